// SPDX-License-Identifier: MIT
// Runs every rule over fixed inputs and prints one hash of all result bits per rule. The same source is built with
// ordinary and with hostile flags and compilers (see CMakeLists.txt beside it); the outputs must be the same.
#include <algorithm>
#include <array>
#include <bit>
#include <cinttypes>
#include <cstdint>
#include <cstdio>
#include <span>
#include <vector>

#include "pgl/feedback.hpp"
#include "pgl/host/balance.hpp"
#include "pgl/host/bounds.hpp"
#include "pgl/host/build_ecol.hpp"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/defragment.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/gather.hpp"
#include "pgl/host/limit_transfer.hpp"
#include "pgl/host/oriented_box.hpp"
#include "pgl/host/pack_delta.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/rearrange.hpp"
#include "pgl/host/reform.hpp"
#include "pgl/host/select_by_error.hpp"
#include "pgl/host/select_occluders.hpp"
#include "pgl/host/unify.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace ieee = pgl::ieee;

namespace {

/// FNV-1a, a word at a time. All NaN count as one: their bits are not promised.
class Hash {
 public:
  void operator()(std::uint64_t word) { value_ = (value_ ^ word) * 0x100000001b3u; }
  void operator()(float x) { (*this)(static_cast<std::uint64_t>(x != x ? 0x7fc00000u : ieee::to_bits(x))); }
  void operator()(double x) { (*this)(x != x ? 0x7ff8000000000000u : ieee::to_bits(x)); }
  void operator()(const glm::vec3& p) {
    for (int i = 0; i < 3; ++i) (*this)(p[i]);
  }
  void operator()(const pgl::Box& box) {
    (*this)(box.min);
    (*this)(box.max);
  }
  void operator()(const pgl::ScreenBox& box) {
    for (const float x : {box.x0, box.y0, box.x1, box.y1, box.depth}) (*this)(x);
  }
  void operator()(const pgl::Triangle<std::uint32_t>& t) {
    for (const std::uint32_t v : t.v) (*this)(std::uint64_t{v});
  }
  template <class T>
  void operator()(const std::vector<T>& values) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    for (const T& value : values) {
      if constexpr (std::is_integral_v<T>)
        (*this)(static_cast<std::uint64_t>(value));
      else
        (*this)(value);
    }
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325u;
};

/// splitmix64.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits() {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>(bits() % n); }
  /// All mantissa bits at random, in (-2, 2), with a few sizes: sums of products round differently when fused.
  template <class T>
  T number() {
    constexpr int mantissa = sizeof(T) == 4 ? 23 : 52;
    constexpr std::uint64_t bias = sizeof(T) == 4 ? 127 : 1023;
    const std::uint64_t word = bits();
    const std::uint64_t exponent = bias - (word & 3);
    const std::uint64_t sign = word >> 63 << (sizeof(T) * 8 - 1);
    return ieee::from_bits<T>(static_cast<decltype(ieee::to_bits(T{}))>(
        sign | exponent << mantissa | ((word >> 8) & ((std::uint64_t{1} << mantissa) - 1))));
  }
  /// Any bit pattern at all.
  template <class T>
  T any() {
    return ieee::from_bits<T>(static_cast<decltype(ieee::to_bits(T{}))>(bits()));
  }
  glm::vec3 point() {
    const float x = number<float>(), y = number<float>(), z = number<float>();
    return {x, y, z};
  }
  template <class T>
  std::vector<T> numbers(std::size_t n) {
    std::vector<T> values(n);
    for (T& value : values) value = number<T>();
    return values;
  }

 private:
  std::uint64_t state_;
};

template <class T>
void operations(Hash& hash, Random& random) {
  for (int i = 0; i < 20000; ++i) {
    const bool plain = i % 2 == 0;
    const T a = plain ? random.number<T>() : random.any<T>();
    const T b = plain ? random.number<T>() : random.any<T>();
    const T c = plain ? random.number<T>() : random.any<T>();
    for (const T x : {ieee::add(a, b), ieee::sub(a, b), ieee::mul(a, b), ieee::div(a, b), ieee::sqrt(a),
                      ieee::fma(a, b, c), ieee::min(a, b), ieee::max(a, b), ieee::next_up(a), ieee::next_down(a)})
      hash(x);
    hash(static_cast<std::uint64_t>(ieee::order_key(a)));
    hash(static_cast<std::uint64_t>(ieee::is_finite(a)));
    hash(ieee::to_float(static_cast<double>(a)));
  }
}

