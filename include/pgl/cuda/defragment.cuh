// SPDX-License-Identifier: MIT
// Makes the block of a new selection from the block of the last one and what is new, on the GPU: in another buffer or
// in place.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>
#include <cuda/atomic>
#include <numeric>
#include <span>
#include <type_traits>

#include "pgl/config.hpp"
#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/tiles.cuh"
#include "pgl/defragment.hpp"
#include "pgl/pack_delta.hpp"

namespace pgl::cuda {

/// Scratch memory of defragment_in_place, besides registers and shared memory: at most 5 % of the bytes of the largest
/// block so far, plus 2 KiB; 0.5 % with blocks of 256 threads and elements of 4 to 64 bytes. Reuse it from frame to
/// frame: it only grows. For one stream at a time.
struct DefragmentWorkspace {
  Buffer memory;
};

namespace defragment_detail {

/// How elements are copied: a lane of a warp takes 4 bytes at a time, a row of 128 bytes with its neighbours, and reads
/// them as the largest words that elements are aligned to.
template <class T>
struct Copied {
  using Word = std::conditional_t<alignof(T) % 4 == 0, std::uint32_t,
                                  std::conditional_t<alignof(T) % 2 == 0, std::uint16_t, std::uint8_t>>;
  static constexpr unsigned words = sizeof(T) / sizeof(Word);  ///< of an element
  static constexpr unsigned lane_words = 4 / sizeof(Word);     ///< of a row, for each lane
  static constexpr unsigned row_words = 32 * lane_words;

  /// As many elements as `bytes` hold, at least one and at most `most`; where that can be, such that they fill rows.
  static constexpr unsigned fitting(unsigned bytes, unsigned most) {
    const unsigned full = 128 / std::gcd(128u, static_cast<unsigned>(sizeof(T)));  // elements that fill rows
    unsigned elements = bytes / sizeof(T) < most ? bytes / sizeof(T) : most;
    if (elements >= full) elements -= elements % full;
    return elements == 0 ? 1 : elements;
  }
};

/// What a warp knows of the runs of elements in its tile that have one source each: where each begins, as a bit of
/// heads, and where word 0 of the tile would come from, or go to, if it were of this run.
template <unsigned positions, unsigned runs>
struct Area {
  static constexpr unsigned rows = (positions + 31) / 32;
  static_assert(rows <= 32);
  std::uint64_t run[runs];
  std::uint32_t until[runs];  ///< the position in the tile where the run ends; what follows up to the next is no run
  unsigned heads[rows];
  unsigned before[rows];  ///< heads in earlier words

  /// To be called by the whole warp when each lane has entered its runs; then all of them may be asked for.
  __device__ void complete() {
    __syncwarp();
    const unsigned lane = detail::lane_index();
    const auto own = static_cast<unsigned>(lane < rows ? __popc(heads[lane]) : 0);
    unsigned sum = own;
    for (unsigned step = 1; step < 32; step *= 2) {
      const unsigned other = __shfl_up_sync(detail::whole_warp, sum, step);
      if (lane >= step) sum += other;
    }
    if (lane < rows) before[lane] = sum - own;
    __syncwarp();
  }

