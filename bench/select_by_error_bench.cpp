// SPDX-License-Identifier: MIT
// Selection by error for 718 thousand objects, against a plain version that computes each projected error; unified
// counts for some tiles, against reading them once; and a frame's feedback.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/feedback.hpp"
#include "pgl/host/select_by_error.hpp"
#include "pgl/host/unify.hpp"

namespace {

constexpr std::size_t object_count = 718000;
constexpr std::size_t mesh_count = 20000;

struct Scene {
  std::vector<float> areas, depths, scales, errors;
  std::vector<pgl::Mesh> meshes;
  std::vector<std::uint32_t> mesh_of_object, min_vertices, max_vertices, counts;
  pgl::View view;
};

/// A camera in a hall full of parts of 8 to some ten thousand vertices, whose errors fall from a fifth of a metre as
/// the count rises; a tenth of the objects is in view.
Scene& hall() {
  static Scene scene = [] {
    std::mt19937_64 random(1);
    std::lognormal_distribution<double> vertices(5.3, 1.1);
    std::uniform_real_distribution<double> unit(0, 1);
    Scene s;
    for (std::size_t m = 0; m < mesh_count; ++m) {
      const auto most = static_cast<std::uint32_t>(std::max(8.0, vertices(random)));
      const std::uint32_t least = std::max(4u, most / 20);
      s.meshes.push_back({.first_map = s.errors.size(), .min_vertices = least, .max_vertices = most});
      for (std::uint32_t k = least; k <= most; ++k)
        s.errors.push_back(k == most ? 0.0f : static_cast<float>(0.2 * std::pow(static_cast<double>(least) / k, 2)));
    }
    for (std::size_t i = 0; i < object_count; ++i) {
      s.mesh_of_object.push_back(static_cast<std::uint32_t>(random() % mesh_count));
      s.min_vertices.push_back(s.meshes[s.mesh_of_object.back()].min_vertices);
      s.max_vertices.push_back(s.meshes[s.mesh_of_object.back()].max_vertices);
      s.areas.push_back(unit(random) < 0.1 ? 100.0f : 0.0f);
      s.depths.push_back(static_cast<float>(0.1 + 300 * unit(random)));
      s.scales.push_back(1.0f);
    }
    s.counts.resize(object_count);
    s.view.clip_from_world[3].w = 0;
    s.view.clip_from_world[2].w = -1;
    s.view.width = 1920;
    s.view.height = 1080;
    return s;
  }();
  return scene;
}

void select_by_error(benchmark::State& state) {
  Scene& s = hall();
  pgl::BudgetTotals totals;
  for (auto _ : state)
    totals = pgl::host::select_by_error(s.areas, s.depths, s.min_vertices, s.max_vertices, s.scales, s.mesh_of_object,
                                        s.meshes, s.errors, s.view, {}, s.counts);
  state.counters["drawn"] = static_cast<double>(totals.objects);
  state.counters["vertices"] = static_cast<double>(totals.vertices);
}
BENCHMARK(select_by_error)->Unit(benchmark::kMillisecond)->UseRealTime();

/// As one would write it: from the coarsest count on, on one thread.
void plain_select(benchmark::State& state) {
  Scene& s = hall();
  const float pixels = pgl::pixels_per_unit(s.view);
  for (auto _ : state) {
    for (std::size_t i = 0; i < object_count; ++i) {
      s.counts[i] = 0;
      if (!(s.areas[i] > 0)) continue;
      const pgl::Mesh& mesh = s.meshes[s.mesh_of_object[i]];
      std::uint32_t k = s.min_vertices[i];
      while (k < s.max_vertices[i] &&
             s.errors[mesh.first_map + k - mesh.min_vertices] * s.scales[i] * pixels / s.depths[i] > 1)
        ++k;
      s.counts[i] = k;
    }
    benchmark::DoNotOptimize(s.counts.data());
  }
}
BENCHMARK(plain_select)->Unit(benchmark::kMillisecond)->UseRealTime();

std::vector<std::uint32_t> counts_of_tiles(std::size_t tiles) {
  std::mt19937_64 random(2);
  std::vector<std::uint32_t> counts(tiles * object_count);
  for (std::uint32_t& count : counts) count = random() % 10 == 0 ? static_cast<std::uint32_t>(random() % 1000) : 0;
  return counts;
}

void unify(benchmark::State& state) {
  const auto tiles = static_cast<std::size_t>(state.range(0));
  const std::vector<std::uint32_t> counts = counts_of_tiles(tiles);
  std::vector<std::uint32_t> unified(object_count);
  for (auto _ : state)
    benchmark::DoNotOptimize(pgl::host::unify(counts, {}, tiles, pgl::UnifyPolicy::performance, unified).vertices);
  state.SetBytesProcessed(static_cast<std::int64_t>((tiles + 1) * object_count * 4) * state.iterations());
}
BENCHMARK(unify)->Arg(2)->Arg(8)->Unit(benchmark::kMillisecond)->UseRealTime();

/// Copying as much, on one thread.
void copy(benchmark::State& state) {
  const auto tiles = static_cast<std::size_t>(state.range(0));
  const std::vector<std::uint32_t> counts = counts_of_tiles(tiles);
  std::vector<std::uint32_t> copies(counts.size());
  for (auto _ : state) {
    std::copy(counts.begin(), counts.end(), copies.begin());
    benchmark::DoNotOptimize(copies.data());
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(2 * tiles * object_count * 4) * state.iterations());
}
BENCHMARK(copy)->Arg(2)->Arg(8)->Unit(benchmark::kMillisecond)->UseRealTime();

void feedback(benchmark::State& state) {
  const auto gpus = static_cast<std::size_t>(state.range(0));
  std::mt19937 random(3);
  pgl::WeightFeedback weights;
  pgl::BudgetFeedback budget;
  std::vector<float> times(gpus);
  std::vector<std::uint64_t> loads(gpus, 1000000);
  std::vector<std::uint32_t> shares(gpus);
  for (float& time : times) time = 5.0f + static_cast<float>(random() % 1000) * 0.01f;
  for (auto _ : state) {
    pgl::next_weights(weights, times, loads, {}, shares);
    benchmark::DoNotOptimize(pgl::next_budget(budget, pgl::frame_milliseconds(times), budget.budget, {}, {}));
  }
}
BENCHMARK(feedback)->Arg(2)->Arg(64)->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
