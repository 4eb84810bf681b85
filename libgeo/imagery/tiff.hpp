// TIFF files as tile sets use them (TIFF 6.0, BigTIFF): a reader for directories of files from outside, and a writer of
// directories. Pixels are not decoded here.
//
// A file consists of a header (byte order, place of the first directory) and a chain of directories. A directory is a
// table of tags, each with a type, a count and its values, or the place of them. The reader trusts nothing: every place
// and length is checked against the file's size before anything is allocated, and a chain with a loop is an error.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/input_file.hpp"

namespace nadir {

// Why a file cannot be used as a tile set. code is that of the finding that it becomes: "tiff.corrupt" (the file or its
// medium is damaged), "tiff.grid" (not on the Web Mercator grid), "tiff.layout" (a layout that is not supported).
class TiffError : public Error {
 public:
  TiffError(const char* code, ErrorText text) : Error(std::move(text)), code_(code) {}
  const char* code() const { return code_; }

 private:
  const char* code_;
};

// Random access to bytes of a file (positional reads; not mapped, because a file that is truncated in flight must be an
// error, not a signal) or of memory.
class RandomBytes {
 public:
  virtual ~RandomBytes() = default;
  virtual std::uint64_t size() const = 0;
  // Fills the target. False when the bytes are not all there. Throws TiffError when the medium fails.
  virtual bool read(std::uint64_t at, std::span<std::uint8_t> target) const = 0;
};

class FileBytes final : public RandomBytes {
 public:
  explicit FileBytes(InputFile file) : file_(std::move(file)) {}

  std::uint64_t size() const override { return file_.size(); }  // when it was opened
  bool read(std::uint64_t at, std::span<std::uint8_t> target) const override;

 private:
  InputFile file_;
};

class MemoryBytes final : public RandomBytes {
 public:
  explicit MemoryBytes(ByteView bytes) : bytes_(bytes) {}  // outlives this
  std::uint64_t size() const override { return bytes_.size(); }
  bool read(std::uint64_t at, std::span<std::uint8_t> target) const override;

 private:
  ByteView bytes_;
};

namespace tiff {

// The tags that a tile set consists of.
enum Tag : std::uint16_t {
  kSubfileType = 254,
  kWidth = 256,
  kHeight = 257,
  kBitsPerSample = 258,
  kCompression = 259,
  kPhotometric = 262,
  kSamplesPerPixel = 277,
  kPlanarConfig = 284,
  kPredictor = 317,
  kTileWidth = 322,
  kTileHeight = 323,
  kTileOffsets = 324,
  kTileSizes = 325,
  kExtraSamples = 338,
  kSampleFormat = 339,
  kJpegTables = 347,
  kChromaSubsampling = 530,
  kPixelScale = 33550,
  kTiepoint = 33922,
  kTransformation = 34264,
  kGeoKeys = 34735,
  kGeoTexts = 34737,
  kNodata = 42113,
};

enum Compression : std::uint16_t {
  kNone = 1,
  kLzw = 5,
  kJpeg = 7,
  kDeflate = 8,
  kPackBits = 32773,
  kOldDeflate = 32946,
  kZstd = 50000,
  kWebp = 50001,
};

enum Photometric : std::uint16_t { kWhiteIsZero = 0, kGrey = 1, kRgb = 2, kMask = 4, kYCbCr = 6 };

inline constexpr std::uint64_t kReducedImage = 1, kMaskImage = 4;  // bits of kSubfileType

}  // namespace tiff

class TiffFile {
 public:
  // bytes outlive this. Throws TiffError ("tiff.corrupt") when this is not a TIFF or its directories are malformed.
  TiffFile(const RandomBytes& bytes, std::string name);

  std::size_t directories() const { return directories_.size(); }
  const std::string& name() const { return name_; }

  // Values of a tag; empty when the directory has none. Throws TiffError for another type, more than `most` values, or
  // values outside of the file.
  std::vector<std::uint64_t> numbers(std::size_t directory, std::uint16_t tag, std::uint64_t most = 64) const;
  std::vector<double> reals(std::size_t directory, std::uint16_t tag, std::uint64_t most = 64) const;
  Bytes bytes(std::size_t directory, std::uint16_t tag, std::uint64_t most) const;
  // One number; `absent` when the directory has none.
  std::uint64_t number(std::size_t directory, std::uint16_t tag, std::uint64_t absent) const;
  bool has(std::size_t directory, std::uint16_t tag) const { return find(directory, tag) != nullptr; }

  [[noreturn]] void corrupt(std::string expected, std::string found) const;

 private:
  struct Field {
    std::uint16_t tag = 0, type = 0;
    std::uint64_t count = 0, at = 0;  // at: offset of the values
  };

  const Field* find(std::size_t directory, std::uint16_t tag) const;
  std::uint64_t integer(const std::uint8_t* from, int size) const;
  std::uint64_t integer_at(std::uint64_t at, int size) const;
  Bytes values_of(const Field& field, int size, std::uint64_t most) const;
  void read_chain();
  std::uint64_t read_directory(std::uint64_t at);  // returns the offset of the next one

  const RandomBytes& bytes_;
  std::string name_;
  bool big_endian_ = false, big_ = false;
  std::vector<std::vector<Field>> directories_;
};

// Builds one directory: little-endian, classic or BigTIFF.
class TiffTags {
 public:
  explicit TiffTags(bool big) : big_(big) {}

  void shorts(std::uint16_t tag, std::initializer_list<std::uint16_t> values);
  void longs(std::uint16_t tag, std::span<const std::uint32_t> values);
  void long_(std::uint16_t tag, std::uint32_t value) { longs(tag, {&value, 1}); }
  void places(std::uint16_t tag, std::span<const std::uint64_t> values);  // LONG, or LONG8 in a BigTIFF
  void doubles(std::uint16_t tag, std::initializer_list<double> values);
  void text(std::uint16_t tag, std::string_view value);
  void undefined(std::uint16_t tag, ByteView value);

  // Bytes of the directory and of the values behind it. Even.
  std::uint64_t size() const;
  // The bytes, for this offset in the file; next: offset of the following directory, 0 when there is none.
  Bytes write(std::uint64_t at, std::uint64_t next) const;

 private:
  struct Field {
    std::uint16_t type = 0;
    std::uint64_t count = 0;
    Bytes values;
  };
  std::uint64_t table_size() const;

  bool big_;
  std::map<std::uint16_t, Field> fields_;  // a directory is sorted by tag
};

// The header of a file whose first directory lies at this offset: 8 bytes, in a BigTIFF 16.
Bytes tiff_header(bool big, std::uint64_t first_directory);

}  // namespace nadir
