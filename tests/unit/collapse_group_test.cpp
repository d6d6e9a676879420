// SPDX-License-Identifier: MIT
// What a group of GPU threads does with one mesh, done by threads of the CPU: the same bytes as pgl::host::build_ecol,
// for groups of any size, so that the algorithm is tested where there is no GPU.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <barrier>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <thread>
#include <vector>

#include "pgl/cuda/collapse_group.hpp"
#include "pgl/host/build_ecol.hpp"
#include "support/ecol_cases.hpp"

namespace {

using namespace test;

/// N threads that meet at every collective, as a warp's do.
template <unsigned N>
class ThreadGroup {
 public:
  struct Meeting {
    std::barrier<> barrier{N};
    std::array<std::array<std::uint64_t, 8>, N> words{};
  };
  static constexpr unsigned size = N;

  ThreadGroup(Meeting& meeting, unsigned rank) : meeting_(&meeting), rank_(rank) {}
  unsigned rank() const { return rank_; }
  void sync() const { meeting_->barrier.arrive_and_wait(); }

  template <class T>
  T shuffle(const T& value, unsigned from) const {
    static_assert(sizeof(T) <= sizeof(std::array<std::uint64_t, 8>));
    std::memcpy(meeting_->words[rank_].data(), &value, sizeof(T));
    sync();
    T result;
    std::memcpy(static_cast<void*>(&result), meeting_->words[from].data(), sizeof(T));
    sync();
    return result;
  }
  std::uint32_t match(std::uint32_t key) const {
    std::uint32_t mask = 0;
    meeting_->words[rank_][0] = key;
    sync();
    for (unsigned i = 0; i < N; ++i) mask |= std::uint32_t{meeting_->words[i][0] == key} << i;
    sync();
    return mask;
  }
  std::uint32_t ballot(bool p) const {
    std::uint32_t mask = 0;
    meeting_->words[rank_][0] = p ? 1 : 0;
    sync();
    for (unsigned i = 0; i < N; ++i) mask |= static_cast<std::uint32_t>(meeting_->words[i][0]) << i;
    sync();
    return mask;
  }
  std::uint32_t least(std::uint32_t x) const {
    for (unsigned step = N / 2; step > 0; step /= 2) x = std::min(x, shuffle(x, rank_ ^ step));
    return x;
  }
  std::uint32_t exchange(std::uint32_t* p, std::uint32_t x) const {
    return std::atomic_ref(*p).exchange(x, std::memory_order_relaxed);
  }
  void add(std::uint32_t* p, std::uint32_t x) const { std::atomic_ref(*p).fetch_add(x, std::memory_order_relaxed); }
  void lower(std::uint64_t* p, std::uint64_t x) const {
    const std::atomic_ref<std::uint64_t> a(*p);
    for (std::uint64_t old = a.load(); x < old && !a.compare_exchange_weak(old, x);) {
    }
  }
  template <class Cost>
  pgl::cuda::detail::RoundFound<Cost> found(const pgl::cuda::detail::RoundFound<Cost>& mine) const {
    const bool any = ballot(mine.any) != 0;
    return {any, pgl::cuda::detail::least_of(*this, mine.least)};
  }

 private:
  Meeting* meeting_;
  unsigned rank_;
};

template <class Index>
struct Result {
  std::uint32_t left = 0;
  std::vector<Index> ecol, permute_v;
  std::vector<std::uint32_t> permute_t, map;
  std::vector<float> error;
  bool operator==(const Result&) const = default;

