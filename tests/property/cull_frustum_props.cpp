// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <random>
#include <vector>

#include "pgl/host/cull_frustum.hpp"
#include "support/exact.hpp"
#include "support/numbers.hpp"

namespace {

using numbers::Kind;
using pgl::Box;
using pgl::View;

/// Changes rows of the matrix, by signs and powers of two, until the point is inside; zeroes a row if nothing else
/// helps.
void make_inside(View& view, const glm::vec3& point) {
  const exact::Point p = exact::point(point);
  glm::mat4& m = view.clip_from_world;
  const auto scale_row = [&](int row, float by) {
    for (int column = 0; column < 4; ++column) m[column][row] *= by;
  };
  if (exact::row_times(m, 3, p) < 0) scale_row(3, -1);
  const exact::Number w = exact::row_times(m, 3, p);
  if (view.depth_range == pgl::DepthRange::zero_to_one && exact::row_times(m, 2, p) < 0) scale_row(2, -1);
  for (int row = 0; row < 3; ++row)
    for (int tries = 0; abs(exact::row_times(m, row, p)) > w ||
                        (row == 2 && view.depth_range == pgl::DepthRange::zero_to_one && exact::row_times(m, 2, p) < 0);
         ++tries)
      scale_row(row, tries < 30 ? 0x1p-4f : 0.0f);
}

RC_GTEST_PROP(CullFrustumProps, keepsEveryBoxAroundAPointInside, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    const Kind k = numbers::kind();
    View view = numbers::view(k);
    const glm::vec3 p = numbers::point_near(view, k);
    make_inside(view, p);
    RC_ASSERT(exact::is_inside(view, exact::point(p)));
    RC_ASSERT(pgl::in_frustum(numbers::box_around(p, k), view));
    RC_ASSERT(pgl::in_frustum(Box{p, p}, view));
  }
}

RC_GTEST_PROP(CullFrustumProps, keepsEveryBoxAroundAPointExactlyOnASide, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    View view = numbers::view(Kind::small);
    glm::mat4& m = view.clip_from_world;
    for (int column = 0; column < 4; ++column)
      for (int row = 0; row < 4; ++row) m[column][row] = numbers::number(Kind::small);
    const glm::vec3 p = numbers::point(Kind::small);
    // Small integers: every sum is exact. Some coordinate becomes w, -w, or 0 at p.
    m[3].w += static_cast<float>(numbers::whole(0, 200));
    make_inside(view, p);
    const auto at_p = [&](int row) { return m[0][row] * p.x + m[1][row] * p.y + m[2][row] * p.z + m[3][row]; };
    const int row = numbers::whole(0, 2);
    const bool low = numbers::whole(0, 1) == 0;
    const bool zero = low && row == 2 && view.depth_range == pgl::DepthRange::zero_to_one;
    for (int column = 0; column < 4; ++column) m[column][row] = numbers::number(Kind::small);
    m[3][row] += (zero ? 0 : low ? -at_p(3) : at_p(3)) - at_p(row);
    RC_ASSERT(exact::is_inside(view, exact::point(p)));
    RC_ASSERT(exact::row_times(m, row, exact::point(p)) == exact::Number(zero ? 0 : low ? -at_p(3) : at_p(3)));
    RC_ASSERT(pgl::in_frustum(numbers::box_around(p, Kind::small), view));
    // Scaled by a power of two it is exact still.
    const float scale = std::ldexp(1.0f, numbers::whole(-120, 110));
    for (int column = 0; column < 4; ++column) m[column] *= scale;
    RC_ASSERT(exact::is_inside(view, exact::point(p)));
    RC_ASSERT(pgl::in_frustum(Box{p, p}, view));
  }
}

RC_GTEST_PROP(CullFrustumProps, dropsOnlyBoxesWithoutAPointInside, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    const Kind k = numbers::kind();
    const View view = numbers::view(k);
    const Box box = numbers::box_near(view, k);
    if (!pgl::in_frustum(box, view)) RC_ASSERT(!exact::intersects(box, view));
  }
}

/// Whether the box is outside by more than rounding in double can hide.
bool is_clearly_outside(const exact::HalfSpace& h, const Box& box) {
  exact::Number terms = abs(h[3]);
  for (int axis = 0; axis < 3; ++axis)
    terms += abs(h[static_cast<std::size_t>(axis)]) *
             std::max(abs(exact::Number(box.min[axis])), abs(exact::Number(box.max[axis])));
  return exact::largest(h, box) < -terms * exact::Number(0x1p-49);
}

RC_GTEST_PROP(CullFrustumProps, dropsEveryBoxClearlyOutsideAHalfSpace, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    const Kind k = numbers::kind();
    const View view = numbers::view(k);
    const Box box = numbers::box_near(view, k);
    bool clearly = false, outside = false;
    for (const exact::HalfSpace& h : exact::half_spaces(view)) {
      outside |= exact::largest(h, box) < 0;
      clearly |= is_clearly_outside(h, box);
    }
    if (clearly) RC_ASSERT(!pgl::in_frustum(box, view));
    if (!outside) RC_ASSERT(pgl::in_frustum(box, view));
  }
}

