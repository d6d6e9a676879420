// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "bench.cuh"
#include "device_scene.cuh"
#include "host_stream.hpp"
#include "pgl/cuda/block_stream.cuh"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/defragment.cuh"
#include "pgl/cuda/gather.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/pack_delta.cuh"
#include "pgl/cuda/reform.cuh"
#include "pgl/pack_delta.hpp"
#include "rows.hpp"
#include "stream_scene.cuh"

namespace pgl::bench {
namespace {

using Index = DeviceScene::Index;
using Corners = Triangle<Index>;

constexpr double metres_per_frame = 1.0;

/// Vertices and triangles of the host that copies start from: page-locked where there is a device.
class Staging {
 public:
  void reserve(bool host_only, std::uint64_t vertices, std::uint64_t triangles) {
    triangles_at_ = (vertices * sizeof(glm::vec3) + 255) / 256 * 256;
    const std::size_t bytes = triangles_at_ + std::max<std::uint64_t>(triangles, 1) * sizeof(Corners);
    if (host_only) {
      plain_.resize(bytes);
    } else {
      must(pinned_.reserve(bytes), "page-locked memory");
    }
  }
  glm::vec3* vertices() { return reinterpret_cast<glm::vec3*>(data()); }
  Corners* triangles() { return reinterpret_cast<Corners*>(data() + triangles_at_); }

 private:
  std::byte* data() { return plain_.empty() ? pinned_.at<std::byte>() : plain_.data(); }
  std::vector<std::byte> plain_;
  cuda::PinnedBuffer pinned_;
  std::size_t triangles_at_ = 0;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

/// The frames of the path but the first, in which everything is new: sums of sizes, and each one's milliseconds.
struct Sums {
  int frames = 0, unpacked_frames = 0;
  double vertices = 0, triangles = 0, new_vertices = 0, new_triangles = 0, most_new = 0;
  double unpacked = 0, copies = 0;                    // a copy for each object
  std::vector<double> collect, transfer, defragment;  // with coherence
  std::vector<double> all_collect, all_transfer;      // without
  std::vector<double> select, offsets, build;         // the rest of a frame

  void add(const HostPath& path) {
    ++frames;
    const auto v = static_cast<double>(path.vertex_offsets.back()),
               t = static_cast<double>(path.triangle_offsets.back());
    vertices += v;
    triangles += t;
    new_vertices += static_cast<double>(path.new_vertices());
    new_triangles += static_cast<double>(path.new_triangles());
    most_new = std::max(most_new, static_cast<double>(path.new_vertices()) / std::max(v, 1.0));
  }
};

/// A stream and what is timed on it.
class Timed {
 public:
  Timed() {
    must(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "stream");
    for (cudaEvent_t* event : {&begin_, &end_}) must(cudaEventCreate(event), "event");
  }
  ~Timed() {
    cudaEventDestroy(begin_);
    cudaEventDestroy(end_);
    cudaStreamDestroy(stream_);
  }
  Timed(const Timed&) = delete;
  Timed& operator=(const Timed&) = delete;
  cudaStream_t stream() const { return stream_; }

  /// Milliseconds on the device that what `enqueue` puts on the stream takes. Waits.
  template <class Enqueue>
  double ms(Enqueue&& enqueue) {
    must(cudaEventRecord(begin_, stream_), "event");
    must(enqueue(stream_), "a step of the path");
    must(cudaEventRecord(end_, stream_), "event");
    must(cudaEventSynchronize(end_), "a step of the path");
    float elapsed = 0;
    must(cudaEventElapsedTime(&elapsed, begin_, end_), "event");
    return static_cast<double>(elapsed);
  }

 private:
  cudaStream_t stream_ = nullptr;
  cudaEvent_t begin_ = nullptr, end_ = nullptr;
};

/// Keeps host memory page-locked, where the system lets it.
class PageLocked {
 public:
  template <class T>
  explicit PageLocked(std::span<const T> memory) : memory_(const_cast<std::remove_const_t<T>*>(memory.data())) {
    locked_ = cudaHostRegister(memory_, memory.size_bytes(), cudaHostRegisterDefault) == cudaSuccess;
    if (!locked_) (void)cudaGetLastError();
  }
  ~PageLocked() {
    if (locked_) cudaHostUnregister(memory_);
  }
  PageLocked(const PageLocked&) = delete;
  PageLocked& operator=(const PageLocked&) = delete;
  bool locked() const { return locked_; }

