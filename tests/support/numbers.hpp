// SPDX-License-Identifier: MIT
// RapidCheck generators of the floats, boxes, points and views that geometry properties are tried with.
#pragma once

#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>

#include "pgl/types.hpp"

namespace numbers {

/// An integer in [low, high], as likely large in the first trials as in the last.
inline int whole(int low, int high) {
  return *rc::gen::resize(rc::kNominalSize, rc::gen::inRange(low, high + 1));
}

/// Which floats to draw.
enum class Kind {
  small,  ///< integers from -6 to 6: exact ties and touching are common
  plain,  ///< 24 random bits in (-1, 1)
  wide,   ///< 24 random bits, sizes from 1e-30 to 1e30, also 0
};

inline Kind kind() {
  return static_cast<Kind>(whole(0, 2));
}

inline float number(Kind k) {
  if (k == Kind::small) return static_cast<float>(whole(-6, 6));
  const float bits = static_cast<float>(whole(-0xffffff, 0xffffff));
  if (k == Kind::plain) return bits * 0x1p-24f;
  return whole(0, 9) == 0 ? 0.0f : std::ldexp(bits, whole(-123, 75));
}

/// Coordinates that are now and then not finite, or a zero of either sign.
inline float any_number(Kind k) {
  constexpr float special[] = {0.0f, -0.0f, std::numeric_limits<float>::infinity(),
                               -std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()};
  return whole(0, 9) == 0 ? special[whole(0, 4)] : number(k);
}

inline glm::vec3 point(Kind k) {
  const float x = number(k), y = number(k), z = number(k);
  return {x, y, z};
}

/// A box around the point: at least the point itself, often flat in some axes.
inline pgl::Box box_around(const glm::vec3& p, Kind k) {
  pgl::Box box{p, p};
  for (int axis = 0; axis < 3; ++axis) {
    if (whole(0, 2) > 0) box.min[axis] = std::min(p[axis], number(k));
    if (whole(0, 2) > 0) box.max[axis] = std::max(p[axis], number(k));
  }
  return box;
}

inline pgl::Box box(Kind k) {
  return box_around(point(k), k);
}

/// A point of the box: each coordinate at an end or between.
inline glm::vec3 point_in(const pgl::Box& box) {
  glm::vec3 p;
  for (int axis = 0; axis < 3; ++axis) {
    const double t = std::max(0.0, std::min(1.0, whole(-8, 24) / 16.0));
    const double c = (1 - t) * static_cast<double>(box.min[axis]) + t * static_cast<double>(box.max[axis]);
    p[axis] = std::clamp(static_cast<float>(c), box.min[axis], box.max[axis]);
  }
  return p;
}

/// Any affine transform with finite entries: singular, mirrored and far from rigid ones too.
inline glm::mat4x3 any_affine() {
  const Kind k = kind();
  glm::mat4x3 m;
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 3; ++row) m[column][row] = number(k);
  return m;
}

/// A camera at a random place, far or near, at any scale of the world; or, one time in two, any matrix at all.
inline pgl::View view(Kind k) {
  pgl::View v;
  v.width = static_cast<float>(whole(1, 4096));
  v.height = static_cast<float>(whole(1, 4096));
  v.depth_range = whole(0, 1) ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
  v.near_depth = std::ldexp(1.0f, whole(-20, 0));
  if (whole(0, 1)) {
    for (int column = 0; column < 4; ++column)
      for (int row = 0; row < 4; ++row) v.clip_from_world[column][row] = number(k);
    const int special = whole(0, 7);
    for (int column = 0; column < 4; ++column) {
      glm::vec4& c = v.clip_from_world[column];
      if (special == 0) c.x = c.w;                              // the boundary everywhere
      if (special == 1) c.w = 0;                                // nothing or a line or a plane inside
      if (special == 2) c.y = -c.x;                             // singular
      if (special == 3) c.w = column == 3 ? std::abs(c.w) : 0;  // parallel projection
      if (special == 4) c = glm::vec4(0);                       // everything inside
      if (special == 5 && column < 3) c *= 0x1p-40f;            // far away
    }
    return v;
  }
  const float scale = k == Kind::wide ? std::ldexp(1.0f, whole(-90, 90)) : k == Kind::small ? 8.0f : 1.0f;
  const float nearest = scale * std::ldexp(1.0f, whole(-14, 0)), farthest = nearest * std::ldexp(1.5f, whole(0, 14));
  v.near_depth = nearest;
  glm::mat4 projection(0.0f);  // x and y may be skewed; z by case
  projection[0].x = std::ldexp(1.0f, whole(-3, 6));
  projection[1].y = std::ldexp(1.25f, whole(-3, 6));
  projection[2].x = 0.25f * number(Kind::small);
  projection[2].w = -1;
  const int depth = whole(0, 3);
  if (depth == 0) {  // reversed, infinite far
    projection[3].z = nearest;
  } else if (depth == 1) {  // reversed
    projection[2].z = nearest / (farthest - nearest);
    projection[3].z = farthest * nearest / (farthest - nearest);
  } else {
    projection[2].z = (farthest + nearest) / (nearest - farthest);
    projection[3].z = 2 * farthest * nearest / (nearest - farthest);
  }
  if (whole(0, 5) == 0) projection[0].x = -projection[0].x;  // mirrored
  const glm::vec3 eye = scale * point(Kind::plain);
  const glm::vec3 direction = point(Kind::plain) + glm::vec3(0.0f, 0.0f, 1e-3f);
  v.clip_from_world =
      projection * glm::lookAt(glm::vec3(0), direction, glm::vec3(0.1f, 1, 0.2f)) * glm::translate(glm::mat4(1), -eye);
  // Where the numbers ran out of float's range, another camera.
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 4; ++row)
      if (!std::isfinite(v.clip_from_world[column][row])) v.clip_from_world[column][row] = 1;
  return v;
}

/// A point near which the view's frustum may be: of the view's scale, often behind, beside or beyond.
inline glm::vec3 point_near(const pgl::View& v, Kind k) {
  const glm::dmat4 m(v.clip_from_world);
  const double w = static_cast<double>(v.near_depth) * std::ldexp(1.0, whole(0, 16));
  const glm::dvec4 clip(w * whole(-20, 20) / 16, w * whole(-20, 20) / 16, w * whole(-20, 20) / 16, w);
  const glm::dvec4 p = glm::inverse(m) * clip;
  const glm::vec3 q(glm::dvec3(p) / p.w);
  const bool usable = std::isfinite(q.x) && std::isfinite(q.y) && std::isfinite(q.z);
  return usable && whole(0, 7) > 0 ? q : point(k);
}

/// A box near the view's frustum, from a point to several times its distance from the origin of clip space.
inline pgl::Box box_near(const pgl::View& v, Kind k) {
  if (whole(0, 3) == 0) return box(k);
  const glm::vec3 p = point_near(v, k), q = point_near(v, k);
  pgl::Box b{p, p};
  const float t = std::ldexp(1.0f, whole(-12, 0));
  for (int axis = 0; axis < 3; ++axis) {
    const float c = p[axis] + (q[axis] - p[axis]) * t;
    if (!std::isfinite(c)) continue;
    b.min[axis] = std::min(p[axis], c);
    b.max[axis] = std::max(p[axis], c);
  }
  return b;
}

}  // namespace numbers
