// SPDX-License-Identifier: MIT
// The way from a camera to the triangles to draw, written once for every backend.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "pgl/balance.hpp"
#include "pgl/build_hzm.hpp"
#include "pgl/depth.hpp"
#include "pgl/distribute_budget.hpp"
#include "pgl/gather.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/select_occluders.hpp"
#include "pgl/limit_transfer.hpp"
#include "pgl/pack_delta.hpp"
#include "pgl/project.hpp"
#include "pgl/select_by_error.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"
#include "pgl/unify.hpp"
#include "scene/model_view.hpp"
#include "viewer/buffers.hpp"
#include "viewer/occlusion.hpp"
#include "viewer/ranks.hpp"
#include "viewer/streaming.hpp"
#include "viewer/tiling.hpp"

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

/// What each step of a frame took, in milliseconds. Budget: choosing the counts, by whatever rule. Balance: the tiles
/// and who is in them. Unify: telling the other ranks what fits and what was chosen, and waiting for them. Load:
/// checking, and so reading, what the frame needs of a mapped file. Upload: handing the buffers over, to OpenGL and
/// back.
struct FrameTimes {
  double cull = 0.0, occluders = 0.0, depth = 0.0, hzm = 0.0, occlusion = 0.0;
  double project = 0.0, budget = 0.0, balance = 0.0, unify = 0.0, load = 0.0, limit = 0.0, send = 0.0;
  double defragment = 0.0;
  double reform = 0.0, gather = 0.0, upload = 0.0;
};

/// What a frame chose, by object; of several ranks, all of them together.
struct Selection {
  std::vector<std::uint32_t> counts;     ///< vertices drawn
  std::vector<std::uint8_t> in_view;     ///< 1: may be in the frustum
  std::vector<std::uint8_t> visible;     ///< 1: that, and not known to be hidden
  std::vector<std::uint32_t> occluders;  ///< objects that were drawn into the depth
};

/// What prepares the frames.
struct BackendInfo {
  std::string name;      ///< host, cuda
  std::string gpu;       ///< the device's name and its place on the PCI bus, empty on the host
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

  /// Selects and builds what to draw of the model from `view` as the request says, into the DrawBuffers: of several
  /// ranks, what touches this one's tile. Throws std::runtime_error where 32-bit indices do not suffice, memory runs
  /// out or a device fails; what load() throws goes through, and what Ranks throws.
  virtual FrameTimes run(const View& view, FrameRequest request) = 0;

  /// Of the last frame.
  virtual Selection selection() = 0;
  virtual const std::vector<Tile>& tiles() const = 0;  ///< by rank; nothing where there is one
  virtual Sent sent() const = 0;                       ///< nothing where nothing is streamed
  virtual MemoryPlan memory() const = 0;               ///< as planned by the first frame

  virtual bool streams() const = 0;  ///< sends what frames need of the model: where it does not fit, or was told to
  virtual BackendInfo info() const = 0;
};

/// Where a model is and how much of it may be used: one in a mapped file is checked before it is read.
template <class Index>
struct FrameModel {
  scene::ModelView<Index> view;
  // What is called before the arrays are read, or nothing. counts: vertices, for each object.
  std::function<void(std::span<const std::uint32_t> counts)> load;       ///< all that drawing these reads
  std::function<void(std::span<const std::uint32_t> counts)> load_maps;  ///< the maps of objects with any
  std::function<void()> load_tables;                                     ///< all of map and ecol
  std::function<void()> load_errors;                                     ///< all errors
};

/// What a frame is made with.
struct FrameOptions {
  std::uint64_t budget = 0;         ///< vertices that frames will draw, about: whether the model fits depends on it
  std::uint32_t min_triangles = 0;  ///< a drawn object keeps at least so many, or all that it has
  OcclusionOptions occlusion;
  StreamOptions stream;
  LodMode lod = LodMode::budget;
  bool own_limits = false;  ///< several ranks: the request's budget or threshold is for this rank's tile alone
  TileOptions tiles;
  Ranks* ranks = nullptr;  ///< who draws the picture too; must outlive the frame
};

