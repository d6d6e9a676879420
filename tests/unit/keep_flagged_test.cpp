// SPDX-License-Identifier: MIT
// Flags in common, less a list.
#include "pgl/host/keep_flagged.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

namespace {

using Flags = std::vector<std::uint8_t>;

Flags kept(const Flags& flags, const Flags& also, const std::vector<std::uint32_t>& except) {
  Flags out(flags.size(), 0xA5);
  pgl::host::keep_flagged(flags, also, except, out);
  return out;
}

TEST(KeepFlagged, KeepsWhatBothFlagAsOnes) {
  EXPECT_EQ(kept({0, 0, 1, 1, 2, 255, 255}, {0, 1, 0, 1, 4, 255, 0}, {}), (Flags{0, 0, 0, 1, 1, 1, 0}));
}

TEST(KeepFlagged, NoSecondFlagsMeansAll) {
  EXPECT_EQ(kept({0, 1, 7}, {}, {}), (Flags{0, 1, 1}));
}

TEST(KeepFlagged, DropsTheListedObjectsAndPassesOverNone) {
  EXPECT_EQ(kept({1, 1, 0, 1}, {}, {pgl::no_object, 3, 2, 3, pgl::no_object}), (Flags{1, 1, 0, 0}));
  EXPECT_EQ(kept({1, 1}, {1, 1}, {0}), (Flags{0, 1}));
}

TEST(KeepFlagged, WorksInPlaceOfEither) {
  Flags a = {1, 1, 0, 1}, b = {1, 0, 1, 1};
  const std::vector<std::uint32_t> except = {0};
  pgl::host::keep_flagged(a, b, except, b);
  EXPECT_EQ(b, (Flags{0, 0, 0, 1}));
  pgl::host::keep_flagged(a, b, {}, a);
  EXPECT_EQ(a, (Flags{0, 0, 0, 1}));
}

TEST(KeepFlagged, NoObjectsAreNoWork) {
  EXPECT_EQ(kept({}, {}, {pgl::no_object}), Flags());
}

TEST(KeepFlagged, KeepsEachOfMany) {
  Flags flags(200'003), also(200'003), expected(200'003);
  std::vector<std::uint32_t> except;
  for (std::uint32_t i = 0; i < flags.size(); ++i) {
    flags[i] = i % 3 != 0 ? 1 : 0;
    also[i] = i % 5 != 0 ? 1 : 0;
    if (i % 1009 == 7) except.push_back(i);
    expected[i] = i % 3 != 0 && i % 5 != 0 && i % 1009 != 7 ? 1 : 0;
  }
  EXPECT_EQ(kept(flags, also, except), expected);
}

}  // namespace
