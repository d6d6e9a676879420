// SPDX-License-Identifier: MIT
// Draws the depth of occluders into a map, on the GPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/tiles.cuh"
#include "pgl/depth.hpp"
#include "pgl/gather.hpp"
#include "pgl/rasterize_depth.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

/// Scratch memory of rasterize_depth: 8 bytes per occluder and 152 for each triangle that may wait.
struct DepthWorkspace {
  Buffer memory;
  /// Triangles of more than a few texels wait until they can be shared out among all warps. Those that find no room are
  /// drawn at once: more slowly, to the same bits. At most 2^24 - 1.
  std::uint32_t room = 1u << 17;
};

namespace depth_detail {

/// The most threads in a block of the kernels that need many registers.
inline constexpr unsigned most_set_up_threads = 256;
inline constexpr unsigned most_draw_threads = 512;

inline constexpr std::uint32_t most_texels_of_a_lane = 32;  ///< of a box that one lane draws by itself
inline constexpr std::uint32_t pieces_along = 16;           ///< of a box, at most, along each side
inline constexpr std::uint32_t pieces_per_triangle = 8;     ///< that there is room for, on average
inline constexpr std::uint32_t no_piece = 0xffffffffu;

/// Triangles that wait to be drawn, and the pieces of their boxes: number of the triangle, row and column of the piece
/// in 24, 4 and 4 bits, or no_piece.
struct Waiting {
  DepthTriangle* triangles;
  std::uint32_t* pieces;
  unsigned* counts;  // triangles, pieces: those for which there was no room are counted too
  unsigned room;     // triangles
  unsigned piece_room;
};

/// The side of a piece of a box: at least 32 texels, and so that there are at most pieces_along.
PGL_HD constexpr std::uint32_t piece_side(std::uint32_t texels) {
  const std::uint32_t least = (texels - 1) / pieces_along + 1;
  return (least + 31) / 32 * 32;
}
PGL_HD constexpr std::uint32_t piece_count(std::uint32_t texels) {
  return (texels - 1) / piece_side(texels) + 1;
}

/// The arrays of the model that are drawn.
template <class Index>
struct DepthModel {
  const Mesh* meshes;
  const Object* objects;
  const glm::vec3* vertices;
  const Triangle<Index>* triangles;
  const std::uint32_t* map;
};

/// Writes where each occluder's groups of up to 32 triangles begin, offsets[occluders] being their number. Also,
/// nothing waits yet. One block.
template <class = void>
__global__ void count_groups_kernel(const Mesh* meshes, const Object* objects, const std::uint32_t* map,
                                    const std::uint32_t* occluders, std::uint64_t n, std::uint64_t* offsets,
                                    unsigned* waiting) {
  __shared__ std::uint64_t sums[32];
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32, warps = blockDim.x / 32;
  if (threadIdx.x < 2) waiting[threadIdx.x] = 0;
  std::uint64_t before = 0;
  for (std::uint64_t first = 0; first < n; first += blockDim.x) {
    const std::uint64_t i = first + threadIdx.x;
    std::uint64_t own = 0;
    if (i < n && occluders[i] != no_object) {
      const Mesh mesh = meshes[objects[occluders[i]].mesh];
      own = (std::uint64_t{triangles_at(mesh, map, mesh.max_vertices)} + 31) / 32;
    }
    std::uint64_t up_to = own;
    for (unsigned step = 1; step < 32; step *= 2) {
      const std::uint64_t other = __shfl_up_sync(0xffffffffu, up_to, step);
      if (lane >= step) up_to += other;
    }
    if (lane == 31) sums[warp] = up_to;
    __syncthreads();
    std::uint64_t here = before;
    for (unsigned w = 0; w < warps; ++w) {
      here += w < warp ? sums[w] : 0;
      before += sums[w];
    }
    if (i < n) offsets[i] = here + up_to - own;
    __syncthreads();
  }
  if (threadIdx.x == 0) offsets[n] = before;
}

/// Draws the texels [x0, x1) x [y0, y1) of a triangle's box, of which this thread takes those from (x, y) on that are a
/// multiple of the steps away. Values just outside the box, which are not used, do not overflow either.
__device__ inline void draw_texels(const DepthTriangle& t, std::uint32_t x, std::uint32_t x_step, std::uint32_t x1,
                                   std::uint32_t y, std::uint32_t y_step, std::uint32_t y1, std::uint32_t width,
                                   Depth* depth) {
  std::int64_t row[4], right[4], up[4];  // the edges and the depth
#pragma unroll
  for (int k = 0; k < 4; ++k) {
    const std::int64_t* plane = k < 3 ? t.edge[k] : t.depth;
    row[k] = plane[0] + plane[1] * static_cast<std::int64_t>(x) + plane[2] * static_cast<std::int64_t>(y);
    right[k] = plane[1] * static_cast<std::int64_t>(x_step);
    up[k] = plane[2] * static_cast<std::int64_t>(y_step);
  }
  Depth* texels = depth + (std::uint64_t{t.y0} + y) * width + t.x0;
  for (; y < y1; y += y_step, texels += std::uint64_t{y_step} * width) {
    std::int64_t edge0 = row[0], edge1 = row[1], edge2 = row[2], value = row[3];
    for (std::uint32_t i = x; i < x1; i += x_step) {
      if ((edge0 | edge1 | edge2) >= 0) atomicMin(texels + i, depth_of(t, value));
      edge0 += right[0];
      edge1 += right[1];
      edge2 += right[2];
      value += right[3];
    }
#pragma unroll
    for (int k = 0; k < 4; ++k) row[k] += up[k];
  }
}

/// The same by a whole warp: texels side by side as far as the part is wide.
__device__ inline void draw_by_warp(const DepthTriangle& t, std::uint32_t x0, std::uint32_t x1, std::uint32_t y0,
                                    std::uint32_t y1, std::uint32_t width, Depth* depth) {
  const unsigned lane = detail::lane_index();
  const unsigned across = x1 - x0 > 16 ? 32 : x1 - x0 > 8 ? 16 : 8;
  draw_texels(t, x0 + lane % across, across, x1, y0 + lane / across, 32 / across, y1, width, depth);
}

/// Puts the lanes' triangles with `waits` into the queue, with all their pieces; a whole warp together. Returns whether
/// this lane's found no room.
__device__ inline bool push(const DepthTriangle& t, bool waits, const Waiting& waiting) {
  const unsigned lane = detail::lane_index();
  const unsigned all = __ballot_sync(detail::whole_warp, waits);
  if (all == 0) return false;
  // Looked at first, so that a full queue is not counted on for ever.
  unsigned is_full = 0;
  if (lane == 0) {
    const volatile unsigned* counts = waiting.counts;
    is_full = counts[0] >= waiting.room || counts[1] >= waiting.piece_room ? 1u : 0u;
  }
  if (__shfl_sync(detail::whole_warp, is_full, 0) != 0) return waits;

  const std::uint32_t across = waits ? piece_count(t.columns) : 1;
  const std::uint32_t pieces = waits ? across * piece_count(t.rows) : 0;
  std::uint32_t up_to = pieces;
  for (unsigned step = 1; step < 32; step *= 2) {
    const std::uint32_t other = __shfl_up_sync(detail::whole_warp, up_to, step);
    if (lane >= step) up_to += other;
  }
  unsigned first_triangle = 0, first_piece = 0;
  if (lane == 31) {
    first_triangle = atomicAdd(waiting.counts, static_cast<unsigned>(__popc(all)));
    first_piece = atomicAdd(waiting.counts + 1, up_to);
  }
  const unsigned number =
      __shfl_sync(detail::whole_warp, first_triangle, 31) + static_cast<unsigned>(__popc(all & ((1u << lane) - 1)));
  const unsigned begin = __shfl_sync(detail::whole_warp, first_piece, 31) + up_to - pieces, end = begin + pieces;
  const bool fits = waits && number < waiting.room && end <= waiting.piece_room;
  if (fits) waiting.triangles[number] = t;
  constexpr std::uint32_t few = 4;
  if (pieces <= few || !fits)
    for (unsigned p = begin; p < end && p < waiting.piece_room; ++p)
      waiting.pieces[p] = fits ? number << 8 | (p - begin) / across << 4 | (p - begin) % across : no_piece;
  for (unsigned left = __ballot_sync(detail::whole_warp, fits && pieces > few); left != 0; left &= left - 1) {
    const int source = __ffs(static_cast<int>(left)) - 1;
    const unsigned of = __shfl_sync(detail::whole_warp, number, source);
    const unsigned from = __shfl_sync(detail::whole_warp, begin, source);
    const unsigned size = __shfl_sync(detail::whole_warp, pieces, source);
    const unsigned row = __shfl_sync(detail::whole_warp, across, source);
    for (unsigned p = lane; p < size; p += 32) waiting.pieces[from + p] = of << 8 | p / row << 4 | p % row;
  }
  return waits && !fits;
}

/// Number `part` of the up to two triangles that remain of a triangle that is cut; no columns if there is none. By
/// itself, since it is seldom and would take many registers.
template <class Index>
__device__ __noinline__ DepthTriangle cut_part(const DepthView& view, const DepthModel<Index>& model,
                                               std::uint32_t object, std::uint64_t triangle, int part) {
  const Object& placed = model.objects[object];
  const Mesh& mesh = model.meshes[placed.mesh];
  ClipVertex clip[3];
  for (int k = 0; k < 3; ++k) {
    const Index v = model.triangles[mesh.first_triangle + triangle].v[k];
    clip[k] = clip_vertex(view, transform_point(placed.transform, model.vertices[mesh.first_vertex + v]));
  }
  DepthTriangle cut[2];
  cut[0].columns = cut[1].columns = 0;
  cut_depth_triangle(view, clip, cut);
  return cut[part];
}

/// A warp takes 32 triangles of an occluder at a time, a lane each. What is small on the map the lanes draw by
/// themselves, the rest has to wait.
template <class Index>
__global__ void __launch_bounds__(most_set_up_threads, 2)
    set_up_kernel(const __grid_constant__ DepthModel<Index> model, const std::uint32_t* occluders, std::uint64_t n,
                  const std::uint64_t* offsets, const __grid_constant__ DepthView view,
                  const __grid_constant__ Waiting waiting, Depth* depth) {
  __shared__ DepthTriangle shared[most_set_up_threads / 32];
  DepthTriangle& of_warp = shared[threadIdx.x / 32];
  const unsigned lane = detail::lane_index();
  const std::uint64_t groups = offsets[n];
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t g = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32; g < groups; g += stride) {
    const std::uint64_t o = detail::object_at(offsets, 0, n, g);
    const Object object = model.objects[occluders[o]];
    const Mesh mesh = model.meshes[object.mesh];
    const std::uint64_t i = (g - offsets[o]) * 32 + lane;
    const bool exists = i < triangles_at(mesh, model.map, mesh.max_vertices);
    Triangle<Index> corners{};
    if (exists) corners = model.triangles[mesh.first_triangle + i];
    glm::vec3 points[3];
    for (int k = 0; k < 3; ++k)
      points[k] = exists ? model.vertices[mesh.first_vertex + corners.v[k]] : glm::vec3(0.0f, 0.0f, 0.0f);

    for (int part = 0; part < 2; ++part) {  // a triangle that is cut may be two
      DepthTriangle t;
      t.columns = t.rows = 0;
      bool is_cut = false;
      if (exists) {
        const auto placed = [&](int k) {
          return depth_vertex(view, clip_vertex(view, transform_point(object.transform, points[k])));
        };
        const DepthVertex a = placed(0), b = placed(1), c = placed(2);
        is_cut = !(is_drawable(a) && is_drawable(b) && is_drawable(c));
        if (is_cut) {
          t = cut_part(view, model, occluders[o], i, part);
        } else if (part == 0) {
          t = depth_triangle(view, a, b, c);
        }
      }

      const std::uint64_t texels = t.columns == 0 ? 0 : std::uint64_t{t.columns} * t.rows;
      const bool is_small = texels <= most_texels_of_a_lane;
      if (is_small && texels > 0) draw_texels(t, 0, 1, t.columns, 0, 1, t.rows, view.width, depth);
      __syncwarp();
      const bool found_no_room = push(t, !is_small, waiting);
      for (unsigned left = __ballot_sync(detail::whole_warp, found_no_room); left != 0; left &= left - 1) {
        if (lane == static_cast<unsigned>(__ffs(static_cast<int>(left))) - 1) of_warp = t;
        __syncwarp();
        draw_by_warp(of_warp, 0, of_warp.columns, 0, of_warp.rows, view.width, depth);
        __syncwarp();
      }
      if (!__any_sync(detail::whole_warp, is_cut)) break;
    }
  }
}

