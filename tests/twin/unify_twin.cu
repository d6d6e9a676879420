// SPDX-License-Identifier: MIT
// Unified counts: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "pgl/cuda/unify.cuh"
#include "pgl/host/unify.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::BudgetTotals;
using pgl::UnifyPolicy;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using Counts = std::vector<std::uint32_t>;
using Flags = std::vector<std::uint8_t>;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

constexpr UnifyPolicy policies[] = {UnifyPolicy::quality, UnifyPolicy::performance};

struct Tiles {
  std::size_t tiles = 0, n = 0;
  Counts counts;
  Flags in_tile;  ///< may be empty
};

Tiles random_tiles(std::size_t tiles, std::size_t n, bool with_flags, std::uint32_t seed) {
  std::mt19937 random(seed);
  Tiles t{tiles, n, {}, {}};
  for (std::size_t k = 0; k < tiles * n; ++k) {
    const bool touches = random() % 3 == 0;
    if (with_flags) t.in_tile.push_back(touches ? static_cast<std::uint8_t>(1 + random() % 255) : 0);
    t.counts.push_back(touches && random() % 5 != 0 ? static_cast<std::uint32_t>(random() % 1000) : 0);
    if (random() % 50 == 0) t.counts.back() = 0xfffffffeu;
  }
  return t;
}

/// Unified counts, and what the first tile draws of them, where there is one.
struct Unified {
  Counts unified, drawn;
  std::vector<BudgetTotals> totals;
  AssertionResult is(const Unified& other) const {
    if (AssertionResult same = same_bytes(unified, other.unified); !same) return same << " (unified)";
    if (AssertionResult same = same_bytes(drawn, other.drawn); !same) return same << " (drawn)";
    if (AssertionResult same = same_bytes(totals, other.totals); !same) return same << " (totals)";
    return AssertionSuccess();
  }
};

template <class T>
std::span<const T> first_tile(std::span<const T> all, std::size_t n) {
  return all.empty() ? all : all.first(n);
}

Unified host_unified(const Tiles& t, UnifyPolicy policy) {
  Unified out{Counts(t.n, 4242), Counts(t.tiles > 0 ? t.n : 0, 4242), std::vector<BudgetTotals>(2)};
  out.totals[0] = pgl::host::unify(t.counts, t.in_tile, t.tiles, policy, out.unified);
  if (t.tiles > 0)
    out.totals[1] = pgl::host::take_unified(first_tile<std::uint32_t>(t.counts, t.n),
                                            first_tile<std::uint8_t>(t.in_tile, t.n), out.unified, out.drawn);
  return out;
}

struct OnDevice {
  explicit OnDevice(const Tiles& t)
      : counts(t.counts), unified(t.n), drawn(t.tiles > 0 ? t.n : 0), in_tile(t.in_tile), totals(2) {}
  cudaError_t unify(const Tiles& t, UnifyPolicy policy, pgl::cuda::Launch launch) const {
    PGL_CUDA_TRY(
        pgl::cuda::unify(counts.input(), in_tile.input(), t.tiles, policy, unified.view(), totals.data(), launch));
    if (t.tiles == 0) return cudaMemsetAsync(totals.data() + 1, 0, sizeof(BudgetTotals), launch.stream);
    return pgl::cuda::take_unified(first_tile(counts.input(), t.n), first_tile(in_tile.input(), t.n), unified.input(),
                                   drawn.view(), totals.data() + 1, launch);
  }
  Unified read() const { return {unified.read(), drawn.read(), totals.read()}; }
  DeviceArray<std::uint32_t> counts, unified, drawn;
  DeviceArray<std::uint8_t> in_tile;
  DeviceArray<BudgetTotals> totals;
};

/// Demands one result of the CPU, with one thread and with all, and of the GPU at every block size.
AssertionResult agree(const Tiles& tiles) {
  const OnDevice device(tiles);
  for (const UnifyPolicy policy : policies) {
    const Unified expected = host_unified(tiles, policy);
    AssertionResult result = AssertionSuccess();
    with_host_threads([&] {
      if (const AssertionResult same = host_unified(tiles, policy).is(expected); !same)
        result = AssertionFailure() << "the host alone: " << same.message();
    });
    if (!result) return result;
    for (const unsigned threads : block_sizes) {
      pgl::test::poison(device.unified);
      pgl::test::poison(device.drawn);
      pgl::test::poison(device.totals);
      must(device.unify(tiles, policy, {nullptr, threads}));
      if (const AssertionResult same = device.read().is(expected); !same)
        return AssertionFailure() << tiles.tiles << " tiles, " << tiles.n << " objects, blocks of " << threads << ": "
                                  << same.message();
    }
  }
  return AssertionSuccess();
}

TEST(UnifyTwin, SameBytesForRandomTiles) {
  PGL_NEEDS_DEVICE();
  for (std::uint32_t seed = 0; seed < 20; ++seed)
    EXPECT_TRUE(agree(random_tiles(1 + seed % 7, 300 + seed, seed % 2 == 0, seed)));
}

TEST(UnifyTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : {0, 1, 2, 31, 32, 33, 255, 256, 257, 1023, 1024, 1025, 12289})
    for (const std::size_t tiles : {0, 1, 2, 5, 64})
      for (const bool with_flags : {false, true})
        EXPECT_TRUE(agree(random_tiles(tiles, n, with_flags, static_cast<std::uint32_t>(n + tiles))));
  EXPECT_TRUE(agree(random_tiles(2, 718003, true, 1)));
}

TEST(UnifyTwin, MayWriteOverWhatItReads) {
  PGL_NEEDS_DEVICE();
  const Tiles tiles = random_tiles(3, 10007, true, 2);
  for (const UnifyPolicy policy : policies) {
    const Unified expected = host_unified(tiles, policy);
    for (std::size_t tile = 0; tile < 3; ++tile) {
      const OnDevice device(tiles);
      const std::span<std::uint32_t> own = device.counts.view().subspan(tile * tiles.n, tiles.n);
      must(pgl::cuda::unify(device.counts.input(), device.in_tile.input(), 3, policy, own, nullptr));
      const Counts all = device.counts.read();
      const auto begin = all.begin() + static_cast<std::ptrdiff_t>(tile * tiles.n);
      EXPECT_TRUE(same_bytes(Counts(begin, begin + static_cast<std::ptrdiff_t>(tiles.n)), expected.unified)) << tile;
    }
    const OnDevice device(tiles);
    const DeviceArray<std::uint32_t> unified(expected.unified);
    must(pgl::cuda::take_unified(device.counts.input().first(tiles.n), device.in_tile.input().first(tiles.n),
                                 unified.input(), unified.view(), nullptr));
    EXPECT_TRUE(same_bytes(unified.read(), expected.drawn));
  }
}

TEST(UnifyTwin, ReplaysAsAGraphOverOtherCounts) {
  PGL_NEEDS_DEVICE();
  const Tiles first = random_tiles(4, 5003, true, 3);
  const OnDevice device(first);
  const pgl::test::Captured graph(
      [&](cudaStream_t stream) { return device.unify(first, UnifyPolicy::performance, stream); });
  for (const std::uint32_t seed : {3u, 4u}) {
    const Tiles now = random_tiles(4, 5003, true, seed);
    pgl::test::assign(device.counts, now.counts);
    pgl::test::assign(device.in_tile, now.in_tile);
    pgl::test::poison(device.unified);
    pgl::test::poison(device.drawn);
    pgl::test::poison(device.totals);
    graph.replay();
    EXPECT_TRUE(device.read().is(host_unified(now, UnifyPolicy::performance)));
  }
}

}  // namespace
