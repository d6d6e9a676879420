// SPDX-License-Identifier: MIT
// The rule of oriented boxes: a small box of any orientation around a mesh, and how much of it the mesh fills.
#pragma once

#include <cfloat>
#include <cstdint>

#include "pgl/bounds.hpp"
#include "pgl/build_ecol.hpp"
#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// A box of any orientation: the points p with |axes[i] . (p - centre)| <= half[i] for each i, in exact arithmetic.
///
/// The axes are unit vectors at right angles, up to a rounding to float in each coordinate, and right-handed. half is
/// sorted: half.x >= half.y >= half.z, so that axes[2] is the direction of a largest face. A box without points has
/// half = -1; one that outgrows float's range has infinite halves.
struct OrientedBox {
  glm::vec3 centre{0.0f};
  glm::vec3 axes[3] = {{1.0f, 0.0f, 0.0f}, {0.0f, 1.0f, 0.0f}, {0.0f, 0.0f, 1.0f}};
  glm::vec3 half{-1.0f};
  friend bool operator==(const OrientedBox&, const OrientedBox&) = default;
};

/// Tells whether the box holds no point.
PGL_HD inline bool is_empty(const OrientedBox& box) {
  return !(box.half.z >= 0.0f);
}

/// Returns the surface of the box's six faces; 0 for an empty box.
PGL_HD inline double surface_area(const OrientedBox& box) {
  if (is_empty(box)) return 0.0;
  const double x = box.half.x, y = box.half.y, z = box.half.z;
  return ieee::mul(ieee::add(ieee::add(ieee::mul(x, y), ieee::mul(y, z)), ieee::mul(z, x)), 8.0);
}

