#include "service/gps_health.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

using enum GpsVerdict;

constexpr LonLat kHome{8.55, 47.37};

// An aircraft that flies east at 25 m/s, its receiver at 5 Hz and its eyes at 5 Hz, each where the test wants them.
class Flight {
 public:
  struct Seen {
    double gps_off_m = 0;     // north of the truth
    double vision_off_m = 0;  // the same
    double gps_late_s = 0;    // from measurement to message
    bool gps_fix = true;
    bool gps_speaks = true;
    bool vision_speaks = true;
    bool glitch = false;
    bool ekf_knows = true;
    std::optional<double> speed_mps = 25;
    std::optional<double> accuracy_m = 2;
    double vision_sigma_m = 8;
  };

  GpsVerdict step(const Seen& seen) {
    now_s += 0.2;
    const double east_m = 25 * (now_s - 1000);
    if (seen.vision_speaks)
      health.on_vision({.time_s = now_s - 0.1,
                        .place = at(east_m - 2.5, seen.vision_off_m),
                        .covariance_m2 = seen.vision_sigma_m * seen.vision_sigma_m * Eigen::Matrix2d::Identity(),
                        .velocity_mps = {25, 0},
                        .velocity_sigma_mps = 1});
    if (seen.gps_speaks) {
      const LonLat place = at(east_m - 25 * seen.gps_late_s, seen.gps_off_m);
      health.on_event(GpsFix3d{now_s, seen.gps_fix, place, seen.speed_mps, seen.accuracy_m});
    }
    health.on_event(EkfReport{now_s, seen.ekf_knows, seen.glitch});
    return (assessment = health.assess(now_s)).verdict;
  }

  GpsVerdict fly(double seconds, const Seen& seen) {
    for (const double end_s = now_s + seconds - 0.1; now_s < end_s;) step(seen);
    return assessment.verdict;
  }

  double now_s = 1000;
  GpsHealth health{now_s};
  GpsAssessment assessment;

 private:
  LonLat at(double east_m, double north_m) const { return frame_.lonlat_from_plane({east_m, north_m}); }
  LocalFrame frame_{kHome};
};

TEST(GpsHealth, TrustsTheFirstFixAndContinues) {
  Flight flight;
  EXPECT_EQ(flight.health.assess(flight.now_s).verdict, unknown);
  EXPECT_EQ(flight.step({}), trusted);
  EXPECT_EQ(flight.fly(600, {}), trusted);
}

TEST(GpsHealth, OrdinaryNoiseIsNotSpoofing) {
  Flight flight;
  for (int i = 0; i < 3000; ++i) {
    ASSERT_EQ(flight.step({.gps_off_m = 6 * std::sin(i * 0.7), .vision_off_m = 15 * std::cos(i * 0.3)}), trusted)
        << i << flight.assessment.reason;
  }
}

TEST(GpsHealth, SilenceIsDenialAfterOneAndAHalfSeconds) {
  Flight flight;
  flight.fly(5, {});
  flight.now_s += 1.49;
  EXPECT_EQ(flight.health.assess(flight.now_s).verdict, trusted);
  flight.now_s += 0.02;
  EXPECT_EQ(flight.health.assess(flight.now_s).verdict, denied);
}

TEST(GpsHealth, AReceiverThatIsNeverReceivedIsDenied) {
  GpsHealth health(50);
  EXPECT_EQ(health.assess(51.4).verdict, unknown);
  EXPECT_EQ(health.assess(51.6).verdict, denied);
}

TEST(GpsHealth, ALostLinkMeansNothingForGps) {
  Flight flight;
  flight.fly(5, {});
  for (int i = 0; i < 100; ++i) EXPECT_EQ(flight.health.assess(flight.now_s += 0.2, false).verdict, trusted);
  EXPECT_EQ(flight.health.assess(flight.now_s += 1.4).verdict, trusted);
  EXPECT_EQ(flight.health.assess(flight.now_s += 0.2).verdict, denied);
}

TEST(GpsHealth, ALostFixIsDenialWellWithinThreeSeconds) {
  Flight flight;
  flight.fly(5, {});
  const double lost_s = flight.now_s;
  while (flight.step({.gps_fix = false}) != denied) ASSERT_LT(flight.now_s - lost_s, 1.0);
  EXPECT_EQ(flight.assessment.reason, "the receiver has no fix");
}

TEST(GpsHealth, OneMessageWithoutAFixIsTolerated) {
  Flight flight;
  flight.fly(5, {});
  EXPECT_EQ(flight.step({.gps_fix = false}), trusted);
  EXPECT_EQ(flight.fly(20, {}), trusted);
}

