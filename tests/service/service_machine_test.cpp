// Each rule of docs/onboard.md, just before and just after its bound. The figures are typed in from the design, not
// taken from service_rules.hpp.
#include "service/service_machine.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <limits>

#include "service/machine_driver.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

using test::MachineDriver;
using enum ServiceState;
using Why = ServiceReason;
using SourceLabel::dead_reckoned;
using SourceLabel::satellite_anchored;
using SourceLabel::vo_extrapolated;

TEST(ServiceMachine, StartsUpStepByStep) {
  MachineDriver flight;
  EXPECT_EQ(flight.state(), boot);
  EXPECT_FALSE(flight.status().serves_fixes);
  flight.on(PackageVerified{true});
  EXPECT_EQ(flight.state(), awaiting_autopilot);
  flight.on(AutopilotHeartbeat{LinkAuthentication::signature, false});
  EXPECT_EQ(flight.state(), relocalizing);
  EXPECT_TRUE(flight.status().serves_fixes);
  EXPECT_FALSE(flight.status().fix);
  EXPECT_EQ(flight.status().sigma_m, 999);
  flight.frame(satellite_anchored, 4);
  EXPECT_EQ(flight.state(), normal);
  EXPECT_TRUE(flight.status().fix);
  EXPECT_EQ(flight.status().source, satellite_anchored);
  EXPECT_EQ(flight.status().sigma_m, 4);
  ASSERT_EQ(flight.events.size(), 3);
  EXPECT_EQ(flight.events[2].from, relocalizing);
  EXPECT_EQ(flight.events[2].to, normal);
  EXPECT_EQ(flight.events[2].reason, Why::first_anchor);
}

TEST(ServiceMachine, AnUnsignedLinkIsNamedAsSuch) {
  MachineDriver flight;
  flight.on(PackageVerified{true});
  flight.on(AutopilotHeartbeat{LinkAuthentication::not_required, false});
  EXPECT_EQ(flight.state(), relocalizing);
  ASSERT_EQ(flight.events.size(), 2);
  EXPECT_EQ(flight.events[1].reason, Why::link_without_signing);
}

TEST(ServiceMachine, OrderOfTheBootDoesNotMatter) {
  MachineDriver flight;
  flight.frame(satellite_anchored);
  flight.on(AutopilotHeartbeat{LinkAuthentication::signature, false});
  EXPECT_EQ(flight.state(), boot);
  flight.on(PackageVerified{true});
  EXPECT_EQ(flight.state(), relocalizing);
  flight.frame(vo_extrapolated);  // found before; the next good picture confirms it
  EXPECT_EQ(flight.state(), normal);
}

TEST(ServiceMachine, ARejectedPackageProvidesNoPosition) {
  MachineDriver flight;
  flight.on(PackageVerified{false, "manifest.signature: no key that we trust"});
  flight.heartbeat();
  flight.fly(10, satellite_anchored);
  EXPECT_EQ(flight.count(Why::package_refused), 1);
  EXPECT_NE(flight.events[0].text.find("no key that we trust"), std::string::npos);
  EXPECT_FALSE(flight.status().serves_fixes);
  EXPECT_FALSE(flight.status().fix);
  EXPECT_FALSE(flight.saw(Why::first_anchor));
}

TEST(ServiceMachine, AnUnauthenticatedLinkIsNoLink) {
  MachineDriver flight;
  flight.on(PackageVerified{true});
  for (int i = 0; i < 20; ++i) flight.on(AutopilotHeartbeat{LinkAuthentication::missing, true});
  flight.frame(satellite_anchored);
  EXPECT_EQ(flight.state(), awaiting_autopilot);
  EXPECT_EQ(flight.count(Why::link_unsigned), 1);
  flight.on(AutopilotHeartbeat{LinkAuthentication::signature, true});
  EXPECT_EQ(flight.state(), relocalizing);
}

TEST(ServiceMachine, OnlyAnAnchorEndsTheSearch) {
  MachineDriver flight;
  flight.boot_to_search();
  flight.fly(5, vo_extrapolated);
  flight.frame(dead_reckoned);
  EXPECT_EQ(flight.state(), relocalizing);
  EXPECT_FALSE(flight.status().fix);
}

