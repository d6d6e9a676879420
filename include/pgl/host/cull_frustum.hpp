// SPDX-License-Identifier: MIT
// View-frustum culling of all objects, on the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cull_frustum.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Marks the boxes that may be in view: in_view[i] = 1 where in_frustum(boxes[i], view), else 0.
///
/// Never 0 for a box with a point in the frustum (see in_frustum, also for empty, NaN and infinite boxes).
/// Precondition: in_view.size() == boxes.size(). O(n), allocates nothing; the same bits for any number of threads.
inline void cull_frustum(std::span<const Box> boxes, const View& view, std::span<std::uint8_t> in_view) {
  PGL_ASSERT(in_view.size() == boxes.size());
  const Frustum frustum = frustum_of(view);
  parallel_for(boxes.size(), 4096,
               [&](std::size_t i) { in_view[i] = static_cast<std::uint8_t>(in_frustum(boxes[i], frustum)); });
}

}  // namespace pgl::host
