#include "ortho/candidate_store.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/mbtiles.hpp"
#include "ortho/sample_candidates.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr std::uint32_t kX = 278'000, kY = 182'000;

TileKey key(std::uint32_t number) { return {19, kX + number % 7, kY + number / 7}; }

class Candidates : public ::testing::Test {
 protected:
  Candidate make(std::uint32_t number, std::int64_t sigma_mm = 2000, int picture = 0) const {
    return test::sample_candidate(key_, key(number), picture, sigma_mm);
  }
  std::vector<Candidate> read(bool damaged = false) const {
    CandidateReader reader(path());
    Findings findings;
    std::vector<Candidate> all;
    while (auto candidate = reader.next(findings)) all.push_back(std::move(*candidate));
    EXPECT_EQ(findings.contains("candidate.damaged"), damaged);
    return all;
  }
  std::filesystem::path path() const { return folder_ / "candidates"; }
  std::filesystem::path file() const { return path() / kCandidateFile; }

  test::TemporaryFolder folder_;
  PrivateKey key_ = PrivateKey::generate();
};

TEST_F(Candidates, AreReadInTheOrderOfTheirKeys) {
  CandidateStore store(path());
  for (const std::uint32_t number : {9U, 3U, 17U, 0U}) {
    EXPECT_EQ(store.put(std::vector{make(number)}), std::vector{CandidateOutcome::added});
  }
  EXPECT_EQ(store.tiles(), 4U);
  store.close();
  const auto all = read();
  ASSERT_EQ(all.size(), 4U);
  EXPECT_TRUE(std::is_sorted(all.begin(), all.end(),
                             [](const Candidate& a, const Candidate& b) { return a.sidecar.key < b.sidecar.key; }));
  const Candidate expected = make(9);
  const auto found = std::find_if(all.begin(), all.end(), [](const Candidate& c) { return c.sidecar.key == key(9); });
  ASSERT_NE(found, all.end());
  EXPECT_EQ(found->sidecar_bytes, expected.sidecar_bytes);
  EXPECT_EQ(found->tile, expected.tile);
  EXPECT_EQ(found->signature.signature, expected.signature.signature);
  EXPECT_TRUE(CandidateReader(path()).clean_shutdown());
  EXPECT_EQ(CandidateReader(path()).rows(), 4U);
}

TEST_F(Candidates, AreAnMbtilesFileForOthers) {
  CandidateStore store(path());
  store.put(std::vector{make(0), make(8)});
  store.close();
  EXPECT_FALSE(std::filesystem::exists(file().string() + "-journal"));
  const MbtilesReader reader(file());
  EXPECT_EQ(reader.read(key(8)), make(8).tile);
  EXPECT_EQ(reader.zooms().max, 19);
  const auto metadata = reader.metadata();
  EXPECT_EQ(metadata.at("format"), "jpg");
  EXPECT_EQ(metadata.at("maxzoom"), "19");
  const LonLatBox box = bounds_of(key(0));
  EXPECT_NEAR(std::stod(metadata.at("bounds")), box.west_deg, 1e-6);
  const auto gdal = test::run_process({"gdalinfo", file()});
  EXPECT_EQ(gdal.code, 0) << gdal.err;
  EXPECT_NE(gdal.out.find("Size is 512, 512"), std::string::npos) << gdal.out;
}

TEST_F(Candidates, KeepTheBetterOfTwo) {
  CandidateStore store(path());
  store.put(std::vector{make(0, 2000, 1)});
  EXPECT_FALSE(store.wants(make(0, 2000).sidecar)) << "as good is not better";
  EXPECT_EQ(store.put(std::vector{make(0, 2500, 2)}).front(), CandidateOutcome::worse);
  EXPECT_TRUE(store.wants(make(0, 1000).sidecar));
  EXPECT_EQ(store.put(std::vector{make(0, 1000, 3)}).front(), CandidateOutcome::replaced);
  EXPECT_EQ(store.tiles(), 1U);
  store.close();
  ASSERT_EQ(read().size(), 1U);
  EXPECT_EQ(read().front().tile, make(0, 1000, 3).tile);
}

TEST(CandidateCost, GrowsWithSigmaViewAngleAndBlurAndSoftComesLast) {
  const CandidateSidecar base = test::sample_sidecar(key(0));
  CandidateSidecar other = base;
  other.pose.sigma_mm += 100;
  EXPECT_GT(cost_mm(other), cost_mm(base));
  other = base;
  other.quality.view_angle_mdeg += 5000;
  EXPECT_GT(cost_mm(other), cost_mm(base));
  other = base;
  other.quality.sharpness_ppm /= 2;
  EXPECT_GT(cost_mm(other), cost_mm(base));
  other = base;
  other.trust = CandidateTrust::soft;
  other.pose.sigma_mm = 1;
  EXPECT_GT(cost_mm(other), cost_mm(base));
}

