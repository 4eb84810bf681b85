#include "ablation_variants.hpp"

#include "bench/keypoint_matcher.hpp"
#include "cpu_time.hpp"

namespace nadir::bench {
namespace {

MapMatcherFactory comparing(const MatchFeatures& features) {
  return [features](const MatcherMap& map) { return make_channel_matcher_with(map, features); };
}

MatchFeatures without_means() {
  MatchFeatures features;
  features.channels.means_removed = false;
  return features;
}

// Takes the point on the optical axis for the camera's position.
class PictureCentre final : public MapMatcher {
 public:
  explicit PictureCentre(const MatcherMap& map) : map_(map), matcher_(make_channel_matcher(map)) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    return centred(matcher_->match(grey, prior));
  }
  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return centred(matcher_->match_anywhere(grey, prior, area));
  }

 private:
  AnchorMatch centred(AnchorMatch match) const {
    if (!match.solved) return match;
    CameraPose& pose = match.solved->pose;
    const Eigen::Vector2d middle(map_.camera.width / 2.0, map_.camera.height / 2.0);
    if (const auto centre = ground_from_ray(pose, map_.camera.ray_from_pixel(middle), map_.surface)) {
      pose.position = *centre;
    }
    return match;
  }

  MatcherMap map_;
  std::unique_ptr<MapMatcher> matcher_;
};

class TimedMatcher final : public MapMatcher {
 public:
  TimedMatcher(std::unique_ptr<MapMatcher> timed, std::vector<double>& spent_ms)
      : timed_(std::move(timed)), spent_ms_(spent_ms) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    const double before = cpu_ms();
    AnchorMatch match = timed_->match(grey, prior);
    spent_ms_.push_back(cpu_ms() - before);
    return match;
  }
  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    const double before = cpu_ms();
    AnchorMatch match = timed_->match_anywhere(grey, prior, area);
    spent_ms_.push_back(cpu_ms() - before);
    return match;
  }

 private:
  std::unique_ptr<MapMatcher> timed_;
  std::vector<double>& spent_ms_;
};

class TimedOdometry final : public OdometryFrontEnd {
 public:
  TimedOdometry(std::unique_ptr<OdometryFrontEnd> timed, std::vector<double>& spent_ms)
      : timed_(std::move(timed)), spent_ms_(spent_ms) {}

  std::optional<OdometryStep> track(const OdometryFrame& frame) override {
    const double before = cpu_ms();
    auto step = timed_->track(frame);
    spent_ms_.push_back(cpu_ms() - before);
    return step;
  }
  void reset() override { timed_->reset(); }

 private:
  std::unique_ptr<OdometryFrontEnd> timed_;
  std::vector<double>& spent_ms_;
};

}  // namespace

std::vector<Variant> matcher_variants() {
  return {{"full", make_channel_matcher},
          {"no means removed", comparing(without_means())},
          {"one channel", comparing({ChannelSet::strength, ChannelSet::strength, {}})},
          {"grey NCC", comparing({ChannelSet::grey, ChannelSet::grey, {}})},
          {"SIFT", make_sift_matcher},
          {"image centre", [](const MatcherMap& map) { return std::make_unique<PictureCentre>(map); }}};
}

MapMatcherFactory timed(MapMatcherFactory made, std::vector<double>& spent_ms) {
  return [made = std::move(made), &spent_ms](const MatcherMap& map) {
    return std::make_unique<TimedMatcher>(made(map), spent_ms);
  };
}

OdometryFactory timed(OdometryFactory made, std::vector<double>& spent_ms) {
  return [made = std::move(made), &spent_ms] { return std::make_unique<TimedOdometry>(made(), spent_ms); };
}

}  // namespace nadir::bench
