// SPDX-License-Identifier: MIT
// The transfer cap for 718 thousand objects, against a plain version with std::sort in the same run.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/host/limit_transfer.hpp"
#include "timing.hpp"

namespace {

using pgl::bench::least_ms;
using pgl::bench::set_threads;

constexpr std::size_t object_count = 718000;
constexpr std::size_t mesh_count = 20000;

struct Scene {
  std::vector<float> areas, depths;
  std::vector<pgl::Mesh> meshes;
  std::vector<std::uint32_t> map, mesh_of_object, min_vertices, max_vertices;
  pgl::BudgetOptions weight;

  /// The counts that a camera at `at` metres along the hall wants.
  std::vector<std::uint32_t> wanted_at(double at) {
    std::mt19937_64 random(2);
    std::lognormal_distribution<double> radius(-1.5, 0.8);
    std::uniform_real_distribution<double> unit(0, 1);
    for (std::size_t i = 0; i < object_count; ++i) {
      const double x = 600.0 * static_cast<double>(i) / object_count + 10 * unit(random) - at;
      const double y = 60 * unit(random) - 30, z = 30 * unit(random) - 15, r = radius(random);
      const bool inside = x > -r && std::fabs(y) < 0.9 * x + r && std::fabs(z) < 0.5 * x + r;
      const double depth = std::max(x - r, 0.1), pixels = 1000 * r / depth;
      areas[i] = inside ? static_cast<float>(3 * pixels * pixels) : 0.0f;
      depths[i] = static_cast<float>(depth);
    }
    std::vector<std::uint32_t> counts(object_count);
    pgl::host::BudgetWorkspace workspace;
    pgl::host::distribute_budget(areas, depths, min_vertices, max_vertices, weight, workspace, counts);
    return counts;
  }
};

/// A hall 600 m long, full of parts of 8 to some ten thousand vertices and 1 cm to a few metres, numbered from one end
/// to the other, with about two triangles a vertex.
Scene& hall() {
  static Scene scene = [] {
    std::mt19937_64 random(1);
    std::lognormal_distribution<double> vertices(5.3, 1.1);
    Scene s;
    s.weight.budget = 10500000;
    for (std::size_t m = 0; m < mesh_count; ++m) {
      const auto most = static_cast<std::uint32_t>(std::max(8.0, vertices(random)));
      const std::uint32_t least = std::max(4u, most / 20);
      s.meshes.push_back({.first_map = s.map.size(), .min_vertices = least, .max_vertices = most});
      for (std::uint32_t k = least; k <= most; ++k)
        s.map.push_back(2 * k - 4 + static_cast<std::uint32_t>(random() % 2));
    }
    for (std::size_t i = 0; i < object_count; ++i) {
      s.mesh_of_object.push_back(static_cast<std::uint32_t>(random() % mesh_count));
      s.min_vertices.push_back(s.meshes[s.mesh_of_object.back()].min_vertices);
      s.max_vertices.push_back(s.meshes[s.mesh_of_object.back()].max_vertices);
    }
    s.areas.resize(object_count);
    s.depths.resize(object_count);
    return s;
  }();
  return scene;
}

/// The same job as one would write it with the standard library.
struct Plain {
  struct Growing {
    float weight;
    std::uint32_t object;
  };
  std::vector<Growing> order;

