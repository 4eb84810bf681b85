// The thread of the links: receives the autopilot's telemetry, sends our fixes ten times a second and the operator's
// texts. It never waits for a camera frame, and no frame waits for it.
//
//   link            receives                                     sends
//   autopilot       telemetry of the configured autopilot,       everything
//                   commands that are addressed to us
//   ground station  commands that are addressed to us            heartbeat, texts, figures, answers to commands
//   logger          nothing                                      everything
//
// Fixes go to the configured autopilot and to loggers, whoever else sends on a link (mavlink/link.hpp). The autopilot's
// first HEARTBEAT says in which messages (fixes/autopilot_backend.hpp); one that is not supported gets none.
#pragma once

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "fixes/autopilot_backend.hpp"
#include "fixes/fix_stream.hpp"
#include "flight/arrival_time.hpp"
#include "flight/gps_fusion_switch.hpp"
#include "flight/parameter_watch.hpp"
#include "mavlink/link.hpp"
#include "service/clock.hpp"
#include "service/mailbox.hpp"
#include "service/service_machine.hpp"
#include "service/watchdog.hpp"
#include "vision/camera.hpp"

namespace nadir {

// Interrupts another thread's poll(). An eventfd: any number of calls wake it once.
class WakeUp {
 public:
  WakeUp() : fd_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    if (fd_ >= 0) return;
    throw Error({.what = "cannot create an event descriptor",
                 .found = system_error_text(errno),
                 .fix = "raise the limit of open files"});
  }
  ~WakeUp() { ::close(fd_); }
  WakeUp(const WakeUp&) = delete;
  WakeUp& operator=(const WakeUp&) = delete;

  void call() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = ::write(fd_, &one, sizeof one);  // full: already woken
  }

  // Until call(), an event of one of these (descriptor -1: none), or the timeout.
  void wait(std::vector<pollfd> waited, int at_most_ms) const {
    waited.push_back({fd_, POLLIN, 0});
    ::poll(waited.data(), waited.size(), at_most_ms);
    std::uint64_t calls = 0;
    [[maybe_unused]] const auto taken = ::read(fd_, &calls, sizeof calls);
  }

 private:
  int fd_;
};

// Durations in bins of a millisecond: constant memory however long the flight.
class LatencyHistogram {
 public:
  void add(double seconds) {
    const double ms = std::clamp(std::floor(seconds * 1000), 0.0, static_cast<double>(bins_.size() - 1));
    ++bins_[static_cast<std::size_t>(ms)];
    ++count_;
    largest_s_ = std::max(largest_s_, seconds);
  }

  std::uint64_t count() const { return count_; }
  double largest_s() const { return largest_s_; }

  // Upper end of the bin of this quantile; 0 without any. Durations above two seconds count as two.
  double quantile_s(double share) const {
    const double wanted = share * static_cast<double>(count_);
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < bins_.size() && count_ != 0; ++i) {
      sum += bins_[i];
      if (static_cast<double>(sum) >= wanted) return static_cast<double>(i + 1) / 1000;
    }
    return 0;
  }

 private:
  std::array<std::uint32_t, 2000> bins_{};
  std::uint64_t count_ = 0;
  double largest_s_ = 0;
};

enum class StationRole { ground_station, logger };

std::string_view name_of(StationRole role);

// Another end that we serve besides the autopilot.
struct StationSetup {
  StationRole role = StationRole::ground_station;
  std::string endpoint;  // parse_endpoint()
};

struct AutopilotLinkSetup {
  Airframe airframe;
  std::unique_ptr<Transport> transport;
  std::optional<SigningKey> key;  // of all links; none: simulators and the bench
  // With a key: the folder with what a restart must know, our own timestamps ("signing-time") and those of each link's
  // peers ("signing-streams", "signing-streams-1", …).
  std::optional<std::filesystem::path> state{};
  std::vector<StationSetup> stations{};
  bool switch_gps = false;  // PX4: GPS leaves its filter while it is not to be trusted (gps_fusion_switch.hpp)
};

class AutopilotLink {
 public:
  // Called on the link's thread: must be quick.
  struct Listener {
    std::function<void(const MessageTimes&, const ReceivedMessage&)> on_message;
    std::function<void(double distance_m)> on_jump;  // the next fix lies so far from the last one
    // A peer claims to be the autopilot without a valid signature; at most once a second.
    std::function<void()> on_unauthenticated_peer;
    // Somebody at another address claims to be the autopilot; at most once in ten seconds.
    std::function<void(std::uint64_t frames)> on_rival{};
    // A fix was due: inputs.sent says whether it went out, with a position or as "no fix", which PX4 is told by
    // silence.
    std::function<void(DueFix due)> on_fix{};
    // What the comparison of parameters found (parameter_watch.hpp): ParameterChanged, ParametersMissing,
    // AutopilotVersionChanged, ParametersCompared.
    std::function<void(OnboardEvent)> on_parameters{};
  };

