// SPDX-License-Identifier: MIT
#include "scene/build_plant.hpp"

#include <cstdint>
#include <utility>
#include <vector>

#include "pgl/host/parallel.hpp"
#include "scene/for_each.hpp"
#include "scene/weld.hpp"

namespace pgl::scene {

AnyModel build_plant(const PlantOptions& options, std::size_t first, std::size_t count, bool weld,
                     const pgl::EcolOptions& ecol, const Progress& progress, BuildReport* report, bool errors) {
  const auto make = [&](std::size_t i, MeshData& mesh) {
    plant_object(options, first + i, mesh);
    if (weld) scene::weld(mesh);
  };
  std::vector<MeshSize> sizes(count);
  std::vector<MeshData> scratch(pgl::host::thread_count());
  for_each(count, progress, "plant", [&](std::size_t i) {
    MeshData& mesh = scratch[pgl::host::thread_index()];
    make(i, mesh);
    sizes[i] = {mesh.positions.size(), mesh.triangles.size()};
  });
  const MeshSource source{count, [&](std::size_t i) { return sizes[i]; }, make};
  std::vector<pgl::Object> objects(count);
  for (std::size_t i = 0; i < count; ++i) objects[i].mesh = static_cast<std::uint32_t>(i);
  return build_any_model(source, std::move(objects), ecol, progress, report, errors);
}

}  // namespace pgl::scene
