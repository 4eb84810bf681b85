// nadir catalogue with a SpatiaLite file. Oracles: ogrinfo (GDAL), and sqlite3 with mod_spatialite.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/files.hpp"
#include "cli/program.hpp"
#include "commands/commands.hpp"
#include "package/package_maker.hpp"
#include "package/tile_image.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CatalogueCommands : public ::testing::Test {
 protected:
  int run(std::vector<std::string> args) {
    out_.str("");
    err_.str("");
    args.insert(args.begin(), "catalogue");
    return run_program(nadir_text(), all_commands(), args, {out_, err_, clock_});
  }
  int add(const fs::path& package) { return run({"add", package.string(), "--to", file()}); }
  std::string path(const char* name) const { return (folder_ / name).string(); }
  std::string file() const { return path("fleet.sqlite"); }

  // The output of sqlite3, without the line end.
  std::string sql(const std::string& statement) const {
    auto result = test::run_process({"sqlite3", file(), statement});
    EXPECT_EQ(result.code, 0) << result.err;
    if (result.out.ends_with('\n')) result.out.pop_back();
    return result.out;
  }
  std::string spatial(const std::string& statement) const {
    const std::string out = sql("SELECT load_extension('mod_spatialite'); " + statement);
    return out.substr(out.find('\n') + 1);
  }
  fs::path make(int sequence, const char* name) {
    maker_.mission = test::mission_yaml({{"sequence: 3", "sequence: " + std::to_string(sequence)}});
    return maker_.make(folder_, name);
  }

  test::TemporaryFolder folder_;
  FixedClock clock_{test::kJudged};
  std::ostringstream out_, err_;
  test::PackageMaker maker_;
};

TEST_F(CatalogueCommands, ACatalogueThatWasMadeBeforeItsViewsGetsThem) {
  ASSERT_EQ(add(make(3, "package")), 0) << out_.str() << err_.str();
  // Some of an earlier version, the others of none.
  for (const char* view : {"package_states", "sector_states", "route_states", "corridor_states", "gap_states"}) {
    sql(std::string("DROP VIEW ") + view);
    sql(std::string("DELETE FROM views_geometry_columns WHERE view_name = '") + view + "'");
  }
  ASSERT_EQ(run({"list", file()}), 0) << "reading does without";
  EXPECT_EQ(sql("SELECT count(*) FROM sqlite_master WHERE name = 'package_states'"), "0");
  ASSERT_EQ(add(make(4, "next")), 0) << out_.str() << err_.str();
  EXPECT_EQ(sql("SELECT series, sequence, current FROM package_states ORDER BY sequence"), "village|3|0\nvillage|4|1");
  EXPECT_EQ(sql("SELECT count(*) FROM views_geometry_columns"), "7");
}

TEST_F(CatalogueCommands, AProjectShowsACatalogueThatWasMadeBeforeItsViews) {
  ASSERT_EQ(add(make(3, "package")), 0) << out_.str() << err_.str();
  sql("DROP VIEW gap_states");
  sql("DELETE FROM views_geometry_columns WHERE view_name = 'gap_states'");
  ASSERT_EQ(run({"project", file(), "--out", path("fleet.qgs")}), 0) << err_.str();
  EXPECT_EQ(sql("SELECT count(*) FROM views_geometry_columns WHERE view_name = 'gap_states'"), "1");
  const std::string project = read_text_file(path("fleet.qgs"));
  EXPECT_NE(project.find("dbname='./fleet.sqlite' table=\"package_states\" (geom) sql=\"current\" = 1"),
            std::string::npos)
      << project;
  EXPECT_EQ(project.find(folder_.path().string()), std::string::npos) << "no path of this machine";
  EXPECT_EQ(run({"project", file(), "--out", path("again.qgs")}), 0);
  EXPECT_EQ(read_text_file(path("again.qgs")), project);
  EXPECT_EQ(sql("SELECT count(*) FROM sqlite_master WHERE name = 'layer_styles'"), "0") << "only where it is asked for";
}

