// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "pgl/cull_frustum.hpp"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "support/depth_maps.hpp"
#include "support/exact.hpp"
#include "support/numbers.hpp"

namespace {

using exact::Number;
using numbers::Kind;
using numbers::whole;
using pgl::Box;
using pgl::Depth;
using pgl::DepthMap;
using pgl::ScreenBox;
using pgl::View;
using test::Depths;

// ---- rectangles against texels

/// A map with its levels.
struct BuiltMap {
  DepthMap size;
  std::vector<Depth> texels;
  pgl::Hzm hzm() const { return pgl::hzm_of(size, texels.data()); }
};

BuiltMap random_map() {
  BuiltMap map;
  map.size = test::map_of(static_cast<std::uint32_t>(whole(1, 90)), static_cast<std::uint32_t>(whole(1, 90)),
                          static_cast<std::uint32_t>(whole(1, 5)));
  map.texels =
      test::texels_of(map.size, static_cast<Depths>(whole(0, 3)), static_cast<std::uint32_t>(whole(0, 1 << 30)));
  pgl::host::build_hzm(map.size, map.texels);
  return map;
}

/// An end of a rectangle along a side of the picture: on a pixel's edge, within, beside.
float place(std::uint32_t pixels) {
  const float at = static_cast<float>(whole(-4, static_cast<int>(pixels) + 4));
  switch (whole(0, 4)) {
    case 0:
      return at;
    case 1:
      return std::nextafter(at, -1e9f);
    case 2:
      return std::nextafter(at, 1e9f);
    default:
      return at + static_cast<float>(whole(0, 255)) / 256;
  }
}

ScreenBox random_rectangle(const DepthMap& size) {
  ScreenBox r;
  const std::uint32_t w = size.width * size.scale, h = size.height * size.scale;
  r.x0 = place(w);
  r.y0 = place(h);
  const bool small = whole(0, 1) != 0;
  r.x1 = small ? r.x0 + static_cast<float>(whole(0, 2048)) / 256 : place(w);
  r.y1 = small ? r.y0 + static_cast<float>(whole(0, 2048)) / 256 : place(h);
  return r;
}

/// Whether the texel has a pixel that the rectangle touches when grown by a pixel on each side, by the definition and
/// without rounding.
bool touches(const ScreenBox& r, const DepthMap& size, std::uint32_t x, std::uint32_t y) {
  const double s = size.scale;
  const auto along = [s](double a, double b, double t) { return a <= b && a < (t + 1) * s + 1 && b >= t * s - 1; };
  return along(r.x0, r.x1, x) && along(r.y0, r.y1, y);
}

RC_GTEST_PROP(CullOccludedProps, coveredTexelsAreThoseThatTheGrownRectangleTouches, ()) {
  for (int repeat = 0; repeat < 20; ++repeat) {
    const DepthMap size =
        test::map_of(static_cast<std::uint32_t>(whole(1, 60)), static_cast<std::uint32_t>(whole(1, 60)),
                     static_cast<std::uint32_t>(whole(1, 5)));
    const ScreenBox r = random_rectangle(size);
    pgl::TexelRange range;
    const bool any = pgl::covered_texels(r, size, range);
    for (std::uint32_t y = 0; y < size.height; ++y)
      for (std::uint32_t x = 0; x < size.width; ++x) {
        const bool in = any && x >= range.x0 && x <= range.x1 && y >= range.y0 && y <= range.y1;
        RC_ASSERT(in == touches(r, size, x, y));
      }
  }
}

/// A map that counts who reads it is not to be had; but all that the test can read is the texels of one level that hold
/// those of the range.
RC_GTEST_PROP(CullOccludedProps, testReadsTheLeastLevelOfTwoByTwoTexels, ()) {
  const auto x0 = static_cast<std::uint32_t>(whole(0, 65535)), y0 = static_cast<std::uint32_t>(whole(0, 65535));
  const auto reach = [](std::uint32_t from) {
    const int most = std::min(65535, static_cast<int>(from) + (1 << whole(0, 16)));
    return static_cast<std::uint32_t>(whole(static_cast<int>(from), most));
  };
  const pgl::TexelRange range{x0, y0, reach(x0), reach(y0)};
  const std::uint32_t level = pgl::covering_level(range);
  const auto is_covered = [&](std::uint32_t l) {
    return (range.x1 >> l) - (range.x0 >> l) <= 1 && (range.y1 >> l) - (range.y0 >> l) <= 1;
  };
  RC_ASSERT(is_covered(level));
  if (level > 0) {
    RC_ASSERT(!is_covered(level - 1));
  }
  RC_ASSERT(level < pgl::hzm_levels(test::map_of(range.x1 + 1, range.y1 + 1)));
}

TEST(CullOccludedProps, FinerTestsAreExactAtTheirLevel) {
  int cases = 0, with_more = 0;
  EXPECT_TRUE(rc::check([&] {
    int more = 0;
    for (int repeat = 0; repeat < 20; ++repeat) {
      const BuiltMap map = random_map();
      const ScreenBox r = random_rectangle(map.size);
      pgl::TexelRange range;
      if (!pgl::covered_texels(r, map.size, range)) continue;
      const std::uint32_t coarse = pgl::covering_level(range);
      for (std::uint32_t refinement = 0; refinement <= 17; ++refinement) {
        const std::uint32_t level = coarse > refinement ? coarse - refinement : 0;
        Depth farthest = 0;
        std::uint32_t texels = 0;  // of level 0 that lie below the level's texels which hold the range
        for (std::uint32_t y = range.y0 >> level << level; y < map.size.height && y >> level <= range.y1 >> level; ++y)
          for (std::uint32_t x = range.x0 >> level << level; x < map.size.width && x >> level <= range.x1 >> level;
               ++x) {
            farthest = std::max(farthest, map.texels[std::size_t{y} * map.size.width + x]);
            ++texels;
          }
        RC_ASSERT(texels > 0);
        for (const Depth nearest : {farthest, farthest < pgl::far_depth ? farthest + 1 : farthest, Depth{0}}) {
          const bool answer = pgl::is_hidden(r, nearest, map.hzm(), refinement);
          RC_ASSERT(answer == (farthest < nearest));
          if (answer && !pgl::is_hidden(r, nearest, map.hzm())) ++more;
        }
      }
    }
    ++cases;
    with_more += more > 0;
  }));
  EXPECT_GE(with_more, cases / 2);  // found more than 2 x 2 texels do
}

TEST(CullOccludedProps, RectangleIsHiddenIffTheTexelsThatCoverItAreNearer) {
  int cases = 0, hidden = 0, seen = 0;
  EXPECT_TRUE(rc::check([&] {
    ++cases;
    for (int repeat = 0; repeat < 20; ++repeat) {
      const BuiltMap map = random_map();
      const ScreenBox r = random_rectangle(map.size);
      // All of level 0 that the rectangle touches, and all that shares a texel of the test's level with it.
      std::optional<Depth> touched, covering;
      pgl::TexelRange range;
      const bool any = pgl::covered_texels(r, map.size, range);
      const std::uint32_t level = any ? pgl::covering_level(range) : 0;
      for (std::uint32_t y = 0; y < map.size.height; ++y)
        for (std::uint32_t x = 0; x < map.size.width; ++x) {
          const Depth d = map.texels[std::size_t{y} * map.size.width + x];
          if (touches(r, map.size, x, y)) touched = std::max(touched.value_or(0), d);
          if (any && x >> level >= range.x0 >> level && x >> level <= range.x1 >> level &&
              y >> level >= range.y0 >> level && y >> level <= range.y1 >> level)
            covering = std::max(covering.value_or(0), d);
        }
      RC_ASSERT(touched.has_value() == any);
      std::vector<Depth> tries{0u, 1u, pgl::far_depth, static_cast<Depth>(whole(0, 1 << 30)) * 4};
      if (any)
        for (const Depth d : {*touched, *covering}) {
          tries.push_back(d);
          if (d > 0) tries.push_back(d - 1);
          if (d < pgl::far_depth) tries.push_back(d + 1);
        }
      for (const Depth nearest : tries) {
        const bool answer = pgl::is_hidden(r, nearest, map.hzm());
        if (answer) {
          RC_ASSERT(any);
          RC_ASSERT(*touched < nearest);  // certain
          ++hidden;
        } else {
          ++seen;
        }
        RC_ASSERT(answer == (any && *covering < nearest));  // and no more cautious than the 2 x 2 texels make it
        if (any && level == 0) {
          RC_ASSERT(answer == (*touched < nearest));
        }
      }
    }
  }));
  EXPECT_GE(hidden, cases * 5);
  EXPECT_GE(seen, cases * 5);
}

// ---- boxes

/// The window depth of a point before the camera, from 0 at the near end to 1 at the far one.
Number window_depth(const View& view, const exact::Point& p) {
  Number d = exact::row_times(view.clip_from_world, 2, p) / exact::row_times(view.clip_from_world, 3, p);
  if (view.depth_range == pgl::DepthRange::minus_one_to_one) d = (d + 1) / 2;
  return view.depth_order == pgl::DepthOrder::reversed ? Number(1 - d) : d;
}

View random_view(Kind k) {
  View view = numbers::view(k);
  view.depth_order = whole(0, 1) ? pgl::DepthOrder::reversed : pgl::DepthOrder::conventional;
  return view;
}

glm::vec3 corner_of(const Box& box, int i) {
  return {i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z};
}

RC_GTEST_PROP(CullOccludedProps, nearestDepthIsNotFartherThanAnyPointOfTheBox, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    const Kind k = numbers::kind();
    const View view = random_view(k);
    Box box = numbers::box_near(view, k);
    if (whole(0, 19) == 0) box.min[whole(0, 2)] = numbers::any_number(k);
    Depth nearest = 1;
    const ScreenBox s = pgl::project(box, view, nearest);
    const ScreenBox same = pgl::project(box, view);
    RC_ASSERT(s == same);
    if (!std::isfinite(box.min.x) || !std::isfinite(box.min.y) || !std::isfinite(box.min.z) || pgl::is_empty(box)) {
      RC_ASSERT(nearest == 0);
      continue;
    }
    for (int i = 0; i < 12; ++i) {
      const exact::Point p = exact::point(i < 8 ? corner_of(box, i) : numbers::point_in(box));
      const Number w = exact::row_times(view.clip_from_world, 3, p);
      if (w <= Number(view.near_depth)) {
        RC_ASSERT(nearest == 0);  // behind, or too near
        continue;
      }
      RC_ASSERT(Number(nearest) <= std::max(Number(0), window_depth(view, p)) * Number(0x1p32));
    }
  }
}

