// Memory that is reserved before the flight and kept: what a flight needs occasionally (wider searches, relocalization)
// must be available in the air, and a leak shows in a process of constant size.
//
// glibc's allocator serves all threads from one heap, returns nothing to the system, and serves large buffers from that
// heap too; then the heap is grown once, and every page of it is written. Measured in the closed loop at 3 FullHD
// frames per second: 20 to 50 MB in use, 138 MB at the peak.
#pragma once

#include <cstddef>

namespace nadir {

inline constexpr int kUsualMemory_mb = 192;

// Call it before the first thread starts. 0: no change. Does nothing where the C library is not glibc. Throws Error
// when the system cannot provide that much.
void hold_memory(std::size_t megabytes);

}  // namespace nadir
