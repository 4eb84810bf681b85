// What codecs.cpp and the files of the single formats share. Not for others.
#pragma once

#include "imagery/codecs.hpp"

namespace nadir::codec {

// Throws Error that `name` is no sound picture.
[[noreturn]] void reject(std::string_view name, std::string_view format, std::string_view found);
void check_size(std::int64_t width, std::int64_t height, std::string_view name);

ImageInfo jpeg_info(ByteView bytes, std::string_view name);
DecodedImage decode_jpeg(ByteView bytes, Colour colour, std::string_view name, int shrink);
Bytes encode_jpeg(const cv::Mat& image, int quality);

ImageInfo png_info(ByteView bytes, std::string_view name);
DecodedImage decode_png(ByteView bytes, Colour colour, std::string_view name);
Bytes encode_png(const cv::Mat& image);

ImageInfo webp_info(ByteView bytes, std::string_view name);
DecodedImage decode_webp(ByteView bytes, Colour colour, std::string_view name);
Bytes encode_webp(const cv::Mat& image, int quality);

// Splits BGRA (or BGR) into the asked colour and alpha.
DecodedImage split_alpha(const cv::Mat& pixels, Colour colour);

}  // namespace nadir::codec
