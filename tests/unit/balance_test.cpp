// SPDX-License-Identifier: MIT
// Worked examples of tiles, and their corners.
#include "pgl/host/balance.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <vector>

namespace {

using pgl::BalanceOptions;
using pgl::BalancePolicy;
using pgl::ScreenBox;
using pgl::Tile;
using pgl::TouchedPixels;
using Numbers = std::vector<std::uint32_t>;
using Loads = std::vector<std::uint64_t>;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr BalanceOptions bisection{.policy = BalancePolicy::bisection, .threshold = 0.0f};

/// A rectangle that touches the columns [x0, x1) and the rows [y0, y1), all that it may.
ScreenBox touching(std::uint32_t x0, std::uint32_t y0, std::uint32_t x1, std::uint32_t y1) {
  return {static_cast<float>(x0) + 1.5f, static_cast<float>(y0) + 1.5f, static_cast<float>(x1) - 1.5f,
          static_cast<float>(y1) - 1.5f, 1.0f};
}

struct Picture {
  std::uint32_t width = 100, height = 60;
  std::vector<ScreenBox> rectangles{};
  Numbers loads{};
  Numbers weights{1, 1};
  BalanceOptions options{};
  Loads tile_loads{};

  std::vector<Tile> tiles() {
    std::vector<Tile> r(weights.size(), Tile{7, 7, 7, 7});
    tile_loads.assign(weights.size(), 4242);
    pgl::host::BalanceWorkspace workspace;
    pgl::host::balance(rectangles, loads, width, height, weights, options, workspace, r, tile_loads);
    return r;
  }
};

TEST(TouchedPixels, AreThoseOfTheRectangleAndOneMoreToEachSide) {
  const auto touched = [](float x0, float x1) {
    const TouchedPixels p = pgl::touched_pixels({x0, 5.5f, x1, 5.5f, 1.0f}, 100, 60);
    EXPECT_TRUE(p == TouchedPixels{} || (p.y0 == 4 && p.y1 == 7));
    return std::pair(p.x0, p.x1);
  };
  const auto pixels = [](int first, int end) { return std::pair<std::uint16_t, std::uint16_t>(first, end); };
  EXPECT_EQ(touched(10.5f, 20.5f), pixels(9, 22));
  EXPECT_EQ(touched(10.0f, 20.0f), pixels(9, 22));
  EXPECT_EQ(touched(10.5f, 10.5f), pixels(9, 12));
  EXPECT_EQ(touched(0.0f, 0.0f), pixels(0, 2));
  EXPECT_EQ(touched(0.0f, 100.0f), pixels(0, 100));
  EXPECT_EQ(touched(-inf, inf), pixels(0, 100));
  EXPECT_EQ(touched(-1e30f, 3e38f), pixels(0, 100));
  EXPECT_EQ(touched(-5.0f, -1.0f), pixels(0, 1));
  EXPECT_EQ(touched(-5.0f, -1.01f), pixels(0, 0));
  EXPECT_EQ(touched(100.9f, 200.0f), pixels(99, 100));
  EXPECT_EQ(touched(101.0f, 200.0f), pixels(0, 0));
  EXPECT_EQ(touched(20.0f, 10.0f), pixels(0, 0));
  EXPECT_EQ(touched(nan, 10.0f), pixels(0, 0));
  EXPECT_EQ(touched(10.0f, nan), pixels(0, 0));
  EXPECT_EQ(pgl::touched_pixels({0, nan, 10, 10, 1}, 100, 60), TouchedPixels{});
  EXPECT_EQ(pgl::touched_pixels({}, 100, 60), TouchedPixels{});
  EXPECT_EQ(pgl::touched_pixels({-inf, -inf, inf, inf, 1}, 16384, 16384), (TouchedPixels{0, 0, 16384, 16384}));
  EXPECT_EQ(pgl::touched_pixels({0, 0, 1, 1, 1}, 1, 1), (TouchedPixels{0, 0, 1, 1}));
}

TEST(TileBins, HoldEveryPixelOnceForAnyLength) {
  for (std::uint32_t length = 1; length < 90; ++length)
    for (std::uint32_t count = 2; count < 95; ++count) {
      const pgl::TileBins bins = pgl::tile_bins({{5, 7, 5 + length, 8}, 0, 2}, {.bins = count});
      EXPECT_EQ(bins.count, std::min(count, length));
      EXPECT_FALSE(bins.along_y);
      EXPECT_EQ(pgl::bin_begin(bins, bins.count), length);
      for (std::uint32_t k = 0; k < bins.count; ++k) {
        EXPECT_LT(pgl::bin_begin(bins, k), pgl::bin_begin(bins, k + 1));
        for (std::uint32_t at = pgl::bin_begin(bins, k); at < pgl::bin_begin(bins, k + 1); ++at)
          EXPECT_EQ(pgl::bin_at(bins, at), k) << at << " of " << length << " in " << count;
      }
    }
  const pgl::TileBins large = pgl::tile_bins({{0, 0, 3, 16384}, 0, 2}, {.bins = 16383});
  EXPECT_TRUE(large.along_y);
  EXPECT_EQ(pgl::bin_at(large, 16383), 16382u);
  EXPECT_EQ(pgl::bin_at(large, 0), 0u);
}

TEST(Balance, CutsBetweenTwoObjectsWhereTheyBalance) {
  Picture p;
  p.rectangles = {touching(0, 0, 10, 60), touching(10, 0, 20, 60), touching(30, 0, 40, 60), touching(50, 0, 100, 60)};
  p.loads = {5, 5, 4, 6};
  for (const BalanceOptions& options : {BalanceOptions{}, bisection}) {
    p.options = options;
    const std::vector<Tile> tiles = p.tiles();
    EXPECT_GE(tiles[0].x1, 20u);
    EXPECT_LE(tiles[0].x1, 30u);
    EXPECT_EQ(tiles[1], (Tile{tiles[0].x1, 0, 100, 60}));
    EXPECT_EQ(p.tile_loads, (Loads{10, 10}));
  }
  p.options = {};
  EXPECT_EQ(p.tiles()[0], (Tile{0, 0, 20, 60}));  // the lowest of equals
}

TEST(Balance, CountsWhatTouchesBothSidesInBoth) {
  Picture p;
  p.rectangles = {touching(0, 0, 100, 60), touching(0, 0, 50, 60), touching(50, 0, 100, 60)};
  p.loads = {1000, 10, 10};
  EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 50, 60}, {50, 0, 100, 60}}));
  EXPECT_EQ(p.tile_loads, (Loads{1010, 1010}));
}

