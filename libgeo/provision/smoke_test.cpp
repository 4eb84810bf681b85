#include "provision/smoke_test.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cmath>

#include "base/error.hpp"
#include "mavlink/commands.hpp"
#include "mavlink/gps_input.hpp"

namespace nadir {
namespace {

constexpr int kImuSamples = 50;
constexpr std::uint64_t kLongestMeasurement_us = 3'000'000;  // by the autopilot's clock
constexpr double kSettling_s = 10;                           // ArduPlane 4.7 takes no rate for 14 s after its start
constexpr LonLat kNowhere{-11.2345678, 2.3456789};           // the Gulf of Guinea
constexpr double kNowhereSigma_m = 100;                      // arming and the filter want 5
constexpr double kSamePlace_deg = 1e-6;

std::int64_t unix_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

// By the autopilot's clock; 0 when none came.
double imu_rate_hz(AutopilotSession& session, MavlinkAddress autopilot) {
  std::optional<std::uint64_t> first_us;
  std::uint64_t last_us = 0;
  int samples = 0;
  const auto count = [&](const ReceivedMessage& message) {
    const auto* imu = std::get_if<ImuSample>(&message.message);
    if (imu == nullptr || message.source != autopilot || imu->instance != 1 || imu->time_us <= last_us) return false;
    last_us = imu->time_us;
    if (!first_us) first_us = last_us;
    return ++samples > kImuSamples || last_us - *first_us > kLongestMeasurement_us;
  };
  session.ask(set_message_interval(autopilot, StreamedMessage::raw_imu, kWantedImuRate_hz), count);
  return samples < 2 ? 0 : (samples - 1) * 1e6 / static_cast<double>(last_us - *first_us);
}

}  // namespace

double check_imu_rate(AutopilotSession& session, MavlinkAddress autopilot) {
  const auto until =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(kSettling_s + session.patience_s());
  double rate_hz = 0;
  do {
    rate_hz = imu_rate_hz(session, autopilot);
    if (rate_hz >= kLeastImuRate_hz) return rate_hz;
  } while (rate_hz > 0 && std::chrono::steady_clock::now() < until);
  throw Error(
      {.what = "the accelerometer comes too seldom",
       .where = session.url(),
       .expected = fmt::format("RAW_IMU at {} Hz, as asked for; at least {}", kWantedImuRate_hz, kLeastImuRate_hz),
       .found = rate_hz > 0 ? fmt::format("{:.1f} Hz by the autopilot's clock", rate_hz) : "none",
       .fix = "raise the link's baud rate, and lower the SRn_ rates of other streams on it"});
}

void check_gps_input(AutopilotSession& session, MavlinkAddress autopilot, int receiver) {
  const auto gps_id = static_cast<std::uint8_t>(receiver - 1);
  std::optional<GpsRaw> last;
  const Fix fix{.unix_us = unix_us(), .place = kNowhere, .sigma_m = kNowhereSigma_m};
  const bool heard = session.ask(gps_input(fix, gps_id), [&](const ReceivedMessage& message) {
    const auto* gps = std::get_if<GpsRaw>(&message.message);
    if (gps == nullptr || message.source != autopilot || gps->receiver != receiver) return false;
    last = *gps;
    return std::abs(gps->place.lat_deg - kNowhere.lat_deg) < kSamePlace_deg &&
           std::abs(gps->place.lon_deg - kNowhere.lon_deg) < kSamePlace_deg;
  });
  session.send(gps_input_without_fix(unix_us(), gps_id));
  if (heard) return;
  throw Error({.what = "the autopilot does not hear GPS_INPUT",
               .where = session.url(),
               .expected = fmt::format("its receiver {} at {:.7f}, {:.7f}, as it was told", receiver, kNowhere.lon_deg,
                                       kNowhere.lat_deg),
               .found = last ? fmt::format("{:.7f}, {:.7f}", last->place.lon_deg, last->place.lat_deg)
                             : fmt::format("nothing of that receiver in {} s", session.patience_s()),
               .fix = "restart the autopilot, which reads the receivers' types at its start, and provision again"});
}

}  // namespace nadir
