#include "adjustment/block_adjustment.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "base/error.hpp"
#include "drawn_block.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

CalibrationPrior held_calibration() {
  return {.focal_relative = 0, .radial = 0, .tangential = 0, .boresight_rad = 0, .height_scale = 0};
}

DrawnBlockOptions held_options() {
  DrawnBlockOptions options;
  options.calibration = held_calibration();
  return options;
}

// A block as drawn, added and adjusted.
struct AdjustedDraw {
  RollingGround ground;
  DrawnBlock truth;
  BlockAdjustment adjustment;
  AdjustedBlock result;

  AdjustedDraw(std::uint64_t seed, const DrawnBlockOptions& options)
      : truth(draw_block(Random(seed), options, ground)), adjustment(truth.nominal, ground, truth.options(options)) {
    truth.add_to(adjustment);
    result = adjust();
  }
  AdjustedBlock adjust() {
    NoProgress progress;
    return adjustment.adjust(progress);
  }
  BlockErrors errors() const { return block_errors(result, truth); }
};

AdjustmentFrame frame_at(PlanePoint position, double agl_m = 100) {
  AdjustmentFrame frame;
  frame.pose.position = position;
  frame.pose.agl_m = agl_m;
  frame.attitude = AttitudeMeasurement{{}, 0.01, 0.02};
  frame.height = HeightMeasurement{agl_m, 0.02};
  return frame;
}

CameraModel plain_camera() {
  CameraModel camera;
  camera.width = 1000, camera.height = 800;
  camera.fx = camera.fy = 800;
  camera.cx = 499.5, camera.cy = 399.5;
  return camera;
}

AdjustmentOptions held_adjustment() {
  AdjustmentOptions options;
  options.calibration = held_calibration();
  return options;
}

AdjustedBlock adjusted(BlockAdjustment& adjustment) {
  NoProgress progress;
  return adjustment.adjust(progress);
}

}  // namespace

TEST(BlockAdjustmentMonteCarlo, PositionsAreAsFarOffAsTheySay) {
  double nees_2d = 0, nees_3d = 0, rms = 0, start_rms = 0;
  constexpr int kBlocks = 240;
  for (std::uint64_t seed = 1; seed <= kBlocks; ++seed) {
    DrawnBlockOptions options;
    options.points_per_frame = 25;
    const AdjustedDraw drawn(seed, options);
    ASSERT_EQ(drawn.result.outcome, AdjustmentOutcome::converged) << seed;
    const BlockErrors errors = drawn.errors();
    ASSERT_EQ(errors.frames, drawn.truth.frames.size()) << seed;
    nees_2d += errors.nees_2d / kBlocks;
    nees_3d += errors.nees_3d / kBlocks;
    rms += errors.rms_m / kBlocks;
    start_rms += distance_m(drawn.truth.frames[0].pose.position, drawn.truth.poses[0].position) / kBlocks;
    EXPECT_LT(drawn.result.mean_reprojection_px, 1) << seed;
  }
  // Right are 2 and 3. The errors of a block's frames are nearly the same: the means scatter by 0.13 and 0.16.
  EXPECT_GT(nees_2d, 1.6);
  EXPECT_LT(nees_2d, 2.4);
  EXPECT_GT(nees_3d, 2.5);
  EXPECT_LT(nees_3d, 3.5);
  EXPECT_LT(rms, 0.3 * start_rms);
  RecordProperty("nees_2d", std::to_string(nees_2d));
  RecordProperty("nees_3d", std::to_string(nees_3d));
}

