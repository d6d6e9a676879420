// SPDX-License-Identifier: MIT
// Oriented boxes of meshes and how compact the meshes are, on the CPU.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/oriented_box.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

namespace detail {

/// One mesh's box and compactness.
template <class Index>
OrientedBox oriented_box(std::span<const glm::vec3> positions, std::span<const Triangle<Index>> triangles,
                         float& compactness) {
  using namespace pgl::detail;
  compactness = 0.0f;
  std::array<Extreme, box_points> extremes;
  for (std::size_t i = 0; i < positions.size(); ++i)
    extend_extremes(extremes.data(), positions[i], static_cast<std::uint32_t>(i));
  if (extremes[0].vertex == Extreme::no_vertex) return OrientedBox{};

  // The extreme points, from the first of them.
  const Vector<double> origin(positions[extremes[0].vertex]);
  std::array<Vector<double>, box_points> points;
  for (int i = 0; i < box_points; ++i) points[i] = difference(Vector<double>(positions[extremes[i].vertex]), origin);

  const AreaScale scale = area_scale(extent_of(extremes.data()), static_cast<std::uint32_t>(triangles.size()));
  std::uint64_t units = 0;
  Extreme largest{0.0, Extreme::no_vertex};  // by triangle
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const Triangle<Index>& triangle = triangles[t];
    PGL_ASSERT(triangle.v[0] < positions.size() && triangle.v[1] < positions.size() &&
               triangle.v[2] < positions.size());
    const double key = triangle_key(positions[triangle.v[0]], positions[triangle.v[1]], positions[triangle.v[2]]);
    units += area_units(key, scale);
    if (key > largest.reach) largest = {key, static_cast<std::uint32_t>(t)};
  }

  BoxCorners corners;
  for (int c = 0; c < 3; ++c)
    corners.largest[c] = largest.vertex == Extreme::no_vertex
                             ? points[0]
                             : difference(Vector<double>(positions[triangles[largest.vertex].v[c]]), origin);
  find_box_corners(points.data(), corners);

  BoxAxes best = coordinate_axes();
  double least = box_cost(points.data(), best);
  for (int number = 1; number < box_candidates; ++number) {
    const BoxAxes axes = candidate_axes(corners, number);
    const double cost = box_cost(points.data(), axes);
    if (cost < least) {
      least = cost;
      best = axes;
    }
  }
  std::array<FloatAxes, box_finalists> finalists;
  finalists[0] = finalists[1] = rounded(best);
  for (int number = 0; number < box_searches; ++number) {
    BoxSearch search = search_start(points.data(), best, number);
    for (int step = 0; step < box_search_steps; ++step) {
      double costs[box_turns];
      for (int turn = 0; turn < box_turns; ++turn) costs[turn] = box_cost(points.data(), turned(search, turn));
      search = advance(search, costs);
    }
    if (search.cost < least) {
      least = search.cost;
      finalists[1] = rounded(search.axes);
    }
  }
  for (int edge = 0; edge < largest_triangle_axes; ++edge)
    finalists[2 + edge] = rounded(candidate_axes(corners, 1 + edge));

  std::array<Reach, 3 * box_finalists> reaches;
  for (const glm::vec3& p : positions) {
    if (!is_finite_point(p)) continue;
    for (int i = 0; i < 3 * box_finalists; ++i)
      reaches[i] = with(reaches[i], reach_along(finalists[i / 3].axis[i % 3], p));
  }
  const OrientedBox box = best_box(extremes.data(), finalists.data(), reaches.data());
  compactness = compactness_of(box, units, scale);
  return box;
}

}  // namespace detail

/// Writes an oriented box around each mesh, and how compact the mesh is. Once per model.
///
/// boxes[m] holds every vertex of mesh m with finite coordinates (exactly, see OrientedBox); others are ignored, as in
/// bounds, and no finite vertex gives the empty box. It is not always the least: its surface was at most 1.15 times the
/// least one's on the shapes that the tests try, and a box-shaped mesh gets its own box up to rounding.
///
/// compactness[m], from 0 to 1, is the area of the mesh's triangles over the surface of its box, at most 1: our reading
/// of [Peng13] Eq 4.1. For a flat box (third side at most 2^-12 of the first) it is the area over that of one side of
/// the box, so that a wall of one layer of triangles is as compact as it looks. Triangles with a vertex that is not
/// finite count as nothing; no area, or no surface, is 0. Each triangle's area is rounded to a unit, so that the sum of
/// a mesh's n is exact in 64 bits: between n / 2^62 and n / 2^61 of the square of what the sides of the mesh's
/// axis-aligned box add up to. That is nothing to speak of up to 2^24 triangles, a percent or two at 2^28 of equal
/// size, and all at 2^31.
///
/// meshes, vertices, triangles, map: in, the model's; boxes, compactness: out, one per mesh. Precondition: a mesh's
/// triangles have indices below its max_vertices. Calls for parts of the meshes give the same as one for all.
/// O(vertices + triangles), parallel over the meshes, allocates nothing; the same bits for any number of threads.
/// Source: our reading of [Peng13] 4.2.1; the box after Larsson and Källberg, Fast computation of tight-fitting
/// oriented bounding boxes, 2011.
template <class Index>
void oriented_boxes(std::span<const Mesh> meshes, std::span<const glm::vec3> vertices,
                    std::span<const Triangle<Index>> triangles, std::span<const std::uint32_t> map,
                    std::span<OrientedBox> boxes, std::span<float> compactness) {
  PGL_ASSERT(boxes.size() == meshes.size() && compactness.size() == meshes.size());
  parallel_for(meshes.size(), 8, [&](std::size_t m) {
    const Mesh& mesh = meshes[m];
    boxes[m] = detail::oriented_box(
        vertices.subspan(mesh.first_vertex, mesh.max_vertices),
        triangles.subspan(mesh.first_triangle, triangles_at(mesh, map.data(), mesh.max_vertices)), compactness[m]);
  });
}

}  // namespace pgl::host
