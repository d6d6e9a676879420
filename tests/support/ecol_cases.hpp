// SPDX-License-Identifier: MIT
// Random inputs of build_ecol: closed, one-sided, open and non-manifold meshes, with options and lock masks.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <random>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "support/meshes.hpp"

namespace test {

enum class Kind { closed, one_sided, open, soup };

struct EcolCase {
  Kind kind = Kind::closed;
  TriangleMesh mesh;
  pgl::EcolOptions options;
  std::vector<std::uint8_t> locked;  ///< empty or one per vertex
  bool fine = false;                 ///< Real is double
};

/// Spheres and tori of any genus, glued together or side by side.
inline TriangleMesh closed_mesh(std::mt19937& rng) {
  const auto piece = [&]() -> TriangleMesh {
    switch (below(rng, 6)) {
      case 0:
        return tetrahedron();
      case 1:
        return octahedron();
      case 2:
        return bipyramid(3 + below(rng, 8));
      case 3:
        return sphere(1);
      default:
        return torus(4 + below(rng, 4), 3 + below(rng, 4));
    }
  };
  TriangleMesh mesh = piece();
  for (std::uint32_t more = below(rng, 4); more > 0; --more) {
    const TriangleMesh next = piece();
    mesh = below(rng, 4) == 0 ? beside(mesh, next)
                              : glued(mesh, next, below(rng, mesh.triangle_count()), below(rng, next.triangle_count()));
  }
  return mesh;
}

/// Grids, bands, fans and surfaces with holes.
inline TriangleMesh open_mesh(std::mt19937& rng) {
  switch (below(rng, 6)) {
    case 0:
      return grid(1 + below(rng, 7), 1 + below(rng, 7));
    case 1:
      return moebius_strip(4 + below(rng, 8), 1 + below(rng, 3));
    case 2:
      return fan(1 + below(rng, 12), false);
    case 3:
      return fan(3 + below(rng, 12), true);
    case 4:
      return punctured(grid(5, 5), rng, 1 + below(rng, 10));
    default:
      return punctured(closed_mesh(rng), rng, 1 + below(rng, 6));
  }
}

inline TriangleMesh soup_mesh(std::mt19937& rng) {
  switch (below(rng, 4)) {
    case 0:
      return two_tetrahedra(below(rng, 4));
    case 1: {  // a surface with some triangles doubled, some degenerate, some across
      TriangleMesh mesh = below(rng, 2) == 0 ? closed_mesh(rng) : open_mesh(rng);
      for (std::uint32_t i = below(rng, 8); i > 0 && !mesh.triangles.empty(); --i) {
        Corners t = mesh.triangles[below(rng, mesh.triangle_count())];
        if (below(rng, 2) == 0) t.v[below(rng, 3)] = below(rng, mesh.vertex_count());
        mesh.triangles.push_back(t);
      }
      return mesh;
    }
    case 2:  // edges of many triangles, few of them open
      return soup(rng, 4 + below(rng, 4), 6 + below(rng, 24));
    default:
      return soup(rng, 1 + below(rng, 30), 1 + below(rng, 60));
  }
}

inline TriangleMesh mesh_of(Kind kind, std::mt19937& rng) {
  switch (kind) {
    case Kind::closed:
      return closed_mesh(rng);
    case Kind::one_sided:
      return below(rng, 2) == 0 ? klein_bottle(4 + below(rng, 5), 4 + below(rng, 3))
                                : glued(klein_bottle(5, 4), closed_mesh(rng), below(rng, 40), 0);
    case Kind::open:
      return open_mesh(rng);
    default:
      return soup_mesh(rng);
  }
}

inline pgl::EcolOptions options_of(std::mt19937& rng) {
  const float penalties[] = {10.0f, 1.0f, 0.1f, 1000.0f};
  return {static_cast<pgl::CostMetric>(below(rng, 3)),
          below(rng, 2) == 0 ? pgl::BoundaryRule::locked : pgl::BoundaryRule::slide, below(rng, 3) != 0,
          below(rng, 3) == 0, penalties[below(rng, 4)]};
}

/// A random case of one of the kinds. Half of them are moved off their symmetric places, the others have many equal
/// costs; a third have a lock mask.
inline EcolCase random_ecol_case(std::uint32_t seed, std::initializer_list<Kind> kinds) {
  std::mt19937 rng(seed);
  EcolCase c;
  c.kind = kinds.begin()[below(rng, static_cast<std::uint32_t>(kinds.size()))];
  c.mesh = mesh_of(c.kind, rng);
  if (below(rng, 2) == 0) c.mesh = jittered(c.mesh, rng, 0.1f);
  if (below(rng, 2) == 0) c.mesh = shuffled(c.mesh, rng);
  c.options = options_of(rng);
  c.fine = below(rng, 3) == 0;
  if (below(rng, 3) == 0) {
    c.locked.resize(c.mesh.positions.size());
    for (auto& l : c.locked) l = static_cast<std::uint8_t>(below(rng, 5) == 0);
  }
  return c;
}

/// Makes a case's positions extreme: scaled by 1e-30 to 1e30, moved far away, flattened, all equal, or with NaN,
/// infinite and subnormal coordinates among them.
inline void make_extreme(EcolCase& c, std::mt19937& rng) {
  const std::uint32_t how = below(rng, 8);
  const float scales[] = {1e-30f, 1e-20f, 1e-6f, 1e6f, 1e20f, 1e30f};
  const float scale = scales[below(rng, 6)];
  for (glm::vec3& p : c.mesh.positions) {
    if (how <= 2) p *= scale;
    if (how == 2) p += glm::vec3(1e3f * scale);
    if (how == 3) p.z = 0;
    if (how == 4) p = {1, 2, 3};
    if (how >= 5 && below(rng, 10) == 0) {
      const float odd[] = {std::nanf(""), INFINITY, -INFINITY, 1e-42f, 3e38f, -0.0f};
      p[static_cast<int>(below(rng, 3))] = odd[how == 5 ? 3 + below(rng, 3) : below(rng, 6)];
    }
  }
}

}  // namespace test
