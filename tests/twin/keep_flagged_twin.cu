// SPDX-License-Identifier: MIT
// Flags in common, less a list: the GPU's bytes against the CPU's.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/cuda/keep_flagged.cuh"
#include "pgl/host/keep_flagged.hpp"
#include "twin/device.cuh"
#include "twin/graph.cuh"

namespace {

using pgl::test::block_sizes;
using pgl::test::DeviceArray;
using pgl::test::must;
using pgl::test::same_bytes;
using pgl::test::with_host_threads;

struct Flags {
  std::vector<std::uint8_t> flags, also;
  std::vector<std::uint32_t> except;
};

Flags random_flags(std::size_t n, std::size_t listed, std::uint32_t seed) {
  std::mt19937 random(seed);
  Flags f;
  for (std::size_t i = 0; i < n; ++i) {
    f.flags.push_back(static_cast<std::uint8_t>(random() % 3 == 0 ? 0 : random() % 256));
    f.also.push_back(static_cast<std::uint8_t>(random() % 3));
  }
  for (std::size_t i = 0; i < listed; ++i)
    f.except.push_back(n == 0 || random() % 4 == 0 ? pgl::no_object : static_cast<std::uint32_t>(random() % n));
  return f;
}

std::vector<std::uint8_t> host_kept(const Flags& f) {
  std::vector<std::uint8_t> out(f.flags.size(), 0xA5);
  pgl::host::keep_flagged(f.flags, f.also, f.except, out);
  return out;
}

TEST(KeepFlaggedTwin, SameBytesAtEverySize) {
  PGL_NEEDS_DEVICE();
  for (const std::size_t n : {0, 1, 31, 32, 33, 255, 256, 257, 1023, 1024, 1025, 300'001})
    for (const std::size_t listed : {0, 1, 33, 700})
      for (const bool all : {false, true}) {
        Flags f = random_flags(n, listed, static_cast<std::uint32_t>(n + listed));
        if (all) f.also.clear();
        const std::vector<std::uint8_t> expected = host_kept(f);
        with_host_threads([&] { EXPECT_TRUE(same_bytes(host_kept(f), expected)); });
        for (const unsigned threads : block_sizes) {
          const DeviceArray<std::uint8_t> flags(f.flags), also(f.also), out(n);
          const DeviceArray<std::uint32_t> except(f.except);
          must(pgl::cuda::keep_flagged(flags.input(), also.input(), except.input(), out.view(), {nullptr, threads}));
          EXPECT_TRUE(same_bytes(out.read(), expected)) << n << " objects, blocks of " << threads;
          must(pgl::cuda::keep_flagged(flags.input(), also.input(), except.input(), flags.view(), {nullptr, threads}));
          EXPECT_TRUE(same_bytes(flags.read(), expected)) << n << " objects in place, blocks of " << threads;
        }
      }
}

TEST(KeepFlaggedTwin, ReplaysAsAGraphOverOtherFlags) {
  PGL_NEEDS_DEVICE();
  const Flags first = random_flags(5000, 40, 1);
  const DeviceArray<std::uint8_t> flags(first.flags), also(first.also), out(first.flags.size());
  const DeviceArray<std::uint32_t> except(first.except);
  const pgl::test::Captured graph([&](cudaStream_t stream) {
    return pgl::cuda::keep_flagged(flags.input(), also.input(), except.input(), out.view(), stream);
  });
  for (const std::uint32_t seed : {1u, 2u}) {
    const Flags now = random_flags(5000, 40, seed);
    pgl::test::assign(flags, now.flags);
    pgl::test::assign(also, now.also);
    pgl::test::assign(except, now.except);
    pgl::test::poison(out);
    graph.replay();
    EXPECT_TRUE(same_bytes(out.read(), host_kept(now)));
  }
}

}  // namespace
