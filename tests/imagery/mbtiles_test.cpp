#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/mbtiles.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

const TileKey kSpecTile{11, 327, 791};  // the specification's own example: row 791 is stored as 1256

void write_set(const std::filesystem::path& path) {
  MbtilesWriter writer(path);
  writer.add(kSpecTile, as_bytes("the tile"));
  writer.add({10, 163, 395}, as_bytes("its parent"));
  writer.set_metadata({{"name", "test"}, {"format", "png"}});
  writer.finish();
}

std::string sql(const std::filesystem::path& file, const std::string& query) {
  const auto result = test::run_process({"sqlite3", file.string(), query});
  EXPECT_EQ(result.code, 0) << result.err;
  return result.out;
}

TEST(Mbtiles, RowsCountFromTheSouth) {
  const test::TemporaryFolder folder;
  const auto file = folder / "set.mbtiles";
  write_set(file);
  EXPECT_EQ(sql(file, "SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles WHERE zoom_level = 11"),
            "11|327|1256|the tile\n");
  EXPECT_EQ(sql(file, "PRAGMA application_id"), "1297105496\n");  // 0x4d504258
  EXPECT_EQ(sql(file, "PRAGMA integrity_check; PRAGMA journal_mode"), "ok\ndelete\n");
  EXPECT_EQ(sql(file, "SELECT value FROM metadata WHERE name = 'format'"), "png\n");

  const MbtilesReader reader(file);
  EXPECT_EQ(reader.zooms().min, 10);
  EXPECT_EQ(reader.zooms().max, 11);
  const auto tile = reader.read(kSpecTile);
  ASSERT_TRUE(tile);
  EXPECT_EQ(as_text(*tile), "the tile");
  EXPECT_FALSE(reader.read({11, 327, 1256}));  // the flipped address is another place
  EXPECT_FALSE(reader.read({11, 5000, 0}));
  EXPECT_FALSE(reader.read_mask(kSpecTile));
  EXPECT_EQ(reader.metadata().at("name"), "test");
}

// Python's word on the digest that `mbtiles validate` computes.
TEST(Mbtiles, StoresTheDigestForMbtilesValidate) {
  const test::TemporaryFolder folder;
  const auto file = folder / "set.mbtiles";
  MbtilesWriter writer(file);
  for (std::uint32_t i = 0; i < 40; ++i) writer.add({12, 100 + 37 * i % 40, 9 + i / 3}, as_bytes(std::string(i, 'x')));
  writer.add({3, 4, 0}, as_bytes("top"));
  writer.finish();
  const auto oracle =
      test::run_process({"python3", "-c",
                         "import hashlib, sqlite3, sys\n"
                         "digest = hashlib.md5()\n"
                         "rows = sqlite3.connect(sys.argv[1]).execute('SELECT * FROM tiles').fetchall()\n"
                         "for z, x, y, data in sorted(rows): digest.update(f'{z}{x}{y}'.encode() + data)\n"
                         "print(digest.hexdigest().upper())",
                         file.string()});
  ASSERT_EQ(oracle.code, 0) << oracle.err;
  EXPECT_EQ(sql(file, "SELECT value FROM metadata WHERE name = 'agg_tiles_hash'"), oracle.out);
  MbtilesWriter(folder / "empty.mbtiles").finish();
  EXPECT_EQ(sql(folder / "empty.mbtiles", "SELECT value FROM metadata"), "D41D8CD98F00B204E9800998ECF8427E\n");
}

TEST(Mbtiles, MasksComeFromTheSidecars) {
  const test::TemporaryFolder folder;
  const auto file = folder / "set.mbtiles";
  write_set(file);
  sql(file,
      "CREATE TABLE nadir_sidecars (zoom_level, tile_column, tile_row, mask);"
      "INSERT INTO nadir_sidecars VALUES (11, 327, 1256, x'0102'), (10, 163, 628, NULL);");
  const MbtilesReader reader(file);
  EXPECT_EQ(reader.read_mask(kSpecTile), (Bytes{1, 2}));
  EXPECT_FALSE(reader.read_mask({10, 163, 395}));
}

TEST(Mbtiles, IsDeterministic) {
  const test::TemporaryFolder folder;
  write_set(folder / "a.mbtiles");
  write_set(folder / "b.mbtiles");
  EXPECT_EQ(read_file(folder / "a.mbtiles"), read_file(folder / "b.mbtiles"));
}

