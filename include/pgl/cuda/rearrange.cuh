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

inline constexpr std::uint32_t most_vertices = 1 << 14;   ///< of a mesh that one block moves
inline constexpr std::uint32_t most_triangles = 1 << 15;  ///< of a mesh that one block moves
inline constexpr std::uint64_t many_blocks = 512;         ///< at most, that move larger meshes together
inline constexpr unsigned area_bytes = 24 << 10;  ///< of shared memory, in which a block puts its output together

/// Whether vertices are put together in shared memory; otherwise they are stored one by one.
template <class Vertex>
inline constexpr bool is_staged = sizeof(Vertex) <= 64 && alignof(Vertex) <= 16;

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

inline __device__ bool is_large(const MeshRange& mesh) {
  return mesh.vertices > most_vertices || mesh.triangles > most_triangles;
}

/// `size` elements of an output, from `first` on: put together by a block in an area of shared memory, at the same
/// place modulo 16 as in the output, so that they can be written in words of 16 bytes.
template <class T>
class Window {
 public:
  /// area: aligned to 16 bytes, window_bytes<T>(size) of them.
  __device__ Window(T* out, std::uint32_t first, std::uint32_t size, std::byte* area)
      : out_(out + first),
        staged_(reinterpret_cast<T*>(area + reinterpret_cast<std::uintptr_t>(out + first) % 16)),
        first_(first),
        size_(size) {}

  __device__ bool has(std::uint32_t place) const { return place - first_ < size_; }
  __device__ void put(std::uint32_t place, const T& value) const { staged_[place - first_] = value; }

  /// By the whole block, of at least 16 threads, with a barrier before and after it.
  __device__ void write() const {
    auto* to = reinterpret_cast<unsigned char*>(out_);
    const auto* from = reinterpret_cast<const unsigned char*>(staged_);
    const unsigned bytes = size_ * static_cast<unsigned>(sizeof(T));
    const unsigned before = min(bytes, (16 - static_cast<unsigned>(reinterpret_cast<std::uintptr_t>(to) % 16)) % 16);
    const unsigned words = (bytes - before) / 16;
    if (threadIdx.x < before) to[threadIdx.x] = from[threadIdx.x];
    auto* to_words = reinterpret_cast<uint4*>(to + before);
    const auto* from_words = reinterpret_cast<const uint4*>(from + before);
    for (unsigned i = threadIdx.x; i < words; i += blockDim.x) to_words[i] = from_words[i];
    const unsigned done = before + 16 * words;
    if (threadIdx.x < bytes - done) to[done + threadIdx.x] = from[done + threadIdx.x];
  }

 private:
  T* out_;
  T* staged_;
  std::uint32_t first_, size_;
};

/// The part of an area that a window of `size` elements takes, wherever its output begins.
template <class T>
__device__ unsigned window_bytes(std::uint32_t size) {
  return (size * static_cast<unsigned>(sizeof(T)) + 31) / 16 * 16;
}

