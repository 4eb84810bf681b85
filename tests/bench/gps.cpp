// How soon the service finds out that the aircraft's GPS lies, and how often it accuses an honest one.
// docs/closed-loop.md.
#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iostream>
#include <limits>
#include <opencv2/core/utility.hpp>
#include <utility>

#include "base/platform.hpp"
#include "base/quantile.hpp"
#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "gps_ratio.hpp"
#include "gps_tracks.hpp"
#include "seeded_runs.hpp"
#include "service/gps_health.hpp"
#include "simulation/noise.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

using Eigen::Vector2d;

constexpr double kFixPeriod_s = 0.2;
constexpr double kVisionDelay_s = 0.1;  // from a frame to its estimate
constexpr double kSettled_s = 60;       // of a flight, before anything is counted or attacked
constexpr double kWhiteSigma_m = 0.2;
constexpr double kVelocitySigma_mps = 1;  // of vision, as claimed

// An honest receiver: two Gauss-Markov processes per axis, ionosphere and ephemerides beside reflections of the ground.
struct ReceiverModel {
  const char* name;
  double slow_sigma_m, slow_time_s;
  double multipath_sigma_m, multipath_time_s;
  double reported_m;
  double latency_s;
};

constexpr std::array kReceivers = {
    ReceiverModel{"open sky", 0.9, 60, 0, 1, 1.2, 0.1},
    ReceiverModel{"multipath", 1.5, 60, 2, 15, 2.5, 0.2},
    ReceiverModel{"poor, and claims half of its error", 3, 60, 2, 15, 1.8, 0.2},
};

struct Attack {
  double drag_mps = 0, step_m = 0;
};

constexpr std::array kAttacks = {Attack{.drag_mps = 0.2}, Attack{.drag_mps = 0.5}, Attack{.drag_mps = 1},
                                 Attack{.drag_mps = 2},   Attack{.drag_mps = 5},   Attack{.step_m = 15},
                                 Attack{.step_m = 30},    Attack{.step_m = 60},    Attack{.step_m = 300}};

class Receiver {
 public:
  Receiver(const ReceiverModel& model, Random random) : model_(model), random_(random) {
    for (Vector2d* error : {&slow_m_, &multipath_m_}) *error = normal();
  }

  Vector2d error_m() {
    const auto step = [&](Vector2d& unit, double time_s) {
      const double keep = std::exp(-kFixPeriod_s / time_s);
      unit = keep * unit + std::sqrt(1 - keep * keep) * normal();
    };
    step(slow_m_, model_.slow_time_s);
    step(multipath_m_, model_.multipath_time_s);
    return model_.slow_sigma_m * slow_m_ + model_.multipath_sigma_m * multipath_m_ + kWhiteSigma_m * normal();
  }

 private:
  Vector2d normal() {
    const double east = random_.normal();
    return {east, random_.normal()};
  }

  const ReceiverModel& model_;
  Random random_;
  Vector2d slow_m_, multipath_m_;
};

struct Outcome {
  double honest_s = 0, distrusted_s = 0;
  int false_alarms = 0;
  std::optional<double> found_s;  // after the attack began
  double trusted_again_s = 0;     // of the attack after it was found, until the flight ends
};

struct Fix {
  double time_s = 0, since_s = 0;  // of the message; since the attack began, less than 0 before it
  Vector2d place_m = Vector2d::Zero();
  double speed_mps = 0;
};

