// SPDX-License-Identifier: MIT
#include "pgl/feedback.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <vector>

namespace {

using pgl::BudgetFeedback;
using pgl::BudgetTarget;
using pgl::FeedbackOptions;
using pgl::full_weight;
using pgl::ThresholdTarget;
using pgl::WeightFeedback;
using Weights = std::vector<std::uint32_t>;

constexpr float inf = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float odd_times[] = {0.0f, -0.0f, -1.0f, inf, -inf, nan};

TEST(Feedback, KnowsItsOptions) {
  EXPECT_TRUE(is_valid(FeedbackOptions{}));
  EXPECT_TRUE(is_valid(BudgetTarget{}));
  EXPECT_TRUE(is_valid(ThresholdTarget{}));
  const double nothing = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {0.0, 1.1, -1.0, nothing}) EXPECT_FALSE(is_valid(FeedbackOptions{.smoothing = bad}));
  for (const double bad : {1.0, 1025.0, 0.0, nothing}) EXPECT_FALSE(is_valid(FeedbackOptions{.largest_change = bad}));
  for (const double bad : {-0.1, 0.6, nothing}) EXPECT_FALSE(is_valid(FeedbackOptions{.dead_band = bad}));
  for (const double bad : {0.0, 1e-7, 1.5, nothing}) EXPECT_FALSE(is_valid(FeedbackOptions{.least_weight = bad}));
  EXPECT_FALSE(is_valid(BudgetTarget{.milliseconds = nothing}));
  EXPECT_FALSE(is_valid(BudgetTarget{.milliseconds = 0}));
  EXPECT_FALSE(is_valid(BudgetTarget{.least = 0}));
  EXPECT_FALSE(is_valid(BudgetTarget{.least = 2, .most = 1}));
  EXPECT_FALSE(is_valid(BudgetTarget{.most = (std::uint64_t{1} << 32) + 1}));
  EXPECT_FALSE(is_valid(ThresholdTarget{.milliseconds = nothing}));
  EXPECT_FALSE(is_valid(ThresholdTarget{.least = 0}));
  EXPECT_FALSE(is_valid(ThresholdTarget{.least = nan}));
  EXPECT_FALSE(is_valid(ThresholdTarget{.least = 2, .most = 1}));
}

TEST(FrameMilliseconds, IsTheLongestThatIsOne) {
  EXPECT_EQ(pgl::frame_milliseconds(std::vector<float>{3, 5, 4}), 5.0f);
  EXPECT_EQ(pgl::frame_milliseconds(std::vector<float>{nan, 5, inf, -7}), 5.0f);
  EXPECT_EQ(pgl::frame_milliseconds(std::vector<float>{nan, 0, -7}), 0.0f);
  EXPECT_EQ(pgl::frame_milliseconds({}), 0.0f);
}

struct Loop {
  WeightFeedback state;
  FeedbackOptions options;
  Weights operator()(const std::vector<float>& times, const std::vector<std::uint64_t>& loads) {
    Weights weights(times.size(), 99);
    pgl::next_weights(state, times, loads, options, weights);
    return weights;
  }
};

TEST(NextWeights, AreEqualBeforeAnythingIsMeasured) {
  for (const float time : odd_times) {
    Loop loop;
    EXPECT_EQ(loop({time, time, time}, {100, 200, 300}), (Weights{full_weight, full_weight, full_weight})) << time;
  }
  Loop loop;
  EXPECT_EQ(loop({5, 6}, {0, 0}), (Weights{full_weight, full_weight}));
  EXPECT_EQ(loop({nan}, {1}), (Weights{full_weight}));
}

TEST(NextWeights, TakeOverTheFirstMeasurement) {
  Loop loop;
  // 10, 20 and 5 units a millisecond.
  EXPECT_EQ(loop({10, 10, 20}, {100, 200, 100}), (Weights{full_weight / 2, full_weight, full_weight / 4}));
}

TEST(NextWeights, TakeOverPartOfTheOthers) {
  Loop loop;
  loop.options = {.smoothing = 0.5, .largest_change = 8, .dead_band = 0};
  loop({1, 1}, {100, 100});
  EXPECT_EQ(loop({1, 3}, {100, 100}), (Weights{full_weight, full_weight / 2}));  // 3 and 1: a pace of 2
  // 16 counts as 8 times the 2 at most; so 2 + (16 - 2) / 2 = 9, and the other's 1 comes from 1.
  EXPECT_EQ(loop({1, 1600}, {100, 100}), (Weights{full_weight, (full_weight + 4) / 9}));
}

TEST(NextWeights, DoNotChangeWithinTheDeadBand) {
  Loop loop;
  loop.options = {.smoothing = 1, .dead_band = 0.1};
  const Weights half = {full_weight / 2, full_weight};
  EXPECT_EQ(loop({2, 1}, {100, 100}), half);
  EXPECT_EQ(loop({1.8f, 1}, {100, 100}), half);  // 0.357 of all for 0.333: 1.07 times
  EXPECT_NE(loop({1.6f, 1}, {100, 100}), half);  // 0.385
}

TEST(NextWeights, IgnoreWhatSaysNothing) {
  Loop loop;
  loop({1, 2}, {100, 100});
  for (const float time : odd_times) EXPECT_EQ(loop({time, 2}, {100, 100}), (Weights{full_weight, full_weight / 2}));
  EXPECT_EQ(loop({50, 2}, {0, 100}), (Weights{full_weight, full_weight / 2}));
}

TEST(NextWeights, OfAGpuThatIsNotMeasuredYetAreThoseOfTheMean) {
  Loop loop;
  EXPECT_EQ(loop({1, 3, nan}, {100, 100, 100}), (Weights{full_weight, (full_weight + 1) / 3, full_weight / 2}));
}