  std::uint64_t operator()(const Scene& s, const std::vector<std::uint32_t>& wanted,
                           const std::vector<std::uint32_t>& previous, const pgl::TransferOptions& options,
                           std::vector<std::uint32_t>& counts) {
    order.clear();
    for (std::uint32_t i = 0; i < wanted.size(); ++i) {
      counts[i] = std::min(wanted[i], previous[i]);
      if (wanted[i] > previous[i])
        order.push_back({pgl::log_weight(s.areas[i], s.depths[i], s.min_vertices[i], s.max_vertices[i], s.weight), i});
    }
    std::sort(order.begin(), order.end(), [](const Growing& a, const Growing& b) {
      return a.weight > b.weight || (a.weight == b.weight && a.object < b.object);
    });
    const auto bytes = [&](std::uint32_t i, std::uint32_t from, std::uint32_t to) {
      return pgl::growth_bytes(s.meshes[s.mesh_of_object[i]], s.map.data(), from, to, options);
    };
    std::uint64_t left = options.cap;
    for (const Growing& growing : order) {
      const std::uint32_t i = growing.object;
      if (previous[i] > 0) continue;
      const std::uint64_t step = bytes(i, 0, s.min_vertices[i]);
      if (step > left) break;
      left -= step;
      counts[i] = s.min_vertices[i];
    }
    for (const Growing& growing : order) {
      const std::uint32_t i = growing.object;
      if (counts[i] == 0) continue;
      const std::uint64_t all = bytes(i, counts[i], wanted[i]);
      if (all > left) {
        const std::uint32_t from = counts[i];
        while (bytes(i, from, counts[i] + 1) <= left) ++counts[i];
        left -= bytes(i, from, counts[i]);
        break;
      }
      left -= all;
      counts[i] = wanted[i];
    }
    return options.cap - left;
  }
};

/// Arguments: threads (0: all), how far the camera went in metres (0: everything is new), cap as a thousandth of all
/// growth (0: no limit). Counters: what grew and what of it was let through, frames until the camera that now stands
/// has everything, and `speedup`: the plain version's least time over ours.
void limit_transfer(benchmark::State& state) {
  Scene& s = hall();
  set_threads(0);  // remembers how many there are
  const bool teleport = state.range(1) == 0;
  const std::vector<std::uint32_t> previous = teleport ? std::vector<std::uint32_t>(object_count) : s.wanted_at(200.0);
  const std::vector<std::uint32_t> wanted = s.wanted_at(200.0 + static_cast<double>(state.range(1)));
  std::vector<std::uint32_t> counts(object_count), plain_counts(object_count);
  pgl::host::TransferWorkspace workspace;
  pgl::TransferOptions options;
  pgl::host::TransferTotals totals;
  const auto limit = [&](const std::vector<std::uint32_t>& from) {
    return pgl::host::limit_transfer(s.areas, s.depths, s.min_vertices, s.max_vertices, s.weight, wanted, from,
                                     s.mesh_of_object, s.meshes, s.map, options, workspace, counts);
  };
  const std::uint64_t growth = limit(previous).bytes;
  if (state.range(2) > 0) options.cap = growth * static_cast<std::uint64_t>(state.range(2)) / 1000;

  Plain plain;
  const double plain_ms =
      least_ms(8, [&] { benchmark::DoNotOptimize(plain(s, wanted, previous, options, plain_counts)); });
  set_threads(state.range(0));
  const double ours_ms = least_ms(8, [&] { totals = limit(previous); });
  if (counts != plain_counts) state.SkipWithError("the plain version gives other counts");
  for (auto _ : state) totals = limit(previous);
  state.counters["growth_MB"] = static_cast<double>(growth) / 1e6;
  state.counters["sent_MB"] = static_cast<double>(totals.bytes) / 1e6;
  state.counters["waiting"] = static_cast<double>(totals.waiting);
  int frames = 1;
  for (std::vector<std::uint32_t> from = counts; totals.missing_bytes > 0; from = counts, ++frames)
    totals = limit(from);
  state.counters["frames"] = frames;
  state.counters["std_ms"] = plain_ms;
  state.counters["speedup"] = plain_ms / ours_ms;
  set_threads(0);
}
BENCHMARK(limit_transfer)
    ->ArgNames({"threads", "metres", "cap1000"})
    ->Args({1, 1, 0})
    ->Args({1, 1, 250})
    ->Args({1, 0, 0})
    ->Args({1, 0, 50})
    ->Args({0, 1, 250})
    ->Args({0, 0, 50})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Argument: threads (0: all).
void least_cap(benchmark::State& state) {
  const Scene& s = hall();
  set_threads(0);
  set_threads(state.range(0));
  std::uint64_t least = 0;
  for (auto _ : state) benchmark::DoNotOptimize(least = pgl::host::least_cap(s.meshes, s.map, 4, {}));
  set_threads(0);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(s.map.size()));
  state.counters["bytes"] = static_cast<double>(least);
}
BENCHMARK(least_cap)->ArgName("threads")->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
