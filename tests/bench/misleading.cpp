#include "misleading.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/error.hpp"

namespace nadir::bench {
namespace {

constexpr int kLeastRepetitions = 20;
constexpr double kWideStarts = 0.5;  // of the flights of a splitting; their weights are 2 at most

constexpr int kPlain = 1000;  // the seed of plain flights

// The 95 % quantile of Student's t (Fisher's expansion; 2e-3 off at four degrees of freedom).
double t_95(double freedom) {
  const double z = 1.6448536269514722, z3 = z * z * z, z5 = z3 * z * z, z7 = z5 * z * z;
  return z + (z3 + z) / (4 * freedom) + (5 * z5 + 16 * z3 + 3 * z) / (96 * freedom * freedom) +
         (3 * z7 + 19 * z5 + 17 * z3 - 15 * z) / (384 * freedom * freedom * freedom);
}

// Both without bias, and so is their mean.
SplitRecord::Estimate mean_of(const SplitRecord::Estimate& one, const SplitRecord::Estimate& other) {
  return {one.levels + other.levels, (one.reached + other.reached) / 2, (one.probability + other.probability) / 2};
}

std::string probability(double p) { return p == 0 ? "0" : fmt::format("{:.2g}", p); }

}  // namespace

std::string splitting_header(const SplittingRun& run) {
  return fmt::format(
      "# nadir bench splitting, base seed {}, {} particles, {}\nindex,fault,levels,reached,misleading,"
      "levels,reached,hazardous,plain,plain_misleading,plain_hazardous,looks,usable,usable_30\n",
      run.seed, run.particles, run.text());
}

std::string line(const SplitRecord& r) {
  return fmt::format("{},{},{},{:.4g},{:.4g},{},{:.4g},{:.4g},{},{},{},{},{},{}\n", r.index, r.fault,
                     r.misleading.levels, r.misleading.reached, r.misleading.probability, r.hazardous.levels,
                     r.hazardous.reached, r.hazardous.probability, r.plain.flights, r.plain.misleading,
                     r.plain.hazardous, r.plain.looks, r.plain.usable, r.plain.usable_30);
}

SplitRecord split_record_of(const std::string& text) {
  std::istringstream in(text);
  SplitRecord r;
  char comma = 0;
  in >> r.index >> comma;
  std::getline(in, r.fault, ',');
  for (SplitRecord::Estimate* e : {&r.misleading, &r.hazardous}) {
    in >> e->levels >> comma >> e->reached >> comma >> e->probability >> comma;
  }
  in >> r.plain.flights >> comma >> r.plain.misleading >> comma >> r.plain.hazardous >> comma >> r.plain.looks >>
      comma >> r.plain.usable >> comma >> r.plain.usable_30;
  if (!in || !(in >> std::ws).eof() || !is_fault_kind(r.fault)) {
    throw Error({.what = "a line of results cannot be read",
                 .expected = "fourteen cells, the second one names a fault",
                 .found = text});
  }
  return r;
}

SplitRecord split(const MeasuredLooks& looks, const RepeatRates& repeats, const SplittingRun& run,
                  std::uint64_t index) {
  const FaultKind& kind = kind_of(index);
  SplitRecord record;
  record.index = index;
  record.fault = kind.code;
  const auto by = [&](FaultFlight::Event event, FaultFlight::Guide guide) -> SplitRecord::Estimate {
    const FaultFlight flight(looks, repeats, kind, run.limits, event, kWideStarts, guide);
    SplittingOptions options;
    options.particles = run.particles;
    options.event = event;
    const auto result =
        Splitting<FaultFlight>(flight, options, hash_of(run.seed, static_cast<std::int64_t>(index), 5 + event)).run();
    return {result.levels, result.reached, result.probability[event]};
  };
  using Guide = FaultFlight::Guide;
  record.misleading = by(FaultFlight::misleading, Guide::doubt);
  record.hazardous =
      mean_of(by(FaultFlight::hazardous, Guide::doubt), by(FaultFlight::hazardous, Guide::unwarned_doubt));
  const FaultFlight flight(looks, repeats, kind, run.limits, FaultFlight::hazardous);
  record.plain = count_flights(flight, 2 * run.particles, hash_of(run.seed, static_cast<std::int64_t>(index), kPlain));
  return split_record_of(line(record));  // rounded as it is stored: a resumed run prints the same
}

SplitEstimate estimate_of(const std::vector<SplitRecord::Estimate>& repetitions) {
  SplitEstimate estimate;
  estimate.repetitions = static_cast<int>(repetitions.size());
  const auto count = static_cast<double>(repetitions.size());
  if (count < 2) return estimate;
  double mean_of_bounds = 0, squares = 0;
  std::vector<double> bounds;
  for (const SplitRecord::Estimate& r : repetitions) {
    estimate.mean += r.probability / count;
    estimate.levels += r.levels / count;
    bounds.push_back(r.probability > 0 ? r.probability : r.reached);
    mean_of_bounds += bounds.back() / count;
  }
  for (const double bound : bounds) squares += (bound - mean_of_bounds) * (bound - mean_of_bounds);
  estimate.bound = std::min(1.0, mean_of_bounds + t_95(count - 1) * std::sqrt(squares / (count - 1) / count));
  return estimate;
}

std::map<std::string, FaultProbability> probabilities(const std::map<std::uint64_t, SplitRecord>& records,
                                                      const CountedFlights& counted) {
  std::map<std::string, std::array<std::vector<SplitRecord::Estimate>, 2>> lists;
  std::map<std::string, FaultProbability> sums;
  for (const auto& [index, r] : records) {
    lists[r.fault][0].push_back(r.misleading);
    lists[r.fault][1].push_back(r.hazardous);
    sums[r.fault].plain.add(r.plain);
  }
  for (auto& [fault, sum] : sums) {
    if (const auto more = counted.find(fault); more != counted.end()) sum.plain.add(more->second);
    sum.misleading = estimate_of(lists[fault][0]);
    sum.hazardous = estimate_of(lists[fault][1]);
    // Where a repetition never met the event: what is hazardously misleading is misleading, too.
    const auto& all = lists[fault][1];
    if (std::any_of(all.begin(), all.end(), [](const SplitRecord::Estimate& e) { return e.probability == 0; })) {
      sum.hazardous.bound = std::max(sum.hazardous.mean, std::min(sum.hazardous.bound, sum.misleading.bound));
    }
  }
  return sums;
}

std::string splitting_table(const std::map<std::uint64_t, SplitRecord>& records, const CountedFlights& counted) {
  const auto by_fault = probabilities(records, counted);
  std::string table =
      "| fault | repetitions | levels | P(misleading) | 95 % bound | levels | P(hazardous) | 95 % bound | of plain "
      "flights: "
      "number | misleading | hazardous | looks with HPL below 30 m, % | below the alert limit, % |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  int least = kLeastRepetitions;
  for (const FaultKind& kind : fault_kinds()) {
    const auto found = by_fault.find(kind.code);
    if (found == by_fault.end()) continue;
    const FaultProbability& p = found->second;
    least = std::min(least, p.misleading.repetitions);
    const auto share = [&](long part) {
      return 100.0 * static_cast<double>(part) / static_cast<double>(std::max(1L, p.plain.looks));
    };
    table += fmt::format("| {} | {} | {:.0f} | {} | {} | {:.0f} | {} | {} | {} | {} | {} | {:.1f} | {:.1f} |\n",
                         kind.name, p.misleading.repetitions, p.misleading.levels, probability(p.misleading.mean),
                         probability(p.misleading.bound), p.hazardous.levels, probability(p.hazardous.mean),
                         probability(p.hazardous.bound), p.plain.flights, p.plain.misleading, p.plain.hazardous,
                         share(p.plain.usable_30), share(p.plain.usable));
  }
  if (least < kLeastRepetitions) {
    table += fmt::format("\nonly {} repetitions of some faults: bounds need {}\n", least, kLeastRepetitions);
  }
  return table;
}

}  // namespace nadir::bench
