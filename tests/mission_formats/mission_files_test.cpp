// Missions written for other programs and read again: the same mission, to the last bit.
#include "mission_formats/mission_files.hpp"

#include <gtest/gtest.h>

#include "base/files.hpp"
#include "mission_formats/gis_files.hpp"
#include "mission_formats/mavlink_plans.hpp"
#include "mission_formats/sample_mission.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class MissionFiles : public testing::Test {
 protected:
  std::filesystem::path exported(const Mission& mission, MissionFormat format) {
    const auto path = folder_.path() / fmt_name(format);
    std::filesystem::remove(path);
    write_mission_as(mission, format, path);
    return path;
  }
  static std::string fmt_name(MissionFormat format) { return "mission." + std::string(name_of(format)); }

  static Mission imported(const std::filesystem::path& path, MissionImportOptions options = {}) {
    const ImportedMission read = mission_from_drawing(read_mission_drawing(path), options, path.string());
    for (const Finding& finding : read.reading.findings.items()) ADD_FAILURE() << to_text(finding);
    return read.reading.mission.value_or(Mission{});
  }

  test::TemporaryFolder folder_;
};

TEST_F(MissionFiles, YamlHoldsEveryBit) {
  for (const Mission& mission : {test::sample_mission(), test::area_alone()}) {
    const MissionReading reading = parse_mission(mission_yaml(mission), "m.yaml");
    for (const Finding& finding : reading.findings.items()) ADD_FAILURE() << to_text(finding);
    ASSERT_TRUE(reading.mission);
    EXPECT_EQ(*reading.mission, mission);
  }
}

TEST_F(MissionFiles, EveryFormatGivesTheSameMissionAgain) {
  for (const HeightFrame frame :
       {HeightFrame::above_ground, HeightFrame::above_takeoff, HeightFrame::above_sea_level}) {
    Mission mission = test::sample_mission();
    mission.route.height_frame = frame;
    for (const MissionFormat format : kMissionFormats) {
      SCOPED_TRACE(std::string(name_of(format)) + " " + std::string(name_of(frame)));
      MissionImportOptions options;
      if (format == MissionFormat::waypoints) options.base = mission;  // they hold a route alone
      EXPECT_EQ(imported(exported(mission, format), options), mission);
    }
    mission.route.heights_m.clear();
    mission.route.height_frame = HeightFrame::above_ground;
    for (const bool flat : {true, false}) {
      mission.terrain.flat = flat;
      for (const MissionFormat format : kMissionFormats) {
        SCOPED_TRACE(std::string(name_of(format)) + " without heights");
        MissionImportOptions options;
        if (format == MissionFormat::waypoints) options.base = mission;
        EXPECT_EQ(imported(exported(mission, format), options), mission);
      }
    }
  }
}

TEST_F(MissionFiles, FramesOfEachPointSurvive) {
  Mission mission = test::sample_mission();
  mission.route.height_frame = HeightFrame::above_takeoff;
  mission.route.height_frames = {HeightFrame::above_takeoff, HeightFrame::above_ground, HeightFrame::above_sea_level};
  const MissionReading reading = parse_mission(mission_yaml(mission), "m.yaml");
  for (const Finding& finding : reading.findings.items()) ADD_FAILURE() << to_text(finding);
  EXPECT_EQ(reading.mission, mission);
  for (const MissionFormat format :
       {MissionFormat::geojson, MissionFormat::gpkg, MissionFormat::plan, MissionFormat::waypoints}) {
    MissionImportOptions options;
    if (format == MissionFormat::waypoints) options.base = mission;
    EXPECT_EQ(imported(exported(mission, format), options), mission) << name_of(format);
  }
  EXPECT_THROW(mission_as_kml(mission), UsageError);

  // Frames that are the same are one frame; a number of them that is not the points' is refused, and so are both forms.
  std::string text = mission_yaml(mission);
  const std::string frames = "frames: [above_takeoff, above_ground, above_sea_level]";
  const auto with = [&](const std::string& other) {
    std::string changed = text;
    changed.replace(changed.find(frames), frames.size(), other);
    return parse_mission(changed, "m.yaml");
  };
  const MissionReading same = with("frames: [above_ground, above_ground, above_ground]");
  ASSERT_TRUE(same.mission);
  EXPECT_TRUE(same.mission->route.height_frames.empty());
  EXPECT_EQ(same.mission->route.height_frame, HeightFrame::above_ground);
  EXPECT_EQ(mission_yaml(*same.mission).find("frames: [above"), std::string::npos);
  EXPECT_FALSE(with("frames: [above_ground, above_takeoff]").mission);
  EXPECT_FALSE(with("frames: [above_ground, above_takeoff, high]").mission);
  EXPECT_FALSE(with("frame: above_ground, " + frames).mission);
  EXPECT_FALSE(with("frames: above_ground").mission);

  // A point more, drawn in another program: whose frames the others are is no longer known.
  const auto path = exported(mission, MissionFormat::geojson);
  std::string drawing = read_text_file(path);
  const std::string words = "above_takeoff above_ground above_sea_level";
  drawing.replace(drawing.find(words), words.size(), "above_takeoff above_ground");
  write_file_atomic(path, drawing);
  const ImportedMission read = mission_from_drawing(read_mission_drawing(path), {}, path.string());
  ASSERT_TRUE(read.reading.mission);
  EXPECT_TRUE(read.reading.mission->route.heights_m.empty());
  EXPECT_FALSE(read.notes.empty());
}

