// SPDX-License-Identifier: MIT
// Keeps the growth of a selection within what may be transferred in a frame; on the CPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/limit_transfer.hpp"

namespace pgl::host {

/// Scratch memory of limit_transfer. Reuse it from frame to frame: it grows to the largest frame and stays.
struct TransferWorkspace {
  std::vector<std::uint64_t> keys;
  std::vector<GrowthCost> costs;
  std::vector<detail::BudgetBucket> buckets;
};

using pgl::TransferTotals;

namespace detail {

/// What the objects of a block that grow cost together, and the range of their keys.
struct GrowthSum {
  GrowthCost cost;
  std::uint64_t least = ~std::uint64_t{0};
  std::uint64_t most = 0;
  void operator+=(const GrowthSum& other) {
    cost.first += other.cost.first;
    cost.rest += other.cost.rest;
    least = std::min(least, other.least);
    most = std::max(most, other.most);
  }
};

/// The largest of several numbers.
struct Most {
  std::uint64_t value = 0;
  void operator+=(const Most& other) { value = std::max(value, other.value); }
};

}  // namespace detail

/// Reduces wanted counts so far that no more than options.cap bytes must be transferred to get there from the previous
/// selection. What is new competes by visual weight: first the coarsest form of objects that are not drawn yet, then
/// detail; the heaviest first. The rule, and what it guarantees, is at the top of pgl/limit_transfer.hpp.
///
/// So where a camera jumps, the objects that are seen best appear first, coarsely, and then refine, over as many frames
/// as it takes; every frame's counts are a valid selection; and with a camera that stands still they become the wanted
/// ones, if the cap is at least least_cap.
///
/// - areas, depths, min_vertices, max_vertices, weight: n each and the options, as they were given to distribute_budget
///   for this frame: they decide the order (log_weight);
/// - wanted: n counts, as distribute_budget writes them: each 0 or in [min_vertices, max_vertices];
/// - previous: n counts of the last selection, 0 or in the range of the object's mesh; all 0 before the first frame;
/// - mesh_of_object: n indices into meshes; meshes, map: the model's;
/// - counts: out, n; may be wanted or previous itself, and overlaps nothing else.
///
/// Returns what is to be transferred and what is missing. Preconditions: is_valid(weight), is_valid(options); n <=
/// 2^31; the bytes of all growth together are below 2^64. O(n), in parallel; allocates only where the workspace is
/// smaller than ever before. The same for any number of threads.
inline TransferTotals limit_transfer(std::span<const float> areas, std::span<const float> depths,
                                     std::span<const std::uint32_t> min_vertices,
                                     std::span<const std::uint32_t> max_vertices, const BudgetOptions& weight,
                                     std::span<const std::uint32_t> wanted, std::span<const std::uint32_t> previous,
                                     std::span<const std::uint32_t> mesh_of_object, std::span<const Mesh> meshes,
                                     std::span<const std::uint32_t> map, const TransferOptions& options,
                                     TransferWorkspace& workspace, std::span<std::uint32_t> counts) {
  const std::size_t n = wanted.size();
  PGL_ASSERT(is_valid(weight) && is_valid(options));
  PGL_ASSERT(n <= (std::size_t{1} << 31));
  PGL_ASSERT(areas.size() == n && depths.size() == n && min_vertices.size() == n && max_vertices.size() == n);
  PGL_ASSERT(previous.size() == n && mesh_of_object.size() == n && counts.size() == n);
  if (workspace.keys.size() < n) workspace.keys.resize(n);
  if (workspace.costs.size() < n) workspace.costs.resize(n);
  std::vector<GrowthCost>& costs = workspace.costs;
  detail::BudgetKeys growing{std::span(workspace.keys.data(), n), detail::block_count(n)};

  const detail::GrowthSum all =
      detail::sum_blocks(n, growing.blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
        detail::GrowthSum sum;
        std::uint64_t* out = growing.keys.data() + begin;
        for (std::size_t i = begin; i < end; ++i) {
          PGL_ASSERT(wanted[i] == 0 || (wanted[i] >= min_vertices[i] && wanted[i] <= max_vertices[i]));
          PGL_ASSERT(previous[i] == 0 || (previous[i] >= meshes[mesh_of_object[i]].min_vertices &&
                                          previous[i] <= meshes[mesh_of_object[i]].max_vertices));
          if (wanted[i] <= previous[i]) continue;
          costs[i] =
              growth_cost(meshes[mesh_of_object[i]], map.data(), min_vertices[i], wanted[i], previous[i], options);
          const std::uint64_t key = weight_key(
              log_weight(areas[i], depths[i], min_vertices[i], max_vertices[i], weight), static_cast<std::uint32_t>(i));
          sum += {costs[i], key, key};
          *out++ = key;
        }
        growing.sizes[b] = static_cast<std::size_t>(out - (growing.keys.data() + begin));
        return sum;
      });

