// SPDX-License-Identifier: MIT
// What a run measured, as JSON for programs and as a table for people.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "pgl/balance.hpp"
#include "viewer/camera.hpp"
#include "viewer/streaming.hpp"

namespace pgl::viewer {

struct Report {
  std::uint64_t objects = 0;
  std::uint64_t meshes = 0;
  std::uint64_t model_vertices = 0;  ///< every object counted, shared meshes as often as they are placed
  std::uint64_t model_triangles = 0;
  std::uint64_t open_vertices = 0;  ///< on open edges, each mesh counted once
  std::uint64_t budget = 0;
  std::uint64_t drawn_objects = 0, drawn_vertices = 0, drawn_triangles = 0;
  std::uint64_t drawn_checksum = 0;      ///< of the last frame
  std::vector<std::uint64_t> checksums;  ///< of every frame, or none
  std::uint64_t culled_frustum = 0, culled_occlusion = 0;
  std::uint64_t occluders = 0;
  MemoryPlan memory;                                    ///< of streamed frames
  std::vector<Sent> sent;                               ///< by every frame, where frames are streamed
  std::uint64_t file_bytes = 0, file_bytes_read = 0;    ///< of the model file, if there is one; read: what was checked
  std::vector<double> frame_ms, load_ms;                ///< of every frame, with `checksums` only
  std::vector<std::pair<std::string, double>> ms;       ///< per step, in the order of the work
  std::vector<std::pair<std::string, double>> mean_ms;  ///< of all frames but the first
  int width = 0, height = 0, samples = 0, frames = 0;
  std::size_t threads = 0;
  Camera camera;
  std::string backend, gpu;
  bool interop = false;
  std::string gl_vendor, gl_renderer, gl_version;
  float threshold = 0.0f;  ///< pixels, where error decides
  // Of several ranks: what is drawn and measured is this one's, what is culled that of all.
  int rank = 0;
  Tile tile;
  std::uint32_t weight = 0;                       ///< of full_weight
  std::string pictures;                           ///< how they come together
  double imbalance = 0.0, worst_imbalance = 0.0;  ///< largest share of triangles, above the mean: 0 is even
  std::vector<std::string> ranks;                 ///< the statistics of each
};

/// The statistics file.
std::string to_json(const Report& report);

/// The table on the terminal.
std::string to_table(const Report& report);

/// The middle value; 0 of nothing.
double median(std::vector<double> values);

}  // namespace pgl::viewer
