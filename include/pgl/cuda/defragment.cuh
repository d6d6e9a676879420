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
inline constexpr unsigned copy_batch = 8;                              ///< rows that are on their way at a time
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
          for (unsigned row = begin_word / C::row_words; row < end_row; row += copy_batch) {
            std::uint32_t words[copy_batch];
            const unsigned at = row * C::row_words + lane * C::lane_words;
#pragma unroll
            for (unsigned r = 0; r < copy_batch; ++r) {
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
            for (unsigned r = 0; r < copy_batch; ++r) {
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
// As pgl/defragment.hpp lays down, with a block of threads for a worker and its registers for its memory: each warp
// takes its share of the tile. A block takes a pair of tickets at a time, the leftward move of tile k and then the
// rightward move of the k-th tile from the end. So tickets are not taken in order, but those of each direction are, and
// a ticket waits for lower ones of its own direction only: these are taken when it is. It ends: number the moves in the
// order left of pair 0, right of pair 0, left of pair 1, ...; of all that are taken and not yet read, consider the
// first. Its block is either at it, and reading waits for nothing, or still at an earlier move, which can only wait for
// even earlier ones, all of which are read.
//
// Which tiles have anything to move is found out before, so that all others cost next to nothing.

inline constexpr unsigned move_rows = 16;  ///< rows that a warp holds at a time, unless an element is larger

template <class T>
inline constexpr unsigned move_share = Copied<T>::fitting(move_rows * 128, 1024);  ///< elements that a warp takes

template <class T>
using MoveArea = Area<move_share<T>, 32>;

/// What is known of a tile before anything moves.
struct Tile {
  std::uint64_t object;  ///< that its first element belongs to
  Landing landing;       ///< where what stays of the old block goes that is where the tile is in the new one
};

inline constexpr std::uint32_t is_read = 1;

/// The parts of the workspace. There is room for `tiles` tiles, and two flags for each.
struct Plan {
  Tile* tiles;
  std::uint32_t* reads;  ///< for each ticket: is_read, or 0
  unsigned long long* next_pair;
};

template <class = void>
__global__ void __launch_bounds__(1024)
    plan_kernel(const std::uint64_t* previous_offsets, const std::uint64_t* offsets, std::uint64_t n,
                std::uint64_t tile_size, [[maybe_unused]] std::uint64_t block_size, Plan plan) {
  const unsigned lane = detail::lane_index();
  const std::uint64_t total = offsets[n], previous_total = previous_offsets[n];
  PGL_ASSERT(total <= block_size && previous_total <= block_size);
  if (blockIdx.x == 0 && threadIdx.x == 0) *plan.next_pair = 0;

  const std::uint64_t tiles = tile_count(total, tile_size);
  const std::uint64_t stride = std::uint64_t{gridDim.x} * (blockDim.x / 32);
  for (std::uint64_t j = std::uint64_t{blockIdx.x} * (blockDim.x / 32) + threadIdx.x / 32; j < tiles; j += stride) {
    const std::uint64_t begin = j * tile_size;
    const std::uint64_t end = begin + (total - begin < tile_size ? total - begin : tile_size);
    const std::uint64_t object = detail::object_at(offsets, 0, n, begin);

    // Each lane looks at an object, until the tile is done or has both moves.
    bool left = false, right = false;
    std::uint64_t done = begin, first = object;
    while (done < end && !(left && right)) {
      const std::uint64_t i = first + lane;
      const std::uint64_t stop = i < n ? offsets[i + 1] : end;
      const std::uint64_t reached = __shfl_sync(detail::whole_warp, stop < end ? stop : end, 31);
      KeptPart part;
      if (i < n && offsets[i] < end) part = part_within(kept_part(previous_offsets, offsets, i), begin, end);
      left = left || __any_sync(detail::whole_warp, moves(part, Shift::left));
      right = right || __any_sync(detail::whole_warp, moves(part, Shift::right));
      // Where all 32 were empty, many more may be.
      first = reached > done ? first + 32 : detail::object_at(offsets, first, n, done);
      done = reached > done ? reached : done;
    }

    Landing landing{total, total};
    if (begin < previous_total) {
      const std::uint64_t last = end < previous_total ? end : previous_total;
      const std::uint64_t first_object = detail::object_at(previous_offsets, 0, n, begin);
      const std::uint64_t last_object = detail::object_at(previous_offsets, first_object, n, last - 1);
      landing = landing_between(previous_offsets, offsets, first_object, last_object, begin, last);
    }
    if (lane == 0) {
      plan.tiles[j] = {object, landing};
      plan.reads[j] = left ? 0 : is_read;
      plan.reads[2 * tiles - 1 - j] = right ? 0 : is_read;
    }
  }
}

template <class T>
__global__ void __launch_bounds__(1024) move_kernel(const std::uint64_t* previous_offsets, const std::uint64_t* offsets,
                                                    std::uint64_t n, T* block, Plan plan) {
  using C = Copied<T>;
  using Word = typename C::Word;
  using Flag = ::cuda::atomic_ref<std::uint32_t, ::cuda::thread_scope_device>;
  constexpr unsigned share = move_share<T>;
  constexpr unsigned rows = (share * C::words + C::row_words - 1) / C::row_words;
  extern __shared__ uint4 pgl_shared_memory[];
  __shared__ std::uint64_t taken;
  const unsigned lane = detail::lane_index(), warp = threadIdx.x / 32;
  MoveArea<T>& area = reinterpret_cast<MoveArea<T>*>(pgl_shared_memory)[warp];
  Word* const block_words = reinterpret_cast<Word*>(block);

  const std::uint64_t total = offsets[n];
  const std::uint64_t tile_size = std::uint64_t{share} * (blockDim.x / 32);
  const std::uint64_t tiles = tile_count(total, tile_size);
  std::uint64_t upcoming = threadIdx.x == 0 ? atomicAdd(plan.next_pair, 1ull) : 0;
  for (;;) {
    if (threadIdx.x == 0) taken = upcoming;
    __syncthreads();
    const std::uint64_t pair = taken;
    if (pair >= tiles) return;
    if (threadIdx.x == 0) upcoming = atomicAdd(plan.next_pair, 1ull);  // arrives while the block is at this one

#pragma unroll 1
    for (std::uint64_t ticket = pair; ticket < 2 * tiles; ticket += tiles) {
      // Only this block changes this flag from now on, and not before all its threads have passed the barrier below.
      if (plan.reads[ticket] == is_read) continue;
      const TileMove move = tile_move(ticket, tiles);
      const Tile tile = plan.tiles[move.tile];
      const std::uint64_t origin = move.tile * tile_size + warp * share;
      const std::uint64_t end = origin + share < total ? origin + share : total;
      Word* const to = block_words + origin * C::words;
      const bool aligned = reinterpret_cast<std::uintptr_t>(to) % 4 == 0;

      // 1. Reads all elements of the move.
      std::uint32_t words[rows];
#pragma unroll
      for (std::uint32_t& row : words) row = 0;
      std::uint64_t which = 0;  // which of them are of the move
      static_assert(rows * C::lane_words <= 64);
      if (origin < end) {
        const std::uint64_t last_object = move.tile + 1 < tiles ? plan.tiles[move.tile + 1].object + 1 : n;
        detail::for_each_group<MoveArea<T>::rows>(
            offsets, n, detail::object_at(offsets, tile.object, last_object, origin), origin, origin, end, area.heads,
            [&](const detail::TilePart& object, unsigned first, unsigned last) {
              if (object.size != 0) {
                const KeptPart part = part_within(kept_part(previous_offsets, offsets, object.object), origin, end);
                const bool here = moves(part, move.shift);
                area.run[object.slot] = (part.from - (part.to - origin)) * C::words;
                area.until[object.slot] = here ? static_cast<std::uint32_t>(part.to + part.size - origin) : 0u;
              }
              area.complete();
#pragma unroll
              for (unsigned r = 0; r < rows; ++r) {
#pragma unroll
                for (unsigned s = 0; s < C::lane_words; ++s) {
                  const unsigned word = r * C::row_words + lane * C::lane_words + s;
                  const unsigned position = word / C::words;
                  if (position < first || position >= last) continue;
                  const unsigned run = area.run_of(position);
                  if (position >= area.until[run]) continue;
                  words[r] |= std::uint32_t{block_words[area.run[run] + word]} << (32 / C::lane_words * s);
                  which |= std::uint64_t{1} << (r * C::lane_words + s);
                }
              }
            });
      }

      // 2. Says so.
      __syncthreads();
      if (threadIdx.x == 0) Flag(plan.reads[ticket]).store(is_read, ::cuda::std::memory_order_release);

      // 3. Waits until nobody has yet to read where it is about to write.
      const TicketRange before = tickets_that_land(tile.landing, tile_size, tiles, ticket);
      for (std::uint64_t other = before.first + threadIdx.x; other < before.last; other += blockDim.x) {
        while (Flag(plan.reads[other]).load(::cuda::std::memory_order_acquire) != is_read) __nanosleep(32);
      }
      __syncthreads();

      // 4. Writes.
#pragma unroll
      for (unsigned r = 0; r < rows; ++r) {
        const auto own = static_cast<unsigned>(which >> (r * C::lane_words)) & ((1u << C::lane_words) - 1);
        write_words<T>(to + (r * C::row_words + lane * C::lane_words), words[r], own, aligned);
      }
    }
    __syncthreads();  // `taken` has been read by all
  }
}

inline constexpr unsigned insert_tile = 128;  ///< elements that a warp takes at a time

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
/// What stays where it is is neither read nor written; what moves is read once and written once, by tiles of 2 KiB for
/// each warp of a block of threads, by ticket and in the order of pgl/defragment.hpp. O(n + elements that move or are
/// new), three kernels; nothing is allocated once the workspace has been used for as large a block and with as large
/// blocks of threads. Enqueued on launch.stream, capturable; the same bytes for any launch and GPU.
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
  const unsigned warps = launch.block_threads / 32;
  const std::uint64_t tile_size = std::uint64_t{warps} * defragment_detail::move_share<T>;
  const std::uint64_t tiles = tile_count(block.size(), tile_size);

  const auto lay_out_scratch = [tiles](detail::Parts& parts) {
    return defragment_detail::Plan{parts.take<defragment_detail::Tile>(tiles), parts.take<std::uint32_t>(2 * tiles),
                                   parts.take<unsigned long long>(1)};
  };
  detail::Parts sizes;
  lay_out_scratch(sizes);
  PGL_CUDA_TRY(workspace.memory.reserve(sizes.size()));
  detail::Parts parts(workspace.memory.at<void>());
  const defragment_detail::Plan plan = lay_out_scratch(parts);

  const auto plan_kernel = defragment_detail::plan_kernel<>;
  std::uint64_t blocks = 0;
  PGL_CUDA_TRY(detail::tile_blocks(plan_kernel, tiles, 0, 1, launch, blocks));
  PGL_CUDA_TRY(detail::run(plan_kernel, blocks, 0, launch, previous_offsets.data(), offsets.data(), n, tile_size,
                           block.size(), plan));

  const auto move_kernel = defragment_detail::move_kernel<T>;
  std::size_t shared_bytes = warps * sizeof(defragment_detail::MoveArea<T>);
  PGL_CUDA_TRY(detail::resident_blocks(move_kernel, shared_bytes, launch, blocks));
  PGL_CUDA_TRY(detail::run(move_kernel, blocks < tiles ? blocks : tiles, shared_bytes, launch, previous_offsets.data(),
                           offsets.data(), n, block.data(), plan));

  if (additional.empty()) return cudaSuccess;
  const auto insert_kernel = defragment_detail::insert_kernel<T>;
  shared_bytes = warps * sizeof(defragment_detail::InsertArea);
  PGL_CUDA_TRY(detail::tile_blocks(insert_kernel, tile_count(additional.size(), defragment_detail::insert_tile),
                                   shared_bytes, 4, launch, blocks));
  return detail::run(insert_kernel, blocks, shared_bytes, launch, previous_offsets.data(), offsets.data(),
                     delta_offsets.data(), n, additional.data(), additional.size(), block.data());
}

}  // namespace pgl::cuda