  /// The run that a position is in.
  __device__ unsigned run_of(unsigned position) const {
    const unsigned up_to = detail::whole_warp >> (31 - position % 32);
    return before[position / 32] + static_cast<unsigned>(__popc(heads[position / 32] & up_to)) - 1;
  }
};

/// Writes those of the words of a lane that `which` has bits for, as one where it has all. They lie in `words` as in
/// memory.
template <class T>
__device__ void write_words(typename Copied<T>::Word* to, std::uint32_t words, unsigned which, bool aligned) {
  using Word = typename Copied<T>::Word;
  constexpr unsigned lane_words = Copied<T>::lane_words;
  if constexpr (lane_words == 1) {
    if (which != 0) *to = words;
  } else {
    if (aligned && which == (1u << lane_words) - 1) {
      *reinterpret_cast<std::uint32_t*>(to) = words;
    } else {
#pragma unroll
      for (unsigned s = 0; s < lane_words; ++s) {
        if ((which >> s & 1) != 0) to[s] = static_cast<Word>(words >> (32 / lane_words * s));
      }
    }
  }
}

template <class T>
inline constexpr unsigned copy_tile = Copied<T>::fitting(6144, 1024);  ///< elements that a warp takes at a time
/// Reads of a lane that are on their way at a time, of whole words and of parts of them.
inline constexpr unsigned copy_reads = 24, copy_part_reads = 16;
inline constexpr unsigned copy_waves = 4;  ///< blocks started, in terms of those that run at the same time

template <class T>
using CopyArea = Area<copy_tile<T>, 64>;

template <class T>
__global__ void __launch_bounds__(1024)
    copy_kernel(const std::uint64_t* previous_offsets, const std::uint64_t* offsets, const std::uint64_t* delta_offsets,
                std::uint64_t n, const T* existing, [[maybe_unused]] std::uint64_t existing_size, const T* additional,
                [[maybe_unused]] std::uint64_t additional_size, T* out, [[maybe_unused]] std::uint64_t out_size) {
  using C = Copied<T>;
  using Word = typename C::Word;
  constexpr unsigned tile = copy_tile<T>;
  constexpr unsigned batch = C::lane_words == 1 ? copy_reads : copy_part_reads / C::lane_words;  // rows
  extern __shared__ uint4 pgl_shared_memory[];
  const unsigned lane = detail::lane_index();
  CopyArea<T>& area = reinterpret_cast<CopyArea<T>*>(pgl_shared_memory)[threadIdx.x / 32];

  const std::uint64_t total = offsets[n];
  PGL_ASSERT(total <= out_size && previous_offsets[n] <= existing_size && delta_offsets[n] <= additional_size);
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t j = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32; j * tile < total;
       j += stride) {
    const std::uint64_t origin = j * tile;
    const std::uint64_t end = origin + tile < total ? origin + tile : total;
    Word* const to = reinterpret_cast<Word*>(out) + origin * C::words;
    const bool aligned = reinterpret_cast<std::uintptr_t>(to) % 4 == 0;
    detail::for_each_group<CopyArea<T>::rows>(
        offsets, n, detail::object_at(offsets, 0, n, origin), origin, origin, end, area.heads,
        [&](const detail::TilePart& object, unsigned first, unsigned last) {
          KeptPart stays, comes;
          if (object.size != 0) {
            const KeptPart kept = kept_part(previous_offsets, offsets, object.object);
            const std::uint64_t fresh = delta_part(previous_offsets, offsets, object.object).size;
            PGL_ASSERT(delta_offsets[object.object + 1] - delta_offsets[object.object] == fresh);
            stays = part_within(kept, origin, end);
            comes = part_within({delta_offsets[object.object], kept.to + kept.size, fresh}, origin, end);
          }
          // An object's elements have one source or two. Its head stands already.
          const bool both = stays.size != 0 && comes.size != 0;
          const unsigned lower_lanes = (1u << lane) - 1;
          unsigned slot =
              object.slot + static_cast<unsigned>(__popc(__ballot_sync(detail::whole_warp, both) & lower_lanes));
          if (both) {
            const auto head = static_cast<unsigned>(comes.to - origin);
            atomicOr(&area.heads[head / 32], 1u << (head % 32));
          }
          const auto note = [&](const T* source, const KeptPart& part) {
            if (part.size == 0) return;
            area.run[slot++] = reinterpret_cast<std::uintptr_t>(source) + (part.from - (part.to - origin)) * sizeof(T);
          };
          note(existing, stays);
          note(additional, comes);
          area.complete();

          const unsigned begin_word = first * C::words, end_word = last * C::words;
          const unsigned end_row = (end_word + C::row_words - 1) / C::row_words;
          for (unsigned row = begin_word / C::row_words; row < end_row; row += batch) {
            std::uint32_t words[batch];
            const unsigned at = row * C::row_words + lane * C::lane_words;
#pragma unroll
            for (unsigned r = 0; r < batch; ++r) {
              words[r] = 0;
#pragma unroll
              for (unsigned s = 0; s < C::lane_words; ++s) {
                // Without a branch, so that the next read need not wait: what is not of the group is not written.
                const unsigned asked = at + r * C::row_words + s;
                const unsigned from_begin = asked > begin_word ? asked : begin_word;
                const unsigned word = from_begin < end_word ? from_begin : end_word - 1;
                const std::uint64_t source = area.run[area.run_of(word / C::words)];
                words[r] |= std::uint32_t{__ldg(reinterpret_cast<const Word*>(source) + word)}
                            << (32 / C::lane_words * s);
              }
            }
#pragma unroll
            for (unsigned r = 0; r < batch; ++r) {
              unsigned which = 0;
#pragma unroll
              for (unsigned s = 0; s < C::lane_words; ++s) {
                const unsigned word = at + r * C::row_words + s;
                if (word >= begin_word && word < end_word) which |= 1u << s;
              }
              write_words<T>(to + (at + r * C::row_words), words[r], which, aligned);
            }
          }
        });
  }
}

// ---- in place ------------------------------------------------------------------------------------------------------
//
// As pgl/defragment.hpp lays down, with a block of threads for a worker and its shared memory for its memory: each warp
// takes its share of the tile. A block takes a pair of tickets at a time, the leftward move of tile k and then the
// rightward move of the k-th tile from the end. So tickets are not taken in order, but those of each direction are, and
// a ticket waits for lower ones of its own direction only: these are taken when it is. It ends: number the moves in the
// order left of pair 0, right of pair 0, left of pair 1, ...; of all that are taken and not yet read, consider the
// first. Its block is either at it, and reading waits for nothing, or still at an earlier move, which can only wait for
// even earlier ones, all of which are read.
//
// Which tiles have anything to move is found out before, so that all others cost next to nothing, and also the first
// object of each share, so that nothing has to be searched for: by a thread for each object. Landings are taken to
// reach to where the next one begins. So a ticket may wait for a few more than it has to, but for no others than lower
// ones of its own direction.

inline constexpr unsigned move_bytes = 4608;  ///< that a warp moves at a time, unless an element is larger
inline constexpr unsigned move_reads = 12;    ///< reads of a lane that are on their way at a time

/// The most elements that a warp takes; fewer where the block has so many warps that shared memory does not hold them.
template <class T>
inline constexpr unsigned move_share = Copied<T>::fitting(move_bytes, 1024);

/// The rows that so many elements fill.
template <class T>
PGL_HD constexpr unsigned rows_of(unsigned elements) {
  return (elements * Copied<T>::words + Copied<T>::row_words - 1) / Copied<T>::row_words;
}

template <class T>
using MoveArea = Area<move_share<T>, 32>;

/// The shared memory of a warp, before the rows of its share.
template <class T>
inline constexpr unsigned move_area_bytes = (sizeof(MoveArea<T>) + 15) / 16 * 16;

/// How the work is shared out.
struct MoveTiles {
  unsigned warps;          ///< of a block
  unsigned share;          ///< elements that a warp takes
  std::size_t warp_bytes;  ///< of shared memory

