// SPDX-License-Identifier: MIT
// The occlusion test of one box: at most four texels of the hierarchical-Z map, and never hidden if it could be seen.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "pgl/build_hzm.hpp"
#include "pgl/config.hpp"
#include "pgl/depth.hpp"
#include "pgl/ieee.hpp"
#include "pgl/project.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// A hierarchical-Z map as the test reads it: the levels of build_hzm and where each begins.
struct Hzm {
  DepthMap size;
  const Depth* texels = nullptr;
  std::uint64_t offsets[most_hzm_levels] = {};
};

/// Returns the map of this size in hzm_texels(size) texels, once per frame.
PGL_HD constexpr Hzm hzm_of(const DepthMap& size, const Depth* texels) {
  Hzm r;
  r.size = size;
  r.texels = texels;
  std::uint64_t offset = 0;
  for (std::uint32_t level = 0, levels = hzm_levels(size); level < levels; ++level) {
    r.offsets[level] = offset;
    offset += std::uint64_t{detail::hzm_side(size.width, level)} * detail::hzm_side(size.height, level);
  }
  return r;
}

/// Texels [x0, x1] x [y0, y1] of one level, both ends included.
struct TexelRange {
  std::uint32_t x0 = 0;
  std::uint32_t y0 = 0;
  std::uint32_t x1 = 0;
  std::uint32_t y1 = 0;
  friend constexpr bool operator==(const TexelRange&, const TexelRange&) = default;
};

namespace detail {

/// The texels along one axis that hold a pixel of [a - 1, b + 1]; false if there are none. Pixels from 2^20 on are in
/// no picture.
PGL_HD constexpr bool covered_along(float a, float b, std::uint32_t texels, std::uint32_t scale, std::uint32_t& first,
                                    std::uint32_t& last) {
  if (!(a <= b && b >= -1.0f && a < 0x1p20f)) return false;
  first = a >= 1.0f ? static_cast<std::uint32_t>(a) - 1 : 0;
  last = b >= 0.0f ? static_cast<std::uint32_t>(ieee::min(b, 0x1p20f)) + 1 : 0;
  if (scale != 1) {
    first /= scale;
    last /= scale;
  }
  if (first >= texels) return false;
  if (last >= texels) last = texels - 1;
  return true;
}

/// The number of bits of a without leading zeros.
PGL_HD constexpr std::uint32_t bit_count(std::uint32_t a) {
#if defined(__CUDA_ARCH__)
  return 32u - static_cast<std::uint32_t>(__clz(static_cast<int>(a)));
#else
  return static_cast<std::uint32_t>(std::bit_width(a));
#endif
}

/// The least level at which texels first..last of level 0 are in at most two: with d = last - first of n bits these are
/// floor(d / 2^l) + 1 or one more, so two at level n, and three at level n - 2, if not more.
PGL_HD constexpr std::uint32_t covering_level(std::uint32_t first, std::uint32_t last) {
  const std::uint32_t level = bit_count(last - first);
  if (level == 0) return 0;
  return (last >> (level - 1)) - (first >> (level - 1)) <= 1 ? level - 1 : level;
}

/// Tells whether all texels of a level that hold the range are nearer.
PGL_HD constexpr bool is_all_nearer(const TexelRange& range, std::uint32_t level, Depth nearest, const Hzm& hzm) {
  const std::size_t width = hzm_side(hzm.size.width, level);
  const Depth* row = hzm.texels + hzm.offsets[level] + (range.y0 >> level) * width;
  for (std::uint32_t y = range.y0 >> level; y <= range.y1 >> level; ++y, row += width)
    for (std::uint32_t x = range.x0 >> level; x <= range.x1 >> level; ++x)
      if (row[x] >= nearest) return false;
  return true;
}

}  // namespace detail

