// SPDX-License-Identifier: MIT
// Which texels of a depth map a triangle covers for certain, and a depth for each that is never too near.
#pragma once

#include <cstdint>

#include "pgl/bounds.hpp"
#include "pgl/config.hpp"
#include "pgl/depth.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// A view as triangles are drawn with it into a depth map, once per call. Lengths are in texels from here on.
struct DepthView {
  double row[4][4];   ///< of x, y, w and n of a point's clip coordinates; n is what is at least 0 behind the near plane
  double half_width;  ///< of the picture
  double half_height;
  double inset;         ///< how far from its centre, along both axes, a texel must be covered
  double depth_factor;  ///< window depth = depth_factor * n / w, near 0 and far 1 for any depth range and order
  std::uint32_t width;  ///< of the map
  std::uint32_t height;
};

/// Preconditions: every entry of clip_from_world is finite; size is depth_map_of(view, size.scale, size.coverage).
PGL_HD inline DepthView depth_view_of(const View& view, const DepthMap& size) {
  PGL_ASSERT(size == depth_map_of(view, size.scale, size.coverage));
  const bool zero_to_one = view.depth_range == DepthRange::zero_to_one;
  const bool reversed = view.depth_order == DepthOrder::reversed;
  DepthView r;
  for (int j = 0; j < 4; ++j) {
    const glm::vec4& column = view.clip_from_world[j];
    PGL_ASSERT(ieee::is_finite(column.x) && ieee::is_finite(column.y));
    PGL_ASSERT(ieee::is_finite(column.z) && ieee::is_finite(column.w));
    const double z = column.z, w = column.w;
    r.row[0][j] = column.x;
    r.row[1][j] = column.y;
    r.row[2][j] = w;
    r.row[3][j] = reversed ? ieee::sub(w, z) : zero_to_one ? z : ieee::add(z, w);
  }
  const double scale = size.scale;
  r.half_width = ieee::div(ieee::mul(static_cast<double>(view.width), 0.5), scale);
  r.half_height = ieee::div(ieee::mul(static_cast<double>(view.height), 0.5), scale);
  // Pixel centres reach (scale - 1) / (2 scale) from the texel's centre. Rounded up.
  r.inset = size.coverage == Coverage::whole
                ? 0.5
                : ieee::mul(ieee::div(ieee::sub(scale, 1.0), ieee::mul(scale, 2.0)), 1.0 + 0x1p-50);
  r.depth_factor = zero_to_one ? 1.0 : 0.5;
  r.width = size.width;
  r.height = size.height;
  return r;
}

/// A point's clip coordinates x, y, w and n, and how far each may be from the truth.
struct ClipVertex {
  double value[4];
  double error[4];
};

/// Carries a point of the world into clip space. Products of two floats, or of a float and a sum of two, err by one
/// rounding at most, three sums by as many, the sum in the row by one: less than 6 * 2^-53 of the sum of the terms'
/// sizes, of which 8 are allowed. An error is NaN or infinite if the point is.
PGL_HD inline ClipVertex clip_vertex(const DepthView& view, const glm::vec3& p) {
  const double px = p.x, py = p.y, pz = p.z;
  ClipVertex r;
  for (int k = 0; k < 4; ++k) {
    const double x = ieee::mul(view.row[k][0], px);
    const double y = ieee::mul(view.row[k][1], py);
    const double z = ieee::mul(view.row[k][2], pz);
    const double w = view.row[k][3];
    r.value[k] = ieee::add(ieee::add(ieee::add(x, y), z), w);
    const double terms = ieee::add(ieee::add(detail::magnitude(x), detail::magnitude(y)),
                                   ieee::add(detail::magnitude(z), detail::magnitude(w)));
    r.error[k] = ieee::mul(terms, 0x1p-50);
  }
  return r;
}

/// A point on the map: where it is, in texels from the lower left corner, and its window depth.
struct DepthVertex {
  double x;
  double y;
  double depth;
  double place_error;  ///< how far x and y may be from the truth; infinite if the point is not certainly before the eye
                       ///< and behind the near plane, or is absurdly far off the picture or beyond the far plane
  double depth_error;
};

