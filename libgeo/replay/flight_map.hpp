// The map that a replay flies with: a package that was verified as the aircraft would verify it.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "base/progress.hpp"
#include "base/time.hpp"
#include "estimation/localizer.hpp"
#include "geodesy/local_frame.hpp"
#include "package/open_package.hpp"
#include "replay/report.hpp"

namespace nadir {

struct FlightMapPaths {
  std::filesystem::path package;
  std::filesystem::path trust;  // root.json
  std::optional<std::string> airframe;
};

// No package when the findings refuse.
Opening open_flight_map(const FlightMapPaths& paths, UtcTime now, Progress& progress);

// The imagery around the track for the report; nothing where the map has no pixels there.
std::optional<ReportMap> report_map(const TileSource& tiles, const LocalFrame& frame, PlaneBox track);

}  // namespace nadir
