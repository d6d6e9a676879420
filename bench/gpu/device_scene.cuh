// SPDX-License-Identifier: MIT
// The plant on the device.
#pragma once

#include <cstdint>

#include "bench.cuh"
#include "host_frame.hpp"

namespace pgl::bench {

/// What every frame reads, on the device.
struct DeviceScene {
  using Index = std::uint16_t;

  DeviceScene(const Bench& bench, const Scene& s)
      : meshes(bench.upload(s.meshes)),
        objects(bench.upload(s.objects)),
        mesh_of_object(bench.upload(s.mesh_of_object)),
        min_vertices(bench.upload(s.min_vertices)),
        max_vertices(bench.upload(s.max_vertices)),
        boxes(bench.upload(s.boxes)),
        vertices(bench.upload(s.vertices)),
        triangles(bench.upload(s.triangles)),
        ecol(bench.upload(s.ecol)),
        map(bench.upload(s.map)) {}
  DeviceArray<Mesh> meshes;
  DeviceArray<Object> objects;
  DeviceArray<std::uint32_t> mesh_of_object, min_vertices, max_vertices;
  DeviceArray<Box> boxes;
  DeviceArray<glm::vec3> vertices;
  DeviceArray<Triangle<Index>> triangles;
  DeviceArray<Index> ecol;
  DeviceArray<std::uint32_t> map;
};

}  // namespace pgl::bench