TEST(GpsHealth, AStepOf300MetresIsSpoofingAtOnceWithAndWithoutVision) {
  for (const bool vision : {true, false}) {
    Flight flight;
    flight.fly(20, {.vision_speaks = vision});
    EXPECT_EQ(flight.step({.gps_off_m = 300, .vision_speaks = vision}), spoofed) << vision;
    EXPECT_NE(flight.assessment.reason.find("a step of 300 m"), std::string::npos) << flight.assessment.reason;
    EXPECT_EQ(flight.fly(300, {.gps_off_m = 300, .vision_speaks = vision}), spoofed) << "it never becomes true";
  }
}

TEST(GpsHealth, AReportedBadAccuracyDoesNotHideTheStep) {
  Flight flight;
  flight.fly(20, {});
  EXPECT_EQ(flight.step({.gps_off_m = 300, .accuracy_m = 5000}), spoofed);
}

TEST(GpsHealth, ADragOffIsFoundTheNearerTheBetterVisionIs) {
  for (const auto& [vision_sigma_m, limit_m] : {std::pair{2.0, 20.0}, {8.0, 42.0}}) {
    for (const double m_per_s : {0.2, 0.5, 1.0, 2.0, 5.0}) {
      Flight flight;
      flight.fly(20, {.vision_sigma_m = vision_sigma_m});
      double off_m = 0;
      while (flight.step({.gps_off_m = off_m, .vision_sigma_m = vision_sigma_m}) == trusted) {
        off_m += m_per_s * 0.2;
        ASSERT_LT(off_m, limit_m) << m_per_s;
      }
      EXPECT_EQ(flight.assessment.verdict, spoofed);
      EXPECT_NE(flight.assessment.reason.find("visual position"), std::string::npos);
    }
  }
}

// 22 m of flight lie between an old frame and a fix, and 8 m between a late fix and its message.
TEST(GpsHealth, PositionsAreComparedAtOneTimeAndLateFixesAreHonest) {
  Flight flight;
  for (int i = 0; i < 200; ++i) {
    ASSERT_EQ(flight.step({.gps_late_s = 0.3, .vision_speaks = i % 5 == 0, .vision_sigma_m = 1}), trusted)
        << flight.assessment.reason;
  }
  EXPECT_EQ(flight.fly(2, {.gps_off_m = 16, .vision_sigma_m = 1}), spoofed) << "as far, but across the track";
}

// Not far enough to be accused again, and too far to be trusted.
TEST(GpsHealth, BetweenAgreementAndDisagreementItIsNotTrustedAgain) {
  Flight flight;
  flight.fly(20, {.vision_sigma_m = 3});
  ASSERT_EQ(flight.fly(2, {.gps_off_m = 20, .vision_sigma_m = 3}), spoofed);
  EXPECT_EQ(flight.fly(60, {.gps_off_m = 13, .vision_sigma_m = 3}), spoofed);
  EXPECT_EQ(flight.fly(10.6, {.gps_off_m = 5, .vision_sigma_m = 3}), trusted);
}

TEST(GpsHealth, DisagreementMustLast) {
  Flight flight;
  flight.fly(20, {});
  EXPECT_EQ(flight.fly(0.8, {.vision_off_m = 150}), trusted) << "one bad anchor accuses nobody";
  EXPECT_EQ(flight.fly(20, {}), trusted);
  EXPECT_EQ(flight.fly(1.6, {.vision_off_m = 150}), spoofed);
}

TEST(GpsHealth, InaccurateVisionProvesNothing) {
  Flight flight;
  flight.fly(20, {.vision_sigma_m = 100});
  EXPECT_EQ(flight.fly(30, {.vision_off_m = 400, .vision_sigma_m = 100}), trusted);
  EXPECT_EQ(flight.fly(30, {.vision_off_m = 150, .vision_sigma_m = 50}), trusted) << "within both sigmas";
}

TEST(GpsHealth, ImpossibleSpeedIsSpoofing) {
  Flight flight;
  flight.fly(5, {});
  EXPECT_EQ(flight.step({.speed_mps = 99}), trusted);
  EXPECT_EQ(flight.step({.speed_mps = 101}), spoofed);
}

TEST(GpsHealth, TheAutopilotsAlarmCountsAfterASecond) {
  Flight flight;
  flight.fly(5, {});
  EXPECT_EQ(flight.fly(0.8, {.glitch = true}), trusted);
  EXPECT_EQ(flight.fly(0.8, {.glitch = true}), spoofed);
  Flight lost;
  lost.fly(5, {});
  EXPECT_EQ(lost.fly(0.8, {.ekf_knows = false}), trusted);
  EXPECT_EQ(lost.fly(0.8, {.ekf_knows = false}), denied);
}

