// What is known about one tile besides its picture: digest, origin, date, resolution, accuracy. Rows of the table
// nadir_sidecars inside the MBTiles (sidecar_sql.hpp); the MBTiles stay readable for everybody else.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "base/time.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {

// service: from the imagery's provider; candidate: made in flight; soft: candidate with weak evidence.
enum class TileTrust { service, candidate, soft };
std::string_view name_of(TileTrust trust);
std::optional<TileTrust> parse_tile_trust(std::string_view name);

inline constexpr std::int64_t kWholeTile_ppm = 1'000'000;

struct Sidecar {
  TileKey key;
  Sha256 sha256;       // of the tile's encoded bytes
  std::string source;  // provider
  UtcTime captured_at;
  std::int64_t gsd_mm = 0;   // the source's ground sample distance
  std::int64_t ce90_mm = 0;  // circular error of its placement, 90 %
  TileTrust trust = TileTrust::service;
  std::string sector;                       // id of the sector that decides the freshness; empty outside of all
  std::int64_t valid_ppm = kWholeTile_ppm;  // share of the pixels that show ground
  Bytes mask;                               // PNG, one channel, 255 where the pixel is valid; empty when all are
};

// One digest over all sidecars of a tile set, in the order of TileKey: signed with the manifest, so that dates,
// accuracies and masks cannot be exchanged without touching a tile. Each row goes in as
//   z:u8 x:u32be y:u32be sha256[32] captured_at:i64be gsd_mm:i64be ce90_mm:i64be valid_ppm:i64be
//   then source, trust, sector and mask, each as length:u32be and bytes.
class SidecarDigest {
 public:
  void add(const Sidecar& sidecar);  // throws Error when not in the order of TileKey
  Sha256 finish();

 private:
  Sha256Stream stream_;
  std::optional<TileKey> last_;
  Bytes row_;
};

}  // namespace nadir
