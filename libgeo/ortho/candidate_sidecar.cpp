#include "ortho/candidate_sidecar.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/json.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::int64_t kMillion = 1'000'000;
constexpr std::int64_t kMostSquare_mm2 = 1'000'000'000'000'000;  // (31 km)²
constexpr std::size_t kMaxName = 64, kMaxFrameLabel = 128;
constexpr const char* kRejected = "cannot accept this candidate's sidecar";

bool name_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
}

std::string id(const JsonReader& in, const char* key, std::size_t longest, std::string_view also) {
  const std::string& value = in.text(key);
  const bool good = !value.empty() && value.size() <= longest && value.front() != '.' &&
                    std::all_of(value.begin(), value.end(),
                                [also](char c) { return name_character(c) || also.find(c) != std::string_view::npos; });
  if (!good) in.refuse(key, fmt::format("1 to {} letters, digits and {}", longest, also), value);
  return value;
}

CandidatePose read_pose(const JsonReader& in) {
  CandidatePose pose;
  pose.lat_e7 = in.integer("lat_e7", -900'000'000, 900'000'000);
  pose.lon_e7 = in.integer("lon_e7", -1'800'000'000, 1'800'000'000);
  pose.agl_mm = in.integer("agl_mm", 1, 100 * kMillion);
  pose.heading_mdeg = in.integer("heading_mdeg", 0, 359'999);
  pose.pitch_mdeg = in.integer("pitch_mdeg", -90'000, 90'000);
  pose.roll_mdeg = in.integer("roll_mdeg", -180'000, 180'000);
  pose.sigma_mm = in.integer("sigma_mm", 1, 10 * kMillion);
  pose.cov_ee_mm2 = in.integer("cov_ee_mm2", 0, kMostSquare_mm2);
  pose.cov_en_mm2 = in.integer("cov_en_mm2", -kMostSquare_mm2, kMostSquare_mm2);
  pose.cov_nn_mm2 = in.integer("cov_nn_mm2", 0, kMostSquare_mm2);
  const double en = static_cast<double>(pose.cov_en_mm2);
  // Rounded to whole mm² each, so a covariance of one line may be off by that.
  if (en * en > (static_cast<double>(pose.cov_ee_mm2) + 1) * (static_cast<double>(pose.cov_nn_mm2) + 1)) {
    in.refuse("cov_en_mm2", "a covariance: at most what the variances allow");
  }
  pose.refined = in.integer("refined", 0, 1) == 1;
  in.finish();
  return pose;
}

CandidateQuality read_quality(const JsonReader& in) {
  const CandidateQuality quality{.sharpness_ppm = in.integer("sharpness_ppm", 0, kMillion),
                                 .contrast_ppm = in.integer("contrast_ppm", 0, kMillion),
                                 .clipped_ppm = in.integer("clipped_ppm", 0, kMillion),
                                 .view_angle_mdeg = in.integer("view_angle_mdeg", 0, 90'000),
                                 .overlap_ppm = in.integer("overlap_ppm", 0, kMillion)};
  in.finish();
  return quality;
}

TileKey read_key(const JsonReader& in) {
  const std::int64_t z = in.integer("z", 0, kMaxZoom);
  const std::int64_t last = (std::int64_t{1} << z) - 1;
  return {static_cast<std::uint8_t>(z), static_cast<std::uint32_t>(in.integer("x", 0, last)),
          static_cast<std::uint32_t>(in.integer("y", 0, last))};
}

UtcMillis read_time(const JsonReader& in) {
  const auto time = parse_utc_millis(in.text("captured_at"));
  if (!time) in.refuse("captured_at", "a time like 2026-05-01T12:00:00.250Z");
  return *time;
}

CandidatePart read_part(const JsonReader& in) {
  CandidatePart part{.frame = id(in, "frame", kMaxFrameLabel, "_.-"),
                     .captured_at = read_time(in),
                     .share_ppm = in.integer("share_ppm", 0, kMillion),
                     .pose = read_pose(in.object("pose"))};
  in.finish();
  return part;
}

// What the mosaic states about itself must be the worst of its parts: nobody looks at the parts to find out.
void read_parts(const JsonReader& in, CandidateSidecar& sidecar) {
  sidecar.seam_mm = in.integer("seam_mm", 0, 10 * kMillion);
  const JsonReader parts = in.array("parts", {2, kMaxCandidateParts});
  std::int64_t shares_ppm = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const JsonReader part = parts.object(i);
    const CandidatePart& read = sidecar.parts.emplace_back(read_part(part));
    shares_ppm += read.share_ppm;
    if (read.captured_at < sidecar.captured_at) {
      in.refuse("captured_at", "the oldest part's", part.value("captured_at"));
    }
    if (read.pose.sigma_mm > sidecar.pose.sigma_mm) {
      in.refuse("pose", "the largest sigma of all parts", part.value("pose"));
    }
  }
  if (sidecar.seam_mm > sidecar.pose.sigma_mm) in.refuse("seam_mm", "at most the pose's sigma_mm");
  // Each share is rounded by itself.
  if (std::abs(shares_ppm - kMillion) > static_cast<std::int64_t>(kMaxCandidateParts)) {
    in.refuse("parts", "shares that add up to 1000000", shares_ppm);
  }
}

json json_of(const CandidatePose& pose) {
  return {{"lat_e7", pose.lat_e7},          {"lon_e7", pose.lon_e7},
          {"agl_mm", pose.agl_mm},          {"heading_mdeg", pose.heading_mdeg},
          {"pitch_mdeg", pose.pitch_mdeg},  {"roll_mdeg", pose.roll_mdeg},
          {"sigma_mm", pose.sigma_mm},      {"cov_ee_mm2", pose.cov_ee_mm2},
          {"cov_en_mm2", pose.cov_en_mm2},  {"cov_nn_mm2", pose.cov_nn_mm2},
          {"refined", pose.refined ? 1 : 0}};
}

}  // namespace

