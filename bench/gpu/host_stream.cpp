// SPDX-License-Identifier: MIT
#include "host_stream.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "pgl/defragment.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/defragment.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/gather.hpp"
#include "pgl/host/limit_transfer.hpp"
#include "pgl/host/pack_delta.hpp"
#include "pgl/host/prefix_sum.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/reform.hpp"
#include "pgl/pack_delta.hpp"
#include "scene/plant.hpp"
#include "viewer/camera.hpp"

namespace pgl::bench {

using Index = std::uint16_t;

Cameras::Cameras(const Scene& scene, std::size_t objects) : objects_(objects) {
  for (const Box& box : scene.boxes) {
    all_.min = glm::min(all_.min, box.min);
    all_.max = glm::max(all_.max, box.max);
  }
}

View Cameras::overview(double metres_aside) const {
  const scene::PlantCamera plant = scene::plant_camera({.objects = objects_});
  viewer::Camera camera{plant.position, plant.target, plant.up, glm::degrees(double{plant.vertical_fov})};
  camera.eye += viewer::axes_of(camera).right * metres_aside;
  return viewer::view_of(camera, all_, 1280, 720);
}

View Cameras::flight(double metres) const {
  constexpr double street = 52.0;  // from one to the next
  const double rows = std::floor((all_.max.y - all_.min.y) * 0.5 / street);
  viewer::Camera camera{
      {0.5 * (all_.min.x + all_.max.x) + metres, all_.min.y + rows * street + 5.2, 8.0}, {}, {0.0, 0.0, 1.0}, 60.0};
  camera.target = camera.eye + glm::dvec3(1.0, 0.5 * std::sin(metres / 15.0), -0.05);
  return viewer::view_of(camera, all_, 1280, 720);
}

BudgetOptions options_for(BudgetOptions options, const View& view) {
  options.near_depth = view.near_depth;
  options.viewport_area = view.width * view.height;
  return options;
}

struct Selector::Workspaces {
  host::BudgetWorkspace budget;
  host::TransferWorkspace transfer;
};

Selector::Selector(const Scene& scene)
    : scene_(scene), in_view_(scene.objects.size()), workspaces_(std::make_shared<Workspaces>()) {}

void Selector::select(const View& view, const BudgetOptions& options, Selection& out) {
  const std::size_t n = scene_.objects.size();
  out.areas.resize(n);
  out.depths.resize(n);
  out.counts.resize(n);
  host::cull_frustum(scene_.boxes, view, in_view_);
  host::project(scene_.boxes, in_view_, view, out.areas, out.depths);
  host::distribute_budget(out.areas, out.depths, scene_.min_vertices, scene_.max_vertices, options, workspaces_->budget,
                          out.counts);
  lay_out(out);
}

TransferTotals Selector::limit(const Selection& wanted, const Selection& previous, const BudgetOptions& options,
                               const TransferOptions& transfer, std::span<std::uint32_t> counts) {
  return host::limit_transfer(wanted.areas, wanted.depths, scene_.min_vertices, scene_.max_vertices, options,
                              wanted.counts, previous.counts, scene_.mesh_of_object, scene_.meshes, scene_.map,
                              transfer, workspaces_->transfer, counts);
}

void Selector::lay_out(Selection& s) const {
  const std::size_t n = scene_.objects.size();
  s.triangle_counts.resize(n);
  s.vertex_offsets.resize(n + 1);
  s.triangle_offsets.resize(n + 1);
  host::lay_out(s.counts, scene_.mesh_of_object, scene_.meshes, scene_.map, s.triangle_counts, s.vertex_offsets,
                s.triangle_offsets);
}

std::uint64_t new_elements(std::span<const std::uint64_t> previous_offsets, std::span<const std::uint64_t> offsets) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i + 1 < offsets.size(); ++i) {
    sum += delta_part(previous_offsets.data(), offsets.data(), i).size;
  }
  return sum;
}

