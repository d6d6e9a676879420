// SPDX-License-Identifier: MIT
// The rule of collapsing one mesh step by step: a vertex's least valid collapse, what it changes, and who goes first
// when many vertices go at once.
#pragma once

#include <cstdint>

#include "pgl/build_ecol.hpp"
#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// A mesh while it is collapsed, in memory that its driver owns. Corner 3t + c is corner c of triangle t; the corners
/// of each vertex are a list, so that merging two vertices joins two lists.
///
/// Id numbers vertices and corners: std::uint16_t where both are below 65535, else std::uint32_t. Every list holds the
/// corners of triangles that are left, and only those, whenever no collapse is half done. Degenerate triangles are gone
/// from the start.
template <class Real, class Id>
struct CollapsingMesh {
  static constexpr Id none = static_cast<Id>(~Id{0});
  using Cost = decltype(cost_key(Real{}));

  /// What a vertex may be; see flags.
  static constexpr std::uint8_t movable = 1;   ///< it may go
  static constexpr std::uint8_t balanced = 2;  ///< its triangles name each neighbour as often after it as before it
  static constexpr std::uint8_t present = 4;   ///< it has not gone
  static constexpr std::uint8_t rejected = 8;  ///< its driver has found a collapse of it that is cheaper, but not valid

  std::uint32_t vertices = 0, triangles = 0;
  EcolOptions options;

  Vector<Real>* positions = nullptr;  ///< per vertex, normalised
  Quadric<Real>* quadrics = nullptr;  ///< per vertex; null where neither cost nor error asks for them
  Real* weights = nullptr;            ///< per vertex, of the planes in its quadric; null where no error is asked for
  Id* first = nullptr;                ///< per vertex, its list of corners, none at its end
  Id* last = nullptr;
  std::uint8_t* flags = nullptr;    ///< per vertex
  Id* corners = nullptr;            ///< per corner, its vertex; none at corner 3t where triangle t is gone
  Id* next = nullptr;               ///< per corner, the next one of the same vertex
  Id* previous = nullptr;           ///< and the one before
  Vector<Real>* normals = nullptr;  ///< per triangle, its direction; Melax cost only
};

/// A triangle as one of its corners sees it: the other two, in the triangle's winding.
struct Wedge {
  std::uint32_t triangle, next, previous;
};

template <class Real, class Id>
PGL_HD Wedge wedge_at(const CollapsingMesh<Real, Id>& m, std::uint32_t corner) {
  const std::uint32_t t = corner / 3, c = corner - 3 * t;
  return {t, m.corners[c == 2 ? 3 * t : corner + 1], m.corners[c == 0 ? corner + 2 : corner - 1]};
}

template <class Real, class Id>
PGL_HD bool is_gone(const CollapsingMesh<Real, Id>& m, std::uint32_t triangle) {
  return m.corners[3 * triangle] == m.none;
}

/// How many triangles of u contain x.
template <class Real, class Id>
PGL_HD std::uint32_t edge_uses(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t x) {
  std::uint32_t uses = 0;
  for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
    const Wedge w = wedge_at(m, c);
    uses += (w.next == x) + (w.previous == x);
  }
  return uses;
}

/// How many ends of open edges u is.
template <class Real, class Id>
PGL_HD std::uint32_t open_edges(const CollapsingMesh<Real, Id>& m, std::uint32_t u) {
  std::uint32_t open = 0;
  for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
    const Wedge w = wedge_at(m, c);
    open += (edge_uses(m, u, w.next) == 1) + (edge_uses(m, u, w.previous) == 1);
  }
  return open;
}

/// The direction of a triangle's normal; its length is what triangle_weight takes.
template <class Real, class Id>
PGL_HD Vector<Real> normal_of(const CollapsingMesh<Real, Id>& m, std::uint32_t t) {
  return triangle_normal(m.positions[m.corners[3 * t]], m.positions[m.corners[3 * t + 1]],
                         m.positions[m.corners[3 * t + 2]]);
}