/// The sum of the sizes of a row's terms, each coordinate at the end where it is larger.
Number terms(const View& view, int row, const Box& box) {
  Number sum = abs(Number(view.clip_from_world[3][row]));
  for (int axis = 0; axis < 3; ++axis)
    sum +=
        abs(Number(view.clip_from_world[axis][row])) * std::max(abs(Number(box.min[axis])), abs(Number(box.max[axis])));
  return sum;
}

TEST(CullOccludedProps, NearestDepthIsTightToAStepAndTheSumsRounding) {
  int cases = 0, tight = 0;
  EXPECT_TRUE(rc::check([&] {
    ++cases;
    for (int repeat = 0; repeat < 100; ++repeat) {
      const Kind k = numbers::kind();
      const View view = random_view(k);
      const Box box = numbers::box_near(view, k);
      Depth nearest = 0;
      const ScreenBox s = pgl::project(box, view, nearest);
      if (s.x0 > s.x1 || pgl::is_empty(box)) continue;
      Number least_w, least_d, size = 1;
      for (int i = 0; i < 8; ++i) {
        const exact::Point p = exact::point(corner_of(box, i));
        const Number w = exact::row_times(view.clip_from_world, 3, p);
        least_w = i == 0 || w < least_w ? w : least_w;
      }
      const Number w_error = terms(view, 3, box) * Number(0x1p-47);
      if (least_w - w_error <= Number(view.near_depth)) continue;
      for (int i = 0; i < 8; ++i) {
        const Number d = window_depth(view, exact::point(corner_of(box, i)));
        least_d = i == 0 || d < least_d ? d : least_d;
        size = std::max(size, Number(abs(d) * 2 + 1));
      }
      const Number error = (size * terms(view, 3, box) + terms(view, 2, box)) / (least_w - w_error) * Number(0x1p-47) +
                           (size + 1) * Number(0x1p-48);
      const Number expected = std::min(Number(1), Number(least_d - error)) * Number(0x1p32) - 1;
      RC_ASSERT(Number(nearest) >= expected);
      tight += nearest > 0 && nearest < pgl::far_depth;
    }
  }));
  EXPECT_GE(tight, cases * 5);  // boxes between near and far
}

