#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "ortho/candidate_store.hpp"
#include "ortho/sample_candidates.hpp"
#include "ortho/tile_mosaic.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr int kSide = 256;

// The waves of the synthetic ground at 0.4 m a pixel, moved by so many pixels.
cv::Mat picture(double dx, double dy, double contrast = 1) {
  cv::Mat colour(kSide, kSide, CV_8UC3);
  for (int r = 0; r < kSide; ++r) {
    for (int c = 0; c < kSide; ++c) {
      const double grey = 128 + contrast * (test::waves({0.4 * (c - dx), 0.4 * (r - dy)}) - 128);
      colour.at<cv::Vec3b>(r, c) = cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(grey));
    }
  }
  return colour;
}

cv::Mat band(int from, int to) {
  cv::Mat mask = cv::Mat::zeros(kSide, kSide, CV_8UC1);
  mask.colRange(from, to).setTo(255);
  return mask;
}

TEST(Seam, MeasuresTheDisplacement) {
  for (const auto& [dx, dy] : {std::pair{0.0, 0.0}, {3.0, -2.0}, {0.5, 1.5}, {-4.0, 4.0}}) {
    const auto seam = measure_seam(picture(0, 0), picture(dx, dy), band(100, 180), 6);
    ASSERT_TRUE(seam);
    EXPECT_NEAR(seam->shift_px, std::hypot(dx, dy), 0.15);
    EXPECT_GT(seam->correlation, 0.97);
  }
}

TEST(Seam, IsIndependentOfBrightness) {
  const auto seam = measure_seam(picture(0, 0), picture(2, 0, 0.4), band(0, 256), 6);
  ASSERT_TRUE(seam);
  EXPECT_NEAR(seam->shift_px, 2, 0.15);
}

TEST(Seam, UsesTheOverlapOnly) {
  cv::Mat other = picture(1, 0);
  other.colRange(0, 90).setTo(cv::Scalar::all(0));
  other.colRange(180, kSide).setTo(cv::Scalar::all(255));
  const auto seam = measure_seam(picture(0, 0), other, band(90, 180), 6);
  ASSERT_TRUE(seam);
  EXPECT_NEAR(seam->shift_px, 1, 0.15);
  EXPECT_GT(seam->correlation, 0.97);
}

TEST(Seam, IsUnknownWithoutEnoughOverlap) {
  EXPECT_FALSE(measure_seam(picture(0, 0), picture(0, 0), band(100, 130), 6));
  EXPECT_FALSE(measure_seam(picture(0, 0), picture(0, 0), cv::Mat::zeros(kSide, kSide, CV_8UC1), 6));
}

TEST(Seam, FlatAndUnrelatedImagesDoNotCorrelate) {
  const cv::Mat flat(kSide, kSide, CV_8UC3, cv::Scalar::all(90));
  for (const auto& [one, other] : {std::pair{flat, flat}, {flat, picture(0, 0)}, {picture(0, 0), flat}}) {
    const auto seam = measure_seam(one, other, band(0, 256), 6);
    ASSERT_TRUE(seam);
    EXPECT_LT(seam->correlation, 0.5);
  }
  cv::Mat noise(kSide, kSide, CV_8UC3);
  cv::RNG(5).fill(noise, cv::RNG::UNIFORM, 0, 256);
  EXPECT_LT(measure_seam(picture(0, 0), noise, band(0, 256), 6)->correlation, 0.5);
}

// Tiles of several frames: by hand-made pieces here, by frames over a synthetic ground in candidate_maker_test.cpp.

constexpr TileKey kMosaicKey{18, 139'000, 91'000};
constexpr double kPixel_m = 0.4;

// What a frame shows from column `from` to before `to`: the waves, moved by so many pixels to the east.
PartialTile piece(int from, int to, double slant = 0.1, double moved_px = 0) {
  PartialTile patch;
  patch.key = kMosaicKey;
  patch.image.create(kTileSize, kTileSize, CV_8UC3);
  for (int r = 0; r < kTileSize; ++r) {
    for (int c = 0; c < kTileSize; ++c) {
      const double grey = test::waves({kPixel_m * (c - moved_px), -kPixel_m * r});
      patch.image.at<cv::Vec3b>(r, c) = cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(grey));
    }
  }
  patch.seen = cv::Mat::zeros(kTileSize, kTileSize, CV_8UC1);
  patch.seen.colRange(from, to).setTo(255);
  patch.slants = cv::Mat(kTileSize, kTileSize, CV_32FC1, cv::Scalar::all(slant));
  patch.seen_px = (to - from) * kTileSize;
  patch.least_view_rad = std::atan(slant);
  return patch;
}

CandidateSidecar frame(int number, std::int64_t sigma_mm = 2000) {
  CandidateSidecar sidecar = test::sample_sidecar({0, 0, 0});
  sidecar.frame = "frame_" + std::to_string(number);
  sidecar.captured_at.unix_ms += 1000 * number;
  sidecar.pose.sigma_mm = sigma_mm;
  return sidecar;
}

