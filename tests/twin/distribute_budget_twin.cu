// SPDX-License-Identifier: MIT
// The budget, the layout and prefix sums: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include "pgl/cuda/distribute_budget.cuh"
#include "pgl/cuda/prefix_sum.cuh"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "support/budget_scenes.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::BudgetOptions;
using pgl::BudgetPolicy;
using pgl::BudgetTotals;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using test::Scene;
using Counts = std::vector<std::uint32_t>;
using Offsets = std::vector<std::uint64_t>;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

constexpr BudgetPolicy policies[] = {BudgetPolicy::exact, BudgetPolicy::fair, BudgetPolicy::paper};
constexpr std::uint64_t two_32 = std::uint64_t{1} << 32;

/// Sizes around the edges of warps and blocks, and of the scan's tiles.
constexpr std::size_t sizes[] = {0, 1, 2, 31, 32, 33, 95, 96, 97, 255, 256, 257, 1023, 1024, 1025, 4097, 12289};

// ---- distribute_budget

struct Given {
  Counts counts;
  std::vector<BudgetTotals> totals;
  AssertionResult is(const Given& other) const {
    if (AssertionResult same = same_bytes(counts, other.counts); !same) return same << " (counts)";
    if (AssertionResult same = same_bytes(totals, other.totals); !same) return same << " (totals)";
    return AssertionSuccess();
  }
};

Given host_given(const Scene& scene) {
  pgl::host::BudgetWorkspace workspace;
  Given out{Counts(scene.size(), 4242), {}};
  out.totals = {pgl::host::distribute_budget(scene.areas, scene.depths, scene.min_vertices, scene.max_vertices,
                                             scene.options, workspace, out.counts)};
  return out;
}

/// The arrays of a scene on the device.
struct OnDevice {
  explicit OnDevice(const Scene& scene)
      : areas(scene.areas),
        depths(scene.depths),
        min_vertices(scene.min_vertices),
        max_vertices(scene.max_vertices),
        counts(scene.size()),
        totals(1) {}
  cudaError_t distribute(const BudgetOptions& options, pgl::cuda::BudgetWorkspace& workspace,
                         pgl::cuda::Launch launch) const {
    return pgl::cuda::distribute_budget(areas.input(), depths.input(), min_vertices.input(), max_vertices.input(),
                                        options, workspace, counts.view(), totals.data(), launch);
  }
  Given read() const { return {counts.read(), totals.read()}; }
  DeviceArray<float> areas, depths;
  DeviceArray<std::uint32_t> min_vertices, max_vertices, counts;
  DeviceArray<BudgetTotals> totals;
};

/// Demands one result of the CPU, with one thread and with all, and of the GPU at every block size.
AssertionResult agree(const Scene& scene) {
  static pgl::cuda::BudgetWorkspace& workspace = *new pgl::cuda::BudgetWorkspace;  // outlives the CUDA context
  const Given expected = host_given(scene);
  AssertionResult result = AssertionSuccess();
  with_host_threads([&] {
    if (const AssertionResult same = host_given(scene).is(expected); !same)
      result = AssertionFailure() << "the host alone: " << same.message();
  });
  for (const unsigned threads : block_sizes) {
    const OnDevice device(scene);
    must(device.distribute(scene.options, workspace, {nullptr, threads}));
    if (const AssertionResult same = device.read().is(expected); !same)
      return AssertionFailure() << scene.size() << " objects, policy " << static_cast<int>(scene.options.policy)
                                << ", budget " << scene.options.budget << ", blocks of " << threads << ": "
                                << same.message();
  }
  return result;
}

/// The same with every policy, at budgets from nothing to more than there is.
AssertionResult agree_at_all_budgets(Scene scene) {
  std::uint64_t least = 0, most = 0;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    least += scene.min_vertices[i];
    most += scene.max_vertices[i];
  }
  for (const BudgetPolicy policy : policies)
    for (const std::uint64_t budget : {std::uint64_t{0}, std::uint64_t{1}, least / 2, least, least + 1, most / 100,
                                       most / 10, most / 3, most, most + 1, two_32}) {
      scene.options.policy = policy;
      scene.options.budget = std::min(budget, two_32);
      if (AssertionResult result = agree(scene); !result) return result;
    }
  return AssertionSuccess();
}

