// SPDX-License-Identifier: MIT
// Worked examples of sharing a budget, and its corners: bad numbers, extreme sizes, empty scenes, layout.
#include "pgl/host/distribute_budget.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

namespace {

using pgl::BudgetOptions;
using pgl::BudgetPolicy;
using pgl::Mesh;
using Counts = std::vector<std::uint32_t>;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr std::uint64_t two_32 = std::uint64_t{1} << 32;

struct Scene {
  std::vector<float> areas;
  std::vector<float> depths;
  Counts min_vertices;
  Counts max_vertices;
};

struct Result {
  Counts counts;
  pgl::host::BudgetTotals totals;
};

Result distribute(const Scene& scene, const BudgetOptions& options) {
  pgl::host::BudgetWorkspace workspace;
  Result result{Counts(scene.areas.size(), 12345), {}};
  result.totals = pgl::host::distribute_budget(scene.areas, scene.depths, scene.min_vertices, scene.max_vertices,
                                               options, workspace, result.counts);
  EXPECT_EQ(result.totals.vertices, std::accumulate(result.counts.begin(), result.counts.end(), std::uint64_t{0}));
  EXPECT_EQ(result.totals.objects, result.counts.size() - static_cast<std::size_t>(std::count(
                                                              result.counts.begin(), result.counts.end(), 0u)));
  return result;
}

BudgetOptions budget(std::uint64_t n, float alpha = 2.0f, BudgetPolicy policy = BudgetPolicy::exact) {
  BudgetOptions options;
  options.budget = n;
  options.alpha = alpha;
  options.policy = policy;
  return options;
}

/// With alpha = 2 the parts are in the ratio sqrt(A/D*P): here 1 : 2 : 4, the last being the heaviest.
Scene one_two_four(const Counts& min_vertices) {
  return {{1, 4, 16}, {1, 1, 1}, min_vertices, {64, 64, 64}};
}

TEST(DistributeBudget, SharesInProportion) {
  EXPECT_EQ(distribute(one_two_four({0, 0, 0}), budget(70)).counts, (Counts{10, 20, 40}));
  // Four times as far away is a quarter of the weight.
  EXPECT_EQ(distribute({{16, 16, 16}, {16, 4, 1}, {0, 0, 0}, {64, 64, 64}}, budget(70)).counts, (Counts{10, 20, 40}));
  // With alpha = 3 the parts are (A/D)^(1/3) * P^(2/3).
  EXPECT_EQ(distribute({{1, 8, 8}, {1, 1, 1}, {0, 0, 0}, {64, 64, 512}}, budget(110, 3.0f)).counts,
            (Counts{10, 20, 80}));
}

TEST(DistributeBudget, GivesTheRemainderToTheHeaviest) {
  EXPECT_EQ(distribute(one_two_four({0, 0, 0}), budget(71)).counts, (Counts{10, 20, 41}));
  // All equal: the lowest index is the heaviest.
  EXPECT_EQ(distribute({{4, 4, 4, 4}, {1, 1, 1, 1}, {0, 0, 0, 0}, {9, 9, 9, 9}}, budget(10)).counts,
            (Counts{4, 2, 2, 2}));
}

TEST(DistributeBudget, LiftsTheHeaviestFirst) {
  // Parts 16 : 8 : 8 of 64 are 32, 16, 16; the first can only take 16. The second and third tie.
  EXPECT_EQ(distribute({{16, 1, 1}, {1, 1, 1}, {0, 0, 0}, {16, 64, 64}}, budget(64)).counts, (Counts{16, 32, 16}));
}

TEST(DistributeBudget, DrawsEverythingWhenTheBudgetAllowsIt) {
  const Result result = distribute(one_two_four({8, 8, 8}), budget(two_32));
  EXPECT_EQ(result.counts, (Counts{64, 64, 64}));
  EXPECT_EQ(result.totals, (pgl::host::BudgetTotals{3, 192}));
  EXPECT_EQ(distribute(one_two_four({8, 8, 8}), budget(192)).counts, (Counts{64, 64, 64}));
  EXPECT_EQ(distribute(one_two_four({8, 8, 8}), budget(191)).totals.vertices, 191u);
}

TEST(DistributeBudget, LetsTheObjectAtTheCutTakeTheRemainder) {
  // Clamped shares 10, 25, 40 are 5 too many; the lightest may be drawn with 5.
  EXPECT_EQ(distribute(one_two_four({4, 25, 8}), budget(70)).counts, (Counts{5, 25, 40}));
  EXPECT_EQ(distribute(one_two_four({5, 25, 8}), budget(70)).counts, (Counts{5, 25, 40}));
}

TEST(DistributeBudget, GivesBackWhatTheObjectAtTheCutCannotTake) {
  EXPECT_EQ(distribute(one_two_four({6, 25, 8}), budget(70)).counts, (Counts{0, 25, 45}));
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), budget(70)).counts, (Counts{0, 20, 50}));
}

