// SPDX-License-Identifier: MIT
// Keeps the growth of a selection within what may be transferred in a frame; on the GPU.
#pragma once

#include <cooperative_groups.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/distribute_budget.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/limit_transfer.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

using pgl::TransferTotals;

/// Scratch memory of limit_transfer: 20 bytes for each object and 170 KiB. Reuse it from frame to frame: it grows to
/// the largest frame and stays.
struct TransferWorkspace {
  Buffer memory;
};

namespace detail {

/// What the blocks learn of each other. All zero before the kernel starts.
struct TransferTables {
  BudgetSum extreme_keys[2];  // the largest, and the largest complement
  BudgetSum costs[2];         // as in GrowthCost
  BudgetSum rest;             // of the objects that are drawn
  CutTables first_cut;
  CutTables rest_cut;
};

/// The frame; weights and costs are scratch. An object that does not grow has no costs, and a weight that no object
/// can have.
struct TransferFrame : WeighedObjects {
  const float* areas;
  const float* depths;
  const std::uint32_t* min_vertices;
  const std::uint32_t* max_vertices;
  const std::uint32_t* mesh_of_object;
  const Mesh* meshes;
  const std::uint32_t* map;
  GrowthCost* costs;
};

/// wanted, previous and counts may be the same array: each object is read and written by one thread. totals may be
/// null.
template <class = void>
__global__ void __launch_bounds__(1024)
    limit_transfer_kernel(TransferFrame frame, BudgetOptions weight, TransferOptions options,
                          const std::uint32_t* wanted, const std::uint32_t* previous, std::uint32_t* counts,
                          TransferTables* tables, TransferTotals* totals) {
  __shared__ BudgetShared shared;
  const cooperative_groups::grid_group grid = cooperative_groups::this_grid();
  if (totals != nullptr && blockIdx.x == 0 && threadIdx.x == 0) *totals = TransferTotals{};

  // Costs and weights of what grows, their sums, and the range of the keys.
  BudgetSum extreme_keys[2] = {0, 0};
  BudgetSum costs[2] = {0, 0};
  frame.for_own_objects([&](std::uint64_t i) {
    const std::uint32_t want = wanted[i], before = previous[i];
    PGL_ASSERT(want == 0 || (want >= frame.min_vertices[i] && want <= frame.max_vertices[i]));
    frame.weights[i] = ieee::infinity<float>;
    if (want <= before) return;
    const Mesh& mesh = frame.meshes[frame.mesh_of_object[i]];
    PGL_ASSERT(before == 0 || (before >= mesh.min_vertices && before <= mesh.max_vertices));
    const GrowthCost cost = growth_cost(mesh, frame.map, frame.min_vertices[i], want, before, options);
    frame.costs[i] = cost;
    costs[0] += cost.first;
    costs[1] += cost.rest;
    frame.weights[i] =
        log_weight(frame.areas[i], frame.depths[i], frame.min_vertices[i], frame.max_vertices[i], weight);
    const std::uint64_t key = frame.key(i);
    extreme_keys[0] = KeepMost::combine(extreme_keys[0], key);
    extreme_keys[1] = KeepMost::combine(extreme_keys[1], ~key);
  });
  publish<AddUp>(costs, tables->costs, shared);
  __syncthreads();  // shared is free again
  publish<KeepMost>(extreme_keys, tables->extreme_keys, shared);
  grid.sync();
  const std::uint64_t most = tables->extreme_keys[0], least = ~tables->extreme_keys[1];
  const GrowthCost all{tables->costs[0], tables->costs[1]};

  BudgetCut first{0, all.first};
  if (all.first > options.cap)
    first = find_budget_cut(grid, frame, least, most, options.cap, tables->first_cut, shared,
                            [&](std::uint64_t i) { return frame.costs[i].first; });
  TransferPlan plan{first.key, 0, 0};

  BudgetCut rest{0, all.rest};
  if (first.key != 0) {  // what waits does not grow
    BudgetSum sum[1] = {0};
    frame.for_own_objects([&](std::uint64_t i) {
      const std::uint64_t key = frame.key(i);
      if (key > most) return;  // does not grow at all
      if (is_drawn(plan, key, previous[i]))
        sum[0] += frame.costs[i].rest;
      else
        frame.costs[i].rest = 0;
    });
    publish<AddUp>(sum, &tables->rest, shared);
    grid.sync();
    rest.before = tables->rest;
  }
  const std::uint64_t left = options.cap - first.before;
  if (rest.before > left)
    rest = find_budget_cut(grid, frame, least, most, left, tables->rest_cut, shared,
                           [&](std::uint64_t i) { return frame.costs[i].rest; });
  plan.cut = rest.key;
  plan.room = left - rest.before;

  // What is transferred is known but for the part of the object at the cut: its thread says it, or else the first one.
  BudgetSum let_through[3] = {0, 0, 0};  // as in TransferTotals
  const auto note_bytes = [&](std::uint64_t at_cut) {
    let_through[0] = first.before + rest.before + at_cut;
    let_through[1] = all.first + all.rest - let_through[0];
  };
  if (plan.cut == 0 && blockIdx.x == 0 && threadIdx.x == 0) note_bytes(0);
  frame.for_own_objects([&](std::uint64_t i) {
    const std::uint32_t want = wanted[i], before = previous[i];
    std::uint32_t count = want;
    if (want > before) {
      const std::uint64_t key = frame.key(i);
      const Mesh& mesh = frame.meshes[frame.mesh_of_object[i]];
      const std::uint32_t fewest = frame.min_vertices[i];
      count = limited_vertices(plan, key, mesh, frame.map, fewest, want, before, options);
      if (key == plan.cut) note_bytes(growth_bytes(mesh, frame.map, grown_from(fewest, before), count, options));
      let_through[2] += count < want ? 1u : 0u;
    }
    counts[i] = count;
  });
  static_assert(offsetof(TransferTotals, bytes) == 0 && offsetof(TransferTotals, missing_bytes) == sizeof(BudgetSum) &&
                offsetof(TransferTotals, waiting) == 2 * sizeof(BudgetSum) &&
                sizeof(TransferTotals) == 3 * sizeof(BudgetSum));
  if (totals != nullptr) publish<AddUp>(let_through, reinterpret_cast<BudgetSum*>(totals), shared);
}

}  // namespace detail