/// n objects of one size and depth, area(i) pixels large.
template <class Area>
Scene scene_with_areas(std::size_t n, Area&& area) {
  Scene scene;
  for (std::size_t i = 0; i < n; ++i) scene.areas.push_back(area(i));
  scene.depths.assign(n, 1.0f);
  scene.min_vertices.assign(n, 10);
  scene.max_vertices.assign(n, 1000);
  scene.options.pet = 0;
  return scene;
}

TEST(DistributeBudgetTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    for (int repeat = 0; repeat < 3; ++repeat) {
      const AssertionResult result =
          agree(test::scene_of(150, *rc::gen::element(policies[0], policies[1], policies[2])));
      if (!result) RC_FAIL(result.message());
    }
  }));
}

TEST(DistributeBudgetTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::uint32_t seed = 0;
  for (const std::size_t n : sizes)
    for (const BudgetPolicy policy : policies) {
      Scene scene = test::large_scene(seed++, n);
      scene.options.policy = policy;
      EXPECT_TRUE(agree(scene));
    }
}

TEST(DistributeBudgetTwin, SameBytesForMoreObjectsThanThreads) {
  PGL_NEEDS_DEVICE();
  for (const std::uint32_t seed : {100u, 101u})
    for (const BudgetPolicy policy : policies) {
      Scene scene = test::large_scene(seed, 718003);
      scene.options.policy = policy;
      EXPECT_TRUE(agree(scene));
      scene.options.budget /= 100;  // reduction, where large_scene's own budgets may lift
      EXPECT_TRUE(agree(scene));
    }
}

TEST(DistributeBudgetTwin, SameBytesAtEveryBudget) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(agree_at_all_budgets(test::large_scene(7, 2000)));
  EXPECT_TRUE(agree_at_all_budgets(test::large_scene(8, 2000)));
}

TEST(DistributeBudgetTwin, SameBytesWhereAllWeightsTie) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(agree_at_all_budgets(scene_with_areas(5000, [](std::size_t) { return 64.0f; })));
  // Two weights: all but a few objects fall into one bucket, which only the indices divide.
  EXPECT_TRUE(agree_at_all_budgets(scene_with_areas(5000, [](std::size_t i) { return i % 100 == 0 ? 1e30f : 64.0f; })));
  EXPECT_TRUE(
      agree_at_all_budgets(scene_with_areas(5000, [](std::size_t i) { return i % 100 == 0 ? 1e-30f : 64.0f; })));
}

TEST(DistributeBudgetTwin, SameBytesWhereWeightsAreOneStepApartOrAllOverTheRange) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(agree_at_all_budgets(scene_with_areas(4000, [](std::size_t i) {
    return pgl::ieee::from_bits<float>(pgl::ieee::to_bits(100.0f) + static_cast<std::uint32_t>(i * 7 % 1000));
  })));
  EXPECT_TRUE(agree_at_all_budgets(
      scene_with_areas(4000, [](std::size_t i) { return std::ldexp(1.0f, static_cast<int>(i * 37 % 250) - 125); })));
  Scene wide = scene_with_areas(4000, [](std::size_t i) { return static_cast<float>(1 + i); });
  for (std::size_t i = 0; i < wide.size(); ++i) {
    wide.max_vertices[i] = 1u << (i % 32);
    wide.min_vertices[i] = std::min(static_cast<std::uint32_t>(i % 3), wide.max_vertices[i]);
  }
  wide.options.alpha = 64.0f;
  EXPECT_TRUE(agree_at_all_budgets(wide));
}