/// A view and a point at which the largest terms of w cancel exactly, so that what is left, by 20 to 70 binary orders
/// smaller, decides: plain double arithmetic is often wrong about it.
View cancelling_view(glm::vec3& p) {
  View view;
  view.depth_range = numbers::whole(0, 1) ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
  const float small = std::ldexp(1.0f, -numbers::whole(20, 70));
  glm::mat4& m = view.clip_from_world;
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 4; ++row) m[column][row] = small * numbers::number(Kind::plain) * (row < 3 ? 0.25f : 1.0f);
  p = numbers::point(Kind::plain);
  const int i = numbers::whole(0, 2), j = (i + numbers::whole(1, 2)) % 3;
  p[j] = p[i];
  m[i].w = numbers::number(Kind::plain);
  m[j].w = -m[i].w;
  return view;
}

RC_GTEST_PROP(CullFrustumProps, keepsAPointInsideWhereTheLargestTermsCancel, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    glm::vec3 p;
    const View view = cancelling_view(p);
    if (exact::is_inside(view, exact::point(p))) RC_ASSERT(pgl::in_frustum(Box{p, p}, view));
  }
}

RC_GTEST_PROP(CullFrustumProps, dropsAPointClearlyOutsideWhereTheLargestTermsCancel, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    glm::vec3 p;
    const View view = cancelling_view(p);
    bool clearly = false;
    for (const exact::HalfSpace& h : exact::half_spaces(view)) clearly |= is_clearly_outside(h, Box{p, p});
    if (clearly) RC_ASSERT(!pgl::in_frustum(Box{p, p}, view));
  }
}

RC_GTEST_PROP(CullFrustumProps, isTheSixHalfSpaceTestExactlyOnSmallIntegers, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    View view;
    view.depth_range = numbers::whole(0, 1) ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
    for (int column = 0; column < 4; ++column)
      for (int row = 0; row < 4; ++row) view.clip_from_world[column][row] = numbers::number(Kind::small);
    view.clip_from_world[3].w += static_cast<float>(numbers::whole(0, 60));
    const Box box = numbers::box(Kind::small);
    bool outside = false;
    for (const exact::HalfSpace& h : exact::half_spaces(view)) outside |= exact::largest(h, box) < 0;
    RC_ASSERT(pgl::in_frustum(box, view) == !outside);
  }
}

RC_GTEST_PROP(CullFrustumProps, keepsEveryBoxWithANan, ()) {
  const Kind k = numbers::kind();
  const View view = numbers::view(k);
  Box box = numbers::box_near(view, k);
  const int side = numbers::whole(0, 5);
  (side < 3 ? box.min : box.max)[side % 3] = std::numeric_limits<float>::quiet_NaN();
  RC_ASSERT(pgl::in_frustum(box, view));
}

RC_GTEST_PROP(CullFrustumProps, keepsWhatAnInfiniteBoxHolds, ()) {
  const Kind k = numbers::kind();
  View view = numbers::view(k);
  const glm::vec3 p = numbers::point_near(view, k);
  make_inside(view, p);
  Box box = numbers::box_around(p, k);
  for (int axis = 0; axis < 3; ++axis) {
    if (numbers::whole(0, 1)) box.min[axis] = -std::numeric_limits<float>::infinity();
    if (numbers::whole(0, 1)) box.max[axis] = std::numeric_limits<float>::infinity();
  }
  RC_ASSERT(pgl::in_frustum(box, view));
}

TEST(CullFrustumProps, FewBoxesOfASceneAreKeptThoughOutside) {
  // Boxes of 1 to 50 units all over a site of 1000, from its middle: the share that only an exact test would drop.
  std::mt19937 random(1);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * (static_cast<float>(random() >> 8) * 0x1p-24f);
  };
  View view;
  view.clip_from_world = glm::perspective(1.0f, 16.0f / 9, 0.1f, 2000.0f) *
                         glm::lookAt(glm::vec3(30, 30, 20), glm::vec3(-100, 20, 55), glm::vec3(0, 1, 0));
  int outside = 0, kept = 0;
  for (int i = 0; i < 4000; ++i) {
    const glm::vec3 centre(uniform(-500, 500), uniform(0, 60), uniform(-500, 500));
    const glm::vec3 half(uniform(1, 25), uniform(1, 25), uniform(1, 25));
    const Box box{centre - half, centre + half};
    if (exact::intersects(box, view)) {
      ASSERT_TRUE(pgl::in_frustum(box, view));
      continue;
    }
    ++outside;
    kept += pgl::in_frustum(box, view);
  }
  RecordProperty("outside", outside);
  RecordProperty("kept", kept);
  EXPECT_GT(outside, 2000);
  EXPECT_LE(kept * 200, outside);
}

TEST(CullFrustumProps, DoesNotDependOnTheNumberOfThreads) {
  std::mt19937 random(2);
  std::vector<Box> boxes(30011);
  for (Box& box : boxes) {
    const glm::vec3 p(static_cast<float>(random() % 100), static_cast<float>(random() % 100),
                      static_cast<float>(random() % 100));
    box = {p, p + glm::vec3(1)};
  }
  View view;
  view.clip_from_world =
      glm::perspective(1.0f, 1.0f, 0.1f, 200.0f) * glm::lookAt(glm::vec3(50), glm::vec3(0), glm::vec3(0, 1, 0));
  std::vector<std::uint8_t> expected(boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) expected[i] = pgl::in_frustum(boxes[i], view) ? 1 : 0;
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 5, threads}) {
    omp_set_num_threads(n);
#endif
    std::vector<std::uint8_t> in_view(boxes.size(), 7);
    pgl::host::cull_frustum(boxes, view, in_view);
    EXPECT_EQ(in_view, expected);
#if defined(_OPENMP)
  }
  omp_set_num_threads(threads);
#endif
}

}  // namespace
