// SPDX-License-Identifier: MIT
// How the GPU drivers start kernels: on a stream, with the block size that the caller may choose, and errors returned.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "pgl/config.hpp"

/// Returns the error of a CUDA call from the function around it, if there is one.
#define PGL_CUDA_TRY(...)                                                                        \
  do {                                                                                           \
    if (const cudaError_t pgl_error = (__VA_ARGS__); pgl_error != cudaSuccess) return pgl_error; \
  } while (false)

namespace pgl::cuda {

/// Where and how a driver's kernels run. A stream converts to it, so that `reform(..., stream)` is enough.
/// No result depends on block_threads: a multiple of 32 from 32 to 1024.
struct Launch {
  cudaStream_t stream = nullptr;
  unsigned block_threads = 256;
  constexpr Launch(cudaStream_t on = nullptr, unsigned threads_in_block = 256)
      : stream(on), block_threads(threads_in_block) {}
};

namespace detail {

/// The blocks that give each of n elements a thread.
inline std::uint64_t blocks_for(std::uint64_t n, unsigned block_threads) {
  return (n + block_threads - 1) / block_threads;
}

inline cudaLaunchConfig_t config_of(std::uint64_t blocks, std::size_t shared_bytes, Launch launch) {
  PGL_ASSERT(launch.block_threads % 32 == 0 && launch.block_threads >= 32 && launch.block_threads <= 1024);
  cudaLaunchConfig_t config{};
  config.gridDim = dim3(static_cast<unsigned>(std::min<std::uint64_t>(blocks, 0x7fffffffu)));
  config.blockDim = dim3(launch.block_threads);
  config.dynamicSmemBytes = shared_bytes;
  config.stream = launch.stream;
  return config;
}

/// Enqueues a kernel; nothing for no blocks. With more blocks than a grid takes, the grid has as many as it takes: a
/// kernel that may be asked for so many loops by the stride of the grid.
template <class... Parameters, class... Arguments>
[[nodiscard]] cudaError_t run(void (*kernel)(Parameters...), std::uint64_t blocks, std::size_t shared_bytes,
                              Launch launch, Arguments&&... arguments) {
  if (blocks == 0) return cudaSuccess;
  const cudaLaunchConfig_t config = config_of(blocks, shared_bytes, launch);
  return cudaLaunchKernelEx(&config, kernel, static_cast<Parameters>(arguments)...);
}

/// Finds how many blocks of a kernel the current device runs at the same time.
template <class... Parameters>
[[nodiscard]] cudaError_t resident_blocks(void (*kernel)(Parameters...), std::size_t shared_bytes, Launch launch,
                                          std::uint64_t& blocks) {
  int device = 0, processors = 0, per_processor = 0;
  PGL_CUDA_TRY(cudaGetDevice(&device));
  PGL_CUDA_TRY(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device));
  PGL_CUDA_TRY(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&per_processor, kernel,
                                                             static_cast<int>(launch.block_threads), shared_bytes));
  blocks = static_cast<std::uint64_t>(processors) * static_cast<std::uint64_t>(per_processor);
  return blocks == 0 ? cudaErrorLaunchOutOfResources : cudaSuccess;
}

/// Enqueues a cooperative kernel, one that synchronises its whole grid: on at most as many blocks as run at the same
/// time, and at least one.
template <class... Parameters, class... Arguments>
[[nodiscard]] cudaError_t run_cooperative(void (*kernel)(Parameters...), std::uint64_t blocks, std::size_t shared_bytes,
                                          Launch launch, Arguments&&... arguments) {
  std::uint64_t resident = 0;
  PGL_CUDA_TRY(resident_blocks(kernel, shared_bytes, launch, resident));
  cudaLaunchConfig_t config = config_of(std::clamp<std::uint64_t>(blocks, 1, resident), shared_bytes, launch);
  cudaLaunchAttribute cooperative{};
  cooperative.id = cudaLaunchAttributeCooperative;
  cooperative.val.cooperative = 1;
  config.attrs = &cooperative;
  config.numAttrs = 1;
  return cudaLaunchKernelEx(&config, kernel, static_cast<Parameters>(arguments)...);
}

}  // namespace detail

}  // namespace pgl::cuda
