// Makes candidate tiles of a flight's frames: the same code in flight (nadird, on its own thread) and afterwards (nadir
// ortho, with refined poses). One call per frame does all steps: check eligibility, decode, orthorectify, check the
// pixels, encode, sign, store.
//
// A tile that a frame shows completely is made of that frame. One that it shows in part goes into a mosaic with other
// frames (ortho/tile_mosaic.hpp); finish() stores what is complete at the end.
#pragma once

#include <array>
#include <functional>
#include <utility>
#include <vector>

#include "base/bytes.hpp"
#include "geodesy/local_frame.hpp"
#include "ortho/candidate_store.hpp"
#include "ortho/eligibility.hpp"
#include "ortho/orthorectifier.hpp"
#include "ortho/radiometric_balance.hpp"
#include "ortho/tile_mosaic.hpp"
#include "vision/adjusted_lens.hpp"

namespace nadir {

// What is the same for all frames of a flight. `surface` and `key` must outlive the maker.
struct CandidateFlight {
  std::string airframe;
  std::string flight;
  Sha256 base_package;                     // of its manifest.json
  CameraModel camera;                      // of the images at full size; sidecars name it
  std::optional<SensorReadout> readout{};  // a rolling shutter, which is undone by the pose's motion
  std::optional<AdjustedLens> lens{};      // that the poses belong to; nothing: the camera's nominal one
  LocalFrame frame;                        // the plane of the poses
  const GroundSurface* surface = nullptr;
  const PrivateKey* key = nullptr;  // the airframe's tile key
  int zoom = 0;                     // the mission's finest
  ImageFormat format = ImageFormat::jpeg;
  int quality = 82;  // of the encoding
  EligibilityLimits limits{};
  bool merge_partial_tiles = true;  // mosaics of tiles that no single frame shows completely
  MosaicLimits mosaic{};            // its sigmas are those of `limits`
};

struct PosedFrame {
  std::string name;
  UtcMillis captured_at;
  FramePose pose;
  RadiometricCorrection correction{};  // of what the tiles show; whether there are any is decided before
};

// What one frame contributed.
struct FrameTiles {
  std::optional<OrthoRefusal> refusal;                       // of the frame as a whole
  std::array<int, kOrthoRefusals> refused{};                 // whole tiles and mosaics, by OrthoRefusal
  std::vector<std::pair<TileKey, CandidateOutcome>> stored;  // or not, with the reason
  std::size_t whole = 0;  // tiles that the frame shows completely, including refused ones
  std::array<int, kPartialTileOutcomes> partial_tiles{};  // by PartialTileOutcome
  std::size_t mosaics_stored = 0;                         // of `stored`: mosaics, completed before this frame
};

using DeadlinePassed = std::function<bool()>;

class CandidateMaker {
 public:
  // Throws UsageError for an airframe or flight whose name no sidecar can hold, and for a zoom outside of the grid.
  explicit CandidateMaker(const CandidateFlight& flight);

  // encoded: the image as it came from the camera. Throws Error when the store fails (OutOfSpace: the disk is full);
  // images that do not decode are refusals. deadline_passed is called before each tile: the tiles after that are left
  // out (late). Without it there is no deadline, and the same frames give the same tiles.
  FrameTiles make(const PosedFrame& seen, ByteView encoded, CandidateStore& store,
                  const DeadlinePassed& deadline_passed = {});

  // After the last frame: the mosaics that are complete.
  FrameTiles finish(CandidateStore& store);
  std::uint64_t unfinished() const { return mosaics_.dropped(); }  // mosaics that were never completed

  // Without encoding, signing and storing: for mosaics and tests. The sidecars have no digest and no size yet.
  struct RawTile {
    CandidateSidecar sidecar;
    cv::Mat image;
  };
  std::vector<RawTile> raw_tiles(const PosedFrame& seen, ByteView encoded, FrameTiles& report) const;

 private:
  struct PreparedFrame {
    ReducedFrame reduced;
    CandidateSidecar sidecar;  // of its tiles, without what differs between them
    double tile_gsd_m = 0;
  };
  CandidateSidecar sidecar_of(const PosedFrame& seen, CandidateTrust trust) const;
  std::optional<PreparedFrame> prepare(const PosedFrame& seen, ByteView encoded, FrameTiles& report) const;
  std::vector<RawTile> make_whole_tiles(const PosedFrame& seen, const PreparedFrame& frame, FrameTiles& report) const;
  void add_partial_tiles(const PosedFrame& seen, const PreparedFrame& frame, CandidateStore& store,
                         const DeadlinePassed& deadline_passed, FrameTiles& report);
  std::vector<RawTile> eligible_mosaics(const std::vector<TileMosaic>& mosaics, FrameTiles& report) const;
  void store_tiles(const std::vector<RawTile>& tiles, CandidateStore& store, const DeadlinePassed& deadline_passed,
                   FrameTiles& report) const;

  CandidateFlight flight_;
  CameraModel seen_with_;  // the camera with the lens that the poses belong to
  Sha256 camera_;
  TileMosaics mosaics_;
};

}  // namespace nadir
