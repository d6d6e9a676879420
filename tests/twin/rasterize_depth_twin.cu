// SPDX-License-Identifier: MIT
// rasterize_depth: the GPU's map against the CPU's, for triangles of every size and views of every kind.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "pgl/cuda/rasterize_depth.cuh"
#include "pgl/host/rasterize_depth.hpp"
#include "support/depth_scenes.hpp"
#include "support/meshes.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::Coverage;
using pgl::Depth;
using pgl::depth_map_of;
using pgl::DepthMap;
using pgl::far_depth;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using test::DepthScene;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

template <class Index>
std::vector<Depth> on_host(const DepthScene<Index>& s, const DepthMap& size, std::vector<Depth> depth) {
  pgl::host::DepthWorkspace workspace;
  pgl::host::rasterize_depth<Index>(s.meshes, s.objects, s.vertices, s.triangles, s.map, s.occluders, s.view, size,
                                    workspace, depth);
  return depth;
}

template <class Index>
struct OnDevice {
  OnDevice(const DepthScene<Index>& s, std::size_t shift)
      : meshes(s.meshes, shift),
        objects(s.objects, shift),
        vertices(s.vertices, shift),
        triangles(s.triangles, shift),
        map(s.map, shift),
        occluders(s.occluders, shift),
        view(s.view) {}
  cudaError_t draw(const DepthMap& size, std::span<Depth> depth, pgl::cuda::Launch launch) {
    return pgl::cuda::rasterize_depth<Index>(meshes.input(), objects.input(), vertices.input(), triangles.input(),
                                             map.input(), occluders.input(), view, size, workspace, depth, launch);
  }
  DeviceArray<pgl::Mesh> meshes;
  DeviceArray<pgl::Object> objects;
  DeviceArray<glm::vec3> vertices;
  DeviceArray<pgl::Triangle<Index>> triangles;
  DeviceArray<std::uint32_t> map, occluders;
  pgl::View view;
  pgl::cuda::DepthWorkspace workspace;
};

/// Draws into a map that holds something here and there.
template <class Index>
AssertionResult agree(const DepthScene<Index>& s, const DepthMap& size) {
  std::vector<Depth> before(std::size_t{size.width} * size.height, far_depth);
  for (std::size_t i = 0; i < before.size(); i += 7) before[i] = far_depth - static_cast<Depth>(i << 8);
  const auto expected = on_host(s, size, before);
  AssertionResult result = AssertionSuccess();
  pgl::test::with_host_threads([&] {
    if (const auto same = same_bytes(on_host(s, size, before), expected); !same)
      result = AssertionFailure() << "the host's threads: " << same.message();
  });
  if (!result) return result;
  for (const unsigned threads : block_sizes) {
    const std::size_t shift = threads == 256 ? 0 : threads == 96 ? 3 : 1;
    OnDevice<Index> device(s, shift);
    const DeviceArray<Depth> depth(before, shift);
    must(device.draw(size, depth.view(), {nullptr, threads}));
    if (const auto same = same_bytes(depth.read(), expected); !same)
      return AssertionFailure() << "blocks of " << threads << ": " << same.message();
  }
  return AssertionSuccess();
}

std::size_t written(const std::vector<Depth>& depth) {
  return depth.size() - static_cast<std::size_t>(std::ranges::count(depth, far_depth));
}

template <class Index>
void try_random_scenes(int most) {
  EXPECT_TRUE(rc::check([&] {
    auto scene = test::any_depth_scene<Index>();
    const DepthMap size = test::choose_size(scene.view, most);
    const AssertionResult result = agree(scene, size);
    if (!result) RC_FAIL(std::string(result.message()));
  }));
}

TEST(RasterizeDepthTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  try_random_scenes<std::uint32_t>(40);
  try_random_scenes<std::uint16_t>(600);
}

