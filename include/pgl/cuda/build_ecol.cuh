// SPDX-License-Identifier: MIT
// Progressive collapse order on the GPU: many meshes at a time, a warp for each, or one large mesh by the whole device.
#pragma once

#include <cooperative_groups.h>
#include <cuda_runtime.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>
#include <cuda/std/iterator>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/collapse_group.hpp"
#include "pgl/cuda/launch.cuh"

namespace pgl::cuda {

namespace detail {

/// One mesh of a batch: its range, which it is, and the memory that it needs outside shared memory.
struct EcolTask {
  MeshRange range;
  std::uint64_t bytes;
  std::uint32_t mesh;
};

/// The 32 threads of a warp as a group.
struct Warp {
  static constexpr unsigned size = 32;
  __device__ unsigned rank() const { return threadIdx.x % 32; }
  __device__ void sync() const { __syncwarp(); }
  __device__ std::uint32_t ballot(bool p) const { return __ballot_sync(~0u, p); }
  __device__ std::uint32_t match(std::uint32_t key) const { return __match_any_sync(~0u, key); }
  template <class T>
  __device__ T shuffle(const T& value, unsigned from) const {
    constexpr int words = (sizeof(T) + 3) / 4;
    unsigned word[words] = {};
    memcpy(word, &value, sizeof(T));
    for (int i = 0; i < words; ++i) word[i] = __shfl_sync(~0u, word[i], static_cast<int>(from));
    T result;
    memcpy(&result, word, sizeof(T));
    return result;
  }
  __device__ std::uint32_t least(std::uint32_t x) const {
#if !defined(__CUDA_ARCH__) || __CUDA_ARCH__ >= 800
    return __reduce_min_sync(~0u, x);
#else
    for (unsigned step = 16; step > 0; step /= 2) x = min(x, __shfl_xor_sync(~0u, x, step));
    return x;
#endif
  }
  __device__ std::uint32_t exchange(std::uint32_t* p, std::uint32_t x) const {
    return atomicExch(p, x);
  }
  __device__ void add(std::uint32_t* p, std::uint32_t x) const {
    atomicAdd(p, x);
  }
  __device__ void lower(std::uint64_t* p, std::uint64_t x) const {
    atomicMin(reinterpret_cast<unsigned long long*>(p), static_cast<unsigned long long>(x));
  }
  template <class Cost>
  __device__ RoundFound<Cost> found(const RoundFound<Cost>& mine) {
    const bool any = __any_sync(~0u, mine.any) != 0;
    const Cost least = least_of(*this, mine.least);
    __syncwarp();
    return {any, least};
  }
};

/// All threads of a cooperative grid, as far as collapse_by_rounds needs a group. `slots`: three, of which the first
/// stands at {0, no cost}.
template <class Cost>
struct GridSlot {
  unsigned any;
  Cost least;
};
template <class Cost>
struct Grid {
  GridSlot<Cost>* slots;
  unsigned turn = 0;

  __device__ void sync() const { cooperative_groups::this_grid().sync(); }
  __device__ void lower(std::uint64_t* p, std::uint64_t x) const { Warp{}.lower(p, x); }
  __device__ RoundFound<Cost> found(const RoundFound<Cost>& mine) {
    Warp warp;
    const RoundFound<Cost> ours = warp.found(mine);
    GridSlot<Cost>& slot = slots[turn % 3];
    if (warp.rank() == 0 && ours.any) slot.any = 1;  // whoever writes, writes the same
    if (warp.rank() == 0 && !ours.any) lower_cost(&slot.least, ours.least);
    if (blockIdx.x == 0 && threadIdx.x == 0) slots[(turn + 1) % 3] = {0, static_cast<Cost>(~Cost{0})};
    sync();
    ++turn;
    return {slot.any != 0, slot.least};
  }

