// SPDX-License-Identifier: MIT
// The rule of progressive collapse order: what a half-edge collapse costs, when it is allowed, and which one is next.
#pragma once

#include <cstdint>

#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// What a collapse costs. All three are computed on normalised positions (see Normalisation).
enum class CostMetric : std::uint8_t {
  quadric,      ///< squared distance to the planes merged into the vertex, weighted by area ([PC11] 4.1)
  melax,        ///< edge length times curvature ([Peng13] Eq 2.2)
  edge_length,  ///< edge length alone
};

/// What a vertex on an open edge (an edge of exactly one triangle) may do.
enum class BoundaryRule : std::uint8_t {
  locked,  ///< it never moves ([Peng13] Eq 2.1); the open edges of every prefix are exactly those of the input
  slide,   ///< it may merge along an open edge into its neighbour, at a penalty; no new open edge ever appears
};

/// Which collapse is next.
enum class EcolOrder : std::uint8_t {
  greedy,  ///< always the least valid one of the whole mesh
  rounds,  ///< independent sets of locally least ones within a factor of two of the least: parallel inside one mesh
};

/// How build_ecol orders the collapses of one mesh.
struct EcolOptions {
  CostMetric metric = CostMetric::quadric;
  BoundaryRule boundary = BoundaryRule::locked;
  bool link_condition = true;  ///< only collapses that keep the topology: closed 2-manifolds stay closed, same genus
  bool flip_guard = true;      ///< no collapse that turns a triangle's normal by more than about 78 degrees
  float boundary_penalty = 10.0f;  ///< slide: weight of open edges against surface, > 0
  EcolOrder order = EcolOrder::greedy;
};

/// A vector in the precision of the cost arithmetic, float or double. Plain storage.
template <class Real>
using Vector = glm::vec<3, Real>;

/// Where costs are computed: p' = (p - centre) * scale, so that |p'| <= 1 and neither the size of a mesh nor its place
/// decides quality. `scale` is a power of two: scaling a mesh by a power of two changes no bit of p'.
struct Normalisation {
  double centre[3] = {0, 0, 0};
  double scale = 1;
};

namespace detail {

/// 2^exponent for exponents of normal doubles.
PGL_HD constexpr double power_of_two(int exponent) {
  return ieee::from_bits<double>(static_cast<std::uint64_t>(exponent + 1023) << 52);
}

}  // namespace detail

/// The normalisation of a mesh with bounding box `box`. An empty or single-point box gives scale 1.
/// Precondition: the box's corners are finite, or the box is empty.
PGL_HD inline Normalisation normalisation(const Box& box) {
  Normalisation n;
  double extent = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(box.min[axis] <= box.max[axis])) return Normalisation{};
    const double low = box.min[axis], high = box.max[axis];
    n.centre[axis] = ieee::mul(ieee::add(low, high), 0.5);
    extent = ieee::max(extent, ieee::sub(high, low));
  }
  if (extent > 0) {
    const auto exponent = static_cast<int>(ieee::to_bits(extent) >> 52) - 1023;  // floats never give subnormal doubles
    n.scale = detail::power_of_two(-exponent);
  }
  return n;
}

/// A position in normalised coordinates, rounded once to Real. Coordinates that are not finite become 0.
template <class Real>
PGL_HD Vector<Real> normalise(const glm::vec3& p, const Normalisation& n) {
  Vector<Real> q;
  for (int axis = 0; axis < 3; ++axis) {
    const double x = ieee::mul(ieee::sub(static_cast<double>(p[axis]), n.centre[axis]), n.scale);
    if constexpr (sizeof(Real) == sizeof(float))
      q[axis] = ieee::is_finite(p[axis]) ? ieee::to_float(x) : 0.0f;
    else
      q[axis] = ieee::is_finite(p[axis]) ? x : 0.0;
  }
  return q;
}

template <class Real>
PGL_HD inline Vector<Real> difference(const Vector<Real>& a, const Vector<Real>& b) {
  return {ieee::sub(a.x, b.x), ieee::sub(a.y, b.y), ieee::sub(a.z, b.z)};
}

template <class Real>
PGL_HD inline Real dot_product(const Vector<Real>& a, const Vector<Real>& b) {
  return ieee::add(ieee::add(ieee::mul(a.x, b.x), ieee::mul(a.y, b.y)), ieee::mul(a.z, b.z));
}

template <class Real>
PGL_HD Vector<Real> cross_product(const Vector<Real>& a, const Vector<Real>& b) {
  return {ieee::sub(ieee::mul(a.y, b.z), ieee::mul(a.z, b.y)), ieee::sub(ieee::mul(a.z, b.x), ieee::mul(a.x, b.z)),
          ieee::sub(ieee::mul(a.x, b.y), ieee::mul(a.y, b.x))};
}

