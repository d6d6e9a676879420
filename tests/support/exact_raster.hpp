// SPDX-License-Identifier: MIT
// What a perfect renderer draws: which samples a triangle covers and how deep it is there, in exact arithmetic. Needs
// gmpxx.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "pgl/gather.hpp"
#include "pgl/types.hpp"
#include "support/exact.hpp"

namespace exact {

/// A function c + x * X + y * Y of the place on the picture. Places are in half pixels, so that the centre of pixel
/// (i, j) is (2i + 1, 2j + 1) and its corners are (2i, 2j) to (2i + 2, 2j + 2).
class Plane {
 public:
  Plane() = default;
  Plane(Number c, Number x, Number y)
      : c_(std::move(c)), x_(std::move(x)), y_(std::move(y)), dc_(c_.get_d()), dx_(x_.get_d()), dy_(y_.get_d()) {}

  Number at(int hx, int hy) const { return c_ + x_ * hx + y_ * hy; }

  /// The value in double, and how far it may be from the exact one. Not finite where the coefficients are too large.
  struct Approximate {
    double value, error;
  };
  Approximate near(int hx, int hy) const {
    const double x = dx_ * hx, y = dy_ * hy;
    return {dc_ + x + y, (std::abs(dc_) + std::abs(x) + std::abs(y)) * 0x1p-49 + 1e-290};
  }

  /// -1, 0 or 1: doubles where they are sure, exact otherwise.
  int sign(int hx, int hy) const {
    const auto [value, error] = near(hx, hy);
    if (value > error) return 1;
    if (value < -error) return -1;
    return sgn(at(hx, hy));
  }

  /// Whether this is below (-1), at or above (1) the other there.
  int compare(const Plane& other, int hx, int hy) const {
    const auto a = near(hx, hy), b = other.near(hx, hy);
    if (a.value - b.value > (a.error + b.error) * 1.01) return 1;
    if (b.value - a.value > (a.error + b.error) * 1.01) return -1;
    return sgn(Number(at(hx, hy) - other.at(hx, hy)));
  }

 private:
  Number c_, x_, y_;
  double dc_ = 0, dx_ = 0, dy_ = 0;
};

/// A triangle of the world as a view shows it: seen from both sides, cut off at the near and the far plane, with window
/// depths from 0, near, to 1, far (also where the view's depth is reversed).
class DrawnTriangle {
 public:
  /// The positions are taken as they are. A triangle with one that is not finite, or seen exactly edge-on, has nothing
  /// to draw.
  DrawnTriangle(const pgl::View& view, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    const glm::vec3* corner[3] = {&a, &b, &c};
    Number x[3], y[3], z[3], w[3];
    for (int k = 0; k < 3; ++k) {
      const glm::vec3& p = *corner[k];
      if (!(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z))) return;
      const Point q = point(p);
      x[k] = row_times(view.clip_from_world, 0, q);
      y[k] = row_times(view.clip_from_world, 1, q);
      z[k] = row_times(view.clip_from_world, 2, q);
      w[k] = row_times(view.clip_from_world, 3, q);
    }
    // A point b0 p0 + b1 p1 + b2 p2 is at the place (s, t) of the picture, from -1 to 1, iff b is orthogonal to both
    // x - s w and y - t w, so b is along their cross product n, whose parts are linear in s and t, and n . w is the
    // same everywhere: the determinant of x, y and w. All three b have one sign iff all n have that of n . w, if the
    // point is in front of the eye.
    const int width = static_cast<int>(view.width), height = static_cast<int>(view.height);
    width_ = width;
    height_ = height;
    Number n[3][3];  // constant, s, t
    for (int k = 0; k < 3; ++k) {
      const int l = (k + 1) % 3, m = (k + 2) % 3;
      n[k][0] = x[l] * y[m] - x[m] * y[l];
      n[k][1] = w[m] * y[l] - w[l] * y[m];
      n[k][2] = w[l] * x[m] - w[m] * x[l];
    }
    const Number determinant = w[0] * n[0][0] + w[1] * n[1][0] + w[2] * n[2][0];
    const int side = sgn(determinant);
    if (side == 0) return;
    for (int k = 0; k < 3; ++k) edge_[k] = in_half_pixels(n[k][0] * side, n[k][1] * side, n[k][2] * side);

    const bool zero_to_one = view.depth_range == pgl::DepthRange::zero_to_one;
    const bool reversed = view.depth_order == pgl::DepthOrder::reversed;
    Number d[3];
    for (int j = 0; j < 3; ++j) {
      d[j] = (z[0] * n[0][j] + z[1] * n[1][j] + z[2] * n[2][j]) / determinant;
      if (!zero_to_one) d[j] = (d[j] + (j == 0 ? 1 : 0)) / 2;
      if (reversed) d[j] = (j == 0 ? 1 : 0) - d[j];
    }
    depth_ = in_half_pixels(d[0], d[1], d[2]);
    beyond_ = in_half_pixels(1 - d[0], -d[1], -d[2]);

