// SPDX-License-Identifier: MIT
// Shares a vertex budget among the objects of a frame, and lays out what was selected; on the GPU.
#pragma once

#include <cooperative_groups.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/prefix_sum.cuh"
#include "pgl/distribute_budget.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

using pgl::BudgetTotals;

/// Scratch memory of distribute_budget: 4 bytes for each object and 170 KiB. Reuse it from frame to frame: it grows to
/// the largest frame and stays.
struct BudgetWorkspace {
  Buffer memory;
};

namespace detail {

using BudgetSum = unsigned long long;  // the 64-bit integer of the atomics

inline constexpr int cut_bits = 10;
inline constexpr unsigned cut_buckets = 1u << cut_bits;
inline constexpr int cut_rounds = 7;  // 64 bits of a key, ten at a time
static_assert(cut_bits * cut_rounds >= 64 && cut_buckets == 32 * 32);

inline constexpr unsigned level_candidates = 6;
inline constexpr int level_rounds = [] {
  int rounds = 0;
  for (std::uint32_t range = budget_levels; range > 1; ++rounds) range = range / (level_candidates + 1) + 1;
  return rounds;
}();

/// What the blocks learn of each other in one search for a cut: for every round the sums and sizes of its buckets.
struct CutTables {
  BudgetSum sums[cut_rounds][cut_buckets];
  unsigned sizes[cut_rounds][cut_buckets];
  BudgetSum key;
};

/// What the blocks learn of each other. All zero before the kernel starts.
struct BudgetTables {
  BudgetSum extreme_keys[2];  // the largest, and the largest complement
  BudgetSum share_sum;
  BudgetSum shared_vertices;
  BudgetSum level_sums[level_rounds][level_candidates];
  CutTables reduction;
  CutTables lift;
};

/// What the threads of a block share.
struct BudgetShared {
  BudgetSum of_warp[32][level_candidates];
  BudgetSum sums[cut_buckets];
  unsigned low[cut_buckets];  // the sums of one round: the low words and what they carry
  unsigned high[cut_buckets];
  unsigned sizes[cut_buckets];
  unsigned bucket;
  BudgetSum before;
};

/// n objects in the order of their weights.
struct WeighedObjects {
  std::uint64_t n;
  float* weights;

  __device__ std::uint64_t key(std::uint64_t i) const { return weight_key(weights[i], static_cast<std::uint32_t>(i)); }

  /// Calls body(i) for this thread's objects, the same ones each time: what one pass wrote of an object, the next reads
  /// in the same thread.
  template <class Body>
  __device__ void for_own_objects(Body&& body) const {
    const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
    for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) body(i);
  }
};

/// The frame; the weights are scratch.
struct BudgetFrame : WeighedObjects {
  const float* areas;
  const float* depths;
  const std::uint32_t* min_vertices;
  const std::uint32_t* max_vertices;
  std::uint32_t* counts;
};

struct AddUp {
  static __device__ BudgetSum combine(BudgetSum a, BudgetSum b) { return a + b; }
  static __device__ void publish(BudgetSum* to, BudgetSum value) {
    if (value > 0) atomicAdd(to, value);
  }
};
struct KeepMost {
  static __device__ BudgetSum combine(BudgetSum a, BudgetSum b) { return a > b ? a : b; }
  static __device__ void publish(BudgetSum* to, BudgetSum value) { atomicMax(to, value); }
};

/// Combines the values of all threads of the grid into the zeros at `to`. They are there after the next
/// synchronisation of the grid, before which a block may not call this again.
template <class Operation, unsigned count>
__device__ void publish(BudgetSum (&values)[count], BudgetSum* to, BudgetShared& shared) {
  static_assert(count <= level_candidates && count <= 32);
  for (unsigned k = 0; k < count; ++k) {
    for (int distance = 16; distance > 0; distance /= 2)
      values[k] = Operation::combine(values[k], __shfl_down_sync(0xffffffffu, values[k], distance));
    if (threadIdx.x % 32 == 0) shared.of_warp[threadIdx.x / 32][k] = values[k];
  }
  __syncthreads();
  if (threadIdx.x < count) {
    BudgetSum of_block = shared.of_warp[0][threadIdx.x];
    for (unsigned warp = 1; warp < blockDim.x / 32; ++warp)
      of_block = Operation::combine(of_block, shared.of_warp[warp][threadIdx.x]);
    Operation::publish(to + threadIdx.x, of_block);
  }
}

