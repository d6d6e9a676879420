// SPDX-License-Identifier: MIT
// Runs pgl_preprocess and looks at what it leaves: a whole file, or nothing and one line.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <sstream>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "scene/build_model.hpp"
#include "scene/build_plant.hpp"
#include "scene/import.hpp"
#include "scene/model_file.hpp"
#include "support/test_data.hpp"

namespace {

namespace fs = std::filesystem;
using namespace pgl::scene;
using support::fixture;
using support::read_bytes;

struct Outcome {
  int code = -1;  ///< 1000 and the signal's number where one ended it
  std::string out, err;
};

/// Without the lines that only tell how far the work is.
std::string without_progress(const std::string& text) {
  std::istringstream lines(text);
  std::string kept;
  for (std::string line; std::getline(lines, line);) {
    if (!line.ends_with(" %") || line.starts_with("pgl_preprocess")) kept += line + "\n";
  }
  return kept;
}

/// A run of the program in a folder, which goes on until `wait`.
class Process {
 public:
  Process(const fs::path& folder, std::vector<std::string> arguments, rlim_t most_bytes = RLIM_INFINITY)
      : out_(support_.path() / "out"), err_(support_.path() / "err") {
    arguments.insert(arguments.begin(), PGL_PREPROCESS);
    std::vector<char*> pointers;
    for (std::string& argument : arguments) pointers.push_back(argument.data());
    pointers.push_back(nullptr);
    pid_ = fork();
    if (pid_ != 0) return;
    const int in = open("/dev/null", O_RDONLY);
    const int out = open(out_.c_str(), O_WRONLY | O_CREAT, 0600), err = open(err_.c_str(), O_WRONLY | O_CREAT, 0600);
    dup2(in, 0);
    dup2(out, 1);
    dup2(err, 2);
    const rlimit limit{most_bytes, most_bytes};
    if (chdir(folder.c_str()) == 0 && setrlimit(RLIMIT_FSIZE, &limit) == 0) execv(PGL_PREPROCESS, pointers.data());
    _exit(126);
  }

  /// Waits until the program catches SIGTERM, so that it may be sent.
  void wait_until_it_listens() const {
    for (int tries = 0; tries < 2000; ++tries) {
      std::ifstream status("/proc/" + std::to_string(pid_) + "/status");
      for (std::string line; std::getline(status, line);) {
        if (!line.starts_with("SigCgt:")) continue;
        if (std::stoull(line.substr(7), nullptr, 16) >> (SIGTERM - 1) & 1) return;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    ADD_FAILURE() << "the program never listened to signals";
  }
  /// Waits until the program has a process that reads a file, and sends that one signals.
  void send_to_its_reader(const std::vector<int>& signals) const {
    const std::string id = std::to_string(pid_);
    for (int tries = 0; tries < 2000; ++tries) {
      std::ifstream children("/proc/" + id + "/task/" + id + "/children");
      if (pid_t reader = 0; children >> reader) {
        std::this_thread::sleep_for(std::chrono::milliseconds(100));  // into the work
        for (const int signal : signals) EXPECT_EQ(kill(reader, signal), 0);
        return;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ADD_FAILURE() << "the program never read a file";
  }
  void send(int signal) const { kill(pid_, signal); }

  Outcome wait() {
    const auto start = std::chrono::steady_clock::now();
    int status = 0;
    while (waitpid(pid_, &status, WNOHANG) == 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      // never leave one behind that does not end
      if (std::chrono::steady_clock::now() - start > std::chrono::minutes(5)) kill(pid_, SIGKILL);
    }
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status), read_bytes(out_),
            without_progress(read_bytes(err_))};
  }

 private:
  support::TemporaryFolder support_;
  fs::path out_, err_;
  pid_t pid_ = -1;
};

template <class T>
::testing::AssertionResult same(std::span<const T> a, std::span<const T> b) {
  if (a.size() != b.size()) return ::testing::AssertionFailure() << a.size() << " and " << b.size() << " elements";
  for (std::size_t i = 0; i < a.size(); ++i)
    if (std::memcmp(&a[i], &b[i], sizeof(T)) != 0)
      return ::testing::AssertionFailure() << "element " << i << " differs";
  return ::testing::AssertionSuccess();
}

class Preprocess : public testing::Test {
 protected:
  Outcome run(const std::vector<std::string>& arguments, rlim_t most_bytes = RLIM_INFINITY) {
    return Process(folder_.path(), arguments, most_bytes).wait();
  }

  void make(const std::vector<std::string>& arguments) {
    const Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
  }

  std::string bytes(const std::string& name) { return read_bytes(folder_.path() / name); }

  std::vector<std::string> files() {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_.path())) names.push_back(entry.path().filename().string());
    std::ranges::sort(names);
    return names;
  }

