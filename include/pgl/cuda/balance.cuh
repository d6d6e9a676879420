// SPDX-License-Identifier: MIT
// Cuts the picture into tiles, one for each GPU, that share out what the objects cost; on the GPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/balance.hpp"
#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/project.hpp"

namespace pgl::cuda {

/// Scratch memory of balance: 16 bytes for each bin along the picture's longer side (or for each of options.bins) and
/// split, of which there are N - 1 or a few more, and with more than two GPUs 8 bytes for each object. Reuse it from
/// frame to frame: it grows to the largest frame and stays.
struct BalanceWorkspace {
  Buffer memory;
};

namespace detail {

using BalanceSum = unsigned long long;  // the 64-bit integer of the atomics

inline constexpr unsigned most_level_nodes = most_tiles / 2;

/// The most sums of a level that a block adds up in its shared memory, 4 bytes each.
inline constexpr std::uint64_t most_shared_sums = 11264;

/// The fewest objects that a block adds up: what it costs to add its sums to all is no more than the objects do.
inline constexpr std::uint64_t least_block_objects = 2048;

/// One level of the tree, as its kernels read it. All nodes but the root, and all sums, are zero before.
struct BalanceLevel {
  TileNode root;        ///< the only node of depth 0
  TileNode* nodes;      ///< of this level, 2^depth; those that are cut no more have a count of 0
  TileNode* children;   ///< of nodes[k]: [2 k] and [2 k + 1]
  std::uint64_t* sums;  ///< for each node those of its bins, by first and then by last bin, in this much memory:
  std::uint64_t sums_of_node;
  unsigned depth;
  BalanceOptions options;

  __device__ TileNode node(unsigned k) const { return depth == 0 ? root : nodes[k]; }
  __device__ std::uint64_t* sums_of(unsigned k) const { return sums + k * sums_of_node; }
};

/// Each object's load and pixels. At depth 0 the pixels are those of its rectangle, and are kept for the other levels
/// where `touched` is not null.
struct BalanceObjects {
  const ScreenBox* rectangles;
  const std::uint32_t* loads;
  std::uint64_t n;
  std::uint32_t width;
  std::uint32_t height;
  TouchedPixels* touched;

  /// The pixels of an object that is drawn somewhere; none of the others.
  __device__ TouchedPixels pixels(std::uint64_t i, unsigned depth) const {
    if (depth > 0) return touched[i];
    TouchedPixels r;
    if (loads[i] > 0) r = touched_pixels(rectangles[i], width, height);
    if (touched != nullptr) touched[i] = r;
    return r;
  }
};

/// The GPUs' weights, passed by value.
struct BalanceWeights {
  std::uint32_t of_gpu[most_tiles];
};

/// The sum of the values of this lane and the ones below it. All 32 lanes call it.
template <class T>
__device__ T sum_of_lanes_up_to_own(T value) {
  for (unsigned distance = 1; distance < 32; distance *= 2) {
    const T below = __shfl_up_sync(0xffffffffu, value, distance);
    if (threadIdx.x % 32 >= distance) value += below;
  }
  return value;
}

/// Adds up the loads of the objects by first and by last bin, for all nodes of a level. A block adds up in shared
/// memory where the sums have room there: the low words, and each carry at once in the sum of all.
template <class = void>
__global__ void __launch_bounds__(1024)
    add_up_loads_kernel(BalanceObjects objects, BalanceLevel level, unsigned shared_sums) {
  extern __shared__ unsigned low_words[];
  __shared__ TileBins bins[most_level_nodes];
  __shared__ unsigned starts[most_level_nodes];  // of the nodes' sums in the shared memory
  __shared__ unsigned sums_of_level;
  const unsigned nodes = 1u << level.depth;
  if (threadIdx.x < most_level_nodes) {
    TileBins own;
    if (threadIdx.x < nodes) {
      const TileNode node = level.node(threadIdx.x);
      if (node.count > 0) own = tile_bins(node, level.options);
    }
    const unsigned sums = 2 * own.count, end = sum_of_lanes_up_to_own(sums);
    bins[threadIdx.x] = own;
    starts[threadIdx.x] = end - sums;
    if (threadIdx.x == most_level_nodes - 1) sums_of_level = end;
  }
  __syncthreads();
  const bool shares = sums_of_level <= shared_sums;
  if (shares) {
    for (unsigned s = threadIdx.x; s < sums_of_level; s += blockDim.x) low_words[s] = 0;
    __syncthreads();
  }
  const auto add = [&](unsigned k, unsigned sum, unsigned load) {
    auto* const of_all = reinterpret_cast<BalanceSum*>(level.sums_of(k) + sum);
    if (shares) {
      const unsigned low = atomicAdd(&low_words[starts[k] + sum], load);
      if (low + load < low) atomicAdd(of_all, BalanceSum{1} << 32);
    } else {
      atomicAdd(of_all, BalanceSum{load});
    }
  };

  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < objects.n; i += stride) {
    const TouchedPixels pixels = objects.pixels(i, level.depth);
    if (pixels.x0 == pixels.x1) continue;
    const unsigned load = objects.loads[i];
    for (unsigned k = 0; k < nodes; ++k) {
      std::uint32_t first = 0, last = 0;
      if (!touched_bins(pixels, bins[k], first, last)) continue;
      add(k, first, load);
      add(k, bins[k].count + last, load);
    }
  }

