#include "safety_record.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>
#include <sstream>

#include "base/error.hpp"
#include "safety_conditions.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir::bench {
namespace {

constexpr std::string_view kColumns =
    "index,condition,frames,attempts,accepted,wrong,anchored,misleading,unknowable,told,overconfident,in_50,in_95,nees,"
    "worst_sigmas,"
    "worst_m,motions,levels\n";

std::string share(int part, int whole) { return whole == 0 ? "-" : fmt::format("{:.1f}", 100.0 * part / whole); }

void add(Record& sum, const Record& r) {
  ++sum.index;  // of a sum: how many segments
  sum.frames += r.frames, sum.attempts += r.attempts, sum.accepted += r.accepted, sum.wrong += r.wrong;
  sum.anchored += r.anchored, sum.misleading += r.misleading, sum.unknowable += r.unknowable,
      sum.positioned += r.positioned, sum.overconfident += r.overconfident;
  sum.in_50 += r.in_50, sum.in_95 += r.in_95, sum.nees += r.nees;
  for (std::size_t i = 0; i < r.motions.numbers.size(); ++i) sum.motions.numbers[i] += r.motions.numbers[i];
  sum.levels.insert(sum.levels.end(), r.levels.begin(), r.levels.end());
  sum.worst_sigmas = std::max(sum.worst_sigmas, r.worst_sigmas), sum.worst_m = std::max(sum.worst_m, r.worst_m);
}

// A sum for each condition, in the order of summary(); others, of which it knows nothing, as they came.
std::vector<Record> sums_of(const std::map<std::uint64_t, Record>& records) {
  std::vector<Record> sums;
  for (const auto& [index, record] : records) {
    auto sum = std::ranges::find(sums, record.condition, &Record::condition);
    if (sum == sums.end()) {
      sum = sums.emplace(sum);
      sum->condition = record.condition;
    }
    add(*sum, record);
  }
  const auto rank = [](const Record& sum) {
    return std::ranges::find(conditions(), sum.condition, &Condition::name) - conditions().begin();
  };
  std::ranges::stable_sort(sums, {}, rank);
  return sums;
}

Record all_of(const std::vector<Record>& sums) {
  Record all;
  all.condition = "**all**";
  for (const Record& sum : sums) add(all, sum);
  return all;
}

std::string row(const Record& s) {
  return fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {:.1f} | {:.0f} |\n", s.condition,
                     s.index, s.attempts, share(s.accepted, s.attempts), s.wrong, s.misleading, s.unknowable,
                     s.overconfident, share(s.in_50, s.positioned), share(s.in_95, s.positioned),
                     s.anchored == 0 ? "-" : fmt::format("{:.2f}", s.nees / s.anchored), s.worst_sigmas, s.worst_m);
}

}  // namespace

std::string header(std::uint64_t base_seed, int worlds, const std::string& second) {
  return fmt::format("# nadir bench safety, base seed {}, {} worlds{}\n{}", base_seed, worlds, second, kColumns);
}

std::string line(const Record& r) {
  return fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{:.4f},{:.3f},{:.2f},{},{}\n", r.index, r.condition,
                     r.frames, r.attempts, r.accepted, r.wrong, r.anchored, r.misleading, r.unknowable, r.positioned,
                     r.overconfident, r.in_50, r.in_95, r.nees, r.worst_sigmas, r.worst_m,
                     fmt::join(r.motions.numbers, " "), levels_text(r.levels));
}

Record record_of(const std::string& text) {
  std::istringstream in(text);
  Record r;
  char comma = 0;
  in >> r.index >> comma;
  std::getline(in, r.condition, ',');
  for (int* value : {&r.frames, &r.attempts, &r.accepted, &r.wrong, &r.anchored, &r.misleading, &r.unknowable,
                     &r.positioned, &r.overconfident, &r.in_50, &r.in_95}) {
    in >> *value >> comma;
  }
  in >> r.nees >> comma >> r.worst_sigmas >> comma >> r.worst_m >> comma;
  if (!in || comma != ',') throw Error({.what = "a line of results cannot be read", .found = text});
  for (int& number : r.motions.numbers) in >> number;
  in >> comma;
  if (!in || comma != ',') throw Error({.what = "the motions of a line of results cannot be read", .found = text});
  std::string levels;
  std::getline(in, levels, ',');
  r.levels = levels_of(levels);
  return r;
}

std::vector<LeveledError> all_levels(const std::map<std::uint64_t, Record>& records) {
  std::vector<LeveledError> levels;
  for (const auto& [index, r] : records) levels.insert(levels.end(), r.levels.begin(), r.levels.end());
  return levels;
}

std::string level_summary(const std::map<std::uint64_t, Record>& records) {
  const std::vector<Record> sums = sums_of(records);
  std::string text = level_table_head();
  for (const Record& sum : sums) text += level_row(sum.condition, level_figures(sum.positioned, sum.levels));
  const Record all = all_of(sums);
  return text + level_row(all.condition, level_figures(all.positioned, all.levels));
}

std::string motion_summary(const std::map<std::uint64_t, Record>& records) {
  std::string text = fmt::format(
      "| condition | motions | of {0} inliers or more: used right | wrong | refused right | wrong | of fewer than {0}: "
      "used right | wrong | refused right | wrong |\n|---|---|---|---|---|---|---|---|---|---|\n",
      parameters::tracking::kSureInliers);
  std::vector<Record> sums = sums_of(records);
  sums.push_back(all_of(sums));
  for (const Record& sum : sums) {
    const auto& numbers = sum.motions.numbers;
    text += fmt::format("| {} | {} |", sum.condition, std::accumulate(numbers.begin(), numbers.end(), 0));
    for (const bool few : {false, true}) {
      for (const bool used : {true, false}) {
        for (const bool wrong : {false, true})
          text += fmt::format(" {} |", numbers[MotionCounts::index(few, used, wrong)]);
      }
    }
    text += "\n";
  }
  return text;
}

std::string summary(const std::map<std::uint64_t, Record>& records, std::uint64_t base_seed) {
  std::string text =
      "| condition | segments | attempts | anchored % | wrong | misleading | unknowable | overconfident | in 50 % | in "
      "95 % | NEES | "
      "worst sigmas | worst m |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  Record all;
  all.condition = "all";
  for (const Condition& condition : conditions()) {
    Record sum;
    sum.condition = condition.name;
    for (const auto& [index, record] : records) {
      if (record.condition == condition.name) add(sum, record), add(all, record);
    }
    if (sum.index > 0) text += row(sum);
  }
  text += row(all);
  for (const auto& [index, r] : records) {
    if (!r.violates()) continue;
    text += fmt::format("VIOLATION --seed {} --only {}: {}, {} wrong, {} misleading, {:.1f} sigmas, {:.0f} m\n",
                        base_seed, index, r.condition, r.wrong, r.misleading, r.worst_sigmas, r.worst_m);
  }
  return text;
}

}  // namespace nadir::bench
