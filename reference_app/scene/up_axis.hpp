// SPDX-License-Identifier: MIT
// Which axis of a model points up.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>

namespace pgl::scene {

/// The numbers are those of the model file.
enum class UpAxis : std::uint32_t { not_told, x, y, z };

/// The unit vector along the axis; y's where none is told.
inline glm::dvec3 direction_of(UpAxis up) {
  switch (up) {
    case UpAxis::x:
      return {1.0, 0.0, 0.0};
    case UpAxis::z:
      return {0.0, 0.0, 1.0};
    default:
      return {0.0, 1.0, 0.0};
  }
}

}  // namespace pgl::scene
