// SPDX-License-Identifier: MIT
// Tiles for 718 thousand objects, against the version that counts all objects again in each step, in the same run.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/host/balance.hpp"
#include "timing.hpp"

namespace {

using pgl::bench::least_ms;
using pgl::bench::set_threads;

constexpr std::size_t object_count = 718000;
constexpr std::uint32_t width = 1920, height = 1080;

struct Scene {
  std::vector<pgl::ScreenBox> rectangles;
  std::vector<std::uint32_t> loads;
};

/// A view along a hall, about a third of whose parts are in sight, most of them far away and small, more of them to the
/// left; some cross the whole picture. Loads are triangles, by the area.
const Scene& hall() {
  static const Scene scene = [] {
    std::mt19937_64 random(1);
    std::lognormal_distribution<double> radius(-1.5, 0.8);
    std::uniform_real_distribution<double> unit(0, 1);
    Scene s;
    for (std::size_t i = 0; i < object_count; ++i) {
      const double depth = 0.5 + 300 * unit(random) * unit(random), r = radius(random);
      const double x = 100 * unit(random) * unit(random) - 40, y = 40 * unit(random) - 20;
      const double scale = 1000 / depth, cx = width / 2.0 + scale * x, cy = height / 2.0 + scale * y;
      const auto clamped = [](double p, double most) { return static_cast<float>(std::clamp(p, 0.0, most)); };
      const bool seen = cx > -scale * r && cx < width + scale * r && cy > -scale * r && cy < height + scale * r;
      pgl::ScreenBox box;
      if (seen)
        box = {clamped(cx - scale * r, width), clamped(cy - scale * r, height), clamped(cx + scale * r, width),
               clamped(cy + scale * r, height), static_cast<float>(depth)};
      s.rectangles.push_back(box);
      s.loads.push_back(seen ? 8 + static_cast<std::uint32_t>(std::min(scale * r * scale * r, 20000.0)) : 0);
    }
    return s;
  }();
  return scene;
}

/// Alg 6 as one would write it from the paper: each step counts all objects again.
std::uint32_t counted_split(const Scene& s, float threshold) {
  std::uint32_t low = 1, high = width - 1, at = 0;
  while (low <= high) {
    at = low + (high - low) / 2;
    std::uint64_t left = 0, right = 0;
    for (std::size_t i = 0; i < s.loads.size(); ++i) {
      if (s.loads[i] == 0) continue;
      const pgl::TouchedPixels p = pgl::touched_pixels(s.rectangles[i], width, height);
      left += p.x0 < at ? s.loads[i] : 0;
      right += p.x1 > at ? s.loads[i] : 0;
    }
    const double l = static_cast<double>(left), r = static_cast<double>(right);
    if (std::fabs(l - r) <= static_cast<double>(threshold) * (l + r)) break;
    if (l > r)
      high = at - 1;
    else
      low = at + 1;
  }
  return at;
}

/// Arguments: threads (0: all), GPUs, bins (0: every pixel), threshold as thousandths (-1: the histogram's policy).
/// Counters: the largest tile's load over the mean one's; all tiles' loads over those of one GPU for the whole picture,
/// which is what straddlers cost; for two GPUs and Alg 6 `speedup`, the least time of the version that counts in each
/// step over ours.
void balance(benchmark::State& state) {
  const Scene& s = hall();
  set_threads(0);  // remembers how many there are
  const auto gpus = static_cast<std::size_t>(state.range(1));
  const std::vector<std::uint32_t> weights(gpus, 1);
  pgl::BalanceOptions options{.bins = static_cast<std::uint32_t>(state.range(2))};
  if (state.range(3) >= 0) {
    options.policy = pgl::BalancePolicy::bisection;
    options.threshold = static_cast<float>(state.range(3)) / 1000.0f;
  }
  std::vector<pgl::Tile> tiles(gpus);
  std::vector<std::uint64_t> loads(gpus);
  pgl::host::BalanceWorkspace workspace;
  const auto run = [&] {
    pgl::host::balance(s.rectangles, s.loads, width, height, weights, options, workspace, tiles, loads);
  };
  set_threads(state.range(0));
  const double ours_ms = least_ms(8, run);
  for (auto _ : state) run();
  std::uint64_t total = 0, of_tiles = 0;
  for (std::size_t i = 0; i < object_count; ++i)
    if (pgl::touched_pixels(s.rectangles[i], width, height) != pgl::TouchedPixels{}) total += s.loads[i];
  for (const std::uint64_t load : loads) of_tiles += load;
  state.counters["largest"] = static_cast<double>(*std::max_element(loads.begin(), loads.end())) *
                              static_cast<double>(gpus) / static_cast<double>(of_tiles);
  state.counters["drawn"] = static_cast<double>(of_tiles) / static_cast<double>(total);
  if (gpus == 2 && state.range(3) >= 0) {
    std::uint32_t at = 0;
    const double plain_ms = least_ms(4, [&] { benchmark::DoNotOptimize(at = counted_split(s, options.threshold)); });
    if (state.range(3) > 0 && at != tiles[0].x1) state.SkipWithError("the plain version cuts elsewhere");
    state.counters["counted_ms"] = plain_ms;
    state.counters["speedup"] = plain_ms / ours_ms;
  }
  set_threads(0);
}
BENCHMARK(balance)
    ->ArgNames({"threads", "gpus", "bins", "threshold1000"})
    ->Args({1, 2, 0, -1})
    ->Args({1, 2, 16, -1})
    ->Args({1, 2, 64, -1})
    ->Args({1, 2, 256, -1})
    ->Args({1, 2, 0, 0})
    ->Args({1, 2, 0, 1})
    ->Args({1, 2, 0, 10})
    ->Args({1, 2, 0, 30})
    ->Args({1, 2, 0, 100})
    ->Args({1, 4, 0, -1})
    ->Args({1, 8, 0, -1})
    ->Args({1, 64, 0, -1})
    ->Args({0, 2, 0, -1})
    ->Args({0, 64, 0, -1})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Argument: threads (0: all).
void in_tile(benchmark::State& state) {
  const Scene& s = hall();
  set_threads(0);
  set_threads(state.range(0));
  std::vector<std::uint8_t> flags(object_count);
  for (auto _ : state) {
    pgl::host::in_tile(s.rectangles, s.loads, {0, 0, width / 2, height}, flags);
    benchmark::DoNotOptimize(flags.data());
  }
  set_threads(0);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(object_count));
}
BENCHMARK(in_tile)->ArgName("threads")->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
