// SPDX-License-Identifier: MIT
// Keeps the blocks of the last selection on the GPU and brings them up to the next one, sending no more than what is
// new.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <array>
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
///   draw's stream     apply, reform, gather, draw of the frame before ...                 └─ apply, reform ...
///
/// So with two streams for selecting and drawing, a frame is selected, packed and copied while the one before is
/// defragmented, reformed and drawn: what belongs to a frame under way is there twice, and a selection, which the frame
/// after it still needs, three times. Memory on the device: three selections (counts and offsets), four arrays of
/// offsets, the blocks, what is new (twice), and the scratch of lay_out_delta and defragment_in_place; page-locked:
/// three selections' offsets, what is new (twice). That grows with the largest frame so far, unless reserve() is told
/// more; warm, nothing is allocated.
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
    for (const Flight& flight : flights_) {
      for (const cudaEvent_t event : flight.events()) {
        if (event == nullptr) continue;
        (void)cudaEventSynchronize(event);
        (void)cudaEventDestroy(event);
      }
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
    for (Flight& flight : flights_) PGL_CUDA_TRY(flight.make_events());
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
    host_vertex_delta_.resize(objects + 1);
    host_triangle_delta_.resize(objects + 1);
    PGL_CUDA_TRY(vertices_.reserve(std::max<std::size_t>(1, vertices) * sizeof(Vertex)));
    PGL_CUDA_TRY(triangles_.reserve(std::max<std::size_t>(1, triangles) * sizeof(Triangle<Index>)));
    new_bytes = std::min(new_bytes, vertices * sizeof(Vertex) + triangles * sizeof(Triangle<Index>));
    for (Flight& flight : flights_) {
      PGL_CUDA_TRY(flight.vertex_delta.reserve(offset_bytes));
      PGL_CUDA_TRY(flight.triangle_delta.reserve(offset_bytes));
      if (new_bytes != 0) PGL_CUDA_TRY(make_room_for_new(flight, new_bytes + alignment));
    }
    next_step_ = Step::begin;
    return cudaDeviceSynchronize();
  }

  /// Takes the next selection, in device memory, on a stream: the arrays may change once what is enqueued here is done.
  /// counts[n], vertex_offsets[n+1], triangle_offsets[n+1] as for pgl::host::BlockStream. Only enqueues. Waits on the
  /// device for the apply() of the frame before the last.
  [[nodiscard]] cudaError_t begin(std::span<const std::uint32_t> counts, std::span<const std::uint64_t> vertex_offsets,
                                  std::span<const std::uint64_t> triangle_offsets, Launch launch = {}) {
    PGL_ASSERT(next_step_ == Step::begin);
    next_step_ = Step::send;
    PGL_ASSERT(counts.size() == objects_);
    PGL_ASSERT(vertex_offsets.size() == objects_ + 1 && triangle_offsets.size() == objects_ + 1);
    ++frame_;
    // The frame before the last had these arrays last, and whoever drew the one before that read the selection.
    PGL_CUDA_TRY(cudaStreamWaitEvent(launch.stream, flight().applied));
    Selection &last = selection(1), &next = selection(0);
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
    PGL_CUDA_TRY(take(vertex_offsets, last.vertices, next.vertices, flight().vertex_delta));
    PGL_CUDA_TRY(take(triangle_offsets, last.triangles, next.triangles, flight().triangle_delta));
    return cudaEventRecord(flight().selected, launch.stream);
  }

  /// Waits until the selection is there, collects what is new with all threads and enqueues its copy to the device.
  /// meshes, objects, vertices and triangles are the scene's, in the memory of the CPU. Writes how much is new.
  [[nodiscard]] cudaError_t send(std::span<const Mesh> meshes, std::span<const Object> objects,
                                 std::span<const Vertex> vertices, std::span<const Triangle<Index>> triangles,
                                 DeltaSize& size) {
    PGL_ASSERT(next_step_ == Step::send);
    next_step_ = Step::apply;
    Flight& now = flight();
    PGL_CUDA_TRY(cudaEventSynchronize(now.selected));
    Selection &last = selection(1), &next = selection(0);
    const auto before_v = on_host(last.vertices), now_v = on_host(next.vertices);
    const auto before_t = on_host(last.triangles), now_t = on_host(next.triangles);
    PGL_ASSERT(now_v.back() <= vertex_room_ && now_t.back() <= triangle_room_);
    size.vertices = host::lay_out_delta(before_v, now_v, host_vertex_delta_);
    size.triangles = host::lay_out_delta(before_t, now_t, host_triangle_delta_);
    size.bytes = size.vertices * sizeof(Vertex) + size.triangles * sizeof(Triangle<Index>);
    now.triangles_at = (size.vertices * sizeof(Vertex) + alignment - 1) / alignment * alignment;
    now.size = size;

    // The selection came behind the apply() of the frame before the last: what was sent for that has arrived, and has
    // been read.
    const std::size_t bytes = now.triangles_at + size.triangles * sizeof(Triangle<Index>);
    PGL_CUDA_TRY(make_room_for_new(now, bytes));
    if (size.bytes != 0) {
      host::pack_delta<Vertex>(meshes, objects, &Mesh::first_vertex, vertices, before_v, now_v, host_vertex_delta_,
                               {now.staging.template at<Vertex>(), size.vertices});
      host::pack_delta<Triangle<Index>>(meshes, objects, &Mesh::first_triangle, triangles, before_t, now_t,
                                        host_triangle_delta_,
                                        {now.staging.template at<Triangle<Index>>(now.triangles_at), size.triangles});
      PGL_CUDA_TRY(cudaMemcpyAsync(now.additional.template at<std::byte>(), now.staging.template at<std::byte>(), bytes,
                                   cudaMemcpyHostToDevice, copy_stream_));
    }
    return cudaEventRecord(now.sent, copy_stream_);
  }

  /// Brings the blocks up to the selection, on a stream, once what was sent has arrived. Only enqueues. Whatever reads
  /// the blocks, or the selection as returned below, must come behind this call and before the next apply(): on the
  /// same stream, or ordered so by events.
  [[nodiscard]] cudaError_t apply(Launch launch = {}) {
    PGL_ASSERT(next_step_ == Step::apply);
    next_step_ = Step::begin;
    const Flight& now = flight();
    PGL_CUDA_TRY(cudaStreamWaitEvent(launch.stream, now.selected));
    PGL_CUDA_TRY(cudaStreamWaitEvent(launch.stream, now.sent));
    const Selection &last = selection(1), &next = selection(0);
    PGL_CUDA_TRY(defragment_in_place<Vertex>(all(last.vertices.device), all(next.vertices.device),
                                             all(now.vertex_delta),
                                             {now.additional.template at<Vertex>(), now.size.vertices}, workspace_,
                                             {vertices_.at<Vertex>(), vertex_room_}, launch));
    PGL_CUDA_TRY(defragment_in_place<Triangle<Index>>(
        all(last.triangles.device), all(next.triangles.device), all(now.triangle_delta),
        {now.additional.template at<Triangle<Index>>(now.triangles_at), now.size.triangles}, workspace_,
        {triangles_.at<Triangle<Index>>(), triangle_room_}, launch));
    return cudaEventRecord(now.applied, launch.stream);
  }

  /// The selection of the last begin(), in device memory; before the first one, nothing of every object.
  std::span<const std::uint32_t> counts() const { return {selection(0).counts.template at<std::uint32_t>(), objects_}; }
  std::span<const std::uint64_t> vertex_offsets() const { return all(selection(0).vertices.device); }
  std::span<const std::uint64_t> triangle_offsets() const { return all(selection(0).triangles.device); }

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
  /// What belongs to one frame on its way.
  struct Flight {
    Buffer vertex_delta, triangle_delta, additional;
    PinnedBuffer staging;
    DeltaSize size;
    std::size_t triangles_at = 0;  ///< bytes from the beginning of what is new
    cudaEvent_t selected = nullptr, sent = nullptr, applied = nullptr;

    std::array<cudaEvent_t, 3> events() const { return {selected, sent, applied}; }
    cudaError_t make_events() {
      cudaEvent_t* const all[] = {&selected, &sent, &applied};
      for (cudaEvent_t* const event : all) {
        if (*event == nullptr) PGL_CUDA_TRY(cudaEventCreateWithFlags(event, cudaEventDisableTiming));
      }
      return cudaSuccess;
    }
  };

  Flight& flight() { return flights_[frame_ % 2]; }
  /// The selection of this frame, or of the one `before` it.
  Selection& selection(std::uint64_t before) { return selections_[(frame_ - before) % 3]; }
  const Selection& selection(std::uint64_t before) const { return selections_[(frame_ - before) % 3]; }

  std::span<std::uint64_t> all(const Buffer& buffer) const { return {buffer.at<std::uint64_t>(), objects_ + 1}; }
  std::span<const std::uint64_t> on_host(const Offsets& offsets) const {
    return {offsets.host.template at<std::uint64_t>(), objects_ + 1};
  }
  static cudaError_t make_room_for_new(Flight& flight, std::size_t bytes) {
    PGL_CUDA_TRY(flight.additional.reserve(bytes));
    return flight.staging.reserve(bytes);
  }

  std::size_t objects_ = 0;
  std::uint64_t vertex_room_ = 0, triangle_room_ = 0;
  std::uint64_t frame_ = 3;  // of the last begin()
  Selection selections_[3];
  Flight flights_[2];
  Step next_step_ = Step::begin;  // checked in debug builds
  Buffer vertices_, triangles_;
  std::vector<std::uint64_t> host_vertex_delta_, host_triangle_delta_;
  ScanWorkspace scan_workspace_;
  DefragmentWorkspace workspace_;
  cudaStream_t copy_stream_ = nullptr;
};

}  // namespace pgl::cuda
