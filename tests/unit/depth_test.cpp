// SPDX-License-Identifier: MIT
#include "pgl/depth.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>

namespace {

using pgl::Coverage;
using pgl::Depth;
using pgl::depth_above;
using pgl::depth_below;
using pgl::depth_map_of;
using pgl::DepthMap;
using pgl::far_depth;

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double step = 0x1p-32;

TEST(Depth, OfAWholeNumberOfStepsIsThatNumber) {
  for (const Depth d : {1u, 2u, 0x7fffffffu, 0x80000000u, 0xfffffffeu}) {
    EXPECT_EQ(depth_above(d * step), d);
    EXPECT_EQ(depth_below(d * step), d);
  }
  EXPECT_EQ(depth_above(0.0), 0u);
  EXPECT_EQ(depth_below(0.0), 0u);
  EXPECT_EQ(depth_above(-0.0), 0u);
  EXPECT_EQ(depth_below(-0.0), 0u);
  EXPECT_EQ(depth_above(0.5), 0x80000000u);
}

TEST(Depth, BetweenStepsIsTheOneThatIsNotNearerOrNotFarther) {
  for (const Depth d : {0u, 1u, 1000u, 0x7fffffffu, 0x80000000u, 0xfffffffdu}) {
    for (const double between :
         {std::nextafter(d * step, 1.0), (d + 0.5) * step, std::nextafter((d + 1) * step, 0.0)}) {
      EXPECT_EQ(depth_above(between), d + 1) << between;
      EXPECT_EQ(depth_below(between), d) << between;
    }
  }
}

TEST(Depth, OfTheFarPlaneAndBeyondIsTheFarthest) {
  for (const double far : {1.0, std::nextafter(1.0, 2.0), 7.0, 1e300, inf}) {
    EXPECT_EQ(depth_above(far), far_depth);
    EXPECT_EQ(depth_below(far), far_depth);
  }
  EXPECT_EQ(depth_above(far_depth * step), far_depth);
  EXPECT_EQ(depth_below(far_depth * step), far_depth);
  EXPECT_EQ(depth_above(std::nextafter(1.0, 0.0)), far_depth);
  EXPECT_EQ(depth_below(std::nextafter(1.0, 0.0)), far_depth);
}

TEST(Depth, BeforeTheNearPlaneIsTheNearest) {
  for (const double near : {-0x1p-1074, -1.0, -1e300, -inf}) {
    EXPECT_EQ(depth_above(near), 0u);
    EXPECT_EQ(depth_below(near), 0u);
  }
}

TEST(Depth, OfSubnormalsIsOneStepAboveAndNoneBelow) {
  for (const double tiny : {0x1p-1074, 0x1p-1023, 0x1p-1000}) {
    EXPECT_EQ(depth_below(tiny), 0u);
    EXPECT_EQ(depth_above(tiny), 1u);
  }
}

TEST(Depth, OfNanHidesNothingAndIsNeverHidden) {
  EXPECT_EQ(depth_above(nan), far_depth);
  EXPECT_EQ(depth_below(nan), 0u);
}

TEST(Depth, NeverDecreases) {
  double last = -0.25;
  for (int i = 0; i < 100000; ++i) {
    const double next = last + 0x1p-16 * (i % 7 == 0 ? 1.0 : 0x1p-17);
    EXPECT_LE(depth_above(last), depth_above(next));
    EXPECT_LE(depth_below(last), depth_below(next));
    EXPECT_LE(depth_below(next), depth_above(next));
    EXPECT_LE(depth_above(next) - depth_below(next), 1u);
    last = next;
  }
  EXPECT_LT(last, 0.25);
}

pgl::View view_of(float width, float height) {
  pgl::View v;
  v.width = width;
  v.height = height;
  return v;
}

TEST(DepthMapOf, HoldsEveryPixelAtEveryScale) {
  EXPECT_EQ(depth_map_of(view_of(1920, 1080)), (DepthMap{1920, 1080, 1, Coverage::centres}));
  EXPECT_EQ(depth_map_of(view_of(1920, 1080), 2, Coverage::whole), (DepthMap{960, 540, 2, Coverage::whole}));
  EXPECT_EQ(depth_map_of(view_of(1921, 1081), 4), (DepthMap{481, 271, 4, Coverage::centres}));
  EXPECT_EQ(depth_map_of(view_of(1, 1), 8), (DepthMap{1, 1, 8, Coverage::centres}));
  EXPECT_EQ(depth_map_of(view_of(65536, 7)), (DepthMap{65536, 7, 1, Coverage::centres}));
  for (std::uint32_t pixels = 1; pixels < 40; ++pixels)
    for (std::uint32_t scale = 1; scale < 12; ++scale) {
      const DepthMap map = depth_map_of(view_of(static_cast<float>(pixels), 1), scale);
      EXPECT_GE(map.width * scale, pixels);
      EXPECT_LT((map.width - 1) * scale, pixels);
      EXPECT_EQ(map.height, 1u);
    }
}

TEST(DepthMapOfDeathTest, RefusesPicturesThatHaveNoPixelsOrTooMany) {
  EXPECT_DEATH(depth_map_of(view_of(0.5f, 10)), "");
  EXPECT_DEATH(depth_map_of(view_of(10.5f, 10)), "");
  EXPECT_DEATH(depth_map_of(view_of(10, 65537)), "");
  EXPECT_DEATH(depth_map_of(view_of(10, 10), 0), "");
}

}  // namespace
