// SPDX-License-Identifier: MIT
// From the times that frames took to how the next one is shared out, and how much there is to share: [NC07], our
// reading.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "pgl/config.hpp"
#include "pgl/ieee.hpp"

// Three loops, each closed around something measured. In quality mode the error threshold stays and next_weights alone
// evens out the times of the GPUs ([NC07] Eq 1); in performance mode next_budget (Eq 2) or next_threshold (Eq 3) holds
// the time of a frame as well. All are plain arithmetic on a few numbers, the same bits everywhere: processes that are
// given the same measurements come to the same result, and need not send it to each other.
//
// What a GPU does is estimated as its *pace*, milliseconds per unit of load (triangles, vertices). Since a time is set
// against the load that it was measured with, it may arrive some frames late. A measured pace m moves the estimate p to
//
//   p + s (clamp(m, p / c, p * c) - p)           s smoothing, c largest_change
//
// and one that is not a number above 0 does not. Let the true pace be P, and each m within [P (1 - x), P (1 + x)]:
//
// - An estimate in that range stays in it: the clamped m lies between p and m, and p moves towards it, not past it.
// - From outside, p comes nearer to the range each frame: its distance becomes at most 1 - s of what it was, or p
//   itself grows by the factor 1 + s (c - 1), or falls by 1 - s (1 - 1 / c). So a pace that is k times another is
//   arrived at in about log k / log of that factor frames, and then a few of 1 / s more.
// - One frame that was measured wrong, by whatever factor, moves the estimate by no more than those factors.
// - While P drifts by the part d of itself per frame, p lags behind by about d / s of it.
// - Times that have a constant part too, P(L) = a / L + b at the load L, only make p (and the loads that follow from
//   it) come nearer more slowly: at 1 - s + s r times the distance, r = (a / L) / P(L) < 1, without passing by.
//
// So once settled, the share of a GPU is within a factor of (1 + x) / (1 - x) of the ideal one, its speed by the sum of
// all speeds, whatever the noise does; and the dead band adds a factor of 1 + dead_band. Noise that is random is
// averaged over about 2 / s frames, and does much less.

namespace pgl {

/// The most GPUs that next_weights shares out among.
inline constexpr std::size_t most_gpus = 64;

/// The weight of the fastest GPU.
inline constexpr std::uint32_t full_weight = 1u << 20;

/// How fast the loops follow what is measured.
struct FeedbackOptions {
  double smoothing = 0.25;      ///< part of a measurement that is taken over at once, in (0, 1]
  double largest_change = 2.0;  ///< a measurement counts as no further from the last estimate than this factor; in
                                ///< (1, 1024]. No budget or threshold changes by more in a frame
  double dead_band = 0.02;      ///< relative changes up to this one are not made, in [0, 0.5]
  double least_weight =
      1.0 / 64.0;  ///< of the fastest GPU's, in [2^-20, 1]: no GPU gets less, so that each is measured
};

/// Tells whether every option is in its documented range. NaN is in none.
constexpr bool is_valid(const FeedbackOptions& options) {
  return options.smoothing > 0.0 && options.smoothing <= 1.0 && options.largest_change > 1.0 &&
         options.largest_change <= 1024.0 && options.dead_band >= 0.0 && options.dead_band <= 0.5 &&
         options.least_weight >= 0x1p-20 && options.least_weight <= 1.0;
}

/// Returns the milliseconds per unit of load; 0 where that says nothing: no load, or a time that is not above 0 and
/// finite.
constexpr double measured_pace(float milliseconds, std::uint64_t load) {
  if (!(milliseconds > 0.0f) || !ieee::is_finite(milliseconds) || load == 0) return 0.0;
  return ieee::div(static_cast<double>(milliseconds), static_cast<double>(load));
}

/// Takes a measured pace into an estimate, 0 for none yet, as said at the top of this file.
constexpr double smoothed_pace(double pace, double measured, const FeedbackOptions& options) {
  if (!(measured > 0.0)) return pace;
  if (!(pace > 0.0)) return measured;
  const double least = ieee::div(pace, options.largest_change), most = ieee::mul(pace, options.largest_change);
  const double clamped = ieee::min(ieee::max(measured, least), most);
  return ieee::add(pace, ieee::mul(options.smoothing, ieee::sub(clamped, pace)));
}

/// Returns the longest of the times that are above 0 and finite, which a frame of several GPUs took; 0 if none is.
constexpr float frame_milliseconds(std::span<const float> milliseconds) {
  float longest = 0.0f;
  for (const float time : milliseconds)
    if (time > longest && ieee::is_finite(time)) longest = time;
  return longest;
}

// ---- weights: which part of the picture's load each GPU gets

/// What next_weights keeps from frame to frame. All zero to begin with.
struct WeightFeedback {
  std::uint32_t gpus = 0;                 ///< 0 before the first frame
  double paces[most_gpus] = {};           ///< milliseconds per unit of load, 0 while not known
  std::uint32_t weights[most_gpus] = {};  ///< as they were last written
};

namespace detail {

/// The weights that the paces call for: the fastest GPU's is full_weight, the others' in proportion to their speeds,
/// rounded, and at least the least. A GPU not measured yet counts as the mean of those that are.
inline void weights_of_paces(std::span<const double> paces, const FeedbackOptions& options,
                             std::span<std::uint32_t> weights) {
  double sum = 0.0, fastest = ieee::infinity<double>;
  std::uint32_t known = 0;
  for (const double pace : paces) {
    if (!(pace > 0.0)) continue;
    sum = ieee::add(sum, pace);
    fastest = ieee::min(fastest, pace);
    ++known;
  }
  const double mean = known > 0 ? ieee::div(sum, static_cast<double>(known)) : 1.0;
  if (known == 0) fastest = mean;
  const double full = static_cast<double>(full_weight);
  for (std::size_t i = 0; i < paces.size(); ++i) {
    const double relative = ieee::div(fastest, paces[i] > 0.0 ? paces[i] : mean);  // at most 1
    const double weight = ieee::mul(ieee::min(ieee::max(relative, options.least_weight), 1.0), full);
    weights[i] = static_cast<std::uint32_t>(ieee::add(weight, 0.5));
  }
}

/// Tells whether some share of the second weights differs from that of the first by more than the dead band, relative
/// to the first.
inline bool shares_differ(std::span<const std::uint32_t> from, std::span<const std::uint32_t> to, double dead_band) {
  std::uint64_t sum_from = 0, sum_to = 0;
  for (const std::uint32_t w : from) sum_from += w;
  for (const std::uint32_t w : to) sum_to += w;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const std::uint64_t a = from[i] * sum_to, b = to[i] * sum_from;  // below 2^47: exact as doubles
    const std::uint64_t apart = a > b ? a - b : b - a;
    if (static_cast<double>(apart) > ieee::mul(dead_band, static_cast<double>(a))) return true;
  }
  return false;
}

}  // namespace detail

