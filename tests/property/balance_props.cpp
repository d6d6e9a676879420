// SPDX-License-Identifier: MIT
// Tiles against a version that tries every position and counts every object for each.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "pgl/host/balance.hpp"
#include "support/balance_scenes.hpp"

namespace {

using pgl::BalancePolicy;
using pgl::Tile;
using test::any_balance_scene;
using test::balance_scene;
using test::BalanceScene;
using Loads = std::vector<std::uint64_t>;
__extension__ typedef __int128 Wide;

struct Result {
  std::vector<Tile> tiles;
  Loads loads;
  friend bool operator==(const Result&, const Result&) = default;
};

Result balance(const BalanceScene& s) {
  static pgl::host::BalanceWorkspace workspace;  // full of what other scenes left
  Result r{std::vector<Tile>(s.weights.size(), Tile{9, 9, 9, 9}), Loads(s.weights.size(), 4242)};
  pgl::host::balance(s.rectangles, s.loads, s.width, s.height, s.weights, s.options, workspace, r.tiles, r.loads);
  return r;
}

/// The pixels from low to high that a rectangle grown by one to each side has a point in, one after the other.
struct Range {
  std::int64_t first = 0, last = -1;
  Range(float low, float high, std::uint32_t side) {
    bool any = false;
    for (std::int64_t c = 0; c < side; ++c) {
      const auto pixel = static_cast<double>(c);  // [c, c + 1)
      if (!(low <= high && low < pixel + 2 && high >= pixel - 1)) continue;
      if (!any) first = c;
      last = c;
      any = true;
    }
  }
  bool meets(std::int64_t begin, std::int64_t end) const { return std::max(first, begin) < std::min(last + 1, end); }
};

/// Counts, for every question anew.
struct Oracle {
  const BalanceScene& s;
  std::vector<Range> columns{}, rows{};
  Result result{};
  int reached = 0, missed = 0;  // searches that ended within the threshold, or not

  explicit Oracle(const BalanceScene& scene) : s(scene) {
    for (const pgl::ScreenBox& box : s.rectangles) {
      columns.emplace_back(box.x0, box.x1, s.width);
      rows.emplace_back(box.y0, box.y1, s.height);
    }
    result.tiles.resize(s.weights.size());
    result.loads.resize(s.weights.size());
    cut({0, 0, s.width, s.height}, 0, s.weights.size());
  }

  bool is_in(std::size_t i, const Tile& t) const {
    return s.loads[i] > 0 && columns[i].meets(t.x0, t.x1) && rows[i].meets(t.y0, t.y1);
  }
  std::uint64_t load(const Tile& t) const {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < s.size(); ++i) sum += is_in(i, t) ? s.loads[i] : 0;
    return sum;
  }

  struct Candidate {
    Tile left, right;
    Wide l, r;
    Wide larger() const { return std::max(l, r); }
    Wide difference() const { return l > r ? l - r : r - l; }
    bool is_within(float threshold) const {
      return difference() * (1 << 24) <= static_cast<Wide>(static_cast<double>(threshold) * (1 << 24)) * (l + r);
    }
    bool beats(const Candidate& other) const {
      return std::pair(larger(), difference()) < std::pair(other.larger(), other.difference());
    }
  };

  void cut(const Tile& t, std::size_t first, std::size_t last) {
    if (last - first == 1) {
      result.tiles[first] = t;
      result.loads[first] = load(t);
      return;
    }
    const std::size_t middle = first + (last - first) / 2;
    Wide left_weight = 0, right_weight = 0;
    for (std::size_t gpu = first; gpu < last; ++gpu) (gpu < middle ? left_weight : right_weight) += s.weights[gpu];
    const std::uint32_t width = t.x1 - t.x0, height = t.y1 - t.y0, length = std::max(width, height);
    const auto cut_at = [&](std::uint32_t at) {
      Candidate c{t, t, 0, 0};
      if (height > width)
        c.left.y1 = c.right.y0 = t.y0 + at;
      else
        c.left.x1 = c.right.x0 = t.x0 + at;
      c.l = load(c.left) * right_weight;
      c.r = load(c.right) * left_weight;
      return c;
    };
    Candidate chosen = cut_at(length);
    if (width == 0 || height == 0) chosen = {t, t, 0, 0};
    if (length >= 2 && width > 0 && height > 0) {
      chosen =
          load(t) == 0
              ? cut_at(std::max(1u, static_cast<std::uint32_t>(length * left_weight / (left_weight + right_weight))))
              : chosen_of(candidates(length, cut_at));
    }
    cut(chosen.left, first, middle);
    cut(chosen.right, middle, last);
  }

