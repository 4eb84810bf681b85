#include "misleading.hpp"

#include <fmt/format.h>

#include <cmath>
#include <sstream>

#include "base/error.hpp"

namespace nadir::bench {
namespace {

constexpr int kLeastRepetitions = 20;

// The 95 % quantile of Student's t (Fisher's expansion; 2e-3 off at four degrees of freedom).
double t_95(double freedom) {
  const double z = 1.6448536269514722, z3 = z * z * z, z5 = z3 * z * z, z7 = z5 * z * z;
  return z + (z3 + z) / (4 * freedom) + (5 * z5 + 16 * z3 + 3 * z) / (96 * freedom * freedom) +
         (3 * z7 + 19 * z5 + 17 * z3 - 15 * z) / (384 * freedom * freedom * freedom);
}

std::string probability(double p) { return p == 0 ? "0" : fmt::format("{:.2g}", p); }

}  // namespace

std::string splitting_header(const SplittingRun& run) {
  return fmt::format(
      "# nadir bench splitting, base seed {}, {} particles, {:g} minutes, alert limit {:g} m, risk {:g}, looks {} "
      "({}), "
      "repeats {}\nindex,fault,levels,reached,misleading,hazardous,plain,plain_misleading,plain_hazardous,looks,usable,"
      "usable_30\n",
      run.seed, run.particles, run.limits.minutes, run.limits.alert_limit_m, run.limits.integrity_risk,
      run.looks_sha256.substr(0, 16), run.looks_origin, run.repeats_sha256.substr(0, 16));
}

std::string line(const SplitRecord& r) {
  return fmt::format("{},{},{},{:.6g},{:.6g},{:.6g},{},{},{},{},{},{}\n", r.index, r.fault, r.levels, r.reached,
                     r.misleading, r.hazardous, r.plain, r.plain_misleading, r.plain_hazardous, r.looks, r.usable,
                     r.usable_30);
}

SplitRecord split_record_of(const std::string& text) {
  std::istringstream in(text);
  SplitRecord r;
  char comma = 0;
  in >> r.index >> comma;
  std::getline(in, r.fault, ',');
  in >> r.levels >> comma >> r.reached >> comma >> r.misleading >> comma >> r.hazardous >> comma >> r.plain >> comma >>
      r.plain_misleading >> comma >> r.plain_hazardous >> comma >> r.looks >> comma >> r.usable >> comma >> r.usable_30;
  const bool known =
      std::any_of(fault_kinds().begin(), fault_kinds().end(), [&](const FaultKind& k) { return k.code == r.fault; });
  if (!in || !(in >> std::ws).eof() || !known) {
    throw Error({.what = "a line of results cannot be read",
                 .expected = "twelve cells, the second one names a fault",
                 .found = text});
  }
  return r;
}

SplitRecord split(const MeasuredLooks& looks, const RepeatRates& repeats, const SplittingRun& run,
                  std::uint64_t index) {
  const FaultKind& kind = fault_kinds()[index % fault_kinds().size()];
  const FaultFlight flight(looks, repeats, kind.fault, run.limits);
  SplittingOptions options;
  options.particles = run.particles;
  const auto result =
      Splitting<FaultFlight>(flight, options, hash_of(run.seed, static_cast<std::int64_t>(index), 5)).run();
  SplitRecord record;
  record.index = index;
  record.fault = kind.code;
  record.levels = result.levels;
  record.reached = result.reached;
  record.misleading = result.probability[FaultFlight::misleading];
  record.hazardous = result.probability[FaultFlight::hazardous];
  for (const FaultFlight::State& end : result.plain) {
    ++record.plain;
    record.plain_misleading += end.events[FaultFlight::misleading] ? 1 : 0;
    record.plain_hazardous += end.events[FaultFlight::hazardous] ? 1 : 0;
    record.looks += end.looks, record.usable += end.usable, record.usable_30 += end.usable_30;
  }
  return record;
}

SplitEstimate estimate_of(const std::vector<double>& probabilities, const std::vector<double>& reached) {
  SplitEstimate estimate;
  estimate.repetitions = static_cast<int>(probabilities.size());
  const auto count = static_cast<double>(probabilities.size());
  if (count < 2) return estimate;
  double mean_of_bounds = 0, squares = 0;
  std::vector<double> bounds;
  for (std::size_t i = 0; i < probabilities.size(); ++i) {
    estimate.mean += probabilities[i] / count;
    bounds.push_back(probabilities[i] > 0 ? probabilities[i] : reached[i]);
    mean_of_bounds += bounds.back() / count;
  }
  for (const double bound : bounds) squares += (bound - mean_of_bounds) * (bound - mean_of_bounds);
  estimate.bound = std::min(1.0, mean_of_bounds + t_95(count - 1) * std::sqrt(squares / (count - 1) / count));
  return estimate;
}

std::map<std::string, FaultProbability> probabilities(const std::map<std::uint64_t, SplitRecord>& records) {
  struct Lists {
    std::vector<double> misleading, hazardous, reached;
  };
  std::map<std::string, Lists> lists;
  std::map<std::string, FaultProbability> sums;
  for (const auto& [index, r] : records) {
    Lists& of_fault = lists[r.fault];
    of_fault.misleading.push_back(r.misleading);
    of_fault.hazardous.push_back(r.hazardous);
    of_fault.reached.push_back(r.reached);
    FaultProbability& sum = sums[r.fault];
    sum.levels += r.levels;
    sum.plain += r.plain, sum.plain_misleading += r.plain_misleading, sum.plain_hazardous += r.plain_hazardous;
    sum.looks += r.looks, sum.usable += r.usable, sum.usable_30 += r.usable_30;
  }
  for (auto& [fault, sum] : sums) {
    const Lists& of_fault = lists[fault];
    sum.misleading = estimate_of(of_fault.misleading, of_fault.reached);
    sum.hazardous = estimate_of(of_fault.hazardous, of_fault.reached);
    sum.levels /= static_cast<double>(of_fault.reached.size());
  }
  return sums;
}

std::string splitting_table(const std::map<std::uint64_t, SplitRecord>& records) {
  const auto by_fault = probabilities(records);
  std::string table =
      "| fault | repetitions | levels | P(misleading) | 95 % bound | P(hazardous) | 95 % bound | of plain flights: "
      "number | misleading | hazardous | looks with HPL below 30 m, % | below the alert limit, % |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  int least = kLeastRepetitions;
  for (const FaultKind& kind : fault_kinds()) {
    const auto found = by_fault.find(std::string(kind.code));
    if (found == by_fault.end()) continue;
    const FaultProbability& p = found->second;
    least = std::min(least, p.misleading.repetitions);
    const auto share = [&](long part) {
      return 100.0 * static_cast<double>(part) / static_cast<double>(std::max(1L, p.looks));
    };
    table += fmt::format("| {} | {} | {:.0f} | {} | {} | {} | {} | {} | {} | {} | {:.1f} | {:.1f} |\n", kind.name,
                         p.misleading.repetitions, p.levels, probability(p.misleading.mean),
                         probability(p.misleading.bound), probability(p.hazardous.mean), probability(p.hazardous.bound),
                         p.plain, p.plain_misleading, p.plain_hazardous, share(p.usable_30), share(p.usable));
  }
  if (least < kLeastRepetitions) {
    table += fmt::format("\nonly {} repetitions of some faults: bounds need {}\n", least, kLeastRepetitions);
  }
  return table;
}

}  // namespace nadir::bench