  BudgetCut first{0, all.cost.first};
  if (all.cost.first > options.cap)
    first = detail::find_budget_cut(growing, all.least, all.most, options.cap, workspace.buckets,
                                    [&](std::uint32_t i) { return costs[i].first; });
  TransferPlan plan{first.key, 0, 0};

  BudgetCut rest{0, all.cost.rest};
  if (first.key != 0) {  // what waits does not grow
    rest.before = growing.sum([&](std::span<const std::uint64_t> keys) {
      std::uint64_t sum = 0;
      for (const std::uint64_t key : keys) {
        const std::uint32_t i = object_of_key(key);
        if (!is_drawn(plan, key, previous[i])) costs[i].rest = 0;
        sum += costs[i].rest;
      }
      return sum;
    });
  }
  const std::uint64_t left = options.cap - first.before;
  if (rest.before > left)
    rest = detail::find_budget_cut(growing, all.least, all.most, left, workspace.buckets,
                                   [&](std::uint32_t i) { return costs[i].rest; });
  plan.cut = rest.key;
  plan.room = left - rest.before;

  TransferTotals totals = detail::sum_blocks(n, growing.blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
    TransferTotals part;
    const std::uint64_t* next = growing.keys.data() + begin;
    const std::uint64_t* const last = next + growing.sizes[b];
    for (std::size_t i = begin; i < end; ++i) {
      if (next == last || object_of_key(*next) != i) {
        counts[i] = wanted[i];
        continue;
      }
      const std::uint64_t key = *next++;
      const Mesh& mesh = meshes[mesh_of_object[i]];
      const std::uint32_t want = wanted[i];
      const std::uint32_t count =
          limited_vertices(plan, key, mesh, map.data(), min_vertices[i], want, previous[i], options);
      if (key == plan.cut)
        part.bytes = growth_bytes(mesh, map.data(), grown_from(min_vertices[i], previous[i]), count, options);
      part.waiting += count < want ? 1 : 0;
      counts[i] = count;
    }
    return part;
  });
  totals.bytes += first.before + rest.before;
  totals.missing_bytes = all.cost.first + all.cost.rest - totals.bytes;
  return totals;
}

/// Computes the least cap with which everything that is wanted arrives in the end, in bytes: the largest step of any
/// mesh. With a cap of a few times this, or more, hardly any of it is lost to what does not fit.
///
/// meshes, map: the model's; the whole map is read. min_triangles: as for vertex_limits. Precondition:
/// is_valid(options). O(vertices of the meshes), parallel over meshes, nothing allocated.
inline std::uint64_t least_cap(std::span<const Mesh> meshes, std::span<const std::uint32_t> map,
                               std::uint32_t min_triangles, const TransferOptions& options) {
  PGL_ASSERT(is_valid(options));
  return detail::sum_blocks(meshes.size(), detail::block_count(meshes.size()),
                            [&](std::size_t, std::size_t begin, std::size_t end) {
                              detail::Most most;
                              for (std::size_t m = begin; m < end; ++m)
                                most += {largest_step(meshes[m], map.data(), min_triangles, options)};
                              return most;
                            })
      .value;
}

}  // namespace pgl::host
