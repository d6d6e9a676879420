// SPDX-License-Identifier: MIT
// What the command line of pgl_viewer asks for.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "pgl/distribute_budget.hpp"
#include "scene/import.hpp"
#include "scene/plant.hpp"
#include "scene/up_axis.hpp"
#include "viewer/camera.hpp"
#include "viewer/occlusion.hpp"
#include "viewer/streaming.hpp"
#include "viewer/tiling.hpp"

namespace pgl::viewer {

/// A camera as typed: the up axis comes from the scene.
struct CameraOption {
  glm::dvec3 eye{}, target{};
  std::optional<double> fov_degrees;
};

/// What prepares the frames.
enum class BackendKind { host, cuda };

struct Options {
  std::vector<std::string> files;  ///< none: the procedural plant
  bool preprocessed = false;       ///< the one file is a model file, .pgl
  scene::PlantOptions plant{.objects = 2000};
  scene::ImportOptions import;
  EcolOptions ecol;

  std::uint64_t budget = 1'000'000;  ///< vertices, 0..2^32
  std::uint32_t min_triangles = 0;   ///< a drawn object keeps at least so many
  BudgetOptions distribution;        ///< its budget, near_depth and viewport_area are set for each frame
  BackendKind backend = BackendKind::host;
  OcclusionOptions occlusion;
  StreamOptions stream;
  bool prefetch = true;  ///< a model file is read ahead of the frames
  LodMode lod = LodMode::budget;
  float threshold = 1.0f;            ///< pixels, for LodMode::error
  std::optional<double> frame_time;  ///< milliseconds, which the budget or the threshold follows

  TileOptions tiles;       ///< of several ranks
  double patience = 10.0;  ///< seconds: see Ranks
  int slow_rank = -1;      ///< this one draws
  int slow_factor = 1;     ///< each frame so often

  scene::UpAxis up = scene::UpAxis::not_told;  ///< none: as a model file says, else z of the plant, y of files
  std::optional<CameraOption> camera;          ///< none: the whole model
  int width = 1280, height = 720;              ///< pixels, 1..16384
  bool wireframe = false;
  bool orbit = false;     ///< the camera turns by one degree a frame
  bool fly = false;       ///< the camera flies through the model, once in all the frames
  bool headless = false;  ///< draw offscreen even where there is a display
  int frames = 0;         ///< then stop; 0: one offscreen, no end in a window

  std::string output;      ///< PNG of the last frame; of a wall, of this rank's part
  std::string reference;   ///< PNG of the last frame's selection, seen from outside
  std::string stats;       ///< JSON
  bool checksums = false;  ///< in the statistics, of every frame
  int threads = 0;         ///< 0: all
};

/// Reads the command line. Prints help or version, if rank is 0, and returns nothing when they were asked for. Files
/// are written by rank 0, and of a wall by each: --output FILE.png is then FILE-RANK.png; rank 0 tries all of them.
/// Throws std::runtime_error with one line that names the option.
std::optional<Options> parse_options(int argc, const char* const* argv, int rank);

}  // namespace pgl::viewer
