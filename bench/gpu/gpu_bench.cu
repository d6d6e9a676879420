// SPDX-License-Identifier: MIT
// The GPU drivers on the workload of Peng13 Table 4.5: times beside the copy bandwidth and the host's, bytes compared.
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>

#include "bench.cuh"
#include "device_scene.cuh"
#include "host_frame.hpp"
#include "rows.hpp"

namespace pgl::bench {
namespace {

constexpr const char* usage =
    "usage: gpu_bench [options]\n"
    "  --rows A,B         only rows whose names contain A or B\n"
    "  --objects N        objects of the plant (718000)\n"
    "  --budget N         vertices of a frame (10500000)\n"
    "  --unstitched       the plant as made, its faces not stitched together\n"
    "  --data FOLDER      real models (else the environment variable PGL_TEST_DATA)\n"
    "  --json FILE        write the rows as JSON, after every row\n"
    "  --table FILE       write them as a table, after every row\n"
    "  --context K=V      add to the JSON, e.g. commit=1234abc\n"
    "  --quick            few repetitions\n"
    "  --host-only        only the host's times; no GPU is needed\n"
    "Exits with 0, with 1 where something failed or differs, with 2 for impossible options, with 3 without a GPU.\n";

struct Usage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Arguments {
  BenchOptions bench;
  Workload workload;
  std::string data;
  std::vector<std::pair<std::string, std::string>> context;
  bool help = false;
};

std::uint64_t number(const std::string& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) throw Usage("not a number: " + text);
  return value;
}

Arguments parse(int argc, char** argv) {
  Arguments a;
  if (const char* folder = std::getenv("PGL_TEST_DATA")) a.data = folder;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const auto value = [&]() -> std::string {
      if (i + 1 >= argc) throw Usage(name + " needs a value");
      return argv[++i];
    };
    if (name == "--rows") {
      std::string list = value();
      for (std::size_t at = 0; at <= list.size();) {
        const std::size_t comma = std::min(list.find(',', at), list.size());
        if (comma > at) a.bench.filters.push_back(list.substr(at, comma - at));
        at = comma + 1;
      }
    } else if (name == "--objects") {
      a.workload.objects = number(value());
      if (a.workload.objects == 0 || a.workload.objects > 4000000) throw Usage("--objects: 1 to 4000000");
    } else if (name == "--budget") {
      a.workload.budget = number(value());
      if (a.workload.budget > 0xffffffffu) throw Usage("--budget: below 2^32");
    } else if (name == "--unstitched") {
      a.workload.stitched = false;
    } else if (name == "--data") {
      a.data = value();
    } else if (name == "--json") {
      a.bench.json = value();
    } else if (name == "--table") {
      a.bench.table = value();
    } else if (name == "--context") {
      const std::string pair = value();
      const std::size_t equals = pair.find('=');
      if (equals == std::string::npos) throw Usage("--context needs KEY=VALUE");
      a.context.emplace_back(pair.substr(0, equals), pair.substr(equals + 1));
    } else if (name == "--quick") {
      a.bench.quick = true;
    } else if (name == "--host-only") {
      a.bench.host_only = true;
    } else if (name == "--help") {
      a.help = true;
    } else {
      throw Usage("unknown option " + name);
    }
  }
  return a;
}

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

void describe(Bench& bench, const Arguments& arguments) {
  Report& report = bench.report;
  std::time_t now = std::time(nullptr);
  char date[16];
  std::strftime(date, sizeof date, "%Y-%m-%d", std::gmtime(&now));
  if (!bench.host_only()) {
    cudaDeviceProp properties{};
    must(cudaGetDeviceProperties(&properties, 0), "device");
    int toolkit = 0;
    must(cudaRuntimeGetVersion(&toolkit), "runtime");
    report.context.emplace_back("gpu", properties.name);
    report.context.emplace_back("compute_capability",
                                std::to_string(properties.major) + "." + std::to_string(properties.minor));
    report.context.emplace_back("toolkit", std::to_string(toolkit / 1000) + "." + std::to_string(toolkit % 1000 / 10));
    report.figures.emplace_back("gpu_multiprocessors", properties.multiProcessorCount);
    report.figures.emplace_back("gpu_l2_bytes", properties.l2CacheSize);
    report.figures.emplace_back("gpu_memory_bytes", static_cast<double>(properties.totalGlobalMem));
  }
  report.context.emplace_back("date", date);
  report.context.emplace_back("processor", processor());
  for (const auto& pair : arguments.context) report.context.push_back(pair);
  report.figures.emplace_back("host_cores", static_cast<double>(use_threads(0)));
}

