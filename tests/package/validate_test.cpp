#include "package/validate.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "imagery/codecs.hpp"
#include "imagery/mbtiles.hpp"
#include "package/mission_check.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

Bytes encoded(cv::Scalar colour, int type, ImageFormat format, int side = 256) {
  return encode_image(cv::Mat(side, side, type, colour), format);
}

class Validate : public ::testing::Test {
 protected:
  using Edit = std::function<bool(TileKey&, Bytes&)>;

  fs::path make(const std::string& name, const Edit& edit) {
    MbtilesWriter writer(folder_ / name);
    for (int zoom = mission_.zoom.min; zoom <= mission_.zoom.max; ++zoom) {
      for (TileKey key : required_tiles(mission_, zoom)) {
        Bytes tile = test::noise_tile(key.x * 1000 + key.y);
        if (edit(key, tile)) writer.add(key, tile);
      }
    }
    writer.set_metadata({{"name", name}, {"format", "jpg"}});
    writer.finish();
    return folder_ / name;
  }
  Validation validate(const fs::path& path) {
    NoProgress progress;
    return validate_tile_set(path, mission_, test::kJudged, progress);
  }
  Findings findings_of(const Edit& edit) {
    const fs::path path = make("t" + std::to_string(++files_) + ".mbtiles", edit);
    return validate(path).findings;
  }
  // Spoils the first tile of the finest zoom.
  Findings with_one_tile(const Bytes& spoilt) {
    return findings_of([&, n = 0](TileKey& key, Bytes& tile) mutable {
      if (key.z == mission_.zoom.max && n++ == 0) tile = spoilt;
      return true;
    });
  }

  test::TemporaryFolder folder_;
  Mission mission_ = parse_mission(test::mission_yaml(), "m.yaml").mission.value();
  int files_ = 0;
};

TEST_F(Validate, AcceptsACompleteSet) {
  const Validation result = validate(make("good.mbtiles", [](TileKey&, Bytes&) { return true; }));
  EXPECT_TRUE(result.findings.empty()) << test::codes(result.findings);
  EXPECT_FALSE(result.has_sidecars);
  EXPECT_GT(result.tiles, 10U);
}

TEST_F(Validate, CoverageGap) {
  const Findings findings = findings_of([n = 0](TileKey& key, Bytes&) mutable { return key.z != 18 || n++ % 3 != 0; });
  EXPECT_TRUE(findings.contains("coverage.gap"));
}

TEST_F(Validate, TileUndecodable) {
  EXPECT_TRUE(with_one_tile({1, 2, 3}).contains("tile.undecodable"));
  EXPECT_TRUE(with_one_tile({}).contains("tile.undecodable"));
  Bytes truncated = test::noise_tile(1);
  truncated.resize(truncated.size() / 2);
  const Findings findings = with_one_tile(truncated);
  EXPECT_TRUE(findings.contains("tile.undecodable"));
  EXPECT_TRUE(findings.contains("coverage.gap"));  // what cannot be shown covers nothing
}

TEST_F(Validate, TileSize) { EXPECT_TRUE(with_one_tile(test::noise_tile(1, 512)).contains("tile.size")); }

TEST_F(Validate, TileBlank) {
  for (const double value : {0.0, 255.0}) {
    const Findings findings = with_one_tile(encoded(cv::Scalar::all(value), CV_8UC3, ImageFormat::png));
    EXPECT_TRUE(findings.contains("tile.blank"));
    EXPECT_TRUE(findings.contains("coverage.gap"));
  }
  EXPECT_TRUE(with_one_tile(encoded({0, 0, 0, 0}, CV_8UC4, ImageFormat::png)).contains("coverage.gap"));
}

// A lake is blue throughout and still an image of the ground.
TEST_F(Validate, ASingleColourIsAWarning) {
  const Findings findings = with_one_tile(encoded({120, 60, 20}, CV_8UC3, ImageFormat::png));
  EXPECT_TRUE(findings.contains("tile.blank"));
  EXPECT_FALSE(findings.has_errors());
}

