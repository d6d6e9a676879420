// SPDX-License-Identifier: MIT
// Models made up by a random generator, and the bytes of a .pgl file as docs/file_format.md describes them, without the
// code that reads and writes them but for the checksum of a page.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "pgl/bounds.hpp"
#include "pgl/select_occluders.hpp"
#include "scene/build_model.hpp"
#include "scene/model_format.hpp"
#include "scene/model_view.hpp"

namespace support {

/// Fills in what follows from objects and meshes, by the rules alone.
template <class Index>
void make_object_tables(pgl::scene::Model<Index>& model) {
  model.object_boxes.clear();
  model.faces.clear();
  model.compactness_order.clear();
  for (const pgl::Object& object : model.objects) {
    model.compactness_order.push_back(static_cast<std::uint32_t>(model.faces.size()));
    model.object_boxes.push_back(pgl::transform(model.mesh_boxes[object.mesh], object.transform));
    model.faces.push_back(
        pgl::occluder_face(model.oriented_boxes[object.mesh], model.compactness[object.mesh], object.transform));
  }
  std::stable_sort(
      model.compactness_order.begin(), model.compactness_order.end(),
      [&](std::uint32_t a, std::uint32_t b) { return model.faces[a].compactness > model.faces[b].compactness; });
}

struct RandomModelOptions {
  std::size_t meshes = 5;
  std::size_t objects = 8;
  std::uint32_t vertices = 60;   ///< of a mesh, at most
  std::uint32_t triangles = 90;  ///< of a mesh, at most
  bool errors = true;
};

/// A model that is as Model says, of no shape at all: much faster than to build one. Some meshes are empty.
template <class Index>
pgl::scene::Model<Index> random_model(std::mt19937& random, const RandomModelOptions& options) {
  const auto below = [&](std::uint64_t n) { return static_cast<std::uint32_t>(random() % n); };
  const auto real = [&](float scale) { return scale * (static_cast<float>(random() % 20001) / 10000.0f - 1.0f); };
  pgl::scene::Model<Index> model;
  for (std::size_t m = 0; m < options.meshes; ++m) {
    pgl::Mesh mesh{model.vertices.size(), model.triangles.size(), model.map.size(), 0, 0};
    if (below(8) != 0) mesh.max_vertices = 1 + below(options.vertices);
    if (mesh.max_vertices > 0) mesh.min_vertices = 1 + below(mesh.max_vertices);
    for (std::uint32_t v = 0; v < mesh.max_vertices; ++v) {
      model.vertices.push_back({real(10), real(10), real(10)});
      model.ecol.push_back(v < mesh.min_vertices ? pgl::no_target<Index> : static_cast<Index>(below(v)));
    }
    const std::uint32_t triangles = mesh.max_vertices == 0 ? 0 : below(options.triangles + 1);
    for (std::uint32_t t = 0; t < triangles; ++t) {
      pgl::Triangle<Index> triangle;
      for (Index& v : triangle.v) v = static_cast<Index>(below(mesh.max_vertices));
      model.triangles.push_back(triangle);
    }
    std::vector<std::uint32_t> map(mesh.max_vertices - mesh.min_vertices + 1);
    for (std::uint32_t& entry : map) entry = below(triangles + 1);
    map.back() = triangles;
    std::sort(map.begin(), map.end());
    model.map.insert(model.map.end(), map.begin(), map.end());
    if (options.errors) {
      std::vector<float> errors(map.size());  // many are 0, and the last; the first may be infinite
      for (float& error : errors) error = std::max(real(2), 0.0f);
      if (below(8) == 0) errors.front() = std::numeric_limits<float>::infinity();
      errors.back() = 0;
      std::sort(errors.begin(), errors.end(), std::greater());
      model.errors.insert(model.errors.end(), errors.begin(), errors.end());
    }
    pgl::Box bounds;
    for (std::uint32_t v = 0; v < mesh.max_vertices; ++v)
      bounds = pgl::extend(bounds, model.vertices[mesh.first_vertex + v]);
    model.mesh_boxes.push_back(bounds);
    pgl::OrientedBox box;
    box.half = {3, 2, 1};
    box.centre = {real(5), real(5), real(5)};
    model.oriented_boxes.push_back(box);
    model.compactness.push_back(static_cast<float>(below(5)) / 4.0f);
    model.meshes.push_back(mesh);
  }
  for (std::size_t i = 0; i < (options.meshes == 0 ? 0 : options.objects); ++i) {
    pgl::Object object;
    object.mesh = below(options.meshes);
    for (int column = 0; column < 4; ++column) object.transform[column] = {real(2), real(2), real(2)};
    model.objects.push_back(object);
  }
  make_object_tables(model);
  return model;
}

/// Full counts of all objects.
template <class Index>
std::vector<std::uint32_t> full_counts(const pgl::scene::ModelView<Index>& model) {
  std::vector<std::uint32_t> counts;
  for (const pgl::Object& object : model.objects) counts.push_back(model.meshes[object.mesh].max_vertices);
  return counts;
}

/// Counts that are 0 or anything in the range of the object's mesh.
template <class Index>
std::vector<std::uint32_t> random_counts(const pgl::scene::ModelView<Index>& model, std::mt19937& random) {
  std::vector<std::uint32_t> counts;
  for (const pgl::Object& object : model.objects) {
    const pgl::Mesh& mesh = model.meshes[object.mesh];
    const std::uint32_t range = mesh.max_vertices - mesh.min_vertices + 1;
    counts.push_back(random() % 3 == 0 ? 0 : mesh.min_vertices + static_cast<std::uint32_t>(random() % range));
  }
  return counts;
}

/// A .pgl file's bytes, to look at and to tamper with.
class ModelBytes {
 public:
  static constexpr std::size_t page = 4096, sections = 14;
  enum Section : std::size_t {
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
    errors,
    checksums
  };

