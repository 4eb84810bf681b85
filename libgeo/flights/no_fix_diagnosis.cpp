#include "flights/no_fix_diagnosis.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "estimation/look_likelihood.hpp"
#include "geodesy/angles.hpp"
#include "vision/camera_frame.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/rectification.hpp"

namespace nadir {
namespace {

double thread_cpu_s() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// Chosen, all of them; what counts as evidence is the localizer's own (localizer_parameters.hpp).
constexpr std::size_t kTriedFrames = 6;  // of kDiagnosedFrames, spread evenly
constexpr std::size_t kProbes = 3;       // a hypothesis without a hit in so many frames is given up
constexpr int kLeastAgreeing = 3;        // frames, for an explanation
constexpr double kStartReach_m = 150;  // half the side of what is searched around the start, which is stated to 100 m …
constexpr double kFastest_mps = 30;    // … and by which windows grow with time
constexpr double kReachFromHit_m = 60;  // around a place that was found …
constexpr double kMaxReach_m = 700;     // … and no window is larger: the time of a search
constexpr double kFeet_m = 0.3048;
constexpr int kLadderRungs = 5;  // from a factor of 1 to that of feet; the ladder goes one further each way
constexpr std::size_t kHeightsWithHeadings = 2;  // the likeliest heights are tried under all headings as well
constexpr double kRungReach = 0.125;             // of the height around a rung: half the way to the next
constexpr double kFoundHeightReach = 0.075;      // around the factor that the first hit found, or under all headings
constexpr double kRangeSigmas = 2.5;  // half widths of the ranges above in σ, as the localizer searches heights
constexpr double kDiagnosedHeadingSigmas = 3;  // likewise
constexpr double kLeastDiagnosedHeading_rad = radians(3);
constexpr double kSameFactor = 0.08;  // two factors that mean the same thing
constexpr double kSameHeading_rad = radians(12);
constexpr double kMagnetic_rad = radians(30);  // declination and mounting errors are smaller, almost everywhere
constexpr double kFarStart_m = 120;            // a match so far from it: the start is wrong

enum class Where { around_start, swapped_start, whole_area };

struct Hypothesis {
  double height_factor = 1;
  double height_offset_m = 0;  // added to the stated height
  bool any_heading = false;
  Where where = Where::around_start;

  bool as_stated() const { return height_factor == 1 && height_offset_m == 0 && !any_heading; }
};

struct TriedFrame {
  cv::Mat grey;
  Telemetry telemetry;
};

struct MapHit {
  const TriedFrame* frame;
  CameraPose pose;
  double evidence;  // nats
  double stated_agl_m;
};

class NoFixExperiment {
 public:
  NoFixExperiment(const StatedFlight& flight, Cancel cancel)
      : flight_(flight),
        surface_(flight.surface != nullptr ? flight.surface : &flat_),
        matcher_(flight.matcher({flight.camera.camera, flight.tiles, flight.frame, *surface_})),
        cancel_(std::move(cancel)) {
    choose_frames();
  }

  std::optional<NoFixDiagnosis> run(const std::function<bool()>& out_of_time);

 private:
  void choose_frames();
  std::vector<Hypothesis> hypotheses() const;
  std::vector<MapHit> hits_of(const Hypothesis& hypothesis);
  std::optional<MapHit> look(const TriedFrame& frame, const Hypothesis& hypothesis, const std::vector<MapHit>& before);
  std::optional<MapHit> look(const TriedFrame& frame, const Hypothesis& hypothesis, const std::vector<MapHit>& before,
                             std::optional<double> heading_rad);
  bool convincing(const std::vector<MapHit>& hits) const;
  bool headings_agree(const std::vector<MapHit>& hits) const;
  std::optional<PlanePoint> start(bool swapped) const;

  NoFixDiagnosis explained(const Hypothesis& hypothesis, const std::vector<MapHit>& hits) const;
  std::string height_in_words(const MapHit& hit) const;
  std::string heading_in_words(const std::vector<MapHit>& hits) const;
  std::string start_in_words(const Hypothesis& hypothesis, const MapHit& hit) const;

