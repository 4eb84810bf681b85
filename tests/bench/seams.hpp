// An orthophoto of a flight's frames by their poses; how far its parts are displaced against each other where they
// meet, which is what errors of poses, lens and terrain leave to be seen; and the step of their levels there, which
// exposure and vignetting leave.
//
// Each pixel is of the frame that sees it most from above. Where the pixels of two frames meet in a tile, both frames
// are registered in all that both show of it (measure_seam()), and the step is the difference of their mean levels in
// what both show of a band of 11 pixels along the border: the ground is the same, the levels should be.
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {

struct SeamFigures {
  std::vector<double> shifts_px;  // of seams that could be measured; pixels of the orthophoto
  std::vector<double> steps;      // grey levels, of seams where both frames show enough of the band
  std::size_t seams = 0;
  double gsd_m = 0;  // of the orthophoto
};

using FramePoses = std::vector<std::optional<CameraPose>>;       // one per frame, nothing where it is not to be used
using BenchImageOf = std::function<cv::Mat(std::size_t frame)>;  // CV_8UC1 or CV_8UC3, of the camera's size

// mosaic: where the orthophoto goes, CV_8UC3 with 0 where there is none.
SeamFigures seams(const CameraModel& camera, const LocalFrame& plane, const GroundSurface& surface,
                  const FramePoses& poses, const BenchImageOf& image_of, cv::Mat* mosaic = nullptr);

nlohmann::json json_from(const SeamFigures& figures);

// The same images with their exposures balanced (ortho/radiometric_balance.hpp).
BenchImageOf balanced_images(const CameraModel& camera, const GroundSurface& surface, const FramePoses& poses,
                             const BenchImageOf& image_of);

}  // namespace nadir::bench
