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

/// What project takes from a view, once for all boxes: the rows of clip_from_world as doubles, and how the quotient of
/// the third and the fourth becomes a window depth.
struct ViewRows {
  double row[4][4];    ///< [row][column]; the third turned round for a view with reversed depth
  double error[4][4];  ///< of their sizes, 2^-50
  double full[2];      ///< width, height
  double half[2];
  double depth_shift;  ///< window depth = (quotient + shift) * scale
  double depth_scale;
  bool w_falls[3];  ///< w is less at the upper end of this axis
  float near_depth;
};

PGL_HD inline ViewRows rows_of(const View& view) {
  PGL_ASSERT(view.width > 0.0f && ieee::is_finite(view.width) && view.height > 0.0f && ieee::is_finite(view.height));
  PGL_ASSERT(view.near_depth > 0.0f && ieee::is_finite(view.near_depth));
  const bool reversed = view.depth_order == DepthOrder::reversed;
  ViewRows r;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) {
      const double entry = view.clip_from_world[column][row];
      r.row[row][column] = row == 2 && reversed ? -entry : entry;
      r.error[row][column] = ieee::mul(magnitude(entry), 0x1p-50);
    }
  r.full[0] = view.width;
  r.full[1] = view.height;
  for (int axis = 0; axis < 2; ++axis) r.half[axis] = ieee::mul(r.full[axis], 0.5);
  const bool from_minus_one = view.depth_range == DepthRange::minus_one_to_one;
  r.depth_shift = from_minus_one || reversed ? 1.0 : 0.0;
  r.depth_scale = from_minus_one ? 0.5 : 1.0;
  for (int axis = 0; axis < 3; ++axis) r.w_falls[axis] = r.row[3][axis] < 0.0;
  r.near_depth = view.near_depth;
  return r;
}

/// A box as its ends along each axis in the order of w: no corner has a lesser w than the one of the first ends, and
/// none a greater than the one of the last.
struct SortedBox {
  double x[2];
  double y[2];
  double z[2];
  double size[3];  ///< the sum of the sizes of an axis' ends
};

PGL_HD inline SortedBox sorted_by_w(const Box& box, const ViewRows& view) {
  SortedBox r;
  r.x[0] = view.w_falls[0] ? box.max.x : box.min.x;
  r.x[1] = view.w_falls[0] ? box.min.x : box.max.x;
  r.y[0] = view.w_falls[1] ? box.max.y : box.min.y;
  r.y[1] = view.w_falls[1] ? box.min.y : box.max.y;
  r.z[0] = view.w_falls[2] ? box.max.z : box.min.z;
  r.z[1] = view.w_falls[2] ? box.min.z : box.max.z;
  r.size[0] = ieee::add(magnitude(r.x[0]), magnitude(r.x[1]));
  r.size[1] = ieee::add(magnitude(r.y[0]), magnitude(r.y[1]));
  r.size[2] = ieee::add(magnitude(r.z[0]), magnitude(r.z[1]));
  return r;
}

/// What one row of the matrix gives over a box: its value at the corners, and how far those may be from the truth.
struct RowOverBox {
  double corner[8];  ///< bit 0 chooses x[1], bit 1 y[1], bit 2 z[1]
  double error;      ///< at least |corner[i] - exact| for each; NaN or infinite if the box is not finite
};

/// Products of two floats are exact in double, and nothing under- or overflows. Three sums err by less than 3.1 * 2^-53
/// of the sum of the terms' sizes, which the sum over both ends bounds from above. 8 * 2^-53 are allowed, so that
/// corner[i] - error and corner[i] + error, rounded, are bounds too. Rounding is monotone: the row of w has its least
/// at corner[0] and its greatest at corner[7].
PGL_HD inline RowOverBox row_over_box(const ViewRows& view, int number, const SortedBox& box) {
  const double(&row)[4] = view.row[number];
  const double(&error)[4] = view.error[number];
  const double x0 = ieee::mul(row[0], box.x[0]), x1 = ieee::mul(row[0], box.x[1]);
  const double y0 = ieee::mul(row[1], box.y[0]), y1 = ieee::mul(row[1], box.y[1]);
  const double z0 = ieee::mul(row[2], box.z[0]), z1 = ieee::mul(row[2], box.z[1]);
  const double xy[4] = {ieee::add(x0, y0), ieee::add(x1, y0), ieee::add(x0, y1), ieee::add(x1, y1)};
  const double zw[2] = {ieee::add(z0, row[3]), ieee::add(z1, row[3])};
  RowOverBox r;
  for (int i = 0; i < 8; ++i) r.corner[i] = ieee::add(xy[i & 3], zw[i >> 2]);
  r.error = ieee::add(ieee::add(ieee::mul(error[0], box.size[0]), ieee::mul(error[1], box.size[1])),
                      ieee::add(ieee::mul(error[2], box.size[2]), error[3]));
  return r;
}

