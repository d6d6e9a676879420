// SPDX-License-Identifier: MIT
// The hierarchical-Z map and the occlusion test: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "pgl/cuda/build_hzm.cuh"
#include "pgl/cuda/cull_occluded.cuh"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "support/depth_maps.hpp"
#include "support/numbers.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using numbers::Kind;
using numbers::whole;
using pgl::Box;
using pgl::Depth;
using pgl::DepthMap;
using pgl::View;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using test::Depths;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

// ---- build_hzm

std::vector<Depth> host_hzm(const DepthMap& size, std::vector<Depth> texels) {
  pgl::host::build_hzm(size, texels);
  return texels;
}

/// `shift` texels behind an aligned address, so that rows may be read by four, or written by two, or neither.
std::vector<Depth> device_hzm(const DepthMap& size, const std::vector<Depth>& texels, unsigned threads,
                              std::size_t shift) {
  const DeviceArray<Depth> on_device(texels, shift);
  must(pgl::cuda::build_hzm(size, on_device.view(), {nullptr, threads}));
  return on_device.read();
}

AssertionResult maps_agree(const DepthMap& size, const std::vector<Depth>& texels) {
  AssertionResult result = AssertionSuccess();
  const std::vector<Depth> expected = host_hzm(size, texels);
  with_host_threads([&] {
    if (const AssertionResult same = same_bytes(host_hzm(size, texels), expected); !same)
      result = AssertionFailure() << "the host alone: " << same.message();
  });
  for (const unsigned threads : block_sizes)
    for (const std::size_t shift : {0, 1, 2}) {
      if (const AssertionResult same = same_bytes(device_hzm(size, texels, threads, shift), expected); !same)
        return AssertionFailure() << size.width << " x " << size.height << ", blocks of " << threads << ", shifted by "
                                  << shift << ": " << same.message();
    }
  return result;
}

TEST(BuildHzmTwin, SameBytesForRandomMaps) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    const DepthMap size =
        test::map_of(static_cast<std::uint32_t>(whole(1, 300)), static_cast<std::uint32_t>(whole(1, 300)));
    const auto kind = static_cast<Depths>(whole(0, 3));
    const auto seed = static_cast<std::uint32_t>(whole(0, 1 << 30));
    const AssertionResult result = maps_agree(size, test::texels_of(size, kind, seed));
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(BuildHzmTwin, SameBytesAtOddSizes) {
  PGL_NEEDS_DEVICE();
  for (const DepthMap& size : test::odd_sizes()) {
    EXPECT_TRUE(maps_agree(size, test::texels_of(size, Depths::noise, 1)));
    EXPECT_TRUE(maps_agree(size, test::texels_of(size, Depths::few_values, 2)));
  }
}

TEST(BuildHzmTwin, SameBytesForLargeMaps) {
  PGL_NEEDS_DEVICE();
  for (const DepthMap& size :
       {test::map_of(4096, 4096), test::map_of(4097, 2049), test::map_of(65536, 70), test::map_of(33, 65536)})
    EXPECT_TRUE(maps_agree(size, test::texels_of(size, Depths::noise, 3)));
}

TEST(BuildHzmTwin, ReplaysAsAGraphOverOtherDepths) {
  PGL_NEEDS_DEVICE();
  const DepthMap size = test::map_of(1000, 700);
  const DeviceArray<Depth> texels(pgl::hzm_texels(size));
  const pgl::test::Captured graph(
      [&](cudaStream_t stream) { return pgl::cuda::build_hzm(size, texels.view(), stream); });
  for (const std::uint32_t seed : {4u, 5u}) {
    const std::vector<Depth> depths = test::texels_of(size, Depths::noise, seed);
    pgl::test::assign(texels, depths);
    graph.replay();
    EXPECT_TRUE(same_bytes(texels.read(), host_hzm(size, depths)));
  }
}

// ---- cull_occluded

struct Scene {
  std::vector<Box> boxes;
  std::vector<std::uint8_t> in_view;
  std::vector<std::uint32_t> occluders;
  View view;
  DepthMap size;
  std::vector<Depth> hzm;
  std::uint32_t refinement = 0;
};

