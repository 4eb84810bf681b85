#include "flight_adjustment/flight_adjustment.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <opencv2/core.hpp>

#include "flights/stored_flight.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "support/temporary_folder.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

constexpr int kFrames = 10;

const std::vector<Moment>& moments() {
  static const std::vector<Moment> flown = flight(kFrames);
  return flown;
}

// A flight that was localized, with what the adjustment is given.
struct Flown {
  Flown() : engine_setup(test::engine_setup(Course::smooth)) {
    store = FlightStore::create(folder.path() / "flight", description(Course::smooth), kNow);
    std::vector<EncodedPicture> pictures;
    for (const Moment& moment : moments()) {
      EncodedPicture& picture = pictures.emplace_back();
      picture.telemetry = moment.telemetry;
      picture.name = moment.telemetry.frame;
      picture.bytes = encode_image(moment.image, ImageFormat::png);
    }
    store->accept(offers(pictures), kNow);
    engine = std::make_unique<FlightEngine>(*store, engine_setup);
    engine->process();
    engine->complete();
    flight = flight_to_adjust(*store, *engine, engine_setup);
    NoProgress progress;
    adjusted = adjust_flight(flight, progress);
  }

  TemporaryFolder folder;
  FlightEngineSetup engine_setup;
  std::unique_ptr<FlightStore> store;
  std::unique_ptr<FlightEngine> engine;
  FlightToAdjust flight{.camera = {}, .plane = LocalFrame(kOrigin)};
  AdjustedFlight adjusted;
};

Flown& flown() {
  static Flown once;
  return once;
}

AdjustedFlight adjust(const FlightToAdjust& flight) {
  NoProgress progress;
  return adjust_flight(flight, progress);
}

double rms_m(const std::vector<Estimate>& estimates) {
  double sum = 0;
  for (std::size_t i = 0; i < estimates.size(); ++i) sum += std::pow(off_m(estimates[i], moments()[i]), 2);
  return std::sqrt(sum / static_cast<double>(estimates.size()));
}

FlightToAdjust without_anchors() {
  FlightToAdjust flight = flown().flight;
  for (SmoothedFrame& frame : flight.smoothed) frame.anchor.reset();
  return flight;
}

}  // namespace

TEST(FlightAdjustment, IsMoreAccurateThanTheFlightWasOnline) {
  const AdjustedFlight& adjusted = flown().adjusted;
  const AdjustmentSummary& summary = adjusted.summary;
  ASSERT_EQ(adjusted.estimates.size(), moments().size());
  EXPECT_EQ(summary.outcome, AdjustmentOutcome::converged);
  EXPECT_EQ(summary.anchored_frames, moments().size());
  EXPECT_EQ(summary.floating_frames, 0U);
  EXPECT_GT(summary.observations, 40 * moments().size());
  EXPECT_LT(summary.mean_reprojection_px, 1);
  EXPECT_TRUE(summary.switched_off.empty());
  const double online_m = rms_m(flown().store->estimates(EstimateKind::online)), adjusted_m = rms_m(adjusted.estimates);
  EXPECT_LT(adjusted_m, 0.8 * online_m) << online_m;
  double nees = 0;
  for (std::size_t i = 0; i < moments().size(); ++i) {
    expect_sound(adjusted.estimates[i]);
    const Eigen::Vector2d off =
        flown().flight.plane.plane_from_lonlat(*adjusted.estimates[i].position) - moments()[i].truth.position;
    nees += off.dot(adjusted.estimates[i].covariance_m2.inverse() * off) / static_cast<double>(moments().size());
  }
  EXPECT_LT(nees, 2 * 2.2);  // the map's own error of 1 m, which is part of the covariance, is none here
  std::printf("adjusted %.2f m, online %.2f m, reprojection %.2f px, NEES %.2f\n", adjusted_m, online_m,
              summary.mean_reprojection_px, nees);
}

