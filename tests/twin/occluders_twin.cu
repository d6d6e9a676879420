// SPDX-License-Identifier: MIT
// Faces of occluders, the order of compactness and the choice of occluders: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "pgl/cuda/select_occluders.cuh"
#include "pgl/host/select_occluders.hpp"
#include "support/numbers.hpp"
#include "support/occluder_scenes.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using numbers::Kind;
using occluders::Scene;
using pgl::OccluderFace;
using pgl::OrientedBox;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;
using Indices = std::vector<std::uint32_t>;

constexpr float nan = std::numeric_limits<float>::quiet_NaN();

/// Sizes around the edges of warps and blocks, and more than one block of any size.
constexpr std::size_t sizes[] = {0, 1, 2, 31, 32, 33, 95, 96, 97, 255, 256, 257, 1023, 1024, 1025, 5000};

pgl::cuda::OccluderWorkspace& device_workspace() {
  static pgl::cuda::OccluderWorkspace& workspace = *new pgl::cuda::OccluderWorkspace;  // outlives the CUDA context
  return workspace;
}

// ---- faces

struct Placed {
  std::vector<pgl::Object> objects;
  std::vector<OrientedBox> boxes;
  std::vector<float> compactness;
};

std::vector<OccluderFace> host_faces(const Placed& in) {
  std::vector<OccluderFace> faces(in.objects.size());
  pgl::host::occluder_faces(in.objects, in.boxes, in.compactness, faces);
  return faces;
}

AssertionResult faces_agree(const Placed& in) {
  const std::vector<OccluderFace> expected = host_faces(in);
  AssertionResult result = AssertionSuccess();
  with_host_threads([&] {
    if (!same_bytes(host_faces(in), expected)) result = AssertionFailure() << "the host alone";
  });
  const DeviceArray<pgl::Object> objects(in.objects);
  const DeviceArray<OrientedBox> boxes(in.boxes);
  const DeviceArray<float> compactness(in.compactness);
  for (const unsigned threads : block_sizes) {
    const DeviceArray<OccluderFace> faces(in.objects.size());
    must(pgl::cuda::occluder_faces(objects.input(), boxes.input(), compactness.input(), faces.view(),
                                   {nullptr, threads}));
    if (AssertionResult same = same_bytes(faces.read(), expected); !same) return same << ", blocks of " << threads;
  }
  return result;
}

TEST(OccluderFacesTwin, SameBytesForRandomBoxesAndTransforms) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    Placed in;
    in.boxes.resize(4);
    in.compactness = {0.0f, 1.0f, 0.3f, 0.7f};
    for (std::size_t i = 1; i < 4; ++i) {
      const Kind k = numbers::kind();
      in.boxes[i].centre = numbers::point(k);
      for (int axis = 0; axis < 3; ++axis) {
        in.boxes[i].axes[axis] = numbers::point(Kind::plain);
        in.boxes[i].half[axis] = std::abs(numbers::number(k));
      }
    }
    in.objects.resize(static_cast<std::size_t>(numbers::whole(0, 70)));
    for (pgl::Object& object : in.objects) {
      object.mesh = static_cast<std::uint32_t>(numbers::whole(0, 3));
      object.transform = numbers::any_affine();
      if (numbers::whole(0, 9) == 0) object.transform[numbers::whole(0, 3)].y = numbers::any_number(Kind::small);
    }
    const AssertionResult result = faces_agree(in);
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(OccluderFacesTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(1);
  const auto number = [&] { return static_cast<float>(static_cast<std::int32_t>(random())) * 0x1p-28f; };
  Placed in;
  in.boxes.resize(2);
  in.boxes[0].half = {3, 2, 1};
  in.boxes[1].half = {1, 0.5f, 0};
  in.compactness = {0.25f, 1};
  for (const std::size_t n : sizes) {
    in.objects.resize(n);
    for (pgl::Object& object : in.objects) {
      object.mesh = random() % 2;
      for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 3; ++row) object.transform[column][row] = number();
    }
    EXPECT_TRUE(faces_agree(in));
  }
}

// ---- the order of compactness

Indices host_order(const std::vector<OccluderFace>& in) {
  pgl::host::OccluderWorkspace workspace;
  Indices order(in.size());
  pgl::host::compactness_order(in, workspace, order);
  return order;
}