namespace detail {

// How a box is found, after the DiTO boxes of Larsson and Källberg (2011): the vertices that reach farthest along 13
// fixed directions, both ways, stand for the mesh; triangles among them, and the mesh's largest triangle, give
// orientations to try on them; three searches improve on the best by small turns; what wins, and a few more, are tried
// on all vertices. What decides is the surface, which still tells orientations apart when the mesh is flat.

inline constexpr int box_directions = 13;
inline constexpr int box_points = 2 * box_directions;

/// The vertex that reaches farthest along a direction; of several, the first. None: no_vertex.
struct Extreme {
  static constexpr std::uint32_t no_vertex = 0xffffffffu;
  double reach = -ieee::infinity<double>;
  std::uint32_t vertex = no_vertex;
};
PGL_HD constexpr Extreme farther(const Extreme& a, const Extreme& b) {
  return a.reach > b.reach || (a.reach == b.reach && a.vertex < b.vertex) ? a : b;
}

PGL_HD inline bool is_finite_point(const glm::vec3& p) {
  return ieee::is_finite(p.x) && ieee::is_finite(p.y) && ieee::is_finite(p.z);
}

/// How far a point reaches along the directions: the axes, the diagonals of the faces of a cube, those of the cube.
/// Times the lengths of the directions, which do not matter.
PGL_HD inline void reaches_of(const glm::vec3& p, double* reach) {
  const double x = p.x, y = p.y, z = p.z;
  reach[0] = x;
  reach[1] = y;
  reach[2] = z;
  reach[3] = ieee::add(x, y);
  reach[4] = ieee::sub(x, y);
  reach[5] = ieee::add(x, z);
  reach[6] = ieee::sub(x, z);
  reach[7] = ieee::add(y, z);
  reach[8] = ieee::sub(y, z);
  reach[9] = ieee::add(reach[3], z);
  reach[10] = ieee::sub(reach[3], z);
  reach[11] = ieee::add(reach[4], z);
  reach[12] = ieee::sub(reach[4], z);
}

/// Takes a vertex into the extremes: of direction d, [2d] reaches farthest along it and [2d + 1] against it.
/// Call it with ascending vertices, or with fresh ones and combine by farther(). Not finite: ignored.
PGL_HD inline void extend_extremes(Extreme* extremes, const glm::vec3& p, std::uint32_t vertex) {
  if (!is_finite_point(p)) return;
  double reach[box_directions];
  reaches_of(p, reach);
  for (int d = 0; d < box_directions; ++d) {
    if (reach[d] > extremes[2 * d].reach) extremes[2 * d] = {reach[d], vertex};
    if (-reach[d] > extremes[2 * d + 1].reach) extremes[2 * d + 1] = {-reach[d], vertex};
  }
}

/// What is known of a mesh once its extremes are.
struct MeshExtent {
  double centre[3];     ///< of its axis-aligned box
  double farthest = 0;  ///< the largest size of a coordinate
  double size = 0;      ///< the sum of the sides: every triangle's area is below its square
};
PGL_HD inline MeshExtent extent_of(const Extreme* extremes) {
  MeshExtent e;
  for (int i = 0; i < 3; ++i) {
    const double high = extremes[2 * i].reach, low = -extremes[2 * i + 1].reach;
    e.centre[i] = ieee::mul(ieee::add(low, high), 0.5);
    e.farthest = ieee::max(e.farthest, ieee::max(magnitude(low), magnitude(high)));
    e.size = ieee::add(e.size, ieee::sub(high, low));
  }
  return e;
}

/// Twice the area, squared, of a triangle with finite corners; -1 for one with a corner that is not.
PGL_HD inline double triangle_key(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  if (!(is_finite_point(a) && is_finite_point(b) && is_finite_point(c))) return -1.0;
  const Vector<double> n = triangle_normal(Vector<double>(a), Vector<double>(b), Vector<double>(c));
  return dot_product(n, n);
}

/// The mesh's area is added up in integers: each triangle's in units of the extent's size squared over 2^exponent, so
/// that the sum of `triangles` of them fits into 64 bits.
struct AreaScale {
  double factor = 0;  ///< units in an area of 1
  double unit = 0;    ///< the area of a unit
  double most = 0;    ///< what one triangle counts at most
};
PGL_HD inline AreaScale area_scale(const MeshExtent& extent, std::uint32_t triangles) {
  int exponent = 62;
  for (std::uint32_t t = triangles; t > 0; t >>= 1) --exponent;
  const double square = ieee::mul(extent.size, extent.size), most = power_of_two(exponent);
  if (!(square > 0.0)) return {};
  return {ieee::div(most, square), ieee::div(square, most), most};
}
PGL_HD inline std::uint64_t area_units(double triangle_key, const AreaScale& scale) {
  if (!(triangle_key > 0.0)) return 0;
  const double area = ieee::mul(ieee::sqrt(triangle_key), 0.5);
  return static_cast<std::uint64_t>(ieee::add(ieee::min(ieee::mul(area, scale.factor), scale.most), 0.5));
}

/// Three axes at right angles, right-handed.
struct BoxAxes {
  Vector<double> axis[3];
};
PGL_HD inline BoxAxes coordinate_axes() {
  return {{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}};
}

PGL_HD inline bool is_null(const Vector<double>& a) {
  return a.x == 0.0 && a.y == 0.0 && a.z == 0.0;
}

/// Axes along the edge ab and across the triangle abc. Where the three are in a line, any axes along it; the coordinate
/// axes where a is b.
PGL_HD inline BoxAxes axes_along(const Vector<double>& a, const Vector<double>& b, const Vector<double>& c) {
  const Vector<double> u = direction(difference(b, a));
  if (is_null(u)) return coordinate_axes();
  const Vector<double> normal = direction(triangle_normal(a, b, c));
  Vector<double> v = direction(cross_product(normal, u));
  if (is_null(v)) {
    const double x = magnitude(u.x), y = magnitude(u.y), z = magnitude(u.z);
    Vector<double> across{0.0, 0.0, 0.0};
    if (x <= y && x <= z)
      across.x = 1.0;
    else if (y <= z)
      across.y = 1.0;
    else
      across.z = 1.0;
    v = direction(cross_product(across, u));
  }
  return {{u, v, cross_product(u, v)}};
}

/// Half the surface of the points' box of this orientation, from its sides.
PGL_HD inline double half_surface(double x, double y, double z) {
  return ieee::add(ieee::add(ieee::mul(x, y), ieee::mul(y, z)), ieee::mul(z, x));
}

/// The least interval with all p . axis.
struct Reach {
  double low = ieee::infinity<double>;
  double high = -ieee::infinity<double>;
};
PGL_HD inline Reach with(const Reach& r, double value) {
  return {ieee::min(value, r.low), ieee::max(value, r.high)};
}
PGL_HD inline Reach merged(const Reach& a, const Reach& b) {
  return {ieee::min(a.low, b.low), ieee::max(a.high, b.high)};
}
PGL_HD inline double box_cost(const Reach* reach) {
  return half_surface(ieee::sub(reach[0].high, reach[0].low), ieee::sub(reach[1].high, reach[1].low),
                      ieee::sub(reach[2].high, reach[2].low));
}
PGL_HD inline double box_cost(const Vector<double>* points, const BoxAxes& axes) {
  Reach reach[3];
  for (int i = 0; i < box_points; ++i)
    for (int k = 0; k < 3; ++k) reach[k] = with(reach[k], dot_product(points[i], axes.axis[k]));
  return box_cost(reach);
}

inline constexpr int largest_triangle_axes = 3;
inline constexpr int first_base_axes = 1 + largest_triangle_axes;
inline constexpr int box_candidates = first_base_axes + 3 + 2 * 9;

/// The triangles and tetrahedra that give orientations: the mesh's largest triangle; of the extreme points the two of
/// one direction that are farthest apart, the one farthest from their line, and the two farthest from the plane of the
/// three, on either side.
struct BoxCorners {
  Vector<double> largest[3];  ///< three times the same point where there is none
  Vector<double> base[3];
  Vector<double> top[2];
};

/// Fills in base and top.
PGL_HD inline void find_box_corners(const Vector<double>* points, BoxCorners& corners) {
  double most = -1.0;
  int pair = 0;
  for (int d = 0; d < box_directions; ++d) {
    const Vector<double> e = difference(points[2 * d], points[2 * d + 1]);
    const double apart = dot_product(e, e);
    if (apart > most) {
      most = apart;
      pair = d;
    }
  }
  const Vector<double> a = points[2 * pair], b = points[2 * pair + 1];
  int third = 0;
  most = -1.0;
  for (int i = 0; i < box_points; ++i) {
    const Vector<double> n = triangle_normal(a, b, points[i]);
    const double off = dot_product(n, n);
    if (off > most) {
      most = off;
      third = i;
    }
  }
  const Vector<double> c = points[third], n = direction(triangle_normal(a, b, c));
  int above = 0, below = 0;
  double high = -ieee::infinity<double>, low = ieee::infinity<double>;
  for (int i = 0; i < box_points; ++i) {
    const double height = dot_product(n, points[i]);
    if (height > high) {
      high = height;
      above = i;
    }
    if (height < low) {
      low = height;
      below = i;
    }
  }
  corners.base[0] = a;
  corners.base[1] = b;
  corners.base[2] = c;
  corners.top[0] = points[above];
  corners.top[1] = points[below];
}

/// The orientation of candidate `number`: 0 the coordinate axes, then each edge of the largest triangle, of the base,
/// and of the three other triangles of each tetrahedron.
PGL_HD inline BoxAxes candidate_axes(const BoxCorners& corners, int number) {
  if (number == 0) return coordinate_axes();
  const int k = (number - 1) % 3, next = k == 2 ? 0 : k + 1, last = k == 0 ? 2 : k - 1;
  if (number < first_base_axes) return axes_along(corners.largest[k], corners.largest[next], corners.largest[last]);
  const Vector<double>*base = corners.base, p = base[k], q = base[next];
  if (number < first_base_axes + 3) return axes_along(p, q, base[last]);
  const int side = number - (first_base_axes + 3), edge = side % 9 / 3;
  const Vector<double> top = corners.top[side / 9];
  return edge == 0 ? axes_along(p, q, top) : edge == 1 ? axes_along(q, top, p) : axes_along(top, p, q);
}

/// A search for better axes by small turns about each of them.
struct BoxSearch {
  BoxAxes axes;
  double cost = 0;
  double turn = 0.25;  ///< tangent of half the angle
};
inline constexpr int box_turns = 6;
inline constexpr int box_searches = 3;
inline constexpr int box_search_steps = 16;

/// The axes after the search's next turn, one of box_turns.
PGL_HD inline BoxAxes turned(const BoxSearch& search, int number) {
  const double square = ieee::mul(search.turn, search.turn), length = ieee::add(1.0, square);
  const double c = ieee::div(ieee::sub(1.0, square), length);
  const double s = ieee::div(ieee::mul(number % 2 == 0 ? 2.0 : -2.0, search.turn), length);
  const int k = number / 2, i = k == 2 ? 0 : k + 1, j = k == 0 ? 2 : k - 1;
  BoxAxes r = search.axes;
  const Vector<double> u = r.axis[i], v = r.axis[j];
  for (int axis = 0; axis < 3; ++axis) {
    r.axis[i][axis] = ieee::add(ieee::mul(c, u[axis]), ieee::mul(s, v[axis]));
    r.axis[j][axis] = ieee::sub(ieee::mul(c, v[axis]), ieee::mul(s, u[axis]));
  }
  return r;
}

/// Where search `number` starts: from the best candidate, from the coordinate axes, and from the best candidate turned
/// by 45 degrees about two of its axes, as far away as axes can be.
PGL_HD inline BoxSearch search_start(const Vector<double>* points, const BoxAxes& best, int number) {
  BoxSearch r;
  r.axes = number == 1 ? coordinate_axes() : best;
  if (number == 2) {
    BoxSearch far;
    far.axes = best;
    far.turn = 0.41421356237309503;
    far.axes = turned(far, 0);
    r.axes = turned(far, 2);
  }
  r.cost = box_cost(points, r.axes);
  return r;
}

/// Goes on with the best turn if that is better, else with half the angle. costs: of each turn.
PGL_HD inline BoxSearch advance(const BoxSearch& search, const double* costs) {
  int best = 0;
  for (int i = 1; i < box_turns; ++i)
    if (costs[i] < costs[best]) best = i;
  BoxSearch r = search;
  if (costs[best] < search.cost) {
    r.axes = turned(search, best);
    r.cost = costs[best];
  } else {
    r.turn = ieee::mul(search.turn, 0.5);
  }
  return r;
}

/// The orientations that are tried on all vertices, beside the coordinate axes, which need no trying: the best
/// candidate, what the best search found, and those of the largest triangle.
inline constexpr int box_finalists = 2 + largest_triangle_axes;

/// Axes as a box stores them.
struct FloatAxes {
  glm::vec3 axis[3];
};
PGL_HD inline FloatAxes rounded(const BoxAxes& axes) {
  FloatAxes r;
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < 3; ++i) r.axis[k][i] = ieee::add(ieee::to_float(axes.axis[k][i]), 0.0f);
  return r;
}

