// SPDX-License-Identifier: MIT
#include "pgl/host/reform.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <random>
#include <vector>

#include "support/block.hpp"
#include "support/random_collapse.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

using pgl::Mesh;
using pgl::no_target;
using pgl::Object;
template <class Index>
using Triangles = std::vector<pgl::Triangle<Index>>;

const glm::mat4x3 mirror_x(glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, 0, 1), glm::vec3(0));

/// A scene in which every mesh stands once, and a place for its result.
template <class Index>
struct Scene {
  std::vector<Mesh> meshes;
  std::vector<Object> objects;
  Triangles<Index> triangles;
  std::vector<Index> ecol;
  std::vector<std::uint32_t> counts;
  std::vector<std::uint64_t> vertex_offsets{0};
  std::vector<std::uint64_t> triangle_offsets{0};

  /// Shows `count` vertices and the first `shown` triangles of a new mesh.
  void add(const Triangles<Index>& mesh_triangles, const std::vector<Index>& mesh_ecol, std::uint32_t count,
           std::uint64_t shown, const glm::mat4x3& transform = glm::mat4x3(1.0f)) {
    objects.push_back({static_cast<std::uint32_t>(meshes.size()), transform});
    meshes.push_back({.first_vertex = ecol.size(),
                      .first_triangle = triangles.size(),
                      .max_vertices = static_cast<std::uint32_t>(mesh_ecol.size())});
    triangles.insert(triangles.end(), mesh_triangles.begin(), mesh_triangles.end());
    ecol.insert(ecol.end(), mesh_ecol.begin(), mesh_ecol.end());
    counts.push_back(count);
    vertex_offsets.push_back(vertex_offsets.back() + count);
    triangle_offsets.push_back(triangle_offsets.back() + shown);
  }

  Triangles<std::uint32_t> reform(pgl::host::ReformWorkspace<Index>& workspace) const {
    Triangles<std::uint32_t> out(triangle_offsets.back());
    pgl::host::reform<Index>(meshes, objects, triangles, ecol, counts, vertex_offsets, triangle_offsets, workspace,
                             out);
    return out;
  }
  Triangles<std::uint32_t> reform() const {
    pgl::host::ReformWorkspace<Index> workspace;
    return reform(workspace);
  }
  /// From a block of the selected triangles, with no others at hand.
  Triangles<std::uint32_t> reform_block(pgl::host::ReformWorkspace<Index>& workspace) const {
    const pgl::Triangle<Index> beyond{{no_target<Index>, no_target<Index>, no_target<Index>}};
    const auto block = test::block_of(meshes, objects, &Mesh::first_triangle, triangles, triangle_offsets, beyond);
    Triangles<std::uint32_t> out(triangle_offsets.back());
    pgl::host::reform_block<Index>(meshes, objects, block, ecol, counts, vertex_offsets, triangle_offsets, workspace,
                                   out);
    return out;
  }
  Triangles<Index> reform_local() const {
    pgl::host::ReformWorkspace<Index> workspace;
    Triangles<Index> out(triangle_offsets.back());
    pgl::host::reform_local<Index>(meshes, objects, triangles, ecol, counts, triangle_offsets, workspace, out);
    return out;
  }

  /// The plain loop of the paper.
  Triangles<std::uint32_t> reform_plainly() const {
    Triangles<std::uint32_t> out;
    for (std::size_t i = 0; i < objects.size(); ++i) {
      const Mesh& mesh = meshes[objects[i].mesh];
      for (std::uint64_t t = 0; t < triangle_offsets[i + 1] - triangle_offsets[i]; ++t) {
        pgl::Triangle<std::uint32_t> triangle{};
        for (int c = 0; c < 3; ++c) {
          std::uint32_t v = triangles[mesh.first_triangle + t].v[c];
          while (v >= counts[i]) v = ecol[mesh.first_vertex + v];
          triangle.v[c] = static_cast<std::uint32_t>(vertex_offsets[i] + v);
        }
        out.push_back(triangle);
      }
    }
    return out;
  }
};

