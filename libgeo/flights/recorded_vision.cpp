#include "flights/recorded_vision.hpp"

#include <fmt/format.h>

#include <bit>
#include <cstdint>
#include <cstring>
#include <deque>
#include <string>
#include <utility>

#include "base/error.hpp"

namespace nadir {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie in memory");

// ---- Answers as bytes: one list of members for both directions, so that the two cannot differ.

constexpr std::uint8_t kAnswersVersion = 1;
constexpr std::uint8_t kJudgedMatch = 3;      // a kind of answer: a match whose evidence its matcher has judged
constexpr std::uint32_t kMaxAnswers = 64;     // of a frame; a localizer asks some four questions
constexpr std::uint32_t kMaxPlaces = 4096;    // hypotheses of a search
constexpr std::uint32_t kMaxPatches = 65536;  // correspondences of a pose

class AnswerWriter {
 public:
  template <typename Number>
  void number(Number& value) {
    const auto* at = reinterpret_cast<const std::uint8_t*>(&value);
    bytes_.insert(bytes_.end(), at, at + sizeof value);
  }
  template <typename Element>
  void length(std::vector<Element>& list, std::uint32_t /*most*/) {
    auto size = static_cast<std::uint32_t>(list.size());
    number(size);
  }
  template <typename Value>
  bool presence(std::optional<Value>& value) {
    truth(value.has_value());
    return value.has_value();
  }
  void whole(int& value) { number(value); }
  void truth(bool value) { bytes_.push_back(value ? 1 : 0); }

  Bytes take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

// Beyond the end everything is 0 and good() false.
class AnswerReader {
 public:
  explicit AnswerReader(ByteView bytes) : bytes_(bytes) {}

  template <typename Number>
  void number(Number& value) {
    if (!take(&value, sizeof value)) value = 0;
  }
  template <typename Element>
  void length(std::vector<Element>& list, std::uint32_t most) {
    std::uint32_t size = 0;
    number(size);
    good_ = good_ && size <= most;
    list.resize(good_ ? size : 0);
  }
  template <typename Value>
  bool presence(std::optional<Value>& value) {
    bool there = false;
    truth(there);
    if (there) value.emplace();
    return there;
  }
  void whole(int& value) { number(value); }
  void truth(bool& value) {
    std::uint8_t byte = 0;
    number(byte);
    good_ = good_ && byte <= 1;
    value = good_ && byte == 1;
  }

  bool good() const { return good_; }
  bool at_end() const { return good_ && bytes_.empty(); }

 private:
  bool take(void* target, std::size_t size) {
    good_ = good_ && bytes_.size() >= size;
    if (!good_) return false;
    std::memcpy(target, bytes_.data(), size);
    bytes_ = bytes_.subspan(size);
    return true;
  }

