// SPDX-License-Identifier: MIT
// Checks that the importer library leaves out: headers that promise more than the file holds.
#pragma once

#include <cstdint>
#include <filesystem>

namespace pgl::scene {

/// True for .obj, .ply, .stl, .gltf, .glb and .wrl, in any case.
bool has_known_extension(const std::filesystem::path& file);

/// True for .wrl, in any case.
bool is_vrml(const std::filesystem::path& file);

/// Throws std::runtime_error with the reason when the file is visibly truncated or malformed, or needs a glTF extension
/// that changes geometry. PLY: every element is there, with lists no longer than the file. STL: the binary count fits,
/// the text has its last endsolid. glTF: sizes of chunks, buffer views and accessors agree, positions are floats. VRML:
/// version 2.0, brackets match and end, strings end, no other file is asked for. OBJ promises nothing, so there is
/// nothing to check. Linear time, one pass over the mapped file.
///
/// Returns the number of triangles that a glTF file promises in the meshes that its scene places, instances not
/// counted: the importer library silently leaves out those whose indices are out of range. 0 for other formats.
std::uint64_t check_file(const std::filesystem::path& file);

}  // namespace pgl::scene
