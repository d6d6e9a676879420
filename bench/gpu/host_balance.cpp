// SPDX-License-Identifier: MIT
#include "host_balance.hpp"

#include "pgl/host/balance.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/project.hpp"

namespace pgl::bench {

struct HostBalance::Workspace {
  host::BalanceWorkspace balance;
};

HostBalance::HostBalance(const Scene& scene, std::uint64_t budget)
    : width(static_cast<std::uint32_t>(scene.view.width)),
      height(static_cast<std::uint32_t>(scene.view.height)),
      rectangles(scene.objects.size()),
      loads(scene.objects.size()),
      flags(scene.objects.size()),
      workspace_(std::make_shared<Workspace>()) {
  const std::size_t n = scene.objects.size();
  std::vector<float> areas(n), depths(n);
  std::vector<std::uint32_t> counts(n);
  std::vector<std::uint64_t> vertex_offsets(n + 1), triangle_offsets(n + 1);
  host::project(scene.boxes, {}, scene.view, areas, depths, rectangles);
  const BudgetOptions options{
      .budget = budget, .near_depth = scene.view.near_depth, .viewport_area = scene.view.width * scene.view.height};
  host::BudgetWorkspace budget_workspace;
  host::distribute_budget(areas, depths, scene.min_vertices, scene.max_vertices, options, budget_workspace, counts);
  host::lay_out(counts, scene.mesh_of_object, scene.meshes, scene.map, loads, vertex_offsets, triangle_offsets);
}

void HostBalance::balance(std::size_t gpus, const BalanceOptions& options) {
  weights.assign(gpus, 1);
  tiles.resize(gpus);
  tile_loads.resize(gpus);
  host::balance(rectangles, loads, width, height, weights, options, workspace_->balance, tiles, tile_loads);
}

void HostBalance::in_tile() {
  host::in_tile(rectangles, loads, tiles[0], flags);
}

}  // namespace pgl::bench
