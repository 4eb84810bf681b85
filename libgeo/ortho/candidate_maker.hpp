// Candidates out of a flight's frames: the same code in flight (nadird, on a thread of its own) and afterwards (nadir
// ortho, with refined poses). One call per frame does all: may it, decode, orthorectify, judge, encode, sign, store.
//
// A tile that a frame shows wholly is made of that frame. What it shows in part waits for other frames that show the
// rest (ortho/tile_quilts.hpp); finish() makes what is whole by then.
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
#include "ortho/tile_mosaic.hpp"

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
  bool merge_partial_tiles = true;  // tiles that no single frame shows wholly
  MosaicLimits quilt{};         // its sigmas are those of `limits`
};

struct PosedFrame {
  std::string name;
  UtcMillis captured_at;
  FramePose pose;
};

// What became of one frame.
struct FrameTiles {
  std::optional<OrthoRefusal> refusal;                    // of the frame as a whole
  std::array<int, kOrthoRefusals> refused{};              // whole tiles, by OrthoRefusal
  std::vector<std::pair<TileKey, CandidateOutcome>> stored;  // or not: by their fate
  std::size_t whole = 0;                                  // tiles that the frame shows wholly, refused ones as well
  std::array<int, kPartialTileOutcomes> pieces{};                  // by PartialTileOutcome
  std::size_t pieced = 0;  // of `stored`: tiles of several frames, the last of them seen before this one
};

using DeadlinePassed = std::function<bool()>;

class CandidateMaker {
 public:
  // Throws UsageError for an airframe or flight whose name no sidecar can hold, and for a zoom outside of the grid.
  explicit CandidateMaker(const CandidateFlight& flight);

  // encoded: the picture as it came from the camera. Throws Error when the store fails (OutOfSpace: the disk is full);
  // pictures that do not decode are refusals. out_of_time is asked before each tile: what comes after is left out
  // (late), pieces of tiles first; without it time does not count, and the same frames give the same tiles.
  FrameTiles make(const PosedFrame& seen, ByteView encoded, CandidateStore& store, const DeadlinePassed& out_of_time = {});

  // After the last frame: the tiles that several frames show wholly together.
  FrameTiles finish(CandidateStore& store);
  std::uint64_t unfinished() const { return quilts_.dropped(); }  // tiles that never became whole

  // Without encoding, signing and storing: for mosaics and tests. The sidecars have no digest and no size yet.
  struct RawTile {
    CandidateSidecar sidecar;
    cv::Mat image;
  };
  std::vector<RawTile> raw_tiles(const PosedFrame& seen, ByteView encoded, FrameTiles& report) const;

 private:
  struct ReadyFrame {
    ReducedFrame reduced;
    CandidateSidecar sidecar;  // of its tiles, without what differs between them
    double tile_gsd_m = 0;
  };
  CandidateSidecar sidecar_of(const PosedFrame& seen, CandidateTrust trust) const;
  std::optional<ReadyFrame> ready(const PosedFrame& seen, ByteView encoded, FrameTiles& report) const;
  std::vector<RawTile> whole_of(const PosedFrame& seen, const ReadyFrame& frame, FrameTiles& report) const;
  void add_pieces(const PosedFrame& seen, const ReadyFrame& frame, CandidateStore& store, const DeadlinePassed& out_of_time,
                  FrameTiles& report);
  std::vector<RawTile> judged(const std::vector<TileMosaic>& quilts, FrameTiles& report) const;
  void store_all(const std::vector<RawTile>& tiles, CandidateStore& store, const DeadlinePassed& out_of_time,
                 FrameTiles& report) const;

  CandidateFlight flight_;
  Sha256 camera_;
  TileMosaics quilts_;
};

}  // namespace nadir