template <class Index>
Triangles<Index> random_triangles(std::mt19937& random, std::uint32_t vertices, std::size_t size) {
  Triangles<Index> triangles(size);
  for (auto& triangle : triangles) {
    for (Index& v : triangle.v) v = static_cast<Index>(random() % vertices);
  }
  return triangles;
}

/// Each vertex merges into the one before it.
template <class Index>
std::vector<Index> chain(std::uint32_t vertices) {
  std::vector<Index> ecol(vertices, no_target<Index>);
  for (std::uint32_t v = 1; v < vertices; ++v) ecol[v] = static_cast<Index>(v - 1);
  return ecol;
}

/// Each vertex merges into any vertex before it.
template <class Index>
std::vector<Index> random_ecol(std::mt19937& random, std::uint32_t vertices) {
  std::vector<Index> ecol(vertices, no_target<Index>);
  for (std::uint32_t v = 1; v < vertices; ++v) ecol[v] = static_cast<Index>(random() % v);
  return ecol;
}

template <class Index>
class Reform : public testing::Test {};
using Indices = testing::Types<std::uint16_t, std::uint32_t>;
TYPED_TEST_SUITE(Reform, Indices);

TYPED_TEST(Reform, TakesOneStepPerCollapse) {
  using Index = TypeParam;
  const auto ecol = chain<Index>(6);
  std::uint64_t steps = 7;
  EXPECT_EQ(pgl::follow_collapses(ecol.data(), 2, Index{1}, steps), 1);
  EXPECT_EQ(steps, 7u);
  EXPECT_EQ(pgl::follow_collapses(ecol.data(), 2, Index{5}, steps), 1);
  EXPECT_EQ(steps, 3u);
  EXPECT_EQ(pgl::follow_collapses(ecol.data(), 1, Index{5}, steps), 2) << "out of steps on the way";
  EXPECT_EQ(steps, 0u);
}

TYPED_TEST(Reform, FollowsEachCornerBelowTheCount) {
  using Index = TypeParam;
  constexpr Index none = no_target<Index>;
  Scene<Index> scene;
  const Triangles<Index> triangles{{{0, 1, 2}}, {{5, 0, 2}}, {{3, 4, 1}}, {{5, 4, 3}}};
  const std::vector<Index> ecol{none, none, none, 2, 3, 1};
  scene.add(triangles, ecol, 3, 2);                     // 5 -> 1
  scene.add(triangles, ecol, 4, 3, glm::mat4x3(2.0f));  // 4 -> 3
  scene.add(triangles, ecol, 6, 4, mirror_x);           // nothing collapsed, turned
  scene.add(triangles, ecol, 0, 0);                     // not shown
  EXPECT_EQ(scene.reform_local(), (Triangles<Index>{{{0, 1, 2}},
                                                    {{1, 0, 2}},
                                                    {{0, 1, 2}},
                                                    {{1, 0, 2}},
                                                    {{3, 3, 1}},
                                                    {{0, 2, 1}},
                                                    {{5, 2, 0}},
                                                    {{3, 1, 4}},
                                                    {{5, 3, 4}}}));
  EXPECT_EQ(scene.reform(), (Triangles<std::uint32_t>{{{0, 1, 2}},
                                                      {{1, 0, 2}},
                                                      {{3, 4, 5}},
                                                      {{4, 3, 5}},
                                                      {{6, 6, 4}},
                                                      {{7, 9, 8}},
                                                      {{12, 9, 7}},
                                                      {{10, 8, 11}},
                                                      {{12, 10, 11}}}));
}

TYPED_TEST(Reform, AcceptsEmptyScenes) {
  Scene<TypeParam> scene;
  EXPECT_TRUE(scene.reform().empty());
  EXPECT_TRUE(scene.reform_local().empty());
  pgl::host::ReformWorkspace<TypeParam> workspace;
  EXPECT_TRUE(scene.reform_block(workspace).empty());
  scene.add({}, {}, 0, 0);
  scene.add({{{0, 0, 0}}}, {no_target<TypeParam>}, 0, 0);
  EXPECT_TRUE(scene.reform().empty());
}

