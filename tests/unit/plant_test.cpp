// SPDX-License-Identifier: MIT
// The plant: the same bytes everywhere, sound surfaces, the numbers of a real model, and parts that fit together.

#include "scene/plant.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "scene/plant_shapes.hpp"
#include "support/surface.hpp"

namespace {

using namespace pgl::scene;
using pgl::Box;

struct Hash {  // FNV-1a, 64 bits
  std::uint64_t value = 0xcbf29ce484222325u;
  void add(std::uint32_t word) {
    for (int i = 0; i < 4; ++i) value = (value ^ ((word >> (8 * i)) & 0xffu)) * 0x100000001b3u;
  }
  void add(const MeshData& mesh) {
    for (const glm::vec3& p : mesh.positions)
      for (int axis = 0; axis < 3; ++axis) add(std::bit_cast<std::uint32_t>(p[axis]));
    for (const auto& t : mesh.triangles)
      for (const std::uint32_t v : t.v) add(v);
  }
};

MeshData object(const PlantOptions& options, std::size_t i) {
  MeshData mesh;
  plant_object(options, i, mesh);
  return mesh;
}

std::uint64_t hash_of(const PlantOptions& options, std::size_t i) {
  Hash hash;
  hash.add(object(options, i));
  return hash.value;
}

Box box_of(const MeshData& mesh) {
  Box box;
  for (const glm::vec3& p : mesh.positions) {
    box.min = glm::min(box.min, p);
    box.max = glm::max(box.max, p);
  }
  return box;
}

bool touch(const Box& a, const Box& b) {
  return glm::all(glm::lessThanEqual(a.min, b.max)) && glm::all(glm::lessThanEqual(b.min, a.max));
}

void expect_sound(const PlantOptions& options, std::size_t i, const MeshData& mesh) {
  const support::SurfaceFacts facts = support::surface_facts(mesh.positions, mesh.triangles);
  SCOPED_TRACE(std::string(plant_kind_name(plant_kind(options, i))) + " " + std::to_string(i));
  ASSERT_TRUE(facts.in_range);
  EXPECT_TRUE(facts.finite);
  EXPECT_EQ(facts.degenerate, 0u);
  EXPECT_EQ(facts.repeated_edges, 0u);
  EXPECT_EQ(facts.pinched, 0u);
  EXPECT_EQ(facts.unused, 0u);
  EXPECT_EQ(facts.repeated, 0u);
  EXPECT_EQ(facts.open_edges == 0, plant_is_closed(options, i));
  EXPECT_TRUE(facts.open_edges > 0 || facts.inside_out == 0);
  EXPECT_EQ(plant_object_size(options, i), (PlantSize{mesh.positions.size(), mesh.triangles.size()}));
}

}  // namespace

TEST(Plant, HasTheSameBytesOnEveryCompiler) {
  const PlantOptions options{25000, 1};  // all sixteen plans, rows of either direction
  Hash hash;
  MeshData mesh;
  for (std::size_t i = 0; i < options.objects; i += i < 1500 ? 1 : 13) {
    plant_object(options, i, mesh);
    hash.add(mesh);
  }
  EXPECT_EQ(hash.value, 2505627414376430777u);
}

TEST(Plant, AnglesAreExactToTheLastBits) {
  for (int i = -4000; i <= 4000; ++i) {
    const double turns = i / 777.0;
    const pgl::scene::shapes::Turn t = pgl::scene::shapes::turn(turns);
    const long double angle = 2 * std::numbers::pi_v<long double> * turns;
    EXPECT_NEAR(t.c.v, static_cast<double>(std::cos(angle)), 1e-15);
    EXPECT_NEAR(t.s.v, static_cast<double>(std::sin(angle)), 1e-15);
  }
  for (int quarter = -8; quarter <= 8; ++quarter) {  // a right angle is one
    const pgl::scene::shapes::Turn t = pgl::scene::shapes::turn(quarter * 0.25);
    EXPECT_EQ(std::abs(t.c.v) + std::abs(t.s.v), 1.0);
  }
}

