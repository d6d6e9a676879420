// SPDX-License-Identifier: MIT
// Moves the vertices, triangles and collapse targets of a mesh, or of many, to the order of their removal.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/rearrange.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace rearrange_detail {

inline constexpr std::uint32_t most_per_warp = 1 << 14;  ///< vertices, and triangles, of a mesh that one warp moves
inline constexpr std::uint64_t many_blocks = 512;        ///< at most, that move larger meshes together

/// The arrays of one mesh, or those that all meshes have their ranges of.
template <class Vertex, class Index>
struct Arrays {
  const Vertex* vertices;
  const Triangle<Index>* triangles;
  const Index* ecol;
  const Index* permute_v;
  const std::uint32_t* permute_t;
  Vertex* out_vertices;
  Triangle<Index>* out_triangles;
  Index* out_ecol;

  __device__ Arrays of(const MeshRange& mesh) const {
    return {vertices + mesh.first_vertex,        triangles + mesh.first_triangle, ecol + mesh.first_vertex,
            permute_v + mesh.first_vertex,       permute_t + mesh.first_triangle, out_vertices + mesh.first_vertex,
            out_triangles + mesh.first_triangle, out_ecol + mesh.first_vertex};
  }
};

/// Moves every stride-th vertex and triangle of a mesh, from `first` on.
template <class Vertex, class Index>
__device__ void move(const Arrays<Vertex, Index>& mesh, std::uint64_t vertices, std::uint64_t triangles,
                     std::uint64_t first, std::uint64_t stride) {
  for (std::uint64_t v = first; v < vertices; v += stride) {
    const Index place = mesh.permute_v[v], target = mesh.ecol[v];
    PGL_ASSERT(place < vertices && (target == no_target<Index> || target < vertices));
    mesh.out_vertices[place] = mesh.vertices[v];
    mesh.out_ecol[place] = rearranged_target(target, mesh.permute_v);
  }
  for (std::uint64_t t = first; t < triangles; t += stride) {
    const Triangle<Index> triangle = mesh.triangles[t];
    PGL_ASSERT(mesh.permute_t[t] < triangles);
    PGL_ASSERT(triangle.v[0] < vertices && triangle.v[1] < vertices && triangle.v[2] < vertices);
    mesh.out_triangles[mesh.permute_t[t]] = rearranged_triangle(triangle, mesh.permute_v);
  }
}

template <class Vertex, class Index>
__global__ void __launch_bounds__(1024)
    move_one_kernel(Arrays<Vertex, Index> arrays, std::uint64_t vertices, std::uint64_t triangles) {
  move(arrays, vertices, triangles, std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x,
       std::uint64_t{gridDim.x} * blockDim.x);
}

/// A warp for each mesh that is not too large for one.
template <class Vertex, class Index>
__global__ void __launch_bounds__(1024)
    move_small_kernel(const MeshRange* meshes, std::uint64_t size, Arrays<Vertex, Index> arrays) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t m = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32; m < size; m += stride) {
    const MeshRange& mesh = meshes[m];
    if (mesh.vertices > most_per_warp || mesh.triangles > most_per_warp) continue;
    move(arrays.of(mesh), mesh.vertices, mesh.triangles, threadIdx.x % 32, 32);
  }
}

/// The whole grid for each of the others: every block looks through all meshes for them, 4 per thread at a time. Takes
/// 4 words of shared memory per warp.
template <class Vertex, class Index>
__global__ void __launch_bounds__(1024)
    move_large_kernel(const MeshRange* meshes, std::uint64_t size, Arrays<Vertex, Index> arrays) {
  extern __shared__ uint4 pgl_shared_memory[];
  auto* found = reinterpret_cast<unsigned*>(pgl_shared_memory);  // a bit per mesh
  const unsigned warps = blockDim.x / 32;
  for (std::uint64_t first = 0; first < size; first += 4 * blockDim.x) {
    bool any = false;
#pragma unroll
    for (unsigned i = 0; i < 4; ++i) {
      const std::uint64_t m = first + i * blockDim.x + threadIdx.x;
      const bool large = m < size && (meshes[m].vertices > most_per_warp || meshes[m].triangles > most_per_warp);
      const unsigned of_warp = __ballot_sync(0xffffffffu, large);
      if (threadIdx.x % 32 == 0) found[i * warps + threadIdx.x / 32] = of_warp;
      any |= large;
    }
    if (!__syncthreads_or(any)) continue;
    for (unsigned word = 0; word < 4 * warps; ++word) {
      for (unsigned left = found[word]; left != 0; left &= left - 1) {
        const MeshRange& mesh = meshes[first + 32 * word + static_cast<unsigned>(__ffs(static_cast<int>(left)) - 1)];
        move(arrays.of(mesh), mesh.vertices, mesh.triangles, std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x,
             std::uint64_t{gridDim.x} * blockDim.x);
      }
    }
    __syncthreads();
  }
}

}  // namespace rearrange_detail