TEST(TileMosaic, BecomesCompleteFromAlignedParts) {
  TileMosaic mosaic(kMosaicKey, kPixel_m, {});
  EXPECT_EQ(mosaic.add(piece(0, 150), frame(2)), PartialTileOutcome::merged);
  EXPECT_FALSE(mosaic.whole());
  EXPECT_EQ(mosaic.add(piece(90, 256), frame(1, 2500)), PartialTileOutcome::merged);
  ASSERT_TRUE(mosaic.whole());
  const cv::Mat expected = piece(0, 256).image;
  EXPECT_EQ(cv::norm(mosaic.image(), expected, cv::NORM_INF), 0);

  const auto sidecar = mosaic.sidecar();
  ASSERT_TRUE(sidecar);
  EXPECT_EQ(sidecar->key, kMosaicKey);
  ASSERT_EQ(sidecar->parts.size(), 2U);
  EXPECT_EQ(sidecar->parts[0].frame, "frame_2") << "the larger part first";
  EXPECT_EQ(sidecar->parts[0].share_ppm, std::llround(150e6 / 256));
  EXPECT_EQ(sidecar->parts[1].share_ppm, std::llround(106e6 / 256)) << "the surer frame keeps what it shows";
  EXPECT_EQ(sidecar->frame, "frame_1") << "the least sure one's";
  EXPECT_GE(sidecar->pose.sigma_mm, 2500);
  EXPECT_LT(sidecar->pose.sigma_mm, 2510);
  EXPECT_EQ(sidecar->captured_at, frame(1).captured_at) << "the oldest one's";
  EXPECT_EQ(parse_candidate(candidate_json(*sidecar), "test"), *sidecar);
}

TEST(TileMosaic, TakesEachPixelFromTheSmallestViewAngle) {
  PartialTile west = piece(0, 256), east = piece(0, 256);
  for (int c = 0; c < kTileSize; ++c) {
    west.slants.col(c).setTo(0.002 * c);
    east.slants.col(c).setTo(0.002 * (255 - c));
  }
  const cv::Mat light = west.image.clone();
  east.image = light - cv::Scalar::all(20);  // tells whose pixel it is
  TileMosaic mosaic(kMosaicKey, kPixel_m, {});
  EXPECT_EQ(mosaic.add(west, frame(1)), PartialTileOutcome::merged);
  EXPECT_EQ(mosaic.add(east, frame(2)), PartialTileOutcome::merged);
  EXPECT_EQ(mosaic.image().at<cv::Vec3b>(40, 50), light.at<cv::Vec3b>(40, 50));
  EXPECT_EQ(mosaic.image().at<cv::Vec3b>(40, 200), east.image.at<cv::Vec3b>(40, 200));
  const auto sidecar = mosaic.sidecar();
  ASSERT_TRUE(sidecar);
  EXPECT_NEAR(static_cast<double>(sidecar->parts[0].share_ppm), 5e5, 8e4);
  EXPECT_NEAR(static_cast<double>(sidecar->quality.view_angle_mdeg), 1000 * degrees(std::atan(0.002 * 135)), 1200)
      << "of the pixels that are used";
}

TEST(TileMosaic, DisplacementOfPartsIsPartOfItsSigma) {
  TileMosaic mosaic(kMosaicKey, kPixel_m, {});
  mosaic.add(piece(0, 150), frame(1));
  EXPECT_EQ(mosaic.add(piece(60, 256, 0.1, 3), frame(2)), PartialTileOutcome::merged);
  const auto sidecar = mosaic.sidecar();
  ASSERT_TRUE(sidecar);
  EXPECT_NEAR(static_cast<double>(sidecar->seam_mm), 1200, 80);
  EXPECT_NEAR(static_cast<double>(sidecar->pose.sigma_mm), std::hypot(2000, sidecar->seam_mm), 1.1);
  EXPECT_EQ(sidecar->pose.cov_ee_mm2, frame(1).pose.cov_ee_mm2 + sidecar->seam_mm * sidecar->seam_mm);
  EXPECT_EQ(sidecar->trust, CandidateTrust::candidate);
  EXPECT_GT(cost_mm(*sidecar), cost_mm(frame(1))) << "a tile of one frame is better";
}

TEST(TileMosaic, MisalignedOrUnverifiedPartsStayOut) {
  TileMosaic mosaic(kMosaicKey, kPixel_m, {});
  mosaic.add(piece(0, 150), frame(1));
  EXPECT_EQ(mosaic.add(piece(60, 256, 0.1, 6), frame(2)), PartialTileOutcome::misaligned) << "2.4 m";
  EXPECT_EQ(mosaic.add(piece(140, 256), frame(3)), PartialTileOutcome::unverified) << "ten columns in common";
  PartialTile water = piece(60, 256);
  water.image.setTo(cv::Scalar::all(70));
  EXPECT_EQ(mosaic.add(water, frame(4)), PartialTileOutcome::unverified);
  EXPECT_EQ(mosaic.add(piece(0, 150), frame(5)), PartialTileOutcome::redundant) << "nothing better";
  EXPECT_FALSE(mosaic.whole());
  EXPECT_EQ(mosaic.add(piece(60, 256), frame(6)), PartialTileOutcome::merged) << "the same when certain";
  EXPECT_TRUE(mosaic.whole());
}