TEST(DistributeBudgetTwin, SameBytesForCountsWhoseSumsCarry) {
  PGL_NEEDS_DEVICE();
  for (const std::uint32_t least : {0u, 1u, 0x7fffffffu, 0x80000000u, 0xfffffff0u}) {
    Scene scene = scene_with_areas(3000, [](std::size_t i) { return static_cast<float>(100 + i % 3); });
    for (std::size_t i = 0; i < scene.size(); ++i) {
      scene.min_vertices[i] = least;
      scene.max_vertices[i] = 0xffffffffu - static_cast<std::uint32_t>(i % 5);
    }
    EXPECT_TRUE(agree_at_all_budgets(scene));
  }
}

TEST(DistributeBudgetTwin, SameBytesForEveryOddAreaDepthAndSize) {
  PGL_NEEDS_DEVICE();
  constexpr float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  const float odd[] = {0.0f, -0.0f, 1e-45f, -1e-45f, 1e-40f,  1.17549435e-38f, 1e-30f, 0.5f, 1.0f,
                       2.0f, 3.0f,  1e4f,   1e30f,   3.4e38f, -1.0f,           inf,    -inf, nan};
  Scene scene;
  for (const float area : odd)
    for (const float depth : odd)
      for (const std::uint32_t vertices : {0u, 1u, 3u, 470u, 0xffffffffu}) {
        scene.areas.push_back(area);
        scene.depths.push_back(depth);
        scene.min_vertices.push_back(std::min(vertices, 4u));
        scene.max_vertices.push_back(vertices);
      }
  for (const float alpha : {std::nextafter(1.0f, 2.0f), 3.0f, 64.0f})
    for (const float pet : {0.0f, 1.0f, inf})
      for (const float viewport_area : {1e-45f, 1e6f, inf}) {
        scene.options.alpha = alpha;
        scene.options.pet = pet;
        scene.options.viewport_area = viewport_area;
        scene.options.near_depth = alpha > 60 ? 1e-45f : 1e-3f;
        for (const BudgetPolicy policy : policies)
          for (const std::uint64_t budget : {std::uint64_t{1000}, std::uint64_t{1} << 31, two_32}) {
            scene.options.policy = policy;
            scene.options.budget = budget;
            EXPECT_TRUE(agree(scene));
          }
      }
}

TEST(DistributeBudgetTwin, GivesNothingWhereNoObjectIsEligible) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(agree_at_all_budgets(scene_with_areas(700, [](std::size_t) { return 0.0f; })));
  EXPECT_TRUE(agree_at_all_budgets(scene_with_areas(0, [](std::size_t) { return 0.0f; })));
}

TEST(DistributeBudgetTwin, DoesNotNeedTheTotals) {
  PGL_NEEDS_DEVICE();
  pgl::cuda::BudgetWorkspace workspace;
  for (const std::size_t n : {0, 300}) {
    const Scene scene = test::large_scene(9, n);
    const OnDevice device(scene);
    must(pgl::cuda::distribute_budget(device.areas.input(), device.depths.input(), device.min_vertices.input(),
                                      device.max_vertices.input(), scene.options, workspace, device.counts.view(),
                                      nullptr));
    EXPECT_TRUE(same_bytes(device.counts.read(), host_given(scene).counts));
  }
}

