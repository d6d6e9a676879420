// SPDX-License-Identifier: MIT
// gather: the GPU's bytes against the CPU's, for objects of any size, any transform and vertices of the user's own.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "pgl/cuda/gather.cuh"
#include "pgl/host/gather.hpp"
#include "pgl/host/parallel.hpp"
#include "support/block.hpp"
#include "support/numbers.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace mine {

// A payload of a library user, which writes only a part of what it is given.
struct Vertex {
  glm::vec3 position;
  std::uint16_t material;
};
struct Drawn {
  std::uint16_t material;
  std::uint16_t own;
  glm::vec3 position;
  std::uint32_t object;
};
PGL_HD inline void place(const pgl::Object& object, std::uint32_t index, const Vertex& vertex, Drawn& drawn) {
  drawn.material = vertex.material;
  drawn.position = pgl::transform_point(object.transform, vertex.position);
  drawn.object = index;
}

}  // namespace mine

namespace {

using glm::vec3;
using pgl::Mesh;
using pgl::Object;
using pgl::PlacedVertex;
using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

struct Scene {
  std::vector<Mesh> meshes;
  std::vector<Object> objects;
  std::vector<vec3> vertices;
  std::vector<std::uint32_t> counts;
  std::vector<std::uint64_t> offsets{0};

  template <class Number>
  void add_mesh(std::uint32_t size, Number&& number) {
    meshes.push_back({.first_vertex = vertices.size(), .max_vertices = size});
    for (std::uint32_t v = 0; v < size; ++v) {
      vec3 p;
      for (int axis = 0; axis < 3; ++axis) p[axis] = number();
      vertices.push_back(p);
    }
  }
  template <class Number>
  void add_object(std::uint32_t mesh, std::uint32_t count, bool identity, Number&& number) {
    Object object{.mesh = mesh};
    for (int column = 0; column < 4 && !identity; ++column)
      for (int row = 0; row < 3; ++row) object.transform[column][row] = number();
    objects.push_back(object);
    counts.push_back(count);
    offsets.push_back(offsets.back() + count);
  }
};

constexpr std::size_t beyond = 70;

template <class T>
T untouched() {
  T value;
  std::memset(static_cast<void*>(&value), 0xA5, sizeof(T));
  return value;
}

/// Which NaN comes out is not part of the promise.
void one_nan(vec3& p) {
  for (int axis = 0; axis < 3; ++axis)
    if (p[axis] != p[axis]) p[axis] = std::numeric_limits<float>::quiet_NaN();
}
void one_nan(PlacedVertex& p) {
  one_nan(p.position);
}
void one_nan(mine::Drawn& p) {
  one_nan(p.position);
}
template <class Placed>
std::vector<Placed> with_one_nan(std::vector<Placed> all) {
  for (Placed& p : all) one_nan(p);
  return all;
}

template <class Vertex>
std::vector<Vertex> vertices_of(const Scene& s) {
  if constexpr (std::is_same_v<Vertex, vec3>) {
    return s.vertices;
  } else {
    std::vector<Vertex> vertices;
    for (const vec3& p : s.vertices) {
      Vertex vertex = untouched<Vertex>();
      vertex.position = p;
      vertex.material = static_cast<std::uint16_t>(vertices.size());
      vertices.push_back(vertex);
    }
    return vertices;
  }
}

template <class Placed, class Vertex>
AssertionResult agree(const Scene& s) {
  const auto vertices = vertices_of<Vertex>(s);
  const auto on_host = [&] {
    std::vector<Placed> out(s.offsets.back() + beyond, untouched<Placed>());
    pgl::host::gather<Placed, Vertex>(s.meshes, s.objects, vertices, s.counts, s.offsets, out);
    return out;
  };
  const auto block = test::block_of(s.meshes, s.objects, &Mesh::first_vertex, vertices, s.offsets, untouched<Vertex>());
  const auto block_on_host = [&] {
    std::vector<Placed> out(s.offsets.back() + beyond, untouched<Placed>());
    pgl::host::gather_block<Placed, Vertex>(s.objects, block, s.offsets, out);
    return out;
  };
  const auto expected = on_host();
  if (const auto same = same_bytes(with_one_nan(block_on_host()), with_one_nan(expected)); !same)
    return AssertionFailure() << "a block: " << same.message();
#if defined(_OPENMP)
  const int all = omp_get_max_threads();
  omp_set_num_threads(1);
  const auto alone = on_host();
  omp_set_num_threads(all);
  if (const auto same = same_bytes(alone, expected); !same)
    return AssertionFailure() << "one thread: " << same.message();
#endif
  for (const unsigned threads : block_sizes) {
    for (const std::size_t shift : {0, 1, 3}) {
      const DeviceArray<Mesh> meshes(s.meshes, shift);
      const DeviceArray<Object> objects(s.objects, shift);
      const DeviceArray<Vertex> in(vertices, shift);
      const DeviceArray<std::uint32_t> counts(s.counts, shift);
      const DeviceArray<std::uint64_t> offsets(s.offsets, shift);
      const DeviceArray<Placed> out(expected.size(), shift);
      must(pgl::cuda::gather<Placed, Vertex>(meshes.input(), objects.input(), in.input(), counts.input(),
                                             offsets.input(), out.view(), {nullptr, threads}));
      if (const auto same = same_bytes(with_one_nan(out.read()), with_one_nan(expected)); !same) {
        return AssertionFailure() << "blocks of " << threads << ", " << shift << " off: " << same.message();
      }
      const DeviceArray<Vertex> packed(block, shift);
      pgl::test::poison(out);
      must(pgl::cuda::gather_block<Placed, Vertex>(objects.input(), packed.input(), offsets.input(), out.view(),
                                                   {nullptr, threads}));
      if (const auto same = same_bytes(with_one_nan(out.read()), with_one_nan(expected)); !same) {
        return AssertionFailure() << "a block, blocks of " << threads << ", " << shift << " off: " << same.message();
      }
    }
  }
  return AssertionSuccess();
}

AssertionResult agree_on_all(const Scene& s) {
  if (auto result = agree<vec3, vec3>(s); !result) return result << " (points)";
  if (auto result = agree<PlacedVertex, vec3>(s); !result) return result << " (placed vertices)";
  return agree<mine::Drawn, mine::Vertex>(s);
}

TEST(GatherTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    Scene s;
    const auto kind = numbers::kind();
    const auto number = [&] { return numbers::any_number(kind); };
    const int meshes = numbers::whole(1, 3);
    for (int m = 0; m < meshes; ++m) s.add_mesh(static_cast<std::uint32_t>(numbers::whole(0, 40)), number);
    for (int i = numbers::whole(0, 12); i > 0; --i) {
      const auto mesh = static_cast<std::uint32_t>(numbers::whole(0, meshes - 1));
      const auto most = static_cast<int>(s.meshes[mesh].max_vertices);
      s.add_object(mesh, static_cast<std::uint32_t>(numbers::whole(0, most)), numbers::whole(0, 2) == 0, number);
    }
    const AssertionResult result = agree_on_all(s);
    if (!result) RC_FAIL(std::string(result.message()));
  }));
}

