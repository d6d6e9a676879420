// SPDX-License-Identifier: MIT
// Draws the plant's parts: surfaces of revolution, prisms, tubes and boxes, put together.

#include "scene/plant_shapes.hpp"

#include <span>
#include <vector>

namespace pgl::scene::shapes {

Turn turn(Real turns) {
  // Quarter turns are taken off exactly; the rest, at most an eighth of a turn, by Taylor's series.
  const Real shifted = turns * 4.0 + 0.5;
  auto quarter = static_cast<std::int64_t>(shifted.v);
  if (static_cast<double>(quarter) > shifted.v) --quarter;
  const Real a = (turns - Real(static_cast<double>(quarter)) * 0.25) * 6.283185307179586;
  const Real a2 = a * a;
  Real c = 1.0, s = 1.0;
  for (int k = 16; k >= 2; k -= 2) {
    c = 1.0 - c * a2 / Real(k * (k - 1));
    s = 1.0 - s * a2 / Real(k * (k + 1));
  }
  s = s * a;
  switch (quarter & 3) {
    case 0:
      return {c, s};
    case 1:
      return {-s, c};
    case 2:
      return {-c, -s};
    default:
      return {s, -c};
  }
}

namespace {

constexpr int max_sides = 128;
constexpr int max_profile = 320;

/// The corners of the regular polygon of n sides, 1 <= n <= max_sides.
std::span<const Turn> circle(int n) {
  static const std::vector<Turn> all = [] {
    std::vector<Turn> table;
    for (int sides = 0; sides <= max_sides; ++sides)
      for (int i = 0; i < sides; ++i) table.push_back(turn(Real(i) / Real(sides)));
    return table;
  }();
  PGL_ASSERT(n >= 1 && n <= max_sides);
  return {all.data() + n * (n - 1) / 2, static_cast<std::size_t>(n)};
}

/// A point of a profile (radius, height) or of a section (across, up).
struct Point {
  Real u, v;
};

/// A short list of points on the stack.
struct Outline {
  std::array<double, 2 * max_profile> data;  // NOLINT: left unset, `size` says what is set
  int size = 0;
  Outline() {}
  Outline(std::initializer_list<Point> points) {
    for (const Point& p : points) push(p.u, p.v);
  }
  void push(Real u, Real v) {
    PGL_ASSERT(size < max_profile);
    data[2 * size] = u.v;
    data[2 * size + 1] = v.v;
    ++size;
  }
  Point operator[](int i) const { return {data[2 * i], data[2 * i + 1]}; }
};

/// Where the triangles go; without arrays it only counts.
class Pen {
 public:
  explicit Pen(bool split_faces) : split(split_faces) {}
  Pen(bool split_faces, MeshData& mesh)
      : split(split_faces), positions_(mesh.positions.data()), triangles_(mesh.triangles.data()) {}

  std::uint32_t vertex(Vec p) {
    if (positions_) positions_[vertices] = {ieee::to_float(p.x.v), ieee::to_float(p.y.v), ieee::to_float(p.z.v)};
    return vertices++;
  }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (triangles_) triangles_[triangles] = {{a, b, c}};
    ++triangles;
  }
  void quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    triangle(a, b, c);
    triangle(a, c, d);
  }
  bool counts_only() const { return positions_ == nullptr; }

  const bool split;
  std::uint32_t vertices = 0;
  std::uint32_t triangles = 0;

 private:
  glm::vec3* positions_ = nullptr;
  Triangle<std::uint32_t>* triangles_ = nullptr;
};

// ---- primitives -----------------------------------------------------------------------------------------------------

/// A ring of n vertices about the frame's z axis, or the one vertex on it. Returns the first.
std::uint32_t ring(Pen& pen, const Frame& f, Point p, int n) {
  const std::uint32_t first = pen.vertices;
  if (!(p.u > 0.0)) return pen.vertex(f.o + f.z * p.v);
  if (pen.counts_only()) {
    pen.vertices += static_cast<std::uint32_t>(n);
    return first;
  }
  const Vec centre = f.o + f.z * p.v;
  for (const Turn& t : circle(n)) pen.vertex(centre + f.x * (p.u * t.c) + f.y * (p.u * t.s));
  return first;
}

/// Triangles between two rings; b lies on the side that is up when the outside is away from the axis.
void band(Pen& pen, std::uint32_t a, bool pole_a, std::uint32_t b, bool pole_b, int n) {
  const auto count = static_cast<std::uint32_t>(n);
  if (pen.counts_only()) {
    pen.triangles += (pole_a || pole_b) ? count : 2 * count;
    return;
  }
  for (std::uint32_t j = 0; j < count; ++j) {
    const std::uint32_t k = j + 1 == count ? 0 : j + 1;
    if (pole_a)
      pen.triangle(a, b + k, b + j);
    else if (pole_b)
      pen.triangle(a + j, a + k, b);
    else
      pen.quad(a + j, a + k, b + k, b + j);
  }
}