TEST(DistributeBudgetTwin, ReplaysAsAGraphOverOtherScenes) {
  PGL_NEEDS_DEVICE();
  constexpr std::size_t n = 20001;
  for (const BudgetPolicy policy : policies) {
    Scene scene = test::large_scene(20, n);
    scene.options.policy = policy;
    scene.options.budget = 100000;
    const OnDevice device(scene);
    pgl::cuda::BudgetWorkspace workspace;
    must(device.distribute(scene.options, workspace, {}));
    const void* const memory = workspace.memory.at<void>();
    const pgl::test::Captured graph(
        [&](cudaStream_t stream) { return device.distribute(scene.options, workspace, stream); });
    enum Kind { any, only_whole, no_minima, complete, unseen };  // leaves out, lifts, lifts all, has nothing to lift
    for (const Kind kind : {any, only_whole, no_minima, complete, unseen, any}) {
      Scene now = test::large_scene(20 + kind, n);
      now.options = scene.options;
      if (kind == complete) now.max_vertices.assign(n, 1);
      if (kind == no_minima || kind == complete) now.min_vertices.assign(n, 0);
      if (kind == only_whole) now.min_vertices = now.max_vertices;
      if (kind == unseen) now.areas.assign(n, 0.0f);
      pgl::test::assign(device.areas, now.areas);
      pgl::test::assign(device.depths, now.depths);
      pgl::test::assign(device.min_vertices, now.min_vertices);
      pgl::test::assign(device.max_vertices, now.max_vertices);
      pgl::test::poison(device.counts);
      pgl::test::poison(device.totals);
      graph.replay();
      const Given expected = host_given(now);
      EXPECT_TRUE(device.read().is(expected)) << "kind " << kind;
      std::uint64_t all = 0;
      for (std::size_t i = 0; i < n; ++i) all += now.areas[i] >= 1 ? now.max_vertices[i] : 0;
      EXPECT_EQ(all > scene.options.budget, kind < complete);
    }
    EXPECT_EQ(workspace.memory.at<void>(), memory);
  }
}

// ---- the weights by themselves

__global__ void weights_kernel(const float* floats, const std::uint32_t* vertices, std::size_t n, BudgetOptions options,
                               float* weights, std::uint32_t* shares) {
  const std::size_t i = std::size_t{blockIdx.x} * blockDim.x + threadIdx.x;
  if (i >= n) return;
  weights[i] = pgl::log_weight(floats[2 * i], floats[2 * i + 1], 0, vertices[i], options);
  shares[i] = pgl::share_weight(weights[i], 2300.0f, options.alpha);
}

TEST(BudgetWeightsTwin, SameBitsForRandomFloats) {
  PGL_NEEDS_DEVICE();
  constexpr std::size_t n = 500000;
  std::mt19937 random(11);
  std::vector<float> floats(2 * n);
  Counts vertices(n);
  for (std::size_t i = 0; i < n; ++i) {
    floats[2 * i] = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()) & 0x7fffffffu);
    floats[2 * i + 1] = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()) & (i % 9 ? 0x7fffffffu : ~0u));
    vertices[i] = static_cast<std::uint32_t>(random()) >> (random() % 32);
  }
  const DeviceArray<float> device_floats(floats), device_weights(n);
  const DeviceArray<std::uint32_t> device_vertices(vertices), device_shares(n);
  for (const float alpha : {1.0001f, 2.0f, 3.0f, 64.0f}) {
    BudgetOptions options;
    options.budget = two_32;
    options.alpha = alpha;
    options.pet = 0;
    std::vector<float> weights(n);
    Counts shares(n);
    for (std::size_t i = 0; i < n; ++i) {
      weights[i] = pgl::log_weight(floats[2 * i], floats[2 * i + 1], 0, vertices[i], options);
      shares[i] = pgl::share_weight(weights[i], 2300.0f, alpha);
    }
    must(pgl::cuda::detail::run(weights_kernel, (n + 255) / 256, 0, {}, device_floats.data(), device_vertices.data(), n,
                                options, device_weights.data(), device_shares.data()));
    EXPECT_TRUE(same_bytes(device_weights.read(), weights));
    EXPECT_TRUE(same_bytes(device_shares.read(), shares));
  }
}

// ---- exclusive_sum

template <class T>
AssertionResult sums_agree(const std::vector<T>& values) {
  pgl::cuda::ScanWorkspace workspace;
  const DeviceArray<T> in(values);
  Offsets expected(values.size() + 1);
  pgl::host::exclusive_sum<T>(values, expected);
  for (const std::size_t shift : {0, 1, 3}) {
    const DeviceArray<std::uint64_t> out(values.size() + 1, shift);
    must(pgl::cuda::exclusive_sum(in.input(), out.view(), workspace));
    if (AssertionResult same = same_bytes(out.read(), expected); !same) return same << " (shift " << shift << ")";
  }
  return AssertionSuccess();
}

