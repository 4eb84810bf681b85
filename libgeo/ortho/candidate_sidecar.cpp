#include "ortho/candidate_sidecar.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "ortho/candidate_sidecar_parse.hpp"

namespace nadir {
namespace {

using nlohmann::json;

bool name_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
}

constexpr std::size_t kMaxFrameLabel = 128;

json json_of(const CandidatePose& pose) {
  return {{"lat_e7", pose.lat_e7},          {"lon_e7", pose.lon_e7},
          {"agl_mm", pose.agl_mm},          {"heading_mdeg", pose.heading_mdeg},
          {"pitch_mdeg", pose.pitch_mdeg},  {"roll_mdeg", pose.roll_mdeg},
          {"sigma_mm", pose.sigma_mm},      {"cov_ee_mm2", pose.cov_ee_mm2},
          {"cov_en_mm2", pose.cov_en_mm2},  {"cov_nn_mm2", pose.cov_nn_mm2},
          {"refined", pose.refined ? 1 : 0}};
}

}  // namespace

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
  const bool pieced = !s.parts.empty();
  json document{{"schema", pieced ? kPiecedTileSchema : kCandidateSchema},
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
  if (pieced) {
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
    throw Error({.what = "a candidate's sidecar is too long",
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

}  // namespace nadir
