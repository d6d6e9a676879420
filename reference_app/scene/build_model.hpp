// SPDX-License-Identifier: MIT
// Preprocesses a scene: collapse order, rearrangement, boxes and compactness of every mesh, on all cores.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <variant>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "pgl/oriented_box.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"
#include "scene/mesh_data.hpp"

namespace pgl::scene {

/// A preprocessed model: what the algorithms of a frame read. Index is std::uint16_t or std::uint32_t.
///
/// meshes[m] owns ranges of vertices, triangles, ecol and map, which follow each other in the order of the meshes
/// without gaps; vertices and triangles of each are in the order of their removal, last first. A mesh of no vertices
/// has one map entry, 0. object_boxes and faces are in the world, mesh_boxes and oriented_boxes in the space of the
/// mesh. compactness_order lists the objects, the most compact first. errors is empty, or has an entry for each of map:
/// the error at that count, in units of the mesh, as pgl::host::build_ecol gives it and select_by_error reads it; a
/// mesh's errors never rise with the count.
template <class Index>
struct Model {
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<glm::vec3> vertices;
  std::vector<pgl::Triangle<Index>> triangles;
  std::vector<Index> ecol;
  std::vector<std::uint32_t> map;
  std::vector<float> errors;
  std::vector<pgl::Box> mesh_boxes;
  std::vector<pgl::Box> object_boxes;
  std::vector<pgl::OrientedBox> oriented_boxes;
  std::vector<float> compactness;  ///< of each mesh
  std::vector<pgl::OccluderFace> faces;
  std::vector<std::uint32_t> compactness_order;
};

using AnyModel = std::variant<Model<std::uint16_t>, Model<std::uint32_t>>;

/// The size of one mesh.
struct MeshSize {
  std::size_t vertices = 0;
  std::size_t triangles = 0;
};

/// Where meshes come from, one at a time, so that a large model need not exist twice.
struct MeshSource {
  std::size_t count = 0;
  /// The exact size of mesh i. Called once or twice for every mesh, on the calling thread.
  std::function<MeshSize(std::size_t)> size;
  /// Writes mesh i, replacing what the argument held. Called once for every mesh, from any thread and in any order.
  std::function<void(std::size_t, MeshData&)> make;
};

/// What preprocessing met, each mesh counted once.
struct BuildReport {
  std::uint64_t open_vertices = 0;  ///< on an edge that only one triangle has: BoundaryRule::locked keeps them in place
};

/// Builds a model from meshes and the objects that place them.
///
/// Every mesh goes through pgl::host::build_ecol (in float), rearrange and oriented_boxes. Meshes are built in
/// parallel, each thread with its own workspace; the result is the same for any number of threads. With `errors` the
/// model has errors beside its map; everything else is the same bits without. Memory: the result, one entry of map (and
/// of errors) per vertex that never collapses, and per thread one mesh and its workspace. `report` may be null.
/// Throws Error when an object names a mesh that is not there, a mesh has too many vertices for Index (65536 or 2^32 -
/// 1), or the source's sizes and meshes disagree; whatever the source or `progress` throws goes through. No meshes and
/// no objects give an empty model. Progress: stages "build" and "boxes", in meshes.
template <class Index>
Model<Index> build_model(const MeshSource& source, std::vector<pgl::Object> objects, const pgl::EcolOptions& options,
                         const Progress& progress = {}, BuildReport* report = nullptr, bool errors = false);

/// The same with the narrowest Index: 16 bits when every mesh has at most 65536 vertices.
AnyModel build_any_model(const MeshSource& source, std::vector<pgl::Object> objects, const pgl::EcolOptions& options,
                         const Progress& progress = {}, BuildReport* report = nullptr, bool errors = false);

/// The same from a scene, whose meshes are given up one by one as they are built.
AnyModel build_any_model(Scene scene, const pgl::EcolOptions& options, const Progress& progress = {},
                         BuildReport* report = nullptr, bool errors = false);

/// Counts the vertices on open edges: edges {a, b}, a != b, that occur once among all corners of all triangles.
/// `scratch` is reused and only grows. Precondition: indices below `vertices`. Linear but for sorting at each vertex.
std::size_t count_open_vertices(std::size_t vertices, const std::vector<pgl::Triangle<std::uint32_t>>& triangles,
                                std::vector<std::uint32_t>& scratch);

}  // namespace pgl::scene