TEST(FlightAdjustment, IsStoredAndRead) {
  FlightStore& store = *flown().store;
  const AdjustedFlight& adjusted = flown().adjusted;
  EXPECT_FALSE(store.adjusted_lens());
  store.put_adjustment(adjusted.estimates, adjusted_poses(adjusted), {}, kNow);
  const auto stored = store.estimates(EstimateKind::adjusted);
  ASSERT_EQ(stored.size(), moments().size());
  EXPECT_EQ(stored[3].position->lat_deg, adjusted.estimates[3].position->lat_deg);
  EXPECT_EQ(stored[3].covariance_m2, adjusted.estimates[3].covariance_m2);

  const auto lens = store.adjusted_lens();
  ASSERT_TRUE(lens);
  const CameraModel nominal = flown().flight.camera.camera, &camera = adjusted.summary.calibration.camera;
  const double scale = static_cast<double>(nominal.width) / camera.width;
  EXPECT_NEAR(lens->applied_to(nominal).fx, scale * camera.fx, 1e-6);
  EXPECT_EQ(lens->applied_to(nominal).distortion, camera.distortion);
  const auto pose = store.adjusted_pose(3);
  ASSERT_TRUE(pose);
  const CameraPose& truth = moments()[3].truth;
  EXPECT_LT(std::abs(wrap_pi(pose->attitude.heading_rad - truth.attitude.heading_rad)), radians(1));
  EXPECT_LT(std::abs(pose->attitude.pitch_rad - truth.attitude.pitch_rad), radians(1));
  EXPECT_NEAR(pose->attitude.roll_rad, adjusted.block.frames[3].pose.attitude.roll_rad, 1e-12);
  EXPECT_EQ(pose->agl_m, adjusted.block.frames[3].pose.agl_m);
  const Eigen::Matrix2d of_position_m2 = pose->covariance.topLeftCorner<2, 2>();
  EXPECT_EQ(of_position_m2, adjusted.estimates[3].covariance_m2);

  // Neighbours err together: by what the block says of them, and by the map.
  const auto joint = store.adjusted_joint_covariance({4, 3}), block = adjusted.block.joint_covariance({4, 3});
  ASSERT_TRUE(joint && block);
  EXPECT_EQ((*joint)(7, 7), pose->covariance(1, 1));
  const double shared_m2 = adjusted.estimates[3].covariance_m2(0, 0) - (*block)(6, 6);
  EXPECT_GT(shared_m2, 0);
  EXPECT_NEAR((*joint)(0, 6), (*block)(0, 6) + shared_m2, 0.05 * shared_m2);
  EXPECT_EQ((*joint)(3, 10), (*block)(3, 10));
  EXPECT_GT(Eigen::MatrixXd(*joint).selfadjointView<Eigen::Lower>().eigenvalues().minCoeff(), 0);
  EXPECT_FALSE(store.adjusted_joint_covariance({3, 999}));
  store.put_estimates(EstimateKind::adjusted, adjusted.estimates, {}, kNow);
  EXPECT_FALSE(store.adjusted_pose(3)) << "poses belong to the estimates that they came with";
}

TEST(FlightAdjustment, PosesAreThoseOfFramesWithAnAnchorThatWasKept) {
  const auto refined = flown().engine->refined_poses();
  ASSERT_EQ(flown().adjusted.poses.size(), refined.size());
  std::size_t poses = 0;
  for (std::size_t i = 0; i < refined.size(); ++i) {
    EXPECT_EQ(flown().adjusted.poses[i].has_value(), refined[i].has_value());
    if (!flown().adjusted.poses[i]) continue;
    ++poses;
    const FramePose& pose = *flown().adjusted.poses[i];
    EXPECT_LT(std::abs(wrap_pi(pose.pose.attitude.heading_rad - moments()[i].truth.attitude.heading_rad)), radians(1));
    EXPECT_LT(std::abs(pose.pose.agl_m - moments()[i].truth.agl_m), 4);
    EXPECT_EQ(pose.sigma_m, flown().adjusted.estimates[i].sigma_m);
  }
  EXPECT_GT(poses, moments().size() / 2);
}