// As Google Earth saves it: folders, views, shared styles, its own namespace, and a ZIP with pictures beside the
// document.
TEST_F(MissionFiles, AKmzOfGoogleEarth) {
  const std::string kml = R"(<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2" xmlns:kml="http://www.opengis.net/kml/2.2" xmlns:atom="http://www.w3.org/2005/Atom">
<Document><name>flight.kmz</name>
 <gx:CascadingStyle kml:id="__managed_style_0"><Style><IconStyle><Icon><href>files/pin.png</href></Icon></IconStyle></Style></gx:CascadingStyle>
 <StyleMap id="m_ylw-pushpin"><Pair><key>normal</key><styleUrl>#s_ylw-pushpin</styleUrl></Pair></StyleMap>
 <Style id="s_ylw-pushpin"><LineStyle><color>ff0000ff</color><width>3</width></LineStyle></Style>
 <Folder><name>Mission</name><open>1</open>
  <LookAt><longitude>11.33</longitude><latitude>48.14</latitude><altitude>0</altitude><range>997</range><gx:altitudeMode>relativeToSeaFloor</gx:altitudeMode></LookAt>
  <Placemark><name>Untitled Path</name><styleUrl>#m_ylw-pushpin</styleUrl>
   <LineString><tessellate>1</tessellate><altitudeMode>relativeToGround</altitudeMode><coordinates>
    11.3333,48.1428,80 11.3666,48.1442,120
   </coordinates></LineString></Placemark>
  <Folder><name>Areas</name>
   <Placemark><name>Old town</name><Polygon><tessellate>1</tessellate><outerBoundaryIs><LinearRing><coordinates>
    11.34,48.14,0 11.35,48.14,0 11.35,48.15,0 11.34,48.14,0
   </coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
   <Placemark><name>No-fly mast</name><Polygon><extrude>1</extrude><altitudeMode>relativeToGround</altitudeMode><outerBoundaryIs><LinearRing><coordinates>
    11.36,48.15,50 11.37,48.15,50 11.37,48.16,50 11.36,48.15,50
   </coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
  </Folder>
  <Placemark><name>Pin</name><Point><gx:drawOrder>1</gx:drawOrder><coordinates>11.34,48.14,0</coordinates></Point></Placemark>
 </Folder>
</Document></kml>)";
  folder_.write("doc.kml", kml);
  std::filesystem::create_directory(folder_ / "files");
  folder_.write("files/pin.png", "no picture, and nobody asks");
  const auto zipped =
      test::run_shell("cd '" + folder_.path().string() +
                      "' && python3 -c \"import zipfile; z = zipfile.ZipFile('flight.kmz', 'w', zipfile.ZIP_DEFLATED); "
                      "z.write('doc.kml'); z.write('files/pin.png')\"");
  ASSERT_EQ(zipped.code, 0) << zipped.err;
  MissionImportOptions options;
  options.id = "earth";
  options.today = *parse_utc("2026-05-01");
  const Mission mission = imported(folder_ / "flight.kmz", options);
  EXPECT_EQ(mission.route.points, (std::vector<LonLat>{{11.3333, 48.1428}, {11.3666, 48.1442}}));
  EXPECT_EQ(mission.route.heights_m, (std::vector<double>{80, 120}));
  EXPECT_EQ(mission.route.height_frame, HeightFrame::above_ground);
  ASSERT_EQ(mission.sectors.size(), 1U);
  EXPECT_EQ(mission.sectors[0].id, "Old-town");
  ASSERT_EQ(mission.no_fly.size(), 1U);
  EXPECT_EQ(mission.no_fly[0].id, "No-fly-mast");
}

