// SPDX-License-Identifier: MIT
#include "pgl/host/build_ecol.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <limits>
#include <new>

#include "pgl/host/rearrange.hpp"
#include "support/ecol_oracle.hpp"

#if defined(_OPENMP)
#include <omp.h>
#endif

// ---- memory is counted, so that what a call allocates can be asserted -----------------------------------------------

namespace {
std::atomic<std::size_t> allocations{0}, allocated_bytes{0};

void* counted(std::size_t bytes, std::size_t alignment = alignof(std::max_align_t)) noexcept {
  allocations.fetch_add(1, std::memory_order_relaxed);
  allocated_bytes.fetch_add(bytes, std::memory_order_relaxed);
  return std::aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment + (bytes == 0 ? alignment : 0));
}
void* required(void* p) {
  if (p == nullptr) throw std::bad_alloc();
  return p;
}
}  // namespace

// Not inlined: half inlined, g++ takes them for mismatched.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  return required(counted(bytes));
}
[[gnu::noinline]] void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return required(counted(bytes, static_cast<std::size_t>(alignment)));
}
[[gnu::noinline]] void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  return counted(bytes);
}
[[gnu::noinline]] void operator delete(void* p) noexcept {
  std::free(p);
}
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept {
  std::free(p);
}
[[gnu::noinline]] void operator delete(void* p, std::align_val_t) noexcept {
  std::free(p);
}
[[gnu::noinline]] void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  std::free(p);
}
[[gnu::noinline]] void operator delete(void* p, const std::nothrow_t&) noexcept {
  std::free(p);
}