TEST(DistributeBudget, StaysBelowTheBudgetOnlyWhenAllThatIsDrawnIsComplete) {
  // 10, 40, 40: the middle one would be left with 30 of its 40, and the heaviest can only be lifted to 64.
  EXPECT_EQ(distribute(one_two_four({8, 40, 8}), budget(70)).counts, (Counts{0, 0, 64}));
}

TEST(DistributeBudget, PassesOverObjectsThatNoBudgetCouldDraw) {
  // The heaviest needs 65 at least.
  const Scene scene{{1, 4, 1000}, {1, 1, 1}, {2, 2, 65}, {64, 64, 80}};
  EXPECT_EQ(distribute(scene, budget(60)).counts, (Counts{20, 40, 0}));
  EXPECT_EQ(distribute(scene, budget(65)).counts[2], 65u);
  EXPECT_EQ(distribute({{1, 4}, {1, 1}, {9, 8}, {20, 20}}, budget(7)).totals, (pgl::host::BudgetTotals{0, 0}));
}

TEST(DistributeBudget, FindsTheCutAmongEqualWeightsByIndex) {
  // 1000 equal objects of 3 to 9 vertices: 333 of them fit at 3, one vertex is left over.
  constexpr std::size_t n = 1000;
  const Scene scene{std::vector<float>(n, 5.0f), std::vector<float>(n, 2.0f), Counts(n, 3), Counts(n, 9)};
  Counts expected(n, 0);
  std::fill(expected.begin(), expected.begin() + 333, 3u);
  expected[0] = 4;
  EXPECT_EQ(distribute(scene, budget(1000)).counts, expected);
}

TEST(DistributeBudget, DrawsNothingWithoutBudget) {
  for (const BudgetPolicy policy : {BudgetPolicy::exact, BudgetPolicy::fair, BudgetPolicy::paper}) {
    EXPECT_EQ(distribute(one_two_four({0, 0, 0}), budget(0, 2.0f, policy)).counts, (Counts{0, 0, 0}));
    EXPECT_EQ(distribute(one_two_four({1, 1, 1}), budget(0, 2.0f, policy)).counts, (Counts{0, 0, 0}));
  }
}

TEST(DistributeBudget, AcceptsNoObjects) {
  for (const BudgetPolicy policy : {BudgetPolicy::exact, BudgetPolicy::fair, BudgetPolicy::paper})
    EXPECT_EQ(distribute({}, budget(100, 2.0f, policy)).totals, (pgl::host::BudgetTotals{0, 0}));
}

TEST(DistributeBudget, AcceptsOneObject) {
  const Scene scene{{3}, {1}, {10}, {20}};
  EXPECT_EQ(distribute(scene, budget(9)).counts, (Counts{0}));
  EXPECT_EQ(distribute(scene, budget(10)).counts, (Counts{10}));
  EXPECT_EQ(distribute(scene, budget(13)).counts, (Counts{13}));
  EXPECT_EQ(distribute(scene, budget(21)).counts, (Counts{20}));
}

