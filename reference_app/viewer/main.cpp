// SPDX-License-Identifier: MIT
// pgl_viewer: a model, a camera and a vertex budget go in; a picture comes out, in a window or in a file.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <functional>
#include <iterator>
#include <memory>
#include <new>
#include <optional>
#include <span>
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
#include "viewer/prefetcher.hpp"
#include "viewer/reference.hpp"
#include "viewer/renderer.hpp"
#include "viewer/report.hpp"
#include "viewer/window.hpp"

namespace pgl::viewer {

namespace {

/// The model files as one scene.
scene::Scene import_files(const Options& options, const scene::Progress& progress) {
  scene::Scene all;
  for (const std::string& file : options.files) {
    scene::ImportReport report;
    scene::Scene part = scene::import_scene(file, options.import, progress, &report);
    for (const std::string& warning : report.warnings) scene::tell("pgl_viewer", warning);
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
  void add(const FrameTimes& ms, double draw, double frame) {
    for (std::size_t i = 0; i < steps.size(); ++i) steps_[i].push_back(ms.*steps[i].of);
    load_.push_back(ms.load);
    draw_.push_back(draw);
    frame_.push_back(frame);
  }
  std::size_t frames() const { return frame_.size(); }

  const std::vector<double>& frames_ms() const { return frame_; }
  const std::vector<double>& loads_ms() const { return load_; }

  /// Appends the medians: of the steps, if they were `timed`, without those that no frame needed; of drawing and of
  /// whole frames, and the worst frame.
  void report(bool timed, std::vector<std::pair<std::string, double>>& ms) {
    for (std::size_t i = 0; timed && i < steps.size(); ++i) {
      const bool taken = std::ranges::any_of(steps_[i], [](double time) { return time > 0.0; });
      if (taken || !steps[i].optional) ms.emplace_back(steps[i].name, median(steps_[i]));
    }
    ms.emplace_back("draw", median(draw_));
    std::vector<double> frames = frame_;
    ms.emplace_back("frame", median(frames));
    ms.emplace_back("worst frame", frames.empty() ? 0.0 : *std::ranges::max_element(frames));
  }

 private:
  struct Step {
    const char* name;
    double FrameTimes::*of;
    bool optional;
  };
  static constexpr std::array<Step, 14> steps = {{{"cull", &FrameTimes::cull, false},
                                                  {"occluders", &FrameTimes::occluders, true},
                                                  {"depth", &FrameTimes::depth, true},
                                                  {"hzm", &FrameTimes::hzm, true},
                                                  {"occlusion", &FrameTimes::occlusion, true},
                                                  {"project", &FrameTimes::project, false},
                                                  {"budget", &FrameTimes::budget, false},
                                                  {"load", &FrameTimes::load, true},
                                                  {"limit", &FrameTimes::limit, true},
                                                  {"send", &FrameTimes::send, true},
                                                  {"defragment", &FrameTimes::defragment, true},
                                                  {"reform", &FrameTimes::reform, false},
                                                  {"gather", &FrameTimes::gather, false},
                                                  {"upload", &FrameTimes::upload, false}}};
  std::array<std::vector<double>, steps.size()> steps_;
  std::vector<double> draw_, frame_, load_;
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
std::unique_ptr<AnyFrame> make_frame(const Options& options, const FrameModel<Index>& model, Renderer& renderer) {
  const FrameOptions frame{options.budget, options.min_triangles, options.occlusion, options.stream};
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
  FrameModel<Index> model{file.view<Index>(), {}, {}, {}};
  if (min_triangles > 0) file.require_map();
  model.load = [&file](std::span<const std::uint32_t> counts) { file.require(counts); };
  model.load_maps = [&file](std::span<const std::uint32_t> counts) { file.require_maps(counts); };
  model.load_tables = [&file] {
    file.require_map();
    file.require_ecol();
  };
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

template <class Index>
void show(const Options& options, const FrameModel<Index>& from, scene::ModelFile* file, Window* window,
          Report& report) {
  const scene::ModelView<Index>& model = from.view;
  Renderer renderer;
  int width = options.width, height = options.height;
  if (window == nullptr) renderer.draw_offscreen(width, height, samples_of(options));

  const Box box = bounds_of(model.object_boxes);
  if (file != nullptr && !glm::all(glm::lessThanEqual(box.min, box.max))) {
    throw scene::Error(file->path(), "has nothing to draw");
  }
  const double extent = glm::distance(glm::dvec3(box.min), glm::dvec3(box.max));
  WindowState state;
  state.budget = options.budget;
  state.wireframe = options.wireframe;
  state.camera = first_camera(options, file != nullptr ? file->up() : scene::UpAxis::not_told, box);
  if (window != nullptr) {
    std::puts(controls);
    window->show(state, extent, std::uint64_t{1} << 32);
  }

  const std::unique_ptr<AnyFrame> frame = make_frame(options, from, renderer);
  std::optional<Prefetcher<Index>> prefetcher;
  if (file != nullptr && options.prefetch) prefetcher.emplace(*file, model, options.min_triangles);
  const BackendInfo info = frame->info();
  if (!info.note.empty()) scene::tell("pgl_viewer", info.note);
  const int last_frame = options.frames > 0 ? options.frames : window == nullptr ? 1 : 0;
  Times times;
  View view;
  Camera last_camera = state.camera;
  for (int done = 0; last_frame == 0 || done < last_frame; ++done) {
    if (window != nullptr) {
      if (!window->handle_events(done > 0 && last_frame == 0 && !options.orbit && !options.fly)) break;
      window->size(width, height);
      width = std::max(width, 1);  // minimised
      height = std::max(height, 1);
    }
    const double aspect = static_cast<double>(width) / height;
    move_on(options, box, aspect, done, last_frame, state.camera);

    Stopwatch whole;
    view = view_of(state.camera, box, width, height);
    BudgetOptions distribution = options.distribution;
    distribution.budget = state.budget;
    if (prefetcher) {
      Camera next = state.camera;
      if (options.fly || options.orbit) {
        move_on(options, box, aspect, done + 1, last_frame, next);
      } else if (done > 0) {  // on as it went
        next.eye += state.camera.eye - last_camera.eye;
        next.target += state.camera.target - last_camera.target;
      }
      BudgetOptions room = distribution;
      if (frame->memory().streams) room.budget = std::min(room.budget, frame->memory().vertices);
      if (next.eye != next.target) prefetcher->want(view_of(next, box, width, height), room);
    }
    last_camera = state.camera;
    const FrameTimes ms = frame->run(view, distribution);
    Stopwatch watch;
    renderer.draw(view, state.camera, extent, state.wireframe, !options.stream.overlap);
    const double draw = watch.lap();
    const double total = whole.lap();
    times.add(ms, draw, total);
    if (options.checksums) report.checksums.push_back(renderer.buffers().checksum());
    if (frame->memory().streams) {
      report.sent.push_back(frame->sent());
    } else if (done == 0 && (options.stream.transfer || options.stream.overlap)) {
      scene::tell("pgl_viewer", "the model fits: nothing is streamed, --transfer and --overlap change nothing");
    }

    if (window != nullptr) {
      if (std::exchange(state.take_picture, false)) {
        const std::string path = options.output.empty() ? "pgl.png" : options.output;
        const PendingFile picture{"P", path, encode_png("P", renderer.read(width, height))};
        try {
          write_files({&picture, 1});
        } catch (const std::runtime_error& error) {  // no reason to close the window
          scene::tell("pgl_viewer", error.what());
        }
      }
      window->present();
      window->set_title(title_of(state.budget, renderer.buffers().triangles(), total));
    }
  }

  report.budget = state.budget;
  report.drawn_vertices = renderer.buffers().vertices();
  report.drawn_triangles = renderer.buffers().triangles();
  report.frames = static_cast<int>(times.frames());
  Selection selection;
  if (report.frames > 0) selection = frame->selection();
  report.drawn_objects = selection.counts.size() - static_cast<std::size_t>(std::ranges::count(selection.counts, 0u));
  report.memory = frame->memory();
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
  report.width = width;
  report.height = height;
  report.samples = renderer.samples();
  report.camera = state.camera;
  report.backend = info.name;
  report.gpu = info.gpu;
  report.interop = info.interop;
  report.gl_vendor = renderer.vendor();
  report.gl_renderer = renderer.renderer();
  report.gl_version = renderer.version();

  std::vector<PendingFile> files;
  if (!options.output.empty()) {
    if (window != nullptr && report.frames > 0) renderer.draw(view, state.camera, extent, state.wireframe);
    files.push_back({"--output", options.output, encode_png("--output", renderer.read(width, height))});
  }
  if (!options.stats.empty()) {
    report.drawn_checksum = renderer.buffers().checksum();
    files.push_back({"--stats", options.stats, to_json(report)});
  }
  if (!options.reference.empty() && report.frames > 0) {
    const Image image = draw_reference(from, selection, state.camera, view, box, extent);
    files.push_back({"--reference", options.reference, encode_png("--reference", image)});
  }
  if (file != nullptr) file->check();  // that the last frame drew no zeros instead of what is gone
  write_files(files);
}

void run(const Options& options) {
#if defined(_OPENMP)
  if (options.threads > 0) omp_set_num_threads(options.threads);
#endif
  Report report;
  report.threads = host::thread_count();
  scene::ProgressLine line;
  const scene::Progress progress = std::ref(line);

  Stopwatch watch;
  scene::Scene imported;
  std::optional<scene::ModelFile> file;
  double open_ms = 0.0;
  if (options.preprocessed) {
    file.emplace(options.files.front());
    open_ms = watch.lap();
  } else {
    imported = import_files(options, progress);
    report.ms.emplace_back("import", watch.lap());
  }

  // Before the long work, so that it is not for nothing; after the import, which forks.
  std::unique_ptr<Window> window;
  std::unique_ptr<OffscreenContext> offscreen;
  int gpu = -1;
  if constexpr (built_with_cuda) {
    if (options.backend == BackendKind::cuda) gpu = choose_gpu();
  }
  if (!options.headless && Window::available()) {
    window = std::make_unique<Window>(options.width, options.height, samples_of(options));
  } else {
    offscreen = std::make_unique<OffscreenContext>(gpu);
  }

  const auto show_model = [&]<class Index>(const FrameModel<Index>& model, scene::ModelFile* mapped) {
    const ModelSize size = size_of(model.view);
    report.objects = model.view.objects.size();
    report.meshes = model.view.meshes.size();
    report.model_vertices = size.vertices;
    report.model_triangles = size.triangles;
    line.clear();
    show(options, model, mapped, window.get(), report);
  };
  watch.lap();
  if (file) {
    if (file->wide()) {
      const auto model = model_of<std::uint32_t>(*file, options.min_triangles);
      report.ms.emplace_back("open", open_ms + watch.lap());
      show_model(model, &*file);
    } else {
      const auto model = model_of<std::uint16_t>(*file, options.min_triangles);
      report.ms.emplace_back("open", open_ms + watch.lap());
      show_model(model, &*file);
    }
  } else {
    scene::BuildReport built;
    const scene::AnyModel any_model = options.files.empty()
                                          ? scene::build_plant(options.plant, 0, options.plant.objects,
                                                               options.import.weld, options.ecol, progress, &built)
                                          : scene::build_any_model(std::move(imported), options.ecol, progress, &built);
    report.ms.emplace_back("preprocess", watch.lap());
    report.open_vertices = built.open_vertices;
    std::visit(
        [&]<class Index>(const scene::Model<Index>& model) {
          show_model(FrameModel<Index>{scene::ModelView<Index>(model), {}, {}, {}}, nullptr);
        },
        any_model);
  }
  std::fputs(to_table(report).c_str(), stdout);
}

int fail(const char* message, int code) {
  scene::tell("pgl_viewer", message);
  return code;
}

}  // namespace

}  // namespace pgl::viewer

/// Exit codes: 0 done, 1 failed, 2 impossible options, 3 nothing to draw with on this machine.
int main(int argc, char** argv) {
  using namespace pgl::viewer;
  std::optional<Options> options;
  try {
    options = parse_options(argc, argv);
  } catch (const std::exception& error) {
    return fail(error.what(), 2);
  }
  if (!options) return 0;
  try {
    run(*options);
    return 0;
  } catch (const NoContext& error) {
    return fail(error.what(), 3);
  } catch (const std::bad_alloc&) {
    return fail("not enough memory", 1);
  } catch (const std::exception& error) {
    return fail(error.what(), 1);
  }
}
