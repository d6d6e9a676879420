// SPDX-License-Identifier: MIT
// rearrange: the GPU's bytes against the CPU's, for one mesh and for batches of meshes of all sizes.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "pgl/cuda/rearrange.cuh"
#include "pgl/host/parallel.hpp"
#include "pgl/host/rearrange.hpp"
#include "support/random_scene.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::MeshRange;
using pgl::Triangle;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

using Vertex = glm::vec3;

template <class Index>
class RearrangeTwin : public testing::Test {};
using Indices = testing::Types<std::uint16_t, std::uint32_t>;
TYPED_TEST_SUITE(RearrangeTwin, Indices);

/// Meshes one after the other, with gaps; what is in a gap must stay as it is.
template <class Index>
struct Batch {
  std::vector<MeshRange> meshes;
  std::vector<Vertex> vertices;
  std::vector<Triangle<Index>> triangles;
  std::vector<Index> ecol, permute_v;
  std::vector<std::uint32_t> permute_t;

  void add_gap(std::size_t size) {
    vertices.resize(vertices.size() + size);
    ecol.resize(vertices.size());
    permute_v.resize(vertices.size());
    triangles.resize(triangles.size() + 2 * size);
    permute_t.resize(triangles.size());
  }
  void add(const test::CollapsingMesh<Index>& mesh) {
    meshes.push_back({.first_vertex = vertices.size(),
                      .first_triangle = triangles.size(),
                      .vertices = mesh.vertices(),
                      .triangles = static_cast<std::uint32_t>(mesh.triangles.size())});
    for (std::uint32_t v = 0; v < mesh.vertices(); ++v) {
      vertices.emplace_back(static_cast<float>(vertices.size()), static_cast<float>(v), -0.0f);
    }
    triangles.insert(triangles.end(), mesh.triangles.begin(), mesh.triangles.end());
    ecol.insert(ecol.end(), mesh.ecol.begin(), mesh.ecol.end());
    permute_v.insert(permute_v.end(), mesh.permute_v.begin(), mesh.permute_v.end());
    permute_t.insert(permute_t.end(), mesh.permute_t.begin(), mesh.permute_t.end());
  }
  /// A mesh whose parts have nothing to do with each other, however large.
  void add(std::mt19937& random, std::uint32_t size, std::uint32_t corners) {
    test::CollapsingMesh<Index> mesh;
    mesh.permute_v.resize(size);
    mesh.permute_t.resize(corners);
    mesh.triangles.resize(corners);
    std::iota(mesh.permute_v.begin(), mesh.permute_v.end(), Index{0});
    std::iota(mesh.permute_t.begin(), mesh.permute_t.end(), 0u);
    std::ranges::shuffle(mesh.permute_v, random);
    std::ranges::shuffle(mesh.permute_t, random);
    for (std::uint32_t v = 0; v < size; ++v) {
      mesh.ecol.push_back(random() % 8 == 0 ? pgl::no_target<Index> : static_cast<Index>(random() % size));
    }
    for (auto& triangle : mesh.triangles)
      for (Index& v : triangle.v) v = static_cast<Index>(random() % size);
    add(mesh);
  }
};

template <class Index>
struct Rearranged {
  std::vector<Vertex> vertices;
  std::vector<Triangle<Index>> triangles;
  std::vector<Index> ecol;

  explicit Rearranged(const Batch<Index>& b)
      : vertices(b.vertices.size()), triangles(b.triangles.size()), ecol(b.ecol.size()) {
    std::memset(static_cast<void*>(vertices.data()), 0xA5, vertices.size() * sizeof(Vertex));
    std::memset(static_cast<void*>(triangles.data()), 0xA5, triangles.size() * sizeof(triangles[0]));
    std::memset(static_cast<void*>(ecol.data()), 0xA5, ecol.size() * sizeof(Index));
  }
  AssertionResult is(const Rearranged& other) const {
    if (auto same = same_bytes(vertices, other.vertices); !same) return same << " (vertices)";
    if (auto same = same_bytes(triangles, other.triangles); !same) return same << " (triangles)";
    return same_bytes(ecol, other.ecol) << " (ecol)";
  }
};

/// One mesh: the whole of the arrays.
template <class Index>
Rearranged<Index> on_host(const Batch<Index>& b, bool batch) {
  Rearranged<Index> out(b);
  if (batch) {
    pgl::host::rearrange<Vertex, Index>(b.meshes, b.vertices, b.triangles, b.ecol, b.permute_v, b.permute_t,
                                        out.vertices, out.triangles, out.ecol);
  } else {
    pgl::host::rearrange<Vertex, Index>(b.vertices, b.triangles, b.ecol, b.permute_v, b.permute_t, out.vertices,
                                        out.triangles, out.ecol);
  }
  return out;
}

