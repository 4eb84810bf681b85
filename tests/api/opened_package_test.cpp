#include "api/opened_package.hpp"

#include <gmock/gmock.h>

#include <fstream>

#include "api/api_fixture.hpp"
#include "base/files.hpp"
#include "base/progress.hpp"
#include "package/package_maker.hpp"
#include "package/vector_layer.hpp"

namespace nadir {
namespace {

class OpenedForTheApi : public test::ApiFixture {
 protected:
  Opening open(const std::filesystem::path& package) {
    NoProgress progress;
    return open_package(package, maker_.options(), progress);
  }
  test::TemporaryFolder folder_;
  test::PackageMaker maker_;
};

TEST_F(OpenedForTheApi, ShowsItsMetadataAndServesItsTiles) {
  const auto folder = maker_.make(folder_);
  Opening opening = open(folder);
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  const std::shared_ptr<const OpenPackage> package = std::move(opening.package);
  const PackageView view = package_view(*package);
  EXPECT_TRUE(view.accepted);
  EXPECT_EQ(view.series, "village");
  EXPECT_EQ(view.tiles, package->imagery().sidecars().size());
  EXPECT_EQ(view.route.size(), package->mission().route.points.size());
  ASSERT_TRUE(view.bounds);
  const TileKey first = package->imagery().sidecars().front().key;
  const LonLatBox tile = bounds_of(first);
  EXPECT_TRUE(view.bounds->west_deg < tile.east_deg && view.bounds->east_deg > tile.west_deg);

  api.use_package(package_for_api(package));
  const ApiResponse served = api.handle(get("/v1/tiles/" + to_text(first)));
  EXPECT_EQ(served.status, 200);
  EXPECT_EQ(sha256(as_bytes(served.body)), package->imagery().sidecars().front().sha256);
}

TEST_F(OpenedForTheApi, ServesItsVectorsAsTheyWereSigned) {
  EXPECT_EQ(api.handle(get("/v1/vectors")).status, 204) << "there is no package";
  const std::string text =
      vectors_geojson({"us", "MIT", {{VectorClass::road, "track", false, {{{11, 48}, {11.001, 48}}}}}});
  maker_.edit_manifest = [&](Manifest& manifest) {
    const auto package = folder_ / "package";
    std::filesystem::create_directories(package / "vectors");
    write_file_atomic(package / kVectorsFile, text);
    manifest.artifacts.push_back(describe_file(package, kVectorsFile, kRoleVectors));
    manifest.artifacts.back().vectors = VectorFacts{"us", "MIT", sha256(as_bytes("source")), 1, 0, 0, 0};
  };
  const auto folder = maker_.make(folder_);
  Opening opening = open(folder);
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  api.use_package(package_for_api(std::shared_ptr<const OpenPackage>(std::move(opening.package))));
  const ApiResponse served = api.handle(get("/v1/vectors"));
  EXPECT_EQ(served.status, 200);
  EXPECT_EQ(served.content_type, "application/geo+json");
  EXPECT_EQ(served.body, text);

  // Spoilt after the package was opened: the map is shown without them. Before that the package is refused.
  std::string other = text;
  other.replace(other.find("track"), 5, "TRACK");
  {
    std::fstream file(folder / kVectorsFile, std::ios::in | std::ios::out);
    file.write(other.data(), static_cast<std::streamsize>(other.size()));
  }
  EXPECT_EQ(api.handle(get("/v1/vectors")).status, 204);
  const Opening again = open(folder);
  EXPECT_FALSE(again.package);
  EXPECT_TRUE(again.findings.contains("artifact.hash"));
}

// Only tiles with the signed digest are shown.
TEST_F(OpenedForTheApi, DoesNotServeATamperedTile) {
  const auto folder = maker_.make(folder_);
  test::sqlite(folder / kImageryFile, "UPDATE tiles SET tile_data = zeroblob(length(tile_data)) WHERE rowid = 1");
  Opening opening = open(folder);
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  const std::shared_ptr<const OpenPackage> package = std::move(opening.package);
  api.use_package(package_for_api(package));
  int shown = 0;
  for (const Sidecar& sidecar : package->imagery().sidecars()) {
    if (api.handle(get("/v1/tiles/" + to_text(sidecar.key))).status == 200) ++shown;
  }
  EXPECT_EQ(shown + 1, static_cast<int>(package->imagery().sidecars().size()));
}

TEST_F(OpenedForTheApi, ARejectedPackageStatesTheReason) {
  const auto folder = maker_.make(folder_);
  std::filesystem::remove(folder / kSignatureFile);
  const PackageView view = refused_package(open(folder).findings);
  EXPECT_FALSE(view.accepted);
  EXPECT_THAT(view.reason, ::testing::HasSubstr("signature.missing"));
}

}  // namespace
}  // namespace nadir
