// SPDX-License-Identifier: MIT
// What occlusion culling finds of what is hidden, on a way around and through a scene, by choice and number of
// occluders, size of the depth map, threshold of compactness and refinement of the test: with the time of each step,
// and what the released vertices buy. One CSV row each, sums over the cameras; scripts/occlusion.py makes the tables
// and pictures of them.
#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "pgl/gather.hpp"
#include "pgl/host/build_hzm.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/cull_occluded.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/keep_flagged.hpp"
#include "pgl/host/project.hpp"
#include "pgl/host/rasterize_depth.hpp"
#include "pgl/host/select_occluders.hpp"
#include "scene/build_model.hpp"
#include "scene/for_each.hpp"
#include "scene/import.hpp"
#include "scene/plant.hpp"
#include "scene/weld.hpp"
#include "timing.hpp"
#include "viewer/camera.hpp"

namespace {

using pgl::Box;
using pgl::Depth;
using pgl::DepthMap;
using pgl::View;
using pgl::scene::MeshData;
using pgl::scene::Model;
using pgl::viewer::Camera;

constexpr double path_frames = 600;  ///< of the whole way

/// Milliseconds of body(): the least of some.
template <class Body>
double least_ms(int repetitions, Body&& body) {
  return pgl::bench::least_shared_ms(repetitions, pgl::host::thread_count(), body);
}

// ---- the way --------------------------------------------------------------------------------------------------------

enum class Place { outside, inside };

struct Site {
  Box box;
  glm::dvec3 up{0.0, 1.0, 0.0};
  bool plant = false;
};

/// Outside: around, from a little above, the whole scene in the picture. Inside: along the longer side, low, the gaze
/// turning left and right.
Camera camera_at(const Site& site, Place place, double t, double aspect) {
  const glm::dvec3 side = pgl::viewer::side_of(site.up), front = pgl::viewer::front_of(site.up);
  if (place == Place::outside) {
    const double angle = 2.0 * glm::pi<double>() * (t + 0.07);
    return pgl::viewer::fit_camera(site.box, std::cos(angle) * side + std::sin(angle) * front + 0.4 * site.up, site.up,
                                   45.0, aspect);
  }
  const glm::dvec3 low(site.box.min), high(site.box.max), size = high - low;
  glm::dvec3 along = glm::abs(side), across = glm::abs(front);
  if (glm::dot(size, across) > glm::dot(size, along) && !site.plant) std::swap(along, across);
  const double length = glm::dot(size, along);
  glm::dvec3 eye = low + along * ((-0.1 + 0.8 * t) * length);
  if (site.plant) {  // in the aisle between pipe rack and frames of the middle row
    const double rows = std::max(1.0, std::round((size.y - 1.0) / 26.0));
    const double row = std::floor(rows / 2.0);
    eye.y = -13.0 * rows + 26.0 * row + (std::fmod(row, 2.0) > 0.0 ? 7.0 : 19.0);
    eye.z = 1.7;
  } else {
    eye += across * (0.5 * glm::dot(size, across)) + site.up * (0.3 * glm::dot(size, site.up));
  }
  Camera camera;
  camera.eye = eye;
  camera.up = site.up;
  camera.fov_degrees = 60.0;
  const double yaw = glm::radians(50.0) * std::sin(2.0 * glm::pi<double>() * 2.0 * t);
  camera.target = eye + length * 0.2 * (std::cos(yaw) * along + std::sin(yaw) * across);
  return camera;
}

// ---- the truth ------------------------------------------------------------------------------------------------------

/// The nearest object at every pixel's centre, by plain double arithmetic; no code of the library but transform_point.
class IdPicture {
 public:
  std::vector<std::uint64_t> nearest;  ///< depth, then object
  std::vector<std::uint8_t> covers;    ///< per object: a sample, in front of others or not
  std::vector<std::uint32_t> samples;  ///< per object: that show it
  static constexpr std::uint64_t nothing = ~std::uint64_t{0};

