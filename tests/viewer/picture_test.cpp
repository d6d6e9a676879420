// SPDX-License-Identifier: MIT
// A picture that is drawn in tiles, and brought together from those of several ranks, is the picture drawn at once.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "pgl/balance.hpp"
#include "pgl/gather.hpp"
#include "pgl/project.hpp"
#include "pgl/types.hpp"
#include "viewer/camera.hpp"
#include "viewer/context.hpp"
#include "viewer/cuda_picture.hpp"
#include "viewer/mpirun.hpp"
#include "viewer/output.hpp"
#include "viewer/picture_exchange.hpp"
#include "viewer/ranks.hpp"
#include "viewer/renderer.hpp"

namespace {

using namespace pgl::viewer;
using pgl::PlacedVertex;
using pgl::Tile;
using Triangle = pgl::Triangle<std::uint32_t>;
using Random = std::mt19937;

/// The same on every machine, unlike the distributions of the library.
std::uint32_t below(Random& random, std::uint32_t end) {
  return static_cast<std::uint32_t>(random() % end);
}
float unit(Random& random) {
  return static_cast<float>(random()) / 4294967296.0f * 2.0f - 1.0f;
}

/// Triangles of all sizes about an eye in their midst: many reach across borders of tiles, some through the near plane.
struct Scene {
  explicit Scene(std::uint32_t seed) {
    Random random(seed);
    for (std::uint32_t i = 0; i < 300; ++i) {
      const float size = i % 50 == 0 ? 1.5f : i % 3 == 0 ? 0.4f : 0.05f;
      const glm::vec3 middle(unit(random), unit(random), unit(random));
      const auto first = static_cast<std::uint32_t>(vertices.size());
      for (int corner = 0; corner < 3; ++corner) {
        const glm::vec3 offset(unit(random), unit(random), unit(random));
        vertices.push_back({middle + size * offset, i});
      }
      triangles.push_back({first, first + 1, first + 2});
    }
    camera.eye = {0.3 * unit(random), 0.3 * unit(random), 0.6};
    camera.target = {0.0, 0.0, -0.2};
    camera.fov_degrees = 75.0;
  }
  pgl::View view(int width, int height) const {
    return view_of(camera, {glm::vec3(-1.0f), glm::vec3(1.0f)}, width, height);
  }
  /// The triangles that a rank would keep for a tile.
  std::vector<Triangle> in_tile(const Tile& tile, const pgl::View& seen) const {
    std::vector<Triangle> kept;
    for (const Triangle& triangle : triangles) {
      pgl::Box box;
      for (const std::uint32_t vertex : triangle.v) {
        box.min = glm::min(box.min, vertices[vertex].position);
        box.max = glm::max(box.max, vertices[vertex].position);
      }
      if (pgl::is_in_tile(pgl::project(box, seen), 1, tile)) kept.push_back(triangle);
    }
    return kept;
  }
  std::vector<PlacedVertex> vertices;
  std::vector<Triangle> triangles;
  Camera camera;
};

/// So many tiles that share a picture out, cut anywhere; some are empty.
std::vector<Tile> cut(Random& random, int width, int height, std::size_t count) {
  std::vector<Tile> tiles = {whole(width, height)};
  while (tiles.size() < count) {
    Tile& left = tiles[below(random, static_cast<std::uint32_t>(tiles.size()))];
    Tile right = left;
    if (random() % 2 == 0) {
      left.x1 = right.x0 = left.x0 + below(random, left.x1 - left.x0 + 1);
    } else {
      left.y1 = right.y0 = left.y0 + below(random, left.y1 - left.y0 + 1);
    }
    tiles.push_back(right);
  }
  std::shuffle(tiles.begin(), tiles.end(), random);
  return tiles;
}

std::size_t bytes_of(const Tile& tile) {
  return std::size_t{4} * (tile.x1 - tile.x0) * (tile.y1 - tile.y0);
}

std::size_t colors(const Image& image) {
  std::set<std::array<std::uint8_t, 3>> all;
  for (std::size_t at = 0; at < image.rgb.size(); at += 3) {
    all.insert({image.rgb[at], image.rgb[at + 1], image.rgb[at + 2]});
  }
  return all.size();
}

/// How many pixels of two pictures differ.
std::size_t differing(const Image& a, const Image& b) {
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  if (a.rgb.size() != b.rgb.size()) return a.rgb.size();
  std::size_t count = 0;
  for (std::size_t at = 0; at < a.rgb.size(); at += 3) {
    count += std::equal(&a.rgb[at], &a.rgb[at] + 3, &b.rgb[at]) ? 0u : 1u;
  }
  return count;
}

/// A part of an image; row 0 of tiles is the lowest, that of images the highest.
Image part_of(const Image& image, const Tile& tile) {
  Image part{static_cast<int>(tile.x1 - tile.x0), static_cast<int>(tile.y1 - tile.y0), {}};
  for (std::uint32_t y = tile.y1; y-- > tile.y0;) {
    const std::size_t row = static_cast<std::size_t>(image.height) - 1 - y;
    const auto begin =
        image.rgb.begin() + static_cast<std::ptrdiff_t>((row * static_cast<std::size_t>(image.width) + tile.x0) * 3);
    part.rgb.insert(part.rgb.end(), begin, begin + 3 * static_cast<std::ptrdiff_t>(part.width));
  }
  return part;
}

/// What stands in for CUDA here: memory that processes share, and a renderer that reads and writes the texture. With it
/// the exchange is tried without a GPU; the tests of the viewer try CUDA itself.
struct Fake {
  Renderer* renderer = nullptr;
  int rank = 0;
  int failing_rank = -1;
  enum class Fails { taking_or_opening, copying } fails = Fails::taking_or_opening;
  std::size_t copies = 0;
} fake;

void fail_if(Fake::Fails what) {
  if (fake.rank == fake.failing_rank && fake.fails == what) throw std::runtime_error("as the test wants it");
}

class FakePicture final : public CudaPicture {
 public:
  explicit FakePicture(std::uint64_t pixels) : takes_(true), size_(sizeof(Shared) + 4 * pixels) {
    static int number = 0;
    const std::string name = "/pgl_picture_test." + std::to_string(getpid()) + "." + std::to_string(++number);
    std::copy_n(name.c_str(), name.size() + 1, name_.begin());
    map(O_CREAT | O_EXCL | O_RDWR);
    shared_->size = size_;
  }
  explicit FakePicture(const SharedMemory& memory) : takes_(false), size_(sizeof(Shared)) {
    std::memcpy(name_.data(), memory.data(), name_.size());
    map(O_RDWR);
    const std::size_t size = shared_->size;
    munmap(shared_, size_);
    size_ = size;
    map(O_RDWR);
    ++shared_->opened;
  }
  ~FakePicture() override {
    if (takes_) {
      EXPECT_EQ(shared_->opened, 0) << "freed while others have it open";
      shm_unlink(name_.data());
    } else {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));  // so that who does not wait for it is seen
      --shared_->opened;
    }
    munmap(shared_, size_);
  }
  SharedMemory memory() const override {
    SharedMemory memory;
    std::memcpy(memory.data(), name_.data(), name_.size());
    return memory;
  }
  void put(const PlacedTile& placed) override {
    fail_if(Fake::Fails::copying);
    fake.renderer->read_tile(placed.tile, bytes(placed));
    ++fake.copies;
  }
  void take(std::span<const PlacedTile> tiles) override {
    EXPECT_TRUE(takes_);
    for (const PlacedTile& placed : tiles) fake.renderer->write_tile(placed.tile, bytes(placed));
    fake.copies += tiles.size();
  }

 private:
  struct Shared {
    std::size_t size;
    std::atomic<int> opened;
  };
  void map(int flags) {
    const int file = shm_open(name_.data(), flags, 0600);
    if (file < 0 || (takes_ && ftruncate(file, static_cast<off_t>(size_)) != 0)) throw std::runtime_error("no memory");
    void* data = mmap(nullptr, size_, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (data == MAP_FAILED) throw std::runtime_error("no memory");
    shared_ = static_cast<Shared*>(data);
  }
  std::span<std::byte> bytes(const PlacedTile& placed) {
    const std::size_t begin = sizeof(Shared) + 4 * placed.pixel;
    EXPECT_LE(begin + bytes_of(placed.tile), size_);
    return {reinterpret_cast<std::byte*>(shared_) + begin, bytes_of(placed.tile)};
  }

  bool takes_;
  std::size_t size_;
  std::array<char, std::tuple_size_v<SharedMemory>> name_{};
  Shared* shared_ = nullptr;
};

}  // namespace

