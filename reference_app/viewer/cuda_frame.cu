// SPDX-License-Identifier: MIT
// Frames that the GPU prepares.
#include "viewer/cuda_frame.hpp"

#include <cuda_gl_interop.h>
#include <cuda_runtime.h>

#include <algorithm>
#include <array>

#include "viewer/context.hpp"
#include "viewer/cuda_backend.cuh"

namespace pgl::viewer {

int choose_gpu(int local_rank) {
  int count = 0;
  const cudaError_t error = cudaGetDeviceCount(&count);
  if (error != cudaSuccess || count == 0) {
    throw NoContext(std::string("--backend: cuda finds no GPU on this machine: ") +
                    cudaGetErrorString(error != cudaSuccess ? error : cudaErrorNoDevice));
  }
  const int device = local_rank % count;
  must(cudaSetDevice(device), "starting the GPU");
  return device;
}

namespace {

template <class Index>
std::unique_ptr<AnyFrame> make(const FrameModel<Index>& model, const FrameOptions& options, DrawBuffers& buffers,
                               const std::string& gl_vendor) {
  const bool shares = gl_vendor.starts_with("NVIDIA");
  if (shares) {
    // Those of the current context: it may be on another GPU than CUDA's first.
    std::array<int, 16> devices{};
    unsigned count = 0;
    int current = 0;
    must(cudaGetDevice(&current), "asking for the device");
    if (cudaGLGetDevices(&count, devices.data(), static_cast<unsigned>(devices.size()), cudaGLDeviceListAll) ==
            cudaSuccess &&
        count > 0) {
      const auto end = devices.begin() + std::min<std::ptrdiff_t>(count, std::ssize(devices));
      if (std::find(devices.begin(), end, current) == end) must(cudaSetDevice(devices[0]), "starting the GPU");
    } else {
      (void)cudaGetLastError();  // registering the buffers will tell
    }
  }
  return std::make_unique<Frame<CudaBackend, Index>>(model, options, buffers, shares);
}

}  // namespace

std::unique_ptr<AnyFrame> make_cuda_frame(const FrameModel<std::uint16_t>& model, const FrameOptions& options,
                                          DrawBuffers& buffers, const std::string& gl_vendor) {
  return make(model, options, buffers, gl_vendor);
}
std::unique_ptr<AnyFrame> make_cuda_frame(const FrameModel<std::uint32_t>& model, const FrameOptions& options,
                                          DrawBuffers& buffers, const std::string& gl_vendor) {
  return make(model, options, buffers, gl_vendor);
}

}  // namespace pgl::viewer
