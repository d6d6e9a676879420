// SPDX-License-Identifier: MIT
// Boxes, frustum culling and projection: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include "pgl/cuda/bounds.cuh"
#include "pgl/cuda/cull_frustum.cuh"
#include "pgl/cuda/project.cuh"
#include "pgl/host/bounds.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/project.hpp"
#include "support/numbers.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using numbers::Kind;
using pgl::Box;
using pgl::View;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

/// Sizes around the edges of warps and blocks, and more objects than one block of any size.
constexpr std::size_t sizes[] = {0, 1, 2, 31, 32, 33, 95, 96, 97, 255, 256, 257, 1023, 1024, 1025, 5000};

/// Demands one result of the CPU, with one thread and with all, and of the GPU at every block size.
template <class Inputs, class OnHost, class OnDevice>
AssertionResult agree(const Inputs& inputs, OnHost&& on_host, OnDevice&& on_device) {
  AssertionResult result = AssertionSuccess();
  const auto expected = on_host(inputs);
  with_host_threads([&] {
    if (const AssertionResult same = on_host(inputs).is(expected); !same)
      result = AssertionFailure() << "the host alone: " << same.message();
  });
  for (const unsigned threads : block_sizes)
    if (const AssertionResult same = on_device(inputs, threads).is(expected); !same)
      return AssertionFailure() << inputs.size() << " elements, blocks of " << threads << ": " << same.message();
  return result;
}

// ---- bounds

struct OneBox {
  std::vector<Box> box;
  AssertionResult is(const OneBox& other) const { return same_bytes(box, other.box); }
};

OneBox host_bounds(const std::vector<glm::vec3>& positions) {
  return {{pgl::host::bounds(positions)}};
}

OneBox device_bounds(const std::vector<glm::vec3>& positions, unsigned threads) {
  static pgl::cuda::BoundsWorkspace& workspace = *new pgl::cuda::BoundsWorkspace;  // outlives the CUDA context
  const DeviceArray<glm::vec3> in(positions);
  const DeviceArray<Box> out(1);
  must(pgl::cuda::bounds(in.input(), out.data(), workspace, {nullptr, threads}));
  return {out.read()};
}

/// Positions all over the floats' range, some not finite.
std::vector<glm::vec3> many_positions(std::size_t n, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<glm::vec3> positions(n);
  for (glm::vec3& p : positions)
    for (int axis = 0; axis < 3; ++axis)
      p[axis] = std::ldexp(static_cast<float>(static_cast<std::int32_t>(random())),
                           random() % 100 == 0 ? 120 : static_cast<int>(random() % 100) - 60);
  return positions;
}

TEST(BoundsTwin, SameBytesForRandomPositions) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    const Kind k = numbers::kind();
    std::vector<glm::vec3> positions(static_cast<std::size_t>(numbers::whole(0, 100)));
    for (glm::vec3& p : positions)
      for (int axis = 0; axis < 3; ++axis) p[axis] = numbers::any_number(k);
    const AssertionResult result = agree(positions, host_bounds, device_bounds);
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(BoundsTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : sizes) EXPECT_TRUE(agree(many_positions(n, 1), host_bounds, device_bounds));
  EXPECT_TRUE(agree(many_positions(1500001, 2), host_bounds, device_bounds));  // some threads have several
}

TEST(BoundsTwin, EmptyWhereNothingIsFinite) {
  PGL_NEEDS_DEVICE();
  const std::vector<glm::vec3> none(300, glm::vec3(0, std::numeric_limits<float>::quiet_NaN(), 0));
  EXPECT_TRUE(agree(none, host_bounds, device_bounds));
  EXPECT_EQ(device_bounds(none, 256).box[0], Box{});
}

TEST(BoundsTwin, OneFarPointAnywhereIsFound) {
  PGL_NEEDS_DEVICE();
  std::vector<glm::vec3> positions(2100, glm::vec3(1, 2, 3));
  for (const std::size_t at : {0, 31, 32, 255, 256, 1023, 1024, 2047, 2048, 2099}) {
    positions[at] = glm::vec3(-7, 99, 4);
    for (const unsigned threads : block_sizes)
      EXPECT_EQ(device_bounds(positions, threads).box[0], (Box{{-7, 2, 3}, {1, 99, 4}})) << at;
    positions[at] = glm::vec3(1, 2, 3);
  }
}

// ---- object_bounds

struct PlacedMeshes {
  std::vector<pgl::Object> objects;
  std::vector<Box> mesh_boxes;
  std::size_t size() const { return objects.size(); }
};
struct Boxes {
  std::vector<Box> boxes;
  AssertionResult is(const Boxes& other) const { return same_bytes(boxes, other.boxes); }
};

Boxes host_object_bounds(const PlacedMeshes& in) {
  Boxes out{std::vector<Box>(in.size())};
  pgl::host::object_bounds(in.objects, in.mesh_boxes, out.boxes);
  return out;
}

