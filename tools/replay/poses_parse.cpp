#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
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
constexpr std::uint64_t kMostFrames = 1'000'000'000;
constexpr std::size_t kMembers = 7, kPoseMembers = 12;

class PoseMembers {
 public:
  PoseMembers(const json& object, std::string where, std::size_t members) : object_(object), where_(std::move(where)) {
    if (!object.is_object()) refuse("", "an object", object);
    if (object.size() != members) refuse("", fmt::format("exactly {} members", members), object.size());
  }

  [[noreturn]] void refuse(std::string_view member, std::string expected, const json& found) const {
    throw Error({.what = "cannot accept these poses",
                 .where = fmt::format("{}{}{}", where_, member.empty() ? "" : ": ", member),
                 .expected = std::move(expected),
                 .found = found.dump(-1, ' ', true, json::error_handler_t::replace).substr(0, 80),
                 .fix = "let nadir replay write the file again"});
  }

  const json& member(const char* key) const {
    const auto found = object_.find(key);
    if (found == object_.end()) refuse(key, "this member", nullptr);
    return *found;
  }
  const std::string& text(const char* key) const {
    const json& value = member(key);
    if (!value.is_string()) refuse(key, "text", value);
    return value.get_ref<const std::string&>();
  }
  double number(const char* key, double least, double most) const {
    const json& value = member(key);
    const bool fits = value.is_number() && value.get<double>() >= least && value.get<double>() <= most;
    if (!fits) refuse(key, fmt::format("a number from {} to {}", least, most), value);
    return value.get<double>();
  }
  std::uint64_t count(const char* key, std::uint64_t most) const {
    const json& value = member(key);
    const bool fits = value.is_number_unsigned() && value.get<std::uint64_t>() <= most;
    if (!fits) refuse(key, fmt::format("a whole number from 0 to {}", most), value);
    return value.get<std::uint64_t>();
  }
  bool yes_or_no(const char* key) const {
    const json& value = member(key);
    if (!value.is_boolean()) refuse(key, "true or false", value);
    return value.get<bool>();
  }
  Sha256 digest(const char* key) const {
    const auto value = Sha256::from_hex(text(key));
    if (!value) refuse(key, "64 lower-case hexadecimal digits", text(key));
    return *value;
  }
  std::string label(const char* key) const {
    const std::string& value = text(key);
    if (value.empty() || frame_label(value) != value) refuse(key, "1 to 128 of A-Z a-z 0-9 . _ -", value);
    return value;
  }

 private:
  const json& object_;
  std::string where_;
};

PosesSubject read_subject(const PoseMembers& in, std::string_view name) {
  if (in.text("schema") != kPosesSchema) in.refuse("schema", std::string(kPosesSchema), in.text("schema"));
  const PoseMembers origin(in.member("origin"), fmt::format("{}: origin", name), 2);
  return {.flight = in.label("flight"),
          .frames = in.count("frames", kMostFrames),
          .base_package = in.digest("base_package"),
          .camera = in.digest("camera"),
          .origin = {origin.number("lon_deg", -180, 180), origin.number("lat_deg", -90, 90)}};
}

FramePose read_pose(const PoseMembers& in) {
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
  const PoseMembers in(whole, std::string(name), kMembers);
  PosesDocument document{read_subject(in, name), {}};
  const json& poses = in.member("poses");
  if (!poses.is_array()) in.refuse("poses", "a list", poses);
  for (const json& object : poses) {
    const PoseMembers one(object, fmt::format("{}: poses/{}", name, document.poses.size()), kPoseMembers);
    const std::uint64_t index = one.count("index", kMostFrames);
    if (index >= document.subject.frames) one.refuse("index", "less than the number of frames", index);
    if (!document.poses.empty() && index <= document.poses.back().index) {
      one.refuse("index", "more than that of the pose before", index);
    }
    document.poses.push_back({index, one.label("frame"), read_pose(one)});
  }
  return document;
}

}  // namespace nadir
