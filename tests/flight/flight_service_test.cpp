// What the service tells an autopilot that comes late, or that nobody vouches for: the whole service without a package,
// and its peer on the other end of a socket.
#include "flight/flight_service.hpp"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <thread>

#include "base/files.hpp"
#include "flight/link_peer.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "package/open_package.hpp"
#include "package/package_maker.hpp"
#include "recorder/recording.hpp"
#include "service/service_rules.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class RejectedFlight : public ::testing::Test {
 protected:
  void begin(std::optional<std::filesystem::path> link_key) {
    FlightOptions options;
    options.airframe.system = 7;
    options.state = folder_ / "state";
    std::filesystem::create_directories(options.state);
    options.autopilot = peer_.endpoint();
    options.api.address = "127.0.0.1:0";
    options.link_key = std::move(link_key);
    options.recording.folder = folder_ / "record";
    options.airframe.camera.uncertainty.heading_rad = 0.2;
    options.airframe.camera.uncertainty.tilt_rad = 0.01;
    Findings findings;
    findings.add({.code = "signature.invalid", .where = "manifest.sig"});
    service_ = std::make_unique<FlightService>(options, VerifiedPackage{nullptr, findings}, clock_, stop_);
    running_ = std::jthread([this] { service_->run(); });
    peer_.listen_until([&] { return heartbeats() >= 2; });
  }
  void TearDown() override { end(); }
  void end() {
    stop_.request_stop();
    running_ = {};
    service_.reset();
  }

  std::size_t heartbeats() const { return peer_.received(MAVLINK_MSG_ID_HEARTBEAT).size(); }

  void autopilot_beats() {
    mavlink_message_t message;
    mavlink_msg_heartbeat_pack(7, 1, &message, MAV_TYPE_FIXED_WING, MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0,
                               MAV_STATE_ACTIVE);
    peer_.send(message);
  }

  std::vector<std::string> texts() const {
    std::vector<std::string> found;
    for (const mavlink_message_t& message : peer_.received(MAVLINK_MSG_ID_STATUSTEXT)) {
      char text[51] = {};
      mavlink_msg_statustext_get_text(&message, text);
      found.emplace_back(text);
    }
    return found;
  }
  bool received_text(const std::string& text) const {
    const auto all = texts();
    return std::find(all.begin(), all.end(), text) != all.end();
  }

  const test::TemporaryFolder folder_;
  const SystemFlightClock clock_;
  StopSignals stop_;
  test::LinkPeer peer_;
  std::unique_ptr<FlightService> service_;
  std::jthread running_;
};

TEST_F(RejectedFlight, ALateAutopilotGetsTheTexts) {
  begin(std::nullopt);
  EXPECT_TRUE(texts().empty()) << "no receiver was connected yet";
  autopilot_beats();
  peer_.listen_until([&] { return received_text("Nadir: map package rejected, no position"); });
  EXPECT_EQ(std::ranges::count(texts(), "Nadir: map package rejected, no position"), 1);
  EXPECT_TRUE(peer_.fixes().empty());
}

TEST_F(RejectedFlight, AnUnsignedAutopilotGetsThatTextOnly) {
  write_file_atomic(folder_ / "link.key", std::string(64, 'a'), 0600);
  begin(folder_ / "link.key");
  autopilot_beats();
  peer_.listen_until([&] { return received_text("Nadir: autopilot link not authenticated"); });
  autopilot_beats();
  const std::size_t before = heartbeats();
  peer_.listen_until([&] { return heartbeats() >= before + 2; });
  EXPECT_EQ(texts(), std::vector<std::string>{"Nadir: autopilot link not authenticated"}) << "once";
}

