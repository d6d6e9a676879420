// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "pgl/gather.hpp"
#include "pgl/host/bounds.hpp"
#include "support/exact.hpp"
#include "support/numbers.hpp"

namespace {

using numbers::any_affine;
using numbers::any_number;
using numbers::Kind;
using pgl::Box;

bool same_bytes(const Box& a, const Box& b) {
  return std::memcmp(&a, &b, sizeof(Box)) == 0;
}

std::vector<glm::vec3> any_positions() {
  const Kind k = numbers::kind();
  std::vector<glm::vec3> positions(static_cast<std::size_t>(numbers::whole(0, 40)));
  for (glm::vec3& p : positions)
    for (int axis = 0; axis < 3; ++axis) p[axis] = any_number(k);
  return positions;
}

RC_GTEST_PROP(BoundsProps, holdEveryFinitePositionAndTouchOneOnEachSide, ()) {
  const std::vector<glm::vec3> positions = any_positions();
  const Box box = pgl::host::bounds(positions);
  std::vector<float> c[3];
  for (const glm::vec3& p : positions)
    if (std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z))
      for (int axis = 0; axis < 3; ++axis) c[axis].push_back(p[axis]);
  RC_ASSERT(pgl::is_empty(box) == c[0].empty());
  for (int axis = 0; axis < 3 && !c[axis].empty(); ++axis) {
    RC_ASSERT(box.min[axis] == *std::min_element(c[axis].begin(), c[axis].end()));
    RC_ASSERT(box.max[axis] == *std::max_element(c[axis].begin(), c[axis].end()));
  }
}

RC_GTEST_PROP(BoundsProps, doNotDependOnTheOrderOfPositions, ()) {
  std::vector<glm::vec3> positions = any_positions();
  const Box box = pgl::host::bounds(positions);
  for (std::size_t i = positions.size(); i > 1; --i)
    std::swap(positions[i - 1], positions[static_cast<std::size_t>(numbers::whole(0, static_cast<int>(i) - 1))]);
  RC_ASSERT(same_bytes(pgl::host::bounds(positions), box));
}

RC_GTEST_PROP(BoundsProps, mergeIsCommutativeAndAssociative, ()) {
  Box b[3];
  for (Box& box : b) {
    const Kind k = numbers::kind();
    for (int axis = 0; axis < 3; ++axis) {
      box.min[axis] = any_number(k);
      box.max[axis] = any_number(k);
      if (numbers::whole(0, 5) > 0 && box.min[axis] > box.max[axis]) std::swap(box.min[axis], box.max[axis]);
    }
  }
  RC_ASSERT(same_bytes(pgl::merge(b[0], b[1]), pgl::merge(b[1], b[0])));
  RC_ASSERT(same_bytes(pgl::merge(pgl::merge(b[0], b[1]), b[2]), pgl::merge(b[0], pgl::merge(b[1], b[2]))));
}

TEST(BoundsProps, DoNotDependOnTheNumberOfThreads) {
  std::vector<glm::vec3> positions(300001);
  std::uint32_t random = 1;
  for (glm::vec3& p : positions)
    for (int axis = 0; axis < 3; ++axis) {
      random = random * 1664525u + 1013904223u;
      p[axis] = static_cast<float>(static_cast<std::int32_t>(random) >> 8);
    }
  const std::vector<pgl::Object> objects(20000);
  const std::vector<Box> meshes{Box{{-1, -2, -3}, {1, 2, 3}}};
  [[maybe_unused]] const Box box = pgl::host::bounds(positions);
  std::vector<Box> placed(objects.size());
  pgl::host::object_bounds(objects, meshes, placed);
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 3, 7}) {
    omp_set_num_threads(n);
    EXPECT_TRUE(same_bytes(pgl::host::bounds(positions), box)) << n;
    std::vector<Box> again(objects.size());
    pgl::host::object_bounds(objects, meshes, again);
    EXPECT_EQ(std::memcmp(again.data(), placed.data(), placed.size() * sizeof(Box)), 0) << n;
  }
  omp_set_num_threads(threads);
#endif
}