  void expect_refused(const Outcome& outcome, int code, const std::string& part, const std::vector<std::string>& kept) {
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
    EXPECT_EQ(outcome.err.rfind("pgl_preprocess: ", 0), 0u) << outcome.err;
    EXPECT_NE(outcome.err.find(part), std::string::npos) << "'" << part << "' is not in: " << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(files(), kept) << part;
  }

  /// The file holds the model, array by array.
  void expect_model(const std::string& name, const AnyModel& expected) {
    ModelFile file(folder_.path() / name);
    file.verify();
    std::visit(
        [&]<class Index>(const Model<Index>& model) {
          ASSERT_EQ(file.wide(), sizeof(Index) == 4);
          const ModelView<Index> view = file.view<Index>(), want(model);
          EXPECT_TRUE(same(view.meshes, want.meshes));
          EXPECT_TRUE(same(view.objects, want.objects));
          EXPECT_TRUE(same(view.vertices, want.vertices));
          EXPECT_TRUE(same(view.triangles, want.triangles));
          EXPECT_TRUE(same(view.ecol, want.ecol));
          EXPECT_TRUE(same(view.map, want.map));
          EXPECT_TRUE(same(view.errors, want.errors));
          EXPECT_TRUE(same(view.mesh_boxes, want.mesh_boxes));
          EXPECT_TRUE(same(view.object_boxes, want.object_boxes));
          EXPECT_TRUE(same(view.oriented_boxes, want.oriented_boxes));
          EXPECT_TRUE(same(view.compactness, want.compactness));
          EXPECT_TRUE(same(view.faces, want.faces));
          EXPECT_TRUE(same(view.compactness_order, want.compactness_order));
        },
        expected);
  }

