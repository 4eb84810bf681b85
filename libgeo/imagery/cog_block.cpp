// JPEG and WebP go to their own libraries. The rest (no compression, LZW, deflate, ZSTD, predictors) is libtiff's: it
// sees a small TIFF in memory of one block, which is written here, and never the file from outside.
#include "imagery/cog_block.hpp"

#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "imagery/cog_tags.hpp"
#include "imagery/cog_tiff.hpp"
#include "imagery/tiff_memory.hpp"

namespace nadir {
namespace {

Bytes tiff_of_one_block(const CogBlockForm& form, ByteView block) {
  TiffTags tags(false);
  const auto bits = static_cast<std::uint16_t>(form.bits);
  tags.long_(tiff::kWidth, static_cast<std::uint32_t>(form.width));
  tags.long_(tiff::kHeight, static_cast<std::uint32_t>(form.height));
  switch (form.samples) {
    case 1: tags.shorts(tiff::kBitsPerSample, {bits}); break;
    case 2: tags.shorts(tiff::kBitsPerSample, {bits, bits}); break;
    case 3: tags.shorts(tiff::kBitsPerSample, {bits, bits, bits}); break;
    default: tags.shorts(tiff::kBitsPerSample, {bits, bits, bits, bits}); break;
  }
  tags.shorts(tiff::kCompression, {form.compression});
  tags.shorts(tiff::kPhotometric, {form.samples >= 3 ? tiff::kRgb : tiff::kGrey});
  tags.shorts(tiff::kSamplesPerPixel, {static_cast<std::uint16_t>(form.samples)});
  tags.shorts(tiff::kPlanarConfig, {1});
  if (form.predictor != 1) tags.shorts(tiff::kPredictor, {form.predictor});
  tags.long_(tiff::kTileWidth, static_cast<std::uint32_t>(form.width));
  tags.long_(tiff::kTileHeight, static_cast<std::uint32_t>(form.height));
  if (form.samples % 2 == 0) tags.shorts(tiff::kExtraSamples, {2});
  tags.long_(tiff::kTileSizes, static_cast<std::uint32_t>(block.size()));
  tags.long_(tiff::kTileOffsets, 0);
  tags.long_(tiff::kTileOffsets, static_cast<std::uint32_t>(8 + tags.size()));
  Bytes file = tiff_header(false, 8);
  const Bytes directory = tags.write(8, 0);
  file.insert(file.end(), directory.begin(), directory.end());
  file.insert(file.end(), block.begin(), block.end());
  return file;
}

Bytes decode_by_libtiff(const CogBlockForm& form, ByteView block, std::string_view name) {
  const Bytes file = tiff_of_one_block(form, block);
  TiffMemory memory{file};
  const TiffHandle tiff = open_tiff(memory, "block", 0);
  const std::size_t row =
      (static_cast<std::size_t>(form.width) * static_cast<std::size_t>(form.samples * form.bits) + 7) / 8;
  Bytes pixels(row * static_cast<std::size_t>(form.height));
  const auto size = static_cast<tmsize_t>(pixels.size());
  if (!tiff || TIFFTileSize(tiff.get()) != size || TIFFReadEncodedTile(tiff.get(), 0, pixels.data(), size) != size) {
    throw Error({.what = "the block cannot be decoded",
                 .where = std::string(name),
                 .expected = fmt::format("{} x {} pixels", form.width, form.height),
                 .found = memory.complaint.empty() ? "damaged data" : memory.complaint});
  }
  return pixels;
}

DecodedImage picture_of(const CogBlockForm& form, Bytes& pixels) {
  if (form.bits == 1) {
    cv::Mat mask(form.height, form.width, CV_8UC1);
    const std::size_t row_bytes = (static_cast<std::size_t>(form.width) + 7) / 8;
    for (int row = 0; row < form.height; ++row) {
      const std::uint8_t* from = pixels.data() + static_cast<std::size_t>(row) * row_bytes;
      for (int column = 0; column < form.width; ++column) {
        mask.at<std::uint8_t>(row, column) = (from[column / 8] >> (7 - column % 8)) % 2 != 0 ? 255 : 0;
      }
    }
    return {mask, {}};
  }
  const cv::Mat raw(form.height, form.width, CV_8UC(form.samples), pixels.data());
  DecodedImage result;
  if (form.samples % 2 == 0) cv::extractChannel(raw, result.alpha, form.samples - 1);
  if (form.samples <= 2) {
    cv::extractChannel(raw, result.image, 0);
    if (form.photometric == tiff::kWhiteIsZero) cv::bitwise_not(result.image, result.image);
  } else {
    cv::cvtColor(raw, result.image, form.samples == 4 ? cv::COLOR_RGBA2BGR : cv::COLOR_RGB2BGR);
  }
  return result;
}

}  // namespace

Bytes whole_jpeg(const CogBlockForm& form, ByteView block) {
  const bool jpeg = block.size() >= 4 && block[0] == 0xff && block[1] == 0xd8;
  if (!jpeg) return {block.begin(), block.end()};
  Bytes result{0xff, 0xd8};
  // Without this mark decoders take three colours for YCbCr.
  constexpr std::array<std::uint8_t, 16> kAdobeRgb{0xff, 0xee, 0, 14, 'A', 'd', 'o', 'b', 'e', 0, 100, 0, 0, 0, 0, 0};
  if (form.samples == 3 && form.photometric == tiff::kRgb)
    result.insert(result.end(), kAdobeRgb.begin(), kAdobeRgb.end());
  // The tables are a JPEG of their own, without picture: begin, tables, end.
  const Bytes& tables = form.jpeg_tables;
  if (tables.size() > 4 && tables[0] == 0xff && tables[1] == 0xd8) {
    const bool ended = tables[tables.size() - 2] == 0xff && tables.back() == 0xd9;
    result.insert(result.end(), tables.begin() + 2, tables.end() - (ended ? 2 : 0));
  }
  if (result.size() == 2) return {block.begin(), block.end()};
  result.insert(result.end(), block.begin() + 2, block.end());
  return result;
}

DecodedImage decode_cog_block(const CogBlockForm& form, ByteView block, std::string_view name) {
  DecodedImage result;
  if (form.compression == tiff::kJpeg) {
    result = decode_image(whole_jpeg(form, block), form.samples == 1 ? Colour::grey : Colour::bgr, name);
  } else if (form.compression == tiff::kWebp) {
    result = decode_image(block, Colour::bgr, name);
  } else {
    Bytes pixels = decode_by_libtiff(form, block, name);
    return picture_of(form, pixels);
  }
  if (result.image.cols != form.width || result.image.rows != form.height) {
    throw Error({.what = "a block has the wrong size",
                 .where = std::string(name),
                 .expected = fmt::format("{} x {} pixels", form.width, form.height),
                 .found = fmt::format("{} x {}", result.image.cols, result.image.rows)});
  }
  return result;
}

}  // namespace nadir
