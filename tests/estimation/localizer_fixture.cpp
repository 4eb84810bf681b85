#include "estimation/localizer_fixture.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir::test {
namespace {

const Landscape& landscape() {
  static const Landscape world(31, 220);
  return world;
}

// The landscape as an encoded tile set, in another light than the camera's.
class LandscapeTiles final : public TileSource {
 public:
  explicit LandscapeTiles(ImageFormat format) : format_(format), frame_(kOrigin) {}

  ZoomRange zooms() const override { return {18, 18}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    if (key.z != 18) return std::nullopt;
    const auto known = tiles_.find(key);
    if (known != tiles_.end()) return known->second;
    const PlanePoint north_west = corner(key, 0, 0), south_east = corner(key, kTileSize, kTileSize);
    const double reach = landscape().half_side_m();
    if (std::max({-south_east.east_m, north_west.east_m, south_east.north_m, -north_west.north_m}) > reach) {
      return tiles_[key] = std::nullopt;
    }
    const PlanePoint north_east = corner(key, kTileSize, 0), south_west = corner(key, 0, kTileSize);
    cv::Mat tile(kTileSize, kTileSize, CV_8UC1);
    for (int r = 0; r < kTileSize; ++r) {
      for (int c = 0; c < kTileSize; ++c) {  // within a tile the plane is as good as linear
        const double u = (c + 0.5) / kTileSize, v = (r + 0.5) / kTileSize;
        const auto mix = [&](double nw, double ne, double sw, double se) {
          return (1 - v) * ((1 - u) * nw + u * ne) + v * ((1 - u) * sw + u * se);
        };
        const PlanePoint place{mix(north_west.east_m, north_east.east_m, south_west.east_m, south_east.east_m),
                               mix(north_west.north_m, north_east.north_m, south_west.north_m, south_east.north_m)};
        tile.at<std::uint8_t>(r, c) = cv::saturate_cast<std::uint8_t>(40 + 0.7 * landscape().grey(place));
      }
    }
    return tiles_[key] = encode_image(tile, format_, 90);
  }

 private:
  PlanePoint corner(const TileKey& key, int column, int row) const {
    return frame_.plane_from_lonlat(lonlat_from_pixel(
        {static_cast<double>(key.x) * kTileSize + column, static_cast<double>(key.y) * kTileSize + row}, key.z));
  }

  ImageFormat format_;
  LocalFrame frame_;
  mutable std::map<TileKey, std::optional<Bytes>> tiles_;
};

}  // namespace

Ground landscape_ground() { return landscape().ground(); }

const TileSource& landscape_tiles() {
  static const LandscapeTiles set(ImageFormat::jpeg);
  return set;
}

CameraFile flight_camera() {
  CameraFile file;
  file.camera = small_camera();
  file.camera.distortion = {-0.1, 0.01, 0, 0, 0};
  file.uncertainty = {radians(1), 0.015, radians(1)};
  return file;
}

std::vector<Moment> flight(int frames) {
  std::vector<Moment> moments;
  Random random(1);
  PlanePoint at{-60, -45};
  double heading = radians(50);
  for (int i = 0; i < frames; ++i) {
    Moment moment;
    moment.truth = {at, 100 + 2.0 * std::sin(i), {heading, radians(3), radians(i % 2 == 0 ? 5 : -2)}};
    moment.image = photograph(landscape().ground(), flight_camera().camera, moment.truth);
    Telemetry& t = moment.telemetry;
    t.frame = "frame" + std::to_string(i) + ".jpg";
    t.time_s = 10 + 1.5 * i;
    t.agl_m = moment.truth.agl_m * 1.01;
    t.heading_rad = wrap_pi(heading - radians(1) + random.normal(0, radians(0.2)));
    t.pitch_rad = moment.truth.attitude.pitch_rad + random.normal(0, radians(0.5));
    t.roll_rad = moment.truth.attitude.roll_rad + random.normal(0, radians(0.5));
    moments.push_back(moment);
    at = {at.east_m + 25 * std::sin(heading), at.north_m + 25 * std::cos(heading)};
    heading += radians(4);
  }
  return moments;
}

const std::vector<Moment>& short_flight() {
  static const std::vector<Moment> moments = flight(4);
  return moments;
}

LonLat place_of(PlanePoint point) { return LocalFrame(kOrigin).lonlat_from_plane(point); }

LonLat start() { return place_of({-48, -60}); }

LocalizerConfig config() {
  LocalizerConfig c;
  c.start_sigma_m = 20;
  c.map_sigma_m = 1;
  return c;
}

double off_m(const Estimate& estimate, const Moment& moment) {
  if (!estimate.position) return 1e9;
  return distance_m(LocalFrame(kOrigin).plane_from_lonlat(*estimate.position), moment.truth.position);
}

void expect_sound(const Estimate& estimate) {
  EXPECT_TRUE(std::isfinite(estimate.sigma_m));
  EXPECT_GE(estimate.sigma_m, 0);
  EXPECT_TRUE(estimate.covariance_m2.allFinite());
  EXPECT_EQ(estimate.position.has_value(), estimate.source != SourceLabel::no_fix);
  if (!estimate.position) return;
  EXPECT_GT(estimate.sigma_m, 0) << "never without a sigma";
  EXPECT_TRUE(std::isfinite(estimate.position->lon_deg) && std::isfinite(estimate.position->lat_deg));
}

}  // namespace nadir::test
