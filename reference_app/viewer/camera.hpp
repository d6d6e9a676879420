// SPDX-License-Identifier: MIT
// The viewer's camera: where it stands, what it sees, how it moves. World space is right-handed.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <utility>

#include "pgl/types.hpp"

#include <glm/gtc/matrix_transform.hpp>

namespace pgl::viewer {

struct Camera {
  glm::dvec3 eye{0.0, 0.0, 1.0};
  glm::dvec3 target{0.0};
  glm::dvec3 up{0.0, 1.0, 0.0};  ///< the world's, of unit length
  double fov_degrees = 45.0;     ///< vertical
};

/// Right, up and forward of the camera, orthonormal, also when it looks straight up or down.
struct CameraAxes {
  glm::dvec3 right, up, forward;
};

inline CameraAxes axes_of(const Camera& camera) {
  const glm::dvec3 forward = glm::normalize(camera.target - camera.eye);
  glm::dvec3 side = glm::cross(forward, camera.up);
  if (glm::dot(side, side) < 1e-12) side = glm::cross(forward, glm::dvec3(camera.up.y, camera.up.z, camera.up.x));
  const glm::dvec3 right = glm::normalize(side);
  return {right, glm::cross(right, forward), forward};
}

/// Calls visit(corner) for the eight corners of the box.
template <class Visit>
void each_corner(const Box& box, Visit&& visit) {
  for (int i = 0; i < 8; ++i) {
    visit(glm::dvec3(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z));
  }
}

/// Two horizontal directions that go with the up axis.
inline glm::dvec3 side_of(const glm::dvec3& up) {
  return {up.z, up.x, up.y};
}
inline glm::dvec3 front_of(const glm::dvec3& up) {
  return glm::cross(side_of(up), up);
}

/// A camera that looks along -direction, as near as it can be with the whole (non-empty) box in the picture.
inline Camera fit_camera(const Box& box, const glm::dvec3& direction, const glm::dvec3& up, double fov_degrees,
                         double aspect) {
  Camera camera;
  camera.up = up;
  camera.fov_degrees = fov_degrees;
  camera.eye = glm::normalize(direction);
  camera.target = glm::dvec3(0.0);
  const CameraAxes axes = axes_of(camera);

  // In the camera's axes, from the middle of the box: a corner c is in the picture of an eye at (x, y, z) where
  // |c.x - x| <= slope.x * (c.z - z), and the same in y. The farthest forward z that satisfies all corners, and the
  // middle of the x and y that do.
  const glm::dvec3 middle = 0.5 * (glm::dvec3(box.min) + glm::dvec3(box.max));
  const double slope_y = 0.94 * std::tan(glm::radians(fov_degrees) / 2.0);
  const glm::dvec2 slope(slope_y * aspect, slope_y);
  glm::dvec2 low(-std::numeric_limits<double>::infinity()), high(std::numeric_limits<double>::infinity());
  each_corner(box, [&](const glm::dvec3& corner) {
    const glm::dvec3 d = corner - middle;
    const glm::dvec2 c(glm::dot(d, axes.right), glm::dot(d, axes.up));
    low = glm::max(low, c - slope * glm::dot(d, axes.forward));
    high = glm::min(high, c + slope * glm::dot(d, axes.forward));
  });
  const glm::dvec2 reach = (high - low) / (2.0 * slope);
  const glm::dvec2 eye = (low + high) / 2.0;
  double z = std::min(reach.x, reach.y);
  if (!(z < 0.0)) z = -1.0;  // a single point
  camera.target = middle + axes.right * eye.x + axes.up * eye.y;
  camera.eye = camera.target + axes.forward * z;
  return camera;
}

/// A camera that looks from a raised corner at the whole (non-empty) box.
inline Camera fit_camera(const Box& box, const glm::dvec3& up, double fov_degrees, double aspect) {
  return fit_camera(box, 0.55 * side_of(up) + 0.8 * front_of(up) + 0.5 * up, up, fov_degrees, aspect);
}

/// A camera that looks from a raised corner at the whole box and at another camera within or beside it: of the four
/// corners from the one beside and a little behind that camera, so that what it sees and what is hidden from it show.
inline Camera reference_camera(Box box, const Camera& camera, double aspect) {
  const glm::vec3 eye(camera.eye);
  box.min = glm::min(box.min, eye);
  box.max = glm::max(box.max, eye);
  const CameraAxes axes = axes_of(camera);
  const glm::dvec3 liked = axes.right - 0.5 * axes.forward, side = side_of(camera.up), front = front_of(camera.up);
  glm::dvec3 best(0.0);
  double most = -std::numeric_limits<double>::infinity();
  for (int corner = 0; corner < 4; ++corner) {
    const glm::dvec3 level = (corner & 1 ? 0.7 : -0.7) * side + (corner & 2 ? 0.7 : -0.7) * front;
    if (glm::dot(level, liked) <= most) continue;
    most = glm::dot(level, liked);
    best = level;
  }
  return fit_camera(box, best + 0.8 * camera.up, camera.up, 35.0, aspect);
}

/// A camera on a flight through the (non-empty) box, at `time` from 0 to 1: from the overview of fit_camera down into
/// it, through it lengthwise near the ground, round a bend across it, and up again to look back. Smooth.
inline Camera fly(const Box& box, const glm::dvec3& up, double fov_degrees, double aspect, double time) {
  const glm::dvec3 middle = 0.5 * (glm::dvec3(box.min) + glm::dvec3(box.max));
  const glm::dvec3 half = 0.5 * (glm::dvec3(box.max) - glm::dvec3(box.min));
  const auto reach = [&](const glm::dvec3& axis) { return glm::dot(half, glm::abs(axis)); };
  glm::dvec3 along = side_of(up), across = front_of(up);
  if (reach(across) > reach(along)) std::swap(along, across);
  const auto at = [&](double a, double b, double height) {  // in half sizes of the box, the height from its floor
    return middle + along * (a * reach(along)) + across * (b * reach(across)) + up * ((height - 1.0) * reach(up));
  };
  const Camera first = fit_camera(box, up, fov_degrees, aspect);
  const std::array<glm::dvec3, 8> points = {first.eye,          at(-1.1, -0.3, 1.2), at(-0.8, -0.1, 0.4),
                                            at(0.0, -0.1, 0.3), at(0.5, 0.0, 0.3),   at(0.6, 0.5, 0.4),
                                            at(0.6, 1.0, 0.8),  at(0.9, 1.6, 2.0)};
  // Catmull-Rom: through all points, with the first and the last one doubled.
  const auto eye_at = [&](double t) {
    const double place = std::clamp(t, 0.0, 1.0) * (points.size() - 1.0);
    const auto i = std::min(static_cast<std::ptrdiff_t>(place), std::ssize(points) - 2);
    const double u = place - static_cast<double>(i);
    const auto point = [&](std::ptrdiff_t k) {
      return points[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(k, 0, std::ssize(points) - 1))];
    };
    const glm::dvec3 a = point(i - 1), b = point(i), c = point(i + 1), d = point(i + 2);
    return 0.5 * (2.0 * b + (c - a) * u + (2.0 * a - 5.0 * b + 4.0 * c - d) * (u * u) +
                  (3.0 * (b - c) + d - a) * (u * u * u));
  };
  Camera camera{eye_at(time), {}, up, fov_degrees};
  // It looks where it goes, and a little at the middle of the box; at the beginning and at the end, there alone.
  const auto ramp = [](double t) {
    t = std::clamp(t, 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
  };
  const double way = 0.7 * ramp((time - 0.05) / 0.15) * (1.0 - ramp((time - 0.65) / 0.15));
  const glm::dvec3 inwards = glm::normalize((time < 0.5 ? first.target : middle) - camera.eye);
  const glm::dvec3 ahead = eye_at(time + 0.06) - eye_at(time - 0.02);
  glm::dvec3 gaze = (1.0 - way) * inwards;
  if (glm::length(ahead) > 0.0) gaze += way * glm::normalize(ahead);
  camera.target = camera.eye + (glm::length(gaze) > 0.05 ? gaze : inwards);
  return camera;
}

/// The view of the camera on a picture of that size. The near and far planes hold the whole box between them, the near
/// plane at no less than 1/20000 of the far one. Throws std::runtime_error where that leaves the range of float.
inline View view_of(const Camera& camera, const Box& box, int width, int height) {
  const CameraAxes axes = axes_of(camera);
  double nearest = std::numeric_limits<double>::infinity();
  double farthest = 0.0;
  each_corner(box, [&](const glm::dvec3& corner) {
    const double depth = glm::dot(corner - camera.eye, axes.forward);
    nearest = std::min(nearest, depth);
    farthest = std::max(farthest, depth);
  });
  const double far_plane = farthest > 0.0 ? farthest * 1.001 : glm::distance(camera.eye, camera.target);
  const double near_plane = std::clamp(nearest * 0.999, far_plane / 20000.0, far_plane * 0.99);
  const double aspect = static_cast<double>(width) / height;
  View view;
  view.clip_from_world = glm::mat4(glm::perspective(glm::radians(camera.fov_degrees), aspect, near_plane, far_plane) *
                                   glm::lookAt(camera.eye, camera.target, axes.up));
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row) {
      if (!std::isfinite(view.clip_from_world[column][row])) {
        throw std::runtime_error("--camera: from there, the model is beyond the range of float");
      }
    }
  }
  view.width = static_cast<float>(width);
  view.height = static_cast<float>(height);
  view.near_depth = static_cast<float>(near_plane);
  return view;
}

