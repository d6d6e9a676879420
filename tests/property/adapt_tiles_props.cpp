// SPDX-License-Identifier: MIT
// What must hold of counts that are selected tile by tile: those of a version that goes pixel by pixel, the whole
// picture's where all tiles ask for the same, and every tile within its budget.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "pgl/host/adapt_tiles.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/select_by_error.hpp"
#include "support/balance_scenes.hpp"
#include "support/error_scenes.hpp"

namespace {

using pgl::BudgetTotals;
using pgl::ScreenBox;
using pgl::Tile;
using pgl::UnifyPolicy;
using Counts = std::vector<std::uint32_t>;
using Flags = std::vector<std::uint8_t>;

constexpr UnifyPolicy policies[] = {UnifyPolicy::quality, UnifyPolicy::performance};

/// Calls body with so many threads: 1 and some, or once without OpenMP.
template <class Body>
void with_threads(Body&& body) {
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 5}) {
    omp_set_num_threads(n);
    body();
  }
  omp_set_num_threads(threads);
#else
  body();
#endif
}

BudgetTotals totals_of(std::span<const std::uint32_t> counts) {
  BudgetTotals totals;
  for (const std::uint32_t count : counts) totals += {count > 0 ? 1u : 0u, count};
  return totals;
}

/// Tells whether a pixel of the tile is touched, pixel by pixel: by the rectangle grown by one to each side.
bool is_touched(const ScreenBox& box, const Tile& tile) {
  const auto any = [](float low, float high, std::uint32_t begin, std::uint32_t end) {
    for (std::uint32_t pixel = begin; pixel < end; ++pixel)
      if (low <= high && low < pixel + 2.0 && high >= pixel - 1.0) return true;
    return false;
  };
  return any(box.x0, box.x1, tile.x0, tile.x1) && any(box.y0, box.y1, tile.y0, tile.y1);
}

/// T tiles of balance, or any: apart, overlapping, empty.
std::vector<Tile> random_tiles(std::mt19937& random, const test::BalanceScene& scene) {
  std::vector<Tile> tiles(scene.weights.size());
  if (random() % 2 == 0) {
    pgl::host::BalanceWorkspace workspace;
    std::vector<std::uint64_t> loads(tiles.size());
    pgl::host::balance(scene.rectangles, scene.loads, scene.width, scene.height, scene.weights, scene.options,
                       workspace, tiles, loads);
    return tiles;
  }
  for (Tile& tile : tiles) {
    const auto number = [&](std::uint32_t side) { return static_cast<std::uint32_t>(random() % (side + 1)); };
    const auto x = std::minmax({number(scene.width), number(scene.width)});
    const auto y = std::minmax({number(scene.height), number(scene.height)});
    tile = {x.first, y.first, x.second, y.second};
  }
  return tiles;
}

RC_GTEST_PROP(AdaptTilesProps, givesWhatGoingPixelByPixelGives, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  const test::BalanceScene scene = test::any_balance_scene(random, 60, 90);
  const std::size_t n = scene.size();
  const std::vector<Tile> tiles = random_tiles(random, scene);
  Counts wanted(n * tiles.size());  // by tile: anything, 0 too
  for (std::uint32_t& count : wanted) count = random() % 4 == 0 ? 0 : random() % 1000;
  static pgl::host::AdaptWorkspace workspace;  // full of what other scenes left
  for (const UnifyPolicy policy : policies) {
    Counts expected;
    for (std::size_t i = 0; i < n; ++i) {
      Counts of_tiles;
      for (std::size_t t = 0; t < tiles.size(); ++t)
        if (is_touched(scene.rectangles[i], tiles[t])) of_tiles.push_back(wanted[t * n + i]);
      const bool quality = policy == UnifyPolicy::quality;
      expected.push_back(of_tiles.empty() ? 0
                         : quality        ? *std::ranges::max_element(of_tiles)
                                          : *std::ranges::min_element(of_tiles));
    }
    with_threads([&] {
      Counts counts(n, 4242);
      std::vector<std::uint8_t> calls(tiles.size());
      const BudgetTotals totals = pgl::host::adapt_tiles(
          scene.rectangles, tiles, policy, workspace,
          [&](std::size_t t, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
            ++calls[t];
            // Those that do not touch the tile get what must not be looked at.
            for (std::size_t i = 0; i < n; ++i)
              out[i] = flags[i] != 0 ? wanted[t * n + i] : policy == UnifyPolicy::quality ? 5000 : 0;
          },
          counts);
      RC_ASSERT(calls == std::vector<std::uint8_t>(tiles.size(), 1));
      RC_ASSERT(counts == expected);
      RC_ASSERT(totals == totals_of(expected));
    });
  }
}

