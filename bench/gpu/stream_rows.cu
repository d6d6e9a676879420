// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cub/device/device_memcpy.cuh>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench.cuh"
#include "device_scene.cuh"
#include "host_stream.hpp"
#include "pgl/cuda/defragment.cuh"
#include "pgl/cuda/gather.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/pack_delta.cuh"
#include "pgl/cuda/reform.cuh"
#include "pgl/defragment.hpp"
#include "rows.hpp"
#include "stream_scene.cuh"

namespace pgl::bench {
namespace {

using Index = DeviceScene::Index;

/// HostBlocks on the device.
template <class T>
struct DeviceBlocks {
  DeviceBlocks(const Bench& bench, const HostBlocks<T>& host)
      : a_offsets(bench.upload(host.a_offsets)),
        b_offsets(bench.upload(host.b_offsets)),
        forth_delta(bench.upload(host.forth_delta)),
        back_delta(bench.upload(host.back_delta)),
        a(bench.upload(host.a)),
        forth_new(bench.upload(host.forth_new)),
        back_new(bench.upload(host.back_new)),
        block(bench.upload(host.block)),
        out(bench.array<T>(host.b.size())),
        out_a(bench.array<T>(host.a.size())) {}

  cudaError_t reset(cudaStream_t stream) const {
    return cudaMemcpyAsync(block.data(), a.data(), a.size() * sizeof(T), cudaMemcpyDeviceToDevice, stream);
  }
  cudaError_t keep(const DeviceArray<T>& to, cudaStream_t stream) const {
    return cudaMemcpyAsync(to.data(), block.data(), to.size() * sizeof(T), cudaMemcpyDeviceToDevice, stream);
  }
  cudaError_t defragment(cudaStream_t stream) const {
    return cuda::defragment<T>(a_offsets.input(), b_offsets.input(), forth_delta.input(), a.input(), forth_new.input(),
                               out.view(), stream);
  }
  cudaError_t forth(cudaStream_t stream) {
    return cuda::defragment_in_place<T>(a_offsets.input(), b_offsets.input(), forth_delta.input(), forth_new.input(),
                                        workspace, block.view(), stream);
  }
  cudaError_t back(cudaStream_t stream) {
    return cuda::defragment_in_place<T>(b_offsets.input(), a_offsets.input(), back_delta.input(), back_new.input(),
                                        workspace, block.view(), stream);
  }

