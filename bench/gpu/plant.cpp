// SPDX-License-Identifier: MIT
#include "plant.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "pgl/host/build_ecol.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/rearrange.hpp"
#include "scene/for_each.hpp"
#include "scene/plant.hpp"
#include "scene/weld.hpp"
#if defined(PGL_BENCH_IMPORT)
#include "scene/import.hpp"
#endif

namespace pgl::bench {

namespace {

/// Gives every mesh of the ranges, whose sizes are set, its place behind the one before.
template <class Index>
void lay_out(Meshes<Index>& meshes) {
  std::uint64_t vertices = 0, triangles = 0, map = 0;
  for (MeshRange& range : meshes.ranges) {
    range.first_vertex = vertices;
    range.first_triangle = triangles;
    range.first_map = map;
    vertices += range.vertices;
    triangles += range.triangles;
    map += std::uint64_t{range.vertices} + 1;
  }
  meshes.positions = HostArray<glm::vec3>(vertices);
  meshes.triangles = HostArray<Triangle<Index>>(triangles);
  meshes.map_entries = map;
}

Meshes<std::uint32_t> one_mesh(const scene::MeshData& mesh) {
  Meshes<std::uint32_t> meshes;
  meshes.ranges.resize(1);
  meshes.ranges[0].vertices = static_cast<std::uint32_t>(mesh.positions.size());
  meshes.ranges[0].triangles = static_cast<std::uint32_t>(mesh.triangles.size());
  lay_out(meshes);
  std::ranges::copy(mesh.positions, meshes.positions.data());
  std::ranges::copy(mesh.triangles, meshes.triangles.data());
  return meshes;
}

}  // namespace

Meshes<std::uint16_t> make_plant(std::size_t objects, bool stitched) {
  const scene::PlantOptions options{.objects = objects};
  Meshes<std::uint16_t> meshes;
  meshes.ranges.resize(objects);

  // Made once, in groups, then moved to their places.
  struct Group {
    std::vector<glm::vec3> positions;
    std::vector<Triangle<std::uint16_t>> triangles;
  };
  constexpr std::size_t group_size = 256;
  std::vector<Group> groups((objects + group_size - 1) / group_size);
  std::vector<scene::MeshData> scratch(host::thread_count());
  const auto each_of_group = [&](std::size_t g, auto&& body) {
    for (std::size_t i = g * group_size; i < std::min(objects, (g + 1) * group_size); ++i) body(i);
  };
  scene::for_each(groups.size(), {}, "make", [&](std::size_t g) {
    scene::MeshData& mesh = scratch[host::thread_index()];
    Group& group = groups[g];
    each_of_group(g, [&](std::size_t i) {
      scene::plant_object(options, i, mesh);
      if (stitched) scene::weld(mesh);
      if (mesh.positions.size() > 65535) throw std::runtime_error("an object of the plant is too large for 16 bits");
      meshes.ranges[i].vertices = static_cast<std::uint32_t>(mesh.positions.size());
      meshes.ranges[i].triangles = static_cast<std::uint32_t>(mesh.triangles.size());
      group.positions.insert(group.positions.end(), mesh.positions.begin(), mesh.positions.end());
      for (const auto& t : mesh.triangles) {
        group.triangles.push_back({{static_cast<std::uint16_t>(t.v[0]), static_cast<std::uint16_t>(t.v[1]),
                                    static_cast<std::uint16_t>(t.v[2])}});
      }
    });
  });
  lay_out(meshes);
  host::parallel_for(groups.size(), 1, [&](std::size_t g) {
    Group& group = groups[g];
    const MeshRange& first = meshes.ranges[g * group_size];
    std::ranges::copy(group.positions, meshes.positions.data() + first.first_vertex);
    std::ranges::copy(group.triangles, meshes.triangles.data() + first.first_triangle);
    group = {};
  });
  return meshes;
}

Meshes<std::uint32_t> bumpy_torus(std::uint32_t around, std::uint32_t across) {
  scene::MeshData mesh;
  for (std::uint32_t i = 0; i < around; ++i) {
    for (std::uint32_t j = 0; j < across; ++j) {
      const double u = 2 * M_PI * i / around, v = 2 * M_PI * j / across;
      const double r = 1 + 0.4 * std::cos(v) + 0.02 * std::sin(9 * u) * std::cos(5 * v);
      mesh.positions.emplace_back(r * std::cos(u), r * std::sin(u), 0.4 * std::sin(v));
      const std::uint32_t i1 = (i + 1) % around, j1 = (j + 1) % across;
      const std::uint32_t a = i * across + j, b = i1 * across + j, c = i1 * across + j1, d = i * across + j1;
      mesh.triangles.push_back({{a, b, c}});
      mesh.triangles.push_back({{a, c, d}});
    }
  }
  return one_mesh(mesh);
}

std::optional<Meshes<std::uint32_t>> read_mesh([[maybe_unused]] const std::string& path) {
#if defined(PGL_BENCH_IMPORT)
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) return std::nullopt;
  const scene::Scene scene = scene::import_scene(path);
  scene::MeshData all;
  for (const scene::MeshData& mesh : scene.meshes) {
    const auto first = static_cast<std::uint32_t>(all.positions.size());
    all.positions.insert(all.positions.end(), mesh.positions.begin(), mesh.positions.end());
    for (const auto& t : mesh.triangles) all.triangles.push_back({{first + t.v[0], first + t.v[1], first + t.v[2]}});
  }
  return one_mesh(all);
#else
  return std::nullopt;
#endif
}

