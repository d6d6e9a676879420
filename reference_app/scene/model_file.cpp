// SPDX-License-Identifier: MIT
#include "scene/model_file.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <mutex>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/select_occluders.hpp"
#include "scene/for_each.hpp"
#include "scene/mapped_file.hpp"
#include "scene/model_format.hpp"

namespace pgl::scene {
namespace {

using format::page_bytes;

constexpr std::size_t objects_at_once = 512;   ///< whose pages are asked for before they are looked at
constexpr std::uint64_t pages_at_once = 1024;  ///< of a section that is checked as a whole
constexpr std::uint64_t pages_between = 4;     ///< up to so many, two parts are asked for as one
constexpr std::size_t meshes_at_once = 64;
constexpr std::size_t table_entries_at_once = 8192;

/// Zeros that the system provides when they are touched: room in proportion to the size of a file that may be used in
/// part only.
template <class Integer>
class LazyAtomics {
 public:
  LazyAtomics() = default;
  explicit LazyAtomics(std::uint64_t size) {
    if (size > std::numeric_limits<std::size_t>::max() / sizeof(Integer)) throw std::bad_alloc();
    data_.reset(static_cast<Integer*>(std::calloc(static_cast<std::size_t>(size) + 1, sizeof(Integer))));
    if (!data_) throw std::bad_alloc();
  }
  std::atomic_ref<Integer> operator[](std::uint64_t i) const { return std::atomic_ref<Integer>(data_.get()[i]); }

 private:
  struct Free {
    void operator()(Integer* data) const { std::free(data); }
  };
  std::unique_ptr<Integer[], Free> data_;
};

/// Calls body(first, last) for parts of [0, n) on all threads; what one of them throws is thrown here.
template <class Body>
void for_parts(std::uint64_t n, std::uint64_t part, const Progress& progress, std::string_view stage, Body&& body) {
  for_each(static_cast<std::size_t>(n / part + (n % part != 0)), progress, stage,
           [&](std::size_t p) { body(p * part, std::min<std::uint64_t>(n, (p + 1) * part)); });
}
template <class Body>
void for_parts(std::uint64_t n, std::uint64_t part, Body&& body) {
  for_parts(n, part, {}, {}, body);
}

}  // namespace

struct ModelFile::State {
  explicit State(const std::filesystem::path& path) : file(path) {}

  MappedFile file;
  format::Layout layout;
  bool wide = false;
  UpAxis up = UpAxis::not_told;
  std::uint64_t root = 0, header_checksum = 0;

  LazyAtomics<std::uint64_t> verified_pages;  ///< a bit for each page of the file
  std::atomic<std::uint64_t> verified_count{0};

  std::mutex mutex;  ///< of the first view()
  std::atomic<bool> tables_checked{false}, map_checked{false}, ecol_checked{false}, errors_checked{false};
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<std::uint32_t> mesh_of_object;
  LazyAtomics<std::uint8_t> verified_maps;       ///< of each mesh: 1 if require_maps has checked its map
  LazyAtomics<std::uint32_t> verified_vertices;  ///< of each mesh: the prefix that has been checked, with what it reads

  std::mutex prefetch_mutex;
  std::vector<std::uint32_t> prefetched;  ///< the counts of the last prefetch

  // ---- errors -------------------------------------------------------------------------------------------------------

  [[noreturn]] void fail(const std::string& reason) const {
    check();  // zeros instead of what is gone are no damage
    throw Error(file.path(), reason);
  }
  [[noreturn]] void damaged(std::uint32_t section, const std::string& what) const {
    fail("is damaged: section '" + std::string(format::section_names[section]) + "': " + what);
  }
  void check() const {
    if (file.shrunk()) throw Error(file.path(), "has become shorter while it was in use");
    if (file.lost()) throw Error(file.path(), "cannot be read any more: part of it is gone");
  }

  // ---- the file -----------------------------------------------------------------------------------------------------

