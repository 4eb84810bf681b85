#include "flight/flight_service.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/error.hpp"
#include "fixes/fix_stream.hpp"
#include "mavlink/commands.hpp"
#include "service/service_rules.hpp"
#include "vision/descriptor_matcher.hpp"

namespace nadir {
namespace {

constexpr double kTurn_s = 0.05, kViewPeriod_s = 0.2, kFiguresPeriod_s = 1;

// The autopilot navigates by our fix: its attitude depends on our fix, and our fix on its attitude. The uncertainty in
// the airframe file was measured with GPS; with fixes of a localizer that trusted it, ArduPlane's attitude drifted by
// 17 and 5 degrees (docs/closed-loop.md).
Airframe fix_aided(Airframe airframe) {
  TelemetryUncertainty& attitude = airframe.camera.uncertainty;
  attitude.heading_rad = std::max(attitude.heading_rad, kFixAidedHeading_rad);
  attitude.tilt_rad = std::max(attitude.tilt_rad, kFixAidedTilt_rad);
  return airframe;
}

ServiceConfig service_config(const OpenPackage* package, const Airframe& airframe) {
  ServiceConfig config;
  if (!airframe.parameters.empty()) config.parameters = ParameterCheck::pending;
  if (package == nullptr) return config;
  const IntegrityRequirement& integrity = package->mission().integrity;
  config.integrity_risk = integrity.risk;
  config.alert_limit_m = integrity.alert_limit_m;
  config.time_to_alert_s = integrity.time_to_alert_s;
  return config;
}

// A camera that cannot be opened yet: a plug-in or a file is missing. CameraFeed reports it and asks again.
class AwaitedCamera final : public CameraSource {
 public:
  using Open = std::function<std::unique_ptr<CameraSource>()>;
  explicit AwaitedCamera(Open open) : open_(std::move(open)) {}

  CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) override {
    try {
      if (!camera_) camera_ = open_();
    } catch (const std::exception& error) {
      return {CameraStatus::failure, {}, error.what()};
    }
    return camera_->next(at_most, std::move(stop));
  }
  std::string describe() const override { return camera_ ? camera_->describe() : "no camera yet"; }

 private:
  Open open_;
  std::unique_ptr<CameraSource> camera_;
};

}  // namespace

// ---- start and end

// Wrong names, keys and addresses are found before there are threads. The camera's thread comes last: before the first
// frame nobody uses the link.
FlightService::FlightService(const FlightOptions& options, VerifiedPackage verified, const FlightClock& clock,
                             StopSignals& stop, Log log)
    : options_(options),
      clock_(clock),
      stop_(stop),
      log_(std::move(log)),
      airframe_(fix_aided(options.airframe)),
      package_{.findings = std::move(verified.findings),
               .rejection = {},
               .notice = std::move(verified.notice),
               .notice_text = std::move(verified.notice_text),
               .resumed = verified.resumed},
      acceptance_{.phase = FlightPhase(verified.acceptance && verified.acceptance->airborne),
                  .record = std::move(verified.acceptance)},
      machine_(clock.monotonic_s(), service_config(verified.package.get(), options.airframe)),
      gps_{.health = GpsHealth(clock.monotonic_s())},
      views_(fmt::format("{:x}", clock.unix_us())),
      manager_(read_service_environment().notify_socket),
      watch_(clock) {
  if (const auto camera = mavlink_camera(options_.camera)) {
    stream_finder_ = std::make_unique<VideoStreamFinder>(airframe_.system, *camera, airframe_.camera.camera.width,
                                                         airframe_.camera.camera.height);
  }
  const std::filesystem::path folder = verified.folder.empty() ? options.package : verified.folder;
  if (verified.package) map_ = std::make_unique<MissionMap>(std::move(verified.package), folder);
  // After the map: reading a large place index takes seconds of flight.
  restart_ = restart_from(StateDirectory(options_.state).load(), clock, acceptance_.phase.airborne());
  if (restart_.position) gps_.health.on_restart();
  const PackageView view = map_ ? package_view(map_->package()) : refused_package(package_.findings);
  views_.set_package(view);
  if (map_) views_.set_integrity(map_->integrity());
  package_.rejection = view.reason;
  make_parts(std::move(verified));
  std::unique_ptr<CameraSource> camera;
  if (map_) camera = opened_camera();
  upkeep_->tend();  // what works is there before the first frame
  journal_.use(parts_->recorder());
  if (map_) start_localization();
  start_link();
  if (map_) start_camera(std::move(camera));
  upkeep_->start(*link_);
}

