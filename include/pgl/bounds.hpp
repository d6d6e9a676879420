// SPDX-License-Identifier: MIT
// Axis-aligned boxes: grow, merge, and carry into the world without losing a vertex to rounding.
#pragma once

#include <cmath>
#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

namespace detail {

/// True if a side of the box is NaN: its extent is unknown.
PGL_HD inline bool has_nan(const Box& box) {
  return box.min.x != box.min.x || box.min.y != box.min.y || box.min.z != box.min.z ||  //
         box.max.x != box.max.x || box.max.y != box.max.y || box.max.z != box.max.z;
}

/// The box of unknown extent: NaN on every side.
PGL_HD inline Box unknown_box() {
  Box r;
  r.min.x = r.min.y = r.min.z = r.max.x = r.max.y = r.max.z = ieee::quiet_nan<float>;
  return r;
}

/// The smaller (larger) of two sides, a zero always as +0, so that the order of a reduction leaves no trace.
PGL_HD inline float lower_side(float a, float b) {
  return ieee::add(ieee::min(a, b), 0.0f);
}
PGL_HD inline float upper_side(float a, float b) {
  return ieee::add(ieee::max(a, b), 0.0f);
}

/// The absolute value.
PGL_HD inline double magnitude(double a) {
  return std::fabs(a);
}

/// The least double at or above (greatest at or below) a + b: the rounding error of the sum tells which way it went.
PGL_HD inline double add_above(double a, double b) {
  const double s = ieee::add(a, b), t = ieee::sub(s, a);
  const double error = ieee::add(ieee::sub(a, ieee::sub(s, t)), ieee::sub(b, t));  // exact: a + b = s + error
  return error > 0.0 ? ieee::next_up(s) : s;
}
PGL_HD inline double add_below(double a, double b) {
  return -add_above(-a, -b);
}

/// The least float at or above (greatest at or below) a.
PGL_HD inline float float_above(double a) {
#if defined(__CUDA_ARCH__)
  return __double2float_ru(a);
#else
  const float nearest = ieee::to_float(a);
  const std::uint32_t bits = ieee::to_bits(nearest);
  const std::uint32_t up = bits >> 31 ? ~std::uint32_t{0} : 1u;  // a zero that is below a is +0
  const std::uint32_t is_below = static_cast<double>(nearest) < a;
  return ieee::from_bits<float>(bits + (up & (0u - is_below)));  // without a branch, which could not be foretold
#endif
}
PGL_HD inline float float_below(double a) {
  return -float_above(-a);
}

/// a * side, where nothing times an infinite side is nothing. Exact if a is a float's value.
PGL_HD inline double reach(double a, float side) {
  return a == 0.0 ? 0.0 : ieee::mul(a, static_cast<double>(side));
}

/// The upper end of x*p.x + y*p.y + z*p.z + w over the box, rounded up.
PGL_HD inline float upper_reach(float x, float y, float z, float w, const Box& box) {
  const double px = reach(x, x < 0.0f ? box.min.x : box.max.x);
  const double py = reach(y, y < 0.0f ? box.min.y : box.max.y);
  const double pz = reach(z, z < 0.0f ? box.min.z : box.max.z);
  return float_above(add_above(add_above(add_above(px, py), pz), static_cast<double>(w)));
}

}  // namespace detail

/// Tells whether the box holds no point: min > max in some axis. A box with a NaN side counts as unknown, not as empty.
PGL_HD inline bool is_empty(const Box& box) {
  if (box.min.x <= box.max.x && box.min.y <= box.max.y && box.min.z <= box.max.z) return false;
  return !detail::has_nan(box);
}

/// Grows the box to hold the point as well.
///
/// A point with a coordinate that is NaN or infinite is ignored. Zeros come out as +0. The result of extending by
/// several points does not depend on their order.
/// Precondition: the box is empty with min > max in every axis, as Box{} is, or it holds a point.
PGL_HD inline Box extend(const Box& box, const glm::vec3& point) {
  if (!(ieee::is_finite(point.x) && ieee::is_finite(point.y) && ieee::is_finite(point.z))) return box;
  Box r;
  r.min.x = detail::lower_side(box.min.x, point.x);
  r.min.y = detail::lower_side(box.min.y, point.y);
  r.min.z = detail::lower_side(box.min.z, point.z);
  r.max.x = detail::upper_side(box.max.x, point.x);
  r.max.y = detail::upper_side(box.max.y, point.y);
  r.max.z = detail::upper_side(box.max.z, point.z);
  return r;
}

/// Returns the least box that holds both boxes.
///
/// An empty box adds nothing; the merge of two empty boxes is Box{}. A NaN on any side of either makes every side NaN.
/// Zeros come out as +0. Commutative and associative, so that a reduction gives the same bits in any order.
PGL_HD inline Box merge(const Box& a, const Box& b) {
  if (detail::has_nan(a) || detail::has_nan(b)) return detail::unknown_box();
  const Box p = is_empty(a) ? Box{} : a, q = is_empty(b) ? Box{} : b;
  Box r;
  r.min.x = detail::lower_side(p.min.x, q.min.x);
  r.min.y = detail::lower_side(p.min.y, q.min.y);
  r.min.z = detail::lower_side(p.min.z, q.min.z);
  r.max.x = detail::upper_side(p.max.x, q.max.x);
  r.max.y = detail::upper_side(p.max.y, q.max.y);
  r.max.z = detail::upper_side(p.max.z, q.max.z);
  return r;
}

/// Returns the axis-aligned box of a box carried by an affine transform (see Object), rounded outwards.
///
/// The result holds m*p for every point p of the box in exact arithmetic, and also the vertex as it is gathered for
/// drawing, ((m[0]*p.x + m[1]*p.y) + m[2]*p.z) + m[3] rounded to double at each step and to float at the end: each
/// step is monotone, so the corner that is extreme exactly is extreme there too. Each side is the nearest float on the
/// outer side of a sum of four doubles rounded outwards; where those sums are exact, as with the identity, nothing
/// grows.
/// An empty box gives Box{}. A side beyond float's range is infinite (or the greatest finite float, on the inner side).
/// Infinite sides stay infinite along the axes that they reach. A NaN in the box or in the transform makes every side
/// NaN, which culling keeps.
PGL_HD inline Box transform(const Box& box, const glm::mat4x3& m) {
  if (is_empty(box)) return Box{};
  if (detail::has_nan(box)) return detail::unknown_box();
  Box r;
  r.max.x = detail::upper_reach(m[0].x, m[1].x, m[2].x, m[3].x, box);
  r.max.y = detail::upper_reach(m[0].y, m[1].y, m[2].y, m[3].y, box);
  r.max.z = detail::upper_reach(m[0].z, m[1].z, m[2].z, m[3].z, box);
  r.min.x = -detail::upper_reach(-m[0].x, -m[1].x, -m[2].x, -m[3].x, box);
  r.min.y = -detail::upper_reach(-m[0].y, -m[1].y, -m[2].y, -m[3].y, box);
  r.min.z = -detail::upper_reach(-m[0].z, -m[1].z, -m[2].z, -m[3].z, box);
  return detail::has_nan(r) ? detail::unknown_box() : r;
}

}  // namespace pgl
