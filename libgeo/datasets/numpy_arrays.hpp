// NumPy's arrays: an .npy file (format 1.0 to 3.0, numpy.lib.format), and the arrays of an .npz file, which is a zip
// archive of them.
//
// Read are numbers of one kind in C order, little-endian, and text: |u1, <i4, <i8, <f4, <f8, <U…. An array of pickled
// objects is refused: reading one would run what it says. Bytes are not trusted: the header is at most 64 KiB, and what
// the shape asks for is compared with what is there before anything is allocated.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"

namespace nadir {

struct NumpyHeader {
  std::string type;                // as in the file: "<f4"
  std::vector<std::size_t> shape;  // empty: one value
  std::size_t begin = 0;           // of the values, in bytes from the file's beginning

  std::size_t value_size() const;  // bytes
  std::size_t count() const;       // values
};

// Throws Error naming `name`. file_size: of all of the file, of which `bytes` is a beginning that holds the header.
NumpyHeader parse_numpy_header(ByteView bytes, std::size_t file_size, std::string_view name);

class NumpyArray {
 public:
  NumpyArray(Bytes file, std::string name);

  const std::string& name() const { return name_; }
  const NumpyHeader& header() const { return header_; }
  ByteView values() const { return ByteView(file_).subspan(header_.begin); }
  // `count` finite numbers; throws Error naming the array where it holds others, or another number of them.
  std::vector<double> numbers(std::size_t count) const;
  std::string text() const;  // of one value of text, in UTF-8

 private:
  Bytes file_;
  std::string name_;
  NumpyHeader header_;
};

// One value of a matrix in an .npy file (the first plane of a stack), without reading the others. Nothing outside of
// it, or where it is not finite.
class NumpyRaster {
 public:
  explicit NumpyRaster(std::filesystem::path path);
  std::optional<double> at(std::ptrdiff_t row, std::ptrdiff_t column) const;

 private:
  std::filesystem::path path_;
  NumpyHeader header_;
};

// The arrays of an .npz file by name, read through GDAL's /vsizip/.
class NumpyArchive {
 public:
  explicit NumpyArchive(std::filesystem::path path);
  bool has(std::string_view array) const;
  NumpyArray array(std::string_view array) const;  // throws Error naming the file and the array

 private:
  std::string member(std::string_view array) const;

  std::filesystem::path path_;
};

}  // namespace nadir
