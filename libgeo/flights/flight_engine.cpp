#include "flights/flight_engine.hpp"

#include <fmt/format.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>
#include <utility>

#include "base/error.hpp"
#include "flights/picture_at_one_moment.hpp"
#include "flights/recorded_vision.hpp"
#include "flights/shared_ground.hpp"
#include "imagery/codecs.hpp"
#include "recorder/record_codec.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr int kLookQuality = 80;  // of the JPEG images of looks

CameraFile shrunk(CameraFile camera, int shrink) {
  camera.camera = camera.camera.scaled(1.0 / shrink);
  return camera;
}

Bytes jpeg(const cv::Mat& image) {
  return image.empty() ? Bytes() : encode_image(image, ImageFormat::jpeg, kLookQuality);
}

cv::Mat image_of(const Bytes& jpeg) {
  return jpeg.empty() ? cv::Mat() : decode_image(jpeg, Colour::grey, "look").image;
}

}  // namespace

UtcMillis system_clock_millis() {
  using namespace std::chrono;
  return {duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count()};
}

struct FlightEngine::Impl {
  Impl(FlightStore& flight_store, const FlightEngineSetup& engine_setup, FlightEngineOptions engine_options)
      : store(flight_store),
        setup(engine_setup),
        camera(shrunk(engine_setup.camera, engine_setup.shrink)),
        options(std::move(engine_options)) {}

  // A localizer in the state after a number of frames.
  struct Running {
    explicit Running(const Impl& engine);

    RecordedVision vision;
    SegmentTracker segments;
    std::unique_ptr<Localizer> localizer;
    std::size_t frames = 0;
    bool live = false;
  };

  Running& running(const FrameListener& listener, const Cancel& cancel);
  void restore_frame(Running& now, const FrameListener& listener);
  void process_frame(Running& now, const BegunFrame& begun, const Cancel& cancel, const FrameListener& listener);
  cv::Mat decode(const Bytes& picture) const { return decode_camera_frame(picture, camera.camera, setup.shrink); }

  FlightStore& store;
  FlightEngineSetup setup;
  CameraFile camera;  // of the decoded pictures
  FlightEngineOptions options;
  std::unique_ptr<Running> current;  // none after something went wrong in the middle of a frame
  std::unique_ptr<SegmentPlacer> placer;
  std::unique_ptr<SharedGround> shared_ground;
};

FlightEngine::Impl::Running::Running(const Impl& engine) : segments(engine.setup.frame) {
  LocalizerConfig config = engine.setup.localizer;
  vision.attach(config);
  localizer =
      std::make_unique<Localizer>(engine.camera, engine.setup.frame, engine.setup.tiles, engine.setup.start, config);
}

FlightEngine::FlightEngine(FlightStore& store, const FlightEngineSetup& setup, const FlightEngineOptions& options)
    : impl_(std::make_unique<Impl>(store, setup, options)) {}

FlightEngine::~FlightEngine() = default;

// A frame as it was, without its picture.
void FlightEngine::Impl::restore_frame(Running& now, const FrameListener& listener) {
  const std::size_t frame = now.frames;
  const Telemetry telemetry = store.picture(frame).telemetry;
  StoredFrame stored = store.stored_frame(frame);
  auto answers = decode_answers(stored.answers);
  if (!answers) {
    throw Error({.what = fmt::format("the stored flight is damaged: what vision found in frame {}", frame),
                 .fix = "get the flight from a backup, or process its pictures again"});
  }
  now.vision.restore(frame, std::move(*answers));
  for (const UserFix& fix : store.fixes_before(frame)) now.localizer->hint(fix.hint.place, fix.hint.radius_m);
  FrameReport report = now.localizer->process({}, telemetry);
  now.vision.end_frame();
  report.estimate.latency_ms = stored.online.estimate.latency_ms;
  if (encode(Record(EstimateRecord{frame, report.estimate, report.odometry, report.state})) !=
      encode(Record(stored.online))) {
    throw Error({.what = fmt::format("frame {} is estimated differently than when it was processed", frame),
                 .expected = "the inputs and the version of Nadir that the flight was begun with",
                 .found = "another estimate from what vision found in the frame",
                 .fix = "go on with that version and those inputs, or process the flight from the start"});
  }
  now.segments.on_frame(report);
  report.anchor.rectified = image_of(stored.seen);
  report.anchor.matched_map = image_of(stored.map);
  ++now.frames;
  if (listener) listener(frame, report, true);
}

FlightEngine::Impl::Running& FlightEngine::Impl::running(const FrameListener& listener, const Cancel& cancel) {
  if (current) return *current;
  auto fresh = std::make_unique<Running>(*this);
  while (fresh->frames < store.processed()) {
    cancel.check();
    restore_frame(*fresh, listener);
  }
  current = std::move(fresh);
  return *current;
}