TEST(BlockAdjustment, OneFrameWithAnAnchorIsTheClosedForm) {
  const FlatGround ground;
  BlockAdjustment adjustment(plain_camera(), ground, held_adjustment());
  adjustment.add_frame(frame_at({10, 20}));
  Eigen::Matrix2d first, second;
  first << 9, 2, 2, 4;
  second << 4, -1, -1, 16;
  adjustment.add_anchor({0, {12, 21}, first});
  adjustment.add_anchor({0, {14, 18}, second});
  const AdjustedBlock block = adjusted(adjustment);
  const Eigen::Matrix2d covariance = (first.inverse() + second.inverse()).inverse();
  const Eigen::Vector2d mean =
      covariance * (first.inverse() * Eigen::Vector2d(12, 21) + second.inverse() * Eigen::Vector2d(14, 18));
  ASSERT_TRUE(block.frames[0].covariance);
  EXPECT_EQ(block.frames[0].state, FrameState::anchored);
  EXPECT_LT((block.frames[0].pose.position.vector() - mean).norm(), 1e-3);
  EXPECT_LT((block.frames[0].covariance->topLeftCorner<2, 2>() - covariance).norm(), 1e-6);
  // The height is the measured one, to 2 %; the attitude likewise.
  EXPECT_NEAR(block.frames[0].pose.agl_m, 100, 1e-6);
  EXPECT_NEAR((*block.frames[0].covariance)(2, 2), 4, 1e-3);
  EXPECT_NEAR((*block.frames[0].covariance)(3, 3), 1e-4, 1e-9);
  EXPECT_NEAR((*block.frames[0].covariance)(5, 5), 4e-4, 1e-9);
}

// Tilt and position are one unknown of the look: whoever measures the tilt moves the position.
TEST(BlockAdjustment, AWholePoseKeepsWhatTiltAndPositionHaveInCommon) {
  const FlatGround ground;
  BlockAdjustment block(plain_camera(), ground, held_adjustment());
  AdjustmentFrame frame;
  frame.pose = {{0, 0}, 100, {}};
  frame.attitude = AttitudeMeasurement{{0, 0.02, 0}, 1e-4, 1e-4};
  block.add_frame(frame);
  PoseAnchor anchor;
  anchor.pose = {{10, 20}, 100, {}};
  anchor.covariance.setZero();
  anchor.covariance.diagonal() << 1, 25, 1e-4, 1e-4, 25e-4, 1e-4;
  anchor.covariance(1, 4) = anchor.covariance(4, 1) = -0.999 * 5 * 0.05;  // pitch up: farther back
  block.add_anchor(anchor);
  const AdjustedBlock result = adjusted(block);
  EXPECT_EQ(result.frames[0].state, FrameState::anchored);
  EXPECT_NEAR(result.frames[0].pose.position.north_m, 20 - 0.999 * 100 * 0.02, 0.05);
  EXPECT_NEAR(result.frames[0].pose.position.east_m, 10, 1e-6);
  EXPECT_LT((*result.frames[0].covariance)(1, 1), 0.1);
  EXPECT_FALSE(result.anchors[0].switched_off);
}

TEST(BlockAdjustment, AWholePoseThatCannotBeIsRefused) {
  const FlatGround ground;
  BlockAdjustment block(plain_camera(), ground);
  block.add_frame(frame_at({0, 0}));
  PoseAnchor anchor;
  anchor.pose = {{0, 0}, 100, {}};
  anchor.covariance(0, 0) = -1;
  EXPECT_THROW(block.add_anchor(anchor), UsageError);
  anchor.covariance.setIdentity();
  anchor.covariance(2, 3) = 0.5;  // not symmetric
  EXPECT_THROW(block.add_anchor(anchor), UsageError);
  anchor.covariance.setIdentity();
  anchor.pose.agl_m = 0;
  EXPECT_THROW(block.add_anchor(anchor), UsageError);
  anchor.pose.agl_m = 100;
  anchor.frame = 1;
  EXPECT_THROW(block.add_anchor(anchor), UsageError);
  anchor.frame = 0;
  EXPECT_EQ(block.add_anchor(anchor), 0U);
}

TEST(BlockAdjustment, OneFrameAloneFloats) {
  const FlatGround ground;
  BlockAdjustment adjustment(plain_camera(), ground, held_adjustment());
  adjustment.add_frame(frame_at({10, 20}));
  const AdjustedBlock block = adjusted(adjustment);
  EXPECT_EQ(block.frames[0].state, FrameState::floating);
  EXPECT_EQ(block.floating_frames, 1U);
  EXPECT_FALSE(block.frames[0].covariance);
  EXPECT_LT(distance_m(block.frames[0].pose.position, {10, 20}), 1e-6);
}

