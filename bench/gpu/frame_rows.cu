// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "bench.cuh"
#include "device_scene.cuh"
#include "host_frame.hpp"
#include "pgl/cuda/cull_frustum.cuh"
#include "pgl/cuda/distribute_budget.cuh"
#include "pgl/cuda/gather.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/prefix_sum.cuh"
#include "pgl/cuda/project.cuh"
#include "pgl/cuda/rearrange.cuh"
#include "pgl/cuda/reform.cuh"
#include "plain_reform.cuh"
#include "rows.hpp"

namespace pgl::bench {
namespace {

using Index = DeviceScene::Index;

/// The steps of a frame on the device, as HostFrame has them. The inputs of every step are the host's results at first,
/// so that each can be run alone.
struct DeviceFrame {
  DeviceFrame(const Bench& bench, const DeviceScene& of, const HostFrame& host)
      : scene(of),
        view(host.scene.view),
        options(host.options),
        in_view(bench.upload(host.in_view)),
        areas(bench.upload(host.areas)),
        depths(bench.upload(host.depths)),
        counts(bench.upload(host.counts)),
        triangle_counts(bench.upload(host.triangle_counts)),
        vertex_offsets(bench.upload(host.vertex_offsets)),
        triangle_offsets(bench.upload(host.triangle_offsets)),
        sums(bench.array<std::uint64_t>(host.sums.size())),
        totals(bench.array<BudgetTotals>(1)),
        triangles(bench.array<Triangle<std::uint32_t>>(host.drawn_triangles())),
        vertices(bench.array<PlacedVertex>(host.drawn_vertices())) {
    if (bench.host_only()) return;
    const std::uint32_t largest = std::ranges::max(host.scene.max_vertices);
    must(reform_workspace.reserve(host.scene.objects.size(), largest), "scratch");
  }

  cudaError_t cull(cudaStream_t stream) {
    return cuda::cull_frustum(scene.boxes.input(), view, in_view.view(), stream);
  }
  cudaError_t project(cudaStream_t stream) {
    return cuda::project(scene.boxes.input(), in_view.input(), view, areas.view(), depths.view(), {}, stream);
  }
  cudaError_t budget(cudaStream_t stream) {
    return cuda::distribute_budget(areas.input(), depths.input(), scene.min_vertices.input(),
                                   scene.max_vertices.input(), options, budget_workspace, counts.view(), totals.data(),
                                   stream);
  }
  cudaError_t lay_out(cudaStream_t stream) {
    return cuda::lay_out(counts.input(), scene.mesh_of_object.input(), scene.meshes.input(), scene.map.input(),
                         triangle_counts.view(), vertex_offsets.view(), triangle_offsets.view(), lay_out_workspace,
                         stream);
  }
  cudaError_t sum_counts(cudaStream_t stream) {
    return cuda::exclusive_sum<std::uint32_t>(counts.input(), sums.view(), sum_workspace, stream);
  }
  cudaError_t reform(cudaStream_t stream) {
    return cuda::reform<Index>(scene.meshes.input(), scene.objects.input(), scene.triangles.input(), scene.ecol.input(),
                               counts.input(), vertex_offsets.input(), triangle_offsets.input(), reform_workspace,
                               triangles.view(), stream);
  }
  cudaError_t reform_local(std::span<Triangle<Index>> out, cudaStream_t stream) {
    return cuda::reform_local<Index>(scene.meshes.input(), scene.objects.input(), scene.triangles.input(),
                                     scene.ecol.input(), counts.input(), triangle_offsets.input(), reform_workspace,
                                     out, stream);
  }
  cudaError_t gather(cudaStream_t stream) {
    return cuda::gather<PlacedVertex, glm::vec3>(scene.meshes.input(), scene.objects.input(), scene.vertices.input(),
                                                 counts.input(), vertex_offsets.input(), vertices.view(), stream);
  }
  cudaError_t select(cudaStream_t stream) {
    PGL_CUDA_TRY(cull(stream));
    PGL_CUDA_TRY(project(stream));
    PGL_CUDA_TRY(budget(stream));
    return lay_out(stream);
  }
  cudaError_t all(cudaStream_t stream) {
    PGL_CUDA_TRY(select(stream));
    PGL_CUDA_TRY(reform(stream));
    return gather(stream);
  }

  const DeviceScene& scene;
  View view;
  BudgetOptions options;
  DeviceArray<std::uint8_t> in_view;
  DeviceArray<float> areas, depths;
  DeviceArray<std::uint32_t> counts, triangle_counts;
  DeviceArray<std::uint64_t> vertex_offsets, triangle_offsets, sums;
  DeviceArray<BudgetTotals> totals;
  DeviceArray<Triangle<std::uint32_t>> triangles;
  DeviceArray<PlacedVertex> vertices;
  cuda::BudgetWorkspace budget_workspace;
  cuda::ScanWorkspace lay_out_workspace, sum_workspace;
  cuda::ReformWorkspace<Index> reform_workspace;
};

/// The least bytes of each step: every input that it needs read once, every output written once.
struct LeastBytes {
  std::uint64_t n, in_view, drawn, vertices, triangles, entries;

