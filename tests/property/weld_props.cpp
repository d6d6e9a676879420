// SPDX-License-Identifier: MIT
// Properties of vertex welding, against comparing every vertex with every other.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "scene/weld.hpp"

namespace {

using pgl::scene::MeshData;

/// Few different coordinates, so that positions often coincide.
rc::Gen<MeshData> meshes() {
  return rc::gen::exec([] {
    const auto coordinate = rc::gen::element(0.0f, -0.0f, 1.0f, -1.0f, 1e30f, std::numeric_limits<float>::denorm_min());
    MeshData mesh;
    const auto count = *rc::gen::inRange<std::size_t>(0, 40);
    for (std::size_t v = 0; v < count; ++v) mesh.positions.push_back({*coordinate, *coordinate, *coordinate});
    if (count == 0) return mesh;
    const auto index = rc::gen::inRange<std::uint32_t>(0, static_cast<std::uint32_t>(count));
    const auto triangles = *rc::gen::inRange<std::size_t>(0, 30);
    for (std::size_t t = 0; t < triangles; ++t) mesh.triangles.push_back({{*index, *index, *index}});
    return mesh;
  });
}

RC_GTEST_PROP(WeldProps, agreesWithComparingAllPairs, ()) {
  const MeshData before = *meshes();
  MeshData after = before;
  const auto counts = pgl::scene::weld(after);

  // The first used vertex at each place, by float comparison (which takes -0 for 0).
  std::set<std::uint32_t> used;
  for (const auto& t : before.triangles) used.insert(std::begin(t.v), std::end(t.v));
  const auto first_at = [&](std::uint32_t v) {
    return *std::find_if(used.begin(), used.end(),
                         [&](std::uint32_t u) { return before.positions[u] == before.positions[v]; });
  };
  std::vector<std::uint32_t> survivors;
  for (const std::uint32_t v : used)
    if (first_at(v) == v) survivors.push_back(v);

  RC_ASSERT(after.positions.size() == survivors.size());
  for (std::size_t k = 0; k < survivors.size(); ++k) RC_ASSERT(after.positions[k] == before.positions[survivors[k]]);
  RC_ASSERT(after.triangles.size() == before.triangles.size());
  std::uint64_t degenerate = 0;
  for (std::size_t t = 0; t < before.triangles.size(); ++t) {
    for (int corner = 0; corner < 3; ++corner)
      RC_ASSERT(survivors[after.triangles[t].v[corner]] == first_at(before.triangles[t].v[corner]));
    degenerate += std::set<std::uint32_t>(std::begin(after.triangles[t].v), std::end(after.triangles[t].v)).size() < 3;
  }
  RC_ASSERT(counts.merged == used.size() - survivors.size());
  RC_ASSERT(counts.unreferenced == before.positions.size() - used.size());
  RC_ASSERT(counts.degenerate == degenerate);
}

RC_GTEST_PROP(WeldProps, changesNothingTheSecondTime, ()) {
  MeshData once = *meshes();
  pgl::scene::weld(once);
  MeshData twice = once;
  const auto counts = pgl::scene::weld(twice);
  RC_ASSERT(counts.merged == 0u && counts.unreferenced == 0u);
  RC_ASSERT(twice.positions == once.positions);
  RC_ASSERT(twice.triangles == once.triangles);
}

}  // namespace