/// Revolves a profile about z: points go up along the outside, down along the inside. `loop` closes it to a torus.
void lathe(Pen& pen, const Frame& f, const Outline& profile, int n, bool loop = false) {
  const int bands = loop ? profile.size : profile.size - 1;
  const auto pole = [&](int i) { return !(profile[i].u > 0.0); };
  if (pen.split) {
    for (int i = 0; i < bands; ++i) {
      const int k = i + 1 == profile.size ? 0 : i + 1;
      const std::uint32_t a = ring(pen, f, profile[i], n);
      const std::uint32_t b = ring(pen, f, profile[k], n);
      band(pen, a, pole(i), b, pole(k), n);
    }
    return;
  }
  const std::uint32_t first = ring(pen, f, profile[0], n);
  std::uint32_t a = first;
  for (int i = 0; i < bands; ++i) {
    const int k = i + 1 == profile.size ? 0 : i + 1;
    const std::uint32_t b = k == 0 ? first : ring(pen, f, profile[k], n);
    band(pen, a, pole(i), b, pole(k), n);
    a = b;
  }
}

/// A round bar along z from w0 to w1, closed by flat ends (or open: a tube).
void bar(Pen& pen, const Frame& f, Real r, Real w0, Real w1, int n, bool ends = true) {
  const auto fan = [&](std::uint32_t first, bool top) {
    for (std::uint32_t j = 1; j + 1 < static_cast<std::uint32_t>(n); ++j)
      top ? pen.triangle(first, first + j, first + j + 1) : pen.triangle(first, first + j + 1, first + j);
  };
  const std::uint32_t a = ring(pen, f, {r, w0}, n);
  const std::uint32_t b = ring(pen, f, {r, w1}, n);
  band(pen, a, false, b, false, n);
  if (!ends) return;
  fan(pen.split ? ring(pen, f, {r, w0}, n) : a, false);
  fan(pen.split ? ring(pen, f, {r, w1}, n) : b, true);
}

/// Extrudes along z, from w0 to w1, the section made of the quads left[i], right[i], right[i+1], left[i+1], each
/// counter-clockwise in (x, y).
void prism(Pen& pen, const Frame& f, const Outline& left, const Outline& right, Real w0, Real w1) {
  const int m = left.size;
  const int corners = 2 * m;
  const auto corner = [&](int i) { return i < m ? right[i] : left[corners - 1 - i]; };
  const auto put = [&](int i, Real w) { return pen.vertex(at(f, corner(i).u, corner(i).v, w)); };
  const auto put_all = [&](Real w) {
    const std::uint32_t first = pen.vertices;
    for (int i = 0; i < corners; ++i) put(i, w);
    return first;
  };
  const auto side = static_cast<std::uint32_t>(corners);
  std::uint32_t bottom = 0, top = 0;
  if (pen.split) {
    for (int i = 0; i < corners; ++i) {
      const int k = i + 1 == corners ? 0 : i + 1;
      const std::uint32_t a = put(i, w0), b = put(k, w0), c = put(k, w1), d = put(i, w1);
      pen.quad(a, b, c, d);
    }
    bottom = put_all(w0);
    top = put_all(w1);
  } else {
    bottom = put_all(w0);
    top = put_all(w1);
    for (std::uint32_t i = 0; i < side; ++i) {
      const std::uint32_t k = i + 1 == side ? 0 : i + 1;
      pen.quad(bottom + i, bottom + k, top + k, top + i);
    }
  }
  for (std::uint32_t i = 0; i + 1 < static_cast<std::uint32_t>(m); ++i) {
    const std::uint32_t l = side - 1 - i;
    pen.quad(top + l, top + i, top + i + 1, top + l - 1);
    pen.quad(bottom + l - 1, bottom + i + 1, bottom + i, bottom + l);
  }
}

/// A box between two corners of the frame.
void box(Pen& pen, const Frame& f, Vec lo, Vec hi) {
  prism(pen, f, {{lo.x, lo.y}, {lo.x, hi.y}}, {{hi.x, lo.y}, {hi.x, hi.y}}, lo.z, hi.z);
}

/// A tube of `rings` rings of n sides; place(k) gives ring k's centre and two directions, u x v along the way.
struct Station {
  Vec o, u, v;
};
template <class Place>
void tube(Pen& pen, int rings, Real r, int n, bool ends, Place&& place) {
  const auto count = static_cast<std::uint32_t>(n);
  if (pen.counts_only()) {
    pen.vertices += static_cast<std::uint32_t>(rings) * count;
    pen.triangles += static_cast<std::uint32_t>(rings - 1) * 2 * count + (ends ? 2 * (count - 2) : 0);
    return;
  }
  std::uint32_t a = 0;
  for (int k = 0; k < rings; ++k) {
    const Station s = place(k);
    const std::uint32_t b = pen.vertices;
    const Vec u = s.u * r, v = s.v * r;
    for (const Turn& t : circle(n)) pen.vertex(s.o + u * t.c + v * t.s);
    if (k > 0) band(pen, a, false, b, false, n);
    if (ends && k == 0)
      for (std::uint32_t j = 1; j + 1 < count; ++j) pen.triangle(b, b + j + 1, b + j);
    if (ends && k == rings - 1)
      for (std::uint32_t j = 1; j + 1 < count; ++j) pen.triangle(b, b + j, b + j + 1);
    a = b;
  }
}