  LeastBytes(const HostFrame& f, const Chains& chains)
      : n(f.counts.size()),
        in_view(static_cast<std::uint64_t>(std::ranges::count(f.in_view, std::uint8_t{1}))),
        drawn(f.totals.objects),
        vertices(f.drawn_vertices()),
        triangles(f.drawn_triangles()),
        entries(chains.entries_read) {}

  /// A box in, a flag out.
  std::uint64_t cull() const { return n * (sizeof(Box) + 1); }
  /// A flag in, the boxes of those in view; area and depth out.
  std::uint64_t project() const { return n * (1 + 8) + in_view * sizeof(Box); }
  /// Area, depth, minimum and maximum in, a count out.
  std::uint64_t budget() const { return n * (4 + 4 + 4 + 4 + 4) + sizeof(BudgetTotals); }
  /// A count in, its triangles and two offsets out; of each drawn object its mesh and an entry of the map.
  std::uint64_t lay_out() const { return n * (4 + 4 + 8 + 8) + 16 + drawn * (4 + sizeof(Mesh) + 4); }
  /// A value in, an offset out.
  std::uint64_t sum() const { return n * (4 + 8) + 8; }
  /// Triangles in and out, the entries of ecol that are met; the offsets; of each drawn object what places it.
  std::uint64_t reform(std::size_t index, std::size_t out) const {
    return triangles * 3 * (index + out) + entries * index + (n + 1) * 8 +
           drawn * (sizeof(Object) + sizeof(Mesh) + 4 + 8);
  }
  /// Vertices in and out; the offsets; of each drawn object what places it.
  std::uint64_t gather() const {
    return vertices * (sizeof(glm::vec3) + sizeof(PlacedVertex)) + (n + 1) * 8 +
           drawn * (sizeof(Object) + sizeof(Mesh));
  }
  std::uint64_t select() const { return cull() + project() + budget() + lay_out(); }
  std::uint64_t all() const { return select() + reform(sizeof(Index), 4) + gather(); }
};

void describe(Bench& bench, const HostFrame& frame, const Chains& chains) {
  auto& figures = bench.report.figures;
  figures.emplace_back("budget", static_cast<double>(frame.options.budget));
  figures.emplace_back("objects_in_view", static_cast<double>(std::ranges::count(frame.in_view, std::uint8_t{1})));
  figures.emplace_back("objects_drawn", static_cast<double>(frame.totals.objects));
  figures.emplace_back("vertices_drawn", static_cast<double>(frame.drawn_vertices()));
  figures.emplace_back("triangles_drawn", static_cast<double>(frame.drawn_triangles()));
  figures.emplace_back("steps_per_corner", chains.mean);
  figures.emplace_back("steps_longest", static_cast<double>(chains.longest));
}

/// Rows of the peer: any grid will do, since it strides.
template <class I>
cudaError_t enqueue_plain(const DeviceScene& scene, const DeviceFrame& frame, const DeviceArray<Triangle<I>>& triangles,
                          const DeviceArray<I>& ecol, cudaStream_t stream) {
  return cuda::detail::run(plain_reform<I>, cuda::detail::blocks_for(frame.triangles.size(), 256), 0, stream,
                           scene.meshes.data(), scene.objects.data(), triangles.data(), ecol.data(),
                           frame.counts.data(), frame.vertex_offsets.data(), frame.triangle_offsets.data(),
                           scene.objects.size(), frame.triangles.data());
}

constexpr const char* plain_note = "the peer: one thread per triangle, a binary search each, chains followed";

void wide_rows(Bench& bench, const DeviceScene& scene, const HostFrame& host, DeviceFrame& device,
               const LeastBytes& bytes) {
  if (!bench.wants("reform/32 bit") && !bench.wants("plain reform/32 bit")) return;
  WideIndices wide(host.scene);
  const auto triangles = bench.upload(wide.triangles);
  const auto ecol = bench.upload(wide.ecol);
  cuda::ReformWorkspace<std::uint32_t> workspace;
  if (!bench.host_only()) {
    must(workspace.reserve(host.scene.objects.size(), std::ranges::max(host.scene.max_vertices)), "scratch");
  }
  const auto outputs = [&] { return std::vector{expect(device.triangles, host.triangles)}; };
  bench.row({.name = "reform/32 bit",
             .bytes = bytes.reform(4, 4),
             .enqueue =
                 [&](cudaStream_t stream) {
                   return cuda::reform<std::uint32_t>(scene.meshes.input(), scene.objects.input(), triangles.input(),
                                                      ecol.input(), device.counts.input(),
                                                      device.vertex_offsets.input(), device.triangle_offsets.input(),
                                                      workspace, device.triangles.view(), stream);
                 },
             .outputs = outputs,
             .host = [&] { wide.reform(host); }});
  bench.row({.name = "plain reform/32 bit",
             .bytes = bytes.reform(4, 4),
             .enqueue = [&](cudaStream_t stream) { return enqueue_plain(scene, device, triangles, ecol, stream); },
             .outputs = outputs,
             .note = plain_note});
}

}  // namespace

void frame_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload) {
  HostFrame host(scene, {.budget = workload.budget});
  const Chains chains = host.chains();
  describe(bench, host, chains);
  const LeastBytes bytes(host, chains);
  DeviceFrame device(bench, device_scene, host);
  const auto counts = [&](const DeviceFrame& d, const HostFrame& h) {
    return std::vector{expect(d.counts, h.counts), expect(d.totals, std::span(&h.totals, 1))};
  };
  const auto layout = [&] {
    return std::vector{expect(device.triangle_counts, host.triangle_counts),
                       expect(device.vertex_offsets, host.vertex_offsets),
                       expect(device.triangle_offsets, host.triangle_offsets)};
  };
  const auto buffers = [&](const DeviceFrame& d, const HostFrame& h) {
    return std::vector{expect(d.counts, h.counts), expect(d.triangles, h.triangles), expect(d.vertices, h.vertices)};
  };

  bench.row({.name = "cull_frustum",
             .bytes = bytes.cull(),
             .enqueue = [&](cudaStream_t stream) { return device.cull(stream); },
             .outputs = [&] { return std::vector{expect(device.in_view, host.in_view)}; },
             .host = [&] { host.cull(); }});
  bench.row({.name = "project",
             .bytes = bytes.project(),
             .enqueue = [&](cudaStream_t stream) { return device.project(stream); },
             .outputs =
                 [&] {
                   return std::vector{expect(device.areas, host.areas), expect(device.depths, host.depths)};
                 },
             .host = [&] { host.project(); }});
  bench.row({.name = "distribute_budget/exact",
             .bytes = bytes.budget(),
             .enqueue = [&](cudaStream_t stream) { return device.budget(stream); },
             .outputs = [&] { return counts(device, host); },
             .host = [&] { host.budget(); }});
  bench.row({.name = "cull_frustum + distribute_budget",
             .bytes = bytes.cull() + bytes.budget(),
             .enqueue =
                 [&](cudaStream_t stream) {
                   PGL_CUDA_TRY(device.cull(stream));
                   return device.budget(stream);
                 },
             .outputs =
                 [&] {
                   auto all = counts(device, host);
                   all.push_back(expect(device.in_view, host.in_view));
                   return all;
                 },
             .host =
                 [&] {
                   host.cull();
                   host.budget();
                 },
             .target_ms = workload.target(0.25)});
  bench.row({.name = "lay_out",
             .bytes = bytes.lay_out(),
             .enqueue = [&](cudaStream_t stream) { return device.lay_out(stream); },
             .outputs = layout,
             .host = [&] { host.lay_out(); }});
  bench.row({.name = "cull_frustum + project + distribute_budget + lay_out",
             .bytes = bytes.select(),
             .enqueue = [&](cudaStream_t stream) { return device.select(stream); },
             .outputs =
                 [&] {
                   auto all = layout();
                   all.push_back(expect(device.counts, host.counts));
                   return all;
                 },
             .host =
                 [&] {
                   host.cull();
                   host.project();
                   host.budget();
                   host.lay_out();
                 }});
  bench.row({.name = "exclusive_sum",
             .bytes = bytes.sum(),
             .enqueue = [&](cudaStream_t stream) { return device.sum_counts(stream); },
             .outputs = [&] { return std::vector{expect(device.sums, host.sums)}; },
             .host = [&] { host.sum_counts(); }});
  bench.row({.name = "reform/16 bit",
             .bytes = bytes.reform(sizeof(Index), 4),
             .enqueue = [&](cudaStream_t stream) { return device.reform(stream); },
             .outputs = [&] { return std::vector{expect(device.triangles, host.triangles)}; },
             .host = [&] { host.reform(); },
             .target_ms = workload.target(0.25 * static_cast<double>(host.drawn_triangles()) / 15.8e6),
             .note = "the aim is 0.25 ms for 15.8 million triangles, here in proportion"});
  bench.row({.name = "plain reform/16 bit",
             .bytes = bytes.reform(sizeof(Index), 4),
             .enqueue =
                 [&](cudaStream_t stream) {
                   return enqueue_plain(device_scene, device, device_scene.triangles, device_scene.ecol, stream);
                 },
             .outputs = [&] { return std::vector{expect(device.triangles, host.triangles)}; },
             .note = plain_note});
  if (bench.wants("reform_local/16 bit")) {
    const auto out = bench.array<Triangle<Index>>(host.drawn_triangles());
    bench.row({.name = "reform_local/16 bit",
               .bytes = bytes.reform(sizeof(Index), sizeof(Index)),
               .enqueue = [&](cudaStream_t stream) { return device.reform_local(out.view(), stream); },
               .outputs = [&] { return std::vector{expect(out, host.local_triangles)}; },
               .host = [&] { host.reform_local(); }});
  }
  bench.row({.name = "gather",
             .bytes = bytes.gather(),
             .enqueue = [&](cudaStream_t stream) { return device.gather(stream); },
             .outputs = [&] { return std::vector{expect(device.vertices, host.vertices)}; },
             .host = [&] { host.gather(); }});
  bench.row({.name = "frame/exact",
             .bytes = bytes.all(),
             .enqueue = [&](cudaStream_t stream) { return device.all(stream); },
             .outputs = [&] { return buffers(device, host); },
             .host = [&] { host.all(); },
             .note = "all steps from culling to the two buffers, 16-bit indices"});
  wide_rows(bench, device_scene, host, device, bytes);

  if (!bench.wants("distribute_budget/fair") && !bench.wants("frame/fair")) return;
  HostFrame fair(scene, {.budget = workload.budget, .policy = BudgetPolicy::fair});
  const LeastBytes fair_bytes(fair, fair.chains());
  DeviceFrame fair_device(bench, device_scene, fair);
  const std::string drawn = "draws " + std::to_string(fair.totals.objects) + " objects, " +
                            std::to_string(fair.drawn_triangles()) + " triangles";
  bench.row({.name = "distribute_budget/fair",
             .bytes = fair_bytes.budget(),
             .enqueue = [&](cudaStream_t stream) { return fair_device.budget(stream); },
             .outputs = [&] { return counts(fair_device, fair); },
             .host = [&] { fair.budget(); }});
  bench.row({.name = "reform/16 bit/fair",
             .bytes = fair_bytes.reform(sizeof(Index), 4),
             .enqueue = [&](cudaStream_t stream) { return fair_device.reform(stream); },
             .outputs = [&] { return std::vector{expect(fair_device.triangles, fair.triangles)}; },
             .host = [&] { fair.reform(); },
             .note = drawn});
  bench.row({.name = "frame/fair",
             .bytes = fair_bytes.all(),
             .enqueue = [&](cudaStream_t stream) { return fair_device.all(stream); },
             .outputs = [&] { return buffers(fair_device, fair); },
             .host = [&] { fair.all(); },
             .note = drawn});
}

