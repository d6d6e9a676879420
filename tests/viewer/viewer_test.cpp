// SPDX-License-Identifier: MIT
// Runs pgl_viewer and looks at what it leaves: pictures, statistics, one-line errors.
#include "viewer/viewer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iomanip>
#include <set>
#include <sstream>
#include <string>
#include <variant>
#include <vector>

#include "scene/build_model.hpp"
#include "scene/import.hpp"
#include "scene/model_file.hpp"
#include "support/test_data.hpp"

namespace {

using namespace viewer_tests;

/// Inside the plant of 2,000 objects, where tanks, floors and vessels stand before others.
const std::vector<std::string> inside_cameras = {"-20,-12,2,20,10,3,60", "14,3,1.7,-10,8,3,70", "0,-30,6,0,10,4,50"};
TEST_F(Viewer, DrawsAPictureOfTheAskedSize) {
  const Json json = statistics(with(small_plant, {"--size", "167x91", "--output", "plant.png"}));
  SKIP_WITHOUT_GL(json);
  const Picture image = picture("plant.png");
  EXPECT_EQ(image.width, 167);
  EXPECT_EQ(image.height, 91);
  EXPECT_GT(image.colors(), 50u);
  EXPECT_EQ(json["size"], Json::array({167, 91}));
  EXPECT_EQ(files(), (std::vector<std::string>{"plant.png", "stats.json"}));
}

TEST_F(Viewer, StatisticsAreCompleteAndConsistent) {
  const Json json = statistics(with(small_plant, {"--budget", "2000", "--frames", "3"}));
  SKIP_WITHOUT_GL(json);
  EXPECT_EQ(json.at("objects"), 40);
  EXPECT_EQ(json.at("budget"), 2000);
  EXPECT_EQ(json.at("frames"), 3);
  EXPECT_EQ(json.at("model").at("meshes"), 40);
  const Json& drawn = json.at("drawn");
  EXPECT_GT(drawn.at("objects"), 0);
  EXPECT_LE(drawn.at("objects").get<int>() + json.at("culled").at("frustum").get<int>(), 40);
  EXPECT_GT(drawn.at("vertices"), 0);
  EXPECT_LE(drawn.at("vertices"), 2000);
  EXPECT_LE(drawn.at("vertices"), json.at("model").at("vertices"));
  EXPECT_GT(drawn.at("triangles"), 0);
  EXPECT_LE(drawn.at("triangles"), json.at("model").at("triangles"));
  EXPECT_EQ(drawn.at("checksum").get<std::string>().find_first_not_of("0123456789abcdef"), std::string::npos);
  EXPECT_EQ(drawn.at("checksum").get<std::string>().size(), 16u);
  double steps = 0.0;
  for (const char* step : {"cull", "project", "budget", "reform", "gather", "upload", "draw"}) {
    EXPECT_GE(json.at("ms").at(step).get<double>(), 0.0) << step;
    steps += json.at("ms").at(step).get<double>();
  }
  EXPECT_GT(json.at("ms").at("frame").get<double>(), 0.0);
  EXPECT_GT(steps, 0.0);
  EXPECT_GE(json.at("ms").at("import").get<double>(), 0.0);
  EXPECT_GT(json.at("ms").at("preprocess").get<double>(), 0.0);
  EXPECT_EQ(json.at("camera").at("eye").size(), 3u);
  EXPECT_EQ(json.at("camera").at("target").size(), 3u);
  for (const char* text : {"vendor", "renderer", "version"}) EXPECT_NE(json.at("gl").at(text), "") << text;
  EXPECT_NE(run({"--version"}).out.find(json.at("pgl").get<std::string>()), std::string::npos);
}

TEST_F(Viewer, PrintsATableOfTheSameNumbers) {
  const Outcome outcome = run(with(small_plant, {"--budget", "2000", "--stats", "stats.json"}));
  if (outcome.code == 3) GTEST_SKIP() << outcome.err;
  const Json json = Json::parse(content_of(folder_ / "stats.json"));
  const auto number = [&](const std::string& name) {
    const std::size_t at = outcome.out.find("\n" + name + " ");
    if (at == std::string::npos) return std::string("missing");
    std::string text = outcome.out.substr(at + 1 + name.size(), outcome.out.find('\n', at + 1) - at - 1 - name.size());
    std::erase_if(text, [](char c) { return c == ' ' || c == ','; });
    return text;
  };
  EXPECT_EQ(number("triangles in the model"), json["model"]["triangles"].dump());
  EXPECT_EQ(number("budget, vertices"), "2000");
  EXPECT_EQ(number("vertices drawn"), json["drawn"]["vertices"].dump());
  EXPECT_EQ(number("triangles drawn"), json["drawn"]["triangles"].dump());
  EXPECT_NE(number("ms reform"), "missing");
}

TEST_F(Viewer, ChecksumDependsOnTheFrameAlone) {
  const auto checksum = [&](std::vector<std::string> more) {
    const Json json = statistics(with(small_plant, std::move(more)));
    return json.is_null() ? std::string() : json["drawn"]["checksum"].get<std::string>();
  };
  const std::string first = checksum({"--budget", "3000", "--threads", "1"});
  if (first.empty()) GTEST_SKIP() << "this machine has no EGL to draw with";
  EXPECT_EQ(checksum({"--budget", "3000", "--threads", "1"}), first);
  EXPECT_EQ(checksum({"--budget", "3000", "--threads", "2"}), first);
  EXPECT_EQ(checksum({"--budget", "3000", "--threads", "7"}), first);
  EXPECT_NE(checksum({"--budget", "2999"}), first);
  EXPECT_NE(checksum({"--budget", "3000", "--seed", "2"}), first);
}

TEST_F(Viewer, ChecksumsAreOfEveryFrameInOrder) {
  const std::vector<std::string> turning =
      with(small_plant, {"--budget", "3000", "--orbit", "--camera", "10,0,3,0,0,3"});
  const Json three = statistics(with(turning, {"--frames", "3", "--checksums"}));
  SKIP_WITHOUT_GL(three);
  ASSERT_EQ(three["checksums"].size(), 3u);
  EXPECT_EQ(three["checksums"][2], three["drawn"]["checksum"]);
  EXPECT_NE(three["checksums"][0], three["checksums"][1]);
  const Json two = statistics(with(turning, {"--frames", "2"}));
  EXPECT_EQ(two["checksums"], Json::array());
  EXPECT_EQ(two["drawn"]["checksum"], three["checksums"][1]);
}

TEST_F(Viewer, HostIsTheBackendUnlessAskedOtherwise) {
  const Json json = statistics(small_plant);
  SKIP_WITHOUT_GL(json);
  EXPECT_EQ(json["backend"], Json::parse(R"({"name": "host", "gpu": "", "interop": false})"));
  EXPECT_EQ(statistics(with(small_plant, {"--backend", "host"}))["drawn"], json["drawn"]);
}

/// The cases that need more than a GPU: where that is missing they are skipped, on a machine with a GPU too.
class BackendsExtra : public Backends {};

TEST_F(Backends, WithoutAGpuCudaIsRefusedInOneLine) {
  // CUDA_VISIBLE_DEVICES hides a GPU that may be there.
  const Outcome outcome = run_as("env -u DISPLAY -u WAYLAND_DISPLAY CUDA_VISIBLE_DEVICES=",
                                 with(small_plant, {"--backend", "cuda", "--output", "a.png", "--stats", "a.json"}));
#if defined(PGL_VIEWER_CUDA)
  EXPECT_EQ(outcome.code, 3);
  EXPECT_NE(outcome.err.find("no GPU"), std::string::npos) << outcome.err;
#else
  EXPECT_EQ(outcome.code, 2);
  EXPECT_NE(outcome.err.find("built without CUDA"), std::string::npos) << outcome.err;
#endif
  EXPECT_TRUE(outcome.err.starts_with("pgl_viewer: --backend")) << outcome.err;
  EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
  EXPECT_EQ(outcome.out, "");
  EXPECT_EQ(files(), std::vector<std::string>());
}

TEST_F(Backends, DrawTheSameBytesFrameAfterFrame) {
  SKIP_WITHOUT_GPU();
  const std::vector<std::string> orbit = {"--headless", "--size", "160x90", "--orbit", "--frames", "12"};
  for (const std::string policy : {"exact", "fair", "paper"}) {
    const Json checksums =
        expect_same(with(orbit, {"--objects", "300", "--budget", "20000", "--policy", policy}))["checksums"];
    EXPECT_EQ(std::set(checksums.begin(), checksums.end()).size(), 12u) << "the frames do not differ";
  }
  expect_same(with(orbit, {"--objects", "1", "--budget", "all"}));
  expect_same(with(orbit, {"--objects", "2000", "--budget", "all", "--frames", "3"}));
  expect_same(with(orbit, {"--objects", "300", "--budget", "5000", "--min-triangles", "20", "--alpha", "1.2"}));
  // From inside, most of it is behind.
  expect_same(with(orbit, {"--objects", "300", "--budget", "9000", "--camera", "0.5,0.2,1,3,0,1"}));
}

TEST_F(BackendsExtra, DrawTheSameBytesWhereOpenGlIsNotTheGpus) {
  SKIP_WITHOUT_GPU();
  const fs::path mesa = "/usr/share/glvnd/egl_vendor.d/50_mesa.json";
  if (!fs::exists(mesa)) GTEST_SKIP() << "Mesa's OpenGL is not installed";
  before_ = "__EGL_VENDOR_LIBRARY_FILENAMES=" + mesa.string();
  expect_same({"--headless", "--size", "160x90", "--orbit", "--frames", "5", "--objects", "300", "--budget", "20000"});
}

TEST_F(Backends, CullTheSameObjectsFrameAfterFrame) {
  SKIP_WITHOUT_GPU();
  for (const std::string aos : {"0", "20", "all"}) {
    for (const std::string& camera : inside_cameras) {
      for (const std::string mode : {"on", "temporal"}) {
        expect_same({"--headless", "--size", "320x180", "--orbit", "--frames", "8", "--objects", "2000", "--budget",
                     "30000", "--occlusion", mode, "--aos", aos, "--camera", camera});
      }
    }
  }
  // Odd sizes, and all of a smaller plant.
  for (const std::string size : {"1x1", "7x133", "641x479"}) {
    expect_same({"--headless", "--size", size, "--objects", "300", "--budget", "all", "--pet", "0", "--occlusion", "on",
                 "--compactness", "0", "--camera", inside_cameras[0]});
  }
}

TEST_F(Backends, DrawTheSameBytesOfSharedAndMirroredMeshesAndWideIndices) {
  SKIP_WITHOUT_GPU();
  const std::vector<std::string> orbit = {"--headless", "--size", "64x64", "--orbit", "--frames", "5"};
  expect_same(with(orbit, {"--budget", "11", fs::absolute(support::fixture("nodes.gltf")).string()}));
  write_strip("strip.obj");
  expect_same(with(orbit, {"--budget", "40000", "--boundary", "slide", "strip.obj"}));
}

TEST_F(BackendsExtra, DrawTheSameBytesOfRealModels) {
  SKIP_WITHOUT_GPU();
  int found = 0;
  for (const char* name : {"single/stanford-bunny.obj", "ifc/mini_project.glb"}) {
    const fs::path file = support::real_model(name);
    if (file.empty()) continue;
    ++found;
    expect_same({"--headless", "--size", "320x200", "--orbit", "--frames", "5", "--budget", "9000", file.string()});
  }
  if (found == 0) GTEST_SKIP() << "real models absent";
}

TEST_F(Viewer, NeverDrawsMoreThanTheBudget) {
  for (const std::uint64_t budget : {0ull, 1ull, 10ull, 100ull, 1000ull, 10'000ull, 4'294'967'296ull}) {
    const Json json = statistics(with(small_plant, {"--budget", std::to_string(budget)}));
    SKIP_WITHOUT_GL(json);
    EXPECT_EQ(json["budget"], budget);
    EXPECT_LE(json["drawn"]["vertices"], budget);
    if (budget >= 10'000) {
      EXPECT_GT(json["drawn"]["vertices"], 0);
    }
  }
}

TEST_F(Viewer, BudgetZeroLeavesTheBackground) {
  const Json json = statistics(with(small_plant, {"--budget", "0", "--output", "none.png"}));
  SKIP_WITHOUT_GL(json);
  EXPECT_EQ(json["drawn"]["vertices"], 0);
  EXPECT_EQ(json["drawn"]["triangles"], 0);
  EXPECT_EQ(json["drawn"]["objects"], 0);
  EXPECT_EQ(picture("none.png").colors(), 1u);
}

TEST_F(Viewer, AllOfAFileIsDrawnWhereTheBudgetAllows) {
  write_tetrahedron("one.obj");
  write(folder_ / "two.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n");
  const Json json = statistics({"--headless", "--size", "64x64", "--budget", "all", "one.obj", "two.obj"});
  SKIP_WITHOUT_GL(json);
  EXPECT_EQ(json["objects"], 2);
  EXPECT_EQ(json["model"]["meshes"], 2);
  EXPECT_EQ(json["model"]["vertices"], 7);
  EXPECT_EQ(json["model"]["triangles"], 5);
  EXPECT_EQ(json["drawn"]["objects"], 2);
  EXPECT_EQ(json["drawn"]["vertices"], 7);
  EXPECT_EQ(json["drawn"]["triangles"], 5);
}

TEST_F(Viewer, WeldingStitchesThePlant) {
  const Json whole = statistics(small_plant);
  SKIP_WITHOUT_GL(whole);
  const Json torn = statistics(with(small_plant, {"--no-weld"}));
  EXPECT_EQ(whole["model"]["triangles"], torn["model"]["triangles"]);
  EXPECT_LT(whole["model"]["vertices"], torn["model"]["vertices"]);
  EXPECT_LT(whole["model"]["open_vertices"], torn["model"]["open_vertices"]);
}

TEST_F(Viewer, ChecksumIsFnv1aOfVerticesThenIndices) {
  const std::vector<std::array<float, 3>> corners = {{0.0f, 0.0f, 0.0f}, {1.5f, 0.0f, 0.0f}, {0.0f, 2.0f, -1.0f}};
  write(folder_ / "one.obj", "v 0 0 0\nv 1.5 0 0\nv 0 2 -1\nf 1 2 3\n");
  const Json json = statistics({"--headless", "--size", "64x64", "one.obj"});
  SKIP_WITHOUT_GL(json);
  // Preprocessing may put the three vertices in any order; the triangle keeps its own.
  std::array<std::uint32_t, 3> place = {0, 1, 2};
  std::set<std::string> possible;
  do {
    std::array<std::uint32_t, 15> words{};  // x, y, z, object of each vertex; three indices
    for (std::size_t v = 0; v < 3; ++v) {
      std::memcpy(&words[place[v] * 4], corners[v].data(), 12);
      words[12 + v] = place[v];
    }
    std::uint64_t hash = 14695981039346656037u;
    for (std::size_t i = 0; i < 60; ++i) {
      hash ^= reinterpret_cast<const unsigned char*>(words.data())[i];
      hash *= 1099511628211u;
    }
    std::ostringstream text;
    text << std::hex << std::setw(16) << std::setfill('0') << hash;
    possible.insert(text.str());
  } while (std::ranges::next_permutation(place).found);
  EXPECT_EQ(possible.size(), 6u);
  EXPECT_TRUE(possible.contains(json["drawn"]["checksum"].get<std::string>())) << json["drawn"];
}

TEST_F(Viewer, ObjectsDifferInColorAndTheNearerOneHidesTheOther) {
  const auto front_color = [&](const std::string& first_z, const std::string& second_z) {
    std::string text = "o first\n", second = "o second\n";
    for (const char* corner : {"-5 -5 ", "5 -5 ", "0 5 "}) {
      text += "v " + std::string(corner) + first_z + "\n";
      second += "v " + std::string(corner) + second_z + "\n";
    }
    write(folder_ / "two.obj", text + "f 1 2 3\n" + second + "f 4 5 6\n");
    const Json json =
        statistics({"--headless", "--size", "32x32", "--camera", "0,0,9,0,0,0", "--output", "two.png", "two.obj"});
    EXPECT_TRUE(json.is_null() || json["drawn"]["objects"] == 2);
    return json.is_null() ? std::array<std::uint8_t, 3>{} : picture("two.png").at(16, 20);
  };
  const auto first = front_color("1", "0"), second = front_color("0", "1");
  if (first == std::array<std::uint8_t, 3>{}) GTEST_SKIP() << "this machine has no EGL to draw with";
  int difference = 0;
  for (std::size_t channel = 0; channel < 3; ++channel) {
    difference = std::max(difference, std::abs(first[channel] - second[channel]));
  }
  EXPECT_GT(difference, 20);
}

TEST_F(Viewer, PictureIsNeitherMirroredNorUpsideDown) {
  // Half of the upper left quarter, seen from the front.
  write(folder_ / "corner.obj", "v -1 1 0\nv -1 0 0\nv 0 1 0\nf 1 2 3\n");
  const Json json =
      statistics({"--headless", "--size", "64x64", "--camera", "0,0,2,0,0,0,90", "--output", "c.png", "corner.obj"});
  SKIP_WITHOUT_GL(json);
  ASSERT_EQ(json["drawn"]["triangles"], 1);
  const Picture image = picture("c.png");
  const auto background = image.at(63, 63);
  EXPECT_NE(image.at(20, 20), background);  // x = y = +-0.7 at a distance of 2 with 90 degrees
  EXPECT_EQ(image.at(43, 20), background);
  EXPECT_EQ(image.at(20, 43), background);
  EXPECT_EQ(image.at(43, 43), background);
}

TEST_F(Viewer, CameraThatLooksAwayCullsEverything) {
  write_tetrahedron("one.obj");
  const Json json =
      statistics({"--headless", "--size", "64x64", "--camera", "0,0,-5,0,0,-6", "--output", "away.png", "one.obj"});
  SKIP_WITHOUT_GL(json);
  EXPECT_EQ(json["culled"]["frustum"], 1);
  EXPECT_EQ(json["drawn"]["vertices"], 0);
  EXPECT_EQ(picture("away.png").colors(), 1u);
}

TEST_F(Viewer, AutomaticCameraHasTheWholeModelInThePicture) {
  write(folder_ / "flat.obj", "v -50 0 -1\nv 50 0 -1\nv 50 0 1\nv -50 0 1\nf 1 2 3\nf 1 3 4\n");
  for (const std::string size : {"200x50", "50x200", "90x90"}) {
    const Json json = statistics({"--headless", "--size", size, "--output", "fit.png", "flat.obj"});
    SKIP_WITHOUT_GL(json);
    const Picture image = picture("fit.png");
    const auto background = image.at(0, 0);
    EXPECT_GT(image.colors(), 1u);
    for (int x = 0; x < image.width; ++x) {
      EXPECT_EQ(image.at(x, 0), background);
      EXPECT_EQ(image.at(x, image.height - 1), background);
    }
    for (int y = 0; y < image.height; ++y) {
      EXPECT_EQ(image.at(0, y), background);
      EXPECT_EQ(image.at(image.width - 1, y), background);
    }
  }
}

TEST_F(Viewer, UpIsWhatWasAskedForElseWhatTheModelFileSays) {
  using pgl::scene::UpAxis;
  const pgl::scene::AnyModel model =
      pgl::scene::build_any_model(pgl::scene::import_scene(support::fixture("objects.obj")), {});
  const Json axes[] = {{0.0, 1.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
  const std::vector<std::string> small = {"--headless", "--size", "64x48"};
  for (const UpAxis told : {UpAxis::not_told, UpAxis::x, UpAxis::y, UpAxis::z}) {
    pgl::scene::ModelFileWriter writer(folder_ / "model.pgl");
    std::visit([&](const auto& part) { writer.append(part); }, model);
    writer.set_up(told);
    writer.finish();
    const Json of_file = statistics(with(small, {"model.pgl"}));
    SKIP_WITHOUT_GL(of_file);
    EXPECT_EQ(of_file["camera"]["up"], axes[static_cast<std::size_t>(told)]);
    const std::string names[] = {"", "x", "y", "z"};
    for (std::size_t asked = 1; asked < 4; ++asked) {
      const std::vector<std::string> arguments = with(small, {"--up", names[asked], "model.pgl"});
      EXPECT_EQ(statistics(arguments)["camera"]["up"], axes[asked]);
      const Json from = statistics(with(arguments, {"--camera", "5,6,7,0,0,0"}));
      EXPECT_EQ(from["camera"]["up"], axes[asked]);
    }
    EXPECT_EQ(statistics(with(small, {"--camera", "5,6,7,0,0,0", "model.pgl"}))["camera"]["up"],
              of_file["camera"]["up"]);
  }
}

TEST_F(Viewer, OrbitTurnsByADegreeAFrame) {
  const Json first = statistics(with(small_plant, {"--camera", "10,0,3,0,0,3"}));
  SKIP_WITHOUT_GL(first);
  const Json third = statistics(with(small_plant, {"--camera", "10,0,3,0,0,3", "--orbit", "--frames", "3"}));
  const double angle = std::atan2(third["camera"]["eye"][1].get<double>(), third["camera"]["eye"][0].get<double>());
  EXPECT_NEAR(std::abs(angle), 2.0 * std::acos(-1.0) / 180.0, 1e-9);
  EXPECT_NEAR(third["camera"]["eye"][2].get<double>(), 3.0, 1e-9);
}

TEST_F(Viewer, WireframeDrawsTheSameTrianglesOtherwise) {
  const Json solid = statistics(with(small_plant, {"--output", "solid.png"}));
  SKIP_WITHOUT_GL(solid);
  const Json wire = statistics(with(small_plant, {"--output", "wire.png", "--wireframe"}));
  EXPECT_EQ(solid["drawn"], wire["drawn"]);
  EXPECT_NE(picture("solid.png").pixels, picture("wire.png").pixels);
}

TEST_F(Viewer, WhatTheWallHidesIsLeftOut) {
  write_wall("wall.obj");
  const std::vector<std::string> arguments = {"--headless", "--size",       "160x120",     "--budget", "all",
                                              "--camera",   "0,0,20,0,0,0", "--occlusion", "on",       "wall.obj"};
  const Json culled = statistics(with(arguments, {"--aos", "1", "--output", "culled.png"}));
  SKIP_WITHOUT_GL(culled);
  EXPECT_EQ(culled["objects"], 5);
  EXPECT_EQ(culled["occluders"], 1);
  EXPECT_EQ(culled["culled"], Json::parse(R"({"frustum": 0, "occlusion": 3})"));
  EXPECT_EQ(culled["drawn"]["objects"], 2);
  EXPECT_EQ(culled["gl"]["samples"], 0);  // none but the pixel's centre
  for (const char* step : {"occluders", "depth", "hzm", "occlusion"}) {
    EXPECT_GE(culled.at("ms").at(step).get<double>(), 0.0) << step;
  }
  const Json whole = statistics(with(arguments, {"--aos", "0", "--output", "whole.png"}));
  EXPECT_EQ(whole["occluders"], 0);
  EXPECT_EQ(whole["culled"], Json::parse(R"({"frustum": 0, "occlusion": 0})"));
  EXPECT_EQ(whole["drawn"]["objects"], 5);
  EXPECT_GT(picture("whole.png").colors(), 3u);
  EXPECT_EQ(picture("culled.png").pixels, picture("whole.png").pixels);

  // All as occluders: those that others hide may go, and do not take with them what hides them.
  const Json all = statistics(with(arguments, {"--aos", "all"}));
  EXPECT_EQ(all["occluders"], 5);
  EXPECT_EQ(all["drawn"], culled["drawn"]);
  // From behind, the wall hides nothing.
  const Json behind = statistics(with(arguments, {"--aos", "1", "--camera", "0,0,-20,0,0,0"}));
  EXPECT_EQ(behind["culled"], Json::parse(R"({"frustum": 0, "occlusion": 0})"));
  // Without culling there are no occluders, and times of its steps.
  const Json off = statistics(with(arguments, {"--occlusion", "off"}));
  EXPECT_EQ(off["occluders"], 0);
  EXPECT_EQ(off["culled"]["occlusion"], 0);
  EXPECT_EQ(off["drawn"]["checksum"], whole["drawn"]["checksum"]);
  EXPECT_FALSE(off["ms"].contains("depth"));
}

TEST_F(Viewer, TheCompactnessThresholdDecidesWhoMayHideOthers) {
  // Four thin bars in a frame around nothing: the area of its faces is small beside that of its box.
  std::ostringstream text;
  text << "o frame\n";
  const float bars[4][4] = {{-5, -5, 5, -4.9f}, {-5, 4.9f, 5, 5}, {-5, -4.9f, -4.9f, 4.9f}, {4.9f, -4.9f, 5, 4.9f}};
  for (const auto& bar : bars) {
    text << "v " << bar[0] << ' ' << bar[1] << " 0\nv " << bar[2] << ' ' << bar[1] << " 0\nv " << bar[2] << ' '
         << bar[3] << " 0\nv " << bar[0] << ' ' << bar[3] << " 0\nf -4 -3 -2\nf -4 -2 -1\n";
  }
  write(folder_ / "frame.obj", text.str());
  const std::vector<std::string> arguments = {"--headless",   "--size",      "64x64", "--camera",
                                              "0,0,20,0,0,0", "--occlusion", "on",    "frame.obj"};
  const Json all = statistics(with(arguments, {"--compactness", "0"}));
  SKIP_WITHOUT_GL(all);
  EXPECT_EQ(all["occluders"], 1);
  EXPECT_EQ(statistics(with(arguments, {"--compactness", "0.5"}))["occluders"], 0);
}

TEST_F(Viewer, CullingChangesNoPixelOfThePlantAtFullDetail) {
  std::size_t hidden = 0;
  for (const std::string& camera : inside_cameras) {
    SCOPED_TRACE(camera);
    const std::vector<std::string> arguments = {"--headless", "--objects",   "2000",  "--size", "480x270",
                                                "--budget",   "all",         "--pet", "0",      "--camera",
                                                camera,       "--occlusion", "on"};
    const Json whole = statistics(with(arguments, {"--aos", "0", "--output", "whole.png"}));
    SKIP_WITHOUT_GL(whole);
    EXPECT_EQ(whole["culled"]["occlusion"], 0);
    const Picture expected = picture("whole.png");
    for (const std::vector<std::string>& occluders : {std::vector<std::string>{},
                                                      {"--aos", "20"},
                                                      {"--aos", "all", "--compactness", "0"},
                                                      {"--occlusion", "temporal", "--aos", "50", "--frames", "2"}}) {
      const Json culled = statistics(with(with(arguments, {"--output", "culled.png"}), occluders));
      EXPECT_EQ(culled["culled"]["frustum"], whole["culled"]["frustum"]);
      EXPECT_GT(culled["culled"]["occlusion"], 0);
      EXPECT_LT(culled["drawn"]["vertices"], whole["drawn"]["vertices"]);
      hidden += culled["culled"]["occlusion"].get<std::size_t>();
      const Picture seen = picture("culled.png");
      ASSERT_EQ(seen.pixels.size(), expected.pixels.size());
      std::size_t different = 0;
      for (std::size_t i = 0; i < seen.pixels.size(); ++i) different += seen.pixels[i] != expected.pixels[i] ? 1 : 0;
      EXPECT_EQ(different, 0u) << testing::PrintToString(occluders);
    }
  }
  EXPECT_GT(hidden, 500u);
}

TEST_F(Viewer, TemporalCullingLosesNothingWhileTheCameraMoves) {
  // Each frame equals the same one without culling, though its first occluders were chosen by what the one before
  // showed.
  for (const char* frames : {"1", "2", "6"}) {
    SCOPED_TRACE(frames);
    const std::vector<std::string> arguments = {
        "--headless", "--objects", "2000",    "--size",   "480x270", "--budget", "all",
        "--pet",      "0",         "--orbit", "--frames", frames,    "--camera", "-20,-12,2,-16,-8,2,70"};
    const Json whole = statistics(with(arguments, {"--occlusion", "on", "--aos", "0", "--output", "whole.png"}));
    SKIP_WITHOUT_GL(whole);
    const Json culled =
        statistics(with(arguments, {"--occlusion", "temporal", "--aos", "10", "--output", "culled.png"}));
    EXPECT_EQ(culled["occluders"], 20);
    EXPECT_GT(culled["culled"]["occlusion"], 0);
    EXPECT_TRUE(picture("culled.png").pixels == picture("whole.png").pixels);
  }
}

TEST_F(Viewer, TemporalCullingFollowsTheCameraAroundTheWall) {
  write_wall("wall.obj");
  const std::vector<std::string> arguments = {"--headless",  "--size",   "64x48",    "--budget",    "all", "--aos", "1",
                                              "--occlusion", "temporal", "--camera", "0,0,20,0,0,0"};
  const Json still = statistics(with(arguments, {"--frames", "4", "wall.obj"}));
  SKIP_WITHOUT_GL(still);
  EXPECT_EQ(still["culled"]["occlusion"], 3);
  EXPECT_EQ(still["drawn"]["objects"], 2);
  EXPECT_EQ(still["occluders"], 2);  // the wall, and then what it does not hide
  const Json half_round = statistics(with(arguments, {"--orbit", "--frames", "181", "wall.obj"}));
  EXPECT_LT(half_round["camera"]["eye"][2], -19.9);
  EXPECT_EQ(half_round["culled"]["occlusion"], 0);
  const Json round = statistics(with(arguments, {"--orbit", "--frames", "361", "wall.obj"}));
  EXPECT_EQ(round["culled"]["occlusion"], 3);
}

TEST_F(Viewer, CullingDoesNotDependOnTheThreads) {
  const std::vector<std::string> arguments = {
      "--headless", "--objects", "2000",     "--size",          "320x180",     "--budget", "20000",      "--orbit",
      "--frames",   "4",         "--camera", inside_cameras[0], "--occlusion", "on",       "--checksums"};
  for (const char* mode : {"on", "temporal"}) {
    const Json one = statistics(with(arguments, {"--threads", "1", "--occlusion", mode}));
    SKIP_WITHOUT_GL(one);
    EXPECT_EQ(one["checksums"].size(), 4u);
    for (const char* threads : {"2", "5"}) {
      const Json more = statistics(with(arguments, {"--threads", threads, "--occlusion", mode}));
      for (const char* key : {"checksums", "drawn", "culled", "occluders"}) EXPECT_EQ(more[key], one[key]) << key;
    }
  }
}

TEST_F(Viewer, TheReferenceShowsOccludersHiddenBoxesAndTheFrustum) {
  write_wall("wall.obj");
  const std::vector<std::string> arguments = {"--headless",   "--size",   "200x150",     "--camera",
                                              "0,0,20,0,0,0", "wall.obj", "--reference", "outside.png"};
  const auto count = [&](auto&& like) {
    const Picture image = picture("outside.png");
    EXPECT_EQ(image.width, 200);
    EXPECT_EQ(image.height, 150);
    return std::ranges::count_if(image.pixels, [&](const auto& p) { return like(int{p[0]}, int{p[1]}, int{p[2]}); });
  };
  const auto purple = [](int r, int g, int b) { return r > g + 40 && b > r + 10; };
  const auto red = [](int r, int g, int b) { return r > g + 60 && r > b + 10; };
  const auto black = [](int r, int g, int b) { return r < 60 && g < 60 && b < 60; };

  const Json on = statistics(with(arguments, {"--occlusion", "on", "--aos", "1"}));
  SKIP_WITHOUT_GL(on);
  EXPECT_EQ(on["culled"]["occlusion"], 3);
  EXPECT_GT(count(purple), 100);
  EXPECT_GT(count(red), 30);
  EXPECT_GT(count(black), 100);

  const Json off = statistics(arguments);
  EXPECT_EQ(off["drawn"]["objects"], 5);
  EXPECT_EQ(count(purple), 0);
  EXPECT_EQ(count(red), 0);
  EXPECT_GT(count(black), 100);
}

TEST_F(Viewer, TheReferenceLeavesThePictureAndTheNumbersAlone) {
  const std::vector<std::string> arguments = with(small_plant, {"--budget", "2000", "--occlusion", "on"});
  const Json plain = statistics(with(arguments, {"--output", "plain.png"}));
  SKIP_WITHOUT_GL(plain);
  const Json both = statistics(with(arguments, {"--output", "a.png", "--reference", "b.png"}));
  for (const char* key : {"drawn", "culled", "occluders", "camera", "gl"}) EXPECT_EQ(both[key], plain[key]) << key;
  EXPECT_EQ(picture("a.png").pixels, picture("plain.png").pixels);
  EXPECT_NE(picture("b.png").pixels, picture("plain.png").pixels);
}

TEST_F(Viewer, WithoutADisplayItDrawsOffscreen) {
  const Outcome outcome = run({"--objects", "5", "--size", "32x32", "--output", "a.png"});
  if (outcome.code == 3) GTEST_SKIP() << outcome.err;
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(picture("a.png").width, 32);
}

TEST_F(Viewer, WithADisplayItOpensAWindow) {
  if (std::system("command -v xvfb-run >/dev/null") != 0) GTEST_SKIP() << "xvfb-run is not installed";
  const Outcome outcome = run_as(
      "env -u WAYLAND_DISPLAY xvfb-run -a",
      with({"--objects", "40", "--size", "160x90"}, {"--frames", "3", "--output", "w.png", "--stats", "stats.json"}));
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Picture window = picture("w.png");
  EXPECT_EQ(window.width, 160);
  EXPECT_EQ(window.height, 90);
  EXPECT_GT(window.colors(), 50u);
  const std::string seen = Json::parse(content_of(folder_ / "stats.json"))["drawn"]["checksum"];
  const Json offscreen = statistics(small_plant);
  if (!offscreen.is_null()) {
    EXPECT_EQ(offscreen["drawn"]["checksum"], seen);
  }
}

TEST_F(Viewer, ImpossibleOptionsAreRefusedInOneLine) {
  const std::vector<std::vector<std::string>> refused = {{"--budget", "-1"},
                                                         {"--budget", "4294967297"},
                                                         {"--budget", "many"},
                                                         {"--budget", "1e6"},
                                                         {"--budget", ""},
                                                         {"--budget"},
                                                         {"--objects", "0"},
                                                         {"--objects", "718001"},
                                                         {"--objects", "3.5"},
                                                         {"--seed", "-1"},
                                                         {"--alpha", "1"},
                                                         {"--alpha", "64.5"},
                                                         {"--alpha", "nan"},
                                                         {"--pet", "-0.5"},
                                                         {"--pet", "inf"},
                                                         {"--min-triangles", "4294967296"},
                                                         {"--policy", "best"},
                                                         {"--metric", "volume"},
                                                         {"--boundary", "free"},
                                                         {"--backend", "gpu"},
                                                         {"--camera", "1,2,3"},
                                                         {"--camera", "1,2,3,1,2,3"},
                                                         {"--camera", "0,0,0,0,0,x"},
                                                         {"--camera", "0,0,0,0,0,nan"},
                                                         {"--camera", "0,0,0,1,1,1,180"},
                                                         {"--size", "0x10"},
                                                         {"--size", "10x16385"},
                                                         {"--size", "10"},
                                                         {"--size", "10x10x10"},
                                                         {"--size", "-5x5"},
                                                         {"--frames", "0"},
                                                         {"--threads", "0"},
                                                         {"--threads", "1025"},
                                                         {"--occlusion", "maybe"},
                                                         {"--aos", "-1"},
                                                         {"--aos", "4294967296"},
                                                         {"--aos", "many"},
                                                         {"--compactness", "-0.1"},
                                                         {"--compactness", "1.5"},
                                                         {"--compactness", "nan"},
                                                         {"--aos", "20"},
                                                         {"--compactness", "0.5"},
                                                         {"--aos", "20", "--occlusion", "off"},
                                                         {"--aos"},
                                                         {"--refine", "-1", "--occlusion", "on"},
                                                         {"--refine", "17", "--occlusion", "on"},
                                                         {"--refine", "1.5", "--occlusion", "on"},
                                                         {"--refine", "2"},
                                                         {"--reference", "picture.jpg"},
                                                         {"--reference", ""},
                                                         {"--output", "picture.jpg"},
                                                         {"--output", ""},
                                                         {"--stats", ""},
                                                         {"--split"},
                                                         {"--flatten"},
                                                         {"--refuse-non-finite"},
                                                         {"--turbo"}};
  for (const auto& options : refused) {
    SCOPED_TRACE(testing::PrintToString(options));
    // Later than the good ones, so that those were read.
    expect_refused(run(with({"--headless", "--output", "a.png", "--stats", "a.json", "--objects", "5"}, options)),
                   options[0]);
  }
}

TEST_F(Viewer, ChecksumsNeedStatistics) {
  expect_refused(run({"--headless", "--objects", "5", "--checksums"}), "--checksums");
}

TEST_F(Viewer, OptionsOfThePlantDoNotGoWithFiles) {
  write_tetrahedron("one.obj");
  expect_refused(run({"--headless", "--objects", "5", "one.obj"}), "--objects", {"one.obj"});
  expect_refused(run({"--headless", "--seed", "5", "one.obj"}), "--seed", {"one.obj"});
}

TEST_F(Viewer, BadFilesAreRefusedInOneLine) {
  write(folder_ / "empty.ply", "");
  write(folder_ / "noise.glb", std::string("\x93\x01\xff\x00\x7f noise", 12));
  write(folder_ / "strange.xyz", "0 0 0\n");
  write(folder_ / "points.obj", "v 0 0 0\nv 1 0 0\n");
  fs::create_directory(folder_ / "folder.stl");
  const std::vector<std::string> before = files();
  for (const std::string name : {"missing.obj", "empty.ply", "noise.glb", "strange.xyz", "points.obj", "folder.stl"}) {
    SCOPED_TRACE(name);
    expect_refused(run({"--headless", "--output", "a.png", "--stats", "a.json", name}), name, before);
  }
}

TEST_F(Viewer, PlacesThatCannotBeWrittenAreRefusedBeforeTheWork) {
  fs::create_directory(folder_ / "taken.png");
  const std::vector<std::string> kept = {"taken.png"};
  // This file is found missing when the work begins.
  const std::vector<std::string> work = {"--headless", "missing.obj"};
  expect_refused(run(with(work, {"--output", "nowhere/a.png", "--stats", "a.json"})), "--output", kept);
  expect_refused(run(with(work, {"--output", "a.png", "--stats", "nowhere/a.json"})), "--stats", kept);
  expect_refused(run(with(work, {"--output", "two\nlines/a.png"})), "--output", kept);
  expect_refused(run(with(work, {"--output", "taken.png"})), "--output", kept);
  expect_refused(run(with(work, {"--output", "a.png", "--stats", "taken.png"})), "--stats", kept);
  expect_refused(run(with(work, {"--stats", "/dev/null"})), "--stats", kept);
  expect_refused(run(with(work, {"--output", "same.png", "--stats", "./same.png"})), "--stats", kept);
  expect_refused(run(with(work, {"--output", "a.png", "--reference", "nowhere/b.png"})), "--reference", kept);
  expect_refused(run(with(work, {"--reference", "taken.png"})), "--reference", kept);
  expect_refused(run(with(work, {"--output", "same.png", "--reference", "./same.png"})), "--reference", kept);
  expect_refused(run(with(work, {"--reference", "same.png", "--stats", "same.png"})), "--stats", kept);
}

TEST_F(Viewer, FailureLeavesOldFilesAsTheyWere) {
  write(folder_ / "a.png", "old picture");
  write(folder_ / "a.json", "old numbers");
  expect_refused(run({"--headless", "--output", "a.png", "--stats", "a.json", "missing.obj"}), "missing.obj",
                 {"a.json", "a.png"});
  EXPECT_EQ(content_of(folder_ / "a.png"), "old picture");
  EXPECT_EQ(content_of(folder_ / "a.json"), "old numbers");
}

TEST_F(Viewer, SuccessReplacesOldFiles) {
  write(folder_ / "a.png", "old picture");
  const Outcome outcome = run(with(small_plant, {"--output", "a.png"}));
  if (outcome.code == 3) GTEST_SKIP() << outcome.err;
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(picture("a.png").width, 160);
  EXPECT_EQ(files(), std::vector<std::string>{"a.png"});
}

TEST_F(Viewer, HelpAndVersionArePrinted) {
  const Outcome help = run({"--help"});
  EXPECT_EQ(help.code, 0);
  for (const char* option : {"--budget", "--camera", "--size", "--output", "--stats", "--frames", "--headless",
                             "--occlusion", "--aos", "--compactness", "--refine", "--reference"}) {
    EXPECT_NE(help.out.find(option), std::string::npos) << option;
  }
  const Outcome version = run({"--version"});
  EXPECT_EQ(version.code, 0);
  EXPECT_TRUE(version.out.starts_with("pgl_viewer "));
}

}  // namespace
