#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/json.hpp"
#include "base/json_members.hpp"
#include "geodesy/angles.hpp"
#include "ortho/candidate_sidecar.hpp"
#include "replay/poses_file.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr double kFarthest_m = 1e6;  // from the plane's origin
constexpr double kHighest_m = 1e5;
constexpr double kWidest_m2 = 1e9;      // (31 km)²
constexpr double kMostTurns_rad = 1e4;  // a heading is not wound back
constexpr std::int64_t kMostFrames = 1'000'000'000;
constexpr std::size_t kMembers = 7, kPoseMembers = 12;

constexpr JsonMembers::Complaint kComplaint{"cannot accept these poses", "let nadir replay write the file again"};

std::uint64_t count(const JsonMembers& in, const char* key) {
  return static_cast<std::uint64_t>(in.whole(key, 0, kMostFrames));
}

std::string label(const JsonMembers& in, const char* key) {
  const std::string& value = in.text(key);
  if (value.empty() || frame_label(value) != value) in.refuse(key, "1 to 128 of A-Z a-z 0-9 . _ -", value);
  return value;
}

PosesSubject read_subject(const JsonMembers& in) {
  if (in.text("schema") != kPosesSchema) in.refuse("schema", std::string(kPosesSchema), in.text("schema"));
  const JsonMembers origin = in.object("origin", 2);
  return {.flight = label(in, "flight"),
          .frames = count(in, "frames"),
          .base_package = in.digest("base_package"),
          .camera = in.digest("camera"),
          .origin = {origin.number("lon_deg", -180, 180), origin.number("lat_deg", -90, 90)}};
}

FramePose read_pose(const JsonMembers& in) {
  FramePose said;
  said.pose.position = {in.number("east_m", -kFarthest_m, kFarthest_m),
                        in.number("north_m", -kFarthest_m, kFarthest_m)};
  said.pose.agl_m = in.number("agl_m", 0.001, kHighest_m);
  said.pose.attitude = {in.number("heading_rad", -kMostTurns_rad, kMostTurns_rad), in.number("pitch_rad", -kPi, kPi),
                        in.number("roll_rad", -2 * kPi, 2 * kPi)};
  const double ee_m2 = in.number("cov_ee_m2", 0, kWidest_m2), nn_m2 = in.number("cov_nn_m2", 0, kWidest_m2);
  const double en_m2 = in.number("cov_en_m2", -kWidest_m2, kWidest_m2);
  if (std::abs(en_m2) > std::sqrt(ee_m2) * std::sqrt(nn_m2) * (1 + 1e-9)) {
    in.refuse("cov_en_m2", "a covariance: at most what the variances allow", en_m2);
  }
  said.covariance_m2 << ee_m2, en_m2, en_m2, nn_m2;
  said.sigma_m = std::sqrt(0.5 * said.covariance_m2.trace());
  said.source = SourceLabel::satellite_anchored;
  said.confirmed = in.yes_or_no("confirmed");
  said.refined = true;
  return said;
}

}  // namespace

PosesDocument parse_poses(std::string_view bytes, std::string_view name) {
  const json whole = parse_json(bytes, name, {.max_depth = 4, .allow_floats = true});
  const JsonMembers in(whole, std::string(name), kMembers, kComplaint);
  PosesDocument document{read_subject(in), {}};
  const json& poses = in.member("poses");
  if (!poses.is_array()) in.refuse("poses", "a list", poses);
  for (const json& object : poses) {
    const JsonMembers one(object, fmt::format("{}: poses/{}", name, document.poses.size()), kPoseMembers, kComplaint);
    const std::uint64_t index = count(one, "index");
    if (index >= document.subject.frames) one.refuse("index", "less than the number of frames", index);
    if (!document.poses.empty() && index <= document.poses.back().index) {
      one.refuse("index", "more than that of the pose before", index);
    }
    document.poses.push_back({index, label(one, "frame"), read_pose(one)});
  }
  return document;
}

}  // namespace nadir
