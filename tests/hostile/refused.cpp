// SPDX-License-Identifier: MIT
// Must not compile under -ffast-math or its parts.
#include "pgl/ieee.hpp"
