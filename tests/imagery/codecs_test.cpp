#include "imagery/codecs.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgproc.hpp>
//
#include <jpeglib.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

// Smooth enough for JPEG's and WebP's chroma subsampling, with something different in each channel and direction.
cv::Mat picture(int columns = 160, int rows = 120) {
  cv::Mat image(rows, columns, CV_8UC3);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      image.at<cv::Vec3b>(row, column) = {static_cast<std::uint8_t>(40 + column), static_cast<std::uint8_t>(200 - row),
                                          static_cast<std::uint8_t>(60 + (row + column) / 2)};
    }
  }
  return image;
}

double mean_difference(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size() || a.type() != b.type()) return 1e9;
  return cv::norm(a, b, cv::NORM_L1) / static_cast<double>(a.total() * static_cast<std::size_t>(a.channels()));
}

class EveryFormat : public testing::TestWithParam<ImageFormat> {};
INSTANTIATE_TEST_SUITE_P(Codecs, EveryFormat, testing::Values(ImageFormat::jpeg, ImageFormat::png, ImageFormat::webp),
                         [](const auto& test) { return std::string(name_of(test.param)); });

TEST_P(EveryFormat, RoundTrips) {
  const Bytes bytes = encode_image(picture(), GetParam(), 95);
  EXPECT_EQ(sniff_image_format(bytes), GetParam());
  const ImageInfo info = read_image_info(bytes, "picture");
  EXPECT_EQ(info.width, 160);
  EXPECT_EQ(info.height, 120);
  const DecodedImage decoded = decode_image(bytes, Colour::bgr, "picture");
  EXPECT_TRUE(decoded.alpha.empty());
  EXPECT_LE(mean_difference(decoded.image, picture()), GetParam() == ImageFormat::png ? 0.0 : 1.6);
  cv::Mat grey;
  cv::cvtColor(picture(), grey, cv::COLOR_BGR2GRAY);
  EXPECT_LE(mean_difference(decode_image(bytes, Colour::grey, "picture").image, grey), 1.6);
}

TEST_P(EveryFormat, ReducesByAveraging) {
  const Bytes bytes = encode_image(picture(161, 117), GetParam(), 95);
  for (const int shrink : {2, 4, 8}) {
    const cv::Mat small = decode_image(bytes, Colour::bgr, "picture", shrink).image;
    ASSERT_EQ(small.size(), cv::Size((161 + shrink - 1) / shrink, (117 + shrink - 1) / shrink));
    cv::Mat expected;
    cv::resize(picture(161, 117), expected, small.size(), 0, 0, cv::INTER_AREA);
    const cv::Rect inner(0, 0, small.cols - 1, small.rows - 1);  // the last cell is cut off differently
    EXPECT_LE(mean_difference(small(inner).clone(), expected(inner).clone()), 2.5) << shrink;
  }
}

TEST_P(EveryFormat, EncodesDeterministically) {
  EXPECT_EQ(encode_image(picture(), GetParam()), encode_image(picture(), GetParam()));
}

TEST_P(EveryFormat, RejectsEveryTruncation) {
  const Bytes bytes = encode_image(picture(64, 48), GetParam(), 75);
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    // A WebP chunk is padded to an even size; its decoder does not miss the padding.
    if (GetParam() == ImageFormat::webp && length + 1 == bytes.size()) continue;
    const ByteView part(bytes.data(), length);
    EXPECT_THROW(decode_image(part, Colour::bgr, "cut"), Error) << length << " of " << bytes.size();
  }
}

TEST_P(EveryFormat, FlippedBitsNeverCrash) {
  const Bytes bytes = encode_image(picture(48, 32), GetParam(), 75);
  int refused = 0;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    Bytes damaged = bytes;
    damaged[at] ^= static_cast<std::uint8_t>(1U << (at % 8));
    try {
      const cv::Mat image = decode_image(damaged, Colour::bgr, "damaged").image;
      EXPECT_LE(image.total(), static_cast<std::size_t>(kMaxImagePixels));
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 0);
}