  support::TemporaryFolder folder_;
};

// ---- what is made ---------------------------------------------------------------------------------------------------

TEST_F(Preprocess, ThePlantIsTheOneThatTheViewerBuilds) {
  const PlantOptions plant{.objects = 1500, .seed = 7};
  make({"-o", "plant.pgl", "--objects", "1500", "--seed", "7", "--batch", "100000"});
  expect_model("plant.pgl", build_plant(plant, 0, plant.objects, true, {}));
  make({"-o", "loose.pgl", "--objects", "40", "--no-weld", "--metric", "melax", "--boundary", "slide"});
  pgl::EcolOptions ecol;
  ecol.metric = pgl::CostMetric::melax;
  ecol.boundary = pgl::BoundaryRule::slide;
  expect_model("loose.pgl", build_plant({.objects = 40}, 0, 40, false, ecol));
  make({"-o", "loose.pgl", "--objects", "40", "--no-weld", "--metric", "melax", "--boundary", "slide", "--errors"});
  expect_model("loose.pgl", build_plant({.objects = 40}, 0, 40, false, ecol, {}, nullptr, true));
  EXPECT_EQ(files(), (std::vector<std::string>{"loose.pgl", "plant.pgl"}));
}

TEST_F(Preprocess, FilesFollowEachOtherInOrder) {
  const std::vector<std::string> names{"objects.obj", "tetra.ply", "nodes.gltf", "two_solids.stl"};
  for (const bool split : {false, true}) {
    Scene all;
    std::vector<std::string> arguments{"-o", "all.pgl"};
    if (split) arguments.push_back("--errors");
    if (split) arguments.push_back("--split");
    ImportOptions options;
    options.split = split;
    for (const std::string& name : names) {
      Scene part = import_scene(fixture(name), options);
      for (pgl::Object& object : part.objects) object.mesh += static_cast<std::uint32_t>(all.meshes.size());
      std::ranges::move(part.meshes, std::back_inserter(all.meshes));
      std::ranges::move(part.objects, std::back_inserter(all.objects));
      arguments.push_back(fixture(name).string());
    }
    make(arguments);
    expect_model("all.pgl", build_any_model(std::move(all), {}, {}, nullptr, split));
  }
}

/// The file depends neither on threads, nor on batches, nor on how the models were named.
TEST_F(Preprocess, TheSameModelsGiveTheSameBytes) {
  make({"-o", "one.pgl", "--objects", "300", "--threads", "1", "--errors"});
  make({"-o", "four.pgl", "--objects", "300", "--threads", "4", "--batch", "5000", "--errors"});
  EXPECT_EQ(bytes("one.pgl"), bytes("four.pgl"));

  fs::create_directories(folder_.path() / "models" / "deeper");
  fs::copy_file(fixture("tetra.ply"), folder_.path() / "models" / "deeper" / "a.ply");
  fs::copy_file(fixture("objects.obj"), folder_.path() / "models" / "b.obj");
  fs::copy_file(fixture("tetra.stl"), folder_.path() / "models" / "c.STL");
  folder_.write("models/readme.txt", "no model");
  folder_.write("list", "models/b.obj\n\nmodels/c.STL\n");
  make({"-o", "named.pgl", "models/b.obj", "models/c.STL", "models/deeper/a.ply"});
  make({"-o", "folder.pgl", "models"});
  make({"-o", "list.pgl", "@list", "models/deeper"});
  EXPECT_EQ(bytes("folder.pgl"), bytes("named.pgl"));
  EXPECT_EQ(bytes("list.pgl"), bytes("named.pgl"));
  make({"-o", "other.pgl", "models/deeper", "@list"});
  EXPECT_NE(bytes("other.pgl"), bytes("named.pgl"));

  make({"-o", "heap.pgl", "models", "--warehouse"});
  for (const char* batch : {"1", "5", "20"}) {
    make({"-o", "parts.pgl", "models", "--warehouse", "--batch", batch});
    EXPECT_EQ(bytes("parts.pgl"), bytes("heap.pgl")) << batch;
  }
}

TEST_F(Preprocess, AWarehouseMovesTheObjectsOfAFileTogetherAndApartFromOthers) {
  const std::vector<std::string> parts{fixture("objects.obj").string(), fixture("tetra.ply").string(),
                                       fixture("groups.obj").string(), fixture("objects.obj").string()};
  std::vector<std::string> arguments{"-o", "heap.pgl"};
  arguments.insert(arguments.end(), parts.begin(), parts.end());
  make(arguments);
  arguments[1] = "shelves.pgl";
  arguments.push_back("--warehouse");
  make(arguments);

  ModelFile heap_file(folder_.path() / "heap.pgl"), shelves_file(folder_.path() / "shelves.pgl");
  shelves_file.verify();
  const auto heap = heap_file.view<std::uint16_t>(), shelves = shelves_file.view<std::uint16_t>();
  ASSERT_EQ(heap.objects.size(), shelves.objects.size());
  EXPECT_TRUE(same(heap.mesh_boxes, shelves.mesh_boxes));
  std::size_t object = 0;
  std::vector<pgl::Box> boxes;
  for (const std::string& part : parts) {
    pgl::Box box;
    const glm::vec3 move = shelves.objects[object].transform[3] - heap.objects[object].transform[3];
    for (std::size_t end = object + import_scene(part).objects.size(); object < end; ++object) {
      const auto& before = heap.objects[object].transform;
      const auto& after = shelves.objects[object].transform;
      EXPECT_LT(glm::distance(after[3] - before[3], move), 1e-4f);
      for (int column = 0; column < 3; ++column) EXPECT_EQ(after[column], before[column]);
      box.min = glm::min(box.min, shelves.object_boxes[object].min);
      box.max = glm::max(box.max, shelves.object_boxes[object].max);
    }
    EXPECT_GT(box.min.z, -1e-4f);
    for (const pgl::Box& other : boxes) {
      const glm::vec3 gap = glm::max(box.min - other.max, other.min - box.max);
      EXPECT_GT(std::max({gap.x, gap.y, gap.z}), 0.01f) << part;
    }
    boxes.push_back(box);
  }
  EXPECT_EQ(object, heap.objects.size());
}

TEST_F(Preprocess, WarningsAreOneLineAndTheRestIsThere) {
  const Outcome outcome = run({"-o", "rest.pgl", fixture("non_finite.obj").string()});
  EXPECT_EQ(outcome.code, 0);
  EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
  EXPECT_NE(outcome.err.find("non_finite.obj"), std::string::npos) << outcome.err;
  expect_model("rest.pgl", build_any_model(import_scene(fixture("non_finite.obj")), {}));
  fs::copy_file(fixture("non_finite.obj"), folder_.path() / "two\nlines.obj");
  const Outcome two = run({"-o", "rest.pgl", "two\nlines.obj"});
  EXPECT_EQ(std::ranges::count(two.err, '\n'), 1) << two.err;
  fs::remove(folder_.path() / "two\nlines.obj");
  fs::remove(folder_.path() / "rest.pgl");
  expect_refused(run({"-o", "rest.pgl", fixture("non_finite.obj").string(), "--refuse-non-finite"}), 1, "non-finite",
                 {});
}

// ---- what is told ---------------------------------------------------------------------------------------------------

TEST_F(Preprocess, SaysWhatIsInAFileAndWhetherItIsWhole) {
  const Outcome made = run({"-o", "plant.pgl", "--objects", "50"});
  EXPECT_NE(made.out.find("peak memory"), std::string::npos);
  const Outcome info = run({"--info", "plant.pgl"});
  EXPECT_EQ(info.code, 0) << info.err;
  const ModelFile file(folder_.path() / "plant.pgl");
  for (const char* name : {"objects", "meshes", "vertices", "triangles", "index", "bytes"}) {
    const std::size_t at = info.out.find(std::string(name) + ' ');
    ASSERT_NE(at, std::string::npos) << name;
    const std::string line = info.out.substr(at, info.out.find('\n', at) - at);
    EXPECT_NE(made.out.find(line + '\n'), std::string::npos) << "not told when it was made: " << line;
    std::string digits;
    std::ranges::copy_if(line, std::back_inserter(digits), [](char c) { return c >= '0' && c <= '9'; });
    const std::string what = name;
    const std::uint64_t value = what == "objects"     ? file.objects()
                                : what == "meshes"    ? file.meshes()
                                : what == "vertices"  ? file.vertices()
                                : what == "triangles" ? file.triangles()
                                : what == "index"     ? (file.wide() ? 32u : 16u)
                                                      : file.bytes();
    EXPECT_EQ(digits, std::to_string(value)) << line;
  }
  const std::string errors = "\nerrors" + std::string(25, ' ');
  EXPECT_NE(info.out.find(errors + "none\n"), std::string::npos) << info.out;
  const std::string recorded = errors.substr(0, errors.size() - 4) + "recorded\n";
  EXPECT_NE(run({"-o", "errors.pgl", "--objects", "3", "--errors"}).out.find(recorded), std::string::npos);
  EXPECT_NE(run({"--info", "errors.pgl"}).out.find(recorded), std::string::npos);
  const Outcome verified = run({"--verify", "plant.pgl"});
  EXPECT_EQ(verified.code, 0) << verified.err;
  EXPECT_NE(verified.out.find("plant.pgl"), std::string::npos);
  for (const char* asked : {"--help", "--version"}) {
    const Outcome told = run({asked});
    EXPECT_EQ(told.code, 0);
    EXPECT_NE(told.out.find("pgl_preprocess"), std::string::npos);
    EXPECT_EQ(told.err, "");
  }
}

TEST_F(Preprocess, TheFileSaysWhichAxisPointsUp) {
  const std::string model = fixture("objects.obj").string();
  const auto expect_up = [&](const std::vector<std::string>& arguments, UpAxis up, const std::string& name) {
    std::vector<std::string> all{"-o", "up.pgl"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const Outcome made = run(all);
    EXPECT_EQ(made.code, 0) << made.err;
    EXPECT_EQ(ModelFile(folder_.path() / "up.pgl").up(), up) << testing::PrintToString(arguments);
    const std::string told = "up" + std::string(33 - name.size(), ' ') + name + "\n";
    EXPECT_NE(made.out.find("\n" + told), std::string::npos) << made.out;
    EXPECT_NE(run({"--info", "up.pgl"}).out.find("\n" + told), std::string::npos) << told;
  };
  expect_up({"--objects", "3"}, UpAxis::z, "z");
  expect_up({"--objects", "3", "--up", "y"}, UpAxis::y, "y");
  expect_up({model}, UpAxis::y, "y");
  expect_up({model, "--up", "z"}, UpAxis::z, "z");
  expect_up({model, "--up", "z", "--up", "x"}, UpAxis::x, "x");
  expect_up({model, "--warehouse"}, UpAxis::z, "z");
  expect_up({model, "--warehouse", "--up", "x"}, UpAxis::x, "x");

  ModelFileWriter writer(folder_.path() / "untold.pgl");  // as a program may that does not know
  writer.finish();
  EXPECT_NE(run({"--info", "untold.pgl"}).out.find(" not told\n"), std::string::npos);
}

TEST_F(Preprocess, DamageIsFoundByVerify) {
  make({"-o", "plant.pgl", "--objects", "50", "--errors"});
  const std::string whole = bytes("plant.pgl");
  std::vector<std::size_t> places{0, 9, whole.size() - 1};
  for (std::size_t k = 1; k < 24; ++k) places.push_back(whole.size() * k / 24);
  for (const std::size_t at : places) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 4);
    folder_.write("damaged.pgl", damaged);
    expect_refused(run({"--verify", "damaged.pgl"}), 1, "damaged.pgl: ", {"damaged.pgl", "plant.pgl"});
  }
  for (const std::size_t length :
       {std::size_t{0}, std::size_t{100}, std::size_t{4096}, whole.size() / 2, whole.size() - 1}) {
    folder_.write("damaged.pgl", whole.substr(0, length));
    for (const char* how : {"--verify", "--info"})
      expect_refused(run({how, "damaged.pgl"}), 1, "damaged.pgl: ", {"damaged.pgl", "plant.pgl"});
  }
  expect_refused(run({"--verify", "missing.pgl"}), 1, "missing.pgl: ", {"damaged.pgl", "plant.pgl"});
}

