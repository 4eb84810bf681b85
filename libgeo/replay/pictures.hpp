// Pictures of a flight as files, and pictures for the report as JPEG.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>

#include "vision/camera.hpp"

namespace nadir {

struct PictureSize {
  int width = 0;   // pixels
  int height = 0;  // pixels
};

bool has_picture_extension(const std::filesystem::path& path);  // .jpg .jpeg .png in any case

// Throws UsageError for a file whose header cannot be read.
PictureSize read_picture_size(const std::filesystem::path& path);

// CV_8UC1 of the file's size divided by `shrink` (1, 2, 4, 8); empty when the file is damaged: the localizer then calls
// the frame unfit.
cv::Mat read_picture(const std::filesystem::path& path, int shrink = 1);

// As the flight decodes its pictures (decode_camera_frame()): empty as well when it is not of the camera's size,
// which is that of the decoded picture.
cv::Mat read_flight_picture(const std::filesystem::path& path, const CameraModel& camera, int shrink);

// "data:image/jpeg;base64,…" of a CV_8UC1 or CV_8UC3 picture, shrunk so that no side exceeds `max_side` pixels.
std::string jpeg_data_uri(const cv::Mat& picture, int max_side, int quality);

}  // namespace nadir
