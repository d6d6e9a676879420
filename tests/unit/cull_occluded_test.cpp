// SPDX-License-Identifier: MIT
#include "pgl/host/cull_occluded.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <tuple>
#include <vector>

#include "pgl/host/build_hzm.hpp"
#include "pgl/types.hpp"

namespace {

using pgl::Box;
using pgl::Depth;
using pgl::DepthMap;
using pgl::DepthOrder;
using pgl::DepthRange;
using pgl::ScreenBox;
using pgl::TexelRange;
using pgl::View;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

DepthMap map_of(std::uint32_t width, std::uint32_t height, std::uint32_t scale = 1) {
  DepthMap size;
  size.width = width;
  size.height = height;
  size.scale = scale;
  return size;
}

ScreenBox rectangle(float x0, float y0, float x1, float y1) {
  return {x0, y0, x1, y1, 1};
}

// ---- which texels

TEST(CoveredTexels, AreThoseOfTheRectangleGrownByAPixel) {
  TexelRange r;
  ASSERT_TRUE(pgl::covered_texels(rectangle(4.5f, 7.25f, 4.75f, 9.0f), map_of(20, 20), r));
  EXPECT_EQ(r, (TexelRange{3, 6, 5, 10}));
  ASSERT_TRUE(pgl::covered_texels(rectangle(0, 0, 20, 20), map_of(20, 20), r));
  EXPECT_EQ(r, (TexelRange{0, 0, 19, 19}));
  ASSERT_TRUE(pgl::covered_texels(rectangle(5, 5, 5, 5), map_of(20, 20), r));  // a point
  EXPECT_EQ(r, (TexelRange{4, 4, 6, 6}));
}

TEST(CoveredTexels, OfACoarseMapAreThoseOfThePixels) {
  TexelRange r;
  ASSERT_TRUE(pgl::covered_texels(rectangle(4.5f, 7.25f, 4.75f, 9.0f), map_of(5, 5, 4), r));
  EXPECT_EQ(r, (TexelRange{0, 1, 1, 2}));
  ASSERT_TRUE(pgl::covered_texels(rectangle(5.5f, 6, 5.75f, 6), map_of(3, 7, 3), r));
  EXPECT_EQ(r, (TexelRange{1, 1, 2, 2}));
  ASSERT_TRUE(pgl::covered_texels(rectangle(0, 0, 19, 19), map_of(1, 1, 1000), r));
  EXPECT_EQ(r, (TexelRange{0, 0, 0, 0}));
}

TEST(CoveredTexels, ReachToThePixelBesideAndNotBeyond) {
  TexelRange r;
  EXPECT_TRUE(pgl::covered_texels(rectangle(-5, 0, -1, 20), map_of(20, 20), r));
  EXPECT_EQ(r, (TexelRange{0, 0, 0, 19}));
  EXPECT_FALSE(pgl::covered_texels(rectangle(-5, 0, std::nextafter(-1.0f, -2.0f), 20), map_of(20, 20), r));
  EXPECT_TRUE(pgl::covered_texels(rectangle(20.5f, 0, 30, 20), map_of(20, 20), r));
  EXPECT_EQ(r, (TexelRange{19, 0, 19, 19}));
  EXPECT_FALSE(pgl::covered_texels(rectangle(21, 0, 30, 20), map_of(20, 20), r));
  EXPECT_FALSE(pgl::covered_texels(rectangle(0, -9, 20, -2), map_of(20, 20), r));
  EXPECT_FALSE(pgl::covered_texels(rectangle(0, 22, 20, 23), map_of(20, 20), r));
}

TEST(CoveredTexels, OfEmptyAndOddRectanglesThereAreNone) {
  TexelRange r;
  EXPECT_FALSE(pgl::covered_texels(ScreenBox{}, map_of(20, 20), r));
  EXPECT_FALSE(pgl::covered_texels(rectangle(5, 5, 4, 6), map_of(20, 20), r));
  for (int side = 0; side < 4; ++side) {
    float s[4] = {5, 5, 6, 6};
    s[side] = nan;
    EXPECT_FALSE(pgl::covered_texels(rectangle(s[0], s[1], s[2], s[3]), map_of(20, 20), r)) << side;
  }
  EXPECT_FALSE(pgl::covered_texels(rectangle(inf, 0, inf, 1), map_of(20, 20), r));
  EXPECT_FALSE(pgl::covered_texels(rectangle(-inf, 0, -inf, 1), map_of(20, 20), r));
  EXPECT_TRUE(pgl::covered_texels(rectangle(-inf, -1e30f, inf, 1e30f), map_of(65536, 65536), r));
  EXPECT_EQ(r, (TexelRange{0, 0, 65535, 65535}));
}

TEST(CoveringLevel, IsTheLeastWithTwoByTwoTexels) {
  EXPECT_EQ(pgl::covering_level({5, 5, 5, 5}), 0u);
  EXPECT_EQ(pgl::covering_level({5, 5, 6, 6}), 0u);
  EXPECT_EQ(pgl::covering_level({4, 4, 7, 4}), 1u);
  EXPECT_EQ(pgl::covering_level({5, 4, 7, 4}), 1u);
  EXPECT_EQ(pgl::covering_level({5, 4, 8, 4}), 2u);  // three texels at level 1: what a formula of the length overlooks
  EXPECT_EQ(pgl::covering_level({0, 0, 0, 4}), 2u);
  EXPECT_EQ(pgl::covering_level({0, 0, 65535, 65535}), 15u);
  EXPECT_EQ(pgl::covering_level({32767, 0, 32768, 0}), 0u);
  for (std::uint32_t a = 0; a < 70; ++a)
    for (std::uint32_t b = a; b < 70; ++b) {
      const std::uint32_t level = pgl::covering_level({a, 3, b, 3});
      EXPECT_LE((b >> level) - (a >> level), 1u);
      if (level > 0) {
        EXPECT_GT((b >> (level - 1)) - (a >> (level - 1)), 1u);
      }
      EXPECT_EQ(pgl::covering_level({3, a, 3, b}), level);
    }
}

// ---- rectangles against a map

/// A map that is `near` everywhere but at one texel, where nothing was drawn.
std::vector<Depth> holed(const DepthMap& size, Depth near, std::uint32_t x, std::uint32_t y) {
  std::vector<Depth> texels(pgl::hzm_texels(size), near);
  texels[y * size.width + x] = pgl::far_depth;
  pgl::host::build_hzm(size, texels);
  return texels;
}

TEST(IsHidden, BehindAWallUnlessTheRectangleTouchesAHole) {
  const DepthMap size = map_of(8, 8);
  const std::vector<Depth> texels = holed(size, 1000, 7, 0);
  const pgl::Hzm hzm = pgl::hzm_of(size, texels.data());
  EXPECT_TRUE(pgl::is_hidden(rectangle(1, 1, 2.5f, 2.5f), 1001, hzm));
  EXPECT_FALSE(pgl::is_hidden(rectangle(1, 1, 2.5f, 2.5f), 1000, hzm));  // as far as the wall: it may be the wall
  EXPECT_FALSE(pgl::is_hidden(rectangle(1, 1, 2.5f, 2.5f), 999, hzm));
  EXPECT_FALSE(pgl::is_hidden(rectangle(6, 1, 6.5f, 1.5f), 1001, hzm));
  EXPECT_FALSE(pgl::is_hidden(rectangle(6, 1, 6.5f, 1.5f), pgl::far_depth, hzm));
  EXPECT_FALSE(pgl::is_hidden(rectangle(0, 0, 8, 8), pgl::far_depth, hzm));
  // It needs level 2, where the texel of the hole is one of those that hold it.
  EXPECT_FALSE(pgl::is_hidden(rectangle(6, 4.5f, 7, 6.5f), 1001, hzm));
  EXPECT_TRUE(pgl::is_hidden(rectangle(6, 5.5f, 7, 6.5f), 1001, hzm));
}

TEST(IsHidden, NothingIsBehindAnEmptyMapOrBesideAFullOne) {
  const DepthMap size = map_of(5, 3);
  const std::vector<Depth> empty(pgl::hzm_texels(size), pgl::far_depth);
  const std::vector<Depth> full(pgl::hzm_texels(size), 0);
  EXPECT_FALSE(pgl::is_hidden(rectangle(1, 1, 2, 2), pgl::far_depth, pgl::hzm_of(size, empty.data())));
  EXPECT_TRUE(pgl::is_hidden(rectangle(1, 1, 2, 2), 1, pgl::hzm_of(size, full.data())));
  EXPECT_FALSE(pgl::is_hidden(rectangle(1, 1, 2, 2), 0, pgl::hzm_of(size, full.data())));
  EXPECT_FALSE(pgl::is_hidden(ScreenBox{}, pgl::far_depth, pgl::hzm_of(size, full.data())));
  EXPECT_FALSE(pgl::is_hidden(rectangle(40, 1, 42, 2), pgl::far_depth, pgl::hzm_of(size, full.data())));
}

TEST(HzmOf, KnowsWhereTheLevelsAre) {
  for (const DepthMap& size : {map_of(1, 1), map_of(7, 1333), map_of(4096, 4096), map_of(65536, 3)}) {
    const pgl::Hzm hzm = pgl::hzm_of(size, nullptr);
    for (std::uint32_t l = 0; l < pgl::hzm_levels(size); ++l) EXPECT_EQ(hzm.offsets[l], pgl::hzm_level(size, l).offset);
  }
}

// ---- boxes

/// At the origin, looking along -z, 90 degrees wide and high; a picture of 64 x 64.
View camera(DepthRange range = DepthRange::minus_one_to_one, DepthOrder order = DepthOrder::conventional) {
  const float near = 0.5f, far = 100;
  View v;
  v.clip_from_world = glm::mat4(0.0f);
  v.clip_from_world[0].x = 1;
  v.clip_from_world[1].y = 1;
  v.clip_from_world[2].w = -1;
  // z / w = a + b / w, from 0 at near to 1 at far; then turned round, then stretched.
  float a = far / (far - near), b = -far * near / (far - near);
  if (order == DepthOrder::reversed) a = 1 - a, b = -b;
  if (range == DepthRange::minus_one_to_one) a = 2 * a - 1, b = 2 * b;
  v.clip_from_world[2].z = -a;
  v.clip_from_world[3].z = b;
  v.width = v.height = 64;
  v.near_depth = near;
  v.depth_range = range;
  v.depth_order = order;
  return v;
}

const View all_cameras[] = {camera(), camera(DepthRange::zero_to_one),
                            camera(DepthRange::minus_one_to_one, DepthOrder::reversed),
                            camera(DepthRange::zero_to_one, DepthOrder::reversed)};

/// The window depth of what is d before the camera.
double depth_at(double d) {
  return 100 / 99.5 * (1 - 0.5 / d);
}

TEST(NearestDepth, IsThatOfTheNearestCornerWhateverTheView) {
  for (const View& view : all_cameras) {
    Depth nearest = 0;
    const ScreenBox s = pgl::project(Box{{-1, -1, -10}, {3, 2, -4}}, view, nearest);
    EXPECT_EQ(s, pgl::project(Box{{-1, -1, -10}, {3, 2, -4}}, view));
    EXPECT_NEAR(nearest * 0x1p-32, depth_at(4), 1e-6);  // the matrix's entries are floats
    (void)pgl::project(Box{{-1, -1, -200}, {3, 2, -150}}, view, nearest);
    EXPECT_EQ(nearest, pgl::far_depth);
  }
}

TEST(NearestDepth, IsNoneWhereABoxIsNotWhollyBeforeTheNearPlane) {
  for (const View& view : all_cameras)
    for (const Box& box :
         {Box{{-1, -1, -10}, {3, 2, -0.4f}}, Box{{-1, -1, -10}, {3, 2, 0}}, Box{{-1, -1, -10}, {3, 2, 4}},
          Box{{-1, -1, 4}, {3, 2, 5}}, Box{}, Box{{-1, -1, -inf}, {3, 2, -4}}, Box{{-1, nan, -9}, {3, 2, -4}},
          Box{{100, -1, -10}, {103, 2, -4}}}) {
      Depth nearest = 1;
      (void)pgl::project(box, view, nearest);
      EXPECT_EQ(nearest, 0u);
    }
  // Behind near_depth, but not behind the near plane.
  View view = camera();
  view.near_depth = 0.01f;
  Depth nearest = 1;
  (void)pgl::project(Box{{0, 0, -10}, {1, 1, -0.4f}}, view, nearest);
  EXPECT_EQ(nearest, 0u);
}

TEST(NearestDepth, KnowsParallelProjection) {
  View view = camera(DepthRange::zero_to_one);
  view.clip_from_world = glm::mat4(1.0f);
  Depth nearest = 0;
  (void)pgl::project(Box{{-0.5f, -0.5f, 0.25f}, {0.5f, 0.5f, 0.75f}}, view, nearest);
  EXPECT_NEAR(nearest, 0x1p30, 1);
  EXPECT_LE(nearest, 1u << 30);
  view.depth_order = DepthOrder::reversed;
  (void)pgl::project(Box{{-0.5f, -0.5f, 0.25f}, {0.5f, 0.5f, 0.5f}}, view, nearest);
  EXPECT_NEAR(nearest, 0x1p31, 1);
  EXPECT_LE(nearest, 1u << 31);
}

/// A map in which everything is hidden by a wall at distance d but the left quarter of the picture.
std::vector<Depth> wall(const DepthMap& size, double d) {
  std::vector<Depth> texels(pgl::hzm_texels(size), pgl::depth_above(depth_at(d)));
  for (std::uint32_t y = 0; y < size.height; ++y)
    for (std::uint32_t x = 0; x < size.width / 4; ++x) texels[y * size.width + x] = pgl::far_depth;
  pgl::host::build_hzm(size, texels);
  return texels;
}

TEST(CullOccluded, DropsWhatIsBehindTheWallAndNothingElse) {
  struct Case {
    Box box;
    bool visible;
  };
  const Case cases[] = {
      {{{0, 0, -20}, {1, 1, -11}}, false},              // behind
      {{{-9, -2, -20}, {1, 1, -11}}, true},             // also behind the open quarter
      {{{0, 0, -20}, {1, 1, -9}}, true},                // through the wall
      {{{0, 0, -9}, {1, 1, -8}}, true},                 // before it
      {{{0, 0, -20}, {1, 1, 1}}, true},                 // around the camera's near plane
      {{{-100, -100, -100}, {100, 100, 100}}, true},    // around the camera
      {{{0, 0, -0.6f}, {0.1f, 0.1f, -0.4f}}, true},     // across the near plane
      {{{0, 0, 1}, {1, 1, 2}}, true},                   // behind the camera: left to the frustum
      {{{300, 0, -12}, {301, 1, -11}}, true},           // beside the picture: left to the frustum
      {{{0, 0, -300}, {1, 1, -200}}, false},            // beyond the far plane and behind the wall
      {{{0.5f, 0.5f, -12}, {0.5f, 0.5f, -12}}, false},  // a point
      {{{0.5f, 0.5f, -9}, {0.5f, 0.5f, -9}}, true},     //
      {{{0, 0, -12}, {5, 5, -12}}, false},              // flat
      {{{9, -100, -12}, {9, 100, -12}}, false},         // a line from end to end
      {{{-100, 0, -12}, {100, 0, -12}}, true},          // that also crosses the open quarter
      {Box{}, true},                                    // left to the frustum
      {{{0, 0, -inf}, {1, 1, -11}}, true},              //
      {{{0, nan, -12}, {1, 1, -11}}, true},             //
      {{{nan, nan, nan}, {nan, nan, nan}}, true},       //
      {{{-inf, -inf, -inf}, {inf, inf, inf}}, true},    //
  };
  std::vector<Box> boxes;
  std::vector<std::uint8_t> expected;
  for (const Case& c : cases) {
    boxes.push_back(c.box);
    expected.push_back(c.visible);
  }
  const std::vector<std::uint8_t> in_view(boxes.size(), 1);
  for (const View& view : all_cameras)
    for (const std::uint32_t scale : {1u, 2u, 3u, 4u}) {
      const DepthMap size = pgl::depth_map_of(view, scale);
      std::vector<std::uint8_t> visible(boxes.size(), 7);
      pgl::host::cull_occluded(boxes, in_view, {}, view, size, wall(size, 10), 0, visible);
      EXPECT_EQ(visible, expected) << "scale " << scale;
      for (std::size_t i = 0; i < boxes.size(); ++i)
        EXPECT_EQ(visible[i], expected[i]) << "box " << i << ", scale " << scale;
    }
}

TEST(CullOccluded, KeepsWhatIsOutOfViewOutAndOccludersIn) {
  const View view = camera();
  const DepthMap size = pgl::depth_map_of(view);
  const Box hidden{{0, 0, -20}, {1, 1, -11}}, seen{{0, 0, -9}, {1, 1, -8}};
  const std::vector<Box> boxes{hidden, seen, hidden, seen, hidden};
  std::vector<std::uint8_t> in_view{1, 1, 255, 0, 0};
  const std::vector<std::uint32_t> occluders{pgl::no_object, 2, pgl::no_object};
  std::vector<std::uint8_t> visible(boxes.size(), 7);
  pgl::host::cull_occluded(boxes, in_view, occluders, view, size, wall(size, 10), 0, visible);
  EXPECT_EQ(visible, (std::vector<std::uint8_t>{0, 1, 1, 0, 0}));
  pgl::host::cull_occluded(boxes, in_view, occluders, view, size, wall(size, 10), 0, in_view);  // in place
  EXPECT_EQ(in_view, visible);
}

TEST(CullOccluded, KeepsWhatADepthBufferMayTakeForNearer) {
  View view;  // depth is z
  view.depth_range = pgl::DepthRange::zero_to_one;
  const DepthMap size = pgl::depth_map_of(view);
  for (const auto& [z, texel, visible] :
       {std::tuple{0.5f, 0x80000000u, 1}, std::tuple{0.5f + 0x1p-22f, 0x80000000u, 1},
        std::tuple{0.5f + 0x1p-21f, 0x80000000u, 0}, std::tuple{1.0f, pgl::far_depth, 1}, std::tuple{0x1p-22f, 0u, 1},
        std::tuple{0x1p-21f, 0u, 0}}) {
    const std::vector<Box> boxes{{{-0.5f, -0.5f, z}, {0.5f, 0.5f, 1}}};
    std::vector<std::uint8_t> in_view{1};
    pgl::host::cull_occluded(boxes, in_view, {}, view, size, std::vector<Depth>{texel}, 0, in_view);
    EXPECT_EQ(in_view[0], visible) << "at " << z;
  }
}

TEST(CullOccluded, TakesNoBoxes) {
  const View view = camera();
  const DepthMap size = pgl::depth_map_of(view);
  pgl::host::cull_occluded({}, {}, {}, view, size, wall(size, 10), 0, {});
}

TEST(CullOccludedDeathTest, RefusesAMapOfAnotherView) {
  const View view = camera();
  const DepthMap size = map_of(32, 32);
  const std::vector<Depth> texels(pgl::hzm_texels(size));
  EXPECT_DEATH(pgl::host::cull_occluded({}, {}, {}, view, size, texels, 0, {}), "");
}

}  // namespace
