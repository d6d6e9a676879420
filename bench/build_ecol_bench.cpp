// SPDX-License-Identifier: MIT
// Collapse order, every level recorded, against meshoptimizer's chain of ten halvings, each from the last, in the same
// run; rounds on one thread and on all, batches of meshes on all.
#include <benchmark/benchmark.h>
#include <meshoptimizer.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "pgl/host/build_ecol.hpp"
#include "scene/plant.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

using pgl::scene::MeshData;

/// Plant objects of 300 to 700 triangles: about 470 on average, as in the papers' Boeing.
std::vector<MeshData> plant_parts() {
  const pgl::scene::PlantOptions plant{4000, 1};
  std::vector<MeshData> parts;
  for (std::size_t i = 0; i < plant.objects && parts.size() < 200; ++i) {
    const auto size = pgl::scene::plant_object_size(plant, i);
    if (size.triangles < 300 || size.triangles > 700) continue;
    parts.emplace_back();
    pgl::scene::plant_object(plant, i, parts.back());
  }
  return parts;
}

/// A closed surface, bumpy everywhere, of 2 * around * across triangles.
MeshData bumpy_torus(std::uint32_t around, std::uint32_t across) {
  MeshData mesh;
  for (std::uint32_t i = 0; i < around; ++i)
    for (std::uint32_t j = 0; j < across; ++j) {
      const double u = 2 * M_PI * i / around, v = 2 * M_PI * j / across;
      const double r = 1 + 0.4 * std::cos(v) + 0.02 * std::sin(9 * u) * std::cos(5 * v);
      mesh.positions.emplace_back(r * std::cos(u), r * std::sin(u), 0.4 * std::sin(v));
      const std::uint32_t i1 = (i + 1) % around, j1 = (j + 1) % across;
      const std::uint32_t a = i * across + j, b = i1 * across + j, c = i1 * across + j1, d = i * across + j1;
      mesh.triangles.push_back({{a, b, c}});
      mesh.triangles.push_back({{a, c, d}});
    }
  return mesh;
}

double seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

struct Outputs {
  std::vector<std::uint32_t> ecol, permute_v, permute_t, map;
};

template <class Real>
void collapse(const MeshData& mesh, const pgl::EcolOptions& options, pgl::host::EcolWorkspace<Real>& work,
              Outputs& out) {
  out.ecol.resize(mesh.positions.size());
  out.permute_v.resize(mesh.positions.size());
  out.permute_t.resize(mesh.triangles.size());
  out.map.resize(mesh.positions.size() + 1);
  pgl::host::build_ecol<Real, std::uint32_t>(mesh.positions, mesh.triangles, {}, options, work, out.ecol, out.permute_v,
                                             out.permute_t, out.map, {});
}

/// Ten halvings, or as many as make progress.
void halve(const MeshData& mesh, std::vector<unsigned>& from, std::vector<unsigned>& to) {
  from.assign(&mesh.triangles[0].v[0], &mesh.triangles[0].v[0] + 3 * mesh.triangles.size());
  to.resize(from.size());
  std::size_t size = from.size();
  for (int i = 0; i < 10; ++i) {
    const std::size_t next = meshopt_simplify(to.data(), from.data(), size, &mesh.positions[0].x, mesh.positions.size(),
                                              sizeof(glm::vec3), size / 6 * 3, 1e9f, 0, nullptr);
    from.swap(to);
    if (next == size) break;
    size = next;
  }
}

void use_threads([[maybe_unused]] std::size_t threads) {
#if defined(_OPENMP)
  omp_set_num_threads(static_cast<int>(threads));
#endif
}

/// Times the batch call on `threads` threads, on as many meshes as there are.
void batch(benchmark::State& state, const std::vector<MeshData>& meshes, const pgl::EcolOptions& options,
           std::size_t threads) {
  std::vector<glm::vec3> positions;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
  std::vector<pgl::MeshRange> ranges;
  std::uint64_t entries = 0;
  for (const MeshData& mesh : meshes) {
    ranges.push_back({positions.size(), triangles.size(), entries, static_cast<std::uint32_t>(mesh.positions.size()),
                      static_cast<std::uint32_t>(mesh.triangles.size())});
    positions.insert(positions.end(), mesh.positions.begin(), mesh.positions.end());
    triangles.insert(triangles.end(), mesh.triangles.begin(), mesh.triangles.end());
    entries += mesh.positions.size() + 1;
  }
  std::vector<pgl::host::EcolWorkspace<float>> work;
  Outputs out;
  out.ecol.resize(positions.size());
  out.permute_v.resize(positions.size());
  out.permute_t.resize(triangles.size());
  out.map.resize(entries);
  std::vector<std::uint32_t> min_vertices(ranges.size());
  const std::size_t before = pgl::host::thread_count();
  use_threads(threads);
  for (auto _ : state)
    pgl::host::build_ecol<float, std::uint32_t>(ranges, positions, triangles, {}, options, work, out.ecol,
                                                out.permute_v, out.permute_t, out.map, {}, min_vertices);
  use_threads(before);
  const auto total = static_cast<double>(triangles.size()) * static_cast<double>(state.iterations());
  state.counters["Mtri_per_s"] = benchmark::Counter(total / 1e6, benchmark::Counter::kIsRate);
}

