// The desk: a root folder with flights and map packages, and the flights that are open.
//
//   ROOT/flights/ID/      a stored flight each (flights/flight_store.hpp)
//   ROOT/packages/NAME/   map packages (package_registry.hpp)
//   ROOT/imports/ID/      photos that are not a flight yet (photo_imports.hpp)
//   ROOT/missions/ID/     missions that are being planned (planning/planning_room.hpp)
//   ROOT/lock             held while a desk uses the folder
//
// Few flights are open at a time (DeskLimits::live_flights): one that is needed takes the place of the one that has
// been idle and unused for longest. A flight with pictures that are not processed yet goes on after a restart by
// itself. Whatever a call has returned is stored: a kill at any moment loses nothing of it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "base/input_file.hpp"
#include "desk/live_flight.hpp"
#include "desk/package_registry.hpp"
#include "desk/photo_imports.hpp"
#include "planning/planning_room.hpp"

namespace nadir {

struct DeskLimits {
  std::size_t flights = 1000;     // in the root folder
  std::size_t live_flights = 16;  // open at a time
  std::size_t engines = 1;        // frames that are processed at a time, of different flights
  std::size_t packages = 100;     // that are listed
  std::uint64_t keep_free_bytes = std::uint64_t{1} << 30;
  PictureLimits pictures;
  ImportLimits imports;
};

struct DeskOptions {
  std::filesystem::path root;
  std::optional<std::filesystem::path> trust;  // root of trust for packages
  MillisClock clock = system_clock_millis;
  std::function<UtcTime()> judged_at;   // the time as of which packages must be valid
  std::function<std::string()> new_id;  // 12 hexadecimal digits
  DeskLimits limits;
  FlightStoreOptions store;       // its limits are those of `limits`
  std::optional<UtcTime> at;      // as of which commands evaluate packages; the present by default
  MapSourceOptions sources;       // of packages; its trust is `trust`
  std::filesystem::path program;  // nadir, whose commands make packages; empty: this program itself
};

std::string random_flight_id();

struct NewFlight {
  std::string name;
  std::string package;  // empty: odometry alone
  std::string camera_text;
  std::optional<LonLat> start;
};

struct FlightSummary {
  std::string id, name, package;
  UtcMillis created;
  FlightStatus status;
  std::string damaged;  // why it cannot be opened; then only the id is known
};

// An import as a flight; without one where something is missing.
struct FinishedImport {
  ImportResult result;
  std::shared_ptr<LiveFlight> flight;
  std::vector<PictureAnswer> answers;
};

// No place is free for another open flight now: all are at work.
class DeskBusy : public Error {
 public:
  using Error::Error;
};

class DeskService {
 public:
  // Creates the folders. Throws UsageError when another desk uses the root, Error when it cannot be written.
  explicit DeskService(DeskOptions options);
  ~DeskService();  // frames that are being processed are processed again next time
  DeskService(const DeskService&) = delete;
  DeskService& operator=(const DeskService&) = delete;

  const DeskLimits& limits() const { return options_.limits; }
  PackageRegistry& packages() { return packages_; }

  // Throws UsageError for a package that cannot be used, a camera that is none, too many flights; OutOfSpace.
  std::shared_ptr<LiveFlight> create(const NewFlight& flight);
  // Null: there is no such flight. Throws DeskBusy, and Error for one that cannot be opened.
  std::shared_ptr<LiveFlight> open(std::string_view id);
  std::vector<FlightSummary> list();  // the newest first
  FlightSummary summary(const LiveFlight& flight) const;

  PlanningRoom& planning() { return planning_; }
  UtcTime judged_at() const { return options_.judged_at(); }

  PhotoImports& imports() { return imports_; }
  // The photos of an import as a flight, whose camera is a draft where none is given. The import is removed then.
  // Throws as create() and PhotoImports::import(); when it is called again after that, or after a kill, it goes on.
  FinishedImport finish_import(std::string_view id, NewFlight flight, const ImportRequest& stated);

  // Throws OutOfSpace when storing so many bytes would leave less than is to be kept free.
  void check_space(std::uint64_t bytes) const;

 private:
  using Live = std::list<std::shared_ptr<LiveFlight>>;
  void read_flights();
  void resume_flights(const std::stop_token& stop);
  std::shared_ptr<LiveFlight> find_live(std::string_view id);                                    // `mutex_` held
  bool make_room();                                                                              // `mutex_` held
  std::shared_ptr<LiveFlight> adopt(std::unique_ptr<FlightStore> store, const std::string& id);  // `mutex_` held
  std::filesystem::path folder_of(std::string_view id) const;

  const DeskOptions options_;
  FileDescriptor lock_;
  PackageRegistry packages_;
  PhotoImports imports_;
  PlanningRoom planning_;
  EngineSlots slots_;
  mutable std::mutex mutex_;
  std::map<std::string, FlightSummary, std::less<>> known_;  // every flight, as it was when it was last open
  std::vector<std::string> unfinished_;                      // with work to do, and not open
  Live live_;                                                // the one used last is the first
  std::jthread resuming_;
};

}  // namespace nadir