FlightService::~FlightService() {
  if (localization_) localization_->request_stop();  // a map match takes longest to end
  camera_.reset();
  link_->stop();  // localizer and link use each other
  localization_.reset();
  if (const std::string failure = upkeep_->finish(); log_ && !failure.empty()) {
    log_("the end of the flight could not be saved: " + on_one_line(failure));
  }
  parts_->close();
}

// What the localizer starts from, and what the recorder says that it started from.
LocalizationSetup FlightService::localization_setup() {
  LocalizationSetup setup{airframe_.camera, airframe_.mount, map_->frame(),      &map_->package().imagery(),
                          options_.start,   map_->config(),  map_->plane_msl_m()};
  setup.config.anchor_every_m = options_.anchor_every_m;
  setup.inertial = options_.inertial;
  if (options_.second_matcher) {
    setup.config.matcher =
        make_second_opinion({.second = [network = options_.second_matcher](
                                           const MatcherMap& map) { return make_descriptor_matcher(map, network); },
                             .use = options_.second_matcher_use,
                             .on_failure =
                                 [this](const std::string& reason) {
                                   publish(PartReported{"second matcher", reason, 0});
                                 }});
    setup.settings = {second_matcher_setting(options_.second_matcher->name(), options_.second_matcher_use)};
  }
  if (restart_.position) {
    setup.start = restart_.position->place;
    setup.config.start_sigma_m = restart_.position->sigma_m;
    setup.config.resumed = true;
  }
  return setup;
}

void FlightService::make_parts(VerifiedPackage verified) {
  const auto publisher = [this](OnboardEvent event) { publish(std::move(event)); };
  OptionalPartsSetup parts{.recording = options_.recording,
                           .api = options_.api,
                           .candidates = options_.candidates,
                           .state = options_.state,
                           .airframe = airframe_,
                           .map = map_.get(),
                           .localization = std::nullopt,
                           .findings = package_.findings,
                           .root_version = verified.root_version};
  if (map_) parts.localization = localization_setup();
  parts_ = std::make_unique<OptionalParts>(std::move(parts), clock_, publisher);
  UpkeepSetup upkeep{
      .state = options_.state, .acceptance = acceptance_.record, .write_memory = std::move(verified.write_memory)};
  if (!map_) upkeep.can_be_opened = std::move(verified.can_be_opened);
  upkeep_ = std::make_unique<Upkeep>(std::move(upkeep), *parts_, clock_, publisher);
}

// Wrong usage is found before the flight; a camera that is not there yet is waited for.
std::unique_ptr<CameraSource> FlightService::opened_camera() const {
  const auto open_source = [this](const std::string& source) {
    const auto& file = options_.camera_credentials;
    return open_camera(file ? with_credentials(source, *file) : source, clock_);
  };
  if (stream_finder_) return std::make_unique<StreamCamera>(*stream_finder_, open_source);
  const auto open = [this, open_source] { return open_source(options_.camera); };
  try {
    return open();
  } catch (const UsageError&) {
    throw;
  } catch (const std::exception&) {
    return std::make_unique<AwaitedCamera>(open);
  }
}

void FlightService::start_localization() {
  LocalizationThread::Listener listener;
  listener.on_frame = [this](std::uint64_t index, const Telemetry& telemetry, ByteView encoded) {
    if (Recorder* recorder = parts_->recorder()) record_input(*recorder, index, telemetry, encoded);
    if (TileMaking* tiles = parts_->tiles()) tiles->on_frame(index, telemetry, encoded);
  };
  listener.on_localized = [this](const LocalizedFrame& frame) { on_localized(frame); };
  listener.on_hint = [this](const HintRecord& hint) {
    if (Recorder* recorder = parts_->recorder()) recorder->record(hint);
  };
  listener.on_match_failed = [this](const std::string& reason) { publish(MatchFailed{reason}); };
  localization_ = std::make_unique<LocalizationThread>(localization_setup(), frames_, watch_, std::move(listener));
  if (restart_.hint) localization_->hint(restart_.hint->place, restart_.hint->radius_m, "restart");
}

