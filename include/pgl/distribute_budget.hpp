// SPDX-License-Identifier: MIT
// The rule that shares a vertex budget among the objects of a frame, by what each is worth on the screen.
#pragma once

#include <cfloat>
#include <cstdint>

#include "pgl/config.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

namespace pgl {

/// How the clamped shares are brought to the budget.
///
/// exact: the sum never exceeds the budget, and meets it whenever a drawn object could take one more vertex. Objects
///   that are not eligible stay at 0. An object whose minimum alone exceeds the budget is not eligible. Heavy objects
///   keep their whole share, so that where lighter ones are raised to their minima, the lightest are left out.
/// fair: what exact promises, and counts as near to proportional as the ranges allow: [Peng13] Eq 2.3 solved under
///   Eq 2.4, with one level for all objects (see level_vertices). An eligible object is below its range only when the
///   minima of all eligible objects together exceed the budget; then it is as exact, starting from the minima.
/// paper: [Peng13] Alg 2 as printed. It leaves out the lightest objects whose running sum is *at most* the excess, so
///   it can stay over budget; it lifts all objects, those of weight 0 too (after the others); and it fills whole
///   objects only, so it can stay below the budget.
enum class BudgetPolicy : std::uint8_t { exact, fair, paper };

/// What distribute_budget is asked for.
struct BudgetOptions {
  std::uint64_t budget = 0;  ///< N, vertices, at most 2^32
  float alpha = 3.0f;        ///< [Peng13] Eq 2.3, in (1, 64]: small favours screen area, large favours detailed objects
  float pet = 1.0f;          ///< pixel error threshold, pixels squared, >= 0: a smaller area on the screen has weight 0
  float near_depth = 1e-3f;  ///< smaller depths count as this one; positive and finite
  float viewport_area = ieee::infinity<float>;  ///< larger areas count as this one, pixels squared; positive
  BudgetPolicy policy = BudgetPolicy::exact;
};

/// What distribute_budget gave out.
struct BudgetTotals {
  std::uint64_t objects = 0;   ///< objects with a count above 0
  std::uint64_t vertices = 0;  ///< sum of all counts
  constexpr void operator+=(const BudgetTotals& other) {
    objects += other.objects;
    vertices += other.vertices;
  }
  friend constexpr bool operator==(const BudgetTotals&, const BudgetTotals&) = default;
};

/// Tells whether every option is in its documented range. NaN is in none.
PGL_HD constexpr bool is_valid(const BudgetOptions& options) {
  return options.budget <= (std::uint64_t{1} << 32) && options.alpha > 1.0f && options.alpha <= 64.0f &&
         options.pet >= 0.0f && options.near_depth > 0.0f && options.near_depth <= FLT_MAX &&
         options.viewport_area > 0.0f;
}

/// Finds the least vertex count at which a mesh keeps at least `min_triangles` triangles (MinT of [Peng13] Eq 2.4).
///
/// The result is in [mesh.min_vertices, mesh.max_vertices]; it is max_vertices where even the full mesh has fewer
/// triangles. `map` is the model's map array (see Mesh). Precondition: the mesh's part of it does not decrease.
/// O(log vertices).
PGL_HD constexpr std::uint32_t minimum_vertices(const Mesh& mesh, const std::uint32_t* map,
                                                std::uint32_t min_triangles) {
  std::uint32_t low = mesh.min_vertices;
  std::uint32_t high = mesh.max_vertices;
  while (low < high) {
    const std::uint32_t middle = low + (high - low) / 2;
    if (triangles_at(mesh, map, middle) >= min_triangles)
      high = middle;
    else
      low = middle + 1;
  }
  return low;
}

namespace detail {

/// Takes log2 of a positive normal number to within 2^-40 and one ulp of the result, exactly for powers of two.
///
/// A float weight needs no more, and this takes a fifth of the time of ieee::log2. x = 2^e m with m in [sqrt(1/2),
/// sqrt(2)), s = (m - 1) / (m + 1), log2(m) = 2 / ln 2 * (s + s^3/3 + ... + s^13/13).
PGL_HD constexpr double weight_log2(double x) {
  const std::uint64_t bits = ieee::to_bits(x);
  const std::uint64_t above = bits - 0x3fe6a09e667f3bcdu;  // the bits of sqrt(1/2)
  const auto e = static_cast<int>(static_cast<std::int64_t>(above) >> 52);
  const double m = ieee::from_bits<double>(bits - (static_cast<std::uint64_t>(e) << 52));
  const double s = ieee::div(ieee::sub(m, 1.0), ieee::add(m, 1.0));
  const double z = ieee::mul(s, s);
  double series = 1.0 / 13;
  series = ieee::add(ieee::mul(series, z), 1.0 / 11);
  series = ieee::add(ieee::mul(series, z), 1.0 / 9);
  series = ieee::add(ieee::mul(series, z), 1.0 / 7);
  series = ieee::add(ieee::mul(series, z), 1.0 / 5);
  series = ieee::add(ieee::mul(series, z), 1.0 / 3);
  series = ieee::add(ieee::mul(series, z), 1.0);
  return ieee::add(static_cast<double>(e), ieee::mul(ieee::mul(s, 0x1.71547652b82fep+1), series));
}

/// Takes 2^x for x in [-64, 0], x rounded to a multiple of 2^-38 first: within a factor of 1 +- 2^-41 of the power of
/// what it is rounded to, exactly for integers, and never decreasing, since neighbours on that grid are further apart.
///
/// A share of 31 bits needs no more. x = k + f with |f| <= 1/2, 2^f = 1 + w + w^2/2! + ... + w^10/10!, w = f ln 2.
PGL_HD constexpr double share_exp2(double x) {
  constexpr double grid = 0x1.8p14;      // the last place of numbers about this size is 2^-38 ...
  constexpr double integers = 0x1.8p52;  // ... and of these 1
  const double rounded = ieee::sub(ieee::add(x, grid), grid);
  const double k = ieee::sub(ieee::add(rounded, integers), integers);
  const double w = ieee::mul(ieee::sub(rounded, k), 0x1.62e42fefa39efp-1);
  double series = 1.0 / 3628800;
  series = ieee::add(ieee::mul(series, w), 1.0 / 362880);
  series = ieee::add(ieee::mul(series, w), 1.0 / 40320);
  series = ieee::add(ieee::mul(series, w), 1.0 / 5040);
  series = ieee::add(ieee::mul(series, w), 1.0 / 720);
  series = ieee::add(ieee::mul(series, w), 1.0 / 120);
  series = ieee::add(ieee::mul(series, w), 1.0 / 24);
  series = ieee::add(ieee::mul(series, w), 1.0 / 6);
  series = ieee::add(ieee::mul(series, w), 0.5);
  series = ieee::add(ieee::mul(series, w), 1.0);
  series = ieee::add(ieee::mul(series, w), 1.0);
  return ieee::mul(series, ieee::from_bits<double>(static_cast<std::uint64_t>(1023 + static_cast<int>(k)) << 52));
}

}  // namespace detail

/// Computes what an object is worth: log2 of A/D * P^(alpha - 1), P its full vertex count ([Peng13] Eq 2.3 without the
/// factor alpha - 1, which all objects share, so that it changes neither the order nor the shares).
///
/// This float *is* the weight from here on: heavier means a larger value, ties go to the lower index. It is the nearest
/// float of a double that is off by at most alpha * 2^-40 and four units in the last place of its larger term; never
/// NaN, +infinity or -0, and at most 2300 in magnitude. A larger area, a smaller depth or a larger mesh never makes an
/// object lighter.
///
/// -infinity means not eligible: an area of 0, below the threshold or NaN (negative ones too), an infinite or NaN
/// depth, a mesh without vertices, and except with BudgetPolicy::paper a minimum above the budget. An infinite area
/// counts as the viewport's, or as the largest float where that is infinite too; a zero or negative depth as
/// near_depth.
/// area: pixels squared; depth: the object's nearest. Precondition: is_valid(options).
PGL_HD inline float log_weight(float area, float depth, std::uint32_t min_vertices, std::uint32_t max_vertices,
                               const BudgetOptions& options) {
  const bool fits = options.policy == BudgetPolicy::paper || min_vertices <= options.budget;
  const bool seen = area > 0.0f && area >= options.pet && depth < ieee::infinity<float>;
  if (!seen || !fits || max_vertices == 0) return -ieee::infinity<float>;
  const float a = ieee::min(ieee::min(area, options.viewport_area), FLT_MAX);
  const float d = ieee::max(depth, options.near_depth);
  const double beta = ieee::sub(static_cast<double>(options.alpha), 1.0);
  const double detail = ieee::mul(beta, detail::weight_log2(static_cast<double>(max_vertices)));
  const double nearness = detail::weight_log2(ieee::div(static_cast<double>(a), static_cast<double>(d)));
  return ieee::add(ieee::to_float(ieee::add(detail, nearness)), 0.0f);  // + 0: turns -0 into +0
}

/// Computes an object's part of the budget as an integer: round(2^31 * (w / w_max)^(1/alpha)), the numerator of
/// [Peng13] Eq 2.3 relative to the heaviest object, so that nothing overflows and sums do not depend on their order.
///
/// 2^31 for the heaviest object, 0 for one that is not eligible or below 2^-32 of the heaviest. Within 0.51 of the
/// exact value for the two floats given. A heavier object never has less. Preconditions: log_weight <= heaviest,
/// neither NaN nor +infinity (heaviest is not read where log_weight is -infinity); alpha in (1, 64].
PGL_HD inline std::uint32_t share_weight(float log_weight, float heaviest, float alpha) {
  if (!(log_weight > -ieee::infinity<float>)) return 0;
  const double below = ieee::sub(static_cast<double>(log_weight), static_cast<double>(heaviest));
  const double exponent = ieee::max(ieee::div(below, static_cast<double>(alpha)), -64.0);
  return static_cast<std::uint32_t>(ieee::add(ieee::mul(detail::share_exp2(exponent), 2147483648.0), 0.5));
}

/// Computes the vertex count that an eligible object starts with: floor(N * share / share_sum), clamped to the object's
/// range ([Peng13] Eq 2.3, 2.4); exact integers.
/// Preconditions: share_sum > 0; share <= 2^31; min_vertices <= max_vertices.
PGL_HD constexpr std::uint32_t shared_vertices(std::uint32_t share, std::uint64_t share_sum, std::uint32_t min_vertices,
                                               std::uint32_t max_vertices, const BudgetOptions& options) {
  const std::uint64_t vertices = options.budget * share / share_sum;  // at most 2^32 * 2^31
  if (vertices < min_vertices) return min_vertices;
  return vertices > max_vertices ? max_vertices : static_cast<std::uint32_t>(vertices);
}

/// How many levels there are to choose from with BudgetPolicy::fair, see budget_level.
inline constexpr std::uint32_t budget_levels = 53u << 11;

/// Computes the level at `index` of the grid that BudgetPolicy::fair searches: all integers below 2^63 of at most 12
/// significant bits, ascending from 0, so that neighbours differ by 1 or by at most a 2048th.
/// Precondition: index < budget_levels.
PGL_HD constexpr std::uint64_t budget_level(std::uint32_t index) {
  constexpr std::uint32_t leading = 1u << 11;
  if (index < leading) return index;
  return static_cast<std::uint64_t>(leading | (index & (leading - 1))) << ((index >> 11) - 1);
}

/// Computes the vertex count that an eligible object has at a level: floor(level * share / 2^31), clamped to the
/// object's range; exact integers.
///
/// The level is the count that the heaviest object would have without its range; all others are in proportion to it
/// ([Peng13] Eq 2.3). A higher level or a larger share never gives less. At level 0 all have their minima.
/// Preconditions: level < 2^63; share <= 2^31; min_vertices <= max_vertices.
PGL_HD constexpr std::uint32_t level_vertices(std::uint64_t level, std::uint32_t share, std::uint32_t min_vertices,
                                              std::uint32_t max_vertices) {
  constexpr std::uint64_t low_bits = (std::uint64_t{1} << 31) - 1;
  const std::uint64_t vertices = (level >> 31) * share + (((level & low_bits) * share) >> 31);  // below 2^63 + 2^31
  // Written so that nothing branches: which side of its range an object is on cannot be predicted.
  const std::uint64_t raised = vertices < min_vertices ? min_vertices : vertices;
  return static_cast<std::uint32_t>(raised < max_vertices ? raised : max_vertices);
}

/// Packs the total order of the objects into an integer: the larger key is the heavier object; among equal weights it
/// is the one with the lower index. Neither 0 nor the largest integer is ever a key.
/// Precondition: the weight is neither NaN nor -0.
PGL_HD constexpr std::uint64_t weight_key(float log_weight, std::uint32_t object) {
  return (static_cast<std::uint64_t>(ieee::order_key(log_weight)) << 32) | (~object & 0xffffffffu);
}

/// The object that a key belongs to.
PGL_HD constexpr std::uint32_t object_of_key(std::uint64_t key) {
  return ~static_cast<std::uint32_t>(key);
}

/// The weight that a key was made of.
PGL_HD constexpr float weight_of_key(std::uint64_t key) {
  return ieee::from_order_key<float>(static_cast<std::uint32_t>(key >> 32));
}

/// The least key that an eligible object can have.
PGL_HD constexpr std::uint64_t least_eligible_key() {
  return weight_key(-ieee::infinity<float>, 0) + 1;
}

/// Where a running sum, heaviest object first, first exceeds a limit: the key of that object, and the sum of the ones
/// heavier than it (at most the limit). key 0: it never does, and `before` is the sum of all.
struct BudgetCut {
  std::uint64_t key = 0;
  std::uint64_t before = 0;
};

/// Turns the clamped shares into final counts: objects with keys below `kept_from` get 0; the one with `partial_key`
/// gets `partial`; those from `filled_from` on get their maximum; the others keep their share.
struct BudgetPlan {
  std::uint64_t kept_from = 0;
  std::uint64_t filled_from = ~std::uint64_t{0};
  std::uint64_t partial_key = 0;
  std::uint32_t partial = 0;
  std::uint64_t left = 0;  ///< vertices that the kept objects may still be lifted by
};

/// The limit of the running sum of counts that decides what is left out when their sum exceeds the budget.
/// Precondition: budget > 0.
PGL_HD constexpr std::uint64_t reduction_limit(const BudgetOptions& options) {
  return options.policy == BudgetPolicy::paper ? options.budget - 1 : options.budget;
}

/// Plans the reduction to the budget, from the cut of the running sum of counts at reduction_limit.
///
/// exact, fair: the lightest objects are left out until the others fit. The last of them, the object at the cut, takes
/// what the others leave if that is at least its minimum, and the sum is N; if not, it is left out and the rest goes
/// back to the others (fair: always, since its count is its minimum). paper: the object at the cut, with which the
/// running sum reaches N, stays whole.
///
/// Preconditions: cut.key != 0; min_at_cut is the minimum of its object.
PGL_HD constexpr BudgetPlan plan_reduction(const BudgetCut& cut, std::uint32_t min_at_cut,
                                           const BudgetOptions& options) {
  BudgetPlan plan;
  plan.kept_from = cut.key;
  if (options.policy == BudgetPolicy::paper) return plan;
  const std::uint64_t left = options.budget - cut.before;  // less than the count at the cut
  if (left >= min_at_cut) {
    plan.partial_key = cut.key;
    plan.partial = static_cast<std::uint32_t>(left);
  } else {
    plan.kept_from = cut.key + 1;
    plan.left = left;
  }
  return plan;
}

/// The least key that may be lifted: that of an eligible object; with BudgetPolicy::paper any.
PGL_HD constexpr std::uint64_t lift_from(const BudgetOptions& options) {
  return options.policy == BudgetPolicy::paper ? 0 : least_eligible_key();
}

/// Plans the lift by plan.left vertices, from the cut of the running sum of (maximum - count) at the limit plan.left,
/// over the keys from lift_from on. (Those below plan.kept_from may be in the sum: they come last, and get 0 anyway.)
///
/// The heaviest objects get their maximum; the object at the cut takes the remainder (exact, fair) or nothing (paper).
/// Precondition: count_at_cut is the count of the object at the cut, 0 where there is none.
PGL_HD constexpr BudgetPlan plan_lift(BudgetPlan plan, const BudgetCut& cut, std::uint32_t count_at_cut,
                                      const BudgetOptions& options) {
  if (cut.key == 0) {
    plan.filled_from = lift_from(options);
    return plan;
  }
  plan.filled_from = cut.key + 1;
  if (options.policy != BudgetPolicy::paper) {
    plan.partial_key = cut.key;
    plan.partial = count_at_cut + static_cast<std::uint32_t>(plan.left - cut.before);
  }
  return plan;
}

/// The vertex count that a plan gives an object.
PGL_HD constexpr std::uint32_t planned_vertices(const BudgetPlan& plan, std::uint64_t key, std::uint32_t count,
                                                std::uint32_t max_vertices) {
  if (key < plan.kept_from) return 0;
  if (key == plan.partial_key) return plan.partial;
  return key >= plan.filled_from ? max_vertices : count;
}

}  // namespace pgl
