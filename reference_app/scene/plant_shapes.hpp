// SPDX-License-Identifier: MIT
// The parts that the plant is made of, as triangles: what plant.cpp lays out, this file draws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "pgl/ieee.hpp"
#include "pgl/types.hpp"
#include "scene/mesh_data.hpp"
#include "scene/plant.hpp"

namespace pgl::scene::shapes {

/// A double whose operators round once each and are never fused, so that every compiler makes the same plant.
struct Real {
  double v = 0;
  constexpr Real() = default;
  constexpr Real(double x) : v(x) {}  // implicit: formulas mix them with literals
};
constexpr Real operator+(Real a, Real b) {
  return ieee::add(a.v, b.v);
}
constexpr Real operator-(Real a, Real b) {
  return ieee::sub(a.v, b.v);
}
constexpr Real operator*(Real a, Real b) {
  return ieee::mul(a.v, b.v);
}
constexpr Real operator/(Real a, Real b) {
  return ieee::div(a.v, b.v);
}
constexpr Real operator-(Real a) {
  return -a.v;
}
constexpr bool operator<(Real a, Real b) {
  return a.v < b.v;
}
constexpr bool operator>(Real a, Real b) {
  return a.v > b.v;
}
inline Real root(Real a) {
  return ieee::sqrt(a.v);
}

struct Vec {
  Real x, y, z;
};
constexpr Vec operator+(Vec a, Vec b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
constexpr Vec operator-(Vec a, Vec b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
constexpr Vec operator-(Vec a) {
  return {-a.x, -a.y, -a.z};
}
constexpr Vec operator*(Vec a, Real s) {
  return {a.x * s, a.y * s, a.z * s};
}
constexpr Real dot(Vec a, Vec b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
constexpr Vec cross(Vec a, Vec b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Real length(Vec a) {
  return root(dot(a, a));
}
inline Vec unit(Vec a) {
  const Real l = length(a);
  return {a.x / l, a.y / l, a.z / l};
}

/// A place with right-handed orthonormal axes.
struct Frame {
  Vec o;
  Vec x{1, 0, 0};
  Vec y{0, 1, 0};
  Vec z{0, 0, 1};
};
constexpr Vec at(const Frame& f, Real u, Real v, Real w) {
  return f.o + f.x * u + f.y * v + f.z * w;
}
/// The same axes at another place, given in the frame itself.
constexpr Frame moved(const Frame& f, Real u, Real v, Real w) {
  return {at(f, u, v, w), f.x, f.y, f.z};
}
/// The same place with the axes renamed, so that z is what was x (or y).
constexpr Frame along_x(const Frame& f) {
  return {f.o, f.y, f.z, f.x};
}
constexpr Frame along_y(const Frame& f) {
  return {f.o, f.z, f.x, f.y};
}

/// Cosine and sine.
struct Turn {
  Real c, s;
};
/// Cosine and sine of an angle in turns, |turns| < 2^40: within 1e-15, and the same bits everywhere.
Turn turn(Real turns);

/// One object of a plan: what it is, where (in its bay), and the numbers of its shape. What p, n and variant mean is
/// said at the drawing function of each kind.
struct Part {
  PlantKind kind = PlantKind::plate;
  std::uint8_t variant = 0;
  bool split = false;  ///< every face its own piece, with its own borders, as where a CAD kernel did not stitch
  std::array<int, 3> n{};
  std::array<Real, 7> p{};
  Frame frame;
  std::uint32_t vertices = 0;  ///< from measure
  std::uint32_t triangles = 0;
};

/// Sets the part's vertex and triangle counts.
void measure(Part& part);

/// Whether the drawn surface is closed.
bool is_closed(const Part& part);

/// Draws a measured part at `place` (in world space, instead of part.frame); `chance` varies what may vary.
void draw(const Part& part, const Frame& place, std::uint64_t chance, MeshData& mesh);

}  // namespace pgl::scene::shapes
