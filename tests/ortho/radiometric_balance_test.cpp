// Frames of known exposure through a lens of known fall-off: whether the balance finds both, and what it must not do.
#include "ortho/radiometric_balance.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/random.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

constexpr double kFalloff = -0.5;  // of ln level, at the corner: 0.6 of the light
constexpr int kSteps = 5;          // to the east; two passes, frames overlap by three quarters and by a half

class Balancing : public ::testing::Test {
 protected:
  struct Taken {
    CameraPose pose;
    std::array<double, 3> log_exposure{};
    cv::Mat image;
  };

  static double ground(PlanePoint place) { return 90 + 0.35 * (test::waves(place) - 128); }
  static double r2(const CameraModel& camera, int x, int y) {
    const double half = std::hypot(camera.width, camera.height) / 2;
    return std::pow(std::hypot(x - camera.cx, y - camera.cy) / half, 2);
  }
  Taken taken(double east_m, double north_m, const std::array<double, 3>& log_exposure) const {
    Taken frame{{{east_m, north_m}, 100, {}}, log_exposure, {}};
    const cv::Mat grey = test::photograph(ground, camera_, frame.pose);
    frame.image.create(grey.size(), CV_8UC3);
    for (int y = 0; y < grey.rows; ++y) {
      for (int x = 0; x < grey.cols; ++x) {
        for (int c = 0; c < 3; ++c) {
          const double log_light = log_exposure[static_cast<std::size_t>(c)] + kFalloff * r2(camera_, x, y);
          frame.image.at<cv::Vec3b>(y, x)[c] =
              cv::saturate_cast<std::uint8_t>(grey.at<std::uint8_t>(y, x) * std::exp(log_light));
        }
      }
    }
    return frame;
  }
  std::vector<Taken> survey() const {
    Random random(5);
    std::vector<Taken> frames;
    for (int pass = 0; pass < 2; ++pass) {
      for (int i = 0; i < kSteps; ++i) {
        const double gain = random.normal(0, 0.15), warmth = random.normal(0, 0.05);
        frames.push_back(taken(40.0 * i, 60.0 * pass, {gain - warmth, gain, gain + warmth}));
      }
    }
    return frames;
  }
  std::vector<RadiometricCorrection> balance(const std::vector<Taken>& frames) const {
    RadiometricBalance balance(surface_);
    for (std::size_t i = 0; i < frames.size(); ++i)
      balance.add(static_cast<std::uint32_t>(i), frames[i].image, camera_, frames[i].pose);
    return balance.solve(frames.size());
  }
  // Of the ground that any two frames show: by how much ln of their corrected levels differs at most.
  double worst_step(const std::vector<Taken>& frames, const std::vector<RadiometricCorrection>& corrections) const {
    double worst = 0;
    for (double east = -60; east <= 220; east += 10) {
      for (double north = -60; north <= 120; north += 10) {
        std::array<std::vector<double>, 3> levels;
        for (std::size_t i = 0; i < frames.size(); ++i) {
          const Eigen::Vector2d at =
              camera_.pixel_from_point(camera_from_ground(frames[i].pose, {east, north}, surface_));
          const int x = static_cast<int>(std::lround(at.x())), y = static_cast<int>(std::lround(at.y()));
          if (x < 0 || y < 0 || x >= camera_.width || y >= camera_.height) continue;
          for (std::size_t c = 0; c < 3; ++c) {
            levels[c].push_back(frames[i].log_exposure[c] + kFalloff * r2(camera_, x, y) +
                                corrections[i].log_factor(c, camera_, x, y));
          }
        }
        for (const auto& of : levels) {
          if (of.empty()) continue;
          const auto [least, most] = std::minmax_element(of.begin(), of.end());
          worst = std::max(worst, *most - *least);
        }
      }
    }
    return worst;
  }

  FlatGround surface_;
  CameraModel camera_ = test::small_camera();
};

TEST_F(Balancing, FindsExposuresAndFallOff) {
  const std::vector<Taken> frames = survey();
  EXPECT_GT(worst_step(frames, std::vector<RadiometricCorrection>(frames.size())), 0.5);
  EXPECT_LT(worst_step(frames, balance(frames)), 0.03) << "3 % of the level, at the worst place of the worst pair";
}

