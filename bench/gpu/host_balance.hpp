// SPDX-License-Identifier: MIT
// The tiles of several GPUs for one frame of the plant, on the host.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "host_frame.hpp"
#include "pgl/balance.hpp"
#include "pgl/project.hpp"

namespace pgl::bench {

/// The rectangles and triangle counts of a frame, and how they are shared out among so many equal GPUs.
struct HostBalance {
  HostBalance(const Scene& scene, std::uint64_t budget);

  void balance(std::size_t gpus, const BalanceOptions& options);
  void in_tile();  ///< of the first of two GPUs; balance must have run

  std::uint32_t width, height;
  std::vector<ScreenBox> rectangles;
  std::vector<std::uint32_t> loads, weights;
  std::vector<Tile> tiles;
  std::vector<std::uint64_t> tile_loads;
  std::vector<std::uint8_t> flags;

 private:
  struct Workspace;  // the drivers' headers stay out of device code
  std::shared_ptr<Workspace> workspace_;
};

}  // namespace pgl::bench
