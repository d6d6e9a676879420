// SPDX-License-Identifier: MIT
// The one loop of the host drivers: OpenMP where it is present, plain otherwise.
#pragma once

#include <cstddef>
#include <cstdint>

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace pgl::host {

/// Threads that parallel_for may use: OpenMP's current setting, or 1 without OpenMP.
inline std::size_t thread_count() {
#if defined(_OPENMP)
  return static_cast<std::size_t>(omp_get_max_threads());
#else
  return 1;
#endif
}

/// The calling thread's number inside parallel_for, below thread_count().
inline std::size_t thread_index() {
#if defined(_OPENMP)
  return static_cast<std::size_t>(omp_get_thread_num());
#else
  return 0;
#endif
}

/// Calls body(i) once for every i in [0, n), in chunks of `grain` taken as threads become free. Runs on the calling
/// thread alone when n <= grain. The body must not throw, and no result may depend on which thread runs what.
template <class Body>
void parallel_for(std::size_t n, std::size_t grain, Body&& body) {
#if defined(_OPENMP)
  if (n > grain && omp_get_max_threads() > 1) {
    const auto count = static_cast<std::int64_t>(n);
    [[maybe_unused]] const auto chunk = static_cast<std::int64_t>(grain == 0 ? 1 : grain);
#pragma omp parallel for schedule(dynamic, chunk)
    for (std::int64_t i = 0; i < count; ++i) body(static_cast<std::size_t>(i));
    return;
  }
#endif
  (void)grain;
  for (std::size_t i = 0; i < n; ++i) body(i);
}

}  // namespace pgl::host
