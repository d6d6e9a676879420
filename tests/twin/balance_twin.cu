// SPDX-License-Identifier: MIT
// Tiles and what is in them: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "pgl/cuda/balance.cuh"
#include "pgl/host/balance.hpp"
#include "support/balance_scenes.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::BalancePolicy;
using pgl::Tile;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using test::any_balance_scene;
using test::balance_scene;
using test::BalanceScene;
using Flags = std::vector<std::uint8_t>;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

/// Sizes around the edges of warps and blocks, and of what a block of balance adds up.
constexpr std::size_t sizes[] = {0, 1, 2, 31, 32, 33, 95, 96, 97, 255, 256, 257, 1023, 1024, 1025, 2047, 2048, 4097};

struct Balanced {
  std::vector<Tile> tiles;
  std::vector<std::uint64_t> loads;
  Flags flags;  ///< of a tile in the middle
  AssertionResult is(const Balanced& other) const {
    if (AssertionResult same = same_bytes(tiles, other.tiles); !same) return same << " (tiles)";
    if (AssertionResult same = same_bytes(loads, other.loads); !same) return same << " (loads)";
    if (AssertionResult same = same_bytes(flags, other.flags); !same) return same << " (flags)";
    return AssertionSuccess();
  }
};

Balanced host_balanced(const BalanceScene& s) {
  pgl::host::BalanceWorkspace workspace;
  const std::size_t gpus = s.weights.size();
  Balanced r{std::vector<Tile>(gpus), std::vector<std::uint64_t>(gpus), Flags(s.size(), 9)};
  pgl::host::balance(s.rectangles, s.loads, s.width, s.height, s.weights, s.options, workspace, r.tiles, r.loads);
  pgl::host::in_tile(s.rectangles, s.loads, r.tiles[gpus / 2], r.flags);
  return r;
}

/// The arrays of a scene on the device.
struct OnDevice {
  explicit OnDevice(const BalanceScene& s)
      : rectangles(s.rectangles),
        loads(s.loads),
        tiles(s.weights.size()),
        tile_loads(s.weights.size()),
        flags(s.size()) {}
  cudaError_t balance(const BalanceScene& s, pgl::cuda::BalanceWorkspace& workspace, pgl::cuda::Launch launch) const {
    const cudaError_t error = pgl::cuda::balance(rectangles.input(), loads.input(), s.width, s.height, s.weights,
                                                 s.options, workspace, tiles.view(), tile_loads.view(), launch);
    if (error != cudaSuccess) return error;
    return pgl::cuda::in_tile(rectangles.input(), loads.input(), tiles.data() + s.weights.size() / 2, flags.view(),
                              launch);
  }
  void poison() const {
    pgl::test::poison(tiles);
    pgl::test::poison(tile_loads);
    pgl::test::poison(flags);
  }
  Balanced read() const { return {tiles.read(), tile_loads.read(), flags.read()}; }
  DeviceArray<pgl::ScreenBox> rectangles;
  DeviceArray<std::uint32_t> loads;
  DeviceArray<Tile> tiles;
  DeviceArray<std::uint64_t> tile_loads;
  DeviceArray<std::uint8_t> flags;
};

pgl::cuda::BalanceWorkspace& shared_workspace() {
  static pgl::cuda::BalanceWorkspace& workspace = *new pgl::cuda::BalanceWorkspace;  // outlives the CUDA context
  return workspace;
}

/// Demands one result of the CPU, with one thread and with all, and of the GPU at every block size.
AssertionResult agree(const BalanceScene& scene) {
  const OnDevice device(scene);
  const Balanced expected = host_balanced(scene);
  AssertionResult result = AssertionSuccess();
  with_host_threads([&] {
    if (const AssertionResult same = host_balanced(scene).is(expected); !same)
      result = AssertionFailure() << "the host alone: " << same.message();
  });
  if (!result) return result;
  for (const unsigned threads : block_sizes) {
    device.poison();
    must(device.balance(scene, shared_workspace(), {nullptr, threads}));
    if (const AssertionResult same = device.read().is(expected); !same)
      return AssertionFailure() << scene.size() << " objects, " << scene.weights.size() << " GPUs, " << scene.width
                                << " x " << scene.height << ", blocks of " << threads << ": " << same.message();
  }
  return AssertionSuccess();
}

AssertionResult agree_for_both_policies(BalanceScene scene) {
  for (const BalancePolicy policy : {BalancePolicy::histogram, BalancePolicy::bisection}) {
    scene.options.policy = policy;
    if (AssertionResult result = agree(scene); !result) return result;
  }
  return AssertionSuccess();
}

TEST(BalanceTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
    const AssertionResult result = agree(any_balance_scene(random, 300, 400));
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(BalanceTwin, SameBytesAtTheEdgesOfWarpsAndBlocks) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(1);
  for (const std::size_t n : sizes)
    for (const std::size_t gpus : {2u, 5u}) EXPECT_TRUE(agree(balance_scene(random, n, 1920, 1080, gpus)));
}

TEST(BalanceTwin, SameBytesForEveryNumberOfGpus) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(2);
  for (std::size_t gpus = 1; gpus <= pgl::most_tiles; ++gpus)
    EXPECT_TRUE(agree(balance_scene(random, 500, 640, 480, gpus)));
}

