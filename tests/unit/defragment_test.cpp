// SPDX-License-Identifier: MIT
#include "pgl/host/defragment.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "pgl/host/pack_delta.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

using pgl::KeptPart;
using pgl::Landing;
using pgl::Shift;
using pgl::TicketRange;
using pgl::TileMove;
using Offsets = std::vector<std::uint64_t>;

/// The new block by every way there is; they must agree.
std::string updated(const Offsets& previous, const Offsets& offsets, const std::string& existing,
                    const std::string& additional) {
  Offsets delta_offsets(offsets.size());
  EXPECT_EQ(pgl::host::lay_out_delta(previous, offsets, delta_offsets), additional.size());
  std::string out(offsets.back(), '?');
  pgl::host::defragment<char>(previous, offsets, delta_offsets, existing, additional, out);

  pgl::host::DefragmentWorkspace workspace;
  std::string block = existing;
  block.resize(std::max(previous.back(), offsets.back()), '?');
  pgl::host::defragment_in_place<char>(previous, offsets, delta_offsets, additional, workspace, block);
  EXPECT_EQ(block.substr(0, offsets.back()), out);

  for (std::uint64_t tile_size = 1; tile_size <= offsets.back(); ++tile_size) {
    namespace in_place = pgl::host::defragment_detail;
    block = existing;
    block.resize(std::max(previous.back(), offsets.back()), '?');
    in_place::move_in_tiles(previous.data(), offsets.data(), offsets.size() - 1, {tile_size, 3}, workspace,
                            block.data());
    in_place::insert(previous.data(), offsets.data(), delta_offsets, additional.data(), block.data());
    EXPECT_EQ(block.substr(0, offsets.back()), out) << tile_size;
  }
  return out;
}

// Objects "ABCDE", "vwxyz" and "12345": a grows, b shrinks, c stays. As printed, Alg 4 takes the existing count from
// the wrong prefix.
TEST(Defragment, MergesWhatStaysAndWhatIsNew) {
  EXPECT_EQ(updated({0, 2, 6, 9}, {0, 4, 5, 8}, "ABvwxy123", "CD"), "ABCDv123");
}

TEST(Defragment, NeverTakesMoreThanTheNewCount) {
  EXPECT_EQ(updated({0, 5, 10}, {0, 2, 3}, "ABCDEvwxyz", ""), "ABv");
}

TEST(Defragment, BeginsWithNothing) {
  EXPECT_EQ(updated({0, 0, 0}, {0, 2, 5}, "", "ABvwx"), "ABvwx");
}

TEST(Defragment, EndsWithNothing) {
  EXPECT_EQ(updated({0, 2, 5}, {0, 0, 0}, "ABvwx", ""), "");
}

TEST(Defragment, OfNoObjectIsEmpty) {
  EXPECT_EQ(updated({0}, {0}, "", ""), "");
}

TEST(Defragment, LeavesTheSameSelectionAsItIs) {
  EXPECT_EQ(updated({0, 2, 2, 5}, {0, 2, 2, 5}, "ABvwx", ""), "ABvwx");
}

TEST(Defragment, MovesRightByLessThanAnObject) {
  EXPECT_EQ(updated({0, 1, 6, 11}, {0, 2, 7, 12}, "Avwxyz12345", "B"), "ABvwxyz12345");
}

TEST(Defragment, MovesLeftByLessThanAnObject) {
  EXPECT_EQ(updated({0, 2, 7, 12}, {0, 1, 6, 11}, "ABvwxyz12345", ""), "Avwxyz12345");
}

TEST(Defragment, MovesSomeLeftAndSomeRight) {
  // a shrinks, b goes left, c goes left and grows, d stays and grows, e goes right and shrinks, f goes left.
  EXPECT_EQ(updated({0, 4, 6, 8, 10, 16, 18}, {0, 1, 3, 8, 12, 13, 15}, "AaaabBCcDdEeeeeeFf", "...!!"),
            "AbBCc...Dd!!EFf");
}

