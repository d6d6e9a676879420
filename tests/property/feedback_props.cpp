// SPDX-License-Identifier: MIT
// The loops of feedback closed around simulated GPUs: unequal, drifting, noisy ones, whose scenes jump. What they
// should come to is known: the share of a GPU is its speed by the sum of all speeds, the budget what fits into the
// time.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "pgl/feedback.hpp"

namespace {

using pgl::BudgetFeedback;
using pgl::BudgetTarget;
using pgl::FeedbackOptions;
using pgl::full_weight;
using pgl::ThresholdTarget;
using pgl::WeightFeedback;

using Random = std::mt19937;

double uniform(Random& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
}

/// A factor of 1 +- noise.
double noisy(Random& random, double noise) {
  return 1 + uniform(random, -noise, noise);
}

/// GPUs of which each draws `speed` units of load a millisecond, after a constant time.
struct Gpus {
  std::vector<double> speeds, constants;
  explicit Gpus(Random& random, std::size_t n, double slowest = 1.0 / 16) : constants(n) {
    for (std::size_t i = 0; i < n; ++i) speeds.push_back(10000 * std::pow(slowest, uniform(random, 0, 1)));
  }
  std::size_t size() const { return speeds.size(); }
  double time(std::size_t i, double load) const { return constants[i] + load / speeds[i]; }
  std::vector<double> ideal_shares() const {
    const double sum = std::accumulate(speeds.begin(), speeds.end(), 0.0);
    std::vector<double> shares;
    for (const double speed : speeds) shares.push_back(speed / sum);
    return shares;
  }
};

/// next_weights around them. What is measured arrives `delay` frames late.
struct WeightLoop {
  WeightFeedback state;
  FeedbackOptions options;
  std::size_t delay = 0;
  std::vector<std::uint32_t> weights;
  std::vector<std::uint64_t> loads;
  struct Frame {
    std::vector<float> times;
    std::vector<std::uint64_t> loads;
  };
  std::deque<Frame> under_way;

  std::vector<double> shares() const {
    const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
    std::vector<double> all;
    for (const std::uint32_t weight : weights) all.push_back(weight / sum);
    return all;
  }

