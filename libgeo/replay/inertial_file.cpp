#include "replay/inertial_file.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <optional>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/quantile.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

constexpr std::array<const char*, 7> kColumns = {"time_s",       "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s",
                                                 "accel_x_mps2", "accel_y_mps2", "accel_z_mps2"};

// Nothing for fewer than two samples.
std::optional<double> median_step_s(std::span<const InertialSample> samples) {
  std::vector<double> steps_s;
  for (std::size_t i = 1; i < samples.size(); ++i) steps_s.push_back(samples[i].time_s - samples[i - 1].time_s);
  if (steps_s.empty()) return std::nullopt;
  return median(std::move(steps_s));
}

void check_rate(const CsvTable& table, const std::vector<InertialSample>& samples) {
  const auto step_s = median_step_s(samples);
  if (!step_s) {
    throw UsageError({.what = "there are no inertial samples",
                      .where = table.path().string(),
                      .expected = "a row for each of at least two samples",
                      .fix = "remove the file if the flight has none"});
  }
  if (close_enough(samples)) return;
  throw UsageError({.what = "the inertial samples are too far apart",
                    .where = table.path().string(),
                    .expected = fmt::format("100 a second, {:.0f} at least", 1 / parameters::inertial::kMaxGap_s),
                    .found = fmt::format("one each {:.3f} s", *step_s),
                    .fix = "log the inertial sensor faster, or remove the file"});
}

}  // namespace

std::vector<InertialSample> read_inertial(const std::filesystem::path& path) {
  return read_inertial(CsvTable::read(path));
}

std::vector<InertialSample> read_inertial(const CsvTable& table) {
  std::array<std::size_t, kColumns.size()> columns{};
  for (std::size_t i = 0; i < columns.size(); ++i) columns[i] = table.required_column(kColumns[i]);
  std::vector<InertialSample> samples;
  samples.reserve(table.rows());
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const auto number = [&](std::size_t column) { return table.required_number(row, columns[column]); };
    const InertialSample sample{number(0), {number(1), number(2), number(3)}, {number(4), number(5), number(6)}};
    if (!samples.empty() && sample.time_s <= samples.back().time_s) {
      throw UsageError({.what = "the inertial samples are not in the order of time",
                        .where = fmt::format("{}:{}", table.path().string(), table.line_of(row)),
                        .expected = fmt::format("time_s later than the row before ({:.6f})", samples.back().time_s),
                        .found = fmt::format("{:.6f}", sample.time_s),
                        .fix = "sort the rows by time_s and remove repeated ones"});
    }
    samples.push_back(sample);
  }
  check_rate(table, samples);
  return samples;
}

std::string inertial_csv(std::span<const InertialSample> samples) {
  std::string csv = fmt::format("{}\n", fmt::join(kColumns, ","));
  for (const InertialSample& sample : samples) {
    const auto &rate = sample.rate_rad_s, &force = sample.force_mps2;
    csv += fmt::format("{:.6f},{:.7f},{:.7f},{:.7f},{:.6f},{:.6f},{:.6f}\n", sample.time_s, rate.x(), rate.y(),
                       rate.z(), force.x(), force.y(), force.z());
  }
  return csv;
}

bool close_enough(std::span<const InertialSample> samples) {
  const auto step_s = median_step_s(samples);
  return step_s && *step_s <= parameters::inertial::kMaxGap_s;
}

void add_inertial(std::vector<Telemetry>& frames, std::span<const InertialSample> samples,
                  const std::filesystem::path& name) {
  bool any = false;
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const auto from = std::ranges::upper_bound(samples, frames[i - 1].time_s, {}, &InertialSample::time_s);
    const auto to = std::ranges::upper_bound(samples, frames[i].time_s, {}, &InertialSample::time_s);
    frames[i].inertial.assign(from, to);
    any = any || from != to;
  }
  if (any || frames.size() < 2) return;
  throw UsageError({.what = "no inertial sample is of the time of the flight",
                    .where = name.string(),
                    .expected = fmt::format("time_s between {:.3f} and {:.3f}, as of the frames", frames.front().time_s,
                                            frames.back().time_s),
                    .found = samples.empty()
                                 ? "no samples"
                                 : fmt::format("{:.3f} to {:.3f}", samples.front().time_s, samples.back().time_s),
                    .fix = "count both from one clock, or remove the file"});
}

}  // namespace nadir
