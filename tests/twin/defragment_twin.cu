// SPDX-License-Identifier: MIT
// lay_out_delta and defragment, also in place: the GPU's bytes against the CPU's, for any two selections.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "pgl/cuda/defragment.cuh"
#include "pgl/cuda/pack_delta.cuh"
#include "pgl/host/defragment.hpp"
#include "pgl/host/pack_delta.hpp"
#include "support/selection_walk.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using ::testing::AssertionFailure;
using ::testing::AssertionResult;
using ::testing::AssertionSuccess;
using Offsets = std::vector<std::uint64_t>;

/// A payload as a library user may have it: of any size, aligned to 1, 2, 4, 8 or 16.
template <std::size_t bytes, std::size_t alignment>
struct alignas(alignment) Element {
  unsigned char byte[bytes];
};

/// Calls body with an element of every size and alignment that is copied in a way of its own.
template <class Body>
void for_all_elements(Body&& body) {
  body(Element<12, 4>{});  // a vertex, a triangle of large meshes
  body(Element<6, 2>{});   // a triangle of small meshes
  body(Element<1, 1>{});
  body(Element<2, 2>{});
  body(Element<6, 1>{});
  body(Element<16, 16>{});
  body(Element<20, 4>{});
  body(Element<33, 1>{});
  body(Element<64, 8>{});
  body(Element<300, 2>{});
}

template <class T>
std::vector<T> random_elements(std::mt19937& random, std::size_t size) {
  std::vector<T> elements(size);
  std::uint64_t state = random();
  std::size_t at = 0;
  for (T& element : elements) {
    for (auto& byte : element.byte) {
      if (at++ % 4 == 0) state = state * 6364136223846793005u + 1442695040888963407u;
      byte = static_cast<unsigned char>(state >> (32 + at % 4 * 8));
    }
  }
  return elements;
}

Offsets delta_of(const Offsets& previous, const Offsets& offsets) {
  Offsets delta_offsets(offsets.size());
  pgl::host::lay_out_delta(previous, offsets, delta_offsets);
  return delta_offsets;
}

Offsets offsets_of(const std::vector<std::uint32_t>& counts) {
  Offsets sums{0};
  for (const std::uint32_t count : counts) sums.push_back(sums.back() + count);
  return sums;
}

constexpr std::size_t beyond = 70;  // elements past the total, which must stay as they are

/// From one selection to the next, by every way there is: all bytes must agree, also those past the end.
template <class T>
AssertionResult agree(std::mt19937& random, const Offsets& previous, const Offsets& offsets, unsigned threads,
                      std::size_t shift) {
  const Offsets delta_offsets = delta_of(previous, offsets);
  const auto additional = random_elements<T>(random, delta_offsets.back());
  const auto before = random_elements<T>(random, std::max(previous.back(), offsets.back()) + beyond);

  auto out = before, block = before;
  pgl::host::defragment<T>(previous, offsets, delta_offsets, before, additional, out);
  pgl::host::DefragmentWorkspace on_host;
  pgl::host::defragment_in_place<T>(previous, offsets, delta_offsets, additional, on_host, block);

  const DeviceArray<std::uint64_t> previous_there(previous, shift), offsets_there(offsets, shift);
  const DeviceArray<std::uint64_t> delta_there(delta_offsets.size(), shift);
  const DeviceArray<T> additional_there(additional, shift), existing_there(before, shift);
  const DeviceArray<T> out_there(before, shift), block_there(before, shift);
  const auto title = [&] {
    return AssertionFailure() << sizeof(T) << " bytes, blocks of " << threads << ", " << shift << " off: ";
  };

  pgl::cuda::ScanWorkspace scan;
  const pgl::cuda::Launch launch(nullptr, threads);
  must(pgl::cuda::lay_out_delta(previous_there.input(), offsets_there.input(), delta_there.view(), scan, launch));
  if (const auto same = same_bytes(delta_there.read(), delta_offsets); !same) return title() << same.message();

  must(pgl::cuda::defragment<T>(previous_there.input(), offsets_there.input(), delta_there.input(),
                                existing_there.input(), additional_there.input(), out_there.view(), launch));
  if (const auto same = same_bytes(out_there.read(), out); !same) return title() << same.message();

  pgl::cuda::DefragmentWorkspace workspace;
  must(pgl::cuda::defragment_in_place<T>(previous_there.input(), offsets_there.input(), delta_there.input(),
                                         additional_there.input(), workspace, block_there.view(), launch));
  if (const auto same = same_bytes(block_there.read(), block); !same) return title() << "in place: " << same.message();
  if (!block.empty() && workspace.memory.size() > block.size() * sizeof(T) / 20 + 1024) {
    return title() << workspace.memory.size() << " bytes of scratch";
  }
  return AssertionSuccess();
}

