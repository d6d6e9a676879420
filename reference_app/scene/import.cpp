// SPDX-License-Identifier: MIT
#include "scene/import.hpp"

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <unordered_map>
#include <utility>

#include "scene/components.hpp"
#include "scene/for_each.hpp"
#include "scene/read_file.hpp"

namespace pgl::scene {
namespace {

bool equal(const MeshData& a, const MeshData& b) {
  return a.positions.size() == b.positions.size() && a.triangles == b.triangles &&
         (a.positions.empty() ||
          std::memcmp(a.positions.data(), b.positions.data(), a.positions.size() * sizeof a.positions[0]) == 0);
}

std::uint64_t fingerprint(const MeshData& mesh) {
  std::uint64_t h = mesh.positions.size();
  const auto add = [&h](const void* data, std::size_t bytes) {  // both element sizes are multiples of four
    for (std::size_t at = 0; at < bytes; at += 4) {
      std::uint32_t word;
      std::memcpy(&word, static_cast<const char*>(data) + at, 4);
      h = (h ^ word) * 0x9e3779b97f4a7c15u;
      h ^= h >> 32;
    }
  };
  add(mesh.positions.data(), mesh.positions.size() * sizeof mesh.positions[0]);
  add(mesh.triangles.data(), mesh.triangles.size() * sizeof mesh.triangles[0]);
  return h;
}

/// Lets equal meshes be one: the first of them. Removes the others and meshes that no object uses.
void share_equal_meshes(std::vector<MeshData>& meshes, std::vector<FileObject>& objects, const Progress& progress) {
  std::vector<std::uint64_t> fingerprints(meshes.size());
  for_each(meshes.size(), progress, "compare", [&](std::size_t m) { fingerprints[m] = fingerprint(meshes[m]); });

  constexpr std::uint32_t unused = ~std::uint32_t{0};
  std::vector<std::uint32_t> new_index(meshes.size(), unused);
  std::unordered_multimap<std::uint64_t, std::uint32_t> kept;
  std::vector<MeshData> result;
  for (FileObject& object : objects) {
    std::uint32_t& index = new_index[object.mesh];
    if (index == unused) {
      MeshData& mesh = meshes[object.mesh];
      const auto [first, last] = kept.equal_range(fingerprints[object.mesh]);
      const auto twin = std::find_if(first, last, [&](const auto& entry) { return equal(result[entry.second], mesh); });
      if (twin != last) {
        index = twin->second;
      } else {
        index = static_cast<std::uint32_t>(result.size());
        kept.emplace(fingerprints[object.mesh], index);
        result.push_back(std::move(mesh));
      }
      mesh = {};
    }
    object.mesh = index;
  }
  meshes = std::move(result);
}

/// The largest |x|, |y| and |z| over the vertices that triangles use; infinite where one of them is not finite.
std::array<double, 3> reach(const MeshData& mesh) {
  std::array<double, 3> largest{};
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t v : triangle.v)
      for (int axis = 0; axis < 3; ++axis) {
        const double x = std::abs(static_cast<double>(mesh.positions[v][axis]));
        if (!(x <= largest[axis])) largest[axis] = std::isfinite(x) ? x : HUGE_VAL;
      }
  return largest;
}

/// True when every vertex of a mesh with this reach stays finite in the world, with room for rounding.
bool fits(const FileObject& object, const std::array<double, 3>& reach) {
  bool inside = true;
  for (int row = 0; row < 3; ++row) {
    double bound = std::abs(object.transform[3][row]);
    for (int column = 0; column < 3; ++column) bound += std::abs(object.transform[column][row]) * reach[column];
    for (int column = 0; column < 3; ++column)
      inside = inside && std::abs(object.transform[column][row]) <= FLT_MAX;  // also refuses NaN
    inside = inside && bound <= 0.999 * static_cast<double>(FLT_MAX);
  }
  return inside;
}

void drop_non_finite(const std::filesystem::path& file, NonFinite policy, const std::vector<MeshData>& meshes,
                     std::vector<FileObject>& objects, ImportReport& report) {
  std::vector<std::array<double, 3>> reaches(meshes.size());
  for (std::size_t m = 0; m < meshes.size(); ++m) reaches[m] = reach(meshes[m]);
  const auto bad = [&](const FileObject& object) { return !fits(object, reaches[object.mesh]); };
  const auto first = std::find_if(objects.begin(), objects.end(), bad);
  if (first == objects.end()) return;
  const std::string name = first->name.empty() ? std::string("without a name") : "'" + first->name + "'";
  if (policy == NonFinite::refuse_file) throw Error(file, "object " + name + " has non-finite coordinates");
  const std::size_t before = objects.size();
  std::erase_if(objects, bad);
  report.objects_dropped = before - objects.size();
  std::string line = report.objects_dropped == 1 ? "dropped object " + name + ", which has non-finite coordinates"
                                                 : "dropped " + std::to_string(report.objects_dropped) +
                                                       " objects with non-finite coordinates, the first " + name;
  if (objects.empty()) throw Error(file, "nothing is left: " + line);
  report.warnings.push_back(Error(file, line).what());
}

/// Splits every mesh once; each object becomes one object per component.
void split(std::vector<MeshData>& meshes, std::vector<FileObject>& objects, const Progress& progress) {
  std::vector<std::vector<MeshData>> parts(meshes.size());
  for_each(meshes.size(), progress, "split", [&](std::size_t m) {
    parts[m] = split_components(meshes[m]);
    meshes[m] = {};
  });
  std::vector<std::size_t> first(meshes.size());
  std::vector<MeshData> result;
  for (std::size_t m = 0; m < parts.size(); ++m) {
    first[m] = result.size();
    std::move(parts[m].begin(), parts[m].end(), std::back_inserter(result));
  }
  std::vector<FileObject> placed;
  for (FileObject& object : objects) {
    object.name.clear();
    for (std::size_t c = 0; c < parts[object.mesh].size(); ++c) {
      placed.push_back(object);
      placed.back().mesh = static_cast<std::uint32_t>(first[object.mesh] + c);
    }
  }
  meshes = std::move(result);
  objects = std::move(placed);
}

/// The mesh in the world: positions rounded once, winding swapped where the transform mirrors.
MeshData bake(const MeshData& mesh, const FileObject& object) {
  const auto& m = object.transform;
  MeshData baked = mesh;
  for (glm::vec3& p : baked.positions) {
    const double x = p.x, y = p.y, z = p.z;
    for (int row = 0; row < 3; ++row)
      p[row] = static_cast<float>(m[0][row] * x + m[1][row] * y + m[2][row] * z + m[3][row]);
  }
  const double determinant = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                             m[1][0] * (m[0][1] * m[2][2] - m[0][2] * m[2][1]) +
                             m[2][0] * (m[0][1] * m[1][2] - m[0][2] * m[1][1]);
  if (determinant < 0)
    for (auto& triangle : baked.triangles) std::swap(triangle.v[1], triangle.v[2]);
  return baked;
}

}  // namespace

