// SPDX-License-Identifier: MIT
// Oriented boxes and compactness: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "pgl/cuda/oriented_box.cuh"
#include "pgl/host/oriented_box.hpp"
#include "support/box_shapes.hpp"
#include "support/random_mesh.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::OrientedBox;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;
using test::Corners;
using test::MeshArrays;
using test::TriangleMesh;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

struct Boxes {
  std::vector<OrientedBox> boxes;
  std::vector<float> compactness;
  AssertionResult is(const Boxes& other) const {
    if (AssertionResult same = same_bytes(boxes, other.boxes); !same) return same << " (boxes)";
    if (AssertionResult same = same_bytes(compactness, other.compactness); !same) return same << " (compactness)";
    return AssertionSuccess();
  }
};

template <class Index>
std::vector<pgl::Triangle<Index>> as_indices(const std::vector<Corners>& triangles) {
  std::vector<pgl::Triangle<Index>> out;
  for (const Corners& t : triangles)
    out.push_back({{static_cast<Index>(t.v[0]), static_cast<Index>(t.v[1]), static_cast<Index>(t.v[2])}});
  return out;
}

template <class Index>
Boxes on_host(const MeshArrays& in) {
  Boxes out{std::vector<OrientedBox>(in.size()), std::vector<float>(in.size())};
  const auto triangles = as_indices<Index>(in.triangles);
  pgl::host::oriented_boxes<Index>(in.meshes, in.vertices, triangles, in.map, out.boxes, out.compactness);
  return out;
}

/// The arrays of meshes on the device.
template <class Index>
struct OnDevice {
  explicit OnDevice(const MeshArrays& in)
      : meshes(in.meshes),
        vertices(in.vertices),
        triangles(as_indices<Index>(in.triangles)),
        map(in.map),
        boxes(in.size()),
        compactness(in.size()) {}
  cudaError_t find(pgl::cuda::Launch launch) const {
    return pgl::cuda::oriented_boxes<Index>(meshes.input(), vertices.input(), triangles.input(), map.input(),
                                            boxes.view(), compactness.view(), launch);
  }
  Boxes read() const { return {boxes.read(), compactness.read()}; }
  DeviceArray<pgl::Mesh> meshes;
  DeviceArray<glm::vec3> vertices;
  DeviceArray<pgl::Triangle<Index>> triangles;
  DeviceArray<std::uint32_t> map;
  DeviceArray<OrientedBox> boxes;
  DeviceArray<float> compactness;
};

/// Demands one result of the CPU, with one thread and with all, and of the GPU at every block size.
template <class Index>
AssertionResult agree(const MeshArrays& in) {
  AssertionResult result = AssertionSuccess();
  const Boxes expected = on_host<Index>(in);
  with_host_threads([&] {
    if (const AssertionResult same = on_host<Index>(in).is(expected); !same)
      result = AssertionFailure() << "the host alone: " << same.message();
  });
  for (const unsigned threads : block_sizes) {
    const OnDevice<Index> device(in);
    must(device.find({nullptr, threads}));
    if (const AssertionResult same = device.read().is(expected); !same)
      return AssertionFailure() << in.size() << " meshes, blocks of " << threads << ": " << same.message();
  }
  return result;
}

TEST(OrientedBoxTwin, SameBytesForRandomMeshes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    MeshArrays in;
    for (int i = numbers::whole(0, 8); i > 0; --i) in.add(test::any_mesh());
    const AssertionResult result = agree<std::uint32_t>(in);
    if (!result) RC_FAIL(result.message());
  }));
}

TEST(OrientedBoxTwin, SameBytesForShapesTurnedAndMovedWith16And32BitIndices) {
  PGL_NEEDS_DEVICE();
  std::mt19937 rng(1);
  MeshArrays in;
  for (const test::NamedMesh& shape : test::box_shapes()) {
    in.add(shape.mesh);
    for (const double far : {0.0, 1.0, 1e4}) {
      const glm::dvec3 shift(far * 3, -far, far * 7);
      in.add(test::rotated(shape.mesh, test::random_axes(rng), shift));
    }
    in.add({});
  }
  EXPECT_TRUE(agree<std::uint32_t>(in));
  EXPECT_TRUE(agree<std::uint16_t>(in));
}

