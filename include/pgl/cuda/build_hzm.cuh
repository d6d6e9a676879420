// SPDX-License-Identifier: MIT
// The hierarchical-Z map of a depth map, on the GPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/build_hzm.hpp"
#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/tiles.cuh"

namespace pgl::cuda {

namespace detail {

/// The levels that one launch adds: a block takes a tile of 64 x 64 texels up to one.
inline constexpr unsigned hzm_rise = 6;
/// The threads that a tile keeps busy: each takes 4 x 4 texels.
inline constexpr unsigned most_hzm_threads = 256;

/// The level that a launch reads, and those that it writes.
struct HzmRise {
  Depth* texels = nullptr;
  unsigned levels = 0;  ///< of `level` that there are, the one that is read among them
  HzmLevel level[hzm_rise + 1] = {};
  unsigned tiles_in_row = 0;
  bool wide_reads = false;   ///< rows of the level that is read begin at multiples of 16 bytes
  bool wide_writes = false;  ///< rows of the first that is written begin at multiples of 8 bytes

  __device__ void put(unsigned l, unsigned x, unsigned y, Depth depth) const {
    if (l < levels && x < level[l].width && y < level[l].height)
      texels[level[l].offset + std::uint64_t{y} * level[l].width + x] = depth;
  }
};

/// Bits 0, 2, 4 and 6: how far right the i-th of 16 x 16 places lies where each four make a square, each four of those
/// a larger one, and so on; i >> 1 tells how far up.
__device__ inline unsigned even_bits(unsigned i) {
  return (i & 1) | (i >> 1 & 2) | (i >> 2 & 4) | (i >> 3 & 8);
}

/// The farthest depth of 4 or 16 neighbouring lanes, each of which holds a texel: of what one or two levels up is one.
__device__ inline Depth farthest_of(Depth depth, int lanes) {
  for (int distance = 1; distance < lanes; distance *= 2)
    depth = farther(depth, __shfl_xor_sync(whole_warp, depth, distance));
  return depth;
}

/// Reads 4 x 4 texels from (4 x, 4 y) on, 0 where there are none, writes the 2 x 2 above them, and returns the one
/// above those.
__device__ inline Depth rise_by_two(const HzmRise& rise, unsigned x, unsigned y) {
  const HzmLevel& from = rise.level[0];
  const Depth* in = rise.texels + from.offset + std::uint64_t{4 * y} * from.width + 4 * x;
  Depth t[4][4];
#pragma unroll
  for (unsigned r = 0; r < 4; ++r) {
    if (rise.wide_reads && 4 * x + 3 < from.width && 4 * y + r < from.height) {
      const uint4 four = *reinterpret_cast<const uint4*>(in + std::uint64_t{r} * from.width);
      t[r][0] = four.x;
      t[r][1] = four.y;
      t[r][2] = four.z;
      t[r][3] = four.w;
    } else {
#pragma unroll
      for (unsigned c = 0; c < 4; ++c) {
        const bool exists = 4 * x + c < from.width && 4 * y + r < from.height;
        t[r][c] = exists ? in[std::uint64_t{r} * from.width + c] : 0;
      }
    }
  }
  Depth above[2];
#pragma unroll
  for (unsigned r = 0; r < 2; ++r) {
    const Depth left = farther(farther(t[2 * r][0], t[2 * r][1]), farther(t[2 * r + 1][0], t[2 * r + 1][1]));
    const Depth right = farther(farther(t[2 * r][2], t[2 * r][3]), farther(t[2 * r + 1][2], t[2 * r + 1][3]));
    const HzmLevel& to = rise.level[1];
    if (rise.wide_writes && 2 * x + 1 < to.width && 2 * y + r < to.height) {
      *reinterpret_cast<uint2*>(rise.texels + to.offset + std::uint64_t{2 * y + r} * to.width + 2 * x) =
          make_uint2(left, right);
    } else {
      rise.put(1, 2 * x, 2 * y + r, left);
      rise.put(1, 2 * x + 1, 2 * y + r, right);
    }
    above[r] = farther(left, right);
  }
  return farther(above[0], above[1]);
}

template <class = void>
__global__ void __launch_bounds__(most_hzm_threads) build_hzm_kernel(const __grid_constant__ HzmRise rise) {
  __shared__ Depth level_4[16];
  const unsigned tile_x = blockIdx.x % rise.tiles_in_row, tile_y = blockIdx.x / rise.tiles_in_row;
  for (unsigned i = threadIdx.x; i < 256; i += blockDim.x) {  // by whole warps
    const unsigned x = 16 * tile_x + even_bits(i), y = 16 * tile_y + even_bits(i >> 1);
    Depth depth = rise_by_two(rise, x, y);
    rise.put(2, x, y, depth);
    depth = farthest_of(depth, 4);
    if (i % 4 == 0) rise.put(3, x / 2, y / 2, depth);
    depth = farther(depth, __shfl_xor_sync(whole_warp, depth, 4));
    depth = farther(depth, __shfl_xor_sync(whole_warp, depth, 8));
    if (i % 16 == 0) {
      rise.put(4, x / 4, y / 4, depth);
      level_4[i / 16] = depth;
    }
  }
  __syncthreads();
  if (threadIdx.x >= 32) return;
  const unsigned i = threadIdx.x;
  Depth depth = farthest_of(i < 16 ? level_4[i] : 0, 4);
  if (i < 16 && i % 4 == 0) rise.put(5, 2 * tile_x + even_bits(i) / 2, 2 * tile_y + even_bits(i >> 1) / 2, depth);
  depth = farthest_of(i < 16 ? level_4[i] : 0, 16);
  if (i == 0) rise.put(6, tile_x, tile_y, depth);
}

}  // namespace detail

/// Fills in the levels above the depths, as pgl::host::build_hzm does.
///
/// texels: in and out, on the device; reads and writes by 16 and 8 bytes where its address and the widths of the levels
/// allow. O(texels), one kernel for every six levels or part of six, so at most three; no scratch; it runs on blocks of
/// at most 256 threads. Enqueued on launch.stream, capturable; the same for any launch.
[[nodiscard]] inline cudaError_t build_hzm(const DepthMap& size, std::span<Depth> texels, Launch launch = {}) {
  PGL_ASSERT(texels.size() == hzm_texels(size));
  launch.block_threads = std::min(launch.block_threads, detail::most_hzm_threads);
  const std::uint32_t levels = hzm_levels(size);
  for (std::uint32_t first = 0; first + 1 < levels; first += detail::hzm_rise) {
    detail::HzmRise rise;
    rise.texels = texels.data();
    rise.levels = std::min(detail::hzm_rise + 1, levels - first);
    for (unsigned l = 0; l < rise.levels; ++l) rise.level[l] = hzm_level(size, first + l);
    const HzmLevel &from = rise.level[0], &to = rise.level[1];
    const auto rows_begin_at = [&](const HzmLevel& level, std::uint32_t wide) {
      return level.width % wide == 0 &&
             reinterpret_cast<std::uintptr_t>(texels.data() + level.offset) % (wide * sizeof(Depth)) == 0;
    };
    rise.wide_reads = rows_begin_at(from, 4);
    rise.wide_writes = rows_begin_at(to, 2);
    rise.tiles_in_row = (from.width + 63) / 64;
    const std::uint64_t tiles = std::uint64_t{rise.tiles_in_row} * ((from.height + 63) / 64);
    PGL_CUDA_TRY(detail::run(detail::build_hzm_kernel<>, tiles, 0, launch, rise));
  }
  return cudaSuccess;
}

}  // namespace pgl::cuda
