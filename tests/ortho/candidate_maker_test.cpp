#include "ortho/candidate_maker.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "ortho/candidate_sidecar.hpp"
#include "ortho/candidate_store.hpp"
#include "support/temporary_folder.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr int kZoom = 20;  // 0.1 m: many tiles, though the frame is coarser

class Making : public ::testing::Test {
 protected:
  CandidateFlight flight() const {
    CandidateFlight flight{.airframe = "mini-07",
                           .flight = "first",
                           .base_package = sha256(as_bytes("manifest")),
                           .camera = camera_,
                           .frame = LocalFrame({11.2, 48.1}),
                           .surface = &ground_,
                           .key = &key_,
                           .zoom = kZoom};
    flight.limits.max_coarseness = 3;
    flight.limits.max_blur_px = 1e3;  // waves are as soft in the sharpest picture
    return flight;
  }
  PosedFrame seen(double east_m = 0) const {
    PosedFrame frame{"frame 1.jpg", {1'777'636'800'250}, {}};
    frame.pose.pose = {{east_m, 0}, 100, {radians(-20), radians(3), radians(-4)}};
    frame.pose.covariance_m2 << 3, 0.5, 0.5, 5;
    frame.pose.sigma_m = 2;
    frame.pose.source = SourceLabel::satellite_anchored;
    frame.pose.confirmed = true;
    return frame;
  }
  Bytes photograph(const PosedFrame& frame) const {
    cv::Mat colour;
    cv::cvtColor(test::photograph(test::waves, camera_, frame.pose.pose), colour, cv::COLOR_GRAY2BGR);
    return encode_image(colour, ImageFormat::jpeg, 95);
  }
  std::vector<Candidate> read() const {
    CandidateReader reader(folder_ / "candidates");
    Findings findings;
    std::vector<Candidate> all;
    while (auto candidate = reader.next(findings)) all.push_back(std::move(*candidate));
    EXPECT_TRUE(findings.empty());
    return all;
  }

  test::TemporaryFolder folder_;
  FlatGround ground_;
  PrivateKey key_ = PrivateKey::generate();
  CameraModel camera_ = test::small_camera().scaled(2);  // 640 x 480, 0.26 m at 100 m
};

// Parcels, roads and roofs, as they are and as a camera sees them that is out of focus, or that moves too fast.
TEST_F(Making, MakesNoTilesFromABlurredFrame) {
  const test::Landscape land(8, 130, 0.2);
  const cv::Mat grey = test::photograph(land.ground(), camera_, seen().pose.pose, 2);
  CandidateStore store(folder_ / "candidates");
  CandidateFlight strict = flight();
  strict.limits.max_blur_px = EligibilityLimits().max_blur_px;
  CandidateMaker maker(strict);
  const auto refusal = [&](const cv::Mat& picture) {
    cv::Mat colour;
    cv::cvtColor(picture, colour, cv::COLOR_GRAY2BGR);
    return maker.make(seen(), encode_image(colour, ImageFormat::jpeg, 95), store).refusal;
  };
  cv::Mat unfocused, moved, in_haze;
  cv::GaussianBlur(grey, unfocused, {}, 5);
  cv::blur(grey, moved, {25, 1});
  EXPECT_EQ(refusal(unfocused), OrthoRefusal::blurred);
  EXPECT_EQ(refusal(moved), OrthoRefusal::blurred);
  EXPECT_EQ(store.tiles(), 0U);
  grey.convertTo(in_haze, CV_8U, 0.3, 120);
  EXPECT_FALSE(refusal(in_haze));
  EXPECT_FALSE(refusal(grey));
  EXPECT_GT(store.tiles(), 0U);
}

