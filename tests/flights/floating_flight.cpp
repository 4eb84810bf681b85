#include "flights/floating_flight.hpp"

#include <fmt/format.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir::test {
namespace {

void add_pictures(FlightStore& store, const std::vector<Moment>& moments, std::size_t first, std::size_t end) {
  std::vector<EncodedPicture> pictures;
  for (std::size_t i = first; i < end; ++i) {
    EncodedPicture& picture = pictures.emplace_back();
    picture.telemetry = moments[i].telemetry;
    picture.name = picture.telemetry.frame = fmt::format("frame{}.img", i);
    picture.bytes = encode_image(moments[i].image, ImageFormat::png);
  }
  for (const PictureAnswer& answer : store.accept(offers(pictures), kNow)) {
    if (answer.outcome != PictureAnswer::Outcome::accepted) throw std::logic_error("a picture was refused");
  }
}

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
  add_pictures(store, floating_moments(), static_cast<std::size_t>(first), static_cast<std::size_t>(end));
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

namespace {

// The landscape's map ends to the east.
class WesternTiles final : public TileSource {
 public:
  ZoomRange zooms() const override { return landscape_tiles().zooms(); }
  std::optional<Bytes> read(const TileKey& key) const override {
    const LonLat middle = lonlat_from_pixel(
        {(static_cast<double>(key.x) + 0.5) * kTileSize, (static_cast<double>(key.y) + 0.5) * kTileSize}, key.z);
    if (LocalFrame(kOrigin).plane_from_lonlat(middle).east_m > 10) return std::nullopt;
    return landscape_tiles().read(key);
  }
};

std::vector<Moment> two_passes(const Ground& second) {
  std::vector<Moment> moments;
  Random random(5);
  for (int i = 0; i < kSecondBegins + kSecondPass; ++i) {
    const bool first = i < kFirstPass;
    const int along = first ? i : i - kSecondBegins;
    Moment& moment = moments.emplace_back();
    const PlanePoint at = first ? PlanePoint{-130 + 25.0 * along, 3 * std::sin(along)}
                                : PlanePoint{85 + 2 * std::sin(along), -100 + 25.0 * along};
    const double heading = radians(first ? 88 : 3) + radians(1.5) * std::sin(0.5 * along);
    moment.truth = {at, 100 + 2.0 * std::sin(i), {heading, radians(2), radians(i % 2 == 0 ? 3 : -2)}};
    moment.image = photograph(first ? landscape_ground() : second, flight_camera().camera, moment.truth);
    if (i == kFirstPass) moment.image.setTo(0);
    Telemetry& t = moment.telemetry;
    t.time_s = 10 + 1.5 * i + (first ? 0 : 30);
    t.agl_m = moment.truth.agl_m * 1.01;
    t.heading_rad = wrap_pi(heading - radians(1) + random.normal(0, radians(0.2)));
    t.pitch_rad = moment.truth.attitude.pitch_rad + random.normal(0, radians(0.5));
    t.roll_rad = moment.truth.attitude.roll_rad + random.normal(0, radians(0.5));
  }
  return moments;
}

LonLat crossing_start() { return place_of({-122, -10}); }

}  // namespace

std::vector<Moment> crossing_moments() {
  static const std::vector<Moment> moments = two_passes(landscape_ground());
  return moments;
}

std::vector<Moment> passing_moments() {
  static const Landscape other(77, 220);
  static const std::vector<Moment> moments = two_passes(other.ground());
  return moments;
}

std::unique_ptr<FlightStore> crossing_flight(const std::filesystem::path& folder, const std::vector<Moment>& moments) {
  FlightDescription flight = description(Course::smooth);
  flight.session.start = crossing_start();
  auto store = FlightStore::create(folder, flight, kNow);
  add_pictures(*store, moments, 0, moments.size());
  return store;
}

FlightEngineSetup crossing_setup() {
  static const WesternTiles tiles;
  FlightEngineSetup setup = engine_setup(Course::smooth);
  setup.tiles = &tiles;
  setup.start = crossing_start();
  setup.localizer.area = PlaneBox{-200, -200, 200, 200};
  return setup;
}

FlightEngineSetup blind_crossing_setup() {
  FlightEngineSetup setup = crossing_setup();
  setup.localizer.matcher = [made = std::make_shared<int>(0)](const MatcherMap& map) -> std::unique_ptr<MapMatcher> {
    if ((*made)++ == 0) return std::make_unique<BlindMatcher>();
    return make_channel_matcher(map);
  };
  return setup;
}

FlightEngineSetup elsewhere_setup() {
  return setup_with([](const MatcherMap& map) { return std::make_unique<MirroredMatcher>(make_channel_matcher(map)); });
}

}  // namespace nadir::test
