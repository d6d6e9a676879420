// SPDX-License-Identifier: MIT
// Progressive collapse order on the CPU: half-edge collapsing, exact greedy or by rounds, of one mesh or of many.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "pgl/collapse.hpp"
#include "pgl/host/bounds.hpp"
#include "pgl/host/prefetch.hpp"
#include "pgl/host/prefix_sum.hpp"

namespace pgl::host {

namespace detail {

inline constexpr std::uint32_t none = ~std::uint32_t{0};

/// A cost and a vertex, ordered by both. In float they share one word: a comparison is one instruction.
template <class Cost>
struct Ranked {
  Cost cost;
  std::uint32_t vertex;
  friend bool operator<(const Ranked& a, const Ranked& b) {
    return a.cost != b.cost ? a.cost < b.cost : a.vertex < b.vertex;
  }
};
inline std::uint64_t rank(std::uint32_t cost, std::uint32_t vertex) {
  return (std::uint64_t{cost} << 32) | vertex;
}
inline std::uint32_t cost_of(std::uint64_t ranked) {
  return static_cast<std::uint32_t>(ranked >> 32);
}
inline std::uint32_t vertex_of(std::uint64_t ranked) {
  return static_cast<std::uint32_t>(ranked);
}
inline Ranked<std::uint64_t> rank(std::uint64_t cost, std::uint32_t vertex) {
  return {cost, vertex};
}
inline std::uint64_t cost_of(const Ranked<std::uint64_t>& ranked) {
  return ranked.cost;
}
inline std::uint32_t vertex_of(const Ranked<std::uint64_t>& ranked) {
  return ranked.vertex;
}

/// A min-heap of vertices by cost, with every vertex's place in it, so that costs can change.
template <class Real>
class VertexHeap {
 public:
  using Cost = decltype(cost_key(Real{}));
  using Entry = decltype(rank(Cost{}, std::uint32_t{}));

  void reset(std::size_t vertices) {
    entries_.clear();
    place_.assign(vertices, none);
  }
  bool empty() const { return entries_.empty(); }
  std::uint32_t top() const { return vertex_of(entries_.front()); }
  bool contains(std::uint32_t v) const { return place_[v] != none; }

  /// The entries that may be next after the top. Precondition: not empty.
  std::span<const Entry> runners_up() const {
    return std::span<const Entry>(entries_).subspan(1, std::min(arity, entries_.size() - 1));
  }

  /// Appends without order; make_heap() orders all.
  void append(Cost cost, std::uint32_t v) {
    place_[v] = static_cast<std::uint32_t>(entries_.size());
    entries_.push_back(rank(cost, v));
  }
  void make_heap() {
    for (std::size_t i = entries_.size() / arity + 1; i-- > 0;)
      if (i < entries_.size()) sink(i, entries_[i]);
  }

  /// Inserts v or changes its cost.
  void set(Cost cost, std::uint32_t v) {
    const Entry e = rank(cost, v);
    std::size_t at = place_[v];
    if (at == none) {
      at = entries_.size();
      entries_.push_back(e);
      rise(at, e);
    } else if (e < entries_[at]) {
      rise(at, e);
    } else {
      sink(at, e);
    }
  }
  void remove(std::uint32_t v) {
    const std::size_t at = place_[v];
    if (at == none) return;
    place_[v] = none;
    const Entry last = entries_.back();
    entries_.pop_back();
    if (at == entries_.size()) return;
    if (last < entries_[at])
      rise(at, last);
    else
      sink(at, last);
  }

 private:
  static constexpr std::size_t arity = 4;

  void put(std::size_t at, const Entry& e) {
    entries_[at] = e;
    place_[vertex_of(e)] = static_cast<std::uint32_t>(at);
  }
  void rise(std::size_t at, const Entry e) {
    while (at > 0) {
      const std::size_t parent = (at - 1) / arity;
      if (!(e < entries_[parent])) break;
      put(at, entries_[parent]);
      at = parent;
    }
    put(at, e);
  }
  void sink(std::size_t at, const Entry e) {
    const std::size_t size = entries_.size();
    for (;;) {
      const std::size_t first = at * arity + 1;
      if (first >= size) break;
      std::size_t least = first;
      const std::size_t last = std::min(first + arity, size);
      for (std::size_t child = first + 1; child < last; ++child)
        if (entries_[child] < entries_[least]) least = child;
      if (!(entries_[least] < e)) break;
      put(at, entries_[least]);
      at = least;
    }
    put(at, e);
  }

  std::vector<Entry> entries_;
  std::vector<std::uint32_t> place_;
};

template <class Real>
class Collapser;
template <class Real>
class Rounds;

}  // namespace detail

/// Scratch memory of build_ecol: about 120 bytes a vertex and 60 a triangle of the largest mesh seen (Real = float).
/// Reuse one per thread from mesh to mesh; it only grows. Contents mean nothing between calls.
template <class Real = float>
class EcolWorkspace {
  friend class detail::Collapser<Real>;
  friend class detail::Rounds<Real>;

  /// What a visit to a neighbour touches: its position, and counts that are valid while `stamp` is the current one.
  struct Near {
    Vector<Real> position;
    std::uint32_t stamp;
    std::uint32_t uses_u;  ///< triangles of u that contain it
    std::uint32_t uses_v;  ///< triangles of v that contain it
    std::uint32_t thirds;  ///< triangles that contain it, u and v
  };
  /// Everything else about a vertex; one cache line in float.
  struct alignas(64) State {
    Quadric<Real> quadric;
    std::uint32_t first, size, capacity;  ///< its wedges
    decltype(cost_key(Real{})) cost;      ///< of its cheapest candidate
    std::uint32_t target;                 ///< of its cheapest candidate
    bool movable;                         ///< may go at all
    bool rejected;                        ///< candidates cheaper than `target` were found invalid
    bool boundary;                        ///< on an open edge
    bool balanced;  ///< its wedges name the same vertices, equally often, as `next` and as `previous`: looking at one
                    ///< is enough. Collapsing keeps this true of every vertex whose own two parts have it.
  };
  /// A triangle as one of its corners sees it: the other two, in the triangle's winding.
  struct Wedge {
    std::uint32_t triangle, next, previous;
  };

