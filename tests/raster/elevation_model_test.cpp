// Heights at single places: of a raster in metres of another grid, exact at its posts and bilinear between them.
#include "raster/elevation_model.hpp"

#include <gdal_priv.h>
#include <gtest/gtest.h>

#include <cmath>

#include "base/error.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr double kWest = 8.5, kNorth = 47.5, kStep = 0.001;

class Elevation : public ::testing::Test {
 protected:
  // Heights of 10 · column + row at the centres of pixels of a thousandth of a degree.
  std::filesystem::path model(const char* unit = "", double nodata_at = -1) {
    GDALAllRegister();
    const auto path = folder_ / "dem.tif";
    auto* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
    auto* dataset = driver->Create(path.c_str(), 20, 10, 1, GDT_Float32, nullptr);
    double transform[] = {kWest, kStep, 0, kNorth, 0, -kStep};
    dataset->SetGeoTransform(transform);
    OGRSpatialReference system;
    system.importFromEPSG(4326);
    dataset->SetSpatialRef(&system);
    auto* band = dataset->GetRasterBand(1);
    band->SetNoDataValue(-9999);
    band->SetUnitType(unit);
    for (int row = 0; row < 10; ++row) {
      float values[20];
      for (int column = 0; column < 20; ++column) {
        values[column] = column == nodata_at ? -9999.0F : static_cast<float>(10 * column + row);
      }
      EXPECT_EQ(band->RasterIO(GF_Write, 0, row, 20, 1, values, 20, 1, GDT_Float32, 0, 0, nullptr), CE_None);
    }
    GDALClose(dataset);
    return path;
  }
  static LonLat at(double column, double row) { return {kWest + (column + 0.5) * kStep, kNorth - (row + 0.5) * kStep}; }
  test::TemporaryFolder folder_;
};

TEST_F(Elevation, BilinearBetweenThePosts) {
  const ElevationModel model_of_ground(model());
  EXPECT_NEAR(*model_of_ground.height_m(at(3, 4)), 34, 1e-3);
  EXPECT_NEAR(*model_of_ground.height_m(at(3.25, 4.5)), 37, 1e-3);
  EXPECT_NEAR(*model_of_ground.height_m(at(19.4, 9)), 199, 1e-3);  // the nearest one's at the edge
  EXPECT_NEAR(*model_of_ground.height_m(at(-0.4, 0)), 0, 1e-3);
  EXPECT_FALSE(model_of_ground.height_m(at(20, 4)));
  EXPECT_FALSE(model_of_ground.height_m({100, 0}));
  EXPECT_FALSE(model_of_ground.height_m({std::nan(""), 47}));
}

TEST_F(Elevation, UnknownHeightsAreUnknown) {
  const ElevationModel model_of_ground(model("m", 5));
  EXPECT_TRUE(model_of_ground.height_m(at(3.9, 2)));
  EXPECT_FALSE(model_of_ground.height_m(at(4.1, 2)));
  EXPECT_FALSE(model_of_ground.height_m(at(5, 2)));
}

TEST_F(Elevation, FeetAndPicturesAreRefused) {
  EXPECT_THROW(ElevationModel(model("ft")), UsageError);
  EXPECT_THROW(ElevationModel(folder_ / "absent.tif"), Error);
  EXPECT_THROW(ElevationModel(folder_.write("text.tif", "no raster")), Error);
}

}  // namespace
}  // namespace nadir