TEST(DefragmentInPlace, LeavesWhatIsPastTheNewTotalAsItIs) {
  const Offsets previous{0, 3, 5}, offsets{0, 1, 3}, delta_offsets{0, 0, 0};
  pgl::host::DefragmentWorkspace workspace;
  std::string block = "ABCvwEND";
  pgl::host::defragment_in_place<char>(previous, offsets, delta_offsets, {}, workspace, block);
  EXPECT_EQ(block, "AvwvwEND");
}

TEST(DefragmentInPlace, AllocatesNothingOnceWarm) {
#if defined(_OPENMP)
  omp_set_num_threads(3);
#endif
  const std::uint64_t many = 1 << 20;
  const Offsets a{0, 5, many}, b{0, 4, many - 1}, zeros{0, 0, 0};
  pgl::host::DefragmentWorkspace workspace;
  std::vector<char> block(many);
  pgl::host::defragment_in_place<char>(a, b, zeros, {}, workspace, block);
  const auto* staging = workspace.staging.data();
  const auto* reads = workspace.reads.data();
  const std::size_t bytes = workspace.staging.size() + workspace.reads.size();
  EXPECT_LE(bytes * 25, many);
  pgl::host::defragment_in_place<char>(a, b, zeros, {}, workspace, block);
  EXPECT_EQ(workspace.staging.data(), staging);
  EXPECT_EQ(workspace.reads.data(), reads);
}

TEST(KeptPart, IsThePrefixOfTheSmallerCount) {
  const Offsets previous{0, 3, 3, 7, 9}, offsets{0, 5, 6, 7, 9};
  EXPECT_EQ(pgl::kept_part(previous.data(), offsets.data(), 0), (KeptPart{0, 0, 3}));
  EXPECT_EQ(pgl::kept_part(previous.data(), offsets.data(), 1), (KeptPart{3, 5, 0}));
  EXPECT_EQ(pgl::kept_part(previous.data(), offsets.data(), 2), (KeptPart{3, 6, 1}));
  EXPECT_EQ(pgl::kept_part(previous.data(), offsets.data(), 3), (KeptPart{7, 7, 2}));
}

TEST(PartWithin, CutsAtBothEnds) {
  const KeptPart part{100, 10, 5};
  EXPECT_EQ(pgl::part_within(part, 0, 20), part);
  EXPECT_EQ(pgl::part_within(part, 12, 20), (KeptPart{102, 12, 3}));
  EXPECT_EQ(pgl::part_within(part, 12, 14), (KeptPart{102, 12, 2}));
  EXPECT_EQ(pgl::part_within(part, 0, 11), (KeptPart{100, 10, 1}));
  EXPECT_EQ(pgl::part_within(part, 15, 20).size, 0u);
  EXPECT_EQ(pgl::part_within(part, 0, 10).size, 0u);
  EXPECT_EQ(pgl::part_within(part, 12, 12).size, 0u);
}

TEST(ObjectAt, PassesOverEmptyObjects) {
  const Offsets offsets{0, 0, 2, 2, 2, 5, 5};
  EXPECT_EQ(pgl::object_at(offsets.data(), 6, 0), 1u);
  EXPECT_EQ(pgl::object_at(offsets.data(), 6, 1), 1u);
  EXPECT_EQ(pgl::object_at(offsets.data(), 6, 2), 4u);
  EXPECT_EQ(pgl::object_at(offsets.data(), 6, 4), 4u);
}

TEST(TileMove, GoesLeftFrontToBackThenRightBackToFront) {
  const TileMove expected[] = {{0, Shift::left},  {1, Shift::left},  {2, Shift::left},
                               {2, Shift::right}, {1, Shift::right}, {0, Shift::right}};
  for (std::uint64_t ticket = 0; ticket < 6; ++ticket) EXPECT_EQ(pgl::tile_move(ticket, 3), expected[ticket]);
  EXPECT_EQ(pgl::tile_count(0, 4), 0u);
  EXPECT_EQ(pgl::tile_count(4, 4), 1u);
  EXPECT_EQ(pgl::tile_count(5, 4), 2u);
}