  std::vector<Near> near_;
  std::vector<State> state_;
  std::vector<Real> weight_;
  std::vector<Wedge> wedges_;
  std::vector<Triangle<std::uint32_t>> triangles_;  ///< current corners, for the normals
  std::vector<Vector<Real>> normals_, edge_normals_;
  std::vector<std::uint32_t> ring_, touched_, vanished_, degenerate_;
  detail::VertexHeap<Real> heap_;

  /// What a mesh collapsed by rounds needs besides (the vectors above have other element types).
  struct RoundsState {
    std::vector<Vector<Real>> positions, normals;
    std::vector<Quadric<Real>> quadrics;
    std::vector<Real> weights;
    std::vector<std::uint32_t> first, last, corners, next, previous;
    std::vector<std::uint8_t> flags, stale;
    std::vector<CandidateOf<Real, std::uint32_t>> least;
    std::vector<std::uint64_t> claims;
    std::vector<std::uint32_t> live, stale_list, candidates, winners;
    std::vector<float> distances;
  };
  RoundsState rounds_;
};

namespace detail {

template <class Real>
class Collapser {
  using Work = EcolWorkspace<Real>;
  using Wedge = typename Work::Wedge;
  using Cost = decltype(cost_key(Real{}));
  using Rank = decltype(rank(Cost{}, std::uint32_t{}));

 public:
  Collapser(Work& work, const EcolOptions& options, bool with_error)
      : w_(work),
        o_(options),
        with_error_(with_error),
        with_quadrics_(with_error || options.metric == CostMetric::quadric),
        with_normals_(options.metric == CostMetric::melax) {}

  template <class Index>
  void load(std::span<const glm::vec3> positions, std::span<const Triangle<Index>> triangles,
            std::span<const std::uint8_t> locked) {
    const std::size_t vertices = positions.size();
    normalisation_ = normalisation(bounds(positions));
    w_.near_.resize(vertices);
    w_.state_.resize(vertices);
    for (std::size_t v = 0; v < vertices; ++v) {
      w_.near_[v] = {normalise<Real>(positions[v], normalisation_), 0, 0, 0, 0};
      w_.state_[v] = {};
      w_.state_[v].target = none;
      w_.state_[v].movable = locked.empty() || locked[v] == 0;
    }

    w_.degenerate_.clear();
    const auto corners = [&](std::size_t t) {
      return Triangle<std::uint32_t>{{triangles[t].v[0], triangles[t].v[1], triangles[t].v[2]}};
    };
    const auto degenerate = [](const Triangle<std::uint32_t>& t) {
      return t.v[0] == t.v[1] || t.v[1] == t.v[2] || t.v[2] == t.v[0];
    };
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const auto tri = corners(t);
      PGL_ASSERT(tri.v[0] < vertices && tri.v[1] < vertices && tri.v[2] < vertices);
      if (degenerate(tri))
        w_.degenerate_.push_back(static_cast<std::uint32_t>(t));
      else
        for (const std::uint32_t v : tri.v) ++w_.state_[v].size;
    }
    std::uint32_t used = 0;
    for (auto& s : w_.state_) {
      s.first = used;
      s.capacity = s.size;
      used += s.size;
      s.size = 0;
    }
    w_.wedges_.resize(used);
    if (with_normals_) {
      w_.triangles_.resize(triangles.size());
      w_.normals_.resize(triangles.size());
    }
    if (with_error_) w_.weight_.assign(vertices, Real(0));
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const auto tri = corners(t);
      if (degenerate(tri)) continue;
      for (int c = 0; c < 3; ++c) {
        auto& s = w_.state_[tri.v[c]];
        w_.wedges_[s.first + s.size++] = {static_cast<std::uint32_t>(t), tri.v[(c + 1) % 3], tri.v[(c + 2) % 3]};
      }
      if (with_normals_) w_.triangles_[t] = tri;
      if (!with_normals_ && !with_quadrics_) continue;
      const Vector<Real> n = triangle_normal(position(tri.v[0]), position(tri.v[1]), position(tri.v[2]));
      const Vector<Real> unit = direction(n);
      if (with_normals_) w_.normals_[t] = unit;
      if (with_quadrics_)
        for (const std::uint32_t v : tri.v) add_plane(v, unit, triangle_weight(n));
    }
    stamp_ = 0;
    set_up_candidates(triangles);
  }

  /// Performs the next collapse. False when none is valid.
  bool step() {
    while (!w_.heap_.empty()) {
      const std::uint32_t u = w_.heap_.top();
      auto& s = w_.state_[u];
      if (valid(u, s.target)) {
        collapse(u, s.target);
        return true;
      }
      find(u, true, s.cost, s.target);
      place(u);
    }
    return false;
  }

  std::uint32_t from() const { return from_; }
  std::uint32_t to() const { return to_; }
  /// The triangles that the last collapse removed, ascending. The first collapse also removes the degenerate ones.
  std::span<const std::uint32_t> vanished() const { return w_.vanished_; }
  /// Geometric error of the last collapse, in model units.
  float error() const { return in_model_units(plane_distance_, normalisation_); }

 private:
  std::span<Wedge> wedges(std::uint32_t v) { return {w_.wedges_.data() + w_.state_[v].first, w_.state_[v].size}; }
  const Vector<Real>& position(std::uint32_t v) const { return w_.near_[v].position; }
  bool is_current(std::uint32_t v) const { return w_.near_[v].stamp == stamp_; }

  void add_plane(std::uint32_t v, const Vector<Real>& unit, Real weight) {
    pgl::add_plane(w_.state_[v].quadric, unit, weight);
    if (with_error_) w_.weight_[v] = ieee::add(w_.weight_[v], weight);
  }

