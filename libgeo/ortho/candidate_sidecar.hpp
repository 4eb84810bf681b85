// Metadata of a candidate tile, which a flight made from its frames. Whether it becomes part of a map is decided after
// the flight; all that is needed for that is here, signed by the airframe's tile key.
//
// The signed bytes are canonical JSON (sorted keys, no blanks, integers and texts only): a sidecar has exactly one
// spelling, and parse_candidate() takes no other. Units stand in the names. docs/formats/candidates.md.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "base/time.hpp"
#include "estimation/source_label.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "trust/signatures.hpp"
#include "vision/camera.hpp"

namespace nadir {

inline constexpr std::string_view kCandidateSchema = "nadir.candidate/1";   // one frame shows all of the tile
inline constexpr std::string_view kMosaicTileSchema = "nadir.candidate/2";  // a mosaic of several frames
inline constexpr std::string_view kCandidatePayloadType = "application/vnd.nadir.candidate-tile.v1+json";
inline constexpr std::size_t kMaxCandidateSidecar = 4096;  // bytes
inline constexpr std::uint64_t kMaxCandidateTile = 1U << 20;
inline constexpr std::size_t kMaxCandidateParts = 6;

enum class CandidateTrust { candidate, soft };
std::string_view name_of(CandidateTrust trust);

// The camera's when the frame was taken, and how well it is known.
struct CandidatePose {
  std::int64_t lat_e7 = 0, lon_e7 = 0;
  std::int64_t agl_mm = 0;
  std::int64_t heading_mdeg = 0;               // 0 to 359999, of image-up, clockwise from north
  std::int64_t pitch_mdeg = 0, roll_mdeg = 0;  // as vision/camera.hpp has them
  std::int64_t sigma_mm = 0;                   // one axis of the equivalent circular error
  std::int64_t cov_ee_mm2 = 0, cov_en_mm2 = 0, cov_nn_mm2 = 0;
  bool refined = false;  // smoothed with what came after the frame

  bool operator==(const CandidatePose&) const = default;
};

struct CandidateQuality {
  std::int64_t sharpness_ppm = 0;    // mean gradient over contrast, of the frame
  std::int64_t contrast_ppm = 0;     // standard deviation of the tile's grey levels, of 255
  std::int64_t clipped_ppm = 0;      // of the tile's pixels: black or blown out
  std::int64_t view_angle_mdeg = 0;  // off nadir, of the tile's worst corner
  std::int64_t overlap_ppm = 0;      // of the tile's pixels that the frame saw; whole tiles have 1 000 000

  bool operator==(const CandidateQuality&) const = default;
};

// One of the frames of a mosaic.
struct CandidatePart {
  std::string frame;  // see frame_label()
  UtcMillis captured_at;
  std::int64_t share_ppm = 0;  // of the tile's pixels
  CandidatePose pose;

  bool operator==(const CandidatePart&) const = default;
};

// Of a mosaic every value is the worst of its parts: `frame` and `pose` are those of the part with the most uncertain
// position, its sigma and variances increased by the parts' displacement; captured_at is the oldest part's.
struct CandidateSidecar {
  std::string airframe;
  std::string flight;   // 1 to 64 of A-Z a-z 0-9 _ -
  Sha256 base_package;  // of the manifest of the package that the flight was anchored to
  std::string frame;    // see frame_label()
  TileKey key;
  Sha256 sha256;                           // of the encoded tile
  std::uint64_t size = 0;                  // bytes
  ImageFormat format = ImageFormat::jpeg;  // JPEG or WebP
  UtcMillis captured_at;
  std::int64_t gsd_mm = 0;  // the frame's own on the ground
  CandidatePose pose;
  SourceLabel source = SourceLabel::satellite_anchored;
  std::int64_t anchor_age_ms = 0;
  CandidateTrust trust = CandidateTrust::candidate;
  CandidateQuality quality;
  Sha256 camera;                     // of the canonical camera
  std::vector<CandidatePart> parts;  // none, or 2 to kMaxCandidateParts
  std::int64_t seam_mm = 0;          // largest displacement between parts, measured in their overlap

  bool operator==(const CandidateSidecar&) const = default;
};

// A frame's name as sidecars hold it: 1 to 128 of A-Z a-z 0-9 . _ -, not beginning with a dot; the rest becomes '_'.
std::string frame_label(std::string_view name);

// The canonical bytes. Throws Error for values that parse_candidate() would refuse.
std::string candidate_json(const CandidateSidecar& sidecar);

// Throws JsonError for a document that is not a sidecar of this version.
CandidateSidecar read_candidate(const nlohmann::json& document, std::string_view name);

// The same for text: throws Error for anything but the canonical bytes of a sidecar of this version.
CandidateSidecar parse_candidate(std::string_view bytes, std::string_view name);

EnvelopeSignature sign_candidate(const PrivateKey& key, std::string_view sidecar_bytes);

// Signed by a key that the root gives to the sidecar's airframe? at: nullopt skips the expiry of keys.
SignatureCheck check_candidate_signature(const TrustRoot& root, const CandidateSidecar& sidecar,
                                         std::string_view sidecar_bytes, const EnvelopeSignature& signature,
                                         std::optional<UtcTime> at);

// The identity of a camera: SHA-256 of its canonical form, JSON with sorted keys, no blanks and integers
// (docs/formats/candidates.md), so that tiles of one lens can be distinguished from those of another.
std::string canonical_camera(const CameraModel& camera);
Sha256 camera_digest(const CameraModel& camera);

}  // namespace nadir
