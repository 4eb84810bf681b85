// report.html: one page that carries everything inside and loads nothing. Its looks live in report/*.{html,css,js},
// which the build embeds; here only the data is put together.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "estimation/estimate.hpp"
#include "cli/output.hpp"
#include "geodesy/local_frame.hpp"
#include "replay/score.hpp"
#include "replay/worst_frames.hpp"

namespace nadir {

// A picture of the map below the track, north-up in the plane of the report's frame.
struct ReportMap {
  std::string image_uri;
  double west_m = 0, north_m = 0, width_m = 0, height_m = 0;
};

struct ReportInput {
  std::string title;
  std::string subtitle;
  LocalFrame frame;
  std::vector<FrameReport> frames;  // the pictures in them are not used
  std::vector<Estimate> refined;
  Truth truth;  // as many as frames
  Score score;
  Figures figures;
  std::vector<FramePictures> worst;
  std::optional<ReportMap> map;
};

std::string report_html(const ReportInput& input);

}  // namespace nadir
