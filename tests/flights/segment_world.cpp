#include "flights/segment_world.hpp"

#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <string>

#include "base/random.hpp"
#include "estimation/localizer.hpp"
#include "estimation/localizer_fixture.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir::test {
namespace {

constexpr double kSquare_m = 40;  // of land that changes as a whole
constexpr double kHole_m = 250;   // around each frame of a segment
constexpr double kReliefWave_m = 600;
constexpr int kRayIterations = 4;  // each leaves a hundredth: the slope times the ray's

std::uint64_t mixed(std::uint64_t value) {
  value ^= value >> 31;
  value *= 0x9E3779B97F4A7C15ULL;
  return value ^ (value >> 29);
}

}  // namespace

struct SegmentWorld::Land {
  Land(std::uint64_t number, const WorldOptions& world)
      : seed(number),
        options(world),
        now(2 * number + 1, world.half_side_m),
        before(2 * number + 2, world.half_side_m),
        frame(kOrigin),
        camera(flight_camera()) {}

  double mapped(PlanePoint place) const {
    const auto square = [](double at_m) { return static_cast<std::int64_t>(std::floor(at_m / kSquare_m)); };
    const std::uint64_t drawn = mixed(mixed(static_cast<std::uint64_t>(square(place.east_m)) + 1000) * 7919 +
                                      static_cast<std::uint64_t>(square(place.north_m)) + 1000 + seed * 104729);
    const bool changed = static_cast<double>(drawn % 10000) < 10000 * options.changed_share;
    return (changed ? before : now).grey(place);
  }

  // Two waves across each other, as long as a slope that a footprint sees as one.
  double height_m(PlanePoint place) const {
    const double phase = static_cast<double>(mixed(seed) % 1000) / 1000 * 2 * kPi;
    const double across = std::sin(2 * kPi * place.east_m / kReliefWave_m + phase);
    const double along = std::sin(2 * kPi * place.north_m / kReliefWave_m + 2 * phase);
    return options.relief_m * (across + along);
  }
  // What a camera sees that would see `flat` on level ground: where its ray meets the relief.
  double seen(PlanePoint flat, const CameraPose& from) const {
    PlanePoint place = flat;
    for (int i = 0; i < kRayIterations && options.relief_m > 0; ++i) {
      place = from.position + (1 - height_m(place) / from.agl_m) * (flat - from.position);
    }
    return now.grey(place);
  }

  std::uint64_t seed;
  WorldOptions options;
  Landscape now, before;
  LocalFrame frame;
  CameraFile camera;
};

namespace {

class LandTiles final : public TileSource {
 public:
  LandTiles(const SegmentWorld::Land& land, MapHole hole, std::vector<PlanePoint> flown)
      : land_(land), hole_(hole), flown_(std::move(flown)) {}

  ZoomRange zooms() const override { return {18, 18}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    if (key.z != 18) return std::nullopt;
    const auto known = tiles_.find(key);
    if (known != tiles_.end()) return known->second;
    return tiles_[key] = paint(key);
  }

 private:
  PlanePoint corner(const TileKey& key, int column, int row) const {
    return land_.frame.plane_from_lonlat(lonlat_from_pixel(
        {static_cast<double>(key.x) * kTileSize + column, static_cast<double>(key.y) * kTileSize + row}, key.z));
  }

  std::optional<Bytes> paint(const TileKey& key) const {
    const PlanePoint nw = corner(key, 0, 0), se = corner(key, kTileSize, kTileSize);
    const double reach = land_.options.half_side_m;
    if (std::max({-se.east_m, nw.east_m, se.north_m, -nw.north_m}) > reach) return std::nullopt;
    const PlanePoint middle{(nw.east_m + se.east_m) / 2, (nw.north_m + se.north_m) / 2};
    if (hole_ == MapHole::blank) {
      for (const PlanePoint& at : flown_) {
        if (distance_m(at, middle) < kHole_m) return std::nullopt;
      }
    }
    cv::Mat tile(kTileSize, kTileSize, CV_8UC1);
    for (int r = 0; r < kTileSize; ++r) {
      for (int c = 0; c < kTileSize; ++c) {
        const PlanePoint place{std::lerp(nw.east_m, se.east_m, (c + 0.5) / kTileSize),
                               std::lerp(nw.north_m, se.north_m, (r + 0.5) / kTileSize)};
        const double grey = hole_ == MapHole::other_land ? land_.before.grey(place) : land_.mapped(place);
        tile.at<std::uint8_t>(r, c) = cv::saturate_cast<std::uint8_t>(40 + 0.7 * grey);
      }
    }
    return encode_image(tile, ImageFormat::jpeg, 90);
  }

