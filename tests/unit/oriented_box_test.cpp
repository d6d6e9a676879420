// SPDX-License-Identifier: MIT
#include "pgl/host/oriented_box.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "support/box_shapes.hpp"

namespace {

using pgl::OrientedBox;
using test::Axes;
using test::Corners;
using test::TriangleMesh;

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float inf = std::numeric_limits<float>::infinity();

struct Found {
  OrientedBox box;
  float compactness = -1;
};

Found find(const TriangleMesh& mesh) {
  test::MeshArrays arrays;
  arrays.add(mesh);
  Found found;
  pgl::host::oriented_boxes<std::uint32_t>(arrays.meshes, arrays.vertices, arrays.triangles, arrays.map,
                                           {&found.box, 1}, {&found.compactness, 1});
  return found;
}

TEST(OrientedBox, OfAnUprightBoxIsThatBoxExactly) {
  TriangleMesh mesh = test::box_mesh(1, 4, 0.25f, 1);
  for (glm::vec3& p : mesh.positions) p += glm::vec3(8, -16, 3);
  const Found found = find(mesh);
  EXPECT_EQ(found.box.centre, glm::vec3(8, -16, 3));
  EXPECT_EQ(found.box.half, glm::vec3(4, 1, 0.25f));  // longest first
  EXPECT_EQ(glm::abs(found.box.axes[0]), glm::vec3(0, 1, 0));
  EXPECT_EQ(glm::abs(found.box.axes[1]), glm::vec3(1, 0, 0));
  EXPECT_EQ(glm::abs(found.box.axes[2]), glm::vec3(0, 0, 1));
  EXPECT_EQ(glm::cross(found.box.axes[0], found.box.axes[1]), found.box.axes[2]);
  EXPECT_EQ(found.compactness, 1.0f);
}

TEST(OrientedBox, OfARotatedBoxIsThatBoxUpToRounding) {
  std::mt19937 rng(1);
  const glm::vec3 sizes[] = {{1, 1, 1}, {5, 1, 0.1f}, {9, 8, 7}, {100, 1, 1}, {3, 3, 0.01f}, {1000, 10, 0.5f}};
  for (const glm::vec3& half : sizes)
    for (int level = 0; level < 3; ++level)
      for (int i = 0; i < 20; ++i) {
        const Axes rows = test::random_axes(rng);
        const glm::dvec3 shift = i % 2 == 0 ? glm::dvec3(0) : glm::dvec3(3, -7, 11);
        const Found found = find(test::rotated(test::box_mesh(half.x, half.y, half.z, level), rows, shift));
        const float rounding = 4e-6f * (half.x + (i % 2 == 0 ? 0.0f : 14.0f));
        for (int k = 0; k < 3; ++k) {
          EXPECT_NEAR(found.box.half[k], half[k], rounding);
          EXPECT_NEAR(found.box.centre[k], shift[k], rounding);
        }
        EXPECT_NEAR(found.compactness, 1.0f, 4 * rounding / half.z + 1e-6f);
      }
}

TEST(OrientedBox, OfAPartWithCutEdgesIsFlushWithItsFaces) {
  std::mt19937 rng(7);
  for (const glm::vec3& half : {glm::vec3(4, 2, 1), glm::vec3(5, 4, 3), glm::vec3(20, 2, 0.5f)})
    for (int i = 0; i < 20; ++i) {
      const TriangleMesh mesh = test::rotated(test::chamfered_box(half, half.z / 8), test::random_axes(rng));
      const OrientedBox box = find(mesh).box;
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(box.half[k], half[k], 4e-6f * half.x);
    }
}

TEST(OrientedBox, IsAtMost15PercentLargerThanTheLeastOnTheTestShapes) {
  std::mt19937 rng(2);
  for (const test::NamedMesh& shape : test::box_shapes()) {
    const double least = test::least_surface(shape.mesh.positions, rng);
    double worst = 0;
    for (int i = 0; i < 16; ++i)
      worst = std::max(worst, pgl::surface_area(find(test::rotated(shape.mesh, test::random_axes(rng))).box) / least);
    EXPECT_LE(worst, 1.15) << shape.name;
    EXPECT_GE(worst, 0.999) << shape.name;  // else it is not the least
  }
}

TEST(OrientedBox, OfNoFiniteVertexIsEmpty) {
  EXPECT_TRUE(pgl::is_empty(OrientedBox{}));
  for (const std::vector<glm::vec3>& positions :
       {std::vector<glm::vec3>{}, {{nan, 0, 0}}, {{0, inf, 0}, {0, 0, -inf}, {nan, nan, nan}}}) {
    TriangleMesh mesh{positions, {}};
    if (!positions.empty()) mesh.triangles.push_back({{0, 0, 0}});
    const Found found = find(mesh);
    EXPECT_EQ(found.box, OrientedBox{});
    EXPECT_EQ(found.compactness, 0.0f);
    EXPECT_EQ(pgl::surface_area(found.box), 0.0);
  }
}

TEST(OrientedBox, OfOnePointIsThatPoint) {
  for (const glm::vec3 p : {glm::vec3(0), glm::vec3(3, -4, 5), glm::vec3(1e30f, -1e-30f, 7)}) {
    const Found found = find({{p, p, p}, {{{0, 1, 2}}}});
    EXPECT_EQ(found.box.centre, p);
    EXPECT_EQ(found.box.half, glm::vec3(0));
    EXPECT_EQ(found.compactness, 0.0f);
  }
}

TEST(OrientedBox, OfALineLiesAlongIt) {
  for (const glm::vec3 d : {glm::vec3(1, 0, 0), glm::vec3(0, 0, -1), glm::vec3(1, 2, -3), glm::vec3(1, 1, 1)}) {
    TriangleMesh line;
    for (int i = -5; i <= 5; ++i) line.positions.push_back(d * static_cast<float>(i) + glm::vec3(1, 2, 3));
    line.triangles = {{{0, 5, 9}}, {{1, 2, 3}}};
    const Found found = find(line);
    const float length = glm::length(d);
    EXPECT_NEAR(found.box.half.x, 5 * length, 1e-5f * length);
    EXPECT_LE(found.box.half.y, 1e-5f * length);
    EXPECT_NEAR(std::abs(glm::dot(found.box.axes[0], d)), length, 1e-5f * length);
    EXPECT_EQ(found.compactness, 0.0f);
  }
}

TEST(OrientedBox, IgnoresVerticesThatAreNotFinite) {
  std::mt19937 rng(3);
  TriangleMesh mesh = test::rotated(test::box_mesh(3, 2, 1), test::random_axes(rng));
  const Found clean = find(mesh);
  for (const glm::vec3 bad : {glm::vec3(nan, 0, 0), glm::vec3(0, inf, 0), glm::vec3(-inf)}) {
    mesh.positions.push_back(bad);
    mesh.triangles.push_back({{0, 1, mesh.vertex_count() - 1}});  // counts as nothing
  }
  const Found found = find(mesh);
  EXPECT_EQ(found.box, clean.box);
  EXPECT_NEAR(found.compactness, clean.compactness, 1e-7f);
}

TEST(OrientedBox, OfAMeshScaledByAPowerOfTwoIsScaledExactly) {
  std::mt19937 rng(4);
  for (const test::NamedMesh& shape : test::box_shapes()) {
    const TriangleMesh mesh = test::rotated(shape.mesh, test::random_axes(rng), {0.3, 1, -2});
    const Found found = find(mesh);
    for (const float scale : {0x1p-60f, 0x1p-20f, 8.0f, 0x1p30f, 0x1p100f}) {
      TriangleMesh other = mesh;
      for (glm::vec3& p : other.positions) p *= scale;
      const Found scaled = find(other);
      EXPECT_EQ(scaled.box.centre, found.box.centre * scale) << shape.name;
      EXPECT_EQ(scaled.box.half, found.box.half * scale) << shape.name;
      for (int k = 0; k < 3; ++k) EXPECT_EQ(scaled.box.axes[k], found.box.axes[k]) << shape.name;
      EXPECT_EQ(scaled.compactness, found.compactness) << shape.name;
    }
  }
}

TEST(OrientedBox, SurvivesTheEndsOfTheFloatRange) {
  const float most = std::numeric_limits<float>::max(), least = std::numeric_limits<float>::denorm_min();
  const Found huge = find(test::box_mesh(most, most, most));
  EXPECT_EQ(huge.box.centre, glm::vec3(0));
  EXPECT_EQ(huge.box.half, glm::vec3(most));
  EXPECT_EQ(huge.compactness, 1.0f);
  const Found tiny = find(test::box_mesh(least, 2 * least, 3 * least));
  EXPECT_EQ(tiny.box.half, glm::vec3(3 * least, 2 * least, least));
  EXPECT_EQ(tiny.compactness, 1.0f);
  // A diagonal of the greatest cube is longer than any float.
  const Found diagonal = find({{{-most, -most, -most}, {most, most, most}}, {}});
  EXPECT_EQ(diagonal.box.half.x, inf);
  EXPECT_EQ(diagonal.compactness, 0.0f);
}

TEST(Compactness, IsTheAreaOverTheSurfaceOfTheBox) {
  EXPECT_NEAR(find(test::sphere(4)).compactness, std::numbers::pi / 6, 0.01);
  EXPECT_NEAR(find(test::tetrahedron()).compactness, 1 / std::sqrt(3.0), 0.01);  // in a cube, up to the search
  TriangleMesh open = test::box_mesh(1, 1, 1);
  open.triangles.resize(10);  // one face is missing
  EXPECT_NEAR(find(open).compactness, 5.0 / 6, 1e-6);
  TriangleMesh twice = test::box_mesh(1, 1, 1);
  twice.triangles.insert(twice.triangles.end(), twice.triangles.begin(), twice.triangles.end());
  EXPECT_EQ(find(twice).compactness, 1.0f);  // never more
  EXPECT_EQ(find({test::sphere(1).positions, {}}).compactness, 0.0f);
}

TEST(Compactness, OfASheetCountsBothItsSides) {
  std::mt19937 rng(5);
  EXPECT_EQ(find(test::grid(7, 3)).compactness, 1.0f);
  for (int i = 0; i < 20; ++i)
    EXPECT_NEAR(find(test::rotated(test::grid(7, 3), test::random_axes(rng), {40, 50, 60})).compactness, 1.0f, 1e-4f);
  TriangleMesh half = test::grid(2, 1);
  half.triangles.resize(2);  // of two squares, one
  EXPECT_NEAR(find(half).compactness, 0.5f, 1e-6f);
}

TEST(Compactness, OfManySmallTrianglesLosesNothing) {
  const TriangleMesh fine = test::box_mesh(1, 0.7f, 0.01f, 6);
  EXPECT_EQ(fine.triangle_count(), 12u << 12);
  EXPECT_NEAR(find(fine).compactness, 1.0f, 1e-6f);
}

TEST(OrientedBoxes, OfPartsAreThoseOfTheWholeAndOf16BitIndicesToo) {
  test::MeshArrays arrays;
  for (const test::NamedMesh& shape : test::box_shapes()) arrays.add(shape.mesh);
  arrays.add({});
  const std::size_t n = arrays.size();
  std::vector<OrientedBox> boxes(n), again(n);
  std::vector<float> compactness(n), compactness_again(n);
  pgl::host::oriented_boxes<std::uint32_t>(arrays.meshes, arrays.vertices, arrays.triangles, arrays.map, boxes,
                                           compactness);
  std::vector<pgl::Triangle<std::uint16_t>> narrow;
  for (const Corners& t : arrays.triangles)
    narrow.push_back(
        {{static_cast<std::uint16_t>(t.v[0]), static_cast<std::uint16_t>(t.v[1]), static_cast<std::uint16_t>(t.v[2])}});
  const std::size_t middle = n / 3;
  for (const auto& [begin, size] : {std::pair{std::size_t{0}, middle}, std::pair{middle, n - middle}})
    pgl::host::oriented_boxes<std::uint16_t>(std::span(arrays.meshes).subspan(begin, size), arrays.vertices, narrow,
                                             arrays.map, std::span(again).subspan(begin, size),
                                             std::span(compactness_again).subspan(begin, size));
  EXPECT_EQ(boxes, again);
  EXPECT_EQ(compactness, compactness_again);
}

}  // namespace
