// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "bench.cuh"
#include "host_balance.hpp"
#include "pgl/cuda/balance.cuh"
#include "rows.hpp"

namespace pgl::bench {
namespace {

/// How even the tiles are, and what objects in several of them cost.
std::string note_of(const HostBalance& host) {
  std::uint64_t all = 0, of_tiles = 0;
  for (std::size_t i = 0; i < host.loads.size(); ++i)
    if (is_in_tile(host.rectangles[i], host.loads[i], {0, 0, host.width, host.height})) all += host.loads[i];
  for (const std::uint64_t load : host.tile_loads) of_tiles += load;
  if (all == 0) return "nothing is drawn";
  const double mean = static_cast<double>(of_tiles) / static_cast<double>(host.tile_loads.size());
  char text[120];
  std::snprintf(text, sizeof text, "the largest load is %.4f of the mean one, all are %.3f of one GPU's",
                static_cast<double>(*std::max_element(host.tile_loads.begin(), host.tile_loads.end())) / mean,
                static_cast<double>(of_tiles) / static_cast<double>(all));
  return text;
}

}  // namespace

void balance_rows(Bench& bench, const Scene& scene, const Workload& workload) {
  if (!bench.wants("balance/") && !bench.wants("in_tile")) return;
  HostBalance host(scene, workload.budget);
  const std::size_t n = host.rectangles.size();
  const auto rectangles = bench.upload(host.rectangles);
  const auto loads = bench.upload(host.loads);
  const auto tiles = bench.array<Tile>(most_tiles);
  const auto tile_loads = bench.array<std::uint64_t>(most_tiles);
  const auto flags = bench.array<std::uint8_t>(n);
  cuda::BalanceWorkspace workspace;

  struct Case {
    const char* name;
    std::size_t gpus;
    BalanceOptions options;
    std::optional<double> target_ms;
  };
  const Case cases[] = {
      {"balance/2", 2, {}, workload.target(0.05)},
      {"balance/2/bisection", 2, {.policy = BalancePolicy::bisection}, std::nullopt},
      {"balance/2/64 bins", 2, {.bins = 64}, std::nullopt},
      {"balance/4", 4, {}, std::nullopt},
      {"balance/8", 8, {}, std::nullopt},
      {"balance/64", 64, {}, std::nullopt},
  };
  for (const Case& c : cases) {
    if (!bench.wants(c.name)) continue;
    host.balance(c.gpus, c.options);
    const std::vector<std::uint32_t> weights(c.gpus, 1);
    bench.row({.name = c.name,
               .bytes = n * (sizeof(ScreenBox) - sizeof(float) + sizeof(std::uint32_t)),  // the depth is not read
               .enqueue =
                   [&](cudaStream_t stream) {
                     return cuda::balance(rectangles.input(), loads.input(), host.width, host.height, weights,
                                          c.options, workspace, tiles.view().first(c.gpus),
                                          tile_loads.view().first(c.gpus), stream);
                   },
               .outputs =
                   [&] {
                     return std::vector{expect(tiles, host.tiles), expect(tile_loads, host.tile_loads)};
                   },
               .host = [&] { host.balance(c.gpus, c.options); },
               .target_ms = c.target_ms,
               .note = note_of(host)});
  }
  if (!bench.wants("in_tile")) return;
  host.balance(2, {});
  const auto tile = bench.upload(host.tiles);
  bench.row({.name = "in_tile",
             .bytes = n * (sizeof(ScreenBox) - sizeof(float) + sizeof(std::uint32_t) + 1),
             .enqueue =
                 [&](cudaStream_t stream) {
                   return cuda::in_tile(rectangles.input(), loads.input(), tile.data(), flags.view(), stream);
                 },
             .outputs = [&] { return std::vector{expect(flags, host.flags)}; },
             .host = [&] { host.in_tile(); }});
}

}  // namespace pgl::bench
