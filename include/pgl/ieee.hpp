// SPDX-License-Identifier: MIT
// Exact arithmetic: one IEEE-754 operation per call, so that a rule gives the same bits on every compiler and device.
#pragma once

#include <bit>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "pgl/config.hpp"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST) || \
    defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "pgl promises equal bits on every backend: compile without -ffast-math and its parts"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && !defined(__CUDA_ARCH__)
#error "pgl promises equal bits on every backend: compile without excess precision (x87)"
#endif

/// Arithmetic that decides anything goes through here. Every function below that is not documented otherwise is a
/// single correctly rounded operation, round to nearest even; nothing is contracted, reassociated or flushed.
/// The caller's thread must be in the default floating-point environment (no FTZ/DAZ, nearest rounding).
namespace pgl::ieee {

namespace detail {

/// Hides a product from the compiler's contraction of a*b+c into fma (-ffp-contract=fast), at no cost.
template <class T>
PGL_HD constexpr T opaque(T x) {
#if !defined(__CUDA_ARCH__)
  if (!std::is_constant_evaluated()) {
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 12 && !defined(__CUDACC__)
    return __builtin_assoc_barrier(x);
#elif (defined(__GNUC__) || defined(__clang__)) && defined(__x86_64__)
    asm("" : "+x"(x));
#elif (defined(__GNUC__) || defined(__clang__)) && defined(__aarch64__)
    asm("" : "+w"(x));
#elif defined(__GNUC__) || defined(__clang__)
    asm("" : "+m"(x));
#endif
  }
#endif
  return x;
}

template <class T>
struct bits_of;
template <>
struct bits_of<float> {
  using type = std::uint32_t;
};
template <>
struct bits_of<double> {
  using type = std::uint64_t;
};

}  // namespace detail

PGL_HD constexpr float add(float a, float b) {
#if defined(__CUDA_ARCH__)
  return __fadd_rn(a, b);
#else
  return a + b;
#endif
}
PGL_HD constexpr double add(double a, double b) {
#if defined(__CUDA_ARCH__)
  return __dadd_rn(a, b);
#else
  return a + b;
#endif
}

PGL_HD constexpr float sub(float a, float b) {
#if defined(__CUDA_ARCH__)
  return __fsub_rn(a, b);
#else
  return a - b;
#endif
}
PGL_HD constexpr double sub(double a, double b) {
#if defined(__CUDA_ARCH__)
  return __dsub_rn(a, b);
#else
  return a - b;
#endif
}

PGL_HD constexpr float mul(float a, float b) {
#if defined(__CUDA_ARCH__)
  return __fmul_rn(a, b);
#else
  return detail::opaque(a * b);
#endif
}
PGL_HD constexpr double mul(double a, double b) {
#if defined(__CUDA_ARCH__)
  return __dmul_rn(a, b);
#else
  return detail::opaque(a * b);
#endif
}

PGL_HD constexpr float div(float a, float b) {
#if defined(__CUDA_ARCH__)
  return __fdiv_rn(a, b);
#else
  return a / b;
#endif
}
PGL_HD constexpr double div(double a, double b) {
#if defined(__CUDA_ARCH__)
  return __ddiv_rn(a, b);
#else
  return a / b;
#endif
}

PGL_HD inline float sqrt(float a) {
#if defined(__CUDA_ARCH__)
  return __fsqrt_rn(a);
#else
  return std::sqrt(a);
#endif
}
PGL_HD inline double sqrt(double a) {
#if defined(__CUDA_ARCH__)
  return __dsqrt_rn(a);
#else
  return std::sqrt(a);
#endif
}

/// a*b+c with one rounding. The only fused operation there is.
PGL_HD inline float fma(float a, float b, float c) {
#if defined(__CUDA_ARCH__)
  return __fmaf_rn(a, b, c);
#else
  return std::fma(a, b, c);
#endif
}
PGL_HD inline double fma(double a, double b, double c) {
#if defined(__CUDA_ARCH__)
  return __fma_rn(a, b, c);
#else
  return std::fma(a, b, c);
#endif
}

/// Nearest float of a double (ties to even; overflow to infinity, gradual underflow).
PGL_HD constexpr float to_float(double a) {
#if defined(__CUDA_ARCH__)
  return __double2float_rn(a);
#else
  return static_cast<float>(a);
#endif
}

/// The bit pattern of a float or double, and back.
template <class T>
PGL_HD constexpr typename detail::bits_of<T>::type to_bits(T a) {
#if defined(__CUDA_ARCH__)
  if constexpr (sizeof(T) == 4)
    return __float_as_uint(a);
  else
    return static_cast<std::uint64_t>(__double_as_longlong(a));
#else
  return std::bit_cast<typename detail::bits_of<T>::type>(a);
#endif
}
template <class T>
PGL_HD constexpr T from_bits(typename detail::bits_of<T>::type bits) {
#if defined(__CUDA_ARCH__)
  if constexpr (sizeof(T) == 4)
    return __uint_as_float(bits);
  else
    return __longlong_as_double(static_cast<long long>(bits));
#else
  return std::bit_cast<T>(bits);
#endif
}

/// Positive infinity, as a constant that host and device code may use.
template <class T>
inline constexpr T infinity = std::numeric_limits<T>::infinity();

/// An unsigned integer that orders like the number itself: -inf < … < -0 < +0 < … < +inf < NaN.
/// Every NaN gives the same, largest key. -0 is below +0.
template <class T>
PGL_HD constexpr typename detail::bits_of<T>::type order_key(T a) {
  using U = typename detail::bits_of<T>::type;
  constexpr U sign = U{1} << (sizeof(U) * 8 - 1);
  if (a != a) return ~U{0};
  const U bits = to_bits(a);
  return (bits & sign) ? ~bits : (bits | sign);
}

/// The next representable number above (below) a: next_up(-0) = next_up(+0) = the least positive subnormal,
/// next_up(+inf) = +inf, NaN stays NaN. next_up(f(x)) of a correctly rounded f is an upper bound of the exact value.
template <class T>
PGL_HD constexpr T next_up(T a) {
  using U = typename detail::bits_of<T>::type;
  constexpr U sign = U{1} << (sizeof(U) * 8 - 1);
  if (!(a < infinity<T>)) return a;
  const U bits = to_bits(a);
  if ((bits & ~sign) == 0) return from_bits<T>(U{1});
  return from_bits<T>((bits & sign) ? bits - 1 : bits + 1);
}
template <class T>
PGL_HD constexpr T next_down(T a) {
  return -next_up(-a);
}

/// True for neither NaN nor infinity.
template <class T>
PGL_HD constexpr bool is_finite(T a) {
  return a - a == T(0);
}

/// The smaller (larger) of two numbers; the second where either is NaN. min(+0, -0) is the second.
template <class T>
PGL_HD constexpr T min(T a, T b) {
  return a < b ? a : b;
}
template <class T>
PGL_HD constexpr T max(T a, T b) {
  return a > b ? a : b;
}

}  // namespace pgl::ieee