void FlightService::start_link() {
  AutopilotLinkSetup setup{.airframe = airframe_,
                           .transport = make_transport(parse_endpoint(options_.autopilot)),
                           .key = std::nullopt,
                           .state = options_.state,
                           .stations = options_.stations,
                           .switch_gps = options_.switch_gps};
  if (options_.link_key) setup.key = SigningKey::read(*options_.link_key);
  AutopilotLink::Listener listener;
  listener.on_message = [this](const MessageTimes& times, const ReceivedMessage& message) {
    on_message(times, message);
  };
  listener.on_jump = [this](double distance_m) { publish(FixJumped{distance_m}); };
  listener.on_unauthenticated_peer = [this] { publish(AutopilotHeartbeat{LinkAuthentication::missing, false}); };
  listener.on_fix = [this](DueFix due) { record_fix(std::move(due)); };
  listener.on_parameters = [this](OnboardEvent event) { publish(std::move(event)); };
  listener.on_rival = [this](std::uint64_t frames) { publish(LinkRivalSeen{frames}); };
  HintIntake::MapDistance distance_m;
  if (map_) distance_m = [this](const LonLat& place) { return map_->distance_m(place); };
  hint_intake_.emplace(MavlinkAddress{airframe_.system, airframe_.component}, std::move(distance_m));
  link_ = std::make_unique<AutopilotLink>(std::move(setup), clock_, watch_, std::move(listener));
  link_->start();  // on_command() uses link_
}

void FlightService::start_camera(std::unique_ptr<CameraSource> source) {
  camera_ = std::make_unique<CameraFeed>(std::move(source), airframe_.capture_delay_s, clock_, frames_, watch_,
                                         [this](OnboardEvent event) { publish(std::move(event)); });
}

// ---- on the threads of the parts: each passes on what it has and never waits

void FlightService::publish(OnboardEvent event) { events_.put({clock_.monotonic_s(), std::move(event)}); }

// On the localizer's thread.
void FlightService::on_localized(const LocalizedFrame& frame) {
  const Estimate& estimate = frame.report.estimate;
  const double captured_s = frame.telemetry.time_s;
  if (estimate.position) {
    const std::optional<double> arrived_s =
        frame.late ? std::nullopt : std::optional(captured_s + airframe_.capture_delay_s);
    const auto vision = vision_estimate(estimate, frame.report.state, captured_s,
                                        map_->ground_msl_m(*estimate.position), map_->integrity().risk);
    if (vision) link_->on_estimate({frame.index, frame.late}, *vision, arrived_s);
    if (options_.send_external_position && vision && frame.report.anchor.verdict == AnchorVerdict::accepted) {
      const double now_s = clock_.monotonic_s();
      link_->send(external_position_estimate({airframe_.system, airframe_.autopilot},
                                             {*estimate.position, vision->sigma_m, now_s, now_s - captured_s}));
    }
  }
  Recorder* recorder = parts_->recorder();
  TileMaking* tiles = parts_->tiles();
  if (recorder != nullptr && frame.late) record_anchor(*recorder, frame.anchor_index, frame.index, frame.report);
  if (recorder != nullptr && !frame.late) record_frame(*recorder, frame.index, frame.report);
  if (tiles != nullptr && frame.report.anchor_pose) tiles->on_anchor(frame.anchor_index, *frame.report.anchor_pose);
  LocalizedFrame event = frame;
  event.report.anchor.rectified.release();  // only the recorder needs the images
  event.report.anchor.matched_map.release();
  publish(std::move(event));
}

