// SPDX-License-Identifier: MIT
// Runs pgl_viewer under mpirun: several ranks draw the picture of one, each its own part, and end together. Every run
// is bounded by mpirun()'s timeout, which shows as exit code 124.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <numbers>
#include <random>
#include <set>
#include <span>
#include <sstream>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "pgl/balance.hpp"
#include "pgl/host/cull_frustum.hpp"
#include "pgl/host/distribute_budget.hpp"
#include "pgl/host/project.hpp"
#include "scene/build_model.hpp"
#include "scene/build_plant.hpp"
#include "support/test_data.hpp"
#include "viewer/camera.hpp"
#include "viewer/mpirun.hpp"
#include "viewer/viewer.hpp"

namespace {

using namespace viewer_tests;
using Arguments = std::vector<std::string>;

/// Among the objects of the plant, many of them across the borders of tiles; most of them; behind all of them.
const Arguments among = {"--camera", "-8,-5,2,6,4,2,60", "--up", "z"};
const Arguments overview = {"--camera", "-30,-40,25,0,0,0,50", "--up", "z"};
const Arguments behind = {"--camera", "-500,0,2,-900,0,2,60", "--up", "z"};

const Arguments offscreen = {"--headless", "--size", "161x97"};

std::uint64_t number(const Json& json) {
  return json.is_number_unsigned() ? json.get<std::uint64_t>() : ~std::uint64_t{0};
}

std::uint64_t planned(const Json& json) {
  const Json& memory = json.at("stream").at("memory");
  return number(memory.at("resident")) + number(memory.at("blocks")) + number(memory.at("drawn"));
}

/// The lines on stderr that are ours: where a run fails, mpirun has much to say.
Arguments told(const Outcome& outcome) {
  std::istringstream text(outcome.err);
  Arguments lines;
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("pgl_")) lines.push_back(line);
  }
  return lines;
}

std::string shell_line(const Arguments& words) {
  std::string line;
  for (const std::string& word : words) line += "'" + word + "' ";
  return line;
}

