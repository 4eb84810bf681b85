#include "desk/live_flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/platform.hpp"
#include "base/yaml.hpp"
#include "cli/nadir_version.hpp"
#include "desk/package_registry.hpp"
#include "flight_adjustment/flight_adjustment.hpp"
#include "flight_adjustment/reconstruction_files.hpp"
#include "flights/picture_at_one_moment.hpp"
#include "replay/replay_flight.hpp"

namespace nadir {
namespace {

constexpr const char* kCompletionFile = "completion-requested";
constexpr const char* kReconstructionFile = "colmap.zip";
// Floating segments are placed while there is nothing else to do. Where pictures arrive without end, for so long of
// each period: one search or look after a frame.
constexpr std::chrono::seconds kPlacementPeriod{5}, kPlacementTime{2};
constexpr double kOneStep_s = 1e-6;
constexpr double kDiagnosis_s = 15;  // another flight may wait for its turn; chosen

// Gives its slot back, also on the way out of an exception.
class HeldSlot {
 public:
  HeldSlot(EngineSlots& slots, const std::stop_token& stop) : slots_(slots), stop_(stop), held_(slots.take(stop)) {}
  ~HeldSlot() {
    if (held_) slots_.give();
  }
  HeldSlot(const HeldSlot&) = delete;
  HeldSlot& operator=(const HeldSlot&) = delete;

  bool held() const { return held_; }
  void let_others() {
    if (!held_ || !slots_.wanted()) return;
    slots_.give();
    held_ = slots_.take(stop_);
  }

 private:
  EngineSlots& slots_;
  const std::stop_token& stop_;
  bool held_;
};

// How far an adjustment is: features and matching of pictures, then iterations; half of the time each, about.
class SharedProgress final : public Progress {
 public:
  SharedProgress(std::atomic<double>& share, std::atomic<std::uint64_t>& changes) : share_(share), changes_(changes) {}
  void begin(std::string_view, std::uint64_t total, std::string_view) override {
    begun_ = std::min(begun_ + 1, 2);
    total_ = std::max<std::uint64_t>(1, total);
    done_ = 0;
  }
  void advance(std::uint64_t steps) override {
    done_ += steps;
    const double part = std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_));
    share_ = 0.5 * (begun_ - 1 + part);
  }
  void end() override {
    share_ = 0.5 * begun_;
    ++changes_;
  }

 private:
  std::atomic<double>& share_;
  std::atomic<std::uint64_t>& changes_;
  int begun_ = 0;
  std::uint64_t done_ = 0, total_ = 1;
};

std::string diagnosis_of(const StoredFlightEvent& event) {
  const nlohmann::json body = nlohmann::json::parse(event.body, nullptr, false);
  const auto text = body.is_object() ? body.find("diagnosis") : body.end();
  return text != body.end() && text->is_string() ? text->get<std::string>() : std::string();
}

}  // namespace

bool EngineSlots::take(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  const std::uint64_t ticket = next_ticket_++;
  waiting_.push_back(ticket);
  const bool taken = news_.wait(lock, stop, [&] { return free_ > 0 && waiting_.front() == ticket; });
  std::erase(waiting_, ticket);
  if (taken) --free_;
  news_.notify_all();  // another one may be at the front now
  return taken;
}

void EngineSlots::give() {
  const std::lock_guard lock(mutex_);
  ++free_;
  news_.notify_all();
}

bool EngineSlots::wanted() const {
  const std::lock_guard lock(mutex_);
  return !waiting_.empty();
}

std::string_view name_of(FlightActivity activity) {
  switch (activity) {
    case FlightActivity::idle: return "idle";
    case FlightActivity::waiting: return "waiting";
    case FlightActivity::processing: return "processing";
    case FlightActivity::completing: return "completing";
    case FlightActivity::blocked: return "blocked";
  }
  return {};
}