 private:
  void* memory_;
  bool locked_ = false;
};

struct DeviceSelection {
  DeviceSelection(const Bench& bench, std::size_t objects)
      : counts(bench.array<std::uint32_t>(objects)),
        triangle_counts(bench.array<std::uint32_t>(objects)),
        vertex_offsets(bench.array<std::uint64_t>(objects + 1)),
        triangle_offsets(bench.array<std::uint64_t>(objects + 1)) {}
  DeviceArray<std::uint32_t> counts, triangle_counts;
  DeviceArray<std::uint64_t> vertex_offsets, triangle_offsets;
};

/// The flight on one selection policy.
class Flight {
 public:
  Flight(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload,
         BudgetPolicy policy, int frames)
      : bench_(bench),
        scene_(scene),
        device_scene_(device_scene),
        options_{.budget = workload.budget, .policy = policy},
        objects_(scene.objects.size()),
        frames_(frames),
        workload_(workload) {}

  /// Selects all frames on the host: how much room is needed, how much of each is new; collects where there is no
  /// device to do more.
  void on_host() {
    HostPath path(scene_, workload_.objects);
    Selector selector(scene_);
    Selection selection;
    for (int k = 0; k < frames_; ++k) {
      const View view = path.cameras.flight(metres(k));
      selector.select(view, options_for(options_, view), selection);
      path.next(selection.vertex_offsets, selection.triangle_offsets);
      new_vertices_.push_back(new_elements(path.previous_vertex_offsets, path.vertex_offsets));
      new_triangles_.push_back(new_elements(path.previous_triangle_offsets, path.triangle_offsets));
      vertex_room_ = std::max(vertex_room_, selection.vertices());
      triangle_room_ = std::max(triangle_room_, selection.triangles());
      if (!bench_.host_only()) continue;
      some_.reserve(true, vertex_room_, triangle_room_);
      Stopwatch watch;
      path.collect(some_.vertices(), some_.triangles());
      const double collect = watch.lap();
      path.collect_all(some_.vertices(), some_.triangles());
      const double all_collect = watch.lap();
      if (k == 0) continue;
      sums_.add(path);
      sums_.collect.push_back(collect);
      sums_.all_collect.push_back(all_collect);
    }
  }

