// What vision found in the frames of a flight, and a localizer that works from it without the frames.
//
// Nearly all of a frame's time is spent in three calls behind interfaces: is the frame usable (FrameChecker), how did
// the camera move (OdometryFrontEnd), where on the map is it (MapMatcher, not at all or several times). All the rest of
// the localizer is arithmetic on their answers: the same answers in the same order give the same estimates, bit for
// bit. So a flight is kept as these answers, some kilobytes a frame. To go on with it, a new localizer estimates the
// flight again from them, in less than a millisecond a frame; no state of the localizer is ever stored.
//
//   RecordedVision vision;
//   vision.attach(config);                       // wraps the three factories
//   Localizer localizer(…, config);
//   for each frame that is known:  vision.restore(i, answers); localizer.process({}, telemetry); vision.end_frame();
//   vision.go_live(image_of);                    // once, before the first frame that is not
//   for each further frame:        vision.begin_frame(i); localizer.process(image, telemetry); vision.end_frame();
//
// Two of the three remember frames: odometry the last two that it was given, the checker the last sharp one. go_live()
// asks for those images and gives them to the real ones. A matcher remembers nothing that changes a result.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "base/bytes.hpp"
#include "estimation/localizer.hpp"

namespace nadir {

// One answer. Of an AnchorMatch all but its images.
using VisionAnswer = std::variant<FrameCheck, std::optional<OdometryStep>, AnchorMatch>;
using VisionAnswers = std::vector<VisionAnswer>;  // of a frame, in the order of the questions

// Every bit of every number. docs/formats/flight.md has the layout.
Bytes encode_answers(std::span<const VisionAnswer> answers);
// nullopt for bytes that encode_answers() does not make.
std::optional<VisionAnswers> decode_answers(ByteView bytes);

class RecordedVision {
 public:
  RecordedVision();
  ~RecordedVision();
  RecordedVision(const RecordedVision&) = delete;
  RecordedVision& operator=(const RecordedVision&) = delete;

  // Before the localizer is made. May outlive this object, but then answers no longer.
  void attach(LocalizerConfig& config);

  // The localizer's next frame is answered from `answers`. A localizer that asks anything else than it did then ends in
  // an Error: it has other inputs than the one that was recorded, or it is another version.
  void restore(std::size_t frame, VisionAnswers answers);
  // The localizer's next frame is answered by the real front ends.
  void begin_frame(std::size_t frame);
  // The answers since then. Throws Error when some of those to be restored were not asked for.
  VisionAnswers end_frame();

  // image_of: the image (CV_8UC1) that the localizer was given as this frame. Throws Error when it is empty.
  using ImageOf = std::function<cv::Mat(std::size_t frame)>;
  void go_live(const ImageOf& image_of);

  struct Tape;

 private:
  std::shared_ptr<Tape> tape_;
};

}  // namespace nadir