LiveFlight::LiveFlight(std::string id, std::unique_ptr<FlightStore> store, const std::filesystem::path& folder,
                       PackageRegistry& packages, EngineSlots& slots, MillisClock clock)
    : id_(std::move(id)),
      store_(std::move(store)),
      completion_file_(folder / kCompletionFile),
      reconstruction_file_(folder / kReconstructionFile),
      packages_(packages),
      slots_(slots),
      clock_(std::move(clock)) {
  completion_requested_ = std::filesystem::exists(completion_file_);
  for (const EventRow& row : store_->events_of(FlightEventKind::diagnosis_changed)) {
    diagnosis_ = diagnosis_of(row.event);
    if (!diagnosis_.empty()) found_diagnosis_ = diagnosis_;
  }
  review_diagnosis();  // a kill may have come before the event
  const std::size_t processed = store_->processed();
  // Refined estimates belong to the frames that were there when the flight was completed.
  completed_ = processed > 0 && processed == store_->accepted() &&
               !store_->estimates(EstimateKind::refined, processed - 1, 1).empty();
  // A placement that a kill interrupted is made again.
  const auto floats = [](const FlightSegment& segment) {
    return segment.state == SegmentState::floating && segment.first_frame < segment.last_frame;
  };
  const std::vector<FlightSegment> segments = store_->segments();
  placement_due_ = has_map() && !completed_ && std::any_of(segments.begin(), segments.end(), floats);
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

LiveFlight::~LiveFlight() = default;

FlightStatus LiveFlight::status() const {
  FlightStatus status;
  status.processed = store_->processed();  // first: it never exceeds what is accepted
  status.accepted = store_->accepted();
  const std::lock_guard lock(mutex_);
  status.activity = activity_;
  status.blocked_by = blocked_by_;
  status.completion_requested = completion_requested_;
  status.diagnosis = diagnosis_;
  status.completed_share = activity_ == FlightActivity::completing ? completed_share_.load() : 0;
  status.completed = completed_ && status.accepted == status.processed;
  return status;
}

std::optional<std::string> LiveFlight::reconstruction() const {
  if (!std::filesystem::exists(reconstruction_file_)) return std::nullopt;
  return std::string(as_text(read_file(reconstruction_file_)));
}

bool LiveFlight::busy() const {
  const std::lock_guard lock(mutex_);
  return has_work();
}

bool LiveFlight::has_work() const {
  if (activity_ == FlightActivity::blocked) return false;
  return activity_ != FlightActivity::idle || completion_requested_ || placement_due_ ||
         store_->processed() < store_->accepted();
}

void LiveFlight::wake() {
  ++changes_;
  const std::lock_guard lock(mutex_);
  ++arrivals_;
  placement_due_ = has_map() && store_->accepted() > 0;
  if (activity_ == FlightActivity::blocked) activity_ = FlightActivity::idle;  // try again
  news_.notify_all();
}

std::vector<PictureAnswer> LiveFlight::accept(std::span<const PictureOffer> batch) {
  std::vector<PictureAnswer> answers = store_->accept(batch, clock_());
  wake();
  return answers;
}

UserFix LiveFlight::add_fix(const UserFix& said) {
  UserFix fix = store_->add_fix(said, clock_());
  wake();
  return fix;
}

std::optional<UserFix> LiveFlight::withdraw_fix(std::int64_t id) {
  auto fix = store_->withdraw_fix(id, clock_());
  ++changes_;
  return fix;
}

bool LiveFlight::take_back_merge(int segment) {
  const bool taken_back = store_->take_back_merge(segment, "desk", clock_());
  if (!taken_back) return false;
  review_diagnosis();
  wake();  // segments that were placed by this one may be placed in another way
  return true;
}

MarkedObject LiveFlight::add_object(std::string_view name, const MarkedSighting& first, std::string_view by) {
  MarkedObject object = store_->add_object(name, first, by, clock_());
  ++changes_;
  return object;
}

std::optional<MarkedObject> LiveFlight::add_sighting(std::int64_t object, const MarkedSighting& sighting) {
  auto changed = store_->add_sighting(object, sighting, clock_());
  ++changes_;
  return changed;
}

std::optional<MarkedObject> LiveFlight::rename_object(std::int64_t id, std::string_view name) {
  auto changed = store_->rename_object(id, name, clock_());
  ++changes_;
  return changed;
}

bool LiveFlight::remove_object(std::int64_t id) {
  const bool removed = store_->remove_object(id, clock_());
  ++changes_;
  return removed;
}

bool LiveFlight::remove_sighting(std::int64_t object, std::int64_t sighting) {
  const bool removed = store_->remove_sighting(object, sighting, clock_());
  ++changes_;
  return removed;
}

void LiveFlight::request_completion() {
  if (store_->accepted() == 0) {
    throw UsageError(
        {.what = "the flight has no pictures yet", .expected = "at least one", .fix = "send its pictures first"});
  }
  write_file_atomic(completion_file_, std::string_view("when all pictures are processed\n"));
  {
    const std::lock_guard lock(mutex_);
    completion_requested_ = true;
  }
  wake();
}

void LiveFlight::set(FlightActivity activity) {
  {
    const std::lock_guard lock(mutex_);
    activity_ = activity;
    if (activity != FlightActivity::blocked) blocked_by_.clear();
  }
  ++changes_;
}

// From the engine's thread, and from those that take placements back: one at a time.
void LiveFlight::review_diagnosis() {
  const std::lock_guard lock(mutex_);
  if (found_diagnosis_.empty()) return;
  const std::vector<FlightSegment> segments = store_->segments();
  const bool on_map = std::any_of(segments.begin(), segments.end(),
                                  [](const FlightSegment& each) { return each.state != SegmentState::floating; });
  const std::string holds = on_map ? std::string() : found_diagnosis_;
  if (holds == diagnosis_) return;
  const nlohmann::json body{{"diagnosis", on_map ? nlohmann::json() : nlohmann::json(holds)}};
  store_->append_event({FlightEventKind::diagnosis_changed, std::nullopt,
                        body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)},
                       clock_());
  diagnosis_ = holds;
  ++changes_;
}