/// A strip of sheet metal: the outline in the frame's (x, y) raised along z from w0 to w1, seen from the outline's
/// right.
void sheet(Pen& pen, const Frame& f, const Outline& outline, Real w0, Real w1) {
  std::uint32_t a = 0;
  for (int i = 0; i < outline.size; ++i) {
    const std::uint32_t b = pen.vertex(at(f, outline[i].u, outline[i].v, w0));
    pen.vertex(at(f, outline[i].u, outline[i].v, w1));
    if (i > 0) pen.quad(a, b, b + 1, a + 1);
    a = b;
  }
}

/// A number in [0, 1) from `chance`, another for every `which`.
Real unit_chance(std::uint64_t chance, int which) {
  return static_cast<double>((chance >> (which * 16)) & 0xffff) * 0x1p-16;
}

/// The frame turned about its own z axis.
Frame spun(const Frame& f, Real turns) {
  const Turn t = turn(turns);
  return {f.o, f.x * t.c + f.y * t.s, f.y * t.c - f.x * t.s, f.z};
}

/// A quarter of an ellipse, from (a, 0) to (0, b) with `steps` steps, the last point left out.
template <class Push>
void quarter(int steps, Push&& push) {
  const std::span<const Turn> t = circle(4 * steps);
  for (int i = 0; i < steps; ++i) push(t[i].c, t[i].s);
}

// ---- kinds ----------------------------------------------------------------------------------------------------------
// p: lengths in metres. n: numbers of sides, rings and the like. f: the frame, z up unless said otherwise.

/// Standing tank. p: radius, height, rise of the roof. n: sides, courses of the shell, rings of the roof.
void draw_tank(Pen& pen, const Part& q, const Frame& f) {
  const Real r = q.p[0], h = q.p[1], rise = q.p[2];
  Outline o{{0, 0}, {r + 0.06, 0}, {r + 0.06, 0.02}, {r, 0.02}};
  const Real top = h - 0.12;
  for (int i = 1; i <= q.n[1]; ++i) {
    const Real z = 0.02 + (top - 0.02) * Real(i) / Real(q.n[1]);
    o.push(r, z);
  }
  o.push(r + 0.07, top);
  o.push(r + 0.07, h);
  for (int i = 0; i < q.n[2]; ++i) {
    const Real s = 1.0 - Real(i) / Real(q.n[2]);
    o.push(r * s, h + rise * (1.0 - s * s));
  }
  o.push(0, h + rise);
  lathe(pen, f, o, q.n[0]);
}

/// Drum with elliptical heads along z, from the lower tangent line at the origin. p: radius, length between the tangent
/// lines, depth of a head. n: sides, rings of the shell, rings of a head.
void draw_vessel(Pen& pen, const Part& q, const Frame& f) {
  const Real r = q.p[0], l = q.p[1], depth = q.p[2];
  Outline o;
  const std::span<const Turn> t = circle(4 * q.n[2]);
  o.push(0, -depth);
  for (int i = q.n[2] - 1; i >= 1; --i) o.push(r * t[i].c, -(depth * t[i].s));
  for (int i = 0; i <= q.n[1]; ++i) o.push(r, l * Real(i) / Real(q.n[1]));
  for (int i = 1; i < q.n[2]; ++i) o.push(r * t[i].c, l + depth * t[i].s);
  o.push(0, l + depth);
  lathe(pen, f, o, q.n[0]);
}

/// 0: box, p: half sizes, top at the origin's height. 1: disc, p: radius, thickness; n: sides.
void draw_slab(Pen& pen, const Part& q, const Frame& f) {
  if (q.variant == 0)
    box(pen, f, {-q.p[0], -q.p[1], -(q.p[2] * 2.0)}, {q.p[0], q.p[1], 0});
  else
    lathe(pen, f, {{0, -q.p[1]}, {q.p[0], -q.p[1]}, {q.p[0], -0.03}, {q.p[0] - 0.03, 0}, {0, 0}}, q.n[0]);
}

/// Rolled section along z. p: half width, half height, length, thickness of the flange, half thickness of the web.
/// n[0]: steps of the root fillet. 0: I and H (with tapered flanges). 1: angle. 2: channel.
void draw_profile(Pen& pen, const Part& q, const Frame& f) {
  const Real b = q.p[0], h = q.p[1], l = q.p[2], tf = q.p[3], tw = q.p[4];
  Outline left, right;
  if (q.variant == 1) {
    left = {{b * 2.0, 0}, {0, 0}, {0, b * 2.0}};
    right = {{b * 2.0, tf}, {tf, tf}, {tf, b * 2.0}};
  } else if (q.variant == 2) {
    left = {{b, -h}, {-b, -h}, {-b, h}, {b, h}};
    right = {{b, tf - h}, {tw * 2.0 - b, tf - h}, {tw * 2.0 - b, h - tf}, {b, h - tf}};
  } else {
    const Real tip = tf * 0.8, rootz = tf * 1.2;
    const Real radius = q.n[0] > 0 ? tf * 1.2 : Real(0);
    right.push(b, -h);
    right.push(b, tip - h);
    const std::span<const Turn> t = circle(4 * (q.n[0] > 0 ? q.n[0] : 1));
    for (int i = 0; i <= q.n[0]; ++i)  // from the flange into the web
      right.push(tw + radius * (1.0 - t[i].s), rootz - h + radius * (1.0 - t[i].c));
    for (int i = q.n[0]; i >= 0; --i) right.push(tw + radius * (1.0 - t[i].s), h - rootz - radius * (1.0 - t[i].c));
    right.push(b, h - tip);
    right.push(b, h);
    for (int i = 0; i < right.size; ++i) left.push(-right[i].u, right[i].v);
  }
  prism(pen, f, left, right, 0, l);
}

