// SPDX-License-Identifier: MIT
#include "pgl/host/select_occluders.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <numeric>
#include <vector>

namespace {

using pgl::no_object;
using pgl::OccluderFace;
using pgl::OrientedBox;
using pgl::View;
using Indices = std::vector<std::uint32_t>;

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float inf = std::numeric_limits<float>::infinity();

View from(const glm::vec3& eye) {
  View v;
  v.clip_from_world = glm::perspective(1.0f, 1.5f, 0.1f, 100.0f) *
                      glm::lookAt(glm::vec3(0), glm::vec3(0.3f, -0.2f, -1), glm::vec3(0, 1, 0)) *
                      glm::translate(glm::mat4(1), -eye);
  return v;
}

OrientedBox box(glm::vec3 half) {
  OrientedBox b;
  b.half = half;
  return b;
}

/// A face of this area that looks along z.
OccluderFace facing_z(const glm::vec3& centre, float area, float compactness = 1) {
  return {centre, {0, 0, std::sqrt(area)}, compactness};
}

Indices select(const Indices& candidates, const std::vector<OccluderFace>& faces,
               const std::vector<std::uint8_t>& in_view, const View& view, std::size_t k) {
  static pgl::host::OccluderWorkspace workspace;
  Indices occluders(k, 12345);
  pgl::host::select_occluders(candidates, faces, in_view, view, workspace, occluders);
  return occluders;
}

Indices all(std::size_t n) {
  Indices indices(n);
  std::iota(indices.begin(), indices.end(), 0u);
  return indices;
}

// ---- the face

TEST(OccluderFaceRule, IsTheLargestOfTheBox) {
  OrientedBox b = box({3, 2, 1});
  b.centre = {10, 20, 30};
  const OccluderFace face = pgl::occluder_face(b, 0.5f, glm::mat4x3(1));
  EXPECT_EQ(face.centre, b.centre);
  EXPECT_EQ(face.compactness, 0.5f);
  EXPECT_NEAR(std::abs(face.normal.z), std::sqrt(6.0f * 4.0f), 1e-6f);
  EXPECT_EQ(face.normal.x, 0.0f);
  EXPECT_EQ(face.normal.y, 0.0f);
}

TEST(OccluderFaceRule, IsCarriedByTheTransform) {
  glm::mat4x3 m(1);
  m[0] = {0, 4, 0};  // x becomes y and four times as long
  m[1] = {2, 0, 0};
  m[2] = {0, 0, 1};
  m[3] = {5, 6, 7};
  OrientedBox b = box({1, 1, 1});
  b.centre = {1, 2, 3};
  const OccluderFace face = pgl::occluder_face(b, 1, m);
  EXPECT_EQ(face.centre, glm::vec3(5 + 4, 6 + 4, 7 + 3));
  EXPECT_NEAR(glm::dot(face.normal, face.normal), 8.0f * 4.0f, 1e-5f);  // sides of 8 and 4
  EXPECT_NEAR(std::abs(face.normal.z), std::sqrt(32.0f), 1e-5f);
}

TEST(OccluderFaceRule, MayBeAnotherFaceOfTheBoxOnceStretched) {
  glm::mat4x3 m(1);
  m[2] = {0, 0, 100};
  const OccluderFace face = pgl::occluder_face(box({3, 2, 1}), 1, m);
  EXPECT_NEAR(std::abs(face.normal.y), std::sqrt(6.0f * 200.0f), 1e-4f);  // x and z span it
  EXPECT_NEAR(face.normal.z, 0, 1e-6f);
}

TEST(OccluderFaceRule, OfASkewedBoxIsPerpendicularToTheFace) {
  glm::mat4x3 m(1);
  m[1] = {1, 1, 1};
  const OccluderFace face = pgl::occluder_face(box({4, 4, 0.1f}), 1, m);
  EXPECT_NEAR(glm::dot(face.normal, m[0]), 0, 1e-5f);
  EXPECT_NEAR(glm::dot(face.normal, m[1]), 0, 1e-5f);
  EXPECT_NEAR(glm::dot(face.normal, face.normal), 64 * std::sqrt(2.0f), 1e-4f);
}

TEST(OccluderFaceRule, OfNothingOrFlatBoxesIsHarmless) {
  EXPECT_EQ(pgl::occluder_face(OrientedBox{}, 0, glm::mat4x3(1)), OccluderFace{});
  const OccluderFace point = pgl::occluder_face(box({0, 0, 0}), 0.25f, glm::mat4x3(1));
  EXPECT_EQ(point.normal, glm::vec3(0));
  const OccluderFace line = pgl::occluder_face(box({7, 0, 0}), 0.25f, glm::mat4x3(1));
  EXPECT_EQ(line.normal, glm::vec3(0));
  const OccluderFace crushed = pgl::occluder_face(box({7, 5, 3}), 1, glm::mat4x3(0));
  EXPECT_EQ(crushed.normal, glm::vec3(0));
}

TEST(OccluderFaceRule, KeepsItsAreaAtTheEndsOfTheFloatRange) {
  for (const float size : {1e-30f, 1e-6f, 1e9f, 1e30f}) {
    const OccluderFace face = pgl::occluder_face(box(glm::vec3(3, 2, 1) * size), 1, glm::mat4x3(1));
    EXPECT_NEAR(std::abs(face.normal.z) / size, std::sqrt(24.0f), 1e-5f);
  }
}

// ---- eye and weight

TEST(Eye, IsWhereTheCameraIs) {
  for (const glm::vec3 at : {glm::vec3(0), glm::vec3(1, 2, 3), glm::vec3(-500, 20, 1000)}) {
    const pgl::Eye eye = pgl::eye_of(from(at));
    EXPECT_NEAR(eye.x, at.x, 1e-3);
    EXPECT_NEAR(eye.y, at.y, 1e-3);
    EXPECT_NEAR(eye.z, at.z, 1e-3);
    EXPECT_EQ(eye.w, 1.0);
  }
}

TEST(Eye, OfAParallelViewIsADirection) {
  View v;
  v.clip_from_world = glm::ortho(-3.0f, 3.0f, -2.0f, 2.0f, 0.1f, 100.0f) *
                      glm::lookAt(glm::vec3(5, 6, 7), glm::vec3(5, 6, 5), glm::vec3(0, 1, 0));
  const pgl::Eye eye = pgl::eye_of(v);
  EXPECT_EQ(eye.w, 0.0);
  EXPECT_GE(std::abs(eye.z), 1.0);
  EXPECT_LT(std::abs(eye.z), 2.0);
  EXPECT_NEAR(eye.x / eye.z, 0, 1e-6);
  EXPECT_NEAR(eye.y / eye.z, 0, 1e-6);
}

TEST(Eye, OfAParallelViewHasThatLengthAtAnyScale) {
  for (const float scale : {0x1p-40f, 1.0f, 0x1p40f}) {
    View v;
    v.clip_from_world = glm::mat4(0.0f);
    v.clip_from_world[0].x = 3 * scale;  // x = 3 scale X, y = scale Y, w = 1
    v.clip_from_world[1].y = scale;
    v.clip_from_world[2].z = scale;
    v.clip_from_world[3].w = 1;
    const pgl::Eye eye = pgl::eye_of(v);
    EXPECT_EQ(eye.x, 0.0);
    EXPECT_EQ(eye.y, 0.0);
    EXPECT_EQ(std::abs(eye.z), 1.5);  // of 3 scale^2
    EXPECT_EQ(eye.w, 0.0);
  }
}

TEST(Eye, IsNowhereWhereThereIsNoView) {
  View v;
  v.clip_from_world = glm::mat4(0.0f);
  const pgl::Eye eye = pgl::eye_of(v);
  for (const double x : {eye.x, eye.y, eye.z, eye.w}) EXPECT_EQ(x, 0.0);
}

TEST(OccluderWeight, IsCompactnessTimesAboutTheSolidAngle) {
  const pgl::Eye eye = pgl::eye_of(from({1, 2, 3}));
  // 4 * 10 / (10 * (100 + 4))
  EXPECT_NEAR(pgl::occluder_weight(facing_z({1, 2, -7}, 4), eye), 4.0 / 104, 1e-6);
  EXPECT_NEAR(pgl::occluder_weight(facing_z({1, 2, -7}, 4, 0.25f), eye), 1.0 / 104, 1e-6);
  // Seen at an angle of 45 degrees, at sqrt(200).
  EXPECT_NEAR(pgl::occluder_weight(facing_z({11, 2, -7}, 4), eye), 4 * std::sqrt(0.5) / 204, 1e-6);
  EXPECT_NEAR(pgl::occluder_weight(facing_z({11, 2, 3}, 4), eye), 0, 1e-6);  // edge on
  // Both sides count the same.
  EXPECT_NEAR(pgl::occluder_weight({{1, 2, -7}, {0, 0, -2}, 1}, eye), 4.0 / 104, 1e-6);
}

TEST(OccluderWeight, IsFiniteWithTheEyeInTheBoxAndAtAnyScale) {
  const pgl::Eye eye{1, 2, 3, 1};
  EXPECT_EQ(pgl::occluder_weight(facing_z({1, 2, 3}, 4), eye), 0.0f);
  EXPECT_EQ(pgl::occluder_weight(OccluderFace{}, eye), 0.0f);
  for (const float size : {1e-38f, 1e-30f, 1e-6f, 1.0f, 1e9f, 1e30f, 1e38f})
    for (const float away : {0.0f, 1e-38f, 1e-6f, 1.0f, 1e9f, 1e38f}) {
      const float weight = pgl::occluder_weight({{1 + away, 2, 3 - away}, {size, size, size}, 1}, eye);
      EXPECT_GE(weight, 0.0f);
      EXPECT_LE(weight, 1.0f);
    }
}

TEST(OccluderWeight, IsTheFormulaFromDistancesFarBelowFloatToFarBeyond) {
  // A |a . t| / (|t| (t^2 + A)) with a = t / |t|: A / (t^2 + A).
  for (const int t : {-250, -200, -100, -20, 0, 20, 60}) {
    const pgl::Eye eye{0, 0, std::ldexp(1.0, t), 1};
    EXPECT_EQ(pgl::occluder_weight(facing_z({0, 0, 0}, 1), eye), static_cast<float>(1 / (std::ldexp(1.0, 2 * t) + 1)));
    EXPECT_EQ(pgl::occluder_weight({{0, 0, 0}, {0, 0, 0x1p-149f}, 1}, eye),
              static_cast<float>(0x1p-298 / (std::ldexp(1.0, 2 * t) + 0x1p-298)));
    EXPECT_EQ(pgl::occluder_weight({{0, 0, 0}, {0, 0, 0x1p127f}, 1}, eye),
              static_cast<float>(0x1p254 / (std::ldexp(1.0, 2 * t) + 0x1p254)));
  }
  for (const double t : {0x1p-251, 0x1p-1000, 0x1p-1074, 0x1p250, 0x1p251, 0x1p511, 0x1p1000})
    for (const float size : {0.0f, 0x1p-149f, 1.0f, 0x1p127f})
      EXPECT_EQ(pgl::occluder_weight({{0, 0, 0}, {0, 0, size}, 1}, {0, 0, t, 1}), 0.0f) << t << " " << size;
}

TEST(OccluderWeight, OfAParallelViewGrowsWithTheProjectedAreaAndDoesNotFallWithDistance) {
  View v;
  v.clip_from_world = glm::ortho(-3.0f, 3.0f, -2.0f, 2.0f, 0.1f, 100.0f);
  const pgl::Eye eye = pgl::eye_of(v);
  const float near = pgl::occluder_weight(facing_z({0, 0, -1}, 4), eye);
  EXPECT_EQ(pgl::occluder_weight(facing_z({0, 0, -90}, 4), eye), near);
  EXPECT_EQ(near, 2.0f);  // sqrt(4)
  EXPECT_GT(pgl::occluder_weight(facing_z({0, 0, -1}, 5), eye), near);
  EXPECT_LT(pgl::occluder_weight(facing_z({0, 0, -1}, 4, 0.5f), eye), near);
  EXPECT_EQ(pgl::occluder_weight({{0, 0, -1}, {2, 0, 0}, 1}, eye), 0.0f);
  EXPECT_TRUE(std::isfinite(pgl::occluder_weight({{0, 0, 0}, {3e38f, 3e38f, 3e38f}, 1}, eye)));
}

TEST(OccluderWeight, IsNoNumberForFacesThatAreNot) {
  for (const pgl::Eye eye : {pgl::Eye{1, 2, 3, 1}, pgl::Eye{1, 2, 3, 0}}) {
    for (const float bad : {nan, inf, -inf}) {
      EXPECT_TRUE(std::isnan(pgl::occluder_weight({{0, bad, 0}, {1, 1, 1}, 1}, eye)));
      EXPECT_TRUE(std::isnan(pgl::occluder_weight({{0, 0, 0}, {1, bad, 1}, 1}, eye)));
      EXPECT_TRUE(std::isnan(pgl::occluder_weight({{0, 0, 0}, {1, 1, 1}, bad}, eye)));
    }
  }
  EXPECT_EQ(pgl::occluder_weight(facing_z({0, 0, -1}, 4), pgl::Eye{0, 0, 0, 0}), 0.0f);  // no view at all
}

// ---- the order of compactness

TEST(CompactnessOrder, IsDescendingWithTiesByIndexAndNaNLast) {
  std::vector<OccluderFace> faces(8);
  const float compactness[] = {0.5f, nan, 1.0f, 0.0f, 0.5f, -0.0f, 1.0f, 0.25f};
  for (std::size_t i = 0; i < 8; ++i) faces[i].compactness = compactness[i];
  pgl::host::OccluderWorkspace workspace;
  Indices order(8);
  pgl::host::compactness_order(faces, workspace, order);
  EXPECT_EQ(order, (Indices{2, 6, 0, 4, 7, 3, 5, 1}));
  EXPECT_EQ(pgl::host::compact_objects(faces, order, 2.0f), 0u);
  EXPECT_EQ(pgl::host::compact_objects(faces, order, 1.0f), 2u);
  EXPECT_EQ(pgl::host::compact_objects(faces, order, 0.5f), 4u);
  EXPECT_EQ(pgl::host::compact_objects(faces, order, 0.3f), 4u);
  EXPECT_EQ(pgl::host::compact_objects(faces, order, 0.0f), 7u);
  EXPECT_EQ(pgl::host::compact_objects(faces, order, -inf), 7u);
  EXPECT_EQ(pgl::host::compact_objects(faces, order, nan), 0u);
  pgl::host::compactness_order({}, workspace, {});
  EXPECT_EQ(pgl::host::compact_objects({}, {}, 0.0f), 0u);
}

// ---- selection

TEST(SelectOccluders, TakesTheHeaviestInTheOrderOfTheCandidates) {
  std::vector<OccluderFace> faces;
  for (int i = 0; i < 6; ++i)
    faces.push_back(facing_z({0, 0, -10}, static_cast<float>((i * 5) % 6 + 1)));  // 1 6 5 4 3 2
  const View view = from({0, 0, 0});
  EXPECT_EQ(select(all(6), faces, {}, view, 0), Indices{});
  EXPECT_EQ(select(all(6), faces, {}, view, 1), Indices{1});
  EXPECT_EQ(select(all(6), faces, {}, view, 3), (Indices{1, 2, 3}));
  EXPECT_EQ(select({5, 3, 1, 0, 2, 4}, faces, {}, view, 3), (Indices{3, 1, 2}));
  EXPECT_EQ(select(all(6), faces, {}, view, 6), all(6));
  EXPECT_EQ(select({5, 0}, faces, {}, view, 1), Indices{5});
}

TEST(SelectOccluders, TakesTheSameFromManyThatAreSharedAmongThreads) {
  std::vector<OccluderFace> faces;
  Indices candidates;
  const std::uint32_t n = 50000;
  for (std::uint32_t i = 0; i < n; ++i) {
    faces.push_back(facing_z({0, 0, -10}, static_cast<float>(1 + i * 7919u % 20011u)));  // some twice or three times
    candidates.push_back(i * 30011u % n);
  }
  std::vector<std::uint32_t> sorted = all(n);
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return faces[a].normal.z > faces[b].normal.z; });
  for (const std::size_t k : {0u, 1u, 20u, 5000u, 20000u, 49999u, 50000u, 50001u}) {
    std::vector<bool> chosen(n);
    for (std::size_t i = 0; i < std::min<std::size_t>(k, n); ++i) chosen[sorted[i]] = true;
    Indices expected;
    for (const std::uint32_t object : candidates)
      if (chosen[object]) expected.push_back(object);
    expected.resize(k, no_object);
    EXPECT_TRUE(select(candidates, faces, {}, from({0, 0, 0}), k) == expected) << k;
  }
}

