// An orthophoto of a flight's frames by their poses, and how far its parts are displaced against each other where they
// meet: what errors of poses, lens and terrain leave to be seen.
//
// Each pixel is of the frame that sees it most from above. Where the pixels of two frames meet in a tile, both frames
// are registered in all that both show of it (measure_seam()).
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "vision/rectification.hpp"

namespace nadir::bench {

struct SeamFigures {
  std::vector<double> shifts_px;  // of seams that could be measured; pixels of the orthophoto
  std::size_t seams = 0;
  double gsd_m = 0;  // of the orthophoto
};

// poses: one per frame, nothing where it is not to be used. image_of: CV_8UC1, of the camera's size. mosaic: where the
// orthophoto goes, CV_8UC1 with 0 where there is none.
SeamFigures seams(const CameraModel& camera, const LocalFrame& plane, const GroundSurface& surface,
                  const std::vector<std::optional<CameraPose>>& poses,
                  const std::function<cv::Mat(std::size_t frame)>& image_of, cv::Mat* mosaic = nullptr);

}  // namespace nadir::bench
