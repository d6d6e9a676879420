// SPDX-License-Identifier: MIT
#include "preprocess/inputs.hpp"

#include <algorithm>
#include <fstream>
#include <system_error>

#include "scene/check_file.hpp"
#include "scene/error.hpp"

namespace pgl::preprocess {

namespace fs = std::filesystem;

namespace {

void add(const fs::path& path, std::vector<fs::path>& files) {
  std::error_code problem;
  const fs::file_status status = fs::status(path, problem);
  if (!fs::exists(status)) throw scene::Error(path, problem ? problem.message() : "does not exist");
  if (!fs::is_directory(status)) {
    if (!scene::has_known_extension(path)) {
      throw scene::Error(path, "unknown format (expected .obj, .ply, .stl, .gltf, .glb or .wrl)");
    }
    files.push_back(path);
    return;
  }
  std::vector<fs::path> found;
  for (fs::recursive_directory_iterator at(path, problem), end; !problem && at != end; at.increment(problem)) {
    std::error_code ignored;
    if (scene::has_known_extension(at->path()) && at->is_regular_file(ignored)) found.push_back(at->path());
  }
  if (problem) throw scene::Error(path, problem.message());
  if (found.empty()) throw scene::Error(path, "has no models");
  std::ranges::sort(found);
  files.insert(files.end(), found.begin(), found.end());
}

}  // namespace

std::vector<fs::path> expand_inputs(const std::vector<std::string>& arguments) {
  std::vector<fs::path> files;
  for (const std::string& argument : arguments) {
    if (!argument.starts_with('@')) {
      add(argument, files);
      continue;
    }
    const fs::path list = argument.substr(1);
    std::ifstream in(list);
    if (!in) throw scene::Error(list, "cannot be read");
    const std::size_t before = files.size();
    for (std::string line; std::getline(in, line);) {
      if (!line.empty()) add(line, files);
    }
    if (in.bad()) throw scene::Error(list, "cannot be read");
    if (files.size() == before) throw scene::Error(list, "has no models");
  }
  return files;
}

}  // namespace pgl::preprocess
