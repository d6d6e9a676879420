// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/host/rearrange.hpp"
#include "support/random_collapse.hpp"

namespace {

template <class Index>
struct Case {
  test::CollapsingMesh<Index> mesh;
  std::vector<std::uint64_t> vertices;
  std::vector<std::uint64_t> out_vertices;
  std::vector<pgl::Triangle<Index>> out_triangles;
  std::vector<Index> out_ecol;
};

template <class Index>
Case<Index> rearranged_case() {
  std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
  const auto vertices = *rc::gen::inRange<std::uint32_t>(1, 60);
  const auto triangles = *rc::gen::inRange<std::uint32_t>(0, 120);
  const auto collapses = *rc::gen::inRange<std::uint32_t>(0, vertices);
  const auto kind = *rc::gen::element(test::Collapses::anywhere, test::Collapses::along_edges,
                                      test::Collapses::one_chain, test::Collapses::one_star);
  Case<Index> c{test::random_collapsing_mesh<Index>(random, vertices, triangles, collapses, kind), {}, {}, {}, {}};
  for (std::uint32_t v = 0; v < vertices; ++v) c.vertices.push_back(random());
  c.out_vertices.resize(c.mesh.ecol.size());
  c.out_ecol.resize(c.mesh.ecol.size());
  c.out_triangles.resize(c.mesh.triangles.size());
  pgl::host::rearrange<std::uint64_t, Index>(c.vertices, c.mesh.triangles, c.mesh.ecol, c.mesh.permute_v,
                                             c.mesh.permute_t, c.out_vertices, c.out_triangles, c.out_ecol);
  return c;
}

template <class Index>
void equals_the_list_of_who_comes_where() {
  const auto c = rearranged_case<Index>();
  const auto expected = test::rearranged(c.mesh);
  RC_ASSERT(c.out_triangles == expected.triangles);
  RC_ASSERT(c.out_ecol == expected.ecol);
  RC_ASSERT(pgl::host::is_permutation<Index>(c.mesh.permute_v));
  RC_ASSERT(pgl::host::is_permutation<std::uint32_t>(c.mesh.permute_t));
}
RC_GTEST_PROP(RearrangeProps, equalsTheListOfWhoComesWhere16, ()) {
  equals_the_list_of_who_comes_where<std::uint16_t>();
}
RC_GTEST_PROP(RearrangeProps, equalsTheListOfWhoComesWhere32, ()) {
  equals_the_list_of_who_comes_where<std::uint32_t>();
}

RC_GTEST_PROP(RearrangeProps, makesEveryTargetSmaller, ()) {
  const auto c = rearranged_case<std::uint16_t>();
  for (std::size_t v = 0; v < c.out_ecol.size(); ++v) {
    if (v < c.mesh.min_vertices) {
      RC_ASSERT(c.out_ecol[v] == pgl::no_target<std::uint16_t>);
    } else {
      RC_ASSERT(c.out_ecol[v] < v);
    }
  }
}

RC_GTEST_PROP(RearrangeProps, isUndoneByTheInversePermutation, ()) {
  using Index = std::uint32_t;
  const auto c = rearranged_case<Index>();
  std::vector<Index> inverse_v(c.mesh.permute_v.size());
  std::vector<std::uint32_t> inverse_t(c.mesh.permute_t.size());
  for (std::uint32_t v = 0; v < inverse_v.size(); ++v) inverse_v[c.mesh.permute_v[v]] = v;
  for (std::uint32_t t = 0; t < inverse_t.size(); ++t) inverse_t[c.mesh.permute_t[t]] = t;
  auto vertices = c.vertices;
  auto triangles = c.mesh.triangles;
  auto ecol = c.mesh.ecol;
  pgl::host::rearrange<std::uint64_t, Index>(c.out_vertices, c.out_triangles, c.out_ecol, inverse_v, inverse_t,
                                             vertices, triangles, ecol);
  RC_ASSERT(vertices == c.vertices);
  RC_ASSERT(triangles == c.mesh.triangles);
  RC_ASSERT(ecol == c.mesh.ecol);
}

RC_GTEST_PROP(RearrangeProps, keepsTheVerticesOfEveryTriangle, ()) {
  const auto c = rearranged_case<std::uint16_t>();
  for (std::size_t t = 0; t < c.mesh.triangles.size(); ++t) {
    const auto& before = c.mesh.triangles[t];
    const auto& after = c.out_triangles[c.mesh.permute_t[t]];
    for (int i = 0; i < 3; ++i) RC_ASSERT(c.out_vertices[after.v[i]] == c.vertices[before.v[i]]);
  }
}

}  // namespace