AssertionResult orders_agree(const std::vector<OccluderFace>& in) {
  const Indices expected = host_order(in);
  AssertionResult result = AssertionSuccess();
  with_host_threads([&] {
    if (!same_bytes(host_order(in), expected)) result = AssertionFailure() << "the host alone";
  });
  const DeviceArray<OccluderFace> faces(in);
  for (const unsigned threads : block_sizes) {
    const DeviceArray<std::uint32_t> order(in.size());
    must(pgl::cuda::compactness_order(faces.input(), device_workspace(), order.view(), {nullptr, threads}));
    if (AssertionResult same = same_bytes(order.read(), expected); !same) return same << ", blocks of " << threads;
  }
  return result;
}

TEST(CompactnessOrderTwin, SameBytesForAnyCompactness) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    const AssertionResult result = orders_agree(occluders::any_scene().faces);
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(CompactnessOrderTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(2);
  const auto some = [&](std::size_t n) {
    std::vector<OccluderFace> faces(n);
    for (OccluderFace& face : faces) {
      face.compactness = static_cast<float>(random() % 2000) / 1999;  // most of them several times
      if (random() % 50 == 0) face.compactness = nan;
      if (random() % 50 == 0) face.compactness = -0.0f;
    }
    return faces;
  };
  for (const std::size_t n : sizes) EXPECT_TRUE(orders_agree(some(n)));
  EXPECT_TRUE(orders_agree(some(700001)));
}

// ---- the choice

Indices on_host(const Scene& scene) {
  pgl::host::OccluderWorkspace workspace;
  Indices chosen(scene.wanted);
  pgl::host::select_occluders(scene.candidates, scene.faces, scene.in_view, scene.view, workspace, chosen);
  return chosen;
}

struct OnDevice {
  explicit OnDevice(const Scene& scene)
      : candidates(scene.candidates), faces(scene.faces), in_view(scene.in_view), chosen(scene.wanted) {}
  cudaError_t select(const pgl::View& view, pgl::cuda::OccluderWorkspace& workspace, pgl::cuda::Launch launch) const {
    return pgl::cuda::select_occluders(candidates.input(), faces.input(), in_view.input(), view, workspace,
                                       chosen.view(), launch);
  }
  DeviceArray<std::uint32_t> candidates;
  DeviceArray<OccluderFace> faces;
  DeviceArray<std::uint8_t> in_view;
  DeviceArray<std::uint32_t> chosen;
};

AssertionResult choices_agree(const Scene& scene) {
  const Indices expected = on_host(scene);
  AssertionResult result = AssertionSuccess();
  with_host_threads([&] {
    if (!same_bytes(on_host(scene), expected)) result = AssertionFailure() << "the host alone";
  });
  for (const unsigned threads : block_sizes) {
    const OnDevice device(scene);
    must(device.select(scene.view, device_workspace(), {nullptr, threads}));
    if (AssertionResult same = same_bytes(device.chosen.read(), expected); !same)
      return same << ": " << scene.wanted << " of " << scene.size() << ", blocks of " << threads;
  }
  return result;
}

/// Objects of all sizes around a camera in their midst.
Scene large_scene(std::size_t n, std::uint32_t seed, std::size_t wanted) {
  std::mt19937 random(seed);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * (static_cast<float>(random() >> 8) * 0x1p-24f);
  };
  Scene scene;
  scene.wanted = wanted;
  scene.view.clip_from_world = glm::perspective(1.0f, 16.0f / 9, 0.1f, 2000.0f) *
                               glm::lookAt(glm::vec3(30, 30, 20), glm::vec3(-100, 20, 55), glm::vec3(0, 1, 0));
  for (std::size_t i = 0; i < n; ++i) {
    OccluderFace face;
    face.centre = {uniform(-500, 500), uniform(0, 60), uniform(-500, 500)};
    const float size = std::ldexp(1.0f, static_cast<int>(random() % 16) - 8);
    face.normal = {uniform(-size, size), uniform(-size, size), uniform(-size, size)};
    face.compactness = uniform(0, 1);
    if (random() % 50 == 0) face.compactness = nan;
    if (random() % 50 == 0) face.normal = glm::vec3(0);
    scene.faces.push_back(face);
    scene.in_view.push_back(random() % 3 != 0);
    scene.candidates.push_back(static_cast<std::uint32_t>(i));
  }
  for (std::size_t i = n; i > 1; --i) std::swap(scene.candidates[i - 1], scene.candidates[random() % i]);
  return scene;
}

