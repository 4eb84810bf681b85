#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/cog_tiles.hpp"
#include "imagery/tiff.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using test::kShape;
using test::tiles_of;
using test::write_cog;

constexpr std::uint64_t kAlwaysBig = 0;

std::unique_ptr<RandomBytes> in_memory(const Bytes& bytes) { return std::make_unique<MemoryBytes>(bytes); }

const char* code_of(const Bytes& bytes) {
  try {
    const CogReader reader(in_memory(bytes), "test");
    return "";
  } catch (const TiffError& error) {
    return error.code();
  }
}

class Cog : public ::testing::TestWithParam<std::tuple<ImageFormat, std::uint64_t>> {
 protected:
  ImageFormat format() const { return std::get<0>(GetParam()); }
  std::uint64_t limit() const { return std::get<1>(GetParam()); }
  test::TemporaryFolder folder_;
};

TEST_P(Cog, BlocksHoldTheBytesOfTheTiles) {
  const auto tiles = tiles_of(kShape, format());
  write_cog(folder_ / "set.tif", tiles, format(), limit());
  EXPECT_FALSE(fs::exists(folder_ / "set.tif.tiles"));
  const CogReader reader(folder_ / "set.tif");
  EXPECT_EQ(reader.zooms().min, 15);
  EXPECT_EQ(reader.zooms().max, 17);
  std::vector<TileKey> keys;
  for (const auto& [key, bytes] : tiles) {
    keys.push_back(key);
    EXPECT_EQ(reader.read(key), bytes) << to_text(key);
    EXPECT_EQ(reader.stored_size(key), bytes.size());
    EXPECT_FALSE(reader.read_mask(key));
  }
  EXPECT_EQ(reader.keys(), keys);
  EXPECT_FALSE(reader.read({17, 65536, 65534}));  // missing: (x + y) % 3 = 0
  EXPECT_FALSE(reader.read({17, 65535, 65535}));  // outside the image
  EXPECT_FALSE(reader.read({14, 8192, 8191}));    // above the coarsest zoom
  EXPECT_FALSE(reader.read({17, 1U << 20, 0}));
}

TEST_P(Cog, IsDeterministicForAnyOrderOfTiles) {
  const auto tiles = tiles_of(kShape, format());
  write_cog(folder_ / "a.tif", tiles, format(), limit());
  {
    CogWriter writer(folder_ / "b.tif", kShape, format(), limit());
    for (auto at = tiles.rbegin(); at != tiles.rend(); ++at) writer.add(at->first, at->second);
    writer.finish();
  }
  EXPECT_EQ(read_file(folder_ / "a.tif"), read_file(folder_ / "b.tif"));
}

// What GDAL's note at the beginning of the file promises.
TEST_P(Cog, TileLayoutMatchesTheGdalMetadata) {
  write_cog(folder_ / "set.tif", tiles_of(kShape, format()), format(), limit());
  const Bytes file = read_file(folder_ / "set.tif");
  const CogReader reader(folder_ / "set.tif");
  const std::string_view text = as_text(file);
  EXPECT_EQ(text.find("GDAL_STRUCTURAL_METADATA_SIZE=000140 bytes\nLAYOUT="), limit() == kAlwaysBig ? 16U : 8U);
  std::uint64_t last = 0;
  for (auto level = reader.levels().rbegin(); level != reader.levels().rend(); ++level) {
    for (std::size_t i = 0; i < level->picture.places.size(); ++i) {
      const std::uint64_t at = level->picture.places[i], size = level->picture.sizes[i];
      if (size == 0) {
        EXPECT_EQ(at, 0U);
        continue;
      }
      EXPECT_GT(at, last);
      last = at + size;
      EXPECT_EQ(file[at - 4] | file[at - 3] << 8 | file[at - 2] << 16, static_cast<int>(size));
      EXPECT_EQ(text.substr(last - 4, 4), text.substr(last, 4));
    }
  }
  EXPECT_EQ(last + 4, file.size());
}

