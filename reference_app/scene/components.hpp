// SPDX-License-Identifier: MIT
// Splits a mesh into its connected components.
#pragma once

#include <vector>

#include "scene/mesh_data.hpp"

namespace pgl::scene {

/// Splits `mesh` into its connected components: triangles that share a vertex, directly or through others, stay
/// together.
///
/// Components come in the order of their first triangle; inside one, triangles and vertices keep their order. Vertices
/// that no triangle uses are dropped, so every component has a triangle; a mesh without triangles gives none. Sharing
/// is by index: weld first where corners merely coincide. Precondition: every index is below the number of positions.
/// Near-linear time; the result is unique.
std::vector<MeshData> split_components(const MeshData& mesh);

}  // namespace pgl::scene
