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
