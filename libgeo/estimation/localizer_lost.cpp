// Without a prediction: who may say where to look, and what is looked at when nobody knows.
#include <cmath>

#include "base/error.hpp"
#include "estimation/localizer_state.hpp"

namespace nadir {

void Localizer::hint(const LonLat& at, double radius_m) {
  const bool place = std::abs(at.lon_deg) <= 180 && std::abs(at.lat_deg) <= 90;  // NaN is none either
  if (!place || !(radius_m > 0) || !std::isfinite(radius_m)) {
    throw UsageError({.what = "the hint is no place",
                      .expected = "longitude, latitude and a radius above 0 m",
                      .found = std::to_string(at.lon_deg) + "," + std::to_string(at.lat_deg) + " within " +
                               std::to_string(radius_m) + " m"});
  }
  const Enu there = state_->frame.enu_from_lonlat(at);
  state_->hinted.emplace(Eigen::Vector2d(there.east_m, there.north_m), radius_m);
}

// A start that was told once is worth no more than a hint that is told now.
void Localizer::State::heed_hint() {
  if (!hinted || hinted->carried()) return;
  against_start.forget();
  const double off_m = (hinted->at_m() - flight->position_m()).norm();
  const bool confirmed = unbroken && last_anchor_s;
  if (placed && !confirmed && off_m > hinted->radius_m() + 3 * flight->position_sigma_m()) {
    log.back().hint_doubt_m = off_m;
    flight->doubt_position(off_m);
  }
  hinted->carried_from(flight->position_m(), flight->position_sigma_m());
}

Localizer::State::LostSearch Localizer::State::lost_search() {
  const Eigen::Vector2d position = flight->position_m();
  const double sigma_m = flight->position_sigma_m();
  LostSearch where{window.area_left(placed, position, sigma_m), std::nullopt, {}};
  if (hinted) where.hint = hinted->box(position, sigma_m, config.area);
  where.part = window.next_part(where.area, position);
  return where;
}

AnchorMatch Localizer::State::match_lost(const cv::Mat& grey, const AnchorPrior& prior, const LostSearch& where) {
  const auto fits = [&](const AnchorMatch& match) {
    const AnchorVerdict verdict = judge_anchor(match, prior, {0, 0, false, true}, config.gates);
    return verdict == AnchorVerdict::accepted || verdict == AnchorVerdict::awaiting_votes;
  };
  const auto among = [&](const SearchSuggestions& suggested) {
    return matcher->match_among(grey, prior, where.area, suggested);
  };
  if (where.hint || config.places != nullptr) {
    AnchorMatch match = among({where.hint, config.places});
    if (fits(match)) return match;
  }
  // What remembers places is right for most frames: for the others it is enough to search a part at a time.
  if (config.places != nullptr) return among({where.part, nullptr});
  return matcher->match_anywhere(grey, prior, where.area);
}

}  // namespace nadir