  /// The neighbours of u, each once, into ring_, with uses_u counted.
  void visit_ring(std::uint32_t u) {
    ++stamp_;
    ring_size_ = 0;
    const auto around = wedges(u);
    if (w_.ring_.size() < 2 * around.size()) w_.ring_.resize(2 * around.size());
    if (w_.state_[u].balanced) {
      for (const Wedge& wedge : around) visit(wedge.next, 2);
    } else {
      for (const Wedge& wedge : around) {
        visit(wedge.next, 1);
        visit(wedge.previous, 1);
      }
    }
  }
  void visit(std::uint32_t x, std::uint32_t uses) {  // without branches: whether x is new is a coin toss
    auto& n = w_.near_[x];
    const bool is_new = n.stamp != stamp_;
    n.stamp = stamp_;
    n.uses_u = is_new ? uses : n.uses_u + uses;
    n.uses_v = n.thirds = 0;
    w_.ring_[ring_size_] = x;
    ring_size_ += is_new;
  }
  std::span<const std::uint32_t> ring() const { return {w_.ring_.data(), ring_size_}; }
  std::size_t open_edges() const {
    std::size_t count = 0;
    for (const std::uint32_t x : ring()) count += w_.near_[x].uses_u == 1;
    return count;
  }

  template <class Index>
  void set_up_candidates(std::span<const Triangle<Index>> triangles) {
    w_.heap_.reset(w_.near_.size());
    for (std::uint32_t u = 0; u < w_.near_.size(); ++u) {
      auto& s = w_.state_[u];
      visit_ring(u);
      for (const Wedge& wedge : wedges(u)) {  // uses_v serves as the count of next minus previous
        ++w_.near_[wedge.next].uses_v;
        --w_.near_[wedge.previous].uses_v;
      }
      s.boundary = false;
      s.balanced = true;
      for (const std::uint32_t x : ring()) {
        s.boundary = s.boundary || w_.near_[x].uses_u == 1;
        s.balanced = s.balanced && w_.near_[x].uses_v == 0;
      }
      if (s.boundary && o_.boundary == BoundaryRule::locked) s.movable = false;
      if (!s.movable && o_.boundary == BoundaryRule::locked) continue;
      if (s.boundary && with_quadrics_) add_open_edges(u, triangles);
      if (!s.movable) continue;
      find(u, false, 0, 0);
      if (s.target != none) w_.heap_.append(s.cost, u);
    }
    w_.heap_.make_heap();
  }

  /// The planes of u's open edges, with u's ring visited.
  template <class Index>
  void add_open_edges(std::uint32_t u, std::span<const Triangle<Index>> triangles) {
    for (const Wedge& wedge : wedges(u)) {
      const auto& tri = triangles[wedge.triangle].v;
      const Vector<Real> n = triangle_normal(position(tri[0]), position(tri[1]), position(tri[2]));
      for (int c = 0; c < 3; ++c) {
        const std::uint32_t a = tri[c], b = tri[(c + 1) % 3];
        if ((a != u && b != u) || w_.near_[a == u ? b : a].uses_u != 1) continue;
        add_plane(u, open_edge_plane(position(a), position(b), n),
                  open_edge_weight(position(a), position(b), static_cast<Real>(o_.boundary_penalty)));
      }
    }
  }

  /// The cost of u -> x. Melax cost, and a boundary vertex, need u's ring visited.
  Real cost(std::uint32_t u, std::uint32_t x) {
    const Vector<Real> d = difference(position(x), position(u));
    if (o_.metric == CostMetric::quadric) return evaluate(w_.state_[u].quadric, d);
    const Real l = length(d);
    const bool slides = w_.state_[u].boundary;
    const auto penalty = static_cast<Real>(o_.boundary_penalty);
    if (o_.metric == CostMetric::edge_length) return edge_length_cost(l, slides, penalty);
    w_.edge_normals_.clear();
    for (const Wedge& n : wedges(u))
      if (n.next == x || n.previous == x) w_.edge_normals_.push_back(w_.normals_[n.triangle]);
    Real curvature = 0;
    for (const Wedge& f : wedges(u)) {
      Real least = ieee::infinity<Real>;
      for (const Vector<Real>& n : w_.edge_normals_)
        least = ieee::min(dissimilarity(w_.normals_[f.triangle], n), least);
      curvature = ieee::max(least, curvature);
    }
    if (slides) {
      const Vector<Real> ahead = direction(d);
      for (const std::uint32_t y : ring()) {
        if (y == x || w_.near_[y].uses_u != 1) continue;
        const Vector<Real> along = direction(difference(position(u), position(y)));
        curvature = ieee::max(slide_curvature(along, ahead, penalty), curvature);
      }
    }
    return melax_cost(l, curvature);
  }

  /// Finds u's cheapest target; with `after`, the cheapest one behind (cost, target) in the order. No target: none.
  void find(std::uint32_t u, bool after, Cost floor_cost, std::uint32_t floor_target) {
    auto& s = w_.state_[u];
    const Rank floor = rank(floor_cost, floor_target);
    Rank best = rank(~Cost{0}, none);
    const auto consider = [&](Real cost_to, std::uint32_t x) {
      const Rank r = rank(cost_key(cost_to), x);
      const bool better = r < best && !(after && !(floor < r));
      best = better ? r : best;
    };
    visit_ring(u);
    const std::size_t open = o_.boundary == BoundaryRule::slide ? open_edges() : 0;
    s.boundary = open != 0;
    const auto slides_to = [&](std::uint32_t x) { return open == 0 || (open == 2 && w_.near_[x].uses_u == 1); };
    if (o_.metric == CostMetric::quadric) {
      const Quadric<Real> q = s.quadric;
      const Vector<Real> p = position(u);
      for (const std::uint32_t x : ring())
        if (slides_to(x)) consider(evaluate(q, difference(position(x), p)), x);
    } else {
      for (const std::uint32_t x : ring())
        if (slides_to(x)) consider(cost(u, x), x);
    }
    s.target = vertex_of(best);
    s.cost = cost_of(best);
    s.rejected = after;
  }

  void place(std::uint32_t u) {
    if (w_.state_[u].target == none)
      w_.heap_.remove(u);
    else
      w_.heap_.set(w_.state_[u].cost, u);
  }

