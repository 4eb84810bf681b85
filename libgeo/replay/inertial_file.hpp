// imu.csv: samples of an inertial sensor, beside the telemetry of a recorded flight (docs/formats.md).
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "estimation/inertial_preintegration.hpp"
#include "estimation/telemetry.hpp"

namespace nadir {

class CsvTable;

inline constexpr std::string_view kInertialFile = "imu.csv";

// Throws UsageError for missing columns, cells that are no numbers, rows out of the order of time, and samples so far
// apart that none could be used.
std::vector<InertialSample> read_inertial(const std::filesystem::path& path);
std::vector<InertialSample> read_inertial(const CsvTable& table);

std::string inertial_csv(std::span<const InertialSample> samples);

// Half of the samples have a neighbour near enough to be used.
bool close_enough(std::span<const InertialSample> samples);

// Gives each frame but the first the samples since the one before. Throws UsageError when the flight has none of them:
// the two files have other clocks. `name`: of the samples' file, for messages.
void add_inertial(std::vector<Telemetry>& frames, std::span<const InertialSample> samples,
                  const std::filesystem::path& name);

}  // namespace nadir
