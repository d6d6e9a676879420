// SPDX-License-Identifier: MIT
// One mesh at any level of detail: order its collapses once, then take any prefix.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "pgl/host/build_ecol.hpp"
#include "pgl/host/rearrange.hpp"
#include "pgl/host/reform.hpp"

int main() {
  using Index = std::uint32_t;
  using Triangle = pgl::Triangle<Index>;

  // A closed ring of 64 x 32 vertices.
  std::vector<glm::vec3> positions;
  std::vector<Triangle> triangles;
  for (Index i = 0; i < 64; ++i)
    for (Index j = 0; j < 32; ++j) {
      const double u = i * M_PI / 32, v = j * M_PI / 16, r = 1 + 0.4 * std::cos(v);
      positions.emplace_back(r * std::cos(u), r * std::sin(u), 0.4 * std::sin(v));
      const Index a = i * 32 + j, b = (i + 1) % 64 * 32 + j, c = (i + 1) % 64 * 32 + (j + 1) % 32,
                  d = i * 32 + (j + 1) % 32;
      triangles.push_back({{a, b, c}});
      triangles.push_back({{a, c, d}});
    }

  // Once per mesh.
  const std::size_t n = positions.size();
  std::vector<Index> ecol(n), place_v(n);
  std::vector<std::uint32_t> place_t(triangles.size()), map(n + 1);
  pgl::host::EcolWorkspace<float> workspace;
  const std::uint32_t least =
      pgl::host::build_ecol<float, Index>(positions, triangles, {}, {}, workspace, ecol, place_v, place_t, map, {});
  std::vector<glm::vec3> vertices(n);
  std::vector<Triangle> ordered(triangles.size());
  std::vector<Index> targets(n);
  pgl::host::rearrange<glm::vec3, Index>(positions, triangles, ecol, place_v, place_t, vertices, ordered, targets);

  // Any time after: the first k vertices and the first map[k] triangles, reformed, are the mesh at k vertices.
  pgl::host::ReformWorkspace<Index> reform_workspace;
  for (const std::uint32_t k : {2048u, 500u, 100u, least}) {
    std::vector<Triangle> level(map[k]);
    pgl::host::reform_mesh<Index>(std::span(ordered).first(map[k]), targets, k, reform_workspace, level);
    std::printf("%4u vertices, %4zu triangles, Euler characteristic %ld\n", k, level.size(),
                static_cast<long>(k) - static_cast<long>(level.size()) / 2);
  }
}
