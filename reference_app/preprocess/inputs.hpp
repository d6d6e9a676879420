// SPDX-License-Identifier: MIT
// Which files the arguments of pgl_preprocess mean.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace pgl::preprocess {

/// Returns the files that are meant, in the order of the arguments: "@LIST" means what the lines of that file name,
/// a folder all files of a known format in it and below, by name. Throws scene::Error where something is missing or of
/// unknown format, or a folder or list has no models, before any file is read.
std::vector<std::filesystem::path> expand_inputs(const std::vector<std::string>& arguments);

}  // namespace pgl::preprocess
