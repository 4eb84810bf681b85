// A localizer that is answered from a record gives the same estimates, without the pictures.
#include "flights/recorded_vision.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/random.hpp"
#include "flights/stored_flight.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace {

using namespace test;

Bytes bits(std::size_t frame, const FrameReport& report) {
  return encode(Record(EstimateRecord{frame, report.estimate, report.odometry, report.state}));
}

struct Flown {
  std::vector<VisionAnswers> answers;
  std::vector<Bytes> estimates;
};

// With the real front ends.
const Flown& flown() {
  static const Flown result = [] {
    Flown flown;
    RecordedVision vision;
    LocalizerConfig recorded = config();
    vision.attach(recorded);
    Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), recorded);
    for (const Moment& moment : short_flight()) {
      const std::size_t frame = flown.answers.size();
      vision.begin_frame(frame);
      flown.estimates.push_back(bits(frame, localizer.process(moment.image, moment.telemetry)));
      flown.answers.push_back(vision.end_frame());
    }
    return flown;
  }();
  return result;
}

TEST(RecordedVision, RecordingChangesNothing) {
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), config());
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    EXPECT_EQ(flown().estimates[i], bits(i, localizer.process(short_flight()[i].image, short_flight()[i].telemetry)))
        << i;
  }
}

TEST(RecordedVision, TheSameEstimatesWithoutPicturesAndWithoutAMap) {
  class NoTiles final : public TileSource {
   public:
    ZoomRange zooms() const override { return landscape_tiles().zooms(); }
    std::optional<Bytes> read(const TileKey&) const override { throw std::logic_error("the map was read"); }
  };
  const NoTiles tiles;
  RecordedVision vision;
  LocalizerConfig restored = config();
  vision.attach(restored);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &tiles, start(), restored);
  for (std::size_t i = 0; i < short_flight().size(); ++i) {
    const auto answers = decode_answers(encode_answers(flown().answers[i]));
    ASSERT_TRUE(answers);
    vision.restore(i, *answers);
    EXPECT_EQ(flown().estimates[i], bits(i, localizer.process({}, short_flight()[i].telemetry))) << i;
    vision.end_frame();
  }
}

TEST(RecordedVision, AnotherInputIsNoticed) {
  RecordedVision vision;
  LocalizerConfig other = config();
  vision.attach(other);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), nullptr, start(), other);  // there was a map
  vision.restore(0, flown().answers[0]);
  localizer.process({}, short_flight()[0].telemetry);
  EXPECT_THROW(vision.end_frame(), Error);

  Localizer mapped(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), other);
  vision.restore(0, {});
  EXPECT_THROW(mapped.process({}, short_flight()[0].telemetry), Error);
}

TEST(RecordedVision, GoingOnNeedsThePicturesThatTheFrontEndsRemember) {
  RecordedVision vision;
  LocalizerConfig restored = config();
  vision.attach(restored);
  Localizer localizer(flight_camera(), LocalFrame(kOrigin), &landscape_tiles(), start(), restored);
  for (std::size_t i = 0; i < 3; ++i) {
    vision.restore(i, flown().answers[i]);
    localizer.process({}, short_flight()[i].telemetry);
    vision.end_frame();
  }
  EXPECT_THROW(vision.go_live([](std::size_t) { return cv::Mat(); }), Error);
  std::vector<std::size_t> asked;
  vision.go_live([&](std::size_t frame) {
    asked.push_back(frame);
    return short_flight()[frame].image;
  });
  EXPECT_EQ(asked, (std::vector<std::size_t>{2, 1})) << "the last sharp one, and odometry's last two";
  vision.begin_frame(3);
  EXPECT_EQ(flown().estimates[3], bits(3, localizer.process(short_flight()[3].image, short_flight()[3].telemetry)));
}

TEST(VisionAnswerBytes, EveryBitComesBack) {
  for (const VisionAnswers& answers : flown().answers) {
    ASSERT_GE(answers.size(), 3U) << "the check, odometry, one match at least";
    const Bytes bytes = encode_answers(answers);
    const auto again = decode_answers(bytes);
    ASSERT_TRUE(again);
    EXPECT_EQ(encode_answers(*again), bytes);
    EXPECT_LT(bytes.size(), 20'000U);
  }
  const auto& match = std::get<AnchorMatch>(flown().answers[0].back());
  const auto again = decode_answers(encode_answers({&flown().answers[0].back(), 1}));
  const auto& same = std::get<AnchorMatch>(again->front());
  ASSERT_TRUE(match.solved && same.solved);
  EXPECT_EQ(match.solved->covariance, same.solved->covariance);
  EXPECT_EQ(match.solved->inlier, same.solved->inlier);
  EXPECT_EQ(match.search.places.size(), same.search.places.size());
  EXPECT_FALSE(same.judged_log_likelihood_ratio);
}

// What a second matcher made of it is one more number; other flights are stored as they always were.
TEST(VisionAnswerBytes, AJudgedMatchKeepsItsEvidence) {
  const VisionAnswer& answer = flown().answers[0].back();
  AnchorMatch match = std::get<AnchorMatch>(answer);
  match.judged_log_likelihood_ratio = -1.25;
  const VisionAnswer judged = match;
  const Bytes bytes = encode_answers({&judged, 1});
  EXPECT_EQ(bytes.size(), encode_answers({&answer, 1}).size() + sizeof(double));
  const auto again = decode_answers(bytes);
  ASSERT_TRUE(again);
  EXPECT_EQ(std::get<AnchorMatch>(again->front()).judged_log_likelihood_ratio, -1.25);
  EXPECT_FALSE(decode_answers(ByteView(bytes).first(bytes.size() - 1)));
}

TEST(VisionAnswerBytes, OtherBytesAreRefused) {
  const Bytes bytes = encode_answers(flown().answers[1]);
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    EXPECT_FALSE(decode_answers(ByteView(bytes).first(length))) << length;
  }
  Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_FALSE(decode_answers(longer));
  Random random(5);
  for (int i = 0; i < 5000; ++i) {  // whatever comes of it, it is not a crash and not a huge allocation
    Bytes changed = bytes;
    changed[static_cast<std::size_t>(random.integer(0, static_cast<int>(changed.size()) - 1))] =
        static_cast<std::uint8_t>(random.integer(0, 255));
    decode_answers(changed);
  }
}

}  // namespace
}  // namespace nadir
