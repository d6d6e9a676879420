// SPDX-License-Identifier: MIT
// Screen areas and depths of all objects, on the GPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/project.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace detail {

/// The most threads in a block of project_kernel: it needs many registers, which small blocks share out better.
inline constexpr unsigned most_project_threads = 128;

/// in_view and rectangles may be null.
template <class = void>
__global__ void __launch_bounds__(most_project_threads)
    project_kernel(const Box* boxes, std::uint64_t n, const std::uint8_t* in_view,
                   const __grid_constant__ pgl::detail::ViewRows view, float* areas, float* depths,
                   ScreenBox* rectangles) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    const bool skip = in_view != nullptr && in_view[i] == 0;
    const ScreenBox rectangle = pgl::detail::project(skip ? Box{} : boxes[i], view);
    areas[i] = projected_area(rectangle);
    depths[i] = rectangle.depth;
    if (rectangles != nullptr) rectangles[i] = rectangle;
  }
}

}  // namespace detail

/// Writes what each object in view covers, its area and its nearest depth, on request also its rectangle, as
/// pgl::host::project does.
///
/// All views are of device memory; an empty `in_view` means all, empty `rectangles` that none are wanted. The view is
/// read before this returns: a captured graph keeps the one that it was captured with.
/// O(n), one kernel, no scratch; it runs on blocks of at most 128 threads. Enqueued on launch.stream, capturable; the
/// same bits for any launch.
[[nodiscard]] inline cudaError_t project(std::span<const Box> boxes, std::span<const std::uint8_t> in_view,
                                         const View& view, std::span<float> areas, std::span<float> depths,
                                         std::span<ScreenBox> rectangles = {}, Launch launch = {}) {
  PGL_ASSERT(in_view.empty() || in_view.size() == boxes.size());
  PGL_ASSERT(areas.size() == boxes.size() && depths.size() == boxes.size());
  PGL_ASSERT(rectangles.empty() || rectangles.size() == boxes.size());
  launch.block_threads = std::min(launch.block_threads, detail::most_project_threads);
  const std::uint64_t n = boxes.size();
  return detail::run(detail::project_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch, boxes.data(), n,
                     in_view.empty() ? nullptr : in_view.data(), pgl::detail::rows_of(view), areas.data(),
                     depths.data(), rectangles.empty() ? nullptr : rectangles.data());
}

}  // namespace pgl::cuda