/// p . axis: the products of two floats are exact in double.
PGL_HD inline double reach_along(const glm::vec3& axis, const glm::vec3& p) {
  const double x = ieee::mul(static_cast<double>(axis.x), static_cast<double>(p.x));
  const double y = ieee::mul(static_cast<double>(axis.y), static_cast<double>(p.y));
  const double z = ieee::mul(static_cast<double>(axis.z), static_cast<double>(p.z));
  return ieee::add(ieee::add(x, y), z);
}
PGL_HD inline double reach_above(const glm::vec3& axis, const glm::vec3& p) {
  const double x = ieee::mul(static_cast<double>(axis.x), static_cast<double>(p.x));
  const double y = ieee::mul(static_cast<double>(axis.y), static_cast<double>(p.y));
  const double z = ieee::mul(static_cast<double>(axis.z), static_cast<double>(p.z));
  return add_above(add_above(x, y), z);
}

/// The reach of all vertices along the coordinate axes.
PGL_HD inline void reach_of_extremes(const Extreme* extremes, Reach* reach) {
  for (int i = 0; i < 3; ++i) reach[i] = {-extremes[2 * i + 1].reach, extremes[2 * i].reach};
}

/// The box of this orientation around what reaches so far along its axes, rounded outwards.
///
/// Each p . axis in `reach` has two roundings of sums that are below 1.74 times the farthest coordinate, or none where
/// the axis is a coordinate axis: it errs by less than 2^-51 of that coordinate.
PGL_HD inline OrientedBox box_around(const FloatAxes& axes, const Reach* reach, const MeshExtent& extent) {
  double centre[3] = {extent.centre[0], extent.centre[1], extent.centre[2]};
  for (int k = 0; k < 3; ++k) {
    const glm::vec3& a = axes.axis[k];
    const Vector<double> wide{a.x, a.y, a.z};
    const Vector<double> from{extent.centre[0], extent.centre[1], extent.centre[2]};
    const double middle = ieee::mul(ieee::add(reach[k].low, reach[k].high), 0.5);
    const double shift = ieee::sub(middle, dot_product(wide, from));
    for (int i = 0; i < 3; ++i) centre[i] = ieee::add(centre[i], ieee::mul(wide[i], shift));
  }
  glm::vec3 c;
  for (int i = 0; i < 3; ++i)
    c[i] = ieee::add(
        ieee::to_float(ieee::max(ieee::min(centre[i], static_cast<double>(FLT_MAX)), -static_cast<double>(FLT_MAX))),
        0.0f);
  float half[3];
  for (int k = 0; k < 3; ++k) {
    const glm::vec3& a = axes.axis[k];
    const bool exact = (a.x == 0.0f) + (a.y == 0.0f) + (a.z == 0.0f) == 2;
    const double error = exact ? 0.0 : ieee::mul(extent.farthest, 0x1p-51);
    const glm::vec3 opposite{-c.x, -c.y, -c.z};
    const double up = add_above(add_above(reach[k].high, error), reach_above(a, opposite));
    const double down = add_above(add_above(-reach[k].low, error), reach_above(a, c));
    half[k] = ieee::add(float_above(ieee::max(up, down)), 0.0f);
  }

  // Longest first, by exchanging neighbours; each exchange changes the hand, and so does turning one axis round.
  OrientedBox box;
  box.centre = c;
  int order[3] = {0, 1, 2};
  bool other_hand = false;
  for (int step = 0; step < 3; ++step) {
    const int i = step % 2;
    if (half[order[i]] < half[order[i + 1]]) {
      const int swapped = order[i];
      order[i] = order[i + 1];
      order[i + 1] = swapped;
      other_hand = !other_hand;
    }
  }
  for (int k = 0; k < 3; ++k) {
    box.axes[k] = axes.axis[order[k]];
    box.half[k] = half[order[k]];
  }
  if (other_hand)
    for (int i = 0; i < 3; ++i) box.axes[2][i] = ieee::sub(0.0f, box.axes[2][i]);
  return box;
}