TEST(NextWeights, AreAtLeastTheLeast) {
  Loop loop;
  EXPECT_EQ(loop({1, 1000}, {100, 100}), (Weights{full_weight, full_weight / 64}));
  Loop extreme;
  extreme.options.least_weight = 0x1p-20;
  EXPECT_EQ(extreme({1e-45f, 3e38f}, {~std::uint64_t{0}, 1}), (Weights{full_weight, 1}));
}

TEST(NextWeights, StartAnewForAnotherNumberOfGpus) {
  Loop loop;
  loop({1, 2}, {100, 100});
  EXPECT_EQ(loop({nan, nan, nan}, {1, 1, 1}), (Weights{full_weight, full_weight, full_weight}));
  EXPECT_EQ(loop({3, 1, 1}, {1, 1, 1}), (Weights{(full_weight + 1) / 3, full_weight, full_weight}));
}

TEST(NextBudget, IsWhatTheTimeAllows) {
  BudgetFeedback state{.budget = 1000};
  const BudgetTarget target{.milliseconds = 20};
  EXPECT_EQ(pgl::next_budget(state, 16, 1000, target, {}), 1250u);
  EXPECT_EQ(state.budget, 1250u);
  EXPECT_EQ(pgl::next_budget(state, 20, 1250, target, {}), 1250u);
}

TEST(NextBudget, ChangesByTheLargestChangeAtMost) {
  const BudgetTarget target{.milliseconds = 20};
  BudgetFeedback up{.budget = 1000}, down{.budget = 1000};
  EXPECT_EQ(pgl::next_budget(up, 0.001f, 1000, target, {}), 2000u);
  EXPECT_EQ(pgl::next_budget(down, 1e9f, 1000, target, {}), 500u);
}

TEST(NextBudget, StaysWithinItsBounds) {
  const BudgetTarget target{.milliseconds = 20, .least = 900, .most = 1100};
  BudgetFeedback state{.budget = 5};
  EXPECT_EQ(pgl::next_budget(state, nan, 5, target, {}), 900u);
  state = {.budget = 5000};
  EXPECT_EQ(pgl::next_budget(state, nan, 5, target, {}), 1100u);
  state = {.budget = 1000};
  EXPECT_EQ(pgl::next_budget(state, 1, 1000, target, {}), 1100u);
  state = {.budget = 1000};
  EXPECT_EQ(pgl::next_budget(state, 1000, 1000, target, {}), 900u);
}

TEST(NextBudget, IgnoresWhatSaysNothing) {
  const BudgetTarget target{.milliseconds = 20};
  BudgetFeedback state{.budget = 1000};
  for (int measured = 0; measured < 2; ++measured) {
    for (const float time : odd_times) EXPECT_EQ(pgl::next_budget(state, time, 1000, target, {}), 1000u) << time;
    EXPECT_EQ(pgl::next_budget(state, 5, 0, target, {}), 1000u);
    EXPECT_EQ(pgl::next_budget(state, 20, 1000, target, {}), 1000u);
  }
}

TEST(NextBudget, IsNotLoweredByAFrameInTime) {
  const BudgetTarget target{.milliseconds = 20};
  BudgetFeedback state{.budget = 1000};
  pgl::next_budget(state, 20, 1000, target, {});
  for (int frame = 0; frame < 100; ++frame) EXPECT_EQ(pgl::next_budget(state, 19, 10, target, {}), 1000u);
  EXPECT_LT(pgl::next_budget(state, 21, 10, target, {}), 1000u);
}

TEST(NextBudget, LeavesTheSmallestBudgetsAgain) {
  const BudgetTarget target{.milliseconds = 20};
  BudgetFeedback state{.budget = 1};
  const FeedbackOptions slow{.largest_change = 1.01, .dead_band = 0};
  for (int frame = 0; frame < 2000; ++frame)
    pgl::next_budget(state, 0.02f * static_cast<float>(state.budget), state.budget, target, slow);
  EXPECT_GE(state.budget, 999u);
  EXPECT_LE(state.budget, 1001u);
}

TEST(NextThreshold, GrowsWhereTheTimeIsTooLong) {
  const ThresholdTarget target{.milliseconds = 20, .least = 0.5f, .most = 8};
  EXPECT_EQ(pgl::next_threshold(1, 30, target, {}), 1.125f);
  EXPECT_EQ(pgl::next_threshold(1, 10, target, {}), 0.875f);
  EXPECT_EQ(pgl::next_threshold(1, 20.3f, target, {}), 1.0f);
  EXPECT_EQ(pgl::next_threshold(1, 1e30f, target, {}), 1.25f);
  EXPECT_EQ(pgl::next_threshold(1, 1e-30f, target, {}), 0.875f);
}

TEST(NextThreshold, StaysWithinItsBounds) {
  const ThresholdTarget target{.milliseconds = 20, .least = 0.5f, .most = 8};
  EXPECT_EQ(pgl::next_threshold(7.9f, 100, target, {}), 8.0f);
  EXPECT_EQ(pgl::next_threshold(0.51f, 1, target, {}), 0.5f);
  for (const float time : odd_times) {
    EXPECT_EQ(pgl::next_threshold(1, time, target, {}), 1.0f) << time;
    EXPECT_EQ(pgl::next_threshold(0, time, target, {}), 0.5f) << time;
    EXPECT_EQ(pgl::next_threshold(inf, time, target, {}), 8.0f) << time;
    EXPECT_EQ(pgl::next_threshold(nan, time, target, {}), 0.5f) << time;
  }
}

}  // namespace