TEST(Balance, CutsAlongTheLongerSide) {
  Picture p{.width = 40, .height = 41};
  p.rectangles = {touching(0, 0, 40, 11), touching(0, 11, 40, 41)};
  p.loads = {3, 3};
  EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 40, 11}, {0, 11, 40, 41}}));
  p.width = 41;
  EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 1, 41}, {1, 0, 41, 41}}));  // along x both objects are on both sides
  EXPECT_EQ(p.tile_loads, (Loads{6, 6}));
}

TEST(Balance, GivesTheFasterGpuMore) {
  Picture p;
  for (std::uint32_t x = 0; x < 100; x += 10) p.rectangles.push_back(touching(x, 0, x + 10, 60));
  p.loads.assign(10, 2);
  p.weights = {4, 1};
  EXPECT_EQ(p.tiles()[0], (Tile{0, 0, 80, 60}));
  EXPECT_EQ(p.tile_loads, (Loads{16, 4}));
  p.weights = {1, 1, 3};  // 1 against 4, then 1 against 3
  EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 20, 60}, {20, 0, 40, 60}, {40, 0, 100, 60}}));
  EXPECT_EQ(p.tile_loads, (Loads{4, 4, 12}));
  p.weights = {0xffffffffu, 1};  // from 90 on the slow one has no less than 2, and from 91 on the fast one 20
  EXPECT_EQ(p.tiles()[1], (Tile{91, 0, 100, 60}));
}

TEST(Balance, CutsWhatNothingTouchesByTheWeights) {
  for (const BalanceOptions& options : {BalanceOptions{}, bisection, BalanceOptions{.bins = 3}}) {
    Picture p{.options = options};
    EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 50, 60}, {50, 0, 100, 60}}));
    EXPECT_EQ(p.tile_loads, (Loads{0, 0}));
    p.weights = {1, 3};
    p.rectangles = {touching(0, 0, 100, 60), {}, {nan, 0, 1, 1, 1}, touching(200, 0, 220, 10)};
    p.loads = {0, 5, 5, 5};  // none of them is drawn here
    EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 25, 60}, {25, 0, 100, 60}}));
    EXPECT_EQ(p.tile_loads, (Loads{0, 0}));
    p.weights = {1, 0xffffffffu};
    EXPECT_EQ(p.tiles()[0], (Tile{0, 0, 1, 60}));
    p.weights = {1, 1, 1, 1};
    EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 50, 30}, {0, 30, 50, 60}, {50, 0, 100, 30}, {50, 30, 100, 60}}));
  }
}

TEST(Balance, GivesOneGpuThePicture) {
  Picture p{.weights = {9}};
  p.rectangles = {touching(0, 0, 30, 60), touching(40, 2, 60, 30), touching(300, 2, 310, 30)};
  p.loads = {7, 4000000000u, 5};
  for (const std::uint32_t bins : {0u, 2u}) {
    p.options.bins = bins;
    EXPECT_EQ(p.tiles(), (std::vector<Tile>{{0, 0, 100, 60}}));
    EXPECT_EQ(p.tile_loads, (Loads{4000000007u}));
  }
}

TEST(Balance, LeavesTilesEmptyWhereThereAreMoreGpusThanPixels) {
  Picture p{.width = 1, .height = 1, .rectangles = {touching(0, 0, 1, 1)}, .loads = {3}};
  p.rectangles[0] = {0, 0, 1, 1, 1};
  p.weights.assign(64, 1);
  std::vector<Tile> tiles = p.tiles();
  EXPECT_EQ(tiles[0], (Tile{0, 0, 1, 1}));
  EXPECT_EQ(p.tile_loads[0], 3u);
  for (std::size_t t = 1; t < 64; ++t) {
    EXPECT_EQ(tiles[t], (Tile{1, 0, 1, 1}));
    EXPECT_EQ(p.tile_loads[t], 0u);
  }
  p.width = 3;
  p.weights.assign(5, 1);
  tiles = p.tiles();
  std::uint32_t pixels = 0;
  for (const Tile& t : tiles) pixels += (t.x1 - t.x0) * (t.y1 - t.y0);
  EXPECT_EQ(pixels, 3u);
}