  if (!shares) return;
  __syncthreads();
  for (unsigned k = 0; k < nodes; ++k)
    for (unsigned s = threadIdx.x; s < 2 * bins[k].count; s += blockDim.x) {
      const unsigned low = low_words[starts[k] + s];
      if (low > 0) atomicAdd(reinterpret_cast<BalanceSum*>(level.sums_of(k) + s), BalanceSum{low});
    }
}

/// Turns sums into the sums of those before each, and returns the sum of all; the threads of a block together, between
/// whose other uses of of_warp this synchronises. The sums are there for all of them.
__device__ inline std::uint64_t sums_before(std::uint64_t* sums, unsigned count, std::uint64_t (&of_warp)[32]) {
  const unsigned each = (count + blockDim.x - 1) / blockDim.x;
  const unsigned begin = min(threadIdx.x * each, count), end = min(begin + each, count);
  std::uint64_t own = 0;
  for (unsigned s = begin; s < end; ++s) own += sums[s];
  const std::uint64_t up_to = sum_of_lanes_up_to_own(own);
  __syncthreads();
  if (threadIdx.x % 32 == 31) of_warp[threadIdx.x / 32] = up_to;
  __syncthreads();
  std::uint64_t running = up_to - own, total = 0;
  for (unsigned warp = 0; warp < blockDim.x / 32; ++warp) {
    if (warp == threadIdx.x / 32) running += total;
    total += of_warp[warp];
  }
  for (unsigned s = begin; s < end; ++s) {
    const std::uint64_t value = sums[s];
    sums[s] = running;
    running += value;
  }
  __syncthreads();
  return total;
}

/// The better one of two borders, 0: none.
__device__ inline unsigned better_border(const LoadSums& sums, const SplitLoads& weights, unsigned a, unsigned b) {
  if (a == 0 || b == 0) return a + b;
  return is_better(split_cost(sums.at(a), weights), a, split_cost(sums.at(b), weights), b) ? a : b;
}

/// The best border of all, for the first thread of a block, whose threads call it together.
__device__ inline unsigned best_border(const LoadSums& sums, unsigned bins, const SplitLoads& weights,
                                       unsigned (&of_warp)[32]) {
  unsigned best = 0;
  SplitCost best_cost;
  for (unsigned k = 1 + threadIdx.x; k < bins; k += blockDim.x) {
    const SplitCost cost = split_cost(sums.at(k), weights);
    if (best != 0 && !is_better(cost, k, best_cost, best)) continue;
    best = k;
    best_cost = cost;
  }
  for (unsigned distance = 16; distance > 0; distance /= 2)
    best = better_border(sums, weights, best, __shfl_down_sync(0xffffffffu, best, distance));
  if (threadIdx.x % 32 == 0) of_warp[threadIdx.x / 32] = best;
  __syncthreads();
  if (threadIdx.x == 0)
    for (unsigned warp = 1; warp < blockDim.x / 32; ++warp) best = better_border(sums, weights, best, of_warp[warp]);
  return best;
}

/// Cuts the nodes of a level, a block each.
template <class = void>
__global__ void __launch_bounds__(1024)
    cut_nodes_kernel(BalanceLevel level, const __grid_constant__ BalanceWeights weights, Tile* tiles,
                     std::uint64_t* tile_loads) {
  __shared__ std::uint64_t sum_of_warp[32];
  __shared__ unsigned border_of_warp[32];
  const TileNode node = level.node(blockIdx.x);
  if (node.count == 0) return;
  const TileBins bins = tile_bins(node, level.options);
  std::uint64_t* const by_first = level.sums_of(blockIdx.x);
  std::uint64_t* const by_last = by_first + bins.count;
  LoadSums sums;
  sums.total = sums_before(by_first, bins.count, sum_of_warp);
  sums_before(by_last, bins.count, sum_of_warp);
  sums.first_below = by_first;
  sums.last_below = by_last;

  const auto finish = [&](const TileNode& part, unsigned child, std::uint64_t load) {
    if (part.count > 1) {
      level.children[2 * blockIdx.x + child] = part;
    } else {
      tiles[part.first] = part.tile;
      tile_loads[part.first] = load;
    }
  };
  if (node.count == 1) {
    if (threadIdx.x == 0) finish(node, 0, sums.total);
    return;
  }
  const SplitLoads node_weights = split_weights(node, weights.of_gpu);
  const bool searches = sums.total > 0 && bins.count > 1;
  unsigned border = 0;
  if (searches && level.options.policy == BalancePolicy::histogram)
    border = best_border(sums, bins.count, node_weights, border_of_warp);
  if (threadIdx.x > 0) return;
  if (searches && level.options.policy == BalancePolicy::bisection)
    border = bisected_border(sums, bins.count, node_weights, level.options.threshold);
  const SplitLoads split = border > 0 ? sums.at(border) : SplitLoads{sums.total, 0};
  const std::uint32_t at = border > 0 ? bin_begin(bins, border) : unloaded_cut(bins, node_weights);
  const TileHalves parts = halves(node, bins, at);
  finish(parts.left, 0, split.left);
  finish(parts.right, 1, split.right);
}

/// loads may be null.
template <class = void>
__global__ void __launch_bounds__(1024) in_tile_kernel(const ScreenBox* rectangles, const std::uint32_t* loads,
                                                       std::uint64_t n, const Tile* tile, std::uint8_t* flags) {
  const Tile own = *tile;
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride)
    flags[i] = is_in_tile(rectangles[i], loads == nullptr ? 1 : loads[i], own) ? 1 : 0;
}

}  // namespace detail

