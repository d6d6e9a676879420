// SPDX-License-Identifier: MIT
// What benchmarks and studies share: the least time of several runs, and the number of threads.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <limits>

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace pgl::bench {

/// Milliseconds of the fastest of `repeats` calls of run().
template <class Run>
double least_ms(int repeats, Run&& run) {
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < repeats; ++k) {
    const auto start = std::chrono::steady_clock::now();
    run();
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
    least = std::min(least, took.count());
  }
  return least;
}

/// The same where others share the machine and `threads` work: one's time is that of the processor.
template <class Run>
double least_shared_ms(int repeats, std::size_t threads, Run&& run) {
  if (threads > 1) return bench::least_ms(repeats, run);
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < repeats; ++k) {
    const std::clock_t start = std::clock();
    run();
    least = std::min(least, 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  return least;
}

/// Sets the number of threads; 0: as many as there were at the first call.
inline void set_threads([[maybe_unused]] std::int64_t threads) {
#if defined(_OPENMP)
  static const int all = omp_get_max_threads();
  omp_set_num_threads(threads == 0 ? all : static_cast<int>(threads));
#endif
}

}  // namespace pgl::bench
