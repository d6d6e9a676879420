// SPDX-License-Identifier: MIT
// Screen areas and depths of all objects, on the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/project.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Writes what each object in view covers: its rectangle's area in square pixels and its nearest depth (clip w), the
/// A and D of [Peng13] Eq 2.3; on request also the rectangle.
///
/// areas[i] is in [0, width * height] and finite, depths[i] is finite and at least view.near_depth (see project).
/// Where in_view[i] is 0 the area is 0, the depth near_depth and the rectangle empty. An empty `in_view` means all.
/// Preconditions: areas and depths, and in_view and rectangles where not empty, have one element per box; those of
/// project on the view. O(n), allocates nothing; the same bits for any number of threads.
inline void project(std::span<const Box> boxes, std::span<const std::uint8_t> in_view, const View& view,
                    std::span<float> areas, std::span<float> depths, std::span<ScreenBox> rectangles = {}) {
  PGL_ASSERT(in_view.empty() || in_view.size() == boxes.size());
  PGL_ASSERT(areas.size() == boxes.size() && depths.size() == boxes.size());
  PGL_ASSERT(rectangles.empty() || rectangles.size() == boxes.size());
  const pgl::detail::ViewRows rows = pgl::detail::rows_of(view);
  parallel_for(boxes.size(), 1024, [&](std::size_t i) {
    const bool skip = !in_view.empty() && in_view[i] == 0;
    const ScreenBox rectangle = pgl::detail::project(skip ? Box{} : boxes[i], rows);
    areas[i] = projected_area(rectangle);
    depths[i] = rectangle.depth;
    if (!rectangles.empty()) rectangles[i] = rectangle;
  });
}

}  // namespace pgl::host