/// The sum of the values of this lane and the ones below it. All 32 lanes call it.
__device__ inline BudgetSum sum_up_to_lane(BudgetSum value) {
  const unsigned lane = threadIdx.x % 32;
  for (unsigned distance = 1; distance < 32; distance *= 2) {
    const BudgetSum below = __shfl_up_sync(0xffffffffu, value, distance);
    if (lane >= distance) value += below;
  }
  return value;
}

/// Finds the first bucket, from the last one down, with which the running sum from `before` on exceeds the limit, and
/// the sum before it: in shared.bucket and shared.before; cut_buckets and the sum of all where there is none. One warp
/// calls it, with shared.sums filled.
__device__ inline void find_bucket(std::uint64_t before, std::uint64_t limit, BudgetShared& shared) {
  const unsigned lane = threadIdx.x % 32;
  BudgetSum own = 0;  // of 32 buckets, each lane beginning at another one, for the banks
  for (unsigned k = 0; k < 32; ++k) own += shared.sums[cut_buckets - 1 - (32 * lane + (k + lane) % 32)];
  BudgetSum up_to = sum_up_to_lane(own);
  unsigned beyond = __ballot_sync(0xffffffffu, before + up_to > limit);
  if (beyond == 0) {
    if (lane == 31) {
      shared.bucket = cut_buckets;
      shared.before = before + up_to;
    }
    return;
  }
  const int part = __ffs(static_cast<int>(beyond)) - 1;
  before += __shfl_sync(0xffffffffu, up_to - own, part);
  const unsigned bucket = cut_buckets - 1 - (32 * static_cast<unsigned>(part) + lane);
  own = shared.sums[bucket];
  up_to = sum_up_to_lane(own);
  beyond = __ballot_sync(0xffffffffu, before + up_to > limit);
  if (static_cast<int>(lane) == __ffs(static_cast<int>(beyond)) - 1) {
    shared.bucket = bucket;
    shared.before = before + (up_to - own);
  }
}

/// Finds where the running sum of value(i), a 32 or 64-bit integer, heaviest object first, over the keys in [least,
/// most] first exceeds `limit`, as the host's find_budget_cut: the range of keys is cut into 1024 buckets, then that of
/// the bucket with the cut, until that holds one object. Twice or three times as a rule, at most seven times. All
/// threads of the grid call it, and all get the same.
template <class Value>
__device__ BudgetCut find_budget_cut(const cooperative_groups::grid_group& grid, const WeighedObjects& frame,
                                     std::uint64_t least, std::uint64_t most, std::uint64_t limit, CutTables& tables,
                                     BudgetShared& shared, Value&& value) {
  BudgetCut cut;
  if (least > most) return cut;
  for (int round = 0;; ++round) {
    const int width = 64 - __clzll(static_cast<long long>(most - least));
    const int shift = width > cut_bits ? width - cut_bits : 0;
    const bool sized = round > 0;  // few objects are left only from the second round on
    for (unsigned b = threadIdx.x; b < cut_buckets; b += blockDim.x)
      shared.low[b] = shared.high[b] = shared.sizes[b] = 0;
    __syncthreads();
    frame.for_own_objects([&](std::uint64_t i) {
      const std::uint64_t key = frame.key(i);
      if (key < least || key > most) return;
      const auto v = value(i);
      if (v == 0) return;  // never at the cut
      const auto b = static_cast<unsigned>((key - least) >> shift);
      const auto v_low = static_cast<unsigned>(v);
      const unsigned low = atomicAdd(&shared.low[b], v_low);
      unsigned above = low + v_low < low ? 1u : 0u;
      if constexpr (sizeof(v) > sizeof(v_low)) above += static_cast<unsigned>(v >> 32);
      if (above != 0) atomicAdd(&shared.high[b], above);
      if (sized) atomicAdd(&shared.sizes[b], 1u);
    });
    __syncthreads();
    for (unsigned b = threadIdx.x; b < cut_buckets; b += blockDim.x) {
      const BudgetSum sum = static_cast<BudgetSum>(shared.high[b]) << 32 | shared.low[b];
      if (sum > 0) atomicAdd(&tables.sums[round][b], sum);
      if (shared.sizes[b] > 0) atomicAdd(&tables.sizes[round][b], shared.sizes[b]);
    }
    grid.sync();

    for (unsigned b = threadIdx.x; b < cut_buckets; b += blockDim.x) shared.sums[b] = tables.sums[round][b];
    __syncthreads();
    if (threadIdx.x < 32) find_bucket(cut.before, limit, shared);
    __syncthreads();
    cut.before = shared.before;
    if (shared.bucket == cut_buckets) return cut;  // in the first round, if ever
    const unsigned size = tables.sizes[round][shared.bucket];
    least += static_cast<std::uint64_t>(shared.bucket) << shift;
    const std::uint64_t last = (std::uint64_t{1} << shift) - 1;
    if (most - least > last) most = least + last;
    if (least >> 32 == most >> 32) {  // one weight: its keys go down to that of the last object
      const std::uint64_t lowest = weight_key(weight_of_key(least), static_cast<std::uint32_t>(frame.n - 1));
      if (least < lowest) least = lowest;
    }
    if (least == most) {
      cut.key = least;
      return cut;
    }
    if (size == 1) break;
  }
  frame.for_own_objects([&](std::uint64_t i) {
    const std::uint64_t key = frame.key(i);
    if (key >= least && key <= most && value(i) > 0) tables.key = key;
  });
  grid.sync();
  cut.key = tables.key;
  return cut;
}

