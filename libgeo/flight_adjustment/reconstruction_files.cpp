#include "flight_adjustment/reconstruction_files.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <iterator>

#include "base/error.hpp"

namespace nadir {
namespace {

// Names with spaces or line ends would be read as other columns.
bool plain(const std::string& name) {
  return !name.empty() && name.find_first_of(" \t\r\n") == std::string::npos && name.front() != '#';
}

void put(std::string& out, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) out.push_back(static_cast<char>((value >> (8 * i)) & 0xFFU));
}

// What a file's local header and its entry in the directory share.
void put_entry(std::string& out, const std::string& name, const std::string& content) {
  constexpr std::uint32_t kVersion = 20, kUtf8 = 0x800, kStored = 0, kNoTime = 0, k1980 = 0x21;
  put(out, kVersion, 2);
  put(out, kUtf8, 2);
  put(out, kStored, 2);
  put(out, kNoTime, 2);
  put(out, k1980, 2);
  put(out, static_cast<std::uint32_t>(crc32_z(0, reinterpret_cast<const Bytef*>(content.data()), content.size())), 4);
  put(out, static_cast<std::uint32_t>(content.size()), 4);
  put(out, static_cast<std::uint32_t>(content.size()), 4);
  put(out, static_cast<std::uint32_t>(name.size()), 2);
  put(out, 0, 2);
}

}  // namespace

std::map<std::string, std::string> reconstruction_files(const AdjustedFlight& adjusted, const CameraModel& full) {
  const CameraModel& camera = adjusted.summary.calibration.camera;  // of the adjusted pixels
  const double scale = static_cast<double>(full.width) / camera.width;
  const auto& k = camera.distortion;
  const auto pixel = [scale](double at) { return (at + 0.5) * scale; };
  std::string cameras =
      fmt::format("1 FULL_OPENCV {} {} {:.4f} {:.4f} {:.4f} {:.4f} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g} 0 0 0\n",
                  full.width, full.height, camera.fx * scale, camera.fy * scale, pixel(camera.cx), pixel(camera.cy),
                  k[0], k[1], k[2], k[3], k[4]);
  std::map<std::string, std::string> files{{"cameras.txt", std::move(cameras)}};
  std::string &images = files["images.txt"], &points = files["points3D.txt"], &geo = files["geo.txt"];
  geo = "EPSG:4326\n";
  const std::size_t frames = adjusted.estimates.size();
  const auto given = [&](std::size_t i) {
    return i < adjusted.block.frames.size() && adjusted.estimates[i].position && plain(adjusted.estimates[i].frame);
  };
  std::vector<std::string> seen(frames);     // of each frame: its points
  std::vector<std::size_t> next(frames, 0);  // index of its next point
  for (std::size_t j = 0; j < adjusted.ties.points.size(); ++j) {
    const AdjustedPoint& point = adjusted.block.points[j];
    if (!point.used) continue;
    std::string track;
    double error_px = 0;
    std::size_t used = 0;
    for (std::size_t o = 0; o < point.observations.size(); ++o) {
      const auto& observation = adjusted.ties.points[j][o];
      if (point.observations[o].use != ObservationUse::used || !given(observation.frame)) continue;
      track += fmt::format(" {} {}", observation.frame + 1, next[observation.frame]++);
      seen[observation.frame] +=
          fmt::format("{:.3f} {:.3f} {} ", pixel(observation.pixel.x()), pixel(observation.pixel.y()), j + 1);
      error_px += scale * point.observations[o].residual_px.norm();
      ++used;
    }
    if (used == 0) continue;
    points += fmt::format("{} {:.4f} {:.4f} {:.4f} 128 128 128 {:.4f}{}\n", j + 1, point.position_m.x(),
                          point.position_m.y(), point.position_m.z(), error_px / static_cast<double>(used), track);
  }
  for (std::size_t i = 0; i < frames; ++i) {
    if (!given(i)) continue;
    const AdjustedFrame& frame = adjusted.block.frames[i];
    const Eigen::Matrix3d camera_from_world = enu_from_camera(frame.pose.attitude).transpose();
    const Eigen::Quaterniond q(camera_from_world);
    const Eigen::Vector3d centre(frame.pose.position.east_m, frame.pose.position.north_m, frame.up_m);
    const Eigen::Vector3d t = -(camera_from_world * centre);
    const Estimate& estimate = adjusted.estimates[i];
    images += fmt::format("{} {:.12f} {:.12f} {:.12f} {:.12f} {:.6f} {:.6f} {:.6f} 1 {}\n{}\n", i + 1, q.w(), q.x(),
                          q.y(), q.z(), t.x(), t.y(), t.z(), estimate.frame, seen[i]);
    geo += fmt::format("{} {:.9f} {:.9f} {:.3f}\n", estimate.frame, estimate.position->lon_deg,
                       estimate.position->lat_deg, frame.up_m);
  }
  return files;
}

std::string zip_archive(const std::map<std::string, std::string>& files) {
  std::string archive, directory;
  for (const auto& [name, content] : files) {
    if (content.size() > UINT32_MAX / 2 || archive.size() > UINT32_MAX / 2) {
      throw Error({.what = "the archive is too large", .expected = "at most 2 GB", .found = name});
    }
    const auto offset = static_cast<std::uint32_t>(archive.size());
    put(archive, 0x04034B50U, 4);
    put_entry(archive, name, content);
    archive += name;
    archive += content;
    put(directory, 0x02014B50U, 4);
    put(directory, 20, 2);
    put_entry(directory, name, content);
    put(directory, 0, 4);  // no comment, on this disk
    put(directory, 0, 2);
    put(directory, 0, 4);
    put(directory, offset, 4);
    directory += name;
  }
  const auto begin = static_cast<std::uint32_t>(archive.size()), count = static_cast<std::uint32_t>(files.size());
  archive += directory;
  put(archive, 0x06054B50U, 4);
  put(archive, 0, 4);
  put(archive, count, 2);
  put(archive, count, 2);
  put(archive, static_cast<std::uint32_t>(directory.size()), 4);
  put(archive, begin, 4);
  put(archive, 0, 2);
  return archive;
}

}  // namespace nadir