  const StatedFlight& flight_;
  FlatGround flat_;
  const GroundSurface* surface_;
  std::unique_ptr<MapMatcher> matcher_;
  Cancel cancel_;
  std::vector<TriedFrame> frames_;
  std::size_t hypotheses_ = 1;
};

double stated_agl_m(const Telemetry& telemetry) {
  return telemetry.agl_m.value_or(parameters::localizer::kAssumedAgl_m);
}

void NoFixExperiment::choose_frames() {
  const std::size_t examined = std::min(kDiagnosedFrames, flight_.telemetry.size());
  const std::size_t every = (examined + kTriedFrames - 1) / kTriedFrames;
  FrozenFrameDetector frozen;
  for (std::size_t begin = 0; begin < examined; begin += every) {
    for (std::size_t i = begin; i < std::min(begin + every, examined); ++i) {
      cancel_.check();
      cv::Mat grey = flight_.read(i);
      if (grey.empty() || !measure_frame_quality(grey).usable || frozen.repeats(grey)) continue;
      const double before_s = frames_.empty() ? 0 : frames_.back().telemetry.time_s;
      frames_.push_back({std::move(grey), plausible_telemetry(flight_.telemetry[i], before_s)});
      break;
    }
  }
}

std::optional<PlanePoint> NoFixExperiment::start(bool swapped) const {
  if (!flight_.start) return std::nullopt;
  const LonLat at = swapped ? LonLat{flight_.start->lat_deg, flight_.start->lon_deg} : *flight_.start;
  if (std::abs(at.lat_deg) > 90) return std::nullopt;
  return flight_.frame.plane_from_lonlat(at);
}

bool inside(const PlaneBox& box, PlanePoint point) {
  return point.east_m >= box.west_m && point.east_m <= box.east_m && point.north_m >= box.south_m &&
         point.north_m <= box.north_m;
}

// The likely first: feet, heights above sea level, twice or half the focal length, headings, the start. Then every
// other height, and at last headings together with the likeliest heights.
std::vector<Hypothesis> NoFixExperiment::hypotheses() const {
  const Where place = flight_.start ? Where::around_start : Where::whole_area;
  const double stated_m = stated_agl_m(frames_.front().telemetry);
  const auto rung = [&](int steps) {
    return Hypothesis{.height_factor = std::pow(kFeet_m, static_cast<double>(steps) / kLadderRungs), .where = place};
  };
  std::vector<Hypothesis> likely_heights;
  if (flight_.ground_msl_m && *flight_.ground_msl_m > kRungReach * stated_m && *flight_.ground_msl_m < stated_m) {
    likely_heights.push_back({.height_offset_m = -*flight_.ground_msl_m, .where = place});
  }
  for (const int steps : {kLadderRungs, -kLadderRungs, 3, -3}) likely_heights.push_back(rung(steps));

  std::vector<Hypothesis> all{{.where = place}};
  all.insert(all.end(), likely_heights.begin(), likely_heights.end());
  const bool headings = std::any_of(frames_.begin(), frames_.end(),
                                    [](const TriedFrame& frame) { return frame.telemetry.heading_rad.has_value(); });
  if (headings) all.push_back({.any_heading = true, .where = place});
  if (flight_.start && flight_.area) {
    if (const auto swapped = start(true); swapped && inside(*flight_.area, *swapped)) {
      all.push_back({.where = Where::swapped_start});
    }
    all.push_back({.where = Where::whole_area});
  }
  for (const int steps : {4, -4, 2, -2, 1, -1, kLadderRungs + 1, -kLadderRungs - 1}) all.push_back(rung(steps));
  // All of an area under all headings and heights takes too long, and so do all heights.
  for (std::size_t i = 0; headings && flight_.start && i < std::min(kHeightsWithHeadings, likely_heights.size()); ++i) {
    likely_heights[i].any_heading = true;
    all.push_back(likely_heights[i]);
  }
  return all;
}

// Found headings differ from the stated ones by a constant, or add up to one with them: another zero, another sense.
bool constant_angle(const std::vector<MapHit>& hits, double sense) {
  const auto constant = [&](const MapHit& hit) {
    return hit.pose.attitude.heading_rad - sense * hit.frame->telemetry.heading_rad.value_or(0);
  };
  return std::all_of(hits.begin(), hits.end(), [&](const MapHit& hit) {
    return std::abs(wrap_pi(constant(hit) - constant(hits.front()))) <= kSameHeading_rad;
  });
}

// One frame under a hypothesis. After a hit under any heading: with the same offset, then with the same sum, which is
// what headings of another sense have.
std::optional<MapHit> NoFixExperiment::look(const TriedFrame& frame, const Hypothesis& hypothesis,
                                            const std::vector<MapHit>& before) {
  const Telemetry& telemetry = frame.telemetry;
  if (!telemetry.heading_rad || !hypothesis.any_heading || before.empty()) {
    const bool known = telemetry.heading_rad && !hypothesis.any_heading;
    return look(frame, hypothesis, before, known ? telemetry.heading_rad : std::nullopt);
  }
  const double found = before.front().pose.attitude.heading_rad;
  const double stated = before.front().frame->telemetry.heading_rad.value_or(0);
  for (const double sense : {1.0, -1.0}) {
    if (!constant_angle(before, sense)) continue;  // an earlier frame has excluded it
    const double heading_rad = wrap_pi(found + sense * (*telemetry.heading_rad - stated));
    if (auto hit = look(frame, hypothesis, before, heading_rad)) return hit;
  }
  return std::nullopt;
}

// heading: nothing where it is to be found.
std::optional<MapHit> NoFixExperiment::look(const TriedFrame& frame, const Hypothesis& hypothesis,
                                            const std::vector<MapHit>& before, std::optional<double> heading_rad) {
  const Telemetry& telemetry = frame.telemetry;
  const TelemetryUncertainty& uncertainty = flight_.camera.uncertainty;
  const double stated_m = stated_agl_m(telemetry);
  AnchorPrior prior;
  prior.cancel = cancel_;
  CameraPose& pose = prior.search.pose;
  pose.agl_m = stated_m * hypothesis.height_factor + hypothesis.height_offset_m;
  prior.search.scale_range = hypothesis.any_heading ? kFoundHeightReach : kRungReach;
  double reach_m = kStartReach_m, since_s = 0;
  if (!before.empty()) {
    const MapHit& hit = before.back();
    // A wrong unit is a factor, a wrong zero a difference; over a few frames both are the same.
    pose.agl_m = before.front().pose.agl_m / before.front().stated_agl_m * stated_m;
    prior.search.scale_range = kFoundHeightReach;
    pose.position = hit.pose.position;
    since_s = telemetry.time_s - hit.frame->telemetry.time_s;
    reach_m = kReachFromHit_m;
  } else if (const auto from = start(hypothesis.where == Where::swapped_start)) {
    pose.position = *from;
    since_s = telemetry.time_s - frames_.front().telemetry.time_s;
  }
  if (!(pose.agl_m >= parameters::plausible::kMinAgl_m)) return std::nullopt;
  prior.log_agl_sigma = prior.search.scale_range / kRangeSigmas;
  prior.search.radius_m = std::min(kMaxReach_m, reach_m + kFastest_mps * std::max(0.0, since_s));
  pose.attitude = {heading_rad.value_or(0), telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)};
  prior.heading_sigma_rad = std::max(kLeastDiagnosedHeading_rad, uncertainty.heading_rad);
  prior.search.heading_range_rad = std::min(kPi, kDiagnosedHeadingSigmas * prior.heading_sigma_rad);
  if (!heading_rad) {
    prior.heading_sigma_rad = prior.search.heading_range_rad = kPi;
  }
  const double tilt_rad = std::max(kDefaultTiltSigma_rad, uncertainty.tilt_rad);
  prior.tilt_covariance_rad2 = tilt_rad * tilt_rad * Eigen::Matrix2d::Identity();

