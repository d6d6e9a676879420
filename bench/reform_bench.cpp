// SPDX-License-Identifier: MIT
// reform against the plain loop of the paper, and gather against memcpy: 15 million triangles, one core and all.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <map>
#include <random>
#include <span>
#include <thread>
#include <tuple>
#include <vector>

#include "pgl/host/gather.hpp"
#include "pgl/host/reform.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

/// Objects that all show `shown` triangles of meshes of `full` triangles, half as many vertices each; every mesh stands
/// in several places, as in an assembly.
template <class Index>
struct Scene {
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<glm::vec3> vertices;
  std::vector<pgl::Triangle<Index>> triangles;
  std::vector<Index> ecol;
  std::vector<std::uint32_t> counts;
  std::vector<std::uint64_t> vertex_offsets{0}, triangle_offsets{0};

  std::uint64_t shown_vertices() const { return vertex_offsets.back(); }
  std::uint64_t shown_triangles() const { return triangle_offsets.back(); }

  /// The target of v is any earlier vertex, as when the collapses spread evenly over a surface: the number of steps
  /// from v to one below k is then about Poisson of mean ln(v / k). Or, `one_chain`, it is the vertex before.
  Scene(std::uint32_t object_count, std::uint32_t full, std::uint32_t shown, bool one_chain = false) {
    std::mt19937 random(1);
    const std::uint32_t mesh_vertices = full / 2, mesh_count = std::max(1u, object_count / 18);
    for (std::uint32_t m = 0; m < mesh_count; ++m) {
      meshes.push_back(
          {.first_vertex = vertices.size(), .first_triangle = triangles.size(), .max_vertices = mesh_vertices});
      for (std::uint32_t v = 0; v < mesh_vertices; ++v) {
        vertices.emplace_back(static_cast<float>(random() % 1000), static_cast<float>(v), 1.0f);
        const std::uint32_t target = v == 0 ? 0 : one_chain ? v - 1 : random() % v;
        ecol.push_back(v == 0 ? pgl::no_target<Index> : static_cast<Index>(target));
      }
      for (std::uint32_t t = 0; t < full; ++t) {
        const auto corner = [&] { return static_cast<Index>(random() % mesh_vertices); };
        triangles.push_back({{corner(), corner(), corner()}});
      }
    }
    for (std::uint32_t i = 0; i < object_count; ++i) {
      pgl::Object object{.mesh = static_cast<std::uint32_t>(random() % mesh_count)};
      object.transform[0] = glm::vec3(i % 9 == 0 ? -1.0f : 1.0f, 0.0f, 0.0f);
      object.transform[3] = glm::vec3(static_cast<float>(i));
      objects.push_back(object);
      counts.push_back(shown / 2);
      vertex_offsets.push_back(vertex_offsets.back() + shown / 2);
      triangle_offsets.push_back(triangle_offsets.back() + shown);
    }
  }

  double steps_per_corner() const {
    std::uint64_t steps = 0;
    const std::size_t sample = std::min<std::size_t>(objects.size(), 1000);
    for (std::size_t i = 0; i < sample; ++i) {
      const pgl::Mesh& mesh = meshes[objects[i].mesh];
      for (std::uint64_t t = 0; t < triangle_offsets[1]; ++t) {
        for (std::uint32_t v : triangles[mesh.first_triangle + t].v) {
          for (; v >= counts[i]; ++steps) v = ecol[mesh.first_vertex + v];
        }
      }
    }
    return static_cast<double>(steps) / static_cast<double>(3 * sample * triangle_offsets[1]);
  }
};

/// The peer: the loop as the paper prints it, over a range of objects.
template <class Index>
void plain(const Scene<Index>& s, std::size_t first, std::size_t last, std::vector<pgl::Triangle<std::uint32_t>>& out) {
  std::for_each(s.objects.begin() + static_cast<std::ptrdiff_t>(first),
                s.objects.begin() + static_cast<std::ptrdiff_t>(last), [&](const pgl::Object& object) {
                  const auto i = static_cast<std::size_t>(&object - s.objects.data());
                  const pgl::Mesh& mesh = s.meshes[object.mesh];
                  const Index* ecol = s.ecol.data() + mesh.first_vertex;
                  const std::uint32_t count = s.counts[i];
                  const auto base = static_cast<std::uint32_t>(s.vertex_offsets[i]);
                  const bool mirror = pgl::mirrored(object.transform);
                  const pgl::Triangle<Index>* in = s.triangles.data() + mesh.first_triangle;
                  for (std::uint64_t t = s.triangle_offsets[i]; t < s.triangle_offsets[i + 1]; ++t, ++in) {
                    std::uint32_t corners[3];
                    for (int c = 0; c < 3; ++c) {
                      std::uint32_t v = in->v[c];
                      while (v >= count) v = ecol[v];
                      corners[c] = base + v;
                    }
                    if (mirror) std::swap(corners[1], corners[2]);
                    out[t] = {{corners[0], corners[1], corners[2]}};
                  }
                });
}

