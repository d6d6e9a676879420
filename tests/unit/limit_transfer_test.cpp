// SPDX-License-Identifier: MIT
// Worked examples of growth under a transfer cap, and its corners.
#include "pgl/host/limit_transfer.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace {

using pgl::GrowthCost;
using pgl::Mesh;
using pgl::TransferOptions;
using pgl::TransferTotals;
using Counts = std::vector<std::uint32_t>;

constexpr std::uint64_t no_limit = ~std::uint64_t{0};

/// A mesh that has, with vertices of 10 bytes and triangles of 100:
///   vertices        2    3    4    5    6
///   triangles       1    2    4    5    8
///   bytes         120  230  440  550  860
///   one more           110  210  110  310
constexpr Mesh six{.first_map = 1, .min_vertices = 2, .max_vertices = 6};
constexpr std::uint32_t map_of_six[] = {77, 1, 2, 4, 5, 8};

/// Objects of that mesh, as heavy as their areas.
struct Scene {
  std::vector<float> areas;
  Counts previous, wanted;
  std::uint32_t fewest = 2;
  std::vector<Mesh> meshes{six};
  Counts map{std::begin(map_of_six), std::end(map_of_six)};
  TransferTotals totals{};

  Counts at(std::uint64_t cap) {
    const std::size_t n = wanted.size();
    const std::vector<float> depths(n, 1.0f);
    const Counts min_vertices(n, fewest), max_vertices(n, meshes[0].max_vertices), mesh_of_object(n, 0);
    pgl::BudgetOptions weight;
    weight.budget = 1000;
    pgl::host::TransferWorkspace workspace;
    Counts counts(n, 4242);
    totals = pgl::host::limit_transfer(areas, depths, min_vertices, max_vertices, weight, wanted, previous,
                                       mesh_of_object, meshes, map, {cap, 10, 100}, workspace, counts);
    return counts;
  }
};

TEST(GrowthBytes, AreThoseOfVerticesAndTheirTriangles) {
  constexpr TransferOptions options{no_limit, 10, 100};
  static_assert(pgl::growth_bytes(six, map_of_six, 0, 2, options) == 120);
  static_assert(pgl::growth_bytes(six, map_of_six, 2, 3, options) == 110);
  static_assert(pgl::growth_bytes(six, map_of_six, 3, 6, options) == 630);
  static_assert(pgl::growth_bytes(six, map_of_six, 5, 5, options) == 0);
  static_assert(pgl::growth_bytes(six, map_of_six, 0, 0, options) == 0);
  // The largest that there are.
  constexpr std::uint32_t all = 0xffffffffu;
  constexpr Mesh full{.min_vertices = all, .max_vertices = all};
  static_assert(pgl::growth_bytes(full, &all, 0, all, {no_limit, 65536, 65536}) == std::uint64_t{all} << 17);
}

TEST(GrowthCost, IsOfTheFirstStepAndOfTheRest) {
  constexpr TransferOptions options{no_limit, 10, 100};
  static_assert(pgl::growth_cost(six, map_of_six, 2, 6, 0, options) == GrowthCost{120, 740});
  static_assert(pgl::growth_cost(six, map_of_six, 4, 6, 0, options) == GrowthCost{440, 420});
  static_assert(pgl::growth_cost(six, map_of_six, 4, 4, 0, options) == GrowthCost{440, 0});
  static_assert(pgl::growth_cost(six, map_of_six, 4, 6, 3, options) == GrowthCost{0, 630});
}

TEST(AffordableVertices, AreTheMostThatFit) {
  constexpr TransferOptions options{no_limit, 10, 100};
  const auto grown = [&](std::uint32_t from, std::uint64_t bytes) {
    return pgl::affordable_vertices(six, map_of_six, from, 6, bytes, options);
  };
  EXPECT_EQ(grown(2, 0), 2u);
  EXPECT_EQ(grown(2, 109), 2u);
  EXPECT_EQ(grown(2, 110), 3u);
  EXPECT_EQ(grown(2, 319), 3u);
  EXPECT_EQ(grown(2, 320), 4u);
  EXPECT_EQ(grown(2, 739), 5u);
  EXPECT_EQ(grown(2, 740), 6u);
  EXPECT_EQ(grown(2, no_limit), 6u);
  EXPECT_EQ(grown(6, 5), 6u);
}

