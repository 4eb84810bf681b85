#include "service/watchdog.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <optional>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "service/notify_socket.hpp"
#include "support/manual_clock.hpp"

namespace nadir {
namespace {

using test::NotifySocket;

TEST(ThreadWatch, NamesLateThreadsAndTheirDelay) {
  ManualClock clock;
  ThreadWatch watch(clock);
  auto localizer = watch.watch("localizer", 2);
  auto recorder = watch.watch("recorder", 10);
  clock.advance(2);
  EXPECT_TRUE(watch.late().empty());
  clock.advance(0.5);
  ASSERT_EQ(watch.late().size(), 1);
  EXPECT_EQ(watch.late()[0].name, "localizer");
  EXPECT_EQ(watch.late()[0].text(), "localizer silent for 2.5 s (at most 2 s)");
  localizer();
  EXPECT_TRUE(watch.late().empty());
  clock.advance(20);
  EXPECT_EQ(watch.late().size(), 2);
}

TEST(ThreadWatch, AThreadThatEndedInOrderIsNotLate) {
  ManualClock clock;
  ThreadWatch watch(clock);
  std::optional<ThreadWatch::Beat> beat(watch.watch("api", 1));
  clock.advance(5);
  EXPECT_EQ(watch.late().size(), 1);
  beat.reset();
  EXPECT_TRUE(watch.late().empty());
}

TEST(ThreadWatch, BeatsComeFromManyThreads) {
  ManualClock clock;
  ThreadWatch watch(clock);
  std::vector<std::jthread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([beat = watch.watch("worker", 1)]() mutable {
      for (int n = 0; n < 2000; ++n) beat();
    });
  }
  for (int n = 0; n < 200; ++n) {
    clock.advance(0.001);
    watch.late();
  }
  threads.clear();
  EXPECT_TRUE(watch.late().empty());
}

TEST(Watchdog, NotifiesOnlyWhileAllThreadsRespond) {
  const NotifySocket systemd;
  const ServiceManager manager(systemd.address());
  ManualClock clock;
  ThreadWatch watch(clock);
  auto beat = watch.watch("localizer", 2);
  Watchdog watchdog(watch, manager, 3, clock.monotonic_s());

  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), std::nullopt);
  EXPECT_EQ(systemd.received(), "WATCHDOG=1");
  for (int i = 0; i < 9; ++i) {
    clock.advance(0.1);
    beat();
    watchdog.tick(clock.monotonic_s());
  }
  EXPECT_EQ(systemd.received(), std::nullopt) << "a third of the interval has not passed";
  clock.advance(0.2);
  beat();
  watchdog.tick(clock.monotonic_s());
  EXPECT_EQ(systemd.received(), "WATCHDOG=1");

  clock.advance(2.5);
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), "localizer silent for 2.5 s (at most 2 s)");
  EXPECT_EQ(systemd.received(), "STATUS=hangs: localizer silent for 2.5 s (at most 2 s)");
  clock.advance(5);
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), std::nullopt) << "reported once";
  EXPECT_EQ(systemd.received(), std::nullopt) << "systemd will act";

  beat();
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), "");
  EXPECT_EQ(systemd.received(), "WATCHDOG=1");
}

TEST(Watchdog, WithoutSystemdItStillNamesLateThreads) {
  const ServiceManager nobody(std::nullopt);
  ManualClock clock;
  ThreadWatch watch(clock);
  auto beat = watch.watch("camera", 1);
  Watchdog watchdog(watch, nobody, std::nullopt, clock.monotonic_s());
  clock.advance(2);
  EXPECT_EQ(watchdog.tick(clock.monotonic_s()), "camera silent for 2.0 s (at most 1 s)");
}

TEST(ServiceManager, SendsTheMessagesOfSystemd) {
  for (const std::string& name : {std::string(), fmt::format("@nadir-test-{}", ::getpid())}) {
    const NotifySocket systemd(name);
    const ServiceManager manager(systemd.address());
    EXPECT_TRUE(manager.listens());
    EXPECT_TRUE(manager.ready("package verified"));
    EXPECT_EQ(systemd.received(), "READY=1\nSTATUS=package verified");
    EXPECT_TRUE(manager.status("normal, σ 6 m"));
    EXPECT_EQ(systemd.received(), "STATUS=normal, σ 6 m");
    EXPECT_TRUE(manager.alive());
    EXPECT_EQ(systemd.received(), "WATCHDOG=1");
    EXPECT_TRUE(manager.stopping("asked to"));
    EXPECT_EQ(systemd.received(), "STOPPING=1\nSTATUS=asked to");
  }
}

TEST(ServiceManager, AStatusIsOneLine) {
  const NotifySocket systemd;
  const ServiceManager manager(systemd.address());
  manager.status("a\nSTOPPING=1\nb");
  EXPECT_EQ(systemd.received(), "STATUS=a STOPPING=1 b");
}

TEST(ServiceManager, WithoutSystemdNothingIsSent) {
  const ServiceManager manager(std::nullopt);
  EXPECT_FALSE(manager.listens());
  EXPECT_FALSE(manager.ready("x"));
}

TEST(ServiceManager, AnUnresponsiveSystemdBlocksNothing) {
  const test::TemporaryFolder folder;
  const ServiceManager gone((folder / "nothing").string());
  EXPECT_FALSE(gone.alive());
  const NotifySocket deaf;
  const ServiceManager manager(deaf.address());
  int sent = 0;
  while (sent < 100'000 && manager.alive()) ++sent;  // its queue fills; sending neither waits nor fails loudly
  EXPECT_LT(sent, 100'000);
}

TEST(ServiceManager, RejectsInvalidSockets) {
  for (const std::string& name : {std::string("relative/path"), std::string("/"), std::string("@"), std::string(""),
                                  "/" + std::string(200, 'x'), std::string("unix:/run/x")}) {
    EXPECT_THROW(ServiceManager{name}, Error) << name;
  }
}

class Environment : public testing::Test {
 protected:
  void SetUp() override { clear(); }
  void TearDown() override { clear(); }
  static void set(const char* name, const std::string& value) { ::setenv(name, value.c_str(), 1); }
  static void clear() {
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(name);
  }
};

TEST_F(Environment, EmptyMeansNothing) {
  const ServiceEnvironment environment = read_service_environment();
  EXPECT_FALSE(environment.notify_socket);
  EXPECT_FALSE(environment.watchdog_interval_s);
  set("NOTIFY_SOCKET", "");
  EXPECT_FALSE(read_service_environment().notify_socket);
}

TEST_F(Environment, ReadsWhatSystemdSetsUp) {
  set("NOTIFY_SOCKET", "/run/systemd/notify");
  set("WATCHDOG_USEC", "10000000");
  EXPECT_EQ(read_service_environment().notify_socket, "/run/systemd/notify");
  EXPECT_EQ(read_service_environment().watchdog_interval_s, 10);
  set("WATCHDOG_PID", std::to_string(::getpid()));
  EXPECT_EQ(read_service_environment().watchdog_interval_s, 10);
  set("WATCHDOG_PID", "1");
  EXPECT_FALSE(read_service_environment().watchdog_interval_s) << "somebody else's";
}

TEST_F(Environment, InvalidValuesAreNoWatchdog) {
  for (const char* text : {"0", "-1", "x", "10s", "99999999999999999999999"}) {
    set("WATCHDOG_USEC", text);
    EXPECT_FALSE(read_service_environment().watchdog_interval_s) << text;
  }
}

}  // namespace
}  // namespace nadir
