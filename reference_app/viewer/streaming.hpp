// SPDX-License-Identifier: MIT
// Whether a frame's vertices and triangles are sent as they are needed, and what fits where they are sent to.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "pgl/gather.hpp"
#include "pgl/types.hpp"
#include "scene/model_view.hpp"

namespace pgl::viewer {

/// automatic: where the model does not fit.
enum class StreamMode { automatic, always, never };

struct StreamOptions {
  StreamMode mode = StreamMode::automatic;
  std::optional<std::uint64_t> gpu_memory;  ///< bytes that frames may take, all in all
  std::optional<std::uint64_t> transfer;    ///< bytes that a frame may send
  bool overlap = false;                     ///< a frame is prepared while the one before is drawn
};

/// What a frame sent.
struct Sent {
  std::uint64_t vertices = 0, triangles = 0, bytes = 0;
  std::uint64_t missing_bytes = 0;  ///< that the frame would have had without the cap
};

/// What memory there is for, in bytes where nothing else is said.
struct MemoryPlan {
  bool streams = false;
  std::uint64_t resident = 0;            ///< whatever the camera: tables, ecol and map, scratch, occluders
  std::uint64_t vertices = 0;            ///< elements that a selection may have
  std::uint64_t triangles = 0;           ///< elements that a selection may have
  std::uint64_t additional = 0;          ///< what one frame may send; there is room for two
  std::uint64_t blocks = 0;              ///< the blocks and what frames send
  std::uint64_t drawn = 0;               ///< OpenGL's buffers
  std::optional<std::uint64_t> limit{};  ///< --gpu-memory
};

/// How many vertices and triangles all objects have together.
struct ModelSize {
  std::uint64_t vertices = 0, triangles = 0;
};

/// The triangles of mesh m at full detail; needs no map, since the meshes of a Model follow each other without gaps.
template <class Index>
std::uint64_t full_triangles(const scene::ModelView<Index>& model, std::size_t m) {
  const std::uint64_t end =
      m + 1 < model.meshes.size() ? model.meshes[m + 1].first_triangle : std::uint64_t{model.triangles.size()};
  return end - model.meshes[m].first_triangle;
}

template <class Index>
ModelSize size_of(const scene::ModelView<Index>& model) {
  ModelSize size;
  for (const Object& object : model.objects) {
    size.vertices += model.meshes[object.mesh].max_vertices;
    size.triangles += full_triangles(model, object.mesh);
  }
  return size;
}

/// The bytes of a block with the scratch that moving it in place may take.
constexpr std::uint64_t with_scratch(std::uint64_t bytes) {
  return bytes + bytes / 20;
}

/// Gives a plan room for so many vertices and triangles, and returns what that takes beside what is resident.
inline std::uint64_t plan_room(const StreamOptions& options, std::uint64_t vertices, std::uint64_t triangles,
                               std::uint64_t vertex_bytes, std::uint64_t triangle_bytes, MemoryPlan& plan) {
  plan.vertices = vertices;
  plan.triangles = triangles;
  const std::uint64_t block = vertices * vertex_bytes + triangles * triangle_bytes;
  plan.additional = std::min(block, options.transfer.value_or(block));
  plan.blocks = with_scratch(block) + 2 * plan.additional;
  plan.drawn = vertices * sizeof(PlacedVertex) + triangles * sizeof(Triangle<std::uint32_t>);
  return plan.blocks + plan.drawn;
}

/// Plans the memory of a streamed frame. resident: what is taken already. Without a limit there is room for the whole
/// budget, with twice as many triangles as vertices to begin with, or for the whole model. Within a limit, the largest
/// number of vertices up to the budget for which there is room for twice as many triangles too; and for all the
/// triangles that still fit. Throws std::runtime_error where not even 1,000 vertices fit.
inline MemoryPlan plan_memory(const StreamOptions& options, const ModelSize& model, std::uint64_t resident,
                              std::uint64_t budget, std::uint64_t vertex_bytes, std::uint64_t triangle_bytes) {
  MemoryPlan plan{.streams = true, .resident = resident, .limit = options.gpu_memory};
  const std::uint64_t most = std::min(budget, model.vertices);
  const auto cost = [&](std::uint64_t vertices, std::uint64_t triangles) {
    return plan_room(options, vertices, triangles, vertex_bytes, triangle_bytes, plan);
  };
  const auto triangles_of = [&](std::uint64_t vertices) { return std::min(model.triangles, 2 * vertices); };
  if (!plan.limit) {
    cost(most, most < model.vertices ? triangles_of(most) : model.triangles);
    return plan;
  }
  const std::uint64_t room = *plan.limit > resident ? *plan.limit - resident : 0;
  const auto largest = [](std::uint64_t low, std::uint64_t high, auto&& fits) {  // fits(low) is taken for granted
    while (low < high) {
      const std::uint64_t middle = low + (high - low + 1) / 2;
      if (fits(middle)) {
        low = middle;
      } else {
        high = middle - 1;
      }
    }
    return low;
  };
  const std::uint64_t vertices =
      largest(0, most, [&](std::uint64_t count) { return cost(count, triangles_of(count)) <= room; });
  if (vertices < std::min<std::uint64_t>(most, 1000)) {
    const std::uint64_t least = resident + cost(std::min<std::uint64_t>(most, 1000), triangles_of(1000));
    throw std::runtime_error("--gpu-memory: this model needs at least " + std::to_string((least >> 20) + 1) +
                             " MiB there, even if hardly anything is drawn");
  }
  const std::uint64_t triangles = largest(triangles_of(vertices), model.triangles,
                                          [&](std::uint64_t count) { return cost(vertices, count) <= room; });
  cost(vertices, triangles);
  return plan;
}

/// What is drawn into the depth where the model itself is not on the GPU: the meshes of the objects most likely to hide
/// others, at full detail, as far as they fit into so many bytes. The others are empty.
template <class Index>
struct OccluderMeshes {
  std::vector<Mesh> meshes;
  std::vector<glm::vec3> vertices;
  std::vector<Triangle<Index>> triangles;
  std::vector<std::uint32_t> map;
  std::vector<std::uint32_t> candidates;  ///< objects, ascending
};

/// Chooses them by the area of their boxes' largest face times compactness. `candidates`: objects that may be chosen.
/// load(counts): called once with the vertices of every object that will be read.
template <class Index>
OccluderMeshes<Index> choose_occluders(const scene::ModelView<Index>& model, std::vector<std::uint32_t> candidates,
                                       std::uint64_t bytes, auto&& load) {
  const auto weight_of = [&](std::uint32_t i) {
    const glm::dvec3 normal(model.faces[i].normal);  // as long as the square root of the area
    const double weight = static_cast<double>(model.faces[i].compactness) * glm::dot(normal, normal);
    return weight >= 0.0 ? weight : 0.0;  // not a NaN
  };
  std::ranges::stable_sort(candidates, [&](std::uint32_t a, std::uint32_t b) { return weight_of(a) > weight_of(b); });
  OccluderMeshes<Index> chosen;
  chosen.meshes.resize(model.meshes.size());
  chosen.map.push_back(0);  // that of the empty ones
  std::vector<std::uint32_t> counts(model.objects.size(), 0);
  std::vector<std::uint32_t> order;
  std::uint64_t taken = 0;
  for (const std::uint32_t i : candidates) {
    const std::uint32_t m = model.objects[i].mesh;
    const Mesh& mesh = model.meshes[m];
    Mesh& copy = chosen.meshes[m];
    if (copy.max_vertices == 0) {
      const std::uint64_t size =
          mesh.max_vertices * sizeof(glm::vec3) + full_triangles(model, m) * sizeof(Triangle<Index>);
      if (taken + size > bytes) break;
      taken += size;
      copy.min_vertices = copy.max_vertices = mesh.max_vertices;
      order.push_back(m);
      counts[i] = mesh.max_vertices;
    }
    chosen.candidates.push_back(i);
  }
  load(std::span<const std::uint32_t>(counts));
  for (const std::uint32_t m : order) {
    const Mesh& mesh = model.meshes[m];
    Mesh& copy = chosen.meshes[m];
    copy.first_vertex = chosen.vertices.size();
    copy.first_triangle = chosen.triangles.size();
    copy.first_map = chosen.map.size();
    const auto vertices = model.vertices.subspan(mesh.first_vertex, mesh.max_vertices);
    const auto triangles = model.triangles.subspan(mesh.first_triangle, full_triangles(model, m));
    chosen.vertices.insert(chosen.vertices.end(), vertices.begin(), vertices.end());
    chosen.triangles.insert(chosen.triangles.end(), triangles.begin(), triangles.end());
    chosen.map.push_back(static_cast<std::uint32_t>(triangles.size()));
  }
  std::ranges::sort(chosen.candidates);
  return chosen;
}

}  // namespace pgl::viewer
