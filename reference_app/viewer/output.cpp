// SPDX-License-Identifier: MIT
// Files that people look at.
#include "viewer/output.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <stdexcept>

#define STB_IMAGE_WRITE_STATIC
#define STB_IMAGE_WRITE_IMPLEMENTATION
#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#endif
#include <stb/stb_image_write.h>
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

namespace pgl::viewer {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void fail(const std::string& option, const std::string& path, const std::string& why) {
  throw std::runtime_error(option + ": cannot write '" + path + "': " + why);
}

/// A new, empty file next to `path`; it is removed again unless it was renamed.
class TemporaryFile {
 public:
  TemporaryFile(const std::string& option, const std::string& path) : option_(option), path_(real_path(path).string()) {
    name_ = path_ + "." + std::to_string(::getpid()) + ".tmp";
    file_ = ::open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file_ < 0) {
      name_.clear();
      fail(option, path, std::strerror(errno));
    }
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() {
    if (file_ >= 0) ::close(file_);
    if (!name_.empty()) ::unlink(name_.c_str());
  }

  void write(const std::string& content) {
    std::size_t done = 0;
    while (done < content.size()) {
      const ssize_t wrote = ::write(file_, content.data() + done, content.size() - done);
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote <= 0) fail(option_, path_, std::strerror(errno));
      done += static_cast<std::size_t>(wrote);
    }
    const int closed = ::close(file_);
    file_ = -1;
    if (closed != 0) fail(option_, path_, std::strerror(errno));
  }

  void take_name() {
    if (std::rename(name_.c_str(), path_.c_str()) != 0) fail(option_, path_, std::strerror(errno));
    name_ = path_;  // undone with the rest if a later file fails
  }
  void keep() { name_.clear(); }

 private:
  std::string option_;
  std::string path_;
  std::string name_;
  int file_ = -1;
};

}  // namespace

fs::path real_path(const std::string& path) {
  std::error_code error;
  const fs::path whole = fs::absolute(path, error);
  const fs::path real = fs::weakly_canonical(whole, error);
  return error ? whole : real;
}

std::string encode_png(const std::string& option, const Image& image) {
  int size = 0;
  const std::unique_ptr<unsigned char, decltype(&std::free)> bytes(
      stbi_write_png_to_mem(image.rgb.data(), image.width * 3, image.width, image.height, 3, &size), &std::free);
  if (!bytes) throw std::runtime_error(option + ": not enough memory to encode the picture");
  return {reinterpret_cast<const char*>(bytes.get()), static_cast<std::size_t>(size)};
}

void check_writable(const std::string& option, const std::string& path) {
  if (path.empty()) fail(option, path, "it has no name");
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (fs::is_directory(status)) fail(option, path, "it is a folder");
  if (fs::exists(status) && !fs::is_regular_file(status)) fail(option, path, "it is not a plain file");
  TemporaryFile probe(option, path);
}

void write_files(std::span<const PendingFile> files) {
  std::vector<std::unique_ptr<TemporaryFile>> written;
  for (const PendingFile& file : files) {
    written.push_back(std::make_unique<TemporaryFile>(file.option, file.path));
    written.back()->write(file.content);
  }
  for (auto& file : written) file->take_name();
  for (auto& file : written) file->keep();
}

std::uint64_t fnv1a(std::span<const std::byte> bytes, std::uint64_t hash) {
  for (const std::byte byte : bytes) hash = (hash ^ static_cast<std::uint64_t>(byte)) * 0x100000001b3u;
  return hash;
}

}  // namespace pgl::viewer
