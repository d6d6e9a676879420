// SPDX-License-Identifier: MIT
#include "pgl/host/pack_delta.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace {

using pgl::DeltaPart;
using Offsets = std::vector<std::uint64_t>;

/// Two meshes, "ABCDE" and "xyz", the first one twice; all lie in one array with a gap. Elements are letters.
struct Small {
  std::vector<pgl::Mesh> meshes{{.first_vertex = 1, .max_vertices = 5}, {.first_vertex = 7, .max_vertices = 3}};
  std::vector<pgl::Object> objects{{.mesh = 0}, {.mesh = 1}, {.mesh = 0}};
  std::string elements = "-ABCDE-xyz";

  std::string delta(const Offsets& previous, const Offsets& offsets) const {
    Offsets delta_offsets(offsets.size());
    std::string out(pgl::host::lay_out_delta(previous, offsets, delta_offsets), '?');
    pgl::host::pack_delta<char>(meshes, objects, &pgl::Mesh::first_vertex, elements, previous, offsets, delta_offsets,
                                out);
    return out;
  }
};

TEST(DeltaPart, IsWhatAnObjectGrewBy) {
  const Offsets previous{0, 3, 3, 7, 9}, offsets{0, 5, 8, 8, 10};
  EXPECT_EQ(pgl::delta_part(previous.data(), offsets.data(), 0), (DeltaPart{3, 2}));
  EXPECT_EQ(pgl::delta_part(previous.data(), offsets.data(), 1), (DeltaPart{0, 3}));
  EXPECT_EQ(pgl::delta_part(previous.data(), offsets.data(), 2).size, 0u);  // left
  EXPECT_EQ(pgl::delta_part(previous.data(), offsets.data(), 3).size, 0u);  // stayed, though it moved
}

TEST(LayOutDelta, SumsWhatGrew) {
  const Offsets previous{0, 3, 3, 7, 9}, offsets{0, 5, 8, 8, 10};
  Offsets delta_offsets(5);
  EXPECT_EQ(pgl::host::lay_out_delta(previous, offsets, delta_offsets), 5u);
  EXPECT_EQ(delta_offsets, (Offsets{0, 2, 5, 5, 5}));
}

TEST(LayOutDelta, OfNoObjectIsOneZero) {
  Offsets delta_offsets{7};
  EXPECT_EQ(pgl::host::lay_out_delta(Offsets{0}, Offsets{0}, delta_offsets), 0u);
  EXPECT_EQ(delta_offsets, Offsets{0});
}

TEST(PackDelta, BeginsWithTheWholeSelection) {
  EXPECT_EQ(Small{}.delta({0, 0, 0, 0}, {0, 2, 5, 9}), "ABxyzABCD");
}

TEST(PackDelta, TakesEachObjectsIncrementOnly) {
  EXPECT_EQ(Small{}.delta({0, 2, 5, 9}, {0, 5, 7, 12}), "CDEE");  // grew, shrank, grew
  EXPECT_EQ(Small{}.delta({0, 2, 5, 9}, {0, 0, 3, 8}), "E");      // left, stayed, grew
}

TEST(PackDelta, WritesNothingWhenNothingGrew) {
  EXPECT_EQ(Small{}.delta({0, 2, 5, 9}, {0, 2, 5, 9}), "");
  EXPECT_EQ(Small{}.delta({0, 2, 5, 9}, {0, 1, 1, 3}), "");
  EXPECT_EQ(Small{}.delta({0, 2, 5, 9}, {0, 0, 0, 0}), "");
}

TEST(PackDelta, LeavesTheRestOfItsOutputAsItIs) {
  const Small s;
  const Offsets previous{0, 1, 1, 1}, offsets{0, 2, 2, 3}, delta_offsets{0, 1, 1, 2};
  std::string out = "????";
  pgl::host::pack_delta<char>(s.meshes, s.objects, &pgl::Mesh::first_vertex, s.elements, previous, offsets,
                              delta_offsets, out);
  EXPECT_EQ(out, "BA??");
}