  template <class Index>
  void draw(const Model<Index>& model, std::span<const std::uint8_t> in_view, const View& view) {
    const auto width = static_cast<std::size_t>(view.width), height = static_cast<std::size_t>(view.height);
    nearest.assign(width * height, nothing);
    covers.assign(model.objects.size(), 0);
    samples.assign(model.objects.size(), 0);
    std::vector<std::vector<glm::dvec4>> scratch(pgl::host::thread_count());
    pgl::host::parallel_for(model.objects.size(), 16, [&](std::size_t i) {
      if (!in_view[i]) return;
      const pgl::Object& object = model.objects[i];
      const pgl::Mesh& mesh = model.meshes[object.mesh];
      auto& clip = scratch[pgl::host::thread_index()];
      clip.resize(mesh.max_vertices);
      for (std::uint32_t v = 0; v < mesh.max_vertices; ++v)
        clip[v] = glm::dmat4(view.clip_from_world) *
                  glm::dvec4(pgl::transform_point(object.transform, model.vertices[mesh.first_vertex + v]), 1.0);
      const std::uint32_t triangles = pgl::triangles_at(mesh, model.map.data(), mesh.max_vertices);
      for (std::uint32_t t = 0; t < triangles; ++t) {
        const auto& v = model.triangles[mesh.first_triangle + t].v;
        draw_clipped(clip[v[0]], clip[v[1]], clip[v[2]], view, static_cast<std::uint32_t>(i));
      }
    });
    for (const std::uint64_t texel : nearest)
      if (texel != nothing) ++samples[texel & 0xffffff];
  }

 private:
  static glm::dvec3 place(const glm::dvec4& p, const View& view) {
    return {(p.x / p.w + 1.0) * 0.5 * view.width, (p.y / p.w + 1.0) * 0.5 * view.height, (p.z / p.w + 1.0) * 0.5};
  }

  void draw_clipped(const glm::dvec4& a, const glm::dvec4& b, const glm::dvec4& c, const View& view, std::uint32_t id) {
    const glm::dvec4 corners[3] = {a, b, c};
    glm::dvec4 kept[4];
    int count = 0;
    for (int k = 0; k < 3; ++k) {
      const glm::dvec4 &p = corners[k], &q = corners[(k + 1) % 3];
      const double dp = p.z + p.w, dq = q.z + q.w;
      if (dp > 0.0) kept[count++] = p;
      if ((dp > 0.0) != (dq > 0.0)) kept[count++] = p + (q - p) * (dp / (dp - dq));
    }
    for (int k = 2; k < count; ++k)
      draw_triangle(place(kept[0], view), place(kept[k - 1], view), place(kept[k], view), view, id);
  }