TEST(LimitTransfer, GivesFirstStepsToAllBeforeMoreToAny) {
  Scene scene{{10, 20}, {0, 0}, {6, 6}};  // the second is the heavier one
  EXPECT_EQ(scene.at(119), (Counts{0, 0}));
  EXPECT_EQ(scene.totals, (TransferTotals{0, 1720, 2}));
  EXPECT_EQ(scene.at(120), (Counts{0, 2}));
  EXPECT_EQ(scene.totals, (TransferTotals{120, 1600, 2}));
  EXPECT_EQ(scene.at(239), (Counts{0, 3}));  // what the lighter one cannot use is not lost
  EXPECT_EQ(scene.totals, (TransferTotals{230, 1490, 2}));
  EXPECT_EQ(scene.at(240), (Counts{2, 2}));
  EXPECT_EQ(scene.at(349), (Counts{2, 2}));
  EXPECT_EQ(scene.at(350), (Counts{2, 3}));
  EXPECT_EQ(scene.at(979), (Counts{2, 5}));  // the heavier one wants 310 more, the lighter one's 110 are not tried
  EXPECT_EQ(scene.totals, (TransferTotals{670, 1050, 2}));
  EXPECT_EQ(scene.at(980), (Counts{2, 6}));
  EXPECT_EQ(scene.at(1719), (Counts{5, 6}));
  EXPECT_EQ(scene.totals, (TransferTotals{1410, 310, 1}));
  EXPECT_EQ(scene.at(1720), (Counts{6, 6}));
  EXPECT_EQ(scene.totals, (TransferTotals{1720, 0, 0}));
  EXPECT_EQ(scene.at(no_limit), (Counts{6, 6}));
}

TEST(LimitTransfer, GivesALightNewObjectItsFirstStepBeforeAHeavyOneMore) {
  Scene scene{{100, 1}, {3, 0}, {6, 4}};
  EXPECT_EQ(scene.at(119), (Counts{3, 0}));  // the first step does not fit, and 119 are not enough for 210
  EXPECT_EQ(scene.at(120), (Counts{3, 2}));
  EXPECT_EQ(scene.at(330), (Counts{4, 2}));
  EXPECT_EQ(scene.at(750), (Counts{6, 2}));
  EXPECT_EQ(scene.at(860), (Counts{6, 3}));
}

TEST(LimitTransfer, LetsObjectsShrinkForNothing) {
  Scene scene{{1, 2, 3, 4}, {6, 5, 3, 0}, {2, 0, 3, 0}};
  EXPECT_EQ(scene.at(0), scene.wanted);
  EXPECT_EQ(scene.totals, TransferTotals{});
}

TEST(LimitTransfer, DoesNotPassOverWhatDoesNotFit) {
  Scene scene{{3, 2, 1}, {2, 0, 0}, {6, 2, 2}};
  EXPECT_EQ(scene.at(239), (Counts{3, 2, 0}));
  scene.previous = {2, 4, 3};
  scene.wanted = {6, 6, 4};
  EXPECT_EQ(scene.at(739), (Counts{5, 4, 3}));  // 430 used; 309 would do for the third one's 210, but its turn is later
  EXPECT_EQ(scene.totals, (TransferTotals{430, 940, 3}));
}

TEST(LimitTransfer, ServesTheLowerIndexFirstWhereWeightsTie) {
  Scene scene{{5, 5, 5}, {0, 0, 0}, {2, 2, 2}};
  EXPECT_EQ(scene.at(120), (Counts{2, 0, 0}));
  EXPECT_EQ(scene.at(240), (Counts{2, 2, 0}));
}

TEST(LimitTransfer, ServesObjectsWithoutAWeightLast) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Scene scene{{0, nan, 7}, {0, 0, 0}, {2, 2, 2}};  // wanted all the same
  EXPECT_EQ(scene.at(120), (Counts{0, 0, 2}));
  EXPECT_EQ(scene.at(240), (Counts{2, 0, 2}));
  EXPECT_EQ(scene.at(360), (Counts{2, 2, 2}));
}