  void open() {
    using namespace format;
    static_assert(sizeof(Header) == page_bytes);
    Header header;
    const std::uint64_t readable = std::min<std::uint64_t>(file.size(), sizeof(Header));
    std::memset(&header, 0, sizeof header);
    file.read_first(std::as_writable_bytes(std::span(&header, 1)).first(static_cast<std::size_t>(readable)));
    const std::size_t known = std::min<std::size_t>(static_cast<std::size_t>(readable), magic.size());
    if (known == 0) fail("is empty");
    if (!std::equal(magic.begin(), magic.begin() + known, header.magic.begin())) fail("is not a pgl model file");
    if (readable < sizeof(Header)) fail("is truncated: it has no whole header");
    if (header.byte_order == __builtin_bswap32(byte_order)) fail("is of a machine with the other order of bytes");
    if (header.version != 1 && header.version != version)
      fail("has version " + std::to_string(header.version) + " of the format, this program reads versions 1 and " +
           std::to_string(version));
    const auto header_bytes = std::as_bytes(std::span(&header, 1));
    if (checksum(header_bytes.first(offsetof(Header, checksum))) != header.checksum)
      fail("is damaged: the checksum of the header does not match");

    // From here on what is wrong is not by accident.
    if (header.version == 1) {  // as version 2 without errors, whose section would begin where the checksums do
      if (header.number_of_sections != section_count - 1 || header.sections[checksums] != SectionEntry{})
        fail("is damaged: the header does not make sense");
      header.number_of_sections = section_count;
      header.sections[checksums] =
          std::exchange(header.sections[errors], {errors, 4, header.sections[errors].first_byte, 0});
      header.sections[checksums].section += checksums - errors;
    }
    const auto is_zero = [](unsigned char byte) { return byte == 0; };
    if (header.byte_order != byte_order || header.bytes_per_page != page_bytes ||
        header.number_of_sections != section_count || (header.index_bits != 16 && header.index_bits != 32) ||
        header.up > static_cast<std::uint32_t>(UpAxis::z) ||
        !std::all_of(header.zero.begin(), header.zero.end(), is_zero))
      fail("is damaged: the header does not make sense");
    wide = header.index_bits == 32;
    up = static_cast<UpAxis>(header.up);
    Counts counts;
    for (std::uint32_t s = 0; s < checksums; ++s) counts[s] = header.sections[s].count;
    const auto expected = layout_of(counts, wide);
    if (!expected) fail("is damaged: a section is larger than any file");
    layout = *expected;
    for (std::uint32_t s = 0; s < section_count; ++s) {
      const SectionEntry& entry = header.sections[s];
      if (entry.section != s || entry.element_bytes != element_bytes(s, wide) || entry.count != layout.count[s])
        damaged(s, "its entry in the header does not make sense");
      if (entry.first_byte != layout.first_byte[s])
        damaged(s, "begins at byte " + std::to_string(entry.first_byte) + " instead of " +
                       std::to_string(layout.first_byte[s]));
    }
    for (const std::uint32_t s : {mesh_boxes, oriented_boxes, compactness})
      if (layout.count[s] != layout.count[format::meshes]) damaged(s, "has not one entry per mesh");
    for (const std::uint32_t s : {object_boxes, faces, compactness_order})
      if (layout.count[s] != layout.count[format::objects]) damaged(s, "has not one entry per object");
    if (layout.count[ecol] != layout.count[format::vertices]) damaged(ecol, "has not one entry per vertex");
    if (layout.count[errors] != 0 && layout.count[errors] != layout.count[map])
      damaged(errors, "has not one entry per entry of 'map'");
    if (layout.count[format::meshes] > 0xffffffffu) damaged(format::meshes, "has too many entries");
    if (layout.count[format::objects] > std::uint64_t{1} << 31) damaged(format::objects, "has too many entries");
    if (header.file_bytes != layout.file_bytes) fail("is damaged: the header does not agree with its sections");
    if ((layout.levels == 1) != (layout.level_pages[0] == 0) || (layout.levels == 1 && header.root != 0))
      fail("is damaged: the header does not make sense");
    if (file.size() < layout.file_bytes)
      fail("is truncated: " + std::to_string(file.size()) + " of " + std::to_string(layout.file_bytes) + " bytes");
    if (file.size() > layout.file_bytes)
      fail("has " + std::to_string(file.size() - layout.file_bytes) + " bytes after its end");
    root = header.root;
    header_checksum = header.checksum;

    verified_pages = LazyAtomics<std::uint64_t>(layout.file_bytes / page_bytes / 64 + 1);
    file.map();
    // Parts of meshes are scattered: what is needed is asked for, and no more.
    const std::uint64_t bulk = layout.first_byte[first_bulk_section];
    file.advise_random(bulk, layout.file_bytes - bulk);
  }

