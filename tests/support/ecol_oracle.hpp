// SPDX-License-Identifier: MIT
// Slow, separate answers to what build_ecol computes: the whole greedy order and the rounds by brute force, costs in
// binary128 from the formulas as printed, and the meshes one gets by collapsing one edge at a time.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "pgl/host/build_ecol.hpp"
#include "support/meshes.hpp"

namespace test {

inline constexpr std::uint32_t nowhere = 0xFFFFFFFFu;  ///< no_target, whatever the index width

/// What build_ecol returns, with 32-bit indices.
struct EcolResult {
  std::uint32_t min_vertices = 0;
  std::vector<std::uint32_t> ecol, permute_v, permute_t, map;
  std::vector<float> error;
};

/// What is under test.
template <class Real, class Index>
EcolResult build(const TriangleMesh& mesh, std::span<const std::uint8_t> locked, const pgl::EcolOptions& options,
                 pgl::host::EcolWorkspace<Real>& workspace, bool with_error = true) {
  const std::size_t vertices = mesh.positions.size(), count = mesh.triangles.size();
  std::vector<pgl::Triangle<Index>> triangles(count);
  for (std::size_t t = 0; t < count; ++t)
    for (int i = 0; i < 3; ++i) triangles[t].v[i] = static_cast<Index>(mesh.triangles[t].v[i]);
  // Every output must be written, whatever was there.
  std::vector<Index> ecol(vertices, Index{0x5A5A}), permute_v(vertices, Index{0x5A5A});
  EcolResult result;
  result.permute_t.assign(count, 0x5A5A5A5A);
  result.map.assign(vertices + 1, 0x5A5A5A5A);
  if (with_error) result.error.assign(vertices + 1, -1.0f);
  result.min_vertices = pgl::host::build_ecol<Real>(
      std::span<const glm::vec3>(mesh.positions), std::span<const pgl::Triangle<Index>>(triangles), locked, options,
      workspace, std::span<Index>(ecol), std::span<Index>(permute_v), std::span<std::uint32_t>(result.permute_t),
      std::span<std::uint32_t>(result.map), std::span<float>(result.error));
  result.permute_v.assign(permute_v.begin(), permute_v.end());
  for (const Index target : ecol) result.ecol.push_back(target == pgl::no_target<Index> ? nowhere : target);
  return result;
}

template <class Real = float, class Index = std::uint32_t>
EcolResult build(const TriangleMesh& mesh, const pgl::EcolOptions& options, std::span<const std::uint8_t> locked = {}) {
  pgl::host::EcolWorkspace<Real> workspace;
  return build<Real, Index>(mesh, locked, options, workspace);
}

/// How two results differ first; empty if they agree to the bit where they mean something.
inline std::string difference_of(const EcolResult& a, const EcolResult& b) {
  std::ostringstream out;
  if (a.min_vertices != b.min_vertices) {
    out << "min " << a.min_vertices << " and " << b.min_vertices << "; ";
  }
  // Latest place first: that is the order of the collapses.
  std::uint32_t latest = 0, at = nowhere;
  for (std::uint32_t v = 0; v < a.permute_v.size(); ++v)
    if ((a.permute_v[v] != b.permute_v[v] || a.ecol[v] != b.ecol[v]) &&
        (at == nowhere || std::max(a.permute_v[v], b.permute_v[v]) > latest)) {
      latest = std::max(a.permute_v[v], b.permute_v[v]);
      at = v;
    }
  if (at != nowhere)
    out << "vertex " << at << ": place " << a.permute_v[at] << " target " << static_cast<std::int32_t>(a.ecol[at])
        << " and place " << b.permute_v[at] << " target " << static_cast<std::int32_t>(b.ecol[at]) << "; ";
  for (std::uint32_t t = 0; t < a.permute_t.size(); ++t)
    if (a.permute_t[t] != b.permute_t[t]) {
      out << "triangle " << t << ": place " << a.permute_t[t] << " and " << b.permute_t[t] << "; ";
      break;
    }
  if (a.min_vertices == b.min_vertices)
    for (std::uint32_t k = a.min_vertices; k < a.map.size(); ++k) {
      if (a.map[k] != b.map[k]) {
        out << "map[" << k << "] " << a.map[k] << " and " << b.map[k] << "; ";
        break;
      }
      if (!a.error.empty() && !b.error.empty() && pgl::ieee::to_bits(a.error[k]) != pgl::ieee::to_bits(b.error[k])) {
        out << "error[" << k << "] " << a.error[k] << " and " << b.error[k] << "; ";
        break;
      }
    }
  return out.str();
}

// ---- the order by brute force ---------------------------------------------------------------------------------------

/// The mesh between two collapses. It holds a list of triangles and nothing that is kept up to date from one step to
/// the next: counts, costs and permissions are found anew from the list. Only the cost functions are the rule's.
template <class Real>
class EcolOracle {
 public:
  struct Move {
    std::uint32_t from, to;
  };