namespace {

using namespace test;
using pgl::BoundaryRule;
using pgl::CostMetric;
using pgl::EcolOptions;
using pgl::EcolOrder;

/// Every combination of metric, boundary rule, link condition, flip guard and order.
std::vector<EcolOptions> all_options() {
  std::vector<EcolOptions> out;
  for (const EcolOrder order : {EcolOrder::greedy, EcolOrder::rounds})
    for (const CostMetric metric : {CostMetric::quadric, CostMetric::melax, CostMetric::edge_length})
      for (const BoundaryRule boundary : {BoundaryRule::locked, BoundaryRule::slide})
        for (const bool link : {true, false})
          for (const bool flip : {false, true}) out.push_back({metric, boundary, link, flip, 10.0f, order});
  return out;
}

std::string name(const EcolOptions& o) {
  const char* metric[] = {"quadric", "melax", "edge_length"};
  return std::string(metric[static_cast<int>(o.metric)]) + (o.boundary == BoundaryRule::slide ? " slide" : " locked") +
         (o.link_condition ? " link" : "") + (o.flip_guard ? " flip" : "") +
         (o.order == EcolOrder::rounds ? " rounds" : "");
}

template <class Real, class Index>
void expect_oracle(const TriangleMesh& mesh, const EcolOptions& options, std::span<const std::uint8_t> locked = {}) {
  const EcolResult result = build<Real, Index>(mesh, options, locked);
  ASSERT_EQ(malformed(mesh, result), "") << name(options);
  ASSERT_EQ(difference_of(result, brute_force<Real>(mesh, locked, options)), "")
      << name(options) << (sizeof(Real) == 4 ? " float" : " double") << ", " << mesh.positions.size() << " vertices, "
      << mesh.triangles.size() << " triangles";
}

/// One mesh, all options, precisions and index widths.
void expect_oracle_always(const TriangleMesh& mesh, std::span<const std::uint8_t> locked = {}) {
  for (const EcolOptions& options : all_options()) {
    expect_oracle<float, std::uint32_t>(mesh, options, locked);
    expect_oracle<float, std::uint16_t>(mesh, options, locked);
    expect_oracle<double, std::uint32_t>(mesh, options, locked);
    expect_oracle<double, std::uint16_t>(mesh, options, locked);
    if (testing::Test::HasFatalFailure()) return;
  }
}

std::vector<std::uint8_t> random_mask(std::mt19937& rng, std::size_t vertices, std::uint32_t one_in) {
  std::vector<std::uint8_t> mask(vertices);
  for (auto& m : mask) m = below(rng, one_in) == 0 ? static_cast<std::uint8_t>(1 + below(rng, 255)) : 0;
  return mask;
}

// ---- the worked example ---------------------------------------------------------------------------------------------

/// A mesh that fits [Peng13] Fig 2.1-2.2: a square 3-4-5-7 with 1, 2 and 6 inside; the shortest edge is 6-4, where only
/// 6 may go, then 1-2.
TriangleMesh worked_example() {
  TriangleMesh mesh{{{-1, 0, 0}, {1, 0, 0}, {-4, 4, 0}, {4, 4, 0}, {4, -4, 0}, {3, 3, 0.25f}, {-4, -4, 0}}, {}};
  // 1-based, as printed.
  const std::uint32_t corners[8][3] = {{1, 2, 3}, {1, 3, 7}, {2, 4, 6}, {2, 6, 3},
                                       {3, 6, 4}, {2, 1, 5}, {1, 7, 5}, {2, 5, 4}};
  for (const auto& c : corners) mesh.triangles.push_back({{c[0] - 1, c[1] - 1, c[2] - 1}});
  return mesh;
}

TEST(BuildEcol, WorkedExampleComesOutAsPrinted) {
  const TriangleMesh mesh = worked_example();
  ASSERT_EQ(open_edges(mesh.triangles), (std::set<Edge>{{2, 3}, {3, 4}, {4, 6}, {2, 6}}));  // boundary 3, 4, 5, 7
  const EcolResult r = build(mesh, EcolOptions{.metric = CostMetric::edge_length});
  // In the figure's numbering.
  const auto permute_v = [&](int v) { return r.permute_v[v - 1] + 1; };
  const auto permute_t = [&](int t) { return r.permute_t[t - 1] + 1; };
  const auto target = [&](int v) { return r.ecol[v - 1] + 1; };

  EXPECT_EQ(r.map[7], 8u);
  EXPECT_EQ(target(6), 4u);
  EXPECT_EQ(permute_v(6), 7u);
  EXPECT_EQ(r.map[6], 6u);
  EXPECT_EQ(target(1), 2u);
  EXPECT_EQ(permute_v(1), 6u);
  EXPECT_EQ(permute_t(1), 6u);
  EXPECT_EQ(permute_t(6), 5u);
  EXPECT_EQ(r.map[5], 4u);
  EXPECT_EQ(permute_v(2), 5u);
  EXPECT_EQ(r.min_vertices, 4u);
  EXPECT_EQ(r.map[4], 2u);
  for (const int v : {3, 4, 5, 7}) EXPECT_EQ(r.ecol[v - 1], nowhere) << v;
  EXPECT_EQ(prefixes_differ(mesh, r), "");
}

TEST(BuildEcol, WorkedExampleRearrangesToItsPrefixes) {
  const TriangleMesh mesh = worked_example();
  const EcolResult r = build(mesh, EcolOptions{.metric = CostMetric::edge_length});
  std::vector<glm::vec3> positions(7);
  std::vector<Corners> triangles(8);
  std::vector<std::uint32_t> ecol(7);
  std::vector<std::uint32_t> targets = r.ecol;
  for (std::uint32_t& target : targets)
    if (target == nowhere) target = pgl::no_target<std::uint32_t>;
  pgl::host::rearrange(std::span<const glm::vec3>(mesh.positions), std::span<const Corners>(mesh.triangles),
                       std::span<const std::uint32_t>(targets), std::span<const std::uint32_t>(r.permute_v),
                       std::span<const std::uint32_t>(r.permute_t), std::span<glm::vec3>(positions),
                       std::span<Corners>(triangles), std::span<std::uint32_t>(ecol));
  // The boundary first, in its old order, then 2, 1, 6.
  EXPECT_EQ(positions[4], mesh.positions[1]);
  EXPECT_EQ(positions[5], mesh.positions[0]);
  EXPECT_EQ(positions[6], mesh.positions[5]);
  EXPECT_EQ(ecol[5], 4u);
  for (std::uint32_t v = 0; v < 4; ++v) EXPECT_EQ(ecol[v], pgl::no_target<std::uint32_t>);
  for (std::uint32_t v = 4; v < 7; ++v) EXPECT_LT(ecol[v], v);
  EXPECT_EQ(triangles[5], (Corners{{5, 4, 0}}));  // t1 = (1, 2, 3)
  EXPECT_EQ(triangles[4], (Corners{{4, 5, 2}}));  // t6 = (2, 1, 5)
}

// ---- the rule -------------------------------------------------------------------------------------------------------

TEST(BuildEcolRule, NormalisationFitsTheUnitBallOfEachAxis) {
  std::mt19937 rng(1);
  for (int i = 0; i < 20000; ++i) {
    pgl::Box box;
    const int exponent = static_cast<int>(below(rng, 270)) - 147;
    glm::vec3 p[2];
    for (glm::vec3& q : p)
      for (int axis = 0; axis < 3; ++axis) q[axis] = std::ldexp(signed_unit(rng), std::min(exponent, 127));
    for (int axis = 0; axis < 3; ++axis) {
      box.min[axis] = std::min(p[0][axis], p[1][axis]);
      box.max[axis] = std::max(p[0][axis], p[1][axis]);
    }
    const pgl::Normalisation n = pgl::normalisation(box);
    int dummy = 0;
    ASSERT_EQ(std::frexp(n.scale, &dummy), 0.5) << "a power of two";
    for (const glm::vec3& q : p) {
      const auto fine = pgl::normalise<double>(q, n);
      const auto coarse = pgl::normalise<float>(q, n);
      for (int axis = 0; axis < 3; ++axis) {
        const Quad exact = (Quad(q[axis]) - (Quad(box.min[axis]) + Quad(box.max[axis])) / 2) * Quad(n.scale);
        const Quad size = exact < 0 ? -exact : exact;
        ASSERT_LE(std::fabs(fine[axis]), 1.0);
        const Quad apart = Quad(fine[axis]) - exact;
        ASSERT_LE((apart < 0 ? -apart : apart), Quad(0x1p-51) * size + Quad(0x1p-53L));
        ASSERT_EQ(coarse[axis], static_cast<float>(fine[axis]));
      }
    }
  }
}

TEST(BuildEcolRule, NormalisationOfNothingOrOnePointKeepsTheScale) {
  EXPECT_EQ(pgl::normalisation(pgl::Box{}).scale, 1);
  const pgl::Normalisation n = pgl::normalisation(pgl::Box{{7, 8, 9}, {7, 8, 9}});
  EXPECT_EQ(n.scale, 1);
  EXPECT_EQ(pgl::normalise<float>({7, 8, 9}, n), glm::vec3(0, 0, 0));
}

TEST(BuildEcolRule, CostKeysOrderLikeCosts) {
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(pgl::cost_key(-1.0f), pgl::cost_key(0.0f));
  EXPECT_EQ(pgl::cost_key(-0.0f), pgl::cost_key(0.0f));
  EXPECT_LT(pgl::cost_key(0.0f), pgl::cost_key(1e-45f));
  EXPECT_LT(pgl::cost_key(1.0f), pgl::cost_key(std::nextafter(1.0f, 2.0f)));
  EXPECT_LT(pgl::cost_key(3e38f), pgl::cost_key(inf));
  EXPECT_EQ(pgl::cost_key(nan), pgl::cost_key(inf));
  EXPECT_EQ(pgl::cost_key(-std::numeric_limits<double>::quiet_NaN()), pgl::cost_key(HUGE_VAL));
}

__extension__ using Wide = __int128;

/// Against exact integers: flipped where the cosine is at most 0.2 or the new triangle has no area.
TEST(BuildEcolRule, FlipsExactlyBeyondItsAngle) {
  std::mt19937 rng(2);
  int flipped = 0, no_area = 0, at_the_angle = 0;
  for (int i = 0; i < 200000; ++i) {
    const std::uint32_t range = i % 2 == 0 ? 5 : 200;  // a few places, so that areas vanish; many
    Wide p[4][3];
    pgl::Vector<double> q[4];
    for (int k = 0; k < 4; ++k)
      for (int axis = 0; axis < 3; ++axis) {
        p[k][axis] = static_cast<int>(below(rng, range)) - 2;
        q[k][axis] = static_cast<double>(p[k][axis]);
      }
    Wide n[2][3];
    for (int k = 0; k < 2; ++k)
      for (int x = 0; x < 3; ++x) {
        const int y = (x + 1) % 3, z = (x + 2) % 3;
        n[k][x] = (p[1][y] - p[0][y]) * (p[2 + k][z] - p[0][z]) - (p[1][z] - p[0][z]) * (p[2 + k][y] - p[0][y]);
      }
    const Wide aa = n[0][0] * n[0][0] + n[0][1] * n[0][1] + n[0][2] * n[0][2];
    const Wide bb = n[1][0] * n[1][0] + n[1][1] * n[1][1] + n[1][2] * n[1][2];
    const Wide ab = n[0][0] * n[1][0] + n[0][1] * n[1][1] + n[0][2] * n[1][2];
    if (25 * ab * ab == aa * bb && ab > 0) {
      ++at_the_angle;  // 0.04 is no double: here either answer is right
      continue;
    }
    const bool computed = pgl::flips(q[0], q[1], q[2], q[3]);
    ASSERT_EQ(computed, aa != 0 && !(ab > 0 && 25 * ab * ab > aa * bb));
    flipped += computed;
    no_area += aa == 0 || bb == 0;
  }
  EXPECT_GT(flipped, 10000);
  EXPECT_GT(no_area, 1000);
  EXPECT_LT(at_the_angle, 1000);
}

/// Every candidate at every step of whole simplifications, against binary128 and its bound.
template <class Real>
void expect_exact_costs(const TriangleMesh& mesh, const EcolOptions& options) {
  EcolOracle<Real> oracle(mesh, {}, options);
  QuadCosts<Real> exact(oracle, options);
  for (;;) {
    for (const auto& move : oracle.candidates()) {
      const Bounded cost = exact.cost(move.from, move.to);
      ASSERT_TRUE(cost.holds(oracle.cost(move)))
          << name(options) << ": " << static_cast<double>(oracle.cost(move)) << " for "
          << static_cast<double>(cost.value) << " +- " << static_cast<double>(cost.slack);
      const Bounded distance = exact.plane_distance(move.from, move.to);
      const Real computed = oracle.plane_distance(move);
      ASSERT_TRUE(distance.holds(computed))
          << name(options) << ": distance " << static_cast<double>(computed) << " for "
          << static_cast<double>(distance.value) << " +- " << static_cast<double>(distance.slack);
    }
    const auto move = oracle.best();
    if (!move) return;
    exact.apply(move->from, move->to);
    oracle.apply(*move);
  }
}

TEST(BuildEcolRule, CostsAgreeWithTheFormulasWithinTheirRounding) {
  std::mt19937 rng(3);
  const TriangleMesh meshes[] = {
      jittered(sphere(1), rng, 0.1f),
      jittered(grid(4, 5), rng, 0.4f),
      punctured(jittered(torus(5, 4), rng, 0.05f), rng, 3),
      soup(rng, 12, 30),
      jittered(soup(rng, 15, 25), rng, 1e-4f),
      fan(12, true),
  };
  for (const TriangleMesh& mesh : meshes)
    for (const CostMetric metric : {CostMetric::quadric, CostMetric::melax, CostMetric::edge_length})
      for (const BoundaryRule boundary : {BoundaryRule::locked, BoundaryRule::slide})
        for (const float penalty : {10.0f, 0.01f, 1000.0f}) {
          if (boundary == BoundaryRule::locked && penalty != 10.0f) continue;  // not used
          const EcolOptions options{metric, boundary, false, false, penalty};
          expect_exact_costs<float>(mesh, options);
          expect_exact_costs<double>(mesh, options);
          if (HasFatalFailure()) return;
        }
}

// ---- the driver against brute force ---------------------------------------------------------------------------------

TEST(BuildEcol, EqualsBruteForceOnSmallShapes) {
  std::mt19937 rng(4);
  TriangleMesh isolated = octahedron();
  isolated.positions.push_back({5, 5, 5});
  TriangleMesh repeated = octahedron();
  for (int i = 0; i < 5; ++i) repeated.triangles.push_back(repeated.triangles[static_cast<std::size_t>(i)]);
  TriangleMesh reversed = tetrahedron();
  reversed.triangles.push_back({{1, 2, 0}});
  TriangleMesh one_point = sphere(1);
  for (glm::vec3& p : one_point.positions) p = {1, 2, 3};
  TriangleMesh line = sphere(1);
  for (std::uint32_t v = 0; v < line.vertex_count(); ++v) line.positions[v] = {static_cast<float>(v), 0, 0};
  TriangleMesh all_degenerate{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{{0, 0, 1}}, {{1, 1, 1}}, {{2, 1, 2}}}};
  TriangleMesh some_degenerate = octahedron();
  some_degenerate.triangles.insert(some_degenerate.triangles.begin() + 2, {{3, 3, 1}});
  some_degenerate.triangles.push_back({{0, 2, 0}});
  const TriangleMesh meshes[] = {
      {},
      {{{1, 2, 3}}, {}},
      {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{{0, 1, 2}}}},
      {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {{{0, 1, 2}}, {{2, 1, 3}}}},
      {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{{0, 1, 2}}, {{0, 2, 1}}}},
      tetrahedron(),
      octahedron(),
      bipyramid(9),
      isolated,
      repeated,
      reversed,
      one_point,
      line,
      all_degenerate,
      some_degenerate,
      worked_example(),
      two_tetrahedra(0),
      two_tetrahedra(1),
      two_tetrahedra(2),
      two_tetrahedra(3),
      fan(9, true),
      fan(9, false),
      grid(1, 12),
      grid(5, 4),
      moebius_strip(7),
      moebius_strip(6, 3),
      klein_bottle(5, 4),
      torus(5, 4),
      beside(sphere(1), grid(3, 3)),
      jittered(glued(torus(5, 4), torus(4, 5), 7, 3), rng, 0.05f),
      shuffled(jittered(sphere(1), rng, 0.2f), rng),
  };
  for (const TriangleMesh& mesh : meshes) {
    expect_oracle_always(mesh);
    const auto mask = random_mask(rng, mesh.positions.size(), 3);
    expect_oracle_always(mesh, mask);
    if (HasFatalFailure()) return;
  }
}