/// Times pgl; the peer runs in the same iteration, one after the other, so that a noisy machine treats both alike.
template <class Real = float>
void compare(benchmark::State& state, const std::vector<MeshData>& meshes, const pgl::EcolOptions& options) {
  pgl::host::EcolWorkspace<Real> work;
  Outputs out;
  std::vector<unsigned> from, to;
  std::size_t triangles = 0;
  for (const MeshData& mesh : meshes) triangles += mesh.triangles.size();
  double ours = 0, peers = 0;
  for (auto _ : state) {
    const double start = seconds();
    for (const MeshData& mesh : meshes) collapse<Real>(mesh, options, work, out);
    const double middle = seconds();
    for (const MeshData& mesh : meshes) halve(mesh, from, to);
    peers += seconds() - middle;
    ours += middle - start;
    state.SetIterationTime(middle - start);
  }
  const auto total = static_cast<double>(triangles) * static_cast<double>(state.iterations());
  state.counters["Mtri_per_s"] = total / ours / 1e6;
  state.counters["meshopt_Mtri_per_s"] = total / peers / 1e6;
  state.counters["ratio"] = peers / ours;
}

pgl::EcolOptions with(pgl::CostMetric metric, pgl::BoundaryRule boundary = pgl::BoundaryRule::locked,
                      bool flip_guard = true) {
  pgl::EcolOptions o;
  o.metric = metric;
  o.boundary = boundary;
  o.flip_guard = flip_guard;
  return o;
}

void register_all() {
  using enum pgl::CostMetric;
  const auto add = [](const char* name, auto meshes, pgl::EcolOptions options, auto real) {
    benchmark::RegisterBenchmark(name,
                                 [=](benchmark::State& state) { compare<decltype(real)>(state, meshes, options); })
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond);
  };
  const std::vector<MeshData> small(100, bumpy_torus(16, 15));
  const std::vector<MeshData> parts = plant_parts();
  const std::vector<MeshData> medium{bumpy_torus(300, 144)};
  const std::vector<MeshData> large{bumpy_torus(1500, 1000)};
  add("build_ecol/quadric/closed_480", small, with(quadric), 0.0f);
  add("build_ecol/quadric/plant_470", parts, with(quadric), 0.0f);
  add("build_ecol/quadric_slide/plant_470", parts, with(quadric, pgl::BoundaryRule::slide), 0.0f);
  add("build_ecol/quadric/closed_86k", medium, with(quadric), 0.0f);
  add("build_ecol/quadric/closed_3M", large, with(quadric), 0.0f);
  add("build_ecol/quadric_unguarded/closed_480", small, with(quadric, pgl::BoundaryRule::locked, false), 0.0f);
  add("build_ecol/quadric_double/closed_480", small, with(quadric), 0.0);
  add("build_ecol/melax/closed_480", small, with(melax), 0.0f);
  add("build_ecol/edge_length/closed_480", small, with(edge_length), 0.0f);
  const auto add_batch = [](const std::string& name, auto meshes, pgl::EcolOptions options) {
    for (const std::size_t threads : {std::size_t{1}, pgl::host::thread_count()}) {
      benchmark::RegisterBenchmark((name + "/threads:" + std::to_string(threads)).c_str(),
                                   [=](benchmark::State& state) { batch(state, meshes, options, threads); })
          ->UseRealTime()
          ->Unit(benchmark::kMillisecond);
      if (pgl::host::thread_count() == 1) break;
    }
  };
  pgl::EcolOptions rounds = with(quadric), melax_rounds = with(melax);
  rounds.order = melax_rounds.order = pgl::EcolOrder::rounds;
  add_batch("build_ecol_batch/quadric/closed_480", small, with(quadric));
  add_batch("build_ecol_batch/quadric_rounds/closed_480", small, rounds);
  add_batch("build_ecol_batch/quadric/plant_470", parts, with(quadric));
  add_batch("build_ecol_rounds/quadric/closed_86k", medium, rounds);
  add_batch("build_ecol_rounds/melax/closed_86k", medium, melax_rounds);
  add_batch("build_ecol_rounds/quadric/closed_3M", large, rounds);
}

}  // namespace

int main(int argc, char** argv) {
  register_all();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
