// SPDX-License-Identifier: MIT
// Calls the rules from a kernel, so that their device code is compiled and not only parsed.
#include <cstdint>

#include "pgl/balance.hpp"
#include "pgl/bounds.hpp"
#include "pgl/build_ecol.hpp"
#include "pgl/build_hzm.hpp"
#include "pgl/cull_frustum.hpp"
#include "pgl/cull_occluded.hpp"
#include "pgl/defragment.hpp"
#include "pgl/depth.hpp"
#include "pgl/distribute_budget.hpp"
#include "pgl/gather.hpp"
#include "pgl/ieee.hpp"
#include "pgl/limit_transfer.hpp"
#include "pgl/oriented_box.hpp"
#include "pgl/pack_delta.hpp"
#include "pgl/project.hpp"
#include "pgl/rasterize_depth.hpp"
#include "pgl/rearrange.hpp"
#include "pgl/reform.hpp"
#include "pgl/select_by_error.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"
#include "pgl/unify.hpp"

namespace ieee = pgl::ieee;

template <class T>
__device__ T all_of_ieee(T a, T b, T c) {
  T r = ieee::add(ieee::mul(a, b), ieee::sub(c, ieee::div(a, b)));
  r = ieee::add(r, ieee::fma(a, b, ieee::sqrt(c)));
  r = ieee::add(r, ieee::pow(ieee::exp2(a), ieee::log2(b)));
  r = ieee::add(r, ieee::next_up(ieee::min(a, ieee::next_down(ieee::max(b, c)))));
  r = ieee::add(r, ieee::is_finite(r) ? ieee::infinity<T> : ieee::quiet_nan<T>);
  return ieee::from_bits<T>(ieee::to_bits(r) ^ ieee::order_key(r));
}

__global__ void ieee_kernel(float* floats, double* doubles) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  floats[i] = all_of_ieee(floats[i], floats[i + 1], floats[i + 2]);
  doubles[i] = all_of_ieee(doubles[i], doubles[i + 1], doubles[i + 2]);
  floats[i] = ieee::add(floats[i], ieee::to_float(doubles[i]));
}

__global__ void object_kernel(const pgl::Object* objects, const pgl::Box* boxes, pgl::View view,
                              pgl::BudgetOptions options, pgl::ScreenBox* rectangles, float* weights,
                              std::uint32_t* shares) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  const pgl::Box box = pgl::transform(boxes[objects[i].mesh], objects[i].transform);
  rectangles[i] = pgl::in_frustum(box, view) ? pgl::project(box, view) : pgl::ScreenBox{};
  weights[i] = pgl::log_weight(pgl::projected_area(rectangles[i]), rectangles[i].depth, 4, 400, options);
  shares[i] = pgl::share_weight(weights[i], weights[0], options.alpha);
  shares[i] = pgl::level_vertices(pgl::budget_level(i % pgl::budget_levels), shares[i], 4, 400);
  shares[i] += pgl::mirrored(objects[i].transform) ? 1u : 0u;
}

__global__ void transfer_kernel(const pgl::Mesh* meshes, const std::uint32_t* map, const std::uint32_t* wanted,
                                const std::uint32_t* previous, pgl::TransferOptions options, pgl::TransferPlan plan,
                                std::uint64_t* bytes, std::uint32_t* counts) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  const pgl::GrowthCost cost = pgl::growth_cost(meshes[i], map, 4, wanted[i], previous[i], options);
  bytes[i] = cost.first + cost.rest + pgl::largest_step(meshes[i], map, 4, options);
  const std::uint64_t key = pgl::weight_key(1.0f, i);
  counts[i] = pgl::limited_vertices(plan, key, meshes[i], map, 4, wanted[i], previous[i], options);
  counts[i] += pgl::is_drawn(plan, key, previous[i]) && pgl::is_valid(options) ? 1u : 0u;
}

__global__ void error_kernel(const pgl::Object* objects, const pgl::Mesh* meshes, const float* errors, pgl::View view,
                             pgl::ErrorOptions options, float* scales, std::uint32_t* counts) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  const pgl::ErrorView error_view = pgl::error_view_of(view, options);
  scales[i] = ieee::add(pgl::error_scale(objects[i].transform), pgl::pixels_per_unit(view));
  counts[i] = pgl::is_seen(scales[i], 1.0f, error_view)
                  ? pgl::vertices_by_error(1.0f, 4, 400, scales[i], meshes[i], errors, error_view)
                  : 0;
  const pgl::UnifyPolicy policy = i % 2 == 0 ? pgl::UnifyPolicy::quality : pgl::UnifyPolicy::performance;
  const std::uint32_t key =
      pgl::combined_key(pgl::no_unify_key(policy), pgl::unify_key(counts[i], i % 3 == 0, policy), policy);
  counts[i] = pgl::vertices_in_tile(pgl::unified_vertices(key), i % 3 == 0);
}

__global__ void occluder_kernel(const pgl::Object* objects, const pgl::OrientedBox* boxes, pgl::View view,
                                std::uint64_t* keys) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  const pgl::OccluderFace face = pgl::occluder_face(boxes[objects[i].mesh], 1.0f, objects[i].transform);
  keys[i] = pgl::occluder_key(pgl::occluder_weight(face, pgl::eye_of(view)), i);
  keys[i] += pgl::compactness_key(face.compactness) + (pgl::surface_area(boxes[i]) > 0.0 ? 1u : 0u);
}

