// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "pgl/host/select_occluders.hpp"
#include "support/exact.hpp"
#include "support/numbers.hpp"
#include "support/occluder_scenes.hpp"

namespace {

using exact::Number;
using numbers::Kind;
using pgl::OccluderFace;
using pgl::View;

/// The determinant of three columns of the rows x, y and w.
Number minor(const View& v, int a, int b, int c) {
  const auto e = [&](int row, int column) { return Number(v.clip_from_world[column][row]); };
  return e(0, a) * (e(1, b) * e(3, c) - e(1, c) * e(3, b)) - e(0, b) * (e(1, a) * e(3, c) - e(1, c) * e(3, a)) +
         e(0, c) * (e(1, a) * e(3, b) - e(1, b) * e(3, a));
}

RC_GTEST_PROP(EyeProps, isWhereTheRowsXYAndWVanishUpToRounding, ()) {
  for (int repeat = 0; repeat < 50; ++repeat) {
    const View v = numbers::view(numbers::kind());
    const pgl::Eye eye = pgl::eye_of(v);
    const Number exact_eye[4] = {minor(v, 1, 2, 3), -minor(v, 0, 2, 3), minor(v, 0, 1, 3), -minor(v, 0, 1, 2)};
    for (const int row : {0, 1, 3}) {  // they do vanish there
      Number sum = 0;
      for (int column = 0; column < 4; ++column) sum += Number(v.clip_from_world[column][row]) * exact_eye[column];
      RC_ASSERT(sum == 0);
    }
    // How far the determinants come out wrong at most: 2^-50 of the sizes of their six products.
    Number error[4];
    for (int i = 0; i < 4; ++i) {
      for (int a = 0; a < 4; ++a)
        for (int b = 0; b < 4; ++b)
          for (int c = 0; c < 4; ++c)
            if (a != b && b != c && a != c && a != i && b != i && c != i)
              error[i] += abs(Number(v.clip_from_world[a][0]) * Number(v.clip_from_world[b][1]) *
                              Number(v.clip_from_world[c][3]));
      error[i] *= Number(0x1p-50);
    }
    const double got[3] = {eye.x, eye.y, eye.z};
    RC_ASSERT(eye.w == 0.0 || eye.w == 1.0);
    if (eye.w == 1.0) {
      // got (W + e_w) = (X + e_x) (1 + d) with |d| <= 2^-53, where X and W are exact: got W - X is
      // e_x + d (X + e_x) - got e_w, and |X| <= 2^50 error.
      for (int i = 0; i < 3; ++i)
        RC_ASSERT(abs(Number(got[i]) * exact_eye[3] - exact_eye[i]) <=
                  error[i] * Number(1.25) + abs(Number(got[i])) * error[3]);
    } else {
      // got s = X + e_x with one s > 0, a power of two.
      RC_ASSERT(abs(exact_eye[3]) <= error[3]);
      const double largest = std::max({std::abs(got[0]), std::abs(got[1]), std::abs(got[2])});
      RC_ASSERT(largest == 0.0 || (largest >= 1.0 && largest < 2.0));
      for (int i = 0; i < 3; ++i) {
        if (largest == 0.0) RC_ASSERT(abs(exact_eye[i]) <= error[i]);
        for (int j = 0; j < 3; ++j)
          RC_ASSERT(abs(Number(got[i]) * exact_eye[j] - Number(got[j]) * exact_eye[i]) <=
                    abs(Number(got[i])) * error[j] + abs(Number(got[j])) * error[i]);
        if (abs(exact_eye[i]) > error[i]) RC_ASSERT(Number(got[i]) * exact_eye[i] > 0);
      }
    }
  }
}

/// The formula, as it is written, in long double.
long double weight_of(const OccluderFace& face, const pgl::Eye& eye) {
  long double t[3], square = 0, area = 0, along = 0;
  for (int i = 0; i < 3; ++i) {
    t[i] = static_cast<long double>(i == 0 ? eye.x : i == 1 ? eye.y : eye.z);
    if (eye.w != 0) t[i] -= static_cast<long double>(face.centre[i]);
    square += t[i] * t[i];
    area += static_cast<long double>(face.normal[i]) * static_cast<long double>(face.normal[i]);
  }
  if (square == 0 || area == 0) return 0;
  for (int i = 0; i < 3; ++i) along += static_cast<long double>(face.normal[i]) / std::sqrt(area) * t[i];
  const long double c = face.compactness, distance = std::sqrt(square);
  if (eye.w == 0) return std::sqrt(c * area * std::abs(along) / distance);
  return c * area * std::abs(along) / (distance * (square + area));
}

OccluderFace any_face(Kind k) {
  OccluderFace face;
  face.centre = numbers::point(k);
  face.normal = numbers::point(k);
  face.compactness = static_cast<float>(numbers::whole(0, 16)) / 16;
  return face;
}

RC_GTEST_PROP(OccluderWeightProps, isTheFormula, ()) {
  for (int repeat = 0; repeat < 100; ++repeat) {
    const Kind k = numbers::kind();
    const OccluderFace face = any_face(k);
    const glm::vec3 at = numbers::point(k);
    const bool far = numbers::whole(0, 3) == 0;
    const pgl::Eye eye{static_cast<double>(at.x), static_cast<double>(at.y), static_cast<double>(at.z),
                       far ? 0.0 : 1.0};
    const float weight = pgl::occluder_weight(face, eye);
    const long double expected = weight_of(face, eye);
    RC_ASSERT(weight >= 0.0f && std::isfinite(weight));
    if (!far) RC_ASSERT(weight <= 1.0f);
    // n . t may cancel: its terms' sizes times what rounding leaves, over what makes the weight of it.
    long double square = 0, area = 0;
    for (int i = 0; i < 3; ++i) {
      const long double t = static_cast<long double>(at[i]) - (far ? 0 : static_cast<long double>(face.centre[i]));
      square += t * t;
      area += static_cast<long double>(face.normal[i]) * static_cast<long double>(face.normal[i]);
    }
    const long double whole = static_cast<long double>(face.compactness) * area;
    const long double error = square == 0 || area == 0 ? 0.0L : 0x1p-48L * (far ? whole : whole / (square + area));
    if (far)
      RC_ASSERT(std::abs(static_cast<long double>(weight) * weight - expected * expected) <=
                0x1p-22L * expected * expected + error + 1e-44L);
    else
      RC_ASSERT(std::abs(weight - expected) <= 0x1p-23L * expected + error + 1e-44L);
  }
}

RC_GTEST_PROP(OccluderFaceProps, isTheLargestOfTheThreeParallelograms, ()) {
  for (int repeat = 0; repeat < 50; ++repeat) {
    pgl::OrientedBox box;
    const Kind k = numbers::whole(0, 1) ? Kind::small : Kind::plain;
    box.centre = numbers::point(k);
    for (int i = 0; i < 3; ++i) box.half[i] = std::abs(numbers::number(k));
    glm::mat4x3 m;
    for (int column = 0; column < 4; ++column) m[column] = numbers::point(k);
    const OccluderFace face = pgl::occluder_face(box, 0.75f, m);
    const glm::dmat4x3 wide(m);
    double largest = 0;
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3;
      const glm::dvec3 a = wide[i] * (2.0 * static_cast<double>(box.half[i]));
      const glm::dvec3 b = wide[j] * (2.0 * static_cast<double>(box.half[j]));
      largest = std::max(largest, glm::length(glm::cross(a, b)));
    }
    const glm::dvec3 normal(face.normal);
    RC_ASSERT(std::abs(glm::dot(normal, normal) - largest) <= 1e-5 * largest);
    const glm::dvec3 centre = wide * glm::dvec4(glm::dvec3(box.centre), 1.0);
    for (int i = 0; i < 3; ++i) RC_ASSERT(std::abs(static_cast<double>(face.centre[i]) - centre[i]) <= 1e-5);
    // It is perpendicular to two of the carried axes.
    int perpendicular = 0;
    for (int i = 0; i < 3; ++i)
      perpendicular += std::abs(glm::dot(normal, wide[i])) <= 1e-5 * glm::length(normal) * glm::length(wide[i]) + 1e-30;
    RC_ASSERT(perpendicular >= 2);
  }
}