    // The pixels that it can touch, roughly; all where a corner is not in front of the eye.
    x1_ = width;
    y1_ = height;
    if (w[0] > 0 && w[1] > 0 && w[2] > 0) {
      double low[2] = {1e300, 1e300}, high[2] = {-1e300, -1e300};
      for (int k = 0; k < 3; ++k) {
        const double place[2] = {Number((x[k] / w[k] + 1) * width / 2).get_d(),
                                 Number((y[k] / w[k] + 1) * height / 2).get_d()};
        for (int axis = 0; axis < 2; ++axis) {
          low[axis] = std::min(low[axis], place[axis]);
          high[axis] = std::max(high[axis], place[axis]);
        }
      }
      const auto whole = [](double v, int most) {
        return static_cast<int>(std::clamp(v, 0.0, static_cast<double>(most)));
      };
      x0_ = whole(low[0] - 2, width);
      y0_ = whole(low[1] - 2, height);
      x1_ = whole(high[0] + 2, width);
      y1_ = whole(high[1] + 2, height);
    }
    drawn_ = true;
  }

  /// Whether it is seen there, its edges included; strictly: without its edges.
  bool covers(int hx, int hy, bool strictly = false) const {
    if (!drawn_) return false;
    const int least = strictly ? 1 : 0;
    return edge_[0].sign(hx, hy) >= least && edge_[1].sign(hx, hy) >= least && edge_[2].sign(hx, hy) >= least &&
           depth_.sign(hx, hy) >= 0 && beyond_.sign(hx, hy) >= 0;
  }
  bool covers_pixel(int i, int j, bool strictly = false) const { return covers(2 * i + 1, 2 * j + 1, strictly); }

  const Plane& depth() const { return depth_; }
  Number depth_at_pixel(int i, int j) const { return depth_.at(2 * i + 1, 2 * j + 1); }

  /// Calls f(i, j) for every pixel whose centre it covers.
  template <class F>
  void for_each_pixel(F&& f) const {
    if (!drawn_) return;
    for (int j = y0_; j < y1_; ++j)
      for (int i = x0_; i < x1_; ++i)
        if (covers_pixel(i, j)) f(i, j);
  }

 private:
  Plane in_half_pixels(const Number& c, const Number& s, const Number& t) const {
    return {c - s - t, s / width_, t / height_};  // s = hx / width - 1
  }

  Plane edge_[3], depth_, beyond_;
  int width_ = 1, height_ = 1;
  int x0_ = 0, y0_ = 0, x1_ = 0, y1_ = 0;
  bool drawn_ = false;
};

/// The triangles of an object as the view shows them, its vertices carried by transform_point.
template <class Index>
std::vector<DrawnTriangle> drawn_triangles(const pgl::View& view, const pgl::Object& object,
                                           std::span<const glm::vec3> mesh_vertices,
                                           std::span<const pgl::Triangle<Index>> mesh_triangles) {
  std::vector<DrawnTriangle> drawn;
  const auto place = [&](Index v) { return pgl::transform_point(object.transform, mesh_vertices[v]); };
  for (const pgl::Triangle<Index>& t : mesh_triangles)
    drawn.emplace_back(view, place(t.v[0]), place(t.v[1]), place(t.v[2]));
  return drawn;
}
template <class Index>
std::vector<DrawnTriangle> drawn_triangles(const pgl::View& view, const pgl::Object& object,
                                           std::span<const pgl::Mesh> meshes, std::span<const glm::vec3> vertices,
                                           std::span<const pgl::Triangle<Index>> triangles,
                                           std::span<const std::uint32_t> map) {
  const pgl::Mesh& mesh = meshes[object.mesh];
  return drawn_triangles<Index>(
      view, object, vertices.subspan(mesh.first_vertex, mesh.max_vertices),
      triangles.subspan(mesh.first_triangle, pgl::triangles_at(mesh, map.data(), mesh.max_vertices)));
}

/// The picture: at the centre of each pixel the nearest of the triangles drawn, which must outlive it.
class Picture {
 public:
  explicit Picture(const pgl::View& view)
      : width_(static_cast<int>(view.width)),
        nearest_(static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height)) {}

  void draw(const DrawnTriangle& triangle) {
    triangle.for_each_pixel([&](int i, int j) {
      const DrawnTriangle*& at = nearest_[index(i, j)];
      if (at == nullptr || triangle.depth().compare(at->depth(), 2 * i + 1, 2 * j + 1) < 0) at = &triangle;
    });
  }
  void draw(const std::vector<DrawnTriangle>& triangles) {
    for (const DrawnTriangle& t : triangles) draw(t);
  }

  /// The triangle seen at a pixel's centre; null where there is none.
  const DrawnTriangle* at(int i, int j) const { return nearest_[index(i, j)]; }

  /// Whether something drawn is strictly nearer than the triangle at a pixel's centre.
  bool hides(const DrawnTriangle& triangle, int i, int j) const {
    const DrawnTriangle* const seen = at(i, j);
    return seen != nullptr && seen->depth().compare(triangle.depth(), 2 * i + 1, 2 * j + 1) < 0;
  }

  /// Whether that is so wherever the triangles are: then they may be left out, and nobody sees it.
  bool hides(const std::vector<DrawnTriangle>& triangles) const {
    bool hidden = true;
    for (const DrawnTriangle& t : triangles) t.for_each_pixel([&](int i, int j) { hidden = hidden && hides(t, i, j); });
    return hidden;
  }

 private:
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(i);
  }
  int width_;
  std::vector<const DrawnTriangle*> nearest_;
};

}  // namespace exact
