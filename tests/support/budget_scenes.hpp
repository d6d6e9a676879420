// SPDX-License-Identifier: MIT
// RapidCheck generators of the objects that a vertex budget is shared among.
#pragma once

#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "pgl/distribute_budget.hpp"

namespace test {

/// What a budget is shared among.
struct Scene {
  std::vector<float> areas;
  std::vector<float> depths;
  std::vector<std::uint32_t> min_vertices;
  std::vector<std::uint32_t> max_vertices;
  pgl::BudgetOptions options;
  std::size_t size() const { return areas.size(); }
};

/// 0 to 1e30 by magnitude, a few round numbers (so that weights tie), and what should not be there but is.
inline rc::Gen<float> magnitude() {
  return rc::gen::weightedOneOf<float>(
      {{3, rc::gen::map(rc::gen::inRange(-100000, 100000),
                        [](int e) { return static_cast<float>(std::exp2(e / 1000.0)); })},
       {10, rc::gen::map(rc::gen::inRange(0, 20000), [](int e) { return static_cast<float>(std::exp2(e / 1000.0)); })},
       {6, rc::gen::element(1.0f, 2.0f, 4.0f, 8.0f)},
       {1, rc::gen::element(0.0f, -0.0f, -1.0f, 1e-45f, 1e-30f, 1e30f, 3.4e38f, std::numeric_limits<float>::infinity(),
                            -std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN())}});
}

inline rc::Gen<std::uint32_t> vertices() {
  return rc::gen::weightedOneOf<std::uint32_t>(
      {{4, rc::gen::inRange<std::uint32_t>(0, 30)},
       {3, rc::gen::map(rc::gen::inRange(0, 31001),
                        [](int e) { return static_cast<std::uint32_t>(std::exp2(e / 1000.0)); })},
       {1, rc::gen::element(0u, 1u, 16u, 0x7fffffffu, 0x80000000u)}});
}

inline rc::Gen<float> alphas() {
  return rc::gen::oneOf(rc::gen::element(std::nextafter(1.0f, 2.0f), 1.001f, 2.0f, 3.0f, 6.0f, 64.0f),
                        rc::gen::map(rc::gen::inRange(1, 63001), [](int a) { return 1.0f + a / 1000.0f; }));
}

/// At most `most` objects, ordinary and odd ones.
inline Scene scene_of(std::size_t most, pgl::BudgetPolicy policy) {
  Scene scene;
  const auto n = *rc::gen::inRange<std::size_t>(0, most + 1);
  // Half of the scenes are of one size or one area, where the order decides.
  const bool one_size = *rc::gen::element(false, false, true);
  const bool one_area = *rc::gen::element(false, false, true);
  scene.areas =
      one_area ? std::vector<float>(n, *magnitude()) : *rc::gen::container<std::vector<float>>(n, magnitude());
  scene.depths =
      one_area ? std::vector<float>(n, *magnitude()) : *rc::gen::container<std::vector<float>>(n, magnitude());
  scene.min_vertices = one_size ? std::vector<std::uint32_t>(n, *vertices())
                                : *rc::gen::container<std::vector<std::uint32_t>>(n, vertices());
  scene.max_vertices = one_size ? std::vector<std::uint32_t>(n, *vertices())
                                : *rc::gen::container<std::vector<std::uint32_t>>(n, vertices());
  std::uint64_t least = 0, most_vertices = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (scene.min_vertices[i] > scene.max_vertices[i]) std::swap(scene.min_vertices[i], scene.max_vertices[i]);
    least += scene.min_vertices[i];
    most_vertices += scene.max_vertices[i];
  }
  pgl::BudgetOptions& options = scene.options;
  options.policy = policy;
  options.alpha = *alphas();
  options.pet = *rc::gen::element(0.0f, 0.0f, 1.0f, 100.0f);
  options.near_depth = *rc::gen::element(1e-45f, 1e-3f, 1.0f);
  options.viewport_area = *rc::gen::element(1e6f, std::numeric_limits<float>::infinity());
  constexpr std::uint64_t two_32 = std::uint64_t{1} << 32;
  const std::uint64_t below_sum = *rc::gen::inRange<std::uint64_t>(0, most_vertices + 1);
  const std::uint64_t anything = *rc::gen::inRange<std::uint64_t>(0, two_32 + 1);
  const std::uint64_t few = *rc::gen::inRange<std::uint64_t>(0, 200);
  options.budget = std::min(two_32, *rc::gen::element(below_sum, below_sum, anything, few, few, least, least + 1,
                                                      most_vertices, most_vertices + 1, two_32));
  return scene;
}

/// Many objects, for what one worker does not see of another's.
inline Scene large_scene(std::uint32_t seed, std::size_t n) {
  std::mt19937 random(seed);
  const auto below = [&](std::uint32_t bound) { return static_cast<std::uint32_t>(random() % bound); };
  Scene scene;
  const bool ties = below(2) == 0;
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < n; ++i) {
    scene.areas.push_back(below(4) == 0 ? 0.0f : static_cast<float>(ties ? below(3) : below(1u << 20)));
    scene.depths.push_back(ties ? 1.0f : 1.0f + static_cast<float>(below(1000)));
    scene.max_vertices.push_back(ties ? 100 : below(1000));
    scene.min_vertices.push_back(below(scene.max_vertices.back() + 1));
    sum += scene.max_vertices.back();
  }
  scene.options.budget = sum * below(1000) / 1500;
  scene.options.alpha = 1.5f + static_cast<float>(below(4));
  return scene;
}

}  // namespace test
