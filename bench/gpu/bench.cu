// SPDX-License-Identifier: MIT
#include "bench.cuh"

#include <cstring>
#include <exception>

#include "pgl/cuda/launch.cuh"

namespace pgl::bench {
namespace {

constexpr std::size_t flush_bytes = std::size_t{512} << 20;   // several times any L2
constexpr std::size_t staging_bytes = std::size_t{64} << 20;  // two of them

/// Reads the whole array, so that nothing else is left in the caches and nothing in them is still to be written.
__global__ void read_all(const uint4* data, std::size_t size, unsigned* never) {
  unsigned sum = 0;
  for (std::size_t i = blockIdx.x * std::size_t{blockDim.x} + threadIdx.x; i < size;
       i += std::size_t{gridDim.x} * blockDim.x) {
    const uint4 v = data[i];
    sum |= v.x | v.y | v.z | v.w;  // all of it is 0
  }
  if (sum != 0) *never = sum;
}

double median(std::vector<float>& values) {
  std::ranges::sort(values);
  const std::size_t n = values.size();
  return 0.5 * (static_cast<double>(values[(n - 1) / 2]) + static_cast<double>(values[n / 2]));
}

/// Events that are destroyed in any case.
class Events {
 public:
  explicit Events(std::size_t count) : events_(count) {
    for (cudaEvent_t& event : events_) must(cudaEventCreate(&event), "event");
  }
  ~Events() {
    for (const cudaEvent_t event : events_) cudaEventDestroy(event);
  }
  cudaEvent_t operator[](std::size_t i) const { return events_[i]; }

 private:
  std::vector<cudaEvent_t> events_;
};

/// A captured call.
class Graph {
 public:
  Graph(const std::function<cudaError_t(cudaStream_t)>& enqueue, cudaStream_t stream) {
    must(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal), "begin capture");
    const cudaError_t enqueued = enqueue(stream);
    const cudaError_t ended = cudaStreamEndCapture(stream, &graph_);
    if (enqueued != cudaSuccess || ended != cudaSuccess) {
      destroy();
      (void)cudaGetLastError();
      must(enqueued, "call inside a capture");
      must(ended, "end capture");
    }
    if (const cudaError_t error = cudaGraphInstantiate(&executable_, graph_, 0); error != cudaSuccess) {
      destroy();
      must(error, "graph");
    }
  }
  ~Graph() { destroy(); }
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;
  cudaError_t launch(cudaStream_t stream) const { return cudaGraphLaunch(executable_, stream); }

 private:
  void destroy() {
    if (executable_ != nullptr) cudaGraphExecDestroy(executable_);
    if (graph_ != nullptr) cudaGraphDestroy(graph_);
  }
  cudaGraph_t graph_ = nullptr;
  cudaGraphExec_t executable_ = nullptr;
};

}  // namespace

Bench::Bench(BenchOptions options) : options_(std::move(options)) {
  if (options_.host_only) return;
  must(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "stream");
  must(cudaMalloc(&flushed_, flush_bytes + 256), "allocation");
  must(cudaMemset(flushed_, 0, flush_bytes + 256), "memset");
  must(cudaHostAlloc(&staging_, 2 * staging_bytes, cudaHostAllocDefault), "pinned memory");
}

Bench::~Bench() {
  if (options_.host_only) return;
  cudaFreeHost(staging_);
  cudaFree(flushed_);
  cudaStreamDestroy(stream_);
}

bool Bench::wants(const std::string& name) const {
  return options_.filters.empty() ||
         std::ranges::any_of(options_.filters, [&](const std::string& f) { return name.find(f) != std::string::npos; });
}

void Bench::save() const {
  if (!options_.json.empty()) write_file(options_.json, to_json(report));
  if (!options_.table.empty()) write_file(options_.table, to_table(report));
}

int Bench::repeats(double ms) const {
  const int most = options_.quick ? 5 : 60;
  return std::clamp(static_cast<int>((options_.quick ? 200.0 : 1500.0) / std::max(ms, 1e-3)), 3, most);
}

