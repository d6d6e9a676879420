// SPDX-License-Identifier: MIT
// pgl_viewer: a model, a camera and a vertex budget go in; a picture comes out, in a window or in a file. Under mpirun,
// several processes draw it together.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <iterator>
#include <memory>
#include <new>
#include <numeric>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#if defined(_OPENMP)
#include <omp.h>
#endif

#include "pgl/host/parallel.hpp"
#include "scene/build_model.hpp"
#include "scene/build_plant.hpp"
#include "scene/error.hpp"
#include "scene/import.hpp"
#include "scene/model_file.hpp"
#include "scene/model_view.hpp"
#include "scene/plant.hpp"
#include "scene/progress_line.hpp"
#include "scene/tell.hpp"
#include "scene/up_axis.hpp"
#include "viewer/camera.hpp"
#include "viewer/context.hpp"
#include "viewer/cuda_frame.hpp"
#include "viewer/frame.hpp"
#include "viewer/host_backend.hpp"
#include "viewer/options.hpp"
#include "viewer/output.hpp"
#include "viewer/pace.hpp"
#include "viewer/picture_exchange.hpp"
#include "viewer/prefetcher.hpp"
#include "viewer/ranks.hpp"
#include "viewer/reference.hpp"
#include "viewer/renderer.hpp"
#include "viewer/report.hpp"
#include "viewer/tiling.hpp"
#include "viewer/window.hpp"

namespace pgl::viewer {

namespace {

/// What went wrong in some rank, on rank 0: all have heard of it and leave.
struct Agreed : std::runtime_error {
  Agreed(const char* why, int exit_code) : std::runtime_error(why), code(exit_code) {}
  int code;
};

/// Does what may go wrong in some ranks only: then it does in all. What `work` throws where there is one rank goes
/// through; else rank 0 throws Agreed, and the others EndedElsewhere.
void together(Ranks& ranks, const std::function<void()>& work) {
  if (ranks.size() == 1) return work();
  std::string failure;
  int code = 0;
  const auto fails = [&](const char* why, int with) {
    failure = why;
    code = with;
  };
  try {
    work();
  } catch (const EndedElsewhere&) {
    throw;
  } catch (const NoContext& error) {
    fails(error.what(), 3);
  } catch (const std::bad_alloc&) {
    fails("not enough memory", 1);
  } catch (const std::exception& error) {
    fails(error.what(), 1);
  }
  const std::vector<int> codes = ranks.gather(code);
  try {
    ranks.agree(failure);
  } catch (const EndedElsewhere&) {
    throw;
  } catch (const std::runtime_error& error) {
    throw Agreed(error.what(), *std::ranges::find_if(codes, [](int one) { return one != 0; }));
  }
}

/// Tells what the person should know, once.
void note(const Ranks& ranks, const std::string& text) {
  if (ranks.rank() == 0 && !text.empty()) scene::tell("pgl_viewer", text);
}

/// The model files as one scene.
scene::Scene import_files(const Options& options, const Ranks& ranks, const scene::Progress& progress) {
  scene::Scene all;
  for (const std::string& file : options.files) {
    scene::ImportReport report;
    scene::Scene part = scene::import_scene(file, options.import, progress, &report);
    for (const std::string& warning : report.warnings) note(ranks, warning);
    const auto first_mesh = static_cast<std::uint32_t>(all.meshes.size());
    for (Object& object : part.objects) object.mesh += first_mesh;
    std::ranges::move(part.meshes, std::back_inserter(all.meshes));
    std::ranges::move(part.objects, std::back_inserter(all.objects));
  }
  return all;
}

/// Where the camera starts: as told, else at the overview that the plant comes with, else with the whole model in view.
/// Up is what was asked for, or what the file says.
Camera first_camera(const Options& options, scene::UpAxis of_file, const Box& box) {
  Camera camera;
  if (options.files.empty()) {
    const scene::PlantCamera plant = scene::plant_camera(options.plant);
    camera = {plant.position, plant.target, plant.up, glm::degrees(double{plant.vertical_fov})};
  }
  const scene::UpAxis up = options.up == scene::UpAxis::not_told ? of_file : options.up;
  if (up != scene::UpAxis::not_told) camera.up = direction_of(up);
  if (options.camera) {
    return {options.camera->eye, options.camera->target, camera.up, options.camera->fov_degrees.value_or(45.0)};
  }
  if (options.files.empty() && up == scene::UpAxis::not_told) return camera;
  return fit_camera(box, camera.up, 45.0, static_cast<double>(options.width) / options.height);
}

Box bounds_of(std::span<const Box> boxes) {
  Box all;
  for (const Box& box : boxes) {
    all.min = glm::min(all.min, box.min);
    all.max = glm::max(all.max, box.max);
  }
  return all;
}

/// The times of one step over all frames, and of all steps, in the order of the work.
class Times {
 public:
  void add(const FrameTimes& ms, double draw, double pictures, double frame) {
    for (std::size_t i = 0; i < steps.size(); ++i) steps_[i].push_back(ms.*steps[i].of);
    load_.push_back(ms.load);
    draw_.push_back(draw);
    pictures_.push_back(pictures);
    frame_.push_back(frame);
  }
  std::size_t frames() const { return frame_.size(); }