/// Bits of all sizes, now and then a float that is none.
struct AnyFloat {
  std::mt19937 random{1};
  float operator()() {
    constexpr float special[] = {0.0f,
                                 -0.0f,
                                 std::numeric_limits<float>::denorm_min(),
                                 1e30f,
                                 -1e30f,
                                 1e-30f,
                                 std::numeric_limits<float>::infinity(),
                                 std::numeric_limits<float>::quiet_NaN(),
                                 std::numeric_limits<float>::max()};
    if (random() % 40 == 0) return special[random() % std::size(special)];
    return std::ldexp(static_cast<float>(static_cast<std::int32_t>(random())), static_cast<int>(random() % 60) - 60);
  }
};

TEST(GatherTwin, SameBytesAroundTheEdgesOfWarpsAndTiles) {
  PGL_NEEDS_DEVICE();
  AnyFloat number;
  for (const std::uint32_t size : {1u, 31u, 32u, 33u, 127u, 128u, 129u, 255u, 256u, 257u, 1023u, 1024u, 1025u}) {
    Scene s;
    s.add_mesh(size, number);
    s.add_mesh(0, number);
    for (const std::uint32_t count : {size, 0u, size - 1, 1u, size / 2}) s.add_object(0, count, count % 2 == 0, number);
    s.add_object(1, 0, true, number);
    EXPECT_TRUE(agree_on_all(s)) << size;
  }
}

