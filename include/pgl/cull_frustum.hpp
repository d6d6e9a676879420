// SPDX-License-Identifier: MIT
// View-frustum culling of boxes that never drops a box with a point in the frustum.
#pragma once

#include "pgl/bounds.hpp"
#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// The six half-spaces of a view: p is inside one iff side[i][0]*p.x + side[i][1]*p.y + side[i][2]*p.z + side[i][3] >=
/// 0. In the order left, right, bottom, top, z's lower end, z's upper end.
struct Frustum {
  double side[6][4];  ///< each within half an ulp of the exact sum of two of the matrix's entries
};

/// Returns the half-spaces of a view, once per frame.
/// Precondition: every entry of clip_from_world is finite (if one is not, its half-spaces drop nothing).
PGL_HD inline Frustum frustum_of(const View& view) {
  Frustum f;
  for (int j = 0; j < 4; ++j) {
    const glm::vec4& column = view.clip_from_world[j];
    PGL_ASSERT(ieee::is_finite(column.x) && ieee::is_finite(column.y));
    PGL_ASSERT(ieee::is_finite(column.z) && ieee::is_finite(column.w));
    const double x = column.x, y = column.y, z = column.z, w = column.w;
    f.side[0][j] = ieee::add(w, x);
    f.side[1][j] = ieee::sub(w, x);
    f.side[2][j] = ieee::add(w, y);
    f.side[3][j] = ieee::sub(w, y);
    f.side[4][j] = view.depth_range == DepthRange::zero_to_one ? z : ieee::add(w, z);
    f.side[5][j] = ieee::sub(w, z);
  }
  return f;
}

namespace detail {

/// True only if no point of the box is in the half-space. Precondition: the box has no NaN.
///
/// The largest value is at the corner that the coefficients' signs choose. Coefficients are 0 or from 2^-149 to 2^129
/// in size, coordinates too, so nothing under- or overflows in double, and five roundings (coefficient, product, three
/// sums) err by less than 6 * 2^-53 of the sum of the terms' sizes. 8 * 2^-53 are allowed.
PGL_HD inline bool is_outside(const Box& box, const double* side) {
  const double x = reach(side[0], side[0] < 0.0 ? box.min.x : box.max.x);
  const double y = reach(side[1], side[1] < 0.0 ? box.min.y : box.max.y);
  const double z = reach(side[2], side[2] < 0.0 ? box.min.z : box.max.z);
  const double most = ieee::add(ieee::add(ieee::add(x, y), z), side[3]);
  if (most >= 0.0) return false;
  const double terms = ieee::add(ieee::add(magnitude(x), magnitude(y)), ieee::add(magnitude(z), magnitude(side[3])));
  return most < -ieee::mul(terms, 0x1p-50);  // false for NaN, and where terms are infinite
}

}  // namespace detail

/// Tells whether a box may have a point in the frustum. False is certain: then none has.
///
/// Inside are the points p whose clip = clip_from_world * p, taken in exact real arithmetic with the matrix's entries
/// as they are, satisfies |x| <= w, |y| <= w and -w <= z <= w (or 0 <= z <= w, by View::depth_range); the boundary is
/// inside. Any matrix will do: reversed or infinite far, orthographic, mirrored, singular.
/// A box is dropped when it lies wholly outside one of the six half-spaces, by an upper bound of the half-space's
/// linear function. Boxes that stick out past a corner or edge of the frustum, outside no single half-space, stay:
/// next to none while boxes are small beside the frustum.
/// An empty box is not in view. A box with a NaN side is in view; one with infinite sides is, unless its finite sides
/// put it outside.
/// Source: [Peng13] 4.5.1, which asks for a corner of the box inside and so drops a box larger than the frustum.
PGL_HD inline bool in_frustum(const Box& box, const Frustum& frustum) {
  if (!(box.min.x <= box.max.x && box.min.y <= box.max.y && box.min.z <= box.max.z)) return detail::has_nan(box);
  for (int i = 0; i < 6; ++i)
    if (detail::is_outside(box, frustum.side[i])) return false;
  return true;
}
PGL_HD inline bool in_frustum(const Box& box, const View& view) {
  return in_frustum(box, frustum_of(view));
}

}  // namespace pgl