TEST(BlockAdjustment, NothingAtAll) {
  const FlatGround ground;
  BlockAdjustment adjustment(plain_camera(), ground);
  const AdjustedBlock block = adjusted(adjustment);
  EXPECT_EQ(block.outcome, AdjustmentOutcome::converged);
  EXPECT_TRUE(block.frames.empty());
}

TEST(BlockAdjustment, AFixSaysWhereTheBlockIs) {
  const FlatGround ground;
  BlockAdjustment adjustment(plain_camera(), ground, held_adjustment());
  adjustment.add_frame(frame_at({10, 20}));
  // The place under the image's centre is under the camera.
  adjustment.add_fix(0, {499.5, 399.5}, {40, 60});
  const AdjustedBlock block = adjusted(adjustment);
  EXPECT_EQ(block.frames[0].state, FrameState::anchored);
  EXPECT_LT(distance_m(block.frames[0].pose.position, {40, 60}), 0.05);
  // 5 m of the fix, 1 m of the tilt, 0.4 m of the click.
  EXPECT_NEAR((*block.frames[0].covariance)(0, 0), 26.14, 0.3);
  EXPECT_LT(block.points[0].control_residual_m->norm(), 0.05);
}

TEST(BlockAdjustment, WithoutTiePointsMotionHoldsFramesTogether) {
  const FlatGround ground;
  BlockAdjustment adjustment(plain_camera(), ground, held_adjustment());
  for (int i = 0; i < 5; ++i) adjustment.add_frame(frame_at({50.0 * i, 0}));
  adjustment.add_anchor({0, {3, 4}, Eigen::Matrix2d::Identity()});
  const AdjustedBlock block = adjusted(adjustment);
  for (int i = 0; i < 5; ++i) {
    const AdjustedFrame& frame = block.frames[static_cast<std::size_t>(i)];
    EXPECT_LT(distance_m(frame.pose.position, {50.0 * i + 3, 4}), 0.01);
    ASSERT_TRUE(frame.covariance);
    // Each step adds 2 m and a fifth of its length.
    EXPECT_NEAR((*frame.covariance)(0, 0), 1 + i * (4 + 100), 1);
  }
}

TEST(BlockAdjustment, ABreakInTheFlightSeparates) {
  const FlatGround ground;
  BlockAdjustment adjustment(plain_camera(), ground, held_adjustment());
  adjustment.add_frame(frame_at({0, 0}));
  AdjustmentFrame after = frame_at({50, 0});
  after.continues_flight = false;
  adjustment.add_frame(after);
  adjustment.add_anchor({0, {3, 4}, Eigen::Matrix2d::Identity()});
  const AdjustedBlock block = adjusted(adjustment);
  EXPECT_EQ(block.frames[0].state, FrameState::anchored);
  EXPECT_EQ(block.frames[1].state, FrameState::floating);
  EXPECT_FALSE(block.frames[1].covariance);
  EXPECT_LT(distance_m(block.frames[1].pose.position, {50, 0}), 0.01);
}

TEST(BlockAdjustment, DisconnectedBlocksAreJudgedByThemselves) {
  DrawnBlockOptions options = held_options();
  const RollingGround ground;
  options.strips = 1;
  options.frames_per_strip = 8;
  const DrawnBlock truth = draw_block(Random(3), options, ground);
  BlockAdjustment adjustment(truth.nominal, ground, truth.options(options));
  // Two flights over the same ground that share no point; only the first has anchors.
  for (int flight = 0; flight < 2; ++flight) {
    for (std::size_t i = 0; i < truth.frames.size(); ++i) {
      AdjustmentFrame frame = truth.frames[i];
      frame.continues_flight = i > 0;
      adjustment.add_frame(frame);
    }
  }
  for (const PositionAnchor& anchor : truth.anchors) adjustment.add_anchor(anchor);
  for (std::size_t flight = 0; flight < 2; ++flight) {
    for (TiePoint point : truth.points) {
      for (auto& o : point.observations) o.frame += flight * truth.frames.size();
      adjustment.add_tie_point(point);
    }
  }
  const AdjustedBlock block = adjusted(adjustment);
  EXPECT_EQ(block.outcome, AdjustmentOutcome::converged);
  EXPECT_EQ(block.floating_frames, truth.frames.size());
  for (std::size_t i = 0; i < truth.frames.size(); ++i) {
    const AdjustedFrame &first = block.frames[i], &second = block.frames[i + truth.frames.size()];
    EXPECT_EQ(first.state, FrameState::anchored);
    EXPECT_EQ(second.state, FrameState::floating);
    EXPECT_TRUE(first.covariance);
    EXPECT_FALSE(second.covariance);
    // Floating blocks keep their place, and get their shape.
    const Eigen::Vector2d step = second.pose.position - block.frames[truth.frames.size()].pose.position;
    EXPECT_LT((step - (truth.poses[i].position - truth.poses[0].position)).norm(), 0.1 * step.norm() + 1);
  }
  EXPECT_LT(distance_m(block.frames[truth.frames.size()].pose.position, truth.frames[0].pose.position), 0.05);
  for (const auto& cross : block.cross_covariances) EXPECT_LT(cross.a, truth.frames.size());
  EXPECT_FALSE(block.joint_covariance({0, truth.frames.size()}));
}

