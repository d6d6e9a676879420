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
/// for each candidate, 64 KiB, and for up to 256 occluders 6144 bytes for each and 768 KiB. Reuse it: it grows to the
/// largest call and stays.
struct OccluderWorkspace {
  Buffer memory;
  /// All zero between the calls of select_occluders: for one stream at a time, and no more after a call that failed.
  Buffer counters;
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

inline constexpr int select_bits = 11;
inline constexpr unsigned select_buckets = 1u << select_bits;
inline constexpr int key_bits = 63;  // the top bit of every key is 1
inline constexpr int select_rounds = (key_bits + select_bits - 1) / select_bits;

/// The most threads in a block of select_few_kernel, the most blocks, and the most occluders that it selects.
inline constexpr unsigned most_few_threads = 1024;
inline constexpr unsigned most_few_blocks = 512;
inline constexpr unsigned most_few = 256;
/// How many more than the wanted a search for the heaviest may leave, to be done with after one round as a rule.
inline constexpr unsigned few_spare = 128;

/// The most threads in a block of select_many_kernel, and the most blocks.
inline constexpr unsigned most_many_threads = 512;
inline constexpr unsigned most_many_blocks = 4096;

/// The 4-byte words of a face, and the faces that a warp has in flight for each of its lanes.
inline constexpr unsigned face_words = sizeof(OccluderFace) / sizeof(float);
inline constexpr unsigned faces_in_flight = 2;
static_assert(sizeof(OccluderFace) == 28 && alignof(OccluderFace) == alignof(float));

/// What the blocks of select_many_kernel learn of each other. The sizes are zero before it starts.
struct SelectTables {
  unsigned sizes[select_rounds][select_buckets];
  unsigned chosen[most_many_blocks];  // by each block
};

/// What the threads of a block share in a search for the heaviest.
struct SelectShared {
  unsigned sizes[select_buckets];
  unsigned bucket;
  unsigned above;  // in higher buckets
};

/// What the threads of a block of select_few_kernel share.
struct SelectFewShared {
  SelectShared search;
  float faces[most_few_threads / 32][32 * face_words];
  std::uint64_t keys[most_few + few_spare];
  std::uint32_t positions[most_few + few_spare];
  unsigned taken;   // of keys and positions
  unsigned base;    // of what the block lists
  unsigned listed;  // by all blocks
  bool last;        // no block finishes later
};

/// What the threads of a block of select_many_kernel share.
struct SelectManyShared {
  SelectShared search;
  float faces[most_many_threads / 32][32 * face_words];
  unsigned of_warp[32];
  unsigned before_block;
  unsigned total;
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
  constexpr unsigned each = 64;  // buckets for each lane
  static_assert(select_buckets == 32 * each);
  const unsigned lane = threadIdx.x % 32;
  unsigned own = 0;  // each lane beginning at another one, for the banks
#pragma unroll 16
  for (unsigned k = 0; k < each; ++k) own += shared.sizes[select_buckets - 1 - (each * lane + (k + lane) % each)];
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
  const unsigned bucket = select_buckets - 1 - (each * static_cast<unsigned>(part) + 2 * lane);
  const unsigned upper = shared.sizes[bucket], lower = shared.sizes[bucket - 1];
  up_to = before + count_up_to_lane(upper + lower);
  reached = __ballot_sync(0xffffffffu, up_to >= place);
  if (static_cast<int>(lane) == __ffs(static_cast<int>(reached)) - 1) {
    const bool in_upper = up_to - lower >= place;
    shared.bucket = in_upper ? bucket : bucket - 1;
    shared.above = in_upper ? up_to - lower - upper : up_to - lower;
  }
}

/// The frame, n candidates, fewer than 2^32 - 2^24; weights is scratch. in_view may be null.
struct SelectFrame {
  const std::uint32_t* candidates;
  unsigned n;
  const OccluderFace* faces;
  const std::uint8_t* in_view;
  float* weights;
  std::uint32_t* occluders;
  std::uint64_t wanted;

  __device__ std::uint64_t key(unsigned i) const { return occluder_key(weights[i], candidates[i]); }