Scene import_scene(const std::filesystem::path& file, const ImportOptions& options, const Progress& progress,
                   ImportReport* report_out) {
  ImportReport report;
  FileContent content = read_file(file, progress);
  std::vector<MeshData>& meshes = content.meshes;
  std::vector<FileObject>& objects = content.objects;
  report.objects_read = objects.size();
  report.meshes_read = meshes.size();
  report.points_and_lines = content.points_and_lines;
  for (const MeshData& mesh : meshes) {
    report.vertices_read += mesh.positions.size();
    report.triangles_read += mesh.triangles.size();
  }
  if (objects.empty()) throw Error(file, "has no triangles");

  Scene scene;
  try {
    if (options.weld) {
      std::vector<WeldCounts> counts(meshes.size());
      for_each(meshes.size(), progress, "weld", [&](std::size_t m) { counts[m] = weld(meshes[m]); });
      for (const WeldCounts& c : counts) {
        report.welded.merged += c.merged;
        report.welded.unreferenced += c.unreferenced;
        report.welded.degenerate += c.degenerate;
      }
    }
    drop_non_finite(file, options.non_finite, meshes, objects, report);
    share_equal_meshes(meshes, objects, progress);
    if (options.split) split(meshes, objects, progress);

    scene.objects.resize(objects.size());
    if (options.flatten) {
      scene.meshes.resize(objects.size());
      for_each(objects.size(), progress, "flatten", [&](std::size_t i) {
        scene.meshes[i] = bake(meshes[objects[i].mesh], objects[i]);
        scene.objects[i].mesh = static_cast<std::uint32_t>(i);
      });
    } else {
      for (std::size_t i = 0; i < objects.size(); ++i) {
        scene.objects[i].mesh = objects[i].mesh;
        for (int column = 0; column < 4; ++column)
          for (int row = 0; row < 3; ++row)
            scene.objects[i].transform[column][row] = static_cast<float>(objects[i].transform[column][row]);
      }
      scene.meshes = std::move(meshes);
    }
  } catch (const std::bad_alloc&) {
    throw Error(file, "does not fit in memory");
  }
  if (report_out) *report_out = std::move(report);
  return scene;
}

}  // namespace pgl::scene
