// SPDX-License-Identifier: MIT
// The trade of speed for accuracy in build_ecol, per order, cost metric, boundary rule, precision and index width: root
// mean square surface error at 50, 10 and 1 % of the triangles, time for all levels, and what the levels then cost. One
// CSV row each; bench/accuracy.py makes the table and the picture of them.
#include <meshoptimizer.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "pgl/host/build_ecol.hpp"
#include "pgl/host/rearrange.hpp"
#include "pgl/host/reform.hpp"
#include "scene/import.hpp"
#include "surface_distance.hpp"
#include "timing.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

using pgl::Triangle;
using pgl::scene::MeshData;
constexpr std::size_t samples = 100000;
constexpr double shares[] = {0.5, 0.1, 0.01};
constexpr int repetitions = 5;  ///< of what is timed

/// Milliseconds of body(): the least of some, since others share the machine.
template <class Body>
double least_ms(Body&& body) {
  return pgl::bench::least_ms(repetitions, body);
}

void use_threads([[maybe_unused]] std::size_t threads) {
#if defined(_OPENMP)
  omp_set_num_threads(static_cast<int>(threads));
#endif
}

double diagonal(const MeshData& mesh) {
  const pgl::Box box = pgl::host::bounds(mesh.positions);
  return glm::length(glm::dvec3(box.max) - glm::dvec3(box.min));
}

struct Way {
  const char* name;
  pgl::EcolOptions options;
  bool wide;    ///< cost in double
  bool narrow;  ///< 16-bit indices
};

/// All levels of one mesh in one way, and how long what took.
template <class Real, class Index>
struct Levels {
  std::vector<Triangle<Index>> triangles;
  std::vector<Index> ecol, permute_v;
  std::vector<std::uint32_t> permute_t, map;
  std::uint32_t least = 0;
  double one_core_ms = 0, all_cores_ms = 0, rearrange_ms = 0, reform_ms = 0;

  Levels(const MeshData& mesh, const pgl::EcolOptions& options, std::size_t threads)
      : triangles(mesh.triangles.size()),
        ecol(mesh.positions.size()),
        permute_v(mesh.positions.size()),
        permute_t(mesh.triangles.size()),
        map(mesh.positions.size() + 1) {
    for (std::size_t t = 0; t < triangles.size(); ++t)
      for (int c = 0; c < 3; ++c) triangles[t].v[c] = static_cast<Index>(mesh.triangles[t].v[c]);
    pgl::host::EcolWorkspace<Real> work;
    const auto build = [&] {
      least = pgl::host::build_ecol<Real, Index>(mesh.positions, triangles, {}, options, work, ecol, permute_v,
                                                 permute_t, map, {});
    };
    build();
    one_core_ms = least_ms(build);
    if (options.order == pgl::EcolOrder::rounds) {
      use_threads(threads);
      all_cores_ms = least_ms(build);
      use_threads(1);
    }

    std::vector<glm::vec3> vertices(mesh.positions.size());
    std::vector<Triangle<Index>> ordered(triangles.size());
    std::vector<Index> targets(ecol.size());
    rearrange_ms = least_ms([&] {
      pgl::host::rearrange<glm::vec3, Index>(mesh.positions, triangles, ecol, permute_v, permute_t, vertices, ordered,
                                             targets);
    });
    const std::uint32_t half = std::max(least, static_cast<std::uint32_t>(vertices.size() / 2));
    pgl::host::ReformWorkspace<Index> reform_work;
    std::vector<Triangle<Index>> level(map[half]);
    reform_ms = least_ms(
        [&] { pgl::host::reform_mesh<Index>(std::span(ordered).first(map[half]), targets, half, reform_work, level); });
  }

  /// The mesh at the finest level of at most `most` triangles.
  std::vector<Triangle<std::uint32_t>> at_most(const MeshData& mesh, std::size_t most) const {
    auto k = static_cast<std::uint32_t>(mesh.positions.size());
    while (k > least && map[k] > most) --k;
    std::vector<Triangle<std::uint32_t>> level;
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      if (permute_t[t] >= map[k]) continue;
      level.push_back(mesh.triangles[t]);
      for (std::uint32_t& v : level.back().v)
        while (permute_v[v] >= k) v = ecol[v];
    }
    return level;
  }
};

std::string text(const char* format, double value) {
  char out[64];
  std::snprintf(out, sizeof out, format, value);
  return out;
}

/// The rows of one mesh; the first, of the peer, is its time for these three levels together.
class Study {
 public:
  Study(std::string name, const MeshData& mesh, std::size_t threads)
      : name_(std::move(name)),
        mesh_(mesh),
        full_(mesh.positions, mesh.triangles),
        unit_(1e4 / diagonal(mesh)),
        threads_(threads) {
    std::vector<Triangle<std::uint32_t>> level(mesh.triangles.size());
    double ms = 0;
    for (int i = 0; i < 3; ++i) {
      const auto asked = static_cast<std::size_t>(shares[i] * static_cast<double>(mesh.triangles.size()));
      level.resize(mesh.triangles.size());
      std::size_t size = 0;
      ms += least_ms([&] {
        size =
            meshopt_simplify(&level[0].v[0], &mesh.triangles[0].v[0], 3 * mesh.triangles.size(), &mesh.positions[0].x,
                             mesh.positions.size(), sizeof(glm::vec3), 3 * asked, 1e9f, 0, nullptr) /
            3;
      });
      level.resize(size);
      peer_size_[i] = size;
      peer_error_[i] = error(i, level);
    }
    std::printf("%s,%zu,%zu,meshopt_simplify,32,%.4f,%.4f,%.4f,1,1,1,%.2f,,,,,\n", name_.c_str(), mesh.positions.size(),
                mesh.triangles.size(), peer_error_[0], peer_error_[1], peer_error_[2], ms);
  }

