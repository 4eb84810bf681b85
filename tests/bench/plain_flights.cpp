#include "plain_flights.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "counted_share.hpp"

namespace nadir::bench {
namespace {

constexpr std::string_view kPlainFormat = "# nadir bench plain flights";

}  // namespace

void FlightCounts::add(const FlightCounts& more) {
  flights += more.flights, misleading += more.misleading, hazardous += more.hazardous;
  looks += more.looks, usable += more.usable, usable_30 += more.usable_30;
}

FlightCounts count_flights(const FaultFlight& flight, int flights, std::uint64_t seed) {
  FlightCounts counts;
  for (int i = 0; i < flights; ++i) {
    Random random(hash_of(seed, i));
    FaultFlight::State end = flight.begin(random);
    while (!flight.ended(end)) flight.advance(end, random);
    counts.add({1, end.events[FaultFlight::misleading] ? 1 : 0, end.events[FaultFlight::hazardous] ? 1 : 0, end.looks,
                end.usable, end.usable_30});
  }
  return counts;
}

std::string FlightsRun::text() const {
  return fmt::format("{:g} minutes, alert limit {:g} m, risk {:g}, looks {} ({}), repeats {}", limits.minutes,
                     limits.alert_limit_m, limits.integrity_risk, looks_sha256.substr(0, 16), looks_origin,
                     repeats_sha256.substr(0, 16));
}

std::string plain_header(const FlightsRun& run) {
  return fmt::format(
      "{}, base seed {}, {} a line, {}\n"
      "index,fault,flights,misleading,hazardous,looks,usable,usable_30\n",
      kPlainFormat, run.seed, kFlightsInALine, run.text());
}

std::string line(const PlainFlights& f) {
  return fmt::format("{},{},{},{},{},{},{},{}\n", f.index, f.fault, f.counts.flights, f.counts.misleading,
                     f.counts.hazardous, f.counts.looks, f.counts.usable, f.counts.usable_30);
}

PlainFlights plain_flights_of(const std::string& text) {
  std::istringstream in(text);
  PlainFlights f;
  FlightCounts& c = f.counts;
  char comma = 0;
  in >> f.index >> comma;
  std::getline(in, f.fault, ',');
  in >> c.flights >> comma >> c.misleading >> comma >> c.hazardous >> comma >> c.looks >> comma >> c.usable >> comma >>
      c.usable_30;
  if (!in || !(in >> std::ws).eof() || !is_fault_kind(f.fault)) {
    throw Error({.what = "a line of results cannot be read",
                 .expected = "eight cells, the second one names a fault",
                 .found = text});
  }
  return f;
}

PlainFlights count_plain(const MeasuredLooks& looks, const RepeatRates& repeats, const FlightsRun& run,
                         std::uint64_t index) {
  const FaultKind& kind = kind_of(index);
  const FaultFlight flight(looks, repeats, kind, run.limits, FaultFlight::hazardous);
  return {index, kind.code,
          count_flights(flight, kFlightsInALine, hash_of(run.seed, static_cast<std::int64_t>(index)))};
}

PlainFile read_plain(const std::filesystem::path& path, std::uint64_t seed) {
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 28));
  PlainFile file;
  std::string names, text;
  std::getline(in, text);
  std::getline(in, names);
  file.header = text + "\n" + names + "\n";
  const std::string expected = fmt::format("{}, base seed {}, {} a line, ", kPlainFormat, seed, kFlightsInALine);
  if (!text.starts_with(expected)) {
    throw UsageError({.what = "not the plain flights of this base seed",
                      .where = path.string(),
                      .expected = expected,
                      .found = text.substr(0, 80),
                      .fix = "pass the --seed of their run, or --from another file"});
  }
  file.run = text.substr(expected.size());
  while (std::getline(in, text)) {
    const PlainFlights flights = plain_flights_of(text);
    file.sums[flights.fault].add(flights.counts);
  }
  return file;
}

bool is_plain_flights(const std::filesystem::path& path) {
  return read_text_file(path, std::uint64_t{1} << 28).starts_with(kPlainFormat);
}

void PlainFile::add(const PlainFile& more) {
  if (more.header != header) {
    throw UsageError({.what = "plain flights of two runs are not added up", .expected = run, .found = more.run});
  }
  for (const auto& [fault, counts] : more.sums) sums[fault].add(counts);
}

std::string PlainFile::text() const {
  std::string lines = header;
  for (const auto& [fault, counts] : sums) lines += line(PlainFlights{number_of(fault_kind(fault), 0), fault, counts});
  return lines;
}

std::string plain_table(const std::map<std::uint64_t, PlainFlights>& counted) {
  std::map<std::string, FlightCounts> sums;
  for (const auto& [index, flights] : counted) sums[flights.fault].add(flights.counts);
  std::string table =
      "| fault | flights | misleading | hazardous | P(hazardous), 95 % |\n"
      "|---|---|---|---|---|\n";
  for (const FaultKind& kind : fault_kinds()) {
    const auto found = sums.find(kind.code);
    if (found == sums.end()) continue;
    const FlightCounts& c = found->second;
    const CountedShare hazardous{c.hazardous, c.flights};
    table += fmt::format("| {} | {} | {} | {} | {:.2g} to {:.2g} |\n", kind.name, c.flights, c.misleading, c.hazardous,
                         hazardous.lower(), hazardous.upper());
  }
  return table;
}

}  // namespace nadir::bench