TEST(ServiceMachine, ALateAnchorEndsTheSearchToo) {
  MachineDriver flight;
  flight.boot_to_search();
  flight.fly(3);
  EXPECT_EQ(flight.state(), ServiceState::relocalizing);
  flight.on(test::estimate(SourceLabel::dead_reckoned, 8, true));
  EXPECT_EQ(flight.state(), ServiceState::relocalizing) << "pictures must carry it";
  flight.on(test::estimate(SourceLabel::vo_extrapolated, 8, true));
  EXPECT_EQ(flight.state(), ServiceState::normal);
}

TEST(ServiceMachine, AnUnusableFrameIsDeadReckoningAtOnce) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.now_s += 0.3;
  flight.frame(dead_reckoned, 6);
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_EQ(flight.status().source, dead_reckoned);
  EXPECT_TRUE(flight.status().fix);
  EXPECT_TRUE(flight.saw(Why::frame_unfit));
}

TEST(ServiceMachine, ASilentCameraIsDeadReckoningAfter400Milliseconds) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.now_s += 0.399;
  flight.tick();
  EXPECT_EQ(flight.state(), normal);
  flight.now_s += 0.002;
  flight.tick();
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_EQ(flight.status().source, dead_reckoned);
  EXPECT_TRUE(flight.saw(Why::camera_silent));
}

TEST(ServiceMachine, ASlowCameraIsSilentWhenOneFrameIsMissing) {
  MachineDriver flight(2.0);
  flight.boot_to_normal();
  flight.now_s += 2.3;
  flight.tick();
  EXPECT_EQ(flight.state(), normal);
  flight.now_s += 0.2;
  flight.tick();
  EXPECT_EQ(flight.state(), degraded);
}

TEST(ServiceMachine, FramesWithoutEstimatesAreDeadReckoningAfterASecond) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.now_s += 0.2;
  flight.on(FrameReceived{});
  const double first_s = flight.now_s;
  while (flight.now_s + 0.2 < first_s + 1) {
    flight.now_s += 0.2;
    flight.on(FrameReceived{});
  }
  flight.now_s = first_s + 0.999;
  flight.tick();
  EXPECT_EQ(flight.state(), normal);
  flight.now_s = first_s + 1.001;
  flight.tick();
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_TRUE(flight.saw(Why::localizer_late));
}

TEST(ServiceMachine, DeadReckoningEndsAfterAStableSecond) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.wait(5);
  ASSERT_EQ(flight.state(), degraded);
  flight.frame(vo_extrapolated);
  flight.fly(0.9);
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_EQ(flight.status().source, dead_reckoned) << "the better label waits as well";
  flight.fly(0.2);
  EXPECT_EQ(flight.state(), normal);
  EXPECT_EQ(flight.status().source, vo_extrapolated);
  EXPECT_TRUE(flight.saw(Why::vision_back));
}

TEST(ServiceMachine, ABreakRestartsTheStableSecond) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.frame(dead_reckoned);
  flight.fly(0.9);
  flight.now_s += 0.1;
  flight.frame(dead_reckoned);
  flight.fly(0.8);
  EXPECT_EQ(flight.state(), degraded);
  flight.wait(0.45);  // the camera pauses
  flight.fly(0.9);
  EXPECT_EQ(flight.state(), degraded);
  flight.fly(0.4);
  EXPECT_EQ(flight.state(), normal);
}

TEST(ServiceMachine, EveryOtherFrameUnusableDoesNotOscillate) {
  MachineDriver flight;
  flight.boot_to_normal();
  for (int i = 0; i < 50; ++i) {
    flight.now_s += 0.3;
    flight.frame(i % 2 == 0 ? dead_reckoned : vo_extrapolated);
  }
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_EQ(flight.count(Why::frame_unfit), 1);
  EXPECT_FALSE(flight.saw(Why::vision_back));
}

