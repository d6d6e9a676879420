// SPDX-License-Identifier: MIT
// Frames that the GPU prepares. Defined where the viewer is built with CUDA.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "viewer/buffers.hpp"
#include "viewer/frame.hpp"

namespace pgl::viewer {

#if defined(PGL_VIEWER_CUDA)
inline constexpr bool built_with_cuda = true;
#else
inline constexpr bool built_with_cuda = false;
#endif

/// Chooses a CUDA device for this thread and returns its number: the first for the first of a machine's ranks, and so
/// on, from the beginning again where there are more. CUDA_VISIBLE_DEVICES says which there are, in which order.
/// Throws NoContext (context.hpp) where there is no GPU or no driver for it.
int choose_gpu(int local_rank);

/// A frame on the chosen GPU, or on the one that draws in the current OpenGL context. The model is copied to it, or
/// sent as it is needed.
/// Where the OpenGL context is of that GPU's driver (`gl_vendor` says NVIDIA), frames are written straight into
/// `buffers`; otherwise they are copied back and uploaded, and info().note says why. Throws std::runtime_error.
std::unique_ptr<AnyFrame> make_cuda_frame(const FrameModel<std::uint16_t>& model, const FrameOptions& options,
                                          DrawBuffers& buffers, const std::string& gl_vendor);
std::unique_ptr<AnyFrame> make_cuda_frame(const FrameModel<std::uint32_t>& model, const FrameOptions& options,
                                          DrawBuffers& buffers, const std::string& gl_vendor);

}  // namespace pgl::viewer
