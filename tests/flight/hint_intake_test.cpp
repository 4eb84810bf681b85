// Hints of ground stations, in the bytes that MAVProxy and QGroundControl send: pymavlink, which MAVProxy sends by,
// writes them with the arguments that these programs give.
#include "flight/hint_intake.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <thread>

#include "base/files.hpp"
#include "base/progress.hpp"
#include "flight/flight_service.hpp"
#include "flight/link_peer.hpp"
#include "mavlink/judge.hpp"
#include "package/package_maker.hpp"
#include "recorder/recording.hpp"
#include "support/manual_clock.hpp"

namespace nadir {
namespace {

struct Click {
  double lat_deg = 47.4, lon_deg = 8.5;
  std::string accuracy = "50.0", age = "0", frame = "0", command = "43003";
  int system = 7, component = 0;
};

// MAVProxy, "Set Position" on the map: to its target component, 0 unless it was set; the time since it was started; no
// altitude.
std::string mavproxy(const Click& click = {}) {
  return fmt::format(R"({{"message": "COMMAND_INT", "target_system": {}, "target_component": {}, "frame": {},
      "command": {}, "param1": 1234.5, "param2": {}, "param3": {}, "x": {}, "y": {}, "z": null}})",
                     click.system, click.component, click.frame, click.command, click.age, click.accuracy,
                     static_cast<int>(click.lat_deg * 1e7), static_cast<int>(click.lon_deg * 1e7));
}

// A ground station that sends the command in COMMAND_LONG.
std::string command_long(const std::string& lat) {
  return fmt::format(R"({{"message": "COMMAND_LONG", "target_system": 7, "target_component": 197, "command": 43003,
      "param3": 50.0, "param5": {}, "param6": 8.5, "param7": null}})",
                     lat);
}

// QGroundControl, "Set Estimator Origin" on the map, to autopilots that do not know the newer command.
std::string qgroundcontrol(double lat_deg, int system = 7) {
  return fmt::format(
      R"({{"message": "SET_GPS_GLOBAL_ORIGIN", "target_system": {}, "latitude": {}, "longitude": 85000000,
      "altitude": 450000}})",
      system, static_cast<int>(lat_deg * 1e7));
}

std::string on_one_line(std::string text) {
  std::erase(text, '\n');
  return text + "\n";
}

ReceivedMessage received(const std::string& message, int system = 255) {
  const auto frames = test::frames_by_pymavlink(on_one_line(message), fmt::format("--system {}", system));
  FrameReader reader;
  reader.add(frames.at(0));
  const auto frame = reader.next();
  return {frame->source, true, 0, decode(*frame).value()};
}