  /// Whether u -> v is allowed now. Leaves u's ring visited, with all counts set if it is.
  bool valid(std::uint32_t u, std::uint32_t v) {
    visit_ring(u);
    for (const std::uint32_t x : ring()) prefetch(w_.state_.data() + x, 1);
    for (const Wedge& wedge : wedges(u)) {
      w_.near_[wedge.previous].thirds += wedge.next == v;
      w_.near_[wedge.next].thirds += wedge.previous == v;
    }
    for (const Wedge& wedge : wedges(v)) {
      const std::uint32_t a = wedge.next, b = wedge.previous;
      const bool near_a = is_current(a), near_b = is_current(b);  // u is not in its own ring
      w_.near_[a].uses_v += near_a;
      w_.near_[b].uses_v += near_b;
      if (o_.link_condition && near_a && near_b && has_triangle(u, a, b)) return false;
    }

    // With locked boundaries a movable vertex is on no open edge, and never comes to be.
    const std::size_t open = o_.boundary == BoundaryRule::slide ? open_edges() : 0;
    if (open != 0 && (open != 2 || w_.near_[v].uses_u != 1)) return false;
    for (const std::uint32_t x : ring()) {
      const auto& n = w_.near_[x];
      if (x == v || n.uses_v == 0) continue;
      if (o_.link_condition && n.thirds == 0) return false;
      if (open != 0 && n.uses_u == 1 && n.uses_v == 1) return false;
      if (!keeps_open_edges(n.uses_v, n.uses_u, n.thirds, open != 0)) return false;
    }
    return !o_.flip_guard || !flips_any(u, v);
  }

  bool has_triangle(std::uint32_t u, std::uint32_t a, std::uint32_t b) {
    for (const Wedge& wedge : wedges(u))
      if ((wedge.next == a && wedge.previous == b) || (wedge.next == b && wedge.previous == a)) return true;
    return false;
  }

  bool flips_any(std::uint32_t u, std::uint32_t v) {
    const auto wide = [&](std::uint32_t x) { return Vector<double>(position(x)); };
    const Vector<double> from = wide(u), to = wide(v);
    for (const Wedge& wedge : wedges(u)) {
      if (wedge.next == v || wedge.previous == v) continue;
      if (flips(wide(wedge.next), wide(wedge.previous), from, to)) return true;
    }
    return false;
  }

  /// Performs u -> v, right after valid(u, v) said yes.
  void collapse(std::uint32_t u, std::uint32_t v) {
    from_ = u;
    to_ = v;
    for (const std::uint32_t x : ring()) prefetch(w_.wedges_.data() + w_.state_[x].first, 1);
    for (const auto& next : w_.heap_.runners_up()) {
      const auto& s = w_.state_[vertex_of(next)];
      prefetch(w_.wedges_.data() + s.first, 1);
      prefetch(w_.state_.data() + s.target, 1);
      prefetch(w_.near_.data() + s.target, 1);
    }
    if (with_quadrics_) merge_quadrics(u, v);
    move_triangles(u, v);
    w_.heap_.remove(u);

    // Only the vertices around u and v can have a different cost or a different answer from valid(): those whose
    // choice may have changed look again, the others only at their new neighbour v.
    w_.touched_.clear();
    for (const std::uint32_t x : ring()) {
      const auto& n = w_.near_[x];
      const auto& s = w_.state_[x];
      if (x == v || !s.movable) continue;
      const bool gone = n.uses_v != 0 && merged_edge_uses(n.uses_v, n.uses_u, n.thirds) == 0;
      const bool rim_changed = s.boundary && n.uses_v != 0;
      if (o_.metric == CostMetric::melax || s.rejected || s.target == u || rim_changed || gone)
        w_.touched_.push_back(x);
      else if (n.uses_v == 0 && (!s.boundary || (n.uses_u == 1 && s.target != none)))
        offer(x, v);
    }
    for (const Wedge& wedge : wedges(v)) {
      const std::uint32_t ends[] = {wedge.next, wedge.previous};  // nvcc cannot loop over a braced list here
      for (const std::uint32_t x : ends) {
        if (is_current(x) || !w_.state_[x].rejected || !w_.state_[x].movable) continue;
        w_.near_[x].stamp = stamp_;
        w_.touched_.push_back(x);
      }
    }
    if (w_.state_[v].movable) w_.touched_.push_back(v);
    for (const std::uint32_t x : w_.touched_) {
      find(x, false, 0, 0);
      place(x);
    }
  }

  void merge_quadrics(std::uint32_t u, std::uint32_t v) {
    const Vector<Real> d = difference(position(v), position(u));
    const Quadric<Real>& q = w_.state_[u].quadric;
    if (with_error_) {
      plane_distance_ = plane_distance(evaluate(q, d), w_.weight_[u]);
      w_.weight_[v] = ieee::add(w_.weight_[v], w_.weight_[u]);
    }
    merge(w_.state_[v].quadric, q, d);
  }

  /// Triangles with u and v vanish; in the others of u, u becomes v.
  void move_triangles(std::uint32_t u, std::uint32_t v) {
    w_.vanished_.assign(w_.degenerate_.begin(), w_.degenerate_.end());
    w_.degenerate_.clear();

    auto &su = w_.state_[u], &sv = w_.state_[v];
    sv.balanced = sv.balanced && su.balanced;
    std::uint32_t kept = 0;
    for (Wedge* list = wedges(v).data(); const Wedge wedge : wedges(v)) {
      list[kept] = wedge;
      kept += wedge.next != u && wedge.previous != u;
    }
    sv.size = kept;
    kept = 0;
    for (Wedge* list = wedges(u).data(); const Wedge wedge : wedges(u)) {
      const bool vanishes = wedge.next == v || wedge.previous == v;
      list[kept] = wedge;
      kept += !vanishes;
      if (vanishes)
        w_.vanished_.push_back(wedge.triangle);
      else if (with_normals_)
        move_corner(wedge.triangle, u, v);
    }
    su.size = kept;
    join(sv, su);
    std::sort(w_.vanished_.begin(), w_.vanished_.end());
    for (const std::uint32_t x : ring())
      if (x != v) rename(x, u, v);
  }