  template <class Element>
  std::span<const Element> section(std::uint32_t s) const {
    PGL_ASSERT(sizeof(Element) == format::element_bytes(s, wide));
    return {reinterpret_cast<const Element*>(file.bytes().data() + layout.first_byte[s]),
            static_cast<std::size_t>(layout.count[s])};
  }

  // ---- pages --------------------------------------------------------------------------------------------------------

  std::span<const std::byte> page(std::uint64_t p) const {
    return file.bytes().subspan(static_cast<std::size_t>(p * page_bytes), static_cast<std::size_t>(page_bytes));
  }
  bool is_verified(std::uint64_t p) const {
    return verified_pages[p / 64].load(std::memory_order_acquire) >> (p % 64) & 1;
  }

  /// Compares a page with its checksum, also if that has been done.
  void verify_page(std::uint64_t p) {
    std::size_t level = 0;
    while (p >= layout.level_first[level] + layout.level_pages[level]) ++level;
    const std::uint64_t number = p - layout.level_first[level];
    std::uint64_t expected = root;
    if (level + 1 < layout.levels) {
      const std::uint64_t parent = layout.level_first[level + 1] + number / format::checksums_per_page;
      require_page(parent);
      std::memcpy(&expected, page(parent).data() + number % format::checksums_per_page * 8, 8);
    }
    if (format::checksum(page(p)) != expected) {
      std::uint32_t s = format::checksums;
      while (s > 0 && p * page_bytes < layout.first_byte[s]) --s;
      damaged(s, "the checksum of page " + std::to_string(p) + " of the file does not match");
    }
    const std::uint64_t bit = std::uint64_t{1} << (p % 64);
    if (!(verified_pages[p / 64].fetch_or(bit, std::memory_order_acq_rel) & bit))
      verified_count.fetch_add(1, std::memory_order_relaxed);
  }
  void require_page(std::uint64_t p) {
    if (!is_verified(p)) verify_page(p);
  }

  /// The pages of elements [first, first + count) of a section, count > 0.
  struct Pages {
    std::uint64_t first, last;
  };
  Pages pages_of(std::uint32_t s, std::uint64_t first, std::uint64_t count) const {
    const std::uint64_t size = format::element_bytes(s, wide);
    return {(layout.first_byte[s] + first * size) / page_bytes,
            (layout.first_byte[s] + (first + count) * size - 1) / page_bytes};
  }
  void require_elements(std::uint32_t s, std::uint64_t first, std::uint64_t count) {
    if (count == 0) return;
    const Pages pages = pages_of(s, first, count);
    for (std::uint64_t p = pages.first; p <= pages.last; ++p) require_page(p);
  }
  /// Pages [first, last), all threads.
  void require_pages(std::uint64_t first, std::uint64_t last) {
    for_parts(last - first, pages_at_once, [&](std::uint64_t from, std::uint64_t to) {
      file.advise_soon((first + from) * page_bytes, (to - from) * page_bytes);
      for (std::uint64_t p = first + from; p < first + to; ++p) require_page(p);
    });
  }

  /// Asks the system for pages of one section, neighbours together; by default for those that are not verified yet.
  class Wanted {
   public:
    Wanted(const State& state, std::uint32_t s, bool all = false) : state_(state), section_(s), all_(all) {}
    void add(std::uint64_t first, std::uint64_t count) {
      if (count == 0) return;
      Pages pages = state_.pages_of(section_, first, count);
      while (!all_ && pages.first <= pages.last && state_.is_verified(pages.first)) ++pages.first;
      while (!all_ && pages.first <= pages.last && state_.is_verified(pages.last)) --pages.last;
      if (pages.first > pages.last) return;
      if (pages.first < begin_ || pages.first > end_ + pages_between) {
        ask();
        begin_ = pages.first;
      }
      end_ = std::max(end_, pages.last + 1);
    }
    void ask() {
      if (end_ > begin_) state_.file.advise_soon(begin_ * page_bytes, (end_ - begin_) * page_bytes);
      begin_ = end_ = 0;
    }

   private:
    const State& state_;
    std::uint32_t section_;
    bool all_;
    std::uint64_t begin_ = 0, end_ = 0;
  };

  // ---- what only verify looks at ------------------------------------------------------------------------------------

