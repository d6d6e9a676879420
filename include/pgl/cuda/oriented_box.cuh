// SPDX-License-Identifier: MIT
// Oriented boxes of meshes and how compact the meshes are, on the GPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/oriented_box.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace detail::oriented {

using namespace pgl::detail;

/// The most threads in a block of oriented_boxes_kernel, which needs many registers.
inline constexpr unsigned most_box_threads = 256;

/// What the threads of a block share about their mesh.
struct BoxShared {
  Extreme extremes_of_warp[most_box_threads / 32][box_points];
  Extreme extremes[box_points];
  Vector<double> points[box_points];  // from the first of them
  Extreme largest_of_warp[most_box_threads / 32];
  unsigned long long units_of_warp[most_box_threads / 32];
  unsigned long long units;
  BoxCorners corners;
  double costs[32];
  BoxAxes best;
  double least;
  BoxSearch searches[box_searches];
  FloatAxes finalists[box_finalists];
  Reach reaches_of_warp[most_box_threads / 32][3 * box_finalists];
  Reach reaches[3 * box_finalists];
};
static_assert(box_points <= 32 && box_candidates <= 32 && box_searches * box_turns <= 32 && 3 * box_finalists <= 32);

__device__ inline Extreme farthest_of_warp(Extreme e) {
  for (int distance = 16; distance > 0; distance /= 2) {
    Extreme other;
    other.reach = __shfl_down_sync(0xffffffffu, e.reach, distance);
    other.vertex = __shfl_down_sync(0xffffffffu, e.vertex, distance);
    e = farther(e, other);
  }
  return e;
}

__device__ inline Reach reach_of_warp(Reach r) {
  for (int distance = 16; distance > 0; distance /= 2) {
    Reach other;
    other.low = __shfl_down_sync(0xffffffffu, r.low, distance);
    other.high = __shfl_down_sync(0xffffffffu, r.high, distance);
    r = merged(r, other);
  }
  return r;
}

/// Finds the finalists from the points and corners, one warp alone: a lane for each candidate, then for each turn.
__device__ inline void find_finalists(BoxShared& shared) {
  const int lane = static_cast<int>(threadIdx.x % 32);
  if (lane < box_candidates) shared.costs[lane] = box_cost(shared.points, candidate_axes(shared.corners, lane));
  __syncwarp();
  if (lane == 0) {
    int best = 0;
    for (int number = 1; number < box_candidates; ++number)
      if (shared.costs[number] < shared.costs[best]) best = number;
    shared.least = shared.costs[best];
    shared.best = candidate_axes(shared.corners, best);
    shared.finalists[0] = shared.finalists[1] = rounded(shared.best);
  }
  __syncwarp();
  if (lane < box_searches) shared.searches[lane] = search_start(shared.points, shared.best, lane);
  __syncwarp();
  for (int step = 0; step < box_search_steps; ++step) {
    if (lane < box_searches * box_turns)
      shared.costs[lane] = box_cost(shared.points, turned(shared.searches[lane / box_turns], lane % box_turns));
    __syncwarp();
    if (lane < box_searches) shared.searches[lane] = advance(shared.searches[lane], shared.costs + lane * box_turns);
    __syncwarp();
  }
  if (lane == 0) {
    double least = shared.least;
    for (int number = 0; number < box_searches; ++number)
      if (shared.searches[number].cost < least) {
        least = shared.searches[number].cost;
        shared.finalists[1] = rounded(shared.searches[number].axes);
      }
  }
  if (lane < largest_triangle_axes) shared.finalists[2 + lane] = rounded(candidate_axes(shared.corners, 1 + lane));
}

