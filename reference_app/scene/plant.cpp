// SPDX-License-Identifier: MIT
// Lays out the plant: what stands where in a bay, and which bay an object belongs to.

#include "scene/plant.hpp"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <vector>

#include "scene/plant_shapes.hpp"

namespace pgl::scene {

namespace {

using namespace shapes;

constexpr double bay_width = 24.0;
constexpr double bay_depth = 26.0;
constexpr double bay_low = -1.0;    // lowest point of any bay
constexpr double bay_high = 33.0;   // above the highest
constexpr double bay_margin = 0.5;  // how far a bay's parts may reach into its neighbours
constexpr std::size_t plan_count = 16;
constexpr std::size_t few_bays = 4;  // so few that their box is measured

constexpr Vec east{1, 0, 0}, north{0, 1, 0}, up{0, 0, 1};

/// The splitmix64 generator's output function (Steele, Lea, Flood 2014).
constexpr std::uint64_t mix(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

/// The frame at o whose z axis is the given axis of the world (either sign); x is up, or east where z is vertical.
Frame facing(Vec o, Vec z) {
  const bool vertical = z.z > 0.5 || z.z < -0.5;
  const Vec x = vertical ? east : up;
  return {o, x, cross(z, x), z};
}

/// The frame at o with x along a horizontal axis and z up.
Frame heading(Vec o, Vec x) {
  return {o, x, cross(up, x), up};
}

struct FlangeSize {
  Real outer, thickness, neck, gap, bolt;
  int bolts;
};
FlangeSize flange_size(Real r) {
  const int bolts = r < 0.1 ? 4 : r < 0.2 ? 8 : 12;
  return {r * 1.25 + 0.045, r * 0.06 + 0.014, r * 0.3 + 0.03, 0.003, r * 0.02 + 0.007, bolts};
}

/// The pipes of the rack, the same in every bay so that they run on: place across the rack, radius.
struct RackPipe {
  double y, r;
};
constexpr double rack_level[3] = {4.6, 6.2, 7.4};
constexpr std::array<RackPipe, 6> rack_low{
    {{2.05, 0.162}, {2.65, 0.109}, {3.15, 0.084}, {3.65, 0.109}, {4.25, 0.136}, {4.9, 0.203}}};
constexpr std::array<RackPipe, 6> rack_high{
    {{2.0, 0.084}, {2.4, 0.057}, {2.95, 0.109}, {3.55, 0.162}, {4.2, 0.136}, {4.9, 0.109}}};
constexpr double shoe = 0.1;

/// How often a part's faces are not stitched together: one in so many, or never (0). Drawn inside Layout::add, after
/// all that its caller draws: no two arguments of a call may draw, since compilers differ in which they evaluate first.
struct Split {
  int one_in = 0;
};

/// Builds the parts of one plan, in the order in which they are numbered.
class Layout {
 public:
  Layout(std::uint64_t plan, std::vector<Part>& parts) : parts_(parts), state_(mix(plan * 0x632be59bd9b4e019u + 17)) {
    const int floors = 2 + static_cast<int>(plan % 3);
    switch (plan % 4) {
      case 0:
        big_tank(plan);
        break;
      case 1:
        small_tanks();
        break;
      case 2:
        towers(plan);
        break;
      default:
        drums();
        break;
    }
    defer_bolts_ = true;
    ground();
    rack(plan);
    ground_floor();
    for (int k = 1; k <= floors; ++k) {
      frame(k);
      upper_floor(k, floors);
    }
    hanging_wires(floors);
    end_plates(floors);
    parts_.insert(parts_.end(), bolts_.begin(), bolts_.end());
    for (Part& part : parts_) measure(part);
  }

 private:
  std::vector<Part>& parts_;
  std::vector<Part> bolts_;  // come last, so that a bay cut short lacks bolts before it lacks pumps
  bool defer_bolts_ = false;
  std::uint64_t state_;

  std::uint64_t next() {
    state_ += 0x9e3779b97f4a7c15u;
    return mix(state_);
  }
  Real uniform(Real low, Real high) { return low + (high - low) * Real(static_cast<double>(next() >> 40) * 0x1p-24); }
  int pick(int n) { return static_cast<int>((next() >> 33) % static_cast<std::uint64_t>(n)); }
  bool one_in(int n) { return pick(n) == 0; }

  /// Sides of a round thing: more for a larger one, and not the same everywhere.
  int sides(Real r) {
    const int base = r < 0.06 ? 20 : r < 0.12 ? 24 : r < 0.3 ? 32 : r < 1.5 ? 44 : 64;
    return base + 4 * (pick(3) - 1);
  }

  void add(PlantKind kind, const Frame& frame, std::initializer_list<Real> p, std::initializer_list<int> n = {},
           int variant = 0, Split split = {}) {
    Part part;
    part.kind = kind;
    part.variant = static_cast<std::uint8_t>(variant);
    part.split = split.one_in > 0 && one_in(split.one_in);
    std::copy(n.begin(), n.end(), part.n.begin());
    std::copy(p.begin(), p.end(), part.p.begin());
    part.frame = frame;
    (defer_bolts_ && kind == PlantKind::bolt ? bolts_ : parts_).push_back(part);
  }

  // ---- piping -------------------------------------------------------------------------------------------------------

  void flange(Vec at, Vec neck, Real r, int n) {
    const FlangeSize s = flange_size(r);
    add(PlantKind::flange, facing(at, neck), {r, s.outer, s.thickness, s.neck}, {n}, 0, Split{2});
  }

  /// The bolts through two mated flanges (of any kind) about `at`.
  void flange_bolts(Vec at, Vec dir, Real r) {
    const FlangeSize s = flange_size(r);
    const Frame f = facing(at - dir * (s.thickness + s.gap * 0.5), dir);
    const Real circle = r + (s.outer - r) * 0.7;
    for (int i = 0; i < s.bolts; ++i) {
      const Turn t = turn((Real(i) + 0.5) / Real(s.bolts));
      add(PlantKind::bolt, moved(f, circle * t.c, circle * t.s, 0), {s.bolt, s.thickness * 2.0 + s.gap}, {16}, 0,
          Split{3});
    }
  }

  /// Two flanges face to face across `at`, and their bolts.
  void flange_pair(Vec at, Vec dir, Real r, int n) {
    const Real half = flange_size(r).gap * 0.5;
    flange(at - dir * half, -dir, r, n);
    flange(at + dir * half, dir, r, n);
    flange_bolts(at, dir, r);
  }

  void blind(Vec at, Vec dir, Real r, int n) {
    const FlangeSize s = flange_size(r);
    flange(at - dir * (s.gap * 0.5), -dir, r, n);
    add(PlantKind::flange, facing(at + dir * (s.gap * 0.5), dir), {r, s.outer, s.thickness, s.neck}, {n}, 1, Split{2});
    flange_bolts(at, dir, r);
  }

  void pipe(Vec from, Vec dir, Real l, Real r, int n) {
    if (!(l > 0.005)) return;
    const bool hollow = one_in(3);
    add(PlantKind::pipe, facing(from, dir), {r, l}, {n, hollow ? 1 : 1 + pick(4)}, hollow ? 1 : 0);
  }

  /// Straight pipe from a to b, with a flanged joint half way now and then.
  void run(Vec a, Vec dir, Real l, Real r, int n) {
    if (l > 2.5 && one_in(3)) {
      flange_pair(a + dir * (l * 0.5), dir, r, n);
      pipe(a, dir, l * 0.5, r, n);
      pipe(a + dir * (l * 0.5), dir, l * 0.5, r, n);
    } else {
      pipe(a, dir, l, r, n);
    }
  }

  static Real valve_half(Real r) { return r * 2.6 + 0.05; }

  /// A valve at `at`, between flanges.
  void valve(Vec at, Vec dir, Real r, int n) {
    const FlangeSize s = flange_size(r);
    const Real half = valve_half(r);
    const bool vertical = dir.z > 0.5 || dir.z < -0.5;
    const Vec stem = vertical ? -north : up;
    const Frame f{at, stem, cross(dir, stem), dir};
    const int kind = one_in(4) ? 1 : 0;
    add(PlantKind::valve, f, {r, half, s.outer, s.thickness}, {n + 16}, kind, Split{3});
    const Real joint = half + s.gap * 0.5;
    flange(at - dir * (half + s.gap), -dir, r, n);
    flange(at + dir * (half + s.gap), dir, r, n);
    flange_bolts(at - dir * joint, dir, r);
    flange_bolts(at + dir * joint, dir, r);
    if (kind == 0 && !vertical)
      add(PlantKind::name_plate,
          Frame{at + stem * (r * 3.0) - cross(dir, stem) * (r * 0.75), dir, stem, -cross(dir, stem)}, {0.04, 0.02});
  }

  /// A run with a valve in its middle where there is room.
  void valved(Vec a, Vec dir, Real l, Real r, int n) {
    const Real half = valve_half(r) + flange_size(r).gap;
    if (l * 0.5 < half + 0.1) return run(a, dir, l, r, n);
    pipe(a, dir, l * 0.5 - half, r, n);
    valve(a + dir * (l * 0.5), dir, r, n);
    pipe(a + dir * (l * 0.5 + half), dir, l * 0.5 - half, r, n);
  }

  /// Pipe along a polyline of axis-parallel pieces, elbows at its corners. The start is flanged; `with_valve` names the
  /// piece that has a valve.
  void route(std::initializer_list<Vec> points, Real r, int with_valve = -1) {
    const Vec* p = points.begin();
    const int pieces = static_cast<int>(points.size()) - 1;
    const int n = sides(r);
    const Real bend = r * 3.0;
    const auto way = [&](int i) {
      const Vec d = p[i + 1] - p[i];
      const auto sign = [](Real v) { return v > 1e-6 ? Real(1) : v < -1e-6 ? Real(-1) : Real(0); };
      return Vec{sign(d.x), sign(d.y), sign(d.z)};
    };
    for (int i = 0; i < pieces; ++i) {
      const Vec dir = way(i);
      PGL_ASSERT(!(dot(dir, dir) > 1.0) && !(dot(dir, dir) < 1.0));
      Real from = i > 0 ? bend : Real(0);
      const Real to = dot(p[i + 1] - p[i], dir) - (i + 1 < pieces ? bend : Real(0));
      PGL_ASSERT(!(to < from));
      if (i == 0) {
        flange_pair(p[0], dir, r, n);
      }
      if (i == with_valve)
        valved(p[i] + dir * from, dir, to - from, r, n);
      else
        run(p[i] + dir * from, dir, to - from, r, n);
      if (i + 1 < pieces) {
        const Vec turned = way(i + 1);
        add(PlantKind::elbow, Frame{p[i + 1] - dir * bend, dir, turned, cross(dir, turned)}, {bend, r},
            {n, 15 + 2 * pick(5)});
      }
    }
  }

  /// A short piece of pipe out of a vessel. Returns where a route may begin.
  Vec nozzle(Vec at, Vec dir, Real r, Real l = 0.25) {
    const int hollow = pick(2);
    add(PlantKind::pipe, facing(at - dir * 0.1, dir), {r, l + 0.1}, {sides(r), 1}, hollow);
    return at + dir * l;
  }

  /// From a point above ground up to the gap over the rack, and down into a pipe of its upper level.
  void over_rack(Vec from, Real z, int k, Real r) {
    const RackPipe& target = rack_high[static_cast<std::size_t>(k)];
    const Real end = rack_level[1] + shoe + target.r;
    route({from, {from.x, from.y, z}, {from.x, target.y, z}, {from.x, target.y, end}}, r, one_in(2) ? 1 : -1);
  }
  /// The same from a nozzle higher than that: up a little, to the line y, down, and on.
  void down_to_rack(Vec from, Real y, Real z, int k, Real r) {
    const RackPipe& target = rack_high[static_cast<std::size_t>(k)];
    const Real end = rack_level[1] + shoe + target.r;
    const Real top = std::max((from.z + r * 4.0 + 0.1).v, (z + r * 6.0 + 0.1).v);
    route(
        {from, {from.x, from.y, top}, {from.x, y, top}, {from.x, y, z}, {from.x, target.y, z}, {from.x, target.y, end}},
        r,
        one_in(3)   ? 1
        : one_in(2) ? 2
                    : -1);
  }

  // ---- equipment ----------------------------------------------------------------------------------------------------

  void standing_ladder(Vec foot, Vec away, Real h, bool cage) {
    add(PlantKind::ladder, Frame{foot + away * 0.2, cross(away, up), away, up}, {h, 0.45, cage ? 2.3 : 0.0}, {10});
  }

  void name_plate(Vec at, Vec seen_from, Real size) {
    add(PlantKind::name_plate, Frame{at, cross(up, seen_from), up, seen_from}, {size, size * 0.6});
  }

  /// Handrails around a circle, as chords.
  void rail_ring(Vec centre, Real r, int chords) {
    for (int i = 0; i < chords; ++i) {
      const Turn a = turn(Real(i) / Real(chords)), b = turn(Real(i + 1) / Real(chords));
      const Vec from = centre + Vec{a.c * r, a.s * r, 0}, to = centre + Vec{b.c * r, b.s * r, 0};
      const Real l = length(to - from);
      const Vec x = unit(to - from);
      add(PlantKind::handrail, Frame{from, x, cross(up, x), up}, {l, 1.05}, {16, l > 1.4 ? 3 : 2}, 0, Split{4});
    }
  }

  /// A round door with a bolted cover on the -y side of a tank.
  void manway(Vec at) {
    const Real r = 0.3;
    const Vec end = nozzle(at, -north, r, 0.18);
    blind(end, -north, r, sides(r));
  }

  void tank(Vec base, Real r, Real h, std::array<int, 3> n, Split split) {
    add(PlantKind::tank, Frame{base}, {r, h, r * 0.22}, {n[0], n[1], n[2]}, 0, split);
  }

  void big_tank(std::uint64_t plan) {
    const Vec c{18, 14.5, 0.35};
    const Real r = uniform(4.2, 4.9), h = uniform(7.5, 10.0);
    if (plan == 0)
      tank(c, r, h, {72, 60, 24}, {});
    else
      tank(c, r, h, {72 + 4 * pick(5), 30 + pick(40), 12 + pick(10)}, Split{2});
    add(PlantKind::slab, Frame{c}, {r + 0.5, 0.5}, {64}, 1);
    standing_ladder(c - east * (r + 0.07), -east, h + 1.0, true);
    rail_ring(c + up * h, r - 0.1, 20);
    manway(c + Vec{0, -r, 0.9});
    name_plate(c + Vec{0, -(r + 0.03), 2.6}, -north, 0.4);
    const Real pr = 0.162;
    const Vec outlet = nozzle(c + Vec{1.5, 0.05 - root(r * r - 2.25), 0.6}, -north, pr, 0.4);
    const RackPipe& low = rack_low[static_cast<std::size_t>(5 - pick(2) * 5)];
    route({outlet,
           {outlet.x, 7.2, outlet.z},
           {outlet.x, 7.2, 3.5},
           {outlet.x, low.y, 3.5},
           {outlet.x, low.y, rack_level[0] + shoe}},
          pr, 0);
    const Vec vent = nozzle(c + Vec{0, 0, h + r * 0.22}, up, 0.109);
    down_to_rack(vent, 8.3, 8.25, 2, 0.109);
    const Vec inlet = nozzle(c + Vec{2.4, -1.2, h + r * 0.13}, up, 0.084, 0.4);
    down_to_rack(inlet, 8.0, 8.25, 3, 0.084);
  }

  void small_tanks() {
    const std::array<Vec, 3> places{{{15.5, 11.6, 0.25}, {20.7, 11.8, 0.25}, {18.0, 17.6, 0.25}}};
    for (std::size_t i = 0; i < places.size(); ++i) {
      const Vec c = places[i];
      const Real r = uniform(1.9, 2.3), h = uniform(4.8, 6.4) + Real(static_cast<double>(i)) * 0.8;
      tank(c, r, h, {56 + 4 * pick(5), 20 + pick(30), 10 + pick(6)}, Split{2});
      add(PlantKind::slab, Frame{c}, {r + 0.35, 0.4}, {48}, 1);
      standing_ladder(c + east * (r + 0.07), east, h + 1.0, one_in(2));
      rail_ring(c + up * h, r - 0.08, 12);
      if (i < 2) manway(c + Vec{-0.6, -root(r * r - 0.36), 0.9});
      name_plate(c + Vec{0, -(r + 0.01), 2.4}, -north, 0.3);
      const Vec top = nozzle(c + Vec{0.4, -0.3, h + r * 0.2}, up, 0.109, 0.35);
      if (top.z + 0.5 < 8.25)
        over_rack(top, 8.25, 2 + pick(2), 0.084);
      else
        down_to_rack(top, 8.4, 8.25, 2 + pick(2), 0.084);
      if (i < 2) {
        const Vec out = nozzle(c + Vec{0.8, 0.05 - root(r * r - 0.64), 0.5}, -north, 0.109, 0.35);
        const RackPipe& low = rack_low[static_cast<std::size_t>(pick(3) + 3)];
        route({out, {out.x, 7.2, out.z}, {out.x, 7.2, 3.5}, {out.x, low.y, 3.5}, {out.x, low.y, rack_level[0] + shoe}},
              0.084, 0);
      }
    }
  }

  void towers(std::uint64_t plan) {
    for (int i = 0; i < 2; ++i) {
      const Real r = uniform(0.9, 1.25), h = uniform(16.0, 25.0);
      const Vec c{Real(15.6) + Real(i) * 5.0, uniform(13.0, 15.0), 3.2};
      const int n = 44 + 4 * pick(4);
      // One tower has a skin as fine as some exporters make it: the largest object there is.
      add(PlantKind::vessel, Frame{c}, {r, h, r * 0.5},
          {plan == 2 && i == 0 ? 96 : n, plan == 2 && i == 0 ? 140 : 40 + pick(40), 7}, 0, Split{i == 1 ? 2 : 0});
      add(PlantKind::support, Frame{c}, {r, 3.2}, {n}, 3, Split{2});
      name_plate(c + Vec{0, -(r + 0.01), 1.2}, -north, 0.3);
      const Real gap = 6.0;
      Real z = 1.5;
      Real from = -3.2;
      for (int k = 0; z < h; ++k, z = z + gap) {
        const Vec level = c + up * z;
        add(PlantKind::grating, Frame{level}, {r + 0.05, r + 1.15, 0.04}, {36, 8}, 1, Split{2});
        rail_ring(level, r + 1.12, 10);
        const Vec side = k % 2 == 0 ? east : -east;
        standing_ladder(c + up * from + side * (r + 0.08), side, z - from + 1.0, k > 0);
        from = z;
        if (k < 2) blind(nozzle(c + Vec{0, -r, z + 1.0}, -north, 0.25, 0.2), -north, 0.25, 28);
      }
      const Vec top = nozzle(c + Vec{0, 0, h + r * 0.5}, up, 0.162);
      down_to_rack(top, c.y - r - 1.6, 8.25, 3, 0.162);
      const Vec feed = nozzle(c + Vec{0.5, 0.02 - root(r * r - 0.25), 2.6}, -north, 0.109, 0.4);
      const RackPipe& low = rack_low[static_cast<std::size_t>(1 + pick(3))];
      route({feed,
             {feed.x, 9.0, feed.z},
             {feed.x, 9.0, 3.4},
             {feed.x, low.y, 3.4},
             {feed.x, low.y, rack_level[0] + shoe}},
            0.109, 2);
    }
  }

  /// A horizontal drum with its axis along `axis`, on two saddles of the given depth below its centre.
  void drum(Vec centre, Vec axis, Real r, Real l, Real foot, int n, Split split) {
    const Frame f{centre - axis * (l * 0.5), cross(up, axis), up, axis};
    add(PlantKind::vessel, f, {r, l, r * 0.5}, {n, 30 + pick(30), 9}, 0, split);
    for (const Real k : {0.18, 0.82})
      add(PlantKind::support, moved(f, 0, 0, l * k), {r, foot, 0.25}, {16}, 1, Split{2});
  }

  void drums() {
    for (int i = 0; i < 3; ++i) {
      const Real x = Real(14.8) + Real(i) * 3.3;
      const Real r = uniform(0.9, 1.1), l = uniform(5.5, 8.0);
      const Vec c{x, 14.5, r + 1.2};
      drum(c, north, r, l, r + 0.4, sides(r), Split{2});
      for (const Real k : {0.18, 0.82})
        add(PlantKind::support, Frame{{x, c.y + l * (k - 0.5), 0.78}}, {r, 0.35, 0.4}, {}, 4);
      name_plate({x, c.y - l * 0.5 - r * 0.5 - 0.01, c.z}, -north, 0.2);
      blind(nozzle(c + Vec{0, l * -0.25, r}, up, 0.25, 0.2), up, 0.25, 28);
      const Vec a = nozzle(c + Vec{0.2, l * 0.3, r}, up, 0.109);
      over_rack(a, 8.25, 2, 0.084);
      const Vec b = nozzle(c + Vec{-0.5, l * -0.38, r * 0.85}, up, 0.084, 0.5);
      over_rack(b, 8.0, 3, 0.084);
      if (i < 2) {  // an exchanger on top of the drum
        const Real er = 0.45;
        const Vec e{x + 1.65, 15.0, 4.6};
        drum(e, north, er, 5.0, er + 0.35, sides(er), Split{2});
        for (const Real k : {0.18, 0.82}) {
          const Vec head{e.x, e.y + (k - 0.5) * 5.0, e.z - er - 0.37};
          add(PlantKind::beam, Frame{{head.x - 0.75, head.y, head.z - 0.1}, north, up, east},
              {0.08, 0.1, 1.5, 0.012, 0.005}, {4});
          for (const Real dx : {-0.4, 0.4})
            add(PlantKind::column, Frame{{head.x + dx, head.y, 0}}, {0.07, 0.07, head.z - 0.2, 0.012, 0.005}, {4});
        }
        over_rack(nozzle(e + Vec{0, -1.9, er}, up, 0.084), 7.85, i == 0 ? 0 : 5, 0.084);
      }
    }
    for (int i = 0; i < 2; ++i) pump({Real(15.6) + Real(i) * 3.6, 8.1, 0.15}, 0.8);
    add(PlantKind::tank, Frame{{21.6, 20.4, 0.1}}, {0.9, 2.2, 0.15}, {40, 8, 6});
  }

  /// A pump on its plinth, shaft along +y.
  void pump(Vec base, Real size) {
    add(PlantKind::pump, Frame{base, north, -east, up}, {size}, {28 + 4 * pick(3)}, 0, Split{4});
    add(PlantKind::support, Frame{base}, {size * 0.4, size * 0.9, 0.2}, {}, 4);
    for (const Real x : {-0.24, 0.24})
      for (const Real y : {-0.7, 0.5})
        add(PlantKind::bolt, Frame{base + Vec{size * x, size * y, size * 0.1}}, {0.008, 0.012}, {12}, 1);
    name_plate(base + Vec{size * -0.21, size * -0.38, size * 0.4}, -east, 0.06);
  }

  // ---- what every bay has -------------------------------------------------------------------------------------------

  void ground() {
    add(PlantKind::slab, Frame{{12, 11.25, 0}}, {12.0, 11.25, 0.15});
    add(PlantKind::slab, Frame{{12, 24.25, -0.05}}, {12.0, 1.75, 0.1});
    add(PlantKind::slab, Frame{{6.5, 14, 0.1}}, {5.6, 5.6, 0.15});
    for (const Real x : {2.0, 12.0, 22.0}) add(PlantKind::slab, Frame{{x, 22.35, 0.12}}, {1.6, 0.12, 0.1});
  }

  void anchored_plate(Vec at, Real half) {
    add(PlantKind::plate, Frame{at}, {half, half, 0.03}, {}, 0, Split{2});
    for (const Real x : {-0.75, 0.75})
      for (const Real y : {-0.75, 0.75})
        add(PlantKind::bolt, Frame{at + Vec{half * x, half * y, 0}}, {0.012, 0.012}, {12}, 1, Split{4});
  }

  void beam(Vec from, Vec dir, Real l, Real half_width, Real half_height, PlantKind kind = PlantKind::beam) {
    add(kind, Frame{from, cross(up, dir), up, dir},
        {half_width, half_height, l, half_height * 0.09, half_height * 0.035}, {one_in(3) ? 0 : 5 + pick(4)}, 0,
        Split{2});
  }

  void column(Vec from, Real l, Real half) {
    add(PlantKind::column, Frame{from}, {half, half, l, half * 0.12, half * 0.05}, {one_in(3) ? 0 : 5 + pick(4)}, 0,
        Split{2});
  }

  void rack(std::uint64_t plan) {
    const std::array<double, 2> lines{1.4, 5.6};
    for (int i = 0; i < 4; ++i) {
      const Real x = Real(3) + Real(i) * 6.0;
      for (const double y : lines) {
        anchored_plate({x, y, 0.03}, 0.24);
        column({x, y, 0.03}, 7.4, 0.14);
      }
      for (const double z : rack_level) {
        beam({x, lines[0] + 0.01, z - 0.14}, north, 4.18, 0.08, 0.14);
        for (const double y : {lines[0] + 0.14, lines[1] - 0.14}) {
          const Vec way = y < 3.0 ? north : -north;
          add(PlantKind::gusset, Frame{{x, y, z - 0.28}, way, cross(up, way), up}, {0.3, 0.3, 0.01}, {},
              one_in(4) ? 1 : 0);
        }
      }
      for (const double y : lines)
        if (i < 3)
          for (const double z : {5.4, 6.9}) beam({x + 0.01, y, z - 0.12}, east, 5.98, 0.07, 0.12);
      for (const double y : lines) {
        if (i % 2 == 0) continue;
        const Vec from{x - 5.8, y, 0.3}, to{x - 0.1, y, 5.0};
        const Vec way = unit(to - from);
        add(PlantKind::brace, Frame{from, cross(north, way), north, way}, {0.045, 0, length(to - from), 0.008}, {}, 1,
            Split{2});
      }
    }
    // Level by level, four lengths of pipe a line, resting on shoes.
    for (int level = 0; level < 2; ++level)
      for (const RackPipe& line : level == 0 ? rack_low : rack_high) {
        const Real z = rack_level[level] + shoe + line.r;
        const int n = sides(line.r);
        for (int i = 0; i < 4; ++i) {
          const Vec from{Real(i) * 6.0, line.y, z};
          if (i > 0 && one_in(4)) flange_pair(from, east, line.r, n);
          if (one_in(8))
            valved(from, east, 6.0, line.r, n);
          else
            pipe(from, east, 6.0, line.r, n);
          add(PlantKind::support, Frame{{Real(3) + Real(i) * 6.0, line.y, rack_level[level]}}, {shoe, 0.16}, {}, 0,
              Split{2});
        }
      }
    for (const double y : {2.4, 4.4}) {
      for (int i = 0; i < 4; ++i)
        add(PlantKind::tray, Frame{{Real(i) * 6.0, y, rack_level[2] + 0.02}}, {5.98, 0.6, 0.12}, {20});
      for (int i = 0; i < 9; ++i) {
        const Real r = Real(0.008) + Real(0.004) * Real((i * 7) % 4);
        const bool fine = i == 4 && plan % 5 == 1;
        add(PlantKind::wire, Frame{{0, y - 0.24 + Real(i) * 0.06, rack_level[2] + 0.025 + r}},
            {bay_width, r, 0.05, 0.02}, {fine ? 16 : 10 + 2 * pick(3), fine ? 880 : 240 + 10 * pick(28), 2 + pick(4)});
      }
    }
  }

  // The frame: columns at x 1.5, 6.5, 11.5 and y 9, 14, 19; floors every 4.5 m.
  static Real line_x(int i) { return Real(1.5) + Real(i) * 5.0; }
  static Real line_y(int j) { return Real(9) + Real(j) * 5.0; }
  static Real floor_z(int k) { return Real(k) * 4.5; }
  static bool is_open(int k, int i, int j) { return k == 1 && i == 0 && j == 1; }  // where the tall vessel passes

  void panels(Vec corner, Real l, Real w, int along, int across) {
    for (int j = 0; j < across; ++j)
      for (int i = 0; i < along; ++i)
        add(PlantKind::grating,
            Frame{corner + Vec{l * Real(i) / Real(along) + 0.005, w * Real(j) / Real(across) + 0.005, 0}},
            {l / Real(along) - 0.01, w / Real(across) - 0.01}, {38 + pick(6), 44 + pick(8)}, 0, Split{6});
  }

  void frame(int k) {
    const Real z = floor_z(k), below = floor_z(k - 1);
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) {
        if (k == 1) anchored_plate({line_x(i), line_y(j), 0.13}, 0.3);
        column({line_x(i), line_y(j), k == 1 ? Real(0.13) : below - 0.05}, k == 1 ? z - 0.18 : z - below, 0.16);
      }
    const Real middle = z - 0.05 - 0.2;
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 2; ++i) beam({line_x(i) + 0.17, line_y(j), middle}, east, 4.66, 0.1, 0.2);
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 3; ++i) beam({line_x(i), line_y(j) + 0.17, middle}, north, 4.66, 0.1, 0.2);
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 2; ++i) {
        if (is_open(k, i, j)) continue;
        for (const Real dy : {1.25, 2.5, 3.75})
          beam({line_x(i) + 0.02, line_y(j) + dy, z - 0.05 - 0.1}, east, 4.96, 0.05, 0.1);
      }
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 2; ++i)
        for (const bool left : {true, false}) {
          const Vec way = left ? east : -east;
          add(PlantKind::gusset,
              Frame{{left ? line_x(i) + 0.16 : line_x(i + 1) - 0.16, line_y(j), z - 0.45}, way, cross(up, way), up},
              {0.35, 0.35, 0.012}, {}, one_in(4) ? 1 : 0);
        }
    for (int j = 0; j < 2; ++j) {
      const Real x = line_x(j == 0 ? 0 : 2);
      const Vec a{x, line_y(j), below + 0.25}, b{x, line_y(j + 1), z - 0.5};
      for (const bool rising : {true, false}) {
        const Vec from = rising ? a : Vec{b.x + 0.09, b.y, a.z}, to = rising ? b : Vec{a.x + 0.09, a.y, b.z};
        const Vec way = unit(to - from);
        add(PlantKind::brace, Frame{from, cross(east, way), east, way}, {0.05, 0, length(to - from), 0.01}, {}, 1,
            Split{2});
      }
      add(PlantKind::brace, Frame{{line_x(j), line_y(2), z - 0.6}, up, -north, east}, {0.05, 0.09, 5.0, 0.01, 0.004},
          {}, 2);
    }
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 2; ++i)
        if (!is_open(k, i, j)) panels({line_x(i), line_y(j), z}, 5, 5, 2, 4);
    stairs(k);
    rails(k);
  }

  void stairs(int k) {
    const bool odd = k % 2 == 1;
    const Real below = k == 1 ? Real(0) : floor_z(k - 1), z = floor_z(k);
    const Real y = odd ? 19.75 : 20.75;
    add(PlantKind::stair, heading({odd ? 2.0 : 6.5, y, below}, odd ? east : -east), {z - below, 4.5, 0.9}, {22, 12});
    const Real x = odd ? 6.5 : 0.75;
    panels({x, 19.2, z}, 1.25, 2.1, 1, 1);
    beam({x, 19.2, z - 0.13}, north, 2.1, 0.04, 0.08);
    beam({x + 1.25, 19.2, z - 0.13}, north, 2.1, 0.04, 0.08);
    const Real foot = k <= 2 ? Real(0) : floor_z(k - 2);  // the landing below on the same side
    column({odd ? 7.7 : 0.8, 21.2, foot}, z - foot - 0.05, 0.07);
    add(PlantKind::handrail, heading({x, 21.28, z}, east), {1.25, 1.1}, {16, 2}, 0, Split{4});
    add(PlantKind::handrail, heading({odd ? 7.78 : 0.72, 19.2, z}, north), {2.1, 1.1}, {16, 3}, 0, Split{4});
  }

  void rails(int k) {
    const Real z = floor_z(k);
    for (int i = 0; i < 4; ++i) {
      const Real s = Real(i) * 2.5;
      add(PlantKind::handrail, heading({line_x(0) + s, line_y(0) - 0.1, z}, east), {2.49, 1.1}, {16, 3}, 0, Split{4});
      add(PlantKind::handrail, heading({line_x(0) - 0.1, line_y(0) + s, z}, north), {2.49, 1.1}, {16, 3}, 0, Split{4});
      add(PlantKind::handrail, heading({line_x(2) + 0.1, line_y(0) + s, z}, north), {2.49, 1.1}, {16, 3}, 0, Split{4});
      if (i == (k % 2 == 1 ? 2 : 0)) continue;  // the way to the stairs
      add(PlantKind::handrail, heading({line_x(0) + s, line_y(2) + 0.1, z}, east), {2.49, 1.1}, {16, 3}, 0, Split{4});
    }
    if (k == 1) {
      add(PlantKind::handrail, heading({line_x(0), line_y(1) - 0.05, z}, east), {5.0, 1.1}, {16, 5}, 0, Split{4});
      add(PlantKind::handrail, heading({line_x(1) - 0.05, line_y(1), z}, north), {5.0, 1.1}, {16, 5}, 0, Split{4});
    }
    // A caged ladder at the side of the frame, floor to floor.
    standing_ladder({line_x(2) + 0.2, k % 2 == 1 ? 12.0 : 16.0, k == 1 ? Real(0.1) : floor_z(k - 1)}, east,
                    k == 1 ? z + 0.9 : Real(5.5), true);
  }

  void ground_floor() {
    const Real z = 0.1;  // top of the frame's slab
    const Real header = 0.67;
    for (int i = 0; i < 4; ++i) {
      const Real x = i == 0 ? 2.5 : i == 1 ? 4.7 : i == 2 ? 8.2 : 10.0;
      pump({x, 10.6, z + 0.15}, 1.0);
      const Vec suction{x, 10.6 + 0.68, z + 0.15 + 0.42}, discharge{x, 10.6 + 0.35, z + 0.15 + 0.9};
      route({suction, {x, 13.2, header}}, 0.1, 0);
      const RackPipe& low = rack_low[static_cast<std::size_t>(1 + (i + pick(2)) % 4)];
      const Real over = Real(3.2) + Real(i % 2) * 0.35;
      route({discharge, {x, discharge.y, over}, {x, low.y, over}, {x, low.y, rack_level[0] + shoe}}, 0.084, i % 2);
    }
    pipe({2.0, 13.2, header}, east, 8.8, 0.136, 24);
    blind({2.0, 13.2, header}, -east, 0.136, 24);
    blind({10.8, 13.2, header}, east, 0.136, 24);
    for (const Real x : {3.4, 6.0, 9.2})
      add(PlantKind::support, Frame{{x, 13.2, header - 0.136}}, {0.1, 0.12, (header - 0.136 - z) * 0.5}, {}, 4);

    // A small tank and a tall vessel feed the header.
    const Vec t{9.0, 16.6, z};
    const Real r = uniform(1.5, 1.8), h = uniform(2.6, 3.2);
    tank(t, r, h, {40 + 4 * pick(4), 8 + pick(8), 8}, Split{2});
    name_plate(t + Vec{0.8, 0.4 - r, 1.5}, -north, 0.2);
    const auto feed = [&](Vec from) { route({from, {from.x, 13.2, header}}, 0.109, 0); };
    feed(nozzle(t + Vec{0, -r, header - z}, -north, 0.109, 0.2));
    const Vec v{4.0, 16.5, 1.7};
    const Real vr = uniform(1.0, 1.3);
    vertical_vessel(v, vr, 5.0, 1.6, 3);
    const Vec bottom = v + Vec{0, 0, vr * -0.5};
    const Real drain = 0.084;
    add(PlantKind::pipe, facing(bottom + up * 0.1, -up), {drain, bottom.z + 0.1 - (header + 0.253)}, {20, 1});
    add(PlantKind::elbow, Frame{{v.x, v.y, header + 0.252}, -up, -north, cross(-up, -north)}, {0.252, drain}, {20, 9});
    valved({v.x, v.y - 0.252, header}, -north, v.y - 0.252 - 13.2, drain, 20);
    const Vec side = nozzle(v + Vec{0, -vr, 4.9}, -north, 0.109);
    const RackPipe& high = rack_high[2];
    route({side, {4.0, 8.1, side.z}, {4.0, 8.1, 8.25}, {4.0, high.y, 8.25}, {4.0, high.y, rack_level[1] + shoe}}, 0.109,
          0);
  }

  /// A vessel on legs (or a skirt). `base` is the lower tangent line, `foot` its height above the floor.
  void vertical_vessel(Vec base, Real r, Real l, Real foot, int support) {
    const int n = sides(r);
    add(PlantKind::vessel, Frame{base}, {r, l, r * 0.5}, {n, 24 + pick(30), 9}, 0, Split{2});
    if (support == 2)
      add(PlantKind::support, Frame{base}, {r - 0.03, foot, 0.05}, {12}, 2, Split{2});
    else
      add(PlantKind::support, Frame{base}, {r, foot}, {n}, 3, Split{2});
    name_plate(base + Vec{0, -(r + 0.01), l * 0.6}, -north, 0.12);
  }

  void upper_floor(int k, int floors) {
    const Real z = floor_z(k);
    const Real shift = Real(k) * 0.3;
    const bool roof = k == floors;
    const auto away = [&](Vec from, int target, Real r) {
      if (k == 1)
        over_rack(from, 8.1, target, r);
      else
        down_to_rack(from, Real(8.5) - Real(k % 2) * 0.35, k == 2 ? 8.25 : 7.95, target, r);
    };
    {
      const Real r = uniform(0.5, 0.7), l = uniform(1.3, 1.6);
      const Vec a{2.6 + shift * 0.5, 11.2, z + 0.8};
      vertical_vessel(a, r, l, 0.8, 2);
      away(nozzle(a + up * (l + r * 0.5), up, 0.084), 2, 0.084);
      const Vec low = nozzle(a + Vec{r, 0, 0.3}, east, 0.057, 0.2);
      if (k > 1) {
        const Real r2 = uniform(0.5, 0.7);
        const Vec b{5.3, 11.2, z + 0.8};
        vertical_vessel(b, r2, 1.5, 0.8, 2);
        route({low, {b.x - r2 - 0.02, 11.2, low.z}}, 0.057, 0);
      } else {
        blind(low, east, 0.057, 16);
      }
    }
    {
      const Real r = uniform(0.6, 0.8), l = uniform(2.4, 3.2);
      const Vec c{9.0, 12.0, z + r + 0.45};
      drum(c, east, r, l, r + 0.43, sides(r), Split{3});
      name_plate(c + Vec{0, -(r + 0.01), 0}, -north, 0.15);
      away(nozzle(c + Vec{shift - 0.9, 0, r}, up, 0.084), 3, 0.084);
      const Vec out = nozzle(c + Vec{l * 0.35, 0, r}, up, 0.057);
      if (k == 1)
        over_rack(out, 7.8, 0, 0.057);
      else
        blind(out, up, 0.057, 16);
    }
    if (k > 1 && !one_in(4)) {
      const Real r = uniform(1.0, 1.5), h = uniform(2.0, roof ? 3.4 : 2.8);
      const Vec t{4.2, 16.5, z};
      tank(t, r, h, {40 + 4 * pick(4), 6 + pick(10), 8}, Split{2});
      if (roof) rail_ring(t + up * h, r - 0.06, 8);
      standing_ladder(t + east * (r + 0.07), east, h + 0.8, false);
      name_plate(t + Vec{0, -(r + 0.01), 1.4}, -north, 0.15);
      route({nozzle(t + Vec{0.3, 0.04 - root(r * r - 0.09), 0.4}, -north, 0.084, 0.2),
             {4.5, 13.4, z + 0.4},
             {8.6, 13.4, z + 0.4},
             {8.6, 13.4, z + 1.1},
             {8.6, 12.5, z + 1.1}},
            0.084, 1);
    }
    if (!roof || one_in(2)) {
      const Real r = uniform(0.5, 0.8);
      const Vec v{9.4, 16.8, z + 0.9};
      vertical_vessel(v, r, 1.4, 0.9, 2);
      const Vec top = nozzle(v + up * (1.4 + r * 0.5), up, 0.057);
      route({top, {v.x, v.y, top.z + 0.35}, {v.x, 14.5, top.z + 0.35}, {v.x, 14.5, z + 0.3}, {10.8, 14.5, z + 0.3}},
            0.057, 3);
    }
    if (k == 1) pump({8.4, 15.2, z}, 0.6);
    // A tray under the floor, across the frame, with a few wires.
    for (int i = 0; i < 2; ++i) add(PlantKind::tray, Frame{{line_x(i), 13.3, z - 0.75}}, {4.99, 0.4, 0.1}, {16});
    for (int i = 0; i < 4; ++i)
      add(PlantKind::wire, Frame{{line_x(0), 13.3 - 0.12 + Real(i) * 0.08, z - 0.735}}, {10.0, 0.012, 0.04, 0.02},
          {12, 140 + 10 * pick(8), 1 + pick(3)});
  }

  /// A wire from a to b that hangs by `sag`.
  void hanging(Vec a, Vec b, Real sag, Real r) {
    const Vec flat{b.x - a.x, b.y - a.y, 0};
    const Real l = length(flat);
    const Vec x = unit(flat);
    const Real dz = b.z - a.z;
    add(PlantKind::wire, Frame{a, x, cross(up, x), up},
        {l * 0.3, dz * 0.3 - sag * 1.35, l * 0.7, dz * 0.7 - sag * 1.35, l, dz, r},
        {10 + 2 * pick(3), 80 + 10 * pick(10)}, 1);
  }

  void lamp(Vec foot) {
    const Real r = 0.06, bend = 0.3;
    add(PlantKind::plate, Frame{foot + up * 0.03}, {0.15, 0.15, 0.03});
    add(PlantKind::pipe, Frame{foot + up * 0.03}, {r, 7.2}, {16, 6}, 1);
    add(PlantKind::elbow, Frame{foot + up * 7.23, up, north, cross(up, north)}, {bend, r}, {16, 9});
    pipe(foot + Vec{0, bend, 7.23 + bend}, north, 0.9, r, 16);
    add(PlantKind::plate, Frame{foot + Vec{0, bend + 1.0, 7.23 + bend + 0.08}}, {0.14, 0.35, 0.14}, {}, 0, Split{2});
  }

  void hanging_wires(int floors) {
    const Real top = floor_z(floors);
    for (int i = 0; i < 4; ++i) {  // from the tray to the motors
      const Real x = i == 0 ? 2.5 : i == 1 ? 4.7 : i == 2 ? 8.2 : 10.0;
      hanging({x + 0.5, 4.7, 7.45}, {x + 0.05, 10.2, 0.95}, 0.9, 0.012);
    }
    for (int i = 0; i < 3; ++i) hanging({line_x(i) + 0.3, 4.7, 7.46}, {line_x(i), 8.83, floor_z(2) - 0.8}, 0.5, 0.014);
    for (int i = 0; i < 2; ++i) {  // street lamps, one fed from the frame, the other from the first
      const Vec foot{Real(13.2) + Real(i) * 9.6, 21.9, 0};
      lamp(foot);
      const Vec joint = foot + Vec{-0.06, 0, 6.9};
      hanging(i == 0 ? Vec{11.66, 19.0, floor_z(2) - 1.2} : foot + Vec{-9.54, 0, 6.9}, joint, 0.6, 0.012);
    }
    for (int i = 0; i < 2; ++i) hanging({1.5, line_y(2 * i), top + 1.0}, {11.5, line_y(2 * i), top + 1.0}, 0.6, 0.01);
  }

  /// End plates and bolts where beams meet columns.
  void end_plates(int floors) {
    for (int k = 1; k <= floors; ++k) {
      const Real middle = floor_z(k) - 0.25;
      for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i)
          for (const Vec way : {east, -east, north, -north}) {
            if ((way.x > 0.0 && i == 2) || (way.x < 0.0 && i == 0) || (way.y > 0.0 && j == 2) ||
                (way.y < 0.0 && j == 0))
              continue;
            const Vec face = Vec{line_x(i), line_y(j), middle} + way * 0.175;
            const Frame f = facing(face, way);  // x up, y sideways
            add(PlantKind::plate, f, {0.22, 0.11, 0.015}, {}, 0, Split{2});
            for (const Real u : {-0.1, 0.1}) add(PlantKind::bolt, moved(f, u, 0.07, 0), {0.01, 0.0}, {}, 2, Split{3});
          }
    }
  }
};

