#include "imagery/tiff_memory.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <utility>

#include "base/error.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

TiffMemory& memory_of(thandle_t handle) { return *static_cast<TiffMemory*>(handle); }

tmsize_t read_memory(thandle_t handle, void* into, tmsize_t size) {
  TiffMemory& memory = memory_of(handle);
  if (size <= 0 || memory.at >= memory.bytes.size()) return 0;
  const auto count =
      std::min(static_cast<std::size_t>(size), memory.bytes.size() - static_cast<std::size_t>(memory.at));
  std::memcpy(into, memory.bytes.data() + memory.at, count);
  memory.at += count;
  return static_cast<tmsize_t>(count);
}

tmsize_t write_nothing(thandle_t, void*, tmsize_t) { return 0; }

toff_t seek_memory(thandle_t handle, toff_t offset, int whence) {
  TiffMemory& memory = memory_of(handle);
  const std::uint64_t base = whence == SEEK_SET ? 0 : whence == SEEK_CUR ? memory.at : memory.bytes.size();
  memory.at = base + offset;  // wraps like libtiff's own negative offsets do; reading checks the place
  return memory.at;
}

int close_memory(thandle_t) { return 0; }
toff_t size_of_memory(thandle_t handle) { return memory_of(handle).bytes.size(); }

__attribute__((format(printf, 4, 0))) int keep_complaint(TIFF*, void* user, const char*, const char* format,
                                                         va_list arguments) {
  TiffMemory& memory = *static_cast<TiffMemory*>(user);
  std::array<char, 256> text{};
  std::vsnprintf(text.data(), text.size(), format, arguments);
  if (memory.complaint.empty()) memory.complaint = printable(text.data());
  return 1;
}

__attribute__((format(printf, 4, 0))) int ignore_warning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

struct FreeOptions {
  void operator()(TIFFOpenOptions* options) const { TIFFOpenOptionsFree(options); }
};

}  // namespace

TiffHandle open_tiff(TiffMemory& memory, const char* name, tmsize_t max_allocation) {
  const std::unique_ptr<TIFFOpenOptions, FreeOptions> options(TIFFOpenOptionsAlloc());
  if (max_allocation > 0) TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), max_allocation);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), keep_complaint, &memory);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), ignore_warning, &memory);
  return TiffHandle(TIFFClientOpenExt(name, "rm", &memory, read_memory, write_nothing, seek_memory, close_memory,
                                      size_of_memory, nullptr, nullptr, options.get()));
}

StrictGeoTiff::StrictGeoTiff(ByteView file, std::string_view name, const Texts& texts, tmsize_t max_allocation)
    : name_(name), texts_(texts), memory_{file}, tiff_(open_tiff(memory_, texts.kind, max_allocation)) {
  if (!tiff_) refuse("a complete TIFF file", memory_.complaint);
}

void StrictGeoTiff::refuse(std::string expected, std::string found) const {
  throw Error({.what = fmt::format("this {} cannot be used", texts_.kind),
               .where = name_,
               .expected = std::move(expected),
               .found = found.empty() ? "something else" : std::move(found),
               .fix = texts_.fix});
}

void StrictGeoTiff::expect(const char* what, std::uint32_t found, std::initializer_list<std::uint32_t> allowed) const {
  if (std::find(allowed.begin(), allowed.end(), found) != allowed.end()) return;
  refuse(fmt::format("{} {}", what, *allowed.begin()), fmt::format("{} {}", what, found));
}

std::uint32_t StrictGeoTiff::number(std::uint32_t tag) const {
  std::uint32_t value = 0;
  return TIFFGetFieldDefaulted(tiff_.get(), tag, &value) == 1 ? value : 0;
}

std::uint16_t StrictGeoTiff::short_number(std::uint32_t tag) const {
  std::uint16_t value = 0;
  return TIFFGetFieldDefaulted(tiff_.get(), tag, &value) == 1 ? value : std::uint16_t{0};
}

