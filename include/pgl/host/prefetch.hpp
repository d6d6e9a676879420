// SPDX-License-Identifier: MIT
// A hint to the processor, where what is needed next lies anywhere in memory.
#pragma once

#include <algorithm>
#include <cstddef>

namespace pgl::host {

/// Asks for the first kilobyte, at most, of elements[0 .. size) to be brought near. From there on the processor sees
/// by itself that they are read in order. Changes nothing but time; does nothing where the compiler has no such hint.
template <class T>
inline void prefetch([[maybe_unused]] const T* elements, [[maybe_unused]] std::size_t size) {
#if defined(__GNUC__) || defined(__clang__)
  const auto* bytes = reinterpret_cast<const char*>(elements);
  const std::size_t end = std::min<std::size_t>(size * sizeof(T), 1024);
  for (std::size_t at = 0; at < end; at += 64) __builtin_prefetch(bytes + at);
#endif
}

}  // namespace pgl::host
