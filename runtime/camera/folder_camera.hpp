// A folder into which another program writes pictures, one file each.
//
// A picture is handed out when its writer has closed it or moved it into place, and only when it is whole: never half
// written. Of those that wait the first by name goes first. A file that was closed cut off is told as trouble and
// handed out when its writer comes back and finishes it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "camera/camera_source.hpp"
#include "camera/folder_watch.hpp"
#include "service/clock.hpp"

namespace nadir {

// What lies in the folder when it is opened. In flight it is old: it shows where the aircraft was, not where it is.
enum class Backlog { skip, newest, all };

class FolderCamera final : public CameraSource {
 public:
  FolderCamera(std::filesystem::path folder, const FlightClock& clock, Backlog backlog = Backlog::skip);

  // A folder that is missing or goes away is trouble until it is there again.
  CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) override;

  std::string describe() const override { return "folder " + folder_.string(); }

 private:
  // Which state of which file: tells a picture from its successor under the same name.
  struct Version {
    std::int64_t modified_ns = 0;
    std::uint64_t size = 0;
    std::uint64_t inode = 0;
    std::string name{};

    bool operator==(const Version&) const = default;
  };

  static std::optional<Version> version_of(const std::filesystem::path& file);

  std::optional<CameraReading> open();
  void look_at_folder(bool all);
  std::optional<CameraReading> take(const std::string& name, double time_s);

  std::filesystem::path folder_;
  const FlightClock& clock_;
  Backlog backlog_;
  std::unique_ptr<FolderWatch> watch_;
  std::map<std::string, double> waiting_;  // by name: when it was noticed
  Version last_;                           // handed out
};

}  // namespace nadir
