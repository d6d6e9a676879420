// SPDX-License-Identifier: MIT
// Occlusion culling as a whole, from boxes to the potentially visible set, against an exact picture of every triangle.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/select_occluders.hpp"
#include "support/depth_scenes.hpp"
#include "support/exact_raster.hpp"
#include "support/numbers.hpp"
#include "support/occlusion_scenes.hpp"

namespace {

using exact::DrawnTriangle;
using numbers::whole;
using pgl::Coverage;
using pgl::Depth;
using pgl::DepthMap;
using pgl::View;
using test::coin;
using Scene = test::OcclusionScene;
using test::Camera;
using test::Palette;
using test::unit;

// ---- the chain

struct Options {
  std::size_t occluders = 0;
  float threshold = 0;
  std::uint32_t refinement = 0;
};

struct Frame {
  std::vector<std::uint8_t> in_view, visible;
  std::vector<std::uint32_t> occluders;
};

Frame run(const Scene& s, const DepthMap& size, const Options& options) {
  const test::OcclusionModel model = test::prepared(s, options.threshold);
  const std::size_t objects = s.objects.size();
  Frame frame{std::vector<std::uint8_t>(objects), std::vector<std::uint8_t>(objects),
              std::vector<std::uint32_t>(options.occluders)};
  pgl::host::OccluderWorkspace occluder_workspace;
  pgl::host::DepthWorkspace depth_workspace;
  std::vector<Depth> hzm(pgl::hzm_texels(size), pgl::far_depth);
  pgl::host::cull_frustum(model.boxes, s.view, frame.in_view);
  pgl::host::select_occluders(model.candidates, model.faces, frame.in_view, s.view, occluder_workspace,
                              frame.occluders);
  pgl::host::rasterize_depth<std::uint32_t>(s.meshes, s.objects, s.vertices, s.triangles, s.map, frame.occluders,
                                            s.view, size, depth_workspace,
                                            std::span(hzm).first(std::size_t{size.width} * size.height));
  pgl::host::build_hzm(size, hzm);
  pgl::host::cull_occluded(model.boxes, frame.in_view, frame.occluders, s.view, size, hzm, options.refinement,
                           frame.visible);
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

Options any_options(const Scene& s) {
  const int n = static_cast<int>(s.objects.size());
  const int k = whole(0, 3);
  return {static_cast<std::size_t>(k == 0   ? n + whole(0, 3)
                                   : k == 1 ? whole(0, n)
                                            : whole(0, 6)),
          whole(0, 3) == 0 ? unit(0, 1) : 0, static_cast<std::uint32_t>(whole(0, 3))};
}

TEST(OcclusionProps, NoCulledObjectShowsInAScene) {
  int cases = 0, with_culled = 0;
  EXPECT_TRUE(rc::check([&] {
    Share sum;
    for (int repeat = 0; repeat < 12; ++repeat) {
      Scene s;
      const Palette palette = test::add_palette(s);
      Camera c = test::any_camera();
      s.view = c.view;
      if (whole(0, 3) > 0) test::place_yard(s, c, palette, whole(0, 20));
      const int others = whole(0, 10);
      for (int i = 0; i < others; ++i) test::place_anything(s, c, palette);
      // Surfaces that coincide: the same objects once more, or the same mesh elsewhere along some axis.
      const int copies = s.objects.empty() ? 0 : whole(0, 4);
      for (int i = 0; i < copies; ++i) {
        pgl::Object copy = s.objects[static_cast<std::size_t>(whole(0, static_cast<int>(s.objects.size()) - 1))];
        if (coin()) copy.transform[3] += copy.transform[whole(0, 2)] * std::ldexp(1.0f, -whole(0, 20));
        s.objects.push_back(copy);
      }
      const DepthMap size = test::any_size(s.view, 40);
      const Share share = check(s, size, any_options(s));
      sum.in_view += share.in_view;
      sum.culled += share.culled;
      sum.culled_with_samples += share.culled_with_samples;
    }
    ++cases;
    with_culled += sum.culled_with_samples > 0;
    RC_CLASSIFY(sum.culled > 0, "some culled");
    RC_CLASSIFY(sum.culled_with_samples > 0, "some culled that have samples");
    RC_CLASSIFY(sum.culled * 10 > sum.in_view, "more than a tenth of what is in view culled");
    RC_CLASSIFY(sum.culled * 4 > sum.in_view, "more than a quarter of what is in view culled");
  }));
  EXPECT_GE(with_culled, cases / 4);
}

/// A triangle that hides much of the picture, if the view is one that can be undone: its corners are far beside the
/// picture, some way before the camera.
void add_screen(Scene& s) {
  const glm::dmat4 world_from_clip = glm::inverse(glm::dmat4(s.view.clip_from_world));
  const double w = static_cast<double>(s.view.near_depth) * std::ldexp(1.0, whole(0, 6));
  const double z = whole(-16, 16) / 16.0;
  std::vector<glm::vec3> corners;
  for (const glm::dvec2 at : {glm::dvec2(-5, -4), glm::dvec2(5, -3), glm::dvec2(0.5, 5)}) {
    const glm::dvec4 p = world_from_clip * glm::dvec4(w * at.x, w * at.y, w * z, w);
    corners.emplace_back(glm::dvec3(p) / p.w);
  }
  const std::vector<pgl::Triangle<std::uint32_t>> triangles{{{0, 1, 2}}};
  s.objects.push_back({.mesh = s.add_mesh(corners, triangles)});
}

TEST(OcclusionProps, NoCulledObjectShowsWhateverTheViewAndTheTriangles) {
  int cases = 0, with_culled = 0;
  EXPECT_TRUE(rc::check([&] {
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
      if (whole(0, 3) > 0) add_screen(s);
      const DepthMap size = test::any_size(s.view, 24);
      culled += check(s, size, any_options(s)).culled;
    }
    ++cases;
    with_culled += culled > 0;
    RC_CLASSIFY(culled > 0, "some culled");
  }));
  EXPECT_GE(with_culled, cases / 20);
}

/// In scenes that suit it the chain finds a good part of what is hidden: a test in which nothing is culled would say
/// nothing.
TEST(OcclusionProps, FindsAGoodPartOfWhatIsHiddenInYards) {
  int hidden = 0, culled = 0, in_view = 0;
  EXPECT_TRUE(rc::check([&] {
    Scene s;
    const Palette palette = test::add_palette(s);
    Camera c = test::any_camera();
    s.view = c.view;
    test::place_yard(s, c, palette, 20);
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
  EXPECT_GT(culled, hidden / 3);
}

/// Pictures of any shape, the largest that is asked for among them: a wall, and small things before and behind it.
TEST(OcclusionProps, NoCulledObjectShowsInNarrowSingleAndLargePictures) {
  for (const auto& [width, height] : {std::pair{1, 1}, {7, 1333}, {1333, 7}, {1, 500}, {4096, 4096}}) {
    Share sum;
    const bool large = width == 4096;
    EXPECT_TRUE(rc::check([&, w = width, h = height] {
      if (large && sum.objects > 60) return;
      Scene s;
      const Palette palette = test::add_palette(s);
      Camera c = test::any_camera();
      s.view = c.view;
      test::place(s, c, palette.cube, 0, 0, 4 * c.near, (c.parallel ? 8 : 4) * c.near * glm::vec3(0.75f, 0.75f, 0.125f),
                  glm::mat3(1));
      for (int i = 0; i < 20; ++i) {
        const float distance = c.near * std::ldexp(1 + unit(0, 1), whole(1, 6));
        const float reach = c.parallel ? 8 * c.near : distance;
        test::place(s, c, palette.meshes[static_cast<std::size_t>(whole(0, 5))], unit(-1, 1), unit(-1, 1), distance,
                    reach * std::ldexp(1.0f, large ? -whole(8, 9) : -whole(3, 8)) * glm::vec3(1, unit(0, 1), 1),
                    test::rotation());
      }
      s.view.width = static_cast<float>(w);
      s.view.height = static_cast<float>(h);
      const Share share = check(s, pgl::depth_map_of(s.view, coin() ? 1 : 2), {4, 0});
      sum.objects += share.objects;
      sum.culled += share.culled;
    }));
    EXPECT_GT(sum.culled, width * height == 1 ? -1 : sum.objects / 200) << width << " x " << height;
  }
}

}  // namespace