/// Reduces wanted counts so far that no more than options.cap bytes must be transferred to get there from the previous
/// selection, as pgl::host::limit_transfer does; the rule is at the top of pgl/limit_transfer.hpp.
///
/// All views are of device memory; counts may be wanted or previous itself, and overlaps nothing else. totals: out, on
/// the device, what the host's returns, zeros for no objects; null if not wanted. The options are read before this
/// returns: a captured graph keeps those that it was captured with.
/// Preconditions: those of the host; they are checked on the device in debug builds, but for the sum of all bytes.
///
/// O(n): one cooperative kernel. Where all fits into the cap its grid synchronises once; where it does not, 3 or 4
/// times as a rule (at most 8) for each of the two cuts, and once between. The device must support cooperative
/// launches. Nothing is allocated once the workspace has been used for as many objects. Enqueued on launch.stream,
/// capturable; the same for any launch and GPU.
[[nodiscard]] inline cudaError_t limit_transfer(
    std::span<const float> areas, std::span<const float> depths, std::span<const std::uint32_t> min_vertices,
    std::span<const std::uint32_t> max_vertices, const BudgetOptions& weight, std::span<const std::uint32_t> wanted,
    std::span<const std::uint32_t> previous, std::span<const std::uint32_t> mesh_of_object,
    std::span<const Mesh> meshes, std::span<const std::uint32_t> map, const TransferOptions& options,
    TransferWorkspace& workspace, std::span<std::uint32_t> counts, TransferTotals* totals, Launch launch = {}) {
  const std::uint64_t n = wanted.size();
  PGL_ASSERT(is_valid(weight) && is_valid(options));
  PGL_ASSERT(n <= (std::uint64_t{1} << 31));
  PGL_ASSERT(areas.size() == n && depths.size() == n && min_vertices.size() == n && max_vertices.size() == n);
  PGL_ASSERT(previous.size() == n && mesh_of_object.size() == n && counts.size() == n);
  if (n == 0) return totals == nullptr ? cudaSuccess : cudaMemsetAsync(totals, 0, sizeof(*totals), launch.stream);
  const auto lay_out_scratch = [n](detail::Parts& parts, detail::TransferTables*& tables, float*& weights,
                                   GrowthCost*& costs) {
    tables = parts.take<detail::TransferTables>(1);
    weights = parts.take<float>(n);
    costs = parts.take<GrowthCost>(n);
  };
  detail::TransferTables* tables = nullptr;
  float* weights = nullptr;
  GrowthCost* costs = nullptr;
  detail::Parts sizes;
  lay_out_scratch(sizes, tables, weights, costs);
  PGL_CUDA_TRY(workspace.memory.reserve(sizes.size()));
  detail::Parts parts(workspace.memory.at<void>());
  lay_out_scratch(parts, tables, weights, costs);
  PGL_CUDA_TRY(cudaMemsetAsync(tables, 0, sizeof(*tables), launch.stream));
  const detail::TransferFrame frame{{n, weights},        areas.data(),        depths.data(),
                                    min_vertices.data(), max_vertices.data(), mesh_of_object.data(),
                                    meshes.data(),       map.data(),          costs};
  return detail::run_cooperative(detail::limit_transfer_kernel<>, detail::blocks_for(n, launch.block_threads), 0,
                                 launch, frame, weight, options, wanted.data(), previous.data(), counts.data(), tables,
                                 totals);
}

}  // namespace pgl::cuda
