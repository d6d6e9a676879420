// SPDX-License-Identifier: MIT
#include "pgl/host/gather.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "support/block.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace mine {

// A payload of a library user, with its own way into the world.
struct Vertex {
  glm::vec3 position;
  std::uint16_t material;
};
struct Drawn {
  glm::vec3 position;
  std::uint32_t material;
  std::uint32_t object;
};
void place(const pgl::Object& object, std::uint32_t index, const Vertex& vertex, Drawn& drawn) {
  drawn = {pgl::transform_point(object.transform, vertex.position), vertex.material, index};
}

}  // namespace mine

namespace {

using glm::vec3;
using pgl::Mesh;
using pgl::Object;
using pgl::PlacedVertex;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float least = std::numeric_limits<float>::denorm_min();
constexpr float most = std::numeric_limits<float>::max();

std::vector<std::uint32_t> bits(const vec3& p) {
  return {std::bit_cast<std::uint32_t>(p.x), std::bit_cast<std::uint32_t>(p.y), std::bit_cast<std::uint32_t>(p.z)};
}

glm::mat4x3 columns(vec3 x, vec3 y, vec3 z, vec3 w) {
  return {x, y, z, w};
}

TEST(TransformPoint, KeepsEveryBitUnderTheIdentity) {
  const float nan = std::bit_cast<float>(0xFFC12345u);
  const std::vector<float> all{0.0f, -0.0f, least, -least, 1e-30f, 1.0f, -1.5f, 1e30f, most, -most, inf, -inf, nan};
  glm::mat4x3 minus_zeros(1.0f);
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) {
      if (column != row) minus_zeros[column][row] = -0.0f;
    }
  }
  for (const float x : all) {
    for (const float y : all) {
      for (const float z : all) {
        EXPECT_EQ(bits(pgl::transform_point(glm::mat4x3(1.0f), vec3(x, y, z))), bits(vec3(x, y, z)));
        EXPECT_EQ(bits(pgl::transform_point(minus_zeros, vec3(x, y, z))), bits(vec3(x, y, z)));
      }
    }
  }
}

TEST(TransformPoint, IsTheIdentityOnlyWhenEveryEntryIs) {
  EXPECT_TRUE(pgl::is_identity(glm::mat4x3(1.0f)));
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 3; ++row) {
      for (const float off : {least, std::numeric_limits<float>::quiet_NaN()}) {
        glm::mat4x3 m(1.0f);
        m[column][row] = column == row && off == off ? 1.0f + 0x1p-23f : off;
        EXPECT_FALSE(pgl::is_identity(m)) << column << ' ' << row;
      }
    }
  }
}

TEST(TransformPoint, AppliesColumnsThenTheTranslation) {
  const auto m = columns(vec3(1, 2, 3), vec3(10, 20, 30), vec3(100, 200, 300), vec3(1000, 2000, 3000));
  EXPECT_EQ(pgl::transform_point(m, vec3(1, 2, 3)), vec3(1321, 2642, 3963));
  EXPECT_EQ(pgl::transform_point(m, vec3(0)), vec3(1000, 2000, 3000));
}

TEST(TransformPoint, RoundsOnceWhereFloatWouldRoundThreeTimes) {
  // In float, 1e8 + 1 loses the 1, and the result would be 0 or 8.
  const auto m = columns(vec3(1e8f), vec3(1), vec3(-1e8f), vec3(0));
  EXPECT_EQ(pgl::transform_point(m, vec3(1, 1, 1)), vec3(1));
}

TEST(TransformPoint, OverflowsToInfinityAndUnderflowsGradually) {
  const auto scale = [](float s) { return columns(vec3(s, 0, 0), vec3(0, s, 0), vec3(0, 0, s), vec3(0)); };
  EXPECT_EQ(pgl::transform_point(scale(2.0f), vec3(most, -most, 1.0f)), vec3(inf, -inf, 2.0f));
  EXPECT_EQ(pgl::transform_point(scale(0.5f), vec3(2 * least, 3 * least, least)), vec3(least, 2 * least, 0.0f));
  EXPECT_EQ(pgl::transform_point(scale(0x1p100f), vec3(0x1p-100f, 0x1p-149f, 0)), vec3(1, 0x1p-49f, 0));
  // Large terms may cancel to something finite.
  EXPECT_EQ(pgl::transform_point(columns(vec3(most), vec3(-most), vec3(1), vec3(0)), vec3(most, most, 7)), vec3(7));
}

