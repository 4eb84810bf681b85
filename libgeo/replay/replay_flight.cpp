#include "replay/replay_flight.hpp"

#include <chrono>
#include <memory>
#include <utility>

#include "base/error.hpp"
#include "estimation/localizer.hpp"
#include "flights/flight_engine.hpp"
#include "recorder/record_codec.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr std::size_t kReportedFrames = 12;
constexpr double kPlacementTime_s = 3;  // of floating segments, at a time

std::optional<double> error_of(const Estimate& estimate, const std::optional<LonLat>& truth, const LocalFrame& frame) {
  return errors_m({estimate}, {truth}, frame).front();
}

// Feeds a flight to the localizer in the order of events in the air: hints and anchors that arrived between two frames
// arrive between them again.
class RecordedOrder {
 public:
  // Both must outlive this.
  RecordedOrder(Localizer& localizer, const RecordedFlight& recorded) : localizer_(localizer), recorded_(recorded) {}

  // The next frame, and all events before the one after it. Every estimate is added to `estimates`; the report has the
  // last. Throws UsageError for a recorded hint that is not a valid position.
  FrameReport frame(const cv::Mat& image, const Telemetry& telemetry, std::vector<EstimateRecord>& estimates);

 private:
  void add(const FrameReport& report, std::vector<EstimateRecord>& estimates) const;
  void replay_events_until(std::uint64_t before, FrameReport& report, std::vector<EstimateRecord>& estimates);
  void finish(const LateAnchor& anchor, FrameReport& report, std::vector<EstimateRecord>& estimates);

  Localizer& localizer_;
  const RecordedFlight& recorded_;
  std::uint64_t index_ = 0;  // of the current frame
  std::size_t next_ = 0;     // of recorded_.between
  std::unique_ptr<AnchorJob> job_;
  std::uint64_t job_index_ = 0;
};

std::uint64_t frame_after(const BetweenFrames& event) {
  if (const auto* anchor = std::get_if<LateAnchor>(&event)) return anchor->taken_after + 1;
  return std::get<HintRecord>(event).before;
}

FrameReport RecordedOrder::frame(const cv::Mat& image, const Telemetry& telemetry,
                                 std::vector<EstimateRecord>& estimates) {
  FrameReport report;
  if (index_ == 0) replay_events_until(0, report, estimates);
  if (!recorded_.session.looked_up_later) {
    report = localizer_.process(image, telemetry);
    add(report, estimates);
  } else {
    Localizer::TrackedFrame followed = localizer_.track(image, telemetry);
    report = std::move(followed.report);
    add(report, estimates);
    if (followed.job) {
      job_ = std::move(followed.job);
      job_index_ = index_;
    }
  }
  replay_events_until(index_ + 1, report, estimates);
  ++index_;
  return report;
}

void RecordedOrder::add(const FrameReport& report, std::vector<EstimateRecord>& estimates) const {
  estimates.push_back({index_, report.estimate, report.odometry, report.state});
}

void RecordedOrder::replay_events_until(std::uint64_t before, FrameReport& report,
                                        std::vector<EstimateRecord>& estimates) {
  const auto& between = recorded_.between;
  for (; next_ < between.size() && frame_after(between[next_]) <= before; ++next_) {
    if (const auto* hint = std::get_if<HintRecord>(&between[next_])) {
      localizer_.hint(hint->place, hint->radius_m);
    } else {
      finish(std::get<LateAnchor>(between[next_]), report, estimates);
    }
  }
}

// Matched when the anchor arrived: by then the same frames had been tracked. A frame that was unfit for matching has an
// anchor record too, but no job.
void RecordedOrder::finish(const LateAnchor& anchor, FrameReport& report, std::vector<EstimateRecord>& estimates) {
  if (!job_ || anchor.index != job_index_) return;
  if (anchor.looked) job_->run();
  const OdometryReport odometry = report.odometry;
  report = localizer_.finish(std::exchange(job_, nullptr));
  report.odometry = odometry;
  add(report, estimates);
}

}  // namespace

