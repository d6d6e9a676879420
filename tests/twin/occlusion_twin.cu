// SPDX-License-Identifier: MIT
// Occlusion culling as a whole, one step after the other on a stream: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "pgl/cuda/build_hzm.cuh"
#include "pgl/cuda/cull_frustum.cuh"
#include "pgl/cuda/cull_occluded.cuh"
#include "pgl/cuda/rasterize_depth.cuh"
#include "pgl/cuda/select_occluders.cuh"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/select_occluders.hpp"
#include "support/occlusion_scenes.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using numbers::whole;
using pgl::Depth;
using pgl::DepthMap;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

/// What every step of a frame leaves.
struct Frame {
  std::vector<std::uint8_t> in_view;
  std::vector<std::uint32_t> occluders;
  std::vector<Depth> hzm;
  std::vector<std::uint8_t> visible;

  AssertionResult is(const Frame& other) const {
    if (AssertionResult same = same_bytes(in_view, other.in_view); !same) return same << " (in view)";
    if (AssertionResult same = same_bytes(occluders, other.occluders); !same) return same << " (occluders)";
    if (AssertionResult same = same_bytes(hzm, other.hzm); !same) return same << " (map)";
    if (AssertionResult same = same_bytes(visible, other.visible); !same) return same << " (visible)";
    return AssertionSuccess();
  }
};

struct Input {
  test::OcclusionScene scene;
  test::OcclusionModel model;
  DepthMap size;
  std::size_t occluders = 0;
  float threshold = 0;
};

Frame host_frame(const Input& in) {
  const test::OcclusionScene& s = in.scene;
  Frame f{std::vector<std::uint8_t>(s.objects.size()), std::vector<std::uint32_t>(in.occluders),
          std::vector<Depth>(pgl::hzm_texels(in.size), pgl::far_depth), std::vector<std::uint8_t>(s.objects.size())};
  pgl::host::OccluderWorkspace choice;
  pgl::host::DepthWorkspace depth;
  pgl::host::cull_frustum(in.model.boxes, s.view, f.in_view);
  pgl::host::select_occluders(in.model.candidates, in.model.faces, f.in_view, s.view, choice, f.occluders);
  pgl::host::rasterize_depth<std::uint32_t>(s.meshes, s.objects, s.vertices, s.triangles, s.map, f.occluders, s.view,
                                            in.size, depth,
                                            std::span(f.hzm).first(std::size_t{in.size.width} * in.size.height));
  pgl::host::build_hzm(in.size, f.hzm);
  pgl::host::cull_occluded(in.model.boxes, f.in_view, f.occluders, s.view, in.size, f.hzm, 1, f.visible);
  return f;
}

struct Workspaces {
  pgl::cuda::OccluderWorkspace choice;
  pgl::cuda::DepthWorkspace depth;
};

/// The arrays of a frame on the device.
struct OnDevice {
  explicit OnDevice(const Input& in)
      : meshes(in.scene.meshes),
        objects(in.scene.objects),
        vertices(in.scene.vertices),
        triangles(in.scene.triangles),
        map(in.scene.map),
        boxes(in.model.boxes),
        faces(in.model.faces),
        candidates(in.model.candidates),
        in_view(in.scene.objects.size()),
        visible(in.scene.objects.size()),
        occluders(in.occluders),
        hzm(pgl::hzm_texels(in.size)) {}

  cudaError_t enqueue(const Input& in, Workspaces& workspaces, pgl::cuda::Launch launch) const {
    const pgl::View& view = in.scene.view;
    const std::span<Depth> depth = hzm.view().first(std::size_t{in.size.width} * in.size.height);
    PGL_CUDA_TRY(pgl::cuda::cull_frustum(boxes.input(), view, in_view.view(), launch));
    PGL_CUDA_TRY(pgl::cuda::select_occluders(candidates.input(), faces.input(), in_view.input(), view,
                                             workspaces.choice, occluders.view(), launch));
    PGL_CUDA_TRY(cudaMemsetAsync(depth.data(), 0xff, depth.size_bytes(), launch.stream));
    PGL_CUDA_TRY(pgl::cuda::rasterize_depth<std::uint32_t>(meshes.input(), objects.input(), vertices.input(),
                                                           triangles.input(), map.input(), occluders.input(), view,
                                                           in.size, workspaces.depth, depth, launch));
    PGL_CUDA_TRY(pgl::cuda::build_hzm(in.size, hzm.view(), launch));
    return pgl::cuda::cull_occluded(boxes.input(), in_view.input(), occluders.input(), view, in.size, hzm.input(), 1,
                                    visible.view(), launch);
  }
  Frame read() const { return {in_view.read(), occluders.read(), hzm.read(), visible.read()}; }