  AutopilotLink(AutopilotLinkSetup setup, const FlightClock& clock, ThreadWatch& watch, Listener listener);
  ~AutopilotLink();
  AutopilotLink(const AutopilotLink&) = delete;
  AutopilotLink& operator=(const AutopilotLink&) = delete;

  // Once: the thread begins. A listener may use the link, and so its owner must have it before. The link has been tried
  // when this returns: state() says why it is closed.
  void start();
  void stop();  // joins the thread; later messages are lost

  // From any thread.
  // which: of the localizer's estimates, for the record. arrived_s: when its frame arrived, to measure the latency of
  // fixes.
  void on_estimate(const FixInputRecord::ArrivedEstimate& which, const VisionEstimate& estimate,
                   std::optional<double> arrived_s);
  void on_status(const ServiceStatus& status);  // whether fixes may be sent, and their accuracy; GPS
  void send_text(TextSeverity severity, std::string text);
  void send(OutgoingMessage message);
  // In flight once a second, from a thread that may wait for disks; at a clean end after stop().
  void save_signing_state(StreamTimestamps::When when);
  // PX4 with switch_gps: its filter does not fuse GPS, and its glitch alarm says nothing of GPS as it is now.
  bool gps_is_off() const { return gps_is_off_; }
  std::vector<std::string> faults() const;  // of the saved signing state, as it was read
  std::string signing_time_failure() const { return signing_time_ ? signing_time_->failure() : std::string(); }

  struct State {
    bool open = false;
    std::string error;      // why it is closed
    std::string autopilot;  // "PX4", by its heartbeat; empty before
    bool supported = true;  // false: it gets no fixes
    std::string missing;    // why it gets no fixes yet
    LinkCounts counts;
    std::uint64_t fixes_sent = 0;              // with a position, and handed to the transport
    double longest_gap_s = 0;                  // between two fixes, "no fix" included
    std::optional<Fix> last_fix;               // in the last of them; nullopt: "no fix"
    std::optional<double> last_message_s;      // when the autopilot's last message arrived
    std::optional<AircraftAttitude> attitude;  // its last one
    std::optional<double> attitude_s;          // when that arrived
    LatencyHistogram latency;                  // from the arrival of a frame to the first fix that uses it
    struct Station {
      StationRole role = StationRole::ground_station;
      std::string endpoint;
      bool open = false;
      std::string error;  // why it is closed
      std::uint64_t sent = 0, commands = 0;
    };
    std::vector<Station> stations;
  };
  State state() const;

  // Why the autopilot of this state is not connected, for people.
  static std::string why_silent(const State& state, bool is_signed);

 private:
  void run(const std::stop_token& stop);
  void receive(double now_s);
  ServiceStatus status() const;
  void send_fix(double now_s, const ServiceStatus& status);
  void recognize_autopilot(double now_s, const ReceivedMessage& message);
  void compare_parameters(double now_s, const IncomingMessage& message);
  void request_streams(double now_s, const ReceivedMessage& message);
  void note_message(double now_s, const ReceivedMessage& received);
  double arrived_s(double now_s, const ReceivedMessage& received);
  void predict_motion(double arrived_s, const ReceivedMessage& received);
  void report_unauthenticated_peer(double now_s, MavlinkAddress claimed);
  void report_rivals(double now_s);
  void send_everywhere(const OutgoingMessage& message, std::int64_t now_us);
  void advance_stations(double now_s);
  void wait_for_input(int at_most_ms) const;
  void publish();

  Airframe airframe_;
  const FlightClock& clock_;
  Listener listener_;
  std::unique_ptr<SigningTime> signing_time_;  // null: the links are not signed
  std::unique_ptr<StreamTimestamps> streams_;  // of the autopilot's link
  MavlinkLink link_;

  struct Station {
    StationSetup setup;
    std::unique_ptr<StreamTimestamps> streams;
    MavlinkLink link;
    std::uint64_t commands = 0;
  };
  std::vector<Station> stations_;
  FixStream fixes_;
  std::unique_ptr<AutopilotBackend> backend_;
  bool recognized_ = false;  // by a heartbeat
  ParameterWatch parameters_;
  ParameterCheck parameter_check_;  // as it was reported
  std::optional<GpsFusionSwitch> gps_switch_;
  std::atomic<bool> gps_is_off_ = false;

  struct ArrivedEstimate {
    FixInputRecord::ArrivedEstimate which;
    VisionEstimate estimate;
    std::optional<double> arrived_s;
  };
  LatestMailbox<ArrivedEstimate> estimates_{8};
  LatestMailbox<OutgoingMessage> outgoing_{32};
  WakeUp wake_up_;
  mutable std::mutex mutex_;
  ServiceStatus status_;
  State state_;

  std::map<std::uint8_t, ArrivalTime> arrivals_;  // by component, of our system
  std::optional<double> last_look_s_, last_fix_s_, requested_s_, unsent_since_s_, unauthenticated_s_, rivals_s_;
  std::uint64_t rivals_ = 0;  // reported
  ThreadWatch::Beat beat_;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
