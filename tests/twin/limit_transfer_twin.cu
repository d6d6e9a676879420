// SPDX-License-Identifier: MIT
// Growth under a transfer cap: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "pgl/cuda/limit_transfer.cuh"
#include "pgl/host/limit_transfer.hpp"
#include "support/transfer_scenes.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::TransferTotals;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using test::Before;
using test::transfer_caps;
using test::transfer_scene;
using test::TransferScene;
using Counts = std::vector<std::uint32_t>;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

constexpr std::uint64_t no_limit = ~std::uint64_t{0};
constexpr Before befores[] = {Before::any, Before::nothing, Before::all, Before::nearly_same};

/// Sizes around the edges of warps and blocks.
constexpr std::size_t sizes[] = {0, 1, 2, 31, 32, 33, 95, 96, 97, 255, 256, 257, 1023, 1024, 1025, 4097, 12289};

struct Limited {
  Counts counts;
  std::vector<TransferTotals> totals;
  AssertionResult is(const Limited& other) const {
    if (AssertionResult same = same_bytes(counts, other.counts); !same) return same << " (counts)";
    if (AssertionResult same = same_bytes(totals, other.totals); !same) return same << " (totals)";
    return AssertionSuccess();
  }
};

Limited host_limited(const TransferScene& s) {
  pgl::host::TransferWorkspace workspace;
  Limited out{Counts(s.size(), 4242), {}};
  out.totals = {pgl::host::limit_transfer(s.areas, s.depths, s.min_vertices, s.max_vertices, s.weight, s.wanted,
                                          s.previous, s.mesh_of_object, s.meshes, s.map, s.options, workspace,
                                          out.counts)};
  return out;
}

/// The arrays of a scene on the device.
struct OnDevice {
  explicit OnDevice(const TransferScene& s)
      : areas(s.areas),
        depths(s.depths),
        min_vertices(s.min_vertices),
        max_vertices(s.max_vertices),
        wanted(s.wanted),
        previous(s.previous),
        mesh_of_object(s.mesh_of_object),
        map(s.map),
        counts(s.size()),
        meshes(s.meshes),
        totals(1) {}
  cudaError_t limit(const TransferScene& s, pgl::cuda::TransferWorkspace& workspace, std::span<std::uint32_t> out,
                    TransferTotals* out_totals, pgl::cuda::Launch launch) const {
    return pgl::cuda::limit_transfer(areas.input(), depths.input(), min_vertices.input(), max_vertices.input(),
                                     s.weight, wanted.input(), previous.input(), mesh_of_object.input(), meshes.input(),
                                     map.input(), s.options, workspace, out, out_totals, launch);
  }
  cudaError_t limit(const TransferScene& s, pgl::cuda::TransferWorkspace& workspace, pgl::cuda::Launch launch) const {
    return limit(s, workspace, counts.view(), totals.data(), launch);
  }
  Limited read() const { return {counts.read(), totals.read()}; }
  DeviceArray<float> areas, depths;
  DeviceArray<std::uint32_t> min_vertices, max_vertices, wanted, previous, mesh_of_object, map, counts;
  DeviceArray<pgl::Mesh> meshes;
  DeviceArray<TransferTotals> totals;
};

pgl::cuda::TransferWorkspace& shared_workspace() {
  static pgl::cuda::TransferWorkspace& workspace = *new pgl::cuda::TransferWorkspace;  // outlives the CUDA context
  return workspace;
}

/// Demands one result of the CPU, with one thread and with all, and of the GPU at every block size, for every cap.
AssertionResult agree(TransferScene scene, const std::vector<std::uint64_t>& caps) {
  const OnDevice device(scene);
  for (const std::uint64_t cap : caps) {
    scene.options.cap = cap;
    const Limited expected = host_limited(scene);
    AssertionResult result = AssertionSuccess();
    with_host_threads([&] {
      if (const AssertionResult same = host_limited(scene).is(expected); !same)
        result = AssertionFailure() << "the host alone: " << same.message();
    });
    if (!result) return result;
    for (const unsigned threads : block_sizes) {
      pgl::test::poison(device.counts);
      pgl::test::poison(device.totals);
      must(device.limit(scene, shared_workspace(), {nullptr, threads}));
      if (const AssertionResult same = device.read().is(expected); !same)
        return AssertionFailure() << scene.size() << " objects, cap " << cap << ", blocks of " << threads << ": "
                                  << same.message();
    }
  }
  return AssertionSuccess();
}