// QGIS keeps styles in a table of the GeoPackage, and may keep other tables without geometry.
TEST_F(MissionFiles, AGeoPackageWithTablesOfQgis) {
  const Mission mission = test::sample_mission();
  const auto path = exported(mission, MissionFormat::gpkg);
  const auto changed = test::run_process({"sqlite3", path.string(),
                                          "CREATE TABLE layer_styles (id INTEGER PRIMARY KEY, f_table_catalog TEXT, "
                                          "f_table_schema TEXT, f_table_name TEXT, "
                                          "f_geometry_column TEXT, styleName TEXT, styleQML TEXT, styleSLD TEXT, "
                                          "useAsDefault BOOLEAN, description TEXT, owner "
                                          "TEXT, ui TEXT, update_time DATETIME);"
                                          "INSERT INTO gpkg_contents (table_name, data_type, identifier, description) "
                                          "VALUES ('layer_styles', 'attributes', "
                                          "'layer_styles', '');"
                                          "INSERT INTO layer_styles (f_table_name, f_geometry_column, styleName, "
                                          "styleQML, useAsDefault) VALUES ('route', 'geom', "
                                          "'route', '<!DOCTYPE qgis><qgis/>', 1);"});
  ASSERT_EQ(changed.code, 0) << changed.err;
  EXPECT_EQ(imported(path), mission);
}

TEST_F(MissionFiles, AnAreaAloneIsAMission) {
  const Mission mission = test::area_alone();
  for (const MissionFormat format :
       {MissionFormat::kml, MissionFormat::kmz, MissionFormat::geojson, MissionFormat::gpkg}) {
    EXPECT_EQ(imported(exported(mission, format)), mission) << name_of(format);
  }
  EXPECT_THROW(mission_as_plan(mission), UsageError);
  EXPECT_THROW(mission_as_waypoints(mission), UsageError);
}

TEST_F(MissionFiles, TheSameMissionGivesTheSameBytes) {
  for (const MissionFormat format : kMissionFormats) {
    const Bytes first = read_file(exported(test::sample_mission(), format));
    EXPECT_EQ(read_file(exported(test::sample_mission(), format)), first) << name_of(format);
  }
}

TEST_F(MissionFiles, WhatWasMovedInAnotherProgramStaysMoved) {
  const Mission mission = test::sample_mission();
  const auto path = exported(mission, MissionFormat::geojson);
  std::string text = read_text_file(path);
  const std::string from = "11.383333333333335";  // the last point's longitude
  ASSERT_NE(text.find(from), std::string::npos) << text.substr(0, 3000);
  // The mission that the file carries keeps the old place: the geometry wins.
  text.replace(text.rfind(from), from.size(), "11.4");
  write_file_atomic(path, text);
  const Mission moved = imported(path);
  EXPECT_EQ(moved.route.points.back().lon_deg, 11.4);
  EXPECT_EQ(moved.sectors, mission.sectors);
  EXPECT_EQ(moved.id, mission.id);
}

TEST_F(MissionFiles, AnEditedCircleIsThePolygonThatWasDrawn) {
  const auto path = exported(test::sample_mission(), MissionFormat::geojson);
  std::string text = read_text_file(path);
  const std::size_t mast = text.find("\"mast\"");
  std::size_t corner = text.find("coordinates", mast);
  for (int i = 0; i < 5; ++i) corner = text.find("11.3", corner + 1);
  text[corner + 5] = text[corner + 5] == '9' ? '8' : '9';
  write_file_atomic(path, text);
  const Mission edited = imported(path);
  ASSERT_EQ(edited.no_fly.size(), 2U);
  EXPECT_EQ(edited.no_fly[1].polygon.size(), 72U);
}

TEST_F(MissionFiles, KmlRefusesHeightsThatItCannotState) {
  Mission mission = test::sample_mission();
  mission.terrain.flat = false;
  EXPECT_THROW(mission_as_kml(mission), UsageError);
  mission.route.height_frame = HeightFrame::above_sea_level;
  EXPECT_EQ(imported(exported(mission, MissionFormat::kml)), mission);
}