/// Projects a point to the map.
///
/// With q = x / w and w's error at most a quarter of w, q errs by at most 4/3 (|q| w.error + x.error) / w, of which
/// twice is taken; the roundings on the way to texels and to a place relative to another texel make less than 9 * 2^-53
/// of three times (|q| + 1) half the picture, of which 32 are allowed. The same for the depth.
PGL_HD inline DepthVertex depth_vertex(const DepthView& view, const ClipVertex& p) {
  DepthVertex r;
  const double w = p.value[2], n = p.value[3];
  r.place_error = ieee::infinity<double>;
  if (!(w > ieee::mul(p.error[2], 4.0) && n >= p.error[3])) return r;
  const double inverse = ieee::div(1.0, w), twice = ieee::mul(inverse, 2.0);
  const double qx = ieee::mul(p.value[0], inverse), qy = ieee::mul(p.value[1], inverse);
  const double q = ieee::max(detail::magnitude(qx), detail::magnitude(qy));
  if (!(q < 0x1p60)) return r;
  r.x = ieee::mul(ieee::add(qx, 1.0), view.half_width);
  r.y = ieee::mul(ieee::add(qy, 1.0), view.half_height);
  const double error = ieee::add(ieee::mul(q, p.error[2]), ieee::max(p.error[0], p.error[1]));
  r.place_error = ieee::mul(ieee::add(ieee::mul(error, twice), ieee::mul(ieee::add(q, 1.0), 0x1p-48)),
                            ieee::max(view.half_width, view.half_height));
  const double ratio = ieee::mul(n, inverse);
  r.depth = ieee::mul(ratio, view.depth_factor);  // exact
  r.depth_error =
      ieee::add(ieee::mul(ieee::add(ieee::mul(ratio, p.error[2]), p.error[3]), twice), ieee::mul(ratio, 0x1p-50));
  if (!(r.depth < 1024.0)) r.place_error = ieee::infinity<double>;
  return r;
}

/// A triangle ready to be drawn. Texel (x0 + i, y0 + j) of its box, i < columns and j < rows, is covered iff
/// edge[k][0] + edge[k][1] * i + edge[k][2] * j >= 0 for k = 0, 1, 2, see covers; its depth there is depth_at. All in
/// integers, so that drivers may step from texel to texel or begin anywhere, and get the same. Nothing overflows in the
/// box and 64 texels around it.
struct DepthTriangle {
  std::int64_t edge[3][3];
  std::int64_t depth[3];  ///< in steps of 2^-48
  Depth farthest;
  std::uint32_t x0;
  std::uint32_t y0;
  std::uint32_t columns;  ///< 0: nothing to draw, and nothing else is set
  std::uint32_t rows;
};

/// Tells whether the triangle covers a texel of its box.
PGL_HD constexpr bool covers(const DepthTriangle& t, std::uint32_t i, std::uint32_t j) {
  const std::int64_t x = i, y = j;
  return ((t.edge[0][0] + t.edge[0][1] * x + t.edge[0][2] * y) | (t.edge[1][0] + t.edge[1][1] * x + t.edge[1][2] * y) |
          (t.edge[2][0] + t.edge[2][1] * x + t.edge[2][2] * y)) >= 0;
}

/// The depth of a value of DepthTriangle::depth's plane, at a texel that is covered.
PGL_HD constexpr Depth depth_of(const DepthTriangle& t, std::int64_t value) {
  const std::int64_t depth = value >> 16;
  return depth < static_cast<std::int64_t>(t.farthest) ? static_cast<Depth>(depth) : t.farthest;
}
PGL_HD constexpr Depth depth_at(const DepthTriangle& t, std::uint32_t i, std::uint32_t j) {
  return depth_of(t,
                  t.depth[0] + t.depth[1] * static_cast<std::int64_t>(i) + t.depth[2] * static_cast<std::int64_t>(j));
}

/// The columns of the box's row j that are covered: [first, end).
struct DepthSpan {
  std::uint32_t first;
  std::uint32_t end;
};
PGL_HD constexpr DepthSpan covered_span(const DepthTriangle& t, std::uint32_t j) {
  std::int64_t first = 0, last = static_cast<std::int64_t>(t.columns) - 1;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t step = t.edge[k][1];
    const std::int64_t value = t.edge[k][0] + t.edge[k][2] * static_cast<std::int64_t>(j);
    if (value < 0) {
      if (step <= 0) return {0, 0};
      const std::int64_t i = (-value - 1) / step + 1;
      first = i > first ? i : first;
    } else if (value + step * last < 0) {
      last = value / -step;
    }
    if (first > last) return {0, 0};
  }
  return {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last + 1)};
}

