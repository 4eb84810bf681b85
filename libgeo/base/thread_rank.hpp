// Who goes first when the computer is busy, and what a thread is called where people look (top -H, a debugger).
//
// Ranks are niceness relative to what the program was started with (Linux keeps it per thread). `ahead` needs a right
// that an ordinary program does not have (LimitNICE= of runtime/nadird.service gives it); without it the thread stays
// where it is. Against other programs it is their control groups or sessions that count, not this.
#pragma once

namespace nadir {

enum class ThreadPriority {
  ahead,   // next to no work, and somebody counts the milliseconds: fixes to the autopilot
  beside,  // as the program was started
  behind,  // may take longer while others have to do: looks at the map, the recorder, readers of the API
};

// Of the calling thread. name: at most 15 characters count.
void begin_thread(const char* name, ThreadPriority rank);

}  // namespace nadir
