// SPDX-License-Identifier: MIT
// Models whose meshes are no more than elements, and sequences of selections of them, with what each should look like.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/types.hpp"

namespace test {

/// A payload of any size, also of those that are no multiple of anything.
template <std::size_t bytes>
struct Payload {
  unsigned char byte[bytes];
  friend bool operator==(const Payload&, const Payload&) = default;
};

enum class ModelShape { even, one_object, mostly_empty, one_huge, huge_and_tiny };
inline constexpr int model_shapes = 5;

enum class Step { stay, walk, one_object, first_object, teleport, some_leave, nothing, everything, turn, halve };
inline constexpr int steps = 10;

template <class T>
class SelectionWalk {
 public:
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<T> elements;
  std::vector<std::uint32_t> counts;

  SelectionWalk(std::mt19937& random, ModelShape shape, std::uint32_t size) {
    const auto below = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    const std::uint32_t object_count = shape == ModelShape::one_object ? 1 : 1 + below(std::max(1u, size));
    const std::uint32_t mesh_count = shape == ModelShape::one_huge ? 2 : 1 + below(object_count);
    std::uint64_t used = below(3);
    for (std::uint32_t m = 0; m < mesh_count; ++m) {
      std::uint32_t most = below(40);
      if (shape == ModelShape::one_object || (shape == ModelShape::one_huge && m == 0)) most = 1 + below(20 * size);
      if (shape == ModelShape::mostly_empty && below(10) != 0) most = 0;
      if (shape == ModelShape::huge_and_tiny) most = below(4) == 0 ? below(400) : below(3);
      meshes.push_back({.first_vertex = used, .first_triangle = used, .max_vertices = most});
      used += most + below(3);  // gaps, which nothing may touch
    }
    for (std::uint32_t i = 0; i < object_count; ++i) objects.push_back({.mesh = below(mesh_count)});
    if (shape == ModelShape::one_huge) {  // it stands once
      for (auto& object : objects) object.mesh = 1;
      objects[below(object_count)].mesh = 0;
    }
    elements.resize(used);
    for (T& element : elements) {
      for (auto& byte : element.byte) byte = static_cast<unsigned char>(random());
    }
    counts.assign(objects.size(), 0);
  }

  std::uint32_t most(std::size_t i) const { return meshes[objects[i].mesh].max_vertices; }

  void go(std::mt19937& random, Step step) {
    const std::size_t n = objects.size();
    const auto any = [&](std::size_t i) { return static_cast<std::uint32_t>(random() % (most(i) + 1)); };
    const auto nudge = [&](std::size_t i) {
      const std::int64_t by = static_cast<std::int64_t>(random() % 7) - 3;
      counts[i] = static_cast<std::uint32_t>(std::clamp<std::int64_t>(std::int64_t{counts[i]} + by, 0, most(i)));
    };
    switch (step) {
      case Step::stay:
        break;
      case Step::walk:
        for (std::size_t i = 0; i < n; ++i) {
          if (random() % 4 == 0) nudge(i);
        }
        break;
      case Step::one_object: {
        const std::size_t i = random() % n;
        counts[i] = any(i);
        break;
      }
      case Step::first_object:
        nudge(0);
        break;  // all others shift by a little
      case Step::teleport:
        for (std::size_t i = 0; i < n; ++i) counts[i] = random() % 3 == 0 ? any(i) : 0;
        break;
      case Step::some_leave:
        for (std::size_t i = 0; i < n; ++i) {
          if (random() % 5 == 0) counts[i] = counts[i] == 0 ? most(i) : 0;
        }
        break;
      case Step::nothing:
        counts.assign(n, 0);
        break;
      case Step::everything:
        for (std::size_t i = 0; i < n; ++i) counts[i] = most(i);
        break;
      case Step::turn: {  // one side grows while the other one shrinks
        const bool grow_first = random() % 2 == 0;
        const std::size_t middle = random() % (n + 1);
        for (std::size_t i = 0; i < n; ++i) counts[i] = (i < middle) == grow_first ? most(i) : any(i) / 4;
        break;
      }
      case Step::halve:
        for (auto& count : counts) count /= 2;
        break;
    }
  }

  std::vector<std::uint64_t> offsets() const {
    std::vector<std::uint64_t> sums{0};
    for (const std::uint32_t count : counts) sums.push_back(sums.back() + count);
    return sums;
  }

  /// The selection copied element by element.
  std::vector<T> fresh() const {
    std::vector<T> copy;
    for (std::size_t i = 0; i < objects.size(); ++i) {
      for (std::uint32_t k = 0; k < counts[i]; ++k) {
        copy.push_back(elements[meshes[objects[i].mesh].first_vertex + k]);
      }
    }
    return copy;
  }

  /// What this selection has and that of `before` has not.
  std::vector<T> missing(const std::vector<std::uint32_t>& before) const {
    std::vector<T> copy;
    for (std::size_t i = 0; i < objects.size(); ++i) {
      for (std::uint32_t k = 0; k < counts[i]; ++k) {
        if (k >= before[i]) copy.push_back(elements[meshes[objects[i].mesh].first_vertex + k]);
      }
    }
    return copy;
  }
};

}  // namespace test