SelectionPair make_pair(const Scene& scene, const Cameras& cameras, const BudgetOptions& options, double share) {
  SelectionPair pair;
  Selector selector(scene);
  pair.view_a = cameras.overview(0);
  pair.options_a = options_for(options, pair.view_a);
  selector.select(pair.view_a, pair.options_a, pair.a);
  const auto try_at = [&](double metres) {
    pair.metres = metres;
    pair.view_b = cameras.overview(metres);
    pair.options_b = options_for(options, pair.view_b);
    selector.select(pair.view_b, pair.options_b, pair.b);
    return static_cast<double>(new_elements(pair.a.vertex_offsets, pair.b.vertex_offsets)) /
           static_cast<double>(std::max<std::uint64_t>(pair.b.vertices(), 1));
  };
  double low = 0, high = 1;
  while (high < 4096 && try_at(high) < share) {
    low = high;
    high *= 2;
  }
  for (int step = 0; step < 10; ++step) {
    const double middle = 0.5 * (low + high);
    (try_at(middle) < share ? low : high) = middle;
  }
  try_at(high);
  return pair;
}

SelectionPair make_spread_pair(const Scene& scene, std::uint64_t vertices, std::uint64_t triangles) {
  const std::size_t n = scene.objects.size();
  SelectionPair pair;
  std::mt19937 random(1);
  const auto around = [&](std::uint64_t total) {  // half to one and a half times the average
    const std::uint64_t mean = std::max<std::uint64_t>(1, (total + n / 2) / n);
    return mean - mean / 2 + random() % (2 * (mean / 2) + 1);
  };
  const auto nudged = [&](std::uint64_t count) {
    if (random() % 2 == 0) return count;
    const std::uint64_t third = (count + 2) / 3;
    return count - third + random() % (2 * third + 1);
  };
  for (Selection* s : {&pair.a, &pair.b}) {
    s->vertex_offsets.assign(1, 0);
    s->triangle_offsets.assign(1, 0);
  }
  for (std::size_t i = 0; i < n; ++i) {
    const Mesh& mesh = scene.meshes[i];
    const std::uint64_t v = around(vertices), t = around(triangles);
    const std::uint64_t most_v = mesh.max_vertices, most_t = triangles_at(mesh, scene.map.data(), mesh.max_vertices);
    const auto add = [&](Selection& s, std::uint64_t count, std::uint64_t corners) {
      s.counts.push_back(static_cast<std::uint32_t>(std::min(count, most_v)));
      s.triangle_counts.push_back(static_cast<std::uint32_t>(std::min(corners, most_t)));
      s.vertex_offsets.push_back(s.vertex_offsets.back() + s.counts.back());
      s.triangle_offsets.push_back(s.triangle_offsets.back() + s.triangle_counts.back());
    };
    add(pair.a, v, t);
    add(pair.b, nudged(v), nudged(t));
  }
  return pair;
}

// ---- blocks

template <class T>
struct HostBlocks<T>::Workspace {
  host::DefragmentWorkspace defragment;
};

namespace {

template <class T>
HostBlocks<T> blocks_of(const Scene& scene, std::uint64_t Mesh::*first, std::span<const T> elements,
                        std::span<const std::uint64_t> a_offsets, std::span<const std::uint64_t> b_offsets) {
  HostBlocks<T> blocks;
  blocks.workspace = std::make_shared<typename HostBlocks<T>::Workspace>();
  blocks.a_offsets = a_offsets;
  blocks.b_offsets = b_offsets;
  const std::vector<std::uint64_t> nothing(a_offsets.size(), 0);
  const auto pack = [&](std::span<const std::uint64_t> previous, std::span<const std::uint64_t> offsets,
                        std::span<const std::uint64_t> delta, std::vector<T>& out) {
    out.resize(delta.back());
    host::pack_delta<T>(scene.meshes, scene.objects, first, elements, previous, offsets, delta, out);
  };
  pack(nothing, a_offsets, a_offsets, blocks.a);
  pack(nothing, b_offsets, b_offsets, blocks.b);
  for (auto* delta : {&blocks.forth_delta, &blocks.back_delta}) delta->resize(a_offsets.size());
  host::lay_out_delta(a_offsets, b_offsets, blocks.forth_delta);
  host::lay_out_delta(b_offsets, a_offsets, blocks.back_delta);
  pack(a_offsets, b_offsets, blocks.forth_delta, blocks.forth_new);
  pack(b_offsets, a_offsets, blocks.back_delta, blocks.back_new);
  blocks.out.resize(blocks.b.size());
  blocks.block = blocks.a;
  blocks.block.resize(std::max(blocks.a.size(), blocks.b.size()));
  return blocks;
}

std::vector<Triangle<std::uint32_t>> wide(const std::vector<Triangle<Index>>& triangles) {
  std::vector<Triangle<std::uint32_t>> out;
  out.reserve(triangles.size());
  for (const auto& t : triangles) out.push_back({{t.v[0], t.v[1], t.v[2]}});
  return out;
}

}  // namespace