TYPED_TEST(Reform, AcceptsOneVertex) {
  Scene<TypeParam> scene;
  scene.add({{{0, 1, 2}}}, chain<TypeParam>(3), 1, 1);
  scene.add({{{0, 0, 0}}}, chain<TypeParam>(1), 1, 1);
  EXPECT_EQ(scene.reform(), (Triangles<std::uint32_t>{{{0, 0, 0}}, {{1, 1, 1}}}));
}

TYPED_TEST(Reform, LetsObjectsShareAMesh) {
  Scene<TypeParam> scene;
  scene.add({{{0, 1, 2}}, {{3, 2, 1}}}, chain<TypeParam>(4), 4, 2);
  scene.objects.push_back(scene.objects[0]);
  scene.counts.push_back(3);
  scene.vertex_offsets.push_back(7);
  scene.triangle_offsets.push_back(3);
  EXPECT_EQ(scene.reform(), (Triangles<std::uint32_t>{{{0, 1, 2}}, {{3, 2, 1}}, {{4, 5, 6}}}));
}

TYPED_TEST(Reform, KeepsIndicesBelowCount) {
  std::mt19937 random(7);
  Scene<TypeParam> scene;
  for (int i = 0; i < 300; ++i) {
    const std::uint32_t vertices = 1 + random() % 500;
    scene.add(random_triangles<TypeParam>(random, vertices, random() % 700), random_ecol<TypeParam>(random, vertices),
              1 + random() % vertices, 0);
    scene.triangle_offsets.back() = scene.triangles.size();
  }
  const auto local = scene.reform_local();
  const auto global = scene.reform();
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    for (std::uint64_t t = scene.triangle_offsets[i]; t < scene.triangle_offsets[i + 1]; ++t) {
      for (int c = 0; c < 3; ++c) {
        ASSERT_LT(local[t].v[c], scene.counts[i]);
        ASSERT_EQ(global[t].v[c], scene.vertex_offsets[i] + local[t].v[c]);
      }
    }
  }
  EXPECT_EQ(global, scene.reform_plainly());
}

TYPED_TEST(Reform, HandlesTheLargestMeshOf16BitIndices) {
  std::mt19937 random(1);
  Scene<TypeParam> scene;
  auto triangles = random_triangles<TypeParam>(random, 65536, 30000);
  triangles[0] = {{65535, 65534, 0}};
  for (const std::uint32_t count : {1u, 65535u, 65536u}) {
    scene.add(triangles, random_ecol<TypeParam>(random, 65536), count, 30000);
    scene.add({{{65535, 0, 65534}}}, chain<TypeParam>(65536), count, 1);
  }
  EXPECT_EQ(scene.reform(), scene.reform_plainly());
}

// Followed one by one these chains take 10^11 steps and more.
TYPED_TEST(Reform, EndsOnChainsAsLongAsTheMesh) {
  using Index = TypeParam;
  constexpr std::uint32_t vertices = sizeof(Index) == 2 ? 65536 : 1000000;
  const auto ecol = chain<Index>(vertices);
  std::mt19937 random(2);
  for (const std::size_t size : {std::size_t{900}, std::size_t{60000}, std::size_t{300000}}) {
    const auto triangles = random_triangles<Index>(random, vertices, size);
    for (const std::uint32_t count : {1u, 1000u, vertices - 1}) {
      pgl::host::ReformWorkspace<Index> workspace;
      Triangles<Index> out(size);
      pgl::host::reform_mesh<Index>(triangles, ecol, count, workspace, out);
      for (std::size_t t = 0; t < size; ++t) {
        for (int c = 0; c < 3; ++c) {
          ASSERT_EQ(out[t].v[c], std::min<std::uint32_t>(triangles[t].v[c], count - 1));
        }
      }
    }
  }
}

