// SPDX-License-Identifier: MIT
// The rule of select_by_error: the fewest vertices whose geometric error stays below a threshold on the screen.
#pragma once

#include <cstdint>

#include "pgl/bounds.hpp"
#include "pgl/config.hpp"
#include "pgl/distribute_budget.hpp"
#include "pgl/ieee.hpp"
#include "pgl/types.hpp"

// How far can an error be seen? Let p be a point of an object and p' the one that stands for it at a coarser count, at
// most e apart in the world, and neither nearer to the camera than D, the least clip.w of the object's box, which holds
// both. With rows x, y, w of clip_from_world, q = clip.x / clip.w of p, and d = p' - p,
//
//   q' - q = (x.d - q w.d) / clip.w'      (and the same from p', with q' and clip.w)
//
// So if one of the two is on the viewport, where |q| <= 1, in pixels (times half the width and half the height) p' is
// at most |M d| / D from p, M the two rows width / 2 (x - q w) and height / 2 (y - r w). The largest singular value of
// M is convex in (q, r), so it is greatest at a corner of the viewport: that is pixels_per_unit, which depends on the
// view alone, and |M d| / D <= pixels_per_unit * e / D. A mesh's error grows by no more than error_scale, the largest
// singular value of the object's transform.

namespace pgl {

/// What select_by_error is asked for.
struct ErrorOptions {
  float threshold = 1.0f;  ///< pixels that an error may take on the screen, >= 0
  float pet = 0.0f;        ///< pixels squared, >= 0: objects with a smaller area on the screen are not drawn
};

/// Tells whether every option is in its documented range. NaN is in none.
PGL_HD constexpr bool is_valid(const ErrorOptions& options) {
  return options.threshold >= 0.0f && options.pet >= 0.0f;
}

namespace detail {

/// Bounds a product's sum a0*b0 + a1*b1 + a2*b2 of floats from above, by its size.
PGL_HD inline double dot_size_above(const double (&a)[3], const double (&b)[3]) {
  double term[3];
  for (int i = 0; i < 3; ++i) term[i] = ieee::mul(a[i], b[i]);  // exact
  const double upper = add_above(add_above(term[0], term[1]), term[2]);
  const double lower = add_below(add_below(term[0], term[1]), term[2]);
  return ieee::max(upper, -lower);
}

/// The greatest sum of sizes in a row of the Gram matrix of three vectors: at least the square of the largest singular
/// value of the matrix that has them as rows.
PGL_HD inline double gram_norm_above(const double (&v)[3][3]) {
  double most = 0.0;
  for (int i = 0; i < 3; ++i) {
    const double x = dot_size_above(v[i], v[0]), y = dot_size_above(v[i], v[1]), z = dot_size_above(v[i], v[2]);
    most = ieee::max(add_above(add_above(x, y), z), most);
  }
  return most;
}

/// The least double at or above the square root of a, which is 0 or neither very small nor very large.
PGL_HD inline double sqrt_above(double a) {
  const double root = ieee::sqrt(a);
  return ieee::fma(root, root, -a) < 0.0 ? ieee::next_up(root) : root;
}

}  // namespace detail

/// Bounds how much longer a transform makes anything: at least its largest singular value, at most 1.32 times that.
///
/// It is the square root of the lesser of the greatest row sums of |A^T A| and |A A^T|, rounded up to a float: exact
/// for any rotation or mirroring with a scale along each axis before or after it, so far as the matrix itself is.
/// 0 for the zero matrix; infinite beyond float's range, and for an entry that is infinite or NaN. The translation does
/// not matter.
PGL_HD inline float error_scale(const glm::mat4x3& transform) {
  double columns[3][3], rows[3][3];
  for (int column = 0; column < 3; ++column)
    for (int row = 0; row < 3; ++row) {
      const float entry = transform[column][row];
      if (!ieee::is_finite(entry)) return ieee::infinity<float>;
      columns[column][row] = rows[row][column] = static_cast<double>(entry);
    }
  const double square = ieee::min(detail::gram_norm_above(columns), detail::gram_norm_above(rows));
  return detail::float_above(detail::sqrt_above(square));
}

/// Bounds how many pixels a world unit takes on the screen at depth (clip w) 1, wherever it is on the viewport and
/// however it lies; at depth D, or farther, it takes at most a D-th of that. See the top of this file.
///
/// Too large by at most a few parts in 10^12 of the greatest at the viewport's corners, then rounded up to a float
/// (infinite beyond its range). For a square picture with a field of view of 90 degrees it is sqrt(3) times what a unit
/// across the view takes in the middle of it, with less at narrower ones; with an orthographic matrix it is just that.
/// Preconditions: those of project on the view.
PGL_HD inline float pixels_per_unit(const View& view) {
  const double half_width = ieee::mul(static_cast<double>(view.width), 0.5);
  const double half_height = ieee::mul(static_cast<double>(view.height), 0.5);
  double greatest = 0.0;
  for (int corner = 0; corner < 4; ++corner) {
    // The rows of M, divided by their greatest entry, so that squares neither overflow nor vanish.
    double u[3], v[3];
    double most = 0.0;
    for (int i = 0; i < 3; ++i) {
      const glm::vec4& column = view.clip_from_world[i];
      const double w = static_cast<double>(column.w);
      u[i] = ieee::mul(half_width, static_cast<double>(column.x));  // exact, as are the three products below
      v[i] = ieee::mul(half_height, static_cast<double>(column.y));
      u[i] = ieee::add(u[i], corner & 1 ? ieee::mul(half_width, w) : -ieee::mul(half_width, w));
      v[i] = ieee::add(v[i], corner & 2 ? ieee::mul(half_height, w) : -ieee::mul(half_height, w));
      most = ieee::max(most, ieee::max(detail::magnitude(u[i]), detail::magnitude(v[i])));
    }
    if (!(most > 0.0)) continue;
    double uu = 0.0, vv = 0.0, uv = 0.0;
    for (int i = 0; i < 3; ++i) {
      const double a = ieee::div(u[i], most), b = ieee::div(v[i], most);
      uu = ieee::add(uu, ieee::mul(a, a));
      vv = ieee::add(vv, ieee::mul(b, b));
      uv = ieee::add(uv, ieee::mul(a, b));
    }
    const double apart = ieee::sub(uu, vv), twice = ieee::mul(uv, 2.0);
    const double root = ieee::sqrt(ieee::add(ieee::mul(apart, apart), ieee::mul(twice, twice)));
    const double square = ieee::mul(ieee::add(ieee::add(uu, vv), root), 0.5);
    greatest = ieee::max(greatest, ieee::mul(ieee::sqrt(square), most));
  }
  return detail::float_above(ieee::mul(greatest, 1.0 + 0x1p-40));  // the roundings above are below 2^-46 of it
}

/// What select_by_error takes from a view and its options, once for all objects.
struct ErrorView {
  float pixels_per_unit = 1.0f;  ///< see the function
  float near_depth = 1e-3f;      ///< smaller depths count as this one
  float threshold = 1.0f;        ///< pixels
  float pet = 0.0f;              ///< pixels squared
};

/// Preconditions: those of project on the view; is_valid(options).
PGL_HD inline ErrorView error_view_of(const View& view, const ErrorOptions& options) {
  PGL_ASSERT(view.width > 0.0f && ieee::is_finite(view.width) && view.height > 0.0f && ieee::is_finite(view.height));
  PGL_ASSERT(view.near_depth > 0.0f && ieee::is_finite(view.near_depth));
  PGL_ASSERT(is_valid(options));
  return {pixels_per_unit(view), view.near_depth, options.threshold, options.pet};
}

/// Tells whether an object is drawn: with an area above 0 and not below the PET, and a depth that is neither infinite
/// nor NaN, as in distribute_budget. All others get the count 0.
PGL_HD constexpr bool is_seen(float area, float depth, const ErrorView& view) {
  return area > 0.0f && area >= view.pet && depth < ieee::infinity<float>;
}

/// Selects the vertex count of an object that is drawn: the fewest in [min_vertices, max_vertices] at which
///
///   error * g <= threshold * max(depth, near_depth)   in exact arithmetic,  g = scale * pixels_per_unit rounded up,
///
/// that is, at which the mesh's error projects to at most the threshold; max_vertices where none is. An error of 0 is
/// below any threshold, an infinite one below an infinite one only.
///
/// errors: the error of each count of each mesh, beside Mesh's map: entry first_map + (k - min_vertices) is that at k
/// vertices. scale: error_scale of the object's transform.
/// Preconditions: mesh.min_vertices <= min_vertices <= max_vertices <= mesh.max_vertices; a mesh's errors are at least
/// 0 and never rise with the count, as build_ecol writes them (others still give a count in the range); the depth is
/// not NaN. O(log vertices).
PGL_HD inline std::uint32_t vertices_by_error(float depth, std::uint32_t min_vertices, std::uint32_t max_vertices,
                                              float scale, const Mesh& mesh, const float* errors,
                                              const ErrorView& view) {
  // Products of two floats are exact in double.
  const double g = static_cast<double>(
      detail::float_above(ieee::mul(static_cast<double>(scale), static_cast<double>(view.pixels_per_unit))));
  const double limit =
      ieee::mul(static_cast<double>(view.threshold), static_cast<double>(ieee::max(depth, view.near_depth)));
  const float* const error_at_min = errors + mesh.first_map;
  std::uint32_t low = min_vertices, high = max_vertices;
  // By ever larger steps from the coarsest count on, near which most objects end, then by halves.
  bool found = false;
  for (std::uint32_t step = 0; low < high; step = 2 * step + 1) {
    const std::uint32_t left = high - low;
    const std::uint32_t middle = low + (!found && step < left ? step : left / 2);
    const float error = error_at_min[middle - mesh.min_vertices];
    if (error == 0.0f || ieee::mul(static_cast<double>(error), g) <= limit) {
      high = middle;
      found = true;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

}  // namespace pgl
