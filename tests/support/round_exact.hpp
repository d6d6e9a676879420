// SPDX-License-Identifier: MIT
// The oracle of single operations: a rational number rounded to the nearest float or double by its definition. Needs
// gmpxx.
#pragma once

#include <gmpxx.h>

#include <cmath>
#include <limits>

namespace round_exact {

/// Two to the power k.
inline mpq_class power_of_two(long k) {
  mpq_class result(1);
  if (k >= 0)
    mpq_mul_2exp(result.get_mpq_t(), result.get_mpq_t(), static_cast<mp_bitcnt_t>(k));
  else
    mpq_div_2exp(result.get_mpq_t(), result.get_mpq_t(), static_cast<mp_bitcnt_t>(-k));
  return result;
}

/// The float or double nearest to `exact`, ties to the even last bit, subnormals and overflow included. Zero gives +0.
template <class T>
T nearest(const mpq_class& exact) {
  using Limits = std::numeric_limits<T>;
  if (exact == 0) return T(0);
  const mpq_class size = abs(exact);
  long exponent = static_cast<long>(mpz_sizeinbase(size.get_num_mpz_t(), 2)) -
                  static_cast<long>(mpz_sizeinbase(size.get_den_mpz_t(), 2));
  if (size < power_of_two(exponent)) --exponent;  // now 2^exponent <= size < 2^(exponent + 1)
  const long least = Limits::min_exponent - 1;
  const long last_bit = (exponent < least ? least : exponent) - (Limits::digits - 1);
  const mpq_class scaled = size * power_of_two(-last_bit);
  mpz_class whole = scaled.get_num() / scaled.get_den();
  const mpq_class rest = scaled - whole;
  if (rest > mpq_class(1, 2) || (rest == mpq_class(1, 2) && mpz_odd_p(whole.get_mpz_t()))) ++whole;
  const T result = std::ldexp(static_cast<T>(whole.get_d()), static_cast<int>(last_bit));
  return exact < 0 ? -result : result;
}

}  // namespace round_exact