// Line after line, each from where the camera is then.
TEST_F(Making, TilesOfARollingShutterAreThoseOfAGlobalOne) {
  constexpr double kReadout_s = 0.03;
  const Eigen::Vector2d velocity_mps(20, 10);
  const auto at = [&](double seconds) {
    CameraPose pose = seen().pose.pose;
    pose.position = PlanePoint(pose.position.vector() + velocity_mps * seconds);
    pose.attitude.heading_rad += radians(40) * seconds;
    pose.attitude.pitch_rad -= radians(30) * seconds;
    pose.attitude.roll_rad += radians(60) * seconds;
    return pose;
  };
  const cv::Mat grey = test::photograph_moving(
      test::waves, camera_, [&](int, int y) { return at(test::row_seconds(camera_, kReadout_s, y)); });
  cv::Mat colour;
  cv::cvtColor(grey, colour, cv::COLOR_GRAY2BGR);
  const Bytes as_read = encode_image(colour, ImageFormat::jpeg, 95), global = photograph(seen());
  PosedFrame passing = seen();
  passing.pose.motion = {velocity_mps, camera_rate(at(-1e-4).attitude, at(1e-4).attitude, 2e-4)};
  CandidateFlight rolling = flight();
  rolling.readout = SensorReadout{kReadout_s};
  const auto tiles = [&](const CandidateFlight& made_of, const Bytes& picture) {
    FrameTiles report;
    return CandidateMaker(made_of).raw_tiles(passing, picture, report);
  };
  const auto wanted = tiles(flight(), global), undone = tiles(rolling, as_read), distorted = tiles(flight(), as_read);
  ASSERT_EQ(undone.size(), wanted.size());
  ASSERT_GE(wanted.size(), 6U);
  double before = 0, after = 0;  // grey levels
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const double values = 3.0 * static_cast<double>(wanted[i].image.total() * wanted.size());
    before += cv::norm(distorted[i].image, wanted[i].image, cv::NORM_L1) / values;
    after += cv::norm(undone[i].image, wanted[i].image, cv::NORM_L1) / values;
  }
  EXPECT_GT(before, 4 * after) << before << " as read, " << after << " undone";
}

