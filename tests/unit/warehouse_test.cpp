// SPDX-License-Identifier: MIT
// Unit tests of the warehouse: parts stand on shelves above the floor, apart from each other, the same every time.
#include "scene/warehouse.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <vector>

namespace {

using pgl::Box;
using pgl::scene::lay_out_warehouse;
using pgl::scene::warehouse_levels;

std::vector<Box> random_parts(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> place(-50.0f, 50.0f);
  std::lognormal_distribution<float> size(0.0f, 1.0f);
  std::vector<Box> parts(count);
  for (Box& part : parts) {
    part.min = {place(random), place(random), place(random)};
    part.max = part.min + glm::vec3(size(random), size(random), size(random));
  }
  return parts;
}

std::vector<Box> moved(std::vector<Box> parts) {
  const std::vector<glm::vec3> moves = lay_out_warehouse(parts);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    parts[i].min += moves[i];
    parts[i].max += moves[i];
  }
  return parts;
}

TEST(Warehouse, PartsStandApartAboveTheFloor) {
  for (const std::size_t count : {1u, 2u, 7u, 50u, 1000u}) {
    const std::vector<Box> parts = moved(random_parts(count, static_cast<unsigned>(count)));
    for (std::size_t i = 0; i < count; ++i) {
      EXPECT_GE(parts[i].min.z, -1e-3f);
      for (std::size_t j = 0; j < i; ++j) {
        const glm::vec3 gap = glm::max(parts[i].min - parts[j].max, parts[j].min - parts[i].max);
        EXPECT_GT(std::max({gap.x, gap.y, gap.z}), 0.01f) << i << " and " << j;
      }
    }
  }
}

TEST(Warehouse, ShelvesAreLevelAndRacksHaveAislesBetween) {
  const std::vector<Box> parts = moved(random_parts(3000, 1));
  Box all;
  for (const Box& part : parts) {
    all.min = glm::min(all.min, part.min);
    all.max = glm::max(all.max, part.max);
  }
  const glm::vec3 size = all.max - all.min;
  EXPECT_LT(size.x / size.y, 1.5f);
  EXPECT_GT(size.x / size.y, 0.6f);
  EXPECT_NEAR(all.min.x + all.max.x, 0.0f, 0.01f * size.x);
  EXPECT_NEAR(all.min.y + all.max.y, 0.0f, 0.05f * size.y);

  // Where no part is along y are the aisles; between two of them is a rack.
  std::vector<Box> by_y = parts;
  std::ranges::sort(by_y, {}, [](const Box& box) { return box.min.y; });
  std::size_t racks = 1, in_rack = 0;
  float reach = by_y[0].max.y, first = by_y[0].min.y, aisles = 0.0f, depths = 0.0f;
  std::set<int> levels;
  const auto end_rack = [&] {
    EXPECT_LE(levels.size(), warehouse_levels);
    EXPECT_GT(in_rack, 0u);
    depths += reach - first;
    levels.clear();
    in_rack = 0;
  };
  for (const Box& part : by_y) {
    if (part.min.y > reach + 0.1f) {
      end_rack();
      ++racks;
      aisles += part.min.y - reach;
      first = part.min.y;
    }
    reach = std::max(reach, part.max.y);
    ++in_rack;
    levels.insert(static_cast<int>(part.min.z * 1000.0f + 0.5f) / 10);
  }
  end_rack();
  EXPECT_GT(racks, 3u);
  EXPECT_NEAR(aisles / static_cast<float>(racks - 1), depths / static_cast<float>(racks), 0.01f);
}

TEST(Warehouse, StaysInOrderAndTakesAnyBoxes) {
  EXPECT_TRUE(lay_out_warehouse({}).empty());
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<Box> odd(6);  // empty ones
  odd[1] = {{0, 0, 0}, {0, 0, 0}};
  odd[2] = {{-inf, 0, 0}, {inf, 1, 1}};
  odd[3] = {{nan, nan, nan}, {nan, nan, nan}};
  odd[4] = {{-1e30f, -1e30f, -1e30f}, {1e30f, 1e30f, 1e30f}};
  odd[5] = {{1, 1, 1}, {2, 2, 2}};
  for (const glm::vec3& move : lay_out_warehouse(odd))
    for (int axis = 0; axis < 3; ++axis) EXPECT_TRUE(std::isfinite(move[axis]));
  for (const glm::vec3& move : lay_out_warehouse(std::vector<Box>(5)))
    for (int axis = 0; axis < 3; ++axis) EXPECT_TRUE(std::isfinite(move[axis]));

  const std::vector<Box> parts = moved(std::vector<Box>(100, Box{{0, 0, 0}, {1, 1, 1}}));
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const glm::vec3 a = parts[i - 1].min, b = parts[i].min;
    EXPECT_TRUE(b.y > a.y || (b.y == a.y && (b.z > a.z || (b.z == a.z && b.x > a.x)))) << i;
  }
}

}  // namespace