struct Plans {
  std::array<std::vector<Part>, plan_count> parts;
  std::array<PlantSize, plan_count> size;
  std::size_t block_objects = 0;
  PlantSize block_size;

  Plans() {
    for (std::size_t i = 0; i < plan_count; ++i) {
      Layout(i, parts[i]);
      block_objects += parts[i].size();
      for (const Part& part : parts[i]) {
        size[i].vertices += part.vertices;
        size[i].triangles += part.triangles;
      }
      block_size.vertices += size[i].vertices;
      block_size.triangles += size[i].triangles;
    }
  }
};

const Plans& plans() {
  static const Plans all;
  return all;
}

/// The order of the plans in a block of bays: a permutation drawn from the seed.
std::array<std::uint8_t, plan_count> plan_order(std::uint64_t seed, std::uint64_t block) {
  std::array<std::uint8_t, plan_count> order;
  for (std::size_t i = 0; i < plan_count; ++i) order[i] = static_cast<std::uint8_t>(i);
  std::uint64_t h = mix(mix(seed) ^ (block + 1));
  for (std::size_t i = plan_count - 1; i > 0; --i) {
    h = mix(h);
    std::swap(order[i], order[(h >> 32) % (i + 1)]);
  }
  return order;
}

struct Slot {
  std::size_t bay;
  const Part* part;
};

