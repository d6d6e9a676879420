// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "bench.cuh"
#include "pgl/cuda/build_ecol.cuh"
#include "rows.hpp"

namespace pgl::bench {
namespace {

/// Meshes on the device, and room for their order.
template <class Index>
struct DeviceMeshes {
  DeviceMeshes(const Bench& bench, const Meshes<Index>& from)
      : ranges(from.ranges),
        positions(bench.upload(from.positions)),
        triangles(bench.upload(from.triangles)),
        ecol(bench.array<Index>(from.positions.size())),
        permute_v(bench.array<Index>(from.positions.size())),
        permute_t(bench.array<std::uint32_t>(from.triangles.size())),
        map(bench.array<std::uint32_t>(from.map_entries)),
        min_vertices(bench.array<std::uint32_t>(from.ranges.size())) {}

  cudaError_t order(const EcolOptions& options, cudaStream_t stream) {
    return cuda::build_ecol<float, Index>(ranges, positions.input(), triangles.input(), {}, options, workspace,
                                          ecol.view(), permute_v.view(), permute_t.view(), map.view(), {},
                                          min_vertices.view(), stream);
  }
  /// The order of as many meshes from the first one on as `host` has.
  std::vector<Expected> expected(const Order<Index>& host) const {
    return {expect(ecol, host.ecol), expect(permute_v, host.permute_v), expect(permute_t, host.permute_t),
            expect(map, host.map), expect(min_vertices, host.min_vertices)};
  }

  std::span<const MeshRange> ranges;  ///< in host memory
  DeviceArray<glm::vec3> positions;
  DeviceArray<Triangle<Index>> triangles;
  DeviceArray<Index> ecol, permute_v;
  DeviceArray<std::uint32_t> permute_t, map, min_vertices;
  cuda::EcolWorkspace<float> workspace;
};

/// Positions and triangles in; targets, both permutations, the map and the minima out.
template <class Index>
std::uint64_t least_bytes(const Meshes<Index>& meshes) {
  return meshes.positions.size() * (sizeof(glm::vec3) + 2 * sizeof(Index)) +
         meshes.triangles.size() * (3 * sizeof(Index) + 4) + meshes.map_entries * 4 + meshes.ranges.size() * 4;
}

struct Policy {
  const char* name;
  EcolOptions options;
};

/// The whole plant. The host orders all of it where that was done anyhow, else its first objects.
void plant_rows(Bench& bench, const Model& model, const Workload& workload) {
  struct PlantPolicy : Policy {
    std::size_t host_objects;  // that take the host a few seconds on one core
  };
  const PlantPolicy policies[] = {{{"quadric", {}}, 20000},
                                  {{"melax", {.metric = CostMetric::melax}}, 5000}};
  const auto name = [](const Policy& policy) { return std::string("build_ecol/plant/") + policy.name; };
  if (std::ranges::none_of(policies, [&](const Policy& policy) { return bench.wants(name(policy)); })) return;

  const Meshes<std::uint16_t>& meshes = model.meshes;
  DeviceMeshes<std::uint16_t> device(bench, meshes);
  for (const PlantPolicy& policy : policies) {
    const bool whole = &policy == policies;
    const std::size_t part = std::min(policy.host_objects, meshes.ranges.size());
    const Order<std::uint16_t> host = room_for_order(meshes, part);
    std::string note;
    if (part < meshes.ranges.size()) {
      note = (whole ? "one core: scaled up from the first " : "host: scaled up from, and compared for, the first ") +
             std::to_string(part) + " objects";
    }
    bench.row({.name = name(policy),
               .bytes = least_bytes(meshes),
               .enqueue = [&](cudaStream_t stream) { return device.order(policy.options, stream); },
               .outputs = [&] { return device.expected(whole ? model.order : host); },
               .host = [&] { order(meshes, policy.options, host); },
               .graph = false,
               .host_all_ms = whole ? std::optional(model.order_ms) : std::nullopt,
               .host_scale = static_cast<double>(meshes.triangles.size()) / static_cast<double>(host.permute_t.size()),
               .target_ms = whole ? workload.target(5000) : std::nullopt,
               .note = note});
  }
}

std::string mesh_note(const std::string& name, const Meshes<std::uint32_t>& meshes) {
  return (name == "scan" ? std::string(scan_file) + ", " : "one mesh of ") + std::to_string(meshes.triangles.size()) +
         " triangles";
}

/// Up to here, a row may try everything. The greedy order of one mesh is one warp's work, some 20 microseconds a
/// collapse; rounds, and Melax cost most of all, take one core minutes.
constexpr std::size_t most_triangles_for_all = 400000;

/// One large mesh, whose greedy order is one thread's work on the host and one warp's on the device.
void mesh_rows(Bench& bench, const std::string& mesh_name, const Meshes<std::uint32_t>& meshes) {
  const Policy policies[] = {{"quadric", {}},
                             {"quadric, rounds", {.order = EcolOrder::rounds}},
                             {"melax, rounds", {.metric = CostMetric::melax, .order = EcolOrder::rounds}}};
  const bool small = meshes.triangles.size() <= most_triangles_for_all;
  DeviceMeshes<std::uint32_t> device(bench, meshes);
  for (const Policy& policy : policies) {
    const Order<std::uint32_t> host = room_for_order(meshes, 1);  // map entries below a minimum stay as they are
    const bool greedy = policy.options.order == EcolOrder::greedy;
    if (!small && policy.options.metric == CostMetric::melax) continue;
    Measurement m{.name = "build_ecol/" + mesh_name + "/" + policy.name,
                  .bytes = least_bytes(meshes),
                  .enqueue = [&](cudaStream_t stream) { return device.order(policy.options, stream); },
                  .outputs = [&] { return device.expected(host); },
                  .host = [&] { order(meshes, policy.options, host); },
                  .graph = false,
                  .host_one = small || greedy,
                  .host_all = !greedy,
                  .note = mesh_note(mesh_name, meshes)};
    if (greedy && !small) {
      m.enqueue = nullptr;
      m.note += "; on the GPU one mesh in greedy order is one warp's work, left out here";
    }
    bench.row(m);
  }
}

}  // namespace

void ecol_rows(Bench& bench, const Model& model, const Workload& workload) {
  plant_rows(bench, model, workload);
  if (bench.wants("build_ecol/scan/quadric, rounds") || bench.wants("build_ecol/scan/melax, rounds")) {
    if (model.scan) {
      mesh_rows(bench, "scan", *model.scan);
    } else {
      bench.left_out("build_ecol/scan/quadric, rounds",
                     std::string("no ") + scan_file + " in PGL_TEST_DATA, or built without the importers");
    }
  }
  if (bench.wants("build_ecol/torus/quadric, rounds") || bench.wants("build_ecol/torus/melax, rounds")) {
    mesh_rows(bench, "torus", bumpy_torus(1500, 1000));
  }
}

}  // namespace pgl::bench
