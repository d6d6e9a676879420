// SPDX-License-Identifier: MIT
// Lays out what a new selection needs and the one before did not have, on the GPU, which then only waits for that.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/prefix_sum.cuh"
#include "pgl/pack_delta.hpp"

namespace pgl::cuda {

namespace pack_delta_detail {

/// Computes how many new elements an object has.
struct DeltaSizes {
  const std::uint64_t* previous_offsets;
  const std::uint64_t* offsets;
  PGL_HD std::uint64_t operator[](std::ptrdiff_t i) const {
    return delta_part(previous_offsets, offsets, static_cast<std::size_t>(i)).size;
  }
};

}  // namespace pack_delta_detail

/// Writes where the new elements of every object go in the block of all that is new, as pgl::host::lay_out_delta does;
/// the total, which that returns, is delta_offsets[n].
///
/// All views are of device memory, n + 1 entries each; delta_offsets overlaps neither of the others. Preconditions:
/// those of the host; that the offsets never decrease is checked on the device in debug builds.
/// O(n), one scan (CUB); no scratch is allocated once the workspace has been used for as many objects. Enqueued on
/// launch.stream, capturable. Integers: the same for any GPU. launch.block_threads is not read.
[[nodiscard]] inline cudaError_t lay_out_delta(std::span<const std::uint64_t> previous_offsets,
                                               std::span<const std::uint64_t> offsets,
                                               std::span<std::uint64_t> delta_offsets, ScanWorkspace& workspace,
                                               Launch launch = {}) {
  PGL_ASSERT(!offsets.empty() && previous_offsets.size() == offsets.size() && delta_offsets.size() == offsets.size());
  return detail::exclusive_sum(pack_delta_detail::DeltaSizes{previous_offsets.data(), offsets.data()},
                               offsets.size() - 1, delta_offsets.data(), workspace, launch);
}

}  // namespace pgl::cuda
