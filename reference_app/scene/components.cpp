// SPDX-License-Identifier: MIT
#include "scene/components.hpp"

namespace pgl::scene {

std::vector<MeshData> split_components(const MeshData& mesh) {
  constexpr std::uint32_t none = ~std::uint32_t{0};
  const auto& triangles = mesh.triangles;
  const std::size_t vertex_count = mesh.positions.size();

  // Union-find with path halving.
  std::vector<std::uint32_t> parent(vertex_count);
  for (std::size_t v = 0; v < vertex_count; ++v) parent[v] = static_cast<std::uint32_t>(v);
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const auto& triangle : triangles) {
    PGL_ASSERT(triangle.v[0] < vertex_count && triangle.v[1] < vertex_count && triangle.v[2] < vertex_count);
    parent[root(triangle.v[1])] = root(triangle.v[0]);
    parent[root(triangle.v[2])] = root(triangle.v[0]);
  }

  // Number the sets by first triangle, and count what each will hold.
  struct Size {
    std::size_t vertices = 0, triangles = 0;
  };
  std::vector<std::uint32_t> component(vertex_count, none);  // of a root
  std::vector<Size> sizes;
  for (const auto& triangle : triangles) {
    std::uint32_t& c = component[root(triangle.v[0])];
    if (c == none) {
      c = static_cast<std::uint32_t>(sizes.size());
      sizes.emplace_back();
    }
    ++sizes[c].triangles;
  }
  for (std::size_t v = 0; v < vertex_count; ++v)
    if (const std::uint32_t c = component[root(static_cast<std::uint32_t>(v))]; c != none) ++sizes[c].vertices;

  std::vector<MeshData> parts(sizes.size());
  for (std::size_t c = 0; c < parts.size(); ++c) {
    parts[c].positions.reserve(sizes[c].vertices);
    parts[c].triangles.reserve(sizes[c].triangles);
  }
  std::vector<std::uint32_t> local(vertex_count);
  for (std::size_t v = 0; v < vertex_count; ++v) {
    const std::uint32_t c = component[root(static_cast<std::uint32_t>(v))];
    if (c == none) continue;
    local[v] = static_cast<std::uint32_t>(parts[c].positions.size());
    parts[c].positions.push_back(mesh.positions[v]);
  }
  for (const auto& triangle : triangles) {
    const auto& v = triangle.v;
    parts[component[root(v[0])]].triangles.push_back({{local[v[0]], local[v[1]], local[v[2]]}});
  }
  return parts;
}

}  // namespace pgl::scene