/// The median time of `each` calls in a row, per call. Everything is on the stream before the device comes to it.
double Bench::events_ms(const Enqueue& enqueue, int times, int each, bool cold) {
  Events events(2 * static_cast<std::size_t>(times));
  for (int k = 0; k < times; ++k) {
    if (cold) {
      read_all<<<1024, 512, 0, stream_>>>(static_cast<const uint4*>(flushed_), flush_bytes / sizeof(uint4),
                                          reinterpret_cast<unsigned*>(static_cast<char*>(flushed_) + flush_bytes));
      must(cudaGetLastError(), "flush");
    }
    const auto first = 2 * static_cast<std::size_t>(k);
    must(cudaEventRecord(events[first], stream_), "event");
    for (int i = 0; i < each; ++i) must(enqueue(stream_), "call");
    must(cudaEventRecord(events[first + 1], stream_), "event");
  }
  must(cudaStreamSynchronize(stream_), "run");
  std::vector<float> ms(static_cast<std::size_t>(times));
  for (std::size_t k = 0; k < ms.size(); ++k) must(cudaEventElapsedTime(&ms[k], events[2 * k], events[2 * k + 1]));
  return median(ms) / each;
}

/// Compares piece by piece: the next piece comes while one is looked at.
bool Bench::same_bytes(const Expected& e) {
  const auto* device = static_cast<const std::byte*>(e.device);
  const auto* host = static_cast<const std::byte*>(e.host);
  auto* staging = static_cast<std::byte*>(staging_);
  const auto size_at = [&](std::size_t at) { return std::min(staging_bytes, e.bytes - at); };
  const auto fetch = [&](std::size_t at) {
    must(cudaMemcpyAsync(staging + (at / staging_bytes % 2) * staging_bytes, device + at, size_at(at),
                         cudaMemcpyDeviceToHost, stream_),
         "download");
  };
  bool same = true;
  if (e.bytes > 0) fetch(0);
  for (std::size_t at = 0; at < e.bytes; at += staging_bytes) {
    must(cudaStreamSynchronize(stream_), "download");
    if (at + staging_bytes < e.bytes) fetch(at + staging_bytes);
    same = same && std::memcmp(staging + (at / staging_bytes % 2) * staging_bytes, host + at, size_at(at)) == 0;
  }
  return same;
}

void Bench::device(const Measurement& m, const std::vector<Expected>& outputs, Row& row) {
  for (const Expected& e : outputs) {
    if (e.bytes > 0) must(cudaMemset(e.device, 0xA5, e.bytes), "memset");
  }
  must(cudaDeviceSynchronize());
  Stopwatch watch;
  const Enqueue& checked = m.check ? m.check : m.enqueue;
  must(checked(stream_), "first call");  // scratch is allocated, code loaded
  must(cudaStreamSynchronize(stream_), "first run");
  const double first_ms = watch.lap();
  const int times = first_ms > 1000 ? 1 : repeats(events_ms(m.enqueue, 1, 1, false));
  row.stream_ms = events_ms(m.enqueue, times, 1, true);
  if (m.graph) {
    const Graph graph(m.enqueue, stream_);
    const Enqueue replay = [&](cudaStream_t stream) { return graph.launch(stream); };
    must(replay(stream_), "graph");
    must(cudaStreamSynchronize(stream_), "graph");
    row.ms = events_ms(replay, times, 1, true);
    row.warm_ms = events_ms(replay, std::max(3, times / 4), 4, false);
  } else {
    row.ms = row.stream_ms;
  }
  for (auto* ms : {&row.ms, &row.stream_ms, &row.warm_ms}) {
    if (*ms) **ms /= m.calls;
  }

  // Once more into poisoned memory, after all those replays: every byte is written each time. What takes seconds is
  // compared as the timed run left it, the first one having been poisoned.
  if (times > 1) {
    for (const Expected& e : outputs) {
      if (e.bytes > 0) must(cudaMemsetAsync(e.device, 0xA5, e.bytes, stream_), "memset");
    }
    must(checked(stream_), "last call");
    must(cudaStreamSynchronize(stream_), "last run");
  }
  if (outputs.empty()) return;
  bool same = true;
  for (const Expected& e : outputs) same = same_bytes(e) && same;
  row.equal = same;
}

