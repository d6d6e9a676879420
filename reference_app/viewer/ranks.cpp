// SPDX-License-Identifier: MIT
#include "viewer/ranks.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <optional>
#include <set>
#include <string_view>
#include <thread>

#include "scene/tell.hpp"

#if defined(PGL_VIEWER_MPI)
#include <mpi.h>
#endif

namespace pgl::viewer {

namespace {

/// The first of these variables that is a number. Open MPI's, then MPICH's.
std::optional<int> number_of_environment(std::initializer_list<const char*> names) {
  for (const char* name : names) {
    const char* text = std::getenv(name);
    int number = 0;
    if (text != nullptr && std::from_chars(text, text + std::strlen(text), number).ec == std::errc()) return number;
  }
  return {};
}

/// What everybody would say, said by one.
[[noreturn]] void refuse(const std::string& why) {
  if (Ranks::rank_of_environment() != 0) throw EndedElsewhere(why);
  throw std::runtime_error(why);
}

}  // namespace

int Ranks::rank_of_environment() {
  return number_of_environment({"OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"}).value_or(0);
}

#if defined(PGL_VIEWER_MPI)

namespace {

using Clock = std::chrono::steady_clock;

double seconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

void check(int code) {
  if (code == MPI_SUCCESS) return;
  std::array<char, MPI_MAX_ERROR_STRING> text;
  int length = 0;
  MPI_Error_string(code, text.data(), &length);
  throw std::runtime_error("MPI: " + std::string(text.data(), static_cast<std::size_t>(length)));
}

/// Bounds what MPI does in one call that cannot be given up: joining, leaving. Ends the process where it takes longer,
/// which makes mpirun end the others; one line, for rank 0 gives up first.
class Deadline {
 public:
  explicit Deadline(double seconds) {
    struct sigaction ours = {};
    ours.sa_handler = [](int) {
      constexpr std::string_view text =
          "pgl_viewer: a rank has not joined or left in time: the run is over (--timeout)\n";
      [[maybe_unused]] const auto written = ::write(STDERR_FILENO, text.data(), text.size());
      ::_exit(1);
    };
    sigaction(SIGALRM, &ours, &before_);
    const double late = Ranks::rank_of_environment() == 0 ? 0.0 : 2.0;
    alarm(static_cast<unsigned>(std::ceil(std::clamp(seconds, 10.0, 1e6) + late)));
  }
  ~Deadline() {
    alarm(0);
    sigaction(SIGALRM, &before_, nullptr);
  }
  Deadline(const Deadline&) = delete;
  Deadline& operator=(const Deadline&) = delete;

