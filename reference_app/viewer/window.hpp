// SPDX-License-Identifier: MIT
// A window with a camera that the mouse and the keys move.
#pragma once

#include <cstdint>
#include <string>

#include "viewer/camera.hpp"

struct GLFWwindow;

namespace pgl::viewer {

/// What keys printed by `controls` mean; shown once when the window opens.
inline constexpr const char* controls =
    "left drag: orbit, right drag: look, middle drag: pan, wheel: nearer or farther, W A S D Q E: fly (shift: faster)\n"
    "up, down or +, -: budget, X: wireframe, R: camera back, P: picture, Esc: quit";

/// What the person at the window chose.
struct WindowState {
  Camera camera;
  std::uint64_t budget = 0;
  bool wireframe = false;
  bool take_picture = false;  ///< set by P; the caller clears it
};

class Window {
 public:
  /// Tells whether there is a display to open a window on.
  static bool available();

  /// Opens a hidden window with an OpenGL 3.3 core context, current on this thread, with at most so many samples a
  /// pixel (1: at its centre). Throws NoContext (context.hpp).
  Window(int width, int height, int samples);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  /// Shows the window. `state` is what the keys and the mouse change from now on and must outlive the window;
  /// `scene_size` scales the steps of flying, `largest_budget` is where the budget keys stop.
  void show(WindowState& state, double scene_size, std::uint64_t largest_budget);

  /// Handles what came in since the last call; if nothing moves, first waits for something to come, at most so many
  /// seconds. Returns false when the window is to be closed.
  bool handle_events(double most_seconds);

  void set_title(const std::string& title);
  void size(int& width, int& height) const;  ///< in pixels
  void present();                            ///< shows the drawn picture

 private:
  void key(int key, int action);
  void cursor(double x, double y);
  bool fly();

  GLFWwindow* window_ = nullptr;
  WindowState* state_ = nullptr;
  Camera home_;
  double scene_size_ = 1.0;
  std::uint64_t largest_budget_ = 0;
  double last_x_ = 0.0, last_y_ = 0.0, last_time_ = 0.0;
};

}  // namespace pgl::viewer