/// What is behind the camera, crosses its near plane, is empty or not finite stays, whatever is in the map.
TEST(CullOccludedProps, BoxesThatAreNotWhollyBeforeTheNearPlaneStay) {
  int cases = 0, hidden_boxes = 0;
  EXPECT_TRUE(rc::check([&] {
    ++cases;
    const Kind k = numbers::kind();
    View view = random_view(k);
    view.width = static_cast<float>(whole(1, 30));
    view.height = static_cast<float>(whole(1, 30));
    const DepthMap size = pgl::depth_map_of(view);
    const std::vector<Depth> nothing_passes(pgl::hzm_texels(size), 0);
    const pgl::Hzm hzm = pgl::hzm_of(size, nothing_passes.data());
    for (int repeat = 0; repeat < 50; ++repeat) {
      Box box = numbers::box_near(view, k);
      if (whole(0, 4) == 0) box.min[whole(0, 2)] = numbers::any_number(k);
      if (whole(0, 4) == 0) box.max[whole(0, 2)] = numbers::any_number(k);
      const bool hidden = pgl::is_hidden(box, view, hzm);
      if (!hidden) continue;
      ++hidden_boxes;
      for (int axis = 0; axis < 3; ++axis) RC_ASSERT(std::isfinite(box.min[axis]) && std::isfinite(box.max[axis]));
      RC_ASSERT(!pgl::is_empty(box));
      for (int i = 0; i < 8; ++i) {
        const exact::Point p = exact::point(corner_of(box, i));
        RC_ASSERT(exact::row_times(view.clip_from_world, 3, p) > Number(view.near_depth));
        RC_ASSERT(window_depth(view, p) > 0);
      }
    }
  }));
  EXPECT_GE(hidden_boxes, cases);  // the others are
}

