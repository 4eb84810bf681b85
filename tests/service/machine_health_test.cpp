#include "service/machine_health.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <map>

#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

std::map<std::string, double> by_name(const NamedValues& values) { return {values.begin(), values.end()}; }

class FakeMachine : public ::testing::Test {
 protected:
  FakeMachine() {
    for (const char* folder :
         {"proc/self", "thermal/thermal_zone0", "thermal/thermal_zone1", "thermal/cooling_device0"}) {
      std::filesystem::create_directories(folder_ / folder);
    }
    write("proc/self/status", "Name:\tnadird\nVmPeak:\t  900000 kB\nVmRSS:\t  312500 kB\n");
    write("proc/meminfo", "MemTotal:  8000000 kB\nMemAvailable:  976562 kB\n");
    write("proc/loadavg", "1.25 0.80 0.40 2/345 6789\n");
    write("thermal/thermal_zone0/temp", "41000\n");
    write("thermal/thermal_zone1/temp", "68500\n");
    write("thermal/cooling_device0/temp", "99000\n");
    use_cpu(100, 20);
  }
  void write(const std::string& name, const std::string& text) { write_file_atomic(folder_ / name, text); }
  // In seconds; the name of the process is as bad as a name may be.
  void use_cpu(int user_s, int system_s) {
    const long hz = ::sysconf(_SC_CLK_TCK);
    write("proc/self/stat", "42 (na) (dird 7) S 1 2 3 4 5 6 7 8 9 10 " + std::to_string(user_s * hz) + " " +
                                std::to_string(system_s * hz) + " 0 0 20 0\n");
  }

  const test::TemporaryFolder folder_;
  MachineHealth health_{folder_ / "proc", folder_ / "thermal"};
};

TEST_F(FakeMachine, MeasuresMemoryLoadAndTheHottestZone) {
  const auto values = by_name(health_.measure(10));
  EXPECT_NEAR(values.at("memory_mb"), 320, 0.01);
  EXPECT_NEAR(values.at("memory_available_mb"), 1000, 0.01);
  EXPECT_EQ(values.at("load_1min"), 1.25);
  EXPECT_EQ(values.at("temperature_c"), 68.5);
  EXPECT_FALSE(values.contains("cpu_percent")) << "one look is no rate";
}

TEST_F(FakeMachine, CpuIsTheTimeUsedSinceTheLastCall) {
  health_.measure(10);
  use_cpu(106, 22);
  EXPECT_NEAR(by_name(health_.measure(15)).at("cpu_percent"), 160, 1e-9);
  EXPECT_NEAR(by_name(health_.measure(20)).at("cpu_percent"), 0, 1e-9);
}

TEST_F(FakeMachine, LeavesOutWhatIsMissingOrNonsense) {
  std::filesystem::remove_all(folder_ / "thermal");
  write("proc/self/status", "VmRSS:\t lots\n");
  write("proc/self/stat", "42 (nadird");
  write("proc/loadavg", "");
  const auto values = by_name(health_.measure(10));
  EXPECT_EQ(values.size(), 1U);
  EXPECT_TRUE(values.contains("memory_available_mb"));
}

TEST(MachineHealth, ThisMachineHasMemoryAndUsesIt) {
  MachineHealth health;
  const auto values = by_name(health.measure(1));
  EXPECT_GT(values.at("memory_mb"), 1);
  EXPECT_GT(values.at("memory_available_mb"), 1);
}

}  // namespace
}  // namespace nadir
