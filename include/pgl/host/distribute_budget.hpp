// SPDX-License-Identifier: MIT
// Shares a vertex budget among the objects of a frame, and lays out what was selected; on the CPU.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/distribute_budget.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefix_sum.hpp"

namespace pgl::host {

namespace detail {

/// The objects whose keys fall into one part of the range of keys: the sum of their values and the keys' own range.
struct BudgetBucket {
  std::uint64_t sum = 0;
  std::uint64_t least = ~std::uint64_t{0};
  std::uint64_t most = 0;
  void operator+=(const BudgetBucket& other) {
    sum += other.sum;
    least = std::min(least, other.least);
    most = std::max(most, other.most);
  }
};

}  // namespace detail

/// Scratch memory of distribute_budget. Reuse it from frame to frame: it grows to the largest frame and stays.
struct BudgetWorkspace {
  std::vector<std::uint64_t> keys;
  std::vector<detail::BudgetBucket> buckets;
};

using pgl::BudgetTotals;

namespace detail {

/// The keys of the objects that take part: those of block b's objects are the first sizes[b] from where the block
/// begins in `keys`, in the order of the objects.
struct BudgetKeys {
  std::span<std::uint64_t> keys;
  std::size_t blocks = 1;
  std::array<std::size_t, max_blocks> sizes{};

