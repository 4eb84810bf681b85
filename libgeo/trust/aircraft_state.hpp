// What an aircraft remembers from one package to the next, so that it accepts neither an older package nor an older root
// nor a clock that was set back. A small JSON file that is replaced in one step.
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

struct AircraftState {
  std::map<std::string, std::int64_t> highest_sequence;  // accepted, by series
  std::map<std::string, std::int64_t> airframe_sequence;  // highest accepted of airframe.json, by airframe
  std::int64_t root_version = 0;                         // 0: none seen
  std::optional<UtcTime> last_trusted_time;
  // Documents of the roots that came with packages, by version, with their signatures: each is verified again from the
  // installed root on, so that the state alone cannot appoint a signer.
  std::map<std::int64_t, std::string> roots;

  // Remembers an accepted package. Nothing ever goes down.
  void accept(const std::string& series, std::int64_t sequence, std::int64_t root, UtcTime at,
              const std::map<std::int64_t, std::string>& newer_roots = {});
  // The same of an airframe file whose signature is good: an unsigned one could claim any number.
  void accept_airframe(const std::string& airframe, std::int64_t sequence);
};

// `state` is set exactly when there is no finding. Finding state.corrupt: a damaged state must not pass for an empty one.
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
