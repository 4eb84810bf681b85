// TIFF frames as cameras write them, made with libtiff.
#pragma once

#include <tiffio.h>

#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>

namespace nadir::test {

// image: CV_8UC1, CV_16UC1 or CV_8UC3 (BGR). In strips of 16 rows, or in tiles of 64 x 64 pixels.
inline void write_tiff(const std::filesystem::path& path, const cv::Mat& image, int compression = COMPRESSION_LZW,
                       bool tiled = false) {
  constexpr int kTile = 64;
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  const int channels = image.channels();
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, image.cols);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, image.rows);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, image.depth() == CV_16U ? 16 : 8);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, channels);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, channels == 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, compression);
  cv::Mat rgb = image.clone();
  if (channels == 3) {
    for (auto& pixel : cv::Mat_<cv::Vec3b>(rgb)) std::swap(pixel[0], pixel[2]);
  }
  if (tiled) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kTile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, kTile);
    for (int y = 0; y < image.rows; y += kTile) {
      for (int x = 0; x < image.cols; x += kTile) {
        cv::Mat tile = cv::Mat::zeros(kTile, kTile, image.type());
        const cv::Rect part = cv::Rect(x, y, kTile, kTile) & cv::Rect(0, 0, image.cols, image.rows);
        rgb(part).copyTo(tile(cv::Rect(0, 0, part.width, part.height)));
        TIFFWriteTile(tiff, tile.data, static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), 0, 0);
      }
    }
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 16);
    for (int y = 0; y < image.rows; ++y) TIFFWriteScanline(tiff, rgb.ptr(y), static_cast<std::uint32_t>(y), 0);
  }
  TIFFClose(tiff);
}

}  // namespace nadir::test
