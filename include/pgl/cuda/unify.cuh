// SPDX-License-Identifier: MIT
// Makes the tiles of a picture agree on the vertex count of every object, on the GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/cuda/launch.cuh"
#include "pgl/cuda/totals.cuh"
#include "pgl/unify.hpp"

namespace pgl::cuda {

using pgl::BudgetTotals;

namespace detail {

/// in_tile may be null; totals may be null, or is zero. Not restrict: unified may be a tile's counts.
template <class = void>
__global__ void __launch_bounds__(1024)
    unify_kernel(const std::uint32_t* counts, const std::uint8_t* in_tile, std::uint64_t tiles, UnifyPolicy policy,
                 std::uint32_t* unified, std::uint64_t n, BudgetTotals* totals) {
  OwnTotals own;
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    std::uint32_t key = no_unify_key(policy);
    for (std::uint64_t t = 0; t < tiles; ++t) {
      const std::uint32_t count = counts[t * n + i];
      const bool touches = in_tile == nullptr ? count > 0 : in_tile[t * n + i] != 0;
      key = combined_key(key, unify_key(count, touches, policy), policy);
    }
    const std::uint32_t vertices = unified_vertices(key);
    unified[i] = vertices;
    own.add(vertices);
  }
  if (totals != nullptr) add_totals(own, totals);
}

/// in_tile may be null; totals may be null, or is zero. Not restrict: out may be counts or unified.
template <class = void>
__global__ void __launch_bounds__(1024)
    take_unified_kernel(const std::uint32_t* counts, const std::uint8_t* in_tile, const std::uint32_t* unified,
                        std::uint32_t* out, std::uint64_t n, BudgetTotals* totals) {
  OwnTotals own;
  const std::uint64_t stride = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t i = std::uint64_t{blockIdx.x} * blockDim.x + threadIdx.x; i < n; i += stride) {
    const bool touches = in_tile == nullptr ? counts[i] > 0 : in_tile[i] != 0;
    const std::uint32_t vertices = vertices_in_tile(unified[i], touches);
    out[i] = vertices;
    own.add(vertices);
  }
  if (totals != nullptr) add_totals(own, totals);
}

}  // namespace detail

/// Unifies the counts that tiles selected each on its own, as pgl::host::unify does.
///
/// All views are of device memory; in_tile may be empty. totals: out, on the device, what the host's returns; null if
/// not wanted. O(tiles * n): one kernel, no scratch, and a memset before it where totals are wanted. Enqueued on
/// launch.stream, capturable; the same for any launch.
[[nodiscard]] inline cudaError_t unify(std::span<const std::uint32_t> counts, std::span<const std::uint8_t> in_tile,
                                       std::size_t tiles, UnifyPolicy policy, std::span<std::uint32_t> unified,
                                       BudgetTotals* totals, Launch launch = {}) {
  const std::uint64_t n = unified.size();
  PGL_ASSERT(counts.size() == tiles * n && (in_tile.empty() || in_tile.size() == counts.size()));
  if (totals != nullptr) PGL_CUDA_TRY(cudaMemsetAsync(totals, 0, sizeof(*totals), launch.stream));
  return detail::run(detail::unify_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch, counts.data(),
                     in_tile.empty() ? nullptr : in_tile.data(), std::uint64_t{tiles}, policy, unified.data(), n,
                     totals);
}

/// Fills in what one tile draws of a unified selection, as pgl::host::take_unified does.
///
/// All views are of device memory; in_tile may be empty; out may be the same array as counts or unified. totals: as for
/// unify. O(n): one kernel, no scratch, and a memset before it where totals are wanted. Enqueued on launch.stream,
/// capturable; the same for any launch.
[[nodiscard]] inline cudaError_t take_unified(std::span<const std::uint32_t> counts,
                                              std::span<const std::uint8_t> in_tile,
                                              std::span<const std::uint32_t> unified, std::span<std::uint32_t> out,
                                              BudgetTotals* totals, Launch launch = {}) {
  const std::uint64_t n = out.size();
  PGL_ASSERT(counts.size() == n && unified.size() == n && (in_tile.empty() || in_tile.size() == n));
  if (totals != nullptr) PGL_CUDA_TRY(cudaMemsetAsync(totals, 0, sizeof(*totals), launch.stream));
  return detail::run(detail::take_unified_kernel<>, detail::blocks_for(n, launch.block_threads), 0, launch,
                     counts.data(), in_tile.empty() ? nullptr : in_tile.data(), unified.data(), out.data(), n, totals);
}

}  // namespace pgl::cuda
