// What each kind of autopilot gets for a fix.
#include "fixes/autopilot_backend.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "fixes/px4_backend.hpp"

namespace nadir {
namespace {

constexpr MavlinkAddress kAutopilot{1, 1};
constexpr LonLat kPlace{8.5, 47.25};
constexpr std::int64_t kSecond_us = 1'000'000;

DueFix fix_at(LonLat place, double sigma_m = 3) {
  DueFix due;
  due.fix =
      Fix{.unix_us = 1'760'000'000'000'000, .place = place, .sigma_m = sigma_m, .msl_m = 600, .vertical_sigma_m = 4};
  due.message = gps_input(*due.fix);
  return due;
}

DueFix no_fix() {
  DueFix due;
  due.message = gps_input_without_fix(1'760'000'000'000'000);
  return due;
}

AutopilotVersion version(std::uint32_t major, std::uint32_t minor) {
  return {.flight_software = major << 24 | minor << 16 | 255U};
}

template <class Message>
Message only(const std::optional<std::vector<OutgoingMessage>>& messages) {
  if (!messages || messages->size() != 1 || !std::holds_alternative<Message>(messages->front())) {
    ADD_FAILURE() << "not one message of that kind";
    return {};
  }
  return std::get<Message>(messages->front());
}

// Whether one of them is of that kind.
template <class Message>
bool has(const std::vector<OutgoingMessage>& messages) {
  for (const OutgoingMessage& message : messages) {
    if (std::holds_alternative<Message>(message)) return true;
  }
  return false;
}

TEST(AutopilotBackend, OtherAutopilotsAreRefused) {
  EXPECT_EQ(make_autopilot_backend(AutopilotType::other, kAutopilot, 0), nullptr);
  EXPECT_EQ(make_autopilot_backend(AutopilotType::none, kAutopilot, 0), nullptr);
  EXPECT_EQ(name_of_autopilot({.autopilot = AutopilotType::other, .autopilot_number = 18}), "MAV_AUTOPILOT 18");
}

TEST(AutopilotBackend, ArduPilotGetsGpsInputAlsoWithoutAFix) {
  const auto backend = make_autopilot_backend(AutopilotType::ardupilot, kAutopilot, 0);
  EXPECT_EQ(only<GpsInput>(backend->messages(fix_at(kPlace))).place, kPlace);
  EXPECT_EQ(only<GpsInput>(backend->messages(no_fix())).fix, GpsFix::no_gps);
  EXPECT_TRUE(backend->requests(0, fix_at(kPlace)).empty());
  EXPECT_TRUE(backend->missing().empty());
}

TEST(AutopilotBackend, TheRealReceiverIsJudged) {
  EXPECT_FALSE(is_real_receiver(AutopilotType::ardupilot, {.receiver = 1}, 0));
  EXPECT_TRUE(is_real_receiver(AutopilotType::ardupilot, {.receiver = 2}, 0));
  EXPECT_TRUE(is_real_receiver(AutopilotType::px4, {.receiver = 1}, 0)) << "PX4 plays nothing of ours back";
  EXPECT_FALSE(is_real_receiver(AutopilotType::px4, {.receiver = 2}, 0));
}

TEST(Px4, NothingIsSentBeforeItsVersionIsKnown) {
  Px4Backend px4(kAutopilot, 0);
  EXPECT_EQ(px4.messages(fix_at(kPlace)), std::nullopt);
  EXPECT_NE(px4.missing().find("AUTOPILOT_VERSION"), std::string::npos);
  const auto asked = px4.requests(kSecond_us, fix_at(kPlace));
  ASSERT_TRUE(has<CommandLong>(asked));
  EXPECT_EQ(std::get<CommandLong>(asked[0]).parameters[0], 148);
  EXPECT_TRUE(px4.requests(kSecond_us + 100'000, fix_at(kPlace)).empty()) << "once a second";
  px4.on_message(0, AutopilotVersion{});
  EXPECT_FALSE(px4.missing().empty()) << "zeros are no version";
}

TEST(Px4, From118OnItGetsGlobalPositions) {
  Px4Backend px4(kAutopilot, 1);
  px4.on_message(0, version(1, 18));
  const auto sent = only<GlobalPositionSensor>(px4.messages(fix_at(kPlace, 3.5)));
  EXPECT_EQ(sent.sensor_id, 2) << "of the slot that gps_id names";
  EXPECT_EQ(sent.place, kPlace);
  EXPECT_EQ(sent.sigma_m, 3.5);
  EXPECT_EQ(sent.processing_s, 0) << "a fix is propagated to the moment of its sending";
  EXPECT_EQ(sent.msl_m, 600);
  EXPECT_EQ(px4.messages(no_fix())->size(), 0U) << "silence";
  EXPECT_TRUE(px4.requests(5 * kSecond_us, fix_at(kPlace)).empty()) << "no origin is needed";
  px4.on_message(0, version(2, 0));
  only<GlobalPositionSensor>(px4.messages(fix_at(kPlace)));
}

TEST(Px4, BeforeItGetsOdometryAboutTheOriginThatItReports) {
  Px4Backend px4(kAutopilot, 0);
  px4.on_message(0, version(1, 17));
  EXPECT_EQ(px4.messages(fix_at(kPlace)), std::nullopt);
  px4.on_message(0, LocalOrigin{{8.5, 47.24}, 500});
  const auto sent = only<LocalPosition>(px4.messages(fix_at(kPlace)));
  EXPECT_NEAR(sent.north_m, 0.01 * std::numbers::pi / 180 * 6'371'000, 1e-3) << "on PX4's sphere";
  EXPECT_NEAR(sent.east_m, 0, 1e-6);
  EXPECT_EQ(sent.down_m, -100);
  EXPECT_EQ(sent.sigma_m, 3);
  EXPECT_EQ(sent.vertical_sigma_m, 4);
}

TEST(Px4, AnUnknownHeightHasALargeVarianceAndNotNone) {
  Px4Backend px4(kAutopilot, 0);
  px4.on_message(0, version(1, 16));
  px4.on_message(0, LocalOrigin{kPlace, 500});
  DueFix due = fix_at(kPlace);
  due.fix->msl_m.reset();
  due.message = gps_input(*due.fix);
  const auto sent = only<LocalPosition>(px4.messages(due));
  EXPECT_EQ(sent.down_m, 0);
  EXPECT_GE(sent.vertical_sigma_m, 100);
}

TEST(Px4, WithoutAnOriginItIsGivenOne) {
  Px4Backend px4(kAutopilot, 0);
  px4.on_message(0, version(1, 17));
  bool set = false;
  for (int second = 1; second <= 5; ++second) {
    const auto requests = px4.requests(second * kSecond_us, fix_at(kPlace));
    EXPECT_TRUE(has<CommandLong>(requests));
    EXPECT_FALSE(has<SetLocalOrigin>(requests) && second < 4) << "it may have one, and needs time to say so";
    set = set || has<SetLocalOrigin>(requests);
  }
  EXPECT_TRUE(set);
  EXPECT_FALSE(has<SetLocalOrigin>(px4.requests(9 * kSecond_us, no_fix()))) << "not without a position";
}

TEST(Px4, JumpsAndMovedOriginsChangeTheResetCounter) {
  Px4Backend px4(kAutopilot, 0);
  px4.on_message(0, version(1, 17));
  px4.on_message(0, LocalOrigin{kPlace, 500});
  const auto first = only<LocalPosition>(px4.messages(fix_at(kPlace))).reset_counter;
  px4.on_message(0, LocalOrigin{kPlace, 500});
  EXPECT_EQ(only<LocalPosition>(px4.messages(fix_at(kPlace))).reset_counter, first);
  DueFix jump = fix_at(kPlace);
  jump.jumped_m = 80;
  EXPECT_EQ(only<LocalPosition>(px4.messages(jump)).reset_counter, first + 1);
  EXPECT_EQ(only<LocalPosition>(px4.messages(fix_at(kPlace))).reset_counter, first + 1);
  px4.on_message(0, LocalOrigin{{8.6, 47.3}, 500});
  const auto moved = only<LocalPosition>(px4.messages(fix_at(kPlace)));
  EXPECT_EQ(moved.reset_counter, first + 2);
  EXPECT_LT(moved.north_m, -5000);
}

TEST(Px4, AnOriginThatIsNoLongerReportedIsLost) {
  Px4Backend px4(kAutopilot, 0);
  px4.on_message(0, version(1, 17));
  px4.on_message(kSecond_us, LocalOrigin{kPlace, 500});
  static_cast<void>(px4.requests(5 * kSecond_us, fix_at(kPlace)));
  EXPECT_TRUE(px4.messages(fix_at(kPlace)));
  static_cast<void>(px4.requests(7 * kSecond_us, fix_at(kPlace)));
  EXPECT_EQ(px4.messages(fix_at(kPlace)), std::nullopt) << "it has restarted: its metres count from elsewhere";
}

// reproject() of PX4's lib/geo/geo.cpp.
LonLat reprojected(LonLat origin, const Px4Plane& plane) {
  constexpr double kRadius_m = 6'371'000, kDegrees = 180 / std::numbers::pi;
  const double x = plane.north_m / kRadius_m, y = plane.east_m / kRadius_m, c = std::hypot(x, y);
  if (c == 0) return origin;
  const double lat0 = origin.lat_deg / kDegrees;
  const double lat = std::asin(std::cos(c) * std::sin(lat0) + x * std::sin(c) * std::cos(lat0) / c);
  const double lon = std::atan2(y * std::sin(c), c * std::cos(lat0) * std::cos(c) - x * std::sin(lat0) * std::sin(c));
  return {origin.lon_deg + lon * kDegrees, lat * kDegrees};
}

TEST(Px4, ItsProjectionGivesThePlaceBack) {
  for (const LonLat origin : {LonLat{8.5, 47.25}, LonLat{-70.2, -33.4}, LonLat{179.99, 65}}) {
    for (const double d_lon : {-0.3, 0.0, 1e-6, 0.2}) {
      for (const double d_lat : {-0.2, 0.0, 1e-6, 0.3}) {
        const LonLat place{origin.lon_deg + d_lon, origin.lat_deg + d_lat};
        const LonLat back = reprojected(origin, px4_plane(origin, place));
        EXPECT_NEAR(back.lat_deg, place.lat_deg, 1e-9);
        EXPECT_NEAR(back.lon_deg, place.lon_deg, 1e-9);
      }
    }
  }
}

}  // namespace
}  // namespace nadir
