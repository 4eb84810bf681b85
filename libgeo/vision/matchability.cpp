#include "vision/matchability.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "base/random.hpp"
#include "vision/correlation.hpp"
#include "vision/oriented_channels.hpp"

namespace nadir {
namespace {

cv::Mat make_noise(std::uint64_t seed) {
  cv::Mat sum = cv::Mat::zeros(kNoiseSide_px, kNoiseSide_px, CV_32FC1);
  Random random = Random(seed).fork("matchability");
  for (const NoiseLayer& layer : kWornNoise) {
    cv::Mat field(sum.size(), CV_32FC1);
    for (float& value : cv::Mat_<float>(field)) value = static_cast<float>(random.normal());
    if (layer.sigma_px > 0) cv::GaussianBlur(field, field, cv::Size(), layer.sigma_px);
    cv::Scalar mean, sigma;
    cv::meanStdDev(field, mean, sigma);
    sum += (field - mean[0]) * (layer.grey_levels / sigma[0]);
  }
  return sum;
}

struct Pattern {
  cv::Mat image;  // CV_8UC1
  cv::Mat mask;
};

// The middle `side` pixels of the window as the frame of another day.
Pattern worn_pattern(const MapWindow& window, int side, const cv::Mat& noise, double contrast, Random random) {
  const double turn = random.uniform(-kWornTurn_rad, kWornTurn_rad),
               scale = 1 + random.uniform(-kWornScale, kWornScale);
  const double c = std::cos(turn) * scale, s = std::sin(turn) * scale;
  const double half = (side - 1) / 2.0;
  const double x = (window.image.cols - 1) / 2.0 + random.uniform(-kWornShift_px, kWornShift_px);
  const double y = (window.image.rows - 1) / 2.0 + random.uniform(-kWornShift_px, kWornShift_px);
  const cv::Matx23d window_from_pattern(c, -s, x - c * half + s * half, s, c, y - s * half - c * half);
  const cv::Size size(side, side);
  Pattern pattern;
  cv::Mat grey;
  constexpr int kHow = cv::INTER_LINEAR | cv::WARP_INVERSE_MAP;
  cv::warpAffine(window.image, grey, window_from_pattern, size, kHow, cv::BORDER_CONSTANT, cv::Scalar(0));
  cv::warpAffine(window.mask, pattern.mask, window_from_pattern, size, kHow, cv::BORDER_CONSTANT, cv::Scalar(0));
  cv::threshold(pattern.mask, pattern.mask, 254, 255, cv::THRESH_BINARY);
  // Somewhere in the noise, mirrored at its borders where a footprint is larger than it.
  const int at_y = random.integer(0, std::max(0, kNoiseSide_px - side));
  const int at_x = random.integer(0, std::max(0, kNoiseSide_px - side));
  const cv::Point at(at_x, at_y);
  cv::Mat worn(size, CV_8UC1);
  const auto gain = static_cast<float>(contrast);
  const auto middle = static_cast<float>(cv::mean(grey, pattern.mask)[0]);
  for (int row = 0; row < side; ++row) {
    const auto* from = grey.ptr<std::uint8_t>(row);
    const auto* add = noise.ptr<float>((at.y + row) % kNoiseSide_px);
    auto* to = worn.ptr<std::uint8_t>(row);
    for (int column = 0; column < side; ++column) {
      to[column] = cv::saturate_cast<std::uint8_t>(middle + gain * (static_cast<float>(from[column]) - middle) +
                                                   add[(at.x + column) % kNoiseSide_px]);
    }
  }
  pattern.image = worn;
  return pattern;
}

// Entropy of the distribution of edge strength over the orientations.
double entropy_of(const std::vector<cv::Mat>& pairs, const cv::Rect& part, const cv::Mat& mask) {
  std::vector<double> shares;
  double sum = 0;
  for (const cv::Mat& pair : pairs) {
    const cv::Scalar mean = cv::mean(pair(part), mask);
    for (const double share : {mean[0], mean[1]}) {
      shares.push_back(share);
      sum += share;
    }
  }
  if (sum < kMinEdgeStrength) return 0;
  double entropy = 0;
  for (const double share : shares) {
    if (share > 0) entropy -= share / sum * std::log(share / sum);
  }
  return entropy / std::log(static_cast<double>(shares.size()));
}

MatchClass class_of(const PlaceMatchability& place, const MatchabilityLimits& limits) {
  if (place.valid < limits.min_valid || place.score < limits.min_score || place.ratio > limits.weak_ratio) {
    return MatchClass::poor;
  }
  return place.ratio > limits.good_ratio ? MatchClass::weak : MatchClass::good;
}

}  // namespace

const char* name_of(MatchClass cls) {
  constexpr std::array<const char*, 4> kNames{"outside", "good", "weak", "poor"};
  return kNames[static_cast<std::size_t>(cls)];
}

MatchabilityOptions matchability_options(double footprint_m, double gsd_m, double search_m) {
  MatchabilityOptions options;
  options.footprint_m = footprint_m;
  options.gsd_m = gsd_m;
  options.distinct_m = std::max(kDistinct_m, kDistinct_px * gsd_m);  // as in flight (matching_plan.cpp)
  options.radius_m = std::max(search_m, kMinWindowDistinct * options.distinct_m);
  options.limits = {.good_ratio = kGoodRatio,
                    .weak_ratio = kHopelessRatio,
                    .min_score = kLeastScore,
                    .min_valid = kMinValidShare};  // as a placement needs in flight
  return options;
}

double square_footprint_m(const CameraModel& camera, double agl_m) {
  return agl_m * std::sqrt(camera.width / camera.fx * (camera.height / camera.fy));
}

MatchabilityProbe::MatchabilityProbe(const MatchabilityOptions& options)
    : options_(options), noise_(make_noise(options.seed)) {}

double MatchabilityProbe::reach_m() const { return options_.radius_m + options_.footprint_m / 2; }

double MatchabilityProbe::texture_of(const cv::Mat& grey, const cv::Mat& mask) {
  cv::Mat smooth;
  grey.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, cv::Size(), kTextureSigma_px);
  const auto [x, y] = image_gradient(smooth);
  return std::sqrt(cv::mean(x.mul(x) + y.mul(y), mask)[0]);
}

