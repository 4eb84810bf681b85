#include "look_detection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <set>
#include <utility>
#include <vector>

#include "geodesy/web_mercator.hpp"
#include "imagery/map_window.hpp"
#include "look_rates.hpp"
#include "vision/matching_plan.hpp"

namespace nadir::bench {
namespace {

constexpr double kHeightStep = 1.25;  // maps are made for heights so far apart, and each look uses the nearest
constexpr double kSearch_m = 100;     // the survey's default, times the ground's unit
constexpr std::size_t kCachedTiles = 256;
constexpr int kTextureSamples = 14;  // a side

constexpr std::array<MatchClass, 3> kClasses{MatchClass::good, MatchClass::weak, MatchClass::poor};

std::string family_of(const ProbedLook& probed) {
  Look look;
  look.ground = probed.ground;
  return family(look);
}

double logit(double p) { return std::log(p / (1 - p)); }
double logistic(double x) { return 1 / (1 + std::exp(-x)); }

double odds_of(const DetectionOdds& odds, MatchClass cls) {
  return cls == MatchClass::good ? odds.good : cls == MatchClass::weak ? odds.weak : odds.poor;
}

// The looks over each ground as one flight, which learns as PlaceBelief does: what it expects of each look.
struct Expected {
  const ProbedLook* look;
  double detection;
};
std::vector<Expected> expected_by_flights(const ProbedLooks& looks) {
  struct Learned {
    double hits = parameters::belief::kDetectionHits, looks = parameters::belief::kDetectionLooks;
  };
  std::map<std::string, Learned> flights;
  std::vector<Expected> all;
  for (const auto& [index, look] : looks) {
    Learned& flight = flights[look.ground];
    all.push_back({&look, flight.hits / flight.looks});
    flight.hits += look.found ? 1 : 0;
    flight.looks += 1;
  }
  return all;
}

double likeliest_odds(const std::vector<Expected>& looks) {
  double low = -5, high = 5;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    double surprise = 0;
    for (const auto& [look, detection] : looks) surprise += look->found - logistic(logit(detection) + middle);
    (surprise > 0 ? low : high) = middle;
  }
  return std::exp((low + high) / 2);
}

std::string class_table(const ProbedLooks& looks) {
  std::string text = "| ground | looks | found, % |" +
                     std::string(" good: found, % (95 %) | weak | poor |\n|---|---|---|---|---|---|\n");
  const auto row = [&](const std::string& name, const std::function<bool(const ProbedLook&)>& filter) {
    CountedShare all;
    std::map<MatchClass, CountedShare> by_class;
    for (const auto& [index, look] : looks) {
      if (!filter(look)) continue;
      for (CountedShare* share : {&all, &by_class[look.place.cls]}) ++share->of, share->count += look.found ? 1 : 0;
    }
    text += fmt::format("| {} | {} | {:.1f} |", name, all.of, 100 * all.share());
    for (const MatchClass cls : kClasses) {
      const CountedShare share = by_class[cls];
      text += share.of == 0 ? std::string(" - |")
                            : fmt::format(" {:.1f} ({:.0f} to {:.0f}; {} of {}) |", 100 * share.share(),
                                          100 * share.lower(), 100 * share.upper(), share.count, share.of);
    }
    text += "\n";
  };
  row("**all**", [](const ProbedLook&) { return true; });
  std::set<std::string> families;
  for (const auto& [index, look] : looks) families.insert(family_of(look));
  for (const std::string& name : families) {
    row(name, [&](const ProbedLook& look) { return family_of(look) == name; });
  }
  return text;
}

struct Sum {
  int looks = 0;
  double without = 0, with = 0;
};
std::map<std::string, Sum> by_ground(const ProbedLooks& looks, const DetectionOdds& odds) {
  std::map<std::string, Sum> grounds;
  for (const auto& [look, detection] : expected_by_flights(looks)) {
    Sum& sum = grounds[look->ground];
    const double adjusted = logistic(logit(detection) + std::log(odds_of(odds, look->place.cls)));
    ++sum.looks;
    sum.without += std::log(look->found ? detection : 1 - detection);
    sum.with += std::log(look->found ? adjusted : 1 - adjusted);
  }
  return grounds;
}

std::string gain_table(const ProbedLooks& looks, const DetectionOdds& odds) {
  std::string text = fmt::format(
      "odds factors: good {:.2f}, weak {:.2f}, poor {:.2f}\n\n| flight over | looks | the flight's own mean, nats a "
      "look | with the factors | gain |\n|---|---|---|---|---|\n",
      odds.good, odds.weak, odds.poor);
  Sum all;
  for (const auto& [name, sum] : by_ground(looks, odds)) {
    text += fmt::format("| {} | {} | {:.4f} | {:.4f} | {:+.4f} |\n", name, sum.looks, sum.without / sum.looks,
                        sum.with / sum.looks, (sum.with - sum.without) / sum.looks);
    all.looks += sum.looks, all.without += sum.without, all.with += sum.with;
  }
  const DetectionGain gain = gain_of(looks, odds);
  return text + fmt::format("| **all** | {} | {:.4f} | {:.4f} | {:+.4f} (± {:.4f}, two standard errors) |\n", all.looks,
                            all.without / all.looks, all.with / all.looks, gain.nats, 2 * gain.sigma_nats);
}

}  // namespace