RC_GTEST_PROP(SelectOccludersProps, chosenAreTheFirstOfASortInTheOrderOfTheCandidates, ()) {
  for (int repeat = 0; repeat < 20; ++repeat) {
    const occluders::Scene scene = occluders::any_scene();
    pgl::host::OccluderWorkspace workspace;
    std::vector<std::uint32_t> chosen(scene.wanted, 777);
    pgl::host::select_occluders(scene.candidates, scene.faces, scene.in_view, scene.view, workspace, chosen);

    std::vector<std::uint32_t> sorted;
    const pgl::Eye eye = pgl::eye_of(scene.view);
    const auto weight = [&](std::uint32_t object) { return pgl::occluder_weight(scene.faces[object], eye); };
    for (const std::uint32_t object : scene.candidates)
      if ((scene.in_view.empty() || scene.in_view[object]) && !std::isnan(weight(object))) sorted.push_back(object);
    std::sort(sorted.begin(), sorted.end(),
              [&](std::uint32_t a, std::uint32_t b) { return weight(a) != weight(b) ? weight(a) > weight(b) : a < b; });
    sorted.resize(std::min(sorted.size(), scene.wanted));
    std::sort(sorted.begin(), sorted.end());
    std::vector<std::uint32_t> expected;
    for (const std::uint32_t object : scene.candidates)
      if (std::binary_search(sorted.begin(), sorted.end(), object)) expected.push_back(object);
    expected.resize(scene.wanted, pgl::no_object);
    RC_ASSERT(chosen == expected);
  }
}

RC_GTEST_PROP(CompactnessOrderProps, isAPermutationThatDescendsAndTheThresholdCutsIt, ()) {
  const occluders::Scene scene = occluders::any_scene();
  const std::size_t n = scene.faces.size();
  pgl::host::OccluderWorkspace workspace;
  std::vector<std::uint32_t> order(n);
  pgl::host::compactness_order(scene.faces, workspace, order);
  std::vector<std::uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  for (std::size_t i = 0; i < n; ++i) RC_ASSERT(sorted[i] == i);
  for (std::size_t i = 1; i < n; ++i) {
    const float a = scene.faces[order[i - 1]].compactness, b = scene.faces[order[i]].compactness;
    RC_ASSERT(std::isnan(b) || a >= b);
    if (a == b || std::isnan(a)) RC_ASSERT(order[i - 1] < order[i]);
  }
  const float threshold = static_cast<float>(numbers::whole(-1, 17)) / 16;
  std::size_t expected = 0;
  for (const OccluderFace& face : scene.faces) expected += face.compactness >= threshold;
  RC_ASSERT(pgl::host::compact_objects(scene.faces, order, threshold) == expected);
}

}  // namespace
