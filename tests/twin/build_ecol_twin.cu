// SPDX-License-Identifier: MIT
// build_ecol: the GPU's bytes are the host's, for any mesh, option, batch and block size.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

#include "pgl/cuda/build_ecol.cuh"
#include "pgl/host/build_ecol.hpp"
#include "support/ecol_cases.hpp"
#include "twin/device.cuh"

namespace {

using namespace test;
using pgl::EcolOptions;
using pgl::EcolOrder;
using pgl::MeshRange;
using pgl::test::DeviceArray;
using pgl::test::must;

/// Many meshes in one set of arrays, with gaps between them.
struct Batch {
  std::vector<MeshRange> meshes;
  std::vector<glm::vec3> positions;
  std::vector<Corners> triangles;
  std::vector<std::uint8_t> locked;
  EcolOptions options;
  bool with_error = false;
  std::size_t map_size = 0;

  void add(const TriangleMesh& mesh, const std::vector<std::uint8_t>& locks = {}) {
    positions.resize(positions.size() + meshes.size() % 3, glm::vec3(9));
    triangles.resize(triangles.size() + meshes.size() % 2, Corners{{7, 7, 7}});
    meshes.push_back({positions.size(), triangles.size(), map_size, mesh.vertex_count(), mesh.triangle_count()});
    positions.insert(positions.end(), mesh.positions.begin(), mesh.positions.end());
    triangles.insert(triangles.end(), mesh.triangles.begin(), mesh.triangles.end());
    locked.resize(positions.size(), 0);
    std::copy(locks.begin(), locks.end(), locked.end() - static_cast<std::ptrdiff_t>(locks.size()));
    map_size += mesh.positions.size() + 1 + meshes.size() % 4;
  }
};

template <class Index>
std::vector<pgl::Triangle<Index>> narrowed(const std::vector<Corners>& wide) {
  std::vector<pgl::Triangle<Index>> triangles;
  for (const Corners& t : wide)
    triangles.push_back({{static_cast<Index>(t.v[0]), static_cast<Index>(t.v[1]), static_cast<Index>(t.v[2])}});
  return triangles;
}

template <class Real, class Index>
class Backends {
 public:
  explicit Backends(const Batch& batch) : b_(batch), triangles_(narrowed<Index>(batch.triangles)) {
    pattern(ecol_, b_.positions.size());
    pattern(permute_v_, b_.positions.size());
    pattern(permute_t_, b_.triangles.size());
    pattern(map_, b_.map_size);
    pattern(error_, b_.with_error ? b_.map_size : 0);
    min_.resize(b_.meshes.size());
    std::vector<pgl::host::EcolWorkspace<Real>> workspaces;
    pgl::host::build_ecol<Real, Index>(b_.meshes, b_.positions, triangles_, b_.locked, b_.options, workspaces, ecol_,
                                       permute_v_, permute_t_, map_, error_, min_);
  }

  /// The device's answer, on top of the same bytes as the host's was.
  ::testing::AssertionResult device_agrees(pgl::cuda::EcolWorkspace<Real>& workspace, pgl::cuda::Launch launch = {}) {
    const DeviceArray positions(b_.positions);
    const DeviceArray triangles(triangles_);
    const DeviceArray locked(b_.locked);
    const DeviceArray<Index> ecol(b_.positions.size()), permute_v(b_.positions.size());
    const DeviceArray<std::uint32_t> permute_t(b_.triangles.size()), map(b_.map_size), min(b_.meshes.size());
    const DeviceArray<float> error(b_.with_error ? b_.map_size : 0);
    must(pgl::cuda::build_ecol<Real, Index>(b_.meshes, positions.input(), triangles.input(), locked.input(), b_.options,
                                            workspace, ecol.view(), permute_v.view(), permute_t.view(), map.view(),
                                            error.view(), min.view(), launch));
    const auto check = [](const char* what, const auto& device, const auto& host) {
      auto same = pgl::test::same_bytes(device, host);
      return same ? ::testing::AssertionSuccess() : ::testing::AssertionFailure() << what << ": " << same.message();
    };
    if (auto r = check("min", min.read(), min_); !r) return r;
    if (auto r = check("ecol", ecol.read(), ecol_); !r) return r;
    if (auto r = check("permute_v", permute_v.read(), permute_v_); !r) return r;
    if (auto r = check("permute_t", permute_t.read(), permute_t_); !r) return r;
    if (auto r = check("map", map.read(), map_); !r) return r;
    return check("error", error.read(), error_);
  }