TEST(ExclusiveSumTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937_64 random(12);
  std::vector<std::size_t> all(std::begin(sizes), std::end(sizes));
  all.insert(all.end(), {1919, 1920, 1921, 3840, 100003, 3000001});
  for (const std::size_t n : all) {
    Counts small(n);
    Offsets large(n);
    for (std::size_t i = 0; i < n; ++i) {
      small[i] = i % 3 == 0 ? 0xffffffffu : static_cast<std::uint32_t>(random());
      large[i] = random() >> 24;
    }
    EXPECT_TRUE(sums_agree(small)) << n;
    EXPECT_TRUE(sums_agree(large)) << n;
  }
}

// ---- vertex_limits and lay_out

/// Objects of a few meshes, whose maps do not decrease, and a count for each.
struct Selection {
  std::vector<pgl::Mesh> meshes;
  Counts map, mesh_of_object, counts;
  std::uint32_t min_triangles = 0;
  std::size_t size() const { return counts.size(); }
};

Selection random_selection(std::size_t n, std::uint32_t seed) {
  std::mt19937 random(seed);
  Selection scene;
  for (int k = 0; k < 9; ++k) {
    pgl::Mesh mesh;
    mesh.first_map = scene.map.size();
    mesh.min_vertices = static_cast<std::uint32_t>(random() % 5);
    mesh.max_vertices = mesh.min_vertices + static_cast<std::uint32_t>(random() % (k == 0 ? 1 : 3000));
    std::uint32_t triangles = 0;
    for (std::uint32_t v = mesh.min_vertices; v <= mesh.max_vertices; ++v) {
      triangles += static_cast<std::uint32_t>(random() % (k == 1 ? 1000000 : 3));
      scene.map.push_back(triangles);
    }
    scene.meshes.push_back(mesh);
  }
  scene.min_triangles = static_cast<std::uint32_t>(random() % 2000);
  for (std::size_t i = 0; i < n; ++i) {
    const auto m = static_cast<std::uint32_t>(random() % scene.meshes.size());
    const pgl::Mesh& mesh = scene.meshes[m];
    scene.mesh_of_object.push_back(m);
    scene.counts.push_back(
        random() % 4 == 0
            ? 0
            : mesh.min_vertices + static_cast<std::uint32_t>(random() % (mesh.max_vertices - mesh.min_vertices + 1)));
  }
  return scene;
}

struct LaidOut {
  Counts min_vertices, max_vertices, triangle_counts;
  Offsets vertex_offsets, triangle_offsets;
  AssertionResult is(const LaidOut& other) const {
    if (AssertionResult same = same_bytes(min_vertices, other.min_vertices); !same) return same << " (least)";
    if (AssertionResult same = same_bytes(max_vertices, other.max_vertices); !same) return same << " (most)";
    if (AssertionResult same = same_bytes(triangle_counts, other.triangle_counts); !same) return same << " (triangles)";
    if (AssertionResult same = same_bytes(vertex_offsets, other.vertex_offsets); !same) return same << " (vertices at)";
    return same_bytes(triangle_offsets, other.triangle_offsets) << " (triangles at)";
  }
};

LaidOut host_laid_out(const Selection& in) {
  const std::size_t n = in.size();
  LaidOut out{Counts(n), Counts(n), Counts(n), Offsets(n + 1), Offsets(n + 1)};
  pgl::host::vertex_limits(in.mesh_of_object, in.meshes, in.map, in.min_triangles, out.min_vertices, out.max_vertices);
  pgl::host::lay_out(in.counts, in.mesh_of_object, in.meshes, in.map, out.triangle_counts, out.vertex_offsets,
                     out.triangle_offsets);
  return out;
}

