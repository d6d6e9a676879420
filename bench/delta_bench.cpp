// SPDX-License-Identifier: MIT
// What a frame costs when only what changed is collected and moved: pack_delta and defragment, out of place and in
// place, beside a fresh copy of the selection and memcpy of as many bytes.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <random>
#include <span>
#include <vector>

#include "pgl/host/defragment.hpp"
#include "pgl/host/pack_delta.hpp"
#include "pgl/host/parallel.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

using Element = glm::vec3;
using Offsets = std::vector<std::uint64_t>;

/// Two selections of the same objects, about `shown` elements of each: the count of every object differs, or that of
/// one in four by up to a third, so that about 2 % is new.
struct Frames {
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<Element> elements;
  Offsets offsets[2];
  Offsets deltas[2];  // to frame 0, to frame 1

  Frames(std::uint32_t object_count, std::uint32_t shown, bool all_change) {
    std::mt19937 random(1);
    const std::uint32_t mesh_count = std::max(1u, object_count / 18);
    for (std::uint32_t m = 0; m < mesh_count; ++m) {
      meshes.push_back({.first_vertex = std::uint64_t{m} * shown * 2, .max_vertices = shown * 2});
    }
    elements.assign(std::uint64_t{mesh_count} * shown * 2, Element(1.0f));
    offsets[0] = offsets[1] = {0};
    for (std::uint32_t i = 0; i < object_count; ++i) {
      objects.push_back({.mesh = static_cast<std::uint32_t>(random() % mesh_count)});
      const std::uint32_t count = shown / 2 + random() % shown;
      std::uint32_t now = count;
      if (all_change) {
        now = shown / 2 + random() % shown;
      } else if (random() % 4 == 0) {  // by up to a third
        now = count - count / 3 + random() % (2 * (count / 3) + 1);
      }
      offsets[0].push_back(offsets[0].back() + count);
      offsets[1].push_back(offsets[1].back() + now);
    }
    for (int k = 0; k < 2; ++k) {
      deltas[k].resize(object_count + 1);
      pgl::host::lay_out_delta(offsets[1 - k], offsets[k], deltas[k]);
    }
  }

  std::uint64_t room() const { return std::max(offsets[0].back(), offsets[1].back()); }
};

/// Best of some runs, each of both frames, in seconds for one.
template <class Body>
double best_seconds(Body body) {
  double best = 1e30;
  for (int run = 0; run < 7; ++run) {
    const auto start = std::chrono::steady_clock::now();
    body(1);
    body(0);
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() / 2);
  }
  return best;
}

// Arguments: objects, elements shown of each (on average), whether every object changes, all cores.
void frame(benchmark::State& state) {
  static const std::size_t all_threads = pgl::host::thread_count();
  const std::size_t used = state.range(3) != 0 ? all_threads : 1;
#if defined(_OPENMP)
  omp_set_num_threads(static_cast<int>(used));
#endif
  const Frames f(static_cast<std::uint32_t>(state.range(0)), static_cast<std::uint32_t>(state.range(1)),
                 state.range(2) != 0);
  std::vector<Element> additional[2], blocks[2], block(f.room());
  for (int k = 0; k < 2; ++k) {
    additional[k].resize(f.deltas[k].back());
    blocks[k].resize(f.room());
  }
  Offsets delta_offsets(f.objects.size() + 1);
  pgl::host::DefragmentWorkspace workspace;

  const auto pack = [&](int k) {
    pgl::host::lay_out_delta(f.offsets[1 - k], f.offsets[k], delta_offsets);
    pgl::host::pack_delta<Element>(f.meshes, f.objects, &pgl::Mesh::first_vertex, f.elements, f.offsets[1 - k],
                                   f.offsets[k], delta_offsets, additional[k]);
  };
  const auto out_of_place = [&](int k) {
    pgl::host::defragment<Element>(f.offsets[1 - k], f.offsets[k], f.deltas[k], blocks[1 - k], additional[k],
                                   blocks[k]);
  };
  const auto in_place = [&](int k) {
    pgl::host::defragment_in_place<Element>(f.offsets[1 - k], f.offsets[k], f.deltas[k], additional[k], workspace,
                                            block);
  };
  const auto fresh = [&](int k) {
    const Offsets nothing(f.objects.size() + 1, 0);
    pgl::host::pack_delta<Element>(f.meshes, f.objects, &pgl::Mesh::first_vertex, f.elements, nothing, f.offsets[k],
                                   f.offsets[k], blocks[k]);
  };
  const auto copy = [&](int k) {
    const std::size_t size = f.offsets[k].back(), pieces = 64;
    pgl::host::parallel_for(pieces, 1, [&](std::size_t p) {
      const std::size_t begin = size * p / pieces, end = size * (p + 1) / pieces;
      std::memcpy(blocks[k].data() + begin, blocks[1 - k].data() + begin, (end - begin) * sizeof(Element));
    });
    benchmark::DoNotOptimize(blocks[k].data());
  };

  const double fresh_s = best_seconds(fresh);
  const double pack_s = best_seconds(pack);
  const double copy_s = best_seconds(copy);
  fresh(0);
  const double defragment_s = best_seconds(out_of_place);
  std::copy(blocks[0].begin(), blocks[0].end(), block.begin());
  const double in_place_s = best_seconds(in_place);
  if (!std::equal(block.begin(), block.begin() + static_cast<std::ptrdiff_t>(f.offsets[0].back()), blocks[0].begin())) {
    state.SkipWithError("the two differ");
  }
  for (auto _ : state) {  // forth and back
    for (const int k : {1, 0}) {
      pack(k);
      in_place(k);
    }
    benchmark::ClobberMemory();
  }
  const double moved = static_cast<double>((f.offsets[0].back() + f.offsets[1].back()) * sizeof(Element));
  state.counters["threads"] = static_cast<double>(used);
  state.counters["new_share"] = static_cast<double>(f.deltas[1].back()) / static_cast<double>(f.offsets[1].back());
  state.counters["fresh_ms"] = fresh_s * 1e3;
  state.counters["pack_ms"] = pack_s * 1e3;
  state.counters["defragment_ms"] = defragment_s * 1e3;
  state.counters["in_place_ms"] = in_place_s * 1e3;
  state.counters["memcpy_ms"] = copy_s * 1e3;
  state.counters["memcpy_GB/s"] = moved / copy_s * 1e-9;
  state.counters["defragment_of_memcpy"] = copy_s / defragment_s;
  state.counters["in_place_of_memcpy"] = copy_s / in_place_s;
  state.counters["scratch_share"] =
      2.0 * static_cast<double>(workspace.staging.size() + workspace.reads.size()) / moved;
}
BENCHMARK(frame)->Unit(benchmark::kMillisecond)->UseRealTime()->Apply([](benchmark::internal::Benchmark* b) {
  b->ArgNames({"objects", "shown", "all_change", "all_cores"});
  for (const int all : {0, 1}) {
    for (const int all_change : {0, 1}) {
      b->Args({36000, 290, all_change, all});
      b->Args({718000, 14, all_change, all});
      b->Args({10, 1000000, all_change, all});
    }
  }
});

}  // namespace

BENCHMARK_MAIN();
