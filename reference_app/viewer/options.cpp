// SPDX-License-Identifier: MIT
// What the command line of pgl_viewer asks for.
#include "viewer/options.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>

#include "scene/command_line.hpp"
#include "viewer/cuda_frame.hpp"
#include "viewer/output.hpp"

namespace pgl::viewer {

using scene::number;
using scene::OptionList;
using scene::refuse;
using scene::refuse_given;

namespace {

std::vector<std::string_view> cut(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(separator, at), text.size());
    parts.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return parts;
}

}  // namespace

std::optional<Options> parse_options(int argc, const char* const* argv, int rank) {
  Options options;
  scene::CommandLine line(
      "pgl_viewer", "Draws a model inside a vertex budget: in a window, or into a picture where there is no display.");
  line.add_files("files", options.files,
                 "Models: OBJ, PLY, STL, glTF, GLB, or one .pgl of pgl_preprocess; none: a made-up plant");
  CLI::App& app = line.app;
  const OptionList plant = add_plant_options(line, options.plant, 718'000);
  const scene::ImportOptionLists import = add_import_options(line, options.import);
  const OptionList ecol = add_ecol_options(line, options.ecol);

  CLI::Option* budget =
      line.add("--budget", "Vertices to draw, at most 2^32 [1000000]",
               [&](const std::string& text) {
                 constexpr std::uint64_t most = std::uint64_t{1} << 32;
                 const auto given = text == "all" ? most : number<std::uint64_t>(text, 0, most);
                 if (!given) refuse("--budget", "needs a number from 0 to 4294967296, or all, not '" + text + "'");
                 options.budget = *given;
               })
          ->type_name("N|all");
  line.add_choice<LodMode>(
      "--lod", options.lod, {{"budget", LodMode::budget}, {"error", LodMode::error}},
      "What decides on an object's vertices: its share of the budget, or its error on the screen [budget]");
  CLI::Option* threshold =
      line.add_number("--threshold", options.threshold, 0.0f, 1e6f, "Pixels that an error may take on the screen [1]");
  line.add("--frame-time",
           "Milliseconds that a frame may take: the budget or the threshold of each rank follows its times [fixed]",
           [&](const std::string& text) {
             const auto given = number<double>(text, 0.001, 1e6);
             if (!given) refuse("--frame-time", "needs milliseconds from 0.001 to 1000000, not '" + text + "'");
             options.frame_time = *given;
           })
      ->type_name("MS");
  line.add_number("--alpha", options.distribution.alpha, std::nextafter(1.0f, 2.0f), 64.0f,
                  "Above 1 to 64: small favours area on the screen, large detailed objects [3]");
  line.add_number("--pet", options.distribution.pet, 0.0f, std::numeric_limits<float>::max(),
                  "Objects of fewer square pixels are not drawn [1]");
  line.add_number("--min-triangles", options.min_triangles, 0u, std::numeric_limits<std::uint32_t>::max(),
                  "A drawn object keeps at least so many triangles [0]");
  line.add_choice<BudgetPolicy>(
      "--policy", options.distribution.policy,
      {{"exact", BudgetPolicy::exact}, {"fair", BudgetPolicy::fair}, {"paper", BudgetPolicy::paper}},
      "How the budget is met: fair leaves objects out only where it must [exact]");
  line.add_choice<BackendKind>("--backend", options.backend, {{"host", BackendKind::host}, {"cuda", BackendKind::cuda}},
                               "What prepares the frames: the CPU or the GPU, to the same bits [host]");
  line.add_number("--threads", options.threads, 1, 1024, "Threads of the host [all]");
  line.add_choice<OcclusionMode>(
      "--occlusion", options.occlusion.mode,
      {{"on", OcclusionMode::on}, {"off", OcclusionMode::off}, {"temporal", OcclusionMode::temporal}},
      "Leave out what a few objects hide: the heaviest in view, or temporal: of those seen before; "
      "one sample a pixel [off]");
  CLI::Option* aos = line.add("--aos", "Objects that may hide others, temporal: up to twice as many [500]",
                              [&](const std::string& text) {
                                constexpr std::size_t most = std::numeric_limits<std::uint32_t>::max();
                                const auto given = text == "all" ? most : number<std::size_t>(text, 0, most);
                                if (!given) {
                                  refuse("--aos", "needs a number from 0 to 4294967295, or all, not '" + text + "'");
                                }
                                options.occlusion.aos = *given;
                              })
                         ->type_name("N|all");
  CLI::Option* compactness = line.add_number("--compactness", options.occlusion.compactness, 0.0f, 1.0f,
                                             "Only objects at least so compact hide others: 0 any, 1 boxes [0.5]");
  CLI::Option* refine = line.add_number("--refine", options.occlusion.refinement, 0u, 16u,
                                        "Levels of finer tests, 0 to 16, where 2x2 texels do not tell [2]");

  line.add_choice<StreamMode>(
      "--stream", options.stream.mode,
      {{"auto", StreamMode::automatic}, {"always", StreamMode::always}, {"never", StreamMode::never}},
      "Send vertices and triangles as frames need them, not the whole model: auto, where it does not fit [auto]");
  const auto add_bytes = [&](const std::string& name, std::optional<std::uint64_t>& bytes, const std::string& help) {
    return line
        .add(name, help,
             [name, &bytes](const std::string& text) {
               const std::string_view units = "KMG";
               const std::size_t unit = text.empty() ? units.npos : units.find(text.back());
               const int shift = unit == units.npos ? 0 : 10 * (static_cast<int>(unit) + 1);
               const auto given = number<std::uint64_t>(std::string_view(text).substr(0, text.size() - (shift > 0)), 0,
                                                        std::uint64_t{1} << (50 - shift));
               if (!given) refuse(name, "needs bytes, as 1500000, 64K, 200M or 6G, up to 2^50, not '" + text + "'");
               bytes = *given << shift;
             })
        ->type_name("BYTES");
  };
  add_bytes("--gpu-memory", options.stream.gpu_memory,
            "What frames may take, all in all, where they are prepared; K, M, G for KiB, MiB, GiB [what is free]");
  CLI::Option* transfer = add_bytes("--transfer", options.stream.transfer,
                                    "What a streamed frame may send at most: detail arrives over several [no limit]");
  CLI::Option* overlap = app.add_flag("--overlap", options.stream.overlap,
                                      "Prepare a streamed frame while the last one is drawn; steps are not timed");
  CLI::Option* prefetch = app.add_flag("--prefetch,!--no-prefetch", options.prefetch,
                                       "Read a .pgl file ahead of the frames, on a thread of its own [on]");

  CLI::Option* tiles = line.add_choice<TileMode>(
      "--tiles", options.tiles.mode,
      {{"equal", TileMode::equal}, {"balanced", TileMode::balanced}, {"measured", TileMode::measured}},
      "Of several ranks: parts of the picture as large, that cost as much, or that take as long [balanced]");
  CLI::Option* wall =
      line.add("--wall",
               "A picture of so many screens, a rank for each, which shows it or writes it: FILE-0.png and so on",
               [&](const std::string& text) {
                 const auto parts = cut(text, 'x');
                 const auto columns = number<std::uint32_t>(parts[0], 1u, most_tiles);
                 const auto rows = number<std::uint32_t>(parts.back(), 1u, most_tiles);
                 if (parts.size() != 2 || !columns || !rows || *columns * *rows > most_tiles) {
                   refuse("--wall", "needs COLUMNSxROWS, at most 64 screens, not '" + text + "'");
                 }
                 options.tiles.mode = TileMode::wall;
                 options.tiles.columns = *columns;
                 options.tiles.rows = *rows;
               })
          ->type_name("CxR");
  CLI::Option* balance = line.add_choice<BalancePolicy>(
      "--balance", options.tiles.balance.policy,
      {{"histogram", BalancePolicy::histogram}, {"bisection", BalancePolicy::bisection}},
      "How a cut is found: the best of all, or by halves until it is good enough [histogram]");
  CLI::Option* lbt = line.add_number("--lbt", options.tiles.balance.threshold, 0.0f, 1.0f,
                                     "Imbalance that is good enough for bisection, 0 to 1 [0.03]");
  CLI::Option* bins = line.add_number("--bins", options.tiles.balance.bins, 0u, most_picture_side,
                                      "Places where a tile may be cut, 2 or more; 0: between any two pixels [0]");
  line.add("--timeout", "Seconds that a rank may keep the others waiting [10]",
           [&](const std::string& text) {
             const auto given = number<double>(text, 0.1, 1e6);
             if (!given) refuse("--timeout", "needs seconds from 0.1 to 1000000, not '" + text + "'");
             options.patience = *given;
           })
      ->type_name("SECONDS");
  line.add("--slow", "For measurements: a rank that draws every frame several times",
           [&](const std::string& text) {
             const auto parts = cut(text, ',');
             const auto which = number<int>(parts[0], 0, 63);
             const auto factor = number<int>(parts.back(), 1, 1000);
             if (parts.size() != 2 || !which || !factor) {
               refuse("--slow", "needs RANK,TIMES as 1,4, not '" + text + "'");
             }
             options.slow_rank = *which;
             options.slow_factor = *factor;
           })
      ->type_name("RANK,TIMES");

  add_up_option(line, options.up,
                "Which axis of the model points up [as a .pgl file says, else z of the plant, y of files]");
  CLI::Option* camera =
      line.add("--camera", "Eye, target, vertical field of view in degrees [whole model]",
               [&](const std::string& text) {
                 constexpr double most = 1e30;
                 std::vector<double> numbers;
                 for (const std::string_view part : cut(text, ',')) {
                   const auto given = number<double>(part, -most, most);
                   if (!given) refuse("--camera", "'" + std::string(part) + "' is not a number from -1e30 to 1e30");
                   numbers.push_back(*given);
                 }
                 if (numbers.size() != 6 && numbers.size() != 7) {
                   refuse("--camera", "needs 6 or 7 numbers, not " + std::to_string(numbers.size()));
                 }
                 CameraOption given_camera;
                 given_camera.eye = {numbers[0], numbers[1], numbers[2]};
                 given_camera.target = {numbers[3], numbers[4], numbers[5]};
                 if (!(glm::distance(given_camera.eye, given_camera.target) > 0.0))
                   refuse("--camera", "eye and target coincide");
                 if (numbers.size() == 7) {
                   if (!(numbers[6] >= 1.0 && numbers[6] <= 170.0)) {
                     refuse("--camera", "the field of view must be from 1 to 170 degrees");
                   }
                   given_camera.fov_degrees = numbers[6];
                 }
                 options.camera = given_camera;
               })
          ->type_name("ex,ey,ez,tx,ty,tz[,fov]");
  line.add("--size", "Pixels, 1 to 16384 each way [1280x720]",
           [&](const std::string& text) {
             const auto parts = cut(text, 'x');
             const auto width = number<int>(parts[0], 1, 16384);
             const auto height = number<int>(parts.back(), 1, 16384);
             if (parts.size() != 2 || !width || !height) {
               refuse("--size", "needs WIDTHxHEIGHT, each from 1 to 16384, not '" + text + "'");
             }
             options.width = *width;
             options.height = *height;
           })
      ->type_name("WxH");
  app.add_flag("--wireframe", options.wireframe, "Draw the edges of the triangles");
  CLI::Option* orbit = app.add_flag("--orbit", options.orbit, "Turn the camera around the model by a degree a frame");
  app.add_flag("--fly", options.fly, "Fly the camera through the model, once in all --frames");
  app.add_flag("--headless", options.headless, "No window, even where there is a display");
  line.add_number("--frames", options.frames, 1, 1'000'000, "Frames before it ends [1 headless, no end in a window]");
  CLI::Option* output =
      app.add_option("--output", options.output, "Write the last frame as a PNG")->type_name("FILE.png");
  CLI::Option* reference =
      app.add_option("--reference", options.reference, "Write the last frame's selection, seen from outside, as a PNG")
          ->type_name("FILE.png");
  CLI::Option* stats =
      app.add_option("--stats", options.stats, "Write what was measured as JSON")->type_name("FILE.json");
  app.add_flag("--checksums", options.checksums, "With --stats: the checksum of every frame, not only the last");

  if (!line.parse(argc, argv, rank == 0)) return {};

  scene::refuse_of_other_source(!options.files.empty(), plant, import.of_files);
  if (options.backend == BackendKind::cuda && !built_with_cuda) {
    refuse("--backend", "this pgl_viewer was built without CUDA: no toolkit was found, or none wanted");
  }
  if (options.checksums && stats->count() == 0) refuse("--checksums", "goes into --stats, and none is asked for");
  if (options.occlusion.mode == OcclusionMode::off) {
    refuse_given({aos, compactness, refine}, "is for --occlusion on or temporal");
  }
  if (options.stream.mode == StreamMode::never) {
    refuse_given({transfer, overlap}, "is for streamed frames, and --stream says never");
  }
  if (options.lod == LodMode::error) {
    refuse_given({budget}, "and --lod error are different limits");
    refuse_given({transfer}, "is for --lod budget, whose weights say what comes first");
  } else {
    refuse_given({threshold}, "is for --lod error");
  }
  if (options.tiles.columns > static_cast<std::uint32_t>(options.width) ||
      options.tiles.rows > static_cast<std::uint32_t>(options.height)) {
    refuse("--wall", "has more screens than --size has pixels");
  }
  if (wall->count() > 0) refuse_given({tiles, balance, lbt, bins}, "is for one picture, and --wall makes several");
  if (options.tiles.mode == TileMode::equal) refuse_given({balance, lbt, bins}, "is for tiles that follow the load");
  if (options.tiles.balance.policy != BalancePolicy::bisection) refuse_given({lbt}, "is for --balance bisection");
  if (options.tiles.balance.bins == 1) refuse("--bins", "needs 0, or from 2 to 16384 places");
  if (options.fly) {
    refuse_given({orbit, camera}, "and --fly are different cameras");
  }
  const auto is_preprocessed = [](const std::string& file) { return file.ends_with(".pgl"); };
  options.preprocessed = std::ranges::any_of(options.files, is_preprocessed);
  if (options.preprocessed) {
    if (options.files.size() > 1)
      refuse(*std::ranges::find_if(options.files, is_preprocessed), "must be the only file");
    for (const OptionList& list : {import.all, ecol}) {
      refuse_given(list, "is for pgl_preprocess, which made this model");
    }
  } else if (prefetch->count() > 0) {
    refuse("--prefetch", "is for a .pgl file, and none is given");
  }
  struct Written {
    std::string name, path;
  };
  std::vector<Written> written;
  const auto add_written = [&](const CLI::Option* option, const std::string& path, bool is_picture) {
    if (option->count() == 0) return;
    const std::string name = option->get_name();
    if (is_picture && !path.ends_with(".png")) refuse(name, "'" + path + "' does not end in .png");
    if (rank == 0) check_writable(name, path);
    for (const Written& other : written) {
      if (real_path(other.path) == real_path(path)) refuse(name, "'" + path + "' is " + other.name + "'s file");
    }
    written.push_back({name, path});
  };
  if (options.tiles.mode == TileMode::wall) {
    const auto file_of = [&](std::uint32_t screen) {
      std::string file = options.output;
      if (file.ends_with(".png")) file.insert(file.size() - 4, "-" + std::to_string(screen));
      return file;
    };
    const std::uint32_t screens = options.tiles.columns * options.tiles.rows;
    for (std::uint32_t screen = 0; screen < screens; ++screen) add_written(output, file_of(screen), true);
    options.output = file_of(static_cast<std::uint32_t>(rank));
  } else {
    add_written(output, options.output, true);
  }
  add_written(reference, options.reference, true);
  add_written(stats, options.stats, false);
  return options;
}

}  // namespace pgl::viewer