TEST(GatherTwin, SameBytesForManySmallObjectsAndAHugeOne) {
  PGL_NEEDS_DEVICE();
  AnyFloat number;
  Scene s;
  for (std::uint32_t m = 0; m < 50; ++m) s.add_mesh(240 + m, number);
  s.add_mesh(100000, number);
  for (int i = 0; i < 4000; ++i) {
    const auto r = static_cast<std::uint32_t>(number.random());
    s.add_object(r % 50, i % 1000 < 300 || r % 3 == 0 ? 0 : r % 29, r % 5 == 0, number);
    if (i == 2000) s.add_object(50, 100000, false, number);
  }
  EXPECT_TRUE(agree_on_all(s));
}

/// Sums whose terms cancel: their order shows, which sums of terms of like size seldom show after rounding to float.
TEST(GatherTwin, SameBytesWhereTermsCancel) {
  PGL_NEEDS_DEVICE();
  AnyFloat number;
  const auto around_one = [&] { return 1.0f + std::ldexp(static_cast<float>(number.random() % 4096), -12); };
  Scene s;
  s.add_mesh(200, around_one);
  for (int i = 0; i < 40; ++i) {
    s.add_object(0, 200, false, around_one);
    const float large = std::ldexp(around_one(), i);
    Object& object = s.objects.back();
    for (int row = 0; row < 3; ++row) {  // x and y cancel but for little; z is small beside them
      object.transform[0][row] = large;
      object.transform[1][row] = -large;
      object.transform[2][row] = std::ldexp(around_one(), -i);
      object.transform[3][row] = 0.0f;
    }
  }
  for (std::size_t v = 0; v + 1 < s.vertices.size(); v += 2) s.vertices[v].y = s.vertices[v].x;
  EXPECT_TRUE(agree_on_all(s));
}

TEST(GatherTwin, WritesNothingForNothing) {
  PGL_NEEDS_DEVICE();
  AnyFloat number;
  Scene s;
  EXPECT_TRUE(agree_on_all(s));
  s.add_mesh(10, number);
  for (int i = 0; i < 100; ++i) s.add_object(0, 0, false, number);
  EXPECT_TRUE(agree_on_all(s));
}

TEST(GatherTwin, ReplaysAsAGraph) {
  PGL_NEEDS_DEVICE();
  AnyFloat number;
  Scene s;
  s.add_mesh(300, number);
  for (std::uint32_t i = 0; i < 500; ++i) s.add_object(0, i % 40, false, number);
  std::vector<PlacedVertex> expected(s.offsets.back());
  pgl::host::gather<PlacedVertex, vec3>(s.meshes, s.objects, s.vertices, s.counts, s.offsets, expected);
  const DeviceArray<Mesh> meshes(s.meshes);
  const DeviceArray<Object> objects(s.objects);
  const DeviceArray<vec3> vertices(s.vertices);
  const DeviceArray<std::uint32_t> counts(s.counts);
  const DeviceArray<std::uint64_t> offsets(s.offsets);
  const DeviceArray<PlacedVertex> out(expected.size());
  const auto enqueue = [&](cudaStream_t stream) {
    return pgl::cuda::gather<PlacedVertex, vec3>(meshes.input(), objects.input(), vertices.input(), counts.input(),
                                                 offsets.input(), out.view(), stream);
  };
  const DeviceArray<vec3> block(
      test::block_of(s.meshes, s.objects, &Mesh::first_vertex, s.vertices, s.offsets, untouched<vec3>()));
  const auto enqueue_block = [&](cudaStream_t stream) {
    return pgl::cuda::gather_block<PlacedVertex, vec3>(objects.input(), block.input(), offsets.input(), out.view(),
                                                       stream);
  };
  must(enqueue(nullptr));  // loads the kernel
  must(enqueue_block(nullptr));
  const pgl::test::Captured graph(enqueue), block_graph(enqueue_block);
  for (int round = 0; round < 2; ++round) {
    pgl::test::poison(out);
    graph.replay();
    EXPECT_TRUE(same_bytes(with_one_nan(out.read()), with_one_nan(expected)));
    pgl::test::poison(out);
    block_graph.replay();
    EXPECT_TRUE(same_bytes(with_one_nan(out.read()), with_one_nan(expected))) << "a block";
  }
}

}  // namespace
