// A TIFF in memory, opened by libtiff for reading. What libtiff says goes into `complaint` instead of to stderr.
#pragma once

#include <tiffio.h>

#include <cstdint>
#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>

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

// A file of one image of float32 that lies north up, in a layout that is known beforehand. libtiff checks the tags of
// TIFF itself; the types of GeoTIFF's and GDAL's are checked here, because libtiff does not know them (or only when
// GDAL lives in the same process). All members throw Error for what is not as expected.
class StrictGeoTiff {
 public:
  struct Texts {
    const char* kind;  // "terrain file": of which messages speak
    const char* fix;
  };
  // name: for messages. max_allocation: as of open_tiff().
  StrictGeoTiff(ByteView file, std::string_view name, const Texts& texts, tmsize_t max_allocation);
  StrictGeoTiff(const StrictGeoTiff&) = delete;  // libtiff holds a pointer into it
  StrictGeoTiff& operator=(const StrictGeoTiff&) = delete;

  TIFF* tiff() const { return tiff_.get(); }
  const std::string& complaint() const { return memory_.complaint; }
  [[noreturn]] void refuse(std::string expected, std::string found) const;

  // tiles or strips; planar_configuration: PLANARCONFIG_CONTIG or PLANARCONFIG_SEPARATE.
  void check_layout(bool tiles, std::uint16_t bands, std::uint16_t planar_configuration) const;
  std::uint32_t number(std::uint32_t tag) const;  // of 32 bits that TIFF defines; 0: absent
  // The text of a tag that TIFF does not define; empty: absent.
  std::string_view text(std::uint32_t tag) const;

  struct NorthUp {
    double west = 0, north = 0, column_step = 0, row_step = 0;
  };
  NorthUp north_up() const;
  std::uint16_t geo_key(std::uint16_t key) const;  // 0: absent, or no number

 private:
  void expect(const char* what, std::uint32_t found, std::initializer_list<std::uint32_t> allowed) const;
  std::uint16_t short_number(std::uint32_t tag) const;
  // Of a tag that TIFF does not define; null when it is absent or of another type.
  const void* values(std::uint32_t tag, TIFFDataType type, std::size_t& count) const;

  std::string name_;
  Texts texts_;
  TiffMemory memory_;
  TiffHandle tiff_;
};

}  // namespace nadir
