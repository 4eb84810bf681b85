// The localizer's two threads. The tracker processes each frame at once: decoding, telemetry, odometry, estimate. The
// matcher matches frames to the map, which takes longer; its result applies to the frame that it was made from. So the
// path of a frame waits for no map match, no disk and no reader.
//
//   camera ─► LatestMailbox ─► tracker ─► estimate at once
//                               │  ▲
//                           job ▼  │ anchor
//                              matcher
//
// Given the order of the localizer's follow(), finish() and hint(), which the recorder keeps, a replay gives the same
// estimates bit for bit.
#pragma once

#include <atomic>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "base/bytes.hpp"
#include "estimation/localizer.hpp"
#include "flight/telemetry_buffer.hpp"
#include "recorder/records.hpp"
#include "service/mailbox.hpp"
#include "service/onboard_event.hpp"
#include "service/watchdog.hpp"

namespace nadir {

struct CapturedFrame {
  std::string name;
  Bytes encoded;
  double captured_s = 0;  // monotonic
};

struct LocalizationSetup {
  CameraFile camera;
  Attitude mount;
  LocalFrame frame;
  const TileSource* tiles = nullptr;
  std::optional<LonLat> start;
  LocalizerConfig config;
  double plane_msl_m = 0;                                       // of the reference plane of the surface's heights
  std::vector<std::pair<std::string, std::string>> settings{};  // other than the defaults, for the recorder
  bool inertial = false;                                        // the autopilot's raw inertial samples are used
};

class LocalizationThread {
 public:
  // Called on the tracker's thread: must be quick.
  struct Listener {
    std::function<void(std::uint64_t index, const Telemetry&, ByteView encoded)> on_frame;  // before it is processed
    std::function<void(const LocalizedFrame&)> on_localized;
    std::function<void(const HintRecord&)> on_hint;  // once the localizer has it
    // On the matcher's thread: a match ended with an exception. One that was cancelled did not fail.
    std::function<void(const std::string& reason)> on_match_failed{};
  };

  // Everything that setup points at, the watch and the frames must outlive this.
  LocalizationThread(const LocalizationSetup& setup, LatestMailbox<CapturedFrame>& frames, ThreadWatch& watch,
                     Listener listener);
  ~LocalizationThread();
  LocalizationThread(const LocalizationThread&) = delete;
  LocalizationThread& operator=(const LocalizationThread&) = delete;

  // The autopilot's telemetry, from the link's thread.
  template <typename Message>
  void on_message(double time_s, const Message& message) {
    const std::scoped_lock lock(telemetry_mutex_);
    telemetry_.on_message(time_s, message);
  }

  // Where to search first (Localizer::hint), from the operator or a trusted GPS; `source` is for the record. Invalid
  // places are ignored. Of several between two frames the last one counts. A search of the whole area in progress is
  // cancelled: the next frame is searched for where the hint points.
  void hint(const LonLat& at, double radius_m, const std::string& source);

  // Frames that were dropped because they could not be decoded: damaged, of another size than the camera's, or made so
  // that decoding them takes too long. From any thread.
  std::uint64_t undecodable() const { return undecodable_; }

  // Both threads end soon: a map match in progress is cancelled and not reported.
  void request_stop();

 private:
  void track_frames(const std::stop_token& stop);
  void match_to_map(const std::stop_token& stop);
  void process(const CapturedFrame& frame);
  bool awaits_attitude(const CapturedFrame& frame, const Telemetry& telemetry);
  void apply_finished_match();
  void apply_hint();
  Telemetry telemetry_at(const CapturedFrame& frame);

  LocalizationSetup setup_;
  int shrink_;
  CameraModel decoded_;  // at the decoded size
  LatestMailbox<CapturedFrame>& frames_;
  Listener listener_;

  std::mutex telemetry_mutex_;
  TelemetryBuffer telemetry_;

  // Of the tracker's thread.
  Localizer localizer_;
  std::uint64_t next_index_ = 0, job_index_ = 0;
  std::optional<double> first_captured_s_;  // of all frames, processed or not
  PlanePoint position_{};
  bool has_position_ = false;     // with the last frame
  bool position_hinted_ = false;  // position_ is that of a hint
  Telemetry last_telemetry_;
  OdometryReport last_odometry_;

  bool searches_everywhere_ = false;  // the job in progress searches the whole area

  std::atomic<std::uint64_t> undecodable_{0};
  std::atomic<bool> cancel_job_{false};
  LatestMailbox<HintRecord> hints_;
  LatestMailbox<std::unique_ptr<AnchorJob>> jobs_, finished_;  // at most one in progress: nothing is ever dropped
  ThreadWatch::Beat tracker_beat_, matcher_beat_;
  std::jthread matcher_, tracker_;  // last: they use everything above
};

}  // namespace nadir