/// One model under a moving camera. Memory is kept from frame to frame and only grows.
///
/// Streamed, the backend's memory has the tables of the model but neither its vertices nor its triangles: each frame
/// sends those that the last one did not have (host::BlockStream, cuda::BlockStream), within StreamOptions::transfer
/// (limit_transfer). What is drawn is the same, byte for byte, but where a limit cuts the selection down: to a
/// transfer, or to what gpu_memory has room for.
///
/// Several ranks choose the same counts for all objects, each by itself, since they all have the same input and the
/// steps the same bits; so they agree on the tiles too, and each goes on with the objects of its own. Only where each
/// has its own limits (own_limits, a transfer) do they tell each other their counts, and of an object in several tiles
/// all draw the smallest (unify, UnifyPolicy::performance). If one streams, all must: it has other occluders then, and
/// tells the others what it sends.
///
/// Backend is a class that has
/// - Input<T>: an array of the model as the steps read it, made from a std::span<const T> whose elements outlive it;
/// - Array<T>: working memory, made empty or from a std::vector<T>, with resize();
/// - the steps, under the names and with the arguments of pgl::host; distribute_budget has at its end where the totals
///   go, in such an array;
/// - BudgetWorkspace, ReformWorkspace<Index>, OccluderWorkspace, DepthWorkspace, TransferWorkspace, BalanceWorkspace:
///   their scratch;
/// - BlockStream<Index>, and reserve, begin, send, apply: its functions, with it as the first argument;
/// - copies: whether an Input is a copy; memory_used(), memory_free(): bytes, as far as it knows;
/// prepare_drawing(vertices, triangles): makes exactly so much room;
/// - reserve(ReformWorkspace, objects, vertices of the largest mesh);
/// - clear(depths): makes them all far_depth;
/// - finish(): waits until the results are there;
/// - fetch(pointers to elements...): their values, as a tuple; download(span): its elements, as a vector;
/// upload(values,
///   span): the other way;
/// - begin_drawing(vertices, triangles): where reform and gather write, as spans; end_drawing(): shows it to OpenGL;
/// - info().
template <class Backend, class Index>
class Frame final : public AnyFrame {
 public:
  template <class T>
  using Array = typename Backend::template Array<T>;
  template <class T>
  using Input = typename Backend::template Input<T>;

  /// What the model views and what the backend is made of must outlive the frame. Throws std::runtime_error where the
  /// model does not fit and may not be streamed.
  Frame(const FrameModel<Index>& model, const FrameOptions& options, auto&&... backend)
      : Frame(model, options, wants_stream(model.view, options), backend...) {}