TEST(BuildEcol, EqualsBruteForceOnMediumShapes) {
  std::mt19937 rng(5);
  const TriangleMesh meshes[] = {
      shuffled(jittered(sphere(2), rng, 0.05f), rng),
      shuffled(jittered(torus(12, 8), rng, 0.02f), rng),
      shuffled(jittered(grid(9, 9), rng, 0.3f), rng),
      shuffled(punctured(sphere(2), rng, 12), rng),
      grid(8, 8),
  };
  for (const TriangleMesh& mesh : meshes)
    for (const EcolOptions& options : all_options()) {
      const auto mask = random_mask(rng, mesh.positions.size(), 10);
      if (below(rng, 2) == 0)
        expect_oracle<float, std::uint32_t>(mesh, options, mask);
      else
        expect_oracle<double, std::uint16_t>(mesh, options);
      if (HasFatalFailure()) return;
    }
}

TEST(BuildEcol, EqualsBruteForceOnRandomSoups) {
  std::mt19937 rng(6);
  const std::vector<EcolOptions> options = all_options();
  for (int round = 0; round < 12000; ++round) {
    const std::uint32_t vertices = 1 + below(rng, round % 4 == 0 ? 20 : 9);
    TriangleMesh mesh = soup(rng, vertices, 1 + below(rng, round % 4 == 1 ? 40 : 16));
    if (round % 3 == 0) mesh = jittered(mesh, rng, 0.25f);
    EcolOptions o = options[below(rng, static_cast<std::uint32_t>(options.size()))];
    o.boundary_penalty = below(rng, 2) == 0 ? 10.0f : 0.25f;
    std::vector<std::uint8_t> mask;
    if (below(rng, 3) == 0) mask = random_mask(rng, vertices, 4);
    SCOPED_TRACE(round);
    switch (below(rng, 4)) {
      case 0:
        expect_oracle<float, std::uint16_t>(mesh, o, mask);
        break;
      case 1:
        expect_oracle<double, std::uint32_t>(mesh, o, mask);
        break;
      default:
        expect_oracle<float, std::uint32_t>(mesh, o, mask);
    }
    if (HasFatalFailure()) return;
  }
}