LocalizerConfig localizer_config(const ReplaySetup& setup) {
  LocalizerConfig config;
  config.area = setup.area;
  if (setup.integrity_risk) config.integrity_risk = *setup.integrity_risk;
  if (setup.recorded != nullptr) config = setup.recorded->session.localizer;
  config.surface = setup.surface;
  const bool with_places = setup.recorded == nullptr || setup.recorded->session.places;
  config.places = with_places ? setup.places : nullptr;
  const bool with_matchability = setup.recorded == nullptr || setup.recorded->session.matchability;
  config.matchability = with_matchability ? setup.matchability : nullptr;
  config.odometry = setup.odometry;
  config.matcher = setup.matcher;
  return config;
}

int picture_shrink(const Flight& flight, const ReplaySetup& setup) {
  if (setup.recorded != nullptr) return setup.recorded->session.picture_shrink;
  return decode_reduction(flight.camera.camera.width, flight.camera.camera.height);
}

namespace {

CameraFile shrunk_camera(const Flight& flight, int shrink) {
  CameraFile camera = flight.camera;
  camera.camera = camera.camera.scaled(1.0 / shrink);
  return camera;
}

// What comes of each frame, however it was flown.
class ReplayCollector {
 public:
  ReplayCollector(const Flight& flight, const ReplaySetup& setup, const Truth& truth, EstimatesCsv* csv,
                  Progress& progress)
      : flight_(flight), setup_(setup), truth_(truth), csv_(csv), progress_(progress) {}

  // restored: an interrupted replay has processed it, and may have said why it matches nowhere.
  void add(std::size_t frame, FrameReport report, bool restored = false) {
    if (csv_ != nullptr) csv_->write(report.estimate);
    if (setup_.recording != nullptr) setup_.recording->after(frame, report);
    worst_.offer(frame, report_cost(report, error_of(report.estimate, truth_[frame], setup_.frame)), report.anchor);
    report.anchor.rectified.release();
    report.anchor.matched_map.release();
    const bool diagnosis_due = watch_.due(report.anchor.verdict);
    result.frames.push_back(std::move(report));
    progress_.advance(1);
    if (diagnosis_due && !restored) diagnose();
  }

  void before(std::size_t frame) {
    if (setup_.recording == nullptr) return;
    setup_.recording->before(frame, flight_.frames[frame], flight_.image_path(frame));
  }

  void place_segments(FlightEngine& engine) {
    while (engine.place_segments(SegmentPlacer::Scope::all, kPlacementTime_s, cancel())) {
    }
  }

  // After the last frame: of a flight that is too short for the watch, or was resumed.
  void finish() {
    if (!watch_.anchored() && !diagnosed_) diagnose();
  }

  ReplayedFlight take() {
    result.worst = worst_.worst_first();
    return std::move(result);
  }

  ReplayedFlight result;

 private:
  void diagnose();
  Cancel cancel() const {
    return Cancel([this] {
      progress_.advance(0);  // throws when interrupted
      return false;
    });
  }