std::unique_ptr<CudaPicture> pgl::viewer::take_cuda_picture(unsigned texture, const std::string&,
                                                            std::uint64_t pixels) {
  EXPECT_EQ(texture, fake.renderer->picture());
  fail_if(Fake::Fails::taking_or_opening);
  return std::make_unique<FakePicture>(pixels);
}
std::unique_ptr<CudaPicture> pgl::viewer::open_cuda_picture(unsigned texture, const std::string&,
                                                            const SharedMemory& memory) {
  EXPECT_EQ(texture, fake.renderer->picture());
  fail_if(Fake::Fails::taking_or_opening);
  return std::make_unique<FakePicture>(memory);
}

namespace {

class Pictures : public testing::Test {
 protected:
  void SetUp() override {
    try {
      context_ = std::make_unique<OffscreenContext>();
    } catch (const NoContext& error) {
      GTEST_SKIP() << "tiles are NOT drawn: " << error.what();
    }
    renderer_ = std::make_unique<Renderer>();
  }

  void draw(const Scene& scene, int width, int height, bool wireframe, const std::optional<Tile>& tile = {}) {
    renderer_->draw(scene.view(width, height), scene.camera, 3.0, wireframe, true, tile);
  }
  Image picture_of(const Scene& scene, int width, int height, bool wireframe) {
    renderer_->buffers().upload(scene.vertices, scene.triangles);
    draw(scene, width, height, wireframe);
    return renderer_->read(width, height);
  }

