// The localizer: frames and telemetry in, estimates out. The same object is used in nadird and for replays; it reads no
// clock and no files but the map's tiles.
//
// Localizer::process() is the path of one frame, as in docs/localization.md. Matching with the map takes longer
// than a frame may wait in flight: track() and finish() are the same path in two parts, and the AnchorJob between them
// may run elsewhere while other frames are tracked. An anchor counts for the frame that it was taken from: the filter
// returns to that moment, is updated, and applies the later steps again.
#pragma once

#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "estimation/estimate.hpp"
#include "estimation/flight_filter.hpp"
#include "estimation/map_look.hpp"
#include "estimation/telemetry.hpp"
#include "estimation/visual_odometry.hpp"
#include "geodesy/local_frame.hpp"
#include "imagery/matchability_raster.hpp"
#include "imagery/tile_source.hpp"
#include "vision/camera.hpp"
#include "vision/camera_frame.hpp"
#include "vision/ground_surface.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

struct LocalizerConfig {
  double integrity_risk = parameters::belief::kIntegrityRisk;   // per look, beyond the protection level
  double start_sigma_m = parameters::localizer::kStartSigma_m;  // of the start position, one axis
  // The start is what this flight knew before its program was restarted. The map has matched the flight before, so
  // that frames which agree with each other overrule such a start. They do not overrule any other start: the map may be
  // wrong.
  bool resumed = false;
  double min_search_radius_m = parameters::search_window::kMinRadius_m;  // half side of the searched square
  double max_search_radius_m = parameters::search_window::kMaxRadius_m;
  double no_fix_sigma_m = parameters::localizer::kNoFixSigma_m;  // beyond this no position is published
  // One axis of the map's own error, see map_sigma_from_ce90(). Nothing: what the tiles state that an anchor was
  // matched with, and where they state nothing, parameters::localizer::kMapSigma_m.
  std::optional<double> map_sigma_m;
  double assumed_agl_m = parameters::localizer::kAssumedAgl_m;  // only until telemetry has a height
  // A healthy flight need not match every frame with the map: after so long a displacement since the last anchor, or
  // when the belief is less certain than one Gaussian of this sigma (one axis), by its protection level. So doubts that
  // no sigma shows, another place or a start that is not confirmed, are looked into at once, and after a look that
  // failed the next frame is looked at. The map's own error does not count: looks do not lessen it. 0 m: every frame.
  double anchor_every_m = 0;
  double anchor_above_sigma_m = parameters::localizer::kMatchAboveSigma_m;
  std::optional<PlaneBox> area;            // where the flight can be at all: searched when the start is not known
  const GroundSurface* surface = nullptr;  // terrain; null: flat ground. Must outlive the localizer.
  // A package's place index: retrieves similar places, so that a lost aircraft need not search all of the area at
  // once; null: it does. Must outlive the localizer.
  const PlaceRetrieval* places = nullptr;
  // A package's matchability map: how often looks find their place, by ground; null: everywhere alike. Must outlive the
  // localizer.
  const MatchabilityRaster* matchability = nullptr;
  FrameCheckerFactory frame_checker = make_frame_checker;
  OdometryFactory odometry = make_feature_odometry;
  MapMatcherFactory matcher = make_channel_matcher;
};

// One frame to be matched with the map: a snapshot of what was predicted for it, and the result.
class AnchorJob {
 public:
  // The heavy part, 0.1 s to some seconds. On any thread; the localizer hands out one job at a time.
  // When cancelled, or when matching fails, it throws, and the job counts as one that never ran.
  void run(const Cancel& cancel = {}) { match = match_frame(cancel); }

  // The rest is the localizer's own.
  std::function<AnchorMatch(const Cancel&)> match_frame;
  std::optional<AnchorMatch> match;  // once it has run

  std::size_t step = 0;  // in the flight's log
  double time_s = 0;
  int segment = 0;
  TelemetryReference reference;
  FlightFilter flight;  // as it was
  LookContext context;
  Eigen::Vector2d corrected_m = Eigen::Vector2d::Zero();  // of the track's past by odometry, up to this frame
  bool searches_everywhere = false;  // no prediction and no hint: all of the area, for half a minute perhaps
};

class Localizer {
 public:
  // frame: the plane in which everything is estimated; with a map the one of its mission. tiles: the map, or null for
  // odometry alone; it must outlive the localizer. start: where the flight begins, if known.
  Localizer(const CameraFile& camera, const LocalFrame& frame, const TileSource* tiles, std::optional<LonLat> start,
            const LocalizerConfig& config = {});
  ~Localizer();

  // image: CV_8UC1 or CV_8UC3 of the camera's size; empty when the frame could not be decoded.
  FrameReport process(const cv::Mat& image, const Telemetry& measured);

  // The frame without the map. `job`: to be run and handed to finish(); none when there is nothing to match, or while
  // another one is out.
  struct TrackedFrame {
    FrameReport report;
    std::unique_ptr<AnchorJob> job;
  };
  TrackedFrame track(const cv::Mat& image, const Telemetry& measured);
  // The result of matching the job's frame, however many were tracked since. The anchor report is of that frame, the
  // estimate of the last one tracked, given the anchor.
  FrameReport finish(std::unique_ptr<AnchorJob> job);

  // An operator says where the aircraft is, within radius_m. Searched first while there is no healthy prediction, and
  // dropped with the next anchor. It moves no position: one that it contradicts, and that no anchor supports without a
  // break, is inflated by their distance. Throws UsageError for an invalid position or radius.
  void hint(const LonLat& at, double radius_m);

  // All frames so far after smoothing with all anchors: same order, same fields.
  std::vector<Estimate> refined() const;
  // The camera's poses of the same frames, after smoothing: of those whose own anchor was accepted and contradicts no
  // other.
  std::vector<std::optional<FramePose>> refined_poses() const;
  // The same flight as an adjustment begins with it; empty while nothing is known of any position.
  std::vector<SmoothedFrame> smoothed() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
