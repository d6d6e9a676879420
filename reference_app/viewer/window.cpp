// SPDX-License-Identifier: MIT
// A window with a camera that the mouse and the keys move.
#include "viewer/window.hpp"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "viewer/context.hpp"

namespace pgl::viewer {

bool Window::available() {
  auto set = [](const char* name) {
    const char* value = std::getenv(name);
    return value != nullptr && *value != '\0';
  };
  return (set("DISPLAY") || set("WAYLAND_DISPLAY")) && glfwInit() == GLFW_TRUE;
}

Window::Window(int width, int height, int samples) {
  glfwInit();
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_SAMPLES, samples == 1 ? 0 : samples);
  glfwWindowHint(GLFW_VISIBLE, GLFW_FALSE);
  window_ = glfwCreateWindow(width, height, "pgl", nullptr, nullptr);
  if (window_ == nullptr) {
    const char* why = nullptr;
    glfwGetError(&why);
    const std::string text = why != nullptr ? why : "unknown reason";
    glfwTerminate();
    throw NoContext("cannot open a window: " + text);
  }
  glfwMakeContextCurrent(window_);
  glfwSwapInterval(1);
}

Window::~Window() {
  glfwDestroyWindow(window_);
  glfwTerminate();
}

void Window::show(WindowState& state, double scene_size, std::uint64_t largest_budget) {
  state_ = &state;
  home_ = state.camera;
  scene_size_ = scene_size;
  largest_budget_ = largest_budget;
  glfwSetWindowUserPointer(window_, this);
  glfwSetKeyCallback(window_, [](GLFWwindow* w, int key, int, int action, int) {
    static_cast<Window*>(glfwGetWindowUserPointer(w))->key(key, action);
  });
  glfwSetCursorPosCallback(window_, [](GLFWwindow* w, double x, double y) {
    static_cast<Window*>(glfwGetWindowUserPointer(w))->cursor(x, y);
  });
  glfwSetScrollCallback(window_, [](GLFWwindow* w, double, double up) {
    zoom(static_cast<Window*>(glfwGetWindowUserPointer(w))->state_->camera, std::pow(0.9, up));
  });
  glfwGetCursorPos(window_, &last_x_, &last_y_);
  last_time_ = glfwGetTime();
  glfwShowWindow(window_);
}

void Window::key(int key, int action) {
  if (action == GLFW_RELEASE) return;
  switch (key) {
    case GLFW_KEY_ESCAPE:
      glfwSetWindowShouldClose(window_, GLFW_TRUE);
      break;
    case GLFW_KEY_UP:
    case GLFW_KEY_EQUAL:
    case GLFW_KEY_KP_ADD:
      state_->budget = std::min(largest_budget_, state_->budget + std::max<std::uint64_t>(state_->budget / 4, 100));
      break;
    case GLFW_KEY_DOWN:
    case GLFW_KEY_MINUS:
    case GLFW_KEY_KP_SUBTRACT:
      state_->budget -= state_->budget > 100 ? state_->budget / 5 : state_->budget;
      break;
    case GLFW_KEY_X:
      state_->wireframe = !state_->wireframe;
      break;
    case GLFW_KEY_R:
      state_->camera = home_;
      break;
    case GLFW_KEY_P:
      state_->take_picture = action == GLFW_PRESS;
      break;
    default:
      break;
  }
}

void Window::cursor(double x, double y) {
  int width = 1, height = 1;
  glfwGetWindowSize(window_, &width, &height);
  const double dx = (x - last_x_) / std::max(height, 1), dy = (y - last_y_) / std::max(height, 1);
  last_x_ = x;
  last_y_ = y;
  Camera& camera = state_->camera;
  if (glfwGetMouseButton(window_, GLFW_MOUSE_BUTTON_LEFT) == GLFW_PRESS) {
    orbit(camera, -3.0 * dx, -3.0 * dy);
  } else if (glfwGetMouseButton(window_, GLFW_MOUSE_BUTTON_RIGHT) == GLFW_PRESS) {
    look(camera, -1.5 * dx, -1.5 * dy);
  } else if (glfwGetMouseButton(window_, GLFW_MOUSE_BUTTON_MIDDLE) == GLFW_PRESS) {
    const double scale =
        2.0 * glm::distance(camera.eye, camera.target) * std::tan(glm::radians(camera.fov_degrees) / 2.0);
    move(camera, {-dx * scale, dy * scale, 0.0});
  }
}

bool Window::fly() {
  const double now = glfwGetTime();
  const double seconds = std::min(now - last_time_, 0.1);
  last_time_ = now;
  auto held = [&](int key) { return glfwGetKey(window_, key) == GLFW_PRESS ? 1.0 : 0.0; };
  const glm::dvec3 way(held(GLFW_KEY_D) - held(GLFW_KEY_A), held(GLFW_KEY_E) - held(GLFW_KEY_Q),
                       held(GLFW_KEY_W) - held(GLFW_KEY_S));
  if (way == glm::dvec3(0.0)) return false;
  move(state_->camera, way * (seconds * scene_size_ * (held(GLFW_KEY_LEFT_SHIFT) != 0.0 ? 0.5 : 0.1)));
  return true;
}

bool Window::handle_events(double most_seconds) {
  if (fly() || !(most_seconds > 0.0)) {
    glfwPollEvents();
  } else {
    glfwWaitEventsTimeout(most_seconds);
    last_time_ = glfwGetTime();
  }
  return glfwWindowShouldClose(window_) == GLFW_FALSE;
}

void Window::set_title(const std::string& title) {
  glfwSetWindowTitle(window_, title.c_str());
}
void Window::size(int& width, int& height) const {
  glfwGetFramebufferSize(window_, &width, &height);
}
void Window::present() {
  glfwSwapBuffers(window_);
}

}  // namespace pgl::viewer