TEST_F(CatalogueCommands, StylesAreStoredOnceAndOthersStay) {
  ASSERT_EQ(add(make(3, "package")), 0) << out_.str() << err_.str();
  for (const char* name : {"a.qgs", "b.qgs"}) {
    ASSERT_EQ(run({"project", file(), "--store-styles", "--out", path(name)}), 0) << err_.str();
    sql("INSERT INTO layer_styles (f_table_name, styleName, styleQML) VALUES ('package_states', 'mine', 'x')");
  }
  EXPECT_EQ(sql("SELECT count(*), count(DISTINCT f_table_name), sum(useAsDefault) FROM layer_styles WHERE styleName = "
                "'nadir'"),
            "7|7|7");
  EXPECT_EQ(sql("SELECT count(*) FROM layer_styles WHERE styleName = 'mine'"), "2");
}

TEST_F(CatalogueCommands, AProjectIsRefusedByName) {
  EXPECT_EQ(run({"project", file(), "--out", path("fleet.qgs")}), 2);
  EXPECT_NE(err_.str().find("no such catalogue"), std::string::npos) << err_.str();
  EXPECT_FALSE(fs::exists(file())) << "none is created";
  ASSERT_EQ(add(make(3, "package")), 0);
  EXPECT_EQ(run({"project", file(), "--out", path("fleet.qgz")}), 2);
  EXPECT_NE(err_.str().find(".qgs"), std::string::npos) << err_.str();
  EXPECT_EQ(run({"project", file(), "--candidates", file(), "--out", path("fleet.qgs")}), 2);
  EXPECT_NE(err_.str().find("nadir.candidate-catalogue/1"), std::string::npos) << err_.str();
  EXPECT_FALSE(fs::exists(path("fleet.qgs")));
  write_file_atomic(path("fleet.qgs"), "mine");
  EXPECT_EQ(run({"project", file(), "--out", path("fleet.qgs")}), 2);
  EXPECT_EQ(read_text_file(path("fleet.qgs")), "mine");
}

TEST_F(CatalogueCommands, GdalReadsEveryLayer) {
  ASSERT_EQ(add(make(3, "package")), 0) << out_.str() << err_.str();
  const auto result = test::run_process({"ogrinfo", "-so", "-al", "-ro", file()});
  ASSERT_EQ(result.code, 0) << result.err;
  const std::string tiles = sql("SELECT count(*) FROM tiles");
  EXPECT_EQ(tiles, test::run_process({"sqlite3", path("package/imagery/base.mbtiles"), "SELECT count(*) FROM tiles"})
                       .out.substr(0, tiles.size()));
  for (const auto& [layer, geometry, count] :
       std::vector<std::tuple<std::string, std::string, std::string>>{{"packages", "Multi Polygon", "1"},
                                                                      {"sources", "Multi Polygon", "1"},
                                                                      {"sectors", "Polygon", "1"},
                                                                      {"routes", "Line String", "1"},
                                                                      {"corridors", "Polygon", "1"},
                                                                      {"required_tiles", "Polygon", tiles},
                                                                      {"tiles", "Polygon", tiles},
                                                                      {"gaps", "Multi Polygon", "0"}}) {
    const std::string head = "\nLayer name: " + layer + "\nGeometry: " + geometry + "\nFeature Count: " + count + "\n";
    const std::size_t at = result.out.find(head);
    ASSERT_NE(at, std::string::npos) << head << result.out;
    const std::string rest = result.out.substr(at + 1, result.out.find("\nLayer name", at + 1) - at);
    EXPECT_NE(rest.find("ID[\"EPSG\",4326]"), std::string::npos) << rest;
    EXPECT_NE(rest.find("FID Column = id"), std::string::npos) << rest;
    if (layer == "sectors") {
      EXPECT_NE(rest.find("Extent: (10.99"), std::string::npos) << rest;
    }
  }
}

TEST_F(CatalogueCommands, ViewsShowSeriesSequenceAndWhatIsCurrent) {
  ASSERT_EQ(add(make(3, "old")), 0) << err_.str();
  ASSERT_EQ(add(make(4, "new")), 0) << err_.str();
  EXPECT_EQ(sql("SELECT series, sequence, current FROM package_states ORDER BY sequence"), "village|3|0\nvillage|4|1");
  EXPECT_EQ(
      sql("SELECT count(*) FROM finest_tiles WHERE current = 1"),
      sql("SELECT count(*) FROM tiles t JOIN packages p ON p.id = t.package_id WHERE p.sequence = 4 AND t.z = 18"));
  EXPECT_EQ(sql("SELECT DISTINCT gsd_m || ' ' || valid_percent FROM finest_tiles"),
            sql("SELECT DISTINCT (gsd_mm / 1000.0) || ' ' || (valid_ppm / 10000.0) FROM tiles"));
  for (const char* view : {"package_states", "finest_tiles", "source_states"}) {
    const auto info = test::run_process({"ogrinfo", "-so", "-ro", file(), view});
    EXPECT_EQ(info.code, 0) << info.err;
    EXPECT_NE(info.out.find("Polygon"), std::string::npos) << view << info.out;
  }
}

