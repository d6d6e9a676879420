// SPDX-License-Identifier: MIT
// Fills one vertex buffer with the selected vertices of every object, placed in the world.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/gather.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefetch.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

namespace gather_detail {

/// gather and gather_block: first_of(i) is where the vertices of object i begin, ahead(i) may ask for those of the
/// objects behind it.
template <class Placed, class First, class Ahead>
void gather(std::span<const Object> objects, std::span<const std::uint64_t> vertex_offsets, std::span<Placed> out,
            First&& first_of, Ahead&& ahead) {
  PGL_ASSERT(vertex_offsets.size() == objects.size() + 1);
  PGL_ASSERT(vertex_offsets.front() == 0 && vertex_offsets.back() <= out.size());
  constexpr std::uint64_t chunk = 1 << 13;
  const std::uint64_t total = vertex_offsets.back();

  // Equal pieces of the output, so that neither one huge object nor many tiny ones keep a thread waiting.
  parallel_for((total + chunk - 1) / chunk, 1, [&](std::size_t c) {
    const std::uint64_t end = std::min<std::uint64_t>(total, (c + 1) * chunk);
    std::uint64_t at = c * chunk;
    auto i = static_cast<std::size_t>(std::ranges::upper_bound(vertex_offsets, at) - vertex_offsets.begin() - 1);
    for (; at < end; ++i) {
      ahead(i);
      const Object object = objects[i];
      const std::uint64_t stop = std::min(end, vertex_offsets[i + 1]);
      const auto* from = first_of(i) + (at - vertex_offsets[i]);
      for (; at < stop; ++at) place(object, static_cast<std::uint32_t>(i), *from++, out[at]);
    }
  });
}

}  // namespace gather_detail

/// Writes the first counts[i] vertices of the mesh of every object i, placed in the world, to
/// out[vertex_offsets[i] .. vertex_offsets[i+1]).
///
/// - meshes, objects[n]: the scene; vertices: those of all meshes, as the meshes index them;
/// - counts[n]: how many vertices each object shows, at most its mesh's max_vertices; 0 shows nothing;
/// - vertex_offsets[n+1]: exclusive prefix sums of counts; the last entry is the total, at most out.size();
/// - out: overlaps no input. Elements from the total on are left as they are.
///
/// Placed is glm::vec3, PlacedVertex, or any type with a place() of its own (pgl/gather.hpp). Sizes are checked in
/// debug builds. No object, or nothing selected, writes nothing. O(n + total), parallel within objects too, no scratch;
/// the result does not depend on the number of threads.
template <class Placed, class Vertex>
void gather(std::span<const Mesh> meshes, std::span<const Object> objects, std::span<const Vertex> vertices,
            std::span<const std::uint32_t> counts, std::span<const std::uint64_t> vertex_offsets,
            std::span<Placed> out) {
  PGL_ASSERT(counts.size() == objects.size());
  const auto first_of = [&](std::size_t i) {
    PGL_ASSERT(vertex_offsets[i + 1] - vertex_offsets[i] == counts[i]);
    PGL_ASSERT(counts[i] <= meshes[objects[i].mesh].max_vertices);
    return vertices.data() + meshes[objects[i].mesh].first_vertex;
  };
  gather_detail::gather(objects, vertex_offsets, out, first_of, [&](std::size_t i) {
    if (i + 2 < objects.size()) prefetch(&meshes[objects[i + 2].mesh], 1);
    if (i + 1 < objects.size()) {
      prefetch(vertices.data() + meshes[objects[i + 1].mesh].first_vertex, counts[i + 1]);
    }
  });
}

/// Like gather, from a block that holds the selected vertices and no others: vertex k of object i is
/// block[vertex_offsets[i] + k], as defragment leaves them. The same bytes as gather of the same selection.
///
/// - objects[n]: the scene;
/// - block: at least vertex_offsets[n] vertices, not placed yet. Elements from there on are not read;
/// - vertex_offsets[n+1]: exclusive prefix sums of the counts; the last entry is at most out.size();
/// - out: overlaps no input. Elements from the total on are left as they are.
///
/// Sizes are checked in debug builds. O(n + total), parallel within objects too, no scratch; the result does not depend
/// on the number of threads.
template <class Placed, class Vertex>
void gather_block(std::span<const Object> objects, std::span<const Vertex> block,
                  std::span<const std::uint64_t> vertex_offsets, std::span<Placed> out) {
  PGL_ASSERT(vertex_offsets.back() <= block.size());
  gather_detail::gather(
      objects, vertex_offsets, out, [&](std::size_t i) { return block.data() + vertex_offsets[i]; },
      [](std::size_t) {});
}

}  // namespace pgl::host