  /// A frame of so much load; measure(i, time) is what is measured of a GPU's time.
  template <class Measure>
  void frame(const Gpus& gpus, double load, Measure&& measure) {
    if (weights.size() != gpus.size()) weights.assign(gpus.size(), full_weight);
    Frame now;
    const std::vector<double> parts = shares();
    for (std::size_t i = 0; i < gpus.size(); ++i) {
      now.loads.push_back(static_cast<std::uint64_t>(load * parts[i]));
      now.times.push_back(static_cast<float>(measure(i, gpus.time(i, static_cast<double>(now.loads[i])))));
    }
    loads = now.loads;
    under_way.push_back(now);
    if (under_way.size() <= delay) return;
    pgl::next_weights(state, under_way.front().times, under_way.front().loads, options, weights);
    under_way.pop_front();
  }
  void frames(int count, const Gpus& gpus, double load) {
    for (int i = 0; i < count; ++i) frame(gpus, load, [](std::size_t, double time) { return time; });
  }
};

/// The factor by which the shares are farthest from others.
double farthest(const std::vector<double>& shares, const std::vector<double>& from) {
  double most = 1;
  for (std::size_t i = 0; i < shares.size(); ++i) most = std::max({most, shares[i] / from[i], from[i] / shares[i]});
  return most;
}

constexpr double load = 1e8;
constexpr double rounding = 1.0005;  // of weights, to a millionth of the fastest GPU's

std::size_t any_number_of_gpus(Random& random) {
  return 1 + random() % (random() % 2 == 0 ? 64 : 4);
}

RC_GTEST_PROP(NextWeightsProps, comeToTheSpeedsAndStayThere, (std::uint32_t seed)) {
  Random random(seed);
  const Gpus gpus(random, any_number_of_gpus(random), 1.0 / 60);
  WeightLoop loop;
  loop.delay = random() % 3;
  loop.frames(4, gpus, load);  // the first measurement tells all
  RC_ASSERT(farthest(loop.shares(), gpus.ideal_shares()) <= (1 + loop.options.dead_band) * rounding);
  const std::vector<std::uint32_t> settled = loop.weights;
  loop.frames(100, gpus, load);
  RC_ASSERT(loop.weights == settled);
}

RC_GTEST_PROP(NextWeightsProps, followSpeedsThatChangeSuddenly, (std::uint32_t seed)) {
  Random random(seed);
  Gpus gpus(random, 2 + random() % 63);
  WeightLoop loop;
  loop.delay = random() % 3;
  loop.frames(10, gpus, load);
  // Up to 8 times as fast or as slow, by steps of 1 / 0.875 or 1.25: after 16 frames, and then some of 1 / s.
  for (double& speed : gpus.speeds) speed *= std::pow(8.0, uniform(random, -1, 1));
  loop.options.least_weight = 0x1p-16;
  loop.frames(16 + 20 + 2, gpus, load);
  RC_ASSERT(farthest(loop.shares(), gpus.ideal_shares()) <= 1 + loop.options.dead_band + 0.01);
}

/// The bound that is said to hold whatever the noise does.
double worst(double noise, const FeedbackOptions& options) {
  return (1 + noise) / (1 - noise) * (1 + options.dead_band) * rounding;
}

RC_GTEST_PROP(NextWeightsProps, stayWithinTheBoundOfAnyNoise, (std::uint32_t seed)) {
  Random random(seed);
  const Gpus gpus(random, any_number_of_gpus(random));
  const std::vector<double> ideal = gpus.ideal_shares();
  const double noise = uniform(random, 0, 0.2);
  WeightLoop loop;
  loop.delay = random() % 3;
  const std::uint32_t kind = random() % 4;
  double reached = 1;
  for (int frame = 0; frame < 300; ++frame) {
    loop.frame(gpus, load, [&](std::size_t i, double time) {
      const bool up = kind == 0   ? (i + static_cast<std::size_t>(frame)) % 2 == 0  // to and fro
                      : kind == 1 ? i % 2 == 0                                      // one-sided
                      : kind == 2 ? frame / 20 % 2 == 0                             // in long waves
                                  : loop.shares()[i] < ideal[i];                    // always to the worse
      return time * (1 + (up ? noise : -noise));
    });
    reached = std::max(reached, farthest(loop.shares(), ideal));
    RC_ASSERT((frame <= static_cast<int>(loop.delay) || farthest(loop.shares(), ideal) <= worst(noise, loop.options)));
  }
  RC_CLASSIFY(reached > 1 + noise);
}

RC_GTEST_PROP(NextWeightsProps, averageRandomNoise, (std::uint32_t seed)) {
  Random random(seed);
  const Gpus gpus(random, 2 + random() % 63);
  const std::vector<double> ideal = gpus.ideal_shares();
  WeightLoop loop;
  double sum = 0;
  int count = 0;
  for (int frame = 0; frame < 400; ++frame) {
    loop.frame(gpus, load, [&](std::size_t, double time) { return time * noisy(random, 0.2); });
    if (frame < 30) continue;
    const std::vector<double> shares = loop.shares();
    for (std::size_t i = 0; i < gpus.size(); ++i, ++count) sum += std::pow(shares[i] / ideal[i] - 1, 2);
    RC_ASSERT(farthest(shares, ideal) <= worst(0.2, loop.options));
  }
  // Noise of +-20 % has a deviation of 11.5 %, of which a smoothing of 1/4 leaves 4.4 %.
  RC_ASSERT(std::sqrt(sum / count) < 0.055);
}

RC_GTEST_PROP(NextWeightsProps, followSpeedsThatDrift, (std::uint32_t seed)) {
  Random random(seed);
  Gpus gpus(random, 2 + random() % 63);
  std::vector<double> drifts, turns;
  for (std::size_t i = 0; i < gpus.size(); ++i) {
    drifts.push_back(uniform(random, -0.01, 0.01));
    turns.push_back(40 + random() % 60);
  }
  WeightLoop loop;
  loop.options.least_weight = 0x1p-16;
  loop.delay = random() % 2;
  for (int frame = 0; frame < 400; ++frame) {
    for (std::size_t i = 0; i < gpus.size(); ++i)
      gpus.speeds[i] *= 1 + (frame / static_cast<int>(turns[i]) % 2 == 0 ? drifts[i] : -drifts[i]);
    loop.frame(gpus, load, [&](std::size_t, double time) { return time; });
    if (frame < 3) continue;
    const double lag = 0.01 / loop.options.smoothing + 0.01 * static_cast<double>(loop.delay + 1);
    RC_ASSERT(farthest(loop.shares(), gpus.ideal_shares()) <=
              (1 + lag) * (1 + lag) * (1 + loop.options.dead_band) * rounding);
  }
}

RC_GTEST_PROP(NextWeightsProps, doNotMindHowMuchThereIsToDraw, (std::uint32_t seed)) {
  Random random(seed);
  const Gpus gpus(random, any_number_of_gpus(random));
  const std::vector<double> ideal = gpus.ideal_shares();
  WeightLoop loop;
  double now = load;
  for (int frame = 0; frame < 300; ++frame) {
    if (random() % 10 == 0) now = std::clamp(now * (random() % 2 == 0 ? 10 : 0.1), 1e6, 1e10);
    loop.frame(gpus, now, [&](std::size_t, double time) { return time * noisy(random, 0.1); });
    RC_ASSERT(farthest(loop.shares(), ideal) <= worst(0.1, loop.options) * 1.001);
  }
}

RC_GTEST_PROP(NextWeightsProps, evenOutTimesThatHaveAConstantPart, (std::uint32_t seed)) {
  Random random(seed);
  Gpus gpus(random, 2 + random() % 63, 1.0 / 8);
  const double balanced = load / std::accumulate(gpus.speeds.begin(), gpus.speeds.end(), 0.0);
  for (double& constant : gpus.constants) constant = uniform(random, 0, 0.5) * balanced;
  WeightLoop loop;
  loop.options.least_weight = 0x1p-16;
  loop.delay = random() % 2;
  loop.frames(200, gpus, load);
  for (const double factor : {1.0, 10.0, 1.0}) {  // a scene that jumps, and back
    loop.frames(200, gpus, load * factor);
    double least = 1e30, most = 0;
    for (std::size_t i = 0; i < gpus.size(); ++i) {
      const double time = gpus.time(i, static_cast<double>(loop.loads[i]));
      least = std::min(least, time);
      most = std::max(most, time);
    }
    RC_ASSERT(most / least <= (1 + loop.options.dead_band) * (1 + loop.options.dead_band) + 0.01);
  }
}

RC_GTEST_PROP(NextWeightsProps, hardlyMoveForOneFrameOfAHundredTimes, (std::uint32_t seed)) {
  Random random(seed);
  const Gpus gpus(random, 2 + random() % 63);
  const std::vector<double> ideal = gpus.ideal_shares();
  WeightLoop loop;
  loop.options.dead_band = 0;
  loop.frames(10, gpus, load);
  const std::size_t slow = random() % gpus.size();
  loop.frame(gpus, load, [&](std::size_t i, double time) { return i == slow ? 100 * time : time; });
  RC_ASSERT(farthest(loop.shares(), ideal) <= 1.25 * rounding);
  RC_ASSERT(farthest(loop.shares(), ideal) >= 1.01);  // it was taken notice of
  loop.frames(12, gpus, load);
  RC_ASSERT(farthest(loop.shares(), ideal) <= 1.01);
  loop.frame(gpus, load, [&](std::size_t, double time) { return 100 * time; });  // all of them
  RC_ASSERT(farthest(loop.shares(), ideal) <= 1.01);
}

RC_GTEST_PROP(NextWeightsProps, recoverFromAFirstFrameOfAHundredTimes, (std::uint32_t seed)) {
  Random random(seed);
  const Gpus gpus(random, 2 + random() % 63, 1.0 / 4);
  WeightLoop loop;
  const std::size_t slow = random() % gpus.size();
  loop.frame(gpus, load, [&](std::size_t i, double time) { return i == slow ? 100 * time : time; });
  loop.frames(35 + 20, gpus, load);  // log 100 / log (1 / 0.875) = 34.5
  RC_ASSERT(farthest(loop.shares(), gpus.ideal_shares()) <= 1 + loop.options.dead_band + 0.01);
}

RC_GTEST_PROP(NextWeightsProps, surviveAnyMeasurement, (std::uint32_t seed)) {
  Random random(seed);
  const std::size_t n = any_number_of_gpus(random);
  WeightFeedback state;
  FeedbackOptions options{.smoothing = uniform(random, 0.01, 1), .largest_change = uniform(random, 1.001, 1024)};
  if (random() % 3 == 0) options = {.smoothing = 1, .largest_change = 1024, .dead_band = 0, .least_weight = 0x1p-20};
  std::vector<float> times(n);
  std::vector<std::uint64_t> loads(n);
  std::vector<std::uint32_t> weights(n);
  for (int frame = 0; frame < 50; ++frame) {
    for (float& time : times) time = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()));
    for (std::uint64_t& of : loads) of = random() % 3 == 0 ? 0 : std::uint64_t{random()} << (random() % 33);
    pgl::next_weights(state, times, loads, options, weights);
    std::uint32_t most = 0;
    for (const std::uint32_t weight : weights) {
      RC_ASSERT(weight >= static_cast<std::uint32_t>(options.least_weight * full_weight));
      RC_ASSERT(weight <= full_weight);
      most = std::max(most, weight);
    }
    RC_ASSERT(most == full_weight);
    for (const double pace : state.paces) RC_ASSERT((pace >= 0.0 && std::isfinite(pace)));
  }
}