TEST(LimitTransfer, DrawsAtLeastOneVertexOfAMeshWithoutAMinimum) {
  Scene scene{{1}, {0}, {3}};
  scene.fewest = 0;
  scene.meshes = {{.min_vertices = 0, .max_vertices = 3}};
  scene.map = {0, 0, 0, 1};
  EXPECT_EQ(scene.at(9), (Counts{0}));
  EXPECT_EQ(scene.at(10), (Counts{1}));
  EXPECT_EQ(scene.at(129), (Counts{2}));
  EXPECT_EQ(scene.at(130), (Counts{3}));
}

TEST(LimitTransfer, KeepsWhatWasDrawnBelowAMinimumThatRoseSince) {
  Scene scene{{1}, {3}, {5}};
  scene.fewest = 5;
  EXPECT_EQ(scene.at(0), (Counts{3}));
  EXPECT_EQ(scene.at(210), (Counts{4}));
  EXPECT_EQ(scene.at(320), (Counts{5}));
}

TEST(LimitTransfer, DoesWithoutObjects) {
  Scene scene{{}, {}, {}};
  EXPECT_EQ(scene.at(0), Counts{});
  EXPECT_EQ(scene.totals, TransferTotals{});
}

/// A camera that jumps: the most visible first, coarsely, then in detail.
TEST(LimitTransfer, BringsDetailOverSeveralFrames) {
  Scene scene{{4, 3, 2, 1}, {0, 6, 0, 0}, {6, 2, 3, 2}};
  const Counts frames[] = {{3, 2, 2, 0}, {4, 2, 2, 2}, {5, 2, 2, 2}, {6, 2, 2, 2}, {6, 2, 3, 2}, {6, 2, 3, 2}};
  for (const Counts& frame : frames) {
    scene.previous = scene.at(350);
    EXPECT_EQ(scene.previous, frame);
    EXPECT_LE(scene.totals.bytes, 350u);
  }
  EXPECT_EQ(scene.totals, TransferTotals{});
}

TEST(LimitTransfer, StopsAtAStepThatIsMoreThanTheCap) {
  Scene scene{{1}, {0}, {6}};
  for (int frame = 0; frame < 20; ++frame) scene.previous = scene.at(309);
  EXPECT_EQ(scene.previous, (Counts{5}));
  scene.previous = scene.at(310);
  EXPECT_EQ(scene.previous, (Counts{6}));
}

TEST(LeastCap, IsTheLargestStep) {
  const TransferOptions options{no_limit, 10, 100};
  const std::vector<Mesh> meshes{{}, six, {.first_map = 6, .min_vertices = 3, .max_vertices = 3}};
  const Counts map{77, 1, 2, 4, 5, 8, 2};
  const auto least = [&](std::size_t count, std::uint32_t min_triangles) {
    return pgl::host::least_cap(std::span(meshes).first(count), map, min_triangles, options);
  };
  EXPECT_EQ(least(0, 0), 0u);
  EXPECT_EQ(least(1, 0), 0u);
  EXPECT_EQ(least(2, 0), 310u);  // from 5 to 6 vertices
  EXPECT_EQ(least(2, 4), 440u);  // the first step, at 4 vertices
  EXPECT_EQ(least(2, 6), 860u);
  EXPECT_EQ(least(3, 0), 310u);
  EXPECT_EQ(pgl::host::least_cap(std::span(meshes).last(1), map, 0, options), 230u);
}

TEST(TransferOptions, AreCheckedForTheirRanges) {
  static_assert(pgl::is_valid(TransferOptions{}));
  static_assert(pgl::is_valid(TransferOptions{0, 0, 0}));
  static_assert(pgl::is_valid(TransferOptions{no_limit, 65536, 65536}));
  static_assert(!pgl::is_valid(TransferOptions{0, 65537, 0}));
  static_assert(!pgl::is_valid(TransferOptions{0, 0, 65537}));
}

}  // namespace
