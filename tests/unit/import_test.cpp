// SPDX-License-Identifier: MIT
// Unit tests of reading model files: what comes in as authored, and what is refused with one line.
#include "scene/import.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <set>

#include "pgl/host/parallel.hpp"
#include "support/test_data.hpp"

namespace {

using pgl::scene::Error;
using pgl::scene::import_scene;
using pgl::scene::ImportOptions;
using pgl::scene::ImportReport;
using pgl::scene::MeshData;
using pgl::scene::NonFinite;
using pgl::scene::Scene;
using support::fixture;
using support::TemporaryFolder;
using Corners = pgl::Triangle<std::uint32_t>;
using Points = std::vector<glm::vec3>;

// ---- helpers --------------------------------------------------------------------------------------------------------

template <class T>
void append(std::string& bytes, T value, bool big_endian = false) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  if (big_endian) std::reverse(raw, raw + sizeof value);
  bytes.append(raw, sizeof value);
}

const Points tetra_points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
const std::vector<Corners> tetra_triangles{{{0, 2, 1}}, {{0, 1, 3}}, {{1, 2, 3}}, {{2, 0, 3}}};

/// Lists have lengths of one byte, or four in the big-endian form.
std::string binary_ply(bool big_endian) {
  std::string bytes = std::string("ply\nformat binary_") + (big_endian ? "big" : "little") +
                      "_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
                      "element face 4\nproperty list " +
                      (big_endian ? "uint" : "uchar") + " int vertex_indices\nend_header\n";
  for (const glm::vec3& p : tetra_points)
    for (int axis = 0; axis < 3; ++axis) append(bytes, p[axis], big_endian);
  for (const Corners& t : tetra_triangles) {
    if (big_endian)
      append(bytes, std::uint32_t{3}, true);
    else
      append(bytes, std::uint8_t{3});
    for (const std::uint32_t v : t.v) append(bytes, static_cast<std::int32_t>(v), big_endian);
  }
  return bytes;
}

std::string binary_stl() {
  std::string bytes(80, ' ');
  append(bytes, std::uint32_t{4});
  for (const Corners& t : tetra_triangles) {
    for (int k = 0; k < 3; ++k) append(bytes, 0.0f);
    for (const std::uint32_t v : t.v)
      for (int axis = 0; axis < 3; ++axis) append(bytes, tetra_points[v][axis]);
    append(bytes, std::uint16_t{0});
  }
  return bytes;
}

/// A GLB file of one binary chunk; `json` is everything but the asset and the buffer.
std::string glb(const std::string& json, const std::string& binary) {
  std::string text =
      R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":)" + std::to_string(binary.size()) + "}]," + json + "}";
  text.resize((text.size() + 3) / 4 * 4, ' ');
  std::string bytes = "glTF";
  append(bytes, std::uint32_t{2});
  append(bytes, static_cast<std::uint32_t>(28 + text.size() + binary.size()));
  append(bytes, static_cast<std::uint32_t>(text.size()));
  bytes += "JSON" + text;
  append(bytes, static_cast<std::uint32_t>(binary.size()));
  return bytes + std::string("BIN\0", 4) + binary;
}

/// The tetrahedron as a GLB; `accessors` and `nodes` can be replaced.
std::string tetra_glb(const std::string& nodes = R"([{"mesh":0}])", const std::string& index_count = "12",
                      const std::string& extra = "", std::uint16_t first_index = 0) {
  std::string binary;
  for (const glm::vec3& p : tetra_points)
    for (int axis = 0; axis < 3; ++axis) append(binary, p[axis]);
  for (const Corners& t : tetra_triangles)
    for (const std::uint32_t v : t.v) append(binary, static_cast<std::uint16_t>(v));
  std::memcpy(binary.data() + 48, &first_index, 2);
  return glb(extra + R"("scene":0,"scenes":[{"nodes":[0]}],"nodes":)" + nodes +
                 R"(,"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
      "accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,1]},
                   {"bufferView":1,"componentType":5123,"count":)" +
                 index_count + R"(,"type":"SCALAR"}],
      "bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":24}])",
             binary);
}

