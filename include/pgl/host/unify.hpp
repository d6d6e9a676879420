// SPDX-License-Identifier: MIT
// Makes the tiles of a picture agree on the vertex count of every object, on the CPU.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/unify.hpp"

namespace pgl::host {

using pgl::BudgetTotals;

/// Unifies the counts that tiles selected each on its own: one count per object, so that an object on a border between
/// tiles shows no seam ([NC07], our reading).
///
/// - counts: in, the counts of n objects for each of so many tiles, one tile after the other;
/// - in_tile: in, as many flags: whether the object touches the tile. Empty: it does where its count is not 0;
/// - unified: out, n. An object that no tile draws gets 0. With UnifyPolicy::performance, one that some tile touches
///   but leaves out (flag set, count 0) gets 0 too. May be the same array as one of the tiles' counts.
/// Returns how many objects have a count above 0, and the sum of the counts.
///
/// Every result is one of the object's counts or 0: so 0 or in its range, if these were. With
/// UnifyPolicy::performance what a tile then draws (take_unified) is object by object at most what it selected, so
/// within its budget; with UnifyPolicy::quality at least that, so within its error threshold.
/// Preconditions: counts.size() == tiles * n; in_tile is empty or as long; counts below 2^32 - 1.
/// O(tiles * n), in parallel; allocates nothing; the same for any number of threads and order of tiles.
inline BudgetTotals unify(std::span<const std::uint32_t> counts, std::span<const std::uint8_t> in_tile,
                          std::size_t tiles, UnifyPolicy policy, std::span<std::uint32_t> unified) {
  const std::size_t n = unified.size();
  PGL_ASSERT(counts.size() == tiles * n && (in_tile.empty() || in_tile.size() == counts.size()));
  return detail::sum_blocks(n, detail::block_count(n), [&](std::size_t, std::size_t begin, std::size_t end) {
    BudgetTotals part;
    // Some objects at a time, so that each tile's counts are read in a row.
    constexpr std::size_t most = 1024;
    std::uint32_t keys[most];
    for (std::size_t first = begin; first < end; first += most) {
      const std::size_t size = std::min(most, end - first);
      std::fill_n(keys, size, no_unify_key(policy));
      for (std::size_t t = 0; t < tiles; ++t) {
        const std::uint32_t* const count = counts.data() + t * n + first;
        const std::uint8_t* const touches = in_tile.empty() ? nullptr : in_tile.data() + t * n + first;
        for (std::size_t i = 0; i < size; ++i) {
          const bool is_touched = touches == nullptr ? count[i] > 0 : touches[i] != 0;
          keys[i] = combined_key(keys[i], unify_key(count[i], is_touched, policy), policy);
        }
      }
      for (std::size_t i = 0; i < size; ++i) {
        const std::uint32_t vertices = unified_vertices(keys[i]);
        unified[first + i] = vertices;
        part += {vertices > 0 ? 1u : 0u, vertices};
      }
    }
    return part;
  });
}

/// Fills in what one tile draws of a unified selection: the unified counts of the objects that touch it, 0 for all
/// others.
///
/// counts, in_tile: in, the tile's own, n each, as in unify (in_tile empty: an object touches where its count is not
/// 0). unified: in, n. out: n, may be the same array as counts or unified.
/// Returns how many objects the tile draws, and with how many vertices. O(n), in parallel; allocates nothing; the same
/// for any number of threads.
inline BudgetTotals take_unified(std::span<const std::uint32_t> counts, std::span<const std::uint8_t> in_tile,
                                 std::span<const std::uint32_t> unified, std::span<std::uint32_t> out) {
  const std::size_t n = out.size();
  PGL_ASSERT(counts.size() == n && unified.size() == n && (in_tile.empty() || in_tile.size() == n));
  return detail::sum_blocks(n, detail::block_count(n), [&](std::size_t, std::size_t begin, std::size_t end) {
    BudgetTotals part;
    for (std::size_t i = begin; i < end; ++i) {
      const bool touches = in_tile.empty() ? counts[i] > 0 : in_tile[i] != 0;
      out[i] = vertices_in_tile(unified[i], touches);
      part += {out[i] > 0 ? 1u : 0u, out[i]};
    }
    return part;
  });
}

}  // namespace pgl::host