TEST_F(Candidates, KeepToTheBudget) {
  const std::uint64_t one = make(0).tile.size() + make(0).sidecar_bytes.size();
  CandidateStore store(path(), {.budget_bytes = 3 * one});
  std::size_t added = 0;
  for (std::uint32_t i = 0; i < 10; ++i) added += store.put(std::vector{make(i)}).front() == CandidateOutcome::added;
  EXPECT_LE(store.bytes(), 3 * one);
  EXPECT_GE(added, 2U);
  EXPECT_EQ(store.tiles(), added);
  EXPECT_EQ(store.put(std::vector{make(0, 1000)}).front(), CandidateOutcome::replaced)
      << "a better one takes no more room";
}

TEST_F(Candidates, ContinueAfterACleanEndAndCountExistingTiles) {
  {
    CandidateStore store(path());
    store.put(std::vector{make(0), make(1)});
    store.close();
  }
  CandidateStore store(path());
  EXPECT_EQ(store.tiles(), 2U);
  const std::uint64_t bytes =
      make(0).tile.size() + make(0).sidecar_bytes.size() + make(1).tile.size() + make(1).sidecar_bytes.size();
  EXPECT_EQ(store.bytes(), bytes);
  EXPECT_EQ(store.put(std::vector{make(0)}).front(), CandidateOutcome::worse);
  store.put(std::vector{make(2)});
  EXPECT_THROW(CandidateReader{path()}, Error) << "while it is written";
  EXPECT_THROW(CandidateStore{path()}, Error) << "two writers";
  store.close();
  EXPECT_EQ(read().size(), 3U);
}

TEST_F(Candidates, AreNeverWrittenIntoAPackage) {
  std::filesystem::create_directories(path());
  {
    MbtilesWriter package(file());
    package.add(key(0), make(0).tile);
    package.set_metadata({{"name", "a package"}, {"format", "jpg"}});
    package.finish();
  }
  const Bytes before = read_file(file());
  EXPECT_THROW(CandidateStore{path()}, UsageError);
  EXPECT_EQ(read_file(file()), before);
  EXPECT_THROW(CandidateReader{path()}, Error);
}

TEST_F(Candidates, RejectOtherFormatsAndFiles) {
  { CandidateStore(path()).close(); }
  EXPECT_THROW(CandidateStore(path(), {.format = ImageFormat::webp}), UsageError);
  EXPECT_THROW(CandidateStore(folder_ / "png", {.format = ImageFormat::png}), UsageError);
  folder_.write("file", "text");
  EXPECT_THROW(CandidateStore{folder_ / "file"}, UsageError);
  std::filesystem::create_directories(folder_ / "other");
  folder_.write("other/tiles.mbtiles", "this is no database, and long enough to have a page of bytes");
  EXPECT_THROW(CandidateStore{folder_ / "other"}, Error);
  EXPECT_THROW(CandidateReader{folder_ / "other"}, Error);
  EXPECT_THROW(CandidateReader{folder_ / "missing"}, Error);
}

TEST_F(Candidates, AMismatchWithTheSidecarStoresNothing) {
  CandidateStore store(path());
  Candidate swapped = make(1);
  swapped.tile = make(1, 2000, 5).tile;
  EXPECT_THROW(store.put(std::vector{make(0), swapped}), Error);
  EXPECT_EQ(store.tiles(), 0U);
  EXPECT_EQ(store.bytes(), 0U);
  store.put(std::vector{make(2)});
  store.close();
  EXPECT_EQ(read().size(), 1U);
}

TEST_F(Candidates, AreVerifiedByTheirDigest) {
  CandidateStore store(path());
  store.put(std::vector{make(0), make(1), make(2), make(3), make(4), make(5)});
  store.close();
  {
    const SqliteDatabase forged = SqliteDatabase::open_writable(file());
    const auto at = [](std::uint32_t number) {
      return " WHERE tile_column = " + std::to_string(key(number).x) +
             " AND tile_row = " + std::to_string(key(number).tms_row());
    };
    forged.execute("UPDATE tiles SET tile_data = x'00'" + at(0));
    forged.execute("DELETE FROM tiles" + at(1));
    forged.execute("UPDATE nadir_candidates SET sidecar = 'hostile' || char(27)" + at(2));
    forged.execute("UPDATE nadir_candidates SET signature = x'00'" + at(3));
    forged.execute("UPDATE nadir_candidates SET zoom_level = 99" + at(4));
  }
  const auto all = read(true);
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all.front().sidecar.key, key(5));
}

