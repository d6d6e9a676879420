// SPDX-License-Identifier: MIT
// Occlusion culling as a whole, from boxes to the potentially visible set, against an exact picture of every triangle.
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "pgl/host/bounds.hpp"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/oriented_box.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/select_occluders.hpp"
#include "support/depth_scenes.hpp"
#include "support/exact_raster.hpp"
#include "support/meshes.hpp"
#include "support/numbers.hpp"

namespace {

using exact::DrawnTriangle;
using numbers::whole;
using pgl::Coverage;
using pgl::Depth;
using pgl::DepthMap;
using pgl::View;
using test::coin;
using Scene = test::DepthScene<std::uint32_t>;  // its list of occluders is what the chain chooses

// ---- the chain

struct Options {
  std::size_t occluders = 0;
  float threshold = 0;
};

struct Frame {
  std::vector<std::uint8_t> in_view, visible;
  std::vector<std::uint32_t> occluders;
};

Frame run(const Scene& s, const DepthMap& size, const Options& options) {
  const std::size_t meshes = s.meshes.size(), objects = s.objects.size();
  std::vector<pgl::Box> mesh_boxes(meshes), boxes(objects);
  for (std::size_t m = 0; m < meshes; ++m)
    mesh_boxes[m] =
        pgl::host::bounds(std::span(s.vertices).subspan(s.meshes[m].first_vertex, s.meshes[m].max_vertices));
  pgl::host::object_bounds(s.objects, mesh_boxes, boxes);
  std::vector<pgl::OrientedBox> oriented(meshes);
  std::vector<float> compactness(meshes);
  pgl::host::oriented_boxes<std::uint32_t>(s.meshes, s.vertices, s.triangles, s.map, oriented, compactness);
  std::vector<pgl::OccluderFace> faces(objects);
  pgl::host::occluder_faces(s.objects, oriented, compactness, faces);
  pgl::host::OccluderWorkspace occluder_workspace;
  std::vector<std::uint32_t> order(objects);
  pgl::host::compactness_order(faces, occluder_workspace, order);
  const std::size_t candidates = pgl::host::compact_objects(faces, order, options.threshold);

  Frame frame{std::vector<std::uint8_t>(objects), std::vector<std::uint8_t>(objects),
              std::vector<std::uint32_t>(options.occluders)};
  pgl::host::cull_frustum(boxes, s.view, frame.in_view);
  pgl::host::select_occluders(std::span(order).first(candidates), faces, frame.in_view, s.view, occluder_workspace,
                              frame.occluders);
  std::vector<Depth> hzm(pgl::hzm_texels(size), pgl::far_depth);
  pgl::host::DepthWorkspace depth_workspace;
  pgl::host::rasterize_depth<std::uint32_t>(s.meshes, s.objects, s.vertices, s.triangles, s.map, frame.occluders,
                                            s.view, size, depth_workspace,
                                            std::span(hzm).first(std::size_t{size.width} * size.height));
  pgl::host::build_hzm(size, hzm);
  pgl::host::cull_occluded(boxes, frame.in_view, frame.occluders, s.view, size, hzm, frame.visible);
  return frame;
}

// ---- the truth

using Drawn = std::vector<std::vector<DrawnTriangle>>;  // per object

Drawn drawn_objects(const Scene& s) {
  Drawn all;
  for (const pgl::Object& object : s.objects)
    all.push_back(exact::drawn_triangles<std::uint32_t>(s.view, object, s.meshes, s.vertices, s.triangles, s.map));
  return all;
}

/// Calls f(hx, hy), places in half pixels, for the samples that a triangle covers, edges included: pixel centres; for
/// whole coverage also pixel corners and the middles of pixel edges.
template <class F>
void for_each_sample(const DrawnTriangle& t, const View& view, Coverage coverage, F&& f) {
  if (coverage == Coverage::centres) {
    t.for_each_pixel([&](int i, int j) { f(2 * i + 1, 2 * j + 1); });
  } else {
    for (int y = 0; y <= 2 * static_cast<int>(view.height); ++y)
      for (int x = 0; x <= 2 * static_cast<int>(view.width); ++x)
        if (t.covers(x, y)) f(x, y);
  }
}

/// Whether some triangle of the others is strictly nearer than `t` there.
bool is_behind(const DrawnTriangle& t, const Drawn& drawn, const std::vector<std::uint32_t>& others, int x, int y) {
  for (const std::uint32_t other : others)
    for (const DrawnTriangle& o : drawn[other])
      if (o.covers(x, y) && o.depth().compare(t.depth(), x, y) < 0) return true;
  return false;
}

struct Share {
  int objects = 0, in_view = 0, culled = 0, culled_with_samples = 0, shown = 0;
};

/// Demands that at every sample of each culled object an occluder is strictly nearer, and what else a frame must keep.
Share check(const Scene& s, const DepthMap& size, const Options& options) {
  const Frame frame = run(s, size, options);
  Share share;
  share.objects = static_cast<int>(s.objects.size());
  std::vector<std::uint32_t> occluders;
  for (const std::uint32_t o : frame.occluders) {
    if (o == pgl::no_object) continue;
    RC_ASSERT(frame.in_view[o] == 1);
    RC_ASSERT(frame.visible[o] == 1);
    occluders.push_back(o);
  }
  bool culls = false;
  for (std::size_t i = 0; i < s.objects.size(); ++i) {
    RC_ASSERT(frame.visible[i] <= frame.in_view[i]);
    share.in_view += frame.in_view[i];
    culls = culls || frame.in_view[i] != frame.visible[i];
  }
  if (!culls) return share;
  RC_ASSERT(!occluders.empty());
  const Drawn drawn = drawn_objects(s);
  for (std::size_t i = 0; i < s.objects.size(); ++i) {
    if (frame.in_view[i] == frame.visible[i]) continue;
    ++share.culled;
    bool shows = false, has_samples = false;
    for (const DrawnTriangle& t : drawn[i])
      for_each_sample(t, s.view, size.coverage, [&](int x, int y) {
        has_samples = true;
        shows = shows || !is_behind(t, drawn, occluders, x, y);
      });
    share.culled_with_samples += has_samples;
    share.shown += shows;
  }
  RC_ASSERT(share.shown == 0);
  return share;
}

// ---- scenes

struct Palette {
  std::vector<std::uint32_t> meshes;
  std::uint32_t cube = 0;
};

test::TriangleMesh cube() {
  test::TriangleMesh m;
  for (int i = 0; i < 8; ++i)
    m.positions.emplace_back(i & 1 ? 1.0f : -1.0f, i & 2 ? 1.0f : -1.0f, i & 4 ? 1.0f : -1.0f);
  for (const auto& q : {std::array<std::uint32_t, 4>{0, 4, 6, 2},
                        {1, 3, 7, 5},
                        {0, 1, 5, 4},
                        {2, 6, 7, 3},
                        {0, 2, 3, 1},
                        {4, 5, 7, 6}}) {
    m.triangles.push_back({{q[0], q[1], q[2]}});
    m.triangles.push_back({{q[0], q[2], q[3]}});
  }
  return m;
}

/// Meshes of about the unit cube's size: closed, open, of one triangle, of none, without area, with odd vertices.
Palette add_palette(Scene& s) {
  Palette p;
  const auto add = [&](const test::TriangleMesh& mesh) { p.meshes.push_back(s.add_mesh(mesh)); };
  add(cube());
  p.cube = p.meshes[0];
  add(test::sphere(1));
  add(test::tetrahedron());
  test::TriangleMesh sheet = test::grid(2, 2);
  for (glm::vec3& v : sheet.positions) v -= glm::vec3(1, 1, 0);
  add(sheet);
  add(test::torus(5, 4));
  test::TriangleMesh one;
  one.positions = {{-1, -1, 0}, {1, -0.5f, 0.25f}, {0, 1, -0.5f}};
  one.triangles = {{{0, 1, 2}}};
  add(one);
  test::TriangleMesh line = one;  // no area
  line.positions[2] = 0.5f * (line.positions[0] + line.positions[1]);
  add(line);
  test::TriangleMesh spot = one;
  spot.positions = {glm::vec3(0.5f), glm::vec3(0.5f), glm::vec3(0.5f)};
  add(spot);
  test::TriangleMesh odd = cube();
  odd.positions[3].y = std::numeric_limits<float>::quiet_NaN();
  odd.positions[6].x = std::numeric_limits<float>::infinity();
  add(odd);
  add(test::TriangleMesh{});
  return p;
}

float unit(int low, int high) {
  return static_cast<float>(whole(low * 4096, high * 4096)) / 4096;
}

glm::mat3 rotation() {
  const glm::vec3 axis = numbers::point(numbers::Kind::plain) + glm::vec3(0, 0, 1e-3f);
  return glm::mat3(glm::rotate(glm::mat4(1), unit(-3, 3), axis));
}

/// A camera somewhere in a world of some scale, and where it is.
struct Camera {
  View view;
  glm::mat4 world_from_camera{1.0f};
  float scale = 1;
  float near = 1;
  bool parallel = false;
};

Camera any_camera() {
  Camera c;
  c.scale = std::pow(10.0f, static_cast<float>(whole(-6, 9)));
  c.near = c.scale * std::ldexp(1.0f, -whole(0, 6));
  const auto range = coin() ? pgl::DepthRange::zero_to_one : pgl::DepthRange::minus_one_to_one;
  const auto order = coin() ? pgl::DepthOrder::reversed : pgl::DepthOrder::conventional;
  const float far = c.near * std::ldexp(1.0f, whole(4, 14));
  c.view = test::depth_camera(16, 16, c.near, far, range, order, std::ldexp(1.0f, whole(-1, 1)));
  c.parallel = whole(0, 4) == 0;
  if (c.parallel) {
    // Window depth from 0 to 1 over [near, far], and a picture as wide as the perspective one is at 8 near.
    glm::mat4& m = c.view.clip_from_world;
    const double s = range == pgl::DepthRange::minus_one_to_one ? 2 : 1,
                 turn = order == pgl::DepthOrder::reversed ? -1 : 1;
    const double depth = static_cast<double>(far) - static_cast<double>(c.near);
    m[0].x /= 8 * c.near;
    m[1].y /= 8 * c.near;
    m[2] = glm::vec4(0, 0, static_cast<float>(-turn * s / depth), 0);
    m[3] = glm::vec4(0, 0,
                     static_cast<float>(-turn * s * static_cast<double>(c.near) / depth + (turn < 0 ? 1
                                                                                           : s == 2 ? -1
                                                                                                    : 0)),
                     1);
    c.view.near_depth = 0.5f;
  }
  if (coin()) {
    const glm::mat3 turned = rotation();
    c.world_from_camera = glm::mat4(turned);
    c.world_from_camera[3] = glm::vec4(c.scale * unit(-8, 8), c.scale * unit(-8, 8), c.scale * unit(-8, 8), 1);
    const glm::mat4 camera_from_world =
        glm::mat4(glm::transpose(turned)) * glm::translate(glm::mat4(1), -glm::vec3(c.world_from_camera[3]));
    c.view.clip_from_world = c.view.clip_from_world * camera_from_world;
  }
  return c;
}

/// Places a mesh with its centre at a place of the picture, (-1 to 1) twice, and a distance, its half sides given.
void place(Scene& s, const Camera& c, std::uint32_t mesh, float x, float y, float distance, glm::vec3 half,
           const glm::mat3& turn) {
  const float reach = c.parallel ? 8 * c.near : distance;
  // The camera is square; slope is in its matrix, so a quarter more or less of the way does not matter.
  const glm::vec3 centre(x * reach, y * reach, -distance);
  glm::mat4 m = glm::translate(glm::mat4(1), centre) * glm::mat4(turn) * glm::scale(glm::mat4(1), half);
  m = c.world_from_camera * m;
  s.objects.push_back({.mesh = mesh, .transform = glm::mat4x3(m)});
}

/// Anything anywhere: around the eye, through the near plane, behind, beyond; thin, flat, huge, tiny.
void place_anything(Scene& s, const Camera& c, const Palette& palette) {
  const std::uint32_t mesh =
      palette.meshes[static_cast<std::size_t>(whole(0, static_cast<int>(palette.meshes.size()) - 1))];
  float distance = c.near * std::ldexp(1 + unit(0, 1), whole(-2, 9));
  const int where = whole(0, 11);
  if (where == 0) distance = -distance;
  if (where == 1) distance = 0;
  if (where == 2) distance = c.near;
  glm::vec3 half(std::abs(distance) * std::ldexp(1.0f, -whole(0, 8)));
  if (where == 3) half *= 64;
  for (int axis = 0; axis < 3; ++axis)
    if (whole(0, 3) == 0) half[axis] *= std::ldexp(1.0f, -whole(1, 12));
  if (whole(0, 9) == 0) half[whole(0, 2)] = 0;
  if (whole(0, 9) == 0) half.x = -half.x;
  place(s, c, mesh, unit(-1, 1) * 1.25f, unit(-1, 1) * 1.25f, distance, half, coin() ? glm::mat3(1) : rotation());
}

/// Walls, screens and boulders not far from the camera, and things behind them.
void place_yard(Scene& s, const Camera& c, const Palette& palette, int things) {
  const int screens = whole(1, 3);
  for (int i = 0; i < screens; ++i) {
    const float distance = c.near * std::ldexp(1 + unit(0, 1), 2);
    const float reach = c.parallel ? 8 * c.near : distance;
    const bool boulder = whole(0, 3) == 0;
    const glm::vec3 half = reach * glm::vec3(0.5f + unit(0, 1), 0.5f + unit(0, 1), boulder ? 0.5f : 0.01f);
    place(s, c,
          palette.meshes[boulder  ? static_cast<std::size_t>(whole(0, 1))
                         : coin() ? 0
                                  : 3],
          unit(-1, 1) * 0.5f, unit(-1, 1) * 0.5f, distance, half, coin() ? glm::mat3(1) : rotation());
  }
  for (int i = 0; i < things; ++i) {
    const float distance = c.near * std::ldexp(1 + unit(0, 1), whole(3, 6));
    const float reach = c.parallel ? 8 * c.near : distance;
    const glm::vec3 half = reach * std::ldexp(1.0f, -whole(3, 6)) * glm::vec3(1, unit(0, 1), unit(0, 1));
    place(s, c, palette.meshes[static_cast<std::size_t>(whole(0, 5))], unit(-1, 1), unit(-1, 1), distance, half,
          coin() ? glm::mat3(1) : rotation());
  }
}

/// Another size of the picture: the view's matrix knows nothing of it.
DepthMap any_size(View& view, int most) {
  view.width = static_cast<float>(whole(0, 11) == 0 ? 1 : whole(1, most));
  view.height = static_cast<float>(whole(0, 11) == 0 ? 1 : whole(1, most));
  return pgl::depth_map_of(view, static_cast<std::uint32_t>(coin() ? 1 : whole(1, 4)),
                           whole(0, 2) ? Coverage::centres : Coverage::whole);
}

Options any_options(const Scene& s) {
  const int n = static_cast<int>(s.objects.size());
  const int k = whole(0, 3);
  return {static_cast<std::size_t>(k == 0   ? n + whole(0, 3)
                                   : k == 1 ? whole(0, n)
                                            : whole(0, 6)),
          whole(0, 3) == 0 ? unit(0, 1) : 0};
}

RC_GTEST_PROP(OcclusionProps, noCulledObjectShowsInAScene, ()) {
  Share sum;
  for (int repeat = 0; repeat < 12; ++repeat) {
    Scene s;
    const Palette palette = add_palette(s);
    Camera c = any_camera();
    s.view = c.view;
    if (whole(0, 3) > 0) place_yard(s, c, palette, whole(0, 20));
    const int others = whole(0, 10);
    for (int i = 0; i < others; ++i) place_anything(s, c, palette);
    const DepthMap size = any_size(s.view, 40);
    const Share share = check(s, size, any_options(s));
    sum.in_view += share.in_view;
    sum.culled += share.culled;
    sum.culled_with_samples += share.culled_with_samples;
  }
  RC_CLASSIFY(sum.culled > 0, "some culled");
  RC_CLASSIFY(sum.culled_with_samples > 0, "some culled that have samples");
  RC_CLASSIFY(sum.culled * 10 > sum.in_view, "more than a tenth of what is in view culled");
  RC_CLASSIFY(sum.culled * 4 > sum.in_view, "more than a quarter of what is in view culled");
}

RC_GTEST_PROP(OcclusionProps, noCulledObjectShowsWhateverTheViewAndTheTriangles, ()) {
  int culled = 0;
  for (int repeat = 0; repeat < 40; ++repeat) {
    Scene s = test::any_depth_scene<std::uint32_t>();
    // Small copies of what there is, so that something may be hidden.
    const std::size_t objects = s.objects.size();
    for (std::size_t i = 0; i < objects; ++i) {
      pgl::Object copy = s.objects[i];
      for (int column = 0; column < 3; ++column) copy.transform[column] *= std::ldexp(1.0f, -whole(0, 8));
      const glm::vec3 p = numbers::point_near(s.view, numbers::Kind::plain);
      if (coin()) copy.transform[3] = p;
      s.objects.push_back(copy);
    }
    const DepthMap size = any_size(s.view, 24);
    culled += check(s, size, any_options(s)).culled;
  }
  RC_CLASSIFY(culled > 0, "some culled");
}

/// In scenes that suit it the chain finds most of what is hidden: a test in which nothing is culled would say nothing.
TEST(OcclusionProps, FindsMostOfWhatIsHiddenInYards) {
  int hidden = 0, culled = 0, in_view = 0;
  EXPECT_TRUE(rc::check([&] {
    Scene s;
    const Palette palette = add_palette(s);
    Camera c = any_camera();
    s.view = c.view;
    place_yard(s, c, palette, 20);
    s.view.width = s.view.height = 64;
    const DepthMap size = pgl::depth_map_of(s.view);
    const Options options{5, 0};
    const Share share = check(s, size, options);
    const Drawn drawn = drawn_objects(s);
    exact::Picture picture(s.view);
    for (const auto& triangles : drawn) picture.draw(triangles);
    const Frame frame = run(s, size, options);
    for (std::size_t i = 0; i < s.objects.size(); ++i) {
      bool has_samples = false;
      for (const DrawnTriangle& t : drawn[i]) t.for_each_pixel([&](int, int) { has_samples = true; });
      if (frame.in_view[i] != 0 && has_samples && picture.hides(drawn[i])) ++hidden;
    }
    in_view += share.in_view;
    culled += share.culled_with_samples;
  }));
  RecordProperty("in_view", in_view);
  RecordProperty("hidden", hidden);
  RecordProperty("culled", culled);
  EXPECT_GT(hidden, in_view / 5);
  EXPECT_GT(culled, hidden / 2);
}

/// Pictures of any shape, the largest that is asked for among them: a wall, and small things before and behind it.
TEST(OcclusionProps, NoCulledObjectShowsInNarrowSingleAndLargePictures) {
  for (const auto& [width, height] : {std::pair{1, 1}, {7, 1333}, {1333, 7}, {1, 500}, {4096, 4096}}) {
    Share sum;
    const bool large = width == 4096;
    EXPECT_TRUE(rc::check([&, w = width, h = height] {
      if (large && sum.objects > 60) return;
      Scene s;
      const Palette palette = add_palette(s);
      Camera c = any_camera();
      s.view = c.view;
      place(s, c, palette.cube, 0, 0, 4 * c.near, (c.parallel ? 8 : 4) * c.near * glm::vec3(0.75f, 0.75f, 0.125f),
            glm::mat3(1));
      for (int i = 0; i < 20; ++i) {
        const float distance = c.near * std::ldexp(1 + unit(0, 1), whole(1, 6));
        const float reach = c.parallel ? 8 * c.near : distance;
        place(s, c, palette.meshes[static_cast<std::size_t>(whole(0, 5))], unit(-1, 1), unit(-1, 1), distance,
              reach * std::ldexp(1.0f, large ? -whole(8, 9) : -whole(3, 8)) * glm::vec3(1, unit(0, 1), 1), rotation());
      }
      s.view.width = static_cast<float>(w);
      s.view.height = static_cast<float>(h);
      const Share share = check(s, pgl::depth_map_of(s.view, coin() ? 1 : 2), {4, 0});
      sum.objects += share.objects;
      sum.culled += share.culled;
    }));
    EXPECT_GT(sum.culled, width * height == 1 ? -1 : sum.objects / 50) << width << " x " << height;
  }
}

}  // namespace
