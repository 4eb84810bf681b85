#include "recorder/thumbnail.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr int kLongestSide = 320, kQuality = 70;

Bytes small_jpeg(const cv::Mat& picture) {
  if (picture.empty()) return {};
  cv::Mat small = picture;
  const int side = std::max(picture.cols, picture.rows);
  if (side > kLongestSide) {
    const double factor = static_cast<double>(kLongestSide) / side;
    cv::resize(picture, small, {}, factor, factor, cv::INTER_AREA);
  }
  return encode_image(small, ImageFormat::jpeg, kQuality);
}

}  // namespace

ThumbnailRecord thumbnail_record(const ThumbnailPictures& pictures) {
  return {pictures.index, pictures.frame, pictures.verdict, small_jpeg(pictures.seen), small_jpeg(pictures.map)};
}

}  // namespace nadir
