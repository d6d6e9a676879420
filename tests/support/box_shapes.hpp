// SPDX-License-Identifier: MIT
// Shapes whose least oriented boxes are worth finding, rotations, and the least surface by trying many orientations.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "pgl/types.hpp"
#include "support/meshes.hpp"

namespace test {

/// A closed box around the origin, its faces cut `level` times.
inline TriangleMesh box_mesh(float x, float y, float z, int level = 0) {
  TriangleMesh m;
  for (int i = 0; i < 8; ++i) m.positions.push_back({i & 1 ? x : -x, i & 2 ? y : -y, i & 4 ? z : -z});
  m.triangles = {{{0, 2, 1}}, {{1, 2, 3}}, {{4, 5, 6}}, {{5, 7, 6}}, {{0, 1, 4}}, {{1, 5, 4}},
                 {{2, 6, 3}}, {{3, 6, 7}}, {{0, 4, 2}}, {{2, 4, 6}}, {{1, 3, 5}}, {{3, 7, 5}}};
  for (int i = 0; i < level; ++i) m = subdivided(m);
  return m;
}

/// The six faces of a box whose edges and corners are cut off: only the faces tell how the box lies.
inline TriangleMesh chamfered_box(const glm::vec3& half, float cut) {
  TriangleMesh m;
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {-1.0f, 1.0f}) {
      const std::uint32_t first = m.vertex_count();
      for (int i = 0; i < 4; ++i) {
        glm::vec3 p;
        p[axis] = sign * half[axis];
        p[(axis + 1) % 3] = (i & 1 ? 1.0f : -1.0f) * (half[(axis + 1) % 3] - cut);
        p[(axis + 2) % 3] = (i & 2 ? 1.0f : -1.0f) * (half[(axis + 2) % 3] - cut);
        m.positions.push_back(p);
      }
      m.triangles.push_back({{first, first + 1, first + 3}});
      m.triangles.push_back({{first, first + 3, first + 2}});
    }
  return m;
}

/// An open tube of n sides along z.
inline TriangleMesh tube(std::uint32_t n, float length) {
  TriangleMesh m;
  for (std::uint32_t i = 0; i < n; ++i) {
    const double a = 2 * std::numbers::pi * i / n;
    for (const float z : {-length / 2, length / 2})
      m.positions.push_back({static_cast<float>(std::cos(a)), static_cast<float>(std::sin(a)), z});
    const std::uint32_t p = 2 * i, q = 2 * ((i + 1) % n);
    m.triangles.push_back({{p, q, p + 1}});
    m.triangles.push_back({{q, q + 1, p + 1}});
  }
  return m;
}

/// Random points in a box, joined at random.
inline TriangleMesh cloud(std::mt19937& rng, std::uint32_t n, glm::vec3 half) {
  TriangleMesh m;
  for (std::uint32_t i = 0; i < n; ++i)
    m.positions.push_back(glm::vec3(signed_unit(rng), signed_unit(rng), signed_unit(rng)) * half);
  for (std::uint32_t i = 0; i < 2 * n; ++i) m.triangles.push_back({{below(rng, n), below(rng, n), below(rng, n)}});
  return m;
}

struct NamedMesh {
  std::string name;
  TriangleMesh mesh;
};

inline std::vector<NamedMesh> box_shapes() {
  std::mt19937 rng(11);
  TriangleMesh egg = sphere(3), dome = egg;
  for (glm::vec3& p : egg.positions) p *= glm::vec3(3, 2, 1);
  for (glm::vec3& p : dome.positions) p.z = std::abs(p.z);
  std::vector<NamedMesh> all{{"cube", box_mesh(1, 1, 1)},
                             {"plank", box_mesh(5, 1, 0.1f)},
                             {"tessellated plank", box_mesh(5, 1, 0.1f, 3)},
                             {"rod", box_mesh(10, 0.1f, 0.1f, 1)},
                             {"chamfered box", chamfered_box({4, 2, 1}, 0.2f)},
                             {"cross", beside(box_mesh(4, 1, 1, 1), box_mesh(1, 4, 1, 1), 0)},
                             {"tetrahedron", tetrahedron()},
                             {"octahedron", octahedron()},
                             {"sphere", sphere(3)},
                             {"egg", egg},
                             {"dome", dome},
                             {"bipyramid", bipyramid(12)},
                             {"torus", torus(24, 12)},
                             {"tube", tube(24, 8)},
                             {"sheet", grid(8, 5)},
                             {"moebius strip", moebius_strip(30, 2)},
                             {"fan", fan(9, false)}};
  for (int i = 0; i < 4; ++i) all.push_back({"cloud " + std::to_string(i), cloud(rng, 60, {1, 0.7f, 0.3f})});
  return all;
}

