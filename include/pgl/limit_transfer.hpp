// SPDX-License-Identifier: MIT
// The rule of limit_transfer: what of a selection's growth a transfer of so many bytes allows, by visual weight.
#pragma once

#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/distribute_budget.hpp"
#include "pgl/types.hpp"

// A frame wants counts w and the last one drew the counts p. Where w <= p an object shrinks or stays, which costs
// nothing: it gets w. All others *grow*, and their growth must be transferred: vertices, and the triangles that come
// with them. What fits into the cap is decided in the order of weight_key, heaviest object first:
//
// 1. Objects that are *new* (p = 0) get their first step: the fewest vertices that they may be drawn with. The first
//    of them whose step does not fit any more waits, and so do all new ones after it: they are not drawn yet.
// 2. What is left of the cap goes to the growth up to w of all that are drawn now (p > 0, or new and not waiting). The
//    first one that does not fit takes the most vertices that do. Those after it stay as they are.
//
// Both cuts are where a running sum of bytes first exceeds a limit, as in distribute_budget, and each object's count
// follows from them and from itself alone. What this means, c the counts that come out:
//
// - The bytes of the growth from p to c never exceed the cap: the first steps given are at most the cap, and the rest
//   at most what these leave.
// - min(p, w) <= c <= w. And c is 0 or a count that the object may be drawn with, since it is 0, p, w, the first step,
//   or between a first step or p and w. So the selection is valid, only coarser, and within any budget that w is in.
// - Within a step the order decides: no object waits while a lighter new one is given its first step, and none that
//   is drawn stops short of w while a lighter one gets more than p or its first step.
// - If all growth fits into the cap, c = w. With the cap 0, nothing grows that costs anything.
// - Let w and the weights stay, each frame's c be the next one's p, and no p lie between 0 and the object's minimum.
//   Let L be the largest *step* of the meshes: the bytes of a first step or of one vertex more, with its triangles
//   (least_cap). If the cap is at least L, then c = w after at most B / (cap - L + 1) + 1 frames, B the bytes of all
//   growth; in less than B / cap frames it cannot be. For a frame after which something is missing has sent more than
//   cap - L: either a new object waits, since its step is more than what the first steps before it left of the cap; or
//   none waits, and the object at the second cut did not get one vertex more, since that step is more than what is
//   left. With a cap that is less than the step of the object whose turn it is, that object stays as it is, and so do
//   those of the same step after it.

