// SPDX-License-Identifier: MIT
// log2, exp2 and pow of the exact arithmetic, one thread, against the standard library's in the same run.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/ieee.hpp"

namespace {

constexpr std::size_t count = 4096;

/// `count` numbers with base-2 logarithms evenly spread in [low, high).
template <class T>
std::vector<T> sizes(double low, double high) {
  std::mt19937_64 random(1);
  std::vector<T> values(count);
  for (T& x : values) x = static_cast<T>(std::exp2(low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53));
  return values;
}

template <class T>
std::vector<T> exponents(double low, double high) {
  std::mt19937_64 random(2);
  std::vector<T> values(count);
  for (T& x : values) x = static_cast<T>(low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53);
  return values;
}

template <class T, class Function>
double seconds(const std::vector<T>& in, std::vector<T>& out, Function&& function) {
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < count; ++i) out[i] = function(in[i]);
  benchmark::DoNotOptimize(out.data());
  benchmark::ClobberMemory();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Times `ours`. The counters are the best times of one call, ours and the library's, and their ratio.
template <class T, class Ours, class Library>
void compare(benchmark::State& state, const std::vector<T>& in, Ours&& ours, Library&& library) {
  std::vector<T> out(count);
  double own = 1, peer = 1;
  for (auto _ : state) {
    const double elapsed = seconds(in, out, ours);
    state.SetIterationTime(elapsed);
    own = std::min(own, elapsed);
    peer = std::min(peer, seconds(in, out, library));
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(count));
  state.counters["ns"] = own / count * 1e9;
  state.counters["ns_std"] = peer / count * 1e9;
  state.counters["time_over_std"] = own / peer;
}

template <class T>
void log2(benchmark::State& state) {
  compare(
      state, sizes<T>(-30, 30), [](T x) { return pgl::ieee::log2(x); }, [](T x) { return std::log2(x); });
}
template <class T>
void exp2(benchmark::State& state) {
  compare(
      state, exponents<T>(-30, 30), [](T x) { return pgl::ieee::exp2(x); }, [](T x) { return std::exp2(x); });
}
template <class T>
void pow(benchmark::State& state) {
  compare(
      state, sizes<T>(-30, 30), [](T x) { return pgl::ieee::pow(x, T(2.3)); }, [](T x) { return std::pow(x, T(2.3)); });
}

BENCHMARK(log2<double>)->UseManualTime();
BENCHMARK(exp2<double>)->UseManualTime();
BENCHMARK(pow<double>)->UseManualTime();
BENCHMARK(log2<float>)->UseManualTime();
BENCHMARK(exp2<float>)->UseManualTime();
BENCHMARK(pow<float>)->UseManualTime();

}  // namespace

BENCHMARK_MAIN();