/// Draws the triangles that wait: a warp takes a piece at a time.
template <class = void>
__global__ void __launch_bounds__(most_draw_threads)
    draw_waiting_kernel(const __grid_constant__ Waiting waiting, std::uint32_t width, Depth* depth) {
  const unsigned counted = waiting.counts[1];
  const unsigned pieces = counted < waiting.piece_room ? counted : waiting.piece_room;
  const unsigned stride = gridDim.x * (blockDim.x / 32);
  for (unsigned p = blockIdx.x * (blockDim.x / 32) + threadIdx.x / 32; p < pieces; p += stride) {
    const std::uint32_t piece = waiting.pieces[p];
    if (piece == no_piece) continue;
    const DepthTriangle t = waiting.triangles[piece >> 8];
    const std::uint32_t wide = piece_side(t.columns), tall = piece_side(t.rows);
    const std::uint32_t x0 = (piece & 15) * wide, y0 = (piece >> 4 & 15) * tall;
    const std::uint32_t x1 = x0 + wide < t.columns ? x0 + wide : t.columns;
    const std::uint32_t y1 = y0 + tall < t.rows ? y0 + tall : t.rows;
    bool is_outside = false;  // of one edge, all of it
    for (int k = 0; k < 3; ++k) {
      const std::int64_t x = t.edge[k][1] < 0 ? x0 : x1 - 1, y = t.edge[k][2] < 0 ? y0 : y1 - 1;
      is_outside = is_outside || t.edge[k][0] + t.edge[k][1] * x + t.edge[k][2] * y < 0;
    }
    if (!is_outside) draw_by_warp(t, x0, x1, y0, y1, width, depth);
  }
}

}  // namespace depth_detail