template <class Body>
void on_threads(std::size_t threads, std::size_t n, Body body) {
  std::vector<std::thread> running;
  for (std::size_t k = 1; k < threads; ++k) running.emplace_back([=] { body(n * k / threads, n * (k + 1) / threads); });
  body(0, n / threads);
  for (auto& thread : running) thread.join();
}

template <class Body>
double best_seconds(int runs, Body body) {
  double best = 1e30;
  for (int run = 0; run < runs; ++run) {
    const auto start = std::chrono::steady_clock::now();
    body();
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

const std::size_t all_threads = pgl::host::thread_count();

std::size_t use_threads(bool all) {
  const std::size_t n = all ? all_threads : 1;
#if defined(_OPENMP)
  omp_set_num_threads(static_cast<int>(n));
#endif
  return n;
}

template <class Index>
const Scene<Index>& scene_of(std::uint32_t objects, std::uint32_t full, std::uint32_t shown, bool one_chain = false) {
  static std::map<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t, bool>, Scene<Index>> scenes;
  const auto key = std::tuple(objects, full, shown, one_chain);
  if (!scenes.contains(key)) scenes.clear();  // one at a time
  return scenes.try_emplace(key, objects, full, shown, one_chain).first->second;
}

template <class Index>
void reform(const Scene<Index>& s, pgl::host::ReformWorkspace<Index>& workspace,
            std::vector<pgl::Triangle<std::uint32_t>>& out) {
  pgl::host::reform<Index>(s.meshes, s.objects, s.triangles, s.ecol, s.counts, s.vertex_offsets, s.triangle_offsets,
                           workspace, out);
}

// Arguments: objects, triangles of a full mesh, triangles shown of each, all cores.
template <class Index>
void reform_against_plain(benchmark::State& state) {
  const auto argument = [&](int i) { return static_cast<std::uint32_t>(state.range(i)); };
  const auto& s = scene_of<Index>(argument(0), argument(1), argument(2));
  std::vector<pgl::Triangle<std::uint32_t>> out(s.shown_triangles()), expected(s.shown_triangles());
  pgl::host::ReformWorkspace<Index> workspace;
  const std::size_t used = use_threads(state.range(3) != 0);
  for (auto _ : state) {
    reform(s, workspace, out);
    benchmark::ClobberMemory();
  }
  const double ours = best_seconds(3, [&] { reform(s, workspace, out); });
  const double theirs = best_seconds(3, [&] {
    on_threads(used, s.objects.size(), [&](std::size_t first, std::size_t last) { plain(s, first, last, expected); });
  });
  if (out != expected) state.SkipWithError("the two differ");
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(s.shown_triangles()));
  state.counters["threads"] = static_cast<double>(used);
  state.counters["steps_per_corner"] = s.steps_per_corner();
  state.counters["plain_ms"] = theirs * 1e3;
  state.counters["times_plain"] = theirs / ours;
}

void frames(benchmark::internal::Benchmark* b) {
  b->ArgNames({"objects", "full", "shown", "all_cores"})->Unit(benchmark::kMillisecond)->UseRealTime();
  for (const int all : {0, 1}) {
    b->Args({36000, 470, 470, all});   // everything shown
    b->Args({36000, 470, 420, all});   // nearly everything
    b->Args({36000, 7520, 420, all});  // one vertex in 18
    b->Args({718000, 470, 22, all});   // the frame of Peng13 Table 4.5: one vertex in 21
    b->Args({1, 20000000, 15000000, all});
  }
}
BENCHMARK(reform_against_plain<std::uint32_t>)->Apply(frames);
BENCHMARK(reform_against_plain<std::uint16_t>)->Apply([](benchmark::internal::Benchmark* b) {
  b->ArgNames({"objects", "full", "shown", "all_cores"})->Unit(benchmark::kMillisecond)->UseRealTime();
  for (const int all : {0, 1}) {
    b->Args({36000, 470, 420, all});
    b->Args({36000, 7520, 420, all});
    b->Args({718000, 470, 22, all});
  }
});

// Every mesh one chain. The plain loop does ten triangles, and that is scaled up.
void reform_one_chain(benchmark::State& state) {
  const auto argument = [&](int i) { return static_cast<std::uint32_t>(state.range(i)); };
  using Index = std::uint32_t;
  const std::size_t used = use_threads(state.range(3) != 0);
  double ordinary = 0;
  {
    const auto& s = scene_of<Index>(argument(0), argument(1), argument(2));
    std::vector<pgl::Triangle<std::uint32_t>> out(s.shown_triangles());
    pgl::host::ReformWorkspace<Index> workspace;
    ordinary = best_seconds(5, [&] { reform(s, workspace, out); });
  }
  auto s = scene_of<Index>(argument(0), argument(1), argument(2), true);
  std::vector<pgl::Triangle<std::uint32_t>> out(s.shown_triangles());
  pgl::host::ReformWorkspace<Index> workspace;
  for (auto _ : state) {
    reform(s, workspace, out);
    benchmark::ClobberMemory();
  }
  const double ours = best_seconds(5, [&] { reform(s, workspace, out); });
  const auto shown = s.shown_triangles();
  const std::uint64_t sample = std::min<std::uint64_t>(10, s.triangle_offsets[1]);
  s.triangle_offsets[1] = sample;
  const double theirs = best_seconds(1, [&] { plain(s, 0, 1, out); });
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(shown));
  state.counters["threads"] = static_cast<double>(used);
  state.counters["plain_s_one_core_scaled"] = theirs * static_cast<double>(shown) / static_cast<double>(sample);
  state.counters["times_ordinary_time"] = ours / ordinary;
}
BENCHMARK(reform_one_chain)
    ->ArgNames({"objects", "full", "shown", "all_cores"})
    ->Args({36000, 7520, 420, 0})
    ->Args({36000, 7520, 420, 1})
    ->Args({1, 20000000, 5000000, 0})
    ->Args({1, 20000000, 5000000, 1})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

