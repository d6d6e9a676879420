// SPDX-License-Identifier: MIT
// The pixels that a box can cover and the nearest depth that it can have, never too small and never too far.
#pragma once

#include <cfloat>

#include "pgl/bounds.hpp"
#include "pgl/config.hpp"
#include "pgl/depth.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// A rectangle of the viewport and a depth. Window coordinates as in OpenGL: pixels, the origin at the lower left, y
/// up; pixel (i, j) is [i, i + 1] x [j, j + 1]. The default is the empty rectangle, x0 > x1 and y0 > y1.
struct ScreenBox {
  float x0 = ieee::infinity<float>;
  float y0 = ieee::infinity<float>;
  float x1 = -ieee::infinity<float>;
  float y1 = -ieee::infinity<float>;
  float depth = ieee::infinity<float>;  ///< clip w
  friend constexpr bool operator==(const ScreenBox&, const ScreenBox&) = default;
};

namespace detail {

/// What one row of the matrix gives over a box: its value at the corners, and how far those may be from the truth.
struct RowOverBox {
  double corner[8];  ///< bit 0 chooses max.x, bit 1 max.y, bit 2 max.z
  double error;      ///< at least |corner[i] - exact| for each; NaN or infinite if the box is not finite
};

/// Products of two floats are exact in double, and nothing under- or overflows. Three sums err by less than 3.1 * 2^-53
/// of the sum of the terms' sizes, which the sum over both ends bounds from above. 8 * 2^-53 are allowed, so that
/// corner[i] - error and corner[i] + error, rounded, are bounds too.
PGL_HD inline RowOverBox row_over_box(const glm::mat4& m, int row, const Box& box) {
  const double ax = m[0][row], ay = m[1][row], az = m[2][row], aw = m[3][row];
  const double x0 = ieee::mul(ax, static_cast<double>(box.min.x)), x1 = ieee::mul(ax, static_cast<double>(box.max.x));
  const double y0 = ieee::mul(ay, static_cast<double>(box.min.y)), y1 = ieee::mul(ay, static_cast<double>(box.max.y));
  const double z0 = ieee::mul(az, static_cast<double>(box.min.z)), z1 = ieee::mul(az, static_cast<double>(box.max.z));
  RowOverBox r;
  for (int i = 0; i < 8; ++i)
    r.corner[i] = ieee::add(ieee::add(ieee::add(i & 1 ? x1 : x0, i & 2 ? y1 : y0), i & 4 ? z1 : z0), aw);
  const double x = ieee::add(magnitude(x0), magnitude(x1));
  const double y = ieee::add(magnitude(y0), magnitude(y1));
  const double z = ieee::add(magnitude(z0), magnitude(z1));
  r.error = ieee::mul(ieee::add(ieee::add(x, y), ieee::add(z, magnitude(aw))), 0x1p-50);
  return r;
}

/// A box that is wholly before the camera: one over w at its corners, how far those w may be from the truth, and a
/// lower bound of the box's w. Nothing is before the camera while `least` is 0.
struct BeforeCamera {
  double inverse[8];
  double error;
  double least = 0.0;
};

/// The extremes over a box's corners of a row's value by w, and how far they may be from those over the box.
struct QuotientRange {
  double low;
  double high;
  double margin;  ///< also for up to six roundings by 2^-53 of the quotient's size + 1, two of which are done
};

/// Before the camera a quotient by w has its extremes at corners. A corner's quotient q errs by at most (|q| * w.error
/// + v.error) / w, of which the double is taken, and the roundings up to here and in taking q on to pixels or depths
/// make less than 6 * 2^-53 of |q| + 1, of which 8 are.
PGL_HD inline QuotientRange quotient_range(const glm::mat4& m, int row, const Box& box, const BeforeCamera& w) {
  const RowOverBox v = row_over_box(m, row, box);
  QuotientRange r;
  r.low = r.high = ieee::mul(v.corner[0], w.inverse[0]);
  for (int i = 1; i < 8; ++i) {
    const double q = ieee::mul(v.corner[i], w.inverse[i]);
    r.low = ieee::min(q, r.low);
    r.high = ieee::max(q, r.high);
  }
  const double size = ieee::max(-r.low, r.high);  // the largest |q|
  const double error = ieee::div(ieee::add(ieee::mul(size, w.error), v.error), w.least);
  r.margin = ieee::add(ieee::mul(error, 2.0), ieee::mul(ieee::add(size, 1.0), 0x1p-50));
  return r;
}

/// The rule of project, which leaves what it found of w for more quotients; w.least is 0 where the rectangle is empty
/// or the whole viewport for want of a better.
PGL_HD inline ScreenBox project(const Box& box, const View& view, BeforeCamera& before) {
  PGL_ASSERT(view.width > 0.0f && ieee::is_finite(view.width) && view.height > 0.0f && ieee::is_finite(view.height));
  PGL_ASSERT(view.near_depth > 0.0f && ieee::is_finite(view.near_depth));
  before.least = 0.0;
  ScreenBox r;
  r.depth = view.near_depth;
  if (is_empty(box)) return r;

  const RowOverBox w = row_over_box(view.clip_from_world, 3, box);
  double least = w.corner[0], most = w.corner[0];
  for (int i = 1; i < 8; ++i) {
    least = ieee::min(w.corner[i], least);
    most = ieee::max(w.corner[i], most);
  }
  if (ieee::add(most, w.error) < 0.0) return r;
  least = ieee::sub(least, w.error);  // NaN if the error is
  if (!(least > static_cast<double>(view.near_depth))) {
    r.x0 = r.y0 = 0.0f;
    r.x1 = view.width;
    r.y1 = view.height;
    return r;
  }

  before.error = w.error;
  before.least = least;
  for (int i = 0; i < 8; ++i) before.inverse[i] = ieee::div(1.0, w.corner[i]);
  float low[2], high[2];
  for (int axis = 0; axis < 2; ++axis) {
    const QuotientRange q = quotient_range(view.clip_from_world, axis, box, before);
    const double full = axis == 0 ? view.width : view.height, half = ieee::mul(full, 0.5);
    const double p0 = ieee::sub(ieee::mul(ieee::add(q.low, 1.0), half), ieee::mul(q.margin, half));
    const double p1 = ieee::add(ieee::mul(ieee::add(q.high, 1.0), half), ieee::mul(q.margin, half));
    if (p0 > full || p1 < 0.0) {
      before.least = 0.0;
      return r;
    }
    low[axis] = float_below(ieee::max(p0, 0.0));
    high[axis] = float_above(ieee::min(p1, full));
  }
  r.x0 = low[0];
  r.y0 = low[1];
  r.x1 = high[0];
  r.y1 = high[1];
  r.depth = float_below(least);
  return r;
}

/// A window depth, from 0 at the near end to 1 at the far one, that nothing of the box is nearer than.
PGL_HD inline double nearest_window_depth(const Box& box, const View& view, const BeforeCamera& before) {
  const QuotientRange q = quotient_range(view.clip_from_world, 2, box, before);
  const bool reversed = view.depth_order == DepthOrder::reversed;
  const double from_near = ieee::sub(reversed ? -q.high : q.low, q.margin);  // least z / w, or least -z / w
  if (view.depth_range == DepthRange::minus_one_to_one) return ieee::mul(ieee::add(from_near, 1.0), 0.5);
  return reversed ? ieee::add(from_near, 1.0) : from_near;
}

}  // namespace detail