TEST(SelectOccluders, FillsUpWithNoObject) {
  const std::vector<OccluderFace> faces(3, facing_z({0, 0, -10}, 4));
  const View view = from({0, 0, 0});
  EXPECT_EQ(select({2, 0}, faces, {}, view, 4), (Indices{2, 0, no_object, no_object}));
  EXPECT_EQ(select(all(3), faces, {0, 1, 0}, view, 2), (Indices{1, no_object}));
  EXPECT_EQ(select(all(3), faces, {0, 0, 0}, view, 2), (Indices{no_object, no_object}));
  EXPECT_EQ(select({}, faces, {}, view, 2), (Indices{no_object, no_object}));
  EXPECT_EQ(select({}, {}, {}, view, 1), (Indices{no_object}));
}

TEST(SelectOccluders, TakesTheLowerIndicesOfEqualWeights) {
  const std::vector<OccluderFace> faces(5, facing_z({0, 0, -10}, 4));
  EXPECT_EQ(select({4, 1, 3, 0, 2}, faces, {}, from({0, 0, 0}), 3), (Indices{1, 0, 2}));
}

TEST(SelectOccluders, TakesObjectsWithoutWeightLastAndThoseThatAreNoNumbersNever) {
  std::vector<OccluderFace> faces(4, facing_z({0, 0, -10}, 4));
  faces[0].compactness = nan;
  faces[1].compactness = 0;
  const View view = from({0, 0, 0});
  EXPECT_EQ(select(all(4), faces, {}, view, 2), (Indices{2, 3}));
  EXPECT_EQ(select(all(4), faces, {}, view, 3), (Indices{1, 2, 3}));
  EXPECT_EQ(select(all(4), faces, {}, view, 4), (Indices{1, 2, 3, no_object}));
}

TEST(SelectOccluders, LeavesOutWhatIsOutOfView) {
  std::vector<OccluderFace> faces;
  for (int i = 0; i < 6; ++i) faces.push_back(facing_z({0, 0, -10}, static_cast<float>(6 - i)));
  EXPECT_EQ(select(all(6), faces, {0, 0, 1, 0, 255, 1}, from({0, 0, 0}), 2), (Indices{2, 4}));
}

}  // namespace
