// SPDX-License-Identifier: MIT
// Unit tests of the .pgl file: what comes back, what is refused, what is left behind.
#include "scene/model_file.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <limits>
#include <thread>

#include "scene/build_model.hpp"
#include "scene/plant.hpp"
#include "support/model_files.hpp"
#include "support/test_data.hpp"

namespace {

using pgl::scene::build_model;
using pgl::scene::Error;
using pgl::scene::MeshData;
using pgl::scene::MeshSource;
using pgl::scene::Model;
using pgl::scene::ModelFile;
using pgl::scene::ModelFileWriter;
using pgl::scene::ModelView;
using pgl::scene::TemporaryFiles;
using pgl::scene::UpAxis;
using support::full_counts;
using support::ModelBytes;
using support::random_counts;
using support::random_model;
using support::RandomModelOptions;
using support::TemporaryFolder;
using Index16 = std::uint16_t;
using Index32 = std::uint32_t;
namespace fs = std::filesystem;

/// Equal bytes, so that NaN and -0 count.
template <class Element>
void expect_bytes(std::span<const Element> a, std::span<const Element> b, const char* what) {
  ASSERT_EQ(a.size(), b.size()) << what;
  EXPECT_TRUE(a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0) << what;
}

template <class Index>
void expect_equal(const ModelView<Index>& a, const ModelView<Index>& b) {
  expect_bytes(a.meshes, b.meshes, "meshes");
  expect_bytes(a.objects, b.objects, "objects");
  expect_bytes(a.vertices, b.vertices, "vertices");
  expect_bytes(a.triangles, b.triangles, "triangles");
  expect_bytes(a.ecol, b.ecol, "ecol");
  expect_bytes(a.map, b.map, "map");
  expect_bytes(a.errors, b.errors, "errors");
  expect_bytes(a.mesh_boxes, b.mesh_boxes, "mesh_boxes");
  expect_bytes(a.object_boxes, b.object_boxes, "object_boxes");
  expect_bytes(a.oriented_boxes, b.oriented_boxes, "oriented_boxes");
  expect_bytes(a.compactness, b.compactness, "compactness");
  expect_bytes(a.faces, b.faces, "faces");
  expect_bytes(a.compactness_order, b.compactness_order, "compactness_order");
}

template <class Index>
void write_model(const fs::path& file, const Model<Index>& model) {
  ModelFileWriter writer(file);
  writer.append(model);
  writer.finish();
}

template <class Index>
void expect_file_holds(const fs::path& path, const Model<Index>& model) {
  ModelFile file(path);
  ASSERT_EQ(file.wide(), sizeof(Index) == 4);
  EXPECT_EQ(file.bytes(), fs::file_size(path));
  EXPECT_EQ(file.meshes(), model.meshes.size());
  EXPECT_EQ(file.objects(), model.objects.size());
  EXPECT_EQ(file.vertices(), model.vertices.size());
  EXPECT_EQ(file.triangles(), model.triangles.size());
  EXPECT_EQ(file.has_errors(), model.errors.size() == model.map.size());
  const ModelView<Index> view = file.view<Index>();
  file.require(full_counts(view));
  file.require_map();
  file.require_ecol();
  if (file.has_errors()) file.require_errors();
  file.verify();
  expect_equal(view, ModelView<Index>(model));
}

template <class Index>
Model<Index> plant(std::size_t objects, bool errors = true) {
  const pgl::scene::PlantOptions options{.objects = objects};
  MeshSource source;
  source.count = objects;
  source.size = [=](std::size_t i) {
    const auto size = pgl::scene::plant_object_size(options, i);
    return pgl::scene::MeshSize{size.vertices, size.triangles};
  };
  source.make = [=](std::size_t i, MeshData& mesh) { pgl::scene::plant_object(options, i, mesh); };
  std::vector<pgl::Object> placed(objects);
  for (std::size_t i = 0; i < objects; ++i) placed[i].mesh = static_cast<std::uint32_t>(i);
  return build_model<Index>(source, placed, {}, {}, nullptr, errors);
}

/// What Error says when body is called; empty if nothing is thrown.
template <class Body>
std::string error_of(Body&& body) {
  try {
    body();
  } catch (const Error& error) {
    return error.what();
  }
  return {};
}
std::string opening_error(const fs::path& path) {
  return error_of([&] { ModelFile file(path); });
}

std::size_t entries_in(const fs::path& folder) {
  return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

template <class Index>
class BothWidths : public testing::Test {};
using Widths = testing::Types<Index16, Index32>;
TYPED_TEST_SUITE(BothWidths, Widths);

// ---- what comes back ------------------------------------------------------------------------------------------------

TYPED_TEST(BothWidths, APlantComesBackAsItWasBuilt) {
  const TemporaryFolder folder;
  for (const bool errors : {false, true}) {
    const auto model = plant<TypeParam>(300, errors);
    write_model(folder.path() / "plant.pgl", model);
    expect_file_holds(folder.path() / "plant.pgl", model);
  }
}

TYPED_TEST(BothWidths, AnEmptyModelIsAFileOfOnePage) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "empty.pgl";
  write_model(path, Model<TypeParam>{});
  expect_file_holds(path, Model<TypeParam>{});
  EXPECT_EQ(fs::file_size(path), 4096u);
}

TYPED_TEST(BothWidths, AnyModelComesBack) {
  const TemporaryFolder folder;
  std::mt19937 random(5);
  for (const std::size_t meshes : {1u, 2u, 30u, 3000u})
    for (const std::size_t objects : {0u, 1u, 40u, 5000u})
      for (const bool errors : {false, true}) {
        const auto model = random_model<TypeParam>(random, {.meshes = meshes, .objects = objects, .errors = errors});
        write_model(folder.path() / "m.pgl", model);
        expect_file_holds(folder.path() / "m.pgl", model);
      }
}

TEST(ModelFile, IsCheckedThroughThreeLevelsOfChecksums) {
  const TemporaryFolder folder;
  std::mt19937 random(6);
  const fs::path path = folder.path() / "m.pgl";
  const auto model = random_model<Index16>(random, {.meshes = 40, .objects = 50, .vertices = 60'000});
  write_model(path, model);
  expect_file_holds(path, model);
  const ModelBytes bytes(support::read_bytes(path));
  ASSERT_GT(bytes.data_pages(), 2 * 512u);  // so there is a level of several pages, and one above it
  ASSERT_EQ(bytes.count(ModelBytes::checksums), ((bytes.data_pages() + 511) / 512 + 1) * 512);
}

TEST(ModelFile, ChecksumsAreTheOnesThatEveryoneCalls64BitXXH3) {
  EXPECT_EQ(pgl::scene::format::checksum({}), 0x2d06800538d394c2u);
  const std::vector<std::byte> zeros(4096);
  EXPECT_EQ(pgl::scene::format::checksum(zeros), 0x93d76fe148c689bau);
}

TEST(ModelFile, ItsBytesAreAsTheFormatSays) {
  const TemporaryFolder folder;
  std::mt19937 random(7);
  const auto model = random_model<Index32>(random, {});
  write_model(folder.path() / "m.pgl", model);
  ModelBytes file(support::read_bytes(folder.path() / "m.pgl"));
  EXPECT_EQ(file.bytes.substr(0, 8), "\x93PGL\r\n\x1a\n");
  EXPECT_EQ(file.get<std::uint32_t>(8), 2u);
  EXPECT_EQ(file.bytes.substr(12, 4), "\x04\x03\x02\x01");
  EXPECT_EQ(file.get<std::uint32_t>(16), 4096u);
  EXPECT_EQ(file.get<std::uint32_t>(20), 32u);
  EXPECT_EQ(file.get<std::uint64_t>(24), file.bytes.size());
  EXPECT_EQ(file.get<std::uint32_t>(40), 14u);
  EXPECT_EQ(file.get<std::uint32_t>(44), 0u);
  for (std::size_t s = 0; s < ModelBytes::sections; ++s) {
    EXPECT_EQ(file.get<std::uint32_t>(ModelBytes::entry(s)), s);
    EXPECT_EQ(file.first_byte(s) % 4096, 0u);
    EXPECT_EQ(file.first_byte(s), s == 0 ? 4096 : (file.end_byte(s - 1) + 4095) / 4096 * 4096);
  }
  EXPECT_EQ(std::memcmp(file.bytes.data() + file.first_byte(ModelBytes::map), model.map.data(), model.map.size() * 4),
            0);
  ASSERT_EQ(file.count(ModelBytes::errors), model.errors.size());
  EXPECT_EQ(std::memcmp(file.bytes.data() + file.first_byte(ModelBytes::errors), model.errors.data(),
                        model.errors.size() * 4),
            0);
  // An independent seal changes nothing.
  ModelBytes sealed = file;
  sealed.seal();
  EXPECT_EQ(sealed.bytes, file.bytes);
}

/// As files of version 1 were written: without a section of errors, whose entry would have been the last but one.
ModelBytes as_version_1(ModelBytes bytes) {
  EXPECT_EQ(bytes.count(ModelBytes::errors), 0u);
  bytes.put(8, std::uint32_t{1});
  bytes.put(40, std::uint32_t{13});
  const std::size_t last = ModelBytes::entry(ModelBytes::errors), after = ModelBytes::entry(ModelBytes::checksums);
  std::memcpy(bytes.bytes.data() + last, bytes.bytes.data() + after, 24);
  bytes.put(last, std::uint32_t{12});
  std::memset(bytes.bytes.data() + after, 0, 24);
  bytes.seal_header();
  return bytes;
}

TYPED_TEST(BothWidths, AFileOfVersion1IsReadAsOneWithoutErrors) {
  const TemporaryFolder folder;
  std::mt19937 random(15);
  for (const std::size_t meshes : {0u, 1u, 50u}) {
    const auto model = random_model<TypeParam>(random, {.meshes = meshes, .errors = false});
    write_model(folder.path() / "m.pgl", model);
    const ModelBytes old = as_version_1(ModelBytes(support::read_bytes(folder.path() / "m.pgl")));
    expect_file_holds(folder.write("old.pgl", old.bytes), model);

    // Its own header is checked, not one that was made of it.
    for (const std::size_t at :
         {std::size_t{40}, ModelBytes::entry(ModelBytes::errors), ModelBytes::entry(ModelBytes::errors) + 4,
          ModelBytes::entry(ModelBytes::errors) + 8, ModelBytes::entry(ModelBytes::errors) + 16,
          ModelBytes::entry(ModelBytes::checksums), ModelBytes::entry(ModelBytes::checksums) + 23}) {
      ModelBytes bytes = old;
      bytes.bytes[at] ^= 1;
      bytes.seal_header();
      EXPECT_NE(opening_error(folder.write("t.pgl", bytes.bytes)).find("is damaged: "), std::string::npos) << at;
    }
  }
}

TEST(ModelFile, SaysWhichAxisPointsUpIfThatWasTold) {
  const TemporaryFolder folder;
  std::mt19937 random(10);
  const fs::path path = folder.path() / "m.pgl";
  const auto model = random_model<Index16>(random, {});
  write_model(path, model);
  EXPECT_EQ(ModelFile(path).up(), UpAxis::not_told);
  const std::string untold = support::read_bytes(path);
  const std::pair<UpAxis, std::uint32_t> axes[] = {{UpAxis::x, 1}, {UpAxis::y, 2}, {UpAxis::z, 3}};
  for (const auto& [up, number] : axes) {
    ModelFileWriter writer(path);
    writer.append(model);
    writer.set_up(up);
    writer.finish();
    ModelFile file(path);
    EXPECT_EQ(file.up(), up);
    file.verify();
    EXPECT_EQ(direction_of(file.up()), glm::dvec3(number == 1, number == 2, number == 3));
    ModelBytes expected(untold);  // the header and nothing else says it
    expected.put(44, number);
    expected.seal_header();
    EXPECT_EQ(support::read_bytes(path), expected.bytes);
  }
}

// ---- the writer -----------------------------------------------------------------------------------------------------

/// The meshes and objects of several models after each other, as one.
template <class Index>
Model<Index> joined(const std::vector<std::variant<Model<Index16>, Model<Index32>>>& parts) {
  Model<Index> all;
  for (const auto& part : parts)
    std::visit(
        [&](const auto& model) {
          using From = std::decay_t<decltype(model.ecol[0])>;
          const auto first_mesh = static_cast<std::uint32_t>(all.meshes.size());
          for (pgl::Mesh mesh : model.meshes) {
            mesh.first_vertex += all.vertices.size();
            mesh.first_triangle += all.triangles.size();
            mesh.first_map += all.map.size();
            all.meshes.push_back(mesh);
          }
          for (pgl::Object object : model.objects) {
            object.mesh += first_mesh;
            all.objects.push_back(object);
          }
          all.vertices.insert(all.vertices.end(), model.vertices.begin(), model.vertices.end());
          for (const auto& t : model.triangles)
            all.triangles.push_back(
                {{static_cast<Index>(t.v[0]), static_cast<Index>(t.v[1]), static_cast<Index>(t.v[2])}});
          for (const From v : model.ecol)
            all.ecol.push_back(v == pgl::no_target<From> ? pgl::no_target<Index> : static_cast<Index>(v));
          all.map.insert(all.map.end(), model.map.begin(), model.map.end());
          all.errors.insert(all.errors.end(), model.errors.begin(), model.errors.end());
          all.mesh_boxes.insert(all.mesh_boxes.end(), model.mesh_boxes.begin(), model.mesh_boxes.end());
          all.oriented_boxes.insert(all.oriented_boxes.end(), model.oriented_boxes.begin(), model.oriented_boxes.end());
          all.compactness.insert(all.compactness.end(), model.compactness.begin(), model.compactness.end());
        },
        part);
  support::make_object_tables(all);
  return all;
}

TEST(ModelFileWriter, JoinsPartsOfEitherWidthInEitherOrder) {
  const TemporaryFolder folder;
  std::mt19937 random(8);
  const RandomModelOptions options{.meshes = 20, .objects = 30, .vertices = 300, .triangles = 500};
  for (int widths = 0; widths < 16; ++widths) {
    std::vector<std::variant<Model<Index16>, Model<Index32>>> parts;
    ModelFileWriter writer(folder.path() / "m.pgl");
    for (int k = 0; k < 4; ++k) {
      if (widths >> k & 1) {
        parts.emplace_back(random_model<Index32>(random, options));
      } else {
        parts.emplace_back(random_model<Index16>(random, options));
      }
      std::visit([&](const auto& part) { writer.append(part); }, parts.back());
      writer.append(Model<Index16>{});
    }
    writer.finish();
    if (widths == 0) {
      expect_file_holds(folder.path() / "m.pgl", joined<Index16>(parts));
    } else {
      expect_file_holds(folder.path() / "m.pgl", joined<Index32>(parts));
    }
  }
}

TEST(ModelFileWriter, RefusesErrorsOfSomePartsOnly) {
  const TemporaryFolder folder;
  std::mt19937 random(16);
  for (const bool first : {false, true}) {
    ModelFileWriter writer(folder.path() / "m.pgl");
    writer.append(random_model<Index16>(random, {.errors = first}));
    writer.append(random_model<Index32>(random, {.errors = !first}));
    EXPECT_EQ(error_of([&] { writer.finish(); }),
              (folder.path() / "m.pgl").string() + ": cannot be written: some parts have errors, others none");
  }
  EXPECT_EQ(entries_in(folder.path()), 0u);
}

TEST(ModelFileWriter, LetsObjectsBePlacedBeforeTheirTablesAreMade) {
  const TemporaryFolder folder;
  std::mt19937 random(9);
  auto model = random_model<Index16>(random, {.meshes = 7, .objects = 20});
  ModelFileWriter writer(folder.path() / "m.pgl");
  writer.append(model);
  ASSERT_EQ(writer.objects().size(), 20u);
  for (std::size_t i = 0; i < 20; ++i) {
    writer.objects()[i].transform[3] += glm::vec3(100, static_cast<float>(i), 0);
    writer.objects()[i].mesh = static_cast<std::uint32_t>(i % 7);
  }
  model.objects.assign(writer.objects().begin(), writer.objects().end());
  writer.finish();
  expect_file_holds(folder.path() / "m.pgl", joined<Index16>({model}));
}

TEST(ModelFileWriter, RefusesAnObjectWithoutMesh) {
  const TemporaryFolder folder;
  std::mt19937 random(9);
  ModelFileWriter writer(folder.path() / "m.pgl");
  writer.append(random_model<Index16>(random, {}));
  writer.objects()[3].mesh = 5;
  EXPECT_THROW(writer.finish(), Error);
}

class EitherTemporary : public testing::TestWithParam<TemporaryFiles> {};
INSTANTIATE_TEST_SUITE_P(ModelFileWriter, EitherTemporary,
                         testing::Values(TemporaryFiles::unnamed, TemporaryFiles::named));

TEST_P(EitherTemporary, NothingAppearsBeforeTheEndAndNothingElseStays) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(10);
  const auto model = random_model<Index16>(random, {.meshes = 200, .objects = 300});
  {
    ModelFileWriter abandoned(path, GetParam());
    abandoned.append(model);
    EXPECT_FALSE(fs::exists(path));
  }
  EXPECT_EQ(entries_in(folder.path()), 0u);
  {
    ModelFileWriter writer(path, GetParam());
    writer.append(model);
    EXPECT_EQ(entries_in(folder.path()), GetParam() == TemporaryFiles::named ? 1u : 0u);
    writer.finish([&](std::string_view, std::size_t, std::size_t) { EXPECT_FALSE(fs::exists(path)); });
    EXPECT_TRUE(fs::exists(path));
  }
  EXPECT_EQ(entries_in(folder.path()), 1u);
  expect_file_holds(path, model);
}

TEST_P(EitherTemporary, AFileThatWasThereIsReplacedAtTheEndOrStays) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(11);
  const auto before = random_model<Index16>(random, {}), after = random_model<Index16>(random, {});
  write_model(path, before);
  ModelFile open_before(path);
  {
    ModelFileWriter writer(path, GetParam());
    writer.append(after);
    EXPECT_THROW(writer.finish([](std::string_view, std::size_t, std::size_t) { throw std::domain_error("stop"); }),
                 std::domain_error);
  }
  expect_file_holds(path, before);
  EXPECT_EQ(entries_in(folder.path()), 1u);
  {
    ModelFileWriter writer(path, GetParam());
    writer.append(after);
    writer.finish();
  }
  expect_file_holds(path, after);
  EXPECT_EQ(entries_in(folder.path()), 1u);
  // What was open is what it was.
  const auto view = open_before.view<Index16>();
  open_before.require(full_counts(view));
  expect_equal(view, ModelView<Index16>(before));
}

TEST_P(EitherTemporary, AFullDiskIsOneLineAndLeavesNothing) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(12);
  const auto model = random_model<Index16>(random, {.meshes = 100, .objects = 100, .vertices = 4000});
  // A limit to the size of files stands for the disk: first the temporary files reach it, then the file itself.
  struct rlimit unlimited {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &unlimited), 0);
  const auto old_handler = signal(SIGXFSZ, SIG_IGN);
  write_model(path, model);
  const rlim_t size = fs::file_size(path);
  fs::remove(path);
  for (const rlim_t limit : {rlim_t{100'000}, size - 4096}) {
    std::string error;
    bool in_finish = false;
    {
      ModelFileWriter writer(path, GetParam());
      struct rlimit limited = unlimited;
      limited.rlim_cur = limit;
      ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limited), 0);
      error = error_of([&] {
        writer.append(model);
        in_finish = true;
        writer.finish();
      });
      ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
    }
    EXPECT_EQ(error, path.string() + ": cannot be written: File too large");
    EXPECT_EQ(in_finish, limit == size - 4096);
    EXPECT_EQ(entries_in(folder.path()), 0u);
  }
  signal(SIGXFSZ, old_handler);
}