  template <class CutAt>
  std::vector<Candidate> candidates(std::uint32_t length, CutAt&& cut_at) const {
    const std::uint64_t bins = s.options.bins == 0 || s.options.bins > length ? length : s.options.bins;
    std::vector<Candidate> all;
    for (std::uint64_t k = 1; k < bins; ++k) all.push_back(cut_at(static_cast<std::uint32_t>(k * length / bins)));
    return all;
  }

  Candidate chosen_of(std::span<const Candidate> all) {
    Candidate best = all.front();
    for (const Candidate& c : all)
      if (c.beats(best)) best = c;
    if (s.options.policy == BalancePolicy::histogram) return best;
    const bool some = std::any_of(all.begin(), all.end(), [&](auto& c) { return c.is_within(s.options.threshold); });
    std::vector<Candidate> seen;
    for (std::span<const Candidate> left = all; !left.empty();) {
      const Candidate& c = left[(left.size() - 1) / 2];
      seen.push_back(c);
      if (c.is_within(s.options.threshold)) break;
      left = c.l > c.r ? left.first((left.size() - 1) / 2) : left.subspan((left.size() - 1) / 2 + 1);
    }
    // What the rule promises of the search, before what it is.
    std::size_t most_steps = 1;
    while (std::size_t{1} << most_steps <= all.size()) ++most_steps;
    RC_ASSERT(seen.size() <= most_steps);
    RC_ASSERT(seen.back().is_within(s.options.threshold) == some);
    (some ? reached : missed) += 1;
    if (some) return seen.back();
    Candidate taken = seen.front();
    const auto at = [](const Candidate& c) { return std::pair(c.left.x1, c.left.y1); };
    for (const Candidate& c : seen)
      if (c.beats(taken) || (!taken.beats(c) && at(c) < at(taken))) taken = c;
    RC_ASSERT(taken.larger() == best.larger() && taken.difference() == best.difference());
    return taken;
  }
};

template <class Body>
void for_scenes(std::size_t most_objects, std::uint32_t most_side, int repeats, Body&& body) {
  std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
  for (int k = 0; k < repeats; ++k) body(any_balance_scene(random, most_objects, most_side), random);
}

TEST(Balance, IsTheBestOfAllPositionsWhereEveryObjectIsCountedForEach) {
  int scenes = 0, cut = 0, loaded = 0, bisected = 0, reached = 0, missed = 0, binned = 0;
  EXPECT_TRUE(rc::check([&] {
    for_scenes(60, 100, 40, [&](const BalanceScene& scene, std::mt19937&) {
      const Oracle oracle(scene);
      const Result result = balance(scene);
      RC_ASSERT(result.tiles == oracle.result.tiles);
      RC_ASSERT(result.loads == oracle.result.loads);
      ++scenes;
      cut += scene.weights.size() > 2;
      loaded += std::count_if(result.loads.begin(), result.loads.end(), [](auto load) { return load > 0; }) > 1;
      bisected += scene.options.policy == BalancePolicy::bisection && scene.weights.size() > 1;
      binned += scene.options.bins > 0 && scene.options.bins < std::max(scene.width, scene.height);
      reached += oracle.reached;
      missed += oracle.missed;
    });
  }));
  // Of some thousand scenes, so many have something to show.
  EXPECT_GT(scenes, 3000);
  EXPECT_GT(cut, scenes / 3);
  EXPECT_GT(loaded, scenes / 3);
  EXPECT_GT(bisected, scenes / 3);
  EXPECT_GT(binned, scenes / 5);
  EXPECT_GT(reached, scenes / 10);
  EXPECT_GT(missed, scenes / 10);
}