/// The box of the orientation that turned out best on all vertices: of the coordinate axes and the finalists, whose
/// reaches are at reaches[3 * finalist]; ties to the first.
PGL_HD inline OrientedBox best_box(const Extreme* extremes, const FloatAxes* finalists, const Reach* reaches) {
  Reach reach[3];
  reach_of_extremes(extremes, reach);
  FloatAxes axes = rounded(coordinate_axes());
  double least = box_cost(reach);
  for (int f = 0; f < box_finalists; ++f) {
    const double cost = box_cost(reaches + 3 * f);
    if (!(cost < least)) continue;
    least = cost;
    axes = finalists[f];
    for (int k = 0; k < 3; ++k) reach[k] = reaches[3 * f + k];
  }
  return box_around(axes, reach, extent_of(extremes));
}

/// A box whose third side is this much shorter than its first is flat: a sheet, but for rounding.
inline constexpr double flat_ratio = 0x1p-12;

/// The part of the box's surface that `units` of area are; of the surface of one side if the box is flat.
PGL_HD inline float compactness_of(const OrientedBox& box, std::uint64_t units, const AreaScale& scale) {
  if (is_empty(box)) return 0.0f;
  const double x = box.half.x, y = box.half.y, z = box.half.z;
  const bool flat = z <= ieee::mul(x, flat_ratio);
  const double surface = flat ? ieee::mul(ieee::mul(x, y), 4.0) : ieee::mul(half_surface(x, y, z), 8.0);
  const double area = ieee::mul(static_cast<double>(units), scale.unit);
  if (!(surface > 0.0) || !ieee::is_finite(surface)) return 0.0f;
  return ieee::to_float(ieee::min(ieee::div(area, surface), 1.0));
}

}  // namespace detail

}  // namespace pgl
