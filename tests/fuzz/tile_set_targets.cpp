// MBTiles from anybody: a whole file's bytes, and the rows of a sound file.
#include <algorithm>
#include <optional>

#include "base/progress.hpp"
#include "fuzz/any_rows.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "imagery/mbtiles_reader.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"
#include "package/tile_set_check.hpp"
#include "package/validate.hpp"

namespace nadir::fuzz {
namespace {

// A corridor of one or two tiles: judging it takes no time.
const Mission& small_mission() {
  static const Mission mission = parse_mission(R"(schema: nadir.mission/1
id: fuzz
series: fuzz
sequence: 1
created: 2024-04-20T00:00:00Z
expires: 2024-06-01T00:00:00Z
takeoff: {lon_deg: 11.0000, lat_deg: 48.0000}
terrain: {mode: flat}
zoom: {min: 10, max: 11}
min_resolution_m: 60
budget_mb: 1
freshness_days: {stable: 730, active: 90}
airframes: [any]
sectors: []
route:
  corridor_half_width_m: 40
  agl_m: 120
  points: [[11.0000, 48.0000], [11.0020, 48.0005]]
)",
                                               "fuzz")
                                     .mission.value();
  return mission;
}

void judge(const std::filesystem::path& path) {
  NoProgress progress;
  refusing([&] {
    const Validation result = validate_tile_set(path, small_mission(), UtcTime{1'714'003'200}, progress);
    require(std::is_sorted(result.sidecars.begin(), result.sidecars.end(),
                           [](const Sidecar& a, const Sidecar& b) { return a.key < b.key; }),
            "tiles out of order");
    require(result.tiles >= result.sidecars.size(), "more tiles judged than there are");
  });
  check_tile_set(path, {}, VerifyDepth::full, progress);  // must never throw
  refusing([&] {
    const MbtilesReader reader(path);
    static_cast<void>(reader.metadata());
    const int zoom = reader.zooms().max;
    require(zoom >= 0 && zoom <= kMaxZoom, "a zoom outside of the grid");
    for (const std::uint32_t at : {0U, 1U, 5U}) {
      static_cast<void>(reader.read({static_cast<std::uint8_t>(zoom), at, at}));
      static_cast<void>(reader.read_mask({static_cast<std::uint8_t>(zoom), at, at}));
    }
  });
}

}  // namespace

void mbtiles(std::string_view bytes) { judge(scratch_file("any.mbtiles", bytes)); }

void tile_rows(std::string_view bytes) {
  static const test::TemporaryFolder folder;
  static int number = 0;
  const std::filesystem::path path = folder / ("rows" + std::to_string(++number));
  {
    const SqliteDatabase database = SqliteDatabase::create(path);
    database.execute(
        "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN; CREATE TABLE metadata (name, value);"
        "CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)");
    Source source(bytes);
    std::string sidecars(sql::kCreateSidecars);
    if (const auto key = sidecars.find(",\n  PRIMARY"); key != std::string::npos) sidecars.resize(key);
    const bool judged_by_sidecars = source.byte() % 2 == 1;
    if (judged_by_sidecars) database.execute(sidecars + ")");
    auto tile = database.prepare("INSERT INTO tiles VALUES (?, ?, ?, ?)");
    auto datum = database.prepare("INSERT INTO metadata VALUES (?, ?)");
    std::optional<SqliteStatement> sidecar;
    if (judged_by_sidecars) sidecar = database.prepare(std::string("INSERT OR IGNORE") + (sql::kInsertSidecar + 7));
    for (int row = 0; row < 64 && !source.empty(); ++row) {
      const int kind = source.byte() % 3;
      SqliteStatement& insert = kind == 2 && sidecar ? *sidecar : kind == 1 ? datum : tile;
      const int columns = &insert == &tile ? 4 : &insert == &datum ? 2 : 12;
      for (int column = 1; column <= columns; ++column) bind_any(insert, column, source);
      insert.run();
    }
    database.execute("COMMIT");
  }
  judge(path);
  std::filesystem::remove(path);
}

}  // namespace nadir::fuzz