TEST_F(Preprocess, ImpossibleOptionsAreToldInOneLine) {
  const std::string model = fixture("objects.obj").string();
  const auto refused = [&](const std::vector<std::string>& arguments, const std::string& part) {
    expect_refused(run(arguments), 2, part, {});
  };
  refused({}, "--output");
  refused({model}, "--output");
  refused({"-o"}, "--output");
  refused({model, "-o", "model.obj"}, ".pgl");
  refused({"-o", "a.pgl", "--objects", "0"}, "--objects");
  refused({"-o", "a.pgl", "--objects", "10x"}, "--objects");
  refused({"-o", "a.pgl", "--objects", "100000001"}, "--objects");
  refused({"-o", "a.pgl", "--seed", "-1"}, "--seed");
  refused({"-o", "a.pgl", "--metric", "none"}, "--metric");
  refused({"-o", "a.pgl", "--boundary", "none"}, "--boundary");
  refused({"-o", "a.pgl", "--threads", "0"}, "--threads");
  refused({"-o", "a.pgl", "--batch", "0"}, "--batch");
  for (const char* up : {"w", "", "-z", "Z"}) refused({"-o", "a.pgl", "--up", up}, "--up");
  refused({"-o", "a.pgl", "--unknown"}, "--unknown");
  for (const char* option : {"--split", "--flatten", "--warehouse", "--refuse-non-finite"})
    refused({"-o", "a.pgl", option}, option);
  for (const char* option : {"--objects", "--seed"}) refused({"-o", "a.pgl", model, option, "5"}, option);
  refused({"--verify", "a.pgl", "--info", "a.pgl"}, "--info");
  refused({"--verify", "a.pgl", model}, "--verify");
  refused({"--info", "a.pgl", "-o", "b.pgl"}, "--output");
  refused({"--info", "a.pgl", "--warehouse"}, "--warehouse");
  refused({"--verify", "a.pgl", "--seed", "2"}, "--seed");
  refused({"--info", "a.pgl", "--errors"}, "--errors");
  refused({"--info", "a.pgl", "--up", "z"}, "--up");
}

