#include "flight_import/clock_choice.hpp"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "base/plural.hpp"
#include "flight_import/picture_turns.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

// Photos that say nothing of time: as many as triggers, or nothing.
std::optional<ClockOffset> one_for_one(const PhotoSet& set, const FlightLog& log, const std::string& where,
                                       ImportReport& report) {
  if (!set.photos.empty() && log.triggers.size() == set.photos.size()) {
    ClockOffset offset{.offset_s = log.triggers.front().time_s,
                       .sigma_s = 0,
                       .supporting = set.photos.size(),
                       .from = "as many photos as triggers: one for one, in the order of their names",
                       .triggers = {}};
    for (std::size_t i = 0; i < set.photos.size(); ++i) offset.triggers.emplace_back(i);
    report.note("import.triggers", where, "times in the photos",
                "none: the log's triggers are theirs, in the order of names", "");
    return offset;
  }
  report.missing(
      "import.clock_offset", "times in the photos, or as many triggers in the log as there are photos",
      fmt::format("no times, and {} for {}", count(log.triggers.size(), "trigger"), count(set.photos.size(), "photo")),
      "--interval-s SECONDS between the photos together with --clock-offset-s SECONDS of the first one");
  return std::nullopt;
}

}  // namespace

std::optional<ClockOffset> choose_clock_offset(const PhotoSet& set, const FlightLog& log, const std::string& where,
                                               const StatedClock& stated, ImportReport& report, Progress& progress) {
  if (!set.timed) return one_for_one(set, log, where, report);
  if (stated.offset_s) {
    return ClockOffset{*stated.offset_s, 0, 0, "stated with --clock-offset-s", {}};
  }
  const auto zone_s = stated.zone_s ? stated.zone_s : set.zone_s;
  std::vector<double> times_s;
  for (const Photo& photo : set.photos) times_s.push_back(photo.camera_s);
  std::optional<double> utc_s;
  if (zone_s && log.unix_from_log_s) utc_s = -*zone_s - *log.unix_from_log_s;
  ClockOffsetResult by_triggers = offset_from_triggers(times_s, set.step_s, log.triggers, utc_s);
  if (!by_triggers.offset && utc_s) {  // the zone may be wrong
    by_triggers = offset_from_triggers(times_s, set.step_s, log.triggers, std::nullopt);
  }
  if (by_triggers.offset) return by_triggers.offset;
  const bool utc_is_exact = utc_s && !stated.zone_s && set.zone_sigma_s <= 1;
  std::optional<ClockOffset> by_utc;
  if (utc_s) {
    const double sigma_s = stated.zone_s ? 2 : set.zone_sigma_s;
    by_utc = ClockOffset{*utc_s,
                         hypotenuse(sigma_s, 0.3),
                         0,
                         "UTC of both: " + (stated.zone_s ? std::string("--zone-h") : set.zone_from),
                         {}};
    if (utc_is_exact) return by_utc;
  }
  std::vector<TimedPicture> pictures;
  for (const Photo& photo : set.photos) pictures.push_back({photo.facts.file, photo.camera_s});
  const ClockOffsetResult by_turns = offset_from_turns(seen_turns(pictures, progress), set.step_s, log.attitudes);
  if (by_turns.offset) {
    if (by_utc && std::abs(by_turns.offset->offset_s - by_utc->offset_s) > 60) {
      report.warn("import.clock_disagreement", where, fmt::format("about {:.1f} s by UTC", by_utc->offset_s),
                  fmt::format("{:.1f} s by the turns in the pictures", by_turns.offset->offset_s),
                  "the turns decide; check the camera's clock and its zone, or state --clock-offset-s SECONDS");
    }
    return by_turns.offset;
  }
  if (by_utc) {
    report.warn(
        "import.clock_offset", where, "triggers or turns that tell the offset",
        fmt::format("UTC alone, good to {:.0f} s; {}; {}", by_utc->sigma_s, by_triggers.why_not, by_turns.why_not),
        "--clock-offset-s SECONDS, if you know it better");
    return by_utc;
  }
  report.missing("import.clock_offset", "the offset between the clocks of camera and log",
                 fmt::format("triggers: {}. UTC: {}. Turns: {}", by_triggers.why_not,
                             zone_s ? "the log does not know the date" : "the photos do not say their offset from it",
                             by_turns.why_not),
                 "--clock-offset-s SECONDS (log time less camera time), or --zone-h HOURS of the camera's clock");
  return std::nullopt;
}

}  // namespace nadir