  /// Adds up part(keys of the block) over all blocks; any type with +=, whose order must not matter.
  template <class Part>
  auto sum(Part&& part) const {
    return sum_blocks(keys.size(), blocks, [&](std::size_t b, std::size_t begin, std::size_t) {
      return part(std::span<const std::uint64_t>(keys.data() + begin, sizes[b]));
    });
  }
};

/// Finds where the running sum of value(object), heaviest object first, over the keys in [least, most] first exceeds
/// `limit`.
///
/// No sort: the range of keys is cut into 1024 buckets, the one that holds the cut is found from the buckets' sums, and
/// its own, narrower range is cut again, at most seven times and twice as a rule.
template <class Value>
BudgetCut find_budget_cut(const BudgetKeys& objects, std::uint64_t least, std::uint64_t most, std::uint64_t limit,
                          std::vector<BudgetBucket>& buckets, Value&& value) {
  constexpr int bits = 10;
  constexpr std::size_t size = std::size_t{1} << bits;
  if (buckets.size() < objects.blocks * size) buckets.resize(objects.blocks * size);

  BudgetCut cut;
  while (least <= most) {
    const int shift = std::max(0, static_cast<int>(std::bit_width(most - least)) - bits);
    for_blocks(objects.keys.size(), objects.blocks, [&](std::size_t b, std::size_t begin, std::size_t) {
      BudgetBucket* const own = buckets.data() + b * size;
      std::fill(own, own + size, BudgetBucket{});
      for (const std::uint64_t key : objects.keys.subspan(begin, objects.sizes[b]))
        if (key >= least && key <= most) own[(key - least) >> shift] += {value(object_of_key(key)), key, key};
    });
    BudgetBucket at_cut;  // an empty range where nothing exceeds the limit
    for (std::size_t k = size; k-- > 0;) {
      BudgetBucket bucket = buckets[k];
      for (std::size_t b = 1; b < objects.blocks; ++b) bucket += buckets[b * size + k];
      if (cut.before + bucket.sum > limit) {
        at_cut = bucket;
        break;
      }
      cut.before += bucket.sum;
    }
    least = at_cut.least;
    most = at_cut.most;
    if (least == most) {
      cut.key = least;
      break;
    }
  }
  return cut;
}

/// Finds the highest level of the grid at which sum_at(level), which never falls, is at most the budget, in 17 steps; 0
/// where it is so at none.
template <class SumAt>
std::uint64_t find_budget_level(std::uint64_t budget, SumAt&& sum_at) {
  std::uint32_t low = 0;
  std::uint32_t high = budget_levels;
  while (high - low > 1) {
    const std::uint32_t middle = low + (high - low) / 2;
    (sum_at(budget_level(middle)) <= budget ? low : high) = middle;
  }
  return budget_level(low);
}

}  // namespace detail

/// Fills in how few and how many vertices each object may be drawn with, as distribute_budget takes them.
///
/// max_vertices[i] is the full count of the object's mesh; min_vertices[i] the least count that keeps min_triangles
/// (MinT of [Peng13] Eq 2.4), see minimum_vertices. They change with the model and MinT only: call it once at load.
/// mesh_of_object: in, n indices into meshes. meshes, map: in, the model's. min_vertices, max_vertices: out, n entries.
/// O(n log vertices), in parallel.
inline void vertex_limits(std::span<const std::uint32_t> mesh_of_object, std::span<const Mesh> meshes,
                          std::span<const std::uint32_t> map, std::uint32_t min_triangles,
                          std::span<std::uint32_t> min_vertices, std::span<std::uint32_t> max_vertices) {
  PGL_ASSERT(min_vertices.size() == mesh_of_object.size() && max_vertices.size() == mesh_of_object.size());
  parallel_for(mesh_of_object.size(), 4096, [&](std::size_t i) {
    const Mesh& mesh = meshes[mesh_of_object[i]];
    min_vertices[i] = minimum_vertices(mesh, map.data(), min_triangles);
    max_vertices[i] = mesh.max_vertices;
  });
}

/// Shares options.budget vertices among n objects ([Peng13] Eq 2.3, 2.4, Alg 2).
///
/// Each eligible object (see log_weight) gets the part of the budget that its weight calls for, clamped to its range.
/// If that is too much in all, the lightest objects get 0; if too little, the heaviest get more. What that means to the
/// last vertex is said at BudgetPolicy. With BudgetPolicy::exact and BudgetPolicy::fair:
/// - the counts sum up to at most the budget, and to exactly the budget whenever an object with a count above 0 could
///   take one more vertex;
/// - each count is 0 or in [min_vertices, max_vertices]; objects that are not eligible get 0;
/// - of two objects with the same range, the heavier has at least the lighter's count (ties: the lower index is
///   heavier);
/// - something is drawn whenever the budget is above 0 and an object is eligible;
/// - with BudgetPolicy::fair, every eligible object is in its range if the minima of all of them fit into the budget.
/// Lighter objects that would fit into what the object at the cut leaves are not tried: the order decides.
///
/// areas: in, n areas on the screen, pixels squared; 0 for a culled object. depths: in, n nearest depths.
/// min_vertices, max_vertices: in, n ranges, min <= max (see vertex_limits). counts: out, n vertex counts, overlapping
/// nothing else. Any area and depth is accepted; NaN, infinite and zero ones as log_weight says. No objects: no counts.
/// Preconditions: is_valid(options); n <= 2^31.
/// O(n), in parallel; allocates only where the workspace is smaller than ever before. The same for any number of
/// threads.
inline BudgetTotals distribute_budget(std::span<const float> areas, std::span<const float> depths,
                                      std::span<const std::uint32_t> min_vertices,
                                      std::span<const std::uint32_t> max_vertices, const BudgetOptions& options,
                                      BudgetWorkspace& workspace, std::span<std::uint32_t> counts) {
  const std::size_t n = areas.size();
  PGL_ASSERT(is_valid(options));
  PGL_ASSERT(n <= (std::size_t{1} << 31));
  PGL_ASSERT(depths.size() == n && min_vertices.size() == n && max_vertices.size() == n && counts.size() == n);
  if (workspace.keys.size() < n) workspace.keys.resize(n);
  detail::BudgetKeys objects{std::span(workspace.keys.data(), n), detail::block_count(n)};

  // Weights: the keys of the objects that take part (the eligible ones; with the paper's policy all), and their range.
  const detail::BudgetBucket range =
      detail::sum_blocks(n, objects.blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
        detail::BudgetBucket part;
        std::uint64_t* out = objects.keys.data() + begin;
        for (std::size_t i = begin; i < end; ++i) {
          PGL_ASSERT(min_vertices[i] <= max_vertices[i]);
          counts[i] = 0;
          const float weight = log_weight(areas[i], depths[i], min_vertices[i], max_vertices[i], options);
          const std::uint64_t key = weight_key(weight, static_cast<std::uint32_t>(i));
          if (key < lift_from(options)) continue;
          part += {0, key, key};
          *out++ = key;
        }
        objects.sizes[b] = static_cast<std::size_t>(out - (objects.keys.data() + begin));
        return part;
      });
  const float heaviest = weight_of_key(range.most);

