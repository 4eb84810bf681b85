// The matchability map of a package, as a flight reads it: grids, classes, and files that are none. What the survey
// writes is read in tests/package_build.
#include "imagery/matchability_raster.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "base/error.hpp"

namespace nadir {
namespace {

MatchabilityCells four() {
  return {{1000, 2000}, 100, 2, 2, {MatchClass::good, MatchClass::weak, MatchClass::outside, MatchClass::poor}};
}

TEST(MatchabilityRaster, APlaceHasTheClassOfItsCellAndNoneBeyondTheGrid) {
  const MatchabilityRaster raster(four());
  const auto at = [&](double x, double y) { return raster.at(lonlat_from_mercator({x, y})); };
  EXPECT_EQ(at(1001, 1999), MatchClass::good);
  EXPECT_EQ(at(1199, 1901), MatchClass::weak);
  EXPECT_EQ(at(1099, 1899), MatchClass::outside);
  EXPECT_EQ(at(1199, 1801), MatchClass::poor);
  for (const auto& [x, y] : {std::pair{999.0, 1950.0}, {1201.0, 1950.0}, {1050.0, 2001.0}, {1050.0, 1799.0}}) {
    EXPECT_EQ(at(x, y), MatchClass::outside) << x << " " << y;
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(raster.at({nan, nan}), MatchClass::outside);
}

TEST(MatchabilityRaster, RejectsGridsThatAreNone) {
  const auto rejects = [](auto change) {
    MatchabilityCells cells = four();
    change(cells);
    EXPECT_THROW(MatchabilityRaster{cells}, Error);
  };
  rejects([](MatchabilityCells& c) { c.classes.pop_back(); });
  rejects([](MatchabilityCells& c) { c.columns = 0; });
  rejects([](MatchabilityCells& c) { c.columns = -2, c.rows = -2; });
  rejects([](MatchabilityCells& c) { c.side_m = 0; });
  rejects([](MatchabilityCells& c) { c.side_m = std::numeric_limits<double>::quiet_NaN(); });
  rejects([](MatchabilityCells& c) { c.north_west.x_m = 3e7; });
  rejects([](MatchabilityCells& c) { c.side_m = 1e8; });
}

TEST(MatchabilityRaster, RejectsBytesThatAreNoTiff) {
  EXPECT_THROW(parse_matchability_raster(Bytes{}, "empty"), Error);
  EXPECT_THROW(parse_matchability_raster(Bytes(1000, 0x49), "no tiff"), Error);
}

}  // namespace
}  // namespace nadir