  EcolOracle(const TriangleMesh& mesh, std::span<const std::uint8_t> locked, const pgl::EcolOptions& options)
      : options_(options), locked_(locked.begin(), locked.end()), corner_(mesh.triangles) {
    const std::uint32_t vertices = mesh.vertex_count();
    locked_.resize(vertices, 0);
    pgl::Box box;
    for (const glm::vec3& p : mesh.positions)
      for (int axis = 0; axis < 3 && std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); ++axis) {
        box.min[axis] = std::min(box.min[axis], p[axis]);
        box.max[axis] = std::max(box.max[axis], p[axis]);
      }
    frame_ = pgl::normalisation(box);
    for (const glm::vec3& p : mesh.positions) {
      const auto q = pgl::normalise<Real>(p, frame_);
      position_.push_back(q);
      fine_position_.push_back({q.x, q.y, q.z});
    }
    for (std::uint32_t t = 0; t < corner_.size(); ++t) alive_.push_back(!is_degenerate(corner_[t]));
    find_neighbourhoods();

    quadric_.resize(vertices);
    weight_.assign(vertices, Real(0));
    const auto add_plane = [&](std::uint32_t u, const pgl::Vector<Real>& unit, Real weight) {
      pgl::add_plane(quadric_[u], unit, weight);
      weight_[u] = pgl::ieee::add(weight_[u], weight);
    };
    for (std::uint32_t u = 0; u < vertices; ++u)
      for (const std::uint32_t t : around_[u]) add_plane(u, pgl::direction(normal(t)), pgl::triangle_weight(normal(t)));
    if (options.boundary == pgl::BoundaryRule::slide)
      for (std::uint32_t u = 0; u < vertices; ++u)
        for (const std::uint32_t t : around_[u])
          for (int i = 0; i < 3; ++i) {
            const std::uint32_t a = corner_[t].v[i], b = corner_[t].v[(i + 1) % 3];
            if ((a == u || b == u) && uses(a, b) == 1)
              add_plane(u, pgl::open_edge_plane(position_[a], position_[b], normal(t)),
                        pgl::open_edge_weight(position_[a], position_[b], static_cast<Real>(options.boundary_penalty)));
          }

    result_.ecol.assign(vertices, nowhere);
    result_.permute_v.assign(vertices, nowhere);
    result_.permute_t.assign(corner_.size(), nowhere);
    result_.map.assign(vertices + 1, nowhere);
    result_.error.assign(vertices + 1, 0);
    left_ = vertices;
    triangles_left_ = static_cast<std::uint32_t>(corner_.size());
    result_.map[left_] = triangles_left_;
  }

  /// Every half-edge that an alive triangle has, in the order of their indices.
  std::vector<Move> candidates() {
    find_neighbourhoods();
    std::vector<Move> moves;
    for (std::uint32_t u = 0; u < around_.size(); ++u)
      for (const std::uint32_t v : neighbours(u)) moves.push_back({u, v});
    return moves;
  }

  /// The least collapse that is allowed.
  std::optional<Move> best() {
    struct Ranked {
      decltype(pgl::cost_key(Real{})) key;
      Move move;
    };
    std::vector<Ranked> ranked;
    for (const Move& move : candidates()) ranked.push_back({pgl::cost_key(cost(move)), move});
    // Candidates come by (from, to), so a stable sort by cost is the total order.
    std::stable_sort(ranked.begin(), ranked.end(), [](const Ranked& a, const Ranked& b) { return a.key < b.key; });
    for (const Ranked& r : ranked)
      if (allowed(r.move)) return r.move;
    return std::nullopt;
  }

  /// The collapses of the next round, in their order; none when no collapse is allowed. From the definition: every
  /// vertex has its least allowed collapse; the least of all, if it is above the round's limit, lifts the limit to just
  /// below the next power of two; of those within the limit, one is done if it has the least rank at u, at v and at all
  /// their neighbours.
  std::vector<Move> next_round() {
    find_neighbourhoods();
    struct Choice {
      Real cost;
      std::uint32_t to;
    };
    std::map<std::uint32_t, Choice> choices;
    Real least = 0;
    for (std::uint32_t u = 0; u < around_.size(); ++u)
      for (const std::uint32_t v : neighbours(u)) {
        const Real c = ordered(cost({u, v}));
        const auto known = choices.find(u);
        if ((known != choices.end() && !(c < known->second.cost)) || !allowed({u, v})) continue;
        choices[u] = {c, v};
      }
    for (const auto& [u, choice] : choices)
      if (u == choices.begin()->first || choice.cost < least) least = choice.cost;
    if (choices.empty()) return {};
    if (!started_ || least > limit_) limit_ = last_of_binade(least);
    started_ = true;
    std::erase_if(choices, [&](const auto& entry) { return entry.second.cost > limit_; });

    const auto region = [&](std::uint32_t u) {
      std::set<std::uint32_t> out{u, choices[u].to};
      out.merge(neighbours(u));
      out.merge(neighbours(choices[u].to));
      return out;
    };
    const auto before = [&](std::uint32_t a, std::uint32_t b) {
      const Real x = coarse(choices[a].cost), y = coarse(choices[b].cost);
      return x < y || (x == y && scattered(a) < scattered(b));
    };
    std::map<std::uint32_t, std::uint32_t> owner;
    for (const auto& [u, choice] : choices)
      for (const std::uint32_t x : region(u))
        if (const auto [entry, fresh] = owner.try_emplace(x, u); !fresh && before(u, entry->second)) entry->second = u;
    std::vector<Move> round;
    for (const auto& [u, choice] : choices) {
      bool wins = true;
      for (const std::uint32_t x : region(u)) wins = wins && owner[x] == u;
      if (wins) round.push_back({u, choice.to});
    }
    return round;
  }

