// SPDX-License-Identifier: MIT
// Turns the first triangles of every selected object into the triangles of its mesh at the chosen vertex count.
#pragma once

#include <cooperative_groups.h>
#include <cuda_pipeline_primitives.h>
#include <cuda_runtime.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/tiles.cuh"
#include "pgl/reform.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

namespace reform_detail {

/// How the work is shared out; no result depends on it. To try another, derive from it and hide a member.
template <class Index>
struct Tuning {
  /// A warp takes 32 triangles times this at a time: 1 to 4.
  static constexpr unsigned rows = 4;
  /// Shared memory of a warp, where a block has that much for each of its warps.
  static constexpr unsigned area_bytes = 4096;
  /// Bytes of ecol, per triangle in the tile, up to which they are copied there; 0: never.
  static constexpr unsigned copy_worth = 128;
  /// Rounds of following; an object that needs more gets a table of final vertices. 0: every object does.
  static constexpr unsigned most_steps = 128;
  /// Blocks started, in terms of those that run at the same time.
  static constexpr unsigned waves = 4;
};

inline constexpr std::uint64_t finish_blocks = 256;            ///< at most, for the objects with large tables
inline constexpr std::uint64_t least_table_entries = 1 << 22;  ///< shared by these blocks, an object each

template <class Index>
struct Scene {
  const Mesh* meshes;
  const Object* objects;
  std::uint64_t size;  // objects
  const Triangle<Index>* triangles;
  const Index* ecol;
  std::uint64_t ecol_size;
  const std::uint32_t* counts;
  const std::uint64_t* vertex_offsets;  // null: indices are local
  const std::uint64_t* triangle_offsets;
  bool block = false;  // triangles are the selected ones alone, at triangle_offsets
};

/// Objects with chains too long to follow and too many vertices for a table in shared memory.
template <class Index>
struct Postponed {
  std::uint32_t* size;
  std::uint32_t* marks;  // a bit per object
  std::uint32_t* list;
  Index* table;
  std::uint64_t entries;  // of the table
};

/// What the tiles need of an object, found once: its mesh, its place in the frame, whether it is mirrored.
struct alignas(16) Digest {
  std::uint64_t first_vertex;
  std::uint64_t first_triangle;
  std::uint32_t vertices;  // of the whole mesh
  std::uint32_t count;
  std::uint32_t base;
  std::uint32_t mirror;
};

/// An object in a warp's tile.
template <class Index>
struct Shown {
  const Index* ecol;   // of its mesh, or so that a copy is where entries from `count` on would be
  std::uint64_t from;  // the triangle that belongs at position 0 of the tile, modulo 2^64
  std::uint32_t base;
  std::uint32_t count;
  std::uint32_t vertices;  // of the whole mesh
  std::uint16_t lane;      // that knows more
  std::uint16_t mirror;
};

static_assert(sizeof(Shown<std::uint16_t>) == 32);

/// What of a warp's shared memory is for copies of ecol: the rest are its objects and their heads (detail::slot_of).
template <class Index>
PGL_HD constexpr unsigned slab_bytes_of(unsigned area_bytes) {
  return area_bytes - 32 * static_cast<unsigned>(sizeof(Shown<Index>)) - 16;
}

/// Reads a triangle in two words, or in three.
__device__ inline Triangle<std::uint32_t> corners_of(const Triangle<std::uint16_t>* triangle) {
  const std::uint16_t* v = triangle->v;
  const unsigned odd = reinterpret_cast<std::uintptr_t>(v) / 2 % 2;  // then corners 1 and 2 are an aligned word
  const std::uint32_t two = __ldg(reinterpret_cast<const std::uint32_t*>(v + odd));
  const std::uint32_t one = __ldg(v + 2 * (1 - odd));
  const std::uint32_t low = two & 0xffffu, high = two >> 16;
  return {{odd ? one : low, odd ? low : high, odd ? high : one}};
}
__device__ inline Triangle<std::uint32_t> corners_of(const Triangle<std::uint32_t>* triangle) {
  return {{__ldg(triangle->v), __ldg(triangle->v + 1), __ldg(triangle->v + 2)}};
}

template <class T>
__device__ bool any_from(const Triangle<T>& t, std::uint32_t count) {
  return t.v[0] >= count || t.v[1] >= count || t.v[2] >= count;
}

/// Writes the final vertices of [count, vertices) to table[0 ..), a whole warp together. Upwards by 32: targets below
/// these have theirs already, those among them are found by doubling. Linear, whatever the chains.
template <class Index>
__device__ void fill_table(const Index* ecol, std::uint32_t count, std::uint32_t vertices, Index* table) {
  const unsigned lane = detail::lane_index();
  for (std::uint64_t first = count; first < vertices; first += 32) {
    const std::uint64_t v = first + lane;
    std::uint32_t target = v < vertices ? static_cast<std::uint32_t>(ecol[v]) : 0u;
    if (v < vertices && target >= count && target < first) target = table[target - count];
    for (;;) {
      const bool inside = v < vertices && target >= first;
      if (!__any_sync(detail::whole_warp, inside)) break;
      const auto other = inside ? static_cast<unsigned>(target - first) : lane;
      PGL_ASSERT(!inside || other < lane);
      const std::uint32_t next = __shfl_sync(detail::whole_warp, target, static_cast<int>(other));
      if (inside) target = next;
    }
    if (v < vertices) table[v - count] = static_cast<Index>(target);
    __syncwarp();
  }
}

/// Notes for every tile of the output which object holds its first triangle: a search by each tile would read more than
/// the tile itself; and for every object with triangles what its tiles would each look up again. A thread per object; a
/// warp together where one has many tiles. Also, nothing is postponed yet.
template <class Index>
__global__ void __launch_bounds__(1024)
    tiles_kernel(Scene<Index> scene, Postponed<Index> postponed, detail::TileStart start, unsigned tile,
                 std::uint32_t* first_objects, Digest* digests) {
  const std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  if (i == 0) *postponed.size = 0;
  if (i % 32 == 0 && i < scene.size) postponed.marks[i / 32] = 0;
  std::uint64_t first = 0, last = 0;  // tiles
  if (i < scene.size) {
    const std::uint64_t begin = scene.triangle_offsets[i], end = scene.triangle_offsets[i + 1];
    if (begin < end) {
      first = begin == 0 ? 0 : (begin + start.lead + tile - 1) / tile;
      last = (end + start.lead + tile - 1) / tile;
      const Object& object = scene.objects[i];
      const Mesh& mesh = scene.meshes[object.mesh];
      PGL_ASSERT(mesh.first_vertex + mesh.max_vertices <= scene.ecol_size);
      digests[i] = {.first_vertex = mesh.first_vertex,
                    .first_triangle = scene.block ? begin : mesh.first_triangle,
                    .vertices = mesh.max_vertices,
                    .count = scene.counts[i],
                    .base = scene.vertex_offsets == nullptr ? 0u : static_cast<std::uint32_t>(scene.vertex_offsets[i]),
                    .mirror = mirrored(object.transform) ? 1u : 0u};
      PGL_ASSERT(scene.counts[i] > 0 && scene.counts[i] >= mesh.min_vertices && scene.counts[i] <= mesh.max_vertices);
    }
  }
  constexpr std::uint64_t few = 4;
  if (last - first <= few)
    for (std::uint64_t j = first; j < last; ++j) first_objects[j] = static_cast<std::uint32_t>(i);
  for (unsigned many = __ballot_sync(detail::whole_warp, last - first > few); many != 0; many &= many - 1) {
    const int lane = __ffs(static_cast<int>(many)) - 1;
    const std::uint64_t from = __shfl_sync(detail::whole_warp, first, lane);
    const std::uint64_t to = __shfl_sync(detail::whole_warp, last, lane);
    const std::uint64_t object = __shfl_sync(detail::whole_warp, i, lane);
    for (std::uint64_t j = from + detail::lane_index(); j < to; j += 32)
      first_objects[j] = static_cast<std::uint32_t>(object);
  }
}

/// Each warp takes tiles of the output: finds their objects, one per lane, copies the collapses that they may need to
/// shared memory, and gives each lane a triangle of every row.
template <class Tune, class OutIndex, class Index>
__global__ void __launch_bounds__(1024)
    reform_kernel(Scene<Index> scene, Postponed<Index> postponed, Triangle<OutIndex>* out,
                  [[maybe_unused]] std::uint64_t out_size, detail::TileStart start, const std::uint32_t* first_objects,
                  const Digest* digests, unsigned area_bytes) {
  static_assert(Tune::rows >= 1 && Tune::rows <= 4);
  constexpr unsigned tile = 32 * Tune::rows;
  extern __shared__ uint4 pgl_shared_memory[];
  const unsigned lane = detail::lane_index();
  const unsigned slab_bytes = slab_bytes_of<Index>(area_bytes);
  auto* slab = reinterpret_cast<std::byte*>(pgl_shared_memory) + threadIdx.x / 32 * area_bytes;
  auto* shown = reinterpret_cast<Shown<Index>*>(slab + slab_bytes);
  auto* heads = reinterpret_cast<unsigned*>(shown + 32);

  const std::uint64_t total = scene.triangle_offsets[scene.size];
  PGL_ASSERT(total <= out_size);
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t j = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32;
       j * tile < total + start.lead; j += stride) {
    const std::uint64_t origin = j * tile - start.lead;
    const std::uint64_t lo = j == 0 ? 0 : origin;
    const std::uint64_t hi = origin + tile < total ? origin + tile : total;
    if (lo >= hi) continue;
    detail::for_each_group<Tune::rows>(
        scene.triangle_offsets, scene.size, first_objects[j], origin, lo, hi, heads,
        [&](const detail::TilePart& part, unsigned first, unsigned last) {
          // What the lane's object is, and how much of ecol it is worth to copy, in units of 16 bytes.
          Shown<Index> mine{};
          const Index* ecol = nullptr;
          std::uintptr_t copy_from = 0;
          unsigned copied = 0;
          if (part.size != 0) {
            const Digest object = digests[part.object];
            ecol = scene.ecol + object.first_vertex;
            mine.ecol = ecol;
            mine.from = object.first_triangle + (origin - part.begin);
            mine.base = object.base;
            mine.count = object.count;
            mine.vertices = object.vertices;
            mine.lane = static_cast<std::uint16_t>(lane);
            mine.mirror = static_cast<std::uint16_t>(object.mirror);
            if (Tune::most_steps != 0 && mine.count < mine.vertices) {
              copy_from = reinterpret_cast<std::uintptr_t>(ecol + mine.count) & ~std::uintptr_t{15};
              const auto copy_end = (reinterpret_cast<std::uintptr_t>(ecol + mine.vertices) + 15) & ~std::uintptr_t{15};
              const std::uint64_t bytes = copy_end - copy_from;
              if (bytes <= slab_bytes && bytes <= Tune::copy_worth * part.size &&
                  copy_from >= reinterpret_cast<std::uintptr_t>(scene.ecol) &&
                  copy_end <= reinterpret_cast<std::uintptr_t>(scene.ecol + scene.ecol_size)) {
                copied = static_cast<unsigned>(bytes / 16);
              }
            }
          }
          unsigned copy_to_end = copied;
          for (unsigned d = 1; d < 32; d *= 2) {
            const unsigned before = __shfl_up_sync(detail::whole_warp, copy_to_end, d);
            if (lane >= d) copy_to_end += before;
          }
          const unsigned copy_to = copy_to_end - copied;
          if (copy_to_end * 16 > slab_bytes) copied = 0;
          if (copied != 0) {
            mine.ecol = reinterpret_cast<const Index*>(reinterpret_cast<std::uintptr_t>(slab + copy_to * 16) -
                                                       (copy_from - reinterpret_cast<std::uintptr_t>(ecol)));
          }
          if (part.size != 0) shown[part.slot] = mine;
          for (unsigned left = __ballot_sync(detail::whole_warp, copied != 0); left != 0; left &= left - 1) {
            const int k = __ffs(static_cast<int>(left)) - 1;
            const auto size = __shfl_sync(detail::whole_warp, copied, k);
            const auto* from = reinterpret_cast<const uint4*>(static_cast<std::uintptr_t>(
                __shfl_sync(detail::whole_warp, static_cast<unsigned long long>(copy_from), k)));
            auto* to = reinterpret_cast<uint4*>(slab) + __shfl_sync(detail::whole_warp, copy_to, k);
            for (unsigned i = lane; i < size; i += 32) __pipeline_memcpy_async(to + i, from + i, sizeof(uint4));
          }
          __pipeline_commit();
          __syncwarp();

          const auto in_group = [&](unsigned r) { return 32 * r + lane >= first && 32 * r + lane < last; };
          Triangle<std::uint32_t> corners[Tune::rows];
          unsigned slots = 0;  // a byte per row
          const auto object_of = [&](unsigned r) -> const Shown<Index>& { return shown[slots >> (8 * r) & 31]; };
#pragma unroll
          for (unsigned r = 0; r < Tune::rows; ++r) {
            corners[r] = {};
            if (!in_group(r)) continue;
            slots |= detail::slot_of(heads, r) << (8 * r);
            const Shown<Index>& object = object_of(r);
            corners[r] = corners_of(scene.triangles + (object.from + (32 * r + lane)));
            PGL_ASSERT(!any_from(corners[r], object.vertices));
          }
          __pipeline_wait_prior(0);
          __syncwarp();

          unsigned unfinished = 0;  // rows
#pragma unroll
          for (unsigned r = 0; r < Tune::rows; ++r) {
            if (!in_group(r)) continue;
            const Shown<Index>& object = object_of(r);
            std::uint32_t steps = Tune::most_steps;
            corners[r] = follow_corners(object.ecol, object.count, corners[r], steps);
            if (any_from(corners[r], object.count)) unfinished |= 1u << r;
          }
          __syncwarp();

          // Too long: one object after the other, by a table if it fits, which takes the place of the copies.
          for (;;) {
            const unsigned waiting = __ballot_sync(detail::whole_warp, unfinished != 0);
            if (waiting == 0) break;
            const unsigned mine_next =
                unfinished == 0 ? 0 : slots >> (8 * (__ffs(static_cast<int>(unfinished)) - 1)) & 31;
            const unsigned slot = __shfl_sync(detail::whole_warp, mine_next, __ffs(static_cast<int>(waiting)) - 1);
            const Shown<Index> object = shown[slot];
            const auto* all = reinterpret_cast<const Index*>(static_cast<std::uintptr_t>(
                __shfl_sync(detail::whole_warp, static_cast<unsigned long long>(reinterpret_cast<std::uintptr_t>(ecol)),
                            object.lane)));
            const auto number = static_cast<std::uint64_t>(
                __shfl_sync(detail::whole_warp, static_cast<unsigned long long>(part.object), object.lane));
            auto* table = reinterpret_cast<Index*>(slab);
            const bool fits = std::uint64_t{object.vertices - object.count} * sizeof(Index) <= slab_bytes;
            if (fits) {
              fill_table(all, object.count, object.vertices, table);
            } else if (lane == 0) {
              PGL_ASSERT(object.vertices <= postponed.entries);
              const std::uint32_t mark = 1u << (number % 32);
              if ((atomicOr(postponed.marks + number / 32, mark) & mark) == 0) {
                postponed.list[atomicAdd(postponed.size, 1u)] = static_cast<std::uint32_t>(number);
              }
            }
#pragma unroll
            for (unsigned r = 0; r < Tune::rows; ++r) {
              if ((unfinished >> r & 1) == 0 || (slots >> (8 * r) & 31) != slot) continue;
              unfinished &= ~(1u << r);
              for (std::uint32_t& v : corners[r].v) {
                if (fits && v >= object.count) v = table[v - object.count];
              }
            }
            __syncwarp();
          }

          auto* staged = reinterpret_cast<Triangle<OutIndex>*>(slab);
#pragma unroll
          for (unsigned r = 0; r < Tune::rows; ++r) {
            if (32 * r >= last || 32 * r + 32 <= first) continue;
            if (in_group(r)) {
              const Shown<Index>& object = object_of(r);
              staged[lane] = drawn_triangle<OutIndex>(corners[r], object.base, object.mirror != 0);
            }
            __syncwarp();
            detail::write_row<OutIndex>(staged, out, origin + 32 * r, first > 32 * r ? first - 32 * r : 0,
                                        last < 32 * r + 32 ? last - 32 * r : 32, start.aligned);
            __syncwarp();
          }
        });
  }
}