template <class Index>
struct OnDevice {
  DeviceArray<MeshRange> meshes;
  DeviceArray<Vertex> vertices;
  DeviceArray<Triangle<Index>> triangles;
  DeviceArray<Index> ecol, permute_v;
  DeviceArray<std::uint32_t> permute_t;
  DeviceArray<Vertex> out_vertices;
  DeviceArray<Triangle<Index>> out_triangles;
  DeviceArray<Index> out_ecol;

  explicit OnDevice(const Batch<Index>& b)
      : meshes(b.meshes),
        vertices(b.vertices),
        triangles(b.triangles),
        ecol(b.ecol),
        permute_v(b.permute_v),
        permute_t(b.permute_t),
        out_vertices(b.vertices.size()),
        out_triangles(b.triangles.size()),
        out_ecol(b.ecol.size()) {}

  cudaError_t rearrange(bool batch, pgl::cuda::Launch launch) const {
    if (batch) {
      return pgl::cuda::rearrange<Vertex, Index>(meshes.input(), vertices.input(), triangles.input(), ecol.input(),
                                                 permute_v.input(), permute_t.input(), out_vertices.view(),
                                                 out_triangles.view(), out_ecol.view(), launch);
    }
    return pgl::cuda::rearrange<Vertex, Index>(vertices.input(), triangles.input(), ecol.input(), permute_v.input(),
                                               permute_t.input(), out_vertices.view(), out_triangles.view(),
                                               out_ecol.view(), launch);
  }
  Rearranged<Index> read(const Batch<Index>& b) const {
    Rearranged<Index> out(b);
    out.vertices = out_vertices.read();
    out.triangles = out_triangles.read();
    out.ecol = out_ecol.read();
    return out;
  }
};

template <class Index>
AssertionResult agree(const Batch<Index>& b, bool batch) {
  const auto expected = on_host(b, batch);
#if defined(_OPENMP)
  const int all = omp_get_max_threads();
  omp_set_num_threads(1);
  const auto alone = on_host(b, batch);
  omp_set_num_threads(all);
  if (const auto same = alone.is(expected); !same) return AssertionFailure() << "one thread: " << same.message();
#endif
  for (const unsigned threads : block_sizes) {
    const OnDevice<Index> device(b);
    must(device.rearrange(batch, {nullptr, threads}));
    if (const auto same = device.read(b).is(expected); !same) {
      return AssertionFailure() << "blocks of " << threads << ": " << same.message();
    }
  }
  return AssertionSuccess();
}

TYPED_TEST(RearrangeTwin, SameBytesForRandomMeshesWithCollapses) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    const auto choose = [](std::uint32_t least, std::uint32_t most) {
      return static_cast<std::uint32_t>(*rc::gen::inRange<std::uint64_t>(least, std::uint64_t{most} + 1));
    };
    Batch<TypeParam> one, many;
    one.add(test::any_collapsing_mesh<TypeParam>(choose));
    for (std::uint32_t m = choose(0u, 5u); m > 0; --m) {
      many.add_gap(choose(0u, 2u));
      many.add(test::any_collapsing_mesh<TypeParam>(choose));
    }
    many.add_gap(choose(0u, 2u));
    AssertionResult result = agree(one, false);
    if (result) result = agree(many, true);
    if (!result) RC_FAIL(std::string(result.message()));
  }));
}

TYPED_TEST(RearrangeTwin, SameBytesAroundTheEdgesOfWarpsAndBlocks) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(1);
  Batch<TypeParam> all;
  for (const std::uint32_t size : {1u, 31u, 32u, 33u, 255u, 256u, 257u, 1023u, 1024u, 1025u, 16384u, 16385u}) {
    for (const std::uint32_t triangles : {0u, size - 1, size + 1, 2 * size}) {
      Batch<TypeParam> one;
      one.add(random, size, triangles);
      EXPECT_TRUE(agree(one, false)) << size;
      EXPECT_TRUE(agree(one, true)) << size;
      all.add(random, size, triangles);
    }
  }
  EXPECT_TRUE(agree(all, true));
}

// A block moves a mesh in one go if all of its output has room in shared memory, and in windows otherwise; many blocks
// together move one of more than 2^14 vertices or 2^15 triangles. Sizes on both sides of each change.
TYPED_TEST(RearrangeTwin, SameBytesWhereTheOutputOfAMeshBarelyFitsSharedMemory) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(4);
  Batch<TypeParam> b;
  const auto around = [](std::uint32_t size, auto&& add) {
    for (std::uint32_t i = size - 6; i <= size + 6; ++i) add(i);
  };
  for (const std::uint32_t size : {557u, 766u, 875u, 1114u, 1226u, 1534u, 1754u, 2047u, 2457u, 3071u, 4093u, 6141u}) {
    around(size, [&](std::uint32_t vertices) {
      b.add(random, vertices, 0);
      b.add_gap(random() % 2);
      b.add(random, vertices, vertices);
      b.add(random, vertices, 2 * vertices);
    });
  }
  for (const std::uint32_t size : {1878u, 2014u, 3819u, 4027u, 4059u, 8117u}) {
    around(size, [&](std::uint32_t triangles) { b.add(random, 100, triangles); });
  }
  for (const std::uint32_t vertices : {1u, 16383u, 16384u, 16385u}) {
    for (const std::uint32_t triangles : {32767u, 32768u, 32769u}) b.add(random, vertices, triangles);
  }
  EXPECT_TRUE(agree(b, true));
}

