// The result of one long flight as a line of CSV, and of all flights as a table by condition.
#pragma once

#include "safety_record.hpp"

namespace nadir::bench {

struct LongRecord : Record {
  int within_20 = 0, within_50 = 0;                  // frames this close to the truth, online …
  int refined_within_20 = 0, refined_within_50 = 0;  // … and after the flight
  int refined_in_95 = 0;                             // in the ellipse, after the flight
  int losses = 0;                                    // odometry failed, or the frame was missing
  int recovered = 0;                                 // of these: anchored again
  int longest_recovery = 0;                          // usable frames until then
  double error_sum_m = 0;                            // of the frames with a position
};

std::string long_header(std::uint64_t base_seed, int worlds, int frames);
std::string line(const LongRecord& record);
LongRecord long_record_of(const std::string& line);  // throws Error when it is none

std::string long_summary(const std::map<std::uint64_t, LongRecord>& records);

}  // namespace nadir::bench