// However the sizes of the first tiles fall: all tiles are there, in order, and in a file that is hardly larger.
TEST(Mbtiles, PagesFitTheTiles) {
  const test::TemporaryFolder folder;
  struct Case {
    std::size_t tiles, bytes;
    int page_bytes;
    double most;  // of the file, by the bytes of the tiles
  };
  for (const Case& one : {Case{2000, 3300, 65536, 1.1}, Case{2000, 13000, 4096, 1.1}, Case{999, 3300, 4096, 1.3},
                          Case{1000, 7999, 65536, 1.2}, Case{1000, 8000, 4096, 1.1}, Case{3, 3'000'000, 4096, 1.1}}) {
    const auto file = folder / fmt::format("{}-{}.mbtiles", one.tiles, one.bytes);
    MbtilesWriter writer(file);
    for (std::uint32_t i = 0; i < one.tiles; ++i) {
      writer.add({14, i, i}, as_bytes(std::string(one.bytes, static_cast<char>('a' + i % 26))));
    }
    writer.finish();
    EXPECT_EQ(sql(file, "PRAGMA page_size"), std::to_string(one.page_bytes) + "\n") << one.tiles;
    EXPECT_EQ(
        sql(file, "SELECT count(*), sum(length(tile_data)), min(tile_column), max(rowid - tile_column) FROM tiles"),
        fmt::format("{}|{}|0|1\n", one.tiles, one.tiles * one.bytes));
    EXPECT_LT(static_cast<double>(std::filesystem::file_size(file)),
              one.most * static_cast<double>(one.tiles * one.bytes));
    EXPECT_TRUE(MbtilesReader(file).read({14, 1, 1}));
  }
}

TEST(Mbtiles, QuotesAwkwardNames) {
  const test::TemporaryFolder folder;
  const auto file = folder / "50% of #1?mode=rwc.mbtiles";
  write_set(file);
  EXPECT_TRUE(MbtilesReader(file).read(kSpecTile));
}

TEST(Mbtiles, ReadingWritesNothing) {
  const test::TemporaryFolder folder;
  const auto file = folder / "set.mbtiles";
  write_set(file);
  const Bytes before = read_file(file);
  {
    const MbtilesReader reader(file);
    EXPECT_TRUE(reader.read(kSpecTile));
    EXPECT_THROW(reader.database().execute("DELETE FROM tiles"), Error);
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
  }
  EXPECT_EQ(read_file(file), before);
}

TEST(Mbtiles, RejectsADuplicateTile) {
  const test::TemporaryFolder folder;
  MbtilesWriter writer(folder / "set.mbtiles");
  writer.add(kSpecTile, as_bytes("a"));
  writer.add(kSpecTile, as_bytes("b"));
  EXPECT_THROW(writer.finish(), Error);
  EXPECT_THROW(MbtilesWriter(folder / "set.mbtiles"), Error);  // never overwrites
}

TEST(Mbtiles, RejectsOtherFiles) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(MbtilesReader(folder / "missing.mbtiles"), Error);
  EXPECT_THROW(MbtilesReader(folder.path()), Error);
  EXPECT_THROW(MbtilesReader(folder.write("empty.mbtiles", "")), Error);
  EXPECT_THROW(MbtilesReader(folder.write("text.mbtiles", "hello, this is no database at all")), Error);
  sql(folder / "other.mbtiles", "CREATE TABLE birds (name)");
  EXPECT_THROW(MbtilesReader(folder / "other.mbtiles"), Error);
  sql(folder / "hollow.mbtiles",
      "CREATE TABLE metadata (name, value); CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)");
  EXPECT_THROW(MbtilesReader(folder / "hollow.mbtiles"), Error);
  sql(folder / "far.mbtiles",
      "CREATE TABLE metadata (name, value); CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data);"
      "INSERT INTO tiles VALUES (99, 0, 0, x'00')");
  EXPECT_THROW(MbtilesReader(folder / "far.mbtiles"), Error);
}

TEST(Mbtiles, DamagedFilesNeverCrash) {
  const test::TemporaryFolder folder;
  const auto file = folder / "set.mbtiles";
  write_set(file);
  const Bytes whole = read_file(file);
  int refused = 0;
  for (std::size_t at = 16; at < whole.size(); at += 61) {
    Bytes damaged = whole;
    damaged[at] ^= 0x55;
    if (at % 3 == 0) damaged.resize(at);
    const auto place = folder / "damaged.mbtiles";
    std::ofstream(place, std::ios::binary).write(as_text(damaged).data(), static_cast<std::streamsize>(damaged.size()));
    try {
      const MbtilesReader reader(place);
      static_cast<void>(reader.read(kSpecTile));
      static_cast<void>(reader.metadata());
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 50);
}

}  // namespace
}  // namespace nadir
