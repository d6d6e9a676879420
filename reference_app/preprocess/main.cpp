// SPDX-License-Identifier: MIT
// pgl_preprocess: models go in, one .pgl file comes out, whole or not at all, in bounded memory.
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#if defined(_OPENMP)
#include <omp.h>
#endif

#include "pgl/bounds.hpp"
#include "preprocess/inputs.hpp"
#include "preprocess/options.hpp"
#include "scene/build_model.hpp"
#include "scene/build_plant.hpp"
#include "scene/error.hpp"
#include "scene/import.hpp"
#include "scene/model_file.hpp"
#include "scene/progress_line.hpp"
#include "scene/tell.hpp"
#include "scene/warehouse.hpp"

namespace pgl::preprocess {

namespace {

namespace fs = std::filesystem;
using scene::grouped;

// ---- being asked to stop --------------------------------------------------------------------------------------------

volatile std::sig_atomic_t stop_signal = 0;

/// Thrown where the work may end; what is on the way then leaves nothing behind.
struct Stopped {};

/// SIGINT, SIGTERM and SIGHUP only leave a note, unless the caller has them ignored. A full disk, or a limit to what
/// may be written, is an error of write() and no signal.
void watch_signals() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction before {};
    if (sigaction(signal, nullptr, &before) == 0 && before.sa_handler == SIG_IGN) continue;
    struct sigaction action {};
    action.sa_handler = [](int which) { stop_signal = which; };
    sigemptyset(&action.sa_mask);
    sigaction(signal, &action, nullptr);
  }
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

// ---- what is told ---------------------------------------------------------------------------------------------------

class Teller {
 public:
  /// Said after the stage, e.g. ", file 3 of 7".
  std::string where;

  scene::Progress progress() {
    return [this](std::string_view stage, std::size_t done, std::size_t total) {
      if (stop_signal != 0) throw Stopped();
      line_(std::string(stage) + where, done, total);
    };
  }
  void warn(const std::string& warning) {
    line_.clear();
    scene::tell("pgl_preprocess", warning);
  }
  void clear() { line_.clear(); }