 private:
  struct sigaction before_ = {};
};

constexpr int data_tag = 1, note_tag = 2;

// What a note says: the rank that its sender waits for, or one of these.
constexpr int waits_for_nobody = -1, leaves = -2;

}  // namespace

/// All messages go from one rank to another, so that who waits knows for whom. Who waits for long tells all others
/// for whom, four times a second. With these notes
/// - rank 0's word ends the run: the others wait for a rank that waits itself, so that they are not the first to blame
///   one that is well and waits for a dead one; rank 0 takes no excuse, so that no circle waits for ever,
/// - and who gives up follows them to the one that does not answer.
struct Ranks::Mpi {
  Mpi(Ranks& its, double seconds) : ranks(its), patience(seconds) {
    {
      Deadline deadline(patience);
      int level = 0;
      check(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &level));
      check(MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN));
      check(MPI_Comm_rank(MPI_COMM_WORLD, &ranks.rank_));
      check(MPI_Comm_size(MPI_COMM_WORLD, &ranks.size_));
      MPI_Comm local = MPI_COMM_NULL;
      check(MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, ranks.rank_, MPI_INFO_NULL, &local));
      check(MPI_Comm_rank(local, &ranks.local_rank_));
      check(MPI_Comm_size(local, &ranks.local_size_));
      check(MPI_Comm_free(&local));
    }
    peers.resize(static_cast<std::size_t>(ranks.size_));
    worked_from = Clock::now();
  }

  // ---- messages -----------------------------------------------------------------------------------------------------
  void send(int to, std::span<const std::byte> bytes, bool until_received = false) {
    for_pieces(bytes, [&](std::span<const std::byte> piece) {
      const auto start = until_received ? MPI_Issend : MPI_Isend;
      MPI_Request request = MPI_REQUEST_NULL;
      check(start(piece.data(), static_cast<int>(piece.size()), MPI_BYTE, to, data_tag, MPI_COMM_WORLD, &request));
      add(request, to, -1);
    });
  }
  void receive(int from, std::span<std::byte> bytes) {
    for_pieces(bytes, [&](std::span<std::byte> piece) {
      const int size = static_cast<int>(piece.size());
      MPI_Request request = MPI_REQUEST_NULL;
      check(MPI_Irecv(piece.data(), size, MPI_BYTE, from, data_tag, MPI_COMM_WORLD, &request));
      add(request, from, size);
    });
  }

  /// Until all these messages are through.
  void wait() {
    Clock::time_point begin = Clock::now();
    const double limit = begin_wait(begin);
    Clock::time_point last_note = begin;
    hear(false);
    for (int polls = 0; !all_done(); ++polls) {
      const Clock::time_point now = pause(polls, begin);
      if (seconds_between(last_note, now) < 0.25) continue;
      if (seconds_between(last_note, now) > 1.0) begin = now;  // this one was stopped itself: nobody else is to blame
      last_note = now;
      hear(true);
      std::set<int> awaited, missing;
      for (std::size_t i = 0; i < requests.size(); ++i) {
        if (requests[i] != MPI_REQUEST_NULL) awaited.insert(targets[i].peer);
      }
      for (const int peer : awaited) {
        if (seconds_between(last_sign(peer, begin), now) > limit) missing.insert(peer);
      }
      if (!missing.empty()) give_up(missing, limit, now);
      tell(*awaited.begin());
    }
    requests.clear();
    targets.clear();
    worked_from = Clock::now();
  }

  /// Waits until all say that they leave. That is the last note of everybody, so none is on its way then.
  void leave() {
    const Clock::time_point begin = Clock::now();
    const double limit = begin_wait(begin);
    for (int polls = 0;; ++polls) {
      hear(true);
      tell(leaves);
      std::set<int> staying, missing;
      for (int peer = 0; peer < ranks.size_; ++peer) {
        if (peer != ranks.rank_ && !(of(peer).left && of(peer).told_leaving && sent(of(peer)))) staying.insert(peer);
      }
      if (staying.empty()) break;
      const Clock::time_point now = pause(polls, begin);
      for (const int peer : staying) {
        if (seconds_between(last_sign(peer, begin), now) > limit) missing.insert(peer);
      }
      if (!missing.empty()) give_up(missing, limit, now);
    }
    Deadline deadline(patience);
    check(MPI_Finalize());
  }

 private:
  struct Target {
    int peer;
    int bytes;  // that are to be received; negative: this one sends
  };
  struct Peer {
    Clock::time_point heard;  // the last note that came while this one waited
    int waits_for = waits_for_nobody;
    bool left = false;
    int note = 0;  // on its way there
    MPI_Request request = MPI_REQUEST_NULL;
    bool told_leaving = false;
  };

  Peer& of(int peer) { return peers[static_cast<std::size_t>(peer)]; }

  void add(MPI_Request request, int peer, int bytes) {
    requests.push_back(request);
    targets.push_back({peer, bytes});
  }

  /// MPI counts bytes in int.
  template <class Byte, class Call>
  static void for_pieces(std::span<Byte> bytes, Call call) {
    constexpr std::size_t most = std::size_t{1} << 30;
    do {
      const std::size_t size = std::min(bytes.size(), most);
      call(bytes.first(size));
      bytes = bytes.subspan(size);
    } while (!bytes.empty());
  }

  bool all_done() {
    if (requests.empty()) return true;
    statuses.resize(requests.size());
    indices.resize(requests.size());
    int done = 0;
    const int code =
        MPI_Testsome(static_cast<int>(requests.size()), requests.data(), &done, indices.data(), statuses.data());
    if (done == MPI_UNDEFINED) return true;  // none is left
    for (int i = 0; i < done; ++i) {
      const MPI_Status& status = statuses[static_cast<std::size_t>(i)];
      if (code == MPI_ERR_IN_STATUS) check(status.MPI_ERROR);
      const Target& target = targets[static_cast<std::size_t>(indices[static_cast<std::size_t>(i)])];
      int bytes = 0;
      if (target.bytes < 0) continue;
      check(MPI_Get_count(&status, MPI_BYTE, &bytes));
      if (bytes != target.bytes) throw std::runtime_error("MPI: a message of another size than the receiver's");
    }
    check(code);
    return std::ranges::all_of(requests, [](MPI_Request request) { return request == MPI_REQUEST_NULL; });
  }

  /// First at once, then leaving the core to others, for the one that is waited for may need it; then asleep.
  static Clock::time_point pause(int polls, Clock::time_point begin) {
    const Clock::time_point now = polls < 100 ? begin : Clock::now();
    if (polls < 100) return now;
    if (seconds_between(begin, now) < 2e-3) {
      std::this_thread::yield();
    } else {
      std::this_thread::sleep_for(std::chrono::microseconds(20));
    }
    return now;
  }

  // ---- patience -----------------------------------------------------------------------------------------------------
  /// Seconds that a sign of life may take. Where rank 0 gives up, nobody else needs to.
  double begin_wait(Clock::time_point now) {
    work[next_work++ % work.size()] = seconds_between(worked_from, now);
    return patience + 4.0 * *std::ranges::max_element(work) + 0.5 * std::min(ranks.rank_, 4);
  }

  Clock::time_point last_sign(int peer, Clock::time_point begin) {
    const bool excused = ranks.rank_ != 0 && of(peer).waits_for != ranks.rank_;
    return excused ? std::max(begin, of(peer).heard) : begin;
  }

  [[noreturn]] void give_up(const std::set<int>& missing, double limit, Clock::time_point now) {
    std::set<int> dead;
    for (int peer : missing) {
      for (int i = 0; i < ranks.size_; ++i) {
        const int next = of(peer).waits_for;
        if (seconds_between(of(peer).heard, now) > 1.0 || next < 0 || next == ranks.rank_) break;
        peer = next;
      }
      dead.insert(peer);
    }
    std::string names;
    for (const int peer : dead) {
      const bool last = peer == *dead.rbegin();
      names += (names.empty() ? "" : last ? " and " : ", ") + std::to_string(peer);
    }
    std::array<char, 32> time;
    std::snprintf(time.data(), time.size(), "%.3g", limit);
    ranks.abort((dead.size() == 1 ? "rank " + names + " has" : "ranks " + names + " have") + " not answered for " +
                    time.data() + " s: the run is over (--timeout)",
                1);
  }

  // ---- notes --------------------------------------------------------------------------------------------------------
  static bool sent(Peer& peer) {
    int done = 0;
    check(MPI_Test(&peer.request, &done, MPI_STATUS_IGNORE));
    return done != 0;
  }

  /// One on its way at most: more are not queued for a rank that does not listen.
  void tell(int note) {
    for (int i = 0; i < ranks.size_; ++i) {
      Peer& peer = of(i);
      if (i == ranks.rank_ || peer.told_leaving || !sent(peer)) continue;
      peer.note = note;
      peer.told_leaving = note == leaves;
      check(MPI_Isend(&peer.note, 1, MPI_INT, i, note_tag, MPI_COMM_WORLD, &peer.request));
    }
  }

  /// Takes what has come. What came before one waits is old.
  void hear(bool fresh) {
    while (true) {
      int there = 0;
      MPI_Status status;
      check(MPI_Iprobe(MPI_ANY_SOURCE, note_tag, MPI_COMM_WORLD, &there, &status));
      if (there == 0) return;
      int note = 0;
      check(MPI_Recv(&note, 1, MPI_INT, status.MPI_SOURCE, note_tag, MPI_COMM_WORLD, MPI_STATUS_IGNORE));
      Peer& peer = of(status.MPI_SOURCE);
      if (note == leaves) {
        peer.left = true;
      } else if (fresh) {
        peer.heard = Clock::now();
        peer.waits_for = note;
      }
    }
  }

  Ranks& ranks;
  double patience;
  std::vector<MPI_Request> requests;
  std::vector<Target> targets;  // of the requests
  std::vector<int> indices;
  std::vector<MPI_Status> statuses;
  std::vector<Peer> peers;
  Clock::time_point worked_from;
  std::array<double, 128> work = {};  // seconds, of some frames: each waits several times
  std::size_t next_work = 0;

 public:
  bool agreed_to_end = false;
  int exceptions = std::uncaught_exceptions();
};

