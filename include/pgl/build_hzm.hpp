// SPDX-License-Identifier: MIT
// The hierarchical-Z map: where its levels lie, and what a texel of a level is.
#pragma once

#include <cstddef>
#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/depth.hpp"

namespace pgl {

/// The most levels that a map has: a side of 65536 texels, halved down to 1.
inline constexpr std::uint32_t most_hzm_levels = 17;

/// Where one level of a map lies: rows of `width` texels from number `offset` of the map on.
struct HzmLevel {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::uint64_t offset = 0;
  friend constexpr bool operator==(const HzmLevel&, const HzmLevel&) = default;
};

namespace detail {

PGL_HD constexpr void assert_is_map([[maybe_unused]] const DepthMap& size) {
  PGL_ASSERT(size.width >= 1 && size.width <= 65536 && size.height >= 1 && size.height <= 65536 && size.scale >= 1);
}

/// The texels along a side of a level: those along the side of level 0, halved `level` times, each time rounded up.
PGL_HD constexpr std::uint32_t hzm_side(std::uint32_t texels, std::uint32_t level) {
  return ((texels - 1) >> level) + 1;
}

}  // namespace detail

/// Returns how many levels the map of this size has: level 0, the depths themselves, and half as many texels along each
/// side, rounded up, from level to level, until one texel is left.
PGL_HD constexpr std::uint32_t hzm_levels(const DepthMap& size) {
  detail::assert_is_map(size);
  std::uint32_t longest = (size.width > size.height ? size.width : size.height) - 1;
  std::uint32_t levels = 1;
  for (; longest > 0; longest >>= 1) ++levels;
  return levels;
}

/// Returns where a level lies in the array that holds the levels one after the other, level 0 first. For level =
/// hzm_levels(size) the offset is hzm_texels(size).
PGL_HD constexpr HzmLevel hzm_level(const DepthMap& size, std::uint32_t level) {
  detail::assert_is_map(size);
  HzmLevel r{size.width, size.height, 0};
  for (std::uint32_t l = 0; l < level; ++l) {
    r.offset += static_cast<std::uint64_t>(r.width) * r.height;
    r.width = detail::hzm_side(size.width, l + 1);
    r.height = detail::hzm_side(size.height, l + 1);
  }
  return r;
}

/// Returns the number of texels of all levels together.
PGL_HD constexpr std::uint64_t hzm_texels(const DepthMap& size) {
  return hzm_level(size, hzm_levels(size)).offset;
}

/// The farther of two depths.
PGL_HD constexpr Depth farther(Depth a, Depth b) {
  return a > b ? a : b;
}

/// Returns texel (x, y) of the level above one of width x height texels: the farthest of the up to 2 x 2 below it.
/// Precondition: 2 x < width, 2 y < height.
PGL_HD constexpr Depth texel_above(const Depth* below, std::uint32_t width, std::uint32_t height, std::uint32_t x,
                                   std::uint32_t y) {
  const bool right = 2 * x + 1 < width;
  const Depth* row = below + std::size_t{2 * y} * width + 2 * x;
  Depth depth = right ? farther(row[0], row[1]) : row[0];
  if (2 * y + 1 < height) {
    row += width;
    depth = farther(depth, right ? farther(row[0], row[1]) : row[0]);
  }
  return depth;
}

}  // namespace pgl
