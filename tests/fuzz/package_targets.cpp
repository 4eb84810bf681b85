// What packages are made of: signed documents, missions and tile sets.
#include <algorithm>
#include <optional>

#include "base/progress.hpp"
#include "fuzz/any_rows.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "imagery/cog_reader.hpp"
#include "imagery/mbtiles.hpp"
#include "imagery/pmtiles.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"
#include "package/tile_set_check.hpp"
#include "package/validate.hpp"
#include "package/vector_layer.hpp"
#include "package_delta/file_delta.hpp"
#include "package_delta/package_patch.hpp"
#include "trust/aircraft_state.hpp"
#include "trust/rollback_permit.hpp"
#include "trust/root.hpp"
#include "trust/signed_document.hpp"
#include "trust/time_permit.hpp"

namespace nadir::fuzz {

// Signed documents, documents that decide about trust, and the mission.

void root(std::string_view bytes) {
  refusing([&] {
    const SignedRoot first = parse_root(bytes, "fuzz");
    const SignedRoot again = parse_root(first.json(), "again");
    require(again.signed_bytes == first.signed_bytes, "a root changes when it is written");
    require(again.root.version == first.root.version, "a root's version changes");
    check_self(first);
    check_succession(first.root, again, UtcTime{1'800'000'000});
  });
}

void envelope(std::string_view bytes) {
  refusing([&] {
    const Envelope first = parse_envelope(bytes, "fuzz");
    const Envelope again = parse_envelope(envelope_json(first), "again");
    require(again.payload_type == first.payload_type, "a payload type changes");
    require(again.signatures.size() == first.signatures.size(), "signatures get lost");
  });
}

void manifest(std::string_view bytes) {
  const ManifestReading first = parse_manifest(as_bytes(bytes));
  require(first.manifest.has_value() == first.findings.empty(), "a manifest with findings, or neither");
  if (!first.manifest) return;
  const std::string written = manifest_json(*first.manifest);
  const ManifestReading again = parse_manifest(as_bytes(written));
  require(again.manifest.has_value(), "what was accepted is refused when it is written again");
  require(manifest_json(*again.manifest) == written, "a manifest changes when it is written");
}

void vectors(std::string_view bytes) {
  refusing([&] {
    const VectorLayer first = parse_vectors(as_bytes(bytes), "fuzz");
    for (const MapVector& vector : first.features) {
      require(!vector.parts.empty() && vector.parts.front().size() > 1, "a feature without a shape");
      require(vector.is_area || vector.parts.size() == 1, "a line of several parts");
    }
    const std::string written = vectors_geojson(first);
    require(vectors_geojson(parse_vectors(as_bytes(written), "again")) == written,
            "vectors change when they are written");
  });
}

void mission(std::string_view bytes) {
  const MissionReading reading = parse_mission(bytes, "fuzz");
  require(reading.mission.has_value() == !reading.findings.has_errors(), "a mission with refusals, or neither");
}

void state(std::string_view bytes) {
  const StateReading reading = parse_state(bytes, "fuzz");
  require(reading.state.has_value() == reading.findings.empty(), "a state with findings, or neither");
}

void permit(std::string_view bytes) {
  refusing([&] {
    const SignedPermit first = parse_permit(bytes, "fuzz");
    require(first.permit.to < first.permit.from, "a permit that is no step back");
    const SignedPermit again = parse_permit(first.document.json(), "again");
    require(again.document.signed_bytes == first.document.signed_bytes, "a permit changes when it is written");
  });
}

void patch(std::string_view bytes) {
  refusing([&] {
    const SignedPatch first = read_patch(InputFile(scratch_file("patch", bytes)));
    require(!first.header.files.empty(), "a patch without files");
    const SignedPatch again = parse_patch(as_bytes(first.document.json()), "again");
    require(again.document.signed_bytes == first.document.signed_bytes, "a patch changes when it is written");
  });
}

void file_delta(std::string_view bytes) {
  const std::string old_bytes(20'000, 'o');
  refusing([&] {
    const InputFile old_file(scratch_file("old", old_bytes));
    std::size_t at = 0, made = 0;
    const ByteSource source = [&](std::span<std::uint8_t> target) {
      const std::size_t size = std::min(target.size(), bytes.size() - at);
      std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), size, target.begin());
      at += size;
      return size;
    };
    apply_file_delta(&old_file, source, [&](ByteView part) {
      made += part.size();
      if (made > (std::size_t{1} << 24)) throw Error({.what = "as much as was announced"});
    });
  });
}

void time_permit(std::string_view bytes) {
  refusing([&] {
    const SignedTimePermit first = parse_time_permit(bytes, "fuzz");
    require(first.permit.instead < first.permit.remembered, "a permit that leads forwards");
    const SignedTimePermit again = parse_time_permit(first.document.json(), "again");
    require(again.document.signed_bytes == first.document.signed_bytes, "a permit changes when it is written");
  });
}

// Untrusted MBTiles: a whole file's bytes, and the rows of a valid file.

namespace {

// A corridor of one or two tiles: checking it is fast.
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
  TileSetFacts facts;
  facts.count = 1000;
  check_tile_set(open_tile_set_files(path), facts, VerifyDepth::full, progress);  // must never throw
  refusing([&] { static_cast<void>(SqliteDatabase::open_immutable(path, SqliteSchema::plain)); });
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

// Untrusted COGs: a whole file's bytes, through the reader that aircraft use (no GDAL).

namespace {

constexpr std::int64_t kQuick = 1'000'000;  // pixels of a block: larger ones are allowed, but slow

void require_tile(const CogReader& reader, const TileKey& key, bool native) {
  refusing([&] {
    const std::optional<Bytes> tile = reader.read(key);
    require(!native || tile.has_value(), "a block that is no tile");
    if (!tile || native) return;  // the bytes of a block are another target's: picture
    const DecodedImage image = decode_image(*tile, Colour::bgr, "fuzz");
    require(image.image.cols == kTileSize && image.image.rows == kTileSize, "a cut tile of another size");
  });
  refusing([&] {
    const std::optional<Bytes> mask = reader.read_mask(key);
    if (!mask) return;
    const DecodedImage image = decode_image(*mask, Colour::grey, "fuzz");
    require(image.image.cols == kTileSize && image.image.rows == kTileSize, "a mask of another size");
  });
}

}  // namespace

void cog(std::string_view bytes) {
  refusing([&] {
    const CogReader reader(std::make_unique<MemoryBytes>(as_bytes(bytes)), "fuzz");
    const std::vector<CogLevel>& levels = reader.levels();
    require(reader.zooms().min >= 0 && reader.zooms().max <= kMaxZoom, "a zoom outside of the grid");
    require(std::is_sorted(levels.begin(), levels.end(),
                           [](const CogLevel& a, const CogLevel& b) { return a.zoom > b.zoom; }),
            "levels out of order");
    std::int64_t tiles = 0;
    for (const CogLevel& level : levels) {
      const CogBlocks& blocks = level.picture;
      tiles += (blocks.width / kTileSize + 2) * (blocks.height / kTileSize + 2);
      for (const CogBlocks* part : {&blocks, level.mask ? &*level.mask : &blocks}) {
        if (std::int64_t{part->form.width} * part->form.height > kQuick) return;
      }
    }
    if (tiles > 10'000) return;
    const std::vector<TileKey> keys = reader.keys();
    require(std::is_sorted(keys.begin(), keys.end()), "tiles out of order");
    require(std::adjacent_find(keys.begin(), keys.end()) == keys.end(), "one tile twice");
    const std::size_t step = 1 + keys.size() / 4;
    for (std::size_t i = 0; i < keys.size(); i += step) {
      require(keys[i].valid(), "an address outside of the grid");
      const CogLevel* level = reader.level(keys[i].z);
      require(level != nullptr, "a tile of a zoom that is not there");
      require_tile(reader, keys[i], level->native());
    }
  });
}

void pmtiles(std::string_view bytes) {
  refusing([&] {
    const PmtilesReader reader(InputFile(scratch_file("any.pmtiles", bytes)));
    require(reader.zooms().min >= 0 && reader.zooms().max <= kMaxZoom, "a zoom outside of the grid");
    const std::vector<TileKey> keys = reader.keys();
    require(!keys.empty() && std::is_sorted(keys.begin(), keys.end()), "tiles out of order");
    require(std::adjacent_find(keys.begin(), keys.end()) == keys.end(), "one tile twice");
    const std::size_t step = 1 + keys.size() / 16;
    for (std::size_t i = 0; i < keys.size(); i += step) {
      require(keys[i].valid(), "an address outside of the grid");
      const auto tile = reader.read(keys[i]);
      require(tile && tile->size() == reader.stored_size(keys[i]), "a tile of another size");
    }
  });
}

}  // namespace nadir::fuzz
