// The fixes of a recorded flight, made again from the replayed estimates and the recorded inputs of the fix stream
// (fixes/fix_stream.hpp), and compared with those that were sent.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "estimation/terrain_surface.hpp"
#include "replay/recorded_flight.hpp"

namespace nadir {

struct FixComparison {
  // Fixes that cannot be compared, and why. They count neither as identical nor as different.
  struct Interval {
    double from_s = 0, to_s = 0;  // of the first and the last of them
    std::size_t fixes = 0;
    std::string reason;
  };
  struct Difference {
    double time_s = 0;
    std::string field;  // as in fixes.csv; "fix" when there is none on one side
    std::string recorded, replayed;
  };

  std::size_t compared = 0, identical = 0;  // bit for bit, the aircraft's real receiver aside
  std::optional<Difference> first;
  std::vector<Interval> not_compared;
};

struct ReplayedFixes {
  std::vector<FixRecord> fixes;  // with the recorded words of the real receiver
  FixComparison comparison;
};

// estimates: of the replay, in their order. terrain: of the package; null: the ground's height, and so that of the
// fixes, is not known. Any recording: of records that are missing, or contradict each other, the
// comparison tells. Inputs build on each other, so that nothing can be compared after the first that is missing.
ReplayedFixes replay_fixes(const RecordedFlight& recorded, const std::vector<EstimateRecord>& estimates,
                           const TerrainSurface* terrain);

std::string text_of(const FixComparison::Difference& difference);
std::string text_of(const FixComparison::Interval& interval);

}  // namespace nadir
