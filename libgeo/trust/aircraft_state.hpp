// What an aircraft remembers from one package to the next, so that it accepts neither an older package nor an older
// root nor a clock that was set back. A small JSON file that is replaced in one step.
//
// A clock may be wrong, and nothing that is remembered goes down by itself: one acceptance by a clock that runs years
// ahead would refuse every right one for years. So the remembered time follows a clock only for a bounded way beyond a
// date that was signed, and a signed permit takes it back (time_permit.hpp).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "base/time.hpp"

namespace nadir {

inline constexpr std::uint64_t kMaxStateSize = std::uint64_t{1} << 22;

// The remembered time is at most so far beyond the day on which an accepted package was made. Chosen: packages are
// flown in the weeks after they were made, and an aircraft whose clock ran ahead is grounded no longer than that.
inline constexpr std::int64_t kMaxTrustedLead_s = std::int64_t{30} * 86'400;

struct AircraftState {
  std::map<std::string, std::int64_t> highest_sequence;   // accepted, by series
  std::map<std::string, std::int64_t> airframe_sequence;  // highest accepted of airframe.json, by airframe
  std::int64_t root_version = 0;                          // 0: none seen
  std::optional<UtcTime> last_trusted_time;
  // Documents of the roots that came with packages, by version, with their signatures: each is verified again from the
  // installed root on, so that the state alone cannot appoint a signer.
  std::map<std::int64_t, std::string> roots;

  // Remembers an accepted package. Nothing ever goes down.
  // at: no later than remembered_time() says.
  void accept(const std::string& series, std::int64_t sequence, std::int64_t root, UtcTime at,
              const std::map<std::int64_t, std::string>& newer_roots = {});
  // The same of an airframe file whose signature is good: an unsigned one could claim any number.
  void accept_airframe(const std::string& airframe, std::int64_t sequence);
};

// What to remember of an acceptance by that clock, of a package that was made then.
UtcTime remembered_time(UtcTime clock, UtcTime package_created);

// `state` is set exactly when there is no finding. Finding state.corrupt: a damaged state must not pass for an empty
// one.
struct StateReading {
  std::optional<AircraftState> state;
  Findings findings;
};
StateReading parse_state(std::string_view json, std::string_view name);

// A file that does not exist is a new aircraft: the empty state. Throws Error when the file cannot be read.
StateReading check_state(const std::filesystem::path& path);

// The same, but throws Error with the finding.
AircraftState read_state(const std::filesystem::path& path);
void write_state(const std::filesystem::path& path, const AircraftState& state);

}  // namespace nadir
