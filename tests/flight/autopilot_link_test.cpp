// The link's thread over a real socket, with a clock that stands still until the test moves it. A heartbeat a second
// says that a turn of the thread is over: what was due at that time has been sent before it.
#include "flight/autopilot_link.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <map>
#include <mutex>
#include <thread>

#include "flight/link_peer.hpp"
#include "geodesy/local_frame.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace {

constexpr LonLat kPlace{8.5, 47.4};

class HeldClock final : public FlightClock {
 public:
  double monotonic_s() const override {
    ++asking_;
    const std::scoped_lock lock(gate_);
    --asking_;
    return now_s_;
  }
  std::int64_t unix_us() const override { return 1'760'000'000'000'000 + static_cast<std::int64_t>(now_s_ * 1e6); }
  const std::string& boot_id() const override { return boot_id_; }
  bool wait_until(double, std::stop_token) const override { return false; }
  void go_on(double seconds) { now_s_ = now_s_ + seconds; }

  // Who asks for the time waits for as long as this is there; somebody does when it returns.
  std::unique_lock<std::mutex> hold() {
    std::unique_lock held(gate_);
    while (asking_ == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return held;
  }

 private:
  std::atomic<double> now_s_{100};
  mutable std::atomic<int> asking_ = 0;
  mutable std::mutex gate_;
  std::string boot_id_ = "boot";
};

class AutopilotLinkTest : public ::testing::Test {
 protected:
  explicit AutopilotLinkTest(Airframe airframe = {}) {
    airframe.system = 7;
    airframe.gps_id = 1;
    AutopilotLinkSetup setup{airframe, make_transport(parse_endpoint(peer_.endpoint())), std::nullopt};
    setup.switch_gps = true;
    link_ = std::make_unique<AutopilotLink>(
        std::move(setup), clock_, watch_,
        AutopilotLink::Listener{[this](const MessageTimes& times, const ReceivedMessage& message) {
                                  const std::scoped_lock lock(mutex_);
                                  received_.emplace_back(times.arrived_s, message);
                                },
                                [this](double metres) {
                                  const std::scoped_lock lock(mutex_);
                                  jumps_m_.push_back(metres);
                                },
                                {},
                                {},
                                [this](DueFix due) {
                                  const std::scoped_lock lock(mutex_);
                                  due_.push_back(std::move(due));
                                },
                                [this](OnboardEvent event) {
                                  const std::scoped_lock lock(mutex_);
                                  parameter_events_.push_back(std::move(event));
                                }});
    link_->start();
    peer_.listen_until([&] { return heartbeats() == 1; });
  }

  std::size_t heartbeats() const { return peer_.received(MAVLINK_MSG_ID_HEARTBEAT).size(); }

  // A second passes, and everything that was due in it has arrived: one fix, if fixes are sent at all.
  void second() {
    const std::size_t before = heartbeats();
    clock_.go_on(1);
    peer_.listen_until([&] { return heartbeats() > before; });
  }

  void see(LonLat place, double sigma_m) {
    seen_.push_back({.time_us = static_cast<std::int64_t>(clock_.monotonic_s() * 1e6),
                     .place = place,
                     .sigma_m = sigma_m,
                     .speed_sigma_mps = 0.1,
                     .msl_m = 600,
                     .vertical_sigma_m = 3});
    link_->on_estimate({seen_.size() - 1, false}, seen_.back(), clock_.monotonic_s());
  }

  void permit(bool serves, bool fix, double sigma_m) {
    ServiceStatus status;
    status.state = ServiceState::normal;
    status.serves_fixes = serves;
    status.fix = fix;
    status.sigma_m = sigma_m;
    status.source = SourceLabel::vo_extrapolated;
    link_->on_status(status);
  }

  void autopilot_beats(std::uint8_t autopilot) {
    mavlink_message_t message;
    mavlink_msg_heartbeat_pack(7, 1, &message, MAV_TYPE_FIXED_WING, autopilot, 0, 0, MAV_STATE_ACTIVE);
    peer_.send(message);
  }

  // Message ids and intervals that were asked for.
  std::multimap<int, float> asked() const {
    std::multimap<int, float> streams;
    for (const mavlink_message_t& message : peer_.received(MAVLINK_MSG_ID_COMMAND_LONG)) {
      mavlink_command_long_t command;
      mavlink_msg_command_long_decode(&message, &command);
      EXPECT_EQ(command.command, MAV_CMD_SET_MESSAGE_INTERVAL);
      EXPECT_EQ(command.target_system, 7);
      EXPECT_EQ(command.target_component, 1);
      streams.emplace(static_cast<int>(command.param1), command.param2);
    }
    return streams;
  }

  HeldClock clock_;
  ThreadWatch watch_{clock_};
  test::LinkPeer peer_;
  std::mutex mutex_;
  std::vector<std::pair<double, ReceivedMessage>> received_;
  std::vector<double> jumps_m_;
  std::vector<VisionEstimate> seen_;
  std::vector<DueFix> due_;
  std::vector<OnboardEvent> parameter_events_;
  std::unique_ptr<AutopilotLink> link_;
};

TEST_F(AutopilotLinkTest, RequestsStreamsAtTheFirstHeartbeatAndAgainLater) {
  autopilot_beats(MAV_AUTOPILOT_INVALID);  // a ground station
  second();
  EXPECT_TRUE(asked().empty());
  autopilot_beats(MAV_AUTOPILOT_ARDUPILOTMEGA);
  second();
  second();  // what was asked for has gone out
  const auto streams = asked();
  EXPECT_EQ(streams.size(), 9U);
  ASSERT_EQ(streams.count(MAVLINK_MSG_ID_ATTITUDE), 1U);
  EXPECT_EQ(streams.find(MAVLINK_MSG_ID_ATTITUDE)->second, 40'000);
  ASSERT_EQ(streams.count(MAVLINK_MSG_ID_RAW_IMU), 1U);
  EXPECT_EQ(streams.find(MAVLINK_MSG_ID_RAW_IMU)->second, 25'000);
  autopilot_beats(MAV_AUTOPILOT_ARDUPILOTMEGA);
  second();
  second();
  EXPECT_EQ(asked().size(), 9U) << "not with every heartbeat";
  for (int i = 0; i < 10; ++i) second();
  autopilot_beats(MAV_AUTOPILOT_ARDUPILOTMEGA);
  second();
  second();
  EXPECT_EQ(asked().size(), 18U) << "it may have been started anew";
}

class GimbalLinkTest : public AutopilotLinkTest {
 protected:
  GimbalLinkTest() : AutopilotLinkTest(on_gimbal()) {}
  static Airframe on_gimbal() {
    Airframe airframe;
    airframe.gimbal = GimbalAddress{154, 0};
    return airframe;
  }
};

TEST_F(GimbalLinkTest, TheGimbalIsAskedForItsAttitude) {
  autopilot_beats(MAV_AUTOPILOT_ARDUPILOTMEGA);
  second();
  second();
  int asked = 0;
  for (const mavlink_message_t& message : peer_.received(MAVLINK_MSG_ID_COMMAND_LONG)) {
    mavlink_command_long_t command;
    mavlink_msg_command_long_decode(&message, &command);
    if (command.target_component != 154) continue;
    ++asked;
    EXPECT_EQ(command.command, MAV_CMD_SET_MESSAGE_INTERVAL);
    EXPECT_EQ(command.param1, MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS);
    EXPECT_EQ(command.param2, 40'000);
  }
  EXPECT_EQ(asked, 1);
}

TEST_F(AutopilotLinkTest, Px4IsRecognizedAndGetsItsOwnMessages) {
  autopilot_beats(MAV_AUTOPILOT_PX4);
  permit(true, true, 3);
  see(kPlace, 3);
  second();
  second();
  EXPECT_EQ(link_->state().autopilot, "PX4");
  EXPECT_NE(link_->state().missing, "") << "its version is not known";
  EXPECT_EQ(peer_.received(MAVLINK_MSG_ID_GLOBAL_POSITION_SENSOR).size(), 0U);
  mavlink_message_t message;
  mavlink_autopilot_version_t version{};
  version.flight_sw_version = 0x011200FF;
  mavlink_msg_autopilot_version_encode(7, 1, &message, &version);
  peer_.send(message);
  second();
  see(kPlace, 3);
  second();
  second();
  const auto sent = peer_.received(MAVLINK_MSG_ID_GLOBAL_POSITION_SENSOR);
  ASSERT_FALSE(sent.empty());
  mavlink_global_position_sensor_t position;
  mavlink_msg_global_position_sensor_decode(&sent.front(), &position);
  EXPECT_EQ(position.id, 2);  // gps_id 1
  EXPECT_NEAR(position.lat * 1e-7, kPlace.lat_deg, 1e-6);
  EXPECT_TRUE(peer_.fixes().empty()) << "GPS_INPUT is ArduPilot's";
  EXPECT_EQ(link_->state().missing, "");
}

TEST_F(AutopilotLinkTest, KnowsWhetherPx4FusesGps) {
  autopilot_beats(MAV_AUTOPILOT_PX4);
  second();
  EXPECT_FALSE(link_->gps_is_off());
  for (const int control : {0, 7}) {
    mavlink_message_t message;
    mavlink_param_value_t value{};
    std::memcpy(&value.param_value, &control, sizeof control);
    value.param_type = MAV_PARAM_TYPE_INT32;
    std::strncpy(value.param_id, "EKF2_GPS_CTRL", sizeof value.param_id);
    mavlink_msg_param_value_encode(7, 1, &message, &value);
    peer_.send(message);
    second();
    EXPECT_EQ(link_->gps_is_off(), control == 0);
  }
}

// PX4 as its parameters are provisioned: it answers requests for those that it has, and is set.
class ProvisionedPx4 : public AutopilotLinkTest {
 protected:
  ProvisionedPx4() : AutopilotLinkTest(provisioned()) {}
  static Airframe provisioned() {
    Airframe airframe;
    airframe.parameters = {{"EKF2_AGP1_CTRL", 1}, {"EKF2_GPS_CTRL", 7}};
    return airframe;
  }

  void send_value(const std::string& name) {
    mavlink_message_t message;
    mavlink_param_value_t value{};
    std::memcpy(&value.param_value, &has_.at(name), sizeof(std::int32_t));
    value.param_type = MAV_PARAM_TYPE_INT32;
    std::strncpy(value.param_id, name.c_str(), sizeof value.param_id);
    mavlink_msg_param_value_encode(7, 1, &message, &value);
    peer_.send(message);
  }

  void send_version(std::uint32_t flight_software) {
    mavlink_message_t message;
    mavlink_autopilot_version_t version{};
    version.flight_sw_version = flight_software;
    mavlink_msg_autopilot_version_encode(7, 1, &message, &version);
    peer_.send(message);
  }

  // A second with a heartbeat and answers to what came in it.
  void fly(int seconds, GpsVerdict gps = GpsVerdict::unknown) {
    for (int i = 0; i < seconds; ++i) {
      ServiceStatus status;
      status.serves_fixes = true;
      status.gps = gps;
      link_->on_status(status);
      autopilot_beats(MAV_AUTOPILOT_PX4);
      second();
      for (const auto requests = peer_.received(MAVLINK_MSG_ID_PARAM_REQUEST_READ); read_ < requests.size(); ++read_) {
        char name[17] = {};
        mavlink_msg_param_request_read_get_param_id(&requests[read_], name);
        if (has_.contains(name)) send_value(name);
      }
      for (const auto sets = peer_.received(MAVLINK_MSG_ID_PARAM_SET); set_ < sets.size(); ++set_) {
        char name[17] = {};
        mavlink_msg_param_set_get_param_id(&sets[set_], name);
        const float wire = mavlink_msg_param_set_get_param_value(&sets[set_]);
        std::memcpy(&has_.at(name), &wire, sizeof wire);
        send_value(name);
      }
    }
  }

  template <class Event>
  std::vector<Event> events() {
    std::vector<Event> found;
    const std::scoped_lock lock(mutex_);
    for (const OnboardEvent& event : parameter_events_) {
      if (const auto* one = std::get_if<Event>(&event)) found.push_back(*one);
    }
    return found;
  }

  std::map<std::string, std::int32_t> has_{{"EKF2_AGP1_CTRL", 1}, {"EKF2_GPS_CTRL", 7}};

 private:
  std::size_t read_ = 0, set_ = 0;
};

TEST_F(ProvisionedPx4, IsComparedAndAVersionThatTakesOurPositionOtherwiseIsReported) {
  fly(2);
  send_version(0x011200FF);
  fly(2);
  ASSERT_FALSE(events<ParametersCompared>().empty());
  EXPECT_EQ(events<ParametersCompared>().back().check, ParameterCheck::as_provisioned);
  send_version(0x011000FF);
  fly(1);
  ASSERT_EQ(events<AutopilotVersionChanged>().size(), 1U);
  EXPECT_EQ(events<AutopilotVersionChanged>().front().version, "1.16.0");
  EXPECT_EQ(events<ParametersCompared>().back().check, ParameterCheck::deviating);
}

TEST_F(ProvisionedPx4, AParameterThatItDoesNotHaveIsReported) {
  fly(1);
  send_version(0x011200FF);
  has_.erase("EKF2_AGP1_CTRL");
  fly(20);
  ASSERT_EQ(events<ParametersMissing>().size(), 1U);
  EXPECT_EQ(events<ParametersMissing>().front().names, std::vector<std::string>{"EKF2_AGP1_CTRL"});
  EXPECT_EQ(events<ParametersCompared>().back().check, ParameterCheck::deviating);
}

TEST_F(ProvisionedPx4, GpsThatWeTakeOutOfItsFilterIsNoDeviation) {
  fly(1, GpsVerdict::trusted);
  send_version(0x011200FF);
  fly(3, GpsVerdict::trusted);
  fly(5, GpsVerdict::spoofed);
  EXPECT_EQ(has_.at("EKF2_GPS_CTRL"), 0);
  EXPECT_TRUE(link_->gps_is_off());
  fly(5, GpsVerdict::trusted);
  EXPECT_EQ(has_.at("EKF2_GPS_CTRL"), 7);
  EXPECT_TRUE(events<ParameterChanged>().empty());
  ASSERT_EQ(events<ParametersCompared>().size(), 1U);
  EXPECT_EQ(events<ParametersCompared>().back().check, ParameterCheck::as_provisioned);
  has_["EKF2_GPS_CTRL"] = 5;
  send_value("EKF2_GPS_CTRL");
  second();
  ASSERT_EQ(events<ParameterChanged>().size(), 1U) << "somebody else's change";
  EXPECT_EQ(events<ParameterChanged>().front().found, 5);
}

// Silence is PX4's "no fix".
TEST_F(ProvisionedPx4, SilenceIsNoFixThatWasSent) {
  fly(1);
  send_version(0x011200FF);
  fly(5);
  EXPECT_EQ(link_->state().missing, "");
  EXPECT_EQ(link_->state().fixes_sent, 0U);
  see(kPlace, 3);
  permit(true, true, 3);
  second();
  second();
  link_->stop();
  peer_.listen();
  EXPECT_EQ(link_->state().fixes_sent, peer_.received(MAVLINK_MSG_ID_GLOBAL_POSITION_SENSOR).size());
  EXPECT_GT(link_->state().fixes_sent, 0U);
}

TEST(AutopilotLinkState, APortThatCannotBeOpenedIsKnownOnceTheLinkIsStarted) {
  const HeldClock clock;
  ThreadWatch watch(clock);
  AutopilotLinkSetup setup{.airframe = {},
                           .transport = make_transport(parse_endpoint("serial:/dev/nadir-no-such-port:57600")),
                           .key = std::nullopt};
  AutopilotLink link(std::move(setup), clock, watch,
                     {[](const MessageTimes&, const ReceivedMessage&) {}, [](double) {}, {}, {}});
  link.start();
  EXPECT_FALSE(link.state().open);
  EXPECT_EQ(AutopilotLink::why_silent(link.state(), true),
            "serial:/dev/nadir-no-such-port:57600: No such file or directory");
  AutopilotLink::State open = link.state();
  open.error.clear();
  EXPECT_EQ(AutopilotLink::why_silent(open, true), "no heartbeat with a valid signature");
  EXPECT_EQ(AutopilotLink::why_silent(open, false), "no heartbeat");
}

// What came in while the thread had no processor: else an attitude of a second ago would be that of now.
TEST_F(AutopilotLinkTest, MessagesThatWaitedHaveTheTimesAtWhichTheyArrived) {
  const auto send = [this](std::uint32_t boot_ms) {
    mavlink_message_t message;
    mavlink_msg_attitude_pack(7, 1, &message, boot_ms, 0.1F, 0.2F, 0.3F, 0, 0, 0);
    peer_.send(message);
  };
  const auto arrived = [this] {
    const std::scoped_lock lock(mutex_);
    std::vector<double> times_s;
    for (const auto& [time_s, message] : received_) times_s.push_back(time_s);
    return times_s;
  };
  send(5000);
  while (arrived().empty()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  {
    const auto held = clock_.hold();
    for (std::uint32_t i = 1; i < 100; ++i) send(5000 + 10 * i);  // more than are read at once
    clock_.go_on(1);
  }
  while (arrived().size() < 100) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  for (std::size_t i = 0; i < 100; ++i) EXPECT_NEAR(arrived()[i], 100 + 0.01 * static_cast<double>(i), 1e-9);
}

TEST_F(AutopilotLinkTest, AnotherAutopilotGetsNothing) {
  autopilot_beats(MAV_AUTOPILOT_PPZ);
  permit(true, true, 3);
  see(kPlace, 3);
  second();
  second();
  EXPECT_FALSE(link_->state().supported);
  EXPECT_EQ(link_->state().autopilot, "MAV_AUTOPILOT 9");
  EXPECT_TRUE(peer_.fixes().empty());
  EXPECT_TRUE(peer_.received(MAVLINK_MSG_ID_COMMAND_LONG).empty());
}

TEST_F(AutopilotLinkTest, PassesMessagesOn) {
  mavlink_message_t message;
  mavlink_msg_attitude_pack(7, 1, &message, 5, 0.1F, 0.2F, 0.3F, 0, 0, 0);
  peer_.send(message);
  second();
  const std::scoped_lock lock(mutex_);
  ASSERT_EQ(received_.size(), 1U);
  EXPECT_LE(received_.front().first, clock_.monotonic_s());
  EXPECT_EQ(received_.front().second.source, (MavlinkAddress{7, 1}));
  const auto* attitude = std::get_if<AircraftAttitude>(&received_.front().second.message);
  ASSERT_NE(attitude, nullptr);
  EXPECT_NEAR(attitude->yaw_rad, 0.3, 1e-6);
}

TEST_F(AutopilotLinkTest, SendsNoGpsInputUntilFixesAreServed) {
  permit(false, true, 5);
  see(kPlace, 5);
  second();
  second();
  EXPECT_TRUE(peer_.fixes().empty());
}

TEST_F(AutopilotLinkTest, SendsNoFixWhenTheStatusForbids) {
  permit(true, false, 5);
  see(kPlace, 5);
  second();
  second();
  const auto fixes = peer_.fixes();
  ASSERT_EQ(fixes.size(), 2U);
  for (const auto& fix : fixes) {
    EXPECT_EQ(fix.fix_type, 0);
    EXPECT_EQ(fix.lat, 0);
    EXPECT_EQ(fix.lon, 0);
    EXPECT_GE(fix.horiz_accuracy, 999);
    EXPECT_EQ(fix.gps_id, 1);
  }
}

TEST_F(AutopilotLinkTest, SendsFixesWhenTheStatusAllows) {
  permit(true, true, 5);
  see(kPlace, 5);
  second();
  ASSERT_EQ(peer_.fixes().size(), 1U);
  const mavlink_gps_input_t fix = peer_.fixes().front();
  EXPECT_EQ(fix.fix_type, 3);
  EXPECT_NEAR(fix.lat, 474'000'000, 2);
  EXPECT_NEAR(fix.lon, 85'000'000, 2);
  EXPECT_NEAR(static_cast<double>(fix.alt), 600, 0.1);
  EXPECT_GE(fix.horiz_accuracy, 5);
  EXPECT_LT(fix.horiz_accuracy, 10);
  EXPECT_EQ(fix.gps_id, 1);
  permit(true, false, 5);
  second();
  ASSERT_EQ(peer_.fixes().size(), 2U);
  EXPECT_EQ(peer_.fixes().back().fix_type, 0) << "it was taken back";
}

// What is handed out for the record is what went over the wire, and "no fix" is as well.
TEST_F(AutopilotLinkTest, EveryFixThatIsSentIsReported) {
  permit(true, true, 5);
  see(kPlace, 5);
  second();
  permit(true, false, 5);
  second();
  const auto arrived = peer_.fixes();
  const std::scoped_lock lock(mutex_);
  std::vector<DueFix> sent = due_;
  std::erase_if(sent, [](const DueFix& due) { return !due.inputs.sent; });
  ASSERT_EQ(sent.size(), arrived.size());
  ASSERT_EQ(sent.size(), 2U);
  EXPECT_NEAR(sent[0].message.place.lat_deg * 1e7, arrived[0].lat, 1);
  EXPECT_EQ(sent[0].source, SourceLabel::vo_extrapolated);
  EXPECT_NEAR(*sent[0].message.horizontal_accuracy_m, static_cast<double>(arrived[0].horiz_accuracy), 1e-3);
  EXPECT_EQ(sent[1].message.fix, GpsFix::no_gps);
  EXPECT_EQ(sent[1].source, SourceLabel::no_fix);
  EXPECT_EQ(*sent[1].message.horizontal_accuracy_m, 999);
}

// From the wire to the record and to the fix again: nothing that the thread knows besides has a part in a fix.
TEST_F(AutopilotLinkTest, WhatIsReportedMakesTheSameFixes) {
  const auto hear = [&](std::uint8_t component, float yaw_rad) {
    mavlink_message_t message;
    mavlink_msg_attitude_pack(7, component, &message, 5, 0.1F, 0.2F, yaw_rad, 0, 0, 0);
    peer_.send(message);
    mavlink_raw_imu_t imu{};
    imu.xacc = 300;
    imu.zacc = -1000;
    for (const std::uint8_t instance : {std::uint8_t{0}, std::uint8_t{1}}) {
      imu.id = instance;
      mavlink_msg_raw_imu_encode(7, component, &message, &imu);
      peer_.send(message);
    }
  };
  for (int i = 0; i < 8; ++i) {
    permit(i > 0, i != 5, i == 6 ? 30 : 5);
    hear(1, 0.3F * static_cast<float>(i));
    hear(42, 1);  // another component
    if (i % 3 == 1) see(LocalFrame(kPlace).lonlat_from_plane({5.0 * i, 3}), 5);
    second();
  }
  link_->stop();
  FixStream stream(1);
  std::size_t attitudes = 0, forces = 0, estimates = 0;
  const std::scoped_lock lock(mutex_);
  for (std::size_t i = 0; i < due_.size(); ++i) {
    const FixInputRecord& inputs = due_[i].inputs;
    EXPECT_EQ(inputs.number, i);
    for (const FixInputRecord::Input& input : inputs.inputs) {
      if (const auto* which = std::get_if<FixInputRecord::ArrivedEstimate>(&input.what)) {
        stream.on_input(input.time_us, *which, seen_.at(which->index));
        ++estimates;
      } else if (const auto* attitude = std::get_if<FixInputRecord::Attitude>(&input.what)) {
        stream.on_input(input.time_us, *attitude);
        ++attitudes;
      } else {
        stream.on_input(input.time_us, std::get<FixInputRecord::Acceleration>(input.what));
        ++forces;
      }
    }
    const auto again = stream.turn(inputs.time_us, inputs.unix_us, inputs.status);
    ASSERT_TRUE(again) << i;
    EXPECT_EQ(encode(Record(fix_record(*again))), encode(Record(fix_record(due_[i])))) << i;
  }
  EXPECT_EQ(attitudes, 8U);
  EXPECT_EQ(forces, 8U) << "of the first accelerometer of the autopilot alone";
  EXPECT_EQ(estimates, 3U);
  EXPECT_GE(peer_.fixes().size(), 7U);
}

// Age and attitude for the screens, from the autopilot alone.
TEST_F(AutopilotLinkTest, RecordsTheAutopilotsLastMessageAndAttitude) {
  EXPECT_FALSE(link_->state().last_message_s);
  autopilot_beats(MAV_AUTOPILOT_ARDUPILOTMEGA);
  mavlink_message_t message;
  mavlink_msg_attitude_pack(7, 1, &message, 1000, 0.1F, -0.2F, 1.5F, 0, 0, 0);
  peer_.send(message);
  second();
  const AutopilotLink::State state = link_->state();
  ASSERT_TRUE(state.last_message_s && state.attitude && state.attitude_s);
  EXPECT_GE(*state.last_message_s, 100);
  EXPECT_NEAR(state.attitude->yaw_rad, 1.5, 1e-6);
  mavlink_msg_attitude_pack(7, 42, &message, 1000, 0, 0, 3, 0, 0, 0);
  peer_.send(message);
  second();
  EXPECT_NEAR(link_->state().attitude->yaw_rad, 1.5, 1e-6) << "another component's is not the aircraft's";
}

TEST_F(AutopilotLinkTest, WithoutAnEstimateThereIsNoFix) {
  permit(true, true, 5);
  second();
  ASSERT_EQ(peer_.fixes().size(), 1U);
  EXPECT_EQ(peer_.fixes().front().fix_type, 0);
}

TEST_F(AutopilotLinkTest, SigmaIsNeverBelowThatOfTheStatus) {
  for (const double permitted_m : {1.0, 40.0, 80.0}) {
    permit(true, true, permitted_m);
    see(kPlace, 5);
    second();
    EXPECT_GE(static_cast<double>(peer_.fixes().back().horiz_accuracy), std::max(5.0, permitted_m));
    EXPECT_LT(static_cast<double>(peer_.fixes().back().horiz_accuracy), std::max(5.0, permitted_m) + 5);
  }
}

TEST_F(AutopilotLinkTest, AJumpIsReportedOnceAndOnlyForFixesThatAreSent) {
  const LonLat far = LocalFrame(kPlace).lonlat_from_plane({200, 0});
  const auto jumps = [&] {
    const std::scoped_lock lock(mutex_);
    return jumps_m_;
  };
  permit(true, true, 5);
  see(kPlace, 5);
  second();
  EXPECT_TRUE(jumps().empty());
  see(far, 5);
  second();
  second();
  ASSERT_EQ(jumps().size(), 1U);
  EXPECT_NEAR(jumps().front(), 200, 5);
  permit(true, false, 5);
  see(kPlace, 5);
  second();
  EXPECT_EQ(jumps().size(), 1U);
}

TEST_F(AutopilotLinkTest, TextsReachTheOperatorWithTheirSeverity) {
  link_->send_text(TextSeverity::warning, "position jumps by 200 m");
  peer_.listen_until([&] { return !peer_.received(MAVLINK_MSG_ID_STATUSTEXT).empty(); });
  mavlink_statustext_t text;
  const mavlink_message_t message = peer_.received(MAVLINK_MSG_ID_STATUSTEXT).front();
  mavlink_msg_statustext_decode(&message, &text);
  EXPECT_EQ(text.severity, MAV_SEVERITY_WARNING);
  EXPECT_EQ(std::string(text.text, ::strnlen(text.text, sizeof text.text)), "position jumps by 200 m");
  EXPECT_EQ(message.sysid, 7);
  EXPECT_EQ(message.compid, 197);
}

TEST_F(AutopilotLinkTest, CountsWhatItSendsAndSendsNothingAfterStop) {
  permit(true, true, 5);
  see(kPlace, 5);
  for (int i = 0; i < 3; ++i) second();
  link_->stop();
  const AutopilotLink::State state = link_->state();
  EXPECT_TRUE(state.open);
  EXPECT_EQ(state.error, "");
  EXPECT_EQ(state.fixes_sent, 3U);
  EXPECT_EQ(state.longest_gap_s, 1);
  EXPECT_EQ(state.latency.count(), 1U) << "one picture, and two fixes that carry it on";
  EXPECT_EQ(state.latency.largest_s(), 1);
  link_->send_text(TextSeverity::info, "too late");
  link_->stop();  // twice is once
  EXPECT_TRUE(peer_.received(MAVLINK_MSG_ID_STATUSTEXT).empty());
}

// ---- senders and the peer that is served, where we listen

class ListeningLink : public ::testing::Test {
 protected:
  // A link at a port of its own, to which the autopilot (7/1) and others can send.
  void begin(std::vector<StationSetup> stations = {}, bool and_start = true) {
    auto transport = make_transport(parse_endpoint("udpin:127.0.0.1:0"));
    transport->advance(0, [](const Transport::Arrival&) {});
    endpoint_ = "udpout:127.0.0.1:" + std::to_string(transport->local_port());
    Airframe airframe;
    airframe.system = 7;
    AutopilotLinkSetup setup{.airframe = airframe, .transport = std::move(transport), .key = std::nullopt};
    setup.stations = std::move(stations);
    link_ = std::make_unique<AutopilotLink>(
        std::move(setup), clock_, watch_,
        AutopilotLink::Listener{[this](const MessageTimes&, const ReceivedMessage& message) {
                                  const std::scoped_lock lock(mutex_);
                                  received_.push_back(message);
                                },
                                [](double) {},
                                {},
                                [this](std::uint64_t frames) { rivals_ = frames; }});
    if (and_start) link_->start();
    ServiceStatus status;
    status.state = ServiceState::normal;
    status.serves_fixes = true;
    link_->on_status(status);
  }

  static mavlink_message_t heartbeat(std::uint8_t system, std::uint8_t component = 1) {
    mavlink_message_t message;
    mavlink_msg_heartbeat_pack(system, component, &message, MAV_TYPE_FIXED_WING, MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0,
                               MAV_STATE_ACTIVE);
    return message;
  }

  void wait_until(const std::function<bool()>& done) const {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!done()) {
      ASSERT_LT(std::chrono::steady_clock::now(), deadline);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }
  std::size_t received(std::uint8_t system) {
    const std::scoped_lock lock(mutex_);
    return static_cast<std::size_t>(
        std::ranges::count(received_, system, [](const auto& one) { return one.source.system; }));
  }

  // The autopilot has our ear: fixes go to it.
  void settle(test::LinkPeer& autopilot) {
    const std::size_t before = received(7);
    autopilot.send(heartbeat(7));
    wait_until([&] { return received(7) > before; });
    clock_.go_on(1);
    autopilot.listen_until([&] { return !autopilot.fixes().empty(); });
  }

  HeldClock clock_;
  ThreadWatch watch_{clock_};
  std::string endpoint_;
  std::mutex mutex_;
  std::vector<ReceivedMessage> received_;
  std::atomic<std::uint64_t> rivals_ = 0;
  std::unique_ptr<AutopilotLink> link_;
};

// A listener may use the link by its owner's pointer, which the constructor has not returned to yet.
TEST_F(ListeningLink, HearsNobodyBeforeItIsStarted) {
  begin({}, false);
  test::LinkPeer autopilot(endpoint_);
  autopilot.send(heartbeat(7));
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  EXPECT_EQ(received(7), 0U);
  link_->start();
  wait_until([&] { return received(7) == 1; });
}

TEST_F(ListeningLink, AStopWithoutAStartIsClean) {
  begin({}, false);
  link_->stop();
  EXPECT_EQ(received(7), 0U);
}

TEST_F(ListeningLink, FixesGoToTheConfiguredAutopilotAlone) {
  begin();
  test::LinkPeer other(endpoint_);
  other.send(heartbeat(42));
  wait_until([&] { return received(42) == 1; });
  clock_.go_on(1);
  test::LinkPeer autopilot(endpoint_);
  settle(autopilot);
  other.send(heartbeat(42));
  wait_until([&] { return received(42) == 2; });
  const std::size_t before = autopilot.fixes().size();
  clock_.go_on(1);
  autopilot.listen_until([&] { return autopilot.fixes().size() > before; });
  other.listen();
  EXPECT_TRUE(other.fixes().empty()) << "an accepted frame of another system moves nothing";
  EXPECT_EQ(rivals_, 0U);
}

TEST_F(ListeningLink, ASecondSenderThatClaimsToBeTheAutopilotIsIgnoredAndReported) {
  begin();
  test::LinkPeer autopilot(endpoint_);
  settle(autopilot);
  test::LinkPeer rival(endpoint_);
  rival.send(heartbeat(7));
  wait_until([&] { return rivals_ == 1; });
  EXPECT_EQ(received(7), 1U) << "on an unsigned link its messages are dropped";
  const std::size_t before = autopilot.fixes().size();
  clock_.go_on(1);
  autopilot.listen_until([&] { return autopilot.fixes().size() > before; });
  rival.listen();
  EXPECT_TRUE(rival.fixes().empty());
}

TEST_F(ListeningLink, AnAutopilotThatReturnsAtAnotherAddressIsServedAfterTheSilence) {
  begin();
  test::LinkPeer autopilot(endpoint_);
  settle(autopilot);
  clock_.go_on(kPeerSilence_us / 1e6 + 0.1);
  test::LinkPeer moved(endpoint_);
  settle(moved);
  EXPECT_EQ(rivals_, 0U);
}

TEST_F(ListeningLink, StationsGetTheirShareAndGiveCommandsAlone) {
  test::LinkPeer ground, logger;
  begin({{StationRole::ground_station, ground.endpoint()}, {StationRole::logger, logger.endpoint()}});
  test::LinkPeer autopilot(endpoint_);
  settle(autopilot);
  link_->send_text(TextSeverity::info, "hello");
  const auto has_text = [](const test::LinkPeer& peer) { return !peer.received(MAVLINK_MSG_ID_STATUSTEXT).empty(); };
  ground.listen_until([&] { return has_text(ground); });
  logger.listen_until([&] { return has_text(logger) && !logger.fixes().empty(); });
  EXPECT_TRUE(ground.fixes().empty());

  mavlink_message_t attitude, command;
  mavlink_msg_attitude_pack(7, 1, &attitude, 5, 0.1F, 0.2F, 0.3F, 0, 0, 0);
  mavlink_msg_command_int_pack(255, 190, &command, 7, 197, MAV_FRAME_GLOBAL, MAV_CMD_EXTERNAL_POSITION_ESTIMATE, 0, 0,
                               0, 0, 100, 0, 474'000'000, 85'000'000, 0);
  const std::size_t before = received(7);
  for (test::LinkPeer* peer : {&logger, &ground}) {
    peer->send(attitude);
    peer->send(command);
  }
  wait_until([&] { return received(255) == 1; });
  clock_.go_on(1);
  const std::size_t fixes = autopilot.fixes().size();
  autopilot.listen_until([&] { return autopilot.fixes().size() > fixes; });
  EXPECT_EQ(received(255), 1U) << "the logger's messages are ignored";
  EXPECT_EQ(received(7), before) << "telemetry counts only on the autopilot's link";
  const AutopilotLink::State state = link_->state();
  ASSERT_EQ(state.stations.size(), 2U);
  EXPECT_TRUE(state.stations[0].open);
  EXPECT_EQ(state.stations[0].commands, 1U);
  EXPECT_GT(state.stations[1].sent, state.stations[0].sent);
}

TEST(LatencyHistogram, ReturnsItsQuantiles) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.quantile_s(0.5), 0);
  for (int i = 0; i < 100; ++i) histogram.add((i + 0.5) / 1000);
  EXPECT_EQ(histogram.count(), 100U);
  EXPECT_DOUBLE_EQ(histogram.quantile_s(0.5), 0.050);
  EXPECT_DOUBLE_EQ(histogram.quantile_s(0.95), 0.095);
  EXPECT_DOUBLE_EQ(histogram.largest_s(), 0.0995);
}

TEST(LatencyHistogram, ValuesBeyondTheRangeCountAtItsEnd) {
  LatencyHistogram histogram;
  histogram.add(60);
  histogram.add(-1);
  EXPECT_EQ(histogram.quantile_s(1), 2);
  EXPECT_DOUBLE_EQ(histogram.quantile_s(0.5), 0.001);
  EXPECT_EQ(histogram.largest_s(), 60);
}

}  // namespace
}  // namespace nadir