TEST(Plant, ObjectsDoNotDependOnWhatWasMadeBefore) {
  const PlantOptions options{3000, 7};
  std::vector<std::uint64_t> forward;
  MeshData mesh;
  for (std::size_t i = 0; i < options.objects; i += 11) {
    plant_object(options, i, mesh);
    Hash hash;
    hash.add(mesh);
    forward.push_back(hash.value);
  }
  for (std::size_t k = forward.size(); k-- > 0;) EXPECT_EQ(hash_of(options, 11 * k), forward[k]);
}

TEST(Plant, ReusesTheArraysItIsGiven) {
  const PlantOptions options{2000, 1};
  MeshData mesh;
  mesh.positions.reserve(30000);
  mesh.triangles.reserve(30000);
  const auto* positions = mesh.positions.data();
  const auto* triangles = mesh.triangles.data();
  for (std::size_t i = 0; i < options.objects; ++i) plant_object(options, i, mesh);
  EXPECT_EQ(mesh.positions.data(), positions);
  EXPECT_EQ(mesh.triangles.data(), triangles);
}

TEST(Plant, AnotherSeedGivesAnotherPlant) {
  const auto kinds = [](std::uint64_t seed) {
    std::vector<PlantKind> all;
    for (std::size_t i = 0; i < 5000; ++i) all.push_back(plant_kind({5000, seed}, i));
    return all;
  };
  EXPECT_NE(kinds(1), kinds(2));
  // Where two seeds have the same part at the same place, what may vary in it varies: find a wire of one plan.
  std::set<std::uint64_t> different;
  for (std::uint64_t seed = 0; seed < 64; ++seed)
    for (std::size_t i = 0; i < 600; ++i)
      if (plant_kind({1000, seed}, i) == PlantKind::wire) {
        different.insert(hash_of({1000, seed}, i));
        break;
      }
  EXPECT_EQ(different.size(), 64u);
}

TEST(Plant, HasExactlyAsManyObjectsAsAsked) {
  for (const std::size_t objects : {1u, 2u, 7u, 1000u}) {
    const PlantOptions options{objects, 3};
    PlantSize sum;
    MeshData mesh;
    for (std::size_t i = 0; i < objects; ++i) {
      plant_object(options, i, mesh);
      EXPECT_GE(mesh.triangles.size(), 1u);
      sum.vertices += mesh.positions.size();
      sum.triangles += mesh.triangles.size();
    }
    EXPECT_EQ(plant_size(options), sum);
  }
}

TEST(Plant, OfNothingIsEmpty) {
  EXPECT_EQ(plant_size({0, 1}), PlantSize{});
  EXPECT_EQ(plant_box({0, 1}), Box{});
  const PlantCamera camera = plant_camera({0, 1});
  EXPECT_NE(camera.position, camera.target);
}

TEST(Plant, BeginsWithATankOrAVessel) {
  for (std::uint64_t seed = 0; seed < 64; ++seed) {
    const PlantKind kind = plant_kind({1, seed}, 0);
    EXPECT_TRUE(kind == PlantKind::tank || kind == PlantKind::vessel);
  }
}

TEST(Plant, ShowsEveryKindInAThousandObjects) {
  for (std::uint64_t seed = 0; seed < 64; ++seed) {
    std::set<PlantKind> kinds;
    for (std::size_t i = 0; i < 1000; ++i) kinds.insert(plant_kind({1000, seed}, i));
    EXPECT_EQ(kinds.size(), plant_kind_count) << "seed " << seed;
  }
}

TEST(Plant, KindsHaveTheirOwnNames) {
  std::set<std::string_view> names;
  for (std::size_t i = 0; i < plant_kind_count; ++i) names.insert(plant_kind_name(static_cast<PlantKind>(i)));
  EXPECT_EQ(names.size(), plant_kind_count);
  EXPECT_EQ(names.count(""), 0u);
  EXPECT_EQ(plant_kind_name(PlantKind::tank), "tank");
  EXPECT_EQ(plant_kind_name(PlantKind::name_plate), "name plate");
  EXPECT_EQ(plant_kind_name(PlantKind::bolt), "bolt");
}

