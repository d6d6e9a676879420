// SPDX-License-Identifier: MIT
// Small meshes for tests: closed, open, one-sided, non-manifold and random, and what can be said of their topology.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "pgl/types.hpp"

namespace test {

using Corners = pgl::Triangle<std::uint32_t>;
using Edge = std::pair<std::uint32_t, std::uint32_t>;  ///< first < second

struct TriangleMesh {
  std::vector<glm::vec3> positions;
  std::vector<Corners> triangles;

  std::uint32_t vertex_count() const { return static_cast<std::uint32_t>(positions.size()); }
  std::uint32_t triangle_count() const { return static_cast<std::uint32_t>(triangles.size()); }
};

/// A whole number in [0, n), the same with every standard library.
inline std::uint32_t below(std::mt19937& rng, std::uint32_t n) {
  return static_cast<std::uint32_t>(rng()) % n;
}

/// A number in [-1, 1), a multiple of 2^-20.
inline float signed_unit(std::mt19937& rng) {
  return static_cast<float>(static_cast<int>(below(rng, 1u << 21)) - (1 << 20)) / static_cast<float>(1 << 20);
}

// ---- closed surfaces ------------------------------------------------------------------------------------------------

inline TriangleMesh tetrahedron() {
  return {{{1, 1, 1}, {-1, -1, 1}, {-1, 1, -1}, {1, -1, -1}}, {{{0, 2, 1}}, {{0, 1, 3}}, {{0, 3, 2}}, {{1, 2, 3}}}};
}

inline TriangleMesh octahedron() {
  return {{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}},
          {{{0, 2, 4}}, {{2, 1, 4}}, {{1, 3, 4}}, {{3, 0, 4}}, {{2, 0, 5}}, {{1, 2, 5}}, {{3, 1, 5}}, {{0, 3, 5}}}};
}

/// Each triangle cut into four; new vertices are the midpoints of edges.
inline TriangleMesh subdivided(const TriangleMesh& mesh) {
  TriangleMesh out{mesh.positions, {}};
  std::map<Edge, std::uint32_t> middle;
  const auto split = [&](std::uint32_t a, std::uint32_t b) {
    const auto [entry, fresh] = middle.try_emplace(std::minmax(a, b), out.vertex_count());
    if (fresh) {
      const glm::vec3 p = out.positions[a], q = out.positions[b];
      out.positions.push_back({(p.x + q.x) / 2, (p.y + q.y) / 2, (p.z + q.z) / 2});
    }
    return entry->second;
  };
  for (const Corners& t : mesh.triangles) {
    const auto [a, b, c] = t.v;
    const std::uint32_t ab = split(a, b), bc = split(b, c), ca = split(c, a);
    for (const Corners& part : {Corners{{a, ab, ca}}, {{ab, b, bc}}, {{ca, bc, c}}, {{ab, bc, ca}}})
      out.triangles.push_back(part);
  }
  return out;
}

/// The octahedron, cut `level` times, its vertices on the unit sphere: 4^level * 8 triangles.
inline TriangleMesh sphere(int level) {
  TriangleMesh mesh = octahedron();
  for (int i = 0; i < level; ++i) mesh = subdivided(mesh);
  for (glm::vec3& p : mesh.positions) {
    const float l = std::sqrt(p.x * p.x + p.y * p.y + p.z * p.z);
    p = {p.x / l, p.y / l, p.z / l};
  }
  return mesh;
}

/// Two hubs over a ring of n vertices: 2 n triangles, two vertices of valence n.
inline TriangleMesh bipyramid(std::uint32_t n) {
  TriangleMesh mesh{{{0, 0, 1}, {0, 0, -1}}, {}};
  for (std::uint32_t i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n;
    mesh.positions.push_back({static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)), 0});
    const std::uint32_t a = 2 + i, b = 2 + (i + 1) % n;
    mesh.triangles.push_back({{0, a, b}});
    mesh.triangles.push_back({{1, b, a}});
  }
  return mesh;
}

