// SPDX-License-Identifier: MIT
// The way from a camera to the triangles to draw, written once for every backend.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "pgl/build_hzm.hpp"
#include "pgl/depth.hpp"
#include "pgl/distribute_budget.hpp"
#include "pgl/gather.hpp"
#include "pgl/host/select_occluders.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"
#include "scene/build_model.hpp"
#include "viewer/buffers.hpp"
#include "viewer/occlusion.hpp"

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

/// What each step of a frame took, in milliseconds. Upload: handing the buffers over, to OpenGL and back.
struct FrameTimes {
  double cull = 0.0, occluders = 0.0, depth = 0.0, hzm = 0.0, occlusion = 0.0;
  double project = 0.0, budget = 0.0, reform = 0.0, gather = 0.0, upload = 0.0;
};

/// What a frame chose, by object.
struct Selection {
  std::vector<std::uint32_t> counts;     ///< vertices drawn
  std::vector<std::uint8_t> in_view;     ///< 1: may be in the frustum
  std::vector<std::uint8_t> visible;     ///< 1: that, and not known to be hidden
  std::vector<std::uint32_t> occluders;  ///< objects that were drawn into the depth
};

/// What prepares the frames.
struct BackendInfo {
  std::string name;      ///< host, cuda
  std::string gpu;       ///< the name of the device, empty on the host
  bool interop = false;  ///< frames are written straight into OpenGL's buffers
  std::string note;      ///< what the person at the screen should know, or empty
};

/// A frame as the viewer's loop sees it, whatever the backend and the width of the indices.
class AnyFrame {
 public:
  AnyFrame() = default;
  virtual ~AnyFrame() = default;
  AnyFrame(const AnyFrame&) = delete;
  AnyFrame& operator=(const AnyFrame&) = delete;

  /// Selects and builds what to draw of the model from `view` within options.budget vertices, into the DrawBuffers; the
  /// depths and areas of `options` are taken from the view. Throws std::runtime_error where 32-bit indices do not
  /// suffice, memory runs out or a device fails.
  virtual FrameTimes run(const View& view, BudgetOptions options) = 0;

  /// Of the last frame.
  virtual std::uint64_t objects_drawn() const = 0;
  virtual Selection selection() = 0;

  virtual BackendInfo info() const = 0;
};

/// One model under a moving camera. Memory is kept from frame to frame and only grows.
///
/// Backend is a class that has
/// - Input<T>: an array of the model as the steps read it, made from a const std::vector<T>& that outlives it;
/// - Array<T>: working memory, made empty or from a std::vector<T>, with resize();
/// - the steps, under the names and with the arguments of pgl::host; distribute_budget has at its end where the totals
///   go, in such an array;
/// - BudgetWorkspace, ReformWorkspace<Index>, OccluderWorkspace, DepthWorkspace: their scratch;
/// - reserve(ReformWorkspace, objects, vertices of the largest mesh);
/// - clear(depths): makes them all far_depth;
/// - finish(): waits until the results are there;
/// - fetch(pointers to elements...): their values, as a tuple; download(span): its elements, as a vector;
/// - begin_drawing(vertices, triangles): where reform and gather write, as spans; end_drawing(): shows it to OpenGL;
/// - info().
template <class Backend, class Index>
class Frame final : public AnyFrame {
 public:
  template <class T>
  using Array = typename Backend::template Array<T>;
  template <class T>
  using Input = typename Backend::template Input<T>;