  void apply(const Move& move) {
    const auto [u, v] = move;
    const auto d = pgl::difference(position_[v], position_[u]);
    const double distance = static_cast<double>(plane_distance(move)) / frame_.scale;
    pgl::merge(quadric_[v], quadric_[u], d);
    weight_[v] = pgl::ieee::add(weight_[v], weight_[u]);
    const bool first = left_ == result_.permute_v.size();
    std::vector<std::uint32_t> gone;
    for (std::uint32_t t = 0; t < corner_.size(); ++t) {
      if (!alive_[t]) {
        if (first) gone.push_back(t);
        continue;
      }
      for (std::uint32_t& c : corner_[t].v)
        if (c == u) c = v;
      if (is_degenerate(corner_[t])) {
        alive_[t] = false;
        gone.push_back(t);
      }
    }
    std::uint32_t place = triangles_left_;
    for (const std::uint32_t t : gone) result_.permute_t[t] = --place;
    triangles_left_ = place;
    const float before = result_.error[left_];
    --left_;
    result_.ecol[u] = v;
    result_.permute_v[u] = left_;
    result_.map[left_] = triangles_left_;
    result_.error[left_] = std::max(before, static_cast<float>(distance));
  }

  EcolResult finish() {
    result_.min_vertices = left_;
    std::uint32_t place = 0;
    for (std::uint32_t& p : result_.permute_v)
      if (p == nowhere) p = place++;
    place = 0;
    for (std::uint32_t& p : result_.permute_t)
      if (p == nowhere) p = place++;
    return result_;
  }

  /// What a candidate costs; call after candidates() or best().
  Real cost(const Move& move) const {
    const auto [u, v] = move;
    const auto d = pgl::difference(position_[v], position_[u]);
    const Real penalty = static_cast<Real>(options_.boundary_penalty);
    const bool slides = options_.boundary == pgl::BoundaryRule::slide && on_boundary(u);
    if (options_.metric == pgl::CostMetric::quadric) return pgl::evaluate(quadric_[u], d);
    if (options_.metric == pgl::CostMetric::edge_length)
      return slides ? pgl::ieee::mul(pgl::length(d), penalty) : pgl::length(d);
    Real bend = 0;
    for (const std::uint32_t f : around_[u]) {
      Real least = std::numeric_limits<Real>::infinity();
      for (const std::uint32_t n : around_[u])
        if (has(n, v))
          least = std::min(least, pgl::dissimilarity(pgl::direction(normal(f)), pgl::direction(normal(n))));
      bend = std::max(bend, least);
    }
    if (slides)
      for (const std::uint32_t w : neighbours(u))
        if (w != v && uses(u, w) == 1)
          bend = std::max(bend, pgl::ieee::mul(penalty, pgl::dissimilarity(
                                                            pgl::direction(pgl::difference(position_[u], position_[w])),
                                                            pgl::direction(d))));
    return pgl::ieee::mul(pgl::length(d), bend);
  }

