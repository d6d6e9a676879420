// SPDX-License-Identifier: MIT
// Files that people look at: written whole or not at all; pictures as PNG; the checksum of what was drawn.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace pgl::viewer {

/// An RGB picture, 8 bits a channel, top row first.
struct Image {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;  ///< 3 * width * height
};

/// Encodes the picture as PNG. Throws std::runtime_error, naming the option, when there is no memory for it.
std::string encode_png(const std::string& option, const Image& image);

/// The file that a path leads to, through links, whether it exists or not.
std::filesystem::path real_path(const std::string& path);

/// Throws std::runtime_error, naming the option and the path, unless a file can be created at the path: its folder
/// exists and takes new files, and the path is free or a plain file (which would be replaced).
void check_writable(const std::string& option, const std::string& path);

/// A file still to be written.
struct PendingFile {
  std::string option;  ///< named in errors
  std::string path;
  std::string content;
};

/// Writes every file, or none: each goes to a temporary name in its own folder first, and only when all are complete
/// they take their names. Throws std::runtime_error, naming the option and the path, and leaves nothing behind.
void write_files(std::span<const PendingFile> files);

/// The offset basis of fnv1a.
inline constexpr std::uint64_t fnv1a_start = 0xcbf29ce484222325u;

/// Continues the 64-bit FNV-1a hash over more bytes.
std::uint64_t fnv1a(std::span<const std::byte> bytes, std::uint64_t hash = fnv1a_start);

}  // namespace pgl::viewer