// On the link's thread.
void FlightService::on_message(const MessageTimes& times, const ReceivedMessage& received) {
  const bool ours = received.source.system == airframe_.system && received.source.component == airframe_.autopilot;
  const auto telemetry = [&](const auto& message) {
    if (ours && localization_) localization_->on_message(times.arrived_s, message);
  };
  if (const auto* heartbeat = std::get_if<Heartbeat>(&received.message)) {
    if (ours && is_supported(heartbeat->autopilot)) {
      autopilot_ = heartbeat->autopilot;
      publish(AutopilotHeartbeat{received.is_signed ? LinkAuthentication::signature : LinkAuthentication::not_required,
                                 heartbeat->armed});
    }
  } else if (const auto* attitude = std::get_if<AircraftAttitude>(&received.message)) {
    telemetry(*attitude);
  } else if (const auto* gimbal = std::get_if<GimbalAttitude>(&received.message)) {
    on_gimbal(times, received.source, *gimbal);
  } else if (const auto* position = std::get_if<GlobalPosition>(&received.message)) {
    telemetry(*position);
  } else if (const auto* distance = std::get_if<GroundDistance>(&received.message)) {
    telemetry(*distance);
  } else if (const auto* height = std::get_if<GroundHeight>(&received.message)) {
    telemetry(*height);
  } else if (const auto* imu = std::get_if<ImuSample>(&received.message)) {
    telemetry(*imu);
  } else if (const auto* gps = std::get_if<GpsRaw>(&received.message)) {
    if (ours && is_real_receiver(autopilot_, *gps, airframe_.gps_id)) {
      telemetry(*gps);
      receiver_ = TimedReceiver{times.read_s, *gps};
      publish(GpsFix3d{times.read_s, gps->fix >= GpsFix::three_d, gps->place, gps->ground_speed_mps,
                       gps->horizontal_accuracy_m});
    }
  } else if (const auto* ekf = std::get_if<EkfStatus>(&received.message)) {
    if (ours) publish(EkfReport{times.read_s, ekf->horizontal_position_absolute, ekf->gps_glitching});
  } else if (const auto* estimator = std::get_if<EstimatorStatus>(&received.message)) {
    if (!ours) return;
    const bool glitch = estimator->gps_glitching && !link_->gps_is_off();
    publish(EkfReport{times.read_s, estimator->horizontal_position_absolute, glitch});
  } else if (stream_finder_ && received.source.system == airframe_.system) {
    stream_finder_->on_message(received.source, received.message);
    on_command(times.read_s, received);
  } else {
    on_command(times.read_s, received);
  }
}

// On the link's thread. Of the gimbal that carries the camera alone.
void FlightService::on_gimbal(const MessageTimes& times, MavlinkAddress source, const GimbalAttitude& attitude) {
  if (!airframe_.gimbal || source != MavlinkAddress{airframe_.system, airframe_.gimbal->component} ||
      attitude.device != airframe_.gimbal->device || attitude.faulty) {
    return;
  }
  gimbal_s_ = times.read_s;
  if (localization_) localization_->on_message(times.arrived_s, attitude);
}

// On the link's thread.
void FlightService::on_command(double now_s, const ReceivedMessage& received) {
  const HintIntake::Answer answer = hint_intake_->on_message(now_s, received, position_known_);
  if (answer.hint) publish(*answer.hint);
  if (!answer.refusal.empty()) {
    publish(HintRefused{answer.refusal, fmt::format("{}/{}", received.source.system, received.source.component)});
  }
  if (answer.acknowledgement) link_->send(*answer.acknowledgement);
}

// On the link's thread. The recorder queues the record and never waits.
void FlightService::record_fix(DueFix due) {
  Recorder* recorder = parts_->recorder();
  if (recorder == nullptr) return;
  std::optional<FixRecord> sent;
  if (due.inputs.sent) sent = fix_record(due);
  if (sent && receiver_) {
    const GpsRaw& gps = receiver_->gps;
    sent->gps = FixRecord::Receiver{std::max(0.0, sent->time_s - receiver_->time_s), static_cast<int>(gps.fix),
                                    gps.place, gps.msl_m, gps.horizontal_accuracy_m};
  }
  recorder->record(std::move(due.inputs));
  if (sent) recorder->record(*std::move(sent));
}

// ---- the conductor