// A flight with a receiver that is honest until `attack_s`: what comes, in the order in which it does.
template <typename SeeVision, typename SeeFix>
void fly(const Track& track, const ReceiverModel& model, const Attack& attack, double attack_s, Random random,
         SeeVision see_vision, SeeFix see_fix) {
  Receiver receiver(model, random.fork("receiver"));
  const double bearing = random.uniform(-kPi, kPi);
  const Vector2d direction(std::sin(bearing), std::cos(bearing));
  std::size_t before = 0, seen = 0;
  const std::vector<TrackPoint>& points = track.points;
  for (int i = 1; i * kFixPeriod_s <= points.back().time_s; ++i) {
    const double now_s = i * kFixPeriod_s, measured_s = now_s - model.latency_s;
    for (; seen < points.size() && points[seen].time_s + kVisionDelay_s <= now_s; ++seen) {
      if (points[seen].visual && points[seen].sigma_m >= 0) see_vision(points[seen]);
    }
    while (before + 2 < points.size() && points[before + 1].time_s <= measured_s) ++before;
    const TrackPoint &a = points[before], &b = points[before + 1];
    const Vector2d velocity_mps = (b.truth_m - a.truth_m) / (b.time_s - a.time_s);
    Fix fix{.time_s = now_s, .since_s = now_s - attack_s};
    fix.place_m = a.truth_m + velocity_mps * (measured_s - a.time_s) + receiver.error_m();
    Vector2d claimed_mps = velocity_mps;
    if (fix.since_s >= 0) {
      fix.place_m += (attack.step_m + attack.drag_mps * fix.since_s) * direction;
      claimed_mps += attack.drag_mps * direction;
    }
    fix.speed_mps = claimed_mps.norm();
    see_fix(fix);
  }
}

Outcome judge(const Track& track, const ReceiverModel& model, const Attack& attack, double attack_s,
              const Random& random) {
  Outcome outcome;
  GpsHealth health(0);
  bool was_trusted = true;
  const auto see_vision = [&](const TrackPoint& p) {
    health.on_vision({.time_s = p.time_s,
                      .place = frame().lonlat_from_plane({p.estimate_m.x(), p.estimate_m.y()}),
                      .covariance_m2 = p.sigma_m * p.sigma_m * Eigen::Matrix2d::Identity(),
                      .velocity_mps = p.velocity_mps,
                      .velocity_sigma_mps = kVelocitySigma_mps});
  };
  fly(track, model, attack, attack_s, random, see_vision, [&](const Fix& fix) {
    const LonLat place = frame().lonlat_from_plane({fix.place_m.x(), fix.place_m.y()});
    health.on_event(GpsFix3d{fix.time_s, true, place, fix.speed_mps, model.reported_m});
    const bool trusted = health.assess(fix.time_s).verdict != GpsVerdict::spoofed;
    const bool accused = was_trusted && !trusted;
    was_trusted = trusted;
    if (fix.time_s < kSettled_s) return;
    if (fix.since_s < 0) {
      outcome.honest_s += kFixPeriod_s;
      outcome.distrusted_s += trusted ? 0 : kFixPeriod_s;
      outcome.false_alarms += accused;
    } else if (!trusted && !outcome.found_s) {
      outcome.found_s = fix.since_s;
    } else if (trusted && outcome.found_s) {
      outcome.trusted_again_s += kFixPeriod_s;
    }
  });
  return outcome;
}

// ---- The test of gps_health beside a likelihood ratio over windows, one look a second, both with the threshold that
// one honest flight in fifty reaches

enum class Statistic { chi2, onset_ratio };

struct Look {
  double since_s, value;
};

std::vector<Look> looks_of(Statistic statistic, const Track& track, const ReceiverModel& model, const Attack& attack,
                           double attack_s, const Random& random) {
  std::vector<Look> looks;
  OnsetRatio ratio;
  std::optional<TrackPoint> vision;
  double next_s = 1, last = 0;
  fly(
      track, model, attack, attack_s, random, [&](const TrackPoint& p) { vision = p; },
      [&](const Fix& fix) {
        if (fix.time_s < next_s || !vision || fix.time_s - vision->time_s > kMaxVisionAge_s) return;
        next_s = fix.time_s + 1;
        const Vector2d difference_m =
            fix.place_m - vision->estimate_m - vision->velocity_mps * (fix.time_s - vision->time_s);
        const double receiver_m = std::max(model.reported_m, kMinGpsSigma_m);
        double value = 0;
        if (statistic == Statistic::onset_ratio) {
          ratio.add(fix.time_s, difference_m, model.reported_m, vision->sigma_m);
          value = ratio.statistic();
        } else {
          const Eigen::Matrix2d covariance_m2 =
              (receiver_m * receiver_m + vision->sigma_m * vision->sigma_m) * Eigen::Matrix2d::Identity() +
              kGpsTimeSigma_s * kGpsTimeSigma_s * vision->velocity_mps * vision->velocity_mps.transpose();
          const double now = difference_m.dot(covariance_m2.inverse() * difference_m);
          value = std::min(now, std::exchange(last, now));  // in two looks, as it must last
        }
        if (fix.time_s >= kSettled_s) looks.push_back({fix.since_s, value});
      });
  return looks;
}

