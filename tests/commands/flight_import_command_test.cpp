// nadir flight import as a user calls it: exit codes, and what is said on which stream.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;

class FlightImportCommandTest : public test::CommandTest {
 protected:
  FlightImportCommandTest() {
    std::filesystem::create_directory(path("photos"));
    for (const char* name : {"photos/a.jpg", "photos/b.jpg"}) {
      write_file_atomic(path(name),
                        ByteView(encode_image(cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 90, 60)), ImageFormat::jpeg)));
    }
  }
};

TEST_F(FlightImportCommandTest, WritesAFlightAndSaysHowToGoOn) {
  EXPECT_EQ(run({"flight", "import", "--photos", "@photos", "--interval-s", "2", "--agl-m", "100", "--focal-px", "60",
                 "--start=8.5,47.4", "--out", "@flight"}),
            0);
  EXPECT_THAT(out_.str(), HasSubstr("import.interval"));
  EXPECT_THAT(err_.str(), HasSubstr("nadir replay --frames"));
  EXPECT_THAT(err_.str(), HasSubstr("--start=8.5000,47.4000"));
  EXPECT_TRUE(std::filesystem::exists(path("flight/telemetry.csv")));
}

TEST_F(FlightImportCommandTest, AsksForWhatIsMissingAndWritesNothing) {
  EXPECT_EQ(run({"flight", "import", "--photos", "@photos", "--out", "@flight", "--json"}), 1);
  const auto document = result();
  EXPECT_EQ(document["accepted"], false);
  std::string fixes;
  for (const auto& finding : document["findings"]) fixes += finding["fix"].get<std::string>() + "\n";
  EXPECT_THAT(fixes, HasSubstr("--interval-s"));
  EXPECT_THAT(fixes, HasSubstr("--focal-px"));
  EXPECT_FALSE(std::filesystem::exists(path("flight")));
}

TEST_F(FlightImportCommandTest, SourcesThatDoNotGoTogether) {
  EXPECT_EQ(run({"flight", "import", "--out", "@flight"}), 2);
  EXPECT_THAT(err_.str(), HasSubstr("--photos DIR"));
  EXPECT_EQ(run({"flight", "import", "--photos", "@photos", "--video", "@a.mp4", "--out", "@flight"}), 2);
  EXPECT_EQ(run({"flight", "import", "--recorder", "@r", "--log", "@a.BIN", "--out", "@flight"}), 2);
  EXPECT_EQ(run({"flight", "import", "--photos", "@absent", "--out", "@flight"}), 2);
  EXPECT_THAT(err_.str(), HasSubstr("cannot read the photos"));
  EXPECT_EQ(run({"flight", "import", "--photos", "@photos", "--frames", "move", "--out", "@flight"}), 2);
  EXPECT_EQ(run({"flight", "import", "--photos", "@photos", "--clock-offset-s", "3", "--out", "@flight"}), 2);
}

}  // namespace
}  // namespace nadir