class Several : public Viewer {
 protected:
  /// 300 objects of the plant, with their errors.
  static void SetUpTestSuite() {
    std::string name = (fs::temp_directory_path() / "pgl_several_test.XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    models_ = name;
    preprocess({"-o", plant(), "--errors", "--objects", "300"});
  }
  static void TearDownTestSuite() { fs::remove_all(models_); }

  void SetUp() override {
#if defined(PGL_VIEWER_MPI)
    if (std::system("mpirun --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "no mpirun: ranks are NOT tested";
    const Outcome outcome = run({"--headless", "--objects", "1", "--size", "1x1"});
    if (outcome.code == 3) GTEST_SKIP() << outcome.err;
    ASSERT_EQ(outcome.code, 0) << outcome.err;
#else
    GTEST_SKIP() << "MPI was not found: several ranks are NOT tested";
#endif
  }

  static void preprocess(const Arguments& arguments) {
    const int status = std::system((shell_line(with({PGL_PREPROCESS}, arguments)) + ">/dev/null 2>&1").c_str());
    if (status != 0) throw std::runtime_error("pgl_preprocess failed");
  }
  static std::string plant() {
    return (models_ / "plant.pgl").string();
  }

  Outcome run_several(int ranks, const Arguments& arguments, const std::string& environment = "") {
    return run_as("env -u DISPLAY -u WAYLAND_DISPLAY " + environment + mpirun(ranks), arguments);
  }
  /// The same where it fails: mpirun is told not to give the others a second to end in.
  Outcome run_refused(int ranks, const Arguments& arguments) {
    return run_several(ranks, arguments, "OMPI_MCA_odls_base_sigkill_timeout=0 ");
  }

  /// The statistics of a run that goes well and leaves this picture.
  Json drawn_alone(const Arguments& arguments, const std::string& output = "alone.png") {
    return statistics_of(run(with(arguments, {"--output", output, "--stats", "stats.json"})));
  }
  Json drawn_by(int ranks, const Arguments& arguments, const std::string& output = "several.png") {
    return statistics_of(run_several(ranks, with(arguments, {"--output", output, "--stats", "stats.json"})));
  }
  Json statistics_of(const Outcome& outcome) {
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(told(outcome), Arguments());
    const Json json = Json::parse(content_of(folder_ / "stats.json"), nullptr, false);
    fs::remove(folder_ / "stats.json");
    return outcome.code == 0 ? json : Json();
  }

  /// Whether two files are the same picture, byte for byte.
  testing::AssertionResult same(const std::string& a, const std::string& b) {
    const std::string bytes = content_of(folder_ / a);
    if (!bytes.empty() && bytes == content_of(folder_ / b)) return testing::AssertionSuccess();
    const Picture one = picture(a), other = picture(b);
    if (one.pixels.size() != other.pixels.size() || one.width != other.width) {
      return testing::AssertionFailure() << a << " and " << b << " are not as large as each other";
    }
    std::size_t different = 0, first = 0;
    for (std::size_t i = one.pixels.size(); i-- > 0;) {
      if (one.pixels[i] == other.pixels[i]) continue;
      ++different;
      first = i;
    }
    const auto width = static_cast<std::size_t>(one.width);
    return testing::AssertionFailure() << a << " and " << b << " differ in " << different << " pixels, first at "
                                       << first % width << "," << first / width << " from the upper left";
  }

  /// What is told of ranks that shared a picture out: tiles that cover it, and that none drew more than one draws.
  static void expect_shared_out(const Json& several, const Json& alone, int ranks) {
    for (const char* key : {"culled", "occluders", "camera", "objects", "model", "size", "frames"}) {
      EXPECT_EQ(several.value(key, Json()), alone.at(key)) << key;
    }
    EXPECT_EQ(several["drawn"]["objects"], alone["drawn"]["objects"]);
    if (ranks == 1) {
      EXPECT_EQ(several["drawn"], alone["drawn"]);
      EXPECT_FALSE(several.contains("ranks"));
      return;
    }
    ASSERT_EQ(several.value("ranks", Json()).size(), static_cast<std::size_t>(ranks));
    EXPECT_EQ(several["pictures"], "MPI");
    std::uint64_t pixels = 0;
    int number_of_rank = 0;
    for (const Json& rank : several["ranks"]) {
      EXPECT_EQ(rank["rank"], number_of_rank++);
      const std::vector<std::uint64_t> tile = rank["tile"];
      pixels += (tile[2] - tile[0]) * (tile[3] - tile[1]);
      EXPECT_LE(number(rank["drawn"]["vertices"]), number(alone["drawn"]["vertices"]));
      EXPECT_LE(number(rank["drawn"]["triangles"]), number(alone["drawn"]["triangles"]));
      EXPECT_EQ(rank["budget"], alone["budget"]);
    }
    EXPECT_EQ(pixels, number(alone["size"][0]) * number(alone["size"][1]));
  }

  /// That so many ranks leave the picture of one. The statistics of the last of the runs.
  Json expect_picture_of_one(const std::vector<int>& ranks, const Arguments& arguments) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    const Json alone = drawn_alone(arguments);
    Json several;
    if (alone.is_null()) return several;
    for (const int n : ranks) {
      SCOPED_TRACE(std::to_string(n) + " ranks");
      several = drawn_by(n, arguments);
      EXPECT_TRUE(same("alone.png", "several.png"));
      if (!several.is_null()) expect_shared_out(several, alone, n);
      fs::remove(folder_ / "several.png");
    }
    colors_.push_back(picture("alone.png").colors());
    return several;
  }

  /// The run failed, with one line of ours that holds `name`, and left only `kept` behind.
  void expect_refused_once(const Outcome& outcome, const std::string& name, const Arguments& kept = {}) {
    EXPECT_NE(outcome.code, 0);
    EXPECT_NE(outcome.code, 124) << "it would have gone on for ever";
    EXPECT_LT(outcome.code, 128) << outcome.err;
    const Arguments lines = told(outcome);
    EXPECT_EQ(lines.size(), 1u) << testing::PrintToString(lines);
    for (const std::string& line : lines) {
      EXPECT_TRUE(line.starts_with("pgl_viewer: ")) << line;
      EXPECT_NE(line.find(name), std::string::npos) << name << " is not named: " << line;
    }
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(files(), kept);
  }

  /// Balls of 602 vertices in a row, at these x.
  void write_balls(const std::string& name, const std::vector<double>& at) {
    constexpr int rings = 20, parts = 30;
    std::ostringstream text;
    for (const double x : at) {
      text << "o ball" << x << "\nv " << x << " 1.3 0\n";
      for (int ring = 1; ring <= rings; ++ring) {
        const double slope = std::numbers::pi * ring / (rings + 1);
        for (int part = 0; part < parts; ++part) {
          const double turn = 2.0 * std::numbers::pi * part / parts;
          text << "v " << x + 1.3 * std::sin(slope) * std::cos(turn) << ' ' << 1.3 * std::cos(slope) << ' '
               << 1.3 * std::sin(slope) * std::sin(turn) << "\n";
        }
      }
      text << "v " << x << " -1.3 0\n";
      const auto vertex = [](int ring, int part) {  // from the last one back
        return -1 - (rings - ring) * parts - (parts - part % parts);
      };
      for (int part = 0; part < parts; ++part) {
        text << "f " << -(rings * parts + 2) << ' ' << vertex(1, part + 1) << ' ' << vertex(1, part) << "\nf -1 "
             << vertex(rings, part) << ' ' << vertex(rings, part + 1) << "\n";
        for (int ring = 1; ring < rings; ++ring) {
          text << "f " << vertex(ring, part) << ' ' << vertex(ring, part + 1) << ' ' << vertex(ring + 1, part + 1)
               << "\nf " << vertex(ring, part) << ' ' << vertex(ring + 1, part + 1) << ' ' << vertex(ring + 1, part)
               << "\n";
        }
      }
    }
    write(folder_ / name, text.str());
  }

  inline static fs::path models_;
  std::vector<std::size_t> colors_;  ///< of the pictures that were compared
};

// ---- one picture ----------------------------------------------------------------------------------------------------
TEST_F(Several, DrawThePictureOfOneHoweverManyTheyAre) {
  expect_picture_of_one({1, 2, 3, 4, 7},
                        with(with(offscreen, among), {"--budget", "20000", "--orbit", "--frames", "3", plant()}));
  ASSERT_FALSE(colors_.empty());
  EXPECT_GT(colors_[0], 300u);
}

TEST_F(Several, DrawThePictureOfOneHoweverItIsCut) {
  const Arguments arguments = with(with(offscreen, among), {"--budget", "20000", "--orbit", "--frames", "4", plant()});
  ASSERT_FALSE(drawn_alone(arguments).is_null());
  std::set<std::string> cuts;
  for (const Arguments& cut : {Arguments{"--tiles", "equal"},
                               {"--tiles", "balanced"},
                               {"--tiles", "measured"},
                               {"--bins", "2"},
                               {"--bins", "5", "--tiles", "measured"},
                               {"--balance", "bisection"},
                               {"--balance", "bisection", "--lbt", "0.5", "--bins", "8"}}) {
    SCOPED_TRACE(testing::PrintToString(cut));
    const Json json = drawn_by(3, with(arguments, cut));
    EXPECT_TRUE(same("alone.png", "several.png"));
    ASSERT_FALSE(json.is_null());
    cuts.insert(json["ranks"][0]["tile"].dump() + json["ranks"][1]["tile"].dump());
    if (cut.back() == "equal") {
      EXPECT_EQ(json["ranks"][0]["tile"], Json::array({0, 0, 53, 97}));
    }
  }
  EXPECT_GE(cuts.size(), 4u) << "the options say nothing";
}

TEST_F(Several, DrawThePictureOfOneWhateverChoosesTheDetail) {
  int ranks = 2;
  for (const Arguments& selection : {Arguments{"--budget", "0"},
                                     {"--budget", "1"},
                                     {"--budget", "all", "--pet", "0"},
                                     {"--budget", "3000", "--policy", "fair", "--min-triangles", "20"},
                                     {"--budget", "5000", "--policy", "paper", "--alpha", "1.2"},
                                     {"--lod", "error"},
                                     {"--lod", "error", "--threshold", "0"},
                                     {"--lod", "error", "--threshold", "20", "--stream", "always"}}) {
    expect_picture_of_one({ranks}, with(with(with(offscreen, among), selection), {plant()}));
    ranks = 5 - ranks;
  }
  const std::set<std::size_t> different(colors_.begin(), colors_.end());
  EXPECT_GE(different.size(), 5u);
}

TEST_F(Several, DrawThePictureOfOneFromWhereverItIsSeen) {
  for (const Arguments& path : {with(overview, {"--orbit", "--frames", "5"}),
                                {"--fly", "--frames", "7"},
                                behind,
                                {"--camera", "0,0,900,0,0,0,10", "--up", "z"},
                                {"--camera", "0,0,3000000,0,0,0,2", "--up", "z"},
                                {"--camera", "5,3,0.5,5.001,3,0.5,170", "--up", "z"}}) {
    expect_picture_of_one({3}, with(with(offscreen, path), {"--budget", "20000", "--pet", "0", plant()}));
  }
  EXPECT_GT(*std::ranges::max_element(colors_), 500u);
  EXPECT_EQ(std::ranges::count(colors_, 1u), 2) << "only behind all, and too far, there is nothing to be seen";
}

TEST_F(Several, DrawTheWireframeOfOneAndHideWhatOneHides) {
  const Arguments arguments = with(with(offscreen, among), {"--budget", "20000", "--orbit", "--frames", "3", plant()});
  expect_picture_of_one({3}, with(arguments, {"--wireframe"}));
  for (const Arguments& more : {Arguments{}, {"--wireframe"}, {"--stream", "always", "--aos", "20"}}) {
    for (const char* mode : {"on", "temporal"}) {
      const Json json = expect_picture_of_one({2}, with(with(arguments, {"--occlusion", mode}), more));
      ASSERT_FALSE(json.is_null());
      EXPECT_GT(json["culled"]["occlusion"], 0);
      EXPECT_LE(json["gl"]["samples"], 1);
    }
  }
}

TEST_F(Several, DrawThePictureOfOneWhereverTheModelIs) {
  write_strip("strip.obj");
  const std::string nodes = fs::absolute(support::fixture("nodes.gltf")).string();
  const Arguments strip = {"--budget", "40000", "--fly", "--frames", "3"};
  preprocess({"-o", (folder_ / "strip.pgl").string(), "--boundary", "slide", (folder_ / "strip.obj").string()});
  int ranks = 2;
  for (const Arguments& model : {Arguments{"--objects", "40", "--lod", "error"},
                                 {"--budget", "11", "--orbit", "--frames", "4", "--stream", "always", nodes},
                                 {"--budget", "all", nodes},
                                 with(strip, {"--boundary", "slide", "strip.obj"}),
                                 with(strip, {"--stream", "always", "strip.pgl"}),
                                 {"--fly", "--frames", "5", "--stream", "always", "--no-prefetch", plant()},
                                 {"--fly", "--frames", "5", "--stream", "never", plant()}}) {
    expect_picture_of_one({ranks}, with(offscreen, model));
    ranks = 5 - ranks;
  }
  EXPECT_GT(*std::ranges::min_element(colors_), 5u);
}

TEST_F(Several, DrawThePictureOfOneFarFromTheOrigin) {
  std::mt19937 random(7);
  const auto quarter = [&](double reach) {  // floats hold it exactly there
    return std::floor((random() * 0x1p-31 - 1.0) * reach * 4.0) / 4.0;
  };
  for (const int far : {0, 1'000'000}) {
    std::ostringstream text;
    for (int i = 0; i < 300; ++i) {
      const double x = far + quarter(20), y = far + quarter(20), z = quarter(20);
      text << std::fixed << "o leaf" << i << "\nv " << x << ' ' << y << ' ' << z << "\nv " << x + 1 << ' ' << y << ' '
           << z << "\nv " << x << ' ' << y + 2 << ' ' << z + 2 << "\nf -3 -2 -1\n";
    }
    write(folder_ / "leaves.obj", text.str());
    for (int camera = 0; camera < (far == 0 ? 1 : 5); ++camera) {
      std::ostringstream place;
      place << std::fixed << far + quarter(12) << ',' << far + quarter(12) << ',' << quarter(12) << ',' << far << ','
            << far << ",0,10";
      expect_picture_of_one({12}, {"--headless", "--size", "900x600", "--up", "z", "--camera", place.str(), "--budget",
                                   "all", "--pet", "0", "leaves.obj"});
    }
  }
  EXPECT_GT(*std::ranges::min_element(colors_), 5u);
}

TEST_F(Several, DrawThePictureOfOneOfAnySize) {
  for (const char* size : {"1x1", "3x1", "1x3", "2x2", "331x1", "5x173"}) {
    expect_picture_of_one({7}, with({"--headless", "--size", size, "--budget", "20000", plant()}, among));
  }
}

TEST_F(Several, DrawThePictureOfOneOfAnyScene) {
  std::mt19937 random(20240607);
  const auto below = [&](std::uint32_t end) { return static_cast<std::uint32_t>(random() % end); };
  const auto pick = [&](const std::vector<Arguments>& from) {
    return from[below(static_cast<std::uint32_t>(from.size()))];
  };
  for (int i = 0; i < 14; ++i) {
    std::string camera;
    for (const int reach : {30, 25, 12, 20, 20, 6}) {
      const int part = static_cast<int>(below(2001)) - 1000;
      camera += std::to_string(part * reach / 1000.0) + ",";
    }
    camera += std::to_string(10 + below(110));
    const bool error = below(4) == 0;
    Arguments arguments = {
        "--headless", "--size", std::to_string(1 + below(200)) + "x" + std::to_string(1 + below(130)),
        "--camera",   camera,   "--up",
        "z",          "--pet",  pick({{"0"}, {"1"}, {"30"}})[0]};
    for (const Arguments& more :
         {error ? Arguments{"--lod", "error", "--threshold", std::to_string(below(50) / 10.0)}
                : Arguments{"--budget", std::to_string(below(60'000)), "--policy",
                            pick({{"exact"}, {"fair"}, {"paper"}})[0]},
          pick({{}, {"--orbit", "--frames", std::to_string(2 + below(4))}}), pick({{}, {}, {"--wireframe"}}),
          pick({{}, {"--occlusion", "on"}, {"--occlusion", "temporal", "--aos", "30"}}),
          pick({{"--stream", "always"}, {"--stream", "never"}}),
          pick({{}, {"--tiles", "equal"}, {"--tiles", "measured"}, {"--bins", "7"}, {"--balance", "bisection"}})}) {
      arguments = with(arguments, more);
    }
    expect_picture_of_one({static_cast<int>(2 + below(4))}, with(arguments, {plant()}));
  }
  EXPECT_GE(std::ranges::count_if(colors_, [](std::size_t colors) { return colors > 50; }), 9);
}

TEST_F(Several, WriteTheSelectionOfAllSeenFromOutside) {
  const Arguments arguments = with(with(offscreen, among), {"--budget", "20000", plant()});
  ASSERT_FALSE(drawn_alone(with(arguments, {"--reference", "a.png"})).is_null());
  ASSERT_FALSE(drawn_by(3, with(arguments, {"--reference", "b.png"})).is_null());
  EXPECT_TRUE(same("a.png", "b.png"));
  EXPECT_EQ(files(), (Arguments{"a.png", "alone.png", "b.png", "several.png"})) << "once, by one of them";
}

// ---- each its part --------------------------------------------------------------------------------------------------
TEST_F(Several, EachDrawsAndIsSentWhatTouchesItsTileAndNothingElse) {
  const auto any = pgl::scene::build_plant({.objects = 300}, 0, 300, true, {});
  const auto& model = std::get<pgl::scene::Model<std::uint16_t>>(any);
  const std::size_t n = model.objects.size();
  const Arguments arguments = {"--headless", "--size", "301x200", "--stream", "always", "--budget", "20000", plant()};
  for (const Arguments& camera : {among, overview}) {
    const Json json = drawn_by(4, with(arguments, camera));
    ASSERT_FALSE(json.is_null());
    const auto vector = [&](const char* name) {
      const std::vector<double> xyz = json["camera"][name];
      return glm::dvec3(xyz[0], xyz[1], xyz[2]);
    };
    pgl::Box box;
    for (const pgl::Box& one : model.object_boxes) {
      box.min = glm::min(box.min, one.min);
      box.max = glm::max(box.max, one.max);
    }
    const pgl::View view =
        pgl::viewer::view_of({vector("eye"), vector("target"), vector("up"), json["camera"]["fov"]}, box, 301, 200);
    std::vector<std::uint8_t> in_view(n);
    std::vector<float> areas(n), depths(n);
    std::vector<pgl::ScreenBox> rectangles(n);
    std::vector<std::uint32_t> least(n, 0), most(n), counts(n);
    pgl::host::cull_frustum(model.object_boxes, view, in_view);
    pgl::host::project(model.object_boxes, in_view, view, areas, depths, rectangles);
    for (std::size_t i = 0; i < n; ++i) {
      const pgl::Mesh& mesh = model.meshes[model.objects[i].mesh];
      least[i] = mesh.min_vertices;
      most[i] = mesh.max_vertices;
    }
    pgl::BudgetOptions options{.budget = 20'000};
    options.near_depth = view.near_depth;
    options.viewport_area = view.width * view.height;
    pgl::host::BudgetWorkspace workspace;
    const std::uint64_t all =
        pgl::host::distribute_budget(areas, depths, least, most, options, workspace, counts).vertices;
    ASSERT_GT(all, 5000u);

    std::uint64_t sum = 0;
    for (const Json& rank : json["ranks"]) {
      SCOPED_TRACE(rank["rank"]);
      const std::vector<std::uint32_t> tile = rank["tile"];
      std::uint64_t vertices = 0, triangles = 0;
      for (std::size_t i = 0; i < n; ++i) {
        if (counts[i] == 0) continue;
        // A pixel more than the rectangle on every side.
        const pgl::ScreenBox& r = rectangles[i];
        const bool touches = std::floor(r.x0) - 1 < tile[2] && std::floor(r.x1) + 2 > tile[0] &&
                             std::floor(r.y0) - 1 < tile[3] && std::floor(r.y1) + 2 > tile[1];
        if (!touches) continue;
        vertices += counts[i];
        triangles += pgl::triangles_at(model.meshes[model.objects[i].mesh], model.map.data(), counts[i]);
      }
      EXPECT_EQ(rank["drawn"]["vertices"], vertices);
      EXPECT_EQ(rank["drawn"]["triangles"], triangles);
      EXPECT_EQ(rank["stream"]["sent"][0]["bytes"], 12 * vertices + 6 * triangles);
      EXPECT_LT(vertices, all * 3 / 4) << "a part is nearly the whole";
      sum += vertices;
    }
    EXPECT_GE(sum, all);
    EXPECT_LT(sum, 3 * all) << "most is drawn by several";
  }
}

TEST_F(Several, AreSentOnlyWhatIsNewInTheirTiles) {
  const Arguments still = with(with(offscreen, among), {"--stream", "always", "--budget", "20000", "--frames", "3"});
  const Json json = drawn_by(3, with(still, {plant()}));
  ASSERT_FALSE(json.is_null());
  for (const Json& rank : json["ranks"]) {
    EXPECT_GT(number(rank["stream"]["sent"][0]["bytes"]), 0u);
    EXPECT_EQ(rank["stream"]["sent"][1]["bytes"], 0);
    EXPECT_EQ(rank["stream"]["sent"][2]["bytes"], 0);
  }
}

// ---- walls ----------------------------------------------------------------------------------------------------------
TEST_F(Several, ScreensOfAWallSideBySideAreTheOnePicture) {
  struct Wall {
    int columns, rows;
    Arguments more;
  };
  for (const Wall& wall :
       {Wall{1, 1, {}}, Wall{2, 1, {"--occlusion", "on"}}, Wall{1, 3, {"--stream", "always", "--fly", "--frames", "4"}},
        Wall{3, 2, {"--wireframe"}}, Wall{2, 2, {"--lod", "error"}}, Wall{5, 1, {"--size", "7x3"}}}) {
    const Arguments arguments = with(with(offscreen, wall.rows == 3 ? Arguments() : among), with(wall.more, {plant()}));
    SCOPED_TRACE(testing::PrintToString(arguments));
    const Json alone = drawn_alone(arguments);
    ASSERT_FALSE(alone.is_null());
    const Picture one = picture("alone.png");
    const int screens = wall.columns * wall.rows;
    const std::string grid = std::to_string(wall.columns) + "x" + std::to_string(wall.rows);
    const Json json = drawn_by(screens, with(arguments, {"--wall", grid}), "screen.png");
    ASSERT_FALSE(json.is_null());
    int x = 0, y = 0;
    for (int rank = 0; rank < screens; ++rank) {
      const Picture part = picture("screen-" + std::to_string(rank) + ".png");
      ASSERT_GT(part.width, 0);
      std::size_t different = 0;
      for (int v = 0; v < part.height; ++v) {
        for (int u = 0; u < part.width; ++u) different += one.at(x + u, y + v) != part.at(u, v) ? 1 : 0;
      }
      EXPECT_EQ(different, 0u) << "screen " << rank;
      x += part.width;
      if (rank % wall.columns < wall.columns - 1) continue;
      EXPECT_EQ(x, one.width);
      x = 0;
      y += part.height;
    }
    EXPECT_EQ(y, one.height);
    if (screens > 1) {
      EXPECT_EQ(json["pictures"], "none");
    }
    EXPECT_EQ(files().size(), static_cast<std::size_t>(screens + 1)) << testing::PrintToString(files());
    for (int rank = 0; rank < screens; ++rank) fs::remove(folder_ / ("screen-" + std::to_string(rank) + ".png"));
  }
}

// ---- a frame's time -------------------------------------------------------------------------------------------------
/// Four balls in a row, from the left to the middle: the left half of the picture is touched by all, the right half by
/// the last one only, which alone could have more detail there than on the left.
const Arguments row = {"--headless", "--size", "160x90", "--camera", "0,0,14,0,0,0,50",
                       "--tiles",    "equal",  "--pet",  "0"};
const std::vector<double> left_to_middle = {-9.0, -6.0, -3.0, 0.0};

Arguments without_tiles(Arguments arguments) {
  const auto at = std::ranges::find(arguments, "--tiles");
  if (at != arguments.end()) arguments.erase(at, at + 2);
  return arguments;
}

TEST_F(Several, WithABudgetEachDrawWhatIsOnABorderAlike) {
  write_balls("row.obj", left_to_middle);
  for (const Arguments& limit : {Arguments{"--budget", "900"},
                                 {"--budget", "300", "--policy", "fair"},
                                 {"--budget", "700", "--stream", "always"}}) {
    SCOPED_TRACE(testing::PrintToString(limit));
    const Arguments arguments = with(with(row, limit), {"row.obj"});
    const Json alone = drawn_alone(without_tiles(arguments));
    ASSERT_FALSE(alone.is_null());
    EXPECT_GT(number(alone["drawn"]["vertices"]), 250u);
    // The first frame has the budget as it was given; so in each of the two halves.
    const Json json = drawn_by(2, with(arguments, {"--frame-time", "1000"}));
    EXPECT_TRUE(same("alone.png", "several.png"));
    ASSERT_FALSE(json.is_null());
    EXPECT_EQ(json["ranks"][0]["drawn"]["vertices"], alone["drawn"]["vertices"]);
    EXPECT_LT(number(json["ranks"][1]["drawn"]["vertices"]), number(alone["drawn"]["vertices"]) / 2);
    EXPECT_GT(number(json["ranks"][1]["drawn"]["vertices"]), 0u);
  }
}

TEST_F(Several, FallToTheSameLeastBudgetWhereNoTimeIsEnough) {
  write_balls("row.obj", left_to_middle);
  const Arguments arguments = with(row, {"row.obj"});
  const Json alone = drawn_alone(with(without_tiles(arguments), {"--budget", "1000"}));
  ASSERT_FALSE(alone.is_null());
  EXPECT_EQ(alone["drawn"]["vertices"], 1000);
  for (const Arguments& more : {Arguments{}, {"--stream", "always"}}) {
    const Json json =
        drawn_by(2, with(with(arguments, more), {"--budget", "2400", "--frame-time", "0.001", "--frames", "20"}));
    EXPECT_TRUE(same("alone.png", "several.png"));
    ASSERT_FALSE(json.is_null());
    for (const Json& rank : json["ranks"]) EXPECT_EQ(rank["budget"], 1000);
  }
}

TEST_F(Several, RiseToTheWholeModelWhereThereIsTime) {
  for (const char* tiles : {"equal", "balanced", "measured"}) {
    const Arguments arguments = with(with(offscreen, among), {"--pet", "0", plant()});
    ASSERT_FALSE(drawn_alone(with(arguments, {"--budget", "all"})).is_null());
    const Json json = drawn_by(3, with(arguments, {"--tiles", tiles, "--budget", "20000", "--frame-time", "100000",
                                                   "--frames", "10", "--stream", "always"}));
    EXPECT_TRUE(same("alone.png", "several.png"));
    ASSERT_FALSE(json.is_null());
    for (const Json& rank : json["ranks"]) {
      EXPECT_GT(number(rank["budget"]), 200'000u);
      EXPECT_LE(number(rank["budget"]), std::uint64_t{1} << 32);
    }
  }
}

TEST_F(Several, WithAThresholdEachDrawWhatIsOnABorderAlike) {
  const Arguments arguments = with(with(offscreen, among), {"--lod", "error", "--threshold", "2", plant()});
  ASSERT_FALSE(drawn_alone(arguments).is_null());
  for (const int ranks : {2, 5}) {  // the first frame has the threshold as it was given
    ASSERT_FALSE(drawn_by(ranks, with(arguments, {"--frame-time", "16"})).is_null());
    EXPECT_TRUE(same("alone.png", "several.png"));
  }
  for (const auto& [time, threshold] : {std::pair{"0.001", "64"}, std::pair{"1000000", "0.25"}}) {
    ASSERT_FALSE(
        drawn_alone(with(with(offscreen, among), {"--lod", "error", "--threshold", threshold, plant()})).is_null());
    const Json json = drawn_by(3, with(arguments, {"--frame-time", time, "--frames", "40"}));
    EXPECT_TRUE(same("alone.png", "several.png"));
    ASSERT_FALSE(json.is_null());
    for (const Json& rank : json["ranks"]) EXPECT_EQ(rank["threshold"], std::stod(threshold));
  }
}

TEST_F(Several, MeasuredThatARankIsSlowItGetsALesserPart) {
  const Arguments arguments = with(with({"--headless", "--size", "240x150"}, among),
                                   {"--budget", "50000", "--frames", "12", "--checksums", plant()});
  ASSERT_FALSE(drawn_alone(arguments).is_null());
  for (const std::size_t slow : {0u, 1u}) {
    const Json json = drawn_by(2, with(arguments, {"--tiles", "measured", "--slow", std::to_string(slow) + ",20"}));
    EXPECT_TRUE(same("alone.png", "several.png"));
    ASSERT_FALSE(json.is_null());
    const Json &slowed = json["ranks"][slow], &other = json["ranks"][1 - slow];
    EXPECT_LT(number(slowed["weight"]), number(other["weight"]) / 2);
    EXPECT_LT(number(slowed["drawn"]["triangles"]), number(other["drawn"]["triangles"]));
    for (const Json& rank : json["ranks"]) {
      EXPECT_GT(number(rank["weight"]), 0u);
      EXPECT_EQ(rank["frame_ms"].size(), 12u);
      for (const Json& ms : rank["frame_ms"]) EXPECT_TRUE(ms.is_number() && ms > 0.0) << ms;  // null: not finite
    }
    EXPECT_GE(json["imbalance"]["worst"], json["imbalance"]["mean"]);
  }
  const Json even = drawn_by(2, with(arguments, {"--tiles", "balanced", "--slow", "1,20"}));
  EXPECT_EQ(even["ranks"][0]["weight"], even["ranks"][1]["weight"]);
}

// ---- transfers and memory -------------------------------------------------------------------------------------------
TEST_F(Several, NoneIsSentMoreThanItMayAndAllArrivesInTheEnd) {
  const Arguments arguments = with(with(offscreen, among), {"--stream", "always", "--budget", "20000", plant()});
  const Json alone = drawn_alone(arguments);
  ASSERT_FALSE(alone.is_null());
  for (const int ranks : {2, 4}) {
    for (const std::uint64_t cap : {10'000u, 60'000u}) {
      SCOPED_TRACE(cap);
      const Json json = drawn_by(ranks, with(arguments, {"--transfer", std::to_string(cap), "--frames", "60"}));
      ASSERT_FALSE(json.is_null());
      EXPECT_TRUE(same("alone.png", "several.png"));
      for (const Json& rank : json["ranks"]) {
        const Json& sent = rank["stream"]["sent"];
        ASSERT_EQ(sent.size(), 60u);
        std::uint64_t bytes = 0;
        for (const Json& frame : sent) {
          EXPECT_LE(number(frame["bytes"]), cap);
          bytes += number(frame["bytes"]);
        }
        EXPECT_EQ(sent.back()["missing_bytes"], 0);
        EXPECT_EQ(bytes, 12 * number(rank["drawn"]["vertices"]) + 6 * number(rank["drawn"]["triangles"]))
            << "something was sent twice";
      }
      EXPECT_GT(number(json["ranks"][0]["stream"]["sent"][0]["missing_bytes"]), 0u);
    }
  }
  const Json nothing = drawn_by(2, with(arguments, {"--transfer", "0"}));
  ASSERT_FALSE(nothing.is_null());
  EXPECT_EQ(nothing["drawn"]["objects"], 0) << "what was not sent is not drawn";
}

TEST_F(Several, WhileDetailArrivesWhatIsOnABorderIsAlike) {
  write_balls("row.obj", left_to_middle);
  for (const char* frames : {"1", "2", "5"}) {
    SCOPED_TRACE(frames);
    const Arguments arguments =
        with(row, {"--budget", "all", "--stream", "always", "--transfer", "6000", "--frames", frames, "row.obj"});
    const Json alone = drawn_alone(without_tiles(arguments));
    ASSERT_FALSE(alone.is_null());
    const Json json = drawn_by(2, arguments);
    EXPECT_TRUE(same("alone.png", "several.png"));
    ASSERT_FALSE(json.is_null());
    EXPECT_EQ(json["ranks"][0]["drawn"]["checksum"], alone["drawn"]["checksum"]);
    EXPECT_GT(number(alone["stream"]["sent"].back()["missing_bytes"]), 0u);
  }
}

TEST_F(Several, AgreeOnABudgetForWhichAllHaveMemory) {
  write_balls("row.obj", left_to_middle);
  const Arguments arguments = with(row, {"--stream", "always", "row.obj"});
  const Json free = drawn_alone(with(without_tiles(arguments), {"--budget", "all"}));
  ASSERT_FALSE(free.is_null());
  const std::uint64_t resident = number(free["stream"]["memory"]["resident"]);
  const std::uint64_t limit = resident + (planned(free) - resident) * 2 / 3;
  for (const Arguments& more : {Arguments{}, {"--frames", "3", "--orbit"}, {"--policy", "paper"}}) {
    SCOPED_TRACE(testing::PrintToString(more));
    const Arguments limited = with(with(arguments, {"--budget", "all"}), more);
    const Json json = drawn_by(2, with(limited, {"--gpu-memory", std::to_string(limit)}));
    ASSERT_FALSE(json.is_null());
    for (const Json& rank : json["ranks"]) {
      EXPECT_LE(planned(rank), limit);
      EXPECT_LE(number(rank["drawn"]["vertices"]), number(rank["stream"]["memory"]["vertices"]));
      EXPECT_LE(number(rank["drawn"]["triangles"]), number(rank["stream"]["memory"]["triangles"]));
    }
    if (!more.empty()) continue;
    // The left one draws all of the selection, so its vertices are the budget.
    const std::uint64_t budget = number(json["ranks"][0]["drawn"]["vertices"]);
    EXPECT_GT(budget, 1000u);
    EXPECT_LT(budget, number(free["drawn"]["vertices"]));
    ASSERT_FALSE(drawn_alone(with(without_tiles(arguments), {"--budget", std::to_string(budget)})).is_null());
    EXPECT_TRUE(same("alone.png", "several.png"));
  }
}

TEST_F(Several, SharedOutMoreFitsIntoTheMemoryOfEach) {
  // Too little for one, enough for each of four.
  const Arguments arguments = {"--headless", "--size", "160x160",  "--stream", "always", "--camera", "0,0,60,0,0,0,50",
                               "--up",       "y",      "--budget", "all",      "--pet",  "0",        plant()};
  const Json free = drawn_alone(arguments);
  ASSERT_FALSE(free.is_null());
  const std::uint64_t resident = number(free["stream"]["memory"]["resident"]);
  const std::uint64_t limit = resident + (planned(free) - resident) * 3 / 5;
  const Arguments limited = with(arguments, {"--gpu-memory", std::to_string(limit)});
  ASSERT_FALSE(drawn_alone(limited, "limited.png").is_null());
  EXPECT_FALSE(same("alone.png", "limited.png"));
  const Json json = drawn_by(4, limited);
  ASSERT_FALSE(json.is_null());
  EXPECT_TRUE(same("alone.png", "several.png"));
  for (const Json& rank : json["ranks"]) EXPECT_LE(planned(rank), limit);
}

// ---- ends -----------------------------------------------------------------------------------------------------------
TEST_F(Several, RefuseWithOneLineAndLeaveNothing) {
  const Arguments small = {"--headless", "--size", "16x9", "--output", "a.png", "--stats", "a.json"};
  struct Case {
    Arguments arguments;
    std::string name;
  };
  for (const auto& [arguments, name] :
       {Case{{"--budget", "many"}, "--budget"}, Case{{"--walls"}, "--walls"}, Case{{"none.obj"}, "none.obj"},
        Case{{"--wall", "2x2"}, "--wall"}, Case{{"--wall", "2x1", "--size", "1x5"}, "--wall"},
        Case{{"--overlap"}, "--overlap"}, Case{{"--lod", "error", "--transfer", "5K"}, "--transfer"},
        Case{{"--reference", "no/b.png"}, "no/b.png"}, Case{{"--reference", "a.png"}, "a.png"},
        Case{{"--wall", "2x1", "--reference", "a-1.png"}, "a-1.png"},
        Case{{"--stream", "always", "--gpu-memory", "64K"}, "--gpu-memory"}}) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    Arguments all = with(small, {"--objects", "20"});
    if (name == "none.obj") all = small;
    expect_refused_once(run_refused(2, with(all, arguments)), name);
  }
  fs::create_directory(folder_ / "a-1.png");
  expect_refused_once(run_refused(2, with(small, {"--objects", "20", "--wall", "2x1"})), "a-1.png", {"a-1.png"});
}

TEST_F(Several, EndWithTheCodeOfOne) {
  const std::string blind = "__EGL_VENDOR_LIBRARY_FILENAMES=/nowhere ";  // GLVND finds no driver then
  const Arguments small = {"--headless", "--objects", "20", "--size", "16x9"};
  EXPECT_EQ(run_several(2, small, blind).code, run_as("env -u DISPLAY -u WAYLAND_DISPLAY " + blind, small).code);
  EXPECT_EQ(run(with(small, {"--wall", "2x1"})).code, 2);
  EXPECT_EQ(run_refused(2, with(small, {"--wall", "2x2"})).code, 2);
  EXPECT_EQ(run_refused(2, with(small, {"--overlap"})).code, 2);
  EXPECT_EQ(run_refused(2, {"--headless", "none.obj"}).code, 1);
}

TEST_F(Several, OfADamagedFileOneTells) {
  const std::string good = content_of(plant());
  const Arguments arguments = {"--headless", "--size",   "32x20", "--budget", "all",    "--pet",
                               "0",          "--output", "a.png", "--stats",  "a.json", "bad.pgl"};
  int refused = 0;
  for (const int part : {0, 15, 30, 60, 75, 90}) {  // the header, then tables, vertices, triangles, ...
    std::string bad = good;
    char& byte =
        bad[part < 2 ? static_cast<std::size_t>(part) * 20 : good.size() * static_cast<std::size_t>(part) / 100];
    byte = static_cast<char>(byte ^ 0x10);
    write(folder_ / "bad.pgl", bad);
    SCOPED_TRACE(part);
    if (run(arguments).code == 0) {  // nothing that is read
      fs::remove(folder_ / "a.png");
      fs::remove(folder_ / "a.json");
      continue;
    }
    ++refused;
    expect_refused_once(run_refused(3, arguments), "bad.pgl", {"bad.pgl"});
  }
  EXPECT_GE(refused, 4);
  write(folder_ / "bad.pgl", good.substr(0, good.size() / 2));
  expect_refused_once(run_refused(3, arguments), "bad.pgl", {"bad.pgl"});
}

TEST_F(Several, TellTheirNamesAndHelpOnce) {
  const Outcome version = run_several(3, {"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_EQ(std::ranges::count(version.out, '\n'), 1) << version.out;
  const Outcome help = run_several(3, {"--help"});
  EXPECT_EQ(help.out, run({"--help"}).out);
  for (const char* option : {"--tiles", "--wall", "--balance", "--lbt", "--bins", "--timeout", "--slow", "--frame-time",
                             "--lod", "--threshold"}) {
    EXPECT_NE(help.out.find(option), std::string::npos) << option;
  }
  const Outcome table = run_several(3, with(offscreen, {plant()}));
  for (const char* line : {"\nranks ", "\npictures come by ", "\nimbalance, % ", "\nms pictures ", "\nms balance "}) {
    const std::size_t at = table.out.find(line);
    EXPECT_NE(at, std::string::npos) << line;
    EXPECT_EQ(table.out.find(line, at + 1), std::string::npos) << line;
  }
}

/// A long run of which one rank is sent a signal.
class SeveralEnds : public Several {
 protected:
  /// The process of a rank that runs in the folder of this test; 0: there is none.
  int process_of(int rank) const {
    const std::string variable = "OMPI_COMM_WORLD_RANK=" + std::to_string(rank);
    for (const auto& entry : fs::directory_iterator("/proc")) {
      const std::string name = entry.path().filename().string();
      if (name.find_first_not_of("0123456789") != std::string::npos) continue;
      std::error_code error;
      if (fs::read_symlink(entry.path() / "cwd", error) != fs::canonical(folder_)) continue;
      const std::string environment = '\0' + content_of(entry.path() / "environ");
      if (environment.find('\0' + variable + '\0') != std::string::npos) return std::stoi(name);
    }
    return 0;
  }

  Outcome outcome_of(int ranks, int victim, int signal) {
    using namespace std::chrono_literals;
    auto running = std::async(std::launch::async, [&] {
      return run_several(ranks, with(offscreen, {"--timeout", "1", "--frames", "1000000", "--output", "a.png",
                                                 "--stats", "a.json", "--orbit", "--objects", "20"}));
    });
    int process = 0;
    for (int i = 0; i < 200 && process == 0; ++i) {
      std::this_thread::sleep_for(50ms);
      process = process_of(victim);
    }
    EXPECT_NE(process, 0) << "rank " << victim << " was not found";
    std::this_thread::sleep_for(1000ms);  // in the midst of it
    EXPECT_EQ(running.wait_for(0s), std::future_status::timeout) << "the run ended by itself";
    if (process != 0) kill(process, signal);
    const auto begin = std::chrono::steady_clock::now();
    Outcome outcome = running.get();
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 20s);
    EXPECT_NE(outcome.code, 0);
    EXPECT_NE(outcome.code, 124) << "it would have gone on for ever";
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(files(), Arguments());
    for (int rank = 0; rank < ranks; ++rank) {
      for (int i = 0; i < 100 && process_of(rank) != 0; ++i) std::this_thread::sleep_for(50ms);
      const int left = process_of(rank);
      EXPECT_EQ(left, 0) << "rank " << rank << " is still there";
      if (left != 0) kill(left, SIGKILL);
    }
    return outcome;
  }
};

TEST_F(SeveralEnds, WithOneThatIsKilled) {
  for (const int victim : {0, 1}) {
    const Outcome outcome = outcome_of(3, victim, SIGKILL);
    EXPECT_LE(told(outcome).size(), 1u) << outcome.err;
    EXPECT_NE(outcome.err.find("signal 9"), std::string::npos) << outcome.err;  // mpirun says it
  }
}

TEST_F(SeveralEnds, WithOneThatIsStopped) {
  for (const int victim : {0, 2}) {
    const Arguments lines = told(outcome_of(3, victim, SIGSTOP));
    ASSERT_EQ(lines.size(), 1u) << testing::PrintToString(lines);
    EXPECT_NE(lines[0].find("rank " + std::to_string(victim) + " has not answered"), std::string::npos) << lines[0];
  }
}

// ---- a GPU ----------------------------------------------------------------------------------------------------------
/// Frames that both backends prepare, by several ranks.
class SeveralBackends : public Several {
 protected:
  void SetUp() override {
    Several::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    const Outcome outcome = run({"--backend", "cuda", "--headless", "--objects", "1", "--size", "8x8"});
    if (outcome.code != 0) GTEST_SKIP() << "the backends are NOT compared: " << outcome.err;
  }

  /// As drawn_alone and drawn_by; where OpenGL is not the GPU's, CUDA says so.
  Json drawn(int ranks, const Arguments& arguments, const std::string& output) {
    const Arguments all = with(arguments, {"--output", output, "--stats", "stats.json"});
    const Outcome outcome = ranks == 1 ? run(all) : run_several(ranks, all);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    const Json json = Json::parse(content_of(folder_ / "stats.json"), nullptr, false);
    fs::remove(folder_ / "stats.json");
    return outcome.code == 0 ? json : Json();
  }
};

TEST_F(SeveralBackends, DrawTheSameTrianglesIntoTheSamePicture) {
  const Arguments path = with(among, {"--orbit", "--frames", "4", "--checksums"});
  for (const Arguments& more : {Arguments{"--budget", "20000"},
                                {"--budget", "20000", "--stream", "always"},
                                {"--budget", "20000", "--stream", "always", "--transfer", "50K"},
                                {"--budget", "20000", "--tiles", "equal", "--occlusion", "temporal"},
                                {"--lod", "error", "--balance", "bisection"},
                                {"--budget", "all", "--pet", "0", "--bins", "9", "--wireframe"}}) {
    SCOPED_TRACE(testing::PrintToString(more));
    const Arguments arguments = with(with(offscreen, path), with(more, {plant()}));
    const Json host = drawn(2, with(arguments, {"--backend", "host"}), "host.png");
    const Json cuda = drawn(2, with(arguments, {"--backend", "cuda"}), "cuda.png");
    ASSERT_FALSE(host.is_null() || cuda.is_null());
    EXPECT_TRUE(same("host.png", "cuda.png"));
    for (std::size_t rank = 0; rank < 2; ++rank) {
      for (const char* key : {"tile", "checksums", "drawn", "culled", "occluders"}) {
        EXPECT_EQ(cuda["ranks"][rank][key], host["ranks"][rank][key]) << rank << " " << key;
      }
      EXPECT_EQ(cuda["ranks"][rank]["stream"]["sent"], host["ranks"][rank]["stream"]["sent"]);
    }
    EXPECT_EQ(host["pictures"], "MPI");
    EXPECT_EQ(cuda["pictures"], cuda["backend"]["interop"] == true ? "CUDA IPC" : "MPI");
    if (std::ranges::find(more, "--transfer") != more.end()) continue;  // two may be sent as much each
    for (const char* backend : {"host", "cuda"}) {
      drawn(1, without_tiles(with(arguments, {"--backend", backend})), "alone.png");
      EXPECT_TRUE(same("alone.png", "cuda.png")) << backend;
    }
  }
}

TEST_F(SeveralBackends, DrawThePictureOfOneHoweverManyShareAGpu) {
  const Arguments flight =
      with(offscreen, {"--backend", "cuda", "--budget", "20000", "--fly", "--frames", "6", plant()});
  ASSERT_FALSE(drawn(1, flight, "alone.png").is_null());
  for (const int ranks : {2, 3, 7}) {
    for (const char* stream : {"always", "never"}) {
      ASSERT_FALSE(drawn(ranks, with(flight, {"--stream", stream}), "several.png").is_null());
      EXPECT_TRUE(same("alone.png", "several.png")) << ranks << " " << stream;
    }
  }
  for (const char* size : {"1x1", "3x1", "1x3"}) {  // some ranks have no pixel
    ASSERT_FALSE(drawn(1, with(flight, {"--size", size}), "alone.png").is_null());
    ASSERT_FALSE(drawn(5, with(flight, {"--size", size}), "several.png").is_null());
    EXPECT_TRUE(same("alone.png", "several.png")) << size;
  }
}

TEST_F(SeveralBackends, ScreensOfAWallAreTheHosts) {
  const Arguments arguments = with(with(offscreen, among), {"--wall", "2x1", "--budget", "20000", plant()});
  ASSERT_FALSE(drawn(2, with(arguments, {"--backend", "host"}), "host.png").is_null());
  ASSERT_FALSE(drawn(2, with(arguments, {"--backend", "cuda"}), "cuda.png").is_null());
  EXPECT_TRUE(same("host-0.png", "cuda-0.png"));
  EXPECT_TRUE(same("host-1.png", "cuda-1.png"));
}

}  // namespace
