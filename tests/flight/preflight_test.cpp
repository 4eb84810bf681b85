// Camera and autopilot before take-off: a real folder, and a real socket with a peer that uses the official MAVLink
// headers.
#include "flight/preflight.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "base/files.hpp"
#include "camera/folder_camera.hpp"
#include "flight/link_peer.hpp"
#include "imagery/codecs.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;

constexpr double kSoon_s = 0.3, kLong_s = 60;

// Stands still until the other end has said something, then moves with every look: what was said is heard in time,
// however slow this machine is.
class PatientClock final : public FlightClock {
 public:
  double monotonic_s() const override { return spoken ? now_s_ = now_s_ + 0.1 : now_s_; }
  std::int64_t unix_us() const override { return system_.unix_us(); }
  const std::string& boot_id() const override { return system_.boot_id(); }
  bool wait_until(double, std::stop_token) const override { return true; }

  std::atomic<bool> spoken = false;

 private:
  const SystemFlightClock system_;
  mutable double now_s_ = 100;  // of the thread that checks
};

class Preflight : public ::testing::Test {
 protected:
  std::string only_code(const PartCheck& check) const {
    EXPECT_EQ(check.findings.items().size(), 1U);
    return check.findings.items().empty() ? "" : check.findings.items().front().code;
  }
  PartCheck check_folder(const std::filesystem::path& folder, double limit_s) {
    FolderCamera camera(folder, clock_, Backlog::all);
    CameraModel model;
    model.width = 64;
    model.height = 48;
    return check_camera(camera, model, clock_, limit_s);
  }
  void put(const std::string& name, int width, int height) {
    write_file_atomic(folder_ / name, encode_image(cv::Mat(height, width, CV_8UC1, cv::Scalar(80)), ImageFormat::png));
  }

  // An autopilot of this system, once it has heard the other end.
  PartCheck check_link(std::uint8_t system, std::uint8_t type = MAV_AUTOPILOT_ARDUPILOTMEGA) {
    PatientClock clock;
    test::LinkPeer peer;
    Airframe airframe;
    airframe.system = 7;
    auto transport = make_transport(parse_endpoint(peer.endpoint()));
    const std::jthread autopilot([&](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        peer.listen();
        if (peer.received(MAVLINK_MSG_ID_HEARTBEAT).empty()) continue;
        mavlink_message_t message;
        mavlink_msg_heartbeat_pack(system, 1, &message, MAV_TYPE_FIXED_WING, type, 0, 0, 0);
        peer.send(message);
        clock.spoken = true;
      }
    });
    return check_autopilot(std::move(transport), airframe, std::move(signing_), clock, 2);
  }

  const test::TemporaryFolder folder_;
  const SystemFlightClock clock_;
  std::optional<Signing> signing_;
};

TEST_F(Preflight, AFrameOfTheRightSizeIsReady) {
  put("a.png", 64, 48);
  const PartCheck check = check_folder(folder_.path(), kLong_s);
  EXPECT_TRUE(check.findings.empty());
  EXPECT_THAT(check.found, HasSubstr("frame a.png, 64 x 48"));
}

TEST_F(Preflight, AFrameOfAnotherSizeIsNot) {
  put("a.png", 640, 480);
  const PartCheck check = check_folder(folder_.path(), kLong_s);
  EXPECT_EQ(only_code(check), "camera.size");
  EXPECT_EQ(check.findings.items().front().found, "640 x 480");
  EXPECT_THAT(check.findings.items().front().expected, HasSubstr("64 x 48"));
}

TEST_F(Preflight, AnEmptyFolderAndAMissingOneAreNoCamera) {
  const PartCheck empty = check_folder(folder_.path(), kSoon_s);
  EXPECT_EQ(only_code(empty), "camera.no_frame");
  EXPECT_EQ(empty.found, "no frame");
  const PartCheck missing = check_folder(folder_ / "none", kSoon_s);
  EXPECT_EQ(only_code(missing), "camera.no_frame");
  EXPECT_THAT(missing.found, HasSubstr("none"));
}

TEST_F(Preflight, TheConfiguredAutopilotIsReady) {
  const PartCheck check = check_link(7);
  EXPECT_TRUE(check.findings.empty());
  EXPECT_THAT(check.found, HasSubstr("7/1, ArduPilot, NOT SIGNED"));
  EXPECT_THAT(check_link(7, MAV_AUTOPILOT_PX4).found, HasSubstr("7/1, PX4, NOT SIGNED"));
}

TEST_F(Preflight, AnAutopilotOfAnotherKindIsNotSupported) {
  const PartCheck check = check_link(7, MAV_AUTOPILOT_PPZ);
  EXPECT_EQ(only_code(check), "autopilot.unsupported");
  EXPECT_EQ(check.findings.items().front().found, "MAV_AUTOPILOT 9");
}

TEST_F(Preflight, AnotherAutopilotIsNotOurs) {
  const PartCheck check = check_link(9);
  EXPECT_EQ(only_code(check), "autopilot.silent");
  EXPECT_EQ(check.found, "only frames of 9/1");
}

TEST_F(Preflight, AnAutopilotWithoutOurKeyIsNotReady) {
  SigningTime time(folder_ / "signing-time", clock_.unix_us(), 0);
  signing_.emplace(SigningKey::generate(), time, std::uint8_t{1});
  const PartCheck check = check_link(7);
  EXPECT_EQ(only_code(check), "autopilot.silent");
  EXPECT_THAT(check.found, HasSubstr("frames without a signature"));
}

}  // namespace
}  // namespace nadir