TEST(DistributeBudget, GivesCulledObjectsNothing) {
  const Scene scene{{0, -0.0f, -1, nan, 0.99f, 1.0f, 100, 100, 100, 100},
                    {1, 1, 1, 1, 1, 1, inf, nan, 1, 1},
                    {1, 1, 1, 1, 1, 1, 1, 1, 0, 1},
                    {9, 9, 9, 9, 9, 9, 9, 9, 0, 9}};
  EXPECT_EQ(distribute(scene, budget(1000)).counts, (Counts{0, 0, 0, 0, 0, 9, 0, 0, 0, 9}));
  BudgetOptions options = budget(1000);
  options.pet = 0;
  EXPECT_EQ(distribute(scene, options).counts, (Counts{0, 0, 0, 0, 9, 9, 0, 0, 0, 9}));
  options.pet = inf;
  EXPECT_EQ(distribute(scene, options).totals.objects, 0u);
}

TEST(DistributeBudget, ClampsDepthAndArea) {
  BudgetOptions options = budget(70);
  options.near_depth = 2;
  options.viewport_area = 32;
  EXPECT_EQ(distribute({{2, 8, 1e30f}, {-inf, 0, 1}, {0, 0, 0}, {64, 64, 64}}, options).counts, (Counts{10, 20, 40}));
  EXPECT_EQ(distribute({{2, 8, inf}, {-1, 1e-40f, 2}, {0, 0, 0}, {64, 64, 64}}, options).counts, (Counts{10, 20, 40}));
  options.viewport_area = inf;  // now the largest float
  EXPECT_EQ(distribute({{inf, 1e30f}, {1, 1}, {0, 0}, {64, 64}}, options).counts, (Counts{64, 6}));
}

TEST(DistributeBudget, SurvivesTheLargestSizes) {
  constexpr std::uint32_t two_31 = std::uint32_t{1} << 31;
  for (const BudgetPolicy policy : {BudgetPolicy::exact, BudgetPolicy::fair})
    for (const float alpha : {std::nextafter(1.0f, 2.0f), 3.0f, 64.0f}) {
      const std::size_t n = 5;
      Scene scene{std::vector<float>(n, inf), std::vector<float>(n, 0.0f), Counts(n, two_31), Counts(n, two_31)};
      BudgetOptions options = budget(two_32, alpha, policy);
      options.near_depth = std::numeric_limits<float>::denorm_min();
      EXPECT_EQ(distribute(scene, options).counts, (Counts{two_31, two_31, 0, 0, 0}));
      scene.min_vertices.assign(n, 0);
      EXPECT_EQ(distribute(scene, options).totals.vertices, two_32);
      scene.max_vertices.assign(n, ~std::uint32_t{0});
      EXPECT_EQ(distribute(scene, options).totals.vertices, two_32);
      scene.areas.assign(n, 0.0f);
      scene.areas[3] = 1.0f;
      EXPECT_EQ(distribute(scene, options).counts, (Counts{0, 0, 0, ~std::uint32_t{0}, 0}));
    }
}

TEST(DistributeBudget, FairPolicySharesInProportionWithinTheRanges) {
  const auto fair = [](std::uint64_t n) { return budget(n, 2.0f, BudgetPolicy::fair); };
  EXPECT_EQ(distribute(one_two_four({0, 0, 0}), fair(70)).counts, (Counts{10, 20, 40}));
  EXPECT_EQ(distribute(one_two_four({0, 0, 0}), fair(160)).counts, (Counts{32, 64, 64}));  // level 128
  // Level 41 takes 10 + 20 + 41, level 42 one too many: the heaviest gets the remainder.
  EXPECT_EQ(distribute(one_two_four({0, 0, 0}), fair(72)).counts, (Counts{10, 20, 42}));
  // Level 30 takes 20 + 20 + 30: the heaviest pays for what the others' minima take.
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), fair(70)).counts, (Counts{20, 20, 30}));
  // The minimum of the heaviest alone is above its part.
  EXPECT_EQ(distribute(one_two_four({0, 0, 50}), fair(80)).counts, (Counts{10, 20, 50}));
  // Parts 2 : 1 : 1, the first complete with 16: the others share the rest, where exact lifts the heavier of the two.
  EXPECT_EQ(distribute({{16, 1, 1}, {1, 1, 1}, {0, 0, 0}, {16, 64, 64}}, fair(64)).counts, (Counts{16, 24, 24}));
  EXPECT_EQ(distribute(one_two_four({8, 8, 8}), fair(191)).counts, (Counts{63, 64, 64}));
  EXPECT_EQ(distribute(one_two_four({8, 8, 8}), fair(192)).counts, (Counts{64, 64, 64}));
  EXPECT_EQ(distribute(one_two_four({8, 8, 8}), fair(two_32)).counts, (Counts{64, 64, 64}));
}

