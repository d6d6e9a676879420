// SPDX-License-Identifier: MIT
// Fills one vertex buffer with the selected vertices of every object, placed in the world.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/tiles.cuh"
#include "pgl/gather.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace gather_detail {

inline constexpr unsigned rows = 4;   ///< a warp takes 32 vertices times this at a time: 1 to 4
inline constexpr unsigned waves = 4;  ///< blocks started, in terms of those that run at the same time

/// Vertices that leave a warp together, by way of shared memory. Those of the caller's own types are written where they
/// belong by their place(), which may leave parts of them as they are.
template <class Placed>
inline constexpr bool staged = std::is_same_v<Placed, glm::vec3> || std::is_same_v<Placed, PlacedVertex>;

/// The shared memory of a warp.
template <class Placed>
struct Area {
  uint4 vertices[staged<Placed> ? 2 * sizeof(Placed) : 1];  // a row, where it is staged
  std::uint64_t from[32];  // the vertex that belongs at position 0 of the tile, modulo 2^64
  std::uint64_t object[32];
  unsigned heads[4];
};

/// gather, or gather_block: then the vertices are the selected ones alone, where they go, and there are no meshes and
/// no counts.
template <bool from_block, class Placed, class Vertex>
__global__ void __launch_bounds__(1024)
    gather_kernel([[maybe_unused]] const Mesh* meshes, const Object* objects, std::uint64_t size,
                  const Vertex* vertices, [[maybe_unused]] const std::uint32_t* counts, const std::uint64_t* offsets,
                  Placed* out, [[maybe_unused]] std::uint64_t out_size, detail::TileStart start) {
  constexpr std::uint64_t tile = 32 * rows;
  extern __shared__ uint4 pgl_shared_memory[];
  const unsigned lane = detail::lane_index();
  Area<Placed>& area = reinterpret_cast<Area<Placed>*>(pgl_shared_memory)[threadIdx.x / 32];

  const std::uint64_t total = offsets[size];
  PGL_ASSERT(total <= out_size);
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t j = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32;
       j * tile < total + start.lead; j += stride) {
    const std::uint64_t origin = j * tile - start.lead;
    const std::uint64_t lo = j == 0 ? 0 : origin;
    const std::uint64_t hi = origin + tile < total ? origin + tile : total;
    if (lo >= hi) continue;
    [[maybe_unused]] Vertex ahead[from_block ? rows : 1];
    if constexpr (from_block) {  // nothing has to be known of their objects
#pragma unroll
      for (unsigned r = 0; r < rows; ++r) {
        const std::uint64_t at = origin + (32 * r + lane);
        if (at - lo < hi - lo) ahead[r] = vertices[at];  // below lo, also below 0, is far above
      }
    }
    detail::for_each_group<rows>(
        offsets, size, detail::object_at(offsets, 0, size, lo), origin, lo, hi, area.heads,
        [&](const detail::TilePart& part, unsigned first, unsigned last) {
          if (part.size != 0) {
            detail::prefetch(&objects[part.object].transform[1]);
            detail::prefetch(&objects[part.object].transform[3].z);
            if constexpr (!from_block) {
              const Mesh& mesh = meshes[objects[part.object].mesh];
              PGL_ASSERT(counts[part.object] <= mesh.max_vertices);
              PGL_ASSERT(offsets[part.object + 1] - part.begin == counts[part.object]);
              area.from[part.slot] = mesh.first_vertex + (origin - part.begin);
            }
            area.object[part.slot] = part.object;
          }
          __syncwarp();

          const auto in_group = [&](unsigned r) { return 32 * r + lane >= first && 32 * r + lane < last; };
          Vertex vertex[rows];
#pragma unroll
          for (unsigned r = 0; r < rows; ++r) {
            if constexpr (from_block) {
              if (in_group(r)) vertex[r] = ahead[r];
            } else {
              if (in_group(r)) vertex[r] = vertices[area.from[detail::slot_of(area.heads, r)] + (32 * r + lane)];
            }
          }
#pragma unroll
          for (unsigned r = 0; r < rows; ++r) {
            if (32 * r >= last || 32 * r + 32 <= first) continue;
            if (in_group(r)) {
              const std::uint64_t i = area.object[detail::slot_of(area.heads, r)];
              if constexpr (staged<Placed>) {
                place(objects[i], static_cast<std::uint32_t>(i), vertex[r],
                      reinterpret_cast<Placed*>(area.vertices)[lane]);
              } else {
                place(objects[i], static_cast<std::uint32_t>(i), vertex[r], out[origin + (32 * r + lane)]);
              }
            }
            if constexpr (staged<Placed>) {
              __syncwarp();
              detail::write_row<std::uint32_t>(reinterpret_cast<const Placed*>(area.vertices), out, origin + 32 * r,
                                               first > 32 * r ? first - 32 * r : 0,
                                               last < 32 * r + 32 ? last - 32 * r : 32, start.aligned);
              __syncwarp();
            }
          }
        });
  }
}

