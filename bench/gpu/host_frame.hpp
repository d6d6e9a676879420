// SPDX-License-Identifier: MIT
// One frame of the plant on the host, step by step: what the device must equal, and what it is timed against.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "pgl/distribute_budget.hpp"
#include "pgl/gather.hpp"
#include "pgl/types.hpp"
#include "plant.hpp"

namespace pgl::bench {

/// What every frame reads: the arranged plant, every object a mesh of its own at its place in the world.
struct Scene {
  std::vector<Mesh> meshes;
  std::vector<Object> objects;
  std::vector<std::uint32_t> mesh_of_object, min_vertices, max_vertices;
  std::vector<Box> boxes;
  std::span<const glm::vec3> vertices;
  std::span<const Triangle<std::uint16_t>> triangles;
  std::span<const std::uint16_t> ecol;
  std::span<const std::uint32_t> map;
  View view;
};

/// Sets up the scene with the viewer's overview camera on a picture of 1280 by 720. The arrays must outlive it.
Scene scene_of(const Meshes<std::uint16_t>& meshes, const Order<std::uint16_t>& order,
               const Arranged<std::uint16_t>& arranged, std::size_t objects);

/// Collapses followed to draw the frame.
struct Chains {
  double mean = 0;                 ///< steps per corner
  std::uint64_t longest = 0;       ///< steps
  std::uint64_t entries_read = 0;  ///< different entries of ecol met
};

/// The steps of a frame in the order in which they must run for the first time; each may then be repeated.
struct HostFrame {
  HostFrame(const Scene& scene, BudgetOptions options);

  void cull();
  void project();
  void budget();
  void lay_out();
  void sum_counts();
  void reform();
  void reform_local();
  void gather();
  void all();  ///< cull to gather; the arrays have their sizes already

  std::uint64_t drawn_vertices() const { return vertex_offsets.back(); }
  std::uint64_t drawn_triangles() const { return triangle_offsets.back(); }
  Chains chains() const;

  const Scene& scene;
  BudgetOptions options;
  std::vector<std::uint8_t> in_view;
  std::vector<float> areas, depths;
  std::vector<std::uint32_t> counts, triangle_counts;
  std::vector<std::uint64_t> vertex_offsets, triangle_offsets, sums;
  BudgetTotals totals;
  std::vector<Triangle<std::uint32_t>> triangles;
  std::vector<Triangle<std::uint16_t>> local_triangles;
  std::vector<PlacedVertex> vertices;

 private:
  struct Workspaces;  // the drivers' headers stay out of device code
  std::shared_ptr<Workspaces> workspaces_;
};

/// The plant with 32-bit indices.
struct WideIndices {
  HostArray<Triangle<std::uint32_t>> triangles;
  HostArray<std::uint32_t> ecol;
  std::vector<Triangle<std::uint32_t>> out;

  explicit WideIndices(const Scene& scene);
  void reform(const HostFrame& frame);  ///< the frame must have been laid out

 private:
  struct Workspace;
  std::shared_ptr<Workspace> workspace_;
};

}  // namespace pgl::bench
