// Runs a recorded flight through the localizer, frame by frame, and writes each estimate as soon as it is made.
//
// A folder of frames is flown by the FlightEngine over a store (flights/flight_store.hpp), from which an interrupted
// replay goes on. A recording is flown in the order of events in the air, hints and late anchors between the same
// frames as then, and from its beginning.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "base/progress.hpp"
#include "estimation/estimate.hpp"
#include "estimation/visual_odometry.hpp"
#include "flights/flight_engine.hpp"
#include "flights/flight_store.hpp"
#include "flights/no_fix_diagnosis.hpp"
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
  std::size_t restored = 0;  // frames that an interrupted replay had processed
  // Over a map: why the first frames matched nowhere, where they did. Later frames may have matched.
  std::optional<NoFixDiagnosis> diagnosis;
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
  FlightStore* store = nullptr;              // where the flight is kept while it is flown; null: in memory
  ReplayRecording* recording = nullptr;      // where it is recorded, if anywhere
  const RecordedFlight* recorded = nullptr;  // flown as it was then: its configuration, its late anchors
  std::optional<double> ground_msl_m{};      // of the ground, where it is known: for a diagnosis
  // After the last frame of a folder of frames, with the engine that has flown it and what it was made of. Empty:
  // nobody has more to do with it.
  std::function<void(const FlightStore&, FlightEngine&, const FlightEngineSetup&)> on_flown{};
  // While the replay goes on: that the first frames match nowhere, and why, as soon as it is known. Empty: nobody wants
  // to know, and nothing is tried.
  std::function<void()> on_no_match{};
  std::function<void(const NoFixDiagnosis&)> on_diagnosis{};
};

// The localizer's configuration, and the factor by which images are reduced when they are decoded.
LocalizerConfig localizer_config(const ReplaySetup& setup);
int picture_shrink(const Flight& flight, const ReplaySetup& setup);

// What a store keeps of the flight, to be created or compared with. session: of the flight, its identifier included.
FlightDescription flight_description(const Flight& flight, SessionRecord session);

// Throws UsageError when setup.store holds another flight. The truth only selects the frames whose images are kept for
// the report. csv: where estimates are written as they are computed, or null.
ReplayedFlight replay_flight(const Flight& flight, const ReplaySetup& setup, const Truth& truth, EstimatesCsv* csv,
                             Progress& progress);

}  // namespace nadir