TEST(ServiceMachine, BlindForThirtySecondsIsNoFix) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.wait(29.95);
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_TRUE(flight.status().fix);
  flight.wait(0.1);
  EXPECT_EQ(flight.state(), no_fix);
  EXPECT_FALSE(flight.status().fix);
  EXPECT_TRUE(flight.status().serves_fixes) << "as fix_type 0";
  EXPECT_EQ(flight.status().sigma_m, 999);
  EXPECT_EQ(flight.status().source, SourceLabel::no_fix);
  EXPECT_TRUE(flight.saw(Why::blind_too_long));
}

TEST(ServiceMachine, UnusableFramesForThirtySecondsAreNoFixToo) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.fly(29.9, dead_reckoned, 40);
  EXPECT_EQ(flight.state(), degraded);
  flight.fly(0.3, dead_reckoned, 40);
  EXPECT_EQ(flight.state(), no_fix);
}

TEST(ServiceMachine, SigmaBeyond500MetresIsNoFix) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.frame(vo_extrapolated, 500);
  EXPECT_EQ(flight.state(), normal);
  flight.frame(vo_extrapolated, 500.1);
  EXPECT_EQ(flight.state(), no_fix);
  EXPECT_EQ(flight.status().sigma_m, 999);
  EXPECT_TRUE(flight.saw(Why::sigma_too_large));
}

TEST(ServiceMachine, SigmaGrowsMonotonicallyWhileBlind) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.wait(0.5);
  double last_m = flight.status().sigma_m;
  for (int i = 0; i < 250; ++i) {
    flight.now_s += 0.1;
    if (i % 7 == 3) flight.frame(dead_reckoned, 5 + i * 0.01);  // the localizer is more confident than the machine
    flight.tick();
    ASSERT_EQ(flight.state(), degraded);
    ASSERT_GE(flight.status().sigma_m, last_m) << i;
    last_m = flight.status().sigma_m;
  }
  EXPECT_GT(last_m, 5);
}

TEST(ServiceMachine, SigmaThatGrowsBlindlyEndsTheFixAt500Metres) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.frame(dead_reckoned, 450);
  flight.wait(9.9);
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_GT(flight.status().sigma_m, 480);
  flight.wait(0.3);
  EXPECT_EQ(flight.state(), no_fix);
}

TEST(ServiceMachine, NonFiniteNumbersAreNoPosition) {
  for (const double sigma_m : {std::nan(""), -1.0, std::numeric_limits<double>::infinity()}) {
    MachineDriver flight;
    flight.boot_to_normal();
    flight.frame(satellite_anchored, sigma_m);
    EXPECT_EQ(flight.state(), no_fix) << sigma_m;
    EXPECT_TRUE(flight.saw(Why::localizer_lost));
  }
}

TEST(ServiceMachine, NoFixEndsOnlyWithAnAnchorAndAStableSecond) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.on(GpsAssessment{GpsVerdict::trusted});  // or failsafe would come first
  flight.frame(SourceLabel::no_fix);
  flight.fly(5);
  EXPECT_EQ(flight.state(), no_fix) << "odometry alone knows no place";
  flight.fly(5, satellite_anchored, 401);
  EXPECT_EQ(flight.state(), no_fix) << "hysteresis of sigma";
  flight.frame(satellite_anchored, 399);
  flight.fly(0.9, vo_extrapolated, 399);
  EXPECT_EQ(flight.state(), no_fix);
  EXPECT_FALSE(flight.status().fix);
  flight.fly(0.2, vo_extrapolated, 399);
  EXPECT_EQ(flight.state(), normal);
  EXPECT_TRUE(flight.saw(Why::anchored_again));
}

TEST(ServiceMachine, TimeNeverRunsBackwards) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.now_s += 0.3;
  flight.frame(vo_extrapolated);
  const double latest_s = flight.now_s;
  flight.now_s = 3;
  flight.frame(dead_reckoned);
  EXPECT_EQ(flight.events.back().time_s, latest_s);
  flight.now_s = std::nan("");
  flight.frame(vo_extrapolated);
  EXPECT_EQ(flight.state(), degraded);
}

TEST(ServiceMachine, AStallOfTheServiceItselfIsDetected) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.now_s += 40;  // nobody called for so long: every rule still holds, one after the other
  flight.tick();
  EXPECT_TRUE(flight.saw(Why::camera_silent));
  EXPECT_TRUE(flight.saw(Why::blind_too_long));
  EXPECT_EQ(flight.state(), failsafe);
}