TEST(BuildEcol, RoundsEqualBruteForceOnLargerMeshes) {
  std::mt19937 rng(14);
  const TriangleMesh meshes[] = {
      shuffled(jittered(sphere(3), rng, 0.02f), rng), shuffled(jittered(grid(15, 12), rng, 0.3f), rng), grid(14, 14),
      shuffled(punctured(jittered(torus(20, 12), rng, 0.02f), rng, 40), rng), soup(rng, 200, 400)};
  std::uint32_t which = 0;
  for (const TriangleMesh& mesh : meshes)
    for (const BoundaryRule boundary : {BoundaryRule::locked, BoundaryRule::slide})
      for (const bool fine : {false, true}) {
        const CostMetric metric = static_cast<CostMetric>(which++ % 3);
        const EcolOptions options{metric, boundary, which % 4 != 0, which % 5 == 0, 10.0f, EcolOrder::rounds};
        const EcolResult result =
            fine ? build<double, std::uint32_t>(mesh, options) : build<float, std::uint16_t>(mesh, options);
        const EcolResult expected =
            fine ? brute_force<double>(mesh, {}, options) : brute_force<float>(mesh, {}, options);
        ASSERT_EQ(difference_of(result, expected), "") << name(options);
        ASSERT_EQ(fine ? not_allowed<double>(mesh, {}, options, result) : not_allowed<float>(mesh, {}, options, result),
                  "")
            << name(options);
      }
}

/// Too large for brute force at every step: the recorded collapses are replayed, and at some counts the next one is
/// looked for by brute force. At the end nothing may be left to do.
TEST(BuildEcol, TakesTheLeastCollapseOfLargerMeshesAtSampledCounts) {
  std::mt19937 rng(7);
  const TriangleMesh meshes[] = {
      shuffled(jittered(sphere(4), rng, 0.01f), rng), shuffled(jittered(grid(40, 30), rng, 0.3f), rng),
      shuffled(punctured(jittered(torus(50, 30), rng, 0.01f), rng, 200), rng), soup(rng, 800, 1600)};
  std::size_t which = 0;
  for (const TriangleMesh& mesh : meshes)
    for (const BoundaryRule boundary : {BoundaryRule::locked, BoundaryRule::slide}) {
      const CostMetric metric = static_cast<CostMetric>(which++ % 3);
      const EcolOptions options{metric, boundary, which % 4 != 0, which % 3 == 0, 10.0f};
      const EcolResult result = build(mesh, options);
      ASSERT_EQ(malformed(mesh, result), "");
      EcolOracle<float> oracle(mesh, {}, options);
      SequentialCollapse sequence(mesh, result);
      while (!sequence.finished()) {
        const EcolOracle<float>::Move move{sequence.next_from(), sequence.next_to()};
        if (below(rng, mesh.vertex_count()) < 12) {
          const auto best = oracle.best();
          ASSERT_TRUE(best);
          ASSERT_EQ(best->from, move.from) << name(options) << " at " << sequence.vertices_left();
          ASSERT_EQ(best->to, move.to) << name(options) << " at " << sequence.vertices_left();
        }
        oracle.apply(move);
        sequence.step();
      }
      ASSERT_FALSE(oracle.best()) << name(options);
      ASSERT_EQ(difference_of(result, oracle.finish()), "") << name(options);
    }
}

// ---- single shapes, answers known beforehand ------------------------------------------------------------------------

TEST(BuildEcol, OfNothingIsNothing) {
  for (const EcolOrder order : {EcolOrder::greedy, EcolOrder::rounds}) {
    const EcolResult r = build(TriangleMesh{}, EcolOptions{.order = order});
    EXPECT_EQ(r.min_vertices, 0u);
    EXPECT_EQ(r.map, std::vector<std::uint32_t>{0});
    EXPECT_EQ(r.error, std::vector<float>{0});
  }
}

TEST(BuildEcol, KeepsWhatHasNoEdgeToCollapse) {
  const TriangleMesh degenerate{{{0, 0, 0}, {1, 0, 0}}, {{{0, 0, 1}}, {{1, 1, 1}}}};
  for (const EcolOptions& options : all_options()) {
    const EcolResult point = build(TriangleMesh{{{1, 2, 3}}, {}}, options);
    EXPECT_EQ(point.min_vertices, 1u) << name(options);
    EXPECT_EQ(point.ecol[0], nowhere);
    const EcolResult triangle = build(fan(1, false), options);
    EXPECT_EQ(triangle.min_vertices, 3u) << name(options);
    EXPECT_EQ(triangle.map[3], 1u);
    const EcolResult r = build(degenerate, options);
    EXPECT_EQ(r.min_vertices, 2u) << name(options);
    EXPECT_EQ(r.map[2], 2u);
    EXPECT_EQ(r.permute_t, (std::vector<std::uint32_t>{0, 1}));
  }
}

TEST(BuildEcol, LinkConditionKeepsTheTetrahedron) {
  for (EcolOptions options : all_options()) {
    options.link_condition = true;
    options.flip_guard = false;
    EXPECT_EQ(build(tetrahedron(), options).min_vertices, 4u) << name(options);
    EXPECT_EQ(build(octahedron(), options).min_vertices, 4u) << name(options);
    EXPECT_EQ(build(octahedron(), options).map[4], 4u) << name(options);
    EXPECT_EQ(build(two_tetrahedra(1), options).min_vertices, 7u) << name(options);
  }
}

TEST(BuildEcol, GoesFurtherWithoutTheLinkCondition) {
  for (EcolOptions options : all_options()) {
    options.flip_guard = false;
    for (const TriangleMesh& mesh : {tetrahedron(), sphere(2), torus(8, 6)}) {
      options.link_condition = true;
      const std::uint32_t with = build(mesh, options).min_vertices;
      options.link_condition = false;
      const std::uint32_t without = build(mesh, options).min_vertices;
      EXPECT_LT(without, with) << name(options);
    }
  }
}

