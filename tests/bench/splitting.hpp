// Multilevel splitting: how probable is an event that plain simulation never sees?
//
// N paths of a Markov process run to their end. A score says how near a path came to the event. Again and again the
// paths with the least highest score (a share of them; the highest of those is the level) are killed and each is
// replaced by a copy of one that went above the level, run anew from the moment when it did. With K_i paths killed in
// round i, a path of round q has the weight
//
//   w_q = Π_{i < q} (1 - K_i / N) / N
//
// and the probability of any event of a path is the sum of the weights of the paths where it happened, killed ones
// included. The estimate has no bias, whatever the score is; a bad score costs variance. Adaptive multilevel splitting:
// Cérou & Guyader 2007; for processes in steps, with ties, and for any event: Bréhier, Gazeau, Goudenège, Lelièvre &
// Rousset 2016.
//
// Process: a copyable State; State begin(Random&); void advance(State&, Random&); double score(const State&);
// bool ended(const State&); and events, a std::array<bool, kEvents> in State, which once set stay set. A process that
// draws rare beginnings more often than they are says so by a weight in State (importance sampling), which w_q is
// multiplied by.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/random.hpp"
#include "simulation/noise.hpp"

namespace nadir::bench {

struct SplittingOptions {
  int particles = 200;  // N
  double killed_share = 0.1;
  int max_levels = 400;
  double enough_share = 0.5;  // of the paths ended in the event below: no further levels
  double negligible = 1e-9;   // probability of a level from which on nobody cares: likewise
  std::size_t event = 0;
};

template <typename State>
struct SplittingResult {
  std::array<double, std::tuple_size_v<decltype(State::events)>> probability{};
  int levels = 0;
  double reached = 1;  // probability of the last level
};

template <typename Process>
class Splitting {
 public:
  using State = typename Process::State;
  static constexpr std::size_t kEvents = std::tuple_size_v<decltype(State::events)>;

  Splitting(const Process& process, const SplittingOptions& options, std::uint64_t seed)
      : process_(process), options_(options), seed_(seed) {}

  SplittingResult<State> run() {
    SplittingResult<State> result;
    const auto n = static_cast<std::size_t>(options_.particles);
    std::vector<Path> paths;
    for (std::size_t i = 0; i < n; ++i) paths.push_back(whole_path());
    double of_each = 1 / static_cast<double>(n);  // the weight of a path now
    const auto least = static_cast<std::size_t>(std::ceil(options_.killed_share * static_cast<double>(n)));
    while (result.levels < options_.max_levels && of_each * static_cast<double>(n) > options_.negligible) {
      const auto hits =
          std::count_if(paths.begin(), paths.end(), [this](const Path& p) { return p.end.events[options_.event]; });
      if (static_cast<double>(hits) >= options_.enough_share * static_cast<double>(n)) break;
      std::vector<double> scores;
      for (const Path& path : paths) scores.push_back(path.highest());
      std::nth_element(scores.begin(), scores.begin() + static_cast<std::ptrdiff_t>(least - 1), scores.end());
      const double level = scores[least - 1];
      std::vector<std::size_t> killed, alive;
      for (std::size_t i = 0; i < n; ++i) (paths[i].highest() <= level ? killed : alive).push_back(i);
      if (alive.empty()) break;  // no path is above: what they did counts as it is
      for (const std::size_t i : killed) add(result.probability, paths[i], of_each);
      Random choice(hash_of(seed_, static_cast<std::int64_t>(result.levels), -1));
      for (const std::size_t i : killed) {
        const auto parent = static_cast<std::size_t>(choice.integer(0, static_cast<int>(alive.size()) - 1));
        paths[i] = branch(paths[alive[parent]], level);
      }
      of_each *= 1 - static_cast<double>(killed.size()) / static_cast<double>(n);
      ++result.levels;
    }
    double weights = 0;
    for (const Path& path : paths) {
      add(result.probability, path, of_each);
      weights += weight(path.end);
    }
    result.reached = of_each * weights;
    return result;
  }

 private:
  struct Record {  // a moment when the score was higher than ever before
    int step = 0;
    double score = 0;
    State state;
  };
  struct Path {
    std::vector<Record> records;
    State end;
    double highest() const { return records.back().score; }
  };

  static double weight(const State& state) {
    if constexpr (requires { state.weight; }) {
      return state.weight;
    } else {
      return 1;
    }
  }

  static void add(std::array<double, kEvents>& sums, const Path& path, double of_each) {
    for (std::size_t i = 0; i < kEvents; ++i) sums[i] += path.end.events[i] ? of_each * weight(path.end) : 0;
  }

  Path whole_path() {
    Random random(hash_of(seed_, static_cast<std::int64_t>(drawn_++), 0));
    Path path;
    State state = process_.begin(random);
    path.records.push_back({0, process_.score(state), state});
    finish(path, state, 0, random);
    return path;
  }

  // The parent up to where it went above the level, then by other chances.
  Path branch(const Path& parent, double level) {
    Random random(hash_of(seed_, static_cast<std::int64_t>(drawn_++), 0));
    Path path;
    for (const Record& record : parent.records) {
      path.records.push_back(record);
      if (record.score > level) break;
    }
    State state = path.records.back().state;
    finish(path, state, path.records.back().step, random);
    return path;
  }

  void finish(Path& path, State& state, int step, Random& random) {
    while (!process_.ended(state)) {
      process_.advance(state, random);
      ++step;
      const double score = process_.score(state);
      if (score > path.records.back().score) path.records.push_back({step, score, state});
    }
    path.end = state;
  }

  const Process& process_;
  SplittingOptions options_;
  std::uint64_t seed_;
  std::uint64_t drawn_ = 0;
};

}  // namespace nadir::bench