/// A vertex as gathering places it: plain doubles, each step rounded, in this order. (Exact products: no contraction
/// can change them.)
float gathered(const glm::mat4x3& m, int row, const glm::vec3& p) {
  const double x = static_cast<double>(m[0][row]) * static_cast<double>(p.x);
  const double y = static_cast<double>(m[1][row]) * static_cast<double>(p.y);
  const double z = static_cast<double>(m[2][row]) * static_cast<double>(p.z);
  return static_cast<float>(((x + y) + z) + static_cast<double>(m[3][row]));
}

RC_GTEST_PROP(BoundsProps, transformHoldsEveryPointExactlyAndAsGathered, ()) {
  const glm::mat4x3 m = any_affine();
  const Box box = numbers::box(numbers::kind());
  const Box world = pgl::transform(box, m);
  for (int trial = 0; trial < 12; ++trial) {
    glm::vec3 p = numbers::point_in(box);
    if (trial < 8)
      p = {trial & 1 ? box.max.x : box.min.x, trial & 2 ? box.max.y : box.min.y, trial & 4 ? box.max.z : box.min.z};
    for (int row = 0; row < 3; ++row) {
      for (const float vertex : {gathered(m, row, p), pgl::transform_point(m, p)[row]}) {
        RC_ASSERT(world.min[row] <= vertex);
        RC_ASSERT(vertex <= world.max[row]);
      }
      const exact::Number image = exact::row_times(m, row, exact::point(p));
      if (std::isfinite(world.min[row])) RC_ASSERT(exact::Number(world.min[row]) <= image);
      if (std::isfinite(world.max[row])) RC_ASSERT(image <= exact::Number(world.max[row]));
    }
  }
}

/// The greatest float that is at most the value, by bisection over the floats' order; -infinity if there is none.
float float_at_most(const exact::Number& value) {
  const auto nth = [](std::int64_t i) {  // the i-th float from 0, downwards if negative
    const auto bits = static_cast<std::uint32_t>(i < 0 ? -i : i);
    float f;
    std::memcpy(&f, &bits, sizeof f);
    return i < 0 ? -f : f;
  };
  std::int64_t low = -0x7f800000ll, high = 0x7f800000ll;  // -infinity is below, infinity above
  while (high - low > 1) {
    const std::int64_t middle = low + (high - low) / 2;
    (exact::Number(nth(middle)) <= value ? low : high) = middle;
  }
  return nth(low);
}

RC_GTEST_PROP(BoundsProps, transformIsTightToAFloatAndTheSumsRounding, ()) {
  const glm::mat4x3 m = any_affine();
  const Box box = numbers::box(numbers::kind());
  const Box world = pgl::transform(box, m);
  for (int row = 0; row < 3; ++row) {
    exact::Number least, most, terms = abs(exact::Number(m[3][row]));
    for (int corner = 0; corner < 8; ++corner) {
      const glm::vec3 p(corner & 1 ? box.max.x : box.min.x, corner & 2 ? box.max.y : box.min.y,
                        corner & 4 ? box.max.z : box.min.z);
      const exact::Number image = exact::row_times(m, row, exact::point(p));
      least = corner == 0 || image < least ? image : least;
      most = corner == 0 || image > most ? image : most;
    }
    for (int column = 0; column < 3; ++column)
      terms += abs(exact::Number(m[column][row])) *
               std::max(abs(exact::Number(box.min[column])), abs(exact::Number(box.max[column])));
    const exact::Number rounding = terms * exact::Number(0x1p-50);
    RC_ASSERT(world.min[row] >= float_at_most(least - rounding));
    RC_ASSERT(world.max[row] <= -float_at_most(-most - rounding));
  }
}

RC_GTEST_PROP(BoundsProps, transformOfSmallIntegersIsExact, ()) {
  glm::mat4x3 m;
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 3; ++row) m[column][row] = numbers::number(Kind::small);
  const Box box = numbers::box(Kind::small);
  Box expected;
  for (int corner = 0; corner < 8; ++corner)
    for (int row = 0; row < 3; ++row) {
      const float v = m[0][row] * (corner & 1 ? box.max.x : box.min.x) +
                      m[1][row] * (corner & 2 ? box.max.y : box.min.y) +
                      m[2][row] * (corner & 4 ? box.max.z : box.min.z) + m[3][row];
      expected.min[row] = std::min(expected.min[row], v);
      expected.max[row] = std::max(expected.max[row], v);
    }
  RC_ASSERT(pgl::transform(box, m) == expected);
}

}  // namespace