  const std::vector<double>& frames_ms() const { return frame_; }
  const std::vector<double>& loads_ms() const { return load_; }

  /// The mean of a step over all frames but the first, which sends everything.
  static double mean(const std::vector<double>& ms) {
    return ms.size() < 2 ? 0.0 : std::accumulate(ms.begin() + 1, ms.end(), 0.0) / static_cast<double>(ms.size() - 1);
  }

  /// Means of what several ranks are compared by; see report().
  std::vector<std::pair<std::string, double>> means() const {
    std::vector<std::pair<std::string, double>> ms;
    for (std::size_t i = 0; i < steps.size(); ++i) ms.emplace_back(steps[i].name, mean(steps_[i]));
    ms.emplace_back("draw", mean(draw_));
    ms.emplace_back("pictures", mean(pictures_));
    ms.emplace_back("frame", mean(frame_));
    return ms;
  }

  /// Appends the medians: of the steps, if they were `timed`, without those that no frame needed; of drawing and of
  /// whole frames, and the worst frame.
  void report(bool timed, std::vector<std::pair<std::string, double>>& ms) const {
    for (std::size_t i = 0; timed && i < steps.size(); ++i) {
      const bool taken = std::ranges::any_of(steps_[i], [](double time) { return time > 0.0; });
      if (taken || !steps[i].optional) ms.emplace_back(steps[i].name, median(steps_[i]));
    }
    ms.emplace_back("draw", median(draw_));
    if (const double pictures = median(pictures_); pictures > 0.0) ms.emplace_back("pictures", pictures);
    ms.emplace_back("frame", median(frame_));
    ms.emplace_back("worst frame", frame_.empty() ? 0.0 : *std::ranges::max_element(frame_));
  }