// Cut anywhere, a file is an Error or fewer candidates, never a crash nor a false one.
TEST_F(Candidates, SurviveTruncatedFiles) {
  CandidateStore store(path());
  store.put(std::vector{make(0), make(1), make(2)});
  store.close();
  const Bytes whole = read_file(file());
  for (std::size_t size = 0; size < whole.size(); size += whole.size() / 23) {
    std::filesystem::create_directories(folder_ / "cut");
    write_file_atomic(folder_ / "cut" / kCandidateFile, ByteView(whole).first(size));
    try {
      CandidateReader reader(folder_ / "cut");
      Findings findings;
      while (const auto candidate = reader.next(findings)) EXPECT_EQ(candidate->tile.size(), candidate->sidecar.size);
    } catch (const Error&) {
    }
  }
}

// A child puts tiles and announces each; it is killed after some. What it announced is there, whole.
TEST_F(Candidates, SurviveAKilledWriter) {
  for (const int announced : {1, 4, 9}) {
    std::filesystem::remove_all(path());
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    if (child == 0) {
      CandidateStore store(path());
      for (std::uint32_t i = 0;; ++i) {
        store.put(std::vector{make(i)});
        if (write(ends[1], "x", 1) != 1) _exit(1);
      }
    }
    close(ends[1]);
    char mark = 0;
    for (int i = 0; i < announced; ++i) ASSERT_EQ(::read(ends[0], &mark, 1), 1);
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    close(ends[0]);
    ASSERT_TRUE(WIFSIGNALED(status));
    const auto all = read();
    EXPECT_GE(all.size(), static_cast<std::size_t>(announced));
    EXPECT_FALSE(CandidateReader(path()).clean_shutdown());
    CandidateStore again(path());
    EXPECT_EQ(again.tiles(), all.size());
    again.put(std::vector{make(400)});
    again.close();
    EXPECT_EQ(read().size(), all.size() + 1);
    EXPECT_TRUE(CandidateReader(path()).clean_shutdown());
  }
}

// Killed when half of a transaction is in the file already: the journal takes it back.
TEST_F(Candidates, AnIncompleteTransactionIsRolledBack) {
  CandidateStore store(path());
  store.put(std::vector{make(0)});
  store.close();
  const pid_t child = fork();
  if (child == 0) {
    const SqliteDatabase database = SqliteDatabase::open_writable(file());
    database.execute(
        "PRAGMA cache_size = 1; PRAGMA cache_spill = 1; BEGIN;"
        "UPDATE tiles SET tile_data = zeroblob(20000);"
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 300)"
        "INSERT INTO tiles SELECT 19, i, i, zeroblob(4000) FROM n;");
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFSIGNALED(status));
  ASSERT_GT(std::filesystem::file_size(file().string() + "-journal"), 0U);
  const auto all = read();
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all.front().tile, make(0).tile);
  EXPECT_FALSE(std::filesystem::exists(file().string() + "-journal"));
}

// Writing beyond so many bytes of a file fails, as on a full disk. In a child: the limit is the process'.
TEST_F(Candidates, AFullDiskLosesOnlyTheTilesThatDoNotFit) {
  const pid_t child = fork();
  if (child == 0) {
    std::signal(SIGXFSZ, SIG_IGN);
    CandidateStore store(path());
    for (std::uint32_t i = 0; i < 5; ++i) store.put(std::vector{make(i)});
    const rlim_t size = std::filesystem::file_size(file()) + 6000;
    rlimit old{};
    getrlimit(RLIMIT_FSIZE, &old);
    const rlimit limit{size, old.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
    int failed = 0;
    for (std::uint32_t i = 5; i < 9; ++i) {
      try {
        store.put(std::vector{make(i)});
      } catch (const Error&) {
        ++failed;
      }
    }
    setrlimit(RLIMIT_FSIZE, &old);
    if (failed == 0 || store.tiles() != 9U - static_cast<unsigned>(failed)) _exit(2);
    store.put(std::vector{make(20)});  // there is room again
    store.close();
    _exit(failed);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  const int failed = WEXITSTATUS(status);
  ASSERT_GT(failed, 2) << "the limit must have been met";
  EXPECT_EQ(read().size(), 10U - static_cast<std::size_t>(failed));
}

// The same tiles in the same order: the same file.
TEST_F(Candidates, TheFileIsAFunctionOfTheCalls) {
  std::vector<Bytes> files;
  for (const char* name : {"a", "b"}) {
    CandidateStore store(folder_ / name);
    for (std::uint32_t i = 0; i < 12; ++i) store.put(std::vector{make(i, 2000), make(i / 2, 1500)});
    store.close();
    files.push_back(read_file(folder_ / name / kCandidateFile));
  }
  EXPECT_EQ(files.front(), files.back());
}

}  // namespace
}  // namespace nadir
