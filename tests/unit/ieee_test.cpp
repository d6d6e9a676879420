// SPDX-License-Identifier: MIT
// The exact arithmetic against rational numbers, and log2, exp2 and pow against binary128.
#include "pgl/ieee.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "support/quad.hpp"
#include "support/round_exact.hpp"

namespace ieee = pgl::ieee;

namespace {

template <class T>
using Bits = decltype(ieee::to_bits(T{}));

template <class T>
constexpr T inf = std::numeric_limits<T>::infinity();
template <class T>
constexpr T nan_value = std::numeric_limits<T>::quiet_NaN();
template <class T>
constexpr T tiny = std::numeric_limits<T>::denorm_min();
template <class T>
constexpr T huge = std::numeric_limits<T>::max();

/// Equal bits, or both NaN.
template <class T>
bool same(T a, T b) {
  return (std::isnan(a) && std::isnan(b)) || ieee::to_bits(a) == ieee::to_bits(b);
}

/// Every `step`-th exponent, subnormals and infinity with NaN included, with hard and random mantissas and both signs.
template <class T>
std::vector<T> samples(int step, int random_mantissas) {
  constexpr int mantissa_bits = std::numeric_limits<T>::digits - 1;
  constexpr Bits<T> exponents = Bits<T>{1} << (sizeof(T) * 8 - 1 - mantissa_bits);
  constexpr Bits<T> mask = (Bits<T>{1} << mantissa_bits) - 1;
  std::mt19937_64 random(20240501);
  std::vector<T> result;
  for (Bits<T> exponent = 0; exponent < exponents; ++exponent) {
    const bool edge = exponent < 3 || exponent + 3 > exponents;
    if (!edge && exponent % static_cast<Bits<T>>(step) != 0) continue;
    std::vector<Bits<T>> mantissas{0, 1, mask, static_cast<Bits<T>>(random()) & mask};
    for (int i = 1; i < random_mantissas; ++i) mantissas.push_back(static_cast<Bits<T>>(random()) & mask);
    for (const Bits<T> mantissa : mantissas) {
      const T x = ieee::from_bits<T>((exponent << mantissa_bits) | mantissa);
      result.push_back(x);
      result.push_back(-x);
    }
  }
  return result;
}

/// The rational result of a finite operation, rounded; `zero_is_negative` says which zero an exact zero is.
template <class T>
T rounded(const mpq_class& exact, bool zero_is_negative) {
  const T result = round_exact::nearest<T>(exact);
  return exact == 0 && zero_is_negative ? -result : result;
}

template <class T>
void expect_exact_operations(T a, T b) {
  const auto message = [&](const char* op) { return testing::Message() << op << " " << a << " " << b; };
  if (!std::isfinite(a) || !std::isfinite(b)) {
    const long double x = a, y = b;
    EXPECT_TRUE(same(ieee::add(a, b), static_cast<T>(x + y))) << message("add");
    EXPECT_TRUE(same(ieee::sub(a, b), static_cast<T>(x - y))) << message("sub");
    EXPECT_TRUE(same(ieee::mul(a, b), static_cast<T>(x * y))) << message("mul");
    EXPECT_TRUE(same(ieee::div(a, b), static_cast<T>(x / y))) << message("div");
    return;
  }
  const mpq_class x(a), y(b);
  const bool minus_a = std::signbit(a), minus_b = std::signbit(b);
  EXPECT_TRUE(same(ieee::add(a, b), rounded<T>(x + y, a == 0 && b == 0 && minus_a && minus_b))) << message("add");
  EXPECT_TRUE(same(ieee::sub(a, b), rounded<T>(x - y, a == 0 && b == 0 && minus_a && !minus_b))) << message("sub");
  EXPECT_TRUE(same(ieee::mul(a, b), rounded<T>(x * y, minus_a != minus_b))) << message("mul");
  if (b != 0) {
    EXPECT_TRUE(same(ieee::div(a, b), rounded<T>(x / y, minus_a != minus_b))) << message("div");
  } else {
    const T expected = a == 0 ? nan_value<T> : (minus_a != minus_b ? -inf<T> : inf<T>);
    EXPECT_TRUE(same(ieee::div(a, b), expected)) << message("div");
  }
}

template <class T>
void expect_exact_pairs(const std::vector<T>& values, int partners) {
  constexpr int digits = std::numeric_limits<T>::digits;
  std::mt19937_64 random(7);
  for (const T a : values) {
    for (int i = 0; i < partners; ++i) expect_exact_operations(a, values[random() % values.size()]);
    // A partner of nearly the same size, where a sum cancels or a tie is near.
    const T near = std::ldexp(a, static_cast<int>(random() % (2 * digits + 4)) - (digits + 2));
    expect_exact_operations(a, ieee::next_up(near));
    expect_exact_operations(a, -near);
    expect_exact_operations(a, ieee::next_down(-a));
  }
}

template <class T>
void expect_exact_fma(T a, T b, T c) {
  if (!std::isfinite(a) || !std::isfinite(b) || !std::isfinite(c)) return;
  const mpq_class product = mpq_class(a) * mpq_class(b);
  const mpq_class exact = product + mpq_class(c);
  const bool minus_product = std::signbit(a) != std::signbit(b);
  const bool minus_zero = product == 0 && c == 0 && minus_product && std::signbit(c);
  EXPECT_TRUE(same(ieee::fma(a, b, c), rounded<T>(exact, minus_zero))) << a << " " << b << " " << c;
}

template <class T>
void expect_exact_fmas(const std::vector<T>& values, int count) {
  std::mt19937_64 random(11);
  const auto pick = [&] { return values[random() % values.size()]; };
  for (int i = 0; i < count; ++i) {
    const T a = pick(), b = pick();
    expect_exact_fma(a, b, pick());
    const T product = a * b;
    expect_exact_fma(a, b, -product);  // what is left is the rounding error of the product
    expect_exact_fma(a, b, ieee::next_down(-std::ldexp(product, static_cast<int>(random() % 120) - 60)));
  }
}

template <class T>
void expect_exact_square_root(T a) {
  const T root = ieee::sqrt(a);
  if (std::isnan(a) || a < 0) {
    EXPECT_TRUE(std::isnan(root)) << a;
  } else if (a == 0 || std::isinf(a)) {
    EXPECT_TRUE(same(root, a)) << a;
  } else {
    // The root never lies halfway between two numbers, so strictly between both halves is the definition.
    const mpq_class below = (mpq_class(root) + mpq_class(ieee::next_down(root))) / 2;
    const mpq_class above = (mpq_class(root) + mpq_class(ieee::next_up(root))) / 2;
    EXPECT_LT(below * below, mpq_class(a)) << a;
    EXPECT_GT(above * above, mpq_class(a)) << a;
  }
}

/// `values` without NaN, each number once, by the numbers' own order with -0 before +0.
template <class T>
std::vector<T> in_order(std::vector<T> values) {
  std::erase_if(values, [](T x) { return std::isnan(x); });
  std::sort(values.begin(), values.end(),
            [](T a, T b) { return a < b || (a == b && std::signbit(a) && !std::signbit(b)); });
  values.erase(std::unique(values.begin(), values.end(), same<T>), values.end());
  return values;
}

template <class T>
void expect_keys_in_order(const std::vector<T>& values) {
  for (const T value : values)
    EXPECT_EQ(ieee::to_bits(ieee::from_order_key<T>(ieee::order_key(value))), ieee::to_bits(value)) << value;
  for (std::size_t i = 1; i < values.size(); ++i)
    EXPECT_LT(ieee::order_key(values[i - 1]), ieee::order_key(values[i])) << values[i - 1] << " " << values[i];
  constexpr auto last = static_cast<Bits<T>>(~Bits<T>{0});
  EXPECT_LT(ieee::order_key(inf<T>), last);
  EXPECT_EQ(ieee::order_key(nan_value<T>), last);
  EXPECT_EQ(ieee::order_key(-nan_value<T>), last);
  EXPECT_EQ(ieee::order_key(ieee::from_bits<T>(ieee::to_bits(inf<T>) + 1)), last);  // a signalling one
}

template <class T>
void expect_neighbours(const std::vector<T>& values) {
  for (const T a : values) {
    const T up = ieee::next_up(a), down = ieee::next_down(a);
    EXPECT_TRUE(same(up, std::nextafter(a, inf<T>)) || (a == -tiny<T> && same(up, -T(0)))) << a;
    EXPECT_TRUE(same(down, std::nextafter(a, -inf<T>)) || (a == tiny<T> && same(down, T(0)))) << a;
  }
  EXPECT_TRUE(same(ieee::next_up(-T(0)), tiny<T>));
  EXPECT_TRUE(same(ieee::next_down(T(0)), -tiny<T>));
  EXPECT_TRUE(same(ieee::next_up(huge<T>), inf<T>));
  EXPECT_TRUE(same(ieee::next_up(-inf<T>), -huge<T>));
  EXPECT_TRUE(same(ieee::next_up(inf<T>), inf<T>));
  EXPECT_TRUE(std::isnan(ieee::next_up(nan_value<T>)));
  EXPECT_TRUE(std::isnan(ieee::next_down(nan_value<T>)));
}

template <class T>
void expect_choices(const std::vector<T>& values) {
  std::mt19937_64 random(5);
  for (const T a : values) {
    EXPECT_EQ(ieee::is_finite(a), std::isfinite(a)) << a;
    EXPECT_TRUE(same(ieee::from_bits<T>(ieee::to_bits(a)), a));
    const T b = values[random() % values.size()];
    const bool ordered = !std::isnan(a) && !std::isnan(b) && a != b;
    EXPECT_TRUE(same(ieee::min(a, b), ordered && a < b ? a : b)) << a << " " << b;
    EXPECT_TRUE(same(ieee::max(a, b), ordered && a > b ? a : b)) << a << " " << b;
  }
  EXPECT_TRUE(same(ieee::min(T(0), -T(0)), -T(0)));
  EXPECT_TRUE(same(ieee::max(-T(0), T(0)), T(0)));
  EXPECT_TRUE(same(ieee::min(nan_value<T>, T(1)), T(1)));
  EXPECT_TRUE(std::isnan(ieee::max(T(1), nan_value<T>)));
}

// Usable where a constant is needed.
static_assert(ieee::add(ieee::mul(0.1f, 3.0f), 1.0f) == 1.3f);
static_assert(ieee::log2(8.0) == 3.0 && ieee::exp2(-1074.0) == tiny<double> && ieee::pow(3.0, 4.0) == 81.0);
static_assert(ieee::log2(8.0f) == 3.0f && ieee::exp2(-149.0f) == tiny<float> && ieee::pow(3.0f, 4.0f) == 81.0f);

}  // namespace

