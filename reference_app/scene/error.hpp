// SPDX-License-Identifier: MIT
// The one exception of scene building: a line that names the file (or option) and says what is wrong with it.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

namespace pgl::scene {

/// what() is one line, "SUBJECT: reason"; programs print it and exit non-zero.
/// Line breaks and other control characters in either part are replaced by spaces.
class Error : public std::runtime_error {
 public:
  /// The subject is a file, or what else the reason is about, such as an option.
  Error(const std::filesystem::path& subject, std::string_view reason)
      : std::runtime_error(line(subject.native(), reason)) {}

 private:
  static std::string line(std::string_view subject, std::string_view reason) {
    std::string text;
    text.append(subject).append(": ").append(reason);
    for (char& c : text)
      if (static_cast<unsigned char>(c) < 32 || c == 127) c = ' ';
    while (!text.empty() && text.back() == ' ') text.pop_back();
    return text;
  }
};

}  // namespace pgl::scene