TEST(SelectOccludersTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    const Scene scene = occluders::any_scene();
    const AssertionResult result = choices_agree(scene);
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(SelectOccludersTwin, SameBytesAtEverySizeFromNoneToMoreThanAll) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : sizes)
    for (const std::size_t wanted : {std::size_t{0}, std::size_t{1}, std::size_t{20}, n / 2, n, n + 5}) {
      Scene scene = large_scene(n, 3, wanted);
      EXPECT_TRUE(choices_agree(scene));
      scene.in_view.clear();  // all
      EXPECT_TRUE(choices_agree(scene));
    }
}

TEST(SelectOccludersTwin, SameBytesForAMillionCandidates) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t wanted :
       {std::size_t{20}, std::size_t{256}, std::size_t{5000}, std::size_t{400000}, std::size_t{1000001}}) {
    const Scene scene = large_scene(1000001, 4, wanted);
    EXPECT_TRUE(choices_agree(scene));
  }
}

TEST(SelectOccludersTwin, SameBytesWhereAllWeighTheSame) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : {std::size_t{33}, std::size_t{1025}, std::size_t{300001}}) {
    Scene scene = large_scene(n, 5, 0);
    for (const bool weightless : {false, true}) {
      for (OccluderFace& face : scene.faces) face = {{0, 0, 0}, glm::vec3(weightless ? 0.0f : 1.0f), 1};
      for (const std::size_t wanted : {std::size_t{1}, std::size_t{20}, std::size_t{200}, n / 3, n}) {
        scene.wanted = wanted;
        EXPECT_TRUE(choices_agree(scene));
      }
    }
  }
}

TEST(SelectOccludersTwin, SameBytesWhereAsManyWeighTheSameAsABlockListsOrSomeMore) {
  PGL_NEEDS_DEVICE();
  const std::size_t spare = pgl::cuda::detail::few_spare;
  std::mt19937 random(8);
  for (const std::size_t n : {std::size_t{900}, std::size_t{20001}})  // in the part of one block, and of several
    for (const std::size_t wanted : {std::size_t{1}, std::size_t{20}, std::size_t{256}})
      for (const std::size_t heavy : {wanted - 1, wanted, wanted + 1, wanted + spare - 1, wanted + spare,
                                      wanted + spare + 1, 2 * (wanted + spare)}) {
        Scene scene = large_scene(n, 9, wanted);
        scene.in_view.clear();
        for (OccluderFace& face : scene.faces) face = {{0, 0, 0}, glm::vec3(0.01f), 1};
        for (std::size_t i = 0; i < heavy; ++i) {
          const std::size_t other = i + random() % (n - i);
          std::swap(scene.candidates[i], scene.candidates[other]);
          scene.faces[scene.candidates[i]].normal = glm::vec3(1);
        }
        if (random() % 2 == 0)  // else they come first
          std::shuffle(scene.candidates.begin(), scene.candidates.end(), random);
        EXPECT_TRUE(choices_agree(scene)) << heavy << " heavy ones";
      }
}

TEST(SelectOccludersTwin, SameBytesWhereTheWeightsDifferInTheirLastBitsOnly) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : {std::size_t{1500}, std::size_t{100003}})
    for (const std::size_t wanted : {std::size_t{1}, std::size_t{20}, std::size_t{256}, std::size_t{257}}) {
      Scene scene = large_scene(n, 10, wanted);
      for (std::size_t i = 0; i < n; ++i)
        scene.faces[i] = {{0, 0, 0}, glm::vec3(1), std::ldexp(static_cast<float>((1 << 23) + i * 7919 % 64), -23)};
      EXPECT_TRUE(choices_agree(scene));
    }
}

TEST(SelectOccludersTwin, SameBytesOnEitherSideOfFewAndMany) {
  PGL_NEEDS_DEVICE();
  const std::size_t few = pgl::cuda::detail::most_few;
  for (const std::size_t n : {std::size_t{10}, few - 1, few, few + 1, std::size_t{9000}, std::size_t{300001}})
    for (const std::size_t wanted : {few - 1, few, few + 1}) EXPECT_TRUE(choices_agree(large_scene(n, 11, wanted)));
}

