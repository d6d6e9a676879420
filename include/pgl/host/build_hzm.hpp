// SPDX-License-Identifier: MIT
// The hierarchical-Z map of a depth map, on the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/build_hzm.hpp"
#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"

namespace pgl::host {

/// Fills in the levels above the depths: each texel is the farthest of the up to 2 x 2 below it, and so of all texels
/// of level 0 below it.
///
/// texels: the levels one after the other, where hzm_level(size, level) says. Level 0 is read, the others are written.
/// Preconditions: texels.size() == hzm_texels(size); the sides of size are from 1 to 65536.
/// O(texels), allocates nothing; the same for any number of threads.
/// Source: [Peng13] Alg 5, for any size: where a side is odd the last texel has fewer below it.
inline void build_hzm(const DepthMap& size, std::span<Depth> texels) {
  PGL_ASSERT(texels.size() == hzm_texels(size));
  const std::uint32_t levels = hzm_levels(size);
  for (std::uint32_t level = 1; level < levels; ++level) {
    const HzmLevel from = hzm_level(size, level - 1), to = hzm_level(size, level);
    const std::size_t grain = 1 + (std::size_t{1} << 14) / to.width;
    parallel_for(to.height, grain, [&](std::size_t row) {
      const auto y = static_cast<std::uint32_t>(row);
      const Depth* below = texels.data() + from.offset;
      Depth* out = texels.data() + to.offset + row * to.width;
      const std::uint32_t pairs = from.width / 2;
      const bool whole = 2 * y + 1 < from.height;
      const Depth* low = below + std::size_t{2} * row * from.width;
      const Depth* high = whole ? low + from.width : low;
      for (std::uint32_t x = 0; x < pairs; ++x)
        out[x] = farther(farther(low[2 * x], low[2 * x + 1]), farther(high[2 * x], high[2 * x + 1]));
      if (pairs < to.width) out[pairs] = texel_above(below, from.width, from.height, pairs, y);
    });
  }
}

}  // namespace pgl::host