TEST(DistributeBudget, FairPolicyLeavesObjectsOutOnlyWhenTheMinimaExceedTheBudget) {
  const auto fair = [](std::uint64_t n) { return budget(n, 2.0f, BudgetPolicy::fair); };
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), fair(60)).counts, (Counts{20, 20, 20}));
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), budget(60)).counts, (Counts{0, 20, 40}));
  EXPECT_EQ(distribute(one_two_four({8, 40, 8}), fair(70)).counts, (Counts{8, 40, 22}));
  EXPECT_EQ(distribute(one_two_four({8, 40, 8}), budget(70)).counts, (Counts{0, 0, 64}));
  // Below the sum of the minima the lightest go, and what they leave goes to the heaviest.
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), fair(59)).counts, (Counts{0, 20, 39}));
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), fair(40)).counts, (Counts{0, 20, 20}));
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), fair(39)).counts, (Counts{0, 0, 39}));
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), fair(19)).counts, (Counts{0, 0, 0}));
  EXPECT_EQ(distribute(one_two_four({1, 64, 8}), fair(70)).counts, (Counts{0, 0, 64}));
  // The heaviest needs more than there is: it does not count.
  EXPECT_EQ(distribute({{1, 4, 1000}, {1, 1, 1}, {2, 2, 65}, {64, 64, 80}}, fair(60)).counts, (Counts{20, 40, 0}));
}

TEST(DistributeBudget, FairPolicyDrawsTheManyBesideTheFew) {
  // 8 large objects, and 1024 small ones of a 128th of their part, which need 8 vertices at least.
  Scene scene{std::vector<float>(1032, 1.0f), std::vector<float>(1032, 1.0f), Counts(1032, 8), Counts(1032, 1024)};
  std::fill(scene.areas.begin(), scene.areas.begin() + 8, 0x1p14f);
  // Exact: 640 for each large one, which leaves 5120, and the 5 of each small one become 8: 640 of them fit.
  EXPECT_EQ(distribute(scene, budget(10240)).totals, (pgl::host::BudgetTotals{648, 10240}));
  // Fair: 8 for each small one, which leaves 256 for each large one.
  Counts expected(1032, 8);
  std::fill(expected.begin(), expected.begin() + 8, 256u);
  EXPECT_EQ(distribute(scene, budget(10240, 2.0f, BudgetPolicy::fair)).counts, expected);
}

TEST(DistributeBudget, FairPolicySearchesLevelsOfTwelveBits) {
  const Scene scene{{1, 4}, {1, 1}, {0, 0}, {20000, 20000}};
  const auto fair = [&](std::uint64_t n) { return distribute(scene, budget(n, 2.0f, BudgetPolicy::fair)).counts; };
  EXPECT_EQ(fair(12300), (Counts{4100, 8200}));
  EXPECT_EQ(fair(12305), (Counts{4100, 8205}));  // the next level is 8204
  EXPECT_EQ(fair(12306), (Counts{4102, 8204}));
}

TEST(BudgetLevel, HasTwelveSignificantBits) {
  EXPECT_EQ(pgl::budget_level(0), 0u);
  for (const std::uint32_t k : {1u, 2047u, 2048u, 4095u, 4096u}) EXPECT_EQ(pgl::budget_level(k), k);
  EXPECT_EQ(pgl::budget_level(4097), 4098u);
  EXPECT_EQ(pgl::budget_level(6143), 8190u);
  EXPECT_EQ(pgl::budget_level(6144), 8192u);
  EXPECT_EQ(pgl::budget_level(6145), 8196u);
  EXPECT_EQ(pgl::budget_level(pgl::budget_levels - 1), std::uint64_t{0xfff} << 51);
}