TEST(FlightAdjustment, IsTheSameEachTime) {
  const AdjustedFlight again = adjust(flown().flight);
  for (std::size_t i = 0; i < again.estimates.size(); ++i) {
    EXPECT_EQ(again.estimates[i].position->lat_deg, flown().adjusted.estimates[i].position->lat_deg);
    EXPECT_EQ(again.estimates[i].covariance_m2, flown().adjusted.estimates[i].covariance_m2);
  }
}

TEST(FlightAdjustment, AnAnchorThatTheOthersContradictIsSwitchedOff) {
  FlightToAdjust flight = flown().flight;
  std::optional<std::size_t> wrong;
  for (std::size_t i = 4; i < flight.smoothed.size() && !wrong; ++i) {
    if (flight.smoothed[i].anchor) wrong = i;
  }
  ASSERT_TRUE(wrong);
  flight.smoothed[*wrong].anchor->value[0] += 150;
  const AdjustedFlight adjusted = adjust(flight);
  EXPECT_EQ(adjusted.summary.switched_off, std::vector<std::size_t>{*wrong});
  EXPECT_FALSE(adjusted.poses[*wrong]);
  EXPECT_NE(adjusted.estimates[*wrong].source, SourceLabel::satellite_anchored);
  EXPECT_LT(rms_m(adjusted.estimates), 1.5 * rms_m(flown().adjusted.estimates) + 0.3);
}

TEST(FlightAdjustment, WithoutAnchorsABlockStaysWhereDeadReckoningHasIt) {
  FlightToAdjust flight = without_anchors();
  for (Estimate& estimate : flight.refined) estimate.source = SourceLabel::dead_reckoned;
  const AdjustedFlight adjusted = adjust(flight);
  EXPECT_EQ(adjusted.summary.floating_frames, moments().size());
  EXPECT_EQ(adjusted.summary.anchors, 0U);
  EXPECT_EQ(adjusted.summary.calibration.log_focal.value, 0);
  for (std::size_t i = 0; i < moments().size(); ++i) {
    EXPECT_EQ(adjusted.estimates[i].source, SourceLabel::dead_reckoned) << i;
    EXPECT_FALSE(adjusted.poses[i]);
  }
}

TEST(FlightAdjustment, NothingThatIsUnknownGetsAPosition) {
  FlightToAdjust flight = without_anchors();
  for (SmoothedFrame& frame : flight.smoothed) frame.covariance_m2 *= 1e8;
  for (const Estimate& estimate : adjust(flight).estimates) {
    EXPECT_EQ(estimate.source, SourceLabel::no_fix);
    EXPECT_FALSE(estimate.position);
  }
}

TEST(FlightAdjustment, ASegmentThatWasPlacedAsAWholeIsHeldThere) {
  FlightToAdjust flight = without_anchors();
  for (SmoothedFrame& frame : flight.smoothed) {
    frame.pose.position = frame.pose.position + Eigen::Vector2d(300, -200);
    frame.covariance_m2 = 1e6 * Eigen::Matrix2d::Identity();
  }
  flight.placed.assign(moments().size(), true);
  const AdjustedFlight adjusted = adjust(flight);
  EXPECT_EQ(adjusted.summary.floating_frames, 0U);
  EXPECT_LT(rms_m(adjusted.estimates), 3);
}

TEST(FlightAdjustment, ALookThatCannotBeIsLeftOut) {
  FlightToAdjust flight = flown().flight;
  const auto anchored = static_cast<std::size_t>(std::count_if(
      flight.smoothed.begin(), flight.smoothed.end(), [](const SmoothedFrame& f) { return f.anchor.has_value(); }));
  const auto look = std::find_if(flight.smoothed.begin(), flight.smoothed.end(),
                                 [](const SmoothedFrame& f) { return f.anchor.has_value(); });
  ASSERT_NE(look, flight.smoothed.end());
  look->anchor->value[2] = 800;  // a height of exp(800)
  const AdjustedFlight adjusted = adjust(flight);
  EXPECT_EQ(adjusted.summary.anchors, anchored - 1);
  EXPECT_LT(rms_m(adjusted.estimates), 3);
}