/// Objects on the screen with errors: areas are those of the rectangles.
struct ErrorPicture {
  test::BalanceScene picture;
  test::ErrorScene errors;
};

ErrorPicture error_picture(std::mt19937& random) {
  ErrorPicture r{test::any_balance_scene(random, 60, 300), {}};
  r.errors = test::error_scene(random, r.picture.size());
  for (std::size_t i = 0; i < r.picture.size(); ++i) {
    ScreenBox& box = r.picture.rectangles[i];
    if (!(box.x0 >= 0.0f && box.x0 <= box.x1 && box.x1 <= static_cast<float>(r.picture.width))) box = {};
    if (!(box.y0 >= 0.0f && box.y0 <= box.y1 && box.y1 <= static_cast<float>(r.picture.height))) box = {};
    r.errors.areas[i] = pgl::projected_area(box);
  }
  return r;
}

void select_by_error(const test::ErrorScene& s, float threshold, std::span<const std::uint8_t> flags,
                     std::span<std::uint32_t> out) {
  std::vector<float> areas = s.areas;
  for (std::size_t i = 0; i < flags.size(); ++i) areas[i] = flags[i] != 0 ? areas[i] : 0.0f;
  pgl::ErrorOptions options = s.options;
  options.threshold = threshold;
  pgl::host::select_by_error(areas, s.depths, s.min_vertices, s.max_vertices, s.scales, s.mesh_of_object, s.meshes,
                             s.errors, s.view, options, out);
}

RC_GTEST_PROP(AdaptTilesProps, oneThresholdGivesTheWholePicturesCountsForAnyTiles, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  const auto [picture, errors] = error_picture(random);
  std::vector<Tile> tiles(picture.weights.size());
  std::vector<std::uint64_t> loads(tiles.size());
  pgl::host::BalanceWorkspace balance_workspace;
  pgl::host::balance(picture.rectangles, picture.loads, picture.width, picture.height, picture.weights, picture.options,
                     balance_workspace, tiles, loads);
  Counts whole(picture.size());
  select_by_error(errors, errors.options.threshold, {}, whole);
  pgl::host::AdaptWorkspace workspace;
  for (const UnifyPolicy policy : policies) {  // either: all tiles that an object touches ask for the same
    Counts counts(picture.size(), 4242);
    const auto& scene = errors;
    const BudgetTotals totals = pgl::host::adapt_tiles(
        picture.rectangles, tiles, policy, workspace,
        [&](std::size_t, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
          select_by_error(scene, scene.options.threshold, flags, out);
        },
        counts);
    RC_ASSERT(counts == whole);
    RC_ASSERT(totals == totals_of(whole));
  }
}

RC_GTEST_PROP(AdaptTilesProps, qualityIsNowhereCoarserThanATilesThreshold, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  const auto [picture, errors] = error_picture(random);
  const std::vector<Tile> tiles = random_tiles(random, picture);
  std::vector<float> thresholds;
  for (std::size_t t = 0; t < tiles.size(); ++t)
    thresholds.push_back(errors.options.threshold * (0.25f + static_cast<float>(random() % 8)));
  pgl::host::AdaptWorkspace workspace;
  Counts counts(picture.size(), 4242);
  const auto& scene = errors;
  pgl::host::adapt_tiles(
      picture.rectangles, tiles, UnifyPolicy::quality, workspace,
      [&](std::size_t t, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
        select_by_error(scene, thresholds[t], flags, out);
      },
      counts);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    // What the strictest of its tiles alone asks for.
    Counts alone(counts.size());
    float strictest = std::numeric_limits<float>::infinity();
    bool touched = false;
    for (std::size_t t = 0; t < tiles.size(); ++t) {
      if (!is_touched(picture.rectangles[i], tiles[t])) continue;
      strictest = std::min(strictest, thresholds[t]);
      touched = true;
    }
    if (touched) select_by_error(errors, strictest, {}, alone);
    RC_ASSERT(counts[i] == alone[i]);
  }
}

