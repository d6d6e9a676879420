// SPDX-License-Identifier: MIT
// The rule of rearrange: how one triangle and one collapse target read after a mesh's vertices have new places.
#pragma once

#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// Renames the corners of a triangle. The order of the corners, and with it the winding, is kept.
/// permute_v[v] is the new place of vertex v; every corner must be within it.
template <class Index>
PGL_HD constexpr Triangle<Index> rearranged_triangle(const Triangle<Index>& triangle, const Index* permute_v) {
  return {{permute_v[triangle.v[0]], permute_v[triangle.v[1]], permute_v[triangle.v[2]]}};
}

/// Renames the target of a collapse; no_target stays no_target. A real target must be within permute_v.
template <class Index>
PGL_HD constexpr Index rearranged_target(Index target, const Index* permute_v) {
  return target == no_target<Index> ? target : permute_v[target];
}

}  // namespace pgl
