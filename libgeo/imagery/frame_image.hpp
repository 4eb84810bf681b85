// Pictures of cameras: which files may be frames of a flight, and their pixels.
//
// Wider than what tiles of a map may be (codecs.hpp): cameras for surveys write TIFF as well. Of a TIFF the first image
// counts: 8 or 16 bits per sample (of 16 the upper eight), grey, palette or colour, in strips or tiles, uncompressed or
// in any lossless compression of libtiff. HEIC is not read; messages say so by name, because phones and some drones
// write nothing else.
//
// Bytes are not trusted: sizes are checked before anything is allocated, and a truncated or damaged file is an Error.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string_view>

#include "base/bytes.hpp"
#include "imagery/codecs.hpp"

namespace nadir {

bool has_frame_extension(const std::filesystem::path& path);  // .jpg .jpeg .png .tif .tiff in any case
bool has_heic_extension(const std::filesystem::path& path);   // .heic .heif .hif in any case
bool is_tiff(ByteView bytes);                                 // by the first bytes
bool is_heic(ByteView bytes);                                 // likewise
bool is_complete_tiff(ByteView bytes);                        // its first image lies wholly inside

// For a frame that is HEIC. where: the file.
[[noreturn]] void reject_heic(std::string_view where);

struct FrameSize {
  int width = 0;   // pixels
  int height = 0;  // pixels
};

// From the header. These throw Error naming `name` for anything but an image: JPEG, PNG, WebP or TIFF.
FrameSize read_frame_size(ByteView bytes, std::string_view name);
FrameSize read_frame_size(const std::filesystem::path& path);

// shrink: as of decode_image(). CV_8UC1 or CV_8UC3 (BGR).
cv::Mat decode_frame(ByteView bytes, Colour colour, std::string_view name, int shrink = 1,
                     const DecodeBudget& budget = {});
cv::Mat read_frame_file(const std::filesystem::path& path, Colour colour, int shrink = 1);

}  // namespace nadir