  AnchorMatch match;
  double searched_m2 = 4 * prior.search.radius_m * prior.search.radius_m;
  if (before.empty() && hypothesis.where == Where::whole_area) {
    if (!flight_.area) return std::nullopt;
    searched_m2 = flight_.area->area_m2();
    if (flight_.places != nullptr) {
      match = matcher_->match_among(frame.grey, prior, *flight_.area, {std::nullopt, flight_.places});
    } else {
      match = matcher_->match_anywhere(frame.grey, prior, *flight_.area);
    }
  } else {
    match = matcher_->match(frame.grey, prior);
  }
  if (!match.on_map || !match.solved || match.search.places.empty()) return std::nullopt;
  const double evidence = log_likelihood_ratio(match, prior, searched_m2);
  if (evidence < parameters::belief::kWorthKeeping) return std::nullopt;
  return MapHit{&frame, match.solved->pose, evidence, stated_m};
}

std::vector<MapHit> NoFixExperiment::hits_of(const Hypothesis& hypothesis) {
  std::vector<MapHit> hits;
  std::size_t tried = 0;
  for (const TriedFrame& frame : frames_) {
    if (auto hit = look(frame, hypothesis, hits)) hits.push_back(*hit);
    ++tried;
    if (convincing(hits)) break;
    const bool asked_thoroughly = hypothesis.as_stated() && hypothesis.where == Where::around_start;
    if (hits.empty() && tried >= kProbes && !asked_thoroughly) break;
  }
  return hits;
}

// Without measured headings there is nothing to agree with.
bool NoFixExperiment::headings_agree(const std::vector<MapHit>& hits) const {
  const bool measured = std::all_of(hits.begin(), hits.end(),
                                    [](const MapHit& hit) { return hit.frame->telemetry.heading_rad.has_value(); });
  return !measured || constant_angle(hits, 1) || constant_angle(hits, -1);
}

bool NoFixExperiment::convincing(const std::vector<MapHit>& hits) const {
  if (hits.size() < static_cast<std::size_t>(kLeastAgreeing) || !headings_agree(hits)) return false;
  double sum = 0;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    double new_ground = 1;
    const double footprint_m = footprint_side_m(flight_.camera.camera, hits[i].pose.agl_m);
    for (std::size_t j = 0; j < i; ++j) {
      new_ground = std::min(new_ground, distance_m(hits[i].pose.position, hits[j].pose.position) / footprint_m);
    }
    sum += new_ground * hits[i].evidence;
  }
  return sum - std::log(static_cast<double>(hypotheses_)) >= parameters::belief::kUnambiguous;
}

