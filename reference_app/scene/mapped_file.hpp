// SPDX-License-Identifier: MIT
// A file mapped into memory for reading, which survives that the file shrinks or its disk fails.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

namespace pgl::scene {

/// A file's bytes, mapped read-only.
///
/// A page that cannot be read any more, since the file has become shorter or its disk fails, is replaced by zeros when
/// it is touched, and noted. To that end the first MappedFile of a process installs a handler of SIGBUS, which passes
/// on what does not concern any of them.
class MappedFile {
 public:
  /// Opens a regular file; nothing is mapped yet. Throws Error.
  explicit MappedFile(const std::filesystem::path& file);
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  ~MappedFile();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }  ///< when it was opened

  /// Reads the beginning into `bytes`, without the mapping. Throws Error; precondition: not larger than the file.
  void read_first(std::span<std::byte> bytes) const;

  /// Maps the whole file. Throws Error. Call it once.
  void map();
  [[nodiscard]] std::span<const std::byte> bytes() const {
    return {static_cast<const std::byte*>(data_), data_ ? static_cast<std::size_t>(size_) : 0};
  }

  /// What is known of how the bytes from `first` on will be read: in no order (nothing is read ahead), or soon (they
  /// are read from the disk meanwhile). Never fails.
  void advise_random(std::uint64_t first, std::uint64_t bytes) const noexcept;
  void advise_soon(std::uint64_t first, std::uint64_t bytes) const noexcept;

  /// Whether the file is shorter than when it was opened.
  [[nodiscard]] bool shrunk() const noexcept;
  /// Whether a page has been replaced by zeros.
  [[nodiscard]] bool lost() const noexcept;

 private:
  void advise(std::uint64_t first, std::uint64_t bytes, int advice) const noexcept;

  std::filesystem::path path_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
  void* data_ = nullptr;
  struct Watch* watch_ = nullptr;
};

}  // namespace pgl::scene
