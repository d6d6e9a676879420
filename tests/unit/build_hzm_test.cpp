// SPDX-License-Identifier: MIT
#include "pgl/host/build_hzm.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace {

using pgl::Depth;
using pgl::DepthMap;
using pgl::HzmLevel;

DepthMap map_of(std::uint32_t width, std::uint32_t height) {
  DepthMap size;
  size.width = width;
  size.height = height;
  return size;
}

TEST(HzmLevels, HalveUntilOneTexelIsLeft) {
  EXPECT_EQ(pgl::hzm_levels(map_of(1, 1)), 1u);
  EXPECT_EQ(pgl::hzm_levels(map_of(2, 1)), 2u);
  EXPECT_EQ(pgl::hzm_levels(map_of(2, 2)), 2u);
  EXPECT_EQ(pgl::hzm_levels(map_of(3, 1)), 3u);
  EXPECT_EQ(pgl::hzm_levels(map_of(7, 1333)), 12u);
  EXPECT_EQ(pgl::hzm_levels(map_of(4096, 4096)), 13u);
  EXPECT_EQ(pgl::hzm_levels(map_of(65536, 65536)), pgl::most_hzm_levels);
  EXPECT_EQ(pgl::hzm_levels(map_of(1, 65536)), pgl::most_hzm_levels);
}

TEST(HzmLevels, LieOneAfterTheOther) {
  const DepthMap size = map_of(5, 3);
  EXPECT_EQ(pgl::hzm_level(size, 0), (HzmLevel{5, 3, 0}));
  EXPECT_EQ(pgl::hzm_level(size, 1), (HzmLevel{3, 2, 15}));
  EXPECT_EQ(pgl::hzm_level(size, 2), (HzmLevel{2, 1, 21}));
  EXPECT_EQ(pgl::hzm_level(size, 3), (HzmLevel{1, 1, 23}));
  EXPECT_EQ(pgl::hzm_levels(size), 4u);
  EXPECT_EQ(pgl::hzm_texels(size), 24u);
  EXPECT_EQ(pgl::hzm_texels(map_of(1, 1)), 1u);
}

TEST(HzmLevels, CountTheLargestMapIn64Bits) {
  const DepthMap size = map_of(65536, 65536);
  std::uint64_t texels = 0;
  for (std::uint64_t side = 65536; side > 0; side /= 2) texels += side * side;
  EXPECT_EQ(pgl::hzm_texels(size), texels);
  EXPECT_EQ(pgl::hzm_level(size, 16), (HzmLevel{1, 1, texels - 1}));
}

TEST(BuildHzm, LeavesAMapOfOneTexelAsItIs) {
  std::vector<Depth> texels{77};
  pgl::host::build_hzm(map_of(1, 1), texels);
  EXPECT_EQ(texels, (std::vector<Depth>{77}));
}

TEST(BuildHzm, TakesTheFarthestOfFour) {
  std::vector<Depth> texels{1, 4, 3, 2, 0};
  pgl::host::build_hzm(map_of(2, 2), texels);
  EXPECT_EQ(texels, (std::vector<Depth>{1, 4, 3, 2, 4}));
}

TEST(BuildHzm, TakesWhatThereIsWhereSidesAreOdd) {
  std::vector<Depth> texels{1, 2, 3,  //
                            4, 5, 6,  //
                            9, 8, 7,  //
                            0, 0, 0, 0, 0};
  pgl::host::build_hzm(map_of(3, 3), texels);
  EXPECT_EQ(texels, (std::vector<Depth>{1, 2, 3, 4, 5, 6, 9, 8, 7, 5, 6, 9, 7, 9}));
}

TEST(BuildHzm, TakesRowsAndColumns) {
  std::vector<Depth> row{3, 1, 4, 1, 5, 9, 9, 9, 9, 9, 9};
  row.resize(pgl::hzm_texels(map_of(5, 1)));
  pgl::host::build_hzm(map_of(5, 1), row);
  EXPECT_EQ(row, (std::vector<Depth>{3, 1, 4, 1, 5, 3, 4, 5, 4, 5, 5}));
  std::vector<Depth> column{3, 1, 4, 1, 5, 9, 9, 9, 9, 9, 9};
  pgl::host::build_hzm(map_of(1, 5), column);
  EXPECT_EQ(column, row);
}

TEST(BuildHzm, OneFarTexelIsSeenFromEveryLevel) {
  const DepthMap size = map_of(37, 21);
  for (std::uint32_t y = 0; y < size.height; ++y)
    for (std::uint32_t x = 0; x < size.width; ++x) {
      std::vector<Depth> texels(pgl::hzm_texels(size), 0xa5a5a5a5u);
      for (std::uint32_t i = 0; i < size.width * size.height; ++i) texels[i] = 5;
      texels[y * size.width + x] = pgl::far_depth;
      pgl::host::build_hzm(size, texels);
      for (std::uint32_t l = 0; l < pgl::hzm_levels(size); ++l) {
        const HzmLevel level = pgl::hzm_level(size, l);
        for (std::uint32_t i = 0; i < level.width * level.height; ++i)
          ASSERT_EQ(texels[level.offset + i], i == (y >> l) * level.width + (x >> l) ? pgl::far_depth : 5u);
      }
    }
}

TEST(BuildHzmDeathTest, RefusesAnArrayOfAnotherSize) {
  std::vector<Depth> texels(4);
  EXPECT_DEATH(pgl::host::build_hzm(map_of(2, 2), texels), "");
  EXPECT_DEATH(pgl::hzm_levels(map_of(0, 2)), "");
}

}  // namespace
