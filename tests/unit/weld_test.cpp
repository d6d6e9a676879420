// SPDX-License-Identifier: MIT
// Unit tests of vertex welding.
#include "scene/weld.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

namespace {

using pgl::scene::MeshData;
using pgl::scene::weld;
using Corners = pgl::Triangle<std::uint32_t>;

std::uint32_t bits(float x) {
  return std::bit_cast<std::uint32_t>(x);
}

TEST(Weld, LeavesAnEmptyMeshEmpty) {
  MeshData mesh;
  const auto counts = weld(mesh);
  EXPECT_TRUE(mesh.positions.empty());
  EXPECT_TRUE(mesh.triangles.empty());
  EXPECT_EQ(counts.merged + counts.unreferenced + counts.degenerate, 0u);
}

TEST(Weld, DropsEveryVertexOfAMeshWithoutTriangles) {
  MeshData mesh{{{1, 2, 3}, {1, 2, 3}}, {}};
  EXPECT_EQ(weld(mesh).unreferenced, 2u);
  EXPECT_TRUE(mesh.positions.empty());
}

TEST(Weld, JoinsTheCornersOfASoup) {
  MeshData mesh{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{{0, 1, 2}}, {{3, 4, 5}}}};
  const auto counts = weld(mesh);
  EXPECT_EQ(counts.merged, 2u);
  EXPECT_EQ(counts.unreferenced, 0u);
  EXPECT_EQ(counts.degenerate, 0u);
  EXPECT_EQ(mesh.positions, (std::vector<glm::vec3>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}));
  EXPECT_EQ(mesh.triangles, (std::vector<Corners>{{{0, 1, 2}}, {{1, 3, 2}}}));
}

TEST(Weld, KeepsTheOrderOfFirstReferencedOccurrence) {
  // Vertex 0 is unused although its position is used, through vertex 3.
  MeshData mesh{{{9, 9, 9}, {2, 0, 0}, {1, 0, 0}, {9, 9, 9}}, {{{3, 2, 1}}}};
  const auto counts = weld(mesh);
  EXPECT_EQ(counts.unreferenced, 1u);
  EXPECT_EQ(mesh.positions, (std::vector<glm::vec3>{{2, 0, 0}, {1, 0, 0}, {9, 9, 9}}));
  EXPECT_EQ(mesh.triangles, (std::vector<Corners>{{{2, 1, 0}}}));
}

TEST(Weld, TakesNegativeZeroForZero) {
  MeshData mesh{{{-0.0f, 0, 1}, {0, -0.0f, 1}, {5, 0, 1}}, {{{0, 1, 2}}}};
  const auto counts = weld(mesh);
  EXPECT_EQ(counts.merged, 1u);
  EXPECT_EQ(counts.degenerate, 1u);
  ASSERT_EQ(mesh.positions.size(), 2u);
  EXPECT_EQ(bits(mesh.positions[0].x), 0u);
  EXPECT_EQ(bits(mesh.positions[0].y), 0u);
  EXPECT_EQ(mesh.triangles, (std::vector<Corners>{{{0, 0, 1}}}));
}

TEST(Weld, TellsNeighbouringFloatsApart) {
  const float next = std::bit_cast<float>(bits(1.0f) + 1), denormal = std::numeric_limits<float>::denorm_min();
  MeshData mesh{{{1, 1, 1}, {1, 1, next}, {1, next, 1}, {next, 1, 1}, {0, 0, denormal}, {0, 0, 0}},
                {{{0, 1, 2}}, {{3, 4, 5}}}};
  const MeshData before = mesh;
  EXPECT_EQ(weld(mesh).merged, 0u);
  EXPECT_EQ(mesh.positions, before.positions);
  EXPECT_EQ(mesh.triangles, before.triangles);
}

TEST(Weld, KeepsSwappedCoordinatesApart) {
  MeshData mesh{{{1, 2, 3}, {2, 1, 3}, {3, 2, 1}, {1, 3, 2}, {2, 3, 1}, {3, 1, 2}}, {{{0, 1, 2}}, {{3, 4, 5}}}};
  EXPECT_EQ(weld(mesh).merged, 0u);
}

TEST(Weld, MergesNonFinitePositionsOfEqualBits) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  MeshData mesh{{{nan, 0, 0}, {nan, 0, 0}, {inf, 0, 0}, {-inf, 0, 0}, {inf, 0, 0}}, {{{0, 1, 2}}, {{3, 4, 0}}}};
  EXPECT_EQ(weld(mesh).merged, 2u);
  EXPECT_EQ(mesh.positions.size(), 3u);
}

TEST(Weld, KeepsDuplicateAndDegenerateTriangles) {
  MeshData mesh{{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {1, 0, 0}}, {{{0, 1, 2}}, {{0, 1, 2}}, {{0, 3, 3}}}};
  const auto counts = weld(mesh);
  EXPECT_EQ(counts.degenerate, 3u);
  EXPECT_EQ(mesh.triangles, (std::vector<Corners>{{{0, 0, 0}}, {{0, 0, 0}}, {{0, 1, 1}}}));
}

TEST(Weld, JoinsAMillionCornersAtOnePlace) {
  MeshData mesh;
  mesh.positions.assign(1'000'000, {3, 4, 5});
  for (std::uint32_t v = 0; v + 2 < 1'000'000; v += 3) mesh.triangles.push_back({{v, v + 1, v + 2}});
  mesh.triangles.push_back({{999'999, 0, 1}});
  EXPECT_EQ(weld(mesh).merged, 999'999u);
  EXPECT_EQ(mesh.positions.size(), 1u);
}

}  // namespace
