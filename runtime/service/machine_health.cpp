#include "service/machine_health.hpp"

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <sstream>

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr double kKibPerMb = 1e6 / 1024;

// Files of /proc have no size. Empty when there is none.
std::string short_file(const fs::path& path) {
  std::ifstream file(path);
  std::string text(16'384, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(std::max<std::streamsize>(0, file.gcount())));
  return text;
}

std::optional<double> number_at(std::string_view text) {
  text.remove_prefix(std::min(text.find_first_not_of(" \t"), text.size()));
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc{} ? std::optional(value) : std::nullopt;
}

// "VmRSS:    1234 kB" in a file of such lines.
std::optional<double> kib_of(const std::string& text, std::string_view name) {
  const std::string label = std::string(name) + ":";
  const std::size_t at = text.starts_with(label) ? 0 : text.find("\n" + label);
  if (at == std::string::npos) return std::nullopt;
  return number_at(std::string_view(text).substr(text.find(':', at) + 1));
}

// utime and stime, the 14th and 15th field of /proc/self/stat; the second, a name in parentheses, may hold anything.
std::optional<double> cpu_ticks(const std::string& stat) {
  const std::size_t end = stat.rfind(')');
  if (end == std::string::npos) return std::nullopt;
  std::istringstream fields(stat.substr(end + 1));
  std::string skipped;
  for (int field = 3; field < 14; ++field) fields >> skipped;
  double user = 0, system = 0;
  fields >> user >> system;
  return fields ? std::optional(user + system) : std::nullopt;
}

}  // namespace

MachineHealth::MachineHealth(fs::path proc, fs::path thermal)
    : proc_(std::move(proc)), thermal_(std::move(thermal)), ticks_per_s_(static_cast<double>(::sysconf(_SC_CLK_TCK))) {}

NamedValues MachineHealth::measure(double now_s) {
  NamedValues values;
  if (const auto resident = kib_of(short_file(proc_ / "self" / "status"), "VmRSS")) {
    values.emplace_back("memory_mb", *resident / kKibPerMb);
  }
  if (const auto available = kib_of(short_file(proc_ / "meminfo"), "MemAvailable")) {
    values.emplace_back("memory_available_mb", *available / kKibPerMb);
  }
  if (const auto ticks = cpu_ticks(short_file(proc_ / "self" / "stat"))) {
    const double cpu_s = *ticks / ticks_per_s_;
    if (last_ && now_s > last_->first) {
      values.emplace_back("cpu_percent", 100 * (cpu_s - last_->second) / (now_s - last_->first));
    }
    last_ = {now_s, cpu_s};
  }
  if (const auto load = number_at(short_file(proc_ / "loadavg"))) values.emplace_back("load_1min", *load);
  std::optional<double> hottest_c;
  std::error_code error;
  for (fs::directory_iterator zone(thermal_, error), end; !error && zone != end; zone.increment(error)) {
    if (!zone->path().filename().string().starts_with("thermal_zone")) continue;
    const auto millidegrees = number_at(short_file(zone->path() / "temp"));
    if (millidegrees) hottest_c = std::max(hottest_c.value_or(*millidegrees / 1000), *millidegrees / 1000);
  }
  if (hottest_c) values.emplace_back("temperature_c", *hottest_c);
  return values;
}

}  // namespace nadir
