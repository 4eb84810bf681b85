// Missions with everything that formats must carry, and with numbers that no decimal of seven digits holds.
#pragma once

#include <gtest/gtest.h>

#include "package/mission.hpp"
#include "package/mission_yaml.hpp"

namespace nadir::test {

inline Mission sample_mission() {
  Mission mission;
  mission.id = "harbour-a";
  mission.series = "harbour";
  mission.sequence = 7;
  mission.created = *parse_utc("2026-05-01");
  mission.expires = *parse_utc("2026-06-01");
  mission.takeoff = {11.0 + 1.0 / 3, 48.0 + 1.0 / 7};
  mission.terrain = {true, 431.25};
  mission.zoom = {15, 19};
  mission.min_resolution_m = 0.5;
  mission.budget_mb = 300;
  mission.freshness_days = {730, 90};
  mission.airframes = {"mini-07", "mini-08"};
  const LonLat& at = mission.takeoff;
  mission.sectors = {
      {"old-town",
       SectorClass::stable,
       {{at.lon_deg, at.lat_deg}, {at.lon_deg + 0.002, at.lat_deg}, {at.lon_deg + 0.001, at.lat_deg + 0.0017}},
       0},
      {"quay",
       SectorClass::active,
       {{at.lon_deg + 0.01, at.lat_deg},
        {at.lon_deg + 0.012, at.lat_deg + 1e-13},
        {at.lon_deg + 0.011, at.lat_deg + 0.001}},
       75.5}};
  mission.route.corridor_half_width_m = 80;
  mission.route.agl_m = 120;
  mission.route.points = {at, {at.lon_deg + 0.1 / 3, at.lat_deg + 0.01 / 7}, {at.lon_deg + 0.05, at.lat_deg - 0.003}};
  mission.route.height_frame = HeightFrame::above_takeoff;
  mission.route.heights_m = {50, 120.1, 400.0 / 3};
  mission.no_fly = {
      {"range",
       {{at.lon_deg + 0.02, at.lat_deg}, {at.lon_deg + 0.021, at.lat_deg}, {at.lon_deg + 0.02, at.lat_deg + 0.001}},
       {},
       0},
      {"mast", {}, {at.lon_deg + 0.03, at.lat_deg + 0.01}, 1000.0 / 3}};
  mission.integrity.alert_limit_m = 75;
  return mission;
}

inline Mission area_alone() {
  Mission mission = sample_mission();
  mission.route.points.clear();
  mission.route.heights_m.clear();
  mission.route.height_frame = HeightFrame::above_ground;
  mission.no_fly.clear();
  return mission;
}

}  // namespace nadir::test