  /// Each step alone, one after the other, and compared: the blocks after every frame with the whole selection packed.
  void step_by_step() {
    HostPath path(scene_, workload_.objects);
    DeviceSelector selector(bench_, device_scene_);
    DeviceSelection selections[2] = {{bench_, objects_}, {bench_, objects_}};
    for (DeviceArray<std::uint64_t>* offsets : {&selections[1].vertex_offsets, &selections[1].triangle_offsets}) {
      must(cudaMemset(offsets->data(), 0, offsets->size() * sizeof(std::uint64_t)), "memset");
    }
    const auto vertex_delta = bench_.array<std::uint64_t>(objects_ + 1);
    const auto triangle_delta = bench_.array<std::uint64_t>(objects_ + 1);
    const auto block = bench_.array<glm::vec3>(vertex_room_), additional = bench_.array<glm::vec3>(vertex_room_);
    const auto corners = bench_.array<Corners>(triangle_room_), more_corners = bench_.array<Corners>(triangle_room_);
    const auto drawn = bench_.array<PlacedVertex>(vertex_room_);
    const auto reformed = bench_.array<Triangle<std::uint32_t>>(triangle_room_);
    cuda::PinnedBuffer offsets_memory;
    must(offsets_memory.reserve(2 * (objects_ + 1) * sizeof(std::uint64_t)), "page-locked memory");
    const std::span<std::uint64_t> host_vertices{offsets_memory.at<std::uint64_t>(), objects_ + 1};
    const std::span<std::uint64_t> host_triangles{host_vertices.data() + objects_ + 1, objects_ + 1};
    some_.reserve(false, vertex_room_, triangle_room_);
    all_.reserve(false, vertex_room_, triangle_room_);
    std::vector<glm::vec3> block_back(vertex_room_);
    std::vector<Corners> corners_back(triangle_room_);
    cuda::ScanWorkspace scan;
    cuda::DefragmentWorkspace workspace;
    cuda::ReformWorkspace<Index> reform_workspace;
    const PageLocked locked_vertices(scene_.vertices), locked_triangles(scene_.triangles);
    unpacked_locked_ = locked_vertices.locked() && locked_triangles.locked();
    Timed timed;
    const auto copy = [&](auto* to, const auto* from, std::size_t count, cudaMemcpyKind kind) {
      return cudaMemcpyAsync(to, from, count * sizeof(*from), kind, timed.stream());
    };

    for (int k = 0; k < frames_; ++k) {
      const View view = path.cameras.flight(metres(k));
      const BudgetOptions options = options_for(options_, view);
      const DeviceSelection &now = selections[k % 2], &before = selections[1 - k % 2];
      struct {
        double select, offsets, collect, transfer, defragment, build, all_collect, all_transfer;
      } frame{};
      frame.select = timed.ms([&](cudaStream_t stream) {
        PGL_CUDA_TRY(selector.want(view, options, now.counts.view(), stream));
        PGL_CUDA_TRY(selector.lay_out(now.counts.input(), now.triangle_counts.view(), now.vertex_offsets.view(),
                                      now.triangle_offsets.view(), stream));
        return cudaSuccess;
      });
      frame.offsets = timed.ms([&](cudaStream_t) {
        PGL_CUDA_TRY(copy(host_vertices.data(), now.vertex_offsets.data(), objects_ + 1, cudaMemcpyDeviceToHost));
        return copy(host_triangles.data(), now.triangle_offsets.data(), objects_ + 1, cudaMemcpyDeviceToHost);
      });
      path.next(host_vertices, host_triangles);
      if (path.vertex_offsets.back() > vertex_room_ || path.triangle_offsets.back() > triangle_room_) {
        throw std::runtime_error("the device selects more than the host");
      }
      Stopwatch watch;
      path.collect(some_.vertices(), some_.triangles());
      frame.collect = watch.lap();
      frame.transfer = timed.ms([&](cudaStream_t) {
        PGL_CUDA_TRY(copy(additional.data(), some_.vertices(), path.new_vertices(), cudaMemcpyHostToDevice));
        return copy(more_corners.data(), some_.triangles(), path.new_triangles(), cudaMemcpyHostToDevice);
      });
      frame.defragment = timed.ms([&](cudaStream_t stream) {
        PGL_CUDA_TRY(cuda::lay_out_delta(before.vertex_offsets.input(), now.vertex_offsets.input(), vertex_delta.view(),
                                         scan, stream));
        PGL_CUDA_TRY(cuda::lay_out_delta(before.triangle_offsets.input(), now.triangle_offsets.input(),
                                         triangle_delta.view(), scan, stream));
        PGL_CUDA_TRY(cuda::defragment_in_place<glm::vec3>(before.vertex_offsets.input(), now.vertex_offsets.input(),
                                                          vertex_delta.input(), additional.input(), workspace,
                                                          block.view(), stream));
        return cuda::defragment_in_place<Corners>(before.triangle_offsets.input(), now.triangle_offsets.input(),
                                                  triangle_delta.input(), more_corners.input(), workspace,
                                                  corners.view(), stream);
      });
      frame.build = timed.ms([&](cudaStream_t stream) {
        PGL_CUDA_TRY(cuda::reform_block<Index>(device_scene_.meshes.input(), device_scene_.objects.input(),
                                               corners.input(), device_scene_.ecol.input(), now.counts.input(),
                                               now.vertex_offsets.input(), now.triangle_offsets.input(),
                                               reform_workspace, reformed.view(), stream));
        return cuda::gather_block<PlacedVertex, glm::vec3>(device_scene_.objects.input(), block.input(),
                                                           now.vertex_offsets.input(), drawn.view(), stream);
      });

      // Without coherence, and what the blocks must be.
      watch.lap();
      path.collect_all(all_.vertices(), all_.triangles());
      frame.all_collect = watch.lap();
      frame.all_transfer = timed.ms([&](cudaStream_t) {
        PGL_CUDA_TRY(copy(additional.data(), all_.vertices(), path.vertex_offsets.back(), cudaMemcpyHostToDevice));
        return copy(more_corners.data(), all_.triangles(), path.triangle_offsets.back(), cudaMemcpyHostToDevice);
      });
      compare(block, block_back, all_.vertices(), path.vertex_offsets.back());
      compare(corners, corners_back, all_.triangles(), path.triangle_offsets.back());
      equal_ = equal_ && path.new_vertices() == new_vertices_[static_cast<std::size_t>(k)] &&
               path.new_triangles() == new_triangles_[static_cast<std::size_t>(k)];

      last_vertices_ = path.vertex_offsets.back();
      last_triangles_ = path.triangle_offsets.back();

      // Without packing: what is new, object by object, from where it is in the model.
      if (k > 0 && k % unpacked_step == 0) {
        watch.lap();
        double copies = 0;
        const auto each = [&](const std::vector<std::uint64_t>& previous, const std::vector<std::uint64_t>& offsets,
                              const std::vector<std::uint64_t>& delta, std::uint64_t Mesh::*first, const auto& elements,
                              auto* to) {
          for (std::size_t i = 0; i < objects_; ++i) {
            const DeltaPart part = delta_part(previous.data(), offsets.data(), i);
            if (part.size == 0) continue;
            const auto* from = elements.data() + scene_.meshes[scene_.objects[i].mesh].*first + part.first;
            must(copy(to + delta[i], from, part.size, cudaMemcpyHostToDevice), "a copy for an object");
            ++copies;
          }
        };
        each(path.previous_vertex_offsets, path.vertex_offsets, path.vertex_delta, &Mesh::first_vertex, scene_.vertices,
             additional.data());
        each(path.previous_triangle_offsets, path.triangle_offsets, path.triangle_delta, &Mesh::first_triangle,
             scene_.triangles, more_corners.data());
        must(cudaStreamSynchronize(timed.stream()), "the copies of all objects");
        sums_.unpacked += watch.lap();
        sums_.copies += copies;
        ++sums_.unpacked_frames;
        compare(additional, block_back, some_.vertices(), path.new_vertices());
        compare(more_corners, corners_back, some_.triangles(), path.new_triangles());
      }
      if (k == 0) continue;
      sums_.add(path);
      sums_.select.push_back(frame.select);
      sums_.offsets.push_back(frame.offsets);
      sums_.collect.push_back(frame.collect);
      sums_.transfer.push_back(frame.transfer);
      sums_.defragment.push_back(frame.defragment);
      sums_.build.push_back(frame.build);
      sums_.all_collect.push_back(frame.all_collect);
      sums_.all_transfer.push_back(frame.all_transfer);
    }
  }