std::size_t use_threads([[maybe_unused]] std::size_t threads) {
#if defined(_OPENMP)
  static const int all = omp_get_max_threads();
  omp_set_num_threads(threads == 0 ? all : static_cast<int>(threads));
#endif
  return host::thread_count();
}

template <class Index>
Order<Index> room_for_order(const Meshes<Index>& meshes, std::size_t count) {
  std::size_t vertices = meshes.positions.size(), triangles = meshes.triangles.size(), entries = meshes.map_entries;
  if (count < meshes.ranges.size()) {
    vertices = meshes.ranges[count].first_vertex;
    triangles = meshes.ranges[count].first_triangle;
    entries = meshes.ranges[count].first_map;
  }
  Order<Index> out{.ecol = HostArray<Index>(vertices),
                   .permute_v = HostArray<Index>(vertices),
                   .permute_t = HostArray<std::uint32_t>(triangles),
                   .map = HostArray<std::uint32_t>(entries),
                   .min_vertices = HostArray<std::uint32_t>(count)};
  constexpr std::size_t part = 1 << 20;
  host::parallel_for((entries + part - 1) / part, 1, [&](std::size_t p) {
    std::memset(out.map.data() + p * part, 0xA5, sizeof(std::uint32_t) * std::min(part, entries - p * part));
  });
  return out;
}

template <class Index>
void order(const Meshes<Index>& meshes, const EcolOptions& options, const Order<Index>& out) {
  static std::vector<host::EcolWorkspace<float>> workspaces;
  host::build_ecol<float, Index>(
      std::span(meshes.ranges).first(out.min_vertices.size()), meshes.positions.input().first(out.ecol.size()),
      meshes.triangles.input().first(out.permute_t.size()), {}, options, workspaces, out.ecol.view(),
      out.permute_v.view(), out.permute_t.view(), out.map.view(), {}, out.min_vertices.view());
}

template <class Index>
Arranged<Index> room_for_arranged(const Meshes<Index>& meshes) {
  return {.vertices = HostArray<glm::vec3>(meshes.positions.size()),
          .triangles = HostArray<Triangle<Index>>(meshes.triangles.size()),
          .ecol = HostArray<Index>(meshes.positions.size())};
}

template <class Index>
void arrange(const Meshes<Index>& meshes, const Order<Index>& order, const Arranged<Index>& out) {
  host::rearrange<glm::vec3, Index>(meshes.ranges, meshes.positions.input(), meshes.triangles.input(),
                                    order.ecol.input(), order.permute_v.input(), order.permute_t.input(),
                                    out.vertices.view(), out.triangles.view(), out.ecol.view());
}

template <class Index>
std::vector<Mesh> meshes_of(const Meshes<Index>& meshes, const Order<Index>& order) {
  std::vector<Mesh> all(meshes.ranges.size());
  for (std::size_t m = 0; m < all.size(); ++m) {
    const MeshRange& range = meshes.ranges[m];
    const std::uint32_t least = order.min_vertices[m];
    all[m] = {range.first_vertex, range.first_triangle, range.first_map + least, least, range.vertices};
  }
  return all;
}

#define PGL_INSTANTIATE(Index)                                                              \
  template Order<Index> room_for_order(const Meshes<Index>&, std::size_t);                  \
  template void order(const Meshes<Index>&, const EcolOptions&, const Order<Index>&);       \
  template Arranged<Index> room_for_arranged(const Meshes<Index>&);                         \
  template void arrange(const Meshes<Index>&, const Order<Index>&, const Arranged<Index>&); \
  template std::vector<Mesh> meshes_of(const Meshes<Index>&, const Order<Index>&);
PGL_INSTANTIATE(std::uint16_t)
PGL_INSTANTIATE(std::uint32_t)
#undef PGL_INSTANTIATE

}  // namespace pgl::bench