/// Sums that have room in a block's shared memory and such that have none, in pictures of all shapes.
TEST(BalanceTwin, SameBytesForPicturesOfEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(3);
  constexpr std::pair<std::uint32_t, std::uint32_t> pictures[] = {
      {1, 1},      {2, 1},       {1, 3},         {31, 33},   {5631, 100},  {5632, 100},
      {5633, 100}, {100, 16384}, {16384, 16384}, {16384, 1}, {3840, 2160}, {1080, 1920}};
  for (const auto& [width, height] : pictures)
    for (const std::size_t gpus : {1u, 2u, 7u, 64u}) {
      BalanceScene scene = balance_scene(random, 3000, width, height, gpus);
      scene.options.bins = 0;
      EXPECT_TRUE(agree_for_both_policies(scene));
    }
}

TEST(BalanceTwin, SameBytesForMoreObjectsThanThreads) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(4);
  for (const std::size_t gpus : {2u, 64u})
    EXPECT_TRUE(agree_for_both_policies(balance_scene(random, 718003, 1920, 1080, gpus)));
}

/// Low words that overflow in shared memory, all objects at the same places.
TEST(BalanceTwin, SameBytesForSumsThatCarry) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(5);
  for (const std::size_t gpus : {1u, 2u, 6u})
    EXPECT_TRUE(agree_for_both_policies(balance_scene(random, 30000, 1920, 1080, gpus, test::Loads::huge)));
  BalanceScene same = balance_scene(random, 0, 1920, 1080, 2);
  same.rectangles.assign(20000, {300, 300, 500, 500, 1});
  same.loads.assign(20000, 0xffffffffu);
  EXPECT_TRUE(agree_for_both_policies(same));
  same.width = 16384;
  EXPECT_TRUE(agree_for_both_policies(same));
}

/// Products whose words carry, of large loads and large weights; which of two borders is better hangs on the last bits.
TEST(BalanceTwin, SameBytesForWeightsThatCarry) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(9);
  for (int k = 0; k < 40; ++k) EXPECT_TRUE(agree_for_both_policies(test::heavy_balance_scene(random)));
}

/// Three against one is an imbalance of a half: the first border that bisection looks at, and not the best one.
TEST(BalanceTwin, SameBytesWhereTheThresholdIsMetExactly) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(agree(test::balance_scene_at_the_threshold()));
}

TEST(BalanceTwin, SameBytesWhereNothingIsDrawnOrOneOutweighsAll) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(6);
  for (const test::Loads loads : {test::Loads::none, test::Loads::one_heavy, test::Loads::equal})
    for (const std::size_t gpus : {1u, 2u, 9u})
      EXPECT_TRUE(agree_for_both_policies(balance_scene(random, 700, 300, 200, gpus, loads)));
}

TEST(BalanceTwin, SameBytesForFewBins) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(7);
  for (const std::uint32_t bins : {2u, 3u, 64u, 100u, 479u, 480u, 481u, 0xffffffffu}) {
    BalanceScene scene = balance_scene(random, 900, 480, 270, 4);
    scene.options.bins = bins;
    EXPECT_TRUE(agree_for_both_policies(scene));
  }
}

TEST(InTileTwin, NeedsNoLoads) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(8);
  const BalanceScene scene = balance_scene(random, 3001, 640, 480, 3);
  const OnDevice device(scene);
  for (const Tile& tile : {Tile{100, 100, 300, 200}, Tile{100, 100, 100, 200}, Tile{0, 0, 16384, 16384}}) {
    Flags expected(scene.size(), 9);
    pgl::host::in_tile(scene.rectangles, {}, tile, expected);
    const DeviceArray<Tile> tiles(std::vector<Tile>{tile});
    for (const unsigned threads : block_sizes) {
      pgl::test::poison(device.flags);
      must(pgl::cuda::in_tile(device.rectangles.input(), {}, tiles.data(), device.flags.view(), {nullptr, threads}));
      EXPECT_TRUE(same_bytes(device.flags.read(), expected));
    }
  }
}

/// The same call for other objects, without an allocation, and after a larger one that left its sums behind.
TEST(BalanceTwin, ReplaysAsAGraph) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(9);
  for (const std::size_t gpus : {1u, 2u, 5u}) {
    const BalanceScene first = balance_scene(random, 20001, 1280, 720, gpus);
    const OnDevice device(first);
    pgl::cuda::BalanceWorkspace workspace;
    must(device.balance(first, workspace, {}));
    const void* const memory = workspace.memory.at<void>();
    const pgl::test::Captured graph([&](cudaStream_t stream) { return device.balance(first, workspace, stream); });
    BalanceScene now = first;
    for (int frame = 0; frame < 3; ++frame) {
      device.poison();
      graph.replay();
      EXPECT_TRUE(device.read().is(host_balanced(now))) << frame;
      const BalanceScene other = balance_scene(random, 20001, 1280, 720, gpus);
      now.rectangles = other.rectangles;
      now.loads = other.loads;
      pgl::test::assign(device.rectangles, now.rectangles);
      pgl::test::assign(device.loads, now.loads);
    }
    EXPECT_EQ(workspace.memory.at<void>(), memory);
  }
}

}  // namespace