  // Shares (for a moment counts holds these), then clamped shares.
  using Keys = std::span<const std::uint64_t>;
  const std::uint64_t share_sum = objects.sum([&](Keys keys) {
    std::uint64_t sum = 0;
    for (const std::uint64_t key : keys)
      sum += counts[object_of_key(key)] = share_weight(weight_of_key(key), heaviest, options.alpha);
    return sum;
  });
  std::uint64_t level = 0;
  if (options.policy == BudgetPolicy::fair)
    level = detail::find_budget_level(options.budget, [&](std::uint64_t candidate) {
      return objects.sum([&](Keys keys) {
        std::uint64_t sum = 0;
        for (const std::uint64_t key : keys) {
          const std::uint32_t i = object_of_key(key);
          sum += level_vertices(candidate, counts[i], min_vertices[i], max_vertices[i]);
        }
        return sum;
      });
    });
  const std::uint64_t shared = objects.sum([&](Keys keys) {
    std::uint64_t sum = 0;
    for (const std::uint64_t key : keys) {
      if (key < least_eligible_key()) continue;
      const std::uint32_t i = object_of_key(key);
      sum += counts[i] = options.policy == BudgetPolicy::fair
                             ? level_vertices(level, counts[i], min_vertices[i], max_vertices[i])
                             : shared_vertices(counts[i], share_sum, min_vertices[i], max_vertices[i], options);
    }
    return sum;
  });

  BudgetPlan plan;
  if (shared <= options.budget) {
    plan.left = options.budget - shared;
  } else if (options.budget == 0) {
    plan.kept_from = ~std::uint64_t{0};
  } else {
    const BudgetCut cut = detail::find_budget_cut(objects, range.least, range.most, reduction_limit(options),
                                                  workspace.buckets, [&](std::uint32_t i) { return counts[i]; });
    plan = plan_reduction(cut, min_vertices[object_of_key(cut.key)], options);
  }
  if (plan.left > 0) {
    const BudgetCut cut = detail::find_budget_cut(objects, range.least, range.most, plan.left, workspace.buckets,
                                                  [&](std::uint32_t i) { return max_vertices[i] - counts[i]; });
    plan = plan_lift(plan, cut, cut.key == 0 ? 0 : counts[object_of_key(cut.key)], options);
  }

  return objects.sum([&](Keys keys) {
    BudgetTotals totals;
    for (const std::uint64_t key : keys) {
      const std::uint32_t i = object_of_key(key);
      counts[i] = planned_vertices(plan, key, counts[i], max_vertices[i]);
      totals += {counts[i] > 0 ? 1u : 0u, counts[i]};
    }
    return totals;
  });
}

/// Lays out a selection: the triangle count of every object, and where its vertices and triangles start when those of
/// all objects follow each other in order.
///
/// counts: in, n vertex counts, each 0 or in the range of the object's mesh. mesh_of_object: in, n indices into meshes.
/// meshes, map: in, the model's. triangle_counts: out, n. vertex_offsets, triangle_offsets: out, n + 1, the exclusive
/// prefix sums; the last entries are the totals. No out may overlap an in.
/// O(n), in parallel; nothing allocated; the same for any number of threads.
inline void lay_out(std::span<const std::uint32_t> counts, std::span<const std::uint32_t> mesh_of_object,
                    std::span<const Mesh> meshes, std::span<const std::uint32_t> map,
                    std::span<std::uint32_t> triangle_counts, std::span<std::uint64_t> vertex_offsets,
                    std::span<std::uint64_t> triangle_offsets) {
  PGL_ASSERT(mesh_of_object.size() == counts.size() && triangle_counts.size() == counts.size());
  parallel_for(counts.size(), 4096, [&](std::size_t i) {
    const Mesh& mesh = meshes[mesh_of_object[i]];
    PGL_ASSERT(counts[i] == 0 || (counts[i] >= mesh.min_vertices && counts[i] <= mesh.max_vertices));
    triangle_counts[i] = triangles_at(mesh, map.data(), counts[i]);
  });
  exclusive_sum<std::uint32_t>(counts, vertex_offsets);
  exclusive_sum<std::uint32_t>(triangle_counts, triangle_offsets);
}

}  // namespace pgl::host
