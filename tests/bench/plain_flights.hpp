// P(misleading | fault) by counting, without any method: what splitting says (misleading.hpp) must agree with it, and a
// way to the event that no guide of splitting follows is seen here first. Rare events need many flights; the interval
// is that of a count.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>

#include "fault_flight.hpp"

namespace nadir::bench {

struct FlightCounts {
  int flights = 0, misleading = 0, hazardous = 0;
  long looks = 0, usable = 0, usable_30 = 0;

  void add(const FlightCounts& more);
};
FlightCounts count_flights(const FaultFlight& flight, int flights, std::uint64_t seed);

// What identifies a run: the same text, the same results.
struct FlightsRun {
  std::uint64_t seed = 0;
  FlightLimits limits;
  std::string looks_origin, looks_sha256, repeats_sha256;
  std::string text() const;  // without the seed
};

// A line of the results: some flights of one fault.
struct PlainFlights {
  std::uint64_t index = 0;
  std::string fault;  // FaultKind::code
  FlightCounts counts;
};
inline constexpr int kFlightsInALine = 1000;
std::string plain_header(const FlightsRun& run);
std::string line(const PlainFlights& flights);
PlainFlights plain_flights_of(const std::string& line);  // throws Error for anything else

// Every fault in turn: the fault is index modulo their number.
PlainFlights count_plain(const MeasuredLooks& looks, const RepeatRates& repeats, const FlightsRun& run,
                         std::uint64_t index);

// Results of `--part plain`, added up: of each fault (FaultKind::code) all of its flights. Throws UsageError for
// another file or another seed, Error for a line that cannot be read.
struct PlainFile {
  std::string header;  // as it was written
  std::string run;     // FlightsRun::text()
  std::map<std::string, FlightCounts> sums;
  void add(const PlainFile& more);  // throws UsageError for flights of another run
  std::string text() const;         // a line for each fault, which reads as the same sums
};
PlainFile read_plain(const std::filesystem::path& path, std::uint64_t seed);
bool is_plain_flights(const std::filesystem::path& path);

// Of each fault the counts, and the interval of the hazardous share with 95 % confidence.
std::string plain_table(const std::map<std::uint64_t, PlainFlights>& counted);

}  // namespace nadir::bench
