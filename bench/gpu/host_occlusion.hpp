// SPDX-License-Identifier: MIT
// Occlusion culling of the plant on the host, step by step: what the device must equal, and what it is timed against.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "host_frame.hpp"
#include "pgl/cull_occluded.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"

namespace pgl::bench {

/// What is found once of a model, to choose occluders from.
struct OccluderModel {
  explicit OccluderModel(const Scene& scene);

  void oriented_boxes();         ///< of all meshes
  void sample_oriented_boxes();  ///< of every sample_step-th mesh
  void occluder_faces();
  void compactness_order();

  static constexpr std::size_t sample_step = 17;
  std::size_t samples() const { return (scene.meshes.size() + sample_step - 1) / sample_step; }

  const Scene& scene;
  std::vector<OrientedBox> boxes;
  std::vector<float> compactness;
  std::vector<OccluderFace> faces;
  std::vector<std::uint32_t> order;  ///< by compactness
  double oriented_boxes_ms = 0;      ///< what oriented_boxes took, on all cores

 private:
  struct Workspace;  // the drivers' headers stay out of device code
  std::shared_ptr<Workspace> workspace_;
};

/// Square pictures from the height of a person: from just outside a corner of the plant, with all of it in view, and
/// from a bay in its midst, where what is near fills most of the picture.
enum class Stand { corner, inside };
View view_from(Stand stand, const Scene& scene, std::uint32_t side);

/// The steps of occlusion culling in the order in which they must run for the first time; each may then be repeated.
/// Candidates for occluders are all objects, by compactness.
struct HostOcclusion {
  HostOcclusion(const OccluderModel& model, const View& view, std::size_t occluders);

  void cull_frustum();
  void select_occluders();
  void select_occluders_by_index();  ///< writes others: the candidates by index
  void rasterize_depth();            ///< the map is emptied before
  void build_hzm();
  void cull_occluded(std::uint32_t refinement = 0);
  void all();

  std::span<Depth> depth() { return std::span(hzm).first(std::size_t{size.width} * size.height); }

  const OccluderModel& model;
  View view;
  DepthMap size;
  std::vector<std::uint8_t> in_view, visible;
  std::vector<std::uint32_t> occluders, others, by_index;
  std::vector<Depth> hzm;

 private:
  struct Workspaces;
  std::shared_ptr<Workspaces> workspaces_;
};

}  // namespace pgl::bench