/// The same there and back, for all block sizes.
template <class T>
AssertionResult agree_both_ways(std::mt19937& random, const Offsets& a, const Offsets& b) {
  std::size_t shift = 0;
  for (const unsigned threads : block_sizes) {
    if (auto result = agree<T>(random, a, b, threads, shift++ % 4); !result) return result;
    if (auto result = agree<T>(random, b, a, threads, shift++ % 4); !result) return result << " (back)";
  }
  return AssertionSuccess();
}

/// A few steps of a walk, each with a block size and an alignment of its own.
template <class T>
AssertionResult agree_along_a_walk(std::mt19937& random, std::uint32_t size) {
  const auto shape = static_cast<test::ModelShape>(random() % test::model_shapes);
  test::SelectionWalk<test::Payload<1>> walk(random, shape, size);
  for (int k = 0; k < 4; ++k) {
    const Offsets previous = walk.offsets();
    const auto step = static_cast<test::Step>(random() % test::steps);
    walk.go(random, k == 0 && random() % 2 == 0 ? test::Step::everything : step);
    const unsigned threads = block_sizes[random() % block_sizes.size()];
    const AssertionResult result = agree<T>(random, previous, walk.offsets(), threads, random() % 4);
    if (!result) return result;
  }
  return AssertionSuccess();
}

TEST(DefragmentTwin, SameBytesForRandomWalks) {
  PGL_NEEDS_DEVICE();
  EXPECT_TRUE(rc::check([](std::uint32_t seed, bool large) {
    std::mt19937 random(seed);
    const std::uint32_t chosen = static_cast<std::uint32_t>(random()) % 10;
    std::uint32_t index = 0;
    for_all_elements([&]<class T>(T) {
      if (index++ != chosen) return;
      const std::uint32_t size = 1 + static_cast<std::uint32_t>(random()) % (large ? 400 : 30);
      const AssertionResult result = agree_along_a_walk<T>(random, size);
      if (!result) RC_FAIL(std::string(result.message()));
    });
    RC_ASSERT(index == 10u);
  }));
}

TEST(DefragmentTwin, SameBytesAroundTheEdgesOfWarpsAndTiles) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(1);
  std::size_t run = 0;
  for (const std::uint32_t size :
       {1u, 31u, 32u, 33u, 159u, 160u, 161u, 319u, 320u, 321u, 511u, 512u, 513u, 1279u, 1280u, 1281u, 2561u, 5121u}) {
    const Offsets a = offsets_of({3, size, 0, 1, size, 0, 2});
    for (const Offsets& b : {offsets_of({4, size, 0, 2, size, 0, 2}), offsets_of({2, size - 1, 7, 1, size + 1, 0, 0}),
                             offsets_of({size, 0, 0, 1, size / 2, size, 2})}) {
      for_all_elements([&]<class T>(T) {
        if (size * sizeof(T) > 40000) return;
        const unsigned threads = block_sizes[run % block_sizes.size()];
        EXPECT_TRUE((run % 8 < 4 ? agree<T>(random, a, b, threads, run % 3) : agree<T>(random, b, a, threads, run % 3)))
            << size;
        ++run;
      });
      EXPECT_TRUE((agree_both_ways<Element<12, 4>>(random, a, b))) << size;
    }
  }
}

