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
#include "scene/for_each.hpp"
#include "scene/import.hpp"
#include "scene/plant.hpp"
#include "scene/progress_line.hpp"
#include "scene/weld.hpp"
#include "viewer/camera.hpp"
#include "viewer/context.hpp"
#include "viewer/cuda_frame.hpp"
#include "viewer/frame.hpp"
#include "viewer/host_backend.hpp"
#include "viewer/options.hpp"
#include "viewer/output.hpp"
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
    for (const std::string& warning : report.warnings) std::fprintf(stderr, "pgl_viewer: %s\n", warning.c_str());
    const auto first_mesh = static_cast<std::uint32_t>(all.meshes.size());
    for (Object& object : part.objects) object.mesh += first_mesh;
    std::ranges::move(part.meshes, std::back_inserter(all.meshes));
    std::ranges::move(part.objects, std::back_inserter(all.objects));
  }
  return all;
}

/// Preprocesses the plant, which never exists as a whole before that: objects are made twice, to be counted and to be
/// kept. Its faces come unstitched, as those of real models do.
scene::AnyModel build_plant(const Options& options, const scene::Progress& progress, scene::BuildReport& report) {
  const auto make = [&](std::size_t i, scene::MeshData& mesh) {
    scene::plant_object(options.plant, i, mesh);
    if (options.import.weld) scene::weld(mesh);
  };
  std::vector<scene::MeshSize> sizes(options.plant.objects);
  std::vector<scene::MeshData> scratch(host::thread_count());
  scene::for_each(sizes.size(), progress, "plant", [&](std::size_t i) {
    scene::MeshData& mesh = scratch[host::thread_index()];
    make(i, mesh);
    sizes[i] = {mesh.positions.size(), mesh.triangles.size()};
  });
  const scene::MeshSource source{sizes.size(), [&](std::size_t i) { return sizes[i]; }, make};
  std::vector<Object> objects(source.count);
  for (std::size_t i = 0; i < source.count; ++i) objects[i].mesh = static_cast<std::uint32_t>(i);
  return scene::build_any_model(source, std::move(objects), options.ecol, progress, &report);
}

/// Where the camera starts: as told, else at the overview that the plant comes with, else with the whole model in view.
Camera first_camera(const Options& options, const Box& box) {
  Camera camera;
  if (options.files.empty()) {
    const scene::PlantCamera plant = scene::plant_camera(options.plant);
    camera = {plant.position, plant.target, plant.up, glm::degrees(double{plant.vertical_fov})};
  }
  if (options.camera) {
    return {options.camera->eye, options.camera->target, camera.up, options.camera->fov_degrees.value_or(45.0)};
  }
  if (options.files.empty()) return camera;
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
    draw_.push_back(draw);
    frame_.push_back(frame);
  }
  std::size_t frames() const { return frame_.size(); }

  /// Appends the median of each, those of occlusion culling only `with_occlusion`.
  void report(bool with_occlusion, std::vector<std::pair<std::string, double>>& ms) {
    for (std::size_t i = 0; i < steps.size(); ++i) {
      if (with_occlusion || !steps[i].occlusion) ms.emplace_back(steps[i].name, median(steps_[i]));
    }
    ms.emplace_back("draw", median(draw_));
    ms.emplace_back("frame", median(frame_));
  }

 private:
  struct Step {
    const char* name;
    double FrameTimes::*of;
    bool occlusion;
  };
  static constexpr std::array<Step, 10> steps = {{{"cull", &FrameTimes::cull, false},
                                                  {"occluders", &FrameTimes::occluders, true},
                                                  {"depth", &FrameTimes::depth, true},
                                                  {"hzm", &FrameTimes::hzm, true},
                                                  {"occlusion", &FrameTimes::occlusion, true},
                                                  {"project", &FrameTimes::project, false},
                                                  {"budget", &FrameTimes::budget, false},
                                                  {"reform", &FrameTimes::reform, false},
                                                  {"gather", &FrameTimes::gather, false},
                                                  {"upload", &FrameTimes::upload, false}}};
  std::array<std::vector<double>, steps.size()> steps_;
  std::vector<double> draw_, frame_;
};

/// The reference picture of what a frame chose, as large as the frame's own.
template <class Index>
Image draw_reference(const scene::Model<Index>& model, const Selection& selection, const Camera& camera,
                     const View& seen, Box box, double extent) {
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
  return "pgl: budget " + grouped(budget) + ", " + grouped(triangles) + " triangles, " + time + " ms";
}

template <class Index>
std::unique_ptr<AnyFrame> make_frame(const Options& options, const scene::Model<Index>& model, Renderer& renderer) {
  if constexpr (built_with_cuda) {
    if (options.backend == BackendKind::cuda) {
      return make_cuda_frame(model, options.min_triangles, options.occlusion, renderer.buffers(), renderer.vendor());
    }
  }
  return std::make_unique<Frame<HostBackend, Index>>(model, options.min_triangles, options.occlusion,
                                                     renderer.buffers());
}

