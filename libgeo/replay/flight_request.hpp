// Which flight is replayed, and over which map: the options that `nadir replay` and `nadir ortho` share, and what both
// do with them.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "base/progress.hpp"
#include "base/time.hpp"
#include "cli/command.hpp"
#include "estimation/terrain_surface.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/lon_lat.hpp"
#include "package/open_package.hpp"
#include "replay/flight_folder.hpp"
#include "replay/poses_file.hpp"
#include "replay/recorded_flight.hpp"
#include "replay/replay_flight.hpp"
#include "vision/place_index.hpp"

namespace nadir {

struct FlightMapPaths {
  std::filesystem::path package;
  std::filesystem::path trust;  // root.json
  std::optional<std::string> airframe;
};

// The map of a replay: a package that is verified as the aircraft would verify it. No package when there are findings
// of severity refuse.
Opening open_flight_map(const FlightMapPaths& paths, UtcTime now, Progress& progress);

// All that a replay needs, each part at a stable address.
struct ReadyFlight {
  Flight flight;
  std::optional<RecordedFlight> recorded;
  std::unique_ptr<OpenPackage> package;  // null: odometry alone, or the findings refuse
  Findings findings;                     // of a package that was refused
  std::optional<TerrainSurface> surface;
  std::optional<PlaceIndex> places;
  std::optional<ReplaySetup> setup;  // points into the other members; nothing when the package was refused
};

class FlightRequest {
 public:
  // command: its name, for messages.
  explicit FlightRequest(std::string command) : command_(std::move(command)) {}

  enum class Map { optional, required };
  void declare(Options& options, Map map);

  void check() const;  // throws UsageError for options that do not go together
  // Throws UsageError for inputs that are no flight. unpacked: a folder for pictures out of a recording.
  std::unique_ptr<ReadyFlight> open(Context& context, const std::filesystem::path& unpacked);
  // What poses of this flight over its package belong to.
  PosesSubject poses_subject(const ReadyFlight& ready) const;
  // Whether an option says how to localize, which poses that are made already do not do.
  bool says_how() const { return start_ || odometry_ != kOdometry || matcher_ != kMatcher; }

  const std::optional<std::filesystem::path>& package() const { return package_; }
  const std::optional<std::filesystem::path>& trust() const { return trust_; }
  const std::optional<std::filesystem::path>& frames() const { return frames_; }
  const std::optional<std::filesystem::path>& recorder() const { return recorder_; }
  const std::optional<std::string>& airframe() const { return airframe_; }
  const std::optional<LonLat>& start() const { return start_; }
  const std::string& odometry() const { return odometry_; }
  const std::string& matcher() const { return matcher_; }
  // How it was localized, for a recording; after open().
  std::vector<std::pair<std::string, std::string>> settings() const;

 private:
  static constexpr std::string_view kOdometry = "features", kMatcher = "channels";

  Flight flight_to_fly(Context& context, const std::filesystem::path& unpacked,
                       std::optional<RecordedFlight>& recorded);

  void add_second_matcher(Context& context, const std::optional<RecordedFlight>& recorded, ReplaySetup& setup);

  std::string command_;
  std::optional<std::filesystem::path> package_;
  std::optional<std::filesystem::path> trust_;
  std::optional<std::string> airframe_;
  std::optional<UtcTime> at_;
  std::optional<std::filesystem::path> frames_, telemetry_, camera_;
  std::optional<LonLat> start_;
  std::string odometry_{kOdometry};
  std::string matcher_{kMatcher};
  std::optional<std::filesystem::path> matcher_model_;
  std::string second_matcher_{"auto"};
  std::optional<std::pair<std::string, std::string>> second_setting_;  // once the model is open
  std::optional<std::filesystem::path> recorder_;
  std::optional<std::string> session_;
};

// The same flight has the same id: 12 hexadecimal digits.
std::string id_of(const Flight& flight);

}  // namespace nadir