TEST(BlockAdjustment, WrongAnchorsAreSwitchedOffAndDoNoHarm) {
  int wrong = 0, found = 0, right_off = 0;
  double rms = 0, clean_rms = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    DrawnBlockOptions options = held_options();
    options.strips = 3;
    options.frames_per_strip = 14;
    options.anchor_every = 2;
    options.points_per_frame = 25;
    const AdjustedDraw clean(seed, options);
    options.wrong_anchor_share = 0.1;
    const AdjustedDraw drawn(seed, options);
    rms += drawn.errors().rms_m / 12;
    clean_rms += clean.errors().rms_m / 12;
    for (const AdjustedAnchor& anchor : drawn.result.anchors) {
      wrong += drawn.truth.wrong[anchor.anchor] ? 1 : 0;
      found += drawn.truth.wrong[anchor.anchor] && anchor.switched_off ? 1 : 0;
      right_off += !drawn.truth.wrong[anchor.anchor] && anchor.switched_off ? 1 : 0;
      EXPECT_TRUE(!anchor.switched_off || anchor.switch_value < 0.9);
    }
  }
  EXPECT_GE(wrong, 15);
  EXPECT_EQ(found, wrong);
  EXPECT_LE(right_off, 2);  // 0.1 % of some 230
  EXPECT_LT(rms, 1.3 * clean_rms);
}

TEST(BlockAdjustment, WrongTiePointsAreRejected) {
  DrawnBlockOptions options = held_options();
  options.strips = 3;
  options.wrong_observation_share = 0.05;
  const AdjustedDraw drawn(4, options);
  EXPECT_LT(drawn.result.mean_reprojection_px, 0.7);
  EXPECT_GT(drawn.result.rejected_observations, drawn.adjustment.observations() / 40);
  EXPECT_LT(drawn.result.rejected_observations, drawn.adjustment.observations() / 10);
  for (const AdjustedPoint& point : drawn.result.points) {
    for (const AdjustedObservation& o : point.observations) {
      EXPECT_TRUE(o.use != ObservationUse::used || o.residual_px.norm() < 0.5 * 4 + 0.01);
    }
  }
}

TEST(BlockAdjustment, AFocalLengthFourPercentOffIsFound) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    DrawnBlockOptions options = held_options();
    options.strips = 4;
    options.frames_per_strip = 12;
    options.height_sigma = 0.01;
    options.anchor_sigma_m = 2;
    const RollingGround ground;
    const DrawnBlock truth = draw_block(Random(seed), options, ground);
    CameraModel wrong = truth.nominal;
    wrong.fx *= 1.04;
    wrong.fy *= 1.04;
    AdjustmentOptions adjust = truth.options(options);
    adjust.calibration.focal_relative = 0.05;
    BlockAdjustment adjustment(wrong, ground, adjust);
    truth.add_to(adjustment);
    const AdjustedBlock block = adjusted(adjustment);
    const CameraSelfCalibration& found = block.calibration;
    EXPECT_NEAR(found.camera.fx, truth.camera.fx, 0.013 * truth.camera.fx) << seed;
    EXPECT_LT(found.log_focal.sigma, 0.006);
    EXPECT_LT(std::abs(found.log_focal.value + std::log(1.04)), 3 * found.log_focal.sigma) << seed;
    EXPECT_EQ(found.log_height_scale.sigma, 0);  // held
  }
}

