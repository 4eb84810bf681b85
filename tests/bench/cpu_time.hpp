// CPU time of the whole process, so that threads of libraries count.
#pragma once

#include <ctime>

namespace nadir::bench {

inline double cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

}  // namespace nadir::bench
