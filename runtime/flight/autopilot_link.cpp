#include "flight/autopilot_link.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/platform.hpp"
#include "mavlink/closed_link.hpp"
#include "mavlink/commands.hpp"

namespace nadir {
namespace {

constexpr double kHeartbeatPeriod_s = 1, kRequestPeriod_s = 10, kUnauthenticatedPeriod_s = 1, kRivalPeriod_s = 10,
                 kThreadLimit_s = 2;
constexpr double kGimbalRate_hz = 25;
constexpr int kMaxWait_ms = 20;

std::int64_t us(double seconds) { return std::llround(seconds * 1e6); }

// number: 0 for the autopilot's link, then the stations. Each link signs with a link id of its own.
std::optional<Signing> signing_of(const AutopilotLinkSetup& setup, const std::unique_ptr<SigningTime>& time,
                                  const std::unique_ptr<StreamTimestamps>& streams, std::size_t number) {
  if (!setup.key || !time) return std::nullopt;
  return Signing(*setup.key, *time, static_cast<std::uint8_t>(setup.airframe.link + number), streams.get());
}

std::unique_ptr<SigningTime> time_of(const AutopilotLinkSetup& setup, const FlightClock& clock) {
  if (!setup.key || !setup.state) return nullptr;
  return std::make_unique<SigningTime>(*setup.state / "signing-time", clock.unix_us(), us(clock.monotonic_s()));
}

std::unique_ptr<StreamTimestamps> streams_of(const AutopilotLinkSetup& setup, std::size_t number) {
  if (!setup.key || !setup.state) return nullptr;
  const std::string name = "signing-streams";
  return std::make_unique<StreamTimestamps>(*setup.state / (number == 0 ? name : name + "-" + std::to_string(number)));
}

SystemState system_state(ServiceState state) {
  switch (state) {
    case ServiceState::boot: return SystemState::boot;
    case ServiceState::normal: return SystemState::active;
    case ServiceState::degraded:
    case ServiceState::no_fix:
    case ServiceState::no_package: return SystemState::critical;
    case ServiceState::failsafe: return SystemState::emergency;
    default: return SystemState::standby;
  }
}

}  // namespace

std::string_view name_of(StationRole role) { return role == StationRole::ground_station ? "ground station" : "logger"; }

AutopilotLink::AutopilotLink(AutopilotLinkSetup setup, const FlightClock& clock, ThreadWatch& watch, Listener listener)
    : airframe_(setup.airframe),
      clock_(clock),
      listener_(std::move(listener)),
      signing_time_(time_of(setup, clock)),
      streams_(streams_of(setup, 0)),
      link_(std::move(setup.transport), {airframe_.system, airframe_.component},
            signing_of(setup, signing_time_, streams_, 0), MavlinkAddress{airframe_.system, airframe_.autopilot}),
      fixes_(airframe_.gps_id),
      backend_(
          make_autopilot_backend(AutopilotType::ardupilot, {airframe_.system, airframe_.autopilot}, airframe_.gps_id)),
      parameters_(airframe_.parameters, {airframe_.system, airframe_.autopilot}),
      parameter_check_(parameters_.check()),
      gps_switch_(setup.switch_gps
                      ? std::optional(GpsFusionSwitch(airframe_.parameters, {airframe_.system, airframe_.autopilot}))
                      : std::nullopt),
      beat_(watch.watch("link", kThreadLimit_s)),
      thread_() {
  for (const StationSetup& station : setup.stations) {
    const std::size_t number = stations_.size() + 1;
    auto streams = streams_of(setup, number);
    auto signing = signing_of(setup, signing_time_, streams, number);
    MavlinkLink link(make_transport(parse_endpoint(station.endpoint)), {airframe_.system, airframe_.component},
                     std::move(signing));
    stations_.push_back({station, std::move(streams), std::move(link), 0});
  }
}

AutopilotLink::~AutopilotLink() { stop(); }

std::string AutopilotLink::why_silent(const State& state, bool is_signed) {
  if (!state.error.empty()) return state.error;
  if (!state.supported) return fmt::format("it is {}, Nadir flies with {}", state.autopilot, supported_autopilots());
  return is_signed ? "no heartbeat with a valid signature" : "no heartbeat";
}

void AutopilotLink::start() {
  receive(clock_.monotonic_s());
  publish();
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void AutopilotLink::stop() {
  thread_.request_stop();
  wake_up_.call();
  if (thread_.joinable()) thread_.join();
}

void AutopilotLink::on_estimate(const FixInputRecord::ArrivedEstimate& which, const VisionEstimate& estimate,
                                std::optional<double> arrived_s) {
  estimates_.put({which, estimate, arrived_s});
  wake_up_.call();
}

void AutopilotLink::on_status(const ServiceStatus& status) {
  const std::scoped_lock lock(mutex_);
  status_ = status;
}

void AutopilotLink::send_text(TextSeverity severity, std::string text) { send(StatusText{severity, std::move(text)}); }

void AutopilotLink::send(OutgoingMessage message) {
  outgoing_.put(std::move(message));
  wake_up_.call();
}

void AutopilotLink::save_signing_state(StreamTimestamps::When when) {
  if (!signing_time_) return;
  signing_time_->save(us(clock_.monotonic_s()));
  streams_->save(when);
  for (const Station& station : stations_) station.streams->save(when);
}

std::vector<std::string> AutopilotLink::faults() const {
  std::vector<std::string> faults;
  const auto add = [&](const std::unique_ptr<StreamTimestamps>& streams) {
    if (streams && !streams->fault().empty()) faults.push_back(streams->fault());
  };
  add(streams_);
  for (const Station& station : stations_) add(station.streams);
  return faults;
}

AutopilotLink::State AutopilotLink::state() const {
  const std::scoped_lock lock(mutex_);
  return state_;
}

void AutopilotLink::run(const std::stop_token& stop) {
  begin_thread("link", ThreadPriority::high);
  Cadence heartbeats(kHeartbeatPeriod_s, clock_.monotonic_s());
  while (!stop.stop_requested()) {
    beat_();
    const double now_s = clock_.monotonic_s();
    receive(now_s);
    report_rivals(now_s);
    advance_stations(now_s);
    while (const auto arrived = estimates_.try_take()) {
      const bool accepted = fixes_.on_input(us(now_s), arrived->which, arrived->estimate);
      if (accepted && arrived->arrived_s) unsent_since_s_ = arrived->arrived_s;
    }
    const ServiceStatus status = this->status();
    send_fix(now_s, status);
    if (gps_switch_ && recognized_ && backend_->type() == AutopilotType::px4) {
      if (const auto message = gps_switch_->turn(now_s, status.gps)) link_.send(*message, us(now_s));
    }
    if (heartbeats.due(now_s)) send_everywhere(OwnHeartbeat{system_state(status.state)}, us(now_s));
    while (const auto message = outgoing_.try_take()) send_everywhere(*message, us(now_s));
    publish();
    const double until_due_ms = static_cast<double>(fixes_.next_due_us() - us(clock_.monotonic_s())) / 1000;
    const int wait_ms = static_cast<int>(std::clamp(until_due_ms, 0.0, static_cast<double>(kMaxWait_ms)));
    wait_for_input(wait_ms);
  }
}

void AutopilotLink::receive(double now_s) {
  const auto handle = [&](const ReceivedMessage& message) {
    recognize_autopilot(now_s, message);
    request_streams(now_s, message);
    note_message(now_s, message);
    const double arrived_s = this->arrived_s(now_s, message);
    predict_motion(arrived_s, message);
    listener_.on_message({.arrived_s = arrived_s, .read_s = now_s}, message);
  };
  const auto rejected = [&](MavlinkAddress claimed) { report_unauthenticated_peer(now_s, claimed); };
  if (link_.advance(us(now_s), handle, rejected)) last_look_s_ = now_s;
}

double AutopilotLink::arrived_s(double now_s, const ReceivedMessage& received) {
  const auto stamp = stamp_us(received.message);
  if (!stamp || received.source.system != airframe_.system) return now_s;
  return arrivals_[received.source.component].arrived_s(last_look_s_.value_or(now_s), now_s, *stamp);
}

// Ground stations get what is meant for people, loggers all.
void AutopilotLink::send_everywhere(const OutgoingMessage& message, std::int64_t now_us) {
  link_.send(message, now_us);
  const bool for_people = std::holds_alternative<OwnHeartbeat>(message) ||
                          std::holds_alternative<StatusText>(message) || std::holds_alternative<CommandAck>(message) ||
                          std::holds_alternative<NamedValue>(message);
  for (Station& station : stations_) {
    if (for_people || station.setup.role == StationRole::logger) station.link.send(message, now_us);
  }
}

// Telemetry counts only from the autopilot's own link.
void AutopilotLink::advance_stations(double now_s) {
  for (Station& station : stations_) {
    station.link.advance(us(now_s), [&](const ReceivedMessage& message) {
      const bool command = std::holds_alternative<CommandInt>(message.message) ||
                           std::holds_alternative<CommandLong>(message.message) ||
                           std::holds_alternative<SetLocalOrigin>(message.message);
      if (station.setup.role != StationRole::ground_station || !command) return;
      ++station.commands;
      listener_.on_message({.arrived_s = now_s, .read_s = now_s}, message);
    });
  }
}

void AutopilotLink::wait_for_input(int at_most_ms) const {
  std::vector<pollfd> waited{{link_.transport().descriptor(), link_.transport().events(), 0}};
  for (const Station& station : stations_) {
    waited.push_back({station.link.transport().descriptor(), station.link.transport().events(), 0});
  }
  wake_up_.wait(std::move(waited), at_most_ms);
}

ServiceStatus AutopilotLink::status() const {
  const std::scoped_lock lock(mutex_);
  return status_;
}

void AutopilotLink::send_fix(double now_s, const ServiceStatus& status) {
  const FixStatus permission{
      .served = status.serves_fixes, .permitted = status.fix, .source = status.source, .sigma_m = status.sigma_m};
  auto due = fixes_.turn(us(now_s), clock_.unix_us(), permission);
  if (!due) return;
  if (due->jumped_m) listener_.on_jump(*due->jumped_m);
  if (status.serves_fixes && backend_) {
    for (const OutgoingMessage& request : backend_->requests(us(now_s), *due)) link_.send(request, us(now_s));
    if (const auto messages = backend_->messages(*due)) {
      due->inputs.sent = true;
      for (const OutgoingMessage& message : *messages) {
        for (Station& station : stations_) {
          if (station.setup.role == StationRole::logger) station.link.send(message, us(now_s));
        }
        due->inputs.sent = link_.send(message, us(now_s)) && due->inputs.sent;
      }
    }
  }
  const bool sent = due->inputs.sent;
  const std::optional<Fix> fix = due->fix;
  if (listener_.on_fix) listener_.on_fix(*std::move(due));
  if (!sent) return;
  const std::scoped_lock lock(mutex_);
  state_.last_fix = fix;
  if (fix) ++state_.fixes_sent;
  if (fix && unsent_since_s_) state_.latency.add(clock_.monotonic_s() - *unsent_since_s_);
  unsent_since_s_.reset();
  if (last_fix_s_) state_.longest_gap_s = std::max(state_.longest_gap_s, now_s - *last_fix_s_);
  last_fix_s_ = now_s;
}

// The first heartbeat of a supported autopilot decides until the service ends.
void AutopilotLink::recognize_autopilot(double now_s, const ReceivedMessage& message) {
  const MavlinkAddress autopilot{airframe_.system, airframe_.autopilot};
  if (message.source != autopilot) return;
  const auto* heartbeat = std::get_if<Heartbeat>(&message.message);
  if (heartbeat != nullptr && heartbeat->is_autopilot && !recognized_) {
    recognized_ = is_supported(heartbeat->autopilot);
    if (!backend_ || backend_->type() != heartbeat->autopilot) {
      backend_ = make_autopilot_backend(heartbeat->autopilot, autopilot, airframe_.gps_id);
    }
    const std::scoped_lock lock(mutex_);
    state_.autopilot = name_of_autopilot(*heartbeat);
    state_.supported = recognized_;
  }
  if (!recognized_) return;
  backend_->on_message(us(now_s), message.message);
  compare_parameters(now_s, message.message);
}

void AutopilotLink::compare_parameters(double now_s, const IncomingMessage& message) {
  const auto report = [&](OnboardEvent event) {
    if (listener_.on_parameters) listener_.on_parameters(std::move(event));
  };
  if (const auto* heartbeat = std::get_if<Heartbeat>(&message); heartbeat != nullptr && heartbeat->is_autopilot) {
    ParameterWatch::Turn turn = parameters_.on_heartbeat(now_s, *heartbeat);
    for (OutgoingMessage& request : turn.requests) outgoing_.put(std::move(request));
    if (turn.missing) report(*std::move(turn.missing));
  } else if (const auto* version = std::get_if<AutopilotVersion>(&message)) {
    if (auto changed = parameters_.on_message(*version)) report(*std::move(changed));
  } else if (const auto* parameter = std::get_if<ParameterValue>(&message)) {
    if (gps_switch_) {
      if (auto text = gps_switch_->on_message(*parameter)) outgoing_.put(*std::move(text));
      gps_is_off_ = gps_switch_->is_off();
    }
    const bool ours = gps_switch_ && gps_switch_->is_ours(*parameter);
    if (auto changed = parameters_.on_message(*parameter, ours)) report(*std::move(changed));
  }
  const ParameterCheck check = parameters_.check();
  if (std::exchange(parameter_check_, check) != check) report(ParametersCompared{check});
}

// At the first heartbeat, and again periodically: the autopilot may have rebooted.
void AutopilotLink::request_streams(double now_s, const ReceivedMessage& message) {
  const auto* heartbeat = std::get_if<Heartbeat>(&message.message);
  if (heartbeat == nullptr || !heartbeat->is_autopilot || (requested_s_ && now_s - *requested_s_ < kRequestPeriod_s))
    return;
  if (!backend_) return;
  requested_s_ = now_s;
  for (const auto& [stream, rate_hz] : backend_->streams())
    outgoing_.put(set_message_interval(message.source, stream, rate_hz));
  if (airframe_.gimbal) {
    outgoing_.put(set_message_interval({airframe_.system, airframe_.gimbal->component},
                                       StreamedMessage::gimbal_attitude, kGimbalRate_hz));
  }
}

void AutopilotLink::note_message(double now_s, const ReceivedMessage& received) {
  if (received.source != MavlinkAddress{airframe_.system, airframe_.autopilot}) return;
  const std::scoped_lock lock(mutex_);
  state_.last_message_s = now_s;
  if (const auto* attitude = std::get_if<AircraftAttitude>(&received.message)) {
    state_.attitude = *attitude;
    state_.attitude_s = now_s;
  }
}

// Between frames, and above all without them, the fix follows the aircraft's motion.
void AutopilotLink::predict_motion(double arrived_s, const ReceivedMessage& received) {
  if (received.source.system != airframe_.system || received.source.component != airframe_.autopilot) return;
  const auto single = [](double value) { return static_cast<float>(value); };
  if (const auto* attitude = std::get_if<AircraftAttitude>(&received.message)) {
    fixes_.on_input(us(arrived_s), FixInputRecord::Attitude{single(attitude->roll_rad), single(attitude->pitch_rad),
                                                            single(attitude->yaw_rad)});
  } else if (const auto* imu = std::get_if<ImuSample>(&received.message); imu != nullptr && imu->instance == 1) {
    const Vector3& force = imu->acceleration_mps2;
    fixes_.on_input(us(arrived_s), FixInputRecord::Acceleration{single(force.x), single(force.y), single(force.z)});
  }
}

void AutopilotLink::report_unauthenticated_peer(double now_s, MavlinkAddress claimed) {
  const bool claims_autopilot = claimed == MavlinkAddress{airframe_.system, airframe_.autopilot};
  if (!claims_autopilot || (unauthenticated_s_ && now_s - *unauthenticated_s_ < kUnauthenticatedPeriod_s)) return;
  unauthenticated_s_ = now_s;
  if (listener_.on_unauthenticated_peer) listener_.on_unauthenticated_peer();
}

void AutopilotLink::report_rivals(double now_s) {
  const std::uint64_t rivals = link_.counts().rivals;
  if (rivals == rivals_ || (rivals_s_ && now_s - *rivals_s_ < kRivalPeriod_s)) return;
  rivals_ = rivals;
  rivals_s_ = now_s;
  if (listener_.on_rival) listener_.on_rival(rivals);
}

void AutopilotLink::publish() {
  const std::scoped_lock lock(mutex_);
  state_.stations.clear();
  for (const Station& station : stations_) {
    const auto closed = closed_link(station.link.transport());
    state_.stations.push_back({station.setup.role, station.setup.endpoint, !closed,
                               closed ? closed->reason : std::string(), station.link.counts().sent, station.commands});
  }
  const auto closed = closed_link(link_.transport());
  state_.open = !closed;
  state_.error = closed ? closed->reason : std::string();
  state_.missing = backend_ ? backend_->missing() : std::string();
  state_.counts = link_.counts();
}

}  // namespace nadir
