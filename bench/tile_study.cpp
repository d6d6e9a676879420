// SPDX-License-Identifier: MIT
// What tiles cost and what they even out, on the plant: selection with a thread for each tile against one selection on
// all threads ([NC07] Table 1), static against dynamic tiles on a flight while a simulated GPU is slow (Table 2), what
// bins and thresholds of balance are worth, and how much of a plant that grows with the GPUs is drawn more than once.
// One CSV row each; scripts/tiles.py makes the tables and pictures of them.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "pgl/feedback.hpp"
#include "pgl/host/adapt_tiles.hpp"
#include "pgl/host/balance.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/select_by_error.hpp"
#include "scene/build_plant.hpp"
#include "timing.hpp"
#include "viewer/camera.hpp"

namespace {

using pgl::Tile;
using pgl::UnifyPolicy;
using pgl::View;
using Counts = std::vector<std::uint32_t>;
using Flags = std::vector<std::uint8_t>;

constexpr std::uint32_t width = 1920, height = 1080;
constexpr std::uint64_t budget_per_object = 15;  // vertices: 10.8 million for the plant of 718,000
constexpr double aspect = static_cast<double>(width) / height;
const glm::dvec3 up(0.0, 0.0, 1.0);

/// A row of the table: what a column of it holds.
void print_row(const std::map<std::string_view, std::string>& cells) {
  constexpr std::string_view columns[] = {
      "table",     "objects",  "frames",     "gpus",     "threads",   "mode",         "slow",          "bins",
      "lbt",       "frame",    "in_view",    "touching", "shared",    "drawn",        "drawn_unified", "budget",
      "vertices",  "selected", "in_tiles",   "unified",  "triangles", "triangles_in", "largest",       "ms",
      "ms_plain",  "ms_mean",  "ms_worst",   "late",     "recover",   "imbalance",    "more",          "ms_grid",
      "ms_static", "ms_even",  "ms_dynamic", "ms_ideal"};
  std::size_t found = 0;
  for (const std::string_view column : columns) {
    const auto cell = cells.find(column);
    found += cell != cells.end() ? 1 : 0;
    std::printf("%s%s", column == columns[0] ? "" : ",",
                cells.empty()         ? std::string(column).c_str()
                : cell != cells.end() ? cell->second.c_str()
                                      : "");
  }
  std::printf("\n");
  std::fflush(stdout);
  if (found != cells.size()) throw std::logic_error("a cell without a column");
}

std::string text(std::uint64_t value) {
  return std::to_string(value);
}
std::string text(double value, int digits = 4) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.*f", digits, value);
  return buffer;
}

/// Milliseconds of body(): the least of some.
template <class Body>
double least_ms(int repetitions, Body&& body) {
  return pgl::bench::least_shared_ms(repetitions, pgl::host::thread_count(), body);
}

// ---- a frame of the plant -------------------------------------------------------------------------------------------

/// What a selection needs of a model, without its vertices and triangles.
class Plant {
 public:
  Plant(std::size_t objects, bool with_errors) {
    auto built = pgl::scene::build_plant({objects, 1}, 0, objects, true, {.boundary = pgl::BoundaryRule::slide}, {},
                                         nullptr, with_errors);
    std::visit(
        [&](auto& model) {
          meshes = std::move(model.meshes);
          map = std::move(model.map);
          errors = std::move(model.errors);
          boxes = std::move(model.object_boxes);
          for (const pgl::Object& object : model.objects) mesh_of_object.push_back(object.mesh);
          scales.resize(objects);
          pgl::host::error_scales(model.objects, scales);
        },
        built);
    for (const pgl::Box& b : boxes) {
      box.min = glm::min(box.min, b.min);
      box.max = glm::max(box.max, b.max);
    }
    least.resize(objects);
    most.resize(objects);
    pgl::host::vertex_limits(mesh_of_object, meshes, map, 0, least, most);
  }

  std::size_t size() const { return boxes.size(); }

  pgl::Box box;
  std::vector<pgl::Mesh> meshes;
  Counts map, mesh_of_object, least, most;
  std::vector<float> errors, scales;
  std::vector<pgl::Box> boxes;
};

/// What a frame selects, and what it knows of where objects are.
class Frame {
 public:
  explicit Frame(const Plant& plant)
      : areas(plant.size()),
        depths(plant.size()),
        rectangles(plant.size()),
        counts(plant.size()),
        loads(plant.size()),
        plant_(plant),
        in_view_(plant.size()) {}