TEST(Ieee, RoundsEachFloatOperationOnce) {
  expect_exact_pairs(samples<float>(1, 4), 20);
}
TEST(Ieee, RoundsEachDoubleOperationOnce) {
  expect_exact_pairs(samples<double>(1, 2), 2);
}

TEST(Ieee, RoundsFmaOnce) {
  expect_exact_fmas(samples<float>(1, 2), 30000);
  expect_exact_fmas(samples<double>(1, 1), 12000);
  EXPECT_TRUE(std::isnan(ieee::fma(inf<float>, 0.0f, 1.0f)));
  EXPECT_TRUE(std::isnan(ieee::fma(inf<double>, 1.0, -inf<double>)));
  EXPECT_EQ(ieee::fma(huge<double>, 2.0, -huge<double>), huge<double>);
}

TEST(Ieee, RoundsSquareRootsOnce) {
  for (const float a : samples<float>(1, 40)) expect_exact_square_root(a);
  for (const double a : samples<double>(1, 2)) expect_exact_square_root(a);
}

TEST(Ieee, RoundsDoublesToTheNearestFloat) {
  std::mt19937_64 random(3);
  const auto expect = [](double a) {
    const float expected = std::isfinite(a) ? rounded<float>(mpq_class(a), std::signbit(a)) : static_cast<float>(a);
    EXPECT_TRUE(same(ieee::to_float(a), expected)) << a;
  };
  for (const double a : samples<double>(1, 1)) expect(a);
  for (const float a : samples<float>(1, 3)) {  // around every kind of float, and around the ties between two
    const double x = a, middle = std::isfinite(a) ? x + (static_cast<double>(ieee::next_up(a)) - x) / 2 : x;
    for (const double b : {x, middle}) {
      expect(b);
      expect(ieee::next_up(b));
      expect(ieee::next_down(b));
    }
  }
}

