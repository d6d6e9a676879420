// SPDX-License-Identifier: MIT
// What must hold of a shared budget whatever the input, against versions written from the equations.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "pgl/host/distribute_budget.hpp"
#include "support/budget_scenes.hpp"

namespace {

using pgl::BudgetOptions;
using pgl::BudgetPolicy;
using Counts = std::vector<std::uint32_t>;
__extension__ typedef __int128 Wide;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr std::uint64_t two_32 = std::uint64_t{1} << 32;

using test::alphas;
using test::large_scene;
using test::magnitude;
using test::Scene;
using test::scene_of;
using test::vertices;

// ---- the versions to compare with

Counts distribute(const Scene& scene) {
  pgl::host::BudgetWorkspace workspace;
  Counts counts(scene.size(), 4242);
  const auto totals = pgl::host::distribute_budget(scene.areas, scene.depths, scene.min_vertices, scene.max_vertices,
                                                   scene.options, workspace, counts);
  EXPECT_EQ(totals.vertices, std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}));
  EXPECT_EQ(totals.objects, counts.size() - static_cast<std::size_t>(std::count(counts.begin(), counts.end(), 0u)));
  return counts;
}

/// The weights and shares are data here (they have their own properties below).
std::vector<float> weights_of(const Scene& scene) {
  std::vector<float> weights;
  for (std::size_t i = 0; i < scene.size(); ++i)
    weights.push_back(
        pgl::log_weight(scene.areas[i], scene.depths[i], scene.min_vertices[i], scene.max_vertices[i], scene.options));
  return weights;
}

/// 0 for objects that are not eligible.
std::vector<Wide> shares_of(const Scene& scene, const std::vector<float>& weights) {
  const float heaviest = weights.empty() ? 0.0f : *std::max_element(weights.begin(), weights.end());
  std::vector<Wide> shares(scene.size());
  for (std::size_t i = 0; i < scene.size(); ++i)
    if (weights[i] != -inf) shares[i] = pgl::share_weight(weights[i], heaviest, scene.options.alpha);
  return shares;
}

/// Eq 2.3 and 2.4 in 128-bit integers; 0 for objects that are not eligible.
std::vector<Wide> clamped_shares(const Scene& scene, const std::vector<float>& weights) {
  std::vector<Wide> shares = shares_of(scene, weights);
  const Wide sum = std::accumulate(shares.begin(), shares.end(), Wide{0});
  for (std::size_t i = 0; i < scene.size(); ++i)
    if (weights[i] != -inf)
      shares[i] = std::clamp<Wide>(static_cast<Wide>(scene.options.budget) * shares[i] / sum, scene.min_vertices[i],
                                   scene.max_vertices[i]);
  return shares;
}

std::vector<std::size_t> heaviest_first(const std::vector<float>& weights) {
  std::vector<std::size_t> order(weights.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return weights[i] > weights[j]; });
  return order;
}

Counts narrow(const std::vector<Wide>& counts) {
  return {counts.begin(), counts.end()};
}

/// Reduction and lift of the exact and the fair policy, told step by step.
Counts brought_to_budget(const Scene& scene, const std::vector<float>& weights, std::vector<Wide> counts) {
  std::vector<std::size_t> drawn = heaviest_first(weights);
  while (!drawn.empty() && weights[drawn.back()] == -inf) drawn.pop_back();
  const Wide budget = scene.options.budget;
  Wide total = std::accumulate(counts.begin(), counts.end(), Wide{0});
  std::size_t last = scene.size();
  while (total > budget) {
    last = drawn.back();
    drawn.pop_back();
    total -= counts[last];
    counts[last] = 0;
  }
  if (last < scene.size() && budget - total >= scene.min_vertices[last]) {
    counts[last] = budget - total;
    total = budget;
  }
  for (const std::size_t i : drawn) {
    const Wide more = std::min(budget - total, scene.max_vertices[i] - counts[i]);
    counts[i] += more;
    total += more;
  }
  return narrow(counts);
}

Counts exact_counts(const Scene& scene) {
  const std::vector<float> weights = weights_of(scene);
  return brought_to_budget(scene, weights, clamped_shares(scene, weights));
}