// Judge: GDAL reads from the copy what SQLite reads from the catalogue.
TEST_F(CatalogueCommands, ExportedAsGeoPackageItHasTheSameRows) {
  ASSERT_EQ(add(make(3, "old")), 0) << err_.str();
  ASSERT_EQ(add(make(4, "new")), 0) << err_.str();
  ASSERT_EQ(run({"export", file(), "--format", "gpkg", "--out", path("fleet.gpkg")}), 0) << err_.str();
  for (const char* view : {"package_states", "finest_tiles", "source_states", "sector_states", "route_states",
                           "corridor_states", "gap_states"}) {
    const auto info = test::run_process({"ogrinfo", "-so", "-ro", path("fleet.gpkg"), view});
    ASSERT_EQ(info.code, 0) << info.err;
    EXPECT_NE(info.out.find("Feature Count: " + sql(std::string("SELECT count(*) FROM ") + view) + "\n"),
              std::string::npos)
        << info.out;
    EXPECT_NE(info.out.find("ID[\"EPSG\",4326]"), std::string::npos) << info.out;
  }
  const auto values = test::run_process(
      {"sqlite3", path("fleet.gpkg"), "SELECT series, sequence, current FROM package_states ORDER BY sequence"});
  EXPECT_EQ(values.out, "village|3|0\nvillage|4|1\n");
  EXPECT_EQ(run({"export", file(), "--format", "gpkg", "--out", path("fleet.gpkg")}), 2) << "it is there";
  EXPECT_EQ(run({"export", path("none.sqlite"), "--format", "gpkg", "--out", path("none.gpkg")}), 2);
  EXPECT_FALSE(fs::exists(path("none.gpkg")) || fs::exists(path("none.sqlite")));
}

// As GeoParquet where this GDAL can; else it says what is missing, and leaves nothing.
TEST_F(CatalogueCommands, ExportedAsGeoParquetOrRefused) {
  ASSERT_EQ(add(make(3, "package")), 0) << err_.str();
  const bool can = test::run_shell("ogrinfo --formats | grep -q 'Parquet -vector'").code == 0;
  EXPECT_EQ(run({"export", file(), "--format", "parquet", "--out", path("fleet")}), can ? 0 : 2);
  EXPECT_EQ(fs::exists(path("fleet")), can);
  if (can) {
    const auto info = test::run_process({"ogrinfo", "-so", "-ro", "-al", path("fleet/source_states.parquet")});
    EXPECT_NE(info.out.find("Feature Count: 1\n"), std::string::npos) << info.out << info.err;
  } else {
    EXPECT_NE(err_.str().find("built with Apache Arrow"), std::string::npos) << err_.str();
    EXPECT_NE(err_.str().find("ogr2ogr -f Parquet"), std::string::npos) << err_.str();
  }
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_EQ(entry.path().string().find("staging"), std::string::npos) << entry.path();
  }
}

