// SPDX-License-Identifier: MIT
// What must hold of unified counts: tiles agree, and each mode keeps what it promises.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include "pgl/host/select_by_error.hpp"
#include "pgl/host/unify.hpp"
#include "support/error_scenes.hpp"

namespace {

using pgl::BudgetTotals;
using pgl::UnifyPolicy;
using Counts = std::vector<std::uint32_t>;
using Flags = std::vector<std::uint8_t>;

struct Tiles {
  std::size_t tiles = 0, n = 0;
  Counts counts;
  Flags in_tile;
};

/// Counts of 0 or in the object's range; most objects touch few tiles, and a tile may leave out what touches it.
Tiles random_tiles(std::mt19937& random, std::size_t n) {
  Tiles t;
  t.tiles = random() % 3 == 0 ? random() % 65 : random() % 5;
  t.n = n;
  for (std::size_t k = 0; k < t.tiles * n; ++k) {
    const bool touches = random() % 3 == 0;
    t.in_tile.push_back(touches ? static_cast<std::uint8_t>(1 + random() % 255) : 0);
    const std::uint32_t least = static_cast<std::uint32_t>(k % n);
    t.counts.push_back(touches && random() % 5 != 0 ? least + static_cast<std::uint32_t>(random() % 20) : 0);
    if (random() % 200 == 0) t.counts.back() = 0xfffffffeu;
  }
  return t;
}

/// Tile by tile, an object at a time, by what the words say.
Counts told(const Tiles& t, bool by_flags, UnifyPolicy policy) {
  Counts unified;
  for (std::size_t i = 0; i < t.n; ++i) {
    std::optional<std::uint32_t> chosen;
    for (std::size_t k = i; k < t.counts.size(); k += t.n) {
      if (by_flags ? t.in_tile[k] == 0 : t.counts[k] == 0) continue;
      if (!chosen)
        chosen = t.counts[k];
      else if (policy == UnifyPolicy::quality)
        chosen = std::max(*chosen, t.counts[k]);
      else
        chosen = std::min(*chosen, t.counts[k]);
    }
    unified.push_back(chosen.value_or(0));
  }
  return unified;
}

BudgetTotals totals_of(const Counts& counts) {
  BudgetTotals totals;
  for (const std::uint32_t count : counts) totals += {count > 0 ? 1u : 0u, count};
  return totals;
}

RC_GTEST_PROP(UnifyProps, tilesAgreeAndEachModeKeepsItsPromise, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  const Tiles t = random_tiles(random, random() % 70);
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance})
    for (const bool by_flags : {false, true}) {
      const Flags in_tile = by_flags ? t.in_tile : Flags{};
      Counts unified(t.n, 4242);
      const BudgetTotals totals = pgl::host::unify(t.counts, in_tile, t.tiles, policy, unified);
      RC_ASSERT(unified == told(t, by_flags, policy));
      RC_ASSERT(totals == totals_of(unified));
      for (std::size_t tile = 0; tile < t.tiles; ++tile) {
        const auto own = std::span(t.counts).subspan(tile * t.n, t.n);
        const auto touches = std::span(in_tile).subspan(by_flags ? tile * t.n : 0, by_flags ? t.n : 0);
        Counts drawn(t.n, 4242);
        const BudgetTotals in_tile_totals = pgl::host::take_unified(own, touches, unified, drawn);
        RC_ASSERT(in_tile_totals == totals_of(drawn));
        for (std::size_t i = 0; i < t.n; ++i) {
          if (by_flags ? touches[i] == 0 : own[i] == 0) {
            RC_ASSERT(drawn[i] == 0u);
            continue;
          }
          RC_ASSERT(drawn[i] == unified[i]);  // the same in every tile that it touches
          RC_ASSERT((policy == UnifyPolicy::quality ? drawn[i] >= own[i] : drawn[i] <= own[i]));
        }
      }
    }
}

RC_GTEST_PROP(UnifyProps, theOrderOfTheTilesDoesNotMatter, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  const Tiles t = random_tiles(random, 20);
  std::vector<std::size_t> order(t.tiles);
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::shuffle(order.begin(), order.end(), random);
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance}) {
    Counts shuffled, unified(t.n), again(t.n);
    Flags flags;
    for (const std::size_t tile : order)
      for (std::size_t i = 0; i < t.n; ++i) {
        shuffled.push_back(t.counts[tile * t.n + i]);
        flags.push_back(t.in_tile[tile * t.n + i]);
      }
    pgl::host::unify(t.counts, t.in_tile, t.tiles, policy, unified);
    pgl::host::unify(shuffled, flags, t.tiles, policy, again);
    RC_ASSERT(unified == again);
    // Or by keys, two halves first, as several processes would.
    for (std::size_t i = 0; i < t.n; ++i) {
      std::uint32_t halves[2] = {pgl::no_unify_key(policy), pgl::no_unify_key(policy)};
      for (std::size_t tile = 0; tile < t.tiles; ++tile) {
        const std::size_t k = tile * t.n + i;
        const std::uint32_t key = pgl::unify_key(t.counts[k], t.in_tile[k] != 0, policy);
        halves[tile % 2] =
            policy == UnifyPolicy::quality ? std::max(halves[tile % 2], key) : std::min(halves[tile % 2], key);
      }
      RC_ASSERT(pgl::unified_vertices(pgl::combined_key(halves[0], halves[1], policy)) == unified[i]);
    }
  }
}

/// Tiles with thresholds of their own: what quality unifies is what the strictest of an object's tiles takes.
RC_GTEST_PROP(UnifyProps, qualityKeepsTheStrictestThreshold, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  test::ErrorScene scene = test::error_scene(random, 50);
  Counts counts, unified(scene.size()), strictest(scene.size());
  const auto select = [&](Counts& out) {
    pgl::host::select_by_error(scene.areas, scene.depths, scene.min_vertices, scene.max_vertices, scene.scales,
                               scene.mesh_of_object, scene.meshes, scene.errors, scene.view, scene.options, out);
  };
  for (const float threshold : {4.0f, 0.5f, 1.0f}) {
    Counts of_tile(scene.size());
    scene.options.threshold = threshold;
    select(of_tile);
    counts.insert(counts.end(), of_tile.begin(), of_tile.end());
  }
  pgl::host::unify(counts, {}, 3, UnifyPolicy::quality, unified);
  scene.options.threshold = 0.5f;
  select(strictest);
  RC_ASSERT(unified == strictest);
}

TEST(UnifyProps, DoesNotDependOnTheNumberOfThreads) {
  std::mt19937 random(1);
  Tiles t = random_tiles(random, 50021);
  while (t.tiles < 2) t = random_tiles(random, 50021);
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance}) {
    Counts expected(t.n);
    const BudgetTotals totals = pgl::host::unify(t.counts, t.in_tile, t.tiles, policy, expected);
    EXPECT_GT(totals.objects, 0u);
#if defined(_OPENMP)
    const int threads = omp_get_max_threads();
    for (const int n : {1, 2, 5}) {
      omp_set_num_threads(n);
      Counts again(t.n);
      EXPECT_EQ(pgl::host::unify(t.counts, t.in_tile, t.tiles, policy, again), totals);
      EXPECT_EQ(again, expected);
    }
    omp_set_num_threads(threads);
#endif
  }
}

}  // namespace