TEST(BlockAdjustment, BoresightAndDistortionAreFoundWithinTheirSigmas) {
  double chi2 = 0;
  constexpr int kBlocks = 10;
  for (std::uint64_t seed = 1; seed <= kBlocks; ++seed) {
    DrawnBlockOptions options;
    options.strips = 3;
    options.frames_per_strip = 10;
    const AdjustedDraw drawn(seed, options);
    const CameraSelfCalibration& found = drawn.result.calibration;
    for (std::size_t i = 0; i < 3; ++i) {
      const double error = found.boresight[i].value - drawn.truth.boresight_rad[static_cast<Eigen::Index>(i)];
      EXPECT_LT(found.boresight[i].sigma, 0.8 * options.calibration.boresight_rad);
      chi2 += error * error / (found.boresight[i].sigma * found.boresight[i].sigma) / (4 * kBlocks);
    }
    const double error = found.distortion[0].value - drawn.truth.camera.distortion[0];
    EXPECT_LT(found.distortion[0].sigma, 0.5 * options.calibration.radial);
    chi2 += error * error / (found.distortion[0].sigma * found.distortion[0].sigma) / (4 * kBlocks);
  }
  EXPECT_GT(chi2, 0.4);
  EXPECT_LT(chi2, 1.8);
}

TEST(BlockAdjustment, PointsAndCrossCovariancesAreThoseOfTheDenseInverse) {
  // Positions of two frames and of a point, by drawing the measurements again and again.
  DrawnBlockOptions options = held_options();
  options.strips = 1;
  options.frames_per_strip = 3;
  options.points_per_frame = 15;
  options.anchor_every = 1;
  options.relief_sigma_m = 0;
  double point_nees = 0, points = 0, joint_nees = 0, joints = 0;
  for (std::uint64_t seed = 1; seed <= 150; ++seed) {
    const AdjustedDraw drawn(seed, options);
    for (std::size_t j = 0; j < drawn.result.points.size(); ++j) {
      const AdjustedPoint& point = drawn.result.points[j];
      if (!point.covariance_m2) continue;
      const Eigen::Vector3d error = point.position_m - drawn.truth.points_m[j];
      point_nees += error.dot(point.covariance_m2->llt().solve(error));
      ++points;
    }
    const auto joint = drawn.result.joint_covariance({2, 0, 1});
    if (!joint) continue;
    Eigen::VectorXd error(9);
    Eigen::MatrixXd of_positions(9, 9);
    const std::size_t order[] = {2, 0, 1};
    for (Eigen::Index a = 0; a < 3; ++a) {
      const AdjustedFrame& frame = drawn.result.frames[order[a]];
      error.segment<3>(3 * a) = Eigen::Vector3d(frame.pose.position.east_m, frame.pose.position.north_m, frame.up_m) -
                                drawn.truth.centres_m[order[a]];
      for (Eigen::Index b = 0; b < 3; ++b) of_positions.block<3, 3>(3 * a, 3 * b) = joint->block<3, 3>(6 * a, 6 * b);
    }
    joint_nees += error.dot(of_positions.llt().solve(error));
    ++joints;
  }
  ASSERT_GT(joints, 100);
  EXPECT_NEAR(point_nees / points, 3, 0.8);
  EXPECT_NEAR(joint_nees / joints, 9, 1.5);
}

TEST(BlockAdjustment, TheSameInputGivesTheSameBits) {
  DrawnBlockOptions options;
  options.wrong_anchor_share = 0.1;
  options.wrong_observation_share = 0.03;
  const AdjustedDraw first(7, options), second(7, options);
  for (std::size_t i = 0; i < first.result.frames.size(); ++i) {
    EXPECT_EQ(first.result.frames[i].pose.position, second.result.frames[i].pose.position);
    EXPECT_EQ(first.result.frames[i].up_m, second.result.frames[i].up_m);
    EXPECT_EQ(*first.result.frames[i].covariance, *second.result.frames[i].covariance);
  }
}

