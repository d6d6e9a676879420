// SPDX-License-Identifier: MIT
// The objects that two sets of flags have in common, less a few, on the GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace detail {

template <class = void>
__global__ void __launch_bounds__(1024)
    keep_flagged_kernel(const std::uint8_t* flags, const std::uint8_t* also, std::uint64_t n, std::uint8_t* out) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride)
    out[i] = static_cast<std::uint8_t>(flags[i] != 0 && (also == nullptr || also[i] != 0));
}

template <class = void>
__global__ void __launch_bounds__(1024) drop_listed_kernel(const std::uint32_t* except, std::uint64_t n,
                                                           [[maybe_unused]] std::uint64_t objects, std::uint8_t* out) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    const std::uint32_t object = except[i];
    if (object == no_object) continue;
    PGL_ASSERT(object < objects);
    out[object] = 0;
  }
}

}  // namespace detail

/// Marks the objects that are flagged twice and not listed, as pgl::host::keep_flagged does.
///
/// All views are of device memory; `out` may be the same array as flags or also. O(n), one kernel over the objects and
/// one over the list where there is any; no scratch. Enqueued on launch.stream, capturable; the same for any launch.
[[nodiscard]] inline cudaError_t keep_flagged(std::span<const std::uint8_t> flags, std::span<const std::uint8_t> also,
                                              std::span<const std::uint32_t> except, std::span<std::uint8_t> out,
                                              Launch launch = {}) {
  PGL_ASSERT(out.size() == flags.size() && (also.empty() || also.size() == flags.size()));
  const std::uint64_t n = flags.size();
  PGL_CUDA_TRY(detail::run(detail::keep_flagged_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                           flags.data(), also.empty() ? nullptr : also.data(), n, out.data()));
  return detail::run(detail::drop_listed_kernel<>, detail::blocks_for(except.size(), launch.block_threads), 0, launch,
                     except.data(), except.size(), n, out.data());
}

}  // namespace pgl::cuda