 private:
  struct Step {
    const char* name;
    double FrameTimes::*of;
    bool optional;
  };
  static constexpr std::array<Step, 16> steps = {{{"cull", &FrameTimes::cull, false},
                                                  {"occluders", &FrameTimes::occluders, true},
                                                  {"depth", &FrameTimes::depth, true},
                                                  {"hzm", &FrameTimes::hzm, true},
                                                  {"occlusion", &FrameTimes::occlusion, true},
                                                  {"project", &FrameTimes::project, false},
                                                  {"budget", &FrameTimes::budget, false},
                                                  {"balance", &FrameTimes::balance, true},
                                                  {"unify", &FrameTimes::unify, true},
                                                  {"load", &FrameTimes::load, true},
                                                  {"limit", &FrameTimes::limit, true},
                                                  {"send", &FrameTimes::send, true},
                                                  {"defragment", &FrameTimes::defragment, true},
                                                  {"reform", &FrameTimes::reform, false},
                                                  {"gather", &FrameTimes::gather, false},
                                                  {"upload", &FrameTimes::upload, false}}};
  std::array<std::vector<double>, steps.size()> steps_;
  std::vector<double> draw_, pictures_, frame_, load_;
};

/// The reference picture of what a frame chose, as large as the frame's own.
template <class Index>
Image draw_reference(const FrameModel<Index>& model, const Selection& selection, const Camera& camera, const View& seen,
                     Box box, double extent) {
  const auto width = static_cast<int>(seen.width), height = static_cast<int>(seen.height);
  const Camera outside = reference_camera(box, camera, static_cast<double>(width) / height);
  box.min = glm::min(box.min, glm::vec3(camera.eye));
  box.max = glm::max(box.max, glm::vec3(camera.eye));
  const View view = view_of(outside, box, width, height);
  Renderer renderer;
  renderer.draw_offscreen(width, height, 4);
  const std::vector<Box> hidden = fill_reference(model, selection, view, renderer.buffers());
  renderer.draw_reference(view, outside, extent, seen, hidden);
  return renderer.read(width, height);
}

std::string title_of(std::uint64_t budget, std::size_t triangles, double ms) {
  char time[32];
  std::snprintf(time, sizeof time, "%.1f", ms);
  return "pgl: budget " + scene::grouped(budget) + ", " + scene::grouped(triangles) + " triangles, " + time + " ms";
}

template <class Index>
std::unique_ptr<AnyFrame> make_frame(const Options& options, const StreamOptions& stream,
                                     const FrameModel<Index>& model, Ranks& ranks, Renderer& renderer) {
  const FrameOptions frame{.budget = options.budget,
                           .min_triangles = options.min_triangles,
                           .occlusion = options.occlusion,
                           .stream = stream,
                           .lod = options.lod,
                           .own_limits = options.frame_time.has_value(),
                           .tiles = options.tiles,
                           .ranks = &ranks};
  if constexpr (built_with_cuda) {
    if (options.backend == BackendKind::cuda) {
      return make_cuda_frame(model, frame, renderer.buffers(), renderer.vendor());
    }
  }
  return std::make_unique<Frame<HostBackend, Index>>(model, frame, renderer.buffers());
}

/// The model of a file as a frame reads it: checked part by part.
template <class Index>
FrameModel<Index> model_of(scene::ModelFile& file, std::uint32_t min_triangles) {
  FrameModel<Index> model{file.view<Index>(), {}, {}, {}, {}};
  if (min_triangles > 0) file.require_map();
  model.load = [&file](std::span<const std::uint32_t> counts) { file.require(counts); };
  model.load_maps = [&file](std::span<const std::uint32_t> counts) { file.require_maps(counts); };
  model.load_tables = [&file] {
    file.require_map();
    file.require_ecol();
  };
  model.load_errors = [&file] { file.require_errors(); };
  return model;
}

/// With occlusion culling one sample a pixel: what is hidden from all centres may show at another sample.
int samples_of(const Options& options) {
  return options.occlusion.mode == OcclusionMode::off ? 4 : 1;
}

/// How many frames a flight takes where nobody says when to stop.
constexpr int flight_frames = 600;

/// The camera of frame number `frame`, on from that of the frame before.
void move_on(const Options& options, const Box& box, double aspect, int frame, int last_frame, Camera& camera) {
  if (options.fly) {
    const int flight = last_frame > 0 ? last_frame : flight_frames;
    camera = fly(box, camera.up, camera.fov_degrees, aspect, frame % flight / std::max(1.0, flight - 1.0));
  } else if (options.orbit && frame > 0) {
    orbit(camera, glm::radians(1.0), 0.0);
  }
}

/// What rank 0 says at the beginning of a frame.
struct Order {
  bool go = true;
  View view;
  Camera camera;
  std::uint64_t budget = 0;
  bool wireframe = false;
  int width = 0, height = 0;
};

/// How well the ranks' shares were balanced: how much more than the mean the largest had, over all frames.
class Imbalance {
 public:
  void add(std::span<const Taken> all) {
    std::uint64_t sum = 0, most = 0;
    for (const Taken& one : all) {
      sum += one.triangles;
      most = std::max(most, one.triangles);
    }
    if (sum == 0) return;
    const double now = static_cast<double>(most) * static_cast<double>(all.size()) / static_cast<double>(sum) - 1.0;
    sum_ += now;
    worst_ = std::max(worst_, now);
    ++frames_;
  }
  double mean() const { return frames_ > 0 ? sum_ / frames_ : 0.0; }
  double worst() const { return worst_; }