TEST(GpsHealth, AFilterThatHasNotStartedMeansNothing) {
  Flight flight;
  EXPECT_EQ(flight.fly(30, {.ekf_knows = false}), trusted);
}

TEST(GpsHealth, AfterSpoofingItMustBeStableAndAgreeForTenSeconds) {
  Flight flight;
  flight.fly(20, {});
  flight.fly(20, {.gps_off_m = 300});
  ASSERT_EQ(flight.assessment.verdict, spoofed);
  flight.step({});  // the step back is one more step
  EXPECT_EQ(flight.fly(9.8, {}), spoofed);
  EXPECT_EQ(flight.fly(0.6, {}), trusted);
}

TEST(GpsHealth, AfterSpoofingStabilityAloneIsNeverEnough) {
  Flight flight;
  flight.fly(20, {});
  flight.fly(20, {.gps_off_m = 300});
  EXPECT_EQ(flight.fly(300, {.vision_speaks = false}), spoofed);
  EXPECT_EQ(flight.fly(9.8, {}), spoofed);
  EXPECT_EQ(flight.fly(0.6, {}), trusted);
}

TEST(GpsHealth, ADisturbanceRestartsTheInterval) {
  Flight flight;
  flight.fly(20, {});
  flight.fly(20, {.gps_off_m = 300});
  flight.fly(8, {});
  flight.step({.gps_fix = false});
  EXPECT_EQ(flight.fly(9.8, {}), spoofed);
  EXPECT_EQ(flight.fly(0.6, {}), trusted);
}

TEST(GpsHealth, AfterDenialWithoutVisionAMinuteOfStabilityIsEnough) {
  Flight flight;
  flight.fly(20, {.vision_speaks = false});
  flight.fly(5, {.gps_fix = false, .vision_speaks = false});
  ASSERT_EQ(flight.assessment.verdict, denied);
  EXPECT_EQ(flight.fly(59, {.vision_speaks = false}), denied);
  EXPECT_EQ(flight.fly(2, {.vision_speaks = false}), trusted);
}

// Switched on beside a receiver that still looks for satellites: nobody denied it anything.
TEST(GpsHealth, TheFirstFixAfterASearchIsTrustedWithinSeconds) {
  Flight flight;
  EXPECT_EQ(flight.fly(20, {.gps_fix = false, .vision_speaks = false}), denied);
  EXPECT_EQ(flight.fly(4.8, {.vision_speaks = false}), denied);
  EXPECT_EQ(flight.fly(0.6, {.vision_speaks = false}), trusted);
  flight.fly(5, {.gps_fix = false, .vision_speaks = false});
  EXPECT_EQ(flight.fly(59, {.vision_speaks = false}), denied) << "the second one does";
}

TEST(GpsHealth, AfterARestartInFlightThereIsNoFirstFix) {
  Flight flight;
  flight.health.on_restart();
  flight.fly(20, {.gps_fix = false, .vision_speaks = false});
  EXPECT_EQ(flight.fly(59, {.vision_speaks = false}), denied);
  EXPECT_EQ(flight.fly(2, {.vision_speaks = false}), trusted);
}

TEST(GpsHealth, AFirstFixThatVisionContradictsIsSpoofed) {
  Flight flight;
  flight.fly(20, {.gps_fix = false});
  EXPECT_EQ(flight.fly(20, {.gps_off_m = 300}), spoofed);
  EXPECT_EQ(flight.fly(70, {.gps_off_m = 300, .vision_speaks = false}), spoofed);
}

// After half a minute of dead reckoning the filter is where our fix took it, and finds the receiver far off.
TEST(GpsHealth, AlarmsOfAFilterWithoutTheReceiverAreIgnored) {
  Flight flight;
  flight.fly(20, {});
  flight.fly(12, {.gps_fix = false, .vision_speaks = false});
  ASSERT_EQ(flight.assessment.verdict, denied);
  flight.fly(16, {.vision_speaks = false});
  EXPECT_EQ(flight.fly(8, {.vision_speaks = false, .glitch = true}), denied);
  EXPECT_EQ(flight.fly(35, {.vision_speaks = false}), denied);
  EXPECT_EQ(flight.fly(2, {.vision_speaks = false}), trusted) << "a minute after it came back";
}

// ArduPilot reports a glitch for as long as our fix claims a speed that is known to 2 m/s.
TEST(GpsHealth, AnAlarmAboutOurFixNeitherDeniesAReceiverNorDelaysTrust) {
  Flight flight;
  flight.fly(5, {.gps_fix = false});
  ASSERT_EQ(flight.assessment.verdict, denied);
  for (int i = 0; i < 600; ++i) {
    flight.health.our_fix_in_use(flight.now_s);
    flight.step({.glitch = true});
  }
  EXPECT_EQ(flight.assessment.verdict, trusted);
  EXPECT_EQ(flight.step({.gps_off_m = 300, .glitch = true}), spoofed);
}

