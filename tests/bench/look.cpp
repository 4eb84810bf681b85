#include "look.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cpu_time.hpp"
#include "estimation/map_look.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/noise.hpp"

namespace nadir::bench {
namespace {

constexpr double kClear_m = 60;   // distance of a place outside the searched positions, times the ground's unit
constexpr double kLost_m = 800;   // half side of the window of an aircraft that is lost
constexpr int kPlaceTries = 200;  // for a footprint on what the picture shows

// What is drawn of one look before it is matched.
struct Scene {
  const Ground& ground;
  CameraPose truth;  // of recorded frames: only what is known of it
  CameraModel camera;
  cv::Mat grey;
  AnchorPrior prior;  // its position is the window's middle
  const TileSource* map = nullptr;
  double searched_area_m2 = 0;
};

// The picture shows all of the frame's footprint, even where the camera is tilted.
bool shown(const Ground& ground, const CameraPose& pose) {
  const double reach_m = 0.9 * pose.agl_m;
  for (const double east : {-1.0, 0.0, 1.0}) {
    for (const double north : {-1.0, 0.0, 1.0}) {
      const cv::Point at(
          pixel_of({pose.position.east_m + east * reach_m * 0.8, pose.position.north_m + north * reach_m * 0.8},
                   ground.picture.size(), ground.picture_gsd_m));
      if (!cv::Rect({}, ground.picture.size()).contains(at)) return false;
      if (!ground.seen.empty() && ground.seen.at<std::uint8_t>(at) == 0) return false;
    }
  }
  return true;
}

// The lower the smaller the footprint: there is always a place for it.
CameraPose draw_pose(const Ground& ground, Random& random) {
  CameraPose pose;
  const bool gimbal = random.chance(0.4);
  pose.attitude = {random.uniform(-kPi, kPi),
                   gimbal ? random.normal(0, radians(1)) : random.normal(radians(1.5), radians(4)),
                   gimbal ? random.normal(0, radians(1)) : random.normal(0, radians(6))};
  const double width_m = ground.picture.cols * ground.picture_gsd_m,
               height_m = ground.picture.rows * ground.picture_gsd_m;
  double highest_m = ground.largest_agl_m;
  for (int i = 0; i < kPlaceTries; ++i, highest_m = std::max(ground.least_agl_m, 0.98 * highest_m)) {
    pose.agl_m = ground.least_agl_m * std::pow(highest_m / ground.least_agl_m, random.uniform());
    pose.position = {random.uniform(-0.5, 0.5) * width_m, random.uniform(-0.5, 0.5) * height_m};
    if (shown(ground, pose)) return pose;
  }
  throw Error({.what = "no place of the picture holds a frame", .where = ground.name});
}

cv::Mat spoilt(cv::Mat picture, Look& look, Random& random) {
  const double kind = random.uniform();
  look.picture = kind < 0.5 ? "clear" : kind < 0.7 ? "old" : kind < 0.8 ? "clouds" : kind < 0.9 ? "blur" : "night";
  if (look.picture == "clouds") add_clouds(picture, random.uniform(0.2, 0.8), random);
  if (look.picture == "blur") cv::GaussianBlur(picture, picture, cv::Size(), random.uniform(2, 6));
  if (look.picture == "night") make_night(picture, random);
  cv::cvtColor(picture, picture, cv::COLOR_BGR2GRAY);
  return picture;
}

// What the telemetry says: how well heading and tilt are known differs from aircraft to aircraft.
AnchorPrior draw_prior(const Scene& scene, double radius_m, Random& random) {
  const TelemetryUncertainty stated = scene.ground.camera.uncertainty;
  const bool recorded = !scene.ground.frames.empty();
  const double heading_kind = random.uniform(), tilt_kind = random.uniform();
  const bool any_heading = heading_kind > 0.98 && radius_m <= 130 * scene.ground.unit;
  const double heading_sigma_rad = recorded || heading_kind < 0.83 ? stated.heading_rad
                                   : heading_kind < 0.94           ? radians(6)
                                                                   : radians(15);
  const double tilt_sigma_rad = recorded || tilt_kind < 0.65 ? stated.tilt_rad : tilt_kind < 0.87 ? radians(5.5) : 0.35;
  const double agl_sigma = recorded || tilt_kind < 0.9 ? stated.agl_relative : 0.07;
  AnchorPrior prior;
  prior.search.pose = scene.truth;
  Attitude& attitude = prior.search.pose.attitude;
  if (!recorded) {
    prior.search.pose.agl_m *= std::exp(random.normal(0, agl_sigma));
    attitude.heading_rad += any_heading ? random.uniform(-kPi, kPi) : random.normal(0, heading_sigma_rad);
    // A tilt that is not measured is taken for level.
    const bool measured = tilt_sigma_rad == stated.tilt_rad;
    attitude.pitch_rad = measured ? attitude.pitch_rad + random.normal(0, tilt_sigma_rad) : 0;
    attitude.roll_rad = measured ? attitude.roll_rad + random.normal(0, tilt_sigma_rad) : 0;
  }
  prior.search.radius_m = radius_m;
  prior.search.heading_range_rad = any_heading ? kPi : parameters::search_window::kHeadingSigmas * heading_sigma_rad;
  prior.search.scale_range = parameters::search_window::kScaleSigmas * agl_sigma;
  prior.heading_sigma_rad = any_heading ? kPi : heading_sigma_rad;
  prior.log_agl_sigma = agl_sigma;
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * tilt_sigma_rad * tilt_sigma_rad;
  return prior;
}

// The middle of the searched square, from the true place.
PlanePoint window_middle(const Look& look, const Ground& ground, const CameraPose& pose, Random& random) {
  const double r = look.radius_m;
  const PlanePoint truth = pose.position;
  if (look.window != "elsewhere") {
    return {truth.east_m + random.uniform(-0.8, 0.8) * r, truth.north_m + random.uniform(-0.8, 0.8) * r};
  }
  // Towards the middle of the map, where there is most of it. The matcher searches a fifth of the height at least.
  const bool along_east = random.chance(0.5);
  const double away = std::max(r, 0.2 * pose.agl_m) + ground.unit * (kClear_m + random.uniform(0, 100)),
               aside = random.uniform(-0.8, 0.8) * r;
  const auto inward = [](double from, double by) { return from > 0 ? from - by : from + by; };
  return along_east ? PlanePoint{inward(truth.east_m, away), truth.north_m + aside}
                    : PlanePoint{truth.east_m + aside, inward(truth.north_m, away)};
}

// A turned map holds the place for whoever does not know the heading; a window that is nearly the map has no elsewhere.
std::string draw_window(const Ground& ground, const LookPlan& plan, double radius_m, Random& random) {
  const double kind = random.uniform(), rest = (kind - plan.right_share) / (1 - plan.right_share);
  if (kind < plan.right_share) return "right";
  if (rest < 0.4 && radius_m < 0.25 * std::min(ground.width_m, ground.height_m)) return "elsewhere";
  if (rest < 0.6) return "mirrored";
  if (rest < 0.75 || ground.others.empty()) return "turned";
  return "other";
}

double overlap(double low_a, double high_a, double low_b, double high_b) {
  return std::max(0.0, std::min(high_a, high_b) - std::max(low_a, low_b));
}

// Camera positions that are searched and lie over the map.
double searched_area_m2(const Ground& map, const SearchPrior& search) {
  const auto [east, north] = search.pose.position;
  const double r = search.radius_m;
  return overlap(east - r, east + r, -map.width_m / 2, map.width_m / 2) *
         overlap(north - r, north + r, -map.height_m / 2, map.height_m / 2);
}

// Where the middle of the image meets flat ground.
std::optional<PlanePoint> centre_of(const CameraModel& camera, const CameraPose& pose) {
  return ground_from_ray(pose, camera.ray_from_pixel({camera.width / 2.0, camera.height / 2.0}));
}

void judge_candidate(Look& look, const Scene& scene, const SolvedPose& solved) {
  const auto centre = centre_of(scene.camera, solved.pose);
  const Eigen::Matrix2d spread = anchor_model_error_factor(false) * solved.covariance.topLeftCorner<2, 2>();
  look.camera_sigma_m = std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(spread).eigenvalues().maxCoeff());
  if (scene.ground.truth_is_picture_centre) {
    look.off_m = centre ? Eigen::Vector2d(*centre - scene.truth.position) : Eigen::Vector2d(1e4, 0);
    look.error_m = look.camera_error_m = look.off_m.norm();
    return;
  }
  look.off_m = solved.pose.position - scene.truth.position;
  look.camera_error_m = look.off_m.norm();
  const auto true_centre = scene.ground.frames.empty() ? centre_of(scene.camera, scene.truth) : std::nullopt;
  look.error_m = true_centre && centre ? distance_m(*centre, *true_centre) : look.camera_error_m;
}

void judge(Look& look, const Scene& scene, const AnchorMatch& match) {
  look.features.ratio = match.search.ratio;
  if (!match.search.places.empty()) look.features.score = match.search.places.front().score;
  look.patches = match.patches;
  look.fine_gsd_m = match.fine_gsd_m;
  look.coarse_gsd_m = match.coarse_gsd_m;
  if (!match.solved) return;
  judge_candidate(look, scene, *match.solved);
  if (match.search.places.size() < 2) return;
  const PlanePoint rival = match.search.places[1].pose.position;
  look.rival_apart_m = distance_m(rival, match.solved->pose.position);
  look.rival_error_m = distance_m(rival, scene.truth.position);
}

Scene scene_over(const Ground& ground) {
  return {.ground = ground, .truth = {}, .camera = ground.camera.camera, .grey = {}, .prior = {}};
}

// For all pictures: the rays of the pixels and the table of the noise take longer to make than a picture.
struct Studio {
  Photographer photographer{camera_file().camera};
  CameraSensor sensor{{camera_file().camera.width, camera_file().camera.height}, camera_file().camera.fx, 1};
};
const Studio& studio() {
  static const Studio one;
  return one;
}

void use_recorded(Scene& scene, std::size_t number) {
  const RecordedFrame& frame = scene.ground.frames[number];
  scene.grey = read_image_file(frame.file, Colour::grey, 2);
  scene.camera = scene.ground.camera.camera.scaled(0.5);
  scene.camera.width = scene.grey.cols, scene.camera.height = scene.grey.rows;
  scene.truth = {frame.truth, frame.agl_m, {frame.heading_rad, 0, 0}};
}

Exposure draw_exposure(Random& random) {
  return {{random.normal(0, 0.3), random.normal(0, 0.5)}, random.uniform(0.85, 1.25)};
}

// What the camera sees at scene.truth.
cv::Mat picture_at(const Scene& scene, const CameraSensor& sensor, const Exposure& exposure, std::uint64_t number) {
  cv::Mat picture = studio().photographer.photograph(scene.ground.picture, scene.ground.picture_gsd_m,
                                                     *scene.ground.surface, scene.truth);
  sensor.expose(picture, exposure, number);
  return picture;
}

void draw_picture(Scene& scene, Look& look, const CameraSensor& sensor, std::uint64_t number, Random& random) {
  if (!scene.ground.frames.empty()) {
    const auto last = static_cast<int>(scene.ground.frames.size()) - 1;
    look.picture = "clear";
    use_recorded(scene, static_cast<std::size_t>(random.integer(0, last)));
    return;
  }
  scene.truth = draw_pose(scene.ground, random);
  const Exposure exposure = draw_exposure(random);
  scene.grey = spoilt(picture_at(scene, sensor, exposure, number), look, random);
}

// The map in the window, and what is known of the frame.
void draw_search(Scene& scene, Look& look, const Grounds& grounds, Random& random) {
  const Ground& ground = scene.ground;
  const Ground* map = &ground;
  if (look.window == "other") {
    const auto last = static_cast<int>(ground.others.size()) - 1;
    map = &grounds.at(ground.others[static_cast<std::size_t>(random.integer(0, last))]);
  }
  if (look.picture == "old" && ground.old == nullptr) look.picture = "clear";
  scene.map = look.window == "mirrored"                         ? map->mirrored
              : look.window == "turned"                         ? map->turned
              : look.picture == "old" && look.window != "other" ? map->old
                                                                : map->map;
  scene.prior = draw_prior(scene, look.radius_m, random);
  PlanePoint& middle = scene.prior.search.pose.position;
  middle = window_middle(look, ground, scene.truth, random);
  if (look.window == "other") {
    const double r = std::min(look.radius_m, 0.4 * std::min(map->width_m, map->height_m));
    middle = {random.uniform(-1, 1) * (map->width_m / 2 - r), random.uniform(-1, 1) * (map->height_m / 2 - r)};
  }
  if (look.window == "turned") middle = {-middle.north_m, middle.east_m};  // over what was there
  // Nothing is turned for whoever does not know the heading.
  if (look.window == "turned" && scene.prior.search.heading_range_rad > 1)
    look.window = "mirrored", scene.map = map->mirrored;
  scene.searched_area_m2 = searched_area_m2(*map, scene.prior.search);
}

Scene draw_scene(Look& look, const Grounds& grounds, const Ground& ground, std::uint64_t seed, Random& random) {
  Scene scene = scene_over(ground);
  const CameraSensor sensor({scene.camera.width, scene.camera.height}, scene.camera.fx, seed);
  draw_picture(scene, look, sensor, 0, random);
  draw_search(scene, look, grounds, random);
  return scene;
}

const Ground& draw_ground(const Grounds& grounds, const LookPlan& plan, Random& random) {
  const bool real = !grounds.real().empty() && random.chance(plan.real_share);
  const auto& among = real || grounds.painted().empty() ? grounds.real() : grounds.painted();
  return among[static_cast<std::size_t>(random.integer(0, static_cast<int>(among.size()) - 1))];
}

void draw_search_size(Look& look, const Ground& ground, const LookPlan& plan, Random& random) {
  const double size = random.uniform();
  look.radius_m = ground.unit * (size < 0.55 ? 60 : size < 0.85 ? 120 : size < 0.98 ? 250 : kLost_m);
  look.window = draw_window(ground, plan, look.radius_m, random);
}

void begin_look(Look& look, std::uint64_t index, const Ground& ground) {
  look.index = index;
  look.ground = ground.name;
  look.tolerance_m = ground.tolerance_m;
}

void match(Look& look, const Scene& scene, const LookPlan& plan) {
  look.agl_m = scene.truth.agl_m;
  look.names_matcher = !plan.matcher_name.empty();
  const auto matcher = plan.matcher({scene.camera, *scene.map, frame(), *scene.ground.surface});
  const double begin_ms = cpu_ms();
  const AnchorMatch match = matcher->match(scene.grey, scene.prior);
  look.cpu_ms = cpu_ms() - begin_ms;
  if (match.solved) look.features = features_of(match, scene.prior, scene.searched_area_m2);
  judge(look, scene, match);
  look.verdict = !match.on_map ? "no_map" : !match.solved ? "no_pose" : "candidate";
}

}  // namespace

