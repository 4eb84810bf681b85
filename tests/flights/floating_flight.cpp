#include "flights/floating_flight.hpp"

#include <fmt/format.h>

#include <opencv2/core.hpp>

#include "imagery/codecs.hpp"

namespace nadir::test {
namespace {

class BlindMatcher final : public MapMatcher {
 public:
  AnchorMatch match(const cv::Mat& /*grey*/, const AnchorPrior& /*prior*/) override { return {}; }
  AnchorMatch match_anywhere(const cv::Mat& /*grey*/, const AnchorPrior& /*prior*/, const PlaneBox& /*area*/) override {
    return {};
  }
};

// Finds what the real one finds in the mirror: nothing of it is where it seems.
class MirroredMatcher final : public MapMatcher {
 public:
  explicit MirroredMatcher(std::unique_ptr<MapMatcher> real) : real_(std::move(real)) {}
  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    return real_->match(mirrored(grey), prior);
  }
  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return real_->match_anywhere(mirrored(grey), prior, area);
  }

 private:
  static cv::Mat mirrored(const cv::Mat& grey) {
    cv::Mat mirror;
    cv::flip(grey, mirror, 1);
    return mirror;
  }
  std::unique_ptr<MapMatcher> real_;
};

FlightEngineSetup setup_with(const std::function<std::unique_ptr<MapMatcher>(const MatcherMap&)>& of_placer) {
  FlightEngineSetup setup = engine_setup(Course::smooth);
  setup.start.reset();
  setup.localizer.area = PlaneBox{-130, -130, 150, 150};
  setup.localizer.matcher = [made = std::make_shared<int>(0),
                             of_placer](const MatcherMap& map) -> std::unique_ptr<MapMatcher> {
    if ((*made)++ == 0) return std::make_unique<BlindMatcher>();
    return of_placer(map);
  };
  return setup;
}

}  // namespace

std::vector<Moment> floating_moments() {
  static const std::vector<Moment> moments = flight(kFloatingFrames);
  return moments;
}

void add_floating_pictures(FlightStore& store, int first, int end) {
  std::vector<EncodedPicture> pictures;
  const std::vector<Moment> moments = floating_moments();
  for (auto i = static_cast<std::size_t>(first); i < static_cast<std::size_t>(end); ++i) {
    EncodedPicture& picture = pictures.emplace_back();
    picture.telemetry = moments[i].telemetry;
    picture.name = picture.telemetry.frame = fmt::format("frame{}.img", i);
    picture.bytes = encode_image(moments[i].image, ImageFormat::png);
  }
  for (const PictureAnswer& answer : store.accept(offers(pictures), kNow)) {
    if (answer.outcome != PictureAnswer::Outcome::accepted) throw std::logic_error("a picture was refused");
  }
}

std::unique_ptr<FlightStore> floating_flight(const std::filesystem::path& folder, int frames,
                                             const FlightStoreOptions& options) {
  FlightDescription flight = description(Course::smooth);
  flight.session.start.reset();
  auto store = FlightStore::create(folder, flight, kNow, options);
  add_floating_pictures(*store, 0, frames);
  return store;
}

FlightEngineSetup floating_setup() {
  return setup_with([](const MatcherMap& map) { return make_channel_matcher(map); });
}

FlightEngineSetup elsewhere_setup() {
  return setup_with([](const MatcherMap& map) { return std::make_unique<MirroredMatcher>(make_channel_matcher(map)); });
}

}  // namespace nadir::test