TEST(TileMosaic, ALargeTotalSigmaIsRejectedAndAModerateOneIsSoft) {
  for (const auto& [sigma_mm, moved_px, trust] :
       {std::tuple{4800, 4.0, std::optional<CandidateTrust>()}, {2900, 3.0, CandidateTrust::soft}}) {
    TileMosaic mosaic(kMosaicKey, kPixel_m, {});
    mosaic.add(piece(0, 150), frame(1, sigma_mm));
    ASSERT_EQ(mosaic.add(piece(60, 256, 0.1, moved_px), frame(2)), PartialTileOutcome::merged);
    const auto sidecar = mosaic.sidecar();
    ASSERT_EQ(sidecar.has_value(), trust.has_value());
    if (sidecar) {
      EXPECT_EQ(sidecar->trust, *trust);
    }
  }
}

TEST(TileMosaic, HasRoomForSixFrames) {
  TileMosaic mosaic(kMosaicKey, kPixel_m, {});
  for (int i = 0; i < 6; ++i) EXPECT_EQ(mosaic.add(piece(0, 60 + 20 * i), frame(i)), PartialTileOutcome::merged) << i;
  EXPECT_EQ(mosaic.add(piece(0, 256), frame(7)), PartialTileOutcome::full);
  EXPECT_EQ(mosaic.add(piece(0, 256), frame(8, 500)), PartialTileOutcome::full);
}

TEST(TileMosaics, ReturnCompleteMosaicsWhenTheFlightHasPassed) {
  TileMosaics mosaics({});
  mosaics.add(piece(0, 150), frame(1), kPixel_m);
  EXPECT_TRUE(mosaics.take_finished().empty());
  mosaics.add(piece(60, 256), frame(2), kPixel_m);
  EXPECT_TRUE(mosaics.take_finished().empty()) << "the next frame may show it better";
  const auto finished = mosaics.take_finished();
  ASSERT_EQ(finished.size(), 1U);
  EXPECT_TRUE(finished[0].whole());
  EXPECT_EQ(mosaics.open(), 0U);
  EXPECT_EQ(mosaics.dropped(), 0U);
}

TEST(TileMosaics, AreBoundedAndDropTheLeastRecentlyExtended) {
  TileMosaics mosaics({.max_open = 2});
  const auto at = [](std::uint32_t x) {
    PartialTile patch = piece(0, 150);
    patch.key.x = x;
    return patch;
  };
  mosaics.add(at(1), frame(1), kPixel_m);
  mosaics.add(at(2), frame(2), kPixel_m);
  PartialTile more = piece(60, 256);
  more.key.x = 1;
  mosaics.add(more, frame(3), kPixel_m);
  mosaics.add(at(3), frame(4), kPixel_m);  // 2 gives way
  EXPECT_EQ(mosaics.open(), 2U);
  EXPECT_EQ(mosaics.dropped(), 1U);
  const auto rest = mosaics.take_all_complete();
  ASSERT_EQ(rest.size(), 1U);
  EXPECT_EQ(rest[0].key().x, 1U);
  EXPECT_EQ(mosaics.dropped(), 2U);
}

TEST(TileMosaics, PartsOfAnotherPassStartANewMosaic) {
  TileMosaics mosaics({.max_span_s = 100});
  mosaics.add(piece(0, 150), frame(1), kPixel_m);
  mosaics.add(piece(60, 256), frame(102), kPixel_m);
  EXPECT_TRUE(mosaics.take_all_complete().empty());
  EXPECT_EQ(mosaics.dropped(), 2U);
}

TEST(TileMosaics, ASmallPartDoesNotBlockALargerOneForever) {
  TileMosaics mosaics({});
  mosaics.add(piece(0, 20), frame(1), kPixel_m);
  EXPECT_EQ(mosaics.add(piece(15, 200), frame(2), kPixel_m), PartialTileOutcome::unverified);
  EXPECT_EQ(mosaics.add(piece(0, 100), frame(3), kPixel_m), PartialTileOutcome::merged);
  EXPECT_EQ(mosaics.add(piece(150, 256), frame(4), kPixel_m), PartialTileOutcome::merged);
  const auto whole = mosaics.take_all_complete();
  ASSERT_EQ(whole.size(), 1U);
  EXPECT_EQ(whole[0].sidecar()->parts.size(), 3U);
}

}  // namespace
}  // namespace nadir