TEST(BuildEcol, LockedVerticesNeverGo) {
  const TriangleMesh mesh = sphere(2);
  const std::vector<std::uint8_t> all(mesh.positions.size(), 255), none(mesh.positions.size(), 0);
  for (const EcolOptions& options : all_options()) {
    const EcolResult r = build(mesh, options, all);
    EXPECT_EQ(r.min_vertices, mesh.vertex_count());
    for (std::uint32_t v = 0; v < mesh.vertex_count(); ++v) {
      EXPECT_EQ(r.permute_v[v], v);
      EXPECT_EQ(r.ecol[v], nowhere);
    }
    EXPECT_EQ(difference_of(build(mesh, options, none), build(mesh, options)), "");
    std::vector<std::uint8_t> half(mesh.positions.size());
    for (std::size_t v = 0; v < half.size(); v += 2) half[v] = 1;
    const EcolResult h = build(mesh, options, half);
    EXPECT_LT(h.min_vertices, mesh.vertex_count());
    for (std::size_t v = 0; v < half.size(); v += 2) EXPECT_EQ(h.ecol[v], nowhere);
  }
}

TEST(BuildEcol, SlideSimplifiesWhereLockedCannot) {
  for (EcolOptions options : all_options()) {
    options.flip_guard = false;
    options.boundary = BoundaryRule::locked;
    EXPECT_EQ(build(grid(1, 50), options).min_vertices, 102u) << name(options);
    options.boundary = BoundaryRule::slide;
    EXPECT_LE(build(grid(1, 50), options).min_vertices, 4u) << name(options);
    EXPECT_EQ(prefixes_differ(grid(1, 50), build(grid(1, 50), options)), "");
  }
}

TEST(BuildEcol, FlatMeshesHaveNoQuadricErrorAndKeepTheirCorners) {
  const TriangleMesh mesh = grid(8, 8);
  for (const EcolOrder order : {EcolOrder::greedy, EcolOrder::rounds}) {
    const EcolResult r = build(mesh, EcolOptions{.boundary = BoundaryRule::slide, .order = order});
    // Until the four corners are left nothing is lost.
    EXPECT_EQ(r.error[4], 0);
    std::set<std::uint32_t> left;
    for (std::uint32_t v = 0; v < mesh.vertex_count(); ++v)
      if (r.permute_v[v] < 4) left.insert(v);
    EXPECT_EQ(left, (std::set<std::uint32_t>{0, 8, 72, 80}));
  }
}

/// Two far spheres, one a little larger: in rounds both are worked on at the same time, the smaller one first only
/// where its costs are less by more than a factor of two.
TEST(BuildEcol, RoundsWorkEverywhereAtOnce) {
  std::mt19937 rng(15);
  const TriangleMesh one = jittered(sphere(2), rng, 0.05f);
  TriangleMesh other = one;
  for (glm::vec3& p : other.positions) p = {p.x * 1.01f, p.y * 1.01f, p.z * 1.01f};
  const TriangleMesh mesh = beside(one, other, 1000);
  for (const CostMetric metric : {CostMetric::quadric, CostMetric::melax, CostMetric::edge_length}) {
    const EcolOptions options{.metric = metric, .order = EcolOrder::rounds};
    std::vector<std::size_t> sizes, sizes_of_one;
    brute_force<float>(one, {}, options, &sizes_of_one);
    ASSERT_EQ(difference_of(build(mesh, options), brute_force<float>(mesh, {}, options, &sizes)), "");
    EXPECT_LT(sizes.size(), sizes_of_one.size() * 3 / 2);
  }
}

/// A flat mesh in order, all costs equal: were equal costs taken by index, a round would be one collapse.
TEST(BuildEcol, RoundsOfEqualCostsAreLarge) {
  for (const CostMetric metric : {CostMetric::quadric, CostMetric::edge_length}) {
    const TriangleMesh mesh = grid(14, 14);
    const EcolOptions options{.metric = metric, .boundary = BoundaryRule::slide, .order = EcolOrder::rounds};
    std::vector<std::size_t> sizes;
    ASSERT_EQ(difference_of(build(mesh, options), brute_force<float>(mesh, {}, options, &sizes)), "");
    EXPECT_GE(sizes[0], 5u);
  }
}

TEST(BuildEcol, ErrorsAreInModelUnits) {
  // A square pyramid of height 2^-3: its apex goes into a corner at exactly known distances from the four faces.
  TriangleMesh mesh{{{0, 0, 0.125f}, {1, 1, 0}, {-1, 1, 0}, {-1, -1, 0}, {1, -1, 0}},
                    {{{0, 1, 2}}, {{0, 2, 3}}, {{0, 3, 4}}, {{0, 4, 1}}}};
  for (const float size : {1.0f, 0x1p-60f, 0x1p60f}) {
    TriangleMesh scaled = mesh;
    for (glm::vec3& p : scaled.positions) p = {p.x * size, p.y * size, p.z * size};
    const EcolResult r = build(scaled, {});
    ASSERT_EQ(r.min_vertices, 4u);
    // Corner (1,1,0) lies in two of the faces; its distance to the other two, with normals (+-1/8, 1) and the like over
    // sqrt(1 + 1/64), is 1/4 / sqrt(65/64); equal areas.
    const double expected = std::sqrt(2 * (0.0625 / (65.0 / 64)) / 4);
    EXPECT_NEAR(r.error[4] / size, expected, expected * 1e-6);
  }
}

TEST(BuildEcol, RepeatedTrianglesVanishTogether) {
  for (const EcolOptions& options : all_options()) {
    // In rounds the Melax cost of a vertex takes the cube of its triangles.
    const bool cubic = options.metric == CostMetric::melax && options.order == EcolOrder::rounds;
    const std::uint32_t n = cubic ? 60 : 1000;
    TriangleMesh mesh = fan(1, false);
    for (std::uint32_t i = 1; i < n; ++i) mesh.triangles.push_back(mesh.triangles[0]);
    const EcolResult r = build(mesh, options);
    EXPECT_EQ(r.min_vertices, 2u) << name(options);
    EXPECT_EQ(r.map[3], n);
    EXPECT_EQ(r.map[2], 0u);
    for (std::uint32_t t = 0; t < n; ++t) EXPECT_EQ(r.permute_t[t], n - 1 - t);
  }
}