// Bytes read and written per second, against memcpy of as many on as many threads.
template <class Placed>
void gather_against_memcpy(benchmark::State& state) {
  const std::size_t used = use_threads(state.range(2) != 0);
  const auto shown = static_cast<std::uint32_t>(state.range(1));
  const auto& s = scene_of<std::uint32_t>(static_cast<std::uint32_t>(state.range(0)), 470, shown);
  std::vector<Placed> out(s.shown_vertices());
  const auto run = [&] {
    pgl::host::gather<Placed, glm::vec3>(s.meshes, s.objects, s.vertices, s.counts, s.vertex_offsets, out);
  };
  for (auto _ : state) {
    run();
    benchmark::ClobberMemory();
  }
  const double ours = best_seconds(5, run);
  const std::size_t bytes = s.shown_vertices() * (sizeof(glm::vec3) + sizeof(Placed));
  std::vector<char> from(bytes / 2, 1), to(bytes / 2);
  const double copy = best_seconds(5, [&] {
    on_threads(used, from.size(), [&](std::size_t first, std::size_t last) {
      std::memcpy(to.data() + first, from.data() + first, last - first);
    });
    benchmark::DoNotOptimize(to.data());
  });
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(s.shown_vertices()));
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
  state.counters["threads"] = static_cast<double>(used);
  state.counters["memcpy_GB/s"] = static_cast<double>(bytes) / copy * 1e-9;
  state.counters["of_memcpy"] = copy / ours;
}
void selections(benchmark::internal::Benchmark* b) {
  b->ArgNames({"objects", "shown", "all_cores"})->Unit(benchmark::kMillisecond)->UseRealTime();
  for (const int all : {0, 1}) b->Args({36000, 470, all})->Args({718000, 22, all});
}
BENCHMARK(gather_against_memcpy<glm::vec3>)->Apply(selections);
BENCHMARK(gather_against_memcpy<pgl::PlacedVertex>)->Apply(selections);

}  // namespace

BENCHMARK_MAIN();