  /// That the header is still what was read when the file was opened.
  void check_header() const {
    std::uint64_t stored;
    std::memcpy(&stored, page(0).data() + offsetof(format::Header, checksum), 8);
    if (stored != header_checksum || format::checksum(page(0).first(offsetof(format::Header, checksum))) != stored)
      fail("is damaged: the checksum of the header does not match");
  }

  /// That what no section uses is zero: the rest of its last page, and of the last page of each level of checksums.
  void check_padding() const {
    const auto check_zero = [&](std::uint32_t s, std::uint64_t first) {
      const auto rest = file.bytes().subspan(static_cast<std::size_t>(first),
                                             static_cast<std::size_t>((page_bytes - first % page_bytes) % page_bytes));
      if (!std::all_of(rest.begin(), rest.end(), [](std::byte b) { return b == std::byte{0}; }))
        damaged(s, "there is something after its end");
    };
    for (std::uint32_t s = 0; s < format::checksums; ++s)
      check_zero(s, layout.first_byte[s] + layout.count[s] * format::element_bytes(s, wide));
    for (std::size_t level = 1; level < layout.levels; ++level)
      check_zero(format::checksums, layout.level_first[level] * page_bytes + layout.level_pages[level - 1] * 8);
  }

  // ---- tables -------------------------------------------------------------------------------------------------------

  void require_tables() {
    if (tables_checked.load(std::memory_order_acquire)) return;
    const std::lock_guard lock(mutex);
    if (tables_checked.load(std::memory_order_relaxed)) return;
    check_tables();
    tables_checked.store(true, std::memory_order_release);
  }

  void check_tables() {
    using namespace format;
    require_pages(1, layout.first_byte[first_bulk_section] / page_bytes);
    const auto mesh_section = section<pgl::Mesh>(format::meshes);
    const auto object_section = section<pgl::Object>(format::objects);
    const std::size_t mesh_count = mesh_section.size(), object_count = object_section.size();
    try {
      meshes.assign(mesh_section.begin(), mesh_section.end());
      objects.assign(object_section.begin(), object_section.end());
      mesh_of_object.resize(object_count);
      verified_maps = LazyAtomics<std::uint8_t>(mesh_count);
      verified_vertices = LazyAtomics<std::uint32_t>(mesh_count);
    } catch (const std::bad_alloc&) {
      fail("has more meshes and objects than fit into memory");
    }

    for_parts(mesh_count, table_entries_at_once, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t m = first; m < last; ++m) check_mesh(m);
      for (const float c : section<float>(compactness).subspan(first, last - first))
        if (!(c >= 0.0f && c <= 1.0f)) damaged(compactness, "a value is not from 0 to 1");
    });
    if (mesh_count == 0)
      for (const std::uint32_t s : {format::map, format::triangles, format::vertices})
        if (layout.count[s] != 0) damaged(s, "has entries that no mesh owns");

