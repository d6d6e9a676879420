// SPDX-License-Identifier: MIT
#include "pgl/host/unify.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

namespace {

using pgl::BudgetTotals;
using pgl::UnifyPolicy;
using Counts = std::vector<std::uint32_t>;
using Flags = std::vector<std::uint8_t>;

/// Five objects, three tiles: in all, in two, in one, in none, in the last two.
const Counts counts = {9, 7, 0, 0, 0,  //
                       5, 0, 4, 0, 3,  //
                       6, 8, 0, 0, 2};

TEST(Unify, TakesTheLargestForQuality) {
  Counts unified(5, 99);
  const BudgetTotals totals = pgl::host::unify(counts, {}, 3, UnifyPolicy::quality, unified);
  EXPECT_EQ(unified, (Counts{9, 8, 4, 0, 3}));
  EXPECT_EQ(totals, (BudgetTotals{4, 24}));
}

TEST(Unify, TakesTheSmallestOfThoseThatDrawItForPerformance) {
  Counts unified(5, 99);
  const BudgetTotals totals = pgl::host::unify(counts, {}, 3, UnifyPolicy::performance, unified);
  EXPECT_EQ(unified, (Counts{5, 7, 4, 0, 2}));
  EXPECT_EQ(totals, (BudgetTotals{4, 18}));
}

TEST(Unify, LeavesOutForPerformanceWhatATileThatItTouchesLeavesOut) {
  const Flags in_tile = {1, 1, 0, 1, 0,  //
                         1, 1, 1, 0, 1,  //
                         1, 1, 0, 0, 255};
  Counts unified(5, 99);
  EXPECT_EQ(pgl::host::unify(counts, in_tile, 3, UnifyPolicy::performance, unified), (BudgetTotals{3, 11}));
  EXPECT_EQ(unified, (Counts{5, 0, 4, 0, 2}));
  EXPECT_EQ(pgl::host::unify(counts, in_tile, 3, UnifyPolicy::quality, unified), (BudgetTotals{4, 24}));
  EXPECT_EQ(unified, (Counts{9, 8, 4, 0, 3}));
}

TEST(Unify, DoesNotAskTilesThatAnObjectDoesNotTouch) {
  const Flags in_tile = {0, 0, 0, 0, 0,  //
                         0, 0, 0, 0, 0,  //
                         1, 0, 0, 0, 1};
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance}) {
    Counts unified(5, 99);
    EXPECT_EQ(pgl::host::unify(counts, in_tile, 3, policy, unified), (BudgetTotals{2, 8}));
    EXPECT_EQ(unified, (Counts{6, 0, 0, 0, 2}));
  }
}

TEST(Unify, OfOneTileIsThatTile) {
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance}) {
    Counts unified(15, 99);
    pgl::host::unify(counts, {}, 1, policy, unified);
    EXPECT_EQ(unified, counts);
  }
}

TEST(Unify, MayWriteOverATile) {
  for (std::size_t tile = 0; tile < 3; ++tile) {
    Counts all = counts;
    pgl::host::unify(all, {}, 3, UnifyPolicy::performance, std::span(all).subspan(5 * tile, 5));
    for (std::size_t i = 0; i < 15; ++i)
      EXPECT_EQ(all[i], i / 5 == tile ? (Counts{5, 7, 4, 0, 2})[i % 5] : counts[i]) << i;
  }
}

TEST(Unify, OfNothingIsNothing) {
  for (const UnifyPolicy policy : {UnifyPolicy::quality, UnifyPolicy::performance}) {
    Counts unified(3, 99);
    EXPECT_EQ(pgl::host::unify({}, {}, 0, policy, unified), BudgetTotals{});
    EXPECT_EQ(unified, Counts(3));
    EXPECT_EQ(pgl::host::unify({}, {}, 7, policy, {}), BudgetTotals{});
  }
}

TEST(TakeUnified, KeepsWhatTouchesTheTile) {
  const Counts own = {5, 0, 4, 0, 3}, unified = {9, 8, 4, 0, 3};
  Counts out(5, 99);
  EXPECT_EQ(pgl::host::take_unified(own, {}, unified, out), (BudgetTotals{3, 16}));
  EXPECT_EQ(out, (Counts{9, 0, 4, 0, 3}));
  EXPECT_EQ(pgl::host::take_unified(own, Flags{0, 7, 1, 1, 0}, unified, out), (BudgetTotals{2, 12}));
  EXPECT_EQ(out, (Counts{0, 8, 4, 0, 0}));
  Counts in_place = own;
  pgl::host::take_unified(in_place, {}, unified, in_place);
  EXPECT_EQ(in_place, (Counts{9, 0, 4, 0, 3}));
}

}  // namespace
