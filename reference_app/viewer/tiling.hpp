// SPDX-License-Identifier: MIT
// What several GPUs that draw one picture are told: how it is cut into their tiles, and what limits their detail.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/balance.hpp"
#include "pgl/distribute_budget.hpp"
#include "pgl/host/balance.hpp"

namespace pgl::viewer {

/// equal: parts as large as each other, whatever is in them. balanced: what each draws costs the same. measured: and
/// takes the same time, by the times of the frames before. wall: a grid of equal parts, each a screen of its own.
enum class TileMode { equal, balanced, measured, wall };

struct TileOptions {
  TileMode mode = TileMode::balanced;
  BalanceOptions balance;               ///< balanced and measured: how a cut is found
  std::uint32_t columns = 0, rows = 0;  ///< of a wall
};

/// What decides on the vertices of an object: its share of a budget, or its error on the screen.
enum class LodMode { budget, error };

/// What a frame is asked for.
struct FrameRequest {
  BudgetOptions distribution;                       ///< its near_depth and viewport_area are taken from the view
  float threshold = 1.0f;                           ///< pixels, for LodMode::error
  std::array<std::uint32_t, most_tiles> weights{};  ///< what each rank draws in a given time, above 0
};

/// The grid of a wall, row by row from the top left, as people number screens. Some parts are a pixel larger than
/// others where the size is no multiple.
inline std::vector<Tile> wall_tiles(std::uint32_t columns, std::uint32_t rows, std::uint32_t width,
                                    std::uint32_t height) {
  std::vector<Tile> tiles;
  const auto part = [](std::uint32_t size, std::uint32_t of, std::uint32_t i) {
    return static_cast<std::uint32_t>(std::uint64_t{size} * i / of);
  };
  for (std::uint32_t row = rows; row-- > 0;) {  // row 0 of the picture is the lowest
    for (std::uint32_t column = 0; column < columns; ++column) {
      tiles.push_back({part(width, columns, column), part(height, rows, row), part(width, columns, column + 1),
                       part(height, rows, row + 1)});
    }
  }
  return tiles;
}

/// Parts as large as each other: how balance cuts what is touched by no object.
inline std::vector<Tile> equal_tiles(std::uint32_t count, std::uint32_t width, std::uint32_t height) {
  std::vector<Tile> tiles(count);
  std::vector<std::uint64_t> loads(count);
  host::BalanceWorkspace workspace;
  host::balance({}, {}, width, height, std::vector<std::uint32_t>(count, 1), {}, workspace, tiles, loads);
  return tiles;
}

}  // namespace pgl::viewer