  PGL_HD constexpr std::uint64_t size() const { return std::uint64_t{share} * warps; }  ///< of a tile
};

/// For blocks of `warps` warps, or of fewer where shared memory does not hold an element for each.
template <class T>
constexpr MoveTiles move_tiles(unsigned warps) {
  constexpr unsigned area = move_area_bytes<T>, most = detail::most_shared_bytes - 16;  // the kernel has 16 of its own
  const unsigned fit = most / (area + 128 * rows_of<T>(1));
  if (warps > fit) warps = fit;
  const unsigned room = (most / warps - area) / 128 * 128;
  const unsigned share = Copied<T>::fitting(room < move_bytes ? room : move_bytes, 1024);
  return {warps, share, area + 128 * std::size_t{rows_of<T>(share)}};
}

inline constexpr std::uint32_t unread = 1;

/// The parts of the workspace: what is known before anything moves, and how far the moves are.
struct Plan {
  std::uint64_t* objects;   ///< for each share: the object of its first element
  std::uint64_t* landings;  ///< for each tile, and for the end: nothing from there on of the old block goes below it
  std::uint32_t* reads;     ///< for each ticket: unread, or 0
  unsigned* next_pair;      ///< 2^32 tiles are more than a device holds
};

/// Sets to[j] to value(j, object) for all j of each lane's range, whose object is `object`, a whole warp together.
template <class To, class Value>
__device__ void note(To* to, std::uint64_t first, std::uint64_t last, std::uint64_t object, Value&& value) {
  if (first < last) to[first] = value(first, object);
  for (unsigned many = __ballot_sync(detail::whole_warp, first + 1 < last); many != 0; many &= many - 1) {
    const int lane = __ffs(static_cast<int>(many)) - 1;
    const std::uint64_t end = __shfl_sync(detail::whole_warp, last, lane);
    const std::uint64_t whose = __shfl_sync(detail::whole_warp, object, lane);
    for (std::uint64_t j = __shfl_sync(detail::whole_warp, first, lane) + 1 + detail::lane_index(); j < end; j += 32) {
      to[j] = value(j, whose);
    }
  }
}

/// A thread for each object, and one for the end. Expects 0 for all tickets.
template <class = void>
__global__ void __launch_bounds__(1024)
    plan_kernel(const std::uint64_t* previous_offsets, const std::uint64_t* offsets, std::uint64_t n, MoveTiles shape,
                [[maybe_unused]] std::uint64_t block_size, Plan plan) {
  const std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  const std::uint64_t total = offsets[n], tile_size = shape.size();
  const std::uint64_t tiles = tile_count(total, tile_size);
  PGL_ASSERT(total <= block_size && previous_offsets[n] <= block_size);
  if (i == 0) *plan.next_pair = 0;

  // Ranges of shares, of boundaries between tiles, and of tickets: none where the object has nothing to do with any.
  std::uint64_t first_share = 0, last_share = 0, first_landing = 0, last_landing = 0, first_ticket = 0, last_ticket = 0;
  if (i < n) {
    first_share = tile_count(offsets[i], shape.share);
    last_share = tile_count(offsets[i + 1], shape.share);
    first_landing = tile_count(previous_offsets[i], tile_size);
    last_landing = tile_count(previous_offsets[i + 1], tile_size);
    const KeptPart part = kept_part(previous_offsets, offsets, i);
    const bool left = moves(part, Shift::left);
    if (left || moves(part, Shift::right)) {
      const std::uint64_t first = part.to / tile_size, last = (part.to + part.size - 1) / tile_size;
      first_ticket = left ? first : 2 * tiles - 1 - last;
      last_ticket = first_ticket + (last - first + 1);
    }
  } else if (i == n) {
    first_landing = tile_count(previous_offsets[n], tile_size);
    last_landing = tiles + 1;
  }
  if (last_landing > tiles + 1) last_landing = tiles + 1;

  note(plan.objects, first_share, last_share, i, [](std::uint64_t, std::uint64_t object) { return object; });
  note(plan.reads, first_ticket, last_ticket, i, [](std::uint64_t, std::uint64_t) { return unread; });
  note(plan.landings, first_landing, last_landing, i, [&](std::uint64_t j, std::uint64_t object) {
    if (object == n) return total;
    return landing_between(previous_offsets, offsets, object, object, j * tile_size, j * tile_size + 1).first;
  });
}

template <class T>
__global__ void __launch_bounds__(1024) move_kernel(const std::uint64_t* previous_offsets, const std::uint64_t* offsets,
                                                    std::uint64_t n, T* block, MoveTiles shape, Plan plan) {
  using C = Copied<T>;
  using Word = typename C::Word;
  using Flag = ::cuda::atomic_ref<std::uint32_t, ::cuda::thread_scope_device>;
  constexpr unsigned batch = move_reads / C::lane_words;  // rows
  static_assert(batch >= 1 && batch <= 32 && rows_of<T>(move_share<T>) <= 64);
  extern __shared__ uint4 pgl_shared_memory[];
  __shared__ unsigned taken;
  const unsigned lane = detail::lane_index(), warp = threadIdx.x / 32;
  uint4* const own_memory = pgl_shared_memory + warp * (shape.warp_bytes / sizeof(uint4));
  MoveArea<T>& area = *reinterpret_cast<MoveArea<T>*>(own_memory);
  std::uint32_t* const staged =  // the lane's word of row 0
      reinterpret_cast<std::uint32_t*>(own_memory + move_area_bytes<T> / sizeof(uint4)) + lane;
  Word* const block_words = reinterpret_cast<Word*>(block);

  const std::uint64_t total = offsets[n], tile_size = shape.size();
  const std::uint64_t tiles = tile_count(total, tile_size);
  unsigned upcoming = threadIdx.x == 0 ? atomicAdd(plan.next_pair, 1u) : 0;
  for (;;) {
    if (threadIdx.x == 0) taken = upcoming;
    __syncthreads();
    const unsigned pair = taken;
    if (pair >= tiles) return;
    if (threadIdx.x == 0) upcoming = atomicAdd(plan.next_pair, 1u);  // arrives while the block is at this one

    // Only this block changes these from now on, each not before all its threads have passed the first barrier below.
    const unsigned any = (plan.reads[pair] == unread ? 1u : 0u) | (plan.reads[pair + tiles] == unread ? 2u : 0u);
#pragma unroll 1
    for (unsigned turn = 0; turn < 2; ++turn) {
      if ((any >> turn & 1) == 0) continue;
      const std::uint64_t ticket = pair + turn * tiles;
      const TileMove move = tile_move(ticket, tiles);
      const std::uint64_t part_of_block = move.tile * shape.warps + warp;
      const std::uint64_t origin = part_of_block * shape.share;
      const std::uint64_t end = origin + shape.share < total ? origin + shape.share : total;
      const unsigned rows = origin < end ? rows_of<T>(static_cast<unsigned>(end - origin)) : 0;

      // 1. Reads all elements of the move.
      std::uint64_t which[C::lane_words] = {};  // a bit for each row: whether the lane's s-th word of it moves
      if (rows != 0) {
        detail::for_each_group<MoveArea<T>::rows>(
            offsets, n, plan.objects[part_of_block], origin, origin, end, area.heads,
            [&](const detail::TilePart& object, unsigned first, unsigned last) {
              if (object.size != 0) {
                const KeptPart part = part_within(kept_part(previous_offsets, offsets, object.object), origin, end);
                const bool here = moves(part, move.shift);
                area.run[object.slot] = (part.from - (part.to - origin)) * C::words;
                area.until[object.slot] =
                    here ? static_cast<std::uint32_t>(part.to + part.size - origin) * C::words : 0u;
              }
              area.complete();

              const unsigned begin_word = first * C::words, end_word = last * C::words;
              const unsigned end_row = (end_word + C::row_words - 1) / C::row_words;
#pragma unroll 1
              for (unsigned row = begin_word / C::row_words; row < end_row; row += batch) {
                Word words[batch][C::lane_words];
                unsigned here[C::lane_words] = {};
#pragma unroll
                for (unsigned r = 0; r < batch; ++r) {
#pragma unroll
                  for (unsigned s = 0; s < C::lane_words; ++s) {
                    // Nothing but the read depends on a condition, so that the next one need not wait for it.
                    const unsigned word = (row + r) * C::row_words + lane * C::lane_words + s;
                    const unsigned from_begin = word > begin_word ? word : begin_word;
                    const unsigned known = from_begin < end_word ? from_begin : end_word - 1;
                    const unsigned run = area.run_of(known / C::words);
                    const bool comes = word == known && word < area.until[run];
                    const Word* const from = block_words + (area.run[run] + word);
                    words[r][s] = 0;
                    if (comes) words[r][s] = *from;
                    here[s] |= (comes ? 1u : 0u) << r;
                  }
                }
#pragma unroll
                for (unsigned r = 0; r < batch; ++r) {
                  std::uint32_t together = 0;
                  unsigned own = 0;
#pragma unroll
                  for (unsigned s = 0; s < C::lane_words; ++s) {
                    together |= std::uint32_t{words[r][s]} << (32 / C::lane_words * s);
                    own |= (here[s] >> r & 1) << s;
                  }
                  write_words<T>(reinterpret_cast<Word*>(staged + (row + r) * 32), together, own, true);
                }
#pragma unroll
                for (unsigned s = 0; s < C::lane_words; ++s) which[s] |= std::uint64_t{here[s]} << row;
              }
            });
      }

      // 2. Says so.
      const Landing landing{plan.landings[move.tile], plan.landings[move.tile + 1]};
      __syncthreads();
      if (threadIdx.x == 0) Flag(plan.reads[ticket]).store(0, ::cuda::std::memory_order_release);

      // 3. Waits until nobody has yet to read where it is about to write.
      const TicketRange before = tickets_that_land(landing, tile_size, tiles, ticket);
      for (std::uint64_t other = before.first + threadIdx.x; other < before.last; other += blockDim.x) {
        while (Flag(plan.reads[other]).load(::cuda::std::memory_order_acquire) == unread) __nanosleep(32);
      }
      __syncthreads();

      // 4. Writes.
      Word* const to = block_words + (origin * C::words + lane * C::lane_words);
      const bool aligned = reinterpret_cast<std::uintptr_t>(to) % 4 == 0;
#pragma unroll 4
      for (unsigned row = 0; row < rows; ++row) {
        unsigned own = 0;
#pragma unroll
        for (unsigned s = 0; s < C::lane_words; ++s) own |= static_cast<unsigned>(which[s] >> row & 1) << s;
        write_words<T>(to + row * C::row_words, staged[row * 32], own, aligned);
      }
    }
    __syncthreads();  // `taken` has been read by all
  }
}

inline constexpr unsigned insert_tile = 64;  ///< elements that a warp takes at a time

using InsertArea = Area<insert_tile, 32>;

template <class T>
__global__ void __launch_bounds__(1024)
    insert_kernel(const std::uint64_t* previous_offsets, const std::uint64_t* offsets,
                  const std::uint64_t* delta_offsets, std::uint64_t n, const T* additional,
                  [[maybe_unused]] std::uint64_t additional_size, T* block) {
  using C = Copied<T>;
  using Word = typename C::Word;
  extern __shared__ uint4 pgl_shared_memory[];
  InsertArea& area = reinterpret_cast<InsertArea*>(pgl_shared_memory)[threadIdx.x / 32];
  Word* const block_words = reinterpret_cast<Word*>(block);

  const std::uint64_t total = delta_offsets[n];
  PGL_ASSERT(total <= additional_size);
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t j = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32; j * insert_tile < total;
       j += stride) {
    const std::uint64_t origin = j * insert_tile;
    const std::uint64_t end = origin + insert_tile < total ? origin + insert_tile : total;
    const Word* const from = reinterpret_cast<const Word*>(additional) + origin * C::words;
    detail::for_each_group<InsertArea::rows>(
        delta_offsets, n, detail::object_at(delta_offsets, 0, n, origin), origin, origin, end, area.heads,
        [&](const detail::TilePart& object, unsigned first, unsigned last) {
          if (object.size != 0) {
            const DeltaPart part = delta_part(previous_offsets, offsets, object.object);
            PGL_ASSERT(delta_offsets[object.object + 1] - delta_offsets[object.object] == part.size);
            area.run[object.slot] = (offsets[object.object] + part.first + (origin - object.begin)) * C::words;
          }
          area.complete();
          for (unsigned word = first * C::words + detail::lane_index(); word < last * C::words; word += 32) {
            block_words[area.run[area.run_of(word / C::words)] + word] = __ldg(from + word);
          }
        });
  }
}

}  // namespace defragment_detail