// ---- the budget

/// A frame takes constant + cost * vertices milliseconds.
struct Scene {
  double constant = 0, cost = 1e-6;
  double available = 1e12;  ///< vertices that there are to draw
  double time(std::uint64_t drawn) const { return constant + cost * static_cast<double>(drawn); }
};

struct BudgetLoop {
  BudgetFeedback state;
  BudgetTarget target;
  FeedbackOptions options;
  std::size_t delay = 0;
  struct Frame {
    float time;
    std::uint64_t drawn;
  };
  std::deque<Frame> under_way;

  std::uint64_t drawn(const Scene& scene) const {
    return static_cast<std::uint64_t>(std::min(static_cast<double>(state.budget), scene.available));
  }
  /// Returns by how much the budget changed.
  double frame(const Scene& scene, double factor = 1) {
    under_way.push_back({static_cast<float>(scene.time(drawn(scene)) * factor), drawn(scene)});
    if (under_way.size() <= delay) return 1;
    const std::uint64_t before = state.budget;
    const std::uint64_t now = pgl::next_budget(state, under_way.front().time, under_way.front().drawn, target, options);
    under_way.pop_front();
    RC_ASSERT(now == state.budget);
    RC_ASSERT(now >= target.least);
    RC_ASSERT(now <= target.most);
    const double b = static_cast<double>(before), a = static_cast<double>(now);
    RC_ASSERT(a <= b * options.largest_change + 1);
    RC_ASSERT(a >= b / options.largest_change - 1);
    return a / b;
  }
};

