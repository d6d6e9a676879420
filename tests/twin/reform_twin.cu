// SPDX-License-Identifier: MIT
// reform: the GPU's bytes against the CPU's, for chains of any length and scenes around the edges of warps and tiles.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "pgl/cuda/reform.cuh"
#include "pgl/host/parallel.hpp"
#include "pgl/host/reform.hpp"
#include "support/block.hpp"
#include "support/random_scene.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::Mesh;
using pgl::Object;
using pgl::Triangle;
using pgl::test::block_sizes;
using pgl::test::Captured;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using test::Collapses;
using test::Scene;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;

template <class Index>
class ReformTwin : public testing::Test {};
using Indices = testing::Types<std::uint16_t, std::uint32_t>;
TYPED_TEST_SUITE(ReformTwin, Indices);

/// Room in the outputs beyond what is written, which must stay as it is.
constexpr std::size_t beyond = 70;

template <class T>
T untouched() {
  T value;
  std::memset(static_cast<void*>(&value), 0xA5, sizeof(T));
  return value;
}

template <class Index>
struct Reformed {
  std::vector<Triangle<Index>> local;
  std::vector<Triangle<std::uint32_t>> global;

  AssertionResult is(const Reformed& other) const {
    if (auto same = same_bytes(local, other.local); !same) return same << " (local)";
    return same_bytes(global, other.global);
  }
};

template <class Index>
std::vector<Triangle<Index>> block_of(const Scene<Index>& s) {
  return test::block_of(s.meshes, s.objects, &Mesh::first_triangle, s.triangles, s.triangle_offsets,
                        untouched<Triangle<Index>>());
}

template <class Index>
Reformed<Index> on_host(const Scene<Index>& s, pgl::host::ReformWorkspace<Index>& workspace) {
  const std::size_t size = s.triangle_offsets.back() + beyond;
  Reformed<Index> result{std::vector(size, untouched<Triangle<Index>>()),
                         std::vector(size, untouched<Triangle<std::uint32_t>>())};
  pgl::host::reform_local<Index>(s.meshes, s.objects, s.triangles, s.ecol, s.counts, s.triangle_offsets, workspace,
                                 result.local);
  pgl::host::reform<Index>(s.meshes, s.objects, s.triangles, s.ecol, s.counts, s.vertex_offsets, s.triangle_offsets,
                           workspace, result.global);
  return result;
}

/// A scene in device memory, every array some elements off an aligned address.
template <class Index>
struct OnDevice {
  DeviceArray<Mesh> meshes;
  DeviceArray<Object> objects;
  DeviceArray<Triangle<Index>> triangles, block;
  DeviceArray<Index> ecol;
  DeviceArray<std::uint32_t> counts;
  DeviceArray<std::uint64_t> vertex_offsets, triangle_offsets;
  DeviceArray<Triangle<Index>> local;
  DeviceArray<Triangle<std::uint32_t>> global;

  explicit OnDevice(const Scene<Index>& s, std::size_t shift = 1)
      : meshes(s.meshes, shift),
        objects(s.objects, shift),
        triangles(s.triangles, shift),
        block(block_of(s), shift),
        ecol(s.ecol, shift),
        counts(s.counts, shift),
        vertex_offsets(s.vertex_offsets, shift),
        triangle_offsets(s.triangle_offsets, shift),
        local(s.triangle_offsets.back() + beyond, shift),
        global(s.triangle_offsets.back() + beyond, shift) {}

  cudaError_t reform_local(pgl::cuda::ReformWorkspace<Index>& workspace, pgl::cuda::Launch launch) const {
    return pgl::cuda::reform_local<Index>(meshes.input(), objects.input(), triangles.input(), ecol.input(),
                                          counts.input(), triangle_offsets.input(), workspace, local.view(), launch);
  }
  cudaError_t reform(pgl::cuda::ReformWorkspace<Index>& workspace, pgl::cuda::Launch launch) const {
    return pgl::cuda::reform<Index>(meshes.input(), objects.input(), triangles.input(), ecol.input(), counts.input(),
                                    vertex_offsets.input(), triangle_offsets.input(), workspace, global.view(), launch);
  }
  cudaError_t reform_block(pgl::cuda::ReformWorkspace<Index>& workspace, pgl::cuda::Launch launch) const {
    return pgl::cuda::reform_block<Index>(meshes.input(), objects.input(), block.input(), ecol.input(), counts.input(),
                                          vertex_offsets.input(), triangle_offsets.input(), workspace, global.view(),
                                          launch);
  }
  Reformed<Index> read() const { return {local.read(), global.read()}; }
};