/// `v` turned about the unit `axis`.
inline glm::dvec3 turned(const glm::dvec3& v, const glm::dvec3& axis, double radians) {
  return v * std::cos(radians) + glm::cross(axis, v) * std::sin(radians) +
         axis * (glm::dot(axis, v) * (1.0 - std::cos(radians)));
}

/// The direction turned by yaw about the world's up and by pitch about the camera's right, kept off the poles.
inline glm::dvec3 steered(const Camera& camera, const glm::dvec3& direction, double yaw, double pitch) {
  const CameraAxes axes = axes_of(camera);
  const double elevation = std::asin(std::clamp(glm::dot(axes.forward, camera.up), -1.0, 1.0));
  const double limit = glm::radians(89.0);
  pitch = std::clamp(elevation + pitch, -limit, limit) - elevation;
  return turned(turned(direction, axes.right, pitch), camera.up, yaw);
}

/// Moves the eye around the target.
inline void orbit(Camera& camera, double yaw, double pitch) {
  camera.eye = camera.target + steered(camera, camera.eye - camera.target, yaw, pitch);
}

/// Turns the gaze around the eye.
inline void look(Camera& camera, double yaw, double pitch) {
  camera.target = camera.eye + steered(camera, camera.target - camera.eye, yaw, pitch);
}

/// Moves eye and target together: x to the right, y up, z forward.
inline void move(Camera& camera, const glm::dvec3& by) {
  const CameraAxes axes = axes_of(camera);
  const glm::dvec3 step = axes.right * by.x + axes.up * by.y + axes.forward * by.z;
  camera.eye += step;
  camera.target += step;
}

/// Brings the eye nearer to the target (factor below 1) or farther away.
inline void zoom(Camera& camera, double factor) {
  camera.eye = camera.target + (camera.eye - camera.target) * factor;
}

}  // namespace pgl::viewer