 private:
  template <class T>
  static void pattern(std::vector<T>& values, std::size_t size) {
    values.resize(size);
    if (size > 0) std::memset(static_cast<void*>(values.data()), 0xA5, size * sizeof(T));
  }
  const Batch& b_;
  std::vector<pgl::Triangle<Index>> triangles_;
  std::vector<Index> ecol_, permute_v_;
  std::vector<std::uint32_t> permute_t_, map_, min_;
  std::vector<float> error_;
};

template <class Real, class Index>
::testing::AssertionResult agree(const Batch& batch, pgl::cuda::Launch launch = {}) {
  pgl::cuda::EcolWorkspace<Real> workspace;
  return Backends<Real, Index>(batch).device_agrees(workspace, launch);
}

Batch random_batch(std::uint32_t seed, std::uint32_t meshes) {
  std::mt19937 rng(seed);
  Batch batch;
  for (std::uint32_t i = 0; i < meshes; ++i) {
    EcolCase c =
        random_ecol_case(static_cast<std::uint32_t>(rng()), {Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
    if (below(rng, 4) == 0) make_extreme(c, rng);
    if (below(rng, 20) == 0) c = EcolCase{};
    batch.add(c.mesh, c.locked);
  }
  batch.options = options_of(rng);
  batch.options.flip_guard = below(rng, 2) == 0;
  batch.options.order = below(rng, 2) == 0 ? EcolOrder::greedy : EcolOrder::rounds;
  batch.with_error = below(rng, 2) == 0;
  return batch;
}

void random_batches_agree(bool fine, bool narrow) {
  const auto seed = *rc::gen::arbitrary<std::uint32_t>().as("seed");
  const Batch batch = random_batch(seed, 1 + seed % 64);
  const ::testing::AssertionResult same =
      fine ? (narrow ? agree<double, std::uint16_t>(batch) : agree<double, std::uint32_t>(batch))
           : (narrow ? agree<float, std::uint16_t>(batch) : agree<float, std::uint32_t>(batch));
  if (!same) RC_FAIL(std::string(same.message()));
}

TEST(BuildEcolTwin, RandomBatchesInFloat) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] { random_batches_agree(false, true); }));
}
TEST(BuildEcolTwin, RandomBatchesInFloatWithWideIndices) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] { random_batches_agree(false, false); }));
}
TEST(BuildEcolTwin, RandomBatchesInDouble) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([] { random_batches_agree(true, true); }));
}

TEST(BuildEcolTwin, NothingAndMeshesOfNothing) {
  PGL_NEEDS_DEVICE();
  Batch batch;
  EXPECT_TRUE((agree<float, std::uint32_t>(batch)));
  batch.add({});
  batch.add({{{1, 2, 3}}, {}});
  batch.add({{{1, 2, 3}, {4, 5, 6}}, {{{0, 0, 1}}}});
  batch.with_error = true;
  EXPECT_TRUE((agree<float, std::uint32_t>(batch)));
  batch.options.order = EcolOrder::rounds;
  EXPECT_TRUE((agree<float, std::uint32_t>(batch)));
}

