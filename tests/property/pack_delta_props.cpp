// SPDX-License-Identifier: MIT
#include "pgl/host/pack_delta.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "pgl/host/gather.hpp"
#include "support/selection_walk.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

void use_threads([[maybe_unused]] int n) {
#if defined(_OPENMP)
  omp_set_num_threads(n);
#endif
}

template <class T>
void packs_each_missing_element_once(std::uint32_t seed, std::uint32_t size) {
  std::mt19937 random(seed);
  test::SelectionWalk<T> walk(random, static_cast<test::ModelShape>(random() % test::model_shapes), size);
  const auto elements_before = walk.elements;
  for (int k = 0; k < 20; ++k) {
    const auto before = walk.counts;
    const auto previous = walk.offsets();
    const auto step = static_cast<test::Step>(random() % test::steps);
    walk.go(random, step);
    const auto offsets = walk.offsets();
    const auto expected = walk.missing(before);
    for (const int threads : {1, 2, 5}) {
      use_threads(threads);
      std::vector<std::uint64_t> delta_offsets(offsets.size(), 0xA5A5A5A5A5A5A5A5u);
      const std::uint64_t total = pgl::host::lay_out_delta(previous, offsets, delta_offsets);
      RC_ASSERT(total == expected.size());
      RC_ASSERT(delta_offsets.back() == total);
      for (std::size_t i = 0; i < walk.objects.size(); ++i) {
        const std::uint32_t grew = walk.counts[i] > before[i] ? walk.counts[i] - before[i] : 0;
        RC_ASSERT(delta_offsets[i + 1] - delta_offsets[i] == grew);
      }
      T guard;
      for (auto& byte : guard.byte) byte = 0xA5;
      for (const auto first : {&pgl::Mesh::first_vertex, &pgl::Mesh::first_triangle}) {
        std::vector<T> out(total + 3, guard);
        pgl::host::pack_delta<T>(walk.meshes, walk.objects, first, walk.elements, previous, offsets, delta_offsets,
                                 out);
        for (int g = 0; g < 3; ++g, out.pop_back()) RC_ASSERT(out.back() == guard);
        RC_ASSERT(out == expected);
      }
    }
  }
  RC_ASSERT(walk.elements == elements_before);
}

RC_GTEST_PROP(PackDeltaProps, packsEachMissingElementOnceInOrder, (std::uint32_t seed)) {
  packs_each_missing_element_once<test::Payload<1>>(seed, 30);
  packs_each_missing_element_once<test::Payload<6>>(seed, 30);
  packs_each_missing_element_once<test::Payload<12>>(seed, 200);
  packs_each_missing_element_once<test::Payload<100>>(seed, 20);
}

// Pieces of the block are smaller than what one object adds, and many objects share one.
RC_GTEST_PROP(PackDeltaProps, packsBlocksOfManyPieces, (std::uint32_t seed)) {
  if (seed % 5 == 0) packs_each_missing_element_once<test::Payload<999>>(seed, 40);
  if (seed % 25 == 1) packs_each_missing_element_once<test::Payload<70000>>(seed, 2);
}

RC_GTEST_PROP(PackDeltaProps, placesAsGatherDoes, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  test::SelectionWalk<test::Payload<12>> walk(random, test::ModelShape::even, 40);
  std::vector<glm::vec3> vertices;
  for (std::size_t v = 0; v < walk.elements.size(); ++v) {
    vertices.emplace_back(static_cast<float>(random() % 1000), static_cast<float>(v), -1.0f);
  }
  for (auto& object : walk.objects) {
    object.transform[3] = glm::vec3(static_cast<float>(random() % 100));
    object.transform[0].y = static_cast<float>(random() % 3);
  }
  walk.go(random, test::Step::teleport);
  const auto before = walk.counts;
  const auto previous = walk.offsets();
  walk.go(random, test::Step::some_leave);
  walk.go(random, test::Step::walk);
  const auto offsets = walk.offsets();
  std::vector<pgl::PlacedVertex> all(offsets.back()), expected;
  pgl::host::gather<pgl::PlacedVertex, glm::vec3>(walk.meshes, walk.objects, vertices, walk.counts, offsets, all);
  for (std::size_t i = 0; i < walk.objects.size(); ++i) {
    for (std::uint64_t k = before[i]; k < walk.counts[i]; ++k) expected.push_back(all[offsets[i] + k]);
  }
  for (const int threads : {1, 3}) {
    use_threads(threads);
    std::vector<std::uint64_t> delta_offsets(offsets.size());
    std::vector<pgl::PlacedVertex> out(pgl::host::lay_out_delta(previous, offsets, delta_offsets));
    pgl::host::pack_placed_delta<pgl::PlacedVertex, glm::vec3>(walk.meshes, walk.objects, vertices, previous, offsets,
                                                               delta_offsets, out);
    RC_ASSERT(out == expected);
  }
}

// Enough objects for the sums to be taken by several blocks.
RC_GTEST_PROP(PackDeltaProps, laysOutManyObjectsAsOneThreadDoes, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  const std::size_t n = random() % 40000;
  std::vector<std::uint64_t> previous{0}, offsets{0}, expected{0};
  for (std::size_t i = 0; i < n; ++i) {
    // Also counts far above 32 bits.
    const std::uint64_t a = random() % 5 == 0 ? std::uint64_t{random()} << 12 : random() % 9;
    const std::uint64_t b = random() % 3 == 0 ? a : random() % 5 == 0 ? std::uint64_t{random()} << 12 : random() % 9;
    previous.push_back(previous.back() + a);
    offsets.push_back(offsets.back() + b);
    expected.push_back(expected.back() + (b > a ? b - a : 0));
  }
  for (const int threads : {1, 2, 4}) {
    use_threads(threads);
    std::vector<std::uint64_t> delta_offsets(n + 1, 7);
    RC_ASSERT(pgl::host::lay_out_delta(previous, offsets, delta_offsets) == expected.back());
    RC_ASSERT(delta_offsets == expected);
  }
}

}  // namespace
