// `./run bench integrity` as it is called: its parts, and what is wrong usage.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/files.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::bench {
namespace {

using test::run_process;
using testing::HasSubstr;

const std::string kProgram = NADIR_BENCH_INTEGRITY;
const std::string kTableFolder = NADIR_INTEGRITY_DATA;

test::ProcessResult integrity(std::vector<std::string> args) {
  args.insert(args.begin(), kProgram);
  return run_process(args);
}

std::vector<std::string> splitting(const std::string& results, const std::string& seed) {
  return {"--part",        "splitting",
          "--measured",    kTableFolder + "/measured_looks.csv",
          "--repeated",    kTableFolder + "/repeated_looks.csv",
          "--repetitions", "2",
          "--particles",   "12",
          "--seed",        seed,
          "--resume",      results};
}

TEST(IntegrityCommand, SplitsDrawsTheTreeAndResumes) {
  const test::TemporaryFolder folder;
  const std::string results = folder / "splitting.csv", svg = folder / "tree.svg";
  const auto first = integrity(splitting(results, "1000000"));
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_THAT(first.out, HasSubstr("| no fault | 2 |"));
  EXPECT_THAT(first.out, HasSubstr("only 2 repetitions of some faults: bounds need 20"));
  // A killed run goes on where it stopped, with the same result.
  const std::string all = read_text_file(results);
  write_file_atomic(results, all.substr(0, all.size() / 2));
  const auto second = integrity(splitting(results, "1000000"));
  ASSERT_EQ(second.code, 0) << second.err;
  EXPECT_EQ(second.out, first.out);
  const auto tree = integrity({"--part", "tree", "--from", results, "--svg", svg});
  ASSERT_EQ(tree.code, 0) << tree.err;
  EXPECT_THAT(tree.out, HasSubstr("SAIL III, 1e-04 a flight hour"));
  EXPECT_THAT(read_text_file(svg), HasSubstr("hazardously misleading"));
}

TEST(IntegrityCommand, ResultsOfAnotherSeedAreRejected) {
  const test::TemporaryFolder folder;
  const std::string results = folder / "splitting.csv";
  ASSERT_EQ(integrity(splitting(results, "1000000")).code, 0);
  const auto resumed = integrity(splitting(results, "1000001"));
  EXPECT_EQ(resumed.code, 2);
  EXPECT_THAT(resumed.err, HasSubstr("the file holds no results of this run"));
  const auto tree = integrity({"--part", "tree", "--from", results, "--seed", "1000001"});
  EXPECT_EQ(tree.code, 2);
  EXPECT_THAT(tree.err, HasSubstr("not the splitting of this base seed"));
}

TEST(IntegrityCommand, WrongUsageEndsWithAMessage) {
  const test::TemporaryFolder folder;
  const auto part = integrity({"--part", "magic"});
  EXPECT_NE(part.code, 0);
  EXPECT_THAT(part.err, HasSubstr("magic"));
  const auto fitted = integrity({"--part", "splitting", "--seed", "7"});
  EXPECT_EQ(fitted.code, 2);
  EXPECT_THAT(fitted.err, HasSubstr("seeds below a million were fitted to"));
  const auto missing = integrity({"--part", "tree", "--from", folder / "none.csv"});
  EXPECT_EQ(missing.code, 2);
  EXPECT_THAT(missing.err, HasSubstr("none.csv"));
  EXPECT_THAT(integrity({"--part", "tree"}).err, HasSubstr("--from"));
  EXPECT_THAT(integrity({"--part", "table"}).err, HasSubstr("--from"));
  const auto no_table = integrity({"--part", "splitting", "--measured", folder / "none.csv"});
  EXPECT_EQ(no_table.code, 2);
  EXPECT_THAT(no_table.err, HasSubstr("none.csv"));
}

TEST(IntegrityCommand, MakesTheTableOfLooksThatWereMeasured) {
  const test::TemporaryFolder folder;
  const std::string table = folder / "table.csv";
  const std::string results = folder.write("looks.csv", "index,ground\n");
  EXPECT_THAT(integrity({"--part", "table", "--from", results, "--measured", table}).err,
              HasSubstr("not a file of looks"));
  std::string looks = "# nadir bench looks, made up, grounds: painted 9\ncolumns\n";
  for (const char* window : {"right", "elsewhere", "mirrored"}) {
    looks += std::string("1,painted 9,") + window +
             ",clear,candidate,60,200,96,0.5,0.3,0.4,40,1.2,0.9,0.5,0.5,0.014,3.4,3.2," +
             (window == std::string("right") ? "4.00,5.00" : "400.00,410.00") + ",2.00,25,0.800,1.5,60.0,58.0\n";
    looks.replace(looks.rfind("\n1,"), 3, std::string("\n") + std::to_string(looks.size()) + ",");
  }
  write_file_atomic(results, looks);
  const auto made = integrity({"--part", "table", "--from", results, "--measured", table});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("| other | 1 | 1 |"));
  EXPECT_THAT(read_text_file(table), HasSubstr("1,0,h,0,60,p,"));
  write_file_atomic(results, looks.substr(0, looks.size() - 30));
  EXPECT_THAT(integrity({"--part", "table", "--from", results, "--measured", table}).err,
              HasSubstr("a line of results cannot be read"));
}

}  // namespace
}  // namespace nadir::bench
