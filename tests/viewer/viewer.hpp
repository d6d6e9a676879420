// SPDX-License-Identifier: MIT
// Runs pgl_viewer in a folder of its own and reads what it leaves there, for the tests of it.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
#include <stb/stb_image.h>
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

namespace viewer_tests {

namespace fs = std::filesystem;
using Json = nlohmann::json;

inline std::string content_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

inline void write(const fs::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

/// Without the lines that only tell how far the work is: a slow machine prints some.
inline std::string without_progress(const std::string& text) {
  std::istringstream lines(text);
  std::string kept;
  for (std::string line; std::getline(lines, line);) {
    if (!line.ends_with(" %") || line.starts_with("pgl_")) kept += line + "\n";
  }
  return kept;
}

struct Outcome {
  int code = -1;
  std::string out, err;
};

struct Picture {
  int width = 0, height = 0;
  std::vector<std::array<std::uint8_t, 3>> pixels;
  const std::array<std::uint8_t, 3>& at(int x, int y) const {
    return pixels.at(static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x));
  }
  std::size_t colors() const { return std::set(pixels.begin(), pixels.end()).size(); }
};

/// Every test has a folder of its own, where the viewer runs.
class Viewer : public testing::Test {
 protected:
  Viewer() {
    std::string name = (fs::temp_directory_path() / "pgl_viewer_test.XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    folder_ = name;
  }
  ~Viewer() override { fs::remove_all(folder_); }

  Outcome run_as(const std::string& before, const std::vector<std::string>& arguments) {
    std::string line = "cd '" + folder_.string() + "' && " + before + " '" PGL_VIEWER "'";
    for (const std::string& argument : arguments) line += " '" + argument + "'";
    line += " >../out.$$ 2>../err.$$ </dev/null; code=$?; mv ../out.$$ .stdout; mv ../err.$$ .stderr; exit $code";
    const int status = std::system(line.c_str());
    Outcome outcome{WIFEXITED(status) ? WEXITSTATUS(status) : 128, content_of(folder_ / ".stdout"),
                    without_progress(content_of(folder_ / ".stderr"))};
    fs::remove(folder_ / ".stdout");
    fs::remove(folder_ / ".stderr");
    return outcome;
  }

  /// Without any display, whatever the machine has.
  Outcome run(std::vector<std::string> arguments) {
    return run_as("env -u DISPLAY -u WAYLAND_DISPLAY " + before_, std::move(arguments));
  }

  /// The same with the statistics, which must be there. Skips the test where nothing can draw.
  Json statistics(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--stats", "stats.json"});
    const Outcome outcome = run(std::move(arguments));
    if (outcome.code == 3) return {};
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return Json::parse(content_of(folder_ / "stats.json"), nullptr, false);
  }

  Picture picture(const std::string& name) {
    Picture result;
    int channels = 0;
    stbi_uc* bytes = stbi_load((folder_ / name).c_str(), &result.width, &result.height, &channels, 3);
    if (bytes == nullptr) return result;
    EXPECT_EQ(channels, 3);
    result.pixels.resize(static_cast<std::size_t>(result.width) * static_cast<std::size_t>(result.height));
    std::copy_n(bytes, result.pixels.size() * 3, result.pixels.data()->data());
    stbi_image_free(bytes);
    return result;
  }

  std::vector<std::string> files() {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_)) names.push_back(entry.path().filename().string());
    std::ranges::sort(names);
    return names;
  }

  /// The run failed, said why in one line that holds `name`, printed nothing else and left only `kept` behind.
  void expect_refused(const Outcome& outcome, const std::string& name, const std::vector<std::string>& kept = {}) {
    EXPECT_TRUE(outcome.code == 1 || outcome.code == 2) << outcome.code;
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
    EXPECT_TRUE(outcome.err.ends_with('\n')) << outcome.err;
    EXPECT_NE(outcome.err.find(name), std::string::npos) << name << " is not named: " << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(files(), kept);
  }