/// Finds the highest level of the grid at which the sum of the counts is at most the budget, 0 where it is so at none,
/// from the sums at six levels at a time. In the frame's counts are the shares.
__device__ inline std::uint64_t find_budget_level(const cooperative_groups::grid_group& grid, const BudgetFrame& frame,
                                                  std::uint64_t budget, BudgetTables& tables, BudgetShared& shared) {
  std::uint32_t low = 0;
  std::uint32_t high = budget_levels;
  for (int round = 0; high - low > 1; ++round) {
    const auto candidate = [low, range = high - low](unsigned k) {
      return low + range * (k + 1) / (level_candidates + 1);
    };
    std::uint64_t level[level_candidates];
    BudgetSum sums[level_candidates];
    for (unsigned k = 0; k < level_candidates; ++k) {
      level[k] = budget_level(candidate(k));
      sums[k] = 0;
    }
    frame.for_own_objects([&](std::uint64_t i) {
      if (frame.key(i) < least_eligible_key()) return;
      const std::uint32_t share = frame.counts[i], least = frame.min_vertices[i], most = frame.max_vertices[i];
      for (unsigned k = 0; k < level_candidates; ++k) sums[k] += level_vertices(level[k], share, least, most);
    });
    publish<AddUp>(sums, tables.level_sums[round], shared);
    grid.sync();
    for (unsigned k = level_candidates; k-- > 0;) {
      const std::uint32_t middle = candidate(k);
      if (tables.level_sums[round][k] <= budget) {
        low = middle;
        break;
      }
      high = middle;
    }
  }
  return budget_level(low);
}

