// Why do the first frames of a flight match nowhere? Answered by experiment.
//
// What people state wrongly is mostly one of a few things: heights in feet or above sea level, a focal length, the zero
// or the sense of headings, the start, the package. Each is a hypothesis h under which the telemetry is changed, and
// under which a few frames are looked up on the map again. A look that finds a candidate yields ℓ, the log likelihood
// ratio of the true place over a chance peak (estimation/look_likelihood.hpp). The first hit fixes height, heading and
// place; the frames after it are looked up around it, as far as an aircraft flies in that time, at the same factor of
// height, so that they can contradict it. The evidence for h is
//
//   E(h) = ℓ_1 + Σ s_k ℓ_k - ln N
//
// over the frames that hit: s_k is the share of ground that no earlier hit showed (the same ground is one witness, as
// in estimation/belief.hpp), N the number of hypotheses (each is another chance for a chance peak). An explanation
// needs three frames that agree and the evidence that the localizer calls unambiguous: a wrong diagnosis is worse than
// none.
//
// It is one of
//   - a cause, when one hypothesis passes;
//   - "nowhere", when no frame matched as stated, near the start and in the whole area, and no hypothesis passed;
//   - nothing: the frames match as stated, or too few are usable, or the experiments contradict each other.
//
// Reads no clock but the one given, for its budget. Changes no estimate: what it finds is for a person to correct.
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/progress.hpp"
#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/tile_source.hpp"
#include "vision/camera.hpp"
#include "vision/ground_surface.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

// Of a flight's beginning, that are looked at.
inline constexpr std::size_t kDiagnosedFrames = 12;

// When the experiments are worth their time: once, after three frames that were looked up and matched nowhere.
class NoFixWatch {
 public:
  bool due(AnchorVerdict verdict);  // of the next frame
  bool anchored() const { return anchored_; }

 private:
  int failed_ = 0;
  bool anchored_ = false;
};

enum class NoFixCause {
  height,   // the frames match at another height, or with another focal length
  heading,  // at another heading
  height_and_heading,
  start,   // elsewhere in the area
  nowhere  // in no way that was tried
};
std::string_view name_of(NoFixCause cause);

struct NoFixDiagnosis {
  NoFixCause cause = NoFixCause::nowhere;
  int frames_tried = 0, frames_matched = 0;
  double height_factor = 1;                    // found over stated, of the first frame that matched
  std::optional<double> heading_offset_rad{};  // found less stated, likewise; nothing where the cause is no heading
  std::optional<LonLat> place{};               // of the camera at the first frame that matched
  std::string text;                            // in words, with what to look at
};

// The flight as it was stated. All of it must outlive the call.
struct StatedFlight {
  const CameraFile& camera;  // of the images that `read` returns
  const LocalFrame& frame;
  const TileSource& tiles;
  std::optional<LonLat> start;
  std::optional<PlaneBox> area;            // of the package; needed without a start
  const GroundSurface* surface = nullptr;  // null: flat ground
  const PlaceRetrieval* places = nullptr;
  std::optional<double> ground_msl_m;  // of the ground, above sea level, where it is known
  std::span<const Telemetry> telemetry;
  std::function<cv::Mat(std::size_t frame)> read;  // CV_8UC1; empty: cannot be decoded
  MapMatcherFactory matcher = make_channel_matcher;
};

struct DiagnosisBudget {
  double seconds = 60;                  // after which no further hypothesis is tried, but that of another start
  std::function<double()> elapsed_s{};  // since the call; empty: processor time of the calling thread, which does not
                                        // depend on what else the machine does
  Cancel cancel{};
};

// Throws Interrupted when cancelled.
std::optional<NoFixDiagnosis> diagnose_no_fix(const StatedFlight& flight, const DiagnosisBudget& budget = {});

}  // namespace nadir