RC_GTEST_PROP(Balance, CoversEveryPixelOnce, ()) {
  for_scenes(100, 120, 40, [](const BalanceScene& scene, std::mt19937&) {
    std::vector<int> covered(std::size_t{scene.width} * scene.height, 0);
    for (const Tile& t : balance(scene).tiles) {
      RC_ASSERT(t.x0 <= t.x1 && t.x1 <= scene.width && t.y0 <= t.y1 && t.y1 <= scene.height);
      for (std::uint32_t y = t.y0; y < t.y1; ++y)
        for (std::uint32_t x = t.x0; x < t.x1; ++x) ++covered[std::size_t{y} * scene.width + x];
    }
    RC_ASSERT(std::count(covered.begin(), covered.end(), 1) == static_cast<std::ptrdiff_t>(covered.size()));
  });
}

/// No holes: pixel by pixel of what an object touches, the GPU that draws the pixel draws the object.
RC_GTEST_PROP(InTile, HasEveryObjectInEveryTileItTouchesAndNoOther, ()) {
  for_scenes(40, 60, 40, [](const BalanceScene& scene, std::mt19937&) {
    const Result result = balance(scene);
    std::vector<std::vector<std::uint8_t>> expected(result.tiles.size(), std::vector<std::uint8_t>(scene.size(), 0));
    auto without_loads = expected;
    for (std::size_t i = 0; i < scene.size(); ++i) {
      const pgl::ScreenBox& box = scene.rectangles[i];
      const Range columns(box.x0, box.x1, scene.width), rows(box.y0, box.y1, scene.height);
      for (std::int64_t y = rows.first; y <= rows.last; ++y)
        for (std::int64_t x = columns.first; x <= columns.last; ++x)
          for (std::size_t t = 0; t < result.tiles.size(); ++t) {
            const Tile& tile = result.tiles[t];
            if (x < tile.x0 || x >= tile.x1 || y < tile.y0 || y >= tile.y1) continue;
            without_loads[t][i] = 1;
            if (scene.loads[i] > 0) expected[t][i] = 1;
          }
    }
    for (std::size_t t = 0; t < result.tiles.size(); ++t) {
      std::vector<std::uint8_t> flags(scene.size(), 77);
      pgl::host::in_tile(scene.rectangles, scene.loads, result.tiles[t], flags);
      RC_ASSERT(flags == expected[t]);
      std::uint64_t load = 0;
      for (std::size_t i = 0; i < scene.size(); ++i) load += flags[i] != 0 ? scene.loads[i] : 0;
      RC_ASSERT(result.loads[t] == load);
      pgl::host::in_tile(scene.rectangles, {}, result.tiles[t], flags);
      RC_ASSERT(flags == without_loads[t]);
    }
  });
}

/// The loads of both sides of every border, from one pass each over the objects' first and last columns.
TEST(Balance, HasTheSmallestLargerShareInPicturesOfOrdinarySize) {
  std::mt19937 random(3);
  for (const auto& [width, height] : {std::pair(1920u, 1080u), {1080u, 1920u}, {16384u, 3u}, {5000u, 5000u}})
    for (int repeat = 0; repeat < 6; ++repeat) {
      BalanceScene scene =
          balance_scene(random, 20000, width, height, 2, repeat < 3 ? test::Loads::any : test::Loads::huge);
      const bool along_y = height > width;
      const std::uint32_t side = along_y ? height : width;
      std::vector<Wide> first(side + 1, 0), last(side + 1, 0);
      for (std::size_t i = 0; i < scene.size(); ++i) {
        const pgl::TouchedPixels p = pgl::touched_pixels(scene.rectangles[i], width, height);
        if (p == pgl::TouchedPixels{}) continue;
        first[(along_y ? p.y0 : p.x0) + 1u] += scene.loads[i];
        last[along_y ? p.y1 : p.x1] += scene.loads[i];
      }
      for (std::uint32_t x = 1; x <= side; ++x) {
        first[x] += first[x - 1];
        last[x] += last[x - 1];
      }
      scene.options.bins = 0;
      scene.options.threshold = 0;
      for (const BalancePolicy policy : {BalancePolicy::histogram, BalancePolicy::bisection}) {
        scene.options.policy = policy;
        const Result result = balance(scene);
        const auto larger = [&](Wide l, Wide r) { return std::max(l * scene.weights[1], r * scene.weights[0]); };
        const Wide taken = larger(result.loads[0], result.loads[1]);
        Wide least = larger(first[1], last[side] - last[1]);
        for (std::uint32_t x = 1; x < side; ++x) least = std::min(least, larger(first[x], last[side] - last[x]));
        EXPECT_TRUE(taken == least) << width << " x " << height;
        const std::uint32_t at = along_y ? result.tiles[0].y1 : result.tiles[0].x1;
        EXPECT_TRUE(first[at] == result.loads[0] && last[side] - last[at] == result.loads[1]);
      }
    }
}