    const auto order = section<std::uint32_t>(compactness_order);
    const auto object_faces = section<pgl::OccluderFace>(faces);
    // Ascending, and all below the number of objects: each is there once.
    const auto key = [&](std::uint64_t i) {
      if (order[i] >= object_count) damaged(compactness_order, "an entry names no object");
      const std::uint32_t compact = compactness_key(object_faces[order[i]].compactness);
      return static_cast<std::uint64_t>(~compact) << 32 | order[i];
    };
    for_parts(object_count, table_entries_at_once, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t i = first; i < last; ++i) {
        mesh_of_object[i] = objects[i].mesh;
        if (objects[i].mesh >= mesh_count) damaged(format::objects, "an entry names no mesh");
        const float c = object_faces[i].compactness;
        if (!(c >= 0.0f && c <= 1.0f)) damaged(faces, "a compactness is not from 0 to 1");
        if (key(i) <= (i > 0 ? key(i - 1) : 0) && i > 0) damaged(compactness_order, "is not in order");
      }
    });
  }

  /// That a mesh owns what follows what the mesh before it owns, up to where the next one's begins.
  void check_mesh(std::uint64_t m) const {
    const pgl::Mesh& mesh = meshes[m];
    const bool last = m + 1 == meshes.size();
    const std::uint64_t next_vertex = last ? layout.count[format::vertices] : meshes[m + 1].first_vertex;
    const std::uint64_t next_triangle = last ? layout.count[format::triangles] : meshes[m + 1].first_triangle;
    const std::uint64_t next_map = last ? layout.count[format::map] : meshes[m + 1].first_map;
    // Offsets are below 2^62, so that no sum overflows.
    const bool good = (m > 0 || (mesh.first_vertex == 0 && mesh.first_triangle == 0 && mesh.first_map == 0)) &&
                      mesh.first_vertex <= layout.count[format::vertices] &&
                      mesh.first_triangle <= layout.count[format::triangles] &&
                      mesh.first_map <= layout.count[format::map] && mesh.min_vertices <= mesh.max_vertices &&
                      (mesh.min_vertices > 0 || mesh.max_vertices == 0) && (wide || mesh.max_vertices <= 65536) &&
                      mesh.first_vertex + mesh.max_vertices == next_vertex &&
                      mesh.first_map + (mesh.max_vertices - mesh.min_vertices) + 1 == next_map &&
                      next_triangle <= layout.count[format::triangles] && mesh.first_triangle <= next_triangle &&
                      next_triangle - mesh.first_triangle <= 0xffffffffu;
    if (!good) damaged(format::meshes, "mesh " + std::to_string(m) + " does not make sense");
  }

  // ---- meshes -------------------------------------------------------------------------------------------------------

  std::uint32_t triangles_of(std::uint64_t m) const {
    const std::uint64_t next = m + 1 == meshes.size() ? layout.count[format::triangles] : meshes[m + 1].first_triangle;
    return static_cast<std::uint32_t>(next - meshes[m].first_triangle);
  }
  std::uint32_t map_entries_of(std::uint64_t m) const { return meshes[m].max_vertices - meshes[m].min_vertices + 1; }
  [[noreturn]] void damaged_mesh(std::uint32_t s, std::uint64_t m, const char* what) const {
    damaged(s, "mesh " + std::to_string(m) + " " + what);
  }

  void check_map_of(std::uint64_t m) const {
    const auto map = section<std::uint32_t>(format::map).subspan(meshes[m].first_map, map_entries_of(m));
    if (!std::is_sorted(map.begin(), map.end())) damaged_mesh(format::map, m, "gets triangles from losing vertices");
    if (map.back() != triangles_of(m)) damaged_mesh(format::map, m, "does not count its triangles");
    if (meshes[m].max_vertices == 0 && map.back() != 0) damaged_mesh(format::map, m, "has triangles but no vertices");
  }
  void require_map_of(std::uint64_t m) {
    if (map_checked.load(std::memory_order_acquire)) return;
    require_elements(format::map, meshes[m].first_map, map_entries_of(m));
    check_map_of(m);
  }

  bool has_errors() const { return layout.count[format::errors] == layout.count[format::map]; }
  void check_errors_of(std::uint64_t m) const {
    const auto errors = section<float>(format::errors).subspan(meshes[m].first_map, map_entries_of(m));
    bool good = errors.back() >= 0.0f;  // and with it, where none is NaN, all before it
    for (std::size_t k = 1; k < errors.size(); ++k) good &= errors[k - 1] >= errors[k];
    if (!good) damaged_mesh(format::errors, m, "has errors that rise with the count, or a negative one or NaN");
  }

  template <class Index>
  void check_ecol_as(std::uint64_t m) const {
    const pgl::Mesh& mesh = meshes[m];
    const auto ecol = section<Index>(format::ecol).subspan(mesh.first_vertex, mesh.max_vertices);
    bool good = true;
    for (std::uint32_t v = 0; v < mesh.min_vertices; ++v) good &= ecol[v] == no_target<Index>;
    for (std::uint32_t v = mesh.min_vertices; v < mesh.max_vertices; ++v) good &= ecol[v] < v;
    if (!good) damaged_mesh(format::ecol, m, "has a vertex that merges into none before it");
  }
  void check_ecol_of(std::uint64_t m) const {
    wide ? check_ecol_as<std::uint32_t>(m) : check_ecol_as<std::uint16_t>(m);
  }
  void require_ecol_of(std::uint64_t m) {
    if (ecol_checked.load(std::memory_order_acquire)) return;
    require_elements(format::ecol, meshes[m].first_vertex, meshes[m].max_vertices);
    check_ecol_of(m);
  }

  template <class Index>
  void check_triangles_as(std::uint64_t m, std::uint32_t first, std::uint32_t last) const {
    const pgl::Mesh& mesh = meshes[m];
    bool good = true;
    for (const auto& t :
         section<pgl::Triangle<Index>>(format::triangles).subspan(mesh.first_triangle + first, last - first))
      good &= (t.v[0] < mesh.max_vertices) & (t.v[1] < mesh.max_vertices) & (t.v[2] < mesh.max_vertices);
    if (!good) damaged_mesh(format::triangles, m, "has a triangle with a vertex that is not there");
  }
  void check_triangles_of(std::uint64_t m, std::uint32_t first, std::uint32_t last) const {
    wide ? check_triangles_as<std::uint32_t>(m, first, last) : check_triangles_as<std::uint16_t>(m, first, last);
  }

  std::uint32_t triangles_at(std::uint64_t m, std::uint32_t count) const {
    return std::min(triangles_of(m), pgl::triangles_at(meshes[m], section<std::uint32_t>(format::map).data(), count));
  }

  /// The first `count` vertices of mesh m and what drawing them reads, but for its map, which has been checked.
  void require_mesh(std::uint64_t m, std::uint32_t count) {
    auto verified = verified_vertices[m];
    const std::uint32_t done = verified.load(std::memory_order_acquire);
    if (count <= done) return;
    if (done == 0) require_ecol_of(m);
    require_elements(format::vertices, meshes[m].first_vertex + done, count - done);
    const std::uint32_t first = triangles_at(m, done), last = triangles_at(m, count);
    if (first < last) {
      require_elements(format::triangles, meshes[m].first_triangle + first, last - first);
      check_triangles_of(m, first, last);
    }
    for (std::uint32_t most = done; most < count && !verified.compare_exchange_weak(most, count);) {
    }
  }

  /// What verify does for a mesh once all pages are known to be good.
  void verify_mesh(std::uint64_t m) const {
    check_map_of(m);
    check_ecol_of(m);
    check_triangles_of(m, 0, triangles_of(m));
    if (has_errors()) check_errors_of(m);
  }

  /// The maps of objects [first, last) that have counts.
  void require_maps(std::span<const std::uint32_t> counts, std::uint64_t first, std::uint64_t last) {
    const auto wanted = [&](std::uint64_t i) {
      const std::uint32_t m = mesh_of_object[i];
      return counts[i] != 0 && verified_vertices[m].load(std::memory_order_acquire) == 0 &&
             verified_maps[m].load(std::memory_order_acquire) == 0;
    };
    Wanted maps(*this, format::map);
    for (std::uint64_t i = first; i < last; ++i) {
      if (wanted(i)) maps.add(meshes[mesh_of_object[i]].first_map, map_entries_of(mesh_of_object[i]));
    }
    maps.ask();
    for (std::uint64_t i = first; i < last; ++i) {
      if (!wanted(i)) continue;
      require_map_of(mesh_of_object[i]);
      verified_maps[mesh_of_object[i]].store(1, std::memory_order_release);
    }
  }

  /// Objects [first, last), at most objects_at_once.
  void require_objects(std::span<const std::uint32_t> counts, std::uint64_t first, std::uint64_t last) {
    struct Need {
      std::uint32_t mesh, count;
      bool operator<(const Need& other) const { return mesh != other.mesh ? mesh < other.mesh : count > other.count; }
    };
    std::array<Need, objects_at_once> needs;
    std::size_t n = 0;
    for (std::uint64_t i = first; i < last; ++i) {
      if (counts[i] == 0) continue;
      const std::uint32_t m = mesh_of_object[i];
      PGL_ASSERT(counts[i] >= meshes[m].min_vertices && counts[i] <= meshes[m].max_vertices);
      if (counts[i] > verified_vertices[m].load(std::memory_order_acquire))
        needs[n++] = {m, std::clamp(counts[i], meshes[m].min_vertices, meshes[m].max_vertices)};
    }
    if (n == 0) return;
    std::sort(needs.begin(), needs.begin() + n);  // of each mesh the largest count first
    n = std::unique(needs.begin(), needs.begin() + n, [](const Need& a, const Need& b) { return a.mesh == b.mesh; }) -
        needs.begin();

    // All is asked for before the first page is looked at, so that the disk has much to do at a time. How many
    // triangles there are to read, the maps say.
    Wanted maps(*this, format::map), ecol(*this, format::ecol), vertices(*this, format::vertices),
        triangles(*this, format::triangles);
    for (const auto [m, count] : std::span(needs).first(n)) {
      maps.add(meshes[m].first_map, map_entries_of(m));
      ecol.add(meshes[m].first_vertex, meshes[m].max_vertices);
      vertices.add(meshes[m].first_vertex, count);
    }
    maps.ask();
    ecol.ask();
    vertices.ask();
    for (const auto [m, count] : std::span(needs).first(n)) {
      if (verified_vertices[m].load(std::memory_order_acquire) == 0) require_map_of(m);
      triangles.add(meshes[m].first_triangle, triangles_at(m, count));
    }
    triangles.ask();
    for (const auto [m, count] : std::span(needs).first(n)) require_mesh(m, count);
  }

  /// Asks for what objects [first, last) have more of than at the last prefetch and is verified already: the system may
  /// have dropped it since.
  void ask_again(std::span<const std::uint32_t> counts, std::uint64_t first, std::uint64_t last) {
    const auto for_each_grown = [&](auto&& body) {
      for (std::uint64_t i = first; i < last; ++i) {
        const std::uint32_t m = mesh_of_object[i], before = prefetched[i];
        if (counts[i] > before && counts[i] <= verified_vertices[m].load(std::memory_order_acquire))
          body(m, before, counts[i]);
      }
    };
    Wanted maps(*this, format::map, true), ecol(*this, format::ecol, true), vertices(*this, format::vertices, true),
        triangles(*this, format::triangles, true);
    for_each_grown([&](std::uint32_t m, std::uint32_t before, std::uint32_t now) {
      if (before == 0) maps.add(meshes[m].first_map, map_entries_of(m));
      if (before == 0) ecol.add(meshes[m].first_vertex, meshes[m].max_vertices);
      vertices.add(meshes[m].first_vertex + before, now - before);
    });
    maps.ask();
    ecol.ask();
    vertices.ask();
    for_each_grown([&](std::uint32_t m, std::uint32_t before, std::uint32_t now) {
      const std::uint32_t from = triangles_at(m, before), to = triangles_at(m, now);
      if (from < to) triangles.add(meshes[m].first_triangle + from, to - from);
    });
    triangles.ask();
    std::copy(counts.begin() + static_cast<std::ptrdiff_t>(first), counts.begin() + static_cast<std::ptrdiff_t>(last),
              prefetched.begin() + static_cast<std::ptrdiff_t>(first));
  }

  /// A section that is as large as all meshes together.
  template <class Check>
  void require_section(std::uint32_t s, std::atomic<bool>& checked, Check&& check_mesh_m) {
    require_tables();
    if (checked.load(std::memory_order_acquire)) return;
    require_pages(layout.first_byte[s] / page_bytes, layout.first_byte[s + 1] / page_bytes);
    for_parts(meshes.size(), meshes_at_once, [&](std::uint64_t first, std::uint64_t last) {
      for (std::uint64_t m = first; m < last; ++m) check_mesh_m(m);
    });
    checked.store(true, std::memory_order_release);
  }
};

