// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "pgl/host/project.hpp"
#include "support/exact.hpp"
#include "support/numbers.hpp"

namespace {

using exact::Number;
using numbers::Kind;
using pgl::Box;
using pgl::ScreenBox;
using pgl::View;

Number window_x(const View& v, const exact::Point& p) {
  return (exact::row_times(v.clip_from_world, 0, p) / exact::row_times(v.clip_from_world, 3, p) + 1) * Number(v.width) /
         2;
}
Number window_y(const View& v, const exact::Point& p) {
  return (exact::row_times(v.clip_from_world, 1, p) / exact::row_times(v.clip_from_world, 3, p) + 1) *
         Number(v.height) / 2;
}

glm::vec3 corner_of(const Box& box, int i) {
  return {i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z};
}

bool is_whole(const ScreenBox& s, const View& v) {
  return s == ScreenBox{0, 0, v.width, v.height, v.near_depth};
}

RC_GTEST_PROP(ProjectProps, rectangleAndDepthHoldEveryPointOfTheBox, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    const Kind k = numbers::kind();
    const View view = numbers::view(k);
    const Box box = numbers::box_near(view, k);
    const ScreenBox s = pgl::project(box, view);
    RC_ASSERT(s.depth >= view.near_depth);
    RC_ASSERT(std::isfinite(s.depth));
    const bool empty = s.x0 > s.x1;
    RC_ASSERT(empty == (s.y0 > s.y1));
    if (empty) {
      RC_ASSERT(s.depth == view.near_depth);
    } else {
      RC_ASSERT(0 <= s.x0 && s.x1 <= view.width);
      RC_ASSERT(0 <= s.y0 && s.y1 <= view.height);
    }
    const float area = pgl::projected_area(s);
    RC_ASSERT(0 <= area && area <= view.width * view.height);
    for (int i = 0; i < 12; ++i) {
      const exact::Point p = exact::point(i < 8 ? corner_of(box, i) : numbers::point_in(box));
      const Number w = exact::row_times(view.clip_from_world, 3, p);
      if (w < Number(view.near_depth)) continue;
      RC_ASSERT(Number(s.depth) <= w);
      const Number x = window_x(view, p), y = window_y(view, p);
      if (x < 0 || x > Number(view.width) || y < 0 || y > Number(view.height)) continue;  // off the viewport
      RC_ASSERT(!empty);
      RC_ASSERT(Number(s.x0) <= x && x <= Number(s.x1));
      RC_ASSERT(Number(s.y0) <= y && y <= Number(s.y1));
    }
  }
}

/// The greatest float at most v, given that |v| is in float's range: from the nearest double, which may be off by one.
float float_at_most(const Number& v) {
  float f = static_cast<float>(v.get_d());
  while (Number(f) > v) f = std::nextafter(f, -std::numeric_limits<float>::infinity());
  return f;
}
float float_at_least(const Number& v) {
  return -float_at_most(-v);
}

/// The sum of the sizes of a row's terms, each coordinate at the end where it is larger.
Number terms(const View& view, int row, const Box& box) {
  Number sum = abs(Number(view.clip_from_world[3][row]));
  for (int axis = 0; axis < 3; ++axis)
    sum +=
        abs(Number(view.clip_from_world[axis][row])) * std::max(abs(Number(box.min[axis])), abs(Number(box.max[axis])));
  return sum;
}

