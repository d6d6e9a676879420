// SPDX-License-Identifier: MIT
// A stranger's first program: one tetrahedron with a split edge, one collapse.
#include <cstdio>
#include <vector>

#include <pgl/host/build_ecol.hpp>

int main() {
  const std::vector<glm::vec3> positions{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.5f, 0, 0}};
  const std::vector<pgl::Triangle<std::uint32_t>> triangles{{{0, 2, 4}}, {{4, 2, 1}}, {{0, 4, 3}}, {{4, 1, 3}},
                                                            {{0, 3, 2}}, {{1, 2, 3}}};
  std::vector<std::uint32_t> ecol(5), permute_v(5), permute_t(6), map(6);
  pgl::host::EcolWorkspace<float> workspace;
  const auto least = pgl::host::build_ecol<float, std::uint32_t>(positions, triangles, {}, {}, workspace, ecol, permute_v,
                                                                 permute_t, map, {});
  std::printf("%u vertices, %u triangles\n", least, map[least]);
  return least == 4 && map[least] == 4 ? 0 : 1;
}
