#include "fixes/px4_backend.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// Without HIGHRES_IMU a fix goes straight on between frames: it has the accelerations in SI units.
constexpr std::array<MessageRate, 8> kPx4Streams{{
    {StreamedMessage::attitude, 25},
    {StreamedMessage::global_position, 5},
    {StreamedMessage::gps_raw, 5},
    {StreamedMessage::gps2_raw, 5},
    {StreamedMessage::highres_imu, 100},
    {StreamedMessage::estimator_status, 4},
    {StreamedMessage::distance_sensor, 5},
    {StreamedMessage::system_time, 1},
}};

constexpr double kEarthRadius_m = 6'371'000;  // CONSTANTS_RADIUS_OF_EARTH in PX4's lib/geo/geo.h

constexpr std::int64_t kRequestPeriod_us = 1'000'000;
// PX4 reports an origin that it has within a second of the request.
constexpr std::int64_t kOriginPatience_us = 3'000'000;
constexpr std::int64_t kOriginLost_us = 5'000'000;  // requested five times, and not reported

// PX4 fuses the horizontal position alone (EKF2_EV_CTRL 1), but takes no variance of an ODOMETRY unless all three are
// numbers: a NaN here would make it believe EKF2_EVP_NOISE, 0.1 m, for north and east too.
constexpr double kUnknownHeightSigma_m = 1000;

constexpr double kSameOrigin_deg = 1.5e-7;  // the resolution of the message

bool same(const LocalOrigin& a, const LocalOrigin& b) {
  return std::abs(a.place.lat_deg - b.place.lat_deg) < kSameOrigin_deg &&
         std::abs(a.place.lon_deg - b.place.lon_deg) < kSameOrigin_deg;
}

}  // namespace

Px4Plane px4_plane(LonLat origin, LonLat place) {
  const double lat0 = radians(origin.lat_deg), lat = radians(place.lat_deg);
  const double d_lon = radians(place.lon_deg - origin.lon_deg);
  const double cosine = std::sin(lat0) * std::sin(lat) + std::cos(lat0) * std::cos(lat) * std::cos(d_lon);
  const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
  const double scale = angle > 0 ? angle / std::sin(angle) : 1;
  return {scale * (std::cos(lat0) * std::sin(lat) - std::sin(lat0) * std::cos(lat) * std::cos(d_lon)) * kEarthRadius_m,
          scale * std::cos(lat) * std::sin(d_lon) * kEarthRadius_m};
}

std::span<const MessageRate> Px4Backend::streams() const { return kPx4Streams; }

void Px4Backend::on_message(std::int64_t now_us, const IncomingMessage& message) {
  if (const auto* version = std::get_if<AutopilotVersion>(&message)) {
    if (version->flight_software != 0) version_ = version->flight_software;
  } else if (const auto* origin = std::get_if<LocalOrigin>(&message)) {
    if (origin_ && !same(*origin_, *origin)) ++reset_counter_;
    origin_ = *origin;
    origin_us_ = now_us;
    origin_wanted_us_.reset();
  }
}

std::optional<std::vector<OutgoingMessage>> Px4Backend::messages(const DueFix& due) {
  if (due.jumped_m) ++reset_counter_;
  if (!due.fix || due.message.fix < GpsFix::two_d) return std::vector<OutgoingMessage>{};
  if (!missing().empty()) return std::nullopt;
  // As checked for GPS_INPUT (gps_input.hpp): finite, or unknown.
  const GpsInput& checked = due.message;
  const double sigma_m = due.fix->sigma_m;
  if (takes_global_position()) {
    return std::vector<OutgoingMessage>{GlobalPositionSensor{.target = autopilot_,
                                                             .sensor_id = static_cast<std::uint8_t>(gps_id_ + 1),
                                                             .unix_us = checked.unix_us,
                                                             .processing_s = 0,  // propagated to this moment
                                                             .place = checked.place,
                                                             .sigma_m = sigma_m,
                                                             .msl_m = checked.msl_m,
                                                             .vertical_sigma_m = checked.vertical_accuracy_m}};
  }
  const Px4Plane plane = px4_plane(origin_->place, checked.place);
  const bool height = checked.msl_m && checked.vertical_accuracy_m;
  return std::vector<OutgoingMessage>{
      LocalPosition{.unix_us = checked.unix_us,
                    .north_m = plane.north_m,
                    .east_m = plane.east_m,
                    .down_m = height ? origin_->msl_m - *checked.msl_m : 0,
                    .sigma_m = sigma_m,
                    .vertical_sigma_m = height ? *checked.vertical_accuracy_m : kUnknownHeightSigma_m,
                    .reset_counter = reset_counter_}};
}

// Once a second what is missing; the origin also when it is known, because others may move it.
std::vector<OutgoingMessage> Px4Backend::requests(std::int64_t now_us, const DueFix& due) {
  if (now_us < next_request_us_) return {};
  next_request_us_ = now_us + kRequestPeriod_us;
  if (!version_) return {request_message(autopilot_, StreamedMessage::autopilot_version)};
  if (takes_global_position()) return {};
  if (origin_ && now_us - origin_us_ > kOriginLost_us) {
    origin_.reset();
    ++reset_counter_;
  }
  std::vector<OutgoingMessage> requests{request_message(autopilot_, StreamedMessage::local_origin)};
  if (origin_) return requests;
  if (!origin_wanted_us_) origin_wanted_us_ = now_us;
  if (due.fix && now_us - *origin_wanted_us_ >= kOriginPatience_us) {
    requests.emplace_back(SetLocalOrigin{autopilot_.system, due.message.place, due.message.msl_m.value_or(0)});
  }
  return requests;
}

std::string Px4Backend::missing() const {
  if (!version_) return "PX4 has not reported its version (AUTOPILOT_VERSION)";
  if (!takes_global_position() && !origin_) return "PX4 has not reported the origin of its local frame";
  return {};
}

}  // namespace nadir