/// Writes all triangles of one object by a table of final vertices, which it makes by pointer doubling. Thread `thread`
/// of `threads` that all come here; sync() lets each see what the others wrote.
template <class OutIndex, class Index, class Sync>
__device__ void by_large_table(const Scene<Index>& scene, std::uint64_t i, Index* table, std::uint64_t thread,
                               std::uint64_t threads, Triangle<OutIndex>* out, Sync sync) {
  const Object& object = scene.objects[i];
  const Mesh& mesh = scene.meshes[object.mesh];
  const std::uint32_t count = scene.counts[i];
  const Index* ecol = scene.ecol + mesh.first_vertex;
  for (std::uint64_t v = thread; v < mesh.max_vertices; v += threads) {
    table[v] = v < count ? static_cast<Index>(v) : ecol[v];
  }
  sync();
  // Each round doubles the collapses that an entry has behind it; an entry read while another thread writes it is
  // either the old or the new one, and both are on the way.
  for (std::uint64_t done = 1; done < mesh.max_vertices - count; done *= 2) {
    for (std::uint64_t v = count + thread; v < mesh.max_vertices; v += threads) {
      table[v] = final_vertex<Index>(table, count, table, static_cast<std::uint32_t>(v));
    }
    sync();
  }
  const std::uint64_t begin = scene.triangle_offsets[i];
  const std::uint64_t size = scene.triangle_offsets[i + 1] - begin;
  const std::uint64_t base = scene.vertex_offsets == nullptr ? 0 : scene.vertex_offsets[i];
  const bool mirror = mirrored(object.transform);
  const Triangle<Index>* triangles = scene.triangles + (scene.block ? begin : mesh.first_triangle);
  for (std::uint64_t t = thread; t < size; t += threads) {
    const Triangle<Index>& in = triangles[t];
    const Triangle<Index> reformed{{table[in.v[0]], table[in.v[1]], table[in.v[2]]}};
    out[begin + t] = drawn_triangle<OutIndex>(reformed, base, mirror);
  }
  sync();
}

