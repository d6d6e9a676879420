// SPDX-License-Identifier: MIT
// Draws a frame with OpenGL 3.3.
#include "viewer/renderer.hpp"

#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <glm/gtc/type_ptr.hpp>

namespace pgl::viewer {

namespace {

constexpr const char* vertex_shader = R"(
layout(location = 0) in vec3 position;
layout(location = 1) in uint object;
uniform mat4 clip_from_eye;  // from the world's axes at the eye: far from the world's origin this is more precise
uniform vec3 eye;
uniform float scale;  // lengths in the shaders are in sizes of the model
out Surface {
  vec3 from_eye;
  flat uint object;
} surface;
void main() {
  vec3 from_eye = position - eye;
  surface.from_eye = from_eye * scale;
  surface.object = object;
  gl_Position = clip_from_eye * vec4(from_eye, 1.0);
}
)";

// Only for the wireframe: tells the fragments where in their triangle they are.
constexpr const char* geometry_shader = R"(
layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;
in Surface {
  vec3 from_eye;
  flat uint object;
} corner[];
out Surface {
  vec3 from_eye;
  flat uint object;
} surface;
out vec3 barycentric;
void main() {
  for (int i = 0; i < 3; ++i) {
    surface.from_eye = corner[i].from_eye;
    surface.object = corner[i].object;
    barycentric = vec3(i == 0, i == 1, i == 2);
    gl_Position = gl_in[i].gl_Position;
    EmitVertex();
  }
  EndPrimitive();
}
)";

constexpr const char* fragment_shader = R"(
in Surface {
  vec3 from_eye;
  flat uint object;
} surface;
#ifdef WIREFRAME
in vec3 barycentric;
#endif
uniform vec3 up;
uniform vec3 key;   // towards the key light
uniform vec3 haze;  // its colour
uniform float haze_start;
out vec4 color;

// Muted paints, in display values.
const vec3 palette[12] = vec3[12](
  vec3(0.29, 0.45, 0.58), vec3(0.78, 0.55, 0.38), vec3(0.47, 0.60, 0.47), vec3(0.72, 0.42, 0.38),
  vec3(0.83, 0.72, 0.48), vec3(0.40, 0.55, 0.60), vec3(0.62, 0.50, 0.60), vec3(0.66, 0.68, 0.70),
  vec3(0.55, 0.62, 0.40), vec3(0.36, 0.40, 0.50), vec3(0.80, 0.62, 0.56), vec3(0.58, 0.70, 0.74));

// Drawn, occluder, beside: as Role.
const vec3 roles[3] = vec3[3](vec3(0.60, 0.62, 0.64), vec3(0.56, 0.28, 0.77), vec3(0.76, 0.78, 0.80));

uint mixed(uint x) {  // Wellons' lowbias32
  x ^= x >> 16; x *= 0x7feb352du;
  x ^= x >> 15; x *= 0x846ca68bu;
  return x ^ (x >> 16);
}

void main() {
#ifdef ROLES
  vec3 paint = roles[min(surface.object, 2u)];
#else
  uint h = mixed(surface.object + 1u);
  vec3 paint = palette[h % 12u] * (0.9 + 0.2 * float((h >> 8) & 255u) / 255.0);
#endif
  vec3 albedo = pow(paint, vec3(2.2));

  // The face's normal, on the side that is seen; a face seen edge-on has none and takes the direction to the eye.
  vec3 n = cross(dFdx(surface.from_eye), dFdy(surface.from_eye));
  float size = length(n);
  vec3 to_eye = -normalize(surface.from_eye);
  n = size > 0.0 ? n / size : to_eye;

  vec3 sky = mix(vec3(0.24, 0.22, 0.20), vec3(0.46, 0.52, 0.60), 0.5 + 0.5 * dot(n, up));
  vec3 light = sky + vec3(0.84, 0.80, 0.73) * max(dot(n, key), 0.0);
  float gloss = pow(max(dot(n, normalize(key + to_eye)), 0.0), 40.0);
  vec3 lit = albedo * light + 0.06 * gloss;
#ifndef ROLES
  lit = mix(lit, haze, 1.0 - exp(-0.22 * max(length(surface.from_eye) - haze_start, 0.0)));
#endif
#ifdef WIREFRAME
  vec3 pixels = barycentric / max(fwidth(barycentric), vec3(1e-6));
  float line = 1.0 - smoothstep(0.2, 1.0, min(min(pixels.x, pixels.y), pixels.z));
  lit = mix(mix(lit, vec3(0.9), 0.35), vec3(0.015, 0.02, 0.03), 0.85 * line);
#endif
  color = vec4(pow(lit, vec3(1.0 / 2.2)), 1.0);
}
)";

