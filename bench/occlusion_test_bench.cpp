// SPDX-License-Identifier: MIT
// The hierarchical-Z map and the occlusion test at 1920 x 1080, on one core: levels, rectangles, boxes with projection.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <random>
#include <vector>

#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/project.hpp"

namespace {

constexpr std::size_t count = 718687;

float uniform(std::mt19937& random, float low, float high) {
  return low + (high - low) * (static_cast<float>(random() >> 8) * 0x1p-24f);
}

pgl::View view() {
  pgl::View v;
  v.clip_from_world = glm::perspective(1.0f, 16.0f / 9, 0.1f, 2000.0f) *
                      glm::lookAt(glm::vec3(-450, 30, 20), glm::vec3(100, 20, 0), glm::vec3(0, 1, 0));
  v.width = 1920;
  v.height = 1080;
  v.near_depth = 0.1f;
  return v;
}

/// Houses in a street: rectangles of random size and depth before an open background.
std::vector<pgl::Depth> depths_of(const pgl::DepthMap& size) {
  std::vector<pgl::Depth> texels(pgl::hzm_texels(size), pgl::far_depth);
  std::mt19937 random(1);
  for (int house = 0; house < 60; ++house) {
    const auto w = 20 + random() % (size.width / 4), h = 20 + random() % (size.height / 2);
    const auto x = random() % (size.width - w), y = random() % (size.height - h);
    const double distance = uniform(random, 20, 400);
    const pgl::Depth depth = pgl::depth_above(2000 / 1999.9 * (1 - 0.1 / distance));
    for (std::size_t j = y; j < y + h; ++j)
      for (std::size_t i = x; i < x + w; ++i) texels[j * size.width + i] = std::min(texels[j * size.width + i], depth);
  }
  return texels;
}

struct Map {
  pgl::DepthMap size = pgl::depth_map_of(view());
  std::vector<pgl::Depth> texels = depths_of(size);
  Map() { pgl::host::build_hzm(size, texels); }
};
const Map& map() {
  static const Map all;
  return all;
}

/// One thread for as long as it lives.
struct OneThread {
#if defined(_OPENMP)
  int threads = omp_get_max_threads();
  OneThread() {
    omp_set_num_threads(1);
  }
  ~OneThread() {
    omp_set_num_threads(threads);
  }
#endif
};

void build_hzm(benchmark::State& state) {
  const OneThread one;
  pgl::View v = view();
  v.width = static_cast<float>(state.range(0));
  v.height = static_cast<float>(state.range(1));
  const pgl::DepthMap size = pgl::depth_map_of(v);
  std::vector<pgl::Depth> texels = depths_of(size);
  for (auto _ : state) {
    pgl::host::build_hzm(size, texels);
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(size.width) * size.height);
}

/// Rectangles of up to `side` pixels all over the picture, at depths all over the scene's.
void rectangles(benchmark::State& state) {
  std::mt19937 random(2);
  struct Rectangle {
    pgl::ScreenBox box;
    pgl::Depth nearest;
  };
  std::vector<Rectangle> all(1 << 16);
  const float side = static_cast<float>(state.range(0));
  for (Rectangle& r : all) {
    r.box.x0 = uniform(random, 0, 1900);
    r.box.y0 = uniform(random, 0, 1060);
    r.box.x1 = std::min(1920.0f, r.box.x0 + uniform(random, 1, side));
    r.box.y1 = std::min(1080.0f, r.box.y0 + uniform(random, 1, side));
    r.nearest = pgl::depth_below(2000 / 1999.9 * (1 - 0.1 / static_cast<double>(uniform(random, 10, 1000))));
  }
  const pgl::Hzm hzm = pgl::hzm_of(map().size, map().texels.data());
  std::size_t hidden = 0;
  for (auto _ : state) {
    hidden = 0;
    for (const Rectangle& r : all) hidden += pgl::is_hidden(r.box, r.nearest, hzm);
    benchmark::DoNotOptimize(hidden);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(all.size()));
  state.counters["hidden"] = static_cast<double>(hidden) / static_cast<double>(all.size());
}

/// Small boxes all over a wide, flat site, and a camera inside it; those in the frustum are tested.
void boxes(benchmark::State& state) {
  const OneThread one;
  std::mt19937 random(1);
  std::vector<pgl::Box> all(count);
  for (pgl::Box& box : all) {
    const glm::vec3 centre(uniform(random, -500, 500), uniform(random, 0, 60), uniform(random, -500, 500));
    const glm::vec3 half(uniform(random, 0.01f, 2), uniform(random, 0.01f, 2), uniform(random, 0.01f, 2));
    box = {centre - half, centre + half};
  }
  std::vector<std::uint8_t> in_view(count), visible(count);
  pgl::host::cull_frustum(all, view(), in_view);
  const auto tested = std::count(in_view.begin(), in_view.end(), 1);
  for (auto _ : state) {
    pgl::host::cull_occluded(all, in_view, {}, view(), map().size, map().texels, 0, visible);
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * tested);
  state.counters["in_view"] = static_cast<double>(tested) / count;
  state.counters["hidden"] =
      1 - static_cast<double>(std::count(visible.begin(), visible.end(), 1)) / static_cast<double>(tested);
}

BENCHMARK(build_hzm)->Args({1920, 1080})->Args({4096, 4096})->Unit(benchmark::kMillisecond);
BENCHMARK(rectangles)->Arg(8)->Arg(64)->Arg(400);
BENCHMARK(boxes)->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