TEST_F(Preprocess, WhatCannotBeReadOrWrittenIsToldInOneLineAndNothingIsLeft) {
  const std::string model = fixture("objects.obj").string();
  folder_.write("empty", "\n");
  folder_.write("list", "missing.obj\n");
  fs::create_directories(folder_.path() / "nothing");
  fs::create_directories(folder_.path() / "folder.pgl");
  const std::vector<std::string> kept{"empty", "folder.pgl", "list", "nothing"};
  const auto refused = [&](const std::vector<std::string>& arguments, const std::string& part) {
    expect_refused(run(arguments), 1, part, kept);
  };
  refused({"-o", "a.pgl", "missing.obj"}, "missing.obj: ");
  refused({"-o", "a.pgl", model, "@list"}, "missing.obj: ");
  refused({"-o", "a.pgl", "@missing"}, "missing: ");
  refused({"-o", "a.pgl", "@empty"}, "empty: ");
  refused({"-o", "a.pgl", "nothing"}, "nothing: ");
  refused({"-o", "a.pgl", "list"}, "unknown format");
  refused({"-o", "a.pgl", model, fixture("out_of_range.obj").string()}, "out_of_range.obj: ");
  refused({"-o", "a.pgl", model, fixture("no_faces.obj").string()}, "no_faces.obj: ");
  refused({"-o", "missing/a.pgl", model}, "missing/a.pgl: ");
  refused({"-o", "folder.pgl", model}, "folder.pgl: ");
}

