// SPDX-License-Identifier: MIT
#include "pgl/host/rasterize_depth.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "support/depth_scenes.hpp"
#include "support/meshes.hpp"

namespace {

using pgl::Coverage;
using pgl::Depth;
using pgl::depth_map_of;
using pgl::DepthMap;
using pgl::DepthOrder;
using pgl::DepthRange;
using pgl::far_depth;
using pgl::View;
using test::DepthScene;

using Scene = DepthScene<std::uint32_t>;

std::vector<Depth> drawn(const Scene& s, const DepthMap& size) {
  std::vector<Depth> depth(std::size_t{size.width} * size.height, far_depth);
  pgl::host::DepthWorkspace workspace;
  pgl::host::rasterize_depth<std::uint32_t>(s.meshes, s.objects, s.vertices, s.triangles, s.map, s.occluders, s.view,
                                            size, workspace, depth);
  return depth;
}
std::vector<Depth> drawn(const Scene& s) {
  return drawn(s, depth_map_of(s.view));
}

std::size_t written(const std::vector<Depth>& depth) {
  return depth.size() - static_cast<std::size_t>(std::ranges::count(depth, far_depth));
}

/// x, y and z from -1 to 1 are the picture of 8 x 4 pixels, near to far.
View flat() {
  View v;
  v.width = 8;
  v.height = 4;
  return v;
}

/// One triangle, in pixels of the picture `v` and in window depth.
Scene triangle(const View& v, glm::vec3 a, glm::vec3 b, glm::vec3 c) {
  Scene s;
  s.view = v;
  for (glm::vec3* p : {&a, &b, &c}) {
    p->x = p->x / v.width * 2 - 1;
    p->y = p->y / v.height * 2 - 1;
    p->z = p->z * 2 - 1;
  }
  const glm::vec3 points[3] = {a, b, c};
  const pgl::Triangle<std::uint32_t> corners[1] = {{{0, 1, 2}}};
  s.add_occluder(s.add_mesh(points, corners));
  return s;
}

/// The rows from the top to the bottom, # where something was drawn.
std::string shape(const std::vector<Depth>& depth, const DepthMap& size) {
  std::string text;
  for (std::uint32_t j = size.height; j-- > 0;) {
    for (std::uint32_t i = 0; i < size.width; ++i)
      text += depth[std::size_t{j} * size.width + i] == far_depth ? '.' : '#';
    text += '\n';
  }
  return text;
}

constexpr Depth half = 0x80000000u;

#define EXPECT_JUST_ABOVE(depth, value)   \
  do {                                    \
    EXPECT_GE(depth, value);              \
    EXPECT_LE(depth, Depth{(value)} + 2); \
  } while (false)

TEST(RasterizeDepth, DrawsThePixelsWhoseCentresAreInside) {
  const Scene s = triangle(flat(), {0.4f, 0.2f, 0.5f}, {7.9f, 0.2f, 0.5f}, {0.4f, 3.9f, 0.5f});
  const auto depth = drawn(s);
  EXPECT_EQ(shape(depth, depth_map_of(s.view)),
            "#.......\n"
            "###.....\n"
            "#####...\n"
            "#######.\n");
  for (const Depth d : depth)
    if (d != far_depth) EXPECT_JUST_ABOVE(d, half);
}

TEST(RasterizeDepth, DrawsBothWindings) {
  const glm::vec3 a(0.4f, 0.2f, 0.25f), b(7.9f, 0.2f, 0.5f), c(0.4f, 3.9f, 0.75f);
  const auto one = drawn(triangle(flat(), a, b, c)), other = drawn(triangle(flat(), a, c, b));
  EXPECT_EQ(written(one), 16u);
  for (std::size_t i = 0; i < one.size(); ++i) EXPECT_NEAR(one[i], other[i], 1.0) << i;
}

TEST(RasterizeDepth, InterpolatesTheDepth) {
  View v = flat();
  v.width = v.height = 16;
  // Depth x / 32 + y / 64, in a triangle that holds the picture.
  const auto at = [](float x, float y) { return glm::vec3(x, y, x / 32 + y / 64); };
  const auto depth = drawn(triangle(v, at(-1, -1), at(33, -1), at(-1, 33)));
  for (std::uint32_t j = 0; j < 16; ++j)
    for (std::uint32_t i = 0; i < 16; ++i)
      EXPECT_NEAR(depth[16 * j + i], ((i + 0.5) / 32 + (j + 0.5) / 64) * 0x1p32, 0x1p12);  // vertices are floats
}

TEST(RasterizeDepth, KeepsTheNearerOfWhatIsThere) {
  Scene s = triangle(flat(), {-9, -9, 0.5f}, {30, -9, 0.5f}, {-9, 30, 0.5f});
  std::vector<Depth> depth(32, far_depth);
  depth[3] = half - 100;
  depth[4] = half + 100;
  pgl::host::DepthWorkspace workspace;
  for (int again = 0; again < 2; ++again) {
    pgl::host::rasterize_depth<std::uint32_t>(s.meshes, s.objects, s.vertices, s.triangles, s.map, s.occluders, s.view,
                                              depth_map_of(s.view), workspace, depth);
    for (std::size_t i = 0; i < 32; ++i) {
      if (i == 3)
        EXPECT_EQ(depth[i], half - 100);
      else
        EXPECT_JUST_ABOVE(depth[i], half);
    }
  }
}

TEST(RasterizeDepth, LeavesOutWhatIsBeyondTheFarPlane) {
  // Depth runs from 0.5 at x = 0 to 1.5 at x = 8.
  const auto depth = drawn(triangle(flat(), {0, -9, 0.5f}, {0, 30, 0.5f}, {80, 2, 10.5f}));
  EXPECT_EQ(shape(depth, depth_map_of(flat())),
            "####....\n"
            "####....\n"
            "####....\n"
            "####....\n");
}

TEST(RasterizeDepth, CutsOffWhatIsBeforeTheNearPlane) {
  // Depth runs from -0.5 at x = 0 to 0.5 at x = 8.
  const auto depth = drawn(triangle(flat(), {0, -90, -0.5f}, {0, 300, -0.5f}, {80, 2, 9.5f}));
  EXPECT_EQ(shape(depth, depth_map_of(flat())),
            "....####\n"
            "....####\n"
            "....####\n"
            "....####\n");
  EXPECT_JUST_ABOVE(depth[4], (Depth{1} << 28));  // 1/16 at x = 4.5
}

TEST(RasterizeDepth, DrawsTheFloorFromUnderTheEyeToTheHorizon) {
  for (const auto range : {DepthRange::minus_one_to_one, DepthRange::zero_to_one})
    for (const auto order : {DepthOrder::conventional, DepthOrder::reversed}) {
      Scene s;
      s.view = test::depth_camera(64, 64, 0.5f, 1000, range, order);
      const glm::vec3 points[4] = {{-1e4f, -1, 1e4f}, {1e4f, -1, 1e4f}, {1e4f, -1, -1e4f}, {-1e4f, -1, -1e4f}};
      const pgl::Triangle<std::uint32_t> corners[2] = {{{0, 1, 2}}, {{0, 2, 3}}};
      s.add_occluder(s.add_mesh(points, corners));
      const auto depth = drawn(s);
      std::size_t lost = 0;
      for (std::uint32_t j = 0; j < 64; ++j) {
        const double below = 1 - (j + 0.5) / 32;  // the ray falls so much for 1 forward
        const double distance = 1 / below;
        const bool seen = below > 0 && distance > 0.5 && distance < 1000;
        for (std::uint32_t i = 0; i < 64; ++i) {
          const Depth d = depth[64 * j + i];
          if (!seen) {
            EXPECT_EQ(d, far_depth) << i << ' ' << j;
          } else if (d == far_depth) {
            ++lost;  // on the diagonal
          } else {
            EXPECT_NEAR(d, (1 - 0.5 / distance) * 1000 / 999.5 * 0x1p32, 1e4) << i << ' ' << j;
          }
        }
      }
      EXPECT_LE(lost, 32u);
    }
}

TEST(RasterizeDepth, AsksForAllPixelsOfATexel) {
  // Everything left of x = 6.3, in texels of 2 x 2 pixels.
  const Scene s = triangle(flat(), {6.3f, -90, 0.5f}, {6.3f, 90, 0.5f}, {-90, 2, 0.5f});
  EXPECT_EQ(shape(drawn(s), depth_map_of(s.view)), "######..\n######..\n######..\n######..\n");
  const DepthMap twos = depth_map_of(s.view, 2);
  EXPECT_EQ(shape(drawn(s, twos), twos), "###.\n###.\n");
  const Scene less = triangle(flat(), {5.6f, -90, 0.5f}, {5.6f, 90, 0.5f}, {-90, 2, 0.5f});
  EXPECT_EQ(shape(drawn(less, twos), twos), "###.\n###.\n");
  const DepthMap whole = depth_map_of(s.view, 2, Coverage::whole);
  EXPECT_EQ(shape(drawn(less, whole), whole), "##..\n##..\n");
  const DepthMap pixels = depth_map_of(s.view, 1, Coverage::whole);
  EXPECT_EQ(shape(drawn(less, pixels), pixels), "#####...\n#####...\n#####...\n#####...\n");
}

TEST(RasterizeDepth, GivesATexelItsFarthestDepth) {
  View v = flat();
  v.width = v.height = 16;
  const auto at = [](float x, float y) { return glm::vec3(x, y, (x + 8) / 64); };
  const Scene s = triangle(v, at(-8, -8), at(56, -8), at(-8, 56));
  const auto centres = drawn(s, depth_map_of(v, 4)), whole = drawn(s, depth_map_of(v, 4, Coverage::whole));
  for (std::uint32_t i = 0; i < 4; ++i) {
    EXPECT_JUST_ABOVE(centres[i], static_cast<Depth>((4 * i + 3.5 + 8) / 64 * 0x1p32));
    EXPECT_JUST_ABOVE(whole[i], static_cast<Depth>((4 * i + 4.0 + 8) / 64 * 0x1p32));
  }
}

TEST(RasterizeDepth, NeverGoesBeyondTheFarthestCorner) {
  // From 1/4 to 3/4 within a pixel; the plane goes far beyond at the ends of the texels' sides.
  const Scene s = triangle(flat(), {2.4f, -90, 0.25f}, {2.4f, 90, 0.25f}, {3.6f, 2, 0.75f});
  const auto centres = drawn(s);
  EXPECT_EQ(written(centres), 8u);
  for (std::uint32_t j = 0; j < 4; ++j) {
    EXPECT_NEAR(centres[8 * j + 2], (0.25 + 0.1 / 1.2 * 0.5) * 0x1p32, 2000);
    EXPECT_NEAR(centres[8 * j + 3], (0.25 + 1.1 / 1.2 * 0.5) * 0x1p32, 2000);
  }
  const Scene wider = triangle(flat(), {1.9f, -90, 0.25f}, {1.9f, 90, 0.25f}, {3.2f, 2, 0.75f});
  const auto whole = drawn(wider, depth_map_of(wider.view, 1, Coverage::whole));
  EXPECT_EQ(written(whole), 4u);
  for (const Depth d : whole) EXPECT_TRUE(d == far_depth || d <= half / 2 * 3 + 2) << d;
}

TEST(RasterizeDepth, PassesOverWhatIsNoTriangle) {
  constexpr float odd[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                           -std::numeric_limits<float>::infinity()};
  for (const float value : odd)
    for (int axis = 0; axis < 3; ++axis) {
      glm::vec3 p(4, 30, 0.5f);
      p[axis] = value;
      EXPECT_EQ(written(drawn(triangle(flat(), {-9, -9, 0.5f}, {30, -9, 0.5f}, p))), 0u);
    }
  const glm::vec3 a(-9, -9, 0.5f), b(30, 30, 0.5f);
  EXPECT_EQ(written(drawn(triangle(flat(), a, a, b))), 0u);
  EXPECT_EQ(written(drawn(triangle(flat(), a, a, a))), 0u);
  EXPECT_EQ(written(drawn(triangle(flat(), a, b, (a + b) * 0.5f))), 0u);
}

TEST(RasterizeDepth, PassesOverEntriesThatNameNoObject) {
  Scene s = triangle(flat(), {-9, -9, 0.5f}, {30, -9, 0.5f}, {-9, 30, 0.5f});
  s.add_occluder(s.add_mesh({}, {}));
  s.occluders = {pgl::no_object, 0, pgl::no_object, 1, 0};
  EXPECT_EQ(written(drawn(s)), 32u);
  s.occluders = {pgl::no_object, 1};
  EXPECT_EQ(written(drawn(s)), 0u);
  s.occluders.clear();
  EXPECT_EQ(written(drawn(s)), 0u);
}

TEST(RasterizeDepth, TakesPicturesOfOneRowAndOfOneColumn) {
  for (const auto& [width, height] : {std::pair{1.0f, 1.0f}, {7.0f, 1333.0f}, {65536.0f, 1.0f}, {1.0f, 65536.0f}}) {
    View v = flat();
    v.width = width;
    v.height = height;
    const auto depth =
        drawn(triangle(v, {-1.5f * width, -height, 0.5f}, {3 * width, -height, 0.5f}, {-width, 4 * height, 0.5f}));
    EXPECT_EQ(written(depth), depth.size());
  }
}

TEST(RasterizeDepth, DrawsAlikeAtAnyScaleOfTheWorld) {
  const auto at_scale = [](float scale) {
    Scene s;
    s.view = test::depth_camera(96, 64, 0.1f * scale, 64 * scale, DepthRange::zero_to_one, DepthOrder::reversed);
    const std::uint32_t ball = s.add_mesh(test::sphere(3));
    glm::mat4x3 place(scale);
    place[3] = glm::vec3(0.3f, 0.1f, -2.5f) * scale;
    s.add_occluder(ball, place);
    return drawn(s);
  };
  const auto one = at_scale(1);
  EXPECT_GT(written(one), 500u);
  for (const float scale : {0x1p-20f, 0x1p30f}) EXPECT_EQ(at_scale(scale), one);
}

TEST(RasterizeDepth, DoesNotDependOnTheNumberOfThreadsOrTheOrder) {
  Scene s;
  s.view = test::depth_camera(1200, 900, 0.1f, 64, DepthRange::zero_to_one, DepthOrder::reversed);
  const std::uint32_t ball = s.add_mesh(test::sphere(4)), few = s.add_mesh(test::octahedron());
  std::mt19937 random(1);
  for (int i = 0; i < 60; ++i) {
    glm::mat4x3 place(1.0f);
    place[3] = {3 * test::signed_unit(random), 3 * test::signed_unit(random), -5 + 5 * test::signed_unit(random)};
    s.add_occluder(i % 3 ? ball : few, place);
  }
  const auto all = drawn(s);
  EXPECT_GT(written(all), 100000u);
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 7}) {
    omp_set_num_threads(n);
    EXPECT_EQ(drawn(s), all) << n;
  }
  omp_set_num_threads(threads);