/// The postponed objects: a block each where the table has room for a block's share, then the whole grid together.
template <class OutIndex, class Index>
__global__ void __launch_bounds__(1024)
    finish_kernel(Scene<Index> scene, Postponed<Index> postponed, Triangle<OutIndex>* out) {
  const std::uint32_t size = *postponed.size;
  if (size == 0) return;
  const auto grid = cooperative_groups::this_grid();
  const std::uint64_t share = postponed.entries / gridDim.x;
  const auto vertices_of = [&](std::uint32_t i) { return scene.meshes[scene.objects[i].mesh].max_vertices; };
  for (std::uint64_t j = blockIdx.x; j < size; j += gridDim.x) {
    const std::uint32_t i = postponed.list[j];
    if (vertices_of(i) > share) continue;
    by_large_table(scene, i, postponed.table + blockIdx.x * share, threadIdx.x, blockDim.x, out,
                   [] { __syncthreads(); });
  }
  grid.sync();
  for (std::uint64_t j = 0; j < size; ++j) {
    const std::uint32_t i = postponed.list[j];
    if (vertices_of(i) <= share || vertices_of(i) > postponed.entries) continue;
    by_large_table(scene, i, postponed.table, grid.thread_rank(), grid.size(), out, [&] { grid.sync(); });
  }
}

