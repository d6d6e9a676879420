// SPDX-License-Identifier: MIT
// Reads what the next frames will want of a mapped model, on a thread in the background.
#pragma once

#if defined(__linux__)
#include <sys/resource.h>
#include <unistd.h>
#endif

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <new>
#include <optional>
#include <stop_token>
#include <thread>
#include <utility>
#include <vector>

#if defined(_OPENMP)
#include <omp.h>
#endif

#include "pgl/distribute_budget.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/project.hpp"
#include "scene/model_file.hpp"
#include "scene/model_view.hpp"

namespace pgl::viewer {

/// Chooses what a frame from a later camera would draw, and has the file read and checked for it, so that the frame
/// finds it in memory. Occlusion is left out: a little more is read. One thread, the latest wish only. What is wrong
/// with the file is left to the frame that needs it.
template <class Index>
class Prefetcher {
 public:
  /// The file and its model must outlive this. Reads the whole map where min_triangles is not 0.
  Prefetcher(scene::ModelFile& file, const scene::ModelView<Index>& model, std::uint32_t min_triangles)
      : file_(file),
        model_(model),
        min_triangles_(min_triangles),
        thread_([this](std::stop_token stop) { run(stop); }) {}
  Prefetcher(const Prefetcher&) = delete;
  Prefetcher& operator=(const Prefetcher&) = delete;

  /// What will be wanted: the frame of this view, within options.budget. Returns at once; a wish that has not been
  /// taken up yet is forgotten.
  void want(const View& view, const BudgetOptions& options) {
    {
      const std::lock_guard lock(mutex_);
      wish_ = Wish{view, options};
    }
    wished_.notify_one();
  }

 private:
  struct Wish {
    View view;
    BudgetOptions options;
  };

  void run(const std::stop_token& stop) {
    try {
      serve(stop);
    } catch (const std::bad_alloc&) {  // the frames read for themselves
    }
  }

  void serve(const std::stop_token& stop) {
#if defined(__linux__)
    // The frame's threads wait for each other: one that had to share its core would hold up all. So this one has what
    // they leave. (Nice values are each thread's own on Linux.)
    (void)setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), 19);
#endif
#if defined(_OPENMP)
    omp_set_num_threads(1);  // of this thread's parallel loops: the frame has the others
#endif
    const std::size_t n = model_.objects.size();
    std::vector<std::uint32_t> mesh_of_object(n), least(n), most(n), counts(n);
    std::ranges::transform(model_.objects, mesh_of_object.begin(), &Object::mesh);
    host::vertex_limits(mesh_of_object, model_.meshes, model_.map, min_triangles_, least, most);
    std::vector<std::uint8_t> in_view(n);
    std::vector<float> areas(n), depths(n);
    host::BudgetWorkspace workspace;
    for (;;) {
      Wish wish;
      {
        std::unique_lock lock(mutex_);
        if (!wished_.wait(lock, stop, [&] { return wish_.has_value(); })) return;
        wish = *std::exchange(wish_, std::nullopt);
      }
      host::cull_frustum(model_.object_boxes, wish.view, in_view);
      host::project(model_.object_boxes, in_view, wish.view, areas, depths);
      wish.options.near_depth = wish.view.near_depth;
      wish.options.viewport_area = wish.view.width * wish.view.height;
      host::distribute_budget(areas, depths, least, most, wish.options, workspace, counts);
      file_.prefetch(counts, stop);
    }
  }

  scene::ModelFile& file_;
  const scene::ModelView<Index> model_;
  const std::uint32_t min_triangles_;
  std::mutex mutex_;
  std::condition_variable_any wished_;
  std::optional<Wish> wish_;
  std::jthread thread_;
};

}  // namespace pgl::viewer
