// SPDX-License-Identifier: MIT
// Properties of the .pgl file under damage: by accident, which the checksums catch, and with checksums made right
// again, which what is checked of the contents has to catch.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <limits>
#include <optional>
#include <random>
#include <vector>

#include "pgl/host/gather.hpp"
#include "pgl/host/reform.hpp"
#include "scene/model_file.hpp"
#include "support/model_files.hpp"
#include "support/test_data.hpp"

namespace {

using pgl::scene::Error;
using pgl::scene::Model;
using pgl::scene::ModelFile;
using pgl::scene::ModelFileWriter;
using pgl::scene::ModelView;
using support::full_counts;
using support::ModelBytes;
using support::random_counts;
using support::random_model;
using support::RandomModelOptions;
using support::TemporaryFolder;
using Index16 = std::uint16_t;
using Index32 = std::uint32_t;
namespace fs = std::filesystem;

template <class Index>
std::string file_of(const TemporaryFolder& folder, const Model<Index>& model) {
  ModelFileWriter writer(folder.path() / "good.pgl");
  writer.append(model);
  writer.finish();
  return support::read_bytes(folder.path() / "good.pgl");
}

/// True if body throws Error, and nothing else.
template <class Body>
bool refuses(Body&& body) {
  try {
    body();
  } catch (const Error& error) {
    RC_ASSERT(std::string_view(error.what()).find('\n') == std::string_view::npos);
    return true;
  }
  return false;
}

template <class Element>
bool same(std::span<const Element> a, std::span<const Element> b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

template <class Index>
bool same_tables(const ModelView<Index>& a, const ModelView<Index>& b) {
  return same(a.meshes, b.meshes) && same(a.objects, b.objects) && same(a.mesh_boxes, b.mesh_boxes) &&
         same(a.object_boxes, b.object_boxes) && same(a.oriented_boxes, b.oriented_boxes) &&
         same(a.compactness, b.compactness) && same(a.faces, b.faces) && same(a.compactness_order, b.compactness_order);
}

/// What drawing counts[i] vertices of each object reads is the same in both.
template <class Index>
bool same_within_reach(const ModelView<Index>& a, const ModelView<Index>& b, const std::vector<std::uint32_t>& counts) {
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0) continue;
    const pgl::Mesh& mesh = b.meshes[b.objects[i].mesh];
    const std::uint32_t entries = mesh.max_vertices - mesh.min_vertices + 1;
    const std::uint32_t triangles = b.map[mesh.first_map + counts[i] - mesh.min_vertices];
    if (!same(a.map.subspan(mesh.first_map, entries), b.map.subspan(mesh.first_map, entries))) return false;
    if (!same(a.ecol.subspan(mesh.first_vertex, mesh.max_vertices),
              b.ecol.subspan(mesh.first_vertex, mesh.max_vertices)))
      return false;
    if (!same(a.vertices.subspan(mesh.first_vertex, counts[i]), b.vertices.subspan(mesh.first_vertex, counts[i])))
      return false;
    if (!same(a.triangles.subspan(mesh.first_triangle, triangles), b.triangles.subspan(mesh.first_triangle, triangles)))
      return false;
  }
  return true;
}

