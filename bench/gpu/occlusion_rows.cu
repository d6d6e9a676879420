// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench.cuh"
#include "device_scene.cuh"
#include "host_occlusion.hpp"
#include "pgl/cuda/build_hzm.cuh"
#include "pgl/cuda/cull_frustum.cuh"
#include "pgl/cuda/cull_occluded.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/oriented_box.cuh"
#include "pgl/cuda/rasterize_depth.cuh"
#include "pgl/cuda/select_occluders.cuh"
#include "rows.hpp"

namespace pgl::bench {
namespace {

using Index = DeviceScene::Index;

constexpr std::size_t occluder_count = 20;  ///< [Peng13] Table 4.4

/// What is found once of a model, on the device; the host's results at first.
struct DeviceOccluderModel {
  DeviceOccluderModel(const Bench& bench, const DeviceScene& of, const OccluderModel& host)
      : scene(of),
        boxes(bench.upload(host.boxes)),
        compactness(bench.upload(host.compactness)),
        faces(bench.upload(host.faces)),
        order(bench.upload(host.order)) {}

  cudaError_t oriented_boxes(cudaStream_t stream) const {
    return cuda::oriented_boxes<Index>(scene.meshes.input(), scene.vertices.input(), scene.triangles.input(),
                                       scene.map.input(), boxes.view(), compactness.view(), stream);
  }
  cudaError_t occluder_faces(cudaStream_t stream) const {
    return cuda::occluder_faces(scene.objects.input(), boxes.input(), compactness.input(), faces.view(), stream);
  }
  cudaError_t compactness_order(cudaStream_t stream) {
    return cuda::compactness_order(faces.input(), workspace, order.view(), stream);
  }

  const DeviceScene& scene;
  DeviceArray<OrientedBox> boxes;
  DeviceArray<float> compactness;
  DeviceArray<OccluderFace> faces;
  DeviceArray<std::uint32_t> order;
  cuda::OccluderWorkspace workspace;
};

/// The steps of occlusion culling on the device, as HostOcclusion has them; the host's results at first, so that each
/// can be run alone.
struct DeviceOcclusion {
  DeviceOcclusion(const Bench& bench, const DeviceOccluderModel& of, const HostOcclusion& host)
      : model(of),
        view(host.view),
        size(host.size),
        in_view(bench.upload(host.in_view)),
        visible(bench.upload(host.visible)),
        occluders(bench.upload(host.occluders)),
        others(bench.upload(host.others)),
        by_index(bench.upload(host.by_index)),
        hzm(bench.upload(host.hzm)) {}

  cudaError_t cull_frustum(cudaStream_t stream) const {
    return cuda::cull_frustum(model.scene.boxes.input(), view, in_view.view(), stream);
  }
  cudaError_t select_occluders(cudaStream_t stream) {
    return cuda::select_occluders(model.order.input(), model.faces.input(), in_view.input(), view, select_workspace,
                                  occluders.view(), stream);
  }
  cudaError_t select_occluders_by_index(cudaStream_t stream) {
    return cuda::select_occluders(by_index.input(), model.faces.input(), in_view.input(), view, select_workspace,
                                  others.view(), stream);
  }
  cudaError_t rasterize_depth(cudaStream_t stream) {
    const DeviceScene& s = model.scene;
    const std::span<Depth> depth = hzm.view().first(texels());
    PGL_CUDA_TRY(cudaMemsetAsync(depth.data(), 0xff, depth.size_bytes(), stream));  // far_depth
    return cuda::rasterize_depth<Index>(s.meshes.input(), s.objects.input(), s.vertices.input(), s.triangles.input(),
                                        s.map.input(), occluders.input(), view, size, depth_workspace, depth, stream);
  }
  cudaError_t build_hzm(cudaStream_t stream) const { return cuda::build_hzm(size, hzm.view(), stream); }
  cudaError_t cull_occluded(cudaStream_t stream, std::uint32_t refinement = 0) const {
    return cuda::cull_occluded(model.scene.boxes.input(), in_view.input(), occluders.input(), view, size, hzm.input(),
                               refinement, visible.view(), stream);
  }
  /// All but the depths.
  cudaError_t decide(cudaStream_t stream) {
    PGL_CUDA_TRY(select_occluders(stream));
    PGL_CUDA_TRY(build_hzm(stream));
    return cull_occluded(stream);
  }
  cudaError_t all(cudaStream_t stream) {
    PGL_CUDA_TRY(cull_frustum(stream));
    PGL_CUDA_TRY(select_occluders(stream));
    PGL_CUDA_TRY(rasterize_depth(stream));
    PGL_CUDA_TRY(build_hzm(stream));
    return cull_occluded(stream);
  }

