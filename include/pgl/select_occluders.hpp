// SPDX-License-Identifier: MIT
// The rule of choosing occluders: which objects hide the most behind their largest faces.
#pragma once

#include <cfloat>
#include <cstdint>

#include "pgl/build_ecol.hpp"
#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/oriented_box.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// What an object shows as an occluder: the largest face of its oriented box, in the world.
struct OccluderFace {
  glm::vec3 centre{0.0f};  ///< of the box
  /// Of the face, as long as the square root of its area, so that it never leaves float's range.
  glm::vec3 normal{0.0f};
  float compactness = 0.0f;  ///< of the mesh, 0 to 1
  friend bool operator==(const OccluderFace&, const OccluderFace&) = default;
};

/// Returns the largest face of a mesh's oriented box carried by an object's transform; of equal ones, that of axes[2],
/// then axes[1]. An empty box gives OccluderFace{}, whose weight is 0; where a number is not finite, or leaves float's
/// range, centre and normal are quiet_nan, and the face is never selected.
PGL_HD inline OccluderFace occluder_face(const OrientedBox& box, float compactness, const glm::mat4x3& m) {
  OccluderFace face;
  if (is_empty(box)) return face;
  const auto carry = [&m](const glm::vec3& v) {
    Vector<double> r;
    for (int row = 0; row < 3; ++row)
      r[row] = ieee::add(ieee::add(ieee::mul(static_cast<double>(m[0][row]), static_cast<double>(v.x)),
                                   ieee::mul(static_cast<double>(m[1][row]), static_cast<double>(v.y))),
                         ieee::mul(static_cast<double>(m[2][row]), static_cast<double>(v.z)));
    return r;
  };
  Vector<double> side[3];  // the box's sides
  for (int k = 0; k < 3; ++k) {
    side[k] = carry(box.axes[k]);
    const double length = ieee::mul(static_cast<double>(box.half[k]), 2.0);
    for (int i = 0; i < 3; ++i) side[k][i] = ieee::mul(side[k][i], length);
  }
  Vector<double> largest{0.0, 0.0, 0.0};
  double most = -1.0;
  for (int k = 2; k >= 0; --k) {
    const Vector<double> area = cross_product(side[k == 2 ? 0 : k + 1], side[k == 0 ? 2 : k - 1]);
    const double square = dot_product(area, area);
    if (!(square <= most)) {
      most = square;
      largest = area;
    }
  }
  const Vector<double> centre = carry(box.centre);
  const double length = ieee::sqrt(most), root = ieee::sqrt(length);  // root * root = the area
  for (int i = 0; i < 3; ++i) {
    face.centre[i] = ieee::to_float(ieee::add(centre[i], static_cast<double>(m[3][i])));
    face.normal[i] = most == 0.0 ? 0.0f : ieee::add(ieee::to_float(ieee::div(largest[i], root)), 0.0f);
  }
  face.compactness = compactness;
  if (!(detail::is_finite_point(face.centre) && detail::is_finite_point(face.normal)))
    for (int i = 0; i < 3; ++i) face.centre[i] = face.normal[i] = ieee::quiet_nan<float>;
  return face;
}

/// Packs the order of compactness into an integer: the larger, the more compact. NaN is the least, and -0 is 0.
PGL_HD constexpr std::uint32_t compactness_key(float compactness) {
  return compactness != compactness ? 0u : ieee::order_key(ieee::add(compactness, 0.0f));
}

/// Where a view is seen from: with w = 1 the point (x, y, z); with w = 0 from far away along (x, y, z).
struct Eye {
  double x, y, z, w;
};

