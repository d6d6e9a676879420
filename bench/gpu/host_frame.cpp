// SPDX-License-Identifier: MIT
#include "host_frame.hpp"

#include <algorithm>

#include "pgl/host/bounds.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/gather.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/reform.hpp"
#include "scene/plant.hpp"
#include "viewer/camera.hpp"

namespace pgl::bench {

Scene scene_of(const Meshes<std::uint16_t>& meshes, const Order<std::uint16_t>& order,
               const Arranged<std::uint16_t>& arranged, std::size_t objects) {
  Scene s;
  s.meshes = meshes_of(meshes, order);
  const std::size_t n = s.meshes.size();
  s.objects.resize(n);
  s.mesh_of_object.resize(n);
  s.min_vertices.resize(n);
  s.max_vertices.resize(n);
  s.boxes.resize(n);
  s.vertices = arranged.vertices.input();
  s.triangles = arranged.triangles.input();
  s.ecol = arranged.ecol.input();
  s.map = order.map.input();
  std::vector<Box> mesh_boxes(n);
  host::parallel_for(n, 64, [&](std::size_t i) {
    s.objects[i].mesh = s.mesh_of_object[i] = static_cast<std::uint32_t>(i);
    mesh_boxes[i] = host::bounds(s.vertices.subspan(s.meshes[i].first_vertex, s.meshes[i].max_vertices));
  });
  host::object_bounds(s.objects, mesh_boxes, s.boxes);
  host::vertex_limits(s.mesh_of_object, s.meshes, s.map, 0, s.min_vertices, s.max_vertices);

  Box all;
  for (const Box& box : s.boxes) {
    all.min = glm::min(all.min, box.min);
    all.max = glm::max(all.max, box.max);
  }
  const scene::PlantCamera plant = scene::plant_camera({.objects = objects});
  const viewer::Camera camera{plant.position, plant.target, plant.up, glm::degrees(double{plant.vertical_fov})};
  s.view = viewer::view_of(camera, all, 1280, 720);
  return s;
}

struct HostFrame::Workspaces {
  host::BudgetWorkspace budget;
  host::ReformWorkspace<std::uint16_t> reform;
};
struct WideIndices::Workspace {
  host::ReformWorkspace<std::uint32_t> reform;
};

HostFrame::HostFrame(const Scene& of, BudgetOptions with)
    : scene(of), options(with), workspaces_(std::make_shared<Workspaces>()) {
  const std::size_t n = scene.objects.size();
  options.near_depth = scene.view.near_depth;
  options.viewport_area = scene.view.width * scene.view.height;
  in_view.resize(n);
  areas.resize(n);
  depths.resize(n);
  counts.resize(n);
  triangle_counts.resize(n);
  for (auto* offsets : {&vertex_offsets, &triangle_offsets, &sums}) offsets->resize(n + 1);
  cull();
  project();
  budget();
  lay_out();
  sum_counts();
  vertices.resize(drawn_vertices());
  triangles.resize(drawn_triangles());
  reform();
  gather();
}

void HostFrame::cull() {
  host::cull_frustum(scene.boxes, scene.view, in_view);
}
void HostFrame::project() {
  host::project(scene.boxes, in_view, scene.view, areas, depths);
}
void HostFrame::budget() {
  totals = host::distribute_budget(areas, depths, scene.min_vertices, scene.max_vertices, options, workspaces_->budget,
                                   counts);
}
void HostFrame::lay_out() {
  host::lay_out(counts, scene.mesh_of_object, scene.meshes, scene.map, triangle_counts, vertex_offsets,
                triangle_offsets);
}
void HostFrame::sum_counts() {
  host::exclusive_sum<std::uint32_t>(counts, sums);
}
void HostFrame::reform() {
  host::reform<std::uint16_t>(scene.meshes, scene.objects, scene.triangles, scene.ecol, counts, vertex_offsets,
                              triangle_offsets, workspaces_->reform, triangles);
}
void HostFrame::reform_local() {
  local_triangles.resize(drawn_triangles());
  host::reform_local<std::uint16_t>(scene.meshes, scene.objects, scene.triangles, scene.ecol, counts, triangle_offsets,
                                    workspaces_->reform, local_triangles);
}
void HostFrame::gather() {
  host::gather<PlacedVertex, glm::vec3>(scene.meshes, scene.objects, scene.vertices, counts, vertex_offsets, vertices);
}
void HostFrame::all() {
  cull();
  project();
  budget();
  lay_out();
  reform();
  gather();
}

Chains HostFrame::chains() const {
  struct Part {
    std::uint64_t steps = 0, longest = 0, entries = 0;
    std::vector<std::uint8_t> met;
  };
  std::vector<Part> parts(host::thread_count());
  host::parallel_for(counts.size(), 64, [&](std::size_t i) {
    if (counts[i] == 0) return;
    Part& part = parts[host::thread_index()];
    const Mesh& mesh = scene.meshes[scene.objects[i].mesh];
    part.met.assign(mesh.max_vertices, 0);
    for (const auto& t : scene.triangles.subspan(mesh.first_triangle, triangle_counts[i])) {
      for (std::uint32_t v : t.v) {
        std::uint64_t steps = 0;
        for (; v >= counts[i]; ++steps) {
          part.met[v] = 1;
          v = scene.ecol[mesh.first_vertex + v];
        }
        part.steps += steps;
        part.longest = std::max(part.longest, steps);
      }
    }
    part.entries += static_cast<std::uint64_t>(std::ranges::count(part.met, std::uint8_t{1}));
  });
  Chains chains;
  std::uint64_t steps = 0;
  for (const Part& part : parts) {
    steps += part.steps;
    chains.longest = std::max(chains.longest, part.longest);
    chains.entries_read += part.entries;
  }
  if (drawn_triangles() > 0) {
    chains.mean = static_cast<double>(steps) / (3.0 * static_cast<double>(drawn_triangles()));
  }
  return chains;
}

WideIndices::WideIndices(const Scene& scene)
    : triangles(scene.triangles.size()), ecol(scene.ecol.size()), workspace_(std::make_shared<Workspace>()) {
  constexpr std::size_t part = 1 << 16;
  host::parallel_for((triangles.size() + part - 1) / part, 1, [&](std::size_t p) {
    for (std::size_t t = p * part; t < std::min(triangles.size(), (p + 1) * part); ++t) {
      for (int c = 0; c < 3; ++c) triangles[t].v[c] = scene.triangles[t].v[c];
    }
  });
  host::parallel_for((ecol.size() + part - 1) / part, 1, [&](std::size_t p) {
    for (std::size_t v = p * part; v < std::min(ecol.size(), (p + 1) * part); ++v) {
      ecol[v] = scene.ecol[v] == no_target<std::uint16_t> ? no_target<std::uint32_t> : scene.ecol[v];
    }
  });
}

void WideIndices::reform(const HostFrame& frame) {
  const Scene& s = frame.scene;
  out.resize(frame.drawn_triangles());
  host::reform<std::uint32_t>(s.meshes, s.objects, triangles.input(), ecol.input(), frame.counts, frame.vertex_offsets,
                              frame.triangle_offsets, workspace_->reform, out);
}

}  // namespace pgl::bench