namespace detail {

/// Triangles of an n by m net of quads whose corner (i, j) is vertex at(i, j).
template <class At>
void add_net(TriangleMesh& mesh, std::uint32_t n, std::uint32_t m, At&& at) {
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < m; ++j) {
      mesh.triangles.push_back({{at(i, j), at(i + 1, j), at(i + 1, j + 1)}});
      mesh.triangles.push_back({{at(i, j), at(i + 1, j + 1), at(i, j + 1)}});
    }
}

inline glm::vec3 on_torus(double around, double across, double radius) {
  const double a = 2 * std::numbers::pi * around, b = 2 * std::numbers::pi * across;
  const double r = 1 + radius * std::cos(b);
  return {static_cast<float>(r * std::cos(a)), static_cast<float>(r * std::sin(a)),
          static_cast<float>(radius * std::sin(b))};
}

}  // namespace detail

/// n by m vertices, n, m >= 3; with at least 4 of one of them a simplicial torus.
inline TriangleMesh torus(std::uint32_t n, std::uint32_t m) {
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < m; ++j)
      mesh.positions.push_back(detail::on_torus(static_cast<double>(i) / n, static_cast<double>(j) / m, 0.4));
  detail::add_net(mesh, n, m, [&](std::uint32_t i, std::uint32_t j) { return i % n * m + j % m; });
  return mesh;
}

/// A torus whose seam is joined the other way round: closed, one-sided, Euler characteristic 0.
inline TriangleMesh klein_bottle(std::uint32_t n, std::uint32_t m) {
  TriangleMesh mesh = torus(n, m);
  mesh.triangles.clear();
  detail::add_net(mesh, n, m,
                  [&](std::uint32_t i, std::uint32_t j) { return i < n ? i * m + j % m : (m - j % m) % m; });
  return mesh;
}

// ---- open surfaces --------------------------------------------------------------------------------------------------

/// n by m quads in the plane z = 0 with whole coordinates.
inline TriangleMesh grid(std::uint32_t n, std::uint32_t m) {
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i <= n; ++i)
    for (std::uint32_t j = 0; j <= m; ++j) mesh.positions.push_back({static_cast<float>(i), static_cast<float>(j), 0});
  detail::add_net(mesh, n, m, [&](std::uint32_t i, std::uint32_t j) { return i * (m + 1) + j; });
  return mesh;
}

/// A band of n quads with half a turn.
inline TriangleMesh moebius_strip(std::uint32_t n, std::uint32_t width = 1) {
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j <= width; ++j) {
      const double a = 2 * std::numbers::pi * i / n, s = static_cast<double>(j) / width - 0.5;
      const double r = 1 + s * std::cos(a / 2);
      mesh.positions.push_back({static_cast<float>(r * std::cos(a)), static_cast<float>(r * std::sin(a)),
                                static_cast<float>(s * std::sin(a / 2))});
    }
  detail::add_net(mesh, n, width,
                  [&](std::uint32_t i, std::uint32_t j) { return i < n ? i * (width + 1) + j : width - j; });
  return mesh;
}

/// n triangles around vertex 0; `closed` joins the last to the first.
inline TriangleMesh fan(std::uint32_t n, bool closed) {
  TriangleMesh mesh{{{0, 0, 0.25f}}, {}};
  const std::uint32_t rim = closed ? n : n + 1;
  for (std::uint32_t i = 0; i < rim; ++i) {
    const double angle = 2 * std::numbers::pi * i / (closed ? n : 2 * n);
    mesh.positions.push_back({static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)), 0});
  }
  for (std::uint32_t i = 0; i < n; ++i) mesh.triangles.push_back({{0, 1 + i, 1 + (i + 1) % rim}});
  return mesh;
}

// ---- made of others -------------------------------------------------------------------------------------------------

/// Both meshes, the second moved along x and renumbered behind the first.
inline TriangleMesh beside(TriangleMesh a, const TriangleMesh& b, float shift = 3) {
  const std::uint32_t first = a.vertex_count();
  for (const glm::vec3& p : b.positions) a.positions.push_back({p.x + shift, p.y, p.z});
  for (const Corners& t : b.triangles) a.triangles.push_back({{t.v[0] + first, t.v[1] + first, t.v[2] + first}});
  return a;
}

