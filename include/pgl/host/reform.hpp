// SPDX-License-Identifier: MIT
// Turns the first triangles of every selected object into the triangles of its mesh at the chosen vertex count.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefetch.hpp"
#include "pgl/reform.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Scratch of reform, kept from frame to frame: it only grows, and a warm call allocates nothing. 65536 entries per
/// thread, the vertices of the largest meshes at hand (one per thread at most), and a byte per object.
template <class Index>
struct ReformWorkspace {
  std::vector<std::vector<Index>> tables;  ///< final vertices, per thread or per postponed object
  std::vector<std::uint8_t> postponed;     ///< per object: too much for one thread, or chains too long to follow
  std::vector<std::size_t> batch;          ///< postponed objects that are dealt with together
};

namespace reform_detail {

inline constexpr std::uint64_t chunk = 1 << 13;       ///< triangles that a thread takes at a time
inline constexpr std::uint32_t most_alone = 1 << 16;  ///< triangles, and vertices, that one thread does by itself
inline constexpr std::uint64_t table_worth = 64;      ///< vertices per triangle up to which a table is the faster way

/// Some triangles of one object: where they come from and go to.
template <class Index, class OutIndex>
struct Part {
  const Triangle<Index>* triangles;
  const Index* ecol;
  Triangle<OutIndex>* out;
  std::uint64_t size;
  std::uint64_t base;
  std::uint32_t count;
  std::uint32_t vertices;  // of the whole mesh
  bool mirror;
};

template <class Index, class OutIndex>
void fill_table(const Part<Index, OutIndex>& part, Index* table) {
  for (std::uint32_t v = 0; v < part.vertices; ++v) table[v] = final_vertex(part.ecol, part.count, table, v);
}

template <class Index, class OutIndex>
void by_table(const Part<Index, OutIndex>& part, const Index* table) {
  for (std::uint64_t t = 0; t < part.size; ++t) {
    const Triangle<Index>& in = part.triangles[t];
    PGL_ASSERT(in.v[0] < part.vertices && in.v[1] < part.vertices && in.v[2] < part.vertices);
    const Triangle<Index> reformed{{table[in.v[0]], table[in.v[1]], table[in.v[2]]}};
    part.out[t] = drawn_triangle<OutIndex>(reformed, part.base, part.mirror);
  }
}

/// Tells whether all was written: the collapses to follow were at most `steps` together.
template <class Index, class OutIndex>
bool by_following(const Part<Index, OutIndex>& part, std::uint64_t steps) {
  for (std::uint64_t t = 0; t < part.size; ++t) {
    Triangle<Index> reformed = part.triangles[t];
    for (Index& v : reformed.v) {
      PGL_ASSERT(v < part.vertices);
      v = follow_collapses(part.ecol, part.count, v, steps);
      if (v >= part.count) return false;
    }
    part.out[t] = drawn_triangle<OutIndex>(reformed, part.base, part.mirror);
  }
  return true;
}

/// Where the triangles of an object begin: at those of its mesh, or in a block of the selected ones at its own.
enum class From { meshes, block };

/// All of reform; without vertex_offsets, local indices.
template <From from, class OutIndex, class Index>
void reform(std::span<const Mesh> meshes, std::span<const Object> objects, std::span<const Triangle<Index>> triangles,
            std::span<const Index> ecol, std::span<const std::uint32_t> counts,
            std::span<const std::uint64_t> vertex_offsets, std::span<const std::uint64_t> triangle_offsets,
            ReformWorkspace<Index>& workspace, std::span<Triangle<OutIndex>> out) {
  PGL_ASSERT(counts.size() == objects.size() && triangle_offsets.size() == objects.size() + 1);
  PGL_ASSERT(triangle_offsets.front() == 0 && triangle_offsets.back() <= out.size());
  const std::uint64_t total = triangle_offsets.back();

  const auto size_of = [&](std::size_t i) { return triangle_offsets[i + 1] - triangle_offsets[i]; };
  const auto first_of = [&](std::size_t i, const Mesh& mesh) {
    return from == From::meshes ? mesh.first_triangle : triangle_offsets[i];
  };
  const auto part_of = [&](std::size_t i, std::uint64_t first, std::uint64_t last) {
    const Mesh& mesh = meshes[objects[i].mesh];
    const std::uint64_t base = vertex_offsets.empty() ? 0 : vertex_offsets[i];
    PGL_ASSERT(mesh.first_vertex + mesh.max_vertices <= ecol.size());
    PGL_ASSERT(first_of(i, mesh) + size_of(i) <= triangles.size());
    PGL_ASSERT(counts[i] > 0 && counts[i] >= mesh.min_vertices && counts[i] <= mesh.max_vertices);
    PGL_ASSERT(base + counts[i] - 1 <= std::numeric_limits<OutIndex>::max());
    return Part<Index, OutIndex>{.triangles = triangles.data() + first_of(i, mesh) + first,
                                 .ecol = ecol.data() + mesh.first_vertex,
                                 .out = out.data() + triangle_offsets[i] + first,
                                 .size = last - first,
                                 .base = base,
                                 .count = counts[i],
                                 .vertices = mesh.max_vertices,
                                 .mirror = mirrored(objects[i].transform)};
  };

  auto& tables = workspace.tables;
  if (tables.size() < thread_count()) tables.resize(thread_count());
  for (auto& table : tables) table.resize(std::max<std::size_t>(table.size(), most_alone));
  workspace.postponed.assign(objects.size(), 0);

  // The objects that start in the same piece of the output are one thread's, each done in the faster of two ways. For
  // most, all final vertices are tabled once, in ascending order; where few triangles are left of many vertices, the
  // chains are followed, unless that takes more steps than the mesh has vertices. So it is linear for any chains.
  parallel_for((total + chunk - 1) / chunk, 1, [&](std::size_t c) {
    const std::uint64_t end = std::min<std::uint64_t>(total, (c + 1) * chunk);
    auto i = static_cast<std::size_t>(std::ranges::lower_bound(triangle_offsets, c * chunk) - triangle_offsets.begin());
    for (; triangle_offsets[i] < end; ++i) {
      if (i + 2 < objects.size()) prefetch(&meshes[objects[i + 2].mesh], 1);
      if (i + 1 < objects.size() && size_of(i + 1) > 0) {
        const Mesh& next = meshes[objects[i + 1].mesh];
        prefetch(ecol.data() + next.first_vertex, counts[i + 1] < next.max_vertices ? next.max_vertices : 0);
        prefetch(triangles.data() + first_of(i + 1, next), size_of(i + 1));
      }
      if (size_of(i) == 0) continue;
      const auto part = part_of(i, 0, size_of(i));
      const bool follow = part.count == part.vertices || part.vertices > table_worth * part.size;
      if (part.size <= most_alone && follow && by_following(part, part.vertices)) continue;
      if (part.size <= most_alone && part.vertices <= most_alone) {
        Index* table = tables[thread_index()].data();
        fill_table(part, table);
        by_table(part, table);
      } else {
        workspace.postponed[i] = 1;
      }
    }
  });

  // What is too large for one thread: a table per object, as many at a time as there are threads, then their triangles
  // by all threads.
  const auto& postponed = workspace.postponed;
  auto next = std::ranges::find(postponed, 1);
  while (next != postponed.end()) {
    workspace.batch.clear();
    for (; next != postponed.end() && workspace.batch.size() < thread_count();
         next = std::find(next + 1, postponed.end(), 1)) {
      const auto i = static_cast<std::size_t>(next - postponed.begin());
      auto& table = tables[workspace.batch.size()];
      const std::uint32_t vertices = meshes[objects[i].mesh].max_vertices;
      if (counts[i] < vertices) table.resize(std::max<std::size_t>(table.size(), vertices));
      workspace.batch.push_back(i);
    }
    parallel_for(workspace.batch.size(), 1, [&](std::size_t b) {
      const auto part = part_of(workspace.batch[b], 0, 0);
      if (part.count < part.vertices) fill_table(part, tables[b].data());
    });
    for (std::size_t b = 0; b < workspace.batch.size(); ++b) {
      const std::size_t i = workspace.batch[b];
      parallel_for((size_of(i) + chunk - 1) / chunk, 1, [&](std::size_t c) {
        const auto part = part_of(i, c * chunk, std::min<std::uint64_t>(size_of(i), (c + 1) * chunk));
        if (part.count < part.vertices) {
          by_table(part, tables[b].data());
        } else {
          by_following(part, 0);
        }
      });
    }
  }
}

}  // namespace reform_detail