/// Puts a mesh into the order in which it is coarsened, what goes first last; arguments, preconditions and bytes as
/// pgl::host::rearrange.
///
/// All views are of device memory, aligned to their elements. Only enqueues, one kernel, without scratch; can be
/// captured into a graph. Returns the first error of the runtime. O(V + T); the same bytes on any device, for any block
/// size. [Peng13] Alg 1.
template <class Vertex, class Index>
[[nodiscard]] cudaError_t rearrange(std::span<const Vertex> vertices, std::span<const Triangle<Index>> triangles,
                                    std::span<const Index> ecol, std::span<const Index> permute_v,
                                    std::span<const std::uint32_t> permute_t, std::span<Vertex> out_vertices,
                                    std::span<Triangle<Index>> out_triangles, std::span<Index> out_ecol,
                                    Launch launch = {}) {
  PGL_ASSERT(ecol.size() == vertices.size() && permute_v.size() == vertices.size());
  PGL_ASSERT(out_vertices.size() == vertices.size() && out_ecol.size() == vertices.size());
  PGL_ASSERT(permute_t.size() == triangles.size() && out_triangles.size() == triangles.size());
  const rearrange_detail::Arrays<Vertex, Index> arrays{vertices.data(),      triangles.data(), ecol.data(),
                                                       permute_v.data(),     permute_t.data(), out_vertices.data(),
                                                       out_triangles.data(), out_ecol.data()};
  const std::uint64_t elements = std::max(vertices.size(), triangles.size());
  return detail::run(rearrange_detail::move_one_kernel<Vertex, Index>,
                     detail::blocks_for(elements, launch.block_threads), 0, launch, arrays, vertices.size(),
                     triangles.size());
}

/// Puts many meshes into the order in which each is coarsened; arguments, preconditions and bytes as the
/// pgl::host::rearrange of many.
///
/// All views are of device memory, aligned to their elements; outside the ranges of the meshes nothing is read or
/// written. Meshes of up to 2^14 vertices and triangles are moved by a warp each, larger ones by many blocks together.
/// Only enqueues, one or two kernels, without scratch; can be captured into a graph. Returns the first error of the
/// runtime. The same bytes on any device, for any block size. [Peng13] Alg 1.
template <class Vertex, class Index>
[[nodiscard]] cudaError_t rearrange(std::span<const MeshRange> meshes, std::span<const Vertex> vertices,
                                    std::span<const Triangle<Index>> triangles, std::span<const Index> ecol,
                                    std::span<const Index> permute_v, std::span<const std::uint32_t> permute_t,
                                    std::span<Vertex> out_vertices, std::span<Triangle<Index>> out_triangles,
                                    std::span<Index> out_ecol, Launch launch = {}) {
  PGL_ASSERT(ecol.size() == vertices.size() && permute_v.size() == vertices.size());
  PGL_ASSERT(out_vertices.size() == vertices.size() && out_ecol.size() == vertices.size());
  PGL_ASSERT(permute_t.size() == triangles.size() && out_triangles.size() == triangles.size());
  const rearrange_detail::Arrays<Vertex, Index> arrays{vertices.data(),      triangles.data(), ecol.data(),
                                                       permute_v.data(),     permute_t.data(), out_vertices.data(),
                                                       out_triangles.data(), out_ecol.data()};
  PGL_CUDA_TRY(detail::run(rearrange_detail::move_small_kernel<Vertex, Index>,
                           detail::blocks_for(meshes.size(), launch.block_threads / 32), 0, launch, meshes.data(),
                           meshes.size(), arrays));
  const std::uint64_t elements = std::max(vertices.size(), triangles.size());
  if (meshes.empty() || elements <= rearrange_detail::most_per_warp) return cudaSuccess;
  return detail::run(rearrange_detail::move_large_kernel<Vertex, Index>,
                     std::min(rearrange_detail::many_blocks, detail::blocks_for(elements, launch.block_threads)),
                     launch.block_threads / 32 * 16, launch, meshes.data(), meshes.size(), arrays);
}

}  // namespace pgl::cuda
