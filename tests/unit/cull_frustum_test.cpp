// SPDX-License-Identifier: MIT
#include "pgl/host/cull_frustum.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <vector>

namespace {

using pgl::Box;
using pgl::DepthRange;
using pgl::View;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float largest = std::numeric_limits<float>::max();
constexpr float least = std::numeric_limits<float>::denorm_min();

/// At the origin, looking along -z, 90 degrees wide and high: |x| <= -z and |y| <= -z, exactly, from 1 to 101.
View camera() {
  View v;
  v.clip_from_world = glm::mat4(0.0f);
  v.clip_from_world[0].x = 1;
  v.clip_from_world[1].y = 1;
  v.clip_from_world[2].z = -1.02f;  // (far + near) / (near - far)
  v.clip_from_world[3].z = -2.02f;
  v.clip_from_world[2].w = -1;
  return v;
}

Box cube(float x, float y, float z, float half) {
  return {{x - half, y - half, z - half}, {x + half, y + half, z + half}};
}

TEST(CullFrustum, KeepsABoxInTheMiddle) {
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, -10, 1), camera()));
}

TEST(CullFrustum, DropsABoxBeyondEachSide) {
  EXPECT_FALSE(pgl::in_frustum(cube(-20, 0, -10, 1), camera()));
  EXPECT_FALSE(pgl::in_frustum(cube(20, 0, -10, 1), camera()));
  EXPECT_FALSE(pgl::in_frustum(cube(0, -20, -10, 1), camera()));
  EXPECT_FALSE(pgl::in_frustum(cube(0, 20, -10, 1), camera()));
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, -0.5f, 0.25f), camera()));  // before the near plane
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, -200, 1), camera()));       // beyond the far plane
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, 10, 1), camera()));         // behind
}

TEST(CullFrustum, KeepsABoxLargerThanTheFrustum) {
  // None of its corners is inside, so a test of the corners drops it.
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, 0, 1e6f), camera()));
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, 0, largest), camera()));
  EXPECT_TRUE(pgl::in_frustum(Box{{-1e6f, -1e6f, -10}, {1e6f, 1e6f, -10}}, camera()));  // a wall across the view
  EXPECT_TRUE(pgl::in_frustum(Box{{-1e6f, 0, -10}, {1e6f, 0, -10}}, camera()));         // a wire across the view
}

TEST(CullFrustum, KeepsABoxThatTouchesASide) {
  EXPECT_TRUE(pgl::in_frustum(Box{{10, 0, -10}, {10, 0, -10}}, camera()));
  EXPECT_TRUE(pgl::in_frustum(Box{{-12, -1, -10}, {-10, 1, -10}}, camera()));
  EXPECT_TRUE(pgl::in_frustum(Box{{10, 10, -10}, {20, 20, -10}}, camera()));  // at an edge
  EXPECT_TRUE(pgl::in_frustum(Box{{-11, 10, -10}, {-10, 20, -10}}, camera()));
}

TEST(CullFrustum, DropsABoxOneFloatBeyondASide) {
  const float beyond = std::nextafter(10.0f, 11.0f);
  EXPECT_FALSE(pgl::in_frustum(Box{{beyond, 0, -10}, {beyond, 0, -10}}, camera()));
  EXPECT_FALSE(pgl::in_frustum(Box{{-20, 0, -10}, {-beyond, 0, -10}}, camera()));
  EXPECT_FALSE(pgl::in_frustum(Box{{0, beyond, -10}, {0, 20, -10}}, camera()));
}

TEST(CullFrustum, KeepsTheBoxThatTheCameraIsIn) {
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, 0, 2), camera()));
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, 0, 0.5f), camera()));  // wholly before the near plane
}

TEST(CullFrustum, KnowsBothDepthRanges) {
  View v = camera();
  v.clip_from_world = glm::mat4(1.0f);  // inside: |x|, |y| <= 1
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, -0.5f, 0.25f), v));
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, -1.5f, 0.25f), v));
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, 1.5f, 0.25f), v));
  v.depth_range = DepthRange::zero_to_one;
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, -0.5f, 0.25f), v));
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, 0.5f, 0.25f), v));
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, -0.25f, 0.25f), v));  // touches 0
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, 1.5f, 0.25f), v));
}

TEST(CullFrustum, WorksWithReversedDepthAndNoFarPlane) {
  View v = camera();
  v.depth_range = DepthRange::zero_to_one;
  v.clip_from_world[2].z = 0;
  v.clip_from_world[3].z = 0.1f;  // clip z is the near distance, w the depth
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, -10, 1), v));
  EXPECT_TRUE(pgl::in_frustum(Box{{0, 0, -1e30f}, {0, 0, -1e30f}}, v));
  EXPECT_TRUE(pgl::in_frustum(Box{{0, 0, -largest}, {0, 0, -largest}}, v));
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, -0.05f, 0.01f), v));
  EXPECT_FALSE(pgl::in_frustum(cube(0, 0, 10, 1), v));
  EXPECT_FALSE(pgl::in_frustum(Box{{1e30f, 0, -1e29f}, {1e30f, 0, -1e29f}}, v));
}

TEST(CullFrustum, DropsAnEmptyBox) {
  EXPECT_FALSE(pgl::in_frustum(Box{}, camera()));
  EXPECT_FALSE(pgl::in_frustum(Box{{-1, -1, -9}, {1, 1, -10}}, camera()));
  EXPECT_FALSE(pgl::in_frustum(Box{{-1, 1, -10}, {1, -1, -9}}, camera()));
  EXPECT_FALSE(pgl::in_frustum(Box{{1, -1, -10}, {-1, 1, -9}}, camera()));
}

