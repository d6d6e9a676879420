// SPDX-License-Identifier: MIT
// Random scenes of a few small meshes in several places, with what reform has to make of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "pgl/types.hpp"
#include "support/random_collapse.hpp"

namespace test {

/// A mesh of up to 49 vertices and 99 triangles, with collapses of any kind. choose(least, most) gives a number in
/// that range, both ends included; so it is up to the caller whether a failing case can be made smaller.
template <class Index, class Choose>
CollapsingMesh<Index> any_collapsing_mesh(Choose&& choose) {
  std::mt19937 random(choose(0u, ~0u));
  const std::uint32_t vertices = choose(1u, 49u), triangles = choose(0u, 99u), collapses = choose(0u, vertices - 1);
  const Collapses kinds[] = {Collapses::anywhere, Collapses::along_edges, Collapses::one_chain, Collapses::one_star};
  return random_collapsing_mesh<Index>(random, vertices, triangles, collapses, kinds[choose(0u, 3u)]);
}

template <class Index>
struct Scene {
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<pgl::Triangle<Index>> triangles;
  std::vector<Index> ecol;
  std::vector<std::uint32_t> counts;
  std::vector<std::uint64_t> vertex_offsets{0}, triangle_offsets{0};
  std::vector<pgl::Triangle<Index>> local;           ///< what reform_local writes, found by collapsing one by one
  std::vector<pgl::Triangle<std::uint32_t>> global;  ///< what reform writes
};

/// Up to 11 objects that share up to 3 meshes, some mirrored; counts 0 or anywhere in the mesh's range.
template <class Index, class Choose>
Scene<Index> random_scene(Choose&& choose) {
  Scene<Index> scene;
  std::vector<CollapsingMesh<Index>> sources(choose(1u, 3u));
  for (auto& source : sources) {
    source = any_collapsing_mesh<Index>(choose);
    scene.meshes.push_back({.first_vertex = scene.ecol.size(),
                            .first_triangle = scene.triangles.size(),
                            .min_vertices = source.min_vertices,
                            .max_vertices = source.vertices()});
    const auto arranged = rearranged(source);
    scene.triangles.insert(scene.triangles.end(), arranged.triangles.begin(), arranged.triangles.end());
    scene.ecol.insert(scene.ecol.end(), arranged.ecol.begin(), arranged.ecol.end());
  }

  scene.objects.resize(choose(0u, 11u));
  for (auto& object : scene.objects) {
    object.mesh = choose(0u, static_cast<std::uint32_t>(sources.size()) - 1);
    const auto& source = sources[object.mesh];
    const bool mirror = choose(0u, 1u) != 0;
    if (mirror) object.transform[1] = -object.transform[1];
    const bool shown = choose(0u, 3u) != 0;
    scene.counts.push_back(shown ? choose(source.min_vertices, source.vertices()) : 0);
    if (shown) {
      for (pgl::Triangle<Index> t : reformed_slowly(source, scene.counts.back())) {
        if (mirror) std::swap(t.v[1], t.v[2]);
        scene.local.push_back(t);
        const auto first = static_cast<std::uint32_t>(scene.vertex_offsets.back());
        scene.global.push_back({{first + t.v[0], first + t.v[1], first + t.v[2]}});
      }
    }
    scene.vertex_offsets.push_back(scene.vertex_offsets.back() + scene.counts.back());
    scene.triangle_offsets.push_back(scene.global.size());
  }
  return scene;
}

}  // namespace test
