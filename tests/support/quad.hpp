// SPDX-License-Identifier: MIT
// binary128 logarithm, exponential and power: the oracle of pgl::ieee's own. Needs libquadmath where long double is
// less.
#pragma once

#include <cmath>

namespace quad {

#if __LDBL_MANT_DIG__ == 113
using Real = long double;
inline Real log2(Real x) {
  return std::log2(x);
}
inline Real exp2(Real x) {
  return std::exp2(x);
}
inline Real pow(Real x, Real y) {
  return std::pow(x, y);
}
inline Real scale(Real x, int k) {
  return std::ldexp(x, k);
}
inline int exponent(Real x) {
  return std::ilogb(x);
}
#else
__extension__ typedef __float128 Real;
extern "C" {  // declared here since quadmath.h is out of clang's sight
Real log2q(Real);
Real exp2q(Real);
Real powq(Real, Real);
Real scalbnq(Real, int);
int ilogbq(Real);
}
inline Real log2(Real x) {
  return log2q(x);
}
inline Real exp2(Real x) {
  return exp2q(x);
}
inline Real pow(Real x, Real y) {
  return powq(x, y);
}
inline Real scale(Real x, int k) {
  return scalbnq(x, k);
}
inline int exponent(Real x) {
  return ilogbq(x);
}
#endif

/// The distance of `got` from `exact` in units of the last place of a double there; of 2^-1074 among the subnormals.
/// Infinity counts as the exact value from 2^1024 on, and as 2^1024 below, where rounding may overflow to it.
inline double ulps(double got, Real exact) {
  if (std::isinf(got) && exact >= scale(Real(1), 1024)) return 0.0;
  if (exact == 0) return got == 0 ? 0.0 : HUGE_VAL;
  const Real value = std::isinf(got) ? std::copysign(1.0, got) * scale(Real(1), 1024) : Real(got);
  int e = exponent(exact);
  if (e < -1022) e = -1022;
  if (e > 1023) e = 1023;
  const Real error = value - exact;
  return static_cast<double>(scale(error < 0 ? -error : error, 52 - e));
}

}  // namespace quad
