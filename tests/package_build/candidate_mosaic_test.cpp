#include "package_build/candidate_mosaic.hpp"

#include <gdal_priv.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/web_mercator.hpp"
#include "ortho/sample_candidates.hpp"
#include "raster/gdal_dataset.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr TileKey kFirst{19, 278'000, 182'000};

class CandidateMosaicFile : public ::testing::Test {
 protected:
  // Three of four tiles of a square.
  std::filesystem::path candidates() const {
    CandidateStore store(folder_ / "candidates");
    for (const auto& [dx, dy] : {std::pair{0U, 0U}, {1U, 0U}, {0U, 1U}}) {
      store.put(std::vector{test::sample_candidate(key_, {19, kFirst.x + dx, kFirst.y + dy}, static_cast<int>(dx))});
    }
    store.close();
    return folder_ / "candidates";
  }
  test::TemporaryFolder folder_;
  PrivateKey key_ = PrivateKey::generate();
  NoProgress progress_;
};

TEST_F(CandidateMosaicFile, IsAGeoreferencedCogOfTheTiles) {
  const CandidateMosaic mosaic = write_candidate_mosaic(candidates(), folder_ / "mosaic.tif", progress_);
  EXPECT_EQ(mosaic.zoom, 19);
  EXPECT_EQ(mosaic.tiles, 3U);
  EXPECT_EQ(mosaic.width, 512);
  const auto info = test::run_process({"gdalinfo", "-json", folder_ / "mosaic.tif"});
  ASSERT_EQ(info.code, 0) << info.err;
  const auto document = nlohmann::json::parse(info.out);
  EXPECT_EQ(document["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"], "COG");
  EXPECT_NE(document["coordinateSystem"]["wkt"].get<std::string>().find("\"EPSG\",3857"), std::string::npos);
  const LonLatBox box = bounds_of(kFirst);
  const MercatorXY corner = mercator_from_lonlat({box.west_deg, box.north_deg});
  EXPECT_NEAR(document["geoTransform"][0].get<double>(), corner.x_m, 1e-3);
  EXPECT_NEAR(document["geoTransform"][3].get<double>(), corner.y_m, 1e-3);
  EXPECT_NEAR(document["geoTransform"][1].get<double>(), mercator_pixel_m(19), 1e-9);

  const GdalDataset file(folder_ / "mosaic.tif");
  const MaskedImage image = file.read({0, 0, 512, 512}, {512, 512});
  EXPECT_EQ(cv::countNonZero(image.mask), 3 * 256 * 256);
  EXPECT_EQ(cv::countNonZero(image.mask(cv::Rect(256, 256, 256, 256))), 0);
  const cv::Mat second = decode_image(test::sample_candidate(key_, kFirst, 1).tile, Colour::bgr, "tile").image;
  EXPECT_LT(cv::norm(image.bgr(cv::Rect(256, 0, 256, 256)), second, cv::NORM_L1) / (256 * 256 * 3), 6) << "JPEG twice";
}

TEST_F(CandidateMosaicFile, ALargeFlightIsWrittenAtACoarserZoom) {
  const CandidateMosaic mosaic = write_candidate_mosaic(candidates(), folder_ / "mosaic.tif", progress_, 128 * 128);
  EXPECT_EQ(mosaic.zoom, 17);
  EXPECT_EQ(mosaic.width, 128);
  EXPECT_THROW(write_candidate_mosaic(folder_ / "candidates", folder_ / "none.tif", progress_, 4), UsageError);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none.tif"));
}

TEST_F(CandidateMosaicFile, IsReproducibleAndReplacedAtomically) {
  folder_.write("mosaic.tif", "an older one");
  write_candidate_mosaic(candidates(), folder_ / "mosaic.tif", progress_);
  write_candidate_mosaic(folder_ / "candidates", folder_ / "again.tif", progress_);
  EXPECT_EQ(read_file(folder_ / "mosaic.tif"), read_file(folder_ / "again.tif"));
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) files += entry.exists();
  EXPECT_EQ(files, 3U) << "nothing is left beside them";
}

TEST_F(CandidateMosaicFile, WithoutTilesItIsAnError) {
  CandidateStore(folder_ / "empty").close();
  EXPECT_THROW(write_candidate_mosaic(folder_ / "empty", folder_ / "mosaic.tif", progress_), Error);
  EXPECT_THROW(write_candidate_mosaic(folder_ / "missing", folder_ / "mosaic.tif", progress_), Error);
  EXPECT_THROW(write_candidate_mosaic(candidates(), folder_ / "no-such-folder" / "mosaic.tif", progress_), Error);
}

}  // namespace
}  // namespace nadir
