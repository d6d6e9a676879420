// SPDX-License-Identifier: MIT
#include "pgl/ieee.hpp"

#include <gtest/gtest.h>

TEST(Ieee, OrdersKeysLikeNumbers) {
  EXPECT_LT(pgl::ieee::order_key(-1.0f), pgl::ieee::order_key(-0.0f));
}