// What a person sees in two pictures places the block.
TEST(FlightAdjustment, FixesTieABlockToTheMap) {
  FlightToAdjust flight = without_anchors();
  for (SmoothedFrame& frame : flight.smoothed) {
    frame.pose.position = frame.pose.position + Eigen::Vector2d(40, -30);
    frame.covariance_m2 = 2500 * Eigen::Matrix2d::Identity();
  }
  const CameraModel& camera = flight.camera.camera;
  for (const std::size_t i : {std::size_t{1}, std::size_t{8}}) {
    const Eigen::Vector2d pixel(camera.cx + 20, camera.cy - 15);
    const auto place = ground_from_ray(moments()[i].truth, camera.ray_from_pixel(pixel));
    ASSERT_TRUE(place);
    flight.fixes.push_back({i, pixel, *place, 1});
  }
  const AdjustedFlight adjusted = adjust(flight);
  EXPECT_EQ(adjusted.summary.fixes, 2U);
  EXPECT_EQ(adjusted.summary.floating_frames, 0U);
  EXPECT_LT(rms_m(adjusted.estimates), 8);
  EXPECT_EQ(adjusted.estimates[5].source, SourceLabel::vo_extrapolated);
}

TEST(FlightAdjustment, FixesThatWereWithdrawnAreNotUsed) {
  UserFix said;
  said.place = place_of(moments()[1].truth.position);
  said.radius_m = 10;
  said.sigma_m = 5;
  said.hint = {said.place, said.radius_m};
  said.frame = 1;
  said.pixel = PixelPoint{100, 100};
  said.by = "test";
  const UserFix kept = flown().store->add_fix(said, kNow);
  EXPECT_EQ(flight_to_adjust(*flown().store, *flown().engine, flown().engine_setup).fixes.size(), 1U);
  flown().store->withdraw_fix(kept.id, kNow);
  EXPECT_TRUE(flight_to_adjust(*flown().store, *flown().engine, flown().engine_setup).fixes.empty());
}

TEST(FlightAdjustment, BlackPicturesLeaveTheAnchors) {
  FlightToAdjust flight = flown().flight;
  flight.image_of = [](std::size_t i) { return cv::Mat(cv::Mat::zeros(moments()[i].image.size(), CV_8UC1)); };
  const AdjustedFlight adjusted = adjust(flight);
  EXPECT_EQ(adjusted.summary.tie_points, 0U);
  EXPECT_LT(rms_m(adjusted.estimates), 10);
}

TEST(FlightAdjustment, OneFrameAndNone) {
  FlightToAdjust flight = flown().flight;
  flight.telemetry.resize(1), flight.smoothed.resize(1), flight.refined.resize(1), flight.refined_poses.resize(1);
  const AdjustedFlight one = adjust(flight);
  ASSERT_EQ(one.estimates.size(), 1U);
  EXPECT_LT(off_m(one.estimates[0], moments()[0]), 10);
  flight.telemetry.clear(), flight.smoothed.clear(), flight.refined.clear(), flight.refined_poses.clear();
  EXPECT_TRUE(adjust(flight).estimates.empty());
}

TEST(FlightAdjustment, AFlightWithoutAnyPositionComesBackAsItWas) {
  FlightToAdjust flight = flown().flight;
  flight.smoothed.clear();
  const AdjustedFlight adjusted = adjust(flight);
  EXPECT_EQ(adjusted.estimates.size(), moments().size());
  EXPECT_EQ(adjusted.summary.floating_frames, moments().size());
}

TEST(FlightAdjustment, CancelledItEndsWhereverItIs) {
  for (const int after : {0, 5, 15, 30, 45}) {
    NoProgress progress;
    int checks = 0;
    EXPECT_THROW(adjust_flight(flown().flight, progress, Cancel([&] { return ++checks > after; })), Interrupted)
        << after;
  }
}

TEST(FlightAdjustment, ItsSummaryIsADocument) {
  const nlohmann::json document = json_from(flown().adjusted.summary);
  EXPECT_EQ(document.at("outcome"), "converged");
  EXPECT_GT(document.at("calibration").at("log_focal").at("sigma").get<double>(), 0);
  EXPECT_EQ(document.at("calibration").at("distortion").size(), 5U);
  EXPECT_TRUE(document.at("anchors_switched_off").empty());
}
