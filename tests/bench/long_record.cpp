#include "long_record.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <sstream>
#include <vector>

#include "base/error.hpp"

namespace nadir::bench {
namespace {

constexpr std::array kCounts = {
    &LongRecord::within_20,     &LongRecord::within_50, &LongRecord::refined_within_20, &LongRecord::refined_within_50,
    &LongRecord::refined_in_95, &LongRecord::losses,    &LongRecord::recovered,         &LongRecord::longest_recovery};

double percent(int part, int whole) { return whole == 0 ? 0 : 100.0 * part / whole; }

void add(LongRecord& sum, const LongRecord& r) {
  ++sum.index;  // of a sum: how many flights
  for (const auto count :
       {&Record::frames, &Record::attempts, &Record::accepted, &Record::wrong, &Record::anchored, &Record::misleading,
        &Record::positioned, &Record::overconfident, &Record::in_50, &Record::in_95}) {
    sum.*count += r.*count;
  }
  const int longest = std::max(sum.longest_recovery, r.longest_recovery);
  for (const auto count : kCounts) sum.*count += r.*count;
  sum.longest_recovery = longest;
  sum.error_sum_m += r.error_sum_m;
  sum.worst_m = std::max(sum.worst_m, r.worst_m);
  sum.worst_sigmas = std::max(sum.worst_sigmas, r.worst_sigmas);
}

std::string row(const LongRecord& s) {
  return fmt::format(
      "| {} | {} | {:.1f} | {:.1f} | {:.1f} | {:.1f} | {} | {} | {} | {:.1f} | {:.1f} | {} of {} | {} | {:.1f}, {:.1f} "
      "| "
      "{:.1f} |\n",
      s.condition, s.index, percent(s.within_20, s.frames), percent(s.within_50, s.frames),
      s.positioned == 0 ? 0 : s.error_sum_m / s.positioned, percent(s.accepted, s.attempts), s.wrong, s.misleading,
      s.overconfident, percent(s.in_50, s.positioned), percent(s.in_95, s.positioned), s.recovered, s.losses,
      s.longest_recovery, percent(s.refined_within_20, s.frames), percent(s.refined_within_50, s.frames),
      percent(s.refined_in_95, s.frames));
}

}  // namespace

std::string long_header(std::uint64_t base_seed, int worlds, int frames) {
  return fmt::format(
      "# nadir bench flights, base seed {}, {} worlds, {} frames\n"
      "index,condition,frames,attempts,accepted,wrong,anchored,misleading,unknowable,told,overconfident,in_50,in_95,"
      "nees,worst_sigmas,worst_m,within_20,within_50,refined_within_20,refined_within_50,refined_in_95,losses,"
      "recovered,longest_recovery,error_sum_m\n",
      base_seed, worlds, frames);
}

std::string line(const LongRecord& r) {
  std::string text = line(static_cast<const Record&>(r));
  text.pop_back();
  for (const auto count : kCounts) text += fmt::format(",{}", r.*count);
  return text + fmt::format(",{:.2f}\n", r.error_sum_m);
}

LongRecord long_record_of(const std::string& text) {
  LongRecord r;
  static_cast<Record&>(r) = record_of(text);
  std::istringstream in(text);
  std::vector<std::string> cells;
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  constexpr std::size_t kCommon = 16;
  if (cells.size() != kCommon + kCounts.size() + 1) {
    throw Error({.what = "a line of results cannot be read", .found = text});
  }
  for (std::size_t i = 0; i < kCounts.size(); ++i) r.*kCounts[i] = std::stoi(cells[kCommon + i]);
  r.error_sum_m = std::stod(cells.back());
  return r;
}

std::string long_summary(const std::map<std::uint64_t, LongRecord>& records) {
  std::string text =
      "| condition | flights | < 20 m % | < 50 m % | mean m | anchored % | wrong | misleading | overconfident | in 50 "
      "% "
      "| in 95 % | recovered | after frames | refined < 20 m, < 50 m % | refined in 95 % |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  std::vector<LongRecord> sums;
  LongRecord all;
  all.condition = "all";
  for (const auto& [index, record] : records) {
    const auto same = [&](const LongRecord& sum) { return sum.condition == record.condition; };
    auto sum = std::find_if(sums.begin(), sums.end(), same);
    if (sum == sums.end()) {
      sums.emplace_back().condition = record.condition;
      sum = std::prev(sums.end());
    }
    add(*sum, record), add(all, record);
  }
  for (const LongRecord& sum : sums) text += row(sum);
  return text + row(all);
}

}  // namespace nadir::bench
