// SPDX-License-Identifier: MIT
#include "scene/build_model.hpp"

#include <algorithm>
#include <atomic>
#include <limits>
#include <span>
#include <string>
#include <utility>

#include "pgl/host/bounds.hpp"
#include "pgl/host/build_ecol.hpp"
#include "pgl/host/oriented_box.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/rearrange.hpp"
#include "pgl/host/select_occluders.hpp"
#include "scene/error.hpp"
#include "scene/for_each.hpp"

namespace pgl::scene {
namespace {

/// What one thread reuses from mesh to mesh.
struct Workspace {
  MeshData mesh;
  pgl::host::EcolWorkspace<float> collapse;
  std::vector<std::uint32_t> ecol, permute_v, permute_t, arranged_ecol, open_edges;
  std::vector<pgl::Triangle<std::uint32_t>> arranged_triangles;
};

/// Largest number of vertices that Index can tell apart; with 32 bits, ~0 stays free for "none".
template <class Index>
constexpr std::size_t most_vertices = sizeof(Index) == 2 ? 65536 : 0xffffffff;

/// Builds mesh i into its place; map entry k goes to map[k], for k from the returned minimum on, and so do errors,
/// unless they are empty.
template <class Index>
std::uint32_t build_mesh(const MeshData& mesh, const pgl::EcolOptions& options, Workspace& w,
                         std::span<glm::vec3> vertices, std::span<pgl::Triangle<Index>> triangles,
                         std::span<Index> ecol, std::span<std::uint32_t> map, std::span<float> errors) {
  const std::span<const glm::vec3> positions(mesh.positions);
  const std::span<const pgl::Triangle<std::uint32_t>> original(mesh.triangles);
  w.ecol.resize(positions.size());
  w.permute_v.resize(positions.size());
  w.permute_t.resize(original.size());
  const std::uint32_t min_vertices = pgl::host::build_ecol<float, std::uint32_t>(
      positions, original, {}, options, w.collapse, w.ecol, w.permute_v, w.permute_t, map, errors);

  // Collapsing and rearranging work in 32 bits: a vertex number of the original order may equal a narrow no_target.
  const auto rearrange = [&](std::span<pgl::Triangle<std::uint32_t>> to_triangles, std::span<std::uint32_t> to_ecol) {
    pgl::host::rearrange<glm::vec3, std::uint32_t>(positions, original, w.ecol, w.permute_v, w.permute_t, vertices,
                                                   to_triangles, to_ecol);
  };
  if constexpr (sizeof(Index) == 4) {
    rearrange(triangles, ecol);
  } else {
    w.arranged_triangles.resize(original.size());
    w.arranged_ecol.resize(positions.size());
    rearrange(w.arranged_triangles, w.arranged_ecol);
    std::transform(w.arranged_triangles.begin(), w.arranged_triangles.end(), triangles.begin(), [](const auto& t) {
      return pgl::Triangle<Index>{{static_cast<Index>(t.v[0]), static_cast<Index>(t.v[1]), static_cast<Index>(t.v[2])}};
    });
    std::transform(w.arranged_ecol.begin(), w.arranged_ecol.end(), ecol.begin(),
                   [](std::uint32_t v) { return static_cast<Index>(v); });  // no_target becomes the narrow one
  }
  return min_vertices;
}

}  // namespace

std::size_t count_open_vertices(std::size_t vertices, const std::vector<pgl::Triangle<std::uint32_t>>& triangles,
                                std::vector<std::uint32_t>& scratch) {
  // Edges listed at their lower vertex: those of v are upper[first[v]] to upper[first[v + 1]].
  scratch.assign(vertices + 1 + 3 * triangles.size() + vertices, 0);
  std::uint32_t* const first = scratch.data();
  std::uint32_t* const upper = first + vertices + 1;
  std::uint32_t* const open = upper + 3 * triangles.size();
  const auto for_each_edge = [&](auto&& body) {
    for (const auto& t : triangles)
      for (int corner = 0; corner < 3; ++corner) {
        const auto [low, high] = std::minmax(t.v[corner], t.v[(corner + 1) % 3]);
        PGL_ASSERT(high < vertices);
        if (low != high) body(low, high);
      }
  };
  std::uint32_t* const end = first + 1;  // counts, then where each list grows, at last where it ends
  for_each_edge([&](std::uint32_t low, std::uint32_t) { ++end[low]; });
  std::uint32_t sum = 0;
  for (std::size_t v = 0; v < vertices; ++v) sum += std::exchange(end[v], sum);
  for_each_edge([&](std::uint32_t low, std::uint32_t high) { upper[end[low]++] = high; });
  for (std::size_t v = 0; v < vertices; ++v) {
    std::uint32_t* const last = upper + first[v + 1];
    std::sort(upper + first[v], last);
    for (std::uint32_t* at = upper + first[v]; at != last;) {
      std::uint32_t* const next = std::find_if(at, last, [&](std::uint32_t x) { return x != *at; });
      if (next - at == 1) open[v] = open[*at] = 1;
      at = next;
    }
  }
  return static_cast<std::size_t>(std::count(open, open + vertices, 1u));
}

template <class Index>
Model<Index> build_model(const MeshSource& source, std::vector<pgl::Object> objects, const pgl::EcolOptions& options,
                         const Progress& progress, BuildReport* report, bool errors) {
  for (const pgl::Object& object : objects)
    if (object.mesh >= source.count) throw Error("model", "an object has no mesh");

  // Every mesh's place is known beforehand, but for the start of its map: that has an entry for each count down to 0 at
  // first, and is moved together when the least counts are known.
  Model<Index> model;
  model.meshes.resize(source.count);
  std::vector<std::uint32_t> triangle_counts(source.count);
  std::uint64_t vertices = 0, triangles = 0, map_entries = 0;
  for (std::size_t m = 0; m < source.count; ++m) {
    const MeshSize size = source.size(m);
    if (size.vertices > most_vertices<Index>)
      throw Error("model", "mesh " + std::to_string(m) + " has " + std::to_string(size.vertices) + " vertices, " +
                               std::to_string(8 * sizeof(Index)) + "-bit indices reach " +
                               std::to_string(most_vertices<Index>));
    if (size.triangles > (std::numeric_limits<std::uint32_t>::max() - 1) / 3)
      throw Error("model", "mesh " + std::to_string(m) + " has too many triangles");
    triangle_counts[m] = static_cast<std::uint32_t>(size.triangles);
    model.meshes[m] = {vertices, triangles, map_entries, 0, static_cast<std::uint32_t>(size.vertices)};
    vertices += size.vertices;
    triangles += size.triangles;
    map_entries += size.vertices + 1;
  }
  model.vertices.resize(vertices);
  model.triangles.resize(triangles);
  model.ecol.resize(vertices);
  model.map.resize(map_entries);
  if (errors) model.errors.resize(map_entries);
  model.mesh_boxes.resize(source.count);

  std::vector<Workspace> workspaces(pgl::host::thread_count());
  std::atomic<std::uint64_t> open_vertices{0};
  for_each(source.count, progress, "build", [&](std::size_t m) {
    Workspace& w = workspaces[pgl::host::thread_index()];
    pgl::Mesh& mesh = model.meshes[m];
    source.make(m, w.mesh);
    if (w.mesh.positions.size() != mesh.max_vertices || w.mesh.triangles.size() != triangle_counts[m])
      throw Error("model", "mesh " + std::to_string(m) + " is not of the size announced");
    const auto of_map = [&](auto& array) {
      return array.empty() ? std::span(array)
                           : std::span(array).subspan(mesh.first_map, std::size_t{mesh.max_vertices} + 1);
    };
    mesh.min_vertices = build_mesh<Index>(
        w.mesh, options, w, std::span(model.vertices).subspan(mesh.first_vertex, mesh.max_vertices),
        std::span(model.triangles).subspan(mesh.first_triangle, triangle_counts[m]),
        std::span(model.ecol).subspan(mesh.first_vertex, mesh.max_vertices), of_map(model.map), of_map(model.errors));
    model.mesh_boxes[m] = pgl::host::bounds(w.mesh.positions);
    open_vertices += count_open_vertices(mesh.max_vertices, w.mesh.triangles, w.open_edges);
  });
  workspaces.clear();

  map_entries = 0;
  for (pgl::Mesh& mesh : model.meshes) {
    const auto move_down = [&](auto& array) {
      const auto from = array.begin() + static_cast<std::ptrdiff_t>(mesh.first_map);
      std::copy(from + mesh.min_vertices, from + mesh.max_vertices + 1,
                array.begin() + static_cast<std::ptrdiff_t>(map_entries));
    };
    move_down(model.map);
    if (errors) move_down(model.errors);
    mesh.first_map = map_entries;
    map_entries += mesh.max_vertices - mesh.min_vertices + 1;
  }
  model.map.resize(map_entries);
  if (errors) model.errors.resize(map_entries);

  model.oriented_boxes.resize(source.count);
  model.compactness.resize(source.count);
  for_each(source.count, progress, "boxes", [&](std::size_t m) {
    pgl::host::oriented_boxes<Index>(std::span<const pgl::Mesh>(model.meshes).subspan(m, 1), model.vertices,
                                     model.triangles, model.map, std::span(model.oriented_boxes).subspan(m, 1),
                                     std::span(model.compactness).subspan(m, 1));
  });

  model.objects = std::move(objects);
  model.object_boxes.resize(model.objects.size());
  pgl::host::object_bounds(model.objects, model.mesh_boxes, model.object_boxes);
  model.faces.resize(model.objects.size());
  model.compactness_order.resize(model.objects.size());
  pgl::host::occluder_faces(model.objects, model.oriented_boxes, model.compactness, model.faces);
  pgl::host::OccluderWorkspace workspace;
  pgl::host::compactness_order(model.faces, workspace, model.compactness_order);
  if (report) report->open_vertices = open_vertices;
  return model;
}

template Model<std::uint16_t> build_model(const MeshSource&, std::vector<pgl::Object>, const pgl::EcolOptions&,
                                          const Progress&, BuildReport*, bool);
template Model<std::uint32_t> build_model(const MeshSource&, std::vector<pgl::Object>, const pgl::EcolOptions&,
                                          const Progress&, BuildReport*, bool);

AnyModel build_any_model(const MeshSource& source, std::vector<pgl::Object> objects, const pgl::EcolOptions& options,
                         const Progress& progress, BuildReport* report, bool errors) {
  bool narrow = true;
  for (std::size_t m = 0; m < source.count; ++m)
    narrow = narrow && source.size(m).vertices <= most_vertices<std::uint16_t>;
  if (narrow) return build_model<std::uint16_t>(source, std::move(objects), options, progress, report, errors);
  return build_model<std::uint32_t>(source, std::move(objects), options, progress, report, errors);
}

AnyModel build_any_model(Scene scene, const pgl::EcolOptions& options, const Progress& progress, BuildReport* report,
                         bool errors) {
  MeshSource source;
  source.count = scene.meshes.size();
  source.size = [&](std::size_t m) {
    return MeshSize{scene.meshes[m].positions.size(), scene.meshes[m].triangles.size()};
  };
  source.make = [&](std::size_t m, MeshData& mesh) { mesh = std::exchange(scene.meshes[m], {}); };
  return build_any_model(source, std::move(scene.objects), options, progress, report, errors);
}

}  // namespace pgl::scene
