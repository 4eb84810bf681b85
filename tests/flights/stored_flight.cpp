#include "flights/stored_flight.hpp"

#include <fmt/format.h>

#include <map>
#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "imagery/codecs.hpp"
#include "recorder/record_codec.hpp"

namespace nadir::test {

std::vector<PictureOffer> offers(const std::vector<EncodedPicture>& pictures) {
  std::vector<PictureOffer> batch;
  for (const EncodedPicture& picture : pictures) batch.push_back(picture.offer());
  return batch;
}

EncodedPicture plain_picture(int number) {
  const CameraModel camera = flight_camera().camera;
  cv::Mat image(camera.height, camera.width, CV_8UC1, cv::Scalar(100));
  for (int bit = 0; bit < 31; ++bit) {
    image(cv::Rect(bit * 10, 0, 10, 20)) = ((number >> bit) & 1) != 0 ? 250 : 5;
  }
  EncodedPicture picture{fmt::format("picture{}.jpg", number), {}, encode_image(image, ImageFormat::jpeg, 90)};
  picture.telemetry.time_s = number;
  picture.telemetry.agl_m = 100;
  return picture;
}

namespace {

std::vector<EncodedPicture> made_pictures(Course course) {
  const bool eventful = course == Course::eventful;
  std::vector<EncodedPicture> pictures;
  const std::vector<Moment> moments = flight(eventful ? 10 : 5);
  for (std::size_t i = 0; i < moments.size(); ++i) {
    EncodedPicture& picture = pictures.emplace_back();
    picture.telemetry = moments[i].telemetry;
    if (course == Course::rolling) picture.telemetry.rate_rad_s = Eigen::Vector3d(0.02, -0.03, 0.05);
    picture.name = picture.telemetry.frame = fmt::format("frame{}.img", i);
    picture.bytes = encode_image(moments[i].image, ImageFormat::png);
    if (!eventful) continue;
    if (i == 2) picture.bytes = encode_image(cv::Mat::zeros(moments[i].image.size(), CV_8UC1), ImageFormat::png);
    // The same pixels in other bytes: a camera that hangs.
    cv::Mat colour;
    if (i == 4) {
      cv::merge(std::vector<cv::Mat>(3, moments[3].image), colour);
      picture.bytes = encode_lossless_webp(colour);
    }
    if (i == 8) picture.bytes = encode_image(moments[0].image, ImageFormat::webp, 95);
  }
  return pictures;
}

}  // namespace

const std::vector<EncodedPicture>& flight_pictures(Course course) {
  static std::map<Course, std::vector<EncodedPicture>> made;
  const auto known = made.find(course);
  return known != made.end() ? known->second : made.emplace(course, made_pictures(course)).first->second;
}

FlightDescription description(Course course) {
  const FlightEngineSetup setup = engine_setup(course);
  SessionRecord session;
  session.program = "test";
  session.camera = setup.camera;
  session.origin = setup.frame.origin();
  session.start = setup.start;
  session.localizer = setup.localizer;
  return {.name = "a flight", .package = "landscape", .camera_text = "", .session = session};
}

FlightEngineSetup engine_setup(Course course) {
  FlightEngineSetup setup{.camera = flight_camera(),
                          .shrink = 1,
                          .frame = LocalFrame(kOrigin),
                          .tiles = &landscape_tiles(),
                          .start = start(),
                          .localizer = config()};
  if (course == Course::rolling) setup.camera.readout = SensorReadout{0.03};
  if (course == Course::eventful) {
    setup.start.reset();
    setup.localizer.area = PlaneBox{-150, -150, 150, 150};
  }
  return setup;
}

std::unique_ptr<FlightStore> stored_flight(const std::filesystem::path& folder, Course course,
                                           const FlightStoreOptions& options) {
  auto store = FlightStore::create(folder, description(course), kNow, options);
  for (const PictureAnswer& answer : store->accept(offers(flight_pictures(course)), kNow)) {
    if (answer.outcome != PictureAnswer::Outcome::accepted) throw std::logic_error("a picture was refused");
  }
  return store;
}

std::string written_out(const FlightStore& store) {
  std::string text;
  for (const EstimateKind kind : {EstimateKind::online, EstimateKind::refined}) {
    std::size_t index = 0;
    for (Estimate estimate : store.estimates(kind)) {
      estimate.latency_ms = 0;
      const Bytes bytes = encode(Record(EstimateRecord{index, estimate, {}, {}}));
      text += fmt::format("{} {} {}\n", name_of(kind), index++, sha256(bytes).hex());
    }
  }
  for (const FlightSegment& segment : store.segments()) {
    text +=
        fmt::format("segment {} {} to {} {} {}\n", segment.number, segment.first_frame, segment.last_frame,
                    name_of(segment.state), segment.anchored_frame ? static_cast<int>(*segment.anchored_frame) : -1);
  }
  for (const EventRow& row : store.events_after(0, 100'000)) {
    text += fmt::format("event {} {} {} {}\n", row.id, name_of(row.event.kind),
                        row.event.frame ? static_cast<int>(*row.event.frame) : -1, row.event.body);
  }
  return text;
}

}  // namespace nadir::test
