// SPDX-License-Identifier: MIT
#include "scene/mapped_file.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <limits>
#include <mutex>
#include <string>

#include "scene/error.hpp"

namespace pgl::scene {

/// A mapping that the handler looks after. They are linked for ever, and used again, so that the handler needs no lock.
struct Watch {
  std::atomic<std::uintptr_t> begin{0};
  std::atomic<std::uintptr_t> end{0};  ///< 0: not in use
  std::atomic<bool> lost{false};
  std::atomic<bool> taken{false};
  Watch* next = nullptr;
};

namespace {

// What the handler touches is lock-free and has no destructor.
std::atomic<Watch*> first_watch{nullptr};
struct sigaction previous_action;
std::uintptr_t system_page = 4096;
static_assert(std::atomic<std::uintptr_t>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);

/// Puts a page of zeros where a page of a watched mapping cannot be read, so that the instruction succeeds when it is
/// tried again; each fault takes one page away, so this ends.
void on_bus_error(int signal, siginfo_t* info, void* context) {
  const int saved_errno = errno;
  const auto address = reinterpret_cast<std::uintptr_t>(info->si_addr);
  if (info->si_code > 0) {  // from a memory access, not from kill()
    for (Watch* watch = first_watch.load(std::memory_order_acquire); watch; watch = watch->next) {
      const std::uintptr_t end = watch->end.load(std::memory_order_acquire);
      if (address >= end || address < watch->begin.load(std::memory_order_acquire)) continue;
      void* const page = reinterpret_cast<void*>(address / system_page * system_page);
      watch->lost.store(true, std::memory_order_release);
      if (mmap(page, system_page, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0) == MAP_FAILED) break;
      errno = saved_errno;
      return;
    }
  }
  if (previous_action.sa_flags & SA_SIGINFO) {
    previous_action.sa_sigaction(signal, info, context);
  } else if (previous_action.sa_handler != SIG_DFL && previous_action.sa_handler != SIG_IGN) {
    previous_action.sa_handler(signal);
  } else if (info->si_code > 0 || previous_action.sa_handler == SIG_DFL) {
    // As without a handler: the access is tried again and ends the process, or the signal is sent again.
    struct sigaction plain {};
    plain.sa_handler = SIG_DFL;
    sigaction(SIGBUS, &plain, nullptr);
    if (info->si_code <= 0) raise(signal);  // is let in when this handler returns
  }
  errno = saved_errno;
}

void install_handler() {
  static std::once_flag once;
  std::call_once(once, [] {
    system_page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
    struct sigaction action {};
    action.sa_sigaction = on_bus_error;
    action.sa_flags = SA_SIGINFO | SA_ONSTACK | SA_RESTART;
    sigemptyset(&action.sa_mask);
    sigaction(SIGBUS, nullptr, &previous_action);  // before anything can reach the handler
    sigaction(SIGBUS, &action, nullptr);
  });
}

Watch* watch_mapping(void* data, std::uint64_t size) {
  Watch* watch = first_watch.load(std::memory_order_acquire);
  for (; watch; watch = watch->next)
    if (!watch->taken.exchange(true)) break;
  if (!watch) {
    watch = new Watch;
    watch->taken = true;
    watch->next = first_watch.load();
    while (!first_watch.compare_exchange_weak(watch->next, watch)) {
    }
  }
  const auto begin = reinterpret_cast<std::uintptr_t>(data);
  watch->lost = false;
  watch->begin = begin;
  watch->end = begin + static_cast<std::uintptr_t>(size);
  return watch;
}

std::string reason(const char* what) {
  return std::string(what) + ": " + std::strerror(errno);
}

}  // namespace

MappedFile::MappedFile(const std::filesystem::path& file) : path_(file) {
  descriptor_ = open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);  // a pipe must not block
  if (descriptor_ < 0) throw Error(file, reason("cannot be opened"));
  struct stat status {};
  const bool known = fstat(descriptor_, &status) == 0;
  if (known && S_ISREG(status.st_mode)) {
    size_ = static_cast<std::uint64_t>(status.st_size);
    return;
  }
  const std::string why = known ? "is not a regular file" : reason("cannot be read");
  close(descriptor_);
  throw Error(file, why);
}

MappedFile::~MappedFile() {
  if (watch_) {
    watch_->end = 0;
    watch_->begin = std::numeric_limits<std::uintptr_t>::max();
    watch_->taken = false;
  }
  if (data_) munmap(data_, static_cast<std::size_t>(size_));
  close(descriptor_);
}

void MappedFile::read_first(std::span<std::byte> bytes) const {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = pread(descriptor_, bytes.data() + done, bytes.size() - done, static_cast<off_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw Error(path_, reason("cannot be read"));
    if (n == 0) throw Error(path_, "has shrunk while it was read");
    done += static_cast<std::size_t>(n);
  }
}

void MappedFile::map() {
  if (size_ == 0) return;
  install_handler();
  void* const data = size_ <= std::numeric_limits<std::size_t>::max()
                         ? mmap(nullptr, static_cast<std::size_t>(size_), PROT_READ, MAP_PRIVATE, descriptor_, 0)
                         : MAP_FAILED;
  if (data == MAP_FAILED) throw Error(path_, reason("cannot be mapped into memory"));
  data_ = data;
  watch_ = watch_mapping(data, size_);
}

void MappedFile::advise(std::uint64_t first, std::uint64_t bytes, int advice) const noexcept {
  if (!data_ || bytes == 0) return;
  const std::uint64_t begin = first / system_page * system_page;
  const int saved_errno = errno;
  madvise(static_cast<std::byte*>(data_) + begin, static_cast<std::size_t>(first + bytes - begin), advice);
  errno = saved_errno;
}
void MappedFile::advise_random(std::uint64_t first, std::uint64_t bytes) const noexcept {
  advise(first, bytes, MADV_RANDOM);
}
void MappedFile::advise_soon(std::uint64_t first, std::uint64_t bytes) const noexcept {
  advise(first, bytes, MADV_WILLNEED);
}

bool MappedFile::shrunk() const noexcept {
  struct stat status {};
  return fstat(descriptor_, &status) == 0 && static_cast<std::uint64_t>(status.st_size) < size_;
}

bool MappedFile::lost() const noexcept {
  return watch_ && watch_->lost.load(std::memory_order_acquire);
}

}  // namespace pgl::scene
