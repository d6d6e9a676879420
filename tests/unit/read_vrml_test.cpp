// SPDX-License-Identifier: MIT
// Unit tests of reading VRML: which objects come in, where they are, and what is refused with one line.
#include <gtest/gtest.h>

#include <cctype>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "scene/import.hpp"
#include "support/test_data.hpp"

namespace {

using pgl::scene::Error;
using pgl::scene::import_scene;
using pgl::scene::ImportOptions;
using pgl::scene::ImportReport;
using pgl::scene::MeshData;
using pgl::scene::Scene;
using support::TemporaryFolder;

const std::string header = "#VRML V2.0 utf8\n";

/// Why the file is refused, or nothing.
std::string reason(const std::string& text, const char* name = "model.wrl") {
  const TemporaryFolder folder;
  const auto file = folder.write(name, text);
  try {
    import_scene(file);
  } catch (const Error& error) {
    EXPECT_EQ(std::string(error.what()).rfind(file.native() + ": ", 0), 0u) << error.what();
    return error.what();
  }
  return {};
}

Scene read(const std::string& text, const ImportOptions& options = {}, ImportReport* report = nullptr) {
  const TemporaryFolder folder;
  return import_scene(folder.write("model.WRL", header + text), options, {}, report);
}

/// Twice the area of the triangles, as a vector: which way a flat surface faces.
glm::dvec3 area(const MeshData& mesh) {
  glm::dvec3 sum(0.0);
  for (const auto& t : mesh.triangles) {
    const glm::dvec3 a(mesh.positions[t.v[0]]), b(mesh.positions[t.v[1]]), c(mesh.positions[t.v[2]]);
    sum += glm::cross(b - a, c - a);
  }
  return sum;
}

double volume(const MeshData& mesh) {
  double sum = 0.0;
  for (const auto& t : mesh.triangles) {
    const glm::dvec3 a(mesh.positions[t.v[0]]), b(mesh.positions[t.v[1]]), c(mesh.positions[t.v[2]]);
    sum += glm::dot(a, glm::cross(b, c)) / 6.0;
  }
  return sum;
}

std::string face(const std::string& points, const std::string& more = "", const std::string& material = "") {
  return "Shape { geometry IndexedFaceSet { coord Coordinate { point [" + points + "] } coordIndex [0 1 2 3 -1] " +
         more + " }" + (material.empty() ? "" : " appearance Appearance { material " + material + " }") + " }\n";
}
const std::string square = "0 0 0, 1 0 0, 1 1 0, 0 1 0", above = "0 0 2, 1 0 2, 1 1 2, 0 1 2";
const std::string beside = "1 0 0, 2 0 0, 2 1 0, 1 1 0";

class Vrml : public testing::Test {
 protected:
  void SetUp() override {
    const std::string why = reason(header + face(square));
    if (why.find("without which this program was built") != std::string::npos) GTEST_SKIP() << why;
    ASSERT_EQ(why, "");
  }
};

TEST_F(Vrml, FacesComeInWithTheirWinding) {
  for (const bool clockwise : {false, true}) {
    const Scene scene = read(face(square, clockwise ? "ccw FALSE" : ""));
    ASSERT_EQ(scene.objects.size(), 1u);
    EXPECT_EQ(scene.meshes[0].positions.size(), 4u);
    EXPECT_EQ(scene.meshes[0].triangles.size(), 2u);
    EXPECT_EQ(area(scene.meshes[0]), glm::dvec3(0, 0, clockwise ? -2 : 2));
  }
  // A polygon that is not convex, an arrow, has its own area and no more.
  const Scene arrow = read(face("0 0 0, 2 2 0, 0 1 0, -2 2 0", "convex FALSE"));
  EXPECT_EQ(arrow.meshes.at(0).triangles.size(), 2u);
  EXPECT_EQ(area(arrow.meshes[0]), glm::dvec3(0, 0, 4));
}

TEST_F(Vrml, ShapesOfOneMaterialSideBySideAreOneObject) {
  const std::string red = "DEF RED Material { diffuseColor 1 0 0 }", blue = "DEF BLUE Material { }";
  const Scene scene = read(face(square, "", red) + face(beside, "", blue) + face(above, "", "USE RED") + face(above) +
                           face(beside, "", "USE RED"));
  ASSERT_EQ(scene.objects.size(), 3u);
  EXPECT_EQ(scene.meshes[scene.objects[0].mesh].positions.size(), 10u);  // two of the three faces share an edge
  EXPECT_EQ(scene.meshes[scene.objects[1].mesh].positions.size(), 4u);
  EXPECT_EQ(scene.meshes[scene.objects[2].mesh].positions.size(), 4u);
  ImportOptions split;
  split.split = true;
  EXPECT_EQ(
      read(face(square, "", red) + face(beside, "", "USE RED") + face(above, "", "USE RED"), split).objects.size(), 2u);
}

TEST_F(Vrml, AnInstanceIsPlacedByItsNodeAndSharesTheMesh) {
  const Scene scene = read("Transform { translation 10 0 0 children DEF PART Transform { scale 2 3 4 children [ " +
                           face(square) + " ] } }\nTransform { translation 0 20 0 children USE PART }\nUSE PART\n");
  ASSERT_EQ(scene.objects.size(), 3u);
  ASSERT_EQ(scene.meshes.size(), 1u);
  EXPECT_EQ(area(scene.meshes[0]), glm::dvec3(0, 0, 2));
  const std::vector<glm::vec3> places{{10, 0, 0}, {0, 20, 0}, {0, 0, 0}};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(scene.objects[i].transform[0], glm::vec3(2, 0, 0));
    EXPECT_EQ(scene.objects[i].transform[1], glm::vec3(0, 3, 0));
    EXPECT_EQ(scene.objects[i].transform[2], glm::vec3(0, 0, 4));
    EXPECT_EQ(scene.objects[i].transform[3], places[i]);
  }
}