namespace detail {

/// An edge of a triangle whose inner side is to its left, from (x0, y0) on along (dx, dy), as integers: the value at
/// texel (i, j) is below 2^44 times the exact distance function over the larger of |dx| and |dy|, or negative.
/// `margin`: what the exact function must exceed.
PGL_HD inline bool set_edge(double x0, double y0, double dx, double dy, double margin, std::int64_t most_steps,
                            std::int64_t* edge) {
  const double larger = ieee::max(magnitude(dx), magnitude(dy));
  const std::uint64_t exponent = ieee::to_bits(larger) >> 52;
  if (exponent < 64) return false;  // no length to speak of; it is below 2^80, so the exponent of the scale is in range
  const double scale = ieee::from_bits<double>((2089 - exponent) << 52);  // larger * scale is in [2^43, 2^44)
  const double at_origin = ieee::sub(ieee::mul(dy, x0), ieee::mul(dx, y0));
  const double value = ieee::mul(ieee::sub(at_origin, margin), scale);
  if (!(value >= -0x1p62)) return false;  // outside all over the box
  // Cut to integers; what that loses, at each step along x and y too, is made up for.
  edge[0] = static_cast<std::int64_t>(ieee::min(value, 0x1p62)) - (most_steps + 3);
  edge[1] = static_cast<std::int64_t>(ieee::mul(-dy, scale));
  edge[2] = static_cast<std::int64_t>(ieee::mul(dx, scale));
  return true;
}

/// The texels whose centres are in [low + inset, high - inset], of those in [0, size).
PGL_HD inline bool texel_range(double low, double high, double inset, std::uint32_t size, std::uint32_t& first,
                               std::uint32_t& count) {
  const double from = ieee::max(ieee::sub(ieee::add(low, inset), 0.5), 0.0);
  const double to = ieee::min(ieee::sub(ieee::sub(high, inset), 0.5), static_cast<double>(size - 1));
  if (!(from <= to)) return false;
  first = static_cast<std::uint32_t>(from);
  first += static_cast<double>(first) < from ? 1 : 0;
  const std::uint32_t last = static_cast<std::uint32_t>(to);
  if (first > last) return false;
  count = last - first + 1;
  return true;
}

/// The greatest distance of a coordinate from the places in [-inset, steps + inset].
PGL_HD inline double farthest_from(double x, double steps, double inset) {
  return ieee::add(ieee::max(magnitude(x), magnitude(ieee::sub(x, steps))), inset);
}

}  // namespace detail