TEST(LevelVertices, AreExactAtTheExtremes) {
  constexpr std::uint32_t one = std::uint32_t{1} << 31, most = ~std::uint32_t{0};
  constexpr std::uint64_t top = std::uint64_t{0xfff} << 51;
  EXPECT_EQ(pgl::level_vertices(top, one, 0, most), most);
  EXPECT_EQ(pgl::level_vertices(top, 1, 0, most), 0xfff00000u);
  EXPECT_EQ(pgl::level_vertices(top, 0, 3, most), 3u);
  EXPECT_EQ(pgl::level_vertices(0, one, 3, most), 3u);
  EXPECT_EQ(pgl::level_vertices(3, one - 1, 0, most), 2u);
  EXPECT_EQ(pgl::level_vertices(two_32 - 1, one, 0, most), most);
  EXPECT_EQ(pgl::level_vertices((std::uint64_t{1} << 62) + one - 1, 3, 0, 7), 7u);
  EXPECT_EQ(pgl::level_vertices((std::uint64_t{1} << 33) + one - 1, 3, 0, most), 14u);
}

TEST(DistributeBudget, FairPolicyReachesObjectsOfTheSmallestShares) {
  // The part of the lighter one is 2^-31 of the heavier one's, and 2^-40, which counts as 0.
  for (const float area : {0x1p31f, 0x1p40f}) {
    const Scene scene{{1, area}, {1, 1}, {2, 0}, {~std::uint32_t{0}, 1}};
    const auto fair = [](std::uint64_t n) { return budget(n, std::nextafter(1.0f, 2.0f), BudgetPolicy::fair); };
    EXPECT_EQ(distribute(scene, fair(two_32)).counts, (Counts{~std::uint32_t{0}, 1}));
    EXPECT_EQ(distribute(scene, fair(two_32 - 1)).counts, (Counts{~std::uint32_t{0} - 1, 1}));
    EXPECT_EQ(distribute(scene, fair(2)).counts, (Counts{2, 0}));
  }
}

TEST(DistributeBudget, PaperPolicyCanStayOverTheBudget) {
  // 20, 20, 40 is 10 too many; the lightest has more than these 10, so that nothing is left out.
  EXPECT_EQ(distribute(one_two_four({20, 20, 20}), budget(70, 2.0f, BudgetPolicy::paper)).counts, (Counts{20, 20, 40}));
  // 15, 20, 40 of 60: exactly the lightest is in excess. With one more in the budget it is not left out.
  EXPECT_EQ(distribute(one_two_four({15, 20, 40}), budget(60, 2.0f, BudgetPolicy::paper)).counts, (Counts{0, 20, 40}));
  EXPECT_EQ(distribute(one_two_four({15, 20, 40}), budget(61, 2.0f, BudgetPolicy::paper)).counts, (Counts{15, 20, 40}));
}

TEST(DistributeBudget, PaperPolicyMissesTheBudget) {
  // 10, 20, 40 lacks one vertex, but the heaviest would need 24.
  EXPECT_EQ(distribute(one_two_four({0, 0, 0}), budget(71, 2.0f, BudgetPolicy::paper)).counts, (Counts{10, 20, 40}));
}

TEST(DistributeBudget, PaperPolicyLiftsCulledObjects) {
  const Scene scene{{0, 4, nan}, {1, 1, 1}, {1, 1, 1}, {7, 64, 9}};
  EXPECT_EQ(distribute(scene, budget(80, 2.0f, BudgetPolicy::paper)).counts, (Counts{7, 64, 9}));
  EXPECT_EQ(distribute(scene, budget(79, 2.0f, BudgetPolicy::paper)).counts, (Counts{7, 64, 0}));
  EXPECT_EQ(distribute({{0}, {1}, {1}, {7}}, budget(8, 2.0f, BudgetPolicy::paper)).counts, (Counts{7}));
}

