// SPDX-License-Identifier: MIT
// Selects the counts of a frame tile by tile, a thread for each, and makes the tiles agree; on the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/balance.hpp"
#include "pgl/config.hpp"
#include "pgl/host/balance.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/unify.hpp"
#include "pgl/project.hpp"

namespace pgl::host {

/// Scratch memory of adapt_tiles, and what the tiles selected: tile by tile, an entry for each object, as unify and
/// take_unified read them. Reuse it from frame to frame: it grows to the largest frame and stays.
struct AdaptWorkspace {
  std::vector<std::uint8_t> flags;    ///< whether the object touches the tile
  std::vector<std::uint32_t> counts;  ///< what the tile selected
};

/// Selects the vertex counts of a frame for each tile of the picture on its own, all tiles at the same time, and
/// unifies them: one count for each object ([NC07] adapt tiles, our reading).
///
/// - rectangles: n, as project writes them: which objects touch which tile (as in_tile says, whatever their load);
/// - tiles: T of them, at least 1, those of balance or any others, also overlapping or empty ones;
/// - select(tile, flags, counts): the caller's. It fills in counts, n of them, each below 2^32 - 1, what the tile with
///   that number selects: by its own budget with distribute_budget, by its own threshold with select_by_error, or by
///   any other means. flags, n of them, are 1 for the objects that touch the tile, else 0; what is selected for the
///   others does not matter. Once for each tile, from any thread: it must not throw, and what it writes beside counts
///   must be the tile's own (workspaces too). What counts hold before is not defined;
/// - counts: out, n. An object that no tile touches gets 0.
/// Returns how many objects have a count above 0, and the sum of the counts. The workspace then has what each tile
/// selected, for take_unified.
///
/// With UnifyPolicy::performance no tile draws more of an object than it selected, so each is within its budget; with
/// UnifyPolicy::quality none draws less, so each is within its threshold. Where a tile's selection of an object depends
/// on the object alone, as that of select_by_error with one threshold for all, the tiles of balance give with
/// UnifyPolicy::quality what one selection for the whole picture gives. With one tile the result is what was selected
/// for the objects that touch it.
///
/// Each tile is one thread's: the library's own loops inside select run on that thread alone (thread_count() is 1
/// there), unless there is one tile, which has all threads. So threads beyond T have nothing to do until the tiles are
/// unified, and T threads do not do the work of one T times as fast: each goes through all n objects to find its own.
/// Where one selection fits all tiles, running that once on all threads is faster; this is for tiles that select by
/// budgets or thresholds of their own.
///
/// O(n T) and the selections; the same for any number of threads if each selection is. 5 n T bytes of workspace;
/// allocates only where it is smaller than ever before.
template <class Select>
BudgetTotals adapt_tiles(std::span<const ScreenBox> rectangles, std::span<const Tile> tiles, UnifyPolicy policy,
                         AdaptWorkspace& workspace, Select&& select, std::span<std::uint32_t> counts) {
  const std::size_t n = rectangles.size(), all = n * tiles.size();
  PGL_ASSERT(!tiles.empty() && counts.size() == n);
  if (workspace.flags.size() < all) workspace.flags.resize(all);
  if (workspace.counts.size() < all) workspace.counts.resize(all);
  const std::span<std::uint8_t> flags = std::span(workspace.flags).first(all);
  const std::span<std::uint32_t> selected = std::span(workspace.counts).first(all);
  const auto adapt = [&](std::size_t tile) {
    const std::span<std::uint8_t> own = flags.subspan(tile * n, n);
    in_tile(rectangles, {}, tiles[tile], own);
    select(tile, std::span<const std::uint8_t>(own), selected.subspan(tile * n, n));
  };
  if (tiles.size() == 1) {
    adapt(0);
  } else {
    parallel_for(tiles.size(), 1, [&](std::size_t tile) {
#if defined(_OPENMP)
#pragma omp parallel num_threads(1)  // in here this thread is number 0, of 1
      {
        omp_set_num_threads(1);  // for what it begins in here, no other
        adapt(tile);
      }
#else
      adapt(tile);
#endif
    });
  }
  return unify(selected, flags, tiles.size(), policy, counts);
}

}  // namespace pgl::host