TEST(ServiceMachine, AnAnchorBeforeALossDoesNotCount) {
  MachineDriver flight;
  flight.frame(satellite_anchored);
  flight.frame(SourceLabel::no_fix);
  flight.boot_to_search();
  flight.fly(2);
  EXPECT_EQ(flight.state(), relocalizing);
}

TEST(ServiceMachine, IsDeterministic) {
  const auto fly = [] {
    MachineDriver flight;
    flight.boot_to_normal();
    flight.fly(3);
    flight.wait(50);
    flight.frame(satellite_anchored);
    flight.fly(5);
    std::string lines;
    for (const StateTransition& event : flight.events) lines += std::to_string(event.time_s) + event.text + "\n";
    return lines;
  };
  EXPECT_EQ(fly(), fly());
}

// Failsafe, the lead of GPS or pictures, the link and the restart; the figures are typed in from the design.

TEST(FailsafeAndLead, NoPositionForThreeSecondsIsFailsafe) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.frame(SourceLabel::no_fix);
  flight.wait(2.95);
  EXPECT_EQ(flight.state(), no_fix);
  flight.wait(0.1);
  EXPECT_EQ(flight.state(), failsafe);
  EXPECT_FALSE(flight.status().fix);
  EXPECT_TRUE(flight.status().serves_fixes);
}

TEST(FailsafeAndLead, FailsafeReturnsAfterTwoSteadySeconds) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.frame(SourceLabel::no_fix);
  flight.wait(4);
  ASSERT_EQ(flight.state(), failsafe);
  flight.frame(satellite_anchored);
  flight.fly(1.9);
  EXPECT_EQ(flight.state(), failsafe);
  flight.fly(0.2);
  EXPECT_EQ(flight.state(), normal);
}

TEST(FailsafeAndLead, WhileGpsIsTrustedThereIsAPosition) {
  MachineDriver flight;
  flight.boot_to_search();
  flight.on(GpsAssessment{GpsVerdict::trusted});
  flight.heartbeat();
  flight.wait(20);
  EXPECT_EQ(flight.state(), relocalizing);
  flight.on(GpsAssessment{GpsVerdict::denied, "the receiver has no fix"});
  flight.wait(2.95);
  EXPECT_EQ(flight.state(), relocalizing);
  flight.wait(0.1);
  EXPECT_EQ(flight.state(), failsafe);
}

TEST(FailsafeAndLead, FailsafeFromEveryStateBelowAFix) {
  // Armed, so that a position is owed; nothing else is good.
  MachineDriver booting;
  booting.heartbeat();
  booting.wait(3.1);
  EXPECT_EQ(booting.state(), failsafe);

  MachineDriver refused;
  refused.on(PackageVerified{false, "tiles.root"});
  refused.heartbeat();
  refused.wait(3.1);
  EXPECT_EQ(refused.state(), failsafe);
  EXPECT_FALSE(refused.status().serves_fixes);
  refused.fly(5, satellite_anchored);
  EXPECT_EQ(refused.state(), failsafe) << "no package, no position of ours";
  refused.on(GpsAssessment{GpsVerdict::trusted});
  EXPECT_EQ(refused.state(), no_package);

  MachineDriver searching;
  searching.boot_to_search();
  searching.heartbeat();
  searching.wait(3.1);
  EXPECT_EQ(searching.state(), failsafe);
  searching.frame(satellite_anchored);
  EXPECT_EQ(searching.state(), normal) << "the first position is no return: it waits for nothing";
}

TEST(FailsafeAndLead, OnTheGroundNoPositionIsRequired) {
  MachineDriver flight;
  flight.boot_to_search();
  flight.wait(60);
  EXPECT_EQ(flight.state(), relocalizing);
}

TEST(FailsafeAndLead, TrustedGpsEndsFailsafeWithoutAPositionOfOurs) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.wait(40);
  ASSERT_EQ(flight.state(), failsafe);
  flight.on(GpsAssessment{GpsVerdict::trusted});
  EXPECT_EQ(flight.state(), no_fix);
  EXPECT_FALSE(flight.status().fix);
}