/// Sets up vertex u: its flags, its quadric and weight where there are any. The lists must be there, u's in ascending
/// order of the triangles. `may_move`: the lock mask allows it.
template <class Real, class Id>
PGL_HD void set_up_vertex(const CollapsingMesh<Real, Id>& m, std::uint32_t u, bool may_move) {
  Quadric<Real> q;
  Real weight = 0;
  const auto add = [&](const Vector<Real>& unit, Real w) {
    add_plane(q, unit, w);
    weight = ieee::add(weight, w);
  };
  bool same_both_ways = true;
  std::uint32_t open = 0;
  for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
    const Wedge w = wedge_at(m, c);
    if (m.quadrics != nullptr) {
      const Vector<Real> n = normal_of(m, w.triangle);
      add(direction(n), triangle_weight(n));
    }
    std::uint32_t next_as_next = 0, next_as_previous = 0, previous_as_next = 0, previous_as_previous = 0;
    for (Id d = m.first[u]; d != m.none; d = m.next[d]) {
      const Wedge other = wedge_at(m, d);
      next_as_next += other.next == w.next;
      next_as_previous += other.previous == w.next;
      previous_as_next += other.next == w.previous;
      previous_as_previous += other.previous == w.previous;
    }
    same_both_ways = same_both_ways && next_as_next == next_as_previous && previous_as_next == previous_as_previous;
    open += (next_as_next + next_as_previous == 1) + (previous_as_next + previous_as_previous == 1);
  }
  const bool slides = m.options.boundary == BoundaryRule::slide;
  if (open != 0 && slides && m.quadrics != nullptr) {
    const auto penalty = static_cast<Real>(m.options.boundary_penalty);
    for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
      const std::uint32_t t = wedge_at(m, c).triangle;
      const Vector<Real> n = normal_of(m, t);
      for (std::uint32_t k = 0; k < 3; ++k) {
        const std::uint32_t a = m.corners[3 * t + k], b = m.corners[3 * t + (k == 2 ? 0 : k + 1)];
        if ((a != u && b != u) || edge_uses(m, u, a == u ? b : a) != 1) continue;
        add(open_edge_plane(m.positions[a], m.positions[b], n),
            open_edge_weight(m.positions[a], m.positions[b], penalty));
      }
    }
  }
  if (m.quadrics != nullptr) m.quadrics[u] = q;
  if (m.weights != nullptr) m.weights[u] = weight;
  m.flags[u] = static_cast<std::uint8_t>((may_move && (open == 0 || slides) ? m.movable : 0) |
                                         (same_both_ways ? m.balanced : 0) | m.present);
}

/// The cost of merging u into its neighbour x; `slides`: u is on an open edge.
template <class Real, class Id>
PGL_HD Real collapse_cost(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t x, bool slides) {
  const Vector<Real> d = difference(m.positions[x], m.positions[u]);
  if (m.options.metric == CostMetric::quadric) return evaluate(m.quadrics[u], d);
  const Real l = length(d);
  const auto penalty = static_cast<Real>(m.options.boundary_penalty);
  if (m.options.metric == CostMetric::edge_length) return edge_length_cost(l, slides, penalty);
  // An edge has two triangles as a rule: with their normals at hand, one pass over the triangles of u is enough.
  Vector<Real> normal_0{}, normal_1{};
  std::uint32_t on_edge = 0;
  for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
    const Wedge w = wedge_at(m, c);
    if (w.next != x && w.previous != x) continue;
    (on_edge == 0 ? normal_0 : normal_1) = m.normals[w.triangle];
    ++on_edge;
  }
  Real curvature = 0;
  for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
    const Vector<Real> f = m.normals[c / 3];
    Real least = ieee::infinity<Real>;
    if (on_edge > 0) least = ieee::min(dissimilarity(f, normal_0), least);
    if (on_edge > 1) least = ieee::min(dissimilarity(f, normal_1), least);
    for (Id e = on_edge > 2 ? m.first[u] : m.none; e != m.none; e = m.next[e]) {
      const Wedge w = wedge_at(m, e);
      if (w.next == x || w.previous == x) least = ieee::min(dissimilarity(f, m.normals[w.triangle]), least);
    }
    curvature = ieee::max(least, curvature);
  }
  if (slides) {
    const Vector<Real> ahead = direction(d);
    const auto turn = [&](std::uint32_t y) {
      if (y == x || edge_uses(m, u, y) != 1) return;
      const Vector<Real> along = direction(difference(m.positions[u], m.positions[y]));
      curvature = ieee::max(slide_curvature(along, ahead, penalty), curvature);
    };
    for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
      const Wedge w = wedge_at(m, c);
      turn(w.next);
      turn(w.previous);
    }
  }
  return melax_cost(l, curvature);
}

