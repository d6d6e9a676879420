// SPDX-License-Identifier: MIT
// Pictures full of rectangles with loads, ordinary and not, to be shared out among GPUs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "pgl/balance.hpp"
#include "pgl/project.hpp"

namespace test {

struct BalanceScene {
  std::vector<pgl::ScreenBox> rectangles;
  std::vector<std::uint32_t> loads, weights;
  std::uint32_t width = 1, height = 1;
  pgl::BalanceOptions options;

  std::size_t size() const { return rectangles.size(); }
};

/// A rectangle as project does not write it, or seldom: empty, a NaN, beside the picture, far beyond it, a point, on
/// the borders of pixels.
inline pgl::ScreenBox odd_rectangle(std::mt19937& random, std::uint32_t width, std::uint32_t height) {
  constexpr float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  constexpr float numbers[] = {0.0f,   -0.0f, -1.0f,  -1.5f,   -2.0f, -inf,  inf,     nan,     1e-45f, -1e-45f,
                               1e-30f, 1e30f, -1e30f, 3.4e38f, 0.5f,  16384, 1 << 20, 1 << 24, 5e9f,   0.99999994f};
  const auto number = [&](std::uint32_t side) {
    const std::uint32_t kind = random() % 4;
    if (kind == 0) return numbers[random() % std::size(numbers)];
    const float whole = static_cast<float>(random() % (side + 4)) - 2.0f;
    return kind == 1 ? whole : whole + static_cast<float>(random() % 256) / 256.0f;
  };
  pgl::ScreenBox box;
  if (random() % 8 == 0) return box;
  box.x0 = number(width);
  box.x1 = random() % 6 == 0 ? box.x0 : number(width);
  box.y0 = number(height);
  box.y1 = random() % 6 == 0 ? box.y0 : number(height);
  box.depth = 1.0f;
  return box;
}

/// A rectangle in the picture, mostly small, at random or with its centre drawn towards a place.
inline pgl::ScreenBox plain_rectangle(std::mt19937& random, std::uint32_t width, std::uint32_t height, bool crowded) {
  std::uniform_real_distribution<float> unit(0.0f, 1.0f);
  const float most = random() % 16 == 0 ? 1.0f : 0.1f;
  const auto along = [&](std::uint32_t side, float& low, float& high) {
    const float full = static_cast<float>(side), size = unit(random) * unit(random) * most * full;
    const float centre = full * (crowded ? 0.2f + 0.1f * unit(random) * unit(random) : unit(random));
    low = pgl::ieee::max(centre - size / 2, 0.0f);
    high = pgl::ieee::min(centre + size / 2, full);
  };
  pgl::ScreenBox box;
  along(width, box.x0, box.x1);
  along(height, box.y0, box.y1);
  box.depth = 1.0f;
  return box;
}

enum class Loads { any, equal, none, one_heavy, huge };

/// n objects in a picture, for so many GPUs.
inline BalanceScene balance_scene(std::mt19937& random, std::size_t n, std::uint32_t width, std::uint32_t height,
                                  std::size_t gpus, Loads loads = Loads::any) {
  BalanceScene scene;
  scene.width = width;
  scene.height = height;
  const bool odd = random() % 3 == 0, crowded = random() % 3 == 0;
  for (std::size_t i = 0; i < n; ++i) {
    scene.rectangles.push_back(odd || random() % 16 == 0
                                   ? odd_rectangle(random, width, height)
                                   : plain_rectangle(random, width, height, crowded && random() % 8 != 0));
    std::uint32_t load = 0;
    switch (loads) {
      case Loads::any:
        load = random() % 4 == 0 ? 0 : random() % 1000;
        break;
      case Loads::equal:
        load = 7;
        break;
      case Loads::none:
        break;
      case Loads::one_heavy:
        load = i == n / 2 ? 4000000000u : random() % 50;
        break;
      case Loads::huge:
        load = 0xffffffffu - random() % 1000;
        break;
    }
    scene.loads.push_back(load);
  }
  const std::uint32_t kind = random() % 4;
  for (std::size_t gpu = 0; gpu < gpus; ++gpu)
    scene.weights.push_back(kind == 0   ? 1 + random() % 10
                            : kind == 1 ? 1 + static_cast<std::uint32_t>(random() >> 1)
                                        : 1);
  const float thresholds[] = {0.0f, 1e-30f, 0.01f, 0.03f, 0.3f, 1.0f};
  scene.options.threshold = thresholds[random() % std::size(thresholds)];
  scene.options.policy = random() % 2 == 0 ? pgl::BalancePolicy::histogram : pgl::BalancePolicy::bisection;
  const std::uint32_t bins[] = {0, 0, 0, 2, 3, 7, 64, 100000};
  scene.options.bins = bins[random() % std::size(bins)];
  return scene;
}

/// The same, whatever there is: few pixels or many, few GPUs or many.
inline BalanceScene any_balance_scene(std::mt19937& random, std::size_t most_objects, std::uint32_t most_side) {
  const Loads loads[] = {Loads::any, Loads::any, Loads::any, Loads::equal, Loads::none, Loads::one_heavy, Loads::huge};
  const std::uint32_t most = random() % 4 == 0 ? 6 : most_side;
  const std::uint32_t width = 1 + random() % most, height = random() % 8 == 0 ? 1 : 1 + random() % most;
  const std::size_t gpus = random() % 3 == 0 ? 2 : 1 + random() % (random() % 3 == 0 ? pgl::most_tiles : 9);
  const std::size_t n = random() % (most_objects + 1);
  return balance_scene(random, n, width, height, gpus, loads[random() % std::size(loads)]);
}

/// Few objects of nearly the largest load, for GPUs of large and nearly equal weights.
inline BalanceScene heavy_balance_scene(std::mt19937& random) {
  BalanceScene scene = balance_scene(random, 40, 400, 300, 2 + random() % 4, Loads::huge);
  for (std::uint32_t& load : scene.loads) load = 0xffffffffu - random() % 1000;
  for (std::uint32_t& weight : scene.weights) weight = 0xffffffffu - random() % 1000;
  return scene;
}

/// Loads of 2 and 1 left of the middle and 1 right of it, with a threshold of a half.
inline BalanceScene balance_scene_at_the_threshold() {
  BalanceScene scene;
  scene.width = 64;
  scene.height = 8;
  scene.weights = {1, 1};
  scene.options.policy = pgl::BalancePolicy::bisection;
  scene.options.threshold = 0.5f;
  scene.options.bins = 0;
  for (const float x : {8.0f, 24.0f, 48.0f}) scene.rectangles.push_back({x, 2.0f, x + 2.0f, 4.0f, 1.0f});
  scene.loads = {2, 1, 1};
  return scene;
}

}  // namespace test
