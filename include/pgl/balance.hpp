// SPDX-License-Identifier: MIT
// Which GPU draws which part of the picture: tiles, one for each, that share out what the objects cost.
#pragma once

#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/cull_occluded.hpp"
#include "pgl/depth.hpp"
#include "pgl/ieee.hpp"
#include "pgl/project.hpp"

namespace pgl {

/// The widest and highest picture that balance cuts into tiles, pixels, and the most tiles.
inline constexpr std::uint32_t most_picture_side = 16384;
inline constexpr std::uint32_t most_tiles = 64;

/// Whole pixels of the picture, [x0, x1) x [y0, y1); row 0 is the lowest, as in ScreenBox. Empty where x0 = x1 or
/// y0 = y1.
struct Tile {
  std::uint32_t x0 = 0;
  std::uint32_t y0 = 0;
  std::uint32_t x1 = 0;
  std::uint32_t y1 = 0;
  friend constexpr bool operator==(const Tile&, const Tile&) = default;
};

/// How the place of a split is found.
///
/// histogram: the best of all candidates. Two histograms of the load, one by the objects' first columns and one by
///   their last, give after a running sum the loads of both sides for every candidate.
/// bisection: [Peng13] Alg 6, our reading, made to end always: from the middle on, the interval is halved towards the
///   side with the larger share, until the imbalance is at most the threshold LBT or nothing is left to halve; then the
///   best position seen is taken. In the paper each step counts all objects again, on both GPUs; here the two running
///   sums answer it, so that it costs as much as histogram does.
enum class BalancePolicy : std::uint8_t { histogram, bisection };

/// What balance is asked for.
struct BalanceOptions {
  BalancePolicy policy = BalancePolicy::histogram;
  float threshold = 0.03f;  ///< LBT, bisection only, in [0, 1]: the imbalance (see is_balanced) that ends the search
  std::uint32_t bins = 0;  ///< 0: a tile can be cut between any two pixels; from 2 on: only between so many equal parts
};

/// Tells whether every option is in its documented range. NaN is in none.
PGL_HD constexpr bool is_valid(const BalanceOptions& options) {
  return options.threshold >= 0.0f && options.threshold <= 1.0f && options.bins != 1;
}

/// The pixels [x0, x1) x [y0, y1) that an object can touch; none by default.
struct alignas(8) TouchedPixels {
  std::uint16_t x0 = 0;
  std::uint16_t y0 = 0;
  std::uint16_t x1 = 0;
  std::uint16_t y1 = 0;
  friend constexpr bool operator==(const TouchedPixels&, const TouchedPixels&) = default;
};

/// Finds the pixels of a picture that a rectangle of the viewport (see ScreenBox) can touch: its own, rounded outwards,
/// and one more to each side, since renderers move vertices to a grid (see covered_texels). No pixel of the object is
/// elsewhere. None for a rectangle that is empty, has a NaN or, grown, lies beside the picture.
/// Precondition: width and height are in [1, most_picture_side].
PGL_HD constexpr TouchedPixels touched_pixels(const ScreenBox& rectangle, std::uint32_t width, std::uint32_t height) {
  TexelRange range;
  if (!covered_texels(rectangle, DepthMap{.width = width, .height = height}, range)) return {};
  return {static_cast<std::uint16_t>(range.x0), static_cast<std::uint16_t>(range.y0),
          static_cast<std::uint16_t>(range.x1 + 1), static_cast<std::uint16_t>(range.y1 + 1)};
}

/// Tells whether a pixel is in both. Nothing touches an empty tile.
PGL_HD constexpr bool touches(const TouchedPixels& pixels, const Tile& tile) {
  return pixels.x0 < tile.x1 && pixels.x1 > tile.x0 && pixels.y0 < tile.y1 && pixels.y1 > tile.y0 &&
         tile.x0 < tile.x1 && tile.y0 < tile.y1;
}

/// Tells whether an object must be drawn in a tile of balance: it has a load, and can touch a pixel of it.
PGL_HD constexpr bool is_in_tile(const ScreenBox& rectangle, std::uint32_t load, const Tile& tile) {
  return load > 0 && touches(touched_pixels(rectangle, most_picture_side, most_picture_side), tile);
}

/// A rectangle of the picture on the way to the tiles, and the `count` GPUs from `first` on that draw it.
struct TileNode {
  Tile tile;
  std::uint32_t first = 0;
  std::uint32_t count = 0;
};

/// How a node is cut: along its longer side (along x where both are as long), between `count` bins that are as long as
/// each other to within a pixel. Bin k begins floor(k * length / count) pixels from `begin`.
struct TileBins {
  Tile tile;
  bool along_y = false;
  std::uint32_t begin = 0;   ///< pixels, the lower end of the side
  std::uint32_t length = 0;  ///< pixels
  std::uint32_t count = 0;   ///< bins, at most `length`; 0 for an empty tile
};

/// The bins of a node. A node of a single GPU is not cut: one bin. Precondition: is_valid(options).
PGL_HD constexpr TileBins tile_bins(const TileNode& node, const BalanceOptions& options) {
  const std::uint32_t width = node.tile.x1 - node.tile.x0, height = node.tile.y1 - node.tile.y0;
  TileBins r;
  r.tile = node.tile;
  r.begin = node.tile.x0;
  if (width == 0 || height == 0) return r;
  r.along_y = height > width;
  r.begin = r.along_y ? node.tile.y0 : node.tile.x0;
  r.length = r.along_y ? height : width;
  r.count = options.bins == 0 || options.bins > r.length ? r.length : options.bins;
  if (node.count == 1) r.count = 1;
  return r;
}

/// Where bin k begins, in pixels from bins.begin. Precondition: k <= bins.count, bins.count > 0.
PGL_HD constexpr std::uint32_t bin_begin(const TileBins& bins, std::uint32_t k) {
  return static_cast<std::uint32_t>(std::uint64_t{k} * bins.length / bins.count);
}

/// The bin of the pixel `offset` from bins.begin: the last k with bin_begin(k) <= offset.
/// Precondition: offset < bins.length.
PGL_HD constexpr std::uint32_t bin_at(const TileBins& bins, std::uint32_t offset) {
  if (bins.count == bins.length) return offset;
  return ((offset + 1) * bins.count - 1) / bins.length;  // below 2^28
}

/// Finds the first and the last bin that an object touches; false if it does not touch the tile.
PGL_HD constexpr bool touched_bins(const TouchedPixels& pixels, const TileBins& bins, std::uint32_t& first,
                                   std::uint32_t& last) {
  if (!touches(pixels, bins.tile)) return false;
  const std::uint32_t p0 = bins.along_y ? pixels.y0 : pixels.x0, p1 = bins.along_y ? pixels.y1 : pixels.x1;
  const std::uint32_t end = bins.begin + bins.length;
  first = bin_at(bins, p0 > bins.begin ? p0 - bins.begin : 0);
  last = bin_at(bins, (p1 < end ? p1 : end) - 1 - bins.begin);
  return true;
}

/// The loads, or the weights, of the two sides of a split.
struct SplitLoads {
  std::uint64_t left = 0;  ///< or below
  std::uint64_t right = 0;
  friend constexpr bool operator==(const SplitLoads&, const SplitLoads&) = default;
};

/// Running sums over the bins of a node: the loads of the objects whose first bin (whose last bin) is below k, for each
/// bin k, and of all that touch the node.
struct LoadSums {
  const std::uint64_t* first_below = nullptr;
  const std::uint64_t* last_below = nullptr;
  std::uint64_t total = 0;

