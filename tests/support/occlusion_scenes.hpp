// SPDX-License-Identifier: MIT
// Scenes that occlusion culling is tried with: walls and boulders before many things, and anything anywhere.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <span>
#include <vector>

#include "pgl/host/bounds.hpp"
#include "pgl/host/oriented_box.hpp"
#include "pgl/host/select_occluders.hpp"
#include "support/depth_scenes.hpp"
#include "support/meshes.hpp"
#include "support/numbers.hpp"

namespace test {

/// Its list of occluders is not used: they are chosen.
using OcclusionScene = DepthScene<std::uint32_t>;

/// What is known of a model before the first frame.
struct OcclusionModel {
  std::vector<pgl::Box> boxes;            ///< of the objects
  std::vector<pgl::OccluderFace> faces;   ///< of the objects
  std::vector<std::uint32_t> candidates;  ///< for occluders: those compact enough, by compactness
};

inline OcclusionModel prepared(const OcclusionScene& s, float threshold) {
  const std::size_t meshes = s.meshes.size(), objects = s.objects.size();
  OcclusionModel model{std::vector<pgl::Box>(objects), std::vector<pgl::OccluderFace>(objects),
                       std::vector<std::uint32_t>(objects)};
  std::vector<pgl::Box> mesh_boxes(meshes);
  for (std::size_t m = 0; m < meshes; ++m)
    mesh_boxes[m] =
        pgl::host::bounds(std::span(s.vertices).subspan(s.meshes[m].first_vertex, s.meshes[m].max_vertices));
  pgl::host::object_bounds(s.objects, mesh_boxes, model.boxes);
  std::vector<pgl::OrientedBox> oriented(meshes);
  std::vector<float> compactness(meshes);
  pgl::host::oriented_boxes<std::uint32_t>(s.meshes, s.vertices, s.triangles, s.map, oriented, compactness);
  pgl::host::occluder_faces(s.objects, oriented, compactness, model.faces);
  pgl::host::OccluderWorkspace workspace;
  pgl::host::compactness_order(model.faces, workspace, model.candidates);
  model.candidates.resize(pgl::host::compact_objects(model.faces, model.candidates, threshold));
  return model;
}

struct Palette {
  std::vector<std::uint32_t> meshes;
  std::uint32_t cube = 0;
};

inline TriangleMesh cube() {
  TriangleMesh m;
  for (int i = 0; i < 8; ++i)
    m.positions.emplace_back(i & 1 ? 1.0f : -1.0f, i & 2 ? 1.0f : -1.0f, i & 4 ? 1.0f : -1.0f);
  for (const auto& q : {std::array<std::uint32_t, 4>{0, 4, 6, 2},
                        {1, 3, 7, 5},
                        {0, 1, 5, 4},
                        {2, 6, 7, 3},
                        {0, 2, 3, 1},
                        {4, 5, 7, 6}}) {
    m.triangles.push_back({{q[0], q[1], q[2]}});
    m.triangles.push_back({{q[0], q[2], q[3]}});
  }
  return m;
}

/// Meshes of about the unit cube's size: closed, open, of one triangle, of none, without area, with odd vertices.
inline Palette add_palette(OcclusionScene& s) {
  Palette p;
  const auto add = [&](const TriangleMesh& mesh) { p.meshes.push_back(s.add_mesh(mesh)); };
  add(cube());
  p.cube = p.meshes[0];
  add(sphere(1));
  add(tetrahedron());
  TriangleMesh sheet = grid(2, 2);
  for (glm::vec3& v : sheet.positions) v -= glm::vec3(1, 1, 0);
  add(sheet);
  add(torus(5, 4));
  TriangleMesh one;
  one.positions = {{-1, -1, 0}, {1, -0.5f, 0.25f}, {0, 1, -0.5f}};
  one.triangles = {{{0, 1, 2}}};
  add(one);
  TriangleMesh line = one;  // no area
  line.positions[2] = 0.5f * (line.positions[0] + line.positions[1]);
  add(line);
  TriangleMesh spot = one;
  spot.positions = {glm::vec3(0.5f), glm::vec3(0.5f), glm::vec3(0.5f)};
  add(spot);
  TriangleMesh odd = cube();
  odd.positions[3].y = std::numeric_limits<float>::quiet_NaN();
  odd.positions[6].x = std::numeric_limits<float>::infinity();
  add(odd);
  add(TriangleMesh{});
  return p;
}

inline float unit(int low, int high) {
  return static_cast<float>(numbers::whole(low * 4096, high * 4096)) / 4096;
}

inline glm::mat3 rotation() {
  const glm::vec3 axis = numbers::point(numbers::Kind::plain) + glm::vec3(0, 0, 1e-3f);
  return glm::mat3(glm::rotate(glm::mat4(1), unit(-3, 3), axis));
}

/// A camera somewhere in a world of some scale, and where it is.
struct Camera {
  pgl::View view;
  glm::mat4 world_from_camera{1.0f};
  float scale = 1;
  float near = 1;
  bool parallel = false;
};

inline Camera any_camera() {
  Camera c;
  c.scale = std::pow(10.0f, static_cast<float>(numbers::whole(-6, 9)));
  c.near = c.scale * std::ldexp(1.0f, -numbers::whole(0, 6));
  const auto range = coin() ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
  const auto order = coin() ? pgl::DepthOrder::reversed : pgl::DepthOrder::conventional;
  const float far = c.near * std::ldexp(1.0f, numbers::whole(4, 14));
  c.view = depth_camera(16, 16, c.near, far, range, order, std::ldexp(1.0f, numbers::whole(-1, 1)));
  c.parallel = numbers::whole(0, 4) == 0;
  if (c.parallel) {
    // Window depth from 0 to 1 over [near, far], and a picture as wide as the perspective one is at 8 near.
    glm::mat4& m = c.view.clip_from_world;
    const double s = range == pgl::DepthRange::minus_one_to_one ? 2 : 1,
                 turn = order == pgl::DepthOrder::reversed ? -1 : 1;
    const double depth = static_cast<double>(far) - static_cast<double>(c.near);
    m[0].x /= 8 * c.near;
    m[1].y /= 8 * c.near;
    m[2] = glm::vec4(0, 0, static_cast<float>(-turn * s / depth), 0);
    m[3] = glm::vec4(0, 0,
                     static_cast<float>(-turn * s * static_cast<double>(c.near) / depth + (turn < 0 ? 1
                                                                                           : s == 2 ? -1
                                                                                                    : 0)),
                     1);
    c.view.near_depth = 0.5f;
  }
  if (coin()) {
    const glm::mat3 turned = rotation();
    c.world_from_camera = glm::mat4(turned);
    c.world_from_camera[3] = glm::vec4(c.scale * unit(-8, 8), c.scale * unit(-8, 8), c.scale * unit(-8, 8), 1);
    const glm::mat4 camera_from_world =
        glm::mat4(glm::transpose(turned)) * glm::translate(glm::mat4(1), -glm::vec3(c.world_from_camera[3]));
    c.view.clip_from_world = c.view.clip_from_world * camera_from_world;
  }
  return c;
}

/// Places a mesh with its centre at a place of the picture, (-1 to 1) twice, and a distance, its half sides given.
inline void place(OcclusionScene& s, const Camera& c, std::uint32_t mesh, float x, float y, float distance,
                  glm::vec3 half, const glm::mat3& turn) {
  const float reach = c.parallel ? 8 * c.near : distance;
  // The camera is square; slope is in its matrix, so a quarter more or less of the way does not matter.
  const glm::vec3 centre(x * reach, y * reach, -distance);
  glm::mat4 m = glm::translate(glm::mat4(1), centre) * glm::mat4(turn) * glm::scale(glm::mat4(1), half);
  m = c.world_from_camera * m;
  s.objects.push_back({.mesh = mesh, .transform = glm::mat4x3(m)});
}

/// Anything anywhere: around the eye, through the near plane, behind, beyond; thin, flat, huge, tiny.
inline void place_anything(OcclusionScene& s, const Camera& c, const Palette& palette) {
  const std::uint32_t mesh =
      palette.meshes[static_cast<std::size_t>(numbers::whole(0, static_cast<int>(palette.meshes.size()) - 1))];
  float distance = c.near * std::ldexp(1 + unit(0, 1), numbers::whole(-2, 9));
  const int where = numbers::whole(0, 11);
  if (where == 0) distance = -distance;
  if (where == 1) distance = 0;
  if (where == 2) distance = c.near;
  glm::vec3 half(std::abs(distance) * std::ldexp(1.0f, -numbers::whole(0, 8)));
  if (where == 3) half *= 64;
  for (int axis = 0; axis < 3; ++axis)
    if (numbers::whole(0, 3) == 0) half[axis] *= std::ldexp(1.0f, -numbers::whole(1, 12));
  if (numbers::whole(0, 9) == 0) half[numbers::whole(0, 2)] = 0;
  if (numbers::whole(0, 9) == 0) half.x = -half.x;
  place(s, c, mesh, unit(-1, 1) * 1.25f, unit(-1, 1) * 1.25f, distance, half, coin() ? glm::mat3(1) : rotation());
}

/// Walls, screens and boulders not far from the camera, and things behind them.
inline void place_yard(OcclusionScene& s, const Camera& c, const Palette& palette, int things) {
  const int screens = numbers::whole(1, 3);
  for (int i = 0; i < screens; ++i) {
    const float distance = c.near * std::ldexp(1 + unit(0, 1), 2);
    const float reach = c.parallel ? 8 * c.near : distance;
    const bool boulder = numbers::whole(0, 3) == 0;
    const glm::vec3 half = reach * glm::vec3(0.5f + unit(0, 1), 0.5f + unit(0, 1), boulder ? 0.5f : 0.01f);
    place(s, c,
          palette.meshes[boulder  ? static_cast<std::size_t>(numbers::whole(0, 1))
                         : coin() ? 0
                                  : 3],
          unit(-1, 1) * 0.5f, unit(-1, 1) * 0.5f, distance, half, coin() ? glm::mat3(1) : rotation());
  }
  for (int i = 0; i < things; ++i) {
    const float distance = c.near * std::ldexp(1 + unit(0, 1), numbers::whole(3, 6));
    const float reach = c.parallel ? 8 * c.near : distance;
    const glm::vec3 half = reach * std::ldexp(1.0f, -numbers::whole(3, 6)) * glm::vec3(1, unit(0, 1), unit(0, 1));
    place(s, c, palette.meshes[static_cast<std::size_t>(numbers::whole(0, 5))], unit(-1, 1), unit(-1, 1), distance,
          half, coin() ? glm::mat3(1) : rotation());
  }
}

/// Another size of the picture: the view's matrix knows nothing of it.
inline pgl::DepthMap any_size(pgl::View& view, int most) {
  view.width = static_cast<float>(numbers::whole(0, 11) == 0 ? 1 : numbers::whole(1, most));
  view.height = static_cast<float>(numbers::whole(0, 11) == 0 ? 1 : numbers::whole(1, most));
  return pgl::depth_map_of(view, static_cast<std::uint32_t>(coin() ? 1 : numbers::whole(1, 4)),
                           numbers::whole(0, 2) ? pgl::Coverage::centres : pgl::Coverage::whole);
}

}  // namespace test
