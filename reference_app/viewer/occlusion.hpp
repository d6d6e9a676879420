// SPDX-License-Identifier: MIT
// Whether objects that others hide are left out of a frame, and what may hide them.
#pragma once

#include <cstddef>
#include <cstdint>

namespace pgl::viewer {

/// on: the occluders are the heaviest candidates in view, all at once. temporal: first the heaviest of those that the
/// frame before showed, then the heaviest of what those do not hide.
enum class OcclusionMode { off, on, temporal };

struct OcclusionOptions {
  OcclusionMode mode = OcclusionMode::off;
  std::size_t aos = 500;         ///< occluders of a frame, temporal: each time; fewer where there are fewer candidates
  float compactness = 0.5f;      ///< a candidate's is at least this, 0..1
  std::uint32_t refinement = 2;  ///< levels that cull_occluded's test may go down
};

}  // namespace pgl::viewer