  /// Appends the wedges of `gone` to those of `to`, in the roomier of their two places, or in a new one: a place grows
  /// by half, so a vertex that wanders through the mesh and gathers triangles costs memory in proportion.
  void join(typename Work::State& to, typename Work::State& gone) {
    if (to.capacity < gone.capacity) {
      std::swap(to.first, gone.first);
      std::swap(to.size, gone.size);
      std::swap(to.capacity, gone.capacity);
    }
    const std::uint32_t size = to.size + gone.size;
    if (size > to.capacity) {
      const std::size_t first = w_.wedges_.size();
      PGL_ASSERT(first + size + size / 2 < none);
      w_.wedges_.resize(first + size + size / 2);
      std::copy_n(w_.wedges_.data() + to.first, to.size, w_.wedges_.data() + first);
      to.first = static_cast<std::uint32_t>(first);
      to.capacity = size + size / 2;
    }
    std::copy_n(w_.wedges_.data() + gone.first, gone.size, w_.wedges_.data() + to.first + to.size);
    to.size = size;
    gone.size = 0;
  }

  void move_corner(std::uint32_t t, std::uint32_t u, std::uint32_t v) {
    auto& tri = w_.triangles_[t].v;
    for (std::uint32_t& x : tri)
      if (x == u) x = v;
    w_.normals_[t] = direction(triangle_normal(position(tri[0]), position(tri[1]), position(tri[2])));
  }

  /// In x's wedges: u becomes v, and those with both vanish.
  void rename(std::uint32_t x, std::uint32_t u, std::uint32_t v) {
    auto& s = w_.state_[x];
    std::uint32_t kept = 0;
    Wedge* const list = w_.wedges_.data() + s.first;
    for (std::uint32_t i = 0; i < s.size; ++i) {
      Wedge wedge = list[i];
      wedge.next = wedge.next == u ? v : wedge.next;
      wedge.previous = wedge.previous == u ? v : wedge.previous;
      list[kept] = wedge;
      kept += wedge.next != wedge.previous;
    }
    s.size = kept;
  }

  /// A new neighbour v of x: x's choice if it is cheaper. Only for costs that do not look at the ring.
  void offer(std::uint32_t x, std::uint32_t v) {
    const Cost c = cost_key(cost(x, v));
    auto& s = w_.state_[x];
    if (s.target != none && (s.cost < c || (s.cost == c && s.target < v))) return;
    s.cost = c;
    s.target = v;
    w_.heap_.set(c, x);
  }

  Work& w_;
  const EcolOptions& o_;
  const bool with_error_, with_quadrics_, with_normals_;
  Normalisation normalisation_;
  std::uint32_t stamp_ = 0;
  std::size_t ring_size_ = 0;
  std::uint32_t from_ = none, to_ = none;
  Real plane_distance_ = 0;
};

/// One mesh collapsed by rounds, see collapse.hpp: every step of a round runs over the vertices that it is about, on
/// all threads where there are enough of them.
template <class Real>
class Rounds {
  using Mesh = CollapsingMesh<Real, std::uint32_t>;
  using Cost = typename Mesh::Cost;
  static constexpr Cost no_cost = static_cast<Cost>(~Cost{0});

 public:
  template <class Index>
  Rounds(EcolWorkspace<Real>& work, const EcolOptions& options, bool with_error, std::span<const glm::vec3> positions,
         std::span<const Triangle<Index>> triangles, std::span<const std::uint8_t> locked,
         std::span<std::uint32_t> removed_by)
      : w_(work.rounds_), removed_by_(removed_by), normalisation_(normalisation(bounds(positions))) {
    const std::size_t vertices = positions.size();
    m_.vertices = static_cast<std::uint32_t>(vertices);
    m_.triangles = static_cast<std::uint32_t>(triangles.size());
    m_.options = options;
    const auto room = [](auto& array, std::size_t size, bool wanted = true) {
      if (array.size() < size) array.resize(size);
      return wanted ? array.data() : nullptr;
    };
    m_.positions = room(w_.positions, vertices);
    m_.quadrics = room(w_.quadrics, vertices, with_error || options.metric == CostMetric::quadric);
    m_.weights = room(w_.weights, vertices, with_error);
    m_.first = room(w_.first, vertices);
    m_.last = room(w_.last, vertices);
    m_.flags = room(w_.flags, vertices);
    m_.corners = room(w_.corners, 3 * triangles.size());
    m_.next = room(w_.next, 3 * triangles.size());
    m_.previous = room(w_.previous, 3 * triangles.size());
    m_.normals = room(w_.normals, triangles.size(), options.metric == CostMetric::melax);
    room(w_.stale, vertices);
    room(w_.least, vertices);
    w_.claims.assign(vertices, 0);
    room(w_.live, vertices);
    room(w_.stale_list, vertices);
    room(w_.candidates, vertices);
    room(w_.winners, vertices);
    room(w_.distances, vertices);

    parallel_for(vertices, grain, [&](std::size_t v) {
      m_.positions[v] = normalise<Real>(positions[v], normalisation_);
      m_.first[v] = m_.last[v] = Mesh::none;
    });
    for (std::uint32_t t = m_.triangles; t-- > 0;) {  // pushed in front, so that each list ascends
      const auto& v = triangles[t].v;
      PGL_ASSERT(v[0] < vertices && v[1] < vertices && v[2] < vertices);
      const bool degenerate = v[0] == v[1] || v[1] == v[2] || v[2] == v[0];
      for (std::uint32_t c = 3; c-- > 0;) {
        const std::uint32_t corner = 3 * t + c;
        m_.corners[corner] = degenerate ? Mesh::none : std::uint32_t{v[c]};
        if (degenerate) continue;
        const std::uint32_t after = m_.first[v[c]];
        m_.next[corner] = after;
        m_.previous[corner] = Mesh::none;
        (after == Mesh::none ? m_.last[v[c]] : m_.previous[after]) = corner;
        m_.first[v[c]] = corner;
      }
    }
    if (m_.normals != nullptr) {
      parallel_for(triangles.size(), grain, [&](std::size_t t) {
        const auto triangle = static_cast<std::uint32_t>(t);
        if (!is_gone(m_, triangle)) m_.normals[t] = direction(normal_of(m_, triangle));
      });
    }
    parallel_for(vertices, grain, [&](std::size_t v) {
      const auto u = static_cast<std::uint32_t>(v);
      set_up_vertex(m_, u, locked.empty() || locked[v] == 0);
      w_.stale[v] = 0;
      w_.live[v] = w_.stale_list[v] = u;
    });
    live_ = stale_ = vertices;
  }

