// SPDX-License-Identifier: MIT
// The GPU as a backend of the frame: the model is copied to it once, frames are written into OpenGL's own buffers.
#pragma once

#include <cuda_gl_interop.h>
#include <cuda_runtime.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>
#include <vector>

#include "pgl/cuda/balance.cuh"
#include "pgl/cuda/block_stream.cuh"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/build_hzm.cuh"
#include "pgl/cuda/cull_frustum.cuh"
#include "pgl/cuda/cull_occluded.cuh"
#include "pgl/cuda/distribute_budget.cuh"
#include "pgl/cuda/gather.cuh"
#include "pgl/cuda/keep_flagged.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/limit_transfer.cuh"
#include "pgl/cuda/project.cuh"
#include "pgl/cuda/rasterize_depth.cuh"
#include "pgl/cuda/reform.cuh"
#include "pgl/cuda/select_by_error.cuh"
#include "pgl/cuda/select_occluders.cuh"
#include "pgl/cuda/unify.cuh"
#include "viewer/buffers.hpp"
#include "viewer/cuda_error.cuh"
#include "viewer/frame.hpp"

namespace pgl::viewer {

/// An array on the device that only grows, and has any contents after that.
template <class T>
class DeviceArray {
 public:
  DeviceArray() = default;
  explicit DeviceArray(std::span<const T> values) {
    resize(values.size());
    if (values.empty()) return;
    must(cudaMemcpy(data(), values.data(), size_ * sizeof(T), cudaMemcpyHostToDevice), "copying the model");
    must(cudaStreamSynchronize(nullptr),
         "copying the model");  // the last of it may be under way; our stream waits for none
  }
  void resize(std::size_t size) {
    must(memory_.reserve(size * sizeof(T)), "taking memory");
    size_ = size;
  }
  T* data() { return memory_.at<T>(); }
  const T* data() const { return memory_.at<T>(); }
  std::size_t size() const { return size_; }
  // For std::span: device addresses, which the host must not read.
  T* begin() { return data(); }
  T* end() { return data() + size_; }
  const T* begin() const { return data(); }
  const T* end() const { return data() + size_; }

 private:
  cuda::Buffer memory_;
  std::size_t size_ = 0;
};

/// The two buffers of a frame, opened for CUDA: registered once, and again when they grow; mapped for every frame.
class MappedBuffers {
 public:
  explicit MappedBuffers(DrawBuffers& buffers) : buffers_(buffers) {}
  MappedBuffers(const MappedBuffers&) = delete;
  MappedBuffers& operator=(const MappedBuffers&) = delete;
  ~MappedBuffers() {
    (void)unmap(mapped_on_);
    (void)forget();
  }

  /// Makes room and registers the buffers, unless they have it and are. On an error, neither is registered.
  cudaError_t prepare(std::size_t vertices, std::size_t triangles, bool exactly = false) {
    if (resources_[1] != nullptr && buffers_.has_room(vertices, triangles)) return cudaSuccess;
    PGL_CUDA_TRY(forget());
    buffers_.make_room(vertices, triangles, exactly);
    constexpr unsigned flags = cudaGraphicsRegisterFlagsWriteDiscard;
    cudaError_t error = cudaGraphicsGLRegisterBuffer(&resources_[0], buffers_.vertex_buffer(), flags);
    if (error == cudaSuccess) {
      error = cudaGraphicsGLRegisterBuffer(&resources_[1], buffers_.index_buffer(), flags);
      if (error != cudaSuccess) resources_[1] = nullptr;
    } else {
      resources_[0] = nullptr;
    }
    if (error != cudaSuccess) (void)forget();
    return error;
  }

  cudaError_t map(cudaStream_t stream, PlacedVertex*& vertices, Triangle<std::uint32_t>*& triangles) {
    PGL_CUDA_TRY(cudaGraphicsMapResources(2, resources_.data(), stream));
    mapped_ = true;
    mapped_on_ = stream;
    std::size_t bytes = 0;
    void* pointer = nullptr;
    PGL_CUDA_TRY(cudaGraphicsResourceGetMappedPointer(&pointer, &bytes, resources_[0]));
    vertices = static_cast<PlacedVertex*>(pointer);
    PGL_CUDA_TRY(cudaGraphicsResourceGetMappedPointer(&pointer, &bytes, resources_[1]));
    triangles = static_cast<Triangle<std::uint32_t>*>(pointer);
    return cudaSuccess;
  }

  cudaError_t unmap(cudaStream_t stream) {
    if (!mapped_) return cudaSuccess;
    mapped_ = false;
    return cudaGraphicsUnmapResources(2, resources_.data(), stream);
  }

