// SPDX-License-Identifier: MIT
#include "pgl/host/defragment.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "pgl/host/gather.hpp"
#include "pgl/host/pack_delta.hpp"
#include "support/selection_walk.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace {

namespace in_place = pgl::host::defragment_detail;

void use_threads([[maybe_unused]] int n) {
#if defined(_OPENMP)
  omp_set_num_threads(n);
#endif
}

/// Element by element, so that a wrong one is not lost in two long lists.
template <class T>
void expect_equal(const std::vector<T>& block, const std::vector<T>& expected) {
  RC_ASSERT(block.size() >= expected.size());
  RC_ASSERT(std::equal(expected.begin(), expected.end(), block.begin()));
}

/// A walk along which three blocks are kept: one written anew by defragment each time, one updated in place as
/// defragment_in_place decides, and one updated in place by tiles of any size and any number of workers.
template <class T>
void follows_any_sequence(std::uint32_t seed, std::uint32_t size, int length) {
  std::mt19937 random(seed);
  test::SelectionWalk<T> walk(random, static_cast<test::ModelShape>(random() % test::model_shapes), size);
  std::uint64_t most = 0;
  for (std::size_t i = 0; i < walk.objects.size(); ++i) most += walk.most(i);
  T guard;
  for (auto& byte : guard.byte) byte = 0xA5;
  // Room for the largest selection, not more; and guards.
  std::vector<T> copied(most + 2, guard), moved = copied, tiled = copied;
  pgl::host::DefragmentWorkspace workspace;
  for (int k = 0; k < length; ++k) {
    const auto before = walk.counts;
    const auto previous = walk.offsets();
    walk.go(random, static_cast<test::Step>(random() % test::steps));
    const auto offsets = walk.offsets();
    const auto expected = walk.fresh();

    use_threads(1 + static_cast<int>(random() % 4));
    std::vector<std::uint64_t> delta_offsets(offsets.size());
    std::vector<T> additional(pgl::host::lay_out_delta(previous, offsets, delta_offsets));
    pgl::host::pack_delta<T>(walk.meshes, walk.objects, &pgl::Mesh::first_vertex, walk.elements, previous, offsets,
                             delta_offsets, additional);
    const auto additional_before = additional;

    std::vector<T> out(offsets.back() + 2, guard);
    const auto copied_before = copied;
    pgl::host::defragment<T>(previous, offsets, delta_offsets, copied, additional, out);
    expect_equal(out, expected);
    RC_ASSERT(out[out.size() - 1] == guard && out[out.size() - 2] == guard);
    RC_ASSERT(copied == copied_before);
    std::copy(out.begin(), out.end() - 2, copied.begin());

    const auto moved_before = moved;
    pgl::host::defragment_in_place<T>(previous, offsets, delta_offsets, additional, workspace, moved);
    expect_equal(moved, expected);
    RC_ASSERT(std::equal(moved.begin() + static_cast<std::ptrdiff_t>(expected.size()), moved.end(),
                         moved_before.begin() + static_cast<std::ptrdiff_t>(expected.size())));

    if (offsets.back() > 0) {
      const std::uint64_t sizes[] = {1, 2, 3, 1 + random() % 8, 1 + random() % 100, offsets.back(), offsets.back() + 9};
      const in_place::TilePlan plan{std::max(sizes[random() % 7], offsets.back() / 500), 1 + random() % 5};
      in_place::move_in_tiles(previous.data(), offsets.data(), walk.objects.size(), plan, workspace, tiled.data());
      in_place::insert(previous.data(), offsets.data(), delta_offsets, additional.data(), tiled.data());
    }
    expect_equal(tiled, expected);
    RC_ASSERT(tiled[most] == guard && tiled[most + 1] == guard);
    RC_ASSERT(additional == additional_before);
  }
}

RC_GTEST_PROP(DefragmentProps, equalsAFreshCopyAfterAnySequence, (std::uint32_t seed)) {
  follows_any_sequence<test::Payload<1>>(seed, 30, 20);
  follows_any_sequence<test::Payload<3>>(seed, 10, 20);
  follows_any_sequence<test::Payload<6>>(seed, 60, 20);
  follows_any_sequence<test::Payload<12>>(seed, 200, 20);
  follows_any_sequence<test::Payload<16>>(seed, 3, 20);
  follows_any_sequence<test::Payload<101>>(seed, 20, 20);
}