  /// `model` and what the backend is made of must outlive the frame. A drawn object keeps at least min_triangles
  /// triangles, or all that it has.
  Frame(const scene::Model<Index>& model, std::uint32_t min_triangles, const OcclusionOptions& occlusion,
        auto&&... backend)
      : backend_(backend...),
        occlusion_(occlusion.mode != OcclusionMode::off),
        temporal_(occlusion.mode == OcclusionMode::temporal),
        refinement_(occlusion.refinement),
        meshes_(model.meshes),
        objects_(model.objects),
        vertices_(model.vertices),
        triangles_(model.triangles),
        ecol_(model.ecol),
        map_(model.map),
        boxes_(model.object_boxes),
        faces_(model.faces),
        candidates_(occlusion_ ? candidates(model, occlusion.compactness) : std::vector<std::uint32_t>()),
        mesh_of_object_(mesh_numbers(model.objects)) {
    const std::size_t n = model.objects.size();
    for (auto* counts : {&min_vertices_, &max_vertices_, &counts_, &triangle_counts_}) counts->resize(n);
    in_view_.resize(n);
    if (occlusion_) {
      visible_.resize(n);
      occluders_.resize(std::min(occlusion.aos, candidates_.size()));
      if (temporal_) {
        choice_ = Array<std::uint8_t>(std::vector<std::uint8_t>(n, 1));
        visible_ = Array<std::uint8_t>(std::vector<std::uint8_t>(n, 1));
        more_occluders_.resize(occluders_.size());
      }
    }
    areas_.resize(n);
    depths_.resize(n);
    vertex_offsets_.resize(n + 1);
    triangle_offsets_.resize(n + 1);
    totals_.resize(1);
    backend_.vertex_limits(std::span<const std::uint32_t>(mesh_of_object_), std::span(meshes_), std::span(map_),
                           min_triangles, std::span(min_vertices_), std::span(max_vertices_));
    std::uint32_t most_vertices = 0;
    for (const Mesh& mesh : model.meshes) most_vertices = std::max(most_vertices, mesh.max_vertices);
    backend_.reserve(reform_workspace_, n, most_vertices);
    backend_.finish();
  }

  FrameTimes run(const View& view, BudgetOptions options) override {
    FrameTimes ms;
    Stopwatch watch;
    const auto lap = [&] {
      backend_.finish();
      return watch.lap();
    };

    backend_.cull_frustum(std::span(boxes_), view, std::span(in_view_));
    ms.cull = lap();

    if (occlusion_) cull_occluded(view, ms, lap);

    const std::span<std::uint8_t> visible(occlusion_ ? visible_ : in_view_);
    backend_.project(std::span(boxes_), visible, view, std::span(areas_), std::span(depths_));
    ms.project = lap();

    options.near_depth = view.near_depth;
    options.viewport_area = view.width * view.height;
    backend_.distribute_budget(std::span(areas_), std::span(depths_), std::span(min_vertices_),
                               std::span(max_vertices_), options, budget_workspace_, std::span(counts_),
                               totals_.data());
    backend_.lay_out(std::span(counts_), std::span(mesh_of_object_), std::span(meshes_), std::span(map_),
                     std::span(triangle_counts_), std::span(vertex_offsets_), std::span(triangle_offsets_));
    const auto [drawn, triangles] =
        backend_.fetch(totals_.data(), triangle_offsets_.data() + triangle_offsets_.size() - 1);
    drawn_ = drawn.objects;
    if (drawn.vertices > std::numeric_limits<std::uint32_t>::max()) {
      throw std::runtime_error("--budget: the frame has more vertices than 32-bit indices can tell apart: lower it");
    }
    ms.budget = lap();

    const auto [vertex_buffer, index_buffer] = backend_.begin_drawing(drawn.vertices, triangles);
    ms.upload = lap();

    backend_.reform(std::span(meshes_), std::span(objects_), std::span(triangles_), std::span(ecol_),
                    std::span(counts_), std::span(vertex_offsets_), std::span(triangle_offsets_), reform_workspace_,
                    index_buffer);
    ms.reform = lap();

    backend_.gather(std::span(meshes_), std::span(objects_), std::span(vertices_), std::span(counts_),
                    std::span(vertex_offsets_), vertex_buffer);
    ms.gather = lap();

    backend_.end_drawing();
    ms.upload += lap();
    return ms;
  }

  std::uint64_t objects_drawn() const override { return drawn_; }
  Selection selection() override {
    Selection selection;
    selection.counts = backend_.download(std::span(counts_));
    selection.in_view = backend_.download(std::span(in_view_));
    selection.visible = occlusion_ ? backend_.download(std::span(visible_)) : selection.in_view;
    for (const Array<std::uint32_t>* list : {&occluders_, &more_occluders_}) {
      std::ranges::copy(backend_.download(std::span(*list)), std::back_inserter(selection.occluders));
    }
    std::erase(selection.occluders, no_object);
    return selection;
  }
  BackendInfo info() const override { return backend_.info(); }