  DeviceArray<pgl::Mesh> meshes;
  DeviceArray<pgl::Object> objects;
  DeviceArray<glm::vec3> vertices;
  DeviceArray<pgl::Triangle<std::uint32_t>> triangles;
  DeviceArray<std::uint32_t> map;
  DeviceArray<pgl::Box> boxes;
  DeviceArray<pgl::OccluderFace> faces;
  DeviceArray<std::uint32_t> candidates;
  DeviceArray<std::uint8_t> in_view, visible;
  DeviceArray<std::uint32_t> occluders;
  DeviceArray<Depth> hzm;
};

Input any_input(int most_pixels) {
  Input in;
  const test::Palette palette = test::add_palette(in.scene);
  const test::Camera camera = test::any_camera();
  in.scene.view = camera.view;
  test::place_yard(in.scene, camera, palette, whole(0, 30));
  const int others = whole(0, 30);
  for (int i = 0; i < others; ++i) test::place_anything(in.scene, camera, palette);
  in.size = test::any_size(in.scene.view, most_pixels);
  in.threshold = whole(0, 3) == 0 ? 0.5f : 0.0f;
  in.model = test::prepared(in.scene, in.threshold);
  in.occluders = static_cast<std::size_t>(whole(0, 8));
  return in;
}

TEST(OcclusionTwin, SameBytesAfterEveryStep) {
  PGL_NEEDS_DEVICE();
  static Workspaces& workspaces = *new Workspaces;  // outlives the CUDA context
  int in_view = 0, culled = 0;
  EXPECT_TRUE(rc::check([&] {
    const Input in = any_input(300);
    const Frame expected = host_frame(in);
    for (const unsigned threads : block_sizes) {
      const OnDevice device(in);
      must(device.enqueue(in, workspaces, {nullptr, threads}));
      if (const AssertionResult same = device.read().is(expected); !same)
        RC_FAIL("blocks of " + std::to_string(threads) + ": " + same.message());
    }
    for (std::size_t i = 0; i < expected.in_view.size(); ++i) {
      in_view += expected.in_view[i];
      culled += expected.in_view[i] - expected.visible[i];
    }
  }));
  EXPECT_GT(culled, in_view / 20);  // the scenes have something to cull
}

/// Enqueued on a stream, warm, without a word from the host between the steps: the whole chain as one graph, replayed
/// over other places of the same objects.
TEST(OcclusionTwin, ReplaysAsOneGraph) {
  PGL_NEEDS_DEVICE();
  int replayed = 0;
  EXPECT_TRUE(rc::check([&] {
    if (replayed == 10) return;
    Input in = any_input(200);
    if (in.scene.objects.empty() || in.occluders == 0) return;
    ++replayed;
    Workspaces workspaces;
    const OnDevice device(in);
    must(device.enqueue(in, workspaces, {}));
    const pgl::test::Captured graph([&](cudaStream_t stream) { return device.enqueue(in, workspaces, stream); });
    for (int frame = 0; frame < 2; ++frame) {
      pgl::test::poison(device.in_view);
      pgl::test::poison(device.visible);
      pgl::test::poison(device.occluders);
      pgl::test::poison(device.hzm);
      graph.replay();
      if (const AssertionResult same = device.read().is(host_frame(in)); !same) RC_FAIL(same.message());
      // Elsewhere, and mirrored; a mesh is as compact as before, so there are as many candidates.
      for (pgl::Object& object : in.scene.objects) object.transform[0] = -object.transform[0] * 0.5f;
      const std::size_t candidates = in.model.candidates.size();
      in.model = test::prepared(in.scene, in.threshold);
      RC_ASSERT(in.model.candidates.size() == candidates);
      pgl::test::assign(device.objects, in.scene.objects);
      pgl::test::assign(device.boxes, in.model.boxes);
      pgl::test::assign(device.faces, in.model.faces);
      pgl::test::assign(device.candidates, in.model.candidates);
    }
  }));
  EXPECT_GE(replayed, 5);
}

}  // namespace