/// That the tables, and what is within reach of the counts, lead nowhere outside of the arrays.
template <class Index>
void expect_sound(const ModelView<Index>& model, const std::vector<std::uint32_t>& counts) {
  const std::size_t n = model.objects.size();
  RC_ASSERT(model.mesh_boxes.size() == model.meshes.size() && model.oriented_boxes.size() == model.meshes.size());
  RC_ASSERT(model.compactness.size() == model.meshes.size() && model.ecol.size() == model.vertices.size());
  RC_ASSERT(model.object_boxes.size() == n && model.faces.size() == n && model.compactness_order.size() == n);
  std::vector<bool> ordered(n);
  for (const std::uint32_t object : model.compactness_order) {
    RC_ASSERT(object < n && !ordered[object]);
    ordered[object] = true;
  }
  for (std::size_t i = 0; i < n; ++i) {
    RC_ASSERT(model.objects[i].mesh < model.meshes.size());
    const pgl::Mesh& mesh = model.meshes[model.objects[i].mesh];
    RC_ASSERT(mesh.min_vertices <= mesh.max_vertices);
    RC_ASSERT(mesh.first_vertex <= model.vertices.size() &&
              mesh.max_vertices <= model.vertices.size() - mesh.first_vertex);
    const std::uint64_t entries = std::uint64_t{mesh.max_vertices} - mesh.min_vertices + 1;
    RC_ASSERT(mesh.first_map <= model.map.size() && entries <= model.map.size() - mesh.first_map);
    if (counts[i] == 0) continue;
    std::uint32_t last = 0;
    for (const std::uint32_t triangles : model.map.subspan(mesh.first_map, entries)) {
      RC_ASSERT(triangles >= last);
      last = triangles;
    }
    RC_ASSERT(mesh.first_triangle <= model.triangles.size() && last <= model.triangles.size() - mesh.first_triangle);
    for (std::uint32_t v = 0; v < mesh.max_vertices; ++v) {
      const Index target = model.ecol[mesh.first_vertex + v];
      RC_ASSERT((v < mesh.min_vertices ? target == pgl::no_target<Index> : target < v));
    }
    const std::uint32_t triangles = model.map[mesh.first_map + counts[i] - mesh.min_vertices];
    for (const auto& t : model.triangles.subspan(mesh.first_triangle, triangles))
      for (const Index v : t.v) RC_ASSERT(v < mesh.max_vertices);
  }
}

/// That the errors of every mesh are what select_by_error may be given.
template <class Index>
void expect_sound_errors(const ModelView<Index>& model) {
  RC_ASSERT(model.errors.size() == model.map.size());
  for (const pgl::Mesh& mesh : model.meshes) {
    float last = std::numeric_limits<float>::infinity();
    for (const float error : model.errors.subspan(mesh.first_map, mesh.max_vertices - mesh.min_vertices + 1)) {
      RC_ASSERT(error >= 0.0f && error <= last);
      last = error;
    }
  }
}

/// Draws from copies of exactly the size of the arrays, so that a sanitizer sees any read beyond them.
template <class Index>
void draw(const ModelView<Index>& model, const std::vector<std::uint32_t>& counts) {
  const std::vector<pgl::Mesh> meshes(model.meshes.begin(), model.meshes.end());
  const std::vector<pgl::Object> objects(model.objects.begin(), model.objects.end());
  const std::vector<glm::vec3> vertices(model.vertices.begin(), model.vertices.end());
  const std::vector<pgl::Triangle<Index>> triangles(model.triangles.begin(), model.triangles.end());
  const std::vector<Index> ecol(model.ecol.begin(), model.ecol.end());
  std::vector<std::uint64_t> vertex_offsets{0}, triangle_offsets{0};
  for (std::size_t i = 0; i < counts.size(); ++i) {
    vertex_offsets.push_back(vertex_offsets.back() + counts[i]);
    triangle_offsets.push_back(triangle_offsets.back() +
                               pgl::triangles_at(meshes[objects[i].mesh], model.map.data(), counts[i]));
  }
  std::vector<glm::vec3> out_vertices(vertex_offsets.back());
  std::vector<pgl::Triangle<Index32>> out_triangles(triangle_offsets.back());
  pgl::host::gather<glm::vec3, glm::vec3>(meshes, objects, vertices, counts, vertex_offsets, out_vertices);
  pgl::host::ReformWorkspace<Index> workspace;
  pgl::host::reform<Index>(meshes, objects, triangles, ecol, counts, vertex_offsets, triangle_offsets, workspace,
                           out_triangles);
  for (std::size_t i = 0; i < counts.size(); ++i)
    for (std::uint64_t t = triangle_offsets[i]; t < triangle_offsets[i + 1]; ++t)
      for (const Index32 v : out_triangles[t].v) RC_ASSERT(v >= vertex_offsets[i] && v < vertex_offsets[i + 1]);
}

