// SPDX-License-Identifier: MIT
// BlockStream on the GPU: the same blocks as on the CPU after any sequence of selections, however streams overlap.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "pgl/cuda/block_stream.cuh"
#include "support/streamed_model.hpp"
#include "twin/device.cuh"

namespace {

using pgl::test::DeviceArray;
using pgl::test::must;
using test::StreamedFrame;
using test::StreamedModel;
using Stream = pgl::cuda::BlockStream<StreamedFrame::Vertex, std::uint16_t>;

/// Copies as much of a source on the device as there is room for.
template <class T>
void copy(const DeviceArray<T>& to, std::span<const T> from, cudaStream_t stream) {
  ASSERT_LE(to.view().size(), from.size());
  must(cudaMemcpyAsync(to.data(), from.data(), to.view().size_bytes(), cudaMemcpyDeviceToDevice, stream));
}

/// One frame: its selection on the device, and room for the copies that the stream which draws makes: of the blocks,
/// and of the selection as the BlockStream has it.
struct Step {
  std::vector<std::uint32_t> counts_on_host;
  StreamedFrame frame;
  DeviceArray<std::uint32_t> counts;
  DeviceArray<std::uint64_t> vertex_offsets, triangle_offsets;
  DeviceArray<std::uint32_t> drawn_counts;
  DeviceArray<std::uint64_t> drawn_vertex_offsets, drawn_triangle_offsets;
  DeviceArray<StreamedFrame::Vertex> vertices;
  DeviceArray<pgl::Triangle<std::uint16_t>> triangles;
  Step(const StreamedModel& model, StreamedFrame of)
      : counts_on_host(model.counts),
        frame(std::move(of)),
        counts(model.counts),
        vertex_offsets(frame.vertex_offsets),
        triangle_offsets(frame.triangle_offsets),
        drawn_counts(model.counts.size()),
        drawn_vertex_offsets(frame.vertex_offsets.size()),
        drawn_triangle_offsets(frame.triangle_offsets.size()),
        vertices(frame.vertices.size()),
        triangles(frame.triangles.size()) {}
};

class Streams {
 public:
  Streams() {
    must(cudaStreamCreateWithFlags(&select, cudaStreamNonBlocking));
    must(cudaStreamCreateWithFlags(&draw, cudaStreamNonBlocking));
  }
  ~Streams() {
    cudaStreamDestroy(select);
    cudaStreamDestroy(draw);
  }
  cudaStream_t select = nullptr, draw = nullptr;
};

/// Keeps a stream busy, so that what waits for it comes late.
__global__ void dawdle(unsigned cycles) {
  const long long start = clock64();
  while (clock64() - start < cycles) {
  }
}

/// Walks through selections; overlapping, a frame is begun and sent while the one before is still being drawn. All that
/// is allocated or freed is so before or after, since that waits for the device.
void walk(Stream& stream, unsigned seed, test::ModelShape shape, std::uint32_t size, int steps, bool overlap,
          std::uint64_t new_bytes) {
  std::mt19937 random(seed);
  StreamedModel model(random, shape, size);
  std::vector<std::unique_ptr<Step>> walked;
  for (int step = 0; step < steps; ++step) {
    const std::vector<std::uint32_t> before = model.counts;
    model.go(random, static_cast<test::Step>(random() % test::steps));
    walked.push_back(std::make_unique<Step>(model, model.frame(before)));
  }
  must(cudaDeviceSynchronize());

  Streams streams;
  must(stream.reserve(model.objects.size(), model.most_vertices(), model.most_triangles(), new_bytes));
  for (const auto& step : walked) {
    const StreamedFrame& frame = step->frame;
    must(stream.begin(step->counts.input(), step->vertex_offsets.input(), step->triangle_offsets.input(),
                      streams.select));
    // The caller's arrays are its own again behind what begin() enqueued.
    for (const auto bytes :
         {std::as_writable_bytes(step->counts.view()), std::as_writable_bytes(step->vertex_offsets.view()),
          std::as_writable_bytes(step->triangle_offsets.view())}) {
      must(cudaMemsetAsync(bytes.data(), 0xEE, bytes.size(), streams.select));
    }
    pgl::DeltaSize sent;
    must(stream.send(model.meshes, model.objects, model.elements, model.triangles, sent));
    ASSERT_EQ(sent, (pgl::DeltaSize{frame.new_vertices, frame.new_triangles,
                                    12 * frame.new_vertices + 6 * frame.new_triangles}));
    must(stream.apply(streams.draw));
    copy(step->drawn_counts, stream.counts(), streams.draw);
    copy(step->drawn_vertex_offsets, stream.vertex_offsets(), streams.draw);
    copy(step->drawn_triangle_offsets, stream.triangle_offsets(), streams.draw);
    copy(step->vertices, stream.vertices(), streams.draw);
    copy(step->triangles, stream.triangles(), streams.draw);
    if (overlap) {
      dawdle<<<1, 1, 0, streams.draw>>>(200'000);
    } else {
      must(cudaDeviceSynchronize());
    }
  }
  must(cudaDeviceSynchronize());
  for (const auto& step : walked) {
    ASSERT_EQ(step->drawn_counts.read(), step->counts_on_host);
    ASSERT_EQ(step->drawn_vertex_offsets.read(), step->frame.vertex_offsets);
    ASSERT_EQ(step->drawn_triangle_offsets.read(), step->frame.triangle_offsets);
    ASSERT_EQ(step->vertices.read(), step->frame.vertices);
    ASSERT_EQ(step->triangles.read(), step->frame.triangles);
  }
}

TEST(BlockStreamTwin, HoldsAFreshCopyOfEverySelectionAndSendsOnlyWhatIsNew) {
  PGL_NEEDS_DEVICE();
  for (unsigned scene = 0; scene < 20; ++scene) {
    Stream stream;
    walk(stream, scene, static_cast<test::ModelShape>(scene % test::model_shapes), 1 + scene * 20, 15, false, 0);
    if (HasFatalFailure()) return;
  }
}

TEST(BlockStreamTwin, IsTheSameWhereFramesOverlap) {
  PGL_NEEDS_DEVICE();
  for (unsigned scene = 0; scene < 10; ++scene) {
    Stream stream;
    walk(stream, 100 + scene, static_cast<test::ModelShape>(scene % test::model_shapes), 1 + scene * 40, 20, true,
         scene % 2 == 0 ? 0 : 1 << 20);
    if (HasFatalFailure()) return;
  }
}

/// Of fewer objects and of more, from whatever it held, and with a cap that is none.
TEST(BlockStreamTwin, StartsAnewAfterReserve) {
  PGL_NEEDS_DEVICE();
  Stream stream;
  unsigned seed = 200;
  for (const std::uint32_t size : {200u, 20u, 300u, 300u}) {
    walk(stream, seed, static_cast<test::ModelShape>(seed % test::model_shapes), size, 6, true, ~std::uint64_t{0});
    if (HasFatalFailure()) return;
    ++seed;
  }
}

TEST(BlockStreamTwin, TakesASceneOfNoObjects) {
  PGL_NEEDS_DEVICE();
  Stream stream;
  must(stream.reserve(0, 0, 0));
  const DeviceArray<std::uint32_t> counts(std::vector<std::uint32_t>{});
  const DeviceArray<std::uint64_t> offsets(std::vector<std::uint64_t>{0});
  must(stream.begin(counts.input(), offsets.input(), offsets.input()));
  pgl::DeltaSize sent;
  must(stream.send({}, {}, {}, {}, sent));
  EXPECT_EQ(sent, pgl::DeltaSize{});
  must(stream.apply());
  must(cudaDeviceSynchronize());
}

}  // namespace
