// SPDX-License-Identifier: MIT
#include "scene/check_file.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace pgl::scene {
namespace {

[[noreturn]] void fail(const std::string& reason) {
  throw std::runtime_error(reason);
}

std::string extension_of(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension;
}

/// The file's bytes, mapped read-only.
class Mapped {
 public:
  explicit Mapped(const std::filesystem::path& file) {
    const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) fail(std::string("cannot be opened: ") + std::strerror(errno));
    struct stat status {};
    if (fstat(descriptor, &status) == 0) size_ = static_cast<std::size_t>(status.st_size);
    if (size_ != 0) data_ = mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, descriptor, 0);
    close(descriptor);
    if (size_ == 0) fail("is empty");
    if (data_ == MAP_FAILED) fail(std::string("cannot be read: ") + std::strerror(errno));
  }
  Mapped(const Mapped&) = delete;
  Mapped& operator=(const Mapped&) = delete;
  ~Mapped() {
    if (data_ != MAP_FAILED) munmap(data_, size_);
  }
  std::string_view bytes() const { return {static_cast<const char*>(data_), size_}; }

 private:
  void* data_ = MAP_FAILED;
  std::size_t size_ = 0;
};

std::uint32_t little_endian_u32(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t k = 4; k-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[at + k]);
  return value;
}

/// Removes and returns the next word; empty at the end.
std::string_view next_word(std::string_view& text) {
  constexpr std::string_view blank = " \t\r\n\v\f";
  const std::size_t first = std::min(text.find_first_not_of(blank), text.size());
  const std::size_t last = std::min(text.find_first_of(blank, first), text.size());
  const std::string_view word = text.substr(first, last - first);
  text.remove_prefix(last);
  return word;
}

std::uint64_t number(std::string_view word, const char* what) {
  std::uint64_t value = 0;
  const auto [end, problem] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (problem != std::errc{} || end != word.data() + word.size() || word.empty())
    fail(std::string("malformed: bad ") + what + " '" + std::string(word.substr(0, 40)) + "'");
  return value;
}

// ---- PLY ------------------------------------------------------------------------------------------------------------

struct PlyProperty {
  std::size_t bytes = 0;        // of the value, or of one list item
  std::size_t count_bytes = 0;  // of a list's length; 0: not a list
};
struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

std::size_t ply_type_bytes(std::string_view type) {
  for (const std::string_view t : {"char", "uchar", "int8", "uint8"})
    if (type == t) return 1;
  for (const std::string_view t : {"short", "ushort", "int16", "uint16"})
    if (type == t) return 2;
  for (const std::string_view t : {"int", "uint", "int32", "uint32", "float", "float32"})
    if (type == t) return 4;
  for (const std::string_view t : {"double", "float64"})
    if (type == t) return 8;
  fail("malformed: unknown PLY type '" + std::string(type.substr(0, 40)) + "'");
}

void check_ply(std::string_view bytes) {
  std::vector<PlyElement> elements;
  std::string_view format;
  std::string_view rest = bytes;
  for (bool first = true;; first = false) {
    const std::size_t end = rest.find('\n');
    if (first && rest.substr(0, 3) != "ply") fail("malformed: not a PLY file");
    if (end == std::string_view::npos) fail("truncated: the PLY header has no end");
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(end + 1);
    const std::string_view key = next_word(line);
    if (key == "end_header") break;
    if (key == "format") format = next_word(line);
    if (key == "element") {
      const std::string_view name = next_word(line);
      elements.push_back({std::string(name), number(next_word(line), "PLY element count"), {}});
    }
    if (key == "property") {
      if (elements.empty()) fail("malformed: a PLY property before any element");
      const std::string_view type = next_word(line);
      PlyProperty property;
      if (type == "list") {
        property.count_bytes = ply_type_bytes(next_word(line));
        property.bytes = ply_type_bytes(next_word(line));
      } else {
        property.bytes = ply_type_bytes(type);
      }
      elements.back().properties.push_back(property);
    }
  }

  const bool text = format == "ascii", big = format == "binary_big_endian";
  if (!text && !big && format != "binary_little_endian") fail("malformed: unknown PLY format");
  for (const PlyElement& element : elements) {
    if (element.properties.empty() && element.count != 0) fail("malformed: a PLY element without properties");
    for (std::uint64_t i = 0; i < element.count; ++i) {
      const auto truncated = [&] {
        fail("truncated: " + std::to_string(element.count) + " PLY elements '" + element.name + "' promised, " +
             std::to_string(i) + " there");
      };
      for (const PlyProperty& property : element.properties) {
        if (text) {
          const std::string_view word = next_word(rest);
          if (word.empty()) truncated();
          if (property.count_bytes == 0) continue;
          for (std::uint64_t k = number(word, "PLY list length"); k > 0; --k)
            if (next_word(rest).empty()) truncated();
        } else {
          std::uint64_t items = 1;
          if (property.count_bytes != 0) {
            if (rest.size() < property.count_bytes) truncated();
            items = 0;
            for (std::size_t k = 0; k < property.count_bytes; ++k) {
              const std::size_t at = big ? k : property.count_bytes - 1 - k;
              items = items << 8 | static_cast<unsigned char>(rest[at]);
            }
            rest.remove_prefix(property.count_bytes);
          }
          if (items > rest.size() / property.bytes) truncated();
          rest.remove_prefix(items * property.bytes);
        }
      }
    }
  }
}