Look take_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed, std::uint64_t index) {
  const std::uint64_t seed = hash_of(base_seed, static_cast<std::int64_t>(index), 1);
  Random random(seed);
  const Ground& ground = draw_ground(grounds, plan, random);
  Look look;
  begin_look(look, index, ground);
  draw_search_size(look, ground, plan, random);
  const Scene scene = draw_scene(look, grounds, ground, seed, random);
  match(look, scene, plan);
  return look;
}

struct LookTaker::Impl {
  const Grounds& grounds;
  LookPlan plan;
  std::uint64_t base_seed;
  std::optional<std::uint64_t> number;  // of the picture below
  Look drawn;
  std::optional<Scene> scene;
};

LookTaker::LookTaker(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed)
    : impl_(std::make_unique<Impl>(Impl{grounds, plan, base_seed, std::nullopt, {}, std::nullopt})) {}
LookTaker::~LookTaker() = default;

Look LookTaker::take(std::uint64_t index) {
  Impl& s = *impl_;
  const std::uint64_t number = picture_of(index);
  if (s.number != number) {
    Random random(hash_of(s.base_seed, static_cast<std::int64_t>(number), 2));
    const Ground& ground = draw_ground(s.grounds, s.plan, random);
    s.drawn = {};
    begin_look(s.drawn, index, ground);
    s.scene.emplace(scene_over(ground));
    draw_picture(*s.scene, s.drawn, studio().sensor, number, random);
    s.number = number;
  }
  Random random(hash_of(s.base_seed, static_cast<std::int64_t>(index), 3));
  Look look = s.drawn;
  look.index = index;
  draw_search_size(look, s.scene->ground, s.plan, random);
  draw_search(*s.scene, look, s.grounds, random);
  match(look, *s.scene, s.plan);
  return look;
}