Slot slot_of(const PlantOptions& options, std::size_t index) {
  PGL_ASSERT(index < options.objects);
  const Plans& all = plans();
  const std::size_t block = index / all.block_objects;
  std::size_t rest = index % all.block_objects;
  const auto order = plan_order(options.seed, block);
  for (std::size_t i = 0; i + 1 < plan_count; ++i) {
    const auto& parts = all.parts[order[i]];
    if (rest < parts.size()) return {block * plan_count + i, &parts[rest]};
    rest -= parts.size();
  }
  return {block * plan_count + plan_count - 1, &all.parts[order[plan_count - 1]][rest]};
}

/// Bays stand in rows from west to east, as near to a square as may be, around the origin.
struct Site {
  std::size_t bays = 0, columns = 1, rows = 1;
};
Site site_of(const PlantOptions& options) {
  Site site;
  if (options.objects == 0) return site;
  site.bays = slot_of(options, options.objects - 1).bay + 1;
  const auto area = static_cast<double>(site.bays) * bay_depth;
  while (static_cast<double>(site.columns) * static_cast<double>(site.columns) * bay_width < area) ++site.columns;
  site.columns = std::min(site.columns, site.bays);
  site.rows = (site.bays + site.columns - 1) / site.columns;
  return site;
}

}  // namespace

