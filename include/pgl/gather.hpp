// SPDX-License-Identifier: MIT
// The rule of gather: how one vertex of a mesh becomes a vertex in the world, with the same bits everywhere.
#pragma once

#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

namespace detail {

/// One coordinate of a transformed point: the products of two floats are exact in double, the sums are rounded.
PGL_HD constexpr float transform_row(float mx, float my, float mz, float mw, const glm::vec3& p) {
  const double x = ieee::mul(static_cast<double>(mx), static_cast<double>(p.x));
  const double y = ieee::mul(static_cast<double>(my), static_cast<double>(p.y));
  const double z = ieee::mul(static_cast<double>(mz), static_cast<double>(p.z));
  return ieee::to_float(ieee::add(ieee::add(ieee::add(x, y), z), static_cast<double>(mw)));
}

}  // namespace detail

/// Tells whether a transform leaves every point where it is: equal to glm::mat4x3(1), where -0 counts as 0.
PGL_HD constexpr bool is_identity(const glm::mat4x3& m) {
  // Counted, not chained by &&: without branches a compiler can take it out of the loop over the points.
  int same = 0;
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) same += m[column][row] == (column == row ? 1.0f : 0.0f) ? 1 : 0;
  }
  return same == 12;
}

/// Applies an affine transform to a point: ((m[0]*p.x + m[1]*p.y) + m[2]*p.z) + m[3], in double, rounded once to float.
///
/// Each coordinate r of the result, of exact value e and with S the sum of the magnitudes of its four terms, obeys
/// |r - e| <= 2^-24 |e| + 2^-51 S + 2^-150 while |e| is below the largest float: half a unit in the last place, unless
/// the terms cancel to less than about 2^-27 of S. Larger results become infinite, tiny ones subnormal.
///
/// The identity gives back p bit for bit, whatever p is; otherwise a zero result is +0 unless every term is -0, and a
/// NaN or an infinity in p or m spreads by the rules of IEEE-754 (0 times infinity is NaN).
PGL_HD constexpr glm::vec3 transform_point(const glm::mat4x3& m, const glm::vec3& p) {
  if (is_identity(m)) return p;
  return {detail::transform_row(m[0].x, m[1].x, m[2].x, m[3].x, p),
          detail::transform_row(m[0].y, m[1].y, m[2].y, m[3].y, p),
          detail::transform_row(m[0].z, m[1].z, m[2].z, m[3].z, p)};
}

/// A vertex as the viewer draws it: where it is in the world, and whose it is.
struct PlacedVertex {
  glm::vec3 position;
  std::uint32_t object = 0;  ///< index of the object in the scene
  friend bool operator==(const PlacedVertex&, const PlacedVertex&) = default;
};

/// Places one vertex of a mesh in the world as a part of object number `index`.
///
/// gather calls place(object, index, vertex, placed) without a namespace, so a payload of your own needs no more than
/// an overload beside it: `void place(const pgl::Object&, std::uint32_t, const MyVertex&, MyPlacedVertex&)` in the
/// namespace of MyVertex or MyPlacedVertex. It must write `placed` and nothing else.
PGL_HD constexpr void place(const Object& object, std::uint32_t, const glm::vec3& vertex, glm::vec3& placed) {
  placed = transform_point(object.transform, vertex);
}
PGL_HD constexpr void place(const Object& object, std::uint32_t index, const glm::vec3& vertex, PlacedVertex& placed) {
  placed.position = transform_point(object.transform, vertex);
  placed.object = index;
}

}  // namespace pgl
