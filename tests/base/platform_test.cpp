#include "base/platform.hpp"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <string>
#include <thread>

namespace nadir {
namespace {

struct Started {
  int niceness = 0;
  std::string name;
};

Started start(const char* name, ThreadPriority priority) {
  Started started;
  std::thread([&] {
    begin_thread(name, priority);
    started.niceness = ::getpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()));
    std::array<char, 16> shown{};
    ::pthread_getname_np(::pthread_self(), shown.data(), shown.size());
    started.name = shown.data();
  }).join();
  return started;
}

int program_niceness() { return ::getpriority(PRIO_PROCESS, static_cast<id_t>(::getpid())); }

TEST(ThreadPriorities, LowIsNicerThanTheProgram) {
  const int before = program_niceness();
  EXPECT_EQ(start("low", ThreadPriority::low).niceness, std::min(before + 4, 19));
  EXPECT_EQ(start("normal", ThreadPriority::normal).niceness, before);
  EXPECT_EQ(program_niceness(), before) << "the other threads keep theirs";
}

TEST(ThreadPriorities, HighWherePermittedAndHarmlessElsewhere) {
  const int before = program_niceness();
  const int high = start("high", ThreadPriority::high).niceness;
  EXPECT_TRUE(high == before || high == std::max(before - 10, -20)) << high;
}

TEST(ThreadPriorities, NamesAreSetAndLongOnesTruncated) {
  EXPECT_EQ(start("link", ThreadPriority::normal).name, "link");
  EXPECT_EQ(start("a name that is too long", ThreadPriority::normal).name, "a name that is ");
}

}  // namespace

}  // namespace nadir