TEST(Ieee, OrdersKeysLikeNumbers) {
  expect_keys_in_order(in_order(samples<float>(1, 8)));
  expect_keys_in_order(in_order(samples<double>(1, 8)));
}

TEST(Ieee, StepsToTheNeighbouringNumber) {
  expect_neighbours(samples<float>(1, 8));
  expect_neighbours(samples<double>(1, 8));
}

TEST(Ieee, TellsFiniteNumbersAndChoosesTheSmallerAndLarger) {
  expect_choices(samples<float>(1, 8));
  expect_choices(samples<double>(1, 8));
}

TEST(Ieee, KnowsTheBitsOfItsConstants) {
  EXPECT_EQ(ieee::to_bits(ieee::infinity<float>), 0x7f800000u);
  EXPECT_EQ(ieee::to_bits(ieee::infinity<double>), 0x7ff0000000000000u);
  EXPECT_EQ(ieee::to_bits(ieee::quiet_nan<float>), 0x7fc00000u);
  EXPECT_EQ(ieee::to_bits(ieee::quiet_nan<double>), 0x7ff8000000000000u);
  EXPECT_EQ(ieee::to_bits(-0.0f), 0x80000000u);
  EXPECT_EQ(ieee::from_bits<double>(1), tiny<double>);
}