/// What the triangles of u tell of the two other vertices of one triangle of v, before u merges into v.
struct SurfaceFacts {
  std::uint32_t uses[2] = {};    ///< triangles of u that contain them
  std::uint32_t thirds[2] = {};  ///< those of these that contain v
  bool together = false;         ///< a triangle of u contains both: the two would fall together
};
PGL_HD inline void add_facts(SurfaceFacts& facts, const Wedge& of_v, const Wedge& of_u, std::uint32_t v) {
  const bool on_edge = of_u.next == v || of_u.previous == v;
  const bool same[2] = {of_u.next == of_v.next || of_u.previous == of_v.next,
                        of_u.next == of_v.previous || of_u.previous == of_v.previous};
  for (int k = 0; k < 2; ++k) {
    facts.uses[k] += same[k];
    facts.thirds[k] += same[k] && on_edge;
  }
  facts.together = facts.together || (same[0] && same[1]);
}

/// Whether u, an end of `open` open edges, may merge into its neighbour v as far as these facts of one triangle of v
/// tell: by option the topology stays, and so do the open edges (see build_ecol). uses_v: how many triangles of v
/// contain each of the two vertices; only looked at where u has triangles with it.
PGL_HD constexpr bool keeps_surface(const SurfaceFacts& facts, const std::uint32_t* uses_v, std::uint32_t open,
                                    bool link_condition) {
  if (link_condition && facts.together) return false;
  for (int k = 0; k < 2; ++k) {
    const std::uint32_t uses = facts.uses[k], thirds = facts.thirds[k];
    if (uses == 0) continue;
    if (link_condition && thirds == 0) return false;
    if (open != 0 && uses == 1 && uses_v[k] == 1) return false;
    if (!keeps_open_edges(uses_v[k], uses, thirds, open != 0)) return false;
  }
  return true;
}

/// The same of the triangle at corner `of_v` of v, its facts gathered.
template <class Real, class Id>
PGL_HD bool keeps_surface(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t v, std::uint32_t open,
                          std::uint32_t of_v) {
  const Wedge w = wedge_at(m, of_v);
  SurfaceFacts facts;
  for (Id c = m.first[u]; c != m.none; c = m.next[c]) add_facts(facts, w, wedge_at(m, c), v);
  const std::uint32_t uses_v[2] = {facts.uses[0] == 0 ? 0 : edge_uses(m, v, w.next),
                                   facts.uses[1] == 0 ? 0 : edge_uses(m, v, w.previous)};
  return keeps_surface(facts, uses_v, open, m.options.link_condition);
}

/// Whether a triangle of u keeps its facing when u merges into v, or goes with it.
template <class Real, class Id>
PGL_HD bool keeps_facing(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t v, const Wedge& of_u) {
  if (!m.options.flip_guard || of_u.next == v || of_u.previous == v) return true;
  const auto wide = [&](std::uint32_t x) { return Vector<double>(m.positions[x]); };
  return !flips(wide(of_u.next), wide(of_u.previous), wide(u), wide(v));
}

/// A vertex's collapse: what it costs, and into whom. No target: there is none; its cost is then the largest integer.
template <class Cost, class Id>
struct Candidate {
  Cost cost;
  Id target;
};
template <class Cost, class Id>
PGL_HD constexpr bool operator<(const Candidate<Cost, Id>& a, const Candidate<Cost, Id>& b) {
  return a.cost != b.cost ? a.cost < b.cost : a.target < b.target;
}
template <class Real, class Id>
using CandidateOf = Candidate<typename CollapsingMesh<Real, Id>::Cost, Id>;

template <class Real, class Id>
PGL_HD constexpr CandidateOf<Real, Id> no_candidate(const CollapsingMesh<Real, Id>&) {
  using Cost = typename CollapsingMesh<Real, Id>::Cost;
  return {static_cast<Cost>(~Cost{0}), CollapsingMesh<Real, Id>::none};
}

/// How many ends of open edges u is, where that matters: with locked boundaries a vertex that may move is none.
template <class Real, class Id>
PGL_HD std::uint32_t slide_ends(const CollapsingMesh<Real, Id>& m, std::uint32_t u) {
  const bool may_slide = m.options.boundary == BoundaryRule::slide && (m.flags[u] & m.balanced) == 0;
  return may_slide ? open_edges(m, u) : 0;
}

