// A stored picture as vision compares it: decoded, reduced, and, of a rolling shutter, as all lines would have shown it
// at one moment. The localizer undoes the shutter of what it is given; everything that looks at pictures again, after
// the flight or beside it, takes them from here: placements, adjustment, diagnosis, the desk.
//
// The motion during the readout is what was known online: the telemetry's turn rate and attitude, the velocity of the
// estimate. A frame that has not been processed has no velocity yet; its turn is undone.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <opencv2/core/mat.hpp>

#include "flights/flight_store.hpp"
#include "vision/camera.hpp"

namespace nadir {

// camera: of the picture reduced so. CV_8UC1; empty when it cannot be decoded.
cv::Mat picture_at_one_moment(const FlightStore& store, std::size_t frame, const CameraFile& camera, int shrink);

// Where a pixel of the picture as it was taken, a place that a person has clicked, lies in that image.
Eigen::Vector2d pixel_at_one_moment(const FlightStore& store, std::size_t frame, const CameraFile& camera,
                                    const Eigen::Vector2d& as_read);

}  // namespace nadir
