// SPDX-License-Identifier: MIT
// Captures what a driver enqueues as a CUDA graph, to replay it.
#pragma once

#include <cuda_runtime.h>

#include <utility>

#include "twin/device.cuh"

namespace pgl::test {

/// A graph of what enqueue(stream) enqueued, which must not allocate: while the stream is captured CUDA refuses that.
class Captured {
 public:
  template <class Enqueue>
  explicit Captured(Enqueue&& enqueue) {
    must(cudaStreamCreate(&stream_));
    must(cudaStreamBeginCapture(stream_, cudaStreamCaptureModeGlobal));
    const cudaError_t error = std::forward<Enqueue>(enqueue)(stream_);
    cudaGraph_t graph = nullptr;
    const cudaError_t ended = cudaStreamEndCapture(stream_, &graph);
    must(error);
    must(ended);
    must(cudaGraphInstantiate(&executable_, graph, 0));
    must(cudaGraphDestroy(graph));
  }
  Captured(const Captured&) = delete;
  Captured& operator=(const Captured&) = delete;
  ~Captured() {
    if (executable_ != nullptr) cudaGraphExecDestroy(executable_);
    if (stream_ != nullptr) cudaStreamDestroy(stream_);
  }

  /// Runs it once more and waits for it.
  void replay() const {
    must(cudaDeviceSynchronize());
    must(cudaGraphLaunch(executable_, stream_));
    must(cudaStreamSynchronize(stream_));
  }

 private:
  cudaStream_t stream_ = nullptr;
  cudaGraphExec_t executable_ = nullptr;
};

/// Overwrites the array's elements with the bytes 0xA5, or with values.
template <class T>
void poison(const DeviceArray<T>& array) {
  must(cudaMemset(array.data(), 0xA5, array.view().size_bytes()));
}
template <class T>
void assign(const DeviceArray<T>& array, const std::vector<T>& values) {
  must(cudaMemcpy(array.data(), values.data(), array.view().size_bytes(), cudaMemcpyHostToDevice));
}

}  // namespace pgl::test