/// Of the collapses of u into the two vertices beside it in a triangle, the cheaper one, valid or not, but for those
/// that the boundary rule never allows; with `after`, only those behind that one in the order. u may move, and `open`
/// is its slide_ends.
template <class Real, class Id>
PGL_HD CandidateOf<Real, Id> cheapest_at(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t open,
                                         const CandidateOf<Real, Id>* after, const Wedge& of_u) {
  CandidateOf<Real, Id> best = no_candidate(m);
  const auto consider = [&](std::uint32_t x) {
    if (open != 0 && (open != 2 || edge_uses(m, u, x) != 1)) return;
    const CandidateOf<Real, Id> candidate{cost_key(collapse_cost(m, u, x, open != 0)), static_cast<Id>(x)};
    if (candidate < best && (after == nullptr || *after < candidate)) best = candidate;
  };
  consider(of_u.next);
  if ((m.flags[u] & m.balanced) == 0) consider(of_u.previous);
  return best;
}

/// The cheapest collapse of u, as cheapest_at says it, of all of its triangles.
template <class Real, class Id>
PGL_HD CandidateOf<Real, Id> cheapest_collapse(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t open,
                                               const CandidateOf<Real, Id>* after) {
  CandidateOf<Real, Id> best = no_candidate(m);
  for (Id c = m.first[u]; c != m.none; c = m.next[c]) {
    const CandidateOf<Real, Id> at = cheapest_at(m, u, open, after, wedge_at(m, c));
    if (at < best) best = at;
  }
  return best;
}

/// The least valid collapse of u if it costs at most `limit`. If it does not: no target, and the cost of the cheapest
/// collapse above the limit, valid or not.
template <class Real, class Id>
PGL_HD CandidateOf<Real, Id> least_collapse(const CollapsingMesh<Real, Id>& m, std::uint32_t u,
                                            typename CollapsingMesh<Real, Id>::Cost limit) {
  if ((m.flags[u] & m.movable) == 0) return no_candidate(m);
  const std::uint32_t open = slide_ends(m, u);
  CandidateOf<Real, Id> best = cheapest_collapse<Real, Id>(m, u, open, nullptr);
  while (best.target != m.none && best.cost <= limit) {
    const std::uint32_t v = best.target;
    bool valid = true;
    for (Id c = m.first[v]; valid && c != m.none; c = m.next[c]) valid = keeps_surface(m, u, v, open, c);
    for (Id c = m.first[u]; valid && c != m.none; c = m.next[c]) valid = keeps_facing(m, u, v, wedge_at(m, c));
    if (valid) return best;
    const CandidateOf<Real, Id> floor = best;
    best = cheapest_collapse<Real, Id>(m, u, open, &floor);
  }
  return {best.cost, m.none};
}

/// Takes a corner out of the list of its vertex x.
template <class Real, class Id>
PGL_HD void unlink(const CollapsingMesh<Real, Id>& m, std::uint32_t x, std::uint32_t corner) {
  const Id before = m.previous[corner], after = m.next[corner];
  (before == m.none ? m.first[x] : m.next[before]) = after;
  (after == m.none ? m.last[x] : m.previous[after]) = before;
}

/// Part of u -> v, for the triangle at corner `of_u` of u when it has v: takes its corners out of the three lists.
template <class Real, class Id>
PGL_HD void remove_triangle(const CollapsingMesh<Real, Id>& m, std::uint32_t of_u) {
  const std::uint32_t t = of_u / 3;
  for (std::uint32_t c = 3 * t; c < 3 * t + 3; ++c) unlink(m, m.corners[c], c);
  m.corners[3 * t] = m.none;
}

/// Part of u -> v, for the triangle at corner `of_u` of u when it has not v: v takes u's place.
template <class Real, class Id>
PGL_HD void move_triangle(const CollapsingMesh<Real, Id>& m, std::uint32_t of_u, std::uint32_t v) {
  m.corners[of_u] = static_cast<Id>(v);
  if (m.normals != nullptr) m.normals[of_u / 3] = direction(normal_of(m, of_u / 3));
}