  /// At a time of the flight, see pgl::viewer::fly.
  void look(double time) { look(pgl::viewer::fly(plant_.box, up, 45.0, aspect, time)); }

  /// From around, the whole plant in the picture.
  void look_around(double time) {
    const double angle = 2.0 * glm::pi<double>() * time;
    look(pgl::viewer::fit_camera(plant_.box, {std::cos(angle), std::sin(angle), 0.5}, up, 45.0, aspect));
  }

  void look(const pgl::viewer::Camera& camera) {
    view = pgl::viewer::view_of(camera, plant_.box, width, height);
    pgl::host::cull_frustum(plant_.boxes, view, in_view_);
    pgl::host::project(plant_.boxes, in_view_, view, areas, depths, rectangles);
    in_view = static_cast<std::size_t>(std::ranges::count(in_view_, 1));
    options.near_depth = view.near_depth;
    options.viewport_area = view.width * view.height;
  }

  /// One selection for the whole picture, and its triangles as loads.
  void select(std::uint64_t budget) {
    options.budget = budget;
    totals = pgl::host::distribute_budget(areas, depths, plant_.least, plant_.most, options, workspace_, counts);
    find_loads();
  }
  void select_by_error() {
    totals = pgl::host::select_by_error(areas, depths, plant_.least, plant_.most, plant_.scales, plant_.mesh_of_object,
                                        plant_.meshes, plant_.errors, view, {}, counts);
    find_loads();
  }

  View view;
  pgl::BudgetOptions options;
  std::size_t in_view = 0;
  std::vector<float> areas, depths;
  std::vector<pgl::ScreenBox> rectangles;
  Counts counts, loads;
  pgl::BudgetTotals totals;
  std::uint64_t triangles = 0;

 private:
  void find_loads() {
    triangles = 0;
    for (std::size_t i = 0; i < counts.size(); ++i)
      triangles += loads[i] = pgl::triangles_at(plant_.meshes[plant_.mesh_of_object[i]], plant_.map.data(), counts[i]);
  }

  const Plant& plant_;
  Flags in_view_;
  pgl::host::BudgetWorkspace workspace_;
};

/// Tiles and the triangles of each.
struct Split {
  explicit Split(std::size_t gpus) : tiles(gpus), loads(gpus) {}

  void balance(const Frame& frame, std::span<const std::uint32_t> weights, const pgl::BalanceOptions& options = {}) {
    pgl::host::balance(frame.rectangles, frame.loads, width, height, weights, options, workspace, tiles, loads);
  }

  /// Equal rectangles: twice as many columns as rows, or as many.
  void grid() {
    std::uint32_t rows = 1;
    while (4 * rows * rows <= tiles.size()) rows *= 2;
    const auto across = static_cast<std::uint32_t>(tiles.size()) / rows;
    for (std::uint32_t k = 0; k < tiles.size(); ++k) {
      const std::uint32_t x = k % across, y = k / across;
      tiles[k] = {width * x / across, height * y / rows, width * (x + 1) / across, height * (y + 1) / rows};
    }
  }

  void find_loads(const Frame& frame) {
    for (std::size_t k = 0; k < tiles.size(); ++k) {
      loads[k] = 0;
      for (std::size_t i = 0; i < frame.loads.size(); ++i)
        if (pgl::is_in_tile(frame.rectangles[i], frame.loads[i], tiles[k])) loads[k] += frame.loads[i];
    }
  }

  std::uint64_t sum() const {
    std::uint64_t all = 0;
    for (const std::uint64_t load : loads) all += load;
    return all;
  }
  std::uint64_t largest() const { return *std::ranges::max_element(loads); }

  std::vector<Tile> tiles;
  std::vector<std::uint64_t> loads;
  pgl::host::BalanceWorkspace workspace;
};

Counts equal_weights(std::size_t gpus) {
  return Counts(gpus, pgl::full_weight);
}

/// How much the largest of some is above their mean, 0 for equal ones.
template <class Numbers>
double imbalance_of(const Numbers& numbers) {
  double sum = 0.0, largest = 0.0;
  for (const auto& number : numbers) {
    sum += static_cast<double>(number);
    largest = std::max(largest, static_cast<double>(number));
  }
  return sum > 0.0 ? largest / (sum / static_cast<double>(std::size(numbers))) - 1.0 : 0.0;
}