void LiveFlight::watch(AnchorVerdict verdict, const std::stop_token& stop) {
  // Nobody else writes what was found.
  if (no_fix_watch_.due(verdict) && found_diagnosis_.empty()) {
    std::string found = diagnose(stop);
    const std::lock_guard lock(mutex_);
    found_diagnosis_ = std::move(found);
  }
  review_diagnosis();
}

// Of the pictures that are there: most flights begin with a batch. Where it cannot be made (a picture is gone, the desk
// closes) there is none: the flight goes on, and whatever stops it is found there.
std::string LiveFlight::diagnose(const std::stop_token& stop) const try {
  if (!package_) return {};
  const SessionRecord& session = store_->description().session;
  CameraFile camera = session.camera;
  camera.camera = camera.camera.scaled(1.0 / session.picture_shrink);
  std::vector<Telemetry> telemetry;
  for (std::size_t i = 0; i < std::min(store_->accepted(), kDiagnosedFrames); ++i) {
    telemetry.push_back(store_->picture(i).telemetry);
  }
  const TerrainSurface* surface = package_->surface ? &*package_->surface : nullptr;
  std::optional<double> ground_msl_m;
  if (surface != nullptr) ground_msl_m = surface->msl_m(session.start.value_or(package_->frame.origin()));
  const StatedFlight stated{
      .camera = camera,
      .frame = package_->frame,
      .tiles = *tiles_,
      .start = session.start,
      .area = session.localizer.area,
      .surface = surface,
      .places = package_->places ? &*package_->places : nullptr,
      .ground_msl_m = ground_msl_m,
      .telemetry = telemetry,
      .read = [&](std::size_t i) { return picture_at_one_moment(*store_, i, camera, session.picture_shrink); },
      .matcher = session.localizer.matcher};
  const DiagnosisBudget budget{.seconds = kDiagnosis_s, .cancel = Cancel([&stop] { return stop.stop_requested(); })};
  const auto found = diagnose_no_fix(stated, budget);
  return found ? found->text : std::string();
} catch (const Error&) {
  return {};
} catch (const Interrupted&) {
  return {};
}

