// SPDX-License-Identifier: MIT
// What the command lines of the programs have in common.
#pragma once

#include <CLI/CLI.hpp>

#include <charconv>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "scene/import.hpp"
#include "scene/plant.hpp"
#include "scene/up_axis.hpp"
#include "scene/version.hpp"

namespace pgl::scene {

/// Throws std::runtime_error with one line that names the option.
[[noreturn]] inline void refuse(const std::string& option, const std::string& why) {
  throw std::runtime_error(option + ": " + why);
}

/// The whole text as a number in [low, high]; decimal, finite, nothing around it.
template <class T>
std::optional<T> number(std::string_view text, T low, T high) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !(value >= low && value <= high)) return {};
  return value;
}

using OptionList = std::vector<const CLI::Option*>;

/// Refuses those of the options that were given.
inline void refuse_given(const OptionList& options, const std::string& why) {
  for (const CLI::Option* option : options) {
    if (option->count() > 0) refuse(option->get_name(), why);
  }
}

/// A command line whose errors are one line that names the option. Of an option given twice, the last counts.
class CommandLine {
 public:
  CommandLine(const std::string& program, const std::string& description) : app(description, program) {
    app.set_version_flag("--version", program + " " + version());
    app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  }

  /// What is given without an option's name.
  void add_files(const std::string& name, std::vector<std::string>& files, const std::string& help) {
    app.add_option(name, files, help)->type_name("")->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  }

  /// An option whose text is read by `read`, which calls refuse where it cannot.
  CLI::Option* add(const std::string& name, const std::string& help, std::function<void(const std::string&)> read) {
    return app.add_option_function<std::string>(name, std::move(read), help)->type_name("");
  }

  template <class T>
  CLI::Option* add_number(const std::string& name, T& value, T low, T high, const std::string& help) {
    CLI::Option* option = add(name, help, [=, &value](const std::string& text) {
      const auto given = number<T>(text, low, high);
      if (!given) refuse(name, "needs a number from " + shown(low) + " to " + shown(high) + ", not '" + text + "'");
      value = *given;
    });
    return option->type_name("N");
  }

  template <class T>
  CLI::Option* add_choice(const std::string& name, T& value, const std::vector<std::pair<std::string, T>>& choices,
                          const std::string& help) {
    std::string names;
    for (const auto& choice : choices) names += (names.empty() ? "" : "|") + choice.first;
    CLI::Option* option = add(name, help, [=, &value](const std::string& text) {
      for (const auto& [known, meaning] : choices) {
        if (text == known) {
          value = meaning;
          return;
        }
      }
      refuse(name, "needs " + names + ", not '" + text + "'");
    });
    return option->type_name(names);
  }

  /// False if help or the version was asked for, which is then printed unless another process does. Throws
  /// std::runtime_error.
  [[nodiscard]] bool parse(int argc, const char* const* argv, bool print = true) {
    try {
      app.parse(argc, argv);
    } catch (const CLI::Success& asked) {
      if (print) app.exit(asked);
      return false;
    } catch (const CLI::ParseError& error) {
      throw std::runtime_error(error.what());
    }
    return true;
  }

  CLI::App app;

 private:
  template <class T>
  static std::string shown(T value) {
    char text[32];
    const auto end = std::to_chars(text, text + sizeof text, value).ptr;
    return {text, end};
  }
};

// ---- options of the model: where it comes from and how it is built --------------------------------------------------

inline OptionList add_plant_options(CommandLine& line, PlantOptions& plant, std::size_t most_objects) {
  return {line.add_number("--objects", plant.objects, std::size_t{1}, most_objects, "Objects of the plant [2000]"),
          line.add_number("--seed", plant.seed, std::uint64_t{0}, std::numeric_limits<std::uint64_t>::max(),
                          "Seed of the plant [1]")};
}

struct ImportOptionLists {
  OptionList all;
  OptionList of_files;  ///< without those that are of the plant too
};

inline ImportOptionLists add_import_options(CommandLine& line, ImportOptions& import) {
  const CLI::Option* split = line.app.add_flag("--split", import.split, "Every connected part becomes an object");
  const CLI::Option* flatten = line.app.add_flag("--flatten", import.flatten, "No shared meshes: one per object");
  const CLI::Option* weld = line.app.add_flag("--weld,!--no-weld", import.weld, "Merge identical vertices [on]");
  const CLI::Option* strict = line.app.add_flag_callback(
      "--refuse-non-finite", [&import] { import.non_finite = NonFinite::refuse_file; },
      "Refuse a file with NaN or infinite vertices instead of dropping their objects");
  return {{split, flatten, weld, strict}, {split, flatten, strict}};
}

inline OptionList add_ecol_options(CommandLine& line, EcolOptions& ecol) {
  return {
      line.add_choice<CostMetric>(
          "--metric", ecol.metric,
          {{"quadric", CostMetric::quadric}, {"melax", CostMetric::melax}, {"edge-length", CostMetric::edge_length}},
          "What a collapse costs [quadric]"),
      line.add_choice<BoundaryRule>("--boundary", ecol.boundary,
                                    {{"locked", BoundaryRule::locked}, {"slide", BoundaryRule::slide}},
                                    "What vertices on open edges do [locked]")};
}

inline CLI::Option* add_up_option(CommandLine& line, UpAxis& up, const std::string& help) {
  return line.add_choice<UpAxis>("--up", up, {{"x", UpAxis::x}, {"y", UpAxis::y}, {"z", UpAxis::z}}, help);
}

/// Refuses options of the plant where files are given, and options of files where none is.
inline void refuse_of_other_source(bool has_files, const OptionList& of_plant, const OptionList& of_files) {
  if (has_files) {
    refuse_given(of_plant, "is for the plant, and model files are given");
  } else {
    refuse_given(of_files, "is for model files, and none is given");
  }
}

}  // namespace pgl::scene
