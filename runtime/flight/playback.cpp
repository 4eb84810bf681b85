#include "flight/playback.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <variant>
#include <vector>

#include "api/opened_package.hpp"
#include "flight/flight_journal.hpp"
#include "flight/view_builder.hpp"
#include "package/open_package.hpp"
#include "recorder/recording.hpp"
#include "trust/bearer_token.hpp"

namespace nadir {
namespace {

constexpr int kMomentsPerSecond = 5;  // the views of a flight
constexpr std::uint64_t kMoment_ns = 1'000'000'000 / kMomentsPerSecond;
constexpr std::uint64_t kLongestPause_ns = 60'000'000'000;  // between two records
constexpr double kServedEvery_s = 0.1;
constexpr double kTrackLength_s = 3600;  // in points a second apart, as many as the page keeps

double seconds_of(std::int64_t moment) { return static_cast<double>(moment) / kMomentsPerSecond; }

struct Note {
  EventSeverity severity = EventSeverity::info;
  std::string kind, text;
};

struct FrameFollowed {};

// GPS_INPUT; nothing: it said "no fix".
struct FixSent {
  std::optional<Fix> fix;
};

// One record as the view takes it, which needs no more of it.
struct TimedRecord {
  std::uint64_t time_ns = 0;  // since the first record
  std::uint64_t at_ns = 0;    // UTC, since 1970
  std::variant<std::shared_ptr<const LocalizedFrame>, FrameFollowed, MatchFailed, TileCorrupt, StateTransition, Note,
               AircraftAttitude, FixSent>
      what;

  double time_s() const { return static_cast<double>(time_ns) * 1e-9; }
};

std::optional<ServiceState> state_named(std::string_view name) {
  for (int i = 0; i <= static_cast<int>(ServiceState::failsafe); ++i) {
    if (const auto state = static_cast<ServiceState>(i); name_of(state) == name) return state;
  }
  return std::nullopt;
}

// "gps_denied: GPS is denied: no fix", as the journal records it.
std::optional<StateTransition> transition_of(double time_s, const StateRecord& record) {
  const auto from = state_named(record.from), to = state_named(record.to);
  const std::size_t colon = std::min(record.reason.find(": "), record.reason.size());
  const std::string_view name = std::string_view(record.reason).substr(0, colon);
  for (const ReasonText& reason : all_reasons()) {
    if (reason.name != name || !from || !to) continue;
    const std::string text = colon < record.reason.size() ? record.reason.substr(colon + 2) : std::string();
    return StateTransition{time_s, *from, *to, reason.reason, text};
  }
  return std::nullopt;
}

Note note_of(const HealthRecord& record, const std::string& note) {
  const bool alarm = std::any_of(record.measures.begin(), record.measures.end(),
                                 [](const auto& measure) { return measure.first == kAlarmMeasure; });
  const EventSeverity severity = record.healthy ? EventSeverity::info
                                 : alarm        ? EventSeverity::critical
                                                : EventSeverity::warning;
  const std::size_t colon = note.find(": ");
  if (colon == std::string::npos) return {severity, "service", note};
  return {severity, note.substr(0, colon), note.substr(colon + 2)};
}

std::optional<Fix> fix_of(const FixRecord& record) {
  if (!record.place) return std::nullopt;
  Fix fix{.unix_us = record.unix_us, .place = *record.place, .sigma_m = record.accuracy_m.value_or(kNoFixAccuracy_m)};
  if (record.north_mps && record.east_mps) fix.velocity = GpsVelocity{*record.north_mps, *record.east_mps, {}};
  return fix;
}

}  // namespace

// ---- reading

struct Playback::Recorded {
  SessionRecord session;
  std::vector<TimedRecord> records;
  bool has_states = false;
  ServiceState first_state = ServiceState::boot;
  std::string damage;
  std::shared_ptr<const OpenPackage> package;  // null: none