HostBlocks<glm::vec3> vertex_blocks(const Scene& scene, const SelectionPair& pair) {
  return blocks_of(scene, &Mesh::first_vertex, scene.vertices, std::span(pair.a.vertex_offsets),
                   std::span(pair.b.vertex_offsets));
}
HostBlocks<Triangle<std::uint16_t>> triangle_blocks(const Scene& scene, const SelectionPair& pair) {
  return blocks_of(scene, &Mesh::first_triangle, scene.triangles, std::span(pair.a.triangle_offsets),
                   std::span(pair.b.triangle_offsets));
}
HostBlocks<Triangle<std::uint32_t>> widened(const HostBlocks<Triangle<std::uint16_t>>& narrow) {
  HostBlocks<Triangle<std::uint32_t>> blocks;
  blocks.workspace = std::make_shared<HostBlocks<Triangle<std::uint32_t>>::Workspace>();
  blocks.a_offsets = narrow.a_offsets;
  blocks.b_offsets = narrow.b_offsets;
  blocks.forth_delta = narrow.forth_delta;
  blocks.back_delta = narrow.back_delta;
  blocks.a = wide(narrow.a);
  blocks.b = wide(narrow.b);
  blocks.forth_new = wide(narrow.forth_new);
  blocks.back_new = wide(narrow.back_new);
  blocks.out.resize(blocks.b.size());
  blocks.block = blocks.a;
  blocks.block.resize(narrow.block.size());
  return blocks;
}

template <class T>
void HostBlocks<T>::lay_out_delta() {
  host::lay_out_delta(a_offsets, b_offsets, forth_delta);
}
template <class T>
void HostBlocks<T>::defragment() {
  host::defragment<T>(a_offsets, b_offsets, forth_delta, a, forth_new, out);
}
template <class T>
void HostBlocks<T>::forth() {
  host::defragment_in_place<T>(a_offsets, b_offsets, forth_delta, forth_new, workspace->defragment, block);
}
template <class T>
void HostBlocks<T>::back() {
  host::defragment_in_place<T>(b_offsets, a_offsets, back_delta, back_new, workspace->defragment, block);
}
template <class T>
std::uint64_t HostBlocks<T>::moved() const {
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i + 1 < a_offsets.size(); ++i) {
    const KeptPart part = kept_part(a_offsets.data(), b_offsets.data(), i);
    if (part.from != part.to) sum += part.size;
  }
  return sum;
}
template struct HostBlocks<glm::vec3>;
template struct HostBlocks<Triangle<std::uint16_t>>;
template struct HostBlocks<Triangle<std::uint32_t>>;

// ---- a frame from blocks

struct HostStreamFrame::Workspaces {
  host::ReformWorkspace<Index> reform;
};

HostStreamFrame::HostStreamFrame(const Scene& of, const SelectionPair& between, HostBlocks<glm::vec3>& vertex_blocks,
                                 HostBlocks<Triangle<std::uint16_t>>& triangle_blocks)
    : scene(of),
      pair(between),
      vertices(vertex_blocks),
      triangles(triangle_blocks),
      limited(of.objects.size()),
      drawn_a(between.a.vertices()),
      drawn_b(between.b.vertices()),
      reformed_a(between.a.triangles()),
      reformed_b(between.b.triangles()),
      selector_(of),
      vertex_delta_(of.objects.size() + 1),
      triangle_delta_(of.objects.size() + 1),
      workspaces_(std::make_shared<Workspaces>()) {}