/// A box that is wholly before the camera: one over w at its corners, and how far those w may be from the truth, which
/// is at most a third of each. Nothing is before the camera while `is_any` is false.
struct BeforeCamera {
  SortedBox box;
  double inverse[8];
  double error;
  bool is_any = false;
};

/// One over each w. A division for two of them: r = 1 / (a * b) gives 1 / a = r * b and 1 / b = r * a, with three
/// roundings each. 2^-149 < w < 2^259, and the products are in a double's range.
PGL_HD inline void inverses_of(const double (&w)[8], double (&inverse)[8]) {
  for (int i = 0; i < 4; ++i) {
    const double r = ieee::div(1.0, ieee::mul(w[i], w[i + 4]));
    inverse[i] = ieee::mul(r, w[i + 4]);
    inverse[i + 4] = ieee::mul(r, w[i]);
  }
}

/// How far the least or the greatest of the quotients by w at a box's corners, of sizes up to `size`, may be from that
/// over the box. Before the camera a quotient has its extremes at corners. A corner's errs by at most (|q| * w.error +
/// v.error) / w, where w is at least 2/3 of the first corner's; of that by the first corner's w the double is taken.
/// The roundings up to here and in taking q on to pixels or depths make less than 8 * 2^-53 of |q| + 1, of which 16
/// are.
PGL_HD inline double quotient_margin(double size, double v_error, const BeforeCamera& w) {
  const double error = ieee::mul(ieee::add(ieee::mul(size, w.error), v_error), w.inverse[0]);
  return ieee::add(ieee::mul(error, 2.0), ieee::mul(ieee::add(size, 1.0), 0x1p-49));
}

/// The lesser and the greater of two numbers that are not NaN.
PGL_HD inline void sort_two(double a, double b, double& lesser, double& greater) {
  lesser = ieee::min(a, b);
#if defined(__CUDA_ARCH__)
  greater = a < b ? b : a;  // one comparison for both
#else
  greater = ieee::max(a, b);  // one instruction each
#endif
}

/// The rule of project, which leaves what it found of w for more quotients, unless the rectangle is empty or the whole
/// viewport for want of a better.
PGL_HD inline ScreenBox project(const Box& box, const ViewRows& view, BeforeCamera& before) {
  ScreenBox r;
  r.depth = view.near_depth;
  before.is_any = false;
  if (is_empty(box)) return r;

  before.box = sorted_by_w(box, view);
  const RowOverBox w = row_over_box(view, 3, before.box);
  if (ieee::add(w.corner[7], w.error) < 0.0) return r;
  const double least = ieee::sub(w.corner[0], w.error);  // NaN if the error is
  if (!(least > static_cast<double>(view.near_depth) && least >= ieee::mul(w.error, 2.0))) {
    r.x0 = r.y0 = 0.0f;
    r.x1 = static_cast<float>(view.full[0]);
    r.y1 = static_cast<float>(view.full[1]);
    return r;
  }

  before.error = w.error;
  inverses_of(w.corner, before.inverse);
  float low[2], high[2];
  for (int axis = 0; axis < 2; ++axis) {
    const RowOverBox v = row_over_box(view, axis, before.box);
    double least_of[4], most_of[4];
    for (int i = 0; i < 4; ++i) {
      const double a = ieee::mul(v.corner[i], before.inverse[i]);
      const double b = ieee::mul(v.corner[i + 4], before.inverse[i + 4]);
      sort_two(a, b, least_of[i], most_of[i]);
    }
    const double q0 = ieee::min(ieee::min(least_of[0], least_of[1]), ieee::min(least_of[2], least_of[3]));
    const double q1 = ieee::max(ieee::max(most_of[0], most_of[1]), ieee::max(most_of[2], most_of[3]));
    const double margin = ieee::mul(quotient_margin(ieee::max(-q0, q1), v.error, before), view.half[axis]);
    const double p0 = ieee::sub(ieee::mul(ieee::add(q0, 1.0), view.half[axis]), margin);
    const double p1 = ieee::add(ieee::mul(ieee::add(q1, 1.0), view.half[axis]), margin);
    if (p0 > view.full[axis] || p1 < 0.0) return r;
    low[axis] = float_below(ieee::max(p0, 0.0));
    high[axis] = float_above(ieee::min(p1, view.full[axis]));
  }
  r.x0 = low[0];
  r.y0 = low[1];
  r.x1 = high[0];
  r.y1 = high[1];
  r.depth = float_below(least);
  before.is_any = true;
  return r;
}