void plant_object(const PlantOptions& options, std::size_t index, MeshData& mesh) {
  const Slot slot = slot_of(options, index);
  const Site site = site_of(options);
  const std::size_t column = slot.bay % site.columns, row = slot.bay / site.columns;
  const Vec corner{(Real(static_cast<double>(column)) - Real(static_cast<double>(site.columns)) * 0.5) * bay_width,
                   (Real(static_cast<double>(row)) - Real(static_cast<double>(site.rows)) * 0.5) * bay_depth, 0};
  Frame f = slot.part->frame;
  if (row % 2 == 1) {
    f.o = corner + f.o;
  } else {  // half a turn, so that two rows share a street
    const auto half_turn = [](Vec v) { return Vec{-v.x, -v.y, v.z}; };
    f = {corner + Vec{bay_width, bay_depth, 0} + half_turn(f.o), half_turn(f.x), half_turn(f.y), half_turn(f.z)};
  }
  draw(*slot.part, f, mix(mix(options.seed) + index), mesh);
}

PlantSize plant_object_size(const PlantOptions& options, std::size_t index) {
  const Part& part = *slot_of(options, index).part;
  return {part.vertices, part.triangles};
}

PlantSize plant_size(const PlantOptions& options) {
  const Plans& all = plans();
  const std::size_t blocks = options.objects / all.block_objects;
  std::size_t rest = options.objects % all.block_objects;
  PlantSize total{all.block_size.vertices * blocks, all.block_size.triangles * blocks};
  for (const std::uint8_t plan : plan_order(options.seed, blocks)) {
    const std::size_t count = std::min(rest, all.parts[plan].size());
    rest -= count;
    for (std::size_t i = 0; i < count; ++i) {
      total.vertices += all.parts[plan][i].vertices;
      total.triangles += all.parts[plan][i].triangles;
    }
  }
  return total;
}

