// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "pgl/host/build_hzm.hpp"
#include "support/depth_maps.hpp"
#include "support/numbers.hpp"

namespace {

using numbers::whole;
using pgl::Depth;
using pgl::DepthMap;
using pgl::HzmLevel;
using test::Depths;

/// The farthest of the texels of level 0 below a texel, each looked at.
Depth farthest_below(const DepthMap& size, const std::vector<Depth>& texels, std::uint32_t level, std::uint32_t x,
                     std::uint32_t y) {
  const std::uint64_t side = std::uint64_t{1} << level;
  const auto x1 = std::min<std::uint64_t>((x + 1) * side, size.width);
  const auto y1 = std::min<std::uint64_t>((y + 1) * side, size.height);
  Depth farthest = 0;
  for (std::uint64_t j = y * side; j < y1; ++j)
    for (std::uint64_t i = x * side; i < x1; ++i) farthest = std::max(farthest, texels[j * size.width + i]);
  return farthest;
}

bool every_texel_is_the_farthest_below(const DepthMap& size, const std::vector<Depth>& depths) {
  std::vector<Depth> texels = depths;
  pgl::host::build_hzm(size, texels);
  std::uint64_t next = 0;
  std::uint32_t levels = 0;
  for (; levels < pgl::hzm_levels(size); ++levels) {
    const HzmLevel level = pgl::hzm_level(size, levels);
    if (level.offset != next || ((size.width + (std::uint64_t{1} << levels) - 1) >> levels) != level.width ||
        ((size.height + (std::uint64_t{1} << levels) - 1) >> levels) != level.height)
      return false;
    for (std::uint32_t y = 0; y < level.height; ++y)
      for (std::uint32_t x = 0; x < level.width; ++x)
        if (texels[level.offset + std::size_t{y} * level.width + x] != farthest_below(size, depths, levels, x, y))
          return false;
    next += std::uint64_t{level.width} * level.height;
    if ((level.width == 1 && level.height == 1) != (levels + 1 == pgl::hzm_levels(size))) return false;
  }
  return next == texels.size();
}

RC_GTEST_PROP(BuildHzmProps, everyTexelIsTheFarthestOfThoseOfLevelZeroBelowIt, ()) {
  const DepthMap size =
      test::map_of(static_cast<std::uint32_t>(whole(1, 140)), static_cast<std::uint32_t>(whole(1, 140)));
  RC_ASSERT(every_texel_is_the_farthest_below(
      size, test::texels_of(size, static_cast<Depths>(whole(0, 3)), static_cast<std::uint32_t>(whole(0, 1 << 30)))));
}

TEST(BuildHzmProps, EveryTexelIsTheFarthestBelowItAtOddSizes) {
  std::uint32_t seed = 0;
  for (const DepthMap& size : test::odd_sizes())
    for (const Depths kind : {Depths::noise, Depths::ramp, Depths::holed_wall, Depths::few_values})
      EXPECT_TRUE(every_texel_is_the_farthest_below(size, test::texels_of(size, kind, ++seed)))
          << size.width << " x " << size.height << ", kind " << static_cast<int>(kind);
}

TEST(BuildHzmProps, EveryTexelIsTheFarthestOfTheUpToFourBelowAt4096) {
  const DepthMap size = test::map_of(4096, 4096);
  std::vector<Depth> texels = test::texels_of(size, Depths::noise, 1);
  pgl::host::build_hzm(size, texels);
  for (std::uint32_t l = 1; l < pgl::hzm_levels(size); ++l) {
    const HzmLevel from = pgl::hzm_level(size, l - 1), to = pgl::hzm_level(size, l);
    ASSERT_EQ(to.width * 2, from.width);
    std::size_t wrong = 0;
    for (std::size_t y = 0; y < to.height; ++y)
      for (std::size_t x = 0; x < to.width; ++x) {
        const Depth* below = &texels[from.offset + 2 * y * from.width + 2 * x];
        wrong += texels[to.offset + y * to.width + x] !=
                 std::max({below[0], below[1], below[from.width], below[from.width + 1]});
      }
    EXPECT_EQ(wrong, 0u) << "level " << l;
  }
}

TEST(BuildHzmProps, DoesNotDependOnTheNumberOfThreads) {
  const DepthMap size = test::map_of(1001, 777);
  const std::vector<Depth> depths = test::texels_of(size, Depths::noise, 2);
  std::vector<Depth> expected = depths;
  pgl::host::build_hzm(size, expected);
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 5}) {
    omp_set_num_threads(n);
    std::vector<Depth> texels = depths;
    pgl::host::build_hzm(size, texels);
    EXPECT_EQ(texels, expected);
  }
  omp_set_num_threads(threads);
#endif
}

}  // namespace
