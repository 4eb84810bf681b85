// What we ask of the operating system, the C library and the processor.
#pragma once

#include <filesystem>
#include <vector>

// Loops that gain from wide registers are compiled twice, for AVX2 and for the baseline; the loader picks what the
// processor has. For integers, and for floating point only where each result comes from one lane: sums over lanes would
// differ between machines.
#if defined(__x86_64__) && defined(__linux__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && \
    !defined(__clang__)
#define NADIR_FOR_WIDE_REGISTERS __attribute__((target_clones("avx2", "default")))
#else
#define NADIR_FOR_WIDE_REGISTERS  // sanitizers start later than the loader picks
#endif

namespace nadir {

// Scheduling priority of a thread: niceness relative to that of the program (Linux keeps it per thread). `high` needs
// a right that an ordinary program does not have (LimitNICE= in runtime/nadird.service grants it); without it the
// thread stays at normal priority. Against other programs, control groups and sessions count, not this.
enum class ThreadPriority {
  high,    // little work with a deadline in milliseconds: fixes to the autopilot
  normal,  // as the program was started
  low,     // may take longer while others are busy: map matching, the recorder, readers of the API
};

// Sets priority and name (as top -H and debuggers show it; 15 characters at most) of the calling thread.
void begin_thread(const char* name, ThreadPriority priority);

// For programs that allocate and free megabytes for every frame: freed memory stays with the process from now on. glibc
// would return it to the system each time and take it again page by page, a tenth of the time of a replay. No effect
// with other C libraries.
void keep_freed_memory();

// Processor time of the calling thread so far.
double thread_processor_s();

// How long the calling thread has waited for a processor so far, ready to go on; 0 where the kernel does not count it.
double thread_delayed_s();

// The search path of plug-ins: the folder of the program, and ../lib/nadir of an installation.
std::vector<std::filesystem::path> plugin_folders();

}  // namespace nadir