void ieee_operations(Hash& hash) {
  Random random(1);
  operations<float>(hash, random);
  operations<double>(hash, random);
}

/// What a compiler that may contract turns into fma: alone, and in loops that it may vectorise.
template <class T>
void expressions(Hash& hash, Random& random) {
  using ieee::add, ieee::mul, ieee::sub, ieee::div, ieee::sqrt;
  constexpr std::size_t n = 4096;
  const std::vector<T> a = random.numbers<T>(n), b = random.numbers<T>(n), c = random.numbers<T>(n);
  std::vector<T> sum(n), difference(n), reverse(n), scaled(n), normal(n), complex(2 * n);
  for (std::size_t i = 0; i < n; ++i) sum[i] = add(mul(a[i], b[i]), c[i]);
  for (std::size_t i = 0; i < n; ++i) difference[i] = sub(mul(a[i], b[i]), c[i]);
  for (std::size_t i = 0; i < n; ++i) reverse[i] = sub(c[i], mul(a[i], b[i]));
  for (std::size_t i = 0; i < n; ++i) scaled[i] = add(mul(a[i], a[0]), div(b[i], a[1]));
  for (std::size_t i = 0; i < n; ++i) normal[i] = sqrt(add(mul(a[i], a[i]), mul(b[i], b[i])));
  for (std::size_t i = 0; i < n; ++i) {
    complex[2 * i] = sub(mul(a[i], c[i]), mul(b[i], c[n - 1 - i]));
    complex[2 * i + 1] = add(mul(a[i], c[n - 1 - i]), mul(b[i], c[i]));
  }
  for (const std::vector<T>* values : {&sum, &difference, &reverse, &scaled, &normal, &complex}) hash(*values);
  T total = 0;
  for (std::size_t i = 0; i < n; ++i) total = add(total, mul(a[i], b[i]));
  hash(total);
  for (std::size_t i = 0; i + 3 <= n; i += 3) {  // a dot and a cross product, and a polynomial
    hash(add(add(mul(a[i], b[i]), mul(a[i + 1], b[i + 1])), mul(a[i + 2], b[i + 2])));
    hash(sub(mul(a[i + 1], b[i + 2]), mul(a[i + 2], b[i + 1])));
    hash(add(mul(add(mul(a[i], c[i]), b[i]), c[i]), a[i + 2]));
    hash(sub(-mul(a[i], b[i]), c[i]));
  }
}

void ieee_expressions(Hash& hash) {
  Random random(2);
  expressions<float>(hash, random);
  expressions<double>(hash, random);
}

template <class T>
void functions(Hash& hash, Random& random) {
  for (int i = 0; i < 20000; ++i) {
    const T x = random.any<T>(), y = random.number<T>();
    const T positive = random.number<T>() < 0 ? -y : y;
    hash(ieee::log2(x));
    hash(ieee::log2(positive));
    hash(ieee::exp2(x));
    hash(ieee::exp2(ieee::mul(y, T(600))));
    hash(ieee::pow(x, y));
    hash(ieee::pow(ieee::mul(y, y), ieee::mul(random.number<T>(), T(40))));
  }
}

void ieee_functions(Hash& hash) {
  Random random(3);
  functions<float>(hash, random);
  functions<double>(hash, random);
}

// ---- a scene for the others -----------------------------------------------------------------------------------------

pgl::View a_view(Random& random) {
  pgl::View view;
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 4; ++row) view.clip_from_world[column][row] = random.number<float>();
  view.clip_from_world[3][3] = 3.0f;
  view.width = 1920.0f;
  view.height = 1080.0f;
  view.depth_range = random.below(2) ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
  return view;
}

glm::mat4x3 a_transform(Random& random) {
  glm::mat4x3 m;
  for (int column = 0; column < 4; ++column) m[column] = random.point();
  return m;
}