TEST(BuildEcol, DegenerateTrianglesGoWithTheFirstCollapse) {
  TriangleMesh mesh = octahedron();
  mesh.triangles.insert(mesh.triangles.begin(), {{1, 1, 4}});
  mesh.triangles.push_back({{2, 2, 2}});
  for (const EcolOrder order : {EcolOrder::greedy, EcolOrder::rounds}) {
    const EcolResult r = build(mesh, EcolOptions{.order = order});
    EXPECT_EQ(r.map[6], 10u);
    EXPECT_EQ(r.map[5], 6u);
    EXPECT_EQ(r.permute_t[0], 9u);  // the first by index goes to the very end
    EXPECT_EQ(r.permute_t[9], 6u);
    EXPECT_EQ(prefixes_differ(mesh, r), "");
  }
}

TEST(BuildEcol, EqualCostsGoByIndex) {
  // All on one point: every cost is 0, so the first allowed pair by (from, to) goes.
  TriangleMesh mesh = sphere(2);
  for (glm::vec3& p : mesh.positions) p = {0, 0, 0};
  for (EcolOptions options : all_options()) {
    options.flip_guard = options.link_condition = false;
    if (options.order == EcolOrder::rounds) continue;
    const EcolResult r = build(mesh, options);
    const std::uint32_t first = mesh.vertex_count() - 1;
    EXPECT_EQ(r.permute_v[0], first);
    std::uint32_t neighbour = nowhere;
    for (const Corners& t : mesh.triangles)
      if (t.v[0] == 0 || t.v[1] == 0 || t.v[2] == 0)
        for (const std::uint32_t c : t.v)
          if (c != 0) neighbour = std::min(neighbour, c);
    EXPECT_EQ(r.ecol[0], neighbour);
    EXPECT_EQ(r.error[r.min_vertices], 0);
  }
}

// ---- large, long, tiny, huge, not numbers ---------------------------------------------------------------------------

TEST(BuildEcol, CopesWithVerticesOfManyTriangles) {
  for (EcolOptions options : all_options()) {
    if (options.flip_guard || !options.link_condition) continue;
    // Melax costs grow with the square of the valence; a hub that takes part in every collapse makes every round one.
    const std::uint32_t n = options.metric == CostMetric::melax  ? 200
                            : options.order == EcolOrder::rounds ? 1000
                                                                 : 5000;
    for (const TriangleMesh& mesh : {fan(n, true), bipyramid(n / 4)}) {
      const EcolResult r = build(mesh, options);
      ASSERT_EQ(malformed(mesh, r), "") << name(options);
      EXPECT_LE(r.map[r.min_vertices], r.map[mesh.vertex_count()]);
    }
  }
}

TEST(BuildEcol, CopesWithLongStrips) {
  std::mt19937 rng(13);
  for (const EcolOrder order : {EcolOrder::greedy, EcolOrder::rounds})
    for (const CostMetric metric : {CostMetric::quadric, CostMetric::melax, CostMetric::edge_length}) {
      const EcolOptions options{.metric = metric, .boundary = BoundaryRule::slide, .order = order};
      // In order, every cost is equal and one vertex eats its way along, with ever more triangles.
      for (const TriangleMesh& mesh : {grid(1, 300), shuffled(grid(1, 20000), rng)}) {
        const EcolResult r = build(mesh, options);
        EXPECT_EQ(malformed(mesh, r), "");
        EXPECT_LE(r.min_vertices, 4u);
      }
    }
}

/// One hub runs along its whole rim: every collapse moves all its triangles to the next vertex. Memory stays linear.
TEST(BuildEcol, MemoryStaysLinearWhenAHubWanders) {
  const std::uint32_t n = 3000;
  TriangleMesh mesh = bipyramid(n);
  // The hub is vertex 0, and the rim runs away from it in growing steps; the other hub is far off.
  mesh.positions[0] = {0, 0, 0};
  mesh.positions[1] = {0, 0, 4096};
  float at = 1;
  for (std::uint32_t i = 0; i < n; ++i, at += 1.0f + 0x1p-12f * static_cast<float>(i))
    mesh.positions[2 + i] = {at, 0, 0};
  std::vector<std::uint8_t> locked(mesh.positions.size(), 0);
  locked[1] = 1;
  pgl::host::EcolWorkspace<float> workspace;
  const std::size_t before = allocated_bytes;
  const EcolResult r =
      build<float, std::uint32_t>(mesh, locked, EcolOptions{.metric = CostMetric::edge_length}, workspace);
  const std::size_t used = allocated_bytes - before;
  ASSERT_EQ(malformed(mesh, r), "");
  std::uint32_t chain = 0;
  for (std::uint32_t v = 0; r.ecol[v] != nowhere; v = r.ecol[v]) ++chain;
  EXPECT_GT(chain, n / 2) << "the mesh no longer does what this test is about";
  EXPECT_LT(used, 1000 * (mesh.positions.size() + mesh.triangles.size()));
}

TEST(BuildEcol, AllocatesNothingOnceWarm) {
  std::mt19937 rng(8);
  const TriangleMesh big = shuffled(punctured(jittered(sphere(3), rng, 0.02f), rng, 40), rng);
  const TriangleMesh small = jittered(grid(6, 6), rng, 0.2f);
  for (const EcolOptions& options : all_options()) {
    pgl::host::EcolWorkspace<float> workspace;
    const std::uint32_t vertices = big.vertex_count();
    std::vector<std::uint32_t> ecol(vertices), permute_v(vertices), permute_t(big.triangles.size()), map(vertices + 1);
    std::vector<float> error(vertices + 1);
    const auto run = [&](const TriangleMesh& mesh) {
      const std::size_t v = mesh.positions.size(), t = mesh.triangles.size();
      const std::size_t before = allocations;
      pgl::host::build_ecol<float>(std::span<const glm::vec3>(mesh.positions), std::span<const Corners>(mesh.triangles),
                                   {}, options, workspace, std::span(ecol).first(v), std::span(permute_v).first(v),
                                   std::span(permute_t).first(t), std::span(map).first(v + 1),
                                   std::span(error).first(v + 1));
      return allocations - before;
    };
    run(big);
    EXPECT_EQ(run(big), 0u) << name(options);
    EXPECT_EQ(run(small), 0u) << name(options);
    EXPECT_EQ(run(big), 0u) << name(options);
  }
}

TEST(BuildEcol, TakesAllOfSixteenBits) {
  // The most vertices that 16-bit indices can name beside no_target. The last one is a target: its neighbour before it
  // lies in the same place.
  std::mt19937 rng(9);
  TriangleMesh mesh = jittered(torus(255, 257), rng, 0.001f);
  ASSERT_EQ(mesh.positions.size(), 65535u);
  mesh.positions[65533] = mesh.positions[65534];
  for (const EcolOrder order : {EcolOrder::greedy, EcolOrder::rounds}) {
    const EcolOptions options{.order = order};
    const EcolResult wide = build<float, std::uint32_t>(mesh, options);
    const EcolResult narrow = build<float, std::uint16_t>(mesh, options);
    EXPECT_EQ(narrow.ecol[65533], 65534u);
    ASSERT_EQ(malformed(mesh, narrow), "");
    EXPECT_EQ(difference_of(wide, narrow), "");
  }
}

