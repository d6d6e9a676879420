// SPDX-License-Identifier: MIT
// The reader behind import_scene: assimp, and Coin for VRML, kept in a child process.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "scene/mesh_data.hpp"

namespace pgl::scene {

/// An object as the file has it: p -> m[0]*p.x + m[1]*p.y + m[2]*p.z + m[3].
struct FileObject {
  std::uint32_t mesh = 0;
  double transform[4][3] = {};
  std::string name;
};

struct FileContent {
  std::vector<MeshData> meshes;  ///< each has triangles and is used; ordered by first object; indices are in range
  std::vector<FileObject> objects;
  std::uint64_t points_and_lines = 0;
};

/// Reads the file; throws Error as import_scene does. Objects without triangles are left out; there may be none at all.
FileContent read_file(const std::filesystem::path& file, const Progress& progress);

}  // namespace pgl::scene
