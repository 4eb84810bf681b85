#include "candidates/tile_check.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "candidates/flight_maker.hpp"
#include "candidates/image_agreement.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kDay_ms = test::kDay_s * 1000;

class AnnouncedTile : public ::testing::Test {
 protected:
  // The code for a valid tile with one change.
  std::string code(const std::function<void(CandidateSidecar&)>& change) const {
    CandidateSidecar sidecar = good_;
    change(sidecar);
    const auto refusal = check_announced(sidecar, test::kNoon, now_, rules_);
    return refusal ? std::string(name_of(refusal->code)) : "";
  }

  CandidateSidecar good_ = test::FlightMaker().candidate(test::keys_in_a_row(1)[0]).sidecar;
  UtcTime now_{test::kNoon.unix_s + 3600};
  CandidateRules rules_;
};

TEST_F(AnnouncedTile, AValidTileIsAccepted) {
  EXPECT_EQ(code([](CandidateSidecar&) {}), "");
}

TEST_F(AnnouncedTile, EachFaultHasItsReasonCode) {
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

TEST_F(AnnouncedTile, DetectsManipulatedTimes) {
  const auto at = [this](std::int64_t ms) { return code([ms](CandidateSidecar& s) { s.captured_at = {ms}; }); };
  EXPECT_EQ(at(now_.unix_s * 1000 + 6 * 60'000), "captured_in_future");
  EXPECT_EQ(at(test::kNoon.unix_s * 1000 + 6 * 60'000), "captured_in_future") << "after its batch was created";
  EXPECT_EQ(at(test::kNoon.unix_s * 1000 + 4 * 60'000), "") << "clocks differ a little";
  EXPECT_EQ(at(now_.unix_s * 1000 - rules_.max_age_ms - kDay_ms), "too_old");
  EXPECT_EQ(at(0), "too_old");
}

// Each corner was seen by some frame, and the time of each frame counts.
TEST_F(AnnouncedTile, AMosaicIsCheckedByEachOfItsFrames) {
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
  EXPECT_EQ(pieced([](CandidateSidecar& s) { s.parts.clear(); }), "outside_footprint") << "impossible for one frame";
  EXPECT_EQ(pieced([](CandidateSidecar& s) { s.parts[1].pose.lon_e7 += 20'000; }), "outside_footprint");
  EXPECT_EQ(pieced([this](CandidateSidecar& s) { s.parts[1].captured_at.unix_ms = now_.unix_s * 1000 + 6 * 60'000; }),
            "captured_in_future");
}

TEST_F(AnnouncedTile, UncertaintyFavoursTheTile) {
  const double exact = view_angle_rad(good_, 0);
  EXPECT_NEAR(exact, std::atan2(std::hypot(51.7, 51.7), 400), 0.02) << "half a tile of 103 m each way, from 400 m";
  EXPECT_LT(view_angle_rad(good_, 3), exact);
}

const TileKey kPlace = test::keys_in_a_row(1)[0];

cv::Mat grey_of(const cv::Mat& picture) {
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

std::string code_of(const cv::Mat& grey) {
  const auto refusal = check_image_metrics(image_metrics(grey), {});
  return refusal ? std::string(name_of(refusal->code)) : "";
}

// "" when it is read.
std::string read_code(ByteView bytes, const CandidateSidecar& sidecar) {
  const auto read = read_candidate_image(bytes, sidecar);
  return std::holds_alternative<Refusal>(read) ? std::string(name_of(std::get<Refusal>(read).code)) : "";
}

TEST(TileImageCheck, MetricsSeparateGoodImagesFromBadOnes) {
  const cv::Mat good = grey_of(test::FlightMaker().picture(kPlace));
  EXPECT_EQ(code_of(good), "");
  cv::Mat blurred;
  cv::GaussianBlur(good, blurred, {}, 12);
  cv::normalize(blurred, blurred, 40, 220, cv::NORM_MINMAX);
  EXPECT_EQ(code_of(blurred), "blurred");
  EXPECT_EQ(code_of(cv::Mat(256, 256, CV_8UC1, cv::Scalar(90))), "low_texture");
  EXPECT_EQ(code_of(cv::Mat(256, 256, CV_8UC1, cv::Scalar(255))), "low_texture");
  cv::Mat blown = good.clone();
  blown.rowRange(0, 100).setTo(255);
  EXPECT_EQ(code_of(blown), "low_texture");
}

TEST(TileImageCheck, OnlyTheNamedFormatAndSizeIsDecoded) {
  const Candidate good = test::FlightMaker().candidate(kPlace);
  EXPECT_EQ(read_code(good.tile, good.sidecar), "");
  CandidateSidecar webp = good.sidecar;
  webp.format = ImageFormat::webp;
  EXPECT_EQ(read_code(good.tile, webp), "format_unsupported");
  const cv::Mat picture = test::FlightMaker().picture(kPlace);
  EXPECT_EQ(read_code(encode_image(picture, ImageFormat::webp), webp), "");
  EXPECT_EQ(read_code(encode_image(picture, ImageFormat::png), good.sidecar), "format_unsupported");
  EXPECT_EQ(read_code(encode_image(picture.rowRange(0, 255).clone(), ImageFormat::jpeg), good.sidecar),
            "format_unsupported");
  for (const std::size_t length : {0UL, 1UL, 20UL, good.tile.size() / 2}) {
    EXPECT_EQ(read_code(ByteView(good.tile).first(length), good.sidecar), "format_unsupported") << length;
  }
}

TEST(TileImageCheck, ADecompressionBombIsNotDecoded) {
  // A few kilobytes that would become 400 million pixels: the header alone is read.
  const Bytes large = encode_image(cv::Mat(4000, 4000, CV_8UC1, cv::Scalar(7)), ImageFormat::jpeg, 10);
  CandidateSidecar sidecar = test::FlightMaker().candidate(kPlace).sidecar;
  EXPECT_EQ(read_code(large, sidecar), "format_unsupported");
}

Agreement compared(const cv::Mat& one, const cv::Mat& other) {
  return compare_images(FineStructure(one), FineStructure(other));
}

TEST(Agreement, MeasuresTheShiftOfTheSameGround) {
  test::FlightMaker one{{.noise = 1}}, other{{.off_px = 7.5, .noise = 2}};
  const Agreement agreement = compared(grey_of(one.picture(kPlace)), grey_of(other.picture(kPlace)));
  EXPECT_NEAR(agreement.shift_px, 7.5, 0.5);
  EXPECT_GT(agreement.correlation, 0.6);
  const Agreement back = compared(grey_of(other.picture(kPlace)), grey_of(one.picture(kPlace)));
  EXPECT_NEAR(back.shift_px, agreement.shift_px, 0.1);
}

// OpenCV's own phase correlation, and the correlation of the overlap once the other image is moved by its shift.
Agreement agreement_by_opencv(const FineStructure& one, const FineStructure& other) {
  cv::Mat window, moved, correlation;
  cv::createHanningWindow(window, one.values.size(), CV_32F);
  const cv::Point2d shift = cv::phaseCorrelate(one.values, other.values, window);
  const cv::Mat move = (cv::Mat_<double>(2, 3) << 1, 0, -shift.x, 0, 1, -shift.y);
  cv::warpAffine(other.values, moved, move, other.values.size());
  const int margin_px = static_cast<int>(std::ceil(std::hypot(shift.x, shift.y)));
  const cv::Rect common(margin_px, margin_px, 256 - 2 * margin_px, 256 - 2 * margin_px);
  cv::matchTemplate(one.values(common), moved(common), correlation, cv::TM_CCOEFF_NORMED);
  return {.shift_px = std::hypot(shift.x, shift.y), .correlation = correlation.at<float>(0)};
}

TEST(Agreement, IsThatOfOpenCv) {
  for (const double off_px : {0.4, 3.25, 7.5, 20.0}) {
    const FineStructure one(grey_of(test::FlightMaker({.noise = 1}).picture(kPlace)));
    const FineStructure other(grey_of(test::FlightMaker({.off_px = off_px, .noise = 2}).picture(kPlace)));
    const Agreement ours = compare_images(one, other), reference = agreement_by_opencv(one, other);
    EXPECT_NEAR(ours.shift_px, reference.shift_px, 0.02) << off_px;
    EXPECT_NEAR(ours.correlation, reference.correlation, 0.03) << off_px;
  }
}

TEST(Agreement, IsInvariantToLightAndRejectsOtherGround) {
  const cv::Mat one = grey_of(test::FlightMaker({.noise = 1}).picture(kPlace));
  cv::Mat darker;
  grey_of(test::FlightMaker({.noise = 2}).picture(kPlace)).convertTo(darker, CV_8U, 0.5, 10);
  const Agreement same = compared(one, darker);
  EXPECT_LT(same.shift_px, 0.3);
  EXPECT_GT(same.correlation, 0.6);
  const cv::Mat elsewhere = grey_of(test::FlightMaker({.ground = 9}).picture(kPlace));
  EXPECT_LT(compared(one, elsewhere).correlation, 0.35);
}

TEST(Agreement, TexturelessImagesAgreeWithNothing) {
  const cv::Mat flat(256, 256, CV_8UC1, cv::Scalar(90));
  const cv::Mat good = grey_of(test::FlightMaker().picture(kPlace));
  EXPECT_LT(compared(flat, flat).correlation, 0.35);
  EXPECT_LT(compared(flat, good).correlation, 0.35);
  EXPECT_LT(compared(good, flat).correlation, 0.35);
}

}  // namespace
}  // namespace nadir
