// SPDX-License-Identifier: MIT
// Keeps the blocks of the last selection on the GPU and brings them up to the next one, sending no more than what is
// new.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/defragment.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/pack_delta.cuh"
#include "pgl/host/pack_delta.hpp"
#include "pgl/pack_delta.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

/// What pgl::host::BlockStream is, with the blocks on the GPU and the model in the memory of the CPU: the same blocks,
/// byte for byte.
///
/// A frame is begin(), send(), apply(), in this order, which is checked in debug builds. Unlike the other drivers it
/// has a stream and events of its own, since it is about what runs beside what:
///
///   select's stream   lay_out, begin ──┐ offsets to the host
///   CPU                                └─ send: packs into page-locked memory ──┐
///   its own stream                                                              └─ copy ──┐
///   draw's stream     reform, gather, draw of the frame before ...                        └─ apply, reform ...
///
/// So with two streams for selecting and drawing, a frame is selected, packed and copied while the one before is
/// reformed and drawn. Memory on the device: two selections (counts and offsets), two arrays of offsets, the blocks,
/// what is new, and the scratch of lay_out_delta and defragment_in_place; page-locked: two selections' offsets, what is
/// new. That grows with the largest frame so far, unless reserve() is told more; warm, nothing is allocated.
///
/// Every function returns the first error of the runtime; after one, only reserve() may be called. All calls are for
/// the device that was current in reserve(). Not for capture: send() waits.
template <class Vertex, class Index>
class BlockStream {
 public:
  BlockStream() = default;
  BlockStream(const BlockStream&) = delete;
  BlockStream& operator=(const BlockStream&) = delete;
  ~BlockStream() {
    if (copy_stream_ == nullptr) return;
    for (const cudaEvent_t event : {selected_, applied_, sent_}) {
      if (event == nullptr) continue;
      (void)cudaEventSynchronize(event);
      (void)cudaEventDestroy(event);
    }
    (void)cudaStreamSynchronize(copy_stream_);
    (void)cudaStreamDestroy(copy_stream_);
  }

  /// Makes room for selections of exactly so many objects, of at most so many vertices and triangles, and forgets the
  /// last one: the next frame starts from empty blocks. new_bytes: make room for frames that send so much too, e.g. the
  /// cap of limit_transfer; what is more than both blocks counts for nothing. Waits for the device.
  [[nodiscard]] cudaError_t reserve(std::size_t objects, std::uint64_t vertices, std::uint64_t triangles,
                                    std::uint64_t new_bytes = 0) {
    if (copy_stream_ == nullptr) PGL_CUDA_TRY(cudaStreamCreateWithFlags(&copy_stream_, cudaStreamNonBlocking));
    for (cudaEvent_t* event : {&selected_, &applied_, &sent_}) {
      if (*event == nullptr) PGL_CUDA_TRY(cudaEventCreateWithFlags(event, cudaEventDisableTiming));
    }
    PGL_CUDA_TRY(cudaDeviceSynchronize());
    objects_ = objects;
    vertex_room_ = vertices;
    triangle_room_ = triangles;
    const std::size_t offset_bytes = (objects + 1) * sizeof(std::uint64_t);
    for (Selection& selection : selections_) {
      PGL_CUDA_TRY(selection.counts.reserve(std::max<std::size_t>(1, objects) * sizeof(std::uint32_t)));
      PGL_CUDA_TRY(cudaMemset(selection.counts.template at<std::byte>(), 0, objects * sizeof(std::uint32_t)));
      for (Offsets* offsets : {&selection.vertices, &selection.triangles}) {
        PGL_CUDA_TRY(offsets->device.reserve(offset_bytes));
        PGL_CUDA_TRY(offsets->host.reserve(offset_bytes));
        PGL_CUDA_TRY(cudaMemset(offsets->device.template at<std::byte>(), 0, offset_bytes));
        std::fill_n(offsets->host.template at<std::uint64_t>(), objects + 1, 0);
      }
    }
    PGL_CUDA_TRY(vertex_delta_.reserve(offset_bytes));
    PGL_CUDA_TRY(triangle_delta_.reserve(offset_bytes));
    host_vertex_delta_.resize(objects + 1);
    host_triangle_delta_.resize(objects + 1);
    PGL_CUDA_TRY(vertices_.reserve(std::max<std::size_t>(1, vertices) * sizeof(Vertex)));
    PGL_CUDA_TRY(triangles_.reserve(std::max<std::size_t>(1, triangles) * sizeof(Triangle<Index>)));
    new_bytes = std::min(new_bytes, vertices * sizeof(Vertex) + triangles * sizeof(Triangle<Index>));
    if (new_bytes != 0) PGL_CUDA_TRY(make_room_for_new(new_bytes + alignment));
    next_step_ = Step::begin;
    return cudaDeviceSynchronize();
  }