/// A block for each mesh.
template <class Index>
__global__ void __launch_bounds__(most_box_threads)
    oriented_boxes_kernel(const Mesh* meshes, std::uint64_t n, const glm::vec3* vertices,
                          const Triangle<Index>* triangles, const std::uint32_t* map, OrientedBox* boxes,
                          float* compactness) {
  __shared__ alignas(16) unsigned char memory[sizeof(BoxShared)];
  BoxShared& shared = *reinterpret_cast<BoxShared*>(memory);
  const unsigned thread = threadIdx.x, warp = thread / 32, lane = thread % 32, warps = blockDim.x / 32;
  for (std::uint64_t m = blockIdx.x; m < n; m += gridDim.x) {
    const Mesh mesh = meshes[m];
    const glm::vec3* positions = vertices + mesh.first_vertex;

    {
      Extreme own[box_points];
      for (std::uint64_t v = thread; v < mesh.max_vertices; v += blockDim.x)
        extend_extremes(own, positions[v], static_cast<std::uint32_t>(v));
#pragma unroll
      for (int i = 0; i < box_points; ++i) {
        const Extreme of_warp = farthest_of_warp(own[i]);
        if (lane == 0) shared.extremes_of_warp[warp][i] = of_warp;
      }
    }
    __syncthreads();
    if (thread < box_points) {
      Extreme e = shared.extremes_of_warp[0][thread];
      for (unsigned w = 1; w < warps; ++w) e = farther(e, shared.extremes_of_warp[w][thread]);
      shared.extremes[thread] = e;
    }
    __syncthreads();
    if (shared.extremes[0].vertex == Extreme::no_vertex) {  // no finite vertex; the same for all threads
      if (thread == 0) {
        boxes[m] = OrientedBox{};
        compactness[m] = 0.0f;
      }
      __syncthreads();
      continue;
    }
    const Vector<double> origin(positions[shared.extremes[0].vertex]);
    if (thread < box_points)
      shared.points[thread] = difference(Vector<double>(positions[shared.extremes[thread].vertex]), origin);

    const Triangle<Index>* own_triangles = triangles + mesh.first_triangle;
    const std::uint32_t triangle_count = triangles_at(mesh, map, mesh.max_vertices);
    const AreaScale scale = area_scale(extent_of(shared.extremes), triangle_count);
    {
      Extreme largest{0.0, Extreme::no_vertex};
      unsigned long long units = 0;
      for (std::uint64_t t = thread; t < triangle_count; t += blockDim.x) {
        const Triangle<Index> triangle = own_triangles[t];
        const double key = triangle_key(positions[triangle.v[0]], positions[triangle.v[1]], positions[triangle.v[2]]);
        units += area_units(key, scale);
        if (key > largest.reach) largest = {key, static_cast<std::uint32_t>(t)};
      }
      largest = farthest_of_warp(largest);
      for (int distance = 16; distance > 0; distance /= 2) units += __shfl_down_sync(0xffffffffu, units, distance);
      if (lane == 0) {
        shared.largest_of_warp[warp] = largest;
        shared.units_of_warp[warp] = units;
      }
    }
    __syncthreads();
    if (thread == 0) {
      Extreme largest = shared.largest_of_warp[0];
      shared.units = shared.units_of_warp[0];
      for (unsigned w = 1; w < warps; ++w) {
        largest = farther(largest, shared.largest_of_warp[w]);
        shared.units += shared.units_of_warp[w];
      }
      for (int c = 0; c < 3; ++c)
        shared.corners.largest[c] =
            largest.vertex == Extreme::no_vertex
                ? shared.points[0]
                : difference(Vector<double>(positions[own_triangles[largest.vertex].v[c]]), origin);
      find_box_corners(shared.points, shared.corners);
    }
    __syncthreads();
    if (warp == 0) find_finalists(shared);
    __syncthreads();

    {
      Reach own[3 * box_finalists];
      for (std::uint64_t v = thread; v < mesh.max_vertices; v += blockDim.x) {
        const glm::vec3 p = positions[v];
        if (!is_finite_point(p)) continue;
#pragma unroll
        for (int i = 0; i < 3 * box_finalists; ++i)
          own[i] = with(own[i], reach_along(shared.finalists[i / 3].axis[i % 3], p));
      }
#pragma unroll
      for (int i = 0; i < 3 * box_finalists; ++i) {
        const Reach of_warp = reach_of_warp(own[i]);
        if (lane == 0) shared.reaches_of_warp[warp][i] = of_warp;
      }
    }
    __syncthreads();
    if (thread < 3 * box_finalists) {
      Reach r = shared.reaches_of_warp[0][thread];
      for (unsigned w = 1; w < warps; ++w) r = merged(r, shared.reaches_of_warp[w][thread]);
      shared.reaches[thread] = r;
    }
    __syncthreads();
    if (thread == 0) {
      const OrientedBox box = best_box(shared.extremes, shared.finalists, shared.reaches);
      boxes[m] = box;
      compactness[m] = compactness_of(box, shared.units, scale);
    }
    __syncthreads();
  }
}

}  // namespace detail::oriented

/// Writes an oriented box around each mesh, and how compact the mesh is, as pgl::host::oriented_boxes does.
///
/// All views are of device memory. O(vertices + triangles), one kernel with a block of at most 256 threads for each
/// mesh, no scratch. Enqueued on launch.stream, capturable; the same bits for any launch and GPU.
template <class Index>
[[nodiscard]] cudaError_t oriented_boxes(std::span<const Mesh> meshes, std::span<const glm::vec3> vertices,
                                         std::span<const Triangle<Index>> triangles, std::span<const std::uint32_t> map,
                                         std::span<OrientedBox> boxes, std::span<float> compactness,
                                         Launch launch = {}) {
  PGL_ASSERT(boxes.size() == meshes.size() && compactness.size() == meshes.size());
  launch.block_threads = std::min(launch.block_threads, detail::oriented::most_box_threads);
  const std::uint64_t n = meshes.size();
  return detail::run(detail::oriented::oriented_boxes_kernel<Index>, n, 0, launch, meshes.data(), n, vertices.data(),
                     triangles.data(), map.data(), boxes.data(), compactness.data());
}

}  // namespace pgl::cuda
