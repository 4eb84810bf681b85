#include "ortho/candidate_sidecar_parse.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"
#include "base/json_members.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::int64_t kMillion = 1'000'000;
constexpr std::int64_t kMostSquare_mm2 = 1'000'000'000'000'000;  // (31 km)²
constexpr std::size_t kMaxName = 64, kMaxFrame = 128;
constexpr std::size_t kMembers = 19, kMembersPieced = 21;

constexpr JsonMembers::Complaint kComplaint{"cannot accept this candidate's sidecar"};

std::string id(const JsonMembers& in, const char* key, std::size_t longest, std::string_view also) {
  const std::string& value = in.text(key);
  const bool good = !value.empty() && value.size() <= longest && value.front() != '.' &&
                    std::all_of(value.begin(), value.end(), [also](char c) {
                      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                             also.find(c) != std::string_view::npos;
                    });
  if (!good) in.refuse(key, fmt::format("1 to {} letters, digits and {}", longest, also), value);
  return value;
}

CandidatePose read_pose(const JsonMembers& in) {
  CandidatePose pose;
  pose.lat_e7 = in.whole("lat_e7", -900'000'000, 900'000'000);
  pose.lon_e7 = in.whole("lon_e7", -1'800'000'000, 1'800'000'000);
  pose.agl_mm = in.whole("agl_mm", 1, 100 * kMillion);
  pose.heading_mdeg = in.whole("heading_mdeg", 0, 359'999);
  pose.pitch_mdeg = in.whole("pitch_mdeg", -90'000, 90'000);
  pose.roll_mdeg = in.whole("roll_mdeg", -180'000, 180'000);
  pose.sigma_mm = in.whole("sigma_mm", 1, 10 * kMillion);
  pose.cov_ee_mm2 = in.whole("cov_ee_mm2", 0, kMostSquare_mm2);
  pose.cov_en_mm2 = in.whole("cov_en_mm2", -kMostSquare_mm2, kMostSquare_mm2);
  pose.cov_nn_mm2 = in.whole("cov_nn_mm2", 0, kMostSquare_mm2);
  const double en = static_cast<double>(pose.cov_en_mm2);
  // Rounded to whole mm² each, so a covariance of one line may be off by that.
  if (en * en > (static_cast<double>(pose.cov_ee_mm2) + 1) * (static_cast<double>(pose.cov_nn_mm2) + 1)) {
    in.refuse("cov_en_mm2", "a covariance: at most what the variances allow", pose.cov_en_mm2);
  }
  pose.refined = in.whole("refined", 0, 1) == 1;
  return pose;
}

CandidateQuality read_quality(const JsonMembers& in) {
  return {.sharpness_ppm = in.whole("sharpness_ppm", 0, kMillion),
          .contrast_ppm = in.whole("contrast_ppm", 0, kMillion),
          .clipped_ppm = in.whole("clipped_ppm", 0, kMillion),
          .view_angle_mdeg = in.whole("view_angle_mdeg", 0, 90'000),
          .overlap_ppm = in.whole("overlap_ppm", 0, kMillion)};
}

TileKey read_key(const JsonMembers& in) {
  const std::int64_t z = in.whole("z", 0, kMaxZoom);
  const std::int64_t last = (std::int64_t{1} << z) - 1;
  return {static_cast<std::uint8_t>(z), static_cast<std::uint32_t>(in.whole("x", 0, last)),
          static_cast<std::uint32_t>(in.whole("y", 0, last))};
}

SourceLabel read_source(const JsonMembers& in) {
  for (const auto label : {SourceLabel::satellite_anchored, SourceLabel::vo_extrapolated, SourceLabel::dead_reckoned,
                           SourceLabel::no_fix}) {
    if (in.text("source") == name_of(label)) return label;
  }
  in.refuse("source", "a source label", in.text("source"));
}

UtcMillis read_time(const JsonMembers& in) {
  const auto time = parse_utc_millis(in.text("captured_at"));
  if (!time) in.refuse("captured_at", "a time like 2026-05-01T12:00:00.250Z", in.text("captured_at"));
  return *time;
}

bool says_it_is_pieced(const json& document) {
  if (!document.is_object()) return false;
  const auto schema = document.find("schema");
  return schema != document.end() && schema->is_string() && schema->get_ref<const std::string&>() == kPiecedTileSchema;
}

CandidatePart read_part(const JsonMembers& in) {
  return {.frame = id(in, "frame", kMaxFrame, "_.-"),
          .captured_at = read_time(in),
          .share_ppm = in.whole("share_ppm", 0, kMillion),
          .pose = read_pose(in.object("pose", 11))};
}

// What the whole says of itself must be the worst of its parts: nobody looks at the parts to find out.
void read_parts(const JsonMembers& in, CandidateSidecar& sidecar) {
  sidecar.seam_mm = in.whole("seam_mm", 0, 10 * kMillion);
  const json& parts = in.member("parts");
  if (!parts.is_array() || parts.size() < 2 || parts.size() > kMaxCandidateParts) {
    in.refuse("parts", fmt::format("a list of 2 to {} parts", kMaxCandidateParts), parts);
  }
  std::int64_t shares_ppm = 0;
  for (const json& part : parts) {
    const JsonMembers one(part, fmt::format("{}: parts/{}", in.where(), sidecar.parts.size()), 4, kComplaint);
    const CandidatePart& read = sidecar.parts.emplace_back(read_part(one));
    shares_ppm += read.share_ppm;
    if (read.captured_at < sidecar.captured_at) in.refuse("captured_at", "the oldest part's", part["captured_at"]);
    if (read.pose.sigma_mm > sidecar.pose.sigma_mm) in.refuse("pose", "the largest sigma of all parts", part["pose"]);
  }
  if (sidecar.seam_mm > sidecar.pose.sigma_mm) in.refuse("seam_mm", "at most the pose's sigma_mm", sidecar.seam_mm);
  // Each share is rounded by itself.
  if (std::abs(shares_ppm - kMillion) > static_cast<std::int64_t>(kMaxCandidateParts)) {
    in.refuse("parts", "shares that are the whole together", shares_ppm);
  }
}

}  // namespace

CandidateSidecar read_candidate(const json& document, std::string_view name) {
  const bool pieced = says_it_is_pieced(document);
  const JsonMembers in(document, std::string(name), pieced ? kMembersPieced : kMembers, kComplaint);
  if (!pieced && in.text("schema") != kCandidateSchema) {
    in.refuse("schema", fmt::format("{} or {}", kCandidateSchema, kPiecedTileSchema), in.text("schema"));
  }
  CandidateSidecar sidecar;
  sidecar.airframe = id(in, "airframe", kMaxName, "_.-");
  sidecar.flight = id(in, "flight", kMaxName, "_-");
  sidecar.base_package = in.digest("base_package");
  sidecar.frame = id(in, "frame", kMaxFrame, "_.-");
  sidecar.key = read_key(in);
  sidecar.sha256 = in.digest("sha256");
  sidecar.size = static_cast<std::uint64_t>(in.whole("size", 1, kMaxCandidateTile));
  const auto format = parse_image_format(in.text("format"));
  if (!format || *format == ImageFormat::png || name_of(*format) != in.text("format")) {  // "jpg" is no name of ours
    in.refuse("format", "jpeg or webp", in.text("format"));
  }
  sidecar.format = *format;
  sidecar.captured_at = read_time(in);
  sidecar.gsd_mm = in.whole("gsd_mm", 1, 100'000);
  sidecar.pose = read_pose(in.object("pose", 11));
  sidecar.source = read_source(in);
  sidecar.anchor_age_ms = in.whole("anchor_age_ms", 0, 1'000 * kMillion);
  const std::string& trust = in.text("trust");
  if (trust != "candidate" && trust != "soft") in.refuse("trust", "candidate or soft", trust);
  sidecar.trust = trust == "soft" ? CandidateTrust::soft : CandidateTrust::candidate;
  sidecar.quality = read_quality(in.object("quality", 5));
  sidecar.camera = in.digest("camera");
  if (pieced) read_parts(in, sidecar);
  return sidecar;
}

CandidateSidecar parse_candidate(std::string_view bytes, std::string_view name) {
  if (bytes.size() > kMaxCandidateSidecar) {
    throw Error({.what = kComplaint.what,
                 .where = std::string(name),
                 .expected = fmt::format("at most {} bytes", kMaxCandidateSidecar),
                 .found = std::to_string(bytes.size())});
  }
  const json document = parse_json(bytes, name, {.max_depth = 4, .allow_floats = false});
  CandidateSidecar sidecar = read_candidate(document, name);
  if (document.dump() != bytes) {
    throw Error({.what = kComplaint.what,
                 .where = std::string(name),
                 .expected = "canonical JSON: sorted keys, no blanks, numbers and texts in their shortest spelling",
                 .found = "the same values in another spelling"});
  }
  return sidecar;
}

}  // namespace nadir