/// With occlusion culling one sample a pixel: what is hidden from all centres may show at another sample.
int samples_of(const Options& options) {
  return options.occlusion.mode == OcclusionMode::off ? 4 : 1;
}

template <class Index>
void show(const Options& options, const scene::Model<Index>& model, Window* window, Report& report) {
  Renderer renderer;
  int width = options.width, height = options.height;
  if (window == nullptr) renderer.draw_offscreen(width, height, samples_of(options));

  const Box box = bounds_of(model.object_boxes);
  const double extent = glm::distance(glm::dvec3(box.min), glm::dvec3(box.max));
  WindowState state;
  state.budget = options.budget;
  state.wireframe = options.wireframe;
  state.camera = first_camera(options, box);
  if (window != nullptr) {
    std::puts(controls);
    window->show(state, extent, std::uint64_t{1} << 32);
  }

  const std::unique_ptr<AnyFrame> frame = make_frame(options, model, renderer);
  const BackendInfo info = frame->info();
  if (!info.note.empty()) std::fprintf(stderr, "pgl_viewer: %s\n", info.note.c_str());
  const int last_frame = options.frames > 0 ? options.frames : window == nullptr ? 1 : 0;
  Times times;
  View view;
  for (int done = 0; last_frame == 0 || done < last_frame; ++done) {
    if (window != nullptr) {
      if (!window->handle_events(done > 0 && last_frame == 0 && !options.orbit)) break;
      window->size(width, height);
      width = std::max(width, 1);  // minimised
      height = std::max(height, 1);
    }
    if (options.orbit && done > 0) orbit(state.camera, glm::radians(1.0), 0.0);

    Stopwatch whole;
    view = view_of(state.camera, box, width, height);
    BudgetOptions distribution = options.distribution;
    distribution.budget = state.budget;
    const FrameTimes ms = frame->run(view, distribution);
    Stopwatch watch;
    renderer.draw(view, state.camera, extent, state.wireframe);
    const double draw = watch.lap();
    const double total = whole.lap();
    times.add(ms, draw, total);
    if (options.checksums) report.checksums.push_back(renderer.buffers().checksum());

    if (window != nullptr) {
      if (std::exchange(state.take_picture, false)) {
        const std::string path = options.output.empty() ? "pgl.png" : options.output;
        const PendingFile file{"P", path, encode_png("P", renderer.read(width, height))};
        try {
          write_files({&file, 1});
        } catch (const std::runtime_error& error) {  // no reason to close the window
          std::fprintf(stderr, "pgl_viewer: %s\n", error.what());
        }
      }
      window->present();
      window->set_title(title_of(state.budget, renderer.buffers().triangles(), total));
    }
  }

  report.budget = state.budget;
  report.drawn_objects = frame->objects_drawn();
  report.drawn_vertices = renderer.buffers().vertices();
  report.drawn_triangles = renderer.buffers().triangles();
  report.frames = static_cast<int>(times.frames());
  Selection selection;
  if (report.frames > 0) selection = frame->selection();
  const auto none = [](const std::vector<std::uint8_t>& flags) {
    return static_cast<std::uint64_t>(std::ranges::count(flags, std::uint8_t{0}));
  };
  report.culled_frustum = none(selection.in_view);
  report.culled_occlusion = none(selection.visible) - report.culled_frustum;
  report.occluders = selection.occluders.size();
  times.report(options.occlusion.mode != OcclusionMode::off, report.ms);
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
    const Image image = draw_reference(model, selection, state.camera, view, box, extent);
    files.push_back({"--reference", options.reference, encode_png("--reference", image)});
  }
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
  scene::Scene imported = import_files(options, progress);
  report.ms.emplace_back("import", watch.lap());

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

  watch.lap();
  scene::BuildReport built;
  const scene::AnyModel any_model = options.files.empty()
                                        ? build_plant(options, progress, built)
                                        : scene::build_any_model(std::move(imported), options.ecol, progress, &built);
  report.ms.emplace_back("preprocess", watch.lap());
  report.open_vertices = built.open_vertices;
  line.clear();

  std::visit(
      [&](const auto& model) {
        report.objects = model.objects.size();
        report.meshes = model.meshes.size();
        for (const Object& object : model.objects) {
          const Mesh& mesh = model.meshes[object.mesh];
          report.model_vertices += mesh.max_vertices;
          report.model_triangles += triangles_at(mesh, model.map.data(), mesh.max_vertices);
        }
        show(options, model, window.get(), report);
      },
      any_model);
  std::fputs(to_table(report).c_str(), stdout);
}

int fail(std::string message, int code) {
  std::ranges::replace(message, '\n', ' ');
  std::fprintf(stderr, "pgl_viewer: %s\n", message.c_str());
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
