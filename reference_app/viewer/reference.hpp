// SPDX-License-Identifier: MIT
// The second picture: what a frame chose, seen from outside.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <vector>

#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/gather.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/reform.hpp"
#include "pgl/types.hpp"
#include "scene/model_view.hpp"
#include "viewer/buffers.hpp"
#include "viewer/frame.hpp"
#include "viewer/renderer.hpp"

namespace pgl::viewer {

/// Puts the model into the buffers as Renderer::draw_reference() wants it: occluders at full detail, as they were drawn
/// into the depth; what the frame draws at the frame's detail; objects outside the frustum with a share of 2,000,000
/// vertices as `outside` sees them. Objects in the frustum that the frame does not draw are left out. Returns the boxes
/// of those that are hidden. Throws std::runtime_error where 32-bit indices do not suffice.
template <class Index>
std::vector<Box> fill_reference(const FrameModel<Index>& from, const Selection& selection, const View& outside,
                                DrawBuffers& buffers) {
  const scene::ModelView<Index>& model = from.view;
  const std::size_t n = model.objects.size();
  std::vector<Box> hidden;
  std::vector<Role> roles(n, Role::drawn);
  std::vector<std::uint8_t> beside(n);
  for (std::size_t i = 0; i < n; ++i) {
    beside[i] = selection.in_view[i] == 0 ? 1 : 0;
    if (beside[i] != 0) roles[i] = Role::beside;
    if (selection.in_view[i] != 0 && selection.visible[i] == 0) hidden.push_back(model.object_boxes[i]);
  }

  std::vector<std::uint32_t> mesh_of_object(n), least(n), most(n), counts(n), triangle_counts(n);
  std::ranges::transform(model.objects, mesh_of_object.begin(), &Object::mesh);
  host::vertex_limits(mesh_of_object, model.meshes, model.map, 0, least, most);
  std::vector<float> areas(n), depths(n);
  host::project(model.object_boxes, beside, outside, areas, depths);
  BudgetOptions options;
  options.budget = 2'000'000;
  options.policy = BudgetPolicy::fair;
  options.near_depth = outside.near_depth;
  options.viewport_area = outside.width * outside.height;
  host::BudgetWorkspace budget_workspace;
  host::distribute_budget(areas, depths, least, most, options, budget_workspace, counts);
  for (std::size_t i = 0; i < n; ++i) {
    if (beside[i] == 0) counts[i] = selection.counts[i];
  }
  for (const std::uint32_t i : selection.occluders) {
    roles[i] = Role::occluder;
    counts[i] = most[i];
  }

  if (from.load) from.load(counts);
  std::vector<std::uint64_t> vertex_offsets(n + 1), triangle_offsets(n + 1);
  host::lay_out(counts, mesh_of_object, model.meshes, model.map, triangle_counts, vertex_offsets, triangle_offsets);
  if (vertex_offsets[n] > std::numeric_limits<std::uint32_t>::max()) {
    throw std::runtime_error("--reference: it has more vertices than 32-bit indices can tell apart: lower --budget");
  }
  std::vector<PlacedVertex> vertices(vertex_offsets[n]);
  std::vector<Triangle<std::uint32_t>> triangles(triangle_offsets[n]);
  host::ReformWorkspace<Index> reform_workspace;
  host::reform<Index>(model.meshes, model.objects, model.triangles, model.ecol, counts, vertex_offsets,
                      triangle_offsets, reform_workspace, triangles);
  host::gather<PlacedVertex, glm::vec3>(model.meshes, model.objects, model.vertices, counts, vertex_offsets, vertices);
  for (PlacedVertex& vertex : vertices) vertex.object = static_cast<std::uint32_t>(roles[vertex.object]);
  buffers.upload(vertices, triangles);
  return hidden;
}

}  // namespace pgl::viewer
