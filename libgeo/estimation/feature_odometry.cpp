#include <opencv2/features2d.hpp>

#include "estimation/odometry.hpp"
#include "estimation/two_view_step.hpp"
#include "vision/feature_matching.hpp"

namespace nadir {
namespace {

constexpr int kMaxFeatures = 900;
constexpr double kLeastContrast = 0.007;
constexpr double kMatchRatio = 0.85;

struct Seen {
  OdometryFrame frame;  // without its picture
  std::vector<cv::KeyPoint> points;
  FeatureDescriptors descriptors;
};

Seen look(const OdometryFrame& frame, cv::Feature2D& detector) {
  Seen seen{at_working_size(frame), {}, {}};
  cv::Mat descriptors;
  detector.detectAndCompute(seen.frame.grey, cv::noArray(), seen.points, descriptors);
  seen.descriptors = FeatureDescriptors(descriptors);
  seen.frame.grey.release();
  return seen;
}

SharedPixels shared_by(const Seen& before, const Seen& now) {
  SharedPixels shared;
  for (const FeatureMatch& match : unambiguous_matches(now.descriptors, before.descriptors, kMatchRatio)) {
    shared.before.push_back(before.points[match.second].pt);
    shared.now.push_back(now.points[match.first].pt);
  }
  return shared;
}

class FeatureOdometry final : public OdometryFrontEnd {
 public:
  std::optional<OdometryStep> track(const OdometryFrame& frame) override {
    Seen now = look(frame, *detector_);
    std::optional<OdometryStep> step;
    if (last_) {
      if (auto measured = measure_step(last_->frame, now.frame, shared_by(*last_, now))) step = measured->step;
    }
    last_ = std::move(now);
    return step;
  }

  void reset() override { last_.reset(); }

 private:
  cv::Ptr<cv::Feature2D> detector_ = cv::SIFT::create(kMaxFeatures, 3, kLeastContrast);
  std::optional<Seen> last_;
};

}  // namespace

std::unique_ptr<OdometryFrontEnd> make_feature_odometry() { return std::make_unique<FeatureOdometry>(); }

}  // namespace nadir
