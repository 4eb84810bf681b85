// One flight from start to stop.
//
//   camera ──frames──► localization ──estimates──► link ──GPS_INPUT──► autopilot
//     │                    │    │                  ▲ │
//     └──────events────────┴────┼──────────────────┼─┘ telemetry
//                               ▼                  │
//                            conductor ────────────┘ status: fix or no fix, accuracy
//                               │
//                               ├──► journal: recorder, event list, operator
//                               ├──► optional parts: recorder, API with page and watch, candidate tiles
//                               └──► upkeep (a thread of its own: disks may be slow): state directory, and parts that
//                                    could not be started
//
// The conductor is run(), twenty times a second on the caller's thread. It owns the state machine and the assessment of
// GPS; all other threads publish OnboardEvents (service/onboard_event.hpp) and never wait for it.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimation/second_opinion.hpp"
#include "flight/autopilot_link.hpp"
#include "flight/camera_feed.hpp"
#include "flight/flight_journal.hpp"
#include "flight/hint_intake.hpp"
#include "flight/localization_thread.hpp"
#include "flight/mission_map.hpp"
#include "flight/optional_parts.hpp"
#include "flight/upkeep.hpp"
#include "flight/video_stream_finder.hpp"
#include "flight/view_builder.hpp"
#include "geodesy/lon_lat.hpp"
#include "service/acceptance_record.hpp"
#include "service/awaited_parts.hpp"
#include "service/gps_health.hpp"
#include "service/mailbox.hpp"
#include "service/onboard_event.hpp"
#include "service/position_hints.hpp"
#include "service/retried_part.hpp"
#include "service/saved_flight.hpp"
#include "service/service_machine.hpp"
#include "service/service_rules.hpp"
#include "service/stop_signals.hpp"
#include "service/watchdog.hpp"
#include "vision/camera.hpp"

namespace nadir {

// The options of nadird.
struct FlightOptions {
  std::filesystem::path package;
  Airframe airframe;
  std::filesystem::path state;                              // folder
  std::string camera;                                       // open_camera(), or mavlink_camera()
  std::optional<std::filesystem::path> camera_credentials;  // with_credentials()
  std::string autopilot;                                    // parse_endpoint()
  std::vector<StationSetup> stations;                       // besides the autopilot
  std::optional<std::filesystem::path> link_key;            // nullopt: the links are not signed
  RecordingOptions recording;
  CandidateOptions candidates;
  ApiEndpoint api;
  std::optional<LonLat> start;
  double anchor_every_m = 0;
  std::shared_ptr<DenseDescriptorNetwork> second_matcher;  // null: none
  SecondMatcherUse second_matcher_use = SecondMatcherUse::automatic;
  bool inertial = false;                // the autopilot's raw inertial samples are used
  bool switch_gps = false;              // PX4: GPS leaves its filter while it is denied or spoofed
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
  reselect_package,  // the aircraft stands on the ground, or a package can be opened now: choose the package anew
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
  std::string summary() const;                                                              // after run()
  const std::optional<AcceptanceRecord>& acceptance() const { return acceptance_.record; }  // after run()

 private:
  // What was decided about the package before the start.
  struct PackageDecision {
    Findings findings;                // of the verification
    std::string rejection;            // empty: accepted
    std::string notice, notice_text;  // for the operator: a sentence, and as a STATUSTEXT
    bool resumed = false;
  };
  // What was accepted, and whether that still holds.
  struct Acceptance {
    FlightPhase phase;
    std::optional<AcceptanceRecord> record;  // nullopt: nothing is kept
    bool reselect_package = false;
  };
  struct GpsAssessing {
    GpsHealth health;
    GpsVerdict verdict = GpsVerdict::unknown;  // the last one
    GpsHints hints{};
  };
  // What the parts said last.
  struct LastReports {
    std::optional<LocalizedFrame> frame;
    std::string camera_failure, recorder_failure;
    std::size_t corrupt_tiles = 0;  // so many were reported
  };
  struct TimedReceiver {
    double time_s = 0;
    GpsRaw gps;
  };

  // Start
  LocalizationSetup localization_setup();
  void make_parts(VerifiedPackage verified);
  std::unique_ptr<CameraSource> opened_camera() const;
  void start_localization();
  void start_link();
  void start_camera(std::unique_ptr<CameraSource> source);

  // On the threads of the parts
  void publish(OnboardEvent event);  // from any thread
  void on_localized(const LocalizedFrame& frame);
  void on_message(const MessageTimes& times, const ReceivedMessage& message);
  void on_gimbal(const MessageTimes& times, MavlinkAddress source, const GimbalAttitude& attitude);
  void on_command(double now_s, const ReceivedMessage& received);
  void record_fix(DueFix due);

  // The conductor
  void note_start();
  void note_end();
  void on_event(double time_s, const OnboardEvent& event);
  void react(double time_s, const FixJumped& jumped);
  void react(double time_s, const LinkRivalSeen& rival);
  void react(double time_s, const ParameterChanged& changed);
  void react(double time_s, const ParametersMissing& missing);
  void react(double time_s, const AutopilotVersionChanged& changed);
  void react(double time_s, const PositionHinted& hint);
  void react(double time_s, const HintRefused& refused);
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
  void send_figures(double now_s);
  void ask_for_hint(double now_s);
  void save(double now_s);
  void report_corrupt_tiles();
  AwaitedParts awaited_parts() const;
  MailboxCounts frame_counts() const;

  FlightOptions options_;
  const FlightClock& clock_;
  StopSignals& stop_;
  Log log_;
  Airframe airframe_;  // with the attitude's uncertainty as it is flown
  PackageDecision package_;
  std::unique_ptr<MissionMap> map_;  // null: the package was rejected
  Restart restart_;

  // Of the conductor.
  Acceptance acceptance_;
  ServiceMachine machine_;
  GpsAssessing gps_;
  ViewBuilder views_;
  FlightJournal journal_{nullptr};
  OperatorTexts operator_texts_;
  RetriedPart disk_part_{"recorder's disk"};
  LastReports last_;
  bool armed_ = false;  // by the last authentic heartbeat
  HintRequest hint_request_;
  ServiceManager manager_;

  LatestMailbox<TimedEvent> events_{512};               // from all threads
  std::optional<TimedReceiver> receiver_;               // of the link's thread
  std::optional<HintIntake> hint_intake_;               // of the link's thread
  std::atomic<double> gimbal_s_ = -kAwaitedAfter_s;     // when its last attitude came
  std::atomic<bool> position_known_ = false;            // for the link's thread: a position of ours may be sent
  AutopilotType autopilot_ = AutopilotType::ardupilot;  // of the link's thread: by the last heartbeat
  ThreadWatch watch_;
  LatestMailbox<CapturedFrame> frames_;

  std::unique_ptr<VideoStreamFinder> stream_finder_;  // null: the camera's source is named, not found

  // A thread uses the parts above its own: they are destroyed from the last one.
  std::unique_ptr<OptionalParts> parts_;
  std::unique_ptr<AutopilotLink> link_;
  std::unique_ptr<LocalizationThread> localization_;  // null without a map, as the camera
  std::unique_ptr<CameraFeed> camera_;
  std::unique_ptr<Upkeep> upkeep_;
};

}  // namespace nadir
