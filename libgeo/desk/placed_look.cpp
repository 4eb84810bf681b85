#include "desk/placed_look.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "estimation/map_look.hpp"
#include "estimation/search_window.hpp"
#include "flights/picture_at_one_moment.hpp"
#include "imagery/codecs.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

constexpr std::size_t kKeptLooks = 8;  // chosen
constexpr int kLookQuality = 80;       // of JPEG; as the looks in flight

bool same(const CameraPose& one, const CameraPose& other) {
  return one.position == other.position && one.agl_m == other.agl_m &&
         one.attitude.heading_rad == other.attitude.heading_rad && one.attitude.pitch_rad == other.attitude.pitch_rad &&
         one.attitude.roll_rad == other.attitude.roll_rad;
}

LookContext context_of(const FrameView& view, const CameraModel& camera, bool tilt_measured) {
  using namespace parameters;
  const CameraPose& pose = view.camera.pose;
  LookContext context;
  AnchorPrior& prior = context.prior;
  prior.search.pose = pose;
  prior.heading_sigma_rad = std::max(anchor_measurement::kTiltModelError_rad, view.heading_sigma_rad);
  prior.search.heading_range_rad = std::min(kPi, search_window::kHeadingSigmas * prior.heading_sigma_rad);
  prior.log_agl_sigma = std::max(anchor_measurement::kMinHeightSigma, view.agl_sigma_m / std::max(1.0, pose.agl_m));
  prior.search.scale_range = search_window::kScaleSigmas * prior.log_agl_sigma;
  const double tilt_rad = tilt_measured ? view.tilt_sigma_rad : flight_filter::kMissingTilt_rad;
  prior.tilt_covariance_rad2 =
      (tilt_rad * tilt_rad + anchor_measurement::kMinTiltVariance_rad2) * Eigen::Matrix2d::Identity();
  context.track = {pose.position, view.camera.covariance.topLeftCorner<2, 2>()};
  const double sigma_m = std::sqrt(context.track.covariance_m2.trace() / 2);
  const SearchWindow window(search_window::kMinRadius_m, search_window::kMaxRadius_m, std::nullopt);
  prior.search.radius_m = window.radius_m(sigma_m);
  context.window = square_around(pose.position, prior.search.radius_m);
  context.agl_m = pose.agl_m;
  context.footprint_m = footprint_side_m(camera, pose.agl_m);
  context.tilt_missing = !tilt_measured;
  return context;
}

PlacedLook look_at(const FlightStore& store, const FlightGround& ground, const DeskPackage& package,
                   const FrameView& view, std::size_t frame) {
  const SessionRecord& session = store.description().session;
  const CameraModel camera = view.lens.scaled(1.0 / session.picture_shrink);
  const Telemetry telemetry = store.picture(frame).telemetry;
  const LookContext context = context_of(view, camera, view.adjusted || (telemetry.pitch_rad && telemetry.roll_rad));
  PlacedLook look;
  CameraFile reduced = session.camera;
  reduced.camera = camera;
  const cv::Mat image = picture_at_one_moment(store, frame, reduced, session.picture_shrink);
  if (image.empty()) {
    look.report.verdict = AnchorVerdict::frame_unfit;
    return look;
  }
  const auto tiles = package.package->another_imagery_reader();
  const auto matcher = session.localizer.matcher({camera, *tiles, ground.plane(), ground.surface()});
  const AnchorMatch match = matcher->match(image, context.prior);
  const Look found = look_of(match, context);
  LookResult result;
  if (found.candidate) {
    const Eigen::Vector2d off_m = found.candidate->position - context.track.position;
    const Eigen::Matrix2d spread_m2 = context.track.covariance_m2 + found.candidate->covariance_m2;
    result.chi2 = off_m.dot(spread_m2.inverse() * off_m);
    result.accepted = found.candidate->log_likelihood_ratio > 0 && result.chi2 <= parameters::belief::kChi2_999;
  }
  result.place_doubt = std::numeric_limits<double>::quiet_NaN();  // of the segment, not of one of its looks
  look.report = anchor_report(match, context, found, result);
  const auto jpeg = [](cv::Mat& taken) {
    const cv::Mat shown = std::exchange(taken, {});
    return shown.empty() ? Bytes() : encode_image(shown, ImageFormat::jpeg, kLookQuality);
  };
  look.seen = jpeg(look.report.rectified);
  look.map = jpeg(look.report.matched_map);
  return look;
}

}  // namespace

std::shared_ptr<const PlacedLook> PlacedLooks::of(const std::string& flight, const FlightStore& store,
                                                  const FlightGround& ground, std::size_t frame) {
  if (ground.package() == nullptr || !store.placed_estimate(frame)) return nullptr;
  const FrameView view = view_of(store, ground, frame);
  if (!view.placed) return nullptr;
  const std::lock_guard lock(mutex_);
  const auto known = std::find_if(kept_.begin(), kept_.end(), [&](const Kept& each) {
    return each.flight == flight && each.frame == frame && same(each.pose, view.camera.pose);
  });
  if (known != kept_.end()) return known->look;
  auto look = std::make_shared<const PlacedLook>(look_at(store, ground, *ground.package(), view, frame));
  kept_.push_back({flight, frame, view.camera.pose, look});
  if (kept_.size() > kKeptLooks) kept_.pop_front();
  return look;
}

}  // namespace nadir