TEST(Balance, IsTheSameForAnyNumberOfThreadsAndManyObjects) {
  std::mt19937 random(7);
  for (const std::size_t n : {4095u, 4096u, 8193u, 50000u, 300001u})
    for (const std::size_t gpus : {1u, 2u, 5u, 64u}) {
      BalanceScene scene = balance_scene(random, n, 1920, 1080, gpus);
      for (const BalancePolicy policy : {BalancePolicy::histogram, BalancePolicy::bisection}) {
        scene.options.policy = policy;
        const Result expected = balance(scene);
        std::vector<std::uint8_t> expected_flags(n), flags(n);
        pgl::host::in_tile(scene.rectangles, scene.loads, expected.tiles[gpus - 1], expected_flags);
#if defined(_OPENMP)
        const int all = omp_get_max_threads();
        for (const int threads : {1, 2, 7}) {
          omp_set_num_threads(threads);
          EXPECT_EQ(balance(scene), expected) << n << " objects, " << gpus << " GPUs, " << threads << " threads";
          pgl::host::in_tile(scene.rectangles, scene.loads, expected.tiles[gpus - 1], flags);
          EXPECT_EQ(flags, expected_flags);
        }
        omp_set_num_threads(all);
#else
        EXPECT_EQ(balance(scene), expected);
#endif
      }
    }
}

/// Loads and weights as large as they may be, against 128-bit integers.
RC_GTEST_PROP(SplitCost, IsExactForTheLargestLoadsAndWeights, ()) {
  std::mt19937_64 random(*rc::gen::arbitrary<std::uint64_t>());
  const auto below = [&](int bits) { return random() >> (64 - bits) >> random() % static_cast<unsigned>(bits); };
  const auto is = [](const pgl::detail::Wide& a, Wide b) { return (Wide{a.high} << 64 | Wide{a.low}) == b; };
  for (int repeat = 0; repeat < 200; ++repeat) {
    pgl::SplitLoads loads{below(63), below(63)}, weights{1 + below(38), 1 + below(38)};
    if (repeat % 8 == 0) loads.right = loads.left;
    if (repeat % 16 == 0) weights.right = weights.left;
    if (repeat == 0)
      loads = {(std::uint64_t{1} << 63) - 1, (std::uint64_t{1} << 63) - 1}, weights = {1ull << 38, 1ull << 38};
    const Wide l = static_cast<Wide>(loads.left) * weights.right, r = static_cast<Wide>(loads.right) * weights.left;
    const pgl::SplitCost cost = pgl::split_cost(loads, weights);
    RC_ASSERT(is(cost.larger, std::max(l, r)));
    RC_ASSERT(is(cost.difference, l > r ? l - r : r - l));
    RC_ASSERT(cost.left_is_larger == (l > r));
    for (const float threshold : {0.0f, 0.5f, 0.03f, 1.0f, static_cast<float>(random() % 1000) / 1000.0f}) {
      const auto steps = static_cast<Wide>(static_cast<double>(threshold) * (1 << 24));
      RC_ASSERT(pgl::is_balanced(cost, threshold) == ((l > r ? l - r : r - l) * (1 << 24) <= steps * (l + r)));
    }
  }
}

}  // namespace
