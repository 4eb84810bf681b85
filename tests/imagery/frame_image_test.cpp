// Frames of cameras: TIFF beside what tiles may be, and HEIC named when it is refused.
#include "imagery/frame_image.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"
#include "support/tiff_writer.hpp"

namespace nadir {
namespace {

cv::Mat gradient() {
  cv::Mat image(120, 150, CV_8UC3);
  for (int row = 0; row < image.rows; ++row) {
    for (int column = 0; column < image.cols; ++column) {
      image.at<cv::Vec3b>(row, column) = {static_cast<std::uint8_t>(column), static_cast<std::uint8_t>(2 * row),
                                          static_cast<std::uint8_t>((row + column) / 2)};
    }
  }
  return image;
}

class FrameImage : public ::testing::Test {
 protected:
  Bytes tiff(const cv::Mat& image, int compression = COMPRESSION_LZW, bool tiled = false) {
    test::write_tiff(folder_ / "frame.tif", image, compression, tiled);
    return read_file(folder_ / "frame.tif");
  }
  test::TemporaryFolder folder_;
};

TEST_F(FrameImage, TiffHasThePixelsThatWereWritten) {
  const cv::Mat image = gradient();
  for (const int compression : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_PACKBITS}) {
    for (const bool tiled : {false, true}) {
      const Bytes bytes = tiff(image, compression, tiled);
      const FrameSize size = read_frame_size(bytes, "frame.tif");
      EXPECT_EQ(size.width, 150);
      EXPECT_EQ(size.height, 120);
      EXPECT_EQ(read_frame_size(folder_ / "frame.tif").width, 150);
      const cv::Mat decoded = decode_frame(bytes, Colour::bgr, "frame.tif");
      EXPECT_EQ(cv::norm(decoded, image, cv::NORM_INF), 0) << compression << tiled;
    }
  }
}

TEST_F(FrameImage, GreyAndSixteenBitTiff) {
  cv::Mat grey;
  cv::cvtColor(gradient(), grey, cv::COLOR_BGR2GRAY);
  EXPECT_EQ(cv::norm(decode_frame(tiff(grey), Colour::grey, "t"), grey, cv::NORM_INF), 0);
  cv::Mat deep;
  grey.convertTo(deep, CV_16U, 257);
  EXPECT_LE(cv::norm(decode_frame(tiff(deep), Colour::grey, "t"), grey, cv::NORM_INF), 1);
}

TEST_F(FrameImage, ReducesAsOtherFormatsDo) {
  const cv::Mat half = decode_frame(tiff(gradient()), Colour::grey, "t", 4);
  EXPECT_EQ(half.size(), cv::Size(38, 30));
  EXPECT_THROW(decode_frame(tiff(gradient()), Colour::grey, "t", 3), UsageError);
}

TEST_F(FrameImage, TruncatedTiffIsNoImage) {
  const Bytes whole = tiff(gradient());
  EXPECT_TRUE(is_complete_tiff(whole));
  for (std::size_t size = 0; size < whole.size(); size += 100) {
    const ByteView part = ByteView(whole).first(size);
    EXPECT_FALSE(is_complete_tiff(part)) << size;
    EXPECT_THROW(decode_frame(part, Colour::grey, "frame.tif"), Error) << size;
  }
}

TEST_F(FrameImage, OtherKindsOfTiffAreRefused) {
  Bytes bytes = tiff(cv::Mat(20, 20, CV_16UC1, cv::Scalar(7)), COMPRESSION_NONE);
  // BitsPerSample 16 becomes 32: tag 258, type 3, count 1.
  const std::string tag{"\x02\x01\x03\x00\x01\x00\x00\x00\x10", 9};
  const auto at = as_text(bytes).find(tag);
  ASSERT_NE(at, std::string_view::npos);
  bytes[at + 8] = 32;
  try {
    decode_frame(bytes, Colour::grey, "frame.tif");
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("32 bits per sample"));
  }
}

TEST_F(FrameImage, HeicIsNamed) {
  const std::string heic(
      "\0\0\0\x18"
      "ftypheic\0\0\0\0mif1heic",
      24);
  EXPECT_TRUE(is_heic(as_bytes(heic)));
  for (const auto& attempt : std::initializer_list<std::function<void()>>{
           [&] { read_frame_size(as_bytes(heic), "a.heic"); },
           [&] { decode_frame(as_bytes(heic), Colour::grey, "a.heic"); },
           [&] { read_frame_size(folder_.write("a.jpg", heic)); },
       }) {
    try {
      attempt();
      FAIL();
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr("HEIC is not supported: convert to JPEG"));
    }
  }
  EXPECT_TRUE(has_heic_extension("IMG_1.HEIC"));
  EXPECT_FALSE(has_heic_extension("IMG_1.jpg"));
  EXPECT_TRUE(has_frame_extension("a.TIFF"));
  EXPECT_FALSE(has_frame_extension("a.webp.txt"));
}

TEST_F(FrameImage, OtherFormatsAreReadAsBefore) {
  const Bytes jpeg = encode_image(gradient(), ImageFormat::jpeg);
  EXPECT_EQ(read_frame_size(jpeg, "a").width, 150);
  EXPECT_EQ(
      cv::norm(decode_frame(jpeg, Colour::bgr, "a", 2), decode_image(jpeg, Colour::bgr, "a", 2).image, cv::NORM_INF),
      0);
}

}  // namespace
}  // namespace nadir
