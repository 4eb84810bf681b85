// The offset between the clock of a camera and that of a log: log time = camera time + offset.
//
// Three witnesses, in the order of their worth:
//
//   Triggers. The log has the moments at which the camera was triggered or reported a picture. Every pair of a photo
//   and a trigger is a vote for the difference of their times; the offset with the most votes, each trigger counted
//   once, is that of the clocks. The cadence must tell: of photos every 2.00 s, all offsets of whole periods are alike,
//   and only as many photos as triggers decide between them.
//
//   UTC. Both know the date: photos by their GPS or the offset of their zone, the log by its GPS.
//
//   Turns. The change of heading between two overlapping pictures is seen in them; the log has the heading at any time.
//   The offset is where both agree:
//     χ²(o) = Σ min((Δψ_seen - Δψ_log(t_i + o, t_j + o))² / σ², c²)
//   Its mean and its sigma are those of exp(-χ²/2) within ten seconds of the best offset.
//   A flight without turns tells nothing, and a flight of equal loops tells too much: any offset
//   farther away must be clearly worse.
//
// An offset that nothing determines is not guessed.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "flight_import/flight_log.hpp"

namespace nadir {

struct ClockOffset {
  double offset_s = 0;
  double sigma_s = 0;          // one sigma
  std::size_t supporting = 0;  // photos, or pairs of them, that agree with it
  std::string from;            // for people: "37 of 38 photos have a trigger in the log"
  // Of each photo its trigger in the log, when the offset comes from triggers.
  std::vector<std::optional<std::size_t>> triggers;
};

struct ClockOffsetResult {
  std::optional<ClockOffset> offset;
  std::string why_not;  // when there is none
};

// times_s: of the photos by the camera's clock, increasing; step_s: the width within which each is uncertain (a second
// where EXIF has no fractions; the time is then its middle). expected_s: an offset near which the right one lies (from
// UTC), if known.
ClockOffsetResult offset_from_triggers(const std::vector<double>& times_s, double step_s,
                                       const std::vector<CameraTrigger>& triggers, std::optional<double> expected_s);

// What two pictures show: by how much the heading of the later one is larger.
struct SeenTurn {
  double from_s = 0, to_s = 0;  // camera times
  double turn_rad = 0;
};

ClockOffsetResult offset_from_turns(const std::vector<SeenTurn>& turns, double step_s,
                                    const std::vector<TimedAttitude>& attitudes);

}  // namespace nadir
