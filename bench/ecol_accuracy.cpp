// SPDX-License-Identifier: MIT
// The trade of speed for accuracy in build_ecol: root mean square surface error at 50, 10 and 1 % of the triangles, and
// time, per cost metric, boundary rule and precision, next to meshoptimizer at the same triangle count. One CSV row
// each.
#include <meshoptimizer.h>

#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "pgl/host/build_ecol.hpp"
#include "scene/import.hpp"
#include "surface_distance.hpp"

namespace {

using pgl::Triangle;
using pgl::scene::MeshData;
constexpr std::size_t samples = 100000;

double seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double diagonal(const MeshData& mesh) {
  const pgl::Box box = pgl::host::bounds(mesh.positions);
  return glm::length(glm::dvec3(box.max) - glm::dvec3(box.min));
}

struct Levels {
  std::vector<std::uint32_t> ecol, permute_v, permute_t, map;
  std::uint32_t least = 0;
  double ms = 0;

  /// The mesh at the finest level of at most `triangles` triangles.
  std::vector<Triangle<std::uint32_t>> at_most(const MeshData& mesh, std::size_t triangles) const {
    auto k = static_cast<std::uint32_t>(mesh.positions.size());
    while (k > least && map[k] > triangles) --k;
    std::vector<Triangle<std::uint32_t>> level;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      if (permute_t[t] >= map[k]) continue;
      level.push_back(mesh.triangles[t]);
      for (std::uint32_t& v : level.back().v)
        while (permute_v[v] >= k) v = ecol[v];
    }
    return level;
  }
};

template <class Real>
Levels build(const MeshData& mesh, const pgl::EcolOptions& options) {
  const std::size_t vertices = mesh.positions.size();
  Levels l;
  l.ecol.resize(vertices);
  l.permute_v.resize(vertices);
  l.permute_t.resize(mesh.triangles.size());
  l.map.resize(vertices + 1);
  pgl::host::EcolWorkspace<Real> work;
  const double start = seconds();
  l.least = pgl::host::build_ecol<Real, std::uint32_t>(mesh.positions, mesh.triangles, {}, options, work, l.ecol,
                                                       l.permute_v, l.permute_t, l.map, {});
  l.ms = 1e3 * (seconds() - start);
  return l;
}

void study(const std::string& name, const MeshData& mesh) {
  struct Way {
    const char* name;
    pgl::CostMetric metric;
    pgl::BoundaryRule boundary;
    bool flip_guard, wide;
  };
  using enum pgl::CostMetric;
  using enum pgl::BoundaryRule;
  const Way ways[] = {{"quadric", quadric, locked, true, false},
                      {"quadric slide", quadric, slide, true, false},
                      {"quadric slide, double", quadric, slide, true, true},
                      {"quadric slide, no flip guard", quadric, slide, false, false},
                      {"melax", melax, locked, true, false},
                      {"melax slide", melax, slide, true, false},
                      {"edge length", edge_length, locked, true, false},
                      {"edge length slide", edge_length, slide, true, false}};
  const pgl::bench::Surface full(mesh.positions, mesh.triangles);
  const double unit = 1e4 / diagonal(mesh);
  const auto error = [&](const std::vector<Triangle<std::uint32_t>>& level) {
    return unit * pgl::bench::symmetric_rms(full, pgl::bench::Surface(mesh.positions, level), samples);
  };
  for (const double share : {0.5, 0.1, 0.01}) {
    const auto asked = static_cast<std::size_t>(share * static_cast<double>(mesh.triangles.size()));
    std::vector<Triangle<std::uint32_t>> peer(mesh.triangles.size());
    const double start = seconds();
    peer.resize(meshopt_simplify(&peer[0].v[0], &mesh.triangles[0].v[0], 3 * mesh.triangles.size(),
                                 &mesh.positions[0].x, mesh.positions.size(), sizeof(glm::vec3), 3 * asked, 1e9f, 0,
                                 nullptr) /
                3);
    const double peer_ms = 1e3 * (seconds() - start);
    const double peer_error = error(peer);
    std::printf("%s,%g,meshopt_simplify,%zu,%.3f,1,%.1f\n", name.c_str(), share, peer.size(), peer_error, peer_ms);
    for (const Way& way : ways) {
      pgl::EcolOptions options;
      options.metric = way.metric;
      options.boundary = way.boundary;
      options.flip_guard = way.flip_guard;
      const Levels levels = way.wide ? build<double>(mesh, options) : build<float>(mesh, options);
      const auto level = levels.at_most(mesh, peer.size());
      if (level.size() + 4 < peer.size() || levels.map[levels.least] > peer.size()) {
        std::printf("%s,%g,%s,%u,,,%.1f\n", name.c_str(), share, way.name, levels.map[levels.least], levels.ms);
        continue;  // this rule does not get there: its coarsest level is the figure
      }
      const double e = error(level);
      std::printf("%s,%g,\"%s\",%zu,%.3f,%.3f,%.1f\n", name.c_str(), share, way.name, level.size(), e, e / peer_error,
                  levels.ms);
      std::fflush(stdout);
    }
  }
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fprintf(stderr, "usage: ecol_accuracy MODEL...   (every object of each model is one row set)\n");
    return 2;
  }
  std::printf("model,share,method,triangles,rms_1e4_of_diagonal,ratio_to_meshopt,ms_all_levels\n");
  for (int i = 1; i < argc; ++i) {
    const auto scene = pgl::scene::import_scene(argv[i]);
    const std::string model = std::filesystem::path(argv[i]).stem().string();
    for (const MeshData& mesh : scene.meshes)
      if (mesh.triangles.size() >= 1000) study(model, mesh);
  }
} catch (const std::exception& e) {
  std::fprintf(stderr, "ecol_accuracy: %s\n", e.what());
  return 1;
}