TEST(TransformPoint, SpreadsNanAndInfinity) {
  const auto m = columns(vec3(2, 0, 0), vec3(0, 2, 0), vec3(0, 0, 2), vec3(0));
  const vec3 from_nan = pgl::transform_point(m, vec3(std::numeric_limits<float>::quiet_NaN(), 1, 2));
  EXPECT_NE(from_nan.x, from_nan.x);
  const vec3 from_infinity = pgl::transform_point(m, vec3(inf, 1, 2));
  EXPECT_EQ(from_infinity.x, inf);
  EXPECT_NE(from_infinity.y, from_infinity.y) << "0 times infinity";
}

/// Two meshes of 3 and 2 vertices; the first stands twice.
struct Small {
  std::vector<Mesh> meshes{{.max_vertices = 3}, {.first_vertex = 3, .max_vertices = 2}};
  std::vector<Object> objects{{.mesh = 0},
                              {.mesh = 1},
                              {.mesh = 0, .transform = columns(vec3(2, 0, 0), vec3(0, 2, 0), vec3(0, 0, 2), vec3(1))},
                              {.mesh = 1}};
  std::vector<vec3> vertices{vec3(1), vec3(2), vec3(3), vec3(4), vec3(5)};
  std::vector<std::uint32_t> counts{2, 0, 3, 1};
  std::vector<std::uint64_t> offsets{0, 2, 2, 5, 6};
};

TEST(Gather, PlacesTheFirstVerticesOfEveryObject) {
  const Small s;
  std::vector<vec3> out(7, vec3(-1));
  pgl::host::gather<vec3, vec3>(s.meshes, s.objects, s.vertices, s.counts, s.offsets, out);
  EXPECT_EQ(out, (std::vector{vec3(1), vec3(2), vec3(3), vec3(5), vec3(7), vec3(4), vec3(-1)}));
}

TEST(Gather, NumbersTheObjects) {
  const Small s;
  std::vector<PlacedVertex> out(6);
  pgl::host::gather<PlacedVertex, vec3>(s.meshes, s.objects, s.vertices, s.counts, s.offsets, out);
  EXPECT_EQ(out, (std::vector<PlacedVertex>{
                     {vec3(1), 0}, {vec3(2), 0}, {vec3(3), 2}, {vec3(5), 2}, {vec3(7), 2}, {vec3(4), 3}}));
}

TEST(Gather, TakesAPayloadOfOnesOwn) {
  const Small s;
  const std::vector<mine::Vertex> vertices{{vec3(1), 7}, {vec3(2), 8}, {vec3(3), 9}, {vec3(4), 1}, {vec3(5), 2}};
  std::vector<mine::Drawn> out(6);
  pgl::host::gather<mine::Drawn, mine::Vertex>(s.meshes, s.objects, vertices, s.counts, s.offsets, out);
  EXPECT_EQ(out[4].position, vec3(7));
  EXPECT_EQ(out[4].material, 9u);
  EXPECT_EQ(out[4].object, 2u);
  EXPECT_EQ(out[5].material, 1u);
  EXPECT_EQ(out[5].object, 3u);
}

TEST(Gather, AcceptsEmptyScenesAndEmptySelections) {
  const std::vector<std::uint64_t> none{0};
  pgl::host::gather<vec3, vec3>({}, {}, {}, {}, none, {});
  Small s;
  s.counts.assign(4, 0);
  s.offsets.assign(5, 0);
  pgl::host::gather<vec3, vec3>(s.meshes, s.objects, s.vertices, s.counts, s.offsets, {});
}