  /// Performs the next round and returns the vertices that went, in order; none when no valid collapse is left.
  std::span<const std::uint32_t> step() {
    candidates_ = select(w_.candidates, candidates_, w_.candidates, 0, [&](std::uint32_t u) { return !w_.stale[u]; });
    look();
    while (candidates_ == 0)
      if (!raise_limit()) return {};

    ++round_;
    const std::span<const std::uint32_t> candidates = std::span(w_.candidates).first(candidates_);
    const std::size_t blocks = blocks_of(candidates_, 512);
    for_blocks(candidates_, blocks, [&](std::size_t, std::size_t begin, std::size_t end) {
      for (const std::uint32_t u : candidates.subspan(begin, end - begin)) claim(u, blocks > 1);
    });
    const std::size_t winners = select(w_.candidates, candidates_, w_.winners, 0, [&](std::uint32_t u) {
      return for_region(m_, u, w_.least[u].target, [&](std::uint32_t x) { return w_.claims[x] == mark(u); });
    });
    std::sort(w_.winners.begin(), w_.winners.begin() + static_cast<std::ptrdiff_t>(winners));
    perform(std::span(w_.winners).first(winners));
    return {w_.winners.data(), winners};
  }

  std::uint32_t target(std::uint32_t u) const { return w_.least[u].target; }
  float distance(std::uint32_t u) const { return w_.distances[u]; }
  std::span<std::uint32_t> scratch() { return w_.winners; }  ///< an entry per vertex, free between steps

 private:
  static constexpr std::size_t grain = 4096;

  /// Parts in which n vertices are worked on; one where there are too few to share.
  static std::size_t blocks_of(std::size_t n, std::size_t least) {
    return std::min(block_count(n * (grain / least)), n / least + 1);
  }

  /// Writes those of the first n of `from` that `keep` says to `to`, from place `at` on, in their order; returns how
  /// many. `from` and `to` may be one, with at = 0.
  template <class Keep>
  std::size_t select(const std::vector<std::uint32_t>& from, std::size_t n, std::vector<std::uint32_t>& to,
                     std::size_t at, Keep&& keep) {
    const std::size_t blocks = blocks_of(n, 256);
    std::array<std::size_t, max_blocks> begins{}, sizes{};
    for_blocks(n, blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
      begins[b] = begin;
      std::size_t size = 0;
      for (std::size_t i = begin; i < end; ++i)
        if (const std::uint32_t u = from[i]; keep(u)) to[at + begin + size++] = u;
      sizes[b] = size;
    });
    std::size_t kept = sizes[0];
    for (std::size_t b = 1; b < blocks; ++b) {
      const auto first = to.begin() + static_cast<std::ptrdiff_t>(at);
      std::copy_n(first + static_cast<std::ptrdiff_t>(begins[b]), sizes[b], first + static_cast<std::ptrdiff_t>(kept));
      kept += sizes[b];
    }
    return kept;
  }

  /// Brings the least collapses of the stale vertices up to date; those that have one within the limit become
  /// candidates.
  void look() {
    candidates_ += select(w_.stale_list, stale_, w_.candidates, candidates_, [&](std::uint32_t u) {
      w_.stale[u] = 0;
      if ((m_.flags[u] & Mesh::movable) == 0) return false;
      w_.least[u] = least_collapse(m_, u, limit_);
      return w_.least[u].target != Mesh::none;
    });
    stale_ = 0;
  }

  /// Without candidates: raises the limit to the cheapest collapse left and looks at the vertices that it lets in.
  bool raise_limit() {
    struct Least {
      Cost cost = no_cost;
      void operator+=(const Least& other) { cost = std::min(cost, other.cost); }
    };
    live_ = select(w_.live, live_, w_.live, 0, [&](std::uint32_t u) { return (m_.flags[u] & Mesh::movable) != 0; });
    const Cost least = sum_blocks(live_, block_count(live_), [&](std::size_t, std::size_t begin, std::size_t end) {
                         Least part;
                         for (std::size_t i = begin; i < end; ++i) part += {w_.least[w_.live[i]].cost};
                         return part;
                       }).cost;
    if (least == no_cost) return false;
    limit_ = round_limit(least);
    stale_ = select(w_.live, live_, w_.stale_list, 0, [&](std::uint32_t u) { return w_.least[u].cost <= limit_; });
    look();
    return true;
  }

  /// What stands in claims where u's collapse is the least of this round so far.
  std::uint64_t mark(std::uint32_t u) const { return (std::uint64_t{round_} << 32) | u; }

  void claim(std::uint32_t u, bool shared) {
    const std::uint64_t mine = mark(u), rank = round_rank(w_.least[u].cost, u);
    const auto before = [&](std::uint64_t mark) {
      if (mark >> 32 != round_) return true;
      const auto other = static_cast<std::uint32_t>(mark);
      return rank < round_rank(w_.least[other].cost, other);
    };
    for_region(m_, u, w_.least[u].target, [&](std::uint32_t x) {
      if (!shared) {
        if (before(w_.claims[x])) w_.claims[x] = mine;
        return true;
      }
      const std::atomic_ref<std::uint64_t> claim(w_.claims[x]);
      for (std::uint64_t old = claim.load(std::memory_order_relaxed);
           before(old) && !claim.compare_exchange_weak(old, mine, std::memory_order_relaxed);) {
      }
      return true;
    });
  }

  /// Performs the collapses of one round and lists the vertices whose own may be others now.
  void perform(std::span<const std::uint32_t> winners) {
    std::atomic<std::size_t> stale{0};
    for_blocks(winners.size(), blocks_of(winners.size(), 64), [&](std::size_t, std::size_t begin, std::size_t end) {
      std::array<std::uint32_t, 256> list;  // regions do not meet: no vertex comes twice
      std::size_t listed = 0;
      const auto flush = [&] {
        const std::size_t at = stale.fetch_add(listed, std::memory_order_relaxed);
        std::copy_n(list.begin(), listed, w_.stale_list.begin() + static_cast<std::ptrdiff_t>(at));
        listed = 0;
      };
      for (const std::uint32_t u : winners.subspan(begin, end - begin)) {
        const std::uint32_t v = w_.least[u].target;
        for_region(m_, u, v, [&](std::uint32_t x) {
          if (w_.stale[x] != 0) return true;
          w_.stale[x] = 1;
          if (listed == list.size()) flush();
          list[listed++] = x;
          return true;
        });
        const Real distance = perform_collapse(m_, u, v, [&](std::uint32_t t) { removed_by_[t] = u; });
        w_.distances[u] = in_model_units(distance, normalisation_);
      }
      flush();
    });
    stale_ = stale;
  }

  typename EcolWorkspace<Real>::RoundsState& w_;
  std::span<std::uint32_t> removed_by_;
  Normalisation normalisation_;
  Mesh m_;
  Cost limit_ = 0;
  std::uint32_t round_ = 0;
  std::size_t live_ = 0;                    ///< those that may move, and some that are gone
  std::size_t stale_ = 0, candidates_ = 0;  ///< how many are listed
};