/// More than a large block of threads has shared memory for, if each of its warps is to have one.
TEST(DefragmentTwin, SameBytesForElementsOfTwoKilobytes) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(12);
  const Offsets a = offsets_of({3, 60, 0, 1, 40, 0, 2});
  EXPECT_TRUE((agree_both_ways<Element<2048, 16>>(random, a, offsets_of({5, 55, 1, 1, 50, 0, 0}))));
  EXPECT_TRUE((agree_both_ways<Element<2047, 1>>(random, a, offsets_of({0, 70, 0, 0, 41, 3, 9}))));
}

/// By one element and by about a tile: then all of a tile's tickets wait for others.
TEST(DefragmentTwin, SameBytesWhereAllShift) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(2);
  for (const std::uint32_t shift : {1u, 3u, 159u, 160u, 161u, 1280u, 1281u, 5120u, 100000u}) {
    std::vector<std::uint32_t> counts(20001, 13);
    counts[0] = 0;
    const Offsets a = offsets_of(counts);
    counts[0] = shift;
    const Offsets b = offsets_of(counts);
    EXPECT_TRUE((agree_both_ways<Element<12, 4>>(random, a, b))) << shift;
    EXPECT_TRUE((agree_both_ways<Element<6, 2>>(random, a, b))) << shift;
  }
}

TEST(DefragmentTwin, SameBytesWhereOneGiantObjectShifts) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(3);
  const std::uint32_t giant = (1u << 20) + 5;
  for (const std::uint32_t shift : {1u, 1000u, giant}) {
    const Offsets a = offsets_of({1, 0, giant, 2}), b = offsets_of({1 + shift, 0, giant, 0});
    EXPECT_TRUE((agree_both_ways<Element<12, 4>>(random, a, b))) << shift;
    EXPECT_TRUE((agree_both_ways<Element<6, 2>>(random, a, b))) << shift;
  }
  // Two that meet: the first shrinks, the last grows, and one between them goes left or right.
  EXPECT_TRUE((agree_both_ways<Element<12, 4>>(random, offsets_of({giant / 2, 0, giant}),
                                               offsets_of({giant / 4, 7, giant + 1000}))));
}

TEST(DefragmentTwin, SameBytesWhereNeighboursGoBothWays) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(4);
  std::vector<std::uint32_t> counts(20000), next(20000);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    counts[i] = static_cast<std::uint32_t>(random() % 30);
    next[i] = i % 2 == 0 ? counts[i] : static_cast<std::uint32_t>(random() % 30);
  }
  EXPECT_TRUE((agree_both_ways<Element<12, 4>>(random, offsets_of(counts), offsets_of(next))));
  EXPECT_TRUE((agree_both_ways<Element<1, 1>>(random, offsets_of(counts), offsets_of(next))));
}

/// Single elements among many empty objects take long to find, and so to read. Elements of one object beside them,
/// moved the same way, must not be written over them before.
TEST(DefragmentTwin, SameBytesBesideATileThatIsSlowToRead) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(11);
  for (const std::uint32_t shift : {1u, 100u, 2000u}) {
    std::vector<std::uint32_t> counts{0, 7000};
    for (int i = 0; i < 640; ++i) {
      counts.insert(counts.end(), 100, 0);
      counts.push_back(1);
    }
    counts.push_back(7000);
    const Offsets a = offsets_of(counts);
    counts[0] = shift;
    EXPECT_TRUE((agree_both_ways<Element<12, 4>>(random, a, offsets_of(counts)))) << shift;
    EXPECT_TRUE((agree_both_ways<Element<6, 2>>(random, a, offsets_of(counts)))) << shift;
  }
}