  void draw_triangle(const glm::dvec3& a, glm::dvec3 b, glm::dvec3 c, const View& view, std::uint32_t id) {
    double area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if (!(std::abs(area) > 0.0)) return;
    if (area < 0.0) {
      std::swap(b, c);
      area = -area;
    }
    const auto first = [](double x) { return std::max(0.0, std::ceil(x - 0.5)); };
    const auto last = [](double x, float size) {
      return std::min(static_cast<double>(size) - 1.0, std::floor(x - 0.5));
    };
    const double x0 = first(std::min({a.x, b.x, c.x})), x1 = last(std::max({a.x, b.x, c.x}), view.width);
    const double y0 = first(std::min({a.y, b.y, c.y})), y1 = last(std::max({a.y, b.y, c.y}), view.height);
    if (!(x0 <= x1 && y0 <= y1)) return;
    const double gx = ((b.z - a.z) * (c.y - a.y) - (c.z - a.z) * (b.y - a.y)) / area;
    const double gy = ((c.z - a.z) * (b.x - a.x) - (b.z - a.z) * (c.x - a.x)) / area;
    const glm::dvec3* const p[3] = {&a, &b, &c};
    bool any = false;
    for (double y = y0; y <= y1; ++y) {
      // The span of the row that is inside all three edges.
      double from = x0, to = x1;
      for (int k = 0; k < 3; ++k) {
        const glm::dvec3 &s = *p[k], &e = *p[(k + 1) % 3];
        const double dx = e.x - s.x, dy = e.y - s.y;
        const double value = dx * (y + 0.5 - s.y) + dy * s.x;  // inside: value - dy * x >= 0
        if (dy > 0.0)
          to = std::min(to, std::floor(value / dy - 0.5));
        else if (dy < 0.0)
          from = std::max(from, std::ceil(value / dy - 0.5));
        else if (value < 0.0)
          to = -1.0;
      }
      if (!(from <= to)) continue;
      any = true;
      std::uint64_t* const row = nearest.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(view.width);
      for (double x = from; x <= to; ++x) {
        const double depth = std::clamp(a.z + gx * (x + 0.5 - a.x) + gy * (y + 0.5 - a.y), 0.0, 1.0 - 0x1p-39);
        const std::uint64_t texel = (static_cast<std::uint64_t>(depth * 0x1p40) << 24) | id;
        std::atomic_ref<std::uint64_t> at(row[static_cast<std::size_t>(x)]);
        std::uint64_t known = at.load(std::memory_order_relaxed);
        while (texel < known && !at.compare_exchange_weak(known, texel, std::memory_order_relaxed)) {
        }
      }
    }
    if (any) std::atomic_ref<std::uint8_t>(covers[id]).store(1, std::memory_order_relaxed);
  }
};

// ---- the study ------------------------------------------------------------------------------------------------------

/// How occluders are chosen.
enum class Choice {
  selected,   ///< select_occluders among the compact objects in view
  temporal,   ///< half of them among those that the last frame showed, then half among those not hidden by the first
  last_all,   ///< all that the last frame showed
  most_seen,  ///< those that show the most samples, which only the truth knows
  all         ///< all in view: what the test finds at best
};
constexpr const char* choice_names[] = {"selected", "temporal", "all of last", "most seen", "all"};

struct Way {
  Choice choice = Choice::selected;
  std::size_t occluders = 20;
  std::uint32_t scale = 1;
  float threshold = 0.5f;
  std::uint32_t refinement = 0;
};

/// Sums over cameras.
struct Sums {
  double cameras = 0, in_view = 0, seen = 0, hidden = 0, no_sample = 0;
  double culled = 0, culled_hidden = 0, culled_no_sample = 0, wrong = 0;
  double culled_occluders = 0;  ///< of the culled: those that hide others, but are hidden themselves
  double occluder_triangles = 0;
  std::array<double, 4> ms{};  ///< choosing, depth, map, test
  double vertices_in_view = 0, vertices_culled = 0, budget = 0;
  std::array<double, 2> seen_vertices{}, seen_triangles{}, seen_drawn{};  ///< at the budget, without and with culling
};

template <class Index>
class Study {
 public:
  Study(std::string name, const Model<Index>& model, const Site& site, std::uint32_t width, std::uint32_t height)
      : name_(std::move(name)), model_(model), site_(site), width_(width), height_(height) {
    const std::size_t n = model.objects.size();
    in_view_.resize(n);
    kept_.resize(n);
    areas_.resize(n);
    depths_.resize(n);
    least_.resize(n);
    most_.resize(n);
    among_.resize(n);
    for (auto& counts : counts_) counts.resize(n);
    std::vector<std::uint32_t> mesh_of_object(n);
    for (std::size_t i = 0; i < n; ++i) mesh_of_object[i] = model.objects[i].mesh;
    pgl::host::vertex_limits(mesh_of_object, model.meshes, model.map, 0, least_, most_);
    for (std::size_t i = 0; i < n; ++i) triangles_ += full_triangles(i);
  }

  void run(std::string_view table, Place place, int cameras, const std::vector<Way>& ways) {
    std::vector<Sums> sums(ways.size());
    std::array<Sums, 2> limits;
    const bool effect = table == "effect";
    for (int c = 0; c < cameras; ++c) {
      const double t = (c + 0.5) / cameras;
      look(place, t);
      picture_.draw(model_, in_view_, view_);
      drawn_.reset();
      for (std::size_t w = 0; w < ways.size(); ++w) {
        if (ways[w].choice == Choice::temporal || ways[w].choice == Choice::last_all) {
          see_last_frames(place, t, ways[w]);
          look(place, t);
          last_ = kept_;
        }
        occlude(ways[w], effect ? 1 : 3, sums[w]);
        count(sums[w]);
        if (effect && ways[w].choice == Choice::selected) share_out(sums[w]);
        if (effect && ways[w].choice == Choice::all && ways[w].refinement == 0) find_limits(limits);
      }
      std::fprintf(stderr, "%s, %s: %d of %d\n", name_.c_str(), place_name(place), c + 1, cameras);
    }
    for (std::size_t w = 0; w < ways.size(); ++w)
      print(table, place, choice_names[static_cast<int>(ways[w].choice)], ways[w], std::to_string(ways[w].refinement),
            sums[w]);
    if (effect) {
      print(table, place, "every texel", {Choice::all}, "", limits[0]);
      print(table, place, "every sample", {Choice::all}, "", limits[1]);
    }
  }

