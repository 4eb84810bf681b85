// Which offset between the clocks of camera and log an import goes by: what was stated, else the best of the witnesses
// that there are (clock_offset.hpp), and a warning where they disagree or are weak.
#pragma once

#include <optional>
#include <string>

#include "base/progress.hpp"
#include "flight_import/clock_offset.hpp"
#include "flight_import/import_report.hpp"
#include "flight_import/photo_set.hpp"

namespace nadir {

struct StatedClock {
  std::optional<double> offset_s;  // log time less camera time
  std::optional<double> zone_s;    // camera time less UTC
};

// where: the log, for people. Nothing when it is not known, which the report then says.
std::optional<ClockOffset> choose_clock_offset(const PhotoSet& set, const FlightLog& log, const std::string& where,
                                               const StatedClock& stated, ImportReport& report, Progress& progress);

}  // namespace nadir