// ---- log2 -----------------------------------------------------------------------------------------------------------

TEST(IeeeLog2, StaysWithinItsBoundInEveryBinade) {
  std::mt19937_64 random(101);
  double worst = 0;
  const auto measure = [&](double x) { worst = std::max(worst, quad::ulps(ieee::log2(x), quad::log2(x))); };
  for (int k = -1074; k < 1024; ++k) {
    const double base = std::ldexp(1.0, k);
    measure(ieee::next_up(base));
    measure(ieee::next_down(base * 2));
    for (const double edge : {1.2247448713915890, 1.4142135623730951, 1.7320508075688772}) measure(edge * base);
    for (int i = 0; i < 100; ++i) measure(std::ldexp(1.0 + static_cast<double>(random() >> 12) * 0x1p-52, k));
  }
  RecordProperty("worst_ulp", std::to_string(worst));
  EXPECT_LE(worst, 0.501);
}

TEST(IeeeLog2, StaysWithinItsBoundNearOne) {
  std::mt19937_64 random(102);
  double worst = 0;
  const auto measure = [&](double x) { worst = std::max(worst, quad::ulps(ieee::log2(x), quad::log2(x))); };
  for (int i = 1; i <= 2000; ++i) {
    measure(1.0 + i * 0x1p-52);
    measure(1.0 - i * 0x1p-53);
  }
  for (int shift = 1; shift < 52; ++shift)
    for (int i = 0; i < 2000; ++i) {
      const double offset = std::ldexp(static_cast<double>(random() >> 11), -53 - shift);
      measure(1.0 + offset);
      measure(1.0 - offset);
    }
  EXPECT_LE(worst, 0.501);
}

