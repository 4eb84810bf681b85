// Photos with EXIF and XMP, written by hand from the published formats.
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "base/bytes.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir::test {

struct SamplePhoto {
  std::string taken = "2026:06:23 16:31:59";  // empty: no time
  std::string subsec{}, zone{};               // "250", "+02:00"
  std::string gps_date{}, gps_time{};         // "2026:06:23", "14 31 59"
  std::string make = "DJI", model = "FC300S";
  double focal_mm = 3.61;  // 0: none
  int focal_35mm = 20;     // 0: none
  std::optional<LonLat> gps{};
  double gps_alt_m = 198.3;
  std::optional<double> image_direction_deg{};
  std::string xmp{};  // a packet; dji_xmp() makes one
};

std::string dji_xmp(double relative_m, double yaw_deg, double pitch_deg, double roll_deg = 0,
                    const std::string& more = "");

Bytes exif_of(const SamplePhoto& photo);  // the TIFF structure
// A JPEG of this picture with its metadata in front.
Bytes jpeg_with(const cv::Mat& picture, const SamplePhoto& photo);
void write_photo(const std::filesystem::path& path, const SamplePhoto& photo, int width = 64, int height = 48);

// A piece of ground as a camera sees it from above. heading_deg: of the image's up direction.
class SampleGround {
 public:
  explicit SampleGround(int side_px = 1600);
  cv::Mat picture(double east_px, double north_px, double heading_deg, cv::Size size = {320, 240}) const;

 private:
  cv::Mat ground_;
};

}  // namespace nadir::test
