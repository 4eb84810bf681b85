// One flight from start to stop.
//
//   camera ──frames──► localization ──estimates──► link ──GPS_INPUT──► autopilot
//     │                    │    │                  ▲ │
//     └──────events────────┴────┼──────────────────┼─┘ telemetry
//                               ▼                  │
//                            conductor ────────────┘ status: fix or no fix, accuracy
//                               │
//                               ├──► journal: recorder, event list, operator
//                               ├──► board: API, web page, watch
//                               └──► upkeep (a thread of its own: disks may be slow): state directory, and what
//                                    could not be started: API, recorder, candidate tiles
//
// The conductor is run(), twenty times a second on the caller's thread. It owns the state machine and the assessment of
// GPS; all other threads publish OnboardEvents (service/onboard_event.hpp) and never wait for it.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "api/api.hpp"
#include "flight/autopilot_link.hpp"
#include "flight/camera_feed.hpp"
#include "flight/flight_journal.hpp"
#include "flight/localization_thread.hpp"
#include "flight/mission_map.hpp"
#include "flight/tile_making.hpp"
#include "flight/view_builder.hpp"
#include "geodesy/lon_lat.hpp"
#include "service/awaited_parts.hpp"
#include "service/gps_health.hpp"
#include "service/machine_health.hpp"
#include "service/onboard_event.hpp"
#include "service/retried_part.hpp"
#include "service/saved_flight.hpp"
#include "service/service_machine.hpp"
#include "service/stop_signals.hpp"
#include "service/watchdog.hpp"
#include "vision/camera.hpp"

namespace nadir {

// The options of nadird.
struct FlightOptions {
  std::filesystem::path package;
  Airframe airframe;
  std::filesystem::path state;                              // folder
  std::string camera;                                       // open_camera()
  std::optional<std::filesystem::path> camera_credentials;  // with_credentials()
  std::string autopilot;                                    // parse_endpoint()
  std::vector<StationSetup> stations;                       // besides the autopilot
  std::optional<std::filesystem::path> link_key;            // nullopt: the links are not signed
  std::optional<std::filesystem::path> record;              // folder; nullopt: no recording
  bool keep_pictures = false;                               // in the recording
  std::optional<std::filesystem::path> candidates;          // folder for candidate tiles; nullopt: none are made
  std::optional<std::filesystem::path> tile_key;  // signs the tiles; without candidates: the key was not accepted
  std::int64_t candidates_mb = 2000;              // disk budget of the tiles
  int candidates_percent = 25;                    // of one core, for the tiles
  int candidates_frame_ms = 0;                    // for the tiles of one frame; 0: no limit
  std::string listen = "127.0.0.1:8750";
  // File with the API's bearer token. nullopt: on loopback everybody may read, and hints need a token that is made in
  // the state folder.
  std::optional<std::filesystem::path> token;
  std::optional<LonLat> start;
  double anchor_every_m = 0;
  bool send_external_position = false;  // MAV_CMD_EXTERNAL_POSITION_ESTIMATE for each anchor, besides GPS_INPUT
};

// The package as it was verified, or why it was rejected.
struct VerifiedPackage {
  std::unique_ptr<OpenPackage> package;  // null: rejected
  Findings findings;
  std::filesystem::path folder{};                 // of the package; empty: that of the options
  std::optional<AcceptanceRecord> acceptance{};   // kept in the state directory; nullopt: nothing is
  bool resumed = false;                           // accepted earlier, and not judged anew
  std::string notice{};                           // what the operator must know about the choice, in a sentence
  std::string notice_text{};                      // and as a STATUSTEXT
  std::function<void()> write_memory = nullptr;   // of accepted packages; throws, and is tried again
  std::function<bool()> can_be_opened = nullptr;  // asked now and then when there is no package
  std::int64_t root_version = 0;                  // of the root that it was verified by; 0: resumed, not verified now
};

enum class FlightEnd {
  stopped,
  judge_again,  // the aircraft stands on the ground, or a package can be opened now: choose the package anew
};

class FlightService {
 public:
  using Log = std::function<void(const std::string& line)>;  // for the system's log; from the caller's thread

  // Throws Error for what is needed to fly at all, UsageError for options that cannot be right. Everything else is
  // tried again in flight (service/retried_part.hpp).
  FlightService(const FlightOptions& options, VerifiedPackage verified, const FlightClock& clock, StopSignals& stop,
                Log log = nullptr);
  ~FlightService();

  // Until stop is requested, or the package must be judged again.
  FlightEnd run();
  std::string summary() const;                                                       // after run()
  const std::optional<AcceptanceRecord>& acceptance() const { return acceptance_; }  // after run()

 private:
  struct TimedReceiver {
    double time_s = 0;
    GpsRaw gps;
  };

