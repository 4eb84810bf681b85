// libjpeg reports errors by calling a function that must not return. It longjmps here, so the functions that call
// libjpeg hold nothing that needs a destructor: they work on plain structs that the callers own.
#include <cstddef>
#include <cstdio>
//
#include <jerror.h>
#include <jpeglib.h>

#include <array>
#include <csetjmp>
#include <cstdlib>
#include <memory>

#include "base/error.hpp"
#include "imagery/codec_parts.hpp"

namespace nadir::codec {
namespace {

struct ErrorManager {
  jpeg_error_mgr base{};
  std::jmp_buf back{};
  std::array<char, JMSG_LENGTH_MAX> message{};
};

ErrorManager& manager_of(j_common_ptr info) { return *reinterpret_cast<ErrorManager*>(info->err); }

[[noreturn]] void on_error(j_common_ptr info) {
  ErrorManager& manager = manager_of(info);
  manager.base.format_message(info, manager.message.data());
  std::longjmp(manager.back, 1);
}

// Warnings mean that libjpeg made up pixels (truncated or damaged data), but for a few that are harmless.
void on_message(j_common_ptr info, int level) {
  if (level >= 0) return;
  const int code = info->err->msg_code;
  if (code == JWRN_EXTRANEOUS_DATA || code == JWRN_ADOBE_XFORM || code == JWRN_JFIF_MAJOR) return;
  on_error(info);
}

void set_up(ErrorManager& manager) {
  jpeg_std_error(&manager.base);
  manager.base.error_exit = on_error;
  manager.base.emit_message = on_message;
}

struct Decoder {
  jpeg_decompress_struct info{};
  ErrorManager errors;

  Decoder() { info.err = (set_up(errors), &errors.base); }
  ~Decoder() { jpeg_destroy_decompress(&info); }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;
};

bool read_header(Decoder& decoder, ByteView bytes) {
  if (setjmp(decoder.errors.back) != 0) return false;
  jpeg_create_decompress(&decoder.info);
  jpeg_mem_src(&decoder.info, bytes.data(), bytes.size());
  return jpeg_read_header(&decoder.info, TRUE) == JPEG_HEADER_OK;
}

bool start(Decoder& decoder, J_COLOR_SPACE space, unsigned shrink) {
  if (setjmp(decoder.errors.back) != 0) return false;
  decoder.info.out_color_space = space;
  decoder.info.scale_num = 1;
  decoder.info.scale_denom = shrink;
  return jpeg_start_decompress(&decoder.info) == TRUE;
}

bool read_rows(Decoder& decoder, JSAMPLE* pixels, std::size_t row_bytes) {
  if (setjmp(decoder.errors.back) != 0) return false;
  while (decoder.info.output_scanline < decoder.info.output_height) {
    std::array<JSAMPROW, 8> rows{};
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const std::size_t row = std::min<std::size_t>(decoder.info.output_scanline + i, decoder.info.output_height - 1);
      rows[i] = pixels + row * row_bytes;
    }
    const JDIMENSION left = decoder.info.output_height - decoder.info.output_scanline;
    jpeg_read_scanlines(&decoder.info, rows.data(), std::min<JDIMENSION>(left, rows.size()));
  }
  return jpeg_finish_decompress(&decoder.info) == TRUE;
}

void open(Decoder& decoder, ByteView bytes, std::string_view name) {
  if (!read_header(decoder, bytes)) reject(name, "JPEG", decoder.errors.message.data());
  check_size(decoder.info.image_width, decoder.info.image_height, name);
  if (decoder.info.jpeg_color_space == JCS_CMYK || decoder.info.jpeg_color_space == JCS_YCCK) {
    reject(name, "grey or colour JPEG", "CMYK");
  }
}

struct Encoder {
  jpeg_compress_struct info{};
  ErrorManager errors;
  unsigned char* data = nullptr;  // libjpeg allocates it with malloc
  unsigned long size = 0;

  Encoder() { info.err = (set_up(errors), &errors.base); }
  ~Encoder() {
    jpeg_destroy_compress(&info);
    std::free(data);
  }
  Encoder(const Encoder&) = delete;
  Encoder& operator=(const Encoder&) = delete;
};

bool encode(Encoder& encoder, const cv::Mat& image, int quality) {
  if (setjmp(encoder.errors.back) != 0) return false;
  jpeg_compress_struct& info = encoder.info;
  jpeg_create_compress(&info);
  jpeg_mem_dest(&info, &encoder.data, &encoder.size);
  info.image_width = static_cast<JDIMENSION>(image.cols);
  info.image_height = static_cast<JDIMENSION>(image.rows);
  info.input_components = image.channels();
  info.in_color_space = image.channels() == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
  jpeg_set_defaults(&info);  // for colour: YCbCr 4:2:0
  jpeg_set_quality(&info, quality, TRUE);
  info.optimize_coding = TRUE;  // own Huffman tables: map tiles get 10 % smaller for 10 % more time
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    // libjpeg's interface is older than const; it does not write through this pointer.
    auto* row = const_cast<JSAMPLE*>(image.ptr<JSAMPLE>(static_cast<int>(info.next_scanline)));
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  return true;
}

}  // namespace

ImageInfo jpeg_info(ByteView bytes, std::string_view name) {
  Decoder decoder;
  open(decoder, bytes, name);
  return {ImageFormat::jpeg, static_cast<int>(decoder.info.image_width), static_cast<int>(decoder.info.image_height),
          decoder.info.num_components > 1, false};
}

DecodedImage decode_jpeg(ByteView bytes, Colour colour, std::string_view name, int shrink) {
  Decoder decoder;
  open(decoder, bytes, name);
  const bool grey = colour == Colour::grey;
  if (!start(decoder, grey ? JCS_GRAYSCALE : JCS_EXT_BGR, static_cast<unsigned>(shrink))) {
    reject(name, "JPEG", decoder.errors.message.data());
  }
  cv::Mat image(static_cast<int>(decoder.info.output_height), static_cast<int>(decoder.info.output_width),
                grey ? CV_8UC1 : CV_8UC3);
  if (!read_rows(decoder, image.data, image.step)) reject(name, "JPEG", decoder.errors.message.data());
  return {image, {}};
}

Bytes encode_jpeg(const cv::Mat& image, int quality) {
  Encoder encoder;
  if (!encode(encoder, image, quality)) {
    throw Error({.what = "the JPEG encoder failed", .found = encoder.errors.message.data()});
  }
  return {encoder.data, encoder.data + encoder.size};
}

}  // namespace nadir::codec