/// Makes the block of a new selection, as pgl::host::defragment does; arguments, preconditions and bytes as there.
///
/// All views are of device memory, aligned to their elements, best to 128 bytes. The totals are read on the device: the
/// grid depends on out.size() alone. Fastest where elements are aligned to 4 bytes.
/// O(n + total), one kernel, no scratch. Enqueued on launch.stream, capturable; the same for any launch and GPU.
template <class T>
[[nodiscard]] cudaError_t defragment(std::span<const std::uint64_t> previous_offsets,
                                     std::span<const std::uint64_t> offsets,
                                     std::span<const std::uint64_t> delta_offsets, std::span<const T> existing,
                                     std::span<const T> additional, std::span<T> out, Launch launch = {}) {
  static_assert(std::is_trivially_copyable_v<T> && sizeof(T) <= 2048);
  PGL_ASSERT(!offsets.empty() && previous_offsets.size() == offsets.size() && delta_offsets.size() == offsets.size());
  const std::uint64_t n = offsets.size() - 1;
  if (n == 0 || out.empty()) return cudaSuccess;
  const auto kernel = defragment_detail::copy_kernel<T>;
  const std::uint64_t tiles = tile_count(out.size(), defragment_detail::copy_tile<T>);
  const std::size_t shared_bytes = launch.block_threads / 32 * sizeof(defragment_detail::CopyArea<T>);
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(detail::tile_blocks(kernel, tiles, shared_bytes, defragment_detail::copy_waves, launch, blocks));
  return detail::run(kernel, blocks, shared_bytes, launch, previous_offsets.data(), offsets.data(),
                     delta_offsets.data(), n, existing.data(), existing.size(), additional.data(), additional.size(),
                     out.data(), out.size());
}