TEST_F(CatalogueCommands, SpatialiteRunsSpatialQueries) {
  ASSERT_EQ(add(make(3, "package")), 0) << err_.str();
  EXPECT_EQ(sql("PRAGMA integrity_check"), "ok");
  EXPECT_EQ(spatial("SELECT CheckSpatialMetaData()"), "3") << "the current layout of SpatiaLite";
  for (const char* table :
       {"packages", "sources", "sectors", "routes", "corridors", "required_tiles", "tiles", "gaps"}) {
    EXPECT_EQ(spatial("SELECT CheckSpatialIndex('" + std::string(table) + "', 'geom')"), "1") << table;
    EXPECT_EQ(
        spatial("SELECT count(*) FROM " + std::string(table) + " WHERE NOT ST_IsValid(geom) OR ST_SRID(geom) <> 4326"),
        "0")
        << table;
  }
  // The tiles around the take-off point, through the index; the corridor's area; every needed place on imagery.
  EXPECT_EQ(spatial("SELECT count(*) FROM tiles WHERE z = 18 AND ST_Contains(geom, MakePoint(11.0001, 48.0001, 4326))"
                    " AND ROWID IN (SELECT ROWID FROM SpatialIndex WHERE f_table_name = 'tiles' AND"
                    " search_frame = MakePoint(11.0001, 48.0001, 4326))"),
            "1");
  const double corridor = std::stod(spatial("SELECT ST_Area(geom, 1) FROM corridors"));
  EXPECT_NEAR(corridor, 303.6 * 80 + M_PI * 40 * 40, 0.01 * corridor);
  EXPECT_EQ(spatial("SELECT ST_Covers(s.geom, p.geom) FROM sources s, packages p"), "1");
  EXPECT_EQ(
      sql("SELECT captured_at || ' ' || provider || ' ' || gsd_mm || ' ' || ce90_mm || ' ' || trust FROM sources"),
      "2024-04-01T00:00:00Z test 300 4000 service");
}

TEST_F(CatalogueCommands, FootprintsHaveHoles) {
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) {
    Bytes mask(256 * 256, 255);
    for (std::size_t row = 100; row < 120; ++row)
      std::fill_n(mask.begin() + static_cast<std::ptrdiff_t>(row * 256 + 50), 30, 0);
    if (sidecar.key.z != 18) return true;
    sidecar.valid_ppm = kWholeTile_ppm * (65536 - 600) / 65536;
    sidecar.mask = encode_tile_mask(mask);
    return true;
  };
  ASSERT_EQ(add(make(3, "package")), 0) << out_.str() << err_.str();
  EXPECT_EQ(spatial("SELECT ST_IsValid(geom) FROM sources"), "1");
  const std::string tiles = sql("SELECT count(*) FROM tiles WHERE z = 18");
  EXPECT_EQ(spatial("SELECT ST_NumGeometries(geom), ST_NumInteriorRing(ST_GeometryN(geom, 1)) FROM sources"),
            "1|" + tiles);
  EXPECT_NE(sql("SELECT count(*) FROM gaps WHERE reason = 'empty pixels' AND z = 18 AND package_id = 1"), "0");
}

TEST_F(CatalogueCommands, AddingTwiceChangesNothing) {
  const fs::path package = make(3, "package");
  ASSERT_EQ(add(package), 0) << err_.str();
  // GDAL records reading the statistics in SpatiaLite's history; nothing else may differ.
  const auto content = [this] {
    return test::run_shell("sqlite3 '" + file() + "' .dump | grep -v UpdateLayerStatistics").out;
  };
  const std::string before = content();
  EXPECT_GT(before.size(), 1000U);
  EXPECT_EQ(add(package), 0);
  EXPECT_NE(out_.str().find("already"), std::string::npos);
  EXPECT_TRUE(content() == before);
  // Another sequence of the series stands beside it; another package of the same name does not.
  EXPECT_EQ(add(make(4, "newer")), 0);
  EXPECT_EQ(sql("SELECT group_concat(sequence) FROM packages"), "3,4");
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) { return sidecar.gsd_mm = 400, true; };
  EXPECT_EQ(add(make(4, "other")), 1);
  EXPECT_NE(out_.str().find("catalogue.conflict"), std::string::npos) << out_.str();
  EXPECT_EQ(sql("SELECT count(*) FROM sources WHERE gsd_mm = 400"), "0");
  ASSERT_EQ(run({"list", file(), "--json"}), 0);
  const json list = json::parse(out_.str())["packages"];
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0]["state"], "superseded");
  EXPECT_EQ(list[1]["state"], "current");
  EXPECT_EQ(list[1]["sources"][0]["provider"], "test");
  ASSERT_EQ(run({"list", file(), "--at", "2025-01-01"}), 0);
  EXPECT_NE(out_.str().find("village 4  expired"), std::string::npos) << out_.str();
}