  static void print_header() {
    std::puts(
        "table,scene,objects,triangles,place,choice,occluders,scale,threshold,refinement,threads,cameras,in_view,seen,"
        "hidden,no_sample,culled,culled_hidden,culled_no_sample,wrong,culled_occluders,occluder_triangles,ms_select,"
        "ms_depth,ms_hzm,ms_test,vertices_in_view,vertices_culled,budget,seen_vertices_off,seen_vertices_on,"
        "seen_triangles_off,seen_triangles_on,seen_drawn_off,seen_drawn_on");
  }

 private:
  static const char* place_name(Place place) { return place == Place::outside ? "outside" : "inside"; }

  std::uint32_t full_triangles(std::size_t object) const {
    const pgl::Mesh& mesh = model_.meshes[model_.objects[object].mesh];
    return pgl::triangles_at(mesh, model_.map.data(), mesh.max_vertices);
  }

  View view_at(Place place, double t) const {
    return pgl::viewer::view_of(camera_at(site_, place, t, static_cast<double>(width_) / height_), site_.box,
                                static_cast<int>(width_), static_cast<int>(height_));
  }

  void look(Place place, double t) {
    view_ = view_at(place, t);
    pgl::host::cull_frustum(model_.object_boxes, view_, in_view_);
  }

  /// The three frames before the one at t, by the same choice: kept_ becomes what the last of them showed, all objects
  /// before the first of them.
  void see_last_frames(Place place, double t, Way way) {
    if (way.choice == Choice::last_all) way = {Choice::temporal, 4000, 1, 0.0f, way.refinement};
    std::ranges::fill(kept_, std::uint8_t{1});
    for (int frame = 3; frame > 0; --frame) {
      look(place, t - frame / path_frames);
      Sums unused;
      occlude(way, 1, unused);
    }
  }

  /// Chooses occluders, draws their depths and tests all objects in view, occluders too: a frame of the viewer. Ways
  /// that follow each other and differ in refinement alone share what is drawn and its times.
  void occlude(const Way& way, int repetitions, Sums& sums) {
    const DepthMap size = pgl::depth_map_of(view_, way.scale);
    hzm_.resize(pgl::hzm_texels(size));
    if (way.choice == Choice::temporal) {
      drawn_.reset();
      pgl::host::keep_flagged(in_view_, kept_, {}, among_);
      draw(way, way.occluders / 2, true, size, repetitions);
      test(way, size, repetitions, sums);
      std::vector<std::uint32_t> first = std::move(occluders_);
      pgl::host::keep_flagged(kept_, {}, first, among_);
      draw(way, way.occluders - way.occluders / 2, false, size, repetitions);
      test(way, size, repetitions, sums);
      occluders_.insert(occluders_.end(), first.begin(), first.end());
    } else {
      if (!drawn_ || !draws_alike(*drawn_, way)) {
        among_ = in_view_;
        draw(way, way.occluders, true, size, repetitions);
        drawn_ = way;
      }
      test(way, size, repetitions, sums);
    }
    for (const std::uint32_t occluder : occluders_) {
      if (occluder == pgl::no_object) continue;
      sums.occluder_triangles += full_triangles(occluder);
      sums.culled_occluders += kept_[occluder] == 0 ? 1 : 0;
    }
  }

  static bool draws_alike(const Way& a, const Way& b) {
    return a.choice == b.choice && a.occluders == b.occluders && a.scale == b.scale && a.threshold == b.threshold;
  }

  void draw(const Way& way, std::size_t count, bool fresh, const DepthMap& size, int repetitions) {
    const std::span<Depth> depth = std::span(hzm_).first(std::size_t{size.width} * size.height);
    drawn_ms_[0] = least_ms(repetitions, [&] { choose(way, count); });
    drawn_ms_[1] = least_ms(repetitions, [&] {
      if (fresh) std::ranges::fill(depth, pgl::far_depth);
      pgl::host::rasterize_depth<Index>(model_.meshes, model_.objects, model_.vertices, model_.triangles, model_.map,
                                        occluders_, view_, size, depth_workspace_, depth);
    });
    drawn_ms_[2] = least_ms(repetitions, [&] { pgl::host::build_hzm(size, hzm_); });
  }

