#include "replay/flight_folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "imagery/frame_image.hpp"
#include "replay/inertial_file.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

std::set<std::string> images_in(const fs::path& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    throw UsageError({.what = "the folder of frames cannot be read",
                      .where = folder.string(),
                      .expected = "a folder with images",
                      .found = fs::exists(folder, error) ? "no folder" : "nothing"});
  }
  std::set<std::string> names;
  std::optional<fs::path> heic;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    if (has_frame_extension(entry.path())) names.insert(entry.path().filename().string());
    if (has_heic_extension(entry.path())) heic = entry.path();
  }
  if (names.empty()) {
    if (heic) reject_heic(heic->string());
    throw UsageError({.what = "the folder of frames has no images",
                      .where = folder.string(),
                      .expected = "files ending in .jpg, .jpeg, .png, .tif or .tiff"});
  }
  return names;
}

void check_size(const fs::path& path, const CameraModel& camera, const fs::path& camera_path) {
  const FrameSize size = read_frame_size(path);
  if (size.width == camera.width && size.height == camera.height) return;
  throw UsageError(
      {.what = "the image does not come from this camera",
       .where = path.string(),
       .expected = fmt::format("{}×{} pixels as {} says", camera.width, camera.height, camera_path.string()),
       .found = fmt::format("{}×{} pixels", size.width, size.height),
       .fix = "give the camera file of these images; scale width, height, fx, fy, cx and cy if they were resampled"});
}

}  // namespace

Flight read_flight(const FlightPaths& paths) {
  Flight flight;
  flight.frames_folder = paths.frames;
  flight.camera = read_camera_file(paths.camera);
  flight.frames = read_telemetry(paths.telemetry);
  const fs::path inertial = paths.telemetry.parent_path() / kInertialFile;
  if (std::error_code error; fs::exists(inertial, error)) {
    add_inertial(flight.frames, read_inertial(inertial), inertial);
  }
  const std::set<std::string> images = images_in(paths.frames);
  for (const Telemetry& row : flight.frames) {
    if (!images.contains(row.frame)) {
      if (has_heic_extension(row.frame)) reject_heic((paths.frames / row.frame).string());
      throw UsageError({.what = fmt::format("the telemetry names a frame that is missing: {}", row.frame),
                        .where = paths.telemetry.string(),
                        .expected = fmt::format("an image of that name in {}", paths.frames.string()),
                        .fix = "remove the row, or give the folder that belongs to this telemetry"});
    }
    check_size(paths.frames / row.frame, flight.camera.camera, paths.camera);
  }
  flight.images_without_row = images.size() - flight.frames.size();
  return flight;
}

cv::Mat read_grey_image(const std::filesystem::path& path, int shrink) {
  try {
    return read_frame_file(path, Colour::grey, shrink);
  } catch (const Error&) {
    return {};
  }
}

cv::Mat read_flight_image(const std::filesystem::path& path, const CameraModel& camera, int shrink) {
  try {
    return decode_camera_frame(read_file(path), camera, shrink);
  } catch (const Error&) {
    return {};
  }
}