// The first object loses 4 elements, the other 12 go left by 4. Tiles of 4: what tile t writes over, tile t - 1 reads.
TEST(TicketsBeforeWrite, AreTheTilesThatReadWhereThisOneWrites) {
  const Offsets previous{0, 4, 16}, offsets{0, 0, 12};
  const auto before = [&](std::uint64_t ticket) {
    return pgl::tickets_before_write(previous.data(), offsets.data(), 2, 4, ticket);
  };
  EXPECT_EQ(pgl::landing(previous.data(), offsets.data(), 2, 4, 8), (Landing{0, 4}));
  const TicketRange none = before(0);
  EXPECT_GE(none.first, none.last);
  EXPECT_EQ(before(1), (TicketRange{0, 1}));
  EXPECT_EQ(before(2), (TicketRange{1, 2}));
}

// The other way: everything goes right by 4, and tile t writes where tile t + 1 reads.
TEST(TicketsBeforeWrite, AreOfHigherTilesForMovesToTheRight) {
  const Offsets previous{0, 0, 12}, offsets{0, 4, 16};
  const auto before = [&](std::uint64_t ticket) {
    return pgl::tickets_before_write(previous.data(), offsets.data(), 2, 4, ticket);
  };
  // Tickets 4, 5, 6, 7 are tiles 3, 2, 1, 0.
  EXPECT_GE(before(4).first, before(4).last);
  EXPECT_EQ(before(5), (TicketRange{4, 5}));
  EXPECT_EQ(before(6), (TicketRange{5, 6}));
}

TEST(Defragment, ChecksItsInputInDebugBuilds) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto run = [](const Offsets& previous, const Offsets& offsets, const Offsets& delta_offsets,
                      std::size_t existing_size, std::size_t additional_size, std::size_t room, bool in_place) {
    const std::string existing(existing_size, 'e'), additional(additional_size, 'a');
    std::string out(room, '?');
    pgl::host::DefragmentWorkspace workspace;
    if (in_place) {
      pgl::host::defragment_in_place<char>(previous, offsets, delta_offsets, additional, workspace, out);
    } else {
      pgl::host::defragment<char>(previous, offsets, delta_offsets, existing, additional, out);
    }
  };
  for (const bool in_place : {false, true}) {
    run({0, 2}, {0, 3}, {0, 1}, 2, 1, 3, in_place);
    EXPECT_DEATH(run({0, 2}, {0, 3}, {0, 1}, 2, 1, 2, in_place), "size");
    EXPECT_DEATH(run({0, 2}, {0, 3}, {0, 1}, 2, 0, 3, in_place), "additional.size");
    EXPECT_DEATH(run({0, 2}, {0, 3}, {0, 2}, 2, 2, 3, in_place), "delta_offsets");
    EXPECT_DEATH(run({0, 2}, {0, 3, 3}, {0, 1, 1}, 2, 1, 3, in_place), "previous_offsets.size");
    EXPECT_DEATH(run({1, 2}, {0, 3}, {0, 1}, 2, 1, 3, in_place), "front");
    EXPECT_DEATH(run({0, 3, 2}, {0, 3, 4}, {0, 0, 1}, 3, 1, 4, in_place), "previous_offsets");
    EXPECT_DEATH(run({}, {}, {}, 0, 0, 0, in_place), "empty");
  }
  EXPECT_DEATH(run({0, 2}, {0, 1}, {0, 0}, 1, 0, 3, false), "existing.size");
  EXPECT_DEATH(run({0, 2}, {0, 1}, {0, 0}, 0, 0, 1, true), "block.size");
}

}  // namespace
