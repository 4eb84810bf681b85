// One block of a tiled TIFF: from its bytes to a picture.
#pragma once

#include <cstdint>
#include <string_view>

#include "base/bytes.hpp"
#include "imagery/codecs.hpp"

namespace nadir {

// What a directory says about all of its blocks.
struct CogBlockForm {
  std::uint16_t compression = 1;
  std::uint16_t photometric = 1;
  std::uint16_t predictor = 1;
  int samples = 1;  // 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha
  int bits = 8;     // 8, or 1 in masks
  int width = 0, height = 0;
  Bytes jpeg_tables;
};

// A block of JPEG with the tables that the blocks share, as one complete JPEG; bytes that are complete stay as they
// are.
Bytes whole_jpeg(const CogBlockForm& form, ByteView block);

// Throws Error naming `name` for bytes that do not decode to the block's size.
DecodedImage decode_cog_block(const CogBlockForm& form, ByteView block, std::string_view name);

}  // namespace nadir