/// The connected sum: one triangle of each is left out and their corners are joined, winding kept.
inline TriangleMesh glued(const TriangleMesh& a, const TriangleMesh& b, std::uint32_t ta, std::uint32_t tb) {
  const Corners hole = a.triangles[ta], plug = b.triangles[tb];
  TriangleMesh out = a;
  out.triangles.erase(out.triangles.begin() + ta);
  std::vector<std::uint32_t> name(b.positions.size());
  for (std::uint32_t v = 0; v < b.vertex_count(); ++v) {
    if (v == plug.v[0]) {
      name[v] = hole.v[0];
    } else if (v == plug.v[1]) {
      name[v] = hole.v[2];
    } else if (v == plug.v[2]) {
      name[v] = hole.v[1];
    } else {
      name[v] = out.vertex_count();
      const glm::vec3 p = b.positions[v];
      out.positions.push_back({p.x + 3, p.y, p.z});
    }
  }
  for (std::uint32_t t = 0; t < b.triangle_count(); ++t) {
    const Corners& c = b.triangles[t];
    if (t != tb) out.triangles.push_back({{name[c.v[0]], name[c.v[1]], name[c.v[2]]}});
  }
  return out;
}

/// Two tetrahedra with `shared` (0 to 3) vertices in common: three triangles meet in each edge of a shared face's
/// rim or two volumes touch.
inline TriangleMesh two_tetrahedra(std::uint32_t shared) {
  TriangleMesh mesh = tetrahedron();
  std::uint32_t name[4];
  for (std::uint32_t v = 0; v < 4; ++v) {
    name[v] = v < shared ? v : mesh.vertex_count();
    if (v >= shared) mesh.positions.push_back({3.0f + static_cast<float>(v), 0.5f * static_cast<float>(v * v), 2});
  }
  for (const Corners& t : tetrahedron().triangles)
    mesh.triangles.push_back({{name[t.v[0]], name[t.v[1]], name[t.v[2]]}});
  return mesh;
}

/// `count` random triangles on `vertices` vertices with small whole coordinates: repeated corners, repeated triangles,
/// repeated positions and edges of many triangles all occur.
inline TriangleMesh soup(std::mt19937& rng, std::uint32_t vertices, std::uint32_t count) {
  TriangleMesh mesh;
  for (std::uint32_t v = 0; v < vertices; ++v)
    mesh.positions.push_back(
        {static_cast<float>(below(rng, 5)), static_cast<float>(below(rng, 5)), static_cast<float>(below(rng, 3))});
  for (std::uint32_t t = 0; t < count; ++t)
    mesh.triangles.push_back({{below(rng, vertices), below(rng, vertices), below(rng, vertices)}});
  return mesh;
}

/// The same surface with vertices, triangles and first corners in random order.
inline TriangleMesh shuffled(const TriangleMesh& mesh, std::mt19937& rng) {
  std::vector<std::uint32_t> place(mesh.positions.size());
  for (std::uint32_t v = 0; v < place.size(); ++v) {
    const std::uint32_t other = below(rng, v + 1);
    place[v] = place[other];
    place[other] = v;
  }
  TriangleMesh out{std::vector<glm::vec3>(mesh.positions.size()), {}};
  for (std::uint32_t v = 0; v < place.size(); ++v) out.positions[place[v]] = mesh.positions[v];
  for (const Corners& t : mesh.triangles) {
    const std::uint32_t turn = below(rng, 3);
    out.triangles.push_back({{place[t.v[turn]], place[t.v[(turn + 1) % 3]], place[t.v[(turn + 2) % 3]]}});
    std::swap(out.triangles.back(), out.triangles[below(rng, out.triangle_count())]);
  }
  return out;
}

/// Every coordinate moved by up to `amount`.
inline TriangleMesh jittered(TriangleMesh mesh, std::mt19937& rng, float amount) {
  for (glm::vec3& p : mesh.positions)
    for (int axis = 0; axis < 3; ++axis) p[axis] += amount * signed_unit(rng);
  return mesh;
}

