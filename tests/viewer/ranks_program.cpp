// SPDX-License-Identifier: MIT
// What ranks_test runs under mpirun: ranks that work together, and one that does not.
//
//   ranks_program PATIENCE MODE [CULPRIT [CALL]]
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <numeric>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "scene/tell.hpp"
#include "viewer/ranks.hpp"

using pgl::viewer::EndedElsewhere;
using pgl::viewer::Ranks;

namespace {

void demand(bool holds, const char* what) {
  if (!holds) throw std::runtime_error(std::string("wrong: ") + what);
}
#define DEMAND(condition) demand(condition, #condition)

std::uint32_t key(int rank, std::size_t i) {
  std::uint64_t bits = (i + 1) * 0x9E3779B97F4A7C15u + static_cast<std::uint64_t>(rank) * 0xD1B54A32D192ED03u;
  bits ^= bits >> 29;
  return static_cast<std::uint32_t>(bits * 0xBF58476D1CE4E5B9u >> 32);
}

std::vector<std::uint32_t> keys_of(int rank, std::size_t n) {
  std::vector<std::uint32_t> keys(n);
  for (std::size_t i = 0; i < n; ++i) keys[i] = key(rank, i);
  return keys;
}

/// Every call, with sizes from nothing to more than what MPI sends at once.
void all_calls(Ranks& ranks) {
  const int rank = ranks.rank(), size = ranks.size();
  DEMAND(rank == Ranks::rank_of_environment());
  DEMAND(ranks.on_one_machine());
  DEMAND(ranks.local_rank() == rank && ranks.local_size() == size);
  const auto everybody = ranks.gather(rank);
  for (int i = 0; i < size; ++i) DEMAND(everybody[static_cast<std::size_t>(i)] == i);

  struct Frame {
    double eye[3];
    std::uint64_t budget;
  } frame = {{1.5, -2.5, rank + 0.5}, static_cast<std::uint64_t>(rank) << 40};
  ranks.broadcast(frame);
  DEMAND(frame.eye[2] == 0.5 && frame.budget == 0);
  struct Much {
    std::uint32_t keys[100'000];
  };
  auto much = std::make_unique<Much>();
  std::ranges::copy(keys_of(rank, 100'000), much->keys);
  ranks.broadcast(*much);
  DEMAND(std::ranges::equal(much->keys, keys_of(0, 100'000)));
  const std::vector<Much> of_all = ranks.gather(*much);
  for (const Much& one : of_all) DEMAND(std::ranges::equal(one.keys, much->keys));

  DEMAND(ranks.least(static_cast<std::uint64_t>(size - rank) << 33) == std::uint64_t{1} << 33);
  DEMAND(ranks.least(~std::uint64_t{0}) == ~std::uint64_t{0});

  for (const std::size_t length : {std::size_t{0}, std::size_t{1}, std::size_t{3'000'001}}) {
    const auto text = [&](int of) {
      return std::string(of % 2 == 0 ? length : length / 3, static_cast<char>('a' + of));
    };
    const std::vector<std::string> texts = ranks.gather_texts(text(rank));
    DEMAND(texts.size() == (rank == 0 ? static_cast<std::size_t>(size) : 0));
    for (std::size_t i = 0; i < texts.size(); ++i) DEMAND(texts[i] == text(static_cast<int>(i)));
  }

  for (const std::size_t n : {std::size_t{0}, std::size_t{1}, std::size_t{1000}, std::size_t{1'000'003}}) {
    for (const auto how : {Ranks::Combine::least, Ranks::Combine::largest}) {
      std::vector<std::uint32_t> keys = keys_of(rank, n);
      ranks.combine(keys, how);
      for (std::size_t i = 0; i < n; ++i) {
        std::uint32_t right = key(0, i);
        for (int r = 1; r < size; ++r) {
          right = how == Ranks::Combine::least ? std::min(right, key(r, i)) : std::max(right, key(r, i));
        }
        DEMAND(keys[i] == right);
      }
    }
    for (int from = 0; from < size; ++from) {  // everybody to everybody
      for (int to = 0; to < size; ++to) {
        std::vector<std::uint32_t> keys = keys_of(from, n);
        if (from == to) continue;
        if (rank == from) ranks.send(to, std::as_bytes(std::span(keys)));
        if (rank != to) continue;
        std::vector<std::uint32_t> received(n);
        ranks.receive(from, std::as_writable_bytes(std::span(received)));
        DEMAND(received == keys);
      }
    }
  }
  ranks.agree("");
}

/// A call in which the culprit is missing.
void wait_for_all(Ranks& ranks, const std::string& call) {
  int value = 0;
  std::vector<std::uint32_t> keys(300'000);
  if (call == "broadcast") {
    ranks.broadcast(value);
    ranks.gather(value);
  } else if (call == "gather") {
    ranks.gather(value);
  } else if (call == "combine") {
    ranks.combine(keys, Ranks::Combine::least);
  } else if (call == "send") {  // all to rank 0
    for (int from = 1; from < ranks.size(); ++from) {
      if (ranks.rank() == from) ranks.send(0, std::as_bytes(std::span(keys)));
      if (ranks.rank() == 0) ranks.receive(from, std::as_writable_bytes(std::span(keys)));
    }
    ranks.gather(value);
  } else if (call == "agree") {
    ranks.agree("");
  } else if (call != "leave") {
    throw std::runtime_error("no such call");
  }
}

void loop() {
  volatile bool for_ever = true;
  while (for_ever) {
  }
}

void misbehave(const std::string& mode) {
  if (mode == "die") kill(getpid(), SIGKILL);
  if (mode == "stop") raise(SIGSTOP);
  if (mode == "loop") loop();
  if (mode == "exit") std::_Exit(0);
  if (mode == "throw") throw std::runtime_error("a bolt is loose");
}

void sleep_for(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

void run(double patience, const std::string& mode, int culprit, const std::string& call) {
  Ranks ranks(patience);
  const bool is_culprit = ranks.rank() == culprit;
  if (mode == "calls") {
    all_calls(ranks);
    std::printf("%d of %d\n", ranks.rank(), ranks.size());
  } else if (mode == "large") {  // more than one message takes
    std::vector<std::byte> bytes((std::size_t{1} << 30) + 5, std::byte(ranks.rank() + 1));
    if (ranks.rank() == 0) ranks.send(1, bytes);
    if (ranks.rank() == 1) ranks.receive(0, bytes);
    DEMAND(ranks.rank() > 1 || std::ranges::count(bytes, std::byte{1}) == std::ssize(bytes));
  } else if (mode == "slow") {  // all work for long, the culprit for longer: it is no reason to end
    sleep_for(is_culprit ? 3.0 : 1.0);
    ranks.agree("");
    std::printf("waited\n");
  } else if (mode == "leave") {  // what the culprit does after it may take long
    ranks.leave();
    sleep_for(is_culprit ? 4.0 : 0.0);
    std::printf("left\n");
  } else if (mode == "refuse") {  // the culprit and all after it, together
    ranks.agree("");
    const bool fails = ranks.rank() >= culprit;
    ranks.agree(fails ? "no GPU for " + std::to_string(ranks.rank()) : "");
  } else if (mode == "patient") {  // rank 0 has more patience than the others, for it has worked longer
    if (ranks.rank() == 0) sleep_for(0.7);
    if (is_culprit) misbehave("stop");
    ranks.agree("");
  } else if (mode == "abort") {
    if (is_culprit) ranks.abort("a bolt is loose", 7);
    wait_for_all(ranks, call);
  } else {
    ranks.agree("");
    std::printf("pid %d\n", static_cast<int>(getpid()));
    std::fflush(stdout);
    ranks.agree("");
    if (is_culprit) misbehave(mode);
    wait_for_all(ranks, call);
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    run(std::stod(argv[1]), argv[2], argc > 3 ? std::stoi(argv[3]) : -1, argc > 4 ? argv[4] : "gather");
    return 0;
  } catch (const EndedElsewhere&) {
    return 0;
  } catch (const std::exception& error) {
    if (argv[2] == std::string("refuse")) sleep_for(0.3);  // whoever is gone by now must not take this one along
    pgl::scene::tell("pgl_viewer", error.what());
    return 1;
  }
}