TEST(FailsafeAndLead, OurFixLeadsAtOnceWhenGpsFails) {
  for (const GpsVerdict verdict : {GpsVerdict::denied, GpsVerdict::spoofed}) {
    MachineDriver flight;
    flight.boot_to_normal();
    flight.on(GpsAssessment{GpsVerdict::trusted});
    EXPECT_EQ(flight.status().leader, PositionLeader::gps);
    flight.on(GpsAssessment{verdict, "why"});
    EXPECT_EQ(flight.status().leader, PositionLeader::vision);
    EXPECT_EQ(flight.events.back().reason, Why::vision_leads);
    EXPECT_EQ(flight.events.back().from, flight.events.back().to);
    flight.on(GpsAssessment{GpsVerdict::trusted});
    EXPECT_EQ(flight.status().leader, PositionLeader::gps);
    EXPECT_TRUE(flight.saw(Why::gps_leads));
  }
}

// No text says that the autopilot navigates by our position while its parameters say otherwise, or nothing.
TEST(FailsafeAndLead, ThatTheAutopilotUsesOurFixIsSaidWhereItIsKnown) {
  using enum ParameterCheck;
  for (const auto& [check, why] :
       {std::pair(as_provisioned, "GPS is denied"), std::pair(deviating, "not as they were provisioned"),
        std::pair(none_listed, "the airframe file lists no parameters")}) {
    MachineDriver flight(ServiceConfig{.parameters = pending});
    flight.boot_to_normal();
    flight.on(ParametersCompared{check});
    flight.on(GpsAssessment{GpsVerdict::denied, "why"});
    EXPECT_EQ(flight.status().leader, PositionLeader::vision);
    EXPECT_EQ(flight.count(Why::vision_leads), check == as_provisioned ? 1 : 0);
    EXPECT_EQ(flight.count(Why::vision_leads_unconfirmed), check == as_provisioned ? 0 : 1);
    EXPECT_NE(flight.events.back().text.find(why), std::string::npos) << flight.events.back().text;
  }
}

TEST(FailsafeAndLead, ParametersThatAreComparedLateDecideThen) {
  using enum ParameterCheck;
  MachineDriver flight(ServiceConfig{.parameters = pending});
  flight.boot_to_normal();
  flight.on(GpsAssessment{GpsVerdict::denied, "why"});
  flight.fly(14.5);
  EXPECT_FALSE(flight.saw(Why::vision_leads) || flight.saw(Why::vision_leads_unconfirmed)) << "it is not known yet";
  flight.fly(1);
  EXPECT_EQ(flight.count(Why::vision_leads_unconfirmed), 1);
  EXPECT_NE(flight.events.back().text.find("have not all been compared"), std::string::npos);
  flight.on(ParametersCompared{as_provisioned});
  EXPECT_EQ(flight.count(Why::vision_leads), 1);
  flight.on(ParametersCompared{deviating});
  EXPECT_EQ(flight.count(Why::vision_leads_unconfirmed), 2);
  flight.on(GpsAssessment{GpsVerdict::trusted});
  EXPECT_TRUE(flight.saw(Why::gps_leads));
  flight.on(ParametersCompared{as_provisioned});
  EXPECT_EQ(flight.count(Why::vision_leads), 1) << "GPS leads";
}

TEST(FailsafeAndLead, OurFixLeadsAsSoonAsThereIsAPosition) {
  MachineDriver flight;
  flight.boot_to_search();
  flight.on(GpsAssessment{GpsVerdict::denied});
  EXPECT_EQ(flight.status().leader, PositionLeader::gps);
  flight.frame(satellite_anchored);
  EXPECT_EQ(flight.status().leader, PositionLeader::vision);
  flight.wait(60);  // blind, no fix, failsafe: GPS is still bad, so nobody goes back to it
  EXPECT_EQ(flight.status().leader, PositionLeader::vision);
  EXPECT_EQ(flight.count(Why::vision_leads), 1);
}

