// SPDX-License-Identifier: MIT
#include "host_occlusion.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>

#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/oriented_box.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/select_occluders.hpp"
#include "viewer/camera.hpp"

namespace pgl::bench {

using Index = std::uint16_t;

struct OccluderModel::Workspace {
  host::OccluderWorkspace occluders;
};

OccluderModel::OccluderModel(const Scene& of) : scene(of), workspace_(std::make_shared<Workspace>()) {
  boxes.resize(scene.meshes.size());
  compactness.resize(scene.meshes.size());
  faces.resize(scene.objects.size());
  order.resize(scene.objects.size());
  const auto start = std::chrono::steady_clock::now();
  oriented_boxes();
  oriented_boxes_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  occluder_faces();
  compactness_order();
}

void OccluderModel::oriented_boxes() {
  host::oriented_boxes<Index>(scene.meshes, scene.vertices, scene.triangles, scene.map, boxes, compactness);
}
void OccluderModel::sample_oriented_boxes() {
  host::parallel_for(samples(), 8, [&](std::size_t s) {
    const std::size_t m = s * sample_step;
    host::oriented_boxes<Index>(std::span(scene.meshes).subspan(m, 1), scene.vertices, scene.triangles, scene.map,
                                std::span(boxes).subspan(m, 1), std::span(compactness).subspan(m, 1));
  });
}
void OccluderModel::occluder_faces() {
  host::occluder_faces(scene.objects, boxes, compactness, faces);
}
void OccluderModel::compactness_order() {
  host::compactness_order(faces, workspace_->occluders, order);
}

View view_from(Stand stand, const Scene& scene, std::uint32_t side) {
  Box all;
  for (const Box& box : scene.boxes) {
    all.min = glm::min(all.min, box.min);
    all.max = glm::max(all.max, box.max);
  }
  viewer::Camera camera{{all.min.x - 3.0, all.min.y - 3.0, 1.8}, {}, {0.0, 0.0, 1.0}, 90.0};
  glm::dvec3 ahead(1.0, 1.0, 0.1);
  if (stand == Stand::inside) {
    constexpr double street = 52.0;  // from one to the next
    const double rows = std::floor((all.max.y - all.min.y) * 0.7 / street);
    camera.eye = {0.5 * (all.min.x + all.max.x) + 0.5, all.min.y + rows * street + 5.2, 1.8};
    ahead = {1.0, 0.6, 0.05};
  }
  camera.target = camera.eye + ahead;
  return viewer::view_of(camera, all, static_cast<int>(side), static_cast<int>(side));
}

struct HostOcclusion::Workspaces {
  host::OccluderWorkspace occluders;
  host::DepthWorkspace depth;
};

HostOcclusion::HostOcclusion(const OccluderModel& of, const View& from, std::size_t count)
    : model(of), view(from), size(depth_map_of(from)), workspaces_(std::make_shared<Workspaces>()) {
  const std::size_t n = model.scene.objects.size();
  in_view.resize(n);
  visible.resize(n);
  occluders.resize(count);
  others.resize(count);
  by_index.resize(n);
  std::iota(by_index.begin(), by_index.end(), 0u);
  hzm.resize(hzm_texels(size));
  all();
  select_occluders_by_index();
}

void HostOcclusion::cull_frustum() {
  host::cull_frustum(model.scene.boxes, view, in_view);
}
void HostOcclusion::select_occluders() {
  host::select_occluders(model.order, model.faces, in_view, view, workspaces_->occluders, occluders);
}
void HostOcclusion::select_occluders_by_index() {
  host::select_occluders(by_index, model.faces, in_view, view, workspaces_->occluders, others);
}
void HostOcclusion::rasterize_depth() {
  const Scene& s = model.scene;
  const std::span<Depth> texels = depth();
  constexpr std::size_t part = 1 << 16;
  host::parallel_for((texels.size() + part - 1) / part, 1, [&](std::size_t p) {
    std::fill(texels.begin() + static_cast<std::ptrdiff_t>(p * part),
              texels.begin() + static_cast<std::ptrdiff_t>(std::min(texels.size(), (p + 1) * part)), far_depth);
  });
  host::rasterize_depth<Index>(s.meshes, s.objects, s.vertices, s.triangles, s.map, occluders, view, size,
                               workspaces_->depth, texels);
}
void HostOcclusion::build_hzm() {
  host::build_hzm(size, hzm);
}
void HostOcclusion::cull_occluded(std::uint32_t refinement) {
  host::cull_occluded(model.scene.boxes, in_view, occluders, view, size, hzm, refinement, visible);
}
void HostOcclusion::all() {
  cull_frustum();
  select_occluders();
  rasterize_depth();
  build_hzm();
  cull_occluded();
}

}  // namespace pgl::bench
