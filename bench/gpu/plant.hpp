// SPDX-License-Identifier: MIT
// The model of the GPU benchmarks: the procedural plant as flat arrays, as made, ordered by the host, and arranged.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pgl/build_ecol.hpp"
#include "pgl/types.hpp"
#include "scene/mesh_data.hpp"

namespace pgl::bench {

/// An array that is not written before its user writes it: pages belong to the threads that fill them.
template <class T>
class HostArray {
 public:
  HostArray() = default;
  explicit HostArray(std::size_t size) : data_(std::make_unique_for_overwrite<T[]>(size)), size_(size) {}
  T* data() const { return data_.get(); }
  std::size_t size() const { return size_; }
  T& operator[](std::size_t i) const { return data_[i]; }
  std::span<T> view() const { return {data(), size_}; }
  std::span<const T> input() const { return {data(), size_}; }
  std::span<T> view(std::size_t first, std::size_t count) const { return view().subspan(first, count); }

 private:
  std::unique_ptr<T[]> data_;
  std::size_t size_ = 0;
};

/// Meshes as they are made, in flat arrays: what build_ecol reads.
template <class Index>
struct Meshes {
  std::vector<MeshRange> ranges;
  HostArray<glm::vec3> positions;
  HostArray<Triangle<Index>> triangles;
  std::uint64_t map_entries = 0;
};

/// What build_ecol writes for all meshes; map entries below a mesh's minimum hold the bytes 0xA5.
template <class Index>
struct Order {
  HostArray<Index> ecol, permute_v;
  HostArray<std::uint32_t> permute_t, map, min_vertices;
};

/// What rearrange writes for all meshes.
template <class Index>
struct Arranged {
  HostArray<glm::vec3> vertices;
  HostArray<Triangle<Index>> triangles;
  HostArray<Index> ecol;
};

/// The objects [0, objects) of the plant, each once; `stitched` merges vertices at identical positions.
Meshes<std::uint16_t> make_plant(std::size_t objects, bool stitched);

/// One mesh of 2 * around * across triangles: a closed surface, bumpy everywhere.
Meshes<std::uint32_t> bumpy_torus(std::uint32_t around, std::uint32_t across);

/// One mesh from a file, its objects' meshes side by side. Nothing where the program was built without the importers or
/// the file is not there.
std::optional<Meshes<std::uint32_t>> read_mesh(const std::string& path);

/// Sets the threads of pgl::host: 1, or 0 for all. Returns how many that is.
std::size_t use_threads(std::size_t threads);

/// Room for the order of the first `count` meshes.
template <class Index>
Order<Index> room_for_order(const Meshes<Index>& meshes, std::size_t count);

/// Orders as many meshes from the first one on as `out` has room for, on the threads in use. Workspaces stay warm.
template <class Index>
void order(const Meshes<Index>& meshes, const EcolOptions& options, const Order<Index>& out);

template <class Index>
Arranged<Index> room_for_arranged(const Meshes<Index>& meshes);

/// Arranges all meshes on the threads in use.
template <class Index>
void arrange(const Meshes<Index>& meshes, const Order<Index>& order, const Arranged<Index>& out);

/// What the frame reads of each mesh: its map begins where its first level does.
template <class Index>
std::vector<Mesh> meshes_of(const Meshes<Index>& meshes, const Order<Index>& order);

}  // namespace pgl::bench
