// SPDX-License-Identifier: MIT
// Where tests find their files, and a folder for those that they write.
#pragma once

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>

namespace support {

/// A file of tests/data.
inline std::filesystem::path fixture(std::string_view name) {
  return std::filesystem::path(__FILE__).parent_path().parent_path() / "data" / name;
}

/// A file of the optional collection of real models, or an empty path where it is absent. The collection lies where the
/// environment variable PGL_TEST_DATA says, else in shared/data beside the repository.
inline std::filesystem::path real_model(std::string_view name) {
  const char* folder = std::getenv("PGL_TEST_DATA");
  const std::filesystem::path root =
      folder ? std::filesystem::path(folder) : fixture("").parent_path() / ".." / ".." / ".." / "shared" / "data";
  std::error_code ignored;
  return std::filesystem::exists(root / name, ignored) ? root / name : std::filesystem::path();
}

inline std::string read_bytes(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// A folder of its own, removed with everything in it at the end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "pgl_test_XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path write(std::string_view name, std::string_view bytes) const {
    const std::filesystem::path file = path_ / name;
    std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    return file;
  }

 private:
  std::filesystem::path path_;
};

}  // namespace support