  std::size_t texels() const { return std::size_t{size.width} * size.height; }
  /// Level 0 of the map, and the levels above it.
  Expected depth_of(const HostOcclusion& host) const { return {hzm.data(), host.hzm.data(), texels() * sizeof(Depth)}; }
  Expected levels_of(const HostOcclusion& host) const {
    return {hzm.data() + texels(), host.hzm.data() + texels(), (host.hzm.size() - texels()) * sizeof(Depth)};
  }

  const DeviceOccluderModel& model;
  View view;
  DepthMap size;
  DeviceArray<std::uint8_t> in_view, visible;
  DeviceArray<std::uint32_t> occluders, others, by_index;
  DeviceArray<Depth> hzm;
  cuda::OccluderWorkspace select_workspace;
  cuda::DepthWorkspace depth_workspace;
};

/// The least bytes of each step: every input that it needs read once, every output written once.
struct LeastOcclusionBytes {
  std::uint64_t n, in_view = 0, hidden = 0, occluders, vertices = 0, triangles = 0, texels, hzm;

  explicit LeastOcclusionBytes(const HostOcclusion& h)
      : n(h.in_view.size()),
        occluders(h.occluders.size()),
        texels(std::uint64_t{h.size.width} * h.size.height),
        hzm(h.hzm.size()) {
    for (std::size_t i = 0; i < n; ++i) {
      in_view += h.in_view[i];
      hidden += static_cast<std::uint64_t>(h.in_view[i] != 0 && h.visible[i] == 0);
    }
    const Scene& scene = h.model.scene;
    for (const std::uint32_t object : h.occluders) {
      if (object == no_object) continue;
      const Mesh& mesh = scene.meshes[scene.objects[object].mesh];
      vertices += mesh.max_vertices;
      triangles += triangles_at(mesh, scene.map.data(), mesh.max_vertices);
    }
  }

  /// A box in, a flag out.
  std::uint64_t cull_frustum() const { return n * (sizeof(Box) + 1); }
  /// A candidate and a flag in, the faces of those in view; the occluders out.
  std::uint64_t select() const { return n * (4 + 1) + in_view * sizeof(OccluderFace) + occluders * 4; }
  /// The occluders' vertices and triangles in, the map out.
  std::uint64_t rasterize() const {
    return vertices * sizeof(glm::vec3) + triangles * sizeof(Triangle<Index>) + texels * sizeof(Depth);
  }
  /// Level 0 in, the others out.
  std::uint64_t build_hzm() const { return hzm * sizeof(Depth); }
  /// A flag in, the boxes of those in view; a flag out. What is read of the map is not counted.
  std::uint64_t cull_occluded() const { return n * (1 + 1) + in_view * sizeof(Box) + occluders * 4; }
  std::uint64_t decide() const { return select() + build_hzm() + cull_occluded(); }
  std::uint64_t all() const { return cull_frustum() + rasterize() + decide(); }