  DeviceArray<std::uint64_t> a_offsets, b_offsets, forth_delta, back_delta;
  DeviceArray<T> a, forth_new, back_new, block;
  DeviceArray<T> out;    ///< b
  DeviceArray<T> out_a;  ///< a again
  cuda::DefragmentWorkspace workspace;
};

/// The least bytes: what is new and what moves (all that stays, out of place) read and written once, the offsets read.
template <class T>
std::uint64_t least_bytes(const HostBlocks<T>& h, bool in_place) {
  const std::uint64_t elements = in_place ? h.moved() + h.new_size() : h.b.size();
  return 2 * elements * sizeof(T) + 3 * h.a_offsets.size() * sizeof(std::uint64_t);
}

// ---- the peer: cub::DeviceMemcpy::Batched

/// Pieces to copy.
struct Pieces {
  const void** from;
  void** to;
  std::uint32_t* sizes;  // bytes
};

/// Writes the pieces of every object: what stays, then what is new; size 0 where there is none.
template <class T>
__global__ void pieces_kernel(const std::uint64_t* previous, const std::uint64_t* offsets, const std::uint64_t* delta,
                              std::uint64_t n, const T* existing, const T* additional, T* out, Pieces pieces) {
  const std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  if (i >= n) return;
  const KeptPart kept = kept_part(previous, offsets, i);
  const std::uint64_t fresh = offsets[i + 1] - kept.to - kept.size;
  pieces.from[2 * i] = existing + kept.from;
  pieces.to[2 * i] = out + kept.to;
  pieces.sizes[2 * i] = static_cast<std::uint32_t>(kept.size * sizeof(T));
  pieces.from[2 * i + 1] = additional + delta[i];
  pieces.to[2 * i + 1] = out + kept.to + kept.size;
  pieces.sizes[2 * i + 1] = static_cast<std::uint32_t>(fresh * sizeof(T));
}

/// Vertices and triangles in one batch.
template <class Corners>
struct Batch {
  Batch(const Bench& bench, const HostBlocks<glm::vec3>& host_v, const DeviceBlocks<glm::vec3>& vertices,
        const HostBlocks<Corners>& host_t, const DeviceBlocks<Corners>& triangles)
      : vertices_(vertices), triangles_(triangles), objects_(host_v.a_offsets.size() - 1) {
    if (bench.host_only()) return;
    std::vector<const void*> from;
    std::vector<void*> to;
    std::vector<std::uint32_t> sizes;
    const auto add = [&](const auto& host, const auto& device) {
      for (std::size_t i = 0; i < objects_; ++i) {
        const KeptPart kept = kept_part(host.a_offsets.data(), host.b_offsets.data(), i);
        const auto piece = [&](const auto* first, std::uint64_t at, std::uint64_t size) {
          if (size == 0) return;
          from.push_back(first);
          to.push_back(device.out.data() + at);
          sizes.push_back(static_cast<std::uint32_t>(size * sizeof(*first)));
        };
        piece(device.a.data() + kept.from, kept.to, kept.size);
        piece(device.forth_new.data() + host.forth_delta[i], kept.to + kept.size,
              host.b_offsets[i + 1] - kept.to - kept.size);
      }
    };
    add(host_v, vertices);
    add(host_t, triangles);
    size_ = from.size();
    from_ = bench.upload(from);
    to_ = bench.upload(to);
    sizes_ = bench.upload(sizes);
    const std::size_t all = 4 * objects_;
    all_from_ = bench.array<const void*>(all);
    all_to_ = bench.array<void*>(all);
    all_sizes_ = bench.array<std::uint32_t>(all);
    std::size_t bytes = 0, all_bytes = 0;
    must(cub::DeviceMemcpy::Batched(nullptr, bytes, from_.data(), to_.data(), sizes_.data(), count(size_)), "scratch");
    must(
        cub::DeviceMemcpy::Batched(nullptr, all_bytes, all_from_.data(), all_to_.data(), all_sizes_.data(), count(all)),
        "scratch");
    scratch_ = bench.array<std::byte>(std::max(bytes, all_bytes));
  }

  std::size_t size() const { return size_; }
  cudaError_t copy(cudaStream_t stream) const {
    std::size_t bytes = scratch_.size();
    return cub::DeviceMemcpy::Batched(scratch_.data(), bytes, from_.data(), to_.data(), sizes_.data(), count(size_),
                                      stream);
  }
  cudaError_t make_and_copy(cudaStream_t stream) const {
    const Pieces pieces{all_from_.data(), all_to_.data(), all_sizes_.data()};
    PGL_CUDA_TRY(make(vertices_, pieces, stream));
    PGL_CUDA_TRY(
        make(triangles_, {pieces.from + 2 * objects_, pieces.to + 2 * objects_, pieces.sizes + 2 * objects_}, stream));
    std::size_t bytes = scratch_.size();
    return cub::DeviceMemcpy::Batched(scratch_.data(), bytes, all_from_.data(), all_to_.data(), all_sizes_.data(),
                                      count(4 * objects_), stream);
  }

 private:
  static std::int64_t count(std::size_t size) { return static_cast<std::int64_t>(size); }
  template <class T>
  cudaError_t make(const DeviceBlocks<T>& b, Pieces pieces, cudaStream_t stream) const {
    return cuda::detail::run(pieces_kernel<T>, cuda::detail::blocks_for(objects_, 256), 0, stream, b.a_offsets.data(),
                             b.b_offsets.data(), b.forth_delta.data(), objects_, b.a.data(), b.forth_new.data(),
                             b.out.data(), pieces);
  }

