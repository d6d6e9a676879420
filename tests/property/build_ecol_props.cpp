// SPDX-License-Identifier: MIT
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cstdlib>

#include "pgl/host/build_ecol.hpp"
#include "support/ecol_cases.hpp"
#include "support/ecol_oracle.hpp"

namespace {

using namespace test;
using pgl::BoundaryRule;
using pgl::CostMetric;
using pgl::EcolOptions;
using pgl::EcolOrder;

// A case takes a fraction of a millisecond: try more than the usual 100 unless told otherwise.
[[maybe_unused]] const int more_cases = setenv("RC_PARAMS", "max_success=500", 0);

// ---- what is tried --------------------------------------------------------------------------------------------------

using Case = EcolCase;

/// A random case of one of the kinds, in either order.
Case random_case(std::initializer_list<Kind> kinds) {
  const auto seed = *rc::gen::arbitrary<std::uint32_t>().as("seed");
  Case c = random_ecol_case(seed, kinds);
  c.options.order = *rc::gen::element(EcolOrder::greedy, EcolOrder::rounds);
  return c;
}

EcolResult run(const Case& c) {
  return c.fine ? build<double, std::uint32_t>(c.mesh, c.options, c.locked)
                : build<float, std::uint32_t>(c.mesh, c.options, c.locked);
}

void classify(const Case& c, const EcolResult& r) {
  const char* kind[] = {"closed", "one-sided", "open", "soup"};
  RC_TAG(std::string(kind[static_cast<int>(c.kind)]),
         std::string(c.options.order == EcolOrder::greedy ? "greedy" : "rounds"),
         std::string(r.min_vertices == c.mesh.vertex_count()      ? "nothing collapses"
                     : 2 * r.min_vertices > c.mesh.vertex_count() ? "more than half is left"
                                                                  : "less than half is left"));
}

// ---- the mesh at every count ----------------------------------------------------------------------------------------

RC_GTEST_PROP(BuildEcolProps, everyPrefixEqualsCollapsingOneVertexAtATime, ()) {
  const Case c = random_case({Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
  const EcolResult r = run(c);
  classify(c, r);
  RC_ASSERT(prefixes_differ(c.mesh, r) == "");
}

RC_GTEST_PROP(BuildEcolProps, closedManifoldsStayClosedManifoldsOfTheSameGenus, ()) {
  Case c = random_case({Kind::closed, Kind::closed, Kind::one_sided});
  c.options.link_condition = true;
  const bool oriented = c.kind == Kind::closed;
  const std::uint32_t vertices = c.mesh.vertex_count();
  RC_ASSERT(not_closed_manifold(c.mesh.triangles, vertices, oriented) == "");
  const std::int64_t euler = euler_characteristic(c.mesh.triangles, vertices);
  const EcolResult r = run(c);
  classify(c, r);
  RC_CLASSIFY(euler != 2, "not a sphere");
  const Rearranged ordered = rearranged(c.mesh, r);
  for (std::uint32_t k = vertices; k >= r.min_vertices; --k) {
    const std::vector<Corners> prefix = reformed_prefix(ordered, r, k);
    RC_ASSERT(not_closed_manifold(prefix, k, oriented) == "");
    RC_ASSERT(euler_characteristic(prefix, k) == euler);
  }
}

RC_GTEST_PROP(BuildEcolProps, lockedBoundariesKeepExactlyTheirOpenEdges, ()) {
  Case c = random_case({Kind::open, Kind::soup});
  c.options.boundary = BoundaryRule::locked;
  const EcolResult r = run(c);
  classify(c, r);
  const std::set<Edge> open = open_edges(c.mesh.triangles);
  RC_CLASSIFY(open.empty(), "no open edge");
  for (SequentialCollapse sequence(c.mesh, r); !sequence.finished();) {
    sequence.step();
    RC_ASSERT(open_edges(sequence.triangles()) == open);
  }
}

/// Where each vertex has gone when the sequence has come to its present count.
std::vector<std::uint32_t> images(const Case& c, const EcolResult& r, std::uint32_t left) {
  std::vector<std::uint32_t> image(c.mesh.positions.size());
  for (std::uint32_t v = 0; v < image.size(); ++v) {
    image[v] = v;
    while (r.permute_v[image[v]] >= left) image[v] = r.ecol[image[v]];
  }
  return image;
}

RC_GTEST_PROP(BuildEcolProps, slidingMakesNoNewBorder, ()) {
  Case c = random_case({Kind::open, Kind::open, Kind::soup});
  c.options.boundary = BoundaryRule::slide;
  const EcolResult r = run(c);
  classify(c, r);
  const std::set<Edge> open = open_edges(c.mesh.triangles);
  bool moved = false;
  for (const Edge& e : open) moved = moved || r.ecol[e.first] != nowhere || r.ecol[e.second] != nowhere;
  RC_CLASSIFY(moved, "a border moves");
  for (SequentialCollapse sequence(c.mesh, r); !sequence.finished();) {
    sequence.step();
    const std::vector<std::uint32_t> image = images(c, r, sequence.vertices_left());
    std::set<Edge> allowed;
    for (const Edge& e : open) allowed.insert(std::minmax(image[e.first], image[e.second]));
    for (const Edge& e : open_edges(sequence.triangles())) RC_ASSERT(allowed.contains(e));
  }
}

RC_GTEST_PROP(BuildEcolProps, oddEdgesOfEveryPrefixAreTheImageOfTheInputs, ()) {
  const Case c = random_case({Kind::closed, Kind::one_sided, Kind::open, Kind::soup, Kind::soup});
  const EcolResult r = run(c);
  classify(c, r);
  const std::set<Edge> odd = odd_edges(c.mesh.triangles);
  const Rearranged ordered = rearranged(c.mesh, r);
  for (std::uint32_t k = c.mesh.vertex_count(); k >= r.min_vertices && k > 0; --k) {
    const std::vector<std::uint32_t> image = images(c, r, k);
    std::set<Edge> expected;
    for (const Edge& e : odd) {
      const std::uint32_t a = r.permute_v[image[e.first]], b = r.permute_v[image[e.second]];
      if (a == b) continue;
      const Edge moved = std::minmax(a, b);
      if (!expected.insert(moved).second) expected.erase(moved);
    }
    RC_ASSERT(odd_edges(reformed_prefix(ordered, r, k)) == expected);
  }
}

/// The vertices of open edges on locked boundaries, and those of the mask, stay where they are.
RC_GTEST_PROP(BuildEcolProps, lockedVerticesHaveNoTarget, ()) {
  Case c = random_case({Kind::closed, Kind::open, Kind::soup});
  c.options.boundary = BoundaryRule::locked;
  const EcolResult r = run(c);
  classify(c, r);
  for (const Edge& e : open_edges(c.mesh.triangles))
    RC_ASSERT(r.ecol[e.first] == nowhere && r.ecol[e.second] == nowhere);
  for (std::size_t v = 0; v < c.locked.size(); ++v) RC_ASSERT(c.locked[v] == 0 || r.ecol[v] == nowhere);
}

__extension__ using Wide = __int128;

/// Twice the area, as a vector, in whole numbers.
std::array<Wide, 3> whole_normal(const TriangleMesh& mesh, const Corners& t) {
  Wide p[3][3];
  for (int i = 0; i < 3; ++i)
    for (int axis = 0; axis < 3; ++axis) p[i][axis] = static_cast<Wide>(mesh.positions[t.v[i]][axis]);
  std::array<Wide, 3> n;
  for (int x = 0; x < 3; ++x) {
    const int y = (x + 1) % 3, z = (x + 2) % 3;
    n[static_cast<std::size_t>(x)] =
        (p[1][y] - p[0][y]) * (p[2][z] - p[0][z]) - (p[1][z] - p[0][z]) * (p[2][y] - p[0][y]);
  }
  return n;
}

RC_GTEST_PROP(BuildEcolProps, flipGuardLetsNoTriangleTurn, ()) {
  Case c = random_case({Kind::closed, Kind::open, Kind::soup});
  c.mesh = on_lattice(c.mesh, 64);
  c.options.flip_guard = true;
  const EcolResult r = run(c);
  classify(c, r);
  std::size_t turned = 0;
  for (SequentialCollapse sequence(c.mesh, r); !sequence.finished();) {
    std::vector<Corners> before;
    for (std::uint32_t t = 0; t < c.mesh.triangle_count(); ++t) before.push_back(sequence.corners(t));
    sequence.step();
    for (std::uint32_t t = 0; t < c.mesh.triangle_count(); ++t) {
      if (!sequence.alive(t) || before[t] == sequence.corners(t)) continue;
      const auto a = whole_normal(c.mesh, before[t]), b = whole_normal(c.mesh, sequence.corners(t));
      const Wide aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2], bb = b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
      const Wide ab = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
      if (aa == 0) continue;
      RC_ASSERT(ab > 0);
      RC_ASSERT(25 * ab * ab >= aa * bb);  // cosine at least 0.2
      turned += ab * ab != aa * bb;
    }
  }
  RC_CLASSIFY(turned > 0, "triangles turn somewhat");
}

// ---- what must not matter -------------------------------------------------------------------------------------------

RC_GTEST_PROP(BuildEcolProps, equalsBruteForce, ()) {
  const Case c = random_case({Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
  const EcolResult r = run(c);
  classify(c, r);
  RC_ASSERT(difference_of(r, c.fine ? brute_force<double>(c.mesh, c.locked, c.options)
                                    : brute_force<float>(c.mesh, c.locked, c.options)) == "");
}

/// The collapses of one round are done one after another: each is allowed when its turn comes.
RC_GTEST_PROP(BuildEcolProps, everyCollapseIsAllowedWhenItsTurnComes, ()) {
  const Case c = random_case({Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
  const EcolResult r = run(c);
  classify(c, r);
  RC_ASSERT((c.fine ? not_allowed<double>(c.mesh, c.locked, c.options, r)
                    : not_allowed<float>(c.mesh, c.locked, c.options, r)) == "");
}

RC_GTEST_PROP(BuildEcolProps, bothOrdersAgreeOnWhetherAnythingCollapses, ()) {
  Case c = random_case({Kind::closed, Kind::open, Kind::soup});
  c.options.order = EcolOrder::greedy;
  const EcolResult greedy = run(c);
  c.options.order = EcolOrder::rounds;
  const EcolResult rounds = run(c);
  classify(c, rounds);
  RC_ASSERT((greedy.min_vertices == c.mesh.vertex_count()) == (rounds.min_vertices == c.mesh.vertex_count()));
}

RC_GTEST_PROP(BuildEcolProps, equalsBruteForceAtExtremePositions, ()) {
  Case c = random_case({Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
  std::mt19937 rng(*rc::gen::arbitrary<std::uint32_t>());
  make_extreme(c, rng);
  const EcolResult r = run(c);
  classify(c, r);
  RC_ASSERT(difference_of(r, c.fine ? brute_force<double>(c.mesh, c.locked, c.options)
                                    : brute_force<float>(c.mesh, c.locked, c.options)) == "");
}

/// The same with lists that RapidCheck can make smaller.
RC_GTEST_PROP(BuildEcolProps, equalsBruteForceOnAnyListOfTriangles, ()) {
  const auto vertices = *rc::gen::inRange<std::uint32_t>(1, 9);
  const auto count = *rc::gen::inRange<std::size_t>(0, 25);
  const auto corner = rc::gen::inRange<std::uint32_t>(0, vertices);
  TriangleMesh mesh;
  for (const auto& [a, b, c] :
       *rc::gen::container<std::vector<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>>>(
           count, rc::gen::tuple(corner, corner, corner)))
    mesh.triangles.push_back({{a, b, c}});
  for (std::uint32_t v = 0; v < vertices; ++v) {
    const auto [x, y, z] = *rc::gen::tuple(rc::gen::inRange(-3, 4), rc::gen::inRange(-3, 4), rc::gen::inRange(-1, 2));
    mesh.positions.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
  }
  const auto locked = *rc::gen::container<std::vector<std::uint8_t>>(
      vertices, rc::gen::weightedElement<std::uint8_t>({{4, std::uint8_t{0}}, {1, std::uint8_t{1}}}));
  const EcolOptions options{*rc::gen::element(CostMetric::edge_length, CostMetric::quadric, CostMetric::melax),
                            *rc::gen::element(BoundaryRule::locked, BoundaryRule::slide),
                            *rc::gen::arbitrary<bool>(),
                            *rc::gen::arbitrary<bool>(),
                            10.0f,
                            *rc::gen::element(EcolOrder::greedy, EcolOrder::rounds)};
  const EcolResult r = build<float, std::uint16_t>(mesh, options, locked);
  RC_CLASSIFY(r.min_vertices == vertices, "nothing collapses");
  RC_CLASSIFY(r.map[r.min_vertices] == 0, "nothing is left");
  RC_ASSERT(prefixes_differ(mesh, r) == "");
  RC_ASSERT(difference_of(r, brute_force<float>(mesh, locked, options)) == "");
}

RC_GTEST_PROP(BuildEcolProps, scalingByAPowerOfTwoChangesNoBit, ()) {
  Case c = random_case({Kind::closed, Kind::open, Kind::soup});
  c.mesh = on_lattice(c.mesh, 64);  // so that the least subnormals hold them too
  const EcolResult expected = run(c);
  classify(c, expected);
  const int exponent = *rc::gen::inRange(-149, 117);
  RC_CLASSIFY(exponent < -126, "subnormal coordinates");
  Case scaled = c;
  for (glm::vec3& p : scaled.mesh.positions)
    for (int axis = 0; axis < 3; ++axis) p[axis] = std::ldexp(p[axis], exponent);
  EcolResult r = run(scaled);
  // The error scales along; it is rounded once more only where it is subnormal.
  for (std::uint32_t k = r.min_vertices; k < r.error.size(); ++k) {
    const float exact = std::ldexp(expected.error[k], exponent);
    if (c.fine && exact < std::numeric_limits<float>::min())
      RC_ASSERT(std::fabs(r.error[k] - exact) <= std::numeric_limits<float>::denorm_min());
    else
      RC_ASSERT(pgl::ieee::to_bits(r.error[k]) == pgl::ieee::to_bits(exact));
  }
  r.error.clear();
  RC_ASSERT(difference_of(r, expected) == "");
}

RC_GTEST_PROP(BuildEcolProps, movingWithoutLossChangesNoBit, ()) {
  Case c = random_case({Kind::closed, Kind::open, Kind::soup});
  c.mesh = on_lattice(c.mesh, 64);
  const EcolResult expected = run(c);
  classify(c, expected);
  const auto step = rc::gen::inRange(-(1 << 23), 1 << 23);
  const auto [x, y, z] = *rc::gen::tuple(step, step, step);
  for (glm::vec3& p : c.mesh.positions) {
    const glm::vec3 q{p.x + static_cast<float>(x), p.y + static_cast<float>(y), p.z + static_cast<float>(z)};
    RC_ASSERT(q.x - static_cast<float>(x) == p.x && q.y - static_cast<float>(y) == p.y &&
              q.z - static_cast<float>(z) == p.z);
    p = q;
  }
  RC_ASSERT(difference_of(run(c), expected) == "");
}

RC_GTEST_PROP(BuildEcolProps, mirroringChangesNoBit, ()) {
  Case c = random_case({Kind::closed, Kind::open, Kind::soup});
  const EcolResult expected = run(c);
  classify(c, expected);
  const int axis = *rc::gen::inRange(0, 3);
  for (glm::vec3& p : c.mesh.positions) p[axis] = -p[axis];
  RC_ASSERT(difference_of(run(c), expected) == "");
}

/// With sliding borders the open edges of one triangle are summed in another order, and so rounded differently; the
/// flip guard rounds from another corner.
RC_GTEST_PROP(BuildEcolProps, turningInsideOutChangesNoBit, ()) {
  Case c = random_case({Kind::closed, Kind::open, Kind::soup});
  c.options.boundary = BoundaryRule::locked;
  c.options.flip_guard = false;
  const EcolResult expected = run(c);
  classify(c, expected);
  for (Corners& t : c.mesh.triangles) std::swap(t.v[1], t.v[2]);
  RC_ASSERT(difference_of(run(c), expected) == "");
}

RC_GTEST_PROP(BuildEcolProps, reusedWorkspacesGiveTheSameBytes, ()) {
  pgl::host::EcolWorkspace<float> workspace;
  for (int i = 0; i < 6; ++i) {
    const Case c = random_case({Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
    const bool with_error = *rc::gen::arbitrary<bool>();
    const EcolResult fresh = build<float, std::uint32_t>(c.mesh, c.options, c.locked);
    const EcolResult reused = build<float, std::uint32_t>(c.mesh, c.locked, c.options, workspace, with_error);
    RC_ASSERT(difference_of(fresh, reused) == "");
    pgl::host::EcolWorkspace<float> other;
    const EcolResult narrow = build<float, std::uint16_t>(c.mesh, c.locked, c.options, other, with_error);
    RC_ASSERT(difference_of(fresh, narrow) == "");
  }
}

}  // namespace