TEST(Codecs, SeparatesAlpha) {
  cv::Mat image(40, 40, CV_8UC4, cv::Scalar(10, 20, 30, 255));
  image(cv::Rect(0, 0, 20, 40)).setTo(cv::Scalar(10, 20, 30, 0));
  for (const ImageFormat format : {ImageFormat::png, ImageFormat::webp}) {
    const DecodedImage decoded = decode_image(encode_image(image, format, 95), Colour::bgr, "alpha");
    ASSERT_FALSE(decoded.alpha.empty());
    EXPECT_EQ(decoded.alpha.at<std::uint8_t>(20, 5), 0);
    EXPECT_EQ(decoded.alpha.at<std::uint8_t>(20, 35), 255);
    EXPECT_EQ(decoded.image.type(), CV_8UC3);
  }
  EXPECT_THROW(encode_image(image, ImageFormat::jpeg), Error);
}

TEST(Codecs, PreservesGrey) {
  const cv::Mat grey(30, 50, CV_8UC1, cv::Scalar(77));
  for (const ImageFormat format : {ImageFormat::jpeg, ImageFormat::png, ImageFormat::webp}) {
    const cv::Mat back = decode_image(encode_image(grey, format, 90), Colour::grey, "grey").image;
    EXPECT_LE(mean_difference(back, grey), 1.0);
  }
}

// The header claims a size that must not be allocated.
TEST(Codecs, RejectsHugeDeclaredSizes) {
  Bytes png = encode_image(picture(), ImageFormat::png);
  png[16] = 0x7f;  // IHDR's width
  EXPECT_THROW(read_image_info(png, "giant"), Error);
  Bytes jpeg = encode_image(picture(), ImageFormat::jpeg);
  const Bytes marker = {0xff, 0xc0};  // start of frame
  const auto sof = std::search(jpeg.begin(), jpeg.end(), marker.begin(), marker.end());
  ASSERT_NE(sof, jpeg.end());
  sof[5] = sof[7] = 0xea;
  sof[6] = sof[8] = 0x60;  // 60000 x 60000
  try {
    decode_image(jpeg, Colour::bgr, "giant.jpg");
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.text().where, "giant.jpg");
    EXPECT_THAT(error.text().found, testing::HasSubstr("60000 x 60000"));
  }
}

TEST(Codecs, RejectsOtherBytes) {
  EXPECT_FALSE(sniff_image_format({}));
  EXPECT_FALSE(sniff_image_format(as_bytes("GIF89a")));
  EXPECT_THROW(decode_image(as_bytes("GIF89a and more"), Colour::bgr, "a gif"), Error);
  EXPECT_THROW(decode_image({}, Colour::bgr, "nothing"), Error);
  EXPECT_THROW(decode_image(encode_image(picture(), ImageFormat::png), Colour::bgr, "p", 3), UsageError);
  EXPECT_THROW(encode_image(picture(), ImageFormat::jpeg, 0), UsageError);
  EXPECT_THROW(encode_image(cv::Mat(), ImageFormat::png), Error);
  EXPECT_THROW(encode_image(cv::Mat(4, 4, CV_16UC1), ImageFormat::png), Error);
}

TEST(Codecs, ReadsFiles) {
  const test::TemporaryFolder folder;
  const Bytes bytes = encode_image(picture(), ImageFormat::jpeg, 90);
  write_file_atomic(folder / "a.jpg", bytes);
  EXPECT_EQ(read_image_file(folder / "a.jpg", Colour::grey, 4).size(), cv::Size(40, 30));
  EXPECT_THROW(read_image_file(folder / "b.jpg", Colour::grey), Error);
}

