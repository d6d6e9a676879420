// SPDX-License-Identifier: MIT
// Whether objects that others hide are left out of a frame, and what may hide them.
#pragma once

#include <cstddef>

namespace pgl::viewer {

enum class OcclusionMode { off, on };

struct OcclusionOptions {
  OcclusionMode mode = OcclusionMode::off;
  std::size_t aos = 20;      ///< occluders of a frame; as many as there are candidates where that is less
  float compactness = 0.5f;  ///< a candidate's is at least this, 0..1
};

}  // namespace pgl::viewer
