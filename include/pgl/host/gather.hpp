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
            [[maybe_unused]] std::span<const std::uint32_t> counts, std::span<const std::uint64_t> vertex_offsets,
            std::span<Placed> out) {
  PGL_ASSERT(counts.size() == objects.size() && vertex_offsets.size() == objects.size() + 1);
  PGL_ASSERT(vertex_offsets.front() == 0 && vertex_offsets.back() <= out.size());
  constexpr std::uint64_t chunk = 1 << 13;
  const std::uint64_t total = vertex_offsets.back();

  // Equal pieces of the output, so that neither one huge object nor many tiny ones keep a thread waiting.
  parallel_for((total + chunk - 1) / chunk, 1, [&](std::size_t c) {
    const std::uint64_t end = std::min<std::uint64_t>(total, (c + 1) * chunk);
    std::uint64_t at = c * chunk;
    auto i = static_cast<std::size_t>(std::ranges::upper_bound(vertex_offsets, at) - vertex_offsets.begin() - 1);
    for (; at < end; ++i) {
      PGL_ASSERT(vertex_offsets[i + 1] - vertex_offsets[i] == counts[i]);
      PGL_ASSERT(counts[i] <= meshes[objects[i].mesh].max_vertices);
      if (i + 2 < objects.size()) prefetch(&meshes[objects[i + 2].mesh], 1);
      if (i + 1 < objects.size()) {
        prefetch(vertices.data() + meshes[objects[i + 1].mesh].first_vertex, counts[i + 1]);
      }
      const Object object = objects[i];
      const std::uint64_t stop = std::min(end, vertex_offsets[i + 1]);
      const Vertex* from = vertices.data() + meshes[object.mesh].first_vertex + (at - vertex_offsets[i]);
      for (; at < stop; ++at) place(object, static_cast<std::uint32_t>(i), *from++, out[at]);
    }
  });
}

}  // namespace pgl::host