/// Prepares a triangle: only texels that it certainly covers are covered, and only with depths that are certainly not
/// nearer than its surface at any place of the texel that counts. Both windings.
///
/// Let V be the true corners, v the computed ones, at most place_error (p below) off in x and in y, and let s be in the
/// triangle's box. The true edge function cross(V1 - V0, s - V0) = cross(V0 - s, V1 - s) differs from the computed one
/// by at most p0 |V1 - s| + p1 |V0 - s| + 2 p0 p1 in the 1-norm, to which the roundings come. If all three computed
/// ones exceed that, the true ones are positive, so s is in the true triangle; the computed orientation is then the
/// true one too. For a texel's square the functions are taken at its worst corner. In the triangle s = sum b V with
/// weights b >= 0 that sum up to 1, and the true depth there is D = sum b D_k. A plane Q of gradient g that is at or
/// above depth_k + depth_error_k + p_k |g| at the three computed corners is so at s: Q(s) = sum b Q(V_k) >= sum b
/// (Q(v_k) - p_k |g|) >= D. That holds for any g; a good one makes it tight. A gradient that cannot be had, or
/// passes through some thousand times the range of depths within the box, is taken as 0: then the farthest corner
/// counts.
PGL_HD inline DepthTriangle depth_triangle(const DepthView& view, const DepthVertex& a, DepthVertex b, DepthVertex c) {
  DepthTriangle r;
  r.columns = 0;
  const double error = ieee::max(a.place_error, ieee::max(b.place_error, c.place_error));
  if (!(error < 0x1p64)) return r;
  const double left = ieee::min(a.x, ieee::min(b.x, c.x)), right = ieee::max(a.x, ieee::max(b.x, c.x));
  const double low = ieee::min(a.y, ieee::min(b.y, c.y)), high = ieee::max(a.y, ieee::max(b.y, c.y));
  std::uint32_t columns = 0;
  if (!detail::texel_range(low, high, view.inset, view.height, r.y0, r.rows)) return r;
  if (!detail::texel_range(left, right, view.inset, view.width, r.x0, columns)) return r;

  // Places relative to the centre of the box's first texel.
  const double x = ieee::add(static_cast<double>(r.x0), 0.5), y = ieee::add(static_cast<double>(r.y0), 0.5);
  const double ax = ieee::sub(a.x, x), ay = ieee::sub(a.y, y);
  double abx = ieee::sub(b.x, a.x), aby = ieee::sub(b.y, a.y), acx = ieee::sub(c.x, a.x), acy = ieee::sub(c.y, a.y);
  double area = ieee::sub(ieee::mul(abx, acy), ieee::mul(acx, aby));
  if (area < 0.0) {
    const DepthVertex t = b;
    b = c;
    c = t;
    const double tx = abx, ty = aby;
    abx = acx;
    aby = acy;
    acx = tx;
    acy = ty;
    area = -area;
  }
  const double bx = ieee::sub(b.x, x), by = ieee::sub(b.y, y), cx = ieee::sub(c.x, x), cy = ieee::sub(c.y, y);
  const double bcx = ieee::sub(c.x, b.x), bcy = ieee::sub(c.y, b.y);

  // Margins of the edges. Roundings make less than 8 * 2^-53 (|dx| + |dy|) times the first corner's distance.
  double margin[3];
  const double extent = ieee::add(ieee::sub(right, left), ieee::sub(high, low));  // no place in it is farther from any
  const std::uint32_t steps = columns + r.rows;
  if (extent < 65536.0) {
    const double all = ieee::add(ieee::mul(ieee::mul(error, 2.0), ieee::add(extent, error)),
                                 ieee::mul(ieee::mul(extent, extent), 0x1p-49));
    margin[0] = margin[1] = margin[2] = ieee::mul(all, 1.0 + 0x1p-40);
  } else {
    const double wide = static_cast<double>(columns - 1), tall = static_cast<double>(r.rows - 1);
    const double far_a =
        ieee::add(detail::farthest_from(ax, wide, view.inset), detail::farthest_from(ay, tall, view.inset));
    const double far_b =
        ieee::add(detail::farthest_from(bx, wide, view.inset), detail::farthest_from(by, tall, view.inset));
    const double far_c =
        ieee::add(detail::farthest_from(cx, wide, view.inset), detail::farthest_from(cy, tall, view.inset));
    const auto margin_of = [](const DepthVertex& v0, const DepthVertex& v1, double far0, double far1) {
      const double moved = ieee::add(ieee::mul(v0.place_error, ieee::add(far1, v1.place_error)),
                                     ieee::mul(v1.place_error, ieee::add(far0, v0.place_error)));
      const double rounded = ieee::mul(ieee::mul(ieee::add(far0, far1), far0), 0x1p-49);
      return ieee::mul(ieee::add(moved, rounded), 1.0 + 0x1p-40);
    };
    margin[0] = margin_of(a, b, far_a, far_b);
    margin[1] = margin_of(b, c, far_b, far_c);
    margin[2] = margin_of(c, a, far_c, far_a);
  }
  const double ab = ieee::add(detail::magnitude(abx), detail::magnitude(aby));
  const double bc = ieee::add(detail::magnitude(bcx), detail::magnitude(bcy));
  const double ca = ieee::add(detail::magnitude(acx), detail::magnitude(acy));
  const double inset = ieee::mul(view.inset, 1.0 + 0x1p-50);
  if (!detail::set_edge(ax, ay, abx, aby, ieee::add(margin[0], ieee::mul(inset, ab)), steps, r.edge[0]) ||
      !detail::set_edge(bx, by, bcx, bcy, ieee::add(margin[1], ieee::mul(inset, bc)), steps, r.edge[1]) ||
      !detail::set_edge(cx, cy, -acx, -acy, ieee::add(margin[2], ieee::mul(inset, ca)), steps, r.edge[2]))
    return r;

  // Depths in steps of 2^-48.
  const double depth_a = ieee::mul(a.depth, 0x1p48), depth_b = ieee::mul(b.depth, 0x1p48);
  const double depth_c = ieee::mul(c.depth, 0x1p48);
  const double up_a = ieee::add(depth_a, ieee::mul(a.depth_error, 0x1p48));
  const double up_b = ieee::add(depth_b, ieee::mul(b.depth_error, 0x1p48));
  const double up_c = ieee::add(depth_c, ieee::mul(c.depth_error, 0x1p48));
  const double most = ieee::mul(ieee::max(up_a, ieee::max(up_b, up_c)), 1.0 + 0x1p-50);
  const double per_area = ieee::div(1.0, area);
  const double to_b = ieee::sub(depth_b, depth_a), to_c = ieee::sub(depth_c, depth_a);
  double gx = ieee::mul(ieee::sub(ieee::mul(to_b, acy), ieee::mul(to_c, aby)), per_area);
  double gy = ieee::mul(ieee::sub(ieee::mul(to_c, abx), ieee::mul(to_b, acx)), per_area);
  double lift = most;
  // A box and 64 texels around it stay in range.
  const double across = ieee::mul(detail::magnitude(gx), static_cast<double>(columns + 64));
  const double along = ieee::mul(detail::magnitude(gy), static_cast<double>(r.rows + 64));
  if (ieee::add(across, along) <= 0x1p61) {
    r.depth[1] = static_cast<std::int64_t>(gx);
    r.depth[2] = static_cast<std::int64_t>(gy);
    gx = static_cast<double>(r.depth[1]);
    gy = static_cast<double>(r.depth[2]);
    const double slope = ieee::add(detail::magnitude(gx), detail::magnitude(gy));
    const auto lift_of = [&](const DepthVertex& v, double up, double vx, double vy) {
      const double x_part = ieee::mul(gx, vx), y_part = ieee::mul(gy, vy);
      const double terms = ieee::add(ieee::add(detail::magnitude(x_part), detail::magnitude(y_part)), up);
      const double moved = ieee::add(ieee::mul(v.place_error, slope), ieee::mul(terms, 0x1p-49));
      return ieee::add(ieee::sub(up, ieee::add(x_part, y_part)), moved);
    };
    lift = ieee::max(lift_of(a, up_a, ax, ay), ieee::max(lift_of(b, up_b, bx, by), lift_of(c, up_c, cx, cy)));
    lift = ieee::add(lift, ieee::mul(ieee::mul(inset, slope), 1.0 + 0x1p-50));
  } else {
    r.depth[1] = r.depth[2] = 0;
  }
  if (!(detail::magnitude(lift) <= 0x1p62)) {
    r.depth[1] = r.depth[2] = 0;
    lift = most;
  }
  // Up to a whole 2^-48, and to a whole 2^-32 when 16 bits are cut off; a lift beyond 2^53 was rounded, by up to 2^9.
  r.depth[0] = static_cast<std::int64_t>(lift) + 0xffff + 2 + (detail::magnitude(lift) < 0x1p53 ? 0 : 0x400);
  r.farthest = depth_above(ieee::mul(most, 0x1p-48));
  r.columns = columns;
  return r;
}