std::string honest_row(const std::string& flights, const ReceiverModel& model, const std::vector<Outcome>& outcomes) {
  double hours = 0, distrusted_h = 0;
  int alarms = 0;
  for (const Outcome& o : outcomes) {
    hours += o.honest_s / 3600;
    distrusted_h += o.distrusted_s / 3600;
    alarms += o.false_alarms;
  }
  // One-sided 95 % of a Poisson rate, Wilson and Hilferty's cube.
  const double n = alarms + 1, upper = n * std::pow(1 - 1 / (9 * n) + 1.645 / (3 * std::sqrt(n)), 3) / hours;
  return fmt::format("| {} | {} | {:.0f} | {} | {:.3g} (below {:.2g}) | {:.3g} % |\n", flights, model.name, hours,
                     alarms, alarms / hours, upper, 100 * distrusted_h / hours);
}

std::string attack_row(const std::string& flights, const Attack& attack, const std::vector<Outcome>& outcomes) {
  std::vector<double> delays;
  double again_s = 0;
  for (const Outcome& o : outcomes) {
    if (o.found_s) delays.push_back(*o.found_s);
    again_s += o.trusted_again_s;
  }
  const std::string what =
      attack.step_m > 0 ? fmt::format("step of {:.0f} m", attack.step_m) : fmt::format("{:.1f} m/s", attack.drag_mps);
  // Of an attack that nobody found there is no delay, and 0 s would be a quick one.
  const auto delay_s = [&](double share) {
    return delays.empty() ? std::numeric_limits<double>::quiet_NaN() : quantile(delays, share);
  };
  const double median_s = delay_s(0.5), late_s = delay_s(0.95);
  const auto off = [&](double seconds) { return attack.step_m + attack.drag_mps * seconds; };
  return fmt::format("| {} | {} | {} of {} | {:.1f}, {:.1f} | {:.0f}, {:.0f} | {:.1f} |\n", flights, what,
                     delays.size(), outcomes.size(), median_s, late_s, off(median_s), off(late_s),
                     again_s / static_cast<double>(outcomes.size()));
}

struct Tracks {
  std::string name;
  std::vector<Track> all;
};

std::string tables(const Tracks& tracks, int draws, std::uint64_t seed) {
  std::string honest, attacked;
  const auto judged = [&](const ReceiverModel& model, const Attack& attack, bool attacks, std::uint64_t salt) {
    std::vector<Outcome> outcomes;
    for (const Track& track : tracks.all) {
      for (int draw = 0; draw < draws; ++draw) {
        Random random = Random(hash_of(seed, static_cast<std::int64_t>(track.index)))
                            .fork("gps", 1000 * salt + static_cast<std::uint64_t>(draw));
        const double end_s = track.points.back().time_s;
        const double attack_s = attacks ? random.uniform(kSettled_s, std::max(kSettled_s, 0.5 * end_s)) : 1e9;
        outcomes.push_back(judge(track, model, attack, attack_s, random));
      }
    }
    return outcomes;
  };
  for (std::size_t i = 0; i < kReceivers.size(); ++i)
    honest += honest_row(tracks.name, kReceivers[i], judged(kReceivers[i], {}, false, i));
  for (std::size_t i = 0; i < kAttacks.size(); ++i)
    attacked += attack_row(tracks.name, kAttacks[i], judged(kReceivers[0], kAttacks[i], true, 10 + i));
  return "\n| flights | honest receiver | hours | accused | an hour (95 %) | time not trusted "
         "|\n|---|---|---|---|---|---|\n" +
         honest +
         "\n| flights | attack, open sky | found | after, s (median, 95 %) | off by then, m | trusted again, s a "
         "flight |\n"
         "|---|---|---|---|---|---|\n" +
         attacked;
}