TEST(DefragmentTwin, SameBytesForManyObjectsWithoutElements) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(5);
  std::vector<std::uint32_t> counts(100000, 0);
  for (const std::size_t i : {50000, 50001, 99990}) counts[i] = 700;
  auto next = counts;
  next[3] = 40;
  next[50001] = 300;
  EXPECT_TRUE((agree_both_ways<Element<12, 4>>(random, offsets_of(counts), offsets_of(next))));
  EXPECT_TRUE((agree_both_ways<Element<33, 1>>(random, offsets_of(counts), offsets_of(next))));
}

TEST(DefragmentTwin, WritesNothingForNothing) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(6);
  for_all_elements([&]<class T>(T) {
    EXPECT_TRUE(agree_both_ways<T>(random, {0}, {0}));
    EXPECT_TRUE(agree_both_ways<T>(random, Offsets(100, 0), Offsets(100, 0)));
    const Offsets some = offsets_of({40, 0, 50, 300});
    EXPECT_TRUE(agree_both_ways<T>(random, Offsets(5, 0), some));  // from nothing, and back to it
    EXPECT_TRUE(agree_both_ways<T>(random, some, some));
  });
}

/// What a device keeps from selection to selection, moved and copied by turns, is the selection.
TEST(DefragmentTwin, KeepsUpWithAFreshCopyOfTheSelection) {
  PGL_NEEDS_DEVICE();
  using T = Element<12, 4>;
  std::mt19937 random(7);
  for (int shape = 0; shape < test::model_shapes; ++shape) {
    test::SelectionWalk<T> walk(random, static_cast<test::ModelShape>(shape), 500);
    std::uint64_t most = 0;
    for (std::size_t i = 0; i < walk.objects.size(); ++i) most += walk.most(i);
    const DeviceArray<T> block(most), other(most);
    pgl::cuda::ScanWorkspace scan;
    pgl::cuda::DefragmentWorkspace workspace;
    for (int k = 0; k < 40; ++k) {
      const Offsets previous = walk.offsets();
      walk.go(random, static_cast<test::Step>(random() % test::steps));
      const Offsets offsets = walk.offsets();
      const Offsets delta_offsets = delta_of(previous, offsets);
      std::vector<T> additional(delta_offsets.back());
      pgl::host::pack_delta<T>(walk.meshes, walk.objects, &pgl::Mesh::first_vertex, walk.elements, previous, offsets,
                               delta_offsets, additional);

      const DeviceArray<std::uint64_t> previous_there(previous), offsets_there(offsets), delta(offsets.size());
      const DeviceArray<T> additional_there(additional);
      const pgl::cuda::Launch launch(nullptr, block_sizes[random() % block_sizes.size()]);
      must(pgl::cuda::lay_out_delta(previous_there.input(), offsets_there.input(), delta.view(), scan, launch));
      must(pgl::cuda::defragment<T>(previous_there.input(), offsets_there.input(), delta.input(), block.input(),
                                    additional_there.input(), other.view(), launch));
      must(pgl::cuda::defragment_in_place<T>(previous_there.input(), offsets_there.input(), delta.input(),
                                             additional_there.input(), workspace, block.view(), launch));
      const auto expected = walk.fresh();
      auto copied = other.read(), moved = block.read();
      copied.resize(expected.size());
      moved.resize(expected.size());
      ASSERT_TRUE(same_bytes(copied, expected)) << "shape " << shape << ", step " << k;
      ASSERT_TRUE(same_bytes(moved, expected)) << "in place, shape " << shape << ", step " << k;
    }
  }
}

TEST(DefragmentTwin, SameBytesForTwentyThousandObjects) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(8);
  std::vector<std::uint32_t> counts(20000);
  for (auto& count : counts) count = static_cast<std::uint32_t>(random() % 110);
  for (int k = 0; k < 4; ++k) {
    auto next = counts;
    for (auto& count : next) {
      if (k == 1) count = count / 2;
      if (k == 2) count = count * 2;
      if (random() % 25 == 0) count = static_cast<std::uint32_t>(random() % 110);
    }
    ASSERT_GT(offsets_of(next).back() + offsets_of(counts).back(), 1u << 20);
    EXPECT_TRUE((agree<Element<12, 4>>(random, offsets_of(counts), offsets_of(next), 256, 0))) << k;
    EXPECT_TRUE((agree<Element<12, 4>>(random, offsets_of(counts), offsets_of(next), 32, 1))) << k;
    EXPECT_TRUE((agree<Element<6, 2>>(random, offsets_of(counts), offsets_of(next), 1024, 3))) << k;
    counts = next;
  }
}

