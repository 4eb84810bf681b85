// Candidates out of a flight's frames: the same code in flight (nadird, on a thread of its own) and afterwards (nadir
// ortho, with refined poses). One call per frame does all: may it, decode, orthorectify, judge, encode, sign, store.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/local_frame.hpp"
#include "ortho/candidate_store.hpp"
#include "ortho/eligibility.hpp"
#include "ortho/orthorectifier.hpp"

namespace nadir {

// What is the same for all frames of a flight. `surface` and `key` must outlive the maker.
struct CandidateFlight {
  std::string airframe;
  std::string flight;
  Sha256 base_package;  // of its manifest.json
  CameraModel camera;   // of the pictures as they are
  LocalFrame frame;     // the plane of the poses
  const GroundSurface* surface = nullptr;
  const PrivateKey* key = nullptr;  // the airframe's tile key
  int zoom = 0;                     // the mission's finest
  ImageFormat format = ImageFormat::jpeg;
  int quality = 82;  // of the encoding
  EligibilityLimits limits{};
};

struct SeenFrame {
  std::string name;
  UtcMillis captured_at;
  FramePose pose;
};

// What became of one frame.
struct FrameTiles {
  std::optional<OrthoRefusal> refusal;                    // of the frame as a whole
  std::array<int, kOrthoRefusals> refused{};              // whole tiles, by OrthoRefusal
  std::vector<std::pair<TileKey, CandidateFate>> stored;  // or not: by their fate
};

class CandidateMaker {
 public:
  // Throws UsageError for an airframe or flight whose name no sidecar can hold, and for a zoom outside of the grid.
  explicit CandidateMaker(const CandidateFlight& flight);

  // encoded: the picture as it came from the camera. Throws Error when the store fails (OutOfSpace: the disk is full);
  // pictures that do not decode are refusals.
  FrameTiles make(const SeenFrame& seen, ByteView encoded, CandidateStore& store) const;

  // Without encoding, signing and storing: for mosaics and tests. The sidecars have no digest and no size yet.
  struct RawTile {
    CandidateSidecar sidecar;
    cv::Mat image;
  };
  std::vector<RawTile> raw_tiles(const SeenFrame& seen, ByteView encoded, FrameTiles& report) const;

 private:
  CandidateSidecar sidecar_of(const SeenFrame& seen, CandidateTrust trust) const;

  CandidateFlight flight_;
  Sha256 camera_;
};

}  // namespace nadir