// One scene in which every way through the driver is taken: table, short chains, long chains over few and over many
// vertices, large meshes whole and cut down, more of them than there are threads.
template <class Index>
Scene<Index> all_ways() {
  std::mt19937 random(3);
  Scene<Index> scene;
  const std::uint32_t large = sizeof(Index) == 2 ? 65536 : 70000;
  for (int round = 0; round < 5; ++round) {
    for (const std::uint32_t vertices : {1u, 3u, 200u, 5000u, large}) {
      for (const std::size_t size : {std::size_t{0}, std::size_t{1}, std::size_t{40}, std::size_t{2 * vertices}}) {
        for (const bool long_chains : {false, true}) {
          const auto ecol = long_chains ? chain<Index>(vertices) : random_ecol<Index>(random, vertices);
          const std::uint32_t count = round == 0 ? vertices : 1 + random() % (1 + vertices / (round == 1 ? 1 : 20));
          scene.add(random_triangles<Index>(random, vertices, size), ecol, std::min(count, vertices), size);
        }
      }
    }
  }
  return scene;
}

TYPED_TEST(Reform, IsTheSameWhicheverWayItTakes) {
  const auto scene = all_ways<TypeParam>();
  Triangles<std::uint32_t> expected;
  // The plain loop would not end soon on the chains; there the answer is known.
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    const Mesh& mesh = scene.meshes[i];
    const bool long_chains = i % 2 == 1;
    for (std::uint64_t t = scene.triangle_offsets[i]; t < scene.triangle_offsets[i + 1]; ++t) {
      auto& triangle = expected.emplace_back();
      for (int c = 0; c < 3; ++c) {
        std::uint32_t v = scene.triangles[mesh.first_triangle + t - scene.triangle_offsets[i]].v[c];
        if (long_chains) v = std::min(v, scene.counts[i] - 1);
        while (v >= scene.counts[i]) v = scene.ecol[mesh.first_vertex + v];
        triangle.v[c] = static_cast<std::uint32_t>(scene.vertex_offsets[i] + v);
      }
    }
  }
  pgl::host::ReformWorkspace<TypeParam> workspace;
  EXPECT_EQ(scene.reform(workspace), expected);
  EXPECT_EQ(scene.reform(workspace), expected) << "with a workspace that was used before";
  auto hidden = scene;
  hidden.counts.assign(scene.counts.size(), 0);
  hidden.vertex_offsets.assign(scene.vertex_offsets.size(), 0);
  hidden.triangle_offsets.assign(scene.triangle_offsets.size(), 0);
  EXPECT_TRUE(hidden.reform(workspace).empty()) << "with a workspace that was used for another selection";
}

// The second objects show the triangles of the first again: in the block they are there twice.
TYPED_TEST(Reform, IsTheSameFromABlock) {
  auto scene = all_ways<TypeParam>();
  const std::size_t objects = scene.objects.size();
  for (std::size_t i = 0; i < objects; i += 3) {
    scene.objects.push_back(scene.objects[i]);
    if (i % 2 == 0) scene.objects.back().transform = mirror_x;
    scene.counts.push_back(scene.counts[i]);
    scene.vertex_offsets.push_back(scene.vertex_offsets.back() + scene.counts[i]);
    const std::uint64_t shown = scene.triangle_offsets[i + 1] - scene.triangle_offsets[i];
    scene.triangle_offsets.push_back(scene.triangle_offsets.back() + shown);
  }
  pgl::host::ReformWorkspace<TypeParam> workspace;
  const auto expected = scene.reform(workspace);
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 3, threads}) {
    omp_set_num_threads(n);
#else
  {
#endif
    EXPECT_EQ(scene.reform_block(workspace), expected);
  }
}

#if defined(_OPENMP)
TYPED_TEST(Reform, DoesNotDependOnTheNumberOfThreads) {
  const auto scene = all_ways<TypeParam>();
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const auto alone = scene.reform();
  pgl::host::ReformWorkspace<TypeParam> workspace;
  for (const int n : {2, 3, 8}) {
    omp_set_num_threads(n);
    EXPECT_EQ(scene.reform(workspace), alone) << n;
  }
  omp_set_num_threads(threads);
}
#endif

TYPED_TEST(Reform, AllocatesNothingOnceWarm) {
  const auto scene = all_ways<TypeParam>();
  pgl::host::ReformWorkspace<TypeParam> workspace;
  scene.reform(workspace);
  std::vector<const void*> before{workspace.postponed.data(), workspace.batch.data()};
  for (const auto& table : workspace.tables) before.push_back(table.data());
  scene.reform(workspace);
  std::vector<const void*> after{workspace.postponed.data(), workspace.batch.data()};
  for (const auto& table : workspace.tables) after.push_back(table.data());
  EXPECT_EQ(before, after);
}