  std::unique_ptr<OffscreenContext> context_;
  std::unique_ptr<Renderer> renderer_;  // gone before the context
};

struct Size {
  int width, height;
};
constexpr std::array<Size, 4> sizes = {{{97, 61}, {130, 64}, {33, 200}, {320, 180}}};

// As each rank does it: in its own tile, over what was there before, with the triangles that touch the tile alone.
TEST_F(Pictures, TilesMakeTheSamePictureAsAllAtOnce) {
  for (const int samples : {1, 4}) {
    for (const auto& [width, height] : sizes) {
      renderer_->draw_offscreen(width, height, samples);
      std::size_t most_colors = 0;
      for (std::uint32_t seed = 0; seed < 8; ++seed) {
        const bool wireframe = seed % 2 == 1, only_touching = seed % 4 >= 2;
        SCOPED_TRACE(std::to_string(samples) + " samples, " + std::to_string(width) + "x" + std::to_string(height) +
                     ", seed " + std::to_string(seed));
        const Scene scene(seed), other(seed + 100);
        const Image at_once = picture_of(scene, width, height, wireframe);
        most_colors = std::max(most_colors, colors(at_once));
        EXPECT_GT(differing(at_once, picture_of(other, width, height, wireframe)), 100u);  // and is in the picture now

        Random random(seed);
        const pgl::View view = scene.view(width, height);
        std::size_t left_out = 0;
        for (const Tile& tile : cut(random, width, height, 1 + 3 * seed)) {
          renderer_->buffers().upload(other.vertices, other.triangles);
          draw(other, width, height, wireframe);
          const std::vector<Triangle> triangles = only_touching ? scene.in_tile(tile, view) : scene.triangles;
          left_out += scene.triangles.size() - triangles.size();
          renderer_->buffers().upload(scene.vertices, triangles);
          draw(scene, width, height, wireframe, tile);
          renderer_->resolve(tile);
        }
        EXPECT_EQ(left_out > 0, only_touching);
        EXPECT_EQ(differing(renderer_->read_picture(whole(width, height)), at_once), 0u);
      }
      EXPECT_GT(most_colors, 300u);
    }
  }
}

TEST_F(Pictures, ResolvingATileLeavesTheRestOfThePictureAlone) {
  constexpr int width = 97, height = 61;
  const Scene scene(1), other(2);
  const Tile tile{13, 7, 60, 44};
  for (const int samples : {1, 4}) {
    SCOPED_TRACE(samples);
    renderer_->draw_offscreen(width, height, samples);
    const Image all = picture_of(scene, width, height, false), inside = part_of(all, tile);
    const Image before = picture_of(other, width, height, false);
    renderer_->buffers().upload(scene.vertices, scene.triangles);
    draw(scene, width, height, false, tile);
    EXPECT_EQ(differing(renderer_->read_picture(whole(width, height)), before), 0u) << "drawing is not resolving";
    renderer_->resolve(tile);
    const Image after = renderer_->read_picture(whole(width, height));
    EXPECT_EQ(differing(part_of(after, tile), inside), 0u);
    EXPECT_EQ(differing(after, before), differing(part_of(before, tile), inside));
    if (samples == 1) {  // with more, what was drawn beside the tile means nothing
      EXPECT_EQ(differing(renderer_->read(width, height), after), 0u) << "drawn outside the tile";
    }

    draw(scene, width, height, false);  // not in the tile any more
    EXPECT_EQ(differing(renderer_->read(width, height), all), 0u);
  }
}

TEST_F(Pictures, TilesAreReadAndWrittenAsBytesTheLowestRowFirst) {
  constexpr int width = 61, height = 37;
  renderer_->draw_offscreen(width, height, 1);
  const Tile all = whole(width, height);
  std::vector<std::byte> bytes(bytes_of(all)), read(bytes.size());
  Random random(7);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random());
  renderer_->write_tile(all, bytes);
  renderer_->read_tile(all, read);
  EXPECT_EQ(read, bytes);

