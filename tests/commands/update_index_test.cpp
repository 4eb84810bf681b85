// nadir cache update and the place index: made anew, left behind, or missing.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "base/files.hpp"
#include "cli/program.hpp"
#include "package/package_maker.hpp"
#include "commands/commands.hpp"
#include "support/process.hpp"
#include "vision/place_index_files.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

class UpdatedIndex : public ::testing::Test {
 protected:
  UpdatedIndex() {
    folder_.write("root.json", sign_root(maker_.root, {&maker_.signer}).json());
    write_file_atomic(folder_ / "p.key.pem", maker_.signer.pem(), 0600);
    folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"}}));
  }
  int run(std::vector<std::string> args) {
    for (std::string& arg : args) {
      if (arg.starts_with('@')) arg = (folder_ / arg.substr(1)).string();  // in the test's folder
    }
    out_.str("");
    err_.str("");
    return run_program(nadir_text(), all_commands(), args, {out_, err_, clock_});
  }
  int update(const std::string& old, const std::string& out, std::initializer_list<std::string> more) {
    std::vector<std::string> args{"cache",      "update", old,          "--trust", "@root.json", "--mission",
                                  "@next.yaml", "--key",  "@p.key.pem", "--out",   out};
    args.insert(args.end(), more);
    return run(args);
  }
  int index(const std::string& package, std::initializer_list<std::string> more = {}) {
    std::vector<std::string> args{"cache", "index",         package, "--key",         "@p.key.pem", "--overlap-percent",
                                  "10",    "--footprint-m", "110",   "--footprint-m", "150"};
    args.insert(args.end(), more);
    return run(args);
  }
  void expect_accepted(const std::string& package) {
    EXPECT_EQ(run({"cache", "verify", package, "--trust", "@root.json", "--depth", "full"}), 0) << out_.str();
  }
  void expect_same(const std::string& a, const std::string& b) {
    const auto result = test::run_process({"diff", "-r", (folder_ / a).string(), (folder_ / b).string()});
    EXPECT_EQ(result.code, 0) << result.out;
  }
  bool differ(const std::string& a, const std::string& b, std::string_view file) {
    return read_file(folder_ / a / file) != read_file(folder_ / b / file);
  }

  test::TemporaryFolder folder_;
  FixedClock clock_{test::kJudged};
  std::ostringstream out_, err_;
  test::PackageMaker maker_;
};

// The index of the updated package is the one that `cache index` makes of it, by any number of threads.
TEST_F(UpdatedIndex, IsThatOfTheNewTiles) {
  if (test::run_shell("command -v gdal_translate").code != 0) GTEST_SKIP() << "NOT TESTED: no gdal_translate";
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << err_.str();
  const auto cut = test::run_process({"gdal_translate",
                                      "-q",
                                      "-of",
                                      "GTiff",
                                      "-b",
                                      "1",
                                      "-b",
                                      "2",
                                      "-b",
                                      "3",
                                      "-scale",
                                      "0",
                                      "255",
                                      "255",
                                      "0",
                                      "-srcwin",
                                      "300",
                                      "300",
                                      "250",
                                      "250",
                                      folder_ / "old/imagery/base.mbtiles",
                                      folder_ / "new.tif"});
  ASSERT_EQ(cut.code, 0) << cut.err;
  ASSERT_EQ(update("@old", "@new",
                   {"--index", "--threads", "3", "--imagery", "@new.tif", "--captured", "2024-04-10", "--gsd-m", "0.3",
                    "--ce90-m", "4", "--provider", "gdal"}),
            0)
      << out_.str() << err_.str();
  EXPECT_EQ(err_.str().find("not carried over"), std::string::npos) << err_.str();
  expect_accepted("@new");
  EXPECT_TRUE(differ("old", "new", kPlaceIndexFile));
  EXPECT_TRUE(differ("old", "new", kPlaceTableFile));
  fs::copy(folder_ / "new", folder_ / "indexed", fs::copy_options::recursive);
  ASSERT_EQ(index("@indexed", {"--threads", "1"}), 0) << err_.str();
  expect_same("new", "indexed");
}

// With the mission alone the descriptors stay what they were, whatever the containers are.
TEST_F(UpdatedIndex, IsRebuiltForAnotherContainer) {
  maker_.cog = true;
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << err_.str();
  ASSERT_EQ(update("@old", "@new", {"--index", "--format", "mbtiles"}), 0) << out_.str() << err_.str();
  EXPECT_FALSE(differ("old", "new", kPlaceIndexFile));
  expect_accepted("@new");
}

TEST_F(UpdatedIndex, IsNotCarriedOverUnlessRequested) {
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << err_.str();
  ASSERT_EQ(update("@old", "@new", {}), 0) << err_.str();
  EXPECT_NE(err_.str().find("place index is not carried over"), std::string::npos) << err_.str();
  EXPECT_NE(err_.str().find("--index"), std::string::npos) << err_.str();
  EXPECT_FALSE(fs::exists(folder_ / "new/index"));
  expect_accepted("@new");
}

TEST_F(UpdatedIndex, ThatIsMissingOrDamagedIsNamed) {
  maker_.make(folder_, "old");
  EXPECT_EQ(update("@old", "@new", {"--index"}), 2);
  EXPECT_NE(err_.str().find("nadir cache index NEW"), std::string::npos) << err_.str();
  ASSERT_EQ(index("@old"), 0) << err_.str();
  Bytes table = read_file(folder_ / "old" / kPlaceTableFile);
  table[table.size() / 2] ^= 1;
  write_file_atomic(folder_ / "old" / kPlaceTableFile, table);
  EXPECT_NE(update("@old", "@new", {"--index"}), 0);
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

// The tiles alone, with what is appended to one of them, stay 0.1 MB below; an index has 0.3 MB at least.
TEST_F(UpdatedIndex, CountsTowardsTheBudget) {
  maker_.make(folder_, "lean");
  std::uintmax_t size = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder_ / "lean")) {
    if (entry.is_regular_file()) size += entry.file_size();
  }
  const std::uintmax_t budget_mb = size / 1'000'000 + 1;
  bool padded = false;
  maker_.edit_tile = [&](Sidecar&, Bytes& tile) {
    const std::uintmax_t left = budget_mb * 1'000'000 - size;
    if (!padded && left > 100'000) tile.resize(tile.size() + left - 100'000);  // behind the JPEG's end
    padded = true;
    return true;
  };
  maker_.make(folder_, "old");
  ASSERT_EQ(index("@old"), 0) << out_.str() << err_.str();
  folder_.write("next.yaml", test::mission_yaml({{"sequence: 3", "sequence: 4"},
                                                 {"budget_mb: 20", "budget_mb: " + std::to_string(budget_mb)}}));
  EXPECT_EQ(update("@old", "@without", {}), 0) << out_.str();
  EXPECT_EQ(update("@old", "@new", {"--index"}), 1) << out_.str() << err_.str();
  EXPECT_NE(out_.str().find("budget.exceeded"), std::string::npos) << out_.str();
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

}  // namespace
}  // namespace nadir