std::vector<pgl::Box> some_boxes(Random& random, std::size_t n) {
  std::vector<pgl::Box> boxes(n);
  for (pgl::Box& box : boxes) {
    const glm::vec3 p = random.point(), q = random.point();
    for (int i = 0; i < 3; ++i) {
      box.min[i] = ieee::min(p[i], q[i]);
      box.max[i] = ieee::max(p[i], q[i]);
    }
  }
  return boxes;
}

struct Surface {
  std::vector<glm::vec3> positions;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
};

/// A bumpy sheet of side * side vertices, open all around.
Surface a_surface(Random& random, std::uint32_t side) {
  Surface s;
  for (std::uint32_t y = 0; y < side; ++y)
    for (std::uint32_t x = 0; x < side; ++x) {
      const glm::vec3 jitter = random.point();
      s.positions.push_back({ieee::add(ieee::mul(jitter.x, 0.2f), static_cast<float>(x)),
                             ieee::add(ieee::mul(jitter.y, 0.2f), static_cast<float>(y)), jitter.z});
    }
  for (std::uint32_t y = 0; y + 1 < side; ++y)
    for (std::uint32_t x = 0; x + 1 < side; ++x) {
      const std::uint32_t v = y * side + x;
      s.triangles.push_back({{v, v + 1, v + side}});
      s.triangles.push_back({{v + 1, v + side + 1, v + side}});
    }
  return s;
}

struct Order {
  std::vector<std::uint32_t> ecol, permute_v, permute_t, map;
  std::vector<float> error;
  std::uint32_t left = 0;
};

template <class Real>
Order order_of(const Surface& s, const pgl::EcolOptions& options) {
  Order o;
  o.ecol.resize(s.positions.size());
  o.permute_v.resize(s.positions.size());
  o.permute_t.resize(s.triangles.size());
  o.map.resize(s.positions.size() + 1);
  o.error.resize(s.positions.size() + 1);
  pgl::host::EcolWorkspace<Real> workspace;
  o.left = pgl::host::build_ecol<Real, std::uint32_t>(s.positions, s.triangles, {}, options, workspace, o.ecol,
                                                      o.permute_v, o.permute_t, o.map, o.error);
  return o;
}

struct Scene {
  std::vector<pgl::Mesh> meshes;
  std::vector<pgl::Object> objects;
  std::vector<glm::vec3> vertices;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
  std::vector<std::uint32_t> ecol, map, mesh_of_object;
};

Scene a_scene(Random& random, std::uint32_t objects) {
  Scene scene;
  for (std::uint32_t side : {2u, 5u, 9u, 16u, 24u}) {
    const Surface s = a_surface(random, side);
    const Order o = order_of<float>(s, {.boundary = pgl::BoundaryRule::slide});
    scene.meshes.push_back({scene.vertices.size(), scene.triangles.size(), scene.map.size(), o.left, side * side});
    scene.map.insert(scene.map.end(), o.map.begin() + o.left, o.map.end());
    std::vector<glm::vec3> vertices(s.positions.size());
    std::vector<pgl::Triangle<std::uint32_t>> triangles(s.triangles.size());
    std::vector<std::uint32_t> ecol(o.ecol.size());
    pgl::host::rearrange<glm::vec3, std::uint32_t>(s.positions, s.triangles, o.ecol, o.permute_v, o.permute_t, vertices,
                                                   triangles, ecol);
    scene.vertices.insert(scene.vertices.end(), vertices.begin(), vertices.end());
    scene.triangles.insert(scene.triangles.end(), triangles.begin(), triangles.end());
    scene.ecol.insert(scene.ecol.end(), ecol.begin(), ecol.end());
  }
  for (std::uint32_t i = 0; i < objects; ++i) {
    scene.mesh_of_object.push_back(random.below(static_cast<std::uint32_t>(scene.meshes.size())));
    scene.objects.push_back({scene.mesh_of_object.back(), a_transform(random)});
  }
  return scene;
}

// ---- the rules ------------------------------------------------------------------------------------------------------

void bounds(Hash& hash) {
  Random random(4);
  std::vector<glm::vec3> points(20000);
  for (glm::vec3& p : points) p = random.point();
  hash(pgl::host::bounds(points));
  const std::vector<pgl::Box> boxes = some_boxes(random, 5000);
  std::vector<pgl::Object> objects(20000);
  for (pgl::Object& object : objects) object = {random.below(5000), a_transform(random)};
  std::vector<pgl::Box> out(objects.size());
  pgl::host::object_bounds(objects, boxes, out);
  hash(out);
}

