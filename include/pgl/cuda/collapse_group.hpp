// SPDX-License-Identifier: MIT
// How a group of threads collapses one mesh together: the greedy order, rounds, and the places that follow from them.
//
// Written for any group, so that tests can run it without a GPU: a group has `size` threads with ranks from 0, and
// sync(), ballot(), match(), shuffle() and atomics among them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "pgl/bounds.hpp"
#include "pgl/build_ecol.hpp"
#include "pgl/collapse.hpp"
#include "pgl/config.hpp"
#include "pgl/types.hpp"

#if defined(__CUDACC__)
#define PGL_DEVICE __device__
#else
#define PGL_DEVICE
#endif

namespace pgl::cuda::detail {

/// The arrays of one mesh, in the caller's memory: what build_ecol reads and writes.
template <class Index>
struct EcolArrays {
  const glm::vec3* positions;
  const Triangle<Index>* triangles;
  const std::uint8_t* locked;  ///< null: none
  Index* ecol;
  Index* permute_v;
  std::uint32_t* permute_t;
  std::uint32_t* map;
  float* error;  ///< null: not asked for
};

/// What one mesh needs while it is collapsed, in one piece of shared or global memory.
template <class Real, class Id>
struct CollapseState {
  using Mesh = CollapsingMesh<Real, Id>;
  using Cost = typename Mesh::Cost;
  static constexpr unsigned fan = 8;             ///< children of a node of the tree
  static constexpr std::uint32_t scanned = 256;  ///< so many vertices or nodes are looked through without a tree

  Mesh m;
  Cost* cost = nullptr;  ///< per vertex: its candidate
  Id* target = nullptr;
  std::uint32_t* mark = nullptr;    ///< per vertex: greedy: seen in this step; rounds: the round in which it went
  Id* touched = nullptr;            ///< greedy: the vertices around the collapse
  Id* tree = nullptr;               ///< greedy: per node, the vertex with the least candidate below it
  std::uint64_t* claims = nullptr;  ///< rounds: per vertex, the least rank that reaches it
  std::uint8_t* stale = nullptr;    ///< rounds: per vertex, its candidate must be looked for again
  float* distances = nullptr;       ///< rounds, with error: of the collapse in which the vertex went

