// SPDX-License-Identifier: MIT
// From how long frames took to what the next ones are asked for.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "pgl/feedback.hpp"
#include "viewer/tiling.hpp"

namespace pgl::viewer {

/// How a frame went in one rank.
struct Taken {
  float ms = 0.0f;      ///< of its own work, waiting for others left out
  float waited = 0.0f;  ///< of the frame before, milliseconds: telling each other, and waiting for it
  std::uint64_t vertices = 0, triangles = 0;
  bool stop = false;  ///< somebody wants to see no more
};

/// The budget, the threshold and the weights of the next frame: as they were given, or with a frame time as
/// feedback.hpp says; the weights of all ranks from the times of all, so that all have the same.
class Pace {
 public:
  /// Vertices, however long they take: a frame of nothing would be in time, and tell nothing.
  static constexpr std::uint64_t least_budget = 1000;

  Pace(const BudgetOptions& distribution, float threshold, LodMode lod, std::optional<double> frame_time, bool weighs,
       int ranks, int rank)
      : lod_(lod), frame_time_(frame_time), weighs_(weighs), rank_(static_cast<std::size_t>(rank)) {
    request_.distribution = distribution;
    request_.threshold = threshold;
    budget_.budget = distribution.budget;
    std::fill_n(request_.weights.begin(), ranks, full_weight);
  }

  const FrameRequest& request() const { return request_; }

  /// What to draw where nothing is measured.
  void set_budget(std::uint64_t budget) {
    if (!frame_time_) request_.distribution.budget = budget;
  }

  /// all: by rank, of the same frame.
  void follow(std::span<const Taken> all) {
    const Taken& own = all[rank_];
    // What comes to every frame, however fast the others are: who waits least waits for nobody.
    const float shared = std::ranges::min(all, {}, &Taken::waited).waited;
    const float frame_ms = own.ms + shared;
    if (frame_time_ && lod_ == LodMode::budget) {
      request_.distribution.budget =
          next_budget(budget_, frame_ms, own.vertices,
                      BudgetTarget{.milliseconds = *frame_time_, .least = least_budget}, FeedbackOptions{});
    } else if (frame_time_) {
      request_.threshold = next_threshold(request_.threshold, frame_ms, ThresholdTarget{.milliseconds = *frame_time_},
                                          FeedbackOptions{});
    }
    if (!weighs_ || all.size() < 2) return;
    std::vector<float> ms(all.size());
    std::vector<std::uint64_t> loads(all.size());
    std::ranges::transform(all, ms.begin(), &Taken::ms);
    std::ranges::transform(all, loads.begin(), &Taken::triangles);
    next_weights(weights_, ms, loads, FeedbackOptions{}, std::span(request_.weights).first(all.size()));
  }

 private:
  const LodMode lod_;
  const std::optional<double> frame_time_;
  const bool weighs_;
  const std::size_t rank_;
  FrameRequest request_;
  BudgetFeedback budget_;
  WeightFeedback weights_;
};

}  // namespace pgl::viewer
