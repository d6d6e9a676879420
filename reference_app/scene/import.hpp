// SPDX-License-Identifier: MIT
// Reads a model file into a scene: objects as authored, meshes shared between instances.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "scene/error.hpp"
#include "scene/mesh_data.hpp"
#include "scene/weld.hpp"

namespace pgl::scene {

/// What to do with an object whose triangles use a NaN or infinite position, or whose placement leaves the float range.
enum class NonFinite : std::uint8_t { drop_object, refuse_file };

struct ImportOptions {
  bool weld = true;      ///< merge vertices at identical positions and drop unused ones
  bool split = false;    ///< every connected component becomes an object of its own
  bool flatten = false;  ///< bake the transforms: one mesh per object, placed by the identity
  NonFinite non_finite = NonFinite::drop_object;
};

/// What the import met. The sums over meshes count a shared mesh once.
struct ImportReport {
  std::uint64_t objects_read = 0;      ///< objects as authored, with at least one triangle
  std::uint64_t meshes_read = 0;       ///< distinct meshes behind them
  std::uint64_t vertices_read = 0;     ///< in those meshes, as the reader delivers them
  std::uint64_t triangles_read = 0;    ///< in those meshes, polygons already cut
  std::uint64_t points_and_lines = 0;  ///< dropped: pgl draws triangles
  std::uint64_t objects_dropped = 0;   ///< under NonFinite::drop_object
  WeldCounts welded;
  std::vector<std::string> warnings;  ///< one line each, naming the file
};

/// Reads an OBJ, PLY, STL, glTF, GLB or, where the program was built with Coin, VRML 2.0 file.
///
/// An object is a glTF node with a mesh, an OBJ object or group with faces, a solid of an STL file, a whole PLY file,
/// or what shapes of one material a VRML grouping node holds; other materials do not split objects. Objects keep the
/// file's order (depth first). Objects that refer to the same mesh, or to meshes that are equal element by element,
/// share one; meshes are ordered by their first object. Transforms are composed in double (VRML: float) and rounded
/// once; mirrored ones (negative determinant) are kept as they are. Points and lines are dropped, polygons cut into
/// triangles, normals, colours, textures, skins and animations ignored.
///
/// Then, in this order: `weld` merges vertices at identical positions, per mesh. Objects with non-finite geometry are
/// dropped with one line in report->warnings, or the file refused. `split` splits each mesh once and gives every object
/// one object per component, in its place. `flatten` writes each object's world positions, rounded once from double,
/// into a mesh of its own and swaps the winding of mirrored ones.
///
/// Throws Error, one line naming the file, when it is missing, empty, not a regular file, of unknown extension,
/// truncated, malformed, refused, or has no triangles left. The bytes are parsed in a child process with bounded memory
/// and time, so a hostile file cannot bring the caller down; what it computes does not depend on the thread count.
/// Linear time in the size of file and result; the file's content and the result are in memory together.
Scene import_scene(const std::filesystem::path& file, const ImportOptions& options = {}, const Progress& progress = {},
                   ImportReport* report = nullptr);

}  // namespace pgl::scene