std::vector<std::uint8_t> host_visible(const Scene& s) {
  std::vector<std::uint8_t> visible(s.boxes.size(), 0xA5);
  pgl::host::cull_occluded(s.boxes, s.in_view, s.occluders, s.view, s.size, s.hzm, s.refinement, visible);
  return visible;
}

/// The arrays of a scene on the device.
struct OnDevice {
  explicit OnDevice(const Scene& s)
      : boxes(s.boxes), in_view(s.in_view), visible(s.boxes.size()), occluders(s.occluders), hzm(s.hzm) {}
  cudaError_t cull(const Scene& s, pgl::cuda::Launch launch) const {
    return pgl::cuda::cull_occluded(boxes.input(), in_view.input(), occluders.input(), s.view, s.size, hzm.input(),
                                    s.refinement, visible.view(), launch);
  }
  DeviceArray<Box> boxes;
  DeviceArray<std::uint8_t> in_view, visible;
  DeviceArray<std::uint32_t> occluders;
  DeviceArray<Depth> hzm;
};

AssertionResult scenes_agree(const Scene& s) {
  AssertionResult result = AssertionSuccess();
  const std::vector<std::uint8_t> expected = host_visible(s);
  with_host_threads([&] {
    if (const AssertionResult same = same_bytes(host_visible(s), expected); !same)
      result = AssertionFailure() << "the host alone: " << same.message();
  });
  for (const unsigned threads : block_sizes) {
    const OnDevice device(s);
    must(device.cull(s, {nullptr, threads}));
    if (const AssertionResult same = same_bytes(device.visible.read(), expected); !same)
      return AssertionFailure() << s.boxes.size() << " boxes, blocks of " << threads << ": " << same.message();
    if (const AssertionResult same = same_bytes(device.in_view.read(), s.in_view); !same)
      return AssertionFailure() << "in_view was written: " << same.message();
    // In place.
    must(pgl::cuda::cull_occluded(device.boxes.input(), device.in_view.input(), device.occluders.input(), s.view,
                                  s.size, device.hzm.input(), s.refinement, device.in_view.view(), {nullptr, threads}));
    if (const AssertionResult same = same_bytes(device.in_view.read(), expected); !same)
      return AssertionFailure() << s.boxes.size() << " boxes in place, blocks of " << threads << ": " << same.message();
  }
  return result;
}

TEST(CullOccludedTwin, SameBytesForRandomViews) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    const Kind k = numbers::kind();
    Scene s;
    s.view = numbers::view(k);
    s.view.width = static_cast<float>(whole(1, 200));
    s.view.height = static_cast<float>(whole(1, 200));
    s.view.depth_order = whole(0, 1) ? pgl::DepthOrder::reversed : pgl::DepthOrder::conventional;
    s.size = pgl::depth_map_of(s.view, static_cast<std::uint32_t>(whole(1, 5)));
    s.refinement = static_cast<std::uint32_t>(whole(0, 3));
    s.hzm = test::texels_of(s.size, static_cast<Depths>(whole(0, 3)), static_cast<std::uint32_t>(whole(0, 1 << 30)));
    pgl::host::build_hzm(s.size, s.hzm);
    s.boxes.resize(static_cast<std::size_t>(whole(0, 100)));
    for (std::size_t i = 0; i < s.boxes.size(); ++i) {
      Box& box = s.boxes[i];
      box = numbers::box_near(s.view, k);
      if (whole(0, 9) == 0) box.min[whole(0, 2)] = numbers::any_number(k);
      if (whole(0, 9) == 0) box.max[whole(0, 2)] = numbers::any_number(k);
      s.in_view.push_back(static_cast<std::uint8_t>(whole(0, 3) == 0 ? 0 : whole(1, 255)));
      if (s.in_view.back() != 0 && whole(0, 9) == 0) s.occluders.push_back(static_cast<std::uint32_t>(i));
      if (whole(0, 9) == 0) s.occluders.push_back(pgl::no_object);
    }
    const AssertionResult result = scenes_agree(s);
    if (!result) RC_FAIL(result.message());
  }));
}

