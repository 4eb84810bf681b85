// The bones of a TIFF file (TIFF 6.0, BigTIFF): byte order, chain of directories, typed values. Nothing in it is
// believed: every place and length is held against the file's size before anything is allocated, and a chain that comes
// back to itself ends the reading.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "imagery/cog_bytes.hpp"
#include "imagery/cog_error.hpp"

namespace nadir {

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
  // bytes outlive this. Throws CogError ("tiff.corrupt") when this is no TIFF or its directories are not sound.
  TiffFile(const RandomBytes& bytes, std::string name);

  std::size_t directories() const { return directories_.size(); }
  const std::string& name() const { return name_; }

  // Values of a tag; empty when the directory has none. Throws CogError for another type, more than `most` values, or
  // values outside of the file.
  std::vector<std::uint64_t> numbers(std::size_t directory, std::uint16_t tag, std::uint64_t most = 64) const;
  std::vector<double> reals(std::size_t directory, std::uint16_t tag, std::uint64_t most = 64) const;
  Bytes bytes(std::size_t directory, std::uint16_t tag, std::uint64_t most) const;
  // One number, or what stands for it when it is absent.
  std::uint64_t number(std::size_t directory, std::uint16_t tag, std::uint64_t absent) const;
  bool has(std::size_t directory, std::uint16_t tag) const { return find(directory, tag) != nullptr; }

  [[noreturn]] void corrupt(std::string expected, std::string found) const;

 private:
  struct Field {
    std::uint16_t tag = 0, type = 0;
    std::uint64_t count = 0, at = 0;  // at: where the values begin
  };

  const Field* find(std::size_t directory, std::uint16_t tag) const;
  std::uint64_t whole(const std::uint8_t* from, int size) const;
  std::uint64_t whole_at(std::uint64_t at, int size) const;
  Bytes values_of(const Field& field, int size, std::uint64_t most) const;
  void read_chain();
  std::uint64_t read_directory(std::uint64_t at);  // returns the place of the next one

  const RandomBytes& bytes_;
  std::string name_;
  bool big_endian_ = false, big_ = false;
  std::vector<std::vector<Field>> directories_;
};

}  // namespace nadir
