// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "pgl/host/bounds.hpp"
#include "pgl/host/oriented_box.hpp"
#include "support/box_shapes.hpp"
#include "support/exact.hpp"
#include "support/random_mesh.hpp"

namespace {

using exact::Number;
using pgl::OrientedBox;

struct Found {
  OrientedBox box;
  float compactness = -1;
};
Found find(const test::TriangleMesh& mesh) {
  test::MeshArrays arrays;
  arrays.add(mesh);
  Found found;
  pgl::host::oriented_boxes<std::uint32_t>(arrays.meshes, arrays.vertices, arrays.triangles, arrays.map,
                                           {&found.box, 1}, {&found.compactness, 1});
  return found;
}

bool is_finite(const glm::vec3& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

/// |axis . (p - centre)|, exactly.
Number distance(const OrientedBox& box, int k, const glm::vec3& p) {
  Number sum = 0;
  for (int i = 0; i < 3; ++i) sum += Number(box.axes[k][i]) * (Number(p[i]) - Number(box.centre[i]));
  return abs(sum);
}

RC_GTEST_PROP(OrientedBoxProps, holdsEveryFiniteVertexExactly, ()) {
  for (int repeat = 0; repeat < 20; ++repeat) {
    const test::TriangleMesh mesh = test::any_mesh();
    const OrientedBox box = find(mesh).box;
    bool any = false;
    for (const glm::vec3& p : mesh.positions) {
      if (!is_finite(p)) continue;
      any = true;
      RC_ASSERT(is_finite(box.centre));
      for (int k = 0; k < 3; ++k) {
        RC_ASSERT(is_finite(box.axes[k]));
        RC_ASSERT(box.half[k] >= 0);
        if (std::isfinite(box.half[k])) RC_ASSERT(distance(box, k, p) <= Number(box.half[k]));
      }
    }
    RC_ASSERT(any == !pgl::is_empty(box));
  }
}

RC_GTEST_PROP(OrientedBoxProps, hasOrthogonalRightHandedUnitAxesAndItsLongestSideFirst, ()) {
  for (int repeat = 0; repeat < 20; ++repeat) {
    const OrientedBox box = find(test::any_mesh()).box;
    RC_ASSERT(box.half.x >= box.half.y && box.half.y >= box.half.z);
    for (int k = 0; k < 3; ++k) {
      const glm::dvec3 a(box.axes[k]), b(box.axes[(k + 1) % 3]), c(box.axes[(k + 2) % 3]);
      RC_ASSERT(std::abs(glm::dot(a, a) - 1) < 1e-6);
      RC_ASSERT(std::abs(glm::dot(a, b)) < 1e-6);
      RC_ASSERT(glm::dot(glm::cross(a, b), c) > 0.999);
    }
  }
}

RC_GTEST_PROP(OrientedBoxProps, isTouchedOnEverySideAndNoLargerThanTheUprightBox, ()) {
  for (int repeat = 0; repeat < 20; ++repeat) {
    const test::TriangleMesh mesh = test::any_mesh();
    const OrientedBox box = find(mesh).box;
    if (pgl::is_empty(box) || !is_finite(box.half)) continue;
    const pgl::Box upright = pgl::host::bounds(mesh.positions);
    // What rounding to floats may add to a side: of the coordinates, and of the axes, which turns the longest side.
    double farthest = 0;
    for (int i = 0; i < 3; ++i)
      farthest = std::max(
          {farthest, std::abs(static_cast<double>(upright.min[i])), std::abs(static_cast<double>(upright.max[i]))});
    const double rounding = 1e-6 * farthest + 1e-44;
    double side[3], surface = 0, most = 0;
    for (int i = 0; i < 3; ++i) side[i] = static_cast<double>(upright.max[i]) - static_cast<double>(upright.min[i]);
    for (int i = 0; i < 3; ++i) {
      surface += 2 * side[i] * side[(i + 1) % 3];
      most = std::max(most, side[i]);
    }
    RC_ASSERT(pgl::surface_area(box) <= surface * (1 + 1e-6) + 40 * rounding * (most + rounding));
    for (int k = 0; k < 3; ++k)
      for (const double sign : {-1.0, 1.0}) {
        double reach = -std::numeric_limits<double>::infinity();
        for (const glm::vec3& p : mesh.positions)
          if (is_finite(p))
            reach = std::max(reach, sign * glm::dot(glm::dvec3(p) - glm::dvec3(box.centre), glm::dvec3(box.axes[k])));
        RC_ASSERT(reach >= static_cast<double>(box.half[k]) - 4 * rounding);
      }
  }
}

RC_GTEST_PROP(CompactnessProps, isTheAreaOfTheTrianglesOverTheSurfaceOfTheBox, ()) {
  for (int repeat = 0; repeat < 20; ++repeat) {
    const test::TriangleMesh mesh = test::any_mesh();
    const Found found = find(mesh);
    RC_ASSERT(found.compactness >= 0.0f && found.compactness <= 1.0f);
    long double area = 0;
    for (const test::Corners& t : mesh.triangles) {
      const glm::vec3 &p = mesh.positions[t.v[0]], &q = mesh.positions[t.v[1]], &r = mesh.positions[t.v[2]];
      if (!is_finite(p) || !is_finite(q) || !is_finite(r)) continue;
      long double u[3], v[3], square = 0;
      for (int i = 0; i < 3; ++i) {
        u[i] = static_cast<long double>(q[i]) - static_cast<long double>(p[i]);
        v[i] = static_cast<long double>(r[i]) - static_cast<long double>(p[i]);
      }
      for (int i = 0; i < 3; ++i) {
        const long double n = u[i] * v[(i + 1) % 3] - u[(i + 1) % 3] * v[i];
        square += n * n;
      }
      area += std::sqrt(square) / 2;
    }
    const OrientedBox& box = found.box;
    const long double x = box.half.x, y = box.half.y, z = box.half.z;
    if (pgl::is_empty(box) || !(y > 0) || !std::isfinite(box.half.x)) {
      RC_ASSERT(found.compactness == 0.0f);
      continue;
    }
    const long double surface = z <= x / 4096 ? 4 * x * y : 8 * (x * y + y * z + z * x);
    const long double expected = std::min(area / surface, 1.0L);
    // The units of area are tiny beside the square of the box's longest side.
    const long double unit = 64 * 0x1p-50L * (x + y + z) * (x + y + z) / surface;
    RC_ASSERT(std::abs(found.compactness - expected) <= 1e-6L * expected + unit + 1e-38L);
  }
}

}  // namespace
