// SPDX-License-Identifier: MIT
#include "scene/weld.hpp"

#include <bit>
#include <cstring>

namespace pgl::scene {
namespace {

constexpr std::uint32_t none = ~std::uint32_t{0};

std::uint32_t bits(float x) {
  return x == 0.0f ? 0u : std::bit_cast<std::uint32_t>(x);
}

std::uint64_t hash(const glm::vec3& p) {
  const auto mix = [](std::uint64_t h) {
    h *= 0x9e3779b97f4a7c15u;
    return h ^ (h >> 32);
  };
  return mix(mix(bits(p.x) | std::uint64_t{bits(p.y)} << 32) ^ bits(p.z));
}

bool same(const glm::vec3& a, const glm::vec3& b) {
  return bits(a.x) == bits(b.x) && bits(a.y) == bits(b.y) && bits(a.z) == bits(b.z);
}

}  // namespace

WeldCounts weld(MeshData& mesh) {
  auto& positions = mesh.positions;
  WeldCounts counts;

  // new_index: none for an unreferenced vertex, its place afterwards for a referenced one.
  std::vector<std::uint32_t> new_index(positions.size(), none);
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t v : triangle.v) {
      PGL_ASSERT(v < positions.size());
      new_index[v] = 0;
    }

  // Open addressing, at most half full; survivors are compacted to the front of `positions` as they are found.
  std::vector<std::uint32_t> table(std::bit_ceil(positions.size() * 2 + 1), none);
  const std::size_t mask = table.size() - 1;
  std::uint32_t kept = 0;
  for (std::size_t v = 0; v < positions.size(); ++v) {
    if (new_index[v] == none) {
      ++counts.unreferenced;
      continue;
    }
    const glm::vec3 p = positions[v];
    std::size_t slot = hash(p) & mask;
    while (table[slot] != none && !same(positions[table[slot]], p)) slot = (slot + 1) & mask;
    if (table[slot] == none) {
      table[slot] = kept;
      for (int axis = 0; axis < 3; ++axis) positions[kept][axis] = std::bit_cast<float>(bits(p[axis]));
      ++kept;
    } else {
      ++counts.merged;
    }
    new_index[v] = table[slot];
  }
  positions.resize(kept);

  for (auto& triangle : mesh.triangles) {
    for (std::uint32_t& v : triangle.v) v = new_index[v];
    const auto& v = triangle.v;
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) ++counts.degenerate;
  }
  return counts;
}

}  // namespace pgl::scene