  /// Whether a candidate may be done; call after candidates() or best(). Open edges are found by doing it.
  bool allowed(const Move& move) const {
    const auto [u, v] = move;
    if (locked_[u]) return false;
    std::vector<Corners> triangles = triangles_at(u, v);
    const std::set<Edge> before = open_edges(triangles);
    for (Corners& t : triangles)
      for (std::uint32_t& c : t.v)
        if (c == u) c = v;
    const std::set<Edge> after = open_edges(triangles);
    if (!on_boundary(u)) {
      if (ending_in(before, v) != ending_in(after, v)) return false;
    } else {
      if (options_.boundary == pgl::BoundaryRule::locked) return false;
      std::vector<std::uint32_t> ends;
      for (const std::uint32_t w : neighbours(u))
        if (uses(u, w) == 1) ends.push_back(w);
      if (ends.size() != 2 || (ends[0] != v && ends[1] != v)) return false;
      if (uses(v, ends[0] == v ? ends[1] : ends[0]) == 1) return false;
      for (const Edge& e : ending_in(after, v)) {
        const std::uint32_t w = e.first == v ? e.second : e.first;
        if (!before.contains(std::minmax(v, w)) && !before.contains(std::minmax(u, w))) return false;
      }
    }
    if (options_.link_condition) {
      std::set<std::uint32_t> across;
      std::set<Edge> across_u, across_v;
      for (const std::uint32_t t : around_[u]) {
        if (has(t, v))
          across.insert(third(t, u, v));
        else
          across_u.insert(opposite(t, u));
      }
      for (const std::uint32_t t : around_[v])
        if (!has(t, u)) across_v.insert(opposite(t, v));
      const std::set<std::uint32_t> nu = neighbours(u), nv = neighbours(v);
      for (const std::uint32_t w : nu)
        if (nv.contains(w) && !across.contains(w)) return false;
      for (const Edge& e : across_u)
        if (across_v.contains(e)) return false;
    }
    if (options_.flip_guard)
      for (const std::uint32_t t : around_[u]) {
        if (has(t, v)) continue;
        const auto& c = corner_[t].v;
        const int at = c[0] == u ? 0 : c[1] == u ? 1 : 2;
        const auto &x = fine_position_[c[(at + 1) % 3]], &y = fine_position_[c[(at + 2) % 3]];
        if (pgl::flips(x, y, fine_position_[u], fine_position_[v])) return false;
      }
    return true;
  }

  std::uint32_t vertices_left() const { return left_; }
  const std::vector<Corners>& corners() const { return corner_; }
  bool alive(std::uint32_t t) const { return alive_[t]; }
  const std::vector<pgl::Vector<Real>>& positions() const { return position_; }
  /// The geometric error of a candidate, in normalised units.
  Real plane_distance(const Move& move) const {
    const auto d = pgl::difference(position_[move.to], position_[move.from]);
    return pgl::plane_distance(pgl::evaluate(quadric_[move.from], d), weight_[move.from]);
  }
  std::uint32_t uses(std::uint32_t a, std::uint32_t b) const {
    std::uint32_t count = 0;
    for (const std::uint32_t t : around_[a]) count += has(t, b);
    return count;
  }
  const std::vector<std::uint32_t>& around(std::uint32_t v) const { return around_[v]; }
  /// Brings uses() and allowed() up to date.
  void find_neighbourhoods() {
    around_.resize(position_.size());
    for (auto& list : around_) list.clear();
    for (std::uint32_t t = 0; t < corner_.size(); ++t)
      if (alive_[t])
        for (const std::uint32_t c : corner_[t].v) around_[c].push_back(t);
  }

 private:
  bool has(std::uint32_t t, std::uint32_t v) const {
    return corner_[t].v[0] == v || corner_[t].v[1] == v || corner_[t].v[2] == v;
  }
  std::set<std::uint32_t> neighbours(std::uint32_t u) const {
    std::set<std::uint32_t> out;
    for (const std::uint32_t t : around_[u]) out.insert(std::begin(corner_[t].v), std::end(corner_[t].v));
    out.erase(u);
    return out;
  }
  bool on_boundary(std::uint32_t u) const {
    for (const std::uint32_t t : around_[u])
      for (const std::uint32_t w : corner_[t].v)
        if (w != u && uses(u, w) == 1) return true;
    return false;
  }
  std::vector<Corners> triangles_at(std::uint32_t u, std::uint32_t v) const {
    std::vector<Corners> out;
    for (const std::uint32_t t : around_[u]) out.push_back(corner_[t]);
    for (const std::uint32_t t : around_[v])
      if (!has(t, u)) out.push_back(corner_[t]);
    return out;
  }
  static std::set<Edge> ending_in(const std::set<Edge>& edges, std::uint32_t v) {
    std::set<Edge> out;
    for (const Edge& e : edges)
      if (e.first == v || e.second == v) out.insert(e);
    return out;
  }
  std::uint32_t third(std::uint32_t t, std::uint32_t u, std::uint32_t v) const {
    for (const std::uint32_t c : corner_[t].v)
      if (c != u && c != v) return c;
    return nowhere;
  }
  Edge opposite(std::uint32_t t, std::uint32_t u) const {
    const auto& c = corner_[t].v;
    if (c[0] == u) return std::minmax(c[1], c[2]);
    if (c[1] == u) return std::minmax(c[0], c[2]);
    return std::minmax(c[0], c[1]);
  }
  pgl::Vector<Real> normal(std::uint32_t t) const {
    const auto& c = corner_[t].v;
    return pgl::triangle_normal(position_[c[0]], position_[c[1]], position_[c[2]]);
  }
  /// A cost as it is compared: what is no number counts as infinite, what rounding made negative as zero.
  static Real ordered(Real cost) {
    return std::isnan(cost) ? std::numeric_limits<Real>::infinity() : std::max(cost, Real(0));
  }
  /// The greatest number with the binary exponent of a cost; zero and all subnormal numbers share one.
  static Real last_of_binade(Real cost) {
    if (cost < std::numeric_limits<Real>::min()) return std::nextafter(std::numeric_limits<Real>::min(), Real(0));
    int exponent = 0;
    std::frexp(cost, &exponent);
    return std::isinf(cost) ? cost : std::nextafter(std::ldexp(Real(1), exponent), Real(0));
  }
  /// Where a vertex stands among those of equal cost.
  static std::uint32_t scattered(std::uint32_t u) {
    std::uint64_t x = u;
    x ^= x / 65536;
    x = x * 2146121005 % (std::uint64_t{1} << 32);
    x ^= x / 32768;
    x = x * 2221713035 % (std::uint64_t{1} << 32);
    return static_cast<std::uint32_t>(x ^ (x / 65536));
  }
  /// A cost as ranks compare it: a double without its last 32 bits.
  static float coarse(float cost) { return cost; }
  static double coarse(double cost) {
    return std::bit_cast<double>(std::bit_cast<std::uint64_t>(cost) & ~std::uint64_t{0xFFFFFFFF});
  }