/// A window depth, from 0 at the near end to 1 at the far one, that nothing of the box is nearer than. The margin is
/// that of the least quotient: it grows by less than |q| does, so that no greater quotient reaches lower with its own.
PGL_HD inline double nearest_window_depth(const ViewRows& view, const BeforeCamera& before) {
  const RowOverBox v = row_over_box(view, 2, before.box);
  double q[8];
  for (int i = 0; i < 8; ++i) q[i] = ieee::mul(v.corner[i], before.inverse[i]);
  for (int n = 4; n > 0; n /= 2)
    for (int i = 0; i < n; ++i) q[i] = ieee::min(q[i], q[i + n]);
  const double from_near = ieee::sub(q[0], quotient_margin(magnitude(q[0]), v.error, before));
  return ieee::mul(ieee::add(from_near, view.depth_shift), view.depth_scale);
}

/// The rules below, for a view taken apart.
PGL_HD inline ScreenBox project(const Box& box, const ViewRows& view) {
  BeforeCamera before;
  return project(box, view, before);
}
PGL_HD inline ScreenBox project(const Box& box, const ViewRows& view, Depth& nearest) {
  BeforeCamera before;
  const ScreenBox r = project(box, view, before);
  nearest = before.is_any ? depth_below(nearest_window_depth(view, before)) : 0;
  return r;
}

}  // namespace detail

/// Projects a box to the viewport: a rectangle that holds it, and a depth that nothing of it is nearer than.
///
/// With clip = clip_from_world * p in exact real arithmetic, the rectangle holds (clip.x / clip.w + 1) * width / 2 and
/// (clip.y / clip.w + 1) * height / 2 of every point p of the box with clip.w >= near_depth that falls on the viewport
/// [0, width] x [0, height], to which it is clamped; depth is at most the least clip.w, and at least near_depth. Both
/// are rounded outwards, by a few parts in 10^15 of the terms in the matrix product and then to the next float.
///
/// A box that comes nearer than near_depth, or cannot be told from one, takes the whole viewport and near_depth; so
/// does a box with a NaN or infinite side. A box that is empty, wholly behind the camera (clip.w < 0) or wholly beside
/// the viewport gives the empty rectangle and near_depth. A point or a box seen edge-on still has a rectangle some ulps
/// wide, unless that falls on the viewport's edge. With an orthographic matrix clip.w, and so the depth, is 1.
/// Preconditions: width, height and near_depth are finite and positive; every entry of clip_from_world is finite.
/// Source: A and D of [Peng13] Eq 2.3, made finite for a camera inside the box.
PGL_HD inline ScreenBox project(const Box& box, const View& view) {
  return detail::project(box, detail::rows_of(view));
}

/// The same, and a Depth that nothing of the box is nearer than: its least window depth, less a few parts in 10^15 of
/// the terms in the matrix product, rounded down. That is 0 for a box that takes the whole viewport because it comes
/// too near, and for one whose rectangle is empty.
PGL_HD inline ScreenBox project(const Box& box, const View& view, Depth& nearest) {
  return detail::project(box, detail::rows_of(view), nearest);
}

/// Returns the rectangle's area in square pixels: at least 0, at most width * height of the viewport that it was
/// clamped to, finite (clamped to the greatest float), 0 for an empty rectangle.
PGL_HD inline float projected_area(const ScreenBox& box) {
  if (!(box.x0 < box.x1 && box.y0 < box.y1)) return 0.0f;
  return ieee::min(ieee::mul(ieee::sub(box.x1, box.x0), ieee::sub(box.y1, box.y0)), FLT_MAX);
}

}  // namespace pgl
