// SPDX-License-Identifier: MIT
// Occlusion culling of all objects, on the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cull_occluded.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Marks the objects that may be seen: visible[i] = 1 where in_view[i] is not 0 and boxes[i] is not certainly hidden by
/// what is in the map (see is_hidden), and at the occluders; else 0. That is the potentially visible set, for project
/// and distribute_budget to take as their in_view.
///
/// boxes: those of the objects in the world. in_view: as cull_frustum gives it; `visible` may be the same array.
/// occluders: indices of objects, entries no_object are skipped; those whose depths are in the map stay visible.
/// hzm: the map that build_hzm gave for `size`, the depth_map_of the view. refinement: 0 for tests of 2 x 2 texels;
/// with more, objects that these cannot tell to be hidden get a finer test, so many levels down: it finds more, and
/// takes longer. Preconditions: in_view and visible have one element per box; the occluders are in view; hzm.size() is
/// hzm_texels(size); those of project on the view. O(n), allocates nothing; the same for any number of threads.
/// Source: [Peng13] 4.6.
inline void cull_occluded(std::span<const Box> boxes, std::span<const std::uint8_t> in_view,
                          std::span<const std::uint32_t> occluders, const View& view, const DepthMap& size,
                          std::span<const Depth> hzm, std::uint32_t refinement, std::span<std::uint8_t> visible) {
  PGL_ASSERT(in_view.size() == boxes.size() && visible.size() == boxes.size());
  PGL_ASSERT(size == depth_map_of(view, size.scale, size.coverage));
  PGL_ASSERT(hzm.size() == hzm_texels(size));
  const pgl::detail::ViewRows rows = pgl::detail::rows_of(view);
  const Hzm map = hzm_of(size, hzm.data());
  parallel_for(boxes.size(), 1024, [&](std::size_t i) {
    visible[i] = static_cast<std::uint8_t>(in_view[i] != 0 && !pgl::detail::is_hidden(boxes[i], rows, map, refinement));
  });
  for (const std::uint32_t occluder : occluders) {
    if (occluder == no_object) continue;
    PGL_ASSERT(occluder < boxes.size());
    visible[occluder] = 1;
  }
}

}  // namespace pgl::host