void Bench::host(const Measurement& m, Row& row) const {
  const auto time = [&](std::size_t threads) {
    use_threads(threads);
    Stopwatch watch;
    m.host();
    std::vector<float> ms{static_cast<float>(watch.lap())};
    const int more = options_.quick ? 0 : static_cast<int>(std::min(6.0, 600.0 / static_cast<double>(ms[0])));
    for (int k = 0; k < more; ++k) {
      m.host();
      ms.push_back(static_cast<float>(watch.lap()));
    }
    use_threads(0);
    return median(ms) * m.host_scale / m.calls;
  };
  if (m.host_all) row.host_all_ms = m.host_all_ms ? *m.host_all_ms : time(0);
  if (m.host_one) row.host_1_ms = time(1);
}

void Bench::row(const Measurement& m) {
  if (!wants(m.name)) return;
  Row row;
  row.name = m.name;
  row.bytes = m.bytes;
  row.target_ms = m.target_ms;
  row.note = m.note;
  const auto failed = [&](const std::string& why) {
    ++failures_;
    row.note += (row.note.empty() ? "" : "; ") + ("FAILED: " + why);
  };
  std::fprintf(stderr, "gpu_bench: %s\n", m.name.c_str());
  if (m.host) host(m, row);
  bool lost = false;
  if (!host_only() && m.enqueue) {
    std::vector<Expected> outputs;
    try {
      if (m.outputs) outputs = m.outputs();
      device(m, outputs, row);
      if (row.equal && !*row.equal) failed("device and host differ");
    } catch (const std::exception& error) {
      failed(error.what());
      (void)cudaGetLastError();
      lost = cudaDeviceSynchronize() != cudaSuccess;  // an error that stays: nothing more can run here
    }
    if (!lost && !row.equal.value_or(false)) {  // other rows read it
      for (const Expected& e : outputs) {
        if (e.bytes > 0) must(cudaMemcpy(e.device, e.host, e.bytes, cudaMemcpyHostToDevice), "upload");
      }
    }
  }
  report.rows.push_back(std::move(row));
  save();
  if (lost) throw std::runtime_error("the device failed in " + m.name);
}

void Bench::add(Row row) {
  if (row.equal && !*row.equal) {
    ++failures_;
    row.note += (row.note.empty() ? "" : "; ") + std::string("FAILED");
  }
  report.rows.push_back(std::move(row));
  save();
}

void Bench::left_out(const std::string& name, const std::string& why) {
  if (!wants(name)) return;
  report.rows.push_back({.name = name, .note = "left out: " + why});
  save();
}

void Bench::copy() {
  if (host_only()) return;
  const std::size_t bytes = std::size_t{options_.quick ? 1u : 4u} << 30;
  const DeviceArray<std::byte> from(bytes), to(bytes);
  const Enqueue enqueue = [&](cudaStream_t stream) {
    return cudaMemcpyAsync(to.data(), from.data(), bytes, cudaMemcpyDeviceToDevice, stream);
  };
  (void)events_ms(enqueue, 2, 1, false);
  Row row;
  row.name = "copy";
  row.bytes = 2 * bytes;
  row.ms = row.stream_ms = events_ms(enqueue, options_.quick ? 5 : 30, 1, false);
  row.note = "cudaMemcpyAsync within the device, bytes read and bytes written";
  report.copy_gb_per_s = gb_per_s(row);
  report.rows.push_back(row);
  save();
}

}  // namespace pgl::bench
