// report.html: one self-contained page about a replay that loads nothing. Its layout lives in report/*.{html,css,js},
// which the build embeds; this module collects the data: the track, the map below it, and the worst frames.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/output.hpp"
#include "estimation/estimate.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/tile_source.hpp"
#include "package/vector_layer.hpp"
#include "replay/score.hpp"

namespace nadir {

// An image of the map below the track, north-up in the plane of the report's frame.
struct ReportMap {
  std::string image_uri;
  double west_m = 0, north_m = 0, width_m = 0, height_m = 0;
};

// Images of a frame and of the map where it was matched.
struct FrameImages {
  std::size_t index = 0;
  double cost = 0;
  std::string frame_uri;  // data URIs, JPEG
  std::string map_uri;
};

// Keeps the images of the worst frames for the report. Memory is bounded, however long the flight.
class WorstFrames {
 public:
  explicit WorstFrames(std::size_t capacity) : capacity_(capacity) {}

  // Frames without both images are ignored. cost: see report_cost().
  void offer(std::size_t index, double cost, const AnchorReport& anchor);

  const std::vector<FrameImages>& worst_first() const { return kept_; }

 private:
  std::size_t capacity_;
  std::vector<FrameImages> kept_;  // worst first
};

// The error where it is known. Without truth: how close the match was to rejection, rejected ones first.
double report_cost(const FrameReport& report, std::optional<double> error_m);

struct ReportInput {
  std::string title;
  std::string subtitle;
  LocalFrame frame;
  std::vector<FrameReport> frames;  // their images are not used
  std::vector<Estimate> refined;
  Truth truth;  // as many as frames
  Score score;
  IntegrityFigures integrity;
  Figures figures;
  std::vector<FrameImages> worst;
  std::optional<ReportMap> map;
  std::optional<VectorLayer> vectors{};  // of the package; what lies on the map is drawn
  std::string notice{};                  // above everything else: why nothing was localized; may be empty
};

// "data:image/jpeg;base64,…" of a CV_8UC1 or CV_8UC3 image, reduced so that no side exceeds `max_side` pixels.
std::string jpeg_data_uri(const cv::Mat& image, int max_side, int quality);

// The imagery around the track; nothing where the map has no pixels there.
std::optional<ReportMap> report_map(const TileSource& tiles, const LocalFrame& frame, PlaneBox track);

std::string report_html(const ReportInput& input);

}  // namespace nadir
