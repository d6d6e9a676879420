// SPDX-License-Identifier: MIT
// Collects what a new selection needs and the one before did not have, so that only that must be transferred.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "pgl/config.hpp"
#include "pgl/gather.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/pack_delta.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

/// Writes where the new elements of every object go in the block of all that is new: delta_offsets[i] is the number of
/// new elements of the objects before i, delta_offsets[n] that of all, which is also returned.
///
/// - previous_offsets[n+1], offsets[n+1]: exclusive prefix sums of the counts of the last selection and of this one, of
///   vertices or of triangles, over the same objects. Before the first frame all previous_offsets are 0;
/// - delta_offsets[n+1]: out, overlaps neither. All are 0 when nothing grew.
///
/// Preconditions: both begin with 0 and never decrease (the sizes are checked in debug builds, the order too).
/// O(n), parallel, nothing allocated; the same for any number of threads.
inline std::uint64_t lay_out_delta(std::span<const std::uint64_t> previous_offsets,
                                   std::span<const std::uint64_t> offsets, std::span<std::uint64_t> delta_offsets) {
  PGL_ASSERT(!offsets.empty() && previous_offsets.size() == offsets.size() && delta_offsets.size() == offsets.size());
  PGL_ASSERT(previous_offsets.front() == 0 && offsets.front() == 0);
  return detail::scan(offsets.size() - 1, delta_offsets,
                      [&](std::size_t i) { return delta_part(previous_offsets.data(), offsets.data(), i).size; });
}

namespace pack_delta_detail {

/// Calls body(i, element, at, size) for runs of new elements that together are all: elements [element, element + size)
/// of the mesh of object i go to [at, at + size) of the block. In parallel, by equal pieces of the block.
template <class Body>
void for_new_elements(std::span<const std::uint64_t> previous_offsets, std::span<const std::uint64_t> offsets,
                      std::span<const std::uint64_t> delta_offsets, std::uint64_t chunk, Body&& body) {
  PGL_ASSERT(previous_offsets.size() == offsets.size() && delta_offsets.size() == offsets.size());
  PGL_ASSERT(!offsets.empty() && previous_offsets.front() == 0 && offsets.front() == 0 && delta_offsets.front() == 0);
  const std::uint64_t total = delta_offsets.back();
  parallel_for((total + chunk - 1) / chunk, 1, [&](std::size_t c) {
    std::uint64_t at = c * chunk;
    const std::uint64_t end = std::min(total, at + chunk);
    auto i = static_cast<std::size_t>(std::ranges::upper_bound(delta_offsets, at) - delta_offsets.begin() - 1);
    for (; at < end; ++i) {
      const DeltaPart part = delta_part(previous_offsets.data(), offsets.data(), i);
      PGL_ASSERT(delta_offsets[i + 1] - delta_offsets[i] == part.size);
      const std::uint64_t stop = std::min(end, delta_offsets[i + 1]);
      if (at < stop) body(i, part.first + (at - delta_offsets[i]), at, stop - at);
      at = stop;
    }
  });
}

/// Elements of this many bytes that a thread takes at a time: about 64 KiB, at least one.
constexpr std::uint64_t chunk_of(std::size_t bytes) {
  return std::max<std::uint64_t>(1, (std::uint64_t{1} << 16) / bytes);
}

}  // namespace pack_delta_detail

/// Copies the new elements of every object into one block: elements [previous count, count) of the mesh of object i to
/// out[delta_offsets[i] .. delta_offsets[i+1]), each once, in the order of the mesh. Nothing where the object shrank or
/// stayed, and nothing at all when none grew. [Peng13] 3.3.
///
/// - meshes, objects[n]: the scene;
/// - first: which elements these are, &Mesh::first_vertex or &Mesh::first_triangle;
/// - elements: those of all meshes, as the meshes index them; T is any trivially copyable payload;
/// - previous_offsets[n+1], offsets[n+1]: exclusive prefix sums of the counts of the last selection and of this one;
/// - delta_offsets[n+1]: as lay_out_delta writes it from these two;
/// - out: at least delta_offsets[n] elements, e.g. pinned memory that a transfer starts from. Overlaps no input.
///   Elements from the total on are left as they are.
///
/// Sizes are checked in debug builds. O(n + delta_offsets[n]), parallel within objects too, no scratch; the result does
/// not depend on the number of threads.
template <class T>
void pack_delta(std::span<const Mesh> meshes, std::span<const Object> objects, std::uint64_t Mesh::*first,
                std::span<const T> elements, std::span<const std::uint64_t> previous_offsets,
                std::span<const std::uint64_t> offsets, std::span<const std::uint64_t> delta_offsets,
                std::span<T> out) {
  static_assert(std::is_trivially_copyable_v<T>);
  PGL_ASSERT(offsets.size() == objects.size() + 1 && delta_offsets.back() <= out.size());
  pack_delta_detail::for_new_elements(previous_offsets, offsets, delta_offsets, pack_delta_detail::chunk_of(sizeof(T)),
                                      [&](std::size_t i, std::uint64_t element, std::uint64_t at, std::uint64_t size) {
                                        const std::uint64_t from = meshes[objects[i].mesh].*first + element;
                                        PGL_ASSERT(from + size <= elements.size());
                                        std::copy_n(elements.data() + from, size, out.data() + at);
                                      });
}

/// Writes the new vertices of every object, placed in the world, into one block: what pack_delta does with
/// &Mesh::first_vertex, each vertex as gather would have written it. So a block that gather filled, brought up to date
/// by these, is the block that gather fills for the new selection, as long as the transforms stay what they were.
///
/// Arguments as for pack_delta; Placed as for gather (pgl/gather.hpp).
template <class Placed, class Vertex>
void pack_placed_delta(std::span<const Mesh> meshes, std::span<const Object> objects, std::span<const Vertex> vertices,
                       std::span<const std::uint64_t> previous_offsets, std::span<const std::uint64_t> offsets,
                       std::span<const std::uint64_t> delta_offsets, std::span<Placed> out) {
  PGL_ASSERT(offsets.size() == objects.size() + 1 && delta_offsets.back() <= out.size());
  pack_delta_detail::for_new_elements(previous_offsets, offsets, delta_offsets,
                                      pack_delta_detail::chunk_of(sizeof(Placed)),
                                      [&](std::size_t i, std::uint64_t element, std::uint64_t at, std::uint64_t size) {
                                        const Object object = objects[i];
                                        const std::uint64_t from = meshes[object.mesh].first_vertex + element;
                                        PGL_ASSERT(from + size <= vertices.size());
                                        for (std::uint64_t k = 0; k < size; ++k) {
                                          place(object, static_cast<std::uint32_t>(i), vertices[from + k], out[at + k]);
                                        }
                                      });
}

}  // namespace pgl::host