/// Writes the triangles of every object at its vertex count, with indices into the one vertex buffer that gather
/// fills: vertex v of object i is vertex_offsets[i] + v.
///
/// The first map(k) triangles of a mesh, each corner v >= k replaced by the first vertex below k on its way along ecol,
/// are the mesh at k vertices. The order of triangles is kept, and that of corners too, save for an object whose
/// transform mirrors (pgl::mirrored): there corners 1 and 2 are swapped.
///
/// - meshes, objects[n]: the scene; triangles, ecol: those of all meshes, rearranged, as the meshes index them;
/// - counts[n]: vertices that each object shows, 0 or in [min_vertices, max_vertices] of its mesh;
/// - vertex_offsets[n+1], triangle_offsets[n+1]: exclusive prefix sums of counts and of the triangles at those counts;
///   every vertex_offsets[i] + counts[i] at most 2^32;
/// - workspace: scratch, see there; its contents on entry do not matter;
/// - out: the triangles of object i go to [triangle_offsets[i], triangle_offsets[i+1]). Overlaps no input. Elements
/// from
///   the last offset on are left as they are.
///
/// Preconditions, checked in debug builds: ecol[v] < v for every v from an object's count on; corners below the mesh's
/// max_vertices; sizes as above. No object, or nothing selected, writes nothing. Degenerate and duplicate triangles are
/// reformed like any other, and may come out degenerate if the map says that they are still there.
///
/// O(n + triangles written + sum of the max_vertices of the selected meshes), whatever the chains in ecol, parallel
/// within large objects too. The result does not depend on the number of threads. [Peng13] Alg 3.
template <class Index>
void reform(std::span<const Mesh> meshes, std::span<const Object> objects, std::span<const Triangle<Index>> triangles,
            std::span<const Index> ecol, std::span<const std::uint32_t> counts,
            std::span<const std::uint64_t> vertex_offsets, std::span<const std::uint64_t> triangle_offsets,
            ReformWorkspace<Index>& workspace, std::span<Triangle<std::uint32_t>> out) {
  PGL_ASSERT(vertex_offsets.size() == objects.size() + 1);
  reform_detail::reform<reform_detail::From::meshes, std::uint32_t, Index>(
      meshes, objects, triangles, ecol, counts, vertex_offsets, triangle_offsets, workspace, out);
}

