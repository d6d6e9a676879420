// SPDX-License-Identifier: MIT
// Unit tests of preprocessing a whole scene.
#include "scene/build_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <span>
#include <stdexcept>

#include "pgl/host/build_ecol.hpp"
#include "pgl/host/parallel.hpp"
#include "scene/error.hpp"

namespace {

using pgl::scene::AnyModel;
using pgl::scene::build_any_model;
using pgl::scene::build_model;
using pgl::scene::BuildReport;
using pgl::scene::count_open_vertices;
using pgl::scene::Error;
using pgl::scene::MeshData;
using pgl::scene::MeshSize;
using pgl::scene::MeshSource;
using pgl::scene::Model;
using pgl::scene::Scene;
using Corners = pgl::Triangle<std::uint32_t>;
using Index16 = std::uint16_t;
using Index32 = std::uint32_t;

/// A bumpy grid of n x n vertices, moved so that every mesh differs.
MeshData grid(std::uint32_t n, float move = 0) {
  MeshData mesh;
  for (std::uint32_t y = 0; y < n; ++y)
    for (std::uint32_t x = 0; x < n; ++x)
      mesh.positions.push_back({static_cast<float>(x) + move, static_cast<float>(y), static_cast<float>((x * y) % 5)});
  for (std::uint32_t y = 0; y + 1 < n; ++y)
    for (std::uint32_t x = 0; x + 1 < n; ++x) {
      const std::uint32_t v = y * n + x;
      mesh.triangles.push_back({{v, v + 1, v + n}});
      mesh.triangles.push_back({{v + 1, v + n + 1, v + n}});
    }
  return mesh;
}

Scene varied_scene() {
  Scene scene;
  scene.meshes = {grid(6), {}, grid(2, 1), {{{1, 2, 3}}, {}}, grid(9, 2), {{{0, 0, 0}, {1, 0, 0}}, {{{0, 1, 1}}}}};
  for (std::uint32_t k = 0; k < 9; ++k) {
    scene.objects.push_back({k * 5 % 6, glm::mat4x3(1.0f)});
    scene.objects.back().transform[3] = {static_cast<float>(k) * 100, -7, 0.25f};
  }
  scene.objects[2].transform[0][0] = -2;
  return scene;
}

MeshSource source_of(const std::vector<MeshData>& meshes) {
  return {meshes.size(),
          [&](std::size_t m) {
            return MeshSize{meshes[m].positions.size(), meshes[m].triangles.size()};
          },
          [&](std::size_t m, MeshData& mesh) { mesh = meshes[m]; }};
}

template <class Index>
void expect_equal(const Model<Index>& a, const Model<Index>& b) {
  EXPECT_EQ(a.meshes, b.meshes);
  EXPECT_EQ(a.objects, b.objects);
  EXPECT_EQ(a.vertices, b.vertices);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.ecol, b.ecol);
  EXPECT_EQ(a.map, b.map);
  EXPECT_EQ(a.errors, b.errors);
  EXPECT_EQ(a.mesh_boxes, b.mesh_boxes);
  EXPECT_EQ(a.object_boxes, b.object_boxes);
  EXPECT_EQ(a.oriented_boxes, b.oriented_boxes);
  EXPECT_EQ(a.compactness, b.compactness);
  EXPECT_EQ(a.faces, b.faces);
  EXPECT_EQ(a.compactness_order, b.compactness_order);
}