/// A picture in which each pixel hides what is farther than its depth: no box with a point that shows may be dropped.
TEST(CullOccludedProps, NoBoxIsHiddenThatHasAPointNearerThanTheTexelsThere) {
  int cases = 0, hidden_boxes = 0;
  EXPECT_TRUE(rc::check([&] {
    ++cases;
    for (int repeat = 0; repeat < 60; ++repeat) {
      const Kind k = numbers::kind();
      View view = random_view(k);
      view.width = static_cast<float>(whole(1, 60));
      view.height = static_cast<float>(whole(1, 60));
      BuiltMap map;
      map.size = pgl::depth_map_of(view, static_cast<std::uint32_t>(whole(1, 4)));
      map.texels =
          test::texels_of(map.size, static_cast<Depths>(whole(0, 3)), static_cast<std::uint32_t>(whole(0, 1 << 30)));
      const Depth wall = static_cast<Depth>(whole(0, 1 << 30)) << whole(0, 2);
      for (Depth& d : map.texels)
        if (whole(0, 3)) d = std::min(d, wall);
      pgl::host::build_hzm(map.size, map.texels);
      const Box box = numbers::box_near(view, k);
      if (!pgl::is_hidden(box, view, map.hzm())) continue;
      ++hidden_boxes;
      for (int i = 0; i < 20; ++i) {
        const exact::Point p = exact::point(i < 8 ? corner_of(box, i) : numbers::point_in(box));
        const Number w = exact::row_times(view.clip_from_world, 3, p);
        RC_ASSERT(w > 0);
        const Number x = (exact::row_times(view.clip_from_world, 0, p) / w + 1) * Number(view.width) / 2;
        const Number y = (exact::row_times(view.clip_from_world, 1, p) / w + 1) * Number(view.height) / 2;
        if (x < 0 || x >= Number(view.width) || y < 0 || y >= Number(view.height)) continue;
        const auto i_x = static_cast<std::size_t>(x.get_d()) / map.size.scale;
        const auto i_y = static_cast<std::size_t>(y.get_d()) / map.size.scale;
        const Number d = window_depth(view, p);
        RC_ASSERT(d > Number(map.texels[i_y * map.size.width + i_x]) * Number(0x1p-32));
      }
    }
  }));
  EXPECT_GE(hidden_boxes, cases);
}

TEST(CullOccludedProps, DoesNotDependOnTheNumberOfThreads) {
  std::vector<Box> boxes(30011);
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const glm::vec3 p(static_cast<float>(i % 101), static_cast<float>(i % 53), static_cast<float>(i % 211));
    boxes[i] = {p * 0.013f, p * 0.013f + glm::vec3(0.002f)};
  }
  View view;
  view.clip_from_world[2].w = 0.3f;
  view.width = 640;
  view.height = 480;
  BuiltMap map{pgl::depth_map_of(view), {}};
  map.texels = test::texels_of(map.size, Depths::holed_wall, 1);
  pgl::host::build_hzm(map.size, map.texels);
  std::vector<std::uint8_t> in_view(boxes.size()), visible(boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) in_view[i] = i % 5 != 0;
  const std::vector<std::uint32_t> occluders{1, 7, pgl::no_object};
  pgl::host::cull_occluded(boxes, in_view, occluders, view, map.size, map.texels, 0, visible);
  const auto seen = std::count(visible.begin(), visible.end(), 1);
  EXPECT_GT(seen, 100);
  EXPECT_LT(seen, 20000);
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 5}) {
    omp_set_num_threads(n);
    std::vector<std::uint8_t> again = in_view;
    pgl::host::cull_occluded(boxes, again, occluders, view, map.size, map.texels, 0, again);
    EXPECT_EQ(again, visible);
  }
  omp_set_num_threads(threads);
#endif
}

}  // namespace