/// World-space triangles of an object as corner positions, computed in long double.
std::vector<std::array<std::array<long double, 3>, 3>> world_triangles(const Scene& scene, std::size_t object) {
  std::vector<std::array<std::array<long double, 3>, 3>> result;
  const auto& m = scene.objects[object].transform;
  const MeshData& mesh = scene.meshes[scene.objects[object].mesh];
  for (const Corners& t : mesh.triangles) {
    auto& triangle = result.emplace_back();
    for (int corner = 0; corner < 3; ++corner)
      for (int row = 0; row < 3; ++row) {
        long double sum = m[3][row];
        for (int column = 0; column < 3; ++column)
          sum += static_cast<long double>(m[column][row]) * mesh.positions[t.v[corner]][column];
        triangle[corner][row] = sum;
      }
  }
  return result;
}

void expect_sound(const Scene& scene) {
  EXPECT_FALSE(scene.objects.empty());
  for (const auto& object : scene.objects) EXPECT_LT(object.mesh, scene.meshes.size());
  for (const MeshData& mesh : scene.meshes) {
    EXPECT_FALSE(mesh.triangles.empty());
    for (const Corners& t : mesh.triangles)
      for (const std::uint32_t v : t.v) {
        ASSERT_LT(v, mesh.positions.size());
        for (int axis = 0; axis < 3; ++axis) EXPECT_TRUE(std::isfinite(mesh.positions[v][axis]));
      }
  }
}

/// The reason of the Error that importing throws, after checking its form; empty when it succeeds.
std::string reason(const std::filesystem::path& file, const ImportOptions& options = {}) {
  try {
    expect_sound(import_scene(file, options));
    return {};
  } catch (const Error& error) {
    const std::string line = error.what();
    std::string start = file.native() + ": ";
    std::replace(start.begin(), start.end(), '\n', ' ');
    EXPECT_EQ(line.rfind(start, 0), 0u) << line;
    EXPECT_EQ(std::count_if(line.begin(), line.end(), [](unsigned char c) { return c < 32; }), 0) << line;
    EXPECT_GT(line.size(), start.size());
    EXPECT_LT(line.size(), start.size() + 300) << line;
    return line.substr(std::min(start.size(), line.size()));
  }
}

// ---- OBJ ------------------------------------------------------------------------------------------------------------

TEST(ImportObj, KeepsObjectsAndDoesNotSplitThemByMaterial) {
  ImportReport report;
  const Scene scene = import_scene(fixture("objects.obj"), {}, {}, &report);
  expect_sound(scene);
  ASSERT_EQ(scene.objects.size(), 2u);
  ASSERT_EQ(scene.meshes.size(), 2u);
  EXPECT_EQ(scene.objects[0].transform, glm::mat4x3(1.0f));
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(scene.objects[k].mesh, static_cast<std::uint32_t>(k));
    EXPECT_EQ(scene.meshes[k].triangles.size(), 2u);
    EXPECT_EQ(scene.meshes[k].positions.size(), 4u);  // welded inside an object, never across
  }
  EXPECT_EQ(report.objects_read, 2u);
  EXPECT_EQ(report.triangles_read, 4u);
  EXPECT_EQ(report.vertices_read, report.welded.merged + report.welded.unreferenced + 8);
  EXPECT_TRUE(report.warnings.empty());
}