// ---- In words

bool same_factor(double a, double b) { return std::abs(a / b - 1) <= kSameFactor; }
bool same_angle(double a_rad, double b_rad) { return std::abs(wrap_pi(a_rad - b_rad)) <= kSameHeading_rad; }

std::string joined_or(const std::vector<std::string>& parts) {
  std::string text;
  for (std::size_t i = 0; i < parts.size(); ++i) text += (i == 0 ? "" : ", or ") + parts[i];
  return text;
}

std::string NoFixExperiment::height_in_words(const MapHit& hit) const {
  const double factor = hit.pose.agl_m / hit.stated_agl_m;
  std::vector<std::string> questions;
  if (same_factor(factor, kFeet_m)) questions.emplace_back("are the heights in feet");
  if (same_factor(factor, 1 / kFeet_m)) questions.emplace_back("were heights in metres converted from feet");
  if (flight_.ground_msl_m && same_factor(hit.stated_agl_m - *flight_.ground_msl_m, hit.pose.agl_m)) {
    questions.push_back(fmt::format("are they above sea level (the ground lies at {:.0f} m)", *flight_.ground_msl_m));
  } else if (!flight_.ground_msl_m && factor < 1) {
    questions.emplace_back("are they above sea level");
  }
  if (same_factor(factor, 2)) questions.emplace_back("is the camera file's focal length twice the true one");
  if (same_factor(factor, 0.5)) questions.emplace_back("is the camera file's focal length half the true one");
  if (questions.empty()) {
    questions.push_back(fmt::format("are the heights wrong, or is the focal length {:.2f} × the true one", factor));
  }
  return fmt::format("at {:.2f} × the {} height ({:.0f} m instead of {:.0f} m): {}?", factor,
                     hit.frame->telemetry.agl_m ? "stated" : "assumed", hit.pose.agl_m, hit.stated_agl_m,
                     joined_or(questions));
}

std::string NoFixExperiment::heading_in_words(const std::vector<MapHit>& hits) const {
  const double found = hits.front().pose.attitude.heading_rad;
  const double stated = hits.front().frame->telemetry.heading_rad.value_or(0);
  const double offset = wrap_pi(found - stated);
  std::vector<std::string> questions;
  if (constant_angle(hits, -1)) {
    if (same_angle(found + stated, 0)) questions.emplace_back("are they counted counter-clockwise (negated)");
    if (same_angle(found + stated, kPi / 2)) questions.emplace_back("are they counted counter-clockwise from east");
  }
  if (constant_angle(hits, 1)) {
    if (same_angle(offset, kPi)) questions.emplace_back("does the top of the image point to the tail");
    if (same_angle(offset, kPi / 2)) questions.emplace_back("does the top of the image point to the right wing");
    if (same_angle(offset, -kPi / 2)) questions.emplace_back("does the top of the image point to the left wing");
    if (std::abs(offset) <= kMagnetic_rad) questions.emplace_back("are they magnetic instead of true");
    if (questions.empty()) questions.emplace_back("do they have another zero, or is the camera mounted turned");
  }
  if (questions.empty()) questions.emplace_back("do they have another sense and zero");
  return fmt::format("at headings that differ by {:+.0f}° from the stated ones: {}?", degrees(offset),
                     joined_or(questions));
}

std::string NoFixExperiment::start_in_words(const Hypothesis& hypothesis, const MapHit& hit) const {
  const LonLat place = flight_.frame.lonlat_from_plane(hit.pose.position);
  if (hypothesis.where == Where::swapped_start) {
    return fmt::format("around {:.5f},{:.5f}: are longitude and latitude of the start swapped?", place.lon_deg,
                       place.lat_deg);
  }
  const double off_m = distance_m(hit.pose.position, *start(false));
  const std::string off = off_m < 2000 ? fmt::format("{:.0f} m", off_m) : fmt::format("{:.1f} km", off_m / 1000);
  return fmt::format("around {:.5f},{:.5f}, {} from the start: is the start wrong?", place.lon_deg, place.lat_deg, off);
}