/// A scene and a loop whose target it can meet.
Scene any_scene(Random& random, BudgetLoop& loop) {
  Scene scene;
  loop.target = {.milliseconds = uniform(random, 5, 50), .least = 1000, .most = std::uint64_t{1} << 32};
  scene.constant = random() % 2 == 0 ? 0 : uniform(random, 0, 0.5) * loop.target.milliseconds;
  scene.cost = std::pow(10.0, uniform(random, -6.5, -4.5));
  loop.state.budget = static_cast<std::uint64_t>(std::pow(10.0, uniform(random, 5.5, 7)));
  loop.delay = random() % 3;
  return scene;
}

void is_in_time(const BudgetLoop& loop, const Scene& scene, double noise) {
  const double time = scene.time(loop.state.budget) / loop.target.milliseconds;
  const double band = (1 + loop.options.dead_band) * 1.001;
  RC_ASSERT(time <= band / (1 - noise));
  RC_ASSERT(time >= 1 / band / (1 + noise));
}

RC_GTEST_PROP(NextBudgetProps, comesToTheTimeAndStaysThere, (std::uint32_t seed)) {
  Random random(seed);
  BudgetLoop loop;
  const Scene scene = any_scene(random, loop);
  for (int frame = 0; frame < 150; ++frame) loop.frame(scene);
  is_in_time(loop, scene, 0);
  for (int frame = 0; frame < 50; ++frame) RC_ASSERT(std::fabs(loop.frame(scene) - 1) <= loop.options.dead_band + 1e-3);
}

RC_GTEST_PROP(NextBudgetProps, holdsTheTimeInScenesThatJump, (std::uint32_t seed)) {
  Random random(seed);
  BudgetLoop loop;
  Scene scene = any_scene(random, loop);
  const double noise = uniform(random, 0, 0.2);
  const double jumps[] = {1, 10, 0.1, 0.1, 10, 10};
  for (const double jump : jumps) {
    scene.cost *= jump;
    for (int frame = 0; frame < 150; ++frame) {
      const bool wave = frame / 10 % 2 == 0;
      loop.frame(scene, random() % 2 == 0 ? noisy(random, noise) : wave ? 1 + noise : 1 - noise);
      if (frame >= 100) is_in_time(loop, scene, noise);
    }
  }
}