Model make_model(Bench& bench, const Workload& workload) {
  const auto tell = [](const char* what, double ms) {
    std::fprintf(stderr, "gpu_bench: %s %.1f s\n", what, ms * 1e-3);
  };
  Stopwatch watch;
  Model model;
  model.meshes = make_plant(workload.objects, workload.stitched);
  tell("plant made in", watch.lap());
  model.order = room_for_order(model.meshes, model.meshes.ranges.size());
  watch.lap();
  order(model.meshes, {}, model.order);
  model.order_ms = watch.lap();
  tell("ordered in", model.order_ms);
  model.arranged = room_for_arranged(model.meshes);
  arrange(model.meshes, model.order, model.arranged);
  tell("arranged in", watch.lap());
  auto& figures = bench.report.figures;
  figures.emplace_back("objects", static_cast<double>(workload.objects));
  figures.emplace_back("stitched", workload.stitched ? 1 : 0);
  figures.emplace_back("model_vertices", static_cast<double>(model.meshes.positions.size()));
  figures.emplace_back("model_triangles", static_cast<double>(model.meshes.triangles.size()));
  return model;
}

int run(const Arguments& arguments) {
  // First of all: the importer works in a child process, which should not be forked from one that uses a GPU.
  auto scan = arguments.data.empty() ? std::nullopt : read_mesh(arguments.data + "/" + scan_file);
  int devices = 0;
  if (!arguments.bench.host_only && (cudaGetDeviceCount(&devices) != cudaSuccess || devices == 0)) {
    std::fputs("gpu_bench: no GPU, nothing was measured (--host-only measures the host)\n", stderr);
    return 3;
  }
  Bench bench(arguments.bench);
  describe(bench, arguments);
  int failed = 0;
  try {
    bench.copy();
    Model model = make_model(bench, arguments.workload);
    model.scan = std::move(scan);
    {
      const Scene scene = scene_of(model.meshes, model.order, model.arranged, arguments.workload.objects);
      const DeviceScene device_scene(bench, scene);
      frame_rows(bench, scene, device_scene, arguments.workload);
      occlusion_rows(bench, scene, device_scene, arguments.workload);
      balance_rows(bench, scene, arguments.workload);
      stream_rows(bench, scene, device_scene, arguments.workload);
      path_rows(bench, scene, device_scene, arguments.workload);
    }
    rearrange_rows(bench, model);
    ecol_rows(bench, model, arguments.workload);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "gpu_bench: %s\n", error.what());
    bench.report.context.emplace_back("stopped", error.what());
    failed = 1;
  }
  bench.save();
  std::fputs(to_table(bench.report).c_str(), stdout);
  if (bench.failures() > 0) std::fprintf(stderr, "gpu_bench: %d rows failed\n", bench.failures());
  return failed != 0 || bench.failures() > 0 ? 1 : 0;
}

}  // namespace
}  // namespace pgl::bench

int main(int argc, char** argv) {
  using namespace pgl::bench;
  Arguments arguments;
  try {
    arguments = parse(argc, argv);
  } catch (const Usage& error) {
    std::fprintf(stderr, "gpu_bench: %s\n%s", error.what(), usage);
    return 2;
  }
  if (arguments.help) {
    std::fputs(usage, stdout);
    return 0;
  }
  try {
    return run(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "gpu_bench: %s\n", error.what());
    return 1;
  }
}
