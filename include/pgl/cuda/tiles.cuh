// SPDX-License-Identifier: MIT
// How the GPU drivers that fill one output with the parts of many objects share it out: tiles, a warp each.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"

namespace pgl::cuda::detail {

inline constexpr unsigned whole_warp = 0xffffffffu;

__device__ inline unsigned lane_index() {
  return threadIdx.x % 32;
}

/// Where tiles of an output begin, so that as many as can be do so at an address that is a multiple of 16: tile j holds
/// the elements [j * size - lead, (j + 1) * size - lead) that there are. The size is a multiple of 16 elements.
struct TileStart {
  unsigned lead = 0;     ///< below 16
  bool aligned = false;  ///< there is such a lead
};

template <class T>
TileStart tile_start(const T* out) {
  const auto address = reinterpret_cast<std::uintptr_t>(out);
  for (unsigned lead = 0; lead < 16; ++lead) {
    if ((address - lead * sizeof(T)) % 16 == 0) return {lead, true};
  }
  return {};
}

/// Finds the object that holds `position` of the output, a whole warp together: the i in [first, last) with
/// offsets[i] <= position < offsets[i + 1]. Precondition: offsets[first] <= position < offsets[last].
__device__ inline std::uint64_t object_at(const std::uint64_t* offsets, std::uint64_t first, std::uint64_t last,
                                          std::uint64_t position) {
  while (last - first > 1) {
    const std::uint64_t step = (last - first + 31) / 32;
    const std::uint64_t probe = first + (lane_index() + 1) * step;
    const bool below = probe < last && offsets[probe] <= position;
    first += static_cast<unsigned>(__popc(__ballot_sync(whole_warp, below))) * step;
    last = last - first < step ? last : first + step;
  }
  return first;
}

/// What a lane knows of its object in a group, see for_each_group.
struct TilePart {
  std::uint64_t object;
  std::uint64_t begin;  ///< offsets[object]
  std::uint32_t size;  ///< elements that are in the tile, and in this group; 0: none, then only `object` means anything
  unsigned slot;       ///< the lane's object is the slot-th of those with any
};

/// Calls body(part, first, last) for the objects of a tile of the output, a whole warp together: up to 32 objects at a
/// time, one for each lane, that fill the positions [first, last) of the tile. `object` holds element lo. Position 0 is
/// element `origin` of the output, which may lie before its beginning; the tile ends at [lo, hi), both within the
/// offsets.
///
/// heads: a word of shared memory for every 32 positions, rows of them, the warp's own. After a __syncwarp, which the
/// body must do, slot_of finds with them whose a position is. Objects without elements cost little, however many.
template <unsigned rows, class Body>
__device__ void for_each_group(const std::uint64_t* offsets, std::uint64_t objects, std::uint64_t object,
                               std::uint64_t origin, std::uint64_t lo, std::uint64_t hi, unsigned* heads, Body&& body) {
  std::uint64_t first = object;
  while (lo < hi) {
    const std::uint64_t i = first + lane_index();
    const bool exists = i < objects;
    const std::uint64_t begin = exists ? offsets[i] : hi;
    const std::uint64_t end = exists ? offsets[i + 1] : hi;
    const std::uint64_t from = begin > lo ? begin : lo;
    const std::uint64_t to = end < hi ? end : hi;
    const bool shown = from < to;
    const unsigned all_shown = __ballot_sync(whole_warp, shown);
    if (all_shown == 0) {
      first = object_at(offsets, first, objects, lo);
      continue;
    }
    const std::uint64_t stop = __shfl_sync(whole_warp, to, 31);

    if (lane_index() < rows) heads[lane_index()] = 0;
    __syncwarp();
    if (shown) {
      const auto head = static_cast<unsigned>(from - origin);
      atomicOr(&heads[head / 32], 1u << (head % 32));
    }
    const TilePart part{.object = i,
                        .begin = begin,
                        .size = shown ? static_cast<std::uint32_t>(to - from) : 0u,
                        .slot = static_cast<unsigned>(__popc(all_shown & ((1u << lane_index()) - 1)))};
    body(part, static_cast<unsigned>(lo - origin), static_cast<unsigned>(stop - origin));
    __syncwarp();
    lo = stop;
    first += 32;
  }
}

/// The slot of the object that position 32 * row + lane belongs to. Precondition: the position is in the group.
__device__ inline unsigned slot_of(const unsigned* heads, unsigned row) {
  int heads_so_far = __popc(heads[row] & (whole_warp >> (31 - lane_index())));
  for (unsigned r = 0; r < row; ++r) heads_so_far += __popc(heads[r]);
  return static_cast<unsigned>(heads_so_far) - 1;
}

/// Writes the elements [first, last) of 32 in shared memory to out[at + first .. at + last), a whole warp together and
/// without gaps between what neighbours write. `staged` is aligned to 16 bytes, and out + at too if `aligned`; `at` may
/// be below 0, modulo 2^64. T consists of Words.
template <class Word, class T>
__device__ void write_row(const T* staged, T* out, std::uint64_t at, unsigned first, unsigned last, bool aligned) {
  static_assert(sizeof(T) % sizeof(Word) == 0 && alignof(T) >= alignof(Word) && 32 * sizeof(T) % sizeof(uint4) == 0);
  if (aligned && first == 0 && last == 32) {
    auto* to = reinterpret_cast<uint4*>(reinterpret_cast<std::uintptr_t>(out) + at * sizeof(T));
    const auto* from = reinterpret_cast<const uint4*>(staged);
    for (unsigned i = lane_index(); i < 32 * sizeof(T) / sizeof(uint4); i += 32) __stcs(to + i, from[i]);
  } else {
    constexpr unsigned words = sizeof(T) / sizeof(Word);
    auto* to = reinterpret_cast<Word*>(out);
    const auto* from = reinterpret_cast<const Word*>(staged);
    for (unsigned i = first * words + lane_index(); i < last * words; i += 32) __stcs(to + (at * words + i), from[i]);
  }
}

/// Asks for what will be read soon.
__device__ inline void prefetch([[maybe_unused]] const void* address) {
#if defined(__CUDA_ARCH__)
  asm volatile("prefetch.global.L2 [%0];" ::"l"(address));
#endif
}

/// The shared memory that a block may have on any device without asking for more.
inline constexpr std::size_t most_shared_bytes = 48 << 10;

/// The blocks to give a kernel whose warps take tiles by the stride of the grid: enough for all tiles, but at most
/// `waves` times as many as run at the same time.
template <class... Parameters>
[[nodiscard]] cudaError_t tile_blocks(void (*kernel)(Parameters...), std::uint64_t tiles, std::size_t shared_bytes,
                                      unsigned waves, Launch launch, std::uint64_t& blocks) {
  PGL_CUDA_TRY(resident_blocks(kernel, shared_bytes, launch, blocks));
  blocks = std::min(waves * blocks, blocks_for(tiles, launch.block_threads / 32));
  return cudaSuccess;
}

}  // namespace pgl::cuda::detail
