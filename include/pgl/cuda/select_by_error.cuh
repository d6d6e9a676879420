// SPDX-License-Identifier: MIT
// Selects every object's vertex count by its error on the screen, on the GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/totals.cuh"
#include "pgl/select_by_error.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

using pgl::BudgetTotals;

namespace detail {

template <class = void>
__global__ void __launch_bounds__(1024) error_scales_kernel(const Object* objects, std::uint64_t n, float* scales) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride)
    scales[i] = error_scale(objects[i].transform);
}

/// totals may be null, or is zero.
template <class = void>
__global__ void __launch_bounds__(1024)
    select_by_error_kernel(const float* areas, const float* depths, std::uint64_t n, const std::uint32_t* min_vertices,
                           const std::uint32_t* max_vertices, const float* scales, const std::uint32_t* mesh_of_object,
                           const Mesh* meshes, const float* errors, const ErrorView view, std::uint32_t* counts,
                           BudgetTotals* totals) {
  OwnTotals own;
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    PGL_ASSERT(min_vertices[i] <= max_vertices[i]);
    const float depth = depths[i];
    const std::uint32_t count = is_seen(areas[i], depth, view)
                                    ? vertices_by_error(depth, min_vertices[i], max_vertices[i], scales[i],
                                                        meshes[mesh_of_object[i]], errors, view)
                                    : 0;
    counts[i] = count;
    own.add(count);
  }
  if (totals != nullptr) add_totals(own, totals);
}

}  // namespace detail

/// Bounds how much each object's transform enlarges an error of its mesh, as pgl::host::error_scales does.
/// All views are of device memory. O(n), one kernel, no scratch. Enqueued on launch.stream, capturable; the same bits
/// for any launch.
[[nodiscard]] inline cudaError_t error_scales(std::span<const Object> objects, std::span<float> scales,
                                              Launch launch = {}) {
  PGL_ASSERT(scales.size() == objects.size());
  const std::uint64_t n = objects.size();
  return detail::run(detail::error_scales_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     objects.data(), n, scales.data());
}

/// Selects for each object in view the coarsest prefix whose error stays below a threshold on the screen, as
/// pgl::host::select_by_error does.
///
/// All views are of device memory. totals: out, on the device, what the host's returns; null if not wanted. The view
/// and the options are read before this returns: a captured graph keeps those that it was captured with.
/// O(n log vertices): one kernel, no scratch, and a memset before it where totals are wanted. Enqueued on
/// launch.stream, capturable; the same bits for any launch.
[[nodiscard]] inline cudaError_t select_by_error(
    std::span<const float> areas, std::span<const float> depths, std::span<const std::uint32_t> min_vertices,
    std::span<const std::uint32_t> max_vertices, std::span<const float> scales,
    std::span<const std::uint32_t> mesh_of_object, std::span<const Mesh> meshes, std::span<const float> errors,
    const View& view, const ErrorOptions& options, std::span<std::uint32_t> counts, BudgetTotals* totals,
    Launch launch = {}) {
  const std::uint64_t n = areas.size();
  PGL_ASSERT(depths.size() == n && min_vertices.size() == n && max_vertices.size() == n && scales.size() == n);
  PGL_ASSERT(mesh_of_object.size() == n && counts.size() == n);
  if (totals != nullptr) PGL_CUDA_TRY(cudaMemsetAsync(totals, 0, sizeof(*totals), launch.stream));
  return detail::run(detail::select_by_error_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     areas.data(), depths.data(), n, min_vertices.data(), max_vertices.data(), scales.data(),
                     mesh_of_object.data(), meshes.data(), errors.data(), error_view_of(view, options), counts.data(),
                     totals);
}

}  // namespace pgl::cuda
