// SPDX-License-Identifier: MIT
#include "pgl/host/project.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace {

using pgl::Box;
using pgl::ScreenBox;
using pgl::View;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float largest = std::numeric_limits<float>::max();

/// At the origin, looking along -z, 90 degrees wide and high: window x = (x / -z + 1) * 500, y = (y / -z + 1) * 250.
View camera() {
  View v;
  v.clip_from_world = glm::mat4(0.0f);
  v.clip_from_world[0].x = 1;
  v.clip_from_world[1].y = 1;
  v.clip_from_world[3].z = 0.5f;
  v.clip_from_world[2].w = -1;
  v.width = 1000;
  v.height = 500;
  v.near_depth = 0.5f;
  return v;
}

bool is_whole(const ScreenBox& s, const View& v) {
  return s == ScreenBox{0, 0, v.width, v.height, v.near_depth} && pgl::projected_area(s) == v.width * v.height;
}

bool is_empty(const ScreenBox& s, const View& v) {
  return s.x0 > s.x1 && s.y0 > s.y1 && s.depth == v.near_depth && pgl::projected_area(s) == 0.0f;
}

/// The value, or the next float beyond it.
#define EXPECT_JUST_BELOW(a, value) \
  EXPECT_TRUE((a) == (value) || (a) == std::nextafter((value), -inf)) << (a) << " is not just below " << (value)
#define EXPECT_JUST_ABOVE(a, value) \
  EXPECT_TRUE((a) == (value) || (a) == std::nextafter((value), inf)) << (a) << " is not just above " << (value)

TEST(Project, FindsTheRectangleAndTheNearestDepth) {
  const ScreenBox s = pgl::project(Box{{-1, -1, -10}, {3, 2, -4}}, camera());
  EXPECT_JUST_BELOW(s.x0, 375.0f);  // -1 / 4
  EXPECT_JUST_ABOVE(s.x1, 875.0f);  // 3 / 4
  EXPECT_JUST_BELOW(s.y0, 187.5f);
  EXPECT_JUST_ABOVE(s.y1, 375.0f);
  EXPECT_JUST_BELOW(s.depth, 4.0f);
  EXPECT_NEAR(pgl::projected_area(s), 500.0f * 187.5f, 0.1f);
}

TEST(Project, TakesTheFarEndWhereItReachesFurther) {
  // Right of the axis the far end is nearer the centre.
  const ScreenBox s = pgl::project(Box{{1, -2, -10}, {2, -1, -4}}, camera());
  EXPECT_JUST_BELOW(s.x0, 550.0f);
  EXPECT_JUST_ABOVE(s.x1, 750.0f);
  EXPECT_JUST_BELOW(s.y0, 125.0f);
  EXPECT_JUST_ABOVE(s.y1, 225.0f);
}

TEST(Project, ClampsToTheViewport) {
  const ScreenBox s = pgl::project(Box{{-100, 0, -10}, {0, 100, -10}}, camera());
  EXPECT_EQ(s.x0, 0.0f);
  EXPECT_JUST_ABOVE(s.x1, 500.0f);
  EXPECT_JUST_BELOW(s.y0, 250.0f);
  EXPECT_EQ(s.y1, 500.0f);
}

TEST(Project, GivesAPointARectangleOfAFewUlps) {
  const ScreenBox s = pgl::project(Box{{1, 1, -8}, {1, 1, -8}}, camera());
  EXPECT_JUST_BELOW(s.x0, 562.5f);
  EXPECT_JUST_ABOVE(s.x1, 562.5f);
  EXPECT_GT(s.x1, s.x0);
  EXPECT_GT(s.y1, s.y0);
  EXPECT_JUST_BELOW(s.depth, 8.0f);
}

TEST(Project, GivesTheWholeViewportToABoxAroundTheCamera) {
  EXPECT_TRUE(is_whole(pgl::project(Box{glm::vec3(-1), glm::vec3(1)}, camera()), camera()));
  EXPECT_TRUE(is_whole(pgl::project(Box{glm::vec3(0), glm::vec3(0)}, camera()), camera()));
  EXPECT_TRUE(is_whole(pgl::project(Box{glm::vec3(-largest), glm::vec3(largest)}, camera()), camera()));
}

TEST(Project, GivesTheWholeViewportToABoxThatReachesTheNearDepth) {
  EXPECT_TRUE(is_whole(pgl::project(Box{{5, 5, -100}, {6, 6, 100}}, camera()), camera()));
  EXPECT_TRUE(is_whole(pgl::project(Box{{0, 0, -100}, {0, 0, -0.5f}}, camera()), camera()));   // touches it
  EXPECT_TRUE(is_whole(pgl::project(Box{{0, 0, -0.4f}, {0, 0, -0.3f}}, camera()), camera()));  // before it
  EXPECT_TRUE(is_whole(pgl::project(Box{{0, 0, 0}, {0, 0, 5}}, camera()), camera()));          // touches the eye
  EXPECT_FALSE(is_whole(pgl::project(Box{{0, 0, -100}, {0, 0, -0.51f}}, camera()), camera()));
}

TEST(Project, GivesNothingToABoxBehindOrBeside) {
  EXPECT_TRUE(is_empty(pgl::project(Box{{-1, -1, 1}, {1, 1, 2}}, camera()), camera()));
  EXPECT_TRUE(is_empty(pgl::project(Box{{20, 0, -10}, {30, 1, -10}}, camera()), camera()));
  EXPECT_TRUE(is_empty(pgl::project(Box{{-30, 0, -10}, {-20, 1, -10}}, camera()), camera()));
  EXPECT_TRUE(is_empty(pgl::project(Box{{0, 20, -10}, {1, 30, -10}}, camera()), camera()));
  EXPECT_TRUE(is_empty(pgl::project(Box{{0, -30, -10}, {1, -20, -10}}, camera()), camera()));
}