TEST(FailsafeAndLead, ReportsALostLinkAfterFiveSecondsAndContinues) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.fly(4.9);
  EXPECT_TRUE(flight.status().link_up);
  flight.fly(0.3);
  EXPECT_FALSE(flight.status().link_up);
  EXPECT_EQ(flight.state(), normal);
  EXPECT_EQ(flight.count(Why::link_lost), 1);
  flight.on(AutopilotHeartbeat{LinkAuthentication::missing, true});
  EXPECT_FALSE(flight.status().link_up) << "an unknown sender is not the autopilot";
  flight.heartbeat();
  EXPECT_TRUE(flight.status().link_up);
  EXPECT_EQ(flight.count(Why::link_back), 1);
}

TEST(FailsafeAndLead, ARestartContinuesFromTheSavedPosition) {
  MachineDriver flight;
  flight.on(EstimateRestored{.sigma_m = 100, .speed_mps = 20});
  flight.now_s += 2;
  flight.boot_to_search();
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_TRUE(flight.status().fix);
  EXPECT_NEAR(flight.status().sigma_m, 140, 1e-9);
  EXPECT_EQ(flight.status().source, dead_reckoned);
  flight.fly(3, vo_extrapolated, 150);
  EXPECT_EQ(flight.state(), degraded) << "only an anchor makes it normal";
  flight.frame(satellite_anchored);
  EXPECT_EQ(flight.state(), normal) << "steady for three seconds already";
}

TEST(FailsafeAndLead, AnInaccurateSavedPositionIsNoFix) {
  MachineDriver flight;
  flight.on(EstimateRestored{.sigma_m = 480, .speed_mps = 30});
  flight.now_s += 1;
  flight.boot_to_search();
  EXPECT_EQ(flight.state(), relocalizing);
  MachineDriver broken;
  broken.on(EstimateRestored{.sigma_m = std::nan(""), .speed_mps = 30});
  broken.boot_to_search();
  EXPECT_EQ(broken.state(), relocalizing);
}

// Frames come, odometry carries the position, and every look at the map throws: that is not "nothing was due".
TEST(ServiceMachine, AMatcherThatKeepsFailingDegradesUntilAMatchCompletes) {
  test::MachineDriver flight;
  flight.boot_to_normal();
  flight.fly(2);
  for (int i = 1; i < kMatchFailures; ++i) flight.on(MatchFailed{"out of memory"});
  EXPECT_EQ(flight.state(), ServiceState::normal) << "a few may fail";
  flight.on(MatchFailed{"out of memory"});
  EXPECT_EQ(flight.state(), ServiceState::degraded);
  EXPECT_EQ(flight.status().reason, ServiceReason::matcher_failing);
  flight.fly(5);
  EXPECT_EQ(flight.state(), ServiceState::degraded) << "odometry alone does not end it";
  EXPECT_EQ(flight.count(ServiceReason::matcher_failing), 1);
  LocalizedFrame match = test::estimate(SourceLabel::vo_extrapolated, 5);
  match.late = true;
  match.report.anchor.verdict = AnchorVerdict::ambiguous;
  flight.on(match);
  flight.fly(2);
  EXPECT_EQ(flight.state(), ServiceState::normal);
}

TEST(ServiceMachine, AMatcherThatKeepsFailingIsReportedInASearchToo) {
  test::MachineDriver flight;
  flight.boot_to_search();
  for (int i = 0; i < 3 * kMatchFailures; ++i) flight.on(MatchFailed{"out of memory"});
  EXPECT_EQ(flight.state(), ServiceState::relocalizing);
  EXPECT_EQ(flight.count(ServiceReason::matcher_failing), 1);
}

TEST(ServiceMachine, DurationsInTheReasonGrowWhileItLasts) {
  ServiceMachine machine(1000);
  double now_s = 1000;
  machine.on_event(now_s, PackageVerified{true});
  machine.on_event(now_s, AutopilotHeartbeat{LinkAuthentication::signature, true});
  machine.on_event(now_s, FrameReceived{});
  machine.on_event(now_s, test::estimate(SourceLabel::satellite_anchored, 5));
  machine.update(now_s + 0.5);
  EXPECT_EQ(machine.reason_text(), "no frames from the camera: no frame for 0.50 s");
  machine.update(now_s + 12.25);
  EXPECT_EQ(machine.reason_text(), "no frames from the camera: no frame for 12.25 s");
  EXPECT_EQ(machine.status().frame_s, now_s);
  machine.update(now_s + 40);
  EXPECT_EQ(machine.status().state, ServiceState::failsafe);
  machine.update(now_s + 50);
  EXPECT_NE(machine.reason_text().find("for 37."), std::string::npos) << machine.reason_text();
}

