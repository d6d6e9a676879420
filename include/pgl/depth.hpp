// SPDX-License-Identifier: MIT
// Depths as occlusion culling keeps them, and the map that holds one for every texel of the picture.
#pragma once

#include <cstddef>
#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// A window depth in steps of 2^-32: 0 is the near plane, far_depth the far plane, whatever lies beyond, and every
/// texel where nothing was drawn. Larger is always farther, also for a view with reversed depth. An integer, so that
/// least and greatest depths do not depend on an order, and as fine near the far plane as near the eye.
using Depth = std::uint32_t;
inline constexpr Depth far_depth = 0xffffffffu;

/// The least depth that is not nearer (the greatest that is not farther) than a window depth from 0, near, to 1, far.
/// A window depth below 0 or above 1 is taken as 0 or 1; NaN gives far_depth (0): what hides nothing (is never hidden).
PGL_HD constexpr Depth depth_above(double window_depth) {
  if (!(window_depth < 1.0)) return far_depth;
  if (!(window_depth > 0.0)) return 0;
  const double steps = ieee::mul(window_depth, 0x1p32);  // exact: a power of two, and more
  const std::uint64_t whole = static_cast<std::uint64_t>(steps);
  const std::uint64_t up = whole + (static_cast<double>(whole) < steps ? 1 : 0);
  return up < far_depth ? static_cast<Depth>(up) : far_depth;
}
PGL_HD constexpr Depth depth_below(double window_depth) {
  if (!(window_depth > 0.0)) return 0;
  if (!(window_depth < 1.0)) return far_depth;
  return static_cast<Depth>(static_cast<std::uint64_t>(ieee::mul(window_depth, 0x1p32)));
}

/// What of a texel an occluder must cover to be drawn there.
enum class Coverage : std::uint8_t {
  centres,  ///< the centres of all its pixels: enough for a picture with one sample per pixel, at its centre
  whole     ///< every point of it: for pictures with several samples per pixel, wherever they are
};

/// The size of a depth map. Texel (i, j) holds the pixels [i * scale, (i + 1) * scale) x [j * scale, (j + 1) * scale)
/// of the picture, the viewport; row 0 is the lowest, as in OpenGL. Texels are stored row after row.
struct DepthMap {
  std::uint32_t width = 0;   ///< texels, 1 to 65536
  std::uint32_t height = 0;  ///< texels, 1 to 65536
  std::uint32_t scale = 1;   ///< pixels of the picture along a texel's side, at least 1
  Coverage coverage = Coverage::centres;
  friend constexpr bool operator==(const DepthMap&, const DepthMap&) = default;
};

/// Returns the map of a view's whole picture: its width and height over scale, rounded up.
/// Precondition: width and height of the view are whole numbers from 1 to 65536, scale is at least 1.
PGL_HD constexpr DepthMap depth_map_of(const View& view, std::uint32_t scale = 1,
                                       Coverage coverage = Coverage::centres) {
  PGL_ASSERT(view.width >= 1.0f && view.width <= 65536.0f && view.height >= 1.0f && view.height <= 65536.0f);
  PGL_ASSERT(scale >= 1);
  const std::uint32_t width = static_cast<std::uint32_t>(view.width);
  const std::uint32_t height = static_cast<std::uint32_t>(view.height);
  PGL_ASSERT(static_cast<float>(width) == view.width && static_cast<float>(height) == view.height);
  return {(width - 1) / scale + 1, (height - 1) / scale + 1, scale, coverage};
}

}  // namespace pgl