void cull_frustum(Hash& hash) {
  Random random(5);
  const std::vector<pgl::Box> boxes = some_boxes(random, 5000);
  std::vector<std::uint8_t> in_view(boxes.size());
  for (int i = 0; i < 10; ++i) {
    const pgl::View view = a_view(random);
    for (const auto& side : pgl::frustum_of(view).side)
      for (const double x : side) hash(x);
    pgl::host::cull_frustum(boxes, view, in_view);
    hash(in_view);
  }
}

void project(Hash& hash) {
  Random random(6);
  const std::vector<pgl::Box> boxes = some_boxes(random, 5000);
  std::vector<float> areas(boxes.size()), depths(boxes.size());
  std::vector<pgl::ScreenBox> rectangles(boxes.size());
  for (int i = 0; i < 10; ++i) {
    pgl::host::project(boxes, {}, a_view(random), areas, depths, rectangles);
    hash(areas);
    hash(depths);
    hash(rectangles);
  }
}

/// Soups of random points, thick and thin, then objects made of their boxes.
void occluders(Hash& hash) {
  Random random(9);
  std::vector<pgl::Mesh> meshes(300);
  std::vector<glm::vec3> vertices;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
  std::vector<std::uint32_t> map;
  for (pgl::Mesh& mesh : meshes) {
    const std::uint32_t n = 1 + random.below(60);
    mesh.first_vertex = vertices.size();
    mesh.first_triangle = triangles.size();
    mesh.first_map = map.size();
    mesh.min_vertices = mesh.max_vertices = n;
    map.push_back(n);
    const glm::vec3 thickness = random.point();
    for (std::uint32_t i = 0; i < n; ++i) {
      const glm::vec3 p = random.point();
      vertices.push_back({ieee::mul(p.x, thickness.x), ieee::mul(p.y, thickness.y), ieee::mul(p.z, thickness.z)});
      triangles.push_back({{random.below(n), random.below(n), random.below(n)}});
    }
  }
  std::vector<pgl::OrientedBox> boxes(meshes.size());
  std::vector<float> compactness(meshes.size());
  pgl::host::oriented_boxes<std::uint32_t>(meshes, vertices, triangles, map, boxes, compactness);
  for (const pgl::OrientedBox& box : boxes) {
    hash(box.centre);
    for (const glm::vec3& axis : box.axes) hash(axis);
    hash(box.half);
  }
  hash(compactness);
  std::vector<pgl::Object> objects(20000);
  for (pgl::Object& object : objects)
    object = {random.below(static_cast<std::uint32_t>(meshes.size())), a_transform(random)};
  std::vector<pgl::OccluderFace> faces(objects.size());
  pgl::host::occluder_faces(objects, boxes, compactness, faces);
  for (const pgl::OccluderFace& face : faces) {
    hash(face.centre);
    hash(face.normal);
  }
  std::vector<std::uint32_t> order(faces.size()), chosen(500);
  pgl::host::OccluderWorkspace workspace;
  pgl::host::compactness_order(faces, workspace, order);
  hash(order);
  for (int i = 0; i < 10; ++i) {
    const pgl::View view = a_view(random);
    const pgl::Eye eye = pgl::eye_of(view);
    for (const double x : {eye.x, eye.y, eye.z, eye.w}) hash(x);
    for (const pgl::OccluderFace& face : faces) hash(pgl::occluder_weight(face, eye));
    pgl::host::select_occluders(order, faces, {}, view, workspace, chosen);
    hash(chosen);
  }
}

