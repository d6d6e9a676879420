// SPDX-License-Identifier: MIT
// How the programs tell people something.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>

namespace pgl::scene {

/// Writes one line to stderr, after the name of the program. It stays one, even where a file's name has several.
inline void tell(const char* program, std::string message) {
  std::ranges::replace(message, '\n', ' ');
  std::fprintf(stderr, "%s: %s\n", program, message.c_str());
}

/// As "1,234,567".
inline std::string grouped(std::uint64_t number) {
  std::string text = std::to_string(number);
  for (std::size_t at = text.size(); at > 3;) text.insert(at -= 3, 1, ',');
  return text;
}

}  // namespace pgl::scene
