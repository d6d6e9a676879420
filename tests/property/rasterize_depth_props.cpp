// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "pgl/host/rasterize_depth.hpp"
#include "support/depth_scenes.hpp"
#include "support/exact_raster.hpp"
#include "support/numbers.hpp"

namespace {

using exact::DrawnTriangle;
using exact::Number;
using pgl::Coverage;
using pgl::Depth;
using pgl::DepthMap;
using pgl::far_depth;
using pgl::View;
using test::DepthScene;

template <class Index>
std::vector<Depth> drawn(const DepthScene<Index>& s, const DepthMap& size) {
  std::vector<Depth> depth(std::size_t{size.width} * size.height, far_depth);
  pgl::host::DepthWorkspace workspace;
  pgl::host::rasterize_depth<Index>(s.meshes, s.objects, s.vertices, s.triangles, s.map, s.occluders, s.view, size,
                                    workspace, depth);
  return depth;
}

template <class Index>
std::vector<DrawnTriangle> truth(const DepthScene<Index>& s) {
  std::vector<DrawnTriangle> all;
  for (const std::uint32_t i : s.occluders) {
    if (i == pgl::no_object) continue;
    const auto some = exact::drawn_triangles<Index>(s.view, s.objects[i], s.meshes, s.vertices, s.triangles, s.map);
    all.insert(all.end(), some.begin(), some.end());
  }
  return all;
}

/// The places, in half pixels, that a texel's coverage speaks of; of a whole texel its corners, which are enough for a
/// triangle.
std::vector<std::pair<int, int>> places(const View& view, const DepthMap& size, std::uint32_t i, std::uint32_t j) {
  const int scale = static_cast<int>(size.scale), x = static_cast<int>(i) * scale, y = static_cast<int>(j) * scale;
  const int right = std::min(x + scale, static_cast<int>(view.width));
  const int top = std::min(y + scale, static_cast<int>(view.height));
  if (size.coverage == Coverage::whole)
    return {{2 * x, 2 * y}, {2 * right, 2 * y}, {2 * x, 2 * top}, {2 * right, 2 * top}};
  std::vector<std::pair<int, int>> all;
  for (int q = y; q < top; ++q)
    for (int p = x; p < right; ++p) all.emplace_back(2 * p + 1, 2 * q + 1);
  return all;
}

/// The farthest depth of a triangle over the places, if it covers all of them inside its edges.
std::optional<Number> farthest(const DrawnTriangle& t, const std::vector<std::pair<int, int>>& all) {
  for (const auto& [x, y] : all)
    if (!t.covers(x, y, true)) return std::nullopt;
  std::optional<Number> most;
  for (const auto& [x, y] : all) {
    const Number d = t.depth().at(x, y);
    if (!most || d > *most) most = d;
  }
  return most;
}

Number in_steps(Depth depth) {
  return Number(depth) / Number(4294967296.0);
}

/// Whether each texel that is written is covered by one triangle, which is nowhere in it farther than what was written.
/// Counts these texels.
template <class Index>
bool holds(const DepthScene<Index>& scene, const DepthMap& size, int& written) {
  const auto depth = drawn(scene, size);
  const auto exactly = truth(scene);
  for (std::uint32_t j = 0; j < size.height; ++j)
    for (std::uint32_t i = 0; i < size.width; ++i) {
      const Depth d = depth[std::size_t{j} * size.width + i];
      if (d == far_depth) continue;
      ++written;
      const auto all = places(scene.view, size, i, j);
      const bool is_true = std::ranges::any_of(exactly, [&](const DrawnTriangle& t) {
        const auto most = farthest(t, all);
        return most && *most <= in_steps(d);
      });
      if (!is_true) return false;
    }
  return true;
}

TEST(RasterizeDepthProps, ATexelThatIsWrittenIsCoveredAndNotTooNear) {
  int scenes = 0, with_texels = 0;
  EXPECT_TRUE(rc::check([&] {
    for (int repeat = 0; repeat < 5; ++repeat) {
      auto scene = test::any_depth_scene<std::uint32_t>();
      const DepthMap size = test::choose_size(scene.view, 24);
      int written = 0;
      RC_ASSERT(holds(scene, size, written));
      ++scenes;
      with_texels += written > 0;
    }
  }));
  EXPECT_GE(with_texels, scenes / 10);  // else this says nothing
}

/// Window depth a / m.
struct KnownDepth {
  std::int64_t a, m;
};

/// A view of 16 x 16 pixels that shows the origin exactly at the centre of pixel (i, j), at a window depth that is a
/// millionth of a step or so beyond a whole step. Points of in_units(unit) are mostly off the picture, behind the near
/// plane.
View around_the_origin(int i, int j, float unit, KnownDepth* depth = nullptr) {
  View v;
  v.width = v.height = 16;
  v.depth_range = test::coin() ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
  v.depth_order = test::coin() ? pgl::DepthOrder::reversed : pgl::DepthOrder::conventional;
  // Depth a / m, where a * 2^32 is 1, 2 or 3 modulo m.
  const std::int64_t m = 2 * numbers::whole(1 << 15, 1 << 18) + 1;
  std::int64_t a = numbers::whole(1, 3);
  for (int k = 0; k < 32; ++k) a = (a % 2 == 0 ? a : a + m) / 2;
  if (depth != nullptr) *depth = {a, m};
  std::int64_t z = a;
  if (v.depth_order == pgl::DepthOrder::reversed) z = m - z;
  if (v.depth_range == pgl::DepthRange::minus_one_to_one) z = 2 * z - m;
  const auto number = [](std::int64_t n) { return static_cast<float>(n); };
  const float part = std::ldexp(number(std::min(a, m - a)), -numbers::whole(25, 40)) / unit;
  for (int column = 0; column < 3; ++column) {
    v.clip_from_world[column].x = numbers::number(numbers::Kind::plain);
    v.clip_from_world[column].y = numbers::number(numbers::Kind::plain);
    v.clip_from_world[column].z = numbers::whole(0, 3) ? numbers::number(numbers::Kind::plain) * part : 0.0f;
    v.clip_from_world[column].w = numbers::whole(0, 3) ? numbers::number(numbers::Kind::plain) * part : 0.0f;
  }
  v.clip_from_world[3] = {number((2 * i - 15) * m) / 16, number((2 * j - 15) * m) / 16, number(z), number(m)};
  return v;
}

/// A point of whole parts of a unit, up to 2^22 of them.
glm::vec3 in_units(float unit) {
  constexpr int most = 1 << 22;
  const auto x = static_cast<float>(numbers::whole(-most, most)), y = static_cast<float>(numbers::whole(-most, most));
  return glm::vec3(x, y, static_cast<float>(numbers::whole(-most, most))) * unit;
}

DepthScene<std::uint32_t> one_triangle(const View& view, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  DepthScene<std::uint32_t> scene;
  scene.view = view;
  const glm::vec3 points[3] = {a, b, c};
  const pgl::Triangle<std::uint32_t> corners[1] = {{{0, 1, 2}}};
  scene.add_occluder(scene.add_mesh(points, corners));
  return scene;
}

/// What the other properties rely on, without its formulas: the origin as a known sum of a triangle's corners.
RC_GTEST_PROP(RasterizeDepthProps, theExactPictureHasAKnownPointOfATriangleAtItsDepth, ()) {
  int inside = 0;
  for (int repeat = 0; repeat < 100; ++repeat) {
    const int i = numbers::whole(0, 15), j = numbers::whole(0, 15);
    const float unit = std::ldexp(1.0f, numbers::whole(-12, 20));
    KnownDepth known{};
    const View view = around_the_origin(i, j, unit, &known);
    const glm::vec3 a = in_units(unit), b = in_units(unit);
    const DrawnTriangle around(view, a, b, -(a + b));  // a third of each
    if (around.covers_pixel(i, j, true)) {             // not edge-on
      ++inside;
      RC_ASSERT(around.depth_at_pixel(i, j) == Number(mpz_class(known.a)) / mpz_class(known.m));
    }
    const DrawnTriangle beside(view, a, 2.0f * b, a + b);  // 2, 1 and -2 of them
    RC_ASSERT(!beside.covers_pixel(i, j));
    const DrawnTriangle touching(view, a, -a, b);
    RC_ASSERT(!touching.covers_pixel(i, j, true));
    RC_ASSERT(touching.covers_pixel(i, j) == around.covers_pixel(i, j, true));
  }
  RC_ASSERT(inside >= 90);
}

TEST(RasterizeDepthProps, AnEdgeExactlyThroughAPixelsCentreDoesNotCoverIt) {
  int triangles = 0, with_texels = 0;
  EXPECT_TRUE(rc::check([&] {
    for (int repeat = 0; repeat < 200; ++repeat) {
      const int i = numbers::whole(0, 15), j = numbers::whole(0, 15);
      const float unit = std::ldexp(1.0f, numbers::whole(-12, 20));
      const glm::vec3 a = in_units(unit), c = in_units(unit);
      const auto scene = one_triangle(around_the_origin(i, j, unit), a, -a, c);
      RC_ASSERT(!truth(scene)[0].covers_pixel(i, j, true));
      int written = 0;
      RC_ASSERT(holds(scene, pgl::depth_map_of(scene.view), written));
      ++triangles;
      with_texels += written > 0;
    }
  }));
  EXPECT_GE(with_texels, triangles / 4);  // what lies to one side of the centre is drawn
}

TEST(RasterizeDepthProps, ADepthJustBeyondAStepIsRoundedToTheNext) {
  int triangles = 0, with_texels = 0;
  EXPECT_TRUE(rc::check([&] {
    for (int repeat = 0; repeat < 200; ++repeat) {
      const int i = numbers::whole(0, 15), j = numbers::whole(0, 15);
      const float unit = std::ldexp(1.0f, numbers::whole(-12, 20));
      const glm::vec3 a = in_units(unit), b = in_units(unit);
      const auto scene = one_triangle(around_the_origin(i, j, unit), a, b, -(a + b));  // the origin is its centroid
      int written = 0;
      RC_ASSERT(holds(scene, pgl::depth_map_of(scene.view), written));
      ++triangles;
      with_texels += written > 0;
    }
  }));
  EXPECT_GE(with_texels, triangles / 2);
}

/// Balls, rings and octahedra before an ordinary camera, or also around it.
DepthScene<std::uint32_t> ordinary_scene(bool around) {
  DepthScene<std::uint32_t> scene;
  const auto range = test::coin() ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
  const auto order = test::coin() ? pgl::DepthOrder::conventional : pgl::DepthOrder::reversed;
  scene.view = test::depth_camera(static_cast<float>(numbers::whole(20, 64)),
                                  static_cast<float>(numbers::whole(20, 64)), 0.1f, 100, range, order);
  const std::uint32_t meshes[] = {scene.add_mesh(test::sphere(2)), scene.add_mesh(test::octahedron()),
                                  scene.add_mesh(test::torus(12, 8))};
  for (int count = numbers::whole(1, 5); count > 0; --count) {
    glm::mat4x3 place(0.3f + std::abs(numbers::number(numbers::Kind::plain)));
    place[0] += 0.2f * numbers::point(numbers::Kind::plain);
    place[3] = 2.0f * numbers::point(numbers::Kind::plain) + glm::vec3(0, 0, around ? -2 : -5);
    scene.add_occluder(meshes[numbers::whole(0, 2)], place);
  }
  return scene;
}

TEST(RasterizeDepthProps, NearlyAllThatIsCoveredIsWrittenAtItsDepth) {
  int scenes = 0, all_covered = 0;
  EXPECT_TRUE(rc::check([&] {
    const auto scene = ordinary_scene(true);
    const DepthMap size = pgl::depth_map_of(scene.view);
    const auto depth = drawn(scene, size);
    const auto exactly = truth(scene);
    exact::Picture picture(scene.view);
    picture.draw(exactly);
    int covered = 0, good = 0;
    for (std::uint32_t j = 0; j < size.height; ++j)
      for (std::uint32_t i = 0; i < size.width; ++i) {
        const Depth d = depth[std::size_t{j} * size.width + i];
        const DrawnTriangle* const seen = picture.at(static_cast<int>(i), static_cast<int>(j));
        RC_ASSERT(seen != nullptr || d == far_depth);
        if (seen == nullptr) continue;
        ++covered;
        const Number exactly_here = seen->depth_at_pixel(static_cast<int>(i), static_cast<int>(j));
        RC_ASSERT(exactly_here <= in_steps(d));
        good += in_steps(d) - exactly_here <= Number(0x1p-31) ? 1 : 0;  // two steps
      }
    RC_ASSERT(good * 1000 >= covered * 999 - 1000);  // edges of the meshes may go exactly through a centre or two
    ++scenes;
    all_covered += covered;
  }));
  EXPECT_GE(all_covered, (scenes - 10) * 20);
}

/// For larger texels too, but for those on the cut of what is left of a triangle that passes through the near plane.
TEST(RasterizeDepthProps, LargeTexelsAreWrittenWhereOneTriangleCoversThem) {
  int scenes = 0, all_covered = 0;
  EXPECT_TRUE(rc::check([&] {
    const auto scene = ordinary_scene(false);
    const DepthMap size = pgl::depth_map_of(scene.view, static_cast<std::uint32_t>(numbers::whole(1, 5)),
                                            test::coin() ? Coverage::centres : Coverage::whole);
    const auto depth = drawn(scene, size);
    const auto exactly = truth(scene);
    int covered = 0, good = 0;
    for (std::uint32_t j = 0; j < size.height; ++j)
      for (std::uint32_t i = 0; i < size.width; ++i) {
        if (i == size.width - 1 || j == size.height - 1) continue;  // may end beyond the picture
        const auto all = places(scene.view, size, i, j);
        std::optional<Number> nearest;
        for (const DrawnTriangle& t : exactly)
          if (const auto most = farthest(t, all); most && (!nearest || *most < *nearest)) nearest = most;
        const Depth d = depth[std::size_t{j} * size.width + i];
        RC_ASSERT(nearest || d == far_depth);
        if (!nearest) continue;
        ++covered;
        RC_ASSERT(*nearest <= in_steps(d));
        good += in_steps(d) - *nearest <= Number(0x1p-31) ? 1 : 0;
      }
    RC_ASSERT(good * 1000 >= covered * 999 - 1000);
    ++scenes;
    all_covered += covered;
  }));
  EXPECT_GE(all_covered, (scenes - 10) * 5);  // the first scenes that RapidCheck makes are the smallest
}

}  // namespace
