// SPDX-License-Identifier: MIT
#include "scene/warehouse.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace pgl::scene {
namespace {

struct Layout {
  std::vector<glm::dvec3> corners;  ///< where the lower corner of each part goes
  glm::dvec2 floor{0.0};
};

/// Fills shelves of this length.
Layout fill(std::span<const glm::dvec3> sizes, double length, double gap) {
  Layout layout;
  layout.corners.resize(sizes.size());
  struct Rack {
    std::size_t first;  ///< part
    double depth;
  };
  std::vector<Rack> racks;
  std::size_t level = warehouse_levels;  // of the rack before the first: full
  double x = 0.0, z = 0.0, height = 0.0;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const glm::dvec3& size = sizes[i];
    if (i == 0 || x + size.x > length) {
      z += height + gap;
      if (++level >= warehouse_levels) {
        racks.push_back({i, 0.0});
        level = 0;
        z = 0.0;
      }
      x = 0.0;
      height = 0.0;
    }
    layout.corners[i] = {x, 0.0, z};
    layout.floor.x = std::max(layout.floor.x, x + size.x);
    x += size.x + gap;
    height = std::max(height, size.z);
    racks.back().depth = std::max(racks.back().depth, size.y);
  }

  double depth = 0.0;
  for (const Rack& rack : racks) depth += rack.depth;
  const double aisle = racks.empty() ? 0.0 : std::max(depth / static_cast<double>(racks.size()), gap);
  double y = 0.0;
  for (std::size_t r = 0; r < racks.size(); ++r) {
    const std::size_t end = r + 1 < racks.size() ? racks[r + 1].first : sizes.size();
    for (std::size_t i = racks[r].first; i < end; ++i) layout.corners[i].y = y + (racks[r].depth - sizes[i].y) / 2;
    y += racks[r].depth + aisle;
  }
  layout.floor.y = y - aisle;
  return layout;
}

}  // namespace

std::vector<glm::vec3> lay_out_warehouse(std::span<const pgl::Box> parts) {
  std::vector<glm::vec3> moves(parts.size());
  if (parts.empty()) return moves;
  std::vector<glm::dvec3> from(parts.size()), sizes(parts.size());
  std::vector<double> widths(parts.size());
  double widest = 0.0, all = 0.0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const glm::dvec3 low(parts[i].min), size = glm::dvec3(parts[i].max) - low;
    const bool real = size.x >= 0.0 && size.y >= 0.0 && size.z >= 0.0 && std::isfinite(size.x + size.y + size.z);
    if (real) {
      from[i] = low;
      sizes[i] = size;
    }
    widths[i] = std::max(sizes[i].x, sizes[i].y);
    widest = std::max(widest, sizes[i].x);
  }
  std::nth_element(widths.begin(), widths.begin() + static_cast<std::ptrdiff_t>(widths.size() / 2), widths.end());
  double gap = 0.25 * widths[widths.size() / 2];
  if (!(gap > 0.0)) gap = widest > 0.0 ? 0.25 * widest : 1.0;
  for (const glm::dvec3& size : sizes) all += size.x + gap;

  Layout best;
  for (double length = widest;; length = 1.1 * length + gap) {
    Layout layout = fill(sizes, length, gap);
    const auto side = [](const Layout& l) { return std::max(l.floor.x, l.floor.y); };
    if (best.corners.empty() || side(layout) < side(best)) best = std::move(layout);
    if (length > all) break;
  }
  const glm::dvec3 centre(best.floor.x / 2, best.floor.y / 2, 0.0);
  for (std::size_t i = 0; i < parts.size(); ++i) moves[i] = glm::vec3(best.corners[i] - centre - from[i]);
  return moves;
}

}  // namespace pgl::scene
