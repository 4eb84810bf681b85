// Memory, CPU and temperature of the computer that we fly on, for the recorder: read from /proc and /sys, which a test
// replaces by folders of its own. What a system does not have is left out.
//
//   memory_mb            resident memory of this process (VmRSS)
//   memory_available_mb  what the system could still give (MemAvailable)
//   cpu_percent          CPU time of this process since the last call, of one core; missing in the first
//   load_1min            runnable processes, averaged over a minute
//   temperature_c        the hottest thermal zone
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace nadir {

using NamedValues = std::vector<std::pair<std::string, double>>;

class MachineHealth {
 public:
  explicit MachineHealth(std::filesystem::path proc = "/proc", std::filesystem::path thermal = "/sys/class/thermal");

  // now_s: monotonic. A sensor may take milliseconds: not for a thread that flies.
  NamedValues measure(double now_s);

 private:
  std::filesystem::path proc_, thermal_;
  double ticks_per_s_;
  std::optional<std::pair<double, double>> last_;  // time and CPU time, s
};

}  // namespace nadir