TEST(IeeeLog2, KnowsFarMoreThanItRounds) {
  // What makes it monotone: before rounding, the error is far below the step between neighbours (at least 2^-53).
  std::mt19937_64 random(103);
  double worst = 0;
  const auto measure = [&](double x) {
    const auto pair = ieee::detail::log2_pair(x);
    const quad::Real exact = quad::log2(x);
    const double error = static_cast<double>((pair.hi - exact) + pair.lo);
    if (exact != 0) worst = std::max(worst, std::fabs(error / static_cast<double>(exact)));
    EXPECT_EQ(pair.hi, ieee::detail::top26(pair.hi));
  };
  for (int i = 0; i < 200000; ++i) {
    measure(std::ldexp(1.0 + static_cast<double>(random() >> 12) * 0x1p-52, static_cast<int>(random() % 4) - 2));
    measure(ieee::from_bits<double>(random() % 0x7ff0000000000000u));
  }
  EXPECT_LE(worst, 0x1p-65);
}

TEST(IeeeLog2, IsExactAtPowersOfTwo) {
  for (int k = -1074; k < 1024; ++k) EXPECT_TRUE(same(ieee::log2(std::ldexp(1.0, k)), static_cast<double>(k))) << k;
  for (int k = -149; k < 128; ++k) EXPECT_TRUE(same(ieee::log2(std::ldexp(1.0f, k)), static_cast<float>(k))) << k;
}

TEST(IeeeLog2, NeverDecreases) {
  std::mt19937_64 random(104);
  const auto expect = [](double x) { EXPECT_LE(ieee::log2(x), ieee::log2(ieee::next_up(x))) << x; };
  for (int i = 0; i < 500000; ++i) expect(ieee::from_bits<double>(random() % 0x7ff0000000000000u));
  for (int k = -1074; k < 1024; ++k) {  // across binades, and where the reduction changes over
    for (double edge : {1.0, 1.2247449, 1.7320508}) {
      double x = std::ldexp(edge, k);
      for (int i = 0; i < 8; ++i) x = ieee::next_down(x);
      for (int i = 0; i < 16; ++i, x = ieee::next_up(x))
        if (x > 0) expect(x);
    }
  }
  float last = -inf<float>;
  for (std::uint32_t bits = 0; bits <= 0x7f800000u; bits += 997) {
    const float value = ieee::log2(ieee::from_bits<float>(bits));
    EXPECT_LE(last, value) << bits;
    last = value;
  }
}

TEST(IeeeLog2, GivesTheDocumentedSpecialValues) {
  const auto check = []<class T>(T) {
    for (const T x : {-T(1), -tiny<T>, -inf<T>, nan_value<T>, -nan_value<T>})
      EXPECT_EQ(ieee::to_bits(ieee::log2(x)), ieee::to_bits(ieee::quiet_nan<T>)) << x;
    EXPECT_EQ(ieee::log2(T(0)), -inf<T>);
    EXPECT_EQ(ieee::log2(-T(0)), -inf<T>);
    EXPECT_EQ(ieee::log2(inf<T>), inf<T>);
    EXPECT_TRUE(same(ieee::log2(T(1)), T(0)));
  };
  check(0.0f);
  check(0.0);
}

TEST(IeeeLog2, RoundsFloatsCorrectly) {
  for (const float x : samples<float>(1, 400))
    if (x > 0 && std::isfinite(x)) {
      EXPECT_EQ(ieee::log2(x), static_cast<float>(quad::log2(x))) << x;
    }
}

// ---- exp2 -----------------------------------------------------------------------------------------------------------