void poison(const pgl::cuda::Buffer& buffer) {
  if (buffer.size() != 0) must(cudaMemset(buffer.at<void>(), 0xA5, buffer.size()));
}

/// Runs every backend and demands the bytes of the host's first result, which it returns.
template <class Index>
AssertionResult all_agree(const Scene<Index>& s, Reformed<Index>* first = nullptr) {
  pgl::host::ReformWorkspace<Index> host_workspace;
  const auto expected = on_host(s, host_workspace);
  if (first != nullptr) *first = expected;
  std::vector from_block(expected.global.size(), untouched<Triangle<std::uint32_t>>());
  pgl::host::reform_block<Index>(s.meshes, s.objects, block_of(s), s.ecol, s.counts, s.vertex_offsets,
                                 s.triangle_offsets, host_workspace, from_block);
  if (const auto same = same_bytes(from_block, expected.global); !same)
    return AssertionFailure() << "a block: " << same.message();
#if defined(_OPENMP)
  const int all = omp_get_max_threads();
  omp_set_num_threads(1);
  const auto alone = on_host(s, host_workspace);
  omp_set_num_threads(all);
  if (const auto same = alone.is(expected); !same) return AssertionFailure() << "one thread: " << same.message();
#endif
  std::uint32_t largest = 0;
  for (const Mesh& mesh : s.meshes) largest = std::max(largest, mesh.max_vertices);
  for (const unsigned threads : block_sizes) {
    for (const bool reserved : {false, true}) {
      const OnDevice<Index> device(s, threads % 5);
      pgl::cuda::ReformWorkspace<Index> workspace;
      if (reserved) must(workspace.reserve(s.objects.size(), largest));
      must(device.reform_local(workspace, {nullptr, threads}));
      poison(workspace.buffer);
      must(device.reform(workspace, {nullptr, threads}));
      if (const auto same = device.read().is(expected); !same) {
        return AssertionFailure() << "blocks of " << threads << (reserved ? ", reserved: " : ": ") << same.message();
      }
      pgl::test::poison(device.global);
      poison(workspace.buffer);
      must(device.reform_block(workspace, {nullptr, threads}));
      if (const auto same = device.read().is(expected); !same) {
        return AssertionFailure() << "a block, blocks of " << threads << (reserved ? ", reserved: " : ": ")
                                  << same.message();
      }
    }
  }
  return AssertionSuccess();
}

TYPED_TEST(ReformTwin, SameBytesForRandomScenes) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] {
    const auto scene = test::random_scene<TypeParam>([](std::uint32_t least, std::uint32_t most) {
      return static_cast<std::uint32_t>(*rc::gen::inRange<std::uint64_t>(least, std::uint64_t{most} + 1));
    });
    Reformed<TypeParam> first;
    const AssertionResult result = all_agree(scene, &first);
    if (!result) RC_FAIL(std::string(result.message()));
    RC_ASSERT(std::equal(scene.local.begin(), scene.local.end(), first.local.begin()));
    RC_ASSERT(std::equal(scene.global.begin(), scene.global.end(), first.global.begin()));
  }));
}

// ---- scenes of any size, with collapses that are made directly in the new order