/// A triangle by its positions, starting at the least corner: equal for equal oriented triangles.
using Placed = std::array<std::array<float, 3>, 3>;
Placed placed(std::array<glm::vec3, 3> corners) {
  Placed t;
  for (int k = 0; k < 3; ++k) t[k] = {corners[k].x, corners[k].y, corners[k].z};
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

/// What must hold of a model whatever the order of collapses.
template <class Index>
void expect_model_of(const Model<Index>& model, const std::vector<MeshData>& meshes) {
  ASSERT_EQ(model.meshes.size(), meshes.size());
  std::uint64_t vertices = 0, triangles = 0, map_entries = 0;
  for (std::size_t m = 0; m < meshes.size(); ++m) {
    const pgl::Mesh& mesh = model.meshes[m];
    const MeshData& original = meshes[m];
    EXPECT_EQ(mesh.first_vertex, vertices);
    EXPECT_EQ(mesh.first_triangle, triangles);
    EXPECT_EQ(mesh.first_map, map_entries);
    ASSERT_EQ(mesh.max_vertices, original.positions.size());
    ASSERT_LE(mesh.min_vertices, mesh.max_vertices);
    const std::uint32_t* const map = model.map.data() + mesh.first_map;
    EXPECT_TRUE(std::is_sorted(map, map + (mesh.max_vertices - mesh.min_vertices + 1)));
    ASSERT_EQ(map[mesh.max_vertices - mesh.min_vertices], original.triangles.size());

    // The same points and triangles, in another order.
    const auto less = [](const glm::vec3& a, const glm::vec3& b) {
      return std::array{a.x, a.y, a.z} < std::array{b.x, b.y, b.z};
    };
    std::vector<glm::vec3> expected_points = original.positions;
    std::vector<glm::vec3> points(model.vertices.begin() + static_cast<std::ptrdiff_t>(vertices),
                                  model.vertices.begin() + static_cast<std::ptrdiff_t>(vertices + mesh.max_vertices));
    std::multiset<Placed> expected, got;
    for (std::size_t t = 0; t < original.triangles.size(); ++t) {
      const auto& o = original.triangles[t].v;
      const auto& r = model.triangles[triangles + t].v;
      for (const Index v : r) ASSERT_LT(v, mesh.max_vertices);
      expected.insert(placed({original.positions[o[0]], original.positions[o[1]], original.positions[o[2]]}));
      got.insert(placed({points[r[0]], points[r[1]], points[r[2]]}));
    }
    EXPECT_EQ(got, expected);
    std::sort(points.begin(), points.end(), less);
    std::sort(expected_points.begin(), expected_points.end(), less);
    EXPECT_EQ(points, expected_points);

    // Collapse targets go down, and exist exactly from min_vertices on.
    for (std::uint32_t v = 0; v < mesh.max_vertices; ++v) {
      const Index target = model.ecol[vertices + v];
      if (v < mesh.min_vertices)
        EXPECT_EQ(target, pgl::no_target<Index>);
      else
        EXPECT_LT(target, v);
    }
    // Triangles of a prefix, reformed, stay triangles of that prefix.
    for (std::uint32_t k = mesh.min_vertices; k <= mesh.max_vertices; ++k)
      for (std::uint32_t t = 0; t < map[k - mesh.min_vertices]; ++t)
        for (Index v : model.triangles[triangles + t].v) {
          while (v >= k) v = model.ecol[vertices + v];
          EXPECT_LT(v, k);
        }

    pgl::Box box;
    for (const glm::vec3& p : original.positions)
      for (int axis = 0; axis < 3; ++axis) {
        box.min[axis] = std::min(box.min[axis], p[axis]);
        box.max[axis] = std::max(box.max[axis], p[axis]);
      }
    EXPECT_EQ(model.mesh_boxes[m], box);
    vertices += mesh.max_vertices;
    triangles += original.triangles.size();
    map_entries += mesh.max_vertices - mesh.min_vertices + 1;
  }
  EXPECT_EQ(model.vertices.size(), vertices);
  EXPECT_EQ(model.ecol.size(), vertices);
  EXPECT_EQ(model.triangles.size(), triangles);
  EXPECT_EQ(model.map.size(), map_entries);

  ASSERT_EQ(model.object_boxes.size(), model.objects.size());
  for (std::size_t i = 0; i < model.objects.size(); ++i) {
    const auto& m = model.objects[i].transform;
    for (const glm::vec3& p : meshes[model.objects[i].mesh].positions)
      for (int row = 0; row < 3; ++row) {
        const double x = static_cast<double>(m[0][row]) * p.x + static_cast<double>(m[1][row]) * p.y +
                         static_cast<double>(m[2][row]) * p.z + static_cast<double>(m[3][row]);
        EXPECT_LE(model.object_boxes[i].min[row], x);
        EXPECT_GE(model.object_boxes[i].max[row], x);
      }
  }
}

TEST(BuildModel, GivesAnEmptyModelForAnEmptyScene) {
  BuildReport report{77};
  const AnyModel any = build_any_model(Scene{}, {}, {}, &report);
  const auto& model = std::get<Model<Index16>>(any);
  EXPECT_TRUE(model.meshes.empty() && model.objects.empty() && model.vertices.empty() && model.map.empty());
  EXPECT_EQ(report.open_vertices, 0u);
}

TEST(BuildModel, ArrangesEveryMeshInItsPlaceUnderBothWidths) {
  const Scene scene = varied_scene();
  const auto narrow = build_model<Index16>(source_of(scene.meshes), scene.objects, {});
  const auto wide = build_model<Index32>(source_of(scene.meshes), scene.objects, {});
  expect_model_of(narrow, scene.meshes);
  expect_model_of(wide, scene.meshes);
  EXPECT_EQ(narrow.objects, scene.objects);
  EXPECT_LT(narrow.meshes[4].min_vertices, narrow.meshes[4].max_vertices);

  EXPECT_EQ(narrow.meshes, wide.meshes);
  EXPECT_EQ(narrow.map, wide.map);
  EXPECT_EQ(narrow.vertices, wide.vertices);
  for (std::size_t t = 0; t < wide.triangles.size(); ++t)
    for (int corner = 0; corner < 3; ++corner) EXPECT_EQ(narrow.triangles[t].v[corner], wide.triangles[t].v[corner]);
  for (std::size_t v = 0; v < wide.ecol.size(); ++v)
    EXPECT_EQ(narrow.ecol[v], wide.ecol[v] == pgl::no_target<Index32> ? pgl::no_target<Index16> : wide.ecol[v]);
}

TEST(BuildModel, GivesASceneWhatItGivesASource) {
  const Scene scene = varied_scene();
  for (const bool errors : {false, true}) {
    const AnyModel any = build_any_model(scene, {}, {}, nullptr, errors);
    expect_equal(std::get<Model<Index16>>(any),
                 build_model<Index16>(source_of(scene.meshes), scene.objects, {}, {}, nullptr, errors));
  }
}

/// The errors of meshes one by one, each as build_ecol gives them for itself.
std::vector<float> errors_of(const std::vector<MeshData>& meshes, const pgl::EcolOptions& options) {
  std::vector<float> all;
  for (const MeshData& mesh : meshes) {
    const std::size_t n = mesh.positions.size();
    pgl::host::EcolWorkspace<float> workspace;
    std::vector<std::uint32_t> ecol(n), permute_v(n), permute_t(mesh.triangles.size()), map(n + 1);
    std::vector<float> error(n + 1, -1.0f);
    const std::uint32_t least = pgl::host::build_ecol<float, std::uint32_t>(
        mesh.positions, mesh.triangles, {}, options, workspace, ecol, permute_v, permute_t, map, error);
    all.insert(all.end(), error.begin() + least, error.end());
  }
  return all;
}

TEST(BuildModel, RecordsTheErrorsOfEveryMeshBesideItsMapWhereAsked) {
  const Scene scene = varied_scene();
  for (const auto order : {pgl::EcolOrder::greedy, pgl::EcolOrder::rounds})
    for (const auto boundary : {pgl::BoundaryRule::locked, pgl::BoundaryRule::slide}) {
      pgl::EcolOptions options;
      options.order = order;
      options.boundary = boundary;
      auto narrow = build_model<Index16>(source_of(scene.meshes), scene.objects, options, {}, nullptr, true);
      const auto wide = build_model<Index32>(source_of(scene.meshes), scene.objects, options, {}, nullptr, true);
      ASSERT_EQ(narrow.errors.size(), narrow.map.size());
      EXPECT_EQ(narrow.errors, errors_of(scene.meshes, options));
      EXPECT_EQ(wide.errors, narrow.errors);
      EXPECT_EQ(narrow.errors[narrow.meshes[1].first_map], 0.0f);  // of the mesh without vertices, its only entry
      EXPECT_GT(narrow.errors[narrow.meshes[4].first_map], 0.0f);
      // Asking for them changes nothing else.
      const auto without = build_model<Index16>(source_of(scene.meshes), scene.objects, options);
      EXPECT_TRUE(without.errors.empty());
      narrow.errors.clear();
      expect_equal(narrow, without);
    }
}

TEST(BuildModel, RecordsErrorsThatNeverRiseWithTheCountWhateverThePositions) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  const float most = std::numeric_limits<float>::max();
  std::vector<MeshData> meshes;
  for (const float scale : {1e-45f, 1e-38f, 1e-20f, 1e18f, 1e30f, most / 16}) {
    meshes.push_back(grid(9));
    for (glm::vec3& p : meshes.back().positions) p *= scale;
  }
  meshes.push_back(grid(9));
  for (std::size_t v = 0; v < 81; v += 5) meshes.back().positions[v] = {nan, v % 2 ? inf : -inf, most};
  meshes.push_back(grid(9));
  for (std::size_t v = 0; v < 81; ++v) meshes.back().positions[v] *= v % 3 ? most : -most;
  for (const auto order : {pgl::EcolOrder::greedy, pgl::EcolOrder::rounds})
    for (const auto metric : {pgl::CostMetric::quadric, pgl::CostMetric::melax, pgl::CostMetric::edge_length}) {
      pgl::EcolOptions options;
      options.order = order;
      options.metric = metric;
      options.boundary = pgl::BoundaryRule::slide;
      const auto model = build_model<Index16>(source_of(meshes), {}, options, {}, nullptr, true);
      for (const pgl::Mesh& mesh : model.meshes) {
        const auto errors = std::span(model.errors).subspan(mesh.first_map, mesh.max_vertices - mesh.min_vertices + 1);
        EXPECT_GT(errors.size(), 1u);
        EXPECT_EQ(errors.back(), 0.0f);
        for (std::size_t k = 1; k < errors.size(); ++k) ASSERT_GE(errors[k - 1], errors[k]);
      }
    }
}