TEST(Plant, SurfacesAreSound) {
  const PlantOptions options{25000, 1};  // all sixteen plans
  MeshData mesh;
  for (std::size_t i = 0; i < options.objects; i += 7) {
    plant_object(options, i, mesh);
    expect_sound(options, i, mesh);
    if (HasFatalFailure()) return;
  }
}

TEST(Plant, SurfacesAreSoundFarFromTheOrigin) {  // where floats are coarsest
  const PlantOptions options{718000, 1};
  MeshData mesh;
  for (std::size_t i = 0; i < 1000; ++i) {
    plant_object(options, i, mesh);
    expect_sound(options, i, mesh);
    plant_object(options, options.objects - 1 - i, mesh);
    expect_sound(options, options.objects - 1 - i, mesh);
    if (HasFatalFailure()) return;
  }
}

TEST(Plant, HasTheNumbersOfARealModel) {
  const PlantOptions options{718000, 1};
  const PlantSize size = plant_size(options);
  const auto objects = static_cast<double>(options.objects);
  EXPECT_NEAR(static_cast<double>(size.triangles) / objects, 462.0, 0.05 * 462.0);
  EXPECT_NEAR(static_cast<double>(size.vertices) / static_cast<double>(size.triangles), 0.67, 0.05);

  PlantSize sample;
  std::uint64_t least = ~0ull, most = 0, sampled = 0, closed = 0, small = 0, large = 0;
  MeshData mesh;
  for (std::size_t i = 0; i < options.objects; i += 97) {
    plant_object(options, i, mesh);
    ++sampled;
    sample.vertices += mesh.positions.size();
    sample.triangles += mesh.triangles.size();
    closed += plant_is_closed(options, i);
    small += mesh.triangles.size() <= 300;
    large += mesh.triangles.size() >= 1000;
    least = std::min<std::uint64_t>(least, mesh.triangles.size());
    most = std::max<std::uint64_t>(most, mesh.triangles.size());
  }
  EXPECT_NEAR(static_cast<double>(sample.triangles) / static_cast<double>(sampled), 462.0, 0.05 * 462.0);
  EXPECT_NEAR(static_cast<double>(sample.vertices) / static_cast<double>(sample.triangles), 0.67, 0.05);
  EXPECT_EQ(least, 1u);
  EXPECT_LE(most, 30000u);
  EXPECT_GT(closed * 3, sampled);              // a good share is closed,
  EXPECT_GT((sampled - closed) * 4, sampled);  // and a good share is not
  EXPECT_GT(small * 2, sampled);               // most objects are small,
  EXPECT_GT(large * 20, sampled);              // with a heavy tail
}

TEST(Plant, ObjectsHaveFromOneToThirtyThousandTriangles) {
  const PlantOptions options{25000, 1};  // all sixteen plans; the finest objects are a few in each block of them
  PlantSize sum;
  std::uint64_t least = ~0ull, most = 0;
  for (std::size_t i = 0; i < options.objects; ++i) {
    const PlantSize size = plant_object_size(options, i);
    least = std::min(least, size.triangles);
    most = std::max(most, size.triangles);
    sum.vertices += size.vertices;
    sum.triangles += size.triangles;
  }
  EXPECT_EQ(plant_size(options), sum);
  EXPECT_EQ(least, 1u);
  EXPECT_GT(most, 29000u);
  EXPECT_LE(most, 30000u);
}

