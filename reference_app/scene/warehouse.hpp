// SPDX-License-Identifier: MIT
// Lays many models out as one warehouse: on shelves, in racks, with aisles between them.
#pragma once

#include <span>
#include <vector>

#include "pgl/types.hpp"

namespace pgl::scene {

inline constexpr std::size_t warehouse_levels = 6;  ///< shelves above each other in a rack

/// Returns for each part, given by its box, how far to move it; z is up and the floor is z = 0.
///
/// Parts fill a shelf along x, a rack from below and the floor along y, in their order. Gaps on a shelf and the
/// clearance above one are a quarter of the parts' median width, aisles are as wide as the racks are deep on average,
/// and shelves are so long that the floor is about as wide as deep. The whole is centred on x = y = 0, and moved boxes
/// never overlap (but for rounding). Parts whose box is empty or not finite have no size; they are moved with the
/// others' order but from the origin. O(parts), with a logarithmic factor.
[[nodiscard]] std::vector<glm::vec3> lay_out_warehouse(std::span<const pgl::Box> parts);

}  // namespace pgl::scene
