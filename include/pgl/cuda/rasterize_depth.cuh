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

/// Scratch memory of rasterize_depth: 8 bytes per occluder and 2 MB.
struct DepthWorkspace {
  Buffer memory;
};

namespace depth_detail {

/// The most threads in a block of draw_depth_kernel, which needs many registers.
inline constexpr unsigned most_threads = 256;

inline constexpr std::uint32_t most_texels_of_a_lane = 16;   ///< of a box that one lane draws by itself
inline constexpr std::uint32_t most_texels_of_a_warp = 512;  ///< of a box that a warp draws at once
inline constexpr unsigned most_queued = 1 << 14;             ///< triangles that wait for draw_large_kernel
inline constexpr unsigned tile_rows = 16;                    ///< of a tile of draw_large_kernel, 32 columns wide

/// Triangles that are large on the map. More than find room were drawn at once.
struct LargeTriangles {
  DepthTriangle* triangles;
  unsigned* pushed;
};

/// The arrays of the model that are drawn.
template <class Index>
struct DepthModel {
  const Mesh* meshes;
  const Object* objects;
  const glm::vec3* vertices;
  const Triangle<Index>* triangles;
  const std::uint32_t* map;
};

/// Writes where each occluder's groups of up to 32 triangles begin, offsets[occluders] being their number, and empties
/// the queue. One block.
template <class = void>
__global__ void count_groups_kernel(const Mesh* meshes, const Object* objects, const std::uint32_t* map,
                                    const std::uint32_t* occluders, std::uint64_t n, std::uint64_t* offsets,
                                    unsigned* pushed) {
  __shared__ std::uint64_t sums[32];
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32, warps = blockDim.x / 32;
  if (threadIdx.x == 0) *pushed = 0;
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

/// Draws the columns first, first + step, ... and likewise rows of a triangle's box.
__device__ inline void draw_texels(const DepthTriangle& t, std::uint32_t first_column, std::uint32_t column_step,
                                   std::uint32_t first_row, std::uint32_t row_step, std::uint32_t width, Depth* depth) {
  for (std::uint32_t j = first_row; j < t.rows; j += row_step) {
    Depth* const row = depth + (std::uint64_t{t.y0} + j) * width + t.x0;
    for (std::uint32_t i = first_column; i < t.columns; i += column_step)
      if (covers(t, i, j)) atomicMin(row + i, depth_at(t, i, j));
  }
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
/// themselves, then the whole warp draws the rest one by one, or leaves it in the queue.
template <class Index>
__global__ void __launch_bounds__(most_threads, 2)
    draw_depth_kernel(const __grid_constant__ DepthModel<Index> model, const std::uint32_t* occluders, std::uint64_t n,
                      const std::uint64_t* offsets, const __grid_constant__ DepthView view, LargeTriangles large,
                      Depth* depth) {
  __shared__ DepthTriangle shared[most_threads / 32];
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
      bool is_left = texels > most_texels_of_a_lane;
      if (texels > 0 && !is_left) draw_texels(t, 0, 1, 0, 1, view.width, depth);
      if (texels > most_texels_of_a_warp) {
        // Looked at first, so that a full queue is not counted on for ever.
        const unsigned slot =
            *static_cast<volatile unsigned*>(large.pushed) < most_queued ? atomicAdd(large.pushed, 1u) : most_queued;
        if (slot < most_queued) {
          large.triangles[slot] = t;
          is_left = false;
        }
      }
      unsigned left = __ballot_sync(detail::whole_warp, is_left);
      while (left != 0) {
        const unsigned source = static_cast<unsigned>(__ffs(static_cast<int>(left))) - 1;
        left &= left - 1;
        if (lane == source) of_warp = t;
        __syncwarp();
        draw_texels(of_warp, lane % 8, 8, lane / 8, 4, view.width, depth);
        __syncwarp();
      }
      if (!__any_sync(detail::whole_warp, is_cut)) break;
    }
  }
}

/// Draws the triangles in the queue: a warp takes a tile of the map at a time and draws in it all that touch it.
template <class = void>
__global__ void draw_large_kernel(LargeTriangles large, std::uint32_t width, std::uint32_t height,
                                  std::uint64_t tiles_across, std::uint64_t tiles, Depth* depth) {
  const unsigned lane = detail::lane_index();
  const unsigned pushed = *large.pushed;
  const unsigned queued = pushed < most_queued ? pushed : most_queued;
  if (queued == 0) return;
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t tile = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32; tile < tiles;
       tile += stride) {
    const std::int64_t left = static_cast<std::int64_t>(tile % tiles_across) * 32;
    const std::int64_t low = static_cast<std::int64_t>(tile / tiles_across) * tile_rows;
    Depth nearest[tile_rows];
    for (unsigned r = 0; r < tile_rows; ++r) nearest[r] = far_depth;
    bool any = false;
    for (unsigned first = 0; first < queued; first += 32) {
      bool touches = false;
      if (first + lane < queued) {
        const DepthTriangle& t = large.triangles[first + lane];
        touches = t.x0 < left + 32 && left < std::int64_t{t.x0} + t.columns && t.y0 < low + tile_rows &&
                  low < std::int64_t{t.y0} + t.rows;
      }
      unsigned touching = __ballot_sync(detail::whole_warp, touches);
      any = any || touching != 0;
      for (; touching != 0; touching &= touching - 1) {
        const DepthTriangle& t = large.triangles[first + static_cast<unsigned>(__ffs(static_cast<int>(touching))) - 1];
        // At most 31 columns and 15 rows outside its box nothing overflows either.
        const std::int64_t x = left + lane - t.x0, y = low - t.y0, rows = t.rows;
        if (x < 0 || x >= t.columns) continue;
        std::int64_t edge0 = t.edge[0][0] + t.edge[0][1] * x + t.edge[0][2] * y;
        std::int64_t edge1 = t.edge[1][0] + t.edge[1][1] * x + t.edge[1][2] * y;
        std::int64_t edge2 = t.edge[2][0] + t.edge[2][1] * x + t.edge[2][2] * y;
        std::int64_t value = t.depth[0] + t.depth[1] * x + t.depth[2] * y;
        const std::int64_t up0 = t.edge[0][2], up1 = t.edge[1][2], up2 = t.edge[2][2], up = t.depth[2];
        const std::int64_t farthest = t.farthest;
#pragma unroll
        for (unsigned r = 0; r < tile_rows; ++r) {
          const std::int64_t j = y + r;
          if ((edge0 | edge1 | edge2 | j | (rows - 1 - j)) >= 0) {
            const std::int64_t d = value >> 16;
            const Depth kept = static_cast<Depth>(d < farthest ? d : farthest);
            nearest[r] = kept < nearest[r] ? kept : nearest[r];
          }
          edge0 += up0;
          edge1 += up1;
          edge2 += up2;
          value += up;
        }
      }
      __syncwarp();
    }
    if (!any || left + lane >= width) continue;
    Depth* const column = depth + static_cast<std::uint64_t>(low) * width + static_cast<std::uint64_t>(left) + lane;
#pragma unroll
    for (unsigned r = 0; r < tile_rows; ++r) {
      if (nearest[r] == far_depth || low + r >= height) continue;
      Depth* const texel = column + std::uint64_t{r} * width;
      if (nearest[r] < *texel) *texel = nearest[r];
    }
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
/// most 256 threads. Enqueued on launch.stream, capturable; the same bits for any launch: a depth is the least of
/// integers.
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
  const auto take = [&](detail::Parts parts, std::uint64_t*& offsets, dd::LargeTriangles& large) {
    large.pushed = parts.take<unsigned>(1);
    large.triangles = parts.take<DepthTriangle>(dd::most_queued);
    offsets = parts.take<std::uint64_t>(n + 1);
    return parts.size();
  };
  std::uint64_t* offsets = nullptr;
  dd::LargeTriangles large{};
  PGL_CUDA_TRY(workspace.memory.reserve(take(detail::Parts(), offsets, large)));
  take(detail::Parts(workspace.memory.at<void>()), offsets, large);

  PGL_CUDA_TRY(detail::run(dd::count_groups_kernel<>, 1, 0, launch, meshes.data(), objects.data(), map.data(),
                           occluders.data(), n, offsets, large.pushed));
  Launch draw = launch;
  draw.block_threads = std::min(draw.block_threads, dd::most_threads);
  const dd::DepthModel<Index> model{meshes.data(), objects.data(), vertices.data(), triangles.data(), map.data()};
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(detail::resident_blocks(dd::draw_depth_kernel<Index>, 0, draw, blocks));
  PGL_CUDA_TRY(detail::run(dd::draw_depth_kernel<Index>, blocks, 0, draw, model, occluders.data(), n, offsets,
                           depth_view_of(view, size), large, depth.data()));
  const std::uint64_t tiles_across = (std::uint64_t{size.width} + 31) / 32;
  const std::uint64_t tiles = tiles_across * ((size.height - 1) / dd::tile_rows + 1);
  PGL_CUDA_TRY(detail::tile_blocks(dd::draw_large_kernel<>, tiles, 0, 1, launch, blocks));
  return detail::run(dd::draw_large_kernel<>, blocks, 0, launch, large, size.width, size.height, tiles_across, tiles,
                     depth.data());
}

}  // namespace pgl::cuda