LooksInARow take_looks_in_a_row(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed,
                                std::uint64_t index) {
  static constexpr std::array kNewGround = {0.1, 0.25, 0.5, 0.75, 1.0, 1.5};
  Random random(hash_of(base_seed, static_cast<std::int64_t>(index), 4));
  const Ground& ground = draw_ground(grounds, plan, random);
  LooksInARow row;
  Look& first = row.first;
  begin_look(first, index, ground);
  draw_search_size(first, ground, plan, random);
  Scene scene = scene_over(ground);
  Eigen::Vector2d step_m;
  CameraPose next;
  std::size_t number = 0;
  Random fault(0);
  if (!ground.frames.empty()) {
    number = static_cast<std::size_t>(random.integer(0, static_cast<int>(ground.frames.size()) - 2));
    first.picture = "clear";
    use_recorded(scene, number);
    step_m = ground.frames[number + 1].truth - ground.frames[number].truth;
    row.new_ground = step_m.norm() / footprint_side_m(scene.camera, scene.truth.agl_m);
  } else {
    row.new_ground = kNewGround[static_cast<std::size_t>(random.integer(0, kNewGround.size() - 1))];
    for (int i = 0;; ++i) {
      if (i == kPlaceTries) throw Error({.what = "no place of the picture holds two frames", .where = ground.name});
      scene.truth = next = draw_pose(ground, random);
      const double way_m = row.new_ground * footprint_side_m(scene.camera, scene.truth.agl_m);
      const double course_rad = random.uniform(-kPi, kPi);
      step_m = {way_m * std::sin(course_rad), way_m * std::cos(course_rad)};
      next.position = scene.truth.position + step_m;
      next.attitude.heading_rad += random.normal(0, radians(1));
      next.attitude.pitch_rad += random.normal(0, radians(1));
      next.attitude.roll_rad += random.normal(0, radians(2));
      if (shown(ground, next)) break;
    }
    const Exposure exposure = draw_exposure(random);
    fault = random.fork("fault");
    Random once = fault;
    scene.grey = spoilt(picture_at(scene, studio().sensor, exposure, index), first, once);
  }
  draw_search(scene, first, grounds, random);
  match(first, scene, plan);

  Look& second = row.second;
  second = first;
  second.features = {};
  second.error_m = second.camera_error_m = -1;
  second.camera_sigma_m = 0;
  if (!ground.frames.empty()) {
    use_recorded(scene, number + 1);
  } else {
    scene.truth = next;
    // Clouds stay where they were in the picture, as dirt on the lens does.
    scene.grey = spoilt(picture_at(scene, studio().sensor, draw_exposure(random), index + 1), second, fault);
  }
  second.picture = first.picture;
  const PlanePoint middle = scene.prior.search.pose.position;
  scene.prior = draw_prior(scene, second.radius_m, random);
  scene.prior.search.pose.position = middle + step_m;
  match(second, scene, plan);
  return row;
}