  /// Leaves the buffers to OpenGL alone. Precondition: not mapped.
  cudaError_t forget() {
    cudaError_t first = cudaSuccess;
    for (cudaGraphicsResource_t& resource : resources_) {
      if (resource == nullptr) continue;
      const cudaError_t error = cudaGraphicsUnregisterResource(resource);
      if (first == cudaSuccess) first = error;
      resource = nullptr;
    }
    return first;
  }

 private:
  DrawBuffers& buffers_;
  std::array<cudaGraphicsResource_t, 2> resources_{};
  bool mapped_ = false;
  cudaStream_t mapped_on_ = nullptr;
};

/// A stream, and page-locked memory for small results.
class CudaQueue {
 public:
  CudaQueue() {
    must(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
    if (const cudaError_t error = cudaMallocHost(&results_, results_size); error != cudaSuccess) {
      (void)cudaStreamDestroy(stream_);
      must(error, "taking page-locked memory");
    }
  }
  CudaQueue(const CudaQueue&) = delete;
  CudaQueue& operator=(const CudaQueue&) = delete;
  ~CudaQueue() {
    (void)cudaStreamSynchronize(stream_);
    (void)cudaFreeHost(results_);
    (void)cudaStreamDestroy(stream_);
  }
  cudaStream_t stream() const { return stream_; }
  std::byte* results() const { return static_cast<std::byte*>(results_); }
  static constexpr std::size_t results_size = 256;

 private:
  cudaStream_t stream_ = nullptr;
  void* results_ = nullptr;
};

/// What Frame needs of a backend, on the current CUDA device.
class CudaBackend {
 public:
  template <class T>
  using Input = DeviceArray<T>;
  template <class T>
  using Array = DeviceArray<T>;
  using OccluderWorkspace = cuda::OccluderWorkspace;
  using DepthWorkspace = cuda::DepthWorkspace;
  using BudgetWorkspace = cuda::BudgetWorkspace;
  using TransferWorkspace = cuda::TransferWorkspace;
  using BalanceWorkspace = cuda::BalanceWorkspace;
  template <class Index>
  using BlockStream = cuda::BlockStream<glm::vec3, Index>;
  static constexpr bool copies = true;
  template <class Index>
  using ReformWorkspace = cuda::ReformWorkspace<Index>;

  /// `shares`: whether OpenGL's driver is one that may share buffers with CUDA.
  CudaBackend(DrawBuffers& buffers, bool shares) : buffers_(buffers), mapped_(buffers) {
    int device = 0;
    cudaDeviceProp properties{};
    must(cudaGetDevice(&device), "asking for the device");
    must(cudaGetDeviceProperties(&properties, device), "asking for the device");
    free_at_first_ = free_bytes();
    info_.name = "cuda";
    char bus[32] = "";
    must(cudaDeviceGetPCIBusId(bus, sizeof bus, device), "asking for the device");
    info_.gpu = properties.name + std::string(", ") + bus;
    const cudaError_t error = shares ? try_to_share() : cudaErrorNotSupported;
    info_.interop = error == cudaSuccess;
    if (!info_.interop) {
      (void)cudaGetLastError();
      info_.note = std::string("OpenGL and CUDA share no buffers here") +
                   (shares ? std::string(" (") + cudaGetErrorString(error) + ")" : ", OpenGL is not NVIDIA's") +
                   ": frames are copied from the GPU and uploaded";
    }
  }

  template <class Index>
  void reserve(ReformWorkspace<Index>& workspace, std::size_t objects, std::uint32_t most_vertices) {
    must(workspace.reserve(objects, most_vertices), "taking memory");
  }

