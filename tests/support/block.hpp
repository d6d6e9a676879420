// SPDX-License-Identifier: MIT
// The block of a selection, made element by element.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "pgl/types.hpp"

namespace test {

/// The selected elements of all objects, one after the other, and behind them some that nothing may read: those are
/// `beyond`. first: &Mesh::first_vertex or &Mesh::first_triangle.
template <class T>
std::vector<T> block_of(const std::vector<pgl::Mesh>& meshes, const std::vector<pgl::Object>& objects,
                        std::uint64_t pgl::Mesh::*first, const std::vector<T>& elements,
                        const std::vector<std::uint64_t>& offsets, const T& beyond) {
  std::vector<T> block;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    for (std::uint64_t k = 0; k < offsets[i + 1] - offsets[i]; ++k) {
      block.push_back(elements.at(meshes[objects[i].mesh].*first + k));
    }
  }
  block.resize(block.size() + 3, beyond);
  return block;
}

}  // namespace test