PlantKind plant_kind(const PlantOptions& options, std::size_t index) {
  return slot_of(options, index).part->kind;
}

bool plant_is_closed(const PlantOptions& options, std::size_t index) {
  return is_closed(*slot_of(options, index).part);
}

std::string_view plant_kind_name(PlantKind kind) {
  constexpr std::array<std::string_view, plant_kind_count> names{
      "tank",  "vessel", "slab",  "column", "beam",    "brace", "grating", "handrail", "stair",  "ladder",     "pipe",
      "elbow", "flange", "valve", "pump",   "support", "tray",  "wire",    "plate",    "gusset", "name plate", "bolt"};
  return names[static_cast<std::size_t>(kind)];
}

Box plant_box(const PlantOptions& options) {
  const Site site = site_of(options);
  Box box;
  if (site.bays <= few_bays) {
    MeshData mesh;
    for (std::size_t i = 0; i < options.objects; ++i) {
      plant_object(options, i, mesh);
      for (const glm::vec3& p : mesh.positions) {
        box.min = glm::min(box.min, p);
        box.max = glm::max(box.max, p);
      }
    }
  } else {
    const Real x = Real(static_cast<double>(site.columns)) * (bay_width * 0.5) + bay_margin;
    const Real y = Real(static_cast<double>(site.rows)) * (bay_depth * 0.5) + bay_margin;
    box.max = {ieee::to_float(x.v), ieee::to_float(y.v), ieee::to_float(bay_high)};
    box.min = {-box.max.x, -box.max.y, ieee::to_float(bay_low)};
  }
  return box;
}

