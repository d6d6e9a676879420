// SPDX-License-Identifier: MIT
// The plain data that all algorithms share: triangles, boxes, meshes and objects as ranges of the model's arrays.
#pragma once

#include <cstdint>
#include <limits>

#if defined(__CUDACC__)
#include <cuda.h>  // GLM 0.9.9 needs it under nvcc
#pragma nv_diagnostic push
#pragma nv_diag_suppress 20012  // its defaulted functions carry markers that nvcc ignores
#include <glm/glm.hpp>
#pragma nv_diagnostic pop
#else
#include <glm/glm.hpp>
#endif

#include "pgl/config.hpp"

namespace pgl {

/// Three vertex indices, local to the mesh and 0-based; counter-clockwise seen from outside.
/// Index is std::uint16_t (meshes of at most 65536 vertices) or std::uint32_t.
template <class Index>
struct Triangle {
  Index v[3];
  friend constexpr bool operator==(const Triangle&, const Triangle&) = default;
};

/// The `ecol` entry of a vertex that never collapses. Never a real target, since ecol[v] < v.
template <class Index>
inline constexpr Index no_target = static_cast<Index>(~Index{0});

/// An axis-aligned box, both ends included. The empty box has min > max in every axis.
struct Box {
  glm::vec3 min{std::numeric_limits<float>::infinity()};
  glm::vec3 max{-std::numeric_limits<float>::infinity()};
  friend constexpr bool operator==(const Box&, const Box&) = default;
};

/// What one mesh owns in the model's arrays.
///
/// Vertices and ecol: [first_vertex, first_vertex + max_vertices). Triangles: [first_triangle, first_triangle + map at
/// max_vertices). Map: max_vertices - min_vertices + 1 entries from first_map on; entry k - min_vertices is the number
/// of triangles left when the mesh has k vertices.
struct Mesh {
  std::uint64_t first_vertex = 0;
  std::uint64_t first_triangle = 0;
  std::uint64_t first_map = 0;
  std::uint32_t min_vertices = 0;  ///< the coarsest prefix; vertices below it have no target
  std::uint32_t max_vertices = 0;  ///< the full mesh
  friend constexpr bool operator==(const Mesh&, const Mesh&) = default;
};

/// One mesh of many before it is ordered, as build_ecol and rearrange take them in a batch: which part of the arrays of
/// vertices, triangles (indices local to the mesh) and map is its own. Parts of different meshes do not overlap.
struct MeshRange {
  std::uint64_t first_vertex = 0;
  std::uint64_t first_triangle = 0;
  std::uint64_t first_map = 0;  ///< vertices + 1 entries from here on
  std::uint32_t vertices = 0;
  std::uint32_t triangles = 0;
  friend constexpr bool operator==(const MeshRange&, const MeshRange&) = default;
};

/// The number of triangles of a mesh at `vertices` vertices; 0 vertices (not drawn) have none.
/// Precondition: vertices is 0 or in [mesh.min_vertices, mesh.max_vertices].
PGL_HD constexpr std::uint32_t triangles_at(const Mesh& mesh, const std::uint32_t* map, std::uint32_t vertices) {
  return vertices == 0 ? 0u : map[mesh.first_map + (vertices - mesh.min_vertices)];
}

/// The entry of a list of objects that names none of them, and is passed over.
inline constexpr std::uint32_t no_object = 0xffffffffu;

/// A mesh placed in the world by an affine transform: column-major, p -> m[0]*p.x + m[1]*p.y + m[2]*p.z + m[3].
struct Object {
  std::uint32_t mesh = 0;
  glm::mat4x3 transform{1.0f};
  friend bool operator==(const Object&, const Object&) = default;
};

/// Which clip-space depths are inside: OpenGL's -w..w, or 0..w (Direct3D, Vulkan, GL clip control; reversed or not).
enum class DepthRange : std::uint8_t { minus_one_to_one, zero_to_one };

/// Which end of the range of depths is near: the lower one, or, as for reversed depth buffers, the upper one.
enum class DepthOrder : std::uint8_t { conventional, reversed };

/// A camera as the algorithms see it. Clip space as in OpenGL: p inside iff |x| <= w, |y| <= w and z in the range.
struct View {
  glm::mat4 clip_from_world{1.0f};  ///< column-major, column vectors; every entry finite
  float width = 1.0f;               ///< viewport, pixels, > 0
  float height = 1.0f;
  float near_depth = 1e-3f;  ///< depths (clip w) are clamped to at least this, > 0
  DepthRange depth_range = DepthRange::minus_one_to_one;
  DepthOrder depth_order = DepthOrder::conventional;
};

}  // namespace pgl
