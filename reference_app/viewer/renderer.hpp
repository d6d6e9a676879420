// SPDX-License-Identifier: MIT
// Draws a frame with OpenGL 3.3: one vertex buffer, one index buffer, one draw call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "pgl/balance.hpp"
#include "pgl/types.hpp"
#include "viewer/buffers.hpp"
#include "viewer/camera.hpp"
#include "viewer/output.hpp"

namespace pgl::viewer {

/// What draw_reference() paints an object as, where its vertices say so in PlacedVertex::object.
enum class Role : std::uint32_t { drawn, occluder, beside };

/// The tile that is a whole picture.
inline Tile whole(int width, int height) {
  return {0, 0, static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height)};
}

/// Needs a current OpenGL context from its construction to its destruction. Every function throws std::runtime_error
/// when OpenGL reports an error.
class Renderer {
 public:
  Renderer();
  ~Renderer();
  Renderer(const Renderer&) = delete;
  Renderer& operator=(const Renderer&) = delete;

  /// Makes a picture of that size to draw into, with so many samples a pixel (1: at its centre) where the driver and
  /// memory (32 megapixels) allow. Without it, draw() goes to the window. The picture is a texture beside what is drawn
  /// into; resolve() brings it there.
  void draw_offscreen(int width, int height, int samples);

  /// What draw() draws.
  DrawBuffers& buffers() { return buffers_; }

  /// Draws the triangles of buffers() on a background and, if told to, waits until the picture is there.
  /// `extent`: the size of the model, the unit of the haze.
  /// With a tile, only that part of the picture: its pixels are those of the whole drawn at once, if no triangle that
  /// touches them is missing. What was drawn elsewhere means nothing after this: with several samples a pixel, drivers
  /// were seen to draw some of those next to the tile too.
  void draw(const View& view, const Camera& camera, double extent, bool wireframe, bool wait = true,
            const std::optional<Tile>& tile = {});

  /// Draws the triangles of buffers(), whose vertices have a Role for their object, in muted colours; over them the
  /// edges of the frustum of `seen`, and those of `boxes` in red: full where they are in front, faint where not.
  void draw_reference(const View& view, const Camera& camera, double extent, const View& seen,
                      std::span<const Box> boxes);

  /// The last picture: of draw_offscreen's size, or of the window's back buffer of this size.
  Image read(int width, int height);

  // Of the picture that draw_offscreen() made. Preconditions: it did; tiles lie in it.

  /// OpenGL's name of the texture, GL_TEXTURE_2D of GL_RGBA8. It is another after draw_offscreen().
  unsigned picture() const { return picture_; }
  /// Brings what was drawn in a tile into the picture.
  void resolve(const Tile& tile);
  /// Copies a tile of the picture: 4 bytes a pixel (red, green, blue, alpha), row after row, the lowest first, with
  /// nothing between. Precondition: bytes is as large.
  void read_tile(const Tile& tile, std::span<std::byte> bytes);
  void write_tile(const Tile& tile, std::span<const std::byte> bytes);
  /// Reads a part of the picture. Unlike read(), which resolves first.
  Image read_picture(const Tile& part);
  /// Copies a part of the picture to the window's back buffer, from whose lower left corner on it lies.
  void present(const Tile& part);

  const std::string& vendor() const { return vendor_; }
  const std::string& renderer() const { return renderer_; }
  const std::string& version() const { return version_; }
  int samples() const { return samples_; }

 private:
  struct Program {
    unsigned name = 0;
    int clip_from_eye = -1, eye = -1, up = -1, key = -1, haze = -1, haze_start = -1, scale = -1;
  };
  enum class Style { shaded, wireframe, roles };
  static Program build(Style style);
  void begin(const View& view) const;
  void draw_triangles(const Program& program, const View& view, const Camera& camera, double extent) const;
  void free_offscreen();

  DrawBuffers buffers_;
  Program shaded_, wire_, roles_;
  unsigned draw_framebuffer_ = 0, read_framebuffer_ = 0;
  unsigned draw_color_ = 0, draw_depth_ = 0, picture_ = 0;
  int samples_ = 0;
  std::string vendor_, renderer_, version_;
};

}  // namespace pgl::viewer
