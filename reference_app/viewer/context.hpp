// SPDX-License-Identifier: MIT
// An OpenGL 3.3 core context without a window.
#pragma once

#include <stdexcept>

namespace pgl::viewer {

/// This machine has nothing to draw with.
struct NoContext : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A context for offscreen drawing through EGL: on the graphics device that is CUDA's device of that number, else on
/// the first that gives one, else on Mesa's surfaceless platform, which draws on the CPU. It has no default
/// framebuffer. Current on the thread that made it.
class OffscreenContext {
 public:
  /// cuda_device: -1 for any. Throws NoContext.
  explicit OffscreenContext(int cuda_device = -1);
  ~OffscreenContext();
  OffscreenContext(const OffscreenContext&) = delete;
  OffscreenContext& operator=(const OffscreenContext&) = delete;

 private:
  bool open(void* display);
  void* display_ = nullptr;
  void* context_ = nullptr;
};

}  // namespace pgl::viewer
