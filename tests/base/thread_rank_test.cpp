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

struct Seen {
  int niceness = 0;
  std::string name;
};

Seen begun(const char* name, ThreadPriority rank) {
  Seen seen;
  std::thread([&] {
    begin_thread(name, rank);
    seen.niceness = ::getpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()));
    std::array<char, 16> told{};
    ::pthread_getname_np(::pthread_self(), told.data(), told.size());
    seen.name = told.data();
  }).join();
  return seen;
}

int programs_niceness() { return ::getpriority(PRIO_PROCESS, static_cast<id_t>(::getpid())); }

TEST(ThreadRanks, BehindIsNicerThanTheProgram) {
  const int before = programs_niceness();
  EXPECT_EQ(begun("behind", ThreadPriority::low).niceness, std::min(before + 4, 19));
  EXPECT_EQ(begun("beside", ThreadPriority::normal).niceness, before);
  EXPECT_EQ(programs_niceness(), before) << "the others stay as they were";
}

TEST(ThreadRanks, AheadWhereThatIsPermittedAndHarmlessWhereNot) {
  const int before = programs_niceness();
  const int ahead = begun("ahead", ThreadPriority::high).niceness;
  EXPECT_TRUE(ahead == before || ahead == std::max(before - 10, -20)) << ahead;
}

TEST(ThreadRanks, NamesAreShownAndLongOnesCut) {
  EXPECT_EQ(begun("link", ThreadPriority::normal).name, "link");
  EXPECT_EQ(begun("a name that is too long", ThreadPriority::normal).name, "a name that is ");
}

}  // namespace
}  // namespace nadir