class HintIntakeTest : public ::testing::Test {
 protected:
  HintIntake::Answer answer(const std::string& message, bool position_known = false, int system = 255) {
    now_s_ += 10;
    return intake_.on_message(now_s_, received(message, system), position_known);
  }
  // Degrees of latitude north of 47.5 are outside.
  HintIntake intake_{{7, 197}, [](const LonLat& place) { return std::max(0.0, place.lat_deg - 47.5) * 111'000; }};
  double now_s_ = 0;
};

TEST_F(HintIntakeTest, TakesMavproxysClick) {
  for (const int component : {0, 197}) {
    const auto got = answer(mavproxy({.component = component}));
    ASSERT_TRUE(got.hint);
    EXPECT_NEAR(got.hint->place.lat_deg, 47.4, 2e-7);
    EXPECT_NEAR(got.hint->place.lon_deg, 8.5, 2e-7);
    EXPECT_EQ(got.hint->radius_m, 50);
    EXPECT_EQ(got.hint->source, "operator 255/1");
    ASSERT_TRUE(got.acknowledgement);
    EXPECT_EQ(got.acknowledgement->result, CommandResult::accepted);
    EXPECT_EQ(got.acknowledgement->command, 43003);
    EXPECT_EQ(got.acknowledgement->target, (MavlinkAddress{255, 1}));
  }
}

TEST_F(HintIntakeTest, TheAgeWidensTheRadius) {
  const auto got = answer(mavproxy({.age = "2.5"}));
  ASSERT_TRUE(got.hint);
  EXPECT_EQ(got.hint->radius_m, 50 + 2.5 * 100);
}

TEST_F(HintIntakeTest, RefusesWhatNamesNoPlaceOfNow) {
  const std::pair<std::string, std::string> refused[] = {
      {mavproxy({.accuracy = "null"}), "no accuracy"},
      {mavproxy({.accuracy = "0"}), "no accuracy"},
      {mavproxy({.accuracy = "-5"}), "no accuracy"},
      {mavproxy({.accuracy = "1e9"}), "too inaccurate"},
      {mavproxy({.age = "null"}), "no valid age"},
      {mavproxy({.age = "61"}), "too old"},
      {mavproxy({.lat_deg = 91}), "no valid place"},
      {mavproxy({.lat_deg = 47.501}), "outside the map"},
      {mavproxy({.frame = "1"}), "its frame is not global"},
      {command_long("null"), "no valid place"},
      {command_long("91.0"), "no valid place"},
  };
  for (const auto& [message, why] : refused) {
    const auto got = answer(message);
    EXPECT_FALSE(got.hint) << message;
    EXPECT_EQ(got.refusal, why) << message;
    ASSERT_TRUE(got.acknowledgement);
    EXPECT_EQ(got.acknowledgement->result, CommandResult::denied) << message;
  }
}

TEST_F(HintIntakeTest, ACircleThatTouchesTheMapCounts) {
  EXPECT_TRUE(answer(mavproxy({.lat_deg = 47.51, .accuracy = "2000"})).hint);
  EXPECT_FALSE(answer(mavproxy({.lat_deg = 47.51, .accuracy = "1000"})).hint);
}

TEST_F(HintIntakeTest, WhatIsMeantForOthersIsLeftToThem) {
  for (const Click& click : {Click{.system = 42}, Click{.component = 1}, Click{.system = 0}}) {
    const auto got = answer(mavproxy(click));
    EXPECT_FALSE(got.hint);
    EXPECT_FALSE(got.acknowledgement);
  }
  // Commands for the autopilot go to all components; one that names this component is answered.
  EXPECT_FALSE(answer(mavproxy({.command = "192"})).acknowledgement);
  const auto got = answer(mavproxy({.command = "192", .component = 197}));
  ASSERT_TRUE(got.acknowledgement);
  EXPECT_EQ(got.acknowledgement->result, CommandResult::unsupported);
}

TEST_F(HintIntakeTest, TakesTheCommandInSinglePrecision) {
  const auto got = answer(command_long("47.4"));
  ASSERT_TRUE(got.hint);
  EXPECT_NEAR(got.hint->place.lat_deg, 47.4, 5e-6);
  EXPECT_EQ(got.acknowledgement->result, CommandResult::accepted);
}

TEST_F(HintIntakeTest, AnOriginIsAHintWhileThereIsNoPosition) {
  const auto got = answer(qgroundcontrol(47.4));
  ASSERT_TRUE(got.hint);
  EXPECT_EQ(got.hint->radius_m, 500);
  EXPECT_FALSE(got.acknowledgement) << "it is no command";
  EXPECT_FALSE(answer(qgroundcontrol(47.4), true).hint) << "the aircraft is somewhere else by now";
  EXPECT_FALSE(answer(qgroundcontrol(47.4, 42)).hint) << "of another aircraft";
  EXPECT_FALSE(answer(qgroundcontrol(47.4), false, 7).hint) << "of another companion computer, for the autopilot";
  EXPECT_EQ(answer(qgroundcontrol(47.6)).refusal, "outside the map");
  EXPECT_EQ(answer(qgroundcontrol(91)).refusal, "no valid place");
}

TEST_F(HintIntakeTest, ASenderInALoopIsPutOff) {
  const auto click = received(mavproxy());
  int taken = 0, put_off = 0;
  for (int i = 0; i < 100; ++i) {
    const auto got = intake_.on_message(5, click, false);
    taken += got.hint ? 1 : 0;
    put_off += got.acknowledgement->result == CommandResult::temporarily_rejected ? 1 : 0;
    EXPECT_EQ(got.refusal, "") << "no flood of texts";
  }
  EXPECT_EQ(taken, 3);
  EXPECT_EQ(put_off, 97);
}

// The whole service over a package, with a signed link whose other end is pymavlink.
class SignedStation : public ::testing::Test {
 protected:
  void SetUp() override {
    NoProgress progress;
    const std::filesystem::path package = maker_.make(folder_);
    Opening opening = open_package(package, maker_.options(), progress);
    ASSERT_TRUE(opening.package) << test::codes(opening.findings);
    origin_ = mission_frame(opening.package->mission()).origin();
    write_file_atomic(folder_ / "link.key", key_, 0600);
    FlightOptions options;
    options.package = package;
    options.airframe.system = 7;
    options.airframe.camera.camera = CameraModel{640, 480, 500, 500, 319.5, 239.5};
    options.state = folder_ / "state";
    options.camera = folder_ / "frames";
    options.autopilot = peer_.endpoint();
    options.link_key = folder_ / "link.key";
    options.api.address = "127.0.0.1:0";
    options.recording.folder = folder_ / "record";
    std::filesystem::create_directories(options.state);
    std::filesystem::create_directories(options.camera);
    service_ = std::make_unique<FlightService>(options, VerifiedPackage{std::move(opening.package), {}}, clock_, stop_);
    running_ = std::jthread([this] { service_->run(); });
    await([&] { return !peer_.received(MAVLINK_MSG_ID_HEARTBEAT).empty(); });
  }
  void TearDown() override { end(); }
  void end() {
    stop_.request_stop();
    running_ = {};
    service_.reset();
  }

  // Time passes until it is so.
  void await(const std::function<bool()>& done) {
    peer_.listen_until([&] {
      clock_.advance(0.1);
      return done();
    });
  }
  Bytes frame_of(const std::string& message, const std::string& key, int system) {
    const auto now_10us = clock_.unix_us() / 10 - 142'007'040'000'000;
    const std::string signature = key.empty() ? "" : "--key " + key;
    return test::frames_by_pymavlink(on_one_line(message), fmt::format("--system {} --timestamp {} {}", system,
                                                                       now_10us + ++sent_, signature))
        .at(0);
  }
  std::vector<int> answers() {
    std::vector<int> results;
    for (const mavlink_message_t& message : peer_.received(MAVLINK_MSG_ID_COMMAND_ACK)) {
      mavlink_command_ack_t answer;
      mavlink_msg_command_ack_decode(&message, &answer);
      results.push_back(answer.result);
    }
    return results;
  }
  void await_answers(std::size_t number) {
    await([&] { return answers().size() >= number; });
  }
  // How often this text has come.
  int texts(const std::string& wanted) const {
    int number = 0;
    for (const mavlink_message_t& message : peer_.received(MAVLINK_MSG_ID_STATUSTEXT)) {
      char text[51] = {};
      mavlink_msg_statustext_get_text(&message, text);
      number += text == wanted ? 1 : 0;
    }
    return number;
  }

  const test::TemporaryFolder folder_;
  test::PackageMaker maker_;
  const std::string key_ = std::string(64, 'a');
  ManualClock clock_;
  StopSignals stop_;
  test::LinkPeer peer_;
  LonLat origin_;
  int sent_ = 0;
  std::unique_ptr<FlightService> service_;
  std::jthread running_;
};

TEST_F(SignedStation, OnlyItsSignedHintsOverTheMapAreTaken) {
  const std::string heartbeat = R"({"message": "HEARTBEAT", "type": 1, "autopilot": 3, "system_status": 4})";
  peer_.send(frame_of(heartbeat, key_, 7));
  const Click here{.lat_deg = origin_.lat_deg, .lon_deg = origin_.lon_deg};
  Click far = here;
  far.lat_deg -= 3;
  Click antipode = here;
  antipode.lat_deg *= -1;
  antipode.lon_deg -= 180;

  peer_.send(frame_of(mavproxy(here), {}, 255));                    // unsigned
  peer_.send(frame_of(mavproxy(here), std::string(64, 'b'), 255));  // signed by another key
  const Bytes taken = frame_of(mavproxy(here), key_, 255);
  peer_.send(taken);
  await_answers(1);
  EXPECT_EQ(answers(), std::vector<int>{MAV_RESULT_ACCEPTED});
  peer_.send(taken);  // recorded, and sent again
  peer_.send(frame_of(mavproxy(far), key_, 255));
  await_answers(2);
  EXPECT_EQ(answers().back(), MAV_RESULT_DENIED);
  peer_.send(frame_of(mavproxy(antipode), key_, 255));
  await_answers(3);
  EXPECT_EQ(answers(), (std::vector<int>{MAV_RESULT_ACCEPTED, MAV_RESULT_DENIED, MAV_RESULT_DENIED}));
  await([&] { return texts("Nadir: hint refused, outside the map") == 2; });  // both were noted before
  end();

  std::vector<std::string> notes;
  read_recording(folder_ / "record", [&](const Recorded& recorded) {
    const auto* health = std::get_if<HealthRecord>(&recorded.record);
    if (health != nullptr) notes.insert(notes.end(), health->notes.begin(), health->notes.end());
  });
  EXPECT_EQ(std::ranges::count_if(notes, [](const auto& note) { return note.starts_with("hint: operator 255/1: "); }),
            1);
  EXPECT_EQ(std::ranges::count(notes, "hint: of 255/1 refused: outside the map"), 2);
}

TEST_F(SignedStation, AnArmedAircraftThatIsLostAsks) {
  const std::string armed =
      R"({"message": "HEARTBEAT", "type": 1, "autopilot": 3, "base_mode": 128, "system_status": 4})";
  double next_s = 0;
  await([&] {
    if (clock_.monotonic_s() >= next_s) {
      next_s = clock_.monotonic_s() + 4;
      peer_.send(frame_of(armed, key_, 7));
    }
    return texts("Nadir: LOST, please set the position on the map") > 0;
  });
}

}  // namespace
}  // namespace nadir
