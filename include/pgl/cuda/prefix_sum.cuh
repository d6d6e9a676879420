// SPDX-License-Identifier: MIT
// Exclusive prefix sums of integers, on the GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cub/device/device_scan.cuh>
#include <cuda/std/functional>
#include <iterator>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"

namespace pgl::cuda {

/// Scratch memory of exclusive_sum and of what calls it: a few bytes for each thousand values.
struct ScanWorkspace {
  Buffer memory;
};

namespace detail {

/// Reads n integers as 64-bit ones, and behind them zeros, so that the scan of n + 1 values ends with the total. Values
/// is a pointer, or anything else that computes values[i] on the device.
template <class Values>
struct ZeroEnded {
  using iterator_category = std::random_access_iterator_tag;
  using value_type = std::uint64_t;
  using difference_type = std::ptrdiff_t;
  using pointer = const std::uint64_t*;
  using reference = std::uint64_t;

  Values values;
  difference_type size;
  difference_type place = 0;

  PGL_HD std::uint64_t operator*() const { return place < size ? static_cast<std::uint64_t>(values[place]) : 0u; }
  PGL_HD std::uint64_t operator[](difference_type i) const { return *(*this + i); }
  PGL_HD ZeroEnded operator+(difference_type i) const { return {values, size, place + i}; }
  PGL_HD ZeroEnded operator-(difference_type i) const { return {values, size, place - i}; }
  PGL_HD difference_type operator-(const ZeroEnded& other) const { return place - other.place; }
  PGL_HD ZeroEnded& operator+=(difference_type i) { return *this = *this + i; }
  PGL_HD ZeroEnded& operator-=(difference_type i) { return *this = *this - i; }
  PGL_HD ZeroEnded& operator++() { return *this += 1; }
  PGL_HD ZeroEnded& operator--() { return *this -= 1; }
  PGL_HD ZeroEnded operator++(int) { return ++*this - 1; }
  PGL_HD ZeroEnded operator--(int) { return --*this + 1; }
  PGL_HD bool operator==(const ZeroEnded& other) const { return place == other.place; }
  PGL_HD bool operator!=(const ZeroEnded& other) const { return place != other.place; }
  PGL_HD bool operator<(const ZeroEnded& other) const { return place < other.place; }
};

/// Writes the n + 1 exclusive prefix sums of values[0 .. n).
template <class Values>
[[nodiscard]] cudaError_t exclusive_sum(Values values, std::uint64_t n, std::uint64_t* offsets,
                                        ScanWorkspace& workspace, Launch launch) {
  const ZeroEnded<Values> in{values, static_cast<std::ptrdiff_t>(n)};
  const auto scan = [&](void* memory, std::size_t& bytes) {
    return cub::DeviceScan::ExclusiveScan(memory, bytes, in, offsets, ::cuda::std::plus<>{}, std::uint64_t{0},
                                          static_cast<std::int64_t>(n + 1), launch.stream);
  };
  std::size_t bytes = 0;
  PGL_CUDA_TRY(scan(nullptr, bytes));
  PGL_CUDA_TRY(workspace.memory.reserve(bytes));
  return scan(workspace.memory.at<void>(), bytes);
}

}  // namespace detail

/// Writes the exclusive prefix sums of n unsigned integers, as pgl::host::exclusive_sum does; offsets[n] is the total.
///
/// values: in, on the device. offsets: out, on the device, n + 1 entries, not overlapping values; the one entry 0 for
/// no values. Preconditions: those of the host; n < 2^63.
/// O(n), one pass (CUB); no scratch is allocated once the workspace has been used for as many values. Enqueued on
/// launch.stream, capturable. Integers: the same for any GPU. launch.block_threads is not read.
template <class T>
[[nodiscard]] cudaError_t exclusive_sum(std::span<const T> values, std::span<std::uint64_t> offsets,
                                        ScanWorkspace& workspace, Launch launch = {}) {
  PGL_ASSERT(offsets.size() == values.size() + 1);
  return detail::exclusive_sum(values.data(), values.size(), offsets.data(), workspace, launch);
}

}  // namespace pgl::cuda
