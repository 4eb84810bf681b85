#include "estimation/search_window.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "estimation/look_likelihood.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

using namespace parameters::search_window;

void SearchWindow::record_attempt(AnchorVerdict verdict) {
  if (verdict == AnchorVerdict::accepted) {
    anchored_ = true;
    failures_ = 0;
    parts_ = 0;
  } else if (verdict != AnchorVerdict::no_map) {
    ++failures_;
  }
}

double SearchWindow::radius_m(double position_sigma_m) const {
  const double least_m = min_radius_m_ * (1 + std::min(failures_ / kFailuresPerRing, kMaxRings));
  const double reach_m = (anchored_ ? kReachSigmas : kStartReachSigmas) * position_sigma_m;
  return std::clamp(reach_m, least_m, std::max(least_m, max_radius_m_));
}

bool SearchWindow::lost(bool placed, double position_sigma_m) const {
  return !placed || (area_ && kReachSigmas * position_sigma_m > max_radius_m_);
}

PlaneBox SearchWindow::next_part(const PlaneBox& area, PlanePoint position) {
  const auto count = [](double side_m) { return std::max(1, static_cast<int>(std::ceil(side_m / kPart_m))); };
  const double east_m = area.east_m - area.west_m, north_m = area.north_m - area.south_m;
  const int columns = count(east_m), rows = count(north_m);
  std::vector<std::pair<double, PlaneBox>> parts;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const PlaneBox part{area.west_m + column * east_m / columns, area.south_m + row * north_m / rows,
                          area.west_m + (column + 1) * east_m / columns, area.south_m + (row + 1) * north_m / rows};
      parts.emplace_back((part.middle() - position).norm(), part);
    }
  }
  std::stable_sort(parts.begin(), parts.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return parts[parts_++ % parts.size()].second;
}

PlaneBox SearchWindow::reachable_area(bool placed, PlanePoint position, double position_sigma_m) const {
  if (!placed) return *area_;
  const double reach_m = kReachSigmas * position_sigma_m;
  const PlaneBox both{
      std::max(area_->west_m, position.east_m - reach_m), std::max(area_->south_m, position.north_m - reach_m),
      std::min(area_->east_m, position.east_m + reach_m), std::min(area_->north_m, position.north_m + reach_m)};
  return both.west_m < both.east_m && both.south_m < both.north_m ? both : *area_;
}

void OperatorHint::start_propagation(PlanePoint position, double sigma_m) {
  from_ = position;
  from_sigma_m_ = sigma_m;
}

std::optional<PlaneBox> OperatorHint::box(PlanePoint position, double sigma_m,
                                          const std::optional<PlaneBox>& area) const {
  const PlanePoint at = from_ ? PlanePoint(at_.vector() + position.vector() - from_->vector()) : at_;
  const double grown = from_ ? std::max(0.0, sigma_m * sigma_m - from_sigma_m_ * from_sigma_m_) : 0.0;
  const double reach_m = std::max(kMinHintReach_m, radius_m_) + kReachSigmas * std::sqrt(grown);
  PlaneBox box{at.east_m - reach_m, at.north_m - reach_m, at.east_m + reach_m, at.north_m + reach_m};
  if (!area) return box;
  box = {std::max(box.west_m, area->west_m), std::max(box.south_m, area->south_m), std::min(box.east_m, area->east_m),
         std::min(box.north_m, area->north_m)};
  if (box.west_m >= box.east_m || box.south_m >= box.north_m) return std::nullopt;
  return box;
}

AnchorMatch match_lost(MapMatcher& matcher, const PlaceRetrieval* places, const cv::Mat& grey, const AnchorPrior& prior,
                       const LostSearch& where) {
  const auto plausible = [&](const AnchorMatch& match) {
    return match.solved &&
           log_likelihood_ratio(match, prior, where.area.area_m2()) >= parameters::belief::kWorthKeeping;
  };
  const auto among = [&](const SearchSuggestions& suggested) {
    return matcher.match_among(grey, prior, where.area, suggested);
  };
  if (where.hint || places != nullptr) {
    AnchorMatch match = among({where.hint, places});
    if (plausible(match)) return match;
  }
  // The place index is right for most frames: for the others it suffices to search a part at a time.
  if (places != nullptr) return among({where.part, nullptr});
  return matcher.match_anywhere(grey, prior, where.area);
}

}  // namespace nadir