TEST(IeeeExp2, StaysWithinItsBoundInEveryBinadeOfTheResult) {
  std::mt19937_64 random(201);
  double worst = 0;
  const auto measure = [&](double x) { worst = std::max(worst, quad::ulps(ieee::exp2(x), quad::exp2(x))); };
  for (int k = -1080; k < 1024; ++k) {
    for (double near : {0.0, 0.5}) {  // where the fraction is largest, and changes sign
      measure(ieee::next_up(k + near));
      measure(ieee::next_down(k + near));
    }
    for (int i = 0; i < 200; ++i) measure(k + static_cast<double>(random() >> 11) * 0x1p-53);
    for (int i = 0; i < 40; ++i) measure(k + 0.45 + static_cast<double>(random() >> 11) * 0x1p-56);
  }
  RecordProperty("worst_ulp", std::to_string(worst));
  EXPECT_LE(worst, 0.55);
}

TEST(IeeeExp2, StaysWithinItsBoundForSmallArguments) {
  std::mt19937_64 random(202);
  double worst = 0;
  const auto measure = [&](double x) { worst = std::max(worst, quad::ulps(ieee::exp2(x), quad::exp2(x))); };
  for (int shift = 0; shift < 60; ++shift)
    for (int i = 0; i < 1000; ++i) {
      const double x = std::ldexp(static_cast<double>(random() >> 11), -53 - shift);
      measure(x);
      measure(-x);
    }
  EXPECT_LE(worst, 0.55);
  for (const double x : {tiny<double>, 0x1p-1022, 0x1p-500, 0x1p-60, 0x1p-54, 0.0}) {
    EXPECT_EQ(ieee::exp2(x), 1.0) << x;
    EXPECT_EQ(ieee::exp2(-x), 1.0) << x;
  }
}

TEST(IeeeExp2, IsExactAtIntegers) {
  for (int k = -1074; k < 1024; ++k) EXPECT_EQ(ieee::exp2(static_cast<double>(k)), std::ldexp(1.0, k)) << k;
  for (int k = -149; k < 128; ++k) EXPECT_EQ(ieee::exp2(static_cast<float>(k)), std::ldexp(1.0f, k)) << k;
}

TEST(IeeeExp2, UnderflowsGraduallyAndOverflowsToInfinity) {
  EXPECT_TRUE(same(ieee::exp2(-1075.0), 0.0));  // halfway between 0 and the least number: to even
  EXPECT_EQ(ieee::exp2(ieee::next_up(-1075.0)), tiny<double>);
  EXPECT_EQ(ieee::exp2(-1073.5), tiny<double>);  // 1.41 units
  EXPECT_EQ(ieee::exp2(-1073.0), 2 * tiny<double>);
  EXPECT_LT(ieee::exp2(ieee::next_down(-1022.0)), std::numeric_limits<double>::min());
  for (const double x : {-1075.5, -1076.0, -1076.9, -1077.0, -1e5, -huge<double>, -inf<double>})
    EXPECT_TRUE(same(ieee::exp2(x), 0.0)) << x;
  EXPECT_TRUE(std::isfinite(ieee::exp2(ieee::next_down(1024.0))));
  for (const double x : {1024.0, 1024.3, 1024.6, 1025.0, 1e5, huge<double>, inf<double>})
    EXPECT_EQ(ieee::exp2(x), inf<double>) << x;
  EXPECT_TRUE(same(ieee::exp2(-150.0f), 0.0f));
  EXPECT_EQ(ieee::exp2(ieee::next_up(-150.0f)), tiny<float>);
  EXPECT_EQ(ieee::exp2(128.0f), inf<float>);
  EXPECT_TRUE(std::isfinite(ieee::exp2(ieee::next_down(128.0f))));
  EXPECT_TRUE(same(ieee::exp2(-inf<float>), 0.0f));
  EXPECT_EQ(ieee::exp2(inf<float>), inf<float>);
  for (const double x : {nan_value<double>, -nan_value<double>}) {
    EXPECT_EQ(ieee::to_bits(ieee::exp2(x)), ieee::to_bits(ieee::quiet_nan<double>));
    EXPECT_EQ(ieee::to_bits(ieee::exp2(static_cast<float>(x))), ieee::to_bits(ieee::quiet_nan<float>));
  }
}