TEST(DistributeBudget, ReusesItsWorkspace) {
  pgl::host::BudgetWorkspace workspace;
  const auto run = [&](std::size_t n, const BudgetOptions& options) {
    Scene scene{{}, std::vector<float>(n, 2.0f), Counts(n, 2), Counts(n, 100)};
    for (std::size_t i = 0; i < n; ++i) scene.areas.push_back(static_cast<float>(i * 7 % 50));
    Counts counts(n);
    pgl::host::distribute_budget(scene.areas, scene.depths, scene.min_vertices, scene.max_vertices, options, workspace,
                                 counts);
    EXPECT_EQ(counts, distribute(scene, options).counts);
  };
  run(5000, budget(9000));
  const void* const keys = workspace.keys.data();
  const void* const buckets = workspace.buckets.data();
  for (const std::size_t n : {5000, 10, 1, 0, 4999})
    for (const std::uint64_t b : {0, 100, 20000, 1000000}) run(n, budget(b));
  EXPECT_EQ(keys, workspace.keys.data());
  EXPECT_EQ(buckets, workspace.buckets.data());
}

TEST(LogWeight, IsExactForPowersOfTwo) {
  EXPECT_EQ(pgl::log_weight(8, 2, 1, 16, budget(9, 3.0f)), 2.0f + 2 * 4);
  EXPECT_EQ(pgl::log_weight(1, 1, 1, 1, budget(9, 64.0f)), 0.0f);
  EXPECT_FALSE(std::signbit(pgl::log_weight(1, 1, 1, 1, budget(9, 64.0f))));
  EXPECT_EQ(pgl::log_weight(0x1p100f, 0x1p-10f, 0, std::uint32_t{1} << 31,
                            [] {
                              BudgetOptions options = budget(9, 64.0f);
                              options.near_depth = 0x1p-20f;
                              return options;
                            }()),
            110.0f + 63 * 31);
}

TEST(ShareWeight, IsExactForPowersOfTwo) {
  EXPECT_EQ(pgl::share_weight(7.25f, 7.25f, 3.0f), std::uint32_t{1} << 31);
  EXPECT_EQ(pgl::share_weight(1.0f, 7.0f, 3.0f), std::uint32_t{1} << 29);
  EXPECT_EQ(pgl::share_weight(-31.0f, 0.0f, std::nextafter(1.0f, 2.0f)), 1u);
  EXPECT_EQ(pgl::share_weight(-33.0f, 0.0f, std::nextafter(1.0f, 2.0f)), 0u);
  EXPECT_EQ(pgl::share_weight(-2300.0f, 2300.0f, std::nextafter(1.0f, 2.0f)), 0u);
  EXPECT_EQ(pgl::share_weight(-inf, 5.0f, 3.0f), 0u);
}

TEST(BudgetOptionsAre, ValidInTheirRangesOnly) {
  const auto with = [](auto change) {
    BudgetOptions options;
    change(options);
    return pgl::is_valid(options);
  };
  EXPECT_TRUE(pgl::is_valid(BudgetOptions{}));
  EXPECT_TRUE(with([](auto& o) { o.budget = two_32; }));
  EXPECT_FALSE(with([](auto& o) { o.budget = two_32 + 1; }));
  EXPECT_TRUE(with([](auto& o) { o.alpha = std::nextafter(1.0f, 2.0f); }));
  EXPECT_TRUE(with([](auto& o) { o.alpha = 64.0f; }));
  for (const float bad : {1.0f, 65.0f, inf, nan}) EXPECT_FALSE(with([&](auto& o) { o.alpha = bad; }));
  for (const float bad : {-1.0f, nan}) EXPECT_FALSE(with([&](auto& o) { o.pet = bad; }));
  for (const float bad : {0.0f, -1.0f, inf, nan}) EXPECT_FALSE(with([&](auto& o) { o.near_depth = bad; }));
  for (const float bad : {0.0f, -1.0f, nan}) EXPECT_FALSE(with([&](auto& o) { o.viewport_area = bad; }));
}