TEST(ModelFileWriter, SaysAtOnceWhereItCannotWrite) {
  const TemporaryFolder folder;
  const fs::path missing = folder.path() / "missing" / "m.pgl";
  EXPECT_EQ(error_of([&] { ModelFileWriter writer(missing); }),
            missing.string() + ": cannot be written: No such file or directory");
  EXPECT_EQ(error_of([&] { ModelFileWriter writer(folder.path()); }),
            folder.path().string() + ": cannot be written: it is a folder");
  const fs::path pipe = folder.path() / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(error_of([&] { ModelFileWriter writer(pipe); }),
            pipe.string() + ": cannot be written: it is not a regular file");
  EXPECT_EQ(entries_in(folder.path()), 1u);
}

TEST(ModelFileWriter, FollowsSymbolicLinks) {
  const TemporaryFolder folder;
  fs::create_directory(folder.path() / "real");
  fs::create_symlink("real/m.pgl", folder.path() / "link.pgl");
  fs::create_symlink(folder.path() / "link.pgl", folder.path() / "link2.pgl");
  fs::create_symlink("loop.pgl", folder.path() / "loop.pgl");
  std::mt19937 random(13);
  for (int k = 0; k < 2; ++k) {  // to a file that is not there, and to one that is
    const auto model = random_model<Index16>(random, {});
    write_model(folder.path() / "link2.pgl", model);
    expect_file_holds(folder.path() / "real" / "m.pgl", model);
    EXPECT_TRUE(fs::is_symlink(folder.path() / "link.pgl") && fs::is_symlink(folder.path() / "link2.pgl"));
  }
  EXPECT_THROW(ModelFileWriter(folder.path() / "loop.pgl"), Error);
}

