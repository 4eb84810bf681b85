// When a message arrived that may have waited for us.
//
// A busy computer reads late, and what has arrived meanwhile it reads at once: in a turn, an attitude of half a second
// ago is another one. The sender's stamps tell such messages apart, but count by another clock. The least of
// (read − stamp), in the last kLeastDelayOver_s or twice that, is the difference of the two clocks and the least delay.
// With it, and because whatever was there when we last read everything would have been read then,
//
//   arrived = max(stamp + min (read − stamp), last look) ≤ read
//
// Where we look often that is the time of reading, to within the time between two looks, whatever a link's delay or a
// simulator's clock do.
#pragma once

#include <cstdint>
#include <optional>

#include "mavlink/messages.hpp"

namespace nadir {

inline constexpr double kLeastDelayOver_s = 5;
inline constexpr double kMostDelay_s = 30;    // beyond: its clock is another one now
inline constexpr double kMostDisorder_s = 1;  // by which stamps may go back in messages that overtook each other

// A message's times by our monotonic clock. What it measured counts from arrived_s, what follows from it for us from
// read_s.
struct MessageTimes {
  double arrived_s;  // <= read_s
  double read_s;
};

class ArrivalTime {
 public:
  // Our monotonic seconds; read_s does not go back. last_look_s: when all that was there was read.
  double arrived_s(double last_look_s, double read_s, std::uint64_t stamp_us);

 private:
  void begin(double read_s, double delay_s);

  double last_stamp_s_ = 0, began_s_ = 0;
  std::optional<double> least_s_, least_before_s_;  // of (read − stamp), in this stretch and in the one before
};

// Microseconds of the sender's clock; nullopt: none.
std::optional<std::uint64_t> stamp_us(const IncomingMessage& message);

}  // namespace nadir
