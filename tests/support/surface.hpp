// SPDX-License-Identifier: MIT
// Brute-force facts about a triangle surface: what is shared, what is open, what is inside out.
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <span>
#include <tuple>
#include <vector>

#include "pgl/types.hpp"

namespace support {

/// Groups of 0..n-1 that are merged one pair at a time.
class Groups {
 public:
  explicit Groups(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), std::uint32_t{0}); }
  std::uint32_t find(std::uint32_t a) {
    while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
    return a;
  }
  void merge(std::uint32_t a, std::uint32_t b) { parent_[find(a)] = find(b); }

 private:
  std::vector<std::uint32_t> parent_;
};

struct SurfaceFacts {
  bool in_range = true;  ///< the rest is not looked at when an index is not
  bool finite = true;
  std::size_t degenerate = 0;  ///< triangles with a repeated vertex or no area
  std::size_t repeated_edges =
      0;                       ///< directed edges that more than one triangle has: non-manifold, or not oriented alike
  std::size_t open_edges = 0;  ///< directed edges without their opposite
  std::size_t pinched = 0;     ///< vertices whose triangles are not one fan
  std::size_t unused = 0;      ///< vertices of no triangle
  std::size_t components = 0;  ///< connected through vertices
  std::size_t inside_out =
      0;                     ///< components whose signed volume is not positive; means something where nothing is open
  std::size_t repeated = 0;  ///< vertices at the place of another of the same component
};

inline SurfaceFacts surface_facts(std::span<const glm::vec3> positions,
                                  std::span<const pgl::Triangle<std::uint32_t>> triangles) {
  SurfaceFacts facts;
  for (const glm::vec3& p : positions)
    for (int axis = 0; axis < 3; ++axis) facts.finite &= p[axis] - p[axis] == 0.0f;
  for (const auto& t : triangles)
    for (const std::uint32_t v : t.v) facts.in_range &= v < positions.size();
  if (!facts.in_range) return facts;

  using Vec = glm::vec<3, long double>;
  const auto at = [&](std::uint32_t v) { return Vec(positions[v]); };

  struct DirectedEdge {
    std::uint32_t a, b, corner_a, corner_b;
    bool operator<(const DirectedEdge& o) const { return std::tie(a, b) < std::tie(o.a, o.b); }
  };
  std::vector<DirectedEdge> edges;
  Groups parts(positions.size()), fans(3 * triangles.size());
  std::vector<bool> used(positions.size());
  for (std::uint32_t i = 0; i < triangles.size(); ++i) {
    const auto& t = triangles[i].v;
    const Vec normal = glm::cross(at(t[1]) - at(t[0]), at(t[2]) - at(t[0]));
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0] || normal == Vec(0)) ++facts.degenerate;
    for (std::uint32_t c = 0; c < 3; ++c) {
      const std::uint32_t d = (c + 1) % 3;
      edges.push_back({t[c], t[d], 3 * i + c, 3 * i + d});
      parts.merge(t[c], t[d]);
      used[t[c]] = true;
    }
  }
  std::sort(edges.begin(), edges.end());
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const DirectedEdge& e = edges[i];
    if (i > 0 && edges[i - 1].a == e.a && edges[i - 1].b == e.b) ++facts.repeated_edges;
    const auto other = std::lower_bound(edges.begin(), edges.end(), DirectedEdge{e.b, e.a, 0, 0});
    if (other == edges.end() || other->a != e.b || other->b != e.a) {
      ++facts.open_edges;
    } else {
      fans.merge(e.corner_a, other->corner_b);
      fans.merge(e.corner_b, other->corner_a);
    }
  }
  std::vector<std::uint32_t> fan_of(positions.size(), ~0u);
  for (std::uint32_t corner = 0; corner < 3 * triangles.size(); ++corner) {
    const std::uint32_t v = triangles[corner / 3].v[corner % 3];
    const std::uint32_t fan = fans.find(corner);
    if (fan_of[v] == ~0u) fan_of[v] = fan;
    if (fan_of[v] != fan) ++facts.pinched;
  }
  std::vector<long double> volume(positions.size(), 0.0L);
  for (const auto& t : triangles) {  // about a vertex of the component, so that nothing large cancels
    const std::uint32_t root = parts.find(t.v[0]);
    const Vec o = at(root);
    volume[root] += glm::dot(at(t.v[0]) - o, glm::cross(at(t.v[1]) - o, at(t.v[2]) - o));
  }
  std::vector<std::tuple<std::uint32_t, float, float, float>> places;
  for (std::uint32_t v = 0; v < positions.size(); ++v) {
    if (!used[v]) {
      ++facts.unused;
      continue;
    }
    const std::uint32_t root = parts.find(v);
    if (root == v) {
      ++facts.components;
      if (!(volume[v] > 0)) ++facts.inside_out;
    }
    places.emplace_back(root, positions[v].x, positions[v].y, positions[v].z);
  }
  std::sort(places.begin(), places.end());
  for (std::size_t i = 1; i < places.size(); ++i) facts.repeated += places[i] == places[i - 1];
  return facts;
}

}  // namespace support