/// totals may be null.
template <class = void>
__global__ void __launch_bounds__(1024)
    distribute_budget_kernel(BudgetFrame frame, BudgetOptions options, BudgetTables* tables, BudgetTotals* totals) {
  __shared__ BudgetShared shared;
  const cooperative_groups::grid_group grid = cooperative_groups::this_grid();
  if (totals != nullptr && blockIdx.x == 0 && threadIdx.x == 0) *totals = BudgetTotals{};

  // Weights, and the range of the keys of the objects that take part.
  BudgetSum extreme_keys[2] = {0, 0};
  frame.for_own_objects([&](std::uint64_t i) {
    PGL_ASSERT(frame.min_vertices[i] <= frame.max_vertices[i]);
    frame.weights[i] =
        log_weight(frame.areas[i], frame.depths[i], frame.min_vertices[i], frame.max_vertices[i], options);
    const std::uint64_t key = frame.key(i);
    if (key < lift_from(options)) return;
    extreme_keys[0] = KeepMost::combine(extreme_keys[0], key);
    extreme_keys[1] = KeepMost::combine(extreme_keys[1], ~key);
  });
  publish<KeepMost>(extreme_keys, tables->extreme_keys, shared);
  grid.sync();
  const std::uint64_t most = tables->extreme_keys[0], least = ~tables->extreme_keys[1];
  const float heaviest = weight_of_key(most);

  // Shares (for a moment counts holds these; 0 where not eligible), then clamped shares.
  BudgetSum share_sum[1] = {0};
  frame.for_own_objects([&](std::uint64_t i) {
    share_sum[0] += frame.counts[i] = share_weight(frame.weights[i], heaviest, options.alpha);
  });
  publish<AddUp>(share_sum, &tables->share_sum, shared);
  grid.sync();
  const bool fair = options.policy == BudgetPolicy::fair;
  const std::uint64_t level = fair ? find_budget_level(grid, frame, options.budget, *tables, shared) : 0;
  const std::uint64_t shares = tables->share_sum;
  BudgetSum shared_sum[1] = {0};
  frame.for_own_objects([&](std::uint64_t i) {
    if (frame.key(i) < least_eligible_key()) return;
    const std::uint32_t share = frame.counts[i], fewest = frame.min_vertices[i], all = frame.max_vertices[i];
    shared_sum[0] += frame.counts[i] =
        fair ? level_vertices(level, share, fewest, all) : shared_vertices(share, shares, fewest, all, options);
  });
  publish<AddUp>(shared_sum, &tables->shared_vertices, shared);
  grid.sync();

  BudgetPlan plan;
  const std::uint64_t shared_vertices_in_all = tables->shared_vertices;
  if (shared_vertices_in_all <= options.budget) {
    plan.left = options.budget - shared_vertices_in_all;
  } else if (options.budget == 0) {
    plan.kept_from = ~std::uint64_t{0};
  } else {
    const BudgetCut cut = find_budget_cut(grid, frame, least, most, reduction_limit(options), tables->reduction, shared,
                                          [&](std::uint64_t i) { return frame.counts[i]; });
    plan = plan_reduction(cut, frame.min_vertices[object_of_key(cut.key)], options);
  }
  const bool lifts = plan.left > 0;
  BudgetCut lift;
  if (lifts)
    lift = find_budget_cut(grid, frame, least, most, plan.left, tables->lift, shared,
                           [&](std::uint64_t i) { return frame.max_vertices[i] - frame.counts[i]; });

  BudgetSum given_out[2] = {0, 0};  // as in BudgetTotals
  frame.for_own_objects([&](std::uint64_t i) {
    const std::uint64_t key = frame.key(i);
    if (key < lift_from(options)) return;
    // The count at the cut matters to the object at the cut alone, so that each object takes its own for it.
    const std::uint32_t count = frame.counts[i];
    const BudgetPlan own = lifts ? plan_lift(plan, lift, count, options) : plan;
    const std::uint32_t planned = planned_vertices(own, key, count, frame.max_vertices[i]);
    frame.counts[i] = planned;
    given_out[0] += planned > 0 ? 1u : 0u;
    given_out[1] += planned;
  });
  static_assert(offsetof(BudgetTotals, objects) == 0 && offsetof(BudgetTotals, vertices) == sizeof(BudgetSum) &&
                sizeof(BudgetTotals) == 2 * sizeof(BudgetSum));
  if (totals != nullptr) publish<AddUp>(given_out, reinterpret_cast<BudgetSum*>(totals), shared);
}

template <class = void>
__global__ void __launch_bounds__(1024)
    vertex_limits_kernel(const std::uint32_t* mesh_of_object, std::uint64_t n, const Mesh* meshes,
                         const std::uint32_t* map, std::uint32_t min_triangles, std::uint32_t* min_vertices,
                         std::uint32_t* max_vertices) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    const Mesh& mesh = meshes[mesh_of_object[i]];
    min_vertices[i] = minimum_vertices(mesh, map, min_triangles);
    max_vertices[i] = mesh.max_vertices;
  }
}

template <class = void>
__global__ void __launch_bounds__(1024)
    triangle_counts_kernel(const std::uint32_t* counts, std::uint64_t n, const std::uint32_t* mesh_of_object,
                           const Mesh* meshes, const std::uint32_t* map, std::uint32_t* triangle_counts) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    const std::uint32_t count = counts[i];
    const Mesh& mesh = meshes[mesh_of_object[i]];
    PGL_ASSERT(count == 0 || (count >= mesh.min_vertices && count <= mesh.max_vertices));
    triangle_counts[i] = triangles_at(mesh, map, count);
  }
}

}  // namespace detail

/// Fills in how few and how many vertices each object may be drawn with, as pgl::host::vertex_limits does.
///
/// All views are of device memory. O(n log vertices), one kernel, no scratch. Enqueued on launch.stream, capturable;
/// the same for any launch.
[[nodiscard]] inline cudaError_t vertex_limits(std::span<const std::uint32_t> mesh_of_object,
                                               std::span<const Mesh> meshes, std::span<const std::uint32_t> map,
                                               std::uint32_t min_triangles, std::span<std::uint32_t> min_vertices,
                                               std::span<std::uint32_t> max_vertices, Launch launch = {}) {
  PGL_ASSERT(min_vertices.size() == mesh_of_object.size() && max_vertices.size() == mesh_of_object.size());
  const std::uint64_t n = mesh_of_object.size();
  return detail::run(detail::vertex_limits_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     mesh_of_object.data(), n, meshes.data(), map.data(), min_triangles, min_vertices.data(),
                     max_vertices.data());
}