// ---- [NC07] Table 1: adapt tiles ------------------------------------------------------------------------------------

/// What one tile writes to when it selects.
struct TileScratch {
  std::vector<float> areas;
  pgl::host::BudgetWorkspace workspace;
};

void study_adapt(const Plant& plant, int cameras) {
  const std::size_t n = plant.size();
  const std::uint64_t budget = budget_per_object * n;
  Frame frame(plant);
  Counts unified(n), drawn(n);
  for (const std::string_view mode : {"quality", "exact", "fair"})
    for (const std::size_t tiles : {1u, 2u, 4u})
      for (const std::size_t threads : {1u, 2u, 4u}) {
        if (threads > tiles) continue;
        const bool quality = mode == "quality";
        const UnifyPolicy policy = quality ? UnifyPolicy::quality : UnifyPolicy::performance;
        frame.options.policy = mode == "fair" ? pgl::BudgetPolicy::fair : pgl::BudgetPolicy::exact;
        pgl::bench::set_threads(static_cast<std::int64_t>(threads));
        double ms = 0, ms_plain = 0;
        std::uint64_t in_view = 0, touching = 0, shared = 0, vertices = 0, in_tiles = 0, in_picture = 0;
        std::uint64_t plain_drawn = 0, unified_drawn = 0, selected = 0;
        std::vector<TileScratch> scratch(tiles);
        for (TileScratch& own : scratch) own.areas.resize(n);
        pgl::host::AdaptWorkspace workspace;
        for (int camera = 0; camera < cameras; ++camera) {
          frame.look((camera + 0.5) / cameras);
          const auto plain = [&] { quality ? frame.select_by_error() : frame.select(budget); };
          plain();
          Split split(tiles);
          split.balance(frame, equal_weights(tiles));
          const auto select = [&](std::size_t tile, std::span<const std::uint8_t> flags, std::span<std::uint32_t> out) {
            TileScratch& own = scratch[tile];
            for (std::size_t i = 0; i < n; ++i) own.areas[i] = flags[i] != 0 ? frame.areas[i] : 0.0f;
            if (quality) {
              pgl::host::select_by_error(own.areas, frame.depths, plant.least, plant.most, plant.scales,
                                         plant.mesh_of_object, plant.meshes, plant.errors, frame.view, {}, out);
            } else {
              pgl::BudgetOptions options = frame.options;
              options.budget = budget / tiles;
              pgl::host::distribute_budget(own.areas, frame.depths, plant.least, plant.most, options, own.workspace,
                                           out);
            }
          };
          const auto adapt = [&] {
            return pgl::host::adapt_tiles(frame.rectangles, split.tiles, policy, workspace, select, unified);
          };
          const pgl::BudgetTotals totals = adapt();
          pgl::host::BudgetWorkspace plain_workspace;
          // In turn, so that what else the machine does meets both.
          double least[2] = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
          for (int repetition = 0; repetition < 15; ++repetition) {
            least[0] = std::min(least[0], least_ms(1, adapt));
            least[1] = std::min(least[1], least_ms(1, [&] {
                                  if (quality)
                                    pgl::host::select_by_error(frame.areas, frame.depths, plant.least, plant.most,
                                                               plant.scales, plant.mesh_of_object, plant.meshes,
                                                               plant.errors, frame.view, {}, drawn);
                                  else
                                    pgl::host::distribute_budget(frame.areas, frame.depths, plant.least, plant.most,
                                                                 frame.options, plain_workspace, drawn);
                                }));
          }
          ms += least[0];
          ms_plain += least[1];
          if ((quality || tiles == 1) && unified != frame.counts)
            throw std::runtime_error("tiles select something else than the whole picture does");
          in_view += frame.in_view;
          vertices += frame.totals.vertices;
          in_picture += totals.vertices;
          plain_drawn += frame.totals.objects;
          unified_drawn += totals.objects;
          for (std::size_t k = 0; k < tiles * n; ++k) selected += workspace.flags[k] != 0 ? workspace.counts[k] : 0;
          for (std::size_t i = 0; i < n; ++i) {
            std::size_t in = 0;
            for (std::size_t k = 0; k < tiles; ++k) in += workspace.flags[k * n + i];
            touching += in > 0 ? 1 : 0;
            shared += in > 1 ? 1 : 0;
          }
          for (std::size_t k = 0; k < tiles; ++k) {
            const std::uint64_t own =
                pgl::host::take_unified(std::span(workspace.counts).subspan(k * n, n),
                                        std::span(workspace.flags).subspan(k * n, n), unified, drawn)
                    .vertices;
            if (!quality && own > budget / tiles) throw std::runtime_error("a tile draws more than its budget");
            in_tiles += own;
          }
        }
        print_row({{"table", "adapt"},
                   {"objects", text(n)},
                   {"frames", text(static_cast<std::uint64_t>(cameras))},
                   {"gpus", text(tiles)},
                   {"threads", text(threads)},
                   {"mode", std::string(mode)},
                   {"in_view", text(in_view)},
                   {"touching", text(touching)},
                   {"shared", text(shared)},
                   {"budget", quality ? "" : text(budget * static_cast<std::uint64_t>(cameras))},
                   {"vertices", text(vertices)},
                   {"drawn", text(plain_drawn)},
                   {"drawn_unified", text(unified_drawn)},
                   {"selected", text(selected)},
                   {"in_tiles", text(in_tiles)},
                   {"unified", text(in_picture)},
                   {"ms", text(ms / cameras)},
                   {"ms_plain", text(ms_plain / cameras)}});
      }
  pgl::bench::set_threads(0);
}

