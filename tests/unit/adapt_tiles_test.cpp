// SPDX-License-Identifier: MIT
#include "pgl/host/adapt_tiles.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <span>
#include <thread>
#include <vector>

namespace {

using pgl::BudgetTotals;
using pgl::ScreenBox;
using pgl::Tile;
using pgl::UnifyPolicy;
using Counts = std::vector<std::uint32_t>;
using Flags = std::vector<std::uint8_t>;

/// Left, across the middle, right, nowhere.
const std::vector<ScreenBox> rectangles = {{10, 10, 20, 20, 1}, {40, 10, 60, 20, 1}, {80, 10, 90, 20, 1}, ScreenBox{}};
const std::vector<Tile> halves = {{0, 0, 50, 40}, {50, 0, 100, 40}};

TEST(AdaptTiles, SelectsForEachTileAndUnifies) {
  const Counts selected[] = {{5, 6, 99, 99}, {99, 4, 7, 99}};
  pgl::host::AdaptWorkspace workspace;
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance}) {
    Flags seen[2];
    Counts counts(4, 4242);
    const BudgetTotals totals = pgl::host::adapt_tiles(
        rectangles, halves, policy, workspace,
        [&](std::size_t tile, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
          seen[tile].assign(flags.begin(), flags.end());
          std::copy(selected[tile].begin(), selected[tile].end(), out.begin());
        },
        counts);
    EXPECT_EQ(seen[0], (Flags{1, 1, 0, 0}));
    EXPECT_EQ(seen[1], (Flags{0, 1, 1, 0}));
    const std::uint32_t shared = policy == UnifyPolicy::quality ? 6 : 4;
    EXPECT_EQ(counts, (Counts{5, shared, 7, 0}));
    EXPECT_EQ(totals, (BudgetTotals{3, 12 + shared}));
    EXPECT_EQ(workspace.flags, (Flags{1, 1, 0, 0, 0, 1, 1, 0}));
    EXPECT_EQ(workspace.counts, (Counts{5, 6, 99, 99, 99, 4, 7, 99}));
  }
}

TEST(AdaptTiles, TakesAWorkspaceOfLargerFrames) {
  pgl::host::AdaptWorkspace workspace{Flags(1000, 7), Counts(1000, 7)};
  Counts counts(4);
  pgl::host::adapt_tiles(
      rectangles, halves, UnifyPolicy::performance, workspace,
      [](std::size_t tile, std::span<const std::uint8_t>, std::span<std::uint32_t> out) {
        std::fill(out.begin(), out.end(), 10 + static_cast<std::uint32_t>(tile));
      },
      counts);
  EXPECT_EQ(counts, (Counts{10, 10, 11, 0}));
  EXPECT_EQ(workspace.flags.size(), 1000u);
}

TEST(AdaptTiles, OfNoObjectsAsksEveryTile) {
  pgl::host::AdaptWorkspace workspace;
  std::atomic<int> calls = 0;
  EXPECT_EQ(pgl::host::adapt_tiles({}, halves, UnifyPolicy::quality, workspace,
                                   [&](std::size_t, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
                                     calls += flags.empty() && out.empty() ? 1 : 100;
                                   },
                                   {}),
            BudgetTotals{});
  EXPECT_EQ(calls, 2);
}

TEST(AdaptTiles, DrawsNothingInEmptyTiles) {
  const std::vector<Tile> tiles = {{0, 0, 100, 40}, {100, 0, 100, 40}, {0, 0, 0, 0}};
  pgl::host::AdaptWorkspace workspace;
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance}) {
    Counts counts(4);
    pgl::host::adapt_tiles(
        rectangles, tiles, policy, workspace,
        [](std::size_t tile, std::span<const std::uint8_t>, std::span<std::uint32_t> out) {
          std::fill(out.begin(), out.end(), tile == 0 ? 5 : tile == 1 ? 1 : 9);
        },
        counts);
    EXPECT_EQ(counts, (Counts{5, 5, 5, 0}));
  }
}

#if defined(_OPENMP)

/// Sets OpenMP's number of threads, and how deep they may branch, until it dies.
class Threads {
 public:
  explicit Threads(int threads, int levels = 1) { set(threads, levels); }
  ~Threads() { set(threads_, levels_); }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

 private:
  static void set(int threads, int levels) {
    omp_set_num_threads(threads);
    omp_set_max_active_levels(levels);
  }
  int threads_ = omp_get_max_threads(), levels_ = omp_get_max_active_levels();
};

TEST(AdaptTiles, GivesEachTileOneThreadAndASingleOneAll) {
  for (const int levels : {1, 2}) {
    const Threads threads(3, levels);
    pgl::host::AdaptWorkspace workspace;
    Counts counts(4);
    std::atomic<int> wrong = 0;
    const auto expect = [&](std::size_t expected) {
      return [&, expected](std::size_t, std::span<const std::uint8_t>, std::span<std::uint32_t> out) {
        if (pgl::host::thread_count() != expected) ++wrong;
        const std::thread::id own = std::this_thread::get_id();
        if (expected == 1)
          pgl::host::parallel_for(100, 1, [&](std::size_t) { wrong += std::this_thread::get_id() != own ? 1 : 0; });
        std::fill(out.begin(), out.end(), 1);
      };
    };
    pgl::host::adapt_tiles(rectangles, halves, UnifyPolicy::quality, workspace, expect(1), counts);
    EXPECT_EQ(pgl::host::thread_count(), 3u);
    pgl::host::adapt_tiles(rectangles, std::span(halves).first(1), UnifyPolicy::quality, workspace, expect(3), counts);
    EXPECT_EQ(wrong, 0);
    {
      const Threads one(1);
      pgl::host::adapt_tiles(rectangles, halves, UnifyPolicy::quality, workspace, expect(1), counts);
      EXPECT_EQ(pgl::host::thread_count(), 1u);
    }
    EXPECT_EQ(wrong, 0);
  }
}

TEST(AdaptTiles, SelectsForTilesAtTheSameTime) {
  const Threads threads(2);
  pgl::host::AdaptWorkspace workspace;
  Counts counts(4);
  std::atomic<int> begun = 0, alone = 0, elsewhere = 0;
  pgl::host::adapt_tiles(
      rectangles, halves, UnifyPolicy::quality, workspace,
      [&](std::size_t, std::span<const std::uint8_t>, std::span<std::uint32_t> out) {
        std::fill(out.begin(), out.end(), 1);
        ++begun;
        const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
        while (begun < 2 && std::chrono::steady_clock::now() < end) std::this_thread::yield();
        if (begun < 2) ++alone;
        if (pgl::host::thread_index() >= pgl::host::thread_count()) ++elsewhere;
      },
      counts);
  EXPECT_EQ(alone, 0);
  EXPECT_EQ(elsewhere, 0) << "scratch of each thread would not be there";
}

#endif

}  // namespace
