// The circumstances of a measurement: its spread and the load of the machine.
#pragma once

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string>
#include <vector>

namespace nadir {

// "load 4.1, peak memory 123 MB": printed beside the figures, because CPU time grows with other load on the caches.
inline std::string circumstances() {
  std::array<double, 1> load{};
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  if (getloadavg(load.data(), 1) != 1) load[0] = 0;
  return fmt::format("load {:.1f}, peak memory {:.0f} MB", load[0], static_cast<double>(usage.ru_maxrss) * 1024 / 1e6);
}

struct Spread {
  double mean = 0, p50 = 0, p95 = 0, largest = 0;
};
inline Spread spread_of(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  double sum = 0;
  for (const double value : values) sum += value;
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  return {sum / static_cast<double>(values.size()), at(0.5), at(0.95), values.back()};
}

}  // namespace nadir