PlantCamera plant_camera(const PlantOptions& options) {
  PlantCamera camera;
  camera.vertical_fov = 0.69813170f;  // 40 degrees
  if (options.objects == 0) {
    camera.position = {0.0f, -1.0f, 0.0f};
    return camera;
  }
  const Box box = plant_box(options);
  const Real tangent = 0.36397023, aspect = 1.5;  // of half the field of view
  const bool large = site_of(options).bays > few_bays;
  const Real roof = large ? std::min(box.max.z, 16.0f) : box.max.z;  // towers may stand out of what fills the picture
  const Vec low{box.min.x, box.min.y, box.min.z}, high{box.max.x, box.max.y, roof};
  const Vec back = unit({0.5, -0.75, 0.36});
  const Vec right = unit(cross(up, back)), top = cross(back, right);
  Vec target = (low + high) * 0.5;
  Real distance = length(high - low);
  for (int round = 0; round < 16; ++round) {  // centre the box's picture, then stand where it just fits
    Real x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9, nearest = 0;
    for (int i = 0; i < 8; ++i) {
      const Vec c = Vec{i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z} - target;
      const Real ahead = dot(c, back);
      const Real depth = distance - ahead;
      const Real x = dot(c, right) / depth, y = dot(c, top) / depth;
      x0 = std::min(x0.v, x.v);
      x1 = std::max(x1.v, x.v);
      y0 = std::min(y0.v, y.v);
      y1 = std::max(y1.v, y.v);
      nearest = std::max(nearest.v, ahead.v);
    }
    target = target + right * ((x0 + x1) * 0.5 * distance) + top * ((y0 + y1) * 0.5 * distance);
    const Real fill = std::max(((x1 - x0) / aspect).v, (y1 - y0).v);
    distance = std::max((distance * fill * 0.5 / tangent).v, (nearest * 1.2 + 0.5).v);
  }
  const Vec eye = target + back * (distance * 1.03);
  const auto to_vec3 = [](Vec v) {
    return glm::vec3{ieee::to_float(v.x.v), ieee::to_float(v.y.v), ieee::to_float(v.z.v)};
  };
  camera.position = to_vec3(eye);
  camera.target = to_vec3(target);
  return camera;
}

}  // namespace pgl::scene