  // Start
  LocalizationSetup localization_setup() const;
  void start_recorder();
  void start_api();
  std::unique_ptr<CameraSource> opened_camera() const;
  void start_localization();
  void start_tiles();
  void start_link();
  void start_camera(std::unique_ptr<CameraSource> source);

  // On the threads of the parts
  void publish(OnboardEvent event);  // from any thread
  void on_localized(const LocalizedFrame& frame);
  void on_message(double now_s, const ReceivedMessage& message);
  void upkeep_loop(const std::stop_token& stop);
  void upkeep(double now_s);
  void save_state();
  void on_command(const ReceivedMessage& received, const CommandInt& command);
  void record_fix(double now_s, const GpsInput& sent, SourceLabel source);

  // The conductor
  void note_start();
  void note_end();
  void on_event(double time_s, const OnboardEvent& event);
  void react(double time_s, const FixJumped& jumped);
  void react(double time_s, const LinkRivalHeard& rival);
  void react(double time_s, const PositionHinted& hint);
  void react(double time_s, const GpsFix3d& fix);
  void react(double time_s, const LocalizedFrame& frame);
  void react(double time_s, const AutopilotHeartbeat& heartbeat);
  void react(double time_s, const PartReported& reported);
  void react(double time_s, const PackageRestored& restored);
  void react(double time_s, const CameraFailed& failed);
  void react(double time_s, const TileCorrupt& tile);
  void on_transitions(std::span<const StateTransition> transitions);
  void assess_gps(double now_s);
  void update_view(double now_s);
  void save(double now_s);
  void report_corrupt_tiles();
  AwaitedParts awaited_parts() const;
  MailboxCounts frame_counts() const;

  FlightOptions options_;
  const FlightClock& clock_;
  StopSignals& stop_;
  Airframe airframe_;
  std::string rejection_;
  Findings warnings_;  // of the verification
  OperatorTexts operator_texts_;
  std::unique_ptr<MissionMap> map_;  // null: the package was rejected
  StateDirectory state_;
  Restart restart_;
  Log log_;
  std::string notice_, notice_text_;
  bool resumed_ = false, judge_again_ = false;
  std::optional<AcceptanceRecord> acceptance_;  // of the conductor
  FlightPhase phase_;

  ServiceMachine machine_;
  GpsHealth gps_;
  GpsVerdict gps_verdict_ = GpsVerdict::unknown;
  GpsHints gps_hints_;
  ViewBuilder views_;
  FlightBoard board_;
  LatestSlot<Hint> api_hints_;
  LatestMailbox<TimedEvent> events_{512};
  LatestMailbox<SavedFlight> to_save_;
  std::optional<LocalizedFrame> last_frame_;
  std::string last_reason_, recorder_error_;
  std::string camera_failure_;             // the last one
  std::size_t corrupt_tiles_ = 0;          // reported
  std::optional<TimedReceiver> receiver_;  // the link's thread
  MachineHealth health_;                   // the thread of the state directory

  // Parts that are tried again, on the upkeep thread. What others use of them is published as a pointer when it is
  // there, and stays until the end.
  RetriedPart state_part_{"state directory"}, memory_part_{"memory of packages"}, signing_part_{"signing time"},
      api_part_{"API"}, recorder_part_{"recorder"}, tiles_part_{"candidate tiles"};
  RetriedPart disk_part_{"recorder's disk"};    // of the conductor
  RetriedPart making_part_{"candidate tiles"};  // of the tiles' thread
  LatestMailbox<AcceptanceRecord> acceptances_;
  std::optional<SavedFlight> unsaved_flight_;  // of the upkeep thread
  std::optional<AcceptanceRecord> unsaved_acceptance_;
  bool state_prepared_ = false;
  std::function<void()> write_memory_;
  std::function<bool()> can_be_opened_;
  double next_open_s_ = 0, open_pause_s_ = kFirstRetry_s;

  std::unique_ptr<Recorder> recorder_owner_;
  std::atomic<Recorder*> recorder_{nullptr};
  std::unique_ptr<FlightJournal> journal_;
  ServiceManager manager_;
  ThreadWatch watch_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<HttpServer> server_;
  LatestMailbox<CapturedFrame> frames_;
  std::unique_ptr<AutopilotLink> link_;
  std::unique_ptr<TileMaking> tiles_owner_;
  std::atomic<TileMaking*> tiles_{nullptr};  // null: none are made
  std::int64_t root_version_ = 0;            // of VerifiedPackage
  std::unique_ptr<LocalizationThread> localization_;
  std::unique_ptr<CameraFeed> camera_;
  std::jthread upkeep_thread_;  // last: it uses everything above
};

}  // namespace nadir
