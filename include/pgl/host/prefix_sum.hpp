// SPDX-License-Identifier: MIT
// Exclusive prefix sums and block-wise reductions of integers, the same for any number of threads.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"

namespace pgl::host {

namespace detail {

inline constexpr std::size_t max_blocks = 64;

/// The number of equal parts in which n elements are worked on: a few for each thread, one where threads do not pay.
inline std::size_t block_count(std::size_t n) {
  const std::size_t threads = thread_count();
  return threads == 1 ? 1 : std::min({max_blocks, 4 * threads, n / 4096 + 1});
}

/// Calls body(block, begin, end) for every block of [0, n).
template <class Body>
void for_blocks(std::size_t n, std::size_t blocks, Body&& body) {
  parallel_for(blocks, 1, [&](std::size_t b) { body(b, n * b / blocks, n * (b + 1) / blocks); });
}

/// Adds up part(block, begin, end) over all blocks of [0, n); any type with +=, whose order must not matter.
template <class Part>
auto sum_blocks(std::size_t n, std::size_t blocks, Part&& part) {
  std::array<decltype(part(n, n, n)), max_blocks> parts{};
  for_blocks(n, blocks, [&](std::size_t b, std::size_t begin, std::size_t end) { parts[b] = part(b, begin, end); });
  for (std::size_t b = 1; b < blocks; ++b) parts[0] += parts[b];
  return parts[0];
}

/// Writes the exclusive prefix sums of value(0) .. value(n - 1) to offsets[0 .. n], and returns the total. Each value
/// is asked for once or twice, from any thread.
template <class Value>
std::uint64_t scan(std::size_t n, std::span<std::uint64_t> offsets, Value&& value) {
  const std::size_t blocks = block_count(n);
  std::array<std::uint64_t, max_blocks> starts{};
  if (blocks > 1) {
    for_blocks(n, blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
      std::uint64_t sum = 0;
      for (std::size_t i = begin; i < end; ++i) sum += value(i);
      starts[b] = sum;
    });
    std::uint64_t running = 0;
    for (std::size_t b = 0; b < blocks; ++b) {
      const std::uint64_t sum = starts[b];
      starts[b] = running;
      running += sum;
    }
  }
  offsets[0] = 0;
  for_blocks(n, blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
    std::uint64_t running = starts[b];
    for (std::size_t i = begin; i < end; ++i) {
      running += value(i);
      offsets[i + 1] = running;
    }
  });
  return offsets[n];
}

}  // namespace detail

/// Writes the exclusive prefix sums of n integers: offsets[i] is the sum of the first i values, offsets[n] the total,
/// which is also returned.
///
/// values: in, n unsigned integers. offsets: out, n + 1 entries, not overlapping values. No values: one offset, 0.
/// Precondition: the total is below 2^64. O(n), nothing allocated; the same for any number of threads.
template <class T>
std::uint64_t exclusive_sum(std::span<const T> values, std::span<std::uint64_t> offsets) {
  PGL_ASSERT(offsets.size() == values.size() + 1);
  return detail::scan(values.size(), offsets, [&](std::size_t i) { return values[i]; });
}

}  // namespace pgl::host