  Result(std::size_t vertices, std::size_t triangles, bool with_error)
      : ecol(vertices),
        permute_v(vertices),
        permute_t(triangles),
        map(vertices + 1, 77),
        error(with_error ? vertices + 1 : 0, -1.0f) {}
};

template <class Index>
std::vector<pgl::Triangle<Index>> narrowed(const TriangleMesh& mesh) {
  std::vector<pgl::Triangle<Index>> triangles;
  for (const auto& t : mesh.triangles)
    triangles.push_back({{static_cast<Index>(t.v[0]), static_cast<Index>(t.v[1]), static_cast<Index>(t.v[2])}});
  return triangles;
}

template <class Real, class Index>
Result<Index> by_host(const EcolCase& c, bool with_error) {
  Result<Index> r(c.mesh.positions.size(), c.mesh.triangles.size(), with_error);
  const auto triangles = narrowed<Index>(c.mesh);
  pgl::host::EcolWorkspace<Real> workspace;
  r.left = pgl::host::build_ecol<Real, Index>(c.mesh.positions, triangles, c.locked, c.options, workspace, r.ecol,
                                              r.permute_v, r.permute_t, r.map, r.error);
  return r;
}

template <unsigned N, class Real, class Id, class Index>
Result<Index> by_group(const EcolCase& c, bool with_error) {
  using State = pgl::cuda::detail::CollapseState<Real, Id>;
  Result<Index> r(c.mesh.positions.size(), c.mesh.triangles.size(), with_error);
  const auto triangles = narrowed<Index>(c.mesh);
  State state;
  const std::size_t size =
      State::lay_out(state, nullptr, c.mesh.vertex_count(), c.mesh.triangle_count(), c.options, with_error);
  std::vector<std::uint64_t> memory(size / 8 + 4, 0xA5A5A5A5A5A5A5A5u);
  const std::uint64_t guard = memory.back();
  const pgl::cuda::detail::EcolArrays<Index> arrays{c.mesh.positions.data(),
                                                    triangles.data(),
                                                    c.locked.empty() ? nullptr : c.locked.data(),
                                                    r.ecol.data(),
                                                    r.permute_v.data(),
                                                    r.permute_t.data(),
                                                    r.map.data(),
                                                    with_error ? r.error.data() : nullptr};
  typename ThreadGroup<N>::Meeting meeting;
  const auto work = [&](unsigned rank) {
    ThreadGroup<N> group(meeting, rank);
    const std::uint32_t left = pgl::cuda::detail::build_one<Real, Id>(group, memory.data(), c.mesh.vertex_count(),
                                                                      c.mesh.triangle_count(), c.options, arrays);
    if (rank == 0) r.left = left;
  };
  std::vector<std::thread> threads;
  for (unsigned rank = 1; rank < N; ++rank) threads.emplace_back(work, rank);
  work(0);
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(memory.back(), guard);
  return r;
}

template <unsigned N>
void group_equals_host(pgl::EcolOrder order, int cases) {
  for (int i = 0; i < cases; ++i) {
    EcolCase c =
        random_ecol_case(static_cast<std::uint32_t>(i), {Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
    std::mt19937 rng(static_cast<std::uint32_t>(i));
    c.options.flip_guard = below(rng, 2) == 0;
    if (i % 4 == 3) make_extreme(c, rng);
    c.options.order = order;
    const bool with_error = below(rng, 2) == 0;
    const bool same = c.fine ? by_host<double, std::uint32_t>(c, with_error) ==
                                   by_group<N, double, std::uint32_t, std::uint32_t>(c, with_error)
                             : by_host<float, std::uint16_t>(c, with_error) ==
                                   by_group<N, float, std::uint16_t, std::uint16_t>(c, with_error);
    ASSERT_TRUE(same) << "case " << i;
  }
}

TEST(CollapseGroup, OneThreadIsGreedyAsTheHostIs) {
  group_equals_host<1>(pgl::EcolOrder::greedy, 800);
}
TEST(CollapseGroup, OneThreadDoesTheHostsRounds) {
  group_equals_host<1>(pgl::EcolOrder::rounds, 800);
}
TEST(CollapseGroup, ManyThreadsAreGreedyAsTheHostIs) {
  group_equals_host<4>(pgl::EcolOrder::greedy, 30);
}
TEST(CollapseGroup, ManyThreadsDoTheHostsRounds) {
  group_equals_host<4>(pgl::EcolOrder::rounds, 30);
}
TEST(CollapseGroup, AWarpOfThreadsDoesBothAsTheHostDoes) {
  group_equals_host<32>(pgl::EcolOrder::greedy, 8);
  group_equals_host<32>(pgl::EcolOrder::rounds, 8);
}

TEST(CollapseGroup, NothingComesOfNothing) {
  for (const auto order : {pgl::EcolOrder::greedy, pgl::EcolOrder::rounds}) {
    EcolCase c;
    c.options.order = order;
    EXPECT_EQ((by_host<float, std::uint32_t>(c, true)), (by_group<2, float, std::uint16_t, std::uint32_t>(c, true)));
    c.mesh.positions = {{1, 2, 3}, {4, 5, 6}};
    EXPECT_EQ((by_host<float, std::uint32_t>(c, true)), (by_group<2, float, std::uint16_t, std::uint32_t>(c, true)));
    c.mesh.triangles = {{{0, 0, 1}}, {{1, 1, 1}}};
    EXPECT_EQ((by_host<float, std::uint32_t>(c, true)), (by_group<2, float, std::uint16_t, std::uint32_t>(c, true)));
  }
}

/// A mesh large enough for the tree of least candidates, on two levels.
TEST(CollapseGroup, OneThreadIsGreedyOnMeshesWithATree) {
  for (const std::uint32_t side : {32u, 33u, 40u, 190u}) {
    EcolCase c;
    std::mt19937 rng(side);
    c.mesh = jittered(torus(side, side), rng, 0.02f);
    EXPECT_TRUE((by_host<float, std::uint32_t>(c, true) == by_group<1, float, std::uint32_t, std::uint32_t>(c, true)))
        << side;
  }
}

}  // namespace
