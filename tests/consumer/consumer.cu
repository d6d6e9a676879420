// SPDX-License-Identifier: MIT
// A stranger's first program for the GPU: which of two boxes is in view.
#include <cstdio>
#include <vector>

#include <pgl/cuda/cull_frustum.cuh>

namespace {

/// Culls on the GPU; returns the first error.
cudaError_t cull(const std::vector<pgl::Box>& boxes, const pgl::View& view, std::vector<std::uint8_t>& in_view) {
  pgl::Box* device_boxes = nullptr;
  std::uint8_t* device_in_view = nullptr;
  PGL_CUDA_TRY(cudaMalloc(&device_boxes, boxes.size() * sizeof(pgl::Box)));
  PGL_CUDA_TRY(cudaMalloc(&device_in_view, boxes.size()));
  PGL_CUDA_TRY(cudaMemcpy(device_boxes, boxes.data(), boxes.size() * sizeof(pgl::Box), cudaMemcpyHostToDevice));
  PGL_CUDA_TRY(pgl::cuda::cull_frustum({device_boxes, boxes.size()}, view, {device_in_view, boxes.size()}));
  PGL_CUDA_TRY(cudaMemcpy(in_view.data(), device_in_view, boxes.size(), cudaMemcpyDeviceToHost));
  PGL_CUDA_TRY(cudaFree(device_in_view));
  return cudaFree(device_boxes);
}

}  // namespace

int main() {
  int devices = 0;
  if (cudaGetDeviceCount(&devices) != cudaSuccess || devices == 0) {
    std::puts("SKIPPED: no GPU here, so this was only compiled and linked");
    return 0;
  }
  // The identity's frustum is the cube from -1 to 1.
  std::vector<pgl::Box> boxes(2);
  boxes[0].min = boxes[0].max = glm::vec3(0.5f);
  boxes[1].min = boxes[1].max = glm::vec3(2.0f);
  std::vector<std::uint8_t> in_view(2, 7);
  if (const cudaError_t error = cull(boxes, pgl::View{}, in_view); error != cudaSuccess) {
    std::printf("CUDA: %s\n", cudaGetErrorString(error));
    return 1;
  }
  std::printf("in view: %d %d\n", in_view[0], in_view[1]);
  return in_view[0] == 1 && in_view[1] == 0 ? 0 : 1;
}