// Boxes, one an instance: 12 edges of two ends, each end a corner with bit 0 for x, bit 1 for y, bit 2 for z.
constexpr const char* edge_vertex_shader = R"(
layout(location = 0) in vec3 low;
layout(location = 1) in vec3 high;
uniform mat4 clip_from_world;
const int corners[24] = int[24](0, 1, 2, 3, 4, 5, 6, 7,  0, 2, 1, 3, 4, 6, 5, 7,  0, 4, 1, 5, 2, 6, 3, 7);
void main() {
  int corner = corners[gl_VertexID];
  gl_Position = clip_from_world * vec4(mix(low, high, vec3(corner & 1, (corner >> 1) & 1, corner >> 2)), 1.0);
}
)";

// Lines of any width, which OpenGL does not promise: each a strip across the screen, cut at the near plane first.
constexpr const char* edge_geometry_shader = R"(
layout(lines) in;
layout(triangle_strip, max_vertices = 4) out;
uniform vec2 size;   // of the picture, pixels
uniform float width; // of the line, pixels
void main() {
  vec4 a = gl_in[0].gl_Position, b = gl_in[1].gl_Position;
  float in_a = a.z + a.w, in_b = b.z + b.w;
  if (in_a <= 0.0 && in_b <= 0.0) return;
  if (in_a < 0.0) a = mix(a, b, in_a / (in_a - in_b));
  if (in_b < 0.0) b = mix(b, a, in_b / (in_b - in_a));
  if (a.w <= 0.0 || b.w <= 0.0) return;
  vec2 along = (b.xy / b.w - a.xy / a.w) * size;
  float reach = length(along);
  along = reach > 0.0 ? along / reach : vec2(1.0, 0.0);
  vec2 across = vec2(-along.y, along.x) * width / size;
  gl_Position = vec4(a.xy + across * a.w, a.zw); EmitVertex();
  gl_Position = vec4(a.xy - across * a.w, a.zw); EmitVertex();
  gl_Position = vec4(b.xy + across * b.w, b.zw); EmitVertex();
  gl_Position = vec4(b.xy - across * b.w, b.zw); EmitVertex();
  EndPrimitive();
}
)";

constexpr const char* edge_fragment_shader = R"(
uniform vec4 paint;
out vec4 color;
void main() { color = paint; }
)";

const glm::vec3 background(0.87f, 0.905f, 0.935f);  // display values

const char* error_name(GLenum error) {
  switch (error) {
    case GL_INVALID_ENUM:
      return "invalid enum";
    case GL_INVALID_VALUE:
      return "invalid value";
    case GL_INVALID_OPERATION:
      return "invalid operation";
    case GL_INVALID_FRAMEBUFFER_OPERATION:
      return "invalid framebuffer operation";
    case GL_OUT_OF_MEMORY:
      return "out of memory";
    default:
      return "unknown error";
  }
}

void check(const std::string& doing) {
  const GLenum error = glGetError();
  if (error != GL_NO_ERROR) throw std::runtime_error("OpenGL: " + std::string(error_name(error)) + " while " + doing);
}

GLuint compile(GLenum stage, const char* text, const char* define) {
  const GLuint shader = glCreateShader(stage);
  const std::array<const char*, 3> parts = {"#version 330 core\n", define, text};
  glShaderSource(shader, static_cast<GLsizei>(parts.size()), parts.data(), nullptr);
  glCompileShader(shader);
  GLint good = GL_FALSE;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
  if (good != GL_TRUE) {
    std::array<char, 512> log{};
    glGetShaderInfoLog(shader, static_cast<GLsizei>(log.size()), nullptr, log.data());
    throw std::runtime_error(std::string("OpenGL: the driver refuses a shader: ") + log.data());
  }
  return shader;
}

std::string text_of(GLenum name) {
  const GLubyte* text = glGetString(name);
  return text != nullptr ? reinterpret_cast<const char*>(text) : "";
}

/// A program of these stages, of which the middle one may be null; `define` begins each text.
GLuint link(const char* vertex, const char* geometry, const char* fragment, const char* define) {
  const GLuint program = glCreateProgram();
  auto add = [&](GLenum stage, const char* text) {
    const GLuint shader = compile(stage, text, define);
    glAttachShader(program, shader);
    glDeleteShader(shader);  // freed with the program
  };
  add(GL_VERTEX_SHADER, vertex);
  if (geometry != nullptr) add(GL_GEOMETRY_SHADER, geometry);
  add(GL_FRAGMENT_SHADER, fragment);
  glLinkProgram(program);
  GLint good = GL_FALSE;
  glGetProgramiv(program, GL_LINK_STATUS, &good);
  if (good != GL_TRUE) {
    std::array<char, 512> log{};
    glGetProgramInfoLog(program, static_cast<GLsizei>(log.size()), nullptr, log.data());
    throw std::runtime_error(std::string("OpenGL: the driver refuses the shaders: ") + log.data());
  }
  return program;
}

