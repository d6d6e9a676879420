// SPDX-License-Identifier: MIT
// Device memory that a workspace keeps from frame to frame.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <utility>

#include "pgl/cuda/launch.cuh"

namespace pgl::cuda {

namespace detail {

struct DeviceMemory {
  static cudaError_t take(void** data, std::size_t bytes) { return cudaMalloc(data, bytes); }
  static cudaError_t give_back(void* data) { return cudaFree(data); }
};
struct PinnedMemory {
  static cudaError_t take(void** data, std::size_t bytes) { return cudaMallocHost(data, bytes); }
  static cudaError_t give_back(void* data) { return cudaFreeHost(data); }
};

template <class Memory>
class GrowingBuffer {
 public:
  GrowingBuffer() = default;
  GrowingBuffer(GrowingBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  GrowingBuffer& operator=(GrowingBuffer&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~GrowingBuffer() {
    if (data_ != nullptr) (void)Memory::give_back(data_);
  }

  /// Makes room for at least `bytes`, by half more than before where it must grow. On an error it is empty.
  [[nodiscard]] cudaError_t reserve(std::size_t bytes) {
    if (bytes <= size_) return cudaSuccess;
    const std::size_t grown = size_ + size_ / 2;
    if (data_ != nullptr) PGL_CUDA_TRY(Memory::give_back(data_));
    data_ = nullptr;
    size_ = 0;
    const std::size_t wanted = bytes > grown ? bytes : grown;
    PGL_CUDA_TRY(Memory::take(&data_, wanted));
    size_ = wanted;
    return cudaSuccess;
  }

  std::size_t size() const { return size_; }  ///< bytes

  /// The memory `offset` bytes in, aligned to 256 bytes where offset is a multiple of 256.
  template <class T>
  T* at(std::size_t offset = 0) const {
    return reinterpret_cast<T*>(static_cast<std::byte*>(data_) + offset);
  }

 private:
  void* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace detail

/// Device memory that only grows, on the device that is current when it grows. Contents mean nothing after it grew.
///
/// Growing allocates, which may wait for the device and is refused while a stream is being captured: run a step once,
/// or reserve what its docstring names, before you capture it. A call that finds room enough does nothing.
using Buffer = detail::GrowingBuffer<detail::DeviceMemory>;

/// Page-locked host memory that only grows, from which copies to the device run beside other work. Contents mean
/// nothing after it grew. Growing may wait for the device.
using PinnedBuffer = detail::GrowingBuffer<detail::PinnedMemory>;

namespace detail {

/// Hands out the parts of one buffer, each aligned to 256 bytes: first with no memory, to learn the size, then again.
class Parts {
 public:
  explicit Parts(void* memory = nullptr) : memory_(static_cast<std::byte*>(memory)) {}
  template <class T>
  T* take(std::size_t count) {
    const std::size_t offset = size_;
    size_ += (count * sizeof(T) + 255) / 256 * 256;
    return memory_ == nullptr ? nullptr : reinterpret_cast<T*>(memory_ + offset);
  }
  std::size_t size() const { return size_; }

 private:
  std::byte* memory_;
  std::size_t size_ = 0;
};

}  // namespace detail

}  // namespace pgl::cuda