/// Soups of triangles, some of them through the near plane, their map, and small boxes among and behind them.
void occlusion(Hash& hash) {
  Random random(11);
  std::vector<pgl::Mesh> meshes(8);
  std::vector<glm::vec3> vertices;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
  std::vector<std::uint32_t> map;
  for (pgl::Mesh& mesh : meshes) {
    const std::uint32_t n = 3 + random.below(30);
    mesh = {vertices.size(), triangles.size(), map.size(), n, n};
    map.push_back(n);
    for (std::uint32_t i = 0; i < n; ++i) {
      vertices.push_back(random.point());
      triangles.push_back({{random.below(n), random.below(n), random.below(n)}});
    }
  }
  std::vector<pgl::Object> objects(24);
  std::vector<std::uint32_t> all(objects.size());
  for (std::uint32_t i = 0; i < objects.size(); ++i) {
    objects[i] = {random.below(static_cast<std::uint32_t>(meshes.size())), a_transform(random)};
    all[i] = i;
  }
  std::vector<pgl::Box> boxes(5000);
  for (pgl::Box& box : boxes) {
    const glm::vec3 p = random.point(), q = random.point();
    for (int i = 0; i < 3; ++i) {
      box.min[i] = p[i];
      box.max[i] = ieee::add(p[i], ieee::mul(q[i], q[i] < 0.0f ? -0.01f : 0.01f));
    }
  }
  std::vector<std::uint8_t> in_view(boxes.size(), 1), visible(boxes.size());
  pgl::host::DepthWorkspace workspace;
  for (std::uint32_t i = 0; i < 24; ++i) {
    pgl::View view = a_view(random);
    view.width = 200.0f;
    view.height = 150.0f;
    view.depth_order = random.below(2) ? pgl::DepthOrder::reversed : pgl::DepthOrder::conventional;
    const auto coverage = i % 2 == 0 ? pgl::Coverage::centres : pgl::Coverage::whole;
    const pgl::DepthMap size = pgl::depth_map_of(view, 1 + i / 2 % 3, coverage);
    const std::size_t texels = std::size_t{size.width} * size.height;
    const std::span<const std::uint32_t> occluders = std::span(all).first(1 + i);
    std::vector<pgl::Depth> hzm(pgl::hzm_texels(size), pgl::far_depth);
    pgl::host::rasterize_depth<std::uint32_t>(meshes, objects, vertices, triangles, map, occluders, view, size,
                                              workspace, std::span(hzm).first(texels));
    pgl::host::build_hzm(size, hzm);
    hash(hzm);
    for (const pgl::Box& box : boxes) {
      pgl::Depth nearest = 0;
      hash(pgl::project(box, view, nearest));
      hash(std::uint64_t{nearest});
    }
    pgl::host::cull_occluded(boxes, in_view, {}, view, size, hzm, i % 4, visible);
    hash(visible);
  }
}

void distribute_budget(Hash& hash) {
  Random random(7);
  constexpr std::size_t n = 20000;
  std::vector<float> areas(n), depths(n);
  std::vector<std::uint32_t> least(n), most(n), counts(n);
  for (std::size_t i = 0; i < n; ++i) {
    areas[i] = ieee::mul(random.number<float>(), 4096.0f);
    depths[i] = ieee::mul(random.number<float>(), 100.0f);
    least[i] = random.below(100);
    most[i] = least[i] + random.below(10000);
  }
  pgl::host::BudgetWorkspace workspace;
  for (const pgl::BudgetPolicy policy : {pgl::BudgetPolicy::exact, pgl::BudgetPolicy::fair, pgl::BudgetPolicy::paper})
    for (const float alpha : {1.0001f, 2.3f, 3.0f, 7.0f, 64.0f})
      for (const std::uint64_t budget : {std::uint64_t{1000}, std::uint64_t{300000}, std::uint64_t{20000000}}) {
        const pgl::BudgetOptions options{.budget = budget, .alpha = alpha, .policy = policy};
        pgl::host::distribute_budget(areas, depths, least, most, options, workspace, counts);
        hash(counts);
      }
  for (std::size_t i = 0; i < n; ++i) hash(pgl::log_weight(areas[i], depths[i], least[i], most[i], {.budget = 1000}));
}

template <class Real>
void build_ecol(Hash& hash) {
  Random random(8);
  for (const std::uint32_t side : {3u, 12u, 33u}) {
    const Surface s = a_surface(random, side);
    for (const auto metric : {pgl::CostMetric::quadric, pgl::CostMetric::melax, pgl::CostMetric::edge_length})
      for (const auto boundary : {pgl::BoundaryRule::locked, pgl::BoundaryRule::slide}) {
        const Order o = order_of<Real>(s, {.metric = metric, .boundary = boundary});
        for (const auto* values : {&o.ecol, &o.permute_v, &o.permute_t}) hash(*values);
        for (std::size_t k = o.left; k < o.map.size(); ++k) {
          hash(std::uint64_t{o.map[k]});
          hash(o.error[k]);
        }
      }
  }
}

