// SPDX-License-Identifier: MIT
// The rule of defragment: what of the last selection stays, where it goes, and in which order it can go there in place.
#pragma once

#include <cstddef>
#include <cstdint>

#include "pgl/config.hpp"

namespace pgl {

/// Elements that stay from one selection to the next: [from, from + size) of the old block is [to, to + size) of the
/// new one.
struct KeptPart {
  std::uint64_t from = 0;
  std::uint64_t to = 0;
  std::uint64_t size = 0;
  friend constexpr bool operator==(const KeptPart&, const KeptPart&) = default;
};

/// Computes what of an object stays: the prefix that both selections have, as many elements as the smaller count.
///
/// [Peng13] Alg 4, put right: an object has previous_offsets[object + 1] - previous_offsets[object] elements in the old
/// block, and of those never more are taken than the new selection has.
/// previous_offsets, offsets: exclusive prefix sums of the counts of the last selection and of this one, over the same
/// objects; entries object and object + 1 are read. Preconditions: neither decreases.
PGL_HD constexpr KeptPart kept_part(const std::uint64_t* previous_offsets, const std::uint64_t* offsets,
                                    std::size_t object) {
  PGL_ASSERT(previous_offsets[object] <= previous_offsets[object + 1] && offsets[object] <= offsets[object + 1]);
  const std::uint64_t before = previous_offsets[object + 1] - previous_offsets[object];
  const std::uint64_t now = offsets[object + 1] - offsets[object];
  return {previous_offsets[object], offsets[object], before < now ? before : now};
}

/// Cuts a part down to what goes to [begin, end) of the new block; size 0 where nothing does.
/// Precondition: begin <= end.
PGL_HD constexpr KeptPart part_within(const KeptPart& part, std::uint64_t begin, std::uint64_t end) {
  const std::uint64_t first = part.to > begin ? part.to : begin;
  const std::uint64_t last = part.to + part.size < end ? part.to + part.size : end;
  if (first >= last) return {part.from, part.to, 0};
  return {part.from + (first - part.to), first, last - first};
}

/// Finds the object that an element of a block belongs to.
/// offsets: n + 1 exclusive prefix sums. Precondition: position < offsets[n]. O(log n).
PGL_HD constexpr std::size_t object_at(const std::uint64_t* offsets, std::size_t n, std::uint64_t position) {
  PGL_ASSERT(position < offsets[n]);
  std::size_t first = 0, last = n;  // the object is in [first, last)
  while (last - first > 1) {
    const std::size_t middle = first + (last - first) / 2;
    if (offsets[middle] <= position) {
      first = middle;
    } else {
      last = middle;
    }
  }
  return first;
}

// ---- in place ------------------------------------------------------------------------------------------------------
//
// Let p(x) be the place in the old block of the element that goes to x in the new one, for every x that a kept part
// has. Objects lie in the same order in both, so p increases strictly. An element with p(x) > x moves left, one with
// p(x) < x right, and one with p(x) = x stays. Then, for two different elements that go to x < y:
//
// - Writing x hits what is still to be read at p(y) only if p(y) = x < y: y moves right. And then x moves right too,
//   since p(x) < p(y) = x.
// - Writing y hits p(x) only if p(x) = y > x: x moves left. And then y moves left too, since p(y) > p(x) = y.
//
// So moves to the left and moves to the right never meet, nor does either meet what stays. Among those to the left only
// a later one can destroy what an earlier one reads, so front to back is an order without harm; among those to the
// right it is back to front. [Peng13] 6.2.2 asks for such an order; this one needs no memory at all when one thread
// does it.
//
// To share it out: the new block is cut into tiles. For each tile there are two moves, of what goes left into it and of
// what goes right into it. They are numbered by tickets, leftward moves of tiles 0, 1, 2, ... and then rightward moves
// of the last tile, the one before it, .... A worker (a thread, a block of threads) takes the next ticket, and then
//
//   1. reads all elements of its move into memory of its own,
//   2. says so (a flag per ticket),
//   3. waits until those tickets have said so that read where it is about to write (tickets_before_write),
//   4. writes.
//
// Nothing is overwritten before it is read: by the above, what a move writes over is read by the moves in the same
// direction of earlier tickets, for which step 3 waits, or by itself, which step 1 has done, or by none. Nothing read
// was already overwritten, for the same reason. It ends: a ticket waits for lower tickets only, those have been taken
// when it has, and steps 1 and 2 wait for nothing. That holds for any number of workers, however they are scheduled, as
// long as one that has taken a ticket goes on some time.
//
// What is new (pack_delta) is written when all moves are done.

/// Which of the two moves of a tile: of all that goes to a lower place, or of all that goes to a higher one.
enum class Shift : std::uint8_t { left, right };

/// One move of one tile.
struct TileMove {
  std::uint64_t tile = 0;
  Shift shift = Shift::left;
  friend constexpr bool operator==(const TileMove&, const TileMove&) = default;
};

/// The number of tiles that a new block of `total` elements is cut into, the last one perhaps shorter; there are twice
/// as many tickets. Precondition: tile_size > 0.
PGL_HD constexpr std::uint64_t tile_count(std::uint64_t total, std::uint64_t tile_size) {
  return total / tile_size + (total % tile_size != 0 ? 1 : 0);
}

/// The move that a ticket stands for. Precondition: ticket < 2 * tiles.
PGL_HD constexpr TileMove tile_move(std::uint64_t ticket, std::uint64_t tiles) {
  PGL_ASSERT(ticket < 2 * tiles);
  if (ticket < tiles) return {ticket, Shift::left};
  return {2 * tiles - 1 - ticket, Shift::right};
}

/// Tells whether a part has anything to do with moves in this direction. What stays in place has with neither.
PGL_HD constexpr bool moves(const KeptPart& part, Shift shift) {
  return part.size != 0 && (shift == Shift::left ? part.to < part.from : part.to > part.from);
}

/// Where what stays of [begin, end) of the old block goes: nowhere outside of [first, last) of the new one.
struct Landing {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
  friend constexpr bool operator==(const Landing&, const Landing&) = default;
};

/// Computes where what stays of [begin, end) of the old block goes, given the objects that hold its first and its last
/// element: from the first possible place of an element at begin or later to the last possible one of an element before
/// end. Empty or turned round (first >= last) where nothing stays.
///
/// The elements at begin and end may be of objects that shrank, and not stay themselves.
/// Preconditions: begin < end <= the total of the old block; first_object = object_at(previous_offsets, n, begin) and
/// last_object = object_at(previous_offsets, n, end - 1).
PGL_HD constexpr Landing landing_between(const std::uint64_t* previous_offsets, const std::uint64_t* offsets,
                                         std::size_t first_object, std::size_t last_object, std::uint64_t begin,
                                         std::uint64_t end) {
  PGL_ASSERT(begin < end);
  const KeptPart head = kept_part(previous_offsets, offsets, first_object);
  const KeptPart tail = kept_part(previous_offsets, offsets, last_object);
  PGL_ASSERT(head.from <= begin && tail.from < end);
  const std::uint64_t skipped = begin - head.from;
  const std::uint64_t reached = end - tail.from;
  return {head.to + (skipped < head.size ? skipped : head.size), tail.to + (reached < tail.size ? reached : tail.size)};
}

/// Computes where what stays of [begin, end) of the old block goes, as landing_between does; what of it is past the end
/// of the old block counts for nothing.
/// Precondition: begin < end. O(log n) for n objects.
PGL_HD constexpr Landing landing(const std::uint64_t* previous_offsets, const std::uint64_t* offsets, std::size_t n,
                                 std::uint64_t begin, std::uint64_t end) {
  PGL_ASSERT(begin < end);
  const std::uint64_t total = previous_offsets[n];
  if (begin >= total) return {offsets[n], offsets[n]};
  if (end > total) end = total;
  return landing_between(previous_offsets, offsets, object_at(previous_offsets, n, begin),
                         object_at(previous_offsets, n, end - 1), begin, end);
}

/// Tickets [first, last), none where first >= last.
struct TicketRange {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
  friend constexpr bool operator==(const TicketRange&, const TicketRange&) = default;
};

/// Computes the tickets that must have been read before this one may write, given where what stays of the old block
/// goes that is where the ticket's tile of the new one is: the moves in its direction that read there, and perhaps some
/// between them. All are lower than the ticket itself, and of its own direction.
/// Preconditions: tile_size > 0; ticket < 2 * tiles.
PGL_HD constexpr TicketRange tickets_that_land(const Landing& to, std::uint64_t tile_size, std::uint64_t tiles,
                                               std::uint64_t ticket) {
  if (to.first >= to.last) return {};
  const TileMove move = tile_move(ticket, tiles);
  const std::uint64_t first = to.first / tile_size;
  const std::uint64_t last = (to.last - 1) / tile_size;
  if (move.shift == Shift::left) return {first, last < move.tile ? last + 1 : move.tile};
  return {2 * tiles - 1 - last, 2 * tiles - 1 - (first > move.tile ? first - 1 : move.tile)};
}

/// Computes the tickets that must have been read before this one may write: tickets_that_land where its tile is.
///
/// previous_offsets, offsets: n + 1 entries each. All ranges together have at most two tickets for each tile.
/// Preconditions: tile_size > 0; ticket < 2 * tile_count(offsets[n], tile_size). O(log n).
PGL_HD constexpr TicketRange tickets_before_write(const std::uint64_t* previous_offsets, const std::uint64_t* offsets,
                                                  std::size_t n, std::uint64_t tile_size, std::uint64_t ticket) {
  const std::uint64_t tiles = tile_count(offsets[n], tile_size);
  const std::uint64_t begin = tile_move(ticket, tiles).tile * tile_size;
  const std::uint64_t left = offsets[n] - begin;
  const std::uint64_t size = left < tile_size ? left : tile_size;
  return tickets_that_land(landing(previous_offsets, offsets, n, begin, begin + size), tile_size, tiles, ticket);
}

}  // namespace pgl