void StrictGeoTiff::check_layout(bool tiles, std::uint16_t bands, std::uint16_t planar_configuration) const {
  if (TIFFLastDirectory(tiff_.get()) == 0) refuse("one image", "several");
  if ((TIFFIsTiled(tiff_.get()) != 0) != tiles) {
    refuse(tiles ? "a tiled file" : "a file in strips", tiles ? "one in strips" : "a tiled one");
  }
  expect("samples per pixel", short_number(TIFFTAG_SAMPLESPERPIXEL), {bands});
  expect("bits per sample", short_number(TIFFTAG_BITSPERSAMPLE), {32});
  expect("sample format", short_number(TIFFTAG_SAMPLEFORMAT), {SAMPLEFORMAT_IEEEFP});
  expect("planar configuration", short_number(TIFFTAG_PLANARCONFIG), {planar_configuration});
  expect("compression", short_number(TIFFTAG_COMPRESSION),
         {COMPRESSION_ADOBE_DEFLATE, COMPRESSION_NONE, COMPRESSION_DEFLATE});
}

const void* StrictGeoTiff::values(std::uint32_t tag, TIFFDataType type, std::size_t& count) const {
  const TIFFField* field = TIFFFindField(tiff_.get(), tag, TIFF_ANY);
  if (field == nullptr || TIFFFieldDataType(field) != type) return nullptr;
  const void* values = nullptr;
  if (TIFFFieldPassCount(field) == 0) {
    if (type != TIFF_ASCII || TIFFGetField(tiff_.get(), tag, &values) != 1 || values == nullptr) return nullptr;
    count = std::strlen(static_cast<const char*>(values));
  } else if (TIFFFieldReadCount(field) == TIFF_VARIABLE2) {
    std::uint32_t wide = 0;
    if (TIFFGetField(tiff_.get(), tag, &wide, &values) != 1) return nullptr;
    count = wide;
  } else if (TIFFFieldReadCount(field) == TIFF_VARIABLE) {
    std::uint16_t narrow = 0;
    if (TIFFGetField(tiff_.get(), tag, &narrow, &values) != 1) return nullptr;
    count = narrow;
  } else {
    return nullptr;
  }
  return values;
}

std::string_view StrictGeoTiff::text(std::uint32_t tag) const {
  std::size_t count = 0;
  const auto* text = static_cast<const char*>(values(tag, TIFF_ASCII, count));
  return text == nullptr ? std::string_view() : std::string_view(text, std::find(text, text + count, '\0'));
}

StrictGeoTiff::NorthUp StrictGeoTiff::north_up() const {
  constexpr std::uint32_t kPixelScale = 33550, kTiepoint = 33922, kTransformation = 34264;
  std::size_t scales = 0, ties = 0, other = 0;
  const auto* scale = static_cast<const double*>(values(kPixelScale, TIFF_DOUBLE, scales));
  const auto* tie = static_cast<const double*>(values(kTiepoint, TIFF_DOUBLE, ties));
  if (values(kTransformation, TIFF_DOUBLE, other) != nullptr || scale == nullptr || scales != 3 || tie == nullptr ||
      ties != 6 || tie[0] != 0 || tie[1] != 0) {
    refuse("a grid that lies north up: ModelPixelScale and one ModelTiepoint of pixel 0, 0", "another georeference");
  }
  return {tie[3], tie[4], scale[0], scale[1]};
}

// The directory: rows of (key, place of the value, count, value) after a row of header.
std::uint16_t StrictGeoTiff::geo_key(std::uint16_t key) const {
  constexpr std::uint32_t kGeoKeys = 34735;
  std::size_t count = 0;
  const auto* keys = static_cast<const std::uint16_t*>(values(kGeoKeys, TIFF_SHORT, count));
  std::uint16_t value = 0;
  for (std::size_t i = 4; keys != nullptr && i + 3 < count; i += 4) {
    // Where the value lies elsewhere it is a text or a list, which says nothing new.
    if (keys[i] == key && keys[i + 1] == 0) value = keys[i + 3];
  }
  return value;
}

}  // namespace nadir