void rearrange(Hash& hash) {
  Random random(9);
  const Scene scene = a_scene(random, 0);
  hash(scene.vertices);
  hash(scene.triangles);
  hash(scene.ecol);
  hash(scene.map);
}

/// lay_out, reform and gather, on a selection at random.
void reform_and_gather(Hash& hash) {
  Random random(10);
  const Scene scene = a_scene(random, 500);
  const std::size_t n = scene.objects.size();
  std::vector<std::uint32_t> least(n), most(n), counts(n), triangle_counts(n);
  std::vector<std::uint64_t> vertex_offsets(n + 1), triangle_offsets(n + 1);
  pgl::host::vertex_limits(scene.mesh_of_object, scene.meshes, scene.map, 4, least, most);
  for (std::size_t i = 0; i < n; ++i)
    counts[i] = random.below(4) == 0 ? 0 : least[i] + random.below(most[i] - least[i] + 1);
  pgl::host::lay_out(counts, scene.mesh_of_object, scene.meshes, scene.map, triangle_counts, vertex_offsets,
                     triangle_offsets);
  std::vector<pgl::Triangle<std::uint32_t>> triangles(triangle_offsets.back());
  pgl::host::ReformWorkspace<std::uint32_t> workspace;
  pgl::host::reform<std::uint32_t>(scene.meshes, scene.objects, scene.triangles, scene.ecol, counts, vertex_offsets,
                                   triangle_offsets, workspace, triangles);
  std::vector<glm::vec3> vertices(vertex_offsets.back());
  pgl::host::gather<glm::vec3, glm::vec3>(scene.meshes, scene.objects, scene.vertices, counts, vertex_offsets,
                                          vertices);
  hash(vertex_offsets);
  hash(triangle_offsets);
  hash(triangles);
  hash(vertices);
}

/// Brings the block of a selection up to the next one, in place, and as a copy.
template <class T, class Pack>
void update_block(Hash& hash, const std::vector<std::uint64_t>& before, const std::vector<std::uint64_t>& now,
                  std::vector<T>& block, Pack&& pack) {
  std::vector<std::uint64_t> delta_offsets(now.size());
  std::vector<T> additional(pgl::host::lay_out_delta(before, now, delta_offsets)), copied(now.back());
  pack(delta_offsets, additional);
  pgl::host::defragment<T>(before, now, delta_offsets, block, additional, copied);
  block.resize(std::max(before.back(), now.back()));
  pgl::host::DefragmentWorkspace workspace;
  pgl::host::defragment_in_place<T>(before, now, delta_offsets, additional, workspace, block);
  block.resize(now.back());
  hash(delta_offsets);
  hash(additional);
  hash(copied);
  hash(block);
}

