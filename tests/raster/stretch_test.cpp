// 16 bit and float rasters become 8 bit ones by a stated stretch. Expected colours are counted by hand.
#include "raster/stretch.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "raster/raster_source.hpp"
#include "raster/value_raster.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using test::kValuePixels;
using test::ValueRaster;
using StretchKind = StretchRequest::Kind;

class Stretching : public testing::Test {
 protected:
  std::filesystem::path write(const ValueRaster& raster) {
    write_values(path_, raster);
    return path_;
  }
  // Of the file that was written.
  MaskedImage read(std::optional<Stretch> stretch) {
    return RasterSource(path_, stretch).read(test::kValueZoom, kValuePixels);
  }
  std::string refusal(const StretchRequest& request) {
    try {
      resolve_stretch(path_, request);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "not rejected";
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "values.tif";
};

TEST(StretchText, Reads) {
  EXPECT_EQ(parse_stretch("0,4000").kind, StretchKind::values);
  EXPECT_EQ(parse_stretch("-1.5,2e3").low, -1.5);
  EXPECT_EQ(parse_stretch("-1.5,2e3").high, 2000);
  EXPECT_EQ(parse_stretch("percentile:2,98").kind, StretchKind::percentile);
  EXPECT_EQ(parse_stretch("none").kind, StretchKind::none);
  EXPECT_EQ(to_text(Stretch{0, 0.1}), "0 to 0.1");
  for (const char* bad : {"", ",", "1", "1,", ",1", "2,1", "1,1", "nan,1", "0,inf", "0,1,2", "0;1",
                          "percentile:", "percentile:-1,50", "percentile:2,101", "percent:2,98", "0 ,1", "0x1,2"}) {
    EXPECT_THROW(parse_stretch(bad), UsageError) << bad;
  }
}

TEST_F(Stretching, IsLinearFromLowToHigh) {
  write({.value = [](int, int column, int) { return 1000 + 100 * column; }});
  const MaskedImage image = read(Stretch{1100, 2100});
  EXPECT_EQ(cv::countNonZero(image.mask), kValuePixels.area());
  // 255 * (v - 1100) / 1000: below and above are cut off.
  for (const auto& [column, colour] :
       {std::pair{0, 0}, {1, 0}, {2, 26}, {5, 102}, {6, 128}, {11, 255}, {12, 255}, {31, 255}}) {
    EXPECT_EQ(image.bgr.at<cv::Vec3b>(5, column), cv::Vec3b::all(static_cast<std::uint8_t>(colour))) << column;
  }
}

TEST_F(Stretching, IsTheSameForAllBandsTypesAndInterleavings) {
  for (const GDALDataType type : {GDT_UInt16, GDT_Int16, GDT_UInt32, GDT_Int32, GDT_Float32, GDT_Float64}) {
    for (const char* interleave : {"INTERLEAVE=BAND", "INTERLEAVE=PIXEL"}) {
      write({.type = type,
             .bands = 3,
             .value = [](int band, int column, int) { return 500 * band + column; },
             .options = {interleave}});
      // 255 * 500 / 2550 = 50 for each band; ten columns are one more.
      EXPECT_EQ(read(Stretch{0, 2550}).bgr.at<cv::Vec3b>(3, 0), cv::Vec3b(150, 100, 50)) << type << interleave;
      EXPECT_EQ(read(Stretch{0, 2550}).bgr.at<cv::Vec3b>(3, 20), cv::Vec3b(152, 102, 52)) << type << interleave;
    }
  }
}

TEST_F(Stretching, BandsFollowTheirColourInterpretation) {
  write({.bands = 4,
         .value = [](int band, int, int) { return 10 * band; },
         .colours = {GCI_BlueBand, GCI_GreenBand, GCI_RedBand, GCI_Undefined}});  // as PlanetScope has them
  EXPECT_EQ(read(Stretch{0, 255}).bgr.at<cv::Vec3b>(0, 0), cv::Vec3b(10, 20, 30));
}

TEST_F(Stretching, NodataIsTheFilesValueBeforeTheStretch) {
  const auto value = [](int, int column, int) { return column < 4 ? 7 : column; };
  write({.value = value, .nodata = {7}});
  const MaskedImage image = read(Stretch{0, 1});  // everything is white; nodata is not among it
  for (int column = 0; column < kValuePixels.width; ++column) {
    EXPECT_EQ(image.mask.at<std::uint8_t>(9, column), column < 4 || column == 7 ? 0 : 255) << column;
  }
}

TEST_F(Stretching, NodataOfEachBandIsItsOwn) {
  write({.type = GDT_Float32, .bands = 3, .value = [](int band, int column, int) {
           return column < 2 * band ? -1000.0 * band : 100.0;  // all of them in columns 0 and 1
         }});
  const std::filesystem::path vrt = folder_ / "values.vrt";
  {
    GDALDataset* source = GDALDataset::Open(path_.c_str());
    GDALDataset* copy =
        GetGDALDriverManager()->GetDriverByName("VRT")->CreateCopy(vrt.c_str(), source, 0, nullptr, nullptr, nullptr);
    for (int band = 1; band <= 3; ++band) copy->GetRasterBand(band)->SetNoDataValue(-1000.0 * band);
    GDALClose(copy);
    GDALClose(source);
  }
  path_ = vrt;
  const MaskedImage image = read(Stretch{0, 200});
  for (int column = 0; column < kValuePixels.width; ++column) {
    EXPECT_EQ(image.mask.at<std::uint8_t>(3, column), column < 2 ? 0 : 255) << column;
  }
  EXPECT_EQ(image.bgr.at<cv::Vec3b>(3, 8), cv::Vec3b::all(128));
}

TEST_F(Stretching, NonFiniteValuesAreInvalid) {
  write({.type = GDT_Float32, .bands = 3, .value = [](int band, int column, int) {
           if (band == 2 && column == 3) return std::numeric_limits<double>::quiet_NaN();
           if (band == 1 && column == 4) return std::numeric_limits<double>::infinity();
           return 0.5;
         }});
  const MaskedImage image = read(Stretch{0, 1});
  for (int column = 0; column < kValuePixels.width; ++column) {
    EXPECT_EQ(image.mask.at<std::uint8_t>(9, column), column == 3 || column == 4 ? 0 : 255) << column;
    EXPECT_EQ(image.bgr.at<cv::Vec3b>(9, 10), cv::Vec3b::all(128));
  }
}

TEST_F(Stretching, AlphaAndMaskBands) {
  const auto expect_columns_without_ground = [&](int from, int to) {
    const MaskedImage image = read(Stretch{0, 510});
    for (int column = 0; column < kValuePixels.width; ++column) {
      EXPECT_EQ(image.mask.at<std::uint8_t>(0, column), column >= from && column < to ? 0 : 255) << column;
    }
    EXPECT_EQ(image.bgr.at<cv::Vec3b>(0, 20), cv::Vec3b::all(50));
  };
  for (const int bands : {2, 4, 5}) {  // grey, red to blue, and near infrared besides
    std::vector<GDALColorInterp> colours{GCI_RedBand, GCI_GreenBand, GCI_BlueBand, GCI_Undefined};
    if (bands == 2) colours = {GCI_GrayIndex};
    colours.resize(static_cast<std::size_t>(bands), GCI_Undefined);
    colours.back() = GCI_AlphaBand;
    write({.bands = bands,
           .value = [=](int band, int column, int) { return band < bands ? 100
                                                            : column < 5 ? 32767
                                                                         : 32768; },
           .colours = colours});
    expect_columns_without_ground(0, 5);
  }
  write({.bands = 3,
         .value = [](int, int, int) { return 100; },
         .masked_out = [](int column, int) { return column >= 8 && column < 12; }});
  expect_columns_without_ground(8, 12);
  write({.type = GDT_Float32,
         .bands = 2,
         .value = [](int, int, int) { return 1; },
         .colours = {GCI_GrayIndex, GCI_AlphaBand}});
  EXPECT_THROW(read(Stretch{0, 1}), UsageError);
}

TEST_F(Stretching, PercentilesAreOfValidPixelsOfAllBands) {
  // 768 pixels: 1 to 768.
  write({.value = [](int, int column, int row) { return 1 + row * kValuePixels.width + column; }});
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::percentile, 0, 100}), (Stretch{1, 768}));
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::percentile, 50, 100}), (Stretch{384.5, 768}));
  const auto tenths = resolve_stretch(path_, {StretchKind::percentile, 10, 90});
  EXPECT_NEAR(tenths->low, 77.7, 1e-9);  // a tenth of the way from the 1st to the 768th
  EXPECT_NEAR(tenths->high, 691.3, 1e-9);
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::values, 5, 6}), (Stretch{5, 6}));
  write({.bands = 3,
         .value = [](int band, int column, int) { return column < 16 ? 0 : 100 * band; },
         .nodata = {0, 0, 0}});
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::percentile, 0, 100}), (Stretch{100, 300}));
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::percentile, 50, 100}), (Stretch{200, 300}));
}