/// The arrays of a scene with one object.
struct One {
  Mesh mesh;
  Object object;
  std::uint32_t count;
  std::uint64_t triangle_offsets[2];
};
template <class T>  // a template, so that every file that includes this may have it
__global__ void put_kernel(T value, T* to) {
  if (blockIdx.x == 0 && threadIdx.x == 0) *to = value;
}

/// The parts of a workspace's memory; with no memory, only their size.
template <class Index>
struct Scratch {
  One* one;
  Postponed<Index> postponed;
  std::uint32_t* first_objects;  // per tile
  Digest* digests;
  std::size_t bytes;

  Scratch(void* memory, std::size_t objects, std::uint64_t largest_mesh, std::uint64_t triangles) {
    detail::Parts parts(memory);
    one = parts.take<One>(1);
    first_objects = parts.take<std::uint32_t>(triangles / 32 + 2);  // the smallest tile
    digests = parts.take<Digest>(objects);
    postponed.size = parts.take<std::uint32_t>(1 + (objects + 31) / 32);
    postponed.marks = memory == nullptr ? nullptr : postponed.size + 1;
    postponed.list = parts.take<std::uint32_t>(objects);
    postponed.entries = std::max(largest_mesh, least_table_entries);
    postponed.table = parts.take<Index>(postponed.entries);
    bytes = parts.size();
  }
};

}  // namespace reform_detail