PlaceOfLook place_of_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed, std::uint64_t index) {
  Random random(hash_of(base_seed, static_cast<std::int64_t>(index), 1));
  PlaceOfLook place{.ground = draw_ground(grounds, plan, random)};
  Look look;
  draw_search_size(look, place.ground, plan, random);
  if (!place.ground.frames.empty()) {
    const auto last = static_cast<int>(place.ground.frames.size()) - 1;
    const RecordedFrame& frame = place.ground.frames[static_cast<std::size_t>(random.integer(0, last))];
    place.middle = frame.truth;
    place.agl_m = frame.agl_m;
  } else {
    const CameraPose pose = draw_pose(place.ground, random);
    place.middle = centre_of(place.ground.camera.camera, pose).value_or(pose.position);
    place.agl_m = pose.agl_m;
  }
  return place;
}

std::string look_header(std::uint64_t base_seed, const LookPlan& plan, const Grounds& grounds,
                        std::uint64_t windows_of_picture) {
  const std::string windows =
      windows_of_picture == 1 ? "" : fmt::format(", {} windows of each picture", windows_of_picture);
  const bool named = !plan.matcher_name.empty();
  return fmt::format(
      "# nadir bench looks, base seed {}, {:g} real, {:g} right{}{}, grounds: "
      "{}\nindex,ground,window,picture,verdict,radius_m,"
      "agl_m,patches,{},error_m,camera_error_m,camera_sigma_m,tolerance_m,fine_gsd_m,coarse_gsd_m,"
      "rival_apart_m,rival_error_m{}\n",
      base_seed, plan.real_share, plan.right_share, windows, named ? ", matcher " + plan.matcher_name : "",
      grounds.names(), fmt::join(LookFeatures::names, ","), named ? ",off_east_m,off_north_m,cpu_ms" : "");
}