  void write_tetrahedron(const std::string& name) {
    write(folder_ / name, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n");
  }

  /// A wall at z = 0, three cubes behind it and one beside it.
  void write_wall(const std::string& name) {
    std::ostringstream text;
    text << "o wall\nv -5 -5 0\nv 5 -5 0\nv 5 5 0\nv -5 5 0\nf 1 2 3\nf 1 3 4\n";
    for (const float x : {-2.0f, 0.0f, 2.0f, 8.0f}) {
      text << "o cube" << x << "\n";
      for (int corner = 0; corner < 8; ++corner) {
        text << "v " << x + (corner & 1 ? 0.5f : -0.5f) << ' ' << (corner & 2 ? 0.5f : -0.5f) << ' '
             << (corner & 4 ? -2.0f : -3.0f) << "\n";
      }
      for (const char* face :
           {"-8 -6 -5 -7", "-4 -3 -1 -2", "-8 -7 -3 -4", "-6 -2 -1 -5", "-8 -4 -2 -6", "-7 -5 -1 -3"}) {
        text << "f " << face << "\n";
      }
    }
    write(folder_ / name, text.str());
  }

  /// A strip of 70,000 vertices, more than 16-bit indices count.
  void write_strip(const std::string& name) {
    std::ostringstream strip;
    for (int i = 0; i < 35'000; ++i) {
      strip << "v " << i << " 0 " << i % 7 << "\nv " << i << " 1 " << i % 5 << "\n";
      if (i > 0) {
        strip << "f " << 2 * i - 1 << ' ' << 2 * i << ' ' << 2 * i + 1 << "\nf " << 2 * i << ' ' << 2 * i + 2 << ' '
              << 2 * i + 1 << "\n";
      }
    }
    write(folder_ / name, strip.str());
  }

  fs::path folder_;
  std::string before_;  ///< environment of every run
};

#define SKIP_WITHOUT_GL(json) \
  if ((json).is_null()) GTEST_SKIP() << "this machine has no EGL to draw with"

inline const std::vector<std::string> small_plant = {"--headless", "--objects", "40", "--size", "160x90"};

inline std::vector<std::string> with(std::vector<std::string> arguments, std::vector<std::string> more) {
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

/// Frames that both backends prepare.
class Backends : public Viewer {
 protected:
  /// Compares all that is not a time, and gives back what the host told.
  Json expect_same(const std::vector<std::string>& arguments) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    Json of[2];
    for (int i = 0; i < 2; ++i) {
      const Outcome outcome = run(with(arguments, {"--checksums", "--stats", "stats.json", "--backend", names[i]}));
      EXPECT_EQ(outcome.code, 0) << outcome.err;
      if (outcome.code != 0) return {};
      of[i] = Json::parse(content_of(folder_ / "stats.json"), nullptr, false);
      EXPECT_EQ(of[i]["backend"]["name"], names[i]);
      // Only where OpenGL is not the GPU's does CUDA say a word: that it copies.
      EXPECT_EQ(outcome.err.empty(), i == 0 || of[i]["backend"]["interop"] == true) << outcome.err;
    }
    EXPECT_GT(of[0]["drawn"]["triangles"], 0);
    EXPECT_EQ(of[0]["checksums"].size(), of[0]["frames"].get<std::size_t>());
    for (const char* key : {"checksums", "drawn", "culled", "occluders", "objects", "model", "frames", "camera"}) {
      EXPECT_EQ(of[0][key], of[1][key]) << key;
    }
    EXPECT_EQ(of[0]["stream"]["sent"], of[1]["stream"]["sent"]);
    return of[0];
  }

  /// Why the GPU cannot be asked, or nothing.
  std::string missing() {
    const Outcome outcome = run({"--backend", "cuda", "--headless", "--objects", "1", "--size", "8x8"});
    return outcome.code == 0 ? "" : outcome.err;
  }

  static constexpr const char* names[2] = {"host", "cuda"};
};

#define SKIP_WITHOUT_GPU() \
  if (const std::string why = missing(); !why.empty()) GTEST_SKIP() << "the backends are NOT compared: " << why

}  // namespace viewer_tests
