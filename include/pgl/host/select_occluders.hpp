// SPDX-License-Identifier: MIT
// Chooses the occluders of a frame, on the CPU.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefetch.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Writes each object's face: the largest one of its mesh's oriented box in the world (see occluder_face). Once per
/// model, or when objects move.
///
/// boxes, compactness: in, one per mesh (see oriented_boxes). faces: out, one per object.
/// Preconditions: faces.size() == objects.size(); every object's mesh is below boxes.size() == compactness.size().
/// O(objects), allocates nothing; the same bits for any number of threads.
inline void occluder_faces(std::span<const Object> objects, std::span<const OrientedBox> boxes,
                           std::span<const float> compactness, std::span<OccluderFace> faces) {
  PGL_ASSERT(faces.size() == objects.size() && compactness.size() == boxes.size());
  parallel_for(objects.size(), 1024, [&](std::size_t i) {
    PGL_ASSERT(objects[i].mesh < boxes.size());
    faces[i] = occluder_face(boxes[objects[i].mesh], compactness[objects[i].mesh], objects[i].transform);
  });
}

/// Scratch memory of compactness_order and select_occluders. Reuse it: it grows to the largest call and stays.
struct OccluderWorkspace {
  std::vector<std::uint64_t> keys;
  std::vector<std::uint64_t> heaviest;
};

/// Writes the objects' indices by descending compactness, ties by ascending index; NaN comes last. Once per model.
///
/// faces: in, one per object, at most 2^31. order: out, as many. O(n log n). The same for any number of threads.
inline void compactness_order(std::span<const OccluderFace> faces, OccluderWorkspace& workspace,
                              std::span<std::uint32_t> order) {
  const std::size_t n = faces.size();
  PGL_ASSERT(order.size() == n && n <= (std::size_t{1} << 31));
  if (workspace.keys.size() < n) workspace.keys.resize(n);
  const std::span<std::uint64_t> keys(workspace.keys.data(), n);
  parallel_for(n, 4096, [&](std::size_t i) {
    keys[i] = (static_cast<std::uint64_t>(~compactness_key(faces[i].compactness)) << 32) | i;
  });
  std::sort(keys.begin(), keys.end());
  parallel_for(n, 4096, [&](std::size_t i) { order[i] = static_cast<std::uint32_t>(keys[i]); });
}

/// Returns how many objects at the beginning of the compactness order have at least the threshold: the candidates for
/// occluders of [Peng13] 4.2.1 are order.first(this). All but NaN for a threshold of at most 0; 0 for NaN.
///
/// order: compactness_order's of these faces. O(log n).
inline std::size_t compact_objects(std::span<const OccluderFace> faces, std::span<const std::uint32_t> order,
                                   float threshold) {
  PGL_ASSERT(order.size() == faces.size());
  const auto end = std::partition_point(order.begin(), order.end(),
                                        [&](std::uint32_t object) { return faces[object].compactness >= threshold; });
  return static_cast<std::size_t>(end - order.begin());
}

/// Chooses the occluders of a frame: of the candidates in view the occluders.size() heaviest (see occluder_weight);
/// among equal weights those with the lower indices.
///
/// candidates: in, indices of objects, each at most once, in any order (as the compact objects of a model, or all of
/// them); ascending order is the fastest. faces: in, one per object. in_view: in, one per object, 0 where it is out of
/// view; empty means all are in view. occluders: out, overlapping no input: the indices chosen, in the order that they
/// have among the candidates, and no_object in the rest where there are fewer.
/// A candidate whose weight is NaN is never chosen; one whose weight is 0 is, as the lightest.
/// Preconditions: every candidate is below faces.size(); in_view, if not empty, has faces.size() entries;
/// faces.size() <= 2^31. O(candidates + occluders), in parallel; allocates only where the workspace is smaller than
/// ever before. The same for any number of threads.
/// Source: [Peng13] 4.2.1 and Eq 4.2.
inline void select_occluders(std::span<const std::uint32_t> candidates, std::span<const OccluderFace> faces,
                             std::span<const std::uint8_t> in_view, const View& view, OccluderWorkspace& workspace,
                             std::span<std::uint32_t> occluders) {
  const std::size_t n = candidates.size(), k = std::min(occluders.size(), n);
  PGL_ASSERT(in_view.empty() || in_view.size() == faces.size());
  PGL_ASSERT(faces.size() <= (std::size_t{1} << 31) && n <= faces.size());
  const std::size_t blocks = detail::block_count(n);
  if (workspace.keys.size() < n) workspace.keys.resize(n);
  if (workspace.heaviest.size() < n) workspace.heaviest.resize(n);
  const Eye eye = eye_of(view);

  // Each block's k + 1 heaviest, anywhere in its part of `heaviest`, then those of all: the k-th is the limit.
  std::array<std::size_t, detail::max_blocks> sizes{};
  detail::for_blocks(n, blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
    std::uint64_t* const own = workspace.heaviest.data() + begin;
    std::size_t size = 0;
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t object = candidates[i];
      PGL_ASSERT(object < faces.size());
      if (i + 16 < end) prefetch(&faces[candidates[i + 16]], 1);
      const bool seen = in_view.empty() || in_view[object] != 0;
      const std::uint64_t key = seen ? occluder_key(occluder_weight(faces[object], eye), object) : 0;
      workspace.keys[i] = key;
      if (key != 0) own[size++] = key;
    }
    if (size > k + 1) {
      std::nth_element(own, own + k + 1, own + size, std::greater<>{});
      size = k + 1;
    }
    sizes[b] = size;
  });
  std::size_t size = 0;
  for (std::size_t b = 0; b < blocks; ++b) {
    const std::uint64_t* const own = workspace.heaviest.data() + n * b / blocks;
    std::copy(own, own + sizes[b], workspace.heaviest.data() + size);  // never beyond where it is read
    size += sizes[b];
  }
  std::uint64_t limit = 1;  // all candidates with a key
  if (size > k) {
    const auto first = workspace.heaviest.begin();
    std::nth_element(first, first + static_cast<std::ptrdiff_t>(k), first + static_cast<std::ptrdiff_t>(size),
                     std::greater<>{});
    limit = workspace.heaviest[k] + 1;  // keys differ
  }

  // In the candidates' order, each block from where those before it end.
  std::array<std::size_t, detail::max_blocks> chosen{};
  detail::for_blocks(n, blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) chosen[b] += workspace.keys[i] >= limit;
  });
  std::size_t total = 0;
  for (std::size_t b = 0; b < blocks; ++b) {
    const std::size_t of_block = chosen[b];
    chosen[b] = total;
    total += of_block;
  }
  detail::for_blocks(n, blocks, [&](std::size_t b, std::size_t begin, std::size_t end) {
    std::size_t at = chosen[b];
    for (std::size_t i = begin; i < end; ++i)
      if (workspace.keys[i] >= limit) occluders[at++] = candidates[i];
  });
  std::fill(occluders.begin() + static_cast<std::ptrdiff_t>(total), occluders.end(), no_object);
}

}  // namespace pgl::host
