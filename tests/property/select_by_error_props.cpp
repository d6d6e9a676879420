// SPDX-License-Identifier: MIT
// What must hold of a selection by error whatever the input, in exact arithmetic.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "pgl/host/select_by_error.hpp"
#include "support/error_scenes.hpp"
#include "support/exact.hpp"
#include "support/numbers.hpp"

namespace {

using exact::Number;
using numbers::Kind;
using test::error_scene;
using test::ErrorScene;
using Counts = std::vector<std::uint32_t>;

constexpr float infinite = std::numeric_limits<float>::infinity();

struct Result {
  Counts counts;
  pgl::BudgetTotals totals;
  friend bool operator==(const Result&, const Result&) = default;
};

Result select(const ErrorScene& s) {
  Result result{Counts(s.size(), 4242), {}};
  result.totals = pgl::host::select_by_error(s.areas, s.depths, s.min_vertices, s.max_vertices, s.scales,
                                             s.mesh_of_object, s.meshes, s.errors, s.view, s.options, result.counts);
  return result;
}

// ---- how much a transform enlarges

Number square(const Number& x) {
  return x * x;
}
Number length_square(const exact::Point& p) {
  return square(p[0]) + square(p[1]) + square(p[2]);
}

RC_GTEST_PROP(ErrorScaleProps, nothingGrowsByMore, ()) {
  for (int repeat = 0; repeat < 50; ++repeat) {
    const glm::mat4x3 m = numbers::any_affine();
    const float scale = pgl::error_scale(m);
    RC_ASSERT(scale >= 0.0f);
    if (scale == infinite) continue;  // see isCloseToTheLargestSingularValue
    for (int i = 0; i < 8; ++i) {
      const exact::Point d = exact::point(i < 3 ? glm::vec3(i == 0, i == 1, i == 2) : numbers::point(Kind::plain));
      exact::Point moved;
      for (int row = 0; row < 3; ++row)
        moved[row] = Number(m[0][row]) * d[0] + Number(m[1][row]) * d[1] + Number(m[2][row]) * d[2];
      RC_ASSERT(length_square(moved) <= square(Number(scale)) * length_square(d));
    }
  }
}

/// By repeated squaring of the Gram matrix, whose entries are divided by the greatest each time.
long double largest_singular_value(const glm::mat4x3& m) {
  long double gram[3][3] = {};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) gram[i][j] += static_cast<long double>(m[i][k]) * m[j][k];
  long double log2_norm = 0, power = 1;
  for (int step = 0; step < 30; ++step, power *= 2) {
    long double most = 0;
    for (const auto& row : gram)
      for (const long double x : row) most = std::max(most, std::fabs(x));
    if (most == 0) return 0;
    log2_norm += std::log2(most) / power;
    long double next[3][3] = {};
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k) next[i][j] += gram[i][k] / most * (gram[k][j] / most);
    std::copy(&next[0][0], &next[0][0] + 9, &gram[0][0]);
  }
  return std::exp2(log2_norm / 2);
}

RC_GTEST_PROP(ErrorScaleProps, isCloseToTheLargestSingularValue, ()) {
  for (int repeat = 0; repeat < 50; ++repeat) {
    const glm::mat4x3 m = numbers::any_affine();
    const long double most = largest_singular_value(m);
    const float scale = pgl::error_scale(m);
    if (most == 0) {
      RC_ASSERT(scale == 0.0f);
    } else {
      RC_ASSERT(scale >= most * (1 - 1e-9L));
      RC_ASSERT(scale <= std::max(most * 1.3161L, 2e-45L));
    }
  }
}

// ---- how far a point can move on the screen

RC_GTEST_PROP(PixelsPerUnitProps, noPointInViewMovesFartherOnTheScreen, ()) {
  int tried = 0;
  for (int repeat = 0; repeat < 50; ++repeat) {
    const Kind k = numbers::kind();
    const pgl::View view = numbers::view(k);
    const float pixels = pgl::pixels_per_unit(view);
    RC_ASSERT(pixels >= 0.0f);
    if (pixels == infinite) continue;
    const glm::vec3 at = numbers::point_near(view, k), to = numbers::point_near(view, k);
    const float step = std::ldexp(1.0f, numbers::whole(-20, 0));
    const glm::vec3 beside = at + (to - at) * step;
    if (!(std::isfinite(beside.x) && std::isfinite(beside.y) && std::isfinite(beside.z))) continue;
    const exact::Point p = exact::point(at), q = exact::point(beside);
    const Number w[2] = {exact::row_times(view.clip_from_world, 3, p), exact::row_times(view.clip_from_world, 3, q)};
    if (w[0] <= 0 || w[1] <= 0) continue;
    Number window[2][2];  // about the viewport's middle, in pixels
    for (int axis = 0; axis < 2; ++axis) {
      const Number half = Number(axis == 0 ? view.width : view.height) / 2;
      window[0][axis] = exact::row_times(view.clip_from_world, axis, p) / w[0] * half;
      window[1][axis] = exact::row_times(view.clip_from_world, axis, q) / w[1] * half;
    }
    const auto on_viewport = [&](const Number(&at_pixel)[2]) {
      return abs(at_pixel[0]) * 2 <= Number(view.width) && abs(at_pixel[1]) * 2 <= Number(view.height);
    };
    if (!on_viewport(window[0]) && !on_viewport(window[1])) continue;
    ++tried;
    const Number nearest = std::min(w[0], w[1]);
    const Number moved = square(window[1][0] - window[0][0]) + square(window[1][1] - window[0][1]);
    const exact::Point d{Number(q[0] - p[0]), Number(q[1] - p[1]), Number(q[2] - p[2])};
    RC_ASSERT(moved * square(nearest) <= square(Number(pixels)) * length_square(d));
  }
  RC_CLASSIFY(tried > 5);
}