  void vertex_limits(auto&&... arguments) {
    must(cuda::vertex_limits(arguments..., launch()), "finding the ranges of the objects");
  }
  void cull_frustum(auto&&... arguments) { must(cuda::cull_frustum(arguments..., launch()), "culling"); }
  void select_occluders(auto&&... arguments) {
    must(cuda::select_occluders(arguments..., launch()), "choosing occluders");
  }
  void keep_flagged(auto&&... arguments) { must(cuda::keep_flagged(arguments..., launch()), "choosing among objects"); }
  void clear(std::span<Depth> depths) {
    static_assert(far_depth == 0xffffffffu);
    must(cudaMemsetAsync(depths.data(), 0xff, depths.size_bytes(), queue_.stream()), "clearing the depth");
  }
  void rasterize_depth(auto&&... arguments) {
    must(cuda::rasterize_depth(arguments..., launch()), "drawing the occluders");
  }
  void build_hzm(auto&&... arguments) { must(cuda::build_hzm(arguments..., launch()), "building the depth's levels"); }
  void cull_occluded(auto&&... arguments) {
    must(cuda::cull_occluded(arguments..., launch()), "culling what is hidden");
  }
  void project(auto&&... arguments) { must(cuda::project(arguments..., launch()), "projecting"); }
  void distribute_budget(auto&&... arguments) {
    must(cuda::distribute_budget(arguments..., launch()), "sharing the budget");
  }
  void error_scales(auto&&... arguments) { must(cuda::error_scales(arguments..., launch()), "bounding the errors"); }
  void select_by_error(auto&&... arguments) {
    must(cuda::select_by_error(arguments..., launch()), "selecting by error");
  }
  void balance(auto&&... arguments) { must(cuda::balance(arguments..., launch()), "cutting the picture into tiles"); }
  void in_tile(auto&&... arguments) { must(cuda::in_tile(arguments..., launch()), "finding who is in the tile"); }
  void take_unified(auto&&... arguments) {
    must(cuda::take_unified(arguments..., launch()), "taking what is in the tile");
  }
  void lay_out(auto&&... arguments) {
    must(cuda::lay_out(arguments..., lay_out_workspace_, launch()), "laying out the frame");
  }
  void limit_transfer(auto&&... arguments) {
    must(cuda::limit_transfer(arguments..., launch()), "limiting the transfer");
  }
  void reform(auto&&... arguments) { must(cuda::reform(arguments..., launch()), "reforming the triangles"); }
  void gather(auto&&... arguments) { must(cuda::gather(arguments..., launch()), "gathering the vertices"); }
  void finish() {
    must(cudaStreamSynchronize(queue_.stream()), "preparing a frame");
    if (drawing_) must(cudaStreamSynchronize(drawing_->stream()), "preparing a frame");
  }

  // A streamed frame is drawn on a stream of its own, so that the next one can be chosen meanwhile.
  template <class Index>
  void reserve(BlockStream<Index>& stream, std::size_t objects, std::uint64_t vertices, std::uint64_t triangles,
               std::uint64_t additional) {
    if (!drawing_) drawing_.emplace();
    must(stream.reserve(objects, vertices, triangles, additional), "taking memory: lower --budget or --gpu-memory");
  }
  void begin(auto& stream, auto&&... arguments) { must(stream.begin(arguments..., launch()), "choosing what is new"); }
  DeltaSize send(auto& stream, auto&&... arguments) {
    DeltaSize size;
    must(stream.send(arguments..., size), "sending what is new");
    return size;
  }
  void apply(auto& stream) { must(stream.apply(drawing()), "defragmenting the blocks"); }
  void reform_block(auto&&... arguments) {
    must(cuda::reform_block(arguments..., cuda::Launch(drawing())), "reforming the triangles");
  }
  void gather_block(auto&&... arguments) {
    must(cuda::gather_block(arguments..., cuda::Launch(drawing())), "gathering the vertices");
  }
  /// Memory of the device that has been taken since this backend was made, by whomever.
  std::uint64_t memory_used() const {
    const std::uint64_t now = free_bytes();
    return now < free_at_first_ ? free_at_first_ - now : 0;
  }
  /// What may be taken of it, with a tenth left for others.
  static std::optional<std::uint64_t> memory_free() { return free_bytes() / 10 * 9; }
  void prepare_drawing(std::size_t vertices, std::size_t triangles) {
    if (info_.interop) {
      must(mapped_.prepare(vertices, triangles, true), "opening OpenGL's buffers: lower --budget");
    } else {
      vertices_ = {};
      triangles_ = {};
      vertices_.resize(vertices);
      triangles_.resize(triangles);
    }
  }

  template <class... T>
  std::tuple<T...> fetch(const T*... values) {
    static_assert((std::is_trivially_copyable_v<T> && ...) && (sizeof(T) + ...) <= CudaQueue::results_size);
    std::size_t at = 0;
    const auto enqueue = [&](const void* value, std::size_t size) {
      must(cudaMemcpyAsync(queue_.results() + at, value, size, cudaMemcpyDeviceToHost, queue_.stream()),
           "reading the totals");
      at += size;
    };
    (enqueue(values, sizeof(T)), ...);
    must(cudaStreamSynchronize(queue_.stream()), "reading the totals");
    std::tuple<T...> fetched;
    at = 0;
    const auto take = [&](auto&... value) {
      ((std::memcpy(&value, queue_.results() + at, sizeof value), at += sizeof value), ...);
    };
    std::apply(take, fetched);
    return fetched;
  }
  template <class T>
  std::vector<std::remove_const_t<T>> download(std::span<T> values) {
    std::vector<std::remove_const_t<T>> result(values.size());
    copy_back(std::span<const T>(values), result, queue_.stream());
    must(cudaStreamSynchronize(queue_.stream()), "copying from the GPU");
    return result;
  }
  template <class T>
  void upload(std::span<const T> values, std::span<T> to) {
    if (values.empty()) return;
    must(cudaMemcpyAsync(to.data(), values.data(), values.size_bytes(), cudaMemcpyHostToDevice, queue_.stream()),
         "copying to the GPU");
    must(cudaStreamSynchronize(queue_.stream()), "copying to the GPU");
  }