  pgl::EcolOptions options_;
  std::vector<std::uint8_t> locked_;
  pgl::Normalisation frame_;
  std::vector<pgl::Vector<Real>> position_;
  std::vector<pgl::Vector<double>> fine_position_;
  std::vector<Corners> corner_;
  std::vector<bool> alive_;
  std::vector<pgl::Quadric<Real>> quadric_;
  std::vector<Real> weight_;
  std::vector<std::vector<std::uint32_t>> around_;
  EcolResult result_;
  std::uint32_t left_ = 0, triangles_left_ = 0;
  Real limit_ = 0;  ///< of the rounds
  bool started_ = false;
};

/// Sizes of the rounds, where wanted.
template <class Real>
EcolResult brute_force(const TriangleMesh& mesh, std::span<const std::uint8_t> locked, const pgl::EcolOptions& options,
                       std::vector<std::size_t>* sizes = nullptr) {
  EcolOracle<Real> oracle(mesh, locked, options);
  if (options.order == pgl::EcolOrder::greedy) {
    while (const auto move = oracle.best()) oracle.apply(*move);
    return oracle.finish();
  }
  for (auto round = oracle.next_round(); !round.empty(); round = oracle.next_round()) {
    if (sizes != nullptr) sizes->push_back(round.size());
    for (const auto& move : round) oracle.apply(move);
  }
  return oracle.finish();
}

// ---- the meshes in between ------------------------------------------------------------------------------------------

/// The recorded collapses, done one after another on a plain list of triangles, in the original numbering.
class SequentialCollapse {
 public:
  SequentialCollapse(const TriangleMesh& mesh, const EcolResult& result)
      : result_(result), corner_(mesh.triangles), alive_(mesh.triangles.size(), true), goes_(mesh.positions.size()) {
    for (std::uint32_t v = 0; v < goes_.size(); ++v) goes_[result.permute_v[v]] = v;
    left_ = mesh.vertex_count();
  }

  std::uint32_t vertices_left() const { return left_; }
  bool finished() const { return left_ <= result_.min_vertices; }
  std::uint32_t next_from() const { return goes_[left_ - 1]; }
  std::uint32_t next_to() const { return result_.ecol[next_from()]; }

  void step() {
    const std::uint32_t u = next_from(), v = next_to();
    for (std::uint32_t t = 0; t < corner_.size(); ++t) {
      if (!alive_[t]) continue;
      for (std::uint32_t& c : corner_[t].v)
        if (c == u) c = v;
      if (is_degenerate(corner_[t])) alive_[t] = false;
    }
    --left_;
  }

  bool alive(std::uint32_t t) const { return alive_[t]; }
  const Corners& corners(std::uint32_t t) const { return corner_[t]; }
  std::vector<Corners> triangles() const {
    std::vector<Corners> out;
    for (std::uint32_t t = 0; t < corner_.size(); ++t)
      if (alive_[t]) out.push_back(corner_[t]);
    return out;
  }

 private:
  const EcolResult& result_;
  std::vector<Corners> corner_;
  std::vector<bool> alive_;
  std::vector<std::uint32_t> goes_;
  std::uint32_t left_ = 0;
};

/// Does the recorded collapses one at a time and asks before each whether it is allowed in the mesh as it then is, and
/// in the end whether another one would be. Empty if all is well.
template <class Real>
std::string not_allowed(const TriangleMesh& mesh, std::span<const std::uint8_t> locked, const pgl::EcolOptions& options,
                        const EcolResult& result) {
  EcolOracle<Real> oracle(mesh, locked, options);
  for (SequentialCollapse sequence(mesh, result); !sequence.finished(); sequence.step()) {
    const typename EcolOracle<Real>::Move move{sequence.next_from(), sequence.next_to()};
    oracle.find_neighbourhoods();
    if (oracle.uses(move.from, move.to) == 0 || !oracle.allowed(move))
      return std::to_string(move.from) + " into " + std::to_string(move.to) + " at " +
             std::to_string(sequence.vertices_left()) + " vertices";
    oracle.apply(move);
  }
  return oracle.best() ? "one more would be allowed" : "";
}

