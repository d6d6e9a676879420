// SPDX-License-Identifier: MIT
// The plant at any size and seed.

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <string>

#include "scene/plant.hpp"
#include "support/surface.hpp"

namespace {

using namespace pgl::scene;

PlantOptions any_plant(std::size_t most) {
  const std::size_t scale = *rc::gen::element<std::size_t>(1, 10, 1000, most);
  const auto objects = *rc::gen::inRange<std::size_t>(1, std::min(scale, most) + 1);
  return {objects, *rc::gen::arbitrary<std::uint64_t>()};
}

}  // namespace

RC_GTEST_PROP(PlantProps, everyObjectIsSound, ()) {
  const PlantOptions options = any_plant(718000);
  MeshData mesh;
  for (int k = 0; k < 10; ++k) {
    const auto i = *rc::gen::inRange<std::size_t>(0, options.objects);
    plant_object(options, i, mesh);
    const support::SurfaceFacts facts = support::surface_facts(mesh.positions, mesh.triangles);
    if (k == 0) RC_TAG(std::string(plant_kind_name(plant_kind(options, i))));
    RC_ASSERT(facts.in_range && facts.finite);
    RC_ASSERT(facts.degenerate + facts.repeated_edges + facts.pinched + facts.unused + facts.repeated == 0u);
    RC_ASSERT((facts.open_edges == 0) == plant_is_closed(options, i));
    RC_ASSERT(facts.open_edges > 0 || facts.inside_out == 0);
    RC_ASSERT(mesh.triangles.size() >= 1u && mesh.triangles.size() <= 30000u);
    RC_ASSERT(plant_object_size(options, i) == (PlantSize{mesh.positions.size(), mesh.triangles.size()}));
    const pgl::Box box = plant_box({std::max<std::size_t>(options.objects, 10000), options.seed});
    if (options.objects >= 10000)
      for (const glm::vec3& p : mesh.positions)
        RC_ASSERT(glm::all(glm::lessThanEqual(box.min, p)) && glm::all(glm::lessThanEqual(p, box.max)));
  }
}

RC_GTEST_PROP(PlantProps, sizeIsTheSumOfItsObjects, ()) {
  const PlantOptions options = any_plant(60000);
  PlantSize sum;
  for (std::size_t i = 0; i < options.objects; ++i) {
    const PlantSize size = plant_object_size(options, i);
    sum.vertices += size.vertices;
    sum.triangles += size.triangles;
  }
  RC_ASSERT(plant_size(options) == sum);
}

RC_GTEST_PROP(PlantProps, aLargerPlantBeginsWithTheSameObjects, ()) {
  const PlantOptions small = any_plant(718000);
  const PlantOptions large{small.objects + *rc::gen::inRange<std::size_t>(0, 718000), small.seed};
  const auto i = *rc::gen::inRange<std::size_t>(0, small.objects);
  MeshData a, b;
  plant_object(small, i, a);
  plant_object(large, i, b);
  RC_ASSERT(plant_kind(small, i) == plant_kind(large, i));
  RC_ASSERT(a.triangles == b.triangles);
  RC_ASSERT(a.positions.size() == b.positions.size());
}

RC_GTEST_PROP(PlantProps, sameOptionsGiveTheSameBytes, ()) {
  const PlantOptions options = any_plant(718000);
  const auto i = *rc::gen::inRange<std::size_t>(0, options.objects);
  MeshData a, b;
  plant_object(options, *rc::gen::inRange<std::size_t>(0, options.objects), b);
  plant_object(options, i, a);
  plant_object(options, i, b);
  RC_ASSERT(a.triangles == b.triangles);
  RC_ASSERT(a.positions == b.positions);
}
