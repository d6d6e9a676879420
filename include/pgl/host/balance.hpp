// SPDX-License-Identifier: MIT
// Cuts the picture into tiles, one for each GPU, that share out what the objects cost; on the CPU.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/balance.hpp"
#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/project.hpp"

namespace pgl::host {

namespace detail {

/// An object that is drawn somewhere.
struct TouchingObject {
  TouchedPixels pixels;
  std::uint32_t load;
};

}  // namespace detail

/// Scratch memory of balance. Reuse it from frame to frame: it grows to the largest frame and stays.
struct BalanceWorkspace {
  std::vector<detail::TouchingObject> objects;
  std::vector<std::uint64_t> sums;
};

namespace detail {

/// The objects that are drawn somewhere, block by block of all objects, each at the beginning of its block's place.
struct TouchingObjects {
  std::span<TouchingObject> objects;
  std::size_t blocks;
  std::array<std::size_t, max_blocks> sizes{};

  std::size_t size() const {
    std::size_t sum = 0;
    for (std::size_t b = 0; b < blocks; ++b) sum += sizes[b];
    return sum;
  }
  std::span<const TouchingObject> block(std::size_t b) const {
    return objects.subspan(objects.size() * b / blocks, sizes[b]);
  }
};

/// The nodes of one level of the tree, and where the sums of each begin: two for each bin, by first and by last bin.
struct BalanceLevel {
  std::array<TileNode, most_tiles / 2> nodes;
  std::array<TileBins, most_tiles / 2> bins;
  std::array<std::size_t, most_tiles / 2> starts{};
  std::size_t count = 0;
  std::size_t sums = 0;

  void add(const TileNode& node, const BalanceOptions& options) {
    nodes[count] = node;
    bins[count] = tile_bins(node, options);
    starts[count] = sums;
    sums += 2 * bins[count].count;
    ++count;
  }
};

/// Adds up the loads of all objects by first and by last bin, for all nodes of a level. There are at most so many
/// copies of the sums that what they cost is no more than the objects do.
inline std::span<std::uint64_t> add_up_loads(const TouchingObjects& touching, const BalanceLevel& level,
                                             std::vector<std::uint64_t>& memory) {
  const std::size_t copies =
      std::clamp<std::size_t>(touching.size() / std::max<std::size_t>(level.sums, 1), 1, touching.blocks);
  if (memory.size() < copies * level.sums) memory.resize(copies * level.sums);
  for_blocks(touching.blocks, copies, [&](std::size_t copy, std::size_t begin, std::size_t end) {
    const std::span<std::uint64_t> sums(memory.data() + copy * level.sums, level.sums);
    std::fill(sums.begin(), sums.end(), 0);
    for (std::size_t b = begin; b < end; ++b)
      for (const TouchingObject& object : touching.block(b))
        for (std::size_t k = 0; k < level.count; ++k) {
          std::uint32_t first = 0, last = 0;
          if (!touched_bins(object.pixels, level.bins[k], first, last)) continue;
          sums[level.starts[k] + first] += object.load;
          sums[level.starts[k] + level.bins[k].count + last] += object.load;
        }
  });
  const std::span<std::uint64_t> all(memory.data(), level.sums);
  for (std::size_t copy = 1; copy < copies; ++copy)
    for (std::size_t i = 0; i < all.size(); ++i) all[i] += memory[copy * level.sums + i];
  return all;
}

/// Turns sums into the sums of those before each; returns the sum of all.
inline std::uint64_t sums_before(std::span<std::uint64_t> sums) {
  std::uint64_t running = 0;
  for (std::uint64_t& sum : sums) {
    const std::uint64_t own = sum;
    sum = running;
    running += own;
  }
  return running;
}

/// Finds where a node with at least two bins is cut: the border before this bin.
inline std::uint32_t best_border(const LoadSums& sums, std::uint32_t bins, const SplitLoads& weights,
                                 const BalanceOptions& options) {
  if (options.policy == BalancePolicy::bisection) return bisected_border(sums, bins, weights, options.threshold);
  std::uint32_t best = 1;
  SplitCost best_cost = split_cost(sums.at(1), weights);
  for (std::uint32_t k = 2; k < bins; ++k) {
    const SplitCost cost = split_cost(sums.at(k), weights);
    if (!is_better(cost, k, best_cost, best)) continue;
    best = k;
    best_cost = cost;
  }
  return best;
}

}  // namespace detail

/// Cuts the picture into tiles, one for each GPU, so that each has its share of the load: the parts of the picture that
/// the GPUs draw, and what an object costs is counted in every tile that it can touch, since it is drawn in each.
///
/// The tiles are rectangles of whole pixels that cover the picture, without overlap: N pictures, each cut to its tile,
/// are one picture. Each GPU draws the objects that in_tile finds.
///
/// - rectangles: n, as project writes them; empty ones, and such with a NaN, touch nothing (see touched_pixels);
/// - loads: n, what each object costs, in any unit; e.g. the triangle counts of lay_out. 0: not drawn;
/// - width, height: the picture's, pixels, from 1 to most_picture_side;
/// - weights: one for each GPU, 1 to most_tiles of them, above 0; what it draws in a given time, relative to others;
/// - tiles, tile_loads: out, one for each GPU; tile_loads[g] is the sum of the loads of the objects in tiles[g].
///
/// A tree of splits: the GPUs are cut into two halves by number (of an odd number the first half is the smaller one)
/// and the picture along its longer side (along x where both are as long) in two parts for them; so go the halves on.
/// Among the candidates (see BalanceOptions::bins) the cut is where the larger of both sides' shares, load over weight,
/// is smallest; among equals where they differ least; among those the lowest; or where BalancePolicy::bisection finds
/// it. What is touched by no object is cut in proportion to the weights, between pixels. A part of one pixel goes to
/// the first half of its GPUs; the tiles of the others are empty.
///
/// Preconditions: is_valid(options); n <= 2^31; no out overlaps an in. O(n N) for N GPUs, log2(N) passes, in parallel
/// over the objects; integers only: the same for any number of threads. Allocates only where the workspace is smaller
/// than ever before.
/// Source: the load-balanced split of [Peng13] 5 (policies: see BalancePolicy); more than two tiles as [NC07] has them.
inline void balance(std::span<const ScreenBox> rectangles, std::span<const std::uint32_t> loads, std::uint32_t width,
                    std::uint32_t height, std::span<const std::uint32_t> weights, const BalanceOptions& options,
                    BalanceWorkspace& workspace, std::span<Tile> tiles, std::span<std::uint64_t> tile_loads) {
  const std::size_t n = rectangles.size();
  PGL_ASSERT(is_valid(options));
  PGL_ASSERT(n <= (std::size_t{1} << 31) && loads.size() == n);
  PGL_ASSERT(width >= 1 && width <= most_picture_side && height >= 1 && height <= most_picture_side);
  PGL_ASSERT(!weights.empty() && weights.size() <= most_tiles);
  PGL_ASSERT(tiles.size() == weights.size() && tile_loads.size() == weights.size());
  PGL_ASSERT(std::find(weights.begin(), weights.end(), 0u) == weights.end());
  if (workspace.objects.size() < n) workspace.objects.resize(n);
  detail::TouchingObjects touching{std::span(workspace.objects.data(), n), detail::block_count(n)};
  detail::for_blocks(n, touching.blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
    detail::TouchingObject* const first = touching.objects.data() + begin;
    detail::TouchingObject* next = first;
    for (std::size_t i = begin; i < end; ++i) {
      if (loads[i] == 0) continue;
      const TouchedPixels pixels = touched_pixels(rectangles[i], width, height);
      if (pixels != TouchedPixels{}) *next++ = {pixels, loads[i]};
    }
    touching.sizes[b] = static_cast<std::size_t>(next - first);
  });