// A hint to somebody else is theirs; each command that we take is on record with its sender.
TEST_F(RejectedFlight, CommandsAreTakenWhenAddressedToUsAndLoggedWithTheirSender) {
  begin(std::nullopt);
  autopilot_beats();
  const auto hint = [&](std::uint8_t system, std::uint8_t component, std::uint16_t command) {
    mavlink_message_t message;
    mavlink_msg_command_int_pack(255, 190, &message, system, component, MAV_FRAME_GLOBAL, command, 0, 0, 0, 0, 100, 0,
                                 474'000'000, 85'000'000, 0);
    peer_.send(message);
  };
  hint(42, 42, MAV_CMD_EXTERNAL_POSITION_ESTIMATE);
  hint(7, 1, MAV_CMD_EXTERNAL_POSITION_ESTIMATE);
  hint(7, 197, MAV_CMD_NAV_LAND);
  hint(7, 197, MAV_CMD_EXTERNAL_POSITION_ESTIMATE);
  peer_.listen_until([&] { return peer_.received(MAVLINK_MSG_ID_COMMAND_ACK).size() >= 2; });
  std::vector<std::pair<int, int>> answers;
  for (const mavlink_message_t& message : peer_.received(MAVLINK_MSG_ID_COMMAND_ACK)) {
    mavlink_command_ack_t answer;
    mavlink_msg_command_ack_decode(&message, &answer);
    EXPECT_EQ(answer.target_system, 255);
    answers.emplace_back(answer.command, answer.result);
  }
  EXPECT_EQ(answers, (std::vector<std::pair<int, int>>{{MAV_CMD_NAV_LAND, MAV_RESULT_UNSUPPORTED},
                                                       {MAV_CMD_EXTERNAL_POSITION_ESTIMATE, MAV_RESULT_ACCEPTED}}));
  // A hint that was answered has been published; the conductor saves after it has noted what was published before.
  const double answered_s = clock_.monotonic_s();
  peer_.listen_until([&] {
    const SavedFlightReading saved = StateDirectory(folder_ / "state").load();
    return saved.flight && saved.flight->saved_monotonic_s > answered_s;
  });
  end();
  std::vector<std::string> notes;
  read_recording(folder_ / "record", [&](const Recorded& recorded) {
    if (const auto* health = std::get_if<HealthRecord>(&recorded.record)) {
      notes.insert(notes.end(), health->notes.begin(), health->notes.end());
    }
  });
  EXPECT_EQ(std::ranges::count_if(notes, [](const std::string& note) { return note.starts_with("hint: "); }), 1);
  EXPECT_TRUE(std::ranges::any_of(notes, [](const std::string& note) {
    return note.starts_with("hint: operator 255/190, unsigned: within 100 m of 47.4");
  }));
  EXPECT_TRUE(std::ranges::any_of(notes, [](const std::string& note) { return note.starts_with("link: not signed"); }));
}

// An attitude uncertainty that was measured with GPS does not hold when our fix aids the attitude; a larger one that is
// configured stays.
TEST_F(RejectedFlight, TheAttitudeUncertaintyIsAtLeastThatOfAFixAidedAttitude) {
  begin(std::nullopt);
  end();
  std::optional<TelemetryUncertainty> flown;
  read_recording(folder_ / "record", [&](const Recorded& recorded) {
    if (const auto* session = std::get_if<SessionRecord>(&recorded.record)) flown = session->camera.uncertainty;
  });
  ASSERT_TRUE(flown);
  EXPECT_DOUBLE_EQ(flown->heading_rad, 0.2);
  EXPECT_DOUBLE_EQ(flown->tilt_rad, kFixAidedTilt_rad);
}

// What a disk or another process does to parts of the service: it starts, reports, and uses them later. The map is
// missing as well, which is the worst of starts.
class PartsInFlight : public ::testing::Test {
 protected:
  PartsInFlight() {
    options_.airframe.system = 7;
    options_.autopilot = peer_.endpoint();
    options_.api.address = "127.0.0.1:0";
    options_.state = folder_ / "state";
    verified_.findings.add({.code = "signature.invalid", .where = "manifest.sig"});
  }
  ~PartsInFlight() override {
    stop_.request_stop();
    running_ = {};
  }
  void begin() {
    const auto log = [this](const std::string& line) {
      const std::scoped_lock lock(mutex_);
      log_.push_back(line);
    };
    service_ = std::make_unique<FlightService>(options_, std::move(verified_), clock_, stop_, log);
    running_ = std::jthread([this] { end_ = service_->run(); });
  }
  void beats(bool armed) {
    mavlink_message_t message;
    mavlink_msg_heartbeat_pack(7, 1, &message, MAV_TYPE_FIXED_WING, MAV_AUTOPILOT_ARDUPILOTMEGA,
                               armed ? MAV_MODE_FLAG_SAFETY_ARMED : 0, 0, MAV_STATE_ACTIVE);
    peer_.send(message);
  }
  void end() {
    stop_.request_stop();
    running_ = {};
    service_.reset();
  }
  // The autopilot beats meanwhile: without a link nothing is sent to the operator.
  void wait_until(const std::function<bool()>& done) {
    peer_.listen_until([&] {
      if (!peer_.received(MAVLINK_MSG_ID_HEARTBEAT).empty()) beats(false);
      return done();
    });
  }
  void wait_for(const std::string& text) {
    wait_until([&] { return logged(text) > 0; });
  }
  std::ptrdiff_t logged(const std::string& text) const {
    const std::scoped_lock lock(mutex_);
    return std::ranges::count_if(log_, [&](const std::string& line) { return line.find(text) != std::string::npos; });
  }
  bool reported(const std::string& wanted) const {
    return std::ranges::any_of(peer_.received(MAVLINK_MSG_ID_STATUSTEXT), [&](const mavlink_message_t& message) {
      char text[51] = {};
      mavlink_msg_statustext_get_text(&message, text);
      return wanted == text;
    });
  }
  AcceptanceReading acceptance() const { return StateDirectory(options_.state).load_acceptance(); }

