// SPDX-License-Identifier: MIT
#include "pgl/host/rearrange.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <random>
#include <tuple>
#include <vector>

namespace {

using pgl::no_target;
template <class Index>
using Triangles = std::vector<pgl::Triangle<Index>>;

template <class Index>
class Rearrange : public testing::Test {};
using Indices = testing::Types<std::uint16_t, std::uint32_t>;
TYPED_TEST_SUITE(Rearrange, Indices);

TYPED_TEST(Rearrange, MovesEverythingToItsNewPlace) {
  using Index = TypeParam;
  // A square 0 1 2 3 with a middle 4: 4 merges into 1, then 1 into 3.
  const std::vector<char> vertices{'a', 'b', 'c', 'd', 'e'};
  const Triangles<Index> triangles{{{0, 1, 4}}, {{1, 2, 4}}, {{2, 3, 4}}, {{3, 0, 4}}};
  const std::vector<Index> ecol{no_target<Index>, 3, no_target<Index>, no_target<Index>, 1};
  const std::vector<Index> permute_v{1, 3, 0, 2, 4};
  const std::vector<std::uint32_t> permute_t{3, 2, 0, 1};
  std::vector<char> out_vertices(5);
  Triangles<Index> out_triangles(4);
  std::vector<Index> out_ecol(5);

  pgl::host::rearrange<char, Index>(vertices, triangles, ecol, permute_v, permute_t, out_vertices, out_triangles,
                                    out_ecol);

  EXPECT_EQ(out_vertices, (std::vector<char>{'c', 'a', 'd', 'b', 'e'}));
  EXPECT_EQ(out_triangles, (Triangles<Index>{{{0, 2, 4}}, {{2, 1, 4}}, {{3, 0, 4}}, {{1, 3, 4}}}));
  EXPECT_EQ(out_ecol, (std::vector<Index>{no_target<Index>, no_target<Index>, no_target<Index>, 2, 3}));
}

// Meshes in any order with gaps between them, of no, few and more elements than a thread takes.
TYPED_TEST(Rearrange, MovesEachMeshOfABatchAndNothingElse) {
  using Index = TypeParam;
  const std::vector<std::uint32_t> sizes{3, 0, 1, 40000, 310, 50000, 2, 1};
  std::mt19937 random(1);
  std::vector<pgl::MeshRange> meshes;
  std::uint64_t vertex = 2, triangle = 5;
  for (const std::uint32_t size : sizes) {
    meshes.push_back({.first_vertex = vertex, .first_triangle = triangle, .vertices = size, .triangles = 3 * size / 2});
    vertex += size + random() % 3;
    triangle += meshes.back().triangles + random() % 3;
  }
  std::ranges::reverse(meshes);
  std::vector<int> vertices(vertex + 1);
  std::vector<Index> ecol(vertex + 1), permute_v(vertex + 1);
  std::vector<std::uint32_t> permute_t(triangle + 1);
  Triangles<Index> triangles(triangle + 1);
  std::iota(vertices.begin(), vertices.end(), 0);
  for (const auto& mesh : meshes) {
    const auto places = permute_v.begin() + static_cast<std::ptrdiff_t>(mesh.first_vertex);
    std::iota(places, places + mesh.vertices, Index{0});
    std::shuffle(places, places + mesh.vertices, random);
    const auto moved = permute_t.begin() + static_cast<std::ptrdiff_t>(mesh.first_triangle);
    std::iota(moved, moved + mesh.triangles, 0u);
    std::shuffle(moved, moved + mesh.triangles, random);
    for (std::uint32_t v = 0; v < mesh.vertices; ++v) {
      ecol[mesh.first_vertex + v] = random() % 4 == 0 ? no_target<Index> : static_cast<Index>(random() % mesh.vertices);
    }
    for (std::uint32_t t = 0; t < mesh.triangles; ++t) {
      for (Index& v : triangles[mesh.first_triangle + t].v) v = static_cast<Index>(random() % mesh.vertices);
    }
  }

  std::vector<int> out_vertices(vertex + 1, -1), expected_vertices(vertex + 1, -1);
  std::vector<Index> out_ecol(vertex + 1, 7), expected_ecol(vertex + 1, 7);
  Triangles<Index> out_triangles(triangle + 1, {{9, 9, 9}}), expected_triangles(triangle + 1, {{9, 9, 9}});
  for (const auto& mesh : meshes) {
    const auto renamed = [&](Index v) { return v == no_target<Index> ? v : permute_v[mesh.first_vertex + v]; };
    for (std::uint64_t v = mesh.first_vertex; v < mesh.first_vertex + mesh.vertices; ++v) {
      expected_vertices[mesh.first_vertex + permute_v[v]] = vertices[v];
      expected_ecol[mesh.first_vertex + permute_v[v]] = renamed(ecol[v]);
    }
    for (std::uint64_t t = mesh.first_triangle; t < mesh.first_triangle + mesh.triangles; ++t) {
      const auto& v = triangles[t].v;
      expected_triangles[mesh.first_triangle + permute_t[t]] = {{renamed(v[0]), renamed(v[1]), renamed(v[2])}};
    }
  }
  pgl::host::rearrange<int, Index>(meshes, vertices, triangles, ecol, permute_v, permute_t, out_vertices, out_triangles,
                                   out_ecol);
  EXPECT_EQ(out_vertices, expected_vertices);
  EXPECT_EQ(out_ecol, expected_ecol);
  EXPECT_EQ(out_triangles, expected_triangles);
}

TYPED_TEST(Rearrange, AcceptsAnEmptyBatch) {
  using Index = TypeParam;
  const std::vector<int> vertices{1};
  const std::vector<Index> ecol{no_target<Index>}, permute_v{0};
  std::vector<int> out_vertices{5};
  std::vector<Index> out_ecol{6};
  const std::vector<pgl::MeshRange> empty(3);
  for (const auto& meshes : {std::vector<pgl::MeshRange>{}, empty}) {
    pgl::host::rearrange<int, Index>(meshes, vertices, {}, ecol, permute_v, {}, out_vertices, {}, out_ecol);
    EXPECT_EQ(out_vertices[0], 5);
    EXPECT_EQ(out_ecol[0], 6);
  }
}

TYPED_TEST(Rearrange, ChecksTheRangesOfABatchInDebugBuilds) {
  using Index = TypeParam;
  const std::vector<int> vertices{1};
  const std::vector<Index> ecol{no_target<Index>}, permute_v{0};
  std::vector<int> out_vertices(1);
  std::vector<Index> out_ecol(1);
  const std::vector<pgl::MeshRange> meshes{{.vertices = 2}};
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(
      (pgl::host::rearrange<int, Index>(meshes, vertices, {}, ecol, permute_v, {}, out_vertices, {}, out_ecol)),
      "first_vertex");
}

TYPED_TEST(Rearrange, AcceptsAnEmptyMesh) {
  using Index = TypeParam;
  pgl::host::rearrange<float, Index>({}, {}, {}, {}, {}, {}, {}, {});
}

TYPED_TEST(Rearrange, AcceptsOneVertexWithADegenerateTriangle) {
  using Index = TypeParam;
  const std::vector<double> vertices{7.0};
  const Triangles<Index> triangles{{{0, 0, 0}}};
  const std::vector<Index> ecol{no_target<Index>};
  const std::vector<Index> permute_v{0};
  const std::vector<std::uint32_t> permute_t{0};
  std::vector<double> out_vertices(1);
  Triangles<Index> out_triangles(1, {{9, 9, 9}});
  std::vector<Index> out_ecol(1);
  pgl::host::rearrange<double, Index>(vertices, triangles, ecol, permute_v, permute_t, out_vertices, out_triangles,
                                      out_ecol);
  EXPECT_EQ(out_vertices, vertices);
  EXPECT_EQ(out_triangles, triangles);
  EXPECT_EQ(out_ecol, ecol);
}

TYPED_TEST(Rearrange, ReversesTheLargestMeshOf16BitIndices) {
  using Index = TypeParam;
  constexpr std::uint32_t n = 65536;
  std::vector<std::uint32_t> vertices(n);
  std::vector<Index> ecol(n), permute_v(n), out_ecol(n);
  std::vector<std::uint32_t> permute_t(n), out_vertices(n);
  Triangles<Index> triangles(n), out_triangles(n);
  for (std::uint32_t v = 0; v < n; ++v) {
    vertices[v] = v;
    ecol[v] = v + 2 < n ? static_cast<Index>(v + 1) : no_target<Index>;
    permute_v[v] = static_cast<Index>(n - 1 - v);
    permute_t[v] = n - 1 - v;
    triangles[v] = {{static_cast<Index>(v), 0, static_cast<Index>(n - 1)}};
  }
  pgl::host::rearrange<std::uint32_t, Index>(vertices, triangles, ecol, permute_v, permute_t, out_vertices,
                                             out_triangles, out_ecol);
  EXPECT_EQ(out_ecol[0], no_target<Index>);
  EXPECT_EQ(out_ecol[1], no_target<Index>);
  for (std::uint32_t v = 0; v < n; ++v) {
    ASSERT_EQ(out_vertices[v], n - 1 - v);
    ASSERT_EQ(out_ecol[v], v > 1 ? static_cast<Index>(v - 1) : no_target<Index>);
    ASSERT_EQ(out_triangles[v], (pgl::Triangle<Index>{{static_cast<Index>(v), static_cast<Index>(n - 1), 0}}));
  }
}

TYPED_TEST(Rearrange, LeavesItsInputUnchanged) {
  using Index = TypeParam;
  const std::vector<int> vertices{1, 2, 3};
  const Triangles<Index> triangles{{{0, 1, 2}}};
  const std::vector<Index> ecol{2, no_target<Index>, 1};
  const std::vector<Index> permute_v{2, 0, 1};
  const std::vector<std::uint32_t> permute_t{0};
  auto copies = std::tuple(vertices, triangles, ecol, permute_v, permute_t);
  std::vector<int> out_vertices(3);
  Triangles<Index> out_triangles(1);
  std::vector<Index> out_ecol(3);
  pgl::host::rearrange<int, Index>(vertices, triangles, ecol, permute_v, permute_t, out_vertices, out_triangles,
                                   out_ecol);
  EXPECT_EQ(copies, std::tie(vertices, triangles, ecol, permute_v, permute_t));
}

TYPED_TEST(Rearrange, ChecksPlacesInDebugBuilds) {
  using Index = TypeParam;
  const std::vector<int> vertices{1};
  const std::vector<Index> ecol{no_target<Index>};
  const std::vector<Index> permute_v{1};
  std::vector<int> out_vertices(1);
  std::vector<Index> out_ecol(1);
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH((pgl::host::rearrange<int, Index>(vertices, {}, ecol, permute_v, {}, out_vertices, {}, out_ecol)),
               "permute_v");
}

TYPED_TEST(Rearrange, KnowsAPermutation) {
  using Index = TypeParam;
  const auto is = [](std::vector<Index> p) { return pgl::host::is_permutation<Index>(p); };
  EXPECT_TRUE(is({}));
  EXPECT_TRUE(is({0}));
  EXPECT_TRUE(is({2, 0, 1}));
  EXPECT_FALSE(is({1}));
  EXPECT_FALSE(is({0, 0}));
  EXPECT_FALSE(is({0, 1, 3}));
  EXPECT_FALSE(is({0, no_target<Index>}));
  std::vector<Index> all(65536);
  std::iota(all.begin(), all.end(), Index{0});
  EXPECT_TRUE(is(all));
  all[5] = 4;
  EXPECT_FALSE(is(all));
}

}  // namespace