  /// The whole as a renderer does it, by BlockStream: frames per second, waiting after each frame, or packing and
  /// copying beside the frame before.
  double frames_per_second(bool overlapped) {
    const Cameras cameras(scene_, workload_.objects);
    Timed select, draw;
    const cudaStream_t select_stream = select.stream(), draw_stream = overlapped ? draw.stream() : select.stream();
    DeviceSelector selector(bench_, device_scene_);
    const DeviceSelection now(bench_, objects_);
    const auto drawn = bench_.array<PlacedVertex>(vertex_room_);
    const auto reformed = bench_.array<Triangle<std::uint32_t>>(triangle_room_);
    cuda::ReformWorkspace<Index> reform_workspace;
    cuda::BlockStream<glm::vec3, Index> stream;
    must(stream.reserve(objects_, vertex_room_, triangle_room_,
                        vertex_room_ * sizeof(glm::vec3) + triangle_room_ * sizeof(Corners)),
         "room for the blocks");
    Stopwatch watch;
    for (int k = 0; k < frames_; ++k) {
      const View view = cameras.flight(metres(k));
      must(selector.want(view, options_for(options_, view), now.counts.view(), select_stream), "select");
      must(selector.lay_out(now.counts.input(), now.triangle_counts.view(), now.vertex_offsets.view(),
                            now.triangle_offsets.view(), select_stream),
           "lay_out");
      must(stream.begin(now.counts.input(), now.vertex_offsets.input(), now.triangle_offsets.input(), select_stream),
           "begin");
      DeltaSize size;
      must(stream.send(scene_.meshes, scene_.objects, scene_.vertices, scene_.triangles, size), "send");
      equal_ = equal_ && size.vertices == new_vertices_[static_cast<std::size_t>(k)] &&
               size.triangles == new_triangles_[static_cast<std::size_t>(k)];
      must(stream.apply(draw_stream), "apply");
      must(cuda::reform_block<Index>(device_scene_.meshes.input(), device_scene_.objects.input(), stream.triangles(),
                                     device_scene_.ecol.input(), stream.counts(), stream.vertex_offsets(),
                                     stream.triangle_offsets(), reform_workspace, reformed.view(), draw_stream),
           "reform_block");
      must(cuda::gather_block<PlacedVertex, glm::vec3>(device_scene_.objects.input(), stream.vertices(),
                                                       stream.vertex_offsets(), drawn.view(), draw_stream),
           "gather_block");
      if (!overlapped || k == 0) must(cudaDeviceSynchronize(), "the frame");
      if (k == 0) watch.lap();  // everything is new in it
    }
    must(cudaDeviceSynchronize(), "the frames");
    const double ms = watch.lap();

    // After step_by_step, `all_` holds the last frame's selection.
    std::vector<glm::vec3> vertices(vertex_room_);
    std::vector<Corners> triangles(triangle_room_);
    compare(stream.vertices(), vertices, all_.vertices(), last_vertices_);
    compare(stream.triangles(), triangles, all_.triangles(), last_triangles_);
    return (frames_ - 1) * 1000.0 / ms;
  }

