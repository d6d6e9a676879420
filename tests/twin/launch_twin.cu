// SPDX-License-Identifier: MIT
// The arithmetic and the ground under the GPU drivers: the same bits from ieee.hpp, buffers that keep what they have.
#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

#include "pgl/cuda/buffer.cuh"
#include "pgl/cuda/launch.cuh"
#include "pgl/ieee.hpp"
#include "twin/device.cuh"

namespace ieee = pgl::ieee;
using pgl::test::DeviceArray;
using pgl::test::must;

namespace {

/// NaN results are not part of the promise: they count as one.
template <class T>
PGL_HD T canonical(T a) {
  return a == a ? a : ieee::quiet_nan<T>;
}

template <class T>
PGL_HD void all_operations(T a, T b, T c, T* out) {
  out[0] = canonical(ieee::add(a, b));
  out[1] = canonical(ieee::sub(a, b));
  out[2] = canonical(ieee::mul(a, b));
  out[3] = canonical(ieee::div(a, b));
  out[4] = canonical(ieee::sqrt(a < 0 ? -a : a));
  out[5] = canonical(ieee::fma(a, b, c));
  out[6] = canonical(ieee::add(ieee::mul(a, b), c));  // must not be fused
  out[7] = canonical(ieee::log2(a < 0 ? -a : a));
  out[8] = canonical(ieee::exp2(b));
  out[9] = canonical(ieee::pow(a < 0 ? -a : a, b));
  out[10] = canonical(ieee::next_up(a));
  out[11] = canonical(static_cast<T>(ieee::to_float(static_cast<double>(ieee::mul(a, b)))));
}
constexpr int operations = 12;

template <class T>
__global__ void all_operations_kernel(const T* in, std::size_t n, T* out) {
  for (std::size_t i = blockIdx.x * blockDim.x + threadIdx.x; i < n; i += std::size_t{gridDim.x} * blockDim.x)
    all_operations(in[3 * i], in[3 * i + 1], in[3 * i + 2], out + operations * i);
}

template <class T>
void same_bits_of_all_operations() {
  PGL_NEEDS_DEVICE();
  using Bits = typename ieee::detail::bits_of<T>::type;
  std::mt19937_64 random(1);
  std::vector<T> special = {T(0),
                            -T(0),
                            T(1),
                            T(-1),
                            T(0.5),
                            T(3),
                            ieee::infinity<T>,
                            -ieee::infinity<T>,
                            ieee::quiet_nan<T>,
                            ieee::from_bits<T>(Bits{1}),
                            std::numeric_limits<T>::min(),
                            std::numeric_limits<T>::max(),
                            T(1e30),
                            T(1e-30),
                            T(-1e30),
                            T(127),
                            T(-126)};
  std::vector<T> in;
  for (const T a : special)
    for (const T b : special)
      for (const T c : special) in.insert(in.end(), {a, b, c});
  for (int i = 0; i < 300000; ++i) {
    in.push_back(ieee::from_bits<T>(static_cast<Bits>(random())));
    if (i % 2 == 0) in.back() = static_cast<T>(static_cast<double>(static_cast<std::int64_t>(random())) * 0x1p-60);
  }
  const std::size_t n = in.size() / 3;
  std::vector<T> expected(operations * n);
  for (std::size_t i = 0; i < n; ++i)
    all_operations(in[3 * i], in[3 * i + 1], in[3 * i + 2], &expected[operations * i]);
  const DeviceArray<T> device_in(in), device_out(expected.size());
  must(pgl::cuda::detail::run(all_operations_kernel<T>, 500, 0, {}, device_in.data(), n, device_out.data()));
  EXPECT_TRUE(pgl::test::same_bytes(device_out.read(), expected));
}

TEST(Twins, FloatOperationsHaveTheSameBits) {
  same_bits_of_all_operations<float>();
}
TEST(Twins, DoubleOperationsHaveTheSameBits) {
  same_bits_of_all_operations<double>();
}

TEST(Buffer, KeepsItsMemoryUntilItMustGrow) {
  PGL_NEEDS_DEVICE();
  pgl::cuda::Buffer buffer;
  must(buffer.reserve(0));
  EXPECT_EQ(buffer.size(), 0u);
  must(buffer.reserve(1000));
  const void* first = buffer.at<char>();
  must(buffer.reserve(10));
  EXPECT_EQ(buffer.at<char>(), first);
  pgl::cuda::Buffer other = std::move(buffer);
  EXPECT_EQ(other.at<char>(), first);
  EXPECT_EQ(buffer.size(), 0u);
  must(other.reserve(1001));
  EXPECT_GE(other.size(), 1500u);
}

TEST(Launch, DoesNothingForNoBlocks) {
  PGL_NEEDS_DEVICE();
  must(pgl::cuda::detail::run(all_operations_kernel<float>, 0, 0, {}, nullptr, 0, nullptr));
}

}  // namespace
