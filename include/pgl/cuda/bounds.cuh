// SPDX-License-Identifier: MIT
// Boxes of meshes and of placed objects, on the GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/bounds.hpp"
#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/types.hpp"

namespace pgl::cuda {

/// Scratch memory of bounds: a box for each block of the first of its two kernels, at most 24 KiB.
struct BoundsWorkspace {
  Buffer memory;
};

namespace detail {

/// The most blocks that find boxes of their own.
inline constexpr std::uint64_t most_bounds_blocks = 1024;

/// Merges the boxes of a block's threads; the result is thread 0's.
__device__ inline Box merged_over_block(Box box) {
  __shared__ float of_warp[32][6];
  const unsigned warp = threadIdx.x / 32, lane = threadIdx.x % 32, warps = blockDim.x / 32;
  const auto merge_over_warp = [](Box b) {
    for (int distance = 16; distance > 0; distance /= 2) {
      Box other;
      other.min.x = __shfl_down_sync(0xffffffffu, b.min.x, distance);
      other.min.y = __shfl_down_sync(0xffffffffu, b.min.y, distance);
      other.min.z = __shfl_down_sync(0xffffffffu, b.min.z, distance);
      other.max.x = __shfl_down_sync(0xffffffffu, b.max.x, distance);
      other.max.y = __shfl_down_sync(0xffffffffu, b.max.y, distance);
      other.max.z = __shfl_down_sync(0xffffffffu, b.max.z, distance);
      b = merge(b, other);
    }
    return b;
  };
  box = merge_over_warp(box);
  if (lane == 0) {
    float* side = of_warp[warp];
    side[0] = box.min.x;
    side[1] = box.min.y;
    side[2] = box.min.z;
    side[3] = box.max.x;
    side[4] = box.max.y;
    side[5] = box.max.z;
  }
  __syncthreads();
  if (warp == 0) {
    box = Box{};
    if (lane < warps) {
      const float* side = of_warp[lane];
      box.min.x = side[0];
      box.min.y = side[1];
      box.min.z = side[2];
      box.max.x = side[3];
      box.max.y = side[4];
      box.max.z = side[5];
    }
    box = merge_over_warp(box);
  }
  return box;
}

template <class = void>
__global__ void __launch_bounds__(1024)
    bounds_of_blocks_kernel(const glm::vec3* positions, std::uint64_t n, Box* boxes) {
  Box box;
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride)
    box = extend(box, positions[i]);
  box = merged_over_block(box);
  if (threadIdx.x == 0) boxes[blockIdx.x] = box;
}

template <class = void>
__global__ void __launch_bounds__(1024) merge_boxes_kernel(const Box* boxes, std::uint64_t n, Box* out) {
  Box box;
  for (std::uint64_t i = threadIdx.x; i < n; i += blockDim.x) box = merge(box, boxes[i]);
  box = merged_over_block(box);
  if (threadIdx.x == 0) *out = box;
}

template <class = void>
__global__ void __launch_bounds__(1024)
    object_bounds_kernel(const Object* objects, std::uint64_t n, const Box* mesh_boxes, Box* out) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride)
    out[i] = transform(mesh_boxes[objects[i].mesh], objects[i].transform);
}

}  // namespace detail

/// Writes the least box of the positions, as pgl::host::bounds returns it.
///
/// positions: in, on the device, any number. out: one box on the device, written also for no positions. O(n), two
/// kernels; no scratch is allocated once the workspace has been used for as many positions. Enqueued on launch.stream,
/// capturable; the same bits for any launch.
[[nodiscard]] inline cudaError_t bounds(std::span<const glm::vec3> positions, Box* out, BoundsWorkspace& workspace,
                                        Launch launch = {}) {
  const std::uint64_t n = positions.size();
  std::uint64_t blocks = detail::blocks_for(n, launch.block_threads);
  if (blocks > detail::most_bounds_blocks) blocks = detail::most_bounds_blocks;
  PGL_CUDA_TRY(workspace.memory.reserve(detail::most_bounds_blocks * sizeof(Box)));
  Box* const boxes = workspace.memory.at<Box>();
  PGL_CUDA_TRY(detail::run(detail::bounds_of_blocks_kernel<>, blocks, 0, launch, positions.data(), n, boxes));
  return detail::run(detail::merge_boxes_kernel<>, 1, 0, launch, boxes, blocks, out);
}

/// Writes each object's world box, as pgl::host::object_bounds does.
///
/// objects, mesh_boxes: in, on the device. out: on the device, one box per object, overlapping neither.
/// Preconditions: those of the host; that every object's mesh is below mesh_boxes.size() is not checked here.
/// O(objects), one kernel, no scratch. Enqueued on launch.stream, capturable; the same bits for any launch.
[[nodiscard]] inline cudaError_t object_bounds(std::span<const Object> objects, std::span<const Box> mesh_boxes,
                                               std::span<Box> out, Launch launch = {}) {
  PGL_ASSERT(out.size() == objects.size());
  const std::uint64_t n = objects.size();
  return detail::run(detail::object_bounds_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     objects.data(), n, mesh_boxes.data(), out.data());
}

}  // namespace pgl::cuda
