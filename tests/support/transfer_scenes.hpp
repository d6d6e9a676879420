// SPDX-License-Identifier: MIT
// Scenes whose selections grow under a transfer cap: meshes that are no more than maps, counts wanted and drawn before.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "pgl/limit_transfer.hpp"
#include "pgl/types.hpp"

namespace test {

struct TransferScene {
  std::vector<pgl::Mesh> meshes;
  std::vector<std::uint32_t> map, mesh_of_object, min_vertices, max_vertices, wanted, previous;
  std::vector<float> areas, depths;
  std::uint32_t min_triangles = 0;
  pgl::BudgetOptions weight;
  pgl::TransferOptions options;

  std::size_t size() const { return wanted.size(); }
  const pgl::Mesh& mesh(std::size_t i) const { return meshes[mesh_of_object[i]]; }

  /// The bytes that a mesh has up to `vertices` vertices.
  std::uint64_t bytes_at(const pgl::Mesh& mesh, std::uint64_t vertices) const {
    if (vertices == 0) return 0;
    return vertices * options.vertex_bytes +
           std::uint64_t{map.at(mesh.first_map + vertices - mesh.min_vertices)} * options.triangle_bytes;
  }
  /// The bytes that counts have and others lack.
  std::uint64_t bytes_between(const std::vector<std::uint32_t>& from, const std::vector<std::uint32_t>& to) const {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < size(); ++i)
      if (to[i] > from[i]) sum += bytes_at(mesh(i), to[i]) - bytes_at(mesh(i), from[i]);
    return sum;
  }
};

/// Ordinary counts, nothing drawn before, all drawn before, a view that stays for the most part.
enum class Before { any, nothing, all, nearly_same };

/// n objects at random; the cap is without limit.
inline TransferScene transfer_scene(std::mt19937& random, std::size_t n, Before before = Before::any) {
  const auto below = [&](std::uint64_t bound) { return static_cast<std::uint32_t>(random() % bound); };
  TransferScene scene;
  scene.min_triangles = below(3) == 0 ? 0 : below(40);
  const std::uint32_t mesh_count = 1 + below(8);
  const bool flat = below(10) == 0;   // no triangles at all
  const bool steep = below(3) == 0;   // single vertices that bring many triangles
  const bool large = below(10) == 0;  // one mesh far larger than the others
  for (std::uint32_t m = 0; m < mesh_count; ++m) {
    pgl::Mesh mesh;
    mesh.first_map = scene.map.size();
    mesh.min_vertices = below(3) == 0 ? 0 : below(12);
    mesh.max_vertices = mesh.min_vertices + (below(6) == 0 ? 0 : below(m == 0 && large ? 20000 : 300));
    std::uint32_t triangles = 0;
    for (std::uint32_t v = mesh.min_vertices; v <= mesh.max_vertices; ++v) {
      if (v > 2 && !flat) triangles += steep && below(30) == 0 ? below(5000) : below(4);
      scene.map.push_back(triangles);
    }
    scene.meshes.push_back(mesh);
  }
  const std::uint32_t kind = below(4);  // ties, plain numbers, all sizes, numbers that should not be there
  const float odd[] = {0.0f,  -0.0f,   -1.0f, 1e-45f,
                       1e30f, 3.4e38f, 1.0f,  std::numeric_limits<float>::infinity(),
                       2.0f,  1.0f,    4.0f,  std::numeric_limits<float>::quiet_NaN()};
  const auto number = [&] {
    if (kind == 0) return static_cast<float>(1 + below(2));
    if (kind == 1) return static_cast<float>(1 + below(100000));
    if (kind == 2) return std::ldexp(static_cast<float>(1 + below(16)), static_cast<int>(below(200)) - 100);
    return odd[below(std::size(odd))];
  };
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t m = below(mesh_count);
    const pgl::Mesh& mesh = scene.meshes[m];
    scene.mesh_of_object.push_back(m);
    scene.areas.push_back(number());
    scene.depths.push_back(number());
    scene.min_vertices.push_back(pgl::minimum_vertices(mesh, scene.map.data(), scene.min_triangles));
    scene.max_vertices.push_back(mesh.max_vertices);
    const auto in = [&](std::uint32_t least) { return least + below(mesh.max_vertices - least + 1); };
    const std::uint32_t all = mesh.max_vertices;
    // What was drawn before may have been so with another minimum.
    std::uint32_t was = below(3) == 0 ? 0 : in(below(4) == 0 ? mesh.min_vertices : scene.min_vertices[i]);
    if (before == Before::nothing) was = 0;
    if (before == Before::all) was = all;
    std::uint32_t want = below(4) == 0 ? 0 : below(8) == 0 ? all : in(scene.min_vertices[i]);
    if (before == Before::nearly_same && below(10) != 0) want = std::max(was, was == 0 ? 0 : scene.min_vertices[i]);
    scene.previous.push_back(was);
    scene.wanted.push_back(want);
  }
  scene.weight.budget = std::uint64_t{1} << 32;
  scene.weight.pet = below(2) == 0 ? 0.0f : 1.0f;
  scene.weight.alpha = 1.5f + static_cast<float>(below(4));
  constexpr std::uint32_t sizes[][2] = {{12, 12}, {12, 6}, {1, 0}, {0, 1}, {3, 7}, {16, 12}, {65536, 65536}};
  const auto& bytes = sizes[below(std::size(sizes))];
  scene.options.vertex_bytes = bytes[0];
  scene.options.triangle_bytes = bytes[1];
  return scene;
}

/// Caps worth trying: none, one byte, odd parts of what there is, all but one byte, all, more, no limit.
inline std::vector<std::uint64_t> transfer_caps(const TransferScene& scene, std::mt19937& random) {
  const std::uint64_t all = scene.bytes_between(std::vector<std::uint32_t>(scene.size()), scene.wanted);
  const std::uint64_t growth = scene.bytes_between(scene.previous, scene.wanted);
  std::uint64_t first_steps = 0;
  for (std::size_t i = 0; i < scene.size(); ++i)
    if (scene.previous[i] == 0 && scene.wanted[i] > 0)
      first_steps += scene.bytes_at(scene.mesh(i), std::max(1u, scene.min_vertices[i]));
  const auto part = [&](std::uint64_t of) { return random() % (of + 1); };
  return {0,
          1,
          part(all),
          part(growth),
          part(growth / 10),
          part(growth / 1000),
          part(first_steps),
          first_steps + part(first_steps),
          growth - (growth > 0 ? 1 : 0),
          growth,
          growth + 1,
          ~std::uint64_t{0} - 1,
          ~std::uint64_t{0}};
}

}  // namespace test