/// Why the arrays do not have the form that build_ecol promises; empty if they do.
inline std::string malformed(const TriangleMesh& mesh, const EcolResult& r) {
  const std::uint32_t vertices = mesh.vertex_count(), count = mesh.triangle_count();
  if (r.min_vertices > vertices) return "min above the number of vertices";
  if (vertices > 0 && r.min_vertices == 0) return "min is 0";
  std::vector<bool> seen(vertices, false);
  for (const std::uint32_t p : r.permute_v) {
    if (p >= vertices || seen[p]) return "permute_v is no permutation";
    seen[p] = true;
  }
  seen.assign(count, false);
  for (const std::uint32_t p : r.permute_t) {
    if (p >= count || seen[p]) return "permute_t is no permutation";
    seen[p] = true;
  }
  for (std::uint32_t v = 0; v < vertices; ++v) {
    if ((r.ecol[v] == nowhere) != (r.permute_v[v] < r.min_vertices))
      return "vertex " + std::to_string(v) + ": the vertices without target are not those below min";
    if (r.ecol[v] != nowhere && (r.ecol[v] >= vertices || r.permute_v[r.ecol[v]] >= r.permute_v[v]))
      return "vertex " + std::to_string(v) + " merges into one that went before";
  }
  if (r.map[vertices] != count) return "map does not end with all triangles";
  for (std::uint32_t k = r.min_vertices; k < vertices; ++k) {
    if (r.map[k] > r.map[k + 1]) return "map is not monotone at " + std::to_string(k);
    if (!r.error.empty() && !(r.error[k] >= r.error[k + 1])) return "error increases at " + std::to_string(k + 1);
  }
  if (!r.error.empty() && r.error[vertices] != 0) return "error of the full mesh";
  return {};
}

/// The mesh in the order of removal: rearranged as [Peng13] Alg 1 says.
struct Rearranged {
  std::vector<Corners> triangles;
  std::vector<std::uint32_t> ecol;
};
inline Rearranged rearranged(const TriangleMesh& mesh, const EcolResult& r) {
  Rearranged out{std::vector<Corners>(mesh.triangles.size()), std::vector<std::uint32_t>(mesh.positions.size())};
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t)
    for (int i = 0; i < 3; ++i) out.triangles[r.permute_t[t]].v[i] = r.permute_v[mesh.triangles[t].v[i]];
  for (std::uint32_t v = 0; v < mesh.vertex_count(); ++v)
    out.ecol[r.permute_v[v]] = r.ecol[v] == nowhere ? nowhere : r.permute_v[r.ecol[v]];
  return out;
}

/// The first map(k) triangles with every corner followed down to below k ([Peng13] Alg 3).
inline std::vector<Corners> reformed_prefix(const Rearranged& mesh, const EcolResult& r, std::uint32_t k) {
  std::vector<Corners> out(mesh.triangles.begin(), mesh.triangles.begin() + r.map[k]);
  for (Corners& t : out)
    for (std::uint32_t& c : t.v)
      while (c >= k) c = mesh.ecol[c];
  return out;
}

/// Compares the reformed prefix with the sequential collapse at every `stride`-th count; empty if they are the same
/// oriented triangles in the same order. The form of the arrays is checked first.
inline std::string prefixes_differ(const TriangleMesh& mesh, const EcolResult& r, std::uint32_t stride = 1) {
  if (std::string why = malformed(mesh, r); !why.empty()) return why;
  const Rearranged ordered = rearranged(mesh, r);
  std::vector<std::uint32_t> origin(mesh.triangles.size());
  for (std::uint32_t t = 0; t < origin.size(); ++t) origin[r.permute_t[t]] = t;
  SequentialCollapse sequence(mesh, r);
  for (;;) {
    const std::uint32_t k = sequence.vertices_left();
    if (k % stride == 0 || sequence.finished() || k == mesh.vertex_count()) {
      const std::string at = " at " + std::to_string(k) + " vertices";
      const std::vector<Corners> prefix = reformed_prefix(ordered, r, k);
      std::uint32_t alive = 0;
      for (std::uint32_t t = 0; t < origin.size(); ++t) alive += sequence.alive(t);
      if (alive != prefix.size()) return "map" + at;
      for (std::uint32_t i = 0; i < prefix.size(); ++i) {
        Corners expected = sequence.corners(origin[i]);
        for (std::uint32_t& c : expected.v) c = r.permute_v[c];
        if (!sequence.alive(origin[i]) || !(prefix[i] == expected)) return "triangle " + std::to_string(i) + at;
        for (const std::uint32_t c : prefix[i].v)
          if (c >= k) return "corner out of range" + at;
        if (k < mesh.vertex_count() && is_degenerate(prefix[i])) return "degenerate triangle" + at;
      }
    }
    if (sequence.finished()) return {};
    sequence.step();
  }
}