TEST(LimitTransferTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
    const TransferScene scene = transfer_scene(random, random() % 200, befores[random() % std::size(befores)]);
    const AssertionResult result = agree(scene, transfer_caps(scene, random));
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(LimitTransferTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(1);
  for (const std::size_t n : sizes)
    for (const Before before : {Before::any, Before::nothing}) {
      const TransferScene scene = transfer_scene(random, n, before);
      EXPECT_TRUE(agree(scene, transfer_caps(scene, random)));
    }
}

TEST(LimitTransferTwin, SameBytesForMoreObjectsThanThreads) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(2);
  for (const Before before : {Before::any, Before::nothing, Before::nearly_same}) {
    const TransferScene scene = transfer_scene(random, 718003, before);
    const std::uint64_t growth = scene.bytes_between(scene.previous, scene.wanted);
    EXPECT_TRUE(agree(scene, {growth / 100, growth / 3, growth}));
  }
}

/// All objects new and alike but for what area(i) makes of them.
template <class Area>
TransferScene alike(std::size_t n, Area&& area) {
  TransferScene scene;
  scene.meshes = {{.min_vertices = 4, .max_vertices = 11}};
  scene.map = {1, 2, 4, 4, 7, 8, 9, 30};
  for (std::size_t i = 0; i < n; ++i) scene.areas.push_back(area(i));
  scene.depths.assign(n, 1.0f);
  scene.mesh_of_object.assign(n, 0);
  scene.min_vertices.assign(n, 4);
  scene.max_vertices.assign(n, 11);
  scene.wanted.assign(n, 10);
  scene.previous.assign(n, 0);
  scene.weight.budget = 1000;
  scene.weight.pet = 0;
  return scene;
}

TEST(LimitTransferTwin, SameBytesWhereWeightsTie) {
  PGL_NEEDS_DEVICE();
  const std::vector<std::uint64_t> caps = {
      0, 59, 60, 61, 1000, 60 * 2500, 60 * 5000 - 1, 60 * 5000, 60 * 5000 + 1, 500000, no_limit};
  EXPECT_TRUE(agree(alike(5000, [](std::size_t) { return 64.0f; }), caps));
  EXPECT_TRUE(agree(alike(5000, [](std::size_t) { return 0.0f; }), caps));  // no weight at all
  // Two weights: all but a few objects fall into one bucket, which only the indices divide.
  EXPECT_TRUE(agree(alike(5000, [](std::size_t i) { return i % 100 == 0 ? 1e30f : 64.0f; }), caps));
  EXPECT_TRUE(agree(alike(5000, [](std::size_t i) { return i % 100 == 0 ? 1e-30f : 64.0f; }), caps));
  EXPECT_TRUE(agree(alike(5000,
                          [](std::size_t i) {
                            return pgl::ieee::from_bits<float>(pgl::ieee::to_bits(100.0f) +
                                                               static_cast<std::uint32_t>(i * 7 % 1000));
                          }),
                    caps));
}

/// Meshes of 2^32 - 1 vertices and triangles, of which only the first and the last step exist.
TEST(LimitTransferTwin, SameBytesForBytesWhoseSumsCarry) {
  PGL_NEEDS_DEVICE();
  constexpr std::uint32_t all = 0xffffffffu;
  TransferScene scene = alike(3000, [](std::size_t i) { return static_cast<float>(100 + i % 3); });
  scene.meshes = {{.min_vertices = all, .max_vertices = all},
                  {.first_map = 1, .min_vertices = all - 1, .max_vertices = all}};
  scene.map = {all, 5, all - 7};
  for (std::size_t i = 0; i < scene.size(); ++i) {
    scene.mesh_of_object[i] = i % 2;
    scene.min_vertices[i] = scene.meshes[i % 2].min_vertices;
    scene.max_vertices[i] = scene.wanted[i] = all;
    scene.previous[i] = i % 10 == 1 ? all - 1 : 0;
  }
  scene.weight.budget = std::uint64_t{1} << 32;
  scene.options.vertex_bytes = scene.options.triangle_bytes = 65536;
  const std::uint64_t growth = scene.bytes_between(scene.previous, scene.wanted);
  EXPECT_GT(growth, std::uint64_t{1} << 60);
  EXPECT_TRUE(agree(scene, {0, growth / 1000, growth / 3, growth / 2, growth - 1, growth, no_limit}));
}