/// 0: panel, from the corner at the origin along x and y, top at the origin's height. p: length, width. n: bearing bars
/// along x, cross bars. 1: ring platform. p: inner and outer radius, thickness; n: sides, brackets.
void draw_grating(Pen& pen, const Part& q, const Frame& f) {
  if (q.variant == 1) {
    lathe(pen, f, {{q.p[0], -q.p[2]}, {q.p[1], -q.p[2]}, {q.p[1], 0}, {q.p[0], 0}}, q.n[0], true);
    for (int i = 0; i < q.n[1]; ++i) {
      const Frame g = along_y(spun(f, Real(i) / Real(q.n[1])));  // x up, y outward, z sideways
      prism(pen, g, {{-q.p[2] - 0.4, q.p[0] + 0.02}, {-q.p[2] - 0.1, q.p[1] - 0.05}},
            {{-q.p[2], q.p[0] + 0.02}, {-q.p[2], q.p[1] - 0.05}}, -0.01, 0.01);
    }
    return;
  }
  const Real l = q.p[0], w = q.p[1];
  for (int i = 0; i < q.n[0]; ++i) {
    const Real y = w * (Real(i) + 0.5) / Real(q.n[0]);
    box(pen, f, {0.006, y - 0.0025, -0.03}, {l - 0.006, y + 0.0025, 0});
  }
  for (int i = 0; i < q.n[1]; ++i) {
    const Real x = l * (Real(i) + 0.5) / Real(q.n[1]);
    box(pen, f, {x - 0.003, 0, -0.012}, {x + 0.003, w, -0.004});
  }
  box(pen, f, {0, 0, -0.03}, {0.005, w, 0.001});
  box(pen, f, {l - 0.005, 0, -0.03}, {l, w, 0.001});
}

/// Along x from the origin. p: length, height. n: sides of the bars, posts.
void draw_handrail(Pen& pen, const Part& q, const Frame& f) {
  const Real l = q.p[0], h = q.p[1];
  for (int i = 0; i < q.n[1]; ++i)
    bar(pen, moved(f, 0.03 + (l - 0.06) * Real(i) / Real(q.n[1] - 1), 0, 0), 0.021, 0, h - 0.01, q.n[0]);
  bar(pen, along_x(moved(f, 0, 0, h)), 0.024, 0, l, q.n[0]);
  bar(pen, along_x(moved(f, 0, 0, h * 0.5)), 0.017, 0, l, q.n[0]);
  box(pen, f, {0, -0.028, 0.01}, {l, -0.022, 0.11});
}

/// A flight up along x from the origin. p: rise, run, width. n: treads, sides of the rails.
void draw_stair(Pen& pen, const Part& q, const Frame& f) {
  const Real rise = q.p[0], run = q.p[1], half = q.p[2] * 0.5;
  const Vec way{run, 0, rise};
  const Real l = length(way);
  const Real c = run / l, s = rise / l;
  const Vec slope = f.x * c + f.z * s;
  const Frame up{f.o, f.y, cross(slope, f.y), slope};  // y of `up` points up, square to the flight
  for (const Real y : {-half, half}) {
    box(pen, up, {y - 0.006, -0.22, 0}, {y + 0.006, 0.02, l});
    const Frame rail{at(f, 0, y, 0), f.y, up.y, slope};
    const Vec lift = f.z * Real(0.95);
    bar(pen, {rail.o + lift, rail.x, rail.y, rail.z}, 0.02, 0, l, q.n[1]);
    bar(pen, {rail.o + lift * 0.5, rail.x, rail.y, rail.z}, 0.016, 0, l, q.n[1]);
    for (int i = 0; i < 4; ++i) {
      const Real k = (Real(i) + 0.25) / 3.5;
      bar(pen, moved(f, run * k, y, rise * k), 0.017, -0.05, 0.94, q.n[1]);
    }
  }
  for (int i = 0; i < q.n[0]; ++i) {
    const Real k = (Real(i) + 1.0) / Real(q.n[0] + 1);
    for (int j = 0; j < 5; ++j) {
      const Real x = run * k - 0.12 + Real(j) * 0.055;
      box(pen, f, {x, 0.007 - half, rise * k - 0.03}, {x + 0.02, half - 0.007, rise * k});
    }
  }
}