// Large enough for defragment_in_place to choose tiles by itself.
RC_GTEST_PROP(DefragmentProps, equalsAFreshCopyWhereSeveralThreadsMove, (std::uint32_t seed)) {
  if (seed % 4 == 0) follows_any_sequence<test::Payload<12>>(seed, 4000, 6);
  if (seed % 4 == 1) follows_any_sequence<test::Payload<777>>(seed, 60, 6);
  if (seed % 16 == 2) follows_any_sequence<test::Payload<9001>>(seed, 8, 5);
}

/// Two selections of n objects, of counts below `most`; of any kind, or one of the other with a few changes.
std::pair<std::vector<std::uint64_t>, std::vector<std::uint64_t>> two_selections(std::mt19937& random) {
  const std::size_t n = 1 + random() % 40;
  const std::uint32_t most = 1 + random() % 30, change = random() % 4, empty = random() % 3;
  std::vector<std::uint64_t> previous{0}, offsets{0};
  for (std::size_t i = 0; i < n; ++i) {
    const auto any = [&] { return empty != 0 && random() % (empty + 1) != 0 ? 0u : random() % most; };
    const auto before = any();
    const auto now = change != 0 && random() % (change * change + 1) != 0 ? before : any();
    previous.push_back(previous.back() + before);
    offsets.push_back(offsets.back() + now);
  }
  return {previous, offsets};
}

struct Element {
  std::uint64_t from, to;
};

/// What a worker does with one ticket, an element at a time.
struct Move {
  std::uint64_t ticket;
  std::vector<Element> elements;
  std::vector<int> staging;
  std::size_t written = 0;
};

// The plan alone, as any driver may follow it: workers that take tickets in turn and then go on as slowly or as fast as
// they like, element by element. Here the slowest and the fastest are drawn by lot.
RC_GTEST_PROP(DefragmentProps, planOverwritesNothingUnreadUnderAnySchedule, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  for (int run = 0; run < 20; ++run) {
    const auto [previous, offsets] = two_selections(random);
    const std::size_t n = offsets.size() - 1;
    std::vector<int> block(std::max(previous.back(), offsets.back()), -1), expected(offsets.back(), -1);
    for (std::uint64_t x = 0; x < previous.back(); ++x) block[x] = static_cast<int>(x);
    for (std::size_t i = 0; i < n; ++i) {
      for (std::uint64_t k = 0; previous[i] + k < previous[i + 1] && offsets[i] + k < offsets[i + 1]; ++k) {
        expected[offsets[i] + k] = static_cast<int>(previous[i] + k);
      }
    }

    const std::uint64_t tile_size = 1 + random() % (random() % 2 == 0 ? 4 : 64);
    const std::uint64_t tiles = pgl::tile_count(offsets.back(), tile_size);
    const std::size_t most_workers = 1 + random() % 9;
    std::vector<bool> read(2 * tiles, false);
    std::vector<Move> running;
    std::uint64_t next = 0, waits = 0;
    while (next < 2 * tiles || !running.empty()) {
      if (next < 2 * tiles && running.size() < most_workers && (running.empty() || random() % 3 == 0)) {
        Move move{next++, {}, {}};
        in_place::for_parts(previous.data(), offsets.data(), n, tile_size, pgl::tile_move(move.ticket, tiles),
                            [&](const pgl::KeptPart& part) {
                              for (std::uint64_t k = 0; k < part.size; ++k) {
                                move.elements.push_back({part.from + k, part.to + k});
                              }
                            });
        RC_ASSERT(move.elements.size() <= tile_size);
        running.push_back(move);
      }
      std::size_t able = 0;
      const std::size_t lucky = random() % running.size();
      for (std::size_t w = 0; w < running.size(); ++w) {
        Move& move = running[w];
        const auto before = pgl::tickets_before_write(previous.data(), offsets.data(), n, tile_size, move.ticket);
        RC_ASSERT(before.first >= before.last || before.last <= move.ticket);
        const bool may_write = std::all_of(
            read.begin() + static_cast<std::ptrdiff_t>(before.first),
            read.begin() + static_cast<std::ptrdiff_t>(std::max(before.first, before.last)), [](bool b) { return b; });
        const bool reads = move.staging.size() < move.elements.size() || !read[move.ticket];
        if (!reads && !may_write) continue;
        ++able;
        if (w != lucky) continue;
        for (std::size_t many = 1 + random() % 5; many > 0; --many) {
          if (move.staging.size() < move.elements.size()) {
            move.staging.push_back(block[move.elements[move.staging.size()].from]);
          } else if (!read[move.ticket]) {
            read[move.ticket] = true;
            if (before.last > before.first) waits += before.last - before.first;
          } else if (may_write && move.written < move.elements.size()) {
            block[move.elements[move.written].to] = move.staging[move.written];
            ++move.written;
          }
        }
      }
      RC_ASSERT(able > 0);  // never all wait
      std::erase_if(running,
                    [&](const Move& move) { return read[move.ticket] && move.written == move.elements.size(); });
    }
    RC_ASSERT(waits <= 2 * tiles);
    for (std::uint64_t x = 0; x < expected.size(); ++x) RC_ASSERT(expected[x] < 0 || block[x] == expected[x]);
  }
}

