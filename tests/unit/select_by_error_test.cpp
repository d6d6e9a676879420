// SPDX-License-Identifier: MIT
#include "pgl/host/select_by_error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "pgl/host/build_ecol.hpp"
#include "pgl/host/project.hpp"

namespace {

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

glm::mat4x3 matrix(glm::vec3 x, glm::vec3 y, glm::vec3 z) {
  return {x, y, z, glm::vec3(7, 8, 9)};
}

TEST(ErrorScale, IsExactForScalesAndMirrors) {
  EXPECT_EQ(pgl::error_scale(glm::mat4x3(1.0f)), 1.0f);
  EXPECT_EQ(pgl::error_scale(matrix({2, 0, 0}, {0, 3, 0}, {0, 0, 0.5f})), 3.0f);
  EXPECT_EQ(pgl::error_scale(matrix({0, 0, -4}, {0, 4, 0}, {4, 0, 0})), 4.0f);
  EXPECT_EQ(pgl::error_scale(matrix({0, 0, 0}, {0, 0, 0}, {0, 0, 0})), 0.0f);
  EXPECT_EQ(pgl::error_scale(matrix({0x1p-149f, 0, 0}, {0, 0, 0}, {0, 0, 0})), 0x1p-149f);
}

TEST(ErrorScale, IsExactForARotationWithAScaleBeforeOrAfterIt) {
  const glm::vec3 x(0.6f, 0.8f, 0), y(-0.8f, 0.6f, 0), z(0, 0, 1);  // not quite a rotation: the entries are rounded
  EXPECT_NEAR(pgl::error_scale(matrix(x, y, z)), 1.0, 3e-7);
  EXPECT_NEAR(pgl::error_scale(matrix(5.0f * x, y, z)), 5.0, 2e-6);
  const glm::vec3 after(5, 1, 1);
  EXPECT_NEAR(pgl::error_scale(matrix(x * after, y * after, z * after)), 5.0, 2e-6);
}

TEST(ErrorScale, IsInfiniteWhereTheTransformIsNotFinite) {
  for (const float odd : {inf, -inf, nan})
    for (int column = 0; column < 3; ++column)
      for (int row = 0; row < 3; ++row) {
        glm::mat4x3 m(1.0f);
        m[column][row] = odd;
        EXPECT_EQ(pgl::error_scale(m), inf);
      }
  glm::mat4x3 moved(1.0f);
  moved[3].x = nan;
  EXPECT_EQ(pgl::error_scale(moved), 1.0f);
  constexpr float most = std::numeric_limits<float>::max();
  EXPECT_EQ(pgl::error_scale(matrix({most, 0, 0}, {0, 1, 0}, {0, 0, 1})), most);
  EXPECT_EQ(pgl::error_scale(matrix({most, most, 0}, {0, 1, 0}, {0, 0, 1})), inf);
}

/// Looking along -z, 90 degrees wide and high: window x = (x / -z + 1) * width / 2.
pgl::View camera(float width, float height) {
  pgl::View v;
  v.clip_from_world = glm::mat4(0.0f);
  v.clip_from_world[0].x = 1;
  v.clip_from_world[1].y = 1;
  v.clip_from_world[3].z = 0.5f;
  v.clip_from_world[2].w = -1;
  v.width = width;
  v.height = height;
  v.near_depth = 0.5f;
  return v;
}

TEST(PixelsPerUnit, IsThatOfACornerOfTheViewport) {
  // The rows of M at a corner are 500 (1, 0, 1) and 500 (0, 1, 1), whose sum is the longest image: 500 sqrt(3).
  EXPECT_NEAR(pgl::pixels_per_unit(camera(1000, 1000)), 500 * std::sqrt(3.0), 1e-3);
  // 500 (1, 0, 1) and 250 (0, 1, 1): the eigenvalues of (500000, 125000; 125000, 125000).
  EXPECT_NEAR(pgl::pixels_per_unit(camera(1000, 500)),
              std::sqrt(312500 + std::sqrt(187500.0 * 187500 + 125000.0 * 125000)), 1e-3);
}

TEST(PixelsPerUnit, OfAParallelProjectionIsTheLongerSides) {
  pgl::View v = camera(1000, 500);
  v.clip_from_world = glm::mat4(1.0f);
  EXPECT_NEAR(pgl::pixels_per_unit(v), 500, 1e-4);
  EXPECT_GE(pgl::pixels_per_unit(v), 500.0f);
  v.clip_from_world[0].x = 0.01f;
  EXPECT_NEAR(pgl::pixels_per_unit(v), 250, 1e-4);
}

TEST(PixelsPerUnit, ReachesTheEndsOfFloatsRange) {
  pgl::View v = camera(1000, 500);
  v.clip_from_world = glm::mat4(0.0f);
  EXPECT_EQ(pgl::pixels_per_unit(v), 0.0f);
  v.clip_from_world[2].x = 0x1p-140f;
  EXPECT_NEAR(pgl::pixels_per_unit(v) / 0x1p-140f, 500.0f, 1.0f);
  v.clip_from_world[2].x = 1e38f;
  EXPECT_EQ(pgl::pixels_per_unit(v), inf);
}

/// One object of a mesh of 4 to 8 vertices with errors of 16, 4, 4, 1, 0 units; a unit is 500 pixels at depth 1.
struct One {
  std::vector<pgl::Mesh> meshes = {{.first_map = 2, .min_vertices = 4, .max_vertices = 8}};
  std::vector<float> errors = {nan, nan, 16, 4, 4, 1, 0};
  pgl::View view = camera(1000, 500);
  pgl::ErrorOptions options;
  std::vector<std::uint32_t> counts = {99};
  One() {
    view.clip_from_world = glm::mat4(1.0f);  // parallel: a unit is 500 pixels and a hair
    options.threshold = 501;
  }
  std::uint32_t at(float depth, float scale = 1, std::uint32_t least = 4, std::uint32_t most = 8, float area = 100) {
    const std::vector<std::uint32_t> mesh_of_object = {0}, min_vertices = {least}, max_vertices = {most};
    const std::vector<float> areas = {area}, depths = {depth}, scales = {scale};
    const pgl::BudgetTotals totals = pgl::host::select_by_error(areas, depths, min_vertices, max_vertices, scales,
                                                                mesh_of_object, meshes, errors, view, options, counts);
    EXPECT_EQ(totals.vertices, counts[0]);
    EXPECT_EQ(totals.objects, counts[0] > 0 ? 1u : 0u);
    return counts[0];
  }
};

TEST(SelectByError, TakesTheFewestVerticesWhoseErrorIsBelowTheThreshold) {
  One one;
  EXPECT_EQ(one.at(16), 4u);
  EXPECT_EQ(one.at(15.9f), 5u);
  EXPECT_EQ(one.at(4), 5u);
  EXPECT_EQ(one.at(3.9f), 7u);
  EXPECT_EQ(one.at(1), 7u);
  EXPECT_EQ(one.at(0.9f), 8u);
  EXPECT_EQ(one.at(0.5f), 8u);
}

TEST(SelectByError, EnlargesTheErrorWithTheObject) {
  One one;
  EXPECT_EQ(one.at(16, 4), 5u);
  EXPECT_EQ(one.at(16, 0.25f), 4u);
  EXPECT_EQ(one.at(4, 0.25f), 4u);
  EXPECT_EQ(one.at(4, 0), 4u);
  EXPECT_EQ(one.at(1e30f, inf), 8u);
}

TEST(SelectByError, MeetsTheThresholdExactly) {
  One one;
  const float pixels = pgl::pixels_per_unit(one.view);
  one.options.threshold = pixels;
  EXPECT_EQ(one.at(4), 5u);
  EXPECT_EQ(one.at(std::nextafter(4.0f, 0.0f)), 7u);
  one.options.threshold = std::nextafter(pixels, 0.0f);
  EXPECT_EQ(one.at(4), 7u);
}

TEST(SelectByError, StaysInTheObjectsRange) {
  One one;
  EXPECT_EQ(one.at(16, 1, 6), 6u);
  EXPECT_EQ(one.at(0.9f, 1, 4, 6), 6u);
  EXPECT_EQ(one.at(2, 1, 5, 5), 5u);
}

TEST(SelectByError, CountsDepthsBeforeTheNearDepthAsThat) {
  One one;
  one.view.near_depth = 4;
  for (const float depth : {3.0f, 1.0f, 0.0f, -5.0f, -inf}) EXPECT_EQ(one.at(depth), 5u) << depth;
}

TEST(SelectByError, DrawsNothingThatIsNotInView) {
  One one;
  for (const float area : {0.0f, -0.0f, -1.0f, nan}) EXPECT_EQ(one.at(4, 1, 4, 8, area), 0u) << area;
  EXPECT_EQ(one.at(inf), 0u);
  EXPECT_EQ(one.at(nan), 0u);
  EXPECT_EQ(one.at(4, 1, 4, 8, inf), 5u);
  one.options.pet = 100;
  EXPECT_EQ(one.at(4, 1, 4, 8, 99.9f), 0u);
  EXPECT_EQ(one.at(4, 1, 4, 8, 100), 5u);
}

TEST(SelectByError, TakesWhatHasNoErrorWithAThresholdOfZero) {
  One one;
  one.options.threshold = 0;
  EXPECT_EQ(one.at(16), 8u);
  one.errors = {nan, nan, 16, 4, 0, 0, 0};
  EXPECT_EQ(one.at(16), 6u);
  EXPECT_EQ(one.at(16, inf), 6u);
  one.options.threshold = inf;
  EXPECT_EQ(one.at(0.5f), 4u);
}

TEST(SelectByError, KnowsItsOptions) {
  EXPECT_TRUE(pgl::is_valid(pgl::ErrorOptions{}));
  EXPECT_TRUE(pgl::is_valid(pgl::ErrorOptions{0, 0}));
  EXPECT_FALSE(pgl::is_valid(pgl::ErrorOptions{-1, 0}));
  EXPECT_FALSE(pgl::is_valid(pgl::ErrorOptions{nan, 0}));
  EXPECT_FALSE(pgl::is_valid(pgl::ErrorOptions{1, nan}));
}

TEST(SelectByError, TakesNoObjects) {
  EXPECT_EQ(pgl::host::select_by_error({}, {}, {}, {}, {}, {}, {}, {}, camera(1000, 500), {}, {}), pgl::BudgetTotals{});
  pgl::host::error_scales({}, {});
}

TEST(ErrorScales, AreThoseOfTheTransforms) {
  std::vector<pgl::Object> objects(3000);
  for (std::size_t i = 0; i < objects.size(); ++i) objects[i].transform[1].y = static_cast<float>(i);
  std::vector<float> scales(objects.size());
  pgl::host::error_scales(objects, scales);
  for (std::size_t i = 0; i < objects.size(); ++i) ASSERT_EQ(scales[i], std::max(1.0f, static_cast<float>(i)));
}

/// A bumpy sheet, collapsed with its errors recorded, farther and farther away: from all of it to the coarsest prefix.
TEST(SelectByError, FollowsTheErrorsThatBuildEcolWrites) {
  constexpr std::uint32_t side = 24;
  std::vector<glm::vec3> positions;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
  for (std::uint32_t y = 0; y < side; ++y)
    for (std::uint32_t x = 0; x < side; ++x) {
      const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
      positions.push_back({fx, fy, std::sin(fx * 0.7f) * std::cos(fy * 0.9f)});
      if (x + 1 == side || y + 1 == side) continue;
      const std::uint32_t v = y * side + x;
      triangles.push_back({{v, v + 1, v + side}});
      triangles.push_back({{v + 1, v + side + 1, v + side}});
    }
  const std::size_t n = positions.size();
  std::vector<std::uint32_t> ecol(n), permute_v(n), permute_t(triangles.size()), map(n + 1);
  std::vector<float> all_errors(n + 1);
  pgl::host::EcolWorkspace<float> workspace;
  const std::uint32_t left =
      pgl::host::build_ecol<float, std::uint32_t>(positions, triangles, {}, {.boundary = pgl::BoundaryRule::slide},
                                                  workspace, ecol, permute_v, permute_t, map, all_errors);
  const std::vector<float> errors(all_errors.begin() + left, all_errors.end());
  const std::vector<pgl::Mesh> meshes = {{.min_vertices = left, .max_vertices = static_cast<std::uint32_t>(n)}};

  std::vector<pgl::Box> boxes;
  for (int i = 0; i < 40; ++i) {
    const float z = -30.0f * std::exp2(static_cast<float>(i) * 0.5f);
    boxes.push_back({{0, 0, z - 1}, {side - 1, side - 1, z + 1}});
  }
  const std::vector<std::uint32_t> mesh_of_object(boxes.size()), min_vertices(boxes.size(), left),
      max_vertices(boxes.size(), static_cast<std::uint32_t>(n));
  const std::vector<float> scales(boxes.size(), 1.0f);
  std::vector<float> areas(boxes.size()), depths(boxes.size());
  std::vector<std::uint32_t> counts(boxes.size());
  const pgl::View view = camera(1000, 1000);
  pgl::host::project(boxes, {}, view, areas, depths);
  pgl::host::select_by_error(areas, depths, min_vertices, max_vertices, scales, mesh_of_object, meshes, errors, view,
                             {}, counts);
  EXPECT_GT(counts.front(), n / 2);
  EXPECT_EQ(counts.back(), left);
  std::size_t between = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (i > 0) {
      EXPECT_LE(counts[i], counts[i - 1]);
    }
    between += counts[i] > left && counts[i] < n;
    if (counts[i] < n) {
      EXPECT_LE(errors[counts[i] - left] * 866.1f / depths[i], 1.0f);
    }
    if (counts[i] > left) {
      EXPECT_GT(errors[counts[i] - left - 1] * 866.0f / depths[i], 1.0f);
    }
  }
  EXPECT_GT(between, 5u);
}

}  // namespace
