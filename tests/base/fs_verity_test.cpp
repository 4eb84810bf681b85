#include "base/fs_verity.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class FsVerity : public ::testing::Test {
 protected:
  std::filesystem::path file_of(std::size_t size, std::uint64_t seed = 3) {
    Random random(seed);
    std::string text(size, '\0');
    for (char& c : text) c = static_cast<char>(random.integer(0, 255));
    return folder_.write("f", text);
  }
  std::string digest_of(const std::string& text) { return verity_digest(InputFile(folder_.write("g", text)), 1).hex(); }

  test::TemporaryFolder folder_;
};

TEST_F(FsVerity, KnownAnswers) {  // of fsverity-utils 1.5
  EXPECT_EQ(digest_of(""), "3d248ca542a24fc62d1c43b916eae5016878e2533c88238480b26128a1f1af95");
  EXPECT_EQ(digest_of(std::string(4096, 'a')), "a2a808ddaced77f0b6b3068f47b14b5a1fb3fc43674993ab11b8e7e6f2d089e2");
  EXPECT_EQ(digest_of(std::string(600'000, 'a')), "1dbcfd45ca6c4a34e3bdd875ae84c6624a0cbe31327e0d5ddb6e08b89a9140ab");
}

// Around the ends of a block, of the blocks that one block of digests holds, and of the pieces that threads read.
TEST_F(FsVerity, AgreesWithFsverityUtils) {
  if (test::run_shell("command -v fsverity").code != 0) GTEST_SKIP() << "NOT TESTED: needs Debian's package fsverity";
  for (const std::size_t size :
       {0U, 1U, 4095U, 4096U, 4097U, 8192U, 524'288U, 524'289U, 1'048'576U, 1'048'577U, 3'000'001U, 67'112'961U}) {
    const auto path = file_of(size);
    const auto oracle = test::run_shell("fsverity digest --compact " + path.string());
    ASSERT_EQ(oracle.code, 0) << oracle.err;
    const InputFile file(path);
    for (const int threads : {1, 2, 3}) {
      EXPECT_EQ(verity_digest(file, threads).hex(), oracle.out.substr(0, 64)) << size << " bytes, " << threads;
    }
    EXPECT_EQ(digests_of(file).verity.hex(), oracle.out.substr(0, 64)) << size;
    EXPECT_EQ(digests_of(file).sha256, sha256_file(path)) << size;
  }
}

TEST_F(FsVerity, OtherBytesWithTheSameTreesHaveOtherDigests) {
  // Zeros that the last block is filled up with.
  EXPECT_NE(digest_of("map"), digest_of(std::string("map") + '\0'));
  EXPECT_NE(digest_of(std::string(4096, '\0')), digest_of(std::string(8192, '\0')));
  EXPECT_NE(digest_of(""), digest_of(std::string(1, '\0')));
  // Blocks that change places.
  const std::string a(4096, 'a'), b(4096, 'b');
  EXPECT_NE(digest_of(a + b), digest_of(b + a));
  // The digests of a file's blocks, as a file: its tree is the upper part of the other's.
  std::string level;
  for (const std::string& block : {a, b}) {
    const Sha256 digest = sha256(as_bytes(block));
    level.append(digest.bytes.begin(), digest.bytes.end());
  }
  level.resize(4096);
  EXPECT_NE(digest_of(a + b), digest_of(level));
}

TEST_F(FsVerity, CountsPiecesAndSurvivesAFileThatShrinks) {
  const auto path = file_of(3'000'000);
  const InputFile file(path);
  int pieces = 0;
  const Sha256 whole = verity_digest(file, 2, [&] { ++pieces; });
  EXPECT_EQ(pieces, 3);
  std::filesystem::resize_file(path, 2'000'000);
  EXPECT_NE(verity_digest(file, 2), whole);
  EXPECT_NE(digests_of(file).verity, whole);
}

}  // namespace
}  // namespace nadir
