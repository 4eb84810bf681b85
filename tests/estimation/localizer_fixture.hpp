// A flight over a synthetic landscape and the landscape as a map, for tests of the localizer.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "estimation/localizer.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir::test {

inline const LonLat kOrigin{11.2, 48.1};

Ground landscape_ground();
const TileSource& landscape_tiles();  // the landscape in another light than the camera's
CameraFile flight_camera();

struct Moment {
  CameraPose truth;
  Telemetry telemetry;
  cv::Mat image;
};

// A gentle curve at 17 m/s; the telemetry's heading is 1 degree off, its height 1 %, its tilt half a degree.
std::vector<Moment> flight(int frames);
const std::vector<Moment>& short_flight();  // the first four

LonLat place_of(PlanePoint point);
LonLat start();  // 19 m off
LocalizerConfig config();
double off_m(const Estimate& estimate, const Moment& moment);  // very far without a position
void expect_sound(const Estimate& estimate);

}  // namespace nadir::test
