// SPDX-License-Identifier: MIT
// What must hold of growth under a transfer cap whatever the input, against a version that is told step by step.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "pgl/host/limit_transfer.hpp"
#include "support/transfer_scenes.hpp"

namespace {

using pgl::TransferTotals;
using test::Before;
using test::transfer_caps;
using test::transfer_scene;
using test::TransferScene;
using Counts = std::vector<std::uint32_t>;
__extension__ typedef __int128 Wide;

struct Result {
  Counts counts;
  TransferTotals totals;
  friend bool operator==(const Result&, const Result&) = default;
};

TransferTotals limit_into(const TransferScene& s, std::span<const std::uint32_t> wanted,
                          std::span<const std::uint32_t> previous, std::span<std::uint32_t> counts) {
  static pgl::host::TransferWorkspace workspace;  // full of what other scenes left
  return pgl::host::limit_transfer(s.areas, s.depths, s.min_vertices, s.max_vertices, s.weight, wanted, previous,
                                   s.mesh_of_object, s.meshes, s.map, s.options, workspace, counts);
}

Result limit(const TransferScene& s) {
  Result result{Counts(s.size(), 4242), {}};
  result.totals = limit_into(s, s.wanted, s.previous, result.counts);
  return result;
}

/// The weights are data here; they have their own properties (distribute_budget_props).
std::vector<float> weights_of(const TransferScene& s) {
  std::vector<float> weights;
  for (std::size_t i = 0; i < s.size(); ++i)
    weights.push_back(pgl::log_weight(s.areas[i], s.depths[i], s.min_vertices[i], s.max_vertices[i], s.weight));
  return weights;
}

std::vector<std::size_t> heaviest_first(const TransferScene& s) {
  const std::vector<float> weights = weights_of(s);
  std::vector<std::size_t> order(s.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return weights[i] > weights[j]; });
  return order;
}

bool is_new(const TransferScene& s, std::size_t i) {
  return s.previous[i] == 0 && s.wanted[i] > 0;
}

std::uint32_t fewest(const TransferScene& s, std::size_t i) {
  return std::max(1u, s.min_vertices[i]);
}

/// Object by object and, where it does not fit as a whole, vertex by vertex; in 128-bit integers.
Result told(const TransferScene& s) {
  const std::vector<std::size_t> order = heaviest_first(s);
  Result result;
  for (std::size_t i = 0; i < s.size(); ++i) result.counts.push_back(std::min(s.wanted[i], s.previous[i]));
  Wide left = s.options.cap;
  for (const std::size_t i : order) {
    if (!is_new(s, i)) continue;
    const Wide step = s.bytes_at(s.mesh(i), fewest(s, i));
    if (step > left) break;
    left -= step;
    result.counts[i] = fewest(s, i);
  }
  for (const std::size_t i : order) {
    std::uint32_t& count = result.counts[i];
    if (count == 0 || count == s.wanted[i]) continue;
    const auto costs = [&](std::uint32_t to) -> Wide {
      return Wide{s.bytes_at(s.mesh(i), to)} - s.bytes_at(s.mesh(i), count);
    };
    if (const Wide whole = costs(s.wanted[i]); whole <= left) {
      left -= whole;
      count = s.wanted[i];
      continue;
    }
    while (costs(count + 1) <= left) {
      left -= costs(count + 1);
      ++count;
    }
    break;
  }
  result.totals.bytes = static_cast<std::uint64_t>(s.options.cap - left);
  result.totals.missing_bytes = s.bytes_between(result.counts, s.wanted);
  for (std::size_t i = 0; i < s.size(); ++i) result.totals.waiting += result.counts[i] < s.wanted[i];
  return result;
}

TransferScene any_scene(std::mt19937& random, std::size_t most = 60) {
  const Before all[] = {Before::any, Before::any, Before::nothing, Before::all, Before::nearly_same};
  return transfer_scene(random, random() % (most + 1), all[random() % std::size(all)]);
}