TEST(DefragmentTwin, ReplaysAsAGraph) {
  PGL_NEEDS_DEVICE();
  using T = Element<12, 4>;
  std::mt19937 random(9);
  std::vector<std::uint32_t> counts(3000), next(3000);
  for (auto& count : counts) count = static_cast<std::uint32_t>(random() % 40);
  for (auto& count : next) count = static_cast<std::uint32_t>(random() % 40);
  const Offsets previous = offsets_of(counts), offsets = offsets_of(next), delta_offsets = delta_of(previous, offsets);
  const auto additional = random_elements<T>(random, delta_offsets.back());
  const auto existing = random_elements<T>(random, std::max(previous.back(), offsets.back()));
  auto expected = existing;
  pgl::host::defragment<T>(previous, offsets, delta_offsets, existing, additional, expected);

  const DeviceArray<std::uint64_t> previous_there(previous), offsets_there(offsets), delta(offsets.size());
  const DeviceArray<T> additional_there(additional), existing_there(existing);
  const DeviceArray<T> out(existing.size()), block(existing);
  pgl::cuda::ScanWorkspace scan;
  pgl::cuda::DefragmentWorkspace workspace;
  const auto enqueue = [&](cudaStream_t stream) {
    PGL_CUDA_TRY(lay_out_delta(previous_there.input(), offsets_there.input(), delta.view(), scan, stream));
    PGL_CUDA_TRY(pgl::cuda::defragment<T>(previous_there.input(), offsets_there.input(), delta.input(),
                                          existing_there.input(), additional_there.input(), out.view(), stream));
    return pgl::cuda::defragment_in_place<T>(previous_there.input(), offsets_there.input(), delta.input(),
                                             additional_there.input(), workspace, block.view(), stream);
  };
  must(enqueue(nullptr));  // loads the kernels, and makes room
  must(cudaDeviceSynchronize());
  const std::size_t scratch = workspace.memory.size();
  const pgl::test::Captured graph(enqueue);
  EXPECT_EQ(workspace.memory.size(), scratch);
  for (int round = 0; round < 3; ++round) {
    pgl::test::poison(delta);
    pgl::test::assign(out, existing);
    pgl::test::assign(block, existing);
    graph.replay();
    EXPECT_TRUE(same_bytes(delta.read(), delta_offsets));
    EXPECT_TRUE(same_bytes(out.read(), expected));
    EXPECT_TRUE(same_bytes(block.read(), expected));
  }
}

TEST(LayOutDeltaTwin, SameSumsForAnyTwoSelections) {
  PGL_NEEDS_DEVICE();
  std::mt19937 random(10);
  for (const std::size_t n : {0, 1, 31, 32, 33, 1023, 1024, 1025, 100000}) {
    std::vector<std::uint32_t> counts(n), next(n);
    for (auto& count : counts) count = random() % 3 == 0 ? static_cast<std::uint32_t>(random()) : 0;
    for (auto& count : next) count = random() % 3 == 0 ? static_cast<std::uint32_t>(random()) : 0;
    const Offsets previous = offsets_of(counts), offsets = offsets_of(next);
    const DeviceArray<std::uint64_t> previous_there(previous), offsets_there(offsets), delta(offsets.size());
    pgl::cuda::ScanWorkspace scan;
    must(pgl::cuda::lay_out_delta(previous_there.input(), offsets_there.input(), delta.view(), scan));
    EXPECT_TRUE(same_bytes(delta.read(), delta_of(previous, offsets))) << n;
  }
}

}  // namespace