/// Cuts a triangle off at the near plane: writes the corners of what is behind it, in order, and returns how many: 0, 3
/// or 4. They are exact points of the triangle but for their errors, and all certainly behind the plane, by a hair.
///
/// A new corner is the point from an inner to an outer one for a parameter t, whatever rounding made of t: its error is
/// less than the two corners' together and the roundings, which are less than half of that.
PGL_HD inline int cut_at_near_plane(const ClipVertex* in, ClipVertex* out) {
  const double hair = ieee::mul(ieee::max(in[0].error[3], ieee::max(in[1].error[3], in[2].error[3])), 16.0);
  int corners = 0;
  for (int k = 0; k < 3; ++k) {
    const ClipVertex& from = in[k];
    const ClipVertex& to = in[k == 2 ? 0 : k + 1];
    const bool is_inner = from.value[3] >= hair, is_next_inner = to.value[3] >= hair;
    if (is_inner) out[corners++] = from;
    if (is_inner == is_next_inner) continue;
    const ClipVertex& inner = is_inner ? from : to;
    const ClipVertex& outer = is_inner ? to : from;
    const double t = ieee::div(ieee::sub(inner.value[3], hair), ieee::sub(inner.value[3], outer.value[3]));
    ClipVertex& cut = out[corners++];
    for (int m = 0; m < 4; ++m) {
      cut.value[m] = ieee::add(inner.value[m], ieee::mul(t, ieee::sub(outer.value[m], inner.value[m])));
      cut.error[m] = ieee::mul(ieee::add(inner.error[m], outer.error[m]), 2.0);
    }
  }
  return corners;
}

/// Tells whether a corner is in the map's reach, so that a triangle of three such needs no cut.
PGL_HD inline bool is_drawable(const DepthVertex& v) {
  return v.place_error < ieee::infinity<double>;
}

/// Prepares what is behind the near plane of a triangle of the world, by its corners in clip space: writes up to two
/// triangles with something to draw, and returns how many. For triangles with a corner that is not drawable; the others
/// are depth_triangle of their corners.
PGL_HD inline int cut_depth_triangle(const DepthView& view, const ClipVertex* corners, DepthTriangle* out) {
  ClipVertex cut[4];
  const int count = cut_at_near_plane(corners, cut);
  if (count == 0) return 0;
  const DepthVertex first = depth_vertex(view, cut[0]);
  DepthVertex previous = depth_vertex(view, cut[1]);
  int triangles = 0;
  for (int k = 2; k < count; ++k) {
    const DepthVertex next = depth_vertex(view, cut[k]);
    out[triangles] = depth_triangle(view, first, previous, next);
    if (out[triangles].columns > 0) ++triangles;
    previous = next;
  }
  return triangles;
}

}  // namespace pgl