FlightEnd FlightService::run() {
  note_start();
  on_event(clock_.monotonic_s(), PackageVerified{map_ != nullptr, map_ ? package_.notice : package_.rejection});
  if (restart_.position && restart_.position->sigma_m <= kNoFixSigma_m) {
    on_event(clock_.monotonic_s(), EstimateRestored{restart_.position->sigma_m, restart_.position->speed_mps});
  }
  manager_.ready(map_ ? "flying" : "map package rejected: " + package_.rejection);
  Watchdog watchdog(watch_, manager_, read_service_environment().watchdog_interval_s, clock_.monotonic_s());
  Cadence views(kViewPeriod_s, clock_.monotonic_s()), saves(kSavePeriod_s, clock_.monotonic_s()),
      figures(kFiguresPeriod_s, clock_.monotonic_s());
  AwaitedParts awaited = awaited_parts();
  double next_s = clock_.monotonic_s();
  while (!acceptance_.reselect_package && clock_.wait_until(next_s, stop_.token())) {
    const double now_s = clock_.monotonic_s();
    next_s = now_s + kTurn_s;
    while (const auto published = events_.try_take()) on_event(published->time_s, published->event);
    if (const auto hint = parts_->take_hint()) on_event(now_s, PositionHinted{hint->place, hint->radius_m, "API"});
    assess_gps(now_s);
    on_transitions(machine_.update(now_s));
    ask_for_hint(now_s);
    if (stream_finder_ && map_) {
      for (const CommandLong& request : stream_finder_->requests(now_s)) link_->send(request);
    }
    if (views.due(now_s)) update_view(now_s);
    if (figures.due(now_s)) send_figures(now_s);
    if (saves.due(now_s)) {
      save(now_s);
      report_corrupt_tiles();
    }
    for (const std::string& line : awaited.update(now_s)) {
      if (log_) log_(line);
    }
    if (const auto late = watchdog.tick(now_s)) {
      journal_.note(now_s, late->empty() ? EventSeverity::info : EventSeverity::critical, "thread",
                    late->empty() ? "all threads respond again" : *late);
    }
  }
  if (!acceptance_.reselect_package) manager_.stopping("stopping");
  save(clock_.monotonic_s());
  note_end();
  return acceptance_.reselect_package && !stop_.token().stop_requested() ? FlightEnd::reselect_package
                                                                         : FlightEnd::stopped;
}

// Each part takes the events that concern it.
void FlightService::on_event(double time_s, const OnboardEvent& event) {
  const auto dispatch = [&](const auto& known) {
    if constexpr (requires { gps_.health.on_event(known); }) gps_.health.on_event(known);
    if constexpr (requires { views_.on_event(known); }) views_.on_event(known);
    if constexpr (requires { react(time_s, known); }) react(time_s, known);
  };
  std::visit(dispatch, event);
  journal_.on_event(time_s, event);
  on_transitions(machine_.on_event(time_s, event));
}

void FlightService::react(double, const LocalizedFrame& frame) { last_.frame = frame; }

// Take-off and landing, as what was accepted needs to know them.
void FlightService::react(double time_s, const AutopilotHeartbeat& heartbeat) {
  if (heartbeat.authentication != LinkAuthentication::missing) armed_ = heartbeat.armed;
  if (heartbeat.authentication == LinkAuthentication::missing || !acceptance_.record) return;
  const FlightPhase::Change change = acceptance_.phase.on_heartbeat(time_s, heartbeat.armed);
  if (change == FlightPhase::Change::none) return;
  acceptance_.record->airborne = acceptance_.phase.airborne();
  if (change == FlightPhase::Change::landed) acceptance_.record->boot_id.clear();
  upkeep_->save(*acceptance_.record);
  const bool landed = change == FlightPhase::Change::landed;
  journal_.note(time_s, EventSeverity::info, "package",
                landed ? "landed: the next start judges the package anew" : "armed: accepted until the landing");
  // Resumed without a clock, and the aircraft does not fly: a flight that ended while nobody was listening.
  acceptance_.reselect_package =
      acceptance_.reselect_package || (landed && package_.resumed && !acceptance_.phase.armed_ever());
}

void FlightService::react(double, const PackageRestored&) { acceptance_.reselect_package = true; }