TEST(Plant, PartsFitTogether) {
  for (const std::uint64_t seed : {1u, 2u, 3u, 5u}) {
    const PlantOptions options{1200, seed};
    std::vector<Box> boxes;
    for (std::size_t i = 0; i < options.objects; ++i) boxes.push_back(box_of(object(options, i)));
    for (std::size_t i = 0; i < options.objects; ++i) {
      const PlantKind kind = plant_kind(options, i);
      SCOPED_TRACE("object " + std::to_string(i) + " of seed " + std::to_string(seed));
      if (kind == PlantKind::bolt) {  // every bolt goes through something
        bool held = false;
        for (std::size_t k = 0; k < options.objects; ++k)
          held |= plant_kind(options, k) != PlantKind::bolt && touch(boxes[i], boxes[k]);
        EXPECT_TRUE(held);
      }
      if (kind == PlantKind::elbow) {  // both rims of a bend meet the end of a pipe, a flange or another bend
        const MeshData bend = object(options, i);
        const std::size_t sides = (bend.positions.size() - bend.triangles.size() / 2);
        for (const std::size_t first : {std::size_t{0}, bend.positions.size() - sides}) {
          glm::vec3 rim(0.0f);
          for (std::size_t k = 0; k < sides; ++k) rim += bend.positions[first + k] / static_cast<float>(sides);
          bool met = false;
          for (std::size_t k = 0; k < options.objects && !met; ++k) {
            const PlantKind other = plant_kind(options, k);
            if (other != PlantKind::pipe && other != PlantKind::flange) continue;
            const glm::vec3 centre = (boxes[k].min + boxes[k].max) * 0.5f;
            for (int axis = 0; axis < 3; ++axis)
              for (const float end : {boxes[k].min[axis], boxes[k].max[axis]}) {
                glm::vec3 face = centre;
                face[axis] = end;
                met |= glm::distance(face, rim) < 0.006f;
              }
          }
          EXPECT_TRUE(met);
        }
      }
    }
  }
}

TEST(Plant, BoxHoldsEveryObject) {
  for (const std::size_t objects : {1u, 7u, 1000u, 3000u, 40000u}) {
    const PlantOptions options{objects, 4};
    const Box box = plant_box(options);
    MeshData mesh;
    Box all;
    for (std::size_t i = 0; i < objects; i += 1 + objects / 4000) {
      plant_object(options, i, mesh);
      const Box own = box_of(mesh);
      EXPECT_TRUE(glm::all(glm::lessThanEqual(box.min, own.min)) && glm::all(glm::lessThanEqual(own.max, box.max)));
      all.min = glm::min(all.min, own.min);
      all.max = glm::max(all.max, own.max);
    }
    if (objects <= 3000) {
      EXPECT_EQ(box, all);
    }
    EXPECT_LT(glm::length((box.max - box.min) - (all.max - all.min)), 10.0f);
  }
}

TEST(Plant, CameraSeesThePlant) {
  for (const std::size_t objects : {1u, 2u, 200u, 1000u, 3000u, 40000u, 718000u}) {
    const PlantOptions options{objects, 1};
    const PlantCamera camera = plant_camera(options);
    EXPECT_GT(camera.position.z, 1.7f);
    EXPECT_EQ(camera.up, glm::vec3(0, 0, 1));
    const glm::vec3 forward = glm::normalize(camera.target - camera.position);
    const glm::vec3 right = glm::normalize(glm::cross(forward, camera.up)), up = glm::cross(right, forward);
    const float half = std::tan(camera.vertical_fov / 2);
    float widest = 0, highest = 0;
    MeshData mesh;
    for (std::size_t i = 0; i < objects; i += 1 + objects / 3000) {
      plant_object(options, i, mesh);
      for (const glm::vec3& p : mesh.positions) {
        const glm::vec3 d = p - camera.position;
        const float depth = glm::dot(d, forward);
        ASSERT_GT(depth, 0.5f);
        widest = std::max(widest, std::abs(glm::dot(d, right)) / depth / half / 1.5f);
        highest = std::max(highest, std::abs(glm::dot(d, up)) / depth / half);
      }
    }
    EXPECT_LE(widest, 1.0f) << objects;
    EXPECT_LE(highest, 1.0f) << objects;
    EXPECT_GT(std::max(widest, highest), 0.7f) << objects;
  }
}
