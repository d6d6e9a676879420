// SPDX-License-Identifier: MIT
// What the command line of pgl_preprocess asks for.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "scene/import.hpp"
#include "scene/plant.hpp"
#include "scene/up_axis.hpp"

namespace pgl::preprocess {

enum class Task { build, verify, info };

struct Options {
  Task task = Task::build;
  std::string file;                 ///< to be made, or to be looked at
  std::vector<std::string> inputs;  ///< as typed: files, folders, @lists; none: the procedural plant
  scene::PlantOptions plant{.objects = 2000};
  scene::ImportOptions import;
  EcolOptions ecol;
  bool errors = false;  ///< to be recorded beside the model
  bool warehouse = false;
  scene::UpAxis up = scene::UpAxis::not_told;  ///< told where a file is made
  std::size_t batch = 2'000'000;               ///< triangles that small models are built together up to
  int threads = 0;                             ///< 0: all
};

/// Reads the command line. Prints help or version and returns nothing when they were asked for.
/// Throws std::runtime_error with one line that names the option.
std::optional<Options> parse_options(int argc, const char* const* argv);

}  // namespace pgl::preprocess