TEST_F(Vrml, RotationsTurnTheRightWay) {
  const Scene scene = read("Transform { rotation 0 0 1 1.5707964 children " + face(square) + " }");
  const glm::vec3 x = scene.objects.at(0).transform[0];  // a quarter turn about z: x becomes y
  EXPECT_NEAR(x.x, 0, 1e-6);
  EXPECT_NEAR(x.y, 1, 1e-6);
}

TEST_F(Vrml, SolidsAreClosedAndFaceOutwards) {
  const double pi = 3.14159265358979;
  const auto only = [](const char* geometry) { return read(std::string("Shape { geometry ") + geometry + " }"); };
  const Scene box = only("Box { size 1 2 3 }");
  EXPECT_EQ(box.meshes.at(0).positions.size(), 8u);
  EXPECT_NEAR(volume(box.meshes[0]), 6.0, 1e-6);
  EXPECT_NEAR(volume(only("Sphere { radius 1 }").meshes.at(0)), 4 * pi / 3, 0.3);
  EXPECT_NEAR(volume(only("Cylinder { radius 1 height 2 }").meshes.at(0)), 2 * pi, 0.4);
  EXPECT_NEAR(volume(only("Cone { bottomRadius 1 height 3 }").meshes.at(0)), pi, 0.2);
  EXPECT_NEAR(volume(only("Extrusion { spine [0 0 0, 0 5 0] }").meshes.at(0)), 20.0, 1e-5);
  const Scene grid = only("ElevationGrid { xDimension 3 zDimension 2 height [0 0 0 0 0 0] }");
  EXPECT_EQ(area(grid.meshes.at(0)), glm::dvec3(0, 4, 0));
}

TEST_F(Vrml, LinesAndPointsAreCountedAndTextIsLeftOut) {
  ImportReport report;
  const Scene scene = read(
      "Shape { geometry IndexedLineSet { coord DEF C Coordinate { point [0 0 0, 1 1 1] } coordIndex [0 1 -1] } }\n"
      "Shape { geometry PointSet { coord USE C } }\nShape { geometry Text { string \"{ [ \\\" # Inline\" } }\n" +
          face(square),
      {}, &report);
  EXPECT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(report.points_and_lines, 2u);
  EXPECT_NE(reason(header + "Shape { }\n").find("has no triangles"), std::string::npos);
}