RC_GTEST_PROP(PixelsPerUnitProps, isWhatTheWorstCornerAndDirectionNeed, ()) {
  for (int repeat = 0; repeat < 5; ++repeat) {
    const pgl::View view = numbers::view(numbers::kind());
    const glm::mat4& m = view.clip_from_world;
    long double most = 0;
    for (const long double q : {-1, 1})
      for (const long double r : {-1, 1})
        for (int step = 0; step < 400; ++step) {  // across the screen, in this direction
          const long double turn = step * std::numbers::pi_v<long double> / 400;
          long double sum = 0;
          for (int i = 0; i < 3; ++i) {
            const long double x = view.width / 2.0L * (m[i].x - q * m[i].w),
                              y = view.height / 2.0L * (m[i].y - r * m[i].w);
            const long double along = std::cos(turn) * x + std::sin(turn) * y;
            sum += along * along;
          }
          most = std::max(most, sum);
        }
    most = std::sqrt(most);
    const float pixels = pgl::pixels_per_unit(view);
    RC_ASSERT(pixels >= most * (1 - 1e-15L));
    if (pixels < infinite) RC_ASSERT(pixels <= std::max(most * (1 + 1e-4L), 2e-45L));
  }
}

// ---- the selection

/// The least float at or above the product of two that are not negative.
float product_above(float a, float b) {
  if ((a == infinite && b > 0) || (b == infinite && a > 0)) return infinite;
  const Number exact = Number(a) * Number(b);
  if (exact > Number(std::numeric_limits<float>::max())) return infinite;
  float f = static_cast<float>(exact.get_d());
  if (f > 0) f = std::nextafter(f, 0.0f);
  while (Number(f) < exact) f = std::nextafter(f, infinite);
  return f;
}

bool projects_within(float error, float g, float threshold, float depth) {
  if (error == 0 || threshold == infinite) return true;
  if (error == infinite || g == infinite) return false;
  return Number(error) * Number(g) <= Number(threshold) * Number(depth);
}

/// Count by count, from the fewest on.
Counts told(const ErrorScene& s) {
  const float pixels = pgl::pixels_per_unit(s.view);
  Counts counts;
  for (std::size_t i = 0; i < s.size(); ++i) {
    const bool seen =
        s.areas[i] > 0 && !(s.areas[i] < s.options.pet) && !std::isnan(s.depths[i]) && s.depths[i] != infinite;
    std::uint32_t count = 0;
    if (seen) {
      const float g = product_above(s.scales[i], pixels);
      count = s.min_vertices[i];
      while (count < s.max_vertices[i] &&
             !projects_within(s.error(i, count), g, s.options.threshold, std::max(s.depths[i], s.view.near_depth)))
        ++count;
    }
    counts.push_back(count);
  }
  return counts;
}

RC_GTEST_PROP(SelectByErrorProps, isTheCoarsestCountWhoseErrorProjectsBelowTheThreshold, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  const ErrorScene scene = error_scene(random, random() % 60);
  const Result result = select(scene);
  RC_ASSERT(result.counts == told(scene));
  pgl::BudgetTotals totals;
  for (const std::uint32_t count : result.counts) totals += {count > 0 ? 1u : 0u, count};
  RC_ASSERT(result.totals == totals);
}

RC_GTEST_PROP(SelectByErrorProps, aStricterThresholdOrANearerCameraNeverTakesLess, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  ErrorScene scene = error_scene(random, 100);
  const Counts before = select(scene).counts;
  if (random() % 2 == 0)
    scene.options.threshold *= 0.7f;
  else
    for (float& depth : scene.depths) depth *= 0.7f;
  const Counts after = select(scene).counts;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    if (before[i] == 0 || after[i] == 0) continue;
    RC_ASSERT(after[i] >= before[i]);
  }
}

RC_GTEST_PROP(SelectByErrorProps, staysInRangeWhateverTheErrorsAre, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  ErrorScene scene = error_scene(random, 100);
  for (float& error : scene.errors) error = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()));
  const Counts counts = select(scene).counts;
  for (std::size_t i = 0; i < scene.size(); ++i)
    RC_ASSERT(counts[i] == 0 || (counts[i] >= scene.min_vertices[i] && counts[i] <= scene.max_vertices[i]));
}

TEST(SelectByErrorProps, DoesNotDependOnTheNumberOfThreads) {
  std::mt19937 random(1);
  const ErrorScene scene = error_scene(random, 100003);
  const Result expected = select(scene);
  EXPECT_GT(expected.totals.objects, 1000u);
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 5}) {
    omp_set_num_threads(n);
    EXPECT_EQ(select(scene), expected);
  }
  omp_set_num_threads(threads);
#endif
}

}  // namespace