TEST(LimitTransferTwin, SameBytesWhereNothingGrows) {
  PGL_NEEDS_DEVICE();
  TransferScene scene = alike(700, [](std::size_t i) { return static_cast<float>(i); });
  scene.previous = scene.wanted;
  EXPECT_TRUE(agree(scene, {0, 1, no_limit}));
  for (std::size_t i = 0; i < scene.size(); ++i) scene.wanted[i] = i % 3 == 0 ? 0 : 4 + i % 6;
  EXPECT_TRUE(agree(scene, {0, 1, no_limit}));
  EXPECT_TRUE(agree(alike(0, [](std::size_t) { return 1.0f; }), {0, 1, no_limit}));
}

TEST(LimitTransferTwin, MayWriteOverWhatItReads) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(4);
  TransferScene scene = transfer_scene(random, 30011);
  for (const std::uint64_t cap : transfer_caps(scene, random)) {
    scene.options.cap = cap;
    const Limited expected = host_limited(scene);
    const OnDevice device(scene);
    must(device.limit(scene, shared_workspace(), device.wanted.view(), device.totals.data(), {}));
    EXPECT_TRUE((Limited{device.wanted.read(), device.totals.read()}.is(expected))) << cap;
    pgl::test::assign(device.wanted, scene.wanted);
    must(device.limit(scene, shared_workspace(), device.previous.view(), device.totals.data(), {}));
    EXPECT_TRUE((Limited{device.previous.read(), device.totals.read()}.is(expected))) << cap;
  }
}

TEST(LimitTransferTwin, DoesNotNeedTheTotals) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(5);
  for (const std::size_t n : {0, 300}) {
    TransferScene scene = transfer_scene(random, n, Before::nothing);
    for (const std::uint64_t cap : transfer_caps(scene, random)) {
      scene.options.cap = cap;
      const OnDevice device(scene);
      must(device.limit(scene, shared_workspace(), device.counts.view(), nullptr, {}));
      EXPECT_TRUE(same_bytes(device.counts.read(), host_limited(scene).counts));
    }
  }
}

/// Frame after frame, each one's counts the next one's previous ones, without a copy to the host: as a graph.
TEST(LimitTransferTwin, ReplaysAsAGraphUntilAllHasArrived) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(6);
  TransferScene scene = transfer_scene(random, 20001, Before::nothing);
  scene.options.cap = scene.bytes_between(scene.previous, scene.wanted) / 8 +
                      pgl::host::least_cap(scene.meshes, scene.map, scene.min_triangles, scene.options);
  const OnDevice device(scene);
  pgl::cuda::TransferWorkspace workspace;
  must(device.limit(scene, workspace, device.counts.view(), device.totals.data(), {}));
  const void* const memory = workspace.memory.at<void>();
  const pgl::test::Captured graph([&](cudaStream_t stream) {
    return device.limit(scene, workspace, device.previous.view(), device.totals.data(), stream);
  });
  TransferTotals totals;
  for (int frame = 0; frame < 9; ++frame) {
    const Limited expected = host_limited(scene);
    totals = expected.totals[0];
    pgl::test::poison(device.totals);
    graph.replay();
    EXPECT_TRUE((Limited{device.previous.read(), device.totals.read()}.is(expected))) << frame;
    EXPECT_TRUE(frame > 5 || totals.missing_bytes > 0) << frame;
    scene.previous = expected.counts;
  }
  EXPECT_EQ(totals.missing_bytes, 0u);
  // Another scene of as many objects: the graph reads what is there now.
  TransferScene now = scene;
  for (std::size_t i = 0; i < now.size(); ++i) {
    now.areas[i] = static_cast<float>(1 + i * 37 % 1001);
    now.previous[i] = i % 3 == 0 ? 0 : scene.wanted[i];
  }
  pgl::test::assign(device.areas, now.areas);
  pgl::test::assign(device.previous, now.previous);
  graph.replay();
  EXPECT_TRUE((Limited{device.previous.read(), device.totals.read()}.is(host_limited(now))));
  EXPECT_EQ(workspace.memory.at<void>(), memory);
}

}  // namespace
