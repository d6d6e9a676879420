// SPDX-License-Identifier: MIT
// Random meshes with random collapses, and what they are after each one, the slow way.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include "pgl/types.hpp"

namespace test {

/// Whom a vertex merges into: any vertex left, one that it shares a triangle with where it can, the vertex that goes
/// next (one chain as long as the mesh), or always the same one.
enum class Collapses { anywhere, along_edges, one_chain, one_star };

/// A mesh in its original numbering and order, with what rearrange takes.
template <class Index>
struct CollapsingMesh {
  std::uint32_t min_vertices = 0;
  std::vector<pgl::Triangle<Index>> triangles;
  std::vector<Index> ecol;
  std::vector<Index> permute_v;
  std::vector<std::uint32_t> permute_t;
  std::vector<std::uint32_t> map;    ///< entry k - min_vertices: triangles left at k vertices
  std::vector<std::uint32_t> order;  ///< the vertices that collapse, first to last

  std::uint32_t vertices() const { return static_cast<std::uint32_t>(ecol.size()); }
};

/// A triangle that is left, in the original numbering, with its original index.
template <class Index>
using Left = std::pair<std::uint32_t, pgl::Triangle<Index>>;

template <class Index>
bool is_degenerate(const pgl::Triangle<Index>& t) {
  return t.v[0] == t.v[1] || t.v[1] == t.v[2] || t.v[2] == t.v[0];
}

/// Merges one vertex into another in a plain list of triangles, and drops the triangles that this makes degenerate.
template <class Index>
void collapse(std::vector<Left<Index>>& left, Index from, Index to) {
  for (auto& [index, triangle] : left) std::replace(std::begin(triangle.v), std::end(triangle.v), from, to);
  std::erase_if(left, [](const Left<Index>& t) { return is_degenerate(t.second); });
}

template <class Index>
std::vector<Left<Index>> all_triangles(const CollapsingMesh<Index>& mesh) {
  std::vector<Left<Index>> left;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) left.emplace_back(t, mesh.triangles[t]);
  return left;
}

/// The mesh when `count` vertices are left, by collapsing one vertex after the other.
template <class Index>
std::vector<Left<Index>> collapsed_to(const CollapsingMesh<Index>& mesh, std::uint32_t count) {
  std::vector<Left<Index>> left = all_triangles(mesh);
  for (std::uint32_t step = 0; step < mesh.vertices() - count; ++step) {
    const auto from = static_cast<Index>(mesh.order[step]);
    collapse(left, from, mesh.ecol[from]);
  }
  return left;
}

/// A random triangle soup without degenerate triangles (none at all below three vertices), duplicates allowed, with
/// `collapses` < vertices collapses.
template <class Index>
CollapsingMesh<Index> random_collapsing_mesh(std::mt19937& random, std::uint32_t vertices, std::uint32_t triangles,
                                             std::uint32_t collapses, Collapses kind) {
  CollapsingMesh<Index> mesh;
  for (std::uint32_t t = 0; vertices >= 3 && t < triangles; ++t) {
    pgl::Triangle<Index> triangle;
    do {
      for (Index& v : triangle.v) v = static_cast<Index>(random() % vertices);
    } while (is_degenerate(triangle));
    mesh.triangles.push_back(triangle);
  }

  std::vector<std::uint32_t> alive(vertices);
  std::iota(alive.begin(), alive.end(), 0u);
  std::shuffle(alive.begin(), alive.end(), random);
  mesh.ecol.assign(vertices, pgl::no_target<Index>);
  mesh.permute_v.resize(vertices);
  mesh.permute_t.resize(mesh.triangles.size());
  mesh.min_vertices = vertices - collapses;
  std::vector<Left<Index>> left = all_triangles(mesh);
  mesh.map = {static_cast<std::uint32_t>(left.size())};
  std::vector<bool> gone(left.size());

  for (std::uint32_t step = 0; step < collapses; ++step) {
    const std::uint32_t from = alive.back();
    alive.pop_back();
    std::uint32_t to = alive[random() % alive.size()];
    if (kind == Collapses::one_chain) to = alive.back();
    if (kind == Collapses::one_star) to = alive.front();
    if (kind == Collapses::along_edges) {
      for (const auto& [index, triangle] : left) {
        const Index* corner = std::find(std::begin(triangle.v), std::end(triangle.v), from);
        if (corner != std::end(triangle.v)) to = triangle.v[(corner - triangle.v + 1) % 3];
      }
    }
    mesh.order.push_back(from);
    mesh.ecol[from] = static_cast<Index>(to);
    mesh.permute_v[from] = static_cast<Index>(alive.size());
    collapse(left, static_cast<Index>(from), static_cast<Index>(to));

    // Whatever went just now gets the last places that are still free.
    std::vector<bool> here(gone.size());
    for (const auto& [index, triangle] : left) here[index] = true;
    std::uint32_t place = mesh.map.back();
    for (std::size_t t = 0; t < gone.size(); ++t) {
      if (!here[t] && !gone[t]) {
        mesh.permute_t[t] = --place;
        gone[t] = true;
      }
    }
    mesh.map.push_back(static_cast<std::uint32_t>(left.size()));
  }
  std::reverse(mesh.map.begin(), mesh.map.end());
  for (std::size_t place = 0; place < alive.size(); ++place) {
    mesh.permute_v[alive[place]] = static_cast<Index>(place);
  }
  for (std::uint32_t place = 0; place < left.size(); ++place) mesh.permute_t[left[place].first] = place;
  return mesh;
}

/// What rearrange has to make of it, found from the other side: for every new place, who comes there.
template <class Index>
struct RearrangedMesh {
  std::vector<pgl::Triangle<Index>> triangles;
  std::vector<Index> ecol;
};

template <class Index>
RearrangedMesh<Index> rearranged(const CollapsingMesh<Index>& mesh) {
  const auto new_place = [&](Index v) { return mesh.permute_v[v]; };
  RearrangedMesh<Index> result;
  for (std::size_t place = 0; place < mesh.ecol.size(); ++place) {
    const auto v = std::find(mesh.permute_v.begin(), mesh.permute_v.end(), place) - mesh.permute_v.begin();
    const Index target = mesh.ecol[static_cast<std::size_t>(v)];
    result.ecol.push_back(target == pgl::no_target<Index> ? target : new_place(target));
  }
  for (std::size_t place = 0; place < mesh.triangles.size(); ++place) {
    const auto t = std::find(mesh.permute_t.begin(), mesh.permute_t.end(), place) - mesh.permute_t.begin();
    pgl::Triangle<Index> triangle = mesh.triangles[static_cast<std::size_t>(t)];
    std::transform(std::begin(triangle.v), std::end(triangle.v), triangle.v, new_place);
    result.triangles.push_back(triangle);
  }
  return result;
}

/// The triangles at `count` vertices as reform has to write them: collapsed one by one, renamed, in the new order.
template <class Index>
std::vector<pgl::Triangle<Index>> reformed_slowly(const CollapsingMesh<Index>& mesh, std::uint32_t count) {
  std::vector<Left<Index>> left = collapsed_to(mesh, count);
  std::ranges::sort(left, {}, [&](const Left<Index>& t) { return mesh.permute_t[t.first]; });
  std::vector<pgl::Triangle<Index>> result;
  for (const auto& [index, triangle] : left) {
    result.push_back({{mesh.permute_v[triangle.v[0]], mesh.permute_v[triangle.v[1]], mesh.permute_v[triangle.v[2]]}});
  }
  return result;
}

}  // namespace test
