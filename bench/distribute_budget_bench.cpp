// SPDX-License-Identifier: MIT
// Sharing a budget among 718 thousand objects, against a plain version with std::pow and std::sort in the same run.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <random>
#include <vector>

#include "pgl/host/distribute_budget.hpp"
#include "timing.hpp"

namespace {

using pgl::bench::least_ms;
using pgl::bench::set_threads;

constexpr std::size_t object_count = 718000;
constexpr std::uint64_t paper_budget = 10500000;

struct Scene {
  std::vector<float> areas, depths;
  std::vector<std::uint32_t> min_vertices, max_vertices;
};

/// A hall 600 m long, full of parts of 8 to some ten thousand vertices and 1 cm to a few metres, numbered from one end
/// to the other; the camera stands at a third and looks along it. What is behind it or beside the view is culled.
const Scene& hall() {
  static const Scene scene = [] {
    std::mt19937_64 random(1);
    std::lognormal_distribution<double> vertices(5.3, 1.1), radius(-1.5, 0.8);
    std::uniform_real_distribution<double> unit(0, 1);
    Scene s;
    for (std::size_t i = 0; i < object_count; ++i) {
      const double x = 600.0 * (static_cast<double>(i) / object_count - 1.0 / 3) + 10 * unit(random);
      const double y = 60 * unit(random) - 30, z = 30 * unit(random) - 15, r = radius(random);
      const bool inside = x > -r && std::fabs(y) < 0.9 * x + r && std::fabs(z) < 0.5 * x + r;
      const double depth = std::max(x - r, 0.1);
      const double pixels = 1000 * r / depth;
      s.areas.push_back(inside ? static_cast<float>(3 * pixels * pixels) : 0.0f);
      s.depths.push_back(static_cast<float>(depth));
      s.max_vertices.push_back(static_cast<std::uint32_t>(std::max(8.0, vertices(random))));
      s.min_vertices.push_back(std::max(4u, s.max_vertices.back() / 20));
    }
    return s;
  }();
  return scene;
}

/// The same job as one would write it with the standard library: weights by std::pow, order by std::sort.
struct Plain {
  std::vector<double> weights;
  std::vector<std::uint32_t> order;

  std::uint64_t operator()(const Scene& s, const pgl::BudgetOptions& o, std::vector<std::uint32_t>& counts) {
    const std::size_t n = s.areas.size();
    weights.assign(n, 0.0);
    order.clear();
    for (std::size_t i = 0; i < n; ++i) {
      if (!(s.areas[i] >= o.pet) || s.min_vertices[i] > o.budget) continue;
      const double w = s.areas[i] / std::max(s.depths[i], o.near_depth) * std::pow(s.max_vertices[i], o.alpha - 1.0);
      weights[i] = std::pow(w, 1.0 / o.alpha);
      order.push_back(static_cast<std::uint32_t>(i));
    }
    const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
    std::fill(counts.begin(), counts.end(), 0u);
    std::uint64_t total = 0;
    for (const std::uint32_t i : order) {
      const double share = static_cast<double>(o.budget) * weights[i] / sum;
      counts[i] = static_cast<std::uint32_t>(std::clamp<double>(share, s.min_vertices[i], s.max_vertices[i]));
      total += counts[i];
    }
    std::sort(order.begin(), order.end(), [&](std::uint32_t i, std::uint32_t j) { return weights[i] > weights[j]; });
    while (total > o.budget) {
      const std::uint32_t last = order.back();
      order.pop_back();
      total -= counts[last];
      const std::uint64_t room = total <= o.budget ? o.budget - total : 0;
      counts[last] = room >= s.min_vertices[last] ? static_cast<std::uint32_t>(room) : 0;
      if (counts[last] > 0) total = o.budget;
    }
    for (std::size_t k = 0; k < order.size() && total < o.budget; ++k) {
      const std::uint32_t i = order[k];
      const std::uint64_t more = std::min<std::uint64_t>(o.budget - total, s.max_vertices[i] - counts[i]);
      counts[i] += static_cast<std::uint32_t>(more);
      total += more;
    }
    return total;
  }
};

/// Arguments: threads (0: all), budget, 100 * alpha, 100 * PET, policy (0: exact, 1: paper, 2: fair). Counter
/// `speedup`: the plain version's least time over ours.
void distribute_budget(benchmark::State& state) {
  const Scene& s = hall();
  set_threads(0);  // remembers how many there are
  set_threads(state.range(0));
  pgl::BudgetOptions options;
  options.budget = static_cast<std::uint64_t>(state.range(1));
  options.alpha = static_cast<float>(state.range(2)) / 100;
  options.pet = static_cast<float>(state.range(3)) / 100;
  constexpr pgl::BudgetPolicy policies[] = {pgl::BudgetPolicy::exact, pgl::BudgetPolicy::paper,
                                            pgl::BudgetPolicy::fair};
  options.policy = policies[state.range(4)];

  std::vector<std::uint32_t> counts(object_count);
  Plain plain;
  const double plain_ms = least_ms(12, [&] { benchmark::DoNotOptimize(plain(s, options, counts)); });
  pgl::host::BudgetWorkspace workspace;
  pgl::host::BudgetTotals totals;
  const auto ours = [&] {
    totals =
        pgl::host::distribute_budget(s.areas, s.depths, s.min_vertices, s.max_vertices, options, workspace, counts);
  };
  const double ours_ms = least_ms(12, ours);
  for (auto _ : state) ours();
  set_threads(0);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(object_count));
  state.counters["eligible"] = static_cast<double>(
      std::count_if(s.areas.begin(), s.areas.end(), [&](float a) { return a > 0 && a >= options.pet; }));
  state.counters["drawn"] = static_cast<double>(totals.objects);
  state.counters["vertices"] = static_cast<double>(totals.vertices);
  state.counters["std_ms"] = plain_ms;
  state.counters["speedup"] = plain_ms / ours_ms;
}
BENCHMARK(distribute_budget)
    ->ArgNames({"threads", "budget", "alpha100", "pet100", "policy"})
    ->Args({1, paper_budget, 300, 100, 0})
    ->Args({0, paper_budget, 300, 100, 0})
    ->Args({1, paper_budget, 300, 100, 1})
    ->Args({1, paper_budget, 300, 100, 2})
    ->Args({1, paper_budget / 10, 300, 100, 0})
    ->Args({1, paper_budget * 10, 300, 100, 0})
    ->Args({1, paper_budget, 110, 100, 0})
    ->Args({1, paper_budget, 600, 100, 0})
    ->Args({1, paper_budget, 300, 0, 0})
    ->Args({1, paper_budget, 300, 1600, 0})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Argument: threads (0: all). Counter `speedup`: std::exclusive_scan's least time over ours.
void exclusive_sum(benchmark::State& state) {
  const Scene& s = hall();
  set_threads(0);
  set_threads(state.range(0));
  std::vector<std::uint64_t> offsets(object_count + 1);
  const double std_ms = least_ms(20, [&] {
    std::exclusive_scan(s.max_vertices.begin(), s.max_vertices.end(), offsets.begin(), std::uint64_t{0});
    benchmark::ClobberMemory();
  });
  const auto ours = [&] {
    benchmark::DoNotOptimize(pgl::host::exclusive_sum<std::uint32_t>(s.max_vertices, offsets));
    benchmark::ClobberMemory();
  };
  const double ours_ms = least_ms(20, ours);
  for (auto _ : state) ours();
  set_threads(0);
  state.counters["std_ms"] = std_ms;
  state.counters["speedup"] = std_ms / ours_ms;
}
BENCHMARK(exclusive_sum)->ArgName("threads")->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