/// Like reform, from a block that holds the selected triangles and no others: triangle t of object i is
/// block[triangle_offsets[i] + t], with the corners it has in its mesh, as defragment leaves them. The same bytes as
/// reform of the same selection.
///
/// block: at least triangle_offsets[n] triangles; those from there on are not read. ecol is that of all meshes.
template <class Index>
void reform_block(std::span<const Mesh> meshes, std::span<const Object> objects, std::span<const Triangle<Index>> block,
                  std::span<const Index> ecol, std::span<const std::uint32_t> counts,
                  std::span<const std::uint64_t> vertex_offsets, std::span<const std::uint64_t> triangle_offsets,
                  ReformWorkspace<Index>& workspace, std::span<Triangle<std::uint32_t>> out) {
  PGL_ASSERT(vertex_offsets.size() == objects.size() + 1);
  reform_detail::reform<reform_detail::From::block, std::uint32_t, Index>(
      meshes, objects, block, ecol, counts, vertex_offsets, triangle_offsets, workspace, out);
}

/// Like reform, with indices local to the object: each is below counts[i]. For a draw call per object, or one indirect
/// call with a base vertex per object.
template <class Index>
void reform_local(std::span<const Mesh> meshes, std::span<const Object> objects,
                  std::span<const Triangle<Index>> triangles, std::span<const Index> ecol,
                  std::span<const std::uint32_t> counts, std::span<const std::uint64_t> triangle_offsets,
                  ReformWorkspace<Index>& workspace, std::span<Triangle<Index>> out) {
  reform_detail::reform<reform_detail::From::meshes, Index, Index>(meshes, objects, triangles, ecol, counts, {},
                                                                   triangle_offsets, workspace, out);
}

/// Writes the triangles of one mesh at `count` vertices, as reform_local does for an object that is not mirrored.
/// triangles: the first map(count) of the mesh; ecol: of all its vertices; out: as large as triangles.
template <class Index>
void reform_mesh(std::span<const Triangle<Index>> triangles, std::span<const Index> ecol, std::uint32_t count,
                 ReformWorkspace<Index>& workspace, std::span<Triangle<Index>> out) {
  const Mesh mesh{.max_vertices = static_cast<std::uint32_t>(ecol.size())};
  const Object object{};
  const std::uint64_t offsets[2] = {0, triangles.size()};
  reform_local<Index>({&mesh, 1}, {&object, 1}, triangles, ecol, {&count, 1}, offsets, workspace, out);
}

}  // namespace pgl::host
