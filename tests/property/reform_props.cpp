// SPDX-License-Identifier: MIT
#include <gmpxx.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "pgl/host/reform.hpp"
#include "support/block.hpp"
#include "support/random_collapse.hpp"
#include "support/random_scene.hpp"

namespace {

/// RapidCheck chooses, and can so make a failing case smaller.
std::uint32_t choose(std::uint32_t least, std::uint32_t most) {
  return *rc::gen::inRange<std::uint64_t>(least, std::uint64_t{most} + 1);
}

template <class Index>
void equals_sequential_collapse() {
  const auto mesh = test::any_collapsing_mesh<Index>(choose);
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
  const auto s = test::random_scene<Index>(choose);
  pgl::host::ReformWorkspace<Index> workspace;
  std::vector<pgl::Triangle<Index>> local(s.local.size());
  std::vector<pgl::Triangle<std::uint32_t>> global(s.global.size());
  pgl::host::reform_local<Index>(s.meshes, s.objects, s.triangles, s.ecol, s.counts, s.triangle_offsets, workspace,
                                 local);
  pgl::host::reform<Index>(s.meshes, s.objects, s.triangles, s.ecol, s.counts, s.vertex_offsets, s.triangle_offsets,
                           workspace, global);
  RC_ASSERT(local == s.local);
  RC_ASSERT(global == s.global);

  const auto block = test::block_of(s.meshes, s.objects, &pgl::Mesh::first_triangle, s.triangles, s.triangle_offsets,
                                    pgl::Triangle<Index>{{0, 0, 0}});
  global.assign(s.global.size(), {});
  pgl::host::reform_block<Index>(s.meshes, s.objects, block, s.ecol, s.counts, s.vertex_offsets, s.triangle_offsets,
                                 workspace, global);
  RC_ASSERT(global == s.global);
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