// ---- [NC07] Table 2: static and dynamic tiles -----------------------------------------------------------------------

constexpr double ms_per_triangle = 50e-6;  ///< of a simulated GPU at full speed
constexpr double ms_constant = 0.5;        ///< and what a frame takes it without a triangle
constexpr double noise = 0.05;             ///< measured times are off by up to this part of them

enum Method { grid, fixed, even, dynamic, ideal };
constexpr std::string_view method_names[] = {"grid", "static", "even", "dynamic", "ideal"};

/// One run along the flight: so many GPUs, the first of which becomes slow at a frame.
struct Run {
  Run(std::size_t count, double factor) : gpus(count), slow(factor), weights(equal_weights(count)) {
    for (const std::string_view name : method_names) {
      (void)name;
      splits.emplace_back(count);
    }
    splits[grid].grid();
  }

  void draw(const Frame& frame, bool first, bool is_slow) {
    std::vector<double> speeds(gpus, 1.0);
    if (is_slow) speeds[0] = 1.0 / slow;
    Counts known = equal_weights(gpus);
    known[0] = static_cast<std::uint32_t>(static_cast<double>(known[0]) * speeds[0]);
    if (first) splits[fixed].balance(frame, equal_weights(gpus));
    splits[grid].find_loads(frame);
    splits[fixed].find_loads(frame);
    splits[even].balance(frame, equal_weights(gpus));
    splits[dynamic].balance(frame, weights);
    splits[ideal].balance(frame, known);
    for (std::size_t m = 0; m < splits.size(); ++m) {
      std::vector<double> gpu_ms;
      for (std::size_t gpu = 0; gpu < gpus; ++gpu)
        gpu_ms.push_back(static_cast<double>(splits[m].loads[gpu]) * ms_per_triangle / speeds[gpu] + ms_constant);
      ms[m].push_back(*std::ranges::max_element(gpu_ms));
      imbalance[m].push_back(imbalance_of(gpu_ms));
      if (m != dynamic) continue;
      std::vector<float> measured;
      for (const double t : gpu_ms)
        measured.push_back(static_cast<float>(t * (1.0 + noise * (static_cast<double>(random() % 2001) / 1e3 - 1.0))));
      pgl::next_weights(feedback, measured, splits[m].loads, {}, weights);
    }
  }

  std::size_t gpus;
  double slow;
  Counts weights;
  std::vector<Split> splits;
  std::vector<double> ms[std::size(method_names)], imbalance[std::size(method_names)];
  pgl::WeightFeedback feedback;
  std::mt19937 random{1};
};

