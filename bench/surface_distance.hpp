// SPDX-License-Identifier: MIT
// Symmetric root mean square distance between two surfaces, by sampling: what a user sees of a simplification.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <span>
#include <vector>

#include "pgl/types.hpp"

namespace pgl::bench {

/// Nearest-point queries against a triangle mesh, by a bounding volume hierarchy.
class Surface {
 public:
  Surface(std::span<const glm::vec3> positions, std::span<const Triangle<std::uint32_t>> triangles) {
    for (const auto& t : triangles) {
      corners_.push_back({glm::dvec3(positions[t.v[0]]), glm::dvec3(positions[t.v[1]]), glm::dvec3(positions[t.v[2]])});
    }
    order_.resize(corners_.size());
    std::iota(order_.begin(), order_.end(), 0u);
    if (!order_.empty()) build(0, static_cast<std::uint32_t>(order_.size()));
  }

  /// Squared distance from p to the surface; infinite when there is none.
  double squared_distance(const glm::dvec3& p) const {
    double best = std::numeric_limits<double>::infinity();
    if (!nodes_.empty()) visit(0, p, best);
    return best;
  }

  /// `count` points spread over the surface by area, the same ones every time.
  std::vector<glm::dvec3> samples(std::size_t count) const {
    std::vector<double> area(corners_.size() + 1, 0.0);
    for (std::size_t t = 0; t < corners_.size(); ++t) {
      const auto& c = corners_[t];
      area[t + 1] = area[t] + glm::length(glm::cross(c.p[1] - c.p[0], c.p[2] - c.p[0]));
    }
    std::vector<glm::dvec3> points;
    if (!(area.back() > 0)) return points;
    for (std::size_t i = 0; i < count; ++i) {
      const double at = area.back() * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
      const auto t = static_cast<std::size_t>(std::upper_bound(area.begin(), area.end() - 1, at) - area.begin()) - 1;
      double u = fraction(static_cast<double>(i) * 0.7548776662466927);
      double v = fraction(static_cast<double>(i) * 0.5698402909980532);
      if (u + v > 1) u = 1 - u, v = 1 - v;
      const auto& c = corners_[t];
      points.push_back(c.p[0] + u * (c.p[1] - c.p[0]) + v * (c.p[2] - c.p[0]));
    }
    return points;
  }

 private:
  struct Corners {
    glm::dvec3 p[3];
  };
  struct Node {
    glm::dvec3 low, high;
    std::uint32_t begin, end;  ///< of order_, in a leaf
    std::uint32_t right = 0;   ///< the second child; the first follows its parent. 0 in a leaf
  };

  static double fraction(double x) { return x - std::floor(x); }

  std::uint32_t build(std::uint32_t begin, std::uint32_t end) {
    const auto at = static_cast<std::uint32_t>(nodes_.size());
    Node node{glm::dvec3(std::numeric_limits<double>::infinity()), glm::dvec3(-std::numeric_limits<double>::infinity()),
              begin, end};
    for (std::uint32_t i = begin; i < end; ++i)
      for (const auto& p : corners_[order_[i]].p) {
        node.low = glm::min(node.low, p);
        node.high = glm::max(node.high, p);
      }
    nodes_.push_back(node);
    if (end - begin > 4) {
      const glm::dvec3 size = node.high - node.low;
      const int axis = size.x >= size.y ? (size.x >= size.z ? 0 : 2) : (size.y >= size.z ? 1 : 2);
      const std::uint32_t middle = begin + (end - begin) / 2;
      std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, [&](auto a, auto b) {
        const auto &p = corners_[a].p, &q = corners_[b].p;
        return p[0][axis] + p[1][axis] + p[2][axis] < q[0][axis] + q[1][axis] + q[2][axis];
      });
      build(begin, middle);
      nodes_[at].right = build(middle, end);
    }
    return at;
  }

  static double squared_box_distance(const Node& n, const glm::dvec3& p) {
    const glm::dvec3 d = glm::max(glm::max(n.low - p, p - n.high), glm::dvec3(0));
    return glm::dot(d, d);
  }

  void visit(std::uint32_t at, const glm::dvec3& p, double& best) const {
    const Node& n = nodes_[at];
    if (n.right == 0) {
      for (std::uint32_t i = n.begin; i < n.end; ++i)
        best = std::min(best, squared_triangle_distance(corners_[order_[i]], p));
      return;
    }
    std::uint32_t first = at + 1, second = n.right;
    double d1 = squared_box_distance(nodes_[first], p), d2 = squared_box_distance(nodes_[second], p);
    if (d2 < d1) std::swap(first, second), std::swap(d1, d2);
    if (d1 < best) visit(first, p, best);
    if (d2 < best) visit(second, p, best);
  }

  static double squared_segment_distance(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& p) {
    const glm::dvec3 ab = b - a;
    const double l = glm::dot(ab, ab);
    const double t = l > 0 ? std::clamp(glm::dot(p - a, ab) / l, 0.0, 1.0) : 0.0;
    const glm::dvec3 d = p - (a + t * ab);
    return glm::dot(d, d);
  }
  static double squared_triangle_distance(const Corners& c, const glm::dvec3& p) {
    const glm::dvec3 n = glm::cross(c.p[1] - c.p[0], c.p[2] - c.p[0]);
    const double nn = glm::dot(n, n);
    bool inside = nn > 0;
    double edges = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
      const glm::dvec3 &a = c.p[i], &b = c.p[(i + 1) % 3];
      inside = inside && glm::dot(glm::cross(b - a, p - a), n) >= 0;
      edges = std::min(edges, squared_segment_distance(a, b, p));
    }
    const double h = glm::dot(p - c.p[0], n);
    return inside ? std::min(edges, h * h / nn) : edges;
  }

  std::vector<Corners> corners_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

/// Root mean square of the distances from `count` points of each surface to the other.
inline double symmetric_rms(const Surface& a, const Surface& b, std::size_t count) {
  double sum = 0;
  for (const auto& p : a.samples(count)) sum += b.squared_distance(p);
  for (const auto& p : b.samples(count)) sum += a.squared_distance(p);
  return std::sqrt(sum / (2.0 * static_cast<double>(count)));
}

}  // namespace pgl::bench