/// Scratch of reform on the device: 36 bytes and a bit per object, an Index per vertex of the largest mesh, of which at
/// least 2^22, and a bit per triangle of the output. It only grows, and a warm call allocates nothing; its contents on
/// entry do not matter.
template <class Index>
struct ReformWorkspace {
  Buffer buffer;
  std::uint32_t largest_mesh = 0;  ///< the most vertices that a mesh may have; 0: as many as ecol

  /// Makes room for scenes of up to so many objects, meshes of up to so many vertices, and so many triangles of output.
  /// To be called before the first call is captured; without it, a call makes room for a mesh with all vertices there
  /// are.
  [[nodiscard]] cudaError_t reserve(std::size_t objects, std::uint32_t most_vertices, std::uint64_t triangles = 0) {
    largest_mesh = std::max(largest_mesh, most_vertices);
    return buffer.reserve(reform_detail::Scratch<Index>(nullptr, objects, largest_mesh, triangles).bytes);
  }
};

namespace reform_detail {

/// The vertices that a mesh may have: those the workspace is for, and no more than there are, or than Index can name.
template <class Index>
std::uint64_t largest_mesh(const ReformWorkspace<Index>& workspace, std::uint64_t ecol_size) {
  const std::uint64_t indices = std::min(ecol_size, std::uint64_t{no_target<Index>} + 1);
  return workspace.largest_mesh == 0 ? indices : std::min<std::uint64_t>(indices, workspace.largest_mesh);
}

/// All three functions. With `one`, the scene's arrays for each object are made from it.
template <class Tune, class OutIndex, class Index>
[[nodiscard]] cudaError_t reform(Scene<Index> scene, ReformWorkspace<Index>& workspace,
                                 std::span<Triangle<OutIndex>> out, Launch launch, const One* one = nullptr) {
  if (scene.size == 0 || out.empty()) return cudaSuccess;
  const std::uint64_t largest = largest_mesh(workspace, scene.ecol_size);
  PGL_CUDA_TRY(workspace.buffer.reserve(Scratch<Index>(nullptr, scene.size, largest, out.size()).bytes));
  const Scratch<Index> scratch(workspace.buffer.template at<std::byte>(), scene.size, largest, out.size());
  if (one != nullptr) {
    PGL_CUDA_TRY(detail::run(put_kernel<One>, 1, 0, launch, *one, scratch.one));
    scene.meshes = &scratch.one->mesh;
    scene.objects = &scratch.one->object;
    scene.counts = &scratch.one->count;
    scene.triangle_offsets = scratch.one->triangle_offsets;
  }

  const unsigned warps = launch.block_threads / 32;
  const auto area_bytes =
      std::min(Tune::area_bytes, static_cast<unsigned>(detail::most_shared_bytes) / warps) / 16 * 16;
  const std::size_t slab_bytes = slab_bytes_of<Index>(area_bytes);
  const bool may_postpone = largest * sizeof(Index) > slab_bytes;
  const detail::TileStart start = detail::tile_start(out.data());
  const auto kernel = reform_kernel<Tune, OutIndex, Index>;
  const std::uint64_t tiles = (out.size() + start.lead + 32 * Tune::rows - 1) / (32 * Tune::rows);
  PGL_CUDA_TRY(detail::run(tiles_kernel<Index>, detail::blocks_for(scene.size, launch.block_threads), 0, launch, scene,
                           scratch.postponed, start, 32u * Tune::rows, scratch.first_objects, scratch.digests));
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(detail::tile_blocks(kernel, tiles, warps * area_bytes, Tune::waves, launch, blocks));
  PGL_CUDA_TRY(detail::run(kernel, blocks, warps * area_bytes, launch, scene, scratch.postponed, out.data(), out.size(),
                           start, scratch.first_objects, scratch.digests, area_bytes));
  if (!may_postpone) return cudaSuccess;
  return detail::run_cooperative(finish_kernel<OutIndex, Index>, finish_blocks, 0, launch, scene, scratch.postponed,
                                 out.data());
}

}  // namespace reform_detail

