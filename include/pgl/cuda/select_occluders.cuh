// SPDX-License-Identifier: MIT
// Chooses the occluders of a frame, on the GPU.
#pragma once

#include <cooperative_groups.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cub/device/device_radix_sort.cuh>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"

namespace pgl::cuda {

/// Scratch memory of compactness_order, 12 bytes for each object and what CUB needs, and of select_occluders, 4 bytes
/// for each candidate and 48 KiB. Reuse it: it grows to the largest call and stays.
struct OccluderWorkspace {
  Buffer memory;
};

namespace detail {

template <class = void>
__global__ void __launch_bounds__(512)
    occluder_faces_kernel(const Object* objects, std::uint64_t n, const OrientedBox* boxes, const float* compactness,
                          OccluderFace* faces) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    const std::uint32_t mesh = objects[i].mesh;
    faces[i] = occluder_face(boxes[mesh], compactness[mesh], objects[i].transform);
  }
}

template <class = void>
__global__ void __launch_bounds__(1024)
    compactness_keys_kernel(const OccluderFace* faces, std::uint64_t n, std::uint32_t* keys, std::uint32_t* objects) {
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    keys[i] = ~compactness_key(faces[i].compactness);
    objects[i] = static_cast<std::uint32_t>(i);
  }
}

/// The most threads in a block of select_occluders_kernel, and the most blocks.
inline constexpr unsigned most_select_threads = 512;
inline constexpr std::uint64_t most_select_blocks = 4096;

inline constexpr int select_bits = 10;
inline constexpr unsigned select_buckets = 1u << select_bits;
inline constexpr int key_bits = 63;  // the top bit of every key is 1
inline constexpr int select_rounds = (key_bits + select_bits - 1) / select_bits;

/// What the blocks learn of each other. The sizes are zero before the kernel starts.
struct SelectTables {
  unsigned sizes[select_rounds][select_buckets];
  unsigned chosen[most_select_blocks];  // by each block
};

/// What the threads of a block share.
struct SelectShared {
  unsigned sizes[select_buckets];
  unsigned of_warp[32];
  unsigned before_block;
  unsigned total;
  unsigned bucket;
  unsigned above;  // in higher buckets
};

/// The sum of the values of this lane and the ones below it. All 32 lanes call it.
__device__ inline unsigned count_up_to_lane(unsigned value) {
  const unsigned lane = threadIdx.x % 32;
  for (unsigned distance = 1; distance < 32; distance *= 2) {
    const unsigned below = __shfl_up_sync(0xffffffffu, value, distance);
    if (lane >= distance) value += below;
  }
  return value;
}

/// Finds the bucket, from the last one down, that holds the place-th key (from 1), and the size of those above it: in
/// shared.bucket and shared.above; select_buckets and the size of all where there are fewer. One warp calls it, with
/// shared.sizes filled.
__device__ inline void find_select_bucket(unsigned place, SelectShared& shared) {
  static_assert(select_buckets == 32 * 32);
  const unsigned lane = threadIdx.x % 32;
  unsigned own = 0;  // of 32 buckets, each lane beginning at another one, for the banks
  for (unsigned k = 0; k < 32; ++k) own += shared.sizes[select_buckets - 1 - (32 * lane + (k + lane) % 32)];
  unsigned up_to = count_up_to_lane(own);
  unsigned reached = __ballot_sync(0xffffffffu, up_to >= place);
  if (reached == 0) {
    if (lane == 31) {
      shared.bucket = select_buckets;
      shared.above = up_to;
    }
    return;
  }
  const int part = __ffs(static_cast<int>(reached)) - 1;
  const unsigned before = __shfl_sync(0xffffffffu, up_to - own, part);
  const unsigned bucket = select_buckets - 1 - (32 * static_cast<unsigned>(part) + lane);
  own = shared.sizes[bucket];
  up_to = before + count_up_to_lane(own);
  reached = __ballot_sync(0xffffffffu, up_to >= place);
  if (static_cast<int>(lane) == __ffs(static_cast<int>(reached)) - 1) {
    shared.bucket = bucket;
    shared.above = up_to - own;
  }
}

/// The frame, n candidates; weights is scratch. in_view may be null.
struct SelectFrame {
  const std::uint32_t* candidates;
  std::uint64_t n;
  const OccluderFace* faces;
  const std::uint8_t* in_view;
  float* weights;
  std::uint32_t* occluders;
  std::uint64_t wanted;

  __device__ std::uint64_t key(std::uint64_t i) const { return occluder_key(weights[i], candidates[i]); }
};