  /// The first candidate of a block's part, and of the part behind the last block.
  __device__ unsigned begin(unsigned block) const {
    return static_cast<unsigned>(std::uint64_t{n} * block / gridDim.x);
  }
};

/// Weighs the candidates begin to end - 1, and calls body(weight, object). All threads of the block call it; those of a
/// warp share `staged`.
///
/// Eight lanes read one face, a word each: lanes that read a face each, wherever it lies, would ask for as many lines
/// of memory with each of the seven words. What the next step reads first is read meanwhile.
template <class Body>
__device__ void weigh(const SelectFrame& frame, const Eye& eye, unsigned begin, unsigned end, float* staged,
                      Body&& body) {
  const unsigned lane = threadIdx.x % 32, part = lane % 8;
  const float* const words = reinterpret_cast<const float*>(frame.faces);
  const unsigned stride = faces_in_flight * blockDim.x;
  const auto objects_at = [&](unsigned first, std::uint32_t(&object)[faces_in_flight]) {
#pragma unroll
    for (unsigned u = 0; u < faces_in_flight; ++u) {
      const unsigned i = first + 32 * u + lane;
      object[u] = i < end ? frame.candidates[i] : no_object;
    }
  };
  const auto sights_of = [&](const std::uint32_t(&object)[faces_in_flight], bool(&sight)[faces_in_flight]) {
#pragma unroll
    for (unsigned u = 0; u < faces_in_flight; ++u) sight[u] = object[u] != no_object;
    if (frame.in_view == nullptr) return;
#pragma unroll
    for (unsigned u = 0; u < faces_in_flight; ++u) sight[u] &= frame.in_view[sight[u] ? object[u] : 0] != 0;
  };
  std::uint32_t object[faces_in_flight], next[faces_in_flight];
  bool sight[faces_in_flight], seen[faces_in_flight];
  unsigned first = begin + faces_in_flight * (threadIdx.x - lane);  // the same in all lanes
  objects_at(first, object);
  sights_of(object, sight);
  for (; first < end; first += stride) {
    objects_at(first + stride, next);
    float word[faces_in_flight][8];
#pragma unroll
    for (unsigned u = 0; u < faces_in_flight; ++u) {
      seen[u] = sight[u];
      const std::uint32_t own = seen[u] ? object[u] : 0;  // any face will do for one that does not count
#pragma unroll
      for (unsigned r = 0; r < 8; ++r) {
        const std::uint32_t of = __shfl_sync(0xffffffffu, own, static_cast<int>(4 * r + lane / 8));
        word[u][r] = words[std::uint64_t{of} * face_words + min(part, face_words - 1)];
      }
    }
    sights_of(next, sight);
#pragma unroll
    for (unsigned u = 0; u < faces_in_flight; ++u) {
      if (part < face_words) {
#pragma unroll
        for (unsigned r = 0; r < 8; ++r) staged[(4 * r + lane / 8) * face_words + part] = word[u][r];
      }
      __syncwarp();
      const float* const own = staged + lane * face_words;
      const OccluderFace face{{own[0], own[1], own[2]}, {own[3], own[4], own[5]}, own[6]};
      __syncwarp();  // before the words are overwritten
      const unsigned i = first + 32 * u + lane;
      if (i < end) {
        const float weight = seen[u] ? occluder_weight(face, eye) : ieee::quiet_nan<float>;
        frame.weights[i] = weight;
        body(weight, object[u]);
      }
      object[u] = next[u];
    }
  }
}

/// What is at least the place-th key (from 1) of the block's keys, or all keys where there are fewer; then how many.
struct SelectLimit {
  std::uint64_t key;
  unsigned reached;
};

/// Finds a key that at least `place` of the keys reach and at most `most`, or all where there are fewer: digit by
/// digit, from the sizes of the buckets of the bucket that holds the place-th. for_keys(round, body) calls body(key)
/// for each key, among all threads of the block; all of them call this, and get the same. Precondition: 1 <= place <=
/// most; keys but 0 differ.
template <class ForKeys>
__device__ SelectLimit select_limit(unsigned place, unsigned most, SelectShared& shared, ForKeys&& for_keys) {
  std::uint64_t prefix = 1;
  unsigned above = 0;
  int shift = key_bits;
  for (int round = 0;; ++round) {
    const int before = shift;
    shift = before > select_bits ? before - select_bits : 0;
    const std::uint64_t digits = (std::uint64_t{1} << (before - shift)) - 1;
    for (unsigned b = threadIdx.x; b < select_buckets; b += blockDim.x) shared.sizes[b] = 0;
    __syncthreads();
    for_keys(round, [&](std::uint64_t key) {
      if (key >> before == prefix) atomicAdd(&shared.sizes[(key >> shift) & digits], 1u);
    });
    __syncthreads();
    if (threadIdx.x < 32) find_select_bucket(place - above, shared);
    __syncthreads();
    const unsigned bucket = shared.bucket;
    above += shared.above;
    const unsigned size = bucket < select_buckets ? shared.sizes[bucket] : 0;
    __syncthreads();                                  // before what is shared is used again
    if (bucket == select_buckets) return {1, above};  // in the first round, if ever
    prefix = prefix << (before - shift) | bucket;
    if (above + size <= most || shift == 0) return {prefix << shift, above + size};
  }
}

/// The heaviest of each block's part, in any order, and how many there are of all; these and how many blocks are done
/// are zero before the kernel starts and after it.
struct SelectList {
  std::uint64_t* keys;
  std::uint32_t* positions;  // among the candidates
  unsigned* listed;
  unsigned* done;
};

/// The k heaviest, few: every block lists the k heaviest of its part, and not many more; then the block that is done
/// last finds the k heaviest of those, and where each comes among them in the order of the candidates by counting those
/// before it.
template <class = void>
__global__ void __launch_bounds__(most_few_threads) select_few_kernel(SelectFrame frame, Eye eye, SelectList list) {
  __shared__ SelectFewShared shared;
  const unsigned thread = threadIdx.x, begin = frame.begin(blockIdx.x), end = frame.begin(blockIdx.x + 1);
  const unsigned wanted = static_cast<unsigned>(frame.wanted), most = wanted + few_spare;
  if (thread == 0) shared.taken = 0;
  SelectLimit limit = select_limit(wanted, most, shared.search, [&](int round, auto&& body) {
    if (round == 0)
      weigh(frame, eye, begin, end, shared.faces[thread / 32],
            [&](float weight, std::uint32_t object) { body(occluder_key(weight, object)); });
    else
      for (unsigned i = begin + thread; i < end; i += blockDim.x) body(frame.key(i));
  });

  // The block's heaviest. Where they go in the list is asked for at once and looked at when they are found.
  const unsigned reached = min(limit.reached, most);
  unsigned base = 0;
  if (thread == 0 && reached > 0) base = atomicAdd(list.listed, reached);
  constexpr unsigned in_flight = 8;
  for (unsigned first = begin + thread; first < end; first += in_flight * blockDim.x) {
    float weight[in_flight];
#pragma unroll
    for (unsigned u = 0; u < in_flight; ++u) {
      const unsigned i = first + u * blockDim.x;
      weight[u] = i < end ? frame.weights[i] : ieee::quiet_nan<float>;
    }
#pragma unroll
    for (unsigned u = 0; u < in_flight; ++u) {
      if (weight[u] != weight[u] || ieee::order_key(weight[u]) < limit.key >> 32) continue;
      const unsigned i = first + u * blockDim.x;
      const std::uint64_t key = occluder_key(weight[u], frame.candidates[i]);
      if (key < limit.key) continue;
      const unsigned to = atomicAdd(&shared.taken, 1u);
      if (to < reached) {
        shared.keys[to] = key;
        shared.positions[to] = i;
      }
    }
  }
  if (thread == 0) shared.base = base;
  __syncthreads();
  for (unsigned e = thread; e < reached; e += blockDim.x) {
    list.keys[shared.base + e] = shared.keys[e];
    list.positions[shared.base + e] = shared.positions[e];
  }
  __syncthreads();
  if (thread == 0) {
    __threadfence();                                                     // all that the block wrote comes before this
    shared.last = atomicInc(list.done, gridDim.x - 1) == gridDim.x - 1;  // the last one sets it to zero
    __threadfence();
    if (shared.last) shared.listed = atomicExch(list.listed, 0u);
    shared.taken = 0;
  }
  __syncthreads();
  if (!shared.last) return;

  // The last block: calls body(key, place in the list) for all that is listed.
  const unsigned listed = shared.listed;
  const auto for_listed = [&](auto&& body) {
    constexpr unsigned at_once = 4;
    for (unsigned first = thread; first < listed; first += at_once * blockDim.x) {
      std::uint64_t key[at_once];
#pragma unroll
      for (unsigned u = 0; u < at_once; ++u) {
        const unsigned e = first + u * blockDim.x;
        key[u] = e < listed ? __ldcg(reinterpret_cast<const unsigned long long*>(list.keys + e)) : 0;
      }
#pragma unroll
      for (unsigned u = 0; u < at_once; ++u) body(key[u], first + u * blockDim.x);
    }
  };
  limit = select_limit(wanted, most, shared.search,
                       [&](int, auto&& body) { for_listed([&](std::uint64_t key, unsigned) { body(key); }); });
  for_listed([&](std::uint64_t key, unsigned e) {
    if (key < limit.key) return;  // 0 among them
    const unsigned to = atomicAdd(&shared.taken, 1u);
    if (to < most) {
      shared.keys[to] = key;
      shared.positions[to] = __ldcg(list.positions + e);
    }
  });
  __syncthreads();
  const unsigned taken = min(shared.taken, most), chosen = min(taken, wanted);
  if (taken > wanted) {
    for (unsigned e = thread; e < taken; e += blockDim.x) {
      const std::uint64_t key = shared.keys[e];
      unsigned heavier = 0;
#pragma unroll 4
      for (unsigned other = 0; other < taken; ++other) heavier += shared.keys[other] > key ? 1u : 0u;
      if (heavier >= wanted) shared.positions[e] = no_object;  // behind all
    }
    __syncthreads();
  }
  for (unsigned e = thread; e < taken; e += blockDim.x) {
    const std::uint32_t position = shared.positions[e];
    if (position == no_object) continue;
    unsigned to = 0;
#pragma unroll 4
    for (unsigned other = 0; other < taken; ++other) to += shared.positions[other] < position ? 1u : 0u;
    frame.occluders[to] = ~static_cast<std::uint32_t>(shared.keys[e]);
  }
  for (unsigned e = chosen + thread; e < wanted; e += blockDim.x) frame.occluders[e] = no_object;
}

/// The k heaviest, many: the k-th largest key is found digit by digit, eleven bits at a time, from the sizes of the
/// 2048 buckets of the bucket that holds it, until all of a bucket belong to the k; two or three rounds as a rule, six
/// at most. Each block has a part of the candidates in a row, so that the order of the chosen follows from their
/// numbers.
template <class = void>
__global__ void __launch_bounds__(most_many_threads, 1)
    select_many_kernel(SelectFrame frame, Eye eye, SelectTables* tables) {
  __shared__ SelectManyShared shared;
  const cooperative_groups::grid_group grid = cooperative_groups::this_grid();
  const unsigned thread = threadIdx.x, warp = thread / 32, lane = thread % 32, warps = blockDim.x / 32;
  const unsigned begin = frame.begin(blockIdx.x), end = frame.begin(blockIdx.x + 1);

  std::uint64_t limit = 1;  // all candidates with a key
  std::uint64_t prefix = 1;
  unsigned place = frame.wanted < frame.n ? static_cast<unsigned>(frame.wanted) : frame.n;
  int shift = key_bits;
  for (int round = 0; round < select_rounds; ++round) {
    const int before = shift;
    shift = before > select_bits ? before - select_bits : 0;
    const std::uint64_t digits = (std::uint64_t{1} << (before - shift)) - 1;
    for (unsigned b = thread; b < select_buckets; b += blockDim.x) shared.search.sizes[b] = 0;
    __syncthreads();
    const auto count = [&](std::uint64_t key) {
      if (key >> before == prefix) atomicAdd(&shared.search.sizes[(key >> shift) & digits], 1u);
    };
    if (round == 0)
      weigh(frame, eye, begin, end, shared.faces[warp],
            [&](float weight, std::uint32_t object) { count(occluder_key(weight, object)); });
    else
      for (unsigned i = begin + thread; i < end; i += blockDim.x) count(frame.key(i));
    __syncthreads();
    for (unsigned b = thread; b < select_buckets; b += blockDim.x)
      if (shared.search.sizes[b] > 0) atomicAdd(&tables->sizes[round][b], shared.search.sizes[b]);
    grid.sync();

    for (unsigned b = thread; b < select_buckets; b += blockDim.x) shared.search.sizes[b] = tables->sizes[round][b];
    __syncthreads();
    if (warp == 0) find_select_bucket(place, shared.search);
    __syncthreads();
    const unsigned bucket = shared.search.bucket;
    if (bucket == select_buckets) break;  // in the first round, if ever
    place -= shared.search.above;
    const unsigned size = shared.search.sizes[bucket];
    prefix = prefix << (before - shift) | bucket;
    limit = prefix << shift;
    __syncthreads();  // before the sizes are used again
    if (place == size) break;
  }

  // How many each block has, and where its own begin.
  unsigned own = 0;
  for (unsigned i = begin + thread; i < end; i += blockDim.x) own += frame.key(i) >= limit ? 1u : 0u;
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
    for (unsigned first = begin; first < end; first += blockDim.x) {
      const unsigned i = first + thread;
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
/// O(candidates + occluders). Up to 256 occluders: one kernel, on blocks of four times launch.block_threads, at most
/// 1024. More: a memset and one cooperative kernel, on blocks of at most 512 threads, about twice as long. No sort, and
/// nothing is allocated once the workspace has been used for as many candidates and occluders; a workspace that was
/// never used is cleared on launch.stream. Enqueued on launch.stream, capturable; the same for any launch and GPU.
[[nodiscard]] inline cudaError_t select_occluders(std::span<const std::uint32_t> candidates,
                                                  std::span<const OccluderFace> faces,
                                                  std::span<const std::uint8_t> in_view, const View& view,
                                                  OccluderWorkspace& workspace, std::span<std::uint32_t> occluders,
                                                  Launch launch = {}) {
  const std::uint64_t n = candidates.size();
  PGL_ASSERT(in_view.empty() || in_view.size() == faces.size());
  PGL_ASSERT(faces.size() <= (std::uint64_t{1} << 31) && n <= faces.size());
  if (occluders.empty()) return cudaSuccess;
  const bool few = occluders.size() <= detail::most_few;
  detail::SelectTables* tables = nullptr;
  float* weights = nullptr;
  detail::SelectList list{};
  const auto take = [&](detail::Parts parts) {
    weights = parts.take<float>(n);
    if (few) {
      const std::uint64_t most = std::min(n, detail::most_few_blocks * (occluders.size() + detail::few_spare));
      list.keys = parts.take<std::uint64_t>(most);
      list.positions = parts.take<std::uint32_t>(most);
    } else {
      tables = parts.take<detail::SelectTables>(1);
    }
    return parts.size();
  };
  PGL_CUDA_TRY(workspace.memory.reserve(take(detail::Parts())));
  take(detail::Parts(workspace.memory.at<void>()));
  const detail::SelectFrame frame{
      candidates.data(), static_cast<unsigned>(n), faces.data(),    in_view.empty() ? nullptr : in_view.data(),
      weights,           occluders.data(),         occluders.size()};
  if (!few) {
    launch.block_threads = std::min(launch.block_threads, detail::most_many_threads);
    PGL_CUDA_TRY(cudaMemsetAsync(tables->sizes, 0, sizeof(tables->sizes), launch.stream));
    const std::uint64_t blocks =
        std::min<std::uint64_t>(detail::blocks_for(n, 2 * launch.block_threads), detail::most_many_blocks);
    return detail::run_cooperative(detail::select_many_kernel<>, blocks, 0, launch, frame, eye_of(view), tables);
  }
  if (workspace.counters.size() == 0) {
    constexpr std::size_t bytes = 2 * sizeof(unsigned);
    PGL_CUDA_TRY(workspace.counters.reserve(bytes));
    if (const cudaError_t error = cudaMemsetAsync(workspace.counters.at<void>(), 0, bytes, launch.stream);
        error != cudaSuccess) {
      workspace.counters = Buffer();
      return error;
    }
  }
  list.listed = workspace.counters.at<unsigned>();
  list.done = list.listed + 1;
  launch.block_threads = std::min(4 * launch.block_threads, detail::most_few_threads);
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(detail::resident_blocks(detail::select_few_kernel<>, 0, launch, blocks));
  blocks = std::min<std::uint64_t>(blocks, detail::most_few_blocks);
  blocks = std::clamp<std::uint64_t>(detail::blocks_for(n, detail::faces_in_flight * launch.block_threads), 1, blocks);
  return detail::run(detail::select_few_kernel<>, blocks, 0, launch, frame, eye_of(view), list);
}

}  // namespace pgl::cuda