TEST(IeeeExp2, NeverDecreases) {
  std::mt19937_64 random(203);
  const auto expect = [](double x) { EXPECT_LE(ieee::exp2(x), ieee::exp2(ieee::next_up(x))) << x; };
  for (int k = -1076; k < 1024; ++k) {
    for (const double near : {0.0, 0.5}) {
      double x = k + near;
      for (int i = 0; i < 8; ++i) x = ieee::next_down(x);
      for (int i = 0; i < 16; ++i, x = ieee::next_up(x)) expect(x);
    }
    for (int i = 0; i < 100; ++i) expect(k + static_cast<double>(random() >> 11) * 0x1p-53);
  }
  for (int i = 0; i < 300000; ++i) {  // neighbours are closest to each other around 0
    const double x = std::ldexp(static_cast<double>(random() >> 11), -53 - static_cast<int>(random() % 8));
    expect(x);
    expect(-x);
  }
}

TEST(IeeeExp2, RoundsAllFloatsButTwoCorrectly) {
  for (const float x : samples<float>(1, 400))
    if (std::isfinite(x) && std::fabs(x) < 200) {
      EXPECT_EQ(ieee::exp2(x), static_cast<float>(quad::exp2(x))) << x;
    }
  for (const float x : {0x1.853a6ep-9f, -0x1.e7526ep-6f}) {  // the two: so near a tie that the double lies on it
    const double exact = static_cast<double>(quad::exp2(x));
    EXPECT_NE(ieee::exp2(x), static_cast<float>(quad::exp2(x)));
    EXPECT_LE(std::fabs(ieee::exp2(x) - exact), 0.50000001 * std::ldexp(1.0, std::ilogb(exact) - 23));
  }
}

// ---- pow ------------------------------------------------------------------------------------------------------------