/// Draws the edges of boxes over what is there, and is gone.
class Edges {
 public:
  explicit Edges(const glm::vec2& size)
      : program_(link(edge_vertex_shader, edge_geometry_shader, edge_fragment_shader, "")) {
    glGenVertexArrays(1, &vertex_array_);
    glGenBuffers(1, &boxes_);
    glUseProgram(program_);
    glUniform2fv(glGetUniformLocation(program_, "size"), 1, glm::value_ptr(size));
    glDepthMask(GL_FALSE);
    glEnable(GL_DEPTH_CLAMP);  // lines may reach beyond the far plane
  }
  Edges(const Edges&) = delete;
  Edges& operator=(const Edges&) = delete;
  ~Edges() {
    glDisable(GL_BLEND);
    glDisable(GL_DEPTH_CLAMP);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glDeleteBuffers(1, &boxes_);
    glDeleteVertexArrays(1, &vertex_array_);
    glDeleteProgram(program_);
  }

  /// In front of everything as strong as `paint` says, else only `faint` of that.
  void draw(std::span<const Box> boxes, const glm::mat4& clip_from_world, const glm::vec4& paint, float faint,
            float width) const {
    if (boxes.empty()) return;
    glBindVertexArray(vertex_array_);
    glBindBuffer(GL_ARRAY_BUFFER, boxes_);
    glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(boxes.size_bytes()), boxes.data(), GL_STREAM_DRAW);
    for (GLuint end = 0; end < 2; ++end) {
      glEnableVertexAttribArray(end);
      glVertexAttribPointer(end, 3, GL_FLOAT, GL_FALSE, sizeof(Box),
                            reinterpret_cast<void*>(end == 0 ? offsetof(Box, min) : offsetof(Box, max)));
      glVertexAttribDivisor(end, 1);
    }
    glUniformMatrix4fv(glGetUniformLocation(program_, "clip_from_world"), 1, GL_FALSE, glm::value_ptr(clip_from_world));
    glUniform1f(glGetUniformLocation(program_, "width"), width);
    glEnable(GL_BLEND);
    glBlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
    for (const bool behind : {true, false}) {
      glDepthFunc(behind ? GL_GREATER : GL_LEQUAL);
      glUniform4f(glGetUniformLocation(program_, "paint"), paint.x, paint.y, paint.z,
                  behind ? paint.w * faint : paint.w);
      glDrawArraysInstanced(GL_LINES, 0, 24, static_cast<GLsizei>(boxes.size()));
    }
  }

 private:
  GLuint program_ = 0, vertex_array_ = 0, boxes_ = 0;
};

/// A tile as OpenGL takes it.
struct Area {
  explicit Area(const Tile& tile)
      : x(static_cast<GLint>(tile.x0)),
        y(static_cast<GLint>(tile.y0)),
        width(static_cast<GLsizei>(tile.x1 - tile.x0)),
        height(static_cast<GLsizei>(tile.y1 - tile.y0)) {}
  GLint x, y;
  GLsizei width, height;
};

/// Copies the colours of a tile to one of the same size elsewhere.
void copy(GLuint from, const Tile& source, GLuint to, const Tile& target) {
  const Area a(source), b(target);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, from);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, to);
  glBlitFramebuffer(a.x, a.y, a.x + a.width, a.y + a.height, b.x, b.y, b.x + b.width, b.y + b.height,
                    GL_COLOR_BUFFER_BIT, GL_NEAREST);
}

}  // namespace

Renderer::Program Renderer::build(Style style) {
  const bool wireframe = style == Style::wireframe;
  const GLuint program = link(vertex_shader, wireframe ? geometry_shader : nullptr, fragment_shader,
                              wireframe               ? "#define WIREFRAME\n"
                              : style == Style::roles ? "#define ROLES\n"
                                                      : "");
  return {program,
          glGetUniformLocation(program, "clip_from_eye"),
          glGetUniformLocation(program, "eye"),
          glGetUniformLocation(program, "up"),
          glGetUniformLocation(program, "key"),
          glGetUniformLocation(program, "haze"),
          glGetUniformLocation(program, "haze_start"),
          glGetUniformLocation(program, "scale")};
}