// ---- STL ------------------------------------------------------------------------------------------------------------

void check_stl(std::string_view bytes) {
  constexpr std::uint64_t header = 84, facet = 50;
  const std::uint64_t promised = bytes.size() < header ? 0 : little_endian_u32(bytes, 80);
  if (bytes.size() >= header && bytes.size() == header + promised * facet) return;
  std::string_view words = bytes.substr(0, 4096);
  if (next_word(words).substr(0, 5) == "solid") {
    const std::size_t end = bytes.rfind("endsolid"), last = bytes.rfind("endfacet");
    if (end == std::string_view::npos || (last != std::string_view::npos && end < last))
      fail("truncated: the STL text has no final endsolid");
    return;
  }
  if (bytes.size() < header) fail("truncated: shorter than an STL header");
  if (bytes.size() < header + promised * facet)
    fail("truncated: " + std::to_string(promised) + " STL triangles promised, " +
         std::to_string((bytes.size() - header) / facet) + " there");
  fail("malformed: longer than the " + std::to_string(promised) + " STL triangles promised");
}

// ---- glTF -----------------------------------------------------------------------------------------------------------

using Json = nlohmann::json;

std::uint64_t get(const Json& object, const char* key, std::uint64_t otherwise) {
  const auto found = object.find(key);
  if (found == object.end()) return otherwise;
  if (!found->is_number_unsigned()) fail(std::string("malformed: glTF ") + key + " is not a count");
  return found->get<std::uint64_t>();
}

const Json& list(const Json& object, const char* key) {
  static const Json empty = Json::array();
  const auto found = object.find(key);
  if (found == object.end()) return empty;
  if (!found->is_array()) fail(std::string("malformed: glTF ") + key + " is not a list");
  for (const Json& item : *found)
    if (!item.is_object()) fail(std::string("malformed: a glTF list '") + key + "' holds something else");
  return *found;
}

/// Which meshes the scene to load places somewhere; only those are read at all.
std::vector<bool> meshes_in_scene(const Json& root) {
  const Json &nodes = list(root, "nodes"), &scenes = list(root, "scenes");
  std::vector<bool> placed(list(root, "meshes").size()), seen(nodes.size());
  std::vector<std::size_t> stack;
  const auto visit = [&](const Json& from, const char* key) {
    const auto children = from.find(key);
    if (children == from.end() || !children->is_array()) return;
    for (const Json& child : *children)
      if (child.is_number_unsigned()) stack.push_back(child.get<std::size_t>());
  };
  if (const std::uint64_t scene = get(root, "scene", 0); scene < scenes.size()) visit(scenes[scene], "nodes");
  while (!stack.empty()) {
    const std::size_t node = stack.back();
    stack.pop_back();
    if (node >= nodes.size() || seen[node]) continue;
    seen[node] = true;
    visit(nodes[node], "children");
    if (const std::uint64_t mesh = get(nodes[node], "mesh", placed.size()); mesh < placed.size()) placed[mesh] = true;
  }
  return placed;
}