template <class Real>
PGL_HD Real length(const Vector<Real>& a) {
  return ieee::sqrt(dot_product(a, a));
}

/// The vector over its length; zero where the length is zero or not finite.
template <class Real>
PGL_HD Vector<Real> direction(const Vector<Real>& a) {
  const Real l = length(a);
  if (!(l > 0) || !ieee::is_finite(l)) return {0, 0, 0};
  return {ieee::div(a.x, l), ieee::div(a.y, l), ieee::div(a.z, l)};
}

/// Normal of triangle abc, counter-clockwise, as long as twice its area.
template <class Real>
PGL_HD Vector<Real> triangle_normal(const Vector<Real>& a, const Vector<Real>& b, const Vector<Real>& c) {
  return cross_product(difference(b, a), difference(c, a));
}

/// A sum of weighted squared distances to planes, as a quadratic form around one vertex's own position:
/// q(d) = d'Ad + 2b'd + c for a displacement d from that vertex. Working around the vertex, not the origin, is what
/// keeps float accurate: nothing cancels that is larger than the neighbourhood.
template <class Real>
struct Quadric {
  Real xx = 0, yy = 0, zz = 0, xy = 0, xz = 0, yz = 0;
  Real bx = 0, by = 0, bz = 0;
  Real c = 0;
};

/// Adds weight * (unit . d)^2: a plane through the vertex itself.
template <class Real>
PGL_HD void add_plane(Quadric<Real>& q, const Vector<Real>& unit, Real weight) {
  const Real wx = ieee::mul(weight, unit.x), wy = ieee::mul(weight, unit.y), wz = ieee::mul(weight, unit.z);
  q.xx = ieee::add(q.xx, ieee::mul(wx, unit.x));
  q.yy = ieee::add(q.yy, ieee::mul(wy, unit.y));
  q.zz = ieee::add(q.zz, ieee::mul(wz, unit.z));
  q.xy = ieee::add(q.xy, ieee::mul(wx, unit.y));
  q.xz = ieee::add(q.xz, ieee::mul(wx, unit.z));
  q.yz = ieee::add(q.yz, ieee::mul(wy, unit.z));
}

/// q at displacement d; rounding may leave it slightly negative.
template <class Real>
PGL_HD inline Real evaluate(const Quadric<Real>& q, const Vector<Real>& d) {
  const Real x = ieee::add(ieee::add(ieee::mul(q.xy, d.y), ieee::mul(q.xz, d.z)), q.bx);
  const Real y = ieee::add(ieee::mul(q.yz, d.z), q.by);
  const Real sx = ieee::mul(d.x, ieee::add(ieee::mul(q.xx, d.x), ieee::add(x, x)));
  const Real sy = ieee::mul(d.y, ieee::add(ieee::mul(q.yy, d.y), ieee::add(y, y)));
  const Real sz = ieee::mul(d.z, ieee::add(ieee::mul(q.zz, d.z), ieee::add(q.bz, q.bz)));
  return ieee::add(ieee::add(ieee::add(sx, sy), sz), q.c);
}

/// Merges q, held around a vertex at p, into `into`, held around a vertex at p + d.
template <class Real>
PGL_HD inline void merge(Quadric<Real>& into, const Quadric<Real>& q, const Vector<Real>& d) {
  const Real c = evaluate(q, d);
  const auto shifted = [&](Real b, Real ax, Real ay, Real az) {
    return ieee::add(b, ieee::add(ieee::add(ieee::mul(ax, d.x), ieee::mul(ay, d.y)), ieee::mul(az, d.z)));
  };
  into.bx = ieee::add(into.bx, shifted(q.bx, q.xx, q.xy, q.xz));
  into.by = ieee::add(into.by, shifted(q.by, q.xy, q.yy, q.yz));
  into.bz = ieee::add(into.bz, shifted(q.bz, q.xz, q.yz, q.zz));
  into.xx = ieee::add(into.xx, q.xx);
  into.yy = ieee::add(into.yy, q.yy);
  into.zz = ieee::add(into.zz, q.zz);
  into.xy = ieee::add(into.xy, q.xy);
  into.xz = ieee::add(into.xz, q.xz);
  into.yz = ieee::add(into.yz, q.yz);
  into.c = ieee::add(into.c, c > 0 ? c : Real(0));
}

/// The weight of a triangle's plane in the quadrics of its corners: its area. `normal` is triangle_normal's; the plane
/// itself is its direction. A triangle without area weighs nothing.
template <class Real>
PGL_HD Real triangle_weight(const Vector<Real>& normal) {
  return ieee::mul(length(normal), Real(0.5));
}