namespace {

struct Columns {
  std::size_t frame, time, agl;
  std::optional<std::size_t> heading, pitch, roll, imu_east, imu_north, lat, lon;
  std::array<std::optional<std::size_t>, 3> rates;
};

Columns find_columns(const CsvTable& table) {
  Columns columns{};
  columns.frame = table.required_column("frame");
  columns.time = table.required_column("time_s");
  columns.agl = table.required_column("agl_m");
  columns.heading = table.required_column("heading_deg");
  columns.pitch = table.required_column("pitch_deg");
  columns.roll = table.required_column("roll_deg");
  columns.imu_east = table.column("imu_dv_east_mps");
  columns.imu_north = table.column("imu_dv_north_mps");
  if (columns.imu_east.has_value() != columns.imu_north.has_value()) {
    throw UsageError({.what = "the telemetry has only one component of the velocity change",
                      .where = table.path().string(),
                      .expected = "both imu_dv_east_mps and imu_dv_north_mps, or none",
                      .found = columns.imu_east ? "only imu_dv_east_mps" : "only imu_dv_north_mps"});
  }
  columns.rates = {table.column("roll_rate_deg_s"), table.column("pitch_rate_deg_s"), table.column("yaw_rate_deg_s")};
  columns.lat = table.column("lat_deg");
  columns.lon = table.column("lon_deg");
  return columns;
}

std::string place_of(const CsvTable& table, std::size_t row) {
  return fmt::format("{}:{}", table.path().string(), table.line_of(row));
}

std::optional<double> number_within(const CsvTable& table, std::size_t row, std::optional<std::size_t> column,
                                    double low, double high) {
  if (!column) return std::nullopt;
  const auto value = table.number(row, *column);
  if (value && (*value < low || *value > high)) {
    throw UsageError({.what = fmt::format("{} is out of range", table.header()[*column]),
                      .where = place_of(table, row),
                      .expected = fmt::format("{} to {}, or an empty cell for unknown", low, high),
                      .found = table.cell(row, *column)});
  }
  return value;
}

std::optional<double> angle_rad(const CsvTable& table, std::size_t row, std::optional<std::size_t> column,
                                double limit_deg) {
  const auto value = number_within(table, row, column, -limit_deg, limit_deg);
  return value ? std::optional(radians(*value)) : std::nullopt;
}

void check_frame_name(const CsvTable& table, std::size_t row, const std::string& name) {
  const bool plain = !name.empty() && name.find('/') == std::string::npos && name != "." && name != "..";
  if (plain) return;
  throw UsageError({.what = "a frame has an invalid name",
                    .where = place_of(table, row),
                    .expected = "the name of a file in the folder of frames",
                    .found = fmt::format("\"{}\"", name)});
}

}  // namespace

std::vector<Telemetry> read_telemetry(const std::filesystem::path& path) {
  return read_telemetry(CsvTable::read(path));
}

std::vector<Telemetry> read_telemetry(const CsvTable& table) {
  const Columns columns = find_columns(table);
  std::vector<Telemetry> rows;
  std::unordered_map<std::string, std::size_t> line_of_frame;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Telemetry telemetry;
    telemetry.frame = table.cell(row, columns.frame);
    check_frame_name(table, row, telemetry.frame);
    telemetry.time_s = table.required_number(row, columns.time);
    telemetry.agl_m = number_within(table, row, columns.agl, 1, 20000);
    telemetry.heading_rad = angle_rad(table, row, columns.heading, 360);
    telemetry.pitch_rad = angle_rad(table, row, columns.pitch, 90);
    telemetry.roll_rad = angle_rad(table, row, columns.roll, 180);
    const auto imu_east = number_within(table, row, columns.imu_east, -200, 200);
    const auto imu_north = number_within(table, row, columns.imu_north, -200, 200);
    if (imu_east && imu_north) telemetry.imu_dv_mps = {*imu_east, *imu_north};
    const auto rolling = angle_rad(table, row, columns.rates[0], 2000);
    const auto pitching = angle_rad(table, row, columns.rates[1], 2000);
    const auto yawing = angle_rad(table, row, columns.rates[2], 2000);
    if (rolling && pitching && yawing) telemetry.rate_rad_s = {*rolling, *pitching, *yawing};
    const auto lat = number_within(table, row, columns.lat, -90, 90);
    const auto lon = number_within(table, row, columns.lon, -180, 180);
    if (lat && lon) telemetry.gps_position = LonLat{*lon, *lat};

    const auto [other, fresh] = line_of_frame.emplace(telemetry.frame, table.line_of(row));
    if (!fresh) {
      throw UsageError({.what = fmt::format("frame {} has two rows", telemetry.frame),
                        .where = place_of(table, row),
                        .expected = "one row per frame",
                        .found = fmt::format("another in line {}", other->second),
                        .fix = "remove the wrong row"});
    }
    if (!rows.empty() && telemetry.time_s <= rows.back().time_s) {
      throw UsageError({.what = "the rows are not in the order of time",
                        .where = place_of(table, row),
                        .expected = fmt::format("time_s later than the row before ({:.3f})", rows.back().time_s),
                        .found = fmt::format("{:.3f}", telemetry.time_s),
                        .fix = "sort the rows by time_s; if two share one time, the clock or the log is wrong"});
    }
    rows.push_back(std::move(telemetry));
  }
  if (rows.empty()) {
    throw UsageError(
        {.what = "the telemetry has no rows", .where = table.path().string(), .expected = "one row per frame"});
  }
  return rows;
}

}  // namespace nadir