Ranks::Ranks(double patience_seconds) {
  const std::optional<int> size = number_of_environment({"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"});
  // PMIx alone tells no size.
  if (size ? *size <= 1 : !number_of_environment({"PMIX_RANK"})) return;
  mpi_ = std::make_unique<Mpi>(*this, patience_seconds);
  if (size && *size != size_) {
    refuse("mpirun started " + std::to_string(*size) + " ranks, MPI finds " + std::to_string(size_) +
           ": is this mpirun of the MPI that pgl_viewer was built with?");
  }
}

/// An exception that all did not agree on leaves the others waiting. Then nothing is said here, for who catches it can
/// say more; and MPI is not left, so that mpirun ends the others when this process exits.
Ranks::~Ranks() {
  if (!mpi_ || (std::uncaught_exceptions() > mpi_->exceptions && !mpi_->agreed_to_end)) return;
  try {
    leave();
  } catch (const std::exception& error) {
    abort(error.what(), 1);
  }
}

void Ranks::leave() {
  if (mpi_) mpi_->leave();
  mpi_.reset();
}

void Ranks::broadcast_bytes(std::span<std::byte> value) {
  if (!mpi_) return;
  if (rank_ == 0) {
    for (int to = 1; to < size_; ++to) mpi_->send(to, value);
  } else {
    mpi_->receive(0, value);
  }
  mpi_->wait();
}