RC_GTEST_PROP(NextBudgetProps, recoversFromAFrameOfAHundredTimes, (std::uint32_t seed)) {
  Random random(seed);
  BudgetLoop loop;
  const Scene scene = any_scene(random, loop);
  for (int frame = 0; frame < 150; ++frame) loop.frame(scene);
  const double before = static_cast<double>(loop.state.budget);
  loop.frame(scene, 100);
  for (std::size_t frame = 0; frame <= loop.delay; ++frame) loop.frame(scene);
  RC_ASSERT(static_cast<double>(loop.state.budget) >= before / 1.25 / 1.03);
  RC_ASSERT(static_cast<double>(loop.state.budget) <= before / 1.05);  // it was taken notice of
  for (int frame = 0; frame < 60; ++frame) loop.frame(scene);
  is_in_time(loop, scene, 0);
}

RC_GTEST_PROP(NextBudgetProps, isThereAgainAfterALookAtTheSky, (std::uint32_t seed)) {
  Random random(seed);
  BudgetLoop loop;
  Scene scene = any_scene(random, loop);
  loop.delay = 0;
  for (int frame = 0; frame < 150; ++frame) loop.frame(scene);
  const double before = static_cast<double>(loop.state.budget);
  scene.available = static_cast<double>(1 + random() % 5000);
  const double factor = std::min(1.0, 0.9 * loop.target.milliseconds / scene.time(5000));  // in time all the same
  for (int frame = 0; frame < 200; ++frame) loop.frame(scene, factor * noisy(random, 0.1));
  RC_ASSERT(static_cast<double>(loop.state.budget) >= before * 0.999);
}

RC_GTEST_PROP(NextBudgetProps, survivesAnyMeasurement, (std::uint32_t seed)) {
  Random random(seed);
  BudgetFeedback state{.budget = random()};
  BudgetTarget target{.milliseconds = std::pow(10.0, uniform(random, -3, 6)), .least = 1 + random() % 1000};
  target.most = target.least + random();
  const FeedbackOptions options{.smoothing = uniform(random, 0.01, 1), .largest_change = uniform(random, 1.001, 1024)};
  for (int frame = 0; frame < 100; ++frame) {
    const float time = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()));
    const std::uint64_t drawn = random() % 3 == 0 ? 0 : std::uint64_t{random()} << (random() % 33);
    const std::uint64_t budget = pgl::next_budget(state, time, drawn, target, options);
    RC_ASSERT(budget >= target.least);
    RC_ASSERT(budget <= target.most);
    RC_ASSERT((state.pace >= 0.0 && std::isfinite(state.pace)));
  }
}

// ---- the threshold

/// A frame takes constant + scale * threshold^-power milliseconds.
struct Coarsening {
  double constant = 0, scale = 1, power = 1;
  double time(double threshold) const { return constant + scale * std::pow(threshold, -power); }
};

/// One whose time is the target's at a threshold of about 2.
Coarsening any_coarsening(Random& random, const ThresholdTarget& target, double most_power) {
  Coarsening c;
  c.power = uniform(random, 0.5, most_power);
  c.constant = random() % 2 == 0 ? 0 : uniform(random, 0, 0.5) * target.milliseconds;
  c.scale = (target.milliseconds - c.constant) * std::pow(uniform(random, 1, 4), c.power);
  return c;
}

RC_GTEST_PROP(NextThresholdProps, nearsTheTimeWithoutPassingBy, (std::uint32_t seed)) {
  Random random(seed);
  const ThresholdTarget target{.milliseconds = uniform(random, 5, 50), .least = 0.01f, .most = 1000};
  const FeedbackOptions options;
  const Coarsening c = any_coarsening(random, target, 3.1);
  float threshold = static_cast<float>(std::pow(10.0, uniform(random, -1, 2)));
  const bool from_above = c.time(threshold) < target.milliseconds;
  for (int frame = 0; frame < 150; ++frame) {
    threshold = pgl::next_threshold(threshold, static_cast<float>(c.time(threshold)), target, options);
    const double time = c.time(threshold) / target.milliseconds;
    RC_ASSERT((from_above ? time <= 1 + 1e-5 : time >= 1 - 1e-5));
  }
  const double time = c.time(threshold) / target.milliseconds;
  RC_ASSERT(std::fabs(time - 1) <= options.dead_band + 1e-5);
}