  /// Tests against what is drawn; adds the times of both.
  void test(const Way& way, const DepthMap& size, int repetitions, Sums& sums) {
    for (std::size_t step = 0; step < drawn_ms_.size(); ++step) sums.ms[step] += drawn_ms_[step];
    sums.ms[3] += least_ms(repetitions, [&] {
      pgl::host::cull_occluded(model_.object_boxes, in_view_, {}, view_, size, hzm_, way.refinement, kept_);
    });
  }

  /// Writes `count` occluders, or as the way says, of those in among_.
  void choose(const Way& way, std::size_t count) {
    const std::size_t n = model_.objects.size();
    const std::span<const std::uint32_t> order(model_.compactness_order);
    occluders_.clear();
    switch (way.choice) {
      case Choice::selected:
      case Choice::temporal:
        occluders_.resize(std::min(count, n));
        pgl::host::select_occluders(order.first(pgl::host::compact_objects(model_.faces, order, way.threshold)),
                                    model_.faces, among_, view_, occluder_workspace_, occluders_);
        break;
      case Choice::last_all:
        for (std::uint32_t i = 0; i < n; ++i)
          if (in_view_[i] != 0 && last_[i] != 0) occluders_.push_back(i);
        break;
      case Choice::all:
        for (std::uint32_t i = 0; i < n; ++i)
          if (in_view_[i] != 0) occluders_.push_back(i);
        break;
      case Choice::most_seen: {
        for (std::uint32_t i = 0; i < n; ++i)
          if (picture_.samples[i] != 0) occluders_.push_back(i);
        const std::size_t k = std::min(count, occluders_.size());
        std::ranges::partial_sort(occluders_, occluders_.begin() + static_cast<std::ptrdiff_t>(k), {},
                                  [&](std::uint32_t i) { return ~picture_.samples[i]; });
        occluders_.resize(k);
        break;
      }
    }
  }

  /// Compares what was found with the truth.
  void count(Sums& sums) const {
    sums.cameras += 1;
    for (std::size_t i = 0; i < in_view_.size(); ++i) {
      if (in_view_[i] == 0) continue;
      add_object(sums, i, kept_[i] == 0);
      sums.vertices_in_view += most_[i];
      if (kept_[i] == 0) sums.vertices_culled += most_[i];
    }
  }

  void add_object(Sums& sums, std::size_t object, bool culled) const {
    const bool seen = picture_.samples[object] != 0, covers = picture_.covers[object] != 0;
    sums.in_view += 1;
    (seen ? sums.seen : covers ? sums.hidden : sums.no_sample) += 1;
    if (!culled) return;
    sums.culled += 1;
    (seen ? sums.wrong : covers ? sums.culled_hidden : sums.culled_no_sample) += 1;
  }

  /// With everything in the map: what the boxes would find if the test read every texel that the rectangle, grown by a
  /// pixel, touches; and if it read those whose centre is in the rectangle, none in a rectangle that shows nothing.
  void find_limits(std::array<Sums, 2>& limits) {
    for (Sums& sums : limits) sums.cameras += 1;
    for (std::size_t i = 0; i < in_view_.size(); ++i) {
      if (in_view_[i] == 0) continue;
      Depth nearest = 0;
      const pgl::ScreenBox box = pgl::project(model_.object_boxes[i], view_, nearest);
      const auto is_behind = [&](float grow) {
        const auto first = [&](float x) { return static_cast<std::int64_t>(std::max(0.0f, std::ceil(x - grow))); };
        const auto last = [&](float x, std::uint32_t side) {
          return static_cast<std::int64_t>(std::min(static_cast<float>(side) - 1.0f, std::floor(x + grow - 1.0f)));
        };
        if (nearest == 0 || !(box.x0 <= box.x1 && box.y0 <= box.y1)) return false;
        for (std::int64_t y = first(box.y0); y <= last(box.y1, height_); ++y)
          for (std::int64_t x = first(box.x0); x <= last(box.x1, width_); ++x)
            if (nearest <= hzm_[static_cast<std::size_t>(y) * width_ + static_cast<std::size_t>(x)]) return false;
        return true;
      };
      add_object(limits[0], i, is_behind(2.0f));
      add_object(limits[1], i, is_behind(0.5f));
    }
  }