/// All integers below 2^63 of at most 12 significant bits, ascending, each told from the one before.
const std::vector<Wide>& levels() {
  static const std::vector<Wide> all = [] {
    std::vector<Wide> list;
    Wide step = 1;
    for (Wide level = 0; level < Wide{1} << 63; level += step) {
      list.push_back(level);
      if (level == 4096 * step) step *= 2;
    }
    return list;
  }();
  return all;
}

/// The counts at a level, in 128-bit integers; 0 for objects that are not eligible.
std::vector<Wide> counts_at(Wide level, const Scene& scene, const std::vector<float>& weights,
                            const std::vector<Wide>& shares) {
  std::vector<Wide> counts(scene.size());
  for (std::size_t i = 0; i < scene.size(); ++i)
    if (weights[i] != -inf)
      counts[i] = std::clamp<Wide>(level * shares[i] / (Wide{1} << 31), scene.min_vertices[i], scene.max_vertices[i]);
  return counts;
}

/// The fair policy: the last level that fits, and the steps of the exact policy from there.
Counts fair_counts(const Scene& scene) {
  const std::vector<float> weights = weights_of(scene);
  const std::vector<Wide> shares = shares_of(scene, weights);
  const auto fits = [&](Wide level) {
    const std::vector<Wide> counts = counts_at(level, scene, weights, shares);
    return std::accumulate(counts.begin(), counts.end(), Wide{0}) <= static_cast<Wide>(scene.options.budget);
  };
  const auto beyond = std::partition_point(levels().begin(), levels().end(), fits);
  const Wide level = beyond == levels().begin() ? 0 : *(beyond - 1);
  return brought_to_budget(scene, weights, counts_at(level, scene, weights, shares));
}

/// Alg 2 as printed: sort, prefix sums, compare with the excess or the deficit.
Counts paper_counts(const Scene& scene) {
  const std::vector<float> weights = weights_of(scene);
  std::vector<Wide> counts = clamped_shares(scene, weights);
  std::vector<std::size_t> order = heaviest_first(weights);
  const Wide excess = std::accumulate(counts.begin(), counts.end(), Wide{0}) - static_cast<Wide>(scene.options.budget);
  Wide prefix = 0;
  if (excess > 0) {
    std::reverse(order.begin(), order.end());
    for (const std::size_t i : order) {
      prefix += counts[i];
      if (prefix <= excess) counts[i] = 0;
    }
  } else if (excess < 0) {
    for (const std::size_t i : order) {
      prefix += scene.max_vertices[i] - counts[i];
      if (prefix <= -excess) counts[i] = scene.max_vertices[i];
    }
  }
  return narrow(counts);
}

// ---- what must hold

/// Returns the sum of the counts.
std::uint64_t check_promises(const Scene& scene) {
  const Counts counts = distribute(scene);
  const std::vector<float> weights = weights_of(scene);
  const Wide budget = scene.options.budget;

  Wide total = 0;
  bool room = false, eligible = false;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    total += counts[i];
    room = room || (counts[i] > 0 && counts[i] < scene.max_vertices[i]);
    eligible = eligible || weights[i] != -inf;
    RC_ASSERT(counts[i] == 0 || (counts[i] >= scene.min_vertices[i] && counts[i] <= scene.max_vertices[i]));
    if (weights[i] == -inf) RC_ASSERT(counts[i] == 0u);
    if (!(scene.areas[i] > 0)) RC_ASSERT(counts[i] == 0u);
  }
  RC_ASSERT(total <= budget);
  if (room) RC_ASSERT(total == budget);
  if (eligible && budget > 0) RC_ASSERT(total > 0);

  for (std::size_t i = 0; i < scene.size(); ++i)
    for (std::size_t j = 0; j < scene.size(); ++j)
      if (scene.min_vertices[i] == scene.min_vertices[j] && scene.max_vertices[i] == scene.max_vertices[j] &&
          (weights[i] > weights[j] || (weights[i] == weights[j] && i < j)))
        RC_ASSERT(counts[i] >= counts[j]);

  if (scene.options.policy == BudgetPolicy::fair) {
    Wide minima = 0;
    for (std::size_t i = 0; i < scene.size(); ++i)
      if (weights[i] != -inf) minima += scene.min_vertices[i];
    for (std::size_t i = 0; i < scene.size(); ++i)
      if (weights[i] != -inf && minima <= budget) RC_ASSERT(counts[i] >= scene.min_vertices[i]);
  }

  return static_cast<std::uint64_t>(total);
}