namespace pgl {

/// What limit_transfer is asked for.
struct TransferOptions {
  std::uint64_t cap = ~std::uint64_t{0};  ///< bytes that may be transferred in a frame; the default is no limit
  std::uint32_t vertex_bytes = 12;        ///< of a vertex, at most 65536
  std::uint32_t triangle_bytes = 12;      ///< of a triangle, at most 65536
};

/// What limit_transfer let through.
struct TransferTotals {
  std::uint64_t bytes = 0;          ///< to be transferred, at most the cap
  std::uint64_t missing_bytes = 0;  ///< that the wanted selection would take beyond these
  std::uint64_t waiting = 0;        ///< objects with fewer vertices than wanted
  constexpr void operator+=(const TransferTotals& other) {
    bytes += other.bytes;
    missing_bytes += other.missing_bytes;
    waiting += other.waiting;
  }
  friend constexpr bool operator==(const TransferTotals&, const TransferTotals&) = default;
};

/// Tells whether every option is in its documented range.
PGL_HD constexpr bool is_valid(const TransferOptions& options) {
  return options.vertex_bytes <= 65536 && options.triangle_bytes <= 65536;
}

/// Computes the bytes that an object takes to grow: of the vertices [from, to) of its mesh and of the triangles that
/// `to` vertices have and `from` vertices do not.
/// map: the model's, see Mesh; the mesh's part of it does not decrease. Preconditions: from and to are 0 or in the
/// mesh's range, from <= to.
PGL_HD constexpr std::uint64_t growth_bytes(const Mesh& mesh, const std::uint32_t* map, std::uint32_t from,
                                            std::uint32_t to, const TransferOptions& options) {
  const std::uint64_t triangles = triangles_at(mesh, map, to) - triangles_at(mesh, map, from);
  return std::uint64_t{to - from} * options.vertex_bytes + triangles * options.triangle_bytes;
}

/// The fewest vertices that a new object is drawn with: its minimum, and at least one.
PGL_HD constexpr std::uint32_t first_step(std::uint32_t min_vertices) {
  return min_vertices > 0 ? min_vertices : 1;
}

/// The vertices that the rest of an object's growth begins with: its previous ones, or the first step of a new object.
PGL_HD constexpr std::uint32_t grown_from(std::uint32_t min_vertices, std::uint32_t previous) {
  return previous > 0 ? previous : first_step(min_vertices);
}

/// The bytes of an object's growth: of the first step, 0 for an object that was drawn before, and of the rest up to
/// the wanted count.
struct GrowthCost {
  std::uint64_t first = 0;
  std::uint64_t rest = 0;
  friend constexpr bool operator==(const GrowthCost&, const GrowthCost&) = default;
};

/// Computes what an object that grows costs.
/// Preconditions: previous < wanted; first_step(min_vertices) <= wanted; as for growth_bytes.
PGL_HD constexpr GrowthCost growth_cost(const Mesh& mesh, const std::uint32_t* map, std::uint32_t min_vertices,
                                        std::uint32_t wanted, std::uint32_t previous, const TransferOptions& options) {
  const std::uint32_t from = grown_from(min_vertices, previous);
  return {previous > 0 ? 0 : growth_bytes(mesh, map, 0, from, options), growth_bytes(mesh, map, from, wanted, options)};
}

/// Finds the most vertices, in [from, to], that an object at `from` vertices can grow to with so many bytes.
/// Preconditions: from > 0; as for growth_bytes. O(log(to - from)).
PGL_HD constexpr std::uint32_t affordable_vertices(const Mesh& mesh, const std::uint32_t* map, std::uint32_t from,
                                                   std::uint32_t to, std::uint64_t bytes,
                                                   const TransferOptions& options) {
  std::uint32_t low = from, high = to;
  while (low < high) {
    const std::uint32_t middle = high - (high - low) / 2;  // above low
    if (growth_bytes(mesh, map, from, middle, options) <= bytes)
      low = middle;
    else
      high = middle - 1;
  }
  return low;
}

/// The two cuts that decide. A key of 0 is one that all objects are above.
struct TransferPlan {
  std::uint64_t new_cut = 0;  ///< the key of the first new object that waits
  std::uint64_t cut = 0;      ///< the key of the first object whose growth does not fit
  std::uint64_t room = 0;     ///< the bytes that are left for the object at the cut
};

/// Tells whether an object that grows is drawn, that is, does not wait for its first step.
PGL_HD constexpr bool is_drawn(const TransferPlan& plan, std::uint64_t key, std::uint32_t previous) {
  return previous > 0 || key > plan.new_cut;
}

/// The vertex count that a plan gives an object that grows; key is its weight_key.
/// Preconditions: those of growth_cost.
PGL_HD constexpr std::uint32_t limited_vertices(const TransferPlan& plan, std::uint64_t key, const Mesh& mesh,
                                                const std::uint32_t* map, std::uint32_t min_vertices,
                                                std::uint32_t wanted, std::uint32_t previous,
                                                const TransferOptions& options) {
  if (!is_drawn(plan, key, previous)) return 0;
  if (key > plan.cut) return wanted;
  const std::uint32_t from = grown_from(min_vertices, previous);
  return key < plan.cut ? from : affordable_vertices(mesh, map, from, wanted, plan.room, options);
}

/// Computes the largest step of a mesh, in bytes: the first one, at min_triangles, or the largest of one vertex more.
/// 0 for a mesh without vertices. map: as for growth_bytes. O(vertices).
PGL_HD constexpr std::uint64_t largest_step(const Mesh& mesh, const std::uint32_t* map, std::uint32_t min_triangles,
                                            const TransferOptions& options) {
  if (mesh.max_vertices == 0) return 0;
  const std::uint32_t first = first_step(minimum_vertices(mesh, map, min_triangles));
  std::uint64_t most = growth_bytes(mesh, map, 0, first, options);
  for (std::uint32_t k = first; k < mesh.max_vertices; ++k) {
    const std::uint64_t step = growth_bytes(mesh, map, k, k + 1, options);
    most = step > most ? step : most;
  }
  return most;
}

}  // namespace pgl
