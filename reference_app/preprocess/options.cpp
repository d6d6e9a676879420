// SPDX-License-Identifier: MIT
#include "preprocess/options.hpp"

#include <CLI/CLI.hpp>

#include <charconv>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "pgl/config.hpp"

namespace pgl::preprocess {

namespace {

[[noreturn]] void refuse(const std::string& option, const std::string& why) {
  throw std::runtime_error(option + ": " + why);
}

class Parser {
 public:
  template <class T>
  CLI::Option* add_number(const std::string& name, T& value, T low, T high, const std::string& help) {
    const auto read = [=, &value](const std::string& text) {
      T given{};
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), given);
      if (error != std::errc{} || end != text.data() + text.size() || given < low || given > high) {
        refuse(name,
               "needs a number from " + std::to_string(low) + " to " + std::to_string(high) + ", not '" + text + "'");
      }
      value = given;
    };
    return app.add_option_function<std::string>(name, read, help)->type_name("N");
  }

  template <class T>
  CLI::Option* add_choice(const std::string& name, T& value, const std::vector<std::pair<std::string, T>>& choices,
                          const std::string& help) {
    std::string names;
    for (const auto& choice : choices) names += (names.empty() ? "" : "|") + choice.first;
    const auto read = [=, &value](const std::string& text) {
      for (const auto& [known, meaning] : choices) {
        if (text == known) {
          value = meaning;
          return;
        }
      }
      refuse(name, "needs " + names + ", not '" + text + "'");
    };
    return app.add_option_function<std::string>(name, read, help)->type_name(names);
  }

  CLI::App app{"Preprocesses models into one .pgl file, which then opens at once, however large it is.",
               "pgl_preprocess"};
};

}  // namespace

std::optional<Options> parse_options(int argc, const char* const* argv) {
  Options options;
  Parser parser;
  CLI::App& app = parser.app;
  app.set_version_flag("--version", "pgl_preprocess " + std::to_string(PGL_VERSION_MAJOR) + "." +
                                        std::to_string(PGL_VERSION_MINOR) + "." + std::to_string(PGL_VERSION_PATCH));

  app.add_option("in", options.inputs,
                 "Models: OBJ, PLY, STL, glTF, GLB, VRML; folders of them; @FILE: a list, one a line; "
                 "none: a made-up plant")
      ->type_name("");
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);  // an option given twice: the last
  std::string output, verify, info;
  CLI::Option* made =
      app.add_option("-o,--output", output, "The file to make; it appears when all is done")->type_name("OUT.pgl");
  CLI::Option* verified =
      app.add_option("--verify", verify, "Instead: check every byte of a .pgl file")->type_name("FILE");
  CLI::Option* shown = app.add_option("--info", info, "Instead: say what is in a .pgl file")->type_name("FILE");

  constexpr std::size_t most_objects = 100'000'000;
  CLI::Option* objects = parser.add_number("--objects", options.plant.objects, std::size_t{1}, most_objects,
                                           "Objects of the plant [2000]");
  CLI::Option* seed = parser.add_number("--seed", options.plant.seed, std::uint64_t{0},
                                        std::numeric_limits<std::uint64_t>::max(), "Seed of the plant [1]");
  CLI::Option* warehouse = app.add_flag("--warehouse", options.warehouse,
                                        "Every file is a part; parts are laid out on shelves, z up, with aisles");
  CLI::Option* split = app.add_flag("--split", options.import.split, "Every connected part becomes an object");
  CLI::Option* flatten = app.add_flag("--flatten", options.import.flatten, "No shared meshes: one per object");
  CLI::Option* weld = app.add_flag("--weld,!--no-weld", options.import.weld, "Merge identical vertices [on]");
  bool refuse_non_finite = false;
  CLI::Option* strict = app.add_flag("--refuse-non-finite", refuse_non_finite,
                                     "Refuse a file with NaN or infinite vertices instead of dropping their objects");
  CLI::Option* metric = parser.add_choice<CostMetric>(
      "--metric", options.ecol.metric,
      {{"quadric", CostMetric::quadric}, {"melax", CostMetric::melax}, {"edge-length", CostMetric::edge_length}},
      "What a collapse costs [quadric]");
  CLI::Option* boundary = parser.add_choice<BoundaryRule>(
      "--boundary", options.ecol.boundary, {{"locked", BoundaryRule::locked}, {"slide", BoundaryRule::slide}},
      "What vertices on open edges do [locked]");
  CLI::Option* up = parser.add_choice<scene::UpAxis>(
      "--up", options.up, {{"x", scene::UpAxis::x}, {"y", scene::UpAxis::y}, {"z", scene::UpAxis::z}},
      "Which axis points up, for the viewer [z of the plant and of --warehouse, else y]");
  CLI::Option* batch = parser.add_number("--batch", options.batch, std::size_t{1}, std::size_t{1'000'000'000},
                                         "Triangles to build together: more keep more cores busy, and need more memory "
                                         "[2000000]");
  parser.add_number("--threads", options.threads, 1, 1024, "Threads [all]");

  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {  // help, version
    app.exit(asked);
    return {};
  } catch (const CLI::ParseError& error) {
    throw std::runtime_error(error.what());
  }

  if (verified->count() + shown->count() > 0) {
    const CLI::Option* look = verified->count() > 0 ? verified : shown;
    options.task = look == verified ? Task::verify : Task::info;
    options.file = look == verified ? verify : info;
    if (verified->count() > 0 && shown->count() > 0) refuse("--info", "is one thing, --verify another");
    if (!options.inputs.empty()) refuse(look->get_name(), "takes one file and no models beside it");
    for (const CLI::Option* option :
         {made, objects, seed, warehouse, split, flatten, weld, strict, metric, boundary, up, batch}) {
      if (option->count() > 0) refuse(option->get_name(), "is for making a file, not for " + look->get_name());
    }
    return options;
  }
  if (made->count() == 0) refuse("--output", "is missing: which file is to be made?");
  if (!output.ends_with(".pgl")) refuse("--output", "'" + output + "' does not end in .pgl");
  options.file = output;
  if (options.inputs.empty()) {
    for (const CLI::Option* option : {warehouse, split, flatten, strict}) {
      if (option->count() > 0) refuse(option->get_name(), "is for model files, and none is given");
    }
  } else {
    for (const CLI::Option* option : {objects, seed}) {
      if (option->count() > 0) refuse(option->get_name(), "is for the plant, and model files are given");
    }
  }
  if (up->count() == 0) {
    options.up = options.inputs.empty() || options.warehouse ? scene::UpAxis::z : scene::UpAxis::y;
  }
  if (refuse_non_finite) options.import.non_finite = scene::NonFinite::refuse_file;
  return options;
}

}  // namespace pgl::preprocess