  std::string note() const {
    return std::to_string(occluders) + " occluders of " + std::to_string(triangles) + " triangles hide " +
           std::to_string(hidden) + " of " + std::to_string(in_view) + " objects in view";
  }
};

void model_rows(Bench& bench, OccluderModel& host, DeviceOccluderModel& device) {
  const Scene& scene = host.scene;
  const std::uint64_t meshes = scene.meshes.size(), objects = scene.objects.size();
  bench.row({.name = "oriented_boxes",
             // Vertices, triangles, meshes and an entry of the map for each in; boxes and compactness out.
             .bytes = scene.vertices.size() * sizeof(glm::vec3) + scene.triangles.size() * sizeof(Triangle<Index>) +
                      meshes * (sizeof(Mesh) + 4 + sizeof(OrientedBox) + 4),
             .enqueue = [&](cudaStream_t stream) { return device.oriented_boxes(stream); },
             .outputs =
                 [&] {
                   return std::vector{expect(device.boxes, host.boxes), expect(device.compactness, host.compactness)};
                 },
             .host = [&] { host.sample_oriented_boxes(); },
             .graph = false,
             .host_all_ms = host.oriented_boxes_ms,
             .host_scale = static_cast<double>(meshes) / static_cast<double>(host.samples()),
             .note = "with compactness, of the whole model; one core: scaled up from every " +
                     std::to_string(OccluderModel::sample_step) + "th mesh"});
  bench.row({.name = "occluder_faces",
             .bytes = objects * (sizeof(Object) + sizeof(OccluderFace)) + meshes * (sizeof(OrientedBox) + 4),
             .enqueue = [&](cudaStream_t stream) { return device.occluder_faces(stream); },
             .outputs = [&] { return std::vector{expect(device.faces, host.faces)}; },
             .host = [&] { host.occluder_faces(); }});
  bench.row({.name = "compactness_order",
             .bytes = objects * (4 + 4),
             .enqueue = [&](cudaStream_t stream) { return device.compactness_order(stream); },
             .outputs = [&] { return std::vector{expect(device.order, host.order)}; },
             .host = [&] { host.compactness_order(); }});
}

void describe(Bench& bench, const LeastOcclusionBytes& bytes) {
  auto& figures = bench.report.figures;
  figures.emplace_back("occlusion_in_view", static_cast<double>(bytes.in_view));
  figures.emplace_back("occlusion_hidden", static_cast<double>(bytes.hidden));
  figures.emplace_back("occluders", static_cast<double>(bytes.occluders));
  figures.emplace_back("occluder_triangles", static_cast<double>(bytes.triangles));
}

/// The depths of the occluders, the map being emptied before.
void depth_row(Bench& bench, const std::string& name, HostOcclusion& host, DeviceOcclusion& device,
               const LeastOcclusionBytes& bytes, std::optional<double> target_ms) {
  const auto drawn =
      static_cast<std::uint64_t>(std::ranges::count_if(host.depth(), [](Depth depth) { return depth != far_depth; }));
  bench.row({.name = name,
             .bytes = bytes.rasterize(),
             .enqueue = [&](cudaStream_t stream) { return device.rasterize_depth(stream); },
             .outputs = [&] { return std::vector{device.depth_of(host)}; },
             .host = [&] { host.rasterize_depth(); },
             .target_ms = target_ms,
             .note = std::to_string(bytes.occluders) + " occluders of " + std::to_string(bytes.triangles) +
                     " triangles on " + std::to_string(drawn * 100 / bytes.texels) +
                     " % of the map, which is emptied before"});
}

/// The steps that depend on the size of the map, and the whole.
void map_rows(Bench& bench, HostOcclusion& host, DeviceOcclusion& device, const LeastOcclusionBytes& bytes,
              std::optional<double> depth_target_ms) {
  const std::string side = std::to_string(host.size.width);
  depth_row(bench, "rasterize_depth/" + side, host, device, bytes, depth_target_ms);
  bench.row({.name = "build_hzm/" + side,
             .bytes = bytes.build_hzm(),
             .enqueue = [&](cudaStream_t stream) { return device.build_hzm(stream); },
             .outputs = [&] { return std::vector{device.levels_of(host)}; },
             .host = [&] { host.build_hzm(); }});
  bench.row({.name = "cull_occluded/" + side,
             .bytes = bytes.cull_occluded(),
             .enqueue = [&](cudaStream_t stream) { return device.cull_occluded(stream); },
             .outputs = [&] { return std::vector{expect(device.visible, host.visible)}; },
             .host = [&] { host.cull_occluded(); },
             .note = bytes.note()});
  constexpr std::uint32_t refinement = 2;
  host.cull_occluded(refinement);
  bench.row({.name = "cull_occluded/" + side + "/refined",
             .bytes = bytes.cull_occluded(),
             .enqueue = [&](cudaStream_t stream) { return device.cull_occluded(stream, refinement); },
             .outputs = [&] { return std::vector{expect(device.visible, host.visible)}; },
             .host = [&] { host.cull_occluded(refinement); },
             .note = "tests up to two levels finer: " + LeastOcclusionBytes(host).note()});
  host.cull_occluded();
  bench.row({.name = "occlusion/" + side,
             .bytes = bytes.all(),
             .enqueue = [&](cudaStream_t stream) { return device.all(stream); },
             .outputs =
                 [&] {
                   return std::vector{expect(device.in_view, host.in_view), expect(device.occluders, host.occluders),
                                      device.depth_of(host), device.levels_of(host),
                                      expect(device.visible, host.visible)};
                 },
             .host = [&] { host.all(); },
             .note = "all steps from cull_frustum to cull_occluded"});
}

}  // namespace

void occlusion_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload) {
  const std::string whole_row = "select_occluders + build_hzm + cull_occluded/4096";
  const auto wanted = [&](const auto& names) {
    return std::ranges::any_of(names, [&](const std::string& name) { return bench.wants(name); });
  };
  const std::vector<std::string> once = {"oriented_boxes", "occluder_faces", "compactness_order"};
  const std::vector<std::string> inside = {"rasterize_depth/1024/inside", "rasterize_depth/4096/inside"};
  const std::vector<std::string> small = {"rasterize_depth/1024", "build_hzm/1024", "cull_occluded/1024",
                                          "cull_occluded/1024/refined", "occlusion/1024"};
  const std::vector<std::string> large = {
      "select_occluders",   "select_occluders/by index",  "rasterize_depth/4096", "build_hzm/4096",
      "cull_occluded/4096", "cull_occluded/4096/refined", "occlusion/4096",       whole_row};
  if (!wanted(once) && !wanted(inside) && !wanted(small) && !wanted(large)) return;
  OccluderModel host_model(scene);
  DeviceOccluderModel device_model(bench, device_scene, host_model);
  model_rows(bench, host_model, device_model);
  for (const std::string& name : inside) {
    if (!bench.wants(name)) continue;
    const std::uint32_t side = &name == inside.data() ? 1024 : 4096;
    HostOcclusion host(host_model, view_from(Stand::inside, scene, side), occluder_count);
    DeviceOcclusion device(bench, device_model, host);
    depth_row(bench, name, host, device, LeastOcclusionBytes(host),
              side == 1024 ? workload.target(0.10) : std::nullopt);
  }
  if (wanted(small)) {
    HostOcclusion host(host_model, view_from(Stand::corner, scene, 1024), occluder_count);
    DeviceOcclusion device(bench, device_model, host);
    map_rows(bench, host, device, LeastOcclusionBytes(host), workload.target(0.10));
  }
  if (!wanted(large)) return;
  HostOcclusion host(host_model, view_from(Stand::corner, scene, 4096), occluder_count);
  DeviceOcclusion device(bench, device_model, host);
  const LeastOcclusionBytes bytes(host);
  describe(bench, bytes);
  bench.row({.name = "select_occluders",
             .bytes = bytes.select(),
             .enqueue = [&](cudaStream_t stream) { return device.select_occluders(stream); },
             .outputs = [&] { return std::vector{expect(device.occluders, host.occluders)}; },
             .host = [&] { host.select_occluders(); },
             .note = "candidates: all objects, by compactness"});
  bench.row({.name = "select_occluders/by index",
             .bytes = bytes.select(),
             .enqueue = [&](cudaStream_t stream) { return device.select_occluders_by_index(stream); },
             .outputs = [&] { return std::vector{expect(device.others, host.others)}; },
             .host = [&] { host.select_occluders_by_index(); },
             .note = "candidates: all objects, by index"});
  map_rows(bench, host, device, bytes, std::nullopt);
  bench.row({.name = whole_row,
             .bytes = bytes.decide(),
             .enqueue = [&](cudaStream_t stream) { return device.decide(stream); },
             .outputs =
                 [&] {
                   return std::vector{expect(device.occluders, host.occluders), device.levels_of(host),
                                      expect(device.visible, host.visible)};
                 },
             .host =
                 [&] {
                   host.select_occluders();
                   host.build_hzm();
                   host.cull_occluded();
                 },
             .target_ms = workload.target(0.10)});
}

}  // namespace pgl::bench