  void row(const Way& way) {
    if (way.narrow && mesh_.positions.size() > pgl::no_target<std::uint16_t>) return;
    if (way.wide)
      row_of<double, std::uint32_t>(way);
    else if (way.narrow)
      row_of<float, std::uint16_t>(way);
    else
      row_of<float, std::uint32_t>(way);
  }

 private:
  using Level = std::vector<Triangle<std::uint32_t>>;

  /// Of a level at share i. Several ways come to the same level, those of another index width always: measured once.
  double error(int i, const Level& level) {
    for (const auto& [known, e] : known_[i])
      if (known == level) return e;
    known_[i].emplace_back(
        level, unit_ * pgl::bench::symmetric_rms(full_, pgl::bench::Surface(mesh_.positions, level), samples));
    return known_[i].back().second;
  }

  template <class Real, class Index>
  void row_of(const Way& way) {
    const Levels<Real, Index> levels(mesh_, way.options, threads_);
    std::string errors, ratios;
    for (int i = 0; i < 3; ++i) {
      // A way that does not get there has no figure: its coarsest level is too fine.
      const bool reached = levels.map[levels.least] <= peer_size_[i];
      const double e = reached ? error(i, levels.at_most(mesh_, peer_size_[i])) : 0;
      errors += (reached ? text("%.4f", e) : "") + ",";
      ratios += (reached ? text("%.4f", e / peer_error_[i]) : "") + ",";
    }
    const std::string all_cores = levels.all_cores_ms > 0 ? text("%.2f", levels.all_cores_ms) : "";
    const std::size_t bytes = sizeof(Index) * (3 * levels.triangles.size() + levels.ecol.size());
    std::printf("%s,%zu,%zu,\"%s\",%zu,%s%s%.2f,%s,,%.3f,%.3f,%zu\n", name_.c_str(), mesh_.positions.size(),
                mesh_.triangles.size(), way.name, 8 * sizeof(Index), errors.c_str(), ratios.c_str(), levels.one_core_ms,
                all_cores.c_str(), levels.rearrange_ms, levels.reform_ms, bytes);
    std::fflush(stdout);
  }

  std::string name_;
  const MeshData& mesh_;
  pgl::bench::Surface full_;
  double unit_;
  std::size_t threads_;
  std::size_t peer_size_[3] = {};
  double peer_error_[3] = {};
  std::vector<std::pair<Level, double>> known_[3];
};

std::vector<Way> ways() {
  using enum pgl::CostMetric;
  using enum pgl::BoundaryRule;
  const auto greedy = pgl::EcolOrder::greedy, rounds = pgl::EcolOrder::rounds;
  return {{"quadric", {.metric = quadric, .boundary = slide, .order = greedy}, false, false},
          {"quadric, rounds", {.metric = quadric, .boundary = slide, .order = rounds}, false, false},
          {"melax", {.metric = melax, .boundary = slide, .order = greedy}, false, false},
          {"melax, rounds", {.metric = melax, .boundary = slide, .order = rounds}, false, false},
          {"quadric", {.metric = quadric, .boundary = slide, .order = greedy}, false, true},
          {"quadric, rounds", {.metric = quadric, .boundary = slide, .order = rounds}, false, true},
          {"melax", {.metric = melax, .boundary = slide, .order = greedy}, false, true},
          {"melax, rounds", {.metric = melax, .boundary = slide, .order = rounds}, false, true},
          {"edge length", {.metric = edge_length, .boundary = slide}, false, false},
          {"quadric, double", {.metric = quadric, .boundary = slide}, true, false},
          {"quadric, no flip guard", {.metric = quadric, .boundary = slide, .flip_guard = false}, false, false},
          {"quadric, locked", {.metric = quadric, .boundary = locked}, false, false}};
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::fprintf(stderr, "usage: ecol_accuracy MODEL...   (every object of each model is one row set)\n");
    return 2;
  }
  const std::size_t threads = pgl::host::thread_count();
  use_threads(1);
  std::printf(
      "model,vertices,triangles,method,index_bits,rms_50,rms_10,rms_1,ratio_50,ratio_10,ratio_1,ms_one_core,"
      "ms_all_cores,ms_gpu,rearrange_ms,reform_half_ms,bytes\n");
  for (int i = 1; i < argc; ++i) {
    const auto scene = pgl::scene::import_scene(argv[i]);
    const std::string model = std::filesystem::path(argv[i]).stem().string();
    for (const MeshData& mesh : scene.meshes) {
      if (mesh.triangles.size() < 1000) continue;
      Study study(model, mesh, threads);
      for (const Way& way : ways()) study.row(way);
    }
  }
} catch (const std::exception& e) {
  std::fprintf(stderr, "ecol_accuracy: %s\n", e.what());
  return 1;
}
