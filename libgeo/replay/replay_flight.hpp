// Runs a recorded flight through the localizer, frame by frame, and writes each estimate as soon as it is made.
#pragma once

#include <optional>
#include <vector>

#include "base/progress.hpp"
#include "estimation/estimate.hpp"
#include "estimation/visual_odometry.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/tile_source.hpp"
#include "replay/flight_folder.hpp"
#include "replay/recorded_flight.hpp"
#include "replay/report.hpp"
#include "replay/score.hpp"
#include "replay/track_files.hpp"
#include "vision/ground_surface.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

struct ReplayedFlight {
  std::vector<FrameReport> frames;        // without their images
  std::vector<EstimateRecord> published;  // every estimate, also those of late anchors
  std::vector<Estimate> refined;
  std::vector<std::optional<FramePose>> poses;  // Localizer::refined_poses()
  std::vector<FrameImages> worst;
};

// What the localizer starts from.
struct ReplaySetup {
  LocalFrame frame;                   // the plane of the estimates
  const TileSource* tiles = nullptr;  // null: odometry alone
  std::optional<LonLat> start;
  std::optional<double> integrity_risk{};  // per look; nothing: the default
  std::optional<PlaneBox> area;            // where the flight can be, when its start is not known
  const GroundSurface* surface = nullptr;  // null: flat ground
  const PlaceRetrieval* places = nullptr;  // null: when lost, all of the area is searched
  const MatchabilityRaster* matchability = nullptr;
  OdometryFactory odometry = make_feature_odometry;
  MapMatcherFactory matcher = make_channel_matcher;
  ReplayRecording* recording = nullptr;      // where it is recorded, if anywhere
  const RecordedFlight* recorded = nullptr;  // flown as it was then: its configuration, its late anchors
};

// The localizer's configuration, and the factor by which images are reduced when they are decoded.
LocalizerConfig localizer_config(const ReplaySetup& setup);
int picture_shrink(const Flight& flight, const ReplaySetup& setup);

// The truth only selects the frames whose images are kept for the report. csv: where estimates are written as they are
// computed, or null.
ReplayedFlight replay_flight(const Flight& flight, const ReplaySetup& setup, const Truth& truth, EstimatesCsv* csv,
                             Progress& progress);

}  // namespace nadir