CandidateSidecar read_candidate(const json& document, std::string_view name) {
  const JsonReader in(document, {.name = std::string(name), .what = kRejected});
  const bool is_mosaic = in.choice("schema", {kCandidateSchema, kMosaicTileSchema}) == kMosaicTileSchema;
  CandidateSidecar sidecar;
  sidecar.airframe = id(in, "airframe", kMaxName, "_.-");
  sidecar.flight = id(in, "flight", kMaxName, "_-");
  sidecar.base_package = in.digest("base_package");
  sidecar.frame = id(in, "frame", kMaxFrameLabel, "_.-");
  sidecar.key = read_key(in);
  sidecar.sha256 = in.digest("sha256");
  sidecar.size = in.integer<std::uint64_t>("size", 1, kMaxCandidateTile);
  sidecar.format = in.choice("format", std::array{ImageFormat::jpeg, ImageFormat::webp});
  sidecar.captured_at = read_time(in);
  sidecar.gsd_mm = in.integer("gsd_mm", 1, 100'000);
  sidecar.pose = read_pose(in.object("pose"));
  sidecar.source = in.choice("source", std::array{SourceLabel::satellite_anchored, SourceLabel::vo_extrapolated,
                                                  SourceLabel::dead_reckoned, SourceLabel::no_fix});
  sidecar.anchor_age_ms = in.integer("anchor_age_ms", 0, 1'000 * kMillion);
  sidecar.trust = in.choice("trust", std::array{CandidateTrust::candidate, CandidateTrust::soft});
  sidecar.quality = read_quality(in.object("quality"));
  sidecar.camera = in.digest("camera");
  if (is_mosaic) read_parts(in, sidecar);
  in.finish();
  return sidecar;
}

CandidateSidecar parse_candidate(std::string_view bytes, std::string_view name) {
  if (bytes.size() > kMaxCandidateSidecar) {
    throw Error({.what = kRejected,
                 .where = std::string(name),
                 .expected = fmt::format("at most {} bytes", kMaxCandidateSidecar),
                 .found = std::to_string(bytes.size())});
  }
  const json document = parse_json(bytes, name, {.max_depth = 4, .allow_floats = false});
  CandidateSidecar sidecar = read_candidate(document, name);
  if (document.dump() != bytes) {
    throw Error({.what = kRejected,
                 .where = std::string(name),
                 .expected = "canonical JSON: sorted keys, no blanks, numbers and texts in their shortest form",
                 .found = "the same values in another form"});
  }
  return sidecar;
}

std::string_view name_of(CandidateTrust trust) { return trust == CandidateTrust::candidate ? "candidate" : "soft"; }

std::string frame_label(std::string_view name) {
  std::string label(name.substr(0, kMaxFrameLabel));
  for (char& c : label) {
    if (!name_character(c) && c != '.') c = '_';
  }
  if (label.empty() || label.front() == '.') label.insert(0, 1, '_');
  return label.substr(0, kMaxFrameLabel);
}

std::string candidate_json(const CandidateSidecar& s) {
  const bool is_mosaic = !s.parts.empty();
  json document{{"schema", is_mosaic ? kMosaicTileSchema : kCandidateSchema},
                {"airframe", s.airframe},
                {"flight", s.flight},
                {"base_package", s.base_package.hex()},
                {"frame", s.frame},
                {"z", s.key.z},
                {"x", s.key.x},
                {"y", s.key.y},
                {"sha256", s.sha256.hex()},
                {"size", s.size},
                {"format", name_of(s.format)},
                {"captured_at", to_rfc3339(s.captured_at)},
                {"gsd_mm", s.gsd_mm},
                {"pose", json_of(s.pose)},
                {"source", name_of(s.source)},
                {"anchor_age_ms", s.anchor_age_ms},
                {"trust", name_of(s.trust)},
                {"quality",
                 {{"sharpness_ppm", s.quality.sharpness_ppm},
                  {"contrast_ppm", s.quality.contrast_ppm},
                  {"clipped_ppm", s.quality.clipped_ppm},
                  {"view_angle_mdeg", s.quality.view_angle_mdeg},
                  {"overlap_ppm", s.quality.overlap_ppm}}},
                {"camera", s.camera.hex()}};
  if (is_mosaic) {
    document["seam_mm"] = s.seam_mm;
    for (const CandidatePart& part : s.parts) {
      document["parts"].push_back({{"frame", part.frame},
                                   {"captured_at", to_rfc3339(part.captured_at)},
                                   {"share_ppm", part.share_ppm},
                                   {"pose", json_of(part.pose)}});
    }
  }
  // A sidecar that a reader would refuse must not leave this function.
  static_cast<void>(read_candidate(document, "the new sidecar"));
  std::string bytes = document.dump();
  if (bytes.size() > kMaxCandidateSidecar) {
    throw Error({.what = "the candidate's sidecar is too long",
                 .where = "the new sidecar",
                 .expected = fmt::format("at most {} bytes", kMaxCandidateSidecar),
                 .found = std::to_string(bytes.size())});
  }
  return bytes;
}

EnvelopeSignature sign_candidate(const PrivateKey& key, std::string_view sidecar_bytes) {
  return sign_payload(key, kCandidatePayloadType, as_bytes(sidecar_bytes));
}

SignatureCheck check_candidate_signature(const TrustRoot& root, const CandidateSidecar& sidecar,
                                         std::string_view sidecar_bytes, const EnvelopeSignature& signature,
                                         std::optional<UtcTime> at) {
  return check_tile_signatures(root, sidecar.airframe, {signature}, kCandidatePayloadType, as_bytes(sidecar_bytes), at,
                               "candidate tile " + to_text(sidecar.key));
}

std::string canonical_camera(const CameraModel& camera) {
  const auto scaled = [](double value, double unit) { return static_cast<std::int64_t>(std::llround(value / unit)); };
  nlohmann::json distortion = nlohmann::json::array();
  for (const double coefficient : camera.distortion) distortion.push_back(scaled(coefficient, 1e-9));
  const nlohmann::json document{{"schema", "nadir.camera/1"},       {"width", camera.width},
                                {"height", camera.height},          {"fx_e6", scaled(camera.fx, 1e-6)},
                                {"fy_e6", scaled(camera.fy, 1e-6)}, {"cx_e6", scaled(camera.cx, 1e-6)},
                                {"cy_e6", scaled(camera.cy, 1e-6)}, {"distortion_e9", distortion}};
  return document.dump();
}

Sha256 camera_digest(const CameraModel& camera) { return sha256(as_bytes(canonical_camera(camera))); }

}  // namespace nadir
