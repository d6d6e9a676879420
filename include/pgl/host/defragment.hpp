// SPDX-License-Identifier: MIT
// Makes the block of a new selection from the block of the last one and what is new, in another buffer or in place.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <thread>
#include <type_traits>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/defragment.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/pack_delta.hpp"

namespace pgl::host {

/// Scratch of defragment_in_place, kept from frame to frame: it only grows, and a warm call allocates nothing. At most
/// 4 % of the bytes of the largest new block so far, and not above 64 KiB (or one element) for each thread, plus 0.1 %.
/// With one thread, or a block below 256 KiB, nothing.
struct DefragmentWorkspace {
  std::vector<std::byte> staging;   ///< a tile for each worker
  std::vector<std::uint8_t> reads;  ///< for each ticket whether its move has been read
};

namespace defragment_detail {

/// How defragment_in_place is shared out. One worker: no tiles, no scratch.
struct TilePlan {
  std::uint64_t tile_size = 0;  ///< elements
  std::size_t workers = 1;
  std::uint64_t scratch_bytes(std::uint64_t total, std::size_t bytes) const {
    return workers == 1 ? 0 : workers * tile_size * bytes + 2 * tile_count(total, tile_size);
  }
};

/// Tiles of at most 64 KiB, which stay in a core's cache, together at most 1/32 of the block; fewer workers where even
/// tiles of 4 KiB would be more, and then the flags are at most 1/1024 of it.
inline TilePlan plan_tiles(std::uint64_t total, std::size_t bytes, std::size_t threads) {
  const std::uint64_t least = std::max<std::uint64_t>(1, 4096 / bytes),
                      most = std::max<std::uint64_t>(1, 65536 / bytes);
  const std::uint64_t workers = std::min<std::uint64_t>(threads, total / (32 * least));
  if (workers < 2) return {};
  return {std::clamp(total / (32 * workers), least, most), static_cast<std::size_t>(workers)};
}

/// All moves on the calling thread: to the left front to back, then to the right back to front.
template <class T>
void move_alone(const std::uint64_t* previous, const std::uint64_t* offsets, std::size_t n, T* block) {
  for (std::size_t i = 0; i < n; ++i) {
    const KeptPart part = kept_part(previous, offsets, i);
    if (moves(part, Shift::left)) std::memmove(block + part.to, block + part.from, part.size * sizeof(T));
  }
  for (std::size_t i = n; i-- > 0;) {
    const KeptPart part = kept_part(previous, offsets, i);
    if (moves(part, Shift::right)) std::memmove(block + part.to, block + part.from, part.size * sizeof(T));
  }
}

/// Calls body(part) for all of one tile's move, in order.
template <class Body>
void for_parts(const std::uint64_t* previous, const std::uint64_t* offsets, std::size_t n, std::uint64_t tile_size,
               TileMove move, Body&& body) {
  const std::uint64_t begin = move.tile * tile_size;
  const std::uint64_t end = begin + std::min(tile_size, offsets[n] - begin);
  for (std::size_t i = object_at(offsets, n, begin); i < n && offsets[i] < end; ++i) {
    const KeptPart part = part_within(kept_part(previous, offsets, i), begin, end);
    if (moves(part, move.shift)) body(part);
  }
}

/// All moves, ticket by ticket, by several workers (pgl/defragment.hpp).
template <class T>
void move_in_tiles(const std::uint64_t* previous, const std::uint64_t* offsets, std::size_t n, const TilePlan& plan,
                   DefragmentWorkspace& workspace, T* block) {
  const std::uint64_t tiles = tile_count(offsets[n], plan.tile_size);
  const std::size_t tile_bytes = plan.tile_size * sizeof(T);
  if (workspace.staging.size() < plan.workers * tile_bytes) {
    std::vector<std::byte>().swap(workspace.staging);  // so that there are never two, nor one with room to spare
    workspace.staging.resize(plan.workers * tile_bytes);
  }
  workspace.reads.assign(2 * tiles, 0);
  std::atomic<std::uint64_t> next_ticket{0};

  // Tickets, not the numbers of the loop: those may be dealt out in any order. A worker without a thread of its own
  // comes when no ticket is left.
  parallel_for(plan.workers, 1, [&](std::size_t worker) {
    std::byte* const staging = workspace.staging.data() + worker * tile_bytes;
    for (;;) {
      const std::uint64_t ticket = next_ticket.fetch_add(1, std::memory_order_relaxed);
      if (ticket >= 2 * tiles) return;
      const TileMove move = tile_move(ticket, tiles);
      std::byte* end = staging;
      for_parts(previous, offsets, n, plan.tile_size, move, [&](const KeptPart& part) {
        std::memcpy(end, block + part.from, part.size * sizeof(T));
        end += part.size * sizeof(T);
      });
      std::atomic_ref(workspace.reads[ticket]).store(1, std::memory_order_release);
      if (end == staging) continue;

      const TicketRange before = tickets_before_write(previous, offsets, n, plan.tile_size, ticket);
      for (std::uint64_t other = before.first; other < before.last; ++other) {
        while (std::atomic_ref(workspace.reads[other]).load(std::memory_order_acquire) == 0) std::this_thread::yield();
      }
      const std::byte* from = staging;
      for_parts(previous, offsets, n, plan.tile_size, move, [&](const KeptPart& part) {
        std::memcpy(block + part.to, from, part.size * sizeof(T));
        from += part.size * sizeof(T);
      });
    }
  });
}

/// About 128 KiB of elements, at least one: what a thread takes at a time.
constexpr std::uint64_t chunk_of(std::size_t bytes) {
  return std::max<std::uint64_t>(1, (std::uint64_t{1} << 17) / bytes);
}

/// Writes what is new to where it belongs in the new block, by equal pieces of what is new.
template <class T>
void insert(const std::uint64_t* previous, const std::uint64_t* offsets, std::span<const std::uint64_t> delta_offsets,
            const T* additional, T* out) {
  const std::uint64_t total = delta_offsets.back(), chunk = chunk_of(sizeof(T));
  parallel_for((total + chunk - 1) / chunk, 1, [&](std::size_t c) {
    std::uint64_t at = c * chunk;
    const std::uint64_t end = std::min(total, at + chunk);
    for (std::size_t i = object_at(delta_offsets.data(), delta_offsets.size() - 1, at); at < end; ++i) {
      const DeltaPart part = delta_part(previous, offsets, i);
      PGL_ASSERT(delta_offsets[i + 1] - delta_offsets[i] == part.size);
      const std::uint64_t stop = std::min(end, delta_offsets[i + 1]);
      if (at < stop) {
        std::memcpy(out + offsets[i] + part.first + (at - delta_offsets[i]), additional + at, (stop - at) * sizeof(T));
      }
      at = stop;
    }
  });
}

}  // namespace defragment_detail

/// Makes the block of a new selection: for every object its elements of the last selection's block that stay, then
/// those that are new. Equal byte for byte to a fresh copy of the selection, if `existing` was one of the last.
///
/// - previous_offsets[n+1], offsets[n+1]: exclusive prefix sums of the counts of the last selection and of this one, of
///   vertices or of triangles, over the same objects;
/// - delta_offsets[n+1]: as lay_out_delta writes it from these two;
/// - existing: the last selection's block, at least previous_offsets[n] elements;
/// - additional: what is new, as pack_delta writes it, at least delta_offsets[n] elements;
/// - out: object i goes to [offsets[i], offsets[i+1]). Overlaps no input (see defragment_in_place). Elements from the
///   total on are left as they are.
///
/// T is any trivially copyable payload. Sizes are checked in debug builds. O(n + total), parallel within objects too,
/// no scratch; the result does not depend on the number of threads. [Peng13] Alg 4, corrected as kept_part says.
template <class T>
void defragment(std::span<const std::uint64_t> previous_offsets, std::span<const std::uint64_t> offsets,
                std::span<const std::uint64_t> delta_offsets, std::span<const T> existing,
                std::span<const T> additional, std::span<T> out) {
  static_assert(std::is_trivially_copyable_v<T>);
  PGL_ASSERT(!offsets.empty() && previous_offsets.size() == offsets.size() && delta_offsets.size() == offsets.size());
  PGL_ASSERT(previous_offsets.front() == 0 && offsets.front() == 0 && delta_offsets.front() == 0);
  PGL_ASSERT(previous_offsets.back() <= existing.size());
  PGL_ASSERT(delta_offsets.back() <= additional.size());
  PGL_ASSERT(offsets.back() <= out.size());
  const std::size_t n = offsets.size() - 1;
  const std::uint64_t total = offsets.back(), chunk = defragment_detail::chunk_of(sizeof(T));

  parallel_for((total + chunk - 1) / chunk, 1, [&](std::size_t c) {
    const std::uint64_t begin = c * chunk, end = std::min(total, begin + chunk);
    for (std::size_t i = object_at(offsets.data(), n, begin); i < n && offsets[i] < end; ++i) {
      const KeptPart kept = kept_part(previous_offsets.data(), offsets.data(), i);
      const KeptPart fresh{delta_offsets[i], kept.to + kept.size, offsets[i + 1] - kept.to - kept.size};
      PGL_ASSERT(delta_offsets[i + 1] - delta_offsets[i] == fresh.size);
      if (const KeptPart part = part_within(kept, begin, end); part.size > 0) {
        std::memcpy(out.data() + part.to, existing.data() + part.from, part.size * sizeof(T));
      }
      if (const KeptPart part = part_within(fresh, begin, end); part.size > 0) {
        std::memcpy(out.data() + part.to, additional.data() + part.from, part.size * sizeof(T));
      }
    }
  });
}

/// Does what defragment does within one buffer: `block` holds the last selection on entry and the new one on return.
///
/// - previous_offsets[n+1], offsets[n+1], delta_offsets[n+1], additional: as for defragment;
/// - workspace: scratch, see there; its contents on entry do not matter;
/// - block: in and out, at least previous_offsets[n] and at least offsets[n] elements; overlaps no input. Elements from
///   offsets[n] on are left as they are.
///
/// What stays where it is is neither read nor written. What moves is read once and written once, in the order that
/// pgl/defragment.hpp lays down, with the proof that nothing is overwritten before it is read: one thread moves whole
/// objects, to the left front to back and to the right back to front; several take tiles by ticket. Then what is new is
/// written. T is any trivially copyable payload. Sizes are checked in debug builds. O(n + elements that move or are
/// new); the result does not depend on the number of threads. [Peng13] 6.2.2.
template <class T>
void defragment_in_place(std::span<const std::uint64_t> previous_offsets, std::span<const std::uint64_t> offsets,
                         std::span<const std::uint64_t> delta_offsets, std::span<const T> additional,
                         DefragmentWorkspace& workspace, std::span<T> block) {
  static_assert(std::is_trivially_copyable_v<T>);
  PGL_ASSERT(!offsets.empty() && previous_offsets.size() == offsets.size() && delta_offsets.size() == offsets.size());
  PGL_ASSERT(previous_offsets.front() == 0 && offsets.front() == 0 && delta_offsets.front() == 0);
  PGL_ASSERT(previous_offsets.back() <= block.size());
  PGL_ASSERT(offsets.back() <= block.size());
  PGL_ASSERT(delta_offsets.back() <= additional.size());
  const std::size_t n = offsets.size() - 1;
  const std::uint64_t* const previous = previous_offsets.data();

  const auto plan = defragment_detail::plan_tiles(offsets[n], sizeof(T), thread_count());
  if (plan.workers == 1) {
    defragment_detail::move_alone(previous, offsets.data(), n, block.data());
  } else {
    defragment_detail::move_in_tiles(previous, offsets.data(), n, plan, workspace, block.data());
  }
  defragment_detail::insert(previous, offsets.data(), delta_offsets, additional.data(), block.data());
}

}  // namespace pgl::host
