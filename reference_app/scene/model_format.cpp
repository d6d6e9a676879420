// SPDX-License-Identifier: MIT
#include "scene/model_format.hpp"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace pgl::scene::format {

std::optional<Layout> layout_of(const Counts& counts, bool wide) {
  constexpr std::uint64_t most_bytes = std::uint64_t{1} << 62;
  constexpr auto pages_of = [](std::uint64_t n, std::uint64_t per_page) { return n / per_page + (n % per_page != 0); };
  Layout layout;
  std::uint64_t page = 1;
  for (std::uint32_t s = 0; s < checksums; ++s) {
    const std::uint64_t size = element_bytes(s, wide);
    if (counts[s] > most_bytes / size) return std::nullopt;
    layout.first_byte[s] = page * page_bytes;
    layout.count[s] = counts[s];
    page += pages_of(counts[s] * size, page_bytes);
    if (page > most_bytes / page_bytes) return std::nullopt;
  }
  layout.level_first[0] = 1;
  layout.level_pages[0] = page - 1;
  layout.first_byte[checksums] = page * page_bytes;
  for (std::uint64_t pages = page - 1; pages > 1 || (pages == 1 && layout.levels == 1);) {
    pages = pages_of(pages, checksums_per_page);
    layout.level_first[layout.levels] = page;
    layout.level_pages[layout.levels++] = pages;
    layout.count[checksums] += pages * checksums_per_page;
    page += pages;
  }
  layout.file_bytes = page * page_bytes;
  return layout;
}

std::uint64_t checksum(std::span<const std::byte> bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

}  // namespace pgl::scene::format