  const DeviceBlocks<glm::vec3>& vertices_;
  const DeviceBlocks<Corners>& triangles_;
  std::size_t objects_, size_ = 0;
  DeviceArray<const void*> from_, all_from_;
  DeviceArray<void*> to_, all_to_;
  DeviceArray<std::uint32_t> sizes_, all_sizes_;
  DeviceArray<std::byte> scratch_;
};

std::string sizes_of(const SelectionPair& pair, std::uint64_t new_vertices, std::uint64_t new_triangles) {
  const auto percent = [](std::uint64_t part, std::uint64_t all) {
    char text[32];
    std::snprintf(text, sizeof text, "%.1f %%",
                  100.0 * static_cast<double>(part) / static_cast<double>(std::max<std::uint64_t>(all, 1)));
    return std::string(text);
  };
  const auto drawn = pair.b.counts.size() - static_cast<std::size_t>(std::ranges::count(pair.b.counts, 0u));
  return std::to_string(drawn) + " objects, " + std::to_string(pair.b.vertices()) + " vertices (" +
         percent(new_vertices, pair.b.vertices()) + " new), " + std::to_string(pair.b.triangles()) + " triangles (" +
         percent(new_triangles, pair.b.triangles()) + " new)";
}

/// Out of place, in place, and the peer twice, with triangles of one width.
template <class Corners>
void rows_of_width(Bench& bench, const std::vector<std::string>& names, const SelectionPair& pair,
                   HostBlocks<glm::vec3>& host_v, DeviceBlocks<glm::vec3>& v, HostBlocks<Corners>& host_t,
                   const Workload& workload) {
  DeviceBlocks<Corners> t(bench, host_t);
  const Batch<Corners> batch(bench, host_v, v, host_t, t);
  const std::string note = sizes_of(pair, host_v.new_size(), host_t.new_size());
  const auto out = [&] { return std::vector{expect(v.out, host_v.b), expect(t.out, host_t.b)}; };
  const std::uint64_t bytes = least_bytes(host_v, false) + least_bytes(host_t, false);
  // The aim is set for 10.5 million vertices and 15.8 million triangles of 12 bytes; here in proportion.
  const double share =
      static_cast<double>(host_v.b.size() * sizeof(glm::vec3) + host_t.b.size() * sizeof(Corners)) / (12 * 26.3e6);
  const auto aim = [&](double ms) {
    return sizeof(Corners) == 12 ? workload.target(ms * share) : std::optional<double>();
  };
  bench.row({.name = names[0],
             .bytes = bytes,
             .enqueue =
                 [&](cudaStream_t stream) {
                   PGL_CUDA_TRY(v.defragment(stream));
                   return t.defragment(stream);
                 },
             .outputs = out,
             .host =
                 [&] {
                   host_v.defragment();
                   host_t.defragment();
                 },
             .target_ms = aim(0.22),
             .note = note});
  bench.row({.name = names[1],
             .bytes = least_bytes(host_v, true) + least_bytes(host_t, true),
             .enqueue =
                 [&](cudaStream_t stream) {
                   PGL_CUDA_TRY(v.forth(stream));
                   PGL_CUDA_TRY(t.forth(stream));
                   PGL_CUDA_TRY(v.back(stream));
                   return t.back(stream);
                 },
             .check =
                 [&](cudaStream_t stream) {
                   const auto both = [&](auto& blocks) {
                     PGL_CUDA_TRY(blocks.reset(stream));
                     PGL_CUDA_TRY(blocks.forth(stream));
                     PGL_CUDA_TRY(blocks.keep(blocks.out, stream));
                     PGL_CUDA_TRY(blocks.back(stream));
                     return blocks.keep(blocks.out_a, stream);
                   };
                   PGL_CUDA_TRY(both(v));
                   return both(t);
                 },
             .calls = 2,
             .outputs =
                 [&] {
                   auto all = out();
                   all.push_back(expect(v.out_a, host_v.a));
                   all.push_back(expect(t.out_a, host_t.a));
                   return all;
                 },
             .host =
                 [&] {
                   host_v.forth();
                   host_t.forth();
                   host_v.back();
                   host_t.back();
                 },
             .target_ms = aim(0.44),
             .note = "forth and back, a half of it; its bytes are those of what moves and what is new"});
  if (!bench.host_only() && bench.wants(names[1])) {
    const double extra = static_cast<double>(v.workspace.memory.size() + t.workspace.memory.size());
    const double block = static_cast<double>(host_v.block.size() * sizeof(glm::vec3)) +
                         static_cast<double>(host_t.block.size() * sizeof(Corners));
    char text[64];
    std::snprintf(text, sizeof text, "; extra memory %.2f %% of the blocks", 100.0 * extra / block);
    bench.report.rows.back().note += text;
    bench.save();
  }
  bench.row({.name = names[2],
             .bytes = bytes,
             .enqueue = [&](cudaStream_t stream) { return batch.copy(stream); },
             .outputs = out,
             .note = "the peer: " + std::to_string(batch.size()) + " pieces, their arrays made before"});
  bench.row({.name = names[3],
             .bytes = bytes,
             .enqueue = [&](cudaStream_t stream) { return batch.make_and_copy(stream); },
             .outputs = out,
             .note = "the peer: all pieces of all objects, also those of nothing, their arrays made by a kernel"});
}

/// The other steps of a frame that is streamed, and the frame without its transfer.
struct DeviceStreamFrame {
  DeviceStreamFrame(const Bench& bench, const DeviceScene& of, const SelectionPair& between,
                    DeviceBlocks<glm::vec3>& vertex_blocks, DeviceBlocks<Triangle<Index>>& triangle_blocks,
                    const HostBlocks<glm::vec3>& host_v, const HostBlocks<Triangle<Index>>& host_t)
      : scene(of),
        pair(between),
        vertices(vertex_blocks),
        triangles(triangle_blocks),
        selector(bench, of),
        areas_b(bench.upload(between.b.areas)),
        depths_b(bench.upload(between.b.depths)),
        a_counts(bench.upload(between.a.counts)),
        b_counts(bench.upload(between.b.counts)),
        counts(bench.array<std::uint32_t>(between.a.counts.size())),
        limited(bench.array<std::uint32_t>(between.a.counts.size())),
        triangle_counts(bench.array<std::uint32_t>(between.a.counts.size())),
        vertex_offsets(bench.array<std::uint64_t>(between.a.counts.size() + 1)),
        triangle_offsets(bench.array<std::uint64_t>(between.a.counts.size() + 1)),
        vertex_delta(bench.array<std::uint64_t>(between.a.counts.size() + 1)),
        triangle_delta(bench.array<std::uint64_t>(between.a.counts.size() + 1)),
        b_block(bench.upload(host_v.b)),
        b_corners(bench.upload(host_t.b)),
        drawn_a(bench.array<PlacedVertex>(between.a.vertices())),
        drawn_b(bench.array<PlacedVertex>(between.b.vertices())),
        reformed_a(bench.array<Triangle<std::uint32_t>>(between.a.triangles())),
        reformed_b(bench.array<Triangle<std::uint32_t>>(between.b.triangles())) {}