constexpr int scenes = 20;  // for each of RapidCheck's hundred cases

RC_GTEST_PROP(DistributeBudgetProps, keepsItsPromises, ()) {
  int met = 0, complete = 0, nothing = 0;
  for (int k = 0; k < scenes; ++k) {
    const Scene scene = scene_of(30, *rc::gen::element(BudgetPolicy::exact, BudgetPolicy::fair));
    const std::uint64_t total = check_promises(scene);
    (total == 0 ? nothing : total < scene.options.budget ? complete : met) += 1;
  }
  RC_CLASSIFY(met > scenes / 4, "a quarter meet the budget");
  RC_CLASSIFY(complete > scenes / 8, "an eighth draw complete objects only");
  RC_CLASSIFY(nothing > scenes / 2, "half draw nothing");
}

RC_GTEST_PROP(DistributeBudgetProps, equalsTheStepByStepVersion, ()) {
  for (int k = 0; k < scenes; ++k) {
    const Scene scene = scene_of(40, BudgetPolicy::exact);
    RC_ASSERT(distribute(scene) == exact_counts(scene));
  }
}

RC_GTEST_PROP(DistributeBudgetProps, fairPolicyEqualsTheStepByStepVersion, ()) {
  int crowded = 0, lifted = 0;
  for (int k = 0; k < scenes; ++k) {
    const Scene scene = scene_of(40, BudgetPolicy::fair);
    const Counts counts = distribute(scene);
    RC_ASSERT(counts == fair_counts(scene));
    const std::vector<float> weights = weights_of(scene);
    Wide minima = 0;
    for (std::size_t i = 0; i < scene.size(); ++i)
      if (weights[i] != -inf) minima += scene.min_vertices[i];
    (minima > static_cast<Wide>(scene.options.budget) ? crowded : lifted) += 1;
  }
  RC_CLASSIFY(crowded > scenes / 8, "an eighth cannot draw all minima");
  RC_CLASSIFY(lifted > scenes / 4, "a quarter can");
}

/// One level at a time, without relying on the sum never falling.
TEST(DistributeBudgetFair, FindsTheLastLevelOfAllThatFit) {
  ASSERT_EQ(levels().size(), pgl::budget_levels);
  for (std::uint32_t k = 0; k < pgl::budget_levels; ++k)
    ASSERT_EQ(static_cast<std::uint64_t>(levels()[k]), pgl::budget_level(k));
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    Scene scene = large_scene(seed, 1 + 2 * seed);
    scene.options.policy = BudgetPolicy::fair;
    const std::vector<float> weights = weights_of(scene);
    const std::vector<Wide> shares = shares_of(scene, weights);
    Wide last = 0;
    for (const Wide level : levels()) {
      const std::vector<Wide> counts = counts_at(level, scene, weights, shares);
      if (std::accumulate(counts.begin(), counts.end(), Wide{0}) <= static_cast<Wide>(scene.options.budget))
        last = level;
    }
    EXPECT_EQ(distribute(scene), brought_to_budget(scene, weights, counts_at(last, scene, weights, shares)));
  }
}

RC_GTEST_PROP(DistributeBudgetProps, paperPolicyEqualsAlgorithmTwo, ()) {
  int over = 0, below = 0;
  for (int k = 0; k < scenes; ++k) {
    const Scene scene = scene_of(40, BudgetPolicy::paper);
    const Counts counts = distribute(scene);
    RC_ASSERT(counts == paper_counts(scene));
    const auto total = std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
    over += total > scene.options.budget;
    below += total < scene.options.budget;
  }
  RC_CLASSIFY(over > 0, "some over the budget");
  RC_CLASSIFY(below > 0, "some below the budget");
}

