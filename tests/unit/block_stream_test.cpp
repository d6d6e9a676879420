// SPDX-License-Identifier: MIT
// BlockStream on the CPU: after any sequence of selections the blocks are fresh copies, and nothing is sent twice.
#include "pgl/host/block_stream.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <span>
#include <vector>

#include "support/streamed_model.hpp"

namespace {

using test::StreamedFrame;
using test::StreamedModel;
using Stream = pgl::host::BlockStream<StreamedFrame::Vertex, std::uint16_t>;

template <class T>
std::vector<T> first(std::span<const T> block, std::size_t size) {
  return {block.begin(), block.begin() + static_cast<std::ptrdiff_t>(size)};
}

pgl::DeltaSize run(Stream& stream, const StreamedModel& model, const StreamedFrame& frame) {
  stream.begin(model.counts, frame.vertex_offsets, frame.triangle_offsets);
  const pgl::DeltaSize sent = stream.send(model.meshes, model.objects, model.elements, model.triangles);
  stream.apply();
  return sent;
}

TEST(BlockStream, HoldsAFreshCopyOfEverySelectionAndSendsOnlyWhatIsNew) {
  std::mt19937 random(7);
  std::uint64_t all_sent = 0, frames = 0;
  for (int scene = 0; scene < 60; ++scene) {
    const auto shape = static_cast<test::ModelShape>(scene % test::model_shapes);
    StreamedModel model(random, shape, 1 + static_cast<std::uint32_t>(random() % 200));
    Stream stream;
    stream.reserve(model.objects.size(), model.most_vertices(), model.most_triangles());
    EXPECT_TRUE(std::ranges::all_of(stream.counts(), [](std::uint32_t count) { return count == 0; }));
    for (int step = 0; step < 40; ++step) {
      const std::vector<std::uint32_t> before = model.counts;
      model.go(random, static_cast<test::Step>(random() % test::steps));
      const StreamedFrame frame = model.frame(before);
      const pgl::DeltaSize sent = run(stream, model, frame);
      ASSERT_EQ(sent.vertices, frame.new_vertices);
      ASSERT_EQ(sent.triangles, frame.new_triangles);
      ASSERT_EQ(sent.bytes, 12 * sent.vertices + 6 * sent.triangles);
      ASSERT_EQ(first(stream.vertices(), frame.vertices.size()), frame.vertices);
      ASSERT_EQ(first(stream.triangles(), frame.triangles.size()), frame.triangles);
      ASSERT_TRUE(std::ranges::equal(stream.counts(), model.counts));
      ASSERT_TRUE(std::ranges::equal(stream.vertex_offsets(), frame.vertex_offsets));
      ASSERT_TRUE(std::ranges::equal(stream.triangle_offsets(), frame.triangle_offsets));
      all_sent += sent.vertices;
      ++frames;
    }
  }
  EXPECT_GT(all_sent, frames);  // frames that send nothing would show nothing
}

TEST(BlockStream, StartsAnewAfterReserve) {
  std::mt19937 random(3);
  StreamedModel model(random, test::ModelShape::even, 50);
  Stream stream;
  stream.reserve(model.objects.size(), model.most_vertices(), model.most_triangles());
  model.go(random, test::Step::everything);
  run(stream, model, model.frame(std::vector<std::uint32_t>(model.counts.size(), 0)));

  const std::uint64_t room = model.most_vertices() + 10;
  stream.reserve(model.objects.size(), room, model.most_triangles());
  const StreamedFrame frame = model.frame(std::vector<std::uint32_t>(model.counts.size(), 0));
  EXPECT_EQ(run(stream, model, frame).vertices, model.most_vertices());
  EXPECT_EQ(stream.vertices().size(), room);
  EXPECT_EQ(first(stream.vertices(), frame.vertices.size()), frame.vertices);
}

TEST(BlockStream, ChecksRoomAndOrderInDebugBuilds) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  Stream stream;
  stream.reserve(1, 2, 1);
  const std::vector<std::uint32_t> counts{2};
  const std::vector<std::uint64_t> sums{0, 2}, none{0, 0}, many{0, 3};
  EXPECT_DEATH(stream.begin({}, sums, none), "counts.size");
  EXPECT_DEATH(stream.begin(counts, sums, std::vector<std::uint64_t>{0}), "triangle_offsets.size");
  EXPECT_DEATH(stream.begin(counts, many, none), "vertices_.size");
  EXPECT_DEATH(stream.begin(counts, sums, sums), "triangles_.size");
  EXPECT_DEATH(stream.apply(), "next_step_");
  EXPECT_DEATH((void)stream.send({}, {}, {}, {}), "next_step_");
  stream.begin(counts, sums, none);
  EXPECT_DEATH(stream.begin(counts, sums, none), "next_step_");
  EXPECT_DEATH(stream.apply(), "next_step_");
}

TEST(BlockStream, TakesASceneOfNoObjects) {
  Stream stream;
  stream.reserve(0, 0, 0);
  stream.begin({}, std::vector<std::uint64_t>{0}, std::vector<std::uint64_t>{0});
  EXPECT_EQ(stream.send({}, {}, {}, {}), pgl::DeltaSize{});
  stream.apply();
  EXPECT_EQ(stream.counts().size(), 0u);
}

}  // namespace