TEST(OrientedBoxTwin, SameBytesAtEverySizeOfAMesh) {
  PGL_NEEDS_DEVICE();
  std::mt19937 rng(2);
  MeshArrays in;
  for (const std::uint32_t n :
       {1u, 2u, 3u, 31u, 32u, 33u, 95u, 96u, 97u, 255u, 256u, 257u, 1023u, 1024u, 1025u, 30000u})
    in.add(test::cloud(rng, n, {1, 0.5f, 0.25f}));
  in.add({std::vector<glm::vec3>(300, {1, 2, 3}), {{{0, 100, 200}}}});  // all equal
  in.add({std::vector<glm::vec3>(70, glm::vec3(std::numeric_limits<float>::quiet_NaN())), {{{0, 1, 2}}}});
  EXPECT_TRUE(agree<std::uint32_t>(in));
}

TEST(OrientedBoxTwin, SameBytesWhereManyVerticesReachEquallyFar) {
  PGL_NEEDS_DEVICE();
  std::mt19937 rng(3);
  MeshArrays in;
  in.add(test::grid(40, 40));
  in.add(test::on_lattice(test::sphere(4), 3));
  for (int i = 0; i < 20; ++i) in.add(test::soup(rng, 400, 500));
  TriangleMesh zeros = test::box_mesh(1, 1, 1, 3);  // zeros of both signs
  for (std::uint32_t i = 0; i < zeros.vertex_count(); ++i) {
    zeros.positions[i].z = i % 2 == 0 ? 0.0f : -0.0f;
    if (i % 3 == 0) zeros.positions[i].y = -0.0f;
  }
  in.add(zeros);
  in.add({std::vector<glm::vec3>(5, glm::vec3(-0.0f, 0.0f, -0.0f)), {}});
  EXPECT_TRUE(agree<std::uint32_t>(in));
}

TEST(OrientedBoxTwin, SameBytesAtTheEndsOfTheFloatRange) {
  PGL_NEEDS_DEVICE();
  std::mt19937 rng(4);
  const float most = std::numeric_limits<float>::max();
  MeshArrays in;
  for (const float scale : {1e-45f, 1e-38f, 1e-30f, 1e-6f, 1e9f, 1e30f, most})
    for (int i = 0; i < 4; ++i) {
      TriangleMesh mesh = test::cloud(rng, 100, {1, 0.5f, 0.25f});
      for (glm::vec3& p : mesh.positions) p *= scale;
      in.add(mesh);
    }
  in.add({{{-most, -most, -most}, {most, most, most}}, {{{0, 1, 0}}}});
  in.add({{{-most, most, 0}, {most, -most, 1e-30f}, {most, most, most}, {0, 0, 0}}, {{{0, 1, 2}}}});
  EXPECT_TRUE(agree<std::uint32_t>(in));
}

TEST(OrientedBoxTwin, SameBytesForMoreMeshesThanRunAtATime) {
  PGL_NEEDS_DEVICE();
  std::mt19937 rng(5);
  MeshArrays in;
  for (int i = 0; i < 20000; ++i) in.add(test::cloud(rng, 4 + test::below(rng, 12), {1, 1, 0.3f}));
  EXPECT_TRUE(agree<std::uint32_t>(in));
}

TEST(OrientedBoxTwin, ReplaysAsAGraphOverOtherVertices) {
  PGL_NEEDS_DEVICE();
  std::mt19937 rng(6);
  MeshArrays in;
  for (const test::NamedMesh& shape : test::box_shapes()) in.add(shape.mesh);
  const OnDevice<std::uint32_t> device(in);
  const pgl::test::Captured graph([&](cudaStream_t stream) { return device.find(stream); });
  for (int repeat = 0; repeat < 2; ++repeat) {
    MeshArrays now;
    for (const test::NamedMesh& shape : test::box_shapes()) now.add(test::rotated(shape.mesh, test::random_axes(rng)));
    pgl::test::assign(device.vertices, now.vertices);
    pgl::test::poison(device.boxes);
    pgl::test::poison(device.compactness);
    graph.replay();
    EXPECT_TRUE(device.read().is(on_host<std::uint32_t>(now)));
  }
}

}  // namespace
