#include "replay/pictures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "trust/base64.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr std::size_t kHeaderBytes = std::size_t{1} << 18;  // holds the header of all but odd pictures

ImageInfo read_info(const std::filesystem::path& path) {
  Bytes head(kHeaderBytes);
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(head.data()), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(std::max<std::streamsize>(file.gcount(), 0)));
  try {
    return read_image_info(head, path.string());
  } catch (const Error&) {
    if (head.size() < kHeaderBytes) throw;
    return read_image_info(read_file(path), path.string());
  }
}

}  // namespace

bool has_picture_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension == ".jpg" || extension == ".jpeg" || extension == ".png";
}

PictureSize read_picture_size(const std::filesystem::path& path) {
  const ImageInfo info = read_info(path);
  return {info.width, info.height};
}

cv::Mat read_picture(const std::filesystem::path& path, int shrink) {
  try {
    return read_image_file(path, Colour::grey, shrink);
  } catch (const Error&) {
    return {};
  }
}

cv::Mat read_flight_picture(const std::filesystem::path& path, const CameraModel& camera, int shrink) {
  try {
    return decode_camera_frame(read_file(path), camera, shrink);
  } catch (const Error&) {
    return {};
  }
}

std::string jpeg_data_uri(const cv::Mat& picture, int max_side, int quality) {
  cv::Mat small = picture;
  const int side = std::max(picture.cols, picture.rows);
  if (side > max_side) {
    const double factor = static_cast<double>(max_side) / side;
    cv::resize(picture, small, {}, factor, factor, cv::INTER_AREA);
  }
  return "data:image/jpeg;base64," + to_base64(encode_image(small, ImageFormat::jpeg, quality));
}

}  // namespace nadir
