// Failsafe, the lead of GPS or pictures, the link and the restart; the figures are typed in from the design.
#include <gtest/gtest.h>

#include <cmath>

#include "service/machine_driver.hpp"
#include "service/service_machine.hpp"

namespace nadir {
namespace {

using test::MachineDriver;
using enum ServiceState;
using Why = ServiceReason;
using SourceLabel::dead_reckoned;
using SourceLabel::satellite_anchored;
using SourceLabel::vo_extrapolated;

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
  flight.on(AutopilotHeartbeat{false, true});
  EXPECT_FALSE(flight.status().link_up) << "a stranger is no autopilot";
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

}  // namespace
}  // namespace nadir
