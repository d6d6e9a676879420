// SPDX-License-Identifier: MIT
// Unit tests of splitting into connected components.
#include "scene/components.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace {

using pgl::scene::MeshData;
using pgl::scene::split_components;
using Corners = pgl::Triangle<std::uint32_t>;

TEST(Components, GiveNothingForAMeshWithoutTriangles) {
  EXPECT_TRUE(split_components({}).empty());
  EXPECT_TRUE(split_components({{{1, 2, 3}}, {}}).empty());
}

TEST(Components, KeepAConnectedMeshAsItIs) {
  const MeshData mesh{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {{{3, 1, 2}}, {{0, 1, 2}}}};
  const auto parts = split_components(mesh);
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(parts[0].positions, mesh.positions);
  EXPECT_EQ(parts[0].triangles, mesh.triangles);
}

TEST(Components, ComeInTheOrderOfTheirFirstTriangle) {
  // The first triangle uses the last vertices; vertex 3 is isolated.
  const MeshData mesh{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}, {5, 0, 0}, {6, 0, 0}},
                      {{{6, 5, 4}}, {{0, 1, 2}}, {{4, 5, 6}}}};
  const auto parts = split_components(mesh);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].positions, (std::vector<glm::vec3>{{4, 0, 0}, {5, 0, 0}, {6, 0, 0}}));
  EXPECT_EQ(parts[0].triangles, (std::vector<Corners>{{{2, 1, 0}}, {{0, 1, 2}}}));
  EXPECT_EQ(parts[1].positions, (std::vector<glm::vec3>{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}));
  EXPECT_EQ(parts[1].triangles, (std::vector<Corners>{{{0, 1, 2}}}));
}

TEST(Components, StayTogetherAtASingleSharedVertex) {
  const MeshData mesh{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}}, {{{0, 1, 2}}, {{2, 3, 4}}}};
  EXPECT_EQ(split_components(mesh).size(), 1u);
}

TEST(Components, AreJoinedByALaterTriangle) {
  const MeshData mesh{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}, {5, 0, 0}},
                      {{{0, 1, 2}}, {{3, 4, 5}}, {{5, 2, 0}}}};
  const auto parts = split_components(mesh);
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(parts[0].triangles, mesh.triangles);
}

TEST(Components, GoByIndexNotByPosition) {
  const MeshData mesh{{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, {{{0, 1, 2}}, {{3, 4, 5}}}};
  EXPECT_EQ(split_components(mesh).size(), 2u);
}

TEST(Components, AcceptDegenerateTriangles) {
  const MeshData mesh{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{{1, 1, 1}}, {{0, 2, 2}}}};
  const auto parts = split_components(mesh);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].positions, (std::vector<glm::vec3>{{1, 0, 0}}));
  EXPECT_EQ(parts[0].triangles, (std::vector<Corners>{{{0, 0, 0}}}));
  EXPECT_EQ(parts[1].triangles, (std::vector<Corners>{{{0, 1, 1}}}));
}

TEST(Components, FollowALongStripFromEitherEnd) {
  constexpr std::uint32_t n = 300'000;
  MeshData mesh;
  mesh.positions.resize(n);
  for (std::uint32_t v = 0; v + 2 < n; ++v) mesh.triangles.push_back({{v, v + 1, v + 2}});
  EXPECT_EQ(split_components(mesh).size(), 1u);
  std::reverse(mesh.triangles.begin(), mesh.triangles.end());
  EXPECT_EQ(split_components(mesh).size(), 1u);
}

}  // namespace