/// Cuts the picture into tiles, one for each GPU, that share out what the objects cost, as pgl::host::balance does.
///
/// rectangles, loads: in, on the device. weights: in, host memory. tiles, tile_loads: out, on the device, overlapping
/// nothing else. Weights and options are read before this returns: a captured graph keeps those that it was captured
/// with. Preconditions: those of the host.
///
/// ceil(log2 N) passes over the objects, two kernels each, at least one; of an object only its pixels and load are read
/// after the first. O(n N). No round trip to the host; nothing is allocated once the workspace has been used for as
/// many objects, GPUs and bins. Enqueued on launch.stream, capturable; the same for any launch and GPU.
[[nodiscard]] inline cudaError_t balance(std::span<const ScreenBox> rectangles, std::span<const std::uint32_t> loads,
                                         std::uint32_t width, std::uint32_t height,
                                         std::span<const std::uint32_t> weights, const BalanceOptions& options,
                                         BalanceWorkspace& workspace, std::span<Tile> tiles,
                                         std::span<std::uint64_t> tile_loads, Launch launch = {}) {
  const std::uint64_t n = rectangles.size();
  PGL_ASSERT(is_valid(options));
  PGL_ASSERT(n <= (std::uint64_t{1} << 31) && loads.size() == n);
  PGL_ASSERT(width >= 1 && width <= most_picture_side && height >= 1 && height <= most_picture_side);
  PGL_ASSERT(!weights.empty() && weights.size() <= most_tiles);
  PGL_ASSERT(tiles.size() == weights.size() && tile_loads.size() == weights.size());
  PGL_ASSERT(std::find(weights.begin(), weights.end(), 0u) == weights.end());
  unsigned levels = 1;
  while ((std::size_t{1} << levels) < weights.size()) ++levels;
  const std::uint64_t all_nodes = (std::uint64_t{1} << levels) - 1;
  const std::uint32_t longer = std::max(width, height);
  const std::uint64_t sums_of_node = 2 * (options.bins == 0 ? longer : std::min(longer, options.bins));

  const auto lay_out_scratch = [&](detail::Parts& parts, TileNode*& nodes, std::uint64_t*& sums,
                                   TouchedPixels*& touched) {
    nodes = parts.take<TileNode>(all_nodes);
    sums = parts.take<std::uint64_t>(all_nodes * sums_of_node);
    const std::size_t zeros = parts.size();
    touched = parts.take<TouchedPixels>(levels > 1 ? n : 0);
    return zeros;
  };
  TileNode* nodes = nullptr;
  std::uint64_t* sums = nullptr;
  TouchedPixels* touched = nullptr;
  detail::Parts sizes;
  const std::size_t zeros = lay_out_scratch(sizes, nodes, sums, touched);
  PGL_CUDA_TRY(workspace.memory.reserve(sizes.size()));
  detail::Parts parts(workspace.memory.at<void>());
  lay_out_scratch(parts, nodes, sums, touched);
  PGL_CUDA_TRY(cudaMemsetAsync(workspace.memory.at<void>(), 0, zeros, launch.stream));

  detail::BalanceWeights by_value{};
  std::copy(weights.begin(), weights.end(), by_value.of_gpu);
  const detail::BalanceObjects objects{
      rectangles.data(), loads.data(), n, width, height, levels > 1 ? touched : nullptr};
  for (unsigned depth = 0; depth < levels; ++depth) {
    const std::uint64_t level_nodes = std::uint64_t{1} << depth, before = level_nodes - 1;
    const detail::BalanceLevel level{{{0, 0, width, height}, 0, static_cast<std::uint32_t>(weights.size())},
                                     nodes + before,
                                     nodes + before + level_nodes,
                                     sums + before * sums_of_node,
                                     sums_of_node,
                                     depth,
                                     options};
    const std::uint64_t shared_sums = std::min(detail::most_shared_sums, level_nodes * sums_of_node);
    const std::size_t shared_bytes = shared_sums * sizeof(unsigned);
    std::uint64_t blocks = 0;
    PGL_CUDA_TRY(detail::resident_blocks(detail::add_up_loads_kernel<>, shared_bytes, launch, blocks));
    blocks = std::min({blocks, detail::blocks_for(n, launch.block_threads), n / detail::least_block_objects + 1});
    PGL_CUDA_TRY(detail::run(detail::add_up_loads_kernel<>, blocks, shared_bytes, launch, objects, level,
                             static_cast<unsigned>(shared_sums)));
    PGL_CUDA_TRY(detail::run(detail::cut_nodes_kernel<>, level_nodes, 0, launch, level, by_value, tiles.data(),
                             tile_loads.data()));
  }
  return cudaSuccess;
}

/// Marks the objects that a GPU draws in its tile, as pgl::host::in_tile does.
///
/// rectangles, loads, flags: on the device. tile: one of those that balance wrote, on the device.
/// O(n), one kernel, no scratch. Enqueued on launch.stream, capturable; the same for any launch.
[[nodiscard]] inline cudaError_t in_tile(std::span<const ScreenBox> rectangles, std::span<const std::uint32_t> loads,
                                         const Tile* tile, std::span<std::uint8_t> flags, Launch launch = {}) {
  PGL_ASSERT(flags.size() == rectangles.size() && (loads.empty() || loads.size() == rectangles.size()));
  const std::uint64_t n = rectangles.size();
  return detail::run(detail::in_tile_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     rectangles.data(), loads.empty() ? nullptr : loads.data(), n, tile, flags.data());
}

}  // namespace pgl::cuda