Renderer::Renderer() : vendor_(text_of(GL_VENDOR)), renderer_(text_of(GL_RENDERER)), version_(text_of(GL_VERSION)) {
  shaded_ = build(Style::shaded);
  glEnable(GL_DEPTH_TEST);
  glGetIntegerv(GL_SAMPLES, &samples_);
  check("setting up");
}

Renderer::~Renderer() {
  free_offscreen();
  glDeleteProgram(shaded_.name);
  glDeleteProgram(wire_.name);
  glDeleteProgram(roles_.name);
}

void Renderer::free_offscreen() {
  glDeleteFramebuffers(1, &draw_framebuffer_);
  glDeleteFramebuffers(1, &read_framebuffer_);
  glDeleteRenderbuffers(1, &draw_color_);
  glDeleteRenderbuffers(1, &draw_depth_);
  glDeleteTextures(1, &picture_);
  draw_framebuffer_ = read_framebuffer_ = draw_color_ = draw_depth_ = picture_ = 0;
}

void Renderer::draw_offscreen(int width, int height, int samples) {
  free_offscreen();
  const std::string size = std::to_string(width) + "x" + std::to_string(height);
  GLint renderbuffer = 0, texture = 0;
  std::array<GLint, 2> viewport{};
  glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &renderbuffer);
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &texture);
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport.data());
  const GLint largest = std::min({renderbuffer, texture, viewport[0], viewport[1]});
  if (width > largest || height > largest) {
    throw std::runtime_error("--size: " + size + " is larger than this driver's " + std::to_string(largest) + "x" +
                             std::to_string(largest));
  }
  GLint most_samples = 0;
  glGetIntegerv(GL_MAX_SAMPLES, &most_samples);
  samples_ = std::min(samples, most_samples);
  if (samples_ == 1 || static_cast<long>(width) * height > 32'000'000) samples_ = 0;  // none but the centre

  const auto begin = [](GLuint& framebuffer) {
    glGenFramebuffers(1, &framebuffer);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  };
  const auto end = [&] {
    check("making a picture of " + size);
    if (glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
      throw std::runtime_error("--size: the driver cannot draw a picture of " + size);
    }
  };
  begin(read_framebuffer_);
  glGenTextures(1, &picture_);
  glBindTexture(GL_TEXTURE_2D, picture_);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, width, height, 0, GL_RGBA, GL_UNSIGNED_BYTE, nullptr);
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, picture_, 0);
  end();

  begin(draw_framebuffer_);
  const auto attach = [&](GLuint& buffer, GLenum format, GLenum attachment) {
    glGenRenderbuffers(1, &buffer);
    glBindRenderbuffer(GL_RENDERBUFFER, buffer);
    glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples_, format, width, height);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachment, GL_RENDERBUFFER, buffer);
  };
  attach(draw_color_, GL_RGBA8, GL_COLOR_ATTACHMENT0);
  attach(draw_depth_, GL_DEPTH_COMPONENT32F, GL_DEPTH_ATTACHMENT);
  end();
}

void Renderer::begin(const View& view) const {
  glBindFramebuffer(GL_FRAMEBUFFER, draw_framebuffer_);
  glViewport(0, 0, static_cast<GLsizei>(view.width), static_cast<GLsizei>(view.height));
  glClearColor(background.x, background.y, background.z, 1.0f);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
}

void Renderer::draw_triangles(const Program& program, const View& view, const Camera& camera, double extent) const {
  const CameraAxes axes = axes_of(camera);
  const glm::vec3 key = glm::normalize(0.75 * camera.up - 0.5 * axes.right - 0.55 * axes.forward);
  const glm::vec3 eye(camera.eye), up(camera.up), haze = glm::pow(background, glm::vec3(2.2f));
  const float scale = extent > 1e-37 ? static_cast<float>(1.0 / extent) : 1.0f;
  // What the steps of a frame compute exactly must not be off by pixels here: tiles have the objects that touch them.
  glm::dmat4 clip_from_eye(view.clip_from_world);
  clip_from_eye[3] = clip_from_eye * glm::dvec4(eye, 1.0);
  const glm::mat4 matrix(clip_from_eye);

  glUseProgram(program.name);
  glUniformMatrix4fv(program.clip_from_eye, 1, GL_FALSE, glm::value_ptr(matrix));
  glUniform3fv(program.eye, 1, glm::value_ptr(eye));
  glUniform3fv(program.up, 1, glm::value_ptr(up));
  glUniform3fv(program.key, 1, glm::value_ptr(key));
  glUniform3fv(program.haze, 1, glm::value_ptr(haze));
  glUniform1f(program.haze_start, view.near_depth * scale);
  glUniform1f(program.scale, scale);
  buffers_.draw();
}

