#include "replay/poses_file.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "ortho/candidate_sidecar.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 28;  // half a million frames

void require_same(const std::filesystem::path& path, const char* of_what, const std::string& wanted,
                  const std::string& found) {
  if (wanted == found) return;
  throw UsageError({.what = fmt::format("these poses are of another {}", of_what),
                    .where = path.string(),
                    .expected = wanted,
                    .found = found,
                    .fix = "give the poses.json that nadir replay made of this flight, or leave --estimates out"});
}

std::string text_of(LonLat place) { return fmt::format("{}, {}", place.lon_deg, place.lat_deg); }

}  // namespace

PosesDocument poses_document(const PosesSubject& subject, const std::vector<Telemetry>& frames,
                             const std::vector<std::optional<FramePose>>& poses) {
  PosesDocument document{subject, {}};
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (poses[i]) document.poses.push_back({i, frame_label(frames[i].frame), *poses[i]});
  }
  return document;
}

std::string poses_json(const PosesDocument& document) {
  const PosesSubject& of = document.subject;
  json poses = json::array();
  for (const auto& [index, frame, said] : document.poses) {
    const CameraPose& pose = said.pose;
    poses.push_back({{"index", index},
                     {"frame", frame},
                     {"east_m", pose.position.east_m},
                     {"north_m", pose.position.north_m},
                     {"agl_m", pose.agl_m},
                     {"heading_rad", pose.attitude.heading_rad},
                     {"pitch_rad", pose.attitude.pitch_rad},
                     {"roll_rad", pose.attitude.roll_rad},
                     {"cov_ee_m2", said.covariance_m2(0, 0)},
                     {"cov_en_m2", said.covariance_m2(0, 1)},
                     {"cov_nn_m2", said.covariance_m2(1, 1)},
                     {"confirmed", said.confirmed}});
  }
  const json whole{
      {"schema", kPosesSchema},    {"flight", of.flight},
      {"frames", of.frames},       {"base_package", of.base_package.hex()},
      {"camera", of.camera.hex()}, {"origin", {{"lon_deg", of.origin.lon_deg}, {"lat_deg", of.origin.lat_deg}}},
      {"poses", std::move(poses)}};
  return whole.dump(1) + "\n";
}

std::vector<std::optional<FramePose>> read_poses(const std::filesystem::path& path, const PosesSubject& wanted,
                                                 const std::vector<Telemetry>& frames) {
  const PosesDocument document = parse_poses(read_text_file(path, kMostBytes), path.string());
  const PosesSubject& of = document.subject;
  require_same(path, "flight", wanted.flight, of.flight);
  require_same(path, "flight (number of frames)", std::to_string(wanted.frames), std::to_string(of.frames));
  require_same(path, "map (SHA-256 of manifest.json)", wanted.base_package.hex(), of.base_package.hex());
  require_same(path, "camera (its digest)", wanted.camera.hex(), of.camera.hex());
  require_same(path, "plane (longitude, latitude of its origin)", text_of(wanted.origin), text_of(of.origin));
  std::vector<std::optional<FramePose>> poses(frames.size());
  for (const NumberedPose& one : document.poses) {
    require_same(path, "flight (name of a frame)", frame_label(frames[one.index].frame), one.frame);
    poses[one.index] = one.pose;
  }
  return poses;
}

}  // namespace nadir