void rearrange_rows(Bench& bench, const Model& model) {
  if (!bench.wants("rearrange")) return;
  const Meshes<Index>& meshes = model.meshes;
  const std::uint64_t vertices = meshes.positions.size(), triangles = meshes.triangles.size();
  const auto ranges = bench.upload(meshes.ranges);
  const auto positions = bench.upload(meshes.positions);
  const auto corners = bench.upload(meshes.triangles);
  const auto ecol = bench.upload(model.order.ecol);
  const auto permute_v = bench.upload(model.order.permute_v);
  const auto permute_t = bench.upload(model.order.permute_t);
  const auto out_vertices = bench.array<glm::vec3>(vertices);
  const auto out_triangles = bench.array<Triangle<Index>>(triangles);
  const auto out_ecol = bench.array<Index>(vertices);
  bench.row({.name = "rearrange",
             // Vertices, targets and triangles in and out, both permutations and the ranges in.
             .bytes = vertices * 2 * (sizeof(glm::vec3) + sizeof(Index)) + vertices * sizeof(Index) +
                      triangles * (2 * 3 * sizeof(Index) + 4) + meshes.ranges.size() * sizeof(MeshRange),
             .enqueue =
                 [&](cudaStream_t stream) {
                   return cuda::rearrange<glm::vec3, Index>(
                       ranges.input(), positions.input(), corners.input(), ecol.input(), permute_v.input(),
                       permute_t.input(), out_vertices.view(), out_triangles.view(), out_ecol.view(), stream);
                 },
             .outputs =
                 [&] {
                   return std::vector{expect(out_vertices, model.arranged.vertices),
                                      expect(out_triangles, model.arranged.triangles),
                                      expect(out_ecol, model.arranged.ecol)};
                 },
             .host = [&] { arrange(meshes, model.order, model.arranged); },
             .note = "the whole model at once"});
}

}  // namespace pgl::bench