/// Computes the weights with which the next frame is shared out by `balance`, from how long each GPU took for what it
/// drew ([NC07] 4.1, Eq 1, our reading: the split follows the measured speeds).
///
/// - state: of this loop; it starts anew where the number of GPUs is another one.
/// - milliseconds, loads: in, one per GPU, of one and the same frame, which may be some frames ago: the time of the
/// work
///   that grows with the load, and the load (what balance said, or what was drawn). A time that is NaN, infinite, 0 or
///   negative, and a load of 0, say nothing, and leave that GPU's estimate as it is.
/// - weights: out, one per GPU, each from options.least_weight to 1 of full_weight: in proportion to the speeds as they
///   are estimated. Equal before anything was measured. They change only when some GPU's share of them would by more
///   than the dead band, so that tiles do not move for nothing.
///
/// How fast they follow, and how far off they can be, is said at the top of this file. A GPU that is slower than
/// least_weight of the fastest still gets that. Preconditions: as many of each, 1 to most_gpus; is_valid(options).
/// Allocates nothing; the same bits everywhere.
inline void next_weights(WeightFeedback& state, std::span<const float> milliseconds,
                         std::span<const std::uint64_t> loads, const FeedbackOptions& options,
                         std::span<std::uint32_t> weights) {
  const std::size_t n = weights.size();
  PGL_ASSERT(n >= 1 && n <= most_gpus && milliseconds.size() == n && loads.size() == n);
  PGL_ASSERT(is_valid(options));
  const bool is_new = state.gpus != n;
  if (is_new) state = WeightFeedback{};
  state.gpus = static_cast<std::uint32_t>(n);
  const std::span<double> paces = std::span(state.paces).first(n);
  const std::span<std::uint32_t> current = std::span(state.weights).first(n);
  if (is_new)
    for (std::uint32_t& weight : current) weight = full_weight;
  for (std::size_t i = 0; i < n; ++i)
    paces[i] = smoothed_pace(paces[i], measured_pace(milliseconds[i], loads[i]), options);
  detail::weights_of_paces(paces, options, weights);
  const bool changes = detail::shares_differ(current, weights, options.dead_band);
  for (std::size_t i = 0; i < n; ++i) (changes ? current[i] : weights[i]) = changes ? weights[i] : current[i];
}

// ---- budget: how much there is to draw in the time of a frame

/// What next_budget keeps from frame to frame.
struct BudgetFeedback {
  std::uint64_t budget = 1000000;  ///< vertices; what to begin with, then what was last returned
  double pace = 0.0;               ///< milliseconds per vertex, 0 while not known
};

/// What next_budget aims at.
struct BudgetTarget {
  double milliseconds = 1000.0 / 60.0;          ///< of a frame, in [0.001, 1e6]
  std::uint64_t least = 1;                      ///< vertices, at least 1
  std::uint64_t most = std::uint64_t{1} << 32;  ///< vertices, least to 2^32
};

/// Tells whether every value is in its documented range. NaN is in none.
constexpr bool is_valid(const BudgetTarget& target) {
  return target.milliseconds >= 0.001 && target.milliseconds <= 1e6 && target.least >= 1 &&
         target.least <= target.most && target.most <= std::uint64_t{1} << 32;
}