TEST_F(Stretching, ALargeRasterIsSampledEvenly) {
  // 16 x 16 windows of 64 pixels, in the middles of a grid: 2048 pixels are 128 a window.
  write({.type = GDT_UInt16,
         .value = [](int, int column, int row) { return 1000 + column / 128 + 16 * (row / 128); },
         .size = {2048, 2048}});
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::percentile, 0, 100}), (Stretch{1000, 1255}));
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::percentile, 50, 100}), (Stretch{1127.5, 1255}));
}

TEST_F(Stretching, WithoutAStretchTheErrorNamesTheRange) {
  write({.value = [](int, int column, int) { return 112 + column; }, .nodata = {112}});
  const std::string text = refusal({});
  for (const char* part : {"not 8 bit", "values.tif", "UInt16", "113 to 143", "--stretch 113,143"}) {
    EXPECT_THAT(text, testing::HasSubstr(part));
  }
  EXPECT_THROW(read({}), UsageError);
  write({.value = [](int, int, int) { return 5; }});
  EXPECT_THAT(refusal({StretchKind::percentile, 2, 98}), testing::HasSubstr("5 at both"));
  write({.value = [](int, int, int) { return 5; }, .nodata = {5}});
  EXPECT_THAT(refusal({StretchKind::percentile, 2, 98}), testing::HasSubstr("no valid pixel"));
  write({.type = GDT_CFloat32, .value = [](int, int, int) { return 5; }});
  EXPECT_THAT(refusal({StretchKind::values, 0, 9}), testing::HasSubstr("complex"));
}