TEST_F(MissionFiles, HeightsOfUnknownFrameAreAskedFor) {
  const auto path = folder_.write("plan.geojson", R"({"type":"Feature","properties":{},"geometry":{"type":"LineString",
    "coordinates":[[11,48,500],[11.01,48,510]]}})");
  MissionImportOptions options;
  options.id = "a";
  const ImportedMission without = mission_from_drawing(read_mission_drawing(path), options, "plan");
  ASSERT_TRUE(without.reading.mission);
  EXPECT_TRUE(without.reading.mission->route.heights_m.empty());
  EXPECT_TRUE(without.notes.contains("import.heights_ignored"));
  options.height_frame = HeightFrame::above_sea_level;
  options.ground_m = 400;
  const Mission with = imported(path, options);
  EXPECT_EQ(with.route.heights_m, (std::vector<double>{500, 510}));
  EXPECT_EQ(with.route.height_frame, HeightFrame::above_sea_level);
  EXPECT_EQ(with.route.agl_m, 110);
}

// As Google Earth writes: styles, folders, a path with an altitude mode, tessellation.
TEST_F(MissionFiles, GoogleEarthsPathsAndPolygons) {
  const auto path = folder_.write("earth.kml", R"(<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><name>Plan</name>
<Style id="inline"><LineStyle><color>ff0000ff</color></LineStyle></Style>
<Folder><name>f</name>
<Placemark><name>Way</name><styleUrl>#inline</styleUrl><LineString><tessellate>1</tessellate><altitudeMode>absolute</altitudeMode>
<coordinates>
  11.0,48.0,520 11.01,48.002,540
</coordinates></LineString></Placemark>
<Placemark><name>No-fly barracks</name><Polygon><tessellate>1</tessellate><outerBoundaryIs><LinearRing><coordinates>
11.003,48.003,0 11.005,48.003,0 11.005,48.005,0 11.003,48.003,0 </coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
<Placemark><name>Town</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
11.003,48.003,0 11.005,48.003,0 11.005,48.005,0 11.003,48.003,0 </coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
<Placemark><name>Pin</name><Point><coordinates>11,48,0</coordinates></Point></Placemark>
</Folder></Document></kml>)");
  MissionImportOptions options;
  options.id = "earth";
  options.today = *parse_utc("2026-05-01");
  const Mission mission = imported(path, options);
  EXPECT_EQ(mission.route.points, (std::vector<LonLat>{{11, 48}, {11.01, 48.002}}));
  EXPECT_EQ(mission.route.heights_m, (std::vector<double>{520, 540}));
  EXPECT_EQ(mission.route.height_frame, HeightFrame::above_sea_level);
  ASSERT_EQ(mission.no_fly.size(), 1U);
  EXPECT_EQ(mission.no_fly[0].id, "No-fly-barracks");
  ASSERT_EQ(mission.sectors.size(), 1U);
  EXPECT_TRUE(read_mission_drawing(path).notes.contains("import.left_out"));
}

