#include "cli/terminal.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <sstream>

#include "base/error.hpp"

namespace nadir {
namespace {

TEST(TerminalProgress, IsSilentWhereThereIsNoTerminal) {
  std::ostringstream err;
  TerminalProgress progress(err, ProgressStyle::none, 80);
  progress.begin("tiles", 2, "tiles");
  progress.advance(2);
  progress.end();
  EXPECT_EQ(err.str(), "");
}

TEST(TerminalProgress, FitsTheLineAndEndsClean) {
  std::ostringstream err;
  {
    TerminalProgress progress(err, ProgressStyle::bar, 30);
    progress.begin("a label that is longer than the line", 10, "tiles");
  }
  EXPECT_THAT(err.str(), ::testing::EndsWith("\r\x1b[2K"));
  const auto first = err.str().find("\x1b[2K") + 4;
  EXPECT_LT(err.str().find('\r', first) - first, 30U);
}

TEST(TerminalProgress, OtherThreadsOnlyCount) {
  std::ostringstream err;
  TerminalProgress progress(err, ProgressStyle::none, 80);
  progress.begin("work", 4, "steps");
  request_interrupt(true);
  bool threw = false;
  std::thread([&] {
    try {
      progress.advance(1);
    } catch (const Interrupted&) {
      threw = true;
    }
  }).join();
  EXPECT_FALSE(threw);
  EXPECT_THROW(progress.advance(1), Interrupted);
  request_interrupt(false);
}

// With SA_RESTART a blocked read continues to wait after SIGTERM, and only SIGKILL ends the program.
TEST(Terminal, ASignalEndsAReadThatWaits) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    install_signal_handlers();
    const pid_t me = ::getpid();
    // From another process, while this one waits: the kernel delivers it in the read.
    if (::fork() == 0) {
      ::usleep(200'000);
      ::kill(me, SIGTERM);
      ::_exit(0);
    }
    char byte = 0;
    const ssize_t got = ::read(ends[0], &byte, 1);
    ::_exit(got < 0 && errno == EINTR && interrupt_requested() ? 42 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 42);
  ::close(ends[0]);
  ::close(ends[1]);
}

}  // namespace
}  // namespace nadir