  const test::TemporaryFolder folder_;
  const SystemFlightClock clock_;
  StopSignals stop_;
  test::LinkPeer peer_;
  FlightOptions options_;
  VerifiedPackage verified_;
  mutable std::mutex mutex_;
  std::vector<std::string> log_;
  std::unique_ptr<FlightService> service_;
  FlightEnd end_ = FlightEnd::stopped;
  std::jthread running_;
};

TEST_F(PartsInFlight, AStateDirectoryThatCannotBeMadeIsReportedAndUsedLater) {
  folder_.write("state", "a file in its place");
  begin();
  wait_for("state directory: failed");
  wait_until([&] { return reported("Nadir: state directory failed, trying again"); });
  std::filesystem::remove(folder_ / "state");
  wait_for("state directory: works again");
  wait_until([&] { return reported("Nadir: state directory works again"); });
  EXPECT_EQ(logged("state directory: failed"), 1) << "once";
  peer_.listen_until([&] { return StateDirectory(options_.state).load().flight.has_value(); });
}

// A restart then knows as much as the flight did, whenever the last save was due.
TEST_F(PartsInFlight, ACleanEndSavesTheStateOfTheEnd) {
  begin();
  peer_.listen_until([&] { return StateDirectory(options_.state).load().flight.has_value(); });
  const double before_s = clock_.monotonic_s();
  end();
  const SavedFlightReading saved = StateDirectory(options_.state).load();
  ASSERT_TRUE(saved.flight) << saved.rejection;
  EXPECT_GE(saved.flight->saved_monotonic_s, before_s);
  EXPECT_EQ(saved.flight->state, ServiceState::no_package);
}

TEST_F(PartsInFlight, AnEndThatCannotBeSavedIsInTheLog) {
  folder_.write("state", "a file in its place");
  begin();
  wait_for("state directory: failed");
  end();
  EXPECT_EQ(logged("the end of the flight could not be saved: cannot use the state directory"), 1);
}

