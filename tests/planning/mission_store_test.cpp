#include "planning/mission_store.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "mission_formats/sample_mission.hpp"
#include "planning/mission_document.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr UtcTime kToday{1'790'000'000};

TEST(MissionDocument, IsTheMissionToTheLastBit) {
  for (const Mission& mission : {test::sample_mission(), test::area_alone()}) {
    const MissionReading back = read_document(json::parse(document_from(mission).dump()));
    ASSERT_TRUE(back.mission) << to_text(back.findings.items().front());
    EXPECT_EQ(*back.mission, mission);
  }
}

TEST(MissionDocument, WhatIsWrongIsNamedByItsPath) {
  json document = document_from(test::sample_mission());
  document["route"]["heights"]["m"][1] = 99'999;
  document["sectors"][1]["class"] = "lively";
  document["expires"] = "2020-01-01";
  const MissionReading reading = read_document(document);
  EXPECT_FALSE(reading.mission);
  std::vector<std::string> where;
  for (const Finding& finding : reading.findings.items()) where.push_back(finding.where);
  EXPECT_THAT(where, ElementsAre("expires", "sectors[1].class", "route.heights.m[1]"));
}

TEST(MissionDocument, ANewOneNeedsOnlyGround) {
  json document = new_document("harbour", kToday);
  EXPECT_FALSE(read_document(document).mission);
  document["takeoff"] = {{"lon_deg", 11.5}, {"lat_deg", 48.1}};
  document["route"]["points"] = {{11.5, 48.1}, {11.51, 48.1}};
  const MissionReading reading = read_document(document);
  ASSERT_TRUE(reading.mission) << to_text(reading.findings.items().front());
  EXPECT_EQ(reading.mission->id, "harbour");
  EXPECT_GT(reading.mission->expires, kToday);
}

class MissionStoreTest : public ::testing::Test {
 protected:
  MissionStore open(std::size_t most = 10) {
    return MissionStore(
        folder / "missions", most, [] { return kToday; },
        [this] {
          std::string id = std::to_string(++ids_);
          return std::string(12 - id.size(), '0') + id;
        });
  }
  test::TemporaryFolder folder;

 private:
  int ids_ = 0;
};

TEST_F(MissionStoreTest, KeepsDraftsAndTheTextOfAFile) {
  const std::string text = "# ours\n" + mission_yaml(test::sample_mission());
  std::string id;
  {
    MissionStore store = open();
    id = store.create(document_from(test::sample_mission()), text).id;
    store.create(new_document("later", kToday));
  }
  MissionStore store = open();
  EXPECT_EQ(store.list().size(), 2U);
  StoredMission mission = *store.find(id);
  EXPECT_EQ(mission.text, text) << "to the byte";
  json document = json::parse(mission.document);
  mission = store.write(id, 1, document);
  EXPECT_EQ(mission.text, text) << "nothing was changed";
  document["budget_mb"] = 77;
  mission = store.write(id, 2, document);
  EXPECT_EQ(mission.revision, 3);
  EXPECT_THAT(mission.text, HasSubstr("budget_mb: 77"));
  document["takeoff"] = nullptr;
  EXPECT_EQ(store.write(id, 3, document).text, "") << "a draft may be wrong, and is kept";
  EXPECT_EQ(json::parse(store.find(id)->document)["takeoff"], nullptr);
}

TEST_F(MissionStoreTest, TheSecondOfTwoWritersIsTold) {
  MissionStore store = open();
  const std::string id = store.create(new_document("a", kToday)).id;
  json mine = new_document("mine", kToday), theirs = new_document("theirs", kToday);
  store.write(id, 1, theirs);
  EXPECT_THROW(store.write(id, 1, mine), RevisionConflict);
  EXPECT_EQ(json::parse(store.find(id)->document)["id"], "theirs");
  EXPECT_THROW(store.write("ffffffffffff", 1, mine), Error);
}

TEST_F(MissionStoreTest, ADamagedDraftHidesNoOther) {
  MissionStore store = open(2);
  const std::string whole = store.create(new_document("whole", kToday)).id;
  const std::string damaged = store.create(new_document("damaged", kToday)).id;
  EXPECT_THROW(store.create(new_document("third", kToday)), UsageError);
  fs::resize_file(store.folder_of(damaged) / "draft.json", 40);
  EXPECT_EQ(store.list().size(), 1U);
  EXPECT_THROW(store.find(damaged), Error);
  EXPECT_FALSE(store.find("../" + whole));
  EXPECT_TRUE(store.remove(damaged));
  EXPECT_FALSE(store.remove(damaged));
  EXPECT_FALSE(store.remove(".."));
  EXPECT_TRUE(store.find(whole));
}

}  // namespace
}  // namespace nadir