/// Up along z; y away from the wall, which is 0.2 m behind. p: height, width, height where the cage begins (0: none).
/// n[0]: sides of the rungs.
void draw_ladder(Pen& pen, const Part& q, const Frame& f) {
  const Real h = q.p[0], half = q.p[1] * 0.5, cage = q.p[2];
  const Real step = 0.3;
  for (const Real x : {-half - 0.012, half}) box(pen, f, {x, -0.03, 0}, {x + 0.012, 0.03, h});
  for (Real z = step; z < h - 0.05; z = z + step) bar(pen, along_x(moved(f, 0, 0, z)), 0.012, -half, half, q.n[0]);
  for (Real z = 0.9; z < h; z = z + 2.4)
    for (const Real x : {-half - 0.012, half}) box(pen, f, {x, -0.2, z - 0.03}, {x + 0.012, -0.03, z + 0.03});
  if (!(cage > 0.0)) return;
  constexpr int steps = 12;
  Outline hoop;
  for (int i = 0; i <= steps; ++i) {
    const Turn t = turn(Real(i) / Real(steps) * 0.75 - 0.125);
    hoop.push(t.c * 0.38, t.s * 0.38 + 0.33);
  }
  Real last = cage;
  for (Real z = cage; z < h - 0.1; z = z + 0.9) {
    sheet(pen, f, hoop, z, z + 0.05);
    last = z;
  }
  for (int i = 0; i <= 4; ++i) {
    const Turn t = turn(Real(i) * 0.15 - 0.05);
    const Real u = t.c * 0.378, v = t.s * 0.378 + 0.33;
    sheet(pen, f, {{u + t.s * 0.02, v - t.c * 0.02}, {u - t.s * 0.02, v + t.c * 0.02}}, cage, last + 0.05);
  }
}

/// Along z from the origin. p: radius, length. n: sides, rings. 0: the outer skin. 1: hollow, with a wall.
void draw_pipe(Pen& pen, const Part& q, const Frame& f) {
  const Real r = q.p[0], l = q.p[1];
  Outline o;
  for (int i = 0; i <= q.n[1]; ++i) o.push(r, l * Real(i) / Real(q.n[1]));
  if (q.variant == 1) {
    o.push(r * 0.88, l);
    o.push(r * 0.88, 0);
  }
  lathe(pen, f, o, q.n[0], q.variant == 1);
}

/// A quarter bend from the origin, leaving along x, turning towards y. p: radius of the bend, of the pipe. n: sides,
/// rings.
void draw_elbow(Pen& pen, const Part& q, const Frame& f) {
  const Real bend = q.p[0];
  const std::span<const Turn> t = circle(4 * (q.n[1] - 1));
  tube(pen, q.n[1], q.p[1], q.n[0], false, [&](int k) {
    const Vec radial = f.x * t[k].s - f.y * t[k].c;
    return Station{f.o + f.y * bend + radial * bend, radial, -f.z};
  });
}

/// Mating face at the origin, neck along z. p: radius of the pipe, of the flange, thickness, height of the neck. n:
/// sides. 0: weld neck. 1: blind.
void draw_flange(Pen& pen, const Part& q, const Frame& f) {
  const Real r = q.p[0], outer = q.p[1], t = q.p[2], neck = q.p[3];
  if (q.variant == 1) {
    lathe(pen, f, {{0, 0}, {outer, 0}, {outer, t * 0.9}, {outer - t * 0.1, t}, {0, t}}, q.n[0]);
    return;
  }
  const Real face = r + (outer - r) * 0.55;
  lathe(pen, f,
        {{r, 0},
         {face, 0},
         {face, t * 0.1},
         {outer, t * 0.1},
         {outer, t},
         {r + neck * 0.4, t},
         {r + neck * 0.28, t + neck * 0.1},
         {r + neck * 0.2, t + neck * 0.3},
         {r + neck * 0.12, t + neck},
         {r, t + neck}},
        q.n[0], true);
}

/// Centre at the origin, pipe along z, stem along x. p: radius of the pipe, half the length from face to face, radius
/// and thickness of its flanges. n: sides. 0: gate valve with a wheel. 1: ball valve with a lever.
void draw_valve(Pen& pen, const Part& q, const Frame& f, std::uint64_t chance) {
  const Real r = q.p[0], l = q.p[1], outer = q.p[2], t = q.p[3];
  const int n = q.n[0];
  constexpr int steps = 6;
  Outline o{{0, -l}, {outer, -l}, {outer, t - l}, {r * 1.25, t - l}};
  const Real ball = r * (q.variant == 1 ? 1.9 : 1.6);
  const std::span<const Turn> c = circle(4 * steps);
  for (int i = steps - 2; i >= 1; --i) o.push(ball * c[i].c, -(ball * c[i].s));
  o.push(ball, 0);
  for (int i = 1; i <= steps - 2; ++i) o.push(ball * c[i].c, ball * c[i].s);
  o.push(r * 1.25, l - t);
  o.push(outer, l - t);
  o.push(outer, l);
  o.push(0, l);
  lathe(pen, f, o, n);
  const Frame stem = spun(along_x(f), unit_chance(chance, 0));
  if (q.variant == 1) {
    const Real top = ball + r * 0.8;
    lathe(pen, stem,
          {{0, ball * 0.8}, {r * 0.5, ball * 0.8}, {r * 0.5, top}, {r * 0.25, top + r * 0.1}, {0, top + r * 0.1}},
          n / 2);
    const Frame lever = along_x(f);
    box(pen, lever, {-(r * 0.3), -(r * 0.3), top + r * 0.12}, {r * 0.3, r * 4.5, top + r * 0.3});
    bar(pen, along_y(moved(lever, 0, 0, top + r * 0.21)), r * 0.35, r * 4.0, r * 5.5, 12);
    return;
  }
  const Real yoke = ball + r * 2.0;
  lathe(pen, stem,
        {{0, ball * 0.7},
         {r * 0.9, ball * 0.7},
         {r * 0.9, ball + r * 0.3},
         {r * 1.4, ball + r * 0.3},
         {r * 1.4, ball + r * 0.7},
         {r * 0.8, ball + r * 0.7},
         {r * 0.4, yoke},
         {0, yoke}},
        n);
  const Real wheel = yoke + r * 1.2;
  bar(pen, stem, r * 0.16, yoke - r * 0.2, wheel + r * 0.8, 12);
  Outline rim;
  for (const Turn& p : circle(8)) rim.push(r * 1.6 + r * 0.14 * p.c, wheel + r * 0.14 * p.s);
  lathe(pen, stem, rim, n + 8, true);
  lathe(pen, stem, {{0, wheel - r * 0.2}, {r * 0.3, wheel - r * 0.2}, {r * 0.3, wheel + r * 0.2}, {0, wheel + r * 0.2}},
        12);
  for (int i = 0; i < 4; ++i)
    bar(pen, along_x(moved(spun(stem, Real(i) * 0.25), 0, 0, wheel)), r * 0.08, r * 0.25, r * 1.55, 8);
}