 private:
  __device__ static void lower_cost(std::uint32_t* p, std::uint32_t x) {
    if (x < *static_cast<volatile std::uint32_t*>(p)) atomicMin(p, x);
  }
  __device__ static void lower_cost(std::uint64_t* p, std::uint64_t x) {
    if (x < *static_cast<volatile std::uint64_t*>(p)) Warp{}.lower(p, x);
  }
};

template <class Index>
PGL_HD EcolArrays<Index> arrays_of(const EcolArrays<Index>& all, const MeshRange& r) {
  return {all.positions + r.first_vertex,
          all.triangles + r.first_triangle,
          all.locked == nullptr ? nullptr : all.locked + r.first_vertex,
          all.ecol + r.first_vertex,
          all.permute_v + r.first_vertex,
          all.permute_t + r.first_triangle,
          all.map + r.first_map,
          all.error == nullptr ? nullptr : all.error + r.first_map};
}

/// A block of one warp per mesh. memory: null for shared memory; else a part per block, from offsets[block] on, and
/// each block does every gridDim.x-th mesh.
template <class Real, class Id, class Index>
__global__ __launch_bounds__(32) void build_ecol_kernel(const EcolTask* tasks, std::uint32_t count, EcolOptions options,
                                                        EcolArrays<Index> all, std::byte* memory,
                                                        const std::uint64_t* offsets, std::uint32_t* min_vertices) {
  extern __shared__ __align__(16) std::byte shared[];
  void* const own = memory == nullptr ? shared : memory + offsets[blockIdx.x];
  for (std::uint32_t i = blockIdx.x; i < count; i += gridDim.x) {
    const EcolTask task = tasks[i];
    Warp warp;
    const std::uint32_t left =
        build_one<Real, Id>(warp, own, task.range.vertices, task.range.triangles, options, arrays_of(all, task.range));
    if (warp.rank() == 0) min_vertices[task.mesh] = left;
    warp.sync();
  }
}

// ---- one large mesh by rounds ---------------------------------------------------------------------------------------

/// What the steps of one large mesh share on the device.
template <class Cost>
struct LargeShared {
  std::uint32_t low[3], high[3];  ///< order keys of the box
  GridSlot<Cost> slots[3];
  std::uint32_t left;         ///< vertices
  std::uint32_t first_to_go;  ///< vertex
};

template <class Cost>
__device__ Normalisation normalisation_of(const LargeShared<Cost>& shared) {
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    box.min[axis] = ieee::from_order_key<float>(shared.low[axis]);
    box.max[axis] = ieee::from_order_key<float>(shared.high[axis]);
  }
  return normalisation(box);
}

__device__ inline std::uint64_t grid_rank() {
  return static_cast<std::uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
}
__device__ inline std::uint64_t grid_size() {
  return static_cast<std::uint64_t>(gridDim.x) * blockDim.x;
}

template <class Cost>
__global__ void start_large_kernel(LargeShared<Cost>* shared) {
  if (grid_rank() != 0) return;
  for (int axis = 0; axis < 3; ++axis) {
    shared->low[axis] = ieee::order_key(ieee::infinity<float>);
    shared->high[axis] = ieee::order_key(-ieee::infinity<float>);
  }
  shared->slots[0] = {0, static_cast<Cost>(~Cost{0})};
  shared->first_to_go = ~std::uint32_t{0};
}

template <class Cost>
__global__ void bound_large_kernel(const glm::vec3* positions, std::uint32_t vertices, LargeShared<Cost>* shared) {
  Box box;
  for (std::uint64_t v = grid_rank(); v < vertices; v += grid_size()) box = extend(box, positions[v]);
  Warp warp;
  for (unsigned step = 16; step > 0; step /= 2) box = merge(box, warp.shuffle(box, warp.rank() ^ step));
  if (warp.rank() != 0) return;
  for (int axis = 0; axis < 3; ++axis) {
    atomicMin(&shared->low[axis], ieee::order_key(box.min[axis]));
    atomicMax(&shared->high[axis], ieee::order_key(box.max[axis]));
  }
}

template <class Real, class Index, class Cost>
__global__ void load_large_kernel(CollapsingMesh<Real, std::uint32_t> m, EcolArrays<Index> a,
                                  const LargeShared<Cost>* shared, std::uint32_t* keys, std::uint32_t* values) {
  const Normalisation n = normalisation_of(*shared);
  for (std::uint64_t v = grid_rank(); v < m.vertices; v += grid_size()) {
    m.positions[v] = normalise<Real>(a.positions[v], n);
    m.first[v] = m.last[v] = m.none;
    a.ecol[v] = no_target<Index>;
  }
  for (std::uint64_t t = grid_rank(); t < m.triangles; t += grid_size()) {
    const Triangle<Index> triangle = a.triangles[t];
    const bool degenerate = is_degenerate(triangle);
    for (int c = 0; c < 3; ++c) {
      const std::uint64_t corner = 3 * t + static_cast<std::uint64_t>(c);
      PGL_ASSERT(triangle.v[c] < m.vertices);
      m.corners[corner] = keys[corner] = degenerate ? m.none : std::uint32_t{triangle.v[c]};
      values[corner] = static_cast<std::uint32_t>(corner);
    }
    a.permute_t[t] = ~std::uint32_t{0};
  }
}

template <class Real>
__global__ void link_large_kernel(CollapsingMesh<Real, std::uint32_t> m, const std::uint32_t* keys,
                                  const std::uint32_t* values) {
  const std::uint64_t corners = std::uint64_t{3} * m.triangles;
  for (std::uint64_t i = grid_rank(); i < corners; i += grid_size()) {
    const std::uint32_t v = keys[i], c = values[i];
    if (v == m.none) continue;
    const bool ends = i + 1 == corners || keys[i + 1] != v;
    m.next[c] = ends ? m.none : values[i + 1];
    const bool begins = i == 0 || keys[i - 1] != v;
    m.previous[c] = begins ? m.none : values[i - 1];
    if (begins) m.first[v] = c;
    if (ends) m.last[v] = c;
  }
  if (m.normals == nullptr) return;
  for (std::uint64_t t = grid_rank(); t < m.triangles; t += grid_size())
    if (!is_gone(m, static_cast<std::uint32_t>(t)))
      m.normals[t] = direction(normal_of(m, static_cast<std::uint32_t>(t)));
}

template <class Real, class Index>
__global__ void set_up_large_kernel(CollapsingMesh<Real, std::uint32_t> m, EcolArrays<Index> a) {
  for (std::uint64_t v = grid_rank(); v < m.vertices; v += grid_size())
    set_up_vertex(m, static_cast<std::uint32_t>(v), a.locked == nullptr || a.locked[v] == 0);
}

template <class Real, class Index, class Cost>
__global__ void collapse_large_kernel(CollapseState<Real, std::uint32_t> s, EcolArrays<Index> a,
                                      LargeShared<Cost>* shared) {
  Grid<Cost> grid{shared->slots};
  (void)collapse_by_rounds(grid, static_cast<std::uint32_t>(grid_rank()), static_cast<std::uint32_t>(grid_size()), s,
                           normalisation_of(*shared), a);
}

/// Sort keys that put what has no key in front, and the items from the last to the first, so that a stable sort puts
/// the lowest of equal keys last.
template <class Real>
__global__ void vertex_keys_kernel(CollapseState<Real, std::uint32_t> s, std::uint32_t* keys, std::uint32_t* values) {
  for (std::uint64_t i = grid_rank(); i < s.m.vertices; i += grid_size()) {
    const auto v = static_cast<std::uint32_t>(s.m.vertices - 1 - i);
    values[i] = v;
    keys[i] = s.mark[v] == ~std::uint32_t{0} ? 0 : ~s.mark[v];
  }
}

/// How many of n sorted keys are below `key`.
PGL_DEVICE inline std::uint32_t lower_bound(const std::uint32_t* keys, std::uint32_t n, std::uint64_t key) {
  std::uint32_t low = 0, high = n;
  while (low < high) {
    const std::uint32_t middle = low + (high - low) / 2;
    if (keys[middle] < key)
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

template <class Real, class Index, class Cost>
__global__ void place_vertices_kernel(CollapseState<Real, std::uint32_t> s, EcolArrays<Index> a,
                                      const std::uint32_t* keys, const std::uint32_t* values, LargeShared<Cost>* shared,
                                      float* errors, std::uint32_t* min_vertices) {
  const std::uint32_t vertices = s.m.vertices, left = lower_bound(keys, vertices, 1);
  if (grid_rank() == 0) {
    shared->left = *min_vertices = left;
    if (errors != nullptr) errors[vertices] = 0;
  }
  for (std::uint64_t i = grid_rank(); i < vertices; i += grid_size()) {
    const std::uint32_t v = values[i];
    const auto place = static_cast<std::uint32_t>(i < left ? left - 1 - i : i);
    a.permute_v[v] = static_cast<Index>(place);
    if (place == vertices - 1 && left < vertices) shared->first_to_go = v;
    if (errors != nullptr) errors[place] = i < left ? 0.0f : s.distances[v];
  }
}

template <class Index, class Cost>
__global__ void triangle_keys_kernel(EcolArrays<Index> a, std::uint32_t triangles, const LargeShared<Cost>* shared,
                                     std::uint32_t* keys, std::uint32_t* values) {
  for (std::uint64_t i = grid_rank(); i < triangles; i += grid_size()) {
    const auto t = static_cast<std::uint32_t>(triangles - 1 - i);
    const std::uint32_t gone_with = is_degenerate(a.triangles[t]) ? shared->first_to_go : a.permute_t[t];
    values[i] = t;
    keys[i] = gone_with == ~std::uint32_t{0} ? 0 : std::uint32_t{a.permute_v[gone_with]} + 1;
  }
}

template <class Index, class Cost>
__global__ void place_triangles_kernel(EcolArrays<Index> a, std::uint32_t vertices, std::uint32_t triangles,
                                       const std::uint32_t* keys, const std::uint32_t* values,
                                       const LargeShared<Cost>* shared, const float* errors) {
  const std::uint32_t front = lower_bound(keys, triangles, 1);
  for (std::uint64_t i = grid_rank(); i < triangles; i += grid_size())
    a.permute_t[values[i]] = static_cast<std::uint32_t>(i < front ? front - 1 - i : i);
  for (std::uint64_t k = shared->left + grid_rank(); k <= vertices; k += grid_size()) {
    a.map[k] = lower_bound(keys, triangles, k + 1);
    if (a.error != nullptr) a.error[k] = errors[k];
  }
}

struct Larger {
  __device__ float operator()(float a, float b) const { return ieee::max(a, b); }
};

/// The memory of one large mesh.
template <class Real>
struct LargeMemory {
  using Cost = typename CollapsingMesh<Real, std::uint32_t>::Cost;
  LargeShared<Cost>* shared;
  std::byte* state;
  std::uint32_t* keys[2];
  std::uint32_t* values[2];
  float* errors[2];
  std::byte* temporary;
  std::size_t temporary_size = 0;

  [[nodiscard]] static cudaError_t lay_out(LargeMemory& memory, Parts& parts, const MeshRange& mesh,
                                           const EcolOptions& options, bool with_error) {
    const std::size_t items = std::max<std::size_t>(std::size_t{3} * mesh.triangles, mesh.vertices);
    CollapseState<Real, std::uint32_t> s;
    memory.shared = parts.take<LargeShared<Cost>>(1);
    memory.state = parts.take<std::byte>(
        CollapseState<Real, std::uint32_t>::lay_out(s, nullptr, mesh.vertices, mesh.triangles, options, with_error));
    for (int i = 0; i < 2; ++i) {
      memory.keys[i] = parts.take<std::uint32_t>(items);
      memory.values[i] = parts.take<std::uint32_t>(items);
      memory.errors[i] = parts.take<float>(with_error ? mesh.vertices + std::size_t{1} : 0);
    }
    std::size_t scan = 0;
    PGL_CUDA_TRY(memory.sort(nullptr, memory.temporary_size, items, nullptr));
    PGL_CUDA_TRY(memory.scan_errors(nullptr, scan, mesh.vertices + std::size_t{1}, nullptr));
    memory.temporary_size = std::max(memory.temporary_size, scan);
    memory.temporary = parts.take<std::byte>(memory.temporary_size);
    return cudaSuccess;
  }

  [[nodiscard]] cudaError_t sort(void* scratch, std::size_t& size, std::size_t items, cudaStream_t stream) const {
    return cub::DeviceRadixSort::SortPairs(scratch, size, static_cast<const std::uint32_t*>(keys[0]), keys[1],
                                           static_cast<const std::uint32_t*>(values[0]), values[1],
                                           static_cast<std::int64_t>(items), 0, 32, stream);
  }
  [[nodiscard]] cudaError_t scan_errors(void* scratch, std::size_t& size, std::size_t items,
                                        cudaStream_t stream) const {
    return cub::DeviceScan::InclusiveScan(scratch, size, ::cuda::std::make_reverse_iterator(errors[0] + items),
                                          ::cuda::std::make_reverse_iterator(errors[1] + items), Larger{},
                                          static_cast<std::int64_t>(items), stream);
  }
};

template <class Real, class Index>
[[nodiscard]] cudaError_t build_large(const LargeMemory<Real>& memory, const MeshRange& mesh,
                                      const EcolOptions& options, const EcolArrays<Index>& a,
                                      std::uint32_t* min_vertices, Launch launch) {
  using Cost = typename LargeMemory<Real>::Cost;
  CollapseState<Real, std::uint32_t> s;
  CollapseState<Real, std::uint32_t>::lay_out(s, memory.state, mesh.vertices, mesh.triangles, options,
                                              a.error != nullptr);
  const std::uint64_t of_vertices = blocks_for(mesh.vertices, launch.block_threads);
  const std::uint64_t of_both = blocks_for(std::max(mesh.vertices, mesh.triangles) + 1ull, launch.block_threads);
  const std::uint64_t of_corners = blocks_for(3ull * mesh.triangles, launch.block_threads);
  auto* const shared = memory.shared;
  std::size_t size = memory.temporary_size;
  Launch one = launch;
  one.block_threads = 32;
  PGL_CUDA_TRY(run(start_large_kernel<Cost>, 1, 0, one, shared));
  PGL_CUDA_TRY(run(bound_large_kernel<Cost>, std::min<std::uint64_t>(of_vertices, 1024), 0, launch, a.positions,
                   mesh.vertices, shared));
  PGL_CUDA_TRY(
      run(load_large_kernel<Real, Index, Cost>, of_both, 0, launch, s.m, a, shared, memory.keys[0], memory.values[0]));
  PGL_CUDA_TRY(memory.sort(memory.temporary, size, std::size_t{3} * mesh.triangles, launch.stream));
  PGL_CUDA_TRY(run(link_large_kernel<Real>, of_corners, 0, launch, s.m, memory.keys[1], memory.values[1]));
  PGL_CUDA_TRY(run(set_up_large_kernel<Real, Index>, of_vertices, 0, launch, s.m, a));
  PGL_CUDA_TRY(run_cooperative(collapse_large_kernel<Real, Index, Cost>, of_vertices, 0, launch, s, a, shared));
  PGL_CUDA_TRY(run(vertex_keys_kernel<Real>, of_vertices, 0, launch, s, memory.keys[0], memory.values[0]));
  size = memory.temporary_size;
  PGL_CUDA_TRY(memory.sort(memory.temporary, size, mesh.vertices, launch.stream));
  float* const errors = a.error == nullptr ? nullptr : memory.errors[0];
  PGL_CUDA_TRY(run(place_vertices_kernel<Real, Index, Cost>, of_vertices, 0, launch, s, a, memory.keys[1],
                   memory.values[1], shared, errors, min_vertices));
  size = memory.temporary_size;
  if (a.error != nullptr)
    PGL_CUDA_TRY(memory.scan_errors(memory.temporary, size, mesh.vertices + std::size_t{1}, launch.stream));
  PGL_CUDA_TRY(run(triangle_keys_kernel<Index, Cost>, of_both, 0, launch, a, mesh.triangles, shared, memory.keys[0],
                   memory.values[0]));
  size = memory.temporary_size;
  PGL_CUDA_TRY(memory.sort(memory.temporary, size, mesh.triangles, launch.stream));
  return run(place_triangles_kernel<Index, Cost>, of_both, 0, launch, a, mesh.vertices, mesh.triangles, memory.keys[1],
             memory.values[1], shared, memory.errors[1]);
}

}  // namespace detail

namespace detail {

/// Some streams beside the caller's, so that the last meshes of one size do not keep those of the next waiting.
class SideStreams {
 public:
  SideStreams() = default;
  SideStreams(SideStreams&& other) noexcept { swap(other); }
  SideStreams& operator=(SideStreams&& other) noexcept {
    swap(other);
    return *this;
  }
  ~SideStreams() {
    for (const cudaStream_t s : streams_)
      if (s != nullptr) (void)cudaStreamDestroy(s);
    for (const cudaEvent_t e : events_)
      if (e != nullptr) (void)cudaEventDestroy(e);
  }

  /// What is enqueued on the streams from now on comes after what is on `stream`.
  [[nodiscard]] cudaError_t fork(cudaStream_t stream) {
    for (cudaStream_t& s : streams_)
      if (s == nullptr) PGL_CUDA_TRY(cudaStreamCreateWithFlags(&s, cudaStreamNonBlocking));
    for (cudaEvent_t& e : events_)
      if (e == nullptr) PGL_CUDA_TRY(cudaEventCreateWithFlags(&e, cudaEventDisableTiming));
    PGL_CUDA_TRY(cudaEventRecord(events_[count], stream));
    for (const cudaStream_t s : streams_) PGL_CUDA_TRY(cudaStreamWaitEvent(s, events_[count], 0));
    return cudaSuccess;
  }
  cudaStream_t stream(unsigned turn) const { return streams_[turn % count]; }
  /// What is enqueued on `stream` from now on comes after what is on the streams.
  [[nodiscard]] cudaError_t join(cudaStream_t stream) {
    for (unsigned i = 0; i < count; ++i) {
      PGL_CUDA_TRY(cudaEventRecord(events_[i], streams_[i]));
      PGL_CUDA_TRY(cudaStreamWaitEvent(stream, events_[i], 0));
    }
    return cudaSuccess;
  }

 private:
  static constexpr unsigned count = 4;
  void swap(SideStreams& other) noexcept {
    std::swap(streams_, other.streams_);
    std::swap(events_, other.events_);
  }
  cudaStream_t streams_[count] = {};
  cudaEvent_t events_[count + 1] = {};
};

}  // namespace detail

template <class Real = float>
class EcolWorkspace;

namespace detail {
template <class Real, class Index>
[[nodiscard]] cudaError_t build_ecol(std::span<const MeshRange> meshes, const EcolArrays<Index>& all,
                                     const EcolOptions& options, EcolWorkspace<Real>& workspace,
                                     std::uint32_t* min_vertices, Launch launch);
}  // namespace detail

/// Scratch memory of build_ecol. Reuse it from call to call: it grows to what the largest call needed.
///
/// Meshes that fit are collapsed in shared memory and need next to nothing; of the others, as many at a time as fit
/// into about a gigabyte, or one, need about 80 bytes a vertex and 36 a triangle each (Real = float); one large mesh by
/// rounds about 90 and 90.
template <class Real>
class EcolWorkspace {
 public:
  std::size_t bytes() const { return device_tasks_.size() + memory_.size(); }  ///< on the device

 private:
  template <class R, class Index>
  friend cudaError_t detail::build_ecol(std::span<const MeshRange>, const detail::EcolArrays<Index>&,
                                        const EcolOptions&, EcolWorkspace<R>&, std::uint32_t*, Launch);
  std::vector<detail::EcolTask> tasks_;
  std::vector<std::uint64_t> offsets_;
  Buffer device_tasks_, memory_;
  detail::SideStreams side_streams_;
};

namespace detail {

/// By rounds, of the meshes that do not fit into shared memory the largest are the whole device's, one after the other:
/// the i-th if it has at least i times as many vertices. A warp alone takes about as long for a vertex as the device
/// for a sixteenth of such a mesh's rounds, so that one more would take longer than all the rest by warps.
inline constexpr std::uint64_t large_mesh = 1024;
/// Memory for meshes that do not fit into shared memory and are collapsed at the same time, bytes.
inline constexpr std::uint64_t memory_at_a_time = 1ull << 30;

template <class Real, class Index>
cudaError_t build_ecol(std::span<const MeshRange> meshes, const EcolArrays<Index>& all, const EcolOptions& options,
                       EcolWorkspace<Real>& workspace, std::uint32_t* min_vertices, Launch launch) {
  using Small = CollapseState<Real, std::uint16_t>;
  using Wide = CollapseState<Real, std::uint32_t>;
  const bool with_error = all.error != nullptr;
  int device = 0, most_shared = 0, shared_per_processor = 0, reserved = 0;
  PGL_CUDA_TRY(cudaGetDevice(&device));
  PGL_CUDA_TRY(cudaDeviceGetAttribute(&most_shared, cudaDevAttrMaxSharedMemoryPerBlockOptin, device));
  PGL_CUDA_TRY(cudaDeviceGetAttribute(&shared_per_processor, cudaDevAttrMaxSharedMemoryPerMultiprocessor, device));
  PGL_CUDA_TRY(cudaDeviceGetAttribute(&reserved, cudaDevAttrReservedSharedMemoryPerBlock, device));

  // How many meshes may share a processor: 0 where one alone does not fit, else as many as `sharing` offers.
  constexpr std::uint32_t sharing[] = {16, 14, 12, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1};
  const auto limit_of = [&](std::uint32_t n) {
    return std::min<std::size_t>(
               static_cast<std::size_t>(shared_per_processor) / n - static_cast<std::size_t>(reserved),
               static_cast<std::size_t>(most_shared)) /
           16 * 16;
  };
  const auto sharing_of = [&](const MeshRange& mesh) -> std::uint32_t {
    if (mesh.vertices >= 65535 || std::uint64_t{3} * mesh.triangles >= 65535) return 0;
    Small s;
    const std::size_t size = Small::lay_out(s, nullptr, mesh.vertices, mesh.triangles, options, with_error);
    for (const std::uint32_t n : sharing)
      if (size <= limit_of(n)) return n;
    return 0;
  };
  const bool rounds = options.order == EcolOrder::rounds;

  // Tasks: the large ones by rounds, those in global memory, both from large to small; those in shared memory.
  constexpr std::uint32_t kinds = 18;  // 0: large, 1: global memory, 1 + n: n share a processor
  std::uint32_t begin[kinds + 1] = {};
  std::vector<std::uint8_t> kind(meshes.size());
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    kind[i] = static_cast<std::uint8_t>(1 + sharing_of(meshes[i]));
    ++begin[kind[i] + 1];
  }
  for (std::uint32_t k = 0; k < kinds; ++k) begin[k + 1] += begin[k];
  auto& tasks = workspace.tasks_;
  tasks.resize(meshes.size());
  std::uint32_t cursor[kinds];
  std::copy_n(begin, kinds, cursor);
  for (std::size_t i = 0; i < meshes.size(); ++i)
    tasks[cursor[kind[i]]++] = {meshes[i], 0, static_cast<std::uint32_t>(i)};
  for (std::uint32_t i = begin[1]; i < begin[2]; ++i) {
    Wide s;
    tasks[i].bytes = Wide::lay_out(s, nullptr, tasks[i].range.vertices, tasks[i].range.triangles, options, with_error);
  }
  std::sort(tasks.begin() + begin[1], tasks.begin() + begin[2], [](const EcolTask& a, const EcolTask& b) {
    return a.bytes != b.bytes ? a.bytes > b.bytes : a.mesh < b.mesh;
  });
  while (rounds && begin[1] < begin[2] && tasks[begin[1]].range.vertices >= large_mesh * (begin[1] + 1)) ++begin[1];

  // Memory: a part per block for meshes in global memory, of which it does every n-th, so that none is larger than its
  // first; and one for the large ones, in turn.
  auto& offsets = workspace.offsets_;
  offsets.clear();
  std::uint64_t used = 0;
  for (std::uint32_t i = begin[1]; i < begin[2]; ++i) {
    const std::uint64_t size = tasks[i].bytes;
    if (!offsets.empty() && used + size > memory_at_a_time) break;
    offsets.push_back(used);
    used += (size + 255) / 256 * 256;
  }
  for (std::uint32_t i = begin[0]; i < begin[1]; ++i) {
    LargeMemory<Real> memory;
    Parts parts;
    PGL_CUDA_TRY(LargeMemory<Real>::lay_out(memory, parts, tasks[i].range, options, with_error));
    used = std::max<std::uint64_t>(used, parts.size());
  }
  PGL_CUDA_TRY(workspace.memory_.reserve(used));
  const std::size_t task_bytes = (tasks.size() * sizeof(EcolTask) + 255) / 256 * 256;
  PGL_CUDA_TRY(workspace.device_tasks_.reserve(task_bytes + offsets.size() * sizeof(std::uint64_t)));
  const auto* const device_tasks = workspace.device_tasks_.template at<EcolTask>();
  auto* const device_offsets = workspace.device_tasks_.template at<std::uint64_t>(task_bytes);
  if (!tasks.empty())
    PGL_CUDA_TRY(cudaMemcpyAsync(workspace.device_tasks_.template at<EcolTask>(), tasks.data(),
                                 tasks.size() * sizeof(EcolTask), cudaMemcpyHostToDevice, launch.stream));
  if (!offsets.empty())
    PGL_CUDA_TRY(cudaMemcpyAsync(device_offsets, offsets.data(), offsets.size() * sizeof(std::uint64_t),
                                 cudaMemcpyHostToDevice, launch.stream));

  for (std::uint32_t i = begin[0]; i < begin[1]; ++i) {
    const MeshRange& r = tasks[i].range;
    LargeMemory<Real> memory;
    Parts parts(workspace.memory_.template at<std::byte>());
    PGL_CUDA_TRY(LargeMemory<Real>::lay_out(memory, parts, r, options, with_error));
    PGL_CUDA_TRY(build_large<Real, Index>(memory, r, options, arrays_of(all, r), min_vertices + tasks[i].mesh, launch));
  }
  Launch warp = launch;
  warp.block_threads = 32;
  PGL_CUDA_TRY(workspace.side_streams_.fork(launch.stream));
  std::uint32_t turn = 0;
  warp.stream = workspace.side_streams_.stream(turn++);
  PGL_CUDA_TRY(run(build_ecol_kernel<Real, std::uint32_t, Index>, offsets.size(), 0, warp, device_tasks + begin[1],
                   begin[2] - begin[1], options, all, workspace.memory_.template at<std::byte>(), device_offsets,
                   min_vertices));
  auto* const in_shared = build_ecol_kernel<Real, std::uint16_t, Index>;
  PGL_CUDA_TRY(cudaFuncSetAttribute(in_shared, cudaFuncAttributeMaxDynamicSharedMemorySize, most_shared));
  for (std::uint32_t n = 1; n <= 16; ++n) {
    if (begin[n + 1] == begin[n + 2]) continue;
    warp.stream = workspace.side_streams_.stream(turn++);
    PGL_CUDA_TRY(run(in_shared, begin[n + 2] - begin[n + 1], limit_of(n), warp, device_tasks + begin[n + 1],
                     begin[n + 2] - begin[n + 1], options, all, nullptr, nullptr, min_vertices));
  }
  return workspace.side_streams_.join(launch.stream);
}

}  // namespace detail

/// Orders the collapses of many meshes on the GPU: pgl::host::build_ecol over a batch, with the same bytes.
///
/// A warp collapses each mesh, in shared memory where it fits: on a processor with 227 KB, sixteen closed meshes of 250
/// triangles at a time, or one of 4,400. So a model of many meshes keeps the whole device busy; one mesh alone in the
/// greedy order keeps a single warp busy, at some 20 microseconds a collapse. With EcolOrder::rounds the largest meshes
/// that do not fit are collapsed by the whole device instead, one after the other.
///
/// `meshes` is in host memory and is read before the call returns; everything else is on the device: positions,
/// triangles, locked (empty: none), ecol, permute_v, permute_t, map, error (empty: not asked for), min_vertices (one
/// per mesh), as pgl::host::build_ecol has them. Indices below each mesh's number of vertices; at most 2^28 triangles a
/// mesh. Enqueues on launch.stream; copies the list of meshes, so it is not for a captured stream. Memory: see
/// EcolWorkspace; a call that finds room enough allocates nothing on the device.
///
/// Work as on the host for the greedy order, but for the vertices around a collapse, which all look again; per vertex,
/// once, the square of its triangles. Source: as pgl::host::build_ecol.
template <class Real = float, class Index>
[[nodiscard]] cudaError_t build_ecol(std::span<const MeshRange> meshes, std::span<const glm::vec3> positions,
                                     std::span<const Triangle<Index>> triangles, std::span<const std::uint8_t> locked,
                                     const EcolOptions& options, EcolWorkspace<Real>& workspace, std::span<Index> ecol,
                                     std::span<Index> permute_v, std::span<std::uint32_t> permute_t,
                                     std::span<std::uint32_t> map, std::span<float> error,
                                     std::span<std::uint32_t> min_vertices, Launch launch = {}) {
  PGL_ASSERT(min_vertices.size() == meshes.size());
  PGL_ASSERT(ecol.size() == positions.size() && permute_v.size() == positions.size());
  PGL_ASSERT(permute_t.size() == triangles.size() && (error.empty() || error.size() == map.size()));
  PGL_ASSERT(locked.empty() || locked.size() == positions.size());
  const detail::EcolArrays<Index> all{
      positions.data(), triangles.data(), locked.empty() ? nullptr : locked.data(), ecol.data(), permute_v.data(),
      permute_t.data(), map.data(),       error.empty() ? nullptr : error.data()};
  return detail::build_ecol<Real, Index>(meshes, all, options, workspace, min_vertices.data(), launch);
}

/// The same for one mesh; `min_vertices` is one number on the device.
template <class Real = float, class Index>
[[nodiscard]] cudaError_t build_ecol(std::span<const glm::vec3> positions, std::span<const Triangle<Index>> triangles,
                                     std::span<const std::uint8_t> locked, const EcolOptions& options,
                                     EcolWorkspace<Real>& workspace, std::span<Index> ecol, std::span<Index> permute_v,
                                     std::span<std::uint32_t> permute_t, std::span<std::uint32_t> map,
                                     std::span<float> error, std::uint32_t* min_vertices, Launch launch = {}) {
  PGL_ASSERT(map.size() == positions.size() + 1);
  const MeshRange mesh{0, 0, 0, static_cast<std::uint32_t>(positions.size()),
                       static_cast<std::uint32_t>(triangles.size())};
  return build_ecol<Real, Index>(std::span<const MeshRange>(&mesh, 1), positions, triangles, locked, options, workspace,
                                 ecol, permute_v, permute_t, map, error, std::span<std::uint32_t>(min_vertices, 1),
                                 launch);
}

}  // namespace pgl::cuda