  FrameTimes run(const View& view, FrameRequest request) override {
    FrameTimes ms;
    Stopwatch watch;
    const auto lap = [&] {
      if (!options_.overlap) backend_.finish();
      return watch.lap();
    };

    backend_.cull_frustum(std::span(boxes_), view, std::span(in_view_));
    ms.cull = lap();

    if (occlusion_) cull_occluded(view, ms, lap);

    const std::span<std::uint8_t> visible(occlusion_ ? visible_ : in_view_);
    backend_.project(std::span(boxes_), visible, view, std::span(areas_), std::span(depths_), std::span(rectangles_));
    ms.project = lap();

    BudgetOptions& options = request.distribution;
    options.near_depth = view.near_depth;
    options.viewport_area = view.width * view.height;
    if (stream_) {
      if (!memory_.streams || std::min(options.budget, all_.vertices) > planned_) plan(view, request);
      if (!shared_ && memory_.vertices < planned_) options.budget = std::min(options.budget, memory_.vertices);
    }
    Size drawn = choose(view, request, ms, lap);
    // More than two triangles a vertex, or more vertices than the budget, which BudgetPolicy::paper allows; or more of
    // the picture than this rank's share.
    while (stream_) {
      const bool fits = drawn.vertices <= memory_.vertices && drawn.triangles <= memory_.triangles;
      if (!memory_.limit && !fits) make_more_room(drawn);
      if (!memory_.limit) break;
      const bool all_fit = all_agree(fits);
      if (!all_fit) ask_for_less(request, fits, drawn);
      if (shared_) ms.unify += lap();
      if (all_fit) break;
      drawn = choose(view, request, ms, lap);
    }
    if (stream_) drawn = send(options, drawn, ms, lap);
    if (drawn.vertices > std::numeric_limits<std::uint32_t>::max()) {
      throw std::runtime_error("--budget: the frame has more vertices than 32-bit indices can tell apart: lower it");
    }

    const auto [vertex_buffer, index_buffer] = backend_.begin_drawing(drawn.vertices, drawn.triangles);
    ms.upload = lap();
    if (stream_) {
      backend_.reform_block(std::span(meshes_), std::span(objects_), stream_->triangles(), std::span(ecol_),
                            stream_->counts(), stream_->vertex_offsets(), stream_->triangle_offsets(),
                            reform_workspace_, index_buffer);
    } else {
      backend_.reform(std::span(meshes_), std::span(objects_), std::span(triangles_), std::span(ecol_),
                      std::span(own_counts()), std::span(vertex_offsets_), std::span(triangle_offsets_),
                      reform_workspace_, index_buffer);
    }
    ms.reform = lap();
    if (stream_) {
      backend_.gather_block(std::span(objects_), stream_->vertices(), stream_->vertex_offsets(), vertex_buffer);
    } else {
      backend_.gather(std::span(meshes_), std::span(objects_), std::span(vertices_), std::span(own_counts()),
                      std::span(vertex_offsets_), vertex_buffer);
    }
    ms.gather = lap();

    backend_.end_drawing();
    ms.upload += lap();
    if (shared_ && !fixed_tiles()) tile_list_ = backend_.download(std::span(tiles_));
    return ms;
  }