  /// Lays the arrays out from `memory` on, aligned to 16 bytes, and returns their size: with null, only that.
  PGL_HD static std::size_t lay_out(CollapseState& s, void* memory, std::uint32_t vertices, std::uint32_t triangles,
                                    const EcolOptions& options, bool with_error) {
    std::size_t size = 0;
    const auto take = [&](auto*& array, std::size_t count, bool wanted = true) {
      using T = std::remove_reference_t<decltype(*array)>;
      array = nullptr;
      if (!wanted) return;
      size = (size + alignof(T) - 1) / alignof(T) * alignof(T);
      if (memory != nullptr) array = reinterpret_cast<T*>(static_cast<std::byte*>(memory) + size);
      size += count * sizeof(T);
    };
    const bool greedy = options.order == EcolOrder::greedy;
    s.m.vertices = vertices;
    s.m.triangles = triangles;
    s.m.options = options;
    take(s.claims, vertices, !greedy);
    take(s.m.quadrics, vertices, with_error || options.metric == CostMetric::quadric);
    take(s.m.positions, vertices);
    take(s.m.normals, triangles, options.metric == CostMetric::melax);
    take(s.m.weights, vertices, with_error);
    take(s.cost, vertices);
    take(s.mark, vertices);
    take(s.distances, vertices, !greedy && with_error);
    take(s.target, vertices);
    take(s.m.first, vertices);
    take(s.m.last, vertices);
    take(s.m.corners, std::size_t{3} * triangles);
    take(s.m.next, std::size_t{3} * triangles);
    take(s.m.previous, std::size_t{3} * triangles);
    take(s.touched, vertices, greedy);
    std::size_t nodes = 0;
    for (std::uint32_t level = vertices; level > scanned; nodes += level) level = (level + fan - 1) / fan;
    take(s.tree, nodes, greedy);
    take(s.m.flags, vertices);
    take(s.stale, vertices, !greedy);
    return (size + 15) / 16 * 16;
  }
};

/// The least of the threads' values, for all of them.
template <class Group, class T>
PGL_DEVICE T least_of(Group& g, T value) {
  for (unsigned step = Group::size / 2; step > 0; step /= 2) {
    const T other = g.shuffle(value, g.rank() ^ step);
    if (other < value) value = other;
  }
  return value;
}

/// The least candidate of all threads, for all of them.
template <class Group, class Id>
PGL_DEVICE Candidate<std::uint32_t, Id> least_of(Group& g, const Candidate<std::uint32_t, Id>& mine) {
  const std::uint32_t cost = g.least(mine.cost);
  return {cost, static_cast<Id>(g.least(mine.cost == cost ? std::uint32_t{mine.target} : ~std::uint32_t{0}))};
}

/// The sum of the values of the threads up to this one.
template <class Group>
PGL_DEVICE std::uint32_t sum_up_to(Group& g, std::uint32_t value) {
  for (unsigned step = 1; step < Group::size; step *= 2) {
    const std::uint32_t other = g.shuffle(value, g.rank() >= step ? g.rank() - step : g.rank());
    if (g.rank() >= step) value += other;
  }
  return value;
}

/// Of a mask of threads, those with lower (higher) rank than this one.
template <class Group>
PGL_DEVICE std::uint32_t below(const Group& g, std::uint32_t mask) {
  return mask & ((std::uint32_t{1} << g.rank()) - 1);
}
template <class Group>
PGL_DEVICE std::uint32_t above(const Group& g, std::uint32_t mask) {
  return mask & ~((std::uint32_t{2} << g.rank()) - 1);
}

PGL_DEVICE inline std::uint32_t count_bits(std::uint32_t mask) {
#if defined(__CUDA_ARCH__)
  return static_cast<std::uint32_t>(__popc(mask));
#else
  return static_cast<std::uint32_t>(__builtin_popcount(mask));
#endif
}
PGL_DEVICE inline std::uint32_t lowest_bit(std::uint32_t mask) {
#if defined(__CUDA_ARCH__)
  return static_cast<std::uint32_t>(__ffs(static_cast<int>(mask))) - 1;
#else
  return static_cast<std::uint32_t>(__builtin_ctz(mask));
#endif
}

/// Hands the next corners of a list to the threads, one each, none where the list ends, and moves `c` behind them.
template <class Group, class Real, class Id>
PGL_DEVICE Id deal(const Group& g, const CollapsingMesh<Real, Id>& m, Id& c) {
  Id mine = m.none;
  for (unsigned rank = 0; rank < Group::size && c != m.none; ++rank) {
    if (rank == g.rank()) mine = c;
    c = m.next[c];
  }
  return mine;
}

/// Orders n items: those without a key in front, ascending; then by key, the lowest item of each key last. Calls
/// place(item, its place) for each, and end(key, the place behind its items) for each of `keys` keys before that.
/// key(item) is below `keys`, or keys for none. `cursors`: scratch, an entry per key. Returns how many have no key.
template <class Group, class Key, class End, class Place>
PGL_DEVICE std::uint32_t sort_places(Group& g, std::uint32_t n, std::uint32_t keys, std::uint32_t* cursors, Key&& key,
                                     End&& end, Place&& place) {
  for (std::uint32_t k = g.rank(); k < keys; k += Group::size) cursors[k] = 0;
  g.sync();
  std::uint32_t front = 0;
  for (std::uint32_t base = 0; base < n; base += Group::size) {
    const std::uint32_t i = base + g.rank(), k = i < n ? key(i) : 0;
    if (i < n && k < keys) g.add(cursors + k, 1u);
    front += count_bits(g.ballot(i < n && k == keys));
  }
  g.sync();
  std::uint32_t sum = front;
  for (std::uint32_t base = 0; base < keys; base += Group::size) {
    const std::uint32_t k = base + g.rank();
    const std::uint32_t up_to = sum + sum_up_to(g, k < keys ? cursors[k] : 0u);
    if (k < keys) {
      cursors[k] = up_to;
      end(k, up_to);
    }
    sum = g.shuffle(up_to, Group::size - 1);
  }
  g.sync();
  std::uint32_t next = 0;
  for (std::uint32_t base = 0; base < n; base += Group::size) {
    const std::uint32_t i = base + g.rank(), k = i < n ? key(i) : keys;
    const std::uint32_t keyless = g.ballot(i < n && k == keys);
    const std::uint32_t peers = g.match(k) & g.ballot(k < keys);
    const std::uint32_t cursor = k < keys ? cursors[k] : 0;
    g.sync();
    if (k < keys && below(g, peers) == 0) cursors[k] = cursor - count_bits(peers);
    g.sync();
    if (i < n) place(i, k < keys ? cursor - 1 - count_bits(below(g, peers)) : next + count_bits(below(g, keyless)));
    next += count_bits(keyless);
  }
  g.sync();
  return front;
}

template <class Index>
PGL_DEVICE bool is_degenerate(const Triangle<Index>& t) {
  return t.v[0] == t.v[1] || t.v[1] == t.v[2] || t.v[2] == t.v[0];
}

/// Loads the mesh: normalised positions, lists of corners, normals, quadrics, flags. Returns the normalisation.
template <class Group, class Real, class Id, class Index>
PGL_DEVICE Normalisation load_mesh(Group& g, const CollapsingMesh<Real, Id>& m, const EcolArrays<Index>& a) {
  Box box;
  for (std::uint32_t v = g.rank(); v < m.vertices; v += Group::size) box = extend(box, a.positions[v]);
  for (unsigned step = Group::size / 2; step > 0; step /= 2) box = merge(box, g.shuffle(box, g.rank() ^ step));
  const Normalisation n = normalisation(box);
  for (std::uint32_t v = g.rank(); v < m.vertices; v += Group::size) {
    m.positions[v] = normalise<Real>(a.positions[v], n);
    m.first[v] = m.last[v] = m.none;
  }
  g.sync();

  // From the last corner to the first, each pushed in front of its vertex's list, so that the lists ascend.
  const std::uint32_t corners = 3 * m.triangles;
  for (std::uint32_t end = (corners + Group::size - 1) / Group::size * Group::size; end > 0; end -= Group::size) {
    const std::uint32_t c = end - Group::size + g.rank(), t = c / 3;
    bool live = c < corners;
    std::uint32_t v = m.none;
    if (live) {
      const Triangle<Index> triangle = a.triangles[t];
      live = !is_degenerate(triangle);
      if (live) v = triangle.v[c - 3 * t];
      PGL_ASSERT(!live || v < m.vertices);
      m.corners[c] = static_cast<Id>(v);
    }
    const std::uint32_t peers = g.match(v) & g.ballot(live), behind = above(g, peers);
    if (live) {
      const Id after = behind != 0 ? static_cast<Id>(c + lowest_bit(behind) - g.rank()) : m.first[v];
      m.next[c] = after;
      (after == m.none ? m.last[v] : m.previous[after]) = static_cast<Id>(c);
    }
    g.sync();
    if (live && below(g, peers) == 0) {
      m.first[v] = static_cast<Id>(c);
      m.previous[c] = m.none;
    }
    g.sync();
  }
  if (m.normals != nullptr)
    for (std::uint32_t t = g.rank(); t < m.triangles; t += Group::size)
      if (!is_gone(m, t)) m.normals[t] = direction(normal_of(m, t));
  for (std::uint32_t v = g.rank(); v < m.vertices; v += Group::size)
    set_up_vertex(m, v, a.locked == nullptr || a.locked[v] == 0);
  for (std::uint32_t v = g.rank(); v < m.vertices; v += Group::size) a.ecol[v] = no_target<Index>;
  for (std::uint32_t t = g.rank(); t < m.triangles; t += Group::size) a.permute_t[t] = ~std::uint32_t{0};
  g.sync();
  return n;
}

// ---- greedy ---------------------------------------------------------------------------------------------------------

/// The vertex below a node of the tree that has the least candidate. `children`: how many vertices or nodes there are
/// on the level below; `nodes`: what that level holds, null for the vertices themselves.
template <class Real, class Id>
PGL_DEVICE Id least_below(const CollapseState<Real, Id>& s, const Id* nodes, std::uint32_t children,
                          std::uint32_t node) {
  constexpr std::uint32_t fan = CollapseState<Real, Id>::fan;
  CandidateOf<Real, Id> best = no_candidate(s.m);
  for (std::uint32_t i = node * fan; i < children && i < node * fan + fan; ++i) {
    const Id v = nodes == nullptr ? static_cast<Id>(i) : nodes[i];
    if (v == s.m.none) continue;
    const CandidateOf<Real, Id> c{s.cost[v], v};
    if (c.cost < best.cost) best = c;  // upwards: of equal ones the first; one without a candidate has the largest cost
  }
  return best.target;
}

/// Brings the tree up to date after the candidates of vertices(0 .. count - 1) have changed.
template <class Group, class Real, class Id, class Vertices>
PGL_DEVICE void update_tree(Group& g, const CollapseState<Real, Id>& s, std::uint32_t count, Vertices&& vertices) {
  constexpr std::uint32_t fan = CollapseState<Real, Id>::fan;
  const Id* below = nullptr;
  Id* nodes = s.tree;
  std::uint32_t children = s.m.vertices, divisor = 1;
  while (children > s.scanned) {
    const std::uint32_t size = (children + fan - 1) / fan;
    divisor *= fan;
    for (std::uint32_t base = 0; base < count; base += Group::size) {
      const std::uint32_t i = base + g.rank();
      const std::uint32_t node = i < count ? vertices(i) / divisor : ~std::uint32_t{0};
      const std::uint32_t peers = g.match(node);
      if (i < count && detail::below(g, peers) == 0) nodes[node] = least_below(s, below, children, node);
    }
    g.sync();
    below = nodes;
    nodes += size;
    children = size;
  }
}

/// The vertex with the least candidate of all; none where no vertex has one. Precondition: the tree is up to date.
template <class Group, class Real, class Id>
PGL_DEVICE Id least_vertex(Group& g, const CollapseState<Real, Id>& s) {
  constexpr std::uint32_t fan = CollapseState<Real, Id>::fan;
  const Id* nodes = nullptr;
  const Id* above = s.tree;
  std::uint32_t size = s.m.vertices;
  while (size > s.scanned) {
    nodes = above;
    size = (size + fan - 1) / fan;
    above += size;
  }
  CandidateOf<Real, Id> best = no_candidate(s.m);
  for (std::uint32_t i = g.rank(); i < size; i += Group::size) {
    const Id v = nodes == nullptr ? static_cast<Id>(i) : nodes[i];
    if (v == s.m.none) continue;
    const CandidateOf<Real, Id> c{s.cost[v], v};
    if (c.cost < best.cost) best = c;
  }
  return least_of(g, best).target;
}

/// The triangles of a vertex, as long as they are no more than the threads of the group: one each.
template <class Id>
struct Ring {
  Id corner;      ///< none for a thread without a triangle
  Wedge wedge;    ///< of one without a triangle: no vertex at all
  unsigned size;  ///< more than the group has threads: there are more, and the ring holds nothing
};
template <class Group, class Real, class Id>
PGL_DEVICE Ring<Id> ring_of(const Group& g, const CollapsingMesh<Real, Id>& m, std::uint32_t x) {
  Id c = m.first[x];
  Ring<Id> ring{deal(g, m, c), {m.none, m.none, m.none}, Group::size + 1};
  if (c != m.none) return ring;
  if (ring.corner != m.none) ring.wedge = wedge_at(m, ring.corner);
  ring.size = count_bits(g.ballot(ring.corner != m.none));
  return ring;
}

/// Calls body(corner, wedge) on all threads, with each triangle of x on one of them and none on the others, as often as
/// it takes. `ring` is x's.
template <class Group, class Real, class Id, class Body>
PGL_DEVICE void for_ring(const Group& g, const CollapsingMesh<Real, Id>& m, std::uint32_t x, const Ring<Id>& ring,
                         Body&& body) {
  if (ring.size <= Group::size) {
    body(ring.corner, ring.wedge);
    return;
  }
  for (Id c = m.first[x]; c != m.none;) {
    const Id mine = deal(g, m, c);
    body(mine, mine == m.none ? Wedge{m.none, m.none, m.none} : wedge_at(m, mine));
  }
}

/// The two other vertices of thread i's triangle in a ring.
template <class Group, class Id>
PGL_DEVICE Wedge ends_of(const Group& g, const Ring<Id>& ring, unsigned i) {
  struct Ends {
    Id next, previous;
  };
  const Ends ends = g.shuffle(Ends{static_cast<Id>(ring.wedge.next), static_cast<Id>(ring.wedge.previous)}, i);
  return {0, ends.next, ends.previous};
}

/// Whether u may merge into v now; see build_ecol.
template <class Group, class Real, class Id>
PGL_DEVICE bool is_valid_collapse(const Group& g, const CollapsingMesh<Real, Id>& m, std::uint32_t u,
                                  const Ring<Id>& around_u, std::uint32_t v, const Ring<Id>& around_v,
                                  std::uint32_t open) {
  if (around_u.size <= Group::size && around_v.size <= Group::size) {
    SurfaceFacts facts;
    for (unsigned i = 0; i < around_u.size; ++i) add_facts(facts, around_v.wedge, ends_of(g, around_u, i), v);
    std::uint32_t uses_v[2] = {};
    for (unsigned i = 0; i < around_v.size; ++i) {
      const Wedge w = ends_of(g, around_v, i);
      uses_v[0] += (w.next == around_v.wedge.next) + (w.previous == around_v.wedge.next);
      uses_v[1] += (w.next == around_v.wedge.previous) + (w.previous == around_v.wedge.previous);
    }
    const bool breaks = around_v.corner != m.none && !keeps_surface(facts, uses_v, open, m.options.link_condition);
    if (g.ballot(breaks) != 0) return false;
  } else {
    for (Id c = m.first[v]; c != m.none;) {
      const Id mine = deal(g, m, c);
      if (g.ballot(mine != m.none && !keeps_surface(m, u, v, open, mine)) != 0) return false;
    }
  }
  bool flips = false;
  for_ring(g, m, u, around_u,
           [&](Id corner, const Wedge& w) { flips = flips || (corner != m.none && !keeps_facing(m, u, v, w)); });
  return g.ballot(flips) == 0;
}

/// The vertices around u and v, and both, into s.touched, each once; returns how many. `stamp` differs from step to
/// step, by at least 2.
template <class Group, class Real, class Id>
PGL_DEVICE std::uint32_t find_touched(Group& g, const CollapseState<Real, Id>& s, std::uint32_t u,
                                      const Ring<Id>& around_u, std::uint32_t v, const Ring<Id>& around_v,
                                      std::uint32_t stamp) {
  std::uint32_t count = 0;
  const auto append = [&](bool wanted, std::uint32_t x) {
    const bool fresh = wanted && g.exchange(s.mark + x, stamp) != stamp;
    const std::uint32_t mask = g.ballot(fresh);
    if (fresh) s.touched[count + count_bits(below(g, mask))] = static_cast<Id>(x);
    count += count_bits(mask);
  };
  append(g.rank() == 0, u);
  append(g.rank() == 0, v);
  for (int end = 0; end < 2; ++end) {
    const std::uint32_t centre = end == 0 ? u : v;
    const bool one_way = (s.m.flags[centre] & s.m.balanced) != 0;
    for_ring(g, s.m, centre, end == 0 ? around_u : around_v, [&](Id corner, const Wedge& w) {
      append(corner != s.m.none, w.next);
      if (!one_way) append(corner != s.m.none, w.previous);
    });
  }
  g.sync();
  return count;
}

/// The cheapest collapse of u behind `after` in the order (null: of all), found by the whole group.
template <class Group, class Real, class Id>
PGL_DEVICE CandidateOf<Real, Id> cheapest_collapse(Group& g, const CollapsingMesh<Real, Id>& m, std::uint32_t u,
                                                   const Ring<Id>& around_u, std::uint32_t open,
                                                   const CandidateOf<Real, Id>* after) {
  CandidateOf<Real, Id> best = no_candidate(m);
  for_ring(g, m, u, around_u, [&](Id corner, const Wedge& w) {
    if (corner == m.none) return;
    const CandidateOf<Real, Id> at = cheapest_at(m, u, open, after, w);
    if (at < best) best = at;
  });
  return least_of(g, best);
}

/// Brings the candidates of vertices(0 .. count - 1), each there once, up to date: a thread each by look(vertex),
/// which may leave one alone and return false; these are the whole group's.
template <class Group, class Real, class Id, class Vertices, class Look>
PGL_DEVICE void look_at_all(Group& g, const CollapseState<Real, Id>& s, std::uint32_t count, Vertices&& vertices,
                            Look&& look) {
  const CollapsingMesh<Real, Id>& m = s.m;
  for (std::uint32_t base = 0; base < count; base += Group::size) {
    const std::uint32_t i = base + g.rank(), u = i < count ? std::uint32_t{vertices(i)} : 0;
    const bool left_out = i < count && !look(u);
    for (std::uint32_t mask = g.ballot(left_out); mask != 0; mask &= mask - 1) {
      const std::uint32_t large = g.shuffle(u, lowest_bit(mask));
      const CandidateOf<Real, Id> best =
          cheapest_collapse<Group, Real, Id>(g, m, large, ring_of(g, m, large), slide_ends(m, large), nullptr);
      g.sync();  // all have read the flags
      if (g.rank() == 0) {
        s.cost[large] = best.cost;
        s.target[large] = best.target;
        m.flags[large] &= static_cast<std::uint8_t>(~m.rejected);
      }
    }
  }
  g.sync();
}

/// Collapses the mesh in the greedy order: ecol and permute_v of the vertices that go, error, and the vertex that took
/// each triangle away in permute_t. Returns how many vertices are left.
template <class Group, class Real, class Id, class Index>
PGL_DEVICE std::uint32_t collapse_greedily(Group& g, const CollapseState<Real, Id>& s, const Normalisation& n,
                                           const EcolArrays<Index>& a) {
  const CollapsingMesh<Real, Id>& m = s.m;
  // A vertex of more triangles is the whole group's to look at, so that one thread does not keep the others waiting.
  const std::uint32_t most = m.options.metric == CostMetric::melax ? 0 : 8;
  const auto look = [&](std::uint32_t u) {
    CandidateOf<Real, Id> best = no_candidate(m);
    if ((m.flags[u] & m.movable) != 0) {
      std::uint32_t triangles = 0;
      for (Id c = m.first[u]; c != m.none && triangles <= most; c = m.next[c]) ++triangles;
      if (triangles > most) return false;
      best = cheapest_collapse<Real, Id>(m, u, slide_ends(m, u), nullptr);
    }
    s.cost[u] = best.cost;
    s.target[u] = best.target;
    m.flags[u] &= static_cast<std::uint8_t>(~m.rejected);
    return true;
  };
  for (std::uint32_t v = g.rank(); v < m.vertices; v += Group::size) s.mark[v] = ~std::uint32_t{0};
  look_at_all(
      g, s, m.vertices, [](std::uint32_t i) { return i; }, look);
  update_tree(g, s, m.vertices, [](std::uint32_t i) { return i; });

  // A cost that looks at nothing but the two vertices stays as it is, but for those from v. Melax cost changes all
  // around u. So most vertices need not look at all of their neighbours again, only at v where it is a new one.
  const bool costs_stay = m.options.metric != CostMetric::melax;
  const bool may_slide = m.options.boundary == BoundaryRule::slide;
  std::uint32_t left = m.vertices;
  float worst = 0;
  if (a.error != nullptr && g.rank() == 0) a.error[left] = 0;
  for (Id u = least_vertex(g, s); u != m.none; u = least_vertex(g, s)) {
    const CandidateOf<Real, Id> candidate{s.cost[u], s.target[u]};
    const std::uint32_t v = candidate.target, open = slide_ends(m, u);
    const Ring<Id> around_u = ring_of(g, m, u), around_v = ring_of(g, m, v);
    if (!is_valid_collapse(g, m, u, around_u, v, around_v, open)) {
      const CandidateOf<Real, Id> best = cheapest_collapse<Group, Real, Id>(g, m, u, around_u, open, &candidate);
      g.sync();  // all have read the candidate and the flags
      if (g.rank() == 0) {
        s.cost[u] = best.cost;
        s.target[u] = best.target;
        m.flags[u] |= m.rejected;
      }
      g.sync();
      update_tree(g, s, 1, [&](std::uint32_t) { return std::uint32_t{u}; });
      continue;
    }

    const std::uint32_t stamp = 2 * left;
    const std::uint32_t touched = find_touched(g, s, u, around_u, v, around_v, stamp);
    for_ring(g, m, u, around_u, [&](Id corner, const Wedge& w) {
      const bool goes = corner != m.none && (w.next == v || w.previous == v);
      if (corner != m.none && !goes) {
        move_triangle(m, corner, v);
        g.exchange(s.mark + w.next, stamp + 1);  // v is a neighbour now, if it was none
        g.exchange(s.mark + w.previous, stamp + 1);
      } else if (goes) {
        a.permute_t[w.triangle] = u;
        if (!costs_stay) g.exchange(s.mark + (w.next == v ? w.previous : w.next), stamp + 1);
      }
      g.sync();
      for (std::uint32_t mask = g.ballot(goes); mask != 0; mask &= mask - 1) {  // one after the other: lists are shared
        if (g.rank() == lowest_bit(mask)) remove_triangle(m, corner);
        g.sync();
      }
    });
    --left;
    if (g.rank() == 0) {
      const Real distance = join_vertices(m, u, v);
      a.ecol[u] = static_cast<Index>(v);
      a.permute_v[u] = static_cast<Index>(left);
      if (a.error != nullptr) a.error[left] = worst = ieee::max(in_model_units(distance, n), worst);
    }
    g.sync();
    look_at_all(
        g, s, touched, [&](std::uint32_t i) { return s.touched[i]; },
        [&](std::uint32_t x) {
          const std::uint8_t flags = m.flags[x];
          const bool near_u = s.mark[x] == stamp + 1;
          const Id target = s.target[x];
          const bool unsure = (flags & m.rejected) != 0 || target == u || target == v || x == v || x == u;
          if (unsure || (may_slide && (flags & m.balanced) == 0) || (!costs_stay && near_u)) return look(x);
          if (near_u && (flags & m.movable) != 0) {
            const CandidateOf<Real, Id> into_v{cost_key(collapse_cost(m, x, v, false)), static_cast<Id>(v)};
            if (into_v < CandidateOf<Real, Id>{s.cost[x], target}) {
              s.cost[x] = into_v.cost;
              s.target[x] = into_v.target;
            }
          }
          return true;
        });
    update_tree(g, s, touched, [&](std::uint32_t i) { return std::uint32_t{s.touched[i]}; });
  }
  return left;
}

// ---- rounds ---------------------------------------------------------------------------------------------------------

/// What a round finds: whether some vertex has a valid collapse within the limit, and the least cost of the others'.
template <class Cost>
struct RoundFound {
  bool any;
  Cost least;
};

/// Collapses the mesh by rounds: ecol of the vertices that go, their rounds in s.mark and distances, and the vertex
/// that took each triangle away in permute_t. Returns the number of rounds. `threads` of the group share the work;
/// group.found(one thread's) is the group's, for all, and synchronises.
template <class Group, class Real, class Id, class Index>
PGL_DEVICE std::uint32_t collapse_by_rounds(Group& g, std::uint32_t rank, std::uint32_t threads,
                                            const CollapseState<Real, Id>& s, const Normalisation& n,
                                            const EcolArrays<Index>& a) {
  const CollapsingMesh<Real, Id>& m = s.m;
  using Cost = typename CollapsingMesh<Real, Id>::Cost;
  constexpr Cost no_cost = static_cast<Cost>(~Cost{0});
  for (std::uint32_t v = rank; v < m.vertices; v += threads) {
    s.mark[v] = ~std::uint32_t{0};
    s.stale[v] = 1;
  }
  Cost limit = 0;
  for (std::uint32_t round = 0;;) {
    RoundFound<Cost> mine{false, no_cost};
    for (std::uint32_t u = rank; u < m.vertices; u += threads) {
      s.claims[u] = ~std::uint64_t{0};
      if ((m.flags[u] & m.movable) == 0) continue;
      CandidateOf<Real, Id> least{s.cost[u], s.target[u]};
      if (s.stale[u] != 0 || (least.target == m.none && least.cost <= limit)) {
        least = least_collapse(m, u, limit);
        s.cost[u] = least.cost;
        s.target[u] = least.target;
        s.stale[u] = 0;
      }
      if (least.target != m.none)
        mine.any = true;
      else if (least.cost < mine.least)
        mine.least = least.cost;
    }
    const RoundFound<Cost> found = g.found(mine);
    if (!found.any) {
      if (found.least == no_cost) return round;
      limit = round_limit(found.least);
      continue;
    }
    for (std::uint32_t u = rank; u < m.vertices; u += threads) {
      if ((m.flags[u] & m.movable) == 0 || s.target[u] == m.none) continue;
      const std::uint64_t own = round_rank(s.cost[u], u);
      for_region(m, u, s.target[u], [&](std::uint32_t x) {
        g.lower(s.claims + x, own);
        return true;
      });
    }
    g.sync();
    for (std::uint32_t u = rank; u < m.vertices; u += threads) {
      if ((m.flags[u] & m.movable) == 0 || s.target[u] == m.none) continue;
      const std::uint64_t own = round_rank(s.cost[u], u);
      if (for_region(m, u, s.target[u], [&](std::uint32_t x) { return s.claims[x] == own; })) s.mark[u] = round;
    }
    g.sync();
    for (std::uint32_t u = rank; u < m.vertices; u += threads) {
      if (s.mark[u] != round) continue;
      const std::uint32_t v = s.target[u];
      for_region(m, u, v, [&](std::uint32_t x) {
        s.stale[x] = 1;
        return true;
      });
      const Real distance = perform_collapse(m, u, v, [&](std::uint32_t t) { a.permute_t[t] = u; });
      a.ecol[u] = static_cast<Index>(v);
      if (s.distances != nullptr) s.distances[u] = in_model_units(distance, n);
    }
    g.sync();
    ++round;
  }
}

/// The places of the vertices that went by rounds, and the errors. Returns how many vertices are left.
template <class Group, class Real, class Id, class Index>
PGL_DEVICE std::uint32_t place_rounds(Group& g, const CollapseState<Real, Id>& s, std::uint32_t rounds,
                                      std::uint32_t* cursors, const EcolArrays<Index>& a) {
  const std::uint32_t vertices = s.m.vertices;
  const std::uint32_t left = sort_places(
      g, vertices, rounds, cursors,
      [&](std::uint32_t v) { return s.mark[v] == ~std::uint32_t{0} ? rounds : rounds - 1 - s.mark[v]; },
      [](std::uint32_t, std::uint32_t) {},
      [&](std::uint32_t v, std::uint32_t place) { a.permute_v[v] = static_cast<Index>(place); });
  if (a.error != nullptr) {
    for (std::uint32_t v = g.rank(); v < vertices; v += Group::size)
      if (s.mark[v] != ~std::uint32_t{0}) a.error[a.permute_v[v]] = s.distances[v];
    if (g.rank() == 0) a.error[vertices] = 0;
    g.sync();
    if (g.rank() == 0)
      for (std::uint32_t k = vertices; k-- > left;) a.error[k] = ieee::max(a.error[k], a.error[k + 1]);
  }
  g.sync();
  return left;
}

/// The places of vertices that stay and of all triangles, and the map, from ecol, permute_v of the vertices that went,
/// and who took each triangle away in permute_t. `cursors`: scratch, an entry per vertex.
template <class Group, class Index>
PGL_DEVICE void place_all(Group& g, std::uint32_t vertices, std::uint32_t triangles, std::uint32_t left,
                          std::uint32_t* cursors, const EcolArrays<Index>& a) {
  // The places of the vertices that stay: in front, ascending. And the first to go, which takes the degenerate.
  std::uint32_t first_to_go = ~std::uint32_t{0};
  std::uint32_t next = 0;
  for (std::uint32_t base = 0; base < vertices; base += Group::size) {
    const std::uint32_t v = base + g.rank();
    const bool stays = v < vertices && a.ecol[v] == no_target<Index>;
    const std::uint32_t mask = g.ballot(stays);
    if (stays) a.permute_v[v] = static_cast<Index>(next + count_bits(below(g, mask)));
    if (v < vertices && !stays && a.permute_v[v] == vertices - 1) first_to_go = v;
    next += count_bits(mask);
  }
  first_to_go = least_of(g, first_to_go);
  for (std::uint32_t t = g.rank(); t < triangles; t += Group::size)
    if (is_degenerate(a.triangles[t])) a.permute_t[t] = first_to_go;
  g.sync();
  const std::uint32_t front = sort_places(
      g, triangles, vertices, cursors,
      [&](std::uint32_t t) {
        return a.permute_t[t] == ~std::uint32_t{0} ? vertices : std::uint32_t{a.permute_v[a.permute_t[t]]};
      },
      [&](std::uint32_t k, std::uint32_t end) {
        if (k >= left) a.map[k + 1] = end;
      },
      [&](std::uint32_t t, std::uint32_t place) { a.permute_t[t] = place; });
  if (g.rank() == 0) a.map[left] = front;
}

/// All of build_ecol for one mesh, by one group with `memory` as CollapseState::lay_out wants it. Returns how many
/// vertices are left.
template <class Real, class Id, class Group, class Index>
PGL_DEVICE std::uint32_t build_one(Group& g, void* memory, std::uint32_t vertices, std::uint32_t triangles,
                                   const EcolOptions& options, const EcolArrays<Index>& a) {
  CollapseState<Real, Id> s;
  CollapseState<Real, Id>::lay_out(s, memory, vertices, triangles, options, a.error != nullptr);
  const Normalisation n = load_mesh(g, s.m, a);
  std::uint32_t left = 0;
  if (options.order == EcolOrder::greedy) {
    left = collapse_greedily(g, s, n, a);
    g.sync();
  } else {
    const std::uint32_t rounds = collapse_by_rounds(g, g.rank(), Group::size, s, n, a);
    // A round takes a vertex away, so there is room for a cursor a round where the claims were.
    left = place_rounds(g, s, rounds, reinterpret_cast<std::uint32_t*>(s.claims), a);
  }
  place_all(g, vertices, triangles, left, s.mark, a);
  return left;
}

}  // namespace pgl::cuda::detail
