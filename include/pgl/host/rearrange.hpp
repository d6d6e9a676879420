// SPDX-License-Identifier: MIT
// Moves the vertices, triangles and collapse targets of one mesh to the order of their removal.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/rearrange.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Tells whether `positions` holds each of 0 .. size-1 exactly once. The empty list is a permutation.
/// Linear; allocates one bit per entry, so it is for checking input, not for every frame.
template <class Index>
[[nodiscard]] bool is_permutation(std::span<const Index> positions) {
  std::vector<bool> seen(positions.size());
  for (const Index position : positions) {
    if (position >= positions.size() || seen[position]) return false;
    seen[position] = true;
  }
  return true;
}

/// Puts a mesh into the order in which it is coarsened: what goes first stands last.
///
/// Afterwards the first k vertices and the first map(k) triangles are, reformed, the mesh at k vertices, and
/// out_ecol[v] < v for every v that collapses, provided that permute_v gives earlier collapses later places.
///
/// In, all in the original numbering, 0-based, V vertices and T triangles:
/// - vertices[V]: any trivially copyable payload;
/// - triangles[T]: corners below V;
/// - ecol[V]: the vertex that each vertex merges into, or no_target<Index> (so in a mesh of 65536 vertices with 16-bit
///   indices nothing can merge into vertex 65535 of the original numbering: rearrange it with 32 bits, then narrow it);
/// - permute_v[V]: the new place of each vertex, a permutation of 0 .. V-1;
/// - permute_t[T]: the new place of each triangle, a permutation of 0 .. T-1.
///
/// Out: out_vertices[permute_v[v]] = vertices[v]; out_triangles[permute_t[t]] is triangle t with its corners renamed,
/// their order kept; out_ecol[permute_v[v]] = permute_v[ecol[v]], no_target kept. Same sizes as the inputs; no output
/// may overlap any other array.
///
/// That places and corners are in range is checked in debug builds; is_permutation checks the rest. Empty arrays are
/// fine. Duplicate and degenerate triangles are moved like any other. O(V + T), parallel, no scratch; the result does
/// not depend on the number of threads. [Peng13] Alg 1.
template <class Vertex, class Index>
void rearrange(std::span<const Vertex> vertices, std::span<const Triangle<Index>> triangles,
               std::span<const Index> ecol, std::span<const Index> permute_v, std::span<const std::uint32_t> permute_t,
               std::span<Vertex> out_vertices, std::span<Triangle<Index>> out_triangles, std::span<Index> out_ecol) {
  PGL_ASSERT(ecol.size() == vertices.size() && permute_v.size() == vertices.size());
  PGL_ASSERT(out_vertices.size() == vertices.size() && out_ecol.size() == vertices.size());
  PGL_ASSERT(permute_t.size() == triangles.size() && out_triangles.size() == triangles.size());
  constexpr std::size_t grain = 1 << 14;

  parallel_for(vertices.size(), grain, [&](std::size_t v) {
    PGL_ASSERT(permute_v[v] < vertices.size());
    PGL_ASSERT(ecol[v] == no_target<Index> || ecol[v] < vertices.size());
    out_vertices[permute_v[v]] = vertices[v];
    out_ecol[permute_v[v]] = rearranged_target(ecol[v], permute_v.data());
  });
  parallel_for(triangles.size(), grain, [&](std::size_t t) {
    PGL_ASSERT(permute_t[t] < triangles.size());
    PGL_ASSERT(std::ranges::all_of(triangles[t].v, [&](Index v) { return v < vertices.size(); }));
    out_triangles[permute_t[t]] = rearranged_triangle(triangles[t], permute_v.data());
  });
}

/// Puts many meshes into the order in which each is coarsened, as rearrange does for one.
///
/// meshes: the part of each in the other arrays, in any order; parts do not overlap, and may leave gaps: what is in no
/// part is neither read nor written. Indices and places are local to each mesh; first_map does not matter. The other
/// arguments are those of rearrange, with the elements of all meshes.
///
/// O(size of meshes + their vertices + their triangles), parallel over and within meshes, no scratch; the result does
/// not depend on the number of threads. [Peng13] Alg 1.
template <class Vertex, class Index>
void rearrange(std::span<const MeshRange> meshes, std::span<const Vertex> vertices,
               std::span<const Triangle<Index>> triangles, std::span<const Index> ecol,
               std::span<const Index> permute_v, std::span<const std::uint32_t> permute_t,
               std::span<Vertex> out_vertices, std::span<Triangle<Index>> out_triangles, std::span<Index> out_ecol) {
  PGL_ASSERT(ecol.size() == vertices.size() && permute_v.size() == vertices.size());
  PGL_ASSERT(out_vertices.size() == vertices.size() && out_ecol.size() == vertices.size());
  PGL_ASSERT(permute_t.size() == triangles.size() && out_triangles.size() == triangles.size());
  constexpr std::size_t grain = 16;              // meshes
  constexpr std::uint32_t most_alone = 1 << 15;  // vertices, and triangles, of a mesh that one thread moves

  const auto is_large = [](const MeshRange& m) { return m.vertices > most_alone || m.triangles > most_alone; };
  const auto move = [&](const MeshRange& m) {
    PGL_ASSERT(m.first_vertex + m.vertices <= vertices.size() && m.first_triangle + m.triangles <= triangles.size());
    rearrange<Vertex, Index>(
        vertices.subspan(m.first_vertex, m.vertices), triangles.subspan(m.first_triangle, m.triangles),
        ecol.subspan(m.first_vertex, m.vertices), permute_v.subspan(m.first_vertex, m.vertices),
        permute_t.subspan(m.first_triangle, m.triangles), out_vertices.subspan(m.first_vertex, m.vertices),
        out_triangles.subspan(m.first_triangle, m.triangles), out_ecol.subspan(m.first_vertex, m.vertices));
  };
  parallel_for(meshes.size(), grain, [&](std::size_t i) {
    if (!is_large(meshes[i])) move(meshes[i]);  // alone: inside parallel_for another one has one thread
  });
  for (const MeshRange& mesh : meshes) {
    if (is_large(mesh)) move(mesh);
  }
}

}  // namespace pgl::host