 private:
  scene::ProgressLine line_;
};

void row(const char* name, const std::string& value) {
  std::printf("%-14s %20s\n", name, value.c_str());
}
void row(const char* name, std::uint64_t value) {
  row(name, grouped(value));
}
void row_seconds(const char* name, double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", seconds);
  row(name, text);
}

/// The file in numbers. Opens it, which looks at its first page only.
void print_file(const std::string& path) {
  const auto start = std::chrono::steady_clock::now();
  const scene::ModelFile file(path);
  const std::chrono::duration<double, std::micro> opened = std::chrono::steady_clock::now() - start;
  row("objects", file.objects());
  row("meshes", file.meshes());
  row("vertices", file.vertices());
  row("triangles", file.triangles());
  row("errors", file.has_errors() ? "recorded" : "none");
  row("index", file.wide() ? "32 bits" : "16 bits");
  constexpr std::array<const char*, 4> up = {"not told", "x", "y", "z"};
  row("up", up.at(static_cast<std::size_t>(file.up())));
  row("bytes", file.bytes());
  row("opened in", grouped(static_cast<std::uint64_t>(opened.count())) + " us");
}

// ---- the work -------------------------------------------------------------------------------------------------------

/// Adds times of several kinds up.
class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    return std::chrono::duration<double>(now - std::exchange(last_, now)).count();
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

struct Totals {
  scene::BuildReport built;
  double import = 0.0, build = 0.0, write = 0.0;  ///< seconds
};

/// One input file in the model.
struct Part {
  std::size_t end;  ///< its last object, and one
  Box box;
};

void append(const scene::AnyModel& model, scene::ModelFileWriter& writer) {
  std::visit([&](const auto& part) { writer.append(part); }, model);
}

/// Reads a file. A small one on one thread: others would have little to do but to wait, which costs more.
scene::Scene read_model(const fs::path& file, const scene::ImportOptions& options, const scene::Progress& progress,
                        scene::ImportReport& report) {
#if defined(_OPENMP)
  constexpr std::uintmax_t small = std::uintmax_t{4} << 20;  // bytes
  struct Threads {
    int before = omp_get_max_threads();
    ~Threads() { omp_set_num_threads(before); }
  } threads;
  std::error_code unknown;
  if (fs::file_size(file, unknown) < small) omp_set_num_threads(1);
#endif
  return scene::import_scene(file, options, progress, &report);
}

/// Small files are built together, so that all cores have work, and large ones alone.
void build_files(const Options& options, const std::vector<fs::path>& files, scene::ModelFileWriter& writer,
                 Teller& teller, Totals& totals) {
  const scene::Progress progress = teller.progress();
  std::vector<Part> parts;  // of all files so far
  std::size_t parts_built = 0, objects_built = 0;
  scene::Scene batch;
  std::size_t batch_triangles = 0;

  const auto build_batch = [&] {
    Stopwatch watch;
    const scene::AnyModel model =
        scene::build_any_model(std::exchange(batch, {}), options.ecol, progress, &totals.built, options.errors);
    totals.build += watch.lap();
    append(model, writer);
    totals.write += watch.lap();
    const auto& boxes = std::visit([](const auto& m) -> const std::vector<Box>& { return m.object_boxes; }, model);
    std::size_t object = objects_built;
    for (; parts_built < parts.size(); ++parts_built) {
      Part& part = parts[parts_built];
      for (; object < part.end; ++object) part.box = merge(part.box, boxes[object - objects_built]);
    }
    objects_built = object;
    batch_triangles = 0;
  };

  for (std::size_t f = 0; f < files.size(); ++f) {
    if (files.size() > 1) teller.where = ", file " + grouped(f + 1) + " of " + grouped(files.size());
    Stopwatch watch;
    scene::ImportReport report;
    scene::Scene scene = read_model(files[f], options.import, progress, report);
    for (const std::string& warning : report.warnings) teller.warn(warning);
    std::size_t triangles = 0;
    for (const scene::MeshData& mesh : scene.meshes) triangles += mesh.triangles.size();
    totals.import += watch.lap();

    if (batch_triangles != 0 && batch_triangles + triangles > options.batch) build_batch();
    const auto first_mesh = static_cast<std::uint32_t>(batch.meshes.size());
    for (Object& object : scene.objects) object.mesh += first_mesh;
    std::ranges::move(scene.meshes, std::back_inserter(batch.meshes));
    std::ranges::move(scene.objects, std::back_inserter(batch.objects));
    batch_triangles += triangles;
    parts.push_back({objects_built + batch.objects.size(), {}});
  }
  build_batch();
  teller.where.clear();

  if (options.warehouse) {
    std::vector<Box> boxes(parts.size());
    std::ranges::transform(parts, boxes.begin(), &Part::box);
    const std::vector<glm::vec3> moves = scene::lay_out_warehouse(boxes);
    const std::span<Object> objects = writer.objects();
    std::size_t object = 0;
    for (std::size_t p = 0; p < parts.size(); ++p) {
      for (; object < parts[p].end; ++object) {
        glm::vec3& place = objects[object].transform[3];
        place += moves[p];
        if (!std::isfinite(place.x + place.y + place.z)) {
          throw scene::Error("--warehouse", "the parts are too large to be laid out side by side");
        }
      }
    }
  }
}

void build_plant(const Options& options, scene::ModelFileWriter& writer, Teller& teller, Totals& totals) {
  const scene::Progress progress = teller.progress();
  const std::size_t all = options.plant.objects;
  for (std::size_t first = 0; first < all;) {
    std::size_t end = first, triangles = 0;
    do triangles += scene::plant_object_size(options.plant, end++).triangles;
    while (end < all && triangles < options.batch);
    teller.where = end - first < all ? ", object " + grouped(first + 1) + " of " + grouped(all) : std::string();
    Stopwatch watch;
    const scene::AnyModel model = scene::build_plant(options.plant, first, end - first, options.import.weld,
                                                     options.ecol, progress, &totals.built, options.errors);
    first = end;
    totals.build += watch.lap();
    append(model, writer);
    totals.write += watch.lap();
  }
  teller.where.clear();
}

void build(const Options& options, Teller& teller) {
  Stopwatch whole;
  const std::vector<fs::path> files = expand_inputs(options.inputs);
  Totals totals;
  {
    scene::ModelFileWriter writer(options.file);  // first, so that hours of work are not for nothing
    if (options.inputs.empty()) {
      build_plant(options, writer, teller, totals);
    } else {
      build_files(options, files, writer, teller, totals);
    }
    writer.set_up(options.up);
    Stopwatch watch;
    writer.finish(teller.progress());
    totals.write += watch.lap();
  }
  teller.clear();

  if (!options.inputs.empty()) row("files", files.size());
  print_file(options.file);
  row("open vertices", totals.built.open_vertices);
  if (!options.inputs.empty()) row_seconds("import", totals.import);
  row_seconds("build", totals.build);
  row_seconds("write", totals.write);
  row_seconds("whole", whole.lap());
  rusage own{}, readers{};
  getrusage(RUSAGE_SELF, &own);
  getrusage(RUSAGE_CHILDREN, &readers);
  row("peak memory", grouped(static_cast<std::uint64_t>(own.ru_maxrss) / 1024) + " MiB");
  if (!options.inputs.empty()) {
    row("peak of reader", grouped(static_cast<std::uint64_t>(readers.ru_maxrss) / 1024) + " MiB");
  }
}

void run(const Options& options, Teller& teller) {
#if defined(_OPENMP)
  if (options.threads > 0) omp_set_num_threads(options.threads);
#endif
  switch (options.task) {
    case Task::build:
      return build(options, teller);
    case Task::info:
      return print_file(options.file);
    case Task::verify: {
      scene::ModelFile file(options.file);
      file.verify(teller.progress());
      teller.clear();
      std::printf("%s: all %s bytes are as they were written\n", options.file.c_str(), grouped(file.bytes()).c_str());
      return;
    }
  }
}

int fail(const char* message, int code) {
  scene::tell("pgl_preprocess", message);
  return code;
}

}  // namespace

}  // namespace pgl::preprocess

/// Exit codes: 0 done, 1 failed, 2 impossible options; 128 and the signal's number when it was asked to stop.
int main(int argc, char** argv) {
  using namespace pgl::preprocess;
  std::optional<Options> options;
  try {
    options = parse_options(argc, argv);
  } catch (const std::exception& error) {
    return fail(error.what(), 2);
  }
  if (!options) return 0;
  watch_signals();
  Teller teller;
  const auto stopped_or = [&](const char* message) {
    teller.clear();
    if (const int signal = stop_signal; signal != 0) {
      return fail(options->task == Task::build ? "stopped; nothing was written" : "stopped", 128 + signal);
    }
    return fail(message, 1);
  };
  try {
    run(*options, teller);
    return 0;
  } catch (const Stopped&) {
    return stopped_or("stopped");
  } catch (const std::bad_alloc&) {
    return stopped_or("not enough memory");
  } catch (const std::exception& error) {
    return stopped_or(error.what());
  }
}
