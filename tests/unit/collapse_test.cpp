// SPDX-License-Identifier: MIT
#include "pgl/collapse.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <span>
#include <vector>

#include "support/ecol_cases.hpp"
#include "support/ecol_oracle.hpp"

namespace {

using namespace test;
using pgl::EcolOptions;
using pgl::EcolOrder;

// ---- the plainest driver there can be -------------------------------------------------------------------------------

/// A mesh under the rule, every vertex looked at anew whenever anything is asked.
template <class Real, class Id>
class Plain {
 public:
  using Mesh = pgl::CollapsingMesh<Real, Id>;
  using Candidate = pgl::CandidateOf<Real, Id>;

  Plain(const TriangleMesh& mesh, std::span<const std::uint8_t> locked, const EcolOptions& options)
      : vertices_(mesh.vertex_count()),
        corners_(3 * mesh.triangles.size()),
        next_(corners_.size()),
        previous_(corners_.size()) {
    pgl::Box box;
    for (const glm::vec3& p : mesh.positions) box = pgl::extend(box, p);
    frame_ = pgl::normalisation(box);
    for (const glm::vec3& p : mesh.positions) positions_.push_back(pgl::normalise<Real>(p, frame_));
    first_.assign(vertices_, Mesh::none);
    last_.assign(vertices_, Mesh::none);
    flags_.resize(vertices_);
    quadrics_.resize(vertices_);
    weights_.resize(vertices_);
    normals_.resize(mesh.triangles.size());
    m_.vertices = vertices_;
    m_.triangles = mesh.triangle_count();
    m_.options = options;
    m_.positions = positions_.data();
    m_.quadrics = quadrics_.data();
    m_.weights = weights_.data();
    m_.first = first_.data();
    m_.last = last_.data();
    m_.flags = flags_.data();
    m_.corners = corners_.data();
    m_.next = next_.data();
    m_.previous = previous_.data();
    if (options.metric == pgl::CostMetric::melax) m_.normals = normals_.data();
    for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t)
      for (std::uint32_t c = 0; c < 3; ++c) {
        const std::uint32_t corner = 3 * t + c, v = mesh.triangles[t].v[c];
        corners_[corner] = is_degenerate(mesh.triangles[t]) ? Mesh::none : static_cast<Id>(v);
        if (is_degenerate(mesh.triangles[t])) continue;
        (first_[v] == Mesh::none ? first_[v] : next_[last_[v]]) = static_cast<Id>(corner);
        previous_[corner] = last_[v];
        last_[v] = static_cast<Id>(corner);
        next_[corner] = Mesh::none;
      }
    for (std::uint32_t t = 0; t < m_.triangles; ++t)
      if (m_.normals != nullptr && !pgl::is_gone(m_, t)) normals_[t] = pgl::direction(pgl::normal_of(m_, t));
    for (std::uint32_t u = 0; u < vertices_; ++u) pgl::set_up_vertex(m_, u, locked.empty() || locked[u] == 0);
    result_.ecol.assign(vertices_, nowhere);
    result_.permute_v.assign(vertices_, nowhere);
    result_.permute_t.assign(mesh.triangles.size(), nowhere);
    result_.map.assign(vertices_ + 1, m_.triangles);
    result_.error.assign(vertices_ + 1, 0);
    for (std::uint32_t t = 0; t < m_.triangles; ++t)
      if (pgl::is_gone(m_, t)) degenerate_.push_back(t);
    left_ = vertices_;
  }

  EcolResult run() {
    while (m_.options.order == EcolOrder::greedy ? step() : round()) {
    }
    result_.min_vertices = left_;
    std::uint32_t place = 0;
    for (std::uint32_t& p : result_.permute_v)
      if (p == nowhere) p = place++;
    place = 0;
    for (std::uint32_t& p : result_.permute_t)
      if (p == nowhere) p = place++;
    return result_;
  }

 private:
  using Cost = typename Mesh::Cost;

  bool step() {
    std::uint32_t from = nowhere;
    Candidate best = pgl::no_candidate(m_);
    for (std::uint32_t u = 0; u < vertices_; ++u) {
      const Candidate c = pgl::least_collapse(m_, u, static_cast<Cost>(~Cost{0} - 1));
      if (c.target != Mesh::none && (from == nowhere || c.cost < best.cost)) {
        best = c;
        from = u;
      }
    }
    if (from != nowhere) perform(from, best.target);
    return from != nowhere;
  }

  bool round() {
    std::vector<Candidate> least(vertices_);
    for (;;) {
      bool any = false;
      Cost above = static_cast<Cost>(~Cost{0});
      for (std::uint32_t u = 0; u < vertices_; ++u) {
        least[u] = pgl::least_collapse(m_, u, limit_);
        if (least[u].target == Mesh::none)
          above = std::min(above, least[u].cost);
        else
          any = true;
      }
      if (any) break;
      if (above == static_cast<Cost>(~Cost{0})) return false;
      limit_ = pgl::round_limit(above);
    }
    std::vector<std::uint64_t> claims(vertices_, ~std::uint64_t{0});
    const auto all = [&](std::uint32_t u, auto&& body) {
      return least[u].target != Mesh::none && pgl::for_region(m_, u, least[u].target, body);
    };
    for (std::uint32_t u = 0; u < vertices_; ++u)
      all(u, [&](std::uint32_t x) {
        claims[x] = std::min(claims[x], pgl::round_rank(least[u].cost, u));
        return true;
      });
    std::vector<std::uint32_t> winners;
    for (std::uint32_t u = 0; u < vertices_; ++u)
      if (all(u, [&](std::uint32_t x) { return claims[x] == pgl::round_rank(least[u].cost, u); })) winners.push_back(u);
    for (const std::uint32_t u : winners) perform(u, least[u].target);
    return true;
  }

