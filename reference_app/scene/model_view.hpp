// SPDX-License-Identifier: MIT
// The arrays of a preprocessed model, wherever they are: in memory, or in a mapped file.
#pragma once

#include <cstdint>
#include <span>

#include "pgl/oriented_box.hpp"
#include "pgl/select_occluders.hpp"
#include "pgl/types.hpp"
#include "scene/build_model.hpp"

namespace pgl::scene {

/// What Model has, array by array, without owning any of it.
template <class Index>
struct ModelView {
  ModelView() = default;
  ModelView(
      const Model<Index>& model)  // NOLINT(google-explicit-constructor): a model is meant to be passed as its view
      : meshes(model.meshes),
        objects(model.objects),
        vertices(model.vertices),
        triangles(model.triangles),
        ecol(model.ecol),
        map(model.map),
        errors(model.errors),
        mesh_boxes(model.mesh_boxes),
        object_boxes(model.object_boxes),
        oriented_boxes(model.oriented_boxes),
        compactness(model.compactness),
        faces(model.faces),
        compactness_order(model.compactness_order) {}

  std::span<const pgl::Mesh> meshes;
  std::span<const pgl::Object> objects;
  std::span<const glm::vec3> vertices;
  std::span<const pgl::Triangle<Index>> triangles;
  std::span<const Index> ecol;
  std::span<const std::uint32_t> map;
  std::span<const float> errors;
  std::span<const pgl::Box> mesh_boxes;
  std::span<const pgl::Box> object_boxes;
  std::span<const pgl::OrientedBox> oriented_boxes;
  std::span<const float> compactness;
  std::span<const pgl::OccluderFace> faces;
  std::span<const std::uint32_t> compactness_order;
};

}  // namespace pgl::scene