  Selection selection() override {
    backend_.finish();
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
  const std::vector<Tile>& tiles() const override { return tile_list_; }
  Sent sent() const override { return sent_; }
  MemoryPlan memory() const override { return memory_; }
  bool streams() const override { return stream_.has_value(); }
  BackendInfo info() const override { return backend_.info(); }

 private:
  struct Size {
    std::uint64_t vertices = 0, triangles = 0;
  };

  Frame(const FrameModel<Index>& model, const FrameOptions& options, bool streams, auto&&... backend)
      : backend_(backend...),
        model_(loaded(model, streams)),
        options_(options.stream),
        tiling_(options.tiles),
        ranks_(options.ranks),
        shared_(options.ranks != nullptr && options.ranks->size() > 1),
        own_limits_(shared_ && options.own_limits),
        by_error_(options.lod == LodMode::error),
        all_(size_of(model.view)),
        occlusion_(options.occlusion.mode != OcclusionMode::off),
        temporal_(options.occlusion.mode == OcclusionMode::temporal),
        refinement_(options.occlusion.refinement),
        chosen_(streams && occlusion_ ? choose_occluders(model, options) : OccluderMeshes<Index>()),
        meshes_(model.view.meshes),
        objects_(model.view.objects),
        vertices_(streams ? std::span<const glm::vec3>() : model.view.vertices),
        triangles_(streams ? std::span<const Triangle<Index>>() : model.view.triangles),
        ecol_(model.view.ecol),
        map_(model.view.map),
        boxes_(model.view.object_boxes),
        faces_(model.view.faces),
        errors_(by_error_ ? checked_errors(model) : std::span<const float>()),
        occluder_meshes_(std::span<const Mesh>(chosen_.meshes)),
        occluder_vertices_(std::span<const glm::vec3>(chosen_.vertices)),
        occluder_triangles_(std::span<const Triangle<Index>>(chosen_.triangles)),
        occluder_map_(std::span<const std::uint32_t>(chosen_.map)),
        mesh_of_object_(mesh_numbers(model.view.objects)) {
    const std::size_t n = model.view.objects.size();
    for (auto* counts : {&min_vertices_, &max_vertices_, &counts_, &triangle_counts_}) counts->resize(n);
    in_view_.resize(n);
    if (occlusion_) {
      const std::vector<std::uint32_t> candidates =
          streams ? chosen_.candidates : all_candidates(model.view, options.occlusion.compactness);
      candidates_ = Array<std::uint32_t>(candidates);
      visible_.resize(n);
      occluders_.resize(std::min(options.occlusion.aos, candidates_.size()));
      if (temporal_) {
        choice_ = Array<std::uint8_t>(std::vector<std::uint8_t>(n, 1));
        visible_ = Array<std::uint8_t>(std::vector<std::uint8_t>(n, 1));
        more_occluders_.resize(occluders_.size());
      }
    }
    areas_.resize(n);
    depths_.resize(n);
    if (by_error_) {
      scales_.resize(n);
      backend_.error_scales(std::span(objects_), std::span(scales_));
    }
    if (shared_) {
      const auto ranks = static_cast<std::size_t>(ranks_->size());
      rectangles_.resize(n);
      in_tile_.resize(n);
      own_counts_.resize(n);
      loads_ = Array<std::uint32_t>(std::vector<std::uint32_t>(n, 1));
      tiles_.resize(ranks);
      tile_loads_.resize(ranks);
    }
    vertex_offsets_.resize(n + 1);
    triangle_offsets_.resize(n + 1);
    totals_.resize(1);
    transfer_totals_.resize(1);
    backend_.vertex_limits(std::span<const std::uint32_t>(mesh_of_object_), std::span(meshes_), std::span(map_),
                           options.min_triangles, std::span(min_vertices_), std::span(max_vertices_));
    std::uint32_t most_vertices = 0;
    for (const Mesh& mesh : model.view.meshes) most_vertices = std::max(most_vertices, mesh.max_vertices);
    backend_.reserve(reform_workspace_, n, most_vertices);
    if (streams) stream_.emplace();
    backend_.finish();
  }

  /// Whether the model is sent as it is needed: where asked to, or where it does not fit.
  static bool wants_stream(const scene::ModelView<Index>& model, const FrameOptions& options) {
    if (options.stream.mode == StreamMode::always) return true;
    const std::optional<std::uint64_t> room =
        options.stream.gpu_memory ? options.stream.gpu_memory : Backend::memory_free();
    if (!room) return false;
    const ModelSize size = size_of(model);
    const std::uint64_t drawn = std::min(options.budget, size.vertices);
    const std::uint64_t all = tables_bytes(model) + model.vertices.size_bytes() + model.triangles.size_bytes() +
                              drawn * sizeof(PlacedVertex) +
                              std::min(2 * drawn, size.triangles) * sizeof(Triangle<std::uint32_t>);
    if (all <= *room) return false;
    if (options.stream.mode == StreamMode::never && options.stream.gpu_memory) {
      throw std::runtime_error("--gpu-memory: without streaming this model takes " + std::to_string(all >> 20) +
                               " MiB there");
    }
    return options.stream.mode == StreamMode::automatic;
  }

  /// What is in the backend's memory of every model, and the working memory that goes with it.
  static std::uint64_t tables_bytes(const scene::ModelView<Index>& model) {
    constexpr std::uint64_t working =
        7 * sizeof(std::uint32_t) + 4 + 3 * sizeof(float) + 2 * sizeof(std::uint64_t) + sizeof(ScreenBox);
    return model.meshes.size_bytes() + model.objects.size_bytes() + model.ecol.size_bytes() + model.map.size_bytes() +
           model.object_boxes.size_bytes() + model.faces.size_bytes() + model.objects.size() * working;
  }
  /// For each object, what streaming takes beside that: BlockStream's selections and limit_transfer's scratch.
  static constexpr std::uint64_t streamed_object_bytes = 192;

  /// The model, with that of it checked which the backend is about to copy.
  static FrameModel<Index> loaded(FrameModel<Index> model, bool streams) {
    if (!Backend::copies || !model.load) return model;
    if (streams) {
      model.load_tables();
      model.load_maps = nullptr;
      return model;
    }
    std::vector<std::uint32_t> counts(model.view.objects.size());
    std::ranges::transform(model.view.objects, counts.begin(),
                           [&](const Object& object) { return model.view.meshes[object.mesh].max_vertices; });
    model.load_tables();
    model.load(counts);
    model.load = model.load_maps = nullptr;
    return model;
  }

  /// Chooses the counts, of several ranks those in the own tile too, and lays the frame out: counts_, own_counts() and
  /// the offsets. alone: without the others, whatever they choose.
  Size choose(const View& view, const FrameRequest& request, FrameTimes& ms, auto&& lap, bool alone = false) {
    if (own_limits_) {
      cut_tiles(view, request);
      ms.balance += lap();
      backend_.project(std::span(boxes_), std::span<const std::uint8_t>(in_tile_), view, std::span(areas_),
                       std::span(depths_), std::span<ScreenBox>());
      ms.project += lap();
    }
    if (by_error_) {
      backend_.select_by_error(std::span(areas_), std::span(depths_), std::span(min_vertices_),
                               std::span(max_vertices_), std::span(scales_), std::span(mesh_of_object_),
                               std::span(meshes_), std::span(errors_), view,
                               ErrorOptions{.threshold = request.threshold, .pet = request.distribution.pet},
                               std::span(counts_), totals_.data());
    } else {
      backend_.distribute_budget(std::span(areas_), std::span(depths_), std::span(min_vertices_),
                                 std::span(max_vertices_), request.distribution, budget_workspace_, std::span(counts_),
                                 totals_.data());
    }
    ms.budget += lap();
    if (own_limits_ && !alone) {
      unify(counts_);
      ms.unify += lap();
    }
    if (shared_) {
      if (!fixed_tiles() && !(own_limits_ && alone)) {
        if (model_.load_maps) {
          model_.load_maps(backend_.download(std::span(counts_)));
          ms.load += lap();
        }
        lay_out(counts_, loads_);
      }
      if (!own_limits_) cut_tiles(view, request);
      backend_.take_unified(std::span(counts_), std::span(in_tile_), std::span(counts_), std::span(own_counts_),
                            totals_.data());
      ms.balance += lap();
    }
    if (const auto& load = stream_ && options_.transfer ? model_.load_maps : model_.load; load) {
      load(backend_.download(std::span(own_counts())));
      ms.load += lap();
    }
    const Size size = lay_out();
    ms.budget += lap();
    return size;
  }

  /// What this rank draws of the selection.
  Array<std::uint32_t>& own_counts() { return shared_ ? own_counts_ : counts_; }

  bool fixed_tiles() const { return tiling_.mode == TileMode::equal || tiling_.mode == TileMode::wall; }

  /// Cuts the picture into the ranks' tiles, and finds who may touch the own one: with own limits by what the frame
  /// before drew, which may be nothing of what is to be seen now.
  void cut_tiles(const View& view, const FrameRequest& request) {
    const auto width = static_cast<std::uint32_t>(view.width), height = static_cast<std::uint32_t>(view.height);
    const auto ranks = static_cast<std::uint32_t>(ranks_->size());
    std::span<const std::uint32_t> loads(loads_);
    if (!fixed_tiles()) {
      backend_.balance(std::span(rectangles_), loads, width, height, std::span(request.weights).first(ranks),
                       tiling_.balance, balance_workspace_, std::span(tiles_), std::span(tile_loads_));
    } else if (tile_list_.empty() || tiled_width_ != width || tiled_height_ != height) {
      tile_list_ = tiling_.mode == TileMode::wall ? wall_tiles(tiling_.columns, tiling_.rows, width, height)
                                                  : equal_tiles(ranks, width, height);
      tiles_ = Array<Tile>(tile_list_);
      tiled_width_ = width;
      tiled_height_ = height;
    }
    if (own_limits_ || fixed_tiles()) loads = {};
    backend_.in_tile(std::span(rectangles_), loads, tiles_.data() + ranks_->rank(), std::span(in_tile_));
  }

  /// Gives counts_ the smallest count of each object that a rank has whose tile it touches: 0 where none does.
  void unify(const Array<std::uint32_t>& own) {
    constexpr UnifyPolicy policy = UnifyPolicy::performance;
    std::vector<std::uint32_t> keys = backend_.download(std::span(own));
    const std::vector<std::uint8_t> touches = backend_.download(std::span(in_tile_));
    host::parallel_for(keys.size(), 4096,
                       [&](std::size_t i) { keys[i] = unify_key(keys[i], touches[i] != 0, policy); });
    ranks_->combine(keys, Ranks::Combine::least);
    host::parallel_for(keys.size(), 4096, [&](std::size_t i) { keys[i] = unified_vertices(keys[i]); });
    backend_.upload(std::span<const std::uint32_t>(keys), std::span(counts_));
  }

  /// Whether all ranks say so.
  bool all_agree(bool here) const { return shared_ ? ranks_->least(here ? 1 : 0) == 1 : here; }

  /// Lowers what is asked for, as far as the rank needs that has least room; with own limits, only here.
  void ask_for_less(FrameRequest& request, bool fits, const Size& drawn) const {
    if (by_error_) {
      if (fits && own_limits_) return;
      if (!(request.threshold < 1e6f)) {
        throw std::runtime_error("--gpu-memory: even at the coarsest there is no room for what is in view");
      }
      request.threshold = std::max(1.5f * request.threshold, 0.25f);
      return;
    }
    std::uint64_t& budget = request.distribution.budget;
    const std::uint64_t less = fits ? budget : fewer(budget, drawn);
    budget = shared_ && !own_limits_ ? ranks_->least(less) : less;
  }

  void lay_out(Array<std::uint32_t>& counts, Array<std::uint32_t>& triangle_counts) {
    backend_.lay_out(std::span(counts), std::span(mesh_of_object_), std::span(meshes_), std::span(map_),
                     std::span(triangle_counts), std::span(vertex_offsets_), std::span(triangle_offsets_));
  }

  Size lay_out() {
    lay_out(own_counts(), triangle_counts_);
    const auto [vertices, triangles] = backend_.fetch(vertex_offsets_.data() + vertex_offsets_.size() - 1,
                                                      triangle_offsets_.data() + triangle_offsets_.size() - 1);
    return {vertices, triangles};
  }

  /// Brings the blocks up to the selection, or as far as the transfer allows; then the selection is what they have.
  Size send(const BudgetOptions& options, Size wanted, FrameTimes& ms, auto&& lap) {
    sent_ = {};
    Size size = wanted;
    if (options_.transfer) {
      const TransferOptions transfer{
          .cap = *options_.transfer, .vertex_bytes = sizeof(glm::vec3), .triangle_bytes = sizeof(Triangle<Index>)};
      Array<std::uint32_t>& counts = own_counts();
      backend_.limit_transfer(std::span(areas_), std::span(depths_), std::span(min_vertices_), std::span(max_vertices_),
                              options, std::span(counts), stream_->counts(), std::span(mesh_of_object_),
                              std::span(meshes_), std::span(map_), transfer, transfer_workspace_, std::span(counts),
                              transfer_totals_.data());
      const auto [totals] = backend_.fetch(transfer_totals_.data());
      sent_.missing_bytes = totals.missing_bytes;
      ms.limit = lap();
      if (shared_) {
        unify(counts);
        backend_.take_unified(std::span(counts), std::span(in_tile_), std::span(counts_), std::span(counts),
                              totals_.data());
        ms.unify += lap();
      }
      if (model_.load) model_.load(backend_.download(std::span(counts)));
      ms.load += lap();
      size = lay_out();
      ms.limit += lap();
    }
    backend_.begin(*stream_, std::span(own_counts()), std::span(vertex_offsets_), std::span(triangle_offsets_));
    const DeltaSize delta =
        backend_.send(*stream_, model_.view.meshes, model_.view.objects, model_.view.vertices, model_.view.triangles);
    sent_.vertices = delta.vertices;
    sent_.triangles = delta.triangles;
    sent_.bytes = delta.bytes;
    ms.send = lap();
    backend_.apply(*stream_);
    ms.defragment = lap();
    return size;
  }

  /// Plans the memory for a budget, once everything else has been taken: by the steps of a frame that draws nothing.
  void plan(const View& view, FrameRequest request) {
    const std::uint64_t budget = request.distribution.budget;
    // A budget that follows the time of frames rises often, and each time all is sent again: half as much more at once.
    const std::uint64_t more = memory_.streams && !options_.gpu_memory ? budget / 2 : 0;
    planned_ = std::min(budget + more, all_.vertices);
    if (!memory_.streams) {
      request.distribution.budget = 0;
      FrameTimes ms;
      choose(
          view, request, ms, [] { return 0.0; }, true);
      backend_.finish();
      const std::uint64_t n = model_.view.objects.size();
      memory_.resident =
          std::max(tables_bytes(model_.view) + hzm_.size() * sizeof(Depth) + occluder_bytes(), backend_.memory_used()) +
          n * streamed_object_bytes;
    }
    // Of several ranks each has about its part of the picture, and more as it needs more.
    const std::uint64_t room = shared_ && !options_.gpu_memory && !own_limits_
                                   ? planned_ / static_cast<std::uint64_t>(ranks_->size()) / 2 * 3
                                   : planned_;
    memory_ = plan_memory(options_, all_, memory_.resident, room, sizeof(glm::vec3), sizeof(Triangle<Index>));
    make_blocks();
  }

  std::uint64_t occluder_bytes() const {
    return chosen_.meshes.size() * sizeof(Mesh) + chosen_.vertices.size() * sizeof(glm::vec3) +
           chosen_.triangles.size() * sizeof(Triangle<Index>) + chosen_.map.size() * sizeof(std::uint32_t);
  }

  /// The next frame begins with empty blocks. What there was goes first, so that exactly what is planned is taken.
  void make_blocks() {
    backend_.finish();
    stream_.emplace();
    backend_.reserve(*stream_, model_.view.objects.size(), memory_.vertices, memory_.triangles,
                     memory_.limit ? memory_.additional : 0);
    backend_.prepare_drawing(memory_.vertices, memory_.triangles);
  }

  /// Makes room for a frame that is larger than planned; where it grows, half as much again, so that this is rare.
  void make_more_room(const Size& drawn) {
    const auto grown = [](std::uint64_t room, std::uint64_t wanted, std::uint64_t all) {
      return wanted <= room ? room : std::min(all, std::max(wanted, room + room / 2));
    };
    plan_room(options_, grown(memory_.vertices, drawn.vertices, all_.vertices),
              grown(memory_.triangles, drawn.triangles, all_.triangles), sizeof(glm::vec3), sizeof(Triangle<Index>),
              memory_);
    make_blocks();
  }

  /// A smaller budget, in proportion to the vertices and triangles that there is room for.
  std::uint64_t fewer(std::uint64_t budget, const Size& drawn) const {
    const auto share = [](std::uint64_t room, std::uint64_t wanted) {
      return wanted <= room ? 1.0 : static_cast<double>(room) / static_cast<double>(wanted);
    };
    const double part = std::min(share(memory_.vertices, drawn.vertices), share(memory_.triangles, drawn.triangles));
    return std::min(budget - 1,
                    static_cast<std::uint64_t>(static_cast<double>(std::min(budget, all_.vertices)) * part));
  }

  static OccluderMeshes<Index> choose_occluders(const FrameModel<Index>& model, const FrameOptions& options) {
    const std::uint64_t bytes = options.stream.gpu_memory ? *options.stream.gpu_memory / 8 : std::uint64_t{256} << 20;
    return viewer::choose_occluders(model.view, all_candidates(model.view, options.occlusion.compactness), bytes,
                                    [&](std::span<const std::uint32_t> counts) {
                                      if (model.load) model.load(counts);
                                    });
  }

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
      if (stream_) {
        backend_.rasterize_depth(std::span(occluder_meshes_), std::span(objects_), std::span(occluder_vertices_),
                                 std::span(occluder_triangles_), std::span(occluder_map_), occluders, view, size,
                                 depth_workspace_, depth);
      } else {
        if (model_.load) load_occluders(occluders);
        backend_.rasterize_depth(std::span(meshes_), std::span(objects_), std::span(vertices_), std::span(triangles_),
                                 std::span(map_), occluders, view, size, depth_workspace_, depth);
      }
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

  /// The errors of all meshes. Throws std::runtime_error where the model has none.
  static std::span<const float> checked_errors(const FrameModel<Index>& model) {
    if (model.view.errors.size() != model.view.map.size()) {
      throw std::runtime_error("--lod: this model has no errors: make it with pgl_preprocess --errors");
    }
    if (model.load_errors) model.load_errors();
    return model.view.errors;
  }

  /// The objects that may hide others: those at least so compact, in the order in which their faces are read.
  static std::vector<std::uint32_t> all_candidates(const scene::ModelView<Index>& model, float compactness) {
    std::vector<std::uint32_t> objects(model.compactness_order.begin(), model.compactness_order.end());
    objects.resize(host::compact_objects(model.faces, objects, compactness));
    std::ranges::sort(objects);
    return objects;
  }

  /// Occluders are drawn at full detail.
  void load_occluders(std::span<const std::uint32_t> occluders) {
    std::vector<std::uint32_t> counts(model_.view.objects.size(), 0);
    for (const std::uint32_t i : backend_.download(occluders)) {
      if (i != no_object) counts[i] = model_.view.meshes[model_.view.objects[i].mesh].max_vertices;
    }
    model_.load(counts);
  }

  static std::vector<std::uint32_t> mesh_numbers(std::span<const Object> objects) {
    std::vector<std::uint32_t> numbers(objects.size());
    std::ranges::transform(objects, numbers.begin(), &Object::mesh);
    return numbers;
  }

  Backend backend_;
  const FrameModel<Index> model_;
  const StreamOptions options_;
  const TileOptions tiling_;
  Ranks* const ranks_;
  const bool shared_;      // several ranks draw the picture
  const bool own_limits_;  // and each has a budget or a threshold of its own
  const bool by_error_;
  const ModelSize all_;
  const bool occlusion_;
  const bool temporal_;
  const std::uint32_t refinement_;
  const OccluderMeshes<Index> chosen_;  // streamed: what is drawn into the depth
  const Input<Mesh> meshes_;
  const Input<Object> objects_;
  const Input<glm::vec3> vertices_;
  const Input<Triangle<Index>> triangles_;
  const Input<Index> ecol_;
  const Input<std::uint32_t> map_;
  const Input<Box> boxes_;
  const Input<OccluderFace> faces_;
  const Input<float> errors_;
  const Input<Mesh> occluder_meshes_;
  const Input<glm::vec3> occluder_vertices_;
  const Input<Triangle<Index>> occluder_triangles_;
  const Input<std::uint32_t> occluder_map_;
  Array<std::uint32_t> candidates_;
  Array<std::uint32_t> occluders_, more_occluders_;
  Array<std::uint8_t> visible_, choice_;
  Array<Depth> hzm_;
  Array<std::uint32_t> mesh_of_object_, min_vertices_, max_vertices_, counts_, triangle_counts_;
  Array<std::uint8_t> in_view_;
  Array<float> areas_, depths_;
  Array<std::uint64_t> vertex_offsets_, triangle_offsets_;
  Array<BudgetTotals> totals_;
  Array<TransferTotals> transfer_totals_;
  Array<float> scales_;
  Array<ScreenBox> rectangles_;
  Array<std::uint8_t> in_tile_;
  Array<std::uint32_t> own_counts_, loads_;  // loads: triangles of all objects, whoever draws them
  Array<Tile> tiles_;
  Array<std::uint64_t> tile_loads_;
  std::vector<Tile> tile_list_;
  std::uint32_t tiled_width_ = 0, tiled_height_ = 0;  // what fixed tiles are for
  std::optional<typename Backend::template BlockStream<Index>> stream_;
  MemoryPlan memory_;
  std::uint64_t planned_ = 0;  // the budget that memory_ is for
  Sent sent_;
  typename Backend::OccluderWorkspace occluder_workspace_;
  typename Backend::DepthWorkspace depth_workspace_;
  typename Backend::BudgetWorkspace budget_workspace_;
  typename Backend::TransferWorkspace transfer_workspace_;
  typename Backend::BalanceWorkspace balance_workspace_;
  typename Backend::template ReformWorkspace<Index> reform_workspace_;
};

}  // namespace pgl::viewer
