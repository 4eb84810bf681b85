#include "base/thread_rank.hpp"

#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>

namespace nadir {
namespace {

// Threads that work hard may not be far apart: the kernel shares a group's weight out to the processors by what runs
// there, and one that is much nicer than its brothers starves on a processor that it has to share with other groups.
constexpr int kAhead = -10, kBehind = 4, kMostNice = 19, kLeastNice = -20;
constexpr std::size_t kLongestName = 15;

int step(ThreadPriority rank) {
  switch (rank) {
    case ThreadPriority::ahead: return kAhead;
    case ThreadPriority::behind: return kBehind;
    case ThreadPriority::beside: break;
  }
  return 0;
}

}  // namespace

void begin_thread(const char* name, ThreadPriority rank) {
  ::pthread_setname_np(::pthread_self(), std::string(name).substr(0, kLongestName).c_str());
  errno = 0;
  const int program = ::getpriority(PRIO_PROCESS, static_cast<id_t>(::getpid()));  // its main thread's
  if (program == -1 && errno != 0) return;
  const int wanted = std::clamp(program + step(rank), kLeastNice, kMostNice);
  const auto thread = static_cast<id_t>(::gettid());
  [[maybe_unused]] const int refused = ::setpriority(PRIO_PROCESS, thread, wanted);  // then it stays as it is
}

}  // namespace nadir