TEST(BlockAdjustment, AWindowMovesOnlyItsOwnFrames) {
  DrawnBlockOptions options = held_options();
  options.strips = 1;
  options.frames_per_strip = 30;
  AdjustedDraw drawn(8, options);
  const AdjustedBlock& whole = drawn.result;
  NoProgress progress;
  const AdjustedBlock window = drawn.adjustment.adjust({20, 30}, progress);
  for (std::size_t i = 0; i < 30; ++i) {
    const AdjustedFrame &before = whole.frames[i], &after = window.frames[i];
    if (i < 20) {
      EXPECT_EQ(after.state, FrameState::held);
      EXPECT_EQ(after.pose.position, before.pose.position);
      EXPECT_FALSE(after.covariance);
    } else {
      // It is at the optimum already.
      EXPECT_EQ(after.state, FrameState::anchored);
      EXPECT_LT(distance_m(after.pose.position, before.pose.position), 0.05);
      ASSERT_TRUE(after.covariance);
      EXPECT_GT((*after.covariance)(0, 0), 0.5 * (*before.covariance)(0, 0));
    }
  }
  for (const AdjustedAnchor& anchor : window.anchors) {
    EXPECT_GE(drawn.truth.anchors[anchor.anchor].frame, 20U);
  }
  const AdjustedBlock none = drawn.adjustment.adjust({5, 5}, progress);
  EXPECT_EQ(none.iterations, 0);
  EXPECT_THROW(drawn.adjustment.adjust({20, 31}, progress), UsageError);
  EXPECT_THROW(drawn.adjustment.adjust({20, 10}, progress), UsageError);
}

TEST(BlockAdjustment, AFlightThatGrowsByWindowsEndsAsTheWholeOne) {
  DrawnBlockOptions options = held_options();
  options.strips = 1;
  options.frames_per_strip = 24;
  const RollingGround ground;
  const DrawnBlock truth = draw_block(Random(9), options, ground);
  BlockAdjustment adjustment(truth.nominal, ground, truth.options(options));
  NoProgress progress;
  std::vector<std::size_t> index(truth.points.size(), truth.points.size());  // of the points that were added
  std::size_t anchor = 0;
  for (std::size_t i = 0; i < truth.frames.size(); ++i) {
    adjustment.add_frame(truth.frames[i]);
    for (; anchor < truth.anchors.size() && truth.anchors[anchor].frame <= i; ++anchor) {
      adjustment.add_anchor(truth.anchors[anchor]);
    }
    for (std::size_t j = 0; j < truth.points.size(); ++j) {
      for (const ImageObservation& o : truth.points[j].observations) {
        if (o.frame != i) continue;
        if (index[j] == truth.points.size()) {
          index[j] = adjustment.add_tie_point({{o}, {}});
        } else {
          adjustment.add_observation(index[j], o);
        }
      }
    }
    if (i % 6 == 5) adjustment.adjust({i < 12 ? 0 : i - 11, i + 1}, progress);
  }
  const BlockErrors grown = block_errors(adjustment.adjust(progress), truth);
  EXPECT_LT(grown.rms_m, 4);
  const AdjustedDraw at_once(9, options);
  EXPECT_NEAR(grown.rms_m, at_once.errors().rms_m, 0.1);
}

TEST(BlockAdjustment, APointBehindTheCameraIsLeftOut) {
  const FlatGround ground;
  BlockAdjustment adjustment(plain_camera(), ground, held_adjustment());
  adjustment.add_frame(frame_at({0, 0}));
  adjustment.add_frame(frame_at({20, 0}));
  AdjustmentFrame up = frame_at({10, 0});
  up.pose.attitude.pitch_rad = 3.0;  // upside down
  up.attitude->attitude = up.pose.attitude;
  adjustment.add_frame(up);
  adjustment.add_anchor({0, {0, 0}, Eigen::Matrix2d::Identity()});
  adjustment.add_tie_point({{{0, {580, 400}}, {1, {420, 400}}, {2, {500, 400}}}, {}});
  adjustment.add_tie_point({{{2, {500, 400}}}, {}});
  const AdjustedBlock block = adjusted(adjustment);
  EXPECT_EQ(block.points[0].observations[2].use, ObservationUse::behind_camera);
  EXPECT_EQ(block.points[0].observations[0].use, ObservationUse::used);
  EXPECT_FALSE(block.points[1].used);
  EXPECT_TRUE(block.frames[0].pose.position.vector().allFinite());
  EXPECT_EQ(block.rejected_observations, 2U);
}