  ByteView bytes_;
  bool good_ = true;
};

template <typename Archive, typename Matrix>
void matrix(Archive& archive, Matrix& value) {
  for (Eigen::Index i = 0; i < value.size(); ++i) archive.number(value.data()[i]);
}

template <typename Archive>
void members(Archive& archive, FrameCheck& check) {
  archive.truth(check.sharp);
  archive.truth(check.repeated);
}

template <typename Archive>
void members(Archive& archive, LinearizationPoint& point) {
  archive.number(point.log_height);
  archive.number(point.heading_rad);
  archive.number(point.pitch_rad);
  archive.number(point.roll_rad);
}

template <typename Archive>
void members(Archive& archive, std::optional<OdometryStep>& answer) {
  if (!archive.presence(answer)) return;
  OdometryStep& step = *answer;
  matrix(archive, step.displacement_m);
  matrix(archive, step.covariance_m2);
  matrix(archive, step.measurement.value);
  matrix(archive, step.measurement.covariance);
  members(archive, step.measurement.before);
  members(archive, step.measurement.now);
  archive.whole(step.inliers);
  archive.number(step.overlap);
}

template <typename Archive>
void members(Archive& archive, CameraPose& pose) {
  archive.number(pose.position.east_m);
  archive.number(pose.position.north_m);
  archive.number(pose.agl_m);
  archive.number(pose.attitude.heading_rad);
  archive.number(pose.attitude.pitch_rad);
  archive.number(pose.attitude.roll_rad);
}

template <typename Archive>
void members(Archive& archive, SolvedPose& solved) {
  members(archive, solved.pose);
  matrix(archive, solved.covariance);
  matrix(archive, solved.measurement_information);
  matrix(archive, solved.measurement_gradient);
  archive.length(solved.inlier, kMaxPatches);
  for (std::size_t i = 0; i < solved.inlier.size(); ++i) {
    bool inlier = solved.inlier[i];
    archive.truth(inlier);
    solved.inlier[i] = inlier;
  }
  archive.length(solved.residual_m, kMaxPatches);
  for (Eigen::Vector2d& residual : solved.residual_m) matrix(archive, residual);
  archive.whole(solved.inliers);
  archive.number(solved.rms_m);
}

template <typename Archive>
void members(Archive& archive, AnchorMatch& match) {
  archive.length(match.search.places, kMaxPlaces);
  for (MatchHypothesis& place : match.search.places) {
    members(archive, place.pose);
    archive.number(place.score);
    archive.number(place.coarse_score);
  }
  archive.number(match.search.ratio);
  if (archive.presence(match.solved)) members(archive, *match.solved);
  archive.whole(match.patches);
  archive.number(match.frame_share);
  archive.number(match.fine_gsd_m);
  archive.number(match.coarse_gsd_m);
  archive.truth(match.on_map);
  if (archive.presence(match.map_ce90_m)) archive.number(*match.map_ce90_m);
}

// An answer of the kind that the number says; nothing for a kind that there is not.
std::optional<VisionAnswer> empty_answer(std::uint8_t kind) {
  switch (kind) {
    case 0: return FrameCheck{};
    case 1: return std::optional<OdometryStep>{};
    case 2:
    case kJudgedMatch: return AnchorMatch{};
    default: return std::nullopt;
  }
}

}  // namespace

Bytes encode_answers(std::span<const VisionAnswer> answers) {
  AnswerWriter writer;
  std::uint8_t version = kAnswersVersion;
  writer.number(version);
  auto count = static_cast<std::uint32_t>(answers.size());
  writer.number(count);
  for (VisionAnswer answer : answers) {
    const auto* match = std::get_if<AnchorMatch>(&answer);
    const bool judged = match != nullptr && match->judged_log_likelihood_ratio;
    auto kind = judged ? kJudgedMatch : static_cast<std::uint8_t>(answer.index());
    writer.number(kind);
    std::visit([&writer](auto& value) { members(writer, value); }, answer);
    if (!judged) continue;
    double log_likelihood_ratio = *match->judged_log_likelihood_ratio;
    writer.number(log_likelihood_ratio);
  }
  return writer.take();
}

std::optional<VisionAnswers> decode_answers(ByteView bytes) {
  AnswerReader reader(bytes);
  std::uint8_t version = 0;
  std::uint32_t count = 0;
  reader.number(version);
  reader.number(count);
  if (!reader.good() || version != kAnswersVersion || count > kMaxAnswers) return std::nullopt;
  VisionAnswers answers;
  for (std::uint32_t i = 0; i < count; ++i) {
    std::uint8_t kind = 0;
    reader.number(kind);
    auto answer = reader.good() ? empty_answer(kind) : std::nullopt;
    if (!answer) return std::nullopt;
    std::visit([&reader](auto& value) { members(reader, value); }, *answer);
    if (kind == kJudgedMatch) reader.number(std::get<AnchorMatch>(*answer).judged_log_likelihood_ratio.emplace());
    answers.push_back(std::move(*answer));
  }
  if (!reader.at_end()) return std::nullopt;
  return answers;
}

// ---- The localizer's front ends

// What the wrapped front ends share: the answers of the current frame, and what is needed to go live.
struct RecordedVision::Tape {
  std::size_t frame = 0;
  bool restoring = false;
  VisionAnswers answers;
  std::size_t asked = 0;  // of `answers`, while restoring

  // The real ones of the localizer that is attached, and what they would remember. The localizer owns them.
  FrameChecker* checker = nullptr;
  OdometryFrontEnd* odometry = nullptr;
  std::optional<std::size_t> last_sharp;
  struct GivenFrame {
    std::size_t frame = 0;
    OdometryFrame seen;  // without its image
  };
  std::deque<GivenFrame> given;  // to odometry, as many as it compares a frame with; since it was last reset

  [[noreturn]] void refuse(std::string found) const {
    throw Error({.what = fmt::format("frame {} is estimated differently than when it was processed", frame),
                 .expected = "the inputs and the version of Nadir that the flight was begun with",
                 .found = std::move(found),
                 .fix = "go on with that version and those inputs, or process the flight from the start"});
  }

  template <typename Answer>
  const Answer& next_restored() {
    if (asked == answers.size()) refuse("a question more than were recorded");
    const auto* answer = std::get_if<Answer>(&answers[asked]);
    if (answer == nullptr) refuse("another question than was recorded");
    ++asked;
    return *answer;
  }
};

namespace {

constexpr std::size_t kComparedFrames = 2;  // the last one and, over an outlier, the one before it

class RecordedFrameChecker final : public FrameChecker {
 public:
  RecordedFrameChecker(std::shared_ptr<RecordedVision::Tape> tape, std::unique_ptr<FrameChecker> real)
      : tape_(std::move(tape)), real_(std::move(real)) {
    tape_->checker = real_.get();
  }

  FrameCheck check(const cv::Mat& grey) override {
    const FrameCheck found = tape_->restoring ? tape_->next_restored<FrameCheck>() : real_->check(grey);
    if (!tape_->restoring) tape_->answers.emplace_back(found);
    if (found.sharp) tape_->last_sharp = tape_->frame;
    return found;
  }