TEST(GpsHealth, AlarmsAboutOurFixDoNotDenyATrustedReceiver) {
  Flight flight;
  flight.fly(20, {});
  for (int i = 0; i < 150; ++i) {
    flight.health.our_fix_in_use(flight.now_s);
    ASSERT_EQ(flight.step({.vision_speaks = false, .glitch = i > 100}), trusted);
  }
  EXPECT_EQ(flight.fly(14, {.vision_speaks = false, .glitch = true}), trusted) << "it has not come to the receiver yet";
  EXPECT_EQ(flight.fly(2, {.vision_speaks = false, .glitch = true}), spoofed) << "it had time to";
}

TEST(GpsHealth, AStepIsSpoofingAlsoWhileOurFixIsInUse) {
  Flight flight;
  flight.fly(20, {});
  flight.health.our_fix_in_use(flight.now_s);
  EXPECT_EQ(flight.step({.gps_off_m = 300, .vision_speaks = false}), spoofed);
}

TEST(GpsHealth, NoReceiverIsTrustedAgainDuringAFilterAlarm) {
  Flight flight;
  flight.fly(20, {});
  flight.fly(5, {.gps_fix = false, .vision_speaks = false});
  EXPECT_EQ(flight.fly(90, {.vision_speaks = false, .glitch = true}), denied);
  EXPECT_EQ(flight.step({.vision_speaks = false}), trusted);
  EXPECT_EQ(flight.fly(20, {.vision_speaks = false}), trusted);
}

TEST(GpsHealth, JammingThenSpoofingIsDetectedByVision) {
  Flight flight;
  flight.fly(20, {});
  flight.fly(20, {.gps_fix = false});
  EXPECT_EQ(flight.fly(120, {.gps_off_m = 300}), spoofed);
  EXPECT_EQ(flight.fly(20, {.gps_speaks = false}), spoofed) << "a spoofed receiver that falls silent";
}

TEST(GpsHealth, NonFiniteNumbersAreNoFix) {
  for (const LonLat place : {LonLat{std::nan(""), 47}, LonLat{8, 91}, LonLat{181, 0}, LonLat{8, -INFINITY}}) {
    GpsHealth health(0);
    for (double t = 0.2; t < 1.2; t += 0.2) health.on_event(GpsFix3d{t, true, place, 20, 2});
    EXPECT_EQ(health.assess(1.2).verdict, denied);
  }
  Flight flight;
  EXPECT_EQ(flight.fly(5, {.speed_mps = NAN, .accuracy_m = NAN, .vision_sigma_m = NAN}), trusted);
}

TEST(GpsHealth, RepeatedAndLateMessagesChangeNothing) {
  GpsHealth health(0);
  for (double t = 0.2; t < 5; t += 0.2) {
    health.on_event(GpsFix3d{t, true, kHome, 0, 2});
    health.on_event(GpsFix3d{t, true, {kHome.lon_deg + 1, kHome.lat_deg}, 0, 2});
    health.on_event(GpsFix3d{t - 0.1, true, {kHome.lon_deg + 1, kHome.lat_deg}, 0, 2});
  }
  EXPECT_EQ(health.assess(5).verdict, trusted);
}

LonLat east_by(double metres) { return LocalFrame({14.0, 48.8}).lonlat_from_plane({metres, 0}); }

TEST(GpsHints, TheFirstPlaceIsAHintEvenWithAPosition) {
  GpsHints hints;
  EXPECT_TRUE(hints.due(east_by(0), true));
  EXPECT_FALSE(hints.due(east_by(0), true));
}

TEST(GpsHints, WithoutAPositionHintsFollowTheAircraft) {
  GpsHints hints;
  int given = 0;
  for (double metres = 0; metres <= 960; metres += 40) given += hints.due(east_by(metres), false);
  EXPECT_EQ(given, 13) << "every 80 m: 40 are too little";
}

TEST(GpsHints, NoHintWithAPositionOrWithoutMotion) {
  GpsHints hints;
  hints.due(east_by(0), false);
  EXPECT_FALSE(hints.due(east_by(500), true));
  EXPECT_FALSE(hints.due(east_by(60), false));
  EXPECT_TRUE(hints.due(east_by(500), false)) << "lost again";
  EXPECT_FALSE(hints.due({std::nan(""), 48.8}, false));
}

}  // namespace
}  // namespace nadir
