// SPDX-License-Identifier: MIT
// RapidCheck generator of meshes without any order.
#pragma once

#include <cstdint>

#include "support/meshes.hpp"
#include "support/numbers.hpp"

namespace test {

/// A mesh of any numbers: in space, in a plane or on a line, now and then with a vertex that is not finite.
inline TriangleMesh any_mesh() {
  TriangleMesh mesh;
  const numbers::Kind k = numbers::kind();
  const int flat = numbers::whole(0, 3), vertices = numbers::whole(0, 40);
  const bool all_finite = numbers::whole(0, 1) == 0;
  const glm::vec3 a = numbers::point(numbers::Kind::plain), b = numbers::point(numbers::Kind::plain),
                  c = numbers::point(k);
  for (int i = 0; i < vertices; ++i) {
    glm::vec3 p = numbers::point(k);
    if (flat == 1) p = c + a * numbers::number(numbers::Kind::plain) + b * numbers::number(numbers::Kind::plain);
    if (flat == 2) p = c + a * numbers::number(numbers::Kind::plain);
    if (!all_finite && numbers::whole(0, 5) == 0) p[numbers::whole(0, 2)] = numbers::any_number(k);
    mesh.positions.push_back(p);
  }
  for (int i = vertices > 0 ? numbers::whole(0, 60) : 0; i > 0; --i) {
    const auto corner = [&] { return static_cast<std::uint32_t>(numbers::whole(0, vertices - 1)); };
    mesh.triangles.push_back({{corner(), corner(), corner()}});
  }
  return mesh;
}

}  // namespace test