/// limit_transfer, pack_delta and defragment, over frames that each begin with what the last one drew.
void stream(Hash& hash) {
  Random random(12);
  const Scene scene = a_scene(random, 2000);
  const std::size_t n = scene.objects.size();
  std::vector<std::uint32_t> least(n), most(n), wanted(n), counts(n), triangle_counts(n);
  std::vector<float> areas(n), depths(n);
  pgl::host::vertex_limits(scene.mesh_of_object, scene.meshes, scene.map, 4, least, most);
  std::vector<std::uint64_t> vertices_before(n + 1), triangles_before(n + 1), vertices_now(n + 1), triangles_now(n + 1);
  std::vector<glm::vec3> vertices, placed;
  std::vector<pgl::Triangle<std::uint32_t>> triangles;
  pgl::host::TransferWorkspace workspace;
  for (const std::uint32_t min_triangles : {0u, 4u, 31u, 400u})
    hash(pgl::host::least_cap(scene.meshes, scene.map, min_triangles, {}));
  for (std::uint32_t frame = 0; frame < 24; ++frame) {
    if (frame % 6 == 0)  // the camera jumps
      for (std::size_t i = 0; i < n; ++i) {
        areas[i] = ieee::mul(random.number<float>(), 4096.0f);
        depths[i] = ieee::mul(random.number<float>(), 100.0f);
        wanted[i] = random.below(3) == 0 ? 0 : least[i] + random.below(most[i] - least[i] + 1);
      }
    const pgl::TransferOptions options{.cap = 700000u * (frame % 7), .vertex_bytes = 12, .triangle_bytes = 6};
    const pgl::TransferTotals totals =
        pgl::host::limit_transfer(areas, depths, least, most, {.budget = 1u << 20, .pet = 0}, wanted, counts,
                                  scene.mesh_of_object, scene.meshes, scene.map, options, workspace, counts);
    for (const std::uint64_t total : {totals.bytes, totals.missing_bytes, totals.waiting}) hash(total);
    hash(counts);
    pgl::host::lay_out(counts, scene.mesh_of_object, scene.meshes, scene.map, triangle_counts, vertices_now,
                       triangles_now);
    const std::span<const glm::vec3> all_vertices = scene.vertices;
    const std::span<const pgl::Triangle<std::uint32_t>> all_triangles = scene.triangles;
    update_block(hash, vertices_before, vertices_now, vertices, [&](const auto& delta_offsets, auto& out) {
      pgl::host::pack_delta<glm::vec3>(scene.meshes, scene.objects, &pgl::Mesh::first_vertex, all_vertices,
                                       vertices_before, vertices_now, delta_offsets, out);
    });
    update_block(hash, vertices_before, vertices_now, placed, [&](const auto& delta_offsets, auto& out) {
      pgl::host::pack_placed_delta(scene.meshes, scene.objects, all_vertices, vertices_before, vertices_now,
                                   delta_offsets, std::span(out));
    });
    update_block(hash, triangles_before, triangles_now, triangles, [&](const auto& delta_offsets, auto& out) {
      pgl::host::pack_delta(scene.meshes, scene.objects, &pgl::Mesh::first_triangle, all_triangles, triangles_before,
                            triangles_now, delta_offsets, std::span(out));
    });
    vertices_before = vertices_now;
    triangles_before = triangles_now;
  }
}

/// balance and in_tile, on rectangles as project writes them and on any others.
void balance(Hash& hash) {
  Random random(13);
  constexpr std::size_t n = 20000;
  const std::vector<pgl::Box> boxes = some_boxes(random, n);
  std::vector<float> areas(n), depths(n);
  std::vector<pgl::ScreenBox> rectangles(n);
  std::vector<std::uint32_t> loads(n);
  std::vector<std::uint8_t> flags(n);
  pgl::host::BalanceWorkspace workspace;
  for (std::uint32_t i = 0; i < 24; ++i) {
    pgl::host::project(boxes, {}, a_view(random), areas, depths, rectangles);
    for (std::size_t k = 0; k < n; ++k) {
      loads[k] = random.below(i % 5 == 0 ? 0xffffffffu : 1000);
      if (random.below(16) == 0)
        rectangles[k] = {random.any<float>(), random.any<float>(), random.any<float>(), random.any<float>(), 1.0f};
      else if (random.below(4) > 0)  // most objects are small
        rectangles[k].x1 = ieee::add(rectangles[k].x0, 9.5f);
    }
    std::vector<std::uint32_t> weights(1 + i * 63 / 23);
    for (std::uint32_t& weight : weights) weight = 1 + random.below(i % 3 == 0 ? 1 : 1000000);
    const pgl::BalanceOptions options{
        .policy = i % 2 == 0 ? pgl::BalancePolicy::histogram : pgl::BalancePolicy::bisection,
        .threshold = ieee::mul(0.01f, static_cast<float>(i)),
        .bins = i % 4 == 0 ? 100u : 0u};
    std::vector<pgl::Tile> tiles(weights.size());
    std::vector<std::uint64_t> tile_loads(weights.size());
    pgl::host::balance(rectangles, loads, 1920, 1080, weights, options, workspace, tiles, tile_loads);
    for (const pgl::Tile& tile : tiles)
      for (const std::uint32_t side : {tile.x0, tile.y0, tile.x1, tile.y1}) hash(std::uint64_t{side});
    hash(tile_loads);
    pgl::host::in_tile(rectangles, loads, tiles[tiles.size() / 2], flags);
    hash(flags);
  }
}

