// SPDX-License-Identifier: MIT
// Keeps the blocks of the last selection and brings them up to the next one with no more than what is new.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/host/defragment.hpp"
#include "pgl/host/pack_delta.hpp"
#include "pgl/pack_delta.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// The vertices and the triangles of a selection, each as one continuous block, from frame to frame: what stays is
/// moved in place, only what is new is collected from the model. [Peng13] chapter 3, [PC11] 5.2.
///
/// A frame is begin(), send(), apply(), in this order, which is checked in debug builds. After it, vertices() and
/// triangles() are what a fresh copy of the selection is, byte for byte, whatever the selections before were: the raw
/// prefixes of all objects, object i at [offsets[i], offsets[i + 1]), for gather_block and reform_block.
///
/// pgl::cuda::BlockStream has the same functions, and does them on the GPU; here nothing has to be sent anywhere.
/// Vertex is any trivially copyable payload, Index std::uint16_t or std::uint32_t. Results do not depend on the number
/// of threads. Memory: what reserve() says; what is new, up to the largest frame so far; the scratch of
/// defragment_in_place. Warm, nothing is allocated.
template <class Vertex, class Index>
class BlockStream {
 public:
  /// Makes room for selections of exactly so many objects, of at most so many vertices and triangles, and forgets the
  /// last one: the next frame starts from empty blocks.
  void reserve(std::size_t objects, std::uint64_t vertices, std::uint64_t triangles) {
    for (Selection& selection : selections_) {
      selection.counts.assign(objects, 0);
      selection.vertex_offsets.assign(objects + 1, 0);
      selection.triangle_offsets.assign(objects + 1, 0);
    }
    vertex_delta_.assign(objects + 1, 0);
    triangle_delta_.assign(objects + 1, 0);
    vertices_.resize(vertices);
    triangles_.resize(triangles);
    next_step_ = Step::begin;
  }

  /// Takes the next selection, which may change once the call returns.
  /// counts[n]; vertex_offsets[n+1], triangle_offsets[n+1]: as lay_out writes them, totals within the room reserved.
  /// O(n).
  void begin(std::span<const std::uint32_t> counts, std::span<const std::uint64_t> vertex_offsets,
             std::span<const std::uint64_t> triangle_offsets) {
    PGL_ASSERT(next_step_ == Step::begin);
    next_step_ = Step::send;
    PGL_ASSERT(counts.size() == this->counts().size());
    PGL_ASSERT(vertex_offsets.size() == counts.size() + 1 && triangle_offsets.size() == counts.size() + 1);
    PGL_ASSERT(vertex_offsets.back() <= vertices_.size() && triangle_offsets.back() <= triangles_.size());
    current_ = 1 - current_;
    Selection& next = selections_[current_];
    std::ranges::copy(counts, next.counts.begin());
    std::ranges::copy(vertex_offsets, next.vertex_offsets.begin());
    std::ranges::copy(triangle_offsets, next.triangle_offsets.begin());
    const Selection& last = selections_[1 - current_];
    lay_out_delta(last.vertex_offsets, next.vertex_offsets, vertex_delta_);
    lay_out_delta(last.triangle_offsets, next.triangle_offsets, triangle_delta_);
  }

  /// Collects what is new from the model: meshes, objects, vertices and triangles are those of the scene, the same as
  /// in every frame since reserve(). Returns how much it is. O(n + what is new).
  DeltaSize send(std::span<const Mesh> meshes, std::span<const Object> objects, std::span<const Vertex> vertices,
                 std::span<const Triangle<Index>> triangles) {
    PGL_ASSERT(next_step_ == Step::send);
    next_step_ = Step::apply;
    const Selection &last = selections_[1 - current_], &next = selections_[current_];
    const DeltaSize size{vertex_delta_.back(), triangle_delta_.back(),
                         vertex_delta_.back() * sizeof(Vertex) + triangle_delta_.back() * sizeof(Triangle<Index>)};
    if (new_vertices_.size() < size.vertices) new_vertices_.resize(size.vertices);
    if (new_triangles_.size() < size.triangles) new_triangles_.resize(size.triangles);
    pack_delta<Vertex>(meshes, objects, &Mesh::first_vertex, vertices, last.vertex_offsets, next.vertex_offsets,
                       vertex_delta_, new_vertices_);
    pack_delta<Triangle<Index>>(meshes, objects, &Mesh::first_triangle, triangles, last.triangle_offsets,
                                next.triangle_offsets, triangle_delta_, new_triangles_);
    return size;
  }

  /// Brings the blocks up to the selection. O(n + elements that move or are new).
  void apply() {
    PGL_ASSERT(next_step_ == Step::apply);
    next_step_ = Step::begin;
    const Selection &last = selections_[1 - current_], &next = selections_[current_];
    defragment_in_place<Vertex>(last.vertex_offsets, next.vertex_offsets, vertex_delta_, new_vertices_, workspace_,
                                vertices_);
    defragment_in_place<Triangle<Index>>(last.triangle_offsets, next.triangle_offsets, triangle_delta_, new_triangles_,
                                         workspace_, triangles_);
  }

  /// The selection of the last begin(); before the first one, nothing of every object.
  std::span<const std::uint32_t> counts() const { return selections_[current_].counts; }
  std::span<const std::uint64_t> vertex_offsets() const { return selections_[current_].vertex_offsets; }
  std::span<const std::uint64_t> triangle_offsets() const { return selections_[current_].triangle_offsets; }

  /// The blocks, with all the room that they have.
  std::span<const Vertex> vertices() const { return vertices_; }
  std::span<const Triangle<Index>> triangles() const { return triangles_; }

 private:
  enum class Step : std::uint8_t { begin, send, apply };
  struct Selection {
    std::vector<std::uint32_t> counts;
    std::vector<std::uint64_t> vertex_offsets, triangle_offsets;
  };

  Selection selections_[2];
  int current_ = 0;
  Step next_step_ = Step::begin;  // checked in debug builds
  std::vector<std::uint64_t> vertex_delta_, triangle_delta_;
  std::vector<Vertex> vertices_, new_vertices_;
  std::vector<Triangle<Index>> triangles_, new_triangles_;
  DefragmentWorkspace workspace_;
};

}  // namespace pgl::host
