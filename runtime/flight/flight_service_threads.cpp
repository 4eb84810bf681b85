// What FlightService does on the threads of its parts: the localizer's, the link's and that of the state directory.
// Each hands on what it has and never waits; whoever must think about it is the conductor (flight_service.cpp).
#include <cmath>

#include "base/thread_rank.hpp"
#include "flight/flight_service.hpp"
#include "mavlink/commands.hpp"
#include "service/cadence.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kHouseWait{500};

VisionEstimate vision_estimate(const LocalizedFrame& frame, double taken_s, std::optional<double> ground_msl_m) {
  const Estimate& estimate = frame.report.estimate;
  const StateEstimate& belief = frame.report.state;
  VisionEstimate vision;
  vision.time_us = std::llround(taken_s * 1e6);
  vision.place = *estimate.position;
  vision.sigma_m = estimate.sigma_m;
  vision.east_m_s = belief.velocity_mps.x();
  vision.north_m_s = belief.velocity_mps.y();
  vision.speed_sigma_m_s = belief.velocity_sigma_mps;
  if (ground_msl_m) vision.msl_m = *ground_msl_m + belief.agl_m;
  if (ground_msl_m) vision.vertical_sigma_m = belief.agl_sigma_m;
  vision.seen = estimate.source == SourceLabel::satellite_anchored || estimate.source == SourceLabel::vo_extrapolated;
  return vision;
}

}  // namespace

void FlightService::tell(FlightNews news) { news_.put({clock_.monotonic_s(), std::move(news)}); }

// On the localizer's thread.
void FlightService::localized(const LocalizedFrame& frame) {
  const Estimate& estimate = frame.report.estimate;
  const double taken_s = frame.told.time_s;
  if (estimate.position) {
    const std::optional<double> arrived_s =
        frame.late ? std::nullopt : std::optional(taken_s + airframe_.capture_delay_s);
    link_->observe(vision_estimate(frame, taken_s, ground_->ground_msl_m(*estimate.position)), arrived_s);
    if (options_.send_external_position && frame.report.anchor.verdict == AnchorVerdict::accepted) {
      const double now_s = clock_.monotonic_s();
      link_->send(external_position_estimate({airframe_.system, airframe_.autopilot},
                                             {*estimate.position, estimate.sigma_m, now_s, now_s - taken_s}));
    }
  }
  if (recorder_) record(frame);
  if (tiles_ && frame.report.anchor_pose) tiles_->anchored(frame.anchor_index, *frame.report.anchor_pose);
  tell(LocalizerEvent{taken_s, frame.late, frame.index, estimate, frame.report.state, frame.report.anchor.verdict,
                      frame.told.pitch_rad, frame.told.roll_rad});
}

void FlightService::record(const LocalizedFrame& frame) {
  if (frame.late) {
    record_anchor(*recorder_, frame.anchor_index, frame.index, frame.report);
  } else {
    record_frame(*recorder_, frame.index, frame.report);
  }
}

// On the link's thread.
void FlightService::heard(double now_s, const ReceivedMessage& received) {
  const bool ours = received.source.system == airframe_.system && received.source.component == airframe_.autopilot;
  const auto telemetry = [&](const auto& message) {
    if (ours && localizing_) localizing_->hear(now_s, message);
  };
  if (const auto* heartbeat = std::get_if<Heartbeat>(&received.message)) {
    if (ours && heartbeat->is_autopilot) {
      tell(AutopilotEvent{received.is_signed || !options_.link_key, heartbeat->armed});
    }
  } else if (const auto* attitude = std::get_if<AircraftAttitude>(&received.message)) {
    telemetry(*attitude);
  } else if (const auto* position = std::get_if<GlobalPosition>(&received.message)) {
    telemetry(*position);
  } else if (const auto* distance = std::get_if<GroundDistance>(&received.message)) {
    telemetry(*distance);
  } else if (const auto* height = std::get_if<GroundHeight>(&received.message)) {
    telemetry(*height);
  } else if (const auto* imu = std::get_if<ImuSample>(&received.message)) {
    telemetry(*imu);
  } else if (const auto* gps = std::get_if<GpsRaw>(&received.message)) {
    // Our own GPS_INPUT comes back as the receiver of that number.
    if (ours && gps->receiver != airframe_.gps_id + 1) {
      telemetry(*gps);
      tell(GpsFix3d{now_s, gps->fix >= GpsFix::three_d, gps->place, gps->ground_speed_m_s, gps->horizontal_accuracy_m});
    }
  } else if (const auto* ekf = std::get_if<EkfStatus>(&received.message)) {
    if (ours) tell(EkfReport{now_s, ekf->horizontal_position_absolute, ekf->gps_glitching});
  } else if (const auto* command = std::get_if<CommandInt>(&received.message)) {
    if (const auto hint = position_hint(*command)) {
      tell(PlaceHinted{hint->place, hint->radius_m, "operator"});
      link_->send(CommandAck{command->command, CommandResult::accepted, received.source});
    }
  }
}

// Disks may be slow: nobody else touches them in flight but the recorder.
void FlightService::save_state_loop(const std::stop_token& stop) {
  begin_thread("state", ThreadPriority::behind);
  std::string last_trouble;
  Cadence keeping(kSavePeriod_s, clock_.monotonic_s());
  while (!stop.stop_requested()) {
    if (keeping.due(clock_.monotonic_s())) link_->keep_signing_time();
    const auto flight = to_save_.take_within(kHouseWait, stop);
    if (!flight) continue;
    const std::string trouble = state_.save(*flight).value_or("");
    if (trouble != last_trouble && !trouble.empty()) tell(StateNotSaved{trouble});
    last_trouble = trouble;
  }
}

}  // namespace nadir
