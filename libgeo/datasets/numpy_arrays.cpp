#include "datasets/numpy_arrays.hpp"

#include <cpl_vsi.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <memory>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/number_text.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::size_t kMaxHeader = std::size_t{64} << 10;
constexpr std::size_t kMaxArray = std::size_t{1} << 30;  // bytes
constexpr std::size_t kMaxDimensions = 4;
constexpr std::size_t kMaxText = 4096;  // characters

[[noreturn]] void refuse(std::string_view name, std::string expected, std::string found) {
  throw Error({.what = "not a NumPy array that can be read",
               .where = std::string(name),
               .expected = std::move(expected),
               .found = std::move(found)});
}

// What stands behind 'key': in the header, a Python literal.
std::string_view literal(std::string_view header, std::string_view key, std::string_view name) {
  const std::string quoted = fmt::format("'{}':", key);
  const std::size_t at = header.find(quoted);
  if (at == std::string_view::npos) {
    refuse(name, fmt::format("a header with '{}'", key), std::string(header.substr(0, 80)));
  }
  std::string_view rest = header.substr(at + quoted.size());
  while (!rest.empty() && rest.front() == ' ') rest.remove_prefix(1);
  return rest;
}

std::vector<std::size_t> shape_of(std::string_view text, std::string_view name) {
  const std::size_t end = text.find(')');
  if (text.empty() || text.front() != '(' || end == std::string_view::npos) {
    refuse(name, "a shape such as (3, 3)", std::string(text.substr(0, 40)));
  }
  std::vector<std::size_t> shape;
  std::string_view inside = text.substr(1, end - 1);
  while (!inside.empty()) {
    if (inside.front() == ' ' || inside.front() == ',') {
      inside.remove_prefix(1);
      continue;
    }
    std::size_t side = 0;
    const auto [next, error] = std::from_chars(inside.data(), inside.data() + inside.size(), side);
    if (error != std::errc{} || shape.size() == kMaxDimensions) {
      refuse(name, fmt::format("at most {} sides, whole numbers", kMaxDimensions),
             std::string(text.substr(0, end + 1)));
    }
    inside.remove_prefix(static_cast<std::size_t>(next - inside.data()));
    shape.push_back(side);
  }
  return shape;
}

std::size_t size_of_type(std::string_view type) {
  if (type == "|u1") return 1;
  if (type == "<i4" || type == "<f4") return 4;
  if (type == "<i8" || type == "<f8") return 8;
  if (!type.starts_with("<U")) return 0;
  const auto characters = whole_number<std::size_t>(type.substr(2));
  return characters && *characters <= kMaxText ? 4 * *characters : 0;
}

template <typename T>
T value_at(ByteView bytes, std::size_t index) {
  T value{};
  std::memcpy(&value, bytes.data() + index * sizeof value, sizeof value);
  return value;
}

double number_at(std::string_view type, ByteView bytes, std::size_t index) {
  if (type == "|u1") return bytes[index];
  if (type == "<i4") return value_at<std::int32_t>(bytes, index);
  if (type == "<i8") return static_cast<double>(value_at<std::int64_t>(bytes, index));
  if (type == "<f4") return static_cast<double>(value_at<float>(bytes, index));
  return value_at<double>(bytes, index);
}

void append_utf8(std::string& text, std::uint32_t code) {
  if (code < 0x80) {
    text += static_cast<char>(code);
  } else if (code < 0x800) {
    text += static_cast<char>(0xC0 | code >> 6);
    text += static_cast<char>(0x80 | (code & 0x3F));
  } else if (code < 0x10000) {
    text += static_cast<char>(0xE0 | code >> 12);
    text += static_cast<char>(0x80 | (code >> 6 & 0x3F));
    text += static_cast<char>(0x80 | (code & 0x3F));
  } else {
    text += static_cast<char>(0xF0 | code >> 18);
    text += static_cast<char>(0x80 | (code >> 12 & 0x3F));
    text += static_cast<char>(0x80 | (code >> 6 & 0x3F));
    text += static_cast<char>(0x80 | (code & 0x3F));
  }
}

}  // namespace

std::size_t NumpyHeader::value_size() const { return size_of_type(type); }

std::size_t NumpyHeader::count() const {
  std::size_t values = 1;
  for (const std::size_t side : shape) values *= side;
  return values;
}

NumpyHeader parse_numpy_header(ByteView bytes, std::size_t file_size, std::string_view name) {
  if (bytes.size() < 10 || as_text(bytes.first(kMagic.size())) != kMagic) {
    refuse(name, "a file that begins as one of NumPy's arrays (.npy)", "other bytes");
  }
  const int version = bytes[6];
  if (version < 1 || version > 3) refuse(name, "format 1, 2 or 3", std::to_string(version));
  const std::size_t length_bytes = version == 1 ? 2 : 4;
  std::size_t length = 0;
  const std::size_t prefix = 8 + length_bytes;
  if (bytes.size() < prefix) refuse(name, "a whole header", "its beginning");
  for (std::size_t i = 0; i < length_bytes; ++i) length |= static_cast<std::size_t>(bytes[8 + i]) << 8 * i;
  if (length > kMaxHeader || prefix + length > bytes.size()) {
    refuse(name, fmt::format("a header of at most {} bytes", kMaxHeader), fmt::format("{} bytes", length));
  }
  const std::string_view header = as_text(bytes.subspan(prefix, length));
  NumpyHeader result;
  result.begin = prefix + length;
  const std::string_view type = literal(header, "descr", name);
  const std::size_t end = type.empty() ? std::string_view::npos : type.find(type.front(), 1);
  if (type.empty() || (type.front() != '\'' && type.front() != '"') || end == std::string_view::npos) {
    refuse(name, "values of one type", std::string(type.substr(0, 40)));
  }
  result.type = type.substr(1, end - 1);
  if (result.type.find('O') != std::string::npos) {
    refuse(name, "numbers or text", "pickled objects, which are not read: loading them would run what they say");
  }
  if (size_of_type(result.type) == 0) refuse(name, "|u1, <i4, <i8, <f4, <f8 or <U…", result.type);
  if (!literal(header, "fortran_order", name).starts_with("False")) refuse(name, "C order", "Fortran order");
  result.shape = shape_of(literal(header, "shape", name), name);
  std::size_t values = 1;
  for (const std::size_t side : result.shape) {
    if (side != 0 && values > file_size / side) refuse(name, "as many values as the file holds", "more");
    values *= side;
  }
  if (file_size < result.begin || (file_size - result.begin) / result.value_size() < values) {
    refuse(name, fmt::format("{} values of {} bytes", values, result.value_size()),
           fmt::format("{} bytes", file_size < result.begin ? 0 : file_size - result.begin));
  }
  return result;
}