/// build_ecol with EcolOrder::rounds.
template <class Real, class Index>
std::uint32_t build_by_rounds(std::span<const glm::vec3> positions, std::span<const Triangle<Index>> triangles,
                              std::span<const std::uint8_t> locked, const EcolOptions& options,
                              EcolWorkspace<Real>& workspace, std::span<Index> ecol, std::span<Index> permute_v,
                              std::span<std::uint32_t> permute_t, std::span<std::uint32_t> map,
                              std::span<float> error) {
  const auto vertices = static_cast<std::uint32_t>(positions.size());
  std::fill(ecol.begin(), ecol.end(), no_target<Index>);
  std::fill(permute_t.begin(), permute_t.end(), none);  // until the places are known: the vertex that took it away
  Rounds<Real> rounds(workspace, options, !error.empty(), positions, triangles, locked, permute_t);

  std::uint32_t left = vertices;
  float worst = 0;
  std::uint32_t first_to_go = none;
  if (!error.empty()) error[left] = 0;
  for (auto gone = rounds.step(); !gone.empty(); gone = rounds.step()) {
    if (first_to_go == none) first_to_go = gone.front();
    for (const std::uint32_t u : gone) {
      ecol[u] = static_cast<Index>(rounds.target(u));
      permute_v[u] = static_cast<Index>(--left);
      if (!error.empty()) error[left] = worst = ieee::max(rounds.distance(u), worst);
    }
  }

  // The triangles that each vertex took away, and the degenerate ones with the first; then their places.
  std::fill(map.begin() + left, map.end(), 0u);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const auto& v = triangles[t].v;
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) permute_t[t] = first_to_go;
    if (permute_t[t] != none) ++map[permute_v[permute_t[t]]];
  }
  auto triangles_left = static_cast<std::uint32_t>(triangles.size());
  for (std::uint32_t k = vertices + 1; k-- > left;) map[k] = triangles_left -= map[k];
  const std::span<std::uint32_t> cursors = rounds.scratch();
  for (std::uint32_t k = left; k < vertices; ++k) cursors[k] = map[k + 1];
  std::uint32_t next = 0;
  for (std::uint32_t& t : permute_t) t = t == none ? next++ : --cursors[permute_v[t]];

  next = 0;
  for (std::uint32_t v = 0; v < vertices; ++v)
    if (ecol[v] == no_target<Index>) permute_v[v] = static_cast<Index>(next++);
  return left;
}

}  // namespace detail

