#include "imagery/tiff_memory.hpp"

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstring>

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

const void* tiff_values(TIFF& tiff, std::uint32_t tag, TIFFDataType type, std::size_t& count) {
  const TIFFField* field = TIFFFindField(&tiff, tag, TIFF_ANY);
  if (field == nullptr || TIFFFieldDataType(field) != type) return nullptr;
  const void* values = nullptr;
  if (TIFFFieldPassCount(field) == 0) {
    if (type != TIFF_ASCII || TIFFGetField(&tiff, tag, &values) != 1 || values == nullptr) return nullptr;
    count = std::strlen(static_cast<const char*>(values));
  } else if (TIFFFieldReadCount(field) == TIFF_VARIABLE2) {
    std::uint32_t wide = 0;
    if (TIFFGetField(&tiff, tag, &wide, &values) != 1) return nullptr;
    count = wide;
  } else if (TIFFFieldReadCount(field) == TIFF_VARIABLE) {
    std::uint16_t narrow = 0;
    if (TIFFGetField(&tiff, tag, &narrow, &values) != 1) return nullptr;
    count = narrow;
  } else {
    return nullptr;
  }
  return values;
}

}  // namespace nadir
