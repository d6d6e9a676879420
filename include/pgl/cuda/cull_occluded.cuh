// SPDX-License-Identifier: MIT
// Occlusion culling of all objects, on the GPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/tiles.cuh"
#include "pgl/cull_occluded.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace detail {

/// The most threads in a block of cull_occluded_kernel: it needs many registers, and small blocks share them out better
/// and keep all processors busy to the end.
inline constexpr unsigned most_cull_threads = 128;
/// The boxes that a block takes, for each of its threads.
inline constexpr unsigned boxes_per_thread = 4;

/// A block lists which of its boxes are in view, for its threads to share these out: in a scene of which little is in
/// view no lane waits for another's box. `visible` may be in_view.
template <class = void>
__global__ void __launch_bounds__(most_cull_threads)
    cull_occluded_kernel(const Box* boxes, std::uint64_t n, const std::uint8_t* in_view,
                         const __grid_constant__ pgl::detail::ViewRows view, const __grid_constant__ Hzm map,
                         std::uint32_t refinement, std::uint8_t* visible) {
  extern __shared__ std::uint16_t listed[];
  __shared__ unsigned count;
  if (threadIdx.x == 0) count = 0;
  __syncthreads();
  const std::uint64_t first = std::uint64_t{blockIdx.x} * (boxes_per_thread * blockDim.x);
  for (unsigned k = 0; k < boxes_per_thread; ++k) {
    const unsigned i = k * blockDim.x + threadIdx.x;
    const bool exists = first + i < n;
    const bool taken = exists && in_view[first + i] != 0;
    const unsigned all_taken = __ballot_sync(whole_warp, taken);
    unsigned begin = 0;
    if (lane_index() == 0 && all_taken != 0) begin = atomicAdd(&count, static_cast<unsigned>(__popc(all_taken)));
    begin = __shfl_sync(whole_warp, begin, 0);
    if (taken) {
      const unsigned before = static_cast<unsigned>(__popc(all_taken & ((1u << lane_index()) - 1)));
      listed[begin + before] = static_cast<std::uint16_t>(i);
    } else if (exists) {
      visible[first + i] = 0;
    }
  }
  __syncthreads();
  for (unsigned j = threadIdx.x; j < count; j += blockDim.x) {
    const std::uint64_t i = first + listed[j];
    visible[i] = static_cast<std::uint8_t>(!pgl::detail::is_hidden(boxes[i], view, map, refinement));
  }
}

template <class = void>
__global__ void __launch_bounds__(1024) show_occluders_kernel(const std::uint32_t* occluders, std::uint64_t n,
                                                              std::uint64_t objects, std::uint8_t* visible) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    const std::uint32_t occluder = occluders[i];
    if (occluder == no_object) continue;
    PGL_ASSERT(occluder < objects);
    visible[occluder] = 1;
  }
}

}  // namespace detail

/// Marks the objects that may be seen, as pgl::host::cull_occluded does.
///
/// All views are of device memory; `visible` may be the same array as in_view. The view and the map's size are read
/// before this returns: a captured graph keeps those that it was captured with.
/// O(n), one kernel over the boxes, on blocks of at most 128 threads, and one over the occluders where there are any;
/// no scratch. Enqueued on launch.stream, capturable; the same for any launch.
[[nodiscard]] inline cudaError_t cull_occluded(std::span<const Box> boxes, std::span<const std::uint8_t> in_view,
                                               std::span<const std::uint32_t> occluders, const View& view,
                                               const DepthMap& size, std::span<const Depth> hzm,
                                               std::uint32_t refinement, std::span<std::uint8_t> visible,
                                               Launch launch = {}) {
  PGL_ASSERT(in_view.size() == boxes.size() && visible.size() == boxes.size());
  PGL_ASSERT(size == depth_map_of(view, size.scale, size.coverage));
  PGL_ASSERT(hzm.size() == hzm_texels(size));
  const std::uint64_t n = boxes.size();
  Launch of_boxes = launch;
  of_boxes.block_threads = std::min(launch.block_threads, detail::most_cull_threads);
  const unsigned per_block = detail::boxes_per_thread * of_boxes.block_threads;
  PGL_CUDA_TRY(detail::run(detail::cull_occluded_kernel<>, detail::blocks_for(n, per_block),
                           per_block * sizeof(std::uint16_t), of_boxes, boxes.data(), n, in_view.data(),
                           pgl::detail::rows_of(view), hzm_of(size, hzm.data()), refinement, visible.data()));
  return detail::run(detail::show_occluders_kernel<>, detail::blocks_for(occluders.size(), launch.block_threads), 0,
                     launch, occluders.data(), occluders.size(), n, visible.data());
}

}  // namespace pgl::cuda