TEST(DistributeBudgetLarge, DoesNotDependOnTheNumberOfThreads) {
  for (std::uint32_t seed = 0; seed < 6; ++seed) {
    Scene scene = large_scene(seed, 30000 + seed);
    for (const BudgetPolicy policy : {BudgetPolicy::exact, BudgetPolicy::fair, BudgetPolicy::paper}) {
      scene.options.policy = policy;
      const Counts expected = policy == BudgetPolicy::exact  ? exact_counts(scene)
                              : policy == BudgetPolicy::fair ? fair_counts(scene)
                                                             : paper_counts(scene);
#if defined(_OPENMP)
      const int before = omp_get_max_threads();
      for (const int threads : {1, 2, 3, 7}) {
        omp_set_num_threads(threads);
        EXPECT_EQ(distribute(scene), expected) << threads << " threads, seed " << seed;
      }
      omp_set_num_threads(before);
#else
      EXPECT_EQ(distribute(scene), expected) << "seed " << seed;
#endif
    }
  }
}

TEST(DistributeBudgetLarge, FollowsARenumberingOfObjects) {
  for (std::uint32_t seed = 0; seed < 4; ++seed) {
    Scene scene = large_scene(seed, 5000);
    for (std::size_t i = 0; i < scene.size(); ++i) {  // all weights different
      scene.areas[i] = static_cast<float>(10 + i);
      scene.depths[i] = 1;
      scene.max_vertices[i] = 1024;
      scene.min_vertices[i] %= 1024;
    }
    std::vector<std::size_t> order(scene.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::shuffle(order.begin(), order.end(), std::mt19937(seed));
    Scene shuffled = scene;
    for (std::size_t i = 0; i < scene.size(); ++i) {
      shuffled.areas[i] = scene.areas[order[i]];
      shuffled.min_vertices[i] = scene.min_vertices[order[i]];
    }
    const Counts counts = distribute(scene);
    const Counts shuffled_counts = distribute(shuffled);
    for (std::size_t i = 0; i < scene.size(); ++i) ASSERT_EQ(shuffled_counts[i], counts[order[i]]);
  }
}

// ---- weights and shares against long double

/// log2 of Eq 2.3 without its common factor, and the magnitude of what was added up.
struct ExactWeight {
  long double log2;
  long double terms;
};

ExactWeight exact_weight(float area, float depth, std::uint32_t size, const BudgetOptions& options) {
  const long double a = std::min(std::min<long double>(area, options.viewport_area), 3.4028234663852886e38L);
  const long double d = depth > options.near_depth ? depth : options.near_depth;
  const long double detail = (static_cast<long double>(options.alpha) - 1) * std::log2(static_cast<long double>(size));
  const long double nearness = std::log2(a) - std::log2(d);
  return {detail + nearness, std::fabs(detail) + std::fabs(nearness)};
}

long double half_ulp(float x) {
  return (static_cast<long double>(std::nextafter(std::fabs(x), inf)) - std::fabs(x)) / 2;
}

RC_GTEST_PROP(LogWeightProps, isWithinItsStatedBound, ()) {
  const Scene scene = scene_of(20, BudgetPolicy::exact);
  const std::vector<float> weights = weights_of(scene);
  for (std::size_t i = 0; i < scene.size(); ++i) {
    const bool eligible = scene.areas[i] > 0 && scene.areas[i] >= scene.options.pet && scene.depths[i] < inf &&
                          scene.max_vertices[i] > 0 && scene.min_vertices[i] <= scene.options.budget;
    RC_ASSERT((weights[i] == -inf) == !eligible);
    if (!eligible) continue;
    const auto exact = exact_weight(scene.areas[i], scene.depths[i], scene.max_vertices[i], scene.options);
    // Each logarithm within 2^-40 (times beta, at most 63), four roundings of double.
    const long double bound = half_ulp(weights[i]) + 0x1p-40L * scene.options.alpha + 4 * 0x1p-52L * exact.terms;
    RC_ASSERT(std::fabs(weights[i] - exact.log2) <= bound);
    RC_ASSERT(std::fabs(weights[i]) <= 2300.0f);
  }
}

TEST(WeightLog2, IsWithinItsBoundOverAllExponents) {
  std::mt19937_64 random(7);
  for (int e = -500; e <= 500; ++e) {
    EXPECT_EQ(pgl::detail::weight_log2(std::ldexp(1.0, e)), e);
    for (int k = 0; k < 200; ++k) {
      const double m = 1.0 + static_cast<double>(random() >> 12) * 0x1p-52;
      const double x = std::ldexp(k < 20 ? 1.41421356 + (k - 10) * 1e-9 : k < 40 ? 1.0 + k * 0x1p-52 : m, e);
      const long double exact = std::log2(static_cast<long double>(x));
      ASSERT_LE(std::fabs(pgl::detail::weight_log2(x) - exact), 0x1p-40L + 0x1p-52L * std::fabs(exact)) << x;
    }
  }
}

TEST(ShareExp2, IsWithinItsBoundAndNeverDecreases) {
  std::mt19937_64 random(8);
  const auto check = [](double x) {
    const double power = pgl::detail::share_exp2(x);
    const long double exact = std::exp2(std::nearbyint(static_cast<long double>(x) * 0x1p38L) / 0x1p38L);
    ASSERT_LE(std::fabs(power - exact), 0x1p-41L * exact) << x;
    ASSERT_LE(pgl::detail::share_exp2(std::nextafter(x, -64.0)), power) << x;
    ASSERT_LT(pgl::detail::share_exp2(x - 0x1p-37), power) << x;
  };
  for (int k = -64; k <= 0; ++k) EXPECT_EQ(pgl::detail::share_exp2(k), std::ldexp(1.0, k));
  for (int k = -63; k <= 0; ++k) {
    for (int j = -200; j <= 0; ++j) check(k + j * 0x1p-38);          // next to an integer
    for (int j = -200; j <= 200; ++j) check(k - 0.5 + j * 0x1p-38);  // where the series changes sides
    for (int j = 0; j < 200; ++j) check(k - static_cast<double>(random() >> 12) * 0x1p-52);
  }
}

RC_GTEST_PROP(LogWeightProps, neverFallsWithAreaNearnessOrSize, ()) {
  BudgetOptions options;
  options.budget = two_32;
  options.alpha = *alphas();
  options.pet = 0;
  const float area = std::fabs(*magnitude()), depth = std::fabs(*magnitude());
  const std::uint32_t size = *vertices();
  RC_PRE(size > 0u && size < 0x80000000u && area > 0 && depth < inf);
  const float weight = pgl::log_weight(area, depth, 0, size, options);
  RC_ASSERT(pgl::log_weight(std::nextafter(area, inf), depth, 0, size, options) >= weight);
  RC_ASSERT(pgl::log_weight(area, std::nextafter(depth, -inf), 0, size, options) >= weight);
  RC_ASSERT(pgl::log_weight(area, depth, 0, size + 1, options) >= weight);
}

RC_GTEST_PROP(ShareWeightProps, isWithinAUnitOfTheExactPower, ()) {
  const float alpha = *alphas();
  const float heaviest = static_cast<float>(*rc::gen::inRange(-2300000, 2300000)) / 1000.0f;
  const float below = std::ldexp(static_cast<float>(*rc::gen::inRange(0, 1 << 24)), *rc::gen::inRange(-40, -11));
  const float weight = std::max(heaviest - below, -2300.0f);
  const long double exact =
      std::exp2((static_cast<long double>(weight) - heaviest) / static_cast<long double>(alpha)) * 0x1p31L;
  const std::uint32_t share = pgl::share_weight(weight, heaviest, alpha);
  RC_ASSERT(std::fabs(share - exact) <= 0.51L);
  RC_ASSERT(pgl::share_weight(std::nextafter(weight, -inf), heaviest, alpha) <= share);
}

/// Straight from areas, depths and sizes: Eq 2.3 and 2.4 in long double, and what rounding can do to it.
RC_GTEST_PROP(ShareWeightProps, givesTheSharesOfTheEquation, ()) {
  const Scene scene = scene_of(40, BudgetPolicy::exact);
  const BudgetOptions& options = scene.options;
  const std::vector<float> weights = weights_of(scene);
  const long double alpha = options.alpha;
  std::vector<long double> parts(scene.size(), 0.0L);
  long double sum = 0, most = 0, weight_error = 0;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    if (weights[i] == -inf) continue;
    parts[i] = std::exp2(exact_weight(scene.areas[i], scene.depths[i], scene.max_vertices[i], options).log2 / alpha);
    sum += parts[i];
    most = std::max(most, parts[i]);
    weight_error = std::max(weight_error, half_ulp(weights[i]) + 0x1p-40L * alpha);
  }
  const std::vector<Wide> shares = clamped_shares(scene, weights);
  // Every part is off by a factor of at most 2^(2 * weight_error / alpha), and by half a unit of most / 2^31.
  const long double relative = 2 * (std::exp2(2 * weight_error / alpha) - 1);
  const long double unit = 0.51L * 0x1p-31L * most / (sum > 0 ? sum : 1);
  for (std::size_t i = 0; i < scene.size(); ++i) {
    if (weights[i] == -inf) continue;
    const long double fraction = parts[i] / sum;
    const long double exact =
        std::clamp<long double>(options.budget * fraction, scene.min_vertices[i], scene.max_vertices[i]);
    const long double off =
        options.budget * (fraction * (relative + unit * static_cast<long double>(scene.size())) * 1.01L + unit * 1.01L);
    RC_ASSERT(std::fabs(static_cast<long double>(shares[i]) - exact) <= 1 + off);
  }
}

