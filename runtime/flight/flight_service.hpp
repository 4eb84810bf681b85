// One flight from start to stop: the parts of the service, put together.
//
//   camera ──pictures──► localizer ──estimates──► link ──GPS_INPUT──► autopilot
//     │                    │    │                  ▲ │
//     └──────news──────────┴────┼──────────────────┼─┘ telemetry
//                               ▼                  │
//                            conductor ────────────┘ permission: fix or no fix, how sure
//                               │
//                               ├──► journal: recorder, events
//                               ├──► board: API, web page, watch
//                               └──► state directory (its own thread: disks may be slow)
//
// The conductor is this object's run(), twenty times a second on the caller's thread. It owns the state machine and the
// verdict about GPS; everybody else sends it news and never waits for it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "api/api.hpp"
#include "flight/autopilot_link.hpp"
#include "flight/camera_feed.hpp"
#include "flight/flight_facts.hpp"
#include "flight/flight_ground.hpp"
#include "flight/flight_journal.hpp"
#include "flight/flight_options.hpp"
#include "flight/localizing.hpp"
#include "flight/operator_texts.hpp"
#include "flight/tile_making.hpp"
#include "flight/view_builder.hpp"
#include "service/gps_health.hpp"
#include "service/gps_hints.hpp"
#include "service/restart.hpp"
#include "service/state_directory.hpp"
#include "service/stop_signals.hpp"
#include "service/watchdog.hpp"

namespace nadir {

// The package as it was verified, or why it was refused.
struct JudgedPackage {
  std::unique_ptr<OpenPackage> package;  // null: refused
  Findings findings;
};

class FlightService {
 public:
  // Throws Error for what must be right before take-off: files that cannot be read, an address that is taken.
  FlightService(const FlightOptions& options, JudgedPackage judged, const FlightClock& clock, StopSignals& stop);
  ~FlightService();

  // Until stop is asked for.
  void run();
  std::string summary() const;  // after run(): how it went

 private:
  LocalizingSetup localizing_setup() const;
  void note_cautions();
  void start_recorder();
  void start_flight();
  void start_localizing();
  void start_tiles();
  void localized(const LocalizedFrame& frame);
  void heard(double now_s, const ReceivedMessage& message);
  void record(const LocalizedFrame& frame);
  void tell(FlightNews news);

  void sum_up();
  MailboxCounts picture_counts() const;
  void take(const TimedNews& timed);
  void learn(double time_s, const AutopilotEvent& spoke);
  void learn(double time_s, const CameraEvent& spoke);
  void learn(double time_s, const LocalizerEvent& spoke);
  void learn(double time_s, const StateNotSaved& state);
  void learn(double time_s, const TilesNotMade& tiles);
  void learn(double time_s, const FixJumped& jumped);
  void learn(double time_s, const PlaceHinted& hinted);
  void learn(double time_s, const GpsFix3d& fix);
  void learn(double time_s, const EkfReport& report);
  void judge_gps(double now_s);
  void update(double now_s, std::span<const ServiceFact> facts);
  void publish(double now_s);
  void save(double now_s);
  void save_state_loop(const std::stop_token& stop);

  FlightOptions options_;
  const FlightClock& clock_;
  StopSignals& stop_;
  Airframe airframe_;
  std::string refusal_;
  Findings cautions_;  // that refused nothing
  OperatorTexts untold_;
  std::unique_ptr<FlightGround> ground_;  // null: the package was refused
  StateDirectory state_;
  Restart restart_;

  ServiceMachine machine_;
  GpsHealth gps_;
  GpsJudged gps_judged_;
  ViewBuilder views_;
  FlightBoard board_;
  LatestSlot<Hint> hints_;
  LatestMailbox<TimedNews> news_{512};
  LatestMailbox<SavedFlight> to_save_;
  std::optional<LocalizerEvent> last_spoke_;
  std::string last_reason_;
  GpsHints gps_hints_;

  std::string recorder_trouble_;
  std::unique_ptr<Recorder> recorder_;
  std::unique_ptr<FlightJournal> journal_;
  ServiceManager manager_;
  ThreadWatch watch_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<HttpServer> server_;
  LatestMailbox<FlightPicture> pictures_;
  std::unique_ptr<AutopilotLink> link_;
  std::unique_ptr<TileMaking> tiles_;  // null: none are made
  std::unique_ptr<LocalizationThread> localizing_;
  std::unique_ptr<CameraFeed> camera_;
  std::jthread house_;  // last: it uses everything above
};

}  // namespace nadir