/// On a base at the origin, shaft along x. p: size. n: sides.
void draw_pump(Pen& pen, const Part& q, const Frame& f) {
  const Real s = q.p[0];
  const int n = q.n[0];
  box(pen, f, {s * -0.8, s * -0.28, 0}, {s * 0.62, s * 0.28, s * 0.1});
  const Frame shaft = along_x(moved(f, 0, 0, s * 0.42));
  const auto scaled = [&](std::initializer_list<Point> points) {
    Outline o;
    for (const Point& p : points) o.push(s * p.u, s * p.v);
    return o;
  };
  lathe(pen, shaft,
        scaled({{0, -0.78},
                {0.12, -0.78},
                {0.18, -0.74},
                {0.2, -0.7},
                {0.2, -0.55},
                {0.18, -0.55},
                {0.18, -0.2},
                {0.2, -0.2},
                {0.2, -0.08},
                {0.14, -0.05},
                {0.05, -0.05},
                {0.05, 0.02},
                {0.09, 0.02},
                {0.09, 0.1},
                {0.05, 0.1},
                {0.05, 0.24},
                {0, 0.24}}),
        n);
  for (int i = 0; i < 16; ++i)
    box(pen, spun(shaft, (Real(i) + 0.5) / 16.0), {s * 0.17, s * -0.006, s * -0.54}, {s * 0.215, s * 0.006, s * -0.21});
  lathe(pen, shaft,
        scaled({{0, 0.2},
                {0.16, 0.2},
                {0.24, 0.24},
                {0.28, 0.3},
                {0.29, 0.35},
                {0.28, 0.4},
                {0.24, 0.46},
                {0.14, 0.5},
                {0.11, 0.55},
                {0.11, 0.65},
                {0.17, 0.65},
                {0.17, 0.68},
                {0, 0.68}}),
        n);
  lathe(pen, moved(f, s * 0.35, 0, s * 0.42),
        scaled({{0, 0.2}, {0.12, 0.2}, {0.1, 0.4}, {0.17, 0.45}, {0.17, 0.48}, {0, 0.48}}), n);
  box(pen, moved(f, s * -0.38, 0, s * 0.5), {s * -0.1, s * -0.09, s * 0.1}, {s * 0.1, s * 0.09, s * 0.24});
  for (const Real x : {-0.66, -0.16, 0.3})
    box(pen, f, {s * x, s * -0.14, s * 0.1}, {s * (x + 0.06), s * 0.14, s * 0.3});
}

/// 0: pipe shoe, pipe along x. p: height, length. 1: saddle of a drum along z at the origin, y up. p: radius of the
/// drum, depth of the foot, thickness; n: steps. 2: four legs up to the origin. p: radius of their circle, height,
/// radius of a leg; n: sides. 3: skirt up to the origin. p: radius, height; n: sides. 4: plinth down from the origin.
/// p: half sizes.
void draw_support(Pen& pen, const Part& q, const Frame& f) {
  const Real a = q.p[0], b = q.p[1], c = q.p[2];
  switch (q.variant) {
    case 0:
      box(pen, f, {-b, -0.07, 0}, {b, 0.07, 0.012});
      box(pen, f, {-b, -0.006, 0.012}, {b, 0.006, a});
      break;
    case 1: {
      Outline left, right;
      for (int i = 0; i <= q.n[0]; ++i) {
        const Real u = a * (Real(i) / Real(q.n[0]) * 1.7 - 0.85);
        left.push(u, -root(a * a - u * u));
        right.push(u, -b);
      }
      prism(pen, f, left, right, c * -0.5, c * 0.5);
      box(pen, f, {-(a * 0.9), -b - 0.02, -c}, {a * 0.9, -b, c});
      break;
    }
    case 2:
      for (int i = 0; i < 4; ++i) {
        const Turn t = turn(Real(i) * 0.25 + 0.125);
        const Frame leg = moved(f, a * t.c, a * t.s, 0);
        bar(pen, leg, c, 0.015 - b, 0.1, q.n[0]);
        box(pen, leg, {c * -2.0, c * -2.0, -b}, {c * 2.0, c * 2.0, 0.015 - b});
      }
      break;
    case 3:
      lathe(pen, f,
            {{a - 0.02, -b}, {a + 0.12, -b}, {a + 0.12, 0.03 - b}, {a, 0.03 - b}, {a, b * -0.4}, {a, 0}, {a - 0.02, 0}},
            q.n[0], true);
      break;
    default:
      box(pen, f, {-a, -b, -c}, {a, b, 0});
  }
}