TEST(Balance, AddsUpLoadsBeyond32Bits) {
  Picture p;
  for (std::uint32_t i = 0; i < 3000; ++i) p.rectangles.push_back(touching(i % 25 * 4, 0, i % 25 * 4 + 4, 60));
  p.loads.assign(3000, 0xffffffffu);
  p.weights = {0xffffffffu, 0xffffffffu, 0xffffffffu, 0xffffffffu};
  for (const BalanceOptions& options : {BalanceOptions{}, bisection}) {
    p.options = options;
    const std::vector<Tile> tiles = p.tiles();
    EXPECT_GT(tiles[1].x1, 48u);  // 13 of the 25 columns of objects on either side, one of them on both
    EXPECT_LT(tiles[1].x1, 52u);
    EXPECT_EQ(p.tile_loads, Loads(4, std::uint64_t{0xffffffffu} * 120 * 13));
  }
}

TEST(Balance, CutsThroughAHeavyObjectOnlyWhereTheLargerShareIsNoLargerForIt) {
  Picture p;
  p.rectangles = {touching(40, 0, 60, 60)};
  p.loads = {1000};
  for (std::uint32_t x = 0; x < 100; x += 10) {
    p.rectangles.push_back(touching(x, 0, x + 10, 60));
    p.loads.push_back(1);
  }
  EXPECT_EQ(p.tiles()[0], (Tile{0, 0, 50, 60}));  // beside it there are 4 and 1006
  EXPECT_EQ(p.tile_loads, (Loads{1005, 1005}));
  p.rectangles = {touching(40, 0, 60, 60), touching(60, 0, 100, 60), touching(0, 0, 100, 60)};
  p.loads = {1000, 1000, 1};
  EXPECT_EQ(p.tiles()[0], (Tile{0, 0, 60, 60}));
  EXPECT_EQ(p.tile_loads, (Loads{1001, 1001}));
}

TEST(Bisection, StopsInTheMiddleWhereThatIsBalanced) {
  Picture p;
  p.rectangles = {touching(0, 0, 44, 60), touching(60, 0, 100, 60)};
  p.loads = {97, 103};
  p.options = {.policy = BalancePolicy::bisection, .threshold = 0.03f};
  EXPECT_EQ(p.tiles()[0].x1, 50u);
  p.rectangles.push_back(touching(46, 0, 50, 60));
  p.loads = {91, 103, 6};
  EXPECT_EQ(p.tiles()[0].x1, 50u);
  p.options.threshold = 0.029f;  // 97 against 103 is 6 of 200: not balanced; nor is anything else
  EXPECT_EQ(p.tile_loads, (Loads{97, 103}));
  p.tiles();
  EXPECT_EQ(p.tile_loads, (Loads{97, 103}));
}

TEST(InTile, IsEveryObjectThatTouchesIt) {
  const std::vector<ScreenBox> rectangles = {
      touching(0, 0, 50, 60),    touching(10, 0, 51, 60), touching(50, 20, 60, 30), touching(60, 0, 70, 20), {},
      {-inf, -inf, inf, inf, 1}, {nan, 0, 1, 1, 1}};
  const Numbers loads = {1, 1, 1, 1, 1, 0, 1};
  std::vector<std::uint8_t> flags(7, 9);
  pgl::host::in_tile(rectangles, loads, {50, 0, 100, 20}, flags);
  EXPECT_EQ(flags, (std::vector<std::uint8_t>{0, 1, 0, 1, 0, 0, 0}));
  pgl::host::in_tile(rectangles, {}, {50, 0, 100, 20}, flags);
  EXPECT_EQ(flags, (std::vector<std::uint8_t>{0, 1, 0, 1, 0, 1, 0}));
  pgl::host::in_tile(rectangles, {}, {50, 0, 50, 20}, flags);
  EXPECT_EQ(flags, std::vector<std::uint8_t>(7, 0));
}

TEST(BalanceOptions, AreRefusedOutsideTheirRanges) {
  EXPECT_TRUE(pgl::is_valid(BalanceOptions{}));
  EXPECT_TRUE(pgl::is_valid(BalanceOptions{.threshold = 1.0f, .bins = 0xffffffffu}));
  EXPECT_FALSE(pgl::is_valid(BalanceOptions{.bins = 1}));
  EXPECT_FALSE(pgl::is_valid(BalanceOptions{.threshold = -0.01f}));
  EXPECT_FALSE(pgl::is_valid(BalanceOptions{.threshold = 1.01f}));
  EXPECT_FALSE(pgl::is_valid(BalanceOptions{.threshold = nan}));
}

}  // namespace