  cudaError_t lay_out_delta(cudaStream_t stream) {
    return cuda::lay_out_delta(vertices.a_offsets.input(), vertices.b_offsets.input(), vertex_delta.view(),
                               delta_workspace, stream);
  }
  cudaError_t limit(std::uint64_t cap, cudaStream_t stream) {
    return selector.limit(areas_b.input(), depths_b.input(), pair.options_b, b_counts.input(), a_counts.input(),
                          transfer(cap), limited.view(), stream);
  }
  cudaError_t gather(cudaStream_t stream) {
    return cuda::gather_block<PlacedVertex, glm::vec3>(scene.objects.input(), b_block.input(),
                                                       vertices.b_offsets.input(), drawn_b.view(), stream);
  }
  cudaError_t reform(cudaStream_t stream) {
    return cuda::reform_block<Index>(scene.meshes.input(), scene.objects.input(), b_corners.input(), scene.ecol.input(),
                                     b_counts.input(), vertices.b_offsets.input(), triangles.b_offsets.input(),
                                     reform_workspace, reformed_b.view(), stream);
  }
  /// From selecting to the drawn buffers; the blocks follow from a to b or back. What is new is there.
  cudaError_t frame(bool to_b, cudaStream_t stream) {
    const BudgetOptions& options = to_b ? pair.options_b : pair.options_a;
    const auto& previous_counts = to_b ? a_counts : b_counts;
    const auto& previous_vertices = to_b ? vertices.a_offsets : vertices.b_offsets;
    const auto& previous_triangles = to_b ? triangles.a_offsets : triangles.b_offsets;
    PGL_CUDA_TRY(selector.want(to_b ? pair.view_b : pair.view_a, options, counts.view(), stream));
    PGL_CUDA_TRY(selector.limit(selector.areas.input(), selector.depths.input(), options, counts.input(),
                                previous_counts.input(), transfer(~std::uint64_t{0}), counts.view(), stream));
    PGL_CUDA_TRY(selector.lay_out(counts.input(), triangle_counts.view(), vertex_offsets.view(),
                                  triangle_offsets.view(), stream));
    PGL_CUDA_TRY(cuda::lay_out_delta(previous_vertices.input(), vertex_offsets.input(), vertex_delta.view(),
                                     delta_workspace, stream));
    PGL_CUDA_TRY(cuda::lay_out_delta(previous_triangles.input(), triangle_offsets.input(), triangle_delta.view(),
                                     delta_workspace, stream));
    PGL_CUDA_TRY(cuda::defragment_in_place<glm::vec3>(
        previous_vertices.input(), vertex_offsets.input(), vertex_delta.input(),
        (to_b ? vertices.forth_new : vertices.back_new).input(), vertices.workspace, vertices.block.view(), stream));
    PGL_CUDA_TRY(cuda::defragment_in_place<Triangle<Index>>(previous_triangles.input(), triangle_offsets.input(),
                                                            triangle_delta.input(),
                                                            (to_b ? triangles.forth_new : triangles.back_new).input(),
                                                            triangles.workspace, triangles.block.view(), stream));
    PGL_CUDA_TRY(cuda::reform_block<Index>(scene.meshes.input(), scene.objects.input(), triangles.block.input(),
                                           scene.ecol.input(), counts.input(), vertex_offsets.input(),
                                           triangle_offsets.input(), reform_workspace,
                                           (to_b ? reformed_b : reformed_a).view(), stream));
    return cuda::gather_block<PlacedVertex, glm::vec3>(scene.objects.input(), vertices.block.input(),
                                                       vertex_offsets.input(), (to_b ? drawn_b : drawn_a).view(),
                                                       stream);
  }
  cudaError_t forth_and_back(cudaStream_t stream) {
    PGL_CUDA_TRY(frame(true, stream));
    return frame(false, stream);
  }

