#include "service/held_memory.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>
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

// Each case is the start of a program of its own: memory is held before the first thread, and neither the heaps that
// other tests' threads left behind nor the heap that a case before it has grown may count. A child that is started
// anew ("threadsafe") runs nothing but its case.
class HeldMemory : public ::testing::Test {
 protected:
  HeldMemory() { GTEST_FLAG_SET(death_test_style, "threadsafe"); }
  ~HeldMemory() override { GTEST_FLAG_SET(death_test_style, style_); }

 private:
  const std::string style_ = GTEST_FLAG_GET(death_test_style);
};

constexpr int kHeld = 0, kWrong = 1;

// Ends the child, with what was measured on stderr where it is wrong.
void require(bool holds, const char* what, double found_mb) {
  if (holds) return;
  std::fprintf(stderr, "%s: %.1f MB\n", what, found_mb);
  std::_Exit(kWrong);
}

[[noreturn]] void hold_and_work() {
  const double before_mb = resident_mb();
  hold_memory(128);
  const double held_mb = resident_mb();
  require(held_mb >= before_mb + 120, "128 MB were to be reserved, and were not", held_mb - before_mb);
  for (unsigned round = 0; round < 5; ++round) {
    std::vector<std::jthread> threads;
    for (unsigned i = 0; i < 3; ++i) threads.emplace_back(come_and_go, 10 * round + i);
    threads.clear();
    require(resident_mb() <= held_mb * 1.05, "more than what was reserved is in use", resident_mb() - held_mb);
    require(resident_mb() >= held_mb * 0.95, "memory was given back", held_mb - resident_mb());
  }
  std::_Exit(kHeld);
}

TEST_F(HeldMemory, IsReservedAtTheStartAndStaysConstant) {
  EXPECT_EXIT(hold_and_work(), ::testing::ExitedWithCode(kHeld), "");
}

[[noreturn]] void hold_nothing() {
  const double before_mb = resident_mb();
  hold_memory(0);
  require(resident_mb() <= before_mb + 10, "nothing was to be reserved", resident_mb() - before_mb);
  std::_Exit(kHeld);
}

TEST_F(HeldMemory, ZeroReservesNothing) { EXPECT_EXIT(hold_nothing(), ::testing::ExitedWithCode(kHeld), ""); }

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

TEST_F(HeldMemory, MoreThanAvailableIsRejected) { EXPECT_EXIT(ask_for_too_much(), ::testing::ExitedWithCode(7), ""); }

#endif

}  // namespace
}  // namespace nadir