ModelFile::ModelFile(const std::filesystem::path& file) : state_(std::make_unique<State>(file)) {
  try {
    state_->open();
  } catch (const std::bad_alloc&) {
    throw Error(file, "is too large for this machine");
  }
}
ModelFile::~ModelFile() = default;
ModelFile::ModelFile(ModelFile&&) noexcept = default;
ModelFile& ModelFile::operator=(ModelFile&&) noexcept = default;

const std::filesystem::path& ModelFile::path() const {
  return state_->file.path();
}
bool ModelFile::wide() const {
  return state_->wide;
}
UpAxis ModelFile::up() const {
  return state_->up;
}
std::uint64_t ModelFile::bytes() const {
  return state_->layout.file_bytes;
}
std::uint64_t ModelFile::meshes() const {
  return state_->layout.count[format::meshes];
}
std::uint64_t ModelFile::objects() const {
  return state_->layout.count[format::objects];
}
std::uint64_t ModelFile::vertices() const {
  return state_->layout.count[format::vertices];
}
std::uint64_t ModelFile::triangles() const {
  return state_->layout.count[format::triangles];
}
bool ModelFile::has_errors() const {
  return state_->has_errors();
}

template <class Index>
ModelView<Index> ModelFile::view() {
  State& s = *state_;
  PGL_ASSERT(s.wide == (sizeof(Index) == 4));
  s.require_tables();
  s.check();
  ModelView<Index> view;
  view.meshes = s.meshes;
  view.objects = s.objects;
  view.vertices = s.section<glm::vec3>(format::vertices);
  view.triangles = s.section<pgl::Triangle<Index>>(format::triangles);
  view.ecol = s.section<Index>(format::ecol);
  view.map = s.section<std::uint32_t>(format::map);
  view.errors = s.section<float>(format::errors);
  view.mesh_boxes = s.section<pgl::Box>(format::mesh_boxes);
  view.object_boxes = s.section<pgl::Box>(format::object_boxes);
  view.oriented_boxes = s.section<pgl::OrientedBox>(format::oriented_boxes);
  view.compactness = s.section<float>(format::compactness);
  view.faces = s.section<pgl::OccluderFace>(format::faces);
  view.compactness_order = s.section<std::uint32_t>(format::compactness_order);
  return view;
}
template ModelView<std::uint16_t> ModelFile::view();
template ModelView<std::uint32_t> ModelFile::view();

