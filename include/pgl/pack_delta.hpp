// SPDX-License-Identifier: MIT
// The rule of pack_delta: which elements of an object a new selection needs that the one before did not.
#pragma once

#include <cstddef>
#include <cstdint>

#include "pgl/config.hpp"

namespace pgl {

/// The elements of one object that are new: [first, first + size) of its mesh. first only means something where size >
/// 0.
struct DeltaPart {
  std::uint64_t first = 0;
  std::uint64_t size = 0;
  friend constexpr bool operator==(const DeltaPart&, const DeltaPart&) = default;
};

/// How much a frame sends.
struct DeltaSize {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::uint64_t bytes = 0;  ///< of both
  friend constexpr bool operator==(const DeltaSize&, const DeltaSize&) = default;
};

/// Computes which elements of an object are new: those from its previous count up to its present one; none where it
/// shrank or stayed. [Peng13] 3.3.
///
/// Elements are the vertices or the triangles of a mesh, of which a selection always has a prefix.
/// previous_offsets, offsets: exclusive prefix sums of the counts of the last selection and of this one, over the same
/// objects; entries object and object + 1 are read. Preconditions: neither decreases.
PGL_HD constexpr DeltaPart delta_part(const std::uint64_t* previous_offsets, const std::uint64_t* offsets,
                                      std::size_t object) {
  PGL_ASSERT(previous_offsets[object] <= previous_offsets[object + 1] && offsets[object] <= offsets[object + 1]);
  const std::uint64_t before = previous_offsets[object + 1] - previous_offsets[object];
  const std::uint64_t now = offsets[object + 1] - offsets[object];
  return {before, now > before ? now - before : 0};
}

}  // namespace pgl