/// Coordinates times `scale`, rounded to whole numbers.
inline TriangleMesh on_lattice(TriangleMesh mesh, float scale) {
  for (glm::vec3& p : mesh.positions)
    for (int axis = 0; axis < 3; ++axis) p[axis] = std::nearbyint(p[axis] * scale);
  return mesh;
}

/// Without `holes` triangles chosen at random (with repetition); their vertices stay.
inline TriangleMesh punctured(TriangleMesh mesh, std::mt19937& rng, std::uint32_t holes) {
  for (std::uint32_t i = 0; i < holes && !mesh.triangles.empty(); ++i)
    mesh.triangles.erase(mesh.triangles.begin() + below(rng, mesh.triangle_count()));
  return mesh;
}

// ---- topology -------------------------------------------------------------------------------------------------------

inline bool is_degenerate(const Corners& t) {
  return t.v[0] == t.v[1] || t.v[1] == t.v[2] || t.v[2] == t.v[0];
}

/// The number of non-degenerate triangles on each edge.
inline std::map<Edge, std::uint32_t> edge_uses(const std::vector<Corners>& triangles) {
  std::map<Edge, std::uint32_t> uses;
  for (const Corners& t : triangles)
    if (!is_degenerate(t))
      for (int i = 0; i < 3; ++i) ++uses[std::minmax(t.v[i], t.v[(i + 1) % 3])];
  return uses;
}

/// The edges of exactly one non-degenerate triangle.
inline std::set<Edge> open_edges(const std::vector<Corners>& triangles) {
  std::set<Edge> open;
  for (const auto& [edge, uses] : edge_uses(triangles))
    if (uses == 1) open.insert(edge);
  return open;
}

/// The edges of an odd number of triangles.
inline std::set<Edge> odd_edges(const std::vector<Corners>& triangles) {
  std::set<Edge> odd;
  for (const auto& [edge, uses] : edge_uses(triangles))
    if (uses % 2 == 1) odd.insert(edge);
  return odd;
}

/// Why the triangles are not a closed 2-manifold that uses all of `vertices` vertices; empty if they are.
/// `oriented` also asks that neighbours wind alike.
inline std::string not_closed_manifold(const std::vector<Corners>& triangles, std::uint32_t vertices, bool oriented) {
  for (const Corners& t : triangles)
    if (is_degenerate(t)) return "degenerate triangle";
  for (const auto& [edge, uses] : edge_uses(triangles))
    if (uses != 2) return "edge of " + std::to_string(uses) + " triangles";
  std::vector<std::vector<Edge>> around(vertices);
  std::set<Edge> directed;
  for (const Corners& t : triangles)
    for (int i = 0; i < 3; ++i) {
      const std::uint32_t a = t.v[i], b = t.v[(i + 1) % 3], c = t.v[(i + 2) % 3];
      if (a >= vertices) return "vertex out of range";
      around[a].push_back({b, c});
      if (!directed.insert({a, b}).second && oriented) return "neighbours wind differently";
    }
  for (std::uint32_t v = 0; v < vertices; ++v) {
    if (around[v].empty()) return "vertex without triangles";
    // The edges across from v must be one cycle: walk it and count.
    std::map<std::uint32_t, std::vector<std::uint32_t>> next;
    for (const auto& [b, c] : around[v]) {
      next[b].push_back(c);
      next[c].push_back(b);
    }
    const std::uint32_t start = next.begin()->first;
    std::uint32_t here = start, before = next[start][1], steps = 0;
    do {
      if (next[here].size() != 2) return "vertex whose link is no cycle";
      const std::uint32_t ahead = next[here][0] == before ? next[here][1] : next[here][0];
      before = here;
      here = ahead;
      ++steps;
    } while (here != start && steps <= next.size());
    if (steps != next.size()) return "vertex whose link is more than one cycle";
    if (steps < 3) return "two triangles with the same corners";
  }
  return {};
}

/// Vertices - edges + triangles.
inline std::int64_t euler_characteristic(const std::vector<Corners>& triangles, std::uint32_t vertices) {
  return static_cast<std::int64_t>(vertices) - static_cast<std::int64_t>(edge_uses(triangles).size()) +
         static_cast<std::int64_t>(triangles.size());
}

}  // namespace test
