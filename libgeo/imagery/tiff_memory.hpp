// A TIFF in memory, opened by libtiff for reading. What libtiff says goes into `complaint` instead of to stderr.
#pragma once

#include <tiffio.h>

#include <cstdint>
#include <memory>
#include <string>

#include "base/bytes.hpp"

namespace nadir {

// As libtiff wants to see it, and libtiff's first complaint.
struct TiffMemory {
  ByteView bytes;
  std::uint64_t at = 0;
  std::string complaint{};
};

struct CloseTiff {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffHandle = std::unique_ptr<TIFF, CloseTiff>;

// max_allocation: bytes of libtiff's largest single one; 0: its own limit. Null when libtiff refuses it. The memory
// must outlive the handle and stay where it is.
TiffHandle open_tiff(TiffMemory& memory, const char* name, tmsize_t max_allocation);

// The values of a tag that TIFF itself does not define, null when it is absent or of another type.
const void* tiff_values(TIFF& tiff, std::uint32_t tag, TIFFDataType type, std::size_t& count);

}  // namespace nadir