struct Odd {
  std::uint8_t bytes[7];
};
struct Long {
  std::uint16_t values[37];
};
struct alignas(16) Four {
  float values[4];
};
struct alignas(32) Eight {
  float values[8];
};

/// A batch with vertices of another kind, of random bytes.
template <class Other, class Index>
AssertionResult agree_with_vertices(const Batch<Index>& b) {
  std::mt19937 random(5);
  std::vector<Other> vertices(b.vertices.size()), expected(b.vertices.size());
  std::vector<std::uint8_t> bytes(vertices.size() * sizeof(Other));
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  std::memcpy(static_cast<void*>(vertices.data()), bytes.data(), bytes.size());
  std::memset(static_cast<void*>(expected.data()), 0xA5, bytes.size());
  Rearranged<Index> rest(b);
  pgl::host::rearrange<Other, Index>(b.meshes, vertices, b.triangles, b.ecol, b.permute_v, b.permute_t, expected,
                                     rest.triangles, rest.ecol);
  const DeviceArray<Other> in(vertices);
  for (const unsigned threads : block_sizes) {
    const OnDevice<Index> device(b);
    const DeviceArray<Other> out(vertices.size());
    must(pgl::cuda::rearrange<Other, Index>(
        device.meshes.input(), in.input(), device.triangles.input(), device.ecol.input(), device.permute_v.input(),
        device.permute_t.input(), out.view(), device.out_triangles.view(), device.out_ecol.view(), {nullptr, threads}));
    if (auto same = same_bytes(out.read(), expected); !same) return same << " (vertices)";
    if (auto same = same_bytes(device.out_triangles.read(), rest.triangles); !same) return same << " (triangles)";
    if (auto same = same_bytes(device.out_ecol.read(), rest.ecol); !same) return same << " (ecol)";
  }
  return AssertionSuccess();
}

TYPED_TEST(RearrangeTwin, SameBytesForVerticesOfAnySizeAndAlignment) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(6);
  Batch<TypeParam> b;
  for (const std::uint32_t size : {1u, 2u, 5u, 100u, 1000u, 3000u, 7000u, 16384u, 16385u}) {
    b.add_gap(random() % 3);
    b.add(random, size, size + size / 2);
  }
  EXPECT_TRUE(agree_with_vertices<std::uint8_t>(b));
  EXPECT_TRUE(agree_with_vertices<Odd>(b));
  EXPECT_TRUE(agree_with_vertices<double>(b));
  EXPECT_TRUE(agree_with_vertices<Four>(b));
  EXPECT_TRUE(agree_with_vertices<Long>(b));
  EXPECT_TRUE(agree_with_vertices<Eight>(b));
}

// Some thousand small meshes, in no order, with large ones among them.
TYPED_TEST(RearrangeTwin, SameBytesForABatchOfMeshesOfAllSizes) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(2);
  Batch<TypeParam> b;
  for (int m = 0; m < 3000; ++m) {
    b.add_gap(random() % 2);
    b.add(random, 1 + random() % 60, random() % 90);
    if (m % 1000 == 500) b.add(random, 60000, 110000);
    if (m % 700 == 0) b.meshes.push_back({});
  }
  std::ranges::shuffle(b.meshes, random);
  EXPECT_TRUE(agree(b, true));
}

TYPED_TEST(RearrangeTwin, WritesNothingForNothing) {
  PGL_NEEDS_DEVICE();
  Batch<TypeParam> b;
  EXPECT_TRUE(agree(b, false));
  EXPECT_TRUE(agree(b, true));
  b.add_gap(20000);
  EXPECT_TRUE(agree(b, true));
  b.meshes.resize(100);
  EXPECT_TRUE(agree(b, true));
}

TYPED_TEST(RearrangeTwin, ReplaysAsAGraph) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(3);
  Batch<TypeParam> b;
  for (int m = 0; m < 100; ++m) b.add(random, 300, 500);
  b.add(random, 20000, 20000);
  const OnDevice<TypeParam> device(b);
  const auto expected = on_host(b, true);
  must(device.rearrange(true, {}));  // loads the kernels
  const pgl::test::Captured graph([&](cudaStream_t stream) { return device.rearrange(true, stream); });
  for (int round = 0; round < 2; ++round) {
    pgl::test::poison(device.out_vertices);
    pgl::test::poison(device.out_triangles);
    pgl::test::poison(device.out_ecol);
    graph.replay();
    EXPECT_TRUE(device.read(b).is(expected));
  }
}

}  // namespace