std::unique_ptr<FlightEngine> LiveFlight::make_engine() {
  no_fix_watch_ = {};
  const FlightDescription& flight = store_->description();
  const SessionRecord& session = flight.session;
  FlightEngineSetup setup{.camera = session.camera,
                          .shrink = session.picture_shrink,
                          .frame = LocalFrame(session.origin),
                          .tiles = nullptr,
                          .start = session.start,
                          .localizer = session.localizer};
  setup.localizer.surface = nullptr;
  setup.localizer.places = nullptr;
  setup.localizer.matchability = nullptr;
  if (!flight.package.empty()) {
    const auto listing = packages_.find(flight.package);
    if (!listing || !listing->package) {
      throw Error({.what = "the flight's map package cannot be used",
                   .where = flight.package,
                   .found = listing ? listing->reason : "no such package",
                   .fix = "put the package back, and start the desk with its root of trust"});
    }
    package_ = listing->package;
    if (session.package && *session.package != package_->manifest) {
      throw Error({.what = "the map package is not the one that the flight was begun with",
                   .where = flight.package,
                   .expected = "a manifest of SHA-256 " + session.package->hex(),
                   .found = package_->manifest.hex(),
                   .fix = "put that package back, or begin a new flight with this one"});
    }
    tiles_ = package_->package->another_imagery_reader();
    setup.frame = package_->frame;
    setup.tiles = tiles_.get();
    if (session.terrain && package_->surface) setup.localizer.surface = &*package_->surface;
    if (session.places && package_->places) setup.localizer.places = &*package_->places;
    if (session.matchability) setup.localizer.matchability = package_->package->matchability();
  }
  setup_ = setup;
  return std::make_unique<FlightEngine>(*store_, setup, FlightEngineOptions{.clock = clock_, .keep_looks = true});
}

void LiveFlight::adjust(FlightEngine& engine, const Cancel& cancel) {
  SharedProgress progress(completed_share_, changes_);
  const AdjustedFlight adjusted = adjust_flight(flight_to_adjust(*store_, engine, *setup_), progress, cancel);
  write_file_atomic(reconstruction_file_,
                    std::string_view(zip_archive(reconstruction_files(adjusted, setup_->camera.camera))));
  store_->put_adjustment(adjusted.estimates, adjusted_poses(adjusted), refinement_events(adjusted), clock_());
}

void LiveFlight::work(const std::stop_token& stop, std::unique_ptr<FlightEngine>& engine) {
  set(FlightActivity::waiting);
  HeldSlot slot(slots_, stop);
  if (!slot.held()) throw Interrupted();
  set(FlightActivity::processing);
  if (!engine) engine = make_engine();
  const Cancel cancel([&stop] { return stop.stop_requested(); });
  auto period = std::chrono::steady_clock::now();
  const std::size_t processed = engine->process(cancel, [&](std::size_t /*frame*/, FrameReport& report, bool restored) {
    ++changes_;
    watch(report.anchor.verdict, stop);
    slot.let_others();
    if (restored) return;
    const auto now = std::chrono::steady_clock::now();
    if (now - period >= kPlacementPeriod) period = now;
    if (now - period < kPlacementTime) engine->place_segments(SegmentPlacer::Scope::closed, kOneStep_s, cancel);
  });
  review_diagnosis();
  bool complete = false;
  {
    const std::lock_guard lock(mutex_);
    if (processed > 0) completed_ = false;
    complete = completion_requested_ && store_->processed() == store_->accepted();
    if (complete) activity_ = FlightActivity::completing;
  }
  const auto let_others = [&slot] { slot.let_others(); };
  if (!place_segments(*engine, let_others, stop) || !complete) return;
  engine->complete();
  ++changes_;
  const auto interrupted = [&] {
    slot.let_others();
    return stop.stop_requested() || store_->processed() < store_->accepted();
  };
  completed_share_ = 0;
  try {
    adjust(*engine, Cancel(interrupted));
  } catch (const Interrupted&) {
    if (stop.stop_requested()) throw;
    return;  // new pictures first
  }
  std::error_code ignored;
  std::filesystem::remove(completion_file_, ignored);  // one that stays asks for the same once more
  const std::lock_guard lock(mutex_);
  completion_requested_ = false;
  completed_ = true;
}