void Ranks::gather_bytes(std::span<const std::byte> own, std::span<std::byte> all) {
  const std::size_t n = own.size();
  std::ranges::copy(own, all.begin());  // right on rank 0, which tells the others
  if (!mpi_) return;
  if (rank_ == 0) {
    for (int from = 1; from < size_; ++from) {
      mpi_->receive(from, all.subspan(n * static_cast<std::size_t>(from), n));
    }
    mpi_->wait();
  } else {
    mpi_->send(0, own);
  }
  broadcast_bytes(all);
}

std::vector<std::string> Ranks::gather_texts(const std::string& own) {
  const std::vector<std::uint64_t> lengths = gather(std::uint64_t{own.size()});
  if (rank_ != 0) {
    mpi_->send(0, std::as_bytes(std::span(own)));
    mpi_->wait();
    return {};
  }
  std::vector<std::string> all = {own};
  for (int from = 1; from < size_; ++from) {
    std::string& text = all.emplace_back(lengths[static_cast<std::size_t>(from)], '\0');
    receive(from, std::as_writable_bytes(std::span(text)));
  }
  return all;
}

std::uint64_t Ranks::least(std::uint64_t value) {
  return std::ranges::min(gather(value));
}

/// A binary tree, up and down again: nobody takes in more than log2(ranks) arrays.
void Ranks::combine(std::span<std::uint32_t> keys, Combine how) {
  if (!mpi_) return;
  const std::span<std::byte> bytes = std::as_writable_bytes(keys);
  std::vector<std::uint32_t> others(keys.size());
  int step = 1;
  for (; step < size_ && (rank_ & step) == 0; step *= 2) {
    if (rank_ + step >= size_) continue;
    receive(rank_ + step, std::as_writable_bytes(std::span(others)));
    for (std::size_t i = 0; i < keys.size(); ++i) {
      keys[i] = how == Combine::least ? std::min(keys[i], others[i]) : std::max(keys[i], others[i]);
    }
  }
  if (rank_ != 0) {
    mpi_->send(rank_ - step, bytes);
    mpi_->wait();
    receive(rank_ - step, bytes);
  }
  for (step /= 2; step > 0; step /= 2) {
    if (rank_ + step < size_) mpi_->send(rank_ + step, bytes);
  }
  mpi_->wait();
}

void Ranks::send(int to, std::span<const std::byte> bytes) {
  mpi_->send(to, bytes, true);
  mpi_->wait();
}

void Ranks::receive(int from, std::span<std::byte> bytes) {
  mpi_->receive(from, bytes);
  mpi_->wait();
}

#else

struct Ranks::Mpi {};

Ranks::Ranks(double) {
  const int size = number_of_environment({"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}).value_or(1);
  if (size > 1) refuse("mpirun started " + std::to_string(size) + " ranks, this pgl_viewer was built without MPI");
}
Ranks::~Ranks() = default;
void Ranks::leave() {}
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

#endif

void Ranks::agree(const std::string& failure) {
  const std::vector<std::uint8_t> failed = gather(std::uint8_t{!failure.empty()});
  const auto first = std::ranges::find(failed, 1);
  if (first == failed.end()) return;
  const std::vector<std::string> texts = gather_texts(failure);
#if defined(PGL_VIEWER_MPI)
  if (mpi_) mpi_->agreed_to_end = true;
#endif
  if (rank_ != 0) throw EndedElsewhere("another rank says why");
  const auto rank = first - failed.begin();
  const bool all = std::ranges::count(failed, 1) == size_;
  throw std::runtime_error(all ? failure
                               : "rank " + std::to_string(rank) + ": " + texts[static_cast<std::size_t>(rank)]);
}

void Ranks::abort(const std::string& why, int code) {
  std::fflush(stdout);
  // What all meet at about the same time, rank 0 tells: it ends the others meanwhile.
  std::this_thread::sleep_for(std::chrono::milliseconds(500 * std::min(rank_, 4)));
  scene::tell("pgl_viewer", mpi_ ? "rank " + std::to_string(rank_) + ": " + why : why);
  std::fflush(stderr);
#if defined(PGL_VIEWER_MPI)
  if (mpi_) {
    alarm(5);  // should MPI not even manage this
    MPI_Abort(MPI_COMM_WORLD, code);
  }
#endif
  std::_Exit(code);
}

}  // namespace pgl::viewer