/// Returns the number of triangles promised.
std::uint64_t check_gltf_json(std::string_view text, std::uint64_t binary_chunk_bytes) {
  constexpr std::uint64_t limit = std::uint64_t{1} << 40;
  const Json root = Json::parse(
      text.begin(), text.end(),
      [](int depth, Json::parse_event_t event, Json& parsed) {
        if (event != Json::parse_event_t::key) return true;
        if (depth != 1) return parsed != "matrix" && parsed != "extras";
        for (const char* key : {"asset", "extensionsRequired", "buffers", "bufferViews", "accessors", "meshes", "nodes",
                                "scenes", "scene"})
          if (parsed == key) return true;
        return false;
      },
      /*allow_exceptions=*/false);
  if (!root.is_object()) fail("malformed: the glTF text is not a JSON object");
  const auto asset = root.find("asset");
  if (asset == root.end() || !asset->is_object()) fail("malformed: no glTF asset");
  const auto version = asset->find("version");
  if (version == asset->end() || !version->is_string() || version->get<std::string>().substr(0, 2) != "2.")
    fail("not glTF 2");

  if (const auto required = root.find("extensionsRequired"); required != root.end()) {
    for (const Json& item : *required) {
      const std::string name = item.is_string() ? item.get<std::string>() : std::string();
      bool harmless = false;  // says how surfaces look, not where they are
      for (const char* prefix : {"KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_"})
        harmless = harmless || name.rfind(prefix, 0) == 0;
      if (!harmless) fail("needs the glTF extension '" + name.substr(0, 60) + "', which is not supported");
    }
  }

  const Json &buffers = list(root, "buffers"), &views = list(root, "bufferViews"), &accessors = list(root, "accessors");
  for (std::size_t b = 0; b < buffers.size(); ++b)
    if (b == 0 && !buffers[b].contains("uri") && get(buffers[b], "byteLength", 0) > binary_chunk_bytes)
      fail("truncated: the glTF buffer is longer than its chunk");
  for (const Json& view : views) {
    const std::uint64_t buffer = get(view, "buffer", limit), first = get(view, "byteOffset", 0);
    const std::uint64_t length = get(view, "byteLength", limit);
    if (buffer >= buffers.size()) fail("malformed: a glTF buffer view has no buffer");
    if (first > limit || length > limit || first + length > get(buffers[buffer], "byteLength", 0))
      fail("malformed: a glTF buffer view reaches past its buffer");
  }
  for (const Json& accessor : accessors) {
    const std::uint64_t count = get(accessor, "count", 0), offset = get(accessor, "byteOffset", 0);
    const auto type = accessor.find("type");
    const std::string shape = type != accessor.end() && type->is_string() ? type->get<std::string>() : std::string();
    std::uint64_t components = 0, component_bytes = 0;
    const std::pair<const char*, unsigned> shapes[] = {{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4},
                                                       {"MAT2", 4},   {"MAT3", 9}, {"MAT4", 16}};
    for (const auto& [name, n] : shapes)
      if (shape == name) components = n;
    switch (get(accessor, "componentType", 0)) {
      case 5120:
      case 5121:
        component_bytes = 1;
        break;
      case 5122:
      case 5123:
        component_bytes = 2;
        break;
      case 5125:
      case 5126:
        component_bytes = 4;
        break;
    }
    if (components == 0 || component_bytes == 0) fail("malformed: a glTF accessor has an unknown type");
    if (count > limit || offset > limit) fail("malformed: a glTF accessor reaches past its buffer view");
    if (!accessor.contains("bufferView") || count == 0) continue;
    const std::uint64_t index = get(accessor, "bufferView", limit);
    if (index >= views.size()) fail("malformed: a glTF accessor has no buffer view");
    const std::uint64_t element = components * component_bytes;
    const std::uint64_t stride = std::max(get(views[index], "byteStride", element), std::uint64_t{1});
    if (stride > 65536 || offset + (count - 1) * stride + element > get(views[index], "byteLength", 0))
      fail("malformed: a glTF accessor reaches past its buffer view");
  }
  const Json& meshes = list(root, "meshes");
  const std::vector<bool> placed = meshes_in_scene(root);
  std::uint64_t triangles = 0;
  for (std::size_t m = 0; m < meshes.size(); ++m)
    for (const Json& primitive : list(meshes[m], "primitives")) {
      const auto accessor_of = [&](const Json& from, const char* key) -> const Json* {
        if (!from.contains(key)) return nullptr;
        const std::uint64_t index = get(from, key, limit);
        if (index >= accessors.size()) fail(std::string("malformed: glTF ") + key + " has no accessor");
        return &accessors[index];
      };
      const auto attributes = primitive.find("attributes");
      if (attributes == primitive.end() || !attributes->is_object())
        fail("malformed: a glTF primitive has no attributes");
      const Json* positions = accessor_of(*attributes, "POSITION");
      if (positions && (get(*positions, "componentType", 0) != 5126 || positions->at("type") != "VEC3"))
        fail("malformed: glTF positions are not three floats");
      const Json* indices = accessor_of(primitive, "indices");
      if (indices && (get(*indices, "componentType", 0) % 2 == 0 || indices->at("type") != "SCALAR"))
        fail("malformed: glTF indices are not unsigned");
      if (!positions || !placed[m]) continue;
      const std::uint64_t corners = get(indices ? *indices : *positions, "count", 0), mode = get(primitive, "mode", 4);
      if (mode == 4) triangles += corners / 3;
      if (mode == 5 || mode == 6) triangles += corners < 3 ? 0 : corners - 2;  // strip, fan
    }
  return triangles;
}