// Objects from none to far more vertices than a thread takes at a time.
TEST(Gather, EqualsThePlainLoopAtAnySizeAndNumberOfThreads) {
  const std::vector<std::uint32_t> sizes{0, 1, 8191, 8192, 8193, 0, 0, 100000, 3, 16384, 0};
  std::vector<Mesh> meshes;
  std::vector<Object> objects;
  std::vector<std::uint32_t> counts;
  std::vector<std::uint64_t> offsets{0};
  std::uint64_t first = 0;
  for (const std::uint32_t size : sizes) {
    const auto i = static_cast<std::uint32_t>(objects.size());
    meshes.push_back({.first_vertex = first, .max_vertices = size + 5});
    objects.push_back({.mesh = i, .transform = glm::mat4x3(static_cast<float>(i))});
    first += size + 5;
    counts.push_back(size);
    offsets.push_back(offsets.back() + size);
  }
  std::vector<vec3> vertices(first);
  for (std::size_t v = 0; v < first; ++v) vertices[v] = vec3(static_cast<float>(v), 1, -2);
  std::vector<PlacedVertex> expected;
  for (std::uint32_t i = 0; i < objects.size(); ++i) {
    for (std::uint32_t v = 0; v < counts[i]; ++v) {
      const vec3& p = vertices[meshes[i].first_vertex + v];
      expected.push_back({vec3(static_cast<float>(i) * p.x, i, -2.0f * static_cast<float>(i)), i});
    }
  }
  const auto block = test::block_of(meshes, objects, &Mesh::first_vertex, vertices, offsets, vec3(-9));
#if defined(_OPENMP)
  const int threads = omp_get_max_threads();
  for (const int n : {1, 2, 7, threads}) {
    omp_set_num_threads(n);
#else
  {
#endif
    std::vector<PlacedVertex> out(expected.size());
    pgl::host::gather<PlacedVertex, vec3>(meshes, objects, vertices, counts, offsets, out);
    EXPECT_EQ(out, expected);
    out.assign(expected.size(), {});
    pgl::host::gather_block<PlacedVertex, vec3>(objects, block, offsets, out);
    EXPECT_EQ(out, expected) << "from a block";
  }
}

TEST(GatherBlock, PlacesTheVerticesOfTheBlock) {
  const Small s;
  const std::vector<vec3> block{vec3(1), vec3(2), vec3(10), vec3(20), vec3(30), vec3(4), vec3(99)};
  std::vector<PlacedVertex> out(7, {vec3(-1), 77});
  pgl::host::gather_block<PlacedVertex, vec3>(s.objects, block, s.offsets, out);
  EXPECT_EQ(
      out, (std::vector<PlacedVertex>{
               {vec3(1), 0}, {vec3(2), 0}, {vec3(21), 2}, {vec3(41), 2}, {vec3(61), 2}, {vec3(4), 3}, {vec3(-1), 77}}));
}

TEST(GatherBlock, TakesAPayloadOfOnesOwn) {
  const Small s;
  const std::vector<mine::Vertex> block{{vec3(1), 7}, {vec3(2), 8}, {vec3(1), 7},
                                        {vec3(2), 8}, {vec3(3), 9}, {vec3(4), 1}};
  std::vector<mine::Drawn> out(6);
  pgl::host::gather_block<mine::Drawn, mine::Vertex>(s.objects, block, s.offsets, out);
  EXPECT_EQ(out[4].position, vec3(7));
  EXPECT_EQ(out[4].material, 9u);
  EXPECT_EQ(out[4].object, 2u);
  EXPECT_EQ(out[5].object, 3u);
}

TEST(GatherBlock, AcceptsEmptyScenesAndEmptySelections) {
  const std::vector<std::uint64_t> none{0};
  pgl::host::gather_block<vec3, vec3>({}, {}, none, {});
  const Small s;
  pgl::host::gather_block<vec3, vec3>(s.objects, {}, std::vector<std::uint64_t>(5), {});
}

TEST(GatherBlock, ChecksItsInputInDebugBuilds) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const Small s;
  const std::vector<vec3> block(6);
  std::vector<vec3> out(6);
  const auto with = [&](std::size_t vertices, std::size_t room) {
    pgl::host::gather_block<vec3, vec3>(s.objects, std::span(block).first(vertices), s.offsets,
                                        std::span(out).first(room));
  };
  with(6, 6);
  EXPECT_DEATH(with(5, 6), "block");
  EXPECT_DEATH(with(6, 5), "out");
}

TEST(Gather, ChecksItsInputInDebugBuilds) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  Small s;
  std::vector<vec3> out(6);
  s.offsets.back() = 7;
  EXPECT_DEATH((pgl::host::gather<vec3, vec3>(s.meshes, s.objects, s.vertices, s.counts, s.offsets, out)), "size");
  out.resize(7);
  EXPECT_DEATH((pgl::host::gather<vec3, vec3>(s.meshes, s.objects, s.vertices, s.counts, s.offsets, out)), "counts");
  s = {};
  s.counts[0] = 4;
  s.offsets = {0, 4, 4, 7, 8};
  out.resize(8);
  EXPECT_DEATH((pgl::host::gather<vec3, vec3>(s.meshes, s.objects, s.vertices, s.counts, s.offsets, out)),
               "max_vertices");
}

}  // namespace