/// The plane through open edge ab, upright on its triangle, and its weight penalty * |ab|^2 (slide only). The zero
/// plane where edge or triangle has no extent.
template <class Real>
PGL_HD Vector<Real> open_edge_plane(const Vector<Real>& a, const Vector<Real>& b, const Vector<Real>& normal) {
  return direction(cross_product(difference(b, a), direction(normal)));
}
template <class Real>
PGL_HD Real open_edge_weight(const Vector<Real>& a, const Vector<Real>& b, Real penalty) {
  const Vector<Real> ab = difference(b, a);
  return ieee::mul(penalty, dot_product(ab, ab));
}

/// Root mean square distance to planes of total weight `weight`, from the value of their quadric, in normalised units;
/// 0 without planes.
template <class Real>
PGL_HD Real plane_distance(Real value, Real weight) {
  return value > 0 && weight > 0 ? ieee::sqrt(ieee::div(value, weight)) : Real(0);
}

/// A distance in normalised units, in the model's.
template <class Real>
PGL_HD float in_model_units(Real distance, const Normalisation& n) {
  return ieee::to_float(ieee::div(static_cast<double>(distance), n.scale));
}

/// How differently two triangles face, 0 (same) to 1 (opposite), from unit normals: (1 - f.n) / 2, [Peng13] Eq 2.2.
/// A triangle without area has the zero normal and differs by 1/2 from any.
template <class Real>
PGL_HD Real dissimilarity(const Vector<Real>& f, const Vector<Real>& n) {
  return ieee::mul(ieee::sub(Real(1), dot_product(f, n)), Real(0.5));
}

/// How sharply a boundary vertex turns when it slides from the direction `along` of the open edge behind it into the
/// direction `ahead` of the one it merges along, times the penalty: the boundary's part in the curvature of Eq 2.2.
template <class Real>
PGL_HD Real slide_curvature(const Vector<Real>& along, const Vector<Real>& ahead, Real penalty) {
  return ieee::mul(penalty, dissimilarity(along, ahead));
}

/// [Peng13] Eq 2.2: the length of the edge times the curvature, which is the largest dissimilarity of a triangle of the
/// vertex that goes to the likest triangle on the edge (and, sliding, the largest slide_curvature).
template <class Real>
PGL_HD Real melax_cost(Real edge_length, Real curvature) {
  return ieee::mul(edge_length, curvature);
}

/// The length of the edge, times the penalty for a vertex that slides along the boundary.
template <class Real>
PGL_HD Real edge_length_cost(Real edge_length, bool slides, Real penalty) {
  return slides ? ieee::mul(edge_length, penalty) : edge_length;
}

/// The cost as build_ecol orders it: never negative, NaN is infinite; then an integer that orders like it.
template <class Real>
PGL_HD inline auto cost_key(Real cost) {
  if (cost != cost) cost = ieee::infinity<Real>;
  return ieee::order_key(cost > 0 ? cost : Real(0));
}

/// The total order of half-edge collapses: by cost, then by the vertex that goes, then by the one it merges into.
template <class Key>
struct Collapse {
  Key cost;
  std::uint32_t from;
  std::uint32_t to;
};
template <class Key>
PGL_HD constexpr bool operator<(const Collapse<Key>& a, const Collapse<Key>& b) {
  if (a.cost != b.cost) return a.cost < b.cost;
  if (a.from != b.from) return a.from < b.from;
  return a.to < b.to;
}

/// How many triangles edge vw will have when u merges into v, from the present counts: triangles on vw, triangles on
/// uw, and triangles uvw (which vanish).
PGL_HD constexpr std::uint32_t merged_edge_uses(std::uint32_t vw, std::uint32_t uw, std::uint32_t uvw) {
  return vw + uw - 2 * uvw;
}

/// Whether merging edge uw into vw respects the open edges: with u off the boundary none appears or vanishes; with u on
/// the boundary (slide only) none appears that is not the image of one.
PGL_HD constexpr bool keeps_open_edges(std::uint32_t vw, std::uint32_t uw, std::uint32_t uvw, bool u_on_boundary) {
  const bool open_after = merged_edge_uses(vw, uw, uvw) == 1;
  return u_on_boundary ? (!open_after || vw == 1 || uw == 1) : open_after == (vw == 1);
}

/// Whether triangle (corner, a, b) turns by more than acos(0.2), about 78 degrees, or loses its area, when its corner
/// moves. A triangle that had no area before never counts as flipped.
PGL_HD inline bool flips(const Vector<double>& a, const Vector<double>& b, const Vector<double>& corner_before,
                         const Vector<double>& corner_after) {
  const Vector<double> ab = difference(b, a);
  const Vector<double> before = cross_product(ab, difference(corner_before, a));
  const Vector<double> after = cross_product(ab, difference(corner_after, a));
  const double bb = dot_product(before, before);
  const double d = dot_product(before, after);
  return bb > 0 && !(d > 0 && ieee::mul(d, d) > ieee::mul(ieee::mul(0.04, bb), dot_product(after, after)));
}

}  // namespace pgl
