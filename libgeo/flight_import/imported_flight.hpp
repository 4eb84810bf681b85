// An imported flight on its way into a folder: frames with their telemetry, and the files that are made of them
// (docs/formats.md).
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

inline constexpr double kMinFrameStep_s = 1e-3;  // between the times of two frames

struct ImportedFrame {
  std::filesystem::path file;  // the image
  std::string name;            // of the frame: a plain file name that no other frame has
  double time_s = 0;
  std::optional<double> agl_m, heading_rad, pitch_rad, roll_rad;  // as in Telemetry
  std::optional<Eigen::Vector2d> imu_dv_mps;
  std::optional<Eigen::Vector3d> rate_rad_s{};  // as in Telemetry
  std::optional<LonLat> place;                  // truth, when it was asked for
  std::optional<double> alt_m;
};

std::string telemetry_csv(const std::vector<ImportedFrame>& frames);
std::string truth_csv(const std::vector<ImportedFrame>& frames);  // of the frames that have a place

enum class FrameOrigin {
  linked,    // symbolic links to files that stay where they are
  copied,    // copies of them
  unpacked,  // the files lie in the folder already, perhaps under other names and with others
};

// The frames under their names in the folder, and nothing else in it.
void write_frames(const std::vector<ImportedFrame>& frames, FrameOrigin origin, const std::filesystem::path& folder,
                  Progress& progress);

}  // namespace nadir
