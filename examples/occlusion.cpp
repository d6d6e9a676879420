// SPDX-License-Identifier: MIT
// Occlusion culling: of a thousand boxes behind a wall, those that cannot be seen are dropped before anything is drawn.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <numeric>
#include <vector>

#include <glm/gtc/matrix_transform.hpp>

#include "pgl/host/bounds.hpp"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/oriented_box.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/select_occluders.hpp"

using Index = std::uint16_t;

int main() {
  // Once per model: one mesh, a cube; a thousand small ones in rows, and one made into a wall with a gap below.
  std::vector<glm::vec3> vertices;
  for (int i = 0; i < 8; ++i) vertices.emplace_back(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1);
  const std::vector<pgl::Triangle<Index>> triangles{
      {{0, 2, 1}}, {{1, 2, 3}}, {{4, 5, 6}}, {{5, 7, 6}}, {{0, 1, 4}}, {{1, 5, 4}},
      {{2, 6, 3}}, {{3, 6, 7}}, {{0, 4, 2}}, {{2, 4, 6}}, {{1, 3, 5}}, {{3, 7, 5}},
  };
  const std::vector<pgl::Mesh> meshes{{.min_vertices = 8, .max_vertices = 8}};
  const std::vector<std::uint32_t> map{12};
  std::vector<pgl::Object> objects(1001);
  for (std::size_t i = 0; i < 1000; ++i)
    objects[i].transform[3] =
        glm::vec3(4.0f * float(i % 10) - 18, 4.0f * float(i / 10 % 10) - 18, -4.0f * float(i / 100));
  objects[1000].transform =
      glm::mat4x3(glm::vec3(30, 0, 0), glm::vec3(0, 18, 0), glm::vec3(0, 0, 0.1f), glm::vec3(0, 5, 10));
  const std::size_t n = objects.size();
  const std::vector<pgl::Box> mesh_boxes{pgl::host::bounds(vertices)};
  std::vector<pgl::Box> boxes(n);
  pgl::host::object_bounds(objects, mesh_boxes, boxes);

  std::vector<pgl::OrientedBox> oriented(meshes.size());
  std::vector<float> compactness(meshes.size());
  pgl::host::oriented_boxes<Index>(meshes, vertices, triangles, map, oriented, compactness);
  std::vector<pgl::OccluderFace> faces(n);
  pgl::host::occluder_faces(objects, oriented, compactness, faces);
  pgl::host::OccluderWorkspace occluder_workspace;
  std::vector<std::uint32_t> order(n);
  pgl::host::compactness_order(faces, occluder_workspace, order);
  const auto candidates = std::span<const std::uint32_t>(order).first(pgl::host::compact_objects(faces, order, 0.5f));

  // Every frame.
  pgl::View view;
  view.width = 1280, view.height = 720, view.near_depth = 0.1f;
  view.clip_from_world = glm::perspective(1.0f, view.width / view.height, view.near_depth, 1e4f) *
                         glm::lookAt(glm::vec3(0, 0, 40), glm::vec3(0, 0, 0), glm::vec3(0, 1, 0));
  std::vector<std::uint8_t> in_view(n), visible(n);
  pgl::host::cull_frustum(boxes, view, in_view);
  std::vector<std::uint32_t> occluders(4);
  pgl::host::select_occluders(candidates, faces, in_view, view, occluder_workspace, occluders);

  const pgl::DepthMap size = pgl::depth_map_of(view);
  std::vector<pgl::Depth> depths(pgl::hzm_texels(size), pgl::far_depth);
  pgl::host::DepthWorkspace depth_workspace;
  pgl::host::rasterize_depth<Index>(meshes, objects, vertices, triangles, map, occluders, view, size, depth_workspace,
                                    std::span(depths).first(std::size_t{size.width} * size.height));
  pgl::host::build_hzm(size, depths);
  pgl::host::cull_occluded(boxes, in_view, occluders, view, size, depths, 0, visible);

  const auto count = [](const std::vector<std::uint8_t>& flags) {
    return std::accumulate(flags.begin(), flags.end(), 0);
  };
  const bool wall = std::find(occluders.begin(), occluders.end(), 1000u) != occluders.end();
  std::printf("%zu objects, %d in view, %d may be seen; the wall is %s of the four occluders\n", n, count(in_view),
              count(visible), wall ? "one" : "none");
  // `visible` takes the place of in_view in project and distribute_budget: see frame.cpp.
  return count(visible) < count(in_view) / 2 ? 0 : 1;
}