NoFixDiagnosis NoFixExperiment::explained(const Hypothesis& hypothesis, const std::vector<MapHit>& hits) const {
  const MapHit& first = hits.front();
  NoFixDiagnosis result;
  result.frames_tried = static_cast<int>(frames_.size());
  result.frames_matched = static_cast<int>(hits.size());
  result.height_factor = first.pose.agl_m / first.stated_agl_m;
  result.place = flight_.frame.lonlat_from_plane(first.pose.position);
  const bool height = hypothesis.height_factor != 1 || hypothesis.height_offset_m != 0;
  if (hypothesis.any_heading) {
    result.heading_offset_rad =
        wrap_pi(first.pose.attitude.heading_rad - first.frame->telemetry.heading_rad.value_or(0));
  }
  result.text = fmt::format("{} frames match ", hits.size());
  if (height && hypothesis.any_heading) {
    result.cause = NoFixCause::height_and_heading;
    result.text += height_in_words(first) + " And " + heading_in_words(hits);
  } else if (height) {
    result.cause = NoFixCause::height;
    result.text += height_in_words(first);
  } else if (hypothesis.any_heading) {
    result.cause = NoFixCause::heading;
    result.text += heading_in_words(hits);
  } else {
    result.cause = NoFixCause::start;
    result.text += start_in_words(hypothesis, first);
  }
  return result;
}

std::optional<NoFixDiagnosis> NoFixExperiment::run(const std::function<bool()>& out_of_time) {
  if (frames_.size() < static_cast<std::size_t>(kLeastAgreeing)) return std::nullopt;
  const std::vector<Hypothesis> all = hypotheses();
  hypotheses_ = all.size();
  bool matched_as_stated = false, area_searched = false, left_out = false;
  for (const Hypothesis& hypothesis : all) {
    if (out_of_time() && (area_searched || !hypothesis.as_stated())) {
      left_out = true;
      continue;
    }
    const std::vector<MapHit> hits = hits_of(hypothesis);
    const bool whole_area = hypothesis.where == Where::whole_area;
    if (hypothesis.as_stated() && hypothesis.where != Where::swapped_start) {
      matched_as_stated = matched_as_stated || !hits.empty();
      area_searched = area_searched || whole_area;
      if (!flight_.start && !hits.empty()) return std::nullopt;  // the localizer will find it
    }
    if (!convincing(hits)) continue;
    const bool near_start = flight_.start && hypothesis.where != Where::swapped_start && hypothesis.as_stated() &&
                            distance_m(hits.front().pose.position, *start(false)) <= kFarStart_m;
    if (near_start) return std::nullopt;
    return explained(hypothesis, hits);
  }
  if (matched_as_stated || !area_searched) return std::nullopt;
  NoFixDiagnosis nowhere;
  nowhere.frames_tried = static_cast<int>(frames_.size());
  nowhere.text = fmt::format(
      "the first {} frames match nowhere in this package{}: are they of another place, or of ground that the map does "
      "not show (clouds, snow, water, another season)?",
      frames_.size(), left_out ? " with the heights and headings stated (others were not all tried, for time)" : "");
  return nowhere;
}

}  // namespace

bool NoFixWatch::due(AnchorVerdict verdict) {
  constexpr int kFailuresBefore = 3;
  anchored_ = anchored_ || verdict == AnchorVerdict::accepted;
  if (anchored_ || verdict == AnchorVerdict::not_tried || verdict == AnchorVerdict::frame_unfit) return false;
  return ++failed_ == kFailuresBefore;
}

std::string_view name_of(NoFixCause cause) {
  switch (cause) {
    case NoFixCause::height: return "height";
    case NoFixCause::heading: return "heading";
    case NoFixCause::height_and_heading: return "height_and_heading";
    case NoFixCause::start: return "start";
    case NoFixCause::nowhere: return "nowhere";
  }
  return {};
}

std::optional<NoFixDiagnosis> diagnose_no_fix(const StatedFlight& flight, const DiagnosisBudget& budget) {
  const double began_s = thread_cpu_s();
  const auto elapsed_s = [&] { return budget.elapsed_s ? budget.elapsed_s() : thread_cpu_s() - began_s; };
  return NoFixExperiment(flight, budget.cancel).run([&] { return elapsed_s() > budget.seconds; });
}

}  // namespace nadir
