// SPDX-License-Identifier: MIT
// Adds up what the threads of a grid selected.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>

#include "pgl/distribute_budget.hpp"

namespace pgl::cuda::detail {

/// What a thread selected: the two sums of BudgetTotals.
struct OwnTotals {
  unsigned long long sums[2] = {0, 0};
  __device__ void add(std::uint32_t vertices) {
    sums[0] += vertices > 0 ? 1 : 0;
    sums[1] += vertices;
  }
};

/// Adds every thread's own totals to `totals`, which must be zero before the kernel: integers, whose order does not
/// show. All threads of the block must call it, once, in whole warps.
__device__ inline void add_totals(OwnTotals own, BudgetTotals* totals) {
  using Sum = unsigned long long;
  static_assert(offsetof(BudgetTotals, objects) == 0 && offsetof(BudgetTotals, vertices) == sizeof(Sum) &&
                sizeof(BudgetTotals) == 2 * sizeof(Sum));
  __shared__ Sum of_block[2];
  if (threadIdx.x < 2) of_block[threadIdx.x] = 0;
  __syncthreads();
  for (int i = 0; i < 2; ++i) {
    Sum sum = own.sums[i];
    for (int offset = 16; offset > 0; offset /= 2) sum += __shfl_down_sync(0xffffffffu, sum, offset);
    if (threadIdx.x % 32 == 0 && sum > 0) atomicAdd(&of_block[i], sum);
  }
  __syncthreads();
  if (threadIdx.x < 2 && of_block[threadIdx.x] > 0)
    atomicAdd(reinterpret_cast<Sum*>(totals) + threadIdx.x, of_block[threadIdx.x]);
}

}  // namespace pgl::cuda::detail