TEST(ModelFileWriter, WritesBesideTheWorkingFolderToo) {
  const TemporaryFolder folder;
  const fs::path before = fs::current_path();
  fs::current_path(folder.path());
  write_model("m.pgl", Model<Index16>{});
  fs::current_path(before);
  expect_file_holds(folder.path() / "m.pgl", Model<Index16>{});
}

TEST(ModelFileWriter, TellsProgressUpToTheEnd) {
  const TemporaryFolder folder;
  std::mt19937 random(14);
  ModelFileWriter writer(folder.path() / "m.pgl");
  writer.append(random_model<Index16>(random, {.meshes = 400, .objects = 10, .vertices = 10'000}));
  std::vector<std::string> stages;
  std::size_t last = 0, calls = 0;
  writer.finish([&](std::string_view stage, std::size_t done, std::size_t total) {
    if (stages.empty() || stages.back() != stage) {
      stages.emplace_back(stage);
      last = 0;
    }
    EXPECT_GE(done, last);
    EXPECT_LE(done, total);
    EXPECT_EQ(total, fs::exists(folder.path() / "m.pgl") ? 0 : total);
    last = done;
    ++calls;
  });
  EXPECT_EQ(stages, (std::vector<std::string>{"write", "sync"}));
  EXPECT_GT(calls, 4u);
}

// ---- what is read when ----------------------------------------------------------------------------------------------

TEST(ModelFile, OpeningChecksNoPageAndEachIsCheckedOnceWhenItIsUsed) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(20);
  const auto model = random_model<Index16>(random, {.meshes = 300, .objects = 400, .vertices = 3000});
  write_model(path, model);
  const ModelBytes bytes(support::read_bytes(path));

  ModelFile file(path);
  EXPECT_EQ(file.bytes_verified(), 0u);
  const auto view = file.view<Index16>();
  const std::uint64_t tables = file.bytes_verified();
  EXPECT_GE(tables, bytes.first_byte(ModelBytes::map) - 4096);
  EXPECT_LE(tables, bytes.first_byte(ModelBytes::map) + 3 * 4096);  // and the checksums of those

  std::vector<std::uint32_t> counts(view.objects.size(), 0);
  file.require(counts);
  EXPECT_EQ(file.bytes_verified(), tables);
  counts[17] = view.meshes[view.objects[17].mesh].min_vertices;
  file.require(counts);
  const std::uint64_t one = file.bytes_verified();
  EXPECT_GT(one, tables);
  EXPECT_LT(one, tables + 200'000);
  file.require(counts);
  EXPECT_EQ(file.bytes_verified(), one);

  const auto some = random_counts(view, random);
  file.prefetch(some);
  const std::uint64_t more = file.bytes_verified();
  EXPECT_GT(more, one);
  file.require(some);
  EXPECT_EQ(file.bytes_verified(), more);
  file.require(full_counts(view));
  EXPECT_LE(file.bytes_verified(), bytes.bytes.size());
  file.require_map();
  file.require_ecol();
  const std::uint64_t drawn = file.bytes_verified();
  file.require_errors();
  const std::uint64_t with_errors = file.bytes_verified();
  EXPECT_GE(with_errors - drawn, 4 * view.errors.size());
  file.require_errors();
  EXPECT_EQ(file.bytes_verified(), with_errors);
  file.verify();
  EXPECT_EQ(file.bytes_verified(), bytes.bytes.size() - 4096);
}

TEST(ModelFile, APrefixOfAnObjectNeedsNotTheRest) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  // One mesh of many pages; damage in its last vertex, its last triangle, and in another mesh.
  std::mt19937 random(21);
  Model<Index16> model;
  do {
    model = random_model<Index16>(random, {.meshes = 2, .objects = 6, .vertices = 50'000, .triangles = 60'000});
  } while (model.meshes[0].max_vertices < 20'000 || model.meshes[1].max_vertices < 20'000 ||
           model.meshes[0].min_vertices > 10'000 || model.map[0] == 0 || model.triangles.size() < 20'000);
  for (std::uint32_t i = 0; i < 6; ++i) model.objects[i].mesh = i % 2;
  write_model(path, model);
  ModelBytes bytes(support::read_bytes(path));
  const pgl::Mesh& first = model.meshes[0];
  const std::uint32_t triangles = model.map[first.max_vertices - first.min_vertices];
  ASSERT_GT(triangles, 5000u);
  bytes.bytes[bytes.first_byte(ModelBytes::vertices) + 12 * (first.max_vertices - 1)] ^= 1;
  std::vector<std::uint32_t> counts{first.min_vertices, 0, 0, 0, 0, 0};
  {
    ModelFile file(folder.write("v.pgl", bytes.bytes));
    file.require(counts);
    counts[2] = first.max_vertices;
    const std::string error = error_of([&] { file.require(counts); });
    EXPECT_TRUE(error.starts_with((folder.path() / "v.pgl").string() + ": is damaged: section 'vertices': ")) << error;
    EXPECT_FALSE(error_of([&] { file.require(counts); }).empty());  // again, as often as it is asked
    counts[2] = 0;
    file.require(counts);
  }
  bytes = ModelBytes(support::read_bytes(path));
  bytes.bytes[bytes.first_byte(ModelBytes::triangles) + 6 * (triangles - 1)] ^= 1;
  {
    ModelFile file(folder.write("t.pgl", bytes.bytes));
    file.require(counts);
    file.prefetch({{first.max_vertices, 0, 0, 0, 0, 0}});  // finds it, and does not say so
    counts[4] = first.max_vertices;
    EXPECT_NE(error_of([&] { file.require(counts); }).find("'triangles'"), std::string::npos);
  }
}

TEST(ModelFile, MapsMayBeCheckedBeforeTheRest) {
  const TemporaryFolder folder;
  std::mt19937 random(22);
  Model<Index16> model;
  do {  // the maps of the two meshes share no page
    model = random_model<Index16>(random, {.meshes = 3, .objects = 3, .vertices = 50'000, .triangles = 60'000});
  } while (model.meshes[1].max_vertices < model.meshes[1].min_vertices + 5000);
  for (std::uint32_t i = 0; i < 3; ++i) model.objects[i].mesh = i;
  const fs::path path = folder.path() / "m.pgl";
  write_model(path, model);
  ModelBytes bytes(support::read_bytes(path));
  bytes.bytes[bytes.first_byte(ModelBytes::map) + 4 * model.meshes[2].first_map] ^= 1;
  ModelFile file(folder.write("d.pgl", bytes.bytes));
  (void)file.view<Index16>();
  const std::uint64_t tables = file.bytes_verified();
  file.require_maps({{model.meshes[0].max_vertices, 0, 0}});
  const std::uint64_t one = file.bytes_verified();
  EXPECT_GT(one, tables);
  file.require_maps({{model.meshes[0].max_vertices, 0, 0}});
  EXPECT_EQ(file.bytes_verified(), one);
  const std::string error = error_of([&] { file.require_maps({{0, 0, model.meshes[2].max_vertices}}); });
  EXPECT_NE(error.find("section 'map'"), std::string::npos) << error;
  EXPECT_FALSE(error_of([&] { file.require_maps({{0, 0, model.meshes[2].max_vertices}}); }).empty());
  file.require({{model.meshes[0].max_vertices, 0, 0}});
}

TEST(ModelFile, ErrorsAreCheckedWhereTheyAreAskedForAndNowhereElse) {
  const TemporaryFolder folder;
  std::mt19937 random(26);
  const auto model = random_model<Index16>(random, {.meshes = 40, .objects = 40, .vertices = 2000});
  write_model(folder.path() / "m.pgl", model);
  ModelBytes bytes(support::read_bytes(folder.path() / "m.pgl"));
  bytes.bytes[(bytes.first_byte(ModelBytes::errors) + bytes.end_byte(ModelBytes::errors)) / 2] ^= 1;
  ModelFile file(folder.write("d.pgl", bytes.bytes));
  file.require(full_counts(file.view<Index16>()));
  file.require_map();
  file.require_ecol();
  for (int k = 0; k < 2; ++k) {
    const std::string error = error_of([&] { file.require_errors(); });
    EXPECT_NE(error.find("d.pgl: is damaged: section 'errors': "), std::string::npos) << error;
  }

  write_model(folder.path() / "n.pgl", random_model<Index16>(random, {.errors = false}));
  ModelFile none(folder.path() / "n.pgl");
  EXPECT_TRUE(none.view<Index16>().errors.empty());
  EXPECT_EQ(error_of([&] { none.require_errors(); }),
            (folder.path() / "n.pgl").string() + ": has no recorded errors; pgl_preprocess --errors records them");
}

/// How many pages of the range the system has in memory.
template <class Element>
std::size_t pages_in_memory(std::span<const Element> range) {
  const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto first = reinterpret_cast<std::uintptr_t>(range.data()) / page * page;
  const auto bytes = reinterpret_cast<std::uintptr_t>(range.data() + range.size()) - first;
  std::vector<unsigned char> there((bytes + page - 1) / page);
  EXPECT_EQ(mincore(reinterpret_cast<void*>(first), bytes, there.data()), 0);
  return static_cast<std::size_t>(std::count_if(there.begin(), there.end(), [](unsigned char c) { return c & 1; }));
}

TEST(ModelFile, PrefetchFetchesAgainWhatTheSystemHasDropped) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(25);
  write_model(path, random_model<Index16>(random, {.meshes = 20, .objects = 20, .vertices = 20'000}));
  ModelFile file(path);
  const auto view = file.view<Index16>();
  const auto counts = full_counts(view);
  const std::vector<std::uint32_t> nothing(counts.size(), 0);
  const auto object = static_cast<std::size_t>(std::max_element(counts.begin(), counts.end()) - counts.begin());
  const pgl::Mesh& mesh = view.meshes[view.objects[object].mesh];
  const auto vertices = view.vertices.subspan(mesh.first_vertex, mesh.max_vertices);
  ASSERT_GT(vertices.size_bytes(), 100'000u);
  file.prefetch(counts);
  file.prefetch(nothing);
  const std::size_t pages = pages_in_memory(vertices);
  // Out of this process' memory, and then out of the system's: the whole file, of which it keeps pages together.
  const ModelBytes bytes(support::read_bytes(path));
  auto* const mapping =
      const_cast<char*>(reinterpret_cast<const char*>(view.vertices.data())) - bytes.first_byte(ModelBytes::vertices);
  ASSERT_EQ(madvise(mapping, bytes.bytes.size(), MADV_DONTNEED), 0);
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  posix_fadvise(descriptor, 0, 0, POSIX_FADV_DONTNEED);
  close(descriptor);
  if (pages_in_memory(vertices) > pages / 2) GTEST_SKIP() << "files are always in memory here";
  file.prefetch(nothing);
  EXPECT_LT(pages_in_memory(vertices), pages / 2);
  const std::uint64_t verified = file.bytes_verified();
  file.prefetch(counts);
  for (int k = 0; k < 500 && pages_in_memory(vertices) < pages; ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_EQ(pages_in_memory(vertices), pages);
  EXPECT_EQ(file.bytes_verified(), verified);
}

TEST(ModelFile, PrefetchStopsWhenItIsTold) {
  const TemporaryFolder folder;
  std::mt19937 random(22);
  const auto model = random_model<Index16>(random, {.meshes = 300, .objects = 2000, .vertices = 500});
  write_model(folder.path() / "m.pgl", model);
  ModelFile file(folder.path() / "m.pgl");
  const auto view = file.view<Index16>();
  const std::uint64_t before = file.bytes_verified();
  std::stop_source stop;
  stop.request_stop();
  file.prefetch(full_counts(view), stop.get_token());
  EXPECT_EQ(file.bytes_verified(), before);
}

TEST(ModelFile, IsReadByManyThreadsAtATime) {
  const TemporaryFolder folder;
  std::mt19937 random(23);
  const auto model = random_model<Index16>(random, {.meshes = 300, .objects = 2000, .vertices = 1500});
  write_model(folder.path() / "m.pgl", model);
  const ModelView<Index16> expected(model);
  std::vector<std::vector<std::uint32_t>> selections;
  for (int k = 0; k < 40; ++k) selections.push_back(random_counts(expected, random));
  for (int round = 0; round < 5; ++round) {
    ModelFile file(folder.path() / "m.pgl");
    std::vector<std::jthread> threads;
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&, t] {
        for (const auto& counts : selections) {
          if (t % 2 == 0) {
            file.prefetch(counts);
          } else {
            EXPECT_EQ(error_of([&] { file.require(counts); }), "");
          }
        }
        EXPECT_EQ(file.view<Index16>().objects.size(), 2000u);
      });
    threads.clear();
    file.require(full_counts(expected));
    expect_equal(file.view<Index16>(), expected);
  }
}

TEST(ModelFile, MayBeMovedWhileItsArraysAreInUse) {
  const TemporaryFolder folder;
  std::mt19937 random(24);
  const auto model = random_model<Index16>(random, {});
  write_model(folder.path() / "m.pgl", model);
  ModelFile file(folder.path() / "m.pgl");
  const auto view = file.view<Index16>();
  ModelFile moved(std::move(file));
  moved.require(full_counts(view));
  ModelFile assigned(folder.path() / "m.pgl");
  assigned = std::move(moved);
  expect_equal(view, ModelView<Index16>(model));
}

// ---- what is refused ------------------------------------------------------------------------------------------------

TEST(ModelFile, SaysWhatIsNoModelFile) {
  const TemporaryFolder folder;
  const auto error = [&](std::string_view name, std::string_view bytes) {
    const fs::path path = folder.write(name, bytes);
    const std::string text = opening_error(path);
    EXPECT_TRUE(text.starts_with(path.string() + ": "));
    return text.substr(std::min(text.size(), path.string().size() + 2));
  };
  EXPECT_EQ(error("empty", ""), "is empty");
  EXPECT_EQ(error("text", "solid teapot\n"), "is not a pgl model file");
  EXPECT_EQ(error("long", std::string(100'000, 'x')), "is not a pgl model file");
  EXPECT_EQ(error("magic", "\x93PG"), "is truncated: it has no whole header");
  EXPECT_EQ(opening_error(folder.path() / "none"),
            (folder.path() / "none").string() + ": cannot be opened: No such file or directory");
  EXPECT_EQ(opening_error(folder.path()), folder.path().string() + ": is not a regular file");
  const fs::path pipe = folder.path() / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(opening_error(pipe), pipe.string() + ": is not a regular file");

  std::mt19937 random(30);
  write_model(folder.path() / "m.pgl", random_model<Index16>(random, {}));
  const ModelBytes good(support::read_bytes(folder.path() / "m.pgl"));
  ModelBytes bytes = good;
  for (const std::uint32_t version : {0u, 3u, 0xffffffffu}) {
    bytes = good;
    bytes.put(8, version);
    const std::string expected =
        "has version " + std::to_string(version) + " of the format, this program reads versions 1 and 2";
    EXPECT_EQ(error("version", bytes.bytes), expected);
    bytes.seal_header();
    EXPECT_EQ(error("version", bytes.bytes), expected);
  }
  bytes = good;
  bytes.put<std::uint32_t>(8, 1);
  bytes.seal_header();
  EXPECT_EQ(error("version", bytes.bytes), "is damaged: the header does not make sense");
  bytes = good;
  bytes.put<std::uint32_t>(12, 0x04030201);
  EXPECT_EQ(error("order", bytes.bytes), "is of a machine with the other order of bytes");
  bytes = good;
  bytes.bytes[100] ^= 4;
  EXPECT_EQ(error("header", bytes.bytes), "is damaged: the checksum of the header does not match");
  EXPECT_EQ(error("longer", good.bytes + "x"), "has 1 bytes after its end");
  const std::string whole = std::to_string(good.bytes.size());
  EXPECT_EQ(error("shorter", good.bytes.substr(0, good.bytes.size() - 1)),
            "is truncated: " + std::to_string(good.bytes.size() - 1) + " of " + whole + " bytes");
}

TEST(ModelFile, IsRefusedAtEveryLength) {
  const TemporaryFolder folder;
  std::mt19937 random(31);
  write_model(folder.path() / "m.pgl", random_model<Index16>(random, {}));
  const std::string good = support::read_bytes(folder.path() / "m.pgl");
  const fs::path path = folder.write("t.pgl", good);
  for (std::size_t length = good.size(); length-- > 0;) {
    if (length > 5000 && length % 7 != 0 && length % 4096 > 2 && length % 4096 < 4094) continue;
    ASSERT_EQ(truncate(path.c_str(), static_cast<off_t>(length)), 0);
    ASSERT_NE(opening_error(path), "") << length;
  }
}

TEST(ModelFile, RefusesHeadersThatMakeNoSenseThoughTheirChecksumIsRight) {
  const TemporaryFolder folder;
  std::mt19937 random(32);
  write_model(folder.path() / "m.pgl", random_model<Index16>(random, {}));
  const ModelBytes good(support::read_bytes(folder.path() / "m.pgl"));
  const auto error = [&](auto&& change) {
    ModelBytes bytes = good;
    change(bytes);
    bytes.seal_header();
    const fs::path path = folder.write("t.pgl", bytes.bytes);
    return error_of([&] { ModelFile(path).verify(); });
  };
  constexpr std::uint64_t huge = std::numeric_limits<std::uint64_t>::max();
  for (std::size_t s = 0; s < ModelBytes::sections; ++s) {
    for (const std::uint64_t count : {huge, huge / 2, huge / 12 + 1, std::uint64_t{1} << 40, good.count(s) + 1,
                                      good.count(s) - 1, good.count(s) + 4096, std::uint64_t{0}})
      EXPECT_NE(error([&](ModelBytes& b) { b.put(ModelBytes::entry(s) + 16, count); }), "") << s << " " << count;
    for (const std::uint64_t first : {huge, huge - 4095, std::uint64_t{0}, good.first_byte(s) + 4096,
                                      good.first_byte(s) - 4096, good.first_byte(s) + 1, good.first_byte((s + 5) % 14)})
      EXPECT_NE(error([&](ModelBytes& b) { b.put(ModelBytes::entry(s) + 8, first); }), "") << s << " " << first;
    for (const std::uint32_t size : {0u, 1u, 3u, 0xffffffffu})
      EXPECT_NE(error([&](ModelBytes& b) { b.put(ModelBytes::entry(s) + 4, size); }), "") << s << " " << size;
    EXPECT_NE(error([&](ModelBytes& b) { b.put(ModelBytes::entry(s), std::uint32_t{99}); }), "") << s;
  }
  EXPECT_NE(error([](ModelBytes& b) { b.put<std::uint32_t>(16, 8192); }), "");
  EXPECT_NE(error([](ModelBytes& b) { b.put<std::uint32_t>(20, 32); }), "");
  EXPECT_NE(error([](ModelBytes& b) { b.put<std::uint32_t>(20, 8); }), "");
  EXPECT_NE(error([](ModelBytes& b) { b.put<std::uint64_t>(24, huge); }), "");
  for (const std::uint32_t sections : {0u, 13u, 15u})
    EXPECT_NE(error([=](ModelBytes& b) { b.put<std::uint32_t>(40, sections); }), "") << sections;
  for (const std::uint32_t up : {4u, 5u, 0x100u, 0x01000000u, 0xffffffffu})
    EXPECT_NE(error([=](ModelBytes& b) { b.put<std::uint32_t>(44, up); }), "") << up;
  EXPECT_NE(error([](ModelBytes& b) { b.put<std::uint32_t>(12, 1); }), "");
  EXPECT_NE(error([](ModelBytes& b) { b.bytes[4000] = 1; }), "");
  EXPECT_EQ(error([](ModelBytes&) {}), "");  // and nothing changed is nothing wrong
}

TEST(ModelFile, RefusesContentsThatBreakARuleByOneThoughChecksumsAreRight) {
  const TemporaryFolder folder;
  Model<Index16> model;
  constexpr Index16 none = pgl::no_target<Index16>;
  model.meshes = {{0, 0, 0, 2, 5}, {5, 3, 4, 0, 0}, {5, 3, 5, 1, 1}};
  model.vertices.resize(6);
  model.triangles = {{{0, 1, 1}}, {{2, 1, 0}}, {{4, 3, 2}}};
  model.ecol = {none, none, 0, 1, 3, none};
  model.map = {1, 1, 2, 3, 0, 0};
  constexpr float infinity = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  model.errors = {infinity, 2, 2, -0.0f, 0, 0.5f};  // also a whole mesh may have an error
  model.mesh_boxes.resize(3);
  model.oriented_boxes.resize(3);
  for (auto& box : model.oriented_boxes) box.half = {3, 2, 1};
  model.compactness = {0.5f, 0, 0.25f};
  model.objects.resize(4);
  for (std::uint32_t i = 0; i < 4; ++i) model.objects[i].mesh = i % 3;
  support::make_object_tables(model);
  ASSERT_EQ(model.compactness_order, (std::vector<Index32>{0, 3, 2, 1}));
  write_model(folder.path() / "m.pgl", model);
  expect_file_holds(folder.path() / "m.pgl", model);
  const ModelBytes good(support::read_bytes(folder.path() / "m.pgl"));

  const auto expect_refused = [&](ModelBytes::Section section, const char* what, auto&& change,
                                  bool drawn = true) {  // what no object draws, require does not look at
    ModelBytes bytes = good;
    change(bytes, bytes.first_byte(section));
    bytes.seal();
    const fs::path path = folder.write("t.pgl", bytes.bytes);
    const std::string part = std::string("section '").append(pgl::scene::format::section_names[section]).append("'");
    const std::string verified = error_of([&] { ModelFile(path).verify(); });
    EXPECT_NE(verified.find(part), std::string::npos) << what << ": " << verified;
    const std::string used = error_of([&] {
      ModelFile file(path);
      file.require(full_counts(file.view<Index16>()));
    });
    EXPECT_EQ(used, drawn ? verified : "") << what;
    const std::string maps = error_of([&] {
      ModelFile file(path);
      file.require_maps(full_counts(file.view<Index16>()));
    });
    EXPECT_EQ(maps, drawn && section != ModelBytes::triangles && section != ModelBytes::ecol ? verified : "") << what;
    const std::string sections = error_of([&] {
      ModelFile file(path);
      file.require_map();
      file.require_ecol();
      file.require_errors();
    });
    EXPECT_EQ(sections, section == ModelBytes::triangles ? "" : verified) << what;
  };
  const auto forge = [&](ModelBytes::Section section, std::size_t at, auto value) {
    const std::string what = "byte " + std::to_string(at) + " := " + std::to_string(value);
    expect_refused(section, what.c_str(), [&](ModelBytes& b, std::size_t first) { b.put(first + at, value); });
  };
  using u16 = std::uint16_t;
  using u32 = std::uint32_t;
  using u64 = std::uint64_t;
  for (std::size_t t = 0; t < 3; ++t)
    for (std::size_t corner = 0; corner < 3; ++corner) forge(ModelBytes::triangles, 6 * t + 2 * corner, u16{5});
  for (const u16 v : {u16{0}, u16{1}, u16{2}, u16{3}, u16{4}, u16{5}}) {
    forge(ModelBytes::ecol, 2 * std::size_t{v}, v);
    if (v == 0 || v == 1 || v == 5) forge(ModelBytes::ecol, 2 * std::size_t{v}, u16{0});
    if (v >= 2 && v < 5) forge(ModelBytes::ecol, 2 * std::size_t{v}, none);
  }
  forge(ModelBytes::map, 4, u32{0});   // falls from 1 to 0
  forge(ModelBytes::map, 0, u32{2});   // falls from 2 to 1
  forge(ModelBytes::map, 8, u32{4});   // falls from 4 to 3
  forge(ModelBytes::map, 12, u32{2});  // a triangle too few
  forge(ModelBytes::map, 12, u32{4});  // and too many
  expect_refused(
      ModelBytes::map, "a triangle of no vertex", [&](ModelBytes& b, std::size_t first) { b.put(first + 16, u32{1}); },
      false);
  forge(ModelBytes::map, 20, u32{1});  // not there
  const std::pair<std::size_t, float> wrong_errors[] = {
      {0, nan}, {0, 1.5f}, {0, -infinity}, {1, nan}, {2, nan},        {2, 2.1f}, {2, -1.0f},
      {3, nan}, {3, 3.0f}, {3, -1e-40f},   {4, nan}, {4, -0x1p-149f}, {5, nan},  {5, -infinity}};
  for (const auto& [k, value] : wrong_errors) {
    const std::string what = "error " + std::to_string(k) + " := " + std::to_string(value);
    expect_refused(
        ModelBytes::errors, what.c_str(),
        [k = k, value = value](ModelBytes& b, std::size_t first) { b.put(first + 4 * k, value); }, false);
  }
  forge(ModelBytes::objects, 0, u32{3});
  forge(ModelBytes::objects, 52 * 3, u32{0xffffffff});
  for (const float value : {1.0000001f, -0.0000001f, std::numeric_limits<float>::quiet_NaN()})
    for (const std::size_t m : {0u, 1u, 2u}) {
      expect_refused(ModelBytes::compactness, "compactness",
                     [&](ModelBytes& b, std::size_t first) { b.put(first + 4 * m, value); });
      expect_refused(ModelBytes::faces, "compactness of a face",
                     [&](ModelBytes& b, std::size_t first) { b.put(first + 28 * m + 24, value); });
    }
  forge(ModelBytes::compactness_order, 4, u32{0});   // twice
  forge(ModelBytes::compactness_order, 12, u32{4});  // no object
  expect_refused(ModelBytes::compactness_order, "a tie the other way round", [&](ModelBytes& b, std::size_t first) {
    b.put(first, u32{3});
    b.put(first + 4, u32{0});
  });
  expect_refused(ModelBytes::compactness_order, "by number", [&](ModelBytes& b, std::size_t first) {
    b.put(first + 8, u32{1});
    b.put(first + 12, u32{2});
  });
  for (std::size_t m = 0; m < 3; ++m)
    for (std::size_t field = 0; field < 3; ++field)
      for (const u64 change : {u64{1}, ~u64{0}, u64{1} << 32, u64{1} << 63}) {
        const std::size_t at = 32 * m + 8 * field;
        const u64 value = good.get<u64>(good.first_byte(ModelBytes::meshes) + at) + change;
        // Where the triangles of the third mesh begin is said by the maps alone.
        if (field == 1 && (m == 1 || m == 2) && value < 4) {
          ModelBytes b = good;
          b.put(b.first_byte(ModelBytes::meshes) + at, value);
          b.seal();
          EXPECT_NE(error_of([&] { ModelFile(folder.write("t.pgl", b.bytes)).verify(); }), "");
        } else {
          forge(ModelBytes::meshes, at, value);
        }
      }
  for (std::size_t m = 0; m < 3; ++m)
    for (std::size_t field = 0; field < 2; ++field)
      for (const u32 change : {1u, ~0u, 1u << 31}) {
        const std::size_t at = 32 * m + 24 + 4 * field;
        forge(ModelBytes::meshes, at, good.get<u32>(good.first_byte(ModelBytes::meshes) + at) + change);
      }
  expect_refused(
      ModelBytes::map, "triangles of a mesh of no vertices",
      [&](ModelBytes& b, std::size_t first) {
        b.put(b.first_byte(ModelBytes::meshes) + 32 + 8, u64{2});
        b.put(first + 12, u32{2});
        b.put(first + 16, u32{1});
      },
      false);
  for (const u64 count : {1, 5, 7}) {
    ModelBytes b = good;
    b.put(ModelBytes::entry(ModelBytes::errors) + 16, count);
    b.seal();
    EXPECT_NE(opening_error(folder.write("t.pgl", b.bytes)).find("section 'errors'"), std::string::npos) << count;
  }
  expect_refused(ModelBytes::meshes, "a mesh that has vertices may be of none", [&](ModelBytes& b, std::size_t first) {
    b.put(first + 64 + 24, u32{0});  // the third mesh is of 0 to 1 vertices, with 2 map entries
    b.put(ModelBytes::entry(ModelBytes::map) + 16, u64{7});
    b.put(ModelBytes::entry(ModelBytes::errors) + 16, u64{7});
  });
}

TEST(ModelFile, RefusesTrianglesAndVerticesThatNoMeshOwns) {
  const TemporaryFolder folder;
  write_model(folder.path() / "m.pgl", Model<Index16>{});
  for (const std::size_t s : {ModelBytes::map, ModelBytes::triangles, ModelBytes::vertices}) {
    // A page for the section, and one for its checksum.
    pgl::scene::format::Counts counts{};
    counts[s] = 1;
    if (s == ModelBytes::vertices) counts[ModelBytes::ecol] = 1;
    const auto layout = pgl::scene::format::layout_of(counts, false);
    ModelBytes bytes(support::read_bytes(folder.path() / "m.pgl"));
    bytes.bytes.resize(layout->file_bytes);
    for (std::size_t k = 0; k < ModelBytes::sections; ++k) {
      bytes.put(ModelBytes::entry(k) + 8, layout->first_byte[k]);
      bytes.put(ModelBytes::entry(k) + 16, layout->count[k]);
    }
    bytes.put(24, layout->file_bytes);
    bytes.seal();
    ModelFile file(folder.write("t.pgl", bytes.bytes));
    EXPECT_NE(error_of([&] { (void)file.view<Index16>(); }).find("that no mesh owns"), std::string::npos);
  }
}

TEST(ModelFile, SixteenBitsNameAtMost65536Vertices) {
  const TemporaryFolder folder;
  for (const std::uint32_t vertices : {65'536u, 65'537u}) {
    Model<Index16> model;
    model.meshes = {{0, 0, 0, vertices, vertices}};
    model.vertices.resize(vertices);
    model.ecol.assign(vertices, pgl::no_target<Index16>);
    model.map = {0};
    model.mesh_boxes.resize(1);
    model.oriented_boxes.resize(1);
    model.compactness.resize(1);
    write_model(folder.path() / "m.pgl", model);
    EXPECT_EQ(error_of([&] { ModelFile(folder.path() / "m.pgl").verify(); }).empty(), vertices == 65'536);
  }
}

TEST(ModelFile, WhatLiesBetweenSectionsIsZeroOrTheFileIsDamaged) {
  const TemporaryFolder folder;
  std::mt19937 random(34);
  write_model(folder.path() / "m.pgl", random_model<Index16>(random, {}));
  const ModelBytes good(support::read_bytes(folder.path() / "m.pgl"));
  for (std::size_t s = 0; s < ModelBytes::checksums; ++s)
    for (const std::size_t at : {good.end_byte(s), good.end_byte(s) / 4096 * 4096 + 4095}) {
      ASSERT_NE(good.end_byte(s) % 4096, 0u);
      ModelBytes bytes = good;
      bytes.bytes[at] = 1;
      bytes.seal();
      const std::string error = error_of([&] { ModelFile(folder.write("t.pgl", bytes.bytes)).verify(); });
      const std::string expected =
          std::string(pgl::scene::format::section_names[s]).append("': there is something after");
      EXPECT_NE(error.find(expected), std::string::npos) << error;
    }
  // After the last checksum too, which only the header's can be right about.
  ModelBytes bytes = good;
  const std::size_t last = good.first_byte(ModelBytes::checksums);
  bytes.bytes[last + 4095] = 1;
  bytes.put(32, bytes.checksum_of_page(last / 4096));
  bytes.seal_header();
  EXPECT_NE(error_of([&] { ModelFile(folder.write("t.pgl", bytes.bytes)).verify(); }), "");
}

TEST(ModelFile, VerifyLooksAgainAtWhatHasBeenChecked) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(35);
  const auto model = random_model<Index16>(random, {});
  write_model(path, model);
  const ModelBytes bytes(support::read_bytes(path));
  for (const std::size_t at : {std::size_t{60}, std::size_t{4097}, bytes.first_byte(ModelBytes::map) + 4,
                               bytes.first_byte(ModelBytes::vertices) + 5, bytes.bytes.size() - 1}) {
    ModelFile file(folder.write("t.pgl", bytes.bytes));
    file.require(full_counts(file.view<Index16>()));
    file.verify();
    ModelBytes other = bytes;
    other.bytes[at] ^= 8;
    const int descriptor = open((folder.path() / "t.pgl").c_str(), O_WRONLY | O_CLOEXEC);
    ASSERT_EQ(pwrite(descriptor, &other.bytes[at], 1, static_cast<off_t>(at)), 1);
    close(descriptor);
    EXPECT_THROW(file.verify(), Error) << at;
  }
}

TEST(ModelFile, NoLayoutIsLargerThanItsNumbersCanSay) {
  constexpr std::uint64_t huge = std::numeric_limits<std::uint64_t>::max();
  for (const bool wide : {false, true})
    for (std::uint32_t s = 0; s < pgl::scene::format::checksums; ++s) {
      const std::uint64_t size = pgl::scene::format::element_bytes(s, wide);
      for (const std::uint64_t count : {huge, huge / size, huge / size + 2, (huge >> 2) / size + 2, huge / 2}) {
        pgl::scene::format::Counts counts{};
        counts[s] = count;
        EXPECT_FALSE(pgl::scene::format::layout_of(counts, wide)) << s << " " << count;
      }
    }
}

TEST(ModelFile, AFileOfHugeHolesIsRefusedWithoutBeingRead) {
  // Counts and length agree, and say that there are exabytes, or just more than anyone has.
  const TemporaryFolder folder;
  std::mt19937 random(33);
  write_model(folder.path() / "m.pgl", Model<Index16>{});
  int tried = 0;
  for (const std::uint64_t vertices : {std::uint64_t{1} << 38, std::uint64_t{1} << 58}) {
    pgl::scene::format::Counts counts{};
    counts[pgl::scene::format::ecol] = counts[pgl::scene::format::vertices] = vertices;
    const auto layout = pgl::scene::format::layout_of(counts, false);
    ASSERT_TRUE(layout);
    ModelBytes bytes(support::read_bytes(folder.path() / "m.pgl"));
    for (std::size_t s = 0; s < ModelBytes::sections; ++s) {
      bytes.put(ModelBytes::entry(s) + 8, layout->first_byte[s]);
      bytes.put(ModelBytes::entry(s) + 16, layout->count[s]);
    }
    bytes.put(24, layout->file_bytes);
    bytes.seal_header();
    const fs::path path = folder.write("t.pgl", bytes.bytes);
    if (truncate(path.c_str(), static_cast<off_t>(layout->file_bytes)) != 0) continue;  // no such file system
    ++tried;
    std::optional<ModelFile> file;
    const std::string error = error_of([&] {
      file.emplace(path);
      (void)file->view<Index16>();
    });
    EXPECT_NE(error, "");
    if (file) {
      EXPECT_LT(file->bytes_verified(), std::uint64_t{1} << 20);
    }
  }
  if (tried == 0) GTEST_SKIP() << "no file may be so long here: holes are NOT tried";
}

// ---- a file that shrinks --------------------------------------------------------------------------------------------

class Shrinking : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(ModelFile, Shrinking, testing::Values(0, 1, 2, 3, 4));

TEST_P(Shrinking, IsAnErrorWheneverItHappens) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(40);
  const auto model = random_model<Index16>(random, {.meshes = 50, .objects = 80, .vertices = 2000});
  for (const std::uint64_t length :
       {std::uint64_t{0}, std::uint64_t{1}, std::uint64_t{4096}, std::uint64_t{10'000}, std::uint64_t{200'000}}) {
    write_model(path, model);
    ASSERT_LT(length, fs::file_size(path));
    ModelFile file(path);
    const int when = GetParam();
    ModelView<Index16> view;
    if (when >= 1) view = file.view<Index16>();
    const auto full = full_counts(ModelView<Index16>(model));
    if (when >= 2) file.require(random_counts(view, random));
    if (when >= 3) file.require(full);
    if (when >= 4) file.verify();
    file.check();
    ASSERT_EQ(truncate(path.c_str(), static_cast<off_t>(length)), 0);

    const std::string expected = path.string() + ": has become shorter while it was in use";
    EXPECT_EQ(error_of([&] { file.check(); }), expected);
    EXPECT_EQ(error_of([&] { (void)file.view<Index16>(); }), expected);
    EXPECT_EQ(error_of([&] { file.require(full); }), expected);
    EXPECT_EQ(error_of([&] { file.require_map(); }), expected);
    EXPECT_EQ(error_of([&] { file.require_ecol(); }), expected);
    EXPECT_EQ(error_of([&] { file.require_errors(); }), expected);
    EXPECT_EQ(error_of([&] { file.verify(); }), expected);
    file.prefetch(full);
    // Whoever reads on reads zeros, and does not end.
    if (when >= 1) {
      std::uint64_t sum = 0;
      for (const glm::vec3& v : view.vertices.last(20)) sum += v.x != 0.0f;
      EXPECT_EQ(sum, 0u);
      [[maybe_unused]] const volatile std::uint32_t last = view.map.back();
      expect_bytes<pgl::Mesh>(view.meshes, model.meshes, "meshes");
      expect_bytes<pgl::Object>(view.objects, model.objects, "objects");
    }
    // Grown again, it is still not what it was.
    ASSERT_EQ(truncate(path.c_str(), static_cast<off_t>(file.bytes())), 0);
    EXPECT_NE(error_of([&] { file.require(full); }), "");
    fs::remove(path);
  }
}

TEST(ModelFile, AnyThreadMayMeetTheEnd) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "m.pgl";
  std::mt19937 random(41);
  const auto model = random_model<Index16>(random, {.meshes = 50, .objects = 80, .vertices = 2000});
  write_model(path, model);
  ModelFile file(path);
  const auto view = file.view<Index16>();
  file.require(full_counts(view));
  ASSERT_EQ(truncate(path.c_str(), 5000), 0);
  std::vector<std::jthread> threads;
  for (int t = 0; t < 8; ++t)
    threads.emplace_back([&] {
      float sum = 0;
      for (const glm::vec3& v : view.vertices) sum += v.x;
      EXPECT_EQ(sum, 0.0f);
    });
  threads.clear();
  EXPECT_NE(error_of([&] { file.check(); }), "");
}

/// A mapping of one page whose file has no byte any more.
const volatile char* gone_page(const TemporaryFolder& folder) {
  const fs::path path = folder.write("other", std::string(4096, 'x'));
  const int descriptor = open(path.c_str(), O_RDWR);
  void* const data = mmap(nullptr, 4096, PROT_READ, MAP_SHARED, descriptor, 0);
  EXPECT_EQ(ftruncate(descriptor, 0), 0);
  close(descriptor);
  return static_cast<const char*>(data);
}

/// As in the tests themselves, whatever the build type.
TEST(ModelFileDeathTest, PreconditionsAreCheckedInTheLibraryToo) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const TemporaryFolder folder;
  ModelFileWriter writer(folder.path() / "m.pgl");
  EXPECT_DEATH(writer.set_up(static_cast<UpAxis>(4)), "up <= UpAxis::z");
}

TEST(ModelFileDeathTest, FaultsElsewhereGoWhereTheyWentBefore) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");  // a process in which no ModelFile has been
  const TemporaryFolder folder;
  write_model(folder.path() / "m.pgl", plant<Index16>(1));
  EXPECT_EXIT(
      {
        signal(SIGBUS, [](int) { _exit(42); });
        ModelFile file(folder.path() / "m.pgl");
        (void)gone_page(folder)[0];
      },
      testing::ExitedWithCode(42), "");
  EXPECT_EXIT(
      {
        struct sigaction action {};
        action.sa_flags = SA_SIGINFO;
        action.sa_sigaction = [](int, siginfo_t* info, void*) { _exit(info->si_code > 0 ? 43 : 44); };
        sigaction(SIGBUS, &action, nullptr);
        ModelFile file(folder.path() / "m.pgl");
        raise(SIGBUS);
      },
      testing::ExitedWithCode(44), "");
  EXPECT_EXIT(
      {
        signal(SIGBUS, SIG_DFL);
        ModelFile file(folder.path() / "m.pgl");
        (void)gone_page(folder)[0];
      },
      testing::KilledBySignal(SIGBUS), "");
  EXPECT_EXIT(
      {
        signal(SIGBUS, SIG_DFL);
        ModelFile file(folder.path() / "m.pgl");
        raise(SIGBUS);
        _exit(46);
      },
      testing::KilledBySignal(SIGBUS), "");
  EXPECT_EXIT(
      {
        signal(SIGBUS, SIG_IGN);
        ModelFile file(folder.path() / "m.pgl");
        raise(SIGBUS);
        _exit(45);
      },
      testing::ExitedWithCode(45), "");
}

}  // namespace