  /// What the objects that are seen get of a vertex budget, without and with culling.
  void share_out(Sums& sums) {
    double in_view = 0;
    for (std::size_t i = 0; i < in_view_.size(); ++i)
      if (in_view_[i] != 0) in_view += most_[i];
    pgl::BudgetOptions options;
    options.budget = static_cast<std::uint64_t>(std::min(1e6, 0.1 * in_view));
    options.near_depth = view_.near_depth;
    options.viewport_area = view_.width * view_.height;
    options.policy = pgl::BudgetPolicy::fair;
    sums.budget += static_cast<double>(options.budget);
    for (int on = 0; on < 2; ++on) {
      pgl::host::project(model_.object_boxes, on == 1 ? kept_ : in_view_, view_, areas_, depths_);
      pgl::host::distribute_budget(areas_, depths_, least_, most_, options, budget_workspace_, counts_[on]);
      for (std::size_t i = 0; i < counts_[on].size(); ++i) {
        if (picture_.samples[i] == 0 || counts_[on][i] == 0) continue;
        sums.seen_drawn[on] += 1;
        sums.seen_vertices[on] += counts_[on][i];
        sums.seen_triangles[on] +=
            pgl::triangles_at(model_.meshes[model_.objects[i].mesh], model_.map.data(), counts_[on][i]);
      }
    }
  }

  void print(std::string_view table, Place place, const char* choice, const Way& way, const std::string& refinement,
             const Sums& s) const {
    std::printf("%s,%s,%zu,%llu,%s,%s,", std::string(table).c_str(), name_.c_str(), model_.objects.size(),
                static_cast<unsigned long long>(triangles_), place_name(place), choice);
    if (way.choice == Choice::all || way.choice == Choice::last_all)
      std::printf(",%u,,", way.scale);
    else
      std::printf("%zu,%u,%g,", way.occluders, way.scale, static_cast<double>(way.threshold));
    std::printf("%s,%zu,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f", refinement.c_str(),
                pgl::host::thread_count(), s.cameras, s.in_view, s.seen, s.hidden, s.no_sample, s.culled,
                s.culled_hidden, s.culled_no_sample, s.wrong, s.culled_occluders, s.occluder_triangles);
    for (const double ms : s.ms) std::printf(",%.3f", ms);
    std::printf(",%.0f,%.0f,%.0f", s.vertices_in_view, s.vertices_culled, s.budget);
    for (const auto& pair : {s.seen_vertices, s.seen_triangles, s.seen_drawn})
      std::printf(",%.0f,%.0f", pair[0], pair[1]);
    std::printf("\n");
    std::fflush(stdout);
  }

  std::string name_;
  const Model<Index>& model_;
  Site site_;
  std::uint32_t width_, height_;
  std::uint64_t triangles_ = 0;
  View view_;
  IdPicture picture_;
  std::vector<std::uint8_t> in_view_, kept_, last_, among_;
  std::vector<std::uint32_t> occluders_, least_, most_;
  std::array<std::vector<std::uint32_t>, 2> counts_;
  std::vector<float> areas_, depths_;
  std::vector<Depth> hzm_;
  std::optional<Way> drawn_;          ///< in hzm_, from this camera
  std::array<double, 3> drawn_ms_{};  ///< choosing, depth, map
  pgl::host::OccluderWorkspace occluder_workspace_;
  pgl::host::DepthWorkspace depth_workspace_;
  pgl::host::BudgetWorkspace budget_workspace_;
};

std::vector<Way> effect_ways() {
  using enum Choice;
  std::vector<Way> ways;
  for (const std::size_t k : {20, 100, 500, 2000})
    for (const std::uint32_t refinement : {0u, 2u}) ways.push_back({selected, k, 1, 0.5f, refinement});
  ways.push_back({selected, 500, 1, 0.5f, 4});
  for (const std::size_t k : {500, 2000}) ways.push_back({temporal, k, 1, 0.5f, 2});
  ways.push_back({most_seen, 500, 1, 0.5f, 2});
  ways.push_back({last_all, 0, 1, 0.5f, 2});
  for (const std::uint32_t refinement : {0u, 2u}) ways.push_back({all, 0, 1, 0.5f, refinement});
  return ways;
}

std::vector<Way> trade_ways() {
  std::vector<Way> ways;
  for (const std::size_t k : {5, 10, 20, 50, 100, 200, 500, 1000, 2000})
    for (const std::uint32_t refinement : {0u, 1u, 2u, 4u}) ways.push_back({Choice::selected, k, 1, 0.5f, refinement});
  for (const std::size_t k : {20, 100, 500, 2000}) {
    for (const std::uint32_t scale : {2u, 4u}) ways.push_back({Choice::selected, k, scale, 0.5f, 2});
    for (const float threshold : {0.0f, 0.3f, 0.7f, 0.9f}) ways.push_back({Choice::selected, k, 1, threshold, 2});
  }
  return ways;
}

pgl::scene::AnyModel build_plant(std::size_t objects, const pgl::EcolOptions& options) {
  const pgl::scene::PlantOptions plant{objects, 1};
  const auto make = [&](std::size_t i, MeshData& mesh) {
    pgl::scene::plant_object(plant, i, mesh);
    pgl::scene::weld(mesh);
  };
  std::vector<pgl::scene::MeshSize> sizes(objects);
  std::vector<MeshData> scratch(pgl::host::thread_count());
  pgl::scene::for_each(objects, {}, "plant", [&](std::size_t i) {
    MeshData& mesh = scratch[pgl::host::thread_index()];
    make(i, mesh);
    sizes[i] = {mesh.positions.size(), mesh.triangles.size()};
  });
  std::vector<pgl::Object> placed(objects);
  for (std::size_t i = 0; i < objects; ++i) placed[i].mesh = static_cast<std::uint32_t>(i);
  return pgl::scene::build_any_model({objects, [&](std::size_t i) { return sizes[i]; }, make}, std::move(placed),
                                     options);
}

/// The whole text as a number from 1 to `most`.
std::size_t number(std::string_view text, std::size_t most) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || value < 1 || value > most)
    throw std::runtime_error("'" + std::string(text) + "' is not a number from 1 to " + std::to_string(most));
  return value;
}

}  // namespace