Boxes device_object_bounds(const PlacedMeshes& in, unsigned threads) {
  const DeviceArray<pgl::Object> objects(in.objects);
  const DeviceArray<Box> mesh_boxes(in.mesh_boxes), out(in.size());
  must(pgl::cuda::object_bounds(objects.input(), mesh_boxes.input(), out.view(), {nullptr, threads}));
  return {out.read()};
}

TEST(ObjectBoundsTwin, SameBytesForRandomTransforms) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    PlacedMeshes in;
    in.mesh_boxes = {Box{}, numbers::box(numbers::kind()), numbers::box(numbers::kind())};
    Box odd;
    for (int axis = 0; axis < 3; ++axis) {
      odd.min[axis] = numbers::any_number(Kind::wide);
      odd.max[axis] = numbers::any_number(Kind::wide);
    }
    in.mesh_boxes.push_back(odd);
    in.objects.resize(static_cast<std::size_t>(numbers::whole(0, 70)));
    for (pgl::Object& object : in.objects) {
      object.mesh = static_cast<std::uint32_t>(numbers::whole(0, 3));
      object.transform = numbers::any_affine();
      if (numbers::whole(0, 9) == 0) object.transform[numbers::whole(0, 3)].y = numbers::any_number(Kind::small);
    }
    const AssertionResult result = agree(in, host_object_bounds, device_object_bounds);
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(ObjectBoundsTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(3);
  const auto number = [&] { return static_cast<float>(static_cast<std::int32_t>(random())) * 0x1p-28f; };
  for (const std::size_t n : sizes) {
    PlacedMeshes in;
    in.mesh_boxes = {Box{{-1, -2, -3}, {1, 2, 3}}, Box{{0.1f, 0.2f, 0.3f}, {0.4f, 0.5f, 0.6f}}};
    in.objects.resize(n);
    for (pgl::Object& object : in.objects) {
      object.mesh = random() % 2;
      for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 3; ++row) object.transform[column][row] = number();
    }
    EXPECT_TRUE(agree(in, host_object_bounds, device_object_bounds));
  }
}

// ---- cull_frustum and project

struct Scene {
  std::vector<Box> boxes;
  View view;
  std::size_t size() const { return boxes.size(); }
};

/// What culling gives, then projection of what is in view with rectangles, then of all without.
struct Selection {
  std::vector<std::uint8_t> in_view;
  std::vector<float> areas, depths;
  std::vector<pgl::ScreenBox> rectangles;
  std::vector<float> all_areas, all_depths;

  AssertionResult is(const Selection& other) const {
    if (AssertionResult same = same_bytes(in_view, other.in_view); !same) return same << " (in view)";
    if (AssertionResult same = same_bytes(areas, other.areas); !same) return same << " (areas)";
    if (AssertionResult same = same_bytes(depths, other.depths); !same) return same << " (depths)";
    if (AssertionResult same = same_bytes(rectangles, other.rectangles); !same) return same << " (rectangles)";
    if (AssertionResult same = same_bytes(all_areas, other.all_areas); !same) return same << " (areas of all)";
    if (AssertionResult same = same_bytes(all_depths, other.all_depths); !same) return same << " (depths of all)";
    return AssertionSuccess();
  }
};

Selection host_selection(const Scene& scene) {
  const std::size_t n = scene.size();
  Selection out{std::vector<std::uint8_t>(n),   std::vector<float>(n), std::vector<float>(n),
                std::vector<pgl::ScreenBox>(n), std::vector<float>(n), std::vector<float>(n)};
  pgl::host::cull_frustum(scene.boxes, scene.view, out.in_view);
  pgl::host::project(scene.boxes, out.in_view, scene.view, out.areas, out.depths, out.rectangles);
  pgl::host::project(scene.boxes, {}, scene.view, out.all_areas, out.all_depths);
  return out;
}

/// The arrays of a scene on the device.
struct OnDevice {
  explicit OnDevice(const Scene& scene)
      : boxes(scene.boxes),
        in_view(scene.size()),
        areas(scene.size()),
        depths(scene.size()),
        all_areas(scene.size()),
        all_depths(scene.size()),
        rectangles(scene.size()) {}
  cudaError_t select(const View& view, pgl::cuda::Launch launch) const {
    PGL_CUDA_TRY(pgl::cuda::cull_frustum(boxes.input(), view, in_view.view(), launch));
    PGL_CUDA_TRY(pgl::cuda::project(boxes.input(), in_view.input(), view, areas.view(), depths.view(),
                                    rectangles.view(), launch));
    return pgl::cuda::project(boxes.input(), {}, view, all_areas.view(), all_depths.view(), {}, launch);
  }
  Selection read() const {
    return {in_view.read(), areas.read(), depths.read(), rectangles.read(), all_areas.read(), all_depths.read()};
  }
  DeviceArray<Box> boxes;
  DeviceArray<std::uint8_t> in_view;
  DeviceArray<float> areas, depths, all_areas, all_depths;
  DeviceArray<pgl::ScreenBox> rectangles;
};

