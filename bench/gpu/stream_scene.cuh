// SPDX-License-Identifier: MIT
// The steps of a streamed frame on the device.
#pragma once

#include <cstdint>
#include <span>

#include "bench.cuh"
#include "device_scene.cuh"
#include "pgl/cuda/cull_frustum.cuh"
#include "pgl/cuda/distribute_budget.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/limit_transfer.cuh"
#include "pgl/cuda/project.cuh"
#include "pgl/distribute_budget.hpp"
#include "pgl/limit_transfer.hpp"

namespace pgl::bench {

/// Selects on the device as Selector does on the host.
struct DeviceSelector {
  DeviceSelector(const Bench& bench, const DeviceScene& of)
      : scene(of),
        in_view(bench.array<std::uint8_t>(of.boxes.size())),
        areas(bench.array<float>(of.boxes.size())),
        depths(bench.array<float>(of.boxes.size())),
        totals(bench.array<BudgetTotals>(1)),
        transfer_totals(bench.array<TransferTotals>(1)) {}

  cudaError_t want(const View& view, const BudgetOptions& options, std::span<std::uint32_t> counts,
                   cudaStream_t stream) {
    PGL_CUDA_TRY(cuda::cull_frustum(scene.boxes.input(), view, in_view.view(), stream));
    PGL_CUDA_TRY(cuda::project(scene.boxes.input(), in_view.input(), view, areas.view(), depths.view(), {}, stream));
    return cuda::distribute_budget(areas.input(), depths.input(), scene.min_vertices.input(),
                                   scene.max_vertices.input(), options, budget_workspace, counts, totals.data(),
                                   stream);
  }
  /// counts: in and out.
  cudaError_t limit(std::span<const float> with_areas, std::span<const float> with_depths, const BudgetOptions& options,
                    std::span<const std::uint32_t> wanted, std::span<const std::uint32_t> previous,
                    const TransferOptions& transfer, std::span<std::uint32_t> counts, cudaStream_t stream) {
    return cuda::limit_transfer(with_areas, with_depths, scene.min_vertices.input(), scene.max_vertices.input(),
                                options, wanted, previous, scene.mesh_of_object.input(), scene.meshes.input(),
                                scene.map.input(), transfer, transfer_workspace, counts, transfer_totals.data(),
                                stream);
  }
  cudaError_t lay_out(std::span<const std::uint32_t> counts, std::span<std::uint32_t> triangle_counts,
                      std::span<std::uint64_t> vertex_offsets, std::span<std::uint64_t> triangle_offsets,
                      cudaStream_t stream) {
    return cuda::lay_out(counts, scene.mesh_of_object.input(), scene.meshes.input(), scene.map.input(), triangle_counts,
                         vertex_offsets, triangle_offsets, lay_out_workspace, stream);
  }

  const DeviceScene& scene;
  DeviceArray<std::uint8_t> in_view;
  DeviceArray<float> areas, depths;
  DeviceArray<BudgetTotals> totals;
  DeviceArray<TransferTotals> transfer_totals;
  cuda::BudgetWorkspace budget_workspace;
  cuda::TransferWorkspace transfer_workspace;
  cuda::ScanWorkspace lay_out_workspace;
};

}  // namespace pgl::bench
