// SPDX-License-Identifier: MIT
// Runs pgl_viewer on models that are streamed: what is drawn, what frames send, what memory they take, and model files.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <span>
#include <sstream>
#include <string>
#include <variant>
#include <vector>

#include "pgl/host/limit_transfer.hpp"
#include "scene/build_plant.hpp"
#include "scene/model_file.hpp"
#include "scene/model_view.hpp"
#include "support/test_data.hpp"
#include "viewer/viewer.hpp"

namespace {

using namespace viewer_tests;
using Arguments = std::vector<std::string>;

const Arguments offscreen = {"--headless", "--size", "160x100"};
const Arguments plant = with(offscreen, {"--objects", "40"});
/// Among the 40 objects of that plant: a third is behind, some are near.
const Arguments among = {"--camera", "6,2,1,0,0,1,60", "--up", "z"};

/// Makes a model file with pgl_preprocess, in the folder of the test; true if that went well.
testing::AssertionResult preprocess(const fs::path& folder, const Arguments& arguments) {
  std::string line = "cd '" + folder.string() + "' && '" PGL_PREPROCESS "'";
  for (const std::string& argument : arguments) line += " '" + argument + "'";
  const int status = std::system((line + " >/dev/null 2>&1 </dev/null").c_str());
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) return testing::AssertionFailure() << line << ": " << status;
  return testing::AssertionSuccess();
}

std::uint64_t number(const Json& json) {
  return json.is_number_unsigned() ? json.get<std::uint64_t>() : ~std::uint64_t{0};
}

/// The bytes that frames sent, one after another.
std::vector<std::uint64_t> sent_bytes(const Json& json) {
  std::vector<std::uint64_t> bytes;
  for (const Json& frame : json.at("stream").at("sent")) bytes.push_back(frame.at("bytes"));
  return bytes;
}

/// The memory that was planned, all in all.
std::uint64_t planned(const Json& json) {
  const Json& memory = json.at("stream").at("memory");
  return number(memory.at("resident")) + number(memory.at("blocks")) + number(memory.at("drawn"));
}

/// Six objects in a row, of 16 vertices each and all the 560 triangles that these can have: many more than two for a
/// vertex.
void write_dense(const fs::path& file) {
  std::ostringstream text;
  for (int object = 0; object < 6; ++object) {
    text << "o dense" << object << "\n";
    for (int v = 0; v < 16; ++v) {
      text << "v " << object * 30 + (v * 7) % 16 << ' ' << (v * 5) % 16 << ' ' << (v * v) % 17 << "\n";
    }
    for (int a = 1; a <= 16; ++a) {
      for (int b = a + 1; b <= 16; ++b) {
        for (int c = b + 1; c <= 16; ++c) {
          text << "f " << object * 16 + a << ' ' << object * 16 + b << ' ' << object * 16 + c << "\n";
        }
      }
    }
  }
  write(file, text.str());
}

class Stream : public Viewer {
 protected:
  /// Draws the frames with the whole model in memory and streamed, and expects the same. What the streamed run told.
  Json expect_as_whole(const Arguments& arguments) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    const Json whole = statistics(with(arguments, {"--checksums", "--stream", "never"}));
    if (whole.is_null()) return {};
    EXPECT_EQ(whole.at("stream").at("streams"), false);
    EXPECT_EQ(whole.at("stream").at("sent"), Json::array());
    const Json streamed = statistics(with(arguments, {"--checksums", "--stream", "always"}));
    EXPECT_EQ(streamed.value("checksums", Json()).size(), whole.at("frames").get<std::size_t>());
    for (const char* key : {"checksums", "drawn", "culled", "occluders", "camera", "model"}) {
      EXPECT_EQ(streamed.value(key, Json()), whole.at(key)) << key;
    }
    if (!streamed.contains("stream")) return streamed;
    EXPECT_EQ(streamed.at("stream").at("streams"), true);
    EXPECT_EQ(streamed.at("stream").at("sent").size(), whole.at("frames").get<std::size_t>());
    return streamed;
  }
};

TEST_F(Stream, FramesOfAPathAreThoseOfTheWholeModel) {
  for (const Arguments& path : {Arguments{"--fly"}, with(among, {"--orbit"})}) {
    const Json json = expect_as_whole(with(with(plant, path), {"--budget", "3000", "--frames", "10"}));
    SKIP_WITHOUT_GL(json);
    const std::set<Json> different(json["checksums"].begin(), json["checksums"].end());
    EXPECT_GE(different.size(), 6u);
  }
  for (const Arguments& selection : {Arguments{"--policy", "fair", "--min-triangles", "20"},
                                     {"--policy", "paper", "--alpha", "1.2"},
                                     {"--no-weld", "--pet", "50"}}) {
    expect_as_whole(with(with(plant, selection), {"--budget", "2500", "--fly", "--frames", "6"}));
  }
}

TEST_F(Stream, WhatIsHiddenIsTheSame) {
  write_wall("wall.obj");
  for (const std::string mode : {"on", "temporal"}) {
    const Json wall = expect_as_whole(with(offscreen, {"--camera", "0,0,20,0,0,0", "--aos", "1", "--occlusion", mode,
                                                       "--orbit", "--frames", "4", "wall.obj"}));
    SKIP_WITHOUT_GL(wall);
    EXPECT_EQ(wall["culled"]["occlusion"], 3);
    const Json inside = expect_as_whole(with(offscreen, {"--objects", "300", "--budget", "20000", "--occlusion", mode,
                                                         "--camera", "-8,-5,2,6,4,2,60", "--orbit", "--frames", "4"}));
    EXPECT_GT(inside["culled"]["occlusion"], 0);
    EXPECT_GT(inside["occluders"], 10);
    expect_as_whole(with(plant, {"--fly", "--frames", "6", "--occlusion", mode, "--compactness", "0"}));
  }
}