RC_GTEST_PROP(NextThresholdProps, holdsTheTimeInNoiseAndInScenesThatJump, (std::uint32_t seed)) {
  Random random(seed);
  const ThresholdTarget target{.milliseconds = uniform(random, 5, 50), .least = 0.001f, .most = 100000};
  const FeedbackOptions options;
  Coarsening c = any_coarsening(random, target, 3.1);
  const double noise = uniform(random, 0, 0.2);
  float threshold = 2;
  for (const double jump : {1.0, 10.0, 0.1, 0.1}) {
    c.scale *= jump;
    for (int frame = 0; frame < 200; ++frame) {
      const double factor = random() % 3 == 0 ? noisy(random, noise) : frame / 9 % 2 == 0 ? 1 + noise : 1 - noise;
      threshold = pgl::next_threshold(threshold, static_cast<float>(c.time(threshold) * factor), target, options);
      if (frame < 150) continue;
      const double time = c.time(threshold) / target.milliseconds;
      RC_ASSERT(time <= (1 + options.dead_band) / (1 - noise) * 1.001);
      RC_ASSERT(time >= (1 - options.dead_band) / (1 + noise) / 1.001);
    }
  }
}

RC_GTEST_PROP(NextThresholdProps, settlesWithATimeThatComesAFrameLate, (std::uint32_t seed)) {
  Random random(seed);
  const ThresholdTarget target{.milliseconds = uniform(random, 5, 50), .least = 0.01f, .most = 1000};
  const Coarsening c = any_coarsening(random, target, 3);  // s e is 3/4 at most
  float threshold = static_cast<float>(std::pow(10.0, uniform(random, -1, 2)));
  float late = static_cast<float>(c.time(threshold));
  for (int frame = 0; frame < 300; ++frame) {
    const float now = static_cast<float>(c.time(threshold));
    threshold = pgl::next_threshold(threshold, late, target, {});
    late = now;
  }
  RC_ASSERT(std::fabs(c.time(threshold) / target.milliseconds - 1) <= 0.025);
}

RC_GTEST_PROP(NextThresholdProps, survivesAnyMeasurement, (std::uint32_t seed)) {
  Random random(seed);
  const FeedbackOptions options{.smoothing = uniform(random, 0.01, 1), .largest_change = uniform(random, 1.001, 1024)};
  for (int frame = 0; frame < 100; ++frame) {
    const float time = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()));
    const float before = pgl::ieee::from_bits<float>(static_cast<std::uint32_t>(random()));
    const float threshold = pgl::next_threshold(before, time, {}, options);
    RC_ASSERT((threshold >= 0.25f && threshold <= 64.0f));
  }
}

// ---- all together

/// Several GPUs that share a budget out by the weights, both from the same times, in a scene that jumps.
RC_GTEST_PROP(FeedbackProps, weightsAndBudgetTogetherHoldTheTimeOfAllGpus, (std::uint32_t seed)) {
  Random random(seed);
  Gpus gpus(random, any_number_of_gpus(random));
  for (double& speed : gpus.speeds) speed *= 100;
  const BudgetTarget target{.milliseconds = uniform(random, 5, 50), .least = 1000};
  const double noise = random() % 2 == 0 ? 0 : 0.1;
  WeightLoop weights;
  BudgetFeedback budget;
  for (const double jump : {1.0, 10.0, 0.1}) {
    for (double& speed : gpus.speeds) speed /= jump;
    for (int frame = 0; frame < 150; ++frame) {
      std::vector<float> times(gpus.size());
      weights.frame(gpus, static_cast<double>(budget.budget), [&](std::size_t i, double time) {
        return times[i] = static_cast<float>(time * noisy(random, noise));
      });
      double slowest = 0;
      for (std::size_t i = 0; i < gpus.size(); ++i)
        slowest = std::max(slowest, gpus.time(i, static_cast<double>(weights.loads[i])));
      if (frame >= 100) {
        const double of_target = slowest / target.milliseconds;
        RC_ASSERT(of_target <= (1 + noise) / (1 - noise) / (1 - noise) * 1.06);
        RC_ASSERT(of_target >= 1 / (1 + noise) / 1.06);
      }
      pgl::next_budget(budget, pgl::frame_milliseconds(times), budget.budget, target, {});
    }
  }
}

}  // namespace
