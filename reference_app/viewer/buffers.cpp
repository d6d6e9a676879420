// SPDX-License-Identifier: MIT
// The one vertex buffer and the one index buffer of a frame, in OpenGL.
#include "viewer/buffers.hpp"

#include <epoxy/gl.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "viewer/output.hpp"

namespace pgl::viewer {

namespace {

void refuse_too_many(std::size_t triangles) {
  if (triangles > std::numeric_limits<GLsizei>::max() / 3) {
    throw std::runtime_error("OpenGL: one draw call cannot draw " + std::to_string(triangles) +
                             " triangles: lower --budget");
  }
}

void fill_buffer(GLenum target, std::size_t bytes, const void* data, GLenum usage, const char* what) {
  glBufferData(target, static_cast<GLsizeiptr>(bytes), data, usage);
  if (glGetError() != GL_NO_ERROR) {
    throw std::runtime_error(std::string("OpenGL: the driver refuses the ") + what + " buffer of " +
                             std::to_string(bytes >> 20) + " MiB: lower --budget");
  }
}

/// Continues the hash over the first bytes of a buffer, read in pieces.
std::uint64_t hash_buffer(GLenum target, std::size_t bytes, std::uint64_t hash) {
  constexpr std::size_t piece = std::size_t{1} << 24;
  std::vector<std::byte> read(std::min(bytes, piece));
  for (std::size_t at = 0; at < bytes; at += piece) {
    const std::span<std::byte> part = std::span(read).first(std::min(piece, bytes - at));
    glGetBufferSubData(target, static_cast<GLintptr>(at), static_cast<GLsizeiptr>(part.size()), part.data());
    hash = fnv1a(part, hash);
  }
  if (glGetError() != GL_NO_ERROR) throw std::runtime_error("OpenGL: the driver does not give the buffers back");
  return hash;
}

}  // namespace

DrawBuffers::DrawBuffers() {
  glGenVertexArrays(1, &vertex_array_);
  glGenBuffers(1, &vertex_buffer_);
  glGenBuffers(1, &index_buffer_);
  bind();
  glEnableVertexAttribArray(0);
  glEnableVertexAttribArray(1);
  constexpr GLsizei stride = sizeof(PlacedVertex);
  glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, stride, nullptr);
  glVertexAttribIPointer(1, 1, GL_UNSIGNED_INT, stride, reinterpret_cast<void*>(offsetof(PlacedVertex, object)));
  if (glGetError() != GL_NO_ERROR) throw std::runtime_error("OpenGL: the driver refuses buffers");
}

DrawBuffers::~DrawBuffers() {
  glDeleteBuffers(1, &vertex_buffer_);
  glDeleteBuffers(1, &index_buffer_);
  glDeleteVertexArrays(1, &vertex_array_);
}

void DrawBuffers::bind() const {
  glBindVertexArray(vertex_array_);
  glBindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
  glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, index_buffer_);
}

void DrawBuffers::upload(std::span<const PlacedVertex> vertices, std::span<const Triangle<std::uint32_t>> triangles) {
  refuse_too_many(triangles.size());
  bind();
  fill_buffer(GL_ARRAY_BUFFER, vertices.size_bytes(), vertices.data(), GL_STREAM_DRAW, "vertex");
  fill_buffer(GL_ELEMENT_ARRAY_BUFFER, triangles.size_bytes(), triangles.data(), GL_STREAM_DRAW, "index");
  vertices_ = vertex_room_ = vertices.size();
  triangles_ = triangle_room_ = triangles.size();
}

bool DrawBuffers::has_room(std::size_t vertices, std::size_t triangles) const {
  return std::max<std::size_t>(vertices, 1) <= vertex_room_ && std::max<std::size_t>(triangles, 1) <= triangle_room_;
}

void DrawBuffers::make_room(std::size_t vertices, std::size_t triangles, bool exactly) {
  refuse_too_many(triangles);
  vertices_ = triangles_ = 0;
  bind();
  const auto grow = [exactly](GLenum target, std::size_t& room, std::size_t wanted, std::size_t size,
                              const char* what) {
    if (std::max<std::size_t>(wanted, 1) <= room) return;
    const std::size_t more =
        exactly ? std::max(wanted, std::size_t{1}) : std::max({wanted, room + room / 2, std::size_t{1024}});
    room = 0;  // should it fail
    fill_buffer(target, more * size, nullptr, GL_DYNAMIC_DRAW, what);
    room = more;
  };
  grow(GL_ARRAY_BUFFER, vertex_room_, vertices, sizeof(PlacedVertex), "vertex");
  grow(GL_ELEMENT_ARRAY_BUFFER, triangle_room_, triangles, sizeof(Triangle<std::uint32_t>), "index");
}

void DrawBuffers::set_drawn(std::size_t vertices, std::size_t triangles) {
  refuse_too_many(triangles);
  vertices_ = vertices;
  triangles_ = triangles;
}

void DrawBuffers::draw() const {
  bind();
  glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(triangles_ * 3), GL_UNSIGNED_INT, nullptr);
}

std::uint64_t DrawBuffers::checksum() const {
  bind();
  const std::uint64_t hash = hash_buffer(GL_ARRAY_BUFFER, vertices_ * sizeof(PlacedVertex), fnv1a_start);
  return hash_buffer(GL_ELEMENT_ARRAY_BUFFER, triangles_ * sizeof(Triangle<std::uint32_t>), hash);
}

}  // namespace pgl::viewer