TEST_F(Preprocess, VrmlIsReadOrSaidToBeMissing) {
  folder_.write(
      "square.wrl",
      "#VRML V2.0 utf8\nShape { geometry IndexedFaceSet { coord Coordinate { point [0 0 0, 1 0 0, 1 1 0, 0 1 0] }"
      " coordIndex [0 1 2 3 -1] } }\n");
  const Outcome outcome = run({"-o", "square.pgl", "square.wrl"});
  if (outcome.code != 0) {
    expect_refused(outcome, 1, "square.wrl: VRML needs the library Coin", {"square.wrl"});
    GTEST_SKIP() << outcome.err;
  }
  expect_model("square.pgl", build_any_model(import_scene(folder_.path() / "square.wrl"), {}));
}

/// What anyone can install: a library of Debian's kicad-packages3d, whose solids stay apart.
TEST_F(Preprocess, AFolderOfRealPartsBecomesAWarehouse) {
  const fs::path parts = "/usr/share/kicad/3dmodels/Buzzer_Beeper.3dshapes";
  if (!fs::exists(parts)) GTEST_SKIP() << "kicad-packages3d is not installed";
  const Outcome outcome = run({"-o", "warehouse.pgl", parts.string(), "--split", "--warehouse"});
  if (outcome.err.find("needs the library Coin") != std::string::npos) GTEST_SKIP() << outcome.err;
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  ModelFile file(folder_.path() / "warehouse.pgl");
  file.verify();
  ImportOptions options;
  options.split = true;
  std::uint64_t objects = 0, triangles = 0;
  for (const auto& entry : fs::directory_iterator(parts)) {
    if (entry.path().extension() != ".wrl") continue;
    const Scene scene = import_scene(entry.path(), options);
    objects += scene.objects.size();
    for (const MeshData& mesh : scene.meshes) triangles += mesh.triangles.size();
  }
  EXPECT_GT(objects, 20u);
  EXPECT_EQ(file.objects(), objects);
  EXPECT_EQ(file.triangles(), triangles);
}