template <class Index>
void add_mesh(Scene<Index>& s, std::mt19937& random, std::uint32_t vertices, std::uint32_t triangles, Collapses kind) {
  s.meshes.push_back({.first_vertex = s.ecol.size(),
                      .first_triangle = s.triangles.size(),
                      .min_vertices = std::min(vertices, 1u),
                      .max_vertices = vertices});
  for (std::uint32_t v = 0; v < vertices; ++v) {
    const std::uint32_t target = v == 0                         ? std::uint32_t{pgl::no_target<Index>}
                                 : kind == Collapses::one_chain ? v - 1
                                 : kind == Collapses::one_star  ? 0
                                 : kind == Collapses::along_edges
                                     ? v - 1 - static_cast<std::uint32_t>(random() % std::min(v, 5u))
                                     : static_cast<std::uint32_t>(random() % v);
    s.ecol.push_back(static_cast<Index>(target));
  }
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const auto corner = [&] { return static_cast<Index>(random() % vertices); };
    s.triangles.push_back({{corner(), corner(), corner()}});
  }
}

template <class Index>
void add_object(Scene<Index>& s, std::mt19937& random, std::uint32_t mesh, std::uint32_t count, std::uint64_t size) {
  Object object{.mesh = mesh};
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row)
      object.transform[column][row] = static_cast<float>(static_cast<int>(random() % 7) - 3);
  }
  s.objects.push_back(object);
  s.counts.push_back(count);
  s.vertex_offsets.push_back(s.vertex_offsets.back() + count);
  s.triangle_offsets.push_back(s.triangle_offsets.back() + (count == 0 ? 0 : size));
}

constexpr Collapses kinds[] = {Collapses::anywhere, Collapses::along_edges, Collapses::one_chain, Collapses::one_star};

// The frame that it is made for, only fewer: many meshes of some hundred vertices, of which most objects show a few.
TYPED_TEST(ReformTwin, SameBytesForAFrameOfManySmallParts) {
  PGL_NEEDS_DEVICE();
  for (const Collapses kind : kinds) {
    for (const unsigned culled : {0u, 1u, 9u}) {  // of 10
      std::mt19937 random(culled);
      Scene<TypeParam> s;
      for (int m = 0; m < 60; ++m) add_mesh<TypeParam>(s, random, 240 + random() % 71, 464, kind);
      for (int i = 0; i < 3000; ++i) {
        const auto mesh = static_cast<std::uint32_t>(random() % s.meshes.size());
        const bool close = random() % 50 == 0;
        const auto count = random() % 10 < culled ? 0u : close ? 240u : 3u + static_cast<std::uint32_t>(random() % 25);
        add_object<TypeParam>(s, random, mesh, count, close ? 464 : random() % 60);
      }
      EXPECT_TRUE(all_agree(s)) << static_cast<int>(kind) << ' ' << culled;
    }
  }
}

TYPED_TEST(ReformTwin, SameBytesAroundTheEdgesOfWarpsAndTiles) {
  PGL_NEEDS_DEVICE();
  for (const std::uint32_t size :
       {1u, 31u, 32u, 33u, 63u, 64u, 65u, 127u, 128u, 129u, 255u, 256u, 257u, 1023u, 1024u, 1025u}) {
    for (const Collapses kind : kinds) {
      std::mt19937 random(size);
      Scene<TypeParam> s;
      add_mesh<TypeParam>(s, random, size, size, kind);
      add_mesh<TypeParam>(s, random, 1, 1, kind);
      for (const std::uint32_t count : {size, 1u, size / 2, 0u, size - 1, 1u})
        add_object<TypeParam>(s, random, 0, count, size);
      add_object<TypeParam>(s, random, 1, 1, 1);
      EXPECT_TRUE(all_agree(s)) << size;
    }
  }
}

// Long runs of objects that show nothing, before, between and behind those that do; objects of one triangle.
TYPED_TEST(ReformTwin, SameBytesAmongManyEmptyObjects) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(5);
  Scene<TypeParam> s;
  add_mesh<TypeParam>(s, random, 100, 300, Collapses::anywhere);
  for (const int run : {0, 5000, 1, 31, 32, 33, 1000, 0, 0, 64, 20000}) {
    for (int i = 0; i < run; ++i) add_object<TypeParam>(s, random, 0, 0, 0);
    for (int i = 0; i < run % 100; ++i) add_object<TypeParam>(s, random, 0, 7, 1);
    for (int i = 0; i < 10; ++i) add_object<TypeParam>(s, random, 0, 20, random() % 3 * 50);
  }
  EXPECT_TRUE(all_agree(s));
}