std::string comparison(const Tracks& tracks, std::uint64_t seed, double sigma_factor) {
  std::vector<Track> claimed = tracks.all;  // the same errors, of which vision claims more
  for (Track& track : claimed) {
    for (TrackPoint& p : track.points) p.sigma_m *= sigma_factor;
  }
  const auto random_of = [&](const Track& track, std::uint64_t salt) {
    return Random(hash_of(seed, static_cast<std::int64_t>(track.index))).fork("compared", salt);
  };
  std::string rows;
  for (const Statistic statistic : {Statistic::chi2, Statistic::onset_ratio}) {
    std::vector<double> largest;
    for (const Track& track : claimed) {
      for (std::size_t i = 0; i < kReceivers.size(); ++i) {
        double most = 0;
        for (const Look& look : looks_of(statistic, track, kReceivers[i], {}, 1e9, random_of(track, i)))
          most = std::max(most, look.value);
        largest.push_back(most);
      }
    }
    const double threshold = quantile(largest, 0.98);
    rows += fmt::format("| {:.1f} × | {} | {:.1f} |", sigma_factor,
                        statistic == Statistic::chi2 ? "χ² of one time" : "likelihood ratio", threshold);
    for (std::size_t i = 0; i < 5; ++i) {  // the drags
      std::vector<double> off_m;
      for (const Track& track : claimed) {
        Random random = random_of(track, 10 + i);
        const double attack_s = random.uniform(2 * kSettled_s, 4 * kSettled_s);
        const auto looks = looks_of(statistic, track, kReceivers[0], kAttacks[i], attack_s, random);
        const auto found =
            std::ranges::find_if(looks, [&](const Look& l) { return l.since_s >= 0 && l.value > threshold; });
        off_m.push_back(found == looks.end() ? std::numeric_limits<double>::infinity()
                                             : found->since_s * kAttacks[i].drag_mps);
      }
      rows += fmt::format(" {:.0f}, {:.0f} |", quantile(off_m, 0.5), quantile(off_m, 0.95));
    }
    rows += "\n";
  }
  return rows;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Honest and spoofed GPS receivers beside vision: false alarms an hour, and how far off a lie gets.",
               "gps");
  RunOptions options;
  options.count = 8;
  options.worlds = 4;
  options.add_to(app, "flights");
  int drawn = 400, frames = 1200, draws = 1;
  app.add_option("--drawn", drawn, "flights without pictures")->capture_default_str();
  app.add_option("--frames", frames, "of each flight, two a second")->capture_default_str();
  app.add_option("--draws", draws, "receivers over each flight")->capture_default_str();
  bool compare = false;
  app.add_flag("--compare", compare, "the test beside a likelihood ratio over windows, over the drawn flights alone");
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    keep_freed_memory();
    Tracks without_pictures{"drawn", {}}, flown{"flown", {}};
    for (int i = 0; i < drawn; ++i)
      without_pictures.all.push_back(draw_track(options.seed, static_cast<std::uint64_t>(i), frames));
    if (compare) {
      std::cout
          << "| vision claims | test | threshold | 0.2 m/s | 0.5 | 1 | 2 | 5 m/s: off by then, m (median, 95 %) |\n"
             "|---|---|---|---|---|---|---|---|\n";
      for (const double factor : {1.0, 2.0}) std::cout << comparison(without_pictures, options.seed, factor);
      return 0;
    }
    if (drawn > 0) std::cout << tables(without_pictures, draws, options.seed) << std::flush;
    if (options.count == 0) return 0;
    std::vector<std::unique_ptr<World>> worlds;
    const auto world = [&](std::uint64_t i) -> const World& { return *worlds[i % worlds.size()]; };
    for (int i = 0; i < options.worlds; ++i)
      worlds.push_back(std::make_unique<World>(options.seed + static_cast<std::uint64_t>(i)));
    const std::string header =
        fmt::format("# nadir bench gps, base seed {}, {} worlds, {} frames\n", options.seed, options.worlds, frames);
    for (const auto& [index, track] : run_all<Track>(options, header, track_of, [&](std::uint64_t i) {
           return fly_track(options.seed, i, frames, world(i));
         })) {
      flown.all.push_back(track);
    }
    std::cout << tables(flown, draws, options.seed);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "gps: " << error.what() << "\n";
    return 2;
  }
}
