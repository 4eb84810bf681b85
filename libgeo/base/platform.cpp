#include "base/platform.hpp"

#include <malloc.h>
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <limits>
#include <string>
#include <system_error>

namespace nadir {
namespace {

// Niceness relative to the program. Busy threads must stay close together: the kernel distributes a control group's
// weight over the processors by what runs there, and a thread that is much nicer than the others of its program starves
// on a processor that it shares with other groups.
constexpr int kHigh = -10, kLow = 4, kMostNice = 19, kLeastNice = -20;
constexpr std::size_t kMaxThreadName = 15;

int niceness_of(ThreadPriority priority) {
  switch (priority) {
    case ThreadPriority::high: return kHigh;
    case ThreadPriority::low: return kLow;
    case ThreadPriority::normal: break;
  }
  return 0;
}

}  // namespace

void begin_thread(const char* name, ThreadPriority priority) {
  ::pthread_setname_np(::pthread_self(), std::string(name).substr(0, kMaxThreadName).c_str());
  errno = 0;
  const int program = ::getpriority(PRIO_PROCESS, static_cast<id_t>(::getpid()));  // that of its main thread
  if (program == -1 && errno != 0) return;
  const int wanted = std::clamp(program + niceness_of(priority), kLeastNice, kMostNice);
  const auto thread = static_cast<id_t>(::gettid());
  [[maybe_unused]] const int refused = ::setpriority(PRIO_PROCESS, thread, wanted);  // without the right: as before
}

void keep_freed_memory() {
#ifdef __GLIBC__
  ::mallopt(M_MMAP_THRESHOLD, 32 << 20);  // glibc's maximum: smaller buffers come from the heap
  ::mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
#endif
}

double thread_processor_s() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double thread_delayed_s() {
  double running_ns = 0, waiting_ns = 0;
  std::ifstream("/proc/thread-self/schedstat") >> running_ns >> waiting_ns;
  return 1e-9 * waiting_ns;
}

std::vector<std::filesystem::path> plugin_folders() {
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return {};
  return {program.parent_path(), program.parent_path().parent_path() / "lib" / "nadir"};
}

}  // namespace nadir