TEST(WeightKey, OrdersByWeightThenByLowerIndex) {
  std::vector<std::uint64_t> keys;  // heaviest first
  for (const float weight : {2300.0f, 1.5f, 1e-45f, 0.0f, -1e-45f, -2300.0f})
    for (const std::uint32_t object : {0u, 1u, 77u, 0x80000000u}) {
      keys.push_back(pgl::weight_key(weight, object));
      EXPECT_EQ(pgl::object_of_key(keys.back()), object);
      EXPECT_EQ(pgl::weight_of_key(keys.back()), weight);
    }
  EXPECT_TRUE(std::is_sorted(keys.rbegin(), keys.rend()));
  EXPECT_LT(pgl::weight_key(-inf, 0), pgl::least_eligible_key());
  EXPECT_GE(keys.back(), pgl::least_eligible_key());
  EXPECT_GT(pgl::weight_key(-inf, ~0u), 0u);
}

/// Two meshes of one model: map entries of the first are 0, 0, 2, 5, 5, 9 for 3 to 8 vertices, of the second 4 for 6.
struct Model {
  std::vector<Mesh> meshes{{0, 0, 1, 3, 8}, {8, 9, 7, 6, 6}};
  Counts map{99, 0, 0, 2, 5, 5, 9, 4, 99};
};

TEST(MinimumVertices, IsTheFirstCountWithEnoughTriangles) {
  const Model model;
  const auto first = [&](std::uint32_t t) { return pgl::minimum_vertices(model.meshes[0], model.map.data(), t); };
  EXPECT_EQ(first(0), 3u);
  EXPECT_EQ(first(1), 5u);
  EXPECT_EQ(first(2), 5u);
  EXPECT_EQ(first(3), 6u);
  EXPECT_EQ(first(5), 6u);
  EXPECT_EQ(first(6), 8u);
  EXPECT_EQ(first(9), 8u);
  EXPECT_EQ(first(10), 8u);  // the full mesh has fewer
  EXPECT_EQ(pgl::minimum_vertices(model.meshes[1], model.map.data(), 1), 6u);
  EXPECT_EQ(pgl::minimum_vertices(Mesh{}, model.map.data(), 1), 0u);
}

TEST(VertexLimits, FollowTheObjectsMeshes) {
  const Model model;
  const Counts mesh_of_object{1, 0, 1, 0};
  Counts min_vertices(4), max_vertices(4);
  pgl::host::vertex_limits(mesh_of_object, model.meshes, model.map, 2, min_vertices, max_vertices);
  EXPECT_EQ(min_vertices, (Counts{6, 5, 6, 5}));
  EXPECT_EQ(max_vertices, (Counts{6, 8, 6, 8}));
  pgl::host::vertex_limits({}, model.meshes, model.map, 2, {}, {});
}

TEST(LayOut, PlacesObjectsOneAfterTheOther) {
  const Model model;
  const Counts mesh_of_object{0, 1, 1, 0, 0};
  const Counts counts{8, 0, 6, 3, 6};
  Counts triangles(5);
  std::vector<std::uint64_t> vertex_offsets(6, 1), triangle_offsets(6, 1);
  pgl::host::lay_out(counts, mesh_of_object, model.meshes, model.map, triangles, vertex_offsets, triangle_offsets);
  EXPECT_EQ(triangles, (Counts{9, 0, 4, 0, 5}));
  EXPECT_EQ(vertex_offsets, (std::vector<std::uint64_t>{0, 8, 8, 14, 17, 23}));
  EXPECT_EQ(triangle_offsets, (std::vector<std::uint64_t>{0, 9, 9, 13, 13, 18}));
}

TEST(LayOut, AcceptsNoObjects) {
  std::vector<std::uint64_t> vertex_offsets(1, 1), triangle_offsets(1, 1);
  pgl::host::lay_out({}, {}, {}, {}, {}, vertex_offsets, triangle_offsets);
  EXPECT_EQ(vertex_offsets[0], 0u);
  EXPECT_EQ(triangle_offsets[0], 0u);
}

TEST(ExclusiveSum, ExceedsThirtyTwoBits) {
  const Counts values(3, ~std::uint32_t{0});
  std::vector<std::uint64_t> offsets(4);
  EXPECT_EQ(pgl::host::exclusive_sum<std::uint32_t>(values, offsets), 3 * (two_32 - 1));
  EXPECT_EQ(offsets, (std::vector<std::uint64_t>{0, two_32 - 1, 2 * (two_32 - 1), 3 * (two_32 - 1)}));
}

}  // namespace