  /// The loads of the two sides of the border before bin k. What touches both sides counts in both. From one border to
  /// the next the left one never falls and the right one never rises, and they add up to at least the total.
  PGL_HD constexpr SplitLoads at(std::uint32_t k) const { return {first_below[k], total - last_below[k]}; }
};

/// The sums of the weights of a node's two halves: of the first floor(count / 2) of its GPUs, and of the others.
PGL_HD constexpr SplitLoads split_weights(const TileNode& node, const std::uint32_t* weights) {
  const std::uint32_t middle = node.first + node.count / 2;
  SplitLoads r;
  for (std::uint32_t gpu = node.first; gpu < middle; ++gpu) r.left += weights[gpu];
  for (std::uint32_t gpu = middle; gpu < node.first + node.count; ++gpu) r.right += weights[gpu];
  return r;
}

namespace detail {

/// An integer below 2^128.
struct Wide {
  std::uint64_t high = 0;
  std::uint64_t low = 0;
  friend PGL_HD constexpr bool operator<(const Wide& a, const Wide& b) {
    return a.high != b.high ? a.high < b.high : a.low < b.low;
  }
  friend PGL_HD constexpr Wide operator+(const Wide& a, const Wide& b) {
    return {a.high + b.high + (a.low + b.low < a.low ? 1 : 0), a.low + b.low};
  }
  friend PGL_HD constexpr Wide operator-(const Wide& a, const Wide& b) {
    return {a.high - b.high - (a.low < b.low ? 1 : 0), a.low - b.low};
  }
};

PGL_HD constexpr Wide wide_product(std::uint64_t a, std::uint64_t b) {
  constexpr std::uint64_t low_half = 0xffffffffu;
  const std::uint64_t a0 = a & low_half, a1 = a >> 32, b0 = b & low_half, b1 = b >> 32;
  const std::uint64_t outer = a0 * b0, cross0 = a0 * b1, cross1 = a1 * b0;
  const std::uint64_t middle = (outer >> 32) + (cross0 & low_half) + (cross1 & low_half);
  return {a1 * b1 + (cross0 >> 32) + (cross1 >> 32) + (middle >> 32), middle << 32 | (outer & low_half)};
}
/// Precondition: the product is below 2^128.
PGL_HD constexpr Wide wide_product(const Wide& a, std::uint32_t b) {
  const Wide low = wide_product(a.low, std::uint64_t{b});
  return {low.high + a.high * b, low.low};
}

}  // namespace detail

/// How well a split shares out: a side's share is its load over its weight, and both stand here times the product of
/// the weights, so that they are integers: l = left load * right weight and r = right load * left weight.
struct SplitCost {
  detail::Wide larger;      ///< max(l, r)
  detail::Wide difference;  ///< |l - r|
  bool left_is_larger = false;
};

/// Exact integers. Preconditions: loads below 2^63, weights at most 2^38.
PGL_HD constexpr SplitCost split_cost(const SplitLoads& loads, const SplitLoads& weights) {
  const detail::Wide l = detail::wide_product(loads.left, weights.right);
  const detail::Wide r = detail::wide_product(loads.right, weights.left);
  if (r < l) return {l, l - r, true};
  return {r, r - l, false};
}

/// Tells whether the split at border `a` is to be preferred to that at `b`: the smaller larger share, then the smaller
/// difference, then the lower border. A total order.
PGL_HD constexpr bool is_better(const SplitCost& cost_a, std::uint32_t a, const SplitCost& cost_b, std::uint32_t b) {
  if (cost_a.larger < cost_b.larger) return true;
  if (cost_b.larger < cost_a.larger) return false;
  if (cost_a.difference < cost_b.difference) return true;
  if (cost_b.difference < cost_a.difference) return false;
  return a < b;
}

/// Tells whether the imbalance |l - r| / (l + r) is at most the threshold, in exact integers; the threshold counts as
/// the next multiple of 2^-24 that is not larger. Source: the test of [Peng13] Alg 6 against LBT.
PGL_HD constexpr bool is_balanced(const SplitCost& cost, float threshold) {
  constexpr std::uint32_t one = 1u << 24;
  const auto steps = static_cast<std::uint32_t>(ieee::mul(threshold, 0x1p24f));
  const detail::Wide sum = cost.larger + cost.larger - cost.difference;  // below 2^102
  return !(detail::wide_product(sum, steps) < detail::wide_product(cost.difference, one));
}

/// Finds a border by BalancePolicy::bisection, from 1 to bins - 1. At most floor(log2(bins - 1)) + 1 borders are looked
/// at. Preconditions: bins >= 2; something touches the node.
///
/// Along the borders l never falls and r never rises, so (l - r) / (l + r), whose denominator is never 0, never falls.
/// Hence whatever border is within the threshold stays in the interval, and one is found wherever there is one. Where
/// there is none, the search ends between two neighbours, or at an end: below l < r, above l > r. Both were looked at.
/// Of the lower borders none has a smaller r, and of the upper ones none has a smaller l: the best one seen has the
/// smallest larger share of all, and its difference, as histogram would find it. With a threshold of 0 that is always
/// so; with more, a border within the threshold is taken although another may have a smaller larger share.
PGL_HD constexpr std::uint32_t bisected_border(const LoadSums& sums, std::uint32_t bins, const SplitLoads& weights,
                                               float threshold) {
  std::uint32_t low = 1, high = bins - 1, best = 0;
  SplitCost best_cost;
  while (low <= high) {
    const std::uint32_t k = low + (high - low) / 2;
    const SplitCost cost = split_cost(sums.at(k), weights);
    if (is_balanced(cost, threshold)) return k;
    if (best == 0 || is_better(cost, k, best_cost, best)) {
      best = k;
      best_cost = cost;
    }
    if (cost.left_is_larger)
      high = k - 1;
    else
      low = k + 1;
  }
  return best;
}

/// Where a node is cut that no object touches, in pixels from bins.begin: in proportion to the weights, but with a
/// pixel on either side where there are two. Precondition: weights above 0.
PGL_HD constexpr std::uint32_t unloaded_cut(const TileBins& bins, const SplitLoads& weights) {
  if (bins.length < 2) return bins.length;
  const auto at = static_cast<std::uint32_t>(bins.length * weights.left / (weights.left + weights.right));
  return at < 1 ? 1 : at;  // below length, since the right weight is not 0
}

/// The two parts of a node that is cut `at` pixels from bins.begin, for the two halves of its GPUs (see split_weights).
struct TileHalves {
  TileNode left;
  TileNode right;
};
PGL_HD constexpr TileHalves halves(const TileNode& node, const TileBins& bins, std::uint32_t at) {
  TileHalves r{{node.tile, node.first, node.count / 2}, {node.tile, node.first + node.count / 2, 0}};
  r.right.count = node.count - r.left.count;
  if (bins.along_y)
    r.left.tile.y1 = r.right.tile.y0 = bins.begin + at;
  else
    r.left.tile.x1 = r.right.tile.x0 = bins.begin + at;
  return r;
}

}  // namespace pgl
