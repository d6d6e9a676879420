// SPDX-License-Identifier: MIT
// Selects every object's vertex count by its error on the screen, on the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/select_by_error.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

using pgl::BudgetTotals;

/// Bounds how much each object's transform enlarges an error of its mesh (see error_scale): once at load, and again for
/// objects that turn or are scaled.
/// objects: in, n of them. scales: out, n. O(n), in parallel; allocates nothing; the same bits for any number of
/// threads.
inline void error_scales(std::span<const Object> objects, std::span<float> scales) {
  PGL_ASSERT(scales.size() == objects.size());
  parallel_for(objects.size(), 1024, [&](std::size_t i) { scales[i] = error_scale(objects[i].transform); });
}

/// Selects for each object in view the coarsest prefix of its mesh whose recorded geometric error projects to at most
/// options.threshold pixels, wherever it is in the object's box (quality mode of [NC07], our reading). Nothing limits
/// the sum.
///
/// An error e of a mesh, in its units, takes at most e * scale * pixels_per_unit(view) / depth pixels on the screen:
/// see the top of pgl/select_by_error.hpp for why this never says too little. It errs to the other side by at most the
/// obliqueness at the viewport's corners, the depth of the object's box, and a factor of 1.32 for a sheared transform.
/// What the recorded error itself means is said at build_ecol: a root mean square, not a bound.
///
/// - areas, depths: n each, as project writes them; an object with an area of 0 (not in view) or below options.pet
///   gets 0;
/// - min_vertices, max_vertices: n ranges that the counts are in, see vertex_limits;
/// - scales: n, see error_scales; mesh_of_object: n indices into meshes;
/// - errors: beside the model's map, entry for entry: the error at each count of each mesh (those that build_ecol
///   writes, from the mesh's min_vertices on);
/// - counts: out, n, overlapping nothing else.
/// Returns how many objects have a count above 0, and the sum of the counts. Preconditions: those of vertices_by_error,
/// error_view_of. O(n log vertices), in parallel; allocates nothing; the same for any number of threads.
inline BudgetTotals select_by_error(std::span<const float> areas, std::span<const float> depths,
                                    std::span<const std::uint32_t> min_vertices,
                                    std::span<const std::uint32_t> max_vertices, std::span<const float> scales,
                                    std::span<const std::uint32_t> mesh_of_object, std::span<const Mesh> meshes,
                                    std::span<const float> errors, const View& view, const ErrorOptions& options,
                                    std::span<std::uint32_t> counts) {
  const std::size_t n = areas.size();
  PGL_ASSERT(depths.size() == n && min_vertices.size() == n && max_vertices.size() == n && scales.size() == n);
  PGL_ASSERT(mesh_of_object.size() == n && counts.size() == n);
  const ErrorView limits = error_view_of(view, options);
  return detail::sum_blocks(n, detail::block_count(n), [&](std::size_t, std::size_t begin, std::size_t end) {
    BudgetTotals part;
    for (std::size_t i = begin; i < end; ++i) {
      PGL_ASSERT(min_vertices[i] <= max_vertices[i]);
      counts[i] = is_seen(areas[i], depths[i], limits)
                      ? vertices_by_error(depths[i], min_vertices[i], max_vertices[i], scales[i],
                                          meshes[mesh_of_object[i]], errors.data(), limits)
                      : 0;
      part += {counts[i] > 0 ? 1u : 0u, counts[i]};
    }
    return part;
  });
}

}  // namespace pgl::host
