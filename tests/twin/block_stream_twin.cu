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

template <class T>
std::vector<T> first(std::span<const T> block, std::size_t size) {
  std::vector<T> values(size);
  must(cudaMemcpy(values.data(), block.data(), size * sizeof(T), cudaMemcpyDeviceToHost));
  return values;
}

/// One frame: its selection on the device, and room for copies of the blocks that the stream which draws makes.
struct Step {
  std::vector<std::uint32_t> counts_on_host;
  StreamedFrame frame;
  DeviceArray<std::uint32_t> counts;
  DeviceArray<std::uint64_t> vertex_offsets, triangle_offsets;
  DeviceArray<StreamedFrame::Vertex> vertices;
  DeviceArray<pgl::Triangle<std::uint16_t>> triangles;
  Step(const StreamedModel& model, StreamedFrame of)
      : counts_on_host(model.counts),
        frame(std::move(of)),
        counts(model.counts),
        vertex_offsets(frame.vertex_offsets),
        triangle_offsets(frame.triangle_offsets),
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
void walk(unsigned seed, test::ModelShape shape, std::uint32_t size, int steps, bool overlap, std::uint64_t new_bytes) {
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
  Stream stream;
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
    must(cudaMemcpyAsync(step->vertices.data(), stream.vertices().data(), step->vertices.view().size_bytes(),
                         cudaMemcpyDeviceToDevice, streams.draw));
    must(cudaMemcpyAsync(step->triangles.data(), stream.triangles().data(), step->triangles.view().size_bytes(),
                         cudaMemcpyDeviceToDevice, streams.draw));
    if (overlap) {
      dawdle<<<1, 1, 0, streams.draw>>>(200'000);
    } else {
      must(cudaDeviceSynchronize());
      ASSERT_EQ(first(stream.counts(), step->counts_on_host.size()), step->counts_on_host);
    }
  }
  must(cudaDeviceSynchronize());
  for (const auto& step : walked) {
    ASSERT_EQ(step->vertices.read(), step->frame.vertices);
    ASSERT_EQ(step->triangles.read(), step->frame.triangles);
  }
}

TEST(BlockStreamTwin, HoldsAFreshCopyOfEverySelectionAndSendsOnlyWhatIsNew) {
  PGL_NEEDS_DEVICE();
  for (unsigned scene = 0; scene < 20; ++scene) {
    walk(scene, static_cast<test::ModelShape>(scene % test::model_shapes), 1 + scene * 20, 15, false, 0);
    if (HasFatalFailure()) return;
  }
}

TEST(BlockStreamTwin, IsTheSameWhereFramesOverlap) {
  PGL_NEEDS_DEVICE();
  for (unsigned scene = 0; scene < 10; ++scene) {
    walk(100 + scene, static_cast<test::ModelShape>(scene % test::model_shapes), 1 + scene * 40, 20, true,
         scene % 2 == 0 ? 0 : 1 << 20);
    if (HasFatalFailure()) return;
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
