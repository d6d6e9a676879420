// SPDX-License-Identifier: MIT
// Merges vertices at identical positions, so that triangle soups become connected surfaces.
#pragma once

#include <cstdint>

#include "scene/mesh_data.hpp"

namespace pgl::scene {

/// What weld did to one mesh.
struct WeldCounts {
  std::uint64_t merged = 0;        ///< referenced vertices that became another one
  std::uint64_t unreferenced = 0;  ///< vertices that no triangle used
  std::uint64_t degenerate = 0;    ///< triangles that repeat a vertex afterwards; they are kept
};

/// Merges the vertices of `mesh` that lie at identical positions and drops those that no triangle uses.
///
/// Identical means equal bits, with -0 equal to +0 (and written as +0); two NaNs merge when their bits agree. Vertices
/// keep the order of their first referenced occurrence by index; triangles keep their number, order and corner order.
/// Precondition: every index is below the number of positions, which is below 2^31.
/// Expected O(vertices + triangles) time; the result is unique.
WeldCounts weld(MeshData& mesh);

}  // namespace pgl::scene
