#include "raster/imagery_input.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "raster/test_raster.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

TEST(ImageryFacts, AreReadFromTheStacItem) {
  const test::TemporaryFolder folder;
  test::write_item(folder / "map.tif", "2024-03-01T00:00:00Z", 0.25, "survey of 2024");
  const ImageryFacts facts = read_imagery_facts(folder / "map.tif", {});
  EXPECT_EQ(to_rfc3339(facts.captured_at), "2024-03-01T00:00:00Z");
  EXPECT_EQ(facts.gsd_m, 0.25);
  EXPECT_EQ(facts.ce90_m, 5);
  EXPECT_EQ(facts.provider, "survey of 2024");
}

TEST(ImageryFacts, OverridesTakePrecedence) {
  const test::TemporaryFolder folder;
  test::write_item(folder / "map.tif");
  const ImageryOverrides all{parse_utc("2020-01-02"), 1.5, 9.0, "me"};
  for (const auto& raster : {folder / "map.tif", folder / "without.tif"}) {
    const ImageryFacts facts = read_imagery_facts(raster, all);
    EXPECT_EQ(to_rfc3339(facts.captured_at), "2020-01-02T00:00:00Z");
    EXPECT_EQ(facts.gsd_m, 1.5);
    EXPECT_EQ(facts.ce90_m, 9.0);
    EXPECT_EQ(facts.provider, "me");
  }
}

TEST(ImageryFacts, LicenceAndAttributionAreStatedByTheItemOrTheUserOrNobody) {
  const test::TemporaryFolder folder;
  const auto item = [&](const std::string& more) {
    folder.write(
        "map.json",
        R"({"type":"Feature","properties":{"datetime":"2024-01-01T00:00:00Z","gsd":1,"providers":[{"name":"a"}],)"
        R"("nadir:ce90_m":5)" +
            more + "}}");
    return read_imagery_facts(folder / "map.tif", {});
  };
  EXPECT_EQ(item("").licence, "");
  EXPECT_EQ(item(R"(,"license":"CC-BY-4.0")").licence, "CC-BY-4.0");
  EXPECT_EQ(item(R"(,"license":"CC-BY-4.0")").attribution, "");
  EXPECT_EQ(item(R"(,"license":"CC-BY-4.0","attribution":"© a 2024")").attribution, "© a 2024");
  ImageryOverrides stated;
  stated.licence = kUnknownLicence;
  stated.attribution = "ask b";
  const ImageryFacts facts = read_imagery_facts(folder / "map.tif", stated);
  EXPECT_EQ(facts.licence, "unknown");
  EXPECT_EQ(facts.attribution, "ask b");
  EXPECT_THROW(item(R"(,"license":4)"), UsageError);
  EXPECT_THROW(item(R"(,"license":")" + std::string(65, 'x') + '"'), UsageError);
  stated.attribution = std::string(201, 'x');
  EXPECT_THROW(read_imagery_facts(folder / "map.tif", stated), UsageError);
}

TEST(ImageryInputs, SourcesOfTilesHaveTheirLicences) {
  const auto input = [](const std::string& provider, const std::string& licence, const std::string& attribution) {
    ImageryInput one;
    one.path = provider + ".tif";
    one.facts.provider = provider;
    one.facts.licence = licence;
    one.facts.attribution = attribution;
    return one;
  };
  const std::vector<ImageryInput> inputs{input("b", "CC-BY-4.0", "© b"), input("a", kUnknownLicence.data(), ""),
                                         input("silent", "", ""), input("unused", "MIT", ""),
                                         input("c + d", "ODbL-1.0", "")};
  std::vector<Sidecar> tiles(3);
  tiles[0].source = "b + a";
  tiles[1].source = "silent";
  tiles[2].source = "c + d + old";
  const std::vector<SourceLicence> old{{"gone", "MIT", ""}, {"old", "CC0-1.0", "© old"}};
  const std::vector<SourceLicence> expected{{"a", "unknown", ""},
                                            {"b", "CC-BY-4.0", "© b"},
                                            {"c", "ODbL-1.0", ""},
                                            {"d", "ODbL-1.0", ""},
                                            {"old", "CC0-1.0", "© old"}};
  EXPECT_EQ(stated_sources(tiles, inputs, old), expected);
  const Findings findings = check_stated_licences(inputs);
  ASSERT_EQ(findings.items().size(), 1U);
  EXPECT_EQ(findings.items()[0].code, "licence.unstated");
  EXPECT_EQ(findings.items()[0].where, "silent.tif");
  EXPECT_FALSE(findings.has_errors());
}

void expect_refused(const std::filesystem::path& raster, const std::string& words) {
  try {
    static_cast<void>(read_imagery_facts(raster, {}));
    FAIL() << "no error, expected " << words;
  } catch (const UsageError& error) {
    EXPECT_THAT(std::string(error.what()), testing::HasSubstr(words));
  }
}

TEST(ImageryFacts, MissingFactsAreErrors) {
  const test::TemporaryFolder folder;
  expect_refused(folder / "map.tif", "--captured");
  const auto item = [&](const std::string& properties) {
    folder.write("map.json", R"({"type":"Feature","properties":)" + properties + "}");
  };
  item(R"({"gsd":1,"providers":[{"name":"a"}],"nadir:ce90_m":5})");
  expect_refused(folder / "map.tif", "--captured");
  item(R"({"datetime":"2024-01-01T00:00:00Z","providers":[{"name":"a"}],"nadir:ce90_m":5})");
  expect_refused(folder / "map.tif", "--gsd-m");
  item(R"({"datetime":"2024-01-01T00:00:00Z","gsd":1,"nadir:ce90_m":5})");
  expect_refused(folder / "map.tif", "--provider");
  item(R"({"datetime":"2024-01-01T00:00:00Z","gsd":1,"providers":[{"name":"a"}]})");
  expect_refused(folder / "map.tif", "--ce90-m");
  item(R"({"datetime":"in March","gsd":1,"providers":[{"name":"a"}],"nadir:ce90_m":5})");
  expect_refused(folder / "map.tif", "in March");
  item(R"({"datetime":"2024-01-01T00:00:00Z","gsd":-1,"providers":[{"name":"a"}],"nadir:ce90_m":5})");
  expect_refused(folder / "map.tif", "gsd");
  item(R"({"datetime":"2024-01-01T00:00:00Z","gsd":"fine","providers":[{"name":"a"}],"nadir:ce90_m":5})");
  expect_refused(folder / "map.tif", "gsd");
  item("[]");
  expect_refused(folder / "map.tif", "STAC");
  folder.write("map.json", "{");
  EXPECT_THROW(read_imagery_facts(folder / "map.tif", {}), Error);
}

}  // namespace
}  // namespace nadir
