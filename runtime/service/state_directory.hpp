// The folder that carries a flight over a restart: flight.json, replaced in one step about once a second. Other parts
// keep their own files beside it (the signing time of the link, what the aircraft remembers of packages).
//
// Writing syncs to disk and may take as long as the disk likes: it belongs to the thread that keeps house, never to the
// path of a frame. A full disk costs the restart its memory, not the flight.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "service/saved_flight.hpp"

namespace nadir {

class StateDirectory {
 public:
  // Makes the folder when it is missing and sweeps up what a killed writer left. Throws Error when that is impossible:
  // better before take-off than in flight.
  explicit StateDirectory(std::filesystem::path folder);

  const std::filesystem::path& folder() const { return folder_; }

  // What went wrong, or nullopt. The file is then still the last one.
  std::optional<std::string> save(const SavedFlight& flight) const;

  // A missing, damaged or unreadable file is a refusal with its reason.
  SavedFlightReading load() const;

 private:
  std::filesystem::path file() const { return folder_ / "flight.json"; }

  std::filesystem::path folder_;
};

}  // namespace nadir