int main(int argc, char** argv) try {
  std::uint32_t width = 1920, height = 1080;
  int cameras = 6;
  const char* table = "effect";
  bool header = true;
  std::vector<std::string> scenes;
  for (int i = 1; i < argc; ++i) {
    const std::string_view word = argv[i];
    if (word == "--trade")
      table = "trade";
    else if (word == "--no-header")
      header = false;
    else if (word == "--cameras" && i + 1 < argc)
      cameras = static_cast<int>(number(argv[++i], 10000));
    else if (word == "--size" && i + 2 < argc) {
      width = static_cast<std::uint32_t>(number(argv[++i], 16384));
      height = static_cast<std::uint32_t>(number(argv[++i], 16384));
    } else if (word.starts_with("-"))
      throw std::runtime_error("unknown or unfinished option '" + std::string(word) + "'");
    else
      scenes.emplace_back(word);
  }
  if (scenes.empty()) {
    std::fprintf(
        stderr,
        "usage: occlusion_study [--trade] [--cameras N] [--size WIDTH HEIGHT] [--no-header] SCENE...\n"
        "A scene is a model file or plant:OBJECTS; N cameras go around it and as many through it.\n"
        "--trade varies number of occluders, refinement, map size and threshold; else the choices are compared.\n");
    return 2;
  }
  const pgl::EcolOptions options{.boundary = pgl::BoundaryRule::slide};
  const std::vector<Way> ways = std::string_view(table) == "trade" ? trade_ways() : effect_ways();
  if (header) Study<std::uint16_t>::print_header();
  for (const std::string& scene : scenes) {
    const bool plant = scene.starts_with("plant:");
    const auto built = plant ? build_plant(number(std::string_view(scene).substr(6), 1u << 20), options)
                             : pgl::scene::build_any_model(pgl::scene::import_scene(scene), options);
    std::visit(
        [&]<class Index>(const Model<Index>& model) {
          Site site;
          for (const Box& box : model.object_boxes) {
            site.box.min = glm::min(site.box.min, box.min);
            site.box.max = glm::max(site.box.max, box.max);
          }
          site.plant = plant;
          if (plant) site.up = {0.0, 0.0, 1.0};
          Study<Index> study(plant ? "plant" : std::filesystem::path(scene).stem().string(), model, site, width,
                             height);
          for (const Place place : {Place::outside, Place::inside}) study.run(table, place, cameras, ways);
        },
        built);
  }
} catch (const std::exception& e) {
  std::fprintf(stderr, "occlusion_study: %s\n", e.what());
  return 1;
}