TEST_F(Making, MakesGeoreferencedTiles) {
  CandidateStore store(folder_ / "candidates");
  CandidateMaker maker(flight());
  const FrameTiles report = maker.make(seen(), photograph(seen()), store);
  EXPECT_FALSE(report.refusal);
  store.close();
  const auto all = read();
  ASSERT_GE(all.size(), 6U);
  EXPECT_EQ(report.stored.size(), all.size());
  for (const Candidate& candidate : all) {
    const CandidateSidecar& s = candidate.sidecar;
    EXPECT_EQ(s.frame, "frame_1.jpg");
    EXPECT_EQ(to_rfc3339(s.captured_at), "2026-05-01T12:00:00.250Z");
    EXPECT_EQ(s.pose.heading_mdeg, 340'000);
    EXPECT_EQ(s.pose.pitch_mdeg, 3'000);
    EXPECT_EQ(s.pose.roll_mdeg, -4'000);
    EXPECT_EQ(s.pose.agl_mm, 100'000);
    EXPECT_EQ(s.pose.sigma_mm, 2'000);
    EXPECT_EQ(s.pose.cov_nn_mm2, 5'000'000);
    EXPECT_EQ(s.pose.lat_e7, 481'000'000);
    EXPECT_FALSE(s.pose.refined);
    EXPECT_NEAR(static_cast<double>(s.gsd_mm), 262, 2);
    EXPECT_EQ(s.camera, camera_digest(camera_));
    const cv::Mat tile = decode_image(candidate.tile, Colour::grey, "tile").image;
    double squares = 0;
    for (int r = 0; r < kTileSize; ++r) {
      for (int c = 0; c < kTileSize; ++c) {
        const LonLat place = lonlat_from_pixel({s.key.x * 256.0 + c + 0.5, s.key.y * 256.0 + r + 0.5}, s.key.z);
        const PlanePoint enu = flight().frame.plane_from_lonlat(place);
        const double off = tile.at<std::uint8_t>(r, c) - test::waves(enu);
        squares += off * off;
      }
    }
    // 1 m off would be 10 grey levels; JPEG twice is 2.
    EXPECT_LT(std::sqrt(squares / (kTileSize * kTileSize)), 3.5) << to_text(s.key);
  }
}

TEST_F(Making, KeepsTheBetterTilesOfTwoFrames) {
  CandidateStore store(folder_ / "candidates");
  CandidateMaker maker(flight());
  const std::size_t first = maker.make(seen(), photograph(seen()), store).stored.size();
  const FrameTiles again = maker.make(seen(), photograph(seen()), store);
  for (const auto& [key, fate] : again.stored) EXPECT_EQ(fate, CandidateOutcome::worse);
  EXPECT_EQ(again.stored.size(), first);
  PosedFrame surer = seen();
  surer.pose.sigma_m = 1;
  for (const auto& [key, fate] : maker.make(surer, photograph(surer), store).stored) {
    EXPECT_EQ(fate, CandidateOutcome::replaced);
  }
  EXPECT_EQ(store.tiles(), first);
}

TEST_F(Making, MakesNoTilesFromUncertainFrames) {
  CandidateStore store(folder_ / "candidates");
  CandidateMaker maker(flight());
  const Bytes picture = photograph(seen());
  const auto refusal = [&](const PosedFrame& frame, ByteView encoded) {
    return maker.make(frame, encoded, store).refusal;
  };
  PosedFrame frame = seen();
  frame.pose.source = SourceLabel::vo_extrapolated;
  EXPECT_EQ(refusal(frame, picture), OrthoRefusal::not_anchored);
  frame = seen();
  frame.pose.anchor_age_s = 5;
  EXPECT_EQ(refusal(frame, picture), OrthoRefusal::not_anchored);
  frame = seen();
  frame.pose.confirmed = false;
  EXPECT_EQ(refusal(frame, picture), OrthoRefusal::unconfirmed);
  frame = seen();
  frame.pose.sigma_m = 6;
  EXPECT_EQ(refusal(frame, picture), OrthoRefusal::unsure);
  frame = seen();
  frame.pose.pose.agl_m = 400;
  EXPECT_EQ(refusal(frame, picture), OrthoRefusal::too_coarse);
  EXPECT_EQ(refusal(seen(), {}), OrthoRefusal::frame_unfit);
  EXPECT_EQ(refusal(seen(), ByteView(picture).first(picture.size() / 2)), OrthoRefusal::frame_unfit);
  EXPECT_EQ(refusal(seen(), as_bytes("no picture at all")), OrthoRefusal::frame_unfit);
  EXPECT_EQ(refusal(seen(), encode_image(cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(9)), ImageFormat::jpeg)),
            OrthoRefusal::frame_unfit)
      << "another camera's";
  EXPECT_EQ(refusal(seen(), encode_image(cv::Mat(480, 640, CV_8UC3, cv::Scalar::all(9)), ImageFormat::jpeg)),
            OrthoRefusal::frame_unfit);
  EXPECT_EQ(store.tiles(), 0U);
  EXPECT_FALSE(refusal(seen(), picture)) << "the same when certain";
}

TEST_F(Making, CountsRejectedTiles) {
  CandidateStore store(folder_ / "candidates");
  CandidateFlight strict = flight();
  strict.limits.max_view_angle_rad = 0.1;
  const FrameTiles report = CandidateMaker(strict).make(seen(), photograph(seen()), store);
  EXPECT_FALSE(report.refusal);
  EXPECT_GE(report.refused[static_cast<std::size_t>(OrthoRefusal::oblique)], 2);
  EXPECT_TRUE(report.stored.empty());
}

TEST_F(Making, SkipsTilesAfterTheDeadline) {
  CandidateStore store(folder_ / "candidates");
  CandidateMaker maker(flight());
  int asked = 0;
  const FrameTiles made = maker.make(seen(), photograph(seen()), store, [&] { return ++asked > 2; });
  EXPECT_FALSE(made.refusal);
  EXPECT_EQ(made.stored.size(), 2U) << "the two that there was time for";
  EXPECT_EQ(store.tiles(), 2U);
  EXPECT_EQ(made.refused[static_cast<std::size_t>(OrthoRefusal::late)], asked - 2);
  const FrameTiles later = maker.make(seen(), photograph(seen()), store);
  EXPECT_GE(store.tiles(), 6U);
  EXPECT_EQ(later.refused[static_cast<std::size_t>(OrthoRefusal::late)], 0);
}

TEST_F(Making, IsDeterministic) {
  for (const char* name : {"a", "b"}) {
    CandidateStore store(folder_ / name);
    CandidateMaker maker(flight());
    for (const double east_m : {0.0, 12.0, 25.0}) maker.make(seen(east_m), photograph(seen(east_m)), store);
    store.close();
  }
  EXPECT_EQ(sha256_file(folder_ / "a" / kCandidateFile), sha256_file(folder_ / "b" / kCandidateFile));
}

// A tile of 102 m and two frames that see 168 by 126 m each, from 40 m to the west and to the east of its middle.
class MakingOfSeveralFrames : public Making {
 protected:
  static constexpr TileKey kTile{18, 139'240, 90'872};

  CandidateFlight low_flight() const {
    CandidateFlight low = flight();
    low.zoom = kTile.z;
    const LonLatBox box = bounds_of(kTile);
    low.frame = LocalFrame({(box.west_deg + box.east_deg) / 2, (box.south_deg + box.north_deg) / 2});
    return low;
  }
  PosedFrame at(double east_m, double sigma_m = 2) const {
    PosedFrame frame = seen(east_m);
    frame.name = fmt::format("frame_{}.jpg", east_m);
    frame.captured_at.unix_ms += std::llround(east_m * 100);
    frame.pose.pose.attitude = {};
    frame.pose.sigma_m = sigma_m;
    return frame;
  }
  // position_error_m: of the eastern frame's place, to the east.
  FrameTiles fly(const CandidateFlight& flight, CandidateStore& store, double position_error_m = 0) const {
    CandidateMaker maker(flight);
    const FrameTiles west = maker.make(at(-40), photograph(at(-40)), store);
    PosedFrame posed = at(40);
    posed.pose.pose.position.east_m += position_error_m;
    FrameTiles east = maker.make(posed, photograph(at(40)), store);
    EXPECT_FALSE(west.refusal || east.refusal);
    EXPECT_EQ(west.whole + east.whole, 0U);
    EXPECT_EQ(store.tiles(), tiles_before_) << "the next frame may show it better";
    FrameTiles made = maker.finish(store);
    made.partial_tiles = east.partial_tiles;
    return made;
  }
  std::uint64_t tiles_before_ = 0;
};

TEST_F(MakingOfSeveralFrames, MakesGeoreferencedMosaics) {
  CandidateStore store(folder_ / "candidates");
  const FrameTiles made = fly(low_flight(), store);
  EXPECT_EQ(made.mosaics_stored, 1U);
  store.close();
  const auto all = read();
  ASSERT_EQ(all.size(), 1U);
  const CandidateSidecar& s = all[0].sidecar;
  EXPECT_EQ(s.key, kTile);
  EXPECT_EQ(all[0].signature.keyid, key_.public_key().id());
  ASSERT_EQ(s.parts.size(), 2U);
  EXPECT_EQ(s.parts[0].frame.substr(0, 6), "frame_");
  EXPECT_NEAR(static_cast<double>(s.parts[0].share_ppm), 5e5, 1e5);
  EXPECT_EQ(s.captured_at, at(-40).captured_at);
  EXPECT_LT(s.seam_mm, 200) << "the poses are right";
  EXPECT_GE(s.pose.sigma_mm, 2000);
  EXPECT_LT(s.pose.sigma_mm, 2050);
  const cv::Mat tile = decode_image(all[0].tile, Colour::grey, "tile").image;
  double squares = 0;
  for (int r = 0; r < kTileSize; ++r) {
    for (int c = 0; c < kTileSize; ++c) {
      const LonLat place = lonlat_from_pixel({s.key.x * 256.0 + c + 0.5, s.key.y * 256.0 + r + 0.5}, s.key.z);
      const PlanePoint enu = low_flight().frame.plane_from_lonlat(place);
      squares += std::pow(tile.at<std::uint8_t>(r, c) - test::waves(enu), 2);
    }
  }
  EXPECT_LT(std::sqrt(squares / (kTileSize * kTileSize)), 3.5);
}

TEST_F(MakingOfSeveralFrames, IncludesTheDisagreementOfTheirPoses) {
  CandidateStore store(folder_ / "candidates");
  fly(low_flight(), store, 1.2);
  store.close();
  const auto all = read();
  ASSERT_EQ(all.size(), 1U);
  EXPECT_NEAR(static_cast<double>(all[0].sidecar.seam_mm), 1200, 150);
  EXPECT_NEAR(static_cast<double>(all[0].sidecar.pose.sigma_mm), std::hypot(2000, all[0].sidecar.seam_mm), 2);
}

TEST_F(MakingOfSeveralFrames, DoesNotMergeMisalignedFrames) {
  CandidateStore store(folder_ / "candidates");
  const FrameTiles made = fly(low_flight(), store, 3);
  EXPECT_GE(made.partial_tiles[static_cast<std::size_t>(PartialTileOutcome::misaligned)], 1);
  EXPECT_EQ(store.tiles(), 0U);
}

TEST_F(MakingOfSeveralFrames, IsDeterministicAndOptional) {
  for (const char* name : {"a", "b"}) {
    CandidateStore store(folder_ / name);
    fly(low_flight(), store);
    store.close();
  }
  EXPECT_EQ(sha256_file(folder_ / "a" / kCandidateFile), sha256_file(folder_ / "b" / kCandidateFile));
  CandidateFlight whole_only = low_flight();
  whole_only.merge_partial_tiles = false;
  CandidateStore store(folder_ / "candidates");
  EXPECT_EQ(fly(whole_only, store).stored.size(), 0U);
}

TEST_F(MakingOfSeveralFrames, KeepsTheBetterOfAMosaicAndASingleFrameTile) {
  CandidateStore store(folder_ / "candidates");
  fly(low_flight(), store);
  const auto fate_of_one = [&](double sigma_m) {
    PosedFrame above = at(0, sigma_m);
    above.pose.pose.agl_m = 120;
    const FrameTiles made = CandidateMaker(low_flight()).make(above, photograph(above), store);
    const auto here =
        std::find_if(made.stored.begin(), made.stored.end(), [](const auto& s) { return s.first == kTile; });
    return here == made.stored.end() ? std::nullopt : std::optional(here->second);
  };
  EXPECT_EQ(fate_of_one(2.5), CandidateOutcome::worse);
  EXPECT_EQ(fate_of_one(1.5), CandidateOutcome::replaced);
  tiles_before_ = store.tiles();
  EXPECT_TRUE(fly(low_flight(), store).stored.empty()) << "it is not even begun";
}

TEST_F(Making, RefusesInvalidNamesBeforeTheFlight) {
  CandidateFlight wrong = flight();
  wrong.airframe = "mini 07";
  EXPECT_THROW(CandidateMaker{wrong}, UsageError);
  wrong = flight();
  wrong.flight = "a/b";
  EXPECT_THROW(CandidateMaker{wrong}, UsageError);
  wrong = flight();
  wrong.zoom = 25;
  EXPECT_THROW(CandidateMaker{wrong}, UsageError);
}

TEST(CameraDigest, IsComputedFromTheCanonicalForm) {
  CameraModel camera{1280, 720, 1002.5, 1001.8, 643.2, 356.9, {-0.085, 0.032, 0.0004, -0.0003, 0}};
  EXPECT_EQ(canonical_camera(camera),
            R"({"cx_e6":643200000,"cy_e6":356900000,"distortion_e9":[-85000000,32000000,400000,-300000,0],)"
            R"("fx_e6":1002500000,"fy_e6":1001800000,"height":720,"schema":"nadir.camera/1","width":1280})");
  const Sha256 one = camera_digest(camera);
  camera.fx += 0.001;
  EXPECT_NE(camera_digest(camera), one);
}

}  // namespace
}  // namespace nadir
