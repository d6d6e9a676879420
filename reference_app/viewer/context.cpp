// SPDX-License-Identifier: MIT
// An OpenGL 3.3 core context without a window.
#include "viewer/context.hpp"

#include <epoxy/egl.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace pgl::viewer {

namespace {

bool has_extension(const char* list, const char* name) {
  return list != nullptr && std::strstr(list, name) != nullptr;
}

/// The number by which CUDA knows a graphics device, or -1.
int cuda_number(EGLDeviceEXT device) {
  EGLAttrib number = -1;
  if (!has_extension(eglQueryDeviceStringEXT(device, EGL_EXTENSIONS), "EGL_NV_device_cuda") ||
      eglQueryDeviceAttribEXT(device, EGL_CUDA_DEVICE_NV, &number) != EGL_TRUE) {
    return -1;
  }
  return static_cast<int>(number);
}

}  // namespace

bool OffscreenContext::open(void* display) {
  if (display == EGL_NO_DISPLAY || eglInitialize(display, nullptr, nullptr) != EGL_TRUE) return false;
  const std::array<EGLint, 5> want_config = {EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE, 0, EGL_NONE};
  const std::array<EGLint, 7> want_context = {
      EGL_CONTEXT_MAJOR_VERSION,           3,       EGL_CONTEXT_MINOR_VERSION, 3, EGL_CONTEXT_OPENGL_PROFILE_MASK,
      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  EGLint configs = 0;
  if (has_extension(eglQueryString(display, EGL_EXTENSIONS), "EGL_KHR_surfaceless_context") &&
      eglChooseConfig(display, want_config.data(), &config, 1, &configs) == EGL_TRUE && configs == 1 &&
      eglBindAPI(EGL_OPENGL_API) == EGL_TRUE) {
    EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, want_context.data());
    if (context != EGL_NO_CONTEXT) {
      if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context) == EGL_TRUE) {
        display_ = display;
        context_ = context;
        return true;
      }
      eglDestroyContext(display, context);
    }
  }
  eglTerminate(display);
  return false;
}

OffscreenContext::OffscreenContext(int cuda_device) {
  if (!epoxy_has_egl()) throw NoContext("cannot draw offscreen: libEGL is not installed");
  const char* client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  if (!has_extension(client, "EGL_EXT_platform_base")) throw NoContext("cannot draw offscreen: libEGL is too old");
  // Some drivers tell of both halves of device_base, some of the whole.
  if (has_extension(client, "EGL_EXT_platform_device") &&
      (has_extension(client, "EGL_EXT_device_query") || has_extension(client, "EGL_EXT_device_base"))) {
    std::array<EGLDeviceEXT, 16> devices{};
    EGLint count = 0;
    if (eglQueryDevicesEXT(static_cast<EGLint>(devices.size()), devices.data(), &count) != EGL_TRUE) count = 0;
    if (cuda_device >= 0) {  // to the front, the others as they are
      std::stable_partition(devices.begin(), devices.begin() + count,
                            [&](EGLDeviceEXT device) { return cuda_number(device) == cuda_device; });
    }
    for (EGLint i = 0; i < count; ++i) {
      if (has_extension(eglQueryDeviceStringEXT(devices[i], EGL_EXTENSIONS), "EGL_MESA_device_software")) continue;
      if (open(eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, devices[i], nullptr))) return;
    }
  }
  if (has_extension(client, "EGL_MESA_platform_surfaceless") &&
      open(eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr))) {
    return;
  }
  throw NoContext("cannot draw offscreen: EGL gives no OpenGL 3.3 context");
}

OffscreenContext::~OffscreenContext() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
  eglTerminate(display_);
}

}  // namespace pgl::viewer