  static TransferOptions transfer(std::uint64_t cap) {
    return {.cap = cap, .vertex_bytes = sizeof(glm::vec3), .triangle_bytes = sizeof(Triangle<Index>)};
  }

  const DeviceScene& scene;
  const SelectionPair& pair;
  DeviceBlocks<glm::vec3>& vertices;
  DeviceBlocks<Triangle<Index>>& triangles;
  DeviceSelector selector;
  DeviceArray<float> areas_b, depths_b;
  DeviceArray<std::uint32_t> a_counts, b_counts, counts, limited, triangle_counts;
  DeviceArray<std::uint64_t> vertex_offsets, triangle_offsets, vertex_delta, triangle_delta;
  DeviceArray<glm::vec3> b_block;
  DeviceArray<Triangle<Index>> b_corners;
  DeviceArray<PlacedVertex> drawn_a, drawn_b;
  DeviceArray<Triangle<std::uint32_t>> reformed_a, reformed_b;
  cuda::ScanWorkspace delta_workspace;
  cuda::ReformWorkspace<Index> reform_workspace;
};

void step_rows(Bench& bench, const std::string& suffix, HostStreamFrame& host, DeviceStreamFrame& device,
               const Workload& workload) {
  const SelectionPair& pair = host.pair;
  const std::uint64_t n = pair.b.counts.size();
  const std::uint64_t new_bytes =
      host.vertices.new_size() * sizeof(glm::vec3) + host.triangles.new_size() * sizeof(Triangle<Index>);
  bench.row({.name = "lay_out_delta" + suffix,
             .bytes = 3 * (n + 1) * sizeof(std::uint64_t),
             .enqueue = [&](cudaStream_t stream) { return device.lay_out_delta(stream); },
             .outputs = [&] { return std::vector{expect(device.vertex_delta, host.vertices.forth_delta)}; },
             .host = [&] { host.vertices.lay_out_delta(); },
             .note = "of the vertices"});
  std::uint64_t growing = 0;
  for (std::size_t i = 0; i < n; ++i) growing += pair.b.counts[i] > pair.a.counts[i] ? 1 : 0;
  for (const bool capped : {false, true}) {
    const std::uint64_t cap = capped ? new_bytes / 2 : ~std::uint64_t{0};
    bench.row({.name = (capped ? "limit_transfer" : "limit_transfer/no cap") + suffix,
               // Both counts in, one out; of what grows its area, depth, range, mesh and two entries of the map.
               .bytes = 3 * 4 * n + growing * (4 * 4 + 4 + sizeof(Mesh) + 2 * 4),
               .enqueue = [&device, cap](cudaStream_t stream) { return device.limit(cap, stream); },
               .outputs =
                   [&] {
                     return std::vector{expect(device.limited, host.limited),
                                        expect(device.selector.transfer_totals, std::span(&host.totals, 1))};
                   },
               .host = [&host, cap] { host.limit(cap); },
               .target_ms = capped ? workload.target(0.15) : std::nullopt,
               .note = std::to_string(growing) + " objects grow" + (capped ? "; the cap is half of what is new" : "")});
  }
  const std::uint64_t drawn = n - static_cast<std::uint64_t>(std::ranges::count(pair.b.counts, 0u));
  bench.row(
      {.name = "gather_block" + suffix,
       .bytes = pair.b.vertices() * (sizeof(glm::vec3) + sizeof(PlacedVertex)) + (n + 1) * 8 + drawn * sizeof(Object),
       .enqueue = [&](cudaStream_t stream) { return device.gather(stream); },
       .outputs = [&] { return std::vector{expect(device.drawn_b, host.drawn_b)}; },
       .host = [&] { host.gather(); }});
  bench.row({.name = "reform_block/16 bit" + suffix,
             // The entries of ecol that are met are not counted.
             .bytes = pair.b.triangles() * 3 * (sizeof(Index) + 4) + (n + 1) * 8 +
                      drawn * (sizeof(Object) + sizeof(Mesh) + 4 + 8),
             .enqueue = [&](cudaStream_t stream) { return device.reform(stream); },
             .outputs = [&] { return std::vector{expect(device.reformed_b, host.reformed_b)}; },
             .host = [&] { host.reform(); }});
  bench.row({.name = "frame/streamed" + suffix,
             .enqueue = [&](cudaStream_t stream) { return device.forth_and_back(stream); },
             .check =
                 [&](cudaStream_t stream) {
                   PGL_CUDA_TRY(device.vertices.reset(stream));
                   PGL_CUDA_TRY(device.triangles.reset(stream));
                   return device.forth_and_back(stream);
                 },
             .calls = 2,
             .outputs =
                 [&] {
                   return std::vector{expect(device.drawn_a, host.drawn_a), expect(device.drawn_b, host.drawn_b),
                                      expect(device.reformed_a, host.reformed_a),
                                      expect(device.reformed_b, host.reformed_b)};
                 },
             .host =
                 [&] {
                   host.forth();
                   host.back();
                 },
             .target_ms = workload.target(1.0),
             .note = "all steps but the transfer: cull_frustum to lay_out, limit_transfer (no cap), lay_out_delta and "
                     "defragment_in_place of both, reform_block, gather_block; forth and back, a half of it"});
}

/// Names that any of the rows of one pair of selections may have.
std::vector<std::string> defragment_names(const std::string& suffix) {
  return {"defragment" + suffix, "defragment_in_place" + suffix, "cub::DeviceMemcpy::Batched" + suffix,
          "cub::DeviceMemcpy::Batched and its arrays" + suffix};
}
std::string wide_suffix(const std::string& kind) {
  return "/12-byte triangles/" + kind;
}
std::string narrow_suffix(const std::string& kind) {
  return "/6-byte triangles/" + kind;
}

bool wants_any(const Bench& bench, const std::vector<std::string>& names) {
  return std::ranges::any_of(names, [&](const std::string& name) { return bench.wants(name); });
}
bool wants_defragment(const Bench& bench, const std::string& kind) {
  return wants_any(bench, defragment_names(wide_suffix(kind))) ||
         wants_any(bench, defragment_names(narrow_suffix(kind)));
}

/// Both widths of triangles.
void defragment_rows(Bench& bench, const std::string& kind, const SelectionPair& pair, HostBlocks<glm::vec3>& host_v,
                     DeviceBlocks<glm::vec3>& v, HostBlocks<Triangle<Index>>& host_t, const Workload& workload) {
  if (wants_any(bench, defragment_names(wide_suffix(kind)))) {
    HostBlocks<Triangle<std::uint32_t>> host_wide = widened(host_t);
    rows_of_width(bench, defragment_names(wide_suffix(kind)), pair, host_v, v, host_wide, workload);
  }
  if (wants_any(bench, defragment_names(narrow_suffix(kind)))) {
    rows_of_width(bench, defragment_names(narrow_suffix(kind)), pair, host_v, v, host_t, workload);
  }
}

/// All rows between two frames of a camera that moves.
void pair_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload,
               const std::string& kind, BudgetPolicy policy) {
  constexpr double new_share = 0.04;
  const std::string suffix = "/" + kind;
  const std::vector<std::string> steps = {"lay_out_delta" + suffix,         "limit_transfer" + suffix,
                                          "limit_transfer/no cap" + suffix, "gather_block" + suffix,
                                          "reform_block/16 bit" + suffix,   "frame/streamed" + suffix};
  if (!wants_any(bench, steps) && !wants_defragment(bench, kind)) return;
  const Cameras cameras(scene, workload.objects);
  const SelectionPair pair = make_pair(scene, cameras, {.budget = workload.budget, .policy = policy}, new_share);
  HostBlocks<glm::vec3> host_v = vertex_blocks(scene, pair);
  HostBlocks<Triangle<Index>> host_t = triangle_blocks(scene, pair);
  DeviceBlocks<glm::vec3> v(bench, host_v);
  defragment_rows(bench, kind, pair, host_v, v, host_t, workload);
  if (!wants_any(bench, steps)) return;
  DeviceBlocks<Triangle<Index>> t(bench, host_t);
  HostStreamFrame host(scene, pair, host_v, host_t);
  DeviceStreamFrame device(bench, device_scene, pair, v, t, host_v, host_t);
  step_rows(bench, suffix, host, device, workload);
}

/// Every object shows a few vertices and triangles.
void spread_rows(Bench& bench, const Scene& scene, const Workload& workload) {
  const std::string kind = "every object";
  if (!wants_defragment(bench, kind)) return;
  const SelectionPair pair = make_spread_pair(scene, workload.budget, workload.budget * 158 / 105);
  HostBlocks<glm::vec3> host_v = vertex_blocks(scene, pair);
  HostBlocks<Triangle<Index>> host_t = triangle_blocks(scene, pair);
  DeviceBlocks<glm::vec3> v(bench, host_v);
  defragment_rows(bench, kind, pair, host_v, v, host_t, workload);
}

}  // namespace

void stream_rows(Bench& bench, const Scene& scene, const DeviceScene& device_scene, const Workload& workload) {
  spread_rows(bench, scene, workload);
  pair_rows(bench, scene, device_scene, workload, "exact", BudgetPolicy::exact);
  pair_rows(bench, scene, device_scene, workload, "fair", BudgetPolicy::fair);
}

}  // namespace pgl::bench
