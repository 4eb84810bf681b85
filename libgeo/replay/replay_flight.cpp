#include "replay/replay_flight.hpp"

#include <chrono>
#include <memory>
#include <utility>

#include "estimation/localizer.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr std::size_t kReportedFrames = 12;

std::optional<double> error_of(const Estimate& estimate, const std::optional<LonLat>& truth, const LocalFrame& frame) {
  return errors_m({estimate}, {truth}, frame).front();
}

// Feeds a flight to the localizer in the order of events in the air: hints and anchors that arrived between two frames
// arrive between them again.
class RecordedOrder {
 public:
  // recorded: null for a flight without recording: each frame is then localized before the next. Both must outlive
  // this.
  RecordedOrder(Localizer& localizer, const RecordedFlight* recorded) : localizer_(localizer), recorded_(recorded) {}

  // The next frame, and all events before the one after it. Every estimate is added to `estimates`; the report has the
  // last. Throws UsageError for a recorded hint that is not a valid position.
  FrameReport frame(const cv::Mat& image, const Telemetry& telemetry, std::vector<EstimateRecord>& estimates);

 private:
  void add(const FrameReport& report, std::vector<EstimateRecord>& estimates) const;
  void replay_events_until(std::uint64_t before, FrameReport& report, std::vector<EstimateRecord>& estimates);
  void finish(const LateAnchor& anchor, FrameReport& report, std::vector<EstimateRecord>& estimates);

  Localizer& localizer_;
  const RecordedFlight* recorded_;
  std::uint64_t index_ = 0;  // of the current frame
  std::size_t next_ = 0;     // of recorded_->between
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
  if (recorded_ == nullptr || !recorded_->session.looked_up_later) {
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
  if (recorded_ == nullptr) return;
  const auto& between = recorded_->between;
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

ReplayedFlight replay_flight(const Flight& flight, const ReplaySetup& setup, const Truth& truth, EstimatesCsv* csv,
                             Progress& progress) {
  const int shrink = picture_shrink(flight, setup);
  CameraFile camera = flight.camera;
  camera.camera = camera.camera.scaled(1.0 / shrink);
  Localizer localizer(camera, setup.frame, setup.tiles, setup.start, localizer_config(setup));
  RecordedOrder order(localizer, setup.recorded);
  ReplayedFlight result;
  WorstFrames worst(kReportedFrames);
  progress.begin("replay", flight.frames.size(), "frames");
  for (std::size_t i = 0; i < flight.frames.size(); ++i) {
    if (setup.recording != nullptr) setup.recording->before(i, flight.frames[i], flight.image_path(i));
    const auto before = std::chrono::steady_clock::now();
    const cv::Mat image = read_flight_image(flight.image_path(i), camera.camera, shrink);
    FrameReport report = order.frame(image, flight.frames[i], result.published);
    const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - before;
    report.estimate.latency_ms = spent.count();  // including decoding
    if (csv != nullptr) csv->write(report.estimate);
    if (setup.recording != nullptr) setup.recording->after(i, report);

    worst.offer(i, report_cost(report, error_of(report.estimate, truth[i], setup.frame)), report.anchor);
    report.anchor.rectified.release();
    report.anchor.matched_map.release();
    result.frames.push_back(std::move(report));
    progress.advance(1);
  }
  progress.end();
  result.refined = localizer.refined();
  result.poses = localizer.refined_poses();
  result.worst = worst.worst_first();
  return result;
}

}  // namespace nadir
