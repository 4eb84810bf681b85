#include "replay/truth.hpp"

#include <fmt/format.h>

#include <cmath>
#include <unordered_map>

#include "base/csv.hpp"
#include "base/error.hpp"

namespace nadir {

Truth read_truth(const std::filesystem::path& path, const std::vector<Telemetry>& frames) {
  const CsvTable table = CsvTable::read(path);
  const std::size_t frame = table.required_column("frame");
  const std::size_t lat = table.required_column("lat_deg");
  const std::size_t lon = table.required_column("lon_deg");
  std::unordered_map<std::string, std::size_t> index;
  for (std::size_t i = 0; i < frames.size(); ++i) index.emplace(frames[i].frame, i);

  Truth truth(frames.size());
  std::size_t matched = 0;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const std::string where = fmt::format("{}:{}", path.string(), table.line_of(row));
    const auto found = index.find(table.cell(row, frame));
    if (found == index.end()) continue;  // truth of a longer flight
    if (truth[found->second]) {
      throw UsageError({.what = fmt::format("frame {} has two positions", found->first), .where = where});
    }
    const LonLat place{table.required_number(row, lon), table.required_number(row, lat)};
    if (std::abs(place.lon_deg) > 180 || std::abs(place.lat_deg) > 90) {
      throw UsageError({.what = "no such place on Earth",
                        .where = where,
                        .expected = "lat_deg in -90 to 90, lon_deg in -180 to 180",
                        .found = fmt::format("{}, {}", place.lat_deg, place.lon_deg)});
    }
    truth[found->second] = place;
    ++matched;
  }
  if (matched == 0) {
    throw UsageError({.what = "the truth knows none of the flight's frames",
                      .where = path.string(),
                      .expected = fmt::format("frames like {}", frames.front().frame),
                      .fix = "give the truth of this flight, or leave --truth out"});
  }
  return truth;
}

}  // namespace nadir
