// SPDX-License-Identifier: MIT
// Depth maps for tests of what is built on them: sizes around every edge, walls with holes, ramps and noise.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "pgl/build_hzm.hpp"
#include "pgl/depth.hpp"

namespace test {

inline pgl::DepthMap map_of(std::uint32_t width, std::uint32_t height, std::uint32_t scale = 1) {
  return {width, height, scale, pgl::Coverage::centres};
}

/// Sizes around powers of two, tiles of 4, 16 and 64 texels and six levels; rows and columns.
inline const std::vector<pgl::DepthMap>& odd_sizes() {
  static const std::vector<pgl::DepthMap> sizes = [] {
    std::vector<pgl::DepthMap> all;
    for (const auto& [w, h] : std::vector<std::pair<std::uint32_t, std::uint32_t>>{
             {1, 1},     {2, 1},     {1, 2},    {2, 2},     {3, 3},     {4, 4},    {5, 3},    {7, 1333},
             {1333, 7},  {1, 1000},  {1000, 1}, {15, 17},   {16, 16},   {17, 15},  {31, 33},  {63, 65},
             {64, 64},   {65, 63},   {66, 130}, {127, 129}, {128, 128}, {129, 64}, {130, 66}, {255, 257},
             {256, 256}, {333, 250}, {640, 63}, {512, 300}, {4097, 2},  {2, 4099}, {5000, 1}, {1, 5000}})
      all.push_back(map_of(w, h));
    return all;
  }();
  return sizes;
}

/// The kinds of depths that texels_of makes.
enum class Depths { noise, ramp, holed_wall, few_values };

/// A map with its levels, of which only level 0 means anything.
inline std::vector<pgl::Depth> texels_of(const pgl::DepthMap& size, Depths kind, std::uint32_t seed) {
  std::vector<pgl::Depth> texels(pgl::hzm_texels(size), 0x5a5a5a5au);
  std::mt19937 random(seed);
  for (std::uint32_t y = 0; y < size.height; ++y)
    for (std::uint32_t x = 0; x < size.width; ++x) {
      pgl::Depth& d = texels[std::size_t{y} * size.width + x];
      const pgl::Depth any = random();
      switch (kind) {
        case Depths::noise:
          d = any;
          break;
        case Depths::ramp:
          d = x * 0x10001u + y * 0x30000u;
          break;
        case Depths::holed_wall:
          d = any % 200 == 0 ? pgl::far_depth : 0x40000000u + any % 1000;
          break;
        case Depths::few_values:
          d = any % 3 == 0 ? 0 : any % 3 == 1 ? 0x80000000u : pgl::far_depth;
          break;
      }
    }
  return texels;
}

}  // namespace test
