// SPDX-License-Identifier: MIT
// What every header needs: version, host/device marker, debug checks.
#pragma once

#define PGL_VERSION_MAJOR 0
#define PGL_VERSION_MINOR 1
#define PGL_VERSION_PATCH 0

/// Marks a rule: a function that compiles for the host and, under nvcc, for the device as well.
#if defined(__CUDACC__)
#define PGL_HD __host__ __device__
#else
#define PGL_HD
#endif

/// Checks a documented precondition in debug builds. Define it before the first pgl include to use your own.
#if !defined(PGL_ASSERT)
#include <cassert>
#define PGL_ASSERT(condition) assert(condition)
#endif
