// SPDX-License-Identifier: MIT
// The plain form of a scene before preprocessing: triangle meshes, and objects that place them.
#pragma once

#include <cstdint>
#include <functional>
#include <string_view>
#include <vector>

#include "pgl/types.hpp"

namespace pgl::scene {

/// Triangles over positions; indices are local and 0-based. Nothing is implied about order, sharing or manifoldness.
struct MeshData {
  std::vector<glm::vec3> positions;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
};

/// Objects that place meshes; Object::mesh indexes `meshes`, and several objects may share one.
struct Scene {
  std::vector<MeshData> meshes;
  std::vector<pgl::Object> objects;
};

/// Told now and then during long work, always on the calling thread: the step, and how much of it is done.
/// `total` is constant within a stage. May be empty. An exception thrown from it ends the work and reaches the caller.
using Progress = std::function<void(std::string_view stage, std::size_t done, std::size_t total)>;

}  // namespace pgl::scene
