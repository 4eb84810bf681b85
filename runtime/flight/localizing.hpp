// The localizer's two threads. One follows every picture at once: decode, telemetry, odometry, estimate. The other
// looks at the map, which takes longer; what it finds counts for the picture that it was taken from. So the path of a
// picture waits for no anchor, no disk and no reader.
//
//   camera ─► LatestMailbox ─► follow ─► estimate at once
//                               │  ▲
//                           job ▼  │ anchor
//                              look at the map
//
// Given the order of follow(), finish() and hint(), which the recorder keeps, everything here is the same to the last
// bit.
#pragma once

#include <atomic>
#include <functional>
#include <mutex>
#include <thread>

#include "base/bytes.hpp"
#include "estimation/localizer.hpp"
#include "flight/telemetry_buffer.hpp"
#include "recorder/records.hpp"
#include "service/latest_mailbox.hpp"
#include "service/thread_watch.hpp"

namespace nadir {

struct FlightPicture {
  std::string name;
  Bytes encoded;
  double taken_s = 0;  // monotonic
};

// What came out of one frame, or of one look at the map.
struct LocalizedFrame {
  std::uint64_t index = 0;         // of the last frame followed
  std::uint64_t anchor_index = 0;  // of the frame that report.anchor is about
  bool late = false;               // a look at the map came back; the frame itself was told before
  Telemetry told;                  // of the last frame followed
  FrameReport report;
};

struct LocalizingSetup {
  CameraFile camera;
  Attitude mount;
  LocalFrame frame;
  const TileSource* tiles = nullptr;
  std::optional<LonLat> start;
  LocalizerConfig config;
  double plane_msl_m = 0;  // of the plane from which the surface's heights count
};

class LocalizationThread {
 public:
  // Called on the localizer's thread: must be quick.
  struct Listener {
    std::function<void(std::uint64_t index, const Telemetry&, ByteView encoded)> input;  // before it is followed
    std::function<void(const LocalizedFrame&)> output;
    std::function<void(const HintRecord&)> hinted;  // once the localizer has it
  };

  // Everything that setup points at, the watch and the pictures must outlive this.
  LocalizationThread(const LocalizingSetup& setup, LatestMailbox<FlightPicture>& pictures, ThreadWatch& watch,
             Listener listener);
  ~LocalizationThread();
  LocalizationThread(const LocalizationThread&) = delete;
  LocalizationThread& operator=(const LocalizationThread&) = delete;

  // What the autopilot says, from the link's thread.
  template <typename Message>
  void hear(double time_s, const Message& message) {
    const std::scoped_lock lock(telemetry_mutex_);
    telemetry_.hear(time_s, message);
  }

  // An operator's, or that of a GPS that is trusted: where to look first (Localizer::hint). `by` is for the record.
  // What is no place is passed over. When several come between two pictures the last one counts. A search of all the
  // area that is under way is given up: the next picture is looked for where the hint points.
  void hint(const LonLat& at, double radius_m, const std::string& by);

  // Both threads end soon: a look at the map that is under way is given up, and nothing is told of it.
  void request_stop();

  int picture_shrink() const { return shrink_; }

 private:
  void follow_pictures(const std::stop_token& stop);
  void look_at_map(const std::stop_token& stop);
  void follow(const FlightPicture& picture);
  bool too_early(const FlightPicture& picture, const Telemetry& told);
  void take_finished();
  void take_hint();
  Telemetry telemetry_at(const FlightPicture& picture);

  LocalizingSetup setup_;
  int shrink_;
  CameraModel decoded_;  // as pictures are decoded
  LatestMailbox<FlightPicture>& pictures_;
  Listener listener_;

  std::mutex telemetry_mutex_;
  TelemetryBuffer telemetry_;

  // The follower's own.
  Localizer localizer_;
  std::uint64_t next_index_ = 0, job_index_ = 0;
  std::optional<double> first_taken_s_;  // of the pictures, followed or not
  PlanePoint believed_at_{};
  bool placed_ = false;         // a position was told with the last picture
  bool ground_hinted_ = false;  // believed_at_ is a hint's, and no position was told since
  Telemetry last_told_;
  OdometryReport last_odometry_;

  bool everywhere_ = false;  // the job that is out searches all of the area

  std::atomic<bool> give_up_{false};  // that job is of no use any more
  LatestMailbox<HintRecord> hints_;
  LatestMailbox<std::unique_ptr<AnchorJob>> jobs_, finished_;  // one is out at most: nothing is ever dropped
  ThreadWatch::Beat follower_beat_, looker_beat_;
  std::jthread looker_, follower_;  // last: they use everything above
};

}  // namespace nadir