TEST(ModelFileProps, EveryByteOfAFileIsWatched) {
  const TemporaryFolder folder;
  std::mt19937 random(1);
  const std::string good =
      file_of(folder, random_model<Index16>(random, {.meshes = 20, .objects = 30, .vertices = 100, .triangles = 200}));
  ASSERT_LT(good.size(), 100'000u);
  const fs::path path = folder.write("t.pgl", good);
  const int file = open(path.c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(file, 0);
  for (std::size_t at = 0; at < good.size(); ++at) {
    const char flipped = static_cast<char>(good[at] ^ (1 << random() % 8));
    ASSERT_EQ(pwrite(file, &flipped, 1, static_cast<off_t>(at)), 1);
    bool refused = false;
    try {
      ModelFile(path).verify();
    } catch (const Error&) {
      refused = true;
    }
    ASSERT_TRUE(refused) << "byte " << at;
    ASSERT_EQ(pwrite(file, &good[at], 1, static_cast<off_t>(at)), 1);
  }
  close(file);
  EXPECT_NO_THROW(ModelFile(path).verify());
}

template <class Index>
void damage_never_shows() {
  const auto seed = *rc::gen::arbitrary<std::uint32_t>();
  std::mt19937 random(seed);
  const TemporaryFolder folder;
  const RandomModelOptions options{.meshes = 1 + random() % 40,
                                   .objects = random() % 60,
                                   .vertices = random() % 4 == 0 ? 20'000u : 200u,
                                   .triangles = random() % 4 == 0 ? 20'000u : 300u,
                                   .errors = random() % 4 != 0};
  const Model<Index> model = random_model<Index>(random, options);
  ModelBytes bytes(file_of(folder, model));
  // A few bits, a run of rubbish, a page in the place of another, or a bit whose page has got the right checksum, which
  // then is not that of the checksums.
  const std::uint64_t kind = random() % 5, header = 4096;
  for (std::uint64_t k = 0; kind < 2 && k <= kind * 3; ++k)
    bytes.bytes[header + random() % (bytes.bytes.size() - header)] ^= static_cast<char>(1 << random() % 8);
  if (kind == 2) {
    const std::size_t first = header + random() % (bytes.bytes.size() - header);
    const std::size_t last = std::min<std::size_t>(bytes.bytes.size(), first + random() % 9000);
    for (std::size_t at = first; at < last; ++at) bytes.bytes[at] = static_cast<char>(random());
  }
  if (kind == 3) {
    const std::size_t pages = bytes.bytes.size() / 4096, a = 1 + random() % (pages - 1), b = 1 + random() % (pages - 1);
    std::swap_ranges(bytes.bytes.begin() + static_cast<std::ptrdiff_t>(a * 4096),
                     bytes.bytes.begin() + static_cast<std::ptrdiff_t>((a + 1) * 4096),
                     bytes.bytes.begin() + static_cast<std::ptrdiff_t>(b * 4096));
  }
  if (kind == 4) {
    const std::size_t p = 1 + random() % bytes.data_pages();
    bytes.bytes[p * 4096 + random() % 4096] ^= static_cast<char>(1 << random() % 8);
    bytes.put(bytes.first_byte(ModelBytes::checksums) + 8 * (p - 1), bytes.checksum_of_page(p));
  }
  const bool changed = bytes.bytes != support::read_bytes(folder.path() / "good.pgl");
  ModelFile file(folder.write("t.pgl", bytes.bytes));  // the header is whole
  ModelView<Index> view;
  bool used = !refuses([&] { view = file.view<Index>(); });
  const ModelView<Index> expected(model);
  if (used) RC_ASSERT(same_tables(view, expected));
  for (int k = 0; used && k < 3; ++k) {
    const auto counts = k == 2 ? full_counts(expected) : random_counts(expected, random);
    if (random() % 2) file.prefetch(counts);
    const bool refused = refuses([&] { file.require(counts); });
    if (!refused) RC_ASSERT(same_within_reach(view, expected, counts));
    RC_ASSERT(refuses([&] { file.require(counts); }) == refused);
    used = !refused;
  }
  if (!refuses([&] { file.require_map(); })) RC_ASSERT(!used || same(view.map, expected.map));
  if (!refuses([&] { file.require_ecol(); })) RC_ASSERT(!used || same(view.ecol, expected.ecol));
  if (!refuses([&] { file.require_errors(); })) RC_ASSERT(!used || same(view.errors, expected.errors));
  RC_ASSERT(refuses([&] { file.verify(); }) == changed);
  RC_CLASSIFY(!used, "met in use");
  RC_CLASSIFY(used, "never met, or met by verify");
}
RC_GTEST_PROP(ModelFileProps, damageIsAnErrorOrIsNotRead16, ()) {
  damage_never_shows<Index16>();
}
RC_GTEST_PROP(ModelFileProps, damageIsAnErrorOrIsNotRead32, ()) {
  damage_never_shows<Index32>();
}

/// A value that a count, an offset or an index may go wrong by.
std::uint64_t odd_value(std::mt19937& random, std::uint64_t value) {
  const std::uint64_t any = std::uint64_t{random()} << 32 | random();
  switch (random() % 10) {
    case 0:
      return 0;
    case 1:
      return ~std::uint64_t{0};
    case 2:
      return value + 1;
    case 3:
      return value - 1;
    case 4:
      return value ^ std::uint64_t{1} << random() % 64;
    case 5:
      return value + (random() % 64) - 32;
    case 6:
      return std::uint64_t{1} << random() % 64;
    case 7:
      return (std::uint64_t{1} << random() % 64) - 1;
    case 8:
      return any % 100;
    default:
      return any;
  }
}

/// Changes a number of a section, at one of the places where a number of its records begins.
void tamper(ModelBytes& bytes, std::mt19937& random, std::size_t section) {
  if (bytes.count(section) == 0) return;
  const std::uint64_t size = bytes.element_bytes(section);
  const std::size_t record = bytes.first_byte(section) + random() % bytes.count(section) * size;
  const bool narrow =
      bytes.get<std::uint32_t>(20) == 16 && (section == ModelBytes::ecol || section == ModelBytes::triangles);
  if (section == ModelBytes::meshes && random() % 2) {
    const std::size_t at = record + 8 * (random() % 3);
    bytes.put(at, odd_value(random, bytes.get<std::uint64_t>(at)));
  } else if (narrow) {
    const std::size_t at = record + 2 * (random() % (size / 2));
    bytes.put(at, static_cast<std::uint16_t>(odd_value(random, bytes.get<std::uint16_t>(at))));
  } else {
    const std::size_t at = record + 4 * (random() % (size / 4));
    bytes.put(at, static_cast<std::uint32_t>(odd_value(random, bytes.get<std::uint32_t>(at))));
  }
}

/// Changes counts in the header together, as far as the sections stay where they are.
void tamper_with_counts(ModelBytes& bytes, std::mt19937& random) {
  static const std::vector<std::vector<std::size_t>> groups = {
      {ModelBytes::meshes, ModelBytes::mesh_boxes, ModelBytes::oriented_boxes, ModelBytes::compactness},
      {ModelBytes::objects, ModelBytes::object_boxes, ModelBytes::faces, ModelBytes::compactness_order},
      {ModelBytes::map},
      {ModelBytes::errors},
      {ModelBytes::map, ModelBytes::errors},
      {ModelBytes::ecol, ModelBytes::vertices},
      {ModelBytes::triangles}};
  const auto& group = groups[random() % groups.size()];
  const std::uint64_t change = random() % 2 ? 1 : ~std::uint64_t{0};
  for (const std::size_t s : group) {
    const std::uint64_t size = bytes.element_bytes(s), count = bytes.count(s);
    if ((count + change > count) != (change == 1)) return;
    if ((count * size + 4095) / 4096 != ((count + change) * size + 4095) / 4096) return;
  }
  for (const std::size_t s : group) bytes.put(ModelBytes::entry(s) + 16, bytes.count(s) + change);
}

enum class Outcome : std::uint8_t { refused, refused_in_part, harmless };

template <class Index>
Outcome use_forgery(const TemporaryFolder& folder, ModelBytes bytes, std::mt19937& random) {
  static constexpr std::size_t sections[] = {ModelBytes::meshes,
                                             ModelBytes::meshes,
                                             ModelBytes::meshes,
                                             ModelBytes::objects,
                                             ModelBytes::compactness,
                                             ModelBytes::faces,
                                             ModelBytes::compactness_order,
                                             ModelBytes::map,
                                             ModelBytes::map,
                                             ModelBytes::ecol,
                                             ModelBytes::ecol,
                                             ModelBytes::triangles,
                                             ModelBytes::vertices,
                                             ModelBytes::errors,
                                             ModelBytes::errors,
                                             ModelBytes::object_boxes};
  const std::size_t changes = random() % 4;
  for (std::size_t k = 0; k < changes; ++k) {
    if (random() % 6 == 0) {
      tamper_with_counts(bytes, random);
    } else {
      tamper(bytes, random, sections[random() % std::size(sections)]);
    }
  }
  bytes.seal();

  std::optional<ModelFile> file;
  ModelView<Index> view;
  if (refuses([&] {
        file.emplace(folder.write("t.pgl", bytes.bytes));
        view = file->template view<Index>();
      })) {
    RC_ASSERT(changes > 0u);
    return Outcome::refused;
  }
  bool refused = false;
  for (int k = 0; k < 3; ++k) {
    const auto counts = k == 2 ? full_counts(view) : random_counts(view, random);
    if (refuses([&] { file->require(counts); })) {
      refused = true;
      continue;
    }
    expect_sound(view, counts);
    draw(view, counts);
  }
  refused = refuses([&] { file->require_map(); }) || refused;
  refused = refuses([&] { file->require_ecol(); }) || refused;
  if (file->has_errors()) {
    if (refuses([&] { file->require_errors(); })) {
      refused = true;
    } else {
      expect_sound_errors(view);
    }
  }
  const bool whole = !refuses([&] { file->verify(); });
  RC_ASSERT(!(refused && whole));  // verify knows all that the others know
  RC_ASSERT(changes > 0u || whole);
  return refused ? Outcome::refused_in_part : Outcome::harmless;
}

template <class Index>
void forgery_stays_inside() {
  const auto seed = *rc::gen::arbitrary<std::uint32_t>();
  std::mt19937 random(seed);
  const TemporaryFolder folder;
  const Model<Index> model = random_model<Index>(random, {.meshes = 1 + random() % 30,
                                                          .objects = random() % 40,
                                                          .vertices = 80,
                                                          .triangles = 150,
                                                          .errors = random() % 4 != 0});
  const ModelBytes bytes(file_of(folder, model));
  std::array<int, 3> outcomes{};
  for (int k = 0; k < 8; ++k) ++outcomes[static_cast<std::size_t>(use_forgery<Index>(folder, bytes, random))];
  RC_CLASSIFY(outcomes[0] > 0, "some refused");
  RC_CLASSIFY(outcomes[1] > 0, "some refused in part");
  RC_CLASSIFY(outcomes[2] > 0, "some harmless");
}

RC_GTEST_PROP(ModelFileProps, whatIsWrongWithRightChecksumsLeadsNowhere16, ()) {
  forgery_stays_inside<Index16>();
}
RC_GTEST_PROP(ModelFileProps, whatIsWrongWithRightChecksumsLeadsNowhere32, ()) {
  forgery_stays_inside<Index32>();
}

}  // namespace