// ---- costs in binary128 ---------------------------------------------------------------------------------------------

__extension__ using Quad = __float128;

inline Quad quad_sqrt(Quad x) {
  if (!(x > 0)) return 0;
  Quad root = std::sqrt(static_cast<long double>(x));
  for (int i = 0; i < 2; ++i) root = (root + x / root) / 2;
  return root;
}

struct QuadVector {
  Quad x = 0, y = 0, z = 0;
  QuadVector() = default;
  QuadVector(Quad a, Quad b, Quad c) : x(a), y(b), z(c) {}
  template <class Real>
  explicit QuadVector(const pgl::Vector<Real>& p) : x(p.x), y(p.y), z(p.z) {}
  friend QuadVector operator-(const QuadVector& a, const QuadVector& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend Quad dot(const QuadVector& a, const QuadVector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
  friend QuadVector cross(const QuadVector& a, const QuadVector& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
  Quad norm() const { return quad_sqrt(dot(*this, *this)); }
  QuadVector unit() const {
    const Quad l = norm();
    return l > 0 ? QuadVector(x / l, y / l, z / l) : QuadVector();
  }
};

/// An exact value, and how far the same formula in Real may be from it.
struct Bounded {
  Quad value = 0, slack = 0;
  bool holds(Quad computed) const {
    const Quad apart = computed - value;
    return (apart < 0 ? -apart : apart) <= slack;
  }
};

/// The three costs from the formulas as printed, in binary128: a quadric is a list of planes, and its value the sum of
/// weight times squared distance; nothing is expanded, shifted or merged.
///
/// The bounds, with u the unit roundoff of Real. The normal N of a triangle with sides a, b comes out with an error of
/// at most 6 u |a||b| (three roundings a product, one a difference). Its term (N.d)^2 / 2|N| changes by at most
/// 1.5 |d|^2 for each unit of N, so 9 u |a||b| |d|^2. Weight and unit vector are good to 12 u, the sums over P planes
/// to P u, the evaluation to 7 u, each of M merges to 12 u more, all relative to weight times the square of the whole
/// way that the plane was moved. An upright plane inherits the unit error (6 |a||b| / |N| + 14) u of its triangle,
/// twice. Together: (40 + P + 12 M) u times the sum of size * way^2. Normals shorter than the root of the least normal
/// number lose their square, so their whole term is slack.
template <class Real>
class QuadCosts {
 public:
  QuadCosts(const EcolOracle<Real>& mesh, const pgl::EcolOptions& options)
      : mesh_(mesh), options_(options), planes_(mesh.positions().size()), merges_(mesh.positions().size(), 0) {
    for (std::uint32_t u = 0; u < planes_.size(); ++u)
      for (const std::uint32_t t : mesh.around(u)) {
        const Face f = face(t);
        planes_[u].push_back({f.normal.unit(), point(u), f.normal.norm() / 2, f.sides, 0});
        if (options.boundary != pgl::BoundaryRule::slide) continue;
        const auto& c = mesh.corners()[t].v;
        for (int i = 0; i < 3; ++i) {
          const std::uint32_t a = c[i], b = c[(i + 1) % 3];
          if ((a != u && b != u) || mesh.uses(a, b) != 1) continue;
          const QuadVector along = point(b) - point(a);
          const Quad weight = Quad(options.boundary_penalty) * dot(along, along);
          const Quad area = f.normal.norm();
          // Without a normal there is no upright plane: what rounding makes of it is all slack.
          const Quad condition = area > 0 ? f.sides / area : 1 / unit_roundoff;
          planes_[u].push_back({cross(along, f.normal.unit()).unit(), point(u), weight, weight * condition, 0});
        }
      }
  }

  /// Before the oracle itself applies the move.
  void apply(std::uint32_t u, std::uint32_t v) {
    const Quad step = (point(v) - point(u)).norm();
    for (Plane& p : planes_[u]) {
      p.way += step;
      planes_[v].push_back(p);
    }
    planes_[u].clear();
    merges_[v] += merges_[u] + 1;
  }

  Bounded quadric(std::uint32_t u, std::uint32_t v) const {
    Bounded out;
    const Quad step = (point(v) - point(u)).norm();
    const Quad factor = unit_roundoff * Quad(40 + planes_[u].size() + 12 * merges_[u]);
    for (const Plane& p : planes_[u]) {
      const Quad distance = dot(p.normal, point(v) - p.through);
      const Quad way = p.way + step;
      out.value += p.weight * distance * distance;
      out.slack += factor * p.size * way * way + (p.weight < smallest ? p.weight * way * way : Quad(0));
    }
    out.slack += Quad(40 * (planes_[u].size() + 1)) * Quad(std::numeric_limits<Real>::denorm_min());
    return out;
  }

  /// Root mean square distance. |sqrt a - sqrt b| is at most sqrt |a - b|.
  Bounded plane_distance(std::uint32_t u, std::uint32_t v) const {
    const Bounded sum = quadric(u, v);
    Quad weight = 0, weight_slack = 0;
    for (const Plane& p : planes_[u]) {
      weight += p.weight;
      weight_slack += unit_roundoff * Quad(20 + planes_[u].size() + merges_[u]) * p.size;
    }
    if (!(weight > 2 * weight_slack)) return {0, std::numeric_limits<long double>::infinity()};
    const Quad mean = sum.value / weight;
    const Quad mean_slack = 2 * (sum.slack + mean * weight_slack) / weight;
    return {quad_sqrt(mean), quad_sqrt(mean_slack) + 4 * unit_roundoff * quad_sqrt(mean + mean_slack)};
  }

  /// |d| * max over triangles f of u of min over triangles n on uv of (1 - f.n) / 2.
  Bounded melax(std::uint32_t u, std::uint32_t v) const {
    const QuadVector d = point(v) - point(u);
    Quad most = 0, worst_error = 0;
    for (const std::uint32_t f : mesh_.around(u)) {
      Quad least = 2;
      const Face a = face(f);
      for (const std::uint32_t n : mesh_.around(u)) {
        const auto& c = mesh_.corners()[n].v;
        if (c[0] != v && c[1] != v && c[2] != v) continue;
        const Face b = face(n);
        least = std::min(least, (1 - dot(a.normal.unit(), b.normal.unit())) / 2);
        worst_error = std::max(worst_error, (a.error() + b.error()) / 2);
      }
      most = std::max(most, least);
    }
    if (slides(u))
      for (const std::uint32_t w : open_ends(u)) {
        if (w == v) continue;
        const Quad turn = (1 - dot((point(u) - point(w)).unit(), d.unit())) / 2;
        most = std::max(most, Quad(options_.boundary_penalty) * turn);
        worst_error = std::max(worst_error, 12 * unit_roundoff * Quad(options_.boundary_penalty));
      }
    return {d.norm() * most, d.norm() * (worst_error + 12 * unit_roundoff * (1 + most)) + smallest * (1 + most)};
  }

  Bounded edge_length(std::uint32_t u, std::uint32_t v) const {
    const Quad value = (point(v) - point(u)).norm() * (slides(u) ? Quad(options_.boundary_penalty) : Quad(1));
    return {value, value * 6 * unit_roundoff + smallest * Quad(1 + options_.boundary_penalty)};
  }

  Bounded cost(std::uint32_t u, std::uint32_t v) const {
    switch (options_.metric) {
      case pgl::CostMetric::quadric:
        return quadric(u, v);
      case pgl::CostMetric::melax:
        return melax(u, v);
      default:
        return edge_length(u, v);
    }
  }

 private:
  static constexpr Quad unit_roundoff = Quad(std::numeric_limits<Real>::epsilon()) / 2;
  static constexpr Quad smallest = sizeof(Real) == 4 ? Quad(0x1p-62L) : Quad(0x1p-510L);

  struct Plane {
    QuadVector normal, through;  // unit normal; a point of the plane
    Quad weight = 0;
    Quad size = 0;  // bounds the weight, times how ill-conditioned the normal is
    Quad way = 0;   // length of the way that the plane was moved
  };
  struct Face {
    QuadVector normal;
    Quad sides;  // |a||b|
    Quad error() const {
      const Quad area = normal.norm();
      if (!(area > smallest)) return 2;
      return std::min(Quad(2), (6 * sides / area + 4) * unit_roundoff);
    }
  };

  QuadVector point(std::uint32_t v) const { return QuadVector(mesh_.positions()[v]); }
  Face face(std::uint32_t t) const {
    const auto& c = mesh_.corners()[t].v;
    const QuadVector a = point(c[1]) - point(c[0]), b = point(c[2]) - point(c[0]);
    return {cross(a, b), a.norm() * b.norm()};
  }
  std::set<std::uint32_t> open_ends(std::uint32_t u) const {
    std::set<std::uint32_t> out;
    for (const std::uint32_t t : mesh_.around(u))
      for (const std::uint32_t w : mesh_.corners()[t].v)
        if (w != u && mesh_.uses(u, w) == 1) out.insert(w);
    return out;
  }
  bool slides(std::uint32_t u) const { return options_.boundary == pgl::BoundaryRule::slide && !open_ends(u).empty(); }

  const EcolOracle<Real>& mesh_;
  pgl::EcolOptions options_;
  std::vector<std::vector<Plane>> planes_;
  std::vector<std::uint32_t> merges_;
};

}  // namespace test
