#include "service/stop_signals.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "service/mailbox.hpp"

namespace nadir {
namespace {

// Ends when the token says so; hangs (and so fails by ctest's time limit) when it never does.
void wait_for_stop(std::stop_token stop) {
  LatestMailbox<int> never;
  never.take(std::move(stop));
}

TEST(StopSignals, SigtermAndSigintStopEveryThread) {
  for (const int signal : {SIGTERM, SIGINT}) {
    StopSignals signals;
    std::atomic<int> ended = 0;
    {
      std::jthread one([&] { wait_for_stop(signals.token()), ++ended; });
      std::jthread two([&] { wait_for_stop(signals.token()), ++ended; });
      ::kill(::getpid(), signal);
    }
    EXPECT_EQ(ended, 2);
    EXPECT_TRUE(signals.token().stop_requested());
  }
}

TEST(StopSignals, StopsFromInsideAsWell) {
  StopSignals signals;
  EXPECT_FALSE(signals.token().stop_requested());
  signals.request_stop();
  EXPECT_TRUE(signals.token().stop_requested());
}

TEST(StopSignals, ASecondSignalEndsTheProcess) {
  EXPECT_EXIT(
      {
        StopSignals signals;
        ::kill(::getpid(), SIGTERM);
        wait_for_stop(signals.token());
        ::kill(::getpid(), SIGTERM);
        for (;;) ::pause();
      },
      testing::ExitedWithCode(128 + SIGTERM), "");
}

TEST(StopSignals, RestoresTheSignalMask) {
  sigset_t before, after;
  ::pthread_sigmask(SIG_SETMASK, nullptr, &before);
  { const StopSignals signals; }
  ::pthread_sigmask(SIG_SETMASK, nullptr, &after);
  EXPECT_EQ(sigismember(&before, SIGTERM), sigismember(&after, SIGTERM));
  EXPECT_EQ(sigismember(&after, SIGTERM), 0);
}

}  // namespace
}  // namespace nadir
