// SPDX-License-Identifier: MIT
// The rule of reform: which vertex stands for a collapsed one, and which way round a triangle is drawn.
#pragma once

#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// Follows the collapses from vertex v until one of the first `count` vertices is reached, taking one of `steps` for
/// every collapse. Out of steps, it stops where it is: the result is then still >= count.
/// Precondition: ecol[v] < v for every v >= count that is met. [Peng13] Alg 3.
template <class Index>
PGL_HD constexpr Index follow_collapses(const Index* ecol, std::uint32_t count, Index v, std::uint64_t& steps) {
  while (v >= count && steps != 0) {
    PGL_ASSERT(ecol[v] < v);
    v = ecol[v];
    --steps;
  }
  return v;
}

/// Follows the three corners of a triangle side by side, each as follow_collapses does, taking one of `steps` for every
/// round in which one of them moves. Out of steps, it stops where it is: a corner of the result is then still >= count.
/// Corner is Index, or wider. Precondition: as for follow_collapses.
template <class Index, class Corner>
PGL_HD constexpr Triangle<Corner> follow_corners(const Index* ecol, std::uint32_t count, Triangle<Corner> t,
                                                 std::uint32_t& steps) {
  for (; steps != 0 && (t.v[0] >= count || t.v[1] >= count || t.v[2] >= count); --steps) {
    for (Corner& v : t.v) {
      PGL_ASSERT(v < count || ecol[v] < v);
      if (v >= count) v = ecol[v];
    }
  }
  return t;
}

/// Entry v of the table of final vertices: where follow_collapses ends from v with steps enough.
/// Precondition: the table is filled below v.
template <class Index>
PGL_HD constexpr Index final_vertex(const Index* ecol, std::uint32_t count, const Index* table, std::uint32_t v) {
  if (v < count) return static_cast<Index>(v);
  PGL_ASSERT(ecol[v] < v);
  return table[ecol[v]];
}

/// The triangle as it is drawn: corners counted from `base`, and corners 1 and 2 swapped where the object is mirrored,
/// so that its outside stays counter-clockwise. Precondition: the sums fit OutIndex.
template <class OutIndex, class Index>
PGL_HD constexpr Triangle<OutIndex> drawn_triangle(const Triangle<Index>& t, std::uint64_t base, bool mirror) {
  const Index second = mirror ? t.v[2] : t.v[1], third = mirror ? t.v[1] : t.v[2];  // not by index: stays in registers
  return {{static_cast<OutIndex>(base + t.v[0]), static_cast<OutIndex>(base + second),
           static_cast<OutIndex>(base + third)}};
}

namespace detail {

/// Adds b to the sum of e[0 .. size), exactly: size + 1 parts that do not overlap, the largest last.
/// Shewchuk, *Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates*, 1997, Fig 6.
PGL_HD constexpr void grow_expansion(double* e, int size, double b) {
  for (int i = 0; i < size; ++i) {
    const double sum = ieee::add(b, e[i]);
    const double part = ieee::sub(sum, b);
    e[i] = ieee::add(ieee::sub(b, ieee::sub(sum, part)), ieee::sub(e[i], part));
    b = sum;
  }
  e[size] = b;
}

}  // namespace detail

/// Tells whether a transform turns the mesh inside out: the determinant of its linear part is negative.
///
/// The sign is that of the exact determinant, for any finite entries. A singular transform is not mirrored, nor is one
/// with a NaN or an infinity in its linear part. The translation does not matter. Constant time; the slow, exact sum is
/// only taken when the determinant in double is within its rounding error of zero.
PGL_HD inline bool mirrored(const glm::mat4x3& m) {
  const float a[3][3] = {{m[0].x, m[0].y, m[0].z}, {m[1].x, m[1].y, m[1].z}, {m[2].x, m[2].y, m[2].z}};

  // Six products of three floats: exact as pair (a double) times single, and neither too large nor too small for
  // double.
  double pair[6];
  double single[6];
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    pair[2 * i] = ieee::mul(static_cast<double>(a[1][j]), static_cast<double>(a[2][k]));
    pair[2 * i + 1] = -ieee::mul(static_cast<double>(a[1][k]), static_cast<double>(a[2][j]));
    single[2 * i] = single[2 * i + 1] = static_cast<double>(a[0][i]);
  }
  double determinant = 0.0;
  double magnitude = 0.0;
  for (int i = 0; i < 6; ++i) {
    const double term = ieee::mul(pair[i], single[i]);
    determinant = ieee::add(determinant, term);
    magnitude = ieee::add(magnitude, term < 0.0 ? -term : term);
  }
  if (!ieee::is_finite(magnitude)) return false;
  // Each term and each of the five sums is off by at most 2^-53 of the magnitude: six in all, and 2^-50 is eight.
  const double error = ieee::mul(magnitude, 0x1p-50);
  if (determinant < -error) return true;
  if (determinant > error) return false;

  double e[12] = {};
  for (int i = 0; i < 6; ++i) {
    const double term = ieee::mul(pair[i], single[i]);
    detail::grow_expansion(e, 2 * i, ieee::fma(pair[i], single[i], -term));
    detail::grow_expansion(e, 2 * i + 1, term);
  }
  for (int i = 11; i >= 0; --i) {
    if (e[i] != 0.0) return e[i] < 0.0;
  }
  return false;
}

}  // namespace pgl