void ModelFile::require(std::span<const std::uint32_t> counts) {
  State& s = *state_;
  s.require_tables();
  PGL_ASSERT(counts.size() == s.objects.size());
  for_parts(s.objects.size(), objects_at_once,
            [&](std::uint64_t first, std::uint64_t last) { s.require_objects(counts, first, last); });
  s.check();
}

void ModelFile::require_maps(std::span<const std::uint32_t> counts) {
  State& s = *state_;
  s.require_tables();
  PGL_ASSERT(counts.size() == s.objects.size());
  for_parts(s.objects.size(), objects_at_once,
            [&](std::uint64_t first, std::uint64_t last) { s.require_maps(counts, first, last); });
  s.check();
}

void ModelFile::require_map() {
  State& s = *state_;
  s.require_section(format::map, s.map_checked, [&s](std::uint64_t m) { s.require_map_of(m); });
  s.check();
}

void ModelFile::require_ecol() {
  State& s = *state_;
  s.require_section(format::ecol, s.ecol_checked, [&s](std::uint64_t m) { s.require_ecol_of(m); });
  s.check();
}

void ModelFile::require_errors() {
  State& s = *state_;
  if (!s.has_errors()) s.fail("has no recorded errors; pgl_preprocess --errors records them");
  s.require_section(format::errors, s.errors_checked, [&s](std::uint64_t m) { s.check_errors_of(m); });
  s.check();
}

