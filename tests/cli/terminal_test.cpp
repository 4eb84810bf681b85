#include "cli/terminal.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "base/error.hpp"

namespace nadir {
namespace {

TEST(TerminalProgress, IsSilentWhereThereIsNoTerminal) {
  std::ostringstream err;
  TerminalProgress progress(err, false, 80);
  progress.begin("tiles", 2, "tiles");
  progress.advance(2);
  progress.end();
  EXPECT_EQ(err.str(), "");
}

TEST(TerminalProgress, FitsTheLineAndEndsClean) {
  std::ostringstream err;
  {
    TerminalProgress progress(err, true, 30);
    progress.begin("a label that is longer than the line", 10, "tiles");
  }
  EXPECT_THAT(err.str(), ::testing::EndsWith("\r\x1b[2K"));
  const auto first = err.str().find("\x1b[2K") + 4;
  EXPECT_LT(err.str().find('\r', first) - first, 30U);
}

TEST(TerminalProgress, OtherThreadsOnlyCount) {
  std::ostringstream err;
  TerminalProgress progress(err, false, 80);
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

}  // namespace
}  // namespace nadir