// ---- minimum and layout

RC_GTEST_PROP(MinimumVerticesProps, equalsALinearSearch, ()) {
  auto map = *rc::gen::container<Counts>(*rc::gen::inRange<std::size_t>(1, 50), rc::gen::inRange(0u, 40u));
  std::sort(map.begin(), map.end());
  const auto least = *rc::gen::inRange(1u, 1000u);
  const pgl::Mesh mesh{0, 0, 0, least, least + static_cast<std::uint32_t>(map.size()) - 1};
  const auto wanted = *rc::gen::inRange(0u, 45u);
  std::uint32_t expected = mesh.max_vertices;
  for (std::uint32_t k = mesh.max_vertices; k >= least; --k)
    if (map[k - least] >= wanted) expected = k;
  RC_ASSERT(pgl::minimum_vertices(mesh, map.data(), wanted) == expected);
}

RC_GTEST_PROP(ExclusiveSumProps, equalsTheRunningSum, ()) {
  const auto values = *rc::gen::container<Counts>(*rc::gen::inRange<std::size_t>(0, 100), vertices());
  std::vector<std::uint64_t> offsets(values.size() + 1, 99), expected(values.size() + 1, 0);
  std::inclusive_scan(values.begin(), values.end(), expected.begin() + 1, std::plus<>{}, std::uint64_t{0});
  RC_ASSERT(pgl::host::exclusive_sum<std::uint32_t>(values, offsets) == expected.back());
  RC_ASSERT(offsets == expected);
}

