#include "candidates/tile_check.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "candidates/flight_maker.hpp"

namespace nadir {
namespace {

const TileKey kPlace = test::keys_in_a_row(1)[0];

cv::Mat grey_of(const cv::Mat& picture) {
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

std::string code_of(const cv::Mat& grey) {
  const auto refusal = judge_figures(picture_figures(grey), {});
  return refusal ? std::string(name_of(refusal->code)) : "";
}

// "" when it is read.
std::string read_code(ByteView bytes, const CandidateSidecar& sidecar) {
  const auto read = read_candidate_picture(bytes, sidecar);
  return std::holds_alternative<Refusal>(read) ? std::string(name_of(std::get<Refusal>(read).code)) : "";
}

TEST(TilePicture, FiguresTellGoodPicturesFromBadOnes) {
  const cv::Mat good = grey_of(test::FlightMaker().picture(kPlace));
  EXPECT_EQ(code_of(good), "");
  cv::Mat blurred;
  cv::GaussianBlur(good, blurred, {}, 12);
  cv::normalize(blurred, blurred, 40, 220, cv::NORM_MINMAX);
  EXPECT_EQ(code_of(blurred), "blurred");
  EXPECT_EQ(code_of(cv::Mat(256, 256, CV_8UC1, cv::Scalar(90))), "low_texture");
  EXPECT_EQ(code_of(cv::Mat(256, 256, CV_8UC1, cv::Scalar(255))), "low_texture");
  cv::Mat blown = good.clone();
  blown.rowRange(0, 100).setTo(255);
  EXPECT_EQ(code_of(blown), "low_texture");
}

TEST(TilePicture, OnlyTheNamedFormatAndSizeIsDecoded) {
  const Candidate good = test::FlightMaker().candidate(kPlace);
  EXPECT_EQ(read_code(good.tile, good.sidecar), "");
  CandidateSidecar webp = good.sidecar;
  webp.format = ImageFormat::webp;
  EXPECT_EQ(read_code(good.tile, webp), "format_unsupported");
  const cv::Mat picture = test::FlightMaker().picture(kPlace);
  EXPECT_EQ(read_code(encode_image(picture, ImageFormat::webp), webp), "");
  EXPECT_EQ(read_code(encode_image(picture, ImageFormat::png), good.sidecar), "format_unsupported");
  EXPECT_EQ(read_code(encode_image(picture.rowRange(0, 255).clone(), ImageFormat::jpeg), good.sidecar),
            "format_unsupported");
  for (const std::size_t length : {0UL, 1UL, 20UL, good.tile.size() / 2}) {
    EXPECT_EQ(read_code(ByteView(good.tile).first(length), good.sidecar), "format_unsupported") << length;
  }
}

TEST(TilePicture, APictureThatUnfoldsIsNotDecoded) {
  // A few kilobytes that would become 400 million pixels: the header alone is read.
  const Bytes large = encode_image(cv::Mat(4000, 4000, CV_8UC1, cv::Scalar(7)), ImageFormat::jpeg, 10);
  CandidateSidecar sidecar = test::FlightMaker().candidate(kPlace).sidecar;
  EXPECT_EQ(read_code(large, sidecar), "format_unsupported");
}

TEST(Agreement, MeasuresTheShiftOfTheSameGround) {
  test::FlightMaker one{{.noise = 1}}, other{{.off_px = 7.5, .noise = 2}};
  const Agreement agreement = compare_pictures(grey_of(one.picture(kPlace)), grey_of(other.picture(kPlace)));
  EXPECT_NEAR(agreement.shift_px, 7.5, 0.5);
  EXPECT_GT(agreement.correlation, 0.6);
  const Agreement back = compare_pictures(grey_of(other.picture(kPlace)), grey_of(one.picture(kPlace)));
  EXPECT_NEAR(back.shift_px, agreement.shift_px, 0.1);
}

TEST(Agreement, LightDoesNotMatterAndOtherGroundDoesNotAgree) {
  const cv::Mat one = grey_of(test::FlightMaker({.noise = 1}).picture(kPlace));
  cv::Mat darker;
  grey_of(test::FlightMaker({.noise = 2}).picture(kPlace)).convertTo(darker, CV_8U, 0.5, 10);
  const Agreement same = compare_pictures(one, darker);
  EXPECT_LT(same.shift_px, 0.3);
  EXPECT_GT(same.correlation, 0.6);
  const cv::Mat elsewhere = grey_of(test::FlightMaker({.ground = 9}).picture(kPlace));
  EXPECT_LT(compare_pictures(one, elsewhere).correlation, 0.35);
}

TEST(Agreement, PicturesWithoutStructureAgreeWithNothing) {
  const cv::Mat flat(256, 256, CV_8UC1, cv::Scalar(90));
  const cv::Mat good = grey_of(test::FlightMaker().picture(kPlace));
  EXPECT_LT(compare_pictures(flat, flat).correlation, 0.35);
  EXPECT_LT(compare_pictures(flat, good).correlation, 0.35);
  EXPECT_LT(compare_pictures(good, flat).correlation, 0.35);
}

}  // namespace
}  // namespace nadir
