#include "flight_import/imported_flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "base/error.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

std::string cell(const std::optional<double>& value, int decimals) {
  return value ? fmt::format("{:.{}f}", *value, decimals) : std::string();
}

std::optional<double> in_degrees(const std::optional<double>& angle_rad) {
  return angle_rad ? std::optional(degrees(*angle_rad)) : std::nullopt;
}

}  // namespace

std::string telemetry_csv(const std::vector<ImportedFrame>& frames) {
  const bool imu = std::any_of(frames.begin(), frames.end(), [](const ImportedFrame& one) { return one.imu_dv_mps; });
  std::string csv = "frame,time_s,agl_m,heading_deg,pitch_deg,roll_deg";
  const bool turn = std::any_of(frames.begin(), frames.end(), [](const ImportedFrame& one) { return one.rate_rad_s; });
  if (imu) csv += ",imu_dv_east_mps,imu_dv_north_mps";
  csv += turn ? ",roll_rate_deg_s,pitch_rate_deg_s,yaw_rate_deg_s\n" : "\n";
  for (const ImportedFrame& frame : frames) {
    std::optional<double> heading_deg = in_degrees(frame.heading_rad);
    if (heading_deg && *heading_deg < 0) *heading_deg += 360;
    csv += fmt::format("{},{:.6f},{},{},{},{}", frame.name, frame.time_s, cell(frame.agl_m, 2), cell(heading_deg, 3),
                       cell(in_degrees(frame.pitch_rad), 3), cell(in_degrees(frame.roll_rad), 3));
    if (imu) {
      const auto& dv = frame.imu_dv_mps;
      csv += dv ? fmt::format(",{:.5f},{:.5f}", dv->x(), dv->y()) : std::string(",,");
    }
    if (turn) {
      const auto& rate = frame.rate_rad_s;
      csv += rate ? fmt::format(",{:.4f},{:.4f},{:.4f}", degrees(rate->x()), degrees(rate->y()), degrees(rate->z()))
                  : std::string(",,,");
    }
    csv += '\n';
  }
  return csv;
}

std::string truth_csv(const std::vector<ImportedFrame>& frames) {
  std::string csv = "frame,lat_deg,lon_deg,alt_m\n";
  for (const ImportedFrame& frame : frames) {
    if (!frame.place) continue;
    csv += fmt::format("{},{:.8f},{:.8f},{}\n", frame.name, frame.place->lat_deg, frame.place->lon_deg,
                       cell(frame.alt_m, 2));
  }
  return csv;
}

void write_frames(const std::vector<ImportedFrame>& frames, FrameOrigin origin, const std::filesystem::path& folder,
                  Progress& progress) {
  namespace fs = std::filesystem;
  progress.begin("writing frames", frames.size(), "frames");
  std::set<std::string> kept;
  for (const ImportedFrame& frame : frames) {
    const fs::path target = folder / frame.name;
    std::error_code error;
    switch (origin) {
      case FrameOrigin::linked: fs::create_symlink(fs::canonical(frame.file), target, error); break;
      case FrameOrigin::copied: fs::copy_file(frame.file, target, error); break;
      case FrameOrigin::unpacked: fs::rename(frame.file, target, error); break;
    }
    if (error) throw Error({.what = "cannot write a frame", .where = target.string(), .found = error.message()});
    kept.insert(frame.name);
    progress.advance();
  }
  progress.end();
  if (origin != FrameOrigin::unpacked) return;
  std::vector<fs::path> left_out;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!kept.contains(entry.path().filename().string())) left_out.push_back(entry.path());
  }
  for (const fs::path& path : left_out) fs::remove(path);
}

}  // namespace nadir
