// SPDX-License-Identifier: MIT
// Preprocesses the built-in plant, as a whole or in parts.
#pragma once

#include <cstddef>

#include "scene/build_model.hpp"
#include "scene/plant.hpp"

namespace pgl::scene {

/// Preprocesses `count` objects of the plant from `first` on; object i of the result is object first + i of the plant,
/// placed by the identity, with mesh i.
///
/// The objects never exist together before that: each is made twice, to be counted and to be kept. Their faces come
/// unstitched, as those of real models do; `weld` stitches them. Stages of progress: "plant", then build_model's;
/// `report` and `errors` are build_model's too.
/// Precondition: first + count <= options.objects.
AnyModel build_plant(const PlantOptions& options, std::size_t first, std::size_t count, bool weld,
                     const pgl::EcolOptions& ecol, const Progress& progress = {}, BuildReport* report = nullptr,
                     bool errors = false);

}  // namespace pgl::scene