// Ground that is brighter towards the west, as seen: each overlap has the same sign, and their sum is no exposure.
TEST_F(Balancing, KeepsTheLargeScaleWhereTheSunShinesFromOneSide) {
  std::vector<Taken> frames;
  for (int i = 0; i < 16; ++i) {
    frames.push_back(taken(40.0 * i, 0, {}));
    for (int x = 0; x < camera_.width; ++x) {
      cv::Mat column = frames.back().image.col(x);
      column *= std::exp(0.1 * (camera_.cx - x) / camera_.cx);
    }
  }
  const auto corrections = balance(frames);
  const auto gain = [&](std::size_t i) { return corrections[i].log_factor(1, camera_, camera_.cx, camera_.cy); };
  EXPECT_LT(std::abs(gain(15) - gain(0)), 0.05) << "a ramp would be 0.5";
  EXPECT_GT(
      corrections[8].log_factor(1, camera_, 310, camera_.cy) - corrections[8].log_factor(1, camera_, 10, camera_.cy),
      0.12);
}

TEST_F(Balancing, KeepsTheLevelOfTheWhole) {
  const std::vector<Taken> frames = survey();
  const auto corrections = balance(frames);
  double before = 0, after = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    cv::Mat corrected = frames[i].image.clone();
    corrections[i].apply(corrected, camera_);
    before += cv::mean(frames[i].image)[1], after += cv::mean(corrected)[1];
  }
  EXPECT_NEAR(after / before, 1, 0.03);
}

TEST_F(Balancing, CorrectsAReducedImageLikeTheWholeOne) {
  const std::vector<Taken> frames = survey();
  const RadiometricCorrection correction = balance(frames)[3];
  cv::Mat whole = frames[3].image.clone(), reduced;
  cv::resize(frames[3].image, reduced, {camera_.width / 2, camera_.height / 2}, 0, 0, cv::INTER_AREA);
  correction.apply(whole, camera_);
  correction.apply(reduced, camera_.scaled(0.5));
  cv::resize(whole, whole, reduced.size(), 0, 0, cv::INTER_AREA);
  EXPECT_LE(cv::norm(whole, reduced, cv::NORM_INF), 2);
}

// A field was mown between the passes, and a cloud's shadow lies over a quarter of one frame.
TEST_F(Balancing, IsNotMisledByWhatHasChanged) {
  std::vector<Taken> frames = survey();
  cv::Mat shadow = frames[7].image(cv::Rect(0, 0, camera_.width / 2, camera_.height / 2));
  shadow *= 0.6;
  EXPECT_LT(worst_step(frames, balance(frames)), 0.06);
}

TEST_F(Balancing, IgnoresWhatIsClipped) {
  std::vector<Taken> frames = survey();
  frames[4].image(cv::Rect(0, 0, camera_.width / 2, camera_.height)).setTo(cv::Scalar::all(255));
  EXPECT_LT(worst_step(frames, balance(frames)), 0.03);
}

TEST_F(Balancing, LeavesFramesAsTheyAreThatShareNoGround) {
  std::vector<Taken> frames{taken(0, 0, {0.2, 0.2, 0.2}), taken(5000, 0, {-0.2, -0.2, -0.2})};
  for (const RadiometricCorrection& correction : balance(frames)) EXPECT_EQ(correction, RadiometricCorrection());
  RadiometricBalance nothing(surface_);
  const auto corrections = nothing.solve(3);
  ASSERT_EQ(corrections.size(), 3U);
  cv::Mat image = frames[0].image.clone();
  corrections[2].apply(image, camera_);
  EXPECT_EQ(cv::norm(image, frames[0].image, cv::NORM_INF), 0);
}

TEST_F(Balancing, LooksAtNoFrameBesideTheHorizon) {
  std::vector<Taken> frames = survey();
  frames[2].pose.attitude.pitch_rad = 1.4;
  const auto corrections = balance(frames);
  EXPECT_EQ(corrections[2], RadiometricCorrection());
  EXPECT_FALSE(corrections[3] == RadiometricCorrection());
}

TEST_F(Balancing, GivesTheSameBits) {
  const std::vector<Taken> frames = survey();
  EXPECT_EQ(balance(frames), balance(frames));
}

}  // namespace
}  // namespace nadir