  detail::BalanceLevel level;
  level.add({{0, 0, width, height}, 0, static_cast<std::uint32_t>(weights.size())}, options);
  while (level.count > 0) {
    const std::span<std::uint64_t> sums = detail::add_up_loads(touching, level, workspace.sums);
    detail::BalanceLevel next;
    for (std::size_t k = 0; k < level.count; ++k) {
      const TileNode& node = level.nodes[k];
      const TileBins& bins = level.bins[k];
      const std::span<std::uint64_t> by_first = sums.subspan(level.starts[k], bins.count);
      const std::span<std::uint64_t> by_last = sums.subspan(level.starts[k] + bins.count, bins.count);
      const LoadSums running{by_first.data(), by_last.data(), detail::sums_before(by_first)};
      detail::sums_before(by_last);
      const auto finish = [&](const TileNode& part, std::uint64_t load) {
        if (part.count > 1) {
          next.add(part, options);
        } else {
          tiles[part.first] = part.tile;
          tile_loads[part.first] = load;
        }
      };
      if (node.count == 1) {
        finish(node, running.total);
        continue;
      }
      const SplitLoads node_weights = split_weights(node, weights.data());
      SplitLoads split{running.total, 0};
      std::uint32_t at = unloaded_cut(bins, node_weights);
      if (running.total > 0 && bins.count > 1) {
        const std::uint32_t border = detail::best_border(running, bins.count, node_weights, options);
        split = running.at(border);
        at = bin_begin(bins, border);
      }
      const TileHalves parts = halves(node, bins, at);
      finish(parts.left, split.left);
      finish(parts.right, split.right);
    }
    level = next;
  }
}

/// Marks the objects that a GPU draws in its tile: flags[i] = 1 for an object with a load that can touch a pixel of the
/// tile, else 0. Each object with a load that can touch the picture is in at least one tile of balance.
///
/// rectangles, loads: n, as they were given to balance; empty `loads` mean that all objects have one, as where the
/// tiles are cut by what the last frame cost. flags: out, n, for project to take as its in_view. An empty tile has no
/// objects. O(n), in parallel, allocates nothing.
inline void in_tile(std::span<const ScreenBox> rectangles, std::span<const std::uint32_t> loads, const Tile& tile,
                    std::span<std::uint8_t> flags) {
  PGL_ASSERT(flags.size() == rectangles.size() && (loads.empty() || loads.size() == rectangles.size()));
  parallel_for(rectangles.size(), 4096, [&](std::size_t i) {
    flags[i] = static_cast<std::uint8_t>(is_in_tile(rectangles[i], loads.empty() ? 1 : loads[i], tile) ? 1 : 0);
  });
}

}  // namespace pgl::host
