// SPDX-License-Identifier: MIT
// Selection by error: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "pgl/cuda/select_by_error.cuh"
#include "pgl/host/select_by_error.hpp"
#include "support/error_scenes.hpp"
#include "support/numbers.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::BudgetTotals;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using test::error_scene;
using test::ErrorScene;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

/// Sizes around the edges of warps and blocks.
constexpr std::size_t sizes[] = {0, 1, 2, 31, 32, 33, 95, 96, 97, 255, 256, 257, 1023, 1024, 1025, 12289};

struct Selected {
  std::vector<std::uint32_t> counts;
  std::vector<BudgetTotals> totals;
  AssertionResult is(const Selected& other) const {
    if (AssertionResult same = same_bytes(counts, other.counts); !same) return same << " (counts)";
    if (AssertionResult same = same_bytes(totals, other.totals); !same) return same << " (totals)";
    return AssertionSuccess();
  }
};

Selected host_selected(const ErrorScene& s) {
  Selected out{std::vector<std::uint32_t>(s.size(), 4242), {}};
  out.totals = {pgl::host::select_by_error(s.areas, s.depths, s.min_vertices, s.max_vertices, s.scales,
                                           s.mesh_of_object, s.meshes, s.errors, s.view, s.options, out.counts)};
  return out;
}

/// The arrays of a scene on the device.
struct OnDevice {
  explicit OnDevice(const ErrorScene& s)
      : areas(s.areas),
        depths(s.depths),
        scales(s.scales),
        errors(s.errors),
        min_vertices(s.min_vertices),
        max_vertices(s.max_vertices),
        mesh_of_object(s.mesh_of_object),
        counts(s.size()),
        meshes(s.meshes),
        totals(1) {}
  cudaError_t select(const ErrorScene& s, BudgetTotals* out_totals, pgl::cuda::Launch launch) const {
    return pgl::cuda::select_by_error(areas.input(), depths.input(), min_vertices.input(), max_vertices.input(),
                                      scales.input(), mesh_of_object.input(), meshes.input(), errors.input(), s.view,
                                      s.options, counts.view(), out_totals, launch);
  }
  Selected read() const { return {counts.read(), totals.read()}; }
  DeviceArray<float> areas, depths, scales, errors;
  DeviceArray<std::uint32_t> min_vertices, max_vertices, mesh_of_object, counts;
  DeviceArray<pgl::Mesh> meshes;
  DeviceArray<BudgetTotals> totals;
};

/// Demands one result of the CPU, with one thread and with all, and of the GPU at every block size.
AssertionResult agree(const ErrorScene& scene) {
  const Selected expected = host_selected(scene);
  AssertionResult result = AssertionSuccess();
  with_host_threads([&] {
    if (const AssertionResult same = host_selected(scene).is(expected); !same)
      result = AssertionFailure() << "the host alone: " << same.message();
  });
  if (!result) return result;
  const OnDevice device(scene);
  for (const unsigned threads : block_sizes) {
    pgl::test::poison(device.counts);
    pgl::test::poison(device.totals);
    must(device.select(scene, device.totals.data(), {nullptr, threads}));
    if (const AssertionResult same = device.read().is(expected); !same)
      return AssertionFailure() << scene.size() << " objects, blocks of " << threads << ": " << same.message();
  }
  return AssertionSuccess();
}

TEST(SelectByErrorTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
    const AssertionResult result = agree(error_scene(random, random() % 200));
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(SelectByErrorTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(1);
  for (const std::size_t n : sizes) EXPECT_TRUE(agree(error_scene(random, n)));
  const ErrorScene large = error_scene(random, 718003);
  EXPECT_TRUE(agree(large));
  EXPECT_GT(host_selected(large).totals[0].objects, large.size() / 10);
}

TEST(SelectByErrorTwin, SameBytesForErrorsThatMakeNoSense) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(2);
  for (int i = 0; i < 20; ++i) {
    ErrorScene scene = error_scene(random, 500);
    for (float& error : scene.errors) error = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()));
    EXPECT_TRUE(agree(scene));
  }
}

TEST(SelectByErrorTwin, SameTotalsWhereTheirSumsCarry) {
  PGL_NEEDS_DEVICE();
  constexpr std::uint32_t all = 0xfffffffeu;
  std::mt19937 random(3);
  ErrorScene scene = error_scene(random, 3001);
  scene.meshes = {{.min_vertices = all - 1, .max_vertices = all}};
  scene.errors = {1, 0};
  scene.areas.assign(scene.size(), 100.0f);
  scene.depths.assign(scene.size(), 1.0f);
  scene.scales.assign(scene.size(), 1.0f);
  scene.mesh_of_object.assign(scene.size(), 0);
  scene.min_vertices.assign(scene.size(), all - 1);
  scene.max_vertices.assign(scene.size(), all);
  EXPECT_TRUE(agree(scene));
  EXPECT_GT(host_selected(scene).totals[0].vertices, std::uint64_t{1} << 43);
}

TEST(SelectByErrorTwin, DoesNotNeedTheTotals) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(4);
  for (const std::size_t n : {0, 1000}) {
    const ErrorScene scene = error_scene(random, n);
    const OnDevice device(scene);
    must(device.select(scene, nullptr, {}));
    EXPECT_TRUE(same_bytes(device.counts.read(), host_selected(scene).counts));
  }
}

TEST(SelectByErrorTwin, ReplaysAsAGraphOverOtherDepths) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(5);
  ErrorScene scene = error_scene(random, 5003);
  const OnDevice device(scene);
  const pgl::test::Captured graph(
      [&](cudaStream_t stream) { return device.select(scene, device.totals.data(), stream); });
  for (int frame = 0; frame < 3; ++frame) {
    for (float& depth : scene.depths) depth *= 1.5f;
    pgl::test::assign(device.depths, scene.depths);
    pgl::test::poison(device.counts);
    pgl::test::poison(device.totals);
    graph.replay();
    EXPECT_TRUE(device.read().is(host_selected(scene)));
  }
}

AssertionResult scales_agree(const std::vector<pgl::Object>& objects) {
  std::vector<float> expected(objects.size());
  pgl::host::error_scales(objects, expected);
  const DeviceArray<pgl::Object> in(objects);
  for (const unsigned threads : block_sizes) {
    const DeviceArray<float> out(objects.size());
    must(pgl::cuda::error_scales(in.input(), out.view(), {nullptr, threads}));
    if (const AssertionResult same = same_bytes(out.read(), expected); !same)
      return AssertionFailure() << objects.size() << " objects, blocks of " << threads << ": " << same.message();
  }
  return AssertionSuccess();
}

TEST(ErrorScalesTwin, SameBytesForRandomTransforms) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    std::vector<pgl::Object> objects(static_cast<std::size_t>(numbers::whole(0, 70)));
    for (pgl::Object& object : objects) {
      object.transform = numbers::any_affine();
      if (numbers::whole(0, 9) == 0)
        object.transform[numbers::whole(0, 3)].y = numbers::any_number(numbers::Kind::small);
    }
    const AssertionResult result = scales_agree(objects);
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(ErrorScalesTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(6);
  for (const std::size_t n : sizes) {
    std::vector<pgl::Object> objects(n);
    for (pgl::Object& object : objects)
      for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 3; ++row)
          object.transform[column][row] = static_cast<float>(static_cast<std::int32_t>(random())) * 0x1p-28f;
    EXPECT_TRUE(scales_agree(objects));
  }
}

}  // namespace