TYPED_TEST(Reform, LeavesTheRestOfTheOutputAlone) {
  Scene<TypeParam> scene;
  scene.add({{{0, 1, 2}}}, chain<TypeParam>(3), 3, 1);
  pgl::host::ReformWorkspace<TypeParam> workspace;
  Triangles<std::uint32_t> out(3, {{7, 8, 9}});
  pgl::host::reform<TypeParam>(scene.meshes, scene.objects, scene.triangles, scene.ecol, scene.counts,
                               scene.vertex_offsets, scene.triangle_offsets, workspace, out);
  EXPECT_EQ(out, (Triangles<std::uint32_t>{{{0, 1, 2}}, {{7, 8, 9}}, {{7, 8, 9}}}));
}

TYPED_TEST(Reform, ReachesTheLastOf32BitVertices) {
  using Index = TypeParam;
  constexpr std::uint32_t before = 0xFFFFFFFFu - 2;  // vertices of another object, of which no triangle is left
  const std::vector<Mesh> meshes{{.max_vertices = before}, {.max_vertices = 4}};
  const std::vector<Object> objects{{.mesh = 0}, {.mesh = 1}};
  const std::vector<std::uint32_t> counts{before, 3};
  const std::vector<std::uint64_t> vertex_offsets{0, before, std::uint64_t{1} << 32};
  const std::vector<std::uint64_t> triangle_offsets{0, 0, 1};
  pgl::host::ReformWorkspace<Index> workspace;
  Triangles<std::uint32_t> out(1);
  pgl::host::reform<Index>(meshes, objects, Triangles<Index>{{{0, 1, 3}}}, chain<Index>(4), counts, vertex_offsets,
                           triangle_offsets, workspace, out);
  EXPECT_EQ(out[0], (pgl::Triangle<std::uint32_t>{{0xFFFFFFFDu, 0xFFFFFFFEu, 0xFFFFFFFFu}}));
}

TYPED_TEST(Reform, ChecksItsInputInDebugBuilds) {
  using Index = TypeParam;
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto with = [](std::vector<Index> ecol, Triangles<Index> triangles, std::uint64_t first_vertex) {
    Scene<Index> scene;
    scene.add(triangles, ecol, 2, triangles.size());
    scene.vertex_offsets[0] = first_vertex;
    return scene.reform();
  };
  const std::vector<Index> good{no_target<Index>, no_target<Index>, 1};
  EXPECT_EQ(with(good, {{{0, 1, 2}}}, 5), (Triangles<std::uint32_t>{{{5, 6, 6}}}));
  EXPECT_DEATH(with({no_target<Index>, no_target<Index>, 2}, {{{0, 1, 2}}}, 0), "ecol");
  EXPECT_DEATH(with({no_target<Index>, no_target<Index>, no_target<Index>}, {{{0, 1, 2}}}, 0), "ecol");
  EXPECT_DEATH(with(good, {{{0, 1, 3}}}, 0), "vertices");
  EXPECT_DEATH(with(good, {{{0, 1, 2}}}, 0xFFFFFFFFu), "max");
  // A block may be shorter than the triangles of the meshes, but not than the selection.
  Scene<Index> scene;
  scene.add({{{0, 1, 2}}, {{2, 1, 0}}}, good, 3, 2);
  scene.add({{{0, 1, 2}}, {{2, 1, 0}}}, good, 3, 1);
  const auto from_block_of = [&](std::size_t size) {
    pgl::host::ReformWorkspace<Index> workspace;
    Triangles<std::uint32_t> out(3);
    pgl::host::reform_block<Index>(scene.meshes, scene.objects, Triangles<Index>(size), scene.ecol, scene.counts,
                                   scene.vertex_offsets, scene.triangle_offsets, workspace, out);
    return out[2];
  };
  EXPECT_EQ(from_block_of(3), (pgl::Triangle<std::uint32_t>{{3, 3, 3}}));
  EXPECT_DEATH(from_block_of(2), "triangles");
}

