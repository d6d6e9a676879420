// SPDX-License-Identifier: MIT
// The CPU as a backend of the frame.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <tuple>
#include <type_traits>
#include <vector>

#include "pgl/host/balance.hpp"
#include "pgl/host/block_stream.hpp"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/gather.hpp"
#include "pgl/host/keep_flagged.hpp"
#include "pgl/host/limit_transfer.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/reform.hpp"
#include "pgl/host/select_by_error.hpp"
#include "pgl/host/select_occluders.hpp"
#include "pgl/host/unify.hpp"
#include "viewer/buffers.hpp"
#include "viewer/frame.hpp"

namespace pgl::viewer {

/// What Frame needs of a backend, on the CPU: the model is read where it is, frames are uploaded.
class HostBackend {
 public:
  template <class T>
  using Input = std::span<const T>;
  template <class T>
  using Array = std::vector<T>;
  using OccluderWorkspace = host::OccluderWorkspace;
  using DepthWorkspace = host::DepthWorkspace;
  using BudgetWorkspace = host::BudgetWorkspace;
  using TransferWorkspace = host::TransferWorkspace;
  using BalanceWorkspace = host::BalanceWorkspace;
  template <class Index>
  using BlockStream = host::BlockStream<glm::vec3, Index>;
  static constexpr bool copies = false;
  template <class Index>
  using ReformWorkspace = host::ReformWorkspace<Index>;

  explicit HostBackend(DrawBuffers& buffers) : buffers_(buffers) {}

  template <class Index>
  void reserve(ReformWorkspace<Index>&, std::size_t, std::uint32_t) {}

  void vertex_limits(auto&&... arguments) { host::vertex_limits(arguments...); }
  void cull_frustum(auto&&... arguments) { host::cull_frustum(arguments...); }
  void select_occluders(auto&&... arguments) { host::select_occluders(arguments...); }
  void keep_flagged(auto&&... arguments) { host::keep_flagged(arguments...); }
  void clear(std::span<Depth> depths) { std::ranges::fill(depths, far_depth); }
  void rasterize_depth(auto&&... arguments) { host::rasterize_depth(arguments...); }
  void build_hzm(auto&&... arguments) { host::build_hzm(arguments...); }
  void cull_occluded(auto&&... arguments) { host::cull_occluded(arguments...); }
  void project(auto&&... arguments) { host::project(arguments...); }
  void distribute_budget(auto&& areas, auto&& depths, auto&& min_vertices, auto&& max_vertices, auto&& options,
                         auto&& workspace, auto&& counts, BudgetTotals* totals) {
    *totals = host::distribute_budget(areas, depths, min_vertices, max_vertices, options, workspace, counts);
  }
  void error_scales(auto&&... arguments) { host::error_scales(arguments...); }
  void select_by_error(auto&& areas, auto&& depths, auto&& min_vertices, auto&& max_vertices, auto&& scales,
                       auto&& mesh_of_object, auto&& meshes, auto&& errors, auto&& view, auto&& options, auto&& counts,
                       BudgetTotals* totals) {
    *totals = host::select_by_error(areas, depths, min_vertices, max_vertices, scales, mesh_of_object, meshes, errors,
                                    view, options, counts);
  }
  void balance(auto&&... arguments) { host::balance(arguments...); }
  void in_tile(auto&& rectangles, auto&& loads, const Tile* tile, auto&& flags) {
    host::in_tile(rectangles, loads, *tile, flags);
  }
  void take_unified(auto&& counts, auto&& in_tile, auto&& unified, auto&& out, BudgetTotals* totals) {
    *totals = host::take_unified(counts, in_tile, unified, out);
  }
  void lay_out(auto&&... arguments) { host::lay_out(arguments...); }
  void limit_transfer(auto&& areas, auto&& depths, auto&& min_vertices, auto&& max_vertices, auto&& weight,
                      auto&& wanted, auto&& previous, auto&& mesh_of_object, auto&& meshes, auto&& map, auto&& options,
                      auto&& workspace, auto&& counts, TransferTotals* totals) {
    *totals = host::limit_transfer(areas, depths, min_vertices, max_vertices, weight, wanted, previous, mesh_of_object,
                                   meshes, map, options, workspace, counts);
  }
  void reform(auto&&... arguments) { host::reform(arguments...); }
  void gather(auto&&... arguments) { host::gather(arguments...); }
  void reform_block(auto&&... arguments) { host::reform_block(arguments...); }
  void gather_block(auto&&... arguments) { host::gather_block(arguments...); }
  void finish() {}

  template <class Index>
  void reserve(BlockStream<Index>& stream, std::size_t objects, std::uint64_t vertices, std::uint64_t triangles,
               std::uint64_t) {
    stream.reserve(objects, vertices, triangles);
  }
  void begin(auto& stream, auto&&... arguments) { stream.begin(arguments...); }
  DeltaSize send(auto& stream, auto&&... arguments) { return stream.send(arguments...); }
  void apply(auto& stream) { stream.apply(); }
  std::uint64_t memory_used() const { return 0; }
  static std::optional<std::uint64_t> memory_free() { return {}; }
  void prepare_drawing(std::size_t, std::size_t) {}

  template <class... T>
  std::tuple<T...> fetch(const T*... values) {
    return {*values...};
  }
  template <class T>
  std::vector<std::remove_const_t<T>> download(std::span<T> values) {
    return {values.begin(), values.end()};
  }
  template <class T>
  void upload(std::span<const T> values, std::span<T> to) {
    std::ranges::copy(values, to.begin());
  }

  auto begin_drawing(std::size_t vertices, std::size_t triangles) {
    if (vertices_.size() < vertices) vertices_.resize(vertices);
    if (triangles_.size() < triangles) triangles_.resize(triangles);
    drawn_vertices_ = std::span(vertices_).first(vertices);
    drawn_triangles_ = std::span(triangles_).first(triangles);
    return std::tuple(drawn_vertices_, drawn_triangles_);
  }
  void end_drawing() { buffers_.upload(drawn_vertices_, drawn_triangles_); }

  BackendInfo info() const { return {.name = "host", .gpu = {}, .interop = false, .note = {}}; }

 private:
  DrawBuffers& buffers_;
  std::vector<PlacedVertex> vertices_;
  std::vector<Triangle<std::uint32_t>> triangles_;
  std::span<PlacedVertex> drawn_vertices_;
  std::span<Triangle<std::uint32_t>> drawn_triangles_;
};

}  // namespace pgl::viewer