  void perform(std::uint32_t u, std::uint32_t v) {
    std::vector<std::uint32_t> gone;
    gone.swap(degenerate_);
    const Real distance = pgl::perform_collapse(m_, u, v, [&](std::uint32_t t) { gone.push_back(t); });
    std::sort(gone.begin(), gone.end());
    std::uint32_t place = result_.map[left_];
    for (const std::uint32_t t : gone) result_.permute_t[t] = --place;
    const float before = result_.error[left_];
    --left_;
    result_.ecol[u] = v;
    result_.permute_v[u] = left_;
    result_.map[left_] = place;
    result_.error[left_] = std::max(before, pgl::in_model_units(distance, frame_));
  }

  std::uint32_t vertices_, left_ = 0;
  pgl::Normalisation frame_;
  std::vector<pgl::Vector<Real>> positions_, normals_;
  std::vector<pgl::Quadric<Real>> quadrics_;
  std::vector<Real> weights_;
  std::vector<Id> first_, last_, corners_, next_, previous_;
  std::vector<std::uint8_t> flags_;
  std::vector<std::uint32_t> degenerate_;
  Mesh m_;
  Cost limit_ = 0;
  EcolResult result_;
};

/// In wide and in narrow ids; both orders are brute force's.
TEST(Collapse, ThePlainestDriverGivesWhatBruteForceGives) {
  std::mt19937 rng(1);
  for (int i = 0; i < 400; ++i) {
    SCOPED_TRACE(i);
    EcolCase c =
        random_ecol_case(static_cast<std::uint32_t>(rng()), {Kind::closed, Kind::one_sided, Kind::open, Kind::soup});
    if (i % 4 == 0) make_extreme(c, rng);
    c.options.order = i % 2 == 0 ? EcolOrder::rounds : EcolOrder::greedy;
    if (c.fine) {
      const EcolResult expected = brute_force<double>(c.mesh, c.locked, c.options);
      ASSERT_EQ(difference_of(Plain<double, std::uint16_t>(c.mesh, c.locked, c.options).run(), expected), "");
      ASSERT_EQ(difference_of(Plain<double, std::uint32_t>(c.mesh, c.locked, c.options).run(), expected), "");
    } else {
      const EcolResult expected = brute_force<float>(c.mesh, c.locked, c.options);
      ASSERT_EQ(difference_of(Plain<float, std::uint16_t>(c.mesh, c.locked, c.options).run(), expected), "");
      ASSERT_EQ(difference_of(Plain<float, std::uint32_t>(c.mesh, c.locked, c.options).run(), expected), "");
    }
  }
}

// ---- who goes first -------------------------------------------------------------------------------------------------

template <class Real>
void expect_limits() {
  const auto key = [](Real cost) { return pgl::cost_key(cost); };
  const Real least_normal = std::numeric_limits<Real>::min();
  for (const Real cost : {Real(0), std::numeric_limits<Real>::denorm_min(), std::nextafter(least_normal, Real(0))}) {
    EXPECT_LT(pgl::round_limit(key(cost)), key(least_normal)) << cost;
    EXPECT_GE(pgl::round_limit(key(cost)), key(std::nextafter(least_normal, Real(0)))) << cost;
  }
  for (const Real cost : {least_normal, Real(0.75), Real(1), Real(1.5), Real(3), std::nextafter(Real(4), Real(0))}) {
    int exponent = 0;
    std::frexp(cost, &exponent);
    const Real power = std::ldexp(Real(1), exponent);
    EXPECT_EQ(pgl::round_limit(key(cost)), key(std::nextafter(power, Real(0)))) << cost;
    EXPECT_LT(pgl::round_limit(key(cost)), key(power)) << cost;
  }
  const Real infinity = std::numeric_limits<Real>::infinity();
  EXPECT_EQ(pgl::round_limit(key(std::numeric_limits<Real>::max())), key(std::numeric_limits<Real>::max()));
  EXPECT_GE(pgl::round_limit(key(infinity)), key(infinity));
}

TEST(Collapse, LimitsEndAtPowersOfTwo) {
  expect_limits<float>();
  expect_limits<double>();
}

TEST(Collapse, RanksOrderByCostThenByVertexWithoutPattern) {
  const auto rank = [](auto cost, std::uint32_t u) { return pgl::round_rank(pgl::cost_key(cost), u); };
  std::uint32_t ahead = 0;
  std::set<std::uint64_t> ranks;
  for (std::uint32_t u = 0; u < 10000; ++u) {
    EXPECT_LT(rank(0.0f, u), rank(std::numeric_limits<float>::denorm_min(), u + 1));
    EXPECT_LT(rank(1.0f, u), rank(std::nextafter(1.0f, 2.0f), u + 1));
    EXPECT_LT(rank(1.0, u), rank(1.0 + 0x1p-20, u + 1));
    // Beyond its first 32 bits a double does not count.
    EXPECT_EQ(rank(1.0, u), rank(1.0 + 0x1p-21, u));
    ahead += rank(1.0f, u) < rank(1.0f, u + 1);
    ranks.insert(rank(1.0f, u));
  }
  EXPECT_EQ(ranks.size(), 10000u) << "no two vertices have one rank";
  EXPECT_NEAR(ahead, 5000, 300);
  // No rank is that of a vertex which nobody claims.
  EXPECT_LT(rank(std::numeric_limits<float>::infinity(), 0u) | 0xffffffffu, ~std::uint64_t{0});
  EXPECT_LT(rank(std::numeric_limits<double>::infinity(), 0u) | 0xffffffffu, ~std::uint64_t{0});
}

}  // namespace
