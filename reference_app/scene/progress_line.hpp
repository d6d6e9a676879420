// SPDX-License-Identifier: MIT
// Progress on stderr, for the programs that do long work.
#pragma once

#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <string_view>

namespace pgl::scene {

/// Progress on stderr, for work of more than a second: one line that changes on a terminal, else a line now and then.
class ProgressLine {
 public:
  ~ProgressLine() { clear(); }

  void operator()(std::string_view stage, std::size_t done, std::size_t total) {
    const double now = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    if (now < next_) return;
    next_ = now + (terminal_ ? 0.2 : 10.0);
    const auto percent = static_cast<int>(total == 0 ? 0 : 100.0 * static_cast<double>(done) / total);
    std::fprintf(stderr, "%s%.*s %d %%%s", terminal_ ? "\r\033[K" : "", static_cast<int>(stage.size()), stage.data(),
                 percent, terminal_ ? "" : "\n");
    shown_ = true;
  }

  void clear() {
    if (shown_ && terminal_) std::fputs("\r\033[K", stderr);
    shown_ = false;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  double next_ = 1.0;
  bool terminal_ = isatty(STDERR_FILENO) == 1;
  bool shown_ = false;
};

}  // namespace pgl::scene