void study_flight(const Plant& plant, int frames) {
  std::vector<Run> runs;
  runs.emplace_back(1, 1.0);
  for (const std::size_t gpus : {2u, 4u, 8u})
    for (const double slow : {1.0, 2.0, 4.0}) runs.emplace_back(gpus, slow);
  Frame frame(plant);
  const int event = frames / 3;
  for (int f = 0; f < frames; ++f) {
    frame.look(static_cast<double>(f) / std::max(1, frames - 1));
    frame.select(budget_per_object * plant.size());
    for (Run& run : runs) run.draw(frame, f == 0, f >= event);
  }
  for (const Run& run : runs)
    for (std::size_t m = 0; m < run.splits.size(); ++m) {
      double sum = 0, worst = 0, imbalance = 0;
      std::uint64_t late = 0;
      int in_time = 0;  // frames in a row
      std::optional<int> recovered;
      for (int f = event; f < frames; ++f) {
        const auto at = static_cast<std::size_t>(f);
        sum += run.ms[m][at];
        worst = std::max(worst, run.ms[m][at]);
        imbalance += run.imbalance[m][at];
        const bool is_late = run.ms[m][at] > 1.1 * run.ms[ideal][at];
        late += is_late ? 1 : 0;
        in_time = is_late ? 0 : in_time + 1;
        if (!recovered && in_time == 10) recovered = f - event - 9;
      }
      print_row({{"table", "flight"},
                 {"objects", text(plant.size())},
                 {"frames", text(static_cast<std::uint64_t>(frames - event))},
                 {"frame", text(static_cast<std::uint64_t>(event))},
                 {"gpus", text(run.gpus)},
                 {"slow", text(run.slow, 0)},
                 {"mode", std::string(method_names[m])},
                 {"ms_mean", text(sum / (frames - event))},
                 {"ms_worst", text(worst)},
                 {"late", text(late)},
                 {"recover", recovered ? text(static_cast<std::uint64_t>(*recovered)) : ""},
                 {"imbalance", text(imbalance / (frames - event))}});
    }
  for (const Run& run : runs) {
    if (run.gpus != 4 || run.slow != 2.0) continue;
    for (std::size_t f = 0; f < run.ms[grid].size(); ++f)
      print_row({{"table", "frame"},
                 {"frame", text(f)},
                 {"gpus", text(run.gpus)},
                 {"slow", text(run.slow, 0)},
                 {"ms_grid", text(run.ms[grid][f], 3)},
                 {"ms_static", text(run.ms[fixed][f], 3)},
                 {"ms_even", text(run.ms[even][f], 3)},
                 {"ms_dynamic", text(run.ms[dynamic][f], 3)},
                 {"ms_ideal", text(run.ms[ideal][f], 3)}});
  }
}

// ---- the trade ------------------------------------------------------------------------------------------------------

void study_trade(const Plant& plant, int cameras) {
  std::vector<pgl::BalanceOptions> ways;
  for (const std::uint32_t bins : {0u, 8u, 32u, 128u, 512u}) ways.push_back({.bins = bins});
  for (const float lbt : {0.0f, 0.01f, 0.03f, 0.1f, 0.3f})
    ways.push_back({.policy = pgl::BalancePolicy::bisection, .threshold = lbt});
  pgl::bench::set_threads(1);
  Frame frame(plant);
  for (const std::size_t gpus : {2u, 4u, 16u, 64u}) {
    std::vector<double> ms(ways.size()), imbalance(ways.size()), more(ways.size());
    for (int camera = 0; camera < cameras; ++camera) {
      frame.look((camera + 0.5) / cameras);
      frame.select(budget_per_object * plant.size());
      Split split(gpus);
      const Counts weights = equal_weights(gpus);
      std::vector<double> least(ways.size(), std::numeric_limits<double>::infinity());
      for (int repetition = 0; repetition < 7; ++repetition)
        for (std::size_t w = 0; w < ways.size(); ++w)
          least[w] = std::min(least[w], least_ms(1, [&] { split.balance(frame, weights, ways[w]); }));
      for (std::size_t w = 0; w < ways.size(); ++w) {
        split.balance(frame, weights, ways[w]);
        ms[w] += least[w];
        imbalance[w] += imbalance_of(split.loads);
        more[w] += static_cast<double>(split.sum()) / static_cast<double>(frame.triangles) - 1.0;
      }
    }
    for (std::size_t w = 0; w < ways.size(); ++w) {
      const bool bisection = ways[w].policy == pgl::BalancePolicy::bisection;
      print_row({{"table", "trade"},
                 {"objects", text(plant.size())},
                 {"frames", text(static_cast<std::uint64_t>(cameras))},
                 {"gpus", text(gpus)},
                 {"threads", "1"},
                 {"mode", bisection ? "bisection" : "histogram"},
                 {"bins", bisection ? "" : text(std::uint64_t{ways[w].bins})},
                 {"lbt", bisection ? text(static_cast<double>(ways[w].threshold), 2) : ""},
                 {"ms", text(ms[w] / cameras)},
                 {"imbalance", text(imbalance[w] / cameras)},
                 {"more", text(more[w] / cameras)}});
    }
  }
  pgl::bench::set_threads(0);
}

