// SPDX-License-Identifier: MIT
#include "preprocess/options.hpp"

#include <cstddef>

#include "scene/command_line.hpp"

namespace pgl::preprocess {

using scene::OptionList;
using scene::refuse;
using scene::refuse_given;

std::optional<Options> parse_options(int argc, const char* const* argv) {
  Options options;
  scene::CommandLine line("pgl_preprocess",
                          "Preprocesses models into one .pgl file, which then opens at once, however large it is.");
  line.add_files("in", options.inputs,
                 "Models: OBJ, PLY, STL, glTF, GLB, VRML; folders of them; @FILE: a list, one a line; "
                 "none: a made-up plant");
  std::string output, verify, info;
  CLI::App& app = line.app;
  const CLI::Option* made =
      app.add_option("-o,--output", output, "The file to make; it appears when all is done")->type_name("OUT.pgl");
  const CLI::Option* verified =
      app.add_option("--verify", verify, "Instead: check every byte of a .pgl file")->type_name("FILE");
  const CLI::Option* shown = app.add_option("--info", info, "Instead: say what is in a .pgl file")->type_name("FILE");

  constexpr std::size_t most_objects = 100'000'000;
  const OptionList plant = add_plant_options(line, options.plant, most_objects);
  const CLI::Option* warehouse = app.add_flag("--warehouse", options.warehouse,
                                              "Every file is a part; parts are laid out on shelves, z up, with aisles");
  const scene::ImportOptionLists import = add_import_options(line, options.import);
  const OptionList ecol = add_ecol_options(line, options.ecol);
  const CLI::Option* errors =
      app.add_flag("--errors", options.errors,
                   "Record the error of every count of vertices too, for selection by error (quality mode)");
  const CLI::Option* up = add_up_option(
      line, options.up, "Which axis points up, for the viewer [z of the plant and of --warehouse, else y]");
  const CLI::Option* batch =
      line.add_number("--batch", options.batch, std::size_t{1}, std::size_t{1'000'000'000},
                      "Triangles to build together: more keep more cores busy, and need more memory [2000000]");
  line.add_number("--threads", options.threads, 1, 1024, "Threads [all]");
  if (!line.parse(argc, argv)) return {};

  if (verified->count() + shown->count() > 0) {
    const CLI::Option* look = verified->count() > 0 ? verified : shown;
    options.task = look == verified ? Task::verify : Task::info;
    options.file = look == verified ? verify : info;
    if (verified->count() > 0 && shown->count() > 0) refuse("--info", "is one thing, --verify another");
    if (!options.inputs.empty()) refuse(look->get_name(), "takes one file and no models beside it");
    for (const OptionList& list : {OptionList{made, warehouse, errors, up, batch}, plant, import.all, ecol}) {
      refuse_given(list, "is for making a file, not for " + look->get_name());
    }
    return options;
  }
  if (made->count() == 0) refuse("--output", "is missing: which file is to be made?");
  if (!output.ends_with(".pgl")) refuse("--output", "'" + output + "' does not end in .pgl");
  options.file = output;
  const bool has_files = !options.inputs.empty();
  if (!has_files) refuse_given({warehouse}, "is for model files, and none is given");
  scene::refuse_of_other_source(has_files, plant, import.of_files);
  if (up->count() == 0) {
    options.up = !has_files || options.warehouse ? scene::UpAxis::z : scene::UpAxis::y;
  }
  return options;
}

}  // namespace pgl::preprocess
