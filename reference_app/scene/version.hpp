// SPDX-License-Identifier: MIT
// The version as the programs tell it.
#pragma once

#include <string>

#include "pgl/config.hpp"

namespace pgl::scene {

/// As "1.2.3".
inline std::string version() {
  return std::to_string(PGL_VERSION_MAJOR) + "." + std::to_string(PGL_VERSION_MINOR) + "." +
         std::to_string(PGL_VERSION_PATCH);
}

}  // namespace pgl::scene
