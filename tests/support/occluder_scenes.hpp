// SPDX-License-Identifier: MIT
// RapidCheck generator of faces, candidates and views for the choice of occluders.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "pgl/select_occluders.hpp"
#include "support/numbers.hpp"

namespace occluders {

struct Scene {
  std::vector<pgl::OccluderFace> faces;
  std::vector<std::uint32_t> candidates;
  std::vector<std::uint8_t> in_view;  ///< empty: all are
  pgl::View view;
  std::size_t wanted = 0;
  std::size_t size() const { return candidates.size(); }
};

/// Faces of which many weigh the same or nothing and some are no numbers; candidates in any order, some left out.
inline Scene any_scene(int most = 60) {
  using numbers::whole;
  Scene scene;
  const numbers::Kind k = numbers::kind();
  scene.view = numbers::view(k);
  const int n = whole(0, most);
  for (int i = 0; i < n; ++i) {
    pgl::OccluderFace face;
    if (!scene.faces.empty() && whole(0, 3) == 0) {
      face = scene.faces[static_cast<std::size_t>(whole(0, i - 1))];
    } else {
      const bool odd = whole(0, 7) == 0;
      for (int axis = 0; axis < 3; ++axis) {
        face.centre[axis] = odd ? numbers::any_number(k) : numbers::number(k);
        face.normal[axis] = odd ? numbers::any_number(k) : numbers::number(k);
      }
      face.compactness = odd ? numbers::any_number(k) : static_cast<float>(whole(0, 16)) / 16;
    }
    scene.faces.push_back(face);
    scene.candidates.push_back(static_cast<std::uint32_t>(i));
  }
  for (int i = n - 1; i > 0; --i)
    std::swap(scene.candidates[static_cast<std::size_t>(i)], scene.candidates[static_cast<std::size_t>(whole(0, i))]);
  if (whole(0, 1)) scene.candidates.resize(static_cast<std::size_t>(whole(0, n)));
  if (whole(0, 2)) {
    for (int i = 0; i < n; ++i) scene.in_view.push_back(whole(0, 2) > 0);
  }
  const int c = static_cast<int>(scene.candidates.size());
  scene.wanted = static_cast<std::size_t>(whole(0, 1) ? whole(0, c / 4) : whole(0, c + 3));
  return scene;
}

}  // namespace occluders