std::uint64_t check_glb(std::string_view bytes) {
  constexpr std::uint64_t header = 12, chunk_header = 8;
  if (bytes.substr(0, 4) != "glTF") fail("malformed: not a GLB file");
  if (bytes.size() < header + chunk_header) fail("truncated: shorter than a GLB header");
  if (little_endian_u32(bytes, 4) != 2) fail("not glTF 2");
  const std::uint64_t length = little_endian_u32(bytes, 8), text = little_endian_u32(bytes, 12);
  if (length > bytes.size())
    fail("truncated: " + std::to_string(length) + " bytes promised, " + std::to_string(bytes.size()) + " there");
  if (little_endian_u32(bytes, 16) != 0x4e4f534a || header + chunk_header + text > length)
    fail("malformed: the GLB has no JSON chunk");
  std::uint64_t binary = 0;
  const std::uint64_t second = header + chunk_header + (text + 3) / 4 * 4;
  if (second + chunk_header <= length) {
    binary = little_endian_u32(bytes, second);
    if (second + chunk_header + binary > length) fail("truncated: the GLB's second chunk is cut");
  }
  return check_gltf_json(bytes.substr(header + chunk_header, text), binary);
}

// ---- VRML -----------------------------------------------------------------------------------------------------------

void check_vrml(std::string_view bytes) {
  if (bytes.substr(0, 2) == "\x1f\x8b") fail("is compressed; unpack it with gunzip first");
  if (bytes.substr(0, 10) == "#VRML V1.0") fail("is VRML 1.0; only VRML 2.0 is read");
  if (bytes.substr(0, 15) != "#VRML V2.0 utf8") fail("malformed: not a VRML 2.0 file");
  std::string open;  // brackets
  for (std::size_t at = 0; at < bytes.size();) {
    const char c = bytes[at];
    if (c == '#') {
      at = std::min(bytes.find_first_of("\n\r", at), bytes.size());
    } else if (c == '"') {
      for (++at; at < bytes.size() && bytes[at] != '"'; ++at)
        if (bytes[at] == '\\') ++at;
      if (at >= bytes.size()) fail("truncated: a VRML string has no end");
      ++at;
    } else if (c == '{' || c == '[') {
      open.push_back(c);
      ++at;
    } else if (c == '}' || c == ']') {
      if (open.empty() || open.back() != (c == '}' ? '{' : '[')) fail("malformed: VRML brackets do not match");
      open.pop_back();
      ++at;
    } else if (std::isalpha(static_cast<unsigned char>(c)) || c == '_') {
      const auto inside = [](char x) {
        return std::isalnum(static_cast<unsigned char>(x)) || x == '_' || x == '-' || x == '+';
      };
      const std::size_t first = at;
      while (at < bytes.size() && inside(bytes[at])) ++at;
      const std::string_view word = bytes.substr(first, at - first);
      for (const std::string_view other : {"Inline", "WWWInline", "File", "EXTERNPROTO"})
        if (word == other) fail("needs other files (" + std::string(word) + "), which is not supported");
    } else {
      ++at;
    }
  }
  if (!open.empty()) fail("truncated: VRML brackets are not closed");
}

}  // namespace

bool has_known_extension(const std::filesystem::path& file) {
  const std::string extension = extension_of(file);
  for (const char* known : {".obj", ".ply", ".stl", ".gltf", ".glb", ".wrl"})
    if (extension == known) return true;
  return false;
}

bool is_vrml(const std::filesystem::path& file) {
  return extension_of(file) == ".wrl";
}

std::uint64_t check_file(const std::filesystem::path& file) {
  const Mapped mapped(file);
  const std::string extension = extension_of(file);
  if (extension == ".glb") return check_glb(mapped.bytes());
  if (extension == ".gltf") return check_gltf_json(mapped.bytes(), 0);
  if (extension == ".ply") check_ply(mapped.bytes());
  if (extension == ".stl") check_stl(mapped.bytes());
  if (extension == ".wrl") check_vrml(mapped.bytes());
  return 0;
}

}  // namespace pgl::scene