TEST(LayOutLarge, DoesNotDependOnTheNumberOfThreads) {
  // 50001 objects of three meshes; the layout told object by object.
  const std::vector<pgl::Mesh> meshes{{0, 0, 0, 3, 5}, {5, 9, 3, 1, 4}, {9, 12, 7, 8, 8}};
  const Counts map{1, 2, 9, 0, 0, 1, 3, 12};
  const std::size_t n = 50001;
  std::mt19937 random(3);
  Counts mesh_of_object(n), counts(n), triangles(n);
  std::vector<std::uint64_t> vertex_offsets(n + 1), triangle_offsets(n + 1);
  for (std::size_t i = 0; i < n; ++i) {
    const pgl::Mesh& mesh = meshes[mesh_of_object[i] = random() % 3];
    counts[i] = random() % 3 == 0 ? 0 : mesh.min_vertices + random() % (mesh.max_vertices - mesh.min_vertices + 1);
  }
#if defined(_OPENMP)
  const int before = omp_get_max_threads();
  for (const int threads : {1, 2, 5}) {
    omp_set_num_threads(threads);
#endif
    pgl::host::lay_out(counts, mesh_of_object, meshes, map, triangles, vertex_offsets, triangle_offsets);
    std::uint64_t vertex = 0, triangle = 0;
    for (std::size_t i = 0; i < n; ++i) {
      ASSERT_EQ(vertex_offsets[i], vertex);
      ASSERT_EQ(triangle_offsets[i], triangle);
      const pgl::Mesh& mesh = meshes[mesh_of_object[i]];
      ASSERT_EQ(triangles[i], counts[i] == 0 ? 0 : map[mesh.first_map + counts[i] - mesh.min_vertices]);
      vertex += counts[i];
      triangle += triangles[i];
    }
    ASSERT_EQ(vertex_offsets[n], vertex);
    ASSERT_EQ(triangle_offsets[n], triangle);
#if defined(_OPENMP)
  }
  omp_set_num_threads(before);
#endif
}

}  // namespace