std::string line(const Look& l) {
  const std::string place =
      l.names_matcher ? fmt::format(",{:.2f},{:.2f},{:.1f}", l.off_m.x(), l.off_m.y(), l.cpu_ms) : "";
  return fmt::format(
      "{},{},{},{},{},{:.0f},{:.0f},{},{:.5f},{:.2f},{:.2f},{:.2f},{:.0f},{:.3f},{:.3f},{:.1f},{:.1f}{}\n", l.index,
      l.ground, l.window, l.picture, l.verdict, l.radius_m, l.agl_m, l.patches, fmt::join(l.features.values(), ","),
      l.error_m, l.camera_error_m, l.camera_sigma_m, l.tolerance_m, l.fine_gsd_m, l.coarse_gsd_m, l.rival_apart_m,
      l.rival_error_m, place);
}

Look look_of(const std::string& text) {
  std::istringstream in(text);
  Look l;
  char comma = 0;
  in >> l.index >> comma;
  for (std::string* cell : {&l.ground, &l.window, &l.picture, &l.verdict}) std::getline(in, *cell, ',');
  LookFeatures& f = l.features;
  for (double* value : {&l.radius_m, &l.agl_m}) in >> *value >> comma;
  in >> l.patches >> comma;
  for (double* value : {&f.ratio, &f.score, &f.inlier_share, &f.inliers, &f.residual_px, &f.frame_share, &f.shift_px,
                        &f.deviation_sigmas, &f.tilt_sigma_rad, &f.ln_poses, &f.ln_places, &l.error_m,
                        &l.camera_error_m, &l.camera_sigma_m}) {
    in >> *value >> comma;
  }
  in >> l.tolerance_m;
  for (double* value : {&l.fine_gsd_m, &l.coarse_gsd_m, &l.rival_apart_m, &l.rival_error_m}) in >> comma >> *value;
  if (in && !in.eof() && in.peek() == ',') {
    l.names_matcher = true;
    in >> comma >> l.off_m.x() >> comma >> l.off_m.y() >> comma >> l.cpu_ms;
  }
  if (!in) throw Error({.what = "a line of results cannot be read", .found = text});
  return l;
}

LooksFile read_looks(const std::filesystem::path& path) {
  static constexpr std::string_view kFormat = "# nadir bench looks, ", kGrounds = ", grounds: ";
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 30));
  std::string text;
  std::getline(in, text);
  const std::size_t grounds = text.find(kGrounds);
  if (!text.starts_with(kFormat) || grounds == std::string::npos) {
    throw UsageError({.what = "not a file of looks",
                      .where = path.string(),
                      .expected = fmt::format("{}... as --resume keeps them", kFormat),
                      .found = text.substr(0, 80)});
  }
  LooksFile file{
      text.substr(kFormat.size(), grounds - kFormat.size()), text.substr(grounds + kGrounds.size()), false, {}};
  file.shared_pictures = file.run.find("windows of each picture") != std::string::npos;
  std::getline(in, text);  // names of the columns
  while (std::getline(in, text)) {
    const Look look = look_of(text);
    file.looks[look.index] = look;
  }
  return file;
}

}  // namespace nadir::bench