TEST(IeeePow, StaysWithinItsBoundForEveryBaseAndSizeOfResult) {
  std::mt19937_64 random(301);
  double worst = 0;
  const auto measure = [&](double x, double result_exponent) {
    const double y = result_exponent / std::log2(x);
    if (!std::isfinite(y)) return;
    const quad::Real exact = quad::pow(x, y);
    if (exact < quad::scale(1, -1080)) return;
    worst = std::max(worst, quad::ulps(ieee::pow(x, y), exact));
  };
  const auto uniform = [&](double from, double to) {
    return from + (to - from) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  for (int k = -1074; k < 1024; ++k)
    for (int i = 0; i < 100; ++i) measure(std::ldexp(uniform(1, 2), k), uniform(-1076, 1024));
  for (int i = 0; i < 60000; ++i) {
    measure(uniform(1.05, 1.35), uniform(-1022, 1024));    // a large exponent
    measure(uniform(1.1, 1.3), 1020 + uniform(0.5, 0.6));  // and the largest error on top
    measure(uniform(1.1, 1.3), -1020 + uniform(0.5, 0.6));
    measure(1 + std::ldexp(uniform(-1, 1), -static_cast<int>(random() % 52) - 1), uniform(-1076, 1024));
  }
  RecordProperty("worst_ulp", std::to_string(worst));
  EXPECT_LE(worst, 0.6);
}

TEST(IeeePow, IsExactWhereTheResultIsANumber) {
  for (int base = 1; base <= 40; ++base) {
    mpz_class power = 1;
    for (int exponent = 0; exponent < 60 && mpz_sizeinbase(power.get_mpz_t(), 2) <= 53; ++exponent, power *= base)
      EXPECT_EQ(ieee::pow(static_cast<double>(base), static_cast<double>(exponent)), power.get_d())
          << base << " " << exponent;
  }
  std::mt19937_64 random(302);
  for (int i = 0; i < 100000; ++i) {
    const double x = ieee::from_bits<double>(random() % 0x7ff0000000000000u);
    const double subnormal = ieee::from_bits<double>(random() % 0x0020000000000000u);
    EXPECT_EQ(ieee::pow(x, 1.0), x);
    EXPECT_EQ(ieee::pow(subnormal, 1.0), subnormal);
    const double root = std::ldexp(static_cast<double>(random() >> 38), static_cast<int>(random() % 900) - 450);
    EXPECT_EQ(ieee::pow(root, 2.0), root * root);
    EXPECT_EQ(ieee::pow(root * root, 0.5), root);
  }
  for (int k = -1074; k < 1024; ++k) EXPECT_EQ(ieee::pow(2.0, static_cast<double>(k)), std::ldexp(1.0, k));
  double x = std::numeric_limits<double>::min();  // from the normal numbers into the subnormal ones
  for (int i = 0; i < 100; ++i) x = ieee::next_up(x);
  for (int i = 0; i < 200; ++i, x = ieee::next_down(x)) EXPECT_EQ(ieee::pow(x, 1.0), x);
}

TEST(IeeePow, GivesTheDocumentedSpecialValues) {
  const auto check = []<class T>(T) {
    const std::vector<T> values{T(0),
                                -T(0),
                                tiny<T>,
                                T(0.5),
                                ieee::next_down(T(1)),
                                T(1),
                                ieee::next_up(T(1)),
                                T(2),
                                T(3),
                                huge<T>,
                                inf<T>,
                                -tiny<T>,
                                -T(1),
                                -T(2),
                                -huge<T>,
                                -inf<T>,
                                nan_value<T>};
    for (const T x : values)
      for (const T y : values) {
        const T got = ieee::pow(x, y);
        if (std::isnan(x) || std::isnan(y) || x < 0) {
          EXPECT_EQ(ieee::to_bits(got), ieee::to_bits(ieee::quiet_nan<T>)) << x << " " << y;
        } else if (x == 0 || !std::isfinite(x) || !std::isfinite(y) || x == 1 || y == 0) {
          EXPECT_TRUE(same(got, std::pow(std::fabs(x), y))) << x << " " << y << " " << got;
        } else if (std::fabs(y) == huge<T>) {
          EXPECT_TRUE(same(got, (x > 1) == (y > 0) ? inf<T> : T(0))) << x << " " << y << " " << got;
        } else if (std::fabs(y) == tiny<T>) {
          EXPECT_EQ(got, T(1)) << x << " " << y;
        }
      }
  };
  check(0.0f);
  check(0.0);
  EXPECT_EQ(ieee::pow(0.0, 0.0), 1.0);
}

TEST(IeeePow, FloatStaysWithinItsBoundAndNeverTurnsBack) {
  std::mt19937_64 random(303);
  double worst = 0;
  for (int i = 0; i < 200000; ++i) {
    const float x = ieee::from_bits<float>(static_cast<std::uint32_t>(random()) % 0x7f800000u);
    const double target = -151 + 279.0 * static_cast<double>(random() >> 11) * 0x1p-53;
    const float y = static_cast<float>(i % 4 == 0 ? target * 0x1p-30 : target / std::log2(static_cast<double>(x)));
    if (!(x > 0) || !std::isfinite(y)) continue;
    const float got = ieee::pow(x, y);
    const quad::Real exact = quad::pow(x, y);
    if (std::isfinite(got)) {
      const int e = std::max(quad::exponent(exact), -126);
      const quad::Real error = got - exact;
      worst = std::max(worst, static_cast<double>(quad::scale(error < 0 ? -error : error, 23 - e)));
    }
    const float wider = ieee::pow(ieee::next_up(x), y), taller = ieee::pow(x, ieee::next_up(y));
    EXPECT_TRUE(y >= 0 ? got <= wider : got >= wider) << x << " " << y;
    EXPECT_TRUE(x >= 1 ? got <= taller : got >= taller) << x << " " << y;
  }
  EXPECT_LE(worst, 0.500001);
}