/// Draws the triangles of the occluders, at full detail, into a depth map, as pgl::host::rasterize_depth does. Fill the
/// map with far_depth first, all bytes 0xff: cudaMemsetAsync does it.
///
/// All views are of device memory. The view is read before this returns: a captured graph keeps the one that it was
/// captured with. The occluders may be written on the stream just before, by select_occluders: nothing of them is known
/// on the host.
/// Three kernels; nothing is allocated once the workspace has served as many occluders. The second runs on blocks of at
/// most 256 threads, the third of at most 512. Enqueued on launch.stream, capturable; the same bits for any launch: a
/// depth is the least of integers.
template <class Index>
[[nodiscard]] cudaError_t rasterize_depth(std::span<const Mesh> meshes, std::span<const Object> objects,
                                          std::span<const glm::vec3> vertices,
                                          std::span<const Triangle<Index>> triangles,
                                          std::span<const std::uint32_t> map, std::span<const std::uint32_t> occluders,
                                          const View& view, const DepthMap& size, DepthWorkspace& workspace,
                                          std::span<Depth> depth, Launch launch = {}) {
  namespace dd = depth_detail;
  PGL_ASSERT(depth.size() == static_cast<std::size_t>(size.width) * size.height);
  if (occluders.empty()) return cudaSuccess;
  const std::uint64_t n = occluders.size();
  dd::Waiting waiting{};
  waiting.room = std::clamp(workspace.room, 1u, (1u << 24) - 1);
  waiting.piece_room = dd::pieces_per_triangle * waiting.room;
  std::uint64_t* offsets = nullptr;
  const auto take = [&](detail::Parts parts) {
    waiting.counts = parts.take<unsigned>(2);
    waiting.triangles = parts.take<DepthTriangle>(waiting.room);
    waiting.pieces = parts.take<std::uint32_t>(waiting.piece_room);
    offsets = parts.take<std::uint64_t>(n + 1);
    return parts.size();
  };
  PGL_CUDA_TRY(workspace.memory.reserve(take(detail::Parts())));
  take(detail::Parts(workspace.memory.at<void>()));

  PGL_CUDA_TRY(detail::run(dd::count_groups_kernel<>, 1, 0, launch, meshes.data(), objects.data(), map.data(),
                           occluders.data(), n, offsets, waiting.counts));
  Launch set_up = launch;
  set_up.block_threads = std::min(set_up.block_threads, dd::most_set_up_threads);
  const dd::DepthModel<Index> model{meshes.data(), objects.data(), vertices.data(), triangles.data(), map.data()};
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(detail::resident_blocks(dd::set_up_kernel<Index>, 0, set_up, blocks));
  PGL_CUDA_TRY(detail::run(dd::set_up_kernel<Index>, blocks, 0, set_up, model, occluders.data(), n, offsets,
                           depth_view_of(view, size), waiting, depth.data()));
  Launch draw = launch;
  draw.block_threads = std::min(draw.block_threads, dd::most_draw_threads);
  PGL_CUDA_TRY(detail::resident_blocks(dd::draw_waiting_kernel<>, 0, draw, blocks));
  return detail::run(dd::draw_waiting_kernel<>, blocks, 0, draw, waiting, size.width, depth.data());
}

}  // namespace pgl::cuda