// ---- being stopped --------------------------------------------------------------------------------------------------

TEST_F(Preprocess, ASignalLeavesNothingBehind) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    Process process(folder_.path(), {"-o", "plant.pgl", "--objects", "700000"});
    process.wait_until_it_listens();
    std::this_thread::sleep_for(std::chrono::milliseconds(300));  // into the work
    process.send(signal);
    expect_refused(process.wait(), 128 + signal, "nothing was written", {});
  }
}

TEST_F(Preprocess, ASignalLeavesAFormerFileAsItWas) {
  make({"-o", "plant.pgl", "--objects", "20"});
  const std::string former = bytes("plant.pgl");
  Process process(folder_.path(), {"-o", "plant.pgl", "--objects", "700000"});
  process.wait_until_it_listens();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  process.send(SIGTERM);
  expect_refused(process.wait(), 128 + SIGTERM, "nothing was written", {"plant.pgl"});
  EXPECT_EQ(bytes("plant.pgl"), former);
  make({"-o", "plant.pgl", "--objects", "21"});
  expect_model("plant.pgl", build_plant({.objects = 21}, 0, 21, true, {}));
}

/// A model that takes a second to read.
std::string large_model() {
  std::string text;
  for (int k = 0; k < 400'000; ++k) text += "v " + std::to_string(k) + " 0 0\nv 0 1 0\nv 0 0 1\nf -1 -2 -3\n";
  return text;
}

/// Also while another process reads a large file for it, and never ends.
TEST_F(Preprocess, ASignalEndsTheReadingOfAFile) {
  folder_.write("large.obj", large_model());
  Process process(folder_.path(), {"-o", "large.pgl", "large.obj"});
  process.wait_until_it_listens();
  process.send_to_its_reader({SIGSTOP});
  process.send(SIGINT);
  expect_refused(process.wait(), 128 + SIGINT, "nothing was written", {"large.obj"});
}

/// As under nohup, where the signal goes to every process of the terminal.
TEST_F(Preprocess, ASignalThatTheCallerIgnoresEndsNothing) {
  folder_.write("large.obj", large_model());
  const auto before = signal(SIGHUP, SIG_IGN);
  Process process(folder_.path(), {"-o", "large.pgl", "large.obj"});
  signal(SIGHUP, before);
  process.wait_until_it_listens();
  process.send_to_its_reader({SIGSTOP, SIGHUP, SIGCONT});
  process.send(SIGHUP);
  const Outcome outcome = process.wait();
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(files(), (std::vector<std::string>{"large.obj", "large.pgl"}));
}

TEST_F(Preprocess, AFullDiskIsToldInOneLineAndNothingIsLeft) {
  make({"-o", "plant.pgl", "--objects", "500"});
  const std::string former = bytes("plant.pgl");
  // The least leaves room for the kilobyte of shared memory without which clang's OpenMP does not begin.
  for (const std::size_t limit : {std::size_t{4096}, former.size() / 8, former.size() / 2, former.size() - 1}) {
    const Outcome outcome = run({"-o", "plant.pgl", "--objects", "500"}, limit);
    expect_refused(outcome, 1, "plant.pgl: ", {"plant.pgl"});
    EXPECT_EQ(bytes("plant.pgl"), former);
  }
}

}  // namespace