TEST(CullFrustum, KeepsABoxWithANan) {
  for (int side = 0; side < 6; ++side) {
    Box box = cube(1000, 1000, 1000, 1);
    (side < 3 ? box.min : box.max)[side % 3] = nan;
    EXPECT_TRUE(pgl::in_frustum(box, camera())) << side;
  }
  EXPECT_TRUE(pgl::in_frustum(Box{glm::vec3(nan), glm::vec3(nan)}, camera()));
}

TEST(CullFrustum, KeepsAnInfiniteBoxUnlessItsFiniteSidesPutItOutside) {
  EXPECT_TRUE(pgl::in_frustum(Box{glm::vec3(-inf), glm::vec3(inf)}, camera()));
  EXPECT_TRUE(pgl::in_frustum(Box{{-inf, 0, -10}, {inf, 0, -10}}, camera()));
  EXPECT_TRUE(pgl::in_frustum(Box{{0, 0, -inf}, {0, 0, -5}}, camera()));
  EXPECT_FALSE(pgl::in_frustum(Box{{-inf, -inf, 1}, {inf, inf, 2}}, camera()));  // behind; 0 * inf along x and y
  EXPECT_FALSE(pgl::in_frustum(Box{{20, -inf, -10}, {30, inf, -9}}, camera()));  // beside
  EXPECT_FALSE(pgl::in_frustum(Box{{20, -1, -10}, {inf, 1, -9}}, camera()));
  EXPECT_FALSE(pgl::in_frustum(Box{{-inf, -1, -10}, {-20, 1, -9}}, camera()));
}

TEST(CullFrustum, KeepsEverythingUnderTheZeroMatrix) {
  View v = camera();
  v.clip_from_world = glm::mat4(0.0f);  // 0 <= 0 everywhere
  EXPECT_TRUE(pgl::in_frustum(cube(7, 8, 9, 1), v));
  v.clip_from_world[3].w = -1;
  EXPECT_FALSE(pgl::in_frustum(cube(7, 8, 9, 1), v));
}

TEST(CullFrustum, ReachesTheEndsOfFloatsRange) {
  View v = camera();
  v.clip_from_world = glm::mat4(least);  // |x| <= 1 still
  EXPECT_TRUE(pgl::in_frustum(cube(0, 0, 0, least), v));
  EXPECT_FALSE(pgl::in_frustum(Box{{2, 0, 0}, {2, 0, 0}}, v));
  v.clip_from_world = glm::mat4(largest);
  EXPECT_TRUE(pgl::in_frustum(Box{{1, -1, 1}, {largest, 0, largest}}, v));
  EXPECT_FALSE(pgl::in_frustum(Box{{-largest, 0, 0}, {-2, 0, 0}}, v));
  for (int column = 0; column < 4; ++column) v.clip_from_world[column] = glm::vec4(largest);
  EXPECT_TRUE(pgl::in_frustum(Box{glm::vec3(largest), glm::vec3(largest)}, v));
  EXPECT_FALSE(pgl::in_frustum(Box{glm::vec3(-largest), glm::vec3(-largest)}, v));
}

TEST(CullFrustum, KeepsAPointThatPlainDoublesLose) {
  // w = x + y - z - 0.5 = 0.5 at p; the sum from the left in double gives -0.5.
  View v = camera();
  v.clip_from_world = glm::mat4(0.0f);
  v.clip_from_world[0].w = v.clip_from_world[1].w = 1;
  v.clip_from_world[2].w = -1;
  v.clip_from_world[3].w = -0.5f;
  const glm::vec3 p(0x1p80f, 1, 0x1p80f);
  EXPECT_TRUE(pgl::in_frustum(Box{p, p}, v));
  // The same in a coefficient: w + x = (1 + 2^-60) x - y - 2^-61, lost when 1 + 2^-60 is rounded.
  v.clip_from_world[0] = glm::vec4(0x1p-60f, 0, 0, 1);
  v.clip_from_world[1] = glm::vec4(0, 0, 0, -1);
  v.clip_from_world[2] = glm::vec4(0, 0, 0, 1);
  v.clip_from_world[3] = glm::vec4(-0x1p-61f, 0, 0, 0);
  EXPECT_TRUE(pgl::in_frustum(Box{{1, 1, 0x1p-50f}, {1, 1, 0x1p-50f}}, v));
  EXPECT_TRUE(pgl::in_frustum(Box{{1, 1, 0x1p-61f}, {1, 1, 0x1p-61f}}, v));
}

TEST(CullFrustum, TakesNoBoxes) {
  pgl::host::cull_frustum({}, camera(), {});
}

TEST(CullFrustum, MarksEachBoxAsTheRuleSays) {
  for (const std::size_t n : {1u, 4096u, 4097u, 100000u}) {
    std::vector<Box> boxes(n);
    for (std::size_t i = 0; i < n; ++i)
      boxes[i] = cube(static_cast<float>(i % 37) - 18, static_cast<float>(i % 11) - 5, -static_cast<float>(i % 120), 1);
    std::vector<std::uint8_t> in_view(n, 9);
    pgl::host::cull_frustum(boxes, camera(), in_view);
    for (std::size_t i = 0; i < n; ++i) ASSERT_EQ(in_view[i], pgl::in_frustum(boxes[i], camera()) ? 1 : 0) << i;
  }
}

}  // namespace