TEST_F(Validate, TransparentPixelsAreGaps) {
  cv::Mat image(256, 256, CV_8UC4);
  cv::randu(image, 0, 255);
  std::vector<cv::Mat> planes;
  cv::split(image, planes);
  planes[3].setTo(255);
  planes[3](cv::Rect(100, 100, 56, 56)).setTo(0);
  cv::merge(planes, image);
  // In every tile, so that some of it is surely needed.
  const Bytes tile = encode_image(image, ImageFormat::png);
  const Findings findings = findings_of([&](TileKey& key, Bytes& bytes) {
    if (key.z == 18) bytes = tile;
    return true;
  });
  EXPECT_TRUE(findings.contains("coverage.gap")) << test::codes(findings);
}

TEST_F(Validate, TileMisaddressedWhenRowsAreFlipped) {
  const Findings findings = findings_of([](TileKey& key, Bytes&) {
    key.y = key.tms_row();
    return true;
  });
  EXPECT_TRUE(findings.contains("tile.misaddressed")) << test::codes(findings);
}

TEST_F(Validate, TileMisaddressedOutsideTheGrid) {
  const fs::path path = make("outside.mbtiles", [](TileKey&, Bytes&) { return true; });
  test::sqlite(path, "INSERT INTO tiles VALUES (3, 8, 0, x'00'), (99, 0, 0, x'00'), (3, -1, 0, x'00')");
  EXPECT_TRUE(validate(path).findings.contains("tile.misaddressed"));
}

TEST_F(Validate, TileMisaddressedWhenTwice) {
  const fs::path path = make("twice.mbtiles", [](TileKey&, Bytes&) { return true; });
  test::sqlite(path, "DROP INDEX tile_index; INSERT INTO tiles SELECT * FROM tiles LIMIT 1");
  EXPECT_TRUE(validate(path).findings.contains("tile.misaddressed"));
}

TEST_F(Validate, BudgetExceeded) {
  mission_.budget_mb = 1;
  const Findings findings = findings_of([](TileKey&, Bytes& tile) {
    tile.resize(tile.size() + 100'000, 0);  // after the end of the image
    return true;
  });
  EXPECT_TRUE(findings.contains("budget.exceeded")) << test::codes(findings);
}

TEST_F(Validate, SqliteCorruptEndsTheIterationNotTheValidation) {
  const fs::path path = make("damaged.mbtiles", [](TileKey&, Bytes&) { return true; });
  fs::resize_file(path, fs::file_size(path) / 2);
  const Findings findings = validate(path).findings;
  EXPECT_TRUE(findings.contains("sqlite.corrupt") || findings.contains("tile.undecodable")) << test::codes(findings);
  EXPECT_TRUE(findings.contains("coverage.gap"));
}

TEST_F(Validate, EmptySetIsAGap) {
  EXPECT_TRUE(findings_of([](TileKey&, Bytes&) { return false; }).contains("coverage.gap"));
}

TEST_F(Validate, ThrowsForOtherFiles) {
  EXPECT_THROW(validate(folder_ / "none.mbtiles"), Error);
  EXPECT_THROW(validate(folder_.write("text.mbtiles", "not a database")), Error);
  EXPECT_THROW(validate(folder_.path()), Error);
  test::sqlite(folder_ / "other.db", "CREATE TABLE t (a)");
  EXPECT_THROW(validate(folder_ / "other.db"), Error);
}

TEST_F(Validate, UsesSidecars) {
  test::PackageMaker maker;
  maker.edit_tile = [](Sidecar& sidecar, Bytes&) {
    sidecar.captured_at = parse_utc("2020-01-01").value();
    return true;
  };
  const fs::path package = maker.make(folder_);
  const Validation result = validate(package / kImageryFile);
  EXPECT_TRUE(result.has_sidecars);
  EXPECT_TRUE(result.findings.contains("freshness.stale"));
}

}  // namespace
}  // namespace nadir
