// SPDX-License-Identifier: MIT
// Properties of the exact arithmetic over arbitrary bit patterns.
#include "pgl/ieee.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <cstdint>

#include "support/quad.hpp"
#include "support/round_exact.hpp"

namespace ieee = pgl::ieee;

namespace {

std::uint64_t word() {
  return *rc::gen::resize(rc::kNominalSize, rc::gen::arbitrary<std::uint64_t>());
}

/// Any float: every bit pattern is as likely.
float any_float() {
  return ieee::from_bits<float>(static_cast<std::uint32_t>(word() >> 32));
}

/// Any double: every bit pattern is as likely.
double any_double() {
  return ieee::from_bits<double>(word());
}

float finite_float() {
  const float x = any_float();
  return std::isfinite(x) ? x : 1.0f;
}

/// A positive finite double of any size.
double positive() {
  return ieee::from_bits<double>(1 + word() % 0x7fefffffffffffffu);
}

/// A double in (-1080, 1030), close to 0 as often as far from it.
double exponent() {
  const double x = static_cast<double>(static_cast<std::int64_t>(word())) * 0x1p-63;
  return word() % 2 == 0 ? x * 1.5 : -25 + 1055 * x;
}

}  // namespace

RC_GTEST_PROP(IeeeProps, floatOperationsAreTheRationalResultRoundedOnce, ()) {
  const float a = finite_float(), b = finite_float();
  // Any size against any size, and sizes close together, where a sum cancels.
  const float c = word() % 2 == 0 ? finite_float() : std::ldexp(b, static_cast<int>(std::ilogb(a == 0 ? 1 : a)) % 64);
  RC_PRE(std::isfinite(c));
  const auto agrees = [](float got, const mpq_class& exact) { return got == round_exact::nearest<float>(exact); };
  RC_ASSERT(agrees(ieee::add(a, c), mpq_class(a) + mpq_class(c)));
  RC_ASSERT(agrees(ieee::sub(a, c), mpq_class(a) - mpq_class(c)));
  RC_ASSERT(agrees(ieee::mul(a, c), mpq_class(a) * mpq_class(c)));
  RC_ASSERT(agrees(ieee::fma(a, b, c), mpq_class(a) * mpq_class(b) + mpq_class(c)));
  if (c != 0) RC_ASSERT(agrees(ieee::div(a, c), mpq_class(a) / mpq_class(c)));
}

RC_GTEST_PROP(IeeeProps, theProductIsRoundedBeforeItIsAdded, ()) {
  const float a = finite_float(), b = finite_float();
  const float product = round_exact::nearest<float>(mpq_class(a) * mpq_class(b));
  RC_PRE(std::isfinite(product));
  RC_ASSERT(ieee::sub(ieee::mul(a, b), product) == 0.0f);  // fused, this is the rounding error
}

RC_GTEST_PROP(IeeeProps, keysCompareLikeNumbers, ()) {
  const float a = any_float(), b = word() % 4 == 0 ? ieee::next_up(a) : any_float();
  const auto key_a = ieee::order_key(a), key_b = ieee::order_key(b);
  if (std::isnan(a) || std::isnan(b)) {
    RC_ASSERT((key_a == key_b) == (std::isnan(a) && std::isnan(b)));
    RC_ASSERT((key_a < key_b) == (!std::isnan(a) && std::isnan(b)));
  } else if (a != b) {
    RC_ASSERT((key_a < key_b) == (a < b));
  } else {
    RC_ASSERT((key_a < key_b) == (std::signbit(a) && !std::signbit(b)));
  }
}

RC_GTEST_PROP(IeeeProps, stepUpThenDownReturns, ()) {
  const double a = any_double();
  RC_PRE(std::isfinite(a) && a != 0 && std::isfinite(ieee::next_up(a)));
  RC_ASSERT(ieee::next_down(ieee::next_up(a)) == a);
  RC_ASSERT(a < ieee::next_up(a));
}

RC_GTEST_PROP(IeeeProps, log2IsMonotoneAndAccurate, ()) {
  const double x = positive(), y = word() % 2 == 0 ? ieee::next_up(x) : positive();
  RC_PRE(std::isfinite(y));
  RC_ASSERT((x < y ? ieee::log2(x) <= ieee::log2(y) : ieee::log2(x) >= ieee::log2(y)));
  RC_ASSERT(quad::ulps(ieee::log2(x), quad::log2(x)) <= 0.501);
}

RC_GTEST_PROP(IeeeProps, exp2IsMonotoneAndAccurate, ()) {
  const double x = exponent(), y = word() % 2 == 0 ? ieee::next_up(x) : exponent();
  RC_ASSERT((x < y ? ieee::exp2(x) <= ieee::exp2(y) : ieee::exp2(x) >= ieee::exp2(y)));
  RC_ASSERT(quad::ulps(ieee::exp2(x), quad::exp2(x)) <= 0.55);
}

RC_GTEST_PROP(IeeeProps, powIsAccurate, ()) {
  const double x = positive();
  const double y = exponent() / std::log2(x);
  RC_PRE(std::isfinite(y));
  RC_ASSERT(quad::ulps(ieee::pow(x, y), quad::pow(x, y)) <= 0.6);
}

RC_GTEST_PROP(IeeeProps, powOfTwoIsExp2, ()) {
  const double y = exponent();
  RC_ASSERT(ieee::to_bits(ieee::pow(2.0, y)) == ieee::to_bits(ieee::exp2(y)));
}

RC_GTEST_PROP(IeeeProps, logarithmsGiveOneAnswerForAnyBits, ()) {
  const double x = any_double(), y = any_double();
  const auto canonical = [](double r) {
    return !std::isnan(r) || ieee::to_bits(r) == ieee::to_bits(ieee::quiet_nan<double>);
  };
  RC_ASSERT(canonical(ieee::log2(x)));
  RC_ASSERT(std::isnan(ieee::log2(x)) == !(x >= 0));
  RC_ASSERT(canonical(ieee::exp2(x)));
  RC_ASSERT(std::isnan(ieee::exp2(x)) == std::isnan(x));
  RC_ASSERT(canonical(ieee::pow(x, y)));
  RC_ASSERT(std::isnan(ieee::pow(x, y)) == (!(x >= 0) || std::isnan(y)));
}