TEST(ImportObj, MakesAnObjectOfEveryGroupAndCutsConcavePolygons) {
  const Scene scene = import_scene(fixture("groups.obj"));
  expect_sound(scene);
  ASSERT_EQ(scene.objects.size(), 3u);
  EXPECT_EQ(scene.meshes[0].positions, (Points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(scene.meshes[1].positions, (Points{{0, 0, 1}, {1, 0, 1}, {0, 1, 1}}));
  // The arrow: triangles all counter-clockwise, whose areas add up to the pentagon's (shoelace: 10).
  ASSERT_EQ(scene.meshes[2].triangles.size(), 3u);
  double area = 0;
  for (const auto& t : world_triangles(scene, 2)) {
    const double twice =
        static_cast<double>((t[1][0] - t[0][0]) * (t[2][1] - t[0][1]) - (t[2][0] - t[0][0]) * (t[1][1] - t[0][1]));
    EXPECT_GT(twice, 0);
    area += twice / 2;
  }
  EXPECT_EQ(area, 10.0);
}

TEST(ImportObj, DropsPointsAndLinesAndCountsThem) {
  ImportReport report;
  const Scene scene = import_scene(fixture("lines.obj"), {}, {}, &report);
  ASSERT_EQ(scene.meshes.size(), 1u);
  EXPECT_EQ(scene.meshes[0].positions, (Points{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(scene.meshes[0].triangles, (std::vector<Corners>{{{0, 1, 2}}}));
  EXPECT_EQ(report.points_and_lines, 4u);  // one segment, two segments, one point
}

TEST(ImportObj, LetsEqualObjectsShareAMesh) {
  const TemporaryFolder folder;
  const auto file = folder.write("twins.obj",
                                 "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
                                 "o b\nv 0 0 0\nv 1 0 0\nv 0 2 0\nf 4 5 6\n"
                                 "o c\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 7 8 9\n");
  const Scene scene = import_scene(file);
  ASSERT_EQ(scene.objects.size(), 3u);
  EXPECT_EQ(scene.meshes.size(), 2u);
  EXPECT_EQ(scene.objects[0].mesh, 0u);
  EXPECT_EQ(scene.objects[1].mesh, 1u);
  EXPECT_EQ(scene.objects[2].mesh, 0u);
}

TEST(ImportObj, LeavesVerticesAloneWithoutWelding) {
  ImportOptions options;
  options.weld = false;
  ImportReport report;
  const Scene scene = import_scene(fixture("objects.obj"), options, {}, &report);
  expect_sound(scene);
  EXPECT_EQ(report.welded.merged, 0u);
  EXPECT_EQ(scene.meshes[0].positions.size() + scene.meshes[1].positions.size(), report.vertices_read);
}

// ---- PLY and STL ----------------------------------------------------------------------------------------------------

TEST(ImportPly, ReadsTextAndBothBinaryOrders) {
  const TemporaryFolder folder;
  for (const auto& file : {fixture("tetra.ply"), folder.write("little.ply", binary_ply(false)),
                           folder.write("big.PLY", binary_ply(true))}) {
    const Scene scene = import_scene(file);
    ASSERT_EQ(scene.meshes.size(), 1u) << file;
    ASSERT_EQ(scene.objects.size(), 1u);
    EXPECT_EQ(scene.meshes[0].positions, tetra_points);
    EXPECT_EQ(scene.meshes[0].triangles, tetra_triangles);
  }
}

TEST(ImportPly, AcceptsFacesOfFewerThanThreeCorners) {
  const TemporaryFolder folder;
  const auto file =
      folder.write("segment.ply",
                   "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                   "property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
                   "0 0 0\n1 0 0\n0 1 0\n2 0 1\n3 0 1 2\n1 2\n0\n");
  ImportReport report;
  const Scene scene = import_scene(file, {}, {}, &report);
  EXPECT_EQ(scene.meshes.at(0).triangles, (std::vector<Corners>{{{0, 1, 2}}}));
  EXPECT_EQ(report.points_and_lines, 3u);
}

TEST(ImportStl, WeldsTheSoupOfTextAndBinary) {
  const TemporaryFolder folder;
  for (const auto& file : {fixture("tetra.stl"), folder.write("binary.stl", binary_stl())}) {
    const Scene scene = import_scene(file);
    ASSERT_EQ(scene.meshes.size(), 1u) << file;
    ASSERT_EQ(scene.meshes[0].triangles.size(), 4u);
    EXPECT_EQ(scene.meshes[0].positions.size(), 4u);
    for (std::size_t t = 0; t < 4; ++t)
      for (int corner = 0; corner < 3; ++corner)
        EXPECT_EQ(scene.meshes[0].positions[scene.meshes[0].triangles[t].v[corner]],
                  tetra_points[tetra_triangles[t].v[corner]]);
  }
}

TEST(ImportStl, MakesAnObjectOfEverySolid) {
  const Scene scene = import_scene(fixture("two_solids.stl"));
  ASSERT_EQ(scene.objects.size(), 2u);
  EXPECT_EQ(scene.meshes[scene.objects[0].mesh].triangles.size(), 4u);
  EXPECT_EQ(scene.meshes[scene.objects[1].mesh].triangles.size(), 2u);
}

// ---- glTF -----------------------------------------------------------------------------------------------------------

TEST(ImportGltf, SharesMeshesAndComposesTransforms) {
  const Scene scene = import_scene(fixture("nodes.gltf"));
  expect_sound(scene);
  ASSERT_EQ(scene.objects.size(), 3u);
  ASSERT_EQ(scene.meshes.size(), 2u);
  EXPECT_EQ(scene.objects[0].mesh, 0u);
  EXPECT_EQ(scene.objects[1].mesh, 0u);
  EXPECT_EQ(scene.objects[2].mesh, 1u);
  EXPECT_EQ(scene.meshes[0].positions, tetra_points);
  EXPECT_EQ(scene.meshes[0].triangles, tetra_triangles);
  EXPECT_EQ(scene.meshes[1].triangles,
            (std::vector<Corners>{tetra_triangles[0], tetra_triangles[1]}));  // both materials
  EXPECT_EQ(scene.objects[0].transform, glm::mat4x3(2, 0, 0, 0, 2, 0, 0, 0, 2, 10, 0, 0));
  EXPECT_EQ(scene.objects[1].transform, glm::mat4x3(-2, 0, 0, 0, 2, 0, 0, 0, 2, 10, 6, 0));  // mirrored, kept so
  const glm::mat4x3 quarter_turn(0, 1, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0);
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 3; ++row)
      EXPECT_NEAR(scene.objects[2].transform[column][row], quarter_turn[column][row], 1e-6);
}

TEST(ImportGltf, ComposesDeepTreesInDouble) {
  // 600 steps of 0.1 and then back by 600 * float(0.1): sums in float drift by far more than one rounding.
  std::string nodes = "[";
  for (int k = 0; k < 600; ++k) nodes += R"({"translation":[0.1,0,0],"children":[)" + std::to_string(k + 1) + "]},";
  nodes += R"({"mesh":0}])";
  const TemporaryFolder folder;
  const Scene scene = import_scene(folder.write("deep.glb", tetra_glb(nodes)));
  ASSERT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(scene.objects[0].transform[3][0], static_cast<float>(600.0 * static_cast<double>(0.1f)));
}

TEST(ImportGltf, SplitsEachMeshOnceAndPlacesItsComponents) {
  // Two tetrahedra in one mesh, placed twice.
  std::string binary;
  for (int k = 0; k < 2; ++k)
    for (const glm::vec3& p : tetra_points)
      for (int axis = 0; axis < 3; ++axis) append(binary, p[axis] + (axis == 0 ? 5.0f * static_cast<float>(k) : 0.0f));
  for (std::uint32_t k = 0; k < 2; ++k)
    for (const Corners& t : tetra_triangles)
      for (const std::uint32_t v : t.v) append(binary, v + 4 * k);
  const TemporaryFolder folder;
  const auto file = folder.write("pair.glb", glb(R"("scene":0,"scenes":[{"nodes":[0,1]}],
        "nodes":[{"mesh":0},{"mesh":0,"translation":[0,7,0]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3","min":[0,0,0],"max":[6,1,1]},
                     {"bufferView":1,"componentType":5125,"count":24,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":96},{"buffer":0,"byteOffset":96,"byteLength":96}])",
                                                 binary));
  EXPECT_EQ(import_scene(file).objects.size(), 2u);
  ImportOptions options;
  options.split = true;
  Scene scene = import_scene(file, options);
  expect_sound(scene);
  ASSERT_EQ(scene.meshes.size(), 2u);
  ASSERT_EQ(scene.objects.size(), 4u);
  for (std::uint32_t k = 0; k < 4; ++k) {
    EXPECT_EQ(scene.objects[k].mesh, k % 2);
    EXPECT_EQ(scene.objects[k].transform[3], glm::vec3(0, k < 2 ? 0 : 7, 0));
  }
  EXPECT_EQ(scene.meshes[0].positions, tetra_points);
  EXPECT_EQ(scene.meshes[1].positions[0], glm::vec3(5, 0, 0));

  options.flatten = true;
  scene = import_scene(file, options);
  ASSERT_EQ(scene.meshes.size(), 4u);
  EXPECT_EQ(scene.meshes[3].positions[0], glm::vec3(5, 7, 0));
}

TEST(ImportGltf, FlattensToWorldSpaceAndTurnsMirroredTriangles) {
  const Scene placed = import_scene(fixture("nodes.gltf"));
  ImportOptions options;
  options.flatten = true;
  const Scene flat = import_scene(fixture("nodes.gltf"), options);
  expect_sound(flat);
  ASSERT_EQ(flat.objects.size(), 3u);
  ASSERT_EQ(flat.meshes.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(flat.objects[i], (pgl::Object{static_cast<std::uint32_t>(i), glm::mat4x3(1.0f)}));
    auto expected = world_triangles(placed, i);
    const auto got = world_triangles(flat, i);
    ASSERT_EQ(got.size(), expected.size());
    for (std::size_t t = 0; t < got.size(); ++t) {
      if (i == 1) std::swap(expected[t][1], expected[t][2]);
      for (int corner = 0; corner < 3; ++corner)
        for (int axis = 0; axis < 3; ++axis)
          EXPECT_NEAR(static_cast<double>(got[t][corner][axis]), static_cast<double>(expected[t][corner][axis]), 1e-6);
    }
  }
}

// ---- non-finite geometry --------------------------------------------------------------------------------------------

TEST(ImportNonFinite, DropsTheObjectWithALineNamingFileAndObject) {
  ImportReport report;
  const Scene scene = import_scene(fixture("non_finite.obj"), {}, {}, &report);
  expect_sound(scene);
  ASSERT_EQ(scene.objects.size(), 2u);
  EXPECT_EQ(scene.meshes[0].positions[0], glm::vec3(0, 0, 0));
  EXPECT_EQ(scene.meshes[1].positions[0], glm::vec3(0, 0, 2));  // its unused NaN vertex does no harm
  EXPECT_EQ(report.objects_dropped, 2u);
  ASSERT_EQ(report.warnings.size(), 1u);
  EXPECT_EQ(report.warnings[0].rfind(fixture("non_finite.obj").native() + ": ", 0), 0u);
  EXPECT_NE(report.warnings[0].find("'nan'"), std::string::npos);
  EXPECT_NE(report.warnings[0].find('2'), std::string::npos);
}

TEST(ImportNonFinite, RefusesTheFileWhenAsked) {
  ImportOptions options;
  options.non_finite = NonFinite::refuse_file;
  EXPECT_NE(reason(fixture("non_finite.obj"), options).find("'nan'"), std::string::npos);
  EXPECT_EQ(reason(fixture("objects.obj"), options), "");
}

TEST(ImportNonFinite, DropsPlacementsThatLeaveTheFloatRange) {
  const TemporaryFolder folder;
  const auto file = folder.write(
      "far.glb", tetra_glb(R"([{"children":[1,2]},{"mesh":0},{"name":"huge","scale":[1e30,1e30,1e30],"children":[3]},
                               {"name":"too far","mesh":0,"scale":[1e30,1,1]}])"));
  for (const bool flatten : {false, true}) {
    ImportOptions options;
    options.flatten = flatten;
    ImportReport report;
    EXPECT_EQ(import_scene(file, options, {}, &report).objects.size(), 1u);
    EXPECT_EQ(report.objects_dropped, 1u);
    ASSERT_EQ(report.warnings.size(), 1u);
    EXPECT_NE(report.warnings[0].find("'too far'"), std::string::npos);
  }
}

TEST(ImportNonFinite, SaysSoWhenNothingIsLeft) {
  const TemporaryFolder folder;
  const auto file = folder.write("nan.obj", "o lost\nv nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  EXPECT_NE(reason(file).find("nothing is left"), std::string::npos);
}

// ---- bad input ------------------------------------------------------------------------------------------------------

TEST(ImportBadInput, IsToldInOneLineThatNamesTheFile) {
  const TemporaryFolder folder;
  const auto expect = [&](const std::filesystem::path& file, const char* part) {
    const std::string why = reason(file);
    EXPECT_NE(why.find(part), std::string::npos) << file << ": " << why;
  };
  const auto write = [&](const char* name, const std::string& bytes) { return folder.write(name, bytes); };
  expect(folder.path() / "missing.obj", "No such file");
  expect(folder.path() / "new\nline.obj/missing.obj", "No such file");
  expect(folder.path(), "is a directory");
  for (const char* name : {"empty.obj", "empty.ply", "empty.stl", "empty.gltf", "empty.glb"})
    expect(write(name, ""), "is empty");
  for (const char* name : {"model.txt", "model", "model.dae", "obj"})
    expect(write(name, "v 0 0 0\n"), "unknown format");
  ASSERT_EQ(mkfifo((folder.path() / "pipe.obj").c_str(), 0600), 0);
  expect(folder.path() / "pipe.obj", "not a regular file");

  expect(fixture("out_of_range.obj"), "out of range");
  expect(fixture("out_of_range.ply"), "out of range");
  expect(write("index.glb", tetra_glb(R"([{"mesh":0}])", "12", "", 9)), "out of range");
  expect(fixture("no_faces.obj"), "has no triangles");
  expect(fixture("cloud.ply"), "has no triangles");
  expect(write("no_nodes.glb", tetra_glb(R"([{"name":"nothing"}])")), "has no triangles");
  expect(write("solid.stl", "solid nothing\nendsolid nothing\n"), "");

  expect(fixture("four_billion.ply"), "truncated: 4294967295");
  std::string stl = binary_stl();
  std::fill_n(stl.begin() + 80, 4, '\xff');
  expect(write("four_billion.stl", stl), "truncated: 4294967295");
  expect(write("short.glb", tetra_glb().substr(0, 200)), "200 there");
  expect(write("four_billion.glb", tetra_glb(R"([{"mesh":0}])", "4294967295")), "past its buffer view");
  expect(write("list.ply",
               "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
               "element face 1\nproperty list uint int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
               "4294967295 0 1 2\n"),
         "truncated");
  std::string list = binary_ply(false);
  list.replace(list.find("uchar"), 5, "uint");  // the list's first bytes 3 0 0 0 count three, but then all is shifted
  expect(write("shifted.ply", list), "truncated");
  expect(write("not.ply", "plyformat"), "truncated");
  expect(write("other.ply", "solid x\n"), "not a PLY");
  expect(write("other.glb", fixture("objects.obj").native() + std::string(40, ' ')), "not a GLB");
  expect(write("text.gltf", "{"), "JSON");
  expect(write("list.gltf", "[1,2,3]"), "JSON");
  expect(write("version.gltf", R"({"asset":{"version":"3.0"}})"), "not glTF 2");
  expect(write("outside.gltf", R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":4294967295,"uri":"none.bin"}],
    "scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
    "bufferViews":[{"buffer":0,"byteLength":36}]})"),
         "cannot be read");
  for (const char* extension : {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization"})
    expect(write("compressed.glb",
                 tetra_glb(R"([{"mesh":0}])", "12", std::string(R"("extensionsRequired":[")") + extension + "\"],")),
           extension);
}

TEST(ImportBadInput, OfTreesWithoutEndIsSurvived) {
  const TemporaryFolder folder;
  EXPECT_NE(reason(folder.write("cycle.glb", tetra_glb(R"([{"mesh":0,"children":[0]}])"))), "");
  EXPECT_NE(reason(folder.write("brackets.gltf", std::string(500'000, '['))), "");
  EXPECT_NE(reason(folder.write("objects.gltf",
                                [] {
                                  std::string text;
                                  for (int k = 0; k < 200'000; ++k) text += "{\"a\":";
                                  return text;
                                }())),
            "");
  std::string chain = "[";
  for (int k = 0; k < 20'000; ++k) chain += R"({"children":[)" + std::to_string(k + 1) + "]},";
  reason(folder.write("chain.glb", tetra_glb(chain + R"({"mesh":0}])")));  // read or refused, but nothing falls over
}

TEST(ImportBadInput, OfRandomBytesIsRefused) {
  const TemporaryFolder folder;
  std::mt19937 random(1);
  for (const char* extension : {".obj", ".ply", ".stl", ".gltf", ".glb"})
    for (const std::size_t size : {1u, 7u, 83u, 84u, 134u, 5000u}) {
      std::string bytes(size, ' ');
      for (char& c : bytes) c = static_cast<char>(random());
      EXPECT_NE(reason(folder.write(std::string("garbage") + extension, bytes)), "") << extension << ' ' << size;
    }
}

TEST(ImportBadInput, CutAtAnyPlaceIsRefusedOrSound) {
  const TemporaryFolder folder;
  const std::array<std::pair<const char*, std::string>, 6> whole{
      {{"cut.ply", support::read_bytes(fixture("tetra.ply"))},
       {"cut_binary.ply", binary_ply(false)},
       {"cut.stl", support::read_bytes(fixture("tetra.stl"))},
       {"cut_binary.stl", binary_stl()},
       {"cut.glb", tetra_glb()},
       {"cut.obj", support::read_bytes(fixture("objects.obj"))}}};
  for (const auto& [name, bytes] : whole) {
    ASSERT_EQ(reason(folder.write(name, bytes)), "");
    const bool can_tell = std::string_view(name) != "cut.obj";
    // Text may lose its last line end, and digits of its last number, and still promise nothing more.
    const std::size_t end = bytes.size() - (bytes.back() == '\n' ? 13 : 1);
    for (std::size_t k = 0; k < 20; ++k) {
      const std::size_t length = end * k / 19;
      const std::string why = reason(folder.write(name, bytes.substr(0, length)));
      if (can_tell) {
        EXPECT_NE(why, "") << name << " cut to " << length << " of " << bytes.size();
      }
    }
  }
}

TEST(ImportBadInput, WithFlippedBitsIsRefusedOrSound) {
  const TemporaryFolder folder;
  const std::array<std::pair<const char*, std::string>, 7> whole{
      {{"flip.ply", support::read_bytes(fixture("tetra.ply"))},
       {"flip_binary.ply", binary_ply(true)},
       {"flip.stl", support::read_bytes(fixture("two_solids.stl"))},
       {"flip_binary.stl", binary_stl()},
       {"flip.gltf", support::read_bytes(fixture("nodes.gltf"))},
       {"flip.glb", tetra_glb()},
       {"flip.obj", support::read_bytes(fixture("groups.obj"))}}};
  std::mt19937 random(2);
  for (const auto& [name, bytes] : whole)
    for (int k = 0; k < 20; ++k) {
      std::string changed = bytes;
      for (int flips = 0; flips <= k % 8; ++flips)
        changed[random() % changed.size()] ^= static_cast<char>(1 << random() % 8);
      ImportOptions options;
      options.weld = k % 2;
      options.split = k % 3 == 0;
      options.flatten = k % 5 == 0;
      reason(folder.write(name, changed), options);
    }
}

// ---- the work itself ------------------------------------------------------------------------------------------------

TEST(Import, TellsProgressThatEndsAtTheTotal) {
  ImportOptions options;
  options.split = options.flatten = true;
  std::set<std::string> stages;
  std::size_t last = 0, last_total = 0;
  import_scene(fixture("nodes.gltf"), options, [&](std::string_view stage, std::size_t done, std::size_t total) {
    EXPECT_LE(done, total);
    stages.insert(std::string(stage));
    last = done;
    last_total = total;
  });
  for (const char* stage : {"weld", "split", "flatten"}) EXPECT_TRUE(stages.count(stage)) << stage;
  EXPECT_EQ(last, last_total);
}

TEST(Import, EndsWhenProgressThrowsAndLeavesNoChildBehind) {
  struct Stop {};
  for (const char* at : {"weld", "flatten"}) {
    ImportOptions options;
    options.flatten = true;
    const auto stop = [&](std::string_view stage, std::size_t, std::size_t) {
      if (stage == at) throw Stop{};
    };
    EXPECT_THROW(import_scene(fixture("nodes.gltf"), options, stop), Stop);
  }
  reason(fixture("out_of_range.ply"));
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

#if defined(_OPENMP)
TEST(Import, DoesNotDependOnTheNumberOfThreads) {
  ImportOptions options;
  options.split = options.flatten = true;
  const int threads = omp_get_max_threads();
  std::vector<Scene> scenes;
  for (const int n : {1, 4}) {
    omp_set_num_threads(n);
    scenes.push_back(import_scene(fixture("nodes.gltf"), options));
  }
  omp_set_num_threads(threads);
  EXPECT_EQ(scenes[0].objects, scenes[1].objects);
  ASSERT_EQ(scenes[0].meshes.size(), scenes[1].meshes.size());
  for (std::size_t m = 0; m < scenes[0].meshes.size(); ++m) {
    EXPECT_EQ(scenes[0].meshes[m].positions, scenes[1].meshes[m].positions);
    EXPECT_EQ(scenes[0].meshes[m].triangles, scenes[1].meshes[m].triangles);
  }
}
#endif

/// Counts that were taken from the files by other means (a separate reader of the JSON and of the text).
TEST(ImportRealModels, HaveTheObjectsTrianglesAndVerticesThatAreKnown) {
  struct Known {
    const char* file;
    std::size_t objects, triangles, vertices;  // instanced; vertices after welding
  };
  const Known known[] = {{"ifc/duplex.glb", 692, 26'774, 61'478 - 46'257},
                         {"ifc/mini_project.glb", 2'636, 261'069, 535'195 - 401'159},
                         {"ifc/office_a.glb", 1'461, 49'923, 119'601 - 91'509},
                         {"ifc/smiley_west.glb", 2'831, 40'396, 82'264 - 56'302},
                         {"single/2CylinderEngine.glb", 67, 121'496, 0},
                         {"single/dragon_vrip_res2.ply", 1, 202'520, 100'250 - 43},
                         {"single/stanford-bunny.obj", 1, 69'451, 35'947 - 1'113},
                         {"single/beetle-alt.obj", 1, 38'656, 19'887 - 2},
                         {"single/suzanne.obj", 1, 968, 507 - 2},
                         {"single/teapot.obj", 1, 6'320, 3'644 - 403},
                         {"synthetic_pathologies/homer_soup.obj", 1, 12'000, 36'000 - 29'998},
                         {"synthetic_pathologies/homer_degenerate_dup.obj", 1, 13'000, 6'002}};
  int found = 0;
  for (const Known& k : known) {
    const auto file = support::real_model(k.file);
    if (file.empty()) continue;
    ++found;
    const Scene scene = import_scene(file);
    std::size_t triangles = 0, vertices = 0;
    for (const auto& object : scene.objects) {
      triangles += scene.meshes[object.mesh].triangles.size();
      vertices += scene.meshes[object.mesh].positions.size();
    }
    EXPECT_EQ(scene.objects.size(), k.objects) << k.file;
    EXPECT_EQ(triangles, k.triangles) << k.file;
    if (k.vertices != 0) {
      EXPECT_EQ(vertices, k.vertices) << k.file;
    }
  }
  if (found == 0) GTEST_SKIP() << "no real models here; set PGL_TEST_DATA to their folder";
}

}  // namespace
