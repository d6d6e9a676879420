// SPDX-License-Identifier: MIT
#include <gmpxx.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <random>

#include "pgl/gather.hpp"

namespace {

/// Any finite float, or one of a moderate size so that terms meet and cancel.
float number(std::mt19937& random, int exponents) {
  for (;;) {
    const auto bits = static_cast<std::uint32_t>(random());
    const float x = exponents == 0 ? std::bit_cast<float>(bits)
                                   : std::ldexp(static_cast<float>(static_cast<std::int32_t>(bits)),
                                                static_cast<int>(random() % static_cast<unsigned>(exponents)) - 40);
    if (std::isfinite(x)) return x;
  }
}

mpq_class power_of_two(int exponent) {
  mpq_class one = 1, result;
  if (exponent < 0) {
    mpq_div_2exp(result.get_mpq_t(), one.get_mpq_t(), static_cast<mp_bitcnt_t>(-exponent));
  } else {
    mpq_mul_2exp(result.get_mpq_t(), one.get_mpq_t(), static_cast<mp_bitcnt_t>(exponent));
  }
  return result;
}

void is_within_the_stated_error(std::mt19937& random, int exponents, bool cancelling) {
  glm::mat4x3 m{1.0f};
  glm::vec3 p{};
  for (int row = 0; row < 3; ++row) {
    p[row] = number(random, exponents);
    for (int column = 0; column < 4; ++column) m[column][row] = number(random, exponents);
  }
  if (cancelling) {
    const glm::vec3 near = pgl::transform_point(m, p);
    for (int row = 0; row < 3; ++row) {
      if (std::isfinite(near[row] - m[3][row])) m[3][row] = -(near[row] - m[3][row]);
    }
  }
  const glm::vec3 result = pgl::transform_point(m, p);
  const mpq_class largest = power_of_two(128) - power_of_two(103);  // from here on float rounds to infinity
  for (int row = 0; row < 3; ++row) {
    mpq_class exact = m[3][row], sum = abs(exact);
    for (int column = 0; column < 3; ++column) {
      const mpq_class term = mpq_class(m[column][row]) * mpq_class(p[column]);
      exact += term;
      sum += abs(term);
    }
    const mpq_class error = abs(exact) * power_of_two(-24) + sum * power_of_two(-51) + power_of_two(-150);
    if (std::isinf(result[row])) {
      RC_ASSERT(abs(exact) + error >= largest);
      RC_ASSERT(std::signbit(result[row]) == (exact < 0));
    } else {
      RC_ASSERT(abs(mpq_class(result[row]) - exact) <= error);
    }
  }
}

RC_GTEST_PROP(GatherProps, transformsWithinTheStatedError, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  for (int i = 0; i < 100; ++i) {
    is_within_the_stated_error(random, 0, false);
    is_within_the_stated_error(random, 20, false);
    is_within_the_stated_error(random, 3, true);
    is_within_the_stated_error(random, 60, true);
  }
}

// Products of floats fill a double; with one product and one term that joins it exactly, only the last rounding is
// left.
RC_GTEST_PROP(GatherProps, roundsASingleProductCorrectly, (std::uint32_t seed)) {
  std::mt19937 random(seed);
  for (int i = 0; i < 100; ++i) {
    const float a = number(random, 0), x = number(random, 0);
    glm::mat4x3 m{0.0f};
    m[1].x = a;
    const float expected = static_cast<float>(static_cast<__float128>(a) * static_cast<__float128>(x));
    RC_ASSERT(pgl::transform_point(m, glm::vec3(3.0f, x, -5.0f)).x == expected);
  }
}

}  // namespace
