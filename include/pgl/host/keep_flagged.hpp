// SPDX-License-Identifier: MIT
// The objects that two sets of flags have in common, less a few, on the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Marks the objects that are flagged twice and not listed: out[i] = 1 where flags[i] and also[i] are not 0 and i is
/// none of `except`, else 0. What chooses among objects in view, as select_occluders does, can so be told to choose
/// among fewer: those that were visible in the last frame, those that are not occluders yet.
///
/// also: empty means all. except: indices of objects, entries no_object are passed over. `out` may be the same array as
/// flags or also.
/// Preconditions: flags, out and also, if not empty, have one element per object; the listed objects are below that.
/// O(n), allocates nothing; the same for any number of threads.
inline void keep_flagged(std::span<const std::uint8_t> flags, std::span<const std::uint8_t> also,
                         std::span<const std::uint32_t> except, std::span<std::uint8_t> out) {
  PGL_ASSERT(out.size() == flags.size() && (also.empty() || also.size() == flags.size()));
  parallel_for(flags.size(), 65536, [&](std::size_t i) {
    out[i] = static_cast<std::uint8_t>(flags[i] != 0 && (also.empty() || also[i] != 0));
  });
  for (const std::uint32_t object : except) {
    if (object == no_object) continue;
    PGL_ASSERT(object < out.size());
    out[object] = 0;
  }
}

}  // namespace pgl::host