TEST_F(Stream, SharedAndMirroredMeshesAndWideIndicesAreTheSame) {
  const std::string nodes = fs::absolute(support::fixture("nodes.gltf")).string();
  for (const char* budget : {"7", "11", "all"}) {
    const Json json = expect_as_whole(with(offscreen, {"--budget", budget, "--orbit", "--frames", "4", nodes}));
    SKIP_WITHOUT_GL(json);
    EXPECT_GT(json["objects"], json["model"]["meshes"]) << "none is shared";
  }
  write_strip("strip.obj");
  const Json wide = expect_as_whole(
      with(offscreen, {"--budget", "40000", "--boundary", "slide", "--fly", "--frames", "3", "strip.obj"}));
  for (const Json& frame : wide["stream"]["sent"]) {
    EXPECT_EQ(number(frame["bytes"]), 12 * number(frame["vertices"]) + 12 * number(frame["triangles"]));
  }
}

TEST_F(Stream, RealModelsAreTheSame) {
  int found = 0;
  for (const char* name : {"single/stanford-bunny.obj", "ifc/mini_project.glb", "single/2CylinderEngine.glb"}) {
    const fs::path file = support::real_model(name);
    if (file.empty()) continue;
    ++found;
    const Json json = expect_as_whole(with(offscreen, {"--fly", "--frames", "6", "--budget", "9000", file.string()}));
    SKIP_WITHOUT_GL(json);
    EXPECT_GT(sent_bytes(json)[0], 0u);
  }
  if (found == 0) GTEST_SKIP() << "real models absent";
}

TEST_F(Stream, MeshesWithManyTrianglesAVertexHaveRoom) {
  write_dense(folder_ / "dense.obj");
  for (const char* budget : {"20", "50", "all"}) {
    const Json json = expect_as_whole(with(
        offscreen, {"--budget", budget, "--pet", "0", "--fly", "--frames", "12", "--boundary", "slide", "dense.obj"}));
    SKIP_WITHOUT_GL(json);
    std::uint64_t most = 0;
    for (const Json& frame : json["stream"]["sent"]) most = std::max(most, number(frame["triangles"]));
    EXPECT_GT(most, 2 * 12u) << "no more than two triangles a vertex";
    EXPECT_GE(number(json["stream"]["memory"]["triangles"]), number(json["drawn"]["triangles"]));
  }
}

TEST_F(Stream, AnyBudgetOfAnyPolicyIsTheSame) {
  struct Case {
    std::string policy, budget;
  };
  for (const auto& [policy, budget] :
       {Case{"exact", "0"}, Case{"exact", "1"}, Case{"exact", "all"}, Case{"fair", "0"}, Case{"fair", "100"},
        Case{"fair", "all"}, Case{"paper", "0"}, Case{"paper", "100"}, Case{"paper", "1100"}, Case{"paper", "all"}}) {
    const Json json = expect_as_whole(
        with(with(plant, among), {"--budget", budget, "--policy", policy, "--frames", "2", "--orbit", "--pet", "0"}));
    SKIP_WITHOUT_GL(json);
    if (budget == "0") {
      EXPECT_EQ(sent_bytes(json), std::vector<std::uint64_t>(2, 0));
    } else if (policy == "paper" && budget == "100") {
      EXPECT_GT(json["drawn"]["vertices"], 100) << "this policy keeps to its budget";
    }
  }
}

TEST_F(Stream, OnlyWhatIsNewIsSent) {
  const Json still = statistics(with(plant, {"--budget", "3000", "--stream", "always", "--frames", "4"}));
  SKIP_WITHOUT_GL(still);
  const Json& first = still["stream"]["sent"][0];
  EXPECT_EQ(first["vertices"], still["drawn"]["vertices"]);
  EXPECT_EQ(first["triangles"], still["drawn"]["triangles"]);
  EXPECT_EQ(number(first["bytes"]), 12 * number(first["vertices"]) + 6 * number(first["triangles"]));
  for (std::size_t f = 1; f < 4; ++f) {
    EXPECT_EQ(still["stream"]["sent"][f],
              Json::parse(R"({"vertices": 0, "triangles": 0, "bytes": 0, "missing_bytes": 0})"));
  }
  // A degree to the side, what was there is most of what is needed, and nothing is missing.
  const Arguments turning = with(with(plant, among), {"--budget", "3000", "--stream", "always", "--orbit"});
  std::uint64_t before = 0;
  for (const char* frames : {"1", "2", "3", "4"}) {
    const Json json = statistics(with(turning, {"--frames", frames}));
    const Json& last = json["stream"]["sent"].back();
    const std::uint64_t drawn = number(json["drawn"]["vertices"]), sent = number(last["vertices"]);
    EXPECT_GE(before + sent, drawn);
    EXPECT_EQ(last["missing_bytes"], 0);
    if (before > 0) {
      EXPECT_LT(sent, drawn / 2);
    }
    before = drawn;
  }
}