  /// Takes the next selection, in device memory, on a stream: the arrays may change once what is enqueued here is done.
  /// counts[n], vertex_offsets[n+1], triangle_offsets[n+1] as for pgl::host::BlockStream. Only enqueues. Waits on the
  /// device for the last apply().
  [[nodiscard]] cudaError_t begin(std::span<const std::uint32_t> counts, std::span<const std::uint64_t> vertex_offsets,
                                  std::span<const std::uint64_t> triangle_offsets, Launch launch = {}) {
    PGL_ASSERT(next_step_ == Step::begin);
    next_step_ = Step::send;
    PGL_ASSERT(counts.size() == objects_);
    PGL_ASSERT(vertex_offsets.size() == objects_ + 1 && triangle_offsets.size() == objects_ + 1);
    current_ = 1 - current_;
    PGL_CUDA_TRY(cudaStreamWaitEvent(launch.stream, applied_));
    Selection &last = selections_[1 - current_], &next = selections_[current_];
    PGL_CUDA_TRY(cudaMemcpyAsync(next.counts.template at<std::byte>(), counts.data(), counts.size_bytes(),
                                 cudaMemcpyDeviceToDevice, launch.stream));
    const auto take = [&](std::span<const std::uint64_t> offsets, Offsets& before, Offsets& now,
                          Buffer& delta) -> cudaError_t {
      PGL_CUDA_TRY(cudaMemcpyAsync(now.device.template at<std::byte>(), offsets.data(), offsets.size_bytes(),
                                   cudaMemcpyDeviceToDevice, launch.stream));
      PGL_CUDA_TRY(cudaMemcpyAsync(now.host.template at<std::byte>(), offsets.data(), offsets.size_bytes(),
                                   cudaMemcpyDeviceToHost, launch.stream));
      return lay_out_delta(all(before.device), all(now.device), all(delta), scan_workspace_, launch);
    };
    PGL_CUDA_TRY(take(vertex_offsets, last.vertices, next.vertices, vertex_delta_));
    PGL_CUDA_TRY(take(triangle_offsets, last.triangles, next.triangles, triangle_delta_));
    return cudaEventRecord(selected_, launch.stream);
  }

  /// Waits until the selection is there, collects what is new with all threads and enqueues its copy to the device.
  /// meshes, objects, vertices and triangles are the scene's, in the memory of the CPU. Writes how much is new.
  [[nodiscard]] cudaError_t send(std::span<const Mesh> meshes, std::span<const Object> objects,
                                 std::span<const Vertex> vertices, std::span<const Triangle<Index>> triangles,
                                 DeltaSize& size) {
    PGL_ASSERT(next_step_ == Step::send);
    next_step_ = Step::apply;
    PGL_CUDA_TRY(cudaEventSynchronize(selected_));
    Selection &last = selections_[1 - current_], &next = selections_[current_];
    const auto before_v = on_host(last.vertices), now_v = on_host(next.vertices);
    const auto before_t = on_host(last.triangles), now_t = on_host(next.triangles);
    PGL_ASSERT(now_v.back() <= vertex_room_ && now_t.back() <= triangle_room_);
    size.vertices = host::lay_out_delta(before_v, now_v, host_vertex_delta_);
    size.triangles = host::lay_out_delta(before_t, now_t, host_triangle_delta_);
    size.bytes = size.vertices * sizeof(Vertex) + size.triangles * sizeof(Triangle<Index>);
    triangles_at_ = (size.vertices * sizeof(Vertex) + alignment - 1) / alignment * alignment;
    new_ = size;

    // The selection came behind the last apply(): what was sent for that has arrived and been read.
    const std::size_t bytes = triangles_at_ + size.triangles * sizeof(Triangle<Index>);
    PGL_CUDA_TRY(make_room_for_new(bytes));
    if (size.bytes != 0) {
      host::pack_delta<Vertex>(meshes, objects, &Mesh::first_vertex, vertices, before_v, now_v, host_vertex_delta_,
                               {staging_.at<Vertex>(), size.vertices});
      host::pack_delta<Triangle<Index>>(meshes, objects, &Mesh::first_triangle, triangles, before_t, now_t,
                                        host_triangle_delta_,
                                        {staging_.at<Triangle<Index>>(triangles_at_), size.triangles});
      PGL_CUDA_TRY(cudaMemcpyAsync(additional_.template at<std::byte>(), staging_.template at<std::byte>(), bytes,
                                   cudaMemcpyHostToDevice, copy_stream_));
    }
    return cudaEventRecord(sent_, copy_stream_);
  }