/// Calls body(scene, random) for ten scenes of at most so many objects.
template <class Body>
void for_scenes(std::size_t most, Body&& body) {
  std::mt19937 random(*rc::gen::arbitrary<std::uint32_t>());
  for (int k = 0; k < 10; ++k) body(any_scene(random, most), random);
}

/// Calls body(scene) for scenes with all kinds of caps.
template <class Body>
void for_capped_scenes(Body&& body) {
  for_scenes(60, [&](TransferScene scene, std::mt19937& random) {
    for (const std::uint64_t cap : transfer_caps(scene, random)) {
      scene.options.cap = cap;
      body(std::as_const(scene));
    }
  });
}

TEST(LimitTransfer, IsWhatTheRuleToldStepByStepGives) {
  int scenes = 0, waiting = 0, within_first_step = 0, partly_grown = 0, all_there = 0;
  EXPECT_TRUE(rc::check([&] {
    for_capped_scenes([&](const TransferScene& scene) {
      const Result expected = told(scene), result = limit(scene);
      RC_ASSERT(result.counts == expected.counts);
      RC_ASSERT(result.totals == expected.totals);
      ++scenes;
      bool waits = false, first = false, partly = false;
      for (std::size_t i = 0; i < scene.size(); ++i) {
        const std::uint32_t count = expected.counts[i];
        if (count >= scene.wanted[i]) continue;
        waits = waits || count == 0;
        first = first || (is_new(scene, i) && count == fewest(scene, i));
        partly = partly || (count > scene.previous[i] && count > fewest(scene, i));
      }
      waiting += waits;
      within_first_step += waits && first;
      partly_grown += partly;
      all_there += expected.counts == scene.wanted;
    });
  }));
  // Of a thousand scenes, so many have something to show.
  EXPECT_GT(waiting, scenes / 5);
  EXPECT_GT(within_first_step, scenes / 25);
  EXPECT_GT(partly_grown, scenes / 10);
  EXPECT_GT(all_there, scenes / 5);
}

TEST(LimitTransfer, IsTheSameForAnyNumberOfThreadsAndManyObjects) {
  std::mt19937 random(7);
  for (const std::size_t n : {4095u, 4096u, 8193u, 50000u, 300001u}) {
    TransferScene scene = transfer_scene(random, n);
    for (const std::uint64_t cap : transfer_caps(scene, random)) {
      scene.options.cap = cap;
      const Result expected = told(scene);
#if defined(_OPENMP)
      const int all = omp_get_max_threads();
      for (const int threads : {1, 2, 7}) {
        omp_set_num_threads(threads);
        EXPECT_EQ(limit(scene), expected) << n << " objects, cap " << cap << ", " << threads << " threads";
      }
      omp_set_num_threads(all);
#else
      EXPECT_EQ(limit(scene), expected);
#endif
    }
  }
}

RC_GTEST_PROP(LimitTransfer, StaysWithinTheCapAndGivesAValidSelection, ()) {
  for_capped_scenes([](const TransferScene& scene) {
    const std::uint64_t cap = scene.options.cap;
    const auto [counts, totals] = limit(scene);
    const std::uint64_t bytes = scene.bytes_between(scene.previous, counts);
    RC_ASSERT(bytes <= cap);
    RC_ASSERT(totals.bytes == bytes);
    RC_ASSERT(totals.missing_bytes == scene.bytes_between(scene.previous, scene.wanted) - bytes);
    for (std::size_t i = 0; i < scene.size(); ++i) {
      RC_ASSERT(counts[i] >= std::min(scene.previous[i], scene.wanted[i]));
      RC_ASSERT(counts[i] <= scene.wanted[i]);
      const std::uint32_t least =
          scene.previous[i] > 0 ? std::min(scene.previous[i], fewest(scene, i)) : fewest(scene, i);
      RC_ASSERT(counts[i] == 0 || counts[i] >= least);
    }
  });
}