/// Shares options.budget vertices among n objects, as pgl::host::distribute_budget does ([Peng13] Eq 2.3, 2.4, Alg 2).
///
/// areas, depths, min_vertices, max_vertices: in, on the device. counts: out, on the device, overlapping nothing else.
/// totals: out, on the device, what the host's returns, zeros for no objects; null if not wanted. The options are read
/// before this returns: a captured graph keeps those that it was captured with.
/// Preconditions: those of the host; they are checked on the device in debug builds.
///
/// O(n): one cooperative kernel, whose grid synchronises 3 times, and 3 or 4 times more as a rule (at most 8) for each
/// of leaving out and lifting; BudgetPolicy::fair adds 6. The device must support cooperative launches, as all that
/// CUDA 13 knows do. Nothing is allocated once the workspace has been used for as many objects. Enqueued on
/// launch.stream, capturable; the same for any launch and GPU.
[[nodiscard]] inline cudaError_t distribute_budget(std::span<const float> areas, std::span<const float> depths,
                                                   std::span<const std::uint32_t> min_vertices,
                                                   std::span<const std::uint32_t> max_vertices,
                                                   const BudgetOptions& options, BudgetWorkspace& workspace,
                                                   std::span<std::uint32_t> counts, BudgetTotals* totals,
                                                   Launch launch = {}) {
  const std::uint64_t n = areas.size();
  PGL_ASSERT(is_valid(options));
  PGL_ASSERT(n <= (std::uint64_t{1} << 31));
  PGL_ASSERT(depths.size() == n && min_vertices.size() == n && max_vertices.size() == n && counts.size() == n);
  if (n == 0) return totals == nullptr ? cudaSuccess : cudaMemsetAsync(totals, 0, sizeof(*totals), launch.stream);
  const auto lay_out_scratch = [n](detail::Parts& parts, detail::BudgetTables*& tables, float*& weights) {
    tables = parts.take<detail::BudgetTables>(1);
    weights = parts.take<float>(n);
  };
  detail::BudgetTables* tables = nullptr;
  float* weights = nullptr;
  detail::Parts sizes;
  lay_out_scratch(sizes, tables, weights);
  PGL_CUDA_TRY(workspace.memory.reserve(sizes.size()));
  detail::Parts parts(workspace.memory.at<void>());
  lay_out_scratch(parts, tables, weights);
  PGL_CUDA_TRY(cudaMemsetAsync(tables, 0, sizeof(*tables), launch.stream));
  const detail::BudgetFrame frame{{n, weights},        areas.data(),        depths.data(),
                                  min_vertices.data(), max_vertices.data(), counts.data()};
  return detail::run_cooperative(detail::distribute_budget_kernel<>, detail::blocks_for(n, launch.block_threads), 0,
                                 launch, frame, options, tables, totals);
}

/// Lays out a selection, as pgl::host::lay_out does: triangle counts, and where vertices and triangles start.
///
/// All views are of device memory; vertex_offsets and triangle_offsets have n + 1 entries, the last the totals. No out
/// may overlap an in. Preconditions: those of the host; that counts are in their meshes' ranges is checked on the
/// device in debug builds.
/// O(n), one kernel and two scans; nothing is allocated once the workspace has been used for as many objects. Enqueued
/// on launch.stream, capturable; the same for any launch and GPU.
[[nodiscard]] inline cudaError_t lay_out(std::span<const std::uint32_t> counts,
                                         std::span<const std::uint32_t> mesh_of_object, std::span<const Mesh> meshes,
                                         std::span<const std::uint32_t> map, std::span<std::uint32_t> triangle_counts,
                                         std::span<std::uint64_t> vertex_offsets,
                                         std::span<std::uint64_t> triangle_offsets, ScanWorkspace& workspace,
                                         Launch launch = {}) {
  PGL_ASSERT(mesh_of_object.size() == counts.size() && triangle_counts.size() == counts.size());
  const std::uint64_t n = counts.size();
  PGL_CUDA_TRY(detail::run(detail::triangle_counts_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                           counts.data(), n, mesh_of_object.data(), meshes.data(), map.data(), triangle_counts.data()));
  PGL_CUDA_TRY(exclusive_sum(counts, vertex_offsets, workspace, launch));
  return exclusive_sum(std::span<const std::uint32_t>(triangle_counts), triangle_offsets, workspace, launch);
}

}  // namespace pgl::cuda
