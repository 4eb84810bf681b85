#include "replay/poses_file.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "geodesy/angles.hpp"
#include "ortho/candidate_sidecar.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 28;  // half a million frames

void require_same(const std::filesystem::path& path, const char* of_what, const std::string& wanted,
                  const std::string& found) {
  if (wanted == found) return;
  throw UsageError({.what = fmt::format("these poses belong to another {}", of_what),
                    .where = path.string(),
                    .expected = wanted,
                    .found = found,
                    .fix = "give the poses.json that nadir replay wrote for this flight, or omit --estimates"});
}

std::string text_of(LonLat place) { return fmt::format("{}, {}", place.lon_deg, place.lat_deg); }

}  // namespace

PosesDocument poses_document(const PosesSubject& subject, const std::vector<Telemetry>& frames,
                             const std::vector<std::optional<FramePose>>& poses,
                             const std::optional<AdjustedLens>& lens) {
  PosesDocument document{subject, lens, {}};
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (poses[i]) document.poses.push_back({i, frame_label(frames[i].frame), *poses[i]});
  }
  return document;
}

std::string poses_json(const PosesDocument& document) {
  const PosesSubject& of = document.subject;
  json poses = json::array();
  for (const auto& [index, frame, estimate] : document.poses) {
    const CameraPose& pose = estimate.pose;
    poses.push_back(
        {{"index", index},
         {"frame", frame},
         {"east_m", pose.position.east_m},
         {"north_m", pose.position.north_m},
         {"agl_m", pose.agl_m},
         {"heading_rad", pose.attitude.heading_rad},
         {"pitch_rad", pose.attitude.pitch_rad},
         {"roll_rad", pose.attitude.roll_rad},
         {"cov_ee_m2", estimate.covariance_m2(0, 0)},
         {"cov_en_m2", estimate.covariance_m2(0, 1)},
         {"cov_nn_m2", estimate.covariance_m2(1, 1)},
         {"confirmed", estimate.confirmed},
         {"velocity_mps", {estimate.motion.velocity_mps.x(), estimate.motion.velocity_mps.y()}},
         {"rate_rad_s",
          {estimate.motion.rate_rad_s.x(), estimate.motion.rate_rad_s.y(), estimate.motion.rate_rad_s.z()}}});
  }
  json lens;
  if (document.lens) lens = {{"log_focal", document.lens->log_focal}, {"distortion", document.lens->distortion}};
  const json whole{{"schema", kPosesSchema},
                   {"flight", of.flight},
                   {"frames", of.frames},
                   {"base_package", of.base_package.hex()},
                   {"camera", of.camera.hex()},
                   {"lens", std::move(lens)},
                   {"origin", {{"lon_deg", of.origin.lon_deg}, {"lat_deg", of.origin.lat_deg}}},
                   {"poses", std::move(poses)}};
  return whole.dump(1) + "\n";
}

FlightPoses read_poses(const std::filesystem::path& path, const PosesSubject& wanted,
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
  return {std::move(poses), document.lens};
}