#endif
  std::ranges::reverse(s.occluders);
  EXPECT_EQ(drawn(s), all);
}

TEST(RasterizeDepth, AllocatesNothingTheSecondTime) {
  Scene s;
  s.view = test::depth_camera(300, 200, 0.1f, 64, DepthRange::zero_to_one, DepthOrder::conventional);
  glm::mat4x3 place(1.0f);
  place[3].z = -2;
  s.add_occluder(s.add_mesh(test::sphere(3)), place);
  const DepthMap size = depth_map_of(s.view);
  std::vector<Depth> depth(std::size_t{size.width} * size.height, far_depth);
  pgl::host::DepthWorkspace w;
  const auto draw = [&] {
    pgl::host::rasterize_depth<std::uint32_t>(s.meshes, s.objects, s.vertices, s.triangles, s.map, s.occluders, s.view,
                                              size, w, depth);
  };
  draw();
  const auto held = [&] {
    return std::vector<std::size_t>{w.vertices.capacity(), w.vertex_parts.capacity(), w.triangle_parts.capacity(),
                                    w.large.capacity()};
  };
  const auto before = held();
  draw();
  EXPECT_EQ(held(), before);
}

/// The spans that the host draws, and depths by steps along a row, are those that the rule defines texel by texel.
TEST(RasterizeDepth, SpansAndStepsAreWhatTheDefinitionSays) {
  std::mt19937 random(7);
  std::size_t covered = 0, rows_without = 0;
  for (int repeat = 0; repeat < 3000; ++repeat) {
    View v;
    v.width = static_cast<float>(1 + random() % 60);
    v.height = static_cast<float>(1 + random() % 40);
    const pgl::DepthView view = pgl::depth_view_of(v, depth_map_of(v));
    pgl::DepthVertex corners[3];
    for (pgl::DepthVertex& c : corners) {
      const float reach = repeat % 3 == 0 ? 3.0f : 1.0f;
      const glm::vec3 p(reach * test::signed_unit(random), reach * test::signed_unit(random),
                        test::signed_unit(random));
      c = pgl::depth_vertex(view, pgl::clip_vertex(view, p));
      ASSERT_TRUE(pgl::is_drawable(c));
    }
    const pgl::DepthTriangle t = pgl::depth_triangle(view, corners[0], corners[1], corners[2]);
    if (t.columns == 0) continue;
    for (std::uint32_t j = 0; j < t.rows; ++j) {
      const pgl::DepthSpan span = pgl::covered_span(t, j);
      std::int64_t value = t.depth[0] + t.depth[2] * static_cast<std::int64_t>(j);
      rows_without += span.first >= span.end;
      for (std::uint32_t i = 0; i < t.columns; ++i, value += t.depth[1]) {
        ASSERT_EQ(pgl::covers(t, i, j), span.first <= i && i < span.end) << i << ", " << j;
        if (!pgl::covers(t, i, j)) continue;
        ASSERT_EQ(pgl::depth_at(t, i, j), pgl::depth_of(t, value));
        ++covered;
      }
    }
  }
  EXPECT_GT(covered, 100000u);
  EXPECT_GT(rows_without, 100u);
}

}  // namespace
