// SPDX-License-Identifier: MIT
// The one vertex buffer and the one index buffer of a frame, in OpenGL.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/gather.hpp"
#include "pgl/types.hpp"

namespace pgl::viewer {

/// What one draw call draws. Its contents come from upload(), or from whoever writes into the buffers by their names
/// and then says so with set_drawn(). Needs a current OpenGL 3.3 context from its construction to its destruction.
/// Throws std::runtime_error when OpenGL reports an error, or when the triangles are too many for one draw call.
class DrawBuffers {
 public:
  DrawBuffers();
  ~DrawBuffers();
  DrawBuffers(const DrawBuffers&) = delete;
  DrawBuffers& operator=(const DrawBuffers&) = delete;

  /// Replaces what is drawn. The indices count in `vertices`.
  void upload(std::span<const PlacedVertex> vertices, std::span<const Triangle<std::uint32_t>> triangles);

  /// Tells whether the buffers have room for so much, and some at least: what make_room() leaves does.
  bool has_room(std::size_t vertices, std::size_t triangles) const;
  /// Makes such room, by half more than before where a buffer grows, or exactly. Nothing is drawn until set_drawn().
  void make_room(std::size_t vertices, std::size_t triangles, bool exactly = false);
  /// Says how much of the buffers is drawn from now on. Precondition: has_room().
  void set_drawn(std::size_t vertices, std::size_t triangles);

  unsigned vertex_buffer() const { return vertex_buffer_; }  ///< OpenGL's name of the PlacedVertex array
  unsigned index_buffer() const { return index_buffer_; }    ///< OpenGL's name of the Triangle<std::uint32_t> array
  std::size_t vertices() const { return vertices_; }         ///< drawn
  std::size_t triangles() const { return triangles_; }       ///< drawn

  /// The draw call, with the program that is in use.
  void draw() const;

  /// The 64-bit FNV-1a hash of the drawn vertices, then of the drawn triangles, as they lie in the buffers: of
  /// everything that upload() or another writer made of a frame. Reads the buffers back.
  std::uint64_t checksum() const;

 private:
  void bind() const;  ///< another's may be bound

  unsigned vertex_array_ = 0, vertex_buffer_ = 0, index_buffer_ = 0;
  std::size_t vertices_ = 0, triangles_ = 0;
  std::size_t vertex_room_ = 0, triangle_room_ = 0;
};

}  // namespace pgl::viewer
