// How late the frames are, against the gyroscopes: the time between an exposure and the stamp that the frame got, in
// the clock of an inertial sensor that turns with the camera.
//
// Two neighbouring frames show how the camera turned between their exposures, whatever it flew over; the gyroscopes
// measure the same between any two moments. With a delay d, the constant error b of the gyroscopes, and the small
// rotation M from the sensor's axes to the camera's,
//
//   R_before^T R_now = M ΔR(t_before - d, t_now - d; b) M^T        ΔR: inertial_preintegration.hpp
//
// so that d shows wherever the aircraft turns faster at one frame than at the other: at the beginning and the end of
// each turn. All three axes are compared: of the heading alone, a sensor that is mounted askew looks like a delay,
// since aircraft bank as they begin to turn. Robust least squares over d, b and M, solved by Ceres from the best delay
// of a grid. Neither map nor GPS is needed.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "base/progress.hpp"
#include "estimation/inertial_preintegration.hpp"
#include "replay/flight_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {

// Two frames that show the same ground. Attitudes of the camera as the images have them against each other; the heading
// of the first is the telemetry's.
struct ImageTurn {
  double from_s = 0, to_s = 0;  // their stamps
  Attitude before, now;
  Eigen::Matrix3d covariance_rad2 = Eigen::Matrix3d::Identity();  // of the turn: a rotation vector in the camera's axes
};

struct GyroDelay {
  double delay_s = 0;  // to be added to the capture delay
  double sigma_s = 0;
  Eigen::Vector3d bias_rad_s = Eigen::Vector3d::Zero();  // of the gyroscopes
  Eigen::Vector3d mount_rad = Eigen::Vector3d::Zero();   // rotation vector of M
  std::size_t used = 0, outliers = 0;                    // pairs of frames
};

// All samples of the flight, in order of time; empty without an inertial sensor.
std::vector<InertialSample> inertial_samples(const Flight& flight);

// From the flight's images: pairs of neighbours whose rates of turn differ most, and some others for the bias.
// assumed_mount: of the camera whose attitudes the telemetry has; zeros: the aircraft's own.
std::vector<ImageTurn> measure_image_turns(const Flight& flight, const std::vector<InertialSample>& samples,
                                           const CameraFile& camera, const Attitude& assumed_mount,
                                           const Attitude& mount, std::size_t most_pairs, Progress& progress);

// Nothing for fewer than ten pairs with samples around them, for a delay of half a second or more, and where most pairs
// that turn contradict the samples.
std::optional<GyroDelay> solve_gyro_delay(const std::vector<ImageTurn>& turns,
                                          const std::vector<InertialSample>& samples);

}  // namespace nadir
