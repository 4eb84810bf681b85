// Drawings that are damaged, or made to harm: each is refused with a reason, soon, and within bounded memory.
#include <gtest/gtest.h>
#include <zlib.h>

#include "base/files.hpp"
#include "mission_formats/gis_files.hpp"
#include "mission_formats/mission_files.hpp"
#include "mission_formats/sample_mission.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class HostileDrawings : public testing::Test {
 protected:
  std::string refusal(const std::string& name, const std::string& text) { return refusal(folder_.write(name, text)); }
  static std::string refusal(const std::filesystem::path& path) {
    try {
      read_mission_drawing(path);
    } catch (const Error& error) {
      return error.what();
    }
    return "accepted";
  }

  test::TemporaryFolder folder_;
};

constexpr const char* kKml = R"(<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>
  <LineString><coordinates>11,48 11.01,48</coordinates></LineString></Placemark></Document></kml>)";

TEST_F(HostileDrawings, XmlEntitiesAreRefused) {
  std::string laughs = "<?xml version=\"1.0\"?><!DOCTYPE kml [<!ENTITY a \"aaaaaaaaaa\">";
  for (char c = 'b'; c < 'l'; ++c) {
    laughs += std::string("<!ENTITY ") + c + " \"";
    for (int i = 0; i < 10; ++i) laughs += std::string("&") + static_cast<char>(c - 1) + ";";
    laughs += "\">";
  }
  laughs += "]><kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document><name>&k;</name></Document></kml>";
  EXPECT_NE(refusal("laughs.kml", laughs).find("<!DOCTYPE"), std::string::npos);
  EXPECT_NE(
      refusal(
          "secret.kml",
          "<?xml version=\"1.0\"?><!DOCTYPE k [<!ENTITY x SYSTEM \"file:///etc/passwd\">]><kml><name>&x;</name></kml>")
          .find("document type"),
      std::string::npos);
}

TEST_F(HostileDrawings, ArchivesThatUnfoldOrHoldNothingAreRefused) {
  const auto zip = [&](const std::string& python) {
    const std::string path = (folder_.path() / "a.kmz").string();
    std::filesystem::remove(path);
    EXPECT_EQ(test::run_shell("python3 -c \"import zipfile\nz=zipfile.ZipFile('" + path +
                              "','w',zipfile.ZIP_DEFLATED)\n" + python + "\nz.close()\"")
                  .code,
              0);
    return refusal(path);
  };
  EXPECT_NE(zip("z.writestr('doc.kml', '<kml>' + ' ' * (300 << 20))").find("decompresses"), std::string::npos);
  EXPECT_NE(zip("z.writestr('picture.png', 'x')").find("KML document"), std::string::npos);
  EXPECT_NE(zip("[z.writestr(f'{i}.png', '') for i in range(1500)]").find("at most 1000"), std::string::npos);
  const Bytes sound = mission_as_kmz(test::sample_mission());
  for (const std::size_t keep : {std::size_t{40}, sound.size() / 2, sound.size() - 10}) {
    const auto cut = folder_.path() / "cut.kmz";
    write_file_atomic(cut, ByteView(sound).first(keep));
    EXPECT_NE(refusal(cut), "accepted") << keep;
  }
}

TEST_F(HostileDrawings, DamagedDrawingsAreRefused) {
  ASSERT_EQ(refusal("sound.kml", kKml), "accepted");
  EXPECT_NE(refusal("cut.kml", std::string(kKml).substr(0, 160)), "accepted");
  EXPECT_NE(refusal("text.kml", "no drawing"), "accepted");
  EXPECT_NE(refusal("empty.kml", ""), "accepted");
  const std::string json =
      R"({"type":"Feature","properties":{},"geometry":{"type":"LineString","coordinates":[[11,48],[11.01,48]]}})";
  ASSERT_EQ(refusal("sound.geojson", json), "accepted");
  for (std::size_t cut = 1; cut + 1 < json.size(); cut += 5) {
    EXPECT_NE(refusal("cut.geojson", json.substr(0, cut)), "accepted") << json.substr(0, cut);
  }
  std::string nan = json;
  nan.replace(nan.find("11,48"), 5, "NaN,48");
  EXPECT_NE(refusal("nan.geojson", nan), "accepted");
  std::string huge = json;
  huge.replace(huge.find("11,48"), 5, "1e300,48");
  EXPECT_NE(refusal("huge.geojson", huge).find("outside of the world"), std::string::npos);
  std::string wide = kKml;
  wide.insert(wide.find("11,48"), std::string(1, '\0'));
  EXPECT_NE(refusal("wide.kml", wide).find("UTF-8"), std::string::npos);
}

TEST_F(HostileDrawings, HugeCountsAreRefused) {
  std::string features;
  for (int i = 0; i < 20'001; ++i)
    features += std::string(i == 0 ? "" : ",") +
                R"({"type":"Feature","properties":{},"geometry":{"type":"Point","coordinates":[1,1]}})";
  EXPECT_NE(refusal("many.geojson", R"({"type":"FeatureCollection","features":[)" + features + "]}")
                .find("too many features"),
            std::string::npos);
  std::string points;
  for (int i = 0; i < 1'000'001; ++i) points += std::string(i == 0 ? "" : ",") + "[1,1]";
  EXPECT_NE(
      refusal("long.geojson",
              R"({"type":"Feature","properties":{},"geometry":{"type":"LineString","coordinates":[)" + points + "]}}")
          .find("too many points"),
      std::string::npos);
}

}  // namespace
}  // namespace nadir
