#include "base/files.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/error.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

TEST(Files, ReadsWhatWasWritten) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder / "f", std::string_view("abc\0def", 7));
  EXPECT_EQ(read_text_file(folder / "f"), std::string("abc\0def", 7));
}

TEST(Files, WritesPrivateKeysWithMode0600) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder / "key", std::string_view("secret"), 0600);
  struct stat status {};
  ASSERT_EQ(::stat((folder / "key").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
}

TEST(Files, RejectsOversizedOrIrregularFiles) {
  const test::TemporaryFolder folder;
  folder.write("f", "12345");
  EXPECT_THROW(read_file(folder / "none"), Error);
  EXPECT_THROW(read_file(folder.path()), Error);
  EXPECT_THROW(read_file(folder / "f", 4), Error);
  EXPECT_EQ(read_file(folder / "f", 5).size(), 5U);
}

TEST(Files, LeavesNoTemporaryFiles) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder / "f", std::string_view("one"));
  write_file_atomic(folder / "f", std::string_view("two"));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
  EXPECT_THROW(write_file_atomic(folder / "no" / "f", std::string_view("x")), Error);
}

TEST(StagingDirectory, AppearsAtomicallyOnCommit) {
  const test::TemporaryFolder folder;
  {
    StagingDirectory staging(folder / "out");
    write_file_atomic(staging.path() / "a", std::string_view("a"));
    EXPECT_FALSE(fs::exists(folder / "out"));
    staging.commit();
  }
  EXPECT_EQ(read_text_file(folder / "out" / "a"), "a");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}

TEST(StagingDirectory, LeavesNothingWithoutCommit) {
  const test::TemporaryFolder folder;
  {
    StagingDirectory staging(folder / "out");
    write_file_atomic(staging.path() / "a", std::string_view("a"));
  }
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(StagingDirectory, NeverReplaces) {
  const test::TemporaryFolder folder;
  folder.write("out", "mine");
  EXPECT_THROW(StagingDirectory(folder / "out"), Error);
  StagingDirectory staging(folder / "later");
  folder.write("later", "in the meantime");
  EXPECT_THROW(staging.commit(), Error);
  EXPECT_EQ(read_text_file(folder / "later"), "in the meantime");
}

TEST(StagingDirectory, SeparatesConcurrentBuilders) {
  const test::TemporaryFolder folder;
  StagingDirectory first(folder / "out");
  EXPECT_THROW(StagingDirectory(folder / "out"), Error);
}

TEST(StagingDirectory, TakesOverTheFilesOfADeadProcess) {
  const test::TemporaryFolder folder;
  const pid_t child = ::fork();
  if (child == 0) {
    StagingDirectory staging(folder / "out");
    write_file_atomic(staging.path() / "half", std::string_view("half"));
    ::raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_FALSE(fs::exists(folder / "out"));
  {
    StagingDirectory staging(folder / "out");
    EXPECT_FALSE(fs::exists(staging.path() / "half"));
    write_file_atomic(staging.path() / "whole", std::string_view("whole"));
    staging.commit();
  }
  EXPECT_FALSE(fs::exists(folder / "out" / "half"));
  EXPECT_TRUE(fs::exists(folder / "out" / "whole"));
}

}  // namespace
}  // namespace nadir