RC_GTEST_PROP(DefragmentProps, landingHoldsAllThatStaysAndIsTight, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  for (int run = 0; run < 50; ++run) {
    const auto [previous, offsets] = two_selections(random);
    const std::size_t n = offsets.size() - 1;
    const std::uint64_t begin = random() % (previous.back() + 3), end = begin + 1 + random() % 20;
    const pgl::Landing landing = pgl::landing(previous.data(), offsets.data(), n, begin, end);
    std::uint64_t first = ~std::uint64_t{0}, last = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const pgl::KeptPart part = pgl::kept_part(previous.data(), offsets.data(), i);
      for (std::uint64_t k = 0; k < part.size; ++k) {
        if (part.from + k < begin || part.from + k >= end) continue;
        first = std::min(first, part.to + k);
        last = std::max(last, part.to + k + 1);
      }
    }
    if (last == 0) continue;
    RC_ASSERT(landing.first <= first);
    RC_ASSERT(landing.last >= last);
    // Tight where the ends themselves stay.
    const std::size_t i = pgl::object_at(previous.data(), n, begin);
    if (begin - previous[i] < pgl::kept_part(previous.data(), offsets.data(), i).size)
      RC_ASSERT(landing.first == first);
  }
}

RC_GTEST_PROP(DefragmentProps, takesLessThanATwentiethMore, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  for (int run = 0; run < 100; ++run) {
    const std::uint64_t total = random() >> (random() % 32);
    const std::size_t bytes = 1 + (random() >> (8 + random() % 24)) % 100000;
    const std::size_t threads = 1 + random() % 300;
    const in_place::TilePlan plan = in_place::plan_tiles(total, bytes, threads);
    RC_ASSERT(plan.workers >= 1 && plan.workers <= threads);
    RC_ASSERT(plan.workers == 1 || plan.tile_size > 0);
    RC_ASSERT(plan.scratch_bytes(total, bytes) * 25 <= total * bytes);
    const std::uint64_t tile_bytes = std::max<std::uint64_t>(65536, bytes);
    RC_ASSERT(plan.scratch_bytes(total, bytes) <= threads * tile_bytes + total * bytes / 1000);
  }
}

RC_GTEST_PROP(DefragmentProps, keepsUpWithGather, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  test::SelectionWalk<test::Payload<1>> walk(random, test::ModelShape::even, 60);
  std::vector<glm::vec3> vertices;
  for (std::size_t v = 0; v < walk.elements.size(); ++v) vertices.emplace_back(static_cast<float>(v), 1.0f, -2.0f);
  for (auto& object : walk.objects) object.transform[3] = glm::vec3(static_cast<float>(random() % 100));
  std::vector<pgl::PlacedVertex> existing;
  for (int k = 0; k < 10; ++k) {
    const auto previous = walk.offsets();
    walk.go(random, static_cast<test::Step>(random() % test::steps));
    const auto offsets = walk.offsets();
    std::vector<std::uint64_t> delta_offsets(offsets.size());
    std::vector<pgl::PlacedVertex> additional(pgl::host::lay_out_delta(previous, offsets, delta_offsets));
    std::vector<pgl::PlacedVertex> out(offsets.back()), gathered(offsets.back());
    pgl::host::pack_placed_delta<pgl::PlacedVertex, glm::vec3>(walk.meshes, walk.objects, vertices, previous, offsets,
                                                               delta_offsets, additional);
    pgl::host::defragment<pgl::PlacedVertex>(previous, offsets, delta_offsets, existing, additional, out);
    pgl::host::gather<pgl::PlacedVertex, glm::vec3>(walk.meshes, walk.objects, vertices, walk.counts, offsets,
                                                    gathered);
    RC_ASSERT(out == gathered);
    existing = out;
  }
}

}  // namespace