/// Does what defragment does within one buffer, as pgl::host::defragment_in_place does; arguments, preconditions and
/// bytes as there.
///
/// All views are of device memory, aligned to their elements, block best to 128 bytes. The totals are read on the
/// device: the grids depend on block.size() and additional.size() alone.
///
/// What stays where it is is neither read nor written; what moves is read once and written once, by tiles of up to
/// 4.5 KiB for each warp of a block of threads, by ticket and in the order of pgl/defragment.hpp. O(n + elements that
/// move or are new), a memset and three kernels; nothing is allocated once the workspace has been used for as large a
/// block and with as large blocks of threads. Enqueued on launch.stream, capturable; the same bytes for any launch and
/// GPU.
template <class T>
[[nodiscard]] cudaError_t defragment_in_place(std::span<const std::uint64_t> previous_offsets,
                                              std::span<const std::uint64_t> offsets,
                                              std::span<const std::uint64_t> delta_offsets,
                                              std::span<const T> additional, DefragmentWorkspace& workspace,
                                              std::span<T> block, Launch launch = {}) {
  static_assert(std::is_trivially_copyable_v<T> && sizeof(T) <= 2048);
  PGL_ASSERT(!offsets.empty() && previous_offsets.size() == offsets.size() && delta_offsets.size() == offsets.size());
  const std::uint64_t n = offsets.size() - 1;
  if (n == 0 || block.empty()) return cudaSuccess;
  const defragment_detail::MoveTiles shape = defragment_detail::move_tiles<T>(launch.block_threads / 32);
  const std::uint64_t tiles = tile_count(block.size(), shape.size());

  const auto lay_out_scratch = [&](detail::Parts& parts) {
    return defragment_detail::Plan{parts.take<std::uint64_t>(tiles * shape.warps), parts.take<std::uint64_t>(tiles + 1),
                                   parts.take<std::uint32_t>(2 * tiles), parts.take<unsigned>(1)};
  };
  detail::Parts sizes;
  lay_out_scratch(sizes);
  PGL_CUDA_TRY(workspace.memory.reserve(sizes.size()));
  detail::Parts parts(workspace.memory.at<void>());
  const defragment_detail::Plan plan = lay_out_scratch(parts);

  PGL_CUDA_TRY(cudaMemsetAsync(plan.reads, 0, 2 * tiles * sizeof(*plan.reads), launch.stream));
  PGL_CUDA_TRY(detail::run(defragment_detail::plan_kernel<>, detail::blocks_for(n + 1, launch.block_threads), 0, launch,
                           previous_offsets.data(), offsets.data(), n, shape, block.size(), plan));

  const auto move_kernel = defragment_detail::move_kernel<T>;
  const Launch by_tile(launch.stream, 32 * shape.warps);
  std::size_t shared_bytes = shape.warps * shape.warp_bytes;
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(detail::resident_blocks(move_kernel, shared_bytes, by_tile, blocks));
  PGL_CUDA_TRY(detail::run(move_kernel, blocks < tiles ? blocks : tiles, shared_bytes, by_tile, previous_offsets.data(),
                           offsets.data(), n, block.data(), shape, plan));

  if (additional.empty()) return cudaSuccess;
  const auto insert_kernel = defragment_detail::insert_kernel<T>;
  shared_bytes = launch.block_threads / 32 * sizeof(defragment_detail::InsertArea);
  PGL_CUDA_TRY(detail::tile_blocks(insert_kernel, tile_count(additional.size(), defragment_detail::insert_tile),
                                   shared_bytes, 4, launch, blocks));
  return detail::run(insert_kernel, blocks, shared_bytes, launch, previous_offsets.data(), offsets.data(),
                     delta_offsets.data(), n, additional.data(), additional.size(), block.data());
}

}  // namespace pgl::cuda
