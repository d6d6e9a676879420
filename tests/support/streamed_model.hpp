// SPDX-License-Identifier: MIT
// Models of vertices and triangles under sequences of selections, with what the blocks of each should hold.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "pgl/types.hpp"
#include "support/selection_walk.hpp"

namespace test {

/// What one frame should hold, and should have sent.
struct StreamedFrame {
  using Vertex = Payload<12>;
  std::vector<std::uint64_t> vertex_offsets, triangle_offsets;
  std::vector<Vertex> vertices;
  std::vector<pgl::Triangle<std::uint16_t>> triangles;
  std::uint64_t new_vertices = 0, new_triangles = 0;
};

/// A SelectionWalk whose meshes have triangles too: five for every three vertices that are shown.
class StreamedModel : public SelectionWalk<StreamedFrame::Vertex> {
 public:
  std::vector<pgl::Triangle<std::uint16_t>> triangles;

  StreamedModel(std::mt19937& random, ModelShape shape, std::uint32_t size) : SelectionWalk(random, shape, size) {
    std::uint64_t used = random() % 3;
    for (pgl::Mesh& mesh : meshes) {
      mesh.first_triangle = used;
      used += triangles_of(mesh.max_vertices) + random() % 2;
    }
    triangles.resize(used);
    for (auto& triangle : triangles) {
      for (auto& v : triangle.v) v = static_cast<std::uint16_t>(random());
    }
  }

  static std::uint32_t triangles_of(std::uint32_t vertices) { return vertices * 5 / 3; }

  std::uint64_t most_vertices() const {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < objects.size(); ++i) sum += most(i);
    return sum;
  }
  std::uint64_t most_triangles() const {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < objects.size(); ++i) sum += triangles_of(most(i));
    return sum;
  }

  /// Copied element by element; what is new, against the counts of the frame before.
  StreamedFrame frame(const std::vector<std::uint32_t>& before) const {
    StreamedFrame frame;
    frame.vertex_offsets = offsets();
    frame.vertices = fresh();
    frame.triangle_offsets = {0};
    for (std::size_t i = 0; i < objects.size(); ++i) {
      const std::uint32_t count = triangles_of(counts[i]), had = triangles_of(before[i]);
      const std::uint64_t first = meshes[objects[i].mesh].first_triangle;
      for (std::uint32_t k = 0; k < count; ++k) frame.triangles.push_back(triangles[first + k]);
      frame.triangle_offsets.push_back(frame.triangles.size());
      if (counts[i] > before[i]) {
        frame.new_vertices += counts[i] - before[i];
        frame.new_triangles += count - had;
      }
    }
    return frame;
  }
};

}  // namespace test