TEST(BuildEcol, SizeDoesNotMatter) {
  std::mt19937 rng(10);
  for (const float size : {1e-30f, 1e30f, 1e-38f, 3e-43f, 1e38f}) {
    for (TriangleMesh mesh : {sphere(1), grid(4, 4), jittered(torus(5, 5), rng, 0.1f)}) {
      for (glm::vec3& p : mesh.positions) p = {p.x * size, p.y * size, p.z * size};
      for (const EcolOptions& options : all_options()) {
        if (options.flip_guard) continue;
        expect_oracle<float, std::uint32_t>(mesh, options);
        expect_oracle<double, std::uint32_t>(mesh, options);
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST(BuildEcol, AcceptsCoordinatesThatAreNoNumbers) {
  std::mt19937 rng(11);
  const float strange[] = {std::numeric_limits<float>::quiet_NaN(),
                           std::numeric_limits<float>::infinity(),
                           -std::numeric_limits<float>::infinity(),
                           3.4e38f,
                           -3.4e38f,
                           1e-45f};
  for (int round = 0; round < 30; ++round) {
    TriangleMesh mesh = round % 2 == 0 ? jittered(sphere(1), rng, 0.1f) : grid(4, 4);
    const std::uint32_t count = round % 10 == 0 ? 3 * mesh.vertex_count() : 1 + below(rng, 8);
    for (std::uint32_t i = 0; i < count; ++i)
      mesh.positions[below(rng, mesh.vertex_count())][static_cast<int>(below(rng, 3))] = strange[below(rng, 6)];
    for (const EcolOptions& options : all_options()) {
      const EcolResult r = build(mesh, options);
      ASSERT_EQ(prefixes_differ(mesh, r), "") << name(options);
      for (std::uint32_t k = r.min_vertices; k < r.error.size(); ++k) ASSERT_FALSE(std::isnan(r.error[k]));
      ASSERT_EQ(difference_of(r, brute_force<float>(mesh, {}, options)), "") << name(options);
    }
  }
}

TEST(BuildEcol, ErrorsAreOptionalAndChangeNothing) {
  std::mt19937 rng(12);
  const TriangleMesh mesh = jittered(sphere(2), rng, 0.05f);
  for (const EcolOptions& options : all_options()) {
    pgl::host::EcolWorkspace<float> workspace;
    const EcolResult with = build<float, std::uint32_t>(mesh, {}, options, workspace, true);
    const EcolResult without = build<float, std::uint32_t>(mesh, {}, options, workspace, false);
    EXPECT_EQ(difference_of(with, without), "") << name(options);
  }
}

// ---- many threads, many meshes --------------------------------------------------------------------------------------

/// The number of threads while it lives.
class Threads {
 public:
  explicit Threads([[maybe_unused]] int count) {
#if defined(_OPENMP)
    omp_set_num_threads(count);
#endif
  }
  ~Threads() {
#if defined(_OPENMP)
    omp_set_num_threads(before_);
#endif
  }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;

 private:
  [[maybe_unused]] int before_ = static_cast<int>(pgl::host::thread_count());
};

TEST(BuildEcol, ThreadsChangeNoBit) {
  std::mt19937 rng(16);
  TriangleMesh soups;
  for (int i = 0; i < 300; ++i) soups = beside(soups, soup(rng, 20, 60), 0.5f * static_cast<float>(i));
  struct {
    TriangleMesh mesh;
    CostMetric metric;
    BoundaryRule boundary;
    bool link_condition;
  } const cases[] = {
      {shuffled(jittered(torus(150, 100), rng, 0.01f), rng), CostMetric::quadric, BoundaryRule::locked, true},
      {shuffled(grid(80, 80), rng), CostMetric::quadric, BoundaryRule::slide, true},  // nearly all costs are equal
      {shuffled(punctured(jittered(torus(120, 110), rng, 0.01f), rng, 2000), rng), CostMetric::melax,
       BoundaryRule::slide, true},
      {soups, CostMetric::edge_length, BoundaryRule::slide, false}};
  for (const auto& [mesh, metric, boundary, link_condition] : cases) {
    const EcolOptions options{metric, boundary, link_condition, link_condition, 10.0f, EcolOrder::rounds};
    EcolResult expected;
    pgl::host::EcolWorkspace<float> workspace;
    for (const int threads : {1, 2, 4}) {
      const Threads scope(threads);
      const EcolResult r = build<float, std::uint32_t>(mesh, {}, options, workspace);
      if (threads == 1) {
        expected = r;
        ASSERT_EQ(malformed(mesh, r), "") << name(options);
        ASSERT_LT(r.min_vertices, mesh.vertex_count()) << name(options);
      }
      ASSERT_EQ(difference_of(r, expected), "") << name(options) << " on " << threads << " threads";
    }
  }
}

/// The outputs of many meshes in shared arrays, with places between them that are nobody's.
template <class Real, class Index>
void expect_batch_equals_single_calls(const std::vector<TriangleMesh>& meshes, const EcolOptions& options,
                                      bool with_locks, bool with_error, std::mt19937& rng) {
  const std::size_t count = meshes.size();
  std::vector<std::size_t> order(count);
  for (std::size_t i = 0; i < count; ++i) {
    order[i] = i;
    std::swap(order[i], order[below(rng, static_cast<std::uint32_t>(i + 1))]);
  }
  std::vector<pgl::MeshRange> ranges(count);
  std::uint64_t vertices = below(rng, 3), triangles = below(rng, 3), entries = below(rng, 3);
  for (const std::size_t i : order) {  // in memory the meshes lie in another order than in the list
    ranges[i] = {vertices, triangles, entries, meshes[i].vertex_count(), meshes[i].triangle_count()};
    vertices += meshes[i].positions.size() + below(rng, 3);
    triangles += meshes[i].triangles.size() + below(rng, 3);
    entries += meshes[i].positions.size() + 1 + below(rng, 3);
  }
  constexpr Index foreign = static_cast<Index>(0x5A5A5A5A);
  std::vector<glm::vec3> positions(vertices, glm::vec3(std::numeric_limits<float>::quiet_NaN()));
  std::vector<pgl::Triangle<Index>> corners(triangles, {{foreign, foreign, foreign}});
  std::vector<std::uint8_t> locked(with_locks ? vertices : 0, 1);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t v = ranges[i].first_vertex, t = ranges[i].first_triangle;
    std::copy(meshes[i].positions.begin(), meshes[i].positions.end(), positions.begin() + static_cast<long>(v));
    for (std::size_t k = 0; k < meshes[i].triangles.size(); ++k)
      for (int c = 0; c < 3; ++c) corners[t + k].v[c] = static_cast<Index>(meshes[i].triangles[k].v[c]);
    for (std::size_t k = 0; with_locks && k < meshes[i].positions.size(); ++k)
      locked[v + k] = static_cast<std::uint8_t>(below(rng, 6) == 0);
  }

  // What single calls give, into the same arrays.
  struct Outputs {
    std::vector<Index> ecol, permute_v;
    std::vector<std::uint32_t> permute_t, map;
    std::vector<float> error;
    std::vector<std::uint32_t> min_vertices;
    bool operator==(const Outputs&) const = default;
  };
  const Outputs untouched{std::vector<Index>(vertices, foreign),
                          std::vector<Index>(vertices, foreign),
                          std::vector<std::uint32_t>(triangles, 0x5A5A5A5A),
                          std::vector<std::uint32_t>(entries, 0x5A5A5A5A),
                          std::vector<float>(with_error ? entries : 0, -1.0f),
                          std::vector<std::uint32_t>(count, 0x5A5A5A5A)};
  Outputs expected = untouched;
  for (std::size_t i = 0; i < count; ++i) {
    const pgl::MeshRange& m = ranges[i];
    pgl::host::EcolWorkspace<Real> workspace;
    const auto part = [](auto& array, std::uint64_t first, std::size_t size) {
      return array.empty() ? std::span(array) : std::span(array).subspan(first, size);
    };
    expected.min_vertices[i] = pgl::host::build_ecol<Real, Index>(
        part(positions, m.first_vertex, m.vertices), part(corners, m.first_triangle, m.triangles),
        part(locked, m.first_vertex, m.vertices), options, workspace, part(expected.ecol, m.first_vertex, m.vertices),
        part(expected.permute_v, m.first_vertex, m.vertices), part(expected.permute_t, m.first_triangle, m.triangles),
        part(expected.map, m.first_map, m.vertices + 1u), part(expected.error, m.first_map, m.vertices + 1u));
  }
  std::vector<pgl::host::EcolWorkspace<Real>> workspaces;
  for (const int threads : {1, 2, 4}) {
    const Threads scope(threads);
    Outputs out = untouched;
    pgl::host::build_ecol<Real, Index>(ranges, positions, corners, locked, options, workspaces, out.ecol, out.permute_v,
                                       out.permute_t, out.map, out.error, out.min_vertices);
    ASSERT_TRUE(out == expected) << name(options) << " on " << threads << " threads";
  }
}

TEST(BuildEcol, BatchesEqualSingleCallsAndLeaveTheGapsAlone) {
  std::mt19937 rng(17);
  std::vector<TriangleMesh> meshes{{}, {{{1, 2, 3}}, {}}, octahedron(), {}, fan(7, false)};
  meshes.push_back({{{0, 0, 0}, {1, 0, 0}}, {{{0, 0, 1}}, {{1, 1, 1}}}});
  for (int i = 0; i < 40; ++i) {
    meshes.push_back(soup(rng, 1 + below(rng, 20), below(rng, 40)));
    meshes.push_back(jittered(sphere(static_cast<int>(below(rng, 3))), rng, 0.1f));
    meshes.push_back(shuffled(jittered(grid(1 + below(rng, 6), 1 + below(rng, 6)), rng, 0.2f), rng));
  }
  std::uint32_t which = 0;
  for (const EcolOptions& options : all_options()) {
    const bool with_locks = which % 2 != 0, with_error = which % 3 != 0;
    switch (which++ % 4) {
      case 0:
        expect_batch_equals_single_calls<float, std::uint32_t>(meshes, options, with_locks, with_error, rng);
        break;
      case 1:
        expect_batch_equals_single_calls<double, std::uint16_t>(meshes, options, with_locks, with_error, rng);
        break;
      case 2:
        expect_batch_equals_single_calls<float, std::uint16_t>(meshes, options, with_locks, with_error, rng);
        break;
      default:
        expect_batch_equals_single_calls<double, std::uint32_t>(meshes, options, with_locks, with_error, rng);
    }
    if (HasFatalFailure()) return;
  }
}

TEST(BuildEcol, OfNoMeshesIsNothing) {
  std::vector<pgl::host::EcolWorkspace<float>> workspaces;
  std::vector<std::uint32_t> permute_t{7}, map{7}, ecol{7}, permute_v{7};
  const std::vector<glm::vec3> positions{{0, 0, 0}};
  const std::vector<Corners> triangles{{{0, 0, 0}}};
  pgl::host::build_ecol<float, std::uint32_t>({}, positions, triangles, {}, {}, workspaces, ecol, permute_v, permute_t,
                                              map, {}, {});
  for (const auto& array : {permute_t, map, ecol, permute_v}) EXPECT_EQ(array, std::vector<std::uint32_t>{7});
}

TEST(BuildEcol, BatchesAllocateNothingOnceWarm) {
  std::mt19937 rng(18);
  std::vector<glm::vec3> positions;
  std::vector<Corners> triangles;
  std::vector<pgl::MeshRange> ranges;
  std::uint64_t entries = 0;
  for (int i = 0; i < 30; ++i) {
    const TriangleMesh mesh = jittered(sphere(1), rng, 0.1f);
    ranges.push_back({positions.size(), triangles.size(), entries, mesh.vertex_count(), mesh.triangle_count()});
    positions.insert(positions.end(), mesh.positions.begin(), mesh.positions.end());
    triangles.insert(triangles.end(), mesh.triangles.begin(), mesh.triangles.end());
    entries += mesh.positions.size() + 1;
  }
  std::vector<std::uint32_t> ecol(positions.size()), permute_v(positions.size()), permute_t(triangles.size()),
      map(entries), min_vertices(ranges.size());
  const Threads one(1);
  for (const EcolOptions& options : all_options()) {
    std::vector<pgl::host::EcolWorkspace<float>> workspaces;
    const auto run = [&] {
      const std::size_t before = allocations;
      pgl::host::build_ecol<float, std::uint32_t>(ranges, positions, triangles, {}, options, workspaces, ecol,
                                                  permute_v, permute_t, map, {}, min_vertices);
      return allocations - before;
    };
    run();
    EXPECT_EQ(run(), 0u) << name(options);
  }
}

}  // namespace
