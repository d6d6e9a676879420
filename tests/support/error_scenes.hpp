// SPDX-License-Identifier: MIT
// Scenes whose objects are selected by error: meshes that are no more than errors, objects seen at all sizes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <random>
#include <vector>

#include "pgl/select_by_error.hpp"
#include "pgl/types.hpp"

namespace test {

struct ErrorScene {
  std::vector<pgl::Mesh> meshes;
  std::vector<float> errors, areas, depths, scales;
  std::vector<std::uint32_t> mesh_of_object, min_vertices, max_vertices;
  pgl::View view;
  pgl::ErrorOptions options;

  std::size_t size() const { return areas.size(); }
  float error(std::size_t i, std::uint32_t vertices) const {
    const pgl::Mesh& mesh = meshes[mesh_of_object[i]];
    return errors.at(mesh.first_map + vertices - mesh.min_vertices);
  }
};

/// n objects at random: few or many sizes, with ties and with what should not be there.
inline ErrorScene error_scene(std::mt19937& random, std::size_t n) {
  const auto below = [&](std::uint64_t bound) { return static_cast<std::uint32_t>(random() % bound); };
  const bool round = below(3) == 0;  // powers of two: errors that meet the threshold exactly
  const bool wild = below(3) == 0;   // all of float's range
  const auto number = [&](int least, int most) {
    const int e = least + static_cast<int>(below(static_cast<std::uint64_t>(most - least + 1)));
    return std::ldexp(round ? 1.0f : 1.0f + static_cast<float>(below(1u << 23)) * 0x1p-23f, e);
  };
  ErrorScene scene;
  const std::uint32_t mesh_count = 1 + below(8);
  for (std::uint32_t m = 0; m < mesh_count; ++m) {
    pgl::Mesh mesh;
    mesh.first_map = scene.errors.size();
    mesh.min_vertices = 1 + below(12);
    mesh.max_vertices = mesh.min_vertices + (below(6) == 0 ? 0 : below(m == 0 && below(10) == 0 ? 20000 : 300));
    std::vector<float> errors;
    for (std::uint32_t v = mesh.min_vertices; v < mesh.max_vertices; ++v)
      errors.push_back(below(8) == 0            ? 0.0f
                       : wild && below(40) == 0 ? std::numeric_limits<float>::infinity()
                       : wild                   ? number(-149, 127)
                                                : number(-12, 2));
    std::sort(errors.begin(), errors.end(), std::greater<>());
    errors.push_back(below(4) == 0 && !errors.empty() ? errors.back() : 0.0f);  // 0 at the full count, as a rule
    scene.errors.insert(scene.errors.end(), errors.begin(), errors.end());
    scene.meshes.push_back(mesh);
  }
  const float odd[] = {0.0f,  -0.0f,   -1.0f, 1e-45f,
                       1e30f, 3.4e38f, 1.0f,  std::numeric_limits<float>::infinity(),
                       2.0f,  1.0f,    4.0f,  std::numeric_limits<float>::quiet_NaN()};
  const bool is_odd = below(4) == 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t m = below(mesh_count);
    const pgl::Mesh& mesh = scene.meshes[m];
    scene.mesh_of_object.push_back(m);
    scene.areas.push_back(is_odd ? odd[below(12)] : below(3) == 0 ? 0.0f : number(-4, 20));
    scene.depths.push_back(is_odd ? odd[below(12)] : number(-4, 10));
    scene.scales.push_back(is_odd && below(2) == 0 ? std::fabs(odd[below(11)]) : number(-3, 3));
    const std::uint32_t span = mesh.max_vertices - mesh.min_vertices + 1;
    std::uint32_t least = mesh.min_vertices, most = mesh.max_vertices;
    if (below(2) == 0) least += below(span);
    if (below(3) == 0) most -= below(most - least + 1);
    scene.min_vertices.push_back(least);
    scene.max_vertices.push_back(most);
  }
  scene.view.width = 1920;
  scene.view.height = 1080;
  scene.view.near_depth = number(-6, 0);
  scene.view.clip_from_world = glm::mat4(0.0f);
  scene.view.clip_from_world[0].x = number(-1, 1);
  scene.view.clip_from_world[1].y = number(-1, 1);
  scene.view.clip_from_world[2].w = below(4) == 0 ? 0.0f : -1.0f;
  scene.view.clip_from_world[3].w = 0.5f;
  scene.options.threshold = below(12) == 0 ? odd[std::min(below(12) & ~2u, 9u)] : number(-4, 6);
  if (!(scene.options.threshold >= 0.0f)) scene.options.threshold = 1.0f;
  if (round && below(2) == 0)  // some errors project to the threshold exactly
    scene.options.threshold = std::ldexp(pgl::pixels_per_unit(scene.view), static_cast<int>(below(10)) - 8);
  scene.options.pet = below(2) == 0 ? 0.0f : 1.0f;
  return scene;
}

}  // namespace test