TEST(BuildModel, PassesTheOptionsOn) {
  const Scene scene = varied_scene();
  pgl::EcolOptions slide;
  slide.boundary = pgl::BoundaryRule::slide;
  const auto locked = build_model<Index16>(source_of(scene.meshes), scene.objects, {});
  const auto slid = build_model<Index16>(source_of(scene.meshes), scene.objects, slide);
  EXPECT_GE(locked.meshes[4].min_vertices, 32u);  // the border of the 9 x 9 grid
  EXPECT_LT(slid.meshes[4].min_vertices, 32u);
}

TEST(BuildModel, ChoosesTheIndexWidthByTheLargestMesh) {
  // Sizes are 65536 and 65537 vertices; every vertex but three is isolated.
  for (const std::size_t vertices : {65536u, 65537u}) {
    std::vector<MeshData> meshes{grid(3), {std::vector<glm::vec3>(vertices), {{{0, 1, 65535}}}}};
    meshes[1].positions[65535] = {1, 2, 3};
    const AnyModel any = build_any_model(source_of(meshes), {}, {});
    EXPECT_EQ(any.index(), vertices == 65536 ? 0u : 1u);
    if (vertices == 65537) {
      EXPECT_THROW(build_model<Index16>(source_of(meshes), {}, {}), Error);
    }
  }
}

