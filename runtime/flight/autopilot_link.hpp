// The thread of the link: reads what the autopilot says, tells it our fixes ten times a second, and what the operator
// must know. Nothing here waits for pictures, and pictures wait for nothing here.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "flight/wake_up.hpp"
#include "mavlink/fix_predictor.hpp"
#include "mavlink/link.hpp"
#include "service/clock.hpp"
#include "service/latency_histogram.hpp"
#include "service/latest_mailbox.hpp"
#include "service/service_machine.hpp"
#include "service/thread_watch.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct AutopilotLinkSetup {
  Airframe airframe;
  std::unique_ptr<Transport> transport;
  std::optional<SigningKey> key;                      // none: simulators and the bench
  std::optional<std::filesystem::path> signing_time;  // with a key: what a restart must not reuse
};

class AutopilotLink {
 public:
  // On the link's thread; must be quick. jumped_m: the next fix lies so far from the last one. stranger: somebody
  // speaks as the autopilot, with a signature that does not count or with none; told once a second at most.
  struct Listener {
    std::function<void(double now_s, const ReceivedMessage&)> message;
    std::function<void(double jumped_m)> jumped;
    std::function<void()> stranger;
  };

  AutopilotLink(AutopilotLinkSetup setup, const FlightClock& clock, ThreadWatch& watch, Listener listener);
  ~AutopilotLink();
  AutopilotLink(const AutopilotLink&) = delete;
  AutopilotLink& operator=(const AutopilotLink&) = delete;

  void stop();  // its thread has ended then; what is sent later is lost

  // From any thread.
  // arrived_s: when its picture was there, to know how long it takes until a fix tells of it.
  void observe(const VisionEstimate& estimate, std::optional<double> arrived_s);
  void permit(const ServiceStatus& status);  // whether, and how surely, fixes may be told
  void tell(TextSeverity severity, std::string text);
  void send(OutgoingMessage message);
  void keep_signing_time();  // once a second, from a thread that has time for disks

  struct State {
    bool open = false;
    std::string trouble;  // why it is not
    LinkCounts counts;
    std::uint64_t fixes_sent = 0;
    double longest_gap_s = 0;  // between two GPS_INPUT, since they began
    std::optional<Fix> told;   // in the last of them; none: "no fix"
    LatencyHistogram latency;  // from a picture to the first fix that tells of it
  };
  State state() const;

 private:
  void run(const std::stop_token& stop);
  ServiceStatus permitted() const;
  void send_fix(double now_s, const ServiceStatus& permitted);
  void ask_for_streams(double now_s, const ReceivedMessage& message);
  void feel(double now_s, const ReceivedMessage& received);
  void tell_stranger(double now_s, MavlinkAddress claimed);
  void publish();

  Airframe airframe_;
  const FlightClock& clock_;
  Listener listener_;
  std::unique_ptr<SigningTime> signing_time_;  // null: the link is not signed
  MavlinkLink link_;
  FixPredictor predictor_;

  struct Observed {
    VisionEstimate estimate;
    std::optional<double> arrived_s;
  };
  LatestMailbox<Observed> estimates_{8};
  LatestMailbox<OutgoingMessage> outgoing_{32};
  WakeUp wake_up_;
  mutable std::mutex mutex_;
  ServiceStatus permitted_;
  State state_;

  std::optional<double> last_fix_s_, asked_s_, untold_since_s_, stranger_s_;
  ThreadWatch::Beat beat_;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