/// Computes the vertex budget of the next frame, so that it takes the target's time ([NC07] 4.2, Eq 2, our reading: the
/// budget times target / measured, smoothed).
///
/// milliseconds: in, how long a frame took, the slowest GPU's time (frame_milliseconds). drawn: in, the vertices that
/// were drawn in it, of all GPUs as the budget is; it may be some frames ago. A time that is NaN, infinite, 0 or
/// negative, or nothing drawn, leaves the budget as it is. A frame that was in time never lowers the budget: looking
/// at the sky, where little is drawn, and that slowly, says nothing about a full view.
///
/// The result, state.budget too, is always in [target.least, target.most]; apart from that it changes by at most the
/// factor options.largest_change (and one vertex), and not at all within the dead band. At a steady pace it comes to
/// target / pace as said at the top of this file; with times measured to 1 +- x, it stays within 1 / (1 +- x) of that
/// once settled, and the dead band.
/// Preconditions: is_valid(target), is_valid(options). The same bits everywhere.
inline std::uint64_t next_budget(BudgetFeedback& state, float milliseconds, std::uint64_t drawn,
                                 const BudgetTarget& target, const FeedbackOptions& options) {
  PGL_ASSERT(is_valid(target) && is_valid(options));
  if (state.budget < target.least) state.budget = target.least;
  if (state.budget > target.most) state.budget = target.most;
  const double budget = static_cast<double>(state.budget);
  double measured = measured_pace(milliseconds, drawn);
  if (static_cast<double>(milliseconds) <= target.milliseconds)
    measured = ieee::min(measured, ieee::div(target.milliseconds, budget));
  state.pace = smoothed_pace(state.pace, measured, options);
  if (!(state.pace > 0.0)) return state.budget;

  double wanted = ieee::div(target.milliseconds, state.pace);
  wanted = ieee::max(wanted, ieee::div(budget, options.largest_change));
  wanted = ieee::min(wanted, ieee::mul(budget, options.largest_change));
  wanted = ieee::min(ieee::max(wanted, static_cast<double>(target.least)), static_cast<double>(target.most));
  const double change = ieee::sub(wanted, budget);
  if (!((change < 0.0 ? -change : change) > ieee::mul(options.dead_band, budget))) return state.budget;
  const std::uint64_t down = static_cast<std::uint64_t>(wanted);
  // Rounded in the direction of the change, so that the smallest budgets change too.
  state.budget = down + (change > 0.0 && static_cast<double>(down) < wanted ? 1 : 0);
  return state.budget;
}

// ---- threshold: how coarse a picture must be to be drawn in the time of a frame

/// What next_threshold aims at.
struct ThresholdTarget {
  double milliseconds = 1000.0 / 60.0;  ///< of a frame, in [0.001, 1e6]
  float least = 0.25f;                  ///< pixels, positive
  float most = 64.0f;                   ///< pixels, least to 2^20
};

/// Tells whether every value is in its documented range. NaN is in none.
constexpr bool is_valid(const ThresholdTarget& target) {
  return target.milliseconds >= 0.001 && target.milliseconds <= 1e6 && target.least >= 0x1p-20f &&
         target.least <= target.most && target.most <= 0x1p20f;
}

/// Computes the error threshold of select_by_error for the next frame, so that it takes the target's time ([NC07] 4.2,
/// Eq 3, our reading).
///
/// threshold: in, pixels, that of the last frame; milliseconds: in, how long the frame took. The threshold is
/// multiplied by 1 + s (r - 1), r = measured / target, at least 1 / c and at most c (s smoothing, c largest_change). A
/// time that is NaN, infinite, 0 or negative leaves it as it is; so does an r within 1 +- dead_band.
///
/// The result is in [target.least, target.most], whatever is given. Let the time fall with the e-th power of the
/// threshold. If 1 + s (c - 1) <= c^(1/e), which is e up to 3 as the options are, the threshold nears the one that is
/// looked for without passing by, its distance near the end by the factor 1 - s e each frame; and times measured to
/// 1 +- x leave it between the thresholds whose times are 1 / (1 +- x) of the target, and the dead band. It is stable
/// for s e < 2, and for s e < 1 where the time measured is that of the frame before the last.
/// Preconditions: is_valid(target), is_valid(options). The same bits everywhere.
inline float next_threshold(float threshold, float milliseconds, const ThresholdTarget& target,
                            const FeedbackOptions& options) {
  PGL_ASSERT(is_valid(target) && is_valid(options));
  const float current = ieee::min(ieee::max(threshold, target.least), target.most);  // least for NaN
  if (!(milliseconds > 0.0f) || !ieee::is_finite(milliseconds)) return current;
  const double measured = ieee::div(static_cast<double>(milliseconds), target.milliseconds);
  const double ratio = ieee::min(ieee::max(measured, ieee::div(1.0, options.largest_change)), options.largest_change);
  const double change = ieee::sub(ratio, 1.0);
  if (!((change < 0.0 ? -change : change) > options.dead_band)) return current;
  const double factor = ieee::add(1.0, ieee::mul(options.smoothing, change));
  const float next = ieee::to_float(ieee::mul(static_cast<double>(current), factor));
  return ieee::min(ieee::max(next, target.least), target.most);
}

}  // namespace pgl
