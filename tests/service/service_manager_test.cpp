#include "service/watchdog.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>

#include "base/error.hpp"
#include "service/notify_socket.hpp"

namespace nadir {
namespace {

using test::NotifySocket;

TEST(ServiceManager, SaysWhatSystemdWantsToHear) {
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

TEST(ServiceManager, WithoutSystemdNothingIsSaid) {
  const ServiceManager manager(std::nullopt);
  EXPECT_FALSE(manager.listens());
  EXPECT_FALSE(manager.ready("x"));
}

TEST(ServiceManager, ADeadOrDeafSystemdHoldsNobodyUp) {
  const test::TemporaryFolder folder;
  const ServiceManager gone((folder / "nothing").string());
  EXPECT_FALSE(gone.alive());
  const NotifySocket deaf;
  const ServiceManager manager(deaf.address());
  int sent = 0;
  while (sent < 100'000 && manager.alive()) ++sent;  // its queue fills; sending neither waits nor fails loudly
  EXPECT_LT(sent, 100'000);
}

TEST(ServiceManager, RefusesWhatIsNoSocket) {
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

TEST_F(Environment, NonsenseIsNoWatchdog) {
  for (const char* text : {"0", "-1", "x", "10s", "99999999999999999999999"}) {
    set("WATCHDOG_USEC", text);
    EXPECT_FALSE(read_service_environment().watchdog_interval_s) << text;
  }
}

}  // namespace
}  // namespace nadir
