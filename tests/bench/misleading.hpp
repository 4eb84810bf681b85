// P(misleading | fault) by splitting: repetitions with seeds of their own, as lines of CSV, and the table of them.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "fault_flight.hpp"
#include "plain_flights.hpp"
#include "splitting.hpp"

namespace nadir::bench {

struct SplitRecord {
  std::uint64_t index = 0;
  std::string fault;  // FaultKind::code
  struct Estimate {
    int levels = 0;
    double reached = 1;  // probability of the last level
    double probability = 0;
  } misleading, hazardous;  // each by splittings of its own; hazardous: the mean of both guides, levels added up
  FlightCounts plain;       // without splitting
};

struct SplittingRun : FlightsRun {
  int particles = 200;
};

std::string splitting_header(const SplittingRun& run);
std::string line(const SplitRecord& record);
SplitRecord split_record_of(const std::string& line);  // throws Error for anything else

// Every fault in turn: the fault is index modulo their number, the repetition the quotient.
SplitRecord split(const MeasuredLooks& looks, const RepeatRates& repeats, const SplittingRun& run, std::uint64_t index);

// A mean of repetitions, and the bound that it is below with 95 % confidence (Student's t). A repetition that never met
// the event counts in the bound with the probability of the last level that it reached.
struct SplitEstimate {
  double mean = 0, bound = 1, levels = 0;  // levels: mean
  int repetitions = 0;
};
struct FaultProbability {
  SplitEstimate misleading, hazardous;
  FlightCounts plain;
};
SplitEstimate estimate_of(const std::vector<SplitRecord::Estimate>& repetitions);
// counted: more plain flights than the repetitions' own, by fault.
using CountedFlights = std::map<std::string, FlightCounts>;
std::map<std::string, FaultProbability> probabilities(const std::map<std::uint64_t, SplitRecord>& records,
                                                      const CountedFlights& counted = {});

std::string splitting_table(const std::map<std::uint64_t, SplitRecord>& records, const CountedFlights& counted = {});

}  // namespace nadir::bench
