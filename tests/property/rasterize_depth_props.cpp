// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "pgl/host/rasterize_depth.hpp"
#include "support/depth_scenes.hpp"
#include "support/exact_raster.hpp"
#include "support/numbers.hpp"

namespace {

using exact::DrawnTriangle;
using exact::Number;
using pgl::Coverage;
using pgl::Depth;
using pgl::DepthMap;
using pgl::far_depth;
using pgl::View;
using test::DepthScene;

template <class Index>
std::vector<Depth> drawn(const DepthScene<Index>& s, const DepthMap& size) {
  std::vector<Depth> depth(std::size_t{size.width} * size.height, far_depth);
  pgl::host::DepthWorkspace workspace;
  pgl::host::rasterize_depth<Index>(s.meshes, s.objects, s.vertices, s.triangles, s.map, s.occluders, s.view, size,
                                    workspace, depth);
  return depth;
}

template <class Index>
std::vector<DrawnTriangle> truth(const DepthScene<Index>& s) {
  std::vector<DrawnTriangle> all;
  for (const std::uint32_t i : s.occluders) {
    if (i == pgl::no_object) continue;
    const auto some = exact::drawn_triangles<Index>(s.view, s.objects[i], s.meshes, s.vertices, s.triangles, s.map);
    all.insert(all.end(), some.begin(), some.end());
  }
  return all;
}

/// The places, in half pixels, that a texel's coverage speaks of; of a whole texel its corners, which are enough for a
/// triangle.
std::vector<std::pair<int, int>> places(const View& view, const DepthMap& size, std::uint32_t i, std::uint32_t j) {
  const int scale = static_cast<int>(size.scale), x = static_cast<int>(i) * scale, y = static_cast<int>(j) * scale;
  const int right = std::min(x + scale, static_cast<int>(view.width));
  const int top = std::min(y + scale, static_cast<int>(view.height));
  if (size.coverage == Coverage::whole)
    return {{2 * x, 2 * y}, {2 * right, 2 * y}, {2 * x, 2 * top}, {2 * right, 2 * top}};
  std::vector<std::pair<int, int>> all;
  for (int q = y; q < top; ++q)
    for (int p = x; p < right; ++p) all.emplace_back(2 * p + 1, 2 * q + 1);
  return all;
}

/// The farthest depth of a triangle over the places, if it covers all of them inside its edges.
std::optional<Number> farthest(const DrawnTriangle& t, const std::vector<std::pair<int, int>>& all) {
  for (const auto& [x, y] : all)
    if (!t.covers(x, y, true)) return std::nullopt;
  std::optional<Number> most;
  for (const auto& [x, y] : all) {
    const Number d = t.depth().at(x, y);
    if (!most || d > *most) most = d;
  }
  return most;
}

Number in_steps(Depth depth) {
  return Number(depth) / Number(4294967296.0);
}

RC_GTEST_PROP(RasterizeDepthProps, aTexelThatIsWrittenIsCoveredAndNotTooNear, ()) {
  for (int repeat = 0; repeat < 10; ++repeat) {
    auto scene = test::any_depth_scene<std::uint32_t>();
    const DepthMap size = test::choose_size(scene.view, 24);
    const auto depth = drawn(scene, size);
    const auto exactly = truth(scene);
    for (std::uint32_t j = 0; j < size.height; ++j)
      for (std::uint32_t i = 0; i < size.width; ++i) {
        const Depth d = depth[std::size_t{j} * size.width + i];
        if (d == far_depth) continue;
        const auto all = places(scene.view, size, i, j);
        RC_ASSERT(std::ranges::any_of(exactly, [&](const DrawnTriangle& t) {
          const auto most = farthest(t, all);
          return most && *most <= in_steps(d);
        }));
      }
  }
}

}  // namespace