/// Balls of several sizes all over the view, some through the near plane and some behind the eye.
DepthScene<std::uint16_t> balls(int level, int count, std::uint32_t seed) {
  DepthScene<std::uint16_t> s;
  std::mt19937 random(seed);
  const std::uint32_t ball = s.add_mesh(test::sphere(level)), few = s.add_mesh(test::octahedron());
  for (int i = 0; i < count; ++i) {
    glm::mat4x3 place(1.0f);
    const float size = 0.02f + 0.5f * std::abs(test::signed_unit(random));
    for (int axis = 0; axis < 3; ++axis) place[axis] *= size;
    place[1].x = 0.1f * size;
    const float distance = 8 * test::signed_unit(random) + 6;
    place[3] = {distance * test::signed_unit(random), distance * test::signed_unit(random), -distance};
    s.add_occluder(i % 5 == 4 ? few : ball, place);
    if (i % 11 == 3) s.occluders.push_back(pgl::no_object);
    if (i % 13 == 3) s.occluders.push_back(static_cast<std::uint32_t>(i));  // once more
  }
  return s;
}

TEST(RasterizeDepthTwin, SameBytesForOrdinaryScenes) {
  PGL_NEEDS_DEVICE();
  auto s = balls(4, 40, 1);
  for (const auto range : {pgl::DepthRange::minus_one_to_one, pgl::DepthRange::zero_to_one})
    for (const auto order : {pgl::DepthOrder::conventional, pgl::DepthOrder::reversed}) {
      s.view = test::depth_camera(1024, 768, 0.1f, 50, range, order);
      for (const std::uint32_t scale : {1u, 3u, 8u})
        for (const auto coverage : {Coverage::centres, Coverage::whole}) {
          const DepthMap size = depth_map_of(s.view, scale, coverage);
          EXPECT_TRUE(agree(s, size)) << scale;
          if (scale == 1) {
            EXPECT_GT(written(on_host(s, size, std::vector<Depth>(std::size_t{1024} * 768, far_depth))), 100000u);
          }
        }
    }
}

TEST(RasterizeDepthTwin, SameBytesForManySmallOccluders) {
  PGL_NEEDS_DEVICE();
  auto s = balls(0, 3000, 2);
  s.view = test::depth_camera(640, 480, 0.1f, 50, pgl::DepthRange::zero_to_one, pgl::DepthOrder::reversed);
  EXPECT_TRUE(agree(s, depth_map_of(s.view)));
}

TEST(RasterizeDepthTwin, SameBytesAroundTheEdgesOfWarps) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(3);
  for (const std::uint32_t size : {1u, 31u, 32u, 33u, 63u, 64u, 65u, 255u, 257u, 1025u}) {
    DepthScene<std::uint32_t> s;
    s.view = test::depth_camera(100, 70, 0.1f, 50, pgl::DepthRange::minus_one_to_one, pgl::DepthOrder::conventional);
    std::vector<glm::vec3> points;
    std::vector<pgl::Triangle<std::uint32_t>> corners;
    for (std::uint32_t t = 0; t < size; ++t) {
      corners.push_back({{3 * t, 3 * t + 1, 3 * t + 2}});
      for (int k = 0; k < 3; ++k)
        points.push_back(
            {3 * test::signed_unit(random), 3 * test::signed_unit(random), -3 + test::signed_unit(random)});
    }
    s.add_mesh({}, {});
    const std::uint32_t mesh = s.add_mesh(points, corners);
    s.add_occluder(mesh);
    s.add_occluder(0);
    s.add_occluder(mesh, glm::mat4x3(0.5f, 0, 0, 0, -0.5f, 0, 0, 0, 0.5f, 0.1f, 0, 0));
    EXPECT_TRUE(agree(s, depth_map_of(s.view))) << size;
  }
}

/// Triangles as large as the picture, at random depths.
DepthScene<std::uint32_t> large_triangles(std::uint32_t count, float spread) {
  DepthScene<std::uint32_t> s;
  std::mt19937 random(4);
  std::vector<glm::vec3> points;
  std::vector<pgl::Triangle<std::uint32_t>> corners;
  for (std::uint32_t t = 0; t < count; ++t) {
    corners.push_back({{3 * t, 3 * t + 1, 3 * t + 2}});
    for (int k = 0; k < 3; ++k)
      points.push_back(
          {spread * test::signed_unit(random), spread * test::signed_unit(random), -5 + 4 * test::signed_unit(random)});
  }
  s.add_occluder(s.add_mesh(points, corners));
  return s;
}