void Renderer::draw(const View& view, const Camera& camera, double extent, bool wireframe, bool wait,
                    const std::optional<Tile>& tile) {
  if (wireframe && wire_.name == 0) wire_ = build(Style::wireframe);
  if (tile) {
    const Area area(*tile);
    glEnable(GL_SCISSOR_TEST);
    glScissor(area.x, area.y, area.width, area.height);
  }
  begin(view);
  draw_triangles(wireframe ? wire_ : shaded_, view, camera, extent);
  glDisable(GL_SCISSOR_TEST);
  if (wait) {
    glFinish();
  } else {
    glFlush();
  }
  check("drawing");
}

void Renderer::draw_reference(const View& view, const Camera& camera, double extent, const View& seen,
                              std::span<const Box> boxes) {
  if (roles_.name == 0) roles_ = build(Style::roles);
  begin(view);
  draw_triangles(roles_, view, camera, extent);
  const float pixel = std::max(1.0f, view.height / 720.0f);
  const float strength = std::clamp(20.0f / std::sqrt(static_cast<float>(boxes.size()) + 1.0f), 0.3f, 0.8f);
  const Edges edges({view.width, view.height});
  edges.draw(boxes, view.clip_from_world, {0.86f, 0.08f, 0.08f, strength}, 0.45f, pixel);

  // The frustum is a box too, in its own clip space. In that, 1 / w is linear in z, and the box begins where it is a
  // thousand times what it is at the far plane, unless the near plane is nearer still: that looks like the eye.
  const glm::dmat4 world_from_clip = glm::inverse(glm::dmat4(seen.clip_from_world));
  const double at_near = (world_from_clip * glm::dvec4(0.0, 0.0, -1.0, 1.0)).w;
  const double at_far = (world_from_clip * glm::dvec4(0.0, 0.0, 1.0, 1.0)).w;
  const double begin = -1.0 - std::max(0.0, (1000.0 * at_far - at_near) / (0.5 * (at_near - at_far)));
  const Box clip{glm::vec3(-1.0f, -1.0f, static_cast<float>(begin)), glm::vec3(1.0f)};
  edges.draw({&clip, 1}, glm::mat4(glm::dmat4(view.clip_from_world) * world_from_clip), {0.05f, 0.07f, 0.10f, 1.0f},
             0.45f, 2.0f * pixel);
  glFinish();
  check("drawing the reference");
}

void Renderer::resolve(const Tile& tile) {
  copy(draw_framebuffer_, tile, read_framebuffer_, tile);
  check("resolving the picture");
}

void Renderer::read_tile(const Tile& tile, std::span<std::byte> bytes) {
  const Area area(tile);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, read_framebuffer_);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(area.x, area.y, area.width, area.height, GL_RGBA, GL_UNSIGNED_BYTE, bytes.data());
  check("reading a tile");
}

void Renderer::write_tile(const Tile& tile, std::span<const std::byte> bytes) {
  const Area area(tile);
  glBindTexture(GL_TEXTURE_2D, picture_);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  glTexSubImage2D(GL_TEXTURE_2D, 0, area.x, area.y, area.width, area.height, GL_RGBA, GL_UNSIGNED_BYTE, bytes.data());
  check("writing a tile");
}

void Renderer::present(const Tile& part) {
  copy(read_framebuffer_, part, 0, {0, 0, part.x1 - part.x0, part.y1 - part.y0});
  check("showing the picture");
}

Image Renderer::read(int width, int height) {
  if (draw_framebuffer_ != 0) resolve(whole(width, height));
  return read_picture(whole(width, height));
}

Image Renderer::read_picture(const Tile& part) {
  const Area area(part);
  Image image{area.width, area.height, {}};
  const std::size_t row = static_cast<std::size_t>(area.width) * 3;
  image.rgb.resize(row * static_cast<std::size_t>(area.height));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, read_framebuffer_);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(area.x, area.y, area.width, area.height, GL_RGB, GL_UNSIGNED_BYTE, image.rgb.data());
  check("reading the picture");
  for (int y = 0; y < area.height / 2; ++y) {  // OpenGL's bottom row is first
    std::uint8_t* top = image.rgb.data() + row * static_cast<std::size_t>(y);
    std::swap_ranges(top, top + row, image.rgb.data() + row * static_cast<std::size_t>(area.height - 1 - y));
  }
  return image;
}

}  // namespace pgl::viewer