// Layers of GIS programs often name nothing, and the parts of a multi-geometry share a name.
TEST_F(MissionFiles, LinesWithoutNamesAreChosenByNumber) {
  const auto path = folder_.write("lines.geojson", R"({"type": "FeatureCollection", "features": [
    {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": [[11, 48], [11.01, 48]]}},
    {"type": "Feature", "properties": {"name": "way"}, "geometry": {"type": "LineString", "coordinates": [[11, 48.1], [11.01, 48.1]]}},
    {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": [[11, 48.2], [11.01, 48.2]]}}]})");
  MissionImportOptions options;
  options.id = "lines";
  options.today = *parse_utc("2026-05-01");
  try {
    mission_from_drawing(read_mission_drawing(path), options, "lines.geojson");
    FAIL() << "one of three";
  } catch (const UsageError& error) {
    EXPECT_EQ(error.text().found, R"(3 lines: "line 1", "way", "line 3")");
  }
  for (const auto& [name, lat_deg] : {std::pair("line 1", 48.0), std::pair("way", 48.1), std::pair("line 3", 48.2)}) {
    options.route = name;
    EXPECT_EQ(imported(path, options).route.points.front().lat_deg, lat_deg) << name;
  }
  for (const char* name : {"line 2", "line 4", ""}) {
    options.route = name;
    EXPECT_THROW(mission_from_drawing(read_mission_drawing(path), options, "lines.geojson"), UsageError) << name;
  }
}

// Pins alone, as people set them in Google Earth: it is said what there is instead of a line.
TEST_F(MissionFiles, PinsAloneAreNoRoute) {
  const auto path = folder_.write("pins.kml", R"(<kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<Placemark><name>A</name><Point><coordinates>11,48,0</coordinates></Point></Placemark>
<Placemark><name>B</name><Point><coordinates>11.1,48,0</coordinates></Point></Placemark></Document></kml>)");
  try {
    MissionImportOptions options;
    options.id = "pins";
    mission_from_drawing(read_mission_drawing(path), options, "pins.kml");
    FAIL() << "no route";
  } catch (const UsageError& error) {
    EXPECT_NE(error.text().found.find("no lines; 2 points"), std::string::npos) << error.text().found;
  }
}

TEST_F(MissionFiles, QgisReadsWhatWeWrite) {
  for (const MissionFormat format : {MissionFormat::kml, MissionFormat::geojson, MissionFormat::gpkg}) {
    const auto path = exported(test::sample_mission(), format);
    const auto info = test::run_shell("ogrinfo -ro -al -so " + path.string());
    EXPECT_EQ(info.code, 0) << (info.out + info.err);
    EXPECT_EQ((info.out + info.err).find("Warning"), std::string::npos) << (info.out + info.err);
  }
  EXPECT_EQ(test::run_shell("cd " + folder_.path().string() + " && python3 -c \"import zipfile; z=zipfile.ZipFile('" +
                            exported(test::sample_mission(), MissionFormat::kmz).string() +
                            "'); assert z.testzip() is None and z.namelist()==['doc.kml']\"")
                .code,
            0);
}

TEST_F(MissionFiles, SwappedCoordinatesAreRecognised) {
  Mission mission = test::sample_mission();
  const auto path = exported(mission, MissionFormat::geojson);
  EXPECT_EQ(read_mission_drawing(path, true).lines.front().points.front().lon_deg, mission.takeoff.lat_deg);
  MissionImportOptions options;
  options.base = mission;
  try {
    mission_from_drawing(read_mission_drawing(path, true), options, "plan");
    FAIL() << "swapped coordinates pass";
  } catch (const UsageError& error) {
    EXPECT_NE(error.text().fix.find("--latitude-first"), std::string::npos) << error.what();
  }
  // A latitude that cannot be one.
  const auto south =
      folder_.write("south.geojson", R"({"type":"Feature","properties":{},"geometry":{"type":"LineString",
    "coordinates":[[-37.75,144.98],[-37.76,144.99]]}})");
  try {
    read_mission_drawing(south);
    FAIL() << "a latitude of 145 degrees passes";
  } catch (const UsageError& error) {
    EXPECT_NE(error.text().fix.find("swapped"), std::string::npos) << error.what();
  }
  EXPECT_EQ(read_mission_drawing(south, true).lines.front().points.front().lon_deg, 144.98);
}

// Drawings of other people, which stay outside of the project: each imports, or is refused with a reason.
TEST_F(MissionFiles, RealFilesImportOrAreRefusedByName) {
  const char* real = std::getenv("NADIR_MISSION_FILES");
  if (real == nullptr) GTEST_SKIP() << "NOT TESTED: NADIR_MISSION_FILES names no folder of real plans and drawings";
  std::size_t files = 0, imports = 0;
  for (const auto& entry : std::filesystem::directory_iterator(real)) {
    ++files;
    try {
      MissionImportOptions options;
      options.id = "real";
      options.today = *parse_utc("2026-05-01");
      const ImportedMission read =
          mission_from_drawing(read_mission_drawing(entry.path()), options, entry.path().filename());
      if (read.reading.mission) {
        ++imports;
        EXPECT_EQ(parse_mission(mission_yaml(*read.reading.mission), "again").mission, read.reading.mission);
        std::cout << entry.path().filename() << ": " << read.reading.mission->route.points.size() << " points, "
                  << read.reading.mission->sectors.size() << " sectors, " << read.reading.mission->no_fly.size()
                  << " no-fly\n";
      } else {
        ASSERT_FALSE(read.reading.findings.empty());
        std::cout << entry.path().filename() << ": " << to_text(read.reading.findings.items().front()) << '\n';
      }
    } catch (const Error& error) {
      EXPECT_FALSE(error.text().what.empty());
      std::cout << entry.path().filename() << ": " << error.what() << '\n';
    }
  }
  std::cout << imports << " of " << files << " import\n";
}

}  // namespace
}  // namespace nadir