TYPED_TEST(ReformTwin, WritesNothingForNothing) {
  PGL_NEEDS_DEVICE();
  Scene<TypeParam> s;
  EXPECT_TRUE(all_agree(s));
  std::mt19937 random(6);
  add_mesh<TypeParam>(s, random, 10, 10, Collapses::anywhere);
  EXPECT_TRUE(all_agree(s));
  for (int i = 0; i < 100; ++i) add_object<TypeParam>(s, random, 0, 0, 0);
  EXPECT_TRUE(all_agree(s));
}

// Chains too long to follow: in meshes with a table in shared memory, with one per block, and with one for the grid.
TYPED_TEST(ReformTwin, SameBytesForChainsAsLongAsTheMesh) {
  PGL_NEEDS_DEVICE();
  const std::uint32_t most = sizeof(TypeParam) == 2 ? 65536 : 300000;
  for (const Collapses kind : {Collapses::one_chain, Collapses::along_edges, Collapses::one_star}) {
    std::mt19937 random(7);
    Scene<TypeParam> s;
    const std::uint32_t sizes[] = {150, 2000, 9000, most, 3500, most - 1};
    for (const std::uint32_t size : sizes) add_mesh<TypeParam>(s, random, size, 2 * size, kind);
    for (int i = 0; i < 60; ++i) {
      const auto m = static_cast<std::uint32_t>(random() % 6);
      const std::uint32_t counts[] = {1, 10, sizes[m] / 2, sizes[m] - 1, sizes[m]};
      const std::uint64_t shown[] = {1, 40, 200, sizes[m], 2 * sizes[m]};
      add_object<TypeParam>(s, random, m, counts[random() % 5], shown[random() % (i % 8 == 0 ? 5 : 4)]);
    }
    EXPECT_TRUE(all_agree(s)) << static_cast<int>(kind);
  }
}

// As a user may time it: other tunings of the kernel.
template <class Index>
struct NeverCopies : pgl::cuda::reform_detail::Tuning<Index> {
  static constexpr unsigned copy_worth = 0, rows = 1;
};
template <class Index>
struct AlwaysTables : pgl::cuda::reform_detail::Tuning<Index> {
  static constexpr unsigned most_steps = 0, rows = 3, waves = 1;
};
template <class Tune, class Index>
AssertionResult agrees(const Scene<Index>& s) {
  pgl::host::ReformWorkspace<Index> host_workspace;
  const auto expected = on_host(s, host_workspace);
  const OnDevice<Index> d(s, 0);
  pgl::cuda::ReformWorkspace<Index> workspace;
  must(pgl::cuda::reform_detail::reform<Tune, std::uint32_t, Index>(
      {d.meshes.data(), d.objects.data(), s.objects.size(), d.triangles.data(), d.ecol.data(), s.ecol.size(),
       d.counts.data(), d.vertex_offsets.data(), d.triangle_offsets.data()},
      workspace, d.global.view(), {}));
  return same_bytes(d.global.read(), expected.global);
}
TYPED_TEST(ReformTwin, SameBytesHoweverItIsTuned) {
  PGL_NEEDS_DEVICE();
  for (const Collapses kind : kinds) {
    std::mt19937 random(8);
    Scene<TypeParam> s;
    for (const std::uint32_t size : {310u, 33u, 12000u}) add_mesh<TypeParam>(s, random, size, 500, kind);
    for (std::uint32_t i = 0; i < 200; ++i) add_object<TypeParam>(s, random, i % 3, 1 + random() % 33, random() % 100);
    EXPECT_TRUE((agrees<NeverCopies<TypeParam>>(s)));
    EXPECT_TRUE((agrees<AlwaysTables<TypeParam>>(s)));
  }
}