TEST(BuildModel, CollapsesOntoTheLastVertexOfAFullSixteenBitMesh) {
  // Four triangles around vertex 0, whose nearest neighbour is number 65535; the others are isolated. In the original
  // order that target looks like a narrow no_target.
  MeshData mesh;
  mesh.positions.assign(65'536, {0, 0, 9});
  mesh.positions[0] = {0.9f, 0, 0};
  mesh.positions[65'535] = {1, 0, 0};
  mesh.positions[1] = {0, 1, 0};
  mesh.positions[2] = {-1, 0, 0};
  mesh.positions[3] = {0, -1, 0};
  mesh.triangles = {{{0, 65'535, 1}}, {{0, 1, 2}}, {{0, 2, 3}}, {{0, 3, 65'535}}};
  pgl::EcolOptions options;
  options.metric = pgl::CostMetric::edge_length;
  const std::vector<MeshData> meshes{mesh};
  const AnyModel any = build_any_model(source_of(meshes), {}, options);
  const auto& model = std::get<Model<Index16>>(any);
  EXPECT_EQ(model.meshes[0].min_vertices, 65'535u);
  EXPECT_EQ(model.map, (std::vector<std::uint32_t>{2, 4}));
  const Index16 target = model.ecol[65'535];
  ASSERT_LT(target, 65'535);
  EXPECT_EQ(model.vertices[target], glm::vec3(1, 0, 0));
}

#if defined(_OPENMP)
TEST(BuildModel, DoesNotDependOnTheNumberOfThreads) {
  std::vector<MeshData> meshes;
  for (std::uint32_t k = 0; k < 40; ++k) meshes.push_back(grid(2 + k % 17, static_cast<float>(k)));
  const int threads = omp_get_max_threads();
  std::vector<Model<Index16>> models;
  std::vector<std::uint64_t> open;
  for (const int n : {1, 2, 7}) {
    omp_set_num_threads(n);
    BuildReport report;
    models.push_back(build_model<Index16>(source_of(meshes), {{3, glm::mat4x3(1.0f)}}, {}, {}, &report, true));
    open.push_back(report.open_vertices);
  }
  omp_set_num_threads(threads);
  expect_model_of(models[0], meshes);
  expect_equal(models[0], models[1]);
  expect_equal(models[0], models[2]);
  EXPECT_EQ(models[0].errors.size(), models[0].map.size());
  EXPECT_EQ(open, std::vector<std::uint64_t>(3, open[0]));
}
#endif

TEST(BuildModel, AsksForEveryMeshOnce) {
  const Scene scene = varied_scene();
  std::vector<std::atomic<int>> made(scene.meshes.size());
  MeshSource source = source_of(scene.meshes);
  source.make = [&](std::size_t m, MeshData& mesh) {
    ++made[m];
    mesh = scene.meshes[m];
  };
  build_any_model(source, {}, {});
  for (const auto& count : made) EXPECT_EQ(count, 1);
}

TEST(BuildModel, RefusesWhatDoesNotFitTogether) {
  const Scene scene = varied_scene();
  EXPECT_THROW(build_any_model(source_of(scene.meshes), {{6, glm::mat4x3(1.0f)}}, {}), Error);
  MeshSource source = source_of(scene.meshes);
  source.make = [&](std::size_t m, MeshData& mesh) { mesh = scene.meshes[m == 4 ? 0 : m]; };
  EXPECT_THROW(build_any_model(source, {}, {}), Error);
}

TEST(BuildModel, LetsExceptionsOfSourceAndProgressThrough) {
  const Scene scene = varied_scene();
  MeshSource source = source_of(scene.meshes);
  source.make = [](std::size_t, MeshData&) { throw std::out_of_range("no more"); };
  EXPECT_THROW(build_any_model(source, {}, {}), std::out_of_range);
  const auto stop = [](std::string_view, std::size_t, std::size_t) { throw std::domain_error("stop"); };
  EXPECT_THROW(build_any_model(scene, {}, stop), std::domain_error);
}

TEST(BuildModel, KnowsWhatMayHideOthers) {
  // A grid, the same turned and moved, and two triangles far apart: the model's arrays are those of the steps.
  MeshData strip;
  strip.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {50, 50, 50}, {51, 50, 50}, {50, 51, 50}};
  strip.triangles = {{{0, 1, 2}}, {{3, 4, 5}}};
  glm::mat4x3 turned(1.0f);
  turned[0] = {0, 1, 0};
  turned[1] = {-1, 0, 0};
  turned[3] = {7, 8, 9};
  const auto model = build_model<Index16>(source_of({strip, grid(5)}),
                                          {{0, glm::mat4x3(1.0f)}, {1, glm::mat4x3(1.0f)}, {1, turned}}, {});
  ASSERT_EQ(model.oriented_boxes.size(), 2u);
  ASSERT_EQ(model.faces.size(), 3u);
  EXPECT_EQ(model.compactness_order, (std::vector<std::uint32_t>{1, 2, 0}));
  EXPECT_LT(model.compactness[0], 0.01f);
  EXPECT_GT(model.compactness[1], 0.3f);
  for (std::size_t i = 0; i < 3; ++i) {
    const pgl::Object& object = model.objects[i];
    EXPECT_EQ(model.faces[i],
              pgl::occluder_face(model.oriented_boxes[object.mesh], model.compactness[object.mesh], object.transform));
  }
}

TEST(BuildModel, TellsProgressUpToTheEnd) {
  std::size_t built = 0, boxes = 0;
  build_any_model(varied_scene(), {}, [&](std::string_view stage, std::size_t done, std::size_t total) {
    EXPECT_TRUE(stage == "build" || (stage == "boxes" && built == 6)) << stage;
    EXPECT_EQ(total, 6u);
    EXPECT_LE(done, total);
    (stage == "build" ? built : boxes) = done;
  });
  EXPECT_EQ(built, 6u);
  EXPECT_EQ(boxes, 6u);
}

TEST(BuildModel, AcceptsNonFinitePositionsAndKeepsThem) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  MeshData mesh = grid(5);
  mesh.positions[12] = {nan, 1, inf};
  const auto model = build_model<Index16>(source_of({mesh}), {{0, glm::mat4x3(1.0f)}}, {});
  EXPECT_EQ(std::count_if(model.vertices.begin(), model.vertices.end(),
                          [](const glm::vec3& p) { return std::isnan(p.x) && p.y == 1 && std::isinf(p.z); }),
            1);
  EXPECT_TRUE(std::isfinite(model.object_boxes[0].min.x) && std::isfinite(model.object_boxes[0].max.z));
}

// ---- open vertices --------------------------------------------------------------------------------------------------

TEST(OpenVertices, AreTheBorderOfAGrid) {
  std::vector<std::uint32_t> scratch;
  EXPECT_EQ(count_open_vertices(81, grid(9).triangles, scratch), 32u);
  EXPECT_EQ(count_open_vertices(4, {{{0, 2, 1}}, {{0, 1, 3}}, {{1, 2, 3}}, {{2, 0, 3}}}, scratch), 0u);
  EXPECT_EQ(count_open_vertices(3, {{{0, 1, 2}}}, scratch), 3u);
  EXPECT_EQ(count_open_vertices(3, {{{0, 1, 2}}, {{0, 1, 2}}}, scratch), 0u);
  EXPECT_EQ(count_open_vertices(5, {}, scratch), 0u);
  EXPECT_EQ(count_open_vertices(0, {}, scratch), 0u);
}

TEST(OpenVertices, AgreeWithCountingEveryEdgeInATable) {
  std::mt19937 random(3);
  std::vector<std::uint32_t> scratch;
  for (int round = 0; round < 300; ++round) {
    const std::uint32_t vertices = 1 + random() % 20;
    std::vector<Corners> triangles(random() % 30);
    for (Corners& t : triangles)
      for (std::uint32_t& v : t.v) v = random() % vertices;
    std::map<std::set<std::uint32_t>, int> uses;
    for (const Corners& t : triangles)
      for (int k = 0; k < 3; ++k)
        if (t.v[k] != t.v[(k + 1) % 3]) ++uses[{t.v[k], t.v[(k + 1) % 3]}];
    std::set<std::uint32_t> open;
    for (const auto& [edge, count] : uses)
      if (count == 1) open.insert(edge.begin(), edge.end());
    EXPECT_EQ(count_open_vertices(vertices, triangles, scratch), open.size());
  }
}

}  // namespace