Selection device_selection(const Scene& scene, unsigned threads) {
  const OnDevice device(scene);
  must(device.select(scene.view, {nullptr, threads}));
  return device.read();
}

/// Boxes of all sizes about a camera in their midst, some empty, some not finite.
Scene large_scene(std::size_t n, std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * (static_cast<float>(random() >> 8) * 0x1p-24f);
  };
  Scene scene;
  scene.view.width = 1920;
  scene.view.height = 1080;
  scene.view.near_depth = 0.1f;
  scene.view.clip_from_world = glm::perspective(1.0f, 16.0f / 9, 0.1f, 2000.0f) *
                               glm::lookAt(glm::vec3(30, 30, 20), glm::vec3(-100, 20, 55), glm::vec3(0, 1, 0));
  for (std::size_t i = 0; i < n; ++i) {
    const glm::vec3 centre(uniform(-500, 500), uniform(0, 60), uniform(-500, 500));
    const float most = std::ldexp(1.0f, static_cast<int>(random() % 16) - 8);
    const glm::vec3 half(uniform(0, most), uniform(0, most), uniform(0, most));
    Box box{centre - half, centre + half};
    if (random() % 50 == 0) box = Box{};
    if (random() % 50 == 0) box.max.y = std::numeric_limits<float>::quiet_NaN();
    if (random() % 50 == 0) box.min.x = -std::numeric_limits<float>::infinity();
    scene.boxes.push_back(box);
  }
  return scene;
}

TEST(CullFrustumAndProjectTwin, SameBytesForRandomViews) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    for (int repeat = 0; repeat < 2; ++repeat) {
      const Kind k = numbers::kind();
      Scene scene;
      scene.view = numbers::view(k);
      scene.boxes.resize(static_cast<std::size_t>(numbers::whole(0, 100)));
      for (Box& box : scene.boxes) {
        box = numbers::box_near(scene.view, k);
        if (numbers::whole(0, 9) == 0) box.min[numbers::whole(0, 2)] = numbers::any_number(k);
        if (numbers::whole(0, 9) == 0) box.max[numbers::whole(0, 2)] = numbers::any_number(k);
      }
      const AssertionResult result = agree(scene, host_selection, device_selection);
      if (!result) RC_FAIL(result.message());
    }
  }));
}

TEST(CullFrustumAndProjectTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : sizes) EXPECT_TRUE(agree(large_scene(n, 4), host_selection, device_selection));
  const Scene scene = large_scene(700001, 5);
  EXPECT_TRUE(agree(scene, host_selection, device_selection));
  const Selection selection = host_selection(scene);
  std::size_t in_view = 0, seen = 0;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    in_view += selection.in_view[i];
    seen += selection.areas[i] > 0;
  }
  EXPECT_GT(in_view, scene.size() / 20);  // both outcomes are there
  EXPECT_LT(in_view, scene.size() / 2);
  EXPECT_GT(seen, scene.size() / 20);
}

TEST(CullFrustumAndProjectTwin, ReplaysAsAGraphOverOtherBoxes) {
  PGL_NEEDS_DEVICE();
  const Scene scene = large_scene(3001, 6);
  const OnDevice device(scene);
  const pgl::test::Captured graph([&](cudaStream_t stream) { return device.select(scene.view, stream); });
  for (const std::uint32_t seed : {6u, 7u}) {
    const Scene now = large_scene(3001, seed);
    pgl::test::assign(device.boxes, now.boxes);
    pgl::test::poison(device.in_view);
    pgl::test::poison(device.areas);
    pgl::test::poison(device.depths);
    pgl::test::poison(device.rectangles);
    pgl::test::poison(device.all_areas);
    pgl::test::poison(device.all_depths);
    graph.replay();
    EXPECT_TRUE(device.read().is(host_selection(now)));
  }
}

TEST(BoundsTwin, ReplaysAsAGraphOnceWarm) {
  PGL_NEEDS_DEVICE();
  pgl::cuda::BoundsWorkspace workspace;
  const DeviceArray<glm::vec3> positions(many_positions(50000, 8));
  const DeviceArray<Box> out(1);
  must(pgl::cuda::bounds(positions.input(), out.data(), workspace));
  const void* const memory = workspace.memory.at<void>();
  const pgl::test::Captured graph(
      [&](cudaStream_t stream) { return pgl::cuda::bounds(positions.input(), out.data(), workspace, stream); });
  for (const std::uint32_t seed : {8u, 9u}) {
    const std::vector<glm::vec3> now = many_positions(50000, seed);
    pgl::test::assign(positions, now);
    pgl::test::poison(out);
    graph.replay();
    EXPECT_TRUE(same_bytes(out.read(), host_bounds(now).box));
  }
  EXPECT_EQ(workspace.memory.at<void>(), memory);
}

}  // namespace