/// Orders the collapses of one mesh: repeatedly performs the least valid half-edge collapse, by (cost, vertex that
/// goes, vertex it merges into), until none is valid. Returns the number of vertices left, `min`.
///
/// With EcolOrder::rounds it performs many at a time instead, as pgl/collapse.hpp says: in each round the collapses
/// that are least in their neighbourhoods and cost less than twice as much as the least one known when the limit last
/// rose, in the order of the vertices that go. Everything below holds for both; a prefix is a little coarser or finer
/// in places. Rounds keep all threads busy inside one mesh; the greedy order runs on one.
///
/// A collapse u -> v moves u onto v; the triangles that contain both vanish. It is valid when u is not masked by
/// `locked`, when it respects the open edges (options.boundary), and, by option, the topology (link condition: the
/// neighbours that u and v share are exactly the third vertices of the triangles on uv, and no other pair of triangles
/// falls together) and the facing of every surviving triangle. What each collapse costs: CostMetric.
///
/// In: `positions`, V of them, any unit and place; `triangles`, T of them, indices below V; `locked`, empty or V flags.
/// Out, all in the input's 0-based numbering, with room as stated; outputs may not overlap inputs or each other:
///   ecol[V]       the vertex that v merges into, or no_target
///   permute_v[V]  the place of v when vertices are sorted so that every prefix is a level: the first to go is last
///   permute_t[T]  the place of triangle t likewise; of those that vanish together the lowest index is last
///   map[V + 1]    entry k, min <= k <= V: the triangles left at k vertices; below min untouched
///   error[V + 1]  empty, or for the same k the greatest root-mean-square distance, over all collapses that leave k
///                 vertices or more, from a merged vertex to the planes of the input triangles merged into it (model
///                 units, area weighted, whatever the cost metric; an estimate, not a bound); error[V] = 0, growing as
///                 k falls
/// Feed the result to rearrange().
///
/// Everything is accepted and nothing is lost. Triangles with a repeated index have no edges; they are last in
/// permute_t and leave with the first collapse. Duplicate triangles count with their multiplicity, edges of more than
/// two triangles are kept from becoming open, isolated vertices stay. Preconditions: indices below V; V below 2^32, T
/// below 2^28; V at most 65535 with 16-bit indices (order a larger one in 32); positions finite (a coordinate that is
/// not finite counts as the box's centre; the result is then still deterministic, but means little); boundary_penalty >
/// 0.
///
/// Greedy: about (V + T) log V work, plus the number of triangles around the two vertices of every collapse. Rounds: a
/// pass over the vertices left per round, of which there are some hundreds, plus, for every vertex looked at, the
/// product of the triangles at both ends of the collapses tried. Memory from the workspace. Run many meshes in
/// parallel, each thread with a workspace of its own (see the overload below). The result depends on the input alone,
/// and not at all on an exact power-of-two scale. Source: [Peng13] 2.3, Eq 2.1 and 2.2, five steps; [PC11] 4.1; link
/// condition: Dey, Edelsbrunner, Guha, Nekhayev, *Topology preserving edge contraction*, 1999; quadrics: Garland,
/// Heckbert, *Surface simplification using quadric error metrics*, 1997. In use: tests/unit/build_ecol_test.cpp.
template <class Real = float, class Index>
std::uint32_t build_ecol(std::span<const glm::vec3> positions, std::span<const Triangle<Index>> triangles,
                         std::span<const std::uint8_t> locked, const EcolOptions& options,
                         EcolWorkspace<Real>& workspace, std::span<Index> ecol, std::span<Index> permute_v,
                         std::span<std::uint32_t> permute_t, std::span<std::uint32_t> map, std::span<float> error) {
  const auto vertices = static_cast<std::uint32_t>(positions.size());
  const auto triangle_count = static_cast<std::uint32_t>(triangles.size());
  PGL_ASSERT(ecol.size() == vertices && permute_v.size() == vertices && permute_t.size() == triangle_count);
  PGL_ASSERT(map.size() == positions.size() + 1 && (error.empty() || error.size() == map.size()));
  PGL_ASSERT(locked.empty() || locked.size() == vertices);
  PGL_ASSERT(positions.size() <= no_target<Index>);

  if (options.order == EcolOrder::rounds)
    return detail::build_by_rounds<Real, Index>(positions, triangles, locked, options, workspace, ecol, permute_v,
                                                permute_t, map, error);
  std::fill(ecol.begin(), ecol.end(), no_target<Index>);
  std::fill(permute_t.begin(), permute_t.end(), detail::none);
  detail::Collapser<Real> collapser(workspace, options, !error.empty());
  collapser.load(positions, triangles, locked);

  std::uint32_t left = vertices, triangles_left = triangle_count;
  float worst = 0;
  map[left] = triangles_left;
  if (!error.empty()) error[left] = 0;
  while (collapser.step()) {
    const std::uint32_t u = collapser.from();
    ecol[u] = static_cast<Index>(collapser.to());
    permute_v[u] = static_cast<Index>(--left);
    for (const std::uint32_t t : collapser.vanished()) permute_t[t] = --triangles_left;
    map[left] = triangles_left;
    if (!error.empty()) error[left] = worst = ieee::max(collapser.error(), worst);
  }

  std::uint32_t next = 0;
  for (std::uint32_t v = 0; v < vertices; ++v)
    if (ecol[v] == no_target<Index>) permute_v[v] = static_cast<Index>(next++);
  next = 0;
  for (std::uint32_t& t : permute_t)
    if (t == detail::none) t = next++;
  return left;
}

/// Orders the collapses of many meshes, each as the call above does; in parallel over the meshes.
///
/// `meshes`: which parts of positions, triangles, ecol, permute_v (by first_vertex), permute_t (by first_triangle), map
/// and error (by first_map, vertices + 1 entries) belong to each; what belongs to none is left as it is. `locked` is
/// empty or has a flag per position. min_vertices: out, per mesh, what the call above returns. `workspaces` grows to
/// one per thread and is kept warm by the caller. Other preconditions and promises as above; the result does not depend
/// on the number of threads.
template <class Real = float, class Index>
void build_ecol(std::span<const MeshRange> meshes, std::span<const glm::vec3> positions,
                std::span<const Triangle<Index>> triangles, std::span<const std::uint8_t> locked,
                const EcolOptions& options, std::vector<EcolWorkspace<Real>>& workspaces, std::span<Index> ecol,
                std::span<Index> permute_v, std::span<std::uint32_t> permute_t, std::span<std::uint32_t> map,
                std::span<float> error, std::span<std::uint32_t> min_vertices) {
  PGL_ASSERT(min_vertices.size() == meshes.size());
  PGL_ASSERT(ecol.size() == positions.size() && permute_v.size() == positions.size());
  PGL_ASSERT(permute_t.size() == triangles.size() && (error.empty() || error.size() == map.size()));
  if (workspaces.size() < thread_count()) workspaces.resize(thread_count());
  parallel_for(meshes.size(), 1, [&](std::size_t i) {
    const MeshRange& mesh = meshes[i];
    PGL_ASSERT(mesh.first_map + mesh.vertices < map.size());
    const auto of_mesh = [&](auto array, std::uint64_t first, std::size_t size) {
      return array.empty() ? array : array.subspan(first, size);
    };
    min_vertices[i] = build_ecol<Real, Index>(
        of_mesh(positions, mesh.first_vertex, mesh.vertices), of_mesh(triangles, mesh.first_triangle, mesh.triangles),
        of_mesh(locked, mesh.first_vertex, mesh.vertices), options, workspaces[thread_index()],
        of_mesh(ecol, mesh.first_vertex, mesh.vertices), of_mesh(permute_v, mesh.first_vertex, mesh.vertices),
        of_mesh(permute_t, mesh.first_triangle, mesh.triangles), of_mesh(map, mesh.first_map, mesh.vertices + 1u),
        of_mesh(error, mesh.first_map, mesh.vertices + 1u));
  });
}

}  // namespace pgl::host
