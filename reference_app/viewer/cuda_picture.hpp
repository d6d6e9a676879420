// SPDX-License-Identifier: MIT
// A picture's pixels in memory of one GPU that several processes of a machine share. Defined where the viewer is built
// with CUDA.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "pgl/balance.hpp"

namespace pgl::viewer {

/// How another process finds the shared memory: what CUDA calls an IPC handle.
using SharedMemory = std::array<std::byte, 64>;

/// A tile, and the pixel of the shared memory where it begins. There it lies without gaps: 4 bytes a pixel (red, green,
/// blue, alpha), row after row, the lowest first.
struct PlacedTile {
  Tile tile;
  std::uint64_t pixel = 0;
};

/// The shared memory beside an OpenGL texture of RGBA8 that CUDA may read and write. Every function returns when it is
/// done, and throws std::runtime_error for what CUDA reports.
class CudaPicture {
 public:
  virtual ~CudaPicture() = default;
  /// For the other processes.
  virtual SharedMemory memory() const = 0;
  /// Copies a tile of the texture into the memory.
  virtual void put(const PlacedTile& tile) = 0;
  /// Copies tiles from the memory into the texture. Only in the process that took the memory.
  virtual void take(std::span<const PlacedTile> tiles) = 0;
};

/// Takes shared memory for so many pixels on CUDA's device, which the current OpenGL context must be on (`gl_vendor`
/// says whether it can be). Those who opened it must have closed it before it is freed here.
std::unique_ptr<CudaPicture> take_cuda_picture(unsigned texture, const std::string& gl_vendor, std::uint64_t pixels);
/// Opens that of another process, which may be on another GPU that this one's can reach.
std::unique_ptr<CudaPicture> open_cuda_picture(unsigned texture, const std::string& gl_vendor,
                                               const SharedMemory& memory);

}  // namespace pgl::viewer