INSTANTIATE_TEST_SUITE_P(Forms, Cog,
                         ::testing::Combine(::testing::Values(ImageFormat::jpeg, ImageFormat::webp),
                                            ::testing::Values(0xffff'0000, kAlwaysBig)));

TEST(CogWriting, RejectsTilesOutsideTheGrid) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(CogWriter(folder / "png.tif", kShape, ImageFormat::png), UsageError);
  EXPECT_THROW(CogWriter(folder / "wide.tif", {{2, 22}, 0, 0, 1, 1}, ImageFormat::jpeg), UsageError);
  CogWriter writer(folder / "set.tif", kShape, ImageFormat::jpeg);
  EXPECT_THROW(writer.add({15, 16386, 16383}, as_bytes("x")), Error);
  EXPECT_THROW(writer.add({14, 8192, 8191}, as_bytes("x")), Error);
  EXPECT_THROW(writer.add({18, 131072, 131064}, as_bytes("x")), Error);
  EXPECT_THROW(writer.add({15, 16384, 16383}, {}), Error);
  writer.add({15, 16384, 16383}, as_bytes("x"));
  writer.add({15, 16384, 16383}, as_bytes("y"));
  EXPECT_THROW(writer.finish(), Error);
  EXPECT_FALSE(fs::exists(folder / "set.tif"));
  folder.write("there.tif", "x");
  EXPECT_THROW(CogWriter(folder / "there.tif", kShape, ImageFormat::jpeg), Error);
}

TEST(CogReading, RejectsOtherFiles) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(CogReader(folder / "missing.tif"), Error);
  EXPECT_THROW(CogReader(folder.path()), Error);
  for (const std::string_view bytes :
       {"", "II", "II*\0\0\0\0\0", "II*\0\377\377\377\377", "MM\0*\0\0\0\b", "hello world"}) {
    EXPECT_STREQ(code_of({bytes.begin(), bytes.end()}), "tiff.corrupt");
  }
}

TEST(CogReading, ACycleOfDirectoriesEnds) {
  const test::TemporaryFolder folder;
  write_cog(folder / "set.tif", tiles_of(kShape, ImageFormat::jpeg), ImageFormat::jpeg);
  Bytes file = read_file(folder / "set.tif");
  const std::uint32_t first = file[4] + 256U * file[5];
  const std::uint32_t fields = file[first];
  // The first directory names itself as the next one.
  std::copy_n(file.begin() + 4, 4, file.begin() + first + 2 + 12 * fields);
  EXPECT_STREQ(code_of(file), "tiff.corrupt");
}

// Counts and places that no file of this size can hold, in each field of each directory in turn.
TEST(CogReading, HugeCountsAndOffsetsAllocateNothing) {
  const test::TemporaryFolder folder;
  write_cog(folder / "set.tif", tiles_of(kShape, ImageFormat::jpeg), ImageFormat::jpeg);
  const Bytes file = read_file(folder / "set.tif");
  const std::uint32_t first = file[4] + 256U * file[5];
  const std::uint32_t fields = file[first];
  for (std::uint32_t field = 0; field < fields; ++field) {
    for (const std::uint32_t part : {2U, 4U, 8U}) {  // type, count, value or place
      Bytes bad = file;
      const std::size_t at = first + 2 + 12 * field + part;
      std::fill_n(bad.begin() + static_cast<std::ptrdiff_t>(at), part == 2 ? 2 : 4, std::uint8_t{0xff});
      try {
        const CogReader reader(in_memory(bad), "test");
        for (const TileKey& key : reader.keys()) static_cast<void>(reader.read(key));
      } catch (const Error&) {
      }
    }
  }
}

// Blocks of 4096 pixels are 256 tiles each: a file of some megabytes could make a list of gigabytes.
TEST(CogReading, RejectsTooManyTiles) {
  const auto file_of = [](std::uint32_t blocks) {
    const std::uint32_t side = blocks * 4096;
    const double half_m = kPi * kMercatorRadius_m, pixel_m = half_m / (1 << 21);  // zoom 14 has 2²² pixels a side
    const std::vector<std::uint32_t> nothing(std::size_t{blocks} * blocks);
    TiffTags tags(false);
    tags.long_(tiff::kWidth, side);
    tags.long_(tiff::kHeight, side);
    tags.shorts(tiff::kBitsPerSample, {8});
    tags.shorts(tiff::kCompression, {tiff::kDeflate});
    tags.shorts(tiff::kPhotometric, {tiff::kGrey});
    tags.shorts(tiff::kTileWidth, {4096});
    tags.shorts(tiff::kTileHeight, {4096});
    tags.longs(tiff::kTileOffsets, nothing);
    tags.longs(tiff::kTileSizes, nothing);
    tags.doubles(tiff::kPixelScale, {pixel_m, pixel_m, 0});
    tags.doubles(tiff::kTiepoint, {0, 0, 0, -half_m, half_m, 0});
    tags.shorts(tiff::kGeoKeys, {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 3857});
    Bytes file = tiff_header(false, 8);
    const Bytes directory = tags.write(8, 0);
    file.insert(file.end(), directory.begin(), directory.end());
    return file;
  };
  EXPECT_STREQ(code_of(file_of(16)), "");
  EXPECT_STREQ(code_of(file_of(1024)), "tiff.layout");
}

TEST(CogReading, TruncationAndBitFlipsNeverCrash) {
  const test::TemporaryFolder folder;
  write_cog(folder / "set.tif", tiles_of(kShape, ImageFormat::webp), ImageFormat::webp);
  const Bytes whole = read_file(folder / "set.tif");
  int refused = 0;
  for (std::size_t at = 0; at < std::min<std::size_t>(whole.size(), 3000); at += 3) {
    Bytes bad = whole;
    bad[at] ^= static_cast<std::uint8_t>(1U << at % 8);
    if (at % 2 == 0) bad.resize(at);
    try {
      const CogReader reader(in_memory(bad), "test");
      for (const TileKey& key : reader.keys()) {
        static_cast<void>(reader.read(key));
        static_cast<void>(reader.read_mask(key));
      }
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 300);
}

TEST(CogReading, ABlockBeyondTheEndIsNamed) {
  const test::TemporaryFolder folder;
  const auto tiles = tiles_of(kShape, ImageFormat::jpeg);
  write_cog(folder / "set.tif", tiles, ImageFormat::jpeg);
  fs::resize_file(folder / "set.tif", fs::file_size(folder / "set.tif") - 100);
  const CogReader reader(folder / "set.tif");
  EXPECT_TRUE(reader.read({15, 16384, 16383}));
  try {
    static_cast<void>(reader.read({17, 65543, 65535}));
    ADD_FAILURE();
  } catch (const TiffError& error) {
    EXPECT_STREQ(error.code(), "tiff.corrupt");
    EXPECT_NE(error.text().where.find("block 7, 3"), std::string::npos) << error.text().where;
  }
}

TEST(CogReading, RestoresSharedJpegTables) {
  CogBlockLayout form;
  form.compression = tiff::kJpeg;
  form.photometric = tiff::kYCbCr;
  form.samples = 3;
  form.width = form.height = kTileSize;
  const Bytes whole = encode_image(test::picture_of({17, 1, 2}), ImageFormat::jpeg, 80);
  // Takes the tables out of a JPEG, as TIFF writers do.
  Bytes tables{0xff, 0xd8}, rest{0xff, 0xd8};
  std::size_t at = 2;
  while (whole[at + 1] != 0xda) {
    const std::size_t size = 2U + 256U * whole[at + 2] + whole[at + 3];
    Bytes& into = whole[at + 1] == 0xdb || whole[at + 1] == 0xc4 ? tables : rest;
    into.insert(into.end(), whole.begin() + static_cast<std::ptrdiff_t>(at),
                whole.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
  }
  rest.insert(rest.end(), whole.begin() + static_cast<std::ptrdiff_t>(at), whole.end());
  tables.insert(tables.end(), {0xff, 0xd9});
  EXPECT_THROW(decode_cog_block(form, rest, "without tables"), Error);
  form.jpeg_tables = tables;
  const cv::Mat expected = decode_image(whole, Colour::bgr, "whole").image;
  EXPECT_EQ(cv::norm(decode_cog_block(form, rest, "with tables").image, expected, cv::NORM_INF), 0);
  form.width = 512;
  EXPECT_THROW(decode_cog_block(form, rest, "another size"), Error);
}

TEST(LosslessWebp, PreservesEveryPixel) {
  const cv::Mat picture = test::picture_of({17, 1, 2});
  const Bytes bytes = encode_lossless_webp(picture);
  EXPECT_EQ(sniff_image_format(bytes), ImageFormat::webp);
  EXPECT_EQ(cv::norm(decode_image(bytes, Colour::bgr, "tile").image, picture, cv::NORM_INF), 0);
  EXPECT_EQ(encode_lossless_webp(picture), bytes);
  EXPECT_THROW(encode_lossless_webp(cv::Mat::zeros(8, 8, CV_8UC1)), Error);
}

// A GeoTIFF of nearly the whole world at zoom 13 with blocks of 4096 pixels: two megabytes of places and sizes, and 67
// million tiles that they are cut into. Every place leads to the same few bytes.
Bytes vast_cog() {
  constexpr std::uint32_t kBlock = 4096, kSide = (1U << 21) - kBlock;
  constexpr std::size_t kBlocks = std::size_t{kSide / kBlock} * (kSide / kBlock);
  const double pixel_m = mercator_pixel_m(13), half_m = pixel_m * (1U << 20);
  TiffTags tags(false);
  tags.long_(tiff::kWidth, kSide);
  tags.long_(tiff::kHeight, kSide);
  tags.shorts(tiff::kBitsPerSample, {8});
  tags.shorts(tiff::kCompression, {tiff::kDeflate});
  tags.shorts(tiff::kPhotometric, {tiff::kGrey});
  tags.shorts(tiff::kSamplesPerPixel, {1});
  tags.long_(tiff::kTileWidth, kBlock);
  tags.long_(tiff::kTileHeight, kBlock);
  const std::vector<std::uint32_t> ones(kBlocks, 8);
  tags.longs(tiff::kTileOffsets, ones);
  tags.longs(tiff::kTileSizes, ones);
  tags.doubles(tiff::kPixelScale, {pixel_m, pixel_m, 0});
  tags.doubles(tiff::kTiepoint, {0, 0, 0, -half_m, half_m, 0});
  tags.shorts(tiff::kGeoKeys, {1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 3857});
  Bytes file = tiff_header(false, 8);
  const Bytes directory = tags.write(8, 0);
  file.insert(file.end(), directory.begin(), directory.end());
  return file;
}

TEST(CogLimits, AManifestsCountBoundsTheTiles) {
  const Bytes vast = vast_cog();
  EXPECT_LT(vast.size(), 2'200'000U);
  const CogReader reader(in_memory(vast), "vast", CogLimits::for_tiles(1'000));
  try {
    reader.keys();
    ADD_FAILURE() << "a list of 67 million tiles";
  } catch (const TiffError& error) {
    EXPECT_STREQ(error.code(), "tiff.layout");
    EXPECT_EQ(error.text().expected, "at most 1000 tiles");
  }
  const CogReader foreign(in_memory(vast), "vast");
  EXPECT_THROW(foreign.keys(), TiffError) << "without a manifest 16 million are the most";
}

TEST(CogLimits, BlocksAreBoundedBeforeTheyAreAllocated) {
  CogLimits few;
  few.blocks = 200'000;
  try {
    const CogReader reader(in_memory(vast_cog()), "vast", few);
    ADD_FAILURE() << "261121 blocks accepted";
  } catch (const TiffError& error) {
    EXPECT_EQ(error.text().expected, "at most 200000 blocks in all images together");
  }
}

TEST(CogLimits, ASoundSetIsReadUnderItsOwnCount) {
  test::TemporaryFolder folder;
  const auto tiles = tiles_of(kShape, ImageFormat::jpeg);
  write_cog(folder / "set.tif", tiles, ImageFormat::jpeg);
  const CogReader reader(InputFile(folder / "set.tif"), CogLimits::for_tiles(tiles.size()));
  EXPECT_EQ(reader.keys().size(), tiles.size());
  const CogReader less(InputFile(folder / "set.tif"), CogLimits::for_tiles(tiles.size() - 1));
  EXPECT_THROW(less.keys(), TiffError);
}

}  // namespace
}  // namespace nadir
