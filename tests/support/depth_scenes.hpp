// SPDX-License-Identifier: MIT
// Occluders and views that the depth rasteriser is tried with.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/depth.hpp"
#include "pgl/types.hpp"
#include "support/meshes.hpp"
#include "support/numbers.hpp"

namespace test {

/// The arrays of a model, and which of its objects are occluders.
template <class Index>
struct DepthScene {
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<glm::vec3> vertices;
  std::vector<pgl::Triangle<Index>> triangles;
  std::vector<std::uint32_t> map;
  std::vector<std::uint32_t> occluders;
  pgl::View view;

  /// Appends a mesh with all its vertices, its map of one entry.
  std::uint32_t add_mesh(std::span<const glm::vec3> positions, std::span<const pgl::Triangle<Index>> corners) {
    const auto size = static_cast<std::uint32_t>(positions.size());
    meshes.push_back({.first_vertex = vertices.size(),
                      .first_triangle = triangles.size(),
                      .first_map = map.size(),
                      .min_vertices = size,
                      .max_vertices = size});
    vertices.insert(vertices.end(), positions.begin(), positions.end());
    triangles.insert(triangles.end(), corners.begin(), corners.end());
    map.push_back(static_cast<std::uint32_t>(corners.size()));
    return static_cast<std::uint32_t>(meshes.size() - 1);
  }
  std::uint32_t add_mesh(const TriangleMesh& mesh) {
    std::vector<pgl::Triangle<Index>> corners;
    for (const Corners& t : mesh.triangles)
      corners.push_back({{static_cast<Index>(t.v[0]), static_cast<Index>(t.v[1]), static_cast<Index>(t.v[2])}});
    return add_mesh(mesh.positions, corners);
  }
  /// Places a mesh, as an occluder.
  void add_occluder(std::uint32_t mesh, const glm::mat4x3& transform = glm::mat4x3(1.0f)) {
    occluders.push_back(static_cast<std::uint32_t>(objects.size()));
    objects.push_back({.mesh = mesh, .transform = transform});
  }
};

/// Perspective with the eye at the origin looking along -z, `slope` half as high as far, any depth range and order.
inline pgl::View depth_camera(float width, float height, float near, float far, pgl::DepthRange range,
                              pgl::DepthOrder order, float slope = 1.0f) {
  // Window depth at distance t: (1 - near / t) far / (far - near); clip z of it by range and order.
  const double n = near, f = far, a = f / (f - n), b = -n * f / (f - n);  // depth * t = a t + b
  const double s = range == pgl::DepthRange::minus_one_to_one ? 2 : 1, shift = s == 2 ? -1 : 0;
  const double za = order == pgl::DepthOrder::reversed ? s * (1 - a) + shift : s * a + shift;
  const double zb = order == pgl::DepthOrder::reversed ? -s * b : s * b;
  pgl::View v;
  v.clip_from_world = glm::mat4(0.0f);
  v.clip_from_world[0].x = height / width / slope;
  v.clip_from_world[1].y = 1 / slope;
  v.clip_from_world[2].z = static_cast<float>(-za);
  v.clip_from_world[3].z = static_cast<float>(zb);
  v.clip_from_world[2].w = -1;
  v.width = width;
  v.height = height;
  v.near_depth = near;
  v.depth_range = range;
  v.depth_order = order;
  return v;
}

inline bool coin() {
  return numbers::whole(0, 1) != 0;
}

/// A picture of up to most x most pixels, now and then of one row or column, and how it is kept as depths.
inline pgl::DepthMap choose_size(pgl::View& view, int most) {
  view.width = static_cast<float>(numbers::whole(0, 5) == 0 ? 1 : numbers::whole(1, most));
  view.height = static_cast<float>(numbers::whole(0, 5) == 0 ? 1 : numbers::whole(1, most));
  const auto scale = static_cast<std::uint32_t>(numbers::whole(0, 1) ? 1 : numbers::whole(1, 8));
  return pgl::depth_map_of(view, scale, coin() ? pgl::Coverage::centres : pgl::Coverage::whole);
}

/// Triangles anywhere near any view: of any size, some slivers, some behind the eye or through the near plane, some not
/// finite or without area; in several objects with any transform.
template <class Index>
DepthScene<Index> any_depth_scene() {
  DepthScene<Index> scene;
  const numbers::Kind kind = numbers::kind();
  scene.view = numbers::view(kind);
  scene.view.depth_order = coin() ? pgl::DepthOrder::reversed : pgl::DepthOrder::conventional;
  const int objects = numbers::whole(1, 4);
  for (int i = 0; i < objects; ++i) {
    std::vector<glm::vec3> positions;
    std::vector<pgl::Triangle<Index>> corners;
    const int count = numbers::whole(0, 6);
    for (int t = 0; t < count; ++t) {
      glm::vec3 p[3];
      for (glm::vec3& q : p) q = numbers::point_near(scene.view, kind);
      const int shape = numbers::whole(0, 7);
      const float part = std::ldexp(1.0f, -numbers::whole(1, 20));
      if (shape <= 2) p[2] = p[0] + (p[2] - p[0]) * part;                                         // thin
      if (shape <= 1) p[1] = p[0] + (p[1] - p[0]) * part;                                         // small
      if (shape == 3) p[numbers::whole(0, 2)][numbers::whole(0, 2)] = numbers::any_number(kind);  // anywhere
      if (shape == 4 && coin()) p[2] = p[1];
      for (const glm::vec3& q : p) {
        corners.resize(static_cast<std::size_t>(t) + 1);
        corners.back().v[positions.size() % 3] = static_cast<Index>(positions.size());
        positions.push_back(q);
      }
    }
    const std::uint32_t mesh = scene.add_mesh(positions, corners);
    glm::mat4x3 transform(1.0f);
    if (coin()) {  // a small turn, or anything
      for (int column = 0; column < 3; ++column) transform[column] += 0.25f * numbers::point(numbers::Kind::plain);
      if (numbers::whole(0, 9) == 0) transform = numbers::any_affine();
    }
    scene.add_occluder(mesh, transform);
    if (numbers::whole(0, 5) == 0) scene.occluders.push_back(pgl::no_object);
  }
  return scene;
}

}  // namespace test