/// Projects a box to the viewport: a rectangle that holds it, and a depth that nothing of it is nearer than.
///
/// With clip = clip_from_world * p in exact real arithmetic, the rectangle holds (clip.x / clip.w + 1) * width / 2 and
/// (clip.y / clip.w + 1) * height / 2 of every point p of the box with clip.w >= near_depth that falls on the viewport
/// [0, width] x [0, height], to which it is clamped; depth is at most the least clip.w, and at least near_depth. Both
/// are rounded outwards, by a few parts in 10^16 of the terms in the matrix product and then to the next float.
///
/// A box that comes nearer than near_depth, or cannot be told from one, takes the whole viewport and near_depth; so
/// does a box with a NaN or infinite side. A box that is empty, wholly behind the camera (clip.w < 0) or wholly beside
/// the viewport gives the empty rectangle and near_depth. A point or a box seen edge-on still has a rectangle some ulps
/// wide, unless that falls on the viewport's edge. With an orthographic matrix clip.w, and so the depth, is 1.
/// Preconditions: width, height and near_depth are finite and positive; every entry of clip_from_world is finite.
/// Source: A and D of [Peng13] Eq 2.3, made finite for a camera inside the box.
PGL_HD inline ScreenBox project(const Box& box, const View& view) {
  detail::BeforeCamera before;
  return detail::project(box, view, before);
}

/// The same, and a Depth that nothing of the box is nearer than: its least window depth, less a few parts in 10^16 of
/// the terms in the matrix product, rounded down. That is 0 for a box that takes the whole viewport because it comes
/// too near, and for one whose rectangle is empty.
PGL_HD inline ScreenBox project(const Box& box, const View& view, Depth& nearest) {
  detail::BeforeCamera before;
  const ScreenBox r = detail::project(box, view, before);
  nearest = before.least > 0.0 ? depth_below(detail::nearest_window_depth(box, view, before)) : 0;
  return r;
}

/// Returns the rectangle's area in square pixels: at least 0, at most width * height of the viewport that it was
/// clamped to, finite (clamped to the greatest float), 0 for an empty rectangle.
PGL_HD inline float projected_area(const ScreenBox& box) {
  if (!(box.x0 < box.x1 && box.y0 < box.y1)) return 0.0f;
  return ieee::min(ieee::mul(ieee::sub(box.x1, box.x0), ieee::sub(box.y1, box.y0)), FLT_MAX);
}

}  // namespace pgl