  explicit ModelBytes(std::string file) : bytes(std::move(file)) {}

  template <class Integer>
  Integer get(std::size_t at) const {
    Integer value;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
  }
  template <class Integer>
  void put(std::size_t at, Integer value) {
    std::memcpy(bytes.data() + at, &value, sizeof value);
  }
  static constexpr std::size_t entry(std::size_t section) { return 48 + 24 * section; }
  std::uint64_t element_bytes(std::size_t section) const { return get<std::uint32_t>(entry(section) + 4); }
  std::uint64_t first_byte(std::size_t section) const { return get<std::uint64_t>(entry(section) + 8); }
  std::uint64_t count(std::size_t section) const { return get<std::uint64_t>(entry(section) + 16); }
  std::uint64_t end_byte(std::size_t section) const {
    return first_byte(section) + count(section) * element_bytes(section);
  }
  std::size_t data_pages() const { return first_byte(checksums) / page - 1; }

  std::uint64_t checksum_of_page(std::size_t p) const {
    return pgl::scene::format::checksum(std::as_bytes(std::span(bytes).subspan(p * page, page)));
  }
  void seal_header() { put(4088, pgl::scene::format::checksum(std::as_bytes(std::span(bytes).first(4088)))); }
  /// Makes all checksums right again. The section of checksums must be where it was, and large enough.
  void seal(std::size_t pages) {
    std::size_t from = 1, to = 1 + pages;
    while (pages > 0) {
      const std::size_t parents = (pages + 511) / 512;
      for (std::size_t p = 0; p < parents * 512; ++p)
        put(to * page + p * 8, p < pages ? checksum_of_page(from + p) : std::uint64_t{0});
      from = to;
      to += parents;
      pages = parents;
      if (parents == 1) {
        put(32, checksum_of_page(from));
        break;
      }
    }
    seal_header();
  }
  void seal() { seal(data_pages()); }

  std::string bytes;
};

}  // namespace support
