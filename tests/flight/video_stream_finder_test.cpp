// What a MAVLink camera says, and which of its streams counts. A real camera's end is tests/camera_video.
#include "flight/video_stream_finder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;
using Kind = VideoStream::Kind;

constexpr MavlinkAddress kCamera{1, 100};

VideoStream stream(int id, int width, const std::string& uri, Kind kind = Kind::rtsp, bool running = true) {
  return {.kind = kind, .id = id, .count = 3, .width = width, .height = width * 3 / 4, .running = running, .uri = uri};
}

std::string why_not(const VideoStreamFinder& finder) {
  try {
    return "found " + finder.uri();
  } catch (const Error& error) {
    return error.what();
  }
}

TEST(MavlinkCameraSource, IsAComponentAndPerhapsAStream) {
  EXPECT_FALSE(mavlink_camera("rtsp://10.0.0.5/live"));
  EXPECT_EQ(mavlink_camera("mavlink:100")->component, 100);
  EXPECT_FALSE(mavlink_camera("mavlink:100")->stream);
  EXPECT_EQ(mavlink_camera("mavlink:101:2")->stream, 2);
  for (const char* wrong : {"mavlink:", "mavlink:0", "mavlink:256", "mavlink:100:", "mavlink:100:x", "mavlink:100:0",
                            "mavlink: 100", "mavlink:100/2"}) {
    EXPECT_THROW(mavlink_camera(wrong), UsageError) << wrong;
  }
}

TEST(VideoStreamFinder, AsksOnceASecondUntilItKnowsAndThenNowAndAgain) {
  VideoStreamFinder finder(1, {100}, 640, 480);
  const auto first = finder.requests(10);
  ASSERT_EQ(first.size(), 2U);
  EXPECT_EQ(first[0].target, kCamera);
  EXPECT_EQ(first[0].command, 512) << "MAV_CMD_REQUEST_MESSAGE";
  EXPECT_EQ(first[0].parameters[0], 269);
  EXPECT_EQ(first[0].parameters[1], 0) << "of all streams";
  EXPECT_EQ(first[1].parameters[0], 259);
  EXPECT_TRUE(finder.requests(10.9).empty());
  EXPECT_EQ(finder.requests(11.1).size(), 2U);
  finder.on_message(kCamera, CameraInformation{"Example", "Eye", true});
  finder.on_message(kCamera, stream(1, 640, "rtsp://10.0.0.5/1"));
  EXPECT_TRUE(finder.requests(20).empty());
  EXPECT_EQ(finder.requests(21.2).size(), 1U);
  finder.on_message(kCamera, stream(1, 640, "rtsp://10.0.0.6/1"));
  EXPECT_EQ(finder.uri(), "rtsp://10.0.0.6/1") << "it has moved";
}

TEST(VideoStreamFinder, TakesTheStreamThatFitsTheCalibratedCamera) {
  VideoStreamFinder finder(1, {100}, 640, 480);
  EXPECT_THAT(why_not(finder), HasSubstr("no answer"));
  finder.on_message({1, 101}, stream(1, 640, "rtsp://another/camera"));
  finder.on_message({2, 100}, stream(1, 640, "rtsp://another/aircraft"));
  EXPECT_THAT(why_not(finder), HasSubstr("no answer"));
  finder.on_message(kCamera, CameraInformation{"Example", "Eye\n1", false});
  EXPECT_THAT(why_not(finder), HasSubstr("Example Eye?1: no streams"));
  finder.on_message(kCamera, stream(1, 1920, "rtsp://10.0.0.5/1"));
  finder.on_message(kCamera, stream(2, 640, "5600", Kind::rtp_udp));
  EXPECT_THAT(why_not(finder), HasSubstr("1: RTSP, 1920 x 1440; 2: RTP, 640 x 480"));
  EXPECT_THAT(why_not(finder), HasSubstr("640 x 480 pixels"));
  finder.on_message(kCamera, stream(3, 640, "rtsp://10.0.0.5/3", Kind::rtsp, false));
  EXPECT_EQ(finder.uri(), "rtsp://10.0.0.5/3");
  finder.on_message(kCamera, stream(4, 0, "rtsp://10.0.0.5/4"));
  EXPECT_EQ(finder.uri(), "rtsp://10.0.0.5/4") << "it runs, and states no size";
  VideoStreamFinder third(1, {100, 3}, 640, 480);
  third.on_message(kCamera, stream(4, 640, "rtsp://10.0.0.5/4"));
  EXPECT_THAT(why_not(third), HasSubstr("with the number 3"));
  third.on_message(kCamera, stream(3, 640, "rtsp://10.0.0.5/3"));
  EXPECT_EQ(third.uri(), "rtsp://10.0.0.5/3");
}

// What it names is opened: nothing but an address of a network camera.
TEST(VideoStreamFinder, AnAddressIsAnAddress) {
  for (const char* wrong :
       {"", "rtsp://", "file:///etc/shadow", "gstreamer:filesrc location=/etc/shadow", "/etc/shadow",
        "rtsp://10.0.0.5/a b", "rtsp://10.0.0.5/\n", "rtsp://10.0.0.5/\"", "rtsp://10.0.0.5/\xff"}) {
    VideoStreamFinder finder(1, {100}, 0, 0);
    finder.on_message(kCamera, stream(1, 640, wrong));
    EXPECT_THAT(why_not(finder), HasSubstr("without an address")) << wrong;
  }
  VideoStreamFinder finder(1, {100}, 0, 0);
  for (int id = 1; id < 200; ++id) finder.on_message(kCamera, stream(id, 640, "x"));
  finder.on_message(kCamera, stream(201, 640, "rtsp://10.0.0.5/201"));
  EXPECT_THAT(why_not(finder), HasSubstr("without an address")) << "no list without end";
}

class OneFrame final : public CameraSource {
 public:
  explicit OneFrame(std::string uri) : uri_(std::move(uri)) {}
  CameraReading next(std::chrono::milliseconds, std::stop_token) override {
    CameraReading reading{.status = CameraStatus::frame};
    reading.frame.name = uri_;
    return reading;
  }
  std::string describe() const override { return uri_; }

 private:
  std::string uri_;
};

TEST(StreamCamera, IsOpenedWhenItsAddressIsKnownAndAgainWhenThatChanges) {
  VideoStreamFinder finder(1, {100}, 0, 0);
  int opened = 0;
  StreamCamera camera(finder, [&](const std::string& uri) {
    ++opened;
    return std::make_unique<OneFrame>(uri);
  });
  const auto next = [&] { return camera.next(std::chrono::milliseconds(0), {}); };
  EXPECT_EQ(next().status, CameraStatus::failure);
  EXPECT_THAT(next().detail, HasSubstr("no video stream of the camera is known"));
  finder.on_message(kCamera, stream(1, 640, "rtsp://10.0.0.5/1"));
  EXPECT_EQ(next().frame.name, "rtsp://10.0.0.5/1");
  next();
  EXPECT_EQ(opened, 1);
  finder.on_message(kCamera, stream(1, 640, "rtsp://10.0.0.6/1"));
  EXPECT_EQ(next().frame.name, "rtsp://10.0.0.6/1");
  EXPECT_EQ(opened, 2);
}

}  // namespace
}  // namespace nadir
