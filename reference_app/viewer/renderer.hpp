// SPDX-License-Identifier: MIT
// Draws a frame with OpenGL 3.3: one vertex buffer, one index buffer, one draw call.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "pgl/types.hpp"
#include "viewer/buffers.hpp"
#include "viewer/camera.hpp"
#include "viewer/output.hpp"

namespace pgl::viewer {

/// What draw_reference() paints an object as, where its vertices say so in PlacedVertex::object.
enum class Role : std::uint32_t { drawn, occluder, beside };

/// Needs a current OpenGL context from its construction to its destruction. Every function throws std::runtime_error
/// when OpenGL reports an error.
class Renderer {
 public:
  Renderer();
  ~Renderer();
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// Makes a picture of that size to draw into, with so many samples a pixel (1: at its centre) where the driver and
  /// memory (32 megapixels) allow. Without it, draw() goes to the window.
  void draw_offscreen(int width, int height, int samples);

  /// What draw() draws.
  DrawBuffers& buffers() { return buffers_; }

  /// Draws the triangles of buffers() on a background and, if told to, waits until the picture is there.
  /// `extent`: the size of the model, the unit of the haze.
  void draw(const View& view, const Camera& camera, double extent, bool wireframe, bool wait = true);

  /// Draws the triangles of buffers(), whose vertices have a Role for their object, in muted colours; over them the
  /// edges of the frustum of `seen`, and those of `boxes` in red: full where they are in front, faint where not.
  void draw_reference(const View& view, const Camera& camera, double extent, const View& seen,
                      std::span<const Box> boxes);

  /// The last picture: of draw_offscreen's size, or of the window's back buffer of this size.
  Image read(int width, int height);

  const std::string& vendor() const { return vendor_; }
  const std::string& renderer() const { return renderer_; }
  const std::string& version() const { return version_; }
  int samples() const { return samples_; }

 private:
  struct Program {
    unsigned name = 0;
    int clip_from_world = -1, eye = -1, up = -1, key = -1, haze = -1, haze_start = -1, scale = -1;
  };
  enum class Style { shaded, wireframe, roles };
  static Program build(Style style);
  void begin(const View& view) const;
  void draw_triangles(const Program& program, const View& view, const Camera& camera, double extent) const;
  void free_offscreen();

  DrawBuffers buffers_;
  Program shaded_, wire_, roles_;
  unsigned draw_framebuffer_ = 0, read_framebuffer_ = 0;
  unsigned draw_color_ = 0, draw_depth_ = 0, read_color_ = 0;
  int samples_ = 0;
  std::string vendor_, renderer_, version_;
};

}  // namespace pgl::viewer