using Axes = std::array<glm::dvec3, 3>;

/// A rotation with all orientations alike: the rows of the matrix of a random unit quaternion.
inline Axes random_axes(std::mt19937& rng) {
  double q[4], square;
  do {
    square = 0;
    for (double& c : q) {
      c = static_cast<double>(signed_unit(rng));
      square += c * c;
    }
  } while (square > 1 || square < 0.01);
  for (double& c : q) c /= std::sqrt(square);
  const auto [w, x, y, z] = q;
  return {glm::dvec3{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
          glm::dvec3{2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
          glm::dvec3{2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
}

inline glm::dvec3 rotate(const Axes& rows, const glm::dvec3& p) {
  return {glm::dot(rows[0], p), glm::dot(rows[1], p), glm::dot(rows[2], p)};
}

inline TriangleMesh rotated(TriangleMesh mesh, const Axes& rows, const glm::dvec3& shift = {0, 0, 0}) {
  for (glm::vec3& p : mesh.positions) p = glm::vec3(rotate(rows, glm::dvec3(p)) + shift);
  return mesh;
}

inline double surface_along(const std::vector<glm::vec3>& positions, const Axes& axes) {
  double e[3];
  for (int k = 0; k < 3; ++k) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const glm::vec3& p : positions) {
      const double d = glm::dot(glm::dvec3(p), axes[static_cast<std::size_t>(k)]);
      low = std::min(low, d);
      high = std::max(high, d);
    }
    e[k] = high - low;
  }
  return 2 * (e[0] * e[1] + e[1] * e[2] + e[2] * e[0]);
}

/// The least surface of a box of any orientation, as well as ever smaller random turns find it: from the coordinate
/// axes and from the best of many random orientations, several times over.
inline double least_surface(const std::vector<glm::vec3>& positions, std::mt19937& rng) {
  double least_of_all = std::numeric_limits<double>::infinity();
  for (int start = 0; start < 8; ++start) {
    Axes best{glm::dvec3{1, 0, 0}, glm::dvec3{0, 1, 0}, glm::dvec3{0, 0, 1}};
    double least = surface_along(positions, best);
    if (start > 0) least = std::numeric_limits<double>::infinity();
    const auto consider = [&](const Axes& axes) {
      const double surface = surface_along(positions, axes);
      if (surface >= least) return;
      least = surface;
      best = axes;
    };
    for (int i = 0; i < 300 && start > 0; ++i) consider(random_axes(rng));
    for (double size = 0.3; size > 1e-5; size *= 0.97)
      for (int i = 0; i < 4; ++i) {
        const Axes about = random_axes(rng);  // a turn about its first row
        const double angle = size * static_cast<double>(signed_unit(rng)), c = std::cos(angle), s = std::sin(angle);
        Axes axes;
        for (std::size_t k = 0; k < 3; ++k)
          axes[k] =
              best[k] * c + glm::cross(about[0], best[k]) * s + about[0] * (glm::dot(about[0], best[k]) * (1 - c));
        consider(axes);
      }
    least_of_all = std::min(least_of_all, least);
  }
  return least_of_all;
}

/// Several meshes in one set of arrays, as a model has them, with something between them.
struct MeshArrays {
  std::vector<pgl::Mesh> meshes;
  std::vector<glm::vec3> vertices;
  std::vector<Corners> triangles;
  std::vector<std::uint32_t> map;
  std::size_t size() const { return meshes.size(); }

  void add(const TriangleMesh& mesh) {
    vertices.push_back({-777, 777, 777});
    triangles.push_back({{0, 0, 0}});
    map.push_back(~0u);
    pgl::Mesh m;
    m.first_vertex = vertices.size();
    m.first_triangle = triangles.size();
    m.first_map = map.size();
    m.max_vertices = mesh.vertex_count();
    m.min_vertices = m.max_vertices == 0 ? 0 : m.max_vertices - 1;
    vertices.insert(vertices.end(), mesh.positions.begin(), mesh.positions.end());
    triangles.insert(triangles.end(), mesh.triangles.begin(), mesh.triangles.end());
    for (std::uint32_t k = m.min_vertices; k < m.max_vertices; ++k) map.push_back(0);
    map.push_back(mesh.triangle_count());
    meshes.push_back(m);
  }
};

}  // namespace test
