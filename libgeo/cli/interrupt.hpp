// Ctrl-C as a flag that working code looks at, so that it can stop cleanly and leave nothing behind.
#pragma once

namespace nadir {

// SIGINT and SIGTERM set the flag; a second one ends the process at once. SIGPIPE is ignored: a closed pipe shows as a
// failed stream.
void install_signal_handlers();

bool interrupt_requested();
void request_interrupt(bool wanted);  // for tests

void throw_if_interrupted();  // throws Interrupted

}  // namespace nadir
