// Does the matchability of the ground say how often a look finds its place? Looks in their place with clear pictures,
// and the survey's own probe of the ground in the picture, for a flight at that height.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "look.hpp"
#include "vision/matchability.hpp"

namespace nadir::bench {

struct ProbedLook {
  std::uint64_t index = 0;
  std::string ground;
  double agl_m = 0;
  bool found = false;  // the candidate is the place
  PlaceMatchability place;
};
using ProbedLooks = std::map<std::uint64_t, ProbedLook>;

// Clear, and in its place: P_D is about those of them whose place the map shows.
bool shows_detection(const Look& look);

std::string probed_csv(const ProbedLooks& looks);

// Keeps what it has read of the grounds. Not for several threads.
class GroundProbe {
 public:
  GroundProbe();
  ~GroundProbe();
  ProbedLook probe(const Look& look, const PlaceOfLook& place);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Factors on the odds of P_D, by class.
struct DetectionOdds {
  double good = 1, weak = 1, poor = 1;
};
// The likeliest ones, beside what a flight learns without them.
DetectionOdds fitted_odds(const ProbedLooks& looks);

// What the factors add to the mean that a flight over each ground learns (estimation/belief.hpp): log-likelihood of
// found or not, per look. Looks over one ground are not independent of each other: the error is that of grounds.
struct DetectionGain {
  double nats = 0, sigma_nats = 0;
};
DetectionGain gain_of(const ProbedLooks& looks, const DetectionOdds& odds);

// How often each class finds its place, and that gain by ground.
std::string detection_tables(const ProbedLooks& looks, const DetectionOdds& odds);

}  // namespace nadir::bench