/// The arrays of a selection on the device.
struct SelectionOnDevice {
  explicit SelectionOnDevice(const Selection& in)
      : meshes(in.meshes),
        map(in.map),
        mesh_of_object(in.mesh_of_object),
        counts(in.counts),
        min_vertices(in.size()),
        max_vertices(in.size()),
        triangle_counts(in.size()),
        vertex_offsets(in.size() + 1),
        triangle_offsets(in.size() + 1) {}
  cudaError_t lay_out(std::uint32_t min_triangles, pgl::cuda::ScanWorkspace& workspace,
                      pgl::cuda::Launch launch) const {
    PGL_CUDA_TRY(pgl::cuda::vertex_limits(mesh_of_object.input(), meshes.input(), map.input(), min_triangles,
                                          min_vertices.view(), max_vertices.view(), launch));
    return pgl::cuda::lay_out(counts.input(), mesh_of_object.input(), meshes.input(), map.input(),
                              triangle_counts.view(), vertex_offsets.view(), triangle_offsets.view(), workspace,
                              launch);
  }
  LaidOut read() const {
    return {min_vertices.read(), max_vertices.read(), triangle_counts.read(), vertex_offsets.read(),
            triangle_offsets.read()};
  }
  DeviceArray<pgl::Mesh> meshes;
  DeviceArray<std::uint32_t> map, mesh_of_object, counts, min_vertices, max_vertices, triangle_counts;
  DeviceArray<std::uint64_t> vertex_offsets, triangle_offsets;
};

TEST(LayOutTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  pgl::cuda::ScanWorkspace workspace;
  std::vector<std::size_t> all(std::begin(sizes), std::end(sizes));
  all.push_back(300007);
  for (const std::size_t n : all) {
    const Selection in = random_selection(n, static_cast<std::uint32_t>(n));
    const LaidOut expected = host_laid_out(in);
    with_host_threads([&] { EXPECT_TRUE(host_laid_out(in).is(expected)) << n; });
    for (const unsigned threads : block_sizes) {
      const SelectionOnDevice device(in);
      must(device.lay_out(in.min_triangles, workspace, {nullptr, threads}));
      EXPECT_TRUE(device.read().is(expected)) << n << " objects, blocks of " << threads;
    }
  }
}

TEST(LayOutTwin, ReplaysAsAGraphOverOtherCounts) {
  PGL_NEEDS_DEVICE();
  Selection in = random_selection(10007, 30);
  const SelectionOnDevice device(in);
  pgl::cuda::ScanWorkspace workspace;
  must(device.lay_out(in.min_triangles, workspace, {}));
  const void* const memory = workspace.memory.at<void>();
  const pgl::test::Captured graph(
      [&](cudaStream_t stream) { return device.lay_out(in.min_triangles, workspace, stream); });
  for (const bool none : {false, true, false}) {
    if (none) in.counts.assign(in.size(), 0);
    pgl::test::assign(device.counts, in.counts);
    pgl::test::poison(device.triangle_counts);
    pgl::test::poison(device.vertex_offsets);
    pgl::test::poison(device.triangle_offsets);
    graph.replay();
    EXPECT_TRUE(device.read().is(host_laid_out(in)));
  }
  EXPECT_EQ(workspace.memory.at<void>(), memory);
}

// ---- the whole of it

TEST(SelectionOfAFrameTwin, SumsOfCountsEndTheLayout) {
  PGL_NEEDS_DEVICE();
  const Scene scene = test::large_scene(40, 30000);
  const OnDevice device(scene);
  pgl::cuda::BudgetWorkspace budget;
  pgl::cuda::ScanWorkspace scan;
  const DeviceArray<std::uint64_t> offsets(scene.size() + 1);
  must(device.distribute(scene.options, budget, {}));
  must(pgl::cuda::exclusive_sum(device.counts.input(), offsets.view(), scan));
  EXPECT_EQ(offsets.read().back(), device.totals.read()[0].vertices);
  EXPECT_LE(offsets.read().back(), scene.options.budget);
}

}  // namespace