NumpyArray::NumpyArray(Bytes file, std::string name)
    : file_(std::move(file)), name_(std::move(name)), header_(parse_numpy_header(file_, file_.size(), name_)) {}

std::vector<double> NumpyArray::numbers(std::size_t count) const {
  if (header_.type.starts_with("<U") || header_.count() != count) {
    refuse(name_, fmt::format("{} numbers", count), fmt::format("{} values of type {}", header_.count(), header_.type));
  }
  std::vector<double> result;
  for (std::size_t i = 0; i < count; ++i) {
    result.push_back(number_at(header_.type, values(), i));
    if (!std::isfinite(result.back())) refuse(name_, "finite numbers", fmt::format("value {} is none", i));
  }
  return result;
}

std::string NumpyArray::text() const {
  if (!header_.type.starts_with("<U") || header_.count() != 1) refuse(name_, "one text", header_.type);
  std::string result;
  for (std::size_t i = 0; i < header_.value_size() / 4; ++i) {
    const auto code = value_at<std::uint32_t>(values(), i);
    if (code == 0) break;
    if (code > 0x10FFFF) refuse(name_, "text", "a character that there is none of");
    append_utf8(result, code);
  }
  return result;
}

NumpyRaster::NumpyRaster(std::filesystem::path path) : path_(std::move(path)) {
  const InputFile file(path_);
  Bytes begin(static_cast<std::size_t>(std::min<std::uint64_t>(file.size(), kMaxHeader)));
  if (!file.read_at(0, begin)) refuse(path_.string(), "a whole header", "its beginning");
  header_ = parse_numpy_header(begin, static_cast<std::size_t>(file.size()), path_.string());
  if (header_.shape.size() < 2 || header_.shape.size() > 3 || header_.type.starts_with("<U")) {
    refuse(path_.string(), "a matrix of numbers", fmt::format("{} sides, {}", header_.shape.size(), header_.type));
  }
}

std::optional<double> NumpyRaster::at(std::ptrdiff_t row, std::ptrdiff_t column) const {
  if (row < 0 || column < 0 || std::cmp_greater_equal(row, header_.shape[0]) ||
      std::cmp_greater_equal(column, header_.shape[1])) {
    return std::nullopt;
  }
  const std::size_t planes = header_.shape.size() == 3 ? header_.shape[2] : 1;
  const std::size_t index =
      (static_cast<std::size_t>(row) * header_.shape[1] + static_cast<std::size_t>(column)) * planes;
  std::array<std::uint8_t, 8> bytes{};
  const std::span<std::uint8_t> value(bytes.data(), header_.value_size());
  if (!InputFile(path_).read_at(header_.begin + index * header_.value_size(), value)) return std::nullopt;
  const double number = number_at(header_.type, value, 0);
  return std::isfinite(number) ? std::optional(number) : std::nullopt;
}

NumpyArchive::NumpyArchive(std::filesystem::path path) : path_(std::filesystem::absolute(path)) {
  register_gdal_drivers();
  InputFile file(path_);  // a regular file
}

std::string NumpyArchive::member(std::string_view array) const {
  return fmt::format("/vsizip/{{{}}}/{}.npy", path_.string(), array);
}

bool NumpyArchive::has(std::string_view array) const {
  const QuietGdal quiet;
  VSIStatBufL stat;
  return VSIStatL(member(array).c_str(), &stat) == 0;
}

NumpyArray NumpyArchive::array(std::string_view array) const {
  const QuietGdal quiet;
  const std::string name = fmt::format("{}, array {}", path_.string(), array);
  const auto close = [](VSILFILE* file) { VSIFCloseL(file); };
  const std::unique_ptr<VSILFILE, decltype(close)> file(VSIFOpenL(member(array).c_str(), "rb"), close);
  if (!file) {
    throw Error({.what = "an array is missing", .where = name, .expected = "an archive of NumPy (.npz) that holds it"});
  }
  VSIFSeekL(file.get(), 0, SEEK_END);
  const vsi_l_offset size = VSIFTellL(file.get());
  if (size > kMaxArray) refuse(name, fmt::format("at most {} bytes", kMaxArray), fmt::format("{} bytes", size));
  VSIFSeekL(file.get(), 0, SEEK_SET);
  Bytes bytes(static_cast<std::size_t>(size));
  if (VSIFReadL(bytes.data(), 1, bytes.size(), file.get()) != bytes.size()) {
    throw Error({.what = "an array cannot be read", .where = name, .found = "a damaged archive"});
  }
  return {std::move(bytes), name};
}

}  // namespace nadir