TEST_F(CatalogueCommands, RemovingDeletesAllRows) {
  ASSERT_EQ(add(make(3, "package")), 0);
  ASSERT_EQ(add(make(4, "newer")), 0);
  EXPECT_EQ(run({"remove", "village", "3", "--from", file()}), 0) << err_.str();
  EXPECT_EQ(sql("SELECT group_concat(sequence) FROM packages"), "4");
  for (const char* table : {"sources", "sectors", "routes", "corridors", "required_tiles", "tiles"}) {
    EXPECT_EQ(sql("SELECT count(DISTINCT package_id) FROM " + std::string(table)), "1") << table;
    EXPECT_EQ(spatial("SELECT CheckSpatialIndex('" + std::string(table) + "', 'geom')"), "1") << table;
  }
  EXPECT_EQ(run({"remove", "village", "3", "--from", file()}), 2);
  EXPECT_NE(err_.str().find("village 3"), std::string::npos);
  EXPECT_EQ(run({"remove", "village", "3", "--from", path("none.sqlite")}), 2);
  EXPECT_FALSE(fs::exists(path("none.sqlite")));
}

TEST_F(CatalogueCommands, GapsAreTheAreaWithoutFreshImagery) {
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) { return sidecar.gsd_mm = 480, true; };
  ASSERT_EQ(add(make(3, "package")), 0);
  folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 9"}, {"series: village", "series: next"}}));
  EXPECT_EQ(run({"gaps", file(), "--mission", path("next.yaml")}), 0) << out_.str() << err_.str();
  EXPECT_TRUE(json::parse(out_.str())["features"].empty());

  // The corridor is active (90 days), the sector stable (730).
  const auto gaps = [&](const std::vector<std::string>& more) {
    std::vector<std::string> args{"gaps", file(), "--mission", path("next.yaml")};
    args.insert(args.end(), more.begin(), more.end());
    EXPECT_EQ(run(args), 1) << out_.str() << err_.str();
    return json::parse(out_.str())["features"];
  };
  const json later = gaps({"--at", "2024-08-01"});
  double area_m2 = 0;
  for (const json& gap : later) {
    EXPECT_EQ(gap["properties"]["reason"], "stale imagery");
    EXPECT_TRUE(gap["properties"]["sector"].is_null()) << gap;
    area_m2 += gap["properties"]["area_m2"].get<double>();
  }
  EXPECT_GT(area_m2, 5000) << "the corridor's end that sticks out of the sector";
  EXPECT_LT(area_m2, 303.6 * 80);

  folder_.write("next.yaml", test::mission_yaml({{"min_resolution_m: 0.5", "min_resolution_m: 0.45"}}));
  for (const json& gap : gaps({})) EXPECT_EQ(gap["properties"]["reason"], "coarse imagery");
  // Elsewhere there is nothing at all.
  std::string moved = test::mission_yaml();
  for (std::size_t at = moved.find("48.0"); at != std::string::npos; at = moved.find("48.0", at))
    moved.replace(at, 2, "49");
  for (std::size_t at = moved.find("47.9990"); at != std::string::npos; at = moved.find("47.9990", at))
    moved.replace(at, 2, "48");
  folder_.write("next.yaml", moved);
  for (const json& gap : gaps({"--store"})) EXPECT_EQ(gap["properties"]["reason"], "no imagery");
  const std::string stored = sql("SELECT count(*) FROM gaps WHERE package_id IS NULL AND mission = 'village-a'");
  EXPECT_GT(std::stoi(stored), 4);
  EXPECT_EQ(spatial("SELECT count(*) FROM gaps WHERE NOT ST_IsValid(geom)"), "0");
  gaps({"--store"});
  EXPECT_EQ(sql("SELECT count(*) FROM gaps"), stored) << "stored gaps replace those before";
}

// The database is a file that others may have written.
TEST_F(CatalogueCommands, AForgedProviderStaysOnItsLine) {
  ASSERT_EQ(add(make(3, "package")), 0) << err_.str();
  ASSERT_EQ(run({"list", file()}), 0);
  const std::string unforged = out_.str();
  sql("UPDATE sources SET provider = 'x' || char(10) || 'village 9  current  mission village-a'");
  ASSERT_EQ(run({"list", file()}), 0);
  const std::string forged = out_.str();
  EXPECT_EQ(std::count(forged.begin(), forged.end(), '\n'), std::count(unforged.begin(), unforged.end(), '\n'));
  EXPECT_NE(out_.str().find("x⏎village 9"), std::string::npos) << out_.str();
}