bool shows_detection(const Look& look) { return look.window == "right" && look.picture == "clear"; }

std::string probed_csv(const ProbedLooks& looks) {
  std::string text = "index,ground,agl_m,found,class,ratio,score,entropy,texture,valid\n";
  for (const auto& [index, l] : looks) {
    text += fmt::format("{},{},{:.0f},{},{},{:.4f},{:.4f},{:.4f},{:.3f},{:.3f}\n", l.index, l.ground, l.agl_m,
                        l.found ? 1 : 0, name_of(l.place.cls), l.place.ratio, l.place.score, l.place.entropy,
                        l.place.texture, l.place.valid);
  }
  return text;
}

struct GroundProbe::Impl {
  struct Survey {
    MapWindowReader reader;
    MatchabilityProbe probe;
  };
  std::map<std::pair<const Ground*, int>, Survey> surveys;

  static Survey begin(const Ground& ground, double agl_m);
};

GroundProbe::GroundProbe() : impl_(std::make_unique<Impl>()) {}
GroundProbe::~GroundProbe() = default;

GroundProbe::Impl::Survey GroundProbe::Impl::begin(const Ground& ground, double agl_m) {
  MapWindowReader reader(*ground.map, kCachedTiles);
  const CameraModel& camera = ground.camera.camera;
  const double map_gsd_m = ground_resolution_m(ground.map->zooms().max, frame().origin().lat_deg);
  MatchabilityOptions options =
      matchability_options(square_footprint_m(camera, agl_m), matching_scale(camera, agl_m, map_gsd_m).coarse_gsd_m,
                           kSearch_m * ground.unit);
  std::vector<double> textures;
  for (int i = 0; i < kTextureSamples * kTextureSamples; ++i) {
    const PlanePoint at{((i % kTextureSamples + 0.5) / kTextureSamples - 0.5) * ground.width_m,
                        ((i / kTextureSamples + 0.5) / kTextureSamples - 0.5) * ground.height_m};
    const MapWindow window =
        reader.read(frame(), square_around(at, options.footprint_m / 2), options.gsd_m, Colour::grey);
    textures.push_back(MatchabilityProbe::texture_of(window.image, window.mask));
  }
  const auto median = textures.begin() + static_cast<std::ptrdiff_t>(textures.size() / 2);
  std::nth_element(textures.begin(), median, textures.end());
  options.typical_texture = *median;
  return {std::move(reader), MatchabilityProbe(options)};
}

ProbedLook GroundProbe::probe(const Look& look, const PlaceOfLook& place) {
  const auto height = static_cast<int>(std::lround(std::log(place.agl_m) / std::log(kHeightStep)));
  auto survey = impl_->surveys.find({&place.ground, height});
  if (survey == impl_->surveys.end()) {
    survey = impl_->surveys
                 .emplace(std::pair(&place.ground, height), Impl::begin(place.ground, std::pow(kHeightStep, height)))
                 .first;
  }
  auto& [reader, probe] = survey->second;
  const MapWindow window =
      reader.read(frame(), square_around(place.middle, probe.reach_m()), probe.options().gsd_m, Colour::grey);
  return {look.index, look.ground, place.agl_m, look.right(), probe.probe(window, look.index)};
}

DetectionOdds fitted_odds(const ProbedLooks& looks) {
  std::map<MatchClass, std::vector<Expected>> by_class;
  for (const Expected& expected : expected_by_flights(looks)) by_class[expected.look->place.cls].push_back(expected);
  const auto factor = [&](MatchClass cls) { return by_class[cls].empty() ? 1.0 : likeliest_odds(by_class[cls]); };
  return {factor(MatchClass::good), factor(MatchClass::weak), factor(MatchClass::poor)};
}

DetectionGain gain_of(const ProbedLooks& looks, const DetectionOdds& odds) {
  const auto grounds = by_ground(looks, odds);
  const auto count = static_cast<double>(looks.size());
  DetectionGain gain;
  for (const auto& [name, sum] : grounds) gain.nats += (sum.with - sum.without) / count;
  double variance = 0;
  for (const auto& [name, sum] : grounds) {
    const double off = sum.with - sum.without - gain.nats * sum.looks;
    variance += off * off;
  }
  gain.sigma_nats = std::sqrt(variance) / count;
  return gain;
}

std::string detection_tables(const ProbedLooks& looks, const DetectionOdds& odds) {
  if (looks.empty()) return "no clear look in its place\n";
  return class_table(looks) + "\n" + gain_table(looks, odds);
}

}  // namespace nadir::bench