/// The k heaviest: the k-th largest key is found digit by digit, ten bits at a time, from the sizes of the 1024 buckets
/// of the bucket that holds it, until all of a bucket belong to the k; two or three rounds as a rule, seven at most.
/// Each block has a part of the candidates in a row, so that the order of the chosen follows from their numbers.
template <class = void>
__global__ void __launch_bounds__(most_select_threads)
    select_occluders_kernel(SelectFrame frame, Eye eye, SelectTables* tables) {
  __shared__ SelectShared shared;
  const cooperative_groups::grid_group grid = cooperative_groups::this_grid();
  const unsigned thread = threadIdx.x, warp = thread / 32, lane = thread % 32, warps = blockDim.x / 32;
  const std::uint64_t begin = frame.n * blockIdx.x / gridDim.x, end = frame.n * (blockIdx.x + 1ull) / gridDim.x;

  std::uint64_t limit = 1;  // all candidates with a key
  std::uint64_t prefix = 1;
  unsigned place = frame.wanted < frame.n ? static_cast<unsigned>(frame.wanted) : static_cast<unsigned>(frame.n);
  int shift = key_bits;
  for (int round = 0; round < select_rounds; ++round) {
    const int before = shift;
    shift = before > select_bits ? before - select_bits : 0;
    const std::uint64_t digits = (std::uint64_t{1} << (before - shift)) - 1;
    for (unsigned b = thread; b < select_buckets; b += blockDim.x) shared.sizes[b] = 0;
    __syncthreads();
    for (std::uint64_t i = begin + thread; i < end; i += blockDim.x) {
      if (round == 0) {
        const std::uint32_t object = frame.candidates[i];
        const bool seen = frame.in_view == nullptr || frame.in_view[object] != 0;
        frame.weights[i] = seen ? occluder_weight(frame.faces[object], eye) : ieee::quiet_nan<float>;
      }
      const std::uint64_t key = frame.key(i);
      if (key >> before == prefix) atomicAdd(&shared.sizes[(key >> shift) & digits], 1u);
    }
    __syncthreads();
    for (unsigned b = thread; b < select_buckets; b += blockDim.x)
      if (shared.sizes[b] > 0) atomicAdd(&tables->sizes[round][b], shared.sizes[b]);
    grid.sync();

    for (unsigned b = thread; b < select_buckets; b += blockDim.x) shared.sizes[b] = tables->sizes[round][b];
    __syncthreads();
    if (warp == 0) find_select_bucket(place, shared);
    __syncthreads();
    const unsigned bucket = shared.bucket;
    if (bucket == select_buckets) break;  // in the first round, if ever
    place -= shared.above;
    const unsigned size = shared.sizes[bucket];
    prefix = prefix << (before - shift) | bucket;
    limit = prefix << shift;
    __syncthreads();  // before the sizes are used again
    if (place == size) break;
  }

  // How many each block has, and where its own begin.
  unsigned own = 0;
  for (std::uint64_t i = begin + thread; i < end; i += blockDim.x) own += frame.key(i) >= limit ? 1u : 0u;
  for (int distance = 16; distance > 0; distance /= 2) own += __shfl_down_sync(0xffffffffu, own, distance);
  if (lane == 0) shared.of_warp[warp] = own;
  __syncthreads();
  if (thread == 0) {
    unsigned of_block = 0;
    for (unsigned w = 0; w < warps; ++w) of_block += shared.of_warp[w];
    tables->chosen[blockIdx.x] = of_block;
    shared.before_block = 0;
    shared.total = 0;
  }
  grid.sync();
  unsigned before_block = 0, total = 0;
  for (unsigned b = thread; b < gridDim.x; b += blockDim.x) {
    const unsigned of_block = tables->chosen[b];
    total += of_block;
    if (b < blockIdx.x) before_block += of_block;
  }
  if (before_block > 0) atomicAdd(&shared.before_block, before_block);
  if (total > 0) atomicAdd(&shared.total, total);
  __syncthreads();

  std::uint64_t at = shared.before_block;
  if (tables->chosen[blockIdx.x] > 0)
    for (std::uint64_t first = begin; first < end; first += blockDim.x) {
      const std::uint64_t i = first + thread;
      const bool chosen = i < end && frame.key(i) >= limit;
      const unsigned of_warp = __ballot_sync(0xffffffffu, chosen);
      if (lane == 0) shared.of_warp[warp] = static_cast<unsigned>(__popc(of_warp));
      __syncthreads();
      std::uint64_t to = at;
      for (unsigned w = 0; w < warps; ++w) {
        if (w < warp) to += shared.of_warp[w];
        at += shared.of_warp[w];
      }
      if (chosen)
        frame.occluders[to + static_cast<unsigned>(__popc(of_warp & ((1u << lane) - 1)))] = frame.candidates[i];
      __syncthreads();
    }
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = shared.total + std::uint64_t{blockIdx.x} * blockDim.x + thread; i < frame.wanted; i += stride)
    frame.occluders[i] = no_object;
}

}  // namespace detail