  const Flight& flight_;
  const ReplaySetup& setup_;
  const Truth& truth_;
  EstimatesCsv* csv_;
  Progress& progress_;
  WorstFrames worst_{kReportedFrames};
  NoFixWatch watch_;
  bool diagnosed_ = false;
};

// A recording was flown as its aircraft was: there is nothing to be stated otherwise.
void ReplayCollector::diagnose() {
  diagnosed_ = true;
  if (!setup_.on_diagnosis || setup_.tiles == nullptr || setup_.recorded != nullptr) return;
  if (setup_.on_no_match) setup_.on_no_match();
  const int shrink = picture_shrink(flight_, setup_);
  const CameraFile camera = shrunk_camera(flight_, shrink);
  const StatedFlight stated{
      .camera = camera,
      .frame = setup_.frame,
      .tiles = *setup_.tiles,
      .start = setup_.start,
      .area = setup_.area,
      .surface = setup_.surface,
      .places = setup_.places,
      .ground_msl_m = setup_.ground_msl_m,
      .telemetry = flight_.frames,
      .read = [&](std::size_t i) { return read_flight_image(flight_.image_path(i), camera.camera, shrink); },
      .matcher = setup_.matcher};
  const DiagnosisBudget budget{.cancel = cancel()};
  result.diagnosis = diagnose_no_fix(stated, budget);
  if (result.diagnosis) setup_.on_diagnosis(*result.diagnosis);
}

void check_same_pictures(const Flight& flight, const FlightStore& store) {
  bool same = store.accepted() == flight.frames.size();
  for (std::size_t i = 0; same && i < flight.frames.size(); ++i) {
    const auto bytes = [i](const Telemetry& telemetry) { return encode(Record(InputRecord{i, telemetry, {}, 0})); };
    same = bytes(store.picture(i).telemetry) == bytes(flight.frames[i]);
  }
  if (same) return;
  throw UsageError({.what = "the interrupted replay is of another flight",
                    .expected = "the same frames and telemetry",
                    .found = "other frames, or other rows",
                    .fix = "resume with the same inputs, or replay from the start without --resume"});
}

// A folder of frames.
void fly_folder(const Flight& flight, const ReplaySetup& setup, FlightStore& store, ReplayCollector& collector) {
  if (store.accepted() == 0) {
    store.refer(flight.frames_folder, flight.frames, flight.files, system_clock_millis());
  } else {
    check_same_pictures(flight, store);
  }
  const FlightEngineSetup made_of{.camera = flight.camera,
                                  .shrink = picture_shrink(flight, setup),
                                  .frame = setup.frame,
                                  .tiles = setup.tiles,
                                  .start = setup.start,
                                  .localizer = localizer_config(setup)};
  FlightEngine engine(store, made_of, {.clock = system_clock_millis, .keep_looks = setup.store != nullptr});
  engine.process({}, [&](std::size_t frame, FrameReport& report, bool restored) {
    collector.before(frame);
    EstimateRecord published{frame, report.estimate, report.odometry, report.state};
    published.estimate.latency_ms = 0;
    collector.result.published.push_back(std::move(published));
    collector.result.restored += restored ? 1U : 0U;
    collector.add(frame, std::move(report), restored);
  });
  collector.place_segments(engine);
  collector.result.refined = engine.refined();
  collector.result.poses = engine.refined_poses();
  if (setup.on_flown) setup.on_flown(store, engine, made_of);
}

void fly_recording(const Flight& flight, const ReplaySetup& setup, ReplayCollector& collector) {
  const int shrink = picture_shrink(flight, setup);
  const CameraFile camera = shrunk_camera(flight, shrink);
  Localizer localizer(camera, setup.frame, setup.tiles, setup.start, localizer_config(setup));
  RecordedOrder order(localizer, *setup.recorded);
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    collector.before(i);
    const auto before = std::chrono::steady_clock::now();
    const cv::Mat image = read_flight_image(flight.image_path(i), camera.camera, shrink);
    FrameReport report = order.frame(image, flight.frames[i], collector.result.published);
    const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - before;
    report.estimate.latency_ms = spent.count();  // including decoding
    collector.add(i, std::move(report));
  }
  collector.result.refined = localizer.refined();
  collector.result.poses = localizer.refined_poses();
}

}  // namespace

FlightDescription flight_description(const Flight& flight, SessionRecord session) {
  return {.name = flight.frames_folder.string(), .package = session.mission, .camera_text = {}, .session = session};
}

ReplayedFlight replay_flight(const Flight& flight, const ReplaySetup& setup, const Truth& truth, EstimatesCsv* csv,
                             Progress& progress) {
  ReplayCollector collector(flight, setup, truth, csv, progress);
  progress.begin("replay", flight.frames.size(), "frames");
  if (setup.recorded != nullptr) {
    fly_recording(flight, setup, collector);
  } else if (setup.store != nullptr) {
    fly_folder(flight, setup, *setup.store, collector);
  } else {
    SessionRecord session;
    session.camera = flight.camera;
    const auto store = FlightStore::in_memory(flight_description(flight, std::move(session)), system_clock_millis());
    fly_folder(flight, setup, *store, collector);
  }
  collector.finish();
  progress.end();
  return collector.take();
}

}  // namespace nadir