void ModelFile::prefetch(std::span<const std::uint32_t> counts, std::stop_token stop) noexcept {
  State& s = *state_;
  const std::unique_lock lock(s.prefetch_mutex, std::try_to_lock);  // of several at a time, one asks again
  try {
    s.require_tables();
    if (lock) s.prefetched.resize(s.objects.size());
  } catch (...) {
    return;
  }
  PGL_ASSERT(counts.size() == s.objects.size());
  for (std::uint64_t first = 0; first < s.objects.size() && !stop.stop_requested(); first += objects_at_once) {
    const std::uint64_t last = std::min<std::uint64_t>(s.objects.size(), first + objects_at_once);
    if (lock) s.ask_again(counts, first, last);
    try {
      s.require_objects(counts, first, last);
    } catch (...) {  // left for require to tell
    }
  }
}

void ModelFile::check() const {
  state_->check();
}

std::uint64_t ModelFile::bytes_verified() const {
  return state_->verified_count.load(std::memory_order_relaxed) * page_bytes;
}

void ModelFile::verify(const Progress& progress) {
  State& s = *state_;
  constexpr std::uint64_t pages_per_step = (1 << 20) / page_bytes;  // a MiB
  const std::uint64_t pages = s.layout.file_bytes / page_bytes;
  s.check_header();
  for_parts(pages - 1, pages_per_step, progress, "checksums", [&](std::uint64_t first, std::uint64_t last) {
    s.file.advise_soon((1 + first) * page_bytes, (last - first) * page_bytes);
    for (std::uint64_t p = 1 + first; p < 1 + last; ++p) s.verify_page(p);
  });
  s.check_padding();
  s.require_tables();
  for_parts(s.meshes.size(), meshes_at_once, progress, "meshes", [&](std::uint64_t first, std::uint64_t last) {
    for (std::uint64_t m = first; m < last; ++m) s.verify_mesh(m);
  });
  s.check();
}

}  // namespace pgl::scene