TEST(BlockAdjustment, ARepeatedObservationCountsOnce) {
  const DrawnBlockOptions options = held_options();
  const AdjustedDraw once(11, options);
  const RollingGround ground;
  BlockAdjustment twice(once.truth.nominal, ground, once.truth.options(options));
  DrawnBlock doubled = once.truth;
  for (TiePoint& point : doubled.points) {
    const auto observations = point.observations;
    point.observations.insert(point.observations.end(), observations.begin(), observations.end());
  }
  doubled.add_to(twice);
  for (std::size_t j = 0; j < doubled.points.size(); ++j) twice.add_observation(j, doubled.points[j].observations[0]);
  EXPECT_EQ(twice.observations(), once.adjustment.observations());
  const AdjustedBlock block = adjusted(twice);
  EXPECT_EQ(*block.frames[3].covariance, *once.result.frames[3].covariance);
}

TEST(BlockAdjustment, ATiePointWithOneObservationSaysNothing) {
  const DrawnBlockOptions options = held_options();
  AdjustedDraw drawn(12, options);
  const AdjustedBlock before = drawn.adjust();
  const std::size_t lone = drawn.adjustment.add_tie_point({{{0, {100, 100}}}, {}});
  const AdjustedBlock after = drawn.adjust();
  EXPECT_FALSE(after.points[lone].used);
  EXPECT_EQ(after.points[lone].observations[0].use, ObservationUse::too_few);
  EXPECT_LT(distance_m(before.frames[0].pose.position, after.frames[0].pose.position), 1e-3);
}

TEST(BlockAdjustment, ImpossibleInputIsRefusedAndChangesNothing) {
  const FlatGround ground;
  EXPECT_THROW(BlockAdjustment(CameraModel{}, ground), UsageError);
  CameraModel bad = plain_camera();
  bad.distortion[1] = kNaN;
  EXPECT_THROW(BlockAdjustment(bad, ground), UsageError);
  AdjustmentOptions options;
  options.terrain_sigma_m = 0;
  EXPECT_THROW(BlockAdjustment(plain_camera(), ground, options), UsageError);
  options = {};
  options.calibration.radial = -1;
  EXPECT_THROW(BlockAdjustment(plain_camera(), ground, options), UsageError);

  BlockAdjustment adjustment(plain_camera(), ground);
  EXPECT_THROW(adjustment.add_frame(frame_at({kNaN, 0})), UsageError);
  EXPECT_THROW(adjustment.add_frame(frame_at({1e9, 0})), UsageError);
  EXPECT_THROW(adjustment.add_frame(frame_at({0, 0}, -5)), UsageError);
  EXPECT_THROW(adjustment.add_frame(frame_at({0, 0}, kNaN)), UsageError);
  AdjustmentFrame frame = frame_at({0, 0});
  frame.pose.attitude.roll_rad = std::numeric_limits<double>::infinity();
  EXPECT_THROW(adjustment.add_frame(frame), UsageError);
  frame = frame_at({0, 0});
  frame.attitude->tilt_sigma_rad = 0;
  EXPECT_THROW(adjustment.add_frame(frame), UsageError);
  frame = frame_at({0, 0});
  frame.height->relative_sigma = kNaN;
  EXPECT_THROW(adjustment.add_frame(frame), UsageError);
  EXPECT_EQ(adjustment.frames(), 0U);

  adjustment.add_frame(frame_at({0, 0}));
  EXPECT_THROW(adjustment.add_anchor({1, {0, 0}, Eigen::Matrix2d::Identity()}), UsageError);
  EXPECT_THROW(adjustment.add_anchor({0, {kNaN, 0}, Eigen::Matrix2d::Identity()}), UsageError);
  EXPECT_THROW(adjustment.add_anchor({0, {0, 0}, -Eigen::Matrix2d::Identity()}), UsageError);
  Eigen::Matrix2d crooked;
  crooked << 4, 1, 0, 4;
  EXPECT_THROW(adjustment.add_anchor({0, {0, 0}, crooked}), UsageError);
  EXPECT_THROW(adjustment.add_tie_point({{{0, {kNaN, 0}}}, {}}), UsageError);
  EXPECT_THROW(adjustment.add_tie_point({{{0, {5000, 0}}}, {}}), UsageError);
  EXPECT_THROW(adjustment.add_tie_point({{{3, {5, 0}}}, {}}), UsageError);
  EXPECT_THROW(adjustment.add_tie_point({{{0, {5, 0}, 0.0}}, {}}), UsageError);
  EXPECT_THROW(adjustment.add_fix(0, {5, 5}, {0, kNaN}), UsageError);
  EXPECT_THROW(adjustment.add_fix(0, {5, 5}, {0, 0}, -1), UsageError);
  EXPECT_THROW(adjustment.add_observation(0, {0, {5, 5}}), UsageError);
  EXPECT_EQ(adjustment.observations(), 0U);
  try {
    adjustment.add_fix(7, {5, 5}, {0, 0});
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_EQ(error.text().found, "7");
    EXPECT_EQ(error.text().where, "tie point 0");
  }
}