TYPED_TEST(ReformTwin, SameBytesForOneMesh) {
  PGL_NEEDS_DEVICE();
  using Index = TypeParam;
  for (const std::uint32_t vertices : {1u, 2u, 33u, 300u, 20000u}) {
    for (const Collapses kind : kinds) {
      std::mt19937 random(9);
      Scene<Index> s;
      add_mesh<Index>(s, random, vertices, vertices + 50, kind);
      const DeviceArray<Triangle<Index>> triangles(s.triangles);
      const DeviceArray<Index> ecol(s.ecol);
      pgl::host::ReformWorkspace<Index> host_workspace;
      pgl::cuda::ReformWorkspace<Index> workspace;
      for (const std::uint32_t count : {1u, vertices / 2 + 1, vertices}) {
        std::vector<Triangle<Index>> expected(s.triangles.size());
        pgl::host::reform_mesh<Index>(s.triangles, s.ecol, count, host_workspace, expected);
        for (const unsigned threads : block_sizes) {
          const DeviceArray<Triangle<Index>> out(s.triangles.size());
          must(pgl::cuda::reform_mesh<Index>(triangles.input(), ecol.input(), count, workspace, out.view(),
                                             {nullptr, threads}));
          EXPECT_TRUE(same_bytes(out.read(), expected)) << vertices << ' ' << count;
        }
      }
      must(pgl::cuda::reform_mesh<Index>({}, ecol.input(), 1, workspace, {}));
    }
  }
}

// Counts and offsets may change between replays, since only the device reads them.
TYPED_TEST(ReformTwin, ReplaysAsAGraphAndAllocatesNothing) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(10);
  Scene<TypeParam> full, less;
  for (const std::uint32_t size : {310u, 30000u}) add_mesh<TypeParam>(full, random, size, 464, Collapses::one_chain);
  less = full;
  for (std::uint32_t i = 0; i < 500; ++i) {
    add_object<TypeParam>(full, random, i % 9 == 0, 20, 22);
    const bool shown = i % 3 != 0;
    add_object<TypeParam>(less, random, 0, shown ? 5 + i % 11 : 0, shown ? i % 22 : 0);
  }
  less.objects = full.objects;
  pgl::host::ReformWorkspace<TypeParam> host_workspace;
  const auto expected = on_host(full, host_workspace);
  auto expected_less = on_host(less, host_workspace);

  const OnDevice<TypeParam> device(full);
  pgl::cuda::ReformWorkspace<TypeParam> workspace;
  must(workspace.reserve(full.objects.size(), 30000));
  must(device.reform_local(workspace, {}));  // loads the kernels
  must(device.reform(workspace, {}));
  const std::size_t reserved = workspace.buffer.size();
  const void* memory = workspace.buffer.template at<void>();
  const Captured graph([&](cudaStream_t stream) {
    PGL_CUDA_TRY(device.reform_local(workspace, stream));
    return device.reform(workspace, stream);
  });
  for (int round = 0; round < 2; ++round) {
    pgl::test::poison(device.local);
    pgl::test::poison(device.global);
    pgl::test::assign(device.counts, full.counts);
    pgl::test::assign(device.vertex_offsets, full.vertex_offsets);
    pgl::test::assign(device.triangle_offsets, full.triangle_offsets);
    graph.replay();
    EXPECT_TRUE(device.read().is(expected));

    pgl::test::poison(device.local);
    pgl::test::poison(device.global);
    pgl::test::assign(device.counts, less.counts);
    pgl::test::assign(device.vertex_offsets, less.vertex_offsets);
    pgl::test::assign(device.triangle_offsets, less.triangle_offsets);
    graph.replay();
    auto result = device.read();
    expected_less.local.resize(result.local.size(), untouched<Triangle<TypeParam>>());
    expected_less.global.resize(result.global.size(), untouched<Triangle<std::uint32_t>>());
    EXPECT_TRUE(result.is(expected_less));
  }
  EXPECT_EQ(workspace.buffer.size(), reserved);
  EXPECT_EQ(workspace.buffer.template at<void>(), memory);
}

}  // namespace