void FlightService::react(double, const PartReported& reported) {
  const bool failed = !reported.failure.empty();
  operator_texts_.add(failed ? TextSeverity::warning : TextSeverity::info,
                      fmt::format("Nadir: {} {}", reported.part, failed ? "failed, trying again" : "works again"));
  if (log_) log_(reported.part + ": " + text_of(reported));
  if (reported.part == "recorder" && !failed) journal_.use(parts_->recorder());
  if (reported.part == "recorder") last_.recorder_failure = reported.failure;
}

void FlightService::react(double, const CameraFailed& failed) { last_.camera_failure = failed.reason; }

void FlightService::react(double, const TileCorrupt&) {
  if (last_.corrupt_tiles++ == 0)
    operator_texts_.add(TextSeverity::critical, "Nadir: CORRUPT MAP TILES, check storage");
}

void FlightService::react(double, const FixJumped& jumped) { link_->send_text(TextSeverity::warning, text_of(jumped)); }

void FlightService::react(double, const LinkRivalSeen&) {
  link_->send_text(TextSeverity::critical, "Nadir: another sender claims to be autopilot");
}

void FlightService::react(double, const ParameterChanged& changed) {
  if (changed.restored()) return;
  operator_texts_.add(TextSeverity::critical,
                      fmt::format("Nadir: {} was changed, is {:g}", changed.name, changed.found));
}

void FlightService::react(double, const ParametersMissing& missing) {
  const std::string what =
      missing.names.size() == 1 ? missing.names.front() : fmt::format("{} parameters", missing.names.size());
  operator_texts_.add(TextSeverity::critical, fmt::format("Nadir: {} missing, provision again", what));
}

void FlightService::react(double, const AutopilotVersionChanged& changed) {
  if (changed.as_expected) return;
  operator_texts_.add(TextSeverity::critical, fmt::format("Nadir: PX4 is {}, provision again", changed.version));
}

void FlightService::react(double, const PositionHinted& hint) {
  if (localization_) localization_->hint(hint.place, hint.radius_m, hint.source);
}

void FlightService::react(double, const HintRefused& refused) {
  operator_texts_.add(TextSeverity::warning, "Nadir: hint refused, " + refused.reason);
}

// A trusted GPS says where to search first; never where we are.
void FlightService::react(double time_s, const GpsFix3d& fix) {
  if (gps_.verdict != GpsVerdict::trusted || !fix.has_fix) return;
  const bool position_known = last_.frame && last_.frame->report.estimate.position;
  if (gps_.hints.due(fix.place, position_known)) on_event(time_s, PositionHinted{fix.place, kGpsHintRadius_m, "GPS"});
}

void FlightService::assess_gps(double now_s) {
  const ServiceStatus status = machine_.status();
  if (status.fix) gps_.health.our_fix_in_use(now_s);
  const GpsAssessment assessment = gps_.health.assess(now_s, status.link_up);
  if (assessment.verdict == gps_.verdict) return;
  gps_.verdict = assessment.verdict;
  on_event(now_s, assessment);
}

void FlightService::on_transitions(std::span<const StateTransition> transitions) {
  for (const StateTransition& transition : transitions) {
    journal_.on_event(transition.time_s, transition);
    const ReasonText& text = text_of(transition.reason);
    const auto severity = static_cast<TextSeverity>(text.severity);  // both have MAVLink's values
    if (transition.reason == ServiceReason::link_unsigned) {
      link_->send_text(severity, std::string(text.operator_text));  // now, without authentication: later it is useless
    } else {
      operator_texts_.add(severity, std::string(text.operator_text));
    }
    manager_.status(transition.text);
  }
  const ServiceStatus status = machine_.status();
  position_known_ = status.fix;
  link_->on_status(status);
  if (!status.link_up) return;
  operator_texts_.deliver([this](TextSeverity severity, const std::string& text) { link_->send_text(severity, text); });
}