/// Writes the triangles of every object at its vertex count, with indices into the one vertex buffer that gather
/// fills; arguments, preconditions and bytes as pgl::host::reform, where the order is explained.
///
/// All views are of device memory, aligned to their elements, out best to 16 bytes. The number of triangles written is
/// triangle_offsets[n], read on the device, so nothing has to wait for it: the grid depends on out.size() alone.
///
/// - workspace: scratch, see there; no two calls that may run at the same time share one;
/// - launch: the stream. The call only enqueues: at most a memset and two kernels, the second (cooperative) only if a
///   mesh may have more vertices than a warp's part of shared memory holds. It can be captured into a graph once the
///   workspace is reserved.
///
/// Returns the first error of the runtime. Work O(n + triangles written + sum of the max_vertices of the selected
/// meshes), for meshes that need a table in global memory times the logarithm of the longest chain. The same bytes on
/// any device, for any block size. [Peng13] Alg 3.
template <class Index>
[[nodiscard]] cudaError_t reform(std::span<const Mesh> meshes, std::span<const Object> objects,
                                 std::span<const Triangle<Index>> triangles, std::span<const Index> ecol,
                                 std::span<const std::uint32_t> counts, std::span<const std::uint64_t> vertex_offsets,
                                 std::span<const std::uint64_t> triangle_offsets, ReformWorkspace<Index>& workspace,
                                 std::span<Triangle<std::uint32_t>> out, Launch launch = {}) {
  PGL_ASSERT(counts.size() == objects.size() && triangle_offsets.size() == objects.size() + 1);
  PGL_ASSERT(vertex_offsets.size() == objects.size() + 1);
  return reform_detail::reform<reform_detail::Tuning<Index>, std::uint32_t, Index>(
      {meshes.data(), objects.data(), objects.size(), triangles.data(), ecol.data(), ecol.size(), counts.data(),
       vertex_offsets.data(), triangle_offsets.data()},
      workspace, out, launch);
}