/// Returns the eye of a view, once per frame: the point that has no place on the screen, where the rows x, y and w of
/// clip_from_world all vanish. An orthographic view has w = 0 and a direction whose largest component is in [1, 2). All
/// zero where the rows are no view at all.
PGL_HD inline Eye eye_of(const View& view) {
  const auto entry = [&view](int row, int column) { return static_cast<double>(view.clip_from_world[column][row]); };
  // The minors of the three rows: delete one column.
  const auto minor = [&entry](int a, int b, int c) {
    const Vector<double> p{entry(0, a), entry(0, b), entry(0, c)}, q{entry(1, a), entry(1, b), entry(1, c)},
        r{entry(3, a), entry(3, b), entry(3, c)};
    return dot_product(p, cross_product(q, r));
  };
  const double x = minor(1, 2, 3), y = -minor(0, 2, 3), z = minor(0, 1, 3), w = -minor(0, 1, 2);
  if (w != 0.0) return {ieee::div(x, w), ieee::div(y, w), ieee::div(z, w), 1.0};
  const double largest = ieee::max(ieee::max(detail::magnitude(x), detail::magnitude(y)), detail::magnitude(z));
  if (!(largest > 0.0)) return {0.0, 0.0, 0.0, 0.0};
  const double scale = ieee::from_bits<double>(ieee::to_bits(largest) & 0x7ff0000000000000u);  // a power of two
  return {ieee::div(x, scale), ieee::div(y, scale), ieee::div(z, scale), 0.0};
}

/// Weighs an object as an occluder: its compactness times about the solid angle of its largest face where that is
/// small; where it is not, growing more slowly, up to 1 for a face that the eye touches.
///
/// With t from the box's centre to the eye, A the area of the face and a its unit normal,
/// weight = compactness * A |a . t| / (|t| (|t|^2 + A)): our reading of [Peng13] Eq 4.2, made finite for an eye inside
/// the box. It is 0 where |t| < 2^-250, as at t = 0, or |t| > 2^250, where it is too small for a float. For an
/// orthographic view t is the direction to the eye, and weight = sqrt(compactness * A |a . t| / |t|): the root of what
/// the face covers, to scale.
/// At least 0, and finite, for a face with finite numbers; NaN, which is never selected, for others.
/// Source: [Peng13] Eq 4.2.
PGL_HD inline float occluder_weight(const OccluderFace& face, const Eye& eye) {
  if (!(detail::is_finite_point(face.normal) && detail::is_finite_point(face.centre) &&
        ieee::is_finite(face.compactness)))
    return ieee::quiet_nan<float>;
  const Vector<double> n(face.normal);
  const Vector<double> c(face.centre);
  const bool far = eye.w == 0.0;
  Vector<double> t{eye.x, eye.y, eye.z};
  if (!far)
    for (int i = 0; i < 3; ++i) t[i] = ieee::sub(t[i], c[i]);
  const double area = dot_product(n, n), square = dot_product(t, t);
  if (!(square >= 0x1p-500 && square <= 0x1p500)) return 0.0f;
  // |n| |n . t| = A |a . t|, here times compactness and |t|. Nothing below leaves double's range: a normal and a
  // compactness that are not 0 have at least 2^-149, so that the divisor is at least 2^-798 where the area is not 0.
  const double facing =
      ieee::mul(ieee::mul(static_cast<double>(face.compactness), detail::magnitude(dot_product(n, t))),
                ieee::sqrt(ieee::mul(area, square)));
  double weight = ieee::div(facing, far ? square : ieee::mul(square, ieee::add(square, area)));
  if (far) weight = ieee::sqrt(weight);
  return weight > 0.0 ? ieee::min(ieee::to_float(weight), FLT_MAX) : 0.0f;
}

/// Packs the total order of the candidates into an integer: the larger key is the heavier one; among equal weights the
/// one with the lower index. A NaN weight has key 0, and no other has.
/// Precondition: the weight is NaN or at least +0; object is not no_object.
PGL_HD constexpr std::uint64_t occluder_key(float weight, std::uint32_t object) {
  return weight != weight ? 0u : (static_cast<std::uint64_t>(ieee::order_key(weight)) << 32) | (~object & 0xffffffffu);
}

}  // namespace pgl
