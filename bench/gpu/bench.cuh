// SPDX-License-Identifier: MIT
// How the GPU benchmarks measure: device memory, timing by events and graphs, comparison with the host's bytes, rows.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "plant.hpp"
#include "report.hpp"

namespace pgl::bench {

/// Throws on a CUDA error.
inline void must(cudaError_t error, const char* what = "CUDA") {
  if (error != cudaSuccess) throw std::runtime_error(std::string(what) + ": " + cudaGetErrorString(error));
}

/// An array in device memory.
template <class T>
class DeviceArray {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  DeviceArray() = default;
  explicit DeviceArray(std::size_t size) : size_(size) {
    if (size > 0) must(cudaMalloc(&data_, size * sizeof(T)), "allocation");
    poison();
  }
  explicit DeviceArray(std::span<const T> values) : DeviceArray(values.size()) {
    if (size_ > 0) must(cudaMemcpy(data_, values.data(), size_ * sizeof(T), cudaMemcpyHostToDevice), "upload");
  }
  explicit DeviceArray(const std::vector<T>& values) : DeviceArray(std::span<const T>(values)) {}
  DeviceArray(DeviceArray&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~DeviceArray() { cudaFree(data_); }

  /// Fills it with bytes that no result may keep.
  void poison() const {
    if (size_ > 0) must(cudaMemset(data_, 0xA5, size_ * sizeof(T)), "memset");
  }
  T* data() const { return static_cast<T*>(data_); }
  std::size_t size() const { return size_; }
  std::span<T> view() const { return {data(), size_}; }
  std::span<const T> input() const { return {data(), size_}; }

 private:
  void* data_ = nullptr;
  std::size_t size_ = 0;
};

/// Device bytes and what they must be after the call.
struct Expected {
  void* device;
  const void* host;
  std::size_t bytes;
};
template <class T, class Values>
Expected expect(const DeviceArray<T>& device, const Values& host) {
  static_assert(std::is_same_v<std::remove_cvref_t<decltype(host[0])>, T>);
  if (device.size() < host.size()) throw std::runtime_error("a device array is too small for what it must hold");
  return {device.data(), host.data(), host.size() * sizeof(T)};
}

/// A row to measure. Enqueue puts the call on a stream (none: the host's times only); outputs are poisoned before and
/// compared after. A call that changes what it reads comes with those that change it back: `calls` of them then, and
/// `check` is enqueued where outputs are compared.
struct Measurement {
  std::string name{};
  std::uint64_t bytes = 0;
  std::function<cudaError_t(cudaStream_t)> enqueue{};
  std::function<cudaError_t(cudaStream_t)> check{};  ///< none: enqueue
  double calls = 1;                                  ///< that enqueue and host do; times are those of one
  std::function<std::vector<Expected>()> outputs{};  ///< asked for after `host` ran
  std::function<void()> host{};                      ///< the same call of pgl::host; it writes what is expected
  bool graph = true;                                 ///< also captured and replayed
  bool host_one = true, host_all = true;
  std::optional<double> host_all_ms{};  ///< where it was measured before
  double host_scale = 1.0;              ///< where `host` does one part in so many
  std::optional<double> target_ms{};
  std::string note{};
};

struct BenchOptions {
  std::vector<std::string> filters;  ///< rows whose names contain one of them; none: all
  std::string json, table;           ///< files, rewritten after every row; none where empty
  bool quick = false;                ///< fewer repetitions
  bool host_only = false;            ///< no device is touched
};

class Bench {
 public:
  explicit Bench(BenchOptions options);
  ~Bench();
  Bench(const Bench&) = delete;
  Bench& operator=(const Bench&) = delete;

  Report report;

  /// Tells whether a row of this name is asked for, and whether any of names that begin so may be.
  bool wants(const std::string& name) const;

  /// Measures one row and writes the report. What goes wrong with it goes into its note and into failures().
  void row(const Measurement& measurement);

  /// A row that was measured elsewhere.
  void add(Row row);

  /// A row that is left out, and why.
  void left_out(const std::string& name, const std::string& why);

  /// Measures how fast the device copies, which all other rows are compared with.
  void copy();

  /// Device memory; none where only the host is measured.
  template <class T>
  DeviceArray<T> array(std::size_t size) const {
    return host_only() ? DeviceArray<T>() : DeviceArray<T>(size);
  }
  template <class Values>
  auto upload(const Values& values) const {
    using T = std::remove_cvref_t<decltype(*values.data())>;
    return host_only() ? DeviceArray<T>() : DeviceArray<T>(std::span<const T>(values.data(), values.size()));
  }

  bool host_only() const { return options_.host_only; }
  bool quick() const { return options_.quick; }
  int failures() const { return failures_; }
  void save() const;

 private:
  using Enqueue = std::function<cudaError_t(cudaStream_t)>;

  void device(const Measurement& m, const std::vector<Expected>& outputs, Row& row);
  void host(const Measurement& m, Row& row) const;
  int repeats(double ms) const;
  double events_ms(const Enqueue& enqueue, int times, int each, bool cold);
  bool same_bytes(const Expected& expected);

  BenchOptions options_;
  cudaStream_t stream_ = nullptr;
  void* flushed_ = nullptr;
  void* staging_ = nullptr;
  int failures_ = 0;
};

/// Milliseconds on the host's clock.
class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace pgl::bench