 private:
  double sum_ = 0.0, worst_ = 0.0;
  int frames_ = 0;
};

/// What was drawn and measured, by whom.
void fill_report(const Options& options, const Times& times, AnyFrame& frame, Renderer& renderer,
                 const scene::ModelFile* file, Report& report) {
  report.drawn_vertices = renderer.buffers().vertices();
  report.drawn_triangles = renderer.buffers().triangles();
  report.frames = static_cast<int>(times.frames());
  Selection selection;
  if (report.frames > 0) selection = frame.selection();
  report.drawn_objects = selection.counts.size() - static_cast<std::size_t>(std::ranges::count(selection.counts, 0u));
  report.memory = frame.memory();
  if (file != nullptr) {
    report.file_bytes = file->bytes();
    report.file_bytes_read = file->bytes_verified();
  }
  if (options.checksums) {
    report.frame_ms = times.frames_ms();
    report.load_ms = times.loads_ms();
  }
  const auto none = [](const std::vector<std::uint8_t>& flags) {
    return static_cast<std::uint64_t>(std::ranges::count(flags, std::uint8_t{0}));
  };
  report.culled_frustum = none(selection.in_view);
  report.culled_occlusion = none(selection.visible) - report.culled_frustum;
  report.occluders = selection.occluders.size();
  times.report(!options.stream.overlap, report.ms);
  report.mean_ms = times.means();
  report.samples = renderer.samples();
  const BackendInfo info = frame.info();
  report.backend = info.name;
  report.gpu = info.gpu;
  report.interop = info.interop;
  report.gl_vendor = renderer.vendor();
  report.gl_renderer = renderer.renderer();
  report.gl_version = renderer.version();
  if (!options.stats.empty()) report.drawn_checksum = renderer.buffers().checksum();
}

template <class Index>
void show(const Options& options, const FrameModel<Index>& from, scene::ModelFile* file, Ranks& ranks, Window* window,
          Report& report) {
  const scene::ModelView<Index>& model = from.view;
  const bool wall = options.tiles.mode == TileMode::wall;
  const bool shared = ranks.size() > 1;
  // What is drawn into a picture first: others' tiles come to it, or only a part of it is shown.
  const bool offscreen = window == nullptr || shared || wall;
  std::optional<Renderer> renderer;
  std::unique_ptr<AnyFrame> frame;
  std::optional<PictureExchange> exchange;
  int width = options.width, height = options.height;
  const Box box = bounds_of(model.object_boxes);
  const double extent = glm::distance(glm::dvec3(box.min), glm::dvec3(box.max));
  WindowState state;
  together(ranks, [&] {
    if (file != nullptr && !glm::all(glm::lessThanEqual(box.min, box.max))) {
      throw scene::Error(file->path(), "has nothing to draw");
    }
    renderer.emplace();
    if (offscreen) renderer->draw_offscreen(width, height, samples_of(options));
    state.budget = options.budget;
    state.wireframe = options.wireframe;
    state.camera = first_camera(options, file != nullptr ? file->up() : scene::UpAxis::not_told, box);
    frame = make_frame(options, options.stream, from, ranks, *renderer);
  });
  // Free memory is each rank's own, but what they choose must be the same: one that streams makes all do so.
  const bool some_stream = ranks.least(frame->streams() ? 0 : 1) == 0;
  together(ranks, [&] {
    if (!some_stream || frame->streams()) return;
    StreamOptions stream = options.stream;
    stream.mode = StreamMode::always;
    frame.reset();  // first, for its memory
    frame = make_frame(options, stream, from, ranks, *renderer);
  });
  const BackendInfo info = frame->info();
  const bool cuda = info.name == "cuda";
  if (shared && !wall) exchange.emplace(ranks, *renderer, width, height, cuda);
  if (window != nullptr) {
    if (ranks.rank() == 0) std::puts(controls);
    window->show(state, extent, std::uint64_t{1} << 32);
  }
  std::optional<Prefetcher<Index>> prefetcher;
  if (file != nullptr && options.prefetch && options.lod == LodMode::budget) {
    prefetcher.emplace(*file, model, options.min_triangles);
  }
  note(ranks, info.note);
  if (cuda && ranks.on_one_machine()) {
    std::vector<std::string> gpus = ranks.gather_texts(info.gpu);
    std::ranges::sort(gpus);
    if (const auto same = std::ranges::adjacent_find(gpus); same != gpus.end()) {
      note(ranks, "several ranks share a GPU: " + *same);
    }
  }
  if (exchange) note(ranks, exchange->note());
  const int last_frame = options.frames > 0 ? options.frames : window == nullptr ? 1 : 0;
  Times times;
  Imbalance imbalance;
  BudgetOptions first = options.distribution;
  first.budget = state.budget;
  Pace pace(first, options.threshold, options.lod, options.frame_time, options.tiles.mode == TileMode::measured,
            ranks.size(), ranks.rank());
  const std::vector<Tile> one_tile = {whole(width, height)};
  const auto tiles = [&]() -> const std::vector<Tile>& { return shared ? frame->tiles() : one_tile; };
  const auto own_tile = [&] { return tiles()[static_cast<std::size_t>(ranks.rank())]; };
  const auto picture = [&] {
    if (!offscreen) return renderer->read(width, height);
    if (!shared) renderer->resolve(own_tile());
    return renderer->read_picture(wall ? own_tile() : whole(width, height));
  };
  Order order;
  Camera last_camera = state.camera;
  bool stop = false;
  double waited = 0.0;
  FrameRequest request = pace.request();  // of the last frame
  for (int done = 0;; ++done) {
    if (window != nullptr) {
      const bool still = done > 0 && last_frame == 0 && !options.orbit && !options.fly;
      // Others are not kept waiting for people.
      const double most_seconds = !still || ranks.rank() != 0 ? 0.0 : shared ? 1.0 : 1e6;
      if (!window->handle_events(most_seconds)) stop = true;
    }
    if (ranks.rank() == 0) {
      order.go = !stop && (last_frame == 0 || done < last_frame);
      if (window != nullptr && !wall) {
        window->size(order.width, order.height);
        order.width = std::clamp(order.width, 1, 16384);  // minimised
        order.height = std::clamp(order.height, 1, 16384);
      } else {
        order.width = width;
        order.height = height;
      }
      const double aspect = static_cast<double>(order.width) / order.height;
      if (order.go) move_on(options, box, aspect, done, last_frame, state.camera);
      order.camera = state.camera;
      order.budget = state.budget;
      order.wireframe = state.wireframe;
      if (order.go) order.view = view_of(order.camera, box, order.width, order.height);
    }
    ranks.broadcast(order);
    if (!order.go) break;
    if (order.width != width || order.height != height) {
      width = order.width;
      height = order.height;
      if (offscreen) {
        exchange.reset();
        renderer->draw_offscreen(width, height, samples_of(options));
        exchange.emplace(ranks, *renderer, width, height, cuda);
      }
    }

    Stopwatch whole_frame;
    pace.set_budget(order.budget);
    request = pace.request();
    if (prefetcher) {
      Camera next = order.camera;
      if (options.fly || options.orbit) {
        move_on(options, box, static_cast<double>(width) / height, done + 1, last_frame, next);
      } else if (done > 0) {  // on as it went
        next.eye += order.camera.eye - last_camera.eye;
        next.target += order.camera.target - last_camera.target;
      }
      BudgetOptions room = request.distribution;
      if (frame->memory().streams && !shared) room.budget = std::min(room.budget, frame->memory().vertices);
      if (next.eye != next.target) prefetcher->want(view_of(next, box, width, height), room);
    }
    last_camera = order.camera;
    const FrameTimes ms = frame->run(order.view, request);
    Stopwatch watch;
    const std::optional<Tile> part = shared ? std::optional(own_tile()) : std::nullopt;
    for (int i = 0; i < (ranks.rank() == options.slow_rank ? options.slow_factor : 1); ++i) {
      renderer->draw(order.view, order.camera, extent, order.wireframe, !options.stream.overlap, part);
    }
    const double draw = watch.lap();
    const double own = whole_frame.lap() - ms.unify;
    double pictures = 0.0;
    if (exchange) {
      exchange->exchange(tiles());
    } else if (shared) {
      renderer->resolve(own_tile());
    }
    const std::vector<Taken> taken =
        ranks.gather(Taken{static_cast<float>(own), static_cast<float>(waited), renderer->buffers().vertices(),
                           renderer->buffers().triangles(), stop});
    if (shared) pictures = watch.lap();
    waited = ms.unify + pictures;
    for (const Taken& one : taken) stop = stop || one.stop;
    pace.follow(taken);
    imbalance.add(taken);
    const double total = own + ms.unify + whole_frame.lap();
    times.add(ms, draw, pictures, total);
    if (options.checksums) report.checksums.push_back(renderer->buffers().checksum());
    if (frame->memory().streams) {
      report.sent.push_back(frame->sent());
    } else if (done == 0 && (options.stream.transfer || options.stream.overlap)) {
      note(ranks, "the model fits: nothing is streamed, --transfer and --overlap change nothing");
    }

    if (window != nullptr) {
      if (std::exchange(state.take_picture, false)) {
        const std::string path = options.output.empty() ? "pgl.png" : options.output;
        const PendingFile file_of_it{"P", path, encode_png("P", picture())};
        try {
          write_files({&file_of_it, 1});
        } catch (const std::runtime_error& error) {  // no reason to close the window
          scene::tell("pgl_viewer", error.what());
        }
      }
      if (offscreen) {
        if (!shared) renderer->resolve(own_tile());
        renderer->present(wall ? own_tile() : whole(width, height));
      }
      window->present();
      std::uint64_t triangles = 0;
      for (const Taken& one : taken) triangles += one.triangles;
      window->set_title(title_of(request.distribution.budget, triangles, total));
    }
  }

  together(ranks, [&] {
    report.budget = request.distribution.budget;
    report.threshold = options.lod == LodMode::error ? request.threshold : 0.0f;
    fill_report(options, times, *frame, *renderer, file, report);
    report.width = width;
    report.height = height;
    report.camera = order.camera;
    if (shared) {
      report.rank = ranks.rank();
      report.pictures = exchange ? exchange->how() : "none";
      report.imbalance = imbalance.mean();
      report.worst_imbalance = imbalance.worst();
      if (report.frames > 0) report.tile = own_tile();
      report.weight = request.weights[static_cast<std::size_t>(ranks.rank())];
    }
    if (file != nullptr) file->check();  // that the last frame drew no zeros instead of what is gone
  });
  if (shared) report.ranks = ranks.gather_texts(to_json(report));
  exchange.reset();
  if (!wall) ranks.leave();  // what rank 0 writes may take long

  std::vector<PendingFile> files;
  const auto encode = [&] {
    if (!options.output.empty() && report.frames > 0 && (ranks.rank() == 0 || wall)) {
      if (window != nullptr && !offscreen) {
        renderer->draw(order.view, order.camera, extent, order.wireframe);
      }
      files.push_back({"--output", options.output, encode_png("--output", picture())});
    }
    if (!options.stats.empty() && ranks.rank() == 0) {
      files.push_back({"--stats", options.stats, to_json(report)});
    }
    if (!options.reference.empty() && report.frames > 0 && ranks.rank() == 0) {
      const Image image = draw_reference(from, frame->selection(), order.camera, order.view, box, extent);
      files.push_back({"--reference", options.reference, encode_png("--reference", image)});
    }
    if (file != nullptr) file->check();  // the reference reads it too
  };
  if (wall) {
    together(ranks, encode);
    together(ranks, [&] { write_files(files); });
  } else if (ranks.rank() == 0) {
    encode();
    write_files(files);
  }
}

/// Why so many ranks cannot do what is asked for, or nothing.
std::string refusal(const Options& options, std::uint32_t ranks) {
  const TileOptions& tiles = options.tiles;
  if (ranks > most_tiles) return "mpirun: at most " + std::to_string(most_tiles) + " ranks draw a picture";
  if (ranks > 1 && options.stream.overlap) {
    return "--overlap: is for one GPU: several wait for each other after every frame";
  }
  if (tiles.mode == TileMode::wall && tiles.columns * tiles.rows != ranks) {
    return "--wall: " + std::to_string(tiles.columns) + "x" + std::to_string(tiles.rows) + " is not drawn by " +
           std::to_string(ranks) + " of mpirun";
  }
  return {};
}

void run(const Options& options, Ranks& ranks) {
#if defined(_OPENMP)
  // Where a file is read ahead and there are many cores, one is left for it: the frame's threads wait for each other,
  // and so for any that has to share its own.
  int threads = omp_get_max_threads() / ranks.local_size();
  if (options.preprocessed && options.prefetch && threads >= 8) --threads;
  omp_set_num_threads(options.threads > 0 ? options.threads : std::max(1, threads));
#endif
  Report report;
  report.threads = host::thread_count();
  scene::ProgressLine line;
  const scene::Progress progress = ranks.rank() == 0 ? scene::Progress(std::ref(line)) : scene::Progress();
  const bool errors = options.lod == LodMode::error;

  Stopwatch watch;
  scene::Scene imported;
  std::optional<scene::ModelFile> file;
  double open_ms = 0.0;
  // Before the long work, so that it is not for nothing; after the import, which forks.
  std::unique_ptr<Window> window;
  std::unique_ptr<OffscreenContext> offscreen;
  std::optional<scene::AnyModel> any_model;
  together(ranks, [&] {
    if (options.preprocessed) {
      file.emplace(options.files.front());
      open_ms = watch.lap();
    } else {
      imported = import_files(options, ranks, progress);
      report.ms.emplace_back("import", watch.lap());
    }
    int gpu = -1;
    if constexpr (built_with_cuda) {
      if (options.backend == BackendKind::cuda) gpu = choose_gpu(ranks.local_rank());
    }
    const bool shows = ranks.rank() == 0 || options.tiles.mode == TileMode::wall;
    if (shows && !options.headless && Window::available()) {
      Tile part = whole(options.width, options.height);
      if (options.tiles.mode == TileMode::wall) {
        part = wall_tiles(options.tiles.columns, options.tiles.rows, part.x1,
                          part.y1)[static_cast<std::size_t>(ranks.rank())];
      }
      window = std::make_unique<Window>(std::max(1, static_cast<int>(part.x1 - part.x0)),
                                        std::max(1, static_cast<int>(part.y1 - part.y0)), samples_of(options));
    } else {
      offscreen = std::make_unique<OffscreenContext>(gpu);
    }
    watch.lap();
    if (!file) {
      scene::BuildReport built;
      any_model.emplace(options.files.empty()
                            ? scene::build_plant(options.plant, 0, options.plant.objects, options.import.weld,
                                                 options.ecol, progress, &built, errors)
                            : scene::build_any_model(std::move(imported), options.ecol, progress, &built, errors));
      report.ms.emplace_back("preprocess", watch.lap());
      report.open_vertices = built.open_vertices;
    }
  });

  const auto show_model = [&]<class Index>(const FrameModel<Index>& model, scene::ModelFile* mapped) {
    const ModelSize size = size_of(model.view);
    report.objects = model.view.objects.size();
    report.meshes = model.view.meshes.size();
    report.model_vertices = size.vertices;
    report.model_triangles = size.triangles;
    line.clear();
    show(options, model, mapped, ranks, window.get(), report);
  };
  const auto show_file = [&]<class Index>() {
    std::optional<FrameModel<Index>> model;
    together(ranks, [&] { model.emplace(model_of<Index>(*file, options.min_triangles)); });
    report.ms.emplace_back("open", open_ms + watch.lap());
    show_model(*model, &*file);
  };
  if (file && file->wide()) {
    show_file.template operator()<std::uint32_t>();
  } else if (file) {
    show_file.template operator()<std::uint16_t>();
  } else {
    std::visit(
        [&]<class Index>(const scene::Model<Index>& model) {
          show_model(FrameModel<Index>{scene::ModelView<Index>(model), {}, {}, {}, {}}, nullptr);
        },
        *any_model);
  }
  if (ranks.rank() == 0) std::fputs(to_table(report).c_str(), stdout);
}

int fail(const char* message, int code) {
  scene::tell("pgl_viewer", message);
  return code;
}

}  // namespace

}  // namespace pgl::viewer