RC_GTEST_PROP(ProjectProps, rectangleAndDepthAreTightToAFloatAndTheSumsRounding, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    const Kind k = numbers::kind();
    const View view = numbers::view(k);
    const Box box = numbers::box_near(view, k);
    const ScreenBox s = pgl::project(box, view);
    Number nearest, farthest;
    for (int i = 0; i < 8; ++i) {
      const Number w = exact::row_times(view.clip_from_world, 3, exact::point(corner_of(box, i)));
      nearest = i == 0 || w < nearest ? w : nearest;
      farthest = i == 0 || w > farthest ? w : farthest;
    }
    const Number w_error = terms(view, 3, box) * Number(0x1p-47);
    if (farthest < -w_error) RC_ASSERT(s.x0 > s.x1);
    if (farthest >= 0 && nearest <= Number(view.near_depth)) RC_ASSERT(is_whole(s, view));
    if (nearest - w_error <= Number(view.near_depth)) continue;

    // Wholly before the camera.
    const Number bounded = std::min(Number(nearest - w_error), Number(std::numeric_limits<float>::max()));
    Number x0, y0, x1, y1, size = 1;
    for (int i = 0; i < 8; ++i) {
      const exact::Point p = exact::point(corner_of(box, i));
      const Number x = window_x(view, p), y = window_y(view, p);
      x0 = i == 0 || x < x0 ? x : x0;
      x1 = i == 0 || x > x1 ? x : x1;
      y0 = i == 0 || y < y0 ? y : y0;
      y1 = i == 0 || y > y1 ? y : y1;
    }
    const auto error = [&](int row, const Number& low, const Number& high, float full) {
      const Number q = std::max(Number(abs(low * 2 / Number(full) - 1)), Number(abs(high * 2 / Number(full) - 1)));
      return Number(((q * terms(view, 3, box) + terms(view, row, box)) / (nearest - w_error) * Number(0x1p-47) +
                     (q + 1) * Number(0x1p-48)) *
                    Number(full) / 2);
    };
    const Number ex = error(0, x0, x1, view.width), ey = error(1, y0, y1, view.height);
    const Number width(view.width), height(view.height), none(0);
    if (x1 < -ex || x0 > width + ex || y1 < -ey || y0 > height + ey) {
      RC_ASSERT(s.x0 > s.x1);
      RC_ASSERT(s.depth == view.near_depth);
      continue;
    }
    if (s.x0 > s.x1) continue;  // so close beside the viewport that either answer is right
    RC_ASSERT(s.depth >= float_at_most(bounded));
    RC_ASSERT(s.x0 >= float_at_most(std::max(none, std::min(width, Number(x0 - ex)))));
    RC_ASSERT(s.y0 >= float_at_most(std::max(none, std::min(height, Number(y0 - ey)))));
    RC_ASSERT(s.x1 <= float_at_least(std::max(none, std::min(width, Number(x1 + ex)))));
    RC_ASSERT(s.y1 <= float_at_least(std::max(none, std::min(height, Number(y1 + ey)))));
  }
}

RC_GTEST_PROP(ProjectProps, givesTheWholeViewportToABoxThatIsNotFinite, ()) {
  const Kind k = numbers::kind();
  const View view = numbers::view(k);
  Box box = numbers::box_near(view, k);
  constexpr float odd[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()};
  const int side = numbers::whole(0, 5);
  const float value = odd[numbers::whole(0, 1)];
  if (side < 3)
    box.min[side] = -value;
  else
    box.max[side - 3] = value;
  RC_ASSERT(is_whole(pgl::project(box, view), view));
}

TEST(ProjectProps, DoesNotDependOnTheNumberOfThreads) {
  std::vector<Box> boxes(30011);
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const glm::vec3 p(static_cast<float>(i % 101), static_cast<float>(i % 53), static_cast<float>(i % 211));
    boxes[i] = {p * 0.013f, p * 0.013f + glm::vec3(0.1f)};
  }
  View view;
  view.clip_from_world[2].w = 0.3f;
  view.width = 640;
  view.height = 480;
  std::vector<float> areas(boxes.size()), depths(boxes.size());
  pgl::host::project(boxes, {}, view, areas, depths);
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 5}) {
    omp_set_num_threads(n);
    std::vector<float> again_areas(boxes.size()), again_depths(boxes.size());
    pgl::host::project(boxes, {}, view, again_areas, again_depths);
    EXPECT_EQ(again_areas, areas);
    EXPECT_EQ(again_depths, depths);
  }
  omp_set_num_threads(threads);
#endif
}

}  // namespace
