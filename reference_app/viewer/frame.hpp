// SPDX-License-Identifier: MIT
// The way from a camera to the triangles to draw, written once for every backend.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>

#include "pgl/distribute_budget.hpp"
#include "pgl/gather.hpp"
#include "pgl/types.hpp"
#include "scene/build_model.hpp"

namespace pgl::viewer {

/// Milliseconds since it was made or last asked.
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

/// What each step of a frame took, in milliseconds.
struct FrameTimes {
  double cull = 0.0, project = 0.0, budget = 0.0, reform = 0.0, gather = 0.0;
};

/// One model under a moving camera. The buffers are kept from frame to frame and only grow.
template <class Backend, class Index>
class Frame {
 public:
  template <class T>
  using Array = typename Backend::template Array<T>;

  /// `model` must outlive the frame. A drawn object keeps at least min_triangles triangles, or all that it has.
  Frame(const scene::Model<Index>& model, std::uint32_t min_triangles) : model_(model) {
    const std::size_t n = model.objects.size();
    for (auto* counts : {&mesh_of_object_, &min_vertices_, &max_vertices_, &counts_, &triangle_counts_}) {
      counts->resize(n);
    }
    in_view_.resize(n);
    areas_.resize(n);
    depths_.resize(n);
    vertex_offsets_.resize(n + 1);
    triangle_offsets_.resize(n + 1);
    for (std::size_t i = 0; i < n; ++i) mesh_of_object_[i] = model.objects[i].mesh;
    Backend::vertex_limits(std::span(mesh_of_object_), std::span(model.meshes), std::span(model.map), min_triangles,
                           std::span(min_vertices_), std::span(max_vertices_));
  }

  /// Selects and builds what to draw of the model from `view` within options.budget vertices; the depths and areas of
  /// `options` are taken from the view. Throws std::runtime_error where 32-bit indices do not suffice.
  FrameTimes run(const View& view, BudgetOptions options) {
    FrameTimes ms;
    Stopwatch watch;
    const auto lap = [&watch] {
      Backend::finish();
      return watch.lap();
    };

    Backend::cull_frustum(std::span(model_.object_boxes), view, std::span(in_view_));
    ms.cull = lap();

    Backend::project(std::span(model_.object_boxes), std::span(in_view_), view, std::span(areas_), std::span(depths_));
    ms.project = lap();

    options.near_depth = view.near_depth;
    options.viewport_area = view.width * view.height;
    const auto drawn =
        Backend::distribute_budget(std::span(areas_), std::span(depths_), std::span(min_vertices_),
                                   std::span(max_vertices_), options, budget_workspace_, std::span(counts_));
    objects_ = drawn.objects;
    Backend::lay_out(std::span(counts_), std::span(mesh_of_object_), std::span(model_.meshes), std::span(model_.map),
                     std::span(triangle_counts_), std::span(vertex_offsets_), std::span(triangle_offsets_));
    vertices_size_ = drawn.vertices;
    triangles_size_ = triangle_offsets_.back();
    if (vertices_size_ > std::numeric_limits<std::uint32_t>::max()) {
      throw std::runtime_error("--budget: the frame has more vertices than 32-bit indices can tell apart: lower it");
    }
    if (vertices_.size() < vertices_size_) vertices_.resize(vertices_size_);
    if (triangles_.size() < triangles_size_) triangles_.resize(triangles_size_);
    ms.budget = lap();

    Backend::reform(std::span(model_.meshes), std::span(model_.objects), std::span(model_.triangles),
                    std::span(model_.ecol), std::span(counts_), std::span(vertex_offsets_),
                    std::span(triangle_offsets_), reform_workspace_, std::span(triangles_).first(triangles_size_));
    ms.reform = lap();

    Backend::gather(std::span(model_.meshes), std::span(model_.objects), std::span(model_.vertices), std::span(counts_),
                    std::span(vertex_offsets_), std::span(vertices_).first(vertices_size_));
    ms.gather = lap();
    return ms;
  }

  std::span<const PlacedVertex> vertices() const { return std::span(vertices_).first(vertices_size_); }
  std::span<const Triangle<std::uint32_t>> triangles() const { return std::span(triangles_).first(triangles_size_); }
  std::uint64_t objects_drawn() const { return objects_; }
  std::uint64_t objects_in_view() const {
    return static_cast<std::uint64_t>(std::ranges::count(in_view_, std::uint8_t{1}));
  }

 private:
  const scene::Model<Index>& model_;
  Array<std::uint32_t> mesh_of_object_, min_vertices_, max_vertices_, counts_, triangle_counts_;
  Array<std::uint8_t> in_view_;
  Array<float> areas_, depths_;
  Array<std::uint64_t> vertex_offsets_, triangle_offsets_;
  Array<PlacedVertex> vertices_;
  Array<Triangle<std::uint32_t>> triangles_;
  std::uint64_t objects_ = 0, vertices_size_ = 0, triangles_size_ = 0;
  typename Backend::BudgetWorkspace budget_workspace_;
  typename Backend::template ReformWorkspace<Index> reform_workspace_;
};

}  // namespace pgl::viewer