/// error_scales and select_by_error in views of their own, as tiles have them, and what unify makes of these.
void select_by_error(Hash& hash) {
  Random random(13);
  const Scene scene = a_scene(random, 5000);
  const std::size_t n = scene.objects.size();
  std::vector<float> errors(scene.map.size()), scales(n), areas(n), depths(n);
  for (const pgl::Mesh& mesh : scene.meshes) {
    float error = 0;
    for (std::uint32_t k = mesh.max_vertices + 1; k-- > mesh.min_vertices;) {
      errors[mesh.first_map + (k - mesh.min_vertices)] = error;
      const float step = ieee::mul(random.number<float>(), 0.01f);
      error = ieee::max(error, ieee::add(error, step));  // never falls
    }
  }
  std::vector<std::uint32_t> least(n), most(n), counts, of_tile(n);
  std::vector<std::uint8_t> in_tile;
  pgl::host::vertex_limits(scene.mesh_of_object, scene.meshes, scene.map, 4, least, most);
  pgl::host::error_scales(scene.objects, scales);
  hash(scales);
  constexpr std::size_t tiles = 6;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    for (std::size_t i = 0; i < n; ++i) {
      areas[i] = random.below(3) == 0 ? 0.0f : ieee::mul(random.number<float>(), 100.0f);
      depths[i] = ieee::mul(random.number<float>(), 10.0f);
      in_tile.push_back(areas[i] > 0.0f || random.below(4) == 0 ? 1 : 0);
    }
    const pgl::View view = a_view(random);
    hash(pgl::pixels_per_unit(view));
    const pgl::BudgetTotals totals =
        pgl::host::select_by_error(areas, depths, least, most, scales, scene.mesh_of_object, scene.meshes, errors, view,
                                   {.threshold = 0.25f * static_cast<float>(1 + tile)}, of_tile);
    hash(totals.vertices);
    hash(of_tile);
    counts.insert(counts.end(), of_tile.begin(), of_tile.end());
  }
  for (const pgl::UnifyPolicy policy : {pgl::UnifyPolicy::quality, pgl::UnifyPolicy::performance})
    for (const bool by_flags : {false, true}) {
      hash(pgl::host::unify(counts, by_flags ? in_tile : std::vector<std::uint8_t>{}, tiles, policy, of_tile).vertices);
      hash(of_tile);
    }
}

/// The loops of feedback around times at random.
void feedback(Hash& hash) {
  Random random(14);
  constexpr std::size_t gpus = 11;
  pgl::WeightFeedback weights;
  pgl::BudgetFeedback budget;
  float threshold = 1.0f;
  std::vector<float> times(gpus);
  std::vector<std::uint64_t> loads(gpus);
  std::vector<std::uint32_t> shares(gpus);
  for (int frame = 0; frame < 3000; ++frame) {
    for (std::size_t i = 0; i < gpus; ++i) {
      times[i] = frame % 50 == 0 ? random.any<float>() : ieee::mul(random.number<float>(), 10.0f);
      loads[i] = random.below(1000000);
    }
    pgl::next_weights(weights, times, loads, {.dead_band = 0.001}, shares);
    const float longest = pgl::frame_milliseconds(times);
    hash(shares);
    for (const double pace : weights.paces) hash(pace);
    hash(pgl::next_budget(budget, longest, budget.budget, {}, {.dead_band = 0.001}));
    hash(threshold = pgl::next_threshold(threshold, longest, {}, {}));
  }
}

void print(const char* name, void (*rule)(Hash&)) {
  Hash hash;
  rule(hash);
  std::printf("%-24s %016" PRIx64 "\n", name, hash.value());
}

}  // namespace

int main() {
  print("ieee operations", ieee_operations);
  print("ieee expressions", ieee_expressions);
  print("ieee functions", ieee_functions);
  print("bounds", bounds);
  print("cull_frustum", cull_frustum);
  print("project", project);
  print("occluders", occluders);
  print("occlusion", occlusion);
  print("distribute_budget", distribute_budget);
  print("build_ecol float", build_ecol<float>);
  print("build_ecol double", build_ecol<double>);
  print("rearrange", rearrange);
  print("reform and gather", reform_and_gather);
  print("stream", stream);
  print("select_by_error", select_by_error);
  print("feedback", feedback);
  print("balance", balance);
}