  /// Brings the blocks up to the selection, on a stream, once what was sent has arrived. Only enqueues. Whatever reads
  /// the blocks, or the selection as returned below, must come behind this call and before the next apply(): on the
  /// same stream, or ordered so by events.
  [[nodiscard]] cudaError_t apply(Launch launch = {}) {
    PGL_ASSERT(next_step_ == Step::apply);
    next_step_ = Step::begin;
    PGL_CUDA_TRY(cudaStreamWaitEvent(launch.stream, selected_));
    PGL_CUDA_TRY(cudaStreamWaitEvent(launch.stream, sent_));
    Selection &last = selections_[1 - current_], &next = selections_[current_];
    PGL_CUDA_TRY(defragment_in_place<Vertex>(all(last.vertices.device), all(next.vertices.device), all(vertex_delta_),
                                             {additional_.at<Vertex>(), new_.vertices}, workspace_,
                                             {vertices_.at<Vertex>(), vertex_room_}, launch));
    PGL_CUDA_TRY(defragment_in_place<Triangle<Index>>(
        all(last.triangles.device), all(next.triangles.device), all(triangle_delta_),
        {additional_.at<Triangle<Index>>(triangles_at_), new_.triangles}, workspace_,
        {triangles_.at<Triangle<Index>>(), triangle_room_}, launch));
    return cudaEventRecord(applied_, launch.stream);
  }

  /// The selection of the last begin(), in device memory; before the first one, nothing of every object.
  std::span<const std::uint32_t> counts() const {
    return {selections_[current_].counts.template at<std::uint32_t>(), objects_};
  }
  std::span<const std::uint64_t> vertex_offsets() const { return all(selections_[current_].vertices.device); }
  std::span<const std::uint64_t> triangle_offsets() const { return all(selections_[current_].triangles.device); }

  /// The blocks, in device memory, with all the room that they have.
  std::span<const Vertex> vertices() const { return {vertices_.at<Vertex>(), vertex_room_}; }
  std::span<const Triangle<Index>> triangles() const { return {triangles_.at<Triangle<Index>>(), triangle_room_}; }

 private:
  enum class Step : std::uint8_t { begin, send, apply };
  static constexpr std::size_t alignment = 256;

  struct Offsets {
    Buffer device;
    PinnedBuffer host;
  };
  struct Selection {
    Buffer counts;
    Offsets vertices, triangles;
  };

  std::span<std::uint64_t> all(const Buffer& buffer) const { return {buffer.at<std::uint64_t>(), objects_ + 1}; }
  std::span<const std::uint64_t> on_host(const Offsets& offsets) const {
    return {offsets.host.template at<std::uint64_t>(), objects_ + 1};
  }
  cudaError_t make_room_for_new(std::size_t bytes) {
    PGL_CUDA_TRY(additional_.reserve(bytes));
    return staging_.reserve(bytes);
  }

  std::size_t objects_ = 0;
  std::uint64_t vertex_room_ = 0, triangle_room_ = 0;
  Selection selections_[2];
  int current_ = 0;
  Step next_step_ = Step::begin;  // checked in debug builds
  DeltaSize new_;
  std::size_t triangles_at_ = 0;  // bytes in what is new
  Buffer vertex_delta_, triangle_delta_, vertices_, triangles_, additional_;
  std::vector<std::uint64_t> host_vertex_delta_, host_triangle_delta_;
  PinnedBuffer staging_;
  ScanWorkspace scan_workspace_;
  DefragmentWorkspace workspace_;
  cudaStream_t copy_stream_ = nullptr;
  cudaEvent_t selected_ = nullptr, applied_ = nullptr, sent_ = nullptr;
};

}  // namespace pgl::cuda
