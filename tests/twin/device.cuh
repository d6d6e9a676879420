// SPDX-License-Identifier: MIT
// What the twin tests share: device arrays at any alignment, block sizes to try, and a skip where there is no GPU.
#pragma once

#include <cuda_runtime.h>
#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#if defined(_OPENMP)
#include <omp.h>
#endif

#include "pgl/cuda/launch.cuh"

namespace pgl::test {

inline bool has_device() {
  int count = 0;
  return cudaGetDeviceCount(&count) == cudaSuccess && count > 0;
}

/// Ends the test as skipped where no GPU is.
#define PGL_NEEDS_DEVICE() \
  if (!::pgl::test::has_device()) GTEST_SKIP() << "no GPU: device results are NOT compared"

/// Throws on a CUDA error: the tests cannot go on after one.
inline void must(cudaError_t error) {
  if (error != cudaSuccess) throw std::runtime_error(std::string("CUDA: ") + cudaGetErrorString(error));
}

/// Block sizes to try every driver with, none of which may change a bit.
inline constexpr std::array<unsigned, 4> block_sizes = {32, 96, 256, 1024};

/// An array on the device that starts `shift` elements behind an aligned address, with bytes around it that must stay
/// as they are.
template <class T>
class DeviceArray {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// Filled with the bytes 0xA5, which no result may keep.
  explicit DeviceArray(std::size_t size, std::size_t shift = 1) : size_(size), shift_(shift) {
    must(cudaMalloc(&memory_, bytes()));
    must(cudaMemset(memory_, 0xA5, bytes()));
  }
  explicit DeviceArray(std::span<const T> values, std::size_t shift = 1) : DeviceArray(values.size(), shift) {
    if (size_ > 0) must(cudaMemcpy(data(), values.data(), size_ * sizeof(T), cudaMemcpyHostToDevice));
  }
  explicit DeviceArray(const std::vector<T>& values, std::size_t shift = 1)
      : DeviceArray(std::span<const T>(values), shift) {}
  DeviceArray(const DeviceArray&) = delete;
  DeviceArray& operator=(const DeviceArray&) = delete;
  ~DeviceArray() { cudaFree(memory_); }

  T* data() const { return static_cast<T*>(memory_) + shift_; }
  std::span<T> view() const { return {data(), size_}; }
  std::span<const T> input() const { return {data(), size_}; }

  /// Waits for the device, checks the bytes around the array, and returns what is in it.
  std::vector<T> read() const {
    must(cudaDeviceSynchronize());
    std::vector<std::uint8_t> all(bytes());
    must(cudaMemcpy(all.data(), memory_, bytes(), cudaMemcpyDeviceToHost));
    const std::size_t begin = shift_ * sizeof(T), end = begin + size_ * sizeof(T);
    for (std::size_t i = 0; i < all.size(); ++i)
      if ((i < begin || i >= end) && all[i] != 0xA5) throw std::runtime_error("a kernel wrote outside its output");
    std::vector<T> values(size_);
    if (size_ > 0) std::memcpy(static_cast<void*>(values.data()), all.data() + begin, size_ * sizeof(T));
    return values;
  }

 private:
  std::size_t bytes() const { return (size_ + shift_ + 8) * sizeof(T); }
  void* memory_ = nullptr;
  std::size_t size_, shift_;
};

/// Calls body() with one thread of the CPU and with all.
template <class Body>
void with_host_threads(Body&& body) {
#if defined(_OPENMP)
  const int all = omp_get_max_threads();
  for (const int threads : {1, all}) {
    omp_set_num_threads(threads);
    body();
  }
  omp_set_num_threads(all);
#else
  body();
#endif
}

/// The same bytes, NaNs included.
template <class T>
::testing::AssertionResult same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  if (a.size() != b.size()) return ::testing::AssertionFailure() << a.size() << " against " << b.size() << " elements";
  for (std::size_t i = 0; i < a.size(); ++i)
    if (std::memcmp(static_cast<const void*>(&a[i]), static_cast<const void*>(&b[i]), sizeof(T)) != 0)
      return ::testing::AssertionFailure() << "element " << i << " of " << a.size() << " differs";
  return ::testing::AssertionSuccess();
}

}  // namespace pgl::test