// ---- usable or not: alert limit 100 m, time to alert 3 s

double time_of(const MachineDriver& flight, Why reason) {
  for (const StateTransition& event : flight.events) {
    if (event.reason == reason) return event.time_s;
  }
  return -1;
}

TEST(Integrity, APositionBeyondTheAlertLimitIsReportedWithinTheTimeToAlertAndStillSent) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.fly_with_level(5, 40);
  EXPECT_TRUE(flight.status().usable);
  EXPECT_EQ(flight.status().hpl_m, 40);
  const double left_s = flight.now_s;
  flight.fly_with_level(20, 130);
  EXPECT_EQ(flight.count(Why::position_not_usable), 1);
  const double told_s = time_of(flight, Why::position_not_usable);
  EXPECT_GT(told_s, left_s);
  EXPECT_LE(told_s, left_s + 3);
  EXPECT_FALSE(flight.status().usable);
  EXPECT_EQ(flight.state(), normal) << "its accuracy says how bad it is: the fix goes on";
  EXPECT_TRUE(flight.status().fix);
  const double back_s = flight.now_s;
  flight.fly_with_level(2.9, 40);
  EXPECT_FALSE(flight.saw(Why::position_usable_again));
  flight.fly_with_level(0.6, 40);
  EXPECT_EQ(flight.count(Why::position_usable_again), 1);
  EXPECT_GE(time_of(flight, Why::position_usable_again), back_s + 3);
  EXPECT_TRUE(flight.status().usable);
}

TEST(Integrity, TheNoticesChangeNoStateAndSayTheLevel) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.fly_with_level(5, 40);
  flight.fly_with_level(3, 130);
  const StateTransition& notice = flight.events.back();
  ASSERT_EQ(notice.reason, Why::position_not_usable);
  EXPECT_EQ(notice.from, notice.to);
  EXPECT_NE(notice.text.find("130 m"), std::string::npos) << notice.text;
}

TEST(Integrity, TheMissionSetsLimitAndTime) {
  MachineDriver flight(ServiceConfig{.integrity_risk = 1e-7, .alert_limit_m = 30, .time_to_alert_s = 10});
  flight.boot_to_normal();
  flight.fly_with_level(11, 29);
  EXPECT_TRUE(flight.status().usable);
  flight.fly_with_level(4.8, 31);
  EXPECT_FALSE(flight.saw(Why::position_not_usable));
  flight.fly_with_level(0.6, 31);
  EXPECT_TRUE(flight.saw(Why::position_not_usable));
}

TEST(Integrity, WithoutAProtectionLevelThereIsNoFixAfterTheTimeToAlert) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.on(GpsAssessment{GpsVerdict::trusted});  // or failsafe would follow
  flight.fly_with_level(5, 40);
  const double left_s = flight.now_s;
  flight.fly_with_level(3, {});
  EXPECT_EQ(flight.state(), normal);
  EXPECT_TRUE(flight.saw(Why::position_not_usable)) << "the operator knows first";
  flight.fly_with_level(0.6, {});
  EXPECT_EQ(flight.state(), no_fix);
  EXPECT_FALSE(flight.status().fix);
  EXPECT_FALSE(flight.status().hpl_m);
  EXPECT_LE(time_of(flight, Why::integrity_lost), left_s + 3.5);

  flight.fly_with_level(10, {}, satellite_anchored);
  EXPECT_EQ(flight.state(), no_fix) << "a match alone does not bound it";
  flight.fly_with_level(2.8, 40, satellite_anchored);
  EXPECT_EQ(flight.state(), no_fix);
  flight.fly_with_level(0.6, 40, satellite_anchored);
  EXPECT_EQ(flight.state(), normal);
  EXPECT_EQ(flight.count(Why::integrity_lost), 1);
}

