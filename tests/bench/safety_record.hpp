// The result of one segment as a line of CSV, and of all segments as a table.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "stanford.hpp"

namespace nadir::bench {

// Motions that odometry measured from frame to frame, used or refused, against the truth.
struct MotionCounts {
  std::array<int, 8> numbers{};
  static std::size_t index(bool few_inliers, bool used, bool wrong) {
    return (few_inliers ? 4U : 0U) + (used ? 2U : 0U) + (wrong ? 1U : 0U);
  }
};

struct Record {
  std::uint64_t index = 0;
  std::string condition;
  int frames = 0;
  int attempts = 0;         // frames that were matched
  int accepted = 0;         // anchors
  int wrong = 0;            // of these more than 50 m from the truth
  int anchored = 0;         // frames labelled satellite_anchored
  int misleading = 0;       // of these more than 3 sigma from the truth
  int unknowable = 0;       // wrong or misleading because the map is out of place by less than the start is unsure
  int positioned = 0;       // frames with a position
  int overconfident = 0;    // of these, under another label, more than 3 sigma from the truth
  int in_50 = 0;            // of these within the 50 % ellipse …
  int in_95 = 0;            // … and the 95 % one
  double nees = 0;          // sum over the anchored frames
  double worst_sigmas = 0;  // largest error of an anchored frame
  double worst_m = 0;
  MotionCounts motions;
  std::vector<LeveledError> levels;  // of the positions that have a protection level

  bool violates() const { return wrong > 0 || misleading > 0; }
};

// Two lines: what it is, and the columns. second: what SecondMatcherOptions names.
std::string header(std::uint64_t base_seed, int worlds, const std::string& second);
std::string line(const Record& record);

Record record_of(const std::string& line);  // throws Error when it is none

// Protection levels by condition, and all of them: for a Stanford diagram.
std::string level_summary(const std::map<std::uint64_t, Record>& records);
// Wrong motions by condition: how many are used, how many refused.
std::string motion_summary(const std::map<std::uint64_t, Record>& records);
std::vector<LeveledError> all_levels(const std::map<std::uint64_t, Record>& records);

// A table by condition, and beneath it every violation with its index.
std::string summary(const std::map<std::uint64_t, Record>& records, std::uint64_t base_seed);

}  // namespace nadir::bench