/// Along x from the origin, between the side rails; rungs at the origin's height. p: length, width, height. n: rungs.
void draw_tray(Pen& pen, const Part& q, const Frame& f) {
  const Real l = q.p[0], half = q.p[1] * 0.5, h = q.p[2];
  const Frame g = along_x(f);  // x across, y up, z along
  const Real in = half - 0.03;
  sheet(pen, g, {{in, -0.01}, {half, -0.01}, {half, h}, {in, h}}, 0, l);
  sheet(pen, g, {{-in, h}, {-half, h}, {-half, -0.01}, {-in, -0.01}}, 0, l);
  for (int i = 0; i < q.n[0]; ++i) {
    const Real x = l * (Real(i) + 0.5) / Real(q.n[0]);
    box(pen, f, {x - 0.02, 0.002 - half, -0.008}, {x + 0.02, half - 0.002, 0});
  }
}

/// 0: a wire laid along x from the origin, wandering. p: length, radius, amplitude sideways and upwards; n: sides,
/// rings, waves. 1: a Bezier curve from the origin in the (x, z) plane. p: the other three control points, radius; n:
/// sides, rings.
void draw_wire(Pen& pen, const Part& q, const Frame& f, std::uint64_t chance) {
  const Real last = Real(q.n[1] - 1);
  if (q.variant == 1) {
    const Real sag = 1.0 + unit_chance(chance, 0) * 0.1;
    const Real x1 = q.p[0], z1 = q.p[1] * sag, x2 = q.p[2], z2 = q.p[3] * sag, x3 = q.p[4], z3 = q.p[5];
    tube(pen, q.n[1], q.p[6], q.n[0], true, [&](int k) {
      const Real t = Real(k) / last, s = 1.0 - t;
      const Real b1 = s * s * t * 3.0, b2 = s * t * t * 3.0, b3 = t * t * t;
      const Real d0 = s * s, d1 = s * t * 2.0, d2 = t * t;
      const Real dx = d0 * x1 + d1 * (x2 - x1) + d2 * (x3 - x2);
      const Real dz = d0 * z1 + d1 * (z2 - z1) + d2 * (z3 - z2);
      const Vec way = unit(f.x * dx + f.z * dz);
      return Station{f.o + f.x * (b1 * x1 + b2 * x2 + b3 * x3) + f.z * (b1 * z1 + b2 * z2 + b3 * z3), f.y,
                     cross(way, f.y)};
    });
    return;
  }
  const Real l = q.p[0], side = q.p[2], lift = q.p[3] * 0.5, waves = q.n[2];
  const Real phase = unit_chance(chance, 0), phase2 = unit_chance(chance, 1);
  const Real speed = waves * 6.283185307179586;
  tube(pen, q.n[1], q.p[1], q.n[0], true, [&](int k) {
    const Real t = Real(k) / last;
    const Real window = t * (1.0 - t) * 4.0, slope = 4.0 - t * 8.0;  // nothing at the ends, where the next bay goes on
    const Turn a = turn(waves * t + phase), b = turn(waves * t * 2.0 + phase2);
    const Vec way = unit(
        {l, side * (slope * a.s + window * speed * a.c), lift * (slope * (1.0 + b.s) + window * speed * 2.0 * b.c)});
    const Vec across = unit({-way.y, way.x, 0});
    const Vec up = cross(way, across);
    const auto in_world = [&](Vec v) { return f.x * v.x + f.y * v.y + f.z * v.z; };
    return Station{at(f, l * t, side * window * a.s, lift * window * (1.0 + b.s)), in_world(across), in_world(up)};
  });
}

/// Centred at the origin, down along z. p: half sizes, thickness.
void draw_plate(Pen& pen, const Part& q, const Frame& f) {
  box(pen, f, {-q.p[0], -q.p[1], -q.p[2]}, {q.p[0], q.p[1], 0});
}

/// The right angle at the origin, legs along x and down z. p: the legs. 0: one triangle. 1: a plate, p[2] thick.
void draw_gusset(Pen& pen, const Part& q, const Frame& f) {
  if (q.variant == 0) {
    const std::uint32_t a = pen.vertex(f.o);
    pen.vertex(at(f, 0, 0, -q.p[1]));
    pen.vertex(at(f, q.p[0], 0, 0));
    pen.triangle(a, a + 1, a + 2);
    return;
  }
  const Real t = q.p[2] * 0.5;
  const std::uint32_t a = pen.vertices;
  for (const Real y : {-t, t}) {
    pen.vertex(at(f, 0, y, 0));
    pen.vertex(at(f, 0, y, -q.p[1]));
    pen.vertex(at(f, q.p[0], y, 0));
  }
  pen.triangle(a, a + 1, a + 2);
  pen.triangle(a + 3, a + 5, a + 4);
  for (std::uint32_t i = 0; i < 3; ++i) {
    const std::uint32_t k = (i + 1) % 3;
    pen.quad(a + k, a + i, a + 3 + i, a + 3 + k);
  }
}

