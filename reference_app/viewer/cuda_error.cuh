// SPDX-License-Identifier: MIT
// What the viewer does about errors of CUDA.
#pragma once

#include <cuda_runtime.h>

#include <stdexcept>
#include <string>

namespace pgl::viewer {

/// Throws std::runtime_error for any error but cudaSuccess.
inline void must(cudaError_t error, const char* doing) {
  if (error == cudaSuccess) return;
  (void)cudaGetLastError();  // who goes on without it must not be told of it later: CUB would
  const std::string hint = error == cudaErrorMemoryAllocation ? ": the GPU's memory is full" : "";
  throw std::runtime_error(std::string("CUDA: ") + cudaGetErrorString(error) + " while " + doing + hint);
}

}  // namespace pgl::viewer
