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
/// The bits of a NaN result are not part of the promise (processors differ), except where a function says so: test
/// for NaN, never store or compare its bits. Flags that break the promise and that the compiler tells of are refused
/// above; clang does not tell of -funsafe-math-optimizations or -fassociative-math given alone, nor nvcc of
/// --use_fast_math or -ftz=true, which flush the subnormal floats of device code.
namespace pgl::ieee {

namespace detail {

/// Hides a product from the compiler's contraction of a*b+c into fma (-ffp-contract=fast, g++'s default wherever the
/// target has fma). Costs no instruction, but keeps a loop around it scalar. g++'s __builtin_assoc_barrier would not,
/// but its vectoriser drops that barrier (g++ 12, -O3) and fuses after all.
template <class T>
PGL_HD constexpr T opaque(T x) {
#if !defined(__CUDA_ARCH__)
  if (!std::is_constant_evaluated()) {
#if (defined(__GNUC__) || defined(__clang__)) && defined(__x86_64__)
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

/// The NaN that log2, exp2 and pow return, always with these bits: positive, quiet, no payload.
template <class T>
inline constexpr T quiet_nan = std::numeric_limits<T>::quiet_NaN();

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

/// The number with this key: from_order_key<T>(order_key(a)) has the bits of a, for every a but NaN.
template <class T>
PGL_HD constexpr T from_order_key(typename detail::bits_of<T>::type key) {
  using U = typename detail::bits_of<T>::type;
  constexpr U sign = U{1} << (sizeof(U) * 8 - 1);
  return from_bits<T>((key & sign) ? key ^ sign : ~key);
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
  return -infinity<T> < a && a < infinity<T>;
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

namespace detail {

/// The unevaluated sum hi + lo, |lo| well below |hi|: a number with more bits than a double holds.
struct Pair {
  double hi;
  double lo;
};

/// The first 26 significant bits of a: the product of two such numbers is exact.
PGL_HD constexpr double top26(double a) {
  return from_bits<double>(to_bits(a) & 0xfffffffff8000000u);
}

/// log2(x) for 0 < x < infinity, with a relative error below 2^-65; hi is a top26, and hi + lo == k for x == 2^k.
///
/// x = 2^e m with m / c in [0.866, 1.2248], c = 1 or 3/2. With s = (m - c) / (m + c), hence |s| < 0.102, and
/// t = 3 + s^2 + s^4 (3/5 + 3/7 s^2 + 3/9 s^4 + ...), log2(x) = e + log2(c) + 2 / (3 ln 2) * s * t, where s, t and the
/// products carry a low part (the scheme of fdlibm's e_pow.c, K.C. Ng, 1993).
PGL_HD constexpr Pair log2_pair(double x) {
  std::uint64_t bits = to_bits(x);
  int e = -1023;
  if (bits < std::uint64_t{1} << 52) {
    bits = to_bits(mul(x, 0x1p54));
    e = -1023 - 54;
  }
  e += static_cast<int>(bits >> 52);
  double m = from_bits<double>((bits & 0xfffffffffffffu) | 0x3ff0000000000000u);
  if (m > 1.7320508) {
    m = mul(m, 0.5);
    ++e;
  }
  const bool near_one = m < 1.2247449;
  const double c = near_one ? 1.0 : 1.5;
  const double base = add(static_cast<double>(e), near_one ? 0.0 : 0x1.2b803400p-1);  // exact
  const double base_l = near_one ? 0.0 : 0x1.cfdeb43cfd006p-27;                       // the rest of log2(3/2)

  // s = s_h + s_l. The divisor m + c is d_h + d_l exactly.
  const double f = sub(m, c);
  const double d = add(m, c);
  const double r = div(1.0, d);
  const double s_h = top26(mul(f, r));
  const double d_h = top26(d);
  const double d_l = sub(m, sub(d_h, c));
  const double s_l = mul(r, sub(sub(f, mul(s_h, d_h)), mul(s_h, d_l)));
  const double s = add(s_h, s_l);

  // rest = s^4 (3/5 + 3/7 s^2 + ...) + (s^2 - s_h^2); what is cut off the series is below 2^-70.
  const double z = mul(s, s);
  const double w = mul(z, z);
  double even = add(mul(w, 3.0 / 17), 3.0 / 13);
  even = add(mul(w, even), 3.0 / 9);
  even = add(mul(w, even), 3.0 / 5);
  double odd = add(mul(w, 3.0 / 19), 3.0 / 15);
  odd = add(mul(w, odd), 3.0 / 11);
  odd = add(mul(w, odd), 3.0 / 7);
  const double rest = add(mul(w, add(even, mul(z, odd))), mul(s_l, add(s_h, s)));

  // t = t_h + t_l and s * t = p_h + p_l.
  const double q = mul(s_h, s_h);
  const double t_h = top26(add(3.0, add(q, rest)));
  const double t_l = sub(rest, sub(sub(t_h, 3.0), q));
  const double u = mul(s_h, t_h);
  const double v = add(mul(s_l, t_h), mul(t_l, s));
  const double p_h = top26(add(u, v));
  const double p_l = sub(v, sub(p_h, u));

  constexpr double scale = 0x1.ec709dc3a03fdp-1;  // 2 / (3 ln 2) = scale_h + scale_l, to 2^-80
  constexpr double scale_h = 0x1.ec709d8p-1;
  constexpr double scale_l = 0x1.0e80ff5d27f05p-27;
  const double y_h = mul(scale_h, p_h);
  const double y_l = add(add(mul(scale_l, p_h), mul(scale, p_l)), base_l);
  const double hi = top26(add(base, add(y_h, y_l)));
  return {hi, sub(y_l, sub(sub(hi, base), y_h))};
}

/// 2^(hi + lo) for finite hi and |lo| at most half an ulp of hi; what is rounded at the end is within 2^-57 of exact.
///
/// hi = k + f with |f| <= 1/2, w = (f + lo) ln 2, and 1 + w + w^2/2 is carried in two parts under the rest of the
/// series.
PGL_HD constexpr double exp2_pair(double hi, double lo) {
  if (hi >= 1025.0) return infinity<double>;
  if (hi <= -1077.0) return 0.0;
  const double nearest = sub(add(hi, 0x1.8p52), 0x1.8p52);
  const auto k = static_cast<int>(nearest);
  const double f = sub(hi, nearest);

  constexpr double ln2 = 0x1.62e42fefa39efp-1;  // = ln2_h + ln2_l, to 2^-81
  constexpr double ln2_h = 0x1.62e42f8p-1;
  constexpr double ln2_l = 0x1.be8e7bcd5e4f2p-27;
  const double f_h = top26(f);
  const double a_h = mul(f_h, ln2_h);
  const double a_l = add(mul(sub(f, f_h), ln2), mul(f_h, ln2_l));
  const double w = add(a_h, a_l);
  const double w_h = top26(w);
  const double w_l = add(sub(a_h, w_h), a_l);

  // series = w^3/3! + w^4/4! + ..., cut where |w| <= 0.3466 makes it 2^-63.
  const double z = mul(w, w);
  double even = 1.0 / 6227020800;
  even = add(mul(even, z), 1.0 / 39916800);
  even = add(mul(even, z), 1.0 / 362880);
  even = add(mul(even, z), 1.0 / 5040);
  even = add(mul(even, z), 1.0 / 120);
  even = add(mul(even, z), 1.0 / 6);
  double odd = 1.0 / 87178291200;
  odd = add(mul(odd, z), 1.0 / 479001600);
  odd = add(mul(odd, z), 1.0 / 3628800);
  odd = add(mul(odd, z), 1.0 / 40320);
  odd = add(mul(odd, z), 1.0 / 720);
  odd = add(mul(odd, z), 1.0 / 24);
  const double series = mul(mul(z, w), add(even, mul(odd, w)));

  // 2^f = s + t. The square of w is (w_h)^2 and w_l (w_h + w).
  const double square = mul(0.5, mul(w_h, w_h));
  const double u = add(w_h, square);
  const double u_rest = sub(square, sub(u, w_h));
  const double s = add(1.0, u);
  const double s_rest = sub(u, sub(s, 1.0));
  const double small = add(w_l, add(mul(mul(0.5, w_l), add(w_h, w)), series));
  const double t = add(add(s_rest, add(u_rest, small)), mul(mul(lo, ln2), add(s, small)));

  const double p = add(s, t);
  const int biased = static_cast<int>(to_bits(p) >> 52) + k;
  if (biased >= 2047) return infinity<double>;
  if (biased > 0) return from_bits<double>(to_bits(p) + (static_cast<std::uint64_t>(k) << 52));
  // A subnormal result: added to `unit`, whose ulp is 2^(-1074 - k), the sum is rounded once and where it must be.
  const double unit = from_bits<double>(static_cast<std::uint64_t>(1 - k) << 52);
  const double sum = add(unit, s);
  const double sum_rest = add(sub(s, sub(sum, unit)), t);
  return from_bits<double>(to_bits(add(sum, sum_rest)) - to_bits(unit));
}

}  // namespace detail

/// Takes the base-2 logarithm.
///
/// Within 0.501 ulp of the exact value for every x > 0, subnormals included, and exactly k for x = 2^k. Never
/// decreases: x <= y gives log2(x) <= log2(y), since what is rounded is known to much less than the step between two
/// neighbours. log2(+-0) = -inf, log2(inf) = inf; a negative x or NaN gives quiet_nan.
PGL_HD constexpr double log2(double x) {
  if (!(x >= 0.0)) return quiet_nan<double>;
  if (x == 0.0) return -infinity<double>;
  if (x == infinity<double>) return x;
  const detail::Pair l = detail::log2_pair(x);
  return add(l.hi, l.lo);
}

/// The same for float, through double; the correctly rounded result for every float.
PGL_HD constexpr float log2(float x) {
  if (!(x >= 0.0f)) return quiet_nan<float>;
  return to_float(log2(static_cast<double>(x)));
}

/// Raises 2 to the power x.
///
/// Within 0.55 ulp of the exact value, where the ulp of a subnormal result is 2^-1074, and exact for integer x down to
/// -1074. Never decreases. Overflows to inf from x = 1024 on, rounds to 0 at x <= -1075; exp2(inf) = inf,
/// exp2(-inf) = 0, NaN gives quiet_nan.
PGL_HD constexpr double exp2(double x) {
  if (x != x) return quiet_nan<double>;
  return detail::exp2_pair(x, 0.0);
}

/// The same for float, through double: the correctly rounded result for all floats but two, 0x1.853a6ep-9 and
/// -0x1.e7526ep-6, where the exact value is so near a tie that the other neighbour comes out.
PGL_HD constexpr float exp2(float x) {
  if (x != x) return quiet_nan<float>;
  return to_float(exp2(static_cast<double>(x)));
}

/// Raises x >= 0 to the power y, as exp2(y * log2(x)) with the logarithm and the product in two parts.
///
/// Within 0.6 ulp of the exact value (the ulp of a subnormal result is 2^-1074), and exact wherever the exact value is
/// a double: pow(x, 1) = x, pow(3, 4) = 81. Not promised to be monotone in the last place.
/// pow(x, +-0) = 1 and pow(1, y) = 1 for every x and y that the next line does not refuse. pow(0, y) is 0 for y > 0 and
/// inf for y < 0, -0 counting as 0; pow(inf, y) the reverse; y = +-inf is the limit of large |y|.
/// x < 0 or a NaN in either place gives quiet_nan (unlike C, for which pow(NaN, 0) = pow(1, NaN) = 1).
PGL_HD constexpr double pow(double x, double y) {
  if (!(x >= 0.0) || y != y) return quiet_nan<double>;
  if (y == 0.0) return 1.0;
  if (x == 0.0 || x == infinity<double>) return (x == 0.0) == (y > 0.0) ? 0.0 : infinity<double>;
  const double exponent = max(min(y, 0x1p66), -0x1p66);  // enough for over- or underflow at any x but 1
  const detail::Pair l = detail::log2_pair(x);
  const double exponent_h = detail::top26(exponent);
  const double product_h = mul(exponent_h, l.hi);
  const double product_l = add(mul(sub(exponent, exponent_h), l.hi), mul(exponent, l.lo));
  const double hi = add(product_h, product_l);
  return detail::exp2_pair(hi, sub(product_l, sub(hi, product_h)));
}

/// The same for float, through double: within 0.500001 ulp. Never decreases in x for y >= 0, never increases for y <=
/// 0, and likewise in y on either side of x = 1.
PGL_HD constexpr float pow(float x, float y) {
  if (!(x >= 0.0f) || y != y) return quiet_nan<float>;
  return to_float(pow(static_cast<double>(x), static_cast<double>(y)));
}

}  // namespace pgl::ieee
