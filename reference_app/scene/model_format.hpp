// SPDX-License-Identifier: MIT
// What lies where in a .pgl file, for the reader and the writer; docs/file_format.md is the same in words.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "pgl/oriented_box.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"

namespace pgl::scene::format {

// Records are in the file as they are in memory.
static_assert(std::endian::native == std::endian::little, "model files are little-endian, and not converted");
static_assert(sizeof(pgl::Mesh) == 3 * 8 + 2 * 4 && offsetof(pgl::Mesh, min_vertices) == 24);
static_assert(sizeof(pgl::Object) == 4 + 12 * 4 && offsetof(pgl::Object, transform) == 4);
static_assert(sizeof(pgl::Box) == 6 * 4);
static_assert(sizeof(pgl::OrientedBox) == 15 * 4 && offsetof(pgl::OrientedBox, half) == 48);
static_assert(sizeof(pgl::OccluderFace) == 7 * 4 && offsetof(pgl::OccluderFace, compactness) == 24);
static_assert(sizeof(glm::vec3) == 3 * 4);
static_assert(sizeof(pgl::Triangle<std::uint16_t>) == 6 && sizeof(pgl::Triangle<std::uint32_t>) == 12);

/// "PGL" after a byte that no text has, and then what a transfer as text would change.
inline constexpr std::array<unsigned char, 8> magic = {0x93, 'P', 'G', 'L', '\r', '\n', 0x1a, '\n'};
inline constexpr std::uint32_t version = 2;
inline constexpr std::uint32_t byte_order = 0x01020304;
inline constexpr std::uint64_t page_bytes = 4096;
inline constexpr std::uint64_t checksums_per_page = page_bytes / 8;

/// The sections, in the order in which they lie in the file.
enum Section : std::uint32_t {
  meshes,
  objects,
  mesh_boxes,
  object_boxes,
  oriented_boxes,
  compactness,
  faces,
  compactness_order,
  map,
  ecol,
  triangles,
  vertices,
  errors,  ///< not in version 1
  checksums,
};
inline constexpr std::uint32_t section_count = 14;
inline constexpr std::uint32_t first_bulk_section = map;  ///< those before it are tables

inline constexpr std::array<std::string_view, section_count> section_names = {
    "meshes", "objects", "mesh_boxes", "object_boxes", "oriented_boxes", "compactness", "faces", "compactness_order",
    "map",    "ecol",    "triangles",  "vertices",     "errors",         "checksums"};

constexpr std::uint64_t element_bytes(std::uint32_t section, bool wide) {
  constexpr std::array<std::uint8_t, section_count> narrow = {32, 52, 24, 24, 60, 4, 28, 4, 4, 2, 6, 12, 4, 8};
  return narrow[section] * (wide && (section == ecol || section == triangles) ? 2u : 1u);
}

struct SectionEntry {
  std::uint32_t section;
  std::uint32_t element_bytes;
  std::uint64_t first_byte;
  std::uint64_t count;  ///< elements
  bool operator==(const SectionEntry&) const = default;
};
static_assert(sizeof(SectionEntry) == 24);

/// The first page.
struct Header {
  std::array<unsigned char, 8> magic;
  std::uint32_t version;
  std::uint32_t byte_order;
  std::uint32_t bytes_per_page;
  std::uint32_t index_bits;  ///< 16 or 32
  std::uint64_t file_bytes;
  std::uint64_t root;  ///< checksum of the last page of checksums, 0 if there is none
  std::uint32_t number_of_sections;
  std::uint32_t up;  ///< 0 not told, 1 x, 2 y, 3 z
  std::array<SectionEntry, section_count> sections;
  std::array<unsigned char, page_bytes - 8 - 48 - section_count * sizeof(SectionEntry)> zero;
  std::uint64_t checksum;  ///< of all before it
};
static_assert(sizeof(Header) == page_bytes && offsetof(Header, sections) == 48 && offsetof(Header, checksum) == 4088);

/// How many elements each section but the checksums has, by its number.
using Counts = std::array<std::uint64_t, section_count - 1>;

/// Where everything lies, which follows from the counts: each section begins at the next page, in their order.
///
/// The checksums are a tree. Level 0 are the pages of the sections, numbered as they lie in the file from page 1 on.
/// Level l + 1 are pages that hold the checksums of level l's pages, 512 each, as many as needed and zeros after the
/// last; the levels follow each other up to the one that has one page. Of that one the header has the checksum. A file
/// whose sections are all empty has no level but 0, which has no page.
struct Layout {
  static constexpr std::size_t most_levels = 8;
  std::array<std::uint64_t, section_count> first_byte{};
  std::array<std::uint64_t, section_count> count{};
  std::array<std::uint64_t, most_levels> level_first{};  ///< page of the file
  std::array<std::uint64_t, most_levels> level_pages{};
  std::size_t levels = 1;  ///< level 0 included
  std::uint64_t file_bytes = 0;
};

/// Returns the layout, or nothing where it would not fit into 2^62 bytes.
std::optional<Layout> layout_of(const Counts& counts, bool wide);

/// XXH3, 64 bits, seed 0.
std::uint64_t checksum(std::span<const std::byte> bytes);

}  // namespace pgl::scene::format