 private:
  /// Writes `visible_`: of the objects in view those that a few others, drawn into the depth at full detail, do not
  /// hide.
  ///
  /// Temporal: the first occluders are those among them that were visible in the frame before (at first, all), so that
  /// none is wasted on what is hidden itself; the second ones, those that the first do not hide, so that what came into
  /// view hides others too. All are drawn as this frame sees them: nothing visible is lost, whatever moved.
  void cull_occluded(const View& view, FrameTimes& ms, auto&& lap) {
    const DepthMap size = depth_map_of(view);
    hzm_.resize(hzm_texels(size));
    const std::span<Depth> hzm(hzm_), depth = hzm.first(std::size_t{size.width} * size.height);
    const std::span<std::uint8_t> in_view(in_view_), visible(visible_), choice(choice_);

    const auto draw = [&](std::span<const std::uint8_t> among, std::span<std::uint32_t> occluders) {
      backend_.select_occluders(std::span(candidates_), std::span(faces_), among, view, occluder_workspace_, occluders);
      ms.occluders += lap();
      backend_.rasterize_depth(std::span(meshes_), std::span(objects_), std::span(vertices_), std::span(triangles_),
                               std::span(map_), occluders, view, size, depth_workspace_, depth);
      ms.depth += lap();
      backend_.build_hzm(size, hzm);
      ms.hzm += lap();
    };
    // An occluder that another hides may go: at every pixel the nearest of all stays, since nothing is before it.
    const auto cull = [&] {
      backend_.cull_occluded(std::span(boxes_), in_view, std::span<const std::uint32_t>(), view, size, hzm, refinement_,
                             visible);
      ms.occlusion += lap();
    };

    backend_.clear(depth);
    if (temporal_) backend_.keep_flagged(in_view, visible, std::span<const std::uint32_t>(), choice);
    draw(temporal_ ? choice : in_view, std::span(occluders_));
    cull();
    if (!temporal_) return;
    backend_.keep_flagged(visible, std::span<const std::uint8_t>(), std::span(occluders_), choice);
    draw(choice, std::span(more_occluders_));
    cull();
  }

  /// The objects that may hide others: those at least so compact, in the order in which their faces are read.
  static std::vector<std::uint32_t> candidates(const scene::Model<Index>& model, float compactness) {
    std::vector<std::uint32_t> objects = model.compactness_order;
    objects.resize(host::compact_objects(model.faces, objects, compactness));
    std::ranges::sort(objects);
    return objects;
  }

  static std::vector<std::uint32_t> mesh_numbers(const std::vector<Object>& objects) {
    std::vector<std::uint32_t> numbers(objects.size());
    std::ranges::transform(objects, numbers.begin(), &Object::mesh);
    return numbers;
  }

  Backend backend_;
  const bool occlusion_;
  const bool temporal_;
  const std::uint32_t refinement_;
  const Input<Mesh> meshes_;
  const Input<Object> objects_;
  const Input<glm::vec3> vertices_;
  const Input<Triangle<Index>> triangles_;
  const Input<Index> ecol_;
  const Input<std::uint32_t> map_;
  const Input<Box> boxes_;
  const Input<OccluderFace> faces_;
  Array<std::uint32_t> candidates_;
  Array<std::uint32_t> occluders_, more_occluders_;
  Array<std::uint8_t> visible_, choice_;
  Array<Depth> hzm_;
  Array<std::uint32_t> mesh_of_object_, min_vertices_, max_vertices_, counts_, triangle_counts_;
  Array<std::uint8_t> in_view_;
  Array<float> areas_, depths_;
  Array<std::uint64_t> vertex_offsets_, triangle_offsets_;
  Array<BudgetTotals> totals_;
  std::uint64_t drawn_ = 0;
  typename Backend::OccluderWorkspace occluder_workspace_;
  typename Backend::DepthWorkspace depth_workspace_;
  typename Backend::BudgetWorkspace budget_workspace_;
  typename Backend::template ReformWorkspace<Index> reform_workspace_;
};

}  // namespace pgl::viewer