bool LiveFlight::place_segments(FlightEngine& engine, const std::function<void()>& let_others,
                                const std::stop_token& stop) {
  const Cancel cancel([&stop] { return stop.stop_requested(); });
  std::uint64_t arrivals = 0;
  {
    const std::lock_guard lock(mutex_);
    arrivals = arrivals_;
  }
  while (engine.place_segments(SegmentPlacer::Scope::all, kOneStep_s, cancel)) {
    review_diagnosis();
    ++changes_;
    let_others();
    const std::lock_guard lock(mutex_);
    if (arrivals != arrivals_) return false;
  }
  review_diagnosis();
  ++changes_;
  const std::lock_guard lock(mutex_);
  if (arrivals != arrivals_) return false;
  placement_due_ = false;
  return true;
}

void LiveFlight::run(const std::stop_token& stop) {
  begin_thread("flight", ThreadPriority::normal);
  std::unique_ptr<FlightEngine> engine;
  for (;;) {
    std::uint64_t arrivals = 0;
    {
      std::unique_lock lock(mutex_);
      if (!news_.wait(lock, stop, [this] { return has_work(); }) || stop.stop_requested()) return;
      arrivals = arrivals_;
    }
    std::string problem;
    try {
      work(stop, engine);
      set(FlightActivity::idle);
      continue;
    } catch (const Interrupted&) {
      return;
    } catch (const Error& error) {
      problem = error.text().what + (error.text().found.empty() ? "" : ": " + error.text().found) +
                (error.text().fix.empty() ? "" : "; " + error.text().fix);
    } catch (const std::exception& error) {
      problem = error.what();
    }
    engine.reset();
    ++changes_;
    const std::lock_guard lock(mutex_);
    activity_ = arrivals == arrivals_ ? FlightActivity::blocked : FlightActivity::idle;
    blocked_by_ = std::move(problem);
  }
}

FlightDescription describe_flight(std::string name, std::string_view camera_text, const std::optional<LonLat>& start,
                                  const std::string& package_name, const DeskPackage* package) {
  if (package == nullptr && !start) {
    throw UsageError({.what = "a flight without a map package needs a start",
                      .expected = "the position of the first picture: odometry alone cannot find it",
                      .fix = "give \"start\", or a \"package\""});
  }
  const CameraFile camera = read_camera(YamlNode::parse(camera_text, "camera"));
  ReplaySetup setup{.frame = package != nullptr ? package->frame : LocalFrame(*start),
                    .tiles = nullptr,
                    .start = start,
                    .integrity_risk = std::nullopt,
                    .area = std::nullopt};
  if (package != nullptr) {
    const Mission& mission = package->package->mission();
    setup.area = required_region(mission, package->frame).bounds();
    setup.integrity_risk = mission.integrity.risk;
    setup.surface = package->surface ? &*package->surface : nullptr;
    setup.places = package->places ? &*package->places : nullptr;
    setup.matchability = package->package->matchability();
  }
  SessionRecord session;
  session.program = "nadir desk";
  session.version = kVersion;
  if (package != nullptr) {
    session.package = package->manifest;
    session.mission = package->package->manifest().mission_id;
  }
  session.camera = camera;
  session.origin = setup.frame.origin();
  session.start = start;
  session.picture_shrink = decode_reduction(camera.camera.width, camera.camera.height);
  session.localizer = localizer_config(setup);
  session.terrain = setup.surface != nullptr;
  session.places = setup.places != nullptr;
  session.matchability = setup.matchability != nullptr;
  session.settings = {{"odometry", "features"}, {"matcher", "channels"}};
  return {.name = std::move(name),
          .package = package_name,
          .camera_text = std::string(camera_text),
          .session = std::move(session)};
}

}  // namespace nadir