/// Boxes of all sizes before a wall, behind it and around the camera; some empty, some not finite.
Scene large_scene(std::size_t n, std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * (static_cast<float>(random() >> 8) * 0x1p-24f);
  };
  Scene s;
  s.view.width = 640;
  s.view.height = 360;
  s.view.near_depth = 0.1f;
  s.view.clip_from_world = glm::perspective(1.0f, 16.0f / 9, 0.1f, 2000.0f) *
                           glm::lookAt(glm::vec3(30, 30, 20), glm::vec3(-100, 20, 55), glm::vec3(0, 1, 0));
  s.size = pgl::depth_map_of(s.view);
  s.hzm = test::texels_of(s.size, Depths::noise, seed);
  const Depth wall = pgl::depth_above(0.998);  // some 50 before the camera
  for (std::size_t i = 0; i < s.hzm.size(); ++i) s.hzm[i] = s.hzm[i] % 1000 == 0 ? pgl::far_depth : wall;
  pgl::host::build_hzm(s.size, s.hzm);
  for (std::size_t i = 0; i < n; ++i) {
    const glm::vec3 centre(uniform(-200, 200), uniform(0, 60), uniform(-200, 200));
    const float most = std::ldexp(1.0f, static_cast<int>(random() % 16) - 12);
    const glm::vec3 half(uniform(0, most), uniform(0, most), uniform(0, most));
    Box box{centre - half, centre + half};
    if (random() % 50 == 0) box = Box{};
    if (random() % 50 == 0) box.max.y = std::numeric_limits<float>::quiet_NaN();
    if (random() % 50 == 0) box.min.x = -std::numeric_limits<float>::infinity();
    s.boxes.push_back(box);
    // Runs in view and runs out of it, and single ones.
    s.in_view.push_back(static_cast<std::uint8_t>((i / 700 % 3 != 1) == (random() % 8 != 0)));
    if (s.in_view.back() != 0 && s.occluders.size() < 2000 && random() % 16 == 0)
      s.occluders.push_back(random() % 4 == 0 ? pgl::no_object : static_cast<std::uint32_t>(i));
  }
  return s;
}

TEST(CullOccludedTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : {0, 1, 31, 32, 33, 127, 128, 129, 383, 384, 385, 1023, 1024, 1025, 2047, 2048, 2049, 5000})
    EXPECT_TRUE(scenes_agree(large_scene(n, 6)));
}

TEST(CullOccludedTwin, SameBytesForManyBoxes) {
  PGL_NEEDS_DEVICE();
  Scene s = large_scene(700001, 7);
  EXPECT_TRUE(scenes_agree(s));
  const std::vector<std::uint8_t> visible = host_visible(s);
  const auto in_view = std::count(s.in_view.begin(), s.in_view.end(), 1);
  const auto seen = std::count(visible.begin(), visible.end(), 1);
  EXPECT_GT(in_view - seen, in_view / 20);  // both outcomes are there
  EXPECT_GT(seen, in_view / 20);
  for (const std::uint32_t refinement : {1u, 2u, 16u}) {
    Scene finer = s;
    finer.refinement = refinement;
    EXPECT_TRUE(scenes_agree(finer));
    const std::vector<std::uint8_t> still = host_visible(finer);
    EXPECT_LT(std::count(still.begin(), still.end(), 1), seen);
  }
  s.occluders.clear();
  std::fill(s.in_view.begin(), s.in_view.end(), std::uint8_t{1});
  EXPECT_TRUE(scenes_agree(s));
  std::fill(s.in_view.begin(), s.in_view.end(), std::uint8_t{0});
  EXPECT_TRUE(scenes_agree(s));
}

TEST(CullOccludedTwin, ReplaysAsAGraphOverOtherBoxesAndDepths) {
  PGL_NEEDS_DEVICE();
  Scene scene = large_scene(3001, 8);
  scene.occluders.resize(50, pgl::no_object);
  const OnDevice device(scene);
  const pgl::test::Captured graph([&](cudaStream_t stream) { return device.cull(scene, stream); });
  for (const std::uint32_t seed : {8u, 9u}) {
    Scene now = large_scene(3001, seed);
    now.occluders.resize(50, pgl::no_object);
    pgl::test::assign(device.boxes, now.boxes);
    pgl::test::assign(device.in_view, now.in_view);
    pgl::test::assign(device.occluders, now.occluders);
    pgl::test::assign(device.hzm, now.hzm);
    pgl::test::poison(device.visible);
    graph.replay();
    EXPECT_TRUE(same_bytes(device.visible.read(), host_visible(now)));
  }
}

}  // namespace