/// Finds the texels of level 0 that a rectangle of the viewport (see ScreenBox) can touch; false if there are none.
///
/// They are those of the pixels [i, i + 1) x [j, j + 1) of the map that the rectangle touches once it is grown by one
/// pixel to each side. Renderers move vertices to a grid, of 1/256 of a pixel or so, and may then cover a pixel centre
/// that the true triangle misses; with the grown rectangle that does not matter. The grid can also
/// take a sample from an occluder whose edge is as near to it as that. The samples around must be covered too, so what
/// is behind can show there only where another occluder begins within a pixel of that edge. A rectangle that is empty,
/// has a NaN or, grown, lies beside the map touches no texel.
PGL_HD constexpr bool covered_texels(const ScreenBox& rectangle, const DepthMap& size, TexelRange& range) {
  return detail::covered_along(rectangle.x0, rectangle.x1, size.width, size.scale, range.x0, range.x1) &&
         detail::covered_along(rectangle.y0, rectangle.y1, size.height, size.scale, range.y0, range.y1);
}

/// Returns the least level at which a range of texels of level 0 lies in at most 2 x 2 texels. Texel i of level 0 lies
/// in texel i >> level of a level.
/// Source: [Peng13] 4.6 takes the level from the length of the square's side, with which it can lie in 3 x 3.
PGL_HD constexpr std::uint32_t covering_level(const TexelRange& range) {
  const std::uint32_t x = detail::covering_level(range.x0, range.x1);
  const std::uint32_t y = detail::covering_level(range.y0, range.y1);
  return x > y ? x : y;
}

/// Tells whether everything at least as far as `nearest` in a rectangle of the viewport is hidden: every depth of level
/// 0 that the rectangle can touch is nearer. True is certain.
///
/// By the farthest of the at most 2 x 2 texels of one level that hold the covered texels. Where these do not tell and
/// `refinement` is not 0, by those that hold them so many levels below, at most 2^(refinement + 1) along each side, up
/// to the first that is not nearer. A rectangle that touches no texel is not hidden.
PGL_HD constexpr bool is_hidden(const ScreenBox& rectangle, Depth nearest, const Hzm& hzm,
                                std::uint32_t refinement = 0) {
  TexelRange range;
  if (nearest == 0 || !covered_texels(rectangle, hzm.size, range)) return false;
  const std::uint32_t level = covering_level(range);
  const std::size_t width = detail::hzm_side(hzm.size.width, level);
  const Depth* texels = hzm.texels + hzm.offsets[level];
  const Depth* low = texels + (range.y0 >> level) * width;
  const Depth* high = texels + (range.y1 >> level) * width;
  const std::uint32_t x0 = range.x0 >> level, x1 = range.x1 >> level;
  if (nearest > farther(farther(low[x0], low[x1]), farther(high[x0], high[x1]))) return true;
  if (refinement == 0 || level == 0) return false;
  return detail::is_all_nearer(range, level > refinement ? level - refinement : 0, nearest, hzm);
}

/// How much farther than the map's depths a box must be to be hidden, 2^-22 of the range from near to far: renderers
/// keep depths in 24 bits, rounded, and may show a surface that lies nearer behind another one than that.
inline constexpr Depth depth_guard = 1u << 10;

namespace detail {

/// The rule below, for a view taken apart.
PGL_HD inline bool is_hidden(const Box& box, const ViewRows& view, const Hzm& hzm, std::uint32_t refinement) {
  Depth nearest = 0;
  const ScreenBox rectangle = project(box, view, nearest);
  return nearest > depth_guard && pgl::is_hidden(rectangle, nearest - depth_guard, hzm, refinement);
}

}  // namespace detail

/// Tells whether a box is hidden by what is in the map. True is certain: no sample of the picture, drawn with exact
/// arithmetic, shows a point of it.
///
/// hzm: the map of the picture's samples as rasterize_depth promises it, none of its depths nearer than the occluders'
/// surface. Not hidden is a box that comes nearer than near_depth or to the near plane, that is empty, behind the
/// camera or beside the viewport (see project), or that has a NaN or infinite side; what cull_frustum should have
/// dropped is left to it. refinement: see above. Preconditions: those of project on the view; hzm.size is depth_map_of
/// the view. Source: [Peng13] 4.6.
PGL_HD inline bool is_hidden(const Box& box, const View& view, const Hzm& hzm, std::uint32_t refinement = 0) {
  return detail::is_hidden(box, detail::rows_of(view), hzm, refinement);
}

}  // namespace pgl