 private:
  std::shared_ptr<RecordedVision::Tape> tape_;
  std::unique_ptr<FrameChecker> real_;
};

class RecordedOdometry final : public OdometryFrontEnd {
 public:
  RecordedOdometry(std::shared_ptr<RecordedVision::Tape> tape, std::unique_ptr<OdometryFrontEnd> real)
      : tape_(std::move(tape)), real_(std::move(real)) {
    tape_->odometry = real_.get();
  }

  std::optional<OdometryStep> track(const OdometryFrame& frame) override {
    using Answer = std::optional<OdometryStep>;
    Answer step = tape_->restoring ? tape_->next_restored<Answer>() : real_->track(frame);
    if (!tape_->restoring) tape_->answers.emplace_back(step);
    tape_->given.push_back({tape_->frame, frame});
    tape_->given.back().seen.grey.release();
    if (tape_->given.size() > kComparedFrames) tape_->given.pop_front();
    return step;
  }

  std::optional<OdometryStep> track_over_last() override {
    using Answer = std::optional<OdometryStep>;
    Answer step = tape_->restoring ? tape_->next_restored<Answer>() : real_->track_over_last();
    if (!tape_->restoring) tape_->answers.emplace_back(step);
    return step;
  }

  void reset() override {
    tape_->given.clear();
    real_->reset();
  }

 private:
  std::shared_ptr<RecordedVision::Tape> tape_;
  std::unique_ptr<OdometryFrontEnd> real_;
};

class RecordedMatcher final : public MapMatcher {
 public:
  RecordedMatcher(std::shared_ptr<RecordedVision::Tape> tape, std::unique_ptr<MapMatcher> real)
      : tape_(std::move(tape)), real_(std::move(real)) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    return answer([&] { return real_->match(grey, prior); });
  }
  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return answer([&] { return real_->match_anywhere(grey, prior, area); });
  }
  AnchorMatch match_among(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area,
                          const SearchSuggestions& suggested) override {
    return answer([&] { return real_->match_among(grey, prior, area, suggested); });
  }

 private:
  template <typename Ask>
  AnchorMatch answer(const Ask& ask) {
    if (tape_->restoring) return tape_->next_restored<AnchorMatch>();
    AnchorMatch match = ask();
    AnchorMatch kept = match;
    kept.rectified.release();
    kept.matched_map.release();
    tape_->answers.emplace_back(std::move(kept));
    return match;
  }

  std::shared_ptr<RecordedVision::Tape> tape_;
  std::unique_ptr<MapMatcher> real_;
};

}  // namespace

RecordedVision::RecordedVision() : tape_(std::make_shared<Tape>()) {}
RecordedVision::~RecordedVision() = default;

void RecordedVision::attach(LocalizerConfig& config) {
  config.frame_checker = [tape = tape_, make = config.frame_checker] {
    return std::make_unique<RecordedFrameChecker>(tape, make());
  };
  config.odometry = [tape = tape_, make = config.odometry] { return std::make_unique<RecordedOdometry>(tape, make()); };
  config.matcher = [tape = tape_, make = config.matcher](const MatcherMap& map) {
    return std::make_unique<RecordedMatcher>(tape, make(map));
  };
}

void RecordedVision::restore(std::size_t frame, VisionAnswers answers) {
  tape_->frame = frame;
  tape_->restoring = true;
  tape_->answers = std::move(answers);
  tape_->asked = 0;
}

void RecordedVision::begin_frame(std::size_t frame) {
  tape_->frame = frame;
  tape_->restoring = false;
  tape_->answers.clear();
}

VisionAnswers RecordedVision::end_frame() {
  if (tape_->restoring && tape_->asked != tape_->answers.size()) tape_->refuse("fewer questions than were recorded");
  return std::exchange(tape_->answers, {});
}

void RecordedVision::go_live(const ImageOf& image_of) {
  const auto image = [&](std::size_t frame) {
    cv::Mat grey = image_of(frame);
    if (!grey.empty()) return grey;
    throw Error({.what = fmt::format("frame {} is needed to go on, and its picture cannot be read any more", frame),
                 .expected = "the picture that was processed",
                 .fix = "restore the picture, or process the flight from the start"});
  };
  cv::Mat sharp;
  if (tape_->last_sharp) {
    sharp = image(*tape_->last_sharp);
    tape_->checker->check(sharp);
  }
  for (const auto& [frame, seen] : tape_->given) {
    OdometryFrame with_image = seen;
    with_image.grey = frame == tape_->last_sharp ? sharp : image(frame);
    if (const auto& undone = seen.undone) {
      with_image.grey = without_rolling_shutter(with_image.grey, seen.camera, undone->readout, undone->motion);
    }
    tape_->odometry->track(with_image);
  }
}

}  // namespace nadir
