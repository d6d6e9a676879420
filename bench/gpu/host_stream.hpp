// SPDX-License-Identifier: MIT
// Streaming the plant on the host: selections along a path, the blocks of two of them, and the steps from one to the
// other; what the device must equal, and what it is timed against.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "host_frame.hpp"
#include "pgl/distribute_budget.hpp"
#include "pgl/gather.hpp"
#include "pgl/limit_transfer.hpp"
#include "pgl/types.hpp"
#include "plant.hpp"

namespace pgl::bench {

/// Where the plant is looked at from, on a picture of 1280 by 720.
class Cameras {
 public:
  Cameras(const Scene& scene, std::size_t objects);

  /// The overview of Scene::view, its camera moved so far to the side; the target stays.
  View overview(double metres_aside) const;

  /// In flight along a street in the midst of the plant, so far from its middle, 8 m above the ground, looking from
  /// side to side.
  View flight(double metres) const;

 private:
  Box all_;
  std::size_t objects_;
};

/// The options for a view, which sets near_depth and viewport_area.
BudgetOptions options_for(BudgetOptions options, const View& view);

/// What is drawn from a view.
struct Selection {
  std::vector<float> areas, depths;
  std::vector<std::uint32_t> counts, triangle_counts;
  std::vector<std::uint64_t> vertex_offsets, triangle_offsets;
  std::uint64_t vertices() const { return vertex_offsets.back(); }
  std::uint64_t triangles() const { return triangle_offsets.back(); }
};

/// Selects as HostFrame does.
class Selector {
 public:
  explicit Selector(const Scene& scene);
  void select(const View& view, const BudgetOptions& options, Selection& out);

  /// Reduces the counts of `wanted` to what a transfer from `previous` may take; the rest of it stays.
  TransferTotals limit(const Selection& wanted, const Selection& previous, const BudgetOptions& options,
                       const TransferOptions& transfer, std::span<std::uint32_t> counts);
  void lay_out(Selection& selection) const;

 private:
  struct Workspaces;  // the drivers' headers stay out of device code
  const Scene& scene_;
  std::vector<std::uint8_t> in_view_;
  std::shared_ptr<Workspaces> workspaces_;
};

/// Elements of the objects of a selection that another one lacks.
std::uint64_t new_elements(std::span<const std::uint64_t> previous_offsets, std::span<const std::uint64_t> offsets);

/// Two selections, the second from a camera moved so far that about `share` of its vertices are new.
struct SelectionPair {
  View view_a, view_b;
  BudgetOptions options_a, options_b;
  Selection a, b;
  double metres = 0;  ///< that the camera was moved
};
SelectionPair make_pair(const Scene& scene, const Cameras& cameras, const BudgetOptions& options, double share);

/// Two selections in which every object shows a few elements, as many as `vertices` and `triangles` together give on
/// average, no matter what its mesh needs at least: half of the objects change their counts by up to a third, so that
/// about 4 % is new. What defragment finds hardest: as many pieces as there can be. Only counts and offsets are there.
SelectionPair make_spread_pair(const Scene& scene, std::uint64_t vertices, std::uint64_t triangles);

/// The blocks of two selections, a and b, of vertices or triangles, and what leads from a to b (forth) and back.
template <class T>
struct HostBlocks {
  std::span<const std::uint64_t> a_offsets, b_offsets;
  std::vector<std::uint64_t> forth_delta, back_delta;
  std::vector<T> a, b, forth_new, back_new;
  std::vector<T> out;    ///< what defragment writes
  std::vector<T> block;  ///< what in_place works in; a before and after

  void lay_out_delta();  ///< forth
  void defragment();     ///< from a to out
  void forth();          ///< in place
  void back();           ///< in place

  std::uint64_t moved() const;  ///< elements that are somewhere else in b than they were in a
  std::uint64_t new_size() const { return forth_delta.back(); }

  struct Workspace;
  std::shared_ptr<Workspace> workspace{};
};

HostBlocks<glm::vec3> vertex_blocks(const Scene& scene, const SelectionPair& pair);
HostBlocks<Triangle<std::uint16_t>> triangle_blocks(const Scene& scene, const SelectionPair& pair);
HostBlocks<Triangle<std::uint32_t>> widened(const HostBlocks<Triangle<std::uint16_t>>& blocks);

/// A frame from the blocks, step by step, forth to b or back to a.
struct HostStreamFrame {
  HostStreamFrame(const Scene& scene, const SelectionPair& pair, HostBlocks<glm::vec3>& vertices,
                  HostBlocks<Triangle<std::uint16_t>>& triangles);

  void limit(std::uint64_t cap);  ///< forth; writes limited and totals
  void gather();                  ///< of b
  void reform();                  ///< of b
  void forth();
  void back();

  const Scene& scene;
  const SelectionPair& pair;
  HostBlocks<glm::vec3>& vertices;
  HostBlocks<Triangle<std::uint16_t>>& triangles;
  std::vector<std::uint32_t> limited;
  TransferTotals totals;
  std::vector<PlacedVertex> drawn_a, drawn_b;
  std::vector<Triangle<std::uint32_t>> reformed_a, reformed_b;

 private:
  void frame(bool to_b);

  Selector selector_;
  Selection next_;
  std::vector<std::uint64_t> vertex_delta_, triangle_delta_;
  struct Workspaces;
  std::shared_ptr<Workspaces> workspaces_;
};

/// What a path does to the bus, frame by frame: the selection before and the present one, and what is new in it.
class HostPath {
 public:
  HostPath(const Scene& scene, std::size_t objects);

  /// Takes over offsets, as the device or a Selector found them, as those of the next frame.
  void next(std::span<const std::uint64_t> vertex_offsets, std::span<const std::uint64_t> triangle_offsets);

  /// What is new, packed into memory with room enough.
  void collect(glm::vec3* vertices, Triangle<std::uint16_t>* triangles);

  /// The whole selection, packed.
  void collect_all(glm::vec3* vertices, Triangle<std::uint16_t>* triangles);

  std::uint64_t new_vertices() const { return vertex_delta.back(); }
  std::uint64_t new_triangles() const { return triangle_delta.back(); }

  const Scene& scene;
  Cameras cameras;
  std::vector<std::uint64_t> previous_vertex_offsets, previous_triangle_offsets;
  std::vector<std::uint64_t> vertex_offsets, triangle_offsets, vertex_delta, triangle_delta;

 private:
  std::vector<std::uint64_t> nothing_;
};

}  // namespace pgl::bench