  const SegmentWorld::Land& land_;
  MapHole hole_;
  std::vector<PlanePoint> flown_;
  mutable std::map<TileKey, std::optional<Bytes>> tiles_;
};

}  // namespace

SegmentWorld::SegmentWorld(std::uint64_t seed, const WorldOptions& options)
    : land_(std::make_unique<Land>(seed, options)) {}

SegmentWorld::~SegmentWorld() = default;

const LocalFrame& SegmentWorld::frame() const { return land_->frame; }

const CameraFile& SegmentWorld::camera() const { return land_->camera; }

PlaneBox SegmentWorld::area() const { return square_around({0, 0}, land_->options.half_side_m - 100); }

SegmentWorld::Segment SegmentWorld::segment(int number, int frames, bool heading_known) const {
  Random random(mixed(land_->seed * 1000 + static_cast<std::uint64_t>(number)) % 1'000'000 + 1);
  Segment segment;
  const double inner_m = land_->options.half_side_m - 250;
  double heading = random.uniform(-kPi, kPi);
  PlanePoint at{random.uniform(-inner_m, inner_m) * 0.7, random.uniform(-inner_m, inner_m) * 0.7};
  const double turn_rad = radians(random.uniform(-4, 4)), heading_error_rad = random.normal(0, radians(1));
  // Odometry alone: nothing ties it to a map. It begins at a position that means nothing.
  LocalizerConfig config;
  RecordedVision vision;
  vision.attach(config);
  Localizer localizer(land_->camera, land_->frame, nullptr, kOrigin, config);
  for (int i = 0; i < frames; ++i) {
    const CameraPose truth{at, 100 + 2.0 * std::sin(i), {heading, radians(2), radians(i % 2 == 0 ? 3 : -2)}};
    cv::Mat image = photograph([&](PlanePoint flat) { return land_->seen(flat, truth); }, land_->camera.camera, truth);
    if (land_->options.noise > 0) {
      for (auto pixel = image.begin<std::uint8_t>(); pixel != image.end<std::uint8_t>(); ++pixel) {
        *pixel = cv::saturate_cast<std::uint8_t>(*pixel + random.normal(0, land_->options.noise));
      }
    }
    ObservedFrame observed;
    observed.frame = static_cast<std::size_t>(i);
    Telemetry& telemetry = observed.telemetry;
    telemetry.frame = "frame" + std::to_string(i);
    telemetry.time_s = 10 + 1.5 * i;
    telemetry.agl_m = truth.agl_m * 1.01;
    if (heading_known) telemetry.heading_rad = wrap_pi(heading + heading_error_rad + random.normal(0, radians(0.2)));
    telemetry.pitch_rad = truth.attitude.pitch_rad + random.normal(0, land_->options.tilt_sigma_rad);
    telemetry.roll_rad = truth.attitude.roll_rad + random.normal(0, land_->options.tilt_sigma_rad);
    vision.begin_frame(observed.frame);
    const FrameReport report = localizer.process(image, telemetry);
    observed.answers = vision.end_frame();
    observed.estimate = report.estimate;
    observed.state = report.state;
    observed.look = report.anchor;
    segment.truth.push_back(truth);
    segment.images.push_back(image);
    segment.observed.push_back(observed);
    at = {at.east_m + 25 * std::sin(heading), at.north_m + 25 * std::cos(heading)};
    heading += turn_rad;
  }
  // The longest piece that odometry did not break is what a flight would call a segment.
  segment.shape = segment_shape(segment.observed, land_->camera.uncertainty);
  return segment;
}

std::unique_ptr<TileSource> SegmentWorld::map(MapHole hole, const Segment& segment) const {
  std::vector<PlanePoint> flown;
  for (const CameraPose& pose : segment.truth) flown.push_back(pose.position);
  return std::make_unique<LandTiles>(*land_, hole, std::move(flown));
}

SegmentPlacementResult SegmentWorld::place(const Segment& segment, MapHole hole,
                                           const std::vector<PlaceStatement>& stated,
                                           const std::optional<PlaceStatement>& predicted) const {
  const auto tiles = map(hole, segment);
  const FlatGround flat;
  const auto matcher = make_channel_matcher({land_->camera.camera, *tiles, land_->frame, flat});
  const PlacementMap placement_map{
      .camera = land_->camera, .matcher = *matcher, .area = area(), .places = nullptr, .read = [&](std::size_t frame) {
        return segment.images[frame];
      }};
  SegmentPlacement placement(segment.shape, placement_map, stated, predicted);
  while (placement.step()) {
  }
  return placement.result();
}

}  // namespace nadir::test
