// A flight that is open, and the thread that processes its pictures as they arrive.
//
//   LiveFlight flight(id, FlightStore::open(folder), folder, …);
//   flight.accept(batch);          // stored; processed as soon as it is this flight's turn
//   flight.request_completion();   // when the pictures so far are processed: refined estimates, then adjusted ones
//
// There is one engine per flight at a time. Engines of several flights take turns, frame by frame, for a few slots
// (EngineSlots): a long flight does not hold up a short one. What must survive a kill is in the store; a wish to
// complete the flight is a file beside it until it is fulfilled.
//
// The adjustment of a completed flight may take minutes. It lets other flights take turns, and gives up when new
// pictures arrive: these come first, and the wish to complete the flight stands.
//
// Why the first pictures match nowhere is found once; whether it holds depends on the segments. Both are in the events.
//
// Where processing ends in an error (a picture is missing, the disk is full), the flight is blocked until something
// new arrives: then it is tried again.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "flights/flight_engine.hpp"
#include "flights/flight_store.hpp"
#include "flights/no_fix_diagnosis.hpp"

namespace nadir {

struct DeskPackage;
class PackageRegistry;

// So many engines may work at a time. Whoever has waited longest is next.
class EngineSlots {
 public:
  explicit EngineSlots(std::size_t count) : free_(count) {}

  bool take(const std::stop_token& stop);  // false: stopped while it waited
  void give();
  bool wanted() const;  // by somebody who waits

 private:
  mutable std::mutex mutex_;
  std::condition_variable_any news_;
  std::size_t free_;
  std::uint64_t next_ticket_ = 0;
  std::deque<std::uint64_t> waiting_;
};

enum class FlightActivity {
  idle,        // nothing to do
  waiting,     // for a slot
  processing,  // pictures
  completing,  // refined estimates, then adjusted ones
  blocked      // by an error
};
std::string_view name_of(FlightActivity activity);

struct FlightStatus {
  FlightActivity activity = FlightActivity::idle;
  std::string blocked_by;  // the error
  std::size_t accepted = 0, processed = 0;
  bool completion_requested = false;
  bool completed = false;      // refined estimates of all accepted pictures are stored
  double completed_share = 0;  // of the adjustment, while it goes on
  std::string diagnosis;       // why the first pictures match nowhere, in words; empty: they do, or nobody knows
};

class LiveFlight {
 public:
  // packages, slots: must outlive this. The engine is made when there is work.
  LiveFlight(std::string id, std::unique_ptr<FlightStore> store, const std::filesystem::path& folder,
             PackageRegistry& packages, EngineSlots& slots, MillisClock clock);
  ~LiveFlight();  // ends the frame that is being processed: it will be processed again
  LiveFlight(const LiveFlight&) = delete;
  LiveFlight& operator=(const LiveFlight&) = delete;

  const std::string& id() const { return id_; }
  const FlightStore& store() const { return *store_; }
  FlightStatus status() const;
  bool busy() const;  // works, or waits to
  // The adjusted flight as a ZIP archive (reconstruction_files.hpp); nothing while there is none.
  std::optional<std::string> reconstruction() const;

  // As FlightStore's, from any thread.
  std::vector<PictureAnswer> accept(std::span<const PictureOffer> batch);
  UserFix add_fix(const UserFix& said);
  std::optional<UserFix> withdraw_fix(std::int64_t id);
  bool take_back_merge(int segment);
  MarkedObject add_object(std::string_view name, const MarkedSighting& first, std::string_view by);
  std::optional<MarkedObject> add_sighting(std::int64_t object, const MarkedSighting& sighting);
  std::optional<MarkedObject> rename_object(std::int64_t id, std::string_view name);
  bool remove_object(std::int64_t id);
  bool remove_sighting(std::int64_t object, std::int64_t sighting);
  // Throws UsageError for a flight without pictures.
  void request_completion();

  // Grows when the flight has changed: its events are worth reading again.
  std::uint64_t changes() const { return changes_; }

 private:
  void run(const std::stop_token& stop);
  void work(const std::stop_token& stop, std::unique_ptr<FlightEngine>& engine);
  void adjust(FlightEngine& engine, const Cancel& cancel);
  std::unique_ptr<FlightEngine> make_engine();
  void watch(AnchorVerdict verdict, const std::stop_token& stop);  // of a frame that was processed
  std::string diagnose(const std::stop_token& stop) const;
  // What holds of it now: nothing once a segment is on the map, and all of it again when that is taken back.
  void review_diagnosis();
  // All floating segments, also one that more pictures may continue; search by search and look by look. False:
  // something else is to be done first.
  bool place_segments(FlightEngine& engine, const std::function<void()>& let_others, const std::stop_token& stop);
  void wake();
  bool has_work() const;  // `mutex_` held
  bool has_map() const { return !store_->description().package.empty(); }
  void set(FlightActivity activity);

  const std::string id_;
  const std::unique_ptr<FlightStore> store_;
  const std::filesystem::path completion_file_, reconstruction_file_;
  PackageRegistry& packages_;
  EngineSlots& slots_;
  const MillisClock clock_;
  std::unique_ptr<const CheckedTiles> tiles_;  // of the engine's own
  std::shared_ptr<const DeskPackage> package_;
  std::optional<FlightEngineSetup> setup_;  // of the engine
  NoFixWatch no_fix_watch_;                 // of the engine's frames
  std::atomic<double> completed_share_ = 0;

  mutable std::mutex mutex_;
  std::condition_variable_any news_;
  FlightActivity activity_ = FlightActivity::idle;
  std::string blocked_by_;
  bool completion_requested_ = false;
  bool completed_ = false;
  std::string found_diagnosis_;  // by experiment, whether it holds or not
  std::string diagnosis_;        // that holds: of the last event diagnosis_changed
  bool placement_due_ = false;   // floating segments may be there that were not tried
  std::uint64_t arrivals_ = 0;   // of pictures, fixes and wishes
  std::atomic<std::uint64_t> changes_ = 1;
  std::jthread thread_;  // last: it uses all of the above
};

// The description of a new flight, as `nadir replay` would begin it. package: null for odometry alone, which needs a
// start. Throws UsageError without both, and for a camera text that is no camera.yaml.
FlightDescription describe_flight(std::string name, std::string_view camera_text, const std::optional<LonLat>& start,
                                  const std::string& package_name, const DeskPackage* package);

}  // namespace nadir
