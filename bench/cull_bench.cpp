// SPDX-License-Identifier: MIT
// Frustum culling and projection of 718 thousand boxes, against plain float versions without error bounds.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <random>
#include <vector>

#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/project.hpp"

namespace {

constexpr std::size_t count = 718687;

/// Small boxes all over a wide, flat site, and a camera inside it.
const std::vector<pgl::Box>& boxes() {
  static const std::vector<pgl::Box> all = [] {
    std::mt19937 random(1);
    const auto uniform = [&](float low, float high) {
      return low + (high - low) * (static_cast<float>(random() >> 8) * 0x1p-24f);
    };
    std::vector<pgl::Box> b(count);
    for (pgl::Box& box : b) {
      const glm::vec3 centre(uniform(-500, 500), uniform(0, 60), uniform(-500, 500));
      const glm::vec3 half(uniform(0.01f, 2), uniform(0.01f, 2), uniform(0.01f, 2));
      box = {centre - half, centre + half};
    }
    return b;
  }();
  return all;
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

/// The textbook test: six float planes, the corner farthest along each normal.
void plain_cull(const std::vector<pgl::Box>& all, const pgl::View& v, std::vector<std::uint8_t>& in_view) {
  const glm::mat4 m = glm::transpose(v.clip_from_world);
  const glm::vec4 plane[6] = {m[3] + m[0], m[3] - m[0], m[3] + m[1], m[3] - m[1], m[3] + m[2], m[3] - m[2]};
  pgl::host::parallel_for(all.size(), 4096, [&](std::size_t i) {
    const pgl::Box& b = all[i];
    bool in = true;
    for (const glm::vec4& p : plane) {
      const float most = p.x * (p.x < 0 ? b.min.x : b.max.x) + p.y * (p.y < 0 ? b.min.y : b.max.y) +
                         p.z * (p.z < 0 ? b.min.z : b.max.z) + p.w;
      if (most < 0) {
        in = false;
        break;
      }
    }
    in_view[i] = in;
  });
}

/// Eight corners through the matrix in float, divided and clamped.
void plain_project(const std::vector<pgl::Box>& all, const std::vector<std::uint8_t>& in_view, const pgl::View& v,
                   std::vector<float>& areas, std::vector<float>& depths) {
  const glm::mat4 m = v.clip_from_world;
  pgl::host::parallel_for(all.size(), 1024, [&](std::size_t i) {
    areas[i] = 0;
    depths[i] = v.near_depth;
    if (!in_view[i]) return;
    const pgl::Box& b = all[i];
    float x0 = 1, y0 = 1, x1 = -1, y1 = -1, depth = 1e30f;
    for (int c = 0; c < 8; ++c) {
      const glm::vec4 p =
          m * glm::vec4(c & 1 ? b.max.x : b.min.x, c & 2 ? b.max.y : b.min.y, c & 4 ? b.max.z : b.min.z, 1.0f);
      x0 = std::min(x0, p.x / p.w);
      x1 = std::max(x1, p.x / p.w);
      y0 = std::min(y0, p.y / p.w);
      y1 = std::max(y1, p.y / p.w);
      depth = std::min(depth, p.w);
    }
    if (depth < v.near_depth) {
      areas[i] = v.width * v.height;
      return;
    }
    areas[i] = (std::min(x1, 1.0f) - std::max(x0, -1.0f)) * (std::min(y1, 1.0f) - std::max(y0, -1.0f)) * 0.25f *
               v.width * v.height;
    depths[i] = depth;
  });
}

/// Times ours by the benchmark and the peer beside it, alternating, and reports how many times as long ours takes.
template <class Ours, class Plain>
void compare(benchmark::State& state, const Ours& ours, const Plain& plain) {
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  if (state.range(0) == 1) omp_set_num_threads(1);
#endif
  using Clock = std::chrono::steady_clock;
  std::chrono::duration<double> ours_time{}, plain_time{};
  for (auto _ : state) {
    const auto t0 = Clock::now();
    plain();
    const auto t1 = Clock::now();
    ours();
    const auto t2 = Clock::now();
    benchmark::ClobberMemory();
    plain_time += t1 - t0;
    ours_time += t2 - t1;
    state.SetIterationTime(std::chrono::duration<double>(t2 - t1).count());
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(count));
  state.counters["threads"] = static_cast<double>(pgl::host::thread_count());
  state.counters["times_plain_float"] = ours_time / plain_time;
#if defined(_OPENMP)
  omp_set_num_threads(threads);
#endif
}

void cull(benchmark::State& state) {
  std::vector<std::uint8_t> in_view(count), plain_in_view(count);
  compare(
      state, [&] { pgl::host::cull_frustum(boxes(), view(), in_view); },
      [&] { plain_cull(boxes(), view(), plain_in_view); });
  state.counters["in_view"] = static_cast<double>(std::count(in_view.begin(), in_view.end(), 1)) / count;
}

void project(benchmark::State& state) {
  std::vector<std::uint8_t> in_view(count);
  std::vector<float> areas(count), depths(count), plain_areas(count), plain_depths(count);
  pgl::host::cull_frustum(boxes(), view(), in_view);
  compare(
      state, [&] { pgl::host::project(boxes(), in_view, view(), areas, depths); },
      [&] { plain_project(boxes(), in_view, view(), plain_areas, plain_depths); });
}

void cull_and_project(benchmark::State& state) {
  std::vector<std::uint8_t> in_view(count), plain_in_view(count);
  std::vector<float> areas(count), depths(count), plain_areas(count), plain_depths(count);
  compare(
      state,
      [&] {
        pgl::host::cull_frustum(boxes(), view(), in_view);
        pgl::host::project(boxes(), in_view, view(), areas, depths);
      },
      [&] {
        plain_cull(boxes(), view(), plain_in_view);
        plain_project(boxes(), plain_in_view, view(), plain_areas, plain_depths);
      });
}

// The argument is the number of threads; 0 is all of them.
BENCHMARK(cull)->Arg(1)->Arg(0)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(project)->Arg(1)->Arg(0)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(cull_and_project)->Arg(1)->Arg(0)->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
