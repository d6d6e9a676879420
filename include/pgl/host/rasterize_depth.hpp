// SPDX-License-Identifier: MIT
// Draws the depth of occluders into a map, on the CPU.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pgl/config.hpp"
#include "pgl/depth.hpp"
#include "pgl/gather.hpp"
#include "pgl/host/parallel.hpp"
#include "pgl/rasterize_depth.hpp"
#include "pgl/types.hpp"

namespace pgl::host {

namespace depth_detail {

/// Some vertices or triangles of one occluder.
struct Part {
  std::uint32_t object;
  std::uint32_t first;
  std::uint32_t last;
  std::size_t base;  ///< where the occluder's vertices begin in the workspace
};

inline constexpr std::uint32_t part_size = 1024;           ///< vertices or triangles
inline constexpr std::size_t batch_vertices = 1 << 15;     ///< per thread: those in the workspace stay in its caches
inline constexpr std::uint64_t most_shared_texels = 1024;  ///< larger boxes are drawn in bands of rows, one thread each

inline void add_parts(std::vector<Part>& parts, std::uint32_t object, std::uint32_t count, std::size_t base) {
  for (std::uint64_t first = 0; first < count; first += part_size)  // in 64 bits, lest the last step begin anew
    parts.push_back({object, static_cast<std::uint32_t>(first),
                     static_cast<std::uint32_t>(std::min<std::uint64_t>(first + part_size, count)), base});
}

/// Keeps the nearer depth; shared: while other threads draw there.
template <bool shared>
void keep_nearer(Depth& texel, Depth depth) {
  if constexpr (shared) {
    const std::atomic_ref<Depth> at(texel);
    Depth now = at.load(std::memory_order_relaxed);
    while (depth < now && !at.compare_exchange_weak(now, depth, std::memory_order_relaxed)) {
    }
  } else {
    texel = depth < texel ? depth : texel;
  }
}

/// Draws the rows [first, last) of the triangle's box.
template <bool shared>
void draw_rows(const DepthTriangle& t, std::uint32_t first, std::uint32_t last, std::uint32_t width, Depth* depth) {
  Depth* row = depth + static_cast<std::size_t>(t.y0 + first) * width + t.x0;
  for (std::uint32_t j = first; j < last; ++j, row += width) {
    const DepthSpan span = covered_span(t, j);
    const std::int64_t start = t.depth[0] + t.depth[2] * static_cast<std::int64_t>(j);
    std::int64_t value = start + t.depth[1] * static_cast<std::int64_t>(span.first);
    for (std::uint32_t i = span.first; i < span.end; ++i, value += t.depth[1])
      keep_nearer<shared>(row[i], depth_of(t, value));
  }
}

}  // namespace depth_detail

/// Scratch of rasterize_depth, kept from frame to frame: it only grows, as a rule to some megabytes per thread, or to
/// 40 bytes per vertex of the largest occluder if that is more. With several threads triangles whose box has more than
/// 1024 texels take 120 bytes each on top, those of an occluder, or of as many as are drawn together, at once.
struct DepthWorkspace {
  std::vector<DepthVertex> vertices;
  std::vector<depth_detail::Part> vertex_parts;
  std::vector<depth_detail::Part> triangle_parts;
  std::vector<std::vector<DepthTriangle>> large;  ///< per thread: triangles that are drawn in bands of rows
};

/// Draws the triangles of the occluders, at full detail, into a depth map: each texel that a triangle covers for
/// certain takes the triangle's depth if that is nearer than what it has. Fill the map with far_depth first.
///
/// A vertex is where transform_point puts it; a picture drawn with exact arithmetic from there is the truth. With the
/// samples of a texel that its DepthMap's coverage speaks of:
/// - a texel that ends nearer than it began has all its samples covered by one occluder triangle, inside its edges;
/// - its depth is at or behind that triangle's true window depth at all of them.
/// So whatever is strictly behind the texel's depth is hidden there. What is lost is little: samples within some 1e-10
/// texels of an edge, also where the next triangle of the mesh begins, and where scale or coverage ask for more than
/// the pixel's centre, every texel that no triangle covers alone. Depths are a step or two too far, more where places
/// or depths are not known better because coordinates are huge beside what is seen.
/// Both windings are drawn. What is before the near plane is cut off; what is beyond the far plane leaves far_depth.
/// Triangles with a corner that is not finite are passed over.
///
/// - meshes, objects, vertices, triangles, map: the model's; occluders: indices of objects, in any order and possibly
///   more than once, entries of no_object are passed over;
/// - depth: width * height texels, row after row, changed in place. Overlaps no input.
///
/// Preconditions: every entry of clip_from_world is finite; size is depth_map_of(view, size.scale, size.coverage); the
/// occluders are below objects.size(), or no_object; a mesh's triangles have indices below its max_vertices.
/// O(vertices + triangles + texels covered, with multiplicity + rows of the triangles' boxes), in parallel, also within
/// large triangles; allocates only where the workspace is smaller than ever before. The same for any number of threads
/// and any order of the occluders. Source: [Peng13] 4.6, which draws with OpenGL.
template <class Index>
void rasterize_depth(std::span<const Mesh> meshes, std::span<const Object> objects, std::span<const glm::vec3> vertices,
                     std::span<const Triangle<Index>> triangles, std::span<const std::uint32_t> map,
                     std::span<const std::uint32_t> occluders, const View& view, const DepthMap& size,
                     DepthWorkspace& workspace, std::span<Depth> depth) {
  namespace detail = depth_detail;
  PGL_ASSERT(depth.size() == static_cast<std::size_t>(size.width) * size.height);
  const DepthView depth_view = depth_view_of(view, size);
  const std::size_t threads = thread_count();
  if (workspace.large.size() < threads) workspace.large.resize(threads);

  const auto draw_part = [&]<bool shared>(const detail::Part& part) {
    const Object& object = objects[part.object];
    const Mesh& mesh = meshes[object.mesh];
    const DepthVertex* const placed = workspace.vertices.data() + part.base;
    auto& large = workspace.large[thread_index()];
    const auto draw = [&](const DepthTriangle& t) {
      if (threads > 1 && std::uint64_t{t.columns} * t.rows > detail::most_shared_texels)
        large.push_back(t);
      else
        detail::draw_rows<shared>(t, 0, t.rows, size.width, depth.data());
    };
    for (std::uint32_t i = part.first; i < part.last; ++i) {
      const Triangle<Index>& t = triangles[mesh.first_triangle + i];
      PGL_ASSERT(t.v[0] < mesh.max_vertices && t.v[1] < mesh.max_vertices && t.v[2] < mesh.max_vertices);
      const DepthVertex &a = placed[t.v[0]], &b = placed[t.v[1]], &c = placed[t.v[2]];
      if (is_drawable(a) && is_drawable(b) && is_drawable(c)) {
        const DepthTriangle triangle = depth_triangle(depth_view, a, b, c);
        if (triangle.columns > 0) draw(triangle);
      } else {
        ClipVertex corners[3];
        for (int k = 0; k < 3; ++k)
          corners[k] = clip_vertex(depth_view, transform_point(object.transform, vertices[mesh.first_vertex + t.v[k]]));
        DepthTriangle cut[2];
        const int count = cut_depth_triangle(depth_view, corners, cut);
        for (int k = 0; k < count; ++k) draw(cut[k]);
      }
    }
  };

  for (std::size_t next = 0; next < occluders.size();) {
    // So many occluders at a time as make work for all threads: first their vertices, then their triangles.
    workspace.vertex_parts.clear();
    workspace.triangle_parts.clear();
    std::size_t total = 0;
    for (; next < occluders.size() && total < threads * detail::batch_vertices; ++next) {
      const std::uint32_t object = occluders[next];
      if (object == no_object) continue;
      PGL_ASSERT(object < objects.size());
      const Mesh& mesh = meshes[objects[object].mesh];
      detail::add_parts(workspace.vertex_parts, object, mesh.max_vertices, total);
      detail::add_parts(workspace.triangle_parts, object, triangles_at(mesh, map.data(), mesh.max_vertices), total);
      total += mesh.max_vertices;
    }
    if (workspace.vertices.size() < total) workspace.vertices.resize(total);
    parallel_for(workspace.vertex_parts.size(), 1, [&](std::size_t p) {
      const detail::Part& part = workspace.vertex_parts[p];
      const Object& object = objects[part.object];
      const std::size_t first = static_cast<std::size_t>(meshes[object.mesh].first_vertex);
      for (std::uint32_t v = part.first; v < part.last; ++v)
        workspace.vertices[part.base + v] =
            depth_vertex(depth_view, clip_vertex(depth_view, transform_point(object.transform, vertices[first + v])));
    });
    const std::size_t parts = workspace.triangle_parts.size();
    const bool shared = threads > 1 && parts > 1;
    parallel_for(parts, 1, [&](std::size_t p) {
      if (shared)
        draw_part.template operator()<true>(workspace.triangle_parts[p]);
      else
        draw_part.template operator()<false>(workspace.triangle_parts[p]);
    });
    // The large triangles: each thread draws the rows of its bands of the map.
    const auto is_empty = [](const auto& large) { return large.empty(); };
    if (std::ranges::all_of(workspace.large, is_empty)) continue;
    const std::uint32_t bands = static_cast<std::uint32_t>(4 * threads);
    const std::uint32_t band_rows = (size.height - 1) / bands + 1;
    parallel_for(bands, 1, [&](std::size_t band) {
      const std::uint64_t begin = band * band_rows, end = begin + band_rows;
      for (const auto& large : workspace.large)
        for (const DepthTriangle& t : large) {
          const std::uint64_t first = std::max<std::uint64_t>(begin, t.y0);
          const std::uint64_t last = std::min<std::uint64_t>(end, std::uint64_t{t.y0} + t.rows);
          if (first >= last) continue;
          detail::draw_rows<false>(t, static_cast<std::uint32_t>(first - t.y0), static_cast<std::uint32_t>(last - t.y0),
                                   size.width, depth.data());
        }
    });
    for (auto& large : workspace.large) large.clear();
  }
}

}  // namespace pgl::host
