// SPDX-License-Identifier: MIT
// A parallel loop for work that may throw and wants to be watched.
#pragma once

#include <atomic>
#include <exception>
#include <mutex>
#include <string_view>

#include "pgl/host/parallel.hpp"
#include "scene/mesh_data.hpp"

namespace pgl::scene {

/// Calls body(i) once for every i in [0, n) on all threads and tells `progress` how many are done.
///
/// When a body (or `progress`) throws, bodies not yet begun are skipped and the first exception caught is rethrown
/// here. Progress is told by the calling thread only, each time it finishes an item, and once at the end.
template <class Body>
void for_each(std::size_t n, const Progress& progress, std::string_view stage, Body&& body) {
  std::atomic<std::size_t> done{0};
  std::atomic<bool> failed{false};
  std::exception_ptr error;
  std::mutex error_mutex;
  pgl::host::parallel_for(n, 1, [&](std::size_t i) {
    if (failed.load(std::memory_order_relaxed)) return;
    try {
      body(i);
      const std::size_t finished = done.fetch_add(1, std::memory_order_relaxed) + 1;
      if (progress && finished < n && pgl::host::thread_index() == 0) progress(stage, finished, n);
    } catch (...) {
      const std::lock_guard lock(error_mutex);
      if (!error) error = std::current_exception();
      failed = true;
    }
  });
  if (error) std::rethrow_exception(error);
  if (progress) progress(stage, n, n);
}

}  // namespace pgl::scene