TEST(SelectOccludersTwin, NeedsNothingOfWhatTheCallsBeforeLeftInTheMemory) {
  PGL_NEEDS_DEVICE();
  const Scene scene = large_scene(40000, 12, 20);
  Scene many = scene;
  many.wanted = 5000;
  const Indices expected = on_host(scene), expected_many = on_host(many);
  pgl::cuda::OccluderWorkspace workspace;
  const DeviceArray<std::uint32_t> order(scene.faces.size());
  for (const int garbage : {0x00, 0xA5, 0xff}) {
    for (const unsigned threads : block_sizes) {  // more blocks and fewer
      const OnDevice device(scene), device_many(many);
      must(device.select(scene.view, workspace, {nullptr, threads}));
      EXPECT_TRUE(same_bytes(device.chosen.read(), expected));
      must(cudaMemset(workspace.memory.at<void>(), garbage, workspace.memory.size()));
      must(device_many.select(many.view, workspace, {nullptr, threads}));
      EXPECT_TRUE(same_bytes(device_many.chosen.read(), expected_many));
      must(pgl::cuda::compactness_order(device.faces.input(), workspace, order.view(), {nullptr, threads}));
      pgl::test::poison(device.chosen);
      must(device.select(scene.view, workspace, {nullptr, threads}));
      EXPECT_TRUE(same_bytes(device.chosen.read(), expected));
    }
    must(cudaMemset(workspace.memory.at<void>(), garbage, workspace.memory.size()));
  }
}

TEST(SelectOccludersTwin, FillsUpWithNoObjectWhereNothingIsInView) {
  PGL_NEEDS_DEVICE();
  Scene scene = large_scene(3000, 6, 1000);
  std::fill(scene.in_view.begin(), scene.in_view.end(), std::uint8_t{0});
  for (const std::size_t wanted : {std::size_t{1000}, std::size_t{100}}) {
    scene.wanted = wanted;
    EXPECT_TRUE(choices_agree(scene));
    EXPECT_EQ(on_host(scene), Indices(wanted, pgl::no_object));
  }
}

TEST(SelectOccludersTwin, ReplaysAsAGraphOverOtherFacesAndAllocatesNothingOnceWarm) {
  PGL_NEEDS_DEVICE();
  Scene scene = large_scene(30000, 7, 50);
  pgl::cuda::OccluderWorkspace workspace;
  const OnDevice device(scene);
  const DeviceArray<std::uint32_t> order(scene.faces.size());
  const auto enqueue = [&](cudaStream_t stream) {
    PGL_CUDA_TRY(pgl::cuda::compactness_order(device.faces.input(), workspace, order.view(), stream));
    return device.select(scene.view, workspace, stream);
  };
  must(enqueue(nullptr));
  const void* const memory = workspace.memory.at<void>();
  const pgl::test::Captured graph(enqueue);
  for (const std::uint32_t seed : {7u, 8u, 9u}) {
    const Scene now = large_scene(30000, seed, 50);
    pgl::test::assign(device.faces, now.faces);
    pgl::test::assign(device.candidates, now.candidates);
    pgl::test::assign(device.in_view, now.in_view);
    pgl::test::poison(device.chosen);
    pgl::test::poison(order);
    graph.replay();
    EXPECT_TRUE(same_bytes(device.chosen.read(), on_host(now)));
    pgl::host::OccluderWorkspace host_workspace;
    Indices expected(now.faces.size());
    pgl::host::compactness_order(now.faces, host_workspace, expected);
    EXPECT_TRUE(same_bytes(order.read(), expected));
  }
  EXPECT_EQ(workspace.memory.at<void>(), memory);
  graph.replay();  // among calls that do not come from the graph
  must(device.select(scene.view, workspace, {nullptr, 64}));
  pgl::test::poison(device.chosen);
  graph.replay();
  EXPECT_TRUE(same_bytes(device.chosen.read(), on_host(large_scene(30000, 9, 50))));
}

TEST(SelectOccludersTwin, ReplaysAsAGraphWithManyOccluders) {
  PGL_NEEDS_DEVICE();
  Scene scene = large_scene(30000, 13, 3000);
  pgl::cuda::OccluderWorkspace workspace;
  const OnDevice device(scene);
  const auto enqueue = [&](cudaStream_t stream) { return device.select(scene.view, workspace, stream); };
  must(enqueue(nullptr));
  const pgl::test::Captured graph(enqueue);
  for (const std::uint32_t seed : {13u, 14u}) {
    const Scene now = large_scene(30000, seed, 3000);
    pgl::test::assign(device.faces, now.faces);
    pgl::test::assign(device.candidates, now.candidates);
    pgl::test::assign(device.in_view, now.in_view);
    pgl::test::poison(device.chosen);
    graph.replay();
    EXPECT_TRUE(same_bytes(device.chosen.read(), on_host(now)));
  }
}

}  // namespace