  const Image image = renderer_->read_picture(all);
  for (std::size_t i = 0; i < bytes.size() / 4; ++i) {
    const std::size_t x = i % width, y = height - 1 - i / width;
    ASSERT_EQ(std::memcmp(&image.rgb[(y * width + x) * 3], &bytes[i * 4], 3), 0) << "pixel " << i;
  }
  for (int round = 0; round < 50; ++round) {
    Tile tile{below(random, width), below(random, height), 0, 0};
    tile.x1 = tile.x0 + 1 + below(random, width - tile.x0);
    tile.y1 = tile.y0 + 1 + below(random, height - tile.y0);
    const std::size_t row = std::size_t{4} * (tile.x1 - tile.x0);
    std::vector<std::byte> part(bytes_of(tile)), got(part.size());
    for (std::byte& byte : part) byte = static_cast<std::byte>(random());
    renderer_->write_tile(tile, part);
    renderer_->read_tile(tile, got);
    EXPECT_EQ(got, part);
    for (std::uint32_t y = tile.y0; y < tile.y1; ++y) {
      std::memcpy(&bytes[(y * std::size_t{width} + tile.x0) * 4], &part[(y - tile.y0) * row], row);
    }
    renderer_->read_tile(all, read);
    ASSERT_EQ(read, bytes) << "round " << round;
    EXPECT_EQ(differing(renderer_->read_picture(tile), part_of(renderer_->read_picture(all), tile)), 0u);
  }
}

TEST_F(Pictures, ASizeBeyondTheDriversIsRefused) {
  try {
    renderer_->draw_offscreen(1 << 20, 8, 1);
    FAIL() << "a million pixels wide";
  } catch (const std::runtime_error& error) {
    EXPECT_TRUE(std::string(error.what()).starts_with("--size: 1048576x8 is larger than this driver's "))
        << error.what();
  }
}

