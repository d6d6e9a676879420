// SPDX-License-Identifier: MIT
// A picture's pixels in memory of one GPU that several processes of a machine share. Defined where the viewer is built
// with CUDA.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "pgl/balance.hpp"

namespace pgl::viewer {

/// How another process finds the shared memory: what CUDA calls an IPC handle.
using SharedMemory = std::array<std::byte, 64>;

/// The shared memory, opened beside an OpenGL texture of RGBA8 that CUDA may read and write. Tiles lie in the memory
/// without gaps: 4 bytes a pixel, row after row, the lowest first. Every function returns when it is done, and throws
/// std::runtime_error for what CUDA reports.
class CudaPicture {
 public:
  virtual ~CudaPicture() = default;
  /// For the other processes.
  virtual SharedMemory memory() const = 0;
  /// Copies a tile of the texture into the memory, to that pixel of it.
  virtual void put(const Tile& tile, std::uint64_t pixel) = 0;
  /// Copies a tile of the texture out of it. Only where the memory was taken.
  virtual void take(const Tile& tile, std::uint64_t pixel) = 0;
};

/// Takes shared memory for so many pixels on the GPU that the current OpenGL context and CUDA use. A process that
/// opened it must have closed it before it is freed here.
std::unique_ptr<CudaPicture> take_cuda_picture(unsigned texture, std::uint64_t pixels);
/// Opens that of another process, which may be on another GPU.
std::unique_ptr<CudaPicture> open_cuda_picture(unsigned texture, const SharedMemory& memory);

}  // namespace pgl::viewer
