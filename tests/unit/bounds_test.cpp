// SPDX-License-Identifier: MIT
#include "pgl/host/bounds.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

namespace {

using pgl::Box;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float largest = std::numeric_limits<float>::max();
constexpr float least = std::numeric_limits<float>::denorm_min();

bool same_bytes(const Box& a, const Box& b) {
  return std::memcmp(&a, &b, sizeof(Box)) == 0;
}

bool is_unknown(const Box& b) {
  return std::isnan(b.min.x) && std::isnan(b.min.y) && std::isnan(b.min.z) &&  //
         std::isnan(b.max.x) && std::isnan(b.max.y) && std::isnan(b.max.z);
}

Box bounds_of(std::vector<glm::vec3> positions) {
  return pgl::host::bounds(positions);
}

TEST(Bounds, OfNothingIsTheEmptyBox) {
  EXPECT_TRUE(same_bytes(bounds_of({}), Box{}));
  EXPECT_TRUE(pgl::is_empty(Box{}));
}

TEST(Bounds, OfOnePointIsThatPoint) {
  const glm::vec3 p(1, -2, least);
  EXPECT_EQ(bounds_of({p}), (Box{p, p}));
  EXPECT_FALSE(pgl::is_empty(Box{p, p}));
}

TEST(Bounds, OfEqualPointsIsThatPoint) {
  const glm::vec3 p(1e30f, -1e-30f, 7);
  EXPECT_EQ(bounds_of(std::vector<glm::vec3>(100000, p)), (Box{p, p}));
}

TEST(Bounds, ReachTheExtremeCoordinatesOfFloat) {
  EXPECT_EQ(bounds_of({{largest, least, 0}, {-largest, -least, 0}}), (Box{{-largest, -least, 0}, {largest, least, 0}}));
}

TEST(Bounds, IgnorePositionsThatAreNotFinite) {
  EXPECT_EQ(bounds_of({{nan, 9, 9}, {1, 2, 3}, {9, inf, 9}, {9, 9, -inf}}), (Box{{1, 2, 3}, {1, 2, 3}}));
  EXPECT_TRUE(same_bytes(bounds_of({{nan, 0, 0}, {0, inf, 0}}), Box{}));
}

TEST(Bounds, StoreEveryZeroAsPositive) {
  const Box plus{{0, 0, 0}, {0, 0, 0}};
  EXPECT_TRUE(same_bytes(bounds_of({{-0.0f, -0.0f, -0.0f}}), plus));
  EXPECT_TRUE(same_bytes(bounds_of({{-0.0f, 0, -0.0f}, {0, -0.0f, 0}}), plus));
  EXPECT_TRUE(same_bytes(pgl::merge(Box{{-0.0f, 0, 0}, {0, -0.0f, 0}}, plus), plus));
}

TEST(Bounds, FindAnExtremeAnywhereInALongArray) {
  for (const std::size_t n : {16383u, 16384u, 16385u, 50001u, 1500000u}) {
    std::vector<glm::vec3> positions(n, glm::vec3(0));
    for (const std::size_t at : {std::size_t{0}, n / 3, n - 1}) {
      positions[at] = {-5, 6, 7};
      EXPECT_EQ(pgl::host::bounds(positions), (Box{{-5, 0, 0}, {0, 6, 7}})) << n << " at " << at;
      positions[at] = {0, 0, 0};
    }
  }
}

TEST(Bounds, CallABoxEmptyIfOneAxisIsReversed) {
  EXPECT_TRUE(pgl::is_empty(Box{{0, 0, 1}, {1, 1, 0}}));
  EXPECT_TRUE(pgl::is_empty(Box{{0, 1, 0}, {1, 0, 1}}));
  EXPECT_TRUE(pgl::is_empty(Box{{1, 0, 0}, {0, 1, 1}}));
  EXPECT_FALSE(pgl::is_empty(Box{{0, 0, 0}, {0, 0, 0}}));
  EXPECT_FALSE(pgl::is_empty(Box{{-inf, -inf, -inf}, {inf, inf, inf}}));
}

TEST(Bounds, CallABoxWithANanNotEmpty) {
  EXPECT_FALSE(pgl::is_empty(Box{{nan, 0, 0}, {1, 1, 1}}));
  EXPECT_FALSE(pgl::is_empty(Box{{nan, 0, 2}, {1, 1, 1}}));
}

TEST(Bounds, MergeAddsNothingFromAnEmptyBox) {
  const Box box{{1, 2, 3}, {4, 5, 6}}, reversed{{9, 9, 9}, {9, 9, 8}};
  EXPECT_EQ(pgl::merge(box, Box{}), box);
  EXPECT_EQ(pgl::merge(Box{}, box), box);
  EXPECT_EQ(pgl::merge(box, reversed), box);
  EXPECT_EQ(pgl::merge(reversed, box), box);
  EXPECT_TRUE(same_bytes(pgl::merge(Box{}, reversed), Box{}));
}

TEST(Bounds, MergeWithANanIsUnknown) {
  const Box box{{1, 2, 3}, {4, 5, 6}}, unknown{{1, nan, 3}, {4, 5, 6}};
  EXPECT_TRUE(is_unknown(pgl::merge(box, unknown)));
  EXPECT_TRUE(is_unknown(pgl::merge(unknown, box)));
  EXPECT_TRUE(is_unknown(pgl::merge(Box{}, unknown)));
}

TEST(Bounds, TransformByTheIdentityChangesNothing) {
  for (const Box& box : {Box{{1, 2, 3}, {4, 5, 6}}, Box{{-largest, least, 0}, {largest, 0.1f, 0}},
                         Box{{-inf, 0, -inf}, {inf, 0, 1}}, Box{}})
    EXPECT_EQ(pgl::transform(box, glm::mat4x3(1.0f)), box);
}

TEST(Bounds, TransformIsExactWhereTheSumsAre) {
  glm::mat4x3 m(0.0f);
  m[0] = {0, 2, 0};   // x to y, doubled
  m[1] = {-1, 0, 0};  // y to -x
  m[2] = {0, 0, 0.5f};
  m[3] = {10, 20, 30};
  EXPECT_EQ(pgl::transform(Box{{1, 2, 4}, {3, 5, 8}}, m), (Box{{5, 22, 32}, {8, 26, 34}}));
}

TEST(Bounds, TransformMirrors) {
  glm::mat4x3 m(1.0f);
  m[0].x = -1;
  EXPECT_EQ(pgl::transform(Box{{1, 2, 3}, {4, 5, 6}}, m), (Box{{-4, 2, 3}, {-1, 5, 6}}));
}

TEST(Bounds, TransformRoundsOutwards) {
  glm::mat4x3 m(1.0f);
  m[3].x = 1e-20f;
  const Box up = pgl::transform(Box{{1, 0, 0}, {1, 0, 0}}, m);
  EXPECT_EQ(up.min.x, 1.0f);
  EXPECT_EQ(up.max.x, std::nextafter(1.0f, 2.0f));
  m[3].x = -1e-20f;
  const Box down = pgl::transform(Box{{1, 0, 0}, {1, 0, 0}}, m);
  EXPECT_EQ(down.min.x, std::nextafter(1.0f, 0.0f));
  EXPECT_EQ(down.max.x, 1.0f);
}

TEST(Bounds, TransformBeyondTheRangeOfFloatIsInfinite) {
  glm::mat4x3 m(1.0f);
  m[0].x = 4;
  EXPECT_EQ(pgl::transform(Box{{-largest, 0, 0}, {largest, 0, 0}}, m), (Box{{-inf, 0, 0}, {inf, 0, 0}}));
  EXPECT_EQ(pgl::transform(Box{{largest, 0, 0}, {largest, 0, 0}}, m), (Box{{largest, 0, 0}, {inf, 0, 0}}));
}

TEST(Bounds, TransformOfAnEmptyBoxIsEmpty) {
  glm::mat4x3 m(0.0f);
  m[3] = {1, 2, 3};
  EXPECT_TRUE(same_bytes(pgl::transform(Box{}, m), Box{}));
  EXPECT_TRUE(same_bytes(pgl::transform(Box{{0, 0, 1}, {1, 1, 0}}, m), Box{}));
}

TEST(Bounds, TransformByZeroIsTheOrigin) {
  glm::mat4x3 m(0.0f);
  m[3] = {1, 2, 3};
  EXPECT_EQ(pgl::transform(Box{{-inf, -1, -1}, {inf, 1, 1}}, m), (Box{{1, 2, 3}, {1, 2, 3}}));
}

TEST(Bounds, TransformWithANanIsUnknown) {
  for (const float x : {1.0f, 0.0f, -1.0f}) {
    glm::mat4x3 m(1.0f);
    m[0].x = x;
    EXPECT_TRUE(is_unknown(pgl::transform(Box{{nan, 0, 0}, {1, 1, 1}}, m)));
    EXPECT_TRUE(is_unknown(pgl::transform(Box{{0, 0, 0}, {nan, 1, 1}}, m)));
  }
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 3; ++row) {
      glm::mat4x3 m(1.0f);
      m[column][row] = nan;
      EXPECT_TRUE(is_unknown(pgl::transform(Box{{-1, -1, -1}, {1, 1, 1}}, m)));
      EXPECT_TRUE(same_bytes(pgl::transform(Box{}, m), Box{}));
    }
}

