// Photos as people have them become a flight at the desk.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <string>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "desk/desk_fixture.hpp"
#include "flight_import/sample_photos.hpp"

namespace nadir {
namespace {

using test::SamplePhoto;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class DeskImport : public test::DeskFixture {
 protected:
  DeskImport() { open(); }

  // Six photos of a flight to the north, a second apart.
  struct File {
    std::string name;
    Bytes bytes;
  };
  std::vector<File> photos(bool heights = true) const {
    static const test::SampleGround ground;
    std::vector<File> files;
    for (int i = 0; i < 6; ++i) {
      SamplePhoto photo{.taken = fmt::format("2026:06:23 16:31:{:02}", 10 + i), .zone = "+02:00"};
      if (heights) photo.xmp = test::dji_xmp(100, 0, -90);
      files.push_back({fmt::format("DJI_{:04}.JPG", i), test::jpeg_with(ground.picture(0, 20.0 * i, 0), photo)});
    }
    return files;
  }

  std::string begin() const {
    const ApiResponse begun = call(post("/v1/imports", ""));
    EXPECT_EQ(begun.status, 201) << begun.body;
    return "/v1/imports/" + json(begun)["id"].get<std::string>();
  }
  ApiResponse put(const std::string& import, const std::vector<File>& files, const char* part = "photo") const {
    std::string body;
    for (const File& file : files) {
      body +=
          fmt::format("--cut\r\nContent-Disposition: form-data; name=\"{}\"; filename=\"{}\"\r\n\r\n", part, file.name);
      body += as_text(file.bytes);
      body += "\r\n";
    }
    return call(post(import + "/files", body + "--cut--\r\n", "multipart/form-data; boundary=cut"));
  }
  ApiResponse finish(const std::string& import, nlohmann::json more = nlohmann::json::object()) const {
    nlohmann::json body{{"name", "photos"}, {"start", {{"lat", 47.4}, {"lon", 8.5}}}};
    body.update(more);
    return call(post(import + "/flight", body.dump()));
  }
  std::vector<std::string> outcomes(const ApiResponse& put) const {
    std::vector<std::string> outcomes;
    EXPECT_EQ(put.status, 200) << put.body;
    const auto answer = json(put);
    for (const auto& file : answer["files"]) outcomes.push_back(file["outcome"]);
    return outcomes;
  }
};

TEST_F(DeskImport, PhotosBecomeAFlight) {
  const std::string import = begin();
  const auto files = photos();
  ASSERT_EQ(put(import, files).status, 200);
  EXPECT_EQ(read("/v1/imports")["imports"][0]["photos"], 6);
  const ApiResponse made = finish(import);
  ASSERT_EQ(made.status, 201) << made.body;
  const auto document = json(made);
  EXPECT_EQ(document["pictures"]["accepted"], 6);
  EXPECT_THAT(document["found"]["heights"].get<std::string>(), HasSubstr("above take-off (6)"));
  EXPECT_FALSE(document["findings"].empty()) << "what was assumed";
  EXPECT_THAT(document["findings"].dump(), ::testing::Not(HasSubstr("--"))) << "options of the command line";
  const std::string flight = "/v1/flights/" + document["flight"]["id"].get<std::string>();
  EXPECT_EQ(settled(flight)["pictures"]["processed"], 6);
  const auto estimates = read(flight + "/estimates")["estimates"];
  EXPECT_EQ(estimates[5]["source"], "vo_extrapolated");
  EXPECT_TRUE(read("/v1/imports")["imports"].empty()) << "the photos are the flight's now";
  EXPECT_EQ(finish(import).status, 404);
}

TEST_F(DeskImport, WhatIsMissingIsAskedForAndTheFilesStay) {
  const std::string import = begin();
  put(import, photos(false));
  const ApiResponse refused = finish(import);
  ASSERT_EQ(refused.status, 422) << refused.body;
  EXPECT_EQ(json(refused)["type"], "urn:nadir:problem:import");
  EXPECT_THAT(json(refused)["errors"][0]["detail"].get<std::string>(), HasSubstr("agl_m METRES"));
  EXPECT_TRUE(read("/v1/flights")["flights"].empty());
  const ApiResponse made = finish(import, {{"agl_m", 100}});
  EXPECT_EQ(made.status, 201) << made.body;
}

TEST_F(DeskImport, FilesKeepTheirNamesAndNothingIsReplaced) {
  const std::string import = begin();
  const auto files = photos();
  const std::vector<File> odd{{"../DJI_0000.JPG", files[0].bytes},
                              {"a/b/c/DJI_0000.JPG", files[0].bytes},
                              {".hidden", files[0].bytes},
                              {"100MEDIA/DJI_0000.JPG", files[0].bytes},
                              {"101MEDIA/DJI_0000.JPG", files[1].bytes},
                              {"101MEDIA/DJI_0000.JPG", files[1].bytes},
                              {"101MEDIA/DJI_0000.JPG", files[2].bytes},
                              {"101MEDIA/DJI_0000.JPG/x.JPG", files[2].bytes},
                              {"empty.JPG", {}}};
  EXPECT_THAT(outcomes(put(import, odd)), ElementsAre("refused", "refused", "refused", "stored", "stored", "known",
                                                      "refused", "refused", "refused"));
  const ApiResponse made = finish(import);
  ASSERT_EQ(made.status, 201) << made.body;
  EXPECT_EQ(json(made)["pictures"]["accepted"], 2) << "one name in two folders";
}

TEST_F(DeskImport, BadCallsAreRefused) {
  EXPECT_EQ(finish("/v1/imports/0123456789ab").status, 404);
  EXPECT_EQ(finish("/v1/imports/..").status, 404);
  const std::string import = begin();
  EXPECT_EQ(put(import, photos(), "picture").status, 400) << "no such part";
  const ApiResponse empty = finish(import);
  EXPECT_EQ(empty.status, 422) << empty.body;
  const ApiResponse wrong = finish(import, {{"agl_m", "high"}, {"agl_feet", 300}});
  EXPECT_EQ(wrong.status, 400);
  EXPECT_EQ(json(wrong)["errors"].size(), 2U) << wrong.body;
  put(import, {{"flight.BIN", {1, 2, 3}}}, "log");
  put(import, photos());
  const ApiResponse no_log = finish(import);
  EXPECT_EQ(no_log.status, 422);
  EXPECT_THAT(json(no_log)["detail"].get<std::string>(), HasSubstr("this is no log that Nadir reads"));
  EXPECT_EQ(call(request("DELETE", import)).status, 204);
  EXPECT_EQ(call(request("DELETE", import)).status, 404);
  for (std::size_t i = 0; i < desk->limits().imports.imports; ++i) begin();
  EXPECT_EQ(call(post("/v1/imports", "")).status, 422);
}

// A kill while the pictures became a flight: the same call goes on with that one.
TEST_F(DeskImport, AnInterruptedImportGoesOnWithItsFlight) {
  const std::string import = begin();
  put(import, photos());
  const auto first = json(finish(import));
  const std::string id = first["flight"]["id"];

  const std::string again = begin();
  put(again, photos());
  desk->imports().set_flight(again.substr(again.rfind('/') + 1), id);
  close();
  open();
  const ApiResponse made = finish(again);
  ASSERT_EQ(made.status, 201) << made.body;
  EXPECT_EQ(json(made)["flight"]["id"], id);
  EXPECT_EQ(json(made)["pictures"]["known"], 6);
  EXPECT_EQ(read("/v1/flights")["flights"].size(), 1U);
}

}  // namespace
}  // namespace nadir