/// Two triangles in (x, y), seen from z. p: half sizes.
void draw_name_plate(Pen& pen, const Part& q, const Frame& f) {
  const std::uint32_t a = pen.vertex(at(f, -q.p[0], -q.p[1], 0));
  pen.vertex(at(f, q.p[0], -q.p[1], 0));
  pen.vertex(at(f, q.p[0], q.p[1], 0));
  pen.vertex(at(f, -q.p[0], q.p[1], 0));
  pen.quad(a, a + 1, a + 2, a + 3);
}

/// Along z. p: radius of the shank, length of the grip. n: sides of the shank. 0: bolt through the grip, with head,
/// washers and nut. 1: anchor, a nut on a stud. 2: a head alone.
void draw_bolt(Pen& pen, const Part& q, const Frame& f, std::uint64_t chance) {
  const Real s = q.p[0], grip = q.p[1];
  const Real hex = s * 1.8, tall = s * 1.3;
  const Frame g = spun(f, unit_chance(chance, 0));
  const auto nut = [&](Real z, bool up) {
    if (up)
      lathe(pen, g, {{0, z}, {hex, z}, {hex, z + tall * 0.8}, {hex * 0.85, z + tall}, {0, z + tall}}, 6);
    else
      lathe(pen, g, {{0, z - tall}, {hex * 0.85, z - tall}, {hex, z - tall * 0.8}, {hex, z}, {0, z}}, 6);
  };
  if (q.variant == 2) {
    nut(0, true);
    return;
  }
  const Real washer = s * 0.3;
  const auto disc = [&](Real z) {
    lathe(pen, g, {{0, z}, {hex * 1.1, z}, {hex * 1.1, z + washer}, {0, z + washer}}, q.n[0]);
  };
  const Real end = grip + washer + tall * 1.5;
  if (q.variant == 1) {
    disc(grip);
    nut(grip + washer, true);
    lathe(pen, g, {{0, -grip}, {s, -grip}, {s, end}, {s * 0.8, end + s * 0.3}, {0, end + s * 0.3}}, q.n[0]);
    return;
  }
  disc(-washer);
  nut(-washer, false);
  disc(grip);
  nut(grip + washer, true);
  lathe(pen, g, {{0, tall * -0.5}, {s, tall * -0.5}, {s, end}, {s * 0.8, end + s * 0.3}, {0, end + s * 0.3}}, q.n[0]);
}

void draw_with(Pen& pen, const Part& q, const Frame& f, std::uint64_t chance) {
  switch (q.kind) {
    case PlantKind::tank:
      return draw_tank(pen, q, f);
    case PlantKind::vessel:
      return draw_vessel(pen, q, f);
    case PlantKind::slab:
      return draw_slab(pen, q, f);
    case PlantKind::column:
    case PlantKind::beam:
    case PlantKind::brace:
      return draw_profile(pen, q, f);
    case PlantKind::grating:
      return draw_grating(pen, q, f);
    case PlantKind::handrail:
      return draw_handrail(pen, q, f);
    case PlantKind::stair:
      return draw_stair(pen, q, f);
    case PlantKind::ladder:
      return draw_ladder(pen, q, f);
    case PlantKind::pipe:
      return draw_pipe(pen, q, f);
    case PlantKind::elbow:
      return draw_elbow(pen, q, f);
    case PlantKind::flange:
      return draw_flange(pen, q, f);
    case PlantKind::valve:
      return draw_valve(pen, q, f, chance);
    case PlantKind::pump:
      return draw_pump(pen, q, f);
    case PlantKind::support:
      return draw_support(pen, q, f);
    case PlantKind::tray:
      return draw_tray(pen, q, f);
    case PlantKind::wire:
      return draw_wire(pen, q, f, chance);
    case PlantKind::plate:
      return draw_plate(pen, q, f);
    case PlantKind::gusset:
      return draw_gusset(pen, q, f);
    case PlantKind::name_plate:
      return draw_name_plate(pen, q, f);
    case PlantKind::bolt:
      return draw_bolt(pen, q, f, chance);
  }
}

}  // namespace

void measure(Part& part) {
  Pen pen(part.split);
  draw_with(pen, part, part.frame, 0);
  part.vertices = pen.vertices;
  part.triangles = pen.triangles;
}

bool is_closed(const Part& part) {
  switch (part.kind) {
    case PlantKind::elbow:
    case PlantKind::tray:
    case PlantKind::name_plate:
      return false;
    case PlantKind::wire:
      return true;
    case PlantKind::gusset:
      return part.variant == 1;
    case PlantKind::pipe:
      return part.variant == 1 && !part.split;
    case PlantKind::ladder:
      return !(part.p[2] > 0.0) && !part.split;
    default:
      return !part.split;
  }
}

void draw(const Part& part, const Frame& place, std::uint64_t chance, MeshData& mesh) {
  mesh.positions.resize(part.vertices);
  mesh.triangles.resize(part.triangles);
  Pen pen(part.split, mesh);
  draw_with(pen, part, place, chance);
  PGL_ASSERT(pen.vertices == part.vertices && pen.triangles == part.triangles);
}

}  // namespace pgl::scene::shapes