void FlightService::update_view(double now_s) {
  const ServiceStatus status = machine_.status();
  views_.set_status(status, machine_.reason_text());
  views_.set_frames(frame_counts(), now_s);
  const AutopilotLink::State link = link_->state();
  views_.set_link(link, status.link_up, options_.link_key.has_value());
  Recorder* recorder = parts_->recorder();
  views_.set_recorder(recorder, last_.recorder_failure);
  if (recorder != nullptr) {
    const StoreStatus status_of_disk = recorder->status();
    std::string failure = status_of_disk.stopped ? status_of_disk.error : std::string();
    if (status_of_disk.stopped && failure.empty()) failure = "nothing can be written";
    if (auto reported = disk_part_.note(now_s, failure)) {
      on_event(now_s, *reported);
    }
  }
  views_.restrict_to_fix(status, link.last_fix, now_s);
  parts_->show(views_.view(now_s, clock_.unix_us(), journal_.events(), journal_.alarms()));
}

// For ground stations, once a second: what a figure cannot say is NaN.
void FlightService::send_figures(double now_s) {
  const ServiceStatus status = machine_.status();
  if (!status.link_up) return;
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const std::optional<double> anchor_age_s = views_.anchor_age_s(now_s);
  const std::pair<std::string_view, double> figures[] = {{"NDR_STATE", static_cast<double>(status.state)},
                                                         {"NDR_SIGMA", status.fix ? status.sigma_m : kNone},
                                                         {"NDR_HPL", status.hpl_m.value_or(kNone)},
                                                         {"NDR_ANCHOR", anchor_age_s.value_or(kNone)}};
  const auto boot_ms = static_cast<std::uint32_t>(std::llround(now_s * 1000));
  for (const auto& [name, value] : figures) {
    link_->send(NamedValue{boot_ms, std::string(name), static_cast<float>(value)});
  }
}

// A trusted GPS hints by itself.
void FlightService::ask_for_hint(double now_s) {
  const ServiceStatus status = machine_.status();
  const bool has_position = !map_ || status.fix || status.gps == GpsVerdict::trusted;
  if (!hint_request_.due(now_s, armed_, has_position)) return;
  journal_.note(now_s, EventSeverity::warning, "hint", "no position: the operator is asked for one");
  operator_texts_.add(TextSeverity::warning, "Nadir: LOST, please set the position on the map");
}

void FlightService::save(double now_s) {
  SavedFlight flight;
  flight.boot_id = clock_.boot_id();
  flight.saved_monotonic_s = now_s;
  flight.saved_unix_us = clock_.unix_us();
  flight.state = machine_.status().state;
  if (last_.frame && last_.frame->report.estimate.position) {
    const Estimate& estimate = last_.frame->report.estimate;
    const Eigen::Vector2d& velocity_mps = last_.frame->report.state.velocity_mps;
    const double captured_s = last_.frame->telemetry.time_s;
    flight.estimate = SavedEstimate{captured_s,          clock_.unix_us() - std::llround((now_s - captured_s) * 1e6),
                                    *estimate.position,  estimate.sigma_m,
                                    velocity_mps.norm(), estimate.source,
                                    estimate.segment,    SavedVelocity{velocity_mps.x(), velocity_mps.y()}};
  }
  if (options_.start) flight.hint = SavedHint{*options_.start, kGpsHintRadius_m};
  upkeep_->save(std::move(flight));
}

// Reading tiles is the matcher's; what it found is looked at here.
void FlightService::report_corrupt_tiles() {
  if (!map_) return;
  const Findings findings = map_->package().imagery().findings();
  constexpr std::string_view kTile = "tile ";
  for (std::size_t i = last_.corrupt_tiles; i < findings.items().size(); ++i) {
    const Finding& finding = findings.items()[i];
    const auto key =
        parse_tile_key(std::string_view(finding.where).substr(std::min(kTile.size(), finding.where.size())));
    on_event(clock_.monotonic_s(), TileCorrupt{key.value_or(TileKey{}), finding.code, finding.found});
  }
}