TEST_F(Vrml, BadFilesAreToldInOneLine) {
  const auto expect = [](const std::string& text, const char* part) {
    const std::string why = reason(text);
    EXPECT_NE(why.find(part), std::string::npos) << text.substr(0, 80) << ": " << why;
  };
  const std::string whole = header + face(square, "", "Material { }");
  EXPECT_EQ(reason(whole), "");
  for (std::size_t length = header.size() + 1; length + 1 < whole.size(); ++length)
    EXPECT_NE(reason(whole.substr(0, length)), "") << length;
  expect(whole.substr(0, whole.size() - 2), "truncated");
  expect(header + "DEF A \"no end", "truncated");
  expect(header + "Shape { geometry Box { ] }", "brackets do not match");
  expect("#VRML V1.0 ascii\nCube { }\n", "VRML 1.0");
  expect("#Inventor V2.1 ascii\nCube { }\n", "not a VRML 2.0 file");
  expect("\x1f\x8b\x08", "compressed");
  expect(header + "Inline { url \"other.wrl\" }", "needs other files");
  expect(header + "EXTERNPROTO P [ ] \"other.wrl\"\nP { }", "needs other files");
  expect(header + "Shape { geometry IndexedFaceSet { coord Coordinate { point [0 0 0] } coordIndex [0 1 2 -1] } }",
         "out of range");
  expect(header + "Shape { geometry IndexedFaceSet { coordIndex [0 1 2 -1] } }", "out of range");
  expect(header + face(square, "coordIndex [0 1 2 -7]"), "out of range");
  expect(header + "Shape { geometry ElevationGrid { xDimension 60000 zDimension 60000 height [0 0 0 0] } }",
         "too few heights");
  expect(header + face(square) + "Shape { geometry Bocks { } }", "cannot be read");
  expect(header + face(square, "colour 1"), "cannot be read");
  expect(header + face("0 0 0, 1 0 zero, 1 1 0, 0 1 0"), "cannot be read");
  expect(header + face("1e39 0 0, 1 0 0, 1 1 0, 0 1 0"), "line 2");
  std::string deep;
  for (int k = 0; k < 200'000; ++k) deep += "Group { children [";
  EXPECT_NE(reason(header + deep), "");
  for (int k = 0; k < 200'000; ++k) deep += "] }";
  EXPECT_NE(reason(header + deep), "");
}

TEST_F(Vrml, PlacementsThatLeaveTheFloatRangeDropTheirObject) {
  ImportReport report;
  const Scene scene = read("Transform { scale 1e38 1 1 children Transform { scale 1e38 1 1 children " + face(square) +
                               " } }\n" + face(square),
                           {}, &report);
  EXPECT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(report.objects_dropped, 1u);
}

TEST_F(Vrml, AnyChangedByteIsSurvived) {
  const TemporaryFolder folder;
  const std::string whole = header + "Transform { translation 1 2 3 children [ DEF A " +
                            face(square, "ccw FALSE convex FALSE", "Material { }") +
                            " USE A ] }\nShape { geometry Extrusion { spine [0 0 0, 0 5 0] } }\nShape { geometry "
                            "ElevationGrid { xDimension 2 "
                            "zDimension 2 height [0 1 0 1] } }\n";
  std::mt19937 random(1);
  int read_well = 0;
  for (int round = 0; round < 400; ++round) {
    std::string text = whole;
    const bool only_numbers = round % 2 == 0;  // else what is left is rarely VRML
    const std::string_view instead = only_numbers ? "0123456789.- " : "09-. eE{}[]\"#,\xff";
    for (int changes = 1 + round % 3; changes > 0; --changes) {
      std::size_t at = 0;
      do at = header.size() + random() % (text.size() - header.size());
      while (only_numbers && std::isdigit(static_cast<unsigned char>(text[at])) == 0);
      text[at] = instead[random() % instead.size()];
    }
    try {
      const Scene scene = import_scene(folder.write("changed.wrl", text));
      ++read_well;
      EXPECT_FALSE(scene.objects.empty());
      for (const pgl::Object& object : scene.objects) ASSERT_LT(object.mesh, scene.meshes.size());
      for (const MeshData& mesh : scene.meshes)
        for (const auto& t : mesh.triangles)
          for (const std::uint32_t v : t.v) ASSERT_LT(v, mesh.positions.size()) << text;
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
  EXPECT_GT(read_well, 50);
  EXPECT_LT(read_well, 350);
}

/// What anyone can install: Debian's kicad-packages3d.
TEST_F(Vrml, ARealConnectorHasItsPinsAndItsBody) {
  const std::filesystem::path file =
      "/usr/share/kicad/3dmodels/Connector_JST.3dshapes/JST_XH_B15B-XH-A_1x15_P2.50mm_Vertical.wrl";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "kicad-packages3d is not installed";
  ImportOptions split;
  split.split = true;
  ImportReport report;
  const Scene scene = import_scene(file, split, {}, &report);
  EXPECT_EQ(report.triangles_read, 1512u);
  EXPECT_EQ(scene.objects.size(), 16u);
}

}  // namespace
