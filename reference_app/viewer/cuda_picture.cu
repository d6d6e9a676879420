// SPDX-License-Identifier: MIT
// A picture's pixels in memory of one GPU that several processes of a machine share.
#include "viewer/cuda_picture.hpp"

#include <cuda_gl_interop.h>
#include <cuda_runtime.h>

#include <cstring>
#include <stdexcept>

#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "viewer/cuda_error.cuh"

namespace pgl::viewer {

namespace {

constexpr std::size_t pixel_size = 4;

/// A texture that is open for CUDA, and the stream of the work with it.
class SharedTexture {
 public:
  SharedTexture(unsigned name, unsigned flags) {
    must(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
    if (const cudaError_t error = cudaGraphicsGLRegisterImage(&resource_, name, GL_TEXTURE_2D, flags);
        error != cudaSuccess) {
      (void)cudaStreamDestroy(stream_);
      must(error, "opening OpenGL's picture");
    }
  }
  SharedTexture(const SharedTexture&) = delete;
  SharedTexture& operator=(const SharedTexture&) = delete;
  ~SharedTexture() {
    (void)cudaGraphicsUnregisterResource(resource_);
    (void)cudaStreamDestroy(stream_);
  }

  /// Has copy(array, stream) enqueue its work with the texture's pixels, after what OpenGL was told before, and waits
  /// for it.
  template <class Copy>
  void use(const Copy& copy) {
    must(cudaGraphicsMapResources(1, &resource_, stream_), "mapping OpenGL's picture");
    cudaArray_t array = nullptr;
    cudaError_t error = cudaGraphicsSubResourceGetMappedArray(&array, resource_, 0, 0);
    if (error == cudaSuccess) error = copy(array, stream_);
    const cudaError_t unmapped = cudaGraphicsUnmapResources(1, &resource_, stream_);
    const cudaError_t done = cudaStreamSynchronize(stream_);
    for (const cudaError_t each : {error, unmapped, done}) must(each, "copying a tile");
  }

 private:
  cudaStream_t stream_ = nullptr;
  cudaGraphicsResource_t resource_ = nullptr;
};

/// Memory for other processes.
class TakenMemory {
 public:
  explicit TakenMemory(std::uint64_t pixels) {
    // Whole pages, so that nothing else that this process takes is shared with it.
    constexpr std::uint64_t page = std::uint64_t{2} << 20;
    must(cudaMalloc(&data_, (pixels * pixel_size + page - 1) / page * page), "taking memory for the picture");
  }
  TakenMemory(const TakenMemory&) = delete;
  TakenMemory& operator=(const TakenMemory&) = delete;
  ~TakenMemory() { (void)cudaFree(data_); }
  std::byte* data() const { return static_cast<std::byte*>(data_); }

 private:
  void* data_ = nullptr;
};

/// Another process's.
class OpenedMemory {
 public:
  explicit OpenedMemory(const SharedMemory& memory) {
    cudaIpcMemHandle_t handle;
    std::memcpy(&handle, memory.data(), sizeof handle);
    must(cudaIpcOpenMemHandle(&data_, handle, cudaIpcMemLazyEnablePeerAccess), "opening the memory of rank 0's GPU");
  }
  OpenedMemory(const OpenedMemory&) = delete;
  OpenedMemory& operator=(const OpenedMemory&) = delete;
  ~OpenedMemory() { (void)cudaIpcCloseMemHandle(data_); }
  std::byte* data() const { return static_cast<std::byte*>(data_); }

 private:
  void* data_ = nullptr;
};

template <class Memory>
class Picture final : public CudaPicture {
 public:
  template <class From>
  Picture(unsigned texture, unsigned flags, const From& from) : texture_(texture, flags), memory_(from) {}

  SharedMemory memory() const override {
    SharedMemory bytes;
    cudaIpcMemHandle_t handle;
    static_assert(sizeof handle == sizeof bytes);
    must(cudaIpcGetMemHandle(&handle, memory_.data()), "sharing memory of the GPU");
    std::memcpy(bytes.data(), &handle, sizeof handle);
    return bytes;
  }

  void put(const PlacedTile& placed) override {
    // By memory of this GPU: what crosses to another one is then a single run of bytes.
    const Size size(placed.tile);
    must(staging_.reserve(size.row * size.rows), "taking memory for a tile");
    texture_.use([&](cudaArray_t array, cudaStream_t stream) {
      PGL_CUDA_TRY(cudaMemcpy2DFromArrayAsync(staging_.at<std::byte>(), size.row, array, placed.tile.x0 * pixel_size,
                                              placed.tile.y0, size.row, size.rows, cudaMemcpyDeviceToDevice, stream));
      return cudaMemcpyAsync(memory_.data() + placed.pixel * pixel_size, staging_.at<std::byte>(), size.row * size.rows,
                             cudaMemcpyDefault, stream);
    });
  }

  void take(std::span<const PlacedTile> tiles) override {
    texture_.use([&](cudaArray_t array, cudaStream_t stream) {
      for (const auto& [tile, pixel] : tiles) {
        const Size size(tile);
        PGL_CUDA_TRY(cudaMemcpy2DToArrayAsync(array, tile.x0 * pixel_size, tile.y0, memory_.data() + pixel * pixel_size,
                                              size.row, size.row, size.rows, cudaMemcpyDeviceToDevice, stream));
      }
      return cudaSuccess;
    });
  }

 private:
  struct Size {
    explicit Size(const Tile& tile) : row((tile.x1 - tile.x0) * pixel_size), rows(tile.y1 - tile.y0) {}
    std::size_t row;  ///< bytes
    std::size_t rows;
  };

  SharedTexture texture_;
  Memory memory_;
  cuda::Buffer staging_;
};

/// Other drivers are not asked.
void check(const std::string& gl_vendor) {
  if (!gl_vendor.starts_with("NVIDIA")) throw std::runtime_error("OpenGL is not NVIDIA's");
}

}  // namespace

std::unique_ptr<CudaPicture> take_cuda_picture(unsigned texture, const std::string& gl_vendor, std::uint64_t pixels) {
  check(gl_vendor);
  return std::make_unique<Picture<TakenMemory>>(texture, cudaGraphicsRegisterFlagsNone, pixels);
}
std::unique_ptr<CudaPicture> open_cuda_picture(unsigned texture, const std::string& gl_vendor,
                                               const SharedMemory& memory) {
  check(gl_vendor);
  return std::make_unique<Picture<OpenedMemory>>(texture, cudaGraphicsRegisterFlagsReadOnly, memory);
}

}  // namespace pgl::viewer
