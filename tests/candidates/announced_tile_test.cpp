#include "candidates/tile_check.hpp"

#include <gtest/gtest.h>

#include "candidates/flight_maker.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kDay_ms = test::kDay_s * 1000;

class AnnouncedTile : public ::testing::Test {
 protected:
  // The code for a tile that is good but for one change.
  std::string code(const std::function<void(CandidateSidecar&)>& change) const {
    CandidateSidecar sidecar = good_;
    change(sidecar);
    const auto refusal = judge_announced(sidecar, test::kNoon, now_, rules_);
    return refusal ? std::string(name_of(refusal->code)) : "";
  }

  CandidateSidecar good_ = test::FlightMaker().candidate(test::keys_in_a_row(1)[0]).sidecar;
  UtcTime now_{test::kNoon.unix_s + 3600};
  CandidateRules rules_;
};

TEST_F(AnnouncedTile, AGoodOneIsTaken) {
  EXPECT_EQ(code([](CandidateSidecar&) {}), "");
}

TEST_F(AnnouncedTile, EachFaultHasItsCode) {
  using Side = CandidateSidecar;
  EXPECT_EQ(code([](Side& s) { s.size = 100; }), "size_out_of_range");
  EXPECT_EQ(code([](Side& s) { s.size = 300'000; }), "size_out_of_range");
  EXPECT_EQ(code([](Side& s) { s.format = ImageFormat::png; }), "format_unsupported");
  EXPECT_EQ(code([](Side& s) { s.key = {18, 1U << 18, 5}; }), "address_invalid");
  EXPECT_EQ(code([](Side& s) { s.key = {18, 5, 0xffffffff}; }), "address_invalid");
  EXPECT_EQ(code([](Side& s) { s.key = {24, s.key.x, s.key.y}; }), "address_invalid");
  EXPECT_EQ(code([](Side& s) { s.key.x += 30; }), "outside_footprint");
  EXPECT_EQ(code([](Side& s) { s.pose.lat_e7 = -s.pose.lat_e7; }), "outside_footprint");
  EXPECT_EQ(code([](Side& s) { s.pose.agl_mm = 20'000; }), "outside_footprint");
  EXPECT_EQ(code([](Side& s) { s.pose.sigma_mm = 5'001; }), "pose_uncertain");
  EXPECT_EQ(code([](Side& s) { s.source = SourceLabel::vo_extrapolated; }), "pose_uncertain");
  EXPECT_EQ(code([](Side& s) { s.anchor_age_ms = 10'001; }), "anchor_too_old");
  EXPECT_EQ(code([](Side& s) { s.quality.contrast_ppm = 1'000; }), "low_texture");
  EXPECT_EQ(code([](Side& s) { s.quality.overlap_ppm = 999'999; }), "policy");
}

TEST_F(AnnouncedTile, ClockTricksAreSeenThrough) {
  const auto at = [this](std::int64_t ms) { return code([ms](CandidateSidecar& s) { s.captured_at = {ms}; }); };
  EXPECT_EQ(at(now_.unix_s * 1000 + 6 * 60'000), "captured_in_future");
  EXPECT_EQ(at(test::kNoon.unix_s * 1000 + 6 * 60'000), "captured_in_future") << "after its batch was made";
  EXPECT_EQ(at(test::kNoon.unix_s * 1000 + 4 * 60'000), "") << "clocks differ a little";
  EXPECT_EQ(at(now_.unix_s * 1000 - rules_.max_age_ms - kDay_ms), "too_old");
  EXPECT_EQ(at(0), "too_old");
}

// Each corner was seen by somebody, and everybody's clock counts.
TEST_F(AnnouncedTile, OfSeveralFramesIsJudgedByEachOfThem) {
  const auto pieced = [this](const std::function<void(CandidateSidecar&)>& change) {
    return code([&](CandidateSidecar& s) {
      s.pose.agl_mm = 36'000;
      const CandidatePart part{.frame = "a", .captured_at = s.captured_at, .share_ppm = 500'000, .pose = s.pose};
      s.parts = {part, part};
      s.parts[0].pose.lon_e7 -= 5'000;  // 38 m to the west and to the east of the tile's middle
      s.parts[1].pose.lon_e7 += 5'000;
      change(s);
    });
  };
  EXPECT_EQ(pieced([](CandidateSidecar&) {}), "");
  EXPECT_EQ(pieced([](CandidateSidecar& s) { s.parts.clear(); }), "outside_footprint") << "one frame cannot have";
  EXPECT_EQ(pieced([](CandidateSidecar& s) { s.parts[1].pose.lon_e7 += 20'000; }), "outside_footprint");
  EXPECT_EQ(pieced([this](CandidateSidecar& s) { s.parts[1].captured_at.unix_ms = now_.unix_s * 1000 + 6 * 60'000; }),
            "captured_in_future");
}

TEST_F(AnnouncedTile, UncertaintyIsOnTheTilesSide) {
  const double exact = view_angle_rad(good_, 0);
  EXPECT_NEAR(exact, std::atan2(std::hypot(51.7, 51.7), 400), 0.02) << "half a tile of 103 m each way, from 400 m";
  EXPECT_LT(view_angle_rad(good_, 3), exact);
}

}  // namespace
}  // namespace nadir