/// Like reform, from a block that holds the selected triangles and no others, as pgl::host::reform_block; the rest, the
/// workspace too, as for reform.
template <class Index>
[[nodiscard]] cudaError_t reform_block(std::span<const Mesh> meshes, std::span<const Object> objects,
                                       std::span<const Triangle<Index>> block, std::span<const Index> ecol,
                                       std::span<const std::uint32_t> counts,
                                       std::span<const std::uint64_t> vertex_offsets,
                                       std::span<const std::uint64_t> triangle_offsets,
                                       ReformWorkspace<Index>& workspace, std::span<Triangle<std::uint32_t>> out,
                                       Launch launch = {}) {
  PGL_ASSERT(counts.size() == objects.size() && triangle_offsets.size() == objects.size() + 1);
  PGL_ASSERT(vertex_offsets.size() == objects.size() + 1);
  return reform_detail::reform<reform_detail::Tuning<Index>, std::uint32_t, Index>(
      {meshes.data(), objects.data(), objects.size(), block.data(), ecol.data(), ecol.size(), counts.data(),
       vertex_offsets.data(), triangle_offsets.data(), true},
      workspace, out, launch);
}

/// Like reform, with indices local to the object, as pgl::host::reform_local.
template <class Index>
[[nodiscard]] cudaError_t reform_local(std::span<const Mesh> meshes, std::span<const Object> objects,
                                       std::span<const Triangle<Index>> triangles, std::span<const Index> ecol,
                                       std::span<const std::uint32_t> counts,
                                       std::span<const std::uint64_t> triangle_offsets,
                                       ReformWorkspace<Index>& workspace, std::span<Triangle<Index>> out,
                                       Launch launch = {}) {
  PGL_ASSERT(counts.size() == objects.size() && triangle_offsets.size() == objects.size() + 1);
  return reform_detail::reform<reform_detail::Tuning<Index>, Index, Index>(
      {meshes.data(), objects.data(), objects.size(), triangles.data(), ecol.data(), ecol.size(), counts.data(),
       nullptr, triangle_offsets.data()},
      workspace, out, launch);
}

/// Writes the triangles of one mesh at `count` vertices, as pgl::host::reform_mesh; count is a plain number.
template <class Index>
[[nodiscard]] cudaError_t reform_mesh(std::span<const Triangle<Index>> triangles, std::span<const Index> ecol,
                                      std::uint32_t count, ReformWorkspace<Index>& workspace,
                                      std::span<Triangle<Index>> out, Launch launch = {}) {
  PGL_ASSERT(out.size() >= triangles.size());
  if (triangles.empty()) return cudaSuccess;
  const reform_detail::One one{.mesh = {.max_vertices = static_cast<std::uint32_t>(ecol.size())},
                               .object = {},
                               .count = count,
                               .triangle_offsets = {0, triangles.size()}};
  return reform_detail::reform<reform_detail::Tuning<Index>, Index, Index>(
      {nullptr, nullptr, 1, triangles.data(), ecol.data(), ecol.size(), nullptr, nullptr, nullptr}, workspace, out,
      launch, &one);
}

}  // namespace pgl::cuda