// Alone, or under mpirun with the others: rank 0's picture is what one rank draws, whichever way the tiles come. The
// only case with ranks, since a process joins the others once.
TEST_F(Pictures, TheTilesOfAllRanksComeTogether) {
  struct Way {
    bool cuda;
    int failing_rank;
    Fake::Fails fails;
    const char* how;
    const char* note;  // on rank 0
  };
  constexpr const char* refused = " cannot share memory of the GPU: as the test wants it";
  const std::array<Way, 5> ways = {{{false, -1, {}, "MPI", ""},
                                    {true, -1, {}, "CUDA IPC", ""},
                                    {true, 0, Fake::Fails::taking_or_opening, "MPI", "rank 0"},
                                    {true, 1, Fake::Fails::taking_or_opening, "MPI", "rank 1"},
                                    {true, 1, Fake::Fails::copying, "MPI", "rank 1"}}};
  Ranks ranks(60.0);
  const bool alone = ranks.size() == 1;
  const auto rank = static_cast<std::size_t>(ranks.rank());
  std::uint32_t seed = 0;
  for (const auto& [width, height] : sizes) {
    for (const Way& way : ways) {
      fake = {renderer_.get(), ranks.rank(), way.failing_rank, way.fails, 0};
      renderer_->draw_offscreen(width, height, 4);
      PictureExchange exchange(ranks, *renderer_, width, height, way.cuda);
      EXPECT_STREQ(exchange.how(), alone ? "alone" : way.how);
      const bool noted = !alone && rank == 0 && way.failing_rank >= 0;
      EXPECT_EQ(exchange.note(),
                noted ? "the tiles come through MPI, since " + std::string(way.note) + refused : std::string());
      fake.copies = 0;
      for (int frame = 0; frame < 5; ++frame) {
        ranks.broadcast(seed);
        const Scene scene(seed);
        const Image at_once = picture_of(scene, width, height, false);
        (void)picture_of(Scene(seed + 100), width, height, false);  // and is in the picture now

        Random random(seed);
        std::vector<Tile> tiles = cut(random, width, height, static_cast<std::size_t>(ranks.size()));
        if (frame == 0) {  // all to one
          std::ranges::fill(tiles, Tile{});
          tiles[seed % tiles.size()] = whole(width, height);
        }
        renderer_->buffers().upload(scene.vertices, scene.in_tile(tiles[rank], scene.view(width, height)));
        draw(scene, width, height, false, tiles[rank]);
        exchange.exchange(tiles);
        const Image picture = renderer_->read_picture(whole(width, height));
        if (rank == 0) {
          EXPECT_EQ(differing(picture, at_once), 0u) << "seed " << seed;
        } else {
          EXPECT_EQ(differing(part_of(picture, tiles[rank]), part_of(at_once, tiles[rank])), 0u) << "seed " << seed;
        }
        ++seed;
      }
      EXPECT_EQ(fake.copies > 0, !alone && std::string(way.how) == "CUDA IPC");
    }
  }
  ranks.agree(HasFailure() ? "not the picture" : "");
}

TEST_F(Pictures, TheTilesOfSeveralRanksComeTogether) {
#if defined(PGL_VIEWER_MPI)
  for (const int ranks : {2, 3, 5}) {
    const std::string line = viewer_tests::mpirun(ranks) +
                             " '" PGL_PICTURE_TEST "' --gtest_filter=Pictures.TheTilesOfAllRanksComeTogether 2>&1";
    FILE* pipe = popen(line.c_str(), "r");
    ASSERT_NE(pipe, nullptr);
    std::string said;
    for (int c; (c = std::fgetc(pipe)) != EOF;) said += static_cast<char>(c);
    EXPECT_EQ(pclose(pipe), 0) << ranks << " ranks: " << said;
  }
#else
  GTEST_SKIP() << "MPI was not found: tiles of several ranks are NOT tested";
#endif
}

}  // namespace