/// Who is refused something, and who gets something, of what there is one after the other.
RC_GTEST_PROP(LimitTransfer, ServesTheHeavierBeforeTheLighter, ()) {
  for_capped_scenes([](const TransferScene& scene) {
    const Counts counts = limit(scene).counts;
    bool refused_new = false, refused_more = false;
    for (const std::size_t i : heaviest_first(scene)) {
      if (is_new(scene, i)) {
        RC_ASSERT(!(refused_new && counts[i] > 0));
        refused_new = refused_new || counts[i] == 0;
      }
      if (counts[i] == 0 || scene.wanted[i] <= scene.previous[i]) continue;
      const std::uint32_t least = is_new(scene, i) ? fewest(scene, i) : scene.previous[i];
      RC_ASSERT(!(refused_more && counts[i] > least));
      refused_more = refused_more || counts[i] < scene.wanted[i];
    }
  });
}

/// Nobody could have had one more step of what is left.
RC_GTEST_PROP(LimitTransfer, LeavesNoRoomForTheNextStep, ()) {
  for_capped_scenes([](const TransferScene& scene) {
    const std::uint64_t cap = scene.options.cap;
    const auto [counts, totals] = limit(scene);
    std::uint64_t first_steps = 0;
    for (std::size_t i = 0; i < scene.size(); ++i)
      if (is_new(scene, i) && counts[i] > 0) first_steps += scene.bytes_at(scene.mesh(i), fewest(scene, i));
    bool new_seen = false, more_seen = false;
    for (const std::size_t i : heaviest_first(scene)) {
      if (counts[i] >= scene.wanted[i]) continue;
      if (counts[i] == 0 && scene.previous[i] == 0) {
        if (!new_seen) RC_ASSERT(scene.bytes_at(scene.mesh(i), fewest(scene, i)) > cap - first_steps);
        new_seen = true;
      } else {
        const std::uint64_t step =
            scene.bytes_at(scene.mesh(i), counts[i] + 1) - scene.bytes_at(scene.mesh(i), counts[i]);
        if (!more_seen) RC_ASSERT(step > cap - totals.bytes);
        more_seen = true;
      }
    }
  });
}

RC_GTEST_PROP(LimitTransfer, GivesAllThatIsWantedWhereItFitsAndNothingForNothing, ()) {
  for_scenes(60, [](TransferScene scene, [[maybe_unused]] std::mt19937& random) {
    const std::uint64_t growth = scene.bytes_between(scene.previous, scene.wanted);
    for (const std::uint64_t cap : {growth, growth + 1, ~std::uint64_t{0}}) {
      scene.options.cap = cap;
      RC_ASSERT(limit(scene) == (Result{scene.wanted, {growth, 0, 0}}));
    }
    scene.options.cap = 0;
    if (scene.options.vertex_bytes == 0) return;  // vertices that cost nothing may come
    const Counts counts = limit(scene).counts;
    for (std::size_t i = 0; i < scene.size(); ++i) RC_ASSERT(counts[i] == std::min(scene.wanted[i], scene.previous[i]));
  });
}

RC_GTEST_PROP(LimitTransfer, MayWriteOverWhatItReads, ()) {
  for_scenes(300, [](TransferScene scene, [[maybe_unused]] std::mt19937& random) {
    for (const std::uint64_t cap : transfer_caps(scene, random)) {
      scene.options.cap = cap;
      const Result expected = limit(scene);
      Counts counts = scene.wanted;
      RC_ASSERT(limit_into(scene, counts, scene.previous, counts) == expected.totals);
      RC_ASSERT(counts == expected.counts);
      counts = scene.previous;
      RC_ASSERT(limit_into(scene, scene.wanted, counts, counts) == expected.totals);
      RC_ASSERT(counts == expected.counts);
    }
  });
}