void FlightEngine::Impl::process_frame(Running& now, const BegunFrame& begun, const Cancel& cancel,
                                       const FrameListener& listener) {
  const auto started = std::chrono::steady_clock::now();
  if (!now.live) {
    now.vision.go_live([this](std::size_t frame) { return decode(store.read_picture(frame)); });
    now.live = true;
  }
  const Bytes picture = store.read_picture(begun.frame);
  const cv::Mat image = decode(picture);
  now.vision.begin_frame(begun.frame);
  for (const UserFix& fix : begun.fixes) now.localizer->hint(fix.hint.place, fix.hint.radius_m);
  Localizer::TrackedFrame tracked = now.localizer->track(image, begun.telemetry);
  FrameReport report = std::move(tracked.report);
  if (tracked.job) {
    tracked.job->run(cancel);
    const OdometryReport odometry = report.odometry;
    report = now.localizer->finish(std::move(tracked.job));
    report.odometry = odometry;
  }
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - started;
  report.estimate.latency_ms = spent.count();  // including decoding

  SegmentTracker::Changes changes = now.segments.on_frame(report);
  ProcessedFrame result{.frame = begun.frame,
                        .answers = encode_answers(now.vision.end_frame()),
                        .online = {begun.frame, report.estimate, report.odometry, report.state},
                        .anchor = report.anchor,
                        .seen = {},
                        .map = {},
                        .picture_bytes = picture.size(),
                        .segments = std::move(changes.segments),
                        .events = std::move(changes.events)};
  if (options.keep_looks) {
    result.seen = jpeg(report.anchor.rectified);
    result.map = jpeg(report.anchor.matched_map);
  }
  store.put_frame(result, options.clock());
  ++now.frames;
  if (listener) listener(begun.frame, report, false);
}

std::size_t FlightEngine::process(const Cancel& cancel, const FrameListener& listener) {
  Impl& s = *impl_;
  std::size_t processed = 0;
  Impl::Running& now = s.running(listener, cancel);
  for (cancel.check(); const auto begun = s.store.begin_frame(); cancel.check()) {
    try {
      s.process_frame(now, *begun, cancel, listener);
    } catch (const Error& error) {
      s.current.reset();  // it is in the middle of the frame
      s.store.abandon_frame();
      try {
        const nlohmann::json body{{"reason", error.text().what}, {"where", error.text().where}};
        s.store.append_event({FlightEventKind::processing_blocked, begun->frame,
                              body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)},
                             s.options.clock());
      } catch (const Error&) {  // a full disk takes no event either; what went wrong first is what matters
      }
      throw;
    } catch (...) {
      s.current.reset();
      s.store.abandon_frame();
      throw;
    }
    ++processed;
  }
  return processed;
}

bool FlightEngine::place_segments(SegmentPlacer::Scope scope, double seconds, const Cancel& cancel) {
  Impl& s = *impl_;
  if (s.setup.tiles == nullptr) return false;
  if (!s.placer) {
    const PlacerSetup setup{
        .camera = s.camera,
        .frame = s.setup.frame,
        .tiles = *s.setup.tiles,
        .localizer = s.setup.localizer,
        .read = [&s](std::size_t frame) { return picture_at_one_moment(s.store, frame, s.camera, s.setup.shrink); },
        .clock = s.options.clock};
    s.placer = std::make_unique<SegmentPlacer>(s.store, setup);
    s.shared_ground = std::make_unique<SharedGround>(s.store, setup);
  }
  using std::chrono::steady_clock;
  const auto end = steady_clock::now() + std::chrono::duration<double>(seconds);
  bool merged = false, more = true;
  while (more && steady_clock::now() < end) {
    PlacerOutcome outcome = s.placer->step(scope, cancel);
    // By the pictures of others what the map alone cannot place; not while pictures wait, because it takes longer.
    if (outcome == PlacerOutcome::nothing_to_do && scope == SegmentPlacer::Scope::all)
      outcome = s.shared_ground->step(cancel);
    merged = merged || outcome == PlacerOutcome::merged;
    more = outcome != PlacerOutcome::nothing_to_do;
  }
  if (merged)
    s.store.put_estimates(EstimateKind::refined, s.running({}, cancel).localizer->refined(), {}, s.options.clock());
  return more;
}

void FlightEngine::complete() {
  Impl& s = *impl_;
  const std::vector<Estimate> online = s.store.estimates(EstimateKind::online);
  std::size_t placed = 0, anchored = 0;
  for (const Estimate& estimate : online) {
    placed += estimate.position ? 1U : 0U;
    anchored += estimate.source == SourceLabel::satellite_anchored ? 1U : 0U;
  }
  std::size_t floating = 0;
  const std::vector<FlightSegment> segments = s.store.segments();
  for (const FlightSegment& segment : segments) floating += segment.state == SegmentState::floating ? 1U : 0U;
  const nlohmann::json body{{"frames", online.size()},
                            {"placed", placed},
                            {"anchored", anchored},
                            {"segments", segments.size()},
                            {"floating_segments", floating}};
  const StoredFlightEvent event{FlightEventKind::flight_completed, std::nullopt, body.dump()};
  s.store.put_estimates(EstimateKind::refined, s.running({}, {}).localizer->refined(), {&event, 1}, s.options.clock());
}

std::vector<Estimate> FlightEngine::refined() {
  std::vector<Estimate> refined = impl_->running({}, {}).localizer->refined();
  for (const EstimateRecord& placed : impl_->store.placed_estimates()) {
    if (placed.index < refined.size()) refined[placed.index] = placed.estimate;
  }
  return refined;
}

std::vector<std::optional<FramePose>> FlightEngine::refined_poses() {
  return impl_->running({}, {}).localizer->refined_poses();
}

std::vector<SmoothedFrame> FlightEngine::smoothed() { return impl_->running({}, {}).localizer->smoothed(); }

}  // namespace nadir
