#include "api/object_location.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cmath>

#include "geodesy/hypotenuse.hpp"
#include "vision/ground_ray.hpp"

namespace nadir {
namespace {

constexpr double kChi2Of95 = 5.991;  // two degrees of freedom
// Along the ray. Chosen.
constexpr GroundMarch kMarch{.share = 0.2, .least_m = 1, .most_m = 50, .range_m = kMaxObjectRange_m, .bisections = 40};

// Everything that is not exactly known, so that the same computation serves the answer and its derivatives.
struct Errors {
  double yaw_rad = 0, pitch_rad = 0, roll_rad = 0;  // of the aircraft
  double gimbal_pitch_rad = 0;
  double agl_m = 0;
};

struct Scene {
  const CameraModel& camera;
  const Eigen::Vector2d& pixel;
  const GimbalAngles& gimbal;
  const AircraftPose& pose;
  const LocalFrame& frame;
  const GroundSurface& surface;
};

// Forward-right-down axes of the airframe from those of the camera.
Eigen::Matrix3d body_from_camera(const GimbalAngles& gimbal, double pitch_error_rad) {
  Eigen::Matrix3d gimbal_from_camera;  // optical axis ahead, image-right to the right, image-down down
  gimbal_from_camera << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  return (Eigen::AngleAxisd(gimbal.yaw_rad, Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(gimbal.pitch_rad + pitch_error_rad, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(gimbal.roll_rad, Eigen::Vector3d::UnitX()))
             .toRotationMatrix() *
         gimbal_from_camera;
}

Eigen::Vector3d ray_in_enu(const Scene& scene, const Errors& errors) {
  Attitude attitude = scene.pose.attitude;
  if (scene.gimbal.from_horizon) attitude.pitch_rad = attitude.roll_rad = 0;
  attitude.heading_rad += errors.yaw_rad;
  attitude.pitch_rad += errors.pitch_rad;
  attitude.roll_rad += errors.roll_rad;
  Eigen::Matrix3d down_camera_from_body;  // the camera of enu_from_camera()
  down_camera_from_body << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  const Eigen::Vector3d ray = scene.camera.ray_from_pixel(scene.pixel).normalized();
  return enu_from_camera(attitude) * down_camera_from_body * body_from_camera(scene.gimbal, errors.gimbal_pitch_rad) *
         ray;
}

// The first point of the ray on the ground.
std::optional<Eigen::Vector3d> ground_point(const Scene& scene, const Errors& errors) {
  const PlanePoint below = scene.frame.plane_from_lonlat(scene.pose.place);
  const double ground_m = scene.surface.height_m(below);
  const Eigen::Vector3d eye(below.east_m, below.north_m, ground_m + scene.pose.agl_m + errors.agl_m);
  const Eigen::Vector3d ray = ray_in_enu(scene, errors);
  if (!ray.allFinite()) return std::nullopt;  // a lens that shows nothing at this pixel
  return first_ground_point(eye, ray, scene.surface, kMarch);
}

// What an error of one sigma does to the place on the ground: half the difference of both signs.
std::optional<Eigen::Vector2d> effect(const Scene& scene, double Errors::*which, double sigma) {
  Errors plus, minus;
  plus.*which = sigma;
  minus.*which = -sigma;
  const auto there = ground_point(scene, plus), here = ground_point(scene, minus);
  if (!there || !here) return std::nullopt;
  return 0.5 * (*there - *here).head<2>();
}

bool manoeuvring(const Attitude& attitude) {
  return std::abs(attitude.pitch_rad) >= kManoeuvreTilt_rad || std::abs(attitude.roll_rad) >= kManoeuvreTilt_rad;
}

}  // namespace

std::variant<ObjectPlace, NoObjectPlace> locate_object(const CameraModel& camera, const Eigen::Vector2d& pixel,
                                                       const GimbalAngles& gimbal, const AircraftPose& pose,
                                                       const ObjectUncertainty& uncertainty, const LocalFrame& frame,
                                                       const GroundSurface& surface) {
  const Scene scene{camera, pixel, gimbal, pose, frame, surface};
  const auto point = ground_point(scene, {});
  if (!point) {
    return NoObjectPlace{"no-ground", "the ray through this pixel meets no ground within 20 km: it looks at the sky"};
  }

  ObjectPlace result;
  result.manoeuvring = manoeuvring(pose.attitude);
  const double tilt_rad = uncertainty.tilt_rad + (result.manoeuvring ? kManoeuvreExtraSigma_rad : 0);
  Eigen::Matrix2d covariance = pose.sigma_m * pose.sigma_m * Eigen::Matrix2d::Identity();
  const std::array<std::pair<double Errors::*, double>, 5> sources{
      {{&Errors::yaw_rad, uncertainty.heading_rad},
       {&Errors::pitch_rad, tilt_rad},
       {&Errors::roll_rad, tilt_rad},
       {&Errors::gimbal_pitch_rad, 0.5 * tilt_rad},
       {&Errors::agl_m, uncertainty.agl_relative * pose.agl_m + surface.relief_sigma_m()}}};
  for (const auto& [which, sigma] : sources) {
    const auto moved = effect(scene, which, sigma);
    if (!moved) {
      return NoObjectPlace{"no-bound",
                           "too close to the horizon for the attitude's uncertainty: point the camera lower"};
    }
    covariance += *moved * moved->transpose();
  }
  const PlanePoint below = frame.plane_from_lonlat(pose.place);
  result.place = frame.lonlat_from_plane({point->x(), point->y()});
  result.error_bound_m =
      std::sqrt(kChi2Of95 * Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(covariance).eigenvalues().maxCoeff());
  result.range_m = hypotenuse(point->x() - below.east_m, point->y() - below.north_m, pose.agl_m);
  return result;
}

}  // namespace nadir
