// SPDX-License-Identifier: MIT
// The rule of unify: one vertex count per object out of those that the tiles of a picture selected each on its own.
#pragma once

#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/distribute_budget.hpp"

namespace pgl {

/// Which of an object's counts all tiles draw ([NC07], our reading).
///
/// quality: the largest, so that no tile draws it coarser than it asked for.
/// performance: the smallest of the tiles that it touches, so that no tile draws more than it asked for.
enum class UnifyPolicy : std::uint8_t { quality, performance };

/// What unify compares for a tile's count of an object: the least (performance) or greatest (quality) key decides, and
/// unified_vertices makes a count of it again. So the order of the tiles does not matter, and several processes may
/// combine theirs by any reduction that has a minimum and a maximum.
///
/// A tile that the object does not touch leaves it to the others. Precondition: count < 2^32 - 1.
PGL_HD constexpr std::uint32_t unify_key(std::uint32_t count, bool touches, UnifyPolicy policy) {
  PGL_ASSERT(count != 0xffffffffu);
  if (policy == UnifyPolicy::quality) return touches ? count : 0;
  return touches ? count : 0xffffffffu;
}

/// The key of no tiles: combining with it changes nothing.
PGL_HD constexpr std::uint32_t no_unify_key(UnifyPolicy policy) {
  return policy == UnifyPolicy::quality ? 0 : 0xffffffffu;
}

/// Combines two keys; commutative and associative.
PGL_HD constexpr std::uint32_t combined_key(std::uint32_t a, std::uint32_t b, UnifyPolicy policy) {
  return (a > b) == (policy == UnifyPolicy::quality) ? a : b;
}

/// The count that a combined key stands for: 0 if no tile draws the object.
PGL_HD constexpr std::uint32_t unified_vertices(std::uint32_t key) {
  return key == 0xffffffffu ? 0 : key;
}

/// What a tile draws of an object.
PGL_HD constexpr std::uint32_t vertices_in_tile(std::uint32_t unified, bool touches) {
  return touches ? unified : 0;
}

}  // namespace pgl