TEST_F(CatalogueCommands, ContentIsNeverExecuted) {
  const std::string name = "x'); DROP TABLE tiles; --\x1b[31m \xff\" OR 1=1";
  maker_.edit_tile = [&name](Sidecar& sidecar, Bytes&) { return sidecar.source = name, true; };
  ASSERT_EQ(add(make(3, "odd '; DROP TABLE packages; --")), 0) << out_.str() << err_.str();
  EXPECT_EQ(sql("SELECT provider FROM sources"), "x'); DROP TABLE tiles; --?[31m ?\" OR 1=1");
  EXPECT_NE(sql("SELECT count(*) FROM tiles"), "0");
  EXPECT_EQ(run({"list", file()}), 0);
  EXPECT_EQ(out_.str().find('\x1b'), std::string::npos);
  EXPECT_EQ(run({"remove", "village' OR '1'='1", "3", "--from", file()}), 2);
  EXPECT_EQ(sql("SELECT count(*) FROM packages"), "1");
}

TEST_F(CatalogueCommands, VerifiesOnRequest) {
  write_file_atomic(path("root.json"), sign_root(maker_.root, {&maker_.signer}).json());
  const fs::path package = make(3, "package");
  ASSERT_EQ(run({"add", package.string(), "--to", file(), "--trust", path("root.json")}), 0)
      << out_.str() << err_.str();
  EXPECT_EQ(sql("SELECT signers FROM packages"), maker_.signer.public_key().id());
  const fs::path forged = make(4, "forged");
  maker_.signer = PrivateKey::generate();
  maker_.sign(forged);
  EXPECT_EQ(run({"add", forged.string(), "--to", file(), "--trust", path("root.json")}), 1) << out_.str();
  EXPECT_EQ(sql("SELECT count(*) FROM packages"), "1");
}

TEST_F(CatalogueCommands, DamagedPackagesAreNotAdded) {
  const fs::path package = make(3, "package");
  test::sqlite(package / kImageryFile, "UPDATE nadir_sidecars SET gsd_mm = 1 WHERE zoom_level = 18");
  EXPECT_EQ(add(package), 1) << out_.str();
  const fs::path other = make(4, "other");
  write_file_atomic(other / kMissionFile, test::mission_yaml());
  EXPECT_EQ(add(other), 1);
  EXPECT_NE(out_.str().find("artifact.hash"), std::string::npos) << out_.str();
  EXPECT_FALSE(fs::exists(file())) << "no catalogue is created for a rejected package";
  EXPECT_EQ(add(folder_ / "none"), 2);
  folder_.write("half/manifest.json", "{");
  EXPECT_EQ(add(folder_ / "half"), 1);
}

TEST_F(CatalogueCommands, WritesOnlyToCatalogues) {
  const fs::path package = make(3, "package");
  const std::string tiles = (package / kImageryFile).string();
  const Sha256 before = sha256_file(tiles);
  EXPECT_EQ(run({"add", package.string(), "--to", tiles}), 2);
  EXPECT_EQ(sha256_file(tiles), before) << err_.str();
  folder_.write("text.sqlite", "no database at all, but longer than a header of SQLite would be");
  folder_.write("empty.sqlite", "");
  for (const char* name : {"text.sqlite", "empty.sqlite"}) {
    EXPECT_EQ(run({"add", package.string(), "--to", path(name)}), 2);
    EXPECT_NE(err_.str().find(name), std::string::npos) << err_.str();
    EXPECT_EQ(run({"list", path(name)}), 2);
  }
  EXPECT_EQ(run({"add", package.string(), "--to", path("no/such/folder.sqlite")}), 2);
  EXPECT_EQ(run({"add", package.string(), "--to", folder_.path().string()}), 2);
  EXPECT_EQ(run({"list", path("none.sqlite")}), 2);
  // Cut off and overwritten files are errors, whatever is hit.
  ASSERT_EQ(add(package), 0) << err_.str();
  const Bytes whole = read_file(file());
  for (const std::size_t part : {1U, 2U, 3U, 5U, 7U}) {
    Bytes damaged(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() * part / 8));
    for (std::size_t i = damaged.size() / 2; i < damaged.size() / 2 + 4096; ++i) damaged[i] = 0xa5;
    write_file_atomic(path("damaged.sqlite"), damaged);
    EXPECT_NE(run({"list", path("damaged.sqlite")}), 1);
    EXPECT_NE(run({"add", package.string(), "--to", path("damaged.sqlite")}), 1);
  }
}

}  // namespace
}  // namespace nadir
