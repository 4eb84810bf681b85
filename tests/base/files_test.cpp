#include "base/files.hpp"

#include <fcntl.h>
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

// A name like ".tmpPID" is predictable: a link planted there would redirect the write.
TEST(Files, FollowNoLinkThatWasPlanted) {
  const test::TemporaryFolder folder;
  folder.write("victim", "precious");
  fs::create_symlink(folder / "victim", folder / ("f.tmp" + std::to_string(::getpid())));
  fs::create_symlink(folder / "victim", folder / "f");
  write_file_atomic(folder / "f", std::string_view("new"));
  EXPECT_EQ(read_text_file(folder / "victim"), "precious");
  EXPECT_FALSE(fs::is_symlink(folder / "f")) << "the link itself is replaced";
  EXPECT_EQ(read_text_file(folder / "f"), "new");
}

// With a predictable name, an attacker who creates the file first, with a mode of his own, reads the key before the
// mode is set.
TEST(Files, ASecretCannotBeOpenedBeforeItIsComplete) {
  const test::TemporaryFolder folder;
  const fs::path guessed = folder / ("key.tmp" + std::to_string(::getpid()));
  const int fd = ::open(guessed.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  ASSERT_GE(fd, 0);
  write_file_atomic(folder / "key", std::string_view("secret"), 0600);
  char byte = 0;
  EXPECT_EQ(::pread(fd, &byte, 1, 0), 0) << "the key was written into it";
  ::close(fd);
}

TEST(Files, HaveTheirModeWhateverTheMask) {
  const test::TemporaryFolder folder;
  for (const unsigned mask : {0U, 0077U}) {
    for (const unsigned mode : {0600U, 0644U}) {
      for (const auto until : {PendingFile::Until::unnamed, PendingFile::Until::hidden_name}) {
        const mode_t before = ::umask(mask);
        PendingFile(folder / "f", as_bytes("x"), mode, until).replace();
        ::umask(before);
        struct stat status {};
        ASSERT_EQ(::stat((folder / "f").c_str(), &status), 0);
        EXPECT_EQ(status.st_mode & 0777U, mode);
      }
    }
  }
}

std::ptrdiff_t entries_in(const test::TemporaryFolder& folder) {
  return std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator());
}

class PendingFiles : public ::testing::TestWithParam<PendingFile::Until> {
 protected:
  PendingFile pending(const char* name, std::string_view text) {
    return PendingFile(folder_ / name, as_bytes(text), 0644, GetParam());
  }
  test::TemporaryFolder folder_;
};

TEST_P(PendingFiles, CreateNeverReplaces) {
  EXPECT_TRUE(pending("f", "first").create());
  EXPECT_FALSE(pending("f", "second").create());
  EXPECT_EQ(read_text_file(folder_ / "f"), "first");
  fs::create_symlink(folder_ / "nowhere", folder_ / "dangling");
  EXPECT_FALSE(pending("dangling", "x").create());
  EXPECT_FALSE(fs::exists(folder_ / "nowhere"));
  EXPECT_EQ(entries_in(folder_), 2);
}

TEST_P(PendingFiles, ReplaceTakesTheWholePlace) {
  pending("f", "a longer text").replace();
  pending("f", "short").replace();
  EXPECT_EQ(read_text_file(folder_ / "f"), "short");
  fs::create_directory(folder_ / "d");
  EXPECT_THROW(pending("d", "x").replace(), Error);
  EXPECT_EQ(entries_in(folder_), 2);
}

TEST_P(PendingFiles, LeaveNothingWhenDropped) {
  { PendingFile dropped = pending("f", "x"); }
  EXPECT_EQ(entries_in(folder_), 0);
}

TEST_P(PendingFiles, MayHaveTheLongestName) {
  const std::string name(255, 'n');
  pending(name.c_str(), "x").replace();
  pending(name.c_str(), "y").replace();
  EXPECT_EQ(read_text_file(folder_ / name), "y");
}

INSTANTIATE_TEST_SUITE_P(Both, PendingFiles,
                         ::testing::Values(PendingFile::Until::unnamed, PendingFile::Until::hidden_name));

// Killed after the bytes were written: with an unnamed file nothing is left, not even a hidden name.
TEST(Files, ADeadProcessLeavesNothing) {
  const test::TemporaryFolder folder;
  const pid_t child = ::fork();
  if (child == 0) {
    const PendingFile file(folder / "f", as_bytes("complete"));
    ::raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(entries_in(folder), 0);
}

TEST(StagingDirectory, FollowsNoLinkInPlaceOfItsLock) {
  const test::TemporaryFolder folder;
  fs::create_symlink(folder / "elsewhere", folder / ".out.lock");
  EXPECT_THROW(StagingDirectory(folder / "out"), Error);
  EXPECT_FALSE(fs::exists(folder / "elsewhere"));
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
