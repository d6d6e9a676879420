// SPDX-License-Identifier: MIT
// Reads VRML through Coin, where the program was built with it.
#pragma once

#include <filesystem>

#include "scene/read_file.hpp"

namespace pgl::scene {

/// Parses a VRML 2.0 (VRML97) file in this process; meant for the child process of read_file, which may crash.
///
/// An object is what the shapes of one material make that a grouping node, or the file's top level, holds side by side:
/// exporters write one shape for every face of a solid. Its mesh is in the space of the node; transforms are composed
/// in float. A node that is used again gives another object, whose mesh is equal. Triangles do not share vertices: weld
/// them. Solids of revolution and the like are cut into triangles by Coin. Lines and points are counted, text is
/// ignored.
///
/// Throws std::runtime_error with the reason when the file cannot be read as a whole, asks for other files (Inline,
/// EXTERNPROTO), or when the program was built without Coin.
FileContent read_vrml(const std::filesystem::path& file);

}  // namespace pgl::scene