/// Writes each object's face, as pgl::host::occluder_faces does.
///
/// All views are of device memory. O(objects), one kernel, no scratch. Enqueued on launch.stream, capturable; the same
/// bits for any launch and GPU.
[[nodiscard]] inline cudaError_t occluder_faces(std::span<const Object> objects, std::span<const OrientedBox> boxes,
                                                std::span<const float> compactness, std::span<OccluderFace> faces,
                                                Launch launch = {}) {
  PGL_ASSERT(faces.size() == objects.size() && compactness.size() == boxes.size());
  launch.block_threads = std::min(launch.block_threads, 512u);
  const std::uint64_t n = objects.size();
  return detail::run(detail::occluder_faces_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     objects.data(), n, boxes.data(), compactness.data(), faces.data());
}

/// Writes the objects' indices by descending compactness, as pgl::host::compactness_order does.
///
/// faces: in, on the device. order: out, on the device. A kernel and a radix sort (CUB, stable); nothing is allocated
/// once the workspace has been used for as many objects. Enqueued on launch.stream, capturable; the same for any launch
/// and GPU.
[[nodiscard]] inline cudaError_t compactness_order(std::span<const OccluderFace> faces, OccluderWorkspace& workspace,
                                                   std::span<std::uint32_t> order, Launch launch = {}) {
  const std::uint64_t n = faces.size();
  PGL_ASSERT(order.size() == n && n <= (std::uint64_t{1} << 31));
  if (n == 0) return cudaSuccess;
  const std::uint32_t* none = nullptr;
  std::uint32_t* nowhere = nullptr;
  std::size_t sort_bytes = 0;
  PGL_CUDA_TRY(
      cub::DeviceRadixSort::SortPairs(nullptr, sort_bytes, none, nowhere, none, nowhere, n, 0, 32, launch.stream));
  std::uint32_t *keys = nullptr, *sorted = nullptr, *objects = nullptr;
  std::byte* memory = nullptr;
  const auto take = [&](detail::Parts parts) {
    keys = parts.take<std::uint32_t>(n);
    sorted = parts.take<std::uint32_t>(n);
    objects = parts.take<std::uint32_t>(n);
    memory = parts.take<std::byte>(sort_bytes);
    return parts.size();
  };
  PGL_CUDA_TRY(workspace.memory.reserve(take(detail::Parts())));
  take(detail::Parts(workspace.memory.at<void>()));
  PGL_CUDA_TRY(detail::run(detail::compactness_keys_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                           faces.data(), n, keys, objects));
  return cub::DeviceRadixSort::SortPairs(memory, sort_bytes, keys, sorted, objects, order.data(), n, 0, 32,
                                         launch.stream);
}

/// Chooses the occluders of a frame, as pgl::host::select_occluders does.
///
/// candidates, faces, in_view: in, on the device; an empty `in_view` means all are in view. occluders: out, on the
/// device, overlapping no input. The view is read before this returns: a captured graph keeps the one that it was
/// captured with. Preconditions: those of the host; that every candidate is below faces.size() is not checked here.
/// O(candidates + occluders); a memset and one cooperative kernel, on blocks of at most 512 threads. No sort, and
/// nothing is allocated once the workspace has been used for as many candidates. Enqueued on launch.stream, capturable;
/// the same for any launch and GPU.
[[nodiscard]] inline cudaError_t select_occluders(std::span<const std::uint32_t> candidates,
                                                  std::span<const OccluderFace> faces,
                                                  std::span<const std::uint8_t> in_view, const View& view,
                                                  OccluderWorkspace& workspace, std::span<std::uint32_t> occluders,
                                                  Launch launch = {}) {
  const std::uint64_t n = candidates.size();
  PGL_ASSERT(in_view.empty() || in_view.size() == faces.size());
  PGL_ASSERT(faces.size() <= (std::uint64_t{1} << 31) && n <= faces.size());
  if (occluders.empty()) return cudaSuccess;
  launch.block_threads = std::min(launch.block_threads, detail::most_select_threads);
  detail::SelectTables* tables = nullptr;
  float* weights = nullptr;
  const auto take = [&](detail::Parts parts) {
    tables = parts.take<detail::SelectTables>(1);
    weights = parts.take<float>(n);
    return parts.size();
  };
  PGL_CUDA_TRY(workspace.memory.reserve(take(detail::Parts())));
  take(detail::Parts(workspace.memory.at<void>()));
  PGL_CUDA_TRY(cudaMemsetAsync(tables->sizes, 0, sizeof(tables->sizes), launch.stream));
  const detail::SelectFrame frame{
      candidates.data(), n, faces.data(), in_view.empty() ? nullptr : in_view.data(), weights, occluders.data(),
      occluders.size()};
  const std::uint64_t blocks = std::min(detail::blocks_for(n, 2 * launch.block_threads), detail::most_select_blocks);
  return detail::run_cooperative(detail::select_occluders_kernel<>, blocks, 0, launch, frame, eye_of(view), tables);
}

}  // namespace pgl::cuda
