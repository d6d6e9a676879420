// SPDX-License-Identifier: MIT
// Properties of splitting into components, against a breadth-first search over triangles.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <deque>
#include <set>

#include "scene/components.hpp"

namespace {

using pgl::scene::MeshData;

rc::Gen<MeshData> meshes() {
  return rc::gen::exec([] {
    MeshData mesh;
    const auto count = *rc::gen::inRange<std::uint32_t>(1, 200);
    for (std::uint32_t v = 0; v < count; ++v) mesh.positions.push_back({static_cast<float>(v), 0, 0});  // tells v
    const auto index = rc::gen::inRange<std::uint32_t>(0, count);
    const auto triangles = *rc::gen::inRange<std::size_t>(0, 25);
    for (std::size_t t = 0; t < triangles; ++t) mesh.triangles.push_back({{*index, *index, *index}});
    return mesh;
  });
}

RC_GTEST_PROP(ComponentsProps, agreeWithABreadthFirstSearch, ()) {
  const MeshData mesh = *meshes();
  const auto parts = pgl::scene::split_components(mesh);

  std::vector<std::set<std::size_t>> expected;  // triangles
  std::set<std::size_t> seen;
  for (std::size_t start = 0; start < mesh.triangles.size(); ++start) {
    if (!seen.insert(start).second) continue;
    std::set<std::size_t> component{start};
    std::deque<std::size_t> queue{start};
    while (!queue.empty()) {
      const auto& t = mesh.triangles[queue.front()].v;
      queue.pop_front();
      for (std::size_t other = 0; other < mesh.triangles.size(); ++other) {
        const auto& o = mesh.triangles[other].v;
        const bool touches = std::find_first_of(std::begin(t), std::end(t), std::begin(o), std::end(o)) != std::end(t);
        if (touches && seen.insert(other).second) {
          component.insert(other);
          queue.push_back(other);
        }
      }
    }
    expected.push_back(component);
  }
  RC_CLASSIFY(expected.size() > 1, "several components");

  RC_ASSERT(parts.size() == expected.size());
  for (std::size_t c = 0; c < parts.size(); ++c) {
    const MeshData& part = parts[c];
    RC_ASSERT(part.triangles.size() == expected[c].size());
    std::set<std::uint32_t> used;
    std::size_t at = 0;
    for (const std::size_t t : expected[c]) {
      for (int corner = 0; corner < 3; ++corner) {
        const std::uint32_t original = mesh.triangles[t].v[corner];
        RC_ASSERT(part.positions.at(part.triangles[at].v[corner]) == mesh.positions[original]);
        used.insert(original);
      }
      ++at;
    }
    RC_ASSERT(part.positions.size() == used.size());
    RC_ASSERT(std::is_sorted(part.positions.begin(), part.positions.end(),
                             [](const glm::vec3& a, const glm::vec3& b) { return a.x < b.x; }));
  }
}

}  // namespace