__global__ void occlusion_kernel(const pgl::Box* boxes, const glm::vec3* points, pgl::View view, pgl::DepthMap size,
                                 pgl::Depth* texels, std::uint8_t* hidden) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  const pgl::DepthView depth_view = pgl::depth_view_of(view, size);
  pgl::ClipVertex corners[3];
  pgl::DepthVertex placed[3];
  for (int k = 0; k < 3; ++k) {
    corners[k] = pgl::clip_vertex(depth_view, points[3 * i + k]);
    placed[k] = pgl::depth_vertex(depth_view, corners[k]);
  }
  pgl::DepthTriangle drawn[2];
  int count = 1;
  if (pgl::is_drawable(placed[0]))
    drawn[0] = pgl::depth_triangle(depth_view, placed[0], placed[1], placed[2]);
  else
    count = pgl::cut_depth_triangle(depth_view, corners, drawn);
  if (count > 0 && drawn[0].columns > 0) {
    const pgl::DepthSpan span = pgl::covered_span(drawn[0], 0);
    if (span.first < span.end && pgl::covers(drawn[0], span.first, 0))
      texels[i] = pgl::depth_at(drawn[0], span.first, 0);
  }
  const pgl::HzmLevel level = pgl::hzm_level(size, 1);
  texels[level.offset + i] = pgl::texel_above(texels, size.width, size.height, i % level.width, i / level.width);
  hidden[i] = pgl::is_hidden(boxes[i], view, pgl::hzm_of(size, texels), 1) ? 1 : 0;
}

__global__ void delta_kernel(const std::uint64_t* previous_offsets, const std::uint64_t* offsets, std::uint64_t n,
                             pgl::KeptPart* parts, pgl::TicketRange* waits) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  const pgl::KeptPart kept = pgl::kept_part(previous_offsets, offsets, i);
  parts[i] = pgl::part_within(kept, kept.to, kept.to + pgl::delta_part(previous_offsets, offsets, i).size);
  parts[i].size += pgl::moves(kept, pgl::Shift::right) ? 1 : 0;
  waits[i] = pgl::tickets_before_write(previous_offsets, offsets, n, 100, i);
}

__global__ void balance_kernel(const pgl::ScreenBox* rectangles, const std::uint32_t* weights,
                               pgl::BalanceOptions options, pgl::LoadSums sums, pgl::TileNode* nodes,
                               std::uint8_t* flags) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  const pgl::TileBins bins = pgl::tile_bins(nodes[i], options);
  const pgl::SplitLoads node_weights = pgl::split_weights(nodes[i], weights);
  std::uint32_t first = 0, last = pgl::unloaded_cut(bins, node_weights);
  if (pgl::touched_bins(pgl::touched_pixels(rectangles[i], 1920, 1080), bins, first, last))
    last = pgl::bisected_border(sums, bins.count, node_weights, options.threshold);
  const pgl::SplitCost a = pgl::split_cost(sums.at(first), node_weights);
  const pgl::SplitCost b = pgl::split_cost(sums.at(last), node_weights);
  const bool better = pgl::is_valid(options) && pgl::is_better(a, first, b, last);
  nodes[i] = pgl::halves(nodes[i], bins, pgl::bin_begin(bins, better ? first : last)).left;
  flags[i] = pgl::is_in_tile(rectangles[i], 1, nodes[i].tile) && pgl::is_balanced(a, 0.1f) ? 1 : 0;
}

__global__ void vertex_kernel(const pgl::Object* objects, const glm::vec3* vertices, const std::uint32_t* ecol,
                              const pgl::Triangle<std::uint32_t>* triangles, pgl::PlacedVertex* placed,
                              pgl::Triangle<std::uint32_t>* out, std::uint32_t count) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  pgl::place(objects[0], 0, vertices[i], placed[i]);
  pgl::Triangle<std::uint32_t> t = pgl::rearranged_triangle(triangles[i], ecol);
  std::uint64_t steps = 1u << 10;
  for (std::uint32_t& v : t.v) v = pgl::follow_collapses(ecol, count, v, steps);
  out[i] = pgl::drawn_triangle<std::uint32_t>(t, i, pgl::mirrored(objects[0].transform));
}

template <class Real>
__device__ Real cost(const glm::vec3* vertices, const pgl::Box& box) {
  const pgl::Normalisation n = pgl::normalisation(box);
  const auto a = pgl::normalise<Real>(vertices[0], n), b = pgl::normalise<Real>(vertices[1], n),
             c = pgl::normalise<Real>(vertices[2], n);
  pgl::Quadric<Real> quadric{};
  pgl::add_plane(quadric, pgl::direction(pgl::triangle_normal(a, b, c)), Real(1));
  return pgl::evaluate(quadric, pgl::difference(a, b));
}

__global__ void cost_kernel(const glm::vec3* vertices, const pgl::Box* boxes, double* costs) {
  const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
  costs[i] = ieee::add(cost<double>(vertices + i, boxes[i]), static_cast<double>(cost<float>(vertices + i, boxes[i])));
}