/// Exit codes: 0 done, 1 failed, 2 impossible options, 3 nothing to draw with on this machine. Of several ranks one
/// tells and has the code.
int main(int argc, char** argv) {
  using namespace pgl::viewer;
  const int rank = Ranks::rank_of_environment();
  std::optional<Options> options;
  try {
    options = parse_options(argc, argv, rank);
  } catch (const std::exception& error) {
    return rank == 0 ? fail(error.what(), 2) : 0;
  }
  if (!options) return 0;
  std::optional<Ranks> ranks;
  const auto end = [&](const char* message, int code) {
    if (ranks && ranks->size() > 1) ranks->abort(message, code);
    return fail(message, code);
  };
  try {
    ranks.emplace(options->patience);
    if (const std::string why = refusal(*options, static_cast<std::uint32_t>(ranks->size())); !why.empty()) {
      return rank == 0 ? fail(why.c_str(), 2) : 0;
    }
    run(*options, *ranks);
    return 0;
  } catch (const EndedElsewhere&) {
    return 0;  // mpirun ends the others as soon as one fails: rank 0 tells first
  } catch (const Agreed& error) {
    return fail(error.what(), error.code);
  } catch (const NoContext& error) {
    return end(error.what(), 3);
  } catch (const std::bad_alloc&) {
    return end("not enough memory", 1);
  } catch (const std::exception& error) {
    return end(error.what(), 1);
  }
}