TEST(BlockAdjustment, CancelledItKeepsWhatItHad) {
  DrawnBlockOptions options = held_options();
  const RollingGround ground;
  const DrawnBlock truth = draw_block(Random(13), options, ground);
  BlockAdjustment adjustment(truth.nominal, ground, truth.options(options));
  truth.add_to(adjustment);
  struct Counted final : Progress {
    std::uint64_t total = 0, done = 0;
    bool ended = false;
    void begin(std::string_view, std::uint64_t of, std::string_view) override { total = of; }
    void advance(std::uint64_t steps) override { done += steps; }
    void end() override { ended = true; }
  } progress;
  int asked = 0;
  EXPECT_THROW(adjustment.adjust(progress, Cancel([&] { return ++asked > 4; })), Interrupted);
  EXPECT_FALSE(progress.ended);
  NoProgress silent;
  const AdjustedBlock untouched = adjustment.adjust({0, 0}, silent);
  for (std::size_t i = 0; i < truth.frames.size(); ++i) {
    EXPECT_LT(distance_m(untouched.frames[i].pose.position, truth.frames[i].pose.position), 1e-9);
  }
  const AdjustedBlock block = adjustment.adjust(progress);
  EXPECT_TRUE(progress.ended);
  EXPECT_GT(progress.done, 3U);
  EXPECT_LE(progress.done, 2 * progress.total);
  EXPECT_EQ(block.floating_frames, 0U);
}

TEST(BlockAdjustment, UnmeasuredAttitudeAndHeightAreFoundFromTheBlock) {
  DrawnBlockOptions options = held_options();
  options.strips = 3;
  options.anchor_every = 1;
  const RollingGround ground;
  DrawnBlock truth = draw_block(Random(14), options, ground);
  for (AdjustmentFrame& frame : truth.frames) {
    frame.attitude.reset();
    frame.height.reset();
  }
  BlockAdjustment adjustment(truth.nominal, ground, truth.options(options));
  truth.add_to(adjustment);
  const AdjustedBlock block = adjusted(adjustment);
  EXPECT_EQ(block.outcome, AdjustmentOutcome::converged);
  const BlockErrors errors = block_errors(block, truth);
  EXPECT_LT(errors.rms_m, 10);
  EXPECT_LT(errors.nees_2d, 6);
  // With one anchor, heading and scale are hardly known, and the covariance says so.
  truth.anchors.resize(1);
  BlockAdjustment one(truth.nominal, ground, truth.options(options));
  truth.add_to(one);
  const AdjustedBlock loose = adjusted(one);
  EXPECT_GT(std::sqrt((*loose.frames[14].covariance)(0, 0)), 20);
}