TEST_F(Stream, NoFrameSendsMoreThanItMay) {
  const Arguments path = with(plant, {"--stream", "always", "--fly", "--frames", "12", "--checksums"});
  const Json free = statistics(path);
  SKIP_WITHOUT_GL(free);
  for (const std::uint64_t cap : {0u, 100u, 1000u, 1025u, 20'480u}) {
    const Json json = statistics(with(path, {"--transfer", std::to_string(cap)}));
    const std::vector<std::uint64_t> bytes = sent_bytes(json);
    ASSERT_EQ(bytes.size(), 12u);
    EXPECT_LE(*std::ranges::max_element(bytes), cap);
    EXPECT_GT(number(json["stream"]["sent"][0]["missing_bytes"]), 0u);
    EXPECT_NE(json["checksums"], free["checksums"]);
    EXPECT_EQ(number(json["stream"]["sent"][0]["missing_bytes"]) + bytes[0], sent_bytes(free)[0]);
    if (cap == 0) {
      EXPECT_EQ(json["drawn"]["vertices"], 0);
    } else if (cap >= 1000) {
      EXPECT_GT(json["drawn"]["triangles"], 0);
    }
  }
  const Json unlimited = statistics(with(path, {"--transfer", "1G"}));
  EXPECT_EQ(unlimited["checksums"], free["checksums"]);
  EXPECT_EQ(unlimited["stream"]["sent"], free["stream"]["sent"]);
  // The units are those of the help.
  EXPECT_EQ(statistics(with(path, {"--transfer", "20K"}))["stream"],
            statistics(with(path, {"--transfer", "20480"}))["stream"]);
}

TEST_F(Stream, AStillCameraConvergesAsFastAsPromised) {
  const auto model = pgl::scene::build_plant({.objects = 40}, 0, 40, true, {});
  const auto& built = std::get<pgl::scene::Model<std::uint16_t>>(model);
  const std::uint64_t step = pgl::host::least_cap(built.meshes, built.map, 0, {.cap = 0, .triangle_bytes = 6});
  ASSERT_GT(step, 0u);

  const Arguments still = with(with(plant, among), {"--stream", "always", "--checksums", "--pet", "0"});
  ASSERT_TRUE(preprocess(folder_, {"-o", "plant.pgl", "--objects", "40"}));
  const Arguments file = with(with(offscreen, among),
                              {"--stream", "always", "--checksums", "--pet", "0", "--occlusion", "on", "plant.pgl"});
  for (const Arguments& arguments : {still, with(still, {"--budget", "4000", "--policy", "fair"}), file}) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    const Json free = statistics(arguments);
    SKIP_WITHOUT_GL(free);
    const std::uint64_t all = sent_bytes(free)[0];
    ASSERT_GT(all, 4 * step);
    for (const std::uint64_t cap : {2 * step, 3 * step + 1, all / 3, all - 1}) {
      SCOPED_TRACE(cap);
      ASSERT_GT(cap, step);
      const std::uint64_t most = all / (cap - step + 1) + 1;  // limit_transfer.hpp
      const Json json =
          statistics(with(arguments, {"--transfer", std::to_string(cap), "--frames", std::to_string(most + 2)}));
      std::uint64_t arrived = 0, needed = 0, missing = all;
      for (const Json& frame : json["stream"]["sent"]) {
        const std::uint64_t bytes = number(frame["bytes"]);
        EXPECT_LE(bytes, cap);
        EXPECT_EQ(bytes > 0, missing > 0) << "after " << needed << " frames";
        needed += missing > 0 ? 1 : 0;
        arrived += bytes;
        missing = number(frame["missing_bytes"]);
        EXPECT_EQ(arrived + missing, all);  // nothing twice
      }
      EXPECT_EQ(missing, 0u);
      EXPECT_LE(needed, most);
      EXPECT_GE(needed, (all + cap - 1) / cap);
      const Json& checksums = json["checksums"];
      EXPECT_EQ(checksums.back(), free["checksums"][0]);
      const std::set<Json> different(checksums.begin(), checksums.end());
      EXPECT_EQ(different.size(), needed) << "a picture was drawn twice, or what had arrived changed";
    }
  }
}