/// Tori around every size at which a mesh gets another share of a processor, a tree, or global memory.
TEST(BuildEcolTwin, MeshesOfEverySizeClass) {
  PGL_NEEDS_DEVICE();
  for (const auto order : {EcolOrder::greedy, EcolOrder::rounds}) {
    Batch batch;
    std::mt19937 rng(5);
    for (std::uint32_t side = 3; side < 70; side += side < 36 ? 1 : 11)
      batch.add(jittered(torus(side, side + side % 3), rng, 0.02f));
    batch.options.order = order;
    batch.with_error = order == EcolOrder::rounds;
    EXPECT_TRUE((agree<float, std::uint16_t>(batch)));
    batch.options.metric = pgl::CostMetric::melax;
    EXPECT_TRUE((agree<float, std::uint16_t>(batch)));
  }
}

/// Some hundred triangles around one vertex: the lists are longer than a warp.
TEST(BuildEcolTwin, FansOfManyTriangles) {
  PGL_NEEDS_DEVICE();
  for (const auto order : {EcolOrder::greedy, EcolOrder::rounds})
    for (const auto boundary : {pgl::BoundaryRule::locked, pgl::BoundaryRule::slide}) {
      Batch batch;
      for (const std::uint32_t n : {31u, 32u, 33u, 63u, 64u, 65u, 100u, 300u}) {
        batch.add(fan(n, true));
        batch.add(fan(n, false));
        batch.add(bipyramid(n));
      }
      batch.options.order = order;
      batch.options.boundary = boundary;
      EXPECT_TRUE((agree<float, std::uint32_t>(batch)));
    }
}

TEST(BuildEcolTwin, OneLargeMeshByRoundsOfTheWholeDevice) {
  PGL_NEEDS_DEVICE();
  Batch batch;
  std::mt19937 rng(6);
  batch.add(jittered(torus(300, 290), rng, 0.004f));
  batch.add(jittered(torus(10, 12), rng, 0.02f));
  TriangleMesh open = punctured(jittered(grid(270, 260), rng, 0.004f), rng, 300);
  open.triangles.push_back({{5, 5, 6}});
  open.triangles.push_back(open.triangles.front());
  batch.add(open);
  batch.options.order = EcolOrder::rounds;
  batch.options.boundary = pgl::BoundaryRule::slide;
  batch.with_error = true;
  for (const unsigned threads : pgl::test::block_sizes)
    EXPECT_TRUE((agree<float, std::uint32_t>(batch, {nullptr, threads}))) << threads;
  batch.with_error = false;
  batch.options.metric = pgl::CostMetric::melax;
  EXPECT_TRUE((agree<double, std::uint32_t>(batch)));
}

/// Too large for shared memory, and small enough for a memory checker.
TEST(BuildEcolTwin, AMeshOfThousandsByRoundsOfTheWholeDevice) {
  PGL_NEEDS_DEVICE();
  Batch batch;
  std::mt19937 rng(9);
  batch.add(punctured(jittered(torus(60, 55), rng, 0.01f), rng, 20));
  batch.options.order = EcolOrder::rounds;
  batch.options.boundary = pgl::BoundaryRule::slide;
  batch.with_error = true;
  EXPECT_TRUE((agree<float, std::uint16_t>(batch)));
}

TEST(BuildEcolTwin, OneLargeMeshGreedily) {
  PGL_NEEDS_DEVICE();
  Batch batch;
  std::mt19937 rng(7);
  batch.add(jittered(torus(130, 120), rng, 0.008f));
  EXPECT_TRUE((agree<float, std::uint32_t>(batch)));
}

TEST(BuildEcolTwin, AWarmWorkspaceAllocatesNothing) {
  PGL_NEEDS_DEVICE();
  Batch batch;
  std::mt19937 rng(8);
  batch.add(jittered(torus(60, 60), rng, 0.008f));
  batch.add(jittered(torus(260, 260), rng, 0.004f));
  batch.options.order = EcolOrder::rounds;
  Backends<float, std::uint32_t> backends(batch);
  pgl::cuda::EcolWorkspace<float> workspace;
  ASSERT_TRUE(backends.device_agrees(workspace));
  const std::size_t first = workspace.bytes();
  EXPECT_GT(first, 0u);
  ASSERT_TRUE(backends.device_agrees(workspace));
  EXPECT_EQ(workspace.bytes(), first);
}

}  // namespace