TEST_F(PartsInFlight, ATakenPortIsReportedAndUsedWhenItIsFree) {
  const int other = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(::bind(other, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(::listen(other, 1), 0);
  socklen_t size = sizeof address;
  ::getsockname(other, reinterpret_cast<sockaddr*>(&address), &size);
  options_.api.address = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  begin();
  wait_for("API: failed");
  ::close(other);
  wait_for("API: works again");
  EXPECT_EQ(logged("API: failed"), 1);
}

TEST_F(PartsInFlight, ARecordingFolderThatCannotBeMadeIsReportedAndUsedLater) {
  folder_.write("record", "a file in its place");
  options_.recording.folder = folder_ / "record";
  begin();
  wait_for("recorder: failed");
  std::filesystem::remove(folder_ / "record");
  wait_for("recorder: works again");
  end();
  std::size_t records = 0;
  read_recording(folder_ / "record", [&](const Recorded&) { ++records; });
  EXPECT_GT(records, 1U);
}

TEST_F(PartsInFlight, ATornSigningTimeIsReportedOnceAndWrittenAnew) {
  std::filesystem::create_directories(options_.state);
  folder_.write("state/signing-time", "123");
  write_file_atomic(folder_ / "link.key", std::string(64, 'a'), 0600);
  options_.link_key = folder_ / "link.key";
  begin();
  peer_.listen_until([&] { return logged("signing time: works again") > 0; });
  EXPECT_EQ(logged("signing time: failed"), 1);
}

TEST_F(PartsInFlight, WrongUsageIsFoundAtTheStart) {
  options_.api.address = "0.0.0.0:0";  // without a token
  EXPECT_THROW(FlightService(options_, std::move(verified_), clock_, stop_), UsageError);
}

// The acceptance lasts until the landing: the autopilot says when the flight begins.
TEST_F(PartsInFlight, AnArmedAutopilotIsRememberedInTheAcceptance) {
  AcceptedPackage package;
  package.folder = "/data/a";
  package.series = "a";
  verified_.acceptance = accepted_next(std::nullopt, package, "boot");
  begin();
  peer_.listen_until([&] { return acceptance().record.has_value(); });
  EXPECT_FALSE(acceptance().record->airborne);
  peer_.listen_until([&] {
    if (!peer_.received(MAVLINK_MSG_ID_HEARTBEAT).empty()) beats(true);
    const AcceptanceReading reading = acceptance();
    return reading.record && reading.record->airborne;
  });
}

// A package that could not be read is asked for again, and the service ends so that it is judged.
TEST_F(PartsInFlight, APackageThatCanBeOpenedAgainIsChecked) {
  std::atomic<int> asked{0};
  verified_.can_be_opened = [&asked] { return ++asked == 2; };
  begin();
  peer_.listen_until([&] { return asked == 2; });
  running_ = {};  // by itself
  EXPECT_EQ(end_, FlightEnd::reselect_package);
}

// The camera of a whole service on a gimbal, among others: of every recorded frame the attitude that it was used with.
class CameraOnGimbal : public PartsInFlight {
 protected:
  struct Sender {
    std::uint8_t system = 7, component = 154, device = 2;
    std::uint16_t flags = GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME;
    std::uint32_t faults = 0;
    double from_nadir_deg = 10;
    bool finite = true;
  };

  CameraOnGimbal() {
    NoProgress progress;
    options_.package = maker_.make(folder_);
    Opening opening = open_package(options_.package, maker_.options(), progress);
    verified_ = {std::move(opening.package), std::move(opening.findings)};
    std::filesystem::create_directories(folder_ / "frames");
    options_.camera = "folder:" + (folder_ / "frames").string();
    options_.airframe.camera.camera = {160, 120, 130, 130, 80, 60, {}};
    options_.airframe.camera.on_gimbal = true;
    options_.airframe.gimbal = GimbalAddress{154, 2};
    options_.recording.folder = folder_ / "record";
  }

  void send_attitude_of(const Sender& sender) {
    const float half = static_cast<float>(radians(sender.from_nadir_deg - 90) / 2);
    mavlink_gimbal_device_attitude_status_t status{};
    status.q[0] = sender.finite ? std::cos(half) : NAN;
    status.q[2] = std::sin(half);
    status.flags = sender.flags;
    status.failure_flags = sender.faults;
    status.gimbal_device_id = sender.device;
    mavlink_message_t message;
    mavlink_msg_gimbal_device_attitude_status_encode(sender.system, sender.component, &message, &status);
    peer_.send(message);
  }

  // What the gimbals say, then a frame, twenty times.
  void fly(const std::vector<Sender>& speakers) {
    for (int i = 0; i < 20; ++i, ++frames_) {
      beats(false);
      mavlink_message_t message;
      mavlink_msg_attitude_pack(7, 1, &message, 0, 0, 0, 1, 0, 0, 0);
      peer_.send(message);
      for (const Sender& sender : speakers) send_attitude_of(sender);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));  // as gimbals pause: frames lie between messages
      const cv::Mat grey(120, 160, CV_8UC1, cv::Scalar(frames_));
      const std::string name = "frame-" + std::to_string(1000 + frames_) + ".png";
      write_file_atomic(folder_ / "made", encode_image(grey, ImageFormat::png));
      std::filesystem::rename(folder_ / "made", folder_ / "frames" / name);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      peer_.listen();
    }
  }

  // Degrees of the camera from straight down, in the order of the frames; nothing: that of no gimbal.
  std::vector<std::optional<double>> recorded_pitches() {
    end();
    std::vector<std::optional<double>> pitches;
    read_recording(folder_ / "record", [&](const Recorded& recorded) {
      const auto* input = std::get_if<InputRecord>(&recorded.record);
      if (input == nullptr) return;
      const auto& pitch = input->telemetry.pitch_rad;
      pitches.push_back(pitch ? std::optional(degrees(*pitch)) : std::nullopt);
    });
    return pitches;
  }

  test::PackageMaker maker_;
  int frames_ = 0;
};

// Each of the others says another angle, and would be seen.
TEST_F(CameraOnGimbal, OnlyTheConfiguredGimbalCountsAndItsSilenceIsNoAttitude) {
  const Sender ours;
  const std::vector<Sender> others = {
      {.component = 171, .from_nadir_deg = 20},
      {.device = 1, .from_nadir_deg = 25},
      {.system = 8, .from_nadir_deg = 30},
      {.flags = GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME | GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME,
       .from_nadir_deg = 35},
      {.faults = GIMBAL_DEVICE_ERROR_FLAGS_ENCODER_ERROR, .from_nadir_deg = 40},
      {.finite = false},
  };
  std::vector<Sender> all = others;
  all.insert(all.begin() + 3, ours);
  begin();
  wait_until([&] { return !peer_.received(MAVLINK_MSG_ID_HEARTBEAT).empty(); });
  fly(all);
  fly(others);
  const auto pitches = recorded_pitches();
  ASSERT_FALSE(pitches.empty());
  EXPECT_TRUE(pitches.front()) << "the first frames wait for an attitude";
  EXPECT_FALSE(pitches.back()) << "ours has been silent";
  for (const std::optional<double>& pitch : pitches) EXPECT_NEAR(pitch.value_or(10), 10, 0.01);
}

}  // namespace
}  // namespace nadir
