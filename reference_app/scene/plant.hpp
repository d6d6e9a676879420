// SPDX-License-Identifier: MIT
// The built-in model: an industrial plant of any number of objects, made object by object from a seed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "pgl/types.hpp"
#include "scene/mesh_data.hpp"

/// The plant is laid out in bays of 24 m by 26 m along streets. Every bay holds a stretch of pipe rack with trays of
/// wires, a steel frame of two to four floors with equipment, and a group of tanks, towers or drums; its pipes connect,
/// its flanges carry their bolts. Bays are built from 16 plans whose order within each block of 16 bays is drawn from
/// the seed. Objects come in the order in which one would build: a plant cut short anywhere still makes sense.
///
/// Everything is deterministic: the same options and index give the same bytes on every compiler and machine, whichever
/// objects were made before. All functions are thread-safe.
namespace pgl::scene {

enum class PlantKind : std::uint8_t {
  tank,
  vessel,
  slab,
  column,
  beam,
  brace,
  grating,
  handrail,
  stair,
  ladder,
  pipe,
  elbow,
  flange,
  valve,
  pump,
  support,
  tray,
  wire,
  plate,
  gusset,
  name_plate,
  bolt,
};
inline constexpr std::size_t plant_kind_count = 22;

struct PlantOptions {
  std::size_t objects = 1000;  ///< any number; 718,000 give about 332 M triangles
  std::uint64_t seed = 1;
};

/// Vertices and triangles of an object or of the whole plant.
struct PlantSize {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  friend constexpr bool operator==(const PlantSize&, const PlantSize&) = default;
};

/// Where to look at the plant from. World space is in metres, right-handed, z up; the ground is z = 0.
struct PlantCamera {
  glm::vec3 position{0.0f};
  glm::vec3 target{0.0f};
  glm::vec3 up{0.0f, 0.0f, 1.0f};
  float vertical_fov = 0.0f;  ///< radians
};

/// Makes object `index` into `mesh`, replacing what it held; allocates nothing once its arrays are large enough.
///
/// Positions are in world space: the object's transform is the identity. Indices are 0-based and in range, no triangle
/// is degenerate, no edge has more than two triangles, and triangles are counter-clockwise seen from outside. 1 to
/// 30,000 triangles. Precondition: index < options.objects.
void plant_object(const PlantOptions& options, std::size_t index, MeshData& mesh);

/// The exact size of an object, without making it. Precondition: index < options.objects.
[[nodiscard]] PlantSize plant_object_size(const PlantOptions& options, std::size_t index);

/// The exact size of the whole plant, without making it. The first call of any function here draws up the plans, which
/// takes some 20 ms; every later call of this one takes microseconds.
[[nodiscard]] PlantSize plant_size(const PlantOptions& options);

/// What an object is. Precondition: index < options.objects.
[[nodiscard]] PlantKind plant_kind(const PlantOptions& options, std::size_t index);

/// True when the object's surface is closed: every edge has two triangles, and every component encloses a positive
/// volume. The others have borders, as real data with unstitched faces has. Precondition: index < options.objects.
[[nodiscard]] bool plant_is_closed(const PlantOptions& options, std::size_t index);

/// The kind's name, in lower case, e.g. "name plate".
[[nodiscard]] std::string_view plant_kind_name(PlantKind kind);

/// A box that holds every object; the empty box for no objects. Exact for the objects of a single bay, else a little
/// large.
[[nodiscard]] Box plant_box(const PlantOptions& options);

/// An overview from above the street, so far away that the whole plant fits a picture at least 3:2 wide. On a site of
/// more than four bays the highest towers may reach out of it.
[[nodiscard]] PlantCamera plant_camera(const PlantOptions& options);

}  // namespace pgl::scene