template <bool from_block, class Placed, class Vertex>
[[nodiscard]] cudaError_t gather(const Mesh* meshes, std::span<const Object> objects, const Vertex* vertices,
                                 const std::uint32_t* counts, std::span<const std::uint64_t> vertex_offsets,
                                 std::span<Placed> out, Launch launch) {
  static_assert(std::is_trivially_copyable_v<Vertex> && std::is_default_constructible_v<Vertex>);
  PGL_ASSERT(vertex_offsets.size() == objects.size() + 1);
  if (objects.empty() || out.empty()) return cudaSuccess;
  const detail::TileStart start = detail::tile_start(out.data());
  const auto kernel = gather_kernel<from_block, Placed, Vertex>;
  const std::uint64_t tile = 32 * rows;
  const std::size_t shared_bytes = launch.block_threads / 32 * sizeof(Area<Placed>);
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(
      detail::tile_blocks(kernel, (out.size() + start.lead + tile - 1) / tile, shared_bytes, waves, launch, blocks));
  return detail::run(kernel, blocks, shared_bytes, launch, meshes, objects.data(), objects.size(), vertices, counts,
                     vertex_offsets.data(), out.data(), out.size(), start);
}

}  // namespace gather_detail

/// Writes the first counts[i] vertices of the mesh of every object i, placed in the world, to
/// out[vertex_offsets[i] .. vertex_offsets[i+1]); arguments, preconditions and bytes as pgl::host::gather.
///
/// All views are of device memory, aligned to their elements, out best to 16 bytes. The number of vertices written is
/// vertex_offsets[n], read on the device: the grid depends on out.size() alone.
///
/// Placed is glm::vec3, PlacedVertex, or any type with a place() of its own that is also device code (PGL_HD). Vertex
/// is default constructible and trivially copyable.
///
/// Only enqueues, one kernel, without scratch; can be captured into a graph. Returns the first error of the runtime.
/// O(n + total); the same bytes on any device, for any block size, where a NaN counts as equal to any other.
template <class Placed, class Vertex>
[[nodiscard]] cudaError_t gather(std::span<const Mesh> meshes, std::span<const Object> objects,
                                 std::span<const Vertex> vertices, std::span<const std::uint32_t> counts,
                                 std::span<const std::uint64_t> vertex_offsets, std::span<Placed> out,
                                 Launch launch = {}) {
  PGL_ASSERT(counts.size() == objects.size());
  return gather_detail::gather<false>(meshes.data(), objects, vertices.data(), counts.data(), vertex_offsets, out,
                                      launch);
}

/// Like gather, from a block that holds the selected vertices and no others; arguments, preconditions and bytes as
/// pgl::host::gather_block, the rest as for gather.
template <class Placed, class Vertex>
[[nodiscard]] cudaError_t gather_block(std::span<const Object> objects, std::span<const Vertex> block,
                                       std::span<const std::uint64_t> vertex_offsets, std::span<Placed> out,
                                       Launch launch = {}) {
  return gather_detail::gather<true, Placed, Vertex>(nullptr, objects, block.data(), nullptr, vertex_offsets, out,
                                                     launch);
}

}  // namespace pgl::cuda