TEST(ObjectBounds, PlaceEachMeshesBox) {
  const std::vector<Box> meshes{Box{{0, 0, 0}, {1, 1, 1}}, Box{}, Box{{-1, 0, 0}, {0, 0, 2}}};
  std::vector<pgl::Object> objects(4);
  objects[0].mesh = 2;
  objects[1].mesh = 0;
  objects[1].transform[3] = {10, 0, 0};
  objects[2].mesh = 1;
  objects[3].mesh = 0;
  objects[3].transform[2].z = -3;
  std::vector<Box> boxes(4);
  pgl::host::object_bounds(objects, meshes, boxes);
  EXPECT_EQ(boxes[0], meshes[2]);
  EXPECT_EQ(boxes[1], (Box{{10, 0, 0}, {11, 1, 1}}));
  EXPECT_TRUE(same_bytes(boxes[2], Box{}));
  EXPECT_EQ(boxes[3], (Box{{0, 0, -3}, {1, 1, 0}}));
}

TEST(ObjectBounds, OfNoObjectsWriteNothing) {
  pgl::host::object_bounds({}, {}, {});
}

TEST(FloatAbove, IsTheLeastFloatThatIsNotLess) {
  std::vector<double> numbers{0.0,    1e-50, 0x1p-150, 0x1p-149, 0x1.8p-149, 0x1p-126,
                              1e-300, 0.1,   1.0,      3.5e38,   1e300,      inf};
  for (const float f : {least, 1e-39f, 0x1p-126f, 0.1f, 1.0f, 1.5f, 0x1.fffffep0f, 2.0f, 1e30f, largest})
    for (const double part : {-0.75, -0.5, -0x1p-28, 0.0, 0x1p-28, 0.5, 0.75})
      numbers.push_back(f + part * (static_cast<double>(f) - static_cast<double>(std::nextafter(f, 0.0f))));
  for (const double size : numbers)
    for (const double a : {size, -size}) {
      const float above = pgl::detail::float_above(a), below = pgl::detail::float_below(a);
      EXPECT_GE(above, a);
      EXPECT_LE(below, a);
      if (above != -inf) {
        EXPECT_TRUE(std::nextafter(above, -inf) < a) << a;
      }
      if (below != inf) {
        EXPECT_TRUE(std::nextafter(below, inf) > a) << a;
      }
    }
  EXPECT_TRUE(std::isnan(pgl::detail::float_above(std::numeric_limits<double>::quiet_NaN())));
}

TEST(ObjectBounds, ReachEveryObject) {
  const std::vector<Box> meshes{Box{{0, 0, 0}, {1, 1, 1}}};
  std::vector<pgl::Object> objects(100003);
  for (std::size_t i = 0; i < objects.size(); ++i) objects[i].transform[3].x = static_cast<float>(i);
  std::vector<Box> boxes(objects.size());
  pgl::host::object_bounds(objects, meshes, boxes);
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const float x = static_cast<float>(i);
    ASSERT_EQ(boxes[i], (Box{{x, 0, 0}, {x + 1, 1, 1}}));
  }
}

}  // namespace
