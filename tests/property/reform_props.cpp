// SPDX-License-Identifier: MIT
#include <gmpxx.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "pgl/host/reform.hpp"
#include "support/random_collapse.hpp"

namespace {

template <class Index>
test::CollapsingMesh<Index> any_mesh() {
  std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
  const auto vertices = *rc::gen::inRange<std::uint32_t>(1, 50);
  const auto triangles = *rc::gen::inRange<std::uint32_t>(0, 100);
  const auto collapses = *rc::gen::inRange<std::uint32_t>(0, vertices);
  const auto kind = *rc::gen::element(test::Collapses::anywhere, test::Collapses::along_edges,
                                      test::Collapses::one_chain, test::Collapses::one_star);
  return test::random_collapsing_mesh<Index>(random, vertices, triangles, collapses, kind);
}

template <class Index>
void equals_sequential_collapse() {
  const auto mesh = any_mesh<Index>();
  const auto arranged = test::rearranged(mesh);
  pgl::host::ReformWorkspace<Index> workspace;
  for (std::uint32_t count = mesh.min_vertices; count <= mesh.vertices(); ++count) {
    const std::uint32_t size = mesh.map[count - mesh.min_vertices];
    std::vector<pgl::Triangle<Index>> out(size);
    pgl::host::reform_mesh<Index>(std::span(arranged.triangles).first(size), arranged.ecol, count, workspace, out);
    RC_ASSERT(out == test::reformed_slowly(mesh, count));
  }
}
RC_GTEST_PROP(ReformProps, equalsSequentialCollapse16, ()) {
  equals_sequential_collapse<std::uint16_t>();
}
RC_GTEST_PROP(ReformProps, equalsSequentialCollapse32, ()) {
  equals_sequential_collapse<std::uint32_t>();
}

// Meshes shared by several objects, counts 0 or anywhere in range, mirrored or not; both kinds of indices.
template <class Index>
void puts_every_object_in_its_place() {
  std::vector<test::CollapsingMesh<Index>> sources(*rc::gen::inRange<std::size_t>(1, 4));
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Triangle<Index>> triangles;
  std::vector<Index> ecol;
  for (auto& source : sources) {
    source = any_mesh<Index>();
    meshes.push_back({.first_vertex = ecol.size(),
                      .first_triangle = triangles.size(),
                      .min_vertices = source.min_vertices,
                      .max_vertices = source.vertices()});
    const auto arranged = test::rearranged(source);
    triangles.insert(triangles.end(), arranged.triangles.begin(), arranged.triangles.end());
    ecol.insert(ecol.end(), arranged.ecol.begin(), arranged.ecol.end());
  }

  std::vector<pgl::Object> objects(*rc::gen::inRange<std::size_t>(0, 12));
  std::vector<std::uint32_t> counts;
  std::vector<std::uint64_t> vertex_offsets{0}, triangle_offsets{0};
  std::vector<pgl::Triangle<Index>> expected_local;
  std::vector<pgl::Triangle<std::uint32_t>> expected;
  for (auto& object : objects) {
    object.mesh = *rc::gen::inRange<std::uint32_t>(0, static_cast<std::uint32_t>(meshes.size()));
    const auto& source = sources[object.mesh];
    const auto mirror = *rc::gen::arbitrary<bool>();
    if (mirror) object.transform[1] = -object.transform[1];
    const bool shown = *rc::gen::inRange(0, 4) != 0;
    counts.push_back(shown ? *rc::gen::inRange(source.min_vertices, source.vertices() + 1) : 0);
    if (shown) {
      for (pgl::Triangle<Index> t : test::reformed_slowly(source, counts.back())) {
        if (mirror) std::swap(t.v[1], t.v[2]);
        expected_local.push_back(t);
        const auto first = static_cast<std::uint32_t>(vertex_offsets.back());
        expected.push_back({{first + t.v[0], first + t.v[1], first + t.v[2]}});
      }
    }
    vertex_offsets.push_back(vertex_offsets.back() + counts.back());
    triangle_offsets.push_back(expected.size());
  }

  pgl::host::ReformWorkspace<Index> workspace;
  std::vector<pgl::Triangle<Index>> local(expected.size());
  std::vector<pgl::Triangle<std::uint32_t>> global(expected.size());
  pgl::host::reform_local<Index>(meshes, objects, triangles, ecol, counts, triangle_offsets, workspace, local);
  pgl::host::reform<Index>(meshes, objects, triangles, ecol, counts, vertex_offsets, triangle_offsets, workspace,
                           global);
  RC_ASSERT(local == expected_local);
  RC_ASSERT(global == expected);
}
RC_GTEST_PROP(ReformProps, putsEveryObjectInItsPlace16, ()) {
  puts_every_object_in_its_place<std::uint16_t>();
}
RC_GTEST_PROP(ReformProps, putsEveryObjectInItsPlace32, ()) {
  puts_every_object_in_its_place<std::uint32_t>();
}

int exact_sign(const glm::mat4x3& m) {
  const auto e = [&](int column, int row) { return mpq_class(m[column][row]); };
  mpq_class determinant = 0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    determinant += e(0, i) * (e(1, j) * e(2, k) - e(2, j) * e(1, k));
  }
  return sgn(determinant);
}

float any_finite_float() {
  const auto bits = *rc::gen::arbitrary<std::uint32_t>();
  const float wild = std::bit_cast<float>(bits);
  const float tame = static_cast<float>(static_cast<std::int32_t>(bits % 7) - 3);
  return *rc::gen::arbitrary<bool>() || !std::isfinite(wild) ? tame : wild;
}

RC_GTEST_PROP(ReformProps, mirrorsWhereTheExactDeterminantIsNegative, ()) {
  glm::mat4x3 m{1.0f};
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) m[column][row] = any_finite_float();
  }
  RC_ASSERT(pgl::mirrored(m) == (exact_sign(m) < 0));
}

// The third column is a combination of the others, as well as float can tell, and then off by a few last places.
RC_GTEST_PROP(ReformProps, mirrorsExactlyNextToSingular, ()) {
  std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
  const auto number = [&] {
    return (static_cast<float>(random()) - 2e9f) * std::ldexp(1.0f, -static_cast<int>(random() % 100));
  };
  for (int i = 0; i < 50; ++i) {
    glm::mat4x3 m{1.0f};
    const float a = static_cast<float>(static_cast<int>(random() % 9) - 4), b = random() % 2 ? number() : 2.0f;
    for (int row = 0; row < 3; ++row) {
      m[0][row] = number();
      m[1][row] = number();
      m[2][row] = static_cast<float>(static_cast<double>(a) * m[0][row] + static_cast<double>(b) * m[1][row]);
    }
    if (random() % 2) m[random() % 3][static_cast<int>(random() % 3)] *= 1.0f + 0x1p-23f;
    RC_ASSERT(pgl::mirrored(m) == (exact_sign(m) < 0));
  }
}

}  // namespace