  std::tuple<std::span<PlacedVertex>, std::span<Triangle<std::uint32_t>>> begin_drawing(std::size_t vertices,
                                                                                        std::size_t triangles) {
    PlacedVertex* vertex_pointer = nullptr;
    Triangle<std::uint32_t>* triangle_pointer = nullptr;
    if (info_.interop) {
      must(mapped_.prepare(vertices, triangles), "opening OpenGL's buffers: lower --budget");
      must(mapped_.map(drawing(), vertex_pointer, triangle_pointer), "mapping OpenGL's buffers");
    } else {
      vertices_.resize(vertices);
      triangles_.resize(triangles);
      vertex_pointer = vertices_.data();
      triangle_pointer = triangles_.data();
    }
    drawn_vertices_ = {vertex_pointer, vertices};
    drawn_triangles_ = {triangle_pointer, triangles};
    return {drawn_vertices_, drawn_triangles_};
  }
  void end_drawing() {
    if (info_.interop) {
      must(mapped_.unmap(drawing()), "giving OpenGL's buffers back");
      buffers_.set_drawn(drawn_vertices_.size(), drawn_triangles_.size());
      return;
    }
    copy_back(std::span<const PlacedVertex>(drawn_vertices_), host_vertices_, drawing());
    copy_back(std::span<const Triangle<std::uint32_t>>(drawn_triangles_), host_triangles_, drawing());
    finish();
    buffers_.upload(std::span(host_vertices_).first(drawn_vertices_.size()),
                    std::span(host_triangles_).first(drawn_triangles_.size()));
  }

  BackendInfo info() const { return info_; }

 private:
  cuda::Launch launch() const { return queue_.stream(); }
  cudaStream_t drawing() const { return drawing_ ? drawing_->stream() : queue_.stream(); }
  static std::uint64_t free_bytes() {
    std::size_t free = 0, total = 0;
    must(cudaMemGetInfo(&free, &total), "asking for the device's memory");
    return free;
  }

  /// Does once what every frame does with OpenGL's buffers. On an error they are OpenGL's alone again.
  cudaError_t try_to_share() {
    PlacedVertex* vertices = nullptr;
    Triangle<std::uint32_t>* triangles = nullptr;
    PGL_CUDA_TRY(mapped_.prepare(0, 0));
    cudaError_t error = mapped_.map(queue_.stream(), vertices, triangles);
    if (const cudaError_t unmapped = mapped_.unmap(queue_.stream()); error == cudaSuccess) error = unmapped;
    if (error == cudaSuccess) error = cudaStreamSynchronize(queue_.stream());
    if (error != cudaSuccess) (void)mapped_.forget();
    return error;
  }

  template <class T>
  void copy_back(std::span<const T> from, std::vector<T>& to, cudaStream_t stream) {
    if (from.empty()) return;
    if (to.size() < from.size()) to.resize(from.size());
    must(cudaMemcpyAsync(to.data(), from.data(), from.size_bytes(), cudaMemcpyDeviceToHost, stream),
         "copying from the GPU");
  }

  CudaQueue queue_;
  std::optional<CudaQueue> drawing_;
  std::uint64_t free_at_first_ = 0;
  DrawBuffers& buffers_;
  MappedBuffers mapped_;
  BackendInfo info_;
  cuda::ScanWorkspace lay_out_workspace_;
  DeviceArray<PlacedVertex> vertices_;  // these where nothing is shared with OpenGL
  DeviceArray<Triangle<std::uint32_t>> triangles_;
  std::vector<PlacedVertex> host_vertices_;
  std::vector<Triangle<std::uint32_t>> host_triangles_;
  std::span<PlacedVertex> drawn_vertices_;
  std::span<Triangle<std::uint32_t>> drawn_triangles_;
};

}  // namespace pgl::viewer
