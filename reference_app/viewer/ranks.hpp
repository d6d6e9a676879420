// SPDX-License-Identifier: MIT
// The processes that draw one picture together, one for each GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace pgl::viewer {

/// Thrown by Ranks where the run must end and somebody else says why, or has said so: nothing is left to tell. Exit
/// with 0 then: mpirun ends all others as soon as one exits with another code, also who has yet to tell.
struct EndedElsewhere : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The processes that mpirun started, numbered from 0: rank 0 has the camera and the picture. One process alone, which
/// makes no call of MPI, where mpirun was not there.
///
/// What is said to be called by all is called by all ranks in the same order. No call waits for ever: a rank that has
/// not come after `patience` seconds and four times as long as this one's own longest stretch of work of late is taken
/// for dead; then the run ends, in all ranks, with one line that names it. Throws std::runtime_error for what MPI
/// reports.
class Ranks {
 public:
  /// Joins the others. Throws std::runtime_error where mpirun started several and this program was built without MPI,
  /// or MPI cannot be had.
  explicit Ranks(double patience_seconds);
  /// Leaves, unless that was done: at the end of a run that went well, or after agree() threw. Where another exception
  /// passes, the others may wait for what never comes: then this does not leave, and mpirun ends them when the process
  /// exits.
  ~Ranks();
  Ranks(const Ranks&) = delete;
  Ranks& operator=(const Ranks&) = delete;

  /// What the environment says before anyone is joined: 0 where mpirun was not there.
  static int rank_of_environment();

  int rank() const { return rank_; }
  int size() const { return size_; }
  int local_rank() const { return local_rank_; }  ///< among those on this machine
  int local_size() const { return local_size_; }
  bool on_one_machine() const { return local_size_ == size_; }

  /// By all: gives everybody rank 0's value.
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void broadcast(T& value) { broadcast_bytes(std::as_writable_bytes(std::span(&value, 1))); }

  /// By all: the values of all, by rank.
  template <class T>
  requires std::is_trivially_copyable_v<T> std::vector<T> gather(const T& own) {
    std::vector<T> all(static_cast<std::size_t>(size_));
    gather_bytes(std::as_bytes(std::span(&own, 1)), std::as_writable_bytes(std::span(all)));
    return all;
  }

  /// By all: the texts of all, by rank, on rank 0; nothing elsewhere.
  std::vector<std::string> gather_texts(const std::string& own);

  /// By all: the least of the values.
  std::uint64_t least(std::uint64_t value);

  /// By all, with as many keys: the least or the largest of each.
  enum class Combine { least, largest };
  void combine(std::span<std::uint32_t> keys, Combine how);

  /// From a rank to another one that receives as many bytes from it. Both wait until it is done.
  void send(int to, std::span<const std::byte> bytes);
  void receive(int from, std::span<std::byte> bytes);

  /// By all: `failure` is what went wrong here, or empty. Where it did anywhere, throws in all ranks: on rank 0 a
  /// std::runtime_error with the first failure's text (and its rank, if only some failed or it is not that of rank 0),
  /// elsewhere EndedElsewhere. So one line is told, and all leave in order.
  void agree(const std::string& failure);

  /// By all: the last call but abort(). What is done after it keeps nobody waiting.
  void leave();

  /// Ends all ranks at once, with one line on stderr that begins with pgl_viewer and, with several, this rank: for what
  /// goes wrong between two agree()s. Alone, only tells and exits. Never returns.
  [[noreturn]] void abort(const std::string& why, int code);

 private:
  void broadcast_bytes(std::span<std::byte> value);
  void gather_bytes(std::span<const std::byte> own, std::span<std::byte> all);

  struct Mpi;                 // what has joined the others
  std::unique_ptr<Mpi> mpi_;  // none: alone
  int rank_ = 0, size_ = 1, local_rank_ = 0, local_size_ = 1;
};

}  // namespace pgl::viewer