  void run(const std::string& kind) {
    on_host();
    double serial = 0, overlapped = 0;
    if (!bench_.host_only()) {
      step_by_step();
      serial = frames_per_second(false);
      overlapped = frames_per_second(true);
    }
    report(kind, serial, overlapped);
  }

 private:
  static constexpr int unpacked_step = 20;

  /// Where frame k is, from the middle of the street.
  double metres(int k) const { return (k - 0.5 * frames_) * metres_per_frame; }

  /// Compares the first `size` elements of device memory with what they must be.
  template <class Device, class T>
  void compare(const Device& device, std::vector<T>& room, const T* expected, std::uint64_t size) {
    must(cudaMemcpy(room.data(), device.data(), size * sizeof(T), cudaMemcpyDeviceToHost), "download");
    equal_ = equal_ && std::memcmp(room.data(), expected, size * sizeof(T)) == 0;
  }

  void report(const std::string& kind, double serial, double overlapped) {
    auto& figures = bench_.report.figures;
    const auto put = [&](const char* name, double value) { figures.emplace_back("path_" + kind + "_" + name, value); };
    const double n = std::max(sums_.frames, 1);
    put("frames", sums_.frames);
    put("metres_per_frame", metres_per_frame);
    put("vertices", sums_.vertices / n);
    put("triangles", sums_.triangles / n);
    put("new_vertices_share", sums_.new_vertices / std::max(sums_.vertices, 1.0));
    put("new_triangles_share", sums_.new_triangles / std::max(sums_.triangles, 1.0));
    put("most_new_vertices_share", sums_.most_new);
    put("coherent_collect_ms", median(sums_.collect));
    put("full_collect_ms", median(sums_.all_collect));
    put("coherent_bytes", (sums_.new_vertices * sizeof(glm::vec3) + sums_.new_triangles * sizeof(Corners)) / n);
    put("full_bytes", (sums_.vertices * sizeof(glm::vec3) + sums_.triangles * sizeof(Corners)) / n);
    if (bench_.host_only()) return;
    put("coherent_transfer_ms", median(sums_.transfer));
    put("coherent_defragment_ms", median(sums_.defragment));
    put("full_transfer_ms", median(sums_.all_transfer));
    if (sums_.unpacked_frames > 0) {
      put("unpacked_transfer_ms", sums_.unpacked / sums_.unpacked_frames);
      put("unpacked_copies", sums_.copies / sums_.unpacked_frames);
      put("unpacked_page_locked", unpacked_locked_ ? 1 : 0);
    }
    put("select_ms", median(sums_.select));
    put("offsets_ms", median(sums_.offsets));
    put("build_ms", median(sums_.build));
    put("serial_fps", serial);
    put("overlapped_fps", overlapped);
    char note[200];
    std::snprintf(note, sizeof note,
                  "a frame of the flight with all that goes over the bus, mean of %d; one after the other %.2f ms; "
                  "blocks compared after every step",
                  sums_.frames, 1000.0 / serial);
    bench_.add({.name = "path/" + kind, .ms = 1000.0 / overlapped, .equal = equal_, .note = note});
  }

  Bench& bench_;
  const Scene& scene_;
  const DeviceScene& device_scene_;
  BudgetOptions options_;
  std::size_t objects_;
  int frames_;
  Workload workload_;
  std::uint64_t vertex_room_ = 1, triangle_room_ = 1;
  std::vector<std::uint64_t> new_vertices_, new_triangles_;  // per frame
  Staging some_, all_;
  Sums sums_;
  std::uint64_t last_vertices_ = 0, last_triangles_ = 0;
  bool equal_ = true, unpacked_locked_ = false;
};

}  // namespace

void path_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload) {
  const std::pair<const char*, BudgetPolicy> kinds[] = {{"exact", BudgetPolicy::exact}, {"fair", BudgetPolicy::fair}};
  for (const auto& [kind, policy] : kinds) {
    const std::string name = std::string("path/") + kind;
    if (!bench.wants(name)) continue;
    std::fprintf(stderr, "gpu_bench: %s\n", name.c_str());
    try {
      Flight(bench, scene, device_scene, workload, policy, bench.quick() ? 22 : 61).run(kind);
    } catch (const std::exception& error) {
      (void)cudaGetLastError();
      bench.add({.name = name, .equal = false, .note = error.what()});
      if (!bench.host_only() && cudaDeviceSynchronize() != cudaSuccess) throw;  // nothing more can run here
    }
  }
}

}  // namespace pgl::bench