TEST(RasterizeDepthTwin, SameBytesForTrianglesThatFillThePicture) {
  PGL_NEEDS_DEVICE();
  auto s = large_triangles(30, 20);
  for (const auto& [width, height] : {std::pair{2048.0f, 1500.0f}, {7.0f, 1333.0f}, {1.0f, 1.0f}, {33.0f, 17.0f}}) {
    s.view = test::depth_camera(width, height, 0.1f, 50, pgl::DepthRange::zero_to_one, pgl::DepthOrder::conventional);
    EXPECT_TRUE(agree(s, depth_map_of(s.view))) << width << " x " << height;
  }
  for (const auto& [width, height] : {std::pair{65536.0f, 1.0f}, {1.0f, 65536.0f}, {65536.0f, 40.0f}}) {
    s.view = test::depth_camera(width, height, 0.1f, 50, pgl::DepthRange::zero_to_one, pgl::DepthOrder::conventional);
    s.view.clip_from_world[0].x = s.view.clip_from_world[1].y = 1;
    const DepthMap size = depth_map_of(s.view);
    EXPECT_TRUE(agree(s, size)) << width << " x " << height;
    EXPECT_GT(written(on_host(s, size, std::vector<Depth>(std::size_t{size.width} * size.height, far_depth))), 10000u);
  }
}

TEST(RasterizeDepthTwin, SameBytesForMoreTrianglesThanMayWait) {
  PGL_NEEDS_DEVICE();
  auto s = large_triangles(4000, 8);
  s.view = test::depth_camera(300, 200, 0.1f, 50, pgl::DepthRange::zero_to_one, pgl::DepthOrder::conventional);
  const DepthMap size = depth_map_of(s.view);
  const std::vector<Depth> empty(std::size_t{size.width} * size.height, far_depth);
  const auto expected = on_host(s, size, empty);
  for (const std::uint32_t room : {1u, 2u, 31u, 100u, 1000u, 4000u, 1u << 17})
    for (const unsigned threads : block_sizes) {
      OnDevice<std::uint32_t> device(s, 0);
      device.workspace.room = room;
      const DeviceArray<Depth> depth(empty);
      must(device.draw(size, depth.view(), {nullptr, threads}));
      EXPECT_TRUE(same_bytes(depth.read(), expected)) << "room for " << room << ", blocks of " << threads;
    }
}

TEST(RasterizeDepthTwin, DrawsNothingForNothing) {
  PGL_NEEDS_DEVICE();
  DepthScene<std::uint32_t> s;
  s.view = test::depth_camera(80, 60, 0.1f, 50, pgl::DepthRange::zero_to_one, pgl::DepthOrder::conventional);
  EXPECT_TRUE(agree(s, depth_map_of(s.view)));
  s.occluders.assign(50, pgl::no_object);
  EXPECT_TRUE(agree(s, depth_map_of(s.view)));
  s.add_mesh({}, {});
  s.add_occluder(0);
  EXPECT_TRUE(agree(s, depth_map_of(s.view)));
}

TEST(RasterizeDepthTwin, ReplaysAsAGraphForOccludersChosenOnTheDevice) {
  PGL_NEEDS_DEVICE();
  auto s = balls(3, 30, 5);
  s.view = test::depth_camera(640, 480, 0.1f, 50, pgl::DepthRange::zero_to_one, pgl::DepthOrder::reversed);
  const DepthMap size = depth_map_of(s.view);
  const std::vector<Depth> empty(std::size_t{size.width} * size.height, far_depth);
  OnDevice<std::uint16_t> device(s, 1);
  const DeviceArray<Depth> depth(empty);
  const auto enqueue = [&](cudaStream_t stream) {
    must(cudaMemsetAsync(depth.data(), 0xff, depth.view().size_bytes(), stream));
    return device.draw(size, depth.view(), stream);
  };
  must(enqueue(nullptr));  // fills the workspace
  const pgl::test::Captured graph(enqueue);
  for (int round = 0; round < 3; ++round) {
    std::ranges::rotate(s.occluders, s.occluders.begin() + 3);
    s.occluders[0] = pgl::no_object;
    pgl::test::assign(device.occluders, s.occluders);
    pgl::test::poison(depth);
    graph.replay();
    EXPECT_TRUE(same_bytes(depth.read(), on_host(s, size, empty)));
  }
}

}  // namespace
