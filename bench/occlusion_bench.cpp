// SPDX-License-Identifier: MIT
// Depth of occluders at 1920 x 1080: triangles per second by their size in pixels, on one core and on all.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <numbers>
#include <random>
#include <vector>

#include "pgl/host/rasterize_depth.hpp"

namespace {

constexpr float width = 1920, height = 1080;

struct Scene {
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<glm::vec3> vertices;
  std::vector<pgl::Triangle<std::uint16_t>> triangles;
  std::vector<std::uint32_t> map, occluders;
  pgl::View view;
  std::int64_t drawn = 0;  ///< triangles of all occluders

  /// A grid of columns x rows cells of two triangles each; at(u, v) says where.
  template <class At>
  void add_mesh(std::uint32_t columns, std::uint32_t rows, At&& at) {
    pgl::Mesh mesh{.first_vertex = vertices.size(), .first_triangle = triangles.size(), .first_map = map.size()};
    for (std::uint32_t j = 0; j <= rows; ++j)
      for (std::uint32_t i = 0; i <= columns; ++i)
        vertices.push_back(
            at(static_cast<float>(i) / static_cast<float>(columns), static_cast<float>(j) / static_cast<float>(rows)));
    for (std::uint32_t j = 0; j < rows; ++j)
      for (std::uint32_t i = 0; i < columns; ++i) {
        const auto a = static_cast<std::uint16_t>(j * (columns + 1) + i), b = static_cast<std::uint16_t>(a + 1);
        const auto c = static_cast<std::uint16_t>(a + columns + 1), d = static_cast<std::uint16_t>(c + 1);
        triangles.push_back({{a, b, d}});
        triangles.push_back({{a, d, c}});
      }
    mesh.min_vertices = mesh.max_vertices = static_cast<std::uint32_t>(vertices.size() - mesh.first_vertex);
    map.push_back(2 * columns * rows);
    meshes.push_back(mesh);
  }
  void add_occluder(std::uint32_t mesh, const glm::mat4x3& transform) {
    occluders.push_back(static_cast<std::uint32_t>(objects.size()));
    objects.push_back({mesh, transform});
    drawn += map[mesh];
  }
};

pgl::View camera() {
  pgl::View v;
  v.clip_from_world = glm::perspective(1.0f, width / height, 0.1f, 1000.0f);
  v.width = width;
  v.height = height;
  v.near_depth = 0.1f;
  return v;
}

/// Twenty walls side by side that fill the picture with triangles of about so many pixels, seen a little askew.
Scene walls(double pixels) {
  Scene s;
  s.view = camera();
  const double cell = std::sqrt(2 * pixels);
  const auto columns = static_cast<std::uint32_t>(std::max(1.0, width / 5 / cell));
  const auto rows = static_cast<std::uint32_t>(std::max(1.0, height / 4 / cell));
  const float half_height = 10 * std::tan(0.5f), half_width = half_height * width / height;
  s.add_mesh(columns, rows, [&](float u, float v) {
    return glm::vec3((2 * u - 1) * half_width / 5, (2 * v - 1) * half_height / 4, 0.1f * u + 0.05f * v);
  });
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 5; ++i) {
      glm::mat4x3 place(1.0f);
      place[3] = {static_cast<float>(2 * i - 4) * half_width / 5, static_cast<float>(2 * j - 3) * half_height / 4, -10};
      s.add_occluder(0, place);
    }
  return s;
}

/// Twenty balls of 20 thousand triangles here and there: half of the triangles turn away, most are about a pixel.
Scene balls() {
  Scene s;
  s.view = camera();
  s.add_mesh(142, 71, [](float u, float v) {
    const float a = 2 * std::numbers::pi_v<float> * u, b = std::numbers::pi_v<float> * v;
    return glm::vec3(std::cos(a) * std::sin(b), std::cos(b), std::sin(a) * std::sin(b));
  });
  std::mt19937 random(1);
  const auto unit = [&] { return static_cast<float>(random() >> 8) * 0x1p-23f - 1; };
  for (int i = 0; i < 20; ++i) {
    glm::mat4x3 place(1.0f);
    place[3] = {8 * unit(), 4 * unit(), -14 + 6 * unit()};
    s.add_occluder(0, place);
  }
  return s;
}

void draw(benchmark::State& state, const Scene& s, std::int64_t threads) {
#if defined(_OPENMP)
  const int all = omp_get_max_threads();
  if (threads == 1) omp_set_num_threads(1);
#else
  (void)threads;
#endif
  const pgl::DepthMap size = pgl::depth_map_of(s.view);
  std::vector<pgl::Depth> depth(std::size_t{size.width} * size.height, pgl::far_depth);
  pgl::host::DepthWorkspace workspace;
  // Into a map that already holds what is drawn: every texel is visited and compared all the same.
  for (auto _ : state) {
    pgl::host::rasterize_depth<std::uint16_t>(s.meshes, s.objects, s.vertices, s.triangles, s.map, s.occluders, s.view,
                                              size, workspace, depth);
    benchmark::ClobberMemory();
  }
  const auto covered = depth.size() - static_cast<std::size_t>(std::ranges::count(depth, pgl::far_depth));
  state.SetItemsProcessed(state.iterations() * s.drawn);
  state.counters["triangles"] = static_cast<double>(s.drawn);
  state.counters["threads"] = static_cast<double>(pgl::host::thread_count());
  state.counters["covered"] = static_cast<double>(covered) / static_cast<double>(depth.size());
#if defined(_OPENMP)
  omp_set_num_threads(all);
#endif
}

void wall_depth(benchmark::State& state) {
  draw(state, walls(static_cast<double>(state.range(1))), state.range(0));
}
void ball_depth(benchmark::State& state) {
  draw(state, balls(), state.range(0));
}

// The first argument is the number of threads, 0 for all of them; the second the pixels of a triangle.
BENCHMARK(wall_depth)->ArgsProduct({{1, 0}, {2, 10, 100, 1000, 50000}})->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(ball_depth)->Arg(1)->Arg(0)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
