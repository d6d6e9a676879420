// SPDX-License-Identifier: MIT
// The groups of rows of the GPU benchmarks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "plant.hpp"

namespace pgl::bench {

class Bench;
struct DeviceScene;
struct Scene;

/// What the rows are about; as it stands, [Peng13] Table 4.5, for which there are targets.
struct Workload {
  std::size_t objects = 718000;
  std::uint64_t budget = 10500000;
  bool stitched = true;

  /// The target where this is the workload that it is set for.
  std::optional<double> target(double ms) const {
    const Workload standard;
    const bool same = objects == standard.objects && budget == standard.budget;
    return same ? std::optional(ms) : std::nullopt;
  }
};

/// The largest scanned model at hand: the Stanford dragon at its second resolution, in the folder of real models.
inline constexpr const char* scan_file = "single/dragon_vrip_res2.ply";

/// The plant, ordered and arranged by the host, and a scanned model where there is one.
struct Model {
  Meshes<std::uint16_t> meshes;
  Order<std::uint16_t> order;
  Arranged<std::uint16_t> arranged;
  double order_ms = 0;  ///< what the host took for `order`, on all cores
  std::optional<Meshes<std::uint32_t>> scan;
};

/// Selection and building of a frame, step by step and as a whole.
void frame_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload);

/// Occlusion culling, step by step and as a whole, of another view than the frame's: in that one all is seen.
void occlusion_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload);

/// Streaming: what takes one selection's blocks to another's, and a frame from them.
void stream_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload);

/// Streaming along a flight, with all that goes over the bus: [Peng13] Table 3.1 and Fig 3.3.
void path_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload);

/// The tiles of several GPUs, for the frame's view.
void balance_rows(Bench& bench, const Scene& scene, const Workload& workload);

/// rearrange of the whole model.
void rearrange_rows(Bench& bench, const Model& model);

/// build_ecol of the whole model, and of single large meshes.
void ecol_rows(Bench& bench, const Model& model, const Workload& workload);

}  // namespace pgl::bench