TEST(Integrity, AShortGapInTheLevelKeepsTheFix) {
  MachineDriver flight;
  flight.boot_to_normal();
  for (int i = 0; i < 20; ++i) {
    flight.fly_with_level(2.4, {});
    flight.frame_with_level(40);
  }
  EXPECT_EQ(flight.state(), normal);
  EXPECT_FALSE(flight.saw(Why::integrity_lost));
  EXPECT_EQ(flight.count(Why::position_not_usable), 1) << "not usable all the while, and said so once";
}

TEST(Integrity, TheFirstAnchorHasTheTimeToAlertToFindALevel) {
  MachineDriver flight;
  flight.boot_to_search();
  flight.fly_with_level(20, {});  // searching: nothing is provided, nothing is reported
  EXPECT_FALSE(flight.saw(Why::position_not_usable));
  flight.frame_with_level({}, satellite_anchored);
  EXPECT_EQ(flight.state(), normal);
  flight.fly_with_level(1, {});
  EXPECT_EQ(flight.state(), normal);
  flight.fly_with_level(5, 60, satellite_anchored);
  EXPECT_EQ(flight.state(), normal);
  EXPECT_TRUE(flight.status().usable);
  EXPECT_FALSE(flight.saw(Why::integrity_lost));
}

TEST(Integrity, NoLevelInFailsafeDoesNotBringTheFixBack) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.fly_with_level(10, {}, satellite_anchored);
  EXPECT_EQ(flight.state(), failsafe);
  EXPECT_EQ(flight.count(Why::integrity_lost), 1);
  flight.fly_with_level(60, {}, satellite_anchored);
  EXPECT_EQ(flight.state(), failsafe) << "it does not oscillate";
  flight.fly_with_level(3.4, 40, satellite_anchored);
  EXPECT_EQ(flight.state(), normal);
}

TEST(Integrity, TheLevelGrowsWithSigmaWhileBlind) {
  MachineDriver flight;
  flight.boot_to_normal();
  flight.fly_with_level(5, 40);
  flight.now_s += 0.5;
  flight.tick();
  ASSERT_EQ(flight.state(), degraded);
  double last_m = flight.status().hpl_m.value_or(1e9);
  const double blind_s = flight.now_s;
  while (flight.now_s < blind_s + 10) {
    flight.wait(0.1);
    ASSERT_TRUE(flight.status().hpl_m);
    ASSERT_GE(*flight.status().hpl_m, last_m);
    last_m = *flight.status().hpl_m;
  }
  // 4.8 sigmas of 5 m/s over 10.5 s, on top of 40 m.
  EXPECT_NEAR(last_m, 40 + 4.8 * 5 * 10.5, 3);
  EXPECT_EQ(flight.state(), degraded) << "the rules of blindness are what they were";
  EXPECT_TRUE(flight.status().fix);
  EXPECT_EQ(flight.count(Why::position_not_usable), 1);
}

TEST(Integrity, ARestoredPositionIsSentAsBeforeButNotUsable) {
  MachineDriver flight;
  flight.on(EstimateRestored{.sigma_m = 50, .speed_mps = 20});
  flight.boot_to_search();
  ASSERT_EQ(flight.state(), degraded);
  flight.wait(5);
  EXPECT_EQ(flight.state(), degraded);
  EXPECT_TRUE(flight.status().fix);
  EXPECT_FALSE(flight.status().usable);
  EXPECT_FALSE(flight.status().hpl_m);
  EXPECT_EQ(flight.count(Why::position_not_usable), 1);
}

TEST(Integrity, NoNumberIsNoLevel) {
  for (const double level_m : {std::nan(""), -1.0, std::numeric_limits<double>::infinity()}) {
    MachineDriver flight;
    flight.boot_to_normal();
    flight.fly_with_level(4, level_m);
    EXPECT_FALSE(flight.status().usable) << level_m;
    EXPECT_EQ(flight.state(), no_fix) << level_m;
  }
}

}  // namespace
}  // namespace nadir