/// Last part of u -> v, when all triangles are removed or moved: v gets u's list and quadric, and u may not go again.
/// Returns the geometric error of the collapse in normalised units, 0 where none is asked for.
template <class Real, class Id>
PGL_HD Real join_vertices(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t v) {
  Real distance = 0;
  if (m.quadrics != nullptr) {
    const Vector<Real> d = difference(m.positions[v], m.positions[u]);
    if (m.weights != nullptr) {
      distance = plane_distance(evaluate(m.quadrics[u], d), m.weights[u]);
      m.weights[v] = ieee::add(m.weights[v], m.weights[u]);
    }
    merge(m.quadrics[v], m.quadrics[u], d);
  }
  if ((m.flags[u] & m.balanced) == 0) m.flags[v] &= static_cast<std::uint8_t>(~m.balanced);
  m.flags[u] = 0;
  if (m.first[u] != m.none) {
    if (m.first[v] == m.none) {
      m.first[v] = m.first[u];
    } else {
      m.next[m.last[v]] = m.first[u];
      m.previous[m.first[u]] = m.last[v];
    }
    m.last[v] = m.last[u];
    m.first[u] = m.last[u] = m.none;
  }
  return distance;
}

// ---- many at once ---------------------------------------------------------------------------------------------------
//
// A round looks at the least valid collapse of every vertex that costs at most the round's limit. One is performed if
// no lesser one (by cost, then by the vertex that goes) reaches any vertex of its region, which is all that it reads or
// changes: u, v and their neighbours. So those of one round do not touch each other, and count as performed in the
// order of the vertices that go. When no vertex has one within the limit, the limit rises to the next power of two
// above the least collapse left.

/// The limit of the coming rounds when the least collapse left costs `least`: all that have its binary exponent.
PGL_HD constexpr std::uint32_t round_limit(std::uint32_t least) {
  return least | 0x007fffffu;
}
PGL_HD constexpr std::uint64_t round_limit(std::uint64_t least) {
  return least | 0x000fffffffffffffu;
}

/// A vertex's place among those of equal cost: all different, and without pattern. By index a flat mesh in order, whose
/// costs are all equal, would have one collapse a round.
PGL_HD constexpr std::uint32_t shuffled_index(std::uint32_t u) {
  u = (u ^ (u >> 16)) * 0x7feb352du;
  u = (u ^ (u >> 15)) * 0x846ca68bu;
  return u ^ (u >> 16);
}

/// The order of the collapses of one round: by cost (of a double, its first 32 bits), then by the shuffled index of the
/// vertex that goes.
PGL_HD constexpr std::uint64_t round_rank(std::uint32_t cost, std::uint32_t from) {
  return (static_cast<std::uint64_t>(cost) << 32) | shuffled_index(from);
}
PGL_HD constexpr std::uint64_t round_rank(std::uint64_t cost, std::uint32_t from) {
  return (cost >> 32 << 32) | shuffled_index(from);
}

/// Calls body(x) for the vertices of the region of u -> v, some of them more than once, until it returns false. Tells
/// whether it never did.
#if defined(__CUDACC__)
#pragma nv_exec_check_disable  // the body may be for one side only
#endif
template <class Real, class Id, class Body>
PGL_HD bool for_region(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t v, Body&& body) {
  for (int end = 0; end < 2; ++end) {
    const std::uint32_t centre = end == 0 ? u : v;
    if (!body(centre)) return false;
    for (Id c = m.first[centre]; c != m.none; c = m.next[c]) {
      const Wedge w = wedge_at(m, c);
      if (!body(w.next)) return false;
      if ((m.flags[centre] & m.balanced) == 0 && !body(w.previous)) return false;
    }
  }
  return true;
}

/// Performs u -> v, on one thread. gone(t) is called for the triangles that vanish. Returns what join_vertices does.
#if defined(__CUDACC__)
#pragma nv_exec_check_disable  // the body may be for one side only
#endif
template <class Real, class Id, class Gone>
PGL_HD Real perform_collapse(const CollapsingMesh<Real, Id>& m, std::uint32_t u, std::uint32_t v, Gone&& gone) {
  for (Id c = m.first[u], after; c != m.none; c = after) {
    after = m.next[c];
    const Wedge w = wedge_at(m, c);
    if (w.next == v || w.previous == v) {
      gone(w.triangle);
      remove_triangle(m, c);
    } else {
      move_triangle(m, c, v);
    }
  }
  return join_vertices(m, u, v);
}

}  // namespace pgl
