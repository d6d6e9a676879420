// SPDX-License-Identifier: MIT
#include "viewer/ranks.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "scene/tell.hpp"

namespace pgl::viewer {

struct Ranks::Mpi {};

Ranks::Ranks(double) {}
Ranks::~Ranks() = default;
int Ranks::rank_of_environment() {
  return 0;
}
void Ranks::still_here() {}
void Ranks::broadcast_bytes(std::span<std::byte>) {}
void Ranks::gather_bytes(std::span<const std::byte> own, std::span<std::byte> all) {
  std::ranges::copy(own, all.begin());
}
std::vector<std::string> Ranks::gather_texts(const std::string& own) {
  return {own};
}
std::uint64_t Ranks::least(std::uint64_t value) {
  return value;
}
void Ranks::combine(std::span<std::uint32_t>, Combine) {}
void Ranks::send(int, std::span<const std::byte>) {}
void Ranks::receive(int, std::span<std::byte>) {}

void Ranks::agree(const std::string& failure) {
  if (!failure.empty()) throw std::runtime_error(failure);
}

void Ranks::abort(const std::string& why, int code) {
  scene::tell("pgl_viewer", why);
  std::fflush(nullptr);
  std::_Exit(code);
}

}  // namespace pgl::viewer