TEST(Mirrored, IsTheSignOfTheDeterminant) {
  EXPECT_FALSE(pgl::mirrored(glm::mat4x3(1.0f)));
  EXPECT_TRUE(pgl::mirrored(glm::mat4x3(-1.0f)));
  EXPECT_TRUE(pgl::mirrored(mirror_x));
  const auto scaled = [](float x, float y, float z) {
    return pgl::mirrored({glm::vec3(x, 0, 0), glm::vec3(0, y, 0), glm::vec3(0, 0, z), glm::vec3(9, 9, 9)});
  };
  EXPECT_FALSE(scaled(-1, -1, 1));
  EXPECT_TRUE(scaled(-1e-45f, 1e-45f, 1e-45f));
  EXPECT_FALSE(scaled(1e-45f, 1e-45f, 1e-45f));
  EXPECT_TRUE(scaled(-3e38f, -3e38f, -3e38f));
  EXPECT_TRUE(scaled(3e38f, -1e-45f, 3e38f));
  // Two axes swapped.
  EXPECT_TRUE(pgl::mirrored({glm::vec3(0, 1, 0), glm::vec3(1, 0, 0), glm::vec3(0, 0, 1), glm::vec3(0)}));
}

TEST(Mirrored, IsFalseForASingularTransform) {
  EXPECT_FALSE(pgl::mirrored(glm::mat4x3(0.0f)));
  EXPECT_FALSE(pgl::mirrored(glm::mat4x3(-0.0f)));
  EXPECT_FALSE(pgl::mirrored({glm::vec3(1, 2, 3), glm::vec3(4, 5, 6), glm::vec3(7, 8, 9), glm::vec3(0)}));
  EXPECT_FALSE(
      pgl::mirrored({glm::vec3(.1f, .7f, .3f), glm::vec3(-.2f, -1.4f, -.6f), glm::vec3(3, 8, 5), glm::vec3(0)}));
}

TEST(Mirrored, SeesWhatDoubleCannot) {
  // det = +-(2^24-1)^2 * something below the rounding of the large products: rows that differ in the last place only.
  const float a = 16777215.0f, b = 16777214.0f, c = 16777213.0f;
  const auto with = [&](float last) {
    return pgl::mirrored(
        {glm::vec3(a, b, 1e-30f), glm::vec3(b, c, 0), glm::vec3(a * 0x1p40f, b * 0x1p40f, last), glm::vec3(0)});
  };
  // (a c - b b) = -1, so the determinant is -last + 2^40 * 1e-30f * (b b - a c) = 2^40 * 1e-30f - last.
  EXPECT_FALSE(with(0x1p40f * 1e-30f));
  EXPECT_TRUE(with(std::nextafter(0x1p40f * 1e-30f, 1.0f)));
  EXPECT_FALSE(with(std::nextafter(0x1p40f * 1e-30f, 0.0f)));
}

TEST(Mirrored, IsFalseForNonFiniteEntries) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                          -std::numeric_limits<float>::infinity()}) {
    for (int column = 0; column < 3; ++column) {
      for (int row = 0; row < 3; ++row) {
        for (const float diagonal : {-1.0f, 1.0f}) {
          for (const float rest : {0.0f, 0.5f}) {
            glm::mat4x3 m{glm::vec3(rest), glm::vec3(rest), glm::vec3(rest), glm::vec3(rest)};
            for (int i = 0; i < 3; ++i) m[i][i] = diagonal;
            m[column][row] = bad;
            EXPECT_FALSE(pgl::mirrored(m));
          }
        }
      }
    }
    EXPECT_FALSE(pgl::mirrored({glm::vec3(bad, 0, 0), glm::vec3(0, -1, 1), glm::vec3(0, 1, 1), glm::vec3(0)}));
    EXPECT_FALSE(pgl::mirrored({glm::vec3(bad, 1, 1), glm::vec3(1, -1, 1), glm::vec3(1, 1, 1), glm::vec3(0)}));
    glm::mat4x3 moved = mirror_x;
    moved[3] = glm::vec3(bad);
    EXPECT_TRUE(pgl::mirrored(moved)) << "the translation does not matter";
  }
}

}  // namespace