TEST_F(Stream, TheMemoryPlannedIsWithinTheLimit) {
  const Arguments path = with(plant, {"--stream", "always", "--checksums", "--budget", "all", "--pet", "0"});
  const Json free = statistics(with(path, {"--frames", "6", "--fly"}));
  SKIP_WITHOUT_GL(free);
  const Json generous = statistics(with(path, {"--frames", "6", "--fly", "--gpu-memory", "1G"}));
  EXPECT_EQ(generous["checksums"], free["checksums"]);
  EXPECT_EQ(generous["stream"]["sent"], free["stream"]["sent"]);

  std::uint64_t room_before = 0;
  for (const std::uint64_t limit : {220'000u, 300'001u, 700'000u, 1'000'000u}) {
    SCOPED_TRACE(limit);
    const Arguments limited = with(path, {"--gpu-memory", std::to_string(limit)});
    const Json flight = statistics(with(limited, {"--frames", "6", "--fly"}));
    EXPECT_LE(planned(flight), limit);
    EXPECT_NE(flight["checksums"], free["checksums"]);
    const Json json = statistics(limited);
    const Json& memory = json["stream"]["memory"];
    EXPECT_LE(planned(json), limit);
    EXPECT_GT(planned(json), limit - limit / 20) << "there was room for more";
    EXPECT_LE(json["drawn"]["vertices"], memory["vertices"]);
    EXPECT_LE(json["drawn"]["triangles"], memory["triangles"]);
    EXPECT_GT(number(json["drawn"]["vertices"]), number(memory["vertices"]) / 2) << "the room is not used";
    EXPECT_GT(number(memory["vertices"]), room_before);
    room_before = number(memory["vertices"]);
    // What is drawn is what a budget of so many vertices would draw, where its triangles fit.
    const Json whole = statistics(
        with(plant, {"--stream", "never", "--checksums", "--pet", "0", "--budget", std::to_string(room_before)}));
    if (number(whole["drawn"]["triangles"]) <= number(memory["triangles"])) {
      EXPECT_EQ(json["drawn"], whole["drawn"]);
    }
    // Frames that send less leave more for the blocks.
    const Json capped = statistics(with(limited, {"--transfer", "2000"}));
    EXPECT_LE(planned(capped), limit);
    EXPECT_GT(number(capped["stream"]["memory"]["vertices"]), number(memory["vertices"]));
    EXPECT_LE(sent_bytes(capped)[0], 2000u);
  }
  // With culling: the map of depths and the occluders are in it.
  const Json culled = statistics(with(path, {"--gpu-memory", "700000", "--occlusion", "on", "--compactness", "0"}));
  EXPECT_LE(planned(culled), 700'000u);
  EXPECT_GT(number(culled["stream"]["memory"]["resident"]),
            number(free["stream"]["memory"]["resident"]) + 160 * 100 * 4);
}

TEST_F(Stream, NothingIsDrawnBeyondTheRoom) {
  write_dense(folder_ / "dense.obj");
  // A budget that may be exceeded, and triangles that are too many for the vertices that fit.
  for (const Arguments& arguments :
       {with(plant, {"--policy", "paper", "--budget", "1100"}), with(plant, {"--policy", "paper", "--budget", "all"}),
        with(offscreen, {"--budget", "60", "dense.obj"}), with(offscreen, {"--budget", "all", "dense.obj"})}) {
    const Json free = statistics(with(arguments, {"--stream", "always", "--pet", "0"}));
    SKIP_WITHOUT_GL(free);
    const std::uint64_t resident = number(free["stream"]["memory"]["resident"]);
    const std::uint64_t drawn = planned(free) - resident;
    for (const std::uint64_t limit : {resident + drawn / 3, resident + drawn / 2, resident + drawn * 3 / 4}) {
      SCOPED_TRACE(testing::PrintToString(arguments) + " " + std::to_string(limit));
      const Arguments limited =
          with(arguments, {"--pet", "0", "--stream", "always", "--gpu-memory", std::to_string(limit)});
      const Outcome outcome = run(limited);
      if (outcome.code == 1) {
        expect_refused(outcome, "--gpu-memory", files());
        continue;
      }
      const Json json = statistics(with(limited, {"--fly", "--frames", "5"}));
      EXPECT_LE(planned(json), limit);
      EXPECT_LE(json["drawn"]["vertices"], json["stream"]["memory"]["vertices"]);
      EXPECT_LE(json["drawn"]["triangles"], json["stream"]["memory"]["triangles"]);
    }
  }
}

TEST_F(Stream, TooLittleMemoryIsRefusedWithHowMuchItTakes) {
  const Arguments arguments = with(plant, {"--stream", "always"});
  const Json enough = statistics(arguments);
  SKIP_WITHOUT_GL(enough);
  fs::remove(folder_ / "stats.json");
  std::string told;
  for (const char* limit : {"0", "1", "64K", "86000"}) {
    const Outcome outcome =
        run(with(arguments, {"--gpu-memory", limit, "--output", "a.png", "--reference", "b.png", "--stats", "a.json"}));
    EXPECT_EQ(outcome.code, 1);
    expect_refused(outcome, "--gpu-memory");
    const std::size_t at = outcome.err.find("at least ");
    ASSERT_NE(at, std::string::npos) << outcome.err;
    told = std::to_string(std::stoull(outcome.err.substr(at + 9))) + "M";
  }
  const Json json = statistics(with(arguments, {"--gpu-memory", told}));
  EXPECT_GT(json["drawn"]["triangles"], 0);
}

TEST_F(Stream, AutomaticallyWhatDoesNotFitIsStreamed) {
  const Arguments quick = {"--headless", "--size", "8x8", "--objects", "40", "--budget", "1000"};
  const Json free = statistics(quick);
  SKIP_WITHOUT_GL(free);
  EXPECT_EQ(free["stream"]["streams"], false) << "on the host the model is where it is";
  const auto streams = [&](std::uint64_t limit) {
    return statistics(with(quick, {"--gpu-memory", std::to_string(limit)}))["stream"]["streams"] == true;
  };
  std::uint64_t low = 200'000, high = 8'000'000;
  ASSERT_TRUE(streams(low));
  ASSERT_FALSE(streams(high));
  while (high - low > 1000) {
    const std::uint64_t middle = (low + high) / 2;
    (streams(middle) ? low : high) = middle;
  }
  const std::uint64_t model = 12 * number(free["model"]["vertices"]) + 6 * number(free["model"]["triangles"]);
  EXPECT_GT(high, model + 16 * number(free["drawn"]["vertices"]) + 12 * number(free["drawn"]["triangles"]));
  EXPECT_LT(high, 2 * model);
  const Json whole = statistics(with(quick, {"--gpu-memory", std::to_string(high), "--stream", "never"}));
  EXPECT_EQ(whole["stream"]["streams"], false);
  EXPECT_EQ(whole["drawn"], free["drawn"]);
  EXPECT_EQ(statistics(with(quick, {"--gpu-memory", std::to_string(low)}))["drawn"], free["drawn"]);
  EXPECT_EQ(statistics(with(quick, {"--gpu-memory", std::to_string(high), "--stream", "always"}))["stream"]["streams"],
            true);
  const Arguments kept = files();
  expect_refused(run(with(quick, {"--gpu-memory", std::to_string(low), "--stream", "never", "--output", "a.png"})),
                 "--gpu-memory", kept);
}

TEST_F(Stream, AModelFileIsDrawnLikeTheModelInMemory) {
  write_strip("strip.obj");
  ASSERT_TRUE(preprocess(folder_, {"-o", "plant.pgl", "--objects", "40"}));
  ASSERT_TRUE(preprocess(folder_, {"-o", "nodes.pgl", support::fixture("nodes.gltf").string()}));
  ASSERT_TRUE(preprocess(folder_, {"-o", "strip.pgl", "--boundary", "slide", "strip.obj"}));
  const std::string nodes = fs::absolute(support::fixture("nodes.gltf")).string();
  struct Case {
    Arguments memory, file, both;
  };
  const Arguments orbit = with(among, {"--orbit", "--frames", "5", "--budget", "3000"});
  for (const Case& c :
       {Case{{"--objects", "40"}, {"plant.pgl"}, orbit},
        {{"--objects", "40"}, {"plant.pgl"}, with(orbit, {"--occlusion", "temporal", "--compactness", "0"})},
        {{"--objects", "40"}, {"plant.pgl"}, with(orbit, {"--min-triangles", "20", "--policy", "fair"})},
        {{"--objects", "40"}, {"plant.pgl"}, with(orbit, {"--budget", "all", "--pet", "0", "--occlusion", "on"})},
        {{nodes}, {"nodes.pgl"}, {"--fly", "--frames", "4", "--budget", "11"}},
        {{"--boundary", "slide", "strip.obj"}, {"strip.pgl"}, {"--fly", "--frames", "3", "--budget", "40000"}}}) {
    const Arguments common = with(with(offscreen, {"--checksums"}), c.both);
    const Json memory = statistics(with(with(common, c.memory), {"--stream", "never"}));
    SKIP_WITHOUT_GL(memory);
    EXPECT_EQ(memory["file"], Json::parse(R"({"bytes": 0, "bytes_read": 0})"));
    for (const Arguments& how : {Arguments{"--stream", "never", "--no-prefetch"},
                                 {"--stream", "always", "--prefetch"},
                                 {"--stream", "always", "--no-prefetch", "--overlap"},
                                 {"--stream", "auto"}}) {
      SCOPED_TRACE(testing::PrintToString(c.both) + " " + testing::PrintToString(how));
      const Json file = statistics(with(with(common, c.file), how));
      for (const char* key : {"checksums", "drawn", "culled", "occluders", "camera", "objects"}) {
        EXPECT_EQ(file[key], memory[key]) << key;
      }
      for (const char* key : {"vertices", "triangles", "meshes"}) EXPECT_EQ(file["model"][key], memory["model"][key]);
      EXPECT_EQ(file["stream"]["streams"], how[1] == "always");
      EXPECT_EQ(number(file["file"]["bytes"]), fs::file_size(folder_ / c.file[0]));
      EXPECT_GT(number(file["file"]["bytes_read"]), 0u);
      EXPECT_LE(file["file"]["bytes_read"], file["file"]["bytes"]);
      EXPECT_TRUE(file["ms"].contains("open"));
      EXPECT_FALSE(file["ms"].contains("preprocess"));
    }
  }
}

TEST_F(Stream, OfAModelFileOnlyWhatFramesNeedIsRead) {
  ASSERT_TRUE(preprocess(folder_, {"-o", "plant.pgl", "--objects", "40"}));
  const Arguments arguments = with(offscreen, {"--no-prefetch", "plant.pgl", "--up", "z", "--budget", "all"});
  for (const char* stream : {"never", "always"}) {
    const auto read = [&](const Arguments& more) {
      const Json json = statistics(with(with(arguments, {"--stream", stream}), more));
      return json.is_null() ? 0 : number(json["file"]["bytes_read"]);
    };
    const std::uint64_t all = read({"--pet", "0"});
    if (all == 0) GTEST_SKIP() << "this machine has no EGL to draw with";
    const std::uint64_t coarse = read({"--pet", "0", "--budget", "500"});
    const std::uint64_t away = read({"--camera", "0,0,500,0,0,600"});
    EXPECT_LT(coarse, all * 2 / 3);
    EXPECT_LT(away, coarse);
    EXPECT_GT(away, 0u);  // the tables
  }
}

TEST_F(Stream, MeansAreOfAllFramesButTheFirst) {
  ASSERT_TRUE(preprocess(folder_, {"-o", "plant.pgl", "--objects", "400"}));
  const Json json = statistics(with(offscreen, {"plant.pgl", "--no-prefetch", "--stream", "always", "--budget", "40000",
                                                "--fly", "--frames", "7", "--checksums"}));
  SKIP_WITHOUT_GL(json);
  for (const char* step : {"load", "frame"}) {
    const std::vector<double> all = json[std::string(step) + "_ms"].get<std::vector<double>>();
    ASSERT_EQ(all.size(), 7u);
    double sum = 0.0;
    for (std::size_t i = 1; i < all.size(); ++i) sum += all[i];
    EXPECT_NEAR(json["mean_ms"][step].get<double>(), sum / 6.0, 1e-9 * sum) << step;
  }
}

TEST_F(Stream, ADamagedModelFileIsRefusedAndLeavesNothing) {
  ASSERT_TRUE(preprocess(folder_, {"-o", "whole.pgl", "--objects", "40"}));
  const std::string whole = content_of(folder_ / "whole.pgl");
  const Arguments arguments = with(with(offscreen, {"--budget", "all", "--pet", "0", "--up", "z"}),
                                   {"--output", "a.png", "--reference", "b.png"});
  const Json expected = statistics(with(arguments, {"whole.pgl"}));
  SKIP_WITHOUT_GL(expected);
  ASSERT_EQ(expected["drawn"]["objects"], 40);
  for (const char* name : {"a.png", "b.png", "stats.json"}) fs::remove(folder_ / name);

  const Arguments kept = {"bad.pgl", "whole.pgl"};
  const auto outcome_of = [&](const std::string& bytes, const Arguments& more) {
    write(folder_ / "bad.pgl", bytes);
    return run(with(with(arguments, {"--stats", "a.json", "bad.pgl"}), more));
  };
  const std::vector<Arguments> ways = {{"--stream", "never", "--no-prefetch"},
                                       {"--stream", "always", "--frames", "2"},
                                       {"--stream", "always", "--transfer", "100K", "--frames", "20"},
                                       {"--stream", "always", "--occlusion", "on", "--compactness", "0"}};
  // A bit in every part of the file; each way sees all of it in the end.
  std::size_t way = 0, refused = 0, places = 0;
  for (std::size_t at = 5; at < whole.size() - 4096; at += whole.size() / 20, ++places) {
    SCOPED_TRACE("byte " + std::to_string(at) + " " + testing::PrintToString(ways[way]));
    std::string bytes = whole;
    bytes[at] = static_cast<char>(bytes[at] ^ 16);
    const Outcome outcome = outcome_of(bytes, ways[way]);
    way = (way + 1) % ways.size();
    if (outcome.code == 0) {  // then it is of no use to the frames
      EXPECT_EQ(outcome.err, "");
      const Json json = Json::parse(content_of(folder_ / "a.json"), nullptr, false);
      EXPECT_EQ(json["drawn"]["checksum"], expected["drawn"]["checksum"]);
      for (const char* name : {"a.png", "b.png", "a.json"}) fs::remove(folder_ / name);
      continue;
    }
    ++refused;
    EXPECT_EQ(outcome.code, 1);
    expect_refused(outcome, "bad.pgl", kept);
  }
  EXPECT_GE(refused + 2, places);  // but what is between the sections
  for (const std::size_t length : {std::size_t{0}, std::size_t{7}, std::size_t{100}, std::size_t{4095},
                                   std::size_t{4096}, whole.size() / 2, whole.size() - 1}) {
    SCOPED_TRACE(length);
    expect_refused(outcome_of(whole.substr(0, length), ways[length % 2]), "bad.pgl", kept);
  }
  expect_refused(outcome_of(whole + 'x', {}), "bad.pgl", kept);
  for (const std::string foreign : {"solid cube\nendsolid\n", "\x89PNG\r\n\x1a\n....", "v 0 0 0\nv 1 0 0\n", "\n"}) {
    expect_refused(outcome_of(foreign, {}), "bad.pgl", kept);
  }
  fs::remove(folder_ / "bad.pgl");
  expect_refused(run(with(arguments, {"bad.pgl"})), "bad.pgl", {"whole.pgl"});
  fs::create_directory(folder_ / "bad.pgl");
  expect_refused(run(with(arguments, {"bad.pgl"})), "bad.pgl", kept);
}

TEST_F(Stream, DamageThatNoFrameNeedsIsNotInTheWay) {
  ASSERT_TRUE(preprocess(folder_, {"-o", "plant.pgl", "--objects", "40"}));
  std::string bytes = content_of(folder_ / "plant.pgl");
  ASSERT_GT(bytes.size(), 20'000u);
  bytes[bytes.size() - 10'000] = static_cast<char>(bytes[bytes.size() - 10'000] ^ 1);  // one of the last vertices
  write(folder_ / "plant.pgl", bytes);
  const Arguments arguments = with(offscreen, {"--up", "z", "--budget", "all", "--pet", "0", "plant.pgl"});
  for (const Arguments& how : {Arguments{"--stream", "never", "--prefetch"},
                               {"--stream", "never", "--no-prefetch"},
                               {"--stream", "always", "--prefetch"},
                               {"--stream", "always", "--no-prefetch"},
                               {"--stream", "always", "--transfer", "100K", "--no-prefetch"}}) {
    SCOPED_TRACE(testing::PrintToString(how));
    const Arguments frames = with(with(arguments, how), {"--frames", "10"});
    const Json away = statistics(with(frames, {"--camera", "0,0,500,0,0,600"}));
    SKIP_WITHOUT_GL(away);
    EXPECT_EQ(away["drawn"]["objects"], 0);
    fs::remove(folder_ / "stats.json");
    const Outcome outcome = run(frames);
    expect_refused(outcome, "plant.pgl", {"plant.pgl"});
    EXPECT_NE(outcome.err.find("'vertices'"), std::string::npos) << outcome.err;
  }
}

TEST_F(Stream, PreparingAheadDrawsTheSame) {
  for (const Arguments& more : {Arguments{}, {"--transfer", "10K"}, {"--occlusion", "temporal"}}) {
    const Arguments arguments =
        with(with(plant, more), {"--fly", "--frames", "8", "--budget", "3000", "--stream", "always", "--checksums"});
    const Json plain = statistics(arguments);
    SKIP_WITHOUT_GL(plain);
    const Json ahead = statistics(with(arguments, {"--overlap"}));
    for (const char* key : {"checksums", "drawn", "culled", "stream"}) EXPECT_EQ(ahead[key], plain[key]) << key;
    EXPECT_TRUE(plain["ms"].contains("send"));
    EXPECT_FALSE(ahead["ms"].contains("send"));
    EXPECT_TRUE(ahead["ms"].contains("frame"));
  }
}

TEST_F(Stream, ImpossibleOptionsAreRefusedInOneLine) {
  const std::vector<Arguments> refused = {{"--stream", "maybe"},
                                          {"--stream", ""},
                                          {"--stream"},
                                          {"--gpu-memory", ""},
                                          {"--gpu-memory", "K"},
                                          {"--gpu-memory", "-1"},
                                          {"--gpu-memory", "1.5G"},
                                          {"--gpu-memory", "1T"},
                                          {"--gpu-memory", "1KK"},
                                          {"--gpu-memory", "1k"},
                                          {"--gpu-memory", "6 G"},
                                          {"--gpu-memory", "1125899906842625"},
                                          {"--gpu-memory", "1048577G"},
                                          {"--gpu-memory", "99999999999999999999"},
                                          {"--gpu-memory"},
                                          {"--transfer", "many"},
                                          {"--transfer", "G"},
                                          {"--transfer", "1e6"},
                                          {"--transfer", "-5"},
                                          {"--transfer", "1099511627777K"},
                                          {"--transfer"},
                                          {"--up", "w"},
                                          {"--up", "-z"},
                                          {"--up", ""},
                                          {"--up"},
                                          {"--transfer", "5M", "--stream", "never"},
                                          {"--overlap", "--stream", "never"},
                                          {"--orbit", "--fly"},
                                          {"--camera", "0,0,1,0,0,0", "--fly"},
                                          {"--prefetch"}};
  for (const Arguments& options : refused) {
    SCOPED_TRACE(testing::PrintToString(options));
    const Outcome outcome =
        run(with({"--headless", "--output", "a.png", "--stats", "a.json", "--objects", "5"}, options));
    EXPECT_EQ(outcome.code, 2);
    expect_refused(outcome, options[0]);
  }
  expect_refused(run({"--headless", "--objects", "5", "--no-prefetch"}), "prefetch");
}

TEST_F(Stream, AModelFileComesAloneAndWithoutOptionsOfItsMaking) {
  write_tetrahedron("one.obj");
  ASSERT_TRUE(preprocess(folder_, {"-o", "a.pgl", "one.obj"}));
  ASSERT_TRUE(preprocess(folder_, {"-o", "b.pgl", "one.obj"}));
  const Arguments kept = files();
  for (const Arguments& beside : {Arguments{"a.pgl", "one.obj"}, {"one.obj", "a.pgl"}, {"a.pgl", "b.pgl"}}) {
    const Outcome outcome = run(with(offscreen, beside));
    EXPECT_EQ(outcome.code, 2);
    expect_refused(outcome, "a.pgl", kept);
  }
  for (const Arguments& options : {Arguments{"--split"},
                                   {"--flatten"},
                                   {"--weld"},
                                   {"--no-weld"},
                                   {"--refuse-non-finite"},
                                   {"--metric", "melax"},
                                   {"--boundary", "slide"},
                                   {"--objects", "5"},
                                   {"--seed", "1"}}) {
    SCOPED_TRACE(options[0]);
    const Outcome outcome = run(with(with(offscreen, options), {"--output", "a.png", "a.pgl"}));
    EXPECT_EQ(outcome.code, 2);
    expect_refused(outcome, options[0] == "--no-weld" ? "weld" : options[0], kept);
  }
}

TEST_F(Stream, AModelFileOfNothingIsRefused) {
  pgl::scene::ModelFileWriter(folder_ / "nothing.pgl").finish();
  for (const Arguments& more : {Arguments{}, {"--fly", "--stream", "always"}}) {
    const Outcome outcome = run(with(with(offscreen, more), {"--output", "a.png", "nothing.pgl"}));
    if (outcome.code == 3) GTEST_SKIP() << outcome.err;
    EXPECT_EQ(outcome.code, 1);
    expect_refused(outcome, "nothing.pgl: has nothing to draw", {"nothing.pgl"});
  }
}

TEST_F(Stream, HelpAndTheTableTellOfIt) {
  const Outcome help = run({"--help"});
  EXPECT_EQ(help.code, 0);
  for (const char* option : {"--stream", "auto|always|never", "--gpu-memory", "--transfer", "--overlap", "--prefetch",
                             "--no-prefetch", "--up", "--fly", ".pgl"}) {
    EXPECT_NE(help.out.find(option), std::string::npos) << option;
  }
  ASSERT_TRUE(preprocess(folder_, {"-o", "plant.pgl", "--objects", "40"}));
  const Outcome streamed = run(with(offscreen, {"--stream", "always", "--transfer", "50K", "plant.pgl"}));
  if (streamed.code == 3) GTEST_SKIP() << streamed.err;
  const Outcome whole = run(with(plant, {"--stream", "never"}));
  for (const char* row : {"\nmost of a frame, KiB ", "\nstill missing, KiB ", "\nmemory planned, MiB ",
                          "\nmodel file, MiB ", "\nread of it, MiB ", "\nms send ", "\nms defragment ", "\nms open "}) {
    EXPECT_NE(streamed.out.find(row), std::string::npos) << row;
    EXPECT_EQ(whole.out.find(row), std::string::npos) << row;
  }
}

/// Streamed frames, prepared by both backends.
class StreamBackends : public Backends {
 protected:
  /// expect_same, of frames that were streamed and sent something.
  Json expect_same_stream(const Arguments& arguments) {
    const Json json = expect_same(with(arguments, {"--stream", "always"}));
    if (json.is_null()) return json;
    EXPECT_EQ(json["stream"]["streams"], true);
    EXPECT_EQ(json["stream"]["sent"].size(), json["frames"].get<std::size_t>());
    EXPECT_GT(sent_bytes(json)[0], 0u);
    return json;
  }
};

TEST_F(StreamBackends, SendAndDrawTheSameBytesFrameAfterFrame) {
  SKIP_WITHOUT_GPU();
  for (const Arguments& path : {Arguments{"--fly"}, with(among, {"--orbit"})}) {
    const Arguments arguments = with(with(plant, path), {"--budget", "3000", "--frames", "16"});
    expect_same_stream(arguments);
    for (const char* cap : {"1000", "20K", "1G"}) {
      expect_same_stream(with(arguments, {"--transfer", cap}));
      expect_same_stream(with(arguments, {"--transfer", cap, "--overlap"}));
    }
    expect_same_stream(with(arguments, {"--overlap"}));
  }
  const Arguments larger = with(offscreen, {"--objects", "2000", "--fly", "--frames", "20"});
  expect_same_stream(with(larger, {"--budget", "200000"}));
  expect_same_stream(with(larger, {"--budget", "200000", "--transfer", "300K"}));
  expect_same_stream(with(larger, {"--budget", "200000", "--transfer", "300K", "--overlap"}));
  expect_same_stream(with(larger, {"--budget", "all", "--pet", "0", "--overlap", "--frames", "6"}));
}

TEST_F(StreamBackends, StreamedFramesAreThoseOfTheWholeModel) {
  SKIP_WITHOUT_GPU();
  for (const char* policy : {"exact", "fair", "paper"}) {
    const Arguments arguments = with(offscreen, {"--objects", "300", "--budget", "20000", "--policy", policy, "--fly",
                                                 "--frames", "12", "--min-triangles", "4"});
    const Json streamed = expect_same_stream(arguments);
    EXPECT_EQ(streamed["checksums"], expect_same(with(arguments, {"--stream", "never"}))["checksums"]);
    EXPECT_EQ(streamed["checksums"], expect_same_stream(with(arguments, {"--overlap"}))["checksums"]);
  }
}

TEST_F(StreamBackends, SmallBudgetsAndManyTrianglesAVertexAreTheSame) {
  SKIP_WITHOUT_GPU();
  write_dense(folder_ / "dense.obj");
  for (const char* budget : {"20", "50", "all"}) {
    expect_same_stream(with(
        offscreen, {"--budget", budget, "--pet", "0", "--fly", "--frames", "12", "--boundary", "slide", "dense.obj"}));
  }
  for (const char* budget : {"1", "100", "1100"}) {
    expect_same_stream(with(plant, {"--budget", budget, "--policy", "paper", "--pet", "0"}));
  }
  const Arguments nothing = with(plant, {"--budget", "0", "--stream", "always", "--frames", "2", "--backend", "cuda"});
  const Outcome outcome = run(with(nothing, {"--stats", "stats.json"}));
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(sent_bytes(Json::parse(content_of(folder_ / "stats.json"))), std::vector<std::uint64_t>(2, 0));
}

TEST_F(StreamBackends, CullTheSame) {
  SKIP_WITHOUT_GPU();
  for (const std::string mode : {"on", "temporal"}) {
    for (const Arguments& more : {Arguments{}, {"--transfer", "100K"}, {"--transfer", "100K", "--overlap"}}) {
      const Json json = expect_same_stream(
          with(with(offscreen, more), {"--objects", "300", "--budget", "20000", "--occlusion", mode, "--camera",
                                       "-8,-5,2,6,4,2,60", "--orbit", "--frames", "10"}));
      EXPECT_GT(json["culled"]["occlusion"], 0);
    }
  }
}

TEST_F(StreamBackends, SharedAndMirroredMeshesAndWideIndicesAreTheSame) {
  SKIP_WITHOUT_GPU();
  write_strip("strip.obj");
  const std::string nodes = fs::absolute(support::fixture("nodes.gltf")).string();
  for (const Arguments& more : {Arguments{}, {"--transfer", "100000"}, {"--transfer", "100000", "--overlap"}}) {
    expect_same_stream(with(with(offscreen, more), {"--budget", "11", "--orbit", "--frames", "5", nodes}));
    expect_same_stream(with(with(offscreen, more),
                            {"--budget", "40000", "--boundary", "slide", "--fly", "--frames", "8", "strip.obj"}));
  }
}

TEST_F(StreamBackends, AModelFileIsTheSame) {
  SKIP_WITHOUT_GPU();
  ASSERT_TRUE(preprocess(folder_, {"-o", "plant.pgl", "--objects", "300"}));
  const Arguments arguments = with(offscreen, {"--up", "z", "--budget", "20000", "--fly", "--frames", "12"});
  const Json whole = expect_same(with(arguments, {"--stream", "never", "plant.pgl"}));
  for (const char* ahead : {"--prefetch", "--no-prefetch"}) {
    EXPECT_EQ(expect_same_stream(with(arguments, {ahead, "plant.pgl"}))["checksums"], whole["checksums"]);
    EXPECT_EQ(expect_same_stream(with(arguments, {ahead, "--overlap", "plant.pgl"}))["checksums"], whole["checksums"]);
    expect_same_stream(with(arguments, {ahead, "--transfer", "50K", "--overlap", "plant.pgl"}));
    expect_same_stream(with(arguments, {ahead, "--occlusion", "temporal", "--min-triangles", "4", "plant.pgl"}));
  }
}

TEST_F(StreamBackends, TheMemoryPlannedIsWithinTheLimit) {
  SKIP_WITHOUT_GPU();
  const Arguments arguments = with(offscreen, {"--objects", "2000", "--budget", "all", "--pet", "0", "--checksums",
                                               "--backend", "cuda", "--stats", "stats.json", "--frames", "4", "--fly"});
  const auto told = [&](const Arguments& more) {
    const Outcome outcome = run(with(arguments, more));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return Json::parse(content_of(folder_ / "stats.json"), nullptr, false);
  };
  const Json whole = told({});
  EXPECT_EQ(whole["stream"]["streams"], false);
  const Json free = told({"--stream", "always"});
  EXPECT_EQ(free["checksums"], whole["checksums"]);
  EXPECT_EQ(told({"--stream", "always", "--gpu-memory", "4G"})["checksums"], whole["checksums"]);
  // Half of what it would take beside what is resident.
  const std::uint64_t resident = number(free["stream"]["memory"]["resident"]);
  const std::uint64_t limit = resident + (planned(free) - resident) / 2;
  const Json limited = told({"--stream", "always", "--gpu-memory", std::to_string(limit)});
  EXPECT_EQ(limited["stream"]["streams"], true);
  EXPECT_LE(planned(limited), limit);
  EXPECT_LE(limited["drawn"]["vertices"], limited["stream"]["memory"]["vertices"]);
  EXPECT_LE(limited["drawn"]["triangles"], limited["stream"]["memory"]["triangles"]);
  EXPECT_NE(limited["checksums"], whole["checksums"]);
  fs::remove(folder_ / "stats.json");
  const Outcome refused = run(with(arguments, {"--stream", "always", "--gpu-memory", "64K"}));
  EXPECT_EQ(refused.code, 1);
  EXPECT_NE(refused.err.find("pgl_viewer: --gpu-memory"), std::string::npos) << refused.err;
  EXPECT_EQ(files(), Arguments());
}

}  // namespace
