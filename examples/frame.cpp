// SPDX-License-Identifier: MIT
// One frame: a row of a thousand balls of one shared mesh, within a budget of 20 thousand vertices.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include <glm/gtc/matrix_transform.hpp>

#include "pgl/host/bounds.hpp"
#include "pgl/host/build_ecol.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/gather.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/rearrange.hpp"
#include "pgl/host/reform.hpp"

using Index = std::uint16_t;  // enough for meshes of 65 thousand vertices
using Triangle = pgl::Triangle<Index>;

namespace {

/// A ball of 24 x 46 vertices and two poles.
void ball(std::vector<glm::vec3>& positions, std::vector<Triangle>& triangles) {
  constexpr int rings = 24, around = 46;
  for (int i = 1; i <= rings; ++i)
    for (int j = 0; j < around; ++j) {
      const double u = M_PI * i / (rings + 1), v = 2 * M_PI * j / around;
      positions.emplace_back(std::sin(u) * std::cos(v), std::sin(u) * std::sin(v), std::cos(u));
    }
  positions.emplace_back(0, 0, 1);
  positions.emplace_back(0, 0, -1);
  const auto at = [](int i, int j) { return static_cast<Index>(i * around + j % around); };
  for (int j = 0; j < around; ++j) {
    triangles.push_back({{Index(rings * around), at(0, j), at(0, j + 1)}});
    for (int i = 0; i + 1 < rings; ++i) {
      triangles.push_back({{at(i, j), at(i + 1, j), at(i + 1, j + 1)}});
      triangles.push_back({{at(i, j), at(i + 1, j + 1), at(i, j + 1)}});
    }
    triangles.push_back({{Index(rings * around + 1), at(rings - 1, j + 1), at(rings - 1, j)}});
  }
}

}  // namespace

int main() {
  // Once per model: the mesh in collapse order, and where its objects are.
  std::vector<glm::vec3> positions;
  std::vector<Triangle> input;
  ball(positions, input);
  const std::size_t vertices_in = positions.size();
  std::vector<Index> ecol_in(vertices_in), place_v(vertices_in), ecol(vertices_in);
  std::vector<std::uint32_t> place_t(input.size()), levels(vertices_in + 1);
  pgl::host::EcolWorkspace<float> ecol_workspace;
  const auto least = pgl::host::build_ecol<float, Index>(positions, input, {}, {}, ecol_workspace, ecol_in, place_v,
                                                         place_t, levels, {});
  std::vector<glm::vec3> vertices(vertices_in);
  std::vector<Triangle> triangles(input.size());
  pgl::host::rearrange<glm::vec3, Index>(positions, input, ecol_in, place_v, place_t, vertices, triangles, ecol);

  const std::vector<pgl::Mesh> meshes{{.min_vertices = least, .max_vertices = static_cast<std::uint32_t>(vertices_in)}};
  const std::vector<std::uint32_t> map(levels.begin() + least, levels.end());
  std::vector<pgl::Object> objects(1000);
  for (std::size_t i = 0; i < objects.size(); ++i) objects[i].transform[3] = glm::vec3(3.0f * float(i), 0, 0);
  const std::vector<std::uint32_t> mesh_of_object(objects.size(), 0);
  const std::vector<pgl::Box> mesh_boxes{pgl::host::bounds(vertices)};
  std::vector<pgl::Box> boxes(objects.size());
  pgl::host::object_bounds(objects, mesh_boxes, boxes);

  // Every frame.
  pgl::View view;
  view.width = 1280, view.height = 720, view.near_depth = 0.1f;
  view.clip_from_world = glm::perspective(1.0f, view.width / view.height, view.near_depth, 1e4f) *
                         glm::lookAt(glm::vec3(-4, -3, 2), glm::vec3(30, 0, 0), glm::vec3(0, 0, 1));
  pgl::BudgetOptions options;
  options.budget = 20000;
  options.near_depth = view.near_depth;

  const std::size_t n = objects.size();
  std::vector<std::uint8_t> in_view(n);
  std::vector<float> areas(n), depths(n);
  std::vector<std::uint32_t> min_vertices(n), max_vertices(n), counts(n), triangle_counts(n);
  std::vector<std::uint64_t> vertex_offsets(n + 1), triangle_offsets(n + 1);
  pgl::host::BudgetWorkspace budget_workspace;
  pgl::host::ReformWorkspace<Index> reform_workspace;

  pgl::host::vertex_limits(mesh_of_object, meshes, map, 20, min_vertices, max_vertices);  // at least 20 triangles each
  pgl::host::cull_frustum(boxes, view, in_view);
  pgl::host::project(boxes, in_view, view, areas, depths);
  const auto drawn =
      pgl::host::distribute_budget(areas, depths, min_vertices, max_vertices, options, budget_workspace, counts);
  pgl::host::lay_out(counts, mesh_of_object, meshes, map, triangle_counts, vertex_offsets, triangle_offsets);
  std::vector<glm::vec3> vertex_buffer(vertex_offsets.back());
  std::vector<pgl::Triangle<std::uint32_t>> index_buffer(triangle_offsets.back());
  pgl::host::gather<glm::vec3, glm::vec3>(meshes, objects, vertices, counts, vertex_offsets, vertex_buffer);
  pgl::host::reform<Index>(meshes, objects, triangles, ecol, counts, vertex_offsets, triangle_offsets, reform_workspace,
                           index_buffer);

  std::printf("%llu of %zu objects, %zu vertices, %zu triangles in one draw call\n",
              static_cast<unsigned long long>(drawn.objects), n, vertex_buffer.size(), index_buffer.size());
  std::printf("the first ball has %u vertices, the hundredth %u, the last %u\n", counts[0], counts[99], counts[999]);
  return vertex_buffer.size() <= options.budget ? 0 : 1;
}