TEST_F(Stretching, EightBitAndPalettesKeepTheirColours) {
  write({.type = GDT_Byte, .value = [](int, int column, int) { return column; }});
  EXPECT_EQ(resolve_stretch(path_, {StretchKind::values, 0, 10}), std::nullopt);
  EXPECT_EQ(read(Stretch{0, 10}).bgr.at<cv::Vec3b>(0, 20), cv::Vec3b::all(20));
  for (const GDALDataType type : {GDT_Byte, GDT_UInt16}) {
    write({.type = type,
           .value = [](int, int column, int) { return column % 3; },
           .palette = {{10, 20, 30, 255}, {40, 50, 60, 255}, {70, 80, 90, 255}},
           .options = {"PHOTOMETRIC=PALETTE"}});
    EXPECT_EQ(resolve_stretch(path_, {}), std::nullopt) << type;
    EXPECT_EQ(read({}).bgr.at<cv::Vec3b>(0, 0), cv::Vec3b(30, 20, 10)) << type;
    EXPECT_EQ(read({}).bgr.at<cv::Vec3b>(0, 5), cv::Vec3b(90, 80, 70)) << type;
  }
}

TEST_F(Stretching, SouthUp) {
  const auto value = [](int, int column, int row) { return 10 * row + column; };
  write({.value = value});
  const MaskedImage north_up = read(Stretch{0, 255});
  write({.value = value, .south_up = true});
  EXPECT_EQ(cv::norm(north_up.bgr, read(Stretch{0, 255}).bgr, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace nadir