namespace {

constexpr double kMaxEast_m = 1e6;  // and north, from the plane's origin
constexpr double kMaxAgl_m = 1e5;
constexpr double kMaxSpeed_mps = 1e4, kMaxRate_rad_s = 100;
constexpr double kMaxVariance_m2 = 1e9;  // (31 km)²
constexpr double kMaxHeading_rad = 1e4;  // headings are not wrapped
constexpr std::int64_t kMaxFrames = 1'000'000'000;

std::string read_label(const JsonReader& in, const char* key) {
  const std::string& value = in.text(key);
  if (value.empty() || frame_label(value) != value) in.refuse(key, "1 to 128 of A-Z a-z 0-9 . _ -");
  return value;
}

PosesSubject read_subject(const JsonReader& in) {
  in.expect("schema", kPosesSchema);
  const JsonReader origin = in.object("origin");
  PosesSubject subject{.flight = read_label(in, "flight"),
                       .frames = in.integer<std::uint64_t>("frames", 0, kMaxFrames),
                       .base_package = in.digest("base_package"),
                       .camera = in.digest("camera"),
                       .origin = {origin.number("lon_deg", -180, 180), origin.number("lat_deg", -90, 90)}};
  origin.finish();
  return subject;
}

std::optional<AdjustedLens> read_lens(const JsonReader& in) {
  if (in.is_null("lens")) return std::nullopt;
  const JsonReader from = in.object("lens");
  AdjustedLens lens;
  lens.log_focal = from.number("log_focal", -kMostLensLogFocal, kMostLensLogFocal);
  const JsonReader distortion =
      from.array("distortion", {.least = lens.distortion.size(), .most = lens.distortion.size()});
  for (std::size_t i = 0; i < lens.distortion.size(); ++i) {
    lens.distortion.at(i) = distortion.number(i, -kMostLensDistortion, kMostLensDistortion);
  }
  from.finish();
  return lens;
}

FramePose read_pose(const JsonReader& in) {
  FramePose result;
  result.pose.position = {in.number("east_m", -kMaxEast_m, kMaxEast_m), in.number("north_m", -kMaxEast_m, kMaxEast_m)};
  result.pose.agl_m = in.number("agl_m", 0.001, kMaxAgl_m);
  result.pose.attitude = {in.number("heading_rad", -kMaxHeading_rad, kMaxHeading_rad),
                          in.number("pitch_rad", -kPi, kPi), in.number("roll_rad", -2 * kPi, 2 * kPi)};
  const double ee_m2 = in.number("cov_ee_m2", 0, kMaxVariance_m2), nn_m2 = in.number("cov_nn_m2", 0, kMaxVariance_m2);
  const double en_m2 = in.number("cov_en_m2", -kMaxVariance_m2, kMaxVariance_m2);
  if (std::abs(en_m2) > std::sqrt(ee_m2) * std::sqrt(nn_m2) * (1 + 1e-9)) {
    in.refuse("cov_en_m2", "a covariance: at most what the variances allow");
  }
  result.covariance_m2 << ee_m2, en_m2, en_m2, nn_m2;
  result.sigma_m = std::sqrt(0.5 * result.covariance_m2.trace());
  result.source = SourceLabel::satellite_anchored;
  result.confirmed = in.boolean("confirmed");
  const JsonReader velocity = in.array("velocity_mps", {.least = 2, .most = 2});
  const JsonReader rate = in.array("rate_rad_s", {.least = 3, .most = 3});
  for (int i = 0; i < 2; ++i) {
    result.motion.velocity_mps[i] = velocity.number(static_cast<std::size_t>(i), -kMaxSpeed_mps, kMaxSpeed_mps);
  }
  for (int i = 0; i < 3; ++i) {
    result.motion.rate_rad_s[i] = rate.number(static_cast<std::size_t>(i), -kMaxRate_rad_s, kMaxRate_rad_s);
  }
  velocity.finish();
  rate.finish();
  result.refined = true;
  return result;
}

}  // namespace

PosesDocument parse_poses(std::string_view bytes, std::string_view name) {
  const json whole = parse_json(bytes, name, {.max_depth = 5, .allow_floats = true});
  const JsonReader in(whole, {.name = std::string(name),
                              .what = "cannot accept these poses",
                              .fix = "create the file again with nadir replay"});
  PosesDocument document{read_subject(in), read_lens(in), {}};
  const JsonReader poses = in.array("poses");
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const JsonReader one = poses.object(i);
    const auto index = one.integer<std::uint64_t>("index", 0, kMaxFrames);
    if (index >= document.subject.frames) one.refuse("index", "less than the number of frames");
    if (!document.poses.empty() && index <= document.poses.back().index) {
      one.refuse("index", "more than the index of the previous pose");
    }
    document.poses.push_back({index, read_label(one, "frame"), read_pose(one)});
    one.finish();
  }
  in.finish();
  return document;
}

}  // namespace nadir
