// Tiles that lie elsewhere than they say, as the base package's map shows it and as other flights do; and those that
// are nearly as far off and pass. The map's ground is that of the flights, seen by another sensor on another day.
#include <gtest/gtest.h>

#include "candidates/service_fixture.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "package/mission_check.hpp"
#include "package/manifest.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kMapCe90_mm = 4'000;  // a sigma of 1.86 m

class Misaligned : public test::ServiceFixture {
 protected:
  void SetUp() override {
    ServiceFixture::SetUp();
    test::PackageMaker maker;
    const test::FlightMaker satellite({.noise = 77});
    maker.edit_tile = [&](Sidecar& sidecar, Bytes& tile) {
      tile = encode_image(satellite.picture(sidecar.key), ImageFormat::jpeg, 75);
      sidecar.ce90_mm = kMapCe90_mm;
      return true;
    };
    const auto package = maker.make(folder_);
    options_.packages = {package};
    manifest_ = sha256_file(package / kManifestFile);
    key_ = required_tiles(parse_mission(maker.mission, "mission").mission.value(), 18).front();
    const LonLatBox box = bounds_of(key_);
    pixel_m_ = ground_resolution_m(key_.z, (box.south_deg + box.north_deg) / 2);
  }

  TileRow judged(double off_m, std::int64_t sigma_mm, std::uint64_t ground = 1) {
    test::FlightOptions& options = first_.options();
    options.off_px = off_m / pixel_m_, options.ground = ground;
    options.sigma_mm = sigma_mm, options.base_package = manifest_;
    return upload(first_, {first_.candidate(key_)}).front();
  }

  Sha256 manifest_;
  TileKey key_;
  double pixel_m_ = 0;
};

// 3 sigma of both: 3 · hypot(1.5, 1.86) = 7.2 m.
TEST_F(Misaligned, ATileDisplacedFromTheMapIsRejected) {
  const TileRow tile = judged(8, 1'500);
  EXPECT_EQ(test::code_of(tile), "misaligned");
  EXPECT_NE(tile.detail.find("off the base package's map; at most 717"), std::string::npos) << tile.detail;
}

TEST_F(Misaligned, ADisplacementJustBelowTheLimitIsAccepted) {
  const TileRow tile = judged(6.4, 1'500);
  EXPECT_EQ(tile.verdict, Verdict::accepted) << test::code_of(tile) << " " << tile.detail;
}

// 3 · hypot(0.3, 1.86) = 5.7 m: who says that he is sure is held to it.
TEST_F(Misaligned, AMoreCertainTileHasAStricterLimit) { EXPECT_EQ(test::code_of(judged(6.4, 300)), "misaligned"); }

// Other ground does not correlate: it has changed, or it is another place; the map cannot tell, other flights will.
TEST_F(Misaligned, ChangedGroundIsNotMisaligned) { EXPECT_EQ(judged(8, 1'500, 5).verdict, Verdict::accepted); }

TEST_F(Misaligned, WithoutAMapTileAlignmentIsUnknown) {
  key_.x += 40;
  EXPECT_EQ(judged(8, 1'500).verdict, Verdict::accepted);
}

// Between flights, 3 · hypot(1.5, 1.5) = 6.4 m: none is rejected, but only those that agree are promoted.
TEST_F(Misaligned, FlightsAgreeOnlyWithinTheAllowedDisplacement) {
  options_.packages.clear();
  const auto promoted = [this](double off_m, std::uint32_t row) {
    const auto keys = test::keys_in_a_row(1, row);
    second_.options().off_px = off_m / ground_resolution_m(18, 47.3);
    EXPECT_EQ(upload(first_, candidates(first_, keys), static_cast<int>(2 * row)).front().verdict, Verdict::accepted);
    EXPECT_EQ(upload(second_, candidates(second_, keys), static_cast<int>(2 * row + 1)).front().verdict,
              Verdict::accepted);
    return service().counts().promoted;
  };
  EXPECT_EQ(promoted(7.2, 1), 0);
  EXPECT_EQ(promoted(5.6, 2), 1);
}

}  // namespace
}  // namespace nadir
