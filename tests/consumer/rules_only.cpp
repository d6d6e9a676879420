// SPDX-License-Identifier: MIT
// The rules alone, without any driver.
#include <pgl/build_ecol.hpp>

int main() { return pgl::merged_edge_uses(2, 2, 1) == 2 ? 0 : 1; }
