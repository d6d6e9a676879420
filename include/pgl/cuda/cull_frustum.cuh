// SPDX-License-Identifier: MIT
// View-frustum culling of all objects, on the GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/cull_frustum.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace detail {

template <class = void>
__global__ void __launch_bounds__(1024)
    cull_frustum_kernel(const Box* boxes, std::uint64_t n, Frustum frustum, std::uint8_t* in_view) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride)
    in_view[i] = static_cast<std::uint8_t>(in_frustum(boxes[i], frustum));
}

}  // namespace detail

/// Marks the boxes that may be in view, as pgl::host::cull_frustum does.
///
/// boxes: in, on the device. in_view: out, on the device, one byte per box. The view is read before this returns: a
/// captured graph keeps the one that it was captured with.
/// O(n), one kernel that reads 24 bytes and writes 1 per box; no scratch. Enqueued on launch.stream, capturable; the
/// same bits for any launch.
[[nodiscard]] inline cudaError_t cull_frustum(std::span<const Box> boxes, const View& view,
                                              std::span<std::uint8_t> in_view, Launch launch = {}) {
  PGL_ASSERT(in_view.size() == boxes.size());
  const std::uint64_t n = boxes.size();
  return detail::run(detail::cull_frustum_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     boxes.data(), n, frustum_of(view), in_view.data());
}

}  // namespace pgl::cuda