/// The largest step by the definition: every count that an object may have and the next one.
std::uint64_t largest_step_of(const TransferScene& s) {
  std::uint64_t most = 0;
  for (const pgl::Mesh& mesh : s.meshes) {
    std::uint32_t first = mesh.min_vertices;
    while (first < mesh.max_vertices && s.map[mesh.first_map + first - mesh.min_vertices] < s.min_triangles) ++first;
    first = std::max(first, 1u);
    if (mesh.max_vertices == 0) continue;
    most = std::max(most, s.bytes_at(mesh, first));
    for (std::uint32_t k = first; k < mesh.max_vertices; ++k)
      most = std::max(most, s.bytes_at(mesh, k + 1) - s.bytes_at(mesh, k));
  }
  return most;
}

RC_GTEST_PROP(LeastCap, IsTheLargestStepOfAnyMesh, ()) {
  for_scenes(0, [](TransferScene scene, [[maybe_unused]] std::mt19937& random) {
    RC_ASSERT(pgl::host::least_cap(scene.meshes, scene.map, scene.min_triangles, scene.options) ==
              largest_step_of(scene));
  });
}

/// Repeats until nothing changes; returns the frames that it took until the wanted counts were there, 0 for never.
std::uint64_t frames_until_there(TransferScene scene, std::uint64_t step) {
  for (std::uint64_t frame = 1;; ++frame) {
    const auto [counts, totals] = limit(scene);
    if (counts == scene.wanted) return frame;
    if (counts == scene.previous) return 0;
    if (step <= scene.options.cap) RC_ASSERT(totals.bytes > scene.options.cap - step);
    scene.previous = counts;
  }
}

RC_GTEST_PROP(LimitTransfer, ArrivesInAsManyFramesAsSaidWhereTheCameraStandsStill, ()) {
  for_scenes(30, [](TransferScene scene, [[maybe_unused]] std::mt19937& random) {
    for (std::size_t i = 0; i < scene.size(); ++i)  // as the same camera's frames draw it
      if (scene.previous[i] < scene.min_vertices[i]) scene.previous[i] = 0;
    const std::uint64_t step = pgl::host::least_cap(scene.meshes, scene.map, scene.min_triangles, scene.options);
    const std::uint64_t growth = scene.bytes_between(scene.previous, scene.wanted);
    for (const std::uint64_t cap : {step, step + 1, 2 * step, 3 * step + growth / 7, step + growth}) {
      if (growth / (cap - step + 1) > 3000) continue;
      scene.options.cap = cap;
      const std::uint64_t frames = frames_until_there(scene, step);
      RC_ASSERT(frames >= 1u);
      RC_ASSERT(frames <= growth / (cap - step + 1) + 1);
      RC_ASSERT(frames * static_cast<Wide>(cap) >= growth);
    }
  });
}

/// An object of the mesh with the largest step arrives with the least cap, and with one byte less never.
RC_GTEST_PROP(LeastCap, IsTheLeastWithWhichAnyObjectArrives, ()) {
  for_scenes(0, [](TransferScene scene, [[maybe_unused]] std::mt19937& random) {
    const std::uint64_t step = pgl::host::least_cap(scene.meshes, scene.map, scene.min_triangles, scene.options);
    if (step == 0) return;
    bool stopped = false;
    for (std::uint32_t m = 0; m < scene.meshes.size(); ++m) {
      TransferScene one = scene;
      one.mesh_of_object = {m};
      one.areas = one.depths = {1.0f};
      one.max_vertices = one.wanted = {one.meshes[m].max_vertices};
      one.min_vertices = {pgl::minimum_vertices(one.meshes[m], one.map.data(), one.min_triangles)};
      one.previous = {0};
      one.options.cap = step;
      RC_ASSERT(frames_until_there(one, step) > 0u);
      one.options.cap = step - 1;
      stopped = stopped || frames_until_there(one, step) == 0;
    }
    RC_ASSERT(stopped);
  });
}

}  // namespace
