// SPDX-License-Identifier: MIT
// Exact rational geometry for oracles: clip space, frustum membership, boxes against frusta. Needs gmpxx.
#pragma once

#include <gmpxx.h>

#include <array>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "pgl/types.hpp"

namespace exact {

using Number = mpq_class;  // a float or double converts exactly
using Point = std::array<Number, 3>;

inline Point point(const glm::vec3& p) {
  return {Number(p.x), Number(p.y), Number(p.z)};
}

/// One coordinate of m * (p, 1).
template <class Matrix>
Number row_times(const Matrix& m, int row, const Point& p) {
  return Number(m[0][row]) * p[0] + Number(m[1][row]) * p[1] + Number(m[2][row]) * p[2] + Number(m[3][row]);
}

/// The definition of inside, as View documents it.
inline bool is_inside(const pgl::View& view, const Point& p) {
  const Number x = row_times(view.clip_from_world, 0, p), y = row_times(view.clip_from_world, 1, p);
  const Number z = row_times(view.clip_from_world, 2, p), w = row_times(view.clip_from_world, 3, p);
  const Number least_z = view.depth_range == pgl::DepthRange::zero_to_one ? Number(0) : Number(-w);
  return abs(x) <= w && abs(y) <= w && least_z <= z && z <= w;
}

/// a[0] x + a[1] y + a[2] z + a[3] >= 0.
using HalfSpace = std::array<Number, 4>;

inline std::vector<HalfSpace> half_spaces(const pgl::View& view) {
  const bool zero_to_one = view.depth_range == pgl::DepthRange::zero_to_one;
  std::vector<HalfSpace> all(6);
  for (int j = 0; j < 4; ++j) {
    const glm::vec4& c = view.clip_from_world[j];
    const Number x(c.x), y(c.y), z(c.z), w(c.w);
    all[0][j] = w + x;
    all[1][j] = w - x;
    all[2][j] = w + y;
    all[3][j] = w - y;
    all[4][j] = zero_to_one ? z : Number(w + z);
    all[5][j] = w - z;
  }
  return all;
}

/// The largest value of a half-space's function over a box, by all eight corners.
inline Number largest(const HalfSpace& h, const pgl::Box& box) {
  std::optional<Number> most;
  for (int c = 0; c < 8; ++c) {
    const Number v = h[0] * Number(c & 1 ? box.max.x : box.min.x) + h[1] * Number(c & 2 ? box.max.y : box.min.y) +
                     h[2] * Number(c & 4 ? box.max.z : box.min.z) + h[3];
    if (!most || v > *most) most = v;
  }
  return *most;
}

/// Whether some point satisfies all the half-spaces: Fourier-Motzkin elimination, one axis after the other.
inline bool is_feasible(std::vector<HalfSpace> all) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::vector<HalfSpace> below, above, rest;
    for (HalfSpace& h : all) {
      const int sign = sgn(h[axis]);
      if (sign == 0) {
        rest.push_back(h);
        continue;
      }
      const Number size = abs(h[axis]);
      for (Number& a : h) a /= size;
      (sign > 0 ? below : above).push_back(h);
    }
    if (axis == 2) {  // only the tightest bounds on the last axis matter
      const auto tightest = [](std::vector<HalfSpace>& bounds) {
        for (const HalfSpace& h : bounds)
          if (h[3] < bounds[0][3]) bounds[0][3] = h[3];
        if (bounds.size() > 1) bounds.resize(1);
      };
      tightest(below);
      tightest(above);
    }
    for (const HalfSpace& a : below)
      for (const HalfSpace& b : above) {
        HalfSpace sum;
        for (std::size_t j = 0; j < 4; ++j) sum[j] = a[j] + b[j];
        rest.push_back(sum);
      }
    all = std::move(rest);
  }
  for (const HalfSpace& h : all)
    if (h[3] < 0) return false;
  return true;
}

/// Whether a non-empty, finite box has a point in the frustum.
inline bool intersects(const pgl::Box& box, const pgl::View& view) {
  std::vector<HalfSpace> all = half_spaces(view);
  for (int j = 0; j < 3; ++j) {
    HalfSpace low, high;
    low[j] = 1;
    low[3] = -Number(box.min[j]);
    high[j] = -1;
    high[3] = Number(box.max[j]);
    all.push_back(low);
    all.push_back(high);
  }
  return is_feasible(std::move(all));
}

}  // namespace exact