struct BudgetPicture {
  test::BalanceScene picture;
  std::vector<float> areas, depths;
  Counts least, most;
};

RC_GTEST_PROP(AdaptTilesProps, performanceKeepsEveryTilesBudgetAndEveryRange, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  BudgetPicture s{test::any_balance_scene(random, 80, 300), {}, {}, {}, {}};
  const std::size_t n = s.picture.size();
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < n; ++i) {
    s.areas.push_back(random() % 8 == 0 ? 0.0f : static_cast<float>(1 + random() % 5000));
    s.depths.push_back(static_cast<float>(1 + random() % 100));
    s.least.push_back(1 + random() % 20);
    s.most.push_back(s.least.back() + random() % 200);
    sum += s.most.back();
  }
  const std::vector<Tile> tiles = random_tiles(random, s.picture);
  std::vector<pgl::BudgetOptions> options(tiles.size());
  for (pgl::BudgetOptions& o : options) {
    o.budget = random() % (sum / tiles.size() + 2);
    o.pet = 0.0f;
    o.policy = random() % 2 == 0 ? pgl::BudgetPolicy::exact : pgl::BudgetPolicy::fair;
  }
  Counts expected;
  with_threads([&] {
    pgl::host::AdaptWorkspace workspace;
    std::vector<pgl::host::BudgetWorkspace> budget_workspaces(tiles.size());
    std::vector<std::vector<float>> areas(tiles.size(), std::vector<float>(n));
    Counts counts(n, 4242);
    const BudgetTotals totals = pgl::host::adapt_tiles(
        s.picture.rectangles, tiles, UnifyPolicy::performance, workspace,
        [&](std::size_t t, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
          for (std::size_t i = 0; i < n; ++i) areas[t][i] = flags[i] != 0 ? s.areas[i] : 0.0f;
          pgl::host::distribute_budget(areas[t], s.depths, s.least, s.most, options[t], budget_workspaces[t], out);
        },
        counts);
    RC_ASSERT(totals == totals_of(counts));
    for (std::size_t i = 0; i < n; ++i)
      RC_ASSERT(counts[i] == 0 || (counts[i] >= s.least[i] && counts[i] <= s.most[i]));
    for (std::size_t t = 0; t < tiles.size(); ++t) {
      Counts drawn(n, 4242), alone(n);
      const auto own = std::span(workspace.counts).subspan(t * n, n);
      const auto flags = std::span(workspace.flags).subspan(t * n, n);
      RC_ASSERT(pgl::host::take_unified(own, flags, counts, drawn).vertices <= options[t].budget);
      pgl::host::distribute_budget(areas[t], s.depths, s.least, s.most, options[t], budget_workspaces[t], alone);
      RC_ASSERT(std::ranges::equal(own, alone));  // the tile's own selection, as it is outside
      if (tiles.size() == 1) RC_ASSERT(counts == alone);
    }
    if (expected.empty()) expected = counts;
    RC_ASSERT(counts == expected);
  });
}

TEST(AdaptTilesProps, DoesNotDependOnTheNumberOfThreads) {
  std::mt19937 random(3);
  const test::BalanceScene scene = test::balance_scene(random, 30011, 1920, 1080, 7);
  std::vector<Tile> tiles(7);
  std::vector<std::uint64_t> loads(7);
  pgl::host::BalanceWorkspace balance_workspace;
  pgl::host::balance(scene.rectangles, scene.loads, 1920, 1080, scene.weights, {}, balance_workspace, tiles, loads);
  for (const UnifyPolicy policy : policies) {
    Counts expected;
    with_threads([&] {
      Counts counts(scene.size());
      pgl::host::AdaptWorkspace workspace;
      pgl::host::adapt_tiles(
          scene.rectangles, tiles, policy, workspace,
          [&](std::size_t t, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
            pgl::host::parallel_for(flags.size(), 512, [&](std::size_t i) {
              out[i] = flags[i] * static_cast<std::uint32_t>((i * 2654435761u + t * 40503u) % 1000);
            });
          },
          counts);
      if (expected.empty()) expected = counts;
      EXPECT_EQ(counts, expected);
    });
    EXPECT_GT(totals_of(expected).objects, 1000u);
  }
}

}  // namespace
