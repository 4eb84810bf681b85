// From P(misleading | fault) to a rate per flight hour: a fault tree of basic events with assumed rates.
//
// The top event, a hazardously misleading position, happens when any basic event happens and the belief does not notice
// it (OR of ANDs). A basic event is a stretch of flight, as long as the simulated ones, that has the fault. With λ of
// them in a flight hour the top event's rate is at most Σ λ_i P(hazardously misleading | fault i): rare events, no
// credit for one that hides another. Where there is no fault, every stretch of the hour counts.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "misleading.hpp"

namespace nadir::bench {

inline constexpr double kSail3_per_h = 1e-4, kSail4_per_h = 1e-5;  // what is aimed at; docs/safety-case.md

struct BasicEvent {
  std::string_view branch, fault;  // FaultKind::code, at a start
  double rate_per_h = 0;           // assumed; of stretches of flight. 0: every one that there is
  std::string_view argument;
};
std::span<const BasicEvent> basic_events();

struct EventProbability {
  SplitEstimate misleading, hazardous;
};
struct TreeRow {
  BasicEvent event;
  std::string name;
  double stretches_per_h = 0;
  EventProbability probability;
  double hazardous_per_h = 0, hazardous_bound_per_h = 0, misleading_per_h = 0, misleading_bound_per_h = 0;
};
struct FaultTree {
  double minutes = 5;
  std::vector<TreeRow> rows;
  double hazardous_per_h = 0, hazardous_bound_per_h = 0, misleading_per_h = 0, misleading_bound_per_h = 0;  // sums
};

// Throws Error where a basic event has no probability.
FaultTree fault_tree(const std::map<std::string, FaultProbability>& probabilities, double minutes);
std::string tree_table(const FaultTree& tree);
std::string tree_svg(const FaultTree& tree);

// Results of `--part splitting`. Throws UsageError for another file or another seed, Error for a line that cannot be
// read.
struct SplittingFile {
  std::string run;
  double minutes = 5;
  std::map<std::uint64_t, SplitRecord> records;
};
SplittingFile read_splitting(const std::filesystem::path& path, std::uint64_t seed);

}  // namespace nadir::bench