/// Moves a mesh that is not large, by the whole block: in one go if all of its output has room in the area, otherwise
/// array after array in windows, each of which looks through the whole array for what belongs into it. Ends with a
/// barrier if it has used the area.
template <class Vertex, class Index>
__device__ void move_by_block(const Arrays<Vertex, Index>& mesh, std::uint32_t vertices, std::uint32_t triangles,
                              std::byte* area) {
  const unsigned step = blockDim.x;
  unsigned left = area_bytes;
  const Index* places = mesh.permute_v;
  const unsigned places_bytes = (vertices * static_cast<unsigned>(sizeof(Index)) + 15) / 16 * 16;
  if (places_bytes <= left / 2) {
    auto* copy = reinterpret_cast<Index*>(area);
    for (std::uint32_t v = threadIdx.x; v < vertices; v += step) copy[v] = __ldg(mesh.permute_v + v);
    places = copy;
    area += places_bytes;
    left -= places_bytes;
    __syncthreads();
  }

  const auto vertex = [&](const Window<Vertex>& window, std::uint32_t v) {
    const std::uint32_t place = places[v];
    PGL_ASSERT(place < vertices);
    if (window.has(place)) window.put(place, mesh.vertices[v]);
  };
  const auto target = [&](const Window<Index>& window, std::uint32_t v) {
    const std::uint32_t place = places[v];
    if (!window.has(place)) return;
    const Index old = __ldg(mesh.ecol + v);
    PGL_ASSERT(place < vertices && (old == no_target<Index> || old < vertices));
    window.put(place, rearranged_target(old, places));
  };
  const auto triangle = [&](const Window<Triangle<Index>>& window, std::uint32_t t) {
    const std::uint32_t place = __ldg(mesh.permute_t + t);
    PGL_ASSERT(place < triangles);
    if (!window.has(place)) return;
    const Index* corners = mesh.triangles[t].v;
    const Triangle<Index> old{{__ldg(corners), __ldg(corners + 1), __ldg(corners + 2)}};
    PGL_ASSERT(old.v[0] < vertices && old.v[1] < vertices && old.v[2] < vertices);
    window.put(place, rearranged_triangle(old, places));
  };

  if constexpr (!is_staged<Vertex>) {
    for (std::uint32_t v = threadIdx.x; v < vertices; v += step) mesh.out_vertices[places[v]] = mesh.vertices[v];
  }
  const std::uint32_t staged = is_staged<Vertex> ? vertices : 0;
  const unsigned for_vertices = window_bytes<Vertex>(staged), for_ecol = window_bytes<Index>(vertices);
  if (for_vertices + for_ecol + window_bytes<Triangle<Index>>(triangles) <= left) {
    const Window<Vertex> window_v(mesh.out_vertices, 0, staged, area);
    const Window<Index> window_e(mesh.out_ecol, 0, vertices, area + for_vertices);
    const Window<Triangle<Index>> window_t(mesh.out_triangles, 0, triangles, area + for_vertices + for_ecol);
    for (std::uint32_t v = threadIdx.x; v < vertices; v += step) {
      vertex(window_v, v);
      target(window_e, v);
    }
    for (std::uint32_t t = threadIdx.x; t < triangles; t += step) triangle(window_t, t);
    __syncthreads();
    window_v.write();
    window_e.write();
    window_t.write();
    __syncthreads();
    return;
  }
  const auto in_windows = [&]<class T>(T* out, std::uint32_t size, const auto& put) {
    const std::uint32_t most = (left - 16) / static_cast<unsigned>(sizeof(T));
    for (std::uint32_t first = 0; first < size; first += most) {
      const Window<T> window(out, first, min(most, size - first), area);
      for (std::uint32_t i = threadIdx.x; i < size; i += step) put(window, i);
      __syncthreads();
      window.write();
      __syncthreads();
    }
  };
  in_windows(mesh.out_vertices, staged, vertex);
  in_windows(mesh.out_ecol, vertices, target);
  in_windows(mesh.out_triangles, triangles, triangle);
}

/// A block for each mesh that is not large. Takes area_bytes of shared memory.
template <class Vertex, class Index>
__global__ void __launch_bounds__(1024)
    move_small_kernel(const MeshRange* meshes, std::uint64_t size, Arrays<Vertex, Index> arrays) {
  extern __shared__ uint4 pgl_shared_memory[];
  for (std::uint64_t m = blockIdx.x; m < size; m += gridDim.x) {
    const MeshRange mesh = meshes[m];
    if (is_large(mesh)) continue;
    move_by_block(arrays.of(mesh), mesh.vertices, mesh.triangles, reinterpret_cast<std::byte*>(pgl_shared_memory));
  }
}

/// The whole grid for each large mesh: every block looks through all meshes for them, 4 per thread at a time. Takes
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
      const bool large = m < size && is_large(meshes[m]);
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
/// written. Meshes of up to 2^14 vertices and 2^15 triangles are moved by a block each, larger ones by many blocks
/// together. Only enqueues, one or two kernels, without scratch; can be captured into a graph. Returns the first error
/// of the runtime. The same bytes on any device, for any block size. [Peng13] Alg 1.
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
  PGL_CUDA_TRY(detail::run(rearrange_detail::move_small_kernel<Vertex, Index>, meshes.size(),
                           rearrange_detail::area_bytes, launch, meshes.data(), meshes.size(), arrays));
  if (meshes.empty() ||
      (vertices.size() <= rearrange_detail::most_vertices && triangles.size() <= rearrange_detail::most_triangles)) {
    return cudaSuccess;
  }
  const std::uint64_t elements = std::max(vertices.size(), triangles.size());
  return detail::run(rearrange_detail::move_large_kernel<Vertex, Index>,
                     std::min(rearrange_detail::many_blocks, detail::blocks_for(elements, launch.block_threads)),
                     launch.block_threads / 32 * 16, launch, meshes.data(), meshes.size(), arrays);
}

}  // namespace pgl::cuda