TEST(Codecs, GdalReadsTheSamePixels) {
  if (test::run_shell("command -v gdal_translate").code != 0)
    GTEST_SKIP() << "NOT TESTED: gdal_translate is not installed";
  const test::TemporaryFolder folder;
  for (const ImageFormat format : {ImageFormat::jpeg, ImageFormat::png}) {
    const Bytes bytes = encode_image(picture(), format, 80);
    write_file_atomic(folder / "a.img", bytes);
    const auto result = test::run_process({"gdal_translate", "-q", "-of", "ENVI", "-co", "INTERLEAVE=BIP",
                                           (folder / "a.img").string(), (folder / "raw").string()});
    ASSERT_EQ(result.code, 0) << result.err;
    const Bytes raw = read_file(folder / "raw");
    cv::Mat rgb = cv::Mat(120, 160, CV_8UC3, const_cast<std::uint8_t*>(raw.data())).clone();
    ASSERT_EQ(raw.size(), rgb.total() * 3);
    cv::cvtColor(rgb, rgb, cv::COLOR_RGB2BGR);
    EXPECT_EQ(cv::norm(decode_image(bytes, Colour::bgr, "a").image, rgb, cv::NORM_INF), 0.0) << name_of(format);
  }
}

// A colour JPEG whose channels come in scans of their own, the last of them again and again.
Bytes jpeg_of_scans(int scans) {
  jpeg_compress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_compress(&info);
  unsigned char* data = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&info, &data, &size);
  info.image_width = info.image_height = 16;
  info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  const jpeg_scan_info script[] = {
      {1, {0, 0, 0, 0}, 0, 63, 0, 0}, {1, {1, 0, 0, 0}, 0, 63, 0, 0}, {1, {2, 0, 0, 0}, 0, 63, 0, 0}};
  info.scan_info = script;
  info.num_scans = 3;
  jpeg_start_compress(&info, TRUE);
  std::array<JSAMPLE, 48> row{};
  row.fill(90);
  JSAMPROW rows[] = {row.data()};
  while (info.next_scanline < info.image_height) jpeg_write_scanlines(&info, rows, 1);
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  Bytes bytes(data, data + size);
  std::free(data);
  const std::uint8_t start_of_scan[] = {0xff, 0xda};
  const auto last = std::find_end(bytes.begin(), bytes.end(), std::begin(start_of_scan), std::end(start_of_scan));
  const Bytes again(last, bytes.end() - 2);
  for (int scan = 3; scan < scans; ++scan) bytes.insert(bytes.end() - 2, again.begin(), again.end());
  return bytes;
}

TEST(Codecs, AJpegMayNotAskForScansWithoutEnd) {
  EXPECT_EQ(decode_image(jpeg_of_scans(3), Colour::bgr, "camera").image.cols, 16);
  EXPECT_EQ(decode_image(jpeg_of_scans(100), Colour::bgr, "camera").image.cols, 16);
  try {
    decode_image(jpeg_of_scans(150'000), Colour::bgr, "camera");
    ADD_FAILURE() << "decoded";
  } catch (const Error& error) {
    EXPECT_EQ(error.text().found, "too many scans");
  }
}

TEST(Codecs, ABudgetEndsAJpegThatTakesTooLong) {
  std::int64_t now_ms = 0;
  const DecodeBudget slow{.limit_ms = 50, .clock = [&now_ms] { return now_ms += 20; }};
  const Bytes bytes = encode_image(picture(), ImageFormat::jpeg);
  try {
    decode_image(bytes, Colour::grey, "camera", 1, slow);
    ADD_FAILURE() << "decoded";
  } catch (const Error& error) {
    EXPECT_EQ(error.text().found, "too much work for its size");
  }
  const DecodeBudget enough{.limit_ms = 50, .clock = [] { return std::int64_t{7}; }};
  EXPECT_FALSE(decode_image(bytes, Colour::grey, "camera", 1, enough).image.empty());
}

}  // namespace
}  // namespace nadir