TEST(PackDelta, TakesTrianglesFromWhereTheyAre) {
  using Triangle = pgl::Triangle<std::uint16_t>;
  const std::vector<pgl::Mesh> meshes{{.first_vertex = 100, .first_triangle = 1}};
  const std::vector<pgl::Object> objects{{.mesh = 0}};
  const std::vector<Triangle> triangles{{{9, 9, 9}}, {{0, 1, 2}}, {{2, 1, 3}}, {{3, 1, 4}}};
  const Offsets previous{0, 1}, offsets{0, 3}, delta_offsets{0, 2};
  std::vector<Triangle> out(2);
  pgl::host::pack_delta<Triangle>(meshes, objects, &pgl::Mesh::first_triangle, triangles, previous, offsets,
                                  delta_offsets, out);
  EXPECT_EQ(out, (std::vector<Triangle>{{{2, 1, 3}}, {{3, 1, 4}}}));
}

TEST(PackPlacedDelta, PlacesWhatIsNew) {
  const std::vector<pgl::Mesh> meshes{{.first_vertex = 1, .max_vertices = 3}};
  std::vector<pgl::Object> objects{{.mesh = 0}, {.mesh = 0}};
  objects[1].transform[3] = glm::vec3(10, 20, 30);
  const std::vector<glm::vec3> vertices{glm::vec3(9), glm::vec3(1), glm::vec3(2), glm::vec3(3)};
  const Offsets previous{0, 2, 3}, offsets{0, 3, 6}, delta_offsets{0, 1, 3};
  std::vector<pgl::PlacedVertex> out(3);
  pgl::host::pack_placed_delta<pgl::PlacedVertex, glm::vec3>(meshes, objects, vertices, previous, offsets,
                                                             delta_offsets, out);
  EXPECT_EQ(out[0], (pgl::PlacedVertex{glm::vec3(3), 0}));
  EXPECT_EQ(out[1], (pgl::PlacedVertex{glm::vec3(12, 22, 32), 1}));
  EXPECT_EQ(out[2], (pgl::PlacedVertex{glm::vec3(13, 23, 33), 1}));
}

TEST(PackDelta, ChecksItsInputInDebugBuilds) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const Small s;
  const auto pack = [&](const Offsets& previous, const Offsets& offsets, const Offsets& delta_offsets, std::size_t room,
                        std::string_view elements) {
    std::string out(room, '?');
    pgl::host::pack_delta<char>(s.meshes, s.objects, &pgl::Mesh::first_vertex, elements, previous, offsets,
                                delta_offsets, out);
  };
  const Offsets none{0, 0, 0, 0}, one{0, 1, 1, 1};
  pack(none, one, one, 1, s.elements);
  EXPECT_DEATH(pack(none, one, one, 0, s.elements), "out.size");
  EXPECT_DEATH(pack(none, one, one, 1, "-"), "elements.size");
  EXPECT_DEATH(pack(none, one, {0, 1, 1, 2}, 2, s.elements), "part.size");
  EXPECT_DEATH(pack({0, 0}, one, one, 1, s.elements), "previous_offsets.size");
  EXPECT_DEATH(pack({1, 1, 1, 1}, one, one, 1, s.elements), "front");
  EXPECT_DEATH(pack(none, {0, 1}, {0, 1}, 1, s.elements), "objects.size");
  Offsets delta_offsets(4);
  EXPECT_DEATH(pgl::host::lay_out_delta(none, Offsets{0, 2, 1, 3}, delta_offsets), "offsets");
  EXPECT_DEATH(pgl::host::lay_out_delta(none, Offsets{1, 2, 3, 4}, delta_offsets), "front");
  EXPECT_DEATH(pgl::host::lay_out_delta(none, Offsets{}, delta_offsets), "empty");
}

}  // namespace
