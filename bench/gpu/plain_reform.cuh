// SPDX-License-Identifier: MIT
// The peer of reform: one thread per triangle, which searches for its object by itself and follows its chains.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>

#include "pgl/reform.hpp"
#include "pgl/types.hpp"

namespace pgl::bench {

/// [Peng13] Alg 3 as it is printed, with the object found by binary search. Grid-stride over the last offset.
template <class Index>
__global__ void plain_reform(const Mesh* meshes, const Object* objects, const Triangle<Index>* triangles,
                             const Index* ecol, const std::uint32_t* counts, const std::uint64_t* vertex_offsets,
                             const std::uint64_t* triangle_offsets, std::size_t n, Triangle<std::uint32_t>* out) {
  const std::uint64_t total = triangle_offsets[n];
  const std::uint64_t step = std::uint64_t{gridDim.x} * blockDim.x;
  for (std::uint64_t t = blockIdx.x * std::uint64_t{blockDim.x} + threadIdx.x; t < total; t += step) {
    std::size_t low = 0, high = n;  // the last object that starts at t or before
    while (high - low > 1) {
      const std::size_t middle = low + (high - low) / 2;
      (triangle_offsets[middle] <= t ? low : high) = middle;
    }
    const Mesh& mesh = meshes[objects[low].mesh];
    Triangle<Index> reformed = triangles[mesh.first_triangle + (t - triangle_offsets[low])];
    for (Index& v : reformed.v) {
      while (v >= counts[low]) v = ecol[mesh.first_vertex + v];
    }
    out[t] = drawn_triangle<std::uint32_t>(reformed, vertex_offsets[low], mirrored(objects[low].transform));
  }
}

}  // namespace pgl::bench