  double length_s() const {
    return seconds_of(static_cast<std::int64_t>((records.back().time_ns + kMoment_ns - 1) / kMoment_ns));
  }
  std::optional<UtcTime> begins() const {
    if (session.started_ns == 0) return std::nullopt;
    return UtcTime{static_cast<std::int64_t>(records.front().at_ns / 1'000'000'000)};
  }

  void read(const PlaybackSource& source, const std::string& id);
  void open_map(const std::filesystem::path& folder, Progress& progress);

 private:
  class Reading;
};

class Playback::Recorded::Reading {
 public:
  explicit Reading(Recorded& recorded) : recorded_(recorded) {}

  void take(std::uint64_t at_ns, const Record& record) {
    if (last_ns_ && at_ns > *last_ns_) time_ns_ += std::min(at_ns - *last_ns_, kLongestPause_ns);
    last_ns_ = at_ns;
    std::visit([&](const auto& known) { on(known); }, record);
  }
  std::size_t estimates() const { return estimates_; }

 private:
  double time_s() const { return static_cast<double>(time_ns_) * 1e-9; }

  template <typename What>
  void add(What what) {
    recorded_.records.push_back({time_ns_, *last_ns_, std::move(what)});
  }

  // The others are not shown. A hint is noted as well.
  template <typename Other>
  void on(const Other&) {}
  void on(const SessionRecord& session) {
    if (recorded_.records.empty()) recorded_.session = session;
  }
  void on(const InputRecord& input) {
    Telemetry& telemetry = inputs_[input.index];
    telemetry.time_s = time_s();
    telemetry.pitch_rad = input.telemetry.pitch_rad;
    telemetry.roll_rad = input.telemetry.roll_rad;
    add(FrameFollowed{});
  }
  void on(const EstimateRecord& estimate) {
    ++estimates_;
    const auto input = inputs_.find(estimate.index);
    last_.index = last_.anchor_index = estimate.index;
    last_.telemetry = input != inputs_.end() ? input->second : Telemetry();
    if (input == inputs_.end()) last_.telemetry.time_s = time_s();
    last_.report.estimate = estimate.estimate;
    last_.report.state = estimate.state;
    add(std::make_shared<const LocalizedFrame>(last_));
  }
  // Its estimate is that of the frame that had been followed by then; the corrected one follows.
  void on(const AnchorRecord& anchor) {
    if (anchor.anchor.verdict == AnchorVerdict::not_tried) return add(MatchFailed{});
    LocalizedFrame frame = last_;
    frame.report.anchor.verdict = anchor.anchor.verdict;
    add(std::make_shared<const LocalizedFrame>(std::move(frame)));
  }
  void on(const StateRecord& record) {
    auto transition = transition_of(time_s(), record);
    if (!transition)
      return add(Note{EventSeverity::warning, "state", record.from + " → " + record.to + ": " + record.reason});
    if (!recorded_.has_states) recorded_.first_state = transition->from;
    recorded_.has_states = true;
    add(*std::move(transition));
  }
  // Of tiles that are made the flight says nothing either.
  void on(const TileRecord& tile) {
    if (!tile.code.starts_with("candidate.")) add(TileCorrupt{tile.key, tile.code, tile.text});
  }
  void on(const HealthRecord& health) {
    for (const std::string& note : health.notes) add(note_of(health, note));
  }
  void on(const FixRecord& fix) { add(FixSent{fix_of(fix)}); }
  void on(const FixInputRecord& fix) {
    const FixInputRecord::Attitude* newest = nullptr;
    for (const FixInputRecord::Input& input : fix.inputs) {
      if (const auto* attitude = std::get_if<FixInputRecord::Attitude>(&input.what)) newest = attitude;
    }
    if (newest != nullptr)
      add(AircraftAttitude{.roll_rad = newest->roll_rad, .pitch_rad = newest->pitch_rad, .yaw_rad = newest->yaw_rad});
  }

  Recorded& recorded_;
  std::uint64_t time_ns_ = 0;
  std::optional<std::uint64_t> last_ns_;
  std::map<std::uint64_t, Telemetry> inputs_;
  LocalizedFrame last_;
  std::size_t estimates_ = 0;
};

void Playback::Recorded::read(const PlaybackSource& source, const std::string& id) {
  Reading reading(*this);
  const std::array flight{Stream::flight};
  const auto take = [&](const nadir::Recorded& one) {
    if (one.segment.session && one.segment.session->id == id) reading.take(one.at_ns, one.record);
  };
  std::vector<SegmentContents> segments = read_recording(source.recording, take, flight);
  if (reading.estimates() == 0) {
    throw UsageError({.what = "the recording has no estimates: there is nothing to show",
                      .where = fmt::format("{}, session {}", source.recording.string(), id),
                      .fix = "nadir recorder info lists what it has; another session is chosen with --session"});
  }
  std::erase_if(segments, [&](const SegmentContents& segment) { return segment.session && segment.session->id != id; });
  const Findings findings = check_recording(segments);
  for (const Finding& finding : findings.items())
    damage += fmt::format("{}{}: {}", damage.empty() ? "" : "; ", finding.code, finding.found);
}

// The manifest's digest is what the recording vouches for: no other package is the one that was flown. Its age was
// judged before take-off.
void Playback::Recorded::open_map(const std::filesystem::path& folder, Progress& progress) {
  if (!session.package) {
    throw UsageError({.what = "the recorded flight had no map package",
                      .where = "session " + session.id,
                      .fix = "leave --package out: the flight is shown without a map"});
  }
  Opening opening = open_accepted_package(folder, *session.package, UtcTime{}, progress);
  if (opening.package) {
    package = std::move(opening.package);
    return;
  }
  const Finding finding = opening.findings.items().empty() ? Finding{} : opening.findings.items().front();
  const bool other = finding.code == "artifact.hash" && finding.where == kManifestFile;
  throw UsageError({.what = other ? "this is not the package that was flown"
                                  : fmt::format("the package is not whole: {}: {}", finding.code, finding.where),
                    .where = folder,
                    .expected = other ? fmt::format("the package of mission {}, whose {} has SHA-256 {}",
                                                    session.mission, kManifestFile, session.package->hex())
                                      : finding.expected,
                    .found = finding.found,
                    .fix = "give that package, or leave --package out: the flight is shown without a map"});
}

// ---- showing

class Playback::Moment {
 public:
  explicit Moment(const Recorded& recorded) : recorded_(recorded), views_(std::string(), FlightTrail(kTrackLength_s)) {
    status_.state = recorded.first_state;
    IntegrityRequirement integrity = IntegrityRequirement();
    if (recorded.package) integrity = recorded.package->mission().integrity;
    if (!recorded.package) integrity.risk = recorded.session.localizer.integrity_risk;
    alert_limit_m_ = integrity.alert_limit_m;
    views_.set_integrity(integrity);
    PackageView map;
    map.mission = recorded.session.mission;
    map.reason = recorded.session.package ? "not opened: --package shows the map that was flown" : "none was flown";
    views_.set_package(recorded.package ? package_view(*recorded.package) : map);
    show(true);
  }

  std::int64_t number() const { return number_; }

  void go_to(std::int64_t number) {
    while (number_ < number) {
      ++number_;
      show(number_ == number);
    }
  }

  // The track ends at the aircraft, even while nothing is added to it.
  FlightView view() const {
    const TimedRecord& last = recorded_.records[next_ == 0 ? 0 : next_ - 1];
    const double now_s = seconds_of(number_), since_s = std::max(0.0, now_s - last.time_s());
    const auto unix_us = static_cast<std::int64_t>(last.at_ns / 1000) + std::llround(since_s * 1e6);
    FlightView view = views_.view(now_s, unix_us, journal_.events(), journal_.alarms());
    if (!recorded_.begins()) view.utc.reset();
    if (view.position) view.track.push_back({now_s, view.position->place, view.position->sigma_m, view.source});
    return view;
  }

 private:
  void show(bool last) {
    const double now_s = seconds_of(number_);
    const std::uint64_t now_ns = static_cast<std::uint64_t>(number_) * kMoment_ns;
    while (next_ < recorded_.records.size() && recorded_.records[next_].time_ns <= now_ns) {
      const TimedRecord& record = recorded_.records[next_++];
      std::visit([&](const auto& what) { on(record.time_s(), what); }, record.what);
    }
    if (!recorded_.has_states) follow_estimates(now_s);
    status_.usable = usable();
    views_.set_status(status_, reason_);
    views_.set_frames({.put = frames_, .dropped = 0}, now_s);
    if (!last && status_.state == ServiceState::normal) return;  // nothing that the next view does not set
    const bool connected = link_.last_message_s && now_s - *link_.last_message_s < kLinkLost_s;
    views_.set_link(link_, connected, signed_);
    views_.restrict_to_fix(status_, link_.last_fix, now_s);
  }

  // The recorded alerts, and the levels that are known.
  bool usable() const {
    if (status_.state != ServiceState::normal && status_.state != ServiceState::degraded) return false;
    if (recorded_.has_states && !recorded_.package) return !alerted_;
    const bool within = hpl_m_ && *hpl_m_ <= alert_limit_m_;
    return !alerted_ && (within || (recorded_.has_states && status_.state == ServiceState::degraded));
  }

  void follow_estimates(double now_s) {
    const ServiceState state = position_ ? ServiceState::normal : ServiceState::no_fix;
    if (state != status_.state) status_.since_s = now_s;
    status_.state = state;
    reason_ = "a replay: the recording has no states of a service";
  }

  void on(double, const std::shared_ptr<const LocalizedFrame>& frame) {
    views_.on_event(*frame);
    position_ = frame->report.estimate.position.has_value();
    hpl_m_ = frame->report.estimate.hpl_m;
  }
  void on(double time_s, const FrameFollowed&) {
    ++frames_;
    status_.frame_s = time_s;
  }
  void on(double, const MatchFailed& failed) { views_.on_event(failed); }
  void on(double time_s, const TileCorrupt& tile) {
    views_.on_event(tile);
    journal_.on_event(time_s, tile);
  }
  void on(double time_s, const Note& note) { journal_.note(time_s, note.severity, note.kind, note.text); }
  void on(double time_s, const AircraftAttitude& attitude) {
    link_.attitude = attitude;
    link_.attitude_s = link_.last_message_s = time_s;
  }
  void on(double, const FixSent& sent) {
    if (sent.fix) ++link_.fixes_sent;
    link_.last_fix = sent.fix;
  }
  void on(double time_s, const StateTransition& transition) {
    journal_.on_event(time_s, transition);
    if (transition.from != transition.to) {
      status_.state = transition.to;
      status_.since_s = time_s;
      reason_ = transition.text;
    }
    const auto gps = [&](GpsVerdict verdict) {
      const std::size_t explained = text_of(transition.reason).explanation.size() + 2;
      views_.on_event(GpsAssessment{
          verdict, transition.text.size() > explained ? transition.text.substr(explained) : std::string()});
    };
    switch (transition.reason) {
      case ServiceReason::gps_denied: return gps(GpsVerdict::denied);
      case ServiceReason::gps_spoofed: return gps(GpsVerdict::spoofed);
      case ServiceReason::gps_trusted: return gps(GpsVerdict::trusted);
      case ServiceReason::link_authentic: signed_ = true; return;
      case ServiceReason::link_without_signing: signed_ = false; return;
      case ServiceReason::position_not_usable: alerted_ = true; return;
      case ServiceReason::position_usable_again: alerted_ = false; return;
      default: return;
    }
  }

  const Recorded& recorded_;
  std::size_t next_ = 0;  // record
  std::int64_t number_ = 0;
  ViewBuilder views_;
  FlightJournal journal_{nullptr};
  ServiceStatus status_;
  std::string reason_;
  AutopilotLink::State link_;
  bool signed_ = false, alerted_ = false, position_ = false;
  std::optional<double> hpl_m_;
  double alert_limit_m_ = 0;
  std::uint64_t frames_ = 0;
};

Playback::Playback(const PlaybackSource& source, std::string run, Progress& progress) : run_(std::move(run)) {
  auto recorded = std::make_unique<Recorded>();
  recorded->read(source, chosen_session(source.recording, source.session, UnlessRequested::newest));
  if (source.package) recorded->open_map(*source.package, progress);
  control_ = {.session = recorded->session.id,
              .recorded = recorded->begins(),
              .at_s = 0,
              .length_s = recorded->length_s(),
              .playing = true,
              .speed = kPlaybackSpeeds.front(),
              .notice = recorded->damage};
  recorded_ = std::move(recorded);
  moment_ = std::make_unique<Moment>(*recorded_);
}

Playback::~Playback() = default;

ApiPackage Playback::for_api() const { return recorded_->package ? package_for_api(recorded_->package) : ApiPackage(); }

PlaybackView Playback::control(const PlaybackRequest& request) {
  const std::lock_guard lock(mutex_);
  if (request.speed) control_.speed = *request.speed;
  std::optional<double> at_s = request.at_s;
  if (request.playing) {
    control_.playing = *request.playing;
    if (*request.playing && !at_s && at_end()) at_s = 0;  // once more
  }
  if (at_s) {
    control_.at_s = std::clamp(seconds_of(std::llround(*at_s * kMomentsPerSecond)), 0.0, control_.length_s);
    sought_ = true;
  }
  return control_;
}

void Playback::advance(double elapsed_s) {
  bool jumps = false;
  std::int64_t wanted = 0;
  {
    const std::lock_guard lock(mutex_);
    jumps = std::exchange(sought_, false);
    if (jumps) {
      position_s_ = control_.at_s;
    } else if (control_.playing) {
      position_s_ = std::min(position_s_ + std::max(0.0, elapsed_s) * control_.speed, control_.length_s);
    }
    wanted = static_cast<std::int64_t>(std::floor(position_s_ * kMomentsPerSecond + 1e-6));
    control_.at_s = seconds_of(wanted);
    if (at_end() && !jumps) control_.playing = false;
  }
  if (jumps) ++jumps_;
  if (wanted < moment_->number()) moment_ = std::make_unique<Moment>(*recorded_);
  moment_->go_to(wanted);
}

FlightView Playback::view() const {
  FlightView view = moment_->view();
  view.boot_id = fmt::format("{}p{}", run_, jumps_);
  const std::lock_guard lock(mutex_);
  view.playback = control_;
  view.playback->at_s = view.time_s;
  return view;
}

void serve_playback(Playback& playback, const ApiEndpoint& endpoint, const FlightClock& clock,
                    const std::stop_token& stop, const std::function<void(std::uint16_t port)>& on_listening) {
  const ListenAddress address = parse_listen_address(endpoint.address);
  ApiOptions options;
  options.now_s = [] { return 0.0; };  // a moment of a recording is never old
  options.loopback = address.loopback();
  options.control_playback = [&playback](const PlaybackRequest& request) { return playback.control(request); };
  if (endpoint.token) options.token = sha256(as_bytes(read_bearer_token(*endpoint.token)));
  require_token_beyond_loopback(address, options.token);
  FlightBoard board;
  LatestSlot<Hint> no_hints;
  Api api(board, no_hints, std::move(options));
  api.use_package(playback.for_api());
  board.publish(playback.view());
  const HttpServer server(api, address);
  on_listening(server.port());
  double last_s = clock.monotonic_s(), next_s = last_s;
  while (clock.wait_until(next_s, stop)) {
    const double now_s = clock.monotonic_s();
    playback.advance(now_s - last_s);
    last_s = now_s;
    next_s = now_s + kServedEvery_s;
    board.publish(playback.view());
  }
}

}  // namespace nadir
