// SPDX-License-Identifier: MIT
// One frame on the GPU: a row of a thousand rings of one shared mesh, within a budget of 20 thousand vertices.
#include <thrust/device_vector.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include <glm/gtc/matrix_transform.hpp>

#include "pgl/cuda/cull_frustum.cuh"
#include "pgl/cuda/distribute_budget.cuh"
#include "pgl/cuda/gather.cuh"
#include "pgl/cuda/project.cuh"
#include "pgl/cuda/reform.cuh"
#include "pgl/host/bounds.hpp"
#include "pgl/host/build_ecol.hpp"
#include "pgl/host/rearrange.hpp"

using Index = std::uint16_t;  // enough for meshes of 65 thousand vertices
using Triangle = pgl::Triangle<Index>;

namespace {

/// Memory on the GPU as the algorithms take it.
template <class T>
std::span<T> view(thrust::device_vector<T>& values) {
  return {thrust::raw_pointer_cast(values.data()), values.size()};
}
template <class T>
std::span<const T> in(const thrust::device_vector<T>& values) {
  return {thrust::raw_pointer_cast(values.data()), values.size()};
}

/// The mesh in collapse order, as examples/levels.cpp explains it.
struct Ring {
  std::vector<glm::vec3> vertices;
  std::vector<Triangle> triangles;
  std::vector<Index> ecol;
  std::vector<std::uint32_t> map;
  pgl::Mesh mesh;
};

Ring make_ring() {
  std::vector<glm::vec3> positions;
  std::vector<Triangle> input;
  for (int i = 0; i < 64; ++i)
    for (int j = 0; j < 32; ++j) {
      const double u = i * M_PI / 32, v = j * M_PI / 16, r = 1 + 0.4 * std::cos(v);
      positions.emplace_back(r * std::cos(u), r * std::sin(u), 0.4 * std::sin(v));
      const auto at = [](int a, int b) { return static_cast<Index>(a % 64 * 32 + b % 32); };
      input.push_back({{at(i, j), at(i + 1, j), at(i + 1, j + 1)}});
      input.push_back({{at(i, j), at(i + 1, j + 1), at(i, j + 1)}});
    }
  const std::size_t n = positions.size();
  std::vector<Index> ecol(n), place_v(n);
  std::vector<std::uint32_t> place_t(input.size()), levels(n + 1);
  pgl::host::EcolWorkspace<float> workspace;
  const auto least =
      pgl::host::build_ecol<float, Index>(positions, input, {}, {}, workspace, ecol, place_v, place_t, levels, {});
  Ring ring{.vertices = std::vector<glm::vec3>(n), .triangles = input, .ecol = ecol, .map = {}, .mesh = {}};
  pgl::host::rearrange<glm::vec3, Index>(positions, input, ecol, place_v, place_t, ring.vertices, ring.triangles,
                                         ring.ecol);
  ring.map.assign(levels.begin() + least, levels.end());
  ring.mesh = {.min_vertices = least, .max_vertices = static_cast<std::uint32_t>(n)};
  return ring;
}

cudaError_t run() {
  // Once per model: what lies in the GPU's memory from now on.
  const Ring ring = make_ring();
  std::vector<pgl::Object> row(1000);
  for (std::size_t i = 0; i < row.size(); ++i) row[i].transform[3] = glm::vec3(3.0f * float(i), 0, 0);
  const std::size_t n = row.size();
  std::vector<pgl::Box> row_boxes(n);
  pgl::host::object_bounds(row, std::vector{pgl::host::bounds(ring.vertices)}, row_boxes);

  const thrust::device_vector<pgl::Mesh> meshes(1, ring.mesh);
  const thrust::device_vector<pgl::Object> objects = row;
  const thrust::device_vector<pgl::Box> boxes = row_boxes;
  const thrust::device_vector<glm::vec3> vertices = ring.vertices;
  const thrust::device_vector<Triangle> triangles = ring.triangles;
  const thrust::device_vector<Index> ecol = ring.ecol;
  const thrust::device_vector<std::uint32_t> map = ring.map, mesh_of_object(n, 0);
  thrust::device_vector<std::uint32_t> min_vertices(n), max_vertices(n), counts(n), triangle_counts(n);
  thrust::device_vector<std::uint8_t> in_view(n);
  thrust::device_vector<float> areas(n), depths(n);
  thrust::device_vector<std::uint64_t> vertex_offsets(n + 1), triangle_offsets(n + 1);
  thrust::device_vector<pgl::BudgetTotals> totals(1);
  pgl::cuda::BudgetWorkspace budget_workspace;
  pgl::cuda::ScanWorkspace scan_workspace;
  pgl::cuda::ReformWorkspace<Index> reform_workspace;
  PGL_CUDA_TRY(pgl::cuda::vertex_limits(in(mesh_of_object), in(meshes), in(map), 20, view(min_vertices),
                                        view(max_vertices)));  // at least 20 triangles each

  // Every frame: only enqueued, on the stream that each call takes last.
  pgl::View camera;
  camera.width = 1280, camera.height = 720, camera.near_depth = 0.1f;
  camera.clip_from_world = glm::perspective(1.0f, camera.width / camera.height, camera.near_depth, 1e4f) *
                           glm::lookAt(glm::vec3(-4, -3, 2), glm::vec3(30, 0, 0), glm::vec3(0, 0, 1));
  pgl::BudgetOptions options;
  options.budget = 20000;
  options.near_depth = camera.near_depth;
  PGL_CUDA_TRY(pgl::cuda::cull_frustum(in(boxes), camera, view(in_view)));
  PGL_CUDA_TRY(pgl::cuda::project(in(boxes), in(in_view), camera, view(areas), view(depths)));
  PGL_CUDA_TRY(pgl::cuda::distribute_budget(in(areas), in(depths), in(min_vertices), in(max_vertices), options,
                                            budget_workspace, view(counts), totals.data().get()));
  PGL_CUDA_TRY(pgl::cuda::lay_out(in(counts), in(mesh_of_object), in(meshes), in(map), view(triangle_counts),
                                  view(vertex_offsets), view(triangle_offsets), scan_workspace));
  const std::uint64_t triangles_drawn = triangle_offsets.back();  // waits: how large the buffers must be
  thrust::device_vector<glm::vec3> vertex_buffer(options.budget);
  thrust::device_vector<pgl::Triangle<std::uint32_t>> index_buffer(triangles_drawn);
  PGL_CUDA_TRY(
      pgl::cuda::gather(in(meshes), in(objects), in(vertices), in(counts), in(vertex_offsets), view(vertex_buffer)));
  PGL_CUDA_TRY(pgl::cuda::reform(in(meshes), in(objects), in(triangles), in(ecol), in(counts), in(vertex_offsets),
                                 in(triangle_offsets), reform_workspace, view(index_buffer)));
  PGL_CUDA_TRY(cudaDeviceSynchronize());

  const pgl::BudgetTotals drawn = totals.front();
  std::printf("%llu of %zu objects, %llu vertices, %zu triangles in one draw call\n",
              static_cast<unsigned long long>(drawn.objects), n, static_cast<unsigned long long>(drawn.vertices),
              index_buffer.size());
  const std::uint32_t first = counts[0], hundredth = counts[99], last = counts[n - 1];
  std::printf("the first ring has %u vertices, the hundredth %u, the last %u\n", first, hundredth, last);
  return drawn.vertices <= options.budget ? cudaSuccess : cudaErrorUnknown;
}

}  // namespace

int main() {
  int devices = 0;
  if (cudaGetDeviceCount(&devices) != cudaSuccess || devices == 0) {
    std::puts("SKIPPED: no GPU here");
    return 0;
  }
  const cudaError_t error = run();
  if (error != cudaSuccess) std::printf("CUDA: %s\n", cudaGetErrorString(error));
  return error == cudaSuccess ? 0 : 1;
}