AwaitedParts FlightService::awaited_parts() const {
  const auto camera_here = [this](double now_s) {
    const std::optional<double> frame_s = machine_.status().frame_s;
    return frame_s && now_s - *frame_s < kAwaitedAfter_s;
  };
  const auto camera = [this] {
    return fmt::format("the camera {}: {}", redacted(options_.camera),
                       last_.camera_failure.empty() ? "no frame" : last_.camera_failure);
  };
  const auto autopilot = [this] {
    return fmt::format("the autopilot {}/{} at {}: {}", airframe_.system, airframe_.autopilot, options_.autopilot,
                       AutopilotLink::why_silent(link_->state(), options_.link_key.has_value()));
  };
  std::vector<AwaitedParts::Part> parts;
  parts.push_back({"package", [this](double) { return map_ != nullptr; },
                   [this] {
                     return fmt::format("a package that is accepted, at {}: {}", options_.package.string(),
                                        package_.rejection);
                   }});
  if (map_) parts.push_back({"camera", camera_here, camera});
  if (map_ && airframe_.gimbal) {
    parts.push_back({"gimbal", [this](double now_s) { return now_s - gimbal_s_ < kAwaitedAfter_s; },
                     [this] {
                       return fmt::format("the gimbal {}/{}: no GIMBAL_DEVICE_ATTITUDE_STATUS of device {}",
                                          airframe_.system, airframe_.gimbal->component, airframe_.gimbal->device);
                     }});
  }
  parts.push_back({"autopilot", [this](double) { return machine_.status().link_up; }, autopilot});
  return AwaitedParts(std::move(parts));
}

void FlightService::note_start() {
  journal_.note(clock_.monotonic_s(), EventSeverity::info, "state", restart_.reason);
  if (!package_.notice.empty()) {
    const bool serious = !package_.notice_text.empty();
    journal_.note(clock_.monotonic_s(), serious ? EventSeverity::critical : EventSeverity::info, "package",
                  package_.notice);
    operator_texts_.add(TextSeverity::critical, package_.notice_text);
    if (log_) log_("package: " + package_.notice);
  }
  if (!options_.link_key) {
    journal_.note(clock_.monotonic_s(), EventSeverity::warning, "link",
                  "not signed (--unsigned-link): anybody on it can pose as the autopilot or as an operator");
  }
  for (const std::string& fault : link_->faults()) {
    journal_.note(clock_.monotonic_s(), EventSeverity::warning, "link", fault);
  }
  for (const Finding& finding : package_.findings.items()) {
    if (finding.severity != Severity::warning) continue;
    journal_.note(clock_.monotonic_s(), EventSeverity::warning, "finding",
                  finding.code + ": " + finding.where + ": " + finding.found);
  }
  if (package_.findings.contains("airframe.unsigned")) {
    operator_texts_.add(TextSeverity::warning, "Nadir: airframe file is not signed");
  }
  if (options_.candidates.tile_key && !options_.candidates.folder) {
    operator_texts_.add(TextSeverity::warning, "Nadir: tile key not accepted, no tiles");
  }
}

void FlightService::note_end() {
  if (const std::size_t undelivered = operator_texts_.pending() + operator_texts_.dropped(); undelivered > 0) {
    journal_.note(clock_.monotonic_s(), EventSeverity::info, "operator",
                  fmt::format("{} {} never delivered: no autopilot connected", undelivered,
                              undelivered == 1 ? "text was" : "texts were"));
  }
  const AutopilotLink::State link = link_->state();
  const MailboxCounts frames = frame_counts();
  journal_.note(
      clock_.monotonic_s(), EventSeverity::info, "summary",
      fmt::format("{} frames, {} dropped; frame to fix p50 {:.0f}, p95 {:.0f}, max {:.0f} ms; {} fixes, "
                  "longest gap {:.0f} ms",
                  frames.put, frames.dropped, 1000 * link.latency.quantile_s(0.5), 1000 * link.latency.quantile_s(0.95),
                  1000 * link.latency.largest_s(), link.fixes_sent, 1000 * link.longest_gap_s));
}

// The stale frames that the camera's thread dropped never reached the mailbox; those that could not be decoded did.
MailboxCounts FlightService::frame_counts() const {
  MailboxCounts counts = frames_.counts();
  const std::uint64_t stale = camera_ ? camera_->stale() : 0;
  counts.put += stale;
  counts.dropped += stale + (localization_ ? localization_->undecodable() : 0);
  return counts;
}

std::string FlightService::summary() const { return journal_.events().events().back().text; }

}  // namespace nadir