void HostStreamFrame::limit(std::uint64_t cap) {
  totals = selector_.limit(pair.b, pair.a, pair.options_b,
                           {.cap = cap, .vertex_bytes = sizeof(glm::vec3), .triangle_bytes = sizeof(Triangle<Index>)},
                           limited);
}
void HostStreamFrame::gather() {
  host::gather_block<PlacedVertex, glm::vec3>(scene.objects, vertices.b, pair.b.vertex_offsets, drawn_b);
}
void HostStreamFrame::reform() {
  host::reform_block<Index>(scene.meshes, scene.objects, triangles.b, scene.ecol, pair.b.counts, pair.b.vertex_offsets,
                            pair.b.triangle_offsets, workspaces_->reform, reformed_b);
}
void HostStreamFrame::forth() {
  frame(true);
}
void HostStreamFrame::back() {
  frame(false);
}

void HostStreamFrame::frame(bool to_b) {
  const Selection& previous = to_b ? pair.a : pair.b;
  const BudgetOptions& options = to_b ? pair.options_b : pair.options_a;
  selector_.select(to_b ? pair.view_b : pair.view_a, options, next_);
  selector_.limit(next_, previous, options,
                  {.vertex_bytes = sizeof(glm::vec3), .triangle_bytes = sizeof(Triangle<Index>)}, next_.counts);
  selector_.lay_out(next_);
  host::lay_out_delta(previous.vertex_offsets, next_.vertex_offsets, vertex_delta_);
  host::lay_out_delta(previous.triangle_offsets, next_.triangle_offsets, triangle_delta_);
  to_b ? vertices.forth() : vertices.back();
  to_b ? triangles.forth() : triangles.back();
  host::reform_block<Index>(scene.meshes, scene.objects, triangles.block, scene.ecol, next_.counts,
                            next_.vertex_offsets, next_.triangle_offsets, workspaces_->reform,
                            to_b ? reformed_b : reformed_a);
  host::gather_block<PlacedVertex, glm::vec3>(scene.objects, vertices.block, next_.vertex_offsets,
                                              to_b ? drawn_b : drawn_a);
}

// ---- a path

HostPath::HostPath(const Scene& of, std::size_t objects) : scene(of), cameras(of, objects) {
  for (auto* offsets : {&vertex_offsets, &triangle_offsets, &vertex_delta, &triangle_delta, &previous_vertex_offsets,
                        &previous_triangle_offsets, &nothing_}) {
    offsets->assign(scene.objects.size() + 1, 0);
  }
}

void HostPath::next(std::span<const std::uint64_t> vertices, std::span<const std::uint64_t> triangles) {
  previous_vertex_offsets.swap(vertex_offsets);
  previous_triangle_offsets.swap(triangle_offsets);
  std::ranges::copy(vertices, vertex_offsets.begin());
  std::ranges::copy(triangles, triangle_offsets.begin());
}

void HostPath::collect(glm::vec3* vertices, Triangle<std::uint16_t>* triangles) {
  host::lay_out_delta(previous_vertex_offsets, vertex_offsets, vertex_delta);
  host::lay_out_delta(previous_triangle_offsets, triangle_offsets, triangle_delta);
  host::pack_delta<glm::vec3>(scene.meshes, scene.objects, &Mesh::first_vertex, scene.vertices, previous_vertex_offsets,
                              vertex_offsets, vertex_delta, {vertices, new_vertices()});
  host::pack_delta<Triangle<Index>>(scene.meshes, scene.objects, &Mesh::first_triangle, scene.triangles,
                                    previous_triangle_offsets, triangle_offsets, triangle_delta,
                                    {triangles, new_triangles()});
}

void HostPath::collect_all(glm::vec3* vertices, Triangle<std::uint16_t>* triangles) {
  host::pack_delta<glm::vec3>(scene.meshes, scene.objects, &Mesh::first_vertex, scene.vertices, nothing_,
                              vertex_offsets, vertex_offsets, {vertices, vertex_offsets.back()});
  host::pack_delta<Triangle<Index>>(scene.meshes, scene.objects, &Mesh::first_triangle, scene.triangles, nothing_,
                                    triangle_offsets, triangle_offsets, {triangles, triangle_offsets.back()});
}

}  // namespace pgl::bench
