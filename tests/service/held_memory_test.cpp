#include "service/held_memory.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <fstream>
#include <random>
#include <thread>
#include <vector>

#include "base/error.hpp"

namespace nadir {
namespace {

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

// What is ours alone: pages of programs and libraries come and go as the kernel likes.
double resident_mb() {
  std::ifstream file("/proc/self/statm");
  double size = 0, resident = 0, of_files = 0;
  file >> size >> resident >> of_files;
  return (resident - of_files) * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1e6;
}

// Buffers of pictures' sizes that come and go, on three threads at once; never more than 60 MB together.
void come_and_go(unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::vector<char>> held(4);
  for (int i = 0; i < 300; ++i) held[random() % held.size()].assign(1 + random() % 5'000'000, 'x');
}

TEST(HeldMemory, IsReservedAtTheStartAndStaysConstant) {
  const double before_mb = resident_mb();
  hold_memory(128);
  const double held_mb = resident_mb();
  EXPECT_GE(held_mb, before_mb + 120);
  for (unsigned round = 0; round < 5; ++round) {
    std::vector<std::jthread> threads;
    for (unsigned i = 0; i < 3; ++i) threads.emplace_back(come_and_go, 10 * round + i);
    threads.clear();
    EXPECT_LE(resident_mb(), held_mb * 1.05) << "round " << round;
    EXPECT_GE(resident_mb(), held_mb * 0.95) << "given back in round " << round;
  }
}

TEST(HeldMemory, ZeroReservesNothing) {
  const double before_mb = resident_mb();
  hold_memory(0);
  EXPECT_LE(resident_mb(), before_mb + 10);
}

// The exit code says what came of it.
[[noreturn]] void ask_for_too_much() {
  std::ifstream file("/proc/self/statm");
  rlim_t pages = 0;
  file >> pages;
  const rlim_t most = pages * static_cast<rlim_t>(::sysconf(_SC_PAGESIZE)) + (rlim_t{128} << 20);
  const struct rlimit limit { most, most };
  ::setrlimit(RLIMIT_AS, &limit);
  try {
    hold_memory(512);
  } catch (const Error& error) {
    std::_Exit(error.text().expected == "512 MB" ? 7 : 8);
  }
  std::_Exit(9);
}

TEST(HeldMemory, MoreThanAvailableIsRejected) { EXPECT_EXIT(ask_for_too_much(), ::testing::ExitedWithCode(7), ""); }

#endif

}  // namespace
}  // namespace nadir