// ---- growth ---------------------------------------------------------------------------------------------------------

void study_growth(std::size_t objects_per_gpu, std::size_t most_gpus, int cameras) {
  for (std::size_t gpus = 1; gpus <= most_gpus; gpus *= 2) {
    const Plant plant(objects_per_gpu * gpus, false);
    Frame frame(plant);
    Split split(gpus);
    for (const bool around : {true, false}) {
      std::uint64_t in_view = 0, drawn = 0, shared = 0, vertices = 0, triangles = 0, in_tiles = 0, largest = 0;
      for (int camera = 0; camera < cameras; ++camera) {
        const double time = (camera + 0.5) / cameras;
        around ? frame.look_around(time) : frame.look(time);
        frame.select(budget_per_object * plant.size());
        split.balance(frame, equal_weights(gpus));
        in_view += frame.in_view;
        drawn += frame.totals.objects;
        vertices += frame.totals.vertices;
        triangles += frame.triangles;
        in_tiles += split.sum();
        largest += split.largest();
        for (std::size_t i = 0; i < plant.size(); ++i)
          shared += std::ranges::count_if(split.tiles,
                                          [&](const Tile& tile) {
                                            return pgl::is_in_tile(frame.rectangles[i], frame.loads[i], tile);
                                          }) > 1
                        ? 1
                        : 0;
      }
      print_row({{"table", "growth"},
                 {"objects", text(plant.size())},
                 {"frames", text(static_cast<std::uint64_t>(cameras))},
                 {"gpus", text(gpus)},
                 {"mode", around ? "around" : "flight"},
                 {"in_view", text(in_view)},
                 {"drawn", text(drawn)},
                 {"shared", text(shared)},
                 {"budget", text(budget_per_object * plant.size() * static_cast<std::uint64_t>(cameras))},
                 {"vertices", text(vertices)},
                 {"triangles", text(triangles)},
                 {"triangles_in", text(in_tiles)},
                 {"largest", text(largest)}});
    }
    std::fprintf(stderr, "growth: %zu GPUs\n", gpus);
  }
}

/// The whole text as a number from 1 to `most`.
std::size_t number(std::string_view words, std::size_t most) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(words.data(), words.data() + words.size(), value);
  if (error != std::errc{} || end != words.data() + words.size() || value < 1 || value > most)
    throw std::runtime_error("'" + std::string(words) + "' is not a number from 1 to " + std::to_string(most));
  return value;
}

}  // namespace

int main(int argc, char** argv) try {
  std::size_t objects = 20000, per_gpu = 4000, gpus = 64, frames = 300, cameras = 12;
  const std::map<std::string_view, std::size_t*> options = {{"--objects", &objects},
                                                            {"--per-gpu", &per_gpu},
                                                            {"--gpus", &gpus},
                                                            {"--frames", &frames},
                                                            {"--cameras", &cameras}};
  for (int i = 1; i < argc; ++i) {
    const auto option = options.find(argv[i]);
    if (option == options.end() || i + 1 == argc) {
      std::fprintf(stderr,
                   "usage: tile_study [--objects N] [--per-gpu N] [--gpus N] [--frames N] [--cameras N]\n"
                   "The plant of so many objects, and one that grows with the number of GPUs; so many frames on a\n"
                   "flight through it, and so many cameras on that for the rest.\n");
      return 2;
    }
    *option->second = number(argv[++i], option->first == "--gpus" ? 64 : 1u << 20);
  }
  print_row({});
  const Plant plant(objects, true);
  study_adapt(plant, static_cast<int>(cameras));
  study_flight(plant, static_cast<int>(frames));
  study_trade(plant, static_cast<int>(cameras));
  study_growth(per_gpu, gpus, static_cast<int>(cameras));
} catch (const std::exception& e) {
  std::fprintf(stderr, "tile_study: %s\n", e.what());
  return 1;
}
