// SPDX-License-Identifier: MIT
// Ranks that work together, and the end of the run where one does not. Every run is bounded by mpirun()'s timeout,
// which shows as exit code 124.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "viewer/mpirun.hpp"

namespace {

namespace fs = std::filesystem;

std::vector<std::string> lines_of(const fs::path& path, const std::string& beginning) {
  std::ifstream file(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with(beginning)) lines.push_back(line);
  }
  return lines;
}

struct Outcome {
  int code;
  std::vector<std::string> out;   // all lines
  std::vector<std::string> told;  // those of stderr that are ours: mpirun has much to say
};

Outcome run(const std::string& before, const std::string& program, const std::string& arguments) {
  std::string folder = (fs::temp_directory_path() / "pgl_ranks_test.XXXXXX").string();
  if (mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no temporary folder");
  const fs::path out = fs::path(folder) / "out", err = fs::path(folder) / "err";
  const int status = std::system(
      (before + " '" + program + "' " + arguments + " >'" + out.string() + "' 2>'" + err.string() + "' </dev/null")
          .c_str());
  const Outcome outcome = {WIFEXITED(status) ? WEXITSTATUS(status) : 128, lines_of(out, ""),
                           lines_of(err, "pgl_viewer: ")};
  fs::remove_all(folder);
  return outcome;
}

#if defined(PGL_VIEWER_MPI)

/// Not there, or dead and only not yet asked for its exit code.
bool is_gone(int pid) {
  if (kill(pid, 0) != 0 && errno == ESRCH) return true;
  std::ifstream file("/proc/" + std::to_string(pid) + "/stat");
  const std::string stat{std::istreambuf_iterator<char>(file), {}};
  return stat.find(") Z ") != std::string::npos;
}

class Ranks : public testing::Test {
 protected:
  static Outcome run(int ranks, const std::string& arguments) {
    return ::run(viewer_tests::mpirun(ranks), PGL_RANKS_PROGRAM, arguments);
  }

  /// Four ranks, one of which does not do as the others do. The run must end with an error, and leave nobody behind.
  static std::vector<std::string> end_of(const std::string& mode, int culprit, const std::string& call = "gather") {
    const Outcome outcome = run(4, "2 " + mode + " " + std::to_string(culprit) + " " + call);
    EXPECT_NE(outcome.code, 0);
    EXPECT_NE(outcome.code, 124) << "it would have gone on for ever";
    int pids = 0;
    for (const std::string& line : outcome.out) {
      int pid = 0;
      if (std::sscanf(line.c_str(), "pid %d", &pid) != 1) continue;
      ++pids;
      for (int i = 0; i < 100 && !is_gone(pid); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(50));
      EXPECT_TRUE(is_gone(pid)) << pid;
      if (!is_gone(pid)) kill(pid, SIGKILL);
    }
    EXPECT_EQ(pids, 4);
    return outcome.told;
  }

  static void expect_named(const std::string& mode, const std::string& call) {
    for (const int culprit : {0, 1, 3}) {
      SCOPED_TRACE(mode + " " + std::to_string(culprit));
      const std::vector<std::string> told = end_of(mode, culprit, call);
      ASSERT_EQ(told.size(), 1u);
      EXPECT_NE(told[0].find(": rank " + std::to_string(culprit) + " has not answered for "), std::string::npos)
          << told[0];
      EXPECT_TRUE(told[0].ends_with("the run is over (--timeout)")) << told[0];
    }
  }
};

TEST_F(Ranks, CarryValuesOfEverySize) {
  for (const int ranks : {1, 2, 3, 4, 5}) {
    const Outcome outcome = run(ranks, "10 calls");
    EXPECT_EQ(outcome.code, 0) << ranks;
    EXPECT_EQ(outcome.out.size(), static_cast<std::size_t>(ranks));
    for (const std::string& line : outcome.out) EXPECT_TRUE(line.ends_with(" of " + std::to_string(ranks))) << line;
    EXPECT_TRUE(outcome.told.empty()) << outcome.told[0];
  }
}

TEST_F(Ranks, AreWaitedForAsLongAsTheWorkIs) {
  const Outcome outcome = run(3, "1 slow 1");
  EXPECT_EQ(outcome.code, 0);
  EXPECT_EQ(outcome.out.size(), 3u);
}

TEST_F(Ranks, KeepNobodyWaitingOnceTheyLeft) {
  const Outcome outcome = run(3, "1 leave 0");
  EXPECT_EQ(outcome.code, 0);
  EXPECT_EQ(outcome.out.size(), 3u);
}

TEST_F(Ranks, ThatDoNotBroadcastAreNamed) {
  expect_named("stop", "broadcast");
}
TEST_F(Ranks, ThatDoNotGatherAreNamed) {
  expect_named("stop", "gather");
}
TEST_F(Ranks, ThatDoNotCombineAreNamed) {
  expect_named("stop", "combine");
}
TEST_F(Ranks, ThatDoNotSendAreNamed) {
  expect_named("stop", "send");
}
TEST_F(Ranks, ThatDoNotAgreeAreNamed) {
  expect_named("stop", "agree");
}
TEST_F(Ranks, ThatDoNotLeaveAreNamed) {
  expect_named("stop", "leave");
}
TEST_F(Ranks, ThatRunForEverAreNamed) {
  expect_named("loop", "gather");
}

TEST_F(Ranks, ThatWaitForTheDeadAreNotBlamed) {
  const Outcome outcome = run(3, "1 patient 1");
  EXPECT_EQ(outcome.code, 1);
  ASSERT_EQ(outcome.told.size(), 1u);
  EXPECT_TRUE(outcome.told[0].starts_with("pgl_viewer: rank 0: rank 1 has not answered for ")) << outcome.told[0];
}

TEST_F(Ranks, EndWithOneThatIsKilled) {
  for (const int culprit : {0, 2}) end_of("die", culprit);  // mpirun says why
}

TEST_F(Ranks, EndWithOneThatExits) {
  for (const int culprit : {0, 2}) end_of("exit", culprit);  // mpirun says why, or who waited
}

TEST_F(Ranks, EndWithOneThatThrows) {
  for (const int culprit : {0, 2}) {
    EXPECT_EQ(end_of("throw", culprit), std::vector<std::string>{"pgl_viewer: a bolt is loose"});
  }
}

TEST_F(Ranks, EndWithTheCodeOfOneThatAborts) {
  for (const int culprit : {0, 2}) {
    const Outcome outcome = run(3, "10 abort " + std::to_string(culprit));
    EXPECT_EQ(outcome.code, 7);
    const std::string line = "pgl_viewer: rank " + std::to_string(culprit) + ": a bolt is loose";
    EXPECT_EQ(outcome.told, std::vector<std::string>{line});
  }
}

TEST_F(Ranks, AgreeOnOneLine) {
  const auto lines = [](int culprit) {
    const Outcome outcome = run(3, "10 refuse " + std::to_string(culprit));
    EXPECT_EQ(outcome.code, 1);
    return outcome.told;
  };
  EXPECT_EQ(lines(0), std::vector<std::string>{"pgl_viewer: no GPU for 0"});
  EXPECT_EQ(lines(1), std::vector<std::string>{"pgl_viewer: rank 1: no GPU for 1"});
  EXPECT_EQ(lines(2), std::vector<std::string>{"pgl_viewer: rank 2: no GPU for 2"});
}

TEST_F(Ranks, OfAnotherMpirunAreRefused) {
  // One process that is told that it is the first of two, but not by an mpirun of this MPI.
  const Outcome outcome = ::run("env -u OMPI_COMM_WORLD_SIZE PMI_SIZE=2 PMI_RANK=0", PGL_RANKS_PROGRAM, "1 calls");
  EXPECT_EQ(outcome.code, 1);
  ASSERT_EQ(outcome.told.size(), 1u);
  EXPECT_NE(outcome.told[0].find("mpirun started 2 ranks, MPI finds 1"), std::string::npos) << outcome.told[0];
}

#else

TEST(Ranks, WorkTogether) {
  GTEST_SKIP() << "MPI was not found: several ranks are NOT tested";
}

#endif

// ---- alone ----------------------------------------------------------------------------------------------------------
TEST(OneRank, NeedsNoMpirun) {
  for (const char* program : {PGL_RANKS_PROGRAM, PGL_RANKS_ALONE_PROGRAM}) {
    EXPECT_EQ(run("", program, "1 calls").out, std::vector<std::string>{"0 of 1"});
    const Outcome refused = run("", program, "1 refuse 0");
    EXPECT_EQ(refused.code, 1);
    EXPECT_EQ(refused.told, std::vector<std::string>{"pgl_viewer: no GPU for 0"});
    const Outcome aborted = run("", program, "1 abort 0");
    EXPECT_EQ(aborted.code, 7);
    EXPECT_EQ(aborted.told, std::vector<std::string>{"pgl_viewer: a bolt is loose"});
  }
}

TEST(OneRank, WithoutMpiIsNotOneOfSeveral) {
  const Outcome first = run("env OMPI_COMM_WORLD_SIZE=2 OMPI_COMM_WORLD_RANK=0", PGL_RANKS_ALONE_PROGRAM, "1 calls");
  EXPECT_EQ(first.code, 1);
  EXPECT_EQ(first.told,
            std::vector<std::string>{"pgl_viewer: mpirun started 2 ranks, this pgl_viewer was built without MPI"});
  const Outcome second = run("env PMI_SIZE=2 PMI_RANK=1", PGL_RANKS_ALONE_PROGRAM, "1 calls");
  EXPECT_EQ(second.code, 0);  // the first one says it
  EXPECT_TRUE(second.told.empty());
  EXPECT_EQ(run("env PMI_SIZE=1 PMI_RANK=0", PGL_RANKS_ALONE_PROGRAM, "1 calls").code, 0);
}

}  // namespace
