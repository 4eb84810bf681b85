// poses.json: where the camera was when each anchored frame of a flight was taken, in every bit of the smoothed flight.
// `nadir replay` writes it, `nadir ortho --estimates` reads it (docs/formats/poses.md).
//
// The file decides where a flight's tiles lie, so it names what it belongs to and is rejected for any other flight, map
// or camera. Angles are radians and lengths metres, as in the localizer: degrees would not be the same bits.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/digest.hpp"
#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "geodesy/lon_lat.hpp"
#include "vision/adjusted_lens.hpp"

namespace nadir {

inline constexpr std::string_view kPosesFile = "poses.json";
inline constexpr std::string_view kPosesSchema = "nadir.poses/3";

struct PosesSubject {
  std::string flight;    // id_of() its telemetry
  std::uint64_t frames;  // of the flight, anchored or not
  Sha256 base_package;   // of its manifest.json: the map that the poses follow
  Sha256 camera;         // camera_digest() of the pictures as they are
  LonLat origin;         // of the plane whose metres east and north count
};

struct NumberedPose {
  std::uint64_t index = 0;  // of the flight's frames, from 0
  std::string frame;        // frame_label() of its name
  FramePose pose;           // satellite_anchored and refined, its anchor 0 s old
};

struct PosesDocument {
  PosesSubject subject;
  std::optional<AdjustedLens> lens;  // that the poses belong to; nothing: the nominal one
  std::vector<NumberedPose> poses;   // by index
};

// poses: Localizer::refined_poses(), or adjusted ones with their lens; one per frame.
PosesDocument poses_document(const PosesSubject& subject, const std::vector<Telemetry>& frames,
                             const std::vector<std::optional<FramePose>>& poses,
                             const std::optional<AdjustedLens>& lens = std::nullopt);
std::string poses_json(const PosesDocument& document);

// Throws Error, naming the member, for anything else: missing or unknown members, numbers out of range, frames out of
// order. `name` is for messages.
PosesDocument parse_poses(std::string_view bytes, std::string_view name);

struct FlightPoses {
  std::vector<std::optional<FramePose>> poses;  // one per frame of the flight
  std::optional<AdjustedLens> lens;
};

// As they were written. Throws UsageError when the file
// belongs to another flight, map or camera, Error when it cannot be read.
FlightPoses read_poses(const std::filesystem::path& path, const PosesSubject& wanted,
                       const std::vector<Telemetry>& frames);

}  // namespace nadir