TEST(Project, GivesABoxThatTouchesTheViewportARectangleThere) {
  const ScreenBox s = pgl::project(Box{{10, 0, -10}, {30, 1, -10}}, camera());
  EXPECT_JUST_BELOW(s.x0, 1000.0f);
  EXPECT_EQ(s.x1, 1000.0f);
}

TEST(Project, GivesNothingToAnEmptyBox) {
  EXPECT_TRUE(is_empty(pgl::project(Box{}, camera()), camera()));
  EXPECT_TRUE(is_empty(pgl::project(Box{{-1, 1, -10}, {1, 0, -9}}, camera()), camera()));
}

TEST(Project, GivesTheWholeViewportToABoxThatIsNotFinite) {
  for (const float odd : {nan, inf, -inf})
    for (int side = 0; side < 6; ++side) {
      Box box{{-1, -1, -10}, {1, 1, -5}};
      (side < 3 ? box.min : box.max)[side % 3] = odd;
      if (box.min[side % 3] > box.max[side % 3]) continue;  // empty
      EXPECT_TRUE(is_whole(pgl::project(box, camera()), camera())) << odd << " at " << side;
    }
}

TEST(Project, ReachesTheEndsOfFloatsRange) {
  const ScreenBox far = pgl::project(Box{{-1, -1, -1e30f}, {1, 1, -1e30f}}, camera());
  EXPECT_JUST_BELOW(far.x0, 500.0f);
  EXPECT_JUST_ABOVE(far.x1, 500.0f);
  EXPECT_JUST_BELOW(far.depth, 1e30f);
  View v = camera();
  v.clip_from_world[2].w = -largest;
  v.clip_from_world[3].w = largest;
  const ScreenBox beyond = pgl::project(Box{{0, 0, -largest}, {0, 0, -largest}}, v);
  EXPECT_EQ(beyond.depth, largest);  // finite, and still a lower bound
  EXPECT_JUST_BELOW(beyond.x0, 500.0f);
  v.near_depth = std::numeric_limits<float>::denorm_min();
  v.width = v.height = largest;
  const ScreenBox wide = pgl::project(Box{{-1, -1, 5}, {1, 1, 5}}, v);
  EXPECT_TRUE(is_empty(wide, v));  // behind
  EXPECT_EQ(pgl::projected_area(pgl::project(Box{glm::vec3(-1), glm::vec3(2)}, v)), largest);
}

TEST(Project, KnowsParallelProjection) {
  View v = camera();
  v.clip_from_world = glm::mat4(1.0f);
  const ScreenBox s = pgl::project(Box{{-0.5f, 0, 100}, {0.5f, 0.25f, 200}}, v);
  EXPECT_JUST_BELOW(s.x0, 250.0f);
  EXPECT_JUST_ABOVE(s.x1, 750.0f);
  EXPECT_JUST_BELOW(s.y0, 250.0f);
  EXPECT_JUST_ABOVE(s.y1, 312.5f);
  EXPECT_JUST_BELOW(s.depth, 1.0f);
}

TEST(ProjectedArea, OfNothingIsZero) {
  EXPECT_EQ(pgl::projected_area(ScreenBox{}), 0.0f);
  EXPECT_EQ(pgl::projected_area(ScreenBox{5, 5, 5, 9, 1}), 0.0f);
  EXPECT_EQ(pgl::projected_area(ScreenBox{5, 5, 9, 5, 1}), 0.0f);
  EXPECT_EQ(pgl::projected_area(ScreenBox{5, 5, 4, 4, 1}), 0.0f);
  EXPECT_EQ(pgl::projected_area(ScreenBox{1, 2, 4, 6, 1}), 12.0f);
}

TEST(Project, TakesNoBoxes) {
  pgl::host::project({}, {}, camera(), {}, {});
}

TEST(Project, WritesEveryObjectAsTheRuleSays) {
  for (const std::size_t n : {1u, 1024u, 1025u, 50000u}) {
    std::vector<Box> boxes(n);
    std::vector<std::uint8_t> in_view(n);
    for (std::size_t i = 0; i < n; ++i) {
      const glm::vec3 p(static_cast<float>(i % 37) - 18, static_cast<float>(i % 11) - 5,
                        5 - static_cast<float>(i % 120));
      boxes[i] = {p, p + glm::vec3(1)};
      in_view[i] = i % 3 != 1;
    }
    for (const bool all : {true, false}) {
      std::vector<float> areas(n, -1.0f), depths(n, -1.0f);
      std::vector<ScreenBox> rectangles(n);
      const std::vector<std::uint8_t> which = all ? std::vector<std::uint8_t>{} : in_view;
      pgl::host::project(boxes, which, camera(), areas, depths, rectangles);
      for (std::size_t i = 0; i < n; ++i) {
        if (!all && in_view[i] == 0) {
          ASSERT_TRUE(is_empty(rectangles[i], camera())) << i;
        } else {
          ASSERT_EQ(rectangles[i], pgl::project(boxes[i], camera())) << i;
        }
        ASSERT_EQ(areas[i], pgl::projected_area(rectangles[i])) << i;
        ASSERT_EQ(depths[i], rectangles[i].depth) << i;
      }
      std::vector<float> same_areas(n), same_depths(n);
      pgl::host::project(boxes, which, camera(), same_areas, same_depths);
      EXPECT_EQ(same_areas, areas);
      EXPECT_EQ(same_depths, depths);
    }
  }
}

}  // namespace
