// SPDX-License-Identifier: MIT
// Boxes of meshes and of placed objects, on the CPU.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "pgl/bounds.hpp"
#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Returns the least box of the positions.
///
/// Positions with a NaN or infinite coordinate are ignored. No finite position gives the empty box. Zeros come out as
/// +0. O(n), allocates nothing; the same bits for any order of the positions and any number of threads.
inline Box bounds(std::span<const glm::vec3> positions) {
  constexpr std::size_t most_parts = 64, part_size = 16384;
  const std::size_t n = positions.size();
  const std::size_t parts = n / part_size + 1 < most_parts ? n / part_size + 1 : most_parts;
  std::array<Box, most_parts> box;
  parallel_for(parts, 1, [&](std::size_t part) {
    Box b;
    for (std::size_t i = n / parts * part; i < (part + 1 == parts ? n : n / parts * (part + 1)); ++i)
      b = extend(b, positions[i]);
    box[part] = b;
  });
  for (std::size_t part = 1; part < parts; ++part) box[0] = merge(box[0], box[part]);
  return box[0];
}

/// Writes each object's world box: its mesh's box carried by its transform, rounded outwards (see transform).
///
/// `mesh_boxes` has one box per mesh, in the mesh's own space; `out` has one per object and may not overlap it.
/// Preconditions: out.size() == objects.size(); every object's mesh is below mesh_boxes.size().
/// O(objects), allocates nothing; the same bits for any number of threads.
inline void object_bounds(std::span<const Object> objects, std::span<const Box> mesh_boxes, std::span<Box> out) {
  PGL_ASSERT(out.size() == objects.size());
  parallel_for(objects.size(), 4096, [&](std::size_t i) {
    PGL_ASSERT(objects[i].mesh < mesh_boxes.size());
    out[i] = transform(mesh_boxes[objects[i].mesh], objects[i].transform);
  });
}

}  // namespace pgl::host