std::vector<PlaceMatchability> MatchabilityProbe::probe(const MapWindow& window,
                                                        std::span<const std::uint64_t> numbers) const {
  const int side = static_cast<int>(std::lround(options_.footprint_m / window.gsd_m));
  const cv::Point corner((window.image.cols - side) / 2, (window.image.rows - side) / 2);
  CV_Assert(side >= 8 && corner.x > 0 && corner.y > 0);
  const cv::Rect footprint(corner, cv::Size(side, side));
  const cv::Mat shown = window.mask(footprint);

  PlaceMatchability place;
  place.cls = MatchClass::poor;
  place.valid = static_cast<double>(cv::countNonZero(shown)) / static_cast<double>(shown.total());
  std::vector<PlaceMatchability> places(numbers.size(), place);
  if (place.valid < options_.limits.min_valid) return places;
  const Channels map = oriented_channels(window.image, window.mask, ChannelSet::six_orientations);
  place.entropy = entropy_of(map.pairs, footprint, shown);
  place.texture = texture_of(window.image(footprint), shown);

  const double contrast = std::min(1.0, kNoiseTexture / std::max(kMinTypicalTexture, options_.typical_texture));
  std::vector<Channels> worn;
  for (const std::uint64_t number : numbers) {
    const Pattern pattern = worn_pattern(window, side, noise_, contrast, Random(options_.seed).fork("place", number));
    worn.push_back(oriented_channels(pattern.image, pattern.mask, ChannelSet::six_orientations));
  }
  // Here: within the distance below which two places are one. Elsewhere: the rest.
  cv::Mat here(window.image.size() - cv::Size(side - 1, side - 1), CV_8UC1, cv::Scalar(0));
  cv::circle(here, corner, static_cast<int>(std::lround(options_.distinct_m / window.gsd_m)), cv::Scalar(255),
             cv::FILLED);
  const WindowSpectra spectra(map);
  std::optional<TemplateNorm> norm;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (i == 0 || cv::norm(worn[i].mask, worn[i - 1].mask, cv::NORM_INF) != 0) {
      norm.emplace(worn[i], spectra, options_.limits.min_valid);
    }
    const cv::Mat scores = correlate(worn[i], spectra, *norm);
    double best_here = 0, best_elsewhere = 0;
    cv::minMaxLoc(scores, nullptr, &best_here, nullptr, nullptr, here);
    cv::minMaxLoc(scores, nullptr, &best_elsewhere, nullptr, nullptr, here == 0);
    place.score = std::max(0.0, best_here);
    place.ratio =
        best_here > 0 ? std::clamp(best_elsewhere / best_here, 0.0, kMaxMatchabilityRatio) : kMaxMatchabilityRatio;
    place.cls = class_of(place, options_.limits);
    places[i] = place;
  }
  return places;
}

PlaceMatchability MatchabilityProbe::probe(const MapWindow& window, std::uint64_t number) const {
  return probe(window, std::span(&number, 1)).front();
}

}  // namespace nadir
