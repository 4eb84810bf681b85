#include "simulation/live_camera.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {
namespace {

constexpr double kMaxPixels = 2.5e8;  // of the world in memory; with its pyramid 1.3 GB
constexpr double kFar_m = 20'000;
const cv::Scalar kGrey(96, 104, 100);

// The finest ground sample distance at which all of the world fits into memory.
double gsd_that_fits(const WorldExtent& extent) {
  double shrink = 1;
  while (static_cast<double>(extent.size.width) * extent.size.height / (shrink * shrink) > kMaxPixels) shrink *= 2;
  return shrink == 1 ? 0 : extent.gsd_m * shrink * 1.01;  // a hair more: distances are measured twice
}

double ground_height_m(const LiveCameraOptions& options, const WorldExtent& extent) {
  return options.dem ? GroundShape::height_at(*options.dem, extent.centre) : options.ground_m;
}

bool finite(const LivePose& pose) {
  return std::isfinite(pose.place.lon_deg) && std::abs(pose.place.lat_deg) <= 90 && std::isfinite(pose.height_m) &&
         std::isfinite(pose.attitude.heading_rad) && std::isfinite(pose.attitude.pitch_rad) &&
         std::isfinite(pose.attitude.roll_rad) && pose.velocity_enu_mps.allFinite();
}

}  // namespace

LiveCamera::LiveCamera(const LiveCameraOptions& options) : LiveCamera(options, extent_of_world(options.world)) {}

LiveCamera::LiveCamera(const LiveCameraOptions& options, const WorldExtent& extent)
    : camera_(read_camera_file(options.camera).camera),
      noise_(options.noise),
      box_(extent.box),
      frame_(extent.centre, ground_height_m(options, extent)),
      world_(options.world, frame_, box_, gsd_that_fits(extent)),
      ground_(options.dem ? GroundShape(*options.dem, frame_, box_) : GroundShape()),
      renderer_(camera_, world_, ground_),
      sensor_({camera_.width, camera_.height}, camera_.fx, options.seed),
      exposure_(camera_, options.seed) {}

RenderedFrame LiveCamera::shoot(const LivePose& pose, std::uint64_t number) const {
  RenderedFrame nothing{cv::Mat(camera_.height, camera_.width, CV_8UC3, kGrey), 0};
  if (!finite(pose)) return nothing;
  const Enu at = frame_.enu_from_geodetic({pose.place, pose.height_m});
  const double ground = ground_.up_m(at.east_m, at.north_m);
  FlightPose flight;
  flight.time_s = static_cast<double>(pose.unix_us) * 1e-6;
  flight.agl_m = std::max(1.0, at.up_m - ground);
  flight.position = {at.east_m, at.north_m, ground + flight.agl_m};
  flight.attitude = pose.attitude;
  flight.velocity = pose.velocity_enu_mps.head<2>();
  const bool far = flight.agl_m > kFar_m || at.east_m < box_.west_m - kFar_m || at.east_m > box_.east_m + kFar_m ||
                   at.north_m < box_.south_m - kFar_m || at.north_m > box_.north_m + kFar_m;
  RenderedFrame shot = far ? nothing : renderer_.render(flight.position, flight.attitude);
  if (noise_ == SensorNoise::real) sensor_.expose(shot.image, exposure_.of(flight, number), number);
  return shot;
}

}  // namespace nadir
